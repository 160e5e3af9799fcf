//! `spinney edit`: changes an Autumnal file, or an exact model.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use clap::Subcommand;
use spinney::edit::{Edit, Editor, FillRegion};
use spinney::import::raster::ImportOptions;
use spinney::query::Polygon;
use spinney::raw::import::cells::CellList;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::rasterize::Overlaps;
use spinney::raw::io::without_query;
use spinney::raw::ops::{Prefer, add_layer, apply_edits, drop_layer, only_layer};
use spinney::raw::store::{FileReference, TreeFormat, file_is_tree};
use spinney::{
    Bounds, CellLocator, Code, CombineOperation, Coordinates, Dataset, FileAccess, FileView, Number,
    SetOperation, ViewOperation,
};

use super::args::{
    CommitOptions, EditOptions, MeaningArgs, OperationName, Packing, PartOptions, class_value, numbers,
    parse_operation, parse_step, same_file,
};
use super::exact::EulerChange;
use super::features::{FeatureCells, FeatureTerms, check_features, feature_value};
use super::report::Work;
use super::report::commit::report_commit;
use super::{Global, open};

/// Edit an Autumnal file: each edit adds a commit and keeps the old ones
///
/// Commands that write trees make an Autumnal file if the output's name ends with .autumn. Time and
/// space are proportional to the change. Other processes can read the file meanwhile: they see the
/// last commit. One process at a time can edit it.
///
/// An exact model is changed by Euler operators, and rewritten.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file; add-layer and drop-layer also accept Goblin files, which are rewritten,
    /// and euler needs an exact model
    file: PathBuf,
    #[command(subcommand)]
    change: Change,
}

const EXAMPLES: &str = "\
Examples:
  spinney edit map.autumn fill --in world --window 5,44,17,48 --value 3 -m 'Alps are mountains'
  spinney edit map.autumn fill --zones lakes.gpkg --where 'area>=1e6' --value 80
  spinney edit map.autumn paste survey.tif --author Ann
  spinney edit map.autumn paste tile.goblin --at 4096,512
  spinney edit map.autumn set cells.csv
  spinney edit part.autumn apply a-b drill.goblin
  spinney edit stack.autumn:B08 fill --window 0,0,64,64 --void
  spinney edit stack.goblin add-layer ndvi.goblin
  spinney edit part.goblin euler 'mev v7 v8 e12 5 5 20; mef v8:e12 v3 e13 f6'
  spinney log map.autumn
  spinney revert map.autumn 3";

/// Changes. A new one is a variant here and an arm in [`run`] and in [`Change::edits`].
#[derive(Subcommand)]
enum Change {
    Paste(Paste),
    Fill(Box<Fill>),
    Set(Set),
    Apply(Apply),
    AddLayer(AddLayer),
    DropLayer(DropLayer),
    Euler(EulerChange),
}

/// Paste another tree or a raster over a region
#[derive(clap::Args)]
struct Paste {
    /// Tree or raster file, of the same kind of values
    patch: PathBuf,
    /// At which cell its first cell is pasted [default: by its world coordinates]
    #[arg(long, value_name = "COL,ROW[,Z]", value_parser = parse_cell)]
    at: Option<[i64; 3]>,
    /// View the file through an operation of `transform`, such as rotate=30; repeatable
    #[arg(long = "view", value_name = "OPERATION", value_parser = parse_step)]
    steps: Vec<ViewOperation>,
    /// Make cells VOID where the patch is VOID, within its extent
    #[arg(long)]
    void: bool,
    /// Round numbers that the tree's type cannot hold
    #[arg(long)]
    round: bool,
    #[command(flatten)]
    meaning: MeaningArgs,
    #[command(flatten)]
    options: EditOptions,
}

