//! Operations from files to files.

use std::path::{Path, PathBuf};

use super::affine::{Sampling, View};
use super::combine::Combined;
use super::crosstab::{Pair, crosstab};
use super::layers::layer_paths;
use super::operation::CombineOperation;
use super::reconcile::{Conversion, Description, Needs, ReconcileOptions, Target, reconcile};
use super::regions::ScanContext;
use super::tree_file::TreeFile;
use super::universe::{CombineOptions, Universe};
use super::view_operation::ViewOperation;
use super::view_source::ViewSource;
use super::warp::{Resampling, WarpOptions};
use crate::store::{BuildOptions, TreeTarget, TreeWriter, WriteOptions, check_space};
use crate::tree::Source;
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::Bounds;
use spinney_base::value::{DataKind, Number, Rule, Value};
use spinney_base::{Error, Progress, Result, SubProgress, TreeType};
use spinney_container::{FileReference, Header, Metadata, Shape};

/// View of a file: operations that are applied to it, such as crop, scale or warp.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FileView {
    /// The file.
    pub path: PathBuf,
    /// Name for messages, if it differs from the path.
    pub name: Option<PathBuf>,
    /// How the file, and files that operations name, are opened.
    pub access: FileAccess,
    /// Operations, first to last.
    pub steps: Vec<ViewOperation>,
    /// Whether the data move in the world together with their cells, instead of keeping their
    /// position in the world.
    pub moves: bool,
    /// Options for operations with another grid. [`Resampling::Nearest`] applies to all operations:
    /// new cells have the value at their centre, also where the file's rule would average.
    pub warp: WarpOptions,
    /// Unit of length of the result, for octrees without a coordinate system: world coordinates are
    /// converted from the file's unit, if it has one.
    pub unit: Option<String>,
}

/// Measures of a tree that was made from others.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Cells along each axis.
    pub extent: [u64; 3],
    /// Levels below the root.
    pub depth: u8,
    /// Cells of each input that are not VOID.
    pub before: Vec<u64>,
    /// Cells of the result that are not VOID.
    pub after: u64,
    /// Cells that the first input's would become after scaling, if none were cut off or decided at
    /// cell centres; `None` for solids of occupancy, which keep their volume.
    pub expected: Option<f64>,
    /// Box in which cells that no input has were filled, if the operation fills cells.
    pub universe: Option<Bounds>,
    /// Conversions of inputs to the first one's grid and values, a line for each.
    pub conversions: Vec<Conversion>,
}

/// Progress units of a pass over all cells.
const WHOLE: u64 = 1 << 32;

/// Pair of values, by channel, and the number of cells in which they coincide: the first tree's
/// value, the second's (`None` is VOID).
pub type PairOfSamples = (Option<Vec<Number>>, Option<Vec<Number>>, u64);

impl FileView {
    /// A file without operations.
    pub fn of(path: &Path) -> FileView {
        FileView { path: path.into(), ..FileView::default() }
    }

    /// Opens the file and applies the operations to the whole of it.
    ///
    /// # Errors
    /// If the file cannot be read, or an operation cannot be applied.
    pub fn open(&self) -> Result<View> {
        self.open_with(&mut |view, step| step.apply(view))
    }

    fn open_with(&self, apply: &mut dyn FnMut(View, &ViewOperation) -> Result<View>) -> Result<View> {
        let file = TreeFile::open(&self.path, &(&self.access).into())?;
        let has_grid = self.steps.iter().any(ViewOperation::leads_to_grid);
        if self.warp.allow_ballpark && !has_grid {
            let expected = "an operation that changes the coordinate system (like=, warp= or grid=)";
            return Err(Error::invalid("allow-ballpark", "operations in one coordinate system", expected));
        }
        let is_nearest = self.warp.resampling == Some(Resampling::Nearest);
        if let (Some(way), false, false) = (self.warp.resampling, is_nearest, has_grid) {
            let expected = "nearest, or an operation with a grid (like=, warp= or grid=): all others use the file's rule";
            return Err(Error::invalid("resampling", way.name(), expected));
        }
        let view = self.steps.iter().try_fold(View::whole(file.into())?.warping(self.warp), apply)?;
        let view = match &self.unit {
            Some(unit) => view.in_unit(unit).map_err(|error| error.of_file(&self.path))?,
            None => view,
        };
        // (A calculation may have another rule than the file.)
        let rule = view.source().header().rule;
        if is_nearest { Ok(view) } else { view.sampled(Sampling::Area(rule)) }
    }

