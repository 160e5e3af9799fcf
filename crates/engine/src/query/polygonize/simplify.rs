//! Simplifies arcs with the algorithm of Douglas and Peucker (1973), under the condition of
//! Saalfeld (1999) and de Berg, van Kreveld and Schirra (1998) that no border vertex is between the
//! original line and the simplified one.
//!
//! A span of an arc is replaced by a segment if all its points are within the tolerance of the
//! segment, and no other border vertex is between the two or on the segment. Otherwise the span is
//! split at its farthest point.
//!
//! Invariant: simplified segments only meet at their ends. If two segments crossed, the border span
//! that one of them replaces would cross the other an odd number of times, and so would have an end
//! on its wrong side. Two segments with the same ends would require an arc that lost all its inner
//! points, or a ring of two points. Neither exists: a short arc keeps at least one inner point, and
//! a ring three points. So each arc can be simplified on its own, given only the original vertices
//! of all borders.

use std::collections::HashMap;

use super::ClassGround;
use super::arcs::Arcs;
use super::points::Point;
use super::rows::Class;
use spinney_base::space::Bounds;
use spinney_base::{Result, sort};

/// Points of an arc per chunk. Longer arcs keep the points where two chunks meet.
const PART: usize = 1 << 12;

/// Columns and rows of vertices that are read together.
const TILE: u32 = 256;

/// Border vertices of a tile, one bit per cell corner.
type Corners = Box<[u64]>;

/// State of the simplification.
pub(super) struct Simplifier<'a> {
    ground: &'a ClassGround<'a>,
    tolerance: f64,
    tiles: HashMap<[u32; 2], Corners>,
    /// Maximum number of tiles in memory.
    most: usize,
}

