//! Contacts: pairs of faces with common points, mostly more than neighbours in a surface have.

use std::collections::{HashMap, HashSet};

use super::contact::Contact;
use super::meeting::{Meeting, meet};
use super::point::ExactPoint;
use super::polygons::{Common, common};
use super::surface::{Surface, too_large};
use crate::boxes::touch;
use crate::{Faces, format_position};
use spinney_base::{Error, Progress, Result, SilentProgress, parallel, sort};

/// Kinds of contacts to find.
#[derive(Clone, Copy, PartialEq)]
enum Wanted {
    /// More than neighbours have: no shared vertices and edges.
    Irregular,
    /// All common points.
    All,
}

impl Surface<'_> {
    /// Returns all that faces of the first body have in common with faces of the others. Coplanar
    /// faces that only touch are left out: the faces that adjoin them have the same common points.
    pub(crate) fn contacts_of_first(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Contact>> {
        let first = self.operands.ends[0];
        let tree = self.boxes_of(0..first, progress)?;
        let others = self.boxes_of(first..self.planes.len() as u32, progress)?;
        let (mut bytes, mut all) = (self.bytes, Vec::new());
        for groups in tree.groups().chunks(64) {
            progress.check()?;
            let found = parallel::map(groups, |group| {
                let mut found: Vec<Contact> = Vec::new();
                tree.pairs_of(group, &others, &mut |[one, other]| {
                    if !progress.interrupted() {
                        found.extend(self.contact(one, other, Wanted::All));
                    }
                });
                sort::by_key(&mut found, |contact| sort::pair_key(contact.faces));
                found
            });
            found.into_iter().try_for_each(|found| self.add(found, &mut all, &mut bytes, memory))?;
        }
        progress.check()?;
        Ok(all)
    }

    /// Appends contacts, if they fit into the memory in addition to `bytes`.
    fn add(&self, found: Vec<Contact>, all: &mut Vec<Contact>, bytes: &mut u64, memory: u64) -> Result<()> {
        let of = |contact: &Contact| {
            let points = 2 * contact.segments.len() + contact.points.len();
            (size_of::<Contact>() + points * size_of::<ExactPoint>()) as u64
        };
        *bytes += found.iter().map(of).sum::<u64>();
        if *bytes > memory {
            return Err(too_large(self.path, *bytes, memory));
        }
        all.extend(found);
        match self.operands.most_contacts {
            most @ 1.. if all.len() as u64 > most => Err(self.too_many(all)),
            _ => Ok(()),
        }
    }

    /// Returns the error for too many contacts, with the face that has most of them.
    fn too_many(&self, contacts: &[Contact]) -> Error {
        let mut counts: HashMap<u32, u64> = HashMap::new();
        contacts
            .iter()
            .flat_map(|contact| contact.faces)
            .for_each(|face| *counts.entry(face).or_default() += 1);
        let worst = counts.into_iter().max_by_key(|(face, count)| (*count, std::cmp::Reverse(*face)));
        let describe = |(face, count): (u32, u64)| {
            let face = self.face(face);
            let at = self.faces.list.grid().to_world(face.points[0]);
            format!("a face at {} that meets {count} other faces (face {})", format_position(at), face.source)
        };
        Error::NotASolid {
            path: self.path.to_path_buf(),
            what: format!(
                "its {} faces meet in more than {} pairs, so the inside is ambiguous",
                self.planes.len(),
                self.operands.most_contacts
            ),
            locations: worst.map(describe).into_iter().collect(),
            count: 1,
            advice: "remove the overlapping faces there, or build cells of it (without --brep)".into(),
        }
    }

    /// Returns all pairs of faces with more in common than neighbours have. Of bodies, these are
    /// faces of different bodies, and further faces that touch such faces. Copies are in no pairs;
    /// if only some faces are changed, each is in one, with the first equal face. Progress counts
    /// faces.
    pub(super) fn contacts(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Contact>> {
        let mut bytes = self.bytes;
        let mut all = Vec::new();
        let mut add = |found: Vec<Contact>| self.add(found, &mut all, &mut bytes, memory);
        let every: Vec<u32> =
            (0..self.planes.len() as u32).filter(|face| self.planes[*face as usize].is_some()).collect();
        if !self.operands.changed.is_empty() {
            let is_changed = |face: u32| self.operands.changed[face as usize];
            let changed: Vec<u32> = every.into_iter().filter(|face| is_changed(*face)).collect();
            let is_wanted = |one, other| one != other && (one < other || !is_changed(other));
            self.pairs(&changed, &is_wanted, progress, &mut add)?;
            let copies = self.copies.pairs().filter(|[_, copy]| is_changed(*copy));
            add(copies.map(Contact::of_copy).collect())?;
            return Ok(all);
        }
        if !self.operands.are_bodies {
            self.pairs(&every, &|one, other| one < other, progress, &mut add)?;
            return Ok(all);
        }
        let differ = |one, other| one < other && self.operand(one) != self.operand(other);
        let mut touched = vec![false; self.planes.len()];
        let mut open = Vec::new();
        let mut touch = |contacts: &[Contact], open: &mut Vec<u32>| {
            for face in contacts.iter().flat_map(|contact| contact.faces) {
                if !std::mem::replace(&mut touched[face as usize], true) {
                    open.push(face);
                }
            }
        };
        self.pairs(&every, &differ, progress, &mut |found| {
            touch(&found, &mut open);
            add(found)
        })?;
        // Invariant: at the end, a face with a contact has contacts with all faces that touch it,
        // also of its own body. Newly found faces are processed until there are no more. So each of
        // these faces gets a vertex wherever another one puts one on a common line. Otherwise the
        // edges of two neighbours would be cut at different points, and the surface would be open
        // there.
        let mut seen: HashSet<[u32; 2]> = HashSet::new();
        while !open.is_empty() {
            let faces = std::mem::take(&mut open);
            let same = |one, other| one != other && self.operand(one) == self.operand(other);
            self.pairs(&faces, &same, &SilentProgress(progress), &mut |mut found| {
                found.retain(|contact| {
                    let [one, other] = contact.faces;
                    seen.insert([one.min(other), one.max(other)])
                });
                touch(&found, &mut open);
                add(found)
            })?;
        }
        Ok(all)
    }

    /// Yields, in batches, the wanted contacts of `faces` with other faces. Progress counts the
    /// faces.
    fn pairs(
        &self,
        faces: &[u32],
        is_wanted: &(dyn Fn(u32, u32) -> bool + Sync),
        progress: &dyn Progress,
        each: &mut dyn FnMut(Vec<Contact>) -> Result<()>,
    ) -> Result<()> {
        const TASK: usize = 1 << 10;
        self.make_boxes(progress)?;
        let total = faces.len() as u64;
        let tasks: Vec<&[u32]> = faces.chunks(TASK).collect();
        for tasks in tasks.chunks(64) {
            progress.check()?;
            let found = parallel::map(tasks, |faces| {
                let mut found = Vec::new();
                let mut others = Vec::new();
                for &one in *faces {
                    if progress.interrupted() {
                        break;
                    }
                    let own = self.bounds(one);
                    others.clear();
                    self.boxes().each(&|bounds| touch(bounds, &own), |other| {
                        if is_wanted(one, other) {
                            others.push(other);
                        }
                    });
                    sort::numbers32(&mut others);
                    found.extend(
                        others.iter().filter_map(|other| self.contact(one, *other, Wanted::Irregular)),
                    );
                }
                progress.advance(faces.len() as u64, total);
                found
            });
            found.into_iter().try_for_each(&mut *each)?;
        }
        Ok(())
    }

    fn contact(&self, one: u32, other: u32, wanted: Wanted) -> Option<Contact> {
        let mut contact =
            Contact { faces: [one, other], segments: Vec::new(), points: Vec::new(), may_overlap: false };
        let (plane_a, plane_b) = (self.plane(one), self.plane(other));
        if let (Some(a), Some(b)) = (self.triangle(one), self.triangle(other)) {
            match meet(&a, plane_a, &b, plane_b) {
                Meeting::SharedVertex(point) if wanted == Wanted::All => contact.points.push(point),
                Meeting::SharedEdge(ends) if wanted == Wanted::All => contact.segments.push(ends),
                Meeting::Nothing | Meeting::SharedVertex(_) | Meeting::SharedEdge(_) => {}
                Meeting::Point(point) => contact.points.push(point),
                Meeting::Segment(ends) => contact.segments.push(ends),
                Meeting::InPlane => contact.may_overlap = true,
            }
        } else if plane_a.is(plane_b) {
            contact.may_overlap = self.may_overlap(one, other);
        } else {
            // (As whole polygons: edges between a polygon's triangles would divide other faces.)
            let Common { segments, points, edges, corners } =
                common(&self.polygon(one), &self.polygon(other));
            (contact.segments, contact.points) = (segments, points);
            if wanted == Wanted::All {
                contact.segments.extend(edges);
                contact.points.extend(corners);
            }
        }
        let is_contact = contact.may_overlap || !contact.segments.is_empty() || !contact.points.is_empty();
        is_contact.then_some(contact)
    }

    /// Whether two faces of one plane whose boxes touch may overlap: exact for on-grid faces, see
    /// [`Contact::may_overlap`].
    fn may_overlap(&self, one: u32, other: u32) -> bool {
        if self.exact(one).is_some() || self.exact(other).is_some() {
            // (Coplanar faces of one body overlap only if they have opposite orientations.)
            let is_one = self.operands.are_bodies && self.operand(one) == self.operand(other);
            return !(is_one && self.plane(one).is_turned_as(self.plane(other)));
        }
        let (plane_a, plane_b) = (self.plane(one), self.plane(other));
        self.with_triangles(one, |a| {
            self.with_triangles(other, |b| {
                let mut pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
                pairs.any(|(a, b)| matches!(meet(a, plane_a, b, plane_b), Meeting::InPlane))
            })
        })
    }
}
