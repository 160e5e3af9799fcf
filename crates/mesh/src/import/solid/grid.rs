//! Fixed-point grid that vertices are snapped to, so that all later decisions use integer
//! arithmetic.

use std::path::Path;

use glam::DVec3;

use spinney_base::space::{Dimension, morton_encode};
use spinney_base::{Error, Result};
use spinney_brep::exact::bounds::SOLID_BITS;
use spinney_brep::exact::normal::triangle_normal;
use spinney_crs::Frame;

/// Maximum number of fraction bits; precision beyond a millionth of a cell is useless.
const FRACTION: u8 = 20;

/// Sort key under which neighbouring points are close to each other.
pub(super) fn place_key(at: [i32; 3]) -> u64 {
    // Coordinates range from minus the space's side to twice the side.
    let cell = |axis: usize| ((i64::from(at[axis]) + (1 << SOLID_BITS)) >> 10) as u32;
    (0..3).fold(0, |key, axis| key | morton_encode(Dimension::Oct, cell(axis)) << axis)
}

/// Triangle on the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Triangle {
    /// Counterclockwise seen from outside the solid.
    pub(super) corners: [[i32; 3]; 3],
    /// Value of the cells on its inner side: a part number, or a colour as 0x00RRGGBB; 0 for
    /// occupancy.
    pub(super) attribute: u32,
    /// Number of its part, from 1.
    pub(super) part: u32,
}

impl Triangle {
    /// Centroid.
    pub(super) fn middle(&self) -> DVec3 {
        self.corners.iter().map(|corner| DVec3::from_array(corner.map(f64::from))).sum::<DVec3>() / 3.0
    }

    /// Normal vector, whose length is twice the area.
    #[inline]
    pub(super) fn normal(&self) -> [i64; 3] {
        triangle_normal(&self.corners)
    }

    /// Minimum coordinate along an axis.
    #[inline]
    pub(super) fn min(&self, axis: usize) -> i32 {
        let [a, b, c] = self.corners;
        a[axis].min(b[axis]).min(c[axis])
    }

    /// Maximum coordinate along an axis.
    #[inline]
    pub(super) fn max(&self, axis: usize) -> i32 {
        let [a, b, c] = self.corners;
        a[axis].max(b[axis]).max(c[axis])
    }
}

impl Triangle {
    /// Moves a triangle that lies exactly in a wall between cells to the middle of the cells on its
    /// inner side. If these are outside of the tree, moves it to the cells on its outer side.
    pub(super) fn leave_wall(&mut self, grid: &Grid, extent: [u64; 3]) {
        let cell = grid.cell();
        let Some(axis) = (0..3).find(|axis| self.min(*axis) == self.max(*axis)) else { return };
        let at = self.min(axis);
        if at.rem_euclid(cell) != 0 {
            return;
        }
        let end = i64::from(cell) * extent[axis] as i64;
        let is_inside_below = match self.normal()[axis] {
            _ if at == 0 => false,
            _ if i64::from(at) == end => true,
            normal => normal > 0,
        };
        let step = if is_inside_below { -cell / 2 } else { cell / 2 };
        self.corners.iter_mut().for_each(|corner| corner[axis] += step);
    }
}

/// Grid over a tree's space, with `2^fraction` grid units per cell.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub(super) depth: u8,
    pub(super) fraction: u8,
    pub(super) frame: Frame,
    /// World coordinates of the first cell's minimum corner. They are subtracted before any
    /// multiplication, so that differences of coordinates far from the world's origin keep all
    /// bits.
    origin: [f64; 3],
    /// Rows of the linear map from there to grid units.
    matrix: [[f64; 3]; 3],
}

impl Grid {
    pub(super) fn new(depth: u8, frame: Frame) -> Result<Grid> {
        let fraction = (SOLID_BITS - depth).min(FRACTION);
        let steps = (1u64 << fraction) as f64;
        let unmappable = || Error::invalid("frame", format!("{:?}", frame.matrix), "an invertible matrix");
        let origin = frame.matrix.map(|row| row[3]);
        let mut linear = frame.clone();
        linear.matrix.iter_mut().for_each(|row| row[3] = 0.0);
        let mut matrix = [[0.0; 3]; 3];
        for axis in 0..3 {
            let mut unit = [0.0; 3];
            unit[axis] = 1.0;
            let image = linear.to_cells(unit).ok_or_else(unmappable)?;
            for row in 0..3 {
                matrix[row][axis] = image[row] * steps;
            }
        }
        Ok(Grid { depth, fraction, frame, origin, matrix })
    }

    /// Width of a cell in grid units.
    pub(super) fn cell(&self) -> i32 {
        1 << self.fraction
    }

    /// Minimum width of a grid unit in the world over the axes.
    pub(super) fn step(&self) -> f64 {
        let linear = self.frame.linear();
        let widths = (0..3).map(|axis| linear.col(axis).length());
        widths.fold(f64::INFINITY, f64::min) / f64::from(self.cell())
    }

    /// Nearest grid point of a vertex.
    ///
    /// # Errors
    /// If the vertex is outside of the space by more than the space's width.
    #[inline]
    pub(super) fn snap(&self, path: &Path, vertex: [f64; 3]) -> Result<[i32; 3]> {
        let space = (1i64 << (self.depth + self.fraction)) as f64;
        let [x, y, z] = [0, 1, 2].map(|axis| vertex[axis] - self.origin[axis]);
        let at = self.matrix.map(|m| (m[0] * x + m[1] * y + m[2] * z).round_ties_even());
        if at.iter().all(|at| -space <= *at && *at <= 2.0 * space) {
            return Ok(at.map(|at| at as i32));
        }
        let [x, y, z] = vertex;
        Err(Error::corrupt(
            path,
            "vertices",
            format!("a vertex at {x}, {y}, {z}"),
            "vertices in or near the space of the tree; omit --grid, or choose a larger tree",
        ))
    }

    /// Distance that a vertex was moved, in the models' unit.
    pub(super) fn displacement(&self, vertex: [f64; 3], snapped: [i32; 3]) -> f64 {
        let cell = f64::from(self.cell());
        let at = snapped.map(|at| f64::from(at) / cell);
        let moved = |axis: usize| {
            let row = self.frame.matrix[axis];
            let there = row[0] * at[0] + row[1] * at[1] + row[2] * at[2];
            (there - (vertex[axis] - self.origin[axis])).powi(2)
        };
        (0..3).map(moved).sum::<f64>().sqrt()
    }
}
