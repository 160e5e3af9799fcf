//! Motions that do not map grid points to those of another grid: vertices are computed in world
//! coordinates and snapped to a new grid.

use super::map::Motion;
use crate::arrangement::Turner;
use crate::planar::PlanarFaces;
use crate::{ExactModel, Face, Faces, Grid};
use spinney_base::{Error, Progress, Result};

/// The unit of a new grid.
#[derive(Clone, Copy)]
pub(super) enum NewUnit<'a> {
    /// That of the model's grid, unless a coarser one is needed.
    Finest,
    /// A width.
    Width(f64),
    /// That of a grid.
    Of(&'a Grid),
}

/// Moves faces one by one, and keeps its buffers between faces.
pub(super) struct Snapping<'a> {
    motion: &'a Motion,
    old: Grid,
    pub(super) grid: Grid,
    pub(super) planar: PlanarFaces,
    /// Maximum squared distance of a vertex from its exact image.
    squared_displacement: f64,
    turner: Turner,
}

impl<'a> Snapping<'a> {
    /// Reads all faces, and creates a grid of the given unit over the moved vertices.
    pub(super) fn of(
        model: &ExactModel,
        motion: &'a Motion,
        unit: NewUnit<'_>,
        progress: &dyn Progress,
    ) -> Result<Snapping<'a>> {
        let old = model.grid().clone();
        let mut bounds: Option<[[f64; 3]; 2]> = None;
        model.each(&mut |face| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            for point in face.points {
                let at = motion.apply(old.to_world(*point));
                let [low, high] = bounds.get_or_insert([at; 2]);
                for axis in 0..3 {
                    low[axis] = low[axis].min(at[axis]);
                    high[axis] = high[axis].max(at[axis]);
                }
            }
            Ok(())
        })?;
        let bounds = bounds.unwrap_or([[0.0; 3]; 2]);
        if !bounds.as_flattened().iter().all(|at| at.is_finite()) {
            return Err(Error::invalid("result", "coordinates that are not finite", "a smaller one"));
        }
        let grid = match unit {
            NewUnit::Finest => {
                Grid::fit(bounds, old.step, old.divisor).map_or_else(|| Grid::over(bounds, None), Ok)
            }
            NewUnit::Width(width) => Grid::over(bounds, Some(width)),
            NewUnit::Of(unit) => Grid::fit(bounds, unit.step, unit.divisor)
                .map_or_else(|| Grid::over(bounds, Some(unit.width())), Ok),
        }?;
        let mut planar = PlanarFaces::default();
        planar.is_coloured = model.is_coloured()?;
        Ok(Snapping { motion, old, grid, planar, squared_displacement: 0.0, turner: Turner::default() })
    }

    /// Returns the maximum distance of a vertex from its exact image.
    pub(super) fn displacement(&self) -> f64 {
        self.squared_displacement.sqrt()
    }

    /// Visits the faces that replace a face: itself, some triangles, or none.
    pub(super) fn face(
        &mut self,
        face: &Face<'_>,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let Snapping { motion, old, grid, planar, squared_displacement, turner } = self;
        let face = if motion.is_mirrored() { turner.turn(face) } else { *face };
        planar.begin(face.ring_ends, face.colours, &mut |corner| {
            let point = motion.apply(old.to_world(face.points[corner]));
            let snapped = grid.snap(point).ok_or_else(|| {
                let expected = "the same position as in the first pass over the model";
                Error::invalid("corner", format!("{point:?}"), expected)
            })?;
            let there = grid.to_world(snapped);
            let moved = (0..3).map(|axis| (there[axis] - point[axis]).powi(2)).sum::<f64>();
            *squared_displacement = squared_displacement.max(moved);
            Ok(snapped)
        })?;
        planar.finish(face.part, face.source, each)
    }
}
