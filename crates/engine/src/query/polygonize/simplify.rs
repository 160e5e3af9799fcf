//! Simplifies arcs with the algorithm of Douglas and Peucker (1973), under the condition of
//! Saalfeld (1999) and de Berg, van Kreveld and Schirra (1998) that no border vertex is between the
//! original line and the simplified one.
//!
//! A span of an arc is replaced by a segment if all its points are within the tolerance of the
//! segment, and no other border vertex is between the two or on the segment. Otherwise the span is
//! split at its farthest point.
//!
//! Invariant: simplified segments only meet at their ends. Let the segments `s` and `t` replace the
//! spans `S` and `T`, and suppose that `s` and `t` cross: once, since both are straight.
//!
//! - `S` and `s` form a closed curve. The ends of `t` are border vertices, so they are not inside
//!   the curve, and `t` crosses it an even number of times. One crossing is with `s`, so `t`
//!   crosses `S` an odd number of times.
//! - In the same way, `S` crosses the closed curve of `T` and `t` an even number of times. It does
//!   not cross `T`, since borders do not cross. So it crosses `t` an even number of times: a
//!   contradiction.
//!
//! Two segments with the same ends would require an arc that lost all its inner points, or a ring
//! of two points. Neither exists:
//!
//! - An arc with inner points keeps at least one: the point farthest from the line through its
//!   ends, or a point where two chunks meet.
//! - A ring keeps at least three points. A ring of one chunk keeps its start, the point farthest
//!   from that, and the point farthest from the line through these two. Other rings keep the start
//!   and at least two points where chunks meet. These three are not collinear: one would be on the
//!   segment between the others, which is not allowed.
//!
//! So each arc can be simplified on its own, given only the original vertices of all borders. Since
//! no vertex gets to another side of a border, rings also keep their orientation and nesting.

use std::collections::HashMap;

use super::ClassGrid;
use super::arcs::Arcs;
use super::points::Point;
use super::rows::Class;
use spinney_base::space::Bounds;
use spinney_base::{Result, sort};

/// Points of an arc per chunk, which limits memory and time. Longer arcs keep the points where two
/// chunks meet. A ring of up to two chunks is treated as one: it would have at most one such point.
const CHUNK_POINTS: usize = 1 << 12;

/// Columns and rows of cell corners that are read together.
const TILE_SIDE: u32 = 256;

/// Border vertices of a tile, one bit per cell corner.
type VertexBits = Box<[u64]>;

/// State of the simplification.
pub(super) struct Simplifier<'a> {
    grid: &'a ClassGrid<'a>,
    tolerance: f64,
    tiles: HashMap<[u32; 2], VertexBits>,
    /// Maximum number of tiles in memory.
    max_tiles: usize,
}

