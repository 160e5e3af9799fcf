//! `spinney dump`: small trees in full.

use anyhow::Result;

use super::args::ViewedTree;
use super::report::print_text;

const EXAMPLES: &str = "Examples:
  spinney dump classic.goblin            the literature's table
  spinney dump classic.goblin --df       the DF-expression
  spinney dump classic.goblin --codes    FD code and value of every leaf";

/// Print a small tree in full
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Print the DF-expression: G (or M) inner, W (V) VOID, B (F) full, digits or [value] for other leaves
    #[arg(long, conflicts_with = "codes")]
    df: bool,
    /// Print a line per leaf: path, FD code, value
    #[arg(long)]
    codes: bool,
    /// Number of records at most: trees of more are refused
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    limit: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let tree = args.tree.open()?;
    let mut text = if args.df {
        tree.df_text(args.limit)?
    } else if args.codes {
        tree.leaf_codes(args.limit)?
    } else {
        tree.classic_table(args.limit)?
    };
    if !text.ends_with('\n') {
        text.push('\n');
    }
    print_text(&text)?;
    Ok(tree.check_unchanged()?)
}
