//! Operations from files to files.

use std::path::{Path, PathBuf};

use numpy::PyArray2;
use numpy::ndarray::Array2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::brep::{Faces as _, Motion, TransformOptions, add_levels, with_levels};
use spinney::edit::{Commit, Note};
use spinney::export::VectorFormat;
use spinney::lines::LineTree;
use spinney::points::PointTree;
use spinney::raw::brep::is_model_file;
use spinney::raw::dataset;
use spinney::raw::import::feature::{ReprojectOptions, SystemChange, reproject_features};
use spinney::raw::io::any_file;
use spinney::raw::lines::is_line_file;
use spinney::raw::ops::{self, AffineMap, FdRange, Outcome, Prefer, ReconcileOptions};
use spinney::raw::points::is_point_file;
use spinney::raw::store::autumnal::{self, CompactOptions, History, Keep};
use spinney::{
    Codec, CombineOperation, CombineOptions, ExactModel, FileView, Header, Metadata, Number, Output,
    Progress as _, Universe, ViewOperation, WarpOptions,
};

use crate::error::{OrRaise, invalid};
use crate::features_over::{FeatureTerms, operand};
use crate::jobs::{self, Terms, access};
use crate::numbers::{PyNumber, plain};
use crate::packing::Packing;

/// Fails if the output is one of the inputs, or has cells of one.
pub(crate) fn check_output(inputs: &[PathBuf], output: &Path) -> PyResult<()> {
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    ops::overwritten_input(&inputs, output).map_or(Ok(()), |message| Err(invalid(message)))
}

/// Returns whether two names refer to one file.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Returns the measures of a new tree, by name.
fn outcome<'py>(py: Python<'py>, outcome: &Outcome) -> PyResult<Bound<'py, PyDict>> {
    let facts = PyDict::new(py);
    facts.set_item("extent", outcome.extent)?;
    facts.set_item("depth", outcome.depth)?;
    facts.set_item("before", outcome.before.clone())?;
    facts.set_item("after", outcome.after)?;
    let conversions: Vec<String> = outcome.conversions.iter().map(ToString::to_string).collect();
    facts.set_item("conversions", conversions)?;
    Ok(facts)
}

/// Returns the properties of a commit, by name.
pub(crate) fn commit_facts<'py>(py: Python<'py>, commit: &Commit) -> PyResult<Bound<'py, PyDict>> {
    let facts = PyDict::new(py);
    facts.set_item("number", commit.number)?;
    facts.set_item("time", commit.note.time)?;
    facts.set_item("author", &commit.note.author)?;
    facts.set_item("message", &commit.note.message)?;
    facts.set_item("cells", commit.cells)?;
    facts.set_item("records", commit.inner_nodes)?;
    facts.set_item("bytes", commit.written.bytes)?;
    Ok(facts)
}

/// Parses view operations, written as on the command line.
pub(crate) fn steps_of(strings: &[String]) -> PyResult<Vec<ViewOperation>> {
    strings.iter().map(|step| step.parse().or_raise()).collect()
}

/// Combines a file, view operations, the name of a resampling method, and whether ballpark datum
/// shifts are allowed.
pub(crate) fn chain_of(
    path: &Path,
    steps: Vec<ViewOperation>,
    (resampling, allow_ballpark): (Option<&str>, bool),
    moves: bool,
) -> PyResult<FileView> {
    let mut warp = WarpOptions::default();
    warp.resampling = resampling.map(str::parse).transpose().or_raise()?;
    warp.allow_ballpark = allow_ballpark;
    Ok(FileView { steps, moves, warp, access: access().clone(), ..FileView::of(path) })
}

/// Returns the region that an operation fills: a box in world coordinates, or a margin in cells
/// around the rasters.
pub(crate) fn universe_of(
    operation: CombineOperation,
    within: Option<&[f64]>,
    margin: Option<u32>,
) -> PyResult<Option<Universe>> {
    let universe = match (within, margin) {
        (None, None) => None,
        (None, Some(cells)) => Some(Universe::Margin(cells)),
        (Some(&[a, b, c, d]), None) => Some(Universe::Within([a, b, 0.0], [c, d, 0.0])),
        (Some(&[a, b, c, d, e, f]), None) => Some(Universe::Within([a, b, c], [d, e, f])),
        (Some(_), Some(_)) => return Err(invalid("within, margin: got both, expected one of them")),
        (Some(_), None) => return Err(invalid("within: expected 4 numbers, or 6 for octrees")),
    };
    if universe.is_some() && !operation.needs_universe() {
        return Err(invalid("within, margin: are for operations that fill cells that no file has"));
    }
    Ok(universe)
}

