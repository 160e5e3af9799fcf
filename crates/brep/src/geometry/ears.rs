//! Ear clipping with exact integers. It takes quadratic time or more in the number of vertices, but
//! keeps every vertex. Its work is bounded.

use std::cell::Cell;
use std::collections::HashSet;

use super::turn::turn;
use spinney_base::sort;

/// Maximum number of vertex visits per vertex of a face; more abort the clipping.
const MAX_VISITS: u64 = 4096;

/// Triangulates flat rings into counterclockwise triangles.
pub(super) struct Ears<'a> {
    flat: &'a [[i64; 2]],
    triangles: Vec<[u32; 3]>,
    /// Number of vertex visits so far.
    visits: Cell<u64>,
}

impl<'a> Ears<'a> {
    pub(super) fn new(flat: &'a [[i64; 2]]) -> Ears<'a> {
        Ears { flat, triangles: Vec::new(), visits: Cell::new(0) }
    }

    /// Triangulates the region between a counterclockwise ring and clockwise holes.
    ///
    /// The triangles are correct if the rings do not cross. If they do, or if the work exceeds its
    /// limit, the result is arbitrary, and the caller has to check it.
    pub(super) fn cut(&mut self, rings: Vec<Vec<u32>>) -> Vec<[u32; 3]> {
        let rings = self.touch_in_corners(rings);
        if let Some(ring) = self.join(rings) {
            self.clip(ring);
        }
        std::mem::take(&mut self.triangles)
    }

    /// Returns the number of vertex visits so far.
    pub(super) fn visits(&self) -> u64 {
        self.visits.get()
    }

    /// Counts vertex visits, and returns whether they exceed the limit.
    fn is_too_much(&self, corners: usize) -> bool {
        self.visits.set(self.visits.get() + corners as u64);
        self.visits.get() > MAX_VISITS * self.flat.len() as u64
    }

    fn at(&self, corner: u32) -> [i64; 2] {
        self.flat[corner as usize]
    }

    fn turn(&self, a: u32, b: u32, c: u32) -> i128 {
        turn(self.at(a), self.at(b), self.at(c))
    }

    /// Returns whether a vertex is strictly between the ends of an edge.
    fn is_between(&self, corner: u32, a: u32, b: u32) -> bool {
        let (p, a_at, b_at) = (self.at(corner), self.at(a), self.at(b));
        let within = |i: usize| a_at[i].min(b_at[i]) <= p[i] && p[i] <= a_at[i].max(b_at[i]);
        within(0) && within(1) && p != a_at && p != b_at && self.turn(a, b, corner) == 0
    }

    /// Splits edges at the vertices on them. A triangle without area between the edge and the
    /// vertex keeps the original edge.
    fn touch_in_corners(&mut self, mut rings: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
        let mut corners: Vec<u32> = rings.iter().flatten().copied().collect();
        corners.sort_unstable_by_key(|&corner| self.at(corner));
        corners.dedup_by_key(|corner| self.at(*corner));
        for ring in &mut rings {
            let mut through = Vec::with_capacity(ring.len());
            for (i, &a) in ring.iter().enumerate() {
                let b = ring[(i + 1) % ring.len()];
                through.push(a);
                let [low, high] = [self.at(a)[0].min(self.at(b)[0]), self.at(a)[0].max(self.at(b)[0])];
                let first = corners.partition_point(|&corner| self.at(corner)[0] < low);
                let last = corners.partition_point(|&corner| self.at(corner)[0] <= high);
                let on_edge = corners[first..last].iter().copied().filter(|&c| self.is_between(c, a, b));
                let mut on_edge: Vec<u32> = on_edge.collect();
                // They are sorted by their coordinates.
                if self.at(a) > self.at(b) {
                    on_edge.reverse();
                }
                let mut from = a;
                for corner in on_edge {
                    self.triangles.push([from, b, corner]);
                    through.push(corner);
                    from = corner;
                }
            }
            *ring = through;
        }
        rings
    }

    /// Joins all rings to one. Holes are joined where they touch, or else by a bridge that is
    /// passed in both directions.
    fn join(&self, rings: Vec<Vec<u32>>) -> Option<Vec<u32>> {
        let mut holes = rings.into_iter();
        let mut ring = holes.next()?;
        let mut holes: Vec<Vec<u32>> = holes.filter(|hole| !hole.is_empty()).collect();
        // No other hole obstructs the farthest one, so a vertex of the ring is visible from it.
        let farthest = |hole: &Vec<u32>| hole.iter().map(|&corner| sort::flat_key(self.at(corner))).max();
        sort::by_wide_key(&mut holes, |hole| farthest(hole).unwrap_or(0));
        let mut taken: HashSet<[i64; 2]> = ring.iter().map(|&corner| self.at(corner)).collect();
        while !holes.is_empty() {
            if self.is_too_much(holes.iter().map(Vec::len).sum()) {
                return None;
            }
            let touches = |hole: &[u32]| hole.iter().any(|&corner| taken.contains(&self.at(corner)));
            let mut touching = holes.iter().enumerate().filter(|(_, hole)| touches(hole));
            let touching = touching.find_map(|(i, hole)| Some((i, self.contact(&ring, hole)?)));
            let (which, (on_ring, on_hole)) = match touching {
                Some(found) => found,
                None => (holes.len() - 1, self.bridge(&ring, &holes)?),
            };
            let hole = holes.remove(which);
            taken.extend(hole.iter().map(|&corner| self.at(corner)));
            let mut joined = ring[..=on_ring].to_vec();
            joined.extend(&hole[on_hole..]);
            joined.extend(&hole[..=on_hole]);
            joined.extend(&ring[on_ring..]);
            // Drop repeated vertices where the rings touch: an edge from a vertex to itself has no
            // direction.
            joined.dedup();
            ring = joined;
        }
        Some(ring)
    }

    /// Returns a contact between a hole and the ring: the indices of a shared vertex in both.
    fn contact(&self, ring: &[u32], hole: &[u32]) -> Option<(usize, usize)> {
        for (on_hole, &corner) in hole.iter().enumerate() {
            let next = hole[(on_hole + 1) % hole.len()];
            if self.is_too_much(ring.len()) {
                return None;
            }
            for (on_ring, &other) in ring.iter().enumerate() {
                if self.at(other) == self.at(corner) && self.opens_to(ring, on_ring, next) {
                    return Some((on_ring, on_hole));
                }
            }
        }
        None
    }

    /// Returns the shortest bridge from the last hole's farthest vertex to the ring that crosses
    /// nothing.
    fn bridge(&self, ring: &[u32], holes: &[Vec<u32>]) -> Option<(usize, usize)> {
        let hole = holes.last()?;
        let on_hole = (0..hole.len()).max_by_key(|&i| self.at(hole[i]))?;
        let from = hole[on_hole];
        let distance = |corner: u32| -> i128 {
            (0..2).map(|i| i128::from(self.at(corner)[i] - self.at(from)[i]).pow(2)).sum()
        };
        let mut candidates: Vec<usize> =
            (0..ring.len()).filter(|&i| self.at(ring[i]) > self.at(from)).collect();
        sort::by_wide_key(&mut candidates, |&i| distance(ring[i]) as u128);
        let is_free = |&on_ring: &usize| {
            let to = ring[on_ring];
            self.opens_to(ring, on_ring, from)
                && self.opens_to(hole, on_hole, to)
                && std::iter::once(ring)
                    .chain(holes.iter().map(Vec::as_slice))
                    .all(|other| !self.is_blocked(from, to, other))
        };
        let corners = ring.len() + holes.iter().map(Vec::len).sum::<usize>();
        let mut candidates = candidates.into_iter().take_while(|_| !self.is_too_much(corners));
        candidates.find(is_free).map(|on_ring| (on_ring, on_hole))
    }

    /// Returns whether a ring has a vertex between two points, or an edge that crosses their
    /// segment.
    pub(super) fn is_blocked(&self, from: u32, to: u32, ring: &[u32]) -> bool {
        (0..ring.len()).any(|i| {
            let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
            self.is_between(a, from, to)
                || self.turn(from, to, a).signum() * self.turn(from, to, b).signum() < 0
                    && self.turn(a, b, from).signum() * self.turn(a, b, to).signum() < 0
        })
    }

    /// Returns whether the segment from a ring's vertex towards another point starts on the ring's
    /// left.
    pub(super) fn opens_to(&self, ring: &[u32], index: usize, towards: u32) -> bool {
        let corner = ring[index];
        let before = ring[(index + ring.len() - 1) % ring.len()];
        let after = ring[(index + 1) % ring.len()];
        self.is_in_angle(before, corner, after, towards)
    }

    /// Returns whether a point is strictly between the two sides of an angle, on the left of the
    /// path through it.
    fn is_in_angle(&self, before: u32, corner: u32, after: u32, point: u32) -> bool {
        let left_of_before = self.turn(before, corner, point) > 0;
        let left_of_after = self.turn(corner, after, point) > 0;
        let bend = self.turn(before, corner, after);
        if bend > 0 || bend == 0 && !self.turns_back(before, corner, after) {
            left_of_before && left_of_after
        } else if bend == 0 {
            // A spike: any direction but that of its own edges.
            self.turn(before, corner, point) != 0 || self.is_ahead(before, corner, point)
        } else {
            left_of_before || left_of_after || {
                // On the extension of one side, within the reflex angle.
                self.turn(before, corner, point) == 0 && self.is_ahead(before, corner, point)
                    || self.turn(corner, after, point) == 0 && self.is_ahead(after, corner, point)
            }
        }
    }

    fn turns_back(&self, before: u32, corner: u32, after: u32) -> bool {
        !self.is_ahead(before, corner, after)
    }

    /// Returns whether a point is on the far side of a vertex as seen from the previous one.
    fn is_ahead(&self, before: u32, corner: u32, point: u32) -> bool {
        let product = |i: usize| {
            i128::from(self.at(corner)[i] - self.at(before)[i])
                * i128::from(self.at(point)[i] - self.at(corner)[i])
        };
        product(0) + product(1) > 0
    }

    /// Clips ears cyclically.
    fn clip(&mut self, mut ring: Vec<u32>) {
        let mut index = 0;
        // Every simple ring has an ear. A full turn without one means that rings cross, which the
        // caller detects.
        let mut failures = 0;
        while ring.len() > 2 && failures < ring.len() {
            index %= ring.len();
            if self.is_too_much(1) {
                return;
            }
            if self.is_ear(&ring, index) {
                let (before, after) = ((index + ring.len() - 1) % ring.len(), (index + 1) % ring.len());
                let ear = [ring[before], ring[index], ring[after]];
                if ear[0] != ear[1] && ear[1] != ear[2] && ear[2] != ear[0] {
                    self.triangles.push(ear);
                }
                ring.remove(index);
                failures = 0;
                // Skip the neighbour: fans would make long, thin triangles.
                index += 1;
            } else {
                failures += 1;
                index += 1;
            }
        }
    }

    /// Returns whether the triangle at a vertex is within the ring, with no other vertex inside or
    /// on it.
    fn is_ear(&self, ring: &[u32], index: usize) -> bool {
        let neighbours =
            |index: usize| [ring[(index + ring.len() - 1) % ring.len()], ring[(index + 1) % ring.len()]];
        let (corner, [before, after]) = (ring[index], neighbours(index));
        let ends = [before, corner, after].map(|c| self.at(c));
        // Repeated vertices or a spike: no area is clipped.
        if ends[0] == ends[1] || ends[1] == ends[2] || ends[2] == ends[0] {
            return true;
        }
        if self.turn(before, corner, after) <= 0 {
            return false;
        }
        let least = [0, 1].map(|i| ends[0][i].min(ends[1][i]).min(ends[2][i]));
        let most = [0, 1].map(|i| ends[0][i].max(ends[1][i]).max(ends[2][i]));
        if self.is_too_much(ring.len()) {
            return false;
        }
        (0..ring.len()).all(|i| {
            let other = ring[i];
            let at = self.at(other);
            if at[0] < least[0] || at[0] > most[0] || at[1] < least[1] || at[1] > most[1] {
                return true;
            }
            if at == ends[1] {
                // Another path through this vertex must not enter the triangle.
                return i == index
                    || neighbours(i).iter().all(|&next| {
                        self.at(next) == ends[1] || !self.is_in_angle(before, corner, after, next)
                    });
            }
            at == ends[0]
                || at == ends[2]
                || self.turn(before, corner, other) < 0
                || self.turn(corner, after, other) < 0
                || self.turn(after, before, other) < 0
        })
    }
}
