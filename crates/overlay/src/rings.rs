//! Assembly of polygons from the edges around faces.

use std::collections::BTreeMap;

use crate::edges::Edge;
use crate::exact::{Cell, turn};

/// A polygon: a counterclockwise outer ring, then clockwise holes. Rings touch each other in points
/// at most. They repeat their first vertex at the end.
pub(crate) type Rings = Vec<Vec<Cell>>;

/// A directed edge with a face on its left.
struct Side {
    from: Cell,
    to: Cell,
    face: u32,
}

/// Assembles the polygons of faces. `face_of` returns the faces to the right and to the left of an
/// edge, directed from its left end, or `None` for a face that is not requested. The two faces of
/// an edge must differ. The map is ordered by face.
pub(crate) fn polygons(
    edges: &[Edge<Cell>],
    face_of: &mut dyn FnMut(usize) -> [Option<u32>; 2],
) -> BTreeMap<u32, Rings> {
    let mut sides = Vec::new();
    for (number, edge) in edges.iter().enumerate() {
        let [a, b] = edge.ends;
        let [right, left] = face_of(number);
        sides.extend(right.map(|face| Side { from: b, to: a, face }));
        sides.extend(left.map(|face| Side { from: a, to: b, face }));
    }
    sides.sort_unstable_by_key(|side| (side.face, side.from, side.to));
    let mut is_used = vec![false; sides.len()];
    let mut polygons: BTreeMap<u32, Rings> = BTreeMap::new();
    let mut tracer = RingTracer { sides: &sides, ring: Vec::new(), indices: BTreeMap::new() };
    for first in 0..sides.len() {
        if !is_used[first] {
            tracer.around(first, &mut is_used, polygons.entry(sides[first].face).or_default());
        }
    }
    for rings in polygons.values_mut() {
        // (A face has one outer ring.)
        rings.sort_by_key(|ring| (!is_outer(ring), ring[0]));
    }
    polygons
}

struct RingTracer<'a> {
    sides: &'a [Side],
    /// Vertices since the first one, and their indices, which detect where a ring touches itself.
    ring: Vec<Cell>,
    indices: BTreeMap<Cell, usize>,
}

impl RingTracer<'_> {
    /// Follows a face's border from an edge on. Makes one ring of it, or several if it touches
    /// itself.
    fn around(&mut self, first: usize, is_used: &mut [bool], rings: &mut Rings) {
        self.ring.clear();
        self.indices.clear();
        let mut side = first;
        loop {
            is_used[side] = true;
            let corner = self.sides[side].from;
            if let Some(index) = self.indices.get(&corner).copied() {
                self.close(index, rings);
            } else {
                self.indices.insert(corner, self.ring.len());
                self.ring.push(corner);
            }
            side = self.next(side);
            if side == first {
                break;
            }
        }
        self.close(0, rings);
    }

    /// Makes a ring of the vertices since an index. The first of them stays in the border.
    fn close(&mut self, index: usize, rings: &mut Rings) {
        let mut ring = self.ring.split_off(index);
        for corner in &ring {
            self.indices.remove(corner);
        }
        self.indices.insert(ring[0], index);
        self.ring.push(ring[0]);
        // The ring starts with its leftmost vertex, whichever edge came first.
        let least = (0..ring.len()).min_by_key(|index| ring[*index]).unwrap_or(0);
        ring.rotate_left(least);
        ring.push(ring[0]);
        rings.push(ring);
    }

    /// Returns the next edge of the face's border: the first one clockwise around the vertex.
    fn next(&self, side: usize) -> usize {
        let Side { from, to: corner, face } = self.sides[side];
        let begin = self.sides.partition_point(|other| (other.face, other.from) < (face, corner));
        let is_here = |other: &Side| other.face == face && other.from == corner;
        let count = self.sides[begin..].iter().take_while(|other| is_here(other)).count();
        let mut best = begin;
        for other in begin + 1..begin + count {
            if is_before(corner, from, self.sides[other].to, self.sides[best].to) {
                best = other;
            }
        }
        best
    }
}

/// Whether `one` comes before `other`, clockwise around a vertex, starting from `from`.
fn is_before(corner: Cell, from: Cell, one: Cell, other: Cell) -> bool {
    // Compare the right half first, then the direction straight ahead, then the left half.
    let half = |point: Cell| match turn(corner, from, point) {
        -1 => 0,
        0 => 1,
        _ => 2,
    };
    match half(one).cmp(&half(other)) {
        std::cmp::Ordering::Equal => turn(corner, other, one) > 0,
        order => order.is_lt(),
    }
}

/// Whether a ring is counterclockwise. Its first vertex is the leftmost one and so lies on its
/// convex hull.
fn is_outer(ring: &[Cell]) -> bool {
    turn(ring[ring.len() - 2], ring[0], ring[1]) > 0
}
