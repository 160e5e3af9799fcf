//! `spinney contours`: files of lines and bands.

use std::fs;
use std::path::Path;

use serde_json::Value;
use spinney::{Crs, DataKind, Frame, Rule, SampleType};
use tempfile::TempDir;

use crate::common::command::{complaint, spinney, stdout};
use crate::common::{Random, byte, made, quad, write_goblin};

/// Returns a hill with a VOID hole in a raster of 40 x 30 cells in UTM zone 32.
fn hill(crs: Option<Crs>) -> (TempDir, String) {
    let form = quad(SampleType::F32, 1);
    let cells = made(form, [40, 30, 1], |[x, y, _]| {
        let (x, y) = (x as f64 - 19.7, y as f64 - 14.3);
        let height = 100.0 - 6.0 * x.hypot(y);
        (x.hypot(y) > 3.0).then(|| form.value.nearest(|_| height))
    });
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("hill.goblin");
    let frame = Frame { crs, ..Frame::planar([10.0, 0.0, 500_000.0, 0.0, -10.0, 5_200_000.0]) };
    write_goblin(&path, &cells, (Rule::Mean, DataKind::Continuous), frame);
    (directory, path.to_str().unwrap().into())
}

fn features(path: &Path) -> (Value, Vec<Value>) {
    let mut all: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    let features = all["features"].take().as_array().unwrap().clone();
    (all, features)
}

#[test]
fn lines_as_geojson_have_values_and_a_coordinate_system() {
    let (directory, file) = hill(Some(Crs::epsg(32632)));
    let out = directory.path().join("lines.geojson");
    let usage = complaint(&["contours", &file, "--every", "20", "c.geojson"], 2);
    assert!(usage.contains("tip: write the output with -o: '-o c.geojson'"), "{usage}");
    spinney(&["contours", &file, "--every", "20", "-o", out.to_str().unwrap()]).success();
    let (all, lines) = features(&out);
    assert_eq!(all["crs"]["properties"]["name"], "urn:ogc:def:crs:EPSG::32632");
    let values: Vec<f64> = lines.iter().map(|line| line["properties"]["value"].as_f64().unwrap()).collect();
    assert!(values.contains(&40.0) && values.contains(&60.0) && values.contains(&-20.0), "{values:?}");
    // The line of 40 goes clockwise around the hill, at a distance of 10 cells.
    let ring = lines.iter().find(|line| line["properties"]["value"] == 40.0).unwrap();
    assert_eq!(ring["geometry"]["type"], "LineString");
    let points: Vec<[f64; 2]> = serde_json::from_value(ring["geometry"]["coordinates"].clone()).unwrap();
    assert_eq!(points.first(), points.last());
    let centre = [500_000.0 + 10.0 * 20.2, 5_200_000.0 - 10.0 * 14.8];
    assert!(points.iter().all(|[x, y]| ((x - centre[0]).hypot(y - centre[1]) - 100.0).abs() < 1.0));
    let turn: f64 = points
        .windows(2)
        .map(|pair| {
            (pair[0][0] - centre[0]) * (pair[1][1] - centre[1])
                - (pair[1][0] - centre[0]) * (pair[0][1] - centre[1])
        })
        .sum();
    assert!(turn < 0.0, "higher values are on the right");
    // The member is absent for WGS 84, and null without a coordinate system.
    for (crs, member) in [(None, Some(&serde_json::Value::Null)), (Some(Crs::epsg(4326)), None)] {
        let (directory, file) = hill(crs);
        let out = directory.path().join("lines.json");
        spinney(&["-q", "contours", &file, "--at", "40,60", "-o", out.to_str().unwrap()]).success();
        assert_eq!(features(&out).0.get("crs"), member);
    }
}