    /// Line for the result's provenance.
    fn provenance(&self) -> String {
        let mut steps: Vec<String> = self.steps.iter().map(ViewOperation::to_string).collect();
        steps.extend(self.unit.iter().map(|unit| format!("unit {unit}")));
        let colon = if steps.is_empty() { "" } else { ": " };
        format!("view of {}{colon}{}", self.path.display(), steps.join(", "))
    }
}

/// Writes a tree from a file and the operations on it; without operations a condensed copy.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::{CombineOperation, CombineOptions, Output, WriteOptions, combine};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("turned.goblin");
/// let mut chain = spinney::FileView::of("fixtures/v1/classes.goblin".as_ref());
/// chain.steps = vec!["rotate=90".parse()?, "crop".parse()?];
/// let outcome = spinney::transform(&chain, Output::create(&path)?, WriteOptions::new(64 << 20), &())?;
/// assert_eq!(outcome.before, [outcome.after]);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read, an operation cannot be applied, the output cannot be written, or on
/// cancellation.
pub fn transform(
    chain: &FileView,
    output: Output,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<Outcome> {
    transform_to(chain, output.into(), how, progress)
}

/// Writes the result of [`transform`], or a shard of it.
///
/// # Errors
/// Those of [`transform`]; also if a shard is requested of an operation that scans all cells first,
/// such as components.
pub fn transform_to(
    chain: &FileView,
    target: TreeTarget,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<Outcome> {
    if target.whole().is_none()
        && let Some(step) = chain.steps.iter().find(|step| step.passes() > 0)
    {
        let advice = "write its result to a file first, then build the shards from that file";
        return Err(Error::unsupported(
            &chain.path,
            format!("{step}, which scans all cells first, in a sharded build"),
            advice,
        ));
    }
    let mut derivations = Vec::new();
    let mut expected = Some(0.0);
    // (A calculation with the layers of a file is one tree.)
    let is_calculated = chain.steps.iter().any(|step| matches!(step, ViewOperation::Calculation(_)));
    let paths =
        if is_calculated { vec![chain.path.clone()] } else { layer_paths(&chain.path, &chain.access)? };
    let passes = 1 + chain.steps.iter().map(ViewOperation::passes).sum::<u64>();
    let total = WHOLE * passes * paths.len() as u64;
    let layers = paths.len() as u64;
    let temporary = target.temporary();
    for path in paths {
        let chain = FileView { path, ..chain.clone() };
        let view = chain.open_with(&mut |view, step| {
            let part = SubProgress::new(progress, WHOLE * step.passes(), total);
            // (What it computes stays in memory until everything is written.)
            let memory = how.memory / layers;
            // (Labels differ wherever values do, so the result does not have fewer nodes.)
            if let (ViewOperation::Components(_), Some(output), false) =
                (step, target.whole(), view.has_windows())
            {
                check_space(output, view.form(), false, expected_records(&view)?)?;
            }
            step.apply_whole(view, &ScanContext { memory, directory: &temporary, progress: &part })
        })?;
        // Expected number of cells, unless some were cut off. (On a grid of another coordinate
        // system cells vary in size, and calculated cells may be VOID anywhere. Cells of solids are
        // full in part: their number does not determine the volume, which is kept.)
        let keeps_volume = view.sampling() == Sampling::Area(Rule::Occupancy);
        let is_known = !view.has_windows() && !view.source().is_computed() && !keeps_volume;
        let shrinks = is_known.then(|| view.to_source().determinant().abs());
        // (The number of nodes of a window is unknown.)
        let least = if view.has_windows() { 0 } else { expected_records(&view)? };
        let before = view.source().cells_before()? as f64;
        let view = if chain.moves { view } else { view.of_level()? };
        expected = expected.zip(shrinks).map(|(sum, volume)| sum + before / volume);
        derivations.push(Derivation {
            least,
            views: vec![view],
            operation: CombineOperation::Over,
            fill: None,
            universe: Universe::Usual,
            moves: chain.moves,
            description: Description::default(),
            provenance: chain.provenance(),
        });
    }
    let part = SubProgress::new(progress, WHOLE * layers, total);
    let progress = if passes > 1 { &part as &dyn Progress } else { progress };
    Ok(Outcome { expected, ..store_all(derivations, target, how, progress)? })
}

/// Merges files into one. Files over other areas or with coarser cells are aligned with the finest.
/// They are opened with the output's [access](Output::access).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::{CombineOperation, CombineOptions, Output, WriteOptions, combine};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("nothing.goblin");
/// let map = "fixtures/v1/classes.goblin".into();
/// let trees = [map, "fixtures/v1/classes.goblin".into()];
/// let output = Output::create(&path)?;
/// let options = CombineOptions::default();
/// let changes = combine(CombineOperation::Changed, options, &trees, output, WriteOptions::new(64 << 20), &())?;
/// assert_eq!(changes.after, 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// Those of [`transform`]; also if types differ or grids cannot be matched.
pub fn combine(
    operation: impl Into<CombineOperation>,
    options: CombineOptions,
    paths: &[PathBuf],
    output: Output,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<Outcome> {
    combine_with(operation.into(), options, paths, &[], output.into(), how, progress)
}

/// Operand that is computed on the cells of the others, from the header and metadata of a tree on
/// these cells.
pub struct MadeOperand<'a> {
    /// Position among all operands, from 0.
    pub place: usize,
    /// Name, for the result's provenance.
    pub name: String,
    /// Function that makes the operand.
    pub make: &'a dyn Fn(&Header, &Metadata) -> Result<ViewSource>,
}

/// Does what [`combine`] does, also to a shard of a file, and also with trees that are computed on
/// the cells of the files' trees: on the finest of their grids, over the extent of all. At least
/// one file is required. Operands are in order of their positions.
///
/// # Errors
/// Those of [`combine`], and those of making trees.
pub fn combine_with(
    operation: CombineOperation,
    options: CombineOptions,
    paths: &[PathBuf],
    made: &[MadeOperand<'_>],
    target: TreeTarget,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let (mut derivations, mut conversions) = (Vec::new(), Vec::new());
    let access = target.access().clone();
    for paths in layers_in_pairs(paths, &access)? {
        let mut names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        let operands = open_all(&paths, &access)?;
        let are_bodies = operands.iter().all(|(_, view)| is_coverage(view));
        let needs = |number: usize| match operation.takes_values_of(number, are_bodies) {
            true => Needs::Values,
            false => Needs::Presence,
        };
        let reconciled = reconcile(operands, &needs, &options.reconcile, Target::default())?;
        reconciled.warn_resampled(progress);
        warn_full(operation, &reconciled.views, &names, progress)?;
        conversions.extend(reconciled.conversions);
        let (mut views, mut description) = (reconciled.views, reconciled.description);
        let (first, depth, extent) = (views[0].source(), views[0].depth(), views[0].extent());
        let shape = Shape { depth, ..first.header().shape };
        let header = Header { extent, shape, ..first.header().clone() };
        let metadata = views[0].metadata(false);
        for operand in made {
            let view = View::whole((operand.make)(&header, &metadata)?)?;
            description.operand += usize::from(operand.place <= description.operand);
            views.insert(operand.place.min(views.len()), view);
            names.insert(operand.place.min(names.len()), operand.name.clone());
        }
        // (Transparent cells count as VOID in all operations.)
        let views = views.into_iter().map(View::opaque).collect::<Result<Vec<_>>>()?;
        let keeps_first = operation.keeps_first(views[0].source().header().rule);
        let least = if keeps_first { expected_records(&views[0])? } else { 0 };
        derivations.push(Derivation {
            least,
            views,
            operation,
            fill: options.fill,
            universe: options.universe,
            moves: false,
            description,
            provenance: format!("{operation} of {}", names.join(" ")),
        });
    }
    Ok(Outcome { conversions, ..store_all(derivations, target, how, progress)? })
}

/// Groups the layers of files that are combined with each other: in files of several layers those
/// of the same name. A layer that a path names, or a file's only layer, is combined with each.
fn layers_in_pairs(paths: &[PathBuf], access: &FileAccess) -> Result<Vec<Vec<PathBuf>>> {
    let mut layers = paths.iter().map(|path| layer_paths(path, access)).collect::<Result<Vec<_>>>()?;
    let name = |path: &PathBuf| FileReference::of(path).layer;
    let Some(most) = layers.iter().find(|layers| layers.len() > 1) else {
        return Ok(vec![layers.into_iter().flatten().collect()]);
    };
    let names: Vec<Option<String>> = most.iter().map(name).collect();
    for (path, layers) in paths.iter().zip(&mut layers) {
        if let [only] = &layers[..] {
            *layers = vec![only.clone(); names.len()];
        } else if layers.iter().map(name).ne(names.iter().cloned()) {
            let advice = "name one layer of each file, as in FILE:LAYER";
            return Err(Error::unsupported(path, "a file with other layers than the first file", advice));
        }
    }
    Ok((0..names.len()).map(|number| layers.iter().map(|layers| layers[number].clone()).collect()).collect())
}

/// Writes a file from trees, each of which becomes a layer.
fn store_all(
    derivations: Vec<Derivation>,
    target: TreeTarget,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<Outcome> {
    if let Some(output) = target.whole() {
        let least = derivations.iter().map(|derivation| (derivation.form(), derivation.least));
        least.into_iter().try_for_each(|(form, least)| check_space(output, form, false, least))?;
    }
    let depth = derivations.iter().map(Derivation::depth).max().unwrap_or(0);
    let dimension = derivations[0].form().dimension;
    let prepared = derivations.into_iter().map(|derivation| derivation.prepare(progress));
    let prepared = prepared.collect::<Result<Vec<_>>>()?;
    let depth = prepared.iter().map(|prepared| prepared.depth).max().unwrap_or(depth);
    let mut writer = target.start((dimension, depth), prepared.len() as u32)?;
    let mut outcomes = Vec::with_capacity(prepared.len());
    for prepared in prepared {
        outcomes.push(prepared.store(&mut writer, how, progress)?);
    }
    writer.finish()?;
    let finest = outcomes.iter().position(|outcome| outcome.depth == depth).unwrap_or(0);
    let mut all = outcomes[finest].clone();
    all.after = outcomes.iter().map(|outcome| outcome.after).sum();
    for (index, before) in all.before.iter_mut().enumerate() {
        *before = outcomes.iter().map(|outcome| outcome.before[index]).sum();
    }
    Ok(all)
}

/// Counts the pairs of values of two files, with classes numbered as in the first: see
/// [`crosstab`]. Also returns the conversions.
///
/// # Errors
/// Those of [`combine`]; also if there are too many pairs.
pub fn crosstab_files(
    first: &Path,
    second: &Path,
    options: &ReconcileOptions,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<(Vec<PairOfSamples>, Vec<Conversion>)> {
    let operands = open_all(&[first.into(), second.into()], access)?;
    let reconciled = reconcile(operands, &|_| Needs::OwnValues, options, Target::default())?;
    reconciled.warn_resampled(progress);
    let [first, second] = &reconciled.views[..] else { unreachable!("two operands are two views") };
    let samples =
        |view: &View, value: Option<Value>| value.map(|value| view.form().value.numbers(value).to_vec());
    let pairs = crosstab(first, second, progress)?;
    let shown = |pair: Pair| (samples(first, pair.first), samples(second, pair.second), pair.cells);
    Ok((pairs.into_iter().map(shown).collect(), reconciled.conversions))
}

/// Views of whole files, with their names.
fn open_all(paths: &[PathBuf], access: &FileAccess) -> Result<Vec<(String, View)>> {
    let open = |path: &PathBuf| {
        let file = TreeFile::open_only(path, &access.into())?;
        Ok((path.display().to_string(), View::whole(file.into())?))
    };
    paths.iter().map(open).collect()
}

/// Warns about operands of a set operation that have no VOID, so that all of their cells are
/// present, if that is probably not intended.
fn warn_full(
    operation: CombineOperation,
    views: &[View],
    names: &[String],
    progress: &dyn Progress,
) -> Result<()> {
    if !matches!(operation, CombineOperation::Set { .. }) || views.len() < 2 {
        return Ok(());
    }
    for (number, (view, name)) in views.iter().zip(names).enumerate() {
        let source = view.source();
        let is_meant = number == 0 && source.header().kind != DataKind::Categorical;
        if is_meant || is_coverage(view) && source.file().is_none() {
            continue;
        }
        if let Some(text) = void_advice(name, source)? {
            progress.warn(Path::new(name), &text);
        }
    }
    Ok(())
}

/// Advice on a tree without VOID in which 0 may mean no data: the command that makes it VOID.
/// `None` if some cells are VOID, none is 0, or cells are computed, so that this is unknown in
/// advance.
pub(crate) fn void_advice(name: &str, source: &ViewSource) -> Result<Option<String>> {
    if source.is_computed() {
        return Ok(None);
    }
    let totals = source.totals(None)?;
    let is_full = totals.cells > 0 && totals.void_cells == 0;
    let has_zero = totals.channels.first().is_some_and(|channel| channel.min == Number::from(0));
    Ok((is_full && has_zero).then(|| {
        let stem = FileReference::of(Path::new(name)).file.with_extension("");
        format!(
            "has no VOID cells: all of its cells have a value; if 0 means no data: `spinney transform {name} void=0 -o {}_0.goblin`",
            stem.display()
        )
    }))
}

/// Whether cells of a view store coverage: the fraction that solids fill.
fn is_coverage(view: &View) -> bool {
    super::coverage::full(view.form(), view.source().header().rule).is_some()
}

/// Approximate number of INNER nodes in a view of a whole file: that of the file, divided by the
/// cell size in cells of the file.
fn expected_records(view: &View) -> Result<u64> {
    let cells = view.to_source().determinant().abs().max(1.0);
    Ok((view.source().shared_records()? as f64 / cells) as u64)
}

/// Numbers separated by commas.
fn list(numbers: &[u64]) -> String {
    numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(",")
}

/// Tree to derive from views, with the header and metadata of the first view's file.
struct Derivation {
    views: Vec<View>,
    operation: CombineOperation,
    /// Value of cells that the operation fills.
    fill: Option<Number>,
    /// Region in which it fills cells.
    universe: Universe,
    /// See [`FileView::moves`].
    moves: bool,
    /// Approximate minimum number of INNER nodes in the result, as far as is known.
    least: u64,
    /// Meaning of the values.
    description: Description,
    /// Line to add to the first file's provenance.
    provenance: String,
}

/// Tree that is ready to be written.
struct Prepared {
    source: Combined,
    header: Header,
    depth: u8,
    extent: [u64; 3],
    metadata: Metadata,
    before: Vec<u64>,
    universe: Option<Bounds>,
}

impl Derivation {
    fn form(&self) -> TreeType {
        self.views[0].form()
    }

    fn depth(&self) -> u8 {
        self.views.iter().map(View::depth).max().unwrap_or(0)
    }

    fn prepare(self, progress: &dyn Progress) -> Result<Prepared> {
        let (views, universe) = match self.operation.needs_universe() {
            true => self.universe.around(self.views).map(|(views, universe)| (views, Some(universe)))?,
            false => (self.views, None),
        };
        views.iter().for_each(|view| view.source().report_remark(progress));
        let (first, described) = (&views[0], &views[self.description.operand]);
        let (header, extent) = (self.description.header(described.source().header()), first.extent());
        let depth = views.iter().map(View::depth).max().unwrap_or(0);
        let mut metadata = Metadata { frame: first.frame(self.moves), ..described.metadata(self.moves) };
        self.description.describe(&mut metadata);
        metadata.provenance.push(match &universe {
            Some(universe) => {
                let [first, size] =
                    [universe.min, universe.size()].map(|cells| list(&cells[..header.form.axes()]));
                format!("{}, in a universe of {size} cells from {first}", self.provenance)
            }
            None => self.provenance,
        });
        // (Of a tree on another grid, cells are counted in its source.)
        let before: Result<Vec<u64>> = views.iter().map(|view| view.source().cells_before()).collect();
        let before = before?;
        let mut source = Combined::new(views, self.operation, extent)?;
        if let Some(universe) = universe {
            source = source.within(universe);
        }
        if let Some(fill) = self.fill {
            let value_type = header.form.value;
            source = source.filled_with(value_type.splat(fill).ok_or_else(|| {
                let expected = format!("a number that {value_type} can store");
                Error::invalid("fill value", fill.to_string(), expected)
            })?)?;
        }
        Ok(Prepared { source, header, depth, extent, metadata, before, universe })
    }
}

impl Prepared {
    fn store(self, writer: &mut TreeWriter, how: WriteOptions, progress: &dyn Progress) -> Result<Outcome> {
        let Prepared { source, header, depth, extent, metadata, before, universe } = self;
        let options = BuildOptions { depth, metadata, ..BuildOptions::written_like(&header, how) };
        let tally = writer.source(&source, extent, &options, progress)?;
        Ok(Outcome {
            extent,
            depth,
            before,
            after: tally.cells,
            expected: None,
            universe,
            conversions: Vec::new(),
        })
    }
}
