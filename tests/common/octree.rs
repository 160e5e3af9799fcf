//! Octree files of bytes for tests of the program, and their cells.

use std::path::Path;

use spinney::raw::dataset;
use spinney::{DataKind, Dataset, Dimension, Frame, OpenOptions, Rule};

use super::{Cells, OCT, byte, write_goblin};

/// A frame whose axes all differ and whose numbers are exact in f64.
pub fn frame() -> Frame {
    let matrix = [[0.5, 0.0, 0.0, 100.0], [0.0, -0.25, 0.0, 40.0], [0.0, 0.0, 2.0, -16.0]];
    Frame { matrix, ..Frame::identity() }
}

/// Writes a file of averaged values at a cell of [`frame`].
pub fn write(path: &Path, cells: &Cells, at: [i64; 3]) {
    assert_eq!(cells.form, OCT);
    let frame = frame().shifted(at.map(|cell| cell as f64));
    write_goblin(path, cells, (Rule::Mean, DataKind::Continuous), frame);
}

pub fn open(path: &Path) -> Dataset {
    let tree = dataset::open(path, &OpenOptions::new()).unwrap();
    assert_eq!(tree.header().form.dimension, Dimension::Oct, "{} is an octree", path.display());
    tree
}

/// Verifies a file and returns all its cells.
pub fn read(path: &Path) -> Cells {
    let tree = open(path);
    assert_eq!(tree.verify(1 << 24, &()).unwrap(), [], "{}", path.display());
    assert_eq!(tree.header().form, OCT, "{}", path.display());
    let (size, bounds) = (tree.header().extent, tree.header().extent_bounds());
    let cells = bounds.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; cells], vec![false; cells]);
    tree.window(tree.depth(), &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    let cells = bytes.iter().zip(&valid).map(|(number, valid)| valid.then(|| byte(*number))).collect();
    Cells { form: OCT, size, cells }
}
