//! Set operations on exact models on the command line.

use std::path::Path;

use serde_json::Value as Json;

use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::directory::TestDirectory;

/// Two cubes with sides of 64 that have one of 32 in common, and one of their own.
struct CubePair {
    directory: TestDirectory,
    a: String,
    b: String,
}

/// Returns a cube as a mesh file.
fn cube(low: i32, high: i32) -> String {
    let mut text = String::from("OFF\n8 6 0\n");
    for [x, y, z] in [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    {
        let at = |corner: i32| if corner == 1 { high } else { low };
        text += &format!("{} {} {}\n", at(x), at(y), at(z));
    }
    text + "4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
}

impl CubePair {
    fn new() -> CubePair {
        let mut made = CubePair { directory: TestDirectory::new(), a: String::new(), b: String::new() };
        made.a = made.built("a", &cube(0, 64), &["--brep", "--snap", "1"]);
        made.b = made.built("b", &cube(32, 96), &["--brep", "--snap", "1"]);
        made
    }

    fn name(&self, name: &str) -> String {
        self.directory.name(name)
    }

    fn built(&self, name: &str, text: &str, options: &[&str]) -> String {
        let [mesh, file] = [format!("{name}.off"), format!("{name}.goblin")].map(|name| self.name(&name));
        std::fs::write(&mesh, text).unwrap();
        command(&["build", "-q", &mesh, "-o", &file]).args(options).assert().success();
        file
    }

    /// Combines both with an operation.
    fn combined(&self, operation: &str, name: &str) -> String {
        let file = self.name(name);
        command(&["combine", "-q", operation, &self.a, &self.b, "-o", &file])
            .assert()
            .success()
            .stdout("")
            .stderr("");
        file
    }
}

fn json(arguments: &[&str]) -> Json {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

#[test]
fn operations_have_names_and_numbers() {
    let directory = CubePair::new();
    let (side, common) = (64f64.powi(3), 32f64.powi(3));
    let cases = [
        ("none", "0", 0.0),
        ("and", "1", common),
        ("a-b", "2", side - common),
        ("a", "3", side),
        ("b-a", "4", side - common),
        ("b", "5", side),
        ("xor", "6", 2.0 * (side - common)),
        ("or", "7", 2.0 * side - common),
        ("nor", "8", common - 2.0 * side),
        ("xnor", "9", 2.0 * (common - side)),
        ("not-b", "10", -side),
        ("a|!b", "11", common - side),
        ("not", "12", -side),
        ("b|!a", "13", common - side),
        ("nand", "14", -common),
        ("all", "15", 0.0),
    ];
    for (name, number, volume) in cases {
        let files = [name, number]
            .map(|operation| directory.combined(operation, &format!("{number}-{}.goblin", operation.len())));
        let bytes = files.each_ref().map(|file| std::fs::read(file).unwrap());
        assert!(bytes[0] == bytes[1], "{name}");
        assert_eq!(json(&["stats", &files[0], "--json"])["volume"], volume, "{name}");
    }
    assert_eq!(
        std::fs::read(directory.combined("union", "u.goblin")).unwrap(),
        std::fs::read(directory.combined("7", "v.goblin")).unwrap()
    );
    // Of one file, and of three.
    let c = directory.built("c", &cube(90, 100), &["--brep", "--snap", "1"]);
    let file = directory.name("many.goblin");
    let message =
        stderr(command(&["combine", "or", &directory.a, &directory.b, &c, "-o", &file]).assert().success());
    assert!(message.contains("faces divided") && message.contains("result"), "{message}");
    assert_eq!(json(&["stats", &file, "--json"])["volume"], 2.0 * side - common + 1000.0 - 216.0);
    let message = stderr(command(&["combine", "not", &directory.a, "-o", &file]).assert().success());
    assert!(message.contains("unbounded"), "{message}");
}

#[test]
fn options_without_an_effect_are_refused() {
    let directory = CubePair::new();
    let (a, b, never) = (&directory.a, &directory.b, directory.name("never.goblin"));
    let cells = directory.built("cells", &cube(0, 64), &["--cells", "16"]);
    let refuse = |arguments: &[&str]| {
        let message = complaint(&[&["combine"], arguments, &["-o", &never]].concat(), 1);
        assert!(!Path::new(&never).exists());
        message
    };
    // Cells and exact models.
    for files in [[a, &cells], [&cells, a]] {
        let message = refuse(&["union", files[0], files[1]]);
        assert!(
            message.contains("cells.goblin: ")
                && message.contains("--grid")
                && message.contains("spinney build"),
            "{message}"
        );
    }
    for options in [&["--values", "b"][..], &["--fill", "3"]] {
        let message = refuse(&[&["union", a, b], options].concat());
        assert!(message.contains(&format!("which {} needs", options[0])), "{message}");
    }
    for options in [["--within", "0,0,0,9,9,9"], ["--margin", "4"]] {
        assert!(
            refuse(&[&["nor", a, b], &options[..]].concat()).contains("which --within or --margin needs")
        );
    }
    for operation in ["over", "min", "max", "add", "subtract", "equal", "changed"] {
        let message = refuse(&[operation, a, b]);
        assert!(message.contains("no values") && message.contains("set operation"), "{operation}: {message}");
    }
    assert!(complaint(&["combine", "cross", a, b], 1).contains("exact model"));
    for files in
        [&["union", a][..], &["a-b", a], &["and", a], &["b", a, b, a], &["b-a", a, b, a], &["not", a, b, a]]
    {
        let message = refuse(files);
        assert!(
            message.contains("bodies") || message.contains("files") || message.contains("body"),
            "{message}"
        );
    }
    complaint(&["combine", "16", a, b, "-o", &never], 2);
    complaint(&["combine", "union", a, &directory.name("none.goblin"), "-o", &never], 1);
    complaint(&["combine", "union", a, b], 1);
    // Inputs are not overwritten.
    let before = std::fs::read(a).unwrap();
    for files in [[a, b], [b, a]] {
        complaint(&["combine", "union", files[0], files[1], "-o", a], 1);
    }
    assert!(std::fs::read(a).unwrap() == before && !Path::new(&never).exists());
}

/// Empty and unbounded solids support the same queries as all others.
#[test]
fn queries_of_results() {
    let directory = CubePair::new();
    let (a, never) = (&directory.a, directory.name("none.goblin"));
    command(&["combine", "-q", "a-b", a, a, "-o", &never]).assert().success();
    let cases = [
        (directory.combined("or", "or.goblin"), "inside\ninside\noutside\noutside\n", 12, false),
        (directory.combined("nor", "nor.goblin"), "outside\noutside\ninside\ninside\n", 12, true),
        (never, "outside\noutside\noutside\noutside\n", 0, false),
        (directory.combined("all", "all.goblin"), "inside\ninside\ninside\ninside\n", 0, true),
    ];
    for (file, locations, faces, is_unbounded) in &cases {
        assert_eq!(stdout(&["point", file, "1,1,1", "90,90,90", "90,1,1", "1e6,0,0"]), *locations, "{file}");
        command(&["verify", file]).assert().success();
        let stats = json(&["stats", file, "--topology", "--json"]);
        assert_eq!(stats["volume"].as_f64().unwrap() < 0.0, *is_unbounded && *faces > 0, "{stats}");
        assert_eq!(stats["topology"]["faces"], *faces, "{stats}");
        let messages = [
            stdout(&["stats", file]),
            stdout(&["info", file]),
            stdout(&["info", file, "--json"]),
            stdout(&["find", file, "--leaf", "void,full,face,edge,vertex,boolean"]),
            stats.to_string(),
        ];
        for text in &messages {
            let is_odd = ["NaN", "inf\n", "inf ", "-0 ", "1844674407370955", "null,null"]
                .iter()
                .find(|odd| text.contains(*odd));
            assert!(is_odd.is_none() && !text.is_empty(), "{file}: {is_odd:?} in {text}");
        }
        assert!(!is_unbounded || messages[1].contains("unbounded"), "{}", messages[1]);
        // Meshes need a surface, and therefore a solid; an empty set is not a valid mesh file.
        for format in ["ply", "stl", "obj", "off", "city.json"] {
            let mesh = directory.name(&format!("out.{format}"));
            let run = command(&["export", file, &mesh]).assert();
            let code = run.get_output().status.code().unwrap();
            let message = stderr(run);
            assert!(code <= 1 && !message.contains("panicked"), "{format}: {message}");
            assert_eq!(code == 0, Path::new(&mesh).exists(), "{format}: {message}");
            assert!(code == 0 || *faces == 0 || *is_unbounded, "{format}: {message}");
            let _ = std::fs::remove_file(mesh);
        }
        for words in [
            vec!["render", file.as_str(), "--size", "20x20"],
            vec!["build", file.as_str(), "--cells", "8", "-o"],
        ] {
            let out = directory.name(if words[0] == "render" { "out.png" } else { "out.goblin" });
            let run = command(&words).arg(&out).assert();
            let code = run.get_output().status.code().unwrap();
            let message = stderr(run);
            assert!(code <= 1 && !message.contains("panicked"), "{words:?}: {message}");
        }
    }
    // They are operands again: everything minus one is its complement; everything minus that is the
    // first again.
    let [one, two] = ["one.goblin", "two.goblin"].map(|name| directory.name(name));
    command(&["combine", "-q", "a-b", &cases[3].0, a, "-o", &one]).assert().success();
    command(&["combine", "-q", "a-b", &cases[3].0, &one, "-o", &two]).assert().success();
    assert_eq!(json(&["stats", &two, "--json"])["volume"], 64f64.powi(3));
    assert_eq!(stdout(&["point", &one, "1,1,1", "-9,0,0"]), "outside\ninside\n");
}

/// Models built with default options can be combined whatever their sizes, and so can scaled ones,
/// and exported ones that are built again.
#[test]
fn models_built_with_default_options_are_combined() {
    let directory = CubePair::new();
    let scaled = |name: &str, file: &str, factor: &str| {
        let path = directory.name(name);
        command(&["transform", "-q", file, &format!("scale={factor}"), "-o", &path]).assert().success();
        path
    };
    let volume = |operation: &str, files: &[&str], warns: bool| {
        let path = directory.name("result.goblin");
        let words = [&["combine", "-q", operation], files, &["-o", &path]].concat();
        let done = command(&words).assert().success();
        let message = String::from_utf8(done.get_output().stderr.clone()).unwrap();
        assert_eq!(message.contains("moved to a common grid"), warns, "{words:?}: {message}");
        assert_eq!(stdout(&["verify", &path]).trim(), format!("{path}: good"));
        json(&["stats", &path, "--json"])["volume"].as_f64().unwrap()
    };
    let near = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{found} {expected}");
    };
    let unit = directory.built("unit", &cube(0, 1), &["--brep"]);
    let two = directory.built("two", &cube(-1, 1), &["--brep"]);
    near(volume("and", &[&unit, &two], false), 1.0);
    let doubled = scaled("doubled.goblin", &unit, "2");
    near(volume("b-a", &[&unit, &doubled], false), 7.0);
    let inches = scaled("inches.goblin", &unit, "25.4");
    near(volume("b-a", &[&unit, &inches], true), 25.4f64.powi(3) - 1.0);
    let third = scaled("third.goblin", &scaled("seventh.goblin", &unit, "0.142857"), "1.7");
    near(volume("or", &[&unit, &third, &inches, &two], true), 25.4f64.powi(3) + 7.0);
    // Decimal coordinates on a decimal grid, as single-precision STL, next to the model it was
    // exported from.
    let lines = cube(0, 11).replace("11", "1.1");
    let decimal = directory.built("decimal", &lines, &["--brep", "--snap", "0.1"]);
    let stl = directory.name("decimal.stl");
    command(&["export", "-q", &decimal, &stl]).assert().success();
    let again = directory.name("again.goblin");
    command(&["build", "-q", &stl, "--brep", "-o", &again]).assert().success();
    near(volume("and", &[&decimal, &again], false), 1.1f64.powi(3));
    near(volume("xor", &[&again, &decimal], false), 0.0);
}

/// Tiles of one city, built separately, with the grids of their files.
#[test]
fn tiles_of_a_city_are_combined() {
    let directory = CubePair::new();
    let tile = |name: &str, scale: &str, at: i32, side: i32| {
        let corner = |i: i32| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| bit * side);
        let vertices: Vec<String> =
            (0..8).map(corner).map(|[x, y, z]| format!("[{},{y},{z}]", x + at)).collect();
        let text = format!(
            r#"{{"type":"CityJSON","version":"2.0","transform":{{"scale":[{scale},{scale},{scale}],"translate":[84710.5,445000.25,0]}},
            "CityObjects":{{"{name}":{{"type":"Building","geometry":[{{"type":"Solid","lod":"2","boundaries":[[
            [[0,2,3,1]],[[4,5,7,6]],[[0,1,5,4]],[[2,6,7,3]],[[0,4,6,2]],[[1,3,7,5]]]]}}]}}}},
            "vertices":[{}]}}"#,
            vertices.join(",")
        );
        let [city, file] = ["city.json", "goblin"].map(|end| directory.name(&format!("{name}.{end}")));
        std::fs::write(&city, text).unwrap();
        command(&["build", "-q", &city, "--brep", "-o", &file]).assert().success();
        file
    };
    let tiles = [
        tile("a", "0.001", 0, 1000),
        // 90 km away, in millimetres; and in units of 0.01 and 0.0007.
        tile("b", "0.001", 90_000_000, 1000),
        tile("c", "0.01", 300, 100),
        tile("d", "0.0007", -3000, 1000),
    ];
    let path = directory.name("city.goblin");
    let files: Vec<&str> = tiles.iter().map(String::as_str).collect();
    let words = [&["combine", "-q", "or"], &files[..], &["-o", &path]].concat();
    command(&words).assert().success();
    assert_eq!(stdout(&["verify", &path]).trim(), format!("{path}: good"));
    let volume = json(&["stats", &path, "--json"])["volume"].as_f64().unwrap();
    assert!((volume - 3.343).abs() < 0.02, "{volume}");
}

