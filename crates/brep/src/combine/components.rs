//! Near faces whose boxes touch no box of another body's faces. Each connected component of them
//! lies on one side of all other bodies, and the winding numbers of one sample settle it.

use std::collections::HashMap;

use super::bodies::Bodies;
use super::table::Fate;
use super::winding::winding;
use crate::arrangement::{ExactFace, ExactPlane, SamplePoint};
use crate::boxes::{Bounds, BoxTree, bounds_of};
use crate::exact::normal::ring_normal;
use crate::exact::union_find::UnionFind;
use crate::face_triangle::FaceTriangle;
use crate::geometry::Triangulator;
use crate::{ExactModel, FaceBuffer};
use spinney_base::{Progress, Result, parallel};

/// Faces per task.
const TASK: usize = 1 << 10;

/// Number of a face: of the octree, or of an exact face.
#[derive(Clone, Copy, Debug)]
pub(super) enum FaceNumber {
    OnGrid(u32),
    Exact(u32),
}

/// The vertices of a face on the common grid.
enum NearFace<'f> {
    OnGrid { points: &'f [[i32; 3]], ring_ends: &'f [usize] },
    Exact(ExactFace),
}

impl NearFace<'_> {
    /// Passes the grid points nearest to the vertices, and the maximum rounding distance in grid
    /// units.
    fn with_points<R>(&self, take: impl FnOnce(&[[i32; 3]], i32) -> R) -> R {
        match self {
            NearFace::OnGrid { points, .. } => take(points, 0),
            NearFace::Exact(face) => take(&face.rounded(), 1),
        }
    }

    /// Returns the box around the face, enlarged by `more` grid units.
    fn bounds(&self, more: i32) -> Bounds {
        self.with_points(|points, off| bounds_of(points, off + more))
    }
}

/// Faces of one body that touch no other body.
#[derive(Default)]
struct Components {
    /// Component of each vertex.
    of_vertex: HashMap<[i32; 3], u32>,
    sets: UnionFind,
    /// First face of each component.
    firsts: Vec<FaceNumber>,
    /// Faces, each with its component.
    faces: Vec<(FaceNumber, u32)>,
}

impl Components {
    fn add(&mut self, face: FaceNumber, points: &[[i32; 3]]) {
        let mut own: Option<u32> = None;
        for point in points {
            let new = own.unwrap_or(self.sets.len() as u32);
            let found = *self.of_vertex.entry(*point).or_insert(new);
            if found as usize == self.sets.len() {
                self.sets.push();
                self.firsts.push(face);
            }
            // Invariant: faces of a component share vertices, or have vertices within half a grid
            // unit of a shared grid point, and none comes within a grid unit of another body. So
            // they all lie on the same sides of all other bodies, and one face decides for all. A
            // face that touched another body would connect its outside with its inside.
            own = Some(self.sets.join(own.unwrap_or(found), found));
        }
        self.faces.extend(own.map(|own| (face, own)));
    }

    /// Returns the memory use in bytes.
    fn bytes(&self) -> u64 {
        // (A hash table is half empty after it has grown.)
        const VERTEX: usize = 2 * (size_of::<([i32; 3], u32)>() + 1);
        (self.of_vertex.len() * VERTEX + 12 * self.sets.len() + size_of_val(&self.faces[..])) as u64
    }
}

