//! `spinney dump`: small trees in full, and structures of the literature.

mod edges;
mod points;

use std::path::Path;

use anyhow::{Result, bail, ensure};
use clap::ValueEnum as _;
use spinney::raw::io::shown;
use spinney::raw::partitions::{Bintree, PmRule, PointDivision};

use super::args::ViewedTree;
use super::report::print_text;
use super::{Global, lines, points as point_files};

const EXAMPLES: &str = "Examples:
  spinney dump classic.goblin               table of nodes, as in the literature
  spinney dump classic.goblin --codes       path, FD code and value of every leaf
  spinney dump classic.goblin --as df       the DF-expression
  spinney dump classic.goblin --as bintree  the DF-expression of a bintree, as in .bintree files
  spinney dump roads.goblin --as pm1        the PM1 quadtree of a tree of lines
  spinney dump wells.goblin --as k-d        the k-d tree of a tree of points
  spinney dump roads.goblin --as bucket --leaf-size 4 --stats

Structures:
  df              cells: G (M) inner, W (V) VOID, B (F) full, digits or [value] for other leaves
  bintree         cells: blocks are halved along x, y (z), x ...; leaves as with df
  pm1, pm2, pm3   lines: leaves have one vertex with its edges, or a part of one edge (pm1), of edges
                  with a common vertex (pm2), or of any edges (pm3); with heights, pm1 is the octree
                  of edges
  bucket          lines: leaves have at most --leaf-size edges, or those of one vertex
  point-quadtree, point-octree
                  points: a node is divided at its point along all axes
  k-d             points: a node is divided at its point along one axis after the other

A tree of edges is its DF-expression (B or F: leaves with edges), then a line per leaf with edges:
corner, side, and the ends of each edge. A tree of points has a line per node in preorder: its
depth, its side of the node above, the coordinates, and the number of equal points; points are
inserted in a pseudo-random order that depends on their coordinates.";

/// Structure of the literature.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum Structure {
    Df,
    Bintree,
    Pm1,
    Pm2,
    Pm3,
    Bucket,
    PointQuadtree,
    PointOctree,
    #[value(name = "k-d")]
    KD,
}

/// Print a small tree in full, or as a structure of the literature
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Print a structure of the literature: df, bintree, pm1, pm2, pm3, bucket, point-quadtree,
    /// point-octree or k-d
    #[arg(
        long = "as",
        value_name = "STRUCTURE",
        value_enum,
        hide_possible_values = true,
        conflicts_with = "codes"
    )]
    structure: Option<Structure>,
    /// Halve each block of a bintree along the axis that gives the fewest nodes: X, Y or Z inner;
    /// for at most 1024 x 1024 or 64 x 64 x 64 cells
    #[arg(long, requires = "structure")]
    adaptive: bool,
    /// Maximum number of edges in a leaf of a bucket tree [default: 8]
    #[arg(long, value_name = "N", requires = "structure")]
    leaf_size: Option<usize>,
    /// Print statistics of a structure of lines or points: numbers of nodes, depth, bytes, and
    /// those of the file
    #[arg(long, requires = "structure")]
    stats: bool,
    /// Print a line per leaf: path, FD code, value
    #[arg(long)]
    codes: bool,
    /// Maximum number of records, edges in leaves, or points; larger trees are an error
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    limit: u64,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let file = &args.tree.file;
    ensure!(
        args.leaf_size.is_none() || args.structure == Some(Structure::Bucket),
        "--leaf-size: works only with --as bucket"
    );
    ensure!(
        !args.adaptive || args.structure == Some(Structure::Bintree),
        "--adaptive: works only with --as bintree"
    );
    let fitting = ["--as", "--stats", "--limit", "--leaf-size"];
    if let Some(tree) = lines::open(file, global)? {
        global.check_options(file, lines::KIND, &fitting)?;
        let rule = match args.structure {
            Some(Structure::Pm1) => PmRule::Pm1,
            Some(Structure::Pm2) => PmRule::Pm2,
            Some(Structure::Pm3) => PmRule::Pm3,
            Some(Structure::Bucket) => PmRule::Bucket(args.leaf_size.unwrap_or(8)),
            other => return unfit(file, lines::KIND, other, "pm1, pm2, pm3 or bucket"),
        };
        return print(edges::text(&tree, rule, (args.limit, args.stats))?);
    }
    if let Some(tree) = point_files::open(file, global)? {
        global.check_options(file, point_files::KIND, &fitting)?;
        let is_octree = tree.dimension().axes() == 3;
        let division = match args.structure {
            Some(Structure::PointQuadtree) if !is_octree => PointDivision::AllAxes,
            Some(Structure::PointOctree) if is_octree => PointDivision::AllAxes,
            Some(Structure::KD) => PointDivision::OneAxis,
            other => {
                let expected = if is_octree { "point-octree or k-d" } else { "point-quadtree or k-d" };
                return unfit(file, point_files::KIND, other, expected);
            }
        };
        return print(points::text(&tree, division, (args.limit, args.stats))?);
    }
    let tree = args.tree.open(global)?;
    ensure!(
        !args.stats,
        "--stats: works only with structures of lines and points; `spinney info` prints those of cells"
    );
    let text = match args.structure {
        Some(Structure::Df) => tree.df_text(args.limit)?,
        Some(Structure::Bintree) => {
            let (cells, extent) = (tree.in_memory(args.limit)?, tree.header().extent);
            let bintree = match args.adaptive {
                true => Bintree::adaptive(&cells, extent)?,
                // (No limit: a record makes at most three nodes, or seven, for its four cells, or
                // eight.)
                false => Bintree::alternating(&cells, extent, usize::MAX)?,
            };
            bintree.to_text()
        }
        None if args.codes => tree.leaf_codes(args.limit)?,
        None => tree.classic_table(args.limit)?,
        other => return unfit(file, "a tree of cells", other, "df or bintree"),
    };
    print(text)?;
    Ok(tree.check_unchanged()?)
}

/// Error of a structure that a file does not have.
fn unfit(file: &Path, kind: &str, structure: Option<Structure>, expected: &str) -> Result<()> {
    let value = structure.and_then(|structure| structure.to_possible_value());
    let found = value.as_ref().map_or("nothing", |value| value.get_name());
    bail!("--as: got {found}, expected {expected} for {}, which is {kind}", file.display())
}

/// Refuses trees with too many items.
fn check_count(path: &Path, count: u64, what: &str, limit: u64) -> Result<()> {
    ensure!(
        count <= limit,
        "{}: has {count} {what}, expected at most {limit}; raise --limit, or write a part with `spinney get`",
        shown(path)
    );
    Ok(())
}

fn print(mut text: String) -> Result<()> {
    if !text.ends_with('\n') {
        text.push('\n');
    }
    print_text(&text)
}
