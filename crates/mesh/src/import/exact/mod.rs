//! Exact models from meshes. Faces are snapped to a grid, checked, and passed to the file builder.

mod boundary;
mod contacts;
mod objects;
mod options;
mod snap;
mod sums;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use self::boundary::{Boundary, Groups, Loop, Open};
use self::objects::Objects;
use self::snap::Snapper;
use self::sums::{ObjectSums, compare};
use super::solid::{ChosenParts, bounds, cell_volume, common_crs, flat_faces, provenance};
use super::{Model, ModelInfo};
use spinney_base::io::{Output, directory_of};
use spinney_base::{Error, Progress, Result, SilentProgress, SubProgress};
use spinney_brep::format_position;
use spinney_brep::{
    BuildReport, DefectKind, Face, FaceList, FaceSorter, Faces as _, Grid, InsideRule, ModelBuilder,
    REPAIR_PASSES, Repair, RepairInput,
};
use spinney_container::{Metadata, Tag};

pub use self::contacts::{ModelContact, model_contacts};
pub use self::objects::SkippedObject;
pub use self::options::{ExactOptions, ExactReport};

/// Builds an exact model from the given models, which are merged. Progress counts faces, each in
/// several passes. Data that exceeds the memory goes to a temporary file in the output's directory.
///
/// ```
/// use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let [mesh, path] = ["tetrahedron.off", "tetrahedron.goblin"].map(|name| directory.path().join(name));
/// let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// std::fs::write(&mesh, text).unwrap();
/// let models = open_all(&[mesh], 64 << 20)?;
/// let report = import_exact(models, &ExactOptions::new(), Output::create(&path)?, &())?;
/// assert_eq!((report.faces, report.displacement), (4, 0.0));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// A surface with thin intersections, no deeper than two grid units, or with folds, which enclose
/// nothing, is repaired as with [`ExactOptions::repair`]: the grid or a file format has rounded its
/// coordinates. It is refused if the output is a stream or an upload, which cannot be started
/// again.
///
/// # Errors
/// [`Error::NotASolid`] if the surface is open, intersects itself or is inside out. Also fails if
/// the models cannot be read, if the file cannot be written, or on cancellation. No file is created
/// then.
pub fn import_exact(
    mut models: Vec<Box<dyn Model>>,
    options: &ExactOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<ExactReport> {
    let restart = output.restart();
    let (error, restart) = match (try_once(&mut models, options, false, output, progress)?, restart) {
        (Outcome::Built(report), _) => return Ok(*report),
        (Outcome::Refused { error, is_thin: true }, Some(restart)) => (error, restart),
        (Outcome::Refused { error, .. }, _) => return Err(error),
    };
    let repair = ExactOptions { repair: true, inside: InsideRule::Positive, ..options.clone() };
    match try_once(&mut models, &repair, true, restart()?, progress) {
        Ok(Outcome::Built(report)) => Ok(*report),
        Ok(Outcome::Refused { .. }) | Err(Error::NotASolid { .. } | Error::TooLarge { .. }) => Err(error),
        Err(error) => Err(error),
    }
}

/// Outcome of building a model.
enum Outcome {
    Built(Box<ExactReport>),
    Refused {
        error: Error,
        /// Whether rounding may have caused the intersections.
        is_thin: bool,
    },
}

/// Builds a model. If `keeps_volume`, it is refused if the repair changes the volume of the faces
/// by more than thin intersections enclose: then bodies overlap, or are inside out. (Such bodies
/// may have no other intersections: a box within another one, with a wall in the same plane.)
fn try_once(
    models: &mut Vec<Box<dyn Model>>,
    options: &ExactOptions,
    keeps_volume: bool,
    output: Output,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let Some(first) = models.first() else {
        return Err(Error::invalid("models", "none", "one or more"));
    };
    let path = first.info().path.clone();
    let crs = match &options.crs {
        Some(crs) => Some(crs.clone()),
        None => common_crs(models, None)?,
    };
    let grid = grid_of(models, options)?;
    let mut objects = Objects::of(models, options.parts.as_ref())?;
    let work = Passes::of(models, options, progress);
    let skipped = match options.skip_bad {
        true => skip_bad(models, &mut objects, &grid, options, &work.part(SKIPPING_PASSES))?,
        false => Vec::new(),
    };
    let place = directory_of(output.path()).to_path_buf();
    let mut target = Target::new(output, &path, &grid, options)?;
    let mut snapper = Snapper::new(grid.clone(), options.up);
    let mut sums = ObjectSums::default();
    let sorter = || FaceSorter::new(&grid, &place, options.memory / 4);
    let mut sorted = sorter();
    let mut area = 0.0;
    // Whether each part has faces, if they may be removed.
    let mut has_faces: Vec<bool> = Vec::new();
    read(models, &objects, &mut snapper, &work.part(1), &mut |face, values| {
        if options.repair {
            let part = face.part as usize;
            has_faces.resize(has_faces.len().max(part + 1), false);
            has_faces[part] |= face.has_area();
        }
        if keeps_volume {
            area += face.area();
        }
        sums.add(objects.object(face.part), face);
        sorted.push(face, values)
    })?;
    let counts = snapper.planar.counts;
    let mut faces = counts.faces;
    let mut closed = (0, 0);
    let mut groups = Groups::default();
    // The triangles that close boundaries.
    let mut closing = FaceList::new(grid.clone(), Vec::new());
    // (With --close, objects are closed separately, except for patches of one surface. Without it,
    // several objects may bound a body together.)
    let object = |face: &Face<'_>| if options.close { objects.object(face.part) } else { 0 };
    if !sums.are_closed(options.close) {
        let mut boundary = Boundary::new(&place, options.memory / 4);
        let mut again = Snapper::new(grid.clone(), options.up);
        read(models, &objects, &mut again, &SilentProgress(progress), &mut |face, _| {
            boundary.add_face(face, object(face))
        })?;
        let Open { loops, groups: found } = boundary.loops(&path, options.memory / 4, progress)?;
        if !options.close {
            return Err(open_surface(&path, &grid, (&objects, sums.has_closed()), &loops));
        }
        groups = found;
        sums.join(&groups);
        let first = (snapper.planar.counts.faces, snapper.read);
        boundary::close(&loops, first, snapper.planar.is_coloured, progress, &mut |face| {
            sums.add(groups.group(objects.object(face.part)), face);
            closing.push(face);
            sorted.push(face, &[])
        })?;
        closed = (loops.len() as u64, closing.len());
        faces += closed.1;
    }
    if !options.repair {
        sums.check(&path, &objects)?;
    }
    sorted.finish(&mut |face, values| {
        if face.number.is_multiple_of(OFTEN) {
            progress.check()?;
        }
        target.push(face, values)
    })?;
    let (mut builder, repaired) = target.repaired(options.inside, &work.part(REPAIR_PASSES))?;
    let vanished =
        (0..).zip(&has_faces).filter(|(part, has_faces)| **has_faces && !builder.has_faces_of(*part));
    let vanished: Vec<&str> = vanished.filter_map(|(part, _)| objects.name(part)).collect();
    let most = BuildReport::THIN * area * grid.width().powi(3);
    if keeps_volume && repaired.is_some_and(|done| (done.volume - sums.volume(&grid)).abs() > most) {
        return Err(Error::NotASolid {
            path,
            what: "the repair changes the volume: bodies overlap, or are inside out".into(),
            locations: Vec::new(),
            count: 0,
            advice: "resolve it with --repair".into(),
        });
    }
    // (Always by the winding rule of cells, regardless of --inside: the repair itself warns of
    // changes by another rule.)
    let volume = repaired.map_or(sums.volume(&grid), |done| done.cells_volume);
    let is_repaired = !keeps_volume && repaired.is_some_and(|done| !done.is_nothing());
    let is_changed = closed.0 > 0 || is_repaired;
    let cells = match is_changed.then(|| sums.bounds(&grid)).flatten() {
        Some(bounds) => {
            let (some, objects) = (objects.some(), objects.joined(&groups));
            let chosen = ChosenParts { some, objects, bounds };
            let frame = (options.up, crs.clone());
            let found = cell_volume(models, chosen, frame, options.memory, &place, progress)?;
            compare(volume, found, &path, progress)?;
            found
        }
        None => None,
    };
    let (mut first, mut with_attributes) = (0, 0);
    for ModelInfo { parts, attributes, .. } in models.iter().map(|model| model.info()) {
        for (part, name) in (0..).zip(parts).filter(|(part, _)| objects.number(first + part).is_some()) {
            builder.part(name, attributes.part(part))?;
            with_attributes += u64::from(attributes.part(part).is_some());
        }
        first += parts.len() as u32;
        attributes.files().iter().try_for_each(|text| builder.about_file(text))?;
    }
    faces = repaired.map_or(faces, |_| builder.faces());
    let has_exact_faces = builder.has_exact_faces();
    let displacement = snapper.squared_displacement.sqrt();
    let mut metadata = Metadata { frame: grid.frame(crs), ..Metadata::default() };
    metadata.provenance = models.iter().map(|model| provenance(model.info())).collect();
    metadata.provenance.extend(history(options, &skipped, repaired.as_ref()));
    let unit = options.unit.clone().or_else(|| models.iter().find_map(|model| model.info().unit.clone()));
    let furthest = repaired.map_or(displacement, |done| done.displacement.max(displacement));
    metadata.set_tag(Tag::ModelDisplacement, furthest.to_string());
    metadata.set_tag(Tag::ModelCutFaces, counts.cut.to_string());
    metadata.set_tag(Tag::ModelSlivers, counts.slivers.to_string());
    metadata.set_tag(Tag::ModelClosingTriangles, closed.1.to_string());
    if let Some(done) = &repaired {
        metadata.set_tag(Tag::ModelRepairedFaces, (done.divided + done.removed).to_string());
    }
    if let Some(unit) = &unit {
        metadata.set_tag(Tag::Unit, unit);
    }
    let built = builder.finish(&mut metadata, &work.part(BUILDING_PASSES))?;
    // (Proxy faces may intersect each other where exact faces are thinner than a grid unit.)
    if built.defect_count > 0 && !has_exact_faces {
        let advice = match options.repair {
            true => {
                "--repair did not resolve it on this grid: choose another grid with --snap, or build cells \
                 (without --brep)"
            }
            false => {
                "resolve it with --repair, or build cells (without --brep), which are the union of all parts"
            }
        };
        let are_all = |is: fn(DefectKind) -> bool| built.defects.iter().all(|defect| is(defect.kind));
        let are_nested = are_all(|kind| matches!(kind, DefectKind::Winding(2..)));
        let what = match are_nested {
            true => "bodies are inside of each other",
            false if are_all(|kind| kind == DefectKind::Fold) => {
                "the surface is folded flat onto itself, and encloses nothing there"
            }
            false => "the surface intersects itself, or is inside out: it bounds no body",
        };
        let advice = match are_nested && !options.repair {
            true if objects.count() > 1 => {
                "build one of the objects with --where, such as `--where id=NAME`, or unite them with --repair"
            }
            true => "write each body to a file of its own, or unite them with --repair",
            false => advice,
        };
        let error = built.error(&path, what, advice);
        let wrong = Wrong { built: &built, objects: &objects, closing: &closing, options };
        let error = wrong.named(error, models, snapper, sorter(), progress)?;
        return Ok(Outcome::Refused { error, is_thin: built.is_thin && !options.repair });
    }
    if !vanished.is_empty() {
        let names = listed(&vanished);
        progress
            .warn(&path, &format!("{} objects have no faces left after the repair: {names}", vanished.len()));
    }
    for model in models.iter() {
        model.remarks().iter().for_each(|remark| progress.warn(&model.info().path, remark));
    }
    let lost_values = models.iter().map(|model| model.lost_values()).sum();
    if lost_values > 0 {
        let text =
            "values of faces (such as semantics or materials) are invalid or too long, and were dropped";
        progress.warn(&path, &format!("{lost_values} {text}"));
    }
    Ok(Outcome::Built(Box::new(ExactReport {
        read: snapper.read,
        faces,
        collapsed: counts.collapsed,
        slivers: counts.slivers,
        cut: counts.cut,
        fanned: counts.fanned,
        objects: objects.count(),
        skipped,
        attributes: with_attributes,
        lost_values,
        closed,
        repair: repaired,
        cells: cells.map(|cells| [cells.volume, cells.error]),
        displacement,
        grid,
        unit,
        built,
    })))
}

/// Faces between two checks for cancellation.
const OFTEN: u64 = 1 << 12;

/// Passes over all faces that checking objects one by one counts for, including reading them.
const SKIPPING_PASSES: u64 = 2;

/// Passes over all faces that building the octree counts for.
const BUILDING_PASSES: u64 = 2;

/// Total work, in passes over the faces.
struct Passes<'a> {
    progress: &'a dyn Progress,
    faces: u64,
    total: u64,
}

