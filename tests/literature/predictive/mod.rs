//! Predictive building, row by row: the same trees as the builder's, and no node is created in
//! vain.

mod tree;

use std::path::Path;

use spinney::tree::{MemTree, build_slabs, build_source};
use spinney::{DataKind, Output, Rule, Value};

use self::tree::{PredictedSource, PredictiveTree};
use crate::common::{CLASSIC, Cells, QUAD, byte, bytes_of, cells_of, made, options, quad, value};

/// Builds the tree of cells by prediction.
fn predicted(cells: &Cells) -> PredictedSource<Option<Value>> {
    let tree = PredictiveTree::of(&cells.cells, cells.size[0] as usize, None);
    PredictedSource { tree, form: cells.form, value: |cell| cell }
}

/// Checks that the builder's file from slabs of rows equals the file of the predicted tree, and
/// that all its nodes are needed.
fn is_that_of_the_builder(cells: &Cells, rule: Rule, kind: DataKind) {
    let source = predicted(cells);
    let needed = MemTree::from_source(&source, Rule::Nearest).unwrap().inner_nodes();
    assert_eq!(source.tree.len(), 1 + 4 * needed, "{:?}", cells.size);
    let found = bytes_of(|path| {
        let output = Output::create(path).unwrap();
        build_source(&source, cells.size, &options(rule, kind, cells.depth()), output, &()).unwrap();
    });
    let is_no_cell = |nodata: &Value| !cells.cells.contains(&Some(*nodata));
    let nodata = (0..).map(|number| value(cells.form.value, number)).find(is_no_cell).unwrap();
    let expected = bytes_of(|path| {
        let (mut slabs, output) = (cells.slabs(nodata), Output::create(path).unwrap());
        let options = options(rule, kind, cells.depth());
        build_slabs(cells.form, &mut slabs, Some(nodata), &options, output, &()).unwrap();
    });
    assert!(found == expected, "{:?}", cells.size);
}

#[test]
fn item_16_raster_of_the_tables() {
    let cells = made(QUAD, [8, 8, 1], |[x, y, _]| Some(byte(CLASSIC[y as usize][x as usize])));
    assert_eq!(predicted(&cells).tree.len(), 10 + 31);
    is_that_of_the_builder(&cells, Rule::Dominant, DataKind::Categorical);
}

#[test]
fn item_16_random_rasters() {
    use spinney::SampleType::{F32, U8, U16};
    for seed in 0..60 {
        let side = [9, 70, 300][seed as usize % 3];
        let size = [1 + seed * 37 % side, 1 + seed * 53 % side, 1];
        let form = [quad(U8, 1), quad(F32, 1), quad(U8, 4), quad(U16, 1)][seed as usize % 4];
        let cells = match seed % 5 {
            0 => Cells::noise(form, seed, size, 1 + seed % 3),
            _ => Cells::random(form, seed, size, 1 + seed % 4, seed % 2 == 0),
        };
        let (rule, kind) =
            [(Rule::Majority, DataKind::Categorical), (Rule::Mean, DataKind::Continuous)][seed as usize % 2];
        is_that_of_the_builder(&cells, rule, kind);
    }
}

#[test]
fn item_16_fixtures() {
    let directory = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    for name in ["classic.png", "island_classes.tif", "island_elevation.tif", "island_rgb.png"] {
        let path = directory.path().join("built.goblin");
        spinney::build(fixtures.join(name), &path).unwrap();
        let built = spinney::open(&path).unwrap();
        let tree = built.in_memory(1 << 20).unwrap();
        let cells = cells_of(&tree, built.header().extent);
        assert_eq!(predicted(&cells).tree.len(), 1 + 4 * tree.inner_nodes(), "{name}");
        is_that_of_the_builder(&cells, built.header().rule, built.header().kind);
    }
}
