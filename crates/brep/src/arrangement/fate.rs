//! Decision which faces bound the inside, by the winding numbers on both sides.

use super::owner::{FaceAtSample, FaceOwner};
use super::sample::{SamplePoint, StoredSample};
use super::surface::Surface;
use crate::Face;
use crate::boxes::Bounds;
use crate::exact::bounds::MARGIN;
use crate::exact::vector::others;
use crate::face_triangle::FaceTriangle;
use crate::geometry::Triangulator;
use spinney_base::{Result, sort};

/// Fate of a face, or of a region of one, by the winding numbers on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RegionFate {
    /// It bounds the inside; reversed or not, and with another part than that of the face if `part`
    /// is given.
    Stays { is_turned: bool, part: Option<u32> },
    /// It is removed: a coincident face stays.
    Covered,
    /// It is removed: both sides are inside.
    Inside,
    /// It is removed: both sides are outside.
    Outside,
}

/// Returns the sample point of a face on the grid; `None` if the face has no area.
pub(crate) fn sample_of_face(face: &Face<'_>) -> Option<StoredSample> {
    let plane = face.plane()?;
    let triangles = FaceTriangle::of_face(face.points, face.ring_ends, &mut Triangulator::new());
    let corners = triangles.first().map_or([face.points[0]; 3], |triangle| triangle.corners);
    Some(SamplePoint::of_triangle(&plane, &corners).stored())
}

impl RegionFate {
    /// Returns the fate of a face with which no other face coincides.
    pub(crate) fn of_single(is_up: bool, is_inside_above: bool, is_inside_below: bool) -> RegionFate {
        match (is_inside_above, is_inside_below) {
            (true, true) => RegionFate::Inside,
            (false, false) => RegionFate::Outside,
            (_, below) => RegionFate::Stays { is_turned: is_up != below, part: None },
        }
    }
}

