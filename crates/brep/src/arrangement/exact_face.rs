//! Faces whose vertices are intersection points of planes, and so exact.

use std::collections::HashMap;

use super::overlay::{Corner, PlaneRegion};
use super::point::{ExactPlane, ExactPoint, turn};
use crate::boxes::{Bounds, bounds_of};
use crate::exact::bounds::MARGIN;
use crate::exact::vector::{cross, dot, others};
use crate::{Face, FaceList, Faces};
use spinney_base::{Progress, Result};

/// A face with vertices that may be off the grid; rings as in [`Face`].
#[derive(Clone, Debug)]
pub(crate) struct ExactFace {
    /// The normal points out of the body.
    pub(crate) plane: ExactPlane,
    pub(crate) corners: Vec<Corner>,
    pub(crate) ring_ends: Vec<usize>,
    pub(crate) colours: Vec<[u8; 3]>,
    pub(crate) part: u32,
    pub(crate) source: u64,
}

impl ExactFace {
    /// Converts a face with vertices on the grid, which lies in `plane`.
    pub(super) fn of_grid(face: &Face<'_>, plane: &ExactPlane) -> ExactFace {
        let axis = plane.main_axis();
        let corner = |[from, to]: [[i32; 3]; 2]| Corner {
            point: ExactPoint::of_grid(from),
            line: ExactPlane::along(axis, from, to),
        };
        let ring = |ring: &[[i32; 3]]| -> Vec<Corner> {
            (0..ring.len()).map(|i| corner([ring[i], ring[(i + 1) % ring.len()]])).collect()
        };
        ExactFace {
            plane: *plane,
            corners: face.rings().flat_map(ring).collect(),
            ring_ends: face.ring_ends.to_vec(),
            colours: face.colours.to_vec(),
            part: face.part,
            source: face.source,
        }
    }

    /// Creates a face from a region of another face, or of its reverse.
    pub(super) fn of_region(
        face: &Face<'_>,
        plane: &ExactPlane,
        region: &PlaneRegion,
        is_turned: bool,
    ) -> ExactFace {
        let plane = if is_turned { plane.turned() } else { *plane };
        let mut found = ExactFace {
            plane,
            corners: Vec::new(),
            ring_ends: Vec::new(),
            colours: Vec::new(),
            part: face.part,
            source: face.source,
        };
        // The rings of a region are oriented as seen from the axis's positive end.
        let is_up = plane.normal[plane.main_axis()] > 0;
        for ring in &region.rings {
            if is_up {
                found.corners.extend(ring)
            } else {
                found.corners.extend(reversed(ring))
            }
            found.ring_ends.push(found.corners.len());
        }
        found
    }

    /// Returns the face as a region of its plane.
    pub(crate) fn region(&self) -> PlaneRegion {
        let is_up = self.plane.normal[self.plane.main_axis()] > 0;
        let ring = |ring: &[Corner]| if is_up { ring.to_vec() } else { reversed(ring).collect() };
        PlaneRegion { rings: self.rings().map(ring).collect() }
    }

    /// Returns the reversed face.
    pub(crate) fn turned(&self) -> ExactFace {
        let mut colours = Vec::with_capacity(self.colours.len());
        let mut start = 0;
        for &end in &self.ring_ends {
            colours.extend(self.colours.get(start..end).into_iter().flatten().rev());
            start = end;
        }
        ExactFace {
            plane: self.plane.turned(),
            corners: self.rings().flat_map(reversed).collect(),
            ring_ends: self.ring_ends.clone(),
            colours,
            ..*self
        }
    }

    /// Yields the rings, the outer one first.
    pub(crate) fn rings(&self) -> impl Iterator<Item = &[Corner]> {
        let starts = std::iter::once(0).chain(self.ring_ends.iter().copied());
        starts.zip(&self.ring_ends).map(|(start, end)| &self.corners[start..*end])
    }

    /// Yields the edges: each vertex with the next one.
    pub(crate) fn edges(&self) -> impl Iterator<Item = (&Corner, &ExactPoint)> {
        self.rings().flat_map(|ring| (0..ring.len()).map(|i| (&ring[i], &ring[(i + 1) % ring.len()].point)))
    }

