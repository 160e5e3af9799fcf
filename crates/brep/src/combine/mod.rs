//! Set operations on bodies: the sixteen of N. A. Tyukachev (2010), on surfaces, exactly.
//!
//! A body is an oriented surface and a bit that says whether what is far away belongs to it. With that bit all sixteen
//! operations make bodies: nothing and everything have no faces and differ in the bit, and a complement has the same
//! faces turned round. The number of an operation is its truth table, and a face stays where the table has different
//! values in front of it and behind it (the index theorem; where faces of two bodies lie on each other, the windings of both
//! change, so that faces turned the same way and faces turned to each other come out right without a code of their own).
//!
//! Both octrees are walked side by side: faces in cells that no other body's surface is near are kept, turned or dropped as a whole,
//! and only those near it are divided by each other. Faces with corners beside the grid are in lists of the cells that they are near,
//! and so results are operands like all others; the faces that stand in for them go with them, or are made anew.

mod alignment;
mod bodies;
mod components;
mod divided;
mod fates;
mod overlap;
mod parts;
mod placed;
mod table;
#[cfg(test)]
mod tests;
mod values;
mod winding;

use std::mem;
use std::path::Path;

use self::alignment::Aligned;
pub(super) use self::bodies::NearFaces;
use self::bodies::{Bodies, Near};
pub use self::divided::divide_faces;
pub use self::parts::{BoundaryPart, boundary_parts};
use self::placed::Placed;
use self::table::OperationTable;
use self::values::FaceValues;
use self::winding::{settled_above, winding};
use super::arrangement::{
    ExactFace, ExactFaces, Operands, Resolved, Rounded, SamplePoint, Seams, Surroundings, divide, round,
};
use super::store::formula::formula;
use super::{BuildReport, ExactModel, Faces, Grid, ModelBuilder};
use crate::closure::SurfaceClosure;
use spinney_base::io::{Output, folder};
use spinney_base::{Error, Progress, Result, SetOperation, SubProgress};
use spinney_container::{Codec, Metadata, Tag};

/// Counts of a set operation on bodies.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CombineReport {
    /// Faces of each body.
    pub before: Vec<u64>,
    /// Faces of the result.
    pub after: u64,
    /// Faces in cells near other bodies, of which the result is arranged anew; of all others nothing is computed.
    pub near: u64,
    /// Pairs of faces that touch or pass through each other.
    pub pairs: u64,
    /// Faces that were divided, or of which a part was taken away.
    pub divided: u64,
    /// Columns of values of faces that the result does not keep, because it would have more than 4096.
    pub lost_columns: u64,
    /// Faces of the result whose values are not known, since they come of a source whose faces have different ones.
    pub lost_values: u64,
    /// The furthest that a new vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
    /// The furthest that a corner of an operand was moved to the grid, in the models' unit: 0 where the operands' grids have a unit in
    /// common, of which each is a multiple.
    pub snapped: f64,
    /// The grid.
    pub grid: Grid,
    /// Whether what is far away belongs to the result.
    pub is_unbounded: bool,
    /// Counts of the octree; and where the surface has defects when its new vertices are moved to the grid, which happens
    /// where it is thinner than the grid's step. What is made of the file by further operations is right there, too.
    pub built: BuildReport,
}

