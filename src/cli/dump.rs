//! `spinney dump`: small trees in full.

use anyhow::Result;
use spinney::raw::partitions::Bintree;

use super::Global;
use super::args::ViewedTree;
use super::report::print_text;

const EXAMPLES: &str = "Examples:
  spinney dump classic.goblin            table of nodes, as in the literature
  spinney dump classic.goblin --df       the DF-expression
  spinney dump classic.goblin --codes    path, FD code and value of every leaf
  spinney dump classic.goblin --bintree  the DF-expression of a bintree, as in .bintree files";

/// Print a small tree in full
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Print the DF-expression: G (or M) inner, W (V) VOID, B (F) full, digits or [value] for other
    /// leaves
    #[arg(long, conflicts_with = "codes")]
    df: bool,
    /// Print the DF-expression of a bintree: blocks are halved along x, y (z), x ...; G (M) inner,
    /// leaves as with --df
    #[arg(long, conflicts_with_all = ["codes", "df"])]
    bintree: bool,
    /// Halve each block along the axis that gives the fewest nodes: X, Y or Z inner; for at most
    /// 1024 x 1024 or 64 x 64 x 64 cells
    #[arg(long, requires = "bintree")]
    adaptive: bool,
    /// Print a line per leaf: path, FD code, value
    #[arg(long)]
    codes: bool,
    /// Maximum number of records; larger trees are an error
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    limit: u64,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let tree = args.tree.open(global)?;
    let mut text = if args.df {
        tree.df_text(args.limit)?
    } else if args.codes {
        tree.leaf_codes(args.limit)?
    } else if args.bintree {
        let (cells, extent) = (tree.in_memory(args.limit)?, tree.header().extent);
        let bintree = match args.adaptive {
            true => Bintree::adaptive(&cells, extent)?,
            // (No limit: a record makes at most three nodes, or seven, for its four cells, or
            // eight.)
            false => Bintree::alternating(&cells, extent, usize::MAX)?,
        };
        bintree.to_text()
    } else {
        tree.classic_table(args.limit)?
    };
    if !text.ends_with('\n') {
        text.push('\n');
    }
    print_text(&text)?;
    Ok(tree.check_unchanged()?)
}
