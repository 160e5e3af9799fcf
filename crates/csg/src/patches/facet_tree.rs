//! Tests of points and boxes against the facets of a shell, by a tree of boxes.

use super::facetting::Facets;
use super::patch::Point;
use crate::box_state::BoxState;

/// Maximum number of facets in a leaf of the tree.
const LEAF: usize = 4;

/// A node: a box around the facets of a range. The first child of a node that is no leaf is the
/// next node.
#[derive(Clone, Debug)]
struct Node {
    low: Point,
    high: Point,
    range: [u32; 2],
    /// The second child; 0 for a leaf.
    second: u32,
}

/// Facets of a closed surface in a tree of boxes.
#[derive(Clone, Debug, Default)]
pub(crate) struct FacetTree {
    facets: Vec<[Point; 3]>,
    nodes: Vec<Node>,
}

/// Returns the box around points.
fn hull<'a>(points: impl Iterator<Item = &'a Point>) -> [Point; 2] {
    points.fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], point| {
        [[0, 1, 2].map(|axis| low[axis].min(point[axis])), [0, 1, 2].map(|axis| high[axis].max(point[axis]))]
    })
}

impl FacetTree {
    pub(crate) fn of(facets: &Facets) -> FacetTree {
        let corners = |triangle: &[u32; 3]| triangle.map(|vertex| facets.vertices[vertex as usize]);
        let mut tree =
            FacetTree { facets: facets.triangles.iter().map(corners).collect(), nodes: Vec::new() };
        if !tree.facets.is_empty() {
            tree.node(0, tree.facets.len());
        }
        tree
    }

    /// Adds the node of a range of facets, and all below it: half of the facets in each child.
    fn node(&mut self, first: usize, end: usize) {
        let number = self.nodes.len();
        let [low, high] = hull(self.facets[first..end].iter().flatten());
        self.nodes.push(Node { low, high, range: [first as u32, end as u32], second: 0 });
        if end - first <= LEAF {
            return;
        }
        let longest = (1..3).fold(0, |longest, axis| {
            if high[axis] - low[axis] > high[longest] - low[longest] { axis } else { longest }
        });
        let middle = |facet: &[Point; 3]| facet.iter().map(|point| point[longest]).sum::<f64>();
        let half = (end - first) / 2;
        self.facets[first..end].select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
        self.node(first, first + half);
        self.nodes[number].second = self.nodes.len() as u32;
        self.node(first + half, end);
    }

    /// Visits the facets of leaves whose box passes a test, until `visit` returns true. Returns
    /// whether it did.
    fn find(
        &self,
        meets: &dyn Fn(&Point, &Point) -> bool,
        visit: &mut dyn FnMut(&[Point; 3]) -> bool,
    ) -> bool {
        let mut stack = Vec::from_iter((!self.nodes.is_empty()).then_some(0));
        while let Some(number) = stack.pop() {
            let Node { low, high, range: [first, end], second } = &self.nodes[number as usize];
            if !meets(low, high) {
                continue;
            }
            if *second > 0 {
                stack.extend([*second, number + 1]);
            } else if self.facets[*first as usize..*end as usize].iter().any(&mut *visit) {
                return true;
            }
        }
        false
    }

    /// Whether a point is inside: a ray from it along z meets an odd number of facets.
    pub(crate) fn has(&self, point: Point) -> bool {
        let [x, y, z] = point;
        let mut is_inside = false;
        self.find(
            &|low, high| low[0] <= x && x <= high[0] && low[1] <= y && y <= high[1] && z < high[2],
            &mut |facet| {
                is_inside ^= is_below(point, facet);
                false
            },
        );
        is_inside
    }

    /// Classifies a box, given by its centre and half widths.
    pub(crate) fn classify(&self, centre: Point, half: Point) -> BoxState {
        let meets = |low: &Point, high: &Point| {
            (0..3)
                .all(|axis| low[axis] <= centre[axis] + half[axis] && centre[axis] - half[axis] <= high[axis])
        };
        let is_near = self.find(&meets, &mut |facet| {
            let [low, high] = hull(facet.iter());
            meets(&low, &high)
        });
        if is_near { BoxState::Mixed } else { BoxState::uniform(self.has(centre)) }
    }
}

/// Whether a ray from a point along z meets a facet. Each edge is evaluated in one direction, so
/// that a ray through an edge meets exactly one of the two facets there.
fn is_below([x, y, z]: Point, facet: &[Point; 3]) -> bool {
    // The edges that cross the line of constant y: their x and z.
    let mut crossings = [None; 3];
    for (index, crossing) in crossings.iter_mut().enumerate() {
        let [mut from, mut to] = [facet[index], facet[(index + 1) % 3]];
        if [from[1], from[0], from[2]] > [to[1], to[0], to[2]] {
            (from, to) = (to, from);
        }
        if from[1] <= y && y < to[1] {
            let share = (y - from[1]) / (to[1] - from[1]);
            *crossing = Some([0, 2].map(|axis| from[axis] + share * (to[axis] - from[axis])));
        }
    }
    let mut crossings = crossings.into_iter().flatten();
    let (Some(one), Some(other)) = (crossings.next(), crossings.next()) else { return false };
    let [[low, low_z], [high, high_z]] = if one[0] <= other[0] { [one, other] } else { [other, one] };
    low <= x && x < high && z < low_z + (x - low) / (high - low) * (high_z - low_z)
}
