//! Euler operators and local changes on the command line.

use std::fs;

use serde_json::Value as Json;

use crate::common::Random;
use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::directory::TestDirectory;

/// A cube of side 10.
const CUBE: &str = "\
mvfs v1 f1 0 0 0; mev v1 v2 e1 10 0 0; mev v2 v3 e2 10 10 0; mev v3 v4 e3 0 10 0; mef v1 v4 e4 f2
mev v1@f2 v5 e5 0 0 10; mev v2@f2 v6 e6 10 0 10; mev v3@f2 v7 e7 10 10 10; mev v4@f2 v8 e8 0 10 10
mef v5 v6 e9 f3; mef v6 v7 e10 f4; mef v7 v8 e11 f5; mef v8 v5 e12 f6
";

fn cube(directory: &TestDirectory) -> String {
    let text = directory.write("cube.euler", CUBE);
    directory.built(&text, "cube.goblin", &["--brep", "--snap", "0.5"])
}

fn stats(file: &str) -> Json {
    serde_json::from_str(&stdout(&["stats", file, "--topology", "--json"])).unwrap()
}

fn volume(file: &str) -> f64 {
    command(&["verify", "-q", file]).assert().success();
    stats(file)["volume"].as_f64().unwrap()
}

/// Returns the faces that differ between two models of equal volume: none if they are equal.
fn difference(directory: &TestDirectory, a: &str, b: &str) -> u64 {
    let output = directory.name("difference.goblin");
    command(&["combine", "-q", "xor", a, b, "-o", &output]).assert().success();
    let info: Json = serde_json::from_str(&stdout(&["info", &output, "--json"])).unwrap();
    info["faces"].as_u64().unwrap()
}

#[test]
fn dumps_build_the_same_model() {
    let directory = TestDirectory::new();
    let csg = |name: &str, text: &str| directory.write(name, text);
    // (A torus of facets, a cavity, a face with two holes and bodies that touch along an edge.)
    let inputs = [
        ("fixtures/hole.euler".to_owned(), &[][..], 1),
        ("fixtures/concave.euler".to_owned(), &["--snap", "0.25"], 1),
        (csg("ring.csg", "unit(mm); torus(0,0,0, 0,0,1, 5, 2)"), &["--deviation", "0.3"], 1),
        (csg("hollow.csg", "difference(block(0,0,0, 9,9,9), block(3,3,3, 6,6,6))"), &[], 2),
        (
            csg(
                "grille.csg",
                "difference(block(0,0,0, 9,9,9), block(1,1,-1, 3,3,10), block(5,1,-1, 7,3,10), block(-1,5,5, 10,7,7))",
            ),
            &["--snap", "1"],
            1,
        ),
        (csg("pair.csg", "block(0,0,0, 2,2,2); block(2,2,0, 4,4,2);"), &["--snap", "1"], 2),
    ];
    for (input, options, shells) in inputs {
        let model = directory.built(&input, "model.goblin", &[&["--brep"], options].concat());
        let text = stdout(&["dump", &model, "--as", "euler"]);
        let again = directory.built(&directory.write("again.euler", &text), "again.goblin", &["--brep"]);
        let (one, other) = (stats(&model), stats(&again));
        for key in ["volume", "topology", "unit"] {
            assert_eq!(one[key], other[key], "{input}: {key}\n{text}");
        }
        assert_eq!(one["topology"]["shells"], shells, "{input}");
        assert_eq!(difference(&directory, &model, &again), 0, "{input}");
        // Names are stable, so a dump of the dump has as many lines.
        assert_eq!(stdout(&["dump", &again, "--as", "euler"]).lines().count(), text.lines().count());
        let is_operator = |line: &&str| !["unit", "step", "part"].iter().any(|word| line.starts_with(word));
        let limit = (text.lines().filter(is_operator).count() - 1).to_string();
        let message = complaint(&["dump", &model, "--as", "euler", "--limit", &limit], 1);
        assert!(message.contains("--limit"), "{message}");
    }
}

