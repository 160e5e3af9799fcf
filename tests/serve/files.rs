//! The files themselves: whole, in ranges, under conditions; names, and path traversal.

use std::os::unix::fs::symlink;

use super::common::command::stdout;
use super::{Server, fixture, island};

#[test]
fn files_come_whole_and_in_ranges() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let bytes = std::fs::read(directory.path().join("classes.goblin")).unwrap();
    let whole = server.get("/classes.goblin");
    let tag = whole.header("etag").unwrap().to_owned();
    assert!(tag.starts_with('"') && tag.ends_with('"') && tag.len() > 10, "{tag}");
    for (name, value) in [
        ("accept-ranges", "bytes"),
        ("content-type", "application/octet-stream"),
        ("access-control-allow-origin", "*"),
    ] {
        assert_eq!(whole.header(name), Some(value));
    }
    assert!(whole.header("content-encoding").is_none());
    assert!(whole.header("access-control-expose-headers").unwrap().contains("Content-Range"));
    assert!(whole.good() == bytes);
    let length = bytes.len();
    for (range, first, end) in [
        ("bytes=0-0", 0, 1),
        ("bytes=100-299", 100, 300),
        ("bytes=-77", length - 77, length),
        ("bytes=-99999999999999999999", 0, length),
        ("bytes=5-99999999999999999999", 5, length),
        ("bytes=7-", 7, length),
    ] {
        let part = server.get_with("/classes.goblin", &[("Range", range), ("If-Range", &tag)]);
        assert_eq!(part.status, 206, "{range}");
        let expected = format!("bytes {first}-{}/{length}", end - 1);
        assert_eq!(part.header("content-range"), Some(&*expected), "{range}");
        assert_eq!(part.header("etag"), Some(&*tag));
        assert!(part.body == bytes[first..end], "{range}");
    }
    // An invalid range, and a range of another version of the file, return the whole file.
    for headers in [
        &[("Range", "bytes=3-2")][..],
        &[("Range", "rows=0-1")],
        &[("Range", "bytes=0-1"), ("If-Range", "\"other\"")],
        &[("Range", "bytes=0-1"), ("If-Range", "Thu, 26 Nov 2026 18:00:00 GMT")],
        &[("If-Match", &tag)],
        &[("If-None-Match", "\"other\"")],
    ] {
        assert!(server.get_with("/classes.goblin", headers).good() == bytes, "{headers:?}");
    }
    for range in ["bytes=0-1,4-5".to_owned(), format!("bytes={length}-"), "bytes=-0".to_owned()] {
        server.get_with("/classes.goblin", &[("Range", &range)]).complaint(416);
    }
    let weak = format!("W/{tag}");
    for given in [&*tag, &*weak, "*", &*format!("\"x\", {tag}")] {
        let same = server.get_with("/classes.goblin", &[("If-None-Match", given)]);
        assert_eq!((same.status, same.header("etag")), (304, Some(&*tag)), "{given}");
    }
    server.get_with("/classes.goblin", &[("If-Match", "\"other\"")]).complaint(412);
    // HEAD requests return only heads, and the connection continues.
    let mut connection = server.connect();
    let head = connection.request("HEAD", "/classes.goblin", &[("Range", "bytes=0-9")], b"").unwrap();
    assert_eq!((head.status, head.header("content-length")), (200, Some(&*length.to_string())));
    assert!(connection.get("/classes.goblin").unwrap().good() == bytes);
}

#[test]
fn large_files_are_sent_in_ranges() {
    let directory = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> =
        (0..3_000_001u32).map(|number| (number.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    std::fs::write(directory.path().join("any.goblin"), &bytes).unwrap();
    let server = Server::start(directory.path(), &[]);
    assert!(server.get("/any.goblin").good() == bytes);
    let part = server.get_with("/any.goblin", &[("Range", "bytes=1000-2999999")]);
    assert!(part.status == 206 && part.body == bytes[1000..3_000_000]);
    // It is not a tree, which queries report.
    server.get("/point/any?x=1&y=1").complaint(500);
}

#[test]
fn empty_files_have_no_ranges() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("empty.goblin"), b"").unwrap();
    let server = Server::start(directory.path(), &[]);
    assert!(server.get("/empty.goblin").good().is_empty());
    server.get_with("/empty.goblin", &[("Range", "bytes=0-")]).complaint(416);
}

#[test]
fn pages_of_all_origins_may_send_requests() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    for target in ["/", "/classes.goblin", "/zonal/classes", "/nothing/there"] {
        let headers = [("Origin", "http://elsewhere"), ("Access-Control-Request-Headers", "range")];
        let response = server.connect().request("OPTIONS", target, &headers, b"").unwrap();
        assert_eq!(response.status, 204);
        let methods = response.header("access-control-allow-methods").unwrap();
        assert!(["GET", "HEAD", "POST", "OPTIONS"].iter().all(|method| methods.contains(method)));
        assert!(response.header("access-control-allow-headers").unwrap().contains("Range"));
    }
    for target in ["/", "/healthz", "/nope.goblin", "/point/classes?x=a"] {
        assert_eq!(server.get(target).header("access-control-allow-origin"), Some("*"), "{target}");
    }
}

