//! Arcs: borders between two regions, from one junction of borders to the next, or around a region.
//!
//! An arc is a chain of points with two half-edges. It is directed so that the lesser class is on
//! its left everywhere (with rows going down).
//!
//! ```text
//!               labels[0]: the lesser class
//!              ---- half-edge 2a ---->
//!   ends[0] o========== arc a ==========o ends[1]
//!              <--- half-edge 2a + 1 ----
//!               labels[1]: the greater class
//! ```
//!
//! Half-edge `2a` runs forwards, `2a + 1` backwards, and each has its region on its left. An end of
//! arc `a` has the number `2a + side`. This is also the number of the half-edge that begins there:
//! `2a` begins at `ends[0]`, `2a + 1` at `ends[1]`.
//!
//! At a junction, a half-edge that arrives continues with the next border clockwise. In this
//! drawing, half-edges are on the side of their regions. `next` of an end leads around one of the
//! corners:
//!
//! ```text
//!          ^ |
//!      NW  | v  NE        arriving from the north, leaving to the east:  around NE
//!   ----->     ----->     arriving from the east, leaving to the south:  around SE
//!   <-----     <-----     arriving from the south, leaving to the west:  around SW
//!      SW  ^ |  SE        arriving from the west, leaving to the north:  around NW
//!          | v
//! ```
//!
//! Following `next` from half-edge to half-edge goes around a region's border once.
//!
//! Invariant: an arc is finished in the line in which the first of its two regions ends, since both
//! regions extend along all of it. It is then added to the lists of both regions. Otherwise their
//! borders would lack arcs.

use super::labels::Labels;
use super::points::{Chain, NONE, Point, Points};
use spinney_base::Result;

/// Direction along a row or a column: 0 east, 1 south, 2 west, 3 north.
type Direction = u8;

/// Returns the direction from a point to another in the same row or column.
fn direction([x, y]: Point, [to_x, to_y]: Point) -> Direction {
    match (to_x.cmp(&x), to_y.cmp(&y)) {
        (std::cmp::Ordering::Greater, _) => 0,
        (_, std::cmp::Ordering::Greater) => 1,
        (std::cmp::Ordering::Less, _) => 2,
        _ => 3,
    }
}

/// Returns a segment's contribution to twice the signed area of a ring.
fn swept([x, y]: Point, [to_x, to_y]: Point) -> i128 {
    i128::from(x) * i128::from(to_y) - i128::from(to_x) * i128::from(y)
}

/// An arc, which may still grow at its ends: the first (0) and the last (1).
pub(super) struct Arc {
    pub(super) chain: Chain,
    pub(super) count: u64,
    pub(super) ends: [Point; 2],
    /// Directions of the first and of the last segment.
    directions: [Direction; 2],
    /// Contribution of half-edge `2a` to twice the signed area of a ring. That of `2a + 1` is its
    /// negative.
    swept: i128,
    /// Labels of the cells on the left and on the right; [`NONE`] for VOID cells.
    pub(super) labels: [u32; 2],
    /// Tip per side while the arc is open there, else [`NONE`].
    tips: [u32; 2],
    /// Per side: half-edge after the one that arrives there, around its region; [`NONE`] while
    /// unknown.
    next: [u32; 2],
    /// Per side: end where the half-edge arrives that precedes the one beginning there; [`NONE`]
    /// while unknown.
    previous: [u32; 2],
    /// Next half-edge in the region's list, per half-edge.
    listed: [u32; 2],
    /// Whether a region may touch itself at the end: four borders meet there, and diagonal cells
    /// have the same class.
    pub(super) is_pinched: [bool; 2],
    /// Number of regions that still need the arc.
    users: u8,
    pub(super) is_seen: [bool; 2],
}

/// An open end of an arc.
#[derive(Clone, Copy)]
pub(super) struct Tip {
    arc: u32,
    side: u8,
}

/// All arcs that are still needed.
pub(super) struct Arcs {
    arcs: Vec<Option<Arc>>,
    free: Vec<u32>,
    tips: Vec<Tip>,
    free_tips: Vec<u32>,
    pub(super) points: Points,
    /// Finished arcs that are not in lists yet.
    finished: Vec<u32>,
}

impl Arcs {
    pub(super) fn new(points: Points) -> Arcs {
        let (arcs, free, tips, free_tips) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Arcs { arcs, free, tips, free_tips, points, finished: Vec::new() }
    }

    /// Returns an arc, which must exist.
    pub(super) fn arc(&self, number: u32) -> &Arc {
        self.arcs[number as usize].as_ref().expect("the arc is in use")
    }

    fn arc_mut(&mut self, number: u32) -> &mut Arc {
        self.arcs[number as usize].as_mut().expect("the arc is in use")
    }

    fn tip(&mut self, arc: u32, side: u8) -> u32 {
        let tip = Tip { arc, side };
        match self.free_tips.pop() {
            Some(number) => {
                self.tips[number as usize] = tip;
                number
            }
            None => {
                self.tips.push(tip);
                (self.tips.len() - 1) as u32
            }
        }
    }

