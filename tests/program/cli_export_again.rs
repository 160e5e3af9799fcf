//! Exact models and octrees that are exported, read by others, and built again.

use serde_json::Value as Json;

use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::directory::TestDirectory;

/// Box as OBJ, by its minimum corner and its size.
fn cuboid([x, y, z]: [f64; 3], [width, length, height]: [f64; 3]) -> String {
    let corner = |i: u8| {
        let at = |bit: u8, low: f64, size: f64| if i >> bit & 1 == 1 { low + size } else { low };
        format!("v {} {} {}\n", at(0, x, width), at(1, y, length), at(2, z, height))
    };
    let corners: String = (0..8).map(corner).collect();
    corners + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
}

/// Prism of a regular polygon as OBJ, around the z axis through the middle of a plate.
fn drill(sides: u32, radius: f64) -> String {
    let at = |i: u32, z: f64| {
        let angle = f64::from(i) * std::f64::consts::TAU / f64::from(sides);
        format!("v {} {} {z}\n", 50.0 + radius * angle.cos(), 25.0 + radius * angle.sin())
    };
    let vertices: String = [-20.0, 40.0].iter().flat_map(|z| (0..sides).map(move |i| at(i, *z))).collect();
    let ring = |numbers: &mut dyn Iterator<Item = u32>| -> String {
        format!("f{}\n", numbers.map(|number| format!(" {number}")).collect::<String>())
    };
    let wall = |i: u32| {
        let next = (i + 1) % sides;
        ring(&mut [i + 1, next + 1, sides + next + 1, sides + i + 1].into_iter())
    };
    let ends = [ring(&mut (1..=sides).rev()), ring(&mut (sides + 1..=2 * sides))].concat();
    vertices + &ends + &(0..sides).map(wall).collect::<String>()
}

fn stats(file: &str) -> Json {
    serde_json::from_str(&stdout(&["stats", file, "--json"])).unwrap()
}

fn volume(file: &str) -> f64 {
    stats(file)["volume"].as_f64().unwrap_or_else(|| panic!("{}", stats(file)))
}

/// Builds an exact model of a text.
fn built(directory: &TestDirectory, name: &str, text: &str, options: &[&str]) -> String {
    let (mesh, file) = (directory.name(&format!("{name}.obj")), directory.name(&format!("{name}.goblin")));
    std::fs::write(&mesh, text).unwrap();
    command(&[&["build", "-q", &mesh, "-o", &file, "--brep"], options].concat()).assert().success();
    file
}

fn run(arguments: &[&str]) {
    command(arguments).assert().success();
}

/// Twice the area of a mesh in OBJ whose polygons are read as fans.
fn area_of_fans(path: &str) -> f64 {
    let (mut points, mut sum) = (Vec::<[f64; 3]>::new(), 0.0);
    for line in std::fs::read_to_string(path).unwrap().lines() {
        let words: Vec<f64> = line.split(' ').skip(1).filter_map(|word| word.parse().ok()).collect();
        match line.get(..2) {
            Some("v ") => points.push([words[0], words[1], words[2]]),
            Some("f ") => {
                let at = |i: usize| points[words[i] as usize - 1];
                for i in 1..words.len() - 1 {
                    let [a, b, c] = [at(0), at(i), at(i + 1)];
                    let to = |p: [f64; 3]| [0, 1, 2].map(|axis| p[axis] - a[axis]);
                    let (u, v) = (to(b), to(c));
                    let normal = [0, 1, 2].map(|k: usize| {
                        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                        u[i] * v[j] - u[j] * v[i]
                    });
                    sum += normal.iter().map(|part| part * part).sum::<f64>().sqrt() / 2.0;
                }
            }
            _ => {}
        }
    }
    sum
}