/// Makes the body of a set operation on others, and writes it into a file; `operation` is a number from 0 to 15: bit 0 says that
/// what is in both bodies belongs to the result, bit 1 what is in the first alone, bit 2 what is in the second alone, bit 3
/// what is in neither. So 1 is the intersection, 2 and 4 are the differences, 6 the symmetric difference, 7 the union, 12
/// the complement of the first. Of more than two bodies there are 0, 1 (what is in all), 2 (in the first alone), 6 (in an odd
/// number of them), 7 (in any), and 8, 9, 13, 14, 15, the complements of these; of one 0, 3, 12 and 15.
///
/// Where the units of all grids are multiples of one that leaves at most 2^26 of them along the longest side, coordinates stay as they
/// are; otherwise as few operands as possible are moved to a common grid, with a warning and within [`CombineReport::snapped`]. New vertices
/// stay where they are as fractions, and go to the nearest points of the grid for what is asked of the file. Names of parts
/// are those of the bodies on which the operation depends, one after the other. Faces keep the values that they have, in columns that are
/// joined by their names, and all parts of a face that is divided have its values. Memory: about 100 bytes for each face in cells near
/// other bodies, and 300 for each whose box touches theirs, half of `memory` at most; and 96 for each face with corners beside the grid.
///
/// ```
/// use spinney::{Codec, ExactModel, Output, SetOperation};
/// use spinney::brep::combine;
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = |name: &str| folder.path().join(name);
/// # let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// # std::fs::write(path("a.off"), text).unwrap();
/// # import_exact(open_all(&[path("a.off")], 64 << 20)?, &ExactOptions::new(), Output::create(&path("a.goblin"))?, &())?;
/// let a = ExactModel::open(&path("a.goblin"), &Default::default())?;
/// let report = combine(SetOperation::Difference, &[&a, &a], Output::create(&path("nothing.goblin"))?, Codec::Plain, 64 << 20, &())?;
/// assert_eq!((report.after, report.is_unbounded), (0, false));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// Octrees of files are taken for what they say: where no face changes, that of the largest operand on the result's grid is taken over.
/// [`ExactModel::verify`] looks at one.
///
/// # Errors
/// If there is no such operation of so many bodies, if grids, coordinate systems or units do not fit together, if the memory is not
/// enough, if a model is no body, if files cannot be read or written, or on interruption. There is no file then.
pub fn combine(
    operation: SetOperation,
    models: &[&ExactModel],
    output: Output,
    codec: Codec,
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    combined((operation, None, false), models, (output, codec), memory, progress)
}

/// What the file of a set operation says of how it was made, instead of what its operands say and their names.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The formula; with nothing in it there is none.
    pub formula: String,
    /// Lines of the provenance.
    pub provenance: Vec<String>,
    /// Tags besides those of the operation.
    pub tags: Vec<(Tag, String)>,
}

/// Does what [`combine`] does; the file tells an origin.
///
/// # Errors
/// Those of [`combine`].
pub fn combine_as(
    operation: SetOperation,
    models: &[&ExactModel],
    origin: &Origin,
    output: Output,
    codec: Codec,
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    combined((operation, Some(origin), false), models, (output, codec), memory, progress)
}

fn combined(
    (operation, origin, keeps_apart): (SetOperation, Option<&Origin>, bool),
    models: &[&ExactModel],
    (output, codec): (Output, Codec),
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    // (Of more, numbers of faces in memory would have more than 32 bits.)
    let memory = memory.min(1 << 38);
    let table = OperationTable::new(operation, models.len())?;
    let before = models.iter().map(|model| model.len()).collect();
    let aligned;
    let (placed, models, snapped) = match Placed::of(models)? {
        Some(placed) => (placed, models.to_vec(), 0.0),
        None => {
            aligned = Aligned::of(models, folder(output.path()), output.access(), memory, progress)?;
            let on_one_grid = aligned.models(models);
            let placed = Placed::of(&on_one_grid)?.ok_or_else(|| {
                Error::invalid("models", "bounds that no grid of 2^26 units holds", "models of one region")
            })?;
            (placed, on_one_grid, aligned.displacement)
        }
    };
    let (those, table) = match keeps_apart {
        // (What the second one is matters for where the first one is divided.)
        true => ((0..models.len()).collect(), table),
        false => table.on_those_that_matter(),
    };
    let (placed, models) =
        (placed.of_those(&those), those.iter().map(|number| models[*number]).collect::<Vec<_>>());
    let is_again = |index: usize| models[..index].iter().any(|model| std::ptr::eq(*model, models[index]));
    for index in (0..models.len()).filter(|index| !is_again(*index)) {
        models[index].check_surface(progress)?;
    }
    let make = || {
        made(
            (operation, origin, keeps_apart, snapped),
            &models,
            &placed,
            table,
            (output, codec),
            memory,
            progress,
        )
    };
    match make() {
        Ok(report) => Ok(CombineReport { before, ..report }),
        // What is no body may have been taken for one.
        Err(error @ (Error::NotASolid { .. } | Error::Invalid { .. })) => {
            Err(suspect(&models, memory, progress)?.unwrap_or(error))
        }
        Err(error) => Err(error),
    }
}

/// The error of the first of some models that is found to be no body, if there is one.
fn suspect(models: &[&ExactModel], memory: u64, progress: &dyn Progress) -> Result<Option<Error>> {
    for model in models {
        let findings = model.verify(memory, progress)?;
        if !findings.is_empty() {
            let places = findings.iter().map(|finding| format!("{}: {}", finding.place, finding.problem));
            return Ok(Some(Error::NotASolid {
                path: model.path().to_path_buf(),
                what: "the model is no body, or its octree is not that of its faces".into(),
                places: places.collect(),
                count: findings.len() as u64,
                advice: "build it again".into(),
            }));
        }
    }
    Ok(None)
}