    fn add(&mut self, at: Point, labels: [u32; 2]) -> u32 {
        let arc = Arc {
            chain: self.points.begin(at),
            count: 1,
            ends: [at; 2],
            directions: [0; 2],
            swept: 0,
            labels,
            tips: [NONE; 2],
            next: [NONE; 2],
            previous: [NONE; 2],
            listed: [NONE; 2],
            is_pinched: [false; 2],
            users: labels.iter().filter(|label| **label != NONE).count() as u8,
            is_seen: [false; 2],
        };
        match self.free.pop() {
            Some(number) => {
                self.arcs[number as usize] = Some(arc);
                number
            }
            None => {
                self.arcs.push(Some(arc));
                (self.arcs.len() - 1) as u32
            }
        }
    }

    /// Starts an arc at a cell corner, from which it continues at both ends. Returns the tips of
    /// its first and its last end.
    pub(super) fn begin(&mut self, at: Point, labels: [u32; 2]) -> [u32; 2] {
        let arc = self.add(at, labels);
        let tips = [0, 1].map(|side| self.tip(arc, side));
        self.arc_mut(arc).tips = tips;
        tips
    }

    /// Starts an arc whose first (0) or last (1) end is at a junction. Returns that end, and the
    /// tip of the other one.
    pub(super) fn begin_at_junction(
        &mut self,
        at: Point,
        side: u8,
        labels: [u32; 2],
        is_pinched: bool,
    ) -> (u32, u32) {
        let arc = self.add(at, labels);
        let tip = self.tip(arc, 1 - side);
        let own = self.arc_mut(arc);
        own.tips[usize::from(1 - side)] = tip;
        own.is_pinched[usize::from(side)] = is_pinched;
        (2 * arc + u32::from(side), tip)
    }

    /// Extends a tip to a point.
    pub(super) fn push(&mut self, tip: u32, at: Point) {
        let Tip { arc, side } = self.tips[tip as usize];
        let side = usize::from(side);
        let Arcs { arcs, points, .. } = self;
        let arc = arcs[arc as usize].as_mut().expect("the arc is in use");
        points.push(&mut arc.chain, side, at);
        let last = std::mem::replace(&mut arc.ends[side], at);
        let (from, to) = if side == 0 { (at, last) } else { (last, at) };
        let direction = direction(from, to);
        arc.swept += swept(from, to);
        if arc.count == 1 {
            arc.directions = [direction; 2];
        }
        arc.directions[side] = direction;
        arc.count += 1;
    }

    /// Joins two tips at a cell corner.
    pub(super) fn meet(&mut self, tips: [u32; 2], at: Point) {
        let [end, start] = if self.tips[tips[0] as usize].side == 1 { tips } else { [tips[1], tips[0]] };
        self.push(end, at);
        let [Tip { arc: first, side: 1 }, Tip { arc: second, side: 0 }] =
            [end, start].map(|tip| self.tips[tip as usize])
        else {
            unreachable!("the smaller class of a border is always on the same side");
        };
        if first == second {
            let beginning = self.arc(first).ends[0];
            self.push(end, beginning);
            self.free_tips.extend([end, start]);
            let [own_start, own_end] = [2 * first, 2 * first + 1];
            let arc = self.arc_mut(first);
            arc.tips = [NONE; 2];
            // Each half-edge of a closed arc follows itself.
            (arc.next, arc.previous) = ([own_end, own_start], [own_end, own_start]);
            self.finished.push(first);
            return;
        }
        self.free_tips.extend([end, start]);
        let after = self.arcs[second as usize].take().expect("the arc is in use");
        self.free.push(second);
        let Arcs { arcs, points, tips, .. } = self;
        let arc = arcs[first as usize].as_mut().expect("the arc is in use");
        arc.swept += swept(at, after.ends[0]) + after.swept;
        arc.directions[1] = if after.count == 1 { direction(at, after.ends[0]) } else { after.directions[1] };
        arc.chain = points.join(arc.chain, after.chain);
        arc.count += after.count;
        arc.ends[1] = after.ends[1];
        arc.tips[1] = after.tips[1];
        arc.is_pinched[1] = after.is_pinched[1];
        let (mut next, mut previous) = (after.next[1], after.previous[1]);
        if after.tips[1] != NONE {
            tips[after.tips[1] as usize] = Tip { arc: first, side: 1 };
        } else {
            // Update the links at the junction to the arc's new number.
            let [old, new] = [2 * second + 1, 2 * first + 1];
            if next == old {
                next = new;
            } else if next != NONE {
                self.arc_mut(next / 2).previous[(next % 2) as usize] = new;
            }
            if previous == old {
                previous = new;
            } else if previous != NONE {
                self.arc_mut(previous / 2).next[(previous % 2) as usize] = new;
            }
        }
        let arc = self.arc_mut(first);
        (arc.next[1], arc.previous[1]) = (next, previous);
        if arc.tips == [NONE; 2] {
            self.finished.push(first);
        }
    }

