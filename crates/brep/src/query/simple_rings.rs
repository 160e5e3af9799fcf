//! Makes the rings of a section simple, which may touch themselves or each other in points. The
//! results are boundaries of connected areas, split at repeated points. Polygons are then valid
//! simple features.

use std::collections::BTreeMap;

use super::touching_points;
use spinney_base::sort;

type Point = [f64; 3];

/// A rounded point, equal for points that coincide.
type Key = [i64; 3];

/// Points of different edges coincide within this fraction of a grid unit.
const FINE: f64 = 4096.0;

fn key(point: &Point) -> Key {
    point.map(|at| (at * FINE).round() as i64)
}

/// Makes rings simple. Each ends with its first point, and has the inside on its left, as seen
/// along two axes of their plane.
pub(super) fn simple_rings(mut rings: Vec<Vec<Point>>, axes: [Point; 2]) -> Vec<Vec<Point>> {
    touching_points::insert(&mut rings, axes, 1.0 / FINE);
    let mut counts: BTreeMap<Key, u32> = BTreeMap::new();
    for point in rings.iter().flat_map(|ring| &ring[1..]) {
        *counts.entry(key(point)).or_default() += 1;
    }
    let is_shared = |point: &Point| counts[&key(point)] > 1;
    let (touching, mut simple): (Vec<_>, Vec<_>) =
        rings.into_iter().partition(|ring| ring[1..].iter().any(is_shared));
    if touching.is_empty() {
        return simple;
    }
    let mut outlines = Outlines::of(&touching, axes);
    while let Some(ring) = outlines.take() {
        split(&ring, &mut simple);
    }
    simple
}

/// Splits a ring, given without its last point, at repeated points.
fn split(ring: &[(Key, Point)], found: &mut Vec<Vec<Point>>) {
    let mut open: Vec<(Key, Point)> = Vec::new();
    let mut positions: BTreeMap<Key, usize> = BTreeMap::new();
    let mut close = |loop_: Vec<(Key, Point)>| {
        if loop_.len() > 2 {
            let first = loop_[0].1;
            found.push(loop_.into_iter().map(|(_, point)| point).chain([first]).collect());
        }
    };
    for &(key, point) in ring {
        if let Some(&place) = positions.get(&key) {
            let loop_: Vec<(Key, Point)> = open.drain(place..).collect();
            for (key, _) in &loop_ {
                positions.remove(key);
            }
            close(loop_);
        }
        positions.insert(key, open.len());
        open.push((key, point));
    }
    close(open);
}

/// Directed edges between points, with the inside on their left.
struct Outlines {
    axes: [Point; 2],
    points: BTreeMap<Key, Point>,
    /// For each point: ends of the edges that start there, possibly with repetitions.
    out: BTreeMap<Key, Vec<Key>>,
}

impl Outlines {
    fn of(rings: &[Vec<Point>], axes: [Point; 2]) -> Outlines {
        let mut points = BTreeMap::new();
        let mut edges: BTreeMap<[Key; 2], i32> = BTreeMap::new();
        for ends in rings.iter().flat_map(|ring| ring.windows(2)) {
            let [from, to] = [key(&ends[0]), key(&ends[1])];
            points.entry(from).or_insert(ends[0]);
            points.entry(to).or_insert(ends[1]);
            // (Edges in both directions bound nothing.)
            match from.cmp(&to) {
                std::cmp::Ordering::Less => *edges.entry([from, to]).or_default() += 1,
                std::cmp::Ordering::Greater => *edges.entry([to, from]).or_default() -= 1,
                std::cmp::Ordering::Equal => {}
            }
        }
        let mut out: BTreeMap<Key, Vec<Key>> = BTreeMap::new();
        for ([from, to], count) in edges {
            let [from, to] = if count > 0 { [from, to] } else { [to, from] };
            (0..count.abs()).for_each(|_| out.entry(from).or_default().push(to));
        }
        Outlines { axes, points, out }
    }

    /// Returns the angle of the direction from one point to another.
    fn angle(&self, from: Key, to: Key) -> f64 {
        let (from, to) = (self.points[&from], self.points[&to]);
        let [x, y] =
            self.axes.map(|along| (0..3).map(|axis| along[axis] * (to[axis] - from[axis])).sum::<f64>());
        y.atan2(x)
    }

    /// Removes a ring, without its last point: the outer boundary or a hole of one connected area.
    fn take(&mut self) -> Option<Vec<(Key, Point)>> {
        let start = loop {
            let first = self.out.first_entry()?;
            if first.get().is_empty() {
                first.remove();
            } else {
                break *first.key();
            }
        };
        let first = *self.out.get(&start)?.last()?;
        let mut ring = vec![(start, self.points[&start])];
        let (mut from, mut at) = (start, self.pop(start, first));
        // Until the first edge would follow.
        loop {
            match self.next(from, at, (start, first)) {
                Some(next) if (at, next) != (start, first) => {
                    ring.push((at, self.points[&at]));
                    (from, at) = (at, self.pop(at, next));
                }
                _ => return Some(ring),
            }
        }
    }

    fn pop(&mut self, from: Key, to: Key) -> Key {
        if let Some(out) = self.out.get_mut(&from)
            && let Some(place) = out.iter().position(|other| *other == to)
        {
            out.remove(place);
        }
        to
    }

