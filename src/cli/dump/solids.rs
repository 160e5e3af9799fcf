//! Structures of the literature of an exact model: its BSP tree, and its extended octree.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use spinney::brep::{Faces, Grid};
use spinney::raw::io::shown;
use spinney::raw::partitions::{BinaryNode, Bsp, BspItem, extended_octree_text};
use spinney::{ExactModel, Progress, SetOperation};

use super::super::report::warn;

/// Query of a BSP tree.
pub(super) enum BspQuery<'a> {
    Text,
    Stats,
    /// The path to the cell of a point.
    Locate([f64; 3]),
    /// The fragments of faces from back to front, as seen from a point.
    Order([f64; 3]),
    /// The tree of a set operation with another model.
    Combination(SetOperation, &'a ExactModel),
}

/// Returns the modified DF-expression of a model's octree.
pub(super) fn octree_text(model: &ExactModel, limit: u64, progress: &dyn Progress) -> Result<String> {
    super::check_count(model.path(), model.len(), "faces", limit)?;
    warn_of_losses(model)?;
    Ok(extended_octree_text(model, progress)?)
}

/// Returns a model's BSP tree as text, or the result of a query of it.
pub(super) fn bsp_text(
    model: &ExactModel,
    query: &BspQuery<'_>,
    limit: u64,
    progress: &dyn Progress,
) -> Result<String> {
    super::check_count(model.path(), model.len(), "faces", limit)?;
    if let BspQuery::Combination(operation, other) = query {
        super::check_count(other.path(), other.len(), "faces", limit)?;
        ensure!(
            model.unit() == other.unit() && model.crs() == other.crs(),
            "{}: has another unit or coordinate system than {}; `spinney combine` converts units",
            shown(other.path()),
            shown(model.path())
        );
        [model, *other].into_iter().try_for_each(warn_of_losses)?;
        let (trees, grid) = Bsp::of_models(&[model, *other], progress)?;
        let made = trees[0].combine(&trees[1], *operation, progress)?;
        return Ok(made.to_text(&grid, model.unit()));
    }
    let (trees, grid) = Bsp::of_models(&[model], progress)?;
    let tree = &trees[0];
    match query {
        BspQuery::Stats => stats(tree, model),
        BspQuery::Locate(point) => path_to(tree, near(&grid, *point)?, &grid),
        BspQuery::Order(eye) => order(tree, near(&grid, *eye)?, &grid),
        _ => {
            warn_of_losses(model)?;
            Ok(tree.to_text(&grid, model.unit()))
        }
    }
}

/// Warns of what a model has and its text does not.
fn warn_of_losses(model: &ExactModel) -> Result<()> {
    let lost = [
        ("the coordinate system (--crs of build sets it)", model.crs().is_some()),
        ("names of objects", model.parts().len() > 1),
        ("attributes", model.parts_with_attributes()? > 0),
        ("values of faces", !model.value_columns()?.is_empty()),
        ("colours", model.is_coloured()?),
    ];
    for (what, _) in lost.into_iter().filter(|(_, is_there)| *is_there) {
        warn(&format!("{}: the text does not contain {what}", shown(model.path())));
    }
    Ok(())
}

/// Returns the grid point nearest to a point of the world.
fn near(grid: &Grid, point: [f64; 3]) -> Result<[i32; 3]> {
    let at = grid.to_grid(point).map(f64::round);
    ensure!(
        at.iter().all(|at| at.abs() < f64::from(1 << 30)),
        "got the point {point:?}, expected one within 2^30 grid units ({}) of the model",
        grid.width()
    );
    Ok(at.map(|at| at as i32))
}

fn coordinates(point: [f64; 3]) -> String {
    point.map(|at| at.to_string()).join(",")
}

fn stats(tree: &Bsp, model: &ExactModel) -> Result<String> {
    let mut text = String::new();
    super::push_bsp_stats(&mut text, tree)?;
    let (faces, nodes, bytes) = (model.len(), model.nodes().total(), model.file_size());
    writeln!(text, "file        {faces} faces, {nodes} nodes, {bytes} bytes")?;
    Ok(text)
}

/// Returns the planes above the cell of a point, each with the point's side, and the cell.
fn path_to(tree: &Bsp, point: [i32; 3], grid: &Grid) -> Result<String> {
    let mut text = format!("point       {} (the nearest grid point)\n", coordinates(grid.to_world(point)));
    let (nodes, wide) = (tree.nodes(), point.map(i128::from));
    let mut at = 0;
    while let BinaryNode::Divided { by, second } = &nodes[at] {
        let (normal, d) = by.descriptor();
        let height: i128 = (0..3).map(|axis| i128::from(normal[axis]) * wide[axis]).sum::<i128>() + d;
        let side = if height < 0 { "back" } else { "front" };
        at = if height < 0 { at + 1 } else { *second };
        let [a, b, c] = normal;
        writeln!(text, "{side:11} {a} {b} {c} {d}")?;
    }
    let is_inside = matches!(nodes[at], BinaryNode::Leaf(true));
    writeln!(text, "cell        {}", if is_inside { "in" } else { "out" })?;
    Ok(text)
}

/// Returns the fragments of faces from back to front.
fn order(tree: &Bsp, eye: [i32; 3], grid: &Grid) -> Result<String> {
    let Grid { origin, step, divisor, .. } = grid;
    let mut text = String::new();
    tree.back_to_front(eye, &mut |item| {
        let BspItem::Fragment(fragment) = item else { return };
        let _ = write!(text, "{}", fragment.source);
        for corner in tree.corners(fragment) {
            let world = [0, 1, 2].map(|axis| (origin[axis] as f64 + corner[axis]) * step / divisor);
            let _ = write!(text, "\t{}", coordinates(world));
        }
        text.push('\n');
    });
    Ok(text)
}

/// Opens the other model of a set operation.
pub(super) fn operand(path: &Path, global: &super::Global) -> Result<ExactModel> {
    match super::super::exact::open(path, global)? {
        Some(model) => Ok(model),
        None => bail!("--combine: {} is no exact model; build it with --brep", shown(path)),
    }
}
