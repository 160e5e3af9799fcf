//! Orientation of a surface's components: finds those that are inside out, and reverses them.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use super::contact::Contact;
use super::surface::{OFTEN, Surface};
use crate::Face;
use crate::boxes::{Bounds, bounds_of, union};
use crate::closure::{Closure, Seed};
use crate::exact::union_find::UnionFind;
use spinney_base::{Progress, Result, parallel};

/// Report of the components that were reversed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Turned {
    /// Outermost components that were inside out, and were reversed with all components inside.
    pub(crate) roots: u64,
    /// Faces of these components and of those inside.
    pub(crate) faces: u64,
    /// Volume of the surface after that, in cubic grid units. What the surface winds around twice
    /// counts twice.
    pub(crate) volume: f64,
}

/// Components of a surface, connected by edges. Each is closed if the surface is.
pub(crate) struct SurfaceComponents {
    /// Component of each face: the number of its first face.
    pub(crate) of_face: UnionFind,
    /// Per component: six times its volume, its box, and its first face with an area.
    pub(crate) list: BTreeMap<u32, SurfaceComponent>,
}

pub(crate) struct SurfaceComponent {
    pub(crate) volume: i128,
    pub(crate) bounds: Bounds,
    pub(crate) first: Option<u32>,
}

/// Receives the faces at an edge, or a face.
type EdgeVisitor<'a> = dyn FnMut(&[u32]) -> Result<()> + 'a;
type FaceVisitor<'a> = dyn FnMut(u32, &Face<'_>) -> Result<()> + 'a;

