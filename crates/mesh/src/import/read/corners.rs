//! Buffer of the face being read, and its completion.

use super::MeshFace;
use spinney_base::Result;

/// Maximum number of corners of a face.
pub(super) const MAX_CORNERS: usize = 1 << 20;

/// Colour of faces without a colour in a file where other faces have one.
pub(super) const WHITE: [u8; 3] = [255; 3];

/// Corners of a face under construction. Buffers are reused for the next face.
#[derive(Default)]
pub(super) struct Corners {
    points: Vec<[f64; 3]>,
    colours: Vec<[u8; 3]>,
    ring_ends: Vec<usize>,
    /// Number of degenerate faces that were left out so far.
    pub(super) degenerate: u64,
}

impl Corners {
    /// Starts a face.
    pub(super) fn clear(&mut self) {
        self.points.clear();
        self.colours.clear();
        self.ring_ends.clear();
    }

    /// Number of corners so far.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Adds a corner.
    #[inline]
    pub(super) fn push(&mut self, point: [f64; 3]) {
        self.points.push(point);
    }

    /// Adds a corner's colour. Either all corners or none must have one.
    #[inline]
    pub(super) fn push_colour(&mut self, colour: [u8; 3]) {
        self.colours.push(colour);
    }

    /// Sets the same colour for all corners.
    pub(super) fn paint(&mut self, colour: [u8; 3]) {
        self.colours.clear();
        self.colours.resize(self.points.len(), colour);
    }

    /// Ends a ring. Drops corners that repeat the previous one, and holes with fewer than three
    /// distinct points. Colours must already have been pushed.
    pub(super) fn end_ring(&mut self) {
        let start = self.ring_ends.last().copied().unwrap_or(0);
        let mut end = start;
        for i in start..self.points.len() {
            if end > start && self.points[end - 1] == self.points[i] {
                continue;
            }
            self.points[end] = self.points[i];
            if !self.colours.is_empty() {
                self.colours[end] = self.colours[i];
            }
            end += 1;
        }
        while end > start + 1 && self.points[end - 1] == self.points[start] {
            end -= 1;
        }
        let is_hole = !self.ring_ends.is_empty();
        if is_hole && !has_three(&self.points[start..end]) {
            end = start;
        }
        self.points.truncate(end);
        self.colours.truncate(end);
        if end > start || !is_hole {
            self.ring_ends.push(end);
        }
    }

    /// Passes the face to `each`, unless its outer ring has fewer than three distinct points.
    #[inline]
    pub(super) fn hand_out(
        &mut self,
        part: u32,
        each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>,
    ) -> Result<()> {
        if self.ring_ends.is_empty() {
            match self.points.as_slice() {
                [a, b, c] if a != b && b != c && c != a => self.ring_ends.push(3),
                _ => self.end_ring(),
            }
        }
        if !has_three(&self.points[..self.ring_ends[0]]) {
            self.degenerate += 1;
            return Ok(());
        }
        let (points, ring_ends, colours) = (&self.points, &self.ring_ends, &self.colours);
        each(&MeshFace { points, ring_ends, colours, part, values: &[] })
    }
}

/// Whether at least three points are distinct.
fn has_three(points: &[[f64; 3]]) -> bool {
    let Some((first, rest)) = points.split_first() else { return false };
    let Some(second) = rest.iter().find(|point| *point != first) else { return false };
    rest.iter().any(|point| point != first && point != second)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points and ring ends that are passed on for rings of points on the number line.
    fn handed_out(rings: &[&[u8]]) -> Option<(Vec<u8>, Vec<usize>)> {
        let mut corners = Corners::default();
        for ring in rings {
            for number in *ring {
                corners.push([f64::from(*number), 0.0, 0.0]);
                corners.push_colour([*number; 3]);
            }
            corners.end_ring();
        }
        let mut found = None;
        let mut each = |face: &MeshFace<'_>| {
            assert!(
                face.points.iter().zip(face.colours).all(|(point, colour)| point[0] == f64::from(colour[0]))
            );
            assert_eq!(face.points.len(), face.colours.len());
            found = Some((face.colours.iter().map(|colour| colour[0]).collect(), face.ring_ends.to_vec()));
            Ok(())
        };
        corners.hand_out(0, &mut each).unwrap();
        assert_eq!(corners.degenerate, u64::from(found.is_none()));
        found
    }

    #[test]
    fn repeated_corners_go() {
        assert_eq!(handed_out(&[&[1, 2, 3]]), Some((vec![1, 2, 3], vec![3])));
        assert_eq!(handed_out(&[&[1, 1, 2, 2, 3, 1, 1]]), Some((vec![1, 2, 3], vec![3])));
        assert_eq!(handed_out(&[&[1, 2, 1, 3]]), Some((vec![1, 2, 1, 3], vec![4])));
    }

    #[test]
    fn faces_that_cover_nothing_go() {
        for ring in [&[][..], &[1], &[1, 2], &[1, 2, 1], &[1, 2, 1, 2], &[5, 5, 5]] {
            assert_eq!(handed_out(&[ring, &[1, 2, 3]]), None, "{ring:?}");
        }
    }

    #[test]
    fn holes_that_cover_nothing_go() {
        let rings: [&[u8]; 4] = [&[1, 2, 3, 4], &[5, 6], &[7, 8, 9, 7], &[]];
        assert_eq!(handed_out(&rings), Some((vec![1, 2, 3, 4, 7, 8, 9], vec![4, 7])));
    }
}
