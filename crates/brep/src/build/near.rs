//! Faces with off-grid vertices, and the cells that they are near.

use super::cells::Cell;
use crate::arrangement::{ExactFace, ExactPlane};
use crate::boxes::{Bounds, bounds_of};
use spinney_base::Result;

/// Boxes and planes of faces with off-grid vertices.
///
/// Invariant: a face is near every cell within half a grid unit of one of its points along each
/// axis. It is also near every cell that one of its proxies cuts, or passes while it is moved to
/// the face. A box contains the face's vertices rounded to the grid, plus the maximum distance
/// between faces and proxies. Otherwise, operations that search pairs of faces only within cells
/// would miss some, and a cell without near faces might be neither inside nor outside completely.
pub(crate) struct NearFaces {
    list: Vec<Option<(Bounds, ExactPlane)>>,
    reach: u8,
}

impl NearFaces {
    /// Creates an empty list; proxies are at most `reach` grid units from their faces.
    pub(crate) fn new(reach: u8) -> NearFaces {
        NearFaces { list: Vec::new(), reach }
    }

    /// Adds a face. Faces are numbered in this order.
    pub(crate) fn push(&mut self, face: &ExactFace) {
        self.list.push(Some(self.bounds_and_plane(face)));
    }

    fn bounds_and_plane(&self, face: &ExactFace) -> (Bounds, ExactPlane) {
        (bounds_of(&face.rounded(), self.reach.into()), face.plane)
    }

    /// Adds `count` faces that are loaded later, when they are needed.
    pub(super) fn skip(&mut self, count: usize) {
        self.list.resize(self.list.len() + count, None);
    }

    /// Loads a skipped face, unless it was loaded already.
    pub(super) fn load(&mut self, number: u32, face: impl FnOnce() -> Result<ExactFace>) -> Result<()> {
        if self.list[number as usize].is_none() {
            self.list[number as usize] = Some(self.bounds_and_plane(&face()?));
        }
        Ok(())
    }

    /// Returns the maximum distance between faces and their proxies, in grid units.
    pub(super) fn reach(&self) -> u8 {
        self.reach
    }

    /// Bytes of memory per face.
    pub(super) const BYTES: u64 = size_of::<Option<(Bounds, ExactPlane)>>() as u64;

    pub(super) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Returns the numbers of all faces.
    pub(super) fn all(&self) -> Vec<u32> {
        self.from(0)
    }

    /// Returns the numbers of the faces from `first` on.
    pub(super) fn from(&self, first: u32) -> Vec<u32> {
        (first..self.list.len() as u32).collect()
    }

    /// Returns those of some faces that are near a cell of a grid of `bits` bits.
    pub(super) fn of(&self, faces: &[u32], cell: &Cell, bits: u8) -> Vec<u32> {
        let (min, width) = cell.bounds(bits);
        faces.iter().copied().filter(|face| self.is_near(*face, min, width)).collect()
    }

    /// Returns whether a face is near the cell that begins at `min`, in half units of the grid.
    fn is_near(&self, face: u32, min: [i64; 3], width: i64) -> bool {
        // Invariant: skipped faces are loaded before they are queried; one that is not loaded
        // counts as near.
        let Some((bounds, plane)) = &self.list[face as usize] else { return true };
        let [low, high] = bounds.map(|corner| corner.map(|at| 2 * i64::from(at)));
        // (Walls are between grid points, and so never on the side of a box.)
        if (0..3).any(|axis| high[axis] < min[axis] || min[axis] + width < low[axis]) {
            return false;
        }
        // The plane intersects the cell, extended by `reach` on all sides, if the signed distances
        // of its corners have both signs.
        let (mut middle, mut reach) = (-4 * plane.offset, 0);
        for (normal, min) in plane.normal.into_iter().zip(min) {
            middle += i128::from(normal) * i128::from(2 * min + width);
            reach += i128::from(normal.unsigned_abs()) * i128::from(width + 4 * i64::from(self.reach));
        }
        middle.abs() <= reach
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrangement::{Corner, ExactPoint};

    /// A triangle in a slanted plane is near cells along it, and not near others in its box.
    #[test]
    fn cells_near_a_triangle() {
        let corners = [[0, 0, 15], [15, 0, 0], [0, 15, 0]];
        let plane = ExactPlane::through(corners[0], [1; 3]);
        let corner = |at: [i32; 3]| Corner { point: ExactPoint::of_grid(at), line: plane };
        let face = ExactFace {
            plane,
            corners: corners.map(corner).to_vec(),
            ring_ends: vec![3],
            colours: Vec::new(),
            part: 0,
            source: 0,
        };
        let mut near = NearFaces::new(1);
        near.push(&face);
        let is_near = |level: u8, position: [u32; 3]| {
            !near.of(&[0], &Cell { level, position, winding: 0 }, 4).is_empty()
        };
        assert!(is_near(0, [0; 3]));
        // Cells of one unit: x + y + z ranges from s - 1.5 to s + 1.5 in the one at x + y + z = s.
        // `reach` adds 3 on both sides.
        for sum in 0..46u32 {
            let position = [0, 1, 2].map(|more| ((sum + more) / 3).min(15));
            let expected = (11..=19).contains(&position.iter().sum::<u32>());
            assert_eq!(is_near(4, position), expected, "{position:?}");
        }
    }
}
