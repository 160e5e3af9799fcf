//! Surfaces for a viewpoint: as fine as an eye sees them, coarser with the distance.

use super::model_surface::ModelSurface;
use crate::boxes::Bounds;
use crate::{ExactModel, Faces, Grid};
use spinney_base::{Error, Result};

/// Where a surface is seen from, and how fine it must be.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// Position of the eye in the world.
    pub eye: [f64; 3],
    /// Maximum error of the surface per distance from the eye, such as the angle of a pixel.
    pub tolerance: f64,
    /// Half-spaces of the world: the points with `a x + b y + c z + d >= 0`, for each. What is seen
    /// is in all of them. The rest of the surface is as coarse as its connection to that allows.
    pub half_spaces: Vec<[f64; 4]>,
    /// Maximum number of faces. The tolerance is increased until there are no more.
    pub faces: u64,
}

impl ExactModel {
    /// Chooses the surface for a viewpoint. It is closed, like those of levels, and finer where the
    /// eye is near: a cluster is replaced if the error that results is at most the tolerance, times
    /// the distance between the eye and the box of all faces that are replaced. Distances less than
    /// a grid unit count as one.
    ///
    /// Reads the tables of clusters from the coarsest level to the finest one that is needed.
    ///
    /// # Errors
    /// If the file has no levels, if the coarsest one has more faces than requested, if the
    /// viewpoint is invalid, or if the file is corrupt or cannot be read.
    pub fn at_view(&self, view: &Viewpoint) -> Result<ModelSurface<'_>> {
        self.count_detail_levels()?;
        let eye = Eye::new(view, self.grid())?;
        Ok(self.within_tolerance(&|error, bounds| eye.angle(error, bounds), eye.tolerance, view.faces, 0)?.0)
    }
}

/// A viewpoint in grid units.
struct Eye {
    position: [f64; 3],
    tolerance: f64,
    half_spaces: Vec<[f64; 4]>,
}

impl Eye {
    fn new(view: &Viewpoint, grid: &Grid) -> Result<Eye> {
        let Viewpoint { eye, tolerance, half_spaces, .. } = view;
        if !(*tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(Error::invalid("tolerance", tolerance.to_string(), "a number of at least 0"));
        }
        // (Products of these are finite.)
        let is_number = |number: &f64| number.abs() <= f64::from(f32::MAX);
        if !eye.iter().chain(half_spaces.as_flattened()).all(is_number) {
            let found = format!("eye {eye:?}, half-spaces {half_spaces:?}");
            return Err(Error::invalid("viewpoint", found, "finite numbers, at most 3e38"));
        }
        let half_spaces = half_spaces.iter().map(|[a, b, c, d]| {
            let origin = grid.to_world([0; 3]);
            let constant = a * origin[0] + b * origin[1] + c * origin[2] + d;
            let [a, b, c] = [a, b, c].map(|factor| factor * grid.width());
            [a, b, c, constant]
        });
        Ok(Eye {
            position: grid.to_grid(*eye),
            tolerance: tolerance.abs(),
            half_spaces: half_spaces.collect(),
        })
    }

    /// Returns the largest angle that an error in a box has, seen from the eye; 0 if the box is not
    /// seen. Never less for a box that contains this one, or for a larger error.
    fn angle(&self, error: f32, bounds: &Bounds) -> f64 {
        let [low, high] = bounds.map(|corner| corner.map(f64::from));
        let is_seen = self.half_spaces.iter().all(|[a, b, c, d]| {
            let most = |axis: usize, factor: &f64| (factor * low[axis]).max(factor * high[axis]);
            most(0, a) + most(1, b) + most(2, c) + d >= 0.0
        });
        if !is_seen {
            return 0.0;
        }
        let gaps = [0, 1, 2]
            .map(|axis| (low[axis] - self.position[axis]).max(self.position[axis] - high[axis]).max(0.0));
        let distance = gaps.iter().map(|gap| gap * gap).sum::<f64>().sqrt();
        f64::from(error) / distance.max(1.0)
    }
}
