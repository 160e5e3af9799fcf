//! Seams: edges of a surface that have no counterpart. They are closed by faces with no area, or
//! almost none.
//!
//! Where a vertex of one face lies on an edge of another, a surface is closed as a point set, but
//! not edge by edge. Models have faces without area there. Such faces have no sides, so a set
//! operation cannot determine their fate. They are left out, and made again where the result needs
//! them.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::closure::edges;
use crate::exact::vector::{cross, dot, subtract};
use crate::planar::PlanarFaces;
use crate::{Face, FaceList, Faces};
use spinney_base::{Progress, Result, sort};

/// An edge; if undirected, the lesser end comes first.
type Edge = [[i32; 3]; 2];

/// Count of an undirected edge, and a face that has it.
#[derive(Clone, Copy, Debug, Default)]
struct Seam {
    /// How often it occurs in its direction, minus how often in the opposite one.
    surplus: i32,
    /// Part and source of a face that has it.
    part: u32,
    source: u64,
    /// Whether the edge is kept when its count is 0.
    is_watched: bool,
}

/// Edges of a surface without a counterpart so far, and watched edges.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seams(HashMap<Edge, Seam>);

impl Seams {
    /// Watches the open edges of other seams.
    pub(crate) fn watch(&mut self, open: Seams) {
        let open = open.0.into_iter();
        self.0.extend(open.map(|(edge, seam)| (edge, Seam { surplus: 0, is_watched: true, ..seam })));
    }

