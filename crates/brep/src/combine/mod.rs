//! Set operations on bodies: the sixteen operations of N. A. Tyukachev (2010), exact, on surfaces.
//!
//! A body is an oriented surface plus one bit: whether the body includes infinity. The bit closes
//! the set of bodies under all sixteen operations. The empty set and the whole space have no faces
//! and differ in the bit. A complement has the same faces, reversed, and the other bit.
//!
//! The number of an operation is its truth table. A face belongs to the result if the table has
//! different values in front of the face and at its back (the index theorem). Where faces of two
//! bodies coincide, the winding numbers of both bodies change at once, so faces with equal and with
//! opposite orientation need no special case.
//!
//! An operation runs in five stages:
//!
//! 1. Classify (`Bodies::new`, `settle_components`). Input: the octrees of all operands and the
//!    operation table. Output: a `Fate` per face, or "near" if the face may meet another body. All
//!    octrees are traversed together. Faces in cells that are far from every other surface are
//!    settled (kept, reversed or dropped) per cell, without reading them. Then near faces whose
//!    boxes touch no face of another body are settled, with one winding number per connected
//!    component.
//! 2. Arrange (`Bodies::near`, `divide`). Input: the remaining near faces, on the common grid.
//!    Output: the exact faces that bound the result.
//! 3. Snap (`on_grid`: `round`). Input: these exact faces. Output: planar faces with vertices on
//!    the grid, which of them are proxies, and the exact faces that the proxies represent. If the
//!    planar faces intersect each other, `Rounded::stitch_and_mend` does the work of stage 4 first,
//!    since winding numbers need a closed surface, and then removes the intersections.
//! 4. Stitch (`Seams::close`). Input: the edges at which new faces meet settled ones. Output: thin
//!    faces, most of them without area, that close the surface on the grid. If stage 3 has
//!    stitched, no seams are left, and this stage adds nothing.
//! 5. Emit (`ModelBuilder`). Input: settled faces, new faces, and the base's octree. Output: the
//!    file. The base's unchanged faces are copied block by block (`kept`), the segments of its
//!    octree without changes with new face numbers (`build::copied`), and the sums over the faces
//!    of its unchanged parts from its file (`build::kept`).
//!
//! An exact face has vertices off the grid. Each cell that it is near lists it, so a result can be
//! an operand like any other model. In the octree, on-grid faces represent an exact face: its
//! proxies. Files do not store the exact face of a proxy, but both have the same part and source.
//!
//! Cost of a small change to a large model (one of 16,000 faces, without a tetrahedron; 344 million
//! instructions, of which little depends on the change): a quarter checks that the exact surface is
//! closed, a quarter copies the octree and computes the sums of changed parts, a tenth classifies
//! exact faces, a tenth arranges faces, and the rest reads and copies faces and tables. No model is
//! trusted to be closed, so this part grows with the model. Known limit: a model with intersecting
//! proxies is no base (see `Bodies::new`), nor is one whose proxies must move farther than before.
//! Such an operation builds the whole octree again, and gains nothing from copying.
//!
//! Fates of an operand's faces. "Stage 1": it is kept, reversed or dropped as a whole.
//! "Stage 2": the same, or it is divided, and each region is kept, reversed or dropped.
//!
//! | face             | decided by     | what represents it in the result's octree               |
//! | ---------------- | -------------- | ------------------------------------------------------- |
//! | on-grid, settled | stage 1        | itself                                                  |
//! | on-grid, near    | stage 2        | itself or its regions; new proxies of off-grid regions  |
//! | exact, settled   | stage 1        | its old proxies, or new ones (*)                        |
//! | exact, near      | stage 2        | new proxies                                             |
//! | proxy, settled   | stage 1 (*)    | itself                                                  |
//! | proxy, near      | always dropped | (new proxies are made of its exact face)                |
//! | without area     | always dropped | (stitching makes new ones where the result needs them)  |
//!
//! (*) If an exact face or a proxy is near, all proxies of its part and source are dropped, and new
//! ones are made for all exact faces of that part and source. The same holds for all proxies of a
//! model whose grid is coarser than the common one.
//!
//! Cost, in instructions, of an operation that builds the whole octree: armadillo minus bunny_hr,
//! 146,146 faces of two files with different units, 5.1 billion instructions. The octree builder
//! takes about 30 percent, two thirds of it in leaves, where faces are tested for contacts. Reading
//! and writing settled faces takes 15 to 17 percent, the division of near faces 13, winding numbers
//! of regions and of components 9 each, sums and closure of exact faces 6, the traversal of both
//! octrees 3. If the largest operand has the common unit, cells without changes are copied instead
//! of built. The rest is spread over many stages. Most of them read every settled face, since its
//! number, part and source may change.