/// Where a result is thinner than a grid unit, mending its surface on the grid must not lose a
/// body: rounding pushes a sample of the thin body's neighbour to the other side of a face.
#[test]
fn mending_keeps_every_body() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let bodies = "OFF\n20 18 0\n0 200 100\n970 50 217\n970 350 217\n970 200 60\n315 180 138\n\
         663 180 180\n663 220 180\n315 220 138\n315 180 288\n663 180 330\n663 220 330\n\
         315 220 288\n0 600 100\n970 450 217\n970 750 217\n970 600 60\n315 600 138\n\
         905 540 210\n905 660 210\n905 600 360\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n\
         4 4 7 6 5\n4 8 9 10 11\n4 4 5 9 8\n4 6 7 11 10\n4 4 8 11 7\n4 5 6 10 9\n3 12 13 14\n\
         3 12 15 13\n3 12 14 15\n3 13 15 14\n3 16 18 17\n3 16 17 19\n3 16 19 18\n3 17 18 19\n";
    let side = "OFF\n8 6 0\n900 0 0\n1000 0 0\n900 800 0\n1000 800 0\n900 0 900\n1000 0 900\n\
         900 800 900\n1000 800 900\n4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n\
         4 1 3 7 5\n";
    for (name, text) in [("bodies", bodies), ("side", side)] {
        let mesh = at(&format!("{name}.off"));
        std::fs::write(&mesh, text).unwrap();
        let model = at(&format!("{name}.goblin"));
        command(&["build", "-q", &mesh, "-o", &model, "--brep", "--snap", "1"]).assert().success();
    }
    let result = at("result.goblin");
    command(&["combine", "-q", "a-b", &at("bodies.goblin"), &at("side.goblin"), "-o", &result])
        .assert()
        .success();
    for model in [&at("bodies.goblin"), &result] {
        assert_eq!(stdout(&["point", model, "850,200,135"]), "inside\n");
    }
}