impl<'a> Simplifier<'a> {
    pub(super) fn new(ground: &'a ClassGround<'a>, tolerance: f64, memory: u64) -> Simplifier<'a> {
        let bytes = u64::from(TILE * TILE / 8);
        let most = usize::try_from(memory / bytes).unwrap_or(usize::MAX).max(16);
        Simplifier { ground, tolerance, tiles: HashMap::new(), most }
    }

    /// Simplifies a finished arc.
    ///
    /// # Errors
    /// If the tree or a temporary file cannot be read.
    pub(super) fn simplify(&mut self, arcs: &mut Arcs, number: u32) -> Result<()> {
        let arc = arcs.arc(number);
        if arc.count < 3 {
            return Ok(());
        }
        let is_ring = arc.ends[0] == arc.ends[1];
        let is_short = arc.count <= PART as u64;
        let mut kept = vec![arc.ends[0]];
        let mut part: Vec<Point> = Vec::new();
        arcs.points.each(arc.chain, false, &mut |points| {
            for point in points {
                part.push(*point);
                if part.len() == PART && !is_short {
                    self.part(&part, &mut [], &mut kept)?;
                    part = vec![*point];
                }
            }
            Ok(())
        })?;
        let mut fixed = Vec::new();
        if is_short && is_ring {
            let far = farthest(&part, |at| self.distance(at, [part[0]; 2]));
            let ends = [part[0], part[far]];
            fixed = vec![far, farthest(&part, |at| self.line_distance(at, ends))];
        } else if is_short {
            let ends = [part[0], part[part.len() - 1]];
            fixed = vec![farthest(&part, |at| self.line_distance(at, ends))];
        }
        self.part(&part, &mut fixed, &mut kept)?;
        arcs.replace(number, &kept);
        Ok(())
    }

    /// Simplifies a span of points and appends the result to `kept`, without the first point.
    fn part(&mut self, points: &[Point], fixed: &mut [usize], kept: &mut Vec<Point>) -> Result<()> {
        let [width, height] = self.ground.size.map(|cells| cells as u32);
        let is_corner = |[x, y]: Point| (x == 0 || x == width) && (y == 0 || y == height);
        let mut fixed: Vec<usize> = fixed.to_vec();
        fixed.extend((0..points.len()).filter(|index| is_corner(points[*index])));
        fixed.push(points.len() - 1);
        sort::by(&mut fixed, &mut Ord::cmp);
        let mut start = 0;
        for end in fixed {
            // Stack of spans to process, the next one last.
            let mut spans = if end > start { vec![(start, end)] } else { Vec::new() };
            while let Some((first, last)) = spans.pop() {
                let span = &points[first..=last];
                let ends = [span[0], span[span.len() - 1]];
                let far = farthest(span, |at| self.distance(at, ends));
                if span.len() == 2
                    || (self.distance(span[far], ends) <= self.tolerance && self.is_free(span)?)
                {
                    kept.push(points[last]);
                } else {
                    spans.extend([(first + far, last), (first, first + far)]);
                }
            }
            start = end.max(start);
        }
        Ok(())
    }

    /// Returns the vector between two points in world coordinates.
    fn step(&self, from: Point, to: Point) -> [f64; 2] {
        let [across, down, _] = self.ground.frame.linear().to_cols_array_2d();
        let [x, y] = [0, 1].map(|axis| f64::from(to[axis]) - f64::from(from[axis]));
        [x * across[0] + y * down[0], x * across[1] + y * down[1]]
    }

    /// Returns the distance of a point from a segment in world coordinates.
    fn distance(&self, at: Point, [start, end]: [Point; 2]) -> f64 {
        let ([x, y], [along_x, along_y]) = (self.step(start, at), self.step(start, end));
        let length = along_x * along_x + along_y * along_y;
        let share = if length > 0.0 { ((x * along_x + y * along_y) / length).clamp(0.0, 1.0) } else { 0.0 };
        (x - share * along_x).hypot(y - share * along_y)
    }

    /// Returns the distance of a point from the line through two others, times the distance of
    /// these, in cells.
    fn line_distance(&self, at: Point, [start, end]: [Point; 2]) -> f64 {
        let [a, b] = [at, end].map(|to| [0, 1].map(|axis| i64::from(to[axis]) - i64::from(start[axis])));
        (a[0] * b[1] - a[1] * b[0]).unsigned_abs() as f64
    }

    /// Returns whether no other border vertex is between the points and the segment from the first
    /// to the last of them, or on the segment.
    fn is_free(&mut self, points: &[Point]) -> Result<bool> {
        let [[first_x, first_y], [last_x, last_y]] = [points[0], points[points.len() - 1]];
        let (mut top, mut bottom) = (first_y, first_y);
        for [_, y] in points {
            (top, bottom) = (top.min(*y), bottom.max(*y));
        }
        // Scale columns so that the segment has an integer column in each row.
        let (upper, lower) = if first_y <= last_y {
            ([first_x, first_y], [last_x, last_y])
        } else {
            ([last_x, last_y], [first_x, first_y])
        };
        let scale = i64::from(lower[1] - upper[1]).max(1);
        let slope = i64::from(lower[0]) - i64::from(upper[0]);
        let mut own: Vec<u64> = points.iter().map(|[x, y]| sort::pair_key([*y, *x])).collect();
        sort::numbers64(&mut own);
        let is_own = |at: Point| own.binary_search(&sort::pair_key([at[1], at[0]])).is_ok();
        // Segments along columns, by their first row.
        let mut steps: Vec<(u32, u32, u32)> = points
            .windows(2)
            .filter(|pair| pair[0][1] != pair[1][1])
            .map(|pair| (pair[0][1].min(pair[1][1]), pair[0][1].max(pair[1][1]), pair[0][0]))
            .collect();
        sort::by_key(&mut steps, |(start, ..)| u64::from(*start));
        let mut next = 0;
        let mut active: Vec<(u32, u32)> = Vec::new();
        let mut crossed: Vec<(i64, bool)> = Vec::new();
        for y in top..=bottom {
            active.retain(|(end, _)| *end > y);
            while let Some((start, end, x)) = steps.get(next).filter(|(start, ..)| *start <= y) {
                debug_assert!(*start == y);
                active.push((*end, *x));
                next += 1;
            }
            crossed.clear();
            crossed.extend(active.iter().map(|(_, x)| (i64::from(*x) * scale, false)));
            if upper[1] <= y && y < lower[1] {
                crossed.push((i64::from(upper[0]) * scale + i64::from(y - upper[1]) * slope, true));
            }
            if first_y == last_y && y == first_y {
                for x in first_x.min(last_x) + 1..first_x.max(last_x) {
                    if self.is_corner([x, y])? && !is_own([x, y]) {
                        return Ok(false);
                    }
                }
            }
            sort::by(&mut crossed, &mut Ord::cmp);
            for pair in crossed.chunks_exact(2) {
                let [(from, is_segment), (to, ends_in_segment)] = [pair[0], pair[1]];
                // (Vertices of other borders are on the arc's own segments only at their ends.)
                let low = if is_segment {
                    from.div_euclid(scale) + i64::from(from % scale != 0)
                } else {
                    from / scale + 1
                };
                let high = if ends_in_segment { to.div_euclid(scale) } else { to / scale - 1 };
                for x in low..=high {
                    let at = [x as u32, y];
                    if self.is_corner(at)? && !is_own(at) {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(true)
    }

    /// Returns whether a border turns or meets another one at a cell corner.
    fn is_corner(&mut self, [x, y]: Point) -> Result<bool> {
        let tile = [x / TILE, y / TILE];
        if !self.tiles.contains_key(&tile) {
            if self.tiles.len() >= self.most {
                self.tiles.clear();
            }
            let corners = self.read(tile)?;
            self.tiles.insert(tile, corners);
        }
        let bit = (y % TILE * TILE + x % TILE) as usize;
        Ok(self.tiles.get(&tile).is_some_and(|corners| corners[bit / 64] >> (bit % 64) & 1 > 0))
    }

    /// Finds the border vertices of a tile.
    fn read(&self, tile: [u32; 2]) -> Result<Corners> {
        let ground = self.ground;
        let first = tile.map(|tile| tile * TILE);
        // Includes the cells to the left and above.
        let low = first.map(|at| at.saturating_sub(1));
        let high: [u32; 2] =
            std::array::from_fn(|axis| u64::from(first[axis] + TILE).min(ground.size[axis]) as u32);
        let mut corners = vec![0; (TILE * TILE / 64) as usize].into_boxed_slice();
        let bounds =
            Bounds { min: [low[0].into(), low[1].into(), 0], max: [high[0].into(), high[1].into(), 1] };
        let (bytes, valid) =
            if bounds.is_empty() { Default::default() } else { ground.cells.window(&bounds)? };
        let columns = (high[0].saturating_sub(low[0])) as usize;
        let class = |x: i64, y: i64| {
            let is_inside = i64::from(low[0]) <= x
                && x < i64::from(high[0])
                && i64::from(low[1]) <= y
                && y < i64::from(high[1]);
            if !is_inside {
                return Class::VOID;
            }
            let index = (y - i64::from(low[1])) as usize * columns + (x - i64::from(low[0])) as usize;
            if !valid[index] {
                return Class::VOID;
            }
            let mut bits = [0; 8];
            bits[..ground.width].copy_from_slice(&bytes[index * ground.width..(index + 1) * ground.width]);
            ground.class(Class { is_valid: true, bits: u64::from_le_bytes(bits) })
        };
        for row in 0..TILE {
            for column in 0..TILE {
                let [x, y] = [first[0] + column, first[1] + row].map(i64::from);
                let (north_west, north_east) = (class(x - 1, y - 1), class(x, y - 1));
                let (south_west, south_east) = (class(x - 1, y), class(x, y));
                let is_along = |a: bool, b: bool, across: bool| a && b && !across;
                let [north, south] = [north_west != north_east, south_west != south_east];
                let [west, east] = [north_west != south_west, north_east != south_east];
                let is_any = north || south || west || east;
                let is_straight =
                    is_along(north, south, west || east) || is_along(west, east, north || south);
                if is_any && !is_straight {
                    let bit = (row * TILE + column) as usize;
                    corners[bit / 64] |= 1 << (bit % 64);
                }
            }
        }
        Ok(corners)
    }
}

/// Returns the index of the first farthest point between the ends.
fn farthest(points: &[Point], distance: impl Fn(Point) -> f64) -> usize {
    let mut found = (0, -1.0);
    for (index, point) in points.iter().enumerate().take(points.len() - 1).skip(1) {
        let far = distance(*point);
        if far > found.1 {
            found = (index, far);
        }
    }
    found.0
}
