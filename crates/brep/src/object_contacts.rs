//! Objects that overlap or touch: pairs of a model's parts, each of which is a solid by itself.

use std::ops::Range;
use std::path::Path;

use crate::arrangement::{ExactFaces, Operands, Surface, divide};
use crate::boxes::{BOX, Bounds, BoxTree, touch, union};
use crate::closure::{ExactClosure, Seed};
use crate::exact::normal::ring_normal;
use crate::repair::volume;
use crate::surface_intersection::areas;
use crate::{ExactModel, FaceList, Faces};
use spinney_base::{Error, Progress, Result, SilentProgress, parallel, sort};

/// The spatial relation of two bodies that share points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactKind {
    /// Their surfaces share points, and their interiors are disjoint.
    Touch,
    /// Their interiors overlap, and neither contains the other.
    Overlap,
    /// The first body contains the second one.
    Contains,
    /// The second body contains the first one.
    Within,
    /// The bodies are equal.
    Equal,
}

impl ContactKind {
    /// Returns the kind's name: "touch".
    pub fn name(self) -> &'static str {
        match self {
            ContactKind::Touch => "touch",
            ContactKind::Overlap => "overlap",
            ContactKind::Contains => "contains",
            ContactKind::Within => "within",
            ContactKind::Equal => "equal",
        }
    }
}

/// Two objects that share points.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ObjectContact {
    /// Numbers of their parts, the smaller one first.
    pub parts: [u32; 2],
    /// The relation of the first object to the second one.
    pub kind: ContactKind,
    /// Volume of the intersection, in cubed units; 0 if they touch.
    pub volume: f64,
    /// Area in which touching surfaces coincide, in squared units; 0 if the interiors overlap.
    pub area: f64,
    /// A common point, in world coordinates.
    pub place: [f64; 3],
}

/// Receives a pair of objects, and returns whether to continue.
pub type ContactVisitor<'a> = dyn FnMut(&ObjectContact) -> Result<bool> + 'a;

/// Visits the pairs of parts that overlap or touch, ordered by their numbers, until `each` returns
/// `false`. Returns the parts that are not closed by themselves, which are skipped with a warning.
/// A part may intersect itself or be inside out: its inside is where its winding number is not 0.
///
/// All faces are in memory. A pair's faces are copied, and each pair of faces that share points
/// takes about a kilobyte more. `path` is the model's, for errors. The results do not depend on the
/// number of threads.
///
/// # Errors
/// If `memory` bytes are not enough, on cancellation, or what `each` returns.
pub fn object_contacts(
    faces: FaceList,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
    each: &mut ContactVisitor<'_>,
) -> Result<Vec<u32>> {
    contacts_of(&ExactFaces::of_grid(faces), path, memory, progress, each)
}

impl ExactModel {
    /// Visits the pairs of parts that touch, as [`object_contacts`] does. (Parts of a valid model
    /// do not overlap.)
    ///
    /// # Errors
    /// If `memory` bytes are not enough, if the file cannot be read or is corrupt, on cancellation,
    /// or what `each` returns.
    pub fn object_contacts(
        &self,
        memory: u64,
        progress: &dyn Progress,
        each: &mut ContactVisitor<'_>,
    ) -> Result<Vec<u32>> {
        self.check_surface(progress)?;
        let mut faces = ExactFaces::of_grid(FaceList::new(self.grid().clone(), self.parts().to_vec()));
        let mut exact_bytes = 0;
        let check = |count: u64, bytes: u64| {
            if count.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            if bytes > memory / 2 { Err(too_large(self.path(), bytes, memory / 2)) } else { Ok(()) }
        };
        self.each_face(&mut |face, is_proxy| {
            if !is_proxy {
                faces.list.push(face);
            }
            check(faces.list.len(), faces.list.bytes())
        })?;
        self.each_exact(&mut |face| {
            exact_bytes += face.bytes();
            faces.push(face);
            check(faces.list.len(), faces.list.bytes() + exact_bytes)
        })?;
        contacts_of(&faces, self.path(), memory, progress, each)
    }
}