/// Builds a tree from a file and view operations.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn transform<'py>(
    py: Python<'py>,
    path: PathBuf,
    mut steps: Vec<String>,
    out: PathBuf,
    resampling: Option<String>,
    allow_ballpark: bool,
    moves: bool,
    of_model: (Option<f64>, Option<String>),
    memory: u64,
    packing: Packing,
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    let has_levels = take_levels(&mut steps)?;
    let steps = steps_of(&steps)?;
    let others = steps.iter().flat_map(ViewOperation::files).map(Path::to_path_buf);
    let inputs: Vec<PathBuf> = others.chain([path.clone()]).collect();
    check_output(&inputs, &out)?;
    if is_model_file(&path, access()).or_raise()? {
        if resampling.is_some() || allow_ballpark || moves {
            return Err(invalid("resampling, allow_ballpark, move: do not apply to exact models"));
        }
        let mut options = TransformOptions::new(memory);
        ((options.snap, options.unit), options.codec) = (of_model, packing.of_model()?);
        options.levels = has_levels;
        return transform_exact(py, &path, steps, &out, options, terms);
    }
    if has_levels {
        return Err(invalid(format!("{}: is not an exact model, which levels needs", path.display())));
    }
    let (snap, unit) = of_model;
    if snap.is_some() {
        return Err(invalid("snap: is for exact models"));
    }
    let mut chain = chain_of(&path, steps, (resampling.as_deref(), allow_ballpark), moves)?;
    chain.unit = unit;
    let how = packing.with(memory);
    let made = jobs::run(py, terms, |work| spinney::transform(&chain, work.create_tree(&out)?, how, work))?;
    outcome(py, &made)
}

/// Writes the features of a file in another coordinate system; returns their number.
#[pyfunction]
pub(crate) fn reproject(
    py: Python<'_>,
    path: PathBuf,
    steps: Vec<String>,
    out: PathBuf,
    allow_ballpark: bool,
    memory: u64,
    terms: Terms,
) -> PyResult<u64> {
    check_output(std::slice::from_ref(&path), &out)?;
    let format = VectorFormat::of(&out).ok_or_else(|| {
        let expected = "expected .geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply";
        invalid(format!("{}: {expected}", out.display()))
    })?;
    let steps = SystemChange::of_view(&path, &steps_of(&steps)?).or_raise()?;
    let mut options = ReprojectOptions { operations: steps, allow_ballpark, ..ReprojectOptions::default() };
    options.features.memory = memory;
    jobs::run(py, terms, |work| reproject_features(&path, &options, work.create(&out)?, format, work))
}

/// Removes the operation that adds levels of detail, which must be the last one; returns whether
/// there is one.
fn take_levels(steps: &mut Vec<String>) -> PyResult<bool> {
    match steps.iter().position(|step| step == "levels") {
        None => Ok(false),
        Some(index) if index + 1 == steps.len() => Ok(steps.pop().is_some()),
        Some(_) => Err(invalid("levels: is followed by another operation, expected it to be the last one")),
    }
}

