//! Responses equal the program's output for the same queries.

use super::common::command::stdout;
use super::{Server, fixture, island};

/// Runs the program with files of a directory. Returns its output.
fn program(directory: &tempfile::TempDir, arguments: &[&str]) -> String {
    let path = |word: &&str| match word.ends_with(".goblin") || word.contains(".autumn") {
        true => directory.path().join(word).to_str().unwrap().to_owned(),
        false => (*word).to_owned(),
    };
    let arguments: Vec<String> = arguments.iter().map(path).collect();
    stdout(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
}

#[test]
fn served_files_are_listed() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    assert_eq!(server.get("/healthz").json()["status"], "ok");
    let page = server.get("/");
    assert_eq!(page.header("content-type"), Some("text/html; charset=utf-8"));
    assert!(page.text().to_lowercase().contains("<!doctype html>") && page.text().contains("classes.goblin"));
    let style = server.get("/assets/page.css");
    assert_eq!(style.header("content-type"), Some("text/css; charset=utf-8"));
    let tag = style.header("etag").unwrap().to_owned();
    assert!(!style.good().is_empty());
    assert_eq!(server.get_with("/assets/page.css", &[("If-None-Match", &tag)]).status, 304);
    for name in ["nothing.js", "../Cargo.toml", "..%2fCargo.toml", "%2fetc%2fpasswd", "js", ""] {
        server.get(&format!("/assets/{name}")).complaint(404);
    }
    let files = server.get("/files.json").json();
    let first = &files["files"][2];
    assert_eq!((first["name"].as_str(), first["file"].as_str()), (Some("classes"), Some("classes.goblin")));
    assert_eq!(first["bytes"], std::fs::metadata(directory.path().join("classes.goblin")).unwrap().len());
    for (method, target) in
        [("POST", "/"), ("PUT", "/classes.goblin"), ("DELETE", "/classes.goblin"), ("GET", "/zonal/classes")]
    {
        server.connect().request(method, target, &[], b"").unwrap().complaint(405);
    }
    for target in ["/a/b", "/point", "/point/classes/1", "/tiles", "/favicon.ico", "/nothing"] {
        server.get(target).complaint(404);
    }
    // A file added later is served as well.
    std::fs::copy(fixture("v1/rgb.goblin"), directory.path().join("new.goblin")).unwrap();
    server.get("/new.goblin").good();
    server.get("/window/new?format=webp").good();
}

#[test]
fn points_are_those_of_the_program() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    for (file, query, arguments) in [
        ("classes", "x=305000&y=3196000", &["305000,3196000"][..]),
        ("classes", "x=1&y=2", &["1,2"]),
        ("heights", "x=305000&y=3196000&level=3", &["305000,3196000", "--level", "3"]),
        ("heights", "x=-16.97&y=28.88&crs=lonlat", &["--in", "lonlat", "--", "-16.97,28.88"]),
        ("heights", "x=100&y=50&crs=cells", &["100,50", "--in", "cells"]),
        ("heights", "x=-1888000&y=3361000&crs=EPSG:3857", &["--in", "EPSG:3857", "--", "-1888000,3361000"]),
        ("stack", "x=3&y=4&crs=cells", &["3,4", "--in", "cells"]),
        ("stack", "x=3&y=4&crs=cells&layer=0", &["3,4", "--in", "cells", "--layer", "0"]),
        ("ball", "x=8&y=8&z=8&crs=cells", &["8,8,8", "--in", "cells"]),
        ("history", "x=8&y=8&crs=cells", &["8,8", "--in", "cells"]),
    ] {
        let ending = if file == "history" { "autumn" } else { "goblin" };
        let name = format!("{file}.{ending}");
        let expected = program(&directory, &[&["point", &*name, "--json"], arguments].concat());
        let response = server.get(&format!("/point/{file}?{query}"));
        assert_eq!(response.header("content-type"), Some("application/json"));
        assert_eq!(String::from_utf8(response.good()).unwrap(), expected, "{file} {query}");
    }
    let expected = program(&directory, &["point", "history.autumn@1", "8,8", "--in", "cells", "--json"]);
    assert_eq!(server.get("/point/history?x=8&y=8&crs=cells&commit=1").text(), expected);
    for (target, what) in [
        ("classes?x=1", "y"),
        ("classes?x=1&y=b", "y"),
        ("classes?x=1&y=inf", "finite"),
        ("classes?x=1&y=1&x=2", "twice"),
        ("classes?x=1&y=1&w=2", "parameter `w`"),
        ("classes?x=1&y=1&crs=nonsense", "coordinates"),
        ("classes?x=1&y=1&crs=@/etc/passwd", "coordinates"),
        ("classes?x=1&y=1&level=99", "level"),
        ("classes?x=1&y=1&layer=other", "layer"),
        ("ball?x=1&y=1", "z"),
        ("history?x=1&y=1&commit=999", "999"),
    ] {
        let response = server.get(&format!("/point/{target}"));
        let message = response.complaint(response.status);
        assert!(
            (400..500).contains(&response.status) && message.contains(what),
            "{target}: {} {message}",
            response.status
        );
    }
    server.get("/point/chapel?x=1&y=1").complaint(422);
}

