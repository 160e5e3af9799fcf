//! Casts rays through octrees: finds the first full cell, and the smooth surface that the cells
//! approximate.
//!
//! A ray advances from uniform block to uniform block, as large as the tree has them, and finds
//! each by its coordinates. This is the scheme of Glassner (Space subdivision for fast ray tracing,
//! IEEE Computer Graphics and Applications 4(10), 1984), with a cached path from the root instead
//! of a hash table. Cells are integers, so rounding can neither skip a block nor stay in one.

use super::field::Field;
use super::occupancy::{BRICK, HALF, OccupancyBlock};
use spinney_base::Result;

/// Density of the surface at the finest level (`SURFACE`) and at coarser levels.
///
/// With one half, walls thinner than a cell would vanish at coarser levels. With a quarter, walls
/// of a quarter of a cell stay, and solids grow by about half a cell, which is less than a pixel.
const SURFACE: f64 = 0.5;
const COARSE_SURFACE: f64 = 0.25;
/// Step length along a ray in search of the surface, in cells.
const STRIDE: f64 = 0.5;
/// Number of densities to evaluate in the last step, before the result is interpolated linearly
/// between the last two.
const REFINEMENTS: usize = 3;

/// A half-line, in cells of the level that it is cast through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// First point; may be outside of the tree's space.
    pub origin: [f64; 3],
    /// Direction, of any nonzero length.
    pub direction: [f64; 3],
}

impl Ray {
    /// Returns the point at `t` times the direction.
    #[inline]
    pub fn at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|axis| self.origin[axis] + t * self.direction[axis])
    }
}

/// A cell hit by a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellHit {
    /// Distance along the ray where it enters the cell, in lengths of the direction; 0 if the ray
    /// starts in it.
    pub t: f64,
    /// The cell.
    pub cell: [u32; 3],
    /// Axis across which the ray enters; `None` if it starts in the cell.
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
    /// Direction of increasing occupancy, inwards, of any length: see [`Rays::surface`].
    pub inwards: [f64; 3],
    /// The nonempty cell that was found there. The surface may be slightly before it.
    pub cell: [u32; 3],
}

/// Casts rays through one level of an octree. It caches its last location and is therefore for one
/// thread at a time. Results do not depend on the cache.
pub trait Rays: Send {
    /// Returns the first cell along a ray that is at least half full. In trees of other rules than
    /// [`Rule::Occupancy`](spinney_base::value::Rule::Occupancy), it is the first cell that is not
    /// VOID.
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn cell(&mut self, ray: &Ray) -> Result<Option<CellHit>>;

    /// Returns the first point along a ray where the occupancy, interpolated linearly between cell
    /// centres, is one half. Its gradient comes from all cells in a ball of radius 3.5 cells, so
    /// that shading shows no stair steps where cells are small. At levels above the finest, the
    /// surface is at one quarter, so that walls thinner than a cell do not vanish there.
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn surface(&mut self, ray: &Ray) -> Result<Option<SurfaceHit>>;

    /// Returns the occupancy at a point, 0 to 1, interpolated linearly between cell centres.
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn density(&mut self, point: [f64; 3]) -> Result<f64>;

    /// Returns the samples of a cell inside the space, as in
    /// [`Dataset::point`](crate::dataset::Dataset::point); zeros if it is VOID.
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn value(&mut self, cell: [u32; 3]) -> Result<[f64; 4]>;
}