impl Surface<'_> {
    /// Returns the fate of a face, from a sample point: see [`Surface::fate`].
    pub(super) fn face_fate(&self, face: u32, is_alone: bool) -> Result<RegionFate> {
        self.fate(&self.sample_of(face), face, is_alone)
    }

    /// Returns a sample point of a face.
    pub(super) fn sample_of(&self, face: u32) -> SamplePoint<'_> {
        let plane = self.plane(face);
        if let Some(exact) = self.exact(face) {
            return SamplePoint::of_region(plane, &exact.region());
        }
        let corners =
            self.with_triangles(face, |triangles| triangles.first().map(|triangle| triangle.corners));
        let first = self.faces.list.get(face as usize).points[0];
        SamplePoint::of_triangle(plane, &corners.unwrap_or([first; 3]))
    }

    /// Change of the winding number at a face that is oriented upwards, from above to below: the
    /// number of equal faces, negative if its component is reversed.
    fn weight(&self, face: u32) -> i32 {
        let count = self.copies.count(face) as i32;
        if self.turned.get(face as usize).is_some_and(|turned| *turned) { -count } else { count }
    }

    /// Returns the fate of a region of a face, from a sample point in it. Of coincident faces, one
    /// stays for all. With `is_alone`, no coincident face is searched for: the face is one of a
    /// body, and touches no other body. (A coincident wall of its own body does not matter then.
    /// Both walls stay, each with the outside in front, as settled ones do.)
    pub(super) fn fate(&self, sample: &SamplePoint<'_>, face: u32, is_alone: bool) -> Result<RegionFate> {
        // Faces that contain the sample, and whether each is oriented upwards.
        let mut same: Vec<(u32, bool)> = Vec::new();
        let is_up = |face: u32| self.plane(face).normal[sample.axis] > 0;
        if is_alone {
            same.push((face, is_up(face)));
        } else {
            self.each_at(sample, |other| {
                let is_there = other == face || sample.side(self.plane(other)) == 0;
                if is_there && self.meets(sample, other) {
                    same.push((other, is_up(other)));
                }
            });
            // Invariant: coincident faces get the same list here, and so agree on the face that
            // stays. Each is divided by the edges of the others, so the list is the same for any
            // sample in a region; and it is sorted. Otherwise two coincident faces could stay, or
            // none, which would be a hole.
            sort::by_key(&mut same, |(face, is_up)| u64::from(*face) << 1 | u64::from(*is_up));
        }
        let [above, below] = self.windings(sample, &same)?;
        let (front, back) = ((self.operands.is_inside)(&above), (self.operands.is_inside)(&below));
        let FaceOwner { part, wall } = match self.operands.owners {
            Some(owners) => {
                let at = same.iter().map(|&(face, is_up)| FaceAtSample {
                    face,
                    operand: self.operand(face),
                    part: self.face(face).part,
                    is_up,
                });
                owners(sample, [&above, &below], &at.collect::<Vec<_>>())?
            }
            None => FaceOwner::default(),
        };
        if front == back {
            if let Some((_, is_turned)) = wall.filter(|(faces, _)| faces.contains(&face)) {
                return Ok(RegionFate::Stays { is_turned, part: None });
            }
            return Ok(if front { RegionFate::Inside } else { RegionFate::Outside });
        }
        // (The faces of a component may have several parts of their own.)
        let part = part.filter(|part| *part != self.face(face).part);
        let is_up = back;
        let stays = same.iter().find(|(_, up)| *up == is_up).or(same.first());
        let own = stays.filter(|(stays, _)| *stays == face);
        Ok(own.map_or(RegionFate::Covered, |(_, up)| RegionFate::Stays { is_turned: *up != is_up, part }))
    }

    /// Returns the winding numbers of all operands above and below a sample. `same` are the faces
    /// that contain it.
    fn windings(&self, sample: &SamplePoint<'_>, same: &[(u32, bool)]) -> Result<[Vec<i32>; 2]> {
        let count = self.operands.far.len();
        let mut changes: Vec<Option<i32>> = vec![None; count];
        for (face, up) in same {
            let weight = self.weight(*face);
            *changes[self.operand(*face)].get_or_insert(0) += if *up { weight } else { -weight };
        }
        // By a ray upwards, where nothing else is known.
        let (mut above, mut needs_ray) = (self.operands.far.to_vec(), vec![true; count]);
        for operand in (0..count).filter(|_| self.operands.are_bodies) {
            let known = match changes[operand] {
                // Invariant: winding numbers of bodies are 0 or 1 (other surfaces are refused when
                // a model is built). So a change at the sample determines the numbers on both sides
                // without any other face: the outside is in front. For a surface that winds twice
                // around a point, this would be a guess.
                Some(change) if change != 0 => Some(i32::from(change < 0)),
                // If two coincident walls of one body cancel, both sides are inside (parts that
                // touch) or both are outside (cavities that touch). Other faces decide, as without
                // faces at the sample.
                _ => (self.operands.winding)(operand, sample).transpose()?,
            };
            if let Some(winding) = known {
                (above[operand], needs_ray[operand]) = (winding, false);
            }
        }
        if needs_ray.contains(&true) {
            self.add_above(sample, same, &needs_ray, &mut above);
        }
        if let Some(rest) = self.operands.rest {
            above[0] += rest(sample)?;
        }
        let below = above.iter().zip(&changes).map(|(above, change)| above + change.unwrap_or(0)).collect();
        Ok([above, below])
    }

    /// Adds the changes of some operands' winding numbers at the faces above a sample, without
    /// those in `same`.
    fn add_above(
        &self,
        sample: &SamplePoint<'_>,
        same: &[(u32, bool)],
        needs_ray: &[bool],
        above: &mut [i32],
    ) {
        self.each_above(sample, &mut |other, up| {
            let operand = self.operand(other);
            if needs_ray[operand] && same.binary_search_by_key(&other, |(face, _)| *face).is_err() {
                above[operand] += up * self.weight(other);
            }
        });
    }

    /// Yields the faces above a sample, with their orientation: 1 upwards, -1 downwards.
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
