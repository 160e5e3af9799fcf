//! Faces moved to the grid.

use std::path::Path;

use crate::brep::{Face, Grid};
use crate::geometry::crossing::ring_normal;
use crate::geometry::{Triangulator, split_bridges};
use crate::space::Up;
use crate::{Error, Result};

/// Counts of what was done to the faces so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Snapped {
    pub(super) read: u64,
    pub(super) faces: u64,
    pub(super) collapsed: u64,
    pub(super) slivers: u64,
    pub(super) cut: u64,
    pub(super) fanned: u64,
    /// The square of the furthest that a corner was moved.
    pub(super) squared_displacement: f64,
}

/// Moves faces to the grid; keeps its buffers from face to face.
pub(super) struct Snapper {
    grid: Grid,
    up: Up,
    pub(super) is_coloured: bool,
    pub(super) counts: Snapped,
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
    ring_ends: Vec<usize>,
    wide: Vec<[i64; 3]>,
    triangulator: Triangulator,
}

impl Snapper {
    pub(super) fn new(grid: Grid, up: Up) -> Snapper {
        Snapper {
            grid,
            up,
            is_coloured: false,
            counts: Snapped::default(),
            points: Vec::new(),
            colours: Vec::new(),
            ring_ends: Vec::new(),
            wide: Vec::new(),
            triangulator: Triangulator::new(),
        }
    }

    /// Hands out what becomes of a face: itself, some triangles, or nothing.
    pub(super) fn face(
        &mut self,
        path: &Path,
        face: &super::super::Face<'_>,
        first_part: u32,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let source = self.counts.read;
        self.counts.read += 1;
        self.move_corners(path, face)?;
        self.settle(first_part + face.part, source, each)
    }

    /// Hands out what becomes of a face whose corners are on the grid, but may not lie in one plane, or fall together.
    pub(super) fn face_on_grid(
        &mut self,
        face: &Face<'_>,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        self.points.clear();
        self.colours.clear();
        self.ring_ends.clear();
        let mut start = 0;
        for &end in face.ring_ends {
            let ring_start = self.points.len();
            for corner in start..end {
                self.add_corner(ring_start, face.points[corner], face.colours.get(corner));
            }
            start = end;
            if !self.end_ring(ring_start) {
                break;
            }
        }
        self.settle(face.part, face.source, each)
    }

    /// Hands out what becomes of the face whose corners were moved.
    fn settle(
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
            self.counts.slivers += 1;
            return self.hand_out(part, source, each);
        }
        if self.points.len() == 3 {
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
            let along = |axis: usize| i128::from(normal[axis]) * i128::from(point[axis] - first[axis]);
            along(0) + along(1) + along(2) == 0
        });
        let mut triangles = Vec::new();
        if self.triangulator.triangulate(&self.wide, &self.ring_ends, &mut triangles) {
            if is_planar {
                return self.hand_out(part, source, each);
            }
            self.counts.cut += 1;
        } else {
            // Fans have the face's boundary, so that what is closed stays so.
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
        let Snapper { points, ring_ends, colours, .. } = self;
        each(&Face { number, points, ring_ends, colours, part, source })
    }

    /// Moves the corners, and leaves out those that have come to lie on the one before, and rings that have fewer than
    /// three then.
    fn move_corners(&mut self, path: &Path, face: &super::super::Face<'_>) -> Result<()> {
        self.points.clear();
        self.colours.clear();
        self.ring_ends.clear();
        let mut start = 0;
        for &end in face.ring_ends {
            let ring_start = self.points.len();
            for corner in start..end {
                let point = self.up.to_z_up(face.points[corner]);
                let snapped = self.grid.snap(point).ok_or_else(|| {
                    let [x, y, z] = point;
                    let expected = "vertices where they were when the file was read first";
                    Error::corrupt(path, "vertices", format!("a vertex at {x}, {y}, {z}"), expected)
                })?;
                let there = self.grid.to_world(snapped);
                let moved = (0..3).map(|axis| (there[axis] - point[axis]).powi(2)).sum::<f64>();
                self.counts.squared_displacement = self.counts.squared_displacement.max(moved);
                self.add_corner(ring_start, snapped, face.colours.get(corner));
            }
            start = end;
            if !self.end_ring(ring_start) {
                break;
            }
        }
        Ok(())
    }

    /// Adds a corner to the ring that began at a place, unless it is where the one before is.
    fn add_corner(&mut self, ring_start: usize, point: [i32; 3], colour: Option<&[u8; 3]>) {
        if self.points.len() > ring_start && self.points.last() == Some(&point) {
            return;
        }
        self.points.push(point);
        if self.is_coloured {
            self.colours.push(colour.copied().unwrap_or([255; 3]));
        }
    }

    /// Ends the ring that began at a place, and leaves it out if it has fewer than three corners; says whether there is an
    /// outer ring now.
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

    /// Whether every edge is there in both directions: the face is a line, and nothing is lost without it.
    fn edges_cancel(&self) -> bool {
        let mut edges = Vec::with_capacity(self.points.len());
        let mut start = 0;
        for &end in &self.ring_ends {
            let ring = &self.points[start..end];
            edges.extend((0..ring.len()).map(|i| (ring[i], ring[(i + 1) % ring.len()])));
            start = end;
        }
        let mut turned: Vec<_> = edges.iter().map(|&(from, to)| (to, from)).collect();
        edges.sort_unstable();
        turned.sort_unstable();
        edges == turned
    }

    /// Takes bridges out of a ring, with which formats that know no holes join them to it.
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

    /// Makes holes turn the other way than the outer ring.
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