/// Fill a region with a value, or make it VOID
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true))]
struct Fill {
    #[command(flatten)]
    part: PartOptions,
    /// Polygon, in world coordinates or those of --in: vertices X,Y separated by blanks, rings by
    /// semicolons; holes are rings, too
    #[arg(long, value_name = "X,Y X,Y ...", conflicts_with = "window")]
    polygon: Option<String>,
    /// A node by its FD code, such as /031
    #[arg(long, value_name = "CODE", conflicts_with_all = ["window", "polygon"])]
    block: Option<String>,
    /// Polygons in a feature file (also lines and points) whose cells are filled: GeoJSON,
    /// FlatGeobuf, GeoPackage (x.gpkg:NAME for one layer of several), a shapefile or a table; in an
    /// octree, columns of cells
    #[arg(long, value_name = "FEATURES", conflicts_with_all = ["window", "polygon", "block"])]
    zones: Option<PathBuf>,
    #[command(flatten)]
    features: FeatureCells,
    /// Value of cells where features overlap: last, first, min, max, sum, count or mean [default:
    /// last]
    #[arg(long, value_name = "RULE", requires = "zones")]
    overlaps: Option<Overlaps>,
    /// Value that all cells get: one number, or one for each channel, or the name of a class; with
    /// --zones a number, or an attribute, whose strings are names of the tree's classes
    #[arg(long, value_name = "NUMBER,...|ATTRIBUTE", value_delimiter = ',')]
    #[arg(allow_hyphen_values = true, group = "what")]
    value: Option<Vec<String>>,
    /// Make cells VOID instead of giving them a value
    #[arg(long, group = "what")]
    void: bool,
    #[command(flatten)]
    options: EditOptions,
}

/// Set single cells from a list
#[derive(clap::Args)]
struct Set {
    /// Lines `X,Y,VALUE` or `X,Y,void` (octrees: X,Y,Z first), or a NumPy array with such rows; -
    /// is standard input
    cells: PathBuf,
    #[command(flatten)]
    options: EditOptions,
}

/// Apply an operation of `combine` with another tree, at its world coordinates
#[derive(clap::Args)]
struct Apply {
    /// Operation, as in `spinney combine`: union, a-b, min, ...; A is the file
    #[arg(value_parser = parse_operation)]
    operation: OperationName,
    /// The other tree file, or a feature file, whose features cover the cells with centres inside
    other: PathBuf,
    /// Round numbers that the tree's type cannot hold
    #[arg(long)]
    round: bool,
    #[command(flatten)]
    meaning: MeaningArgs,
    #[command(flatten)]
    options: EditOptions,
}

/// Add a tree as a layer; its cells are 1, 2, 4 ... times as wide as the file's
#[derive(clap::Args)]
struct AddLayer {
    /// Tree file whose cells become the layer
    tree: PathBuf,
    /// Name of the layer [default: that of the tree's layer, or of its file]
    name: Option<String>,
    /// View the file through an operation of `transform`, such as rotate=30; repeatable
    #[arg(long = "view", value_name = "OPERATION", value_parser = parse_step)]
    steps: Vec<ViewOperation>,
    #[command(flatten)]
    packing: Packing,
    #[command(flatten)]
    options: EditOptions,
}

/// Remove a layer from the file
#[derive(clap::Args)]
struct DropLayer {
    /// The layer, by its name or its number from 0
    name: String,
    #[command(flatten)]
    options: CommitOptions,
}

