//! Exact arrangements, and their rounding to the grid.
//!
//! [`divide`] divides surfaces by each other once, exactly. [`round`] moves the new vertices to the
//! grid. The rounded faces may intersect where the surface is thinner than a grid unit.
//! `Rounded::mended` then repeats two operations: divide the rounded faces by each other, and snap
//! edges to the moved vertices that they pass closer than a grid unit ([`snap`]).
//!
//! Each repetition may make new intersections, and nothing guarantees that they die out. So at most
//! four repetitions follow the first division. The limit bounds the time and also `reach`, to which
//! each repetition adds at most 2 grid units. Mending stops early if it diverges: if more than 100
//! faces are divided and more than twice as many as at first, or if there are more than
//! `4 * crossings + 1000` contacts.
//!
//! If mending succeeds, dividing the surface again would divide and remove no face, all faces are
//! planar with vertices on the grid, and the open edges, at which the surface meets other faces,
//! are unchanged. Otherwise the unmended surface is used. It is still closed, and the model's
//! builder reports where it intersects itself. The exact faces are kept in both cases, so further
//! operations do not depend on mending.

use std::mem;
use std::path::Path;

use super::exact_face::{ExactFace, ExactFaces};
use super::point::ExactPlane;
use super::rounding::Rounder;
use super::seams::Seams;
use super::snapping::{EachFace, snap};
use super::surface::{Kept, OFTEN, Operands, OtherFaces, Resolved, crossings, resolve, too_large};
use crate::exact::normal::ring_normal;
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
            Kept::Face { face, is_turned } => match faces.exact.get(&(face.number as u32)) {
                Some(exact) => found.push(if is_turned { exact.turned() } else { exact.clone() }),
                None if is_turned => found.list.push(&turner.turn(&face)),
                None => found.list.push(&face),
            },
            Kept::PlaneRegion { exact, .. } => {
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
    let ExactFaces { list, exact: mut beside } = exact;
    let is_proxy: Vec<bool> = (0..list.len() as u32).map(|number| beside.contains_key(&number)).collect();
    let whole = Rounded {
        faces: list,
        is_proxy,
        exact: Vec::new(),
        changed: Vec::new(),
        moved: Vec::new(),
        displacement: 0.0,
        reach: 1,
    };
    let (mut rounded, ()) = whole.again(|faces, each| {
        for number in 0..faces.list.len() as u32 {
            if number.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            match beside.get(&number) {
                Some(exact) => {
                    rounder.round(exact, &mut |face| each(&Face { number: number.into(), ..*face }, true))?;
                }
                None => each(&faces.list.get(number as usize), false)?,
            }
        }
        Ok(())
    })?;
    let mut numbers: Vec<u32> = beside.keys().copied().collect();
    sort::numbers32(&mut numbers);
    rounded.exact.extend(numbers.into_iter().filter_map(|number| beside.remove(&number)));
    rounded.take(rounder);
    Ok(rounded)
}

impl Rounded {
    fn take(&mut self, rounder: Rounder) {
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
        let found = crossings(&faces, &operands(&ends, &[0], &self.changed), path, memory, progress);
        self.faces = faces.list;
        found
    }

    /// Closes the surface at open `seams`. If there are `crossings`, also mends the surface, which
    /// is thinner than a grid unit there. If mending fails or exceeds the memory, the unmended
    /// surface is returned, and a model's builder reports where it intersects itself.
    ///
    /// # Errors
    /// On cancellation, or if the surroundings cannot be read.
    pub(crate) fn closed(
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
        let mut made = match self.clone().mended(crossings, surroundings, path, memory, progress) {
            Ok((mended, true)) => mended,
            Ok(_) | Err(Error::NotASolid { .. } | Error::TooLarge { .. }) => self,
            Err(error) => return Err(error),
        };
        exact.append(&mut made.exact);
        Ok(Rounded { exact, ..made })
    }

