//! Faces of two models near each other's surfaces.

use super::bodies::{Bodies, Near};
use super::common_grid::{CommonGrid, incompatible_grids};
use super::table::OperationTable;
use crate::ExactModel;
use crate::arrangement::ExactFaces;
use spinney_base::{Progress, Result, SetOperation};

/// Bytes of a face with its plane and box.
const FACE: u64 = 400;

/// Faces of two models near each other's surfaces, on one grid. If they are too many for the
/// memory, only those whose boxes touch a face of the other model.
pub(crate) struct NearFaces {
    pub faces: ExactFaces,
    /// End index of each model's faces.
    pub ends: Vec<u32>,
    /// Offset that was added to the sources of each model's faces.
    pub(crate) first_sources: [u64; 2],
}

impl NearFaces {
    /// Traverses both octrees together, and reads the faces.
    ///
    /// # Errors
    /// If grids, coordinate systems or units are incompatible, if `memory` bytes are insufficient,
    /// if files are corrupt or cannot be read, or on cancellation.
    pub(crate) fn of(models: [&ExactModel; 2], memory: u64, progress: &dyn Progress) -> Result<NearFaces> {
        let common_grid = CommonGrid::of(&models, 1)?.ok_or_else(|| incompatible_grids(&models))?;
        // (Any operation would do: being near does not depend on it.)
        let mut bodies = Bodies::new(
            &models,
            &common_grid,
            (OperationTable::of_two(SetOperation::Intersection), None),
            None,
            progress,
        )?;
        let near: usize = (0..2).map(|body| bodies.near_of(body).len()).sum();
        if near as u64 * FACE > memory {
            bodies.drop_untouched(memory, progress)?;
        }
        let Near { faces, ends, .. } = bodies.near(None, memory, progress)?;
        Ok(NearFaces { faces, ends, first_sources: [0, bodies.first[1].1] })
    }
}
