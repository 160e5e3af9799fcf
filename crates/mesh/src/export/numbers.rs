//! Vertices that blocks share.

use std::collections::{BTreeMap, HashMap};

use super::sink::Vertex;
use spinney_base::space::{Dimension, morton_encode};

/// Morton code of a block: its position in Z order.
pub(super) fn z_order(block: [u32; 3]) -> u64 {
    block
        .into_iter()
        .enumerate()
        .fold(0, |order, (axis, cell)| order | morton_encode(Dimension::Oct, cell) << axis)
}

/// Vertices on block boundaries, kept until the last block that may request them is done.
#[derive(Default)]
pub(super) struct Shared {
    vertices: HashMap<u64, Vertex>,
    /// Keys of the vertices to drop when the block at this position in Z order is done.
    due: BTreeMap<u64, Vec<u64>>,
}

/// Grid point as an integer: 21 bits per axis hold -1 and coordinates up to 2^19, including the far
/// boundary.
fn key(point: [u32; 3]) -> u64 {
    point.into_iter().fold(0, |key, cell| key << 21 | u64::from(cell.wrapping_add(1)))
}

impl Shared {
    pub(super) fn get(&self, point: [u32; 3]) -> Option<Vertex> {
        self.vertices.get(&key(point)).copied()
    }

    /// Stores a vertex. `last` is the position in Z order of the last block that may request it.
    pub(super) fn put(&mut self, point: [u32; 3], vertex: Vertex, last: u64) {
        self.vertices.insert(key(point), vertex);
        self.due.entry(last).or_default().push(key(point));
    }

    /// Drops the vertices that only blocks up to this position in Z order may request.
    pub(super) fn done(&mut self, position: u64) {
        while let Some(first) = self.due.first_entry().filter(|first| *first.key() <= position) {
            for key in first.remove() {
                self.vertices.remove(&key);
            }
        }
    }
}
