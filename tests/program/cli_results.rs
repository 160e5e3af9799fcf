//! Results of one command as inputs of the next: messages lead to commands that work.

use std::path::Path;

use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::directory::TestDirectory;

/// Returns the arguments of the first command in backticks that a message advises.
fn advised(message: &str) -> Vec<String> {
    let text = message.split('`').skip(1).step_by(2).find(|text| text.starts_with("spinney "));
    let text = text.unwrap_or_else(|| panic!("no command in {message}"));
    text.split_whitespace().skip(1).map(String::from).collect()
}

/// Runs an advised command with other names for some words.
fn follow(message: &str, names: &[(&str, &str)]) {
    let mut arguments = advised(message);
    for argument in &mut arguments {
        if let Some((_, name)) = names.iter().find(|(word, _)| word == argument) {
            *argument = (*name).to_string();
        }
    }
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    command(&arguments).assert().success();
}

fn volume(file: &str) -> f64 {
    let text = stdout(&["stats", "--json", file]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let volume = json.pointer("/solid/volume").or_else(|| json.get("volume"));
    volume.and_then(serde_json::Value::as_f64).unwrap_or_else(|| panic!("{text}"))
}

/// Files of a block and of a smaller block on its lower side.
struct Files {
    directory: TestDirectory,
    plate: String,
    drill: String,
}

impl Files {
    fn new() -> Files {
        let directory = TestDirectory::new();
        let made = |name: &str, text: &str| {
            let file = directory.name(name);
            std::fs::write(&file, text).unwrap();
            file
        };
        let plate = made("plate.csg", "block(0,0,0, 100,50,20);");
        let drill = made("drill.csg", "block(40,10,-5, 60,30,25);");
        Files { directory, plate, drill }
    }

    fn name(&self, name: &str) -> String {
        self.directory.name(name)
    }

    fn built(&self, input: &str, name: &str, options: &[&str]) -> String {
        let file = self.name(name);
        command(&["build", "-q", input, "-o", &file]).args(options).assert().success();
        file
    }
}

/// Exact models have no editable form: a name that ends with .autumn is refused, with a name that
/// works.
#[test]
fn exact_models_are_goblin_files() {
    let files = Files::new();
    let autumn = files.name("x.autumn");
    let plate = files.built(&files.plate, "plate.goblin", &["--brep"]);
    let writers: [&[&str]; 3] = [
        &["build", &files.plate, "--brep", "-o", &autumn],
        &["combine", "or", &plate, &plate, "-o", &autumn],
        &["transform", &plate, "translate=1,1,1", "-o", &autumn],
    ];
    for arguments in writers {
        let message = complaint(arguments, 1);
        assert!(message.contains("have no editable form") && !Path::new(&autumn).exists(), "{message}");
        let name = message.trim_end().rsplit("such as ").next().unwrap().to_string();
        assert!(name.ends_with("x.goblin"), "{message}");
        let again: Vec<&str> =
            arguments.iter().map(|word| if *word == autumn { name.as_str() } else { *word }).collect();
        command(&again).assert().success();
    }
}

/// A tree of cells and an exact model: cells of the model, of the same size.
#[test]
fn cells_are_combined_with_cells_of_exact_models() {
    let files = Files::new();
    let cells = files.built(&files.plate, "cells.goblin", &["--cell", "1.25"]);
    let drill = files.built(&files.drill, "drill.goblin", &["--brep"]);
    let [other, result] = ["other.goblin", "result.goblin"].map(|name| files.name(name));
    for pair in [[&cells, &drill], [&drill, &cells]] {
        let message = complaint(&["combine", "a-b", pair[0], pair[1], "-o", &result], 1);
        follow(&message, &[("CELLS.goblin", &other)]);
        let pair = pair.map(|file| if *file == drill { &other } else { file });
        command(&["combine", "-q", "and", pair[0], pair[1], "-o", &result]).assert().success();
        let expected = 20.0 * 20.0 * 20.0;
        assert!((volume(&result) / expected - 1.0).abs() < 0.01, "{}", volume(&result));
        [&other, &result].into_iter().for_each(|file| std::fs::remove_file(file).unwrap());
    }
}

/// Sections at the lower end of a model are empty, which loses the foot of a solid that is built
/// from them: the message adds a plane there.
#[test]
fn sections_make_the_solid_again() {
    let files = Files::new();
    let plate = files.built(&files.plate, "plate.goblin", &["--brep"]);
    let [sections, solid] = ["sections.gpkg", "solid.goblin"].map(|name| files.name(name));
    let found = stderr(command(&["section", &plate, "z=0..20/2", "-o", &sections]).assert().success());
    assert!(found.contains("z=0: is the lower end of the model"), "{found}");
    let plane = found.split("add `").nth(1).and_then(|text| text.split('`').next()).unwrap().to_string();
    assert_eq!(plane, "z=0.001");
    let of_all = ["section", "-q", &plate, &plane, "z=2..20/2", "-o", &sections];
    let found = stderr(command(&of_all).assert().success());
    assert_eq!(found, "");
    command(&["build", "-q", &sections, "--heights", "at", "--cell", "0.5", "-o", &solid]).assert().success();
    assert!((volume(&solid) / 100_000.0 - 1.0).abs() < 0.005, "{}", volume(&solid));
}

/// The empty set is a model, of which no cells can be made.
#[test]
fn empty_results_are_called_empty() {
    let files = Files::new();
    let plate = files.built(&files.plate, "plate.goblin", &["--brep"]);
    let [empty, cells] = ["empty.goblin", "cells.goblin"].map(|name| files.name(name));
    command(&["combine", "-q", "a-b", &plate, &plate, "-o", &empty]).assert().success();
    let message = complaint(&["build", &empty, "-o", &cells], 1);
    assert!(message.contains("the model is empty") && !message.contains("corrupt"), "{message}");
}

/// Models of unlike grids are snapped to one unit by the command that the message names.
#[test]
fn unlike_grids_are_snapped_to_one() {
    let files = Files::new();
    let plate = files.built(&files.plate, "plate.goblin", &["--brep"]);
    let [larger, result] = ["larger.goblin", "result.goblin"].map(|name| files.name(name));
    command(&["transform", "-q", &plate, "scale=1.1", "-o", &larger]).assert().success();
    let arguments = ["combine", "-q", "and", &larger, &plate, "-o", &result];
    let message = stderr(command(&arguments).assert().success());
    let copies = ["one.goblin", "other.goblin"].map(|name| files.name(name));
    for (model, copy) in [&larger, &plate].into_iter().zip(&copies) {
        follow(&message, &[("MODEL", model), ("COPY.goblin", copy)]);
    }
    let arguments = ["combine", "-q", "and", &copies[0], &copies[1], "-o", &result];
    let message = stderr(command(&arguments).assert().success());
    assert!(!message.contains("common grid"), "{message}");
    assert!((volume(&result) - 100_000.0).abs() < 0.1, "{}", volume(&result));
}

/// Objects that are bodies by themselves but intersect each other: --skip-bad has no effect, and is
/// not advised.
#[test]
fn bodies_that_intersect_are_repaired() {
    let files = Files::new();
    let mesh = files.name("two.obj");
    let mut text = String::new();
    for (name, first, [low, high]) in [("a", 1, [0, 8]), ("b", 9, [4, 12])] {
        text += &format!("o {name}\n");
        for [x, y, z] in
            [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
        {
            let [x, y, z] = [x, y, z].map(|at: i32| if at == 1 { high } else { low });
            text += &format!("v {x} {y} {z}\n");
        }
        for face in [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]] {
            text += &format!("f {}\n", face.map(|vertex| (vertex + first).to_string()).join(" "));
        }
    }
    std::fs::write(&mesh, text).unwrap();
    let file = files.name("two.goblin");
    let build = ["build", "-q", &mesh, "--brep", "-o", &file];
    let message = complaint(&build, 1);
    assert!(
        message.contains("resolve it with --repair") && message.contains("--skip-bad keeps"),
        "{message}"
    );
    let message = complaint(&[&build[..], &["--skip-bad"]].concat(), 1);
    assert!(
        message.contains("resolve it with --repair") && message.contains("--skip-bad keeps"),
        "{message}"
    );
    command(&build).args(["--repair"]).assert().success();
    assert_eq!(volume(&file), 2.0 * 512.0 - 64.0);
}

/// A tool that cuts an object of a city leaves it an object: a solid with its name and volume.
#[test]
fn objects_of_a_city_stay_objects() {
    let files = Files::new();
    let at = |name: &str| files.name(name);
    std::fs::write(
        at("h.city.json"),
        r#"{"type":"CityJSON","version":"2.0","transform":{"scale":[1,1,1],"translate":[0,0,0]},
        "CityObjects":{"h1":{"type":"Building","attributes":{"storeys":2},"geometry":[{"type":"Solid","lod":"2",
        "boundaries":[[[[0,3,2,1]],[[4,5,6,7]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,0,4,7]]]]}]}},
        "vertices":[[0,0,0],[10,0,0],[10,8,0],[0,8,0],[0,0,6],[10,0,6],[10,8,6],[0,8,6]]}"#,
    )
    .unwrap();
    std::fs::write(at("cut.csg"), "block(2,2,4, 8,6,8);").unwrap();
    let house = files.built(&at("h.city.json"), "h.goblin", &["--brep"]);
    let tool = files.built(&at("cut.csg"), "cut.goblin", &["--brep", "--snap", "1"]);
    let [cut, json] = ["hc.goblin", "hc.city.json"].map(at);
    command(&["combine", "-q", "a-b", &house, &tool, "-o", &cut]).assert().success();
    let table = stdout(&["stats", "-q", "--each", &cut]);
    assert!(
        table.contains("h1,Building,") && table.contains("true,11,432,416,") && table.lines().count() == 2,
        "{table}"
    );
    command(&["export", "-q", &cut, &json]).assert().success();
    let city: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let objects = city["CityObjects"].as_object().unwrap();
    assert_eq!(objects.keys().collect::<Vec<_>>(), ["h1"]);
    assert_eq!(objects["h1"]["geometry"][0]["type"], "Solid");
    assert_eq!(objects["h1"]["attributes"]["storeys"], 2);
}
