//! `spinney edit`: changes to an Autumnal file.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use clap::Subcommand;
use spinney::import::cells::CellList;
use spinney::import::raster::{self, ImportOptions};
use spinney::ops::{Chain, Edit, FillRegion, Polygon, Step, edit};
use spinney::dataset::Dataset;
use spinney::space::Code;
use spinney::io::Output;
use spinney::store::file_is_tree;

use super::history::{self, Told};
use super::place::Part;
use super::progress::Work;
use super::viewed::step;
use super::{Global, Result, combine, open};

/// Change a tree in place: a commit more, and the old ones stay.
///
/// FILE is an Autumnal file; `spinney build` and all other programs that make trees make one when the output's name ends
/// with .autumn. Time and room are proportional to what changes. Others can read the file meanwhile: they see the last
/// commit. One process at a time can edit it.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file
    file: PathBuf,
    #[command(subcommand)]
    change: Change,
}

const EXAMPLES: &str = "\
Examples:
  spinney edit map.autumn fill --bbox 5,44,17,48 --value 3 -m 'Alps are mountains'
  spinney edit map.autumn paste survey.tif --where-valid --author Ann
  spinney edit map.autumn paste tile.goblin --at 4096,512
  spinney edit map.autumn set cells.csv
  spinney edit part.autumn apply a-b drill.goblin
  spinney log map.autumn
  spinney revert map.autumn 3";

/// A new kind of change is a line here and one in [`Change::edits`].
#[derive(Subcommand)]
enum Change {
    Paste(Paste),
    Fill(Fill),
    Set(Set),
    Apply(Apply),
}

/// Put another tree or a picture over a part of it
#[derive(clap::Args)]
struct Paste {
    /// Tree file or picture, of the same kind of values
    patch: PathBuf,
    /// The cell that its first one goes to [default: where it lies in the world]
    #[arg(long, value_name = "COL,ROW[,Z]", value_parser = cell, allow_hyphen_values = true)]
    at: Option<[i64; 3]>,
    /// Look at it through a step of `transform`, such as rotate=30; may be given several times
    #[arg(long = "view", value_name = "STEP", value_parser = step)]
    steps: Vec<Step>,
    /// Leave the tree as it is where the patch is VOID
    #[arg(long)]
    where_valid: bool,
    #[command(flatten)]
    told: Told,
}

/// Give a region one value, or make it VOID
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true))]
struct Fill {
    #[command(flatten)]
    part: Part,
    /// Box of an octree's cells: corner and edges
    #[arg(long = "box", value_name = "X,Y,Z,W,H,D", value_parser = super::slice::parse_box, conflicts_with_all = ["window", "bbox"])]
    cuboid: Option<[f64; 6]>,
    /// Polygon, in world coordinates: corners X,Y with blanks between, rings with semicolons; a hole is a ring, too
    #[arg(long, value_name = "X,Y X,Y ...", allow_hyphen_values = true, conflicts_with_all = ["window", "bbox", "cuboid"])]
    polygon: Option<String>,
    /// A node by its FD code, such as /031
    #[arg(long, value_name = "CODE", conflicts_with_all = ["window", "bbox", "cuboid", "polygon"])]
    block: Option<String>,
    /// The value: one number, or one for each channel
    #[arg(
        long,
        value_name = "NUMBER,...",
        value_delimiter = ',',
        allow_negative_numbers = true,
        group = "what"
    )]
    value: Option<Vec<f64>>,
    /// Nothing is there any more
    #[arg(long, group = "what")]
    void: bool,
    #[command(flatten)]
    told: Told,
}

/// Give many single cells new values
#[derive(clap::Args)]
struct Set {
    /// Lines `X,Y,VALUE` or `X,Y,void` (octrees: X,Y,Z first), or a NumPy array with such rows; - is standard input
    cells: PathBuf,
    #[command(flatten)]
    told: Told,
}

/// Do a set operation with another tree, which lies where it lies in the world
#[derive(clap::Args)]
struct Apply {
    /// What to do, as in `spinney combine`: union, a-b, min, ...; A is the file
    #[arg(value_parser = combine::known)]
    operation: String,
    /// The other tree file
    other: PathBuf,
    #[command(flatten)]
    told: Told,
}

pub(crate) fn run(args: Args, global: &Global) -> Result {
    let Args { file, change } = args;
    let told = match &change {
        Change::Paste(Paste { told, .. }) | Change::Fill(Fill { told, .. }) => told.clone(),
        Change::Set(Set { told, .. }) | Change::Apply(Apply { told, .. }) => told.clone(),
    };
    ensure!(
        change.other().is_none_or(|other| !same_file(other, &file)),
        "{}: is edited and pasted; name a commit, as in {}@1",
        file.display(),
        file.display()
    );
    let work = Work::start(global, "cells")?;
    let (edits, _patch) = change.edits(&file, told.memory, &work)?;
    let note = told.note(edits.1);
    let commit = edit(&file, edits.0, note, told.memory, &work)?;
    work.finish();
    history::tell_commit(global, commit.as_ref());
    Ok(())
}

/// Whether both are the newest commit of one file.
fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Changes, one after the other, and a message about them; a file that must stay until they are done.
type Edits = ((Box<dyn Iterator<Item = spinney::Result<Edit>>>, String), Option<tempfile::TempDir>);