impl<'a> Passes<'a> {
    fn of(models: &[Box<dyn Model>], options: &ExactOptions, progress: &'a dyn Progress) -> Passes<'a> {
        let faces = faces_of(models);
        let skipping = if options.skip_bad { SKIPPING_PASSES } else { 0 };
        let repair = if options.repair { REPAIR_PASSES } else { 0 };
        Passes { progress, faces, total: faces * (1 + skipping + repair + BUILDING_PASSES) }
    }

    /// Progress of work that counts for `passes` passes.
    fn part(&self, passes: u64) -> SubProgress<'a> {
        SubProgress::new(self.progress, passes * self.faces, self.total)
    }
}

/// Number of faces of the models, estimated where it is not known before reading.
fn faces_of(models: &[Box<dyn Model>]) -> u64 {
    /// Estimated bytes per face in files that do not declare their number of faces.
    const BYTES: u64 = 100;
    models.iter().map(|model| model.info()).map(|info| info.faces.unwrap_or(info.bytes / BYTES)).sum()
}

/// Lines for the provenance: objects that were left out, and changes to the surface.
fn history(options: &ExactOptions, skipped: &[SkippedObject], repaired: Option<&Repair>) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(parts) = &options.parts {
        lines.push(format!("{} parts were chosen", parts.len()));
    }
    if !skipped.is_empty() {
        let names: Vec<&str> = skipped.iter().map(|object| object.name.as_str()).collect();
        lines.push(format!("left out {} objects that are no bodies: {}", skipped.len(), listed(&names)));
    }
    if let Some(done) = repaired.filter(|done| !done.is_nothing()) {
        let (bodies, rule) = (done.turned.0, options.inside.name());
        let (divided, removed) = (done.divided, done.removed);
        lines.push(format!(
            "repaired, with {rule} windings inside: {bodies} bodies turned, {divided} faces divided, {removed} removed"
        ));
    }
    lines
}