#[test]
fn bands_cover_what_has_values() {
    let (directory, file) = hill(None);
    let out = directory.path().join("bands.geojson");
    spinney(&["-q", "contours", &file, "--every", "25", "--filled", "-o", out.to_str().unwrap()]).success();
    let (_, bands) = features(&out);
    let area = |ring: &Value| {
        let points: Vec<[f64; 2]> = serde_json::from_value(ring.clone()).unwrap();
        let from = points[0];
        let part = |pair: &[[f64; 2]]| {
            (pair[0][0] - from[0]) * (pair[1][1] - from[1]) - (pair[1][0] - from[0]) * (pair[0][1] - from[1])
        };
        points.windows(2).map(part).sum::<f64>() / 2.0
    };
    let mut all = 0.0;
    for band in &bands {
        let (min, max) = (&band["properties"]["min"], &band["properties"]["max"]);
        assert_eq!(max.as_f64().unwrap() - min.as_f64().unwrap(), 25.0);
        let rings = band["geometry"]["coordinates"].as_array().unwrap();
        assert!(area(&rings[0]) > 0.0, "outer rings are counterclockwise");
        all += rings.iter().map(area).sum::<f64>();
    }
    let cells = spinney::open(&file).unwrap().statistics(None, &()).unwrap().cells as f64;
    assert!((all / 100.0 - cells).abs() < 1e-3, "{all} of {cells}");
}

#[test]
fn all_formats_have_the_same_lines() {
    let (directory, file) = hill(Some(Crs::epsg(32632)));
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let run = |name: &str, more: &[&str]| {
        let out = path(name);
        let mut words = vec!["-q", "contours", &file, "--every", "20", "--ends", "close", "-o", &out];
        words.extend(more);
        spinney(&words).success();
        fs::read(out).unwrap()
    };
    let count = features(Path::new(&{
        run("a.geojson", &[]);
        path("a.geojson")
    }))
    .1
    .len();
    let csv = String::from_utf8(run("a.csv", &["--3d"])).unwrap();
    assert!(
        csv.starts_with("WKT,value\r\n\"LINESTRING Z (") && csv.lines().count() == count + 1,
        "{csv:.200}"
    );
    let svg = String::from_utf8(run("a.svg", &[])).unwrap();
    assert!(svg.contains("viewBox=\"500000 -5200000 400 300\"") && svg.matches("<path").count() == count);
    assert_eq!(
        stdout(&["contours", &file, "--every", "20", "--ends", "close", "-o", "-", "--format", "svg"]),
        svg
    );
    let shapes = run("a.shp", &["--3d"]);
    let number = |bytes: &[u8], at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((number(&shapes, 0), 2 * number(&shapes, 24)), (9994, shapes.len() as u32));
    let [index_file, table] = ["a.shx", "a.dbf"].map(|name| fs::read(path(name)).unwrap());
    assert_eq!((index_file.len(), table.len()), (100 + 8 * count, 32 + 32 + 1 + 25 * count + 1));
    assert_eq!((number(&index_file, 100), table[4] as usize), (50, count));
    let database = run("a.gpkg", &[]);
    assert!(database == run("b.gpkg", &["--threads", "1", "--memory", "1"]), "the same bytes every time");
    let database = rusqlite::Connection::open(path("a.gpkg")).unwrap();
    let query = |sql: &str| database.query_row(sql, [], |row| row.get::<_, i64>(0)).unwrap();
    assert_eq!(query("SELECT count(*) FROM contours WHERE value IS NOT NULL"), count as i64);
    assert_eq!(query("SELECT srs_id FROM gpkg_geometry_columns"), 32632);
    let geometry: Vec<u8> = database.query_row("SELECT geom FROM contours", [], |row| row.get(0)).unwrap();
    let points = u32::from_le_bytes(geometry[13..17].try_into().unwrap()) as usize;
    assert_eq!((&geometry[..4], geometry.len()), (&b"GP\0\x01"[..], 17 + 16 * points));
}

#[test]
fn smooth_lines_stay_closed() {
    let (directory, file) = hill(None);
    let out = directory.path().join("lines.geojson");
    let run = |times: &str| {
        let out = out.to_str().unwrap();
        spinney(&["-q", "contours", &file, "--at", "40", "--smooth", times, "-o", out]).success();
        let (_, lines) = features(Path::new(out));
        let points: Vec<[f64; 2]> =
            serde_json::from_value(lines[0]["geometry"]["coordinates"].clone()).unwrap();
        assert_eq!((lines.len(), points.first()), (1, points.last()));
        points.len()
    };
    assert_eq!(run("2") - 1, 4 * (run("0") - 1));
}

