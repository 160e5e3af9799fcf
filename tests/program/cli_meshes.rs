//! `spinney build` of models, from the user's side.

use std::path::Path;

use crate::common::command::{peak_memory, spinney, stderr, stdout};

/// A box of 4 x 2 x 1, as an OBJ file of polygons.
const BOX: &str = "\
o plate
v 0 0 0\nv 4 0 0\nv 4 2 0\nv 0 2 0\nv 0 0 1\nv 4 0 1\nv 4 2 1\nv 0 2 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 1 5 8 4\nf 2 3 7 6
";

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_model_becomes_a_solid_and_comes_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (model, tree) = (at("plate.obj"), at("plate.goblin"));
    std::fs::write(&model, BOX).unwrap();
    let said =
        stderr(spinney(&["build", text(&model), "-o", text(&tree), "--cells", "16", "--stats"]).success());
    for part in ["16 x 8 x 4 in a tree of depth 4, each 0.25 wide", "closed", "6 read, 12 triangles"] {
        assert!(said.contains(part), "{said}");
    }
    let stats = stdout(&["stats", text(&tree), "--json"]);
    let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
    assert_eq!(stats["cells"], 16 * 8 * 4);
    assert!(stdout(&["verify", text(&tree)]).contains("good"));
    assert_eq!(stdout(&["point", text(&tree), "3.9,1.9,0.9"]).trim(), "255");
    // Exported as a mesh and imported again: the same cells.
    let (mesh, again) = (at("plate.ply"), at("again.goblin"));
    spinney(&["export", text(&tree), text(&mesh)]).success();
    spinney(&["build", text(&mesh), "-o", text(&again), "--grid", text(&tree)]).success();
    assert_eq!(stdout(&["dump", text(&tree), "--codes"]), stdout(&["dump", text(&again), "--codes"]));
}

#[test]
fn losses_of_a_format_are_reported_once() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("plate.obj"), BOX).unwrap();
    let (solid, exact) = (at("solid.goblin"), at("exact.goblin"));
    let placed = ["--unit", "mm", "--crs", "EPSG:28992"];
    spinney(&[&["build", text(&at("plate.obj")), "-o", text(&solid), "--cells", "8"], &placed[..]].concat())
        .success();
    spinney(&[&["build", text(&at("plate.obj")), "-o", text(&exact), "--brep"], &placed[..]].concat())
        .success();
    for (tree, mesh, lost) in [
        (&solid, "a.stl", "the coordinate system EPSG:28992"),
        (&solid, "a.glb", "the coordinate system EPSG:28992"),
        (&exact, "b.ply", "the name of the part"),
        (&exact, "b.obj", "the unit of length mm"),
    ] {
        // Also with --quiet, since it is a warning.
        for quiet in [&[][..], &["--quiet"]] {
            let said = stderr(spinney(&[&["export", text(tree), text(&at(mesh))], quiet].concat()).success());
            let lines: Vec<&str> =
                said.lines().filter(|line| line.contains("the format cannot store")).collect();
            assert!(
                matches!(lines[..], [line] if line.starts_with("warning ") && line.contains(lost)),
                "{said}"
            );
        }
    }
    // CityJSON stores the coordinate system, and coordinates in its unit.
    let city = at("b.city.json");
    let said = stderr(spinney(&["export", text(&exact), text(&city)]).success());
    assert!(!said.contains("unit of length"), "{said}");
    let bounds =
        stderr(spinney(&["build", text(&city), "-o", text(&at("again.goblin")), "--cells", "8"]).success());
    assert!(bounds.contains("each 0.0005") && bounds.contains(" m wide"), "{bounds}");
}

#[test]
fn a_tree_without_cells_is_warned_of() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (model, tree) = (at("triangle.obj"), at("triangle.goblin"));
    std::fs::write(&model, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let said = |more: &[&str]| {
        let words = [&["build", text(&model), "-o", text(&tree), "--cells", "16"], more].concat();
        stderr(spinney(&words).success())
    };
    let warned = said(&[]);
    assert!(warned.contains("warning") && warned.contains("--shell"), "{warned}");
    assert!(!said(&["--shell"]).contains("warning"));
}

#[test]
fn cells_have_units_and_fit_together() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (model, tree) = (at("plate.obj"), at("plate.goblin"));
    std::fs::write(&model, BOX).unwrap();
    let build = |more: &[&str]| {
        let mut words = vec!["build", text(&model), "-o", text(&tree)];
        words.extend(more);
        spinney(&words)
    };
    let said = stderr(build(&["--cell", "5mm", "--unit", "cm"]).success());
    assert!(said.contains("8 x 4 x 2 in a tree of depth 3, each 0.5 cm wide"), "{said}");
    assert!(stderr(build(&["--cell", "5mm"]).failure()).contains("--unit"));
    assert!(stderr(build(&["--cell", "0"]).failure()).contains("a width above zero"));
    assert!(stderr(build(&["--cell", "1e-9"]).failure()).contains("2^19"));
    assert!(stderr(build(&["--cells", "0"]).failure()).contains("1 to 524288"));
    assert!(stderr(build(&["--depth", "20"]).failure()).contains("1 to 19"));
    assert!(
        stderr(build(&["--attribute", "colour"]).failure())
            .contains("the attribute colour for a model without colours")
    );
    assert!(stderr(build(&["--rule", "mean"]).failure()).contains("--rule: works only with rasters"));
    assert!(stderr(build(&["--shell", "--edge", "touch"]).failure()).contains("--edge"));
    let quadtree = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/classic.goblin");
    assert!(stderr(build(&["--grid", quadtree]).failure()).contains("expected an octree"));
    // The output of the one successful build is still complete.
    assert!(stdout(&["verify", text(&tree)]).contains("good"));
    let raster = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
    let refused = spinney(&["build", raster, "-o", text(&tree), "--cells", "4"]).failure();
    let message = stderr(refused);
    assert!(message.contains("is not a model") && message.contains("which --cells needs"), "{message}");
    assert!(message.contains("scale="), "{message}");
    // A model and a raster, in either order.
    for inputs in [[raster, text(&model)], [text(&model), raster]] {
        let message =
            stderr(spinney(&["build", inputs[0], inputs[1], "-o", text(&tree), "--cells", "4"]).failure());
        assert!(message.contains("build one tree for each"), "{message}");
    }
}

