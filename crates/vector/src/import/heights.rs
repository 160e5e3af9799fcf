//! Third coordinates and measures of geometries.

/// Heights and measures that the points of a geometry have.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heights {
    /// Whether there are heights.
    pub are_there: bool,
    /// Whether there are measures, which are read over.
    pub have_measures: bool,
    /// Heights of all points, and of all vertices of lines and rings, in their order: as many as there are, where all have one. (Of polygons in
    /// shapefiles only where rings are in the order of the file.)
    pub of_points: Vec<f64>,
}

impl Heights {
    /// Whether there is more than x and y.
    pub fn any(&self) -> bool {
        self.are_there || self.have_measures
    }

    /// Takes the height of a point, or that it has none.
    pub(super) fn add_point(&mut self, height: Option<f64>) {
        // (Of points some of which have none, no height counts.)
        self.of_points.extend(height);
    }
}
