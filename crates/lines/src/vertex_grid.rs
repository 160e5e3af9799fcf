//! Grids for vertices that are given as doubles.

use std::path::Path;

use spinney_base::space::{AxisGrid, CoordinateAxis, Dimension};
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Extent and precision of the vertices of lines, which determine the grid of their tree.
#[derive(Clone, Copy, Debug)]
pub struct VertexSurvey {
    axes: [CoordinateAxis; 3],
    count: u64,
    without_heights: u64,
}

impl Default for VertexSurvey {
    fn default() -> VertexSurvey {
        VertexSurvey { axes: [CoordinateAxis::NONE; 3], count: 0, without_heights: 0 }
    }
}

impl VertexSurvey {
    /// Includes a vertex, whose x and y must be finite. z is NaN if it has no height.
    pub fn include(&mut self, [x, y, z]: [f64; 3]) {
        self.count += 1;
        self.axes[0].include(x);
        self.axes[1].include(y);
        match z.is_finite() {
            true => self.axes[2].include(z),
            false => self.without_heights += 1,
        }
    }

    /// Returns the grid of a tree of these vertices. It has three axes if all vertices have
    /// heights. `path` is that of the source, for messages.
    ///
    /// # Errors
    /// If the vertices do not fit on a grid.
    pub fn grid(&self, path: &Path, crs: Option<&Crs>) -> Result<VertexGrid> {
        let has_heights = self.count > 0 && self.without_heights == 0;
        let dimension = if has_heights { Dimension::Oct } else { Dimension::Quad };
        // Degrees and heights have no common unit.
        let has_one_unit = !has_heights || !crs.is_some_and(Crs::is_geographic);
        let shared = if has_heights && has_one_unit { 3 } else { 2 };
        let mut axes = self.axes.map(|axis| axis.grid());
        let own = axes[..shared].to_vec();
        let fine = own.iter().map(|axis| axis.scale).fold(f64::INFINITY, f64::min);
        let coarse = own.iter().map(|axis| axis.scale).fold(0.0, f64::max);
        // The finest scale, if it spans all axes, or else the coarsest.
        let on = |scale: f64| -> Option<(f64, Vec<f64>)> {
            let offsets = self.axes[..shared].iter().map(|axis| axis_offset(axis, scale));
            Some((scale, offsets.collect::<Option<_>>()?))
        };
        let Some((scale, offsets)) = on(fine).or_else(|| on(coarse)) else {
            let found = self.axes[..shared].iter().map(|axis| format!("{} to {}", axis.least, axis.most));
            let found = format!("coordinates from {}", found.collect::<Vec<_>>().join(", "));
            return Err(Error::corrupt(path, "vertices", found, "coordinates that fit on a 32-bit grid"));
        };
        for (axis, offset) in axes.iter_mut().zip(offsets) {
            // Scales are powers of ten (rounded) or of two, so their ratio is either an integer
            // within double precision or clearly not one.
            let ratio = axis.scale / scale;
            let is_part = (ratio - ratio.round()).abs() <= 4.0 * f64::EPSILON * ratio && ratio >= 1.0;
            *axis = AxisGrid { scale, offset, is_exact: axis.is_exact && is_part };
        }
        if !has_heights {
            axes[2] = AxisGrid { scale, offset: 0.0, is_exact: true };
        }
        let mut grid = VertexGrid { dimension, has_one_unit, axes, bounds: [[0; 3]; 2] };
        if self.count > 0 {
            let corner = |end: fn(&CoordinateAxis) -> f64| grid.vertex(self.axes.each_ref().map(end));
            grid.bounds = [corner(|axis| axis.least), corner(|axis| axis.most)];
        }
        Ok(grid)
    }
}

/// Offset of a grid along an axis, which may have no coordinates.
fn axis_offset(axis: &CoordinateAxis, scale: f64) -> Option<f64> {
    if axis.least > axis.most { Some(0.0) } else { axis.offset(scale) }
}

/// Remark on vertices that are rounded.
pub const ROUNDED: &str = "vertices have more digits than a 32-bit grid, and are rounded to it";

