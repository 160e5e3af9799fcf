//! Solids of primitives: octrees by classification of blocks, set operations on them, and exact
//! models.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use spinney::brep::{Faces, MassProperties};
use spinney::import::mesh::{Resolution, SolidOptions};
use spinney::query::EdgeRule;
use spinney::raw::csg::{Csg, CsgExactOptions, CsgExactReport, CsgImport, import_exact_csg};
use spinney::raw::store::Tag;
use spinney::{Bounds, Dataset, ExactModel, Output};

use crate::common::command::{complaint, spinney, stderr, stdout};

fn csg(text: &str) -> Csg {
    Csg::parse(Path::new("test.csg"), text).unwrap()
}

struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn new() -> TestDirectory {
        TestDirectory(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Returns the octree of an expression.
    fn cells(&self, text: &str, resolution: Resolution, edge: EdgeRule) -> Dataset {
        let mut options = SolidOptions::new();
        (options.resolution, options.edge) = (resolution, edge);
        let path = self.path("cells.goblin");
        CsgImport::plan(csg(text), &options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
        spinney::open(&path).unwrap()
    }

    /// Returns the exact model of an expression.
    fn exact(&self, text: &str, deviation: f64) -> (ExactModel, CsgExactReport) {
        let mut options = CsgExactOptions::new();
        options.deviation = Some(deviation);
        let path = self.path("exact.goblin");
        let report = import_exact_csg(&csg(text), &options, Output::create(&path).unwrap(), &()).unwrap();
        (ExactModel::open(&path, &Default::default()).unwrap(), report)
    }
}

fn volume(tree: &Dataset) -> f64 {
    tree.solid(tree.depth(), &()).unwrap().world_volume()
}

fn volume_of(model: &ExactModel) -> f64 {
    MassProperties::of(model, &()).unwrap().volume
}

/// Returns expressions of primitives, with volume, surface area, and whether they are planar.
fn primitives() -> Vec<(&'static str, f64, f64, bool)> {
    let cone = |low: f64, high: f64, height: f64| {
        let slant = ((high - low).powi(2) + height * height).sqrt();
        let area = PI * (low * low + high * high + (low + high) * slant);
        (PI * height / 3.0 * (low * low + low * high + high * high), area)
    };
    let axis = 3.0f64;
    vec![
        ("block(0,0,0, 2,3,5)", 30.0, 62.0, true),
        ("ball(1,2,3, 1.5)", 4.0 / 3.0 * PI * 3.375, 9.0 * PI, false),
        ("cylinder(1,1,1, 2,3,3, 0.7)", PI * 0.49 * axis, PI * (0.98 + 1.4 * axis), false),
        ("cone(1,1,1, 0.5, 2,3,3, 1.5)", cone(0.5, 1.5, axis).0, cone(0.5, 1.5, axis).1, false),
        ("cone(0,0,0, 1, 2,-2,1, 0)", cone(1.0, 0.0, axis).0, cone(1.0, 0.0, axis).1, false),
        ("torus(0,0,0, 1,2,-2, 2, 0.5)", PI * PI, 4.0 * PI * PI, false),
        ("bounds(0,0,0, 4,4,4); half_space(1,1,0, 4)", 32.0, 72.0, true),
        ("prism([[0,0],[4,0],[4,4],[0,4]], [[1,1],[3,1],[3,3],[1,3]], 1, 3)", 24.0, 72.0, true),
        ("sweep([[0,0],[3,0],[0,3]], 1,2,2)", 9.0, 36.0, true),
        ("revolve([[1,0],[2,0],[2,1],[1,1]], 1,2,3, 1,1,1)", 3.0 * PI, 12.0 * PI, false),
        ("rotate(1,2,3, 40, scale(2, block(0,0,0, 1,1,1)))", 8.0, 24.0, true),
    ]
}

/// Cells with their centre inside: the volume error is at most half of the cells that the surface
/// cuts, and in practice a small fraction of it, which decreases with cell size.
#[test]
fn volumes_of_primitives() {
    let directory = TestDirectory::new();
    for (text, exact, area, _) in primitives() {
        let mut errors = Vec::new();
        for depth in [4, 6, 8] {
            let tree = directory.cells(text, Resolution::Depth(depth), EdgeRule::Centre);
            let cell = tree.metadata().frame.linear().col(0).length();
            let error = (volume(&tree) - exact).abs();
            assert!(error < 0.25 * area * cell, "{text} at {depth}: off by {error} of {exact}");
            errors.push(error / exact);
        }
        for depth in [3, 4, 5] {
            let tree = directory.cells(text, Resolution::Depth(depth), EdgeRule::Area);
            let cell = tree.metadata().frame.linear().col(0).length();
            let error = (volume(&tree) - exact).abs();
            // A cell has one of 255 values.
            assert!(error < 0.05 * area * cell, "{text} at {depth}: off by {error} of {exact}, by area");
        }
        assert!(errors[2] <= errors[0].max(1e-3) && errors[2] < 0.01, "{text}: {errors:?}");
    }
}

/// Octrees of FULL, VOID and MIXED nodes on one grid: combining them cell by cell gives the octree
/// of the expression.
#[test]
fn item_43_set_operations_by_nodes() {
    let (one, other) = ("ball(3,3,3, 2.5)", "union(block(2,2,0, 6,4,5), torus(3,3,3, 1,1,1, 2, 0.6))");
    let directory = TestDirectory::new();
    let build = |name: &str, text: &str| {
        let [csg, tree] = [directory.path(&format!("{name}.csg")), directory.path(&format!("{name}.goblin"))];
        std::fs::write(&csg, format!("bounds(0,0,0, 6,6,6); {text}")).unwrap();
        let tree = tree.to_str().unwrap().to_string();
        stdout(&["build", csg.to_str().unwrap(), "-o", &tree, "--depth", "6"]);
        tree
    };
    let cells = |tree: &str| {
        let mut cells = vec![0u8; 1 << 18];
        let all = Bounds { min: [0; 3], max: [64; 3] };
        spinney::open(tree).unwrap().window(6, &all, 0.0, &mut cells, None).unwrap();
        cells
    };
    let (a, b, made) = (build("a", one), build("b", other), directory.path("made.goblin"));
    let made = made.to_str().unwrap();
    for (operation, text) in [
        ("union", format!("union({one}, {other})")),
        ("intersection", format!("intersection({one}, {other})")),
        ("a-b", format!("difference({one}, {other})")),
        ("b-a", format!("intersection(complement({one}), {other})")),
        ("xor", format!("xor({one}, {other})")),
    ] {
        stdout(&["combine", operation, &a, &b, "-o", made]);
        let (nodes, text_cells) = (cells(made), cells(&build("whole", &text)));
        assert!(nodes == text_cells && nodes.contains(&255), "{operation}");
    }
}

/// The tables of pairs of node kinds, as printed for two models: entries compared with the truth
/// table of each operation.
#[test]
fn item_43_tables_of_node_kinds() {
    let directory = TestDirectory::new();
    let build = |name: &str, text: &str| {
        let [csg, model] =
            [directory.path(&format!("{name}.csg")), directory.path(&format!("{name}.goblin"))];
        std::fs::write(&csg, text).unwrap();
        let model = model.to_str().unwrap().to_string();
        stdout(&["build", "-q", csg.to_str().unwrap(), "-o", &model, "--brep", "--deviation", "0.01"]);
        model
    };
    let (a, b) = (build("a", "ball(0,0,0, 3)"), build("b", "ball(2,1,0, 3)"));
    for operation in 0..16usize {
        let made = directory.path(&format!("{operation}.goblin"));
        let printed = stdout(&[
            "combine",
            "-q",
            &operation.to_string(),
            &a,
            &b,
            "-o",
            made.to_str().unwrap(),
            "--explain",
        ]);
        let rows = printed.lines().skip_while(|line| !line.starts_with("A's node")).skip(1);
        let mut met = 0;
        for row in rows {
            let (kinds, counts) = (&row[..17], &row[34..]);
            let kinds: Vec<&str> = kinds.split_whitespace().collect();
            // Whether points of such nodes are outside, and inside.
            let states = |kind: &str| match kind {
                "VOID" => vec![false],
                "FULL" => vec![true],
                _ => vec![false, true],
            };
            let inside = |a: bool, b: bool| operation >> (2 * usize::from(!a) + usize::from(!b)) & 1 == 1;
            let is_result = |rule: &dyn Fn(bool, bool) -> bool| {
                let all = states(kinds[0])
                    .into_iter()
                    .flat_map(|a| states(kinds[1]).into_iter().map(move |b| (a, b)));
                all.into_iter().all(|(a, b)| rule(a, b) == inside(a, b))
            };
            let is_one_of = |entry: &str| row[17..34].trim() == entry;
            let right = [
                ("VOID", is_result(&|_, _| false)),
                ("FULL", is_result(&|_, _| true)),
                ("copy of A", is_result(&|a, _| a)),
                ("copy of B", is_result(&|_, b| b)),
                ("complement of A", is_result(&|a, _| !a)),
                ("complement of B", is_result(&|_, b| !b)),
                ("divide", kinds.contains(&"MIXED")),
                ("face by face", true),
            ];
            let expected = right.iter().find(|(_, is_right)| *is_right).unwrap().0;
            assert!(is_one_of(expected), "{operation}: {row}, expected {expected}");
            met += counts.split_whitespace().map(|count| count.parse::<u64>().unwrap()).sum::<u64>();
        }
        let is_of_both = ![0, 3, 5, 10, 12, 15].contains(&operation);
        assert!(if is_of_both { met > 1000 } else { met == 2 }, "{operation}: {met}");
    }
}

/// A box of five flat patches and a parabolic roof, whose inner control point is at a height.
fn roofed(height: f64) -> String {
    let share = |index: usize| index as f64 / 2.0;
    let mut text = String::from("6\n");
    for side in 0..6 {
        text.push_str("2 2\n");
        for (u, v) in (0..9).map(|at| (share(at % 3), share(at / 3))) {
            let mut at = [0.0; 3];
            (at[side / 2], at[(side / 2 + 1) % 3], at[(side / 2 + 2) % 3]) = (share(side % 2 * 2), u, v);
            if side == 5 && (u, v) == (0.5, 0.5) {
                at[2] = height;
            }
            text.push_str(&format!("{} {} {}\n", at[0], at[1], at[2]));
        }
    }
    text
}

/// Solids of biquadratic patches: the volume of the formula, facets near it, cells, and operations.
#[test]
fn item_43_patches() {
    let directory = TestDirectory::new();
    let [file, model, cells] = ["roof.bpt", "roof.goblin", "cells.goblin"]
        .map(|name| directory.path(name).to_str().unwrap().to_string());
    std::fs::write(&file, roofed(3.0)).unwrap();
    // The roof is 1 + 8 u (1 - u) v (1 - v), so that its mean is 1 + 8 / 36.
    let exact = 1.0 + 8.0 / 36.0;
    let report = |arguments: &[&str]| stderr(spinney(arguments).success());
    let printed = report(&["build", &file, "-o", &model, "--brep", "--deviation", "0.002"]);
    let line = printed.lines().find(|line| line.starts_with("volume")).unwrap();
    let numbers: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let facets = volume_of(&ExactModel::open(Path::new(&model), &Default::default()).unwrap());
    assert!((numbers[0] - exact).abs() < 1e-12, "{line}");
    assert!(numbers.contains(&facets) && (facets - exact).abs() < 0.002, "{line}: {facets}");
    let printed = report(&["build", &file, "-o", &cells, "--cells", "64", "--edge", "area"]);
    assert!(printed.lines().any(|line| line.starts_with("volume") && line.contains("1.22222")), "{printed}");
    let found = volume(&spinney::open(Path::new(&cells)).unwrap());
    assert!((found - exact).abs() < 0.01, "{found}");
    // The solid as CSG text, with a hole through its roof, as cells and as an exact model.
    let text = directory.path("roof.csg");
    stdout(&["export", "-q", &model, text.to_str().unwrap()]);
    let text = std::fs::read_to_string(text).unwrap();
    let text = format!("let roof = {text} difference(scale(2, roof), block(0.5,0.5,-1, 1.5,1.5,9))");
    // (The hole in the unscaled solid: the integral of the roof over its quarter.)
    let hole = 0.25 + 8.0 * (11.0f64 / 96.0).powi(2);
    let (exact_model, report) = directory.exact(&text, 0.002);
    let expected = 8.0 * (exact - hole);
    assert!((volume_of(&exact_model) - expected).abs() < 0.008 && report.curved == 1);
    assert_eq!(exact_model.verify(64 << 20, &()).unwrap(), vec![]);
    let tree = directory.cells(&text, Resolution::Depth(7), EdgeRule::Area);
    assert!((volume(&tree) / expected - 1.0).abs() < 0.004, "{} and {expected}", volume(&tree));
    // An open shell.
    std::fs::write(&file, roofed(3.0).replacen("6\n", "5\n", 1).rsplitn(12, '\n').last().unwrap()).unwrap();
    let message =
        complaint(&["build", &file, "-o", directory.path("open.goblin").to_str().unwrap(), "--brep"], 1);
    assert!(message.contains("roof.bpt, line ") && message.contains("open shell"), "{message}");
}

/// The extended octree has planes in its leaves, and is built from the expression by exact set
/// operations on polyhedra.
#[test]
fn item_42_extended_octree() {
    let directory = TestDirectory::new();
    // A comb: a block with 8 notches.
    let notches: Vec<String> = (0..8).map(|x| format!("block({}.25,1,2, {}.75,3,5)", x, x)).collect();
    let (model, _) = directory.exact(&format!("difference(block(0,0,0, 8,4,4), {})", notches.join(",")), 0.1);
    assert_eq!(volume_of(&model), 128.0 - 16.0);
    assert_eq!(model.verify(64 << 20, &()).unwrap(), vec![]);
    let nodes = model.nodes().named();
    for kind in ["FACE", "EDGE", "VERTEX", "BOOLEAN"] {
        assert!(nodes.iter().any(|(name, count)| *name == kind && *count > 0), "{nodes:?}");
    }
}

#[test]
fn exact_models_of_primitives() {
    let directory = TestDirectory::new();
    for (text, exact, area, is_planar) in primitives() {
        let mut errors = Vec::new();
        for deviation in [0.05, 0.005] {
            let (model, report) = directory.exact(text, deviation);
            let found = volume_of(&model);
            // Moving vertices by half a grid unit moves surfaces by no more.
            let error = exact - found;
            let moved = 2.0 * area * report.displacement.max(1e-15);
            let most = if is_planar { moved } else { area * deviation };
            assert!(-moved - 1e-9 * exact <= error || !is_planar, "{text}: {found} instead of {exact}");
            assert!(
                error.abs() <= most + 1e-9 * exact,
                "{text} within {deviation}: {found} instead of {exact}"
            );
            assert_eq!(report.curved, usize::from(!is_planar));
            errors.push(error.abs());
        }
        assert!(is_planar || errors[1] < 0.2 * errors[0], "{text}: {errors:?}");
    }
}

/// A set operation on cells and on faces gives the same solid.
#[test]
fn cells_and_exact_models_agree() {
    let directory = TestDirectory::new();
    for text in [
        "difference(union(block(0,0,0, 4,4,2), ball(2,2,2, 1.5)), cylinder(2,2,-1, 2,2,5, 0.5), half_space(1,0,0, 0.5))",
        "xor(block(0,0,0, 3,3,3), translate(1,1,1, block(0,0,0, 3,3,3)), ball(2,2,2, 2))",
        "let rod = cylinder(0,0,-3, 0,0,3, 0.5); intersection(ball(0,0,0, 2), complement(union(rod, rotate(1,0,0, 90, rod), rotate(0,1,0, 90, rod))))",
        "bounds(-2,-2,-2, 2,2,2); complement(ball(0,0,0, 1.5))",
        "difference(mirror(1,1,0, prism([[0,0],[3,0],[3,1],[1,1],[1,3],[0,3]], 0, 2)), half_space(0,0,-1, -1.5))",
        // A star with winding number 2 in its centre, which counts as outside.
        "prism([[0,3],[1.763,-2.427],[-2.853,0.927],[2.853,0.927],[-1.763,-2.427]], 0, 1)",
        "xor(complement(ball(0,0,0, 1)), complement(ball(1,0,0, 1)))",
    ] {
        let tree = directory.cells(text, Resolution::Depth(6), EdgeRule::Area);
        let (model, _) = directory.exact(text, 0.001);
        let (cells, exact) = (volume(&tree), volume_of(&model));
        assert!((cells / exact - 1.0).abs() < 0.004, "{text}: {cells} and {exact}");
        assert!(!model.is_unbounded());
        assert_eq!(model.verify(64 << 20, &()).unwrap(), vec![]);
    }
}

/// Set operations on many solids at once, in groups, include all of them.
#[test]
fn many_bodies() {
    let directory = TestDirectory::new();
    let blocks: Vec<String> =
        (0..150).map(|x| format!("block({x},0,0, {},1,1)", f64::from(x) + 0.5)).collect();
    let text = format!("difference(block(-1,0,0, 151,1,2), {})", blocks.join(","));
    let (model, report) = directory.exact(&text, 0.1);
    assert_eq!((volume_of(&model), report.primitives), (304.0 - 75.0, 151));
    assert_eq!(model.metadata().provenance.len(), 1);
}

#[test]
fn csg_text_is_preserved() {
    let directory = TestDirectory::new();
    let text = "# \"Quoted\" \\ text\nunit(cm);\nball(0,0,0, 1);\n";
    let path = directory.path("ball.csg");
    std::fs::write(&path, text).unwrap();
    let path = path.to_str().unwrap();
    for options in [&["--cells", "16"][..], &["--brep"], &["--cell", "1mm", "--edge", "area"]] {
        let [tree, again] =
            ["tree.goblin", "again.csg"].map(|name| directory.path(name).to_str().unwrap().to_string());
        stdout(&[&["build", path, "-o", &tree], options].concat());
        stdout(&["export", &tree, "-o", &again]);
        assert_eq!(std::fs::read_to_string(&again).unwrap(), text);
        let printed = stdout(&["info", &tree]);
        assert!(printed.contains("# \"Quoted\" \\ text") && printed.contains("unit = cm"), "{printed}");
    }
    let tree = spinney::open(directory.path("tree.goblin")).unwrap();
    assert_eq!(tree.metadata().tag(Tag::Csg), Some(text));
    assert_eq!(tree.metadata().frame.linear().col(0).length(), 0.1);
}

#[test]
fn options_that_do_not_fit_are_refused() {
    let directory = TestDirectory::new();
    let path = directory.path("ball.csg");
    std::fs::write(&path, "ball(0,0,0, 1)").unwrap();
    let [path, out] = [path, directory.path("x.goblin")].map(|path| path.to_str().unwrap().to_string());
    let cases: [(&[&str], &str); 10] = [
        (&["--shell"], "--shell"),
        (&["--edge", "touch"], "centre or area"),
        (&["--attribute", "part"], "--attribute"),
        (&["--up", "y"], "--up"),
        (&["--brep", "--repair"], "--repair: works only with models that have faces"),
        (&["--brep", "--deviation", "0"], "a distance above zero"),
        (&["--brep", "--deviation", "1e-12"], "at most 1048576 facets"),
        (&["--brep", "--deviation", "1e-300"], "at most 1048576 facets"),
        (&["--kind", "categorical"], "--kind: works only with rasters"),
        (&["--where", "a=1"], "--where: works only with features"),
    ];
    for (options, expected) in cases {
        let message = complaint(&[&["build", &path, "-o", &out], options].concat(), 1);
        assert!(message.contains(expected), "{options:?}: {message}");
        assert!(!Path::new(&out).exists());
    }
    let other = directory.path("plane.csg");
    std::fs::write(&other, "half_space(0,0,1, 0)").unwrap();
    let message = complaint(&["build", other.to_str().unwrap(), "-o", &out], 1);
    assert!(message.contains("set its bounds with bounds("), "{message}");
}
