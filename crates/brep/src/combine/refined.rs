//! Copies of models on finer grids, for files that store vertices without their exact fractions.

use std::ops::Deref;

use super::common_grid::bounds;
use super::{Origin, Request, combined};
use crate::query::SurfaceDetail;
use crate::{ExactModel, Faces, Grid, MAX_BITS};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SetOperation, SilentProgress};
use spinney_container::Tag;
use tempfile::TempDir;

/// A copy of a model on a finer grid, in a temporary file.
struct RefinedModel {
    model: ExactModel,
    /// (Dropped last, so that the directory is removed after the model is closed.)
    _directory: TempDir,
}

impl Deref for RefinedModel {
    type Target = ExactModel;

    fn deref(&self) -> &ExactModel {
        &self.model
    }
}

impl ExactModel {
    /// Writes a copy of the model on the finest grid of at most 2^26 units along its longest side,
    /// for an export of its faces to `output`, in a temporary directory. There, off-grid vertices
    /// are rounded by less, and so fewer faces intersect after rounding. `None` if this would not
    /// help: at a coarser level of detail; without off-grid vertices; or if the own grid is as fine
    /// as the default of a build, and none of its rounded faces intersect. Also `None` if the faces
    /// with off-grid vertices need more than a gigabyte of memory, or do not bound a solid: an
    /// export does not need a copy.
    ///
    /// # Errors
    /// If files cannot be read or written, or on cancellation.
    pub fn refined(
        &self,
        detail: SurfaceDetail,
        output: &Output,
        progress: &dyn Progress,
    ) -> Result<Option<impl Deref<Target = ExactModel> + use<>>> {
        const MEMORY: u64 = 1 << 30;
        /// A grid that is chosen by default has more units along the longest side.
        const COARSE: i64 = 1 << 22;
        if detail != SurfaceDetail::Exact || !self.has_exact_faces() {
            return Ok(None);
        }
        let [low, high] = bounds(self)?.unwrap_or_default();
        let longest = (0..3).map(|axis| i64::from(high[axis]) - i64::from(low[axis])).max().unwrap_or(0);
        let is_thin = self.metadata().tag(Tag::ModelIntersections).is_some();
        let parts = parts_of(self.grid(), longest);
        if parts < 2 || longest > COARSE && !is_thin {
            return Ok(None);
        }
        let around = output.temporary_directory();
        let directory =
            tempfile::tempdir_in(&around).map_err(Error::io(&around, "make a temporary directory"))?;
        let path = directory.path().join("refined.goblin");
        let origin = Origin { provenance: self.metadata().provenance.clone(), ..Origin::default() };
        let request = Request { origin: Some(&origin), parts, ..Request::new(SetOperation::First) };
        let copy = (Output::create(&path)?, self.codec());
        match combined(request, &[self], copy, MEMORY, &SilentProgress(progress)) {
            Err(Error::TooLarge { .. } | Error::NotASolid { .. }) => return Ok(None),
            made => made?,
        };
        let model = ExactModel::open(&path, &output.access().into())?.named(self.path());
        Ok(Some(RefinedModel { model, _directory: directory }))
    }
}

/// Returns the maximum number of parts into which units can be divided: a power of 10 for a decimal
/// grid, so that coordinates remain short decimals, otherwise of 2.
fn parts_of(grid: &Grid, longest: i64) -> i64 {
    /// Coordinates up to this number of units are exact doubles.
    const FARTHEST: i64 = 1 << 53;
    let base = if grid.divisor == 1.0 { 2 } else { 10 };
    let farthest = grid.origin.map(|at| at.saturating_abs()).into_iter().max().unwrap_or(0);
    // (Rounding may move vertices outwards by a unit.)
    let fits = |parts: i64| {
        (longest + 2).saturating_mul(parts) < 1 << MAX_BITS
            && (farthest.saturating_add(longest + 2)).saturating_mul(parts) <= FARTHEST
    };
    let mut parts = 1;
    while fits(parts * base) {
        parts *= base;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_divided_as_far_as_both_limits_allow() {
        let grid = |origin: i64, divisor: f64| Grid { bits: 10, origin: [0, 0, origin], step: 1.0, divisor };
        assert_eq!(parts_of(&grid(0, 1.0), 1000), 1 << 16);
        assert_eq!(parts_of(&grid(0, 1000.0), 1000), 10_000);
        assert_eq!(parts_of(&grid(-1 << 50, 1.0), 1000), 4);
        assert_eq!(parts_of(&grid(i64::MIN, 1000.0), 1000), 1);
        assert_eq!(parts_of(&grid(0, 1.0), 1 << 26), 1);
    }
}
