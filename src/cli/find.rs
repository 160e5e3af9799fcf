//! `spinney find`: blocks whose cells all satisfy a condition; leaves, objects and contacts of
//! exact models.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, bail, ensure};
use serde_json::json;
use spinney::query::{Condition, FoundBlock};
use spinney::raw::ops::ViewSource;
use spinney::raw::report::class_as_json;
use spinney::{Dataset, Number};

use super::Global;
use super::args::{Memory, PartOptions, ViewedTree, class_value};
use super::exact::{self, LeafKind};
use super::features::{FeatureCells, FeatureTerms, check_features};
use super::report::{Found, Work, warn};

const EXAMPLES: &str = "Examples:
  spinney find relief.goblin --above 4000
  spinney find landcover.goblin --class 11 --largest 10
  spinney find city.goblin --object 'town hall'
  spinney find city.city.json --contacts --snap 0.001";

/// Find blocks of cells by value, or leaves, objects and contacts of exact models
#[derive(clap::Args)]
#[command(after_help = EXAMPLES, override_usage = "spinney find [OPTIONS] <CONDITION> <FILE>")]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    condition: Wanted,
    #[command(flatten)]
    part: PartOptions,
    /// Region in which to search: the cells of features (polygons, lines and points of GeoJSON,
    /// FlatGeobuf, GeoPackage, a shapefile or a table); in an octree, columns of cells
    #[arg(long, value_name = "FEATURES")]
    within: Option<PathBuf>,
    #[command(flatten)]
    features: FeatureCells,
    #[command(flatten)]
    memory: Memory,
    /// Width of the grid units of a mesh file for --contacts [default: that of `build --brep`]
    #[arg(long, value_name = "WIDTH", requires = "contacts")]
    snap: Option<f64>,
    /// Maximum number of blocks
    #[arg(long, value_name = "N")]
    limit: Option<u64>,
    /// Only this many blocks, the largest first
    #[arg(long, value_name = "N", conflicts_with = "limit")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    largest: Option<u32>,
    /// Print JSON: an object per line
    #[arg(long)]
    json: bool,
}

/// A condition on the first channel, or on leaves of an exact model.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Wanted {
    /// Values greater than this
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    above: Option<Number>,
    /// Values less than this
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    below: Option<Number>,
    /// Values equal to this: a number, or the name of a class
    #[arg(long, value_name = "K", allow_hyphen_values = true)]
    class: Option<String>,
    /// Leaves of exact models, of these kinds
    #[arg(long, value_name = "KIND,...", value_delimiter = ',')]
    leaf: Option<Vec<LeafKind>>,
    /// Name of the object of an exact model to report: its number, box, volume and attributes
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
    /// Pairs of objects that touch or overlap: of an exact model, or of a mesh file
    #[arg(long)]
    contacts: bool,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let Wanted { above, below, class, leaf, object, contacts } = &args.condition;
    let file = args.tree.file.as_path();
    let mut found = Found::new(args.limit, args.largest);
    let view = args.tree.open_model(global)?;
    if *contacts {
        let what = if view.is_some() { exact::KIND } else { "a mesh file" };
        let fitting = ["--contacts", "--snap", "--json", "--limit", "--largest", "--view"];
        global.check_options(file, what, &fitting)?;
        let how = (args.snap, args.memory.bytes);
        exact::find_contacts(view.as_ref(), file, args.json, how, global, &mut found)?;
        found.finish()?;
        return Ok(view.map_or(Ok(()), |view| view.file().check_unchanged())?);
    }
    if let Some(view) = view {
        let fitting = ["--object", "--leaf", "--json", "--limit", "--largest", "--view"];
        global.check_options(file, exact::KIND, &fitting)?;
        match object {
            Some(name) => {
                exact::find_object(&view, name, args.json, args.memory.bytes, global, &mut found)?;
            }
            None => {
                let model = view.as_model("leaves of the octree")?;
                exact::find(model, leaf.as_deref().unwrap_or_default(), args.json, &mut found)?;
            }
        }
        found.finish()?;
        return Ok(view.file().check_unchanged()?);
    }
    ensure!(args.snap.is_none(), "--snap: works only with --contacts of mesh files");
    let has_place = args.part.is_given() || args.within.is_some();
    ensure!(
        has_place || args.part.coordinates().given().is_none(),
        "--in: works only with --window or --within"
    );
    let tree = args.tree.open(global)?;
    let boxes = args.part.boxes(&tree)?;
    let condition = match (*above, *below, class) {
        (Some(bound), _, _) => Condition::Above(bound),
        (_, Some(bound), _) => Condition::Below(bound),
        (_, _, Some(class)) => Condition::Equal(class_value(&tree, "--class", class)?),
        _ => bail!(
            "{}: is not an exact model, which --leaf and --object need; use --above, --below or --class",
            file.display()
        ),
    };
    let parts = boxes.map_or(vec![None], |boxes| boxes.into_iter().map(Some).collect());
    let zones = args.zones(&tree, global)?;
    for bounds in parts {
        let mut take = |block: FoundBlock| {
            found.take(block.level, &block.code, &|| {
                if args.json { as_json(&tree, &block).to_string() } else { as_text(&tree, &block) }
            })
        };
        match &zones {
            Some(zones) => tree.find_within(condition, zones, bounds, &(), &mut take)?,
            None => tree.find(condition, bounds, &(), &mut take)?,
        }
    }
    found.finish()?;
    if found.is_empty() {
        warn_empty(&tree, args)?;
    }
    Ok(tree.check_unchanged()?)
}