/// Returns the names of objects as a list, cut off if it is long.
fn listed(names: &[&str]) -> String {
    /// Maximum number of names; a city may have any number of objects.
    const MOST: usize = 100;
    let more = if names.len() > MOST { ", ..." } else { "" };
    names[..names.len().min(MOST)].join(", ") + more
}

/// Receiver of snapped faces: writes them to the file directly, or collects them for repair.
struct Target {
    builder: ModelBuilder,
    collected: Option<RepairInput>,
    /// Path of the first model, for errors.
    path: PathBuf,
    /// Directory of temporary files.
    directory: PathBuf,
}

impl Target {
    fn new(output: Output, path: &Path, grid: &Grid, options: &ExactOptions) -> Result<Target> {
        let directory = directory_of(output.path()).to_path_buf();
        // (A repair holds faces in addition to the builder's memory.)
        let memory = if options.repair { options.memory / 2 } else { options.memory };
        let builder = ModelBuilder::new(output, grid.clone(), memory)?
            .codec(options.codec)
            .leaf_size(options.leaf_size);
        let collected = options.repair.then(|| RepairInput::new(grid.clone(), memory));
        Ok(Target { builder, collected, path: path.to_path_buf(), directory })
    }

    fn push(&mut self, face: &Face<'_>, values: &[(&str, &str)]) -> Result<()> {
        if let Some(collected) = &mut self.collected {
            return collected.push(face, values, &self.directory);
        }
        self.builder.push(face)?;
        values.iter().try_for_each(|(column, json)| self.builder.face_value(column, json))
    }