fn too_large(path: &Path, needed: u64, limit: u64) -> Error {
    Error::TooLarge {
        path: path.to_path_buf(),
        what: "comparing objects in pairs".into(),
        needed,
        limit,
        advice: "allow more with --memory".into(),
    }
}

/// Faces of the objects, grouped by object.
struct Bodies<'a> {
    faces: &'a ExactFaces,
    /// Face numbers, sorted by object.
    order: Vec<u32>,
    /// Closed objects.
    list: Vec<Body>,
    path: &'a Path,
    memory: u64,
}

struct Body {
    part: u32,
    /// Its faces: a range of indices in the order.
    faces: Range<usize>,
    bounds: Bounds,
}

fn contacts_of(
    faces: &ExactFaces,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
    each: &mut ContactVisitor<'_>,
) -> Result<Vec<u32>> {
    /// Number of pairs per parallel batch.
    const BATCH: usize = 1 << 10;
    let memory = memory / 2 / parallel::threads() as u64;
    let (bodies, open) = Bodies::of(faces, path, memory, progress)?;
    warn_of_open_objects(faces, &open, path, progress);
    let list = &bodies.list;
    if list.is_empty() {
        return Ok(open);
    }
    let tree = BoxTree::of((0..).zip(list).map(|(number, body)| (number, body.bounds)).collect());
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    let mut done = 0;
    for number in 0..list.len() as u32 {
        let own = list[number as usize].bounds;
        let first = pairs.len();
        tree.each(&|bounds| touch(bounds, &own), |other| {
            if other > number {
                pairs.push([number, other]);
            }
        });
        sort::by_key(&mut pairs[first..], |[_, other]| (*other).into());
        if pairs.len() < BATCH && (number as usize) + 1 < list.len() {
            continue;
        }
        for batch in pairs.chunks(BATCH) {
            progress.check()?;
            for found in parallel::map(batch, |pair| bodies.contact(*pair, progress)) {
                if let Some(found) = found?
                    && !each(&found)?
                {
                    return Ok(open);
                }
            }
        }
        progress.advance(u64::from(number) + 1 - done, list.len() as u64);
        done = u64::from(number) + 1;
        pairs.clear();
    }
    Ok(open)
}

/// Warns of open objects.
fn warn_of_open_objects(faces: &ExactFaces, open: &[u32], path: &Path, progress: &dyn Progress) {
    /// Maximum number of names in the warning.
    const MAX_NAMES: usize = 5;
    if open.is_empty() {
        return;
    }
    let name = |part: &u32| {
        faces.list.parts().get(*part as usize).map_or_else(|| format!("part {part}"), String::clone)
    };
    let names: Vec<String> = open.iter().take(MAX_NAMES).map(name).collect();
    let more = if open.len() > MAX_NAMES { ", ..." } else { "" };
    let text = format!("{} objects are open and were left out: {}{more}", open.len(), names.join(", "));
    progress.warn(path, &text);
}