/// Prints a warning that no cell was found, with the values of a file. (Those of a view may take as
/// long as the search.)
fn warn_empty(tree: &Dataset, args: &Args) -> Result<()> {
    let bounds = if args.tree.is_viewed() { Vec::new() } else { tree.exact_bounds()? };
    let values =
        bounds.first().map_or(String::new(), |(min, max)| format!("; values of the file are {min} to {max}"));
    warn(&format!("{}: no cell satisfies the condition{values}", args.tree.file.display()));
    Ok(())
}

impl Args {
    /// Returns the cells of the region of the search, as a tree.
    fn zones(&self, tree: &Dataset, global: &Global) -> Result<Option<Arc<ViewSource>>> {
        let Some(file) = &self.within else {
            self.features.refuse("works only with --within")?;
            return Ok(None);
        };
        check_features(file, "--within")?;
        let how = FeatureTerms {
            coordinates: self.part.coordinates().given().filter(|_| !self.part.is_given()).cloned(),
            memory: self.memory.bytes,
            ..FeatureTerms::default()
        };
        let work = Work::start(global, "features")?;
        let ground = (tree.header(), tree.metadata());
        let (zones, _) = self.features.over(std::slice::from_ref(file), ground, &how, &work)?;
        Ok(Some(Arc::new(zones)))
    }
}

/// Formats a block as a line of text.
fn as_text(tree: &Dataset, block: &FoundBlock) -> String {
    let axes = tree.header().form.axes();
    let list = |numbers: &[u64; 3]| numbers[..axes].iter().map(u64::to_string).collect::<Vec<_>>().join(",");
    let [low, high] = tree.metadata().frame.world_box(&block.bounds);
    let world: Vec<_> = low[..axes].iter().chain(&high[..axes]).map(f64::to_string).collect();
    let (min, size, world) = (list(&block.bounds.min), list(&block.bounds.size()), world.join(","));
    let value = block.value.map_or(String::new(), |value| format!(" {value}"));
    format!("{} {} {min} {size} {world}{value}", block.code, block.level)
}

/// Formats a block as a JSON object.
fn as_json(tree: &Dataset, block: &FoundBlock) -> serde_json::Value {
    let axes = tree.header().form.axes();
    let [low, high] = tree.metadata().frame.world_box(&block.bounds);
    json!({
        "code": block.code,
        "level": block.level,
        "min": block.bounds.min[..axes],
        "size": block.bounds.size()[..axes],
        "world": [low[..axes], high[..axes]],
        "value": block.value.map(class_as_json),
    })
}