    /// Returns the memory use in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        // (A hash table is half empty after it has grown.)
        (2 * self.0.len() * (size_of::<(Edge, Seam)>() + 1)) as u64
    }

    /// Counts the edges of all faces of a list.
    ///
    /// # Errors
    /// On cancellation.
    pub(crate) fn add_all(&mut self, faces: &FaceList, progress: &dyn Progress) -> Result<()> {
        for number in 0..faces.len() as usize {
            if number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            self.add(&faces.get(number));
        }
        Ok(())
    }

    /// Counts the edges of a face.
    pub(crate) fn add(&mut self, face: &Face<'_>) {
        for [from, to] in edges(face) {
            let (edge, way) = undirected([from, to]);
            let new = Seam { part: face.part, source: face.source, ..Seam::default() };
            let seam = self.0.entry(edge).or_insert(new);
            seam.surplus += way;
            if seam.surplus == 0 && !seam.is_watched {
                self.0.remove(&edge);
            }
        }
    }

    /// Whether the same edges are open in both, equally often.
    pub(crate) fn has_same_open_edges(&self, other: &Seams) -> bool {
        self.0.len() == other.0.len()
            && self
                .0
                .iter()
                .all(|(edge, seam)| other.0.get(edge).is_some_and(|own| own.surplus == seam.surplus))
    }

    /// Returns the ends of all edges that are open or watched.
    pub(crate) fn ends(&self) -> HashSet<[i32; 3]> {
        self.0.keys().flatten().copied().collect()
    }

    /// Counts the edges of a face that are open or watched.
    pub(crate) fn add_watched(&mut self, face: &Face<'_>) {
        if self.0.is_empty() {
            return;
        }
        for ends in edges(face) {
            let (edge, way) = undirected(ends);
            if let Some(seam) = self.0.get_mut(&edge) {
                seam.surplus += way;
            }
        }
    }

    /// Yields faces that have the missing edges. Faces wider than `width` grid units are left out:
    /// a surface that lacks these is not closed.
    pub(crate) fn close(
        self,
        width: u8,
        is_coloured: bool,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        // Missing directed edges, by their starts.
        let mut ways: BTreeMap<[i32; 3], Vec<([i32; 3], Seam)>> = BTreeMap::new();
        for (edge, seam) in self.0 {
            let [from, to] = if seam.surplus > 0 { [edge[1], edge[0]] } else { edge };
            let copies = seam.surplus.unsigned_abs() as usize;
            ways.entry(from).or_default().extend(std::iter::repeat_n((to, seam), copies));
        }
        ways.values_mut().for_each(|ways| sort::by_wide_key(ways, |(to, _)| !sort::point_key(*to)));
        let mut planar = PlanarFaces::default();
        planar.is_coloured = is_coloured;
        let mut path: Vec<([i32; 3], Seam)> = Vec::new();
        let mut positions: HashMap<[i32; 3], usize> = HashMap::new();
        while let Some(first) = ways.first_entry() {
            let mut at = *first.key();
            if first.get().is_empty() {
                first.remove();
                continue;
            }
            path.clear();
            positions.clear();
            // Invariant: as many missing edges start at a point as end there, since all counted
            // edges are of rings: of all rings of the list's faces; and of settled faces, the
            // watched edges, since their other edges cancel. So a path ends where it started, and a
            // repeated point completes a ring. If the surface is not closed, the rest of a path
            // stays open.
            while let Some((to, seam)) = ways.get_mut(&at).and_then(Vec::pop) {
                positions.insert(at, path.len());
                path.push((at, seam));
                at = to;
                if let Some(start) = positions.get(&to).copied() {
                    let ring: Vec<[i32; 3]> = path[start..].iter().map(|(from, _)| *from).collect();
                    let Seam { part, source, .. } = path[start].1;
                    path.truncate(start);
                    ring.iter().for_each(|from| {
                        positions.remove(from);
                    });
                    // (Several faces, if the ring is bent.)
                    for points in thin_faces(ring, width) {
                        let colours = vec![[255; 3]; if is_coloured { points.len() } else { 0 }];
                        let ring_ends = [points.len()];
                        let (points, colours) = (&points[..], &colours[..]);
                        let face = Face { number: 0, points, ring_ends: &ring_ends, colours, part, source };
                        planar.face(&face, each)?;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Returns an edge with the lesser end first, and 1 if that is its direction, otherwise -1.
fn undirected([from, to]: Edge) -> (Edge, i32) {
    if from < to { ([from, to], 1) } else { ([to, from], -1) }
}

/// Returns faces that close a ring: itself if it is straight and thin, triangles if it is bent and
/// thin, otherwise none. (Most rings are straight: an edge and the vertices on it, of any number.)
fn thin_faces(ring: Vec<[i32; 3]>, width: u8) -> Vec<Vec<[i32; 3]>> {
    if is_thin(&ring, width) {
        return vec![ring];
    }
    bent_faces(ring, width).unwrap_or_default()
}

/// Returns triangles that close a ring, if their area is at most that of a strip of this width,
/// half as long as the ring. Cuts off the corner with the smallest area until none is left.
///
/// Invariant: the edges that are cut off cancel, so the triangles have the ring's edges, whatever
/// its shape. Rounding opens a ring where it moves the vertices of two neighbours differently: as
/// wide as it moves them, along their common edges, which turn. A wider ring is a hole of the
/// surface. It stays open, so that the surface is refused: a face over it would be a guess.
fn bent_faces(mut ring: Vec<[i32; 3]>, width: u8) -> Option<Vec<Vec<[i32; 3]>>> {
    /// Maximum number of vertices; the time is quadratic.
    const MOST: usize = 1 << 8;
    if ring.len() > MOST {
        return None;
    }
    let minus = |a: [i32; 3], b: [i32; 3]| subtract(a.map(f64::from), b.map(f64::from));
    let length = |along: [f64; 3]| dot(along, along).sqrt();
    let around = |i: usize, count: usize| [(i + count - 1) % count, i, (i + 1) % count];
    let perimeter: f64 = (0..ring.len()).map(|i| length(minus(ring[(i + 1) % ring.len()], ring[i]))).sum();
    let (mut faces, mut area) = (Vec::new(), 0.0);
    while ring.len() > 2 {
        let own = |i: usize| {
            let [a, b, c] = around(i, ring.len()).map(|at| ring[at]);
            length(cross(minus(b, a), minus(c, a))) / 2.0
        };
        let least = (0..ring.len()).min_by(|a, b| own(*a).total_cmp(&own(*b)))?;
        area += own(least);
        faces.push(around(least, ring.len()).map(|at| ring[at]).to_vec());
        ring.remove(least);
    }
    (area <= f64::from(width) * perimeter / 2.0).then_some(faces)
}

/// Whether all vertices of a ring are within `width` grid units of the line through its two ends,
/// the vertices that are farthest apart.
fn is_thin(ring: &[[i32; 3]], width: u8) -> bool {
    let minus = |a: [i32; 3], b: [i32; 3]| subtract(a.map(i128::from), b.map(i128::from));
    let furthest = |from: [i32; 3]| {
        let distance = |at: &&[i32; 3]| {
            let way = minus(**at, from);
            dot(way, way)
        };
        ring.iter().max_by_key(distance).copied().unwrap_or(from)
    };
    // (In a thin ring, the vertex farthest from any point is an end.)
    let from = furthest(ring[0]);
    let along = minus(furthest(from), from);
    let length = dot(along, along);
    ring.iter().all(|at| {
        let there = minus(*at, from);
        let projection = dot(there, along);
        // Squared distance from the line, times the line's squared length.
        dot(there, there) * length - projection * projection <= i128::from(width).pow(2) * length
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face(points: &[[i32; 3]]) -> Face<'_> {
        Face { number: 0, points, ring_ends: &[3], colours: &[], part: 3, source: 7 }
    }

    fn closed(seams: Seams) -> Vec<Vec<[i32; 3]>> {
        let mut found = Vec::new();
        seams
            .close(1, false, &mut |face| {
                assert_eq!((face.part, face.source), (3, 7));
                found.push(face.points.to_vec());
                Ok(())
            })
            .unwrap();
        found
    }

    /// A tetrahedron, one face of which is cut at a vertex on another face's edge.
    #[test]
    fn vertices_on_edges_are_closed() {
        let [a, b, c, d, on] = [[0, 0, 0], [8, 0, 0], [0, 8, 0], [0, 0, 8], [3, 0, 0]];
        let whole = [[a, c, b], [a, b, d], [a, d, c], [b, c, d]];
        let mut seams = Seams::default();
        whole.iter().for_each(|points| seams.add(&face(points)));
        assert!(closed(seams).is_empty());
        let cut = [[a, c, b], [a, on, d], [on, b, d], [a, d, c], [b, c, d]];
        let mut seams = Seams::default();
        cut.iter().for_each(|points| seams.add(&face(points)));
        let found = closed(seams);
        assert_eq!(found, [[a, b, on]]);
        // The same with three settled faces: the zero-area face is among the near ones.
        let mut near = Seams::default();
        [cut[1], cut[2], [a, b, on]].iter().for_each(|points| near.add(&face(points)));
        let mut seams = Seams::default();
        seams.watch(near);
        cut[1..3].iter().for_each(|points| seams.add(&face(points)));
        for points in [cut[0], cut[3], cut[4]] {
            seams.add_watched(&face(&points));
        }
        assert_eq!(closed(seams), [[a, b, on]]);
    }

    /// A thin ring around a corner is closed by thin triangles, whose other edges cancel.
    #[test]
    fn bent_rings_are_closed() {
        let ring = [[0, 0, 0], [80, 1, 0], [60, 90, 0], [81, 2, 0], [81, 1, 0]];
        assert!(!is_thin(&ring, 3));
        let faces = thin_faces(ring.to_vec(), 3);
        let mut left = Seams::default();
        left.add(&Face { ring_ends: &[5], ..face(&ring) });
        for points in &faces {
            assert!(points.len() == 3 && is_thin(points, 3), "{points:?}");
            let turned: Vec<[i32; 3]> = points.iter().rev().copied().collect();
            left.add(&face(&turned));
        }
        assert!(left.0.is_empty() && faces.len() == 3, "{faces:?}");
        assert!(thin_faces([[0, 0, 0], [80, 1, 0], [60, 90, 0], [90, 60, 0]].to_vec(), 3).is_empty());
    }

    #[test]
    fn holes_stay_open() {
        let [a, b, c, d] = [[0, 0, 0], [8, 0, 0], [0, 8, 0], [0, 0, 8]];
        let mut seams = Seams::default();
        for points in [[a, c, b], [a, b, d], [a, d, c]] {
            seams.add(&face(&points));
        }
        assert!(closed(seams).is_empty());
        assert!(
            is_thin(&[a, b, [4, 1, 0]], 1)
                && !is_thin(&[a, b, [4, 1, 1]], 1)
                && is_thin(&[a, b, [4, 1, 1]], 2)
        );
    }
}
