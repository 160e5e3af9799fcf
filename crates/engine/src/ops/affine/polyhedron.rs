//! Convex polyhedra: the part of a view's cell that lies in a node of the source, if axes do not
//! map to axes.

use glam::DVec3;
use smallvec::SmallVec;

use super::map::AffineMap;
use super::view::TINY;

/// Distance from a plane, in cells, that is less than all relevant ones and more than rounding
/// errors.
const ON_PLANE: f64 = 1e-9;

/// Convex polyhedron: the vertices of all faces, in order around each face.
#[derive(Clone, Debug, Default)]
pub(super) struct Polyhedron {
    vertices: SmallVec<[DVec3; 64]>,
    /// End of each face in `vertices`. (16 bits suffice: a polyhedron of n planes has fewer than 6n
    /// entries, and each window of a view adds six planes.)
    ends: SmallVec<[u16; 16]>,
}

impl Polyhedron {
    /// Box.
    pub(super) fn of_box(min: DVec3, max: DVec3) -> Polyhedron {
        let mut cube = Polyhedron::default();
        for axis in 0..3 {
            for is_high in [false, true] {
                // Around the face: the other axes are low, low; high, low; high, high; low, high.
                for (second, third) in [(false, false), (true, false), (true, true), (false, true)] {
                    let mut vertex = min;
                    let flags = [(axis, is_high), ((axis + 1) % 3, second), ((axis + 2) % 3, third)];
                    for (axis, _) in flags.into_iter().filter(|(_, is_high)| *is_high) {
                        vertex[axis] = max[axis];
                    }
                    cube.vertices.push(vertex);
                }
                cube.ends.push(cube.vertices.len() as u16);
            }
        }
        cube
    }

    /// Image by an affine map.
    pub(super) fn mapped(mut self, map: &AffineMap) -> Polyhedron {
        for vertex in &mut self.vertices {
            *vertex = map.0.transform_point3(*vertex);
        }
        self
    }

    /// Bounding box; `None` if nothing is left.
    pub(super) fn bounding_box(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.vertices.first()?;
        Some(
            self.vertices
                .iter()
                .fold((first, first), |(min, max), vertex| (min.min(*vertex), max.max(*vertex))),
        )
    }

    /// Part in a box; `None` if that is nothing.
    pub(super) fn in_box(&self, min: DVec3, max: DVec3) -> Option<Polyhedron> {
        let (low, high) = self.bounding_box()?;
        if high.cmple(min + TINY).any() || low.cmpge(max - TINY).any() {
            return None;
        }
        let mut part = None;
        for axis in 0..3 {
            let unit = DVec3::AXES[axis];
            for (normal, limit, crosses) in [
                (-unit, -min[axis], low[axis] < min[axis] - ON_PLANE),
                (unit, max[axis], high[axis] > max[axis] + ON_PLANE),
            ] {
                if crosses {
                    part = Some(part.as_ref().unwrap_or(self).below(normal, limit));
                }
            }
        }
        let part = part.unwrap_or_else(|| self.clone());
        (!part.vertices.is_empty()).then_some(part)
    }

    /// Part whose points are inside of a box after an affine map.
    pub(super) fn in_mapped_box(self, map: &AffineMap, size: DVec3) -> Polyhedron {
        let rows = map.to_rows();
        (0..3).fold(self, |part, axis| {
            let [x, y, z, start] = rows[axis];
            let normal = DVec3::new(x, y, z);
            part.below(-normal, start).below(normal, size[axis] - start)
        })
    }

    /// Part on the side of a plane where points times the normal are at most `limit`.
    fn below(&self, normal: DVec3, limit: f64) -> Polyhedron {
        // Invariant: vertices that differ from the plane by rounding errors only are on it. If some
        // vertices of a face in the plane were cut off and others not, in turn, the rest of the
        // face and the cut would overlap, and the volume would be too large.
        let over = |vertex: DVec3| {
            let over = normal.dot(vertex) - limit;
            if over.abs() < ON_PLANE { 0.0 } else { over }
        };
        let mut part = Polyhedron::default();
        // Vertices of the cut, with their directions.
        let mut cap: SmallVec<[(f64, DVec3); 16]> = SmallVec::new();
        let mut start = 0;
        for end in self.ends.iter().map(|end| usize::from(*end)) {
            let face = &self.vertices[start..end];
            start = end;
            let mut last = face[face.len() - 1];
            let mut last_over = over(last);
            for vertex in face {
                let over = over(*vertex);
                if (over > 0.0) != (last_over > 0.0) {
                    let cut = last + (*vertex - last) * (last_over / (last_over - over));
                    part.vertices.push(cut);
                    cap.push((0.0, cut));
                }
                if over <= 0.0 {
                    part.vertices.push(*vertex);
                }
                (last, last_over) = (*vertex, over);
            }
            part.close_face();
        }
        // The vertices of the cut, which is convex, are in order of their direction from its
        // middle.
        let middle = cap.iter().map(|(_, point)| point).sum::<DVec3>() / cap.len().max(1) as f64;
        let (along, across) = normal.normalize_or_zero().any_orthonormal_pair();
        for (turned, point) in &mut cap {
            let by = *point - middle;
            *turned = turn(along.dot(by), across.dot(by));
        }
        cap.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        part.vertices.extend(cap.iter().map(|(_, point)| *point));
        part.close_face();
        part
    }

    /// Ends a face at the last vertex; omits it if it has no area.
    fn close_face(&mut self) {
        let start = self.ends.last().map_or(0, |end| usize::from(*end));
        if self.vertices.len() - start < 3 {
            self.vertices.truncate(start);
        } else {
            self.ends.push(self.vertices.len() as u16);
        }
    }

    /// Volume.
    pub(super) fn volume(&self) -> f64 {
        // Tetrahedra from a point inside to all triangles, which need no orientation.
        let middle = self.vertices.iter().sum::<DVec3>() / self.vertices.len().max(1) as f64;
        let (mut sum, mut start) = (0.0, 0);
        for end in self.ends.iter().map(|end| usize::from(*end)) {
            let face = &self.vertices[start..end];
            let first = face[0] - middle;
            for pair in face[1..].windows(2) {
                sum += first.dot((pair[0] - middle).cross(pair[1] - middle)).abs();
            }
            start = end;
        }
        sum / 6.0
    }
}

/// Number from 0 to 4 that grows with the angle of a vector.
fn turn(x: f64, y: f64) -> f64 {
    let length = x.abs() + y.abs();
    if length == 0.0 {
        return 0.0;
    }
    let (x, y) = (x / length, y / length);
    match (x >= 0.0, y >= 0.0) {
        (true, true) => y,
        (false, true) => 1.0 - x,
        (false, false) => 2.0 - y,
        (true, false) => 3.0 + x,
    }
}