/// Noise has lines everywhere.
#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_lines() {
    use crate::common::command::peak_memory;
    let form = quad(SampleType::U8, 1);
    let cells = made(form, [600, 600, 1], |[x, y, _]| Some(byte((Random(x << 20 | y).next() % 4) as u8)));
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let file = path("noise.goblin");
    write_goblin(Path::new(&file), &cells, (Rule::Mean, DataKind::Continuous), Frame::identity());
    let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin("spinney"));
    command.args(["-q", "contours", &file, "--at", "0.5,1.5,2.5", "--memory", "16M", "--threads", "2"]);
    let peak = peak_memory(&mut command.args(["-o", &path("noise.csv")]).spawn().unwrap());
    assert!(fs::metadata(path("noise.csv")).unwrap().len() > 12 << 20);
    // The program takes about 40 MiB, however many lines there are.
    assert!(peak < 58 << 20, "{} MiB", peak >> 20);
}

#[test]
fn what_cannot_be_done_leaves_no_file() {
    let (directory, file) = hill(None);
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let out = path("out.geojson");
    let refused = |words: &[&str], code: i32| {
        let text = complaint(&[&["contours"], words].concat(), code);
        assert!(!Path::new(&out).exists(), "{words:?}");
        text
    };
    assert!(refused(&[&file, "--every", "0", "-o", &out], 1).contains("--every: got step 0"));
    assert!(refused(&[&file, "--every", "1e-9", "-o", &out], 1).contains("fewer levels"));
    assert!(refused(&[&file, "--every", "10", "--max-bytes", "100", "-o", &out], 1).contains("100"));
    assert!(refused(&[&file, "--every", "10", "--level", "30", "-o", &out], 1).contains("--level"));
    assert!(refused(&[&file, "--every", "10", "-o", &path("out.xyz")], 1).contains("unknown format"));
    assert!(refused(&[&file, "--every", "10", "-o", "-", "--format", "gpkg"], 1).contains("stream"));
    refused(&[&file, "-o", &out], 2);
    refused(&[&file, "--every", "10", "--at", "1,2", "-o", &out], 2);
    refused(&[&file, "--every", "10", "--filled", "--ends", "close", "-o", &out], 2);
    // A truncated file, and one with a changed byte in its records.
    let bytes = fs::read(&file).unwrap();
    let bad = path("bad.goblin");
    for length in [0, 50, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&bad, &bytes[..length]).unwrap();
        refused(&[&bad, "--every", "10", "-o", &out], 1);
    }
    let mut changed = bytes;
    changed[100] ^= 1;
    fs::write(&bad, changed).unwrap();
    refused(&[&bad, "--every", "10", "-o", &out], 1);
    // An existing file of that name stays.
    fs::write(&out, "old").unwrap();
    complaint(&["contours", &bad, "--every", "10", "-o", &out], 1);
    assert_eq!(fs::read(&out).unwrap(), b"old");
}

#[test]
fn coordinate_systems_without_a_code_are_stored_or_reported() {
    let definition = "+proj=laea +lat_0=45 +lon_0=-100 +ellps=bessel";
    let crs = Crs::parse(definition).unwrap();
    let text = crs.to_wkt2().unwrap();
    let (directory, file) = hill(Some(crs));
    let run = |name: &str| {
        let out = directory.path().join(name);
        let run = spinney(&["contours", &file, "--every", "20", "-o", out.to_str().unwrap()]).success();
        (String::from_utf8_lossy(&run.get_output().stderr).into_owned(), fs::read(out).unwrap())
    };
    let (said, flat) = run("a.fgb");
    assert!(!said.contains("coordinate system"), "{said}");
    assert!(flat.windows(text.len()).any(|part| part == text.as_bytes()));
    assert!(!run("a.gpkg").0.contains("coordinate system"));
    let database = rusqlite::Connection::open(directory.path().join("a.gpkg")).unwrap();
    let query = "SELECT definition FROM gpkg_spatial_ref_sys JOIN gpkg_geometry_columns USING (srs_id)";
    assert_eq!(database.query_row(query, [], |row| row.get::<_, String>(0)).unwrap(), text);
    assert!(!run("a.shp").0.contains("coordinate system"));
    let esri = fs::read_to_string(directory.path().join("a.prj")).unwrap();
    assert!(esri.starts_with("PROJCS[\"unknown\",GEOGCS["), "{esri}");
    assert!(Crs::parse(&esri).is_ok());
    // GeoJSON stores its definition.
    let (said, json) = run("a.geojson");
    assert!(!said.contains("coordinate system"), "{said}");
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert!(Crs::parse(json["crs"]["properties"]["name"].as_str().unwrap()).is_ok(), "{json}");
    // Shapefiles also store coordinate systems with an EPSG code.
    let (directory, file) = hill(Some(Crs::epsg(32632)));
    let out = directory.path().join("a.shp");
    spinney(&["contours", &file, "--every", "20", "-o", out.to_str().unwrap()]).success();
    let esri = fs::read_to_string(directory.path().join("a.prj")).unwrap();
    assert!(esri.starts_with("PROJCS[\"WGS_84_UTM_zone_32N\",GEOGCS[\"GCS_WGS_1984\","), "{esri}");
}

