//! Coverage of cells by a closed surface: exact, from its faces clipped to the cells.
//!
//! Let `c` be the mean winding number in a cell, `a` the area of the faces in it seen along an axis, counted
//! by the change of winding number behind them and in areas of a cell's wall, and `b` the same with each bit
//! of area weighted by the share of the cell behind it. Then `c - b` is the mean winding number on the wall
//! where the cell begins, and
//!
//! ```text
//! (c - b) + a  =  c' - b'
//! ```
//!
//! holds for the next cell along the axis, since that one begins where this one ends: what font rasterizers
//! do with the areas under outlines, in space and from any neighbour. Cells without faces have the winding
//! number of their centre, so that cells next to them are known, then cells next to those.

use super::bits::Bits;
use super::grid::Triangle;
use super::inside::FULL;
use crate::{Progress, Result};

/// Sums over the faces in a cell.
#[derive(Clone, Copy, Default)]
struct Faces {
    cell: u32,
    /// Whether a face cuts the cell, and not only lies in its wall.
    is_cut: bool,
    /// The area seen along each axis: `a` above.
    area: [f64; 3],
    /// The volume behind it along each axis: `b` above.
    behind: [f64; 3],
    /// The mean winding number, once it is known: `c` above.
    winding: Option<f64>,
}

/// The faces of a block of cells, `2^height` along each axis.
pub(super) struct Coverage {
    height: u8,
    /// One more than the index of a cell in `faces`, by cell; 0 where a cell has no face.
    numbers: Vec<u32>,
    faces: Vec<Faces>,
}

/// Bodies overlap or gape in a cell if its mean winding number is beyond 0 or 1 by this much.
const TOLERANCE: f64 = 1e-3;

impl Coverage {
    /// Clips triangles to the cells of a block that begins at the grid point `min`.
    pub(super) fn new(
        triangles: &[Triangle],
        min: [i32; 3],
        cell: i32,
        height: u8,
        progress: &dyn Progress,
    ) -> Result<Coverage> {
        let mut coverage = Coverage { height, numbers: vec![0; 1 << (3 * height)], faces: Vec::new() };
        let scale = 1.0 / f64::from(cell);
        for triangle in triangles {
            progress.check()?;
            let corner = |corner: [i32; 3]| -> Point {
                std::array::from_fn(|axis| (corner[axis] as i64 - min[axis] as i64) as f64 * scale)
            };
            coverage.clip(ClippedPolygon::triangle(triangle.corners.map(corner)), 3, [0; 3], true);
        }
        Ok(coverage)
    }

    /// Cuts a polygon into what lies in each of the cells, one of the first `axes` axes after the other.
    fn clip(&mut self, polygon: ClippedPolygon, axes: usize, cell: [usize; 3], is_cut: bool) {
        let Some(axis) = axes.checked_sub(1) else { return self.add(&polygon, cell, is_cut) };
        let side = 1usize << self.height;
        let (low, high) = polygon.range(axis);
        let at = |index: usize| {
            let mut cell = cell;
            cell[axis] = index;
            cell
        };
        if high < 0.0 || low >= side as f64 {
            return;
        }
        let first = low.max(0.0) as usize;
        if low == high && low == low.trunc() {
            // In the wall at which a cell begins.
            return self.clip(polygon, axis, at(first), false);
        }
        let end = (high.ceil() as usize).min(side);
        let mut rest = if low < 0.0 { polygon.split(axis, 0.0).1 } else { polygon };
        for index in first..end {
            let wall = (index + 1) as f64;
            if high <= wall {
                return self.clip(rest, axis, at(index), is_cut);
            }
            let (below, above) = rest.split(axis, wall);
            self.clip(below, axis, at(index), is_cut);
            rest = above;
        }
    }

    /// Adds what lies in one cell.
    fn add(&mut self, polygon: &ClippedPolygon, cell: [usize; 3], is_cut: bool) {
        let points = polygon.points();
        let Some((first, others)) = points.split_first().filter(|(_, others)| others.len() > 1) else {
            return;
        };
        let index = (cell[2] << self.height | cell[1]) << self.height | cell[0];
        let number = &mut self.numbers[index];
        if *number == 0 {
            self.faces.push(Faces { cell: index as u32, ..Faces::default() });
            *number = self.faces.len() as u32;
        }
        let faces = &mut self.faces[*number as usize - 1];
        faces.is_cut |= is_cut;
        for pair in others.windows(2) {
            let (u, v): (Point, Point) = (minus(pair[0], *first), minus(pair[1], *first));
            for axis in 0..3 {
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                // Behind a face that is seen from the front the winding number is one less.
                let area = (u[last] * v[next] - u[next] * v[last]) / 2.0;
                // Depth is linear over a triangle: its mean is that of the corners.
                let mean = (first[axis] + pair[0][axis] + pair[1][axis]) / 3.0;
                faces.area[axis] += area;
                faces.behind[axis] += area * ((cell[axis] + 1) as f64 - mean);
            }
        }
    }