#[test]
fn names_do_not_lead_out_of_the_directory() {
    let all = tempfile::tempdir().unwrap();
    let [directory, outside] = ["served", "outside"].map(|name| all.path().join(name));
    std::fs::create_dir_all(directory.join("inner.goblin")).unwrap();
    std::fs::create_dir_all(directory.join("below")).unwrap();
    std::fs::create_dir(&outside).unwrap();
    let copy = |to: std::path::PathBuf| std::fs::copy(fixture("v1/classes.goblin"), to).unwrap();
    copy(directory.join("map.goblin"));
    copy(directory.join("below/deep.goblin"));
    copy(directory.join(".hidden.goblin"));
    copy(directory.join("map.tif"));
    copy(outside.join("secret.goblin"));
    symlink(outside.join("secret.goblin"), directory.join("link.goblin")).unwrap();
    symlink("../outside/secret.goblin", directory.join("relative.goblin")).unwrap();
    symlink(&outside, directory.join("way")).unwrap();
    symlink("map.goblin", directory.join("inside.goblin")).unwrap();
    symlink("loop.goblin", directory.join("loop.goblin")).unwrap();
    let server = Server::start(&directory, &[]);
    server.get("/map.goblin").good();
    server.get("/inside.goblin").good();
    server.get("/point/inside?x=1&y=1&crs=cells").good();
    let names = [
        "link",
        "relative",
        "loop",
        "inner",
        "..",
        ".",
        ".hidden",
        "%2ehidden",
        "..%2foutside%2fsecret",
        "%2e%2e%2foutside%2fsecret",
        "..%5coutside%5csecret",
        "..%252foutside%252fsecret",
        "way%2fsecret",
        "way/secret",
        "below%2fdeep",
        "below/deep",
        "%2fetc%2fpasswd",
        "map%00",
        "map.goblin%00",
        "%00",
        "%ff%fe",
        "map.goblin%2f",
        "map.goblin%2f.",
        ".%2fmap",
        "map.goblin@0",
        "map.goblin:0",
        "%c0%ae%c0%ae%c0%afsecret",
        "file:%2f%2f%2fetc%2fpasswd",
        "https:%2f%2fhost%2fx.goblin",
        "map.tif",
        "map.goblin.goblin",
        "%",
        "%zz",
        "",
    ];
    for name in names {
        for target in [
            format!("/{name}"),
            format!("/{name}.goblin"),
            format!("/point/{name}?x=1&y=1&crs=cells"),
            format!("/point/{name}.goblin?x=1&y=1&crs=cells"),
            format!("/window/{name}"),
            format!("/../outside/{name}.goblin"),
            format!("//{name}/../../outside/secret.goblin"),
        ] {
            let response = server.get(&target);
            // A name that normalizes to the root is the page.
            if target == "/" || target == "/." || target == "/.." {
                assert!(response.header("content-type") != Some("application/octet-stream"));
                continue;
            }
            assert!(matches!(response.status, 400 | 404), "{target}: {response:?}");
            response.complaint(response.status);
        }
    }
    let listed = server.get("/files.json").json();
    let listed: Vec<&str> =
        listed["files"].as_array().unwrap().iter().map(|file| file["file"].as_str().unwrap()).collect();
    assert_eq!(listed, ["inside.goblin", "map.goblin"]);
}

#[test]
fn two_files_of_one_stem_are_distinguished() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    std::fs::copy(fixture("v1/classes.goblin"), path("a.goblin")).unwrap();
    std::fs::copy(fixture("v1/history.autumn"), path("a.autumn")).unwrap();
    std::fs::copy(fixture("v1/classes.goblin"), path("b.goblin")).unwrap();
    let server = Server::start(directory.path(), &[]);
    let message = server.get("/point/a?x=1&y=1&crs=cells").complaint(404);
    assert!(message.contains("a.goblin") && message.contains("a.autumn"), "{message}");
    for name in ["a.goblin", "a.autumn", "b", "b.goblin"] {
        server.get(&format!("/point/{name}?x=1&y=1&crs=cells")).good();
    }
    let files = server.get("/files.json").json();
    let names: Vec<&str> =
        files["files"].as_array().unwrap().iter().map(|file| file["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["a.autumn", "a.goblin", "b"]);
}

#[test]
fn one_file_is_all_that_is_served() {
    let directory = island();
    let server = Server::start(&directory.path().join("classes.goblin"), &[]);
    server.get("/classes.goblin").good();
    server.get("/point/classes?x=1&y=1&crs=cells").good();
    server.get("/point/classes.goblin?x=1&y=1&crs=cells").good();
    server.get("/heights.goblin").complaint(404);
    server.get("/point/heights?x=1&y=1").complaint(404);
    assert_eq!(server.get("/files.json").json()["files"].as_array().unwrap().len(), 1);
}

#[test]
fn manifests_do_not_lead_out_of_the_directory() {
    let directory = island();
    let outer = tempfile::tempdir().unwrap();
    std::fs::rename(directory.path().join("heights.goblin"), outer.path().join("heights.goblin")).unwrap();
    let heights = outer.path().join("heights.goblin");
    let manifest = directory.path().join("all.goblin");
    stdout(&["manifest", "-q", heights.to_str().unwrap(), "-o", manifest.to_str().unwrap()]);
    let served = Server::start(directory.path(), &[]);
    let message = served.get("/point/all?x=100&y=90&crs=cells").complaint(422);
    assert!(message.contains("a manifest") && message.contains("serve it alone"), "{message}");
    assert!(!message.contains(outer.path().to_str().unwrap()), "{message}");
    // A manifest served alone gives access to its files.
    let alone = Server::start(&manifest, &[]);
    alone.get("/point/all?x=100&y=90&crs=cells").good();
}

#[test]
fn a_file_that_cannot_be_queried_is_reported_at_the_start() {
    let remarks = |name: &str| {
        let mut options = spinney::serve::ServeOptions::default();
        options.port = 0;
        let server = spinney::serve::Server::bind(fixture(name).as_ref(), options).unwrap();
        server.remarks().unwrap()
    };
    assert!(remarks("v1/classes.goblin").is_empty());
    let found = remarks("island_classes.tif");
    assert!(found.len() == 1 && found[0].contains("is a TIFF image, not a Spinney file"), "{found:?}");
}
