//! Octrees as 3D Tiles and binary glTF on the command line.

use std::fs;

use crate::common::command::{complaint, spinney, stderr};
use crate::common::gltf_file::{Glb, Tiles};

const BALL: &str = "fixtures/v1/ball.goblin";

#[test]
fn tilesets_and_models_are_written_or_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let tileset = path("ball/tileset.json");
    let message = stderr(spinney(&["export", BALL, &tileset, "--smooth"]).success());
    assert!(message.contains("1 in 1 level,") && !message.contains("globe"), "{message}");
    let json = serde_json::from_slice(&fs::read(&tileset).unwrap()).unwrap();
    let tiles = Tiles::read(&directory.path().join("ball"), &json);
    assert_eq!(tiles.tiles.into_iter().collect::<Vec<_>>(), [([0; 4], true)]);
    let model = path("ball.glb");
    spinney(&["export", "-q", BALL, &model, "--level", "4"]).success().stderr("");
    assert_eq!(Glb::read(model.as_ref()).meshes.len(), 1);
    let piped = spinney(&["export", "-q", BALL, "-", "--format", "glb", "--level", "4"]).success();
    assert_eq!(piped.get_output().stdout, fs::read(&model).unwrap());
    let count = fs::read_dir(directory.path()).unwrap().count();
    let bytes = fs::read(&tileset).unwrap();
    let other = path("other/tileset.json");
    let refusals: [(&[&str], i32, &[&str]); 9] = [
        // Existing files stay.
        (&["export", BALL, &tileset], 1, &["not empty", "another name"]),
        (&["export", BALL, "tileset.json"], 1, &["expected a directory", "x/tileset.json"]),
        (&["export", BALL, &path("missing/other/tileset.json")], 1, &["other"]),
        (&["export", "fixtures/v1/classic.goblin", &other], 1, &["a quadtree", "an octree"]),
        (&["export", "fixtures/v1/chapel.goblin", &other, "--smooth"], 1, &["--smooth", "an exact model"]),
        (&["export", BALL, &other, "--level", "6"], 1, &["level", "0 to 5"]),
        (&["export", BALL, &other, "--triangles"], 1, &["--triangles"]),
        (&["export", BALL, &other, "--zoom", "0..3"], 1, &["--zoom"]),
        (&["export", BALL, &path("ball.ply"), "--meshopt"], 1, &["--meshopt", "3D Tiles and glTF"]),
    ];
    for (arguments, code, words) in refusals {
        let text = complaint(arguments, code);
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {text}");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), count, "{arguments:?}");
    }
    assert_eq!(fs::read(&tileset).unwrap(), bytes);
}

#[test]
fn models_are_read_as_cells_and_exact_models() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let [model, cells, exact, again] = ["a.glb", "a.goblin", "b.goblin", "c.glb"].map(path);
    spinney(&["export", "-q", BALL, &model, "--meshopt"]).success();
    spinney(&["build", "-q", &model, "-o", &cells, "--cells", "24"]).success().stderr("");
    spinney(&["export", "-q", &cells, &again]).success();
    assert!(!Glb::read(again.as_ref()).meshes.is_empty());
    // The format says which axis points up.
    let turned = path("turned.goblin");
    spinney(&["build", "-q", &model, "-o", &turned, "--cells", "24", "--up", "y"]).success();
    let info = |file: &str| {
        let output = spinney(&["stats", file]).success().get_output().stdout.clone();
        String::from_utf8(output).unwrap()
    };
    assert_eq!(info(&turned).replace("turned", "a"), info(&cells));
    spinney(&["build", "-q", &model, "-o", &exact, "--brep"]).success().stderr("");
    let text = spinney(&["info", &exact]).success().get_output().stdout.clone();
    assert!(String::from_utf8_lossy(&text).contains("glTF 2.0, binary"));
    let cut = path("cut.glb");
    let bytes = fs::read(&model).unwrap();
    fs::write(&cut, &bytes[..bytes.len() - 1]).unwrap();
    let text = complaint(&["build", &cut, "-o", &path("d.goblin")], 1);
    assert!(text.contains("cut.glb") && text.contains("as declared"), "{text}");
}
