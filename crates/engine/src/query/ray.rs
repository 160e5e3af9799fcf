//! Rays through octrees: the first full cell, and the smooth surface that the cells stand for.
//!
//! A ray goes from uniform block to uniform block, as large as the tree has them, finding each by its
//! coordinates: the scheme of Glassner (Space subdivision for fast ray tracing, IEEE Computer Graphics and
//! Applications 4(10), 1984), with the way down remembered from block to block instead of a hash table, and
//! whole numbers for the cells so that rounding can neither skip a block nor stay in one.

use super::field::Field;
use super::occupancy::{HALF, OccupancyBlock};
use spinney_base::Result;

/// The surface is where the density between cells is this; at levels above the finest it is where it is this.
///
/// Walls that are thinner than a cell would be gone with one half. With a quarter, walls of a quarter of a
/// cell stay, and solids are fatter by about half a cell, which is less than a pixel.
const SURFACE: f64 = 0.5;
const COARSE_SURFACE: f64 = 0.25;
/// Steps along a ray in search of the surface, in cells.
const STRIDE: f64 = 0.5;
/// Radius of the ball of cells that a surface's normal comes from.
const REACH: f64 = 3.5;
/// Halvings of the last step.
const HALVINGS: usize = 7;

/// A half-line, in cells of the level that it is cast through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The first point; may be outside the tree's space.
    pub origin: [f64; 3],
    /// The direction that it goes in, of any length but 0.
    pub direction: [f64; 3],
}

impl Ray {
    /// The point after so many times the direction.
    #[inline]
    pub fn at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|axis| self.origin[axis] + t * self.direction[axis])
    }
}

/// A cell that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellHit {
    /// Distance along the ray at which it is entered, in lengths of the direction; 0 if the ray starts in it.
    pub t: f64,
    /// The cell.
    pub cell: [u32; 3],
    /// The axis across which the ray enters; `None` if it starts in the cell.
    pub axis: Option<usize>,
    /// The cell's samples, as in [`Dataset::point`](crate::dataset::Dataset::point).
    pub value: [f64; 4],
}

/// A point where a ray meets the smooth surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// Distance along the ray, in lengths of the direction.
    pub t: f64,
    /// The point, in cells.
    pub point: [f64; 3],
    /// Direction in which occupancy grows, inwards, of any length: see [`Rays::surface`].
    pub inwards: [f64; 3],
    /// Samples of the cell that was found there.
    pub value: [f64; 4],
}

/// Casts rays through one level of an octree. One thread at a time, because it remembers where it was; the
/// answers do not depend on that.
pub trait Rays: Send {
    /// The first cell along a ray that is at least half full; for trees other than of
    /// [`Rule::Occupancy`](spinney_base::value::Rule::Occupancy) the first that is not VOID.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn cell(&mut self, ray: &Ray) -> Result<Option<CellHit>>;

    /// The first point along a ray where the occupancy, taken as linear between the cells' centres, is one
    /// half, with its gradient from all cells in a ball of 3.5 cells: shading shows no steps where cells are
    /// small. At levels above the finest it is one quarter, so that walls which are thinner than a cell there
    /// do not vanish.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn surface(&mut self, ray: &Ray) -> Result<Option<SurfaceHit>>;

    /// Occupancy around a point, 0 to 1, linear between the centres of cells.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn density(&mut self, point: [f64; 3]) -> Result<f64>;
}

impl Rays for Field<'_> {
    fn cell(&mut self, ray: &Ray) -> Result<Option<CellHit>> {
        self.along(ray, |_, step, value| {
            let hit = CellHit { t: step.from, cell: step.cell, axis: step.axis, value };
            Ok((step.block.fill >= HALF).then_some(hit))
        })
    }

    fn surface(&mut self, ray: &Ray) -> Result<Option<SurfaceHit>> {
        let length = ray.direction.iter().map(|number| number * number).sum::<f64>().sqrt();
        let (stride, back) = (STRIDE / length, 1.0 / length);
        let surface = if self.is_finest() { SURFACE } else { COARSE_SURFACE };
        let found = self.along(ray, |field, step, value| {
            if step.block.fill == 0 {
                return Ok(None);
            }
            let mut t = step.from;
            let mut before = (step.from - back).max(0.0);
            loop {
                if field.density(ray.at(t))? >= surface {
                    return Ok(Some((before, t, value)));
                }
                if t >= step.to {
                    return Ok(None);
                }
                before = t;
                t = (t + stride).min(step.to);
            }
        })?;
        let Some((mut outside, mut inside, value)) = found else { return Ok(None) };
        // The surface can lie before the first cell that has something, farther along a grazing ray.
        for _ in 0..4 {
            if outside > 0.0 && self.density(ray.at(outside))? >= surface {
                inside = outside;
                outside = (outside - back).max(0.0);
            }
        }
        if self.density(ray.at(outside))? >= surface {
            // It starts inside.
            outside = inside;
        }
        for _ in 0..HALVINGS {
            let middle = outside.midpoint(inside);
            if self.density(ray.at(middle))? >= surface { inside = middle } else { outside = middle }
        }
        let point = ray.at(inside);
        let inwards = self.gradient(point, REACH)?;
        Ok(Some(SurfaceHit { t: inside, point, inwards, value }))
    }

    fn density(&mut self, point: [f64; 3]) -> Result<f64> {
        Field::density(self, point)
    }
}

