//! Structures of the literature of a tree of cells.

use std::fmt::Write as _;

use anyhow::{Result, ensure};
use spinney::query::PolygonRequest;
use spinney::raw::io::shown;
use spinney::raw::partitions::{BinaryNode, Bintree, Bsp, df_head};
use spinney::raw::tree::df;
use spinney::{Dataset, Number, Progress};

use super::super::report::warn;

/// A structure of cells.
pub(super) enum CellStructure {
    Df,
    /// A bintree; whether each block is halved along the axis that gives the fewest nodes.
    Bintree(bool),
    /// The BSP tree of a class.
    Bsp(Number),
}

/// Returns the structure as text, or its sizes.
pub(super) fn text(
    tree: &Dataset,
    structure: &CellStructure,
    (limit, is_stats): (u64, bool),
    progress: &dyn Progress,
) -> Result<String> {
    let header = tree.header();
    let mut text = String::new();
    if !is_stats {
        warn_of_losses(tree);
    }
    match structure {
        CellStructure::Df if is_stats => {
            let packed = df::to_packed(&tree.in_memory(limit)?)?;
            let leaves = packed.values.len();
            writeln!(text, "symbols     {}, {leaves} of them leaves with a value", packed.symbols)?;
            let bytes = packed.bits.len() + leaves * header.form.value.size();
            writeln!(text, "bytes       {bytes}, with two bits a symbol, and the values of leaves")?;
        }
        CellStructure::Df => {
            let head = df_head(header.form, header.depth(), header.extent);
            write!(text, "{head} {}", tree.df_text(limit)?)?;
        }
        CellStructure::Bintree(is_adaptive) => {
            let cells = tree.in_memory(limit)?;
            let bintree = match is_adaptive {
                true => Bintree::adaptive(&cells, header.extent)?,
                // (No limit: a record makes at most three nodes, or seven, for its four cells, or
                // eight.)
                false => Bintree::alternating(&cells, header.extent, usize::MAX)?,
            };
            if !is_stats {
                return Ok(bintree.to_text());
            }
            let nodes = bintree.nodes();
            let leaves = nodes.iter().filter(|node| matches!(node, BinaryNode::Leaf(_))).count();
            writeln!(text, "leaves      {leaves}")?;
            writeln!(text, "divided     {} nodes", nodes.len() - leaves)?;
        }
        CellStructure::Bsp(class) => {
            let structure = class_tree(tree, *class, limit, progress)?;
            if !is_stats {
                return Ok(structure.plane_text(header.depth(), header.extent));
            }
            super::push_bsp_stats(&mut text, &structure)?;
        }
    }
    if is_stats {
        let (records, bytes) = (tree.statistics(None, progress)?.cells, tree.file_size());
        writeln!(text, "file        {records} cells with a value, {bytes} bytes")?;
    }
    Ok(text)
}

/// Warns of what a tree of cells has, and the text of a structure does not.
fn warn_of_losses(tree: &Dataset) {
    let metadata = tree.metadata();
    let lost = [
        ("the position of cells in the world", !metadata.frame.is_identity() || metadata.frame.crs.is_some()),
        ("names of classes", !metadata.class_names.is_empty()),
    ];
    for (what, _) in lost.into_iter().filter(|(_, is_there)| *is_there) {
        warn(&format!("{}: the text does not contain {what}", shown(tree.name())));
    }
}

/// Returns the BSP tree whose inside is the cells of a class.
fn class_tree(tree: &Dataset, class: Number, limit: u64, progress: &dyn Progress) -> Result<Bsp> {
    let mut request = PolygonRequest::new();
    (request.classes, request.in_cells) = (Some(vec![class]), true);
    let mut polygons: Vec<Vec<Vec<[i32; 2]>>> = Vec::new();
    let mut count = 0;
    let found = tree.polygons(&request, progress, &mut |region| {
        let mut first = 0;
        for &rings in region.polygons() {
            let mut polygon = Vec::with_capacity(rings);
            for ring in first..first + rings {
                count += region.count(ring);
                let mut points = Vec::new();
                // (Beyond the limit, points are only counted.)
                if count <= limit {
                    region.points(ring, &mut |some| {
                        points.extend(some.iter().map(|[x, y, _]| [*x as i32, *y as i32]));
                        Ok(())
                    })?;
                    points.pop();
                }
                polygon.push(points);
            }
            first += rings;
            polygons.push(polygon);
        }
        Ok(())
    })?;
    super::check_count(tree.name(), count, "vertices of borders", limit)?;
    ensure!(found.count > 0, "{}: no cell has the value {class}", shown(tree.name()));
    Ok(Bsp::of_polygons(&polygons)?)
}