/// Adds or drops a layer.
fn change_layers(file: &Path, change: &Change, global: &Global) -> Result<()> {
    let work = Work::start(global, "cells")?;
    let commit = match change {
        Change::AddLayer(AddLayer { tree, name, steps, packing, options }) => {
            let reference = FileReference::of(tree);
            let stem =
                without_query(&reference.file).file_stem().map(|stem| stem.to_string_lossy().into_owned());
            let name = name.clone().or(reference.layer.clone()).or(stem).unwrap_or_default();
            let chain =
                FileView { steps: steps.clone(), access: global.access().clone(), ..FileView::of(tree) };
            only_layer(tree, global.access())?;
            let note = options.commit.note(format!("Add layer {name} of {}", tree.display()));
            add_layer(file, &name, &chain, note, packing.with(options.memory), &work)?
        }
        Change::DropLayer(DropLayer { name, options }) => {
            let note = options.note(format!("Drop layer {name}"));
            drop_layer(file, name, note, global.access(), &work)?
        }
        _ => None,
    };
    work.finish();
    match (&commit, open(file, global.access())?.format()) {
        (None, TreeFormat::Goblin) => global.report("output", format_args!("{}", file.display())),
        _ => report_commit(global, commit.as_ref()),
    }
    Ok(())
}

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    let Args { file, change } = args;
    let options = match &change {
        Change::Fill(fill) => &fill.options,
        Change::Paste(Paste { options, .. }) => options,
        Change::Set(Set { options, .. }) | Change::Apply(Apply { options, .. }) => options,
        Change::AddLayer(_) | Change::DropLayer(_) => return change_layers(&file, &change, global),
        Change::Euler(change) => return change.run(&file, global),
    };
    only_layer(&file, global.access())?;
    let (options, memory) = (options.commit.clone(), options.memory.bytes);
    ensure!(
        change.other().is_none_or(|other| !same_file(other, &file)),
        "{}: is both the edited file and the other one; use one of its commits as the other, such as {}@1",
        file.display(),
        file.display()
    );
    let work = Work::start(global, "cells")?;
    // A raster becomes a tree before the file is locked: other processes can edit it meanwhile.
    let pasted = match &change {
        Change::Paste(paste) if !file_is_tree(&paste.patch, global.access())? => {
            Some(PastedRaster::import(&paste.patch, &file, memory, global.access(), &work)?)
        }
        _ => None,
    };
    let patch = change.other().map(Path::to_path_buf);
    let mut editor = Editor::open_with(&file, memory, global.access())?;
    let tree = Dataset::of(editor.tree().into())?;
    let (mut edits, message) = change.edits(&tree, pasted.as_ref(), memory, &work)?;
    drop(tree);
    let note = options.note(message);
    let applied = apply_edits(&mut editor, &mut edits, &work);
    let conversions = match (&pasted, &patch) {
        (Some(pasted), Some(patch)) => applied.map_err(|error| pasted.with_raster_name(error, patch))?,
        _ => applied?,
    };
    let commit = editor.commit(note)?;
    work.finish();
    global.report_conversions(&conversions);
    report_commit(global, commit.as_ref());
    Ok(())
}

/// A sequence of changes.
type Edits = Box<dyn Iterator<Item = spinney::Result<Edit>>>;

impl Change {
    /// Returns the path of the other tree, if there is one.
    fn other(&self) -> Option<&Path> {
        match self {
            Change::Paste(paste) => Some(&paste.patch),
            Change::Apply(apply) => Some(&apply.other),
            Change::AddLayer(change) => Some(&change.tree),
            Change::Fill(_) | Change::Set(_) | Change::DropLayer(_) | Change::Euler(_) => None,
        }
    }

    /// Returns changes to a tree, and a message about them. `pasted` is a raster to be pasted,
    /// already imported.
    fn edits(
        self,
        tree: &Dataset,
        pasted: Option<&PastedRaster>,
        memory: u64,
        work: &Work,
    ) -> Result<(Edits, String)> {
        let (edit, message) = match self {
            Change::Paste(Paste { patch, at, steps, void, round, meaning, .. }) => {
                let path = pasted.map_or(patch.as_path(), |pasted| &pasted.tree);
                let name = pasted.map(|_| patch.clone());
                let chain = FileView { name, steps, access: tree.access(), ..FileView::of(path) };
                let options = meaning.options(None, round);
                (Edit::Paste { patch: chain, at, void, options }, format!("Paste {}", patch.display()))
            }
            Change::Fill(fill) if fill.zones.is_some() => fill.features(tree, memory, work)?,
            Change::Fill(fill) => {
                fill.features.refuse("works only with --zones")?;
                let (regions, name) = fill.regions(tree)?;
                let value = fill.value.as_ref().map(|value_strings| {
                    value_strings.iter().map(|text| class_value(tree, "--value", text)).collect()
                });
                let value: Option<Vec<Number>> = value.transpose()?;
                let what = value.as_ref().map_or("VOID".into(), |value| {
                    value.iter().map(Number::to_string).collect::<Vec<_>>().join(",")
                });
                let edits = regions.into_iter().map(move |region| Ok(Edit::Fill(region, value.clone())));
                return Ok((Box::new(edits), format!("Fill {name} with {what}")));
            }
            Change::Set(Set { cells, .. }) => {
                let batches = CellList::open(&cells, tree.header())?;
                let edits = batches.map(|batch| batch.map(Edit::Set));
                return Ok((Box::new(edits), format!("Set cells of {}", cells.display())));
            }
            Change::Apply(Apply { operation: name, other, round, meaning, .. }) => {
                let operation = name.operation(Prefer::First);
                let operation = operation.with_context(|| {
                    format!("{}: prints a table, expected an operation that makes a tree", name.0)
                })?;
                let message = format!("Apply {} of {}", name.0, other.display());
                if is_feature_file(&other) {
                    let given = meaning.given().into_iter().chain([("--round", round)]);
                    let given = given.into_iter().find(|(_, is_given)| *is_given);
                    ensure!(
                        given.is_none(),
                        "{}: has no effect on features",
                        given.map_or("", |(option, _)| option)
                    );
                    let how =
                        FeatureTerms { memory, warns_of_cells_outside: true, ..FeatureTerms::default() };
                    let ground = (tree.header(), tree.metadata());
                    let cells = FeatureCells::default();
                    let (features, _) = cells.over(std::slice::from_ref(&other), ground, &how, work)?;
                    let edit = Edit::Merge(operation, Arc::new(features));
                    return Ok((Box::new(std::iter::once(Ok(edit))), message));
                }
                (Edit::Apply(operation, other, meaning.options(None, round)), message)
            }
            Change::AddLayer(_) | Change::DropLayer(_) | Change::Euler(_) => {
                unreachable!("layers and exact models are changed as a whole")
            }
        };
        Ok((Box::new(std::iter::once(Ok(edit))), message))
    }
}

