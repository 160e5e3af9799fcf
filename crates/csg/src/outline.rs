//! Outlines in a plane: rings, of which an odd number goes around what is inside.

use std::cell::Cell;

use crate::place::Place;
use spinney_base::space::{Dimension, morton_encode};

/// Children of a node of a tree of boxes, and things in one on the lowest level.
const FAN_OUT: usize = 8;

/// A point in a plane.
pub(crate) type Point = [f64; 2];

/// Rings in a plane. Inside is what an odd number of them goes around, so that a ring within another one is a hole.
#[derive(Clone, Debug)]
pub(crate) struct Outline {
    /// In such an order that near ones are mostly near each other.
    pub(crate) rings: Vec<Ring>,
    boxes: Boxes,
}

/// A ring.
#[derive(Clone, Debug)]
pub(crate) struct Ring {
    /// Its corners, without the first one once more.
    pub(crate) points: Vec<Point>,
    /// Boxes around its edges.
    boxes: Boxes,
}

/// A ring of a face.
pub(crate) struct DirectedRing {
    /// Its corners: counterclockwise around a face, clockwise around a hole.
    pub(crate) points: Vec<Point>,
    /// Of a hole, the number of the ring that it is in.
    pub(crate) hole_in: Option<usize>,
}

/// The box around a run of edges, and the heights at which the run begins and ends.
#[derive(Clone, Copy, Debug)]
struct Run {
    min: Point,
    max: Point,
    ends: [f64; 2],
}

impl Run {
    fn edge([a, b]: [Point; 2]) -> Run {
        Run {
            min: [a[0].min(b[0]), a[1].min(b[1])],
            max: [a[0].max(b[0]), a[1].max(b[1])],
            ends: [a[1], b[1]],
        }
    }

    fn joined(self, next: Run) -> Run {
        Run {
            min: [0, 1].map(|axis| self.min[axis].min(next.min[axis])),
            max: [0, 1].map(|axis| self.max[axis].max(next.max[axis])),
            ends: [self.ends[0], next.ends[1]],
        }
    }

    /// Whether a box around a point reaches into it; widths are halves.
    fn meets(&self, centre: Point, half: Point) -> bool {
        (0..2).all(|axis| {
            self.min[axis] <= centre[axis] + half[axis] && self.max[axis] >= centre[axis] - half[axis]
        })
    }
}

/// Boxes around 8 things in a row, around 8 of these, and so on, up to the one of all.
#[derive(Clone, Debug)]
struct Boxes {
    levels: Vec<Vec<Run>>,
    count: usize,
}

impl Boxes {
    /// The boxes over one or more.
    fn over(things: &[Run]) -> Boxes {
        let join = |runs: &[Run]| -> Vec<Run> {
            let of = |runs: &[Run]| runs[1..].iter().fold(runs[0], |all, run| all.joined(*run));
            runs.chunks(FAN_OUT).map(of).collect()
        };
        let mut levels = vec![join(things)];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            levels.push(join(last));
        }
        Boxes { levels, count: things.len() }
    }

    /// The box around all.
    fn all(&self) -> Run {
        self.levels[self.levels.len() - 1][0]
    }

    /// Goes through the boxes that are entered, and the things in them by their numbers, until `take` says to stop.
    fn visit(&self, enter: &mut dyn FnMut(&Run) -> bool, take: &mut dyn FnMut(usize) -> bool) {
        // At most 7 of each of few levels wait.
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
    /// A ring of three corners or more.
    fn new(points: Vec<Point>) -> Ring {
        let edges: Vec<Run> = (0..points.len()).map(|edge| Run::edge(edge_of(&points, edge))).collect();
        let boxes = Boxes::over(&edges);
        Ring { points, boxes }
    }

    fn is_clockwise(&self) -> bool {
        let [x, y] = self.points[0];
        let next = self.points.iter().cycle().skip(1);
        // (From one of its corners, so that what is far away keeps its digits.)
        let twice = |(a, b): (&Point, &Point)| (a[0] - x) * (b[1] - y) - (b[0] - x) * (a[1] - y);
        self.points.iter().zip(next).map(twice).sum::<f64>() < 0.0
    }

    /// Whether the way from a point to the right crosses the ring an odd number of times.
    fn is_around(&self, [x, y]: Point) -> bool {
        let is_odd = Cell::new(false);
        self.boxes.visit(
            &mut |run| {
                if y < run.min[1] || y >= run.max[1] || x > run.max[0] {
                    return false;
                }
                if x < run.min[0] {
                    // All of it is on the right: where it begins and ends tells.
                    is_odd.set(is_odd.get() != ((run.ends[0] > y) != (run.ends[1] > y)));
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

    /// Whether an edge may pass through a box around a point; widths are halves.
    fn passes(&self, centre: Point, half: Point) -> bool {
        let mut passes = false;
        self.boxes.visit(&mut |run| run.meets(centre, half), &mut |edge| {
            let [a, b] = edge_of(&self.points, edge);
            let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
            let side = dx * (centre[1] - a[1]) - dy * (centre[0] - a[0]);
            // (Widths have room for rounding.)
            passes |= Run::edge([a, b]).meets(centre, half)
                && side.abs() <= dx.abs() * half[1] + dy.abs() * half[0];
            !passes
        });
        passes
    }
}

/// The ends of an edge.
fn edge_of(points: &[Point], edge: usize) -> [Point; 2] {
    [points[edge], points[if edge + 1 == points.len() { 0 } else { edge + 1 }]]
}

impl Outline {
    /// An outline of one or more rings of three corners or more.
    pub(crate) fn new(rings: Vec<Vec<Point>>) -> Outline {
        let mut rings: Vec<Ring> = rings.into_iter().map(Ring::new).collect();
        let around =
            |rings: &[Ring]| Boxes::over(&rings.iter().map(|ring| ring.boxes.all()).collect::<Vec<_>>());
        let all = around(&rings).all();
        rings.sort_by_cached_key(|ring| {
            let run = ring.boxes.all();
            let at = |axis: usize| {
                let share = (run.min[axis] - all.min[axis]) / (all.max[axis] - all.min[axis]);
                morton_encode(Dimension::Quad, (share * 65535.0) as u32)
            };
            at(0) | at(1) << 1
        });
        let boxes = around(&rings);
        Outline { rings, boxes }
    }

    /// The greatest coordinate, without its sign.
    pub(crate) fn magnitude(&self) -> f64 {
        let all = self.rings.iter().flat_map(|ring| &ring.points).flatten();
        all.fold(0.0, |most: f64, at| most.max(at.abs()))
    }

    /// Hands out the numbers of the rings that go around a point.
    fn around(&self, point: Point, take: &mut dyn FnMut(usize)) {
        self.boxes.visit(&mut |run| run.meets(point, [0.0; 2]), &mut |ring| {
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

    /// Whether all of a box is inside, or outside; widths are halves.
    pub(crate) fn place(&self, centre: Point, half: Point) -> Place {
        let mut passes = false;
        self.boxes.visit(&mut |run| run.meets(centre, half), &mut |ring| {
            passes = self.rings[ring].passes(centre, half);
            !passes
        });
        if passes { Place::Mixed } else { Place::uniform(self.has(centre)) }
    }

    /// The rings as those of faces. (Of rings that pass through each other, this says nothing.)
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

    /// Rings with many edges, with and without boxes over them.
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
            let centre = outline.place(point, [half; 2]);
            for at in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [0.3, 1.0]] {
                let inside = outline.has([x + at[0] * half * 0.999, y + at[1] * half * 0.999]);
                assert!(centre == Place::Mixed || centre == Place::uniform(inside));
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
