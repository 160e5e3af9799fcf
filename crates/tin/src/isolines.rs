//! Isolines of surfaces, exact on their triangles.

use crate::mesh::NONE;
use crate::tin::Tin;
use spinney_base::{Error, Result};

/// A line of equal height. Higher terrain is to its right.
#[derive(Clone, Debug, PartialEq)]
pub struct Isoline {
    /// Height of the line.
    pub level: f64,
    /// Two or more points on edges of triangles. A closed line repeats its first point at the end.
    pub points: Vec<[f64; 2]>,
}

impl Isoline {
    /// Whether the line is closed.
    pub fn is_closed(&self) -> bool {
        self.points.len() > 2 && self.points.first() == self.points.last()
    }
}

impl Tin {
    /// Yields the isolines of ascending levels, level by level. A height equal to a level counts as
    /// above it, so lines of a level never cross and meet only in vertices.
    ///
    /// # Errors
    /// If levels are not finite or do not ascend; errors of `each`.
    pub fn isolines(&self, levels: &[f64], each: &mut dyn FnMut(Isoline) -> Result<()>) -> Result<()> {
        if levels.iter().any(|level| !level.is_finite()) || levels.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(Error::invalid("levels", format!("{levels:?}"), "ascending finite numbers"));
        }
        let mut crossed = vec![Vec::new(); levels.len()];
        for (number, corners) in (0u32..).zip(&self.mesh.triangles) {
            let ranks =
                corners.map(|corner| levels.partition_point(|level| *level <= self.heights[corner as usize]));
            let [a, b, c] = ranks;
            for of_level in &mut crossed[a.min(b).min(c)..a.max(b).max(c)] {
                of_level.push(number);
            }
        }
        let mut is_done = vec![false; self.mesh.triangles.len()];
        for (level, triangles) in levels.iter().zip(&crossed) {
            triangles.iter().for_each(|triangle| is_done[*triangle as usize] = false);
            // Lines that begin at the surface's boundary first. All remaining lines are closed.
            for at_border in [true, false] {
                for triangle in triangles.iter().map(|triangle| *triangle as usize) {
                    if is_done[triangle] {
                        continue;
                    }
                    let (entry, _) = self.ways(triangle, *level);
                    if at_border && !self.is_at_boundary(triangle, entry) {
                        continue;
                    }
                    if let Some(line) = self.follow(triangle, *level, &mut is_done) {
                        each(line)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Returns the edges by which the isoline of a level, with higher terrain to its right, enters
    /// and leaves a triangle.
    fn ways(&self, triangle: usize, level: f64) -> (usize, usize) {
        let is_above = self.mesh.triangles[triangle].map(|corner| self.heights[corner as usize] >= level);
        // (Vertices are counterclockwise.)
        let rising = (0..3).find(|at| !is_above[*at] && is_above[(at + 1) % 3]).unwrap_or(0);
        let falling = (0..3).find(|at| is_above[*at] && !is_above[(at + 1) % 3]).unwrap_or(0);
        (rising, falling)
    }

    /// Traces a line from a triangle on.
    fn follow(&self, first: usize, level: f64, is_done: &mut [bool]) -> Option<Isoline> {
        let mut points: Vec<[f64; 2]> = Vec::new();
        let mut push = |point: [f64; 2]| {
            if points.last() != Some(&point) {
                points.push(point);
            }
        };
        let mut triangle = first;
        push(self.crossing(first, self.ways(first, level).0, level));
        loop {
            is_done[triangle] = true;
            let (_, exit) = self.ways(triangle, level);
            push(self.crossing(triangle, exit, level));
            let next = self.mesh.neighbours[triangle][exit];
            if next == NONE || is_done[next as usize] {
                break;
            }
            triangle = next as usize;
        }
        // (Around a vertex at the level, the line degenerates to a point.)
        (points.len() > 1).then_some(Isoline { level, points })
    }

    /// Returns the point where an edge has a height. The result is the same from both sides of the
    /// edge.
    fn crossing(&self, triangle: usize, edge: usize, level: f64) -> [f64; 2] {
        let corners = self.mesh.triangles[triangle];
        let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
        let [a, b] = [a.min(b), a.max(b)].map(|end| end as usize);
        let (low, high) = (self.heights[a], self.heights[b]);
        let (from, to) = (self.mesh.points[a], self.mesh.points[b]);
        if low == level {
            return from;
        }
        if high == level {
            return to;
        }
        let share = (level - low) / (high - low);
        [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]))
    }
}
