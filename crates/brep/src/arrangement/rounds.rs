//! Arrangements, exact and on the grid: bodies are divided by each other once; then their new vertices are moved to the grid,
//! and faces are divided again until that has no more consequences.

use std::path::Path;

use super::exact_face::{ExactFace, ExactFaces};
use super::point::ExactPlane;
use super::rounding::Rounder;
use super::snapping::{EachFace, snap};
use super::surface::{Kept, Operands, Resolved, crossings, resolve};
use crate::exact::normal::ring_normal;
use crate::planar::PlanarFaces;
use crate::{Face, FaceList, Faces};
use spinney_base::{Progress, Result, sort};

/// Counts of what was done to a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rounds {
    /// Pairs of faces that had more in common than neighbours have.
    pub pairs: u64,
    /// Faces that were divided, or of which a part was taken away.
    pub divided: u64,
    /// Faces that were taken away as a whole.
    pub removed: u64,
    /// Those of them that have the outside on both of their sides, at least in part.
    pub outside: u64,
    /// Their share of the area of all faces.
    pub outside_share: f64,
    /// Times that faces were divided.
    pub rounds: u32,
}

/// Returns the faces that bound what is inside of some closed surfaces, exactly. `path` is for errors.
///
/// # Errors
/// If `memory` bytes are not enough, or on interruption.
pub fn divide(
    faces: &ExactFaces,
    operands: &Operands<'_>,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(ExactFaces, Rounds)> {
    let mut found =
        ExactFaces::of_grid(FaceList::new(faces.list.grid().clone(), faces.list.parts().to_vec()));
    let mut turner = Turner::default();
    let Resolved { pairs, divided, removed, outside, outside_share } =
        resolve(faces, operands, path, memory, progress, &mut |kept| {
            match kept {
                Kept::Face { face, is_turned } => match faces.exact.get(&(face.number as u32)) {
                    Some(exact) => found.push(if is_turned { exact.turned() } else { exact.clone() }),
                    None if is_turned => found.list.push(&turner.turn(&face)),
                    None => found.list.push(&face),
                },
                Kept::PlaneRegion { exact, .. } => found.push(exact),
            }
            Ok(())
        })?;
    let rounds = u32::from(divided + removed > 0);
    Ok((found, Rounds { pairs, divided, removed, outside, outside_share, rounds }))
}

/// A surface on the grid, and what of it is not exact.
#[derive(Clone)]
pub struct Rounded {
    /// Planar faces with corners on the grid.
    pub faces: FaceList,
    /// Whether each of them stands for parts of others.
    pub(crate) stands_in: Vec<bool>,
    /// These others.
    pub(crate) exact: Vec<ExactFace>,
    /// Whether each face is new, and may pass through others.
    changed: Vec<bool>,
    /// Vertices that were moved.
    moved: Vec<[i32; 3]>,
    /// The furthest that one was moved, in steps.
    pub displacement: f64,
}