/// Transforms an exact model into a new one, or adds levels of detail; returns counts by name.
fn transform_exact<'py>(
    py: Python<'py>,
    path: &Path,
    steps: Vec<ViewOperation>,
    out: &Path,
    mut options: TransformOptions,
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    let facts = PyDict::new(py);
    if options.levels && steps.is_empty() && options.snap.is_none() && options.unit.is_none() {
        let faces = jobs::run(py, terms, |work| {
            let model = ExactModel::open(path, &access().into())?;
            add_levels(&model, (work.create_tree(out)?, options.codec), options.memory, work)?;
            Ok(model.len())
        })?;
        facts.set_item("before", faces)?;
        facts.set_item("faces", faces)?;
        facts.set_item("is_exact", true)?;
        facts.set_item("displacement", 0.0)?;
        ["cut", "collapsed", "rounded"].into_iter().try_for_each(|name| facts.set_item(name, 0))?;
        return Ok(facts);
    }
    let strings: Vec<String> = steps.iter().map(ViewOperation::to_string).collect();
    options.note = (!strings.is_empty()).then(|| strings.join(", "));
    let mut map = AffineMap::IDENTITY;
    for step in steps {
        match step {
            ViewOperation::Crs(crs) => options.crs = Some(crs),
            step => map = map.then(&step.as_map().or_raise()?),
        }
    }
    let motion = Motion::from_rows(map.to_rows()).or_raise()?;
    let made = jobs::run(py, terms, |work| {
        let model = ExactModel::open(path, &access().into())?;
        let transformed = |output: Output| spinney::brep::transform(&model, &motion, &options, output, work);
        match options.levels {
            true => with_levels(work.create_tree(out)?, options.memory, work, transformed),
            false => transformed(work.create_tree(out)?),
        }
    })?;
    facts.set_item("before", made.before)?;
    facts.set_item("faces", made.after)?;
    facts.set_item("is_exact", made.is_exact)?;
    facts.set_item("displacement", made.displacement)?;
    facts.set_item("cut", made.cut)?;
    facts.set_item("collapsed", made.collapsed)?;
    facts.set_item("rounded", made.rounded)?;
    Ok(facts)
}

/// Combines trees into one.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn combine<'py>(
    py: Python<'py>,
    operation: &str,
    paths: Vec<PathBuf>,
    out: PathBuf,
    prefer_second: bool,
    fill: Option<PyNumber>,
    within: Option<Vec<f64>>,
    margin: Option<u32>,
    reconcile: Reconcile,
    features: Vec<(usize, FeatureTerms<'py>)>,
    memory: u64,
    packing: Packing,
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    let (fill, reconcile) = (fill.map(|number| number.0), reconcile.options()?);
    let prefer = if prefer_second { Prefer::Second } else { Prefer::First };
    let operation = named(operation, prefer)?;
    let universe = universe_of(operation, within.as_deref(), margin)?;
    check_output(&paths, &out)?;
    if any_file(&paths, &|path| is_model_file(path, access())).or_raise()? {
        if !features.is_empty() {
            return Err(invalid("features: are combined with trees of cells, not with exact models"));
        }
        let is_given =
            prefer_second || fill.is_some() || universe.is_some() || reconcile != ReconcileOptions::default();
        if is_given {
            let text = "values, fill, within, margin, extent, classes, units: do not apply to exact models";
            return Err(invalid(text));
        }
        return combine_exact(py, operation, &paths, &out, (memory, packing.of_model()?), terms);
    }
    let features = features.into_iter().map(|(place, terms)| Ok((place, terms.read()?)));
    let features = features.collect::<PyResult<Vec<_>>>()?;
    let made = jobs::run(py, terms, |work| {
        let options = CombineOptions { fill, universe: universe.unwrap_or_default(), reconcile };
        let makers: Vec<_> = features
            .iter()
            .map(|(_, features)| {
                move |header: &Header, metadata: &Metadata| {
                    let laid = features.over(header, metadata, memory, work)?;
                    if laid.beyond > 0 {
                        let text = "features extend beyond the cells of the trees, and were clipped";
                        work.warn(&features.path, &format!("{} {text}", laid.beyond));
                    }
                    Ok(laid.tree)
                }
            })
            .collect();
        let operands: Vec<_> = features
            .iter()
            .zip(&makers)
            .map(|((place, features), make)| operand(*place, &features.path, make))
            .collect();
        ops::combine_with(
            operation,
            options,
            &paths,
            &operands,
            work.create_tree(&out)?.into(),
            packing.with(memory),
            work,
        )
    })?;
    outcome(py, &made)
}

/// Combines exact models into one; returns counts by name.
fn combine_exact<'py>(
    py: Python<'py>,
    operation: CombineOperation,
    paths: &[PathBuf],
    out: &Path,
    (memory, codec): (u64, Codec),
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    let CombineOperation::Set { operation, .. } = operation else {
        return Err(invalid(
            "operation: got one of values, expected a set operation (0 to 15) for exact models",
        ));
    };
    let made = jobs::run(py, terms, |work| {
        let models = paths.iter().map(|path| ExactModel::open(path, &access().into()));
        let models = models.collect::<spinney::Result<Vec<_>>>()?;
        let models: Vec<&ExactModel> = models.iter().collect();
        spinney::brep::combine(operation, &models, work.create_tree(out)?, codec, memory, work)
    })?;
    let facts = PyDict::new(py);
    facts.set_item("before", made.before)?;
    facts.set_item("faces", made.after)?;
    facts.set_item("pairs", made.pairs)?;
    facts.set_item("divided", made.divided)?;
    facts.set_item("displacement", made.displacement)?;
    facts.set_item("snapped", made.snapped)?;
    facts.set_item("is_unbounded", made.is_unbounded)?;
    facts.set_item("defects", made.built.defect_count)?;
    Ok(facts)
}

