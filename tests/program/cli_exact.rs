//! Exact models on the command line: rendered images, and their leaves.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::Value as Json;
use spinney::Region;
use spinney::raw::import::raster::{self, Pixels};

use crate::common::command::{command, complaint, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;
use crate::common::shared_data;

/// A cube with sides of 64 units.
const CUBE: &str = "OFF\n8 6 0\n0 0 0\n64 0 0\n64 64 0\n0 64 0\n0 0 64\n64 0 64\n64 64 64\n0 64 64\n\
    4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
/// A tetrahedron with red vertices.
const COLOURED: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\n\
    property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n6 0 0 255 0 0\n0 6 0 255 0 0\n\
    0 0 6 255 0 0\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

impl TestDirectory {
    /// Returns the pixels of a rendered file.
    fn render(&self, file: &str, options: &[&str]) -> Vec<u8> {
        let out = self.name("out.png");
        command(&["render", "-q", file, &out]).args(options).assert().success().stdout("").stderr("");
        let mut image = raster::open(Path::new(&out), &Default::default()).unwrap();
        let (width, height) = (image.info().width, image.info().height);
        let mut pixels = Pixels::default();
        image.read(Region::new(0, 0, width, height), &mut pixels).unwrap();
        pixels.bytes
    }
}

/// Returns which pixels show only the background, which is white.
fn background(pixels: &[u8]) -> Vec<bool> {
    pixels.chunks(3).map(|pixel| pixel == [255; 3]).collect()
}

/// Counts pixels with a neighbour of the other kind.
fn outline(pixels: &[bool], width: usize) -> usize {
    (0..pixels.len())
        .filter(|&at| {
            let is_other = |other: usize| pixels.get(other).is_some_and(|pixel| *pixel != pixels[at]);
            (at + 1) % width != 0 && is_other(at + 1) || is_other(at + width)
        })
        .count()
}

/// Rendered exact models equal rendered fine cells of the same model.
#[test]
fn images_of_exact_models_match_those_of_fine_cells() {
    let directory = TestDirectory::new();
    let mut meshes = vec![directory.write("cube.off", CUBE)];
    match shared_data().map(|data| data.join("mesh/fandisk.ply")).filter(|path| path.exists()) {
        Some(path) => meshes.push(path.to_str().unwrap().into()),
        None => println!("skipped: no fandisk.ply"),
    }
    for mesh in meshes {
        let exact = directory.built(&mesh, "exact.goblin", &["--brep"]);
        let cells = directory.built(&mesh, "cells.goblin", &["--cells", "512"]);
        for options in
            [&["--size", "160x120"][..], &["--size", "160x120", "--orthographic", "--from", "60,10"]]
        {
            let [a, b] = [&exact, &cells].map(|file| directory.render(file, options));
            let sum: u64 = a.iter().zip(&b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            let mean = sum as f64 / a.len() as f64;
            let [a, b] = [a, b].map(|pixels| background(&pixels));
            let counts = [&a, &b].map(|pixels| pixels.iter().filter(|is_background| **is_background).count());
            let outline = outline(&a, 160);
            println!("{mesh} {options:?}: {mean} {counts:?} {outline}");
            assert!(mean < 2.0, "{mesh} {options:?}: {mean}");
            assert!(counts[0].abs_diff(counts[1]) <= outline / 4, "{mesh} {options:?}: {counts:?} {outline}");
            assert!(counts[0] > 5000 && counts[0] < 17_000, "{counts:?}");
        }
    }
}

/// A model with levels of detail is drawn at the level that its pixels need.
#[test]
fn images_of_models_with_levels_match_those_of_the_exact_surface() {
    let directory = TestDirectory::new();
    let mesh = directory.write("torus.obj", crate::cli_levels::bumpy_torus(160, 100));
    let exact = directory.built(&mesh, "exact.goblin", &["--brep"]);
    let levels = directory.built(&mesh, "levels.goblin", &["--brep", "--levels"]);
    for view in [&["--from", "30,50"][..], &["--orthographic"], &["--scale", "0.5", "--samples", "1"]] {
        let options = [&["--size", "120x90"], view].concat();
        let [a, b] = [&exact, &levels].map(|file| directory.render(file, &options));
        assert!(a != b, "{view:?}: the exact surface was drawn");
        let sum: u64 = a.iter().zip(&b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        let mean = sum as f64 / a.len() as f64;
        let outline = outline(&background(&a), 120);
        let [a, b] = [a, b].map(|pixels| background(&pixels));
        let differ = a.iter().zip(&b).filter(|(a, b)| a != b).count();
        println!("{view:?}: mean {mean}, {differ} of {outline}");
        assert!(mean < 2.0 && differ <= outline / 3, "{view:?}: {mean} {differ} {outline}");
    }
    let out = directory.name("out.png");
    let small = ["render", &levels, &out, "--size", "120x90"];
    let text = stderr(spinney(&small).success());
    assert!(text.contains("off the exact surface"), "{text}");
    // A level can be chosen; the last one is the exact surface.
    let report: Json = serde_json::from_str(&stdout(&["info", "--json", &levels])).unwrap();
    let last = report["levels"].as_array().unwrap().len() - 1;
    let at = |level: usize| directory.render(&levels, &["--size", "120x90", "--level", &level.to_string()]);
    assert!(at(0) != at(1));
    assert_eq!(at(last), directory.render(&exact, &["--size", "120x90"]));
    let text = complaint(&["render", &exact, &out, "--level", "0"], 1);
    assert!(text.contains("add levels with"), "{text}");
}

#[test]
fn images_have_flat_faces_and_the_options_of_cells() {
    let directory = TestDirectory::new();
    let cube = directory.built(&directory.write("cube.off", CUBE), "cube.goblin", &["--brep"]);
    // Seen straight on, with parallel light and rays: one colour inside, without highlights.
    let options = ["--size", "40x40", "--orthographic", "--from", "180,0", "--background", "#102030"];
    let pixels = directory.render(&cube, &options);
    let colours: BTreeSet<&[u8]> = pixels.chunks(3).collect();
    assert!(pixels[..3] == [0x10, 0x20, 0x30] && colours.len() <= 4, "{colours:?}");
    let inside = pixels.chunks(3).filter(|pixel| *pixel != [0x10, 0x20, 0x30]).count();
    assert!((inside as f64 - (0.92 * 40.0f64).powi(2)).abs() <= 4.0 * 40.0, "{inside}");
    // The image does not depend on the thread count.
    let threads = |number: &str| {
        let out = directory.name("threads.png");
        command(&["render", "-q", &cube, &out, "--size", "50x70", "--samples", "3"])
            .env("RAYON_NUM_THREADS", number)
            .assert()
            .success();
        std::fs::read(out).unwrap()
    };
    assert_eq!(threads("1"), threads("3"));
    let options = ["--size", "20x20", "--background", "transparent", "--up", "y", "--scale", "0.5"];
    let pixels = directory.render(&cube, &options);
    assert_eq!((pixels.len(), &pixels[..4]), (1600, &[0; 4][..]));
    // Colours are those of vertices.
    let coloured = directory.built(&directory.write("red.ply", COLOURED), "red.goblin", &["--brep"]);
    let pixels = directory.render(&coloured, &["--size", "20x20", "--background", "black"]);
    let [red, green, blue] =
        [0, 1, 2].map(|channel| pixels.chunks(3).map(|pixel| u64::from(pixel[channel])).sum::<u64>());
    assert!(red > 5000 && green < red / 2 && green == blue, "{red} {green} {blue}");
    let never = directory.name("never.png");
    let refuse =
        |options: &[&str], code: i32| complaint(&[&["render", &cube, &never], options].concat(), code);
    assert!(refuse(&["--level", "3"], 1).contains("add levels with"));
    assert!(refuse(&["--view", "rotate=30,z"], 1).contains("spinney transform"));
    assert!(refuse(&["--size", "10000000x10"], 1).contains("65536"));
    assert!(refuse(&["--scale", "0"], 1).contains("scale"));
    assert!(!Path::new(&never).exists());
}

#[test]
fn leaves_are_found_by_their_kinds() {
    let directory = TestDirectory::new();
    let mesh = directory.write("cube.off", CUBE);
    let cube = directory.built(&mesh, "cube.goblin", &["--brep", "--leaf-size", "0"]);
    let info: Json = serde_json::from_str(&stdout(&["info", &cube, "--json"])).unwrap();
    let all = stdout(&["find", &cube, "--leaf", "void,full,face,edge,vertex,boolean"]);
    let mut counts = BTreeMap::<&str, u64>::new();
    let mut volume = 0.0;
    for line in all.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let [code, level, kind, position, world, faces] = words[..] else { panic!("{line}") };
        *counts.entry(kind).or_default() += 1;
        let numbers = |text: &str| text.split(',').map(|n| n.parse().unwrap()).collect::<Vec<f64>>();
        let (position, world, level) = (numbers(position), numbers(world), level.parse::<i32>().unwrap());
        let width = world[3] - world[0];
        // Cells begin half a grid unit before the grid's first point.
        let first = world[0] - position[0] * width;
        assert!(first <= 0.0 && first > -1e-3 && code.starts_with('/'), "{line}");
        assert!(code.len() as i32 == level + 1, "{line}");
        volume +=
            if kind == "void" { 0.0 } else { (3..6).map(|axis| world[axis] - world[axis - 3]).product() };
        let is_cut = !["void", "full"].contains(&kind);
        assert_eq!(faces.parse::<u64>().unwrap() > 0, is_cut, "{line}");
    }
    for (kind, count) in &counts {
        assert_eq!(info["nodes"][kind], *count, "{kind}");
        let alone = stdout(&["find", &cube, "--leaf", kind, "--json"]);
        assert_eq!(alone.lines().count() as u64, *count);
        let leaf: Json = serde_json::from_str(alone.lines().next().unwrap()).unwrap();
        assert!(leaf["kind"] == *kind && leaf["world"][1].as_array().unwrap().len() == 3, "{leaf}");
    }
    assert!(counts["vertex"] == 8 && volume >= 64f64.powi(3), "{counts:?} {volume}");
    let some = stdout(&["find", &cube, "--leaf", "vertex", "--limit", "3"]);
    assert!(some.lines().count() == 3 && all.contains(&some.lines().next().unwrap().to_string()));
    // The largest come first.
    let most = stdout(&["find", &cube, "--leaf", "void,full,face,edge,vertex", "--largest", "5"]);
    let levels: Vec<u8> = most.lines().map(|line| line.split(' ').nth(1).unwrap().parse().unwrap()).collect();
    assert!(levels.len() == 5 && levels.is_sorted());
}

#[test]
fn conditions_are_those_of_the_kind_of_file() {
    let directory = TestDirectory::new();
    let mesh = directory.write("cube.off", CUBE);
    let cube = directory.built(&mesh, "cube.goblin", &["--brep"]);
    let cells = directory.built(&mesh, "cells.goblin", &["--cells", "8"]);
    let refuse =
        |file: &str, options: &[&str], code: i32| complaint(&[&["find", file], options].concat(), code);
    for file in [&cube, &cells] {
        assert!(refuse(file, &[], 2).contains("--leaf <KIND,...>"));
        assert!(refuse(file, &["--leaf", "full", "--above", "3"], 2).contains("cannot be used with"));
        assert!(refuse(file, &["--leaf", "flat"], 2).contains("void, full, face"));
    }
    for options in [["--above", "3"], ["--below", "3"], ["--class", "3"]] {
        assert!(refuse(&cube, &options, 1).contains(&format!("{} has no effect", options[0])));
    }
    for (options, expected) in [
        (["--window", "0,0,1,1"], "--window has no effect"),
        (["--view", "rotate=30,z"], "spinney transform"),
    ] {
        let given = [&["--leaf", "full"][..], &options].concat();
        assert!(refuse(&cube, &given, 1).contains(expected));
    }
    assert!(refuse(&cells, &["--leaf", "full"], 1).contains("is not an exact model"));
    let text = complaint(&["get", &cube, &directory.name("cube.png")], 1);
    assert!(
        text.contains(&format!("{cube}: is an exact model")) && text.contains("spinney render"),
        "{text}"
    );
}

/// Two cubes that intersect.
const CROSSING: &str = "OFF\n16 12 0\n0 0 0\n64 0 0\n64 64 0\n0 64 0\n0 0 64\n64 0 64\n64 64 64\n0 64 64\n\
    32 32 32\n96 32 32\n96 96 32\n32 96 32\n32 32 96\n96 32 96\n96 96 96\n32 96 96\n\
    4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n\
    4 11 10 9 8\n4 12 13 14 15\n4 8 9 13 12\n4 9 10 14 13\n4 10 11 15 14\n4 11 8 12 15\n";

#[test]
fn self_intersections_are_repaired_on_request() {
    let directory = TestDirectory::new();
    let mesh = directory.write("crossing.off", CROSSING);
    let file = directory.name("x.goblin");
    let message = complaint(&["build", &mesh, "--brep", "-o", &file], 1);
    assert!(message.contains("intersects itself") && message.contains("--repair"), "{message}");
    let message = complaint(&["build", &mesh, "--brep", "--repair", "-o", &file], 0);
    assert!(message.contains("faces divided") && message.contains("no vertex was moved"), "{message}");
    let stats: Json = serde_json::from_str(&stdout(&["stats", &file, "--topology", "--json"])).unwrap();
    assert_eq!(stats["volume"], 2.0 * 64f64.powi(3) - 32f64.powi(3));
    // Six faces with a corner cut out, and the others of both.
    assert_eq!(stats["topology"]["faces"], 12);
    assert_eq!(stats["topology"]["genus"], 0);
    let cube = directory.write("cube.off", CUBE);
    let message = complaint(&["build", &cube, "--brep", "--repair", "-o", &file], 0);
    assert!(message.contains("the surface is valid"), "{message}");
    // The option applies to exact models.
    for option in [vec!["--repair"], vec!["--close"], vec!["--snap", "1"], vec!["--leaf-size", "3"]] {
        let words = [&["build", &mesh, "--cells", "8", "-o", &file][..], &option[..]].concat();
        let message = complaint(&words, 1);
        assert!(message.contains(option[0]) && message.contains("--brep"), "{message}");
    }
}

/// Attributes of CityJSON objects are reported, and a warning is issued if a format cannot store
/// them.
#[test]
fn attributes_are_listed() {
    let directory = TestDirectory::new();
    let sides = "[[[0,2,1]],[[0,1,3]],[[0,3,2]],[[1,2,3]]]";
    let text = format!(
        r#"{{"type":"CityJSON","version":"2.0","transform":{{"scale":[1,1,1],"translate":[0,0,0]}},
        "metadata":{{"title":"One"}},"CityObjects":{{"r":{{"type":"Road","attributes":{{"lanes":{{"n":2}}}},
        "geometry":[{{"type":"Solid","lod":"2","boundaries":[{sides}]}}]}},"x":{{"type":"GenericCityObject"}}}},
        "vertices":[[0,0,0],[4,0,0],[0,4,0],[0,0,4]]}}"#
    );
    let mesh = directory.write("a.city.json", &text);
    let file = directory.name("a.goblin");
    let message = |arguments: &[&str]| stderr(command(arguments).assert().success());
    let built = message(&["build", "--brep", &mesh, "-o", &file]);
    assert!(built.contains("attributes") && built.contains("of 1 parts\n"), "{built}");
    let info: Json = serde_json::from_str(&stdout(&["info", "--json", &file])).unwrap();
    let road = serde_json::json!({ "type": "Road", "attributes": { "lanes": { "n": 2 } } });
    assert_eq!(info["parts"], serde_json::json!(["r", "x"]));
    assert_eq!(info["attributes"]["parts"], serde_json::json!([road, null]));
    assert_eq!(info["attributes"]["files"][0]["metadata"]["title"], "One");
    let text = stdout(&["info", &file]);
    assert!(text.contains("attributes  of 1 parts"), "{text}");
    let export = message(&["export", &file, &directory.name("a.ply")]);
    assert!(export.contains("the attributes of 2 parts and files"), "{export}");
    assert_eq!(export.matches("the format cannot store").count(), 1, "{export}");
    let export = message(&["export", &file, &directory.name("b.city.json")]);
    assert!(!export.contains("the attributes of"), "{export}");
    let written = std::fs::read_to_string(directory.name("b.city.json")).unwrap();
    assert!(written.contains(r#""r":{"type":"Road","attributes":{"lanes":{"n":2}},"geometry""#), "{written}");
}

#[test]
fn distances_and_rays_are_printed() {
    let directory = TestDirectory::new();
    let cube = directory.built(&directory.write("cube.off", CUBE), "cube.goblin", &["--brep", "--snap", "1"]);
    let printed = stdout(&["point", &cube, "--distance", "--", "32,32,1", "64,0,0", "-3,32,32", "67,68,32"]);
    assert_eq!(printed, "-1\n0\n3\n5\n");
    // From inside, from outside, past it, along an edge, through two corners.
    let rays = ["32,32,32,0,0,2", "1,2,80,0,0,-8", "99,99,99,1,0,0", "0,0,-9,0,0,1", "-1,-1,-1,1,1,1"];
    let all = stdout(&["point", &cube, "--rays", "all", "--", rays[0], rays[1], rays[2]]);
    let lines: Vec<&str> = all.lines().collect();
    assert_eq!(lines[0], "ray,distance,x,y,z,face,part,enters");
    let printed =
        |line: &str| -> Vec<f64> { line.split(',').map(|number| number.parse().unwrap()).collect() };
    let near = |line: &str, expected: &[f64]| {
        let found = printed(line);
        assert!(found.len() == expected.len(), "{line}");
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{line}: {expected:?}");
    };
    near(lines[1], &[1.0, 16.0, 32.0, 32.0, 64.0, 1.0, 0.0, 0.0]);
    near(lines[2], &[2.0, 2.0, 1.0, 2.0, 64.0, 1.0, 0.0, 1.0]);
    near(lines[3], &[2.0, 10.0, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(lines.len(), 4);
    // Rays of a file give the same results as those of the command line, and the first hit of each
    // is the first of all hits.
    let text = rays.join("\n") + "\n\n";
    let of = |which: &str| {
        let done = command(&["point", &cube, "--rays", which]).write_stdin(text.clone()).assert().success();
        String::from_utf8(done.get_output().stdout.clone()).unwrap()
    };
    let (all, first) = (of("all"), of("first"));
    assert!(lines[1..].iter().all(|line| all.contains(line)));
    for ray in 1..=rays.len() {
        let own: Vec<&str> = all.lines().filter(|line| line.starts_with(&format!("{ray},"))).collect();
        assert_eq!(own.len() % 2, usize::from(ray == 1), "{all}");
        let first = first.lines().find(|line| line.starts_with(&format!("{ray},")));
        assert_eq!(first, own.first().copied(), "{all}");
    }
    for wrong in ["1,2,3", "1,2,3,0,0,0", "1,2,3,nan,0,1", "1,2,3,4,5,6,7"] {
        assert!(
            complaint(&["point", &cube, "--rays", "first", wrong], 1).contains("expected X,Y,Z,DX,DY,DZ")
        );
    }
    assert!(complaint(&["point", &cube, "--distance", "--rays", "all", "1,2,3"], 2).contains("--rays"));
    let cells = directory.name("cells.goblin");
    command(&["build", &cube, "-o", &cells, "--cells", "16"]).assert().success();
    assert!(complaint(&["point", &cells, "--distance", "1,2,3"], 1).contains("only with exact models"));
}

/// Three cubes as objects: one valid, one open, and one inside out; and two that overlap.
fn street(directory: &TestDirectory) -> String {
    let mut text = String::new();
    let mut first = 1;
    let sides = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];
    for (name, x, count, is_turned) in
        [("right", 0, 6, false), ("open", 20, 5, false), ("turned", 40, 6, true), ("twice", 5, 6, false)]
    {
        text += &format!("o {name}\n");
        for corner in 0..8 {
            let at = |axis: i32| if corner >> axis & 1 == 1 { 10 } else { 0 };
            text += &format!("v {} {} {}\n", x + at(0), at(1), at(2));
        }
        for side in &sides[..count] {
            let mut side = side.map(|corner| first + corner - 1);
            if is_turned {
                side.reverse();
            }
            text += &format!("f {} {} {} {}\n", side[0], side[1], side[2], side[3]);
        }
        first += 8;
    }
    directory.write("street.obj", &text)
}

#[test]
fn objects_are_skipped_repaired_measured_and_exported() {
    let directory = TestDirectory::new();
    let mesh = street(&directory);
    let out = directory.name("street.goblin");
    let refused = complaint(&["build", &mesh, "-o", &out, "--brep"], 1);
    assert!(refused.contains("of open") && refused.contains("--skip-bad"), "{refused}");
    let message =
        stderr(spinney(&["build", &mesh, "-o", &out, "--brep", "--repair", "--skip-bad"]).success());
    for part in [
        "objects    3; 1 LEFT OUT, which are not valid bodies:",
        "skipped    open: open: 4 edges have a face on one side only",
        "turned     1 body that was inside out, 6 of 18 faces",
        " of the result, ",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let info = stdout(&["info", &out, "--json"]);
    for part in [
        "left out 1 objects that are no bodies: open",
        "repaired, with nonzero windings inside: 1 bodies turned",
    ] {
        assert!(info.contains(part), "{part}: {info}");
    }
    // Two cubes that overlap by half, and one next to them.
    let json = stdout(&["stats", &out, "--json"]);
    assert_eq!(serde_json::from_str::<Json>(&json).unwrap()["volume"], 2500.0);
    let all = ["build", &mesh, "-o", &out, "--brep", "--repair", "--close"];
    let message = stderr(command(&all).args(["--inside", "odd"]).assert().success());
    assert!(message.contains("percent from that of cells of the models"), "{message}");
    let json = stdout(&["stats", &out, "--json"]);
    assert_eq!(serde_json::from_str::<Json>(&json).unwrap()["volume"], 3000.0);
    let found = stdout(&["point", &out, "--object", "1,5,5", "45,5,5", "15,5,5", "60,5,5"]);
    assert_eq!(found, "inside\tright\ninside\tturned\nboundary\ttwice\noutside\n");
    command(&["build", &mesh, "-o", &out, "--brep", "--where", "id=right"]).assert().success();
    let table = stdout(&["stats", "-q", "--each", &out]);
    let lines: Vec<&str> = table.lines().map(str::trim_end).collect();
    assert_eq!(lines.len(), 2, "{table}");
    assert!(lines[1].ends_with("right,,true,6,1000,600,0,10,5,5,5"), "{table}");
    let some = directory.name("some.obj");
    command(&["export", "-q", &out, "-o", &some, "--where", "id=right"]).assert().success();
    assert_eq!(
        std::fs::read_to_string(&some).unwrap().lines().filter(|line| line.starts_with("f ")).count(),
        6
    );
    let refused = complaint(&["export", &out, "-o", &some, "--where", "id=wrong"], 1);
    assert!(refused.contains("--where id=wrong: no object satisfies the conditions"), "{refused}");
    let refused = complaint(&["build", &mesh, "-o", &out, "--brep", "--where", "id=wrong"], 1);
    assert!(
        refused.contains("street.obj: --where id=wrong: no object satisfies the conditions"),
        "{refused}"
    );
    for words in [["build", &mesh, "-o", &out, "--brep"], ["export", &out, "-o", &some, "-q"]] {
        let refused = complaint(&[&words[..], &["--where", "roof=flat"]].concat(), 1);
        assert!(refused.contains("--where: got roof, which no object has"), "{refused}");
        assert!(refused.contains("street.") && refused.contains("id, type"), "{refused}");
    }
    let refused = complaint(&["build", &mesh, "-o", &out, "--brep", "--repair", "--inside", "even"], 2);
    assert!(refused.contains("nonzero, positive or odd"), "{refused}");
    let refused = complaint(&["build", &mesh, "-o", &out, "--brep", "--inside", "odd"], 2);
    assert!(refused.contains("--repair"), "{refused}");
}

/// Objects of a file that is not a valid exact model, and of one that is; one of them by name.
#[test]
fn objects_are_found() {
    let directory = TestDirectory::new();
    let mesh = street(&directory);
    let printed = spinney(&["find", &mesh, "--contacts"]).success();
    assert_eq!(String::from_utf8_lossy(&printed.get_output().stdout), "overlap 500 0 5,0,0\tright\ttwice\n");
    assert!(stderr(printed).contains("1 objects are open and were left out: open"));
    let out = directory.name("street.goblin");
    command(&["build", &mesh, "-o", &out, "--brep", "--where", "id=right"]).assert().success();
    assert_eq!(stdout(&["find", &out, "--contacts"]), "");
    assert_eq!(stdout(&["find", &out, "--object", "right"]), "0 0,0,0,10,10,10 1000\tright\n");
    let json: Json = serde_json::from_str(&stdout(&["find", &out, "--object", "right", "--json"])).unwrap();
    assert_eq!(
        (&json["area"], &json["closed"], &json["attributes"]),
        (&600.0.into(), &true.into(), &Json::Null)
    );
    let refused = complaint(&["find", &out, "--object", "rigth"], 1);
    assert!(refused.contains("has no object rigth; similar names are right"), "{refused}");
    for name in ["town hall", "x"] {
        let refused = complaint(&["find", &out, "--object", name], 1);
        assert!(
            refused.contains("among its 1; `spinney stats --each") && !refused.contains("similar"),
            "{refused}"
        );
    }
    let refused = complaint(&["find", &out, "--contacts", "--window", "0,0,0,1,1,1"], 1);
    assert!(refused.contains("--window has no effect"), "{refused}");
    let cells = directory.built(&mesh, "cells.goblin", &["--cells", "16"]);
    let refused = complaint(&["find", &cells, "--contacts"], 1);
    assert!(refused.contains("is not an exact model or a mesh file"), "{refused}");
    // On a coarse grid, objects are at their snapped positions.
    let printed = stdout(&["find", &mesh, "--contacts", "--snap", "4"]);
    assert!(printed.starts_with("overlap ") && printed != "overlap 500 0 5,0,0\tright\ttwice\n", "{printed}");
    assert!(complaint(&["find", &mesh, "--contacts", "--snap", "0"], 1).contains("a width above zero"));
    assert!(
        complaint(&["find", &out, "--contacts", "--snap", "1"], 1)
            .contains("--snap works only with mesh files")
    );
    let refused = complaint(&["find", &cells, "--object", "right"], 1);
    assert!(refused.contains("is not an exact model, which --leaf and --object need"), "{refused}");

    let wall = |low: i32| json_box([low, 0, 0], [low + 2, 2, 2]);
    let city = directory.write("city.city.json", city(&[("a", wall(0)), ("b b", wall(2))]));
    let out = directory.built(&city, "city.goblin", &["--brep"]);
    for file in [&city, &out] {
        let found = stdout(&["find", file, "--contacts", "--json", "--limit", "9"]);
        let found: Json = serde_json::from_str(&found).unwrap();
        let expected = serde_json::json!({ "kind": "touch", "parts": [0, 1], "names": ["a", "b b"], "volume": 0.0,
            "area": 4.0, "place": [2.0, 0.0, 0.0] });
        assert_eq!(found, expected);
        assert_eq!(stdout(&["find", file, "--contacts", "--limit", "0"]), "");
    }
    let object = stdout(&["find", &out, "--object", "b b"]);
    assert!(object.contains(" 8\tb b\t{\"type\":\"Building\"}\tfaces {\"surface\":{"), "{object}");
    // One face of the box has a surface.
    let json: Json = serde_json::from_str(&stdout(&["find", &out, "--object", "b b", "--json"])).unwrap();
    let expected = serde_json::json!({ "surface": { "0": 1 }, "type": { "RoofSurface": 1 } });
    assert_eq!(json["face_values"], expected);
    let info = stdout(&["info", &out]);
    assert!(info.contains("values      of faces: surface, type\n"), "{info}");
    let json: Json = serde_json::from_str(&stdout(&["info", &out, "--json"])).unwrap();
    assert_eq!(json["face_columns"], serde_json::json!(["surface", "type"]));
}

/// Semantics of surfaces stay with faces that `combine` splits.
#[test]
fn combine_keeps_values_of_faces() {
    let directory = TestDirectory::new();
    let built = |name: &str, low: i32| {
        let mesh = city(&[(name, json_box([low; 3], [low + 4; 3]))]);
        let mesh = directory.write(&format!("{name}.city.json"), &mesh);
        directory.built(&mesh, &format!("{name}.goblin"), &["--brep", "--snap", "1"])
    };
    let (a, b) = (built("a", 0), built("b", 2));
    let out = directory.name("c.goblin");
    let message = command(&["combine", "a-b", &a, &b, "-o", &out]).assert().success();
    let message = stderr(message);
    assert!(!message.contains("not kept"), "{message}");
    assert!(stdout(&["info", &out]).contains("values      of faces: surface, type\n"));
    let city = directory.name("c.city.json");
    command(&["export", &out, &city]).assert().success();
    let city: Json = serde_json::from_slice(&std::fs::read(&city).unwrap()).unwrap();
    let semantics = |name: &str| city["CityObjects"][name]["geometry"][0]["semantics"].clone();
    assert_eq!(semantics("a")["surfaces"], serde_json::json!([{ "type": "RoofSurface" }]));
    assert_eq!(semantics("b"), Json::Null);
}

/// Fragments of faces that `section --split` makes keep the faces' values.
#[test]
fn divided_faces_keep_values() {
    let directory = TestDirectory::new();
    let built = |name: &str, low: i32| {
        let mesh = city(&[(name, json_box([low; 3], [low + 4; 3]))]);
        let mesh = directory.write(&format!("{name}.city.json"), &mesh);
        directory.built(&mesh, &format!("{name}.goblin"), &["--brep", "--snap", "1"])
    };
    let (a, b) = (built("a", 0), built("b", 2));
    let out = directory.name("c.goblin");
    let message = stderr(command(&["section", &a, &b, "--split", &out]).assert().success());
    assert!(message.contains("3 of 6 faces divided, 9 faces after"), "{message}");
    let info: Json = serde_json::from_str(&stdout(&["info", &out, "--json"])).unwrap();
    assert_eq!(info["face_columns"], serde_json::json!(["surface", "type"]));
    let city = directory.name("c.city.json");
    command(&["export", &out, &city]).assert().success();
    let city: Json = serde_json::from_slice(&std::fs::read(&city).unwrap()).unwrap();
    assert_eq!(city["CityObjects"].as_object().unwrap().keys().collect::<Vec<_>>(), ["a"]);
    let semantics = &city["CityObjects"]["a"]["geometry"][0]["semantics"];
    assert_eq!(semantics["surfaces"], serde_json::json!([{ "type": "RoofSurface" }]));
    // The roof is two of nine faces.
    let values = semantics["values"][0].as_array().unwrap();
    assert_eq!((values.len(), values.iter().filter(|value| **value == 0).count()), (9, 2));
}

/// Returns the corners of a box, the lower ones first.
fn json_box(low: [i32; 3], high: [i32; 3]) -> [[i32; 3]; 8] {
    [0, 1, 2, 3, 4, 5, 6, 7].map(|corner: usize| {
        let at = [[0, 0], [1, 0], [1, 1], [0, 1]][corner % 4];
        [[low[0], high[0]][at[0]], [low[1], high[1]][at[1]], [low[2], high[2]][corner / 4]]
    })
}

/// Returns a city of boxes whose upper surface is a roof.
fn city(boxes: &[(&str, [[i32; 3]; 8])]) -> String {
    let sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    let mut objects = serde_json::Map::new();
    for (number, (name, _)) in boxes.iter().enumerate() {
        let sides = sides.map(|side| [side.map(|corner: usize| 8 * number + corner)]);
        let semantics = serde_json::json!({ "surfaces": [{ "type": "RoofSurface" }], "values": [[null, 0, null, null, null, null]] });
        let solid =
            serde_json::json!({ "type": "Solid", "lod": "2", "boundaries": [sides], "semantics": semantics });
        objects.insert((*name).into(), serde_json::json!({ "type": "Building", "geometry": [solid] }));
    }
    let vertices: Vec<_> = boxes.iter().flat_map(|(_, corners)| corners).collect();
    serde_json::json!({ "type": "CityJSON", "version": "2.0", "CityObjects": objects, "vertices": vertices,
        "transform": { "scale": [1.0, 1.0, 1.0], "translate": [0.0, 0.0, 0.0] } })
    .to_string()
}