/// Moves the vertices of a surface to the grid.
pub fn round(exact: ExactFaces) -> Result<Rounded> {
    let mut rounder = Rounder::default();
    let ExactFaces { list, exact: mut beside } = exact;
    let stands_in: Vec<bool> = (0..list.len() as u32).map(|number| beside.contains_key(&number)).collect();
    let whole = Rounded {
        faces: list,
        stands_in,
        exact: Vec::new(),
        changed: Vec::new(),
        moved: Vec::new(),
        displacement: 0.0,
    };
    let (mut rounded, ()) = whole.again(|faces, each| {
        for number in 0..faces.list.len() as u32 {
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

    /// Adds faces that were not moved.
    pub fn append(&mut self, faces: &FaceList) {
        for number in 0..faces.len() as usize {
            self.faces.push(&faces.get(number));
        }
        self.stands_in.resize(self.faces.len() as usize, false);
        self.changed.resize(self.faces.len() as usize, false);
    }

    /// Adds a face that stands for nothing of the others.
    pub fn push(&mut self, face: &Face<'_>) {
        self.faces.push(face);
        self.stands_in.push(true);
        self.changed.push(true);
    }

    /// Number of pairs of faces of which one was moved, and that have more in common now than neighbours have.
    ///
    /// # Errors
    /// If `memory` bytes are not enough, or on interruption.
    pub fn crossings(&self, path: &Path, memory: u64, progress: &dyn Progress) -> Result<u64> {
        if !self.changed.contains(&true) {
            return Ok(0);
        }
        let faces = ExactFaces::of_grid(self.faces.clone());
        crossings(&faces, &self.operands(&[faces.list.len() as u32], &[0]), path, memory, progress)
    }

    fn operands<'a>(&'a self, ends: &'a [u32], far: &'a [i32]) -> Operands<'a> {
        Operands {
            ends,
            far,
            are_bodies: false,
            changed: &self.changed,
            winding: &|_, _| None,
            is_inside: &|windings| windings[0] > 0,
        }
    }

    /// Mends what moving the vertices of a whole surface has done to it, as far as that gets in so many rounds; `far` says whether
    /// what is far away is inside. Counts the rounds, and says whether nothing is left to do.
    ///
    /// # Errors
    /// If `memory` bytes are not enough, or on interruption.
    pub fn mended(
        self,
        far: bool,
        most_rounds: u32,
        path: &Path,
        memory: u64,
        progress: &dyn Progress,
        rounds: &mut u32,
    ) -> Result<(Rounded, bool)> {
        let far = [i32::from(far)];
        let mut state = self;
        let mut first = None;
        loop {
            let before = state.clone();
            let ends = [state.faces.len() as u32];
            let operands = before.operands(&ends, &far);
            let mut rounder = Rounder::default();
            let (next, Resolved { divided, removed, .. }) = state.again(|faces, each| {
                let mut turner = Turner::default();
                resolve(faces, &operands, path, memory, progress, &mut |kept| match kept {
                    Kept::Face { face, is_turned: false } => each(&face, false),
                    Kept::Face { face, is_turned: true } => each(&turner.turn(&face), true),
                    Kept::PlaneRegion { face, exact } => {
                        rounder.round(&exact, &mut |part| each(&Face { number: face.number, ..*part }, true))
                    }
                })
            })?;
            state = next;
            state.take(rounder);
            let first = *first.get_or_insert(divided.max(50));
            if divided + removed == 0 || *rounds == most_rounds || divided > 2 * first {
                let is_done = divided + removed == 0 && is_closed(&state.faces);
                return Ok((state, is_done));
            }
            *rounds += 1;
            if divided > 0 {
                // Moving corners has made new crossings: what is thinner than a step has to go.
                let (moved, changed) = (state.moved.clone(), state.changed.clone());
                state = state.again(|faces, each| snap(&faces.list, &moved, &changed, progress, each))?.0;
            }
        }
    }

    /// Collects what is made of the faces as planar ones. Faces that were exact and do not come back as they were go to the exact
    /// ones.
    fn again<R>(
        self,
        make: impl FnOnce(&ExactFaces, &mut EachFace<'_>) -> Result<R>,
    ) -> Result<(Rounded, R)> {
        let Rounded { faces, stands_in, mut exact, moved, displacement, .. } = self;
        let faces = ExactFaces::of_grid(faces);
        let old = &faces.list;
        let mut list = FaceList::new(old.grid().clone(), old.parts().to_vec());
        let mut planar = PlanarFaces::default();
        planar.is_coloured = old.is_coloured();
        let (mut changed, mut still) = (Vec::new(), Vec::new());
        // Whether each comes back as it was.
        let mut is_back = vec![false; stands_in.len()];
        let made = make(&faces, &mut |face, is_new| {
            let number = face.number as usize;
            planar.face(face, &mut |face| {
                let is_same = !is_new && face.points == old.get(number).points;
                list.push(face);
                changed.push(is_new);
                still.push(is_same && !stands_in[number]);
                is_back[number] |= is_same;
                Ok(())
            })
        })?;
        for (number, _) in
            is_back.iter().enumerate().filter(|(number, is_back)| !**is_back && !stands_in[*number])
        {
            let face = old.get(number);
            let normal = ring_normal(face.rings().next().unwrap_or_default());
            if normal != [0; 3] {
                exact.push(ExactFace::of_grid(&face, &ExactPlane::through(face.points[0], normal)));
            }
        }
        // Invariant: of each face of the list there is an entry in `changed` and in `stands_in`, in order.
        // (All three are appended to together.) Combining numbers those that stand for others by their
        // places.
        debug_assert!(changed.len() == list.len() as usize && still.len() == changed.len());
        let stands_in = still.into_iter().map(|still| !still).collect();
        Ok((Rounded { faces: list, stands_in, exact, changed, moved, displacement }, made))
    }
}

/// Whether each edge is there as often in one direction as in the other.
fn is_closed(faces: &FaceList) -> bool {
    let mut edges = Vec::new();
    for number in 0..faces.len() as usize {
        for ring in faces.get(number).rings() {
            edges.extend((0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]));
        }
    }
    let mut turned: Vec<_> = edges.iter().map(|[from, to]| [*to, *from]).collect();
    sort::point_pairs(&mut edges);
    sort::point_pairs(&mut turned);
    edges == turned
}

/// Turns faces to the other side; keeps its buffers from face to face.
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
