//! Outlines in a plane: sets of rings that are combined by the even-odd rule.

use std::cell::Cell;

use crate::box_state::BoxState;
use spinney_base::space::{Dimension, morton_encode};

/// Fan-out of the bounding volume hierarchy, and number of items in a node of the lowest level.
const FAN_OUT: usize = 8;

/// A point in a plane.
pub(crate) type Point = [f64; 2];

/// Rings in a plane, combined by the even-odd rule: a ring within another one is a hole.
#[derive(Clone, Debug)]
pub(crate) struct Outline {
    /// The rings in Morton order, so that near rings are mostly near in memory.
    pub(crate) rings: Vec<Ring>,
    boxes: Boxes,
}

/// A ring.
#[derive(Clone, Debug)]
pub(crate) struct Ring {
    /// Its vertices, without the first one repeated at the end.
    pub(crate) points: Vec<Point>,
    /// Bounding boxes of its edges.
    boxes: Boxes,
}

/// A ring of a face.
pub(crate) struct DirectedRing {
    /// Its vertices: counterclockwise for an outer ring, clockwise for a hole.
    pub(crate) points: Vec<Point>,
    /// For a hole, the index of the ring around it.
    pub(crate) hole_in: Option<usize>,
}

/// Bounding box of consecutive edges, and the y coordinates at which they begin and end.
#[derive(Clone, Copy, Debug)]
struct EdgeSpan {
    min: Point,
    max: Point,
    ends: [f64; 2],
}

impl EdgeSpan {
    fn edge([a, b]: [Point; 2]) -> EdgeSpan {
        EdgeSpan {
            min: [a[0].min(b[0]), a[1].min(b[1])],
            max: [a[0].max(b[0]), a[1].max(b[1])],
            ends: [a[1], b[1]],
        }
    }

    fn joined(self, next: EdgeSpan) -> EdgeSpan {
        EdgeSpan {
            min: [0, 1].map(|axis| self.min[axis].min(next.min[axis])),
            max: [0, 1].map(|axis| self.max[axis].max(next.max[axis])),
            ends: [self.ends[0], next.ends[1]],
        }
    }

    /// Whether it overlaps a box, given by its centre and half widths.
    fn meets(&self, centre: Point, half: Point) -> bool {
        (0..2).all(|axis| {
            self.min[axis] <= centre[axis] + half[axis] && self.max[axis] >= centre[axis] - half[axis]
        })
    }
}

/// A bounding volume hierarchy over items in order: each node covers up to 8 consecutive ones of
/// the level below, up to a single root.
#[derive(Clone, Debug)]
struct Boxes {
    levels: Vec<Vec<EdgeSpan>>,
    count: usize,
}

impl Boxes {
    /// Builds the hierarchy over one or more items.
    fn over(things: &[EdgeSpan]) -> Boxes {
        let join = |spans: &[EdgeSpan]| -> Vec<EdgeSpan> {
            let of = |spans: &[EdgeSpan]| spans[1..].iter().fold(spans[0], |all, span| all.joined(*span));
            spans.chunks(FAN_OUT).map(of).collect()
        };
        let mut levels = vec![join(things)];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            levels.push(join(last));
        }
        Boxes { levels, count: things.len() }
    }

    /// Returns the root's bounding box.
    fn all(&self) -> EdgeSpan {
        self.levels[self.levels.len() - 1][0]
    }

    /// Traverses the nodes for which `enter` returns `true`, and calls `take` with the indices of
    /// their items until it returns `false`.
    fn visit(&self, enter: &mut dyn FnMut(&EdgeSpan) -> bool, take: &mut dyn FnMut(usize) -> bool) {
        // At most 7 nodes of each level are pending.
        let mut stack = vec![(self.levels.len() - 1, 0)];
        while let Some((level, index)) = stack.pop() {
            if !enter(&self.levels[level][index]) {
                continue;
            }
            let first = index * FAN_OUT;
            if level > 0 {
                let end = (first + FAN_OUT).min(self.levels[level - 1].len());
                stack.extend((first..end).map(|index| (level - 1, index)));
            } else if !(first..(first + FAN_OUT).min(self.count)).all(&mut *take) {
                return;
            }
        }
    }
}