    /// Returns the end of the next edge around the area on the left of the edge to a point: the
    /// first one clockwise from that edge. The first edge of the ring is a candidate, although it
    /// was removed.
    fn next(&self, from: Key, at: Key, first: (Key, Key)) -> Option<Key> {
        let own = self.out.get(&at).into_iter().flatten().copied();
        let mut ends: Vec<Key> = own.chain((at == first.0).then_some(first.1)).collect();
        if ends.len() < 2 {
            return ends.pop();
        }
        let back = self.angle(at, from);
        let clockwise = |to: Key| {
            let turn = (back - self.angle(at, to)).rem_euclid(std::f64::consts::TAU);
            if turn == 0.0 { std::f64::consts::TAU } else { turn }
        };
        sort::by_key(&mut ends, |to| sort::float_key(clockwise(*to)));
        ends.first().copied()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const FLAT: [Point; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    fn ring(points: &[[i32; 2]]) -> Vec<Point> {
        let all = points.iter().chain(points.first());
        all.map(|[x, y]| [f64::from(*x), f64::from(*y), 0.5]).collect()
    }

    fn area(ring: &[Point]) -> f64 {
        ring.windows(2).map(|ends| ends[0][0] * ends[1][1] - ends[1][0] * ends[0][1]).sum::<f64>() / 2.0
    }

    /// Areas of the rings; checks that each has no repeated points.
    fn areas(rings: Vec<Vec<Point>>) -> Vec<f64> {
        let found = simple_rings(rings, FLAT);
        for ring in &found {
            assert_eq!(ring[0], ring[ring.len() - 1]);
            let points: BTreeSet<Key> = ring.iter().map(key).collect();
            assert_eq!(points.len() + 1, ring.len(), "{ring:?}");
        }
        let mut areas: Vec<f64> = found.iter().map(|ring| area(ring)).collect();
        areas.sort_by(f64::total_cmp);
        areas
    }

    #[test]
    fn rings_that_touch_themselves_are_split() {
        // Two squares with a common point, as one ring in either way.
        let eight = [[0, 0], [2, 0], [2, 2], [4, 2], [4, 4], [2, 4], [2, 2], [0, 2]];
        assert_eq!(areas(vec![ring(&eight)]), [4.0, 4.0]);
        // A hole that touches the ring around it in a point.
        let pinched = [[0, 0], [6, 0], [6, 6], [0, 6], [0, 0], [2, 4], [4, 2]];
        assert_eq!(areas(vec![ring(&pinched)]), [-6.0, 36.0]);
        // A hole that touches it in two points splits the area.
        let (outer, hole) =
            (ring(&[[0, 0], [4, 0], [4, 4], [0, 4]]), ring(&[[0, 0], [1, 2], [4, 4], [2, 1]]));
        assert_eq!(areas(vec![outer, hole]), [6.0, 6.0]);
        // A point within an edge of the same ring, and two points of a hole within the sides around
        // it.
        let pinched = [[0, 0], [6, 0], [6, 6], [4, 6], [3, 0], [2, 6], [0, 6]];
        assert_eq!(areas(vec![ring(&pinched)]), [15.0, 15.0]);
        let (outer, hole) =
            (ring(&[[0, 0], [8, 0], [8, 8], [0, 8]]), ring(&[[4, 0], [3, 4], [4, 8], [5, 4]]));
        assert_eq!(areas(vec![outer, hole]), [28.0, 28.0]);
        // Coincident walls bound nothing.
        let (left, right) =
            (ring(&[[0, 0], [2, 0], [2, 2], [0, 2]]), ring(&[[2, 0], [4, 0], [4, 2], [2, 2]]));
        assert_eq!(areas(vec![left.clone(), right]), [8.0]);
        let separate = ring(&[[7, 0], [9, 0], [9, 2]]);
        assert_eq!(simple_rings(vec![left.clone(), separate.clone()], FLAT), [left, separate]);
    }

    /// Areas of random cells, whose squares share points.
    #[test]
    fn random_cells_have_simple_rings() {
        let mut state = 9u64;
        for _ in 0..200 {
            let mut cells = [[false; 7]; 7];
            let mut count = 0;
            for (y, row) in cells.iter_mut().enumerate().take(6).skip(1) {
                for (x, cell) in row.iter_mut().enumerate().take(6).skip(1) {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    *cell = (state >> 60).is_multiple_of(2) || x == y;
                    count += i32::from(*cell);
                }
            }
            let squares: Vec<Vec<Point>> = (0..49i32)
                .filter(|cell| cells[(cell / 7) as usize][(cell % 7) as usize])
                .map(|cell| {
                    let (x, y) = (cell % 7, cell / 7);
                    ring(&[[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]])
                })
                .collect();
            let found = areas(squares);
            assert_eq!(found.iter().sum::<f64>(), f64::from(count));
            // As many outer rings as areas that are connected by sides.
            let mut parts = 0;
            let mut open = cells;
            for first in 0..49usize {
                let mut stack = vec![first];
                let mut is_new = false;
                while let Some(cell) = stack.pop() {
                    let (x, y) = (cell % 7, cell / 7);
                    if std::mem::take(&mut open[y][x]) {
                        is_new = true;
                        stack.extend([cell - 1, cell + 1, cell - 7, cell + 7]);
                    }
                }
                parts += usize::from(is_new);
            }
            assert_eq!(found.iter().filter(|area| **area > 0.0).count(), parts);
        }
    }
}