mod alignment;
mod bodies;
mod boundary;
#[cfg(test)]
mod chain_tests;
mod common_grid;
mod components;
mod divided;
mod fates;
#[cfg(test)]
mod grid_tests;
mod kept;
mod near_faces;
mod node_table;
mod overlap;
mod owners;
mod refined;
mod table;
#[cfg(test)]
mod table_tests;
#[cfg(test)]
mod tests;
mod values;
mod winding;

use std::mem;
use std::path::Path;

use self::alignment::Aligned;
use self::bodies::{Bodies, Near};
pub use self::boundary::{BoundaryClass, boundary_classes};
use self::common_grid::CommonGrid;
pub use self::divided::divide_faces;
pub(super) use self::near_faces::NearFaces;
pub use self::node_table::{NodePair, OperandKind, TableEntry};
use self::node_table::{PairCounts, node_pairs};
use self::owners::{Owners, PartNumbers};
use self::table::OperationTable;
use self::values::FaceValues;
use self::winding::{settled_above, winding};
use super::arrangement::{
    ExactFace, ExactFaces, FaceAtSample, FaceOwner, Operands, OwnerRule, Resolved, Rounded, SamplePoint,
    Seams, Surroundings, divide, round,
};
use super::store::formula::formula;
use super::{BuildReport, ExactModel, Face, Faces, Grid, ModelBuilder};
use crate::closure::SurfaceClosure;
use spinney_base::io::{Output, directory_of};
use spinney_base::{Error, Progress, Result, SetOperation, SubProgress};
use spinney_container::{Codec, Metadata, Tag};

/// Report of a set operation on bodies.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CombineReport {
    /// Face count of each operand.
    pub before: Vec<u64>,
    /// Face count of the result.
    pub after: u64,
    /// Faces that were arranged: those near other bodies, and all faces without area, wherever they
    /// are. For all other faces, no geometry is computed.
    pub near: u64,
    /// Pairs of faces that touch or intersect.
    pub pairs: u64,
    /// Faces that were divided or trimmed.
    pub divided: u64,
    /// Face value columns that the result drops, since it would have more than 4096 columns.
    pub lost_columns: u64,
    /// Faces of the result without values, since the faces of their source have different values.
    pub lost_values: u64,
    /// Maximum distance that a new vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
    /// Maximum distance that a vertex of an operand was moved to the common grid, in the models'
    /// unit. 0 if the units of all operands' grids are multiples of a common one.
    pub snapped: f64,
    /// Grid of the result.
    pub grid: Grid,
    /// Whether the result includes infinity.
    pub is_unbounded: bool,
    /// Report of the octree. Lists the surface's defects after its new vertices were moved to the
    /// grid. Defects occur where the surface is thinner than one grid unit. Further operations on
    /// the file are correct there, too, since they use the exact faces.
    pub built: BuildReport,
}