#[test]
fn edits_replace_the_model() {
    let directory = TestDirectory::new();
    let file = cube(&directory);
    let original = fs::read(&file).unwrap();
    // The upper face becomes a roof: a ridge point above its diagonal.
    let roof = "mef v1@f6 v7@f6 e12 f6";
    let message = complaint(&["edit", &file, "euler", roof], 1);
    assert!(message.contains("line 1: got f6, expected a name that an operator gave before"), "{message}");
    let roof = "mef v1 v7 e12 f6; semv e12 v7 v8 e13 5 5 13\nmef v8 v5 e14 f7; mef v8 v3 e15 f8";
    let changes = directory.write("roof.euler", roof);
    let other = directory.name("other.goblin");
    let message = stderr(command(&["edit", &file, "euler", &changes, "-o", &other]).assert().success());
    assert!(message.contains("V 9 - E 16 + F 9 - R 0 = 2 (S 1 - G 0)"), "{message}");
    assert_eq!(fs::read(&file).unwrap(), original);
    assert_eq!(volume(&other), 1000.0 + 100.0 * 3.0 / 3.0);
    command(&["edit", "-q", &file, "euler", roof]).assert().success().stderr("");
    assert_eq!(volume(&file), 1100.0);
    // The last operator of a dump is the first to be undone; the face without its edge is bent.
    let text = stdout(&["dump", &file, "--as", "euler"]);
    assert_eq!(text.lines().count(), 1 + 1 + 16, "{text}");
    let last = text.lines().last().unwrap().split(' ').skip(3).collect::<Vec<_>>();
    let bent = format!("kef {}", last.join(" "));
    // Refused edits leave the file as it is.
    let now = fs::read(&file).unwrap();
    for (operators, expected) in [
        (bent.as_str(), "not in one plane"),
        ("mvfs v90 f90 9 9 9", "a ring of 1 vertices"),
        ("kev e0 v0", "expected"),
        ("kfmrh f0 f1 r99", "expected"),
        ("unit mm", "expected an operator"),
        ("mvfs v90 f90 1e300 0 0", "a point near the model"),
        ("# nothing", "no operators"),
    ] {
        let found = complaint(&["edit", &file, "euler", operators], 1);
        assert!(found.contains(expected), "{operators}: {found}");
        assert_eq!(fs::read(&file).unwrap(), now, "{operators}");
    }
    let message = complaint(&["edit", "fixtures/v1/classic.goblin", "euler", "kef e0 f1"], 1);
    assert!(message.contains("is not an exact model"), "{message}");
    assert_eq!(directory.files(), ["cube.euler", "cube.goblin", "other.goblin", "roof.euler"]);
}

#[test]
fn edits_keep_objects() {
    let directory = TestDirectory::new();
    let text = format!("unit m\n{CUBE}part f2 the roof\npart f3 wall\n");
    let file = directory.built(
        &directory.write("house.euler", text),
        "house.goblin",
        &["--brep", "--snap", "1", "--crs", "EPSG:25832"],
    );
    let dump = |file: &str| stdout(&["dump", file, "--as", "euler", "-q"]);
    let count = |text: &str, name: &str| {
        text.lines().filter(|line| line.starts_with("part") && line.ends_with(name)).count()
    };
    let before = dump(&file);
    assert_eq!([count(&before, " the roof"), count(&before, " wall")], [5, 1], "{before}");
    // A diagonal of the roof: both halves are of it.
    command(&["edit", "-q", &file, "euler", "mef v1@f99 v7 e99 f99"]).assert().code(1);
    command(&["edit", "-q", &file, "euler", "mef v1 v7 e12 f6"]).assert().success();
    let after = dump(&file);
    assert_eq!([count(&after, " the roof"), count(&after, " wall")], [6, 1], "{after}");
    let info = stdout(&["info", &file]);
    assert!(info.contains("unit = m") && info.contains("25832"), "{info}");
    let warning = stderr(command(&["dump", &file, "--as", "euler"]).assert().success());
    assert!(warning.contains("the operators lack the coordinate system"), "{warning}");
}