impl Change {
    fn other(&self) -> Option<&Path> {
        match self {
            Change::Paste(paste) => Some(&paste.patch),
            Change::Apply(apply) => Some(&apply.other),
            _ => None,
        }
    }

    fn edits(self, file: &Path, memory: u64, work: &Work) -> Result<Edits> {
        let one = |edit, message: String| -> Result<Edits> {
            Ok(((Box::new(std::iter::once(Ok(edit))), message), None))
        };
        match self {
            Change::Paste(Paste { patch, at, steps, where_valid, .. }) => {
                let message = format!("Paste {}", patch.display());
                let (path, folder) =
                    if file_is_tree(&patch) { (patch, None) } else { picture(&patch, file, memory, work)? };
                let patch = Chain { steps, ..Chain::of(&path) };
                let edit = Edit::Paste { patch, at, where_valid };
                Ok(((Box::new(std::iter::once(Ok(edit))), message), folder))
            }
            Change::Fill(fill) => {
                let tree = open(file)?;
                let (region, name) = fill.region(&tree)?;
                let value = fill.value.filter(|_| !fill.void);
                let what = value.as_ref().map_or("VOID".into(), |value| format!("{value:?}"));
                one(Edit::Fill(region, value), format!("Fill {name} with {what}"))
            }
            Change::Set(Set { cells, .. }) => {
                let list = CellList::open(&cells, open(file)?.header())?;
                let edits = list.map(|batch| batch.map(Edit::Set));
                Ok(((Box::new(edits), format!("Set cells of {}", cells.display())), None))
            }
            Change::Apply(Apply { operation: name, other, .. }) => {
                let operation = combine::operation(&name, 2, spinney::ops::Prefer::First);
                let operation =
                    operation.with_context(|| format!("{name}: no operation that makes a tree"))?;
                let message = format!("Apply {name} of {}", other.display());
                one(Edit::Apply(operation, other), message)
            }
        }
    }
}

/// A picture as a tree that can be pasted.
fn picture(
    path: &Path,
    file: &Path,
    memory: u64,
    work: &Work,
) -> Result<(PathBuf, Option<tempfile::TempDir>)> {
    let tree = open(file)?;
    let header = tree.header();
    ensure!(
        header.form.axes() == 2,
        "{}: is no tree file, and pictures cannot be pasted into octrees",
        path.display()
    );
    let options = ImportOptions {
        kind: Some(header.kind),
        rule: Some(header.rule),
        memory: Some(memory),
        ..ImportOptions::default()
    };
    let folder = tempfile::Builder::new().prefix("spinney-").tempdir_in(
        file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")),
    )?;
    let patch = folder.path().join("patch.goblin");
    raster::plan(&[path.to_path_buf()], &options)?.build(Output::create(&patch)?, work)?;
    Ok((patch, Some(folder)))
}

impl Fill {
    /// The region, and what to call it.
    fn region(&self, tree: &Dataset) -> Result<(FillRegion, String)> {
        let header = tree.header();
        if let Some(text) = &self.polygon {
            return Ok((FillRegion::Polygon(polygon(text, tree)?), "a polygon".into()));
        }
        if let Some(text) = &self.block {
            let code = Code::parse(header.form.dimension, text).ok();
            let Some(code) = code.filter(|code| code.level() <= tree.depth()) else {
                bail!("--block: {text} is no node of this tree; give `/` and a digit per level");
            };
            return Ok((FillRegion::Box(code.bounds(tree.depth())), format!("block {text}")));
        }
        let bounds = match self.cuboid {
            Some(_) => super::slice::box_cells(tree, self.cuboid, tree.depth(), false)?,
            None => match self.part.bounds(tree)? {
                Some(bounds) => bounds,
                None => bail!("fill what? Give --window, --bbox, --box, --polygon or --block"),
            },
        };
        let size = bounds.size();
        let size: Vec<String> = size[..header.form.axes()].iter().map(u64::to_string).collect();
        Ok((FillRegion::Box(bounds), format!("a box of {} cells", size.join(" x "))))
    }
}

/// A polygon of corners in the world, in cells.
fn polygon(text: &str, tree: &Dataset) -> Result<Polygon> {
    let corner = |text: &str| -> Result<[f64; 2]> {
        let numbers = text.split_once(',').map(|(x, y)| (x.trim().parse(), y.trim().parse()));
        let Some((Ok(x), Ok(y))) = numbers else { bail!("--polygon: `{text}` is no corner X,Y") };
        let [x, y, _] =
            tree.metadata().frame.to_cells([x, y, 0.0]).context("the file's transform has no inverse")?;
        Ok([x, y])
    };
    let rings = text.split(';').map(|ring| ring.split_whitespace().map(corner).collect::<Result<Vec<_>>>());
    Ok(Polygon::new(&rings.collect::<Result<Vec<_>>>()?)?)
}

/// Two or three whole numbers.
fn cell(text: &str) -> Result<[i64; 3], String> {
    let numbers: Option<Vec<i64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some([x, y]) => Ok([*x, *y, 0]),
        Some([x, y, z]) => Ok([*x, *y, *z]),
        _ => Err("expected COL,ROW or X,Y,Z in whole cells".into()),
    }
}
