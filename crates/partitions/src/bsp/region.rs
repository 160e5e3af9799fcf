//! Convex regions of space: the cells of a BSP tree.

use spinney_base::space::Dimension;
use spinney_brep::{ExactPlane, ExactPoint, MAX_BITS};

use super::facet::{Edge, Facet, sides};

/// Convex region of space, as the facets around it, all with the same orientation seen from
/// outside. (A region of the plane is a prism of height 1 over it.)
#[derive(Clone, Debug)]
pub(super) struct Region {
    facets: Vec<Facet>,
}

impl Region {
    /// Domain of trees: the grid, and one more grid unit on every side.
    pub(super) fn space(dimension: Dimension) -> Region {
        let far = 1 << MAX_BITS;
        let ([low, high], z) = ([-1, far], if dimension == Dimension::Quad { [0, 1] } else { [-1, far] });
        Region::of_box([low, low, z[0]], [high, high, z[1]])
    }

    /// Box with the given corners.
    pub(super) fn of_box(min: [i32; 3], max: [i32; 3]) -> Region {
        let ends = [min, max];
        let plane = |axis: usize, end: usize| {
            let mut normal = [0; 3];
            normal[axis] = 1;
            ExactPlane::through(ends[end], normal)
        };
        let facet = |axis: usize, end: usize| {
            let (u, v) =
                if end == 1 { ((axis + 1) % 3, (axis + 2) % 3) } else { ((axis + 2) % 3, (axis + 1) % 3) };
            // Each edge starts on the wall of the edge before it.
            let walls = [(u, 0), (v, 0), (u, 1), (v, 1)];
            let edges = [3, 0, 1, 2].into_iter().zip(walls).map(|(before, wall)| {
                let mut start = [0; 3];
                for (axis, end) in [(axis, end), walls[before], wall] {
                    start[axis] = ends[end][axis];
                }
                (start, plane(wall.0, wall.1))
            });
            Facet::of_grid(plane(axis, end), &edges.collect::<Vec<_>>())
        };
        Region { facets: (0..6).map(|side| facet(side / 2, side % 2)).collect() }
    }

    /// Whether the region extends to the back of a plane and to its front.
    pub(super) fn sides(&self, by: &ExactPlane) -> [bool; 2] {
        let mut found = [false; 2];
        for edge in self.facets.iter().flat_map(|facet| &facet.edges) {
            match by.side(&edge.start) {
                0 => {}
                side => found[usize::from(side > 0)] = true,
            }
            if found == [true; 2] {
                break;
            }
        }
        found
    }

    /// Cuts the region. Returns its fragments at the back and in front of the plane, and the
    /// section between them.
    pub(super) fn cut(self, by: &ExactPlane) -> ([Region; 2], Facet) {
        let mut parts = [const { Vec::new() }; 2];
        // Edges of the section and their ends, oriented as seen from the fragment in front, which
        // has each edge reversed.
        let mut around: Vec<(Edge, ExactPoint)> = Vec::new();
        let mut add = |facet: &Facet, edge: usize| {
            let (from, to) = (facet.edges[edge].start, facet.edges[(edge + 1) % facet.edges.len()].start);
            around.push((Edge { wall: facet.plane, start: to, side: None }, from));
        };
        for facet in self.facets {
            let signs = facet.signs(by);
            match sides(&signs) {
                [true, true] => {
                    let [back, front] = facet.cut(by, &signs);
                    add(&front, front.edges.iter().position(|edge| edge.wall == *by).unwrap_or(0));
                    parts[0].push(back);
                    parts[1].push(front);
                }
                [_, false] => parts[0].push(facet),
                [false, true] => {
                    let next = |i: usize| signs[(i + 1) % signs.len()];
                    if let Some(edge) = (0..signs.len()).find(|i| signs[*i] == 0 && next(*i) == 0) {
                        add(&facet, edge);
                    }
                    parts[1].push(facet);
                }
            }
        }
        let section = Facet { plane: *by, edges: chained(around) };
        let turned = (0..section.edges.len()).rev().map(|i| {
            let before = (i + section.edges.len() - 1) % section.edges.len();
            Edge { wall: section.edges[before].wall, start: section.edges[i].start, side: None }
        });
        parts[0].push(Facet { plane: *by, edges: turned.collect() });
        parts[1].push(section.clone());
        (parts.map(|facets| Region { facets }), section)
    }
}

/// Sorts the edges so that each starts where the one before it ends.
fn chained(mut around: Vec<(Edge, ExactPoint)>) -> Vec<Edge> {
    let mut edges = Vec::with_capacity(around.len());
    let mut next = around.pop();
    while let Some((edge, end)) = next {
        edges.push(edge);
        next = around.iter().position(|(edge, _)| edge.start.is(&end)).map(|found| around.swap_remove(found));
    }
    debug_assert!(around.is_empty() && edges.len() > 2);
    edges
}

#[cfg(test)]
impl Region {
    /// Volume: sum of tetrahedra from the origin to triangles of the facets, which are
    /// counterclockwise seen from outside.
    pub(super) fn volume(&self) -> f64 {
        let mut sum = 0.0;
        for facet in &self.facets {
            let corner = |i: usize| facet.edges[i].start.near;
            for i in 2..facet.edges.len() {
                let ([a, b, c], [d, e, f], [g, h, i]) = (corner(0), corner(i - 1), corner(i));
                sum += (a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)) / 6.0;
            }
        }
        sum
    }

    /// Euler characteristic: vertices - edges + facets.
    pub(super) fn euler(&self) -> i64 {
        let mut corners: Vec<ExactPoint> = Vec::new();
        for corner in self.facets.iter().flat_map(|facet| &facet.edges).map(|edge| edge.start) {
            if !corners.iter().any(|known| known.is(&corner)) {
                corners.push(corner);
            }
        }
        let edges: usize = self.facets.iter().map(|facet| facet.edges.len()).sum();
        corners.len() as i64 - edges as i64 / 2 + self.facets.len() as i64
    }
}