#[test]
fn bad_models_are_reported_and_leave_no_files() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let tree = at("x.goblin");
    for (name, content, said) in [
        ("missing.ply", None, "missing.ply"),
        ("empty.ply", Some(""), "empty.ply"),
        ("index.obj", Some("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), "9"),
        ("nan.obj", Some("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "nan"),
        ("none.obj", Some("v 0 0 0\nv 1 0 0\n"), "none.obj"),
        ("flat.obj", Some("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "flat.obj"),
        ("cut.stl", Some("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0"), "cut.stl"),
    ] {
        let path = at(name);
        if let Some(content) = content {
            std::fs::write(&path, content).unwrap();
        }
        let error = stderr(spinney(&["build", text(&path), "-o", text(&tree)]).failure().code(1));
        assert!(error.contains(said), "{name}: {error}");
        assert!(!tree.exists(), "{name}");
    }
    let model = at("own.obj");
    std::fs::write(&model, BOX).unwrap();
    let error = stderr(spinney(&["build", text(&model), "-o", text(&model)]).failure());
    assert!(error.contains("choose another output"), "{error}");
    assert_eq!(std::fs::read_to_string(&model).unwrap(), BOX);
    let left: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().contains("partial")), "{left:?}");
}

#[test]
#[cfg(target_os = "linux")]
fn memory_stays_within_its_budget() {
    /// Allowance in bytes for the program, thread stacks and allocator overhead.
    const ALLOWANCE: u64 = 32 << 20;
    let directory = tempfile::tempdir().unwrap();
    // A ball of 1.2 million triangles, a file of 60 MB that needs 60 MB in memory.
    let steps = 774u32;
    let point = |i: u32, j: u32| {
        let angle = |step: u32| f64::from(step) * std::f64::consts::PI / f64::from(steps);
        // Each pole is one point, and the last meridian is the first.
        let radius = if i.is_multiple_of(steps) { 0.0 } else { angle(i).sin() };
        let (x, y) = (angle(2 * (j % steps)).cos(), angle(2 * (j % steps)).sin());
        [radius * x, radius * y, angle(i).cos()].map(|number| (number * 100.0) as f32)
    };
    let mut bytes = vec![0; 80];
    bytes.extend((2 * steps * steps).to_le_bytes());
    for (i, j) in (0..steps).flat_map(|i| (0..steps).map(move |j| (i, j))) {
        let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
        for corners in [[a, b, c], [a, c, d]] {
            let numbers = [0.0; 3].into_iter().chain(corners.into_iter().flatten());
            bytes.extend(numbers.flat_map(f32::to_le_bytes).chain([0, 0]));
        }
    }
    let model = directory.path().join("ball.stl");
    std::fs::write(&model, bytes).unwrap();
    let (tree, program) = (directory.path().join("ball.goblin"), env!("CARGO_BIN_EXE_spinney"));
    for cells in ["512", "64"] {
        let words = ["build", text(&model), "-qo", text(&tree), "--cells", cells, "--memory", "24M"];
        let mut child = std::process::Command::new(program).args(words).spawn().unwrap();
        let peak = peak_memory(&mut child);
        assert!(peak > 0 && peak < (24 << 20) + ALLOWANCE, "{} MiB at {cells}", peak >> 20);
    }
    let stats: serde_json::Value = serde_json::from_str(&stdout(&["stats", text(&tree), "--json"])).unwrap();
    let volume = 4.0 / 3.0 * std::f64::consts::PI * 100f64.powi(3);
    let found = stats["solid"]["volume"].as_f64().or(stats["volume"].as_f64()).unwrap();
    assert!((found / volume - 1.0).abs() < 5e-3, "{found}, expected {volume}");
}

#[test]
fn export_of_a_volume_without_void_names_the_command_that_makes_zero_void() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    // A plate of 255 in a block of 0.
    let bytes: Vec<u8> = (0..8 * 8 * 8).map(|cell| if cell / 8 % 8 == 3 { 255 } else { 0 }).collect();
    std::fs::write(at("mask.raw"), bytes).unwrap();
    spinney(&["build", &at("mask.raw"), "--raw-size", "8,8,8", "--raw-type", "u8", "-o", &at("mask.goblin")])
        .success();
    let said = stderr(spinney(&["export", &at("mask.goblin"), &at("all.stl")]).success());
    let command = said.split('`').nth(1).unwrap_or_else(|| panic!("{said}"));
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    spinney(&words).success();
    let said = stderr(spinney(&["export", words[words.len() - 1], &at("plate.stl")]).success());
    assert!(!said.contains("void=0"), "{said}");
    assert_eq!(spinney::open(words[words.len() - 1]).unwrap().statistics(None, &()).unwrap().cells, 64);
}