    /// Coverage of all cells, 0 to 255, x fastest, then y, then z; `inside` tells at which centres the
    /// winding number is `sign`, not 0.
    ///
    /// `None` if it does not follow from these: where bodies overlap, or no cell is without faces.
    pub(super) fn solve(
        mut self,
        inside: &Bits,
        sign: f64,
        progress: &dyn Progress,
    ) -> Result<Option<Vec<u32>>> {
        let mut open: Vec<u32> =
            (0..self.faces.len() as u32).filter(|number| self.faces[*number as usize].is_cut).collect();
        while !open.is_empty() {
            progress.check()?;
            // A wave is worked out as a whole before any of it is kept: the order of the faces has no
            // influence.
            let known: Vec<Option<f64>> =
                open.iter().map(|number| self.next(*number, inside, sign)).collect();
            let before = open.len();
            let mut known = known.into_iter();
            let faces = &mut self.faces;
            open.retain(|number| {
                let winding = known.next().flatten();
                faces[*number as usize].winding = winding;
                winding.is_none()
            });
            if open.len() == before {
                return Ok(None);
            }
        }
        let side = 1usize << self.height;
        let mut values = vec![0; side * side * side];
        for (row, bits) in inside.rows.iter().enumerate().filter(|(_, bits)| **bits != 0) {
            let cells = &mut values[row << self.height..][..side];
            cells.iter_mut().enumerate().for_each(|(x, value)| *value = (*bits >> x & 1) as u32 * FULL);
        }
        for faces in self.faces.iter().filter(|faces| faces.is_cut) {
            let share = faces.winding.unwrap_or(f64::NAN) * sign;
            if !(-TOLERANCE..=1.0 + TOLERANCE).contains(&share) {
                return Ok(None);
            }
            values[faces.cell as usize] = (share.clamp(0.0, 1.0) * f64::from(FULL)).round() as u32;
        }
        Ok(Some(values))
    }

    /// The mean winding number of a cell with faces, from a neighbour whose own is known.
    fn next(&self, number: u32, inside: &Bits, sign: f64) -> Option<f64> {
        let faces = &self.faces[number as usize];
        let mask = (1usize << self.height) - 1;
        let cell = faces.cell as usize;
        let at = [cell & mask, cell >> self.height & mask, cell >> (2 * self.height)];
        (0..3).find_map(|axis| {
            let step = 1usize << (axis as u8 * self.height);
            let before = (at[axis] > 0).then(|| self.known(cell - step, inside, sign)).flatten();
            let begins = before.map(|(winding, other)| winding - other.behind[axis] + other.area[axis]);
            let begins = begins.or_else(|| {
                let after = (at[axis] < mask).then(|| self.known(cell + step, inside, sign)).flatten();
                after.map(|(winding, other)| winding - other.behind[axis] - faces.area[axis])
            });
            begins.map(|begins| begins + faces.behind[axis])
        })
    }

    /// The mean winding number of a cell, if it is known, and its faces.
    fn known(&self, cell: usize, inside: &Bits, sign: f64) -> Option<(f64, Faces)> {
        let faces = match self.numbers[cell] {
            0 => Faces::default(),
            number => self.faces[number as usize - 1],
        };
        if faces.is_cut {
            return faces.winding.map(|winding| (winding, faces));
        }
        let row = cell >> self.height;
        let is_inside = inside.rows[row] >> (cell - (row << self.height)) & 1 != 0;
        Some((if is_inside { sign } else { 0.0 }, faces))
    }
}

/// A point, in cells of the block.
type Point = [f64; 3];

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

/// A convex polygon: a triangle cut by up to six planes has up to 9 corners. (There is room for a few more,
/// since rounding may make a polygon that is parallel to a plane cross it more than twice; what does not fit
/// then has no area to speak of.)
#[derive(Clone, Copy)]
struct ClippedPolygon {
    points: [Point; 12],
    len: usize,
}

impl ClippedPolygon {
    const NONE: ClippedPolygon = ClippedPolygon { points: [[0.0; 3]; 12], len: 0 };

    fn triangle(corners: [Point; 3]) -> ClippedPolygon {
        let mut polygon = ClippedPolygon::NONE;
        corners.into_iter().for_each(|corner| polygon.push(corner));
        polygon
    }

    fn points(&self) -> &[Point] {
        &self.points[..self.len]
    }

    fn push(&mut self, point: Point) {
        if let Some(free) = self.points.get_mut(self.len) {
            *free = point;
            self.len += 1;
        }
    }

    fn range(&self, axis: usize) -> (f64, f64) {
        let along = self.points().iter().map(|point| point[axis]);
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
    }

    /// Clips the polygon at a plane across an axis: the parts below and above it (Sutherland and Hodgman,
    /// 1974).
    fn split(&self, axis: usize, plane: f64) -> (ClippedPolygon, ClippedPolygon) {
        let (mut below, mut above) = (ClippedPolygon::NONE, ClippedPolygon::NONE);
        let Some(mut from) = self.points().last().copied() else { return (below, above) };
        for to in self.points() {
            let (a, b) = (from[axis] - plane, to[axis] - plane);
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                let share = a / (a - b);
                let mut cut: Point = std::array::from_fn(|i| from[i] + (to[i] - from[i]) * share);
                cut[axis] = plane;
                below.push(cut);
                above.push(cut);
            }
            if b <= 0.0 {
                below.push(*to);
            }
            if b >= 0.0 {
                above.push(*to);
            }
            from = *to;
        }
        (below, above)
    }
}
