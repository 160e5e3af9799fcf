//! Parts of models that must not be lost in silence: cells to vertices and levels of detail that no face uses, and
//! solids without an inside.

use std::path::{Path, PathBuf};

use spinney::dataset::Dataset;
use spinney::import::mesh::{InsideTest, Resolution, SolidOptions, SolidReport, open_all, plan_models};
use spinney::io::Output;

use crate::common::{shared_data, with};

/// Builds a model at 16 cells and opens the tree.
fn build(model: PathBuf, options: &SolidOptions) -> (Dataset, SolidReport) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("solid.goblin");
    let models = open_all(&[model], 64 << 20).unwrap();
    let report = plan_models(models, options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
    (spinney::open(&path).unwrap(), report)
}

fn sixteen() -> SolidOptions {
    with(SolidOptions::new(), |it| it.resolution = Resolution::Cells(16))
}

/// Builds a model of this text.
fn build_text(name: &str, text: &str) -> (Dataset, SolidReport) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    build(path, &sixteen())
}

const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

fn volume(tree: &Dataset) -> f64 {
    tree.solid(tree.depth(), &()).unwrap().world_volume()
}

#[test]
fn only_what_faces_use_sets_the_cells() {
    let (alone, expected) = build_text("a.obj", TETRAHEDRON);
    assert!(expected.cells > 0);
    let points = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n9999 0 0\n";
    let off = format!("OFF\n5 4 0\n{points}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n");
    let header = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 4\nproperty list uchar int vertex_indices\nend_header\n";
    let ply = format!("{header}{points}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n");
    let facet = |corners: [&str; 3]| {
        let corners = corners.map(|corner| format!("vertex {corner}\n")).concat();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let [a, b, c, d] = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
    // What has no three different corners is no face.
    let facets =
        [[a, c, b], [a, b, d], [a, d, c], [b, c, d], ["7 7 7", "7 7 7", "8 8 8"]].map(facet).concat();
    let stl = format!("solid a\n{facets}endsolid a\n");
    let obj = format!("{TETRAHEDRON}v 0 -5000 0\n");
    let shell = |z: u32| format!(r#"[[[[{z}, 2, 1]], [[{z}, 1, 3]], [[{z}, 3, 2]], [[1, 2, 3]]]]"#);
    let solid = |lod: &str, boundaries: &str| {
        format!(r#"{{"type": "Solid", "lod": "{lod}", "boundaries": {boundaries}}}"#)
    };
    let city = format!(
        r#"{{"type": "CityJSON", "version": "2.0", "transform": {{"scale": [1, 1, 1], "translate": [0, 0, 0]}},
        "CityObjects": {{"a": {{"type": "Building", "geometry": [{}, {}]}}}},
        "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-700, 0, 0]]}}"#,
        solid("1.2", &shell(4)),
        solid("2.2", &shell(0)),
    );
    for (name, text) in
        [("a.obj", obj), ("a.off", off), ("a.ply", ply), ("a.stl", stl), ("a.city.json", city)]
    {
        let (tree, report) = build_text(name, &text);
        assert_eq!(tree.metadata().frame.matrix, alone.metadata().frame.matrix, "{name}");
        assert_eq!((report.cells, volume(&tree)), (expected.cells, volume(&alone)), "{name}");
    }
}

#[test]
fn solids_without_an_inside_are_told() {
    let doubled = format!("{TETRAHEDRON}f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n");
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_string();
    for (text, inside) in [(doubled, InsideTest::Closed), (triangle, InsideTest::Open)] {
        let (_, report) = build_text("a.obj", &text);
        assert_eq!((report.cells, report.inside), (0, inside));
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("a.obj");
        std::fs::write(&model, text).unwrap();
        let (_, report) = build(model, &with(sixteen(), |it| it.surface = true));
        assert!(report.cells > 0);
    }
}

#[test]
fn files_that_lost_something() {
    let Some(folder) = shared_data().map(|folder| folder.join("hostile/mesh")) else { return };
    let measure = |name: &str| {
        let path = folder.join(name);
        if !Path::new(&path).is_file() {
            eprintln!("skipped: {} is not there", path.display());
            return None;
        }
        let (tree, report) = build(path, &sixteen());
        Some((volume(&tree), report.cells))
    };
    for (name, expected) in [("bom_silent.obj", 1.0), ("multilod.city.json", 1000.0)] {
        if let Some((found, _)) = measure(name) {
            assert!((found - expected).abs() < 1e-9 * expected, "{name}: {found}");
        }
    }
    if let Some((found, _)) = measure("stray.obj") {
        assert!((found - 1.0 / 6.0).abs() < 0.02, "{found}");
    }
    for name in ["triangle.obj", "dup_oppall.obj"] {
        assert!(measure(name).is_none_or(|(_, cells)| cells == 0), "{name}");
    }
}
