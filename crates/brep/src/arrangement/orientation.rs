//! Orientation of the parts of a surface: which of them are inside out, and are turned.

use std::collections::{BTreeMap, HashSet};

use super::contact::Contact;
use super::surface::{OFTEN, Surface};
use crate::boxes::{Bounds, union};
use crate::closure::{Closure, Seed};
use crate::exact::union_find::UnionFind;
use spinney_base::{Progress, Result, parallel};

/// Counts of what was turned of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Turned {
    /// Parts that were inside out, and were turned with what is inside of them.
    pub(crate) roots: u64,
    /// Faces of these, and of what is inside of them.
    pub(crate) faces: u64,
    /// The volume of the surface then, in cubes of steps: what it goes around twice counts twice.
    pub(crate) volume: f64,
}

/// Parts of a surface, each of which hangs together in edges, and is closed for itself where the surface is.
struct Parts {
    /// Of each face: the number of its part, which is that of one of its faces.
    of_face: Vec<u32>,
    /// Of each part: six times its volume, the box around it, and its first face that has an area.
    list: BTreeMap<u32, Part>,
}

struct Part {
    volume: i128,
    bounds: Bounds,
    first: Option<u32>,
}

impl Surface<'_> {
    /// Turns those parts of a surface that nothing else is around and that are inside out, with all parts that they are around: cavities
    /// stay cavities. What a part touches it is not around.
    pub(super) fn turn_roots(&mut self, contacts: &[Contact], progress: &dyn Progress) -> Result<Turned> {
        let Parts { of_face, list } = self.parts(progress)?;
        let total = |sign: &dyn Fn(u32) -> i128| -> i128 {
            list.iter().map(|(number, part)| sign(*number) * part.volume).sum()
        };
        // (Six times: in whole numbers, so that no sum is rounded.)
        let steps = |volume: i128| volume as f64 / 6.0;
        if list.values().all(|part| part.volume >= 0) {
            return Ok(Turned { volume: steps(total(&|_| 1)), ..Turned::default() });
        }
        let pairs = contacts.iter().map(|contact| contact.faces.map(|face| of_face[face as usize]));
        let touching: HashSet<[u32; 2]> = pairs.flat_map(|[a, b]| [[a, b], [b, a]]).collect();
        let numbered: Vec<(u32, &Part)> = list.iter().map(|(number, part)| (*number, part)).collect();
        let around = parallel::map(&numbered, |(number, part)| {
            if progress.interrupted() {
                return Vec::new();
            }
            let holds = |other: u32| {
                let [low, high] = &list[&other].bounds;
                let [own_low, own_high] = &part.bounds;
                other != *number
                    && !touching.contains(&[*number, other])
                    && (0..3).all(|axis| low[axis] < own_low[axis] && own_high[axis] < high[axis])
            };
            self.around(part, &of_face, &holds)
        });
        progress.check()?;
        let mut around_of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for ((number, _), around) in numbered.iter().zip(around) {
            around_of.insert(*number, around);
        }
        // Invariant: a part is turned if its root is, and for no other reason, so that what is around what
        // stays the same. What is around a part has all of its box, so that no part is around one that is
        // around it, and each has a root: of several, which pass through each other, the least.
        let is_root = |number: u32| around_of[&number].is_empty();
        let root = |number: u32| {
            let others = around_of[&number].iter().copied().filter(|other| is_root(*other));
            others.min_by_key(|other| extent(&list[other].bounds)).unwrap_or(number)
        };
        let is_turned = |number: u32| list[&root(number)].volume < 0;
        let turned: HashSet<u32> = list.keys().copied().filter(|number| is_turned(*number)).collect();
        self.turned = of_face.iter().map(|part| turned.contains(part)).collect();
        Ok(Turned {
            roots: turned.iter().filter(|number| is_root(**number)).count() as u64,
            faces: self.turned.iter().filter(|turned| **turned).count() as u64,
            volume: steps(total(&|number| if turned.contains(&number) { -1 } else { 1 })),
        })
    }

    fn parts(&self, progress: &dyn Progress) -> Result<Parts> {
        let mut sets = UnionFind::new(self.planes.len());
        let edges = self.sorted_edges(progress)?;
        let manifold = edges.chunk_by(|a, b| a.0 == b.0).filter(|faces| faces.len() == 2);
        manifold.for_each(|faces| _ = sets.join(faces[0].1, faces[1].1));
        progress.check()?;
        // Bodies that touch have edges in common, and are parts of their own, each closed; what is not closed goes
        // on at such edges.
        let seed = Seed::new();
        let mut closures: BTreeMap<u32, Closure> = BTreeMap::new();
        for (face, part) in (0..).zip(sets.roots()) {
            look(face, progress)?;
            closures.entry(part).or_insert_with(|| Closure::new(seed)).add(&self.face(face));
        }
        let open: HashSet<u32> =
            closures.into_iter().filter(|(_, closure)| !closure.is_closed()).map(|(part, _)| part).collect();
        let first_roots = sets.roots();
        let is_open = |face: u32| open.contains(&first_roots[face as usize]);
        for faces in edges.chunk_by(|a, b| a.0 == b.0).filter(|faces| faces.len() > 2) {
            let mut open = faces.iter().map(|(_, face)| *face).filter(|face| is_open(*face));
            if let Some(first) = open.next() {
                open.for_each(|other| _ = sets.join(first, other));
            }
        }
        progress.check()?;
        let of_face = sets.roots();
        let mut list: BTreeMap<u32, Part> = BTreeMap::new();
        for (face, part) in (0..).zip(&of_face) {
            look(face, progress)?;
            let (volume, bounds) = (self.face(face).six_volumes(), self.bounds(face));
            let first = self.planes[face as usize].is_some().then_some(face);
            list.entry(*part)
                .and_modify(|part| {
                    part.volume += volume;
                    part.bounds = union(part.bounds, &bounds);
                    part.first = part.first.or(first);
                })
                .or_insert(Part { volume, bounds, first });
        }
        Ok(Parts { of_face, list })
    }

    /// Those of some parts that are around a part, by a point of it.
    fn around(&self, part: &Part, of_face: &[u32], may_be: &dyn Fn(u32) -> bool) -> Vec<u32> {
        let Some(first) = part.first else { return Vec::new() };
        let mut windings: BTreeMap<u32, i32> = BTreeMap::new();
        self.each_above(&self.sample_of(first), &mut |face, up| {
            *windings.entry(of_face[face as usize]).or_default() += up;
        });
        windings.retain(|other, winding| *winding != 0 && may_be(*other));
        windings.into_keys().collect()
    }
}

/// Looks at whether to go on, at few of the faces.
fn look(face: u32, progress: &dyn Progress) -> Result<()> {
    if face.is_multiple_of(OFTEN) { progress.check() } else { Ok(()) }
}

/// The volume of a box.
fn extent([low, high]: &Bounds) -> u128 {
    (0..3).map(|axis| u128::from(high[axis].abs_diff(low[axis]))).product()
}