/// Drilled plates in all formats: those of triangles are read as what they are, and all are built
/// and combined again without repair.
#[test]
fn drilled_plates_come_back_from_each_format() {
    let directory = TestDirectory::new();
    let plate = built(&directory, "plate", &cuboid([0.0; 3], [100.0, 50.0, 20.0]), &[]);
    for (sides, radius) in [(64, 7.3), (31, 11.7)] {
        let tool = built(&directory, "drill", &drill(sides, radius), &[]);
        let drilled = directory.name("drilled.goblin");
        run(&["combine", "-q", "a-b", &plate, &tool, "-o", &drilled]);
        let (turn, sides) = (std::f64::consts::TAU / f64::from(sides), f64::from(sides));
        let disc = sides * radius * radius * turn.sin() / 2.0;
        let expected = (5000.0 - disc) * 20.0;
        let surface = 2.0 * (5000.0 - disc) + 6000.0 + sides * 40.0 * radius * (turn / 2.0).sin();
        for name in ["no.stl", "no.ply"] {
            let message = complaint(&["export", &drilled, &directory.name(name), "--triangles"], 1);
            assert!(message.contains("always have triangles"), "{message}");
        }
        for name in ["a.stl", "a.ply", "a.obj", "a.off", "a.city.json"] {
            let (mesh, again, common) =
                (directory.name(name), directory.name("again.goblin"), directory.name("common.goblin"));
            run(&["export", "-q", &drilled, &mesh]);
            run(&["build", "-q", &mesh, "-o", &again, "--brep"]);
            run(&["verify", "-q", &again]);
            run(&["combine", "-q", "and", &again, &plate, "-o", &common]);
            for file in [&drilled, &again, &common] {
                let found = volume(file);
                assert!((found - expected).abs() < 1e-6 * expected, "{name}: {found}, expected {expected}");
            }
            if name == "a.obj" {
                let found = area_of_fans(&mesh);
                assert!((found - surface).abs() < 1e-6 * surface, "{found}, expected {surface}");
            }
            if name == "a.ply" {
                // Triangles only: each is a count of one byte, and three indices.
                let bytes = std::fs::read(&mesh).unwrap();
                let end = bytes.windows(11).position(|word| word == b"end_header\n").unwrap() + 11;
                let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
                let count = |element: &str| -> usize {
                    let line = header.lines().find_map(|line| line.strip_prefix(element)).unwrap();
                    line.trim().parse().unwrap()
                };
                let (vertices, faces) = (count("element vertex"), count("element face"));
                assert_eq!(bytes.len(), end + 24 * vertices + 13 * faces);
            }
            [&mesh, &again, &common].into_iter().for_each(|file| std::fs::remove_file(file).unwrap());
        }
        std::fs::remove_file(&drilled).unwrap();
        std::fs::remove_file(&tool).unwrap();
    }
}

/// Results on a grid of whole units, whose vertices are fractions: the files have them.
#[test]
fn fractions_of_coarse_grids_come_back_from_each_format() {
    let directory = TestDirectory::new();
    let plate =
        built(&directory, "plate", &cuboid([0.0; 3], [100.0, 50.0, 20.0]), &["--snap", "1", "--unit", "m"]);
    let corners = "v 10 10 -7\nv 33 17 25\nv 90 41 9\nv 50 3 28\n";
    let faces = "f 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n";
    let tool = built(&directory, "tool", &format!("{corners}{faces}"), &["--snap", "1", "--unit", "m"]);
    let cut = directory.name("cut.goblin");
    run(&["combine", "-q", "a-b", &plate, &tool, "-o", &cut]);
    let expected = volume(&cut);
    for name in ["a.stl", "a.ply", "a.obj", "a.off", "a.city.json"] {
        let (mesh, again, common) =
            (directory.name(name), directory.name("again.goblin"), directory.name("common.goblin"));
        let said = stderr(command(&["export", &cut, &mesh]).assert().success());
        assert!(said.contains("off-grid vertices, to multiples of 0.00000"), "{said}");
        run(&["build", "-q", &mesh, "-o", &again, "--brep"]);
        run(&["combine", "-q", "and", &again, &plate, "-o", &common]);
        for file in [&again, &common] {
            let found = volume(file);
            assert!((found - expected).abs() < 1e-6 * expected, "{name}: {found}, expected {expected}");
        }
        [&mesh, &again, &common].into_iter().for_each(|file| std::fs::remove_file(file).unwrap());
    }
}

/// Boxes that overlap by one unit of the grid are united, as rounding may have caused it. What is
/// deeper, or a body that is inside out, is refused.
#[test]
fn thin_intersections_are_repaired() {
    let directory = TestDirectory::new();
    let unit = 1.0 / f64::from(1 << 22);
    let boxes = |x: f64, second: [f64; 3]| {
        let numbers = |line: &str| -> String {
            line.split(' ')
                .filter_map(|word| word.parse().ok())
                .map(|at: usize| format!(" {}", at + 8))
                .collect()
        };
        let shifted = |line: &str| match line.starts_with('f') {
            true => format!("f{}\n", numbers(line)),
            false => format!("{line}\n"),
        };
        cuboid([0.0; 3], [1.0; 3]) + &cuboid([x, 0.25, 0.25], second).lines().map(shifted).collect::<String>()
    };
    let (mesh, file) = (directory.name("boxes.obj"), directory.name("boxes.goblin"));
    std::fs::write(&mesh, boxes(1.0 - unit, [1.0, 0.5, 0.5])).unwrap();
    let said = stderr(command(&["build", &mesh, "-o", &file, "--brep"]).assert().success());
    assert!(said.contains("repaired"), "{said}");
    run(&["verify", "-q", &file]);
    assert!((volume(&file) - 1.25).abs() < 1e-6);
    std::fs::remove_file(&file).unwrap();
    // Sixteen units; inside of the other, with a common wall; the same with a thin overlap, too.
    for (x, size) in [(1.0 - 16.0 * unit, [1.0, 0.5, 0.5]), (0.0, [0.5; 3]), (unit - 0.5, [0.5, 1e-3, 0.5])] {
        let mut text = boxes(x, size);
        if x < 0.0 {
            // (The faces of the first box are turned.)
            text = text.replacen(
                "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n",
                "f 2 4 3 1\nf 7 8 6 5\nf 5 6 2 1\nf 4 8 7 3\nf 3 7 5 1\nf 6 8 4 2\n",
                1,
            );
        }
        std::fs::write(&mesh, text).unwrap();
        let message = complaint(&["build", &mesh, "-o", &file, "--brep"], 1);
        assert!(message.contains("resolve it with --repair"), "{message}");
    }
}

