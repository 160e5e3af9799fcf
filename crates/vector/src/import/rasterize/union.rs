//! The share of a cell that several polygons cover together, each point once.
//!
//! A cell with few edges is divided into slabs between consecutive rows in which an edge begins, ends, or crosses another: within a slab the covered
//! length is linear. One with many edges is divided into four first, so that few pairs of edges are compared.

use spinney_base::sort;
use spinney_base::space::EdgeRule;

use super::coverage::settled;
use super::edge::{Edge, PARTS, Point, centre};
use super::mask::Mask;
use super::shapes::{Part, Parts, ShapeKind, Shapes};

/// Maximum number of edges whose pairs are compared.
const MAX_EDGES: usize = 64;
/// Maximum number of times that a cell is divided, so that no edge is checked in more than some dozens of squares.
const MAX_DIVISIONS: u32 = 4;
/// Slabs of a square that has more edges after all divisions, in addition to those between ends, instead of those between crossings: lengths are
/// then those in the middle of a slab, a 1024th of a cell high at most. (Of 1,500 triangles in a few cells, shares are off by less than 1e-4.)
const MANY_SLABS: u32 = 64;

/// A square, in parts of cells.
#[derive(Clone, Copy)]
struct Square {
    low: Point,
    side: i64,
}

/// An edge of one of the polygons.
type Of = (usize, Edge);

/// The segment of an edge right of a square's left side, in sides of the square.
struct Segment {
    polygon: usize,
    /// Its ends; the first row is the lower one.
    from: [f64; 2],
    to: [f64; 2],
}

/// Where an edge crosses the left side of a square.
struct Crossing {
    polygon: usize,
    y: f64,
    /// Whether this is above the middle of the side: decided exactly.
    is_above: bool,
}

impl Shapes {
    /// The share of a cell that some of its parts cover together; lines and points cover cells that they meet.
    ///
    /// Cost: O(n log n) for n edges in the cell that are much shorter than it, and O(n^2) for those that pass through all of it.
    pub(super) fn union_share<'a>(
        &self,
        parts: &Parts,
        cell: Point,
        some: impl Iterator<Item = &'a Part>,
    ) -> f64 {
        let square = Square { low: cell.map(|at| at * PARTS), side: PARTS };
        let (mut edges, mut inside) = (Vec::new(), Vec::new());
        for part in some {
            if self.shapes[part.shape as usize].kind != ShapeKind::Polygon {
                let mut mask = Mask::new(1);
                self.mask(&mut mask, (parts, part), cell, EdgeRule::Centre);
                let mut is_met = false;
                mask.each(|_| is_met = true);
                if is_met {
                    return 1.0;
                }
                continue;
            }
            // From the cell's centre to its left side.
            let way = |edge: &Edge| edge.on_the_way_right(square.middle_left(), centre(cell[0]));
            let winding = part.winding - self.edges_of(parts, part).map(way).sum::<i32>();
            edges.extend(self.edges_of(parts, part).map(|edge| (inside.len(), *edge)));
            inside.push(winding % 2 != 0);
        }
        settled(covered(square, edges, inside, MAX_DIVISIONS))
    }
}

impl Square {
    fn middle_left(self) -> Point {
        [self.low[0], self.low[1] + self.side / 2]
    }

    fn quarters(self) -> [Square; 4] {
        let side = self.side / 2;
        let [x, y] = self.low;
        [[x, y], [x + side, y], [x, y + side], [x + side, y + side]].map(|low| Square { low, side })
    }

    /// The part of an edge on the right of the left side, and where it crosses that.
    ///
    /// Invariant: rounding moves a crossing along the side, but the segment ends in the same place as the crossing, and whether that is above the
    /// middle is decided exactly. So a row has each polygon inside as often as it has on the left, changed by all segments that it crosses: no wrong
    /// place costs more than the slab between this and the right one.
    fn segment(self, (polygon, edge): Of) -> (Option<Segment>, Option<Crossing>) {
        let local = |at: Point| [0, 1].map(|axis| (at[axis] - self.low[axis]) as f64 / self.side as f64);
        let is_right = |at: Point| at[0] > self.low[0];
        let rising = edge.rising(1);
        let (mut from, mut to) = (local(rising.a), local(rising.b));
        let mut crossing = None;
        if is_right(rising.a) != is_right(rising.b) {
            let is_above = edge.is_above(self.middle_left());
            // (Rounding moves it along the side, but not past the middle.)
            let y = from[1] + (to[1] - from[1]) * (-from[0] / (to[0] - from[0]));
            let y = if is_above { y.max(0.5) } else { y.min(0.5) };
            crossing = Some(Crossing { polygon, y, is_above });
            let end = if is_right(rising.a) { &mut to } else { &mut from };
            *end = [0.0, y];
        } else if !is_right(rising.a) {
            return (None, None);
        }
        // (One along a row is not crossed on the way along another.)
        let is_there = from[1] < to[1] && to[1] > 0.0 && from[1] < 1.0;
        (is_there.then_some(Segment { polygon, from, to }), crossing)
    }
}

impl Segment {
    /// Its column at a row that it crosses.
    fn column(&self, y: f64) -> f64 {
        self.from[0] + (self.to[0] - self.from[0]) * ((y - self.from[1]) / (self.to[1] - self.from[1]))
    }
}