/// Makes the body of an operation on the bodies that it depends on.
fn made(
    (operation, origin, keeps_apart, snapped): (SetOperation, Option<&Origin>, bool, f64),
    models: &[&ExactModel],
    placed: &Placed,
    table: OperationTable,
    (output, codec): (Output, Codec),
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    let grid = placed.grid.clone();
    let path = models.first().map_or(Path::new(""), |model| model.path());
    let mut bodies = Bodies::new(models, placed, table, progress)?;
    bodies.settle_components(memory / 2, progress)?;
    let is_unbounded = table.is_inside(&models.iter().map(|model| model.far_winding()).collect::<Vec<_>>());
    let mut builder = ModelBuilder::new(output, grid.clone(), memory / 2)?
        .codec(codec)
        .unbounded(is_unbounded)
        .reach(bodies.reach());
    // Invariant: of the base, which is closed, the faces that go are taken off, and those that stay are not added: it makes no difference
    // which of both is counted.
    let mut surface = SurfaceClosure::new(true);
    let mut values = FaceValues::of(models)?;
    let Near { faces, ends, mut seams, beside, base } =
        bodies.near(Some((&mut builder, &mut surface, &mut values)), memory / 2, progress)?;
    let far: Vec<i32> = models.iter().map(|model| model.far_winding()).collect();
    let operands = Operands {
        ends: &ends,
        far: &far,
        are_bodies: true,
        turns_roots: false,
        most_contacts: 0,
        keeps_apart,
        changed: &[],
        winding: &|number, sample| Some(winding(models[number], number, placed, sample)),
        rest: None,
        is_inside: &|windings| table.is_inside(windings),
    };
    let near = faces.list.len();
    let all = models.iter().map(|model| model.len()).sum::<u64>();
    let part = |share: u64| SubProgress::new(progress, share, near + all);
    let (mut exact, done) = divide(&faces, &operands, path, memory / 2, &part(near))?;
    drop(faces);
    let Resolved { pairs, divided, .. } = done;
    beside.into_iter().for_each(|face| exact.push(face));
    let rounded = on_grid(exact, &bodies, &mut seams, (is_unbounded, path), memory / 2, progress)?;
    // Invariant: all leaves list exact faces as far away as the file says that faces standing in for them may lie; so do those of a base
    // that is taken over. (One that is not has been told of faces that go, of which nothing is made then.)
    let base = base.filter(|base| !base.model.is_beside_grid() || base.model.reach() == rounded.reach);
    if base.is_none() {
        surface = SurfaceClosure::new(true);
    }
    if rounded.reach != bodies.reach() {
        builder = builder.reach(rounded.reach);
    }
    let Rounded { faces, is_proxy, exact, displacement, reach, .. } = rounded;
    let displacement = displacement * grid.width();
    let mut settled = 0u64;
    bodies.settled(progress, &mut |number, face, is_proxy, is_base| {
        settled += 1;
        seams.add_watched(face);
        if is_base && base.is_some() {
            builder.push_kept(face, is_proxy)?;
        } else {
            surface.add(face, is_proxy);
            builder.push_face(face, is_proxy)?;
        }
        values.copy(number, face.number, &mut builder)
    })?;
    faces.each(&mut |face| {
        let is_proxy = is_proxy[face.number as usize];
        surface.add(face, is_proxy);
        builder.push_face(face, is_proxy)?;
        values.give(face, &mut builder)
    })?;
    let mut after = settled + faces.len();
    seams.close(reach, faces.is_coloured(), &mut |face| {
        after += 1;
        surface.add(face, true);
        builder.push_face(face, true)?;
        values.give(face, &mut builder)
    })?;
    drop(faces);
    if let Some(base) = &base {
        bodies.keep_exact(base, &mut builder, progress)?;
    }
    let mut push_exact = |face: ExactFace| {
        surface.add_exact(&face, progress)?;
        builder.push_exact(face)
    };
    bodies.settled_exact(base.is_some(), progress, &mut push_exact)?;
    exact.into_iter().try_for_each(&mut push_exact)?;
    if let Some(flaw) = surface.flaw() {
        return Err(Error::NotASolid {
            path: path.to_path_buf(),
            what: format!("the result would be no body, and so at least one of the models is none: {flaw}"),
            places: Vec::new(),
            count: 0,
            advice: "check them with verify, and build them again".into(),
        });
    }
    let is_on_grid = !builder.is_beside_grid();
    let mut builder = builder.formula(match origin {
        Some(origin) => origin.formula.clone(),
        None => formula(operation, models)?,
    });
    // (Of divided faces, all are the first one's.)
    let kept = if keeps_apart { &models[..1] } else { models };
    for model in kept {
        for (part, name) in (0..).zip(model.parts()) {
            builder.part(name, model.part_attributes(part)?.as_deref())?;
        }
        model.file_attributes()?.iter().try_for_each(|text| builder.about_file(text))?;
    }
    let mut metadata = metadata(operation, models, &grid);
    metadata.set_tag(Tag::ModelDisplacement, (displacement + snapped).to_string());
    if let Some(origin) = origin {
        metadata.provenance.clone_from(&origin.provenance);
        origin.tags.iter().for_each(|(tag, text)| metadata.set_tag(*tag, text));
    }
    let built = builder.finish_with(base.as_ref(), &mut metadata, &part(all), &mut |metadata, built| {
        if built.defect_count > 0 {
            metadata.set_tag(Tag::ModelThinPlaces, built.defect_count.to_string());
        }
    })?;
    if built.defect_count > 0 && is_on_grid {
        return Err(built.error(
            path,
            "the result passes through itself, and so at least one of the models does",
            "check them with verify, and build them again",
        ));
    }
    let FaceValues { lost_columns, lost_values, .. } = values;
    if lost_columns > 0 {
        let most = ModelBuilder::MAX_COLUMNS;
        let text = format!(
            "{lost_columns} columns of values of faces are not kept, as there would be more than {most}"
        );
        progress.warn(path, &text);
    }
    if lost_values > 0 {
        let text = format!(
            "values of {lost_values} faces that were divided are not kept: other faces of the same sources have others"
        );
        progress.warn(path, &text);
    }
    let before = Vec::new();
    Ok(CombineReport {
        before,
        after,
        near,
        pairs,
        divided,
        lost_columns,
        lost_values,
        displacement,
        snapped,
        grid,
        is_unbounded,
        built,
    })
}

