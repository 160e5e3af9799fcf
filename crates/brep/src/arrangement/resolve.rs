//! Selection of the faces that bound the result, by the winding numbers on both sides of each.
//!
//! [`resolve`] works in these steps:
//!
//! 1. It finds the contacts: pairs of faces with more in common than neighbours have.
//! 2. Faces without contacts form components, connected by edges that exactly two faces share. The
//!    winding numbers in front of a component and at its back are the same everywhere, so one
//!    sample point decides for the component.
//! 3. A face with contacts is divided into regions ([`Surface::divide`]): by the segments that it
//!    shares with other faces, and by their edges in its plane. Nothing else meets the inside of a
//!    region, so one sample point decides for the region.
//! 4. For a sample, `Surface::fate` computes two winding numbers of each operand: just above and
//!    just below the face. "Above" is the positive direction of the main axis of the face's plane.
//!    The number above is the number at infinity plus the change at each face that a ray upwards
//!    crosses: 1 if the face is oriented upwards, -1 if downwards. The number below is the number
//!    above plus the change at the faces that contain the sample, of which there are several where
//!    faces coincide. For a body (winding numbers 0 and 1), a face at the sample determines both
//!    numbers, unless two of them cancel. The octree has the numbers of other bodies, so no ray is
//!    needed.
//! 5. [`Operands::is_inside`] maps the numbers of all operands on one side to "inside" or
//!    "outside". If both sides are equal, the region is removed. Otherwise it stays, and is
//!    reversed if its front would be inside. Of coincident faces, one stays.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::exact_face::{ExactFace, ExactFaces};
use super::fate::RegionFate;
use super::operands::Operands;
use super::orientation::Turned;
use super::surface::{Divided, OFTEN, Surface};
use crate::{Face, Faces};
use spinney_base::parallel;
use spinney_base::{Progress, Result, SubProgress, sort};

/// Report of the division of a surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Resolved {
    /// Pairs of faces with more in common than neighbours have.
    pub(crate) pairs: u64,
    /// Faces that were divided or trimmed.
    pub(crate) divided: u64,
    /// Faces that were removed as a whole.
    pub(crate) removed: u64,
    /// Removed faces with the outside on both sides, at least of a region.
    pub(crate) outside: u64,
    /// Their share of the area of all faces.
    pub(crate) outside_share: f64,
    /// Components that were reversed, and the volume after that, in cubic grid units; 0 if
    /// `turns_roots` is off.
    pub(crate) turned: Turned,
}

