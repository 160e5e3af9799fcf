//! Frames: georeferencing of a tree's cells.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::definition::Crs;
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};

/// The affine map from cell coordinates to world coordinates, and their coordinate reference
/// system.
///
/// Cell (0, 0, 0) spans 0..1 on every axis, so its centre is at one half.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Rows of the 3x4 matrix: world x, y, z from cell x, y, z, 1.
    pub matrix: [[f64; 4]; 3],
    /// The coordinate reference system, if known.
    pub crs: Option<Crs>,
    /// Whether samples were points at pixel centres (GeoTIFF `PixelIsPoint`). The half-pixel shift
    /// is already applied to the matrix, so it always refers to areas.
    pub pixel_is_point: bool,
}

impl Frame {
    /// Returns the frame in which cell coordinates are world coordinates.
    pub fn identity() -> Frame {
        Frame {
            matrix: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            crs: None,
            pixel_is_point: false,
        }
    }

    /// Creates a planar frame from the six numbers `a, b, c, d, e, f`: world x = a col + b row + c,
    /// world y = d col + e row + f (the order of rasterio's affine transform).
    pub fn planar([a, b, c, d, e, f]: [f64; 6]) -> Frame {
        Frame { matrix: [[a, b, 0.0, c], [d, e, 0.0, f], [0.0, 0.0, 1.0, 0.0]], ..Frame::identity() }
    }

    /// Returns the six numbers of [`Frame::planar`].
    pub fn affine(&self) -> [f64; 6] {
        let [x, y, _] = self.matrix;
        [x[0], x[1], x[3], y[0], y[1], y[3]]
    }

    /// Whether cell and world coordinates are the same.
    pub fn is_identity(&self) -> bool {
        self.matrix == Frame::identity().matrix
    }

    /// Checks that cells above each other have the same world x and y, so that a polygon covers
    /// whole columns of cells.
    ///
    /// # Errors
    /// If they do not.
    pub fn check_columns(&self) -> Result<()> {
        /// Shift of a layer against the next, in widths of a cell, that rounding may cause.
        const ROUNDING: f64 = 1e-9;
        let [x, y, _] = self.matrix;
        if x[2].hypot(y[2]) <= ROUNDING * x[0].hypot(y[0]).min(x[1].hypot(y[1])) {
            return Ok(());
        }
        let found = "columns of cells that are not vertical";
        let expected = "columns along the world's z axis; `spinney transform TREE like=OTHER -o NEW` resamples a turned tree to the cells of another one";
        Err(Error::invalid("grid of an octree with features", found, expected))
    }