impl<'a> Simplifier<'a> {
    pub(super) fn new(grid: &'a ClassGrid<'a>, tolerance: f64, memory: u64) -> Simplifier<'a> {
        let bytes = u64::from(TILE_SIDE * TILE_SIDE / 8);
        let max_tiles = usize::try_from(memory / bytes).unwrap_or(usize::MAX).max(16);
        Simplifier { grid, tolerance, tiles: HashMap::new(), max_tiles }
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
        let max_count = if is_ring { 2 * CHUNK_POINTS - 1 } else { CHUNK_POINTS };
        let is_one_chunk = arc.count <= max_count as u64;
        let mut kept = vec![arc.ends[0]];
        let mut chunk: Vec<Point> = Vec::new();
        arcs.points.each(arc.chain, false, &mut |points| {
            for point in points {
                chunk.push(*point);
                if chunk.len() == CHUNK_POINTS && !is_one_chunk {
                    self.simplify_chunk(&chunk, &[], &mut kept)?;
                    chunk = vec![*point];
                }
            }
            Ok(())
        })?;
        let mut fixed = Vec::new();
        if is_one_chunk && is_ring {
            let far = farthest(&chunk, |at| self.distance(at, [chunk[0]; 2]));
            let ends = [chunk[0], chunk[far]];
            fixed = vec![far, farthest(&chunk, |at| self.line_distance(at, ends))];
        } else if is_one_chunk {
            let ends = [chunk[0], chunk[chunk.len() - 1]];
            fixed = vec![farthest(&chunk, |at| self.line_distance(at, ends))];
        }
        self.simplify_chunk(&chunk, &fixed, &mut kept)?;
        arcs.replace(number, &kept);
        Ok(())
    }

    /// Simplifies a chunk of points and appends the result to `kept`, without the first point.
    /// Points with `fixed` indices, corners of the raster and the last point are kept.
    fn simplify_chunk(&mut self, points: &[Point], fixed: &[usize], kept: &mut Vec<Point>) -> Result<()> {
        let [width, height] = self.grid.size.map(|cells| cells as u32);
        let is_raster_corner = |[x, y]: Point| (x == 0 || x == width) && (y == 0 || y == height);
        let mut fixed: Vec<usize> = fixed.to_vec();
        fixed.extend((0..points.len()).filter(|index| is_raster_corner(points[*index])));
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
    fn vector(&self, from: Point, to: Point) -> [f64; 2] {
        let [across, down, _] = self.grid.frame.linear().to_cols_array_2d();
        let [x, y] = [0, 1].map(|axis| f64::from(to[axis]) - f64::from(from[axis]));
        [x * across[0] + y * down[0], x * across[1] + y * down[1]]
    }

    /// Returns the distance of a point from a segment in world coordinates.
    fn distance(&self, at: Point, [start, end]: [Point; 2]) -> f64 {
        let ([x, y], [along_x, along_y]) = (self.vector(start, at), self.vector(start, end));
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
    ///
    /// Scans rows of cell corners: those after an odd number of crossings with the points' border
    /// or the segment are between the two.
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
        // Vertical segments of the border by their first row: first and last row, and column.
        let mut verticals: Vec<(u32, u32, u32)> = points
            .windows(2)
            .filter(|pair| pair[0][1] != pair[1][1])
            .map(|pair| (pair[0][1].min(pair[1][1]), pair[0][1].max(pair[1][1]), pair[0][0]))
            .collect();
        sort::by_key(&mut verticals, |(start, ..)| u64::from(*start));
        let mut next = 0;
        let mut active: Vec<(u32, u32)> = Vec::new();
        // Crossings of a row: scaled column, and whether the segment crosses there.
        let mut crossed: Vec<(i64, bool)> = Vec::new();
        for y in top..=bottom {
            // Crossings are counted just below the row: a vertical that starts in row `y` counts,
            // one that ends there does not. So their number is even. All corners inside are found,
            // since the area inside continues below them. Corners on horizontal edges may be found,
            // too. Those of the points' border are own or no vertices, and a horizontal segment,
            // which is never crossed, is searched separately.
            active.retain(|(end, _)| *end > y);
            while let Some((start, end, x)) = verticals.get(next).filter(|(start, ..)| *start <= y) {
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
                    if self.is_vertex([x, y])? && !is_own([x, y]) {
                        return Ok(false);
                    }
                }
            }
            sort::by(&mut crossed, &mut Ord::cmp);
            for pair in crossed.chunks_exact(2) {
                let [(from, is_segment), (to, ends_in_segment)] = [pair[0], pair[1]];
                // Corners on the segment count, as another border must not touch it. Those on the
                // points' border do not: other borders touch it only at its ends, which are own.
                let low = if is_segment {
                    from.div_euclid(scale) + i64::from(from % scale != 0)
                } else {
                    from / scale + 1
                };
                let high = if ends_in_segment { to.div_euclid(scale) } else { to / scale - 1 };
                for x in low..=high {
                    let at = [x as u32, y];
                    if self.is_vertex(at)? && !is_own(at) {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(true)
    }

    /// Returns whether a border turns or meets another one at a cell corner.
    ///
    /// Reads one tile at a time, which is a query of its own if the tree is remote: the next tile
    /// depends on the vertices of this one. Its cells were recently read as rows, so that their
    /// bytes are often cached.
    fn is_vertex(&mut self, [x, y]: Point) -> Result<bool> {
        let tile = [x / TILE_SIDE, y / TILE_SIDE];
        if !self.tiles.contains_key(&tile) {
            if self.tiles.len() >= self.max_tiles {
                self.tiles.clear();
            }
            let vertices = self.read_tile(tile)?;
            self.tiles.insert(tile, vertices);
        }
        let bit = (y % TILE_SIDE * TILE_SIDE + x % TILE_SIDE) as usize;
        Ok(self.tiles.get(&tile).is_some_and(|vertices| vertices[bit / 64] >> (bit % 64) & 1 > 0))
    }

    /// Finds the border vertices of a tile.
    fn read_tile(&self, tile: [u32; 2]) -> Result<VertexBits> {
        let grid = self.grid;
        let first = tile.map(|tile| tile * TILE_SIDE);
        // Includes the cells to the left and above.
        let low = first.map(|at| at.saturating_sub(1));
        let high: [u32; 2] =
            std::array::from_fn(|axis| u64::from(first[axis] + TILE_SIDE).min(grid.size[axis]) as u32);
        let mut vertices = vec![0; (TILE_SIDE * TILE_SIDE / 64) as usize].into_boxed_slice();
        let bounds =
            Bounds { min: [low[0].into(), low[1].into(), 0], max: [high[0].into(), high[1].into(), 1] };
        let (bytes, valid) =
            if bounds.is_empty() { Default::default() } else { grid.cells.window(&bounds)? };
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
            bits[..grid.width].copy_from_slice(&bytes[index * grid.width..(index + 1) * grid.width]);
            grid.class(Class { is_valid: true, bits: u64::from_le_bytes(bits) })
        };
        for row in 0..TILE_SIDE {
            for column in 0..TILE_SIDE {
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
                    let bit = (row * TILE_SIDE + column) as usize;
                    vertices[bit / 64] |= 1 << (bit % 64);
                }
            }
        }
        Ok(vertices)
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
