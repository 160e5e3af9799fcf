//! Whether a set of faces bounds a solid.

use std::path::Path;

use crate::arrangement::ExactFaces;
use crate::build::defects_of;
use crate::closure::{Closure, Seed, edges};
use crate::repair::divided;
use crate::{FaceList, Faces, InsideRule, format_position};
use spinney_base::{Error, Progress, Result, SilentProgress, sort};

/// Returns a description of the flaw, with a position, that keeps faces from bounding a solid.
/// Returns `None` if they do, or if `repair` is given and can repair them. `path` is the model's,
/// for errors. Progress is only checked for cancellation.
///
/// # Errors
/// If `memory` bytes are not enough, if a face is invalid, or on cancellation.
pub fn body_flaw(
    faces: &FaceList,
    repair: Option<InsideRule>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Option<String>> {
    let mut closure = Closure::new(Seed::new());
    for number in 0..faces.len() as usize {
        if number.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        closure.add(&faces.get(number));
    }
    if !closure.is_closed() {
        return open_edges(faces, progress).map(Some);
    }
    let Some(rule) = repair else {
        let defects = defects_of(faces, progress)?;
        let volume: i128 = (0..faces.len() as usize).map(|number| faces.get(number).six_volumes()).sum();
        if defects.is_empty() && volume == 0 {
            return Ok(Some("it has no volume".into()));
        }
        return Ok(defects
            .first()
            .map(|defect| format!("{} at {}", defect.kind, format_position(defect.place))));
    };
    match divided((&ExactFaces::of_grid(faces.clone()), false), rule, path, memory, &SilentProgress(progress))
    {
        Ok(_) => Ok(None),
        Err(Error::NotASolid { what, locations, .. }) => {
            Ok(Some(locations.first().map_or(what.clone(), |location| format!("{what}: {location}"))))
        }
        Err(error) => Err(error),
    }
}

/// Describes the edges that have a face on one side only.
fn open_edges(faces: &FaceList, progress: &dyn Progress) -> Result<String> {
    let all = || (0..faces.len() as usize).map(|number| faces.get(number));
    let mut there: Vec<[[i32; 3]; 2]> = all().flat_map(|face| edges(&face).collect::<Vec<_>>()).collect();
    let mut back: Vec<[[i32; 3]; 2]> = there.iter().map(|[from, to]| [*to, *from]).collect();
    sort::watched(&mut there, progress)?;
    sort::watched(&mut back, progress)?;
    let (mut count, mut first, mut at) = (0u64, None, 0);
    for edge in there {
        while back.get(at).is_some_and(|other| *other < edge) {
            at += 1;
        }
        if back.get(at) == Some(&edge) {
            at += 1;
        } else {
            count += 1;
            first.get_or_insert(edge[0]);
        }
    }
    let place =
        first.map_or(String::new(), |at| format!(", at {}", format_position(faces.grid().to_world(at))));
    Ok(format!("open: {count} edges have a face on one side only{place}"))
}
