//! Conversion of faces with vertices on the grid, but not in one plane or partly coincident, to
//! planar faces.

use super::Face;
use crate::exact::normal::ring_normal;
use crate::exact::vector::{dot, subtract};
use crate::geometry::{Triangulator, split_bridges};
use spinney_base::{Result, sort};

/// Statistics of the conversion.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlanarCounts {
    /// Faces of the output.
    pub faces: u64,
    /// Faces that were dropped: points, or lines whose edges cancel.
    pub collapsed: u64,
    /// Faces without an area that were kept, since they connect their neighbours.
    pub slivers: u64,
    /// Faces that were triangulated, since their vertices are not in one plane.
    pub cut: u64,
    /// Faces that were split into triangle fans, since their rings cross.
    pub fanned: u64,
}

/// Makes faces planar, and keeps its buffers between faces.
#[derive(Default)]
pub struct PlanarFaces {
    /// Whether vertices have colours.
    pub is_coloured: bool,
    /// Statistics of the faces so far.
    pub counts: PlanarCounts,
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
    ring_ends: Vec<usize>,
    wide: Vec<[i64; 3]>,
    triangulator: Triangulator,
}

impl PlanarFaces {
    /// Visits the planar faces that replace a face: itself, some triangles, or none.
    pub fn face(&mut self, face: &Face<'_>, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.begin(face.ring_ends, face.colours, &mut |corner| Ok(face.points[corner]))?;
        self.finish(face.part, face.source, each)
    }

    /// Begins a face of rings with these ends. `place` returns each vertex's grid point by its
    /// index.
    ///
    /// # Errors
    /// Those of `place`.
    pub fn begin(
        &mut self,
        ring_ends: &[usize],
        colours: &[[u8; 3]],
        place: &mut dyn FnMut(usize) -> Result<[i32; 3]>,
    ) -> Result<()> {
        self.points.clear();
        self.colours.clear();
        self.ring_ends.clear();
        let mut start = 0;
        for &end in ring_ends {
            let ring_start = self.points.len();
            for corner in start..end {
                self.add_corner(ring_start, place(corner)?, colours.get(corner));
            }
            start = end;
            if !self.end_ring(ring_start) {
                break;
            }
        }
        Ok(())
    }

    /// Visits the planar faces that replace the face that was begun.
    pub fn finish(
        &mut self,
        part: u32,
        source: u64,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        if self.ring_ends.is_empty() {
            self.counts.collapsed += 1;
            return Ok(());
        }
        let normal = ring_normal(&self.points[..self.ring_ends[0]]);
        if normal == [0; 3] {
            if self.edges_cancel() {
                self.counts.collapsed += 1;
                return Ok(());
            }
            if self.is_on_a_line() {
                self.counts.slivers += 1;
                return self.hand_out(part, source, each);
            }
        } else if self.points.len() == 3 {
            return self.hand_out(part, source, each);
        }
        self.wide.clear();
        self.wide.extend(self.points.iter().map(|point| point.map(i64::from)));
        if self.ring_ends.len() == 1 {
            self.split_bridges();
        }
        self.turn_holes(normal);
        self.wide.clear();
        self.wide.extend(self.points.iter().map(|point| point.map(i64::from)));
        let first = self.points[0];
        let is_planar = self.points.iter().all(|point| {
            let along = subtract(point.map(i128::from), first.map(i128::from));
            dot(normal.map(i128::from), along) == 0
        });
        let mut triangles = Vec::new();
        // (A self-crossing ring may have equal areas of both orientations.)
        let has_area = normal != [0; 3];
        if has_area && self.triangulator.triangulate(&self.wide, &self.ring_ends, &mut triangles) {
            if is_planar {
                return self.hand_out(part, source, each);
            }
            self.counts.cut += 1;
        } else {
            // Fans have the same boundary as the face, so a closed surface stays closed.
            self.counts.fanned += 1;
            let mut start = 0;
            for end in self.ring_ends.iter().map(|end| *end as u32) {
                triangles.extend((start + 2..end).map(|corner| [start, corner - 1, corner]));
                start = end;
            }
        }
        for triangle in triangles {
            let points = triangle.map(|corner| self.points[corner as usize]);
            let [a, b, c] = points;
            if a == b || b == c || c == a {
                continue;
            }
            self.counts.slivers += u64::from(ring_normal(&points) == [0; 3]);
            let colours = match self.colours.is_empty() {
                true => Vec::new(),
                false => triangle.map(|corner| self.colours[corner as usize]).to_vec(),
            };
            let number = self.counts.faces;
            self.counts.faces += 1;
            each(&Face { number, points: &points, ring_ends: &[3], colours: &colours, part, source })?;
        }
        Ok(())
    }

