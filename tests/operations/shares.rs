//! Area shares of classes in cells of other sizes, with frequent ties: no class is preferred.

use std::path::Path;

use spinney::{Crs, DataKind, FileView, Frame, Output, Resampling, Rule, SampleType, WriteOptions};

use crate::common::{Cells, Random, quad, value, write_goblin};

const SIDE: u64 = 256;

/// Writes four random classes, in cells of a size.
fn write(path: &Path, side: u64, cell: f64, seed: u64) {
    let form = quad(SampleType::U8, 1);
    let mut random = Random(seed);
    let cells = (0..side * side).map(|_| Some(value(form.value, random.below(4)))).collect();
    let affine = [cell, 0.0, 500_000.0, 0.0, -cell, 5_400_000.0];
    let frame = Frame { crs: Some(Crs::epsg(32632)), ..Frame::planar(affine) };
    write_goblin(
        path,
        &Cells { form, size: [side, side, 1], cells },
        (Rule::Majority, DataKind::Categorical),
        frame,
    );
}

fn shares(path: &Path) -> Vec<f64> {
    let found = spinney::open(path).unwrap().statistics(None, &()).unwrap();
    assert_eq!(found.classes.len(), 4);
    found.classes.iter().map(|(_, cells)| *cells as f64 / found.cells as f64).collect()
}

#[test]
fn areas_prefer_no_class() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let (source, made) = (path("source.goblin"), path("made.goblin"));
    write(&path("smaller.goblin"), 400, 0.625, 1);
    write(&path("larger.goblin"), 160, 1.5, 2);
    let like = |name: &str| format!("like={}", path(name).display());
    let (smaller, larger) = (like("smaller.goblin"), like("larger.goblin"));
    for steps in
        [&["scale=1.5"][..], &["window=3,5,200,190", "scale=1.5"], &["scale=0.6"], &[&*smaller], &[&*larger]]
    {
        let (mut differences, rasters) = ([0.0; 4], 4);
        for seed in 0..rasters {
            write(&source, SIDE, 1.0, 100 + seed);
            let mut view = FileView::of(&source);
            view.steps = steps.iter().map(|step| step.parse().unwrap()).collect();
            // Operations that keep the grid use the file's rule.
            view.warp.resampling = steps[0].starts_with("like=").then_some(Resampling::Majority);
            spinney::transform(&view, Output::create(&made).unwrap(), WriteOptions::new(64 << 20), &())
                .unwrap();
            for ((difference, found), own) in differences.iter_mut().zip(shares(&made)).zip(shares(&source)) {
                *difference += (found - own) / f64::from(rasters as u32);
            }
        }
        // As if each result had only the 60 x 60 independent cells: adjacent results share source
        // cells.
        let deviation = (0.25f64 * 0.75 / (60.0 * 60.0 * rasters as f64)).sqrt();
        assert!(
            differences.iter().all(|difference| difference.abs() < 3.0 * deviation),
            "{steps:?}: {differences:?}"
        );
    }
}
