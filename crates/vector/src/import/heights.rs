//! Third coordinates and measures of geometries.

/// Heights and measures of a geometry's points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heights {
    /// Whether there are heights.
    pub are_there: bool,
    /// Whether there are measures, which are skipped.
    pub have_measures: bool,
    /// Heights of all points, including vertices of lines and rings, in order. Complete only if all
    /// points have one. For shapefile polygons, set only if the rings keep the order of the file.
    pub of_points: Vec<f64>,
}

impl Heights {
    /// Returns whether there are coordinates other than x and y.
    pub fn any(&self) -> bool {
        self.are_there || self.have_measures
    }

    /// Adds a point, with or without a height.
    pub(super) fn add_point(&mut self, height: Option<f64>) {
        // If some points have no height, the counts differ and no height is used.
        self.of_points.extend(height);
    }
}