    /// Returns the builder with all faces in it, and the counts of the repair.
    fn repaired(self, inside: InsideRule, progress: &dyn Progress) -> Result<(ModelBuilder, Option<Repair>)> {
        let Target { mut builder, collected, path, .. } = self;
        let Some(collected) = collected else { return Ok((builder, None)) };
        builder.record_parts();
        let (builder, done) = collected.repair(inside, builder, &path, progress)?;
        Ok((builder, Some(done)))
    }
}

/// Grid of the models.
fn grid_of(models: &mut [Box<dyn Model>], options: &ExactOptions) -> Result<Grid> {
    let bounds = bounds(models, options.up)?;
    if options.snap.is_some() {
        return Grid::over(bounds, options.snap);
    }
    // A grid that the files define is kept, so coordinates do not change.
    match common_step(models).map(|width| Grid::over(bounds, Some(width))) {
        Some(Ok(grid)) => Ok(grid),
        _ => Grid::over(bounds, None),
    }
}

/// Grid unit of the models' coordinates, if all models declare the same one.
fn common_step(models: &[Box<dyn Model>]) -> Option<f64> {
    let first = models.first()?.info().step?;
    models.iter().all(|model| model.info().step == Some(first)).then_some(first)
}

/// Leaves out objects that are not bodies by themselves.
fn skip_bad(
    models: &mut [Box<dyn Model>],
    objects: &mut Objects,
    grid: &Grid,
    options: &ExactOptions,
    progress: &dyn Progress,
) -> Result<Vec<SkippedObject>> {
    let path = models[0].info().path.clone();
    let all = faces_of(models);
    let part = || SubProgress::new(progress, all, SKIPPING_PASSES * all);
    let mut faces = FaceList::new(grid.clone(), Vec::new());
    read(models, objects, &mut Snapper::new(grid.clone(), options.up), &part(), &mut |face, _| {
        faces.push(face);
        check_memory(&path, faces.bytes(), options.memory / 2, "the list of faces of the tested objects")
    })?;
    objects.skip_bad(&faces, options, &path, &part())
}

