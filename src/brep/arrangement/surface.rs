//! Faces with what bounds no body taken away: by winding numbers of the surfaces that they belong to.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::boxes::{BOX, BoxTree, touch};
use super::meeting::{Meeting, meet};
use super::overlay::{Region, Segment, regions, root};
use super::point::{ExactPlane, ExactPoint, others};
use super::rounding::Rounder;
use super::sample::Sample;
use crate::brep::piece::Piece;
use crate::brep::{Face, FaceList, Faces};
use crate::geometry::Triangulator;
use crate::geometry::crossing::ring_normal;
use crate::parallel;
use crate::{Error, Progress, Result};

/// Counts of what was done to a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Resolved {
    /// Pairs of faces that have more in common than neighbours have.
    pub(crate) pairs: u64,
    /// Faces that were divided, or of which a part was taken away.
    pub(crate) divided: u64,
    /// Faces that were taken away as a whole.
    pub(crate) removed: u64,
    /// The furthest that a new vertex was moved to the grid, in steps of it.
    pub(crate) displacement: f64,
    /// Corners of what is left of faces that were divided.
    pub(crate) corners: Vec<[i32; 3]>,
    /// Whether new vertices were moved at all.
    pub(crate) is_moved: bool,
}

/// Surfaces whose faces stand one behind the other in a list, and what of space is inside of the result.
#[derive(Clone, Copy)]
pub(crate) struct Operands<'a> {
    /// Where each one's faces end in the list.
    pub(crate) ends: &'a [u32],
    /// How many times each goes around what is far away: 0, or 1 where it bounds what is outside of it.
    pub(crate) far: &'a [i32],
    /// Whether each bounds a body by itself: its winding numbers are 0 or 1, and its faces do not pass through each other.
    pub(crate) are_bodies: bool,
    /// If there are any: the faces of which each may pass through any other; no other pair does.
    pub(crate) changed: &'a [bool],
    /// Whether places which they go around so many times are inside.
    pub(crate) is_inside: &'a (dyn Fn(&[i32]) -> bool + Sync),
}

/// What takes faces, and whether each is new.
pub(crate) type EachFace<'a> = dyn FnMut(&Face<'_>, bool) -> Result<()> + 'a;

/// Bytes that a triangle takes while a surface is resolved, apart from the list that it comes in.
const FACE: u64 = (size_of::<ExactPlane>() + BOX + 3 * 40 + 16) as u64;

