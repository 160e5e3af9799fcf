//! Arrangements on the grid: faces are divided again until moving new vertices to the grid has no more consequences.

use std::path::Path;

use super::snapping::snap;
use super::surface::{EachFace, Operands, Resolved, resolve};
use crate::brep::planar::PlanarFaces;
use crate::brep::{FaceList, Faces};
use crate::{Progress, Result};

/// Counts of what was done to a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rounds {
    /// Pairs of faces that had more in common than neighbours have.
    pub(crate) pairs: u64,
    /// Faces that were divided, or of which a part was taken away.
    pub(crate) divided: u64,
    /// Faces that were taken away as a whole.
    pub(crate) removed: u64,
    /// Times that faces were divided.
    pub(crate) rounds: u32,
    /// The furthest that a new vertex was moved, in steps of the grid.
    pub(crate) displacement: f64,
}

/// Times after which a surface is left as it is, as where it gets worse: the builder of the file then tells where it still
/// crosses itself. (The worst scans of the test data take five.)
const MOST_ROUNDS: u32 = 12;

/// Returns the faces that bound what is inside of some closed surfaces, planar and on the grid. `path` is for errors.
///
/// # Errors
/// If `memory` bytes are not enough, or on interruption.
pub(crate) fn arrange(
    mut faces: FaceList,
    operands: &Operands<'_>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(FaceList, Rounds)> {
    let mut rounds = Rounds::default();
    let mut moved = Vec::new();
    let mut changed: Vec<bool> = Vec::new();
    let far = [i32::from((operands.is_inside)(operands.far))];
    loop {
        let ends = [faces.len() as u32];
        let of_result = Operands {
            ends: &ends,
            far: &far,
            are_bodies: false,
            changed: &changed,
            is_inside: &|windings| windings[0] > 0,
        };
        let operands = if rounds.rounds == 0 { operands } else { &of_result };
        let (kept, is_new, resolved) =
            planar(&faces, |each| resolve(&faces, operands, path, memory, progress, each))?;
        let Resolved { pairs, divided, removed, displacement, corners, is_moved } = resolved;
        if rounds.rounds == 0 {
            rounds = Rounds { pairs, divided, removed, ..rounds };
        }
        faces = kept;
        changed = is_new;
        rounds.displacement = rounds.displacement.max(displacement);
        let is_worse = rounds.rounds > 0 && divided > 2 * rounds.divided.max(50);
        if divided + removed == 0 || is_worse || rounds.rounds == MOST_ROUNDS {
            return Ok((faces, rounds));
        }
        rounds.rounds += 1;
        if !is_moved || faces.is_empty() {
            return Ok((faces, rounds));
        }
        moved.extend(corners);
        if rounds.rounds > 1 {
            // Moving corners has made new crossings: what is thinner than a step has to go.
            let (bent, is_bent, ()) = planar(&faces, |each| snap(&faces, &moved, &changed, progress, each))?;
            (faces, changed) = (bent, is_bent);
        }
    }
}

/// Collects what is made of faces as planar ones, whether each is new, and what else is returned.
fn planar<R>(
    faces: &FaceList,
    make: impl FnOnce(&mut EachFace<'_>) -> Result<R>,
) -> Result<(FaceList, Vec<bool>, R)> {
    let mut list = FaceList::new(faces.grid().clone(), faces.parts().to_vec());
    let mut changed = Vec::new();
    let mut planar = PlanarFaces::new();
    planar.is_coloured = faces.is_coloured();
    let made = make(&mut |face, is_new| {
        planar.face(face, &mut |face| {
            list.push(face);
            changed.push(is_new);
            Ok(())
        })
    })?;
    Ok((list, changed, made))
}