impl SurfaceComponents {
    /// Returns the components of `count` faces. `edges` yields the faces at each undirected edge,
    /// `faces` all faces in the order of their numbers.
    pub(crate) fn of(
        count: u64,
        edges: &dyn Fn(&mut EdgeVisitor<'_>) -> Result<()>,
        faces: &dyn Fn(&mut FaceVisitor<'_>) -> Result<()>,
    ) -> Result<SurfaceComponents> {
        let mut sets = UnionFind::new(count as usize);
        edges(&mut |faces| {
            if let [one, other] = faces {
                sets.join(*one, *other);
            }
            Ok(())
        })?;
        // Bodies that touch share edges, but are closed components of their own. Components that
        // are not closed are joined at such edges.
        let seed = Seed::new();
        let mut closures: HashMap<u32, Closure> = HashMap::new();
        faces(&mut |number, face| {
            closures.entry(sets.root(number)).or_insert_with(|| Closure::new(seed)).add(face);
            Ok(())
        })?;
        // Invariant: whether a component is open is that of the components before any was joined.
        // A root that is joined stays the number of one of them, and all that are joined are open.
        let open: HashSet<u32> = closures
            .into_iter()
            .filter(|(_, closure)| !closure.is_closed())
            .map(|(component, _)| component)
            .collect();
        edges(&mut |faces| {
            let mut first = None;
            for &face in faces.iter().filter(|_| faces.len() > 2) {
                if open.contains(&sets.root(face)) {
                    sets.join(*first.get_or_insert(face), face);
                }
            }
            Ok(())
        })?;
        let mut list: BTreeMap<u32, SurfaceComponent> = BTreeMap::new();
        faces(&mut |number, face| {
            let (volume, bounds) = (face.six_volumes(), bounds_of(face.points, 0));
            let first = face.has_area().then_some(number);
            list.entry(sets.root(number))
                .and_modify(|component| {
                    component.volume += volume;
                    component.bounds = union(component.bounds, &bounds);
                    component.first = component.first.or(first);
                })
                .or_insert(SurfaceComponent { volume, bounds, first });
            Ok(())
        })?;
        Ok(SurfaceComponents { of_face: sets, list })
    }

    /// Returns the volume in cubic grid units, after some components are reversed.
    pub(crate) fn volume(&self, is_turned: impl Fn(u32) -> bool) -> f64 {
        let of = |(number, component): (&u32, &SurfaceComponent)| {
            if is_turned(*number) { -component.volume } else { component.volume }
        };
        // (Six times the volume is an integer, so sums are exact.)
        self.list.iter().map(of).sum::<i128>() as f64 / 6.0
    }

    /// Whether no component is inside out.
    pub(crate) fn are_upright(&self) -> bool {
        self.list.values().all(|component| component.volume >= 0)
    }
}

impl SurfaceComponent {
    /// Whether the box of a component with a larger volume contains this one's box. (A component is
    /// inside of larger ones only. So of two with equal boxes, at most one is around the other.)
    pub(crate) fn may_be_in(&self, other: &SurfaceComponent) -> bool {
        let ([own_low, own_high], [low, high]) = (&self.bounds, &other.bounds);
        (0..3).all(|axis| low[axis] <= own_low[axis] && own_high[axis] <= high[axis])
            && self.volume.unsigned_abs() < other.volume.unsigned_abs()
    }

    /// Whether another component, without contacts to this one, may be around it. (Two components
    /// without contacts share at most vertices and edges.)
    pub(crate) fn may_be_inside(&self, other: &SurfaceComponent) -> bool {
        let ([own_low, own_high], [low, high]) = (&self.bounds, &other.bounds);
        self.may_be_in(other) || (0..3).all(|axis| low[axis] < own_low[axis] && own_high[axis] < high[axis])
    }
}

/// Returns the components to reverse, and how many of them are outermost, from the components that
/// are around each one.
pub(crate) fn root_components(
    list: &BTreeMap<u32, SurfaceComponent>,
    around_of: &BTreeMap<u32, Vec<u32>>,
) -> (HashSet<u32>, u64) {
    // Invariant: a component is reversed if and only if its root is, so the nesting does not
    // change. A component around another one contains its box and is larger. So the nesting has no
    // cycles, and each component has a root; of several, which intersect, the smallest.
    let is_root = |number: u32| around_of[&number].is_empty();
    let least = |others: &mut dyn Iterator<Item = u32>| {
        others.min_by_key(|other| (extent(&list[other].bounds), *other))
    };
    let root = |number: u32| {
        /// Limit for nested components, of which not all are found to be around the innermost.
        const MAX_HOPS: usize = 64;
        let mut at = number;
        for _ in 0..MAX_HOPS {
            let around = || around_of[&at].iter().copied();
            let roots = least(&mut around().filter(|other| is_root(*other)));
            match roots.or_else(|| least(&mut around())) {
                Some(next) => at = next,
                None => break,
            }
        }
        at
    };
    let is_turned = |number: u32| list[&root(number)].volume < 0;
    let turned: HashSet<u32> = list.keys().copied().filter(|number| is_turned(*number)).collect();
    let roots = turned.iter().filter(|number| is_root(**number)).count() as u64;
    (turned, roots)
}

impl Surface<'_> {
    /// Reverses the outermost components that are inside out, with all components inside of them.
    /// So cavities stay cavities. That includes cavities that touch the component around them: a
    /// pit whose lid lies in a face of the body, or a cavity that shares a vertex with the body.
    pub(super) fn turn_roots(&mut self, contacts: &[Contact], progress: &dyn Progress) -> Result<Turned> {
        let mut components = self.edge_components(progress)?;
        if components.are_upright() {
            return Ok(Turned { volume: components.volume(|_| false), ..Turned::default() });
        }
        let mut of_face = components.of_face.roots();
        for [first, copy] in self.copies.pairs() {
            of_face[copy as usize] = of_face[first as usize];
        }
        let list = &components.list;
        let pairs = contacts.iter().map(|contact| contact.faces.map(|face| of_face[face as usize]));
        let touching: HashSet<[u32; 2]> = pairs.flat_map(|[a, b]| [[a, b], [b, a]]).collect();
        let numbered: Vec<(u32, &SurfaceComponent)> =
            list.iter().map(|(number, component)| (*number, component)).collect();
        // Faces of the components that touch others.
        let mut touched: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for [component, other] in touching.iter().filter(|[component, other]| component != other) {
            touched.entry(*component).or_default().insert(*other);
        }
        let mut faces_of: BTreeMap<u32, Vec<u32>> =
            touched.keys().map(|component| (*component, Vec::new())).collect();
        for (face, component) in (0..).zip(&of_face).filter(|(face, _)| self.planes[*face as usize].is_some())
        {
            if let Some(faces) = faces_of.get_mut(component) {
                faces.push(face);
            }
        }
        progress.check()?;
        let around = parallel::map(&numbered, |(number, component)| {
            if progress.interrupted() {
                return Vec::new();
            }
            let may_be = touched.get(number).into_iter().flatten().copied();
            let may_be: Vec<u32> = may_be.filter(|other| component.may_be_in(&list[other])).collect();
            let faces = faces_of.get(number).map_or(&[][..], Vec::as_slice);
            let touched = self.around_touching(faces, &of_face, &may_be);
            let holds = |other: u32| {
                other != *number
                    && !touching.contains(&[*number, other])
                    && component.may_be_inside(&list[&other])
            };
            let mut around = self.around(component, &of_face, &holds);
            around.extend(touched);
            around
        });
        progress.check()?;
        let mut around_of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for ((number, _), around) in numbered.iter().zip(around) {
            around_of.insert(*number, around);
        }
        let (turned, roots) = root_components(list, &around_of);
        self.turned = of_face.iter().map(|component| turned.contains(component)).collect();
        Ok(Turned {
            roots,
            faces: self.turned.iter().filter(|turned| **turned).count() as u64,
            volume: components.volume(|number| turned.contains(&number)),
        })
    }

    fn edge_components(&self, progress: &dyn Progress) -> Result<SurfaceComponents> {
        let sorted = self.sorted_edges(progress)?;
        let edges = |each: &mut EdgeVisitor<'_>| {
            let mut faces = Vec::new();
            for (number, edge) in sorted.chunk_by(|a, b| a.0 == b.0).enumerate() {
                check_often(number as u32, progress)?;
                faces.clear();
                faces.extend(edge.iter().map(|(_, face)| *face));
                each(&faces)?;
            }
            Ok(())
        };
        let faces = |each: &mut FaceVisitor<'_>| {
            (0..self.planes.len() as u32).try_for_each(|face| {
                check_often(face, progress)?;
                (0..self.copies.count(face)).try_for_each(|_| each(face, &self.face(face)))
            })
        };
        SurfaceComponents::of(self.planes.len() as u64, &edges, &faces)
    }

    /// Returns those candidates that are around a component, from one sample point.
    fn around(
        &self,
        component: &SurfaceComponent,
        of_face: &[u32],
        may_be: &dyn Fn(u32) -> bool,
    ) -> Vec<u32> {
        let Some(first) = component.first else { return Vec::new() };
        let mut windings: BTreeMap<u32, i32> = BTreeMap::new();
        self.each_above(&self.sample_of(first), &mut |face, up| {
            *windings.entry(of_face[face as usize]).or_default() += up;
        });
        windings.retain(|other, winding| *winding != 0 && may_be(*other));
        windings.into_keys().collect()
    }
}