    /// Returns a description of the first flaw: rings that cross, or have the wrong orientation.
    /// The vertices must lie in the plane.
    ///
    /// # Errors
    /// On cancellation: the work may be quadratic in the number of vertices.
    pub(crate) fn flaw(&self, progress: &dyn Progress) -> Result<Option<&'static str>> {
        let axis = self.plane.main_axis();
        let is_up = self.plane.normal[axis] > 0;
        let [u, v] = others(axis);
        for (number, ring) in self.rings().enumerate() {
            // The minimum vertex of a ring that does not cross itself is convex.
            let order = |a: &&ExactPoint, b: &&ExactPoint| a.compare(b, u).then_with(|| a.compare(b, v));
            let points: Vec<&ExactPoint> = ring.iter().map(|corner| &corner.point).collect();
            let count = points.len();
            let Some(least) = (0..count).min_by(|a, b| order(&points[*a], &points[*b])) else { continue };
            let corners = [points[(least + count - 1) % count], points[least], points[(least + 1) % count]];
            let is_left = turn(axis, corners) > 0;
            if is_left == (is_up == (number > 0)) {
                return Ok(Some(
                    "a ring with the wrong orientation, expected a counterclockwise outer ring and clockwise holes",
                ));
            }
        }
        let edges: Vec<[&ExactPoint; 2]> = self.edges().map(|(from, to)| [&from.point, to]).collect();
        let bounds = |[from, to]: &[&ExactPoint; 2]| {
            [u, v].map(|axis| {
                let (a, b) = (from.near[axis], to.near[axis]);
                [a.min(b) - MARGIN, a.max(b) + MARGIN]
            })
        };
        let boxes: Vec<[[f64; 2]; 2]> = edges.iter().map(bounds).collect();
        for (number, &[a, b]) in edges.iter().enumerate() {
            if number.is_multiple_of(1 << 8) {
                progress.check()?;
            }
            let own = &boxes[number];
            for (other, &[c, d]) in edges.iter().enumerate().skip(number + 1) {
                let is_apart = |k: usize| boxes[other][k][0] > own[k][1] || own[k][0] > boxes[other][k][1];
                if is_apart(0) || is_apart(1) {
                    continue;
                }
                let sides = |from, to, points: [&ExactPoint; 2]| {
                    let [one, two] = points.map(|point| turn(axis, [from, to, point]));
                    one * two
                };
                if sides(a, b, [c, d]) < 0 && sides(c, d, [a, b]) < 0 {
                    return Ok(Some("rings that cross, expected an outer ring, and holes inside it"));
                }
            }
        }
        Ok(None)
    }

    /// Returns the vertices if all of them are on the grid.
    pub(super) fn on_grid(&self) -> Option<Vec<[i32; 3]>> {
        self.corners.iter().map(|corner| corner.point.on_grid()).collect()
    }

    /// Returns the grid points nearest to the vertices.
    pub(crate) fn rounded(&self) -> Vec<[i32; 3]> {
        self.corners.iter().map(|corner| corner.point.rounded()).collect()
    }

    /// Returns six times the volume between the face and the grid's origin, approximately, in cubic
    /// grid units.
    pub(crate) fn six_volumes(&self) -> f64 {
        let of_ring = |ring: &[Corner]| -> f64 {
            let Some((first, rest)) = ring.split_first() else { return 0.0 };
            let pairs = rest.windows(2).map(|pair| cross(pair[0].point.near, pair[1].point.near));
            pairs.map(|normal| dot(first.point.near, normal)).sum()
        };
        self.rings().map(of_ring).sum()
    }

    /// Returns the memory use in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of::<ExactFace>()
            + size_of_val(&self.corners[..])
            + size_of_val(&self.ring_ends[..])
            + size_of_val(&self.colours[..])) as u64
    }
}

/// Faces, some of which have vertices off the grid. The list has the rounded vertices of those.
#[derive(Clone, Debug)]
pub(crate) struct ExactFaces {
    /// The faces, with vertices on the grid.
    pub(crate) list: FaceList,
    pub(crate) exact: HashMap<u32, ExactFace>,
}

impl ExactFaces {
    /// Wraps faces with vertices on the grid.
    pub(crate) fn of_grid(list: FaceList) -> ExactFaces {
        ExactFaces { list, exact: HashMap::new() }
    }

    /// Appends a face with any vertices.
    pub(crate) fn push(&mut self, face: ExactFace) {
        let on_grid = face.on_grid();
        let points = on_grid.clone().unwrap_or_else(|| face.rounded());
        let number = self.list.len();
        self.list.push(&Face {
            number,
            points: &points,
            ring_ends: &face.ring_ends,
            colours: &face.colours,
            part: face.part,
            source: face.source,
        });
        if on_grid.is_none() {
            self.exact.insert(number as u32, face);
        }
    }

    /// Returns the box around a face.
    pub(crate) fn bounds(&self, face: u32) -> Bounds {
        // Invariant: the box contains the face. Off-grid vertices are at most half a grid unit per
        // axis from the rounded ones in the list. Pairs with disjoint boxes are not tested, so an
        // intersection outside of the box would be missed.
        let more = i32::from(self.exact.contains_key(&face));
        bounds_of(self.list.get(face as usize).points, more)
    }

    /// Returns the memory use in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.list.bytes() + self.exact.values().map(ExactFace::bytes).sum::<u64>()
    }
}

/// Yields a ring in reverse order. Edges keep their planes.
fn reversed(ring: &[Corner]) -> impl Iterator<Item = Corner> {
    let count = ring.len();
    (0..count).map(move |i| Corner {
        point: ring[count - 1 - i].point,
        line: ring[(2 * count - 2 - i) % count].line,
    })
}