/// Writes the result of a set operation on bodies to a file.
///
/// `operation` is a truth table from 0 to 15. The result includes what is in both bodies (bit 0),
/// in the first body only (bit 1), in the second body only (bit 2), in neither (bit 3). So 1 is the
/// intersection, 2 and 4 are the differences, 6 is the symmetric difference, 7 the union, 12 the
/// complement of the first body.
///
/// More than two bodies allow 0 (nothing), 1 (in all bodies), 2 (in the first only), 6 (in an odd
/// number of bodies), 7 (in any body), and 8, 9, 13, 14, 15, the complements of these. One body
/// allows 0, 3, 12 and 15.
///
/// Coordinates do not change if the units of all grids are multiples of a common unit, and the
/// models are at most 2^26 of these units long. Otherwise, as few operands as possible are moved to
/// a common grid, with a warning and by at most [`CombineReport::snapped`]. New vertices are stored
/// exactly, as fractions. Queries of the file use the nearest points of the grid instead, except
/// for volumes.
///
/// Each face of the result belongs to the object that it bounds, where an object is a part that is
/// closed by itself. Intersections and differences have the objects of their first body, each cut
/// by itself. In unions and symmetric differences, objects of different bodies that overlap or have
/// a wall in common become one, with the name and the attributes of the first, and a warning lists
/// others. Complements have the same objects as cavities. Walls between touching objects of one
/// body stay. The module `owners` states the rule for all operations.
/// Faces keep their values, and columns are joined by name. All fragments of a divided face have
/// its values.
///
/// Memory: about 100 bytes for each face in cells near other bodies, and 300 bytes for each face
/// whose box touches theirs, at most half of `memory`; plus 96 bytes for each face with off-grid
/// vertices.
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
/// The octrees of the operands are trusted. The result's grid is that of the largest operand, or a
/// larger one of whose octree it is a cell. Where no face changes, this operand's octree is copied.
/// It is built again if the operand's unit is coarser than the common one, or if it has exact faces
/// and its grid does not contain the other operands. [`ExactModel::verify`] checks an octree.
///
/// # Errors
/// If the operation does not exist for this number of bodies, if grids, coordinate systems or units
/// are incompatible, if the memory is insufficient, if a model is not a solid, if files cannot be
/// read or written, or on cancellation. No file is left in these cases.
pub fn combine(
    operation: SetOperation,
    models: &[&ExactModel],
    output: Output,
    codec: Codec,
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    combined(Request::new(operation), models, (output, codec), memory, progress)
}

/// Origin of a result, which its metadata record instead of the operands' formulas and names.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// Formula; empty for none.
    pub formula: String,
    /// Provenance lines.
    pub provenance: Vec<String>,
    /// Tags in addition to those of the operation.
    pub tags: Vec<(Tag, String)>,
}

/// Like [`combine`], with an explicit origin in the file's metadata.
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
    let request = Request { origin: Some(origin), ..Request::new(operation) };
    combined(request, models, (output, codec), memory, progress)
}

/// Like [`combine`] of two models, and returns the operation's table: for each pair of node kinds,
/// what the operation does with it, and how often the traversals of both octrees met it. (An
/// operation that does not depend on both models is decided at the roots.)
///
/// # Errors
/// Those of [`combine`].
pub fn combine_explained(
    operation: SetOperation,
    models: [&ExactModel; 2],
    output: Output,
    codec: Codec,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(CombineReport, Vec<NodePair>)> {
    let mut counts = PairCounts::default();
    let request = Request { counts: Some(&mut counts), ..Request::new(operation) };
    let report = combined(request, &models, (output, codec), memory, progress)?;
    Ok((report, node_pairs(operation, &counts)))
}

/// Set operation on several models, and the origin of its result.
struct Request<'a> {
    operation: SetOperation,
    /// Origin of the result, if it is not the operation.
    origin: Option<&'a Origin>,
    /// Number of parts into which the unit of the models' grids is divided.
    parts: i64,
    /// Whether faces stay divided along the surfaces of all models.
    keeps_cuts: bool,
    /// Counts of the pairs of nodes of two models, if they are wanted.
    counts: Option<&'a mut PairCounts>,
}

impl Request<'_> {
    fn new(operation: SetOperation) -> Self {
        Request { operation, origin: None, parts: 1, keeps_cuts: false, counts: None }
    }
}

