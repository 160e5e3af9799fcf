//! Lids: triangles that close the holes of a surface.
//!
//! With its lids a surface is closed, so its winding numbers are whole, and crossings tell them exactly. The
//! winding field of the surface alone is that number less the field of the lids, which are few and small where holes
//! are.

use std::collections::HashMap;

use super::grid::Triangle;

/// The part of triangles that are lids; parts of models are numbered from 1.
pub(super) const LID: u32 = 0;

/// A surface's lids and the edges of its holes.
#[derive(Debug, Default)]
pub(super) struct Lids {
    pub(super) triangles: Vec<Triangle>,
    /// The edges that are the surface's boundary.
    pub(super) edges: Vec<[[i32; 3]; 2]>,
}

impl Lids {
    /// The lids of these triangles. Each hole is closed by cutting its rim in halves again and again, so that large lids
    /// are in its middle and small ones at the rim.
    pub(super) fn of(triangles: &[Triangle]) -> Lids {
        let mut lids = Lids::default();
        for rim in rims(boundary(triangles)) {
            let from = lids.triangles.len();
            let corner = |corners| Triangle { corners, attribute: 0, part: LID };
            let mut open = vec![(0, rim.len() - 1)];
            while let Some((first, last)) = open.pop() {
                if last - first < 2 {
                    continue;
                }
                let middle = first.midpoint(last);
                let lid = corner([rim[first], rim[middle], rim[last]]);
                if lid.normal() != [0; 3] {
                    lids.triangles.push(lid);
                }
                open.extend([(first, middle), (middle, last)]);
            }
            // A rim along one line is no hole: triangles without area were there.
            if lids.triangles.len() > from {
                lids.edges.extend((0..rim.len()).map(|at| [rim[at], rim[(at + 1) % rim.len()]]));
            }
        }
        lids
    }
}

/// The edges that triangles have more often in one direction than in the other, turned round: as the lids have them;
/// each as often as it takes, in order.
fn boundary(triangles: &[Triangle]) -> Vec<[[i32; 3]; 2]> {
    let mut edges: Vec<([[i32; 3]; 2], i32)> = Vec::with_capacity(3 * triangles.len());
    for triangle in triangles {
        let [a, b, c] = triangle.corners;
        let turned = [[a, b], [b, c], [c, a]]
            .map(|[from, to]| if from < to { ([from, to], 1) } else { ([to, from], -1) });
        edges.extend(turned);
    }
    edges.sort_unstable();
    let mut boundary = Vec::new();
    for same in edges.chunk_by(|a, b| a.0 == b.0) {
        let [low, high] = same[0].0;
        let sum: i32 = same.iter().map(|(_, way)| way).sum();
        let edge = if sum > 0 { [high, low] } else { [low, high] };
        boundary.extend((0..sum.unsigned_abs()).map(|_| edge));
    }
    boundary.sort_unstable();
    boundary
}

/// The rims that edges make up, each a ring of different points. As many edges end in a point as begin there, so
/// that every way comes back to where it was.
fn rims(edges: Vec<[[i32; 3]; 2]>) -> Vec<Vec<[i32; 3]>> {
    let mut rims = Vec::new();
    // Where the next edge from a point is that was not taken.
    let mut next: HashMap<[i32; 3], usize> = HashMap::new();
    for (number, edge) in edges.iter().enumerate().rev() {
        next.insert(edge[0], number);
    }
    let mut way: Vec<[i32; 3]> = Vec::new();
    let mut places: HashMap<[i32; 3], usize> = HashMap::new();
    for start in edges.iter().map(|edge| edge[0]) {
        let mut point = start;
        loop {
            // A point for the second time closes a ring, which is taken off the way.
            if let Some(place) = places.get(&point) {
                let ring = way.split_off(*place);
                for point in &ring {
                    places.remove(point);
                }
                if ring.len() > 2 {
                    rims.push(ring);
                }
            }
            let number = next
                .get_mut(&point)
                .filter(|number| edges.get(**number).is_some_and(|edge| edge[0] == point));
            let Some(number) = number else { break };
            places.insert(point, way.len());
            way.push(point);
            point = edges[*number][1];
            *number += 1;
        }
        debug_assert!(way.is_empty());
    }
    rims
}

#[cfg(test)]
mod tests {
    use super::super::closure::Closure;
    use super::*;

    fn triangle(corners: [[i32; 3]; 3]) -> Triangle {
        Triangle { corners, attribute: 0, part: 1 }
    }

    #[test]
    fn what_has_lids_is_closed() {
        // Loose triangles with random corners, some of which they share.
        let mut state = 1u64;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % below
        };
        for count in [1, 2, 5, 40, 300] {
            let points: Vec<[i32; 3]> = (0..count + 2).map(|_| [0; 3].map(|_| random(1000) as i32)).collect();
            let triangles: Vec<Triangle> = (0..count)
                .map(|_| triangle([0; 3].map(|_| points[random(points.len() as u64) as usize])))
                .filter(|triangle| triangle.normal() != [0; 3])
                .collect();
            let lids = Lids::of(&triangles);
            let mut closure = Closure::default();
            triangles.iter().chain(&lids.triangles).for_each(|triangle| closure.add(triangle.corners));
            assert!(closure.is_closed(), "{count}");
            let mut edges = lids.edges.clone();
            edges.sort_unstable();
            assert_eq!(edges, boundary(&triangles));
        }
    }

    #[test]
    fn holes_have_lids_of_their_own() {
        let [a, b, c, d] = [[0, 0, 0], [90, 0, 0], [0, 90, 0], [0, 0, 90]];
        let closed = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]].map(triangle);
        assert!(Lids::of(&closed).triangles.is_empty());
        let lids = Lids::of(&closed[1..]);
        assert_eq!((lids.triangles.len(), lids.edges.len()), (1, 3));
        assert_eq!(lids.triangles[0].normal(), closed[0].normal());
        // Two triangles that share one corner are two holes.
        let lids = Lids::of(&[triangle([a, b, c]), triangle([a, [-5, 3, 9], [-9, 2, 2]])]);
        assert_eq!((lids.triangles.len(), lids.edges.len()), (2, 6));
        // A corner on an edge, which a triangle without area would join: no hole.
        let middle = [45, 0, 0];
        let split = [[a, c, middle], [c, b, middle], [a, b, d], [b, c, d], [c, a, d]].map(triangle);
        let lids = Lids::of(&split);
        assert!(lids.triangles.is_empty() && lids.edges.is_empty());
    }
}