    fn hand_out(
        &mut self,
        part: u32,
        source: u64,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let number = self.counts.faces;
        self.counts.faces += 1;
        let PlanarFaces { points, ring_ends, colours, .. } = self;
        each(&Face { number, points, ring_ends, colours, part, source })
    }

    /// Adds a vertex to the ring that began at `ring_start`, unless it equals the last one.
    fn add_corner(&mut self, ring_start: usize, point: [i32; 3], colour: Option<&[u8; 3]>) {
        if self.points.len() > ring_start && self.points.last() == Some(&point) {
            return;
        }
        self.points.push(point);
        if self.is_coloured {
            self.colours.push(colour.copied().unwrap_or([255; 3]));
        }
    }

    /// Ends the ring that began at `start`, and drops it if it has fewer than three vertices.
    /// Returns whether there is an outer ring.
    fn end_ring(&mut self, start: usize) -> bool {
        while self.points.len() > start + 1 && self.points.last() == Some(&self.points[start]) {
            self.points.pop();
        }
        if self.points.len() < start + 3 {
            self.points.truncate(start);
        } else {
            self.ring_ends.push(self.points.len());
        }
        self.colours.truncate(self.points.len());
        !self.ring_ends.is_empty()
    }

    /// Returns whether all vertices are on one line.
    fn is_on_a_line(&self) -> bool {
        let first = self.points[0];
        let Some(other) = self.points.iter().find(|point| **point != first) else { return true };
        self.points.iter().all(|point| ring_normal(&[first, *other, *point]) == [0; 3])
    }

    /// Returns whether every edge occurs in both directions: the face is then a line, and can be
    /// dropped.
    fn edges_cancel(&self) -> bool {
        let mut edges = Vec::with_capacity(self.points.len());
        let mut start = 0;
        for &end in &self.ring_ends {
            let ring = &self.points[start..end];
            edges.extend((0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]));
            start = end;
        }
        let mut turned: Vec<_> = edges.iter().map(|&[from, to]| [to, from]).collect();
        sort::point_pairs(&mut edges);
        sort::point_pairs(&mut turned);
        edges == turned
    }

    /// Removes the bridges by which formats without holes join them to the outer ring.
    fn split_bridges(&mut self) {
        let rings = split_bridges(&self.wide);
        if rings.len() < 2 {
            return;
        }
        let order = rings.concat();
        self.points = order.iter().map(|corner| self.points[*corner as usize]).collect();
        if !self.colours.is_empty() {
            self.colours = order.iter().map(|corner| self.colours[*corner as usize]).collect();
        }
        self.ring_ends.clear();
        let mut end = 0;
        for ring in &rings {
            end += ring.len();
            self.ring_ends.push(end);
        }
    }

    /// Orients holes opposite to the outer ring.
    fn turn_holes(&mut self, normal: [i64; 3]) {
        for ring in 1..self.ring_ends.len() {
            let (start, end) = (self.ring_ends[ring - 1], self.ring_ends[ring]);
            let hole = ring_normal(&self.points[start..end]);
            let along: i128 = (0..3).map(|axis| i128::from(normal[axis]) * i128::from(hole[axis])).sum();
            if along > 0 {
                self.points[start..end].reverse();
                if !self.colours.is_empty() {
                    self.colours[start..end].reverse();
                }
            }
        }
    }
}
