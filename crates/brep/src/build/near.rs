//! Faces with corners beside the grid, and which cells they are near.

use super::cells::Cell;
use crate::arrangement::{ExactFace, ExactPlane};
use crate::boxes::{Bounds, bounds_of};
use spinney_base::Result;

/// Boxes and planes of faces with corners beside the grid.
///
/// Invariant: a face is near every cell that is within half a step of one of its points, along each axis, and near every cell that
/// a face standing in for a part of it cuts, or comes to by moving to the face. Boxes have the corners of the grid that are nearest
/// to the face's, and as many steps more as faces may lie beside those that they stand in for. Operations that look for pairs of
/// faces in cells alone would miss some otherwise, and cells that no face is near would not be what the octree says.
pub(crate) struct NearFaces {
    list: Vec<Option<(Bounds, ExactPlane)>>,
    reach: u8,
}

impl NearFaces {
    /// None so far; faces that stand in for them lie at most so many steps beside them.
    pub(crate) fn new(reach: u8) -> NearFaces {
        NearFaces { list: Vec::new(), reach }
    }

    /// Adds a face, whose number is that of those before it.
    pub(crate) fn push(&mut self, face: &ExactFace) {
        self.list.push(Some(self.place(face)));
    }

    fn place(&self, face: &ExactFace) -> (Bounds, ExactPlane) {
        (bounds_of(&face.rounded(), self.reach.into()), face.plane)
    }

    /// Leaves out so many faces, which are told when they are asked for.
    pub(super) fn skip(&mut self, count: usize) {
        self.list.resize(self.list.len() + count, None);
    }

    /// Tells a face that was left out, if it was not told yet.
    pub(super) fn tell(&mut self, number: u32, face: impl FnOnce() -> Result<ExactFace>) -> Result<()> {
        if self.list[number as usize].is_none() {
            self.list[number as usize] = Some(self.place(&face()?));
        }
        Ok(())
    }

    /// Steps that faces lie at most beside those that they stand in for.
    pub(super) fn reach(&self) -> u8 {
        self.reach
    }

    /// Bytes of memory that a face takes.
    pub(super) const BYTES: u64 = size_of::<Option<(Bounds, ExactPlane)>>() as u64;

    pub(super) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Numbers of all faces.
    pub(super) fn all(&self) -> Vec<u32> {
        self.from(0)
    }

    /// Numbers of the faces from one on.
    pub(super) fn from(&self, first: u32) -> Vec<u32> {
        (first..self.list.len() as u32).collect()
    }

    /// Those of some faces that are near a cell of a grid of so many bits.
    pub(super) fn of(&self, faces: &[u32], cell: &Cell, bits: u8) -> Vec<u32> {
        let (min, width) = cell.bounds(bits);
        faces.iter().copied().filter(|face| self.is_near(*face, min, width)).collect()
    }

    /// Whether a face is near a cell from `min` on, of a width, in half units of the grid.
    fn is_near(&self, face: u32, min: [i64; 3], width: i64) -> bool {
        // Invariant: whoever asks for a face that was left out has told it.
        let Some((bounds, plane)) = &self.list[face as usize] else { return true };
        let [low, high] = bounds.map(|corner| corner.map(|at| 2 * i64::from(at)));
        // (Walls lie between points of the grid, and so never at the side of a box.)
        if (0..3).any(|axis| high[axis] < min[axis] || min[axis] + width < low[axis]) {
            return false;
        }
        // The plane passes the cell with as many steps more on all sides, if its products with corners of that have both signs.
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
        // Cells of a unit: x + y + z is from s - 1.5 to s + 1.5 in the one at x + y + z = s, and 3 more either way beside it.
        for sum in 0..46u32 {
            let position = [0, 1, 2].map(|more| ((sum + more) / 3).min(15));
            let expected = (11..=19).contains(&position.iter().sum::<u32>());
            assert_eq!(is_near(4, position), expected, "{position:?}");
        }
    }
}
