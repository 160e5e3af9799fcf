//! Set operations on exact models on the command line.

use std::path::Path;

use serde_json::Value as Json;
use tempfile::TempDir;

use crate::common::command::{command, complaint, stderr, stdout};

/// Two cubes with sides of 64 that have one of 32 in common, and one of their own.
struct Folder {
    folder: TempDir,
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

impl Folder {
    fn new() -> Folder {
        let mut made = Folder { folder: tempfile::tempdir().unwrap(), a: String::new(), b: String::new() };
        made.a = made.built("a", &cube(0, 64), &["--brep", "--snap", "1"]);
        made.b = made.built("b", &cube(32, 96), &["--brep", "--snap", "1"]);
        made
    }

    fn name(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().into()
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
    let folder = Folder::new();
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
            .map(|operation| folder.combined(operation, &format!("{number}-{}.goblin", operation.len())));
        let bytes = files.each_ref().map(|file| std::fs::read(file).unwrap());
        assert!(bytes[0] == bytes[1], "{name}");
        assert_eq!(json(&["stats", &files[0], "--json"])["volume"], volume, "{name}");
    }
    assert_eq!(
        std::fs::read(folder.combined("union", "u.goblin")).unwrap(),
        std::fs::read(folder.combined("7", "v.goblin")).unwrap()
    );
    // Of one file, and of three.
    let c = folder.built("c", &cube(90, 100), &["--brep", "--snap", "1"]);
    let file = folder.name("many.goblin");
    let told = stderr(command(&["combine", "or", &folder.a, &folder.b, &c, "-o", &file]).assert().success());
    assert!(told.contains("faces divided") && told.contains("result"), "{told}");
    assert_eq!(json(&["stats", &file, "--json"])["volume"], 2.0 * side - common + 1000.0 - 216.0);
    let told = stderr(command(&["combine", "not", &folder.a, "-o", &file]).assert().success());
    assert!(told.contains("far away"), "{told}");
}

#[test]
fn what_means_nothing_is_refused() {
    let folder = Folder::new();
    let (a, b, never) = (&folder.a, &folder.b, folder.name("never.goblin"));
    let cells = folder.built("cells", &cube(0, 64), &["--cells", "16"]);
    let refuse = |arguments: &[&str]| {
        let told = complaint(&[&["combine"], arguments, &["-o", &never]].concat(), 1);
        assert!(!Path::new(&never).exists());
        told
    };
    // Cells and exact models.
    for files in [[a, &cells], [&cells, a]] {
        let told = refuse(&["union", files[0], files[1]]);
        assert!(
            told.contains("cells.goblin: ") && told.contains("--brep") && told.contains("spinney build"),
            "{told}"
        );
    }
    for options in [&["--values", "b"][..], &["--fill", "3"]] {
        let told = refuse(&[&["union", a, b], options].concat());
        assert!(told.contains(&format!("{} means nothing", options[0])), "{told}");
    }
    for options in [["--within", "0,0,0,9,9,9"], ["--margin", "4"]] {
        assert!(
            refuse(&[&["nor", a, b], &options[..]].concat()).contains("--within or --margin means nothing")
        );
    }
    for operation in ["over", "min", "max", "add", "subtract", "equal", "changed"] {
        let told = refuse(&[operation, a, b]);
        assert!(told.contains("no values") && told.contains("set operations"), "{operation}: {told}");
    }
    assert!(complaint(&["combine", "cross", a, b], 1).contains("exact model"));
    for files in
        [&["union", a][..], &["a-b", a], &["and", a], &["b", a, b, a], &["b-a", a, b, a], &["not", a, b, a]]
    {
        let told = refuse(files);
        assert!(told.contains("bodies") || told.contains("files") || told.contains("body"), "{told}");
    }
    complaint(&["combine", "16", a, b, "-o", &never], 2);
    complaint(&["combine", "union", a, &folder.name("none.goblin"), "-o", &never], 1);
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
fn questions_to_results() {
    let folder = Folder::new();
    let (a, never) = (&folder.a, folder.name("none.goblin"));
    command(&["combine", "-q", "a-b", a, a, "-o", &never]).assert().success();
    let cases = [
        (folder.combined("or", "or.goblin"), "inside\ninside\noutside\noutside\n", 12, false),
        (folder.combined("nor", "nor.goblin"), "outside\noutside\ninside\ninside\n", 12, true),
        (never, "outside\noutside\noutside\noutside\n", 0, false),
        (folder.combined("all", "all.goblin"), "inside\ninside\ninside\ninside\n", 0, true),
    ];
    for (file, places, faces, is_unbounded) in &cases {
        assert_eq!(stdout(&["point", file, "1,1,1", "90,90,90", "90,1,1", "1e6,0,0"]), *places, "{file}");
        command(&["verify", file]).assert().success();
        let stats = json(&["stats", file, "--json"]);
        assert_eq!(stats["volume"].as_f64().unwrap() < 0.0, *is_unbounded && *faces > 0, "{stats}");
        assert_eq!(stats["topology"]["faces"], *faces, "{stats}");
        let texts = [
            stdout(&["stats", file]),
            stdout(&["info", file]),
            stdout(&["info", file, "--json"]),
            stdout(&["find", file, "--leaf", "void,full,face,edge,vertex,boolean"]),
            stats.to_string(),
        ];
        for text in &texts {
            let is_odd = ["NaN", "inf\n", "inf ", "-0 ", "1844674407370955", "null,null"]
                .iter()
                .find(|odd| text.contains(*odd));
            assert!(is_odd.is_none() && !text.is_empty(), "{file}: {is_odd:?} in {text}");
        }
        assert!(
            !is_unbounded || texts[1].contains("far away") || texts[1].contains("unbounded"),
            "{}",
            texts[1]
        );
        // Meshes need a surface, and therefore a solid; an empty set is not a valid mesh file.
        for format in ["ply", "stl", "obj", "off", "city.json"] {
            let mesh = folder.name(&format!("out.{format}"));
            let run = command(&["export", file, &mesh]).assert();
            let code = run.get_output().status.code().unwrap();
            let told = stderr(run);
            assert!(code <= 1 && !told.contains("panicked"), "{format}: {told}");
            assert_eq!(code == 0, Path::new(&mesh).exists(), "{format}: {told}");
            assert!(code == 0 || *faces == 0 || *is_unbounded, "{format}: {told}");
            let _ = std::fs::remove_file(mesh);
        }
        for words in [
            vec!["render", file.as_str(), "--size", "20x20"],
            vec!["build", file.as_str(), "--cells", "8", "-o"],
        ] {
            let out = folder.name(if words[0] == "render" { "out.png" } else { "out.goblin" });
            let run = command(&words).arg(&out).assert();
            let code = run.get_output().status.code().unwrap();
            let told = stderr(run);
            assert!(code <= 1 && !told.contains("panicked"), "{words:?}: {told}");
        }
    }
    // They are operands again: everything minus one is its complement; everything minus that is the
    // first again.
    let [one, two] = ["one.goblin", "two.goblin"].map(|name| folder.name(name));
    command(&["combine", "-q", "a-b", &cases[3].0, a, "-o", &one]).assert().success();
    command(&["combine", "-q", "a-b", &cases[3].0, &one, "-o", &two]).assert().success();
    assert_eq!(json(&["stats", &two, "--json"])["volume"], 64f64.powi(3));
    assert_eq!(stdout(&["point", &one, "1,1,1", "-9,0,0"]), "outside\ninside\n");
}

/// Models built with default options can be combined whatever their sizes, and so can scaled ones,
/// and exported ones that are built again.
#[test]
fn models_built_with_default_options_are_combined() {
    let folder = Folder::new();
    let scaled = |name: &str, file: &str, factor: &str| {
        let path = folder.name(name);
        command(&["transform", "-q", file, &format!("scale={factor}"), "-o", &path]).assert().success();
        path
    };
    let volume = |operation: &str, files: &[&str], warns: bool| {
        let path = folder.name("result.goblin");
        let words = [&["combine", "-q", operation], files, &["-o", &path]].concat();
        let done = command(&words).assert().success();
        let told = String::from_utf8(done.get_output().stderr.clone()).unwrap();
        assert_eq!(told.contains("moved to a common grid"), warns, "{words:?}: {told}");
        assert_eq!(stdout(&["verify", &path]).trim(), format!("{path}: good"));
        json(&["stats", &path, "--json"])["volume"].as_f64().unwrap()
    };
    let near = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{found} {expected}");
    };
    let unit = folder.built("unit", &cube(0, 1), &["--brep"]);
    let two = folder.built("two", &cube(-1, 1), &["--brep"]);
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
    let decimal = folder.built("decimal", &lines, &["--brep", "--snap", "0.1"]);
    let stl = folder.name("decimal.stl");
    command(&["export", "-q", &decimal, &stl]).assert().success();
    let again = folder.name("again.goblin");
    command(&["build", "-q", &stl, "--brep", "-o", &again]).assert().success();
    near(volume("and", &[&decimal, &again], false), 1.1f64.powi(3));
    near(volume("xor", &[&again, &decimal], false), 0.0);
}

/// Tiles of one city, built separately, with the grids of their files.
#[test]
fn tiles_of_a_city_are_combined() {
    let folder = Folder::new();
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
        let [city, file] = ["city.json", "goblin"].map(|end| folder.name(&format!("{name}.{end}")));
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
    let path = folder.name("city.goblin");
    let files: Vec<&str> = tiles.iter().map(String::as_str).collect();
    let words = [&["combine", "-q", "or"], &files[..], &["-o", &path]].concat();
    command(&words).assert().success();
    assert_eq!(stdout(&["verify", &path]).trim(), format!("{path}: good"));
    let volume = json(&["stats", &path, "--json"])["volume"].as_f64().unwrap();
    assert!((volume - 3.343).abs() < 0.02, "{volume}");
}
