//! Exact arrangements, and their rounding to the grid.
//!
//! [`divide`] divides surfaces by each other once, exactly. [`round`] moves the new vertices to the
//! grid. The rounded faces may intersect where the surface is thinner than a grid unit.
//! `Rounded::mended` then repeats two operations: divide the rounded faces by each other, and snap
//! edges to the moved vertices that they pass closer than a grid unit ([`snap`]).
//!
//! Each repetition may make new intersections, and nothing guarantees that they die out. So at most
//! four repetitions follow the first division. The limit bounds the time and also `reach`: rounding
//! and the first division add 1 grid unit each, and each repetition 2, for snapping and dividing,
//! so at most 10 in all. Mending stops early if it diverges: if more than 100 faces are divided and
//! more than twice as many as at first, or if there are more than `4 * crossings + 1000` contacts.
//!
//! If mending succeeds, dividing the surface again would divide and remove no face, all faces are
//! planar with vertices on the grid, the open edges, at which the surface meets other faces, are
//! unchanged, and no body is lost (`Components`). Otherwise the unmended surface is used. It is
//! still closed, and the model's builder reports where it intersects itself. The exact faces are
//! kept in both cases, so further operations do not depend on mending.
//!
//! Only contacts between faces of the list are found. If the list is a fragment of a surface,
//! nothing keeps mended faces off the surface's other faces: see [`Surroundings`].

use std::collections::{HashMap, HashSet};
use std::mem;
use std::path::Path;

use super::exact_face::{ExactFace, ExactFaces};
use super::operands::{Operands, OtherFaces};
use super::point::ExactPlane;
use super::resolve::{RemainingFace, Resolved, resolve};
use super::rounding::Rounder;
use super::seams::Seams;
use super::snapping::{EachFace, snap};
use super::surface::{OFTEN, contacts_of, too_large};
use crate::exact::normal::ring_normal;
use crate::exact::union_find::UnionFind;
use crate::planar::PlanarFaces;
use crate::{Face, FaceList, Faces};
use spinney_base::{Error, Progress, Result, SilentProgress, sort};

/// Returns the faces that bound the inside of some closed surfaces, exactly. `path` is for errors.
/// Progress counts each face twice.
///
/// # Errors
/// If `memory` bytes are insufficient, or on cancellation.
pub(crate) fn divide(
    faces: &ExactFaces,
    operands: &Operands<'_>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(ExactFaces, Resolved)> {
    let mut found =
        ExactFaces::of_grid(FaceList::new(faces.list.grid().clone(), faces.list.parts().to_vec()));
    let (mut turner, mut part_bytes) = (Turner::default(), 0);
    let resolved = resolve(faces, operands, path, memory, progress, &mut |kept| {
        match kept {
            RemainingFace::Whole { face, is_turned } => match faces.exact.get(&(face.number as u32)) {
                Some(exact) => {
                    let exact = if is_turned { exact.turned() } else { exact.clone() };
                    found.push(ExactFace { part: face.part, ..exact });
                }
                None if is_turned => found.list.push(&turner.turn(&face)),
                None => found.list.push(&face),
            },
            RemainingFace::Region { exact, .. } => {
                // (Where very many faces meet, their regions take much more memory than the faces.)
                part_bytes += exact.bytes();
                if part_bytes > memory {
                    return Err(too_large(path, part_bytes, memory));
                }
                found.push(exact);
            }
        }
        Ok(())
    })?;
    Ok((found, resolved))
}

/// Surroundings of the faces of a list.
///
/// The winding numbers assume that the surface's other faces intersect none of the list, but only
/// the caller can know: `on_grid` in [`combine`](crate::combine()) describes when they may.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    /// Whether infinity is inside.
    pub(crate) is_unbounded: bool,
    /// Maximum distance of the surface's other proxies from their exact faces, in grid units.
    pub(crate) reach: u8,
    /// The surface's other faces, if there are any.
    pub(crate) rest: Option<&'a OtherFaces<'a>>,
}