/// Hands out the faces that bound what is inside. Where faces pass through each other, they are divided, at vertices that
/// are moved to the nearest points of the grid: such faces may have rings whose corners do not lie in one plane, or that
/// fall together. Surfaces have to be closed.
///
/// What is handed out is told from what was there before: `true` stands for a region of a face that was divided.
///
/// All faces are held in memory; planes, boxes and edges take about 250 bytes each. The result depends on no number of
/// threads.
///
/// # Errors
/// If `memory` bytes are not enough, on interruption, or what `each` returns.
pub(crate) fn resolve(
    faces: &FaceList,
    operands: &Operands<'_>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
    each: &mut EachFace<'_>,
) -> Result<Resolved> {
    let needed = faces.len() * FACE + faces.bytes();
    if needed > memory {
        return Err(too_large(path, needed, memory));
    }
    let surface = Surface::of(faces, operands, path, needed);
    let contacts = surface.contacts(memory, progress)?;
    let mut of_face: HashMap<u32, Vec<u32>> = HashMap::new();
    for (number, contact) in (0..).zip(&contacts) {
        contact.faces.iter().for_each(|face| of_face.entry(*face).or_default().push(number));
    }
    let (components, samples) = surface.components(&of_face, progress)?;
    let kept = parallel::map(&samples, |face| {
        let face = *face;
        // (Of bodies it is known what is in front of a face, and behind it.)
        let own = operands.are_bodies.then(|| surface.operand(face));
        if progress.interrupted() { None } else { surface.stays(&surface.sample(face), face, own) }
    });
    let kept: HashMap<u32, Option<bool>> = samples.iter().copied().zip(kept).collect();
    let mut counts = Resolved { pairs: contacts.len() as u64, ..Resolved::default() };
    let mut divided: Vec<u32> = of_face.keys().copied().collect();
    divided.sort_unstable();
    // Some at a time, so that regions do not pile up.
    const BATCH: usize = 1 << 12;
    let mut regions_of: HashMap<u32, Divided> = HashMap::new();
    let mut next = 0;
    let (mut rounder, mut turner) = (Rounder::default(), Turner::default());
    for number in 0..faces.len() as u32 {
        if number % 4096 == 0 {
            progress.check()?;
        }
        if divided.get(next) == Some(&number) {
            if next % BATCH == 0 {
                let batch = &divided[next..divided.len().min(next + BATCH)];
                let found = parallel::map(batch, |face| {
                    if progress.interrupted() {
                        return Divided::default();
                    }
                    surface.divide(*face, &of_face[face], &contacts)
                });
                progress.check()?;
                regions_of = batch.iter().copied().zip(found).collect();
            }
            next += 1;
            let found = regions_of.remove(&number).unwrap_or_default();
            let face = faces.get(number as usize);
            if found.is_whole {
                each(&face, false)?;
            } else if found.regions.is_empty() {
                counts.removed += 1;
            } else {
                counts.divided += 1;
                let plane = surface.plane(number);
                for (region, turned) in &found.regions {
                    rounder.round(plane, &face, region, *turned, &mut |face| each(face, true))?;
                }
            }
            continue;
        }
        if surface.planes[number as usize].is_none() {
            continue;
        }
        match kept.get(&components[number as usize]) {
            Some(Some(false)) => each(&faces.get(number as usize), false)?,
            Some(Some(true)) => each(&turner.turn(&faces.get(number as usize)), false)?,
            _ => counts.removed += 1,
        }
    }
    counts.displacement = rounder.displacement;
    counts.corners = rounder.corners;
    counts.is_moved = rounder.is_moved;
    Ok(counts)
}

/// Turns faces to the other side; keeps its buffers from face to face.
#[derive(Default)]
struct Turner {
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
}

impl Turner {
    fn turn<'a>(&'a mut self, face: &Face<'a>) -> Face<'a> {
        self.points.clear();
        self.colours.clear();
        let mut start = 0;
        for &end in face.ring_ends {
            self.points.extend(face.points[start..end].iter().rev());
            if !face.colours.is_empty() {
                self.colours.extend(face.colours[start..end].iter().rev());
            }
            start = end;
        }
        Face { points: &self.points, colours: &self.colours, ..*face }
    }
}

fn too_large(path: &Path, needed: u64, limit: u64) -> Error {
    Error::TooLarge {
        path: path.to_path_buf(),
        what: "the surface that is to be resolved, with what its faces have in common,".into(),
        needed,
        limit,
        advice: "allow more with --memory".into(),
    }
}

/// A face's regions that stay, and whether they are turned to the other side.
#[derive(Default)]
struct Divided {
    regions: Vec<(Region, bool)>,
    /// Whether the face stays just as it is.
    is_whole: bool,
}

/// Common points of two faces.
struct Contact {
    faces: [u32; 2],
    segments: Vec<[ExactPoint; 2]>,
    points: Vec<ExactPoint>,
    /// Whether the faces lie in one plane.
    in_plane: bool,
}

/// Faces with their planes, and a tree over their boxes.
struct Surface<'a> {
    faces: &'a FaceList,
    operands: &'a Operands<'a>,
    /// Of a model, for errors.
    path: &'a Path,
    /// Memory that faces, planes and boxes take.
    bytes: u64,
    /// None of faces without an area.
    planes: Vec<Option<ExactPlane>>,
    boxes: BoxTree,
    /// Triangles of the faces that are no triangles.
    pieces: HashMap<u32, Vec<Piece>>,
}