#[test]
fn windows_are_those_of_the_program() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let made = directory.path().join("made");
    std::fs::create_dir(&made).unwrap();
    for (query, file, format, arguments) in [
        ("classes?size=64x50", "classes.goblin", "png", &["--size", "64x50"][..]),
        ("classes?size=64", "classes.goblin", "png", &["--size", "64"]),
        ("classes?level=5&format=npy", "classes.goblin", "npy", &["--level", "5"]),
        ("heights?cells=20,30,64,32", "heights.goblin", "png", &["--window", "20,30,64,32"]),
        ("heights?cells=20,30,64,32&format=npy", "heights.goblin", "npy", &["--window", "20,30,64,32"]),
        ("heights?cells=20,30,64,32&format=webp", "heights.goblin", "webp", &["--window", "20,30,64,32"]),
        (
            "heights?style=hillshade&size=100",
            "heights.goblin",
            "png",
            &["--style", "hillshade", "--size", "100"],
        ),
        (
            "heights?bounds=303000,3194000,307000,3198000&level=6",
            "heights.goblin",
            "png",
            &["--in", "world", "--window", "303000,3194000,307000,3198000", "--level", "6"],
        ),
        (
            "heights?bounds=-17,28.85,-16.98,28.88&crs=lonlat&size=32x32&format=npy",
            "heights.goblin",
            "npy",
            &["--in", "lonlat", "--window=-17,28.85,-16.98,28.88", "--size", "32x32"],
        ),
        ("stack?layer=0&format=npy", "stack.goblin", "npy", &["--layer", "0"]),
        (
            "stack?layer=cover,cover&size=40",
            "stack.goblin",
            "png",
            &["--layer", "cover,cover", "--size", "40"],
        ),
        ("ball?z=7&format=npy", "ball.goblin", "npy", &["--slice", "z=7"]),
        ("history?commit=1&format=npy", "history.autumn@1", "npy", &[]),
    ] {
        let output = made.join(format!("out.{format}"));
        program(&directory, &[&["get", file, output.to_str().unwrap(), "--quiet"], arguments].concat());
        let response = server.get(&format!("/window/{query}"));
        let kind = response.header("content-type").unwrap().to_owned();
        assert!(kind.ends_with(format) || format == "npy" && kind.ends_with("octet-stream"), "{kind}");
        assert!(response.good() == std::fs::read(output).unwrap(), "{query}");
    }
    let window = server.get("/window/heights?cells=100,80,3,2&format=json").json();
    assert_eq!((&window["columns"], &window["rows"], &window["level"]), (&3.into(), &2.into(), &8.into()));
    let tree = spinney::open(directory.path().join("heights.goblin")).unwrap();
    let mut value = [spinney::Number::default(); 4];
    for (row, values) in window["values"].as_array().unwrap().iter().enumerate() {
        for (column, found) in values.as_array().unwrap().iter().enumerate() {
            let is_there =
                tree.point([100 + column as u64, 80 + row as u64, 0], tree.depth(), &mut value).unwrap();
            let expected = is_there.then(|| value[0].to_f64() as f32);
            assert_eq!(found.as_f64().map(|found| found as f32), expected);
        }
    }
    let tag = server.get("/window/heights?size=9").header("etag").unwrap().to_owned();
    assert_eq!(server.get_with("/window/heights?size=9", &[("If-None-Match", &tag)]).status, 304);
    server.get_with("/window/heights?size=10", &[("If-None-Match", &tag)]).good();
    for (target, status, what) in [
        ("heights?size=100000", 413, "pixels"),
        ("heights?size=18446744073709551615x18446744073709551615", 413, "pixels"),
        ("heights?size=0", 400, "size"),
        ("heights?size=3x", 400, "size"),
        ("heights?size=3&level=3", 400, "level"),
        ("heights?level=9", 400, "level"),
        ("heights?level=256", 400, "level"),
        ("heights?cells=0,0,0,5", 400, "cells"),
        ("heights?cells=0,0,5", 400, "cells"),
        ("heights?cells=99999,0,5,5", 400, "outside"),
        ("heights?cells=18446744073709551615,18446744073709551615,18446744073709551615,1", 400, "outside"),
        ("heights?bounds=5,44,7,48&crs=lonlat", 400, "outside"),
        ("heights?bounds=7,4,5,8", 400, "got"),
        ("heights?bounds=1,2,3,4&cells=1,2,3,4", 400, "both"),
        ("heights?format=tif", 400, "format"),
        ("heights?format=npy&style=terrain", 400, "style"),
        ("heights?style=/etc/passwd", 400, "style"),
        ("heights?style={", 400, ""),
        ("heights?z=1", 400, "z"),
        ("ball?z=99999", 400, "z"),
        ("stack", 400, "layer"),
        ("stack?layer=0,1&format=npy", 400, "layer"),
        ("stack?layer=0,1,0,1,0,1", 400, ""),
    ] {
        let message = server.get(&format!("/window/{target}")).complaint(status);
        assert!(message.contains(what), "{target}: {message}");
    }
}