/// Fails if `bytes` exceeds the limit. `what` describes the data.
fn check_memory(path: &Path, bytes: u64, limit: u64, what: &str) -> Result<()> {
    if bytes <= limit {
        return Ok(());
    }
    Err(Error::TooLarge {
        path: path.to_path_buf(),
        what: what.into(),
        needed: bytes,
        limit,
        advice: "allow more with --memory".into(),
    })
}

/// Surface with defects, and its sources.
struct Wrong<'a> {
    built: &'a BuildReport,
    objects: &'a Objects,
    /// The triangles that close boundaries.
    closing: &'a FaceList,
    options: &'a ExactOptions,
}

impl Wrong<'_> {
    /// Adds the names of the objects with defects to an error if there are several objects. (After
    /// a repair, face numbers no longer match the faces that were read.)
    fn named(
        &self,
        error: Error,
        models: &mut [Box<dyn Model>],
        snapper: Snapper,
        mut sorted: FaceSorter,
        progress: &dyn Progress,
    ) -> Result<Error> {
        let Wrong { built, objects, closing, options } = *self;
        let Error::NotASolid { path, what, mut locations, count, advice } = error else { return Ok(error) };
        if options.repair || objects.count() < 2 {
            return Ok(Error::NotASolid { path, what, locations, count, advice });
        }
        let wanted: BTreeSet<u64> =
            built.defects.iter().flat_map(|defect| defect.faces.iter().copied()).collect();
        let mut part_of = BTreeMap::new();
        let mut again = Snapper::new(snapper.grid.clone(), snapper.up);
        read(models, objects, &mut again, &SilentProgress(progress), &mut |face, _| sorted.push(face, &[]))?;
        closing.each(&mut |face| sorted.push(face, &[]))?;
        sorted.finish(&mut |face, _| {
            if wanted.contains(&face.number) {
                part_of.insert(face.number, face.part);
            }
            Ok(())
        })?;
        let mut between_objects = 0;
        for (location, defect) in locations.iter_mut().zip(&built.defects) {
            let parts: BTreeSet<u32> =
                defect.faces.iter().filter_map(|face| part_of.get(face).copied()).collect();
            let names: Vec<&str> = parts.iter().filter_map(|part| objects.name(*part)).collect();
            between_objects += u32::from(names.len() > 1);
            if !names.is_empty() {
                *location += &format!(", of {}", names.join(" and "));
            }
        }
        // (Objects that intersect each other may all be bodies by themselves.)
        let advice = match (options.skip_bad, between_objects) {
            (true, 0) => advice,
            (false, 0) => format!("{advice}; --skip-bad omits objects that are no bodies by themselves"),
            _ => format!(
                "{advice}; --skip-bad keeps objects that are bodies by themselves, also where they intersect each other"
            ),
        };
        Ok(Error::NotASolid { path, what, locations, count, advice })
    }
}