/// The faces near other bodies on the grid, mended where they pass through each other there. `seams` has the edges at which they meet the
/// others; none is left where they were mended.
fn on_grid(
    exact: ExactFaces,
    bodies: &Bodies<'_>,
    seams: &mut Seams,
    (is_unbounded, path): (bool, &Path),
    memory: u64,
    progress: &dyn Progress,
) -> Result<Rounded> {
    let mut rounded = round(exact, progress)?;
    let crossings = rounded.crossings(path, memory, progress)?;
    seams.add_all(&rounded.faces, progress)?;
    if crossings > 0 {
        bodies.settled(progress, &mut |_, face, _, _| {
            seams.add_watched(face);
            Ok(())
        })?;
        // Invariant: faces that are not near other bodies pass through none of these, whose new corners lie on other bodies' faces, a step away
        // or more, and are moved by less. So they are in no contact, and what they change in winding numbers is the same all over a region.
        let rest = |sample: &SamplePoint<'_>| settled_above(bodies, sample);
        let around = Surroundings { is_unbounded, reach: bodies.reach(), rest: Some(&rest) };
        rounded = rounded.closed(mem::take(seams), crossings, &around, path, memory, progress)?;
    }
    // (Faces that are made anew lie as near as the mending leaves them; those that stay, as before.)
    rounded.reach = rounded.reach.max(bodies.reach());
    Ok(rounded)
}

/// Unit, place and provenance of the result.
fn metadata(operation: SetOperation, models: &[&ExactModel], grid: &Grid) -> Metadata {
    let crs = models.iter().find_map(|model| model.crs().cloned());
    let mut metadata = Metadata { frame: grid.frame(crs), ..Metadata::default() };
    metadata.provenance = models.iter().flat_map(|model| model.metadata().provenance.clone()).collect();
    let paths: Vec<String> = models.iter().map(|model| model.path().display().to_string()).collect();
    metadata.provenance.push(format!("operation {} of {}", operation.index(), paths.join(" ")));
    if let Some(unit) = models.iter().find_map(|model| model.metadata().tag(Tag::Unit)) {
        metadata.set_tag(Tag::Unit, unit);
    }
    metadata
}