/// A raster as a tree that can be pasted, in a temporary directory that is removed on drop.
struct PastedRaster {
    tree: PathBuf,
    _directory: tempfile::TempDir,
}

impl PastedRaster {
    /// Replaces the tree's path in an error by that of the raster.
    fn with_raster_name(&self, error: spinney::Error, pasted: &Path) -> anyhow::Error {
        let (text, name) = (error.to_string(), self.tree.display().to_string());
        match text.contains(&name) {
            true => anyhow::anyhow!(text.replace(&name, &pasted.display().to_string())),
            false => error.into(),
        }
    }

    /// Imports a raster as a tree of the same kind as that of a file.
    fn import(
        path: &Path,
        file: &Path,
        memory: u64,
        access: &FileAccess,
        work: &Work,
    ) -> Result<PastedRaster> {
        let like = open(file, access)?;
        let header = like.header();
        ensure!(
            header.form.axes() == 2,
            "{}: is not a tree file; rasters cannot be pasted into octrees",
            path.display()
        );
        let mut options = ImportOptions::new();
        options.access = access.clone();
        options.kind = Some(header.kind);
        options.rule = Some(header.rule);
        options.memory = Some(memory);
        let directory_of_file = file.parent().filter(|directory| !directory.as_os_str().is_empty());
        let directory = tempfile::Builder::new()
            .prefix("spinney-")
            .tempdir_in(directory_of_file.unwrap_or(Path::new(".")))?;
        let tree = directory.path().join("patch.goblin");
        spinney::import::raster::plan(&[path.to_path_buf()], &options)?.build(access.create(&tree)?, work)?;
        Ok(PastedRaster { tree, _directory: directory })
    }
}

impl Fill {
    /// Returns the change to the cells of features, and a message about it.
    fn features(self, tree: &Dataset, memory: u64, work: &Work) -> Result<(Edit, String)> {
        let file = self.zones.context("--zones: expected a feature file")?;
        check_features(&file, "--zones")?;
        let value = self.value.as_deref().map(feature_value).transpose()?;
        let what = self.value.map_or("VOID".into(), |value_strings| value_strings.join(","));
        let how = FeatureTerms {
            value,
            overlaps: self.overlaps.unwrap_or_default(),
            coordinates: self.part.coordinates().given().cloned(),
            memory,
            warns_of_cells_outside: false,
        };
        let ground = (tree.header(), tree.metadata());
        let (zones, _) = self.features.over(std::slice::from_ref(&file), ground, &how, work)?;
        let zones = Arc::new(zones);
        let message = format!("Fill {} with {what}", file.display());
        let difference = CombineOperation::set(SetOperation::Difference);
        Ok((if self.void { Edit::Merge(difference, zones) } else { Edit::Cover(zones) }, message))
    }

