//! A patch: the triangles of one object in a group, with numbered vertices, and its boundary.

use std::collections::{BTreeMap, HashMap};

use super::triangles::Triangle;
use crate::exact::union_find::UnionFind;
use crate::hash::Hasher;
use spinney_base::sort;

/// Triangles with numbered vertices. Vertices with the same position and different colours or parts
/// are different.
pub(super) struct Patch {
    vertices: Vec<Vertex>,
    /// Number of each vertex' position.
    positions: Vec<u32>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Position, colour and part.
type Vertex = ([i32; 3], [u8; 3], u32);

/// Directed edges that do not cancel: number of the smaller and the larger end, and the surplus of
/// the direction from the smaller to the larger end.
pub(super) type Boundary = Vec<(u32, u32, i32)>;

impl Patch {
    pub(super) fn of(triangles: &[Triangle]) -> Patch {
        let mut patch = Patch {
            vertices: Vec::with_capacity(triangles.len()),
            positions: Vec::with_capacity(triangles.len()),
            triangles: Vec::with_capacity(triangles.len()),
        };
        let mut known: HashMap<Vertex, u32, Hasher> = HashMap::default();
        let mut known_positions: HashMap<[i32; 3], u32, Hasher> = HashMap::default();
        for triangle in triangles {
            let corners = [0, 1, 2].map(|corner| {
                let vertex = (triangle.points[corner], triangle.colours[corner], triangle.part);
                *known.entry(vertex).or_insert_with(|| {
                    let next = known_positions.len() as u32;
                    patch.positions.push(*known_positions.entry(vertex.0).or_insert(next));
                    patch.vertices.push(vertex);
                    patch.vertices.len() as u32 - 1
                })
            });
            patch.triangles.push(corners);
        }
        patch
    }

    /// Returns the position of each vertex.
    pub(super) fn points(&self) -> Vec<[i32; 3]> {
        self.vertices.iter().map(|vertex| vertex.0).collect()
    }

    /// Returns the number of a vertex' position.
    pub(super) fn position(&self, vertex: u32) -> u32 {
        self.positions[vertex as usize]
    }

    /// Returns all positions in the order of their numbers.
    pub(super) fn each_position(&self) -> impl Iterator<Item = [i32; 3]> {
        let mut next = 0;
        self.vertices.iter().zip(&self.positions).filter_map(move |(vertex, position)| {
            // (Numbers ascend in the order of their first vertices.)
            let is_new = *position == next;
            next += u32::from(is_new);
            is_new.then_some(vertex.0)
        })
    }

    /// Returns the triangles of each set that shares no vertex position with others; `None` if all
    /// are connected.
    pub(super) fn components(&self) -> Option<Vec<Vec<u32>>> {
        let mut sets = UnionFind::new(self.positions.iter().max().map_or(0, |last| *last as usize + 1));
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
            sets.join(a, b);
            sets.join(b, c);
        }
        let mut components: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (index, triangle) in (0..).zip(&self.triangles) {
            let root = sets.root(self.positions[triangle[0] as usize]);
            components.entry(root).or_default().push(index);
        }
        (components.len() > 1).then(|| components.into_values().collect())
    }

    /// Returns the sum of the directed edges of some triangles, in ascending order.
    pub(super) fn boundary(&self, triangles: &[[u32; 3]]) -> Boundary {
        let mut edges = Vec::with_capacity(3 * triangles.len());
        for triangle in triangles {
            let [a, b, c] = triangle.map(|vertex| u64::from(self.positions[vertex as usize]));
            for (from, to) in [(a, b), (b, c), (c, a)] {
                // (Numbers of positions are below 2^31.)
                edges.push(from.min(to) << 32 | from.max(to) << 1 | u64::from(from > to));
            }
        }
        sort::numbers64(&mut edges);
        let mut boundary: Boundary = Vec::new();
        for edge in edges {
            let (low, high) = ((edge >> 32) as u32, (edge as u32) >> 1);
            let sign = 1 - 2 * (edge & 1) as i32;
            match boundary.last_mut() {
                Some(last) if (last.0, last.1) == (low, high) => last.2 += sign,
                last => {
                    if last.is_some_and(|last| last.2 == 0) {
                        boundary.pop();
                    }
                    boundary.push((low, high, sign));
                }
            }
        }
        if boundary.last().is_some_and(|last| last.2 == 0) {
            boundary.pop();
        }
        // (An edge whose ends are the same position cancels itself.)
        boundary.retain(|(low, high, _)| low != high);
        boundary
    }

    /// Returns whether each vertex is at an edge of the boundary.
    pub(super) fn locked(&self, boundary: &Boundary) -> Vec<bool> {
        let mut is_end = vec![false; self.vertices.len()];
        for (low, high, _) in boundary {
            is_end[*low as usize] = true;
            is_end[*high as usize] = true;
        }
        self.positions.iter().map(|position| is_end[*position as usize]).collect()
    }

    /// Returns whether two corners of a triangle are at the same position.
    pub(super) fn is_folded(&self, triangle: &[u32; 3]) -> bool {
        let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
        a == b || b == c || c == a
    }

    /// Returns triangles with their vertices' positions, colours, and the part of the first vertex.
    pub(super) fn triangle(&self, corners: &[u32; 3]) -> Triangle {
        let vertices = corners.map(|vertex| self.vertices[vertex as usize]);
        Triangle {
            points: vertices.map(|vertex| vertex.0),
            colours: vertices.map(|vertex| vertex.1),
            part: vertices[0].2,
        }
    }

    /// Returns the signs of six times the volume between some triangles and the origin.
    pub(super) fn volume_sign(&self, triangles: &[[u32; 3]]) -> i32 {
        let origin = self.vertices[0].0.map(i128::from);
        let at = |vertex: u32| {
            let point = self.vertices[vertex as usize].0;
            [0, 1, 2].map(|axis| i128::from(point[axis]) - origin[axis])
        };
        let six = |[a, b, c]: [[i128; 3]; 3]| -> i128 {
            a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        triangles.iter().map(|triangle| six(triangle.map(at))).sum::<i128>().signum() as i32
    }
}
