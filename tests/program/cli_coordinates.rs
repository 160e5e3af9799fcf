//! Positions in other coordinates than the tree's: the option `--in`, features with their own
//! coordinate systems, boxes across the 180th meridian, and the operation `warp=`.

use std::path::Path;

use serde_json::{Value as Json, json};
use spinney::raw::space::Projection;
use spinney::raw::store::build_tree;
use spinney::tree::MemTree;
use spinney::{Bounds, Crs, DataKind, Frame, Metadata, Output, Rule, SampleType, Value};

use crate::common::command::{command, complaint, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;
use crate::common::{options, quad, with};

const EXTENT: [u64; 3] = [200, 100, 1];

fn framed(epsg: u32, numbers: [f64; 6]) -> Frame {
    Frame { crs: Some(Crs::epsg(epsg)), ..Frame::planar(numbers) }
}

fn utm() -> Frame {
    framed(32632, [500.0, 0.0, 480_000.0, 0.0, -500.0, 5_350_000.0])
}

impl TestDirectory {
    fn tree(&self, name: &str, frame: Frame) -> String {
        let file = self.name(name);
        let cell = |[x, y, _]: [u32; 3]| {
            (u64::from(x) < EXTENT[0] && u64::from(y) < EXTENT[1]).then(|| Value::from([(x % 250) as u8]))
        };
        let tree = MemTree::from_cells(quad(SampleType::U8, 1), 8, Rule::Mean, &cell);
        let metadata = Metadata { frame, ..Metadata::default() };
        let options =
            with(options(Rule::Mean, DataKind::Continuous, 8), |options| options.metadata = metadata);
        build_tree(&tree, EXTENT, &options, Output::create(Path::new(&file)).unwrap(), &()).unwrap();
        file
    }

    /// Writes a GeoJSON file of a quadrilateral with attributes.
    fn zones(&self, name: &str, corners: &[[f64; 2]], crs: &str) -> String {
        let mut ring = corners.to_vec();
        ring.push(corners[0]);
        let geometry = json!({"type": "Polygon", "coordinates": [ring]});
        let feature = json!({"type": "Feature", "id": "a7", "properties": {"name": "A", "owner": "Ann", "lots": [1, 2]},
            "geometry": geometry});
        let mut document = json!({"type": "FeatureCollection", "features": [feature]});
        if !crs.is_empty() {
            document["crs"] = json!({"type": "name", "properties": {"name": crs}});
        }
        let file = self.name(name);
        std::fs::write(&file, document.to_string()).unwrap();
        file
    }
}

/// Returns the border of a box of cells in a coordinate system.
fn corners(frame: &Frame, [left, top, right, bottom]: [f64; 4], epsg: u32) -> Vec<[f64; 2]> {
    let own = Projection::new(frame.crs.as_ref().unwrap(), false).unwrap();
    let other = Projection::new(&Crs::epsg(epsg), false).unwrap();
    let project = |[column, row]: [f64; 2]| {
        let [x, y, _] = frame.to_world([column, row, 0.0]);
        other.forward(own.inverse([x, y]).unwrap()).unwrap()
    };
    // A vertex on each cell, so that edges follow the box even where they are curves.
    let steps = |from: [f64; 2], to: [f64; 2]| {
        (0..64).map(move |i| [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * f64::from(i) / 64.0))
    };
    let ends = [[left, top], [right, top], [right, bottom], [left, bottom]];
    (0..4).flat_map(|side| steps(ends[side], ends[(side + 1) % 4])).map(project).collect()
}

fn zones_of(tree: &str, zones: &str, more: &[&str]) -> Json {
    let words = [&["stats", tree, "--zones", zones, "--json"], more].concat();
    serde_json::from_str(&stdout(&words)).unwrap()
}

#[test]
fn zones_are_in_their_own_system_and_keep_ids_and_attributes() {
    let temp = TestDirectory::new();
    let tree = temp.tree("utm.goblin", utm());
    // A box whose edges pass between cell centres.
    let window = [20.25, 30.25, 60.25, 50.25];
    for (epsg, crs) in [
        (4326, ""),
        (4326, "urn:ogc:def:crs:OGC:1.3:CRS84"),
        (3035, "urn:ogc:def:crs:EPSG::3035"),
        (32632, "EPSG:32632"),
    ] {
        let zones = temp.zones("zones.geojson", &corners(&utm(), window, epsg), crs);
        let found = zones_of(&tree, &zones, &[]);
        let zone = &found["zones"][0];
        assert_eq!((&zone["cells"], &zone["channels"][0]["mean"]), (&json!(800.0), &json!(39.5)), "{crs}");
        assert_eq!(
            (&zone["id"], &zone["name"], &zone["properties"]["owner"]),
            (&json!("a7"), &json!("A"), &json!("Ann"))
        );
        assert_eq!(zone["properties"]["lots"], json!([1, 2]));
    }
    // Explicit options take precedence over the document.
    let own = temp.zones("own.geojson", &corners(&utm(), window, 32632), "");
    assert_eq!(zones_of(&tree, &own, &["--in", "world"])["zones"][0]["cells"], 800.0);
    assert_eq!(zones_of(&tree, &own, &["--in", "EPSG:32632"])["zones"][0]["cells"], 800.0);
    // These are not degrees; other positions miss the tree.
    let message = complaint(&["stats", &tree, "--zones", &own], 1);
    assert!(
        message.contains("own.geojson") && message.contains("is not in degrees") && message.contains("--in"),
        "{message}"
    );
    let away = temp.zones("away.geojson", &[[20.0, 10.0], [21.0, 10.0], [21.0, 11.0]], "");
    let message = complaint(&["stats", &tree, "--zones", &away], 1);
    assert!(message.contains("20,10,21,11") && message.contains("8.7"), "{message}");
    let swapped: Vec<_> = corners(&utm(), window, 4326).into_iter().map(|[x, y]| [y, x]).collect();
    let message = complaint(&["stats", &tree, "--zones", &temp.zones("swapped.geojson", &swapped, "")], 1);
    assert!(message.contains("swapped"), "{message}");
    // A tree without a coordinate system takes them unchanged, and reports it.
    let bare = temp.tree("bare.goblin", Frame::planar([1.0, 0.0, 0.0, 0.0, -1.0, 100.0]));
    let zones = temp.zones("bare.geojson", &[[0.0, 90.0], [10.0, 90.0], [10.0, 100.0], [0.0, 100.0]], "");
    let run = spinney(&["stats", &bare, "--zones", &zones]).success();
    assert!(stderr(run).contains("no coordinate system"));
    assert_eq!(zones_of(&bare, &zones, &[])["zones"][0]["cells"], 100.0);
}

#[test]
fn points_are_found_in_any_coordinates() {
    let temp = TestDirectory::new();
    let tree = temp.tree("utm.goblin", utm());
    let at = |epsg: u32| corners(&utm(), [33.5, 44.5, 34.0, 45.0], epsg)[0];
    let [longitude, latitude] = at(4326);
    let lonlat = format!("{longitude},{latitude}");
    assert_eq!(stdout(&["point", &tree, "--in", "lonlat", &lonlat]), "33\n");
    assert_eq!(
        stdout(&["point", &tree, "--in", "EPSG:3035", &at(3035).map(|number| number.to_string()).join(",")]),
        "33\n"
    );
    assert_eq!(stdout(&["point", &tree, "--in", "cells", "33.5,44.5"]), "33\n");
    assert_eq!(stdout(&["point", &tree, "--in", "world", "496750,5327750"]), "33\n");
    let run =
        spinney(&["point", &tree, "--in", "lonlat", &format!("{latitude},{longitude}"), "7,100"]).success();
    assert_eq!(run.get_output().stdout, b"outside\noutside\n");
    let message = stderr(run);
    assert!(
        message.contains("2 points are outside") && message.contains("swapped") && message.contains("8.7"),
        "{message}"
    );
    assert!(complaint(&["point", &tree, "--in", "there", "1,2"], 2).contains("lonlat"));
    assert!(complaint(&["point", &tree, "--in", "EPSG:999999", "1,2"], 2).contains("EPSG registry"));
    let bare = temp.tree("bare.goblin", Frame::identity());
    assert!(complaint(&["point", &bare, "--in", "lonlat", "1,2"], 1).contains("crs="));
}

#[test]
fn parts_are_found_in_any_coordinates_and_across_the_180th_meridian() {
    let temp = TestDirectory::new();
    let world = temp.tree("world.goblin", framed(4326, [1.8, 0.0, -180.0, 0.0, -1.8, 90.0]));
    let pacific = temp.tree("pacific.goblin", framed(4326, [0.1, 0.0, 170.0, 0.0, -0.1, 5.0]));
    let utm = temp.tree("utm.goblin", utm());
    let stats = |words: &[&str]| -> Json {
        serde_json::from_str(&stdout(&[&["stats", "--json"], words].concat())).unwrap()
    };
    // Columns 195 to 199 and 0 to 4.
    for options in
        [["--in", "lonlat", "--window", "171,-9,-171,9"], ["--in", "world", "--window", "171,-9,189,9"]]
    {
        let found = stats(&[&[world.as_str()], &options[..]].concat());
        assert_eq!((&found["cells"], &found["channels"][0]["mean"]), (&json!(100), &json!(99.5)));
        assert_eq!((&found["channels"][0]["min"], &found["channels"][0]["max"]), (&json!(0), &json!(199)));
        let cells = found["histogram"].as_array().unwrap().iter().map(|bin| bin["cells"].as_u64().unwrap());
        assert_eq!(cells.sum::<u64>(), 100);
    }
    let spread =
        stats(&[&world, "--in", "lonlat", "--window", "171,-9,-171,9"])["channels"][0]["standard_deviation"]
            .as_f64()
            .unwrap();
    let values: Vec<f64> = (195..200).chain(0..5).map(f64::from).collect();
    let expected = (values.iter().map(|value| (value - 99.5).powi(2)).sum::<f64>() / 10.0).sqrt();
    assert!((spread - expected).abs() < 1e-9);
    let out = temp.name("seam.npy");
    command(&["get", &world, &out, "--in", "lonlat", "--window", "171,0,-171,1.8"]).assert().success();
    let bytes = std::fs::read(&out).unwrap();
    assert_eq!(bytes[bytes.len() - 10..], [195, 196, 197, 198, 199, 0, 1, 2, 3, 4]);
    let found = stdout(&["find", &world, "--below", "2", "--in", "lonlat", "--window", "171,-9,-171,9"]);
    assert!(
        !found.is_empty() && stdout(&["find", &world, "--below", "2", "--window", "5,0,190,100"]).is_empty()
    );
    // A raster whose longitudes continue beyond 180 degrees.
    assert_eq!(stats(&[&pacific, "--in", "lonlat", "--window", "175,-1,-175,1"])["cells"], 100 * 20);
    assert_eq!(stdout(&["point", &pacific, "-175.05,0.05"]), "149\n");
    // A box of degrees on UTM: the smallest window around it.
    let frame = self::utm();
    let around = corners(&frame, [50.0, 50.0, 60.0, 60.0], 4326);
    let side = |axis: usize, pick: fn(f64, f64) -> f64, start: f64| {
        around.iter().map(|corner| corner[axis]).fold(start, pick)
    };
    let (west, south) = (side(0, f64::min, 999.0), side(1, f64::min, 999.0));
    let (east, north) = (side(0, f64::max, -999.0), side(1, f64::max, -999.0));
    let found = stats(&[&utm, "--in", "lonlat", "--window", &format!("{west},{south},{east},{north}")]);
    let cells = found["cells"].as_u64().unwrap();
    assert!((100..=13 * 13).contains(&cells), "{cells}");
    for (words, expected) in [
        (["--in", "lonlat", "--window", "48,9,49,10"], "swapped"),
        (["--in", "lonlat", "--window", "20,9,21,10"], "outside of the raster, which is 8.7"),
        (["--in", "lonlat", "--window", "9,48,8,47"], "minimum coordinates"),
        (["--in", "cells", "--window", "9.5,48,8,47"], "expected integers from 0"),
    ] {
        let message = complaint(&[&["stats", utm.as_str()], &words[..]].concat(), 1);
        assert!(message.contains(expected), "{words:?}: {message}");
    }
}

#[test]
fn edits_are_done_in_any_coordinates() {
    let temp = TestDirectory::new();
    let tree = temp.tree("utm.autumn", utm());
    let frame = utm();
    let ring = corners(&frame, [20.25, 30.25, 60.25, 50.25], 4326);
    let text: Vec<String> = ring.iter().map(|[x, y]| format!("{x},{y}")).collect();
    spinney(&["edit", &tree, "fill", "--in", "lonlat", "--polygon", &text.join(" "), "--value", "250"])
        .success();
    let count = |tree: &str| {
        stdout(&["find", tree, "--class", "250"])
            .lines()
            .map(|line| {
                let size = line.split(' ').nth(3).unwrap().split_once(',').unwrap();
                size.0.parse::<u64>().unwrap() * size.1.parse::<u64>().unwrap()
            })
            .sum::<u64>()
    };
    assert_eq!(count(&tree), 800);
    let world = temp.tree("world.autumn", framed(4326, [1.8, 0.0, -180.0, 0.0, -1.8, 90.0]));
    spinney(&["edit", &world, "fill", "--in", "lonlat", "--window", "171,-9,-171,9", "--value", "250"])
        .success();
    assert_eq!(count(&world), 100);
    assert!(
        complaint(&["edit", &world, "fill", "--in", "lonlat", "--window", "0,95,1,96", "--void"], 1)
            .contains("outside")
    );
}

#[test]
fn trees_are_warped_to_any_system() {
    let temp = TestDirectory::new();
    let tree = temp.tree("utm.goblin", utm());
    let out = temp.name("laea.goblin");
    let run =
        spinney(&["transform", &tree, "warp=EPSG:3035,cell=1000,resampling=nearest", "-o", &out]).success();
    assert!(!stderr(run).contains("compared with"));
    let scaled = spinney(&["transform", &tree, "scale=0.7", "-o", &temp.name("scaled.goblin")]).success();
    let report = stderr(scaled);
    assert!(report.contains("\narea       ") && report.contains("% compared with the source's"), "{report}");
    let info: Json = serde_json::from_str(&stdout(&["info", &out, "--json"])).unwrap();
    assert!(info.to_string().contains("EPSG:3035"), "{info}");
    let warped = spinney::open(&out).unwrap();
    let frame = warped.metadata().frame.clone();
    assert_eq!([frame.matrix[0][0], frame.matrix[1][1]], [1000.0, -1000.0]);
    assert!((0..2).all(|axis| frame.matrix[axis][3] % 1000.0 == 0.0));
    // Every cell has the source value at its centre; no data are cut off, and no side is empty.
    let (own, other) = (
        Projection::new(&Crs::epsg(32632), false).unwrap(),
        Projection::new(&Crs::epsg(3035), false).unwrap(),
    );
    let [width, height, _] = warped.header().extent;
    let bounds = Bounds { min: [0; 3], max: [width, height, 1] };
    let (mut bytes, mut valid) = (vec![0; (width * height) as usize], vec![false; (width * height) as usize]);
    warped.window(warped.depth(), &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    let mut cells = 0;
    for row in 0..height {
        for column in 0..width {
            let [x, y, _] = frame.to_world([column as f64 + 0.5, row as f64 + 0.5, 0.0]);
            let projected = own.forward(other.inverse([x, y]).unwrap()).unwrap();
            let [x, y, _] = utm().to_cells([projected[0], projected[1], 0.0]).unwrap();
            let is_in = (0.0..200.0).contains(&x) && (0.0..100.0).contains(&y);
            let index = (row * width + column) as usize;
            let is_edge = [x, y, x - 200.0, y - 100.0].into_iter().any(|away| away.abs() < 1e-3)
                || (x - x.round()).abs() < 1e-3;
            assert!(
                is_edge || (valid[index], bytes[index]) == (is_in, if is_in { x as u8 } else { 0 }),
                "{column},{row}"
            );
            cells += u64::from(valid[index]);
        }
    }
    assert!((4900..5100).contains(&cells), "{cells} of 100 km x 50 km");
    let has = |mut range: Box<dyn Iterator<Item = u64>>| range.any(|index| valid[index as usize]);
    let margin = 2;
    assert!((0..margin).any(|row| has(Box::new(row * width..(row + 1) * width))));
    assert!((0..margin).any(|row| has(Box::new((height - 1 - row) * width..(height - row) * width))));
    assert!((0..margin).any(|column| has(Box::new((0..height).map(move |row| row * width + column)))));
    assert!(
        (0..margin).any(|column| has(Box::new((0..height).map(move |row| row * width + width - 1 - column))))
    );
    // As a view, without a cell width, to degrees across their seam, and around a pole.
    let image = temp.name("view.tif");
    spinney(&["get", &tree, &image, "--view", "warp=EPSG:4326", "--size", "64x64"]).success();
    let fiji = temp.tree("fiji.goblin", framed(32701, [2000.0, 0.0, 200_000.0, 0.0, -2000.0, 8_000_000.0]));
    let out = temp.name("fiji_lonlat.goblin");
    spinney(&["transform", &fiji, "warp=EPSG:4326", "-o", &out]).success();
    let [width, height, _] = spinney::open(&out).unwrap().header().extent;
    assert!(width < 300 && height < 150, "{width} x {height}");
    let pole =
        temp.tree("pole.goblin", framed(3413, [20_000.0, 0.0, -2_000_000.0, 0.0, -20_000.0, 1_000_000.0]));
    let out = temp.name("pole_lonlat.goblin");
    spinney(&["transform", &pole, "warp=EPSG:4326,cell=0.5", "-o", &out]).success();
    assert_eq!(spinney::open(&out).unwrap().header().extent[0], 720);
    for (step, expected) in [
        ("warp=EPSG:999999", "EPSG registry"),
        ("warp=EPSG:3035,cell=0", "above 0"),
        ("warp=EPSG:3035,resampling=best", "nearest"),
    ] {
        assert!(complaint(&["transform", &tree, step, "-o", &out], 2).contains(expected), "{step}");
    }
    let message = complaint(&["transform", &tree, "warp=EPSG:3035,cell=1e-9", "-o", &out], 1);
    assert!(message.contains("larger cell"), "{message}");
    assert!(
        complaint(&["build", "fixtures/island_elevation.tif", "--crs", "EPSG:999999", "-o", &out], 2)
            .contains("EPSG registry")
    );
}

#[test]
fn images_of_web_maps_end_where_the_data_end() {
    let temp = TestDirectory::new();
    let tree = temp.tree("utm.goblin", utm());
    let image = temp.name("map.npy");
    let run = spinney(&["get", &tree, &image, "--view", "grid=xyz,9"]).success();
    assert!(stderr(run).contains("the box of all data"));
    let length = std::fs::metadata(&image).unwrap().len();
    assert!((10_000..1_000_000).contains(&length), "{length}");
}
