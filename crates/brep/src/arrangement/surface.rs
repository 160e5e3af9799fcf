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

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;

use super::contact::Contact;
use super::copies::Copies;
use super::exact_face::{ExactFace, ExactFaces};
use super::fate::RegionFate;
use super::operands::Operands;
use super::orientation::Turned;
use super::overlay::{PlaneRegion, PlaneSegment, VertexKey, Vertices, regions};
use super::point::{ExactPlane, ExactPoint};
use super::rounding::colours;
use super::sample::SamplePoint;
use crate::boxes::{BOX, Bounds, BoxTree};
use crate::exact::bounds::MARGIN;
use crate::exact::normal::{newell, ring_normal};
use crate::exact::union_find::UnionFind;
use crate::face_triangle::FaceTriangle;
use crate::geometry::Triangulator;
use crate::{Face, Faces};
use spinney_base::parallel;
use spinney_base::{Error, Progress, Result, SilentProgress, SubProgress, sort};

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

/// Faces, or edges, between two checks for cancellation.
pub(super) const OFTEN: u32 = 1 << 12;

/// Bytes per triangle while a surface is resolved, apart from the list of faces.
pub(crate) const FACE: u64 = (size_of::<ExactPlane>() + BOX + 3 * 40 + 16) as u64;

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
            outside_area += area(face);
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
        _ => outside_area / (0..faces.len() as usize).map(|number| area(&faces.get(number))).sum::<f64>(),
    };
    let (pairs, divided) = (contacts.len() as u64 + surface.copies.len(), divided_faces);
    Ok(Resolved { pairs, divided, removed, outside, outside_share, turned })
}

/// Returns the contacts: pairs of faces with more in common than neighbours have. Does not advance
/// the progress.
///
/// # Errors
/// If `memory` bytes are insufficient, or on cancellation.
pub(crate) fn contacts_of(
    faces: &ExactFaces,
    operands: &Operands<'_>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Vec<Contact>> {
    let surface = Surface::of(faces, operands, path, faces.list.len() * FACE + faces.bytes(), progress)?;
    surface.contacts(memory, &SilentProgress(progress))
}

pub(super) fn too_large(path: &Path, needed: u64, limit: u64) -> Error {
    Error::TooLarge {
        path: path.to_path_buf(),
        what: "dividing the surface, with the contacts of its faces,".into(),
        needed,
        limit,
        advice: "allow more with --memory".into(),
    }
}

/// Components by their first faces, each with a face that has an area.
type Samples = Vec<(u32, u32)>;

/// The regions of a face that stay.
#[derive(Default)]
struct Divided {
    regions: Vec<ExactFace>,
    /// Whether a region was removed that has the outside on both sides.
    is_outside: bool,
    /// If the whole face stays unchanged: whether it is reversed, and its part.
    whole: Option<(bool, u32)>,
}

/// Faces with their planes, and a tree over their boxes.
pub(crate) struct Surface<'a> {
    pub(super) faces: &'a ExactFaces,
    pub(super) operands: &'a Operands<'a>,
    /// Path of a model, for errors.
    pub(super) path: &'a Path,
    /// Memory of faces, planes and boxes, in bytes.
    pub(super) bytes: u64,
    /// Equal faces.
    pub(super) copies: Copies,
    /// Planes of the faces; `None` for a face without area, and for a copy.
    pub(super) planes: Vec<Option<ExactPlane>>,
    /// Whether each face's component is reversed; empty if none is.
    pub(super) turned: Vec<bool>,
    /// A tree over the faces' boxes, built on first use.
    tree: OnceLock<BoxTree>,
    /// Triangles of the faces that are not triangles.
    triangles: HashMap<u32, Vec<FaceTriangle>>,
}