/// Remainder of a face in a surface.
pub(super) enum RemainingFace<'a> {
    /// The whole face, or its reverse.
    Whole { face: Face<'a>, is_turned: bool },
    /// A region of the face or of its reverse.
    Region { face: Face<'a>, exact: ExactFace },
}

/// Yields the faces that bound the inside, in the order of their origins. Intersecting faces are
/// divided; of coincident faces, one stays. Surfaces must be closed. Faces without area stay where
/// their component does; of bodies none stays, so that vertices may lie on edges.
///
/// All faces are in memory. Planes, boxes and edges take about 250 bytes per face. The result does
/// not depend on the number of threads. Progress counts each face twice: after its contacts are
/// found, and when its fate is known.
///
/// # Errors
/// If `memory` bytes are insufficient, on cancellation, or errors of `each`.
pub(super) fn resolve(
    faces: &ExactFaces,
    operands: &Operands<'_>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
    each: &mut dyn FnMut(RemainingFace<'_>) -> Result<()>,
) -> Result<Resolved> {
    let total = 2 * faces.list.len();
    let mut surface = Surface::new(faces, operands, path, memory, progress)?;
    let contacts = surface.contacts(memory, &SubProgress::new(progress, faces.list.len(), total))?;
    let turned =
        if operands.turns_roots { surface.turn_roots(&contacts, progress)? } else { Turned::default() };
    let mut of_face: HashMap<u32, Vec<u32>> = HashMap::new();
    for (number, contact) in (0..).zip(&contacts) {
        contact.faces.iter().for_each(|face| of_face.entry(*face).or_default().push(number));
    }
    let (components, samples) = surface.components(&of_face, progress)?;
    let fates = parallel::map(&samples, |(_, face)| {
        // (Faces of bodies are in a component only if they touch no other body. Winding numbers of
        // other surfaces are sums over rays, and need all coincident faces.)
        if progress.interrupted() {
            Ok(RegionFate::Inside)
        } else {
            surface.face_fate(*face, operands.are_bodies)
        }
    });
    let mut fate_of: HashMap<u32, RegionFate> = HashMap::new();
    for ((component, _), fate) in samples.iter().zip(fates) {
        fate_of.insert(*component, fate?);
    }
    let mut divided_faces = 0;
    let mut divided: Vec<u32> = of_face.keys().copied().collect();
    sort::numbers32(&mut divided);
    // In batches, to limit the number of regions in memory.
    const BATCH: usize = 1 << 12;
    let mut regions_of: HashMap<u32, Divided> = HashMap::new();
    let mut next = 0;
    let faces = &faces.list;
    // First faces of copies, of which a region has the outside on both sides.
    let mut outside_firsts: HashSet<u32> = HashSet::new();
    let (mut removed, mut outside, mut outside_area) = (0, 0, 0.0);
    let mut remove = |face: &Face<'_>, is_outside: bool| {
        removed += 1;
        if is_outside {
            outside += 1;
            outside_area += face.area();
        }
    };
    for number in 0..faces.len() as u32 {
        if number.is_multiple_of(OFTEN) {
            progress.check()?;
            progress.advance(u64::from(OFTEN).min(faces.len() - u64::from(number)), total);
        }
        let face = faces.get(number as usize);
        let mut note_outside = |is_outside: bool| {
            if is_outside && surface.copies.count(number) > 1 {
                outside_firsts.insert(number);
            }
        };
        if surface.copies.is_copy(number) {
            // (Of coincident faces, the first stays.)
            if face.has_area() {
                remove(&face, outside_firsts.contains(&surface.copies.first(number)));
            }
        } else if divided.get(next) == Some(&number) {
            if next % BATCH == 0 {
                let batch = &divided[next..divided.len().min(next + BATCH)];
                let found = parallel::map(batch, |face| {
                    if progress.interrupted() {
                        return Ok(Divided::default());
                    }
                    surface.divide(*face, &of_face[face], &contacts, progress)
                });
                progress.check()?;
                regions_of.clear();
                for (face, found) in batch.iter().zip(found) {
                    regions_of.insert(*face, found?);
                }
            }
            next += 1;
            let found = regions_of.remove(&number).unwrap_or_default();
            note_outside(found.is_outside);
            match found.whole {
                Some((is_turned, part)) => {
                    each(RemainingFace::Whole { face: Face { part, ..face }, is_turned })?
                }
                None if found.regions.is_empty() => remove(&face, found.is_outside),
                None => {
                    divided_faces += 1;
                    found
                        .regions
                        .into_iter()
                        .try_for_each(|exact| each(RemainingFace::Region { face, exact }))?;
                }
            }
        } else {
            let has_area = surface.planes[number as usize].is_some();
            let fate = fate_of.get(&components[number as usize]);
            note_outside(matches!(fate, Some(RegionFate::Outside)));
            match fate {
                Some(RegionFate::Stays { is_turned, part }) if has_area || !operands.are_bodies => {
                    let part = part.unwrap_or(face.part);
                    each(RemainingFace::Whole { face: Face { part, ..face }, is_turned: *is_turned })?
                }
                fate if has_area => remove(&face, matches!(fate, Some(RegionFate::Outside))),
                // (Faces without area do not count as removed.)
                _ => {}
            }
        }
    }
    let outside_share = match outside {
        0 => 0.0,
        _ => outside_area / (0..faces.len() as usize).map(|number| faces.get(number).area()).sum::<f64>(),
    };
    let (pairs, divided) = (contacts.len() as u64 + surface.copies.len(), divided_faces);
    Ok(Resolved { pairs, divided, removed, outside, outside_share, turned })
}
