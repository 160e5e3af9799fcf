//! An outline for distance queries: a bounding volume hierarchy over its edges.

use robust::{Coord, orient2d};

/// Maximum number of edges in a leaf.
const LEAF: usize = 8;

type Point = [f64; 2];

/// Rings that do not cross, combined by the even-odd rule.
pub(super) struct Outline {
    sides: Vec<[Point; 2]>,
    /// Nodes in preorder.
    nodes: Vec<Node>,
}

/// A bounding box of some edges.
struct Node {
    min: Point,
    max: Point,
    /// The edges of a leaf; empty for an inner node, whose first child is the next node.
    sides: std::ops::Range<usize>,
    /// Index of the second child; 0 for a leaf.
    second: usize,
}

impl Node {
    /// Returns the squared distance from a position.
    fn squared_distance(&self, position: Point) -> f64 {
        let gap =
            |axis: usize| (self.min[axis] - position[axis]).max(position[axis] - self.max[axis]).max(0.0);
        gap(0).powi(2) + gap(1).powi(2)
    }
}

impl Outline {
    /// Creates an outline from rings that repeat their first vertices at the end.
    pub(super) fn new(rings: &[Vec<Point>]) -> Outline {
        let sides = rings.iter().flat_map(|ring| ring.windows(2)).map(|ends| [ends[0], ends[1]]);
        let mut outline = Outline { sides: sides.collect(), nodes: Vec::new() };
        outline.divide(0..outline.sides.len());
        outline
    }

    /// Adds the node of a range of edges, and all nodes below it.
    fn divide(&mut self, range: std::ops::Range<usize>) {
        let sides = &mut self.sides[range.clone()];
        let [min, max] = bounds(sides.iter().flatten());
        let mut node = Node { min, max, sides: range.clone(), second: 0 };
        let own = self.nodes.len();
        if sides.len() <= LEAF {
            self.nodes.push(node);
            return;
        }
        let axis = usize::from(node.max[1] - node.min[1] > node.max[0] - node.min[0]);
        let middle = sides.len() / 2;
        let centre = |side: &[Point; 2]| side[0][axis] + side[1][axis];
        sides.select_nth_unstable_by(middle, |a, b| centre(a).total_cmp(&centre(b)));
        node.sides = 0..0;
        self.nodes.push(node);
        self.divide(range.start..range.start + middle);
        self.nodes[own].second = self.nodes.len();
        self.divide(range.start + middle..range.end);
    }

    /// Returns the distance of a position from the outline: positive inside, negative outside.
    pub(super) fn signed_distance(&self, position: Point) -> f64 {
        let distance = self.distance(position);
        if self.has(position) { distance } else { -distance }
    }

    /// Returns the distance of a position from the nearest edge.
    fn distance(&self, position: Point) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut waiting = vec![(0.0, 0)];
        while let Some((least, number)) = waiting.pop() {
            if least >= nearest {
                continue;
            }
            let node = &self.nodes[number];
            for side in &self.sides[node.sides.clone()] {
                nearest = nearest.min(squared_distance(position, side));
            }
            if node.second > 0 {
                let [first, second] = [number + 1, node.second]
                    .map(|child| (self.nodes[child].squared_distance(position), child));
                let nearer_last = if first.0 <= second.0 { [second, first] } else { [first, second] };
                waiting.extend(nearer_last);
            }
        }
        nearest.sqrt()
    }

    /// Whether a position is inside: whether a ray from it along x crosses an odd number of edges.
    fn has(&self, [x, y]: Point) -> bool {
        let mut is_inside = false;
        let mut waiting = vec![0];
        while let Some(number) = waiting.pop() {
            let node = &self.nodes[number];
            if node.max[0] < x || y < node.min[1] || y > node.max[1] {
                continue;
            }
            for [from, to] in &self.sides[node.sides.clone()] {
                // (An edge includes its lower end, but not its upper one.)
                let [low, high] = if from[1] <= to[1] { [from, to] } else { [to, from] };
                is_inside ^= low[1] <= y && y < high[1] && is_left([x, y], *low, *high);
            }
            if node.second > 0 {
                waiting.extend([number + 1, node.second]);
            }
        }
        is_inside
    }
}

/// Returns the minimum and maximum coordinates of points.
pub(super) fn bounds<'a>(corners: impl Iterator<Item = &'a Point>) -> [Point; 2] {
    corners.fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[min, max], corner| {
        [[0, 1].map(|axis| corner[axis].min(min[axis])), [0, 1].map(|axis| corner[axis].max(max[axis]))]
    })
}

/// Returns the squared distance of a position from an edge.
fn squared_distance([x, y]: Point, [[from_x, from_y], [to_x, to_y]]: &[Point; 2]) -> f64 {
    let (along_x, along_y) = (to_x - from_x, to_y - from_y);
    let (own_x, own_y) = (x - from_x, y - from_y);
    let share = (own_x * along_x + own_y * along_y) / (along_x * along_x + along_y * along_y);
    // (Edges have a length. If its square underflows, the distance from the edge's end is used.)
    let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    (own_x - share * along_x).powi(2) + (own_y - share * along_y).powi(2)
}

/// Whether a position is to the left of an upward line.
fn is_left(position: Point, low: Point, high: Point) -> bool {
    let [low, high, position] = [low, high, position].map(|[x, y]| Coord { x, y });
    orient2d(low, high, position) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_all_sides() {
        let mut state = 5u64;
        let mut random = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / f64::from(1u32 << 24)
        };
        // A star with a hole.
        let ring = |count: u32, radius: &mut dyn FnMut() -> f64| -> Vec<Point> {
            let corner = |number: u32| {
                let angle = f64::from(number) / f64::from(count) * std::f64::consts::TAU;
                let radius = radius();
                [radius * angle.cos(), radius * angle.sin()]
            };
            let mut ring: Vec<Point> = (0..count).map(corner).collect();
            ring.push(ring[0]);
            ring
        };
        let rings = [ring(200, &mut || 5.0 + 3.0 * random()), ring(31, &mut || 2.0)];
        let outline = Outline::new(&rings);
        for _ in 0..2000 {
            let position = [random() * 20.0 - 10.0, random() * 20.0 - 10.0];
            let sides = || rings.iter().flat_map(|ring| ring.windows(2)).map(|ends| [ends[0], ends[1]]);
            let nearest = sides().map(|side| squared_distance(position, &side)).fold(f64::INFINITY, f64::min);
            assert_eq!(outline.distance(position), nearest.sqrt());
            let winding: f64 = sides()
                .map(|ends| {
                    let [from, to] = ends.map(|[x, y]| (y - position[1]).atan2(x - position[0]));
                    (to - from + 9.0 * std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                        - std::f64::consts::PI
                })
                .sum();
            let turns = (winding / std::f64::consts::TAU).round() as i32;
            assert_eq!(outline.has(position), turns % 2 != 0, "{position:?}");
            assert_eq!(outline.signed_distance(position) > 0.0, outline.has(position));
        }
        assert!(Outline::new(&rings[1..]).signed_distance([0.0; 2]) > 1.9);
    }
}