impl<'a> Surface<'a> {
    /// Computes the planes and triangles of the operands' faces. `path` is for errors.
    ///
    /// # Errors
    /// If planes and boxes do not fit into the memory, or on cancellation.
    pub(crate) fn new(
        faces: &'a ExactFaces,
        operands: &'a Operands<'a>,
        path: &'a Path,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Surface<'a>> {
        let needed = faces.list.len() * FACE + faces.bytes();
        match needed > memory {
            true => Err(too_large(path, needed, memory)),
            false => Surface::of(faces, operands, path, needed, progress),
        }
    }

    /// Returns the error for a result that would exceed the memory.
    pub(crate) fn too_large(&self, memory: u64) -> Error {
        too_large(self.path, memory.saturating_add(1), memory)
    }

    fn of(
        faces: &'a ExactFaces,
        operands: &'a Operands<'a>,
        path: &'a Path,
        bytes: u64,
        progress: &dyn Progress,
    ) -> Result<Surface<'a>> {
        let count = faces.list.len() as u32;
        let mut planes = Vec::with_capacity(count as usize);
        let mut triangles = HashMap::new();
        let mut triangulator = Triangulator::new();
        let copies = if operands.unites_equal_faces { Copies::of(faces) } else { Copies::default() };
        for number in 0..count {
            if number.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            if let Some(exact) = faces.exact.get(&number) {
                planes.push(Some(exact.plane));
                continue;
            }
            let face = faces.list.get(number as usize);
            let normal = ring_normal(face.rings().next().unwrap_or_default());
            if normal == [0; 3] || copies.is_copy(number) {
                planes.push(None);
                continue;
            }
            planes.push(Some(ExactPlane::through(face.points[0], normal)));
            if face.points.len() > 3 {
                triangles
                    .insert(number, FaceTriangle::of_face(face.points, face.ring_ends, &mut triangulator));
            }
        }
        let (turned, tree) = (Vec::new(), OnceLock::new());
        Ok(Surface { faces, operands, path, bytes, copies, planes, turned, tree, triangles })
    }

    /// Returns a tree over the boxes of all faces with an area.
    pub(crate) fn boxes(&self) -> &BoxTree {
        self.tree.get_or_init(|| BoxTree::of(self.boxes_with_area(0..self.planes.len() as u32)))
    }

    /// Builds the tree of [`Surface::boxes`], unless it exists.
    pub(super) fn make_boxes(&self, progress: &dyn Progress) -> Result<()> {
        if self.tree.get().is_none() {
            let tree = self.boxes_of(0..self.planes.len() as u32, progress)?;
            self.tree.get_or_init(|| tree);
        }
        Ok(())
    }

    /// Returns a tree over the boxes of those of `faces` that have an area.
    pub(super) fn boxes_of(&self, faces: Range<u32>, progress: &dyn Progress) -> Result<BoxTree> {
        BoxTree::watched(&self.boxes_with_area(faces), progress)
    }

    fn boxes_with_area(&self, faces: Range<u32>) -> Vec<(u32, Bounds)> {
        let has_area = |face: &u32| self.planes[*face as usize].is_some();
        faces.filter(has_area).map(|face| (face, self.bounds(face))).collect()
    }