/// Grid of the vertices of a survey.
#[derive(Clone, Copy, Debug)]
pub struct VertexGrid {
    dimension: Dimension,
    has_one_unit: bool,
    axes: [AxisGrid; 3],
    bounds: [[i32; 3]; 2],
}

impl VertexGrid {
    /// Returns two or three axes.
    pub fn dimension(&self) -> Dimension {
        self.dimension
    }

    /// Returns whether z has the unit of x and y, which it has not if these are degrees.
    pub(crate) fn has_one_unit(&self) -> bool {
        self.has_one_unit
    }

    /// Returns the size of a grid unit along each axis, in world units.
    pub fn scale(&self) -> [f64; 3] {
        self.axes.map(|axis| axis.scale)
    }

    /// Returns the world coordinates of the grid's origin.
    pub fn offset(&self) -> [f64; 3] {
        self.axes.map(|axis| axis.offset)
    }

    /// Returns the minimum and maximum vertex.
    pub fn bounds(&self) -> [[i32; 3]; 2] {
        self.bounds
    }

    /// Returns whether vertices are rounded, by at most half a grid unit.
    pub fn is_rounded(&self) -> bool {
        self.axes.iter().any(|axis| !axis.is_exact)
    }

    /// Returns the grid point of a vertex; z is 0 in two axes.
    pub fn vertex(&self, position: [f64; 3]) -> [i32; 3] {
        let mut vertex = [0; 3];
        for axis in 0..self.dimension.axes() {
            let AxisGrid { scale, offset, .. } = self.axes[axis];
            vertex[axis] = ((position[axis] - offset) / scale).round() as i32;
        }
        vertex
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(vertices: &[[f64; 3]], crs: Option<&Crs>) -> VertexGrid {
        let mut survey = VertexSurvey::default();
        vertices.iter().for_each(|vertex| survey.include(*vertex));
        survey.grid(Path::new("lines"), crs).unwrap()
    }

    #[test]
    fn axes_share_the_finest_scale_unless_it_is_in_degrees() {
        let vertices = [[7.25, 46.5, 100.125], [7.5, 47.0, 4000.0]];
        let space = grid(&vertices, None);
        assert_eq!(
            (space.scale(), space.dimension(), space.is_rounded()),
            ([0.001; 3], Dimension::Oct, false)
        );
        assert_eq!(space.bounds(), [[7250, 46_500, 100_125], [7500, 47_000, 4_000_000]]);
        let degrees = grid(&vertices, Some(&Crs::epsg(4326)));
        assert_eq!(
            (degrees.scale(), degrees.vertex(vertices[0])),
            ([0.01, 0.01, 0.001], [725, 4650, 100_125])
        );
        let plane = grid(&[vertices[0], [7.5, 47.0, f64::NAN]], None);
        assert_eq!(
            (plane.scale(), plane.dimension(), plane.vertex(vertices[1])),
            ([0.01; 3], Dimension::Quad, [750, 4700, 0])
        );
        let empty = grid(&[], None);
        assert_eq!((empty.dimension(), empty.bounds()), (Dimension::Quad, [[0; 3]; 2]));
        // The finest scale does not span the eastings.
        let wide = grid(&[[-2e9, 0.0, 0.001], [2e9, 1.0, 0.5]], None);
        assert!(wide.is_rounded() && wide.scale() == [1.0; 3], "{:?}", wide.scale());
        let mut beyond = VertexSurvey::default();
        [-f64::MAX, f64::MAX].into_iter().for_each(|x| beyond.include([x, 0.0, 0.0]));
        assert!(beyond.grid(Path::new("lines"), None).unwrap().is_rounded());
    }

    #[test]
    fn bounds_contain_all_vertices() {
        let mut random = crate::tests::random(5);
        for digits in [1.0, 1e3, 1e14] {
            let mut number = |scale: f64| (random(1 << 40) as f64 / scale * digits).round() / digits;
            let vertices: Vec<[f64; 3]> = (0..50).map(|_| [number(3e5), number(1e9), number(7e11)]).collect();
            let grid = grid(&vertices, None);
            let [low, high] = grid.bounds();
            for vertex in vertices {
                let at = grid.vertex(vertex);
                assert!((0..3).all(|axis| (low[axis]..=high[axis]).contains(&at[axis])), "{at:?}");
            }
        }
    }
}
