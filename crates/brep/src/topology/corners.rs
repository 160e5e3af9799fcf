//! Rings of a face, by its interior: where several vertices of a face coincide, the interior
//! between edges determines which edge follows which.

use super::super::Face;
use super::around::{Direction, flat, normal, pair_around};
use crate::exact::vector::{main_axis, subtract};
use spinney_base::sort;

/// Combines a point and a number into a key that sorts by point, then by number.
pub(super) fn numbered(point: [i32; 3], number: u32) -> u128 {
    sort::point_key(point) << 32 | u128::from(number)
}

/// Rings of faces, in reusable buffers.
#[derive(Default)]
pub(super) struct FaceRings {
    /// Vertices of the last face's rings, in order.
    pub(super) points: Vec<[i32; 3]>,
    /// End of each ring in `points`.
    pub(super) ends: Vec<usize>,
    /// Keys of points and vertex numbers.
    sorted: Vec<u128>,
}

impl FaceRings {
    /// Finds the rings of a face.
    ///
    /// They are the face's own rings, unless vertices coincide: a hole that touches the outer ring
    /// is merged with it, since the face is not connected between the two at that point. Empty
    /// rings are dropped.
    pub(super) fn find(&mut self, face: &Face<'_>) {
        self.points.clear();
        self.ends.clear();
        self.sorted.clear();
        let has_touching = match (face.ring_ends, face.points) {
            ([_], [a, b, c]) => a == b || b == c || c == a,
            _ => {
                self.sorted
                    .extend(face.points.iter().zip(0u32..).map(|(point, corner)| numbered(*point, corner)));
                sort::numbers128(&mut self.sorted);
                self.sorted.windows(2).any(|pair| pair[0] >> 32 == pair[1] >> 32)
            }
        };
        if has_touching && let Some(follows) = self.follow(face) {
            self.trace(face, &follows);
            return;
        }
        for ring in face.rings().filter(|ring| !ring.is_empty()) {
            self.points.extend_from_slice(ring);
            self.ends.push(self.points.len());
        }
    }

    /// Returns, for each vertex, the vertex at which the edge after its edge starts; `None` for a
    /// face without area.
    fn follow(&self, face: &Face<'_>) -> Option<Vec<u32>> {
        let normal = normal(face.rings());
        if normal == [0; 3] {
            return None;
        }
        let axis = main_axis(normal);
        let is_turned = normal[axis] < 0;
        let mut after = Vec::with_capacity(face.points.len());
        for &end in face.ring_ends {
            let start = after.len() as u32;
            if (start as usize) < end {
                after.extend(start + 1..end as u32);
                after.push(start);
            }
        }
        let mut before = vec![0; after.len()];
        after.iter().zip(0..).for_each(|(&next, corner)| before[next as usize] = corner);
        let mut follows = after.clone();
        let mut directions = Vec::new();
        for same in self.sorted.chunk_by(|a, b| a >> 32 == b >> 32).filter(|same| same.len() > 1) {
            directions.clear();
            for &number in same {
                let corner = number as u32;
                let point = face.points[corner as usize];
                // The interior is on the left of edges: it begins at outgoing edges, and ends at
                // incoming ones.
                for (other, closes) in [(after[corner as usize], false), (before[corner as usize], true)] {
                    let other = face.points[other as usize];
                    let towards = subtract(other.map(i128::from), point.map(i128::from));
                    directions.push(Direction { at: flat(towards, axis, is_turned), closes, number: corner });
                }
            }
            if directions.iter().any(|direction| direction.at == [0; 2]) {
                continue;
            }
            let pairs = pair_around(&mut directions);
            if pairs.len() == same.len() {
                for [out, comes_in] in pairs {
                    follows[before[comes_in as usize] as usize] = out;
                }
            }
        }
        Some(follows)
    }

    fn trace(&mut self, face: &Face<'_>, follows: &[u32]) {
        let mut is_done = vec![false; follows.len()];
        for first in 0..follows.len() {
            let mut corner = first;
            while !is_done[corner] {
                is_done[corner] = true;
                self.points.push(face.points[corner]);
                corner = follows[corner] as usize;
            }
            if self.ends.last().copied().unwrap_or(0) < self.points.len() {
                self.ends.push(self.points.len());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rings(rings: &[&[[i32; 2]]]) -> Vec<Vec<[i32; 2]>> {
        let points: Vec<_> = rings.iter().flat_map(|ring| ring.iter().map(|[x, y]| [*x, *y, 7])).collect();
        let mut ring_ends = Vec::new();
        rings.iter().for_each(|ring| ring_ends.push(ring_ends.last().unwrap_or(&0) + ring.len()));
        let face =
            Face { number: 0, points: &points, ring_ends: &ring_ends, colours: &[], part: 0, source: 0 };
        let mut found = FaceRings::default();
        found.find(&face);
        let starts = [0].into_iter().chain(found.ends.iter().copied());
        let ranges = starts.zip(&found.ends);
        ranges.map(|(start, end)| found.points[start..*end].iter().map(|p| [p[0], p[1]]).collect()).collect()
    }

    const SQUARE: [[i32; 2]; 4] = [[0, 0], [8, 0], [8, 8], [0, 8]];

    #[test]
    fn rings_apart_stay() {
        let hole = [[2, 2], [2, 4], [4, 2]];
        assert_eq!(rings(&[&SQUARE, &hole]), [SQUARE.to_vec(), hole.to_vec()]);
        assert_eq!(rings(&[&SQUARE, &[]]), [SQUARE.to_vec()]);
    }

    #[test]
    fn a_hole_that_touches_joins() {
        let hole = [[0, 0], [2, 4], [4, 2]];
        let joined = vec![[0, 0], [8, 0], [8, 8], [0, 8], [0, 0], [2, 4], [4, 2]];
        assert_eq!(rings(&[&SQUARE, &hole]), [joined]);
        // Two holes that touch each other, and one of them the square.
        let more = [[4, 2], [4, 4], [6, 3]];
        let all = rings(&[&SQUARE, &hole, &more]);
        assert_eq!((all.len(), all[0].len()), (1, 10));
    }

    /// An outline that passes a point twice: its interior sees a separate hole.
    #[test]
    fn a_ring_that_touches_itself_parts_where_its_inside_does_not() {
        let ring = [[0, 0], [8, 0], [8, 8], [4, 8], [6, 4], [2, 4], [4, 8], [0, 8]];
        assert_eq!(rings(&[&ring]).len(), 1);
        let two = [[0, 0], [4, 4], [8, 0], [8, 8], [4, 4], [0, 8]];
        let parted = rings(&[&two]);
        assert_eq!(parted.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3]);
    }

    /// A bridge in both directions is kept.
    #[test]
    fn bridges_stay() {
        let ring = [[0, 0], [2, 2], [2, 4], [4, 2], [2, 2], [0, 0], [8, 0], [8, 8], [0, 8]];
        assert_eq!(rings(&[&ring]), [ring.to_vec()]);
    }
}
