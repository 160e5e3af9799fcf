//! Solids together: results of one command as input of the next, with volumes by formula.

use crate::common::command::{command, stdout};
use crate::common::directory::TestDirectory;

/// A block with a pocket in its top, and a block that crosses one of its sides.
const BODY: &str = "difference(block(0,0,0, 10,8,6), block(2,2,3, 5,6,7));\n";
const TOOL: &str = "block(6,1,-2, 14,5,4);\n";

/// Volumes of both, and of their intersection.
const VOLUMES: [f64; 3] = [444.0, 192.0, 64.0];

/// Operations on both, and their volumes.
const OPERATIONS: [(&str, f64); 5] = [
    ("and", 64.0),
    ("a-b", 444.0 - 64.0),
    ("b-a", 192.0 - 64.0),
    ("or", 444.0 + 192.0 - 64.0),
    ("xor", 444.0 + 192.0 - 128.0),
];

/// Steps before an operation, and the scale of volumes.
type ScaledSteps = (&'static [&'static str], f64);

const STEPS: [ScaledSteps; 6] = [
    (&[], 1.0),
    (&["translate=0.25,0.375,0.125"], 1.0),
    (&["rotate=90,z"], 1.0),
    (&["rotate=30,z"], 1.0),
    (&["scale=1.5"], 3.375),
    (&["mirror=x", "translate=0.25,0,0"], 1.0),
];

impl TestDirectory {
    fn make(&self, arguments: &[&str]) {
        let output = command(arguments).current_dir(self.root()).output().unwrap();
        let messages = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {messages}");
    }

    /// Volume of a solid, exact or of cells.
    fn volume(&self, name: &str) -> f64 {
        let text = stdout(&["stats", "--json", &self.name(name)]);
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        let solid = &found["solid"]["volume"];
        let whole = found["volume"].as_f64().unwrap();
        // (Two numbers of one name mean one thing.)
        let is_same = |solid: f64| (solid - whole).abs() < 1e-9 * whole;
        assert!(solid.as_f64().is_none_or(is_same), "{name}: {text}");
        whole
    }

    /// Checks volumes of all operations after all steps, for two files, within a share of the sum
    /// of both volumes.
    fn check(&self, [body, tool]: [&str; 2], steps: &[ScaledSteps], tolerance: f64) {
        for &(steps, scale) in steps {
            let moved = [body, tool].map(|name| {
                let target = format!("moved_{name}");
                match steps {
                    [] => _ = std::fs::copy(self.path(name), self.path(&target)).unwrap(),
                    _ => self.make(&[&["-q", "transform", name][..], steps, &["-o", &target]].concat()),
                }
                target
            });
            let limit = tolerance * scale * (VOLUMES[0] + VOLUMES[1]);
            for (name, expected) in moved.iter().zip(VOLUMES) {
                let found = self.volume(name);
                assert!(
                    (found - expected * scale).abs() <= limit,
                    "{name} {steps:?}: {found} for {expected}"
                );
            }
            for (operation, expected) in OPERATIONS {
                self.make(&["-q", "combine", operation, &moved[0], &moved[1], "-o", "result.goblin"]);
                let found = self.volume("result.goblin");
                let expected = expected * scale;
                assert!(
                    (found - expected).abs() <= limit,
                    "{operation} of {body} after {steps:?}: {found}, expected {expected}"
                );
            }
        }
    }
}

/// Builds both solids, with options.
fn built(options: &[&str]) -> TestDirectory {
    let directory = TestDirectory::new();
    for (name, text) in [("body", BODY), ("tool", TOOL)] {
        directory.write(&format!("{name}.csg"), text);
        let [source, target] = ["csg", "goblin"].map(|ending| format!("{name}.{ending}"));
        directory.make(&[&["-q", "build", &source, "-o", &target][..], options].concat());
    }
    directory
}

const EXACT: [&str; 3] = ["--brep", "--snap", "0.0078125"];

#[test]
fn exact_models_have_volumes_by_formula() {
    // (Turned vertices move to the grid.)
    built(&["--brep"]).check(["body.goblin", "tool.goblin"], &STEPS, 1e-6);
}

/// Cells of both sources begin at different positions, so one is resampled for each operation.
#[test]
fn cells_have_volumes_by_formula() {
    // (`scale=` changes the number of cells, and not the world.)
    let steps = STEPS.map(|(steps, _)| (steps, 1.0));
    built(&["--cell", "0.5"]).check(["body.goblin", "tool.goblin"], &steps, 0.02);
}

/// A result is exported, built again without repair, and is an operand.
#[test]
fn results_go_through_every_format() {
    let directory = built(&EXACT);
    directory.make(&["-q", "combine", "a-b", "body.goblin", "tool.goblin", "-o", "cut.goblin"]);
    for format in ["ply", "obj", "off", "stl", "city.json", "glb"] {
        let (file, again) = (format!("cut.{format}"), format!("again_{}.goblin", &format[..3]));
        directory.make(&["-q", "export", "cut.goblin", &file]);
        directory.make(&["-q", "build", &file, "--brep", "-o", &again]);
        assert!((directory.volume(&again) - 380.0).abs() < 1e-9, "{format}");
        for (operation, expected) in [("or", 444.0 + 192.0 - 64.0), ("and", 0.0), ("xor", 380.0 + 192.0)] {
            directory.make(&["-q", "combine", operation, &again, "tool.goblin", "-o", "result.goblin"]);
            let found = directory.volume("result.goblin");
            assert!(
                (found - expected).abs() < 1e-9,
                "{operation} after {format}: {found}, expected {expected}"
            );
        }
    }
}

/// Sections of a result are solids again.
#[test]
fn sections_have_the_volume_of_their_layers() {
    let directory = built(&EXACT);
    directory.make(&["-q", "combine", "a-b", "body.goblin", "tool.goblin", "-o", "cut.goblin"]);
    directory.make(&["-q", "section", "cut.goblin", "z=0.25..5.75/0.5", "-o", "layers.gpkg"]);
    directory.make(&[
        "-q",
        "build",
        "layers.gpkg",
        "--heights",
        "at",
        "--cell",
        "0.5",
        "-o",
        "layers.goblin",
    ]);
    let found = directory.volume("layers.goblin");
    assert!((found - 380.0).abs() < 10.0, "{found}");
}