/// Maximum count of sampled faces of a component. If a component is inside of one that it touches,
/// all samples that are not on the other one are inside of it.
pub(crate) const SAMPLES: usize = 256;

impl Surface<'_> {
    /// Returns those candidates that are around a component that touches them, from samples of its
    /// faces. All samples that are not on the other component must be inside of it. A component
    /// that intersects the other one fails this test.
    fn around_touching(&self, faces: &[u32], of_face: &[u32], may_be: &[u32]) -> Vec<u32> {
        if may_be.is_empty() {
            return Vec::new();
        }
        // Per candidate: whether a sample is outside of it, and whether one is inside.
        let mut sides = vec![[false; 2]; may_be.len()];
        let index = |face: u32| may_be.binary_search(&of_face[face as usize]).ok();
        let count = faces.len().min(SAMPLES);
        for number in 0..count {
            let sample = self.sample_of(faces[number * faces.len() / count]);
            let mut windings = vec![0; may_be.len()];
            self.each_above(&sample, &mut |face, up| {
                if let Some(index) = index(face) {
                    windings[index] += up;
                }
            });
            let mut is_on = vec![false; may_be.len()];
            self.each_at(&sample, |face| {
                if let Some(index) = index(face)
                    && sample.side(self.plane(face)) == 0
                    && self.meets(&sample, face)
                {
                    is_on[index] = true;
                }
            });
            for ((sides, winding), _) in sides.iter_mut().zip(windings).zip(is_on).filter(|(_, is_on)| !is_on)
            {
                sides[usize::from(winding != 0)] = true;
            }
        }
        let found = may_be.iter().zip(sides).filter(|(_, sides)| *sides == [false, true]);
        found.map(|(component, _)| *component).collect()
    }
}

/// Checks for cancellation at every [`OFTEN`]th face.
fn check_often(face: u32, progress: &dyn Progress) -> Result<()> {
    if face.is_multiple_of(OFTEN) { progress.check() } else { Ok(()) }
}

/// Returns the volume of a box.
fn extent([low, high]: &Bounds) -> u128 {
    (0..3).map(|axis| u128::from(high[axis].abs_diff(low[axis]))).product()
}
