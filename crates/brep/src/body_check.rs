//! Whether faces bound a body, for themselves.

use std::path::Path;

use crate::arrangement::ExactFaces;
use crate::build::defects_of;
use crate::closure::{Closure, Seed, edges};
use crate::repair::divided;
use crate::{FaceList, Faces, InsideRule, show_place};
use spinney_base::{Error, Progress, Result, SilentProgress, sort};

/// The flaw that keeps some faces from being the boundary of a body, in words, with a place; `None` if they are one, or can be repaired by a rule, if
/// one is given. `path` is a model's for errors. Progress does not count.
///
/// # Errors
/// If `memory` bytes are not enough, if a face is none, or on interruption.
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
        return Ok(defects.first().map(|defect| format!("{} at {}", defect.kind, show_place(defect.place))));
    };
    match divided((&ExactFaces::of_grid(faces.clone()), false), rule, path, memory, &SilentProgress(progress))
    {
        Ok(_) => Ok(None),
        Err(Error::NotASolid { what, places, .. }) => {
            Ok(Some(places.first().map_or(what.clone(), |place| format!("{what}: {place}"))))
        }
        Err(error) => Err(error),
    }
}

/// Edges that have a face on one side only, in words.
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
    let place = first.map_or(String::new(), |at| format!(", at {}", show_place(faces.grid().to_world(at))));
    Ok(format!("open: {count} edges have a face on one side only{place}"))
}