impl Ring {
    /// Creates a ring of at least three vertices.
    fn new(points: Vec<Point>) -> Ring {
        let edges: Vec<EdgeSpan> =
            (0..points.len()).map(|edge| EdgeSpan::edge(edge_of(&points, edge))).collect();
        let boxes = Boxes::over(&edges);
        Ring { points, boxes }
    }

    fn is_clockwise(&self) -> bool {
        let [x, y] = self.points[0];
        let next = self.points.iter().cycle().skip(1);
        // (Relative to one of its vertices, so that rings far from the origin keep their
        // precision.)
        let twice = |(a, b): (&Point, &Point)| (a[0] - x) * (b[1] - y) - (b[0] - x) * (a[1] - y);
        self.points.iter().zip(next).map(twice).sum::<f64>() < 0.0
    }

    /// Whether a ray from a point to the right crosses the ring an odd number of times.
    fn is_around(&self, [x, y]: Point) -> bool {
        let is_odd = Cell::new(false);
        self.boxes.visit(
            &mut |span| {
                if y < span.min[1] || y >= span.max[1] || x > span.max[0] {
                    return false;
                }
                if x < span.min[0] {
                    // All of it is to the right of the point: its ends decide the parity.
                    is_odd.set(is_odd.get() != ((span.ends[0] > y) != (span.ends[1] > y)));
                    return false;
                }
                true
            },
            &mut |edge| {
                let [a, b] = edge_of(&self.points, edge);
                if (a[1] > y) != (b[1] > y) {
                    let is_crossed = x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                    is_odd.set(is_odd.get() != is_crossed);
                }
                true
            },
        );
        is_odd.get()
    }

    /// Whether an edge may pass through a box, given by its centre and half widths.
    fn passes(&self, centre: Point, half: Point) -> bool {
        let mut passes = false;
        self.boxes.visit(&mut |span| span.meets(centre, half), &mut |edge| {
            let [a, b] = edge_of(&self.points, edge);
            let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
            let side = dx * (centre[1] - a[1]) - dy * (centre[0] - a[0]);
            // (The half widths include a margin for rounding.)
            passes |= EdgeSpan::edge([a, b]).meets(centre, half)
                && side.abs() <= dx.abs() * half[1] + dy.abs() * half[0];
            !passes
        });
        passes
    }
}

/// Returns the ends of an edge.
fn edge_of(points: &[Point], edge: usize) -> [Point; 2] {
    [points[edge], points[if edge + 1 == points.len() { 0 } else { edge + 1 }]]
}

impl Outline {
    /// Creates an outline of one or more rings with at least three vertices each.
    pub(crate) fn new(rings: Vec<Vec<Point>>) -> Outline {
        let mut rings: Vec<Ring> = rings.into_iter().map(Ring::new).collect();
        let around =
            |rings: &[Ring]| Boxes::over(&rings.iter().map(|ring| ring.boxes.all()).collect::<Vec<_>>());
        let all = around(&rings).all();
        rings.sort_by_cached_key(|ring| {
            let span = ring.boxes.all();
            let at = |axis: usize| {
                let share = (span.min[axis] - all.min[axis]) / (all.max[axis] - all.min[axis]);
                morton_encode(Dimension::Quad, (share * 65535.0) as u32)
            };
            at(0) | at(1) << 1
        });
        let boxes = around(&rings);
        Outline { rings, boxes }
    }

    /// Returns the maximum magnitude of a coordinate.
    pub(crate) fn magnitude(&self) -> f64 {
        let all = self.rings.iter().flat_map(|ring| &ring.points).flatten();
        all.fold(0.0, |most: f64, at| most.max(at.abs()))
    }

    /// Yields the indices of the rings that go around a point.
    fn around(&self, point: Point, take: &mut dyn FnMut(usize)) {
        self.boxes.visit(&mut |span| span.meets(point, [0.0; 2]), &mut |ring| {
            if self.rings[ring].is_around(point) {
                take(ring);
            }
            true
        });
    }