impl<'a> Surface<'a> {
    fn of(faces: &'a FaceList, operands: &'a Operands<'a>, path: &'a Path, bytes: u64) -> Surface<'a> {
        let mut planes = Vec::with_capacity(faces.len() as usize);
        let mut boxes = Vec::with_capacity(faces.len() as usize);
        let mut pieces = HashMap::new();
        let mut triangulator = Triangulator::new();
        for number in 0..faces.len() as u32 {
            let face = faces.get(number as usize);
            let normal = ring_normal(face.rings().next().unwrap_or_default());
            if normal == [0; 3] {
                planes.push(None);
                continue;
            }
            planes.push(Some(ExactPlane::through(face.points[0], normal)));
            boxes.push((number, bounds(face.points)));
            if face.points.len() > 3 {
                pieces.insert(number, Piece::of_face(face.points, face.ring_ends, &mut triangulator));
            }
        }
        Surface { faces, operands, path, bytes, planes, boxes: BoxTree::of(boxes), pieces }
    }

    fn plane(&self, face: u32) -> &ExactPlane {
        self.planes[face as usize]
            .as_ref()
            .unwrap_or_else(|| unreachable!("only faces with an area are asked for"))
    }

    /// The operand that a face belongs to.
    fn operand(&self, face: u32) -> usize {
        self.operands.ends.partition_point(|end| *end <= face)
    }

    /// Looks at a face as triangles.
    fn with_pieces<R>(&self, face: u32, look: impl FnOnce(&[Piece]) -> R) -> R {
        match self.pieces.get(&face) {
            Some(pieces) => look(pieces),
            None => {
                let points = self.faces.get(face as usize).points;
                look(&[Piece::of_triangle(std::array::from_fn(|corner| points[corner]))])
            }
        }
    }

    /// All pairs of faces that have more in common than neighbours have. Of bodies these are faces of different ones, and
    /// what else such faces touch.
    fn contacts(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Contact>> {
        let mut bytes = self.bytes;
        let mut all = Vec::new();
        let mut add = |found: Vec<Contact>| {
            let of = |contact: &Contact| {
                let points = 2 * contact.segments.len() + contact.points.len();
                (size_of::<Contact>() + points * size_of::<ExactPoint>()) as u64
            };
            bytes += found.iter().map(of).sum::<u64>();
            if bytes > memory {
                return Err(too_large(self.path, bytes, memory));
            }
            all.extend(found);
            Ok(())
        };
        let every: Vec<u32> =
            (0..self.planes.len() as u32).filter(|face| self.planes[*face as usize].is_some()).collect();
        if !self.operands.changed.is_empty() {
            let is_changed = |face: u32| self.operands.changed[face as usize];
            let changed: Vec<u32> = every.into_iter().filter(|face| is_changed(*face)).collect();
            let is_wanted = |one, other| one != other && (one < other || !is_changed(other));
            self.pairs(&changed, &is_wanted, progress, &mut add)?;
            return Ok(all);
        }
        if !self.operands.are_bodies {
            self.pairs(&every, &|one, other| one < other, progress, &mut add)?;
            return Ok(all);
        }
        let differ = |one, other| one < other && self.operand(one) != self.operand(other);
        let mut touched = vec![false; self.planes.len()];
        let mut open = Vec::new();
        let mut touch = |contacts: &[Contact], open: &mut Vec<u32>| {
            for face in contacts.iter().flat_map(|contact| contact.faces) {
                if !std::mem::replace(&mut touched[face as usize], true) {
                    open.push(face);
                }
            }
        };
        self.pairs(&every, &differ, progress, &mut |found| {
            touch(&found, &mut open);
            add(found)
        })?;
        // Faces that are divided have to be wherever others of the same body touch them, too.
        let mut seen: HashSet<[u32; 2]> = HashSet::new();
        while !open.is_empty() {
            let faces = std::mem::take(&mut open);
            let same = |one, other| one != other && self.operand(one) == self.operand(other);
            self.pairs(&faces, &same, progress, &mut |mut found| {
                found.retain(|contact| {
                    let [one, other] = contact.faces;
                    seen.insert([one.min(other), one.max(other)])
                });
                touch(&found, &mut open);
                add(found)
            })?;
        }
        Ok(all)
    }

    /// Hands out, some at a time, the contacts of faces with others that are wanted.
    fn pairs(
        &self,
        faces: &[u32],
        is_wanted: &(dyn Fn(u32, u32) -> bool + Sync),
        progress: &dyn Progress,
        each: &mut dyn FnMut(Vec<Contact>) -> Result<()>,
    ) -> Result<()> {
        const TASK: usize = 1 << 10;
        let tasks: Vec<&[u32]> = faces.chunks(TASK).collect();
        for tasks in tasks.chunks(64) {
            progress.check()?;
            let found = parallel::map(tasks, |faces| {
                let mut found = Vec::new();
                let mut others = Vec::new();
                for &one in *faces {
                    if progress.interrupted() {
                        break;
                    }
                    let own = bounds(self.faces.get(one as usize).points);
                    others.clear();
                    self.boxes.each(&|bounds| touch(bounds, &own), |other| {
                        if is_wanted(one, other) {
                            others.push(other);
                        }
                    });
                    others.sort_unstable();
                    found.extend(others.iter().filter_map(|other| self.contact(one, *other)));
                }
                found
            });
            found.into_iter().try_for_each(&mut *each)?;
        }
        Ok(())
    }

    fn contact(&self, one: u32, other: u32) -> Option<Contact> {
        let mut contact =
            Contact { faces: [one, other], segments: Vec::new(), points: Vec::new(), in_plane: false };
        let (plane_a, plane_b) = (self.plane(one), self.plane(other));
        self.with_pieces(one, |a| {
            self.with_pieces(other, |b| {
                for a in a {
                    for b in b {
                        match meet(a, plane_a, b, plane_b) {
                            Meeting::Regular => {}
                            Meeting::Point(point) => contact.points.push(point),
                            Meeting::Segment(ends) => contact.segments.push(ends),
                            Meeting::InPlane => contact.in_plane = true,
                        }
                    }
                }
            });
        });
        let is_contact = contact.in_plane || !contact.segments.is_empty() || !contact.points.is_empty();
        is_contact.then_some(contact)
    }

    /// The component of each face that touches nothing but its neighbours, by its first face, and these; others are
    /// components of their own, which are not told.
    fn components(
        &self,
        touching: &HashMap<u32, Vec<u32>>,
        progress: &dyn Progress,
    ) -> Result<(Vec<u32>, Vec<u32>)> {
        let count = self.planes.len() as u32;
        let mut parents: Vec<u32> = (0..count).collect();
        let mut edges: Vec<([[i32; 3]; 2], u32)> = Vec::new();
        for face in (0..count).filter(|face| self.planes[*face as usize].is_some()) {
            for ring in self.faces.get(face as usize).rings() {
                edges.extend((0..ring.len()).map(|i| {
                    let (from, to) = (ring[i], ring[(i + 1) % ring.len()]);
                    ([from.min(to), from.max(to)], face)
                }));
            }
        }
        progress.check()?;
        edges.sort_unstable();
        // Two faces at an edge are on the same side of everything.
        for edge in edges.chunk_by(|a, b| a.0 == b.0) {
            if let [(_, one), (_, other)] = edge
                && !touching.contains_key(one)
                && !touching.contains_key(other)
            {
                let [one, other] = [*one, *other].map(|face| root(&mut parents, face));
                parents[one.max(other) as usize] = one.min(other);
            }
        }
        let components: Vec<u32> = (0..count).map(|face| root(&mut parents, face)).collect();
        let firsts = (0..count).filter(|face| {
            components[*face as usize] == *face
                && !touching.contains_key(face)
                && self.planes[*face as usize].is_some()
        });
        let firsts = firsts.collect();
        Ok((components, firsts))
    }

    /// A point inside a face.
    fn sample(&self, face: u32) -> Sample<'_> {
        let corners = self.with_pieces(face, |pieces| pieces.first().map(|piece| piece.corners));
        let first = self.faces.get(face as usize).points[0];
        Sample::of_triangle(self.plane(face), &corners.unwrap_or([first; 3]))
    }

    /// Whether a region of a face, by a point of it, bounds what is inside: then whether its front has to be turned
    /// round. Of faces that lie on each other, one stays for all; but if `alone` is the face's body, what else of it lies
    /// there does not matter.
    fn stays(&self, sample: &Sample<'_>, face: u32, alone: Option<usize>) -> Option<bool> {
        let (axis, near) = (sample.axis, sample.near);
        let [u, v] = others(axis);
        let reaches = |[low, high]: &[[i32; 3]; 2]| {
            let holds = |axis: usize| {
                f64::from(low[axis]) - 1e-6 <= near[axis] && near[axis] <= f64::from(high[axis]) + 1e-6
            };
            holds(u) && holds(v) && near[axis] <= f64::from(high[axis]) + 1e-6
        };
        // The winding numbers above and below; faces in the same place, and whether they are turned up.
        let mut above = self.operands.far.to_vec();
        let mut below = above.clone();
        let mut same: Vec<(u32, bool)> = Vec::new();
        self.boxes.each(&reaches, |other| {
            let plane = self.plane(other);
            let up = plane.normal[axis].signum() as i32;
            let operand = self.operand(other);
            if up == 0 || (alone == Some(operand) && other != face) {
                return;
            }
            let Face { points, ring_ends, .. } = self.faces.get(other as usize);
            if !sample.meets(points, ring_ends) {
                return;
            }
            let side = if other == face { 0 } else { sample.side(plane) };
            // Those that lie below do not count.
            if side * up > 0 {
                return;
            }
            below[operand] += up;
            if side == 0 {
                same.push((other, up > 0));
            } else {
                above[operand] += up;
            }
        });
        if let Some(own) = alone {
            let is_up = self.plane(face).normal[axis] > 0;
            (above[own], below[own]) = if is_up { (0, 1) } else { (1, 0) };
        }
        let (front, back) = ((self.operands.is_inside)(&above), (self.operands.is_inside)(&below));
        if front == back {
            return None;
        }
        let is_up = back;
        same.sort_unstable();
        let stays = same.iter().find(|(_, up)| *up == is_up).or(same.first())?;
        (stays.0 == face).then_some(stays.1 != is_up)
    }

    /// Divides a face by what touches it.
    fn divide(&self, face: u32, touching: &[u32], contacts: &[Contact]) -> Divided {
        let plane = self.plane(face);
        let axis = plane.main_axis();
        let own = self.faces.get(face as usize);
        let edge = |[from, to]: [[i32; 3]; 2]| Segment {
            ends: [from, to].map(ExactPoint::of_grid),
            line: ExactPlane::along(axis, from, to),
        };
        let mut segments: Vec<Segment> = edges_of(&own).map(edge).collect();
        let mut points = Vec::new();
        for &number in touching {
            let contact = &contacts[number as usize];
            let other = contact.faces[usize::from(contact.faces[0] == face)];
            let line = *self.plane(other);
            segments.extend(contact.segments.iter().map(|ends| Segment { ends: *ends, line }));
            points.extend_from_slice(&contact.points);
            let its = self.faces.get(other as usize);
            // Edges in the plane divide it, wherever they were cut into triangles.
            if contact.in_plane || its.points.len() > 3 || own.points.len() > 3 {
                let in_plane = |ends: &[[i32; 3]; 2]| ends.iter().all(|end| plane.height(*end) == 0);
                segments.extend(edges_of(&its).filter(in_plane).map(edge));
            }
        }
        let found = regions(plane, &segments, &points);
        let corners = own.points.len();
        let mut kept = Vec::new();
        let is_one = found.len() == 1 && found[0].rings.iter().map(Vec::len).sum::<usize>() == corners;
        for region in found {
            let sample = Sample::of_region(plane, &region);
            // Edges of others may have made regions outside of the face.
            if !sample.meets(own.points, own.ring_ends) {
                continue;
            }
            if let Some(turned) = self.stays(&sample, face, None) {
                kept.push((region, turned));
            }
        }
        let is_whole = is_one && kept.len() == 1 && !kept[0].1;
        Divided { regions: kept, is_whole }
    }
}

/// The edges of a face.
fn edges_of<'a>(face: &Face<'a>) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    face.rings().flat_map(|ring| (0..ring.len()).map(move |i| [ring[i], ring[(i + 1) % ring.len()]]))
}

/// The box around some points.
fn bounds(points: &[[i32; 3]]) -> [[i32; 3]; 2] {
    points.iter().fold([[i32::MAX; 3], [i32::MIN; 3]], |[low, high], point| {
        [[0, 1, 2].map(|axis| low[axis].min(point[axis])), [0, 1, 2].map(|axis| high[axis].max(point[axis]))]
    })
}