/// A cube with a flap of no thickness at an edge of its lid.
#[test]
fn folds_are_repaired() {
    let directory = TestDirectory::new();
    let (mesh, file) = (directory.name("flap.obj"), directory.name("flap.goblin"));
    let flap = cuboid([0.0; 3], [1.0; 3]) + "v 0.5 -0.125 1\nf 5 9 6\nf 6 9 5\n";
    std::fs::write(&mesh, flap).unwrap();
    // Two boxes that share a wall are not folded.
    let touching = built(&directory, "two", &cuboid([0.0; 3], [1.0; 3]), &[]);
    let other = built(&directory, "other", &cuboid([1.0, 0.0, 0.0], [1.0; 3]), &[]);
    let both = [directory.name("two.obj"), directory.name("other.obj"), directory.name("both.goblin")];
    run(&["build", "-q", &both[0], &both[1], "-o", &both[2], "--brep"]);
    assert_eq!([&touching, &other, &both[2]].map(|file| volume(file)), [1.0, 1.0, 2.0]);
    // A file of such a cube.
    let folded = "fixtures/folded.goblin";
    let found = String::from_utf8(command(&["verify", folded]).assert().code(1).get_output().stdout.clone());
    assert!(found.unwrap().contains("folded onto each other at 0.5, -0.0625, 1"));
    let moved = directory.name("moved.goblin");
    let message = complaint(&["transform", folded, "translate=1,0,0", "-o", &moved], 1);
    assert!(message.contains("verify") && message.contains("--repair"), "{message}");
    // Without and with the advice.
    for options in [&[][..], &["--repair"]] {
        run(&[&["build", "-q", &mesh, "-o", &file, "--brep"], options].concat());
        run(&["verify", "-q", &file]);
        let found = stats(&file);
        assert_eq!((found["volume"].as_f64(), found["surface"].as_f64()), (Some(1.0), Some(6.0)), "{found}");
        std::fs::remove_file(&file).unwrap();
    }
}

/// Far from the origin, single precision would move vertices by decimetres. The advice is followed.
#[test]
fn stl_far_from_the_origin_is_refused_with_advice() {
    let directory = TestDirectory::new();
    let far = built(&directory, "far", &cuboid([500_123.25, 5_200_456.75, 100.0], [10.5, 8.0, 6.0]), &[]);
    let mesh = directory.name("far.stl");
    let message = complaint(&["export", &far, &mesh], 1);
    assert!(
        message.contains("move vertices by up to 3") && message.contains("or write PLY or OBJ"),
        "{message}"
    );
    let from = message.find("--view ").unwrap() + 7;
    let view = message[from..].split(',').take(3).collect::<Vec<_>>().join(",");
    assert_eq!(view, "translate=-500123,-5200456,-100");
    let said = stderr(command(&["export", &far, &mesh, "--view", &view]).assert().success());
    assert!(!said.contains("moved"), "{said}");
    let again = directory.name("again.goblin");
    run(&["build", "-q", &mesh, "-o", &again, "--brep"]);
    assert_eq!(volume(&again), 504.0);
    // A large one is moved by little, and the distance is reported.
    let wide = built(&directory, "wide", &cuboid([500_123.3, 5_200_456.7, 0.0], [9000.0, 8000.0, 6.1]), &[]);
    let said = stderr(command(&["export", &wide, &directory.name("wide.stl")]).assert().success());
    assert!(said.contains("vertices, by at most 2.") && said.contains("e-1"), "{said}");
}