    /// Ends a tip at a junction. Returns the end.
    pub(super) fn end(&mut self, tip: u32, at: Point, is_pinched: bool) -> u32 {
        self.push(tip, at);
        let Tip { arc: number, side } = self.tips[tip as usize];
        self.free_tips.push(tip);
        let arc = self.arc_mut(number);
        arc.tips[usize::from(side)] = NONE;
        arc.is_pinched[usize::from(side)] = is_pinched;
        if arc.tips == [NONE; 2] {
            self.finished.push(number);
        }
        2 * number + u32::from(side)
    }

    /// Links the half-edge that arrives at end `from` to the half-edge `to`.
    ///
    /// Borders of VOID are not linked: VOID regions never end, and links to removed arcs would
    /// dangle.
    pub(super) fn link(&mut self, from: u32, to: u32) {
        if self.arc(from / 2).labels[(1 - from % 2) as usize] == NONE {
            return;
        }
        self.arc_mut(from / 2).next[(from % 2) as usize] = to;
        self.arc_mut(to / 2).previous[(to % 2) as usize] = from;
    }

    /// Takes the arcs that were finished since the last call.
    pub(super) fn take_finished(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.finished)
    }

    /// Adds a finished arc to the lists of its regions.
    pub(super) fn list(&mut self, number: u32, labels: &mut Labels) {
        for (side, label) in self.arc(number).labels.into_iter().enumerate() {
            if label != NONE {
                let half = 2 * number + side as u32;
                labels.push_half(label, half, |last, half| self.link_halves(last, half));
            }
        }
    }

    /// Appends a half-edge to another one's list.
    pub(super) fn link_halves(&mut self, last: u32, half: u32) {
        self.arc_mut(last / 2).listed[(last % 2) as usize] = half;
    }

    /// Returns the half-edge after another one in its list.
    pub(super) fn listed_after(&self, half: u32) -> u32 {
        self.arc(half / 2).listed[(half % 2) as usize]
    }

    /// Returns the half-edge that follows another one around its region.
    pub(super) fn half_after(&self, half: u32) -> u32 {
        // (A half-edge arrives at the end opposite to the one where it begins.)
        self.arc(half / 2).next[(1 - half % 2) as usize]
    }

    /// Marks a half-edge as seen. Returns whether it was not.
    pub(super) fn see(&mut self, half: u32) -> bool {
        !std::mem::replace(&mut self.arc_mut(half / 2).is_seen[(half % 2) as usize], true)
    }

    /// Returns the point where a half-edge begins, and whether a region may touch itself there.
    pub(super) fn start(&self, half: u32) -> (Point, bool) {
        let (arc, side) = (self.arc(half / 2), (half % 2) as usize);
        (arc.ends[side], arc.is_pinched[side])
    }

    /// Returns a half-edge's contribution to twice the signed area of a ring.
    pub(super) fn swept(&self, half: u32) -> i128 {
        let swept = self.arc(half / 2).swept;
        if half.is_multiple_of(2) { swept } else { -swept }
    }

    /// Returns whether two consecutive half-edges meet without a turn.
    pub(super) fn is_straight(&self, before: u32, half: u32) -> bool {
        let step = |half: u32, is_last: bool| {
            let directions = self.arc(half / 2).directions;
            match half % 2 {
                0 => directions[usize::from(is_last)],
                _ => (directions[usize::from(!is_last)] + 2) % 4,
            }
        };
        step(before, true) == step(half, false)
    }

    /// Replaces the points of a finished arc by simplified ones. The ends must stay the same.
    ///
    /// The area and the directions remain those of the exact border. Of the area, only the sign is
    /// used, which is that of the simplified ring. The directions are not used: simplified rings
    /// [keep their junctions](super::rings::RingRules::keeps_junctions).
    pub(super) fn replace(&mut self, number: u32, points: &[Point]) {
        let Arcs { arcs, points: all, .. } = self;
        let arc = arcs[number as usize].as_mut().expect("the arc is in use");
        all.remove(arc.chain);
        arc.chain = all.begin(points[0]);
        for point in &points[1..] {
            all.push(&mut arc.chain, 1, *point);
        }
        arc.count = points.len() as u64;
    }

    /// Drops a region's claim to an arc. The arc is removed when no region needs it.
    pub(super) fn release(&mut self, number: u32) {
        let arc = self.arc_mut(number);
        arc.users -= 1;
        if arc.users == 0 {
            let chain = arc.chain;
            self.points.remove(chain);
            self.arcs[number as usize] = None;
            self.free.push(number);
        }
    }

    /// Moves points to the temporary file if there are too many.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn spool(&mut self) -> Result<()> {
        let Arcs { arcs, points, .. } = self;
        if points.is_full() {
            points.spool(arcs.iter_mut().flatten().map(|arc| &mut arc.chain))?;
        }
        Ok(())
    }
}
