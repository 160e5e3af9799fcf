//! First pass over features: their number, extent and values.

use spinney_base::Result;

use super::options::{FeatureValue, RasterizeOptions};
use super::values::Values;
use crate::import::feature::{Feature, FeatureAttribute, FeatureGeometry};

/// Counts of features and vertices, and their bounding box.
#[derive(Debug)]
pub(super) struct Survey {
    /// Minimum and maximum coordinates.
    pub(super) bounds: [[f64; 2]; 2],
    /// Number of features with a geometry and a value.
    pub(super) features: u64,
    /// Number of features without a geometry.
    pub(super) empty: u64,
    /// Number of features with a geometry and without a value.
    pub(super) valueless: u64,
    /// Number of vertices of all features with both.
    pub(super) vertices: u64,
}

impl Survey {
    /// Creates an empty survey.
    pub(super) fn new() -> Survey {
        let bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        Survey { bounds, features: 0, empty: 0, valueless: 0, vertices: 0 }
    }

    /// Adds a feature and its value.
    ///
    /// # Errors
    /// Those of [`Values::add`].
    pub(super) fn add(
        &mut self,
        feature: &Feature,
        values: &mut Values,
        options: &RasterizeOptions,
    ) -> Result<()> {
        let half = options.half_width(feature).unwrap_or(None).unwrap_or(0.0);
        let vertices = feature.geometry.as_ref().map_or(0, |geometry| self.widen(geometry, half));
        if vertices == 0 {
            self.empty += 1;
            return Ok(());
        }
        if let FeatureValue::Attribute(_) = options.value {
            let attribute = feature.attributes.first().unwrap_or(&FeatureAttribute::None);
            if matches!(attribute, FeatureAttribute::None) {
                self.valueless += 1;
                return Ok(());
            }
            values.add(attribute)?;
        }
        (self.features, self.vertices) = (self.features + 1, self.vertices + vertices);
        Ok(())
    }

    /// Extends the bounds by a geometry, and, for lines, by half of their width; returns the number
    /// of vertices.
    fn widen(&mut self, geometry: &FeatureGeometry, half: f64) -> u64 {
        let mut count = 0;
        let around = if let FeatureGeometry::Lines(_) = geometry { half } else { 0.0 };
        let mut add = |vertices: &[[f64; 2]]| {
            count += vertices.len() as u64;
            for vertex in vertices {
                for (axis, at) in vertex.iter().enumerate() {
                    self.bounds[0][axis] = self.bounds[0][axis].min(*at - around);
                    self.bounds[1][axis] = self.bounds[1][axis].max(*at + around);
                }
            }
        };
        match geometry {
            FeatureGeometry::Points(points) => add(points),
            FeatureGeometry::Lines(lines) => lines.iter().for_each(|line| add(line)),
            FeatureGeometry::Polygons(parts) => parts.iter().flatten().for_each(|ring| add(ring)),
            FeatureGeometry::Collection(members) => {
                return members.iter().map(|member| self.widen(member, half)).sum();
            }
        }
        count
    }
}