#[test]
fn areas_between_contours_are_zones_from_files_of_any_format() {
    let (directory, file) = hill(Some(Crs::epsg(32632)));
    let zones = |ending: &str, more: &[&str]| -> Value {
        let out = directory.path().join(format!("areas.{ending}"));
        let out = out.to_str().unwrap();
        if !Path::new(out).exists() {
            spinney(&["contours", &file, "--at", "20,60", "--filled", "-o", out]).success();
        }
        // CSV files have no coordinate system.
        let own = if ending == "csv" { &["--in", "world"][..] } else { &[] };
        let words = ["stats", &file, "--zones", out, "--edge", "area", "--json"];
        serde_json::from_str(&stdout(&[&words[..], own, more].concat())).unwrap()
    };
    let of = |found: &Value| {
        let mut listed: Vec<(u64, f64)> = found["zones"]
            .as_array()
            .unwrap()
            .iter()
            .map(|zone| {
                let mean = zone["channels"][0]["mean"].as_f64().unwrap_or_default();
                // To a relative precision of a millionth: coordinates are transformed, or stored as
                // text.
                ((zone["cells"].as_f64().unwrap() * 1e3).round() as u64, (mean * 1e3).round())
            })
            .collect();
        listed.sort_by(|a, b| a.partial_cmp(b).unwrap());
        listed
    };
    let expected = zones("geojson", &[]);
    assert!(expected["zones"].as_array().unwrap().len() >= 3);
    let attributes: Vec<String> =
        expected["zones"][0]["properties"].as_object().unwrap().keys().cloned().collect();
    for ending in ["gpkg", "fgb", "shp", "csv"] {
        let found = zones(ending, &[]);
        assert_eq!(of(&found), of(&expected), "{ending}");
        let own = found["zones"][0]["properties"].as_object().unwrap();
        assert!(attributes.iter().all(|name| own.contains_key(name)), "{ending}: {own:?}");
        // Those above a height, and an attribute that does not exist.
        let condition = format!("{}>=60", attributes[0]);
        let high = zones(ending, &["--where", &condition, "--attribute", &attributes[0]]);
        let high = high["zones"].as_array().unwrap();
        assert!(!high.is_empty() && high.len() < of(&expected).len(), "{ending}");
        let lows = high.iter().map(|zone| zone["properties"][&attributes[0]].as_f64().unwrap());
        assert!(lows.into_iter().all(|low| low >= 60.0), "{ending}");
        let out = directory.path().join(format!("areas.{ending}"));
        let listed =
            complaint(&["stats", &file, "--zones", out.to_str().unwrap(), "--where", "nothing=1"], 1);
        assert!(
            listed.contains("nothing, which no feature has") && listed.contains(&attributes[0]),
            "{listed}"
        );
    }
    // Lines are not zones.
    let lines = directory.path().join("lines.fgb");
    spinney(&["contours", &file, "--at", "20", "-o", lines.to_str().unwrap()]).success();
    let listed = complaint(&["stats", &file, "--zones", lines.to_str().unwrap()], 1);
    assert!(listed.contains("`LineString`") && listed.contains("zones are polygons"), "{listed}");
}