    /// Returns the map without its translation. Its columns are the edges of a cell. Its
    /// determinant is a cell's volume, negative if the map mirrors.
    pub fn linear(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&self.matrix.map(|[x, y, z, _]| [x, y, z])).transpose()
    }

    /// Returns the area vectors, in world coordinates, of a cell's upper faces along x, y and z.
    /// They point out of the cell, or into it if the map mirrors.
    pub fn face_areas(&self) -> [DVec3; 3] {
        let DMat3 { x_axis: a, y_axis: b, z_axis: c } = self.linear();
        [b.cross(c), c.cross(a), a.cross(b)]
    }

    /// Converts cell coordinates to world coordinates.
    pub fn to_world(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.matrix.map(|m| m[0] * x + m[1] * y + m[2] * z + m[3])
    }

    /// Converts world coordinates to cell coordinates. `None` if the map cannot be inverted.
    pub fn to_cells(&self, world: [f64; 3]) -> Option<[f64; 3]> {
        let m = &self.matrix;
        // (Adjugate divided by determinant. Cyclic indices give the minors the signs of cofactors.)
        let minor = |r: usize, c: usize| {
            let (r1, r2) = ((r + 1) % 3, (r + 2) % 3);
            let (c1, c2) = ((c + 1) % 3, (c + 2) % 3);
            m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
        };
        let det = (0..3).map(|c| m[0][c] * minor(0, c)).sum::<f64>();
        if !det.is_finite() || det == 0.0 {
            return None;
        }
        let d = [world[0] - m[0][3], world[1] - m[1][3], world[2] - m[2][3]];
        Some(std::array::from_fn(|c| (0..3).map(|r| minor(r, c) * d[r]).sum::<f64>() / det))
    }

    /// Returns the area of a cell in square metres, for projected systems in metres that nearly
    /// preserve areas.
    ///
    /// # Errors
    /// The reason why the area is not known.
    pub fn cell_square_metres(&self) -> Result<f64, &'static str> {
        let crs = self.crs.as_ref();
        let epsg = crs
            .and_then(Crs::numbers)
            .ok_or("the coordinate system has no EPSG number, so the size of a cell is unknown")?;
        match crs.and_then(Crs::unit) {
            _ if epsg.horizontal == 3857 => return Err("Web Mercator does not preserve areas"),
            Some("degrees") => {
                return Err("cells in degrees differ in area; build from a raster in a projected system");
            }
            Some("m") => {}
            _ => return Err("the unit of the coordinate system is not the metre"),
        }
        let [a, b, _, d, e, _] = self.affine();
        Ok((a * e - b * d).abs())
    }

    /// Returns the volume of an octree's cell, in cubic world units.
    ///
    /// # Errors
    /// The reason why the volume is not known: the axes have no common unit.
    pub fn cell_volume(&self) -> Result<f64, &'static str> {
        match self.crs.as_ref().and_then(Crs::unit) {
            Some("degrees") => Err("degrees and heights have no common unit; build in a projected system"),
            _ => Ok(self.linear().determinant().abs()),
        }
    }

    /// Returns the minimum and maximum world coordinates of a box of cells.
    pub fn world_box(&self, cells: &Bounds) -> [[f64; 3]; 2] {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { cells.min[axis] } else { cells.max[axis] };
            let point = self.to_world(std::array::from_fn(|axis| pick(axis) as f64));
            for axis in 0..3 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        [low, high]
    }

    /// Returns the cells that a world box, given by its minimum and maximum coordinates, covers at
    /// least in part, within a raster of a given size. `None` if the map cannot be inverted.
    ///
    /// If the frame is rotated, the result is the bounding box of these cells. It is clipped to the
    /// raster and may be empty.
    pub(crate) fn cells_in_box(&self, low: [f64; 3], high: [f64; 3], extent: [u64; 3]) -> Option<Bounds> {
        // Tolerance, in cells, within which the sides of the box snap to cell borders.
        const ROUNDING: f64 = 1e-6;
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            let cell = self.to_cells(std::array::from_fn(pick))?;
            for axis in 0..3 {
                min[axis] = min[axis].min(cell[axis]);
                max[axis] = max[axis].max(cell[axis]);
            }
        }
        let inside = |axis: usize, cell: f64| cell.clamp(0.0, extent[axis] as f64) as u64;
        Some(Bounds {
            min: std::array::from_fn(|axis| inside(axis, (min[axis] + ROUNDING).floor())),
            max: std::array::from_fn(|axis| inside(axis, (max[axis] - ROUNDING).ceil())),
        })
    }

    /// Returns the cells, in all slices, that a world rectangle (west, south, east, north) covers
    /// within a raster of a given size: see [`Frame::cells_in_box`].
    pub(crate) fn cells_in_rectangle(
        &self,
        [west, south, east, north]: [f64; 4],
        extent: [u64; 3],
    ) -> Option<Bounds> {
        let mut bounds = self.cells_in_box([west, south, 0.0], [east, north, 0.0], extent)?;
        (bounds.min[2], bounds.max[2]) = (0, extent[2]);
        Some(bounds)
    }

    /// Returns the frame of cells that are `2^shift` times as large along every axis: the cells of
    /// level `depth - shift`.
    pub fn coarser(&self, shift: u8) -> Frame {
        self.scaled((1u64 << shift) as f64)
    }

    /// Returns the frame of cells that are `2^shift` times as small along every axis.
    pub fn finer(&self, shift: u8) -> Frame {
        self.scaled(1.0 / (1u64 << shift) as f64)
    }

    fn scaled(&self, scale: f64) -> Frame {
        let matrix = self.matrix.map(|[x, y, z, o]| [x * scale, y * scale, z * scale, o]);
        Frame { matrix, ..self.clone() }
    }

    /// Returns the frame whose cell (0, 0, 0) is this frame's cell `origin`.
    pub fn shifted(&self, origin: [f64; 3]) -> Frame {
        let o = self.to_world(origin);
        let mut frame = self.clone();
        for (row, o) in frame.matrix.iter_mut().zip(o) {
            row[3] = o;
        }
        frame
    }
}
