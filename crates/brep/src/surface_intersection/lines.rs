//! Lines of connected segments.

use super::segments::{CommonSegment, Segments};

/// Consecutive segments.
pub(super) struct SegmentChain {
    pub(super) is_crossing: bool,
    /// One more than segments; the last equals the first if the chain is closed.
    pub(super) vertices: Vec<u32>,
    /// Faces at each segment, as in [`CommonSegment`].
    pub(super) faces: Vec<[[u32; 2]; 2]>,
}

impl SegmentChain {
    fn of(first: &CommonSegment) -> SegmentChain {
        SegmentChain {
            is_crossing: first.is_crossing,
            vertices: first.vertices.to_vec(),
            faces: vec![first.faces],
        }
    }

    fn end(&self) -> u32 {
        self.vertices[self.vertices.len() - 1]
    }

    /// Appends a segment that starts where the chain ends, or ends there and is reversed.
    fn add(&mut self, segment: &CommonSegment) {
        let [from, to] = segment.vertices;
        let is_forward = from == self.end();
        self.vertices.push(if is_forward { to } else { from });
        let turned = segment.faces.map(|[left, right]| [right, left]);
        self.faces.push(if is_forward { segment.faces } else { turned });
    }
}

impl Segments {
    /// Joins the segments. Segments where surfaces intersect form closed lines, in their
    /// directions. Segments where surfaces touch form lines between points where other than two of
    /// them meet.
    pub(super) fn lines(&self) -> Vec<SegmentChain> {
        let mut lines = self.crossing_lines();
        lines.extend(self.touch_lines());
        lines
    }

    fn crossing_lines(&self) -> Vec<SegmentChain> {
        let crossing = |number: &u32| self.list[*number as usize].is_crossing;
        let numbers: Vec<u32> = (0..self.list.len() as u32).filter(crossing).collect();
        let mut from =
            At::of(self.count(), numbers.iter().map(|number| (self.segment(*number).vertices[0], *number)));
        let mut lines = Vec::new();
        for first in numbers {
            if !from.take(self.segment(first).vertices[0], first) {
                continue;
            }
            let mut line = SegmentChain::of(self.segment(first));
            let start = line.vertices[0];
            // Invariant: at each vertex, as many crossing segments start as end. The section of a
            // surface inside of the other body has a closed boundary. So every line returns to its
            // start. If surfaces are not closed, it ends where no segment starts.
            while line.end() != start {
                // Where lines touch each other, continue along the same section of the inside
                // surface.
                let last = line.faces[line.faces.len() - 1];
                let is_on_same_section = |number: &u32| {
                    let faces = self.segment(*number).faces;
                    faces[0][0] == last[0][0] || faces[1][1] == last[1][1]
                };
                let open = from.at(line.end());
                let Some(next) = open.iter().copied().find(is_on_same_section).or(open.first().copied())
                else {
                    break;
                };
                from.take(line.end(), next);
                line.add(self.segment(next));
            }
            lines.push(line);
        }
        lines
    }

    fn touch_lines(&self) -> Vec<SegmentChain> {
        let touching = |number: &u32| !self.segment(*number).is_crossing;
        let numbers: Vec<u32> = (0..self.list.len() as u32).filter(touching).collect();
        let ends =
            numbers.iter().flat_map(|number| self.segment(*number).vertices.map(|vertex| (vertex, *number)));
        let mut at = At::of(self.count(), ends);
        let is_end: Vec<bool> = (0..self.count()).map(|vertex| at.at(vertex as u32).len() != 2).collect();
        let mut lines = Vec::new();
        // Lines from ends first; what is left is closed.
        for is_from_end in [true, false] {
            for &first in &numbers {
                let vertices = self.segment(first).vertices;
                let Some(start) =
                    vertices.into_iter().find(|vertex| is_end[*vertex as usize] || !is_from_end)
                else {
                    continue;
                };
                if !at.take(start, first) {
                    continue;
                }
                let mut line = SegmentChain { vertices: vec![start], faces: Vec::new(), is_crossing: false };
                line.add(self.segment(first));
                at.take(line.end(), first);
                while !is_end[line.end() as usize]
                    && let Some(next) = at.at(line.end()).first().copied()
                {
                    at.take(line.end(), next);
                    line.add(self.segment(next));
                    at.take(line.end(), next);
                }
                lines.push(line);
            }
        }
        lines
    }

    fn segment(&self, number: u32) -> &CommonSegment {
        &self.list[number as usize]
    }

    fn count(&self) -> usize {
        self.vertices.list().len()
    }
}

/// Segments at each vertex that are in no line yet.
struct At(Vec<Vec<u32>>);

impl At {
    fn of(count: usize, ends: impl Iterator<Item = (u32, u32)>) -> At {
        let mut lists = vec![Vec::new(); count];
        ends.for_each(|(vertex, segment)| lists[vertex as usize].push(segment));
        At(lists)
    }

    fn at(&self, vertex: u32) -> &[u32] {
        &self.0[vertex as usize]
    }

    /// Removes a segment from a vertex, if it is there.
    fn take(&mut self, vertex: u32, segment: u32) -> bool {
        let list = &mut self.0[vertex as usize];
        let place = list.iter().position(|known| *known == segment);
        place.map(|place| list.remove(place)).is_some()
    }
}