/// The share of a square that polygons cover, given their edges in it, and which of them have the middle of its left side inside.
fn covered(square: Square, mut edges: Vec<Of>, mut inside: Vec<bool>, divisions: u32) -> f64 {
    let mut has_edges = vec![false; inside.len()];
    edges.iter().for_each(|(polygon, _)| has_edges[*polygon] = true);
    // (Polygons that cover all of it.)
    if inside.iter().zip(&has_edges).any(|(is_inside, has_edges)| *is_inside && !has_edges) {
        return 1.0;
    }
    // Others without edges cover nothing: the rest gets consecutive numbers.
    let mut next = 0;
    let mut numbers = Vec::with_capacity(inside.len());
    for has_edges in &has_edges {
        numbers.push(next);
        next += usize::from(*has_edges);
    }
    edges.iter_mut().for_each(|(polygon, _)| *polygon = numbers[*polygon]);
    let mut has_edges = has_edges.into_iter();
    inside.retain(|_| has_edges.next() == Some(true));
    if edges.len() <= MAX_EDGES || divisions == 0 {
        return covered_in_slabs(square, &edges, &inside);
    }
    let share = |quarter: Square| {
        let (first, next) = (square.middle_left(), quarter.middle_left());
        let mut inside = inside.clone();
        for (polygon, edge) in &edges {
            // Along the left side, then right.
            let up = match next[1] >= first[1] {
                true => edge.on_the_way_up(first, next[1]),
                false => edge.on_the_way_up([first[0], next[1]], first[1]),
            };
            let way = up + edge.on_the_way_right([first[0], next[1]], next[0]);
            inside[*polygon] ^= way % 2 != 0;
        }
        let high = quarter.low.map(|at| at + quarter.side);
        let own = edges.iter().filter(|(_, edge)| edge.may_meet(quarter.low, high)).copied().collect();
        covered(quarter, own, inside, divisions - 1) / 4.0
    };
    square.quarters().map(share).iter().sum()
}

fn covered_in_slabs(square: Square, edges: &[Of], inside: &[bool]) -> f64 {
    let (mut segments, mut crossings) = (Vec::with_capacity(edges.len()), Vec::new());
    for edge in edges {
        let (segment, crossing) = square.segment(*edge);
        segments.extend(segment);
        crossings.extend(crossing);
    }
    let rows = rows_between(&segments, &crossings);
    sort::by(&mut segments, &mut |a, b| a.from[1].total_cmp(&b.from[1]));
    let mut next = segments.iter().peekable();
    // Segments that pass through the slab.
    let mut crossed: Vec<&Segment> = Vec::new();
    let mut sum = 0.0;
    let mut at: Vec<(f64, usize)> = Vec::new();
    for slab in rows.windows(2) {
        let y = (slab[0] + slab[1]) / 2.0;
        let mut inside = inside.to_vec();
        for crossing in &crossings {
            let is_between = if crossing.is_above { crossing.y < y } else { crossing.y > y };
            inside[crossing.polygon] ^= is_between;
        }
        at.clear();
        crossed.retain(|segment| y < segment.to[1]);
        while let Some(segment) = next.next_if(|segment| segment.from[1] < y) {
            if y < segment.to[1] {
                crossed.push(segment);
            }
        }
        at.extend(crossed.iter().map(|segment| (segment.column(y).clamp(0.0, 1.0), segment.polygon)));
        sort::by(&mut at, &mut |(a, _), (b, _)| a.total_cmp(b));
        sum += (slab[1] - slab[0]) * covered_length(&at, &mut inside);
    }
    sum
}

/// The length from 0 to 1 that polygons cover, given the columns at which their edges are crossed, and which have the left end inside.
fn covered_length(at: &[(f64, usize)], inside: &mut [bool]) -> f64 {
    let mut count = inside.iter().filter(|is_inside| **is_inside).count();
    let (mut length, mut last) = (0.0, 0.0);
    for (column, polygon) in at.iter().copied().chain([(1.0, usize::MAX)]) {
        if count > 0 {
            length += column - last;
        }
        last = column;
        if let Some(is_inside) = inside.get_mut(polygon) {
            *is_inside = !*is_inside;
            if *is_inside { count += 1 } else { count -= 1 }
        }
    }
    length
}

/// Rows from 0 to 1 between which segments neither begin nor end nor cross each other or a side, in order.
fn rows_between(segments: &[Segment], crossings: &[Crossing]) -> Vec<f64> {
    let mut rows = vec![0.0, 0.5, 1.0];
    rows.extend(crossings.iter().map(|crossing| crossing.y));
    for segment in segments {
        rows.extend([segment.from[1], segment.to[1]]);
        if (segment.from[0] > 1.0) != (segment.to[0] > 1.0) {
            let share = (1.0 - segment.from[0]) / (segment.to[0] - segment.from[0]);
            rows.push(segment.from[1] + (segment.to[1] - segment.from[1]) * share);
        }
    }
    if segments.len() <= MAX_EDGES {
        for (number, one) in segments.iter().enumerate() {
            for other in segments[..number].iter().filter(|other| other.polygon != one.polygon) {
                rows.extend(crossing_row(one, other));
            }
        }
    } else {
        rows.extend((1..MANY_SLABS).map(|slab| f64::from(slab) / f64::from(MANY_SLABS)));
    }
    rows.retain(|y| (0.0..=1.0).contains(y));
    sort::by(&mut rows, &mut |a, b| a.total_cmp(b));
    rows
}

/// The row in which two segments cross each other.
fn crossing_row(one: &Segment, other: &Segment) -> Option<f64> {
    let (low, high) = (one.from[1].max(other.from[1]), one.to[1].min(other.to[1]));
    if low >= high {
        return None;
    }
    let [first, last] = [low, high].map(|y| one.column(y) - other.column(y));
    ((first > 0.0) != (last > 0.0)).then(|| low + (high - low) * (first / (first - last)))
}
