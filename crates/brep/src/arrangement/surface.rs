//! Faces of a surface that is divided by itself, and queries of them.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;

use super::contact::Contact;
use super::copies::Copies;
use super::exact_face::{ExactFace, ExactFaces};
use super::fate::RegionFate;
use super::operands::Operands;
use super::overlay::{PlaneRegion, PlaneSegment, VertexKey, Vertices, regions};
use super::point::{ExactPlane, ExactPoint};
use super::rounding::colours;
use super::sample::SamplePoint;
use crate::boxes::{BOX, Bounds, BoxTree};
use crate::exact::bounds::MARGIN;
use crate::exact::normal::ring_normal;
use crate::exact::union_find::UnionFind;
use crate::face_triangle::FaceTriangle;
use crate::geometry::Triangulator;
use crate::{Face, Faces};
use spinney_base::{Error, Progress, Result, SilentProgress, sort};

/// Faces, or edges, between two checks for cancellation.
pub(super) const OFTEN: u32 = 1 << 12;

/// Bytes per triangle while a surface is resolved, apart from the list of faces.
pub(crate) const FACE: u64 = (size_of::<ExactPlane>() + BOX + 3 * 40 + 16) as u64;

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
pub(super) struct Divided {
    pub(super) regions: Vec<ExactFace>,
    /// Whether a region was removed that has the outside on both sides.
    pub(super) is_outside: bool,
    /// If the whole face stays unchanged: whether it is reversed, and its part.
    pub(super) whole: Option<(bool, u32)>,
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
    pub(super) fn components(
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
    pub(super) fn divide(
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

/// Yields the edges of a face.
fn edges_of<'a>(face: &Face<'a>) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    face.rings().flat_map(|ring| (0..ring.len()).map(move |i| [ring[i], ring[(i + 1) % ring.len()]]))
}