    /// Whether a point is inside.
    pub(crate) fn has(&self, point: Point) -> bool {
        let mut is_inside = false;
        self.around(point, &mut |_| is_inside = !is_inside);
        is_inside
    }

    /// Classifies a box, given by its centre and half widths, as inside, outside or mixed.
    pub(crate) fn classify(&self, centre: Point, half: Point) -> BoxState {
        let mut passes = false;
        self.boxes.visit(&mut |span| span.meets(centre, half), &mut |ring| {
            passes = self.rings[ring].passes(centre, half);
            !passes
        });
        if passes { BoxState::Mixed } else { BoxState::uniform(self.has(centre)) }
    }

    /// Returns the rings oriented as rings of faces. (The result is not defined for rings that
    /// intersect.)
    pub(crate) fn directed(&self) -> Vec<DirectedRing> {
        let around = |number: usize| {
            let mut others = Vec::new();
            self.around(self.rings[number].points[0], &mut |ring| others.push(ring));
            others.retain(|other| *other != number);
            others
        };
        let depths: Vec<usize> = (0..self.rings.len()).map(|number| around(number).len()).collect();
        let of = |number: usize| {
            let is_hole = depths[number] % 2 == 1;
            let mut points = self.rings[number].points.clone();
            if self.rings[number].is_clockwise() != is_hole {
                points.reverse();
            }
            let innermost = || around(number).into_iter().find(|other| depths[*other] + 1 == depths[number]);
            DirectedRing { points, hole_in: if is_hole { innermost() } else { None } }
        };
        (0..self.rings.len()).map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares rings with many edges with and without the hierarchy.
    #[test]
    fn boxes_over_edges_change_nothing() {
        let star = |count: usize, long: f64, short: f64| -> Vec<[f64; 2]> {
            let corner = |number: usize| {
                let angle = number as f64 / count as f64 * std::f64::consts::TAU;
                let radius = if number.is_multiple_of(2) { long } else { short };
                [radius * angle.cos(), radius * angle.sin()]
            };
            (0..count).map(corner).collect()
        };
        let rings = vec![star(1000, 10.0, 9.0), star(77, 5.0, 1.0)];
        let outline = Outline::new(rings.clone());
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for _ in 0..20_000 {
            let point @ [x, y] = [random() * 24.0 - 12.0, random() * 24.0 - 12.0];
            let crossed = rings.iter().flat_map(|ring| (0..ring.len()).map(|edge| edge_of(ring, edge)));
            let crossed = crossed.filter(|[a, b]| {
                (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            });
            assert_eq!(outline.has(point), crossed.count() % 2 == 1);
            let half = random();
            let centre = outline.classify(point, [half; 2]);
            for at in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [0.3, 1.0]] {
                let inside = outline.has([x + at[0] * half * 0.999, y + at[1] * half * 0.999]);
                assert!(centre == BoxState::Mixed || centre == BoxState::uniform(inside));
            }
        }
    }

    #[test]
    fn rings_are_directed() {
        let square = |least: f64, most: f64| vec![[least, least], [least, most], [most, most], [most, least]];
        let outline = Outline::new(vec![square(3.0, 4.0), square(0.0, 9.0), square(1.0, 8.0)]);
        let mut directed: Vec<_> =
            outline.directed().into_iter().map(|ring| (ring.points[0], ring)).collect();
        directed.sort_by(|(a, _), (b, _)| a[1].total_cmp(&b[1]));
        let holes: Vec<bool> = directed.iter().map(|(_, ring)| ring.hole_in.is_some()).collect();
        assert_eq!(holes, [false, true, false]);
        assert!(!outline.has([2.0, 2.0]) && outline.has([3.5, 3.5]) && outline.has([0.5, 5.0]));
        for (_, ring) in directed {
            assert_eq!(Ring::new(ring.points).is_clockwise(), ring.hole_in.is_some());
        }
    }
}