impl Bodies<'_> {
    /// Returns the closed objects, and the parts of the open ones.
    fn of<'a>(
        faces: &'a ExactFaces,
        path: &'a Path,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<(Bodies<'a>, Vec<u32>)> {
        let part = |face: &u32| faces.list.get(*face as usize).part;
        let mut order: Vec<u32> = (0..faces.list.len() as u32).collect();
        sort::by_key(&mut order, |face| part(face).into());
        let (seed, mut start) = (Seed::new(), 0);
        let (mut list, mut open) = (Vec::new(), Vec::new());
        for run in order.chunk_by(|a, b| part(a) == part(b)) {
            let mut closure = ExactClosure::new(seed);
            let mut bounds = faces.bounds(run[0]);
            for (index, face) in run.iter().enumerate() {
                if index.is_multiple_of(1 << 12) {
                    progress.check()?;
                }
                match faces.exact.get(face) {
                    Some(exact) => closure.add_exact(exact),
                    None => closure.add(&faces.list.get(*face as usize)),
                }
                bounds = union(bounds, &faces.bounds(*face));
            }
            match closure.is_closed() {
                true => list.push(Body { part: part(&run[0]), faces: start..start + run.len(), bounds }),
                false => open.push(part(&run[0])),
            }
            start += run.len();
        }
        let needed = (list.len() * (size_of::<Body>() + BOX)) as u64;
        if needed > memory {
            return Err(too_large(path, needed, memory));
        }
        Ok((Bodies { faces, order, list, path, memory }, open))
    }

    /// Returns the contact of two objects, if they share points.
    fn contact(&self, pair: [u32; 2], progress: &dyn Progress) -> Result<Option<ObjectContact>> {
        let bodies = pair.map(|number| &self.list[number as usize]);
        let mut faces = ExactFaces::of_grid(FaceList::new(self.faces.list.grid().clone(), Vec::new()));
        let mut ends = [0; 2];
        for (body, end) in bodies.iter().zip(&mut ends) {
            for face in &self.order[body.faces.clone()] {
                match self.faces.exact.get(face) {
                    Some(exact) => faces.push(exact.clone()),
                    None => faces.list.push(&self.faces.list.get(*face as usize)),
                }
            }
            *end = faces.list.len() as u32;
        }
        let grid = faces.list.grid().clone();
        let all = Operands {
            ends: &ends,
            far: &[0, 0],
            is_inside: &|windings| windings[0] != 0 && windings[1] != 0,
            ..Operands::NONE
        };
        let progress = &SilentProgress(progress);
        let of = |operands: &Operands<'_>| divide(&faces, operands, self.path, self.memory, progress);
        let parts = bodies.map(|body| body.part);
        let (both, _) = of(&all)?;
        if let Some(place) = place_of(&both) {
            let first = Operands { is_inside: &|windings| windings[0] != 0 && windings[1] == 0, ..all };
            let second = Operands { is_inside: &|windings| windings[0] == 0 && windings[1] != 0, ..all };
            let kind = match [place_of(&of(&first)?.0), place_of(&of(&second)?.0)] {
                [None, None] => ContactKind::Equal,
                [Some(_), None] => ContactKind::Contains,
                [None, Some(_)] => ContactKind::Within,
                [Some(_), Some(_)] => ContactKind::Overlap,
            };
            let (volume, place) = (volume(&both) * grid.width().powi(3), grid.to_world(place));
            return Ok(Some(ObjectContact { parts, kind, volume, area: 0.0, place }));
        }
        let surface = Surface::new(&faces, &all, self.path, self.memory, progress)?;
        let contacts = surface.contacts_of_first(self.memory, progress)?;
        let points = contacts.iter().flat_map(|contact| {
            contact.points.iter().chain(contact.segments.as_flattened()).map(|point| point.to_world(&grid))
        });
        // (The minimum, so that the result is deterministic.)
        let Some(place) = points.min_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal)) else {
            return Ok(None);
        };
        let areas = areas::areas(&surface, &contacts, &grid, self.memory, progress)?;
        let area = areas.iter().fold(0.0, |sum, area| sum + area.polygon.area);
        Ok(Some(ObjectContact { parts, kind: ContactKind::Touch, volume: 0.0, area, place }))
    }
}

/// Returns a vertex of the first face that has an area.
fn place_of(faces: &ExactFaces) -> Option<[i32; 3]> {
    let has_area = |number: &u32| {
        let face = faces.list.get(*number as usize);
        faces.exact.contains_key(number) || ring_normal(face.rings().next().unwrap_or_default()) != [0; 3]
    };
    let number = (0..faces.list.len() as u32).find(has_area)?;
    faces.list.get(number as usize).points.first().copied()
}