impl Bodies<'_> {
    /// Settles the near faces whose boxes touch no box of another body's faces. Takes about 100
    /// bytes for each near face.
    ///
    /// # Errors
    /// If `memory` bytes are insufficient, if files are corrupt or cannot be read, or on
    /// cancellation.
    pub(super) fn settle_components(&mut self, memory: u64, progress: &dyn Progress) -> Result<()> {
        let trees = self.near_boxes(memory, progress)?;
        let boxes: u64 = trees.iter().map(|tree| tree.len() as u64).sum();
        let available = memory.saturating_sub(boxes * BOX);
        for body in 0..self.models.len() {
            let components = self.components(body, &trees, available, progress)?;
            let Components { mut sets, firsts, faces, .. } = components;
            let roots: Vec<u32> =
                (0..).zip(sets.roots()).filter(|(own, root)| own == root).map(|(own, _)| own).collect();
            let fates = parallel::map(&roots, |root| match progress.interrupted() {
                true => Ok(Fate::Drop),
                false => self.fate_of(body, firsts[*root as usize]),
            });
            progress.check()?;
            let mut fate_of = HashMap::new();
            for (root, fate) in roots.into_iter().zip(fates) {
                fate_of.insert(root, fate?);
            }
            for (face, component) in faces {
                let fate = fate_of[&sets.root(component)];
                self.settle(body, face, fate);
            }
        }
        Ok(())
    }

    /// Drops the near faces whose boxes touch no box of another body's faces: contacts of two
    /// surfaces do not need them. Takes about 100 bytes for each near face.
    ///
    /// # Errors
    /// Those of [`Bodies::settle_components`].
    pub(super) fn drop_untouched(&mut self, memory: u64, progress: &dyn Progress) -> Result<()> {
        let trees = self.near_boxes(memory, progress)?;
        for body in 0..self.models.len() {
            let numbers = self.near_of(body);
            let chunks: Vec<&[FaceNumber]> = numbers.chunks(TASK).collect();
            for chunks in chunks.chunks(64) {
                progress.check()?;
                for separate_faces in parallel::map(chunks, |chunk| self.separate_faces(body, chunk, &trees))
                {
                    separate_faces?.into_iter().for_each(|face| self.settle(body, face, Fate::Drop));
                }
            }
        }
        Ok(())
    }

    /// Returns the faces of a body in cells near other bodies.
    pub(super) fn near_of(&self, body: usize) -> Vec<FaceNumber> {
        let overlap = &self.overlaps[body];
        let exact = overlap.exact.near().map(FaceNumber::Exact);
        overlap.faces.near().map(FaceNumber::OnGrid).chain(exact).collect()
    }

    /// Records the fate of a near face that turned out to touch no other body.
    fn settle(&mut self, body: usize, face: FaceNumber, fate: Fate) {
        let overlap = &mut self.overlaps[body];
        match face {
            FaceNumber::OnGrid(number) => overlap.faces.settle(number.into(), fate),
            FaceNumber::Exact(number) => overlap.exact.settle(number.into(), fate),
        }
    }

    /// Returns a tree over the boxes of the near faces of each body.
    fn near_boxes(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<BoxTree>> {
        let (mut trees, mut total) = (Vec::new(), 0);
        for body in 0..self.models.len() {
            let numbers = self.near_of(body);
            total += numbers.len() as u64;
            self.check_memory(body, total * BOX, memory)?;
            let mut boxes = Vec::with_capacity(numbers.len());
            for (index, chunk) in numbers.chunks(TASK).enumerate() {
                if index % 4 == 0 {
                    progress.check()?;
                }
                self.each_of(body, chunk, &mut |_, face| {
                    boxes.push((boxes.len() as u32, face.bounds(0)));
                    Ok(())
                })?;
            }
            trees.push(BoxTree::of(boxes));
        }
        Ok(trees)
    }

    /// Returns those of `faces` whose boxes touch no box of another body's faces.
    fn separate_faces(
        &self,
        body: usize,
        faces: &[FaceNumber],
        trees: &[BoxTree],
    ) -> Result<Vec<FaceNumber>> {
        let mut separate_faces = Vec::new();
        self.each_of(body, faces, &mut |number, face| {
            // (One grid unit more, since new vertices move.)
            let own = face.bounds(1);
            let mut others = trees.iter().enumerate().filter(|(other, _)| *other != body);
            if !others.any(|(_, tree)| tree.touches(&own)) {
                separate_faces.push(number);
            }
            Ok(())
        })?;
        Ok(separate_faces)
    }

    /// Groups a body's near faces that touch no box of another body's faces.
    fn components(
        &self,
        body: usize,
        trees: &[BoxTree],
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Components> {
        let numbers = self.near_of(body);
        let mut found = Components::default();
        let chunks: Vec<&[FaceNumber]> = numbers.chunks(TASK).collect();
        for chunks in chunks.chunks(64) {
            progress.check()?;
            let separate_faces = parallel::map(chunks, |chunk| self.separate_faces(body, chunk, trees));
            for separate_faces in separate_faces {
                self.each_of(body, &separate_faces?, &mut |number, face| {
                    face.with_points(|points, _| found.add(number, points));
                    Ok(())
                })?;
            }
            self.check_memory(body, found.bytes(), memory)?;
        }
        Ok(found)
    }

    /// Returns the fate of a face that touches no other body, by a sample point.
    fn fate_of(&self, body: usize, number: FaceNumber) -> Result<Fate> {
        let mut fate = Fate::Drop;
        self.each_of(body, &[number], &mut |_, face| {
            let plane;
            let (sample, region);
            match face {
                NearFace::OnGrid { points, ring_ends } => {
                    let triangles = FaceTriangle::of_face(points, ring_ends, &mut Triangulator::new());
                    let corners = triangles.first().map_or([points[0]; 3], |triangle| triangle.corners);
                    plane = ExactPlane::through(points[0], ring_normal(&points[..ring_ends[0]]));
                    sample = SamplePoint::of_triangle(&plane, &corners);
                }
                NearFace::Exact(face) => {
                    region = face.region();
                    sample = SamplePoint::of_region(&face.plane, &region);
                }
            }
            let mut windings = Vec::with_capacity(self.models.len());
            for (other, model) in self.models.iter().enumerate() {
                let is_own = other == body;
                windings.push(if is_own { 0 } else { winding(model, other, self.common_grid, &sample)? });
            }
            fate = self.table.fate(body, &windings);
            Ok(())
        })?;
        Ok(fate)
    }

    /// Yields faces of a body on the common grid.
    fn each_of(
        &self,
        body: usize,
        numbers: &[FaceNumber],
        each: &mut dyn FnMut(FaceNumber, &NearFace<'_>) -> Result<()>,
    ) -> Result<()> {
        let model: &ExactModel = self.models[body];
        let (mut buffer, mut points) = (FaceBuffer::default(), Vec::new());
        for &number in numbers {
            match number {
                FaceNumber::OnGrid(face) => {
                    model.face(face.into(), &mut buffer)?;
                    self.put(body, face.into(), &buffer.points, &mut points)?;
                    each(number, &NearFace::OnGrid { points: &points, ring_ends: &buffer.ring_ends })?;
                }
                FaceNumber::Exact(face) => {
                    each(number, &NearFace::Exact(self.common_grid.exact(body, model.exact_face(face)?)))?;
                }
            }
        }
        Ok(())
    }
}

/// Bytes per box while the tree is built.
const BOX: u64 = 96;