/// How operands are reconciled with the first: extent, classes, units, and whether numbers are
/// rounded.
#[derive(FromPyObject)]
pub(crate) struct Reconcile(String, String, String, bool);

impl Reconcile {
    pub(crate) fn options(&self) -> PyResult<ReconcileOptions> {
        let Reconcile(extent, classes, units, round) = self;
        let units_by_number = match &**units {
            "convert" => false,
            "number" => true,
            _ => return Err(invalid(format!("units: got {units:?}, expected 'convert' or 'number'"))),
        };
        let (extent, classes) = (extent.parse().or_raise()?, classes.parse().or_raise()?);
        Ok(ReconcileOptions { extent, classes, units_by_number, round: *round })
    }
}

/// Returns the operation with this name.
pub(crate) fn named(name: &str, prefer: Prefer) -> PyResult<CombineOperation> {
    let operation = CombineOperation::named(name, prefer);
    operation.ok_or_else(|| {
        invalid(format!("operation: got `{name}`, which is unknown; see `spinney help combine`"))
    })
}

/// Samples of two values at the same cells, and the number of these cells.
type Pairs<'py> = Vec<(Option<Vec<Bound<'py, PyAny>>>, Option<Vec<Bound<'py, PyAny>>>, u64)>;

/// Counts which values of one file coincide with which values of another.
#[pyfunction]
pub(crate) fn cross(
    py: Python<'_>,
    first: PathBuf,
    second: PathBuf,
    reconcile: Reconcile,
    terms: Terms,
) -> PyResult<Pairs<'_>> {
    let options = reconcile.options()?;
    let (pairs, _) =
        jobs::run(py, terms, |work| ops::crosstab_files(&first, &second, &options, access(), work))?;
    let value = |samples: Option<Vec<Number>>| {
        samples.map(|samples| samples.into_iter().map(|sample| plain(py, sample)).collect()).transpose()
    };
    pairs.into_iter().map(|(first, second, cells)| Ok((value(first)?, value(second)?, cells))).collect()
}

/// Sums of differences, and the differing path ranges.
type Compared<'py> = ([u64; 5], Option<Bound<'py, PyArray2<u64>>>);

/// Compares two trees. Returns the counts of added, removed and changed cells, of blocks and of
/// ranges; on request also the ranges.
#[pyfunction]
pub(crate) fn diff<'py>(
    py: Python<'py>,
    first: PathBuf,
    second: PathBuf,
    ranges: bool,
    reconcile: Reconcile,
    terms: Terms,
) -> PyResult<Compared<'py>> {
    let (mut runs, options): (Vec<FdRange>, _) = (Vec::new(), reconcile.options()?);
    let found = jobs::run(py, terms, |work| {
        if !ranges {
            return ops::differences(&first, &second, &options, access(), work);
        }
        ops::diff_files(&first, &second, &options, access(), work, &mut |range| {
            runs.push(range);
            Ok(())
        })
    })?;
    let found = found.differences;
    let sums = [found.added, found.removed, found.changed, found.blocks, found.runs];
    let list = Array2::from_shape_fn((runs.len(), 2), |(run, end)| [runs[run].first, runs[run].last][end]);
    Ok((sums, ranges.then(|| PyArray2::from_owned_array(py, list))))
}

/// Returns all defects of a file: their locations and descriptions.
#[pyfunction]
pub(crate) fn verify(
    py: Python<'_>,
    path: PathBuf,
    quick: bool,
    memory: u64,
    terms: Terms,
) -> PyResult<Vec<(String, String)>> {
    let findings = jobs::run(py, terms, |work| {
        if is_model_file(&path, access())? {
            return ExactModel::open(&path, &access().into())?.verify(memory, work);
        }
        if is_point_file(&path, access())? {
            return PointTree::open(&path, &access().into())?.verify(work);
        }
        if is_line_file(&path, access())? {
            return LineTree::open(&path, &access().into())?.verify(memory, work);
        }
        let tree = dataset::open(&path, &access().into())?;
        if quick { tree.verify_quickly(memory, work) } else { tree.verify(memory, work) }
    })?;
    Ok(findings.into_iter().map(|finding| (finding.place, finding.problem)).collect())
}

