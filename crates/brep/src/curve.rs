//! A space-filling curve through the grid: the Z order. Faces that are close on it are close in
//! space.

use std::ops::Range;

use crate::boxes::Bounds;
use crate::{Face, MAX_BITS};
use spinney_base::space::{Dimension, morton_encode};

/// Bits per axis of positions on the curve.
const CURVE_BITS: u8 = 21;

/// Returns the position of a face on a grid of `bits` bits: that of its first vertex in the order
/// of coordinates.
pub(crate) fn position(face: &Face<'_>, bits: u8) -> u64 {
    let least = face.points.iter().min().copied().unwrap_or_default();
    let shift = bits.saturating_sub(CURVE_BITS);
    z_order(least.map(|at| at as u32 >> shift))
}

/// Returns the positions of the points in a cell of the octree.
pub(crate) fn positions_in(level: u8, cell: [u32; 3], bits: u8) -> Range<u64> {
    let (first, shift) = (z_order(cell), 3 * (bits.min(CURVE_BITS) - level));
    first << shift..(first + 1) << shift
}

/// Returns the position of a box's centre, on a grid of the maximum bits.
pub(crate) fn position_of_centre([low, high]: &Bounds) -> u64 {
    let shift = MAX_BITS - CURVE_BITS;
    z_order([0, 1, 2].map(|axis| ((low[axis] + high[axis]) / 2) as u32 >> shift))
}

fn z_order(at: [u32; 3]) -> u64 {
    let [x, y, z] = at.map(|at| morton_encode(Dimension::Oct, at));
    x | y << 1 | z << 2
}