fn combined(
    mut request: Request<'_>,
    models: &[&ExactModel],
    (output, codec): (Output, Codec),
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    // (More memory would allow more than 2^32 faces in it, and face numbers have 32 bits.)
    let memory = memory.min(1 << 38);
    let table = OperationTable::new(request.operation, models.len())?;
    let before = models.iter().map(|model| model.len()).collect();
    let operands = models;
    let aligned;
    let (common_grid, models, snapped) = match CommonGrid::of(models, request.parts)? {
        Some(common_grid) => (common_grid, models.to_vec(), 0.0),
        None => {
            aligned = Aligned::of(models, directory_of(output.path()), output.access(), memory, progress)?;
            let on_one_grid = aligned.models(models);
            let common_grid = CommonGrid::of(&on_one_grid, request.parts)?.ok_or_else(|| {
                Error::invalid(
                    "models",
                    "bounds too large for any grid of 2^26 units",
                    "models of the same region",
                )
            })?;
            (common_grid, on_one_grid, aligned.displacement)
        }
    };
    // (With cuts, the second model matters, too: it divides the faces of the first.)
    let table = if request.keeps_cuts { table.keeping_cuts() } else { table };
    let (relevant, table) = table.on_relevant_bodies();
    if let (Some(counts), [first, second], true) = (&mut request.counts, &models[..], relevant.len() < 2) {
        let roots = [OperandKind::of(&first.root()?), OperandKind::of(&second.root()?)];
        (0..2).for_each(|own| counts.add(own, roots));
    }
    let (common_grid, models) =
        (common_grid.subset(&relevant), relevant.iter().map(|number| models[*number]).collect::<Vec<_>>());
    let is_repeated = |index: usize| models[..index].iter().any(|model| std::ptr::eq(*model, models[index]));
    for index in (0..models.len()).filter(|index| !is_repeated(*index)) {
        models[index].check_surface(progress)?;
    }
    let written =
        write_result((request, snapped), &models, &common_grid, table, (output, codec), memory, progress);
    match written {
        Ok(report) => {
            operands.iter().for_each(|model| model.warn_levels(progress));
            Ok(CombineReport { before, ..report })
        }
        // The cause may be an operand that is not a solid.
        Err(error @ (Error::NotASolid { .. } | Error::Invalid { .. })) => {
            Err(suspect(&models, memory, progress)?.unwrap_or(error))
        }
        Err(error) => Err(error),
    }
}

/// Returns the error for the first model that verification finds not to be a solid, if any.
fn suspect(models: &[&ExactModel], memory: u64, progress: &dyn Progress) -> Result<Option<Error>> {
    for model in models {
        let findings = model.verify(memory, progress)?;
        if !findings.is_empty() {
            let locations = findings.iter().map(|finding| format!("{}: {}", finding.place, finding.problem));
            return Ok(Some(Error::NotASolid {
                path: model.path().to_path_buf(),
                what: "the model is not a solid, or its octree does not match its faces".into(),
                locations: locations.collect(),
                count: findings.len() as u64,
                advice: "build it again".into(),
            }));
        }
    }
    Ok(None)
}