    /// Removes intersections that rounding caused, in a limited number of repetitions. Returns
    /// whether it succeeded: nothing is left to divide, and the surface still has the same open
    /// edges, so that it fits the faces around it.
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
        const MAX_ROUNDS: u32 = 4;
        // (If there are many more contacts than at first, mending diverges.)
        let most_contacts = 4 * crossings + 1000;
        let mut rounds = 0;
        let far = [i32::from(surroundings.is_unbounded)];
        let mut border = Seams::default();
        border.add_all(&self.faces, progress)?;
        let mut state = self;
        let mut first = None;
        loop {
            let (ends, changed) = ([state.faces.len() as u32], state.changed.clone());
            let operands =
                Operands { most_contacts, rest: surroundings.rest, ..operands(&ends, &far, &changed) };
            let mut rounder = Rounder::default();
            let (next, Resolved { divided, removed, .. }) = state.again(|faces, each| {
                let mut turner = Turner::default();
                resolve(faces, &operands, path, memory, &SilentProgress(progress), &mut |kept| match kept {
                    Kept::Face { face, is_turned: false } => each(&face, false),
                    Kept::Face { face, is_turned: true } => each(&turner.turn(&face), true),
                    Kept::PlaneRegion { face, exact } => {
                        rounder.round(&exact, &mut |part| each(&Face { number: face.number, ..*part }, true))
                    }
                })
            })?;
            state = next;
            state.take(rounder);
            state.reach = state.reach.saturating_add(1);
            let first = *first.get_or_insert(divided.max(50));
            if divided + removed == 0 || rounds == MAX_ROUNDS || divided > 2 * first {
                let mut now = Seams::default();
                now.add_all(&state.faces, progress)?;
                let is_done = divided + removed == 0 && now.are_those_of(&border);
                return Ok((state, is_done));
            }
            rounds += 1;
            if divided > 0 {
                // Moving vertices has made new intersections. Snapping collapses what is thinner
                // than a grid unit.
                let (moved, changed) = (state.moved.clone(), state.changed.clone());
                state = state.again(|faces, each| snap(&faces.list, &moved, &changed, progress, each))?.0;
                state.reach = state.reach.saturating_add(1);
            }
        }
    }

    /// Collects the output of `make` as planar faces. A face that was not a proxy and does not come
    /// back unchanged is added to the exact faces.
    fn again<R>(
        self,
        make: impl FnOnce(&ExactFaces, &mut EachFace<'_>) -> Result<R>,
    ) -> Result<(Rounded, R)> {
        let Rounded { faces, is_proxy, mut exact, moved, displacement, reach, .. } = self;
        let faces = ExactFaces::of_grid(faces);
        let old = &faces.list;
        let mut list = FaceList::new(old.grid().clone(), old.parts().to_vec());
        let mut planar = PlanarFaces::default();
        planar.is_coloured = old.is_coloured();
        let (mut changed, mut still) = (Vec::new(), Vec::new());
        // Whether each face comes back unchanged.
        let mut is_back = vec![false; is_proxy.len()];
        let made = make(&faces, &mut |face, is_new| {
            let number = face.number as usize;
            planar.face(face, &mut |face| {
                let is_same = !is_new && face.points == old.get(number).points;
                list.push(face);
                changed.push(is_new);
                still.push(is_same && !is_proxy[number]);
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
        Ok((Rounded { faces: list, is_proxy, exact, changed, moved, displacement, reach }, made))
    }
}

/// Returns the operands for one surface on the grid: points with a positive winding number are
/// inside.
fn operands<'a>(ends: &'a [u32], far: &'a [i32], changed: &'a [bool]) -> Operands<'a> {
    Operands {
        ends,
        far,
        are_bodies: false,
        turns_roots: false,
        most_contacts: 0,
        keeps_apart: false,
        changed,
        winding: &|_, _| None,
        rest: None,
        is_inside: &|windings| windings[0] > 0,
    }
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