    /// Returns the regions, and their description.
    fn regions(&self, tree: &Dataset) -> Result<(Vec<FillRegion>, String)> {
        let header = tree.header();
        if let Some(text) = &self.polygon {
            return Ok((vec![FillRegion::Polygon(self.polygon(text, tree)?)], "a polygon".into()));
        }
        if let Some(text) = &self.block {
            let code = Code::parse(header.form.dimension, text).ok();
            let Some(code) = code.filter(|code| code.level() <= tree.depth()) else {
                bail!("--block: got {text}, expected a node of this tree: `/` and a digit per level");
            };
            return Ok((vec![FillRegion::Box(code.bounds(tree.depth()))], format!("block {text}")));
        }
        let Some(boxes) = self.part.boxes(tree)? else {
            bail!("fill: expected a region: --window, --polygon, --block or --zones");
        };
        let size = |bounds: &Bounds| {
            let size: Vec<String> = bounds.size()[..header.form.axes()].iter().map(u64::to_string).collect();
            size.join(" x ")
        };
        let sizes: Vec<String> = boxes.iter().map(size).collect();
        let name = format!("a box of {} cells", sizes.join(" and "));
        Ok((boxes.into_iter().map(FillRegion::Box).collect(), name))
    }

    /// Parses rings of vertices as a polygon, in cells.
    fn polygon(&self, text: &str, tree: &Dataset) -> Result<Polygon> {
        let vertex = |text: &str| -> Result<[f64; 2]> {
            let numbers = text.split_once(',').map(|(x, y)| (x.trim().parse(), y.trim().parse()));
            let Some((Ok(x), Ok(y))) = numbers else {
                bail!("--polygon: got `{text}`, expected a vertex X,Y")
            };
            Ok([x, y])
        };
        let rings =
            text.split(';').map(|ring| ring.split_whitespace().map(vertex).collect::<Result<Vec<_>>>());
        let rings = rings.collect::<Result<Vec<_>>>()?;
        Polygon::new(&rings)?;
        let coordinates = self.part.coordinates();
        let locator = coordinates.locator(tree, Coordinates::World)?;
        let rings = [rings];
        let parts = locator.parts(&rings);
        let extent = tree.header().extent;
        if !reaches(&parts, extent) {
            let used = coordinates.given().unwrap_or(&Coordinates::World);
            let others = [
                ("world", Coordinates::World),
                ("cells", Coordinates::Cells),
                ("lonlat", Coordinates::LONLAT),
            ];
            let fits = |coordinates: &Coordinates| {
                let locator = CellLocator::new(coordinates, &tree.metadata().frame, extent);
                coordinates != used && locator.is_ok_and(|locator| reaches(&locator.parts(&rings), extent))
            };
            let other = others.into_iter().find(|(_, coordinates)| fits(coordinates));
            let advice = other.map_or(String::new(), |(name, _)| format!("; it is inside with --in {name}"));
            bail!("--polygon: is outside of the raster, which is {}{advice}", locator.bounds_text());
        }
        // (Rings are combined by the even-odd rule, whichever part they come from.)
        Ok(Polygon::new(&parts.concat())?)
    }
}

/// Whether the bounding box of a polygon in cell coordinates overlaps a tree with this extent.
fn reaches(parts: &[Vec<Vec<[f64; 2]>>], extent: [u64; 3]) -> bool {
    (0..2).all(|axis| {
        let numbers = || parts.iter().flatten().flatten().map(|vertex| vertex[axis]);
        let (low, high) =
            (numbers().fold(f64::INFINITY, f64::min), numbers().fold(f64::NEG_INFINITY, f64::max));
        low < extent[axis] as f64 && high > 0.0
    })
}

/// Parses two or three integers.
fn parse_cell(text: &str) -> Result<[i64; 3], String> {
    let cell = numbers(text).or_else(|| numbers(text).map(|[x, y]: [i64; 2]| [x, y, 0]));
    cell.ok_or_else(|| "expected an integer cell: COL,ROW or X,Y,Z".into())
}