/// Visitor of snapped faces and their values.
type FaceVisitor<'a> = dyn FnMut(&Face<'_>, &[(&str, &str)]) -> Result<()> + 'a;

/// Reads all faces of the chosen objects of all models and passes them, snapped to the grid, to
/// `each` with their values. Progress counts faces.
fn read(
    models: &mut [Box<dyn Model>],
    objects: &Objects,
    snapper: &mut Snapper,
    progress: &dyn Progress,
    each: &mut FaceVisitor<'_>,
) -> Result<()> {
    let (mut first_part, total) = (0, faces_of(models));
    let up = snapper.up;
    snapper.planar.is_coloured = models.iter().any(|model| model.info().is_coloured);
    for model in models.iter_mut() {
        let path = model.info().path.clone();
        let parts = model.info().parts.len() as u32;
        snapper.up = model.info().up(up);
        model.faces(&mut |face| {
            if snapper.read.is_multiple_of(OFTEN) {
                progress.check()?;
                progress.advance(OFTEN, total);
            }
            match objects.number(first_part + face.part) {
                Some(part) => snapper.face(&path, face, part, &mut |snapped| each(snapped, face.values)),
                None => {
                    snapper.read += 1;
                    Ok(())
                }
            }
        })?;
        first_part += parts;
    }
    snapper.up = up;
    if snapper.planar.counts.faces == 0 {
        let path = models.first().map(|model| model.info().path.clone()).unwrap_or_default();
        return Err(flat_faces(&path, bounds(models, snapper.up)?, snapper.grid.width()));
    }
    Ok(())
}

/// Error of an open surface. `has_closed` is whether some of the objects are closed.
fn open_surface(path: &Path, grid: &Grid, (objects, has_closed): (&Objects, bool), loops: &[Loop]) -> Error {
    let place = |hole: &Loop| {
        let first = grid.to_world(hole.points[0]);
        let name = objects.name(hole.part).map_or(String::new(), |name| format!(", of {name}"));
        format!("a boundary of {} edges from {}{name}", hole.points.len(), format_position(first))
    };
    Error::NotASolid {
        path: path.to_path_buf(),
        what: "the surface is open: it bounds no body".into(),
        locations: loops.iter().take(100).map(place).collect(),
        count: loops.len() as u64,
        advice: match objects.count() {
            1 => "close it with --close (with `--close --repair` if faces intersect then), or build cells (without --brep)"
                .into(),
            _ if !has_closed => "no object is closed: close them and resolve intersections with `--close --repair`, or build \
                                 cells (without --brep)"
                .into(),
            _ => "close it with --close, omit open objects with --skip-bad, select others with --where, or build cells \
                  (without --brep)"
                .into(),
        },
    }
}
