//! Solids of real meshes: known volumes, and broken meshes against intact ones.

use std::path::{Path, PathBuf};

use spinney::import::mesh::{Resolution, SolidOptions, open_all, plan_models};
use spinney::query::EdgeRule;
use spinney::raw::dataset;
use spinney::raw::import::mesh::{Attribute, InsideTest, SolidReport};
use spinney::{Bounds, Crs, Dataset, OpenOptions, Output};

use crate::common::{shared_data, with};

fn build(inputs: &[PathBuf], options: &SolidOptions) -> (Dataset, SolidReport) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("solid.goblin");
    let models = open_all(inputs, options.memory).unwrap();
    let report = plan_models(models, options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
    (dataset::open(&path, &OpenOptions::new()).unwrap(), report)
}

/// Returns the models of `expected.tsv`: name, whether watertight, signed volume and area.
fn models(directory: &Path) -> Vec<(PathBuf, bool, [f64; 2])> {
    let table = std::fs::read_to_string(directory.join("expected.tsv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('\t').collect();
        let measures = [7, 8].map(|cell| cells[cell].parse().unwrap());
        (directory.join(cells[0]), cells[3] == "True" && cells[4] == "True", measures)
    };
    table.lines().skip(1).map(row).collect()
}

/// Volume in model units.
fn volume(tree: &Dataset) -> f64 {
    let cell = tree.metadata().frame.matrix[0][0];
    let statistics = tree.statistics(None, &()).unwrap();
    statistics.cells as f64 * statistics.channels[0].mean / 255.0 * cell * cell * cell
}

#[test]
fn volumes_and_areas_of_closed_models_are_right() {
    let Some(data) = shared_data() else { return };
    let mut checked = 0;
    for (path, is_closed, [expected, area]) in models(&data.join("mesh")) {
        let name = path.file_name().unwrap().to_str().unwrap().to_string();
        // Loose triangles are no solid, and the volume of overlapping solids is not the sum of
        // theirs.
        if !is_closed || name.contains("overlap") || name.contains("soup") {
            continue;
        }
        let of = |cells, edge| {
            let options = with(SolidOptions::new(), |it| {
                it.resolution = Resolution::Cells(cells);
                it.edge = edge;
            });
            let (tree, report) = build(std::slice::from_ref(&path), &options);
            assert_eq!(report.inside, InsideTest::Closed, "{name}");
            let solid = tree.solid(tree.depth(), &()).unwrap();
            assert!((solid.world_volume() / volume(&tree) - 1.0).abs() < 1e-9, "{name}");
            let surface = tree.solid_surface(tree.depth(), &()).unwrap();
            [volume(&tree) / expected - 1.0, surface.smooth_area() / area - 1.0]
        };
        // An axis-parallel face may be off by half a cell over its whole area.
        let [coarse, fine] = [64, 256].map(|cells| of(cells, EdgeRule::Centre).map(f64::abs));
        assert!(coarse[0] < 5e-2 && fine[0] < 1e-2, "{name}: {coarse:?}, {fine:?}");
        assert!(coarse[1] < 0.1 && fine[1] < 0.02 && fine[1] < coarse[1], "{name}: {coarse:?}, {fine:?}");
        let [error, _] = of(256, EdgeRule::Area);
        assert!(error.abs() < 4e-4, "{name}: {error}");
        checked += 1;
    }
    assert!(checked >= 6, "{checked}");
}

#[test]
fn broken_models_are_filled_as_whole_ones() {
    let Some(data) = shared_data() else { return };
    let mesh = data.join("mesh");
    let cases = [
        ("bunny_hr.ply", "bad_bunny_holes1pct.ply", InsideTest::Open, 0.999),
        ("bunny_hr.ply", "bad_bunny_flip10pct.ply", InsideTest::Flipped, 1.0),
        ("bunny_hr.ply", "bad_bunny_soup.ply", InsideTest::Open, 0.99),
        ("armadillo.ply", "bad_duplicate_faces.ply", InsideTest::Closed, 1.0),
    ];
    for (whole, broken, decided, share) in cases {
        let options = with(SolidOptions::new(), |it| it.resolution = Resolution::Cells(128));
        let (whole, _) = build(&[mesh.join(whole)], &options);
        let like = Resolution::Like(whole.metadata().frame.clone(), 7);
        let (other, report) = build(&[mesh.join(broken)], &with(options, |it| it.resolution = like));
        assert_eq!(report.inside, decided, "{broken}");
        // Which of 128 x 128 x 128 cells are full.
        let there = |tree: &Dataset| {
            let mut valid = vec![false; 1 << 21];
            tree.window(7, &Bounds::of_extent([128; 3]), 0.0, &mut vec![0; 1 << 21], Some(&mut valid))
                .unwrap();
            valid
        };
        let wrong = there(&whole).iter().zip(there(&other)).filter(|(a, b)| **a != *b).count();
        let agree = 1.0 - wrong as f64 / f64::from(1u32 << 21);
        assert!(agree >= share, "{broken}: {agree}");
    }
}

#[test]
fn overlapping_bodies_are_one_solid() {
    let Some(data) = shared_data() else { return };
    let mesh = data.join("mesh");
    let options = with(SolidOptions::new(), |it| it.resolution = Resolution::Cells(128));
    let (both, report) = build(&[mesh.join("bad_two_armadillos_overlap.ply")], &options);
    assert_eq!(report.inside, InsideTest::Closed);
    let one = 0.06861869387;
    assert!(volume(&both) > 1.05 * one && volume(&both) < 1.95 * one, "{}", volume(&both));
}

#[test]
fn buildings_become_parts() {
    let Some(data) = shared_data() else { return };
    let city = data.join("mesh/cityjson/rotterdam_subset.json");
    let options = with(SolidOptions::new(), |it| {
        it.resolution = Resolution::Cell(1.0);
        it.attribute = Attribute::PartNumber;
    });
    let (tree, report) = build(&[city], &options);
    assert!(report.faces > 200, "{report:?}");
    assert_eq!(tree.metadata().class_names.len(), 16);
    // Only the other file stores its coordinate system.
    assert_eq!(tree.metadata().frame.crs, None);
    let options = with(SolidOptions::new(), |it| it.resolution = Resolution::Cells(64));
    let (tree, _) = build(&[data.join("mesh/cityjson/delft.json")], &options);
    assert_eq!(tree.metadata().frame.crs, Some(Crs::epsg(7415)));
}