/// A surface or a part of one on the grid, with its exact faces.
#[derive(Clone)]
pub(crate) struct Rounded {
    /// Planar faces with vertices on the grid.
    pub(crate) faces: FaceList,
    /// Whether each of them is a proxy.
    pub(crate) is_proxy: Vec<bool>,
    /// The exact faces of the proxies.
    pub(crate) exact: Vec<ExactFace>,
    /// Whether each face is new, and may intersect others.
    changed: Vec<bool>,
    /// Component of each face, while the surface is mended; else empty.
    component: Vec<u32>,
    /// Vertices that were moved.
    moved: Vec<[i32; 3]>,
    /// Maximum distance that one was moved, in grid units.
    pub(crate) displacement: f64,
    /// Maximum distance of proxies from their exact faces, in grid units.
    pub(crate) reach: u8,
}

/// Moves the vertices of a surface to the grid.
///
/// # Errors
/// On cancellation.
pub(crate) fn round(exact: ExactFaces, progress: &dyn Progress) -> Result<Rounded> {
    let mut rounder = Rounder::default();
    let ExactFaces { list, exact: mut exact_faces } = exact;
    let is_proxy: Vec<bool> =
        (0..list.len() as u32).map(|number| exact_faces.contains_key(&number)).collect();
    let whole = Rounded {
        faces: list,
        is_proxy,
        exact: Vec::new(),
        changed: Vec::new(),
        component: Vec::new(),
        moved: Vec::new(),
        displacement: 0.0,
        reach: 1,
    };
    let (mut rounded, ()) = whole.replace_faces(|faces, each| {
        for number in 0..faces.list.len() as u32 {
            if number.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            match exact_faces.get(&number) {
                Some(exact) => {
                    rounder.round(exact, &mut |face| each(&Face { number: number.into(), ..*face }, true))?;
                }
                None => each(&faces.list.get(number as usize), false)?,
            }
        }
        Ok(())
    })?;
    let mut numbers: Vec<u32> = exact_faces.keys().copied().collect();
    sort::numbers32(&mut numbers);
    rounded.exact.extend(numbers.into_iter().filter_map(|number| exact_faces.remove(&number)));
    rounded.record_moves(rounder);
    Ok(rounded)
}

impl Rounded {
    /// Adds a rounder's moved vertices and maximum displacement to those of the surface.
    fn record_moves(&mut self, rounder: Rounder) {
        self.displacement = self.displacement.max(rounder.displacement);
        self.moved.extend(rounder.corners);
    }

    /// Counts the contacts of faces that were moved: pairs with more in common than neighbours
    /// have.
    ///
    /// # Errors
    /// If `memory` bytes are insufficient, or on cancellation.
    pub(crate) fn crossings(&mut self, path: &Path, memory: u64, progress: &dyn Progress) -> Result<u64> {
        if !self.changed.contains(&true) {
            return Ok(0);
        }
        let none = FaceList::new(self.faces.grid().clone(), Vec::new());
        let faces = ExactFaces::of_grid(mem::replace(&mut self.faces, none));
        let ends = [faces.list.len() as u32];
        let found = contacts_of(&faces, &operands(&ends, &[0], &self.changed), path, memory, progress);
        self.faces = faces.list;
        found.map(|found| found.len() as u64)
    }

