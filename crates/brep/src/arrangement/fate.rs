//! Which faces bound what is inside: by the winding numbers on both of their sides.

use super::sample::SamplePoint;
use super::surface::Surface;
use crate::boxes::Bounds;
use crate::exact::bounds::MARGIN;
use crate::exact::vector::others;
use spinney_base::{Result, sort};

/// Fate of a face, or of a region of one, where what bounds nothing is taken away.
#[derive(Clone, Copy)]
pub(super) enum Fate {
    /// It bounds what is inside, turned to its other side or not.
    Stays { is_turned: bool },
    /// It goes: another one that lies on it stays.
    Covered,
    /// It goes: what is on both of its sides is inside.
    Inside,
    /// It goes: nothing on either of its sides is inside.
    Outside,
}

impl Surface<'_> {
    /// The fate of a face, by a point of it: see [`Surface::fate`].
    pub(super) fn face_fate(&self, face: u32, alone: bool) -> Result<Fate> {
        self.fate(&self.sample_of(face), face, alone)
    }

    /// A point of a face.
    pub(super) fn sample_of(&self, face: u32) -> SamplePoint<'_> {
        let plane = self.plane(face);
        if let Some(exact) = self.exact(face) {
            return SamplePoint::of_region(plane, &exact.region());
        }
        let corners = self.with_pieces(face, |pieces| pieces.first().map(|piece| piece.corners));
        let first = self.faces.list.get(face as usize).points[0];
        SamplePoint::of_triangle(plane, &corners.unwrap_or([first; 3]))
    }

    /// Change in the winding number of who passes a face downwards that is turned up: 1, or -1 where its part is turned.
    fn weight(&self, face: u32) -> i32 {
        if self.turned.get(face as usize).is_some_and(|turned| *turned) { -1 } else { 1 }
    }

    /// The fate of a region of a face, by a point of it. Of faces that lie on each other, one stays for all; but of a body's
    /// faces that touch no other's (`alone`) each does.
    pub(super) fn fate(&self, sample: &SamplePoint<'_>, face: u32, alone: bool) -> Result<Fate> {
        // Faces in the same place, and whether they are turned up.
        let mut same: Vec<(u32, bool)> = Vec::new();
        let is_up = |face: u32| self.plane(face).normal[sample.axis] > 0;
        if alone {
            same.push((face, is_up(face)));
        } else {
            self.each_at(sample, |other| {
                let is_there = other == face || sample.side(self.plane(other)) == 0;
                if is_there && self.meets(sample, other) {
                    same.push((other, is_up(other)));
                }
            });
            // Invariant: of faces that lie on each other, all have the same list here, and so come to the
            // same one that stays. Each is divided by the edges of the others, so that wherever in a region a
            // sample is, the same faces are there; and the list is in order. Otherwise two of them would stay
            // in one place, or none, and there would be a hole.
            sort::by_key(&mut same, |(face, is_up)| u64::from(*face) << 1 | u64::from(*is_up));
        }
        let [above, below] = self.windings(sample, &same)?;
        let (front, back) = ((self.operands.is_inside)(&above), (self.operands.is_inside)(&below));
        if front == back {
            return Ok(if front { Fate::Inside } else { Fate::Outside });
        }
        let is_up = back;
        let stays = same.iter().find(|(_, up)| *up == is_up).or(same.first());
        let own = stays.filter(|(stays, _)| *stays == face);
        Ok(own.map_or(Fate::Covered, |(_, up)| Fate::Stays { is_turned: *up != is_up }))
    }

    /// The winding numbers above and below a sample, on which these faces lie.
    fn windings(&self, sample: &SamplePoint<'_>, same: &[(u32, bool)]) -> Result<[Vec<i32>; 2]> {
        let count = self.operands.far.len();
        let mut changes: Vec<Option<i32>> = vec![None; count];
        for (face, up) in same {
            let weight = self.weight(*face);
            *changes[self.operand(*face)].get_or_insert(0) += if *up { weight } else { -weight };
        }
        // By a line upwards, where nothing else is known.
        let (mut above, mut is_asked) = (self.operands.far.to_vec(), vec![true; count]);
        for operand in (0..count).filter(|_| self.operands.are_bodies) {
            let known = match changes[operand] {
                // Invariant: winding numbers of bodies are 0 or 1 (whoever builds a model refuses others), so
                // that what changes at a place tells both sides without a look at any other face. Of a
                // surface that goes around something twice, this would be a guess. Outside is in front; two
                // walls of one body that lie on each other have the inside on both sides.
                Some(change) => Some(i32::from(change <= 0)),
                None => (self.operands.winding)(operand, sample).transpose()?,
            };
            if let Some(winding) = known {
                (above[operand], is_asked[operand]) = (winding, false);
            }
        }
        if is_asked.contains(&true) {
            self.add_above(sample, same, &is_asked, &mut above);
        }
        if let Some(rest) = self.operands.rest {
            above[0] += rest(sample)?;
        }
        let below = above.iter().zip(&changes).map(|(above, change)| above + change.unwrap_or(0)).collect();
        Ok([above, below])
    }

    /// Adds what faces above a sample, but for these, change in the winding numbers of some operands.
    fn add_above(
        &self,
        sample: &SamplePoint<'_>,
        same: &[(u32, bool)],
        is_asked: &[bool],
        above: &mut [i32],
    ) {
        self.each_above(sample, &mut |other, up| {
            let operand = self.operand(other);
            if is_asked[operand] && same.binary_search_by_key(&other, |(face, _)| *face).is_err() {
                above[operand] += up * self.weight(other);
            }
        });
    }

    /// Hands out the faces above a sample, with what each is: 1 where it is turned up, -1 where it is turned down.
    pub(super) fn each_above(&self, sample: &SamplePoint<'_>, each: &mut dyn FnMut(u32, i32)) {
        let (axis, near) = (sample.axis, sample.near);
        let [u, v] = others(axis);
        let reaches = |[low, high]: &Bounds| {
            let holds = |axis: usize| {
                f64::from(low[axis]) - MARGIN <= near[axis] && near[axis] <= f64::from(high[axis]) + MARGIN
            };
            holds(u) && holds(v) && near[axis] <= f64::from(high[axis]) + MARGIN
        };
        self.boxes().each(&reaches, |other| {
            let plane = self.plane(other);
            let up = plane.normal[axis].signum() as i32;
            if up != 0 && self.meets(sample, other) && sample.side(plane) * up < 0 {
                each(other, up);
            }
        });
    }
}