#[test]
fn zones_are_those_of_the_program() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let districts = fixture("island_districts.geojson");
    let body = std::fs::read(&districts).unwrap();
    for (file, query, arguments) in [
        ("classes", "", &[][..]),
        ("classes", "edge=area", &["--edge", "area"]),
        (
            "heights",
            "edge=touch&quantiles=0.1,0.5&measure=majority,median",
            &["--edge", "touch", "--quantiles", "0.1,0.5", "--measure", "majority,median"],
        ),
        ("heights", "attribute=name", &["--attribute", "name"]),
        ("heights", "where=name=North%20shore", &["--where", "name=North shore"]),
    ] {
        let name = format!("{file}.goblin");
        let expected =
            program(&directory, &[&["stats", &*name, "--zones", &districts, "--json"], arguments].concat());
        let response = server.post(&format!("/zonal/{file}?{query}"), &body);
        assert_eq!(response.header("content-type"), Some("application/json"));
        assert_eq!(String::from_utf8(response.good()).unwrap(), expected, "{file} {query}");
    }
    // A polygon in degrees, partly outside of a raster in metres; and a column of an octree, which
    // has a volume.
    let lonlat = "[[[-17.2,28.7],[-17,28.7],[-17,28.9],[-17.2,28.9],[-17.2,28.7]]]";
    let column = "[[[0,0],[9,0],[9,9],[0,9],[0,0]]]";
    for (file, ring, query, arguments) in [
        ("classes", lonlat, "edge=area", &["--edge", "area"][..]),
        ("ball", column, "edge=area&crs=cells", &["--edge", "area", "--in", "cells"]),
    ] {
        let body = format!(r#"{{"type":"Polygon","coordinates":{ring}}}"#);
        let zone = directory.path().join("zone.geojson");
        std::fs::write(&zone, &body).unwrap();
        let name = format!("{file}.goblin");
        let command = [&["stats", &*name, "--zones", zone.to_str().unwrap(), "--json"], arguments].concat();
        let expected = program(&directory, &command);
        let response = server.post(&format!("/zonal/{file}?{query}"), body.as_bytes());
        assert_eq!(String::from_utf8(response.good()).unwrap(), expected, "{file}");
        let json: serde_json::Value = serde_json::from_str(&expected).unwrap();
        let zone = &json["zones"][0];
        assert!(file == "ball" || zone["outside_cells"].as_f64().unwrap() > 0.0, "{zone}");
        assert_eq!(zone.get("volume").is_some(), file == "ball", "{zone}");
    }
    // Vertices may have any finite coordinates.
    let far = br#"{"type":"Polygon","coordinates":[[[0,0],[1e308,1e308],[-1e308,1e308],[0,0]]]}"#;
    for edge in ["centre", "touch", "area"] {
        let response = server.post(&format!("/zonal/history?edge={edge}&crs=cells"), far);
        assert!(response.status < 500, "{response:?}");
    }
    let point = br#"{"type":"Point","coordinates":[1,2]}"#;
    for (query, body, what) in [
        ("", &b""[..], ""),
        ("", b"[1,2", ""),
        ("", b"{\"type\":\"Polygon\"}", ""),
        ("", point, "polygon"),
        ("", b"{\"type\":\"Polygon\",\"coordinates\":[[[1,2],[3,4],[5,7],[1,2]]]}", "outside"),
        ("edge=half", &body, "edge"),
        ("quantiles=2", &body, "quantile"),
        ("measure=size", &body, "measure"),
        ("attribute=nothing", &body, "nothing"),
        ("where=nothing", &body, "where"),
    ] {
        let response = server.post(&format!("/zonal/classes?{query}"), body);
        let message = response.complaint(response.status);
        assert!(
            (400..500).contains(&response.status) && message.contains(what),
            "{query}: {} {message}",
            response.status
        );
    }
}
