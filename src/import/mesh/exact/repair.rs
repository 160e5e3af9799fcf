//! Repair of surfaces that pass through themselves: what they go around once or more is inside.

use std::path::Path;

use super::snap::Snapper;
use crate::brep::arrangement::{Resolved, resolve, snap};
use crate::brep::{Face, FaceList, Faces};
use crate::space::Up;
use crate::{Error, Progress, Result};

/// Counts of the repair of a surface that passed through itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Repair {
    /// Pairs of faces that had more in common than neighbours have.
    pub pairs: u64,
    /// Faces of which parts were taken away, or that were divided.
    pub divided: u64,
    /// Faces that were taken away as a whole.
    pub removed: u64,
    /// Times that this was done, until moving the new vertices to the grid had no more consequences.
    pub rounds: u32,
    /// The furthest that a new vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
}

/// Times after which a surface is left as it is, as where it gets worse: the builder of the file then tells where it still
/// crosses itself. (The worst scans of the test data take five.)
const MOST_ROUNDS: u32 = 12;

/// Takes away what does not bound the body; the surface is closed. `path` is a model's for errors.
pub(super) fn repair(
    mut faces: FaceList,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(FaceList, Repair)> {
    let mut repair = Repair::default();
    let mut moved = Vec::new();
    loop {
        let is_inside = |winding: i32| winding > 0;
        let (kept, resolved) =
            settled(&faces, |each| resolve(&faces, path, &is_inside, memory, progress, each))?;
        if kept.is_empty() {
            return Err(Error::NoBody {
                path: path.to_path_buf(),
                what: "nothing is inside: the surface goes around no place once or more".into(),
                places: Vec::new(),
                count: 0,
                advice: "turn its faces round if they point to the inside".into(),
            });
        }
        faces = kept;
        let Resolved { pairs, divided, removed, displacement, corners } = resolved;
        if repair.rounds == 0 {
            repair = Repair { pairs, divided, removed, ..repair };
        }
        repair.displacement = repair.displacement.max(displacement * faces.grid().width());
        let is_worse = repair.rounds > 0 && divided > 2 * repair.divided.max(50);
        if divided + removed == 0 || is_worse || repair.rounds == MOST_ROUNDS {
            return Ok((faces, repair));
        }
        moved.extend(corners);
        if repair.rounds > 0 && divided > 0 {
            // Moving corners has made new crossings: what is thinner than a step has to go.
            (faces, ()) = settled(&faces, |each| snap(&faces, &moved, progress, each))?;
        }
        repair.rounds += 1;
    }
}

/// Collects what is made of faces, as faces of a model: planar, or in triangles.
fn settled<R>(
    faces: &FaceList,
    make: impl FnOnce(&mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<R>,
) -> Result<(FaceList, R)> {
    let grid = faces.grid().clone();
    let mut list = FaceList::new(grid.clone(), faces.parts().to_vec());
    let mut snapper = Snapper::new(grid, Up::default());
    snapper.is_coloured = faces.is_coloured();
    let made = make(&mut |face| {
        snapper.face_on_grid(face, &mut |face| {
            list.push(face);
            Ok(())
        })
    })?;
    Ok((list, made))
}
