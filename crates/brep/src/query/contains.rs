//! Point location: which points are inside of the body.

use crate::exact::bounds::FINE_BITS;
use crate::exact::crossing::{FinePoint, Outline, change_between};
use crate::exact::normal::ring_normal;
use crate::store::segment::LeafRule;
use crate::{ExactModel, FaceBuffer, Faces, ModelNode, ModelNodeState};
use spinney_base::Result;
use spinney_base::io::batch::{defer_missing, finish_deferred, run_batched};

/// Location of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Location {
    /// Inside of the body.
    Inside,
    /// Outside of the body.
    Outside,
    /// On a face, an edge or a vertex.
    Boundary,
}

/// Fraction bits of query points: they are rounded to a grid that is 2^32 times finer than the
/// model's.
const BITS: u32 = FINE_BITS;

impl ExactModel {
    /// Locates a point of the world: exact for the nearest point of a grid that is 2^32 times finer
    /// than the model's.
    ///
    /// The point's cell is found from the root down. If faces cut it, the cell's rule on their
    /// planes decides, or the faces between the point and the cell's minimum corner, whose state is
    /// known. (These are the incident rays of N. A. Tyukachev's set operations, with simulation of
    /// simplicity for rays through edges and vertices.)
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn locate(&self, point: [f64; 3]) -> Result<Location> {
        run_batched(|| self.locate_with(point, &mut FaceBuffer::default()))
    }

    /// Locates many points of the world, as [`ExactModel::locate`].
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn locate_all(&self, points: &[[f64; 3]], locations: &mut Vec<Location>) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        let before = locations.len();
        let found = run_batched(|| {
            locations.truncate(before);
            let mut is_unread = false;
            for point in points {
                let found = defer_missing(self.locate_with(*point, &mut buffer), &mut is_unread)?;
                locations.push(found.unwrap_or(Location::Outside));
            }
            finish_deferred(is_unread)
        });
        if found.is_err() {
            locations.truncate(before);
        }
        found
    }

    fn locate_with(&self, point: [f64; 3], buffer: &mut FaceBuffer) -> Result<Location> {
        let far = if self.is_unbounded() { Location::Inside } else { Location::Outside };
        let at = self.grid().to_grid(point).map(|at| (at * (1u64 << BITS) as f64).round_ties_even());
        let side = (1u64 << (BITS + u32::from(self.grid().bits))) as f64;
        if !at.iter().all(|at| (-side..2.0 * side).contains(at)) {
            return Ok(far);
        }
        let point = FinePoint { at: at.map(|at| at as i64), bits: BITS };
        match self.leaf_at(point.at, BITS)? {
            None => Ok(far),
            Some(node) => match self.locate_in(&node, &point, buffer)? {
                Location::Boundary => Ok(Location::Boundary),
                _ if self.touches_across(&node, &point, buffer)? => Ok(Location::Boundary),
                location => Ok(location),
            },
        }
    }

    /// Returns whether a point on the cell's lower walls is on a face of a neighbouring cell: a
    /// face through an edge of the cell may not cut the cell itself.
    fn touches_across(
        &self,
        node: &ModelNode<'_>,
        point: &FinePoint,
        buffer: &mut FaceBuffer,
    ) -> Result<bool> {
        let [min, _] = node.bounds(self.grid());
        let on_wall = [0, 1, 2].map(|axis| point.at[axis] == min[axis] << (BITS - 1));
        if on_wall == [false; 3] {
            return Ok(false);
        }
        for offset in 1..8 {
            if (0..3).any(|axis| offset >> axis & 1 == 1 && !on_wall[axis]) {
                continue;
            }
            let at = [0, 1, 2].map(|axis| point.at[axis] - (offset >> axis & 1));
            let Some(other) = self.leaf_at(at, BITS)? else { continue };
            for face in other.faces() {
                self.face(face, buffer)?;
                if outline(buffer).has(point) {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// Locates a point in a cell without children.
    fn locate_in(
        &self,
        node: &ModelNode<'_>,
        point: &FinePoint,
        buffer: &mut FaceBuffer,
    ) -> Result<Location> {
        let (rule, inside) = match node.state() {
            ModelNodeState::Leaf { rule, inside, .. } => (rule, inside),
            ModelNodeState::Full => return Ok(Location::Inside),
            _ => return Ok(Location::Outside),
        };
        let [min, _] = node.bounds(self.grid());
        let shift = BITS - 1;
        let corner = FinePoint { at: min.map(|at| at << shift), bits: BITS };
        let mut winding = i32::from(inside);
        let (mut all, mut any) = (true, false);
        for face in node.faces() {
            self.face(face, buffer)?;
            let outline = outline(buffer);
            let side = outline.side(point);
            if side == 0 && outline.has(point) {
                return Ok(Location::Boundary);
            }
            match rule {
                LeafRule::Crossings => winding += change_between(&outline, &corner, point),
                // (A point on the plane, but not on the face, is decided by the other faces.)
                _ => {
                    all &= side < 0;
                    any |= side < 0;
                }
            }
        }
        let inside = match rule {
            LeafRule::All => all,
            LeafRule::Any => any,
            LeafRule::Crossings => winding == 1,
        };
        Ok(if inside { Location::Inside } else { Location::Outside })
    }
}

/// Returns a face as input of crossing tests.
fn outline(buffer: &FaceBuffer) -> Outline<'_> {
    let normal = ring_normal(&buffer.points[..buffer.ring_ends[0]]);
    Outline { points: &buffer.points, ring_ends: &buffer.ring_ends, normal }
}