/// A tetrahedron as a mesh file, with a corner at a point.
fn tetrahedron([x, y, z]: [i32; 3], size: i32) -> String {
    let corners = [[0, 0, 0], [size, 1, 2], [2, size, 1], [1, 2, size]];
    let lines = corners.map(|[u, v, w]| format!("{} {} {}\n", x + u, y + v, z + w)).concat();
    format!("OFF\n4 4 0\n{lines}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
}

/// A chain of operations, a process each: the bytes do not depend on threads and memory, and an
/// operation that a full disk stops leaves the last result and no other file.
#[test]
#[cfg(unix)]
fn chains_of_operations_from_file_to_file() {
    use std::process::Command;

    const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");

    let pair = CubePair::new();
    let (whole, new, other) = (pair.name("whole.goblin"), pair.name("new.goblin"), pair.name("tool.goblin"));
    std::fs::copy(&pair.a, &whole).unwrap();
    for step in 0..10 {
        let at = [step * 17 % 50 - 4, step * 29 % 50 - 4, step * 37 % 50 - 4];
        pair.built("tool", &tetrahedron(at, 20 + step), &["--brep", "--snap", "1"]);
        let operation = if step % 3 == 2 { "or" } else { "a-b" };
        let run = |target: &str, options: &[&str]| {
            let words = ["combine", "-q", operation, &whole, &other, "-o", target];
            command(&words).args(options).assert().success();
            std::fs::read(target).unwrap()
        };
        let bytes = run(&new, &[]);
        for options in [["--threads", "1"], ["--threads", "4"], ["--memory", "16M"]] {
            assert!(run(&new, &options) == bytes, "{step}: {options:?}");
        }
        let names = || {
            let entries = std::fs::read_dir(pair.directory.root()).unwrap();
            let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            names
        };
        let (before, last) = (names(), std::fs::read(&whole).unwrap());
        // (Limits are in blocks of 512 or 1024 bytes.)
        for blocks in [0, 1] {
            let limited = format!("ulimit -f {blocks}; exec \"$@\"");
            let words = ["combine", "-q", operation, &whole, &other, "-o", &new];
            let run = Command::new("sh").args(["-c", &limited, "sh", PROGRAM]).args(words).output().unwrap();
            assert_eq!(run.status.code(), Some(1), "{step}: {}", String::from_utf8_lossy(&run.stderr));
            let files = [&whole, &new].map(|file| std::fs::read(file).unwrap());
            assert!(names() == before && files == [last.clone(), bytes.clone()], "{step}");
        }
        std::fs::rename(&new, &whole).unwrap();
    }
    assert!(stdout(&["verify", &whole]).contains("good"));
}
