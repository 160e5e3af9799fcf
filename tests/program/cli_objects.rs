//! The objects of exact models: some are drawn, and some are inside of others.

use serde_json::Value as Json;

use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::directory::TestDirectory;

/// A cube as an object of an OBJ file that has `first` vertices before it.
fn cube(name: &str, [low, high]: [i32; 2], first: i32) -> String {
    let corner = |i: i32| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high } else { low });
    let corners = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let sides = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];
    let faces =
        sides.map(|side| format!("f {}\n", side.map(|corner| (first + corner).to_string()).join(" ")));
    format!("o {name}\n{}{}", corners.collect::<String>(), faces.concat())
}

/// An image of one of two objects is that of a model of this object alone.
#[test]
fn some_objects_are_drawn() {
    let directory = TestDirectory::new();
    let mesh = directory.write("two.obj", cube("left", [0, 4], 0) + &cube("right", [5, 9], 8));
    let [both, one] = ["both.goblin", "one.goblin"].map(|name| directory.name(name));
    command(&["build", "-q", &mesh, "-o", &both, "--brep"]).assert().success();
    command(&["build", "-q", &mesh, "-o", &one, "--brep", "--where", "id=left"]).assert().success();
    for (name, options) in [
        ("shaded.png", &[][..]),
        ("hidden.svg", &["--drawing", "hidden-lines"]),
        ("wires.svg", &["--drawing", "wireframe"]),
    ] {
        let [some, alone, all] =
            ["some", "alone", "all"].map(|kind| directory.name(&format!("{kind}_{name}")));
        let draw = |file: &str, out: &str, more: &[&str]| {
            let words = ["render", "-q", file, out, "--size", "80x60"];
            command(&words).args(options).args(more).assert().success();
            std::fs::read(out).unwrap()
        };
        let drawn = draw(&both, &some, &["--where", "id=left"]);
        assert_eq!(drawn, draw(&one, &alone, &["--where", "id=left"]), "{name}");
        assert_ne!(drawn, draw(&both, &all, &[]), "{name}");
    }
    let out = directory.name("out.png");
    for (options, what) in [
        (&["--where", "id=middle"][..], "no object satisfies the conditions"),
        (&["--where", "id=left", "--level", "0"], "none for some parts"),
        (&["--where", "id=left", "--drawing", "octants"], "expected all, for blocks of an octree"),
    ] {
        let refused = complaint(&[&["render", &both, &out], options].concat(), 1);
        assert!(refused.contains(what), "{refused}");
    }
}

/// Contours at two values are one inside of the other: they are refused with advice that works, and
/// a repair names the object that vanishes.
#[test]
fn objects_inside_of_others() {
    let directory = TestDirectory::new();
    let mesh = directory.write("nested.obj", cube("outer", [0, 9], 0) + &cube("inner", [2, 6], 8));
    let out = directory.name("out.goblin");
    let refused = complaint(&["build", &mesh, "-o", &out, "--brep"], 1);
    for part in ["bodies are inside of each other", "--where id=NAME", "--repair", "of inner"] {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    command(&["build", &mesh, "-o", &out, "--brep", "--where", "id=inner"]).assert().success();
    let volume = || -> Json {
        serde_json::from_str::<Json>(&stdout(&["stats", &out, "--json"])).unwrap()["volume"].clone()
    };
    assert_eq!(volume(), 64.0);
    let repaired = stderr(command(&["build", &mesh, "-o", &out, "--brep", "--repair"]).assert().success());
    assert!(repaired.contains("1 objects have no faces left after the repair: inner"), "{repaired}");
    assert_eq!(volume(), 729.0);
    // Without objects.
    let one =
        directory.write("one.obj", cube("all", [0, 9], 0) + &cube("all", [2, 6], 8).replace("o all\n", ""));
    let refused = complaint(&["build", &one, "-o", &out, "--brep"], 1);
    assert!(refused.contains("write each body to a file of its own"), "{refused}");
}