#[test]
fn local_changes_have_the_volumes_of_formulas() {
    let directory = TestDirectory::new();
    let file = cube(&directory);
    let concave = directory.built("fixtures/concave.euler", "concave.goblin", &["--brep", "--snap", "0.5"]);
    let pyramid =
        "mvfs v1 f1 0 0 0; mev v1 v2 e1 6 0 0; mev v2 v3 e2 6 6 0; mev v3 v4 e3 0 6 0; mef v1 v4 e4 f2
        mev v1@f2 v5 e5 3 3 4; mef v5 v2 e6 f3; mef v5 v3 e7 f4; mef v5 v4 e8 f5";
    let pyramid = directory.built(
        &directory.write("pyramid.euler", pyramid),
        "pyramid.goblin",
        &["--brep", "--snap", "0.5"],
    );
    let output = directory.name("output.goblin");
    let moved = |file: &str, changes: &[&str]| {
        command(&[&["transform", "-q", file, "-o", &output], changes].concat()).assert().success().stderr("");
        volume(&output)
    };
    // A moved face of a prism, also sideways, below the grid, and in two steps.
    assert_eq!(moved(&file, &["move-face=5,5,10,0,0,2.5"]), 1250.0);
    assert_eq!(moved(&file, &["move-face=5,5,10,3,-4,0"]), 1000.0);
    assert_eq!(moved(&file, &["move-face=0,5,5,-5,0,0", "move-face=-5,5,5,-1,0,0"]), 1600.0);
    // A moved edge: half a prism more.
    assert_eq!(moved(&file, &["move-edge=10,5,10,0,0,3"]), 1000.0 + 10.0 * 10.0 * 3.0 / 2.0);
    // A moved apex: a third of base and height.
    assert_eq!(moved(&pyramid, &["move-vertex=3,3,4,7,-2,5"]), 36.0 * 9.0 / 3.0);
    // Chamfers: a prism less at a convex edge, or more at a concave one.
    assert_eq!(moved(&file, &["chamfer=10,5,10,-1,0,-1"]), 1000.0 - 10.0 * 2.0 * 2.0 / 2.0);
    assert_eq!(moved(&file, &["chamfer=10,5,10,-1,0,-2"]), 1000.0 - 10.0 * 5.0 * 2.5 / 2.0);
    let opposite = ["chamfer=10,5,10,-1,0,-1", "chamfer=0,5,0,1.5,0,1.5"];
    assert_eq!(moved(&file, &opposite), 1000.0 - 10.0 * (2.0 * 2.0 + 3.0 * 3.0) / 2.0);
    let full = (80.0 * 30.0 + 30.0 * 30.0) * 40.0;
    assert_eq!(moved(&concave, &["chamfer=30,30,20,2,2,0"]), full + 40.0 * 4.0 * 4.0 / 2.0);
    // A vertex of the pyramid's base has four edges at none of its ends: the apex has.
    assert_eq!(stats(&output)["topology"]["genus"], 0);
    fs::remove_file(&output).unwrap();
    for (file, change, expected) in [
        (&file, "move-vertex=10,10,10,0,0,2", "not in one plane"),
        (&file, "move-vertex=10,10,9,0,0,2", "the nearest is at 10, 10, 10"),
        (&file, "move-face=5,5,10,0,0,-20", "not a solid"),
        (&file, "move-face=50,5,10,0,0,2", "no face"),
        (&file, "move-face=10,5,10,0,0,2", "expected a position inside one face"),
        (&file, "move-edge=10,10,10,0,0,2", "3 edges there"),
        (&file, "chamfer=10,5,10,-1,1,-1", "perpendicular"),
        (&file, "chamfer=10,5,10,-5,0,-5", "before its end"),
        (&file, "chamfer=10,5,10,1,0,1", "before its end"),
        (&pyramid, "chamfer=3,0,0,-1,0.5,1", "perpendicular"),
        (&pyramid, "chamfer=3,0,0,0,0.5,0.5", "off the grid"),
        (&file, "move-face=5,5,10,0,0,1e30", "shorter"),
        (&file, "move-face=5,5,10,0,0,1e9", "2^26"),
        (&file, "move-face=5,5,10,0,0,0.001", "the grid's unit"),
    ] {
        let message = complaint(&["transform", file, change, "-o", &output], 1);
        assert!(message.contains(expected), "{change}: {message}");
    }
    for change in ["move-face=1,2,3", "move-face=1,2,3,4,5,nan", "move-edge=", "chamfer=a,b,c,d,e,f"] {
        let message = complaint(&["transform", &file, change, "-o", &output], 2);
        assert!(message.contains("X,Y,Z,DX,DY,DZ"), "{message}");
    }
    let message = complaint(&["transform", &file, "move-face=5,5,10,0,0,1", "scale=2", "-o", &output], 1);
    assert!(message.contains("other operations"), "{message}");
    let message =
        complaint(&["transform", "fixtures/v1/classic.goblin", "move-face=5,5,10,0,0,1", "-o", &output], 1);
    assert!(message.contains("is not an exact model"), "{message}");
    assert!(!fs::exists(&output).unwrap());
}

