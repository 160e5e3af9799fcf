//! Repair of surfaces that pass through themselves: what they go around once or more is inside.

use std::path::Path;

use super::snap::Snapper;
use crate::brep::arrangement::{Resolved, resolve};
use crate::brep::{FaceList, Faces};
use crate::{Error, Progress, Result};

/// What was done to a surface that passed through itself.
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

/// Times after which a surface is left as it is: the builder of the file then tells where it still crosses itself. (The
/// worst scans of the test data take four.)
const MOST_ROUNDS: u32 = 12;

/// Takes away what does not bound the body; the surface is closed. `path` is a model's for errors.
pub(super) fn repair(
    mut faces: FaceList,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(FaceList, Repair)> {
    let mut repair = Repair::default();
    loop {
        let grid = faces.grid().clone();
        let mut kept = FaceList::new(grid.clone(), faces.parts().to_vec());
        let mut snapper = Snapper::new(grid.clone(), crate::space::Up::default());
        snapper.is_coloured = faces.is_coloured();
        let is_inside = |winding: i32| winding > 0;
        let Resolved { pairs, divided, removed, displacement } =
            resolve(&faces, &is_inside, memory, progress, &mut |face| {
                snapper.face_on_grid(face, &mut |face| {
                    kept.push(face);
                    Ok(())
                })
            })
            .map_err(|error| match error {
                Error::TooLarge { what, needed, limit, advice, .. } => {
                    Error::TooLarge { path: path.to_path_buf(), what, needed, limit, advice }
                }
                error => error,
            })?;
        if kept.is_empty() {
            return Err(Error::NoBody {
                path: path.to_path_buf(),
                what: "nothing is inside: the surface goes around no place once or more".into(),
                places: Vec::new(),
                count: 0,
                advice: "turn its faces round if they point to the inside".into(),
            });
        }
        if repair.rounds == 0 {
            repair = Repair { pairs, divided, removed, ..repair };
        }
        repair.displacement = repair.displacement.max(displacement * grid.width());
        faces = kept;
        if (divided, removed) == (0, 0) || repair.rounds == MOST_ROUNDS {
            return Ok((faces, repair));
        }
        repair.rounds += 1;
    }
}
