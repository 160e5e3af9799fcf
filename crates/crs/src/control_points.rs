//! Ground control points: places of single cells in the world, where no frame tells those of all.

use serde::{Deserialize, Serialize};

use super::frame::Frame;
use crate::definition::Crs;

/// Ground control points of a picture, and the coordinate system that they are in. They are kept and handed on;
/// nothing is placed by them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlPoints {
    /// The coordinate system of the world, where known.
    pub crs: Option<Crs>,
    /// The points, in the order of the input.
    pub points: Vec<ControlPoint>,
}

/// A place in a picture and where that is in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlPoint {
    /// Column and row; the first cell spans 0 to 1.
    pub cell: [f64; 2],
    /// World coordinates x, y, z.
    pub world: [f64; 3],
}

impl ControlPoints {
    /// The points of a picture whose cells lie in this one's as a map tells (that of a [`Frame`], from cells there
    /// to cells here); none if the map cannot be inverted.
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
