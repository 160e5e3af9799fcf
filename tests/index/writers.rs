//! Commands that write trees from indexes resolve references: their files need no sources.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::command::spinney;
use crate::compare::{Directory, assert_equal_trees, assert_whole, index, open, tree};
use crate::tiffs::{Samples, Tiff};

/// A directory with indexes (`a`, `b`) and trees (`whole_a`, `whole_b`) of two files.
fn indexes() -> Directory {
    let directory = Directory::new();
    for (name, origin, seed) in [("a", [0, 0], 1), ("b", [150, 120], 2)] {
        let tiff = Tiff {
            origin: Some(origin),
            samples: Samples::Int(16),
            nodata: Some("1"),
            ..Tiff::new([300, 280], 1)
        };
        let source = directory.path(&format!("{name}.tif"));
        tiff.filled(seed).write(&source);
        index(std::slice::from_ref(&source), &directory.path(&format!("{name}.goblin")));
        tree(std::slice::from_ref(&source), &directory.path(&format!("whole_{name}.goblin")));
    }
    directory
}

/// Runs commands on the indexes and on the trees; `a` and `b` in the arguments are the files, `OUT`
/// is the output.
fn run(directory: &Directory, arguments: &str, extension: &str) -> [PathBuf; 2] {
    ["", "whole_"].map(|prefix| {
        let output = directory.path(&format!("{prefix}out.{extension}"));
        let words: Vec<String> = arguments
            .split(' ')
            .map(|word| match word {
                "a" | "b" => directory.name(&format!("{prefix}{word}.goblin")),
                "WHOLE" => directory.name("whole_b.goblin"),
                "OUT" => output.to_str().unwrap().into(),
                _ => word.into(),
            })
            .collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        spinney(&[&words[..], &["-q"]].concat()).success();
        output
    })
}

/// Compares all layers of two files, of which the first needs no others.
fn assert_whole_and_equal(found: &Path, expected: &Path, what: &str) {
    assert_whole(found);
    let (found, expected) = (open(found), open(expected));
    assert_eq!(found.layers().unwrap().len(), expected.layers().unwrap().len());
    for number in 0..expected.layers().unwrap().len() {
        let [found, expected] = [&found, &expected].map(|file| file.layer(&number.to_string()).unwrap());
        assert_equal_trees(&found, &expected, what);
        assert_eq!(found.verify(1 << 20, &()).unwrap(), [], "{what}");
    }
}

#[test]
fn trees_made_of_indexes_need_no_sources() {
    let directory = indexes();
    let commands = [
        ("convert a OUT", "goblin"),
        ("convert a OUT --codec packed", "goblin"),
        ("transform a -o OUT", "goblin"),
        ("transform a window=20,30,250,200 -o OUT", "goblin"),
        ("transform a window=0,0,64,64 crop --codec packed -o OUT", "goblin"),
        ("transform a rotate=90 mirror=x -o OUT", "goblin"),
        ("transform a calc=b1*2,type=i16 -o OUT", "goblin"),
        ("transform a depth=5 -o OUT", "goblin"),
        ("combine over a b -o OUT", "goblin"),
        ("combine over WHOLE a -o OUT", "goblin"),
        ("combine and a WHOLE -o OUT", "goblin"),
        ("combine union b a --codec packed -o OUT", "goblin"),
        ("combine max a b -o OUT", "goblin"),
        ("combine changed a b -o OUT", "goblin"),
        ("diff a WHOLE -o OUT", "goblin"),
    ];
    let outputs = commands.map(|(arguments, extension)| {
        let outputs = run(&directory, arguments, extension);
        // (All outputs have one name.)
        outputs.map(|output| fs::read(output).unwrap())
    });
    let (autumn, whole_autumn) = {
        let [autumn, whole] = run(&directory, "convert a OUT", "autumn");
        (autumn, whole)
    };
    for name in ["a.tif", "b.tif"] {
        fs::remove_file(directory.path(name)).unwrap();
    }
    let [found, expected] = ["found.goblin", "expected.goblin"].map(|name| directory.path(name));
    for ((arguments, _), outputs) in commands.iter().zip(outputs) {
        fs::write(&found, &outputs[0]).unwrap();
        fs::write(&expected, &outputs[1]).unwrap();
        assert_whole_and_equal(&found, &expected, arguments);
    }
    assert_equal_trees(&open(&autumn), &open(&whole_autumn), "convert to Autumnal");
}

#[test]
fn layers_of_indexes_are_copied_whole() {
    let directory = indexes();
    for prefix in ["", "whole_"] {
        let name = |name: &str| directory.name(&format!("{prefix}{name}.goblin"));
        fs::copy(name("a"), name("out")).unwrap();
        spinney(&["-q", "edit", &name("out"), "add-layer", &directory.name("whole_a.goblin"), "second"])
            .success();
        fs::copy(directory.name("whole_a.goblin"), name("other")).unwrap();
        spinney(&["-q", "edit", &name("other"), "add-layer", &name("a"), "second"]).success();
        fs::copy(name("out"), name("dropped")).unwrap();
        spinney(&["-q", "edit", &name("dropped"), "drop-layer", "second"]).success();
    }
    fs::remove_file(directory.path("a.tif")).unwrap();
    for name in ["out", "other", "dropped"] {
        let [found, expected] =
            ["", "whole_"].map(|prefix| directory.path(&format!("{prefix}{name}.goblin")));
        assert_whole_and_equal(&found, &expected, name);
    }
}

#[test]
fn exports_are_those_of_the_tree() {
    let directory = indexes();
    for (arguments, extension) in [
        ("export a OUT", "tif"),
        ("get a OUT --window 10,20,200,220", "npy"),
        ("get a OUT --size 64", "png"),
        ("contours a --every 2 -o OUT", "geojson"),
    ] {
        let [found, expected] = run(&directory, arguments, extension);
        assert!(fs::read(found).unwrap() == fs::read(expected).unwrap(), "{arguments}");
    }
}

#[test]
fn manifests_list_indexes() {
    let directory = indexes();
    let [found, expected] = run(&directory, "manifest a b -o OUT", "manifest.json");
    assert_equal_trees(&open(&found), &open(&expected), "manifest");
    fs::remove_file(directory.path("b.tif")).unwrap();
    let cells = |tree: &Path| open(tree).point([10, 10, 0], open(tree).depth(), &mut Default::default());
    assert_eq!(cells(&found).unwrap(), cells(&expected).unwrap());
}
