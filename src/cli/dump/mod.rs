//! `spinney dump`: small trees in full, and structures of the literature.

mod cells;
mod edges;
mod points;
mod solids;
mod topology;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use clap::ValueEnum as _;
use spinney::raw::io::shown;
use spinney::raw::ops::Prefer;
use spinney::raw::partitions::{BinaryNode, Bsp, PmRule, PointDivision};
use spinney::{CombineOperation, ExactModel};

use self::cells::CellStructure;
use self::solids::BspQuery;
use super::args::{DEFAULT_MEMORY, ViewedTree, class_value};
use super::report::{Work, print_text};
use super::{Global, exact, lines, points as point_files};

const EXAMPLES: &str = "Examples:
  spinney dump classic.goblin               table of nodes, as in the literature
  spinney dump classic.goblin --codes       path, FD code and value of every leaf
  spinney dump classic.goblin --as df       the DF-expression
  spinney dump classic.goblin --as bintree  the DF-expression of a bintree, as in .bintree files
  spinney dump roads.goblin --as pm1        the PM1 quadtree of a tree of lines
  spinney dump wells.goblin --as k-d        the k-d tree of a tree of points
  spinney dump part.goblin --as euler       the operators that build an exact model
  spinney dump roads.goblin --as bucket --leaf-size 4 --stats
  spinney dump part.goblin --as bsp         the BSP tree of an exact model, as in .bsp files
  spinney dump part.goblin --as bsp --combine a-b tool.goblin

Structures:
  df              cells: G (M) inner, W (V) VOID, B (F) full, digits or [value] for other leaves;
                  exact models: also A (FACE), E (EDGE), X (VERTEX), with planes, as in .df files
  bintree         cells: blocks are halved along x, y (z), x ...; leaves as with df
  bsp             lines in the plane, a class of a quadtree (--class), exact models: a node is
                  divided by the line of an edge, or by the plane of a face
  pm1, pm2, pm3   lines: leaves have one vertex with its edges, or a part of one edge (pm1), of edges
                  with a common vertex (pm2), or of any edges (pm3); with heights, pm1 is the octree
                  of edges
  bucket          lines: leaves have at most --leaf-size edges, or those of one vertex
  point-quadtree, point-octree
                  points: a node is divided at its point along all axes
  k-d             points: a node is divided at its point along one axis after the other
  euler           exact models: the Euler operators that build the model, as in .euler files
  winged-edge     exact models: vertices, edges, faces and shells, each with its neighbours

A tree of edges is its DF-expression (B or F: leaves with edges), then a line per leaf with edges:
corner, side, and the ends of each edge. A tree of points has a line per node in preorder: its
depth, its side of the node above, the coordinates, and the number of equal points; points are
inserted in a pseudo-random order that depends on their coordinates.";

/// Structure of the literature.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum Structure {
    Df,
    Bintree,
    Bsp,
    Pm1,
    Pm2,
    Pm3,
    Bucket,
    PointQuadtree,
    PointOctree,
    #[value(name = "k-d")]
    KD,
    WingedEdge,
    Euler,
}

/// Print a small tree in full, or as a structure of the literature
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Print a structure of the literature: df, bintree, bsp, pm1, pm2, pm3, bucket,
    /// point-quadtree, point-octree, k-d, euler or winged-edge
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
    /// Values equal to this are the inside of the BSP tree of a class map: a number, or the name of
    /// a class
    #[arg(long, value_name = "CLASS", requires = "structure")]
    class: Option<String>,
    /// Print statistics of a structure: numbers of nodes, depth, bytes, and those of the file
    #[arg(long, requires = "structure")]
    stats: bool,
    /// Locate a point in a BSP tree: its side of each plane down to its cell, and whether that is
    /// in
    #[arg(long, value_name = "X,Y,Z", requires = "structure", value_parser = parse_point, allow_hyphen_values = true)]
    locate: Option<[f64; 3]>,
    /// Viewpoint from which the faces of a BSP tree are printed from back to front: number of the
    /// face and vertices of each fragment
    #[arg(long, value_name = "X,Y,Z", requires = "structure", value_parser = parse_point, allow_hyphen_values = true)]
    eye: Option<[f64; 3]>,
    /// Combine the BSP tree with that of another exact model on a grid of the same unit: any of the
    /// sixteen operations of `combine`
    #[arg(long, value_names = ["OPERATION", "MODEL"], num_args = 2, requires = "structure")]
    combine: Option<Vec<String>>,
    /// Print a line per leaf: path, FD code, value
    #[arg(long)]
    codes: bool,
    /// Maximum number of records, edges in leaves, points or operators; larger files are an error
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    limit: u64,
}

/// Parses a point of space.
fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let point = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    point.filter(|point| point.iter().all(|at| at.is_finite())).ok_or_else(|| "expected X,Y,Z".into())
}