    /// Returns the exact face, if the face has vertices off the grid.
    pub(super) fn exact(&self, face: u32) -> Option<&'a ExactFace> {
        self.faces.exact.get(&face)
    }

    /// Returns the face from the list: exact faces have rounded vertices there.
    pub(crate) fn face(&self, face: u32) -> Face<'a> {
        self.faces.list.get(face as usize)
    }

    /// Returns the face as an exact face.
    pub(crate) fn polygon(&self, face: u32) -> Cow<'a, ExactFace> {
        let of_grid = || ExactFace::of_grid(&self.faces.list.get(face as usize), self.plane(face));
        self.exact(face).map_or_else(|| Cow::Owned(of_grid()), Cow::Borrowed)
    }

    /// Returns the box around a face.
    pub(super) fn bounds(&self, face: u32) -> Bounds {
        self.faces.bounds(face)
    }

    pub(crate) fn plane(&self, face: u32) -> &ExactPlane {
        self.planes[face as usize]
            .as_ref()
            .unwrap_or_else(|| unreachable!("only faces with an area are requested"))
    }

    /// Returns the operand of a face.
    pub(crate) fn operand(&self, face: u32) -> usize {
        self.operands.ends.partition_point(|end| *end <= face)
    }

    /// Returns a face that is a triangle with vertices on the grid.
    pub(super) fn triangle(&self, face: u32) -> Option<FaceTriangle> {
        let points = self.faces.list.get(face as usize).points;
        let corners: [[i32; 3]; 3] = points.try_into().ok()?;
        self.exact(face).is_none().then(|| FaceTriangle::of_triangle(corners))
    }

    /// Passes the triangles of a face.
    pub(super) fn with_triangles<R>(&self, face: u32, use_triangles: impl FnOnce(&[FaceTriangle]) -> R) -> R {
        match self.triangles.get(&face) {
            Some(triangles) => use_triangles(triangles),
            None => {
                let points = self.faces.list.get(face as usize).points;
                use_triangles(&[FaceTriangle::of_triangle(std::array::from_fn(|corner| points[corner]))])
            }
        }
    }

    /// Returns the component of each face without contacts, by its first face, and one face with an
    /// area per component. Other faces are components of their own, without a sample.
    fn components(
        &self,
        touching: &HashMap<u32, Vec<u32>>,
        progress: &dyn Progress,
    ) -> Result<(Vec<u32>, Samples)> {
        let count = self.planes.len() as u32;
        let mut sets = UnionFind::new(count as usize);
        let edges = if self.operands.decides_each { Vec::new() } else { self.sorted_edges(progress)? };
        // Invariant: all faces of a component have the same winding numbers in front, and the same
        // at the back. Joined faces share an edge that no third face has, and have no contacts, so
        // no other face separates them. If two faces of a component were on different sides of
        // another surface, one of them would get the other's fate.
        for (number, edge) in edges.chunk_by(|a, b| a.0 == b.0).enumerate() {
            if number.is_multiple_of(OFTEN as usize) {
                progress.check()?;
            }
            if let [(_, one), (_, other)] = edge
                && self.copies.count(*one) == self.copies.count(*other)
                && !touching.contains_key(one)
                && !touching.contains_key(other)
            {
                sets.join(*one, *other);
            }
        }
        drop(edges);
        let components = sets.roots();
        // (Faces without area have no sides, and follow their neighbours.)
        let mut firsts = vec![u32::MAX; count as usize];
        for face in (0..count).filter(|face| self.planes[*face as usize].is_some()) {
            let first = &mut firsts[components[face as usize] as usize];
            *first = face.min(*first);
        }
        let firsts = (0..count)
            .zip(firsts)
            .filter(|(component, first)| *first != u32::MAX && !touching.contains_key(component));
        let firsts = firsts.collect();
        Ok((components, firsts))
    }

    /// Returns the undirected edges of all faces but copies, sorted, each with its face.
    pub(super) fn sorted_edges(&self, progress: &dyn Progress) -> Result<Vec<([VertexKey; 2], u32)>> {
        let mut edges: Vec<([VertexKey; 2], u32)> = Vec::new();
        let mut vertices = Vertices::default();
        let mut ring: Vec<VertexKey> = Vec::new();
        for face in 0..self.planes.len() as u32 {
            if face.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            if self.copies.is_copy(face) {
                continue;
            }
            let mut add = |ring: &[VertexKey]| {
                edges.extend((0..ring.len()).map(|i| {
                    let (from, to) = (ring[i], ring[(i + 1) % ring.len()]);
                    ([from.min(to), from.max(to)], face)
                }));
            };
            match self.exact(face) {
                Some(exact) => exact.rings().for_each(|corners| {
                    ring.clear();
                    ring.extend(corners.iter().map(|corner| vertices.key(&corner.point)));
                    add(&ring);
                }),
                None => self.faces.list.get(face as usize).rings().for_each(|corners| {
                    ring.clear();
                    ring.extend(corners.iter().map(|corner| (*corner, 0)));
                    add(&ring);
                }),
            }
        }
        sort::watched(&mut edges, progress)?;
        Ok(edges)
    }

    /// Whether the line through a sample meets a face.
    pub(crate) fn meets(&self, sample: &SamplePoint<'_>, face: u32) -> bool {
        match self.exact(face) {
            Some(exact) => sample.meets_exact(exact),
            None => {
                let Face { points, ring_ends, .. } = self.faces.list.get(face as usize);
                sample.meets(points, ring_ends)
            }
        }
    }

    /// Yields the faces whose boxes contain a sample.
    pub(crate) fn each_at(&self, sample: &SamplePoint<'_>, each: impl FnMut(u32)) {
        let near = sample.near;
        let holds = |[low, high]: &Bounds| {
            (0..3).all(|axis| {
                f64::from(low[axis]) - MARGIN <= near[axis] && near[axis] <= f64::from(high[axis]) + MARGIN
            })
        };
        self.boxes().each(&holds, each);
    }

    /// Divides a face along its contacts, and selects the regions that stay.
    fn divide(
        &self,
        face: u32,
        touching: &[u32],
        contacts: &[Contact],
        progress: &dyn Progress,
    ) -> Result<Divided> {
        let plane = self.plane(face);
        let axis = plane.main_axis();
        let mut segments = Vec::new();
        let mut corners = 0;
        self.edges(face, axis, |segment| {
            corners += 1;
            segments.push(segment);
        });
        let mut points = Vec::new();
        for &number in touching {
            let contact = &contacts[number as usize];
            let other = contact.faces[usize::from(contact.faces[0] == face)];
            let line = *self.plane(other);
            segments.extend(contact.segments.iter().map(|ends| PlaneSegment { ends: *ends, line }));
            points.extend_from_slice(&contact.points);
            // Edges in the plane divide the face, also those at which faces were cut into
            // triangles.
            self.edges(other, axis, |segment| {
                if segment.ends.iter().all(|end| plane.side(end) == 0) {
                    // (The plane of an edge may be this face's own plane.)
                    let line = if plane.is(&segment.line) { line } else { segment.line };
                    segments.push(PlaneSegment { line, ..segment });
                }
            });
        }
        let own = self.faces.list.get(face as usize);
        let (failed, is_outside) = (RefCell::new(None), Cell::new(false));
        // Distinct numbers keep regions separate.
        let number = Cell::new(0u32);
        let choose = |region: &PlaneRegion| {
            let sample = SamplePoint::of_region(plane, region);
            // Edges of other faces may enclose regions outside of the face.
            if progress.interrupted() || !self.meets(&sample, face) {
                return None;
            }
            match self.fate(&sample, face, false) {
                Ok(RegionFate::Stays { is_turned, part }) => {
                    number.set(number.get() + u32::from(self.operands.keeps_cuts));
                    return Some((is_turned, part.unwrap_or(own.part), number.get()));
                }
                Ok(fate) => is_outside.set(is_outside.get() || matches!(fate, RegionFate::Outside)),
                Err(error) => drop(failed.replace(Some(error))),
            }
            None
        };
        let gives_up = |_: usize| progress.interrupted();
        let found = regions(plane, &segments, &points, &gives_up, choose).unwrap_or_default();
        if let Some(error) = failed.take() {
            return Err(error);
        }
        let whole = match &found[..] {
            [(region, (is_turned, part, _))]
                if region.rings.iter().map(Vec::len).sum::<usize>() == corners =>
            {
                self.is_same(face, region).then_some((*is_turned, *part))
            }
            _ => None,
        };
        let regions = found.into_iter().map(|(region, (is_turned, part, _))| {
            let colours = |face: &ExactFace| colours(&own, plane, face);
            let mut exact = ExactFace::of_region(&own, plane, &region, is_turned);
            exact.colours = colours(&exact);
            exact.part = part;
            exact
        });
        Ok(Divided { regions: regions.collect(), is_outside: is_outside.get(), whole })
    }

    /// Whether all vertices of a region are vertices of the face.
    fn is_same(&self, face: u32, region: &PlaneRegion) -> bool {
        let own = self.polygon(face);
        region
            .rings
            .iter()
            .flatten()
            .all(|corner| own.corners.iter().any(|known| known.point.is(&corner.point)))
    }

    /// Yields the edges of a face. The planes of edges between grid points are parallel to `axis`.
    pub(crate) fn edges(&self, face: u32, axis: usize, mut each: impl FnMut(PlaneSegment)) {
        if let Some(exact) = self.exact(face) {
            return exact.edges().for_each(|(corner, next)| {
                each(PlaneSegment { ends: [corner.point, *next], line: corner.line })
            });
        }
        for ends in edges_of(&self.faces.list.get(face as usize)) {
            let [from, to] = ends;
            each(PlaneSegment {
                ends: ends.map(ExactPoint::of_grid),
                line: ExactPlane::along(axis, from, to),
            });
        }
    }
}

/// Returns the area of a face, in square grid units. Holes have the opposite orientation.
pub(crate) fn area(face: &Face<'_>) -> f64 {
    let mut sum = [0.0; 3];
    for ring in face.rings() {
        let normal = newell(ring);
        (0..3).for_each(|axis| sum[axis] += normal[axis] as f64);
    }
    sum.map(|part| part * part).iter().sum::<f64>().sqrt() / 2.0
}

/// Yields the edges of a face.
fn edges_of<'a>(face: &Face<'a>) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    face.rings().flat_map(|ring| (0..ring.len()).map(move |i| [ring[i], ring[(i + 1) % ring.len()]]))
}