/// Writes an unchanged tree in the format of the output's name.
#[pyfunction]
pub(crate) fn convert(
    py: Python<'_>,
    path: PathBuf,
    out: PathBuf,
    share: bool,
    memory: u64,
    packing: Packing,
    terms: Terms,
) -> PyResult<()> {
    check_output(std::slice::from_ref(&path), &out)?;
    let how = packing.with(memory);
    jobs::run(py, terms, |work| spinney::convert(&path, share, work.create_tree(&out)?, how, work))
}

/// Adds a tree to a file as a layer; returns the commit's number if the file has commits.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn add_layer(
    py: Python<'_>,
    path: PathBuf,
    tree: PathBuf,
    name: String,
    steps: Vec<String>,
    note: (Option<i64>, String, String),
    memory: u64,
    packing: Packing,
    terms: Terms,
) -> PyResult<Option<u64>> {
    let steps = steps.iter().map(|step| step.parse().or_raise()).collect::<PyResult<Vec<ViewOperation>>>()?;
    let (chain, note) = (FileView { steps, access: access().clone(), ..FileView::of(&tree) }, note_of(note));
    jobs::run(py, terms, |work| {
        let commit = ops::add_layer(&path, &name, &chain, note, packing.with(memory), work)?;
        Ok(commit.map(|commit| commit.number))
    })
}

/// Removes a layer from a file; returns the commit's number if the file has commits.
#[pyfunction]
pub(crate) fn drop_layer(
    py: Python<'_>,
    path: PathBuf,
    name: String,
    note: (Option<i64>, String, String),
    terms: Terms,
) -> PyResult<Option<u64>> {
    let note = note_of(note);
    jobs::run(py, terms, |work| {
        let commit = ops::drop_layer(&path, &name, note, access(), work)?;
        Ok(commit.map(|commit| commit.number))
    })
}

fn note_of((time, author, message): (Option<i64>, String, String)) -> Note {
    Note { time, author, message }
}

/// Writes a tree of the numbers of the commits that last changed each cell.
#[pyfunction]
pub(crate) fn blame(
    py: Python<'_>,
    path: PathBuf,
    out: PathBuf,
    memory: u64,
    packing: Packing,
    terms: Terms,
) -> PyResult<()> {
    check_output(std::slice::from_ref(&path), &out)?;
    let how = packing.with(memory);
    jobs::run(py, terms, |work| ops::blame(&path, work.create_tree(&out)?, how, work))
}

/// Writes the newest commits of a file, or those with the given numbers, to a new file.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn compact<'py>(
    py: Python<'py>,
    path: PathBuf,
    out: PathBuf,
    keep: u64,
    commits: Option<Vec<u64>>,
    share: bool,
    pack: bool,
    memory: u64,
    terms: Terms,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    check_output(std::slice::from_ref(&path), &out)?;
    let keep = commits.map_or(Keep::Last(keep), Keep::Numbers);
    let options = CompactOptions::new(&keep, memory).share(share).pack(pack);
    let made =
        jobs::run(py, terms, |work| autumnal::compact(&path, &options, work.create_tree(&out)?, work))?;
    made.iter().map(|commit| commit_facts(py, commit)).collect()
}

/// Makes an older commit the newest if later commits are corrupt.
#[pyfunction]
pub(crate) fn recover<'py>(
    py: Python<'py>,
    path: PathBuf,
    to: u64,
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    let commit = jobs::run(py, terms, |work| autumnal::recover(&path, to, access(), work))?;
    commit_facts(py, &commit)
}

/// Returns the commits of a file, newest first.
#[pyfunction]
pub(crate) fn log<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let commits = jobs::run(py, Terms::default(), |work| {
        let history = History::open(&path, &access().into())?;
        let mut commits: Vec<Commit> = Vec::new();
        for commit in history.commits() {
            work.check()?;
            commits.push(commit?);
        }
        history.check_unchanged()?;
        Ok(commits)
    })?;
    commits.iter().map(|commit| commit_facts(py, commit)).collect()
}