impl Rays for Field<'_> {
    fn cell(&mut self, ray: &Ray) -> Result<Option<CellHit>> {
        self.along(ray, 0, |_, step| {
            let Some(value) = step.block.value.filter(|_| step.block.fill >= HALF) else { return Ok(None) };
            Ok(Some(CellHit { t: step.from, cell: step.cell, axis: step.axis, value }))
        })
    }

    fn surface(&mut self, ray: &Ray) -> Result<Option<SurfaceHit>> {
        let length = ray.direction.iter().map(|number| number * number).sum::<f64>().sqrt();
        let surface = if self.is_finest() { SURFACE } else { COARSE_SURFACE };
        let mut search = Search {
            ray: *ray,
            stride: STRIDE / length,
            back: 1.0 / length,
            surface,
            evaluated: (-1.0, 0.0),
        };
        // Divided bricks are traversed cell by cell without reading the tree: they are cached for
        // densities anyway.
        let found = self.along(ray, BRICK, |field, step| match step.block {
            OccupancyBlock { is_uniform: true, fill: 0, .. } => Ok(None),
            OccupancyBlock { is_uniform: true, .. } => {
                Ok(search.between(field, step.from, step.to)?.map(|found| (found, step.cell)))
            }
            _ => search.in_brick(field, step),
        })?;
        let Some((Bracket { mut outside, known, mut inside }, cell)) = found else { return Ok(None) };
        let mut without = known.map_or_else(|| self.density(ray.at(outside)), Ok)?;
        // The surface can be before the first nonempty cell, farther away on a grazing ray.
        for _ in 0..4 {
            if outside > 0.0 && without >= surface {
                inside = (outside, without);
                outside = (outside - search.back).max(0.0);
                without = self.density(ray.at(outside))?;
            }
        }
        // (If the density never drops below the surface's, the ray starts inside.)
        let t =
            if without < surface { self.refined(ray, (outside, without), inside, surface)? } else { outside };
        let point = ray.at(t);
        let inwards = self.gradient(point)?;
        Ok(Some(SurfaceHit { t, point, inwards, cell }))
    }

    fn density(&mut self, point: [f64; 3]) -> Result<f64> {
        Field::density(self, point)
    }

    fn value(&mut self, cell: [u32; 3]) -> Result<[f64; 4]> {
        Ok(self.block(cell, 0)?.value.unwrap_or_default())
    }
}

/// Search for the surface along a ray.
struct Search {
    ray: Ray,
    /// Distance between evaluated densities, and the size of a cell, in lengths of the direction.
    stride: f64,
    back: f64,
    /// Density at the surface.
    surface: f64,
    /// Distance of the last evaluated density, and the density, which is below the surface's.
    evaluated: (f64, f64),
}

/// Points before and after the surface.
struct Bracket {
    outside: f64,
    /// The density there, if it was evaluated.
    known: Option<f64>,
    /// Distance and density.
    inside: (f64, f64),
}

impl Search {
    /// Searches for the surface between two distances.
    fn between(&mut self, field: &mut Field<'_>, from: f64, to: f64) -> Result<Option<Bracket>> {
        let (mut outside, mut known, mut t) = ((from - self.back).max(0.0), None, from);
        if self.evaluated.0 >= from {
            (outside, known) = (self.evaluated.0, Some(self.evaluated.1));
            t = (outside + self.stride).min(to);
        }
        while t > self.evaluated.0 {
            let density = field.density(self.ray.at(t))?;
            if density >= self.surface {
                return Ok(Some(Bracket { outside, known, inside: (t, density) }));
            }
            self.evaluated = (t, density);
            (outside, known) = (t, Some(density));
            t = (t + self.stride).min(to);
        }
        Ok(None)
    }