/// Lengths of a cube of 2 units in all formats: converted to metres, kept with their unit, or kept
/// with a warning.
#[test]
fn units_of_each_format() {
    let directory = TestDirectory::new();
    let mesh = directory.name("cube.obj");
    std::fs::write(&mesh, cuboid([0.0; 3], [2.0; 3])).unwrap();
    for (unit, metres) in [("mm", 0.001), ("in", 0.0254)] {
        let (exact, cells) =
            (directory.name(&format!("{unit}.goblin")), directory.name(&format!("{unit}c.goblin")));
        run(&["build", "-q", &mesh, "-o", &exact, "--brep", "--unit", unit]);
        run(&["build", "-q", &mesh, "-o", &cells, "--cells", "4", "--unit", unit]);
        for (file, is_exact) in [(&exact, true), (&cells, false)] {
            for name in ["a.ply", "a.obj", "a.off", "a.stl", "a.city.json", "a.glb"] {
                if name == "a.city.json" && !is_exact {
                    continue;
                }
                let out = directory.name(name);
                let said = stderr(command(&["export", file, &out]).assert().success());
                let is_converted = ["a.city.json", "a.glb"].contains(&name);
                let lost = format!("the unit of length {unit}");
                assert_eq!(said.contains(&lost), !is_converted, "{unit} {name}: {said}");
                let again = directory.name("again.goblin");
                let options = if is_exact { &["--brep"][..] } else { &["--cells", "4"] };
                run(&[&["build", "-q", &out, "-o", &again], options].concat());
                let expected = 8.0 * if is_converted { metres * metres * metres } else { 1.0 };
                let found = volume(&again);
                assert!(
                    (found - expected).abs() < 1e-5 * expected,
                    "{unit} {name}: {found}, expected {expected}"
                );
                [&out, &again].into_iter().for_each(|file| std::fs::remove_file(file).unwrap());
            }
            // Roots of tilesets have boxes in metres.
            let tiles = directory.name(&format!("{unit}{is_exact}/tileset.json"));
            let said = stderr(command(&["export", file, &tiles]).assert().success());
            assert!(!said.contains("unit of length"), "{said}");
            let text = std::fs::read_to_string(&tiles).unwrap();
            let tileset: Json = serde_json::from_str(&text).unwrap();
            let bounds = &tileset["root"]["boundingVolume"]["box"];
            let half = [3, 7, 11].map(|at: usize| bounds[at].as_f64().unwrap());
            assert!(half.iter().all(|half| (half - metres).abs() < 0.01 * metres), "{unit}: {bounds}");
        }
        // Octrees are converted to other units.
        let converted = directory.name("converted.goblin");
        run(&["transform", "-q", &cells, "--unit", "m", "-o", &converted]);
        let both = ["transform", &cells, "scale=0.001", "--unit", "m", "-o", &directory.name("x.goblin")];
        assert!(complaint(&both, 1).contains("leave one of them out"));
        let (found, expected) = (volume(&converted), 8.0 * metres * metres * metres);
        assert!((found - expected).abs() < 1e-9 * expected, "{unit}: {found}");
        let info: Json = serde_json::from_str(&stdout(&["info", "--json", &converted])).unwrap();
        assert_eq!(info["unit"], "m", "{info}");
        std::fs::remove_file(&converted).unwrap();
    }
    let placed = directory.name("placed.goblin");
    run(&["build", "-q", &mesh, "-o", &placed, "--cells", "4", "--crs", "EPSG:28992"]);
    let message = complaint(&["transform", &placed, "--unit", "mm", "-o", &directory.name("x.goblin")], 1);
    assert!(message.contains("which defines their unit"), "{message}");
    let map = "fixtures/v1/classes.goblin";
    let message = complaint(&["transform", map, "--unit", "mm", "-o", &directory.name("x.goblin")], 1);
    assert!(message.contains("quadtree"), "{message}");
}

/// Messages list what a file of this kind can be.
#[test]
fn advice_fits_the_kind_of_file() {
    let directory = TestDirectory::new();
    let exact = built(&directory, "cube", &cuboid([0.0; 3], [2.0; 3]), &[]);
    let cells = directory.name("cells.goblin");
    run(&["build", "-q", &directory.name("cube.obj"), "-o", &cells, "--cells", "4"]);
    let out = directory.name("x.dxf");
    let message = complaint(&["export", &exact, &out], 1);
    assert!(message.contains(".city.json, .glb") && !message.contains(".tif"), "{message}");
    let message = complaint(&["export", &cells, &out], 1);
    assert!(message.contains(".tif") && !message.contains(".city.json"), "{message}");
    let message = complaint(&["diff", &exact, &exact], 1);
    assert!(message.contains("spinney combine xor"), "{message}");
}