/// A block on a ray's way.
struct Step {
    block: OccupancyBlock,
    /// The cell in which the ray enters it.
    cell: [u32; 3],
    /// Distances at which the ray enters and leaves.
    from: f64,
    to: f64,
    /// Across which axis.
    axis: Option<usize>,
}

impl Field<'_> {
    /// Shows the blocks along a ray that are not VOID, with their samples, from near to far, until `visit`
    /// has found something.
    fn along<T>(
        &mut self,
        ray: &Ray,
        mut visit: impl FnMut(&mut Self, Step, [f64; 4]) -> Result<Option<T>>,
    ) -> Result<Option<T>> {
        let side = self.side();
        let Some((mut from, mut axis)) = entry(ray, f64::from(side)) else { return Ok(None) };
        let start = ray.at(from);
        let mut cell: [u32; 3] = std::array::from_fn(|axis| (start[axis].floor() as u32).min(side - 1));
        if let Some(axis) = axis {
            cell[axis] = if ray.direction[axis] > 0.0 { 0 } else { side - 1 };
        }
        loop {
            let block = self.block(cell)?;
            // Where the ray leaves: at the first of the three far planes.
            let (mut to, mut out) = (f64::INFINITY, 0);
            for axis in 0..3 {
                let (speed, min) = (ray.direction[axis], block.min[axis]);
                if speed != 0.0 {
                    let plane = if speed > 0.0 { min + block.side } else { min };
                    let t = (f64::from(plane) - ray.origin[axis]) / speed;
                    if t < to {
                        (to, out) = (t, axis);
                    }
                }
            }
            let to = to.max(from);
            if let Some(value) = block.value
                && let Some(found) = visit(self, Step { block, cell, from, to, axis }, value)?
            {
                return Ok(Some(found));
            }
            // Rounding may put the exit outside of the block: it is clamped to the block along the other
            // axes, and the axis that the ray leaves across gets the neighbour's cell as a whole number. So
            // each turn goes to an adjacent block.
            let exit = ray.at(to);
            for axis in 0..3 {
                let last = block.min[axis] + block.side - 1;
                cell[axis] = (exit[axis].floor() as u32).clamp(block.min[axis], last);
            }
            let next = if ray.direction[out] > 0.0 {
                Some(block.min[out] + block.side).filter(|next| *next < side)
            } else {
                block.min[out].checked_sub(1)
            };
            let Some(next) = next.filter(|_| to.is_finite()) else { return Ok(None) };
            cell[out] = next;
            (from, axis) = (to, Some(out));
        }
    }
}

/// Distance at which a ray enters a cube from 0 to `side`, and the axis across which; `None` if it misses it.
fn entry(ray: &Ray, side: f64) -> Option<(f64, Option<usize>)> {
    let (mut from, mut to, mut across) = (0.0, f64::INFINITY, None);
    for axis in 0..3 {
        let (start, speed) = (ray.origin[axis], ray.direction[axis]);
        if speed == 0.0 {
            if !(0.0..side).contains(&start) {
                return None;
            }
            continue;
        }
        let (near, far) = if speed > 0.0 { (0.0, side) } else { (side, 0.0) };
        let (enters, leaves) = ((near - start) / speed, (far - start) / speed);
        if enters > from {
            (from, across) = (enters, Some(axis));
        }
        to = leaves.min(to);
    }
    (from < to && from.is_finite()).then_some((from, across))
}
