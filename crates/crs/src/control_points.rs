//! Ground control points: world coordinates of single cells, for rasters without a frame.

use serde::{Deserialize, Serialize};

use super::frame::Frame;
use crate::definition::Crs;

/// Ground control points of a raster, and their coordinate reference system. They are stored and
/// passed on, but not used to georeference cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlPoints {
    /// Coordinate reference system of the world coordinates, if known.
    pub crs: Option<Crs>,
    /// The points, in the order of the input.
    pub points: Vec<ControlPoint>,
}

/// A position in a raster and its world coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlPoint {
    /// Column and row; the first cell spans 0 to 1.
    pub cell: [f64; 2],
    /// World coordinates x, y, z.
    pub world: [f64; 3],
}

impl ControlPoints {
    /// Returns the points relative to another raster. `map` maps the cells of that raster to the
    /// cells of this one (a [`Frame`] without world coordinates). `None` if the map cannot be
    /// inverted.
    pub fn seen_through(&self, map: &Frame) -> Option<ControlPoints> {
        let place = |point: &ControlPoint| {
            let [column, row, _] = map.to_cells([point.cell[0], point.cell[1], 0.0])?;
            Some(ControlPoint { cell: [column, row], ..*point })
        };
        let points = self.points.iter().map(place).collect::<Option<Vec<_>>>()?;
        Some(ControlPoints { points, crs: self.crs.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_move_against_the_window() {
        let point = ControlPoint { cell: [10.5, 20.0], world: [1.0, 2.0, 3.0] };
        let points = ControlPoints { crs: None, points: vec![point] };
        // Cells twice as wide and four times as high, from column 4 and row 8 on.
        let window = Frame::planar([2.0, 0.0, 4.0, 0.0, 4.0, 8.0]);
        let seen = points.seen_through(&window).unwrap();
        assert_eq!(seen.points, [ControlPoint { cell: [3.25, 3.0], ..point }]);
        assert_eq!(points.seen_through(&Frame::planar([0.0; 6])), None);
    }
}