/// Vertices of an octahedron are moved, and the volume is that of tetrahedra over its triangles.
#[test]
fn moved_vertices_of_triangles_are_those_of_a_list() {
    let directory = TestDirectory::new();
    let mut points: [[i64; 3]; 6] =
        [[40, 20, 20], [0, 20, 20], [20, 40, 20], [20, 0, 20], [20, 20, 40], [20, 20, 0]];
    let triangles = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let mut text = "OFF\n6 8 0\n".to_owned();
    points.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    let file = directory.built(
        &directory.write("octahedron.off", text),
        "octahedron.goblin",
        &["--brep", "--snap", "1"],
    );
    let mut random = Random(7);
    let mut changes = Vec::new();
    for _ in 0..24 {
        let vertex = random.below(6) as usize;
        let by = [0; 3].map(|_| random.below(5) as i64 - 2);
        let [x, y, z] = points[vertex];
        if by == [0; 3] {
            continue;
        }
        changes.push(format!("move-vertex={x},{y},{z},{},{},{}", by[0], by[1], by[2]));
        (0..3).for_each(|axis| points[vertex][axis] += by[axis]);
    }
    let six: i64 = triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|corner: usize| points[corner]);
            a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        })
        .sum();
    let output = directory.name("moved.goblin");
    let changes: Vec<&str> = changes.iter().map(String::as_str).collect();
    command(&[&["transform", "-q", &file, "-o", &output], &changes[..]].concat()).assert().success();
    assert!((volume(&output) - six as f64 / 6.0).abs() < 1e-9);
}

#[test]
fn wrong_operators_are_refused() {
    let directory = TestDirectory::new();
    let output = directory.name("output.goblin");
    let refuse = |text: &[u8], expected: &str| {
        let file = directory.write("wrong.euler", text);
        let message = complaint(&["build", &file, "-o", &output, "--brep"], 1);
        assert!(message.contains(expected), "{}: {message}", text.escape_ascii());
        assert!(message.contains("wrong.euler"), "{message}");
    };
    for (text, expected) in [
        ("mvfs v1 f1 1e400 0 0", "line 1: got 1e400, expected a finite number"),
        ("\n\nmvfs v1 f1 0 0 nan", "line 3: got nan"),
        ("mev v9 v1 e1 0 0 0", "got v9, expected a name that an operator gave before"),
        (
            "mvfs v1 f1 0 0 0\nkvfs v1 f1\nmev v1 v2 e1 0 0 0",
            "line 3: got v1, expected a name that is in use: line 2 killed v1",
        ),
        ("mvfs v1 f1 0 0 0; mvfs v1 f2 0 0 0", "expected a new name"),
        ("foo", "got foo, expected mvfs, kvfs"),
        ("mvfs v1 f1", "`mvfs VERTEX FACE X Y Z`"),
        ("mvfs v1 f1 0 0 0 0 0 0 0 0 0 0 0", "`mvfs VERTEX FACE X Y Z`"),
        ("mvfs v99999999999 f1 0 0 0", "a vertex, such as v4"),
        ("mvfs v01 f1 0 0 0", "a vertex, such as v4"),
        (
            "mvfs v1 f1 0 0 0; mev v1 v2 e1 1 0 0; mev v1 v3 e2 0 1 0; mev v1 v4 e3 0 0 1",
            "v1@FACE or v1:EDGE, such as v1:e",
        ),
        ("mvfs v1 f1 0 0 0; mev v1 v2 e1 1 0 0", "a face f1 with a ring of 2 vertices"),
        ("mvfs v1 f1 0 0 0; mev v1 v2 e1 1 0 0; kef e1 f1", "expected an edge with another face"),
        ("mvfs v1 f1 0 0 0; mev v1 v2 e1 1 0 0; jekv v1 e1", "expected a vertex of two edges"),
        ("mvfs v1 f1 0 0 0; mvfs v2 f2 1 0 0; kfmrh f1 f2 r1", "ksfmr joins those of two"),
        ("mvfs v1 f1 0 0 0; mvfs v2 f2 1 0 0; ksfmr f1 f2 r1; mfkrh r1 f3", "msfkr divides a shell"),
        ("# nothing", "no vertices"),
        ("unit furlong", "mm, cm, m, km, in or ft"),
        ("step -1", "a width above zero"),
        ("part f1 roof", "a name that an operator gave before"),
        ("mvfs v1 f1 0 0 \0", "got \\0, expected a finite number"),
    ] {
        refuse(text.as_bytes(), expected);
    }
    refuse(b"\xff\xfe", "UTF-8");
    // A long text stays within the memory.
    let mut long = "mvfs v0 f0 0 0 0\n".to_owned();
    (1..40_000).for_each(|i| long += &format!("mev v{} v{i} e{i} {i} 0 0\n", i - 1));
    let file = directory.write("long.euler", long);
    let message = complaint(&["build", &file, "-o", &output, "--brep", "--memory", "16M"], 1);
    assert!(message.contains("long.euler") && message.contains("--memory"), "{message}");
    assert!(!fs::exists(&output).unwrap());
}