/// Prints a structure of an exact model.
fn run_solid(args: &Args, model: &ExactModel, global: &Global) -> Result<()> {
    let file = &args.tree.file;
    let queries = ["--as", "--limit", "--stats", "--locate", "--eye", "--combine"];
    global.check_options(file, exact::KIND, &queries)?;
    let given = [args.stats, args.locate.is_some(), args.eye.is_some(), args.combine.is_some()];
    let given = given.into_iter().filter(|given| *given).count();
    ensure!(given <= 1, "--stats, --locate, --eye, --combine: got {given} of them, expected one");
    ensure!(
        given == 0 || args.structure == Some(Structure::Bsp),
        "--stats, --locate, --eye and --combine work only with --as bsp"
    );
    let work = Work::start(global, "nodes")?;
    let text = match args.structure {
        Some(Structure::Df) => solids::octree_text(model, args.limit, &work)?,
        Some(Structure::Bsp) => {
            let other;
            let query = match &args.combine.as_deref() {
                Some([operation, path]) => {
                    let Some(CombineOperation::Set { operation, .. }) =
                        CombineOperation::named(operation, Prefer::First)
                    else {
                        bail!(
                            "--combine: got `{operation}`, expected a set operation, such as a-b, or 0 to 15"
                        )
                    };
                    other = solids::operand(Path::new(path), global)?;
                    BspQuery::Combination(operation, &other)
                }
                _ => match (args.locate, args.eye) {
                    (Some(point), _) => BspQuery::Locate(point),
                    (_, Some(eye)) => BspQuery::Order(eye),
                    _ if args.stats => BspQuery::Stats,
                    _ => BspQuery::Text,
                },
            };
            solids::bsp_text(model, &query, args.limit, &work)?
        }
        Some(Structure::Euler) => exact::operators(model, DEFAULT_MEMORY, args.limit, &work)?,
        Some(Structure::WingedEdge) => topology::text(model, args.limit, &work)?,
        other => return unfit(file, exact::KIND, other, "df, bsp, euler or winged-edge"),
    };
    work.finish();
    print(text)?;
    Ok(model.check_unchanged()?)
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let file = &args.tree.file;
    ensure!(
        args.leaf_size.is_none() || args.structure == Some(Structure::Bucket),
        "--leaf-size: works only with --as bucket"
    );
    ensure!(
        args.class.is_none() || args.structure == Some(Structure::Bsp),
        "--class: works only with --as bsp"
    );
    ensure!(
        !args.adaptive || args.structure == Some(Structure::Bintree),
        "--adaptive: works only with --as bintree"
    );
    if let Some(model) = exact::open(file, global)? {
        return run_solid(args, &model, global);
    }
    let of_bsp = [
        ("--locate", args.locate.is_some()),
        ("--eye", args.eye.is_some()),
        ("--combine", args.combine.is_some()),
    ];
    if let Some((option, _)) = of_bsp.into_iter().find(|(_, given)| *given) {
        bail!("{option}: works only with exact models (`build --brep`), {} is none", file.display());
    }
    let fitting = ["--as", "--stats", "--limit", "--leaf-size"];
    if let Some(tree) = lines::open(file, global)? {
        global.check_options(file, lines::KIND, &fitting)?;
        let rule = match args.structure {
            Some(Structure::Pm1) => PmRule::Pm1,
            Some(Structure::Pm2) => PmRule::Pm2,
            Some(Structure::Pm3) => PmRule::Pm3,
            Some(Structure::Bucket) => PmRule::Bucket(args.leaf_size.unwrap_or(8)),
            Some(Structure::Bsp) => return print(edges::bsp_text(&tree, (args.limit, args.stats))?),
            other => return unfit(file, lines::KIND, other, "bsp, pm1, pm2, pm3 or bucket"),
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
    let structure = match (args.structure, &args.class) {
        (None, _) => None,
        (Some(Structure::Df), _) => Some(CellStructure::Df),
        (Some(Structure::Bintree), _) => Some(CellStructure::Bintree(args.adaptive)),
        (Some(Structure::Bsp), Some(class)) => {
            Some(CellStructure::Bsp(class_value(&tree, "--class", class)?))
        }
        (Some(Structure::Bsp), None) => {
            bail!(
                "--as bsp: {} is a tree of cells, which needs --class: its cells are inside",
                file.display()
            )
        }
        (other, _) => return unfit(file, "a tree of cells", other, "df, bintree or bsp"),
    };
    let text = match structure {
        Some(structure) => {
            let work = Work::start(global, "cells")?;
            cells::text(&tree, &structure, (args.limit, args.stats), &work)?
        }
        None if args.codes => tree.leaf_codes(args.limit)?,
        None => tree.classic_table(args.limit)?,
    };
    print(text)?;
    Ok(tree.check_unchanged()?)
}

/// Appends the sizes of a BSP tree.
fn push_bsp_stats(text: &mut String, tree: &Bsp) -> Result<()> {
    let (mut inside, mut outside, mut fragments) = (0, 0, 0);
    for node in tree.nodes() {
        match node {
            BinaryNode::Leaf(true) => inside += 1,
            BinaryNode::Leaf(false) => outside += 1,
            BinaryNode::Divided { by, .. } => fragments += by.fragments.len(),
        }
    }
    let divided = tree.nodes().len() - inside - outside;
    writeln!(text, "leaves      {inside} inside, {outside} outside")?;
    writeln!(text, "divided     {divided} nodes")?;
    writeln!(text, "depth       {}", tree.depth())?;
    writeln!(text, "fragments   {fragments}")?;
    // A node that divides has a normal of three 64-bit numbers, an offset of 128 bits, and the
    // 32-bit number of its second side; a leaf one bit.
    writeln!(text, "bytes       {}, besides the fragments", 44 * divided + (inside + outside).div_ceil(8))?;
    Ok(())
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
