//! Octree files of bytes for tests of the program, and what is in them.

use std::path::Path;

use spinney::query::Tree;
use spinney::space::{Bounds, Frame, Oct};
use spinney::store::goblin::OpenOptions;
use spinney::value::{Kind, Rule};

use super::{Cells, write_goblin};

pub type Byte = [u8; 1];

/// A place in the world in which no axis is like another and no number is rounded.
pub fn frame() -> Frame {
    let matrix = [[0.5, 0.0, 0.0, 100.0], [0.0, -0.25, 0.0, 40.0], [0.0, 0.0, 2.0, -16.0]];
    Frame { matrix, ..Frame::identity() }
}

/// Makes a file in which values are averaged, at some cell of [`frame`].
pub fn write(path: &Path, cells: &Cells<Byte>, at: [i64; 3]) {
    let frame = frame().shifted(at.map(|cell| cell as f64));
    write_goblin::<Oct, Byte>(path, cells, (Rule::Mean, Kind::Continuous), frame);
}

pub fn open(path: &Path) -> Box<dyn Tree> {
    let tree = spinney::query::open(path, &OpenOptions::default()).unwrap();
    assert_eq!(tree.header().axes, 3, "{} is an octree", path.display());
    tree
}

/// All cells of a file, which has to be in order.
pub fn read(path: &Path) -> Cells<Byte> {
    let tree = open(path);
    assert_eq!(tree.verify(1 << 24, &()).unwrap(), [], "{}", path.display());
    let size = tree.header().extent;
    let bounds = Bounds { min: [0; 3], max: size };
    let cells = bounds.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; cells], vec![false; cells]);
    tree.window(tree.depth(), &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    let cells = bytes.iter().zip(&valid).map(|(byte, valid)| valid.then_some([*byte])).collect();
    Cells { size, cells }
}
