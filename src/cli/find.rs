//! `spinney find`: the blocks whose cells all meet a condition.

use std::collections::BTreeMap;
use std::io::{BufWriter, Write, stdout};

use anyhow::Result;
use serde_json::json;
use spinney::Error;
use spinney::dataset::Dataset;
use spinney::query::{Condition, FoundBlock};

use super::args::{PartOptions, ViewedTree};
use super::report::statistics::class_as_json;

const EXAMPLES: &str = "Examples:
  spinney find relief.goblin --above 4000
  spinney find landcover.goblin --class 11 --largest 10
  spinney find landcover.goblin --class 11 --bbox 5,44,17,48 --json > blocks.txt

Every cell that meets the condition is in one block, and no block is a part of a larger one. They come
by place, in the order of their FD codes (Z order), or with --largest by size.

A line has the block's FD code, level, first column and row, columns and rows, its box in the world
(west, south, east, north, as --bbox takes it; of octrees least x, y, z and greatest x, y, z), and its
value if it has only one.";

/// Find the blocks of the tree whose cells all meet a condition
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    condition: Wanted,
    #[command(flatten)]
    part: PartOptions,
    /// Stop after so many blocks
    #[arg(long, value_name = "N")]
    limit: Option<u64>,
    /// Only so many blocks, the largest first
    #[arg(long, value_name = "N", conflicts_with = "limit")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    largest: Option<u32>,
    /// Print a JSON object per line
    #[arg(long)]
    json: bool,
}

/// A condition on the first channel.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Wanted {
    /// Values greater than this
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    above: Option<f64>,
    /// Values less than this
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    below: Option<f64>,
    /// Values equal to this
    #[arg(long, value_name = "K", allow_hyphen_values = true)]
    class: Option<f64>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let tree = args.tree.open()?;
    let bounds = args.part.bounds(&tree)?;
    let Wanted { above, below, class } = args.condition;
    let condition = match (above, below, class) {
        (Some(bound), _, _) => Condition::Above(bound),
        (_, Some(bound), _) => Condition::Below(bound),
        (_, _, number) => Condition::Equal(number.unwrap_or_default()),
    };
    let mut out = BufWriter::new(stdout().lock());
    let mut write = |block: &FoundBlock| -> spinney::Result<()> {
        let line = if args.json { as_json(&tree, block).to_string() } else { as_text(&tree, block) };
        writeln!(out, "{line}").map_err(Error::io("-", "write"))
    };
    let mut left = args.limit.unwrap_or(u64::MAX);
    let mut largest = BTreeMap::new();
    tree.find(condition, bounds, &mut |block| {
        if let Some(most) = args.largest {
            // By level, and those of a level as they come.
            largest.insert((block.level, block.code.clone()), block);
            if largest.len() > most as usize {
                largest.pop_last();
            }
            return Ok(true);
        }
        if left == 0 {
            return Ok(false);
        }
        left -= 1;
        write(&block).map(|()| true)
    })?;
    largest.values().try_for_each(write)?;
    out.flush()?;
    Ok(tree.check_unchanged()?)
}

/// A block as a line of text.
fn as_text(tree: &Dataset, block: &FoundBlock) -> String {
    let axes = tree.header().form.axes();
    let list = |numbers: &[u64; 3]| numbers[..axes].iter().map(u64::to_string).collect::<Vec<_>>().join(",");
    let [low, high] = tree.metadata().frame.world_box(&block.bounds);
    let world: Vec<_> = low[..axes].iter().chain(&high[..axes]).map(f64::to_string).collect();
    let (min, size, world) = (list(&block.bounds.min), list(&block.bounds.size()), world.join(","));
    let value = block.value.map_or(String::new(), |value| format!(" {value}"));
    format!("{} {} {min} {size} {world}{value}", block.code, block.level)
}

/// A block as a JSON object.
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
