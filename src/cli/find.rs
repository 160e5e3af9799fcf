//! `spinney find`: the largest blocks whose cells all meet a condition.

use std::io::{BufWriter, Write, stdout};

use anyhow::Result;
use serde_json::json;
use spinney::query::Condition;

use super::args::{PartOptions, ViewedTree};

const EXAMPLES: &str = "Examples:
  spinney find relief.goblin --above 4000
  spinney find landcover.goblin --class 11 --bbox 5,44,17,48 --json | head

A line has the block's FD code, level, first column and row, columns and rows, and its value if it
has only one.";

/// Find the largest blocks whose cells all meet a condition
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
    #[arg(long)]
    limit: Option<u64>,
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
    let mut left = args.limit.unwrap_or(u64::MAX);
    let octree = tree.header().form.axes() == 3;
    let mut failed = Ok(());
    tree.find(condition, bounds, &mut |block| {
        if left == 0 {
            return Ok(false);
        }
        left -= 1;
        let size = block.bounds.size();
        let axes = if octree { 3 } else { 2 };
        let written = if args.json {
            let object = json!({
                "code": block.code,
                "level": block.level,
                "min": block.bounds.min[..axes],
                "size": size[..axes],
                "value": block.value,
            });
            writeln!(out, "{object}")
        } else {
            let numbers =
                |list: &[u64; 3]| list[..axes].iter().map(u64::to_string).collect::<Vec<_>>().join(",");
            let value = block.value.map_or(String::new(), |value| format!(" {value}"));
            let (min, size) = (numbers(&block.bounds.min), numbers(&size));
            writeln!(out, "{} {} {min} {size}{value}", block.code, block.level)
        };
        failed = written;
        Ok(failed.is_ok())
    })?;
    failed?;
    Ok(out.flush()?)
}