    /// Searches for the surface in the nonempty cells of a brick. Also returns the cell.
    ///
    /// Advances from cell to cell across the nearest plane and stores the distance of the next
    /// plane along each axis (Amanatides and Woo, A fast voxel traversal algorithm for ray tracing,
    /// Eurographics 1987).
    fn in_brick(
        &mut self,
        field: &mut Field<'_>,
        step: &BlockCrossing,
    ) -> Result<Option<(Bracket, [u32; 3])>> {
        let Ray { origin, direction } = self.ray;
        let OccupancyBlock { min, side, .. } = step.block;
        let mut cell = step.cell;
        let mut next: [f64; 3] = std::array::from_fn(|axis| {
            let plane = cell[axis] + u32::from(direction[axis] > 0.0);
            let t = (f64::from(plane) - origin[axis]) / direction[axis];
            if direction[axis] == 0.0 { f64::INFINITY } else { t }
        });
        let spacing = direction.map(|speed| (1.0 / speed).abs());
        // Invariant: densities are only evaluated in this brick and its neighbours, which do not
        // evict it.
        let start = field.brick(cell.map(|cell| cell >> BRICK))?;
        let mut from = step.from;
        loop {
            let nearest = |a: usize, b: usize| if next[b] < next[a] { b } else { a };
            let out = nearest(nearest(0, 1), 2);
            // (Rounding must not lead backwards or out of the brick.)
            let to = next[out].clamp(from, step.to);
            if field.fill_in(start, cell) > 0
                && let Some(found) = self.between(field, from, to)?
            {
                return Ok(Some((found, cell)));
            }
            let onwards = if direction[out] > 0.0 { cell[out] + 1 } else { cell[out].wrapping_sub(1) };
            if onwards.wrapping_sub(min[out]) >= side || to >= step.to {
                return Ok(None);
            }
            cell[out] = onwards;
            next[out] += spacing[out];
            from = to;
        }
    }
}

/// A block on a ray's path.
struct BlockCrossing {
    block: OccupancyBlock,
    /// The cell where the ray enters it.
    cell: [u32; 3],
    /// Distances at which the ray enters and leaves it.
    from: f64,
    to: f64,
    /// Axis across which the ray enters it.
    axis: Option<usize>,
}

impl Field<'_> {
    /// Returns the distance where the density along a ray equals the surface's, between a point
    /// with less and one with at least as much. Uses false position, and halves the density at an
    /// end that stays (the Illinois algorithm: Dowell and Jarratt, BIT 11, 1971).
    fn refined(&mut self, ray: &Ray, outside: (f64, f64), inside: (f64, f64), surface: f64) -> Result<f64> {
        // Invariant: the density at the first end is less than the surface's, and at the second end
        // at least that. So there is no division by zero, and the result is between the ends.
        let mut ends = [outside, inside].map(|(t, density)| (t, density - surface));
        let meeting = |[(a, less), (b, more)]: [(f64, f64); 2]| a + less / (less - more) * (b - a);
        let mut moved = None;
        for _ in 0..REFINEMENTS {
            let t = meeting(ends);
            let above = self.density(ray.at(t))? - surface;
            let end = usize::from(above >= 0.0);
            ends[end] = (t, above);
            if moved == Some(end) {
                ends[1 - end].1 /= 2.0;
            }
            moved = Some(end);
        }
        Ok(meeting(ends))
    }

    /// Visits the blocks along a ray from near to far, until `visit` returns a result: uniform
    /// blocks, or blocks of `2^smallest` cells along each axis where these are divided.
    fn along<T>(
        &mut self,
        ray: &Ray,
        smallest: u8,
        mut visit: impl FnMut(&mut Self, &BlockCrossing) -> Result<Option<T>>,
    ) -> Result<Option<T>> {
        let side = self.side();
        let Some((mut from, mut axis)) = entry(ray, f64::from(side)) else { return Ok(None) };
        let start = ray.at(from);
        let mut cell: [u32; 3] = std::array::from_fn(|axis| (start[axis] as u32).min(side - 1));
        if let Some(axis) = axis {
            cell[axis] = if ray.direction[axis] > 0.0 { 0 } else { side - 1 };
        }
        loop {
            let block = self.block(cell, smallest)?;
            // The ray leaves at the first of the three far planes.
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
            if let Some(found) = visit(self, &BlockCrossing { block, cell, from, to, axis })? {
                return Ok(Some(found));
            }
            // Rounding may put the exit outside of the block. It is clamped to the block along the
            // other axes, and along the exit axis it gets the neighbour's integer cell. So each
            // iteration advances to an adjacent block.
            let exit = ray.at(to);
            for axis in 0..3 {
                let last = block.min[axis] + block.side - 1;
                cell[axis] = (exit[axis] as u32).clamp(block.min[axis], last);
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

/// Returns the distance at which a ray enters a cube from 0 to `side` and the axis of the entry, or
/// `None` if the ray misses the cube.
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
