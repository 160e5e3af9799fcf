//! Regions of space for queries.

use crate::grid::PointGrid;
use spinney_base::Result;
use spinney_base::space::{Bounds, Cover};
use spinney_overlay::Polygon;

/// Region in the coordinates of the points. Borders are included, except for polygons, whose
/// borders may be in or out.
#[derive(Clone, Debug, PartialEq)]
pub enum PointRegion {
    /// All of space.
    All,
    /// Box, by its minimum and maximum corners.
    Box([[f64; 3]; 2]),
    /// Vertical prisms over polygons, unbounded in z. Each polygon is an outer ring and its holes.
    Polygons(Vec<Vec<Vec<[f64; 2]>>>),
    /// Ball, by its centre and radius.
    Ball([f64; 3], f64),
}

/// Region on a tree's grid.
pub(crate) enum GridRegion {
    All,
    Nothing,
    /// Minimum and maximum positions.
    Box([[i32; 3]; 2]),
    /// In grid units from the root's corner.
    Polygon(Box<Polygon>),
    Ball([f64; 3], f64),
}

impl PointRegion {
    /// Converts the region to a tree's grid.
    ///
    /// # Errors
    /// If a ring has fewer than three vertices, or a vertex that is not a number.
    pub(crate) fn on(&self, grid: &PointGrid) -> Result<GridRegion> {
        Ok(match self {
            PointRegion::All => GridRegion::All,
            PointRegion::Box(corners) => grid.grid_box(*corners).map_or(GridRegion::Nothing, GridRegion::Box),
            PointRegion::Ball(centre, radius) => GridRegion::Ball(*centre, *radius),
            // Reprojected polygons may be empty near the tree.
            PointRegion::Polygons(parts) if parts.is_empty() => GridRegion::Nothing,
            PointRegion::Polygons(parts) => {
                let step = |at: [f64; 2]| -> [f64; 2] {
                    std::array::from_fn(|axis| {
                        (at[axis] - grid.offset[axis]) / grid.scale[axis] - f64::from(grid.corner[axis])
                    })
                };
                let parts: Vec<Vec<Vec<[f64; 2]>>> = parts
                    .iter()
                    .map(|part| part.iter().map(|ring| ring.iter().map(|at| step(*at)).collect()).collect())
                    .collect();
                GridRegion::Polygon(Box::new(Polygon::of_parts(&parts)?))
            }
        })
    }
}

impl GridRegion {
    /// Returns how the region covers the positions of a box.
    pub(crate) fn cover(&self, grid: &PointGrid, [least, most]: [[i32; 3]; 2]) -> Cover {
        match self {
            GridRegion::All => Cover::Whole,
            GridRegion::Nothing => Cover::Nothing,
            GridRegion::Box([low, high]) => {
                let axes = || 0..3;
                if axes().any(|axis| most[axis] < low[axis] || least[axis] > high[axis]) {
                    Cover::Nothing
                } else if axes().all(|axis| low[axis] <= least[axis] && most[axis] <= high[axis]) {
                    Cover::Whole
                } else {
                    Cover::Partial
                }
            }
            GridRegion::Polygon(polygon) => {
                let step = |position: i32, axis: usize| {
                    (i64::from(position) - i64::from(grid.corner[axis])).max(0) as u64
                };
                let min = [step(least[0], 0), step(least[1], 1), 0];
                let max = [step(most[0], 0) + 1, step(most[1], 1) + 1, 1];
                polygon.cover_area(&Bounds { min, max })
            }
            GridRegion::Ball(centre, radius) => {
                let (near, far) = distances(grid, *centre, [least, most]);
                let square = radius * radius;
                if near > square {
                    Cover::Nothing
                } else if far <= square {
                    Cover::Whole
                } else {
                    Cover::Partial
                }
            }
        }
    }

    /// Returns whether a position is in the region.
    #[inline]
    pub(crate) fn has(&self, grid: &PointGrid, position: [i32; 3]) -> bool {
        match self {
            GridRegion::All => true,
            GridRegion::Nothing => false,
            GridRegion::Box([low, high]) => {
                (0..3).all(|axis| low[axis] <= position[axis] && position[axis] <= high[axis])
            }
            GridRegion::Polygon(polygon) => {
                let step = |axis: usize| f64::from(position[axis]) - f64::from(grid.corner[axis]);
                polygon.contains([step(0), step(1)])
            }
            GridRegion::Ball(centre, radius) => {
                let at = grid.to_world(position);
                let square: f64 = (0..3).map(|axis| (at[axis] - centre[axis]).powi(2)).sum();
                square <= radius * radius
            }
        }
    }
}

/// Returns the squares of the minimum and maximum world distance between a point and a box.
pub(crate) fn distances(grid: &PointGrid, from: [f64; 3], [least, most]: [[i32; 3]; 2]) -> (f64, f64) {
    let (low, high) = (grid.to_world(least), grid.to_world(most));
    let (mut near, mut far) = (0.0, 0.0);
    for axis in 0..3 {
        let (below, above) = (low[axis] - from[axis], from[axis] - high[axis]);
        near += below.max(above).max(0.0).powi(2);
        far += below.abs().max(above.abs()).powi(2);
    }
    (near, far)
}