    /// Closes the surface at open `seams`. If there are `crossings`, also mends the surface, which
    /// is thinner than a grid unit there. If mending fails or exceeds the memory, the unmended
    /// surface is returned, and a model's builder reports where it intersects itself.
    ///
    /// (A repair calls this in any case. A set operation calls it only if there are crossings.
    /// Otherwise it closes the seams while it writes the settled faces, which saves a pass.)
    ///
    /// # Errors
    /// On cancellation, or if the surroundings cannot be read.
    pub(crate) fn stitch_and_mend(
        mut self,
        seams: Seams,
        crossings: u64,
        surroundings: &Surroundings<'_>,
        path: &Path,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Rounded> {
        let width = self.reach.max(surroundings.reach);
        seams.close(width, self.faces.is_coloured(), &mut |face| {
            self.faces.push(face);
            self.is_proxy.push(true);
            self.changed.push(true);
            Ok(())
        })?;
        if crossings == 0 {
            return Ok(self);
        }
        // (The exact faces do not change; mending may add others.)
        let mut exact = mem::take(&mut self.exact);
        let mut surface = match self.clone().mended(crossings, surroundings, path, memory, progress) {
            Ok((mended, true)) => mended,
            Ok(_) | Err(Error::NotASolid { .. } | Error::TooLarge { .. }) => self,
            Err(error) => return Err(error),
        };
        exact.append(&mut surface.exact);
        Ok(Rounded { exact, ..surface })
    }

    /// Removes intersections that rounding caused, in a limited number of repetitions. Returns
    /// whether it succeeded: nothing is left to divide, no body is lost, and the surface still has
    /// the same open edges, so that it fits the faces around it.
    ///
    /// # Errors
    /// If `memory` bytes are insufficient, on cancellation, or if the surroundings cannot be read.
    fn mended(
        self,
        crossings: u64,
        surroundings: &Surroundings<'_>,
        path: &Path,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<(Rounded, bool)> {
        /// Maximum count of repetitions. See the module's documentation.
        const MAX_REPETITIONS: u32 = 4;
        // (If there are many more contacts than at first, mending diverges.)
        let most_contacts = 4 * crossings + 1000;
        let mut repetitions = 0;
        let far = [i32::from(surroundings.is_unbounded)];
        let mut border = Seams::default();
        border.add_all(&self.faces, progress)?;
        let mut state = self;
        let components = Components::of(&state.faces, progress)?;
        state.component.clone_from(&components.of_face);
        let mut first = None;
        loop {
            let (ends, changed) = ([state.faces.len() as u32], state.changed.clone());
            let operands =
                Operands { most_contacts, rest: surroundings.rest, ..operands(&ends, &far, &changed) };
            let mut rounder = Rounder::default();
            let (next, Resolved { divided, removed, .. }) = state.replace_faces(|faces, each| {
                let mut turner = Turner::default();
                resolve(faces, &operands, path, memory, &SilentProgress(progress), &mut |kept| match kept {
                    RemainingFace::Whole { face, is_turned: false } => each(&face, false),
                    RemainingFace::Whole { face, is_turned: true } => each(&turner.turn(&face), true),
                    RemainingFace::Region { face, exact } => {
                        rounder.round(&exact, &mut |part| each(&Face { number: face.number, ..*part }, true))
                    }
                })
            })?;
            state = next;
            state.record_moves(rounder);
            state.reach = state.reach.saturating_add(1);
            let first = *first.get_or_insert(divided.max(50));
            if divided + removed == 0 || repetitions == MAX_REPETITIONS || divided > 2 * first {
                let mut now = Seams::default();
                now.add_all(&state.faces, progress)?;
                let is_done = divided + removed == 0
                    && now.has_same_open_edges(&border)
                    && components.are_kept(&state.component, state.reach);
                state.component.clear();
                return Ok((state, is_done));
            }
            repetitions += 1;
            if divided > 0 {
                // Moving vertices has made new intersections. Snapping collapses what is thinner
                // than a grid unit.
                let (moved, changed) = (state.moved.clone(), state.changed.clone());
                state =
                    state.replace_faces(|faces, each| snap(&faces.list, &moved, &changed, progress, each))?.0;
                state.reach = state.reach.saturating_add(1);
            }
        }
    }

    /// Replaces the faces by the output of `make`, as planar faces.
    ///
    /// An on-grid face that is not a proxy and does not come back unchanged is added to the exact
    /// faces, also if it was reversed or removed. That is right since the exact surface is defined
    /// as the one before rounding and mending: the face belongs to it, and what comes back is its
    /// proxy. (Mending removes and reverses faces only because rounding folded the surface there.)
    fn replace_faces<R>(
        self,
        make: impl FnOnce(&ExactFaces, &mut EachFace<'_>) -> Result<R>,
    ) -> Result<(Rounded, R)> {
        let Rounded { faces, is_proxy, mut exact, component, moved, displacement, reach, .. } = self;
        let faces = ExactFaces::of_grid(faces);
        let old = &faces.list;
        let mut list = FaceList::new(old.grid().clone(), old.parts().to_vec());
        let mut planar = PlanarFaces::default();
        planar.is_coloured = old.is_coloured();
        let (mut changed, mut still, mut kept) = (Vec::new(), Vec::new(), Vec::new());
        // Whether each face comes back unchanged.
        let mut is_back = vec![false; is_proxy.len()];
        let result = make(&faces, &mut |face, is_new| {
            let number = face.number as usize;
            planar.face(face, &mut |face| {
                let is_same = !is_new && face.points == old.get(number).points;
                list.push(face);
                changed.push(is_new);
                still.push(is_same && !is_proxy[number]);
                kept.extend(component.get(number));
                is_back[number] |= is_same;
                Ok(())
            })
        })?;
        for (number, _) in
            is_back.iter().enumerate().filter(|(number, is_back)| !**is_back && !is_proxy[*number])
        {
            let face = old.get(number);
            let normal = ring_normal(face.rings().next().unwrap_or_default());
            if normal != [0; 3] {
                exact.push(ExactFace::of_grid(&face, &ExactPlane::through(face.points[0], normal)));
            }
        }
        // Invariant: `changed` and `is_proxy` have an entry for each face of the list, in order:
        // all three are appended to together. Set operations index `is_proxy` by face number.
        debug_assert!(changed.len() == list.len() as usize && still.len() == changed.len());
        let is_proxy = still.into_iter().map(|still| !still).collect();
        Ok((
            Rounded { faces: list, is_proxy, exact, changed, component: kept, moved, displacement, reach },
            result,
        ))
    }
}

/// Components of a surface, whose faces have edges in common, and their sizes.
///
/// Mending may lose a whole component: its faces are removed if a sample is on the wrong side of a
/// face that is not in the list. A closed component leaves no open edge then.
struct Components {
    /// The component of each face: the number of its first face.
    of_face: Vec<u32>,
    /// Twice the area, and six times the volume, by that number; the volume is meaningless for
    /// open components, which open edges protect.
    sizes: HashMap<u32, [f64; 2]>,
}

impl Components {
    fn of(faces: &FaceList, progress: &dyn Progress) -> Result<Components> {
        let mut sets = UnionFind::new(faces.len() as usize);
        let mut first_at: HashMap<[[i32; 3]; 2], u32> = HashMap::new();
        for number in 0..faces.len() as u32 {
            if number.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            for ring in faces.get(number as usize).rings() {
                let ends = ring.iter().zip(ring.iter().cycle().skip(1));
                for (&from, &to) in ends {
                    let edge = [from.min(to), from.max(to)];
                    sets.join(*first_at.entry(edge).or_insert(number), number);
                }
            }
        }
        let of_face: Vec<u32> = (0..faces.len() as u32).map(|number| sets.root(number)).collect();
        let mut sizes: HashMap<u32, [f64; 2]> = HashMap::new();
        for (number, root) in of_face.iter().enumerate() {
            let face = faces.get(number);
            // (Near the component, where differences are exact.)
            let origin = faces.get(*root as usize).points[0];
            let [area, volume] = sizes.entry(*root).or_default();
            for ring in face.rings() {
                let normal = ring_normal(ring).map(|part| part as f64);
                let from = [0, 1, 2].map(|axis| f64::from(ring[0][axis]) - f64::from(origin[axis]));
                *area += normal.iter().map(|part| part * part).sum::<f64>().sqrt();
                *volume += normal.iter().zip(from).map(|(part, at)| part * at).sum::<f64>();
            }
        }
        Ok(Components { of_face, sizes })
    }

    /// Whether each component still has one of the faces, except for components so thin that a
    /// displacement of `reach` grid units may collapse them.
    fn are_kept(&self, of_face: &[u32], reach: u8) -> bool {
        let kept: HashSet<u32> = of_face.iter().copied().collect();
        // A layer of the thickness `reach` has the volume `reach * area / 2`, both sides counted.
        let is_thin = |[area, volume]: &[f64; 2]| volume.abs() / 6.0 <= f64::from(reach) * area / 4.0;
        self.sizes.iter().all(|(root, size)| kept.contains(root) || is_thin(size))
    }
}

/// Returns the operands for one surface on the grid: points with a positive winding number are
/// inside.
fn operands<'a>(ends: &'a [u32], far: &'a [i32], changed: &'a [bool]) -> Operands<'a> {
    Operands { ends, far, changed, is_inside: &|windings| windings[0] > 0, ..Operands::NONE }
}

/// Reverses faces; keeps its buffers from face to face.
#[derive(Default)]
pub(crate) struct Turner {
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
}

impl Turner {
    pub(crate) fn turn<'a>(&'a mut self, face: &Face<'a>) -> Face<'a> {
        self.points.clear();
        self.colours.clear();
        let mut start = 0;
        for &end in face.ring_ends {
            self.points.extend(face.points[start..end].iter().rev());
            if !face.colours.is_empty() {
                self.colours.extend(face.colours[start..end].iter().rev());
            }
            start = end;
        }
        Face { points: &self.points, colours: &self.colours, ..*face }
    }
}