/// Writes the result of an operation on the bodies on which it depends.
fn write_result(
    (request, snapped): (Request<'_>, f64),
    models: &[&ExactModel],
    common_grid: &CommonGrid,
    table: OperationTable,
    (output, codec): (Output, Codec),
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    let Request { operation, origin, keeps_cuts, counts, .. } = request;
    let grid = common_grid.grid.clone();
    let path = models.first().map_or(Path::new(""), |model| model.path());
    let owners = match models.len() > 1 && !keeps_cuts {
        true => Some(Owners::of(models, common_grid, table, memory / 8, progress)?),
        false => None,
    };
    let mut bodies = Bodies::new(models, common_grid, (table, counts), owners, progress)?;
    bodies.settle_components(memory / 2, progress)?;
    let is_unbounded = table.is_inside(&models.iter().map(|model| model.far_winding()).collect::<Vec<_>>());
    let mut builder = ModelBuilder::new(output, grid.clone(), memory / 2)?
        .codec(codec)
        .unbounded(is_unbounded)
        .reach(bodies.reach());
    // Invariant: the base's surface is closed. So it is sufficient to subtract the base's faces
    // that go; those that stay need not be added.
    let mut surface = SurfaceClosure::new(true);
    let mut values = FaceValues::of(models)?;
    let Near { faces, ends, mut seams, settled_faces, base } =
        bodies.near(Some((&mut builder, &mut surface, &mut values)), memory / 2, progress)?;
    let far: Vec<i32> = models.iter().map(|model| model.far_winding()).collect();
    let owner_rule = |sample: &SamplePoint<'_>, windings: [&[i32]; 2], faces: &[FaceAtSample]| {
        let owners = bodies.owners.as_ref();
        owners.map_or(Ok(FaceOwner::default()), |owners| owners.of_region(sample, windings, faces))
    };
    let operands = Operands {
        ends: &ends,
        far: &far,
        are_bodies: true,
        keeps_cuts,
        winding: &|number, sample| Some(winding(models[number], number, common_grid, sample)),
        owners: bodies.owners.as_ref().map(|_| &owner_rule as &OwnerRule<'_>),
        is_inside: &|windings| table.is_inside(windings),
        ..Operands::NONE
    };
    let near = faces.list.len();
    let all = models.iter().map(|model| model.len()).sum::<u64>();
    let progress_of = |faces: u64| SubProgress::new(progress, faces, near + all);
    let (mut exact, done) = divide(&faces, &operands, path, memory / 2, &progress_of(near))?;
    drop(faces);
    let Resolved { pairs, divided, .. } = done;
    settled_faces.into_iter().for_each(|face| exact.push(face));
    let rounded = on_grid(exact, &bodies, &mut seams, (is_unbounded, path), memory / 2, progress)?;
    // Invariant: the leaves list exact faces up to the file's `reach`, the maximum distance of a
    // proxy from its exact face. So a base with exact faces whose octree is copied must have the
    // result's reach. (If the base is rejected, removals already recorded for it are discarded.)
    let mut base = base.filter(|base| !base.model.has_exact_faces() || base.model.reach() == rounded.reach);
    match base {
        Some(_) => builder = builder.keeping(),
        None => surface = SurfaceClosure::new(true),
    }
    if rounded.reach != bodies.reach() {
        builder = builder.reach(rounded.reach);
    }
    let Rounded { faces, is_proxy, exact, displacement, reach, .. } = rounded;
    let displacement = displacement * grid.width();
    // Invariant: all divisions are done by now, so no more objects are united.
    let parts = match &bodies.owners {
        Some(owners) => owners.numbers(origin.is_none(), progress),
        None => PartNumbers::unchanged(models),
    };
    let mut settled = match &mut base {
        Some(base) => bodies.keep_faces(base, &parts, (&mut builder, &mut seams), &values, progress)?,
        None => 0,
    };
    bodies.settled(base.is_some(), progress, &mut |number, face, is_proxy| {
        settled += 1;
        seams.add_watched(face);
        surface.add(face, is_proxy);
        builder.push_face(&Face { part: parts.of(face.part), ..*face }, is_proxy)?;
        values.copy(number, face.number, &mut builder)
    })?;
    faces.each(&mut |face| {
        let is_proxy = is_proxy[face.number as usize];
        surface.add(face, is_proxy);
        builder.push_face(&Face { part: parts.of(face.part), ..*face }, is_proxy)?;
        values.give(face, &mut builder)
    })?;
    let mut after = settled + faces.len();
    seams.close(reach, faces.is_coloured(), &mut |face| {
        after += 1;
        surface.add(face, true);
        builder.push_face(&Face { part: parts.of(face.part), ..*face }, true)?;
        values.give(face, &mut builder)
    })?;
    drop(faces);
    if let Some(base) = &base {
        bodies.keep_exact(base, &mut builder, progress)?;
    }
    let mut push_exact = |face: ExactFace| {
        surface.add_exact(&face, progress)?;
        builder.push_exact(ExactFace { part: parts.of(face.part), ..face })
    };
    bodies.settled_exact(base.is_some(), progress, &mut push_exact)?;
    exact.into_iter().try_for_each(&mut push_exact)?;
    if let Some(flaw) = surface.flaw() {
        return Err(Error::NotASolid {
            path: path.to_path_buf(),
            what: format!("the result would not be a solid, so at least one of the models is not: {flaw}"),
            locations: Vec::new(),
            count: 0,
            advice: "check them with verify, and build them again with --repair".into(),
        });
    }
    let is_on_grid = !builder.has_exact_faces();
    let mut builder = builder.formula(match origin {
        Some(origin) => origin.formula.clone(),
        None => formula(operation, models)?,
    });
    // (Divided faces all belong to the first model.)
    let kept = if keeps_cuts { &models[..1] } else { models };
    let mut number = 0..;
    for model in kept {
        for ((part, name), number) in (0..).zip(model.parts()).zip(&mut number) {
            if !parts.dropped.has(number) {
                builder.part(name, model.part_attributes(part)?.as_deref())?;
            }
        }
        model.file_attributes()?.iter().try_for_each(|text| builder.about_file(text))?;
    }
    let mut metadata = metadata(operation, models, &grid);
    metadata.set_tag(Tag::ModelDisplacement, (displacement + snapped).to_string());
    if let Some(origin) = origin {
        metadata.provenance.clone_from(&origin.provenance);
        origin.tags.iter().for_each(|(tag, text)| metadata.set_tag(*tag, text));
    }
    let built = builder.finish_with(base.as_ref(), &mut metadata, &progress_of(all))?;
    if built.defect_count > 0 && is_on_grid {
        return Err(built.error(
            path,
            "the result intersects itself, so at least one of the models does",
            "check them with verify, and build them again with --repair",
        ));
    }
    let FaceValues { lost_columns, lost_values, .. } = values;
    if lost_columns > 0 {
        let most = ModelBuilder::MAX_COLUMNS;
        let text = format!("{lost_columns} columns of face values are not kept: the maximum is {most}");
        progress.warn(path, &text);
    }
    if lost_values > 0 {
        let text = format!(
            "the values of {lost_values} divided faces are not kept: other faces with the same sources have different values"
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

/// Snaps the arranged faces to the grid. If they intersect there, also stitches and mends them.
/// `seams` holds the edges at which they meet the settled faces. It is empty after stitching;
/// otherwise the caller stitches, after it has counted the settled faces.
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
        bodies.settled(false, progress, &mut |_, face, _| {
            seams.add_watched(face);
            Ok(())
        })?;
        // Settled faces are not tested for contacts with the new ones, and their contribution to
        // winding numbers is assumed to be constant within a region. Rounding keeps it so: each
        // new vertex lies on faces of two bodies, and so on a face of another body than a given
        // settled face. It is more than one grid unit away from the settled face along some axis
        // (see `Overlap` and `components`), and moves by at most half a unit per axis.
        //
        // Known defect: nothing guarantees it in two cases. A face that rounding tilts may cross a
        // settled face of its own body, if they are closer than a grid unit. And mending moves
        // proxies by up to 10 units, with contacts tested within the list only. A sample may then
        // lie on the wrong side of a settled face, and faces that should stay are removed. If that
        // opens an edge or removes a whole body, mending fails, and the unmended faces are used.
        // The exact faces are kept in all cases, and the builder reports where proxies intersect
        // settled faces.
        let rest = |sample: &SamplePoint<'_>| settled_above(bodies, sample);
        let around = Surroundings { is_unbounded, reach: bodies.reach(), rest: Some(&rest) };
        rounded = rounded.stitch_and_mend(mem::take(seams), crossings, &around, path, memory, progress)?;
    }
    // (New proxies lie within the reach that mending needed; unchanged ones within the operands'
    // reach.)
    rounded.reach = rounded.reach.max(bodies.reach());
    Ok(rounded)
}

/// Frame, unit and provenance of the result.
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
