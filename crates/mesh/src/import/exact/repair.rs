//! Repair of surfaces that pass through themselves: what they go around once or more is inside.

use std::path::Path;

use spinney_base::{Error, Progress, Result};
use spinney_brep::arrangement::{ExactFaces, Operands, Rounded, Rounds, divide, round};
use spinney_brep::{FaceList, Faces};

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
    /// Those of them that went around no place once or more, since they, or what is around them, are inside out.
    pub outside: u64,
    /// Their share of the surface's area: at most a half, as a surface that loses more is refused.
    pub outside_share: f64,
    /// Times that this was done, until moving the new vertices to the grid had no more consequences.
    pub rounds: u32,
    /// The furthest that a new vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
}

/// Times after which a surface is left as it is, as where it gets worse: the builder of the file then tells where it still
/// crosses itself. (The worst scans of the test data take five.)
const MOST_ROUNDS: u32 = 12;

/// Share of a surface's area that may be lost because it goes around no place once or more.
const MOST_OUTSIDE: f64 = 0.5;

/// Takes away what does not bound the body; the surface is closed. `path` is a model's for errors.
pub(super) fn repair(
    faces: FaceList,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(FaceList, Repair)> {
    let (width, count) = (faces.grid().width(), faces.len());
    let all = Operands {
        ends: &[faces.len() as u32],
        far: &[0],
        are_bodies: false,
        changed: &[],
        winding: &|_, _| None,
        is_inside: &|windings| windings[0] > 0,
    };
    let (faces, done) = divide(&ExactFaces::of_grid(faces), &all, path, memory, progress)?;
    let Rounds { pairs, divided, removed, outside, outside_share, mut rounds } = done;
    let (rounded, _) = round(faces)?.mended(false, MOST_ROUNDS, path, memory, progress, &mut rounds)?;
    let Rounded { faces, displacement, .. } = rounded;
    if faces.is_empty() {
        return Err(Error::NoBody {
            path: path.to_path_buf(),
            what: "nothing is inside: the surface goes around no place once or more".into(),
            places: Vec::new(),
            count: 0,
            advice: "turn its faces round if they point to the inside".into(),
        });
    }
    // A body that is mostly gone is no repair of it.
    if outside_share > MOST_OUTSIDE {
        let percent = (outside_share * 100.0).floor();
        return Err(Error::NoBody {
            path: path.to_path_buf(),
            what: format!(
                "most of it would be lost: {outside} of {count} faces, {percent} percent of the surface, go around no \
                 place once or more"
            ),
            places: Vec::new(),
            count: 0,
            advice: "turn round the faces that point to the inside, and divide edges that more than two faces have".into(),
        });
    }
    let displacement = displacement * width;
    Ok((faces, Repair { pairs, divided, removed, outside, outside_share, rounds, displacement }))
}
