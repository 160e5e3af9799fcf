//! Trees of edges of the literature, of a tree of lines.

use std::fmt::Write as _;

use anyhow::{Result, bail, ensure};
use spinney::Dimension;
use spinney::lines::LineTree;
use spinney::raw::io::shown;
use spinney::raw::partitions::{Bsp, EdgeTree, EdgeTreeCounts, PmRule};

use super::super::lines::coordinates;

/// Returns the BSP tree of lines in the plane as text, or its sizes.
pub(super) fn bsp_text(tree: &LineTree, (limit, is_stats): (u64, bool)) -> Result<String> {
    let grid = tree.grid();
    super::check_count(tree.path(), tree.segments(), "segments", limit)?;
    ensure!(
        grid.dimension == Dimension::Quad,
        "--as bsp: {} has lines in space, which divide nothing; expected lines in the plane, or an exact model",
        shown(tree.path())
    );
    let mut edges = Vec::new();
    tree.features(&mut (0..tree.len()), &mut |_, feature| {
        let vertex = |at: [i32; 3]| [0, 1].map(|axis| at[axis].wrapping_sub(grid.corner[axis]));
        let pairs = feature.lines.iter().flat_map(|line| line.windows(2));
        edges.extend(pairs.map(|pair| [vertex(pair[0]), vertex(pair[1])]).filter(|[from, to]| from != to));
        Ok(())
    })?;
    let structure = Bsp::of_segments(&edges)?;
    let mut text = String::new();
    if is_stats {
        super::push_bsp_stats(&mut text, &structure)?;
        push_file_stats(&mut text, tree)?;
        return Ok(text);
    }
    let corner = grid.to_world(grid.corner);
    writeln!(
        text,
        "# lines A B C in grid units of {} x {} from {},{}; the front is where A x + B y + C is not negative",
        grid.scale[0], grid.scale[1], corner[0], corner[1]
    )?;
    structure.push_nodes(&mut text);
    Ok(text)
}

/// Appends the sizes of the file's own tree.
fn push_file_stats(text: &mut String, tree: &LineTree) -> Result<()> {
    let (nodes, blocks, _) = tree.counts();
    let levels = tree.levels()?.len();
    writeln!(text, "file        {nodes} nodes in {levels} levels, {blocks} blocks, {} bytes", tree.bytes())?;
    Ok(())
}

/// Returns the structure as text, or its sizes.
pub(super) fn text(tree: &LineTree, rule: PmRule, (limit, is_stats): (u64, bool)) -> Result<String> {
    let grid = tree.grid();
    super::check_count(tree.path(), tree.segments(), "segments", limit)?;
    let mut edges = Vec::new();
    tree.features(&mut (0..tree.len()), &mut |_, feature| {
        let vertex = |at: [i32; 3]| [0, 1, 2].map(|axis| i64::from(at[axis]) - i64::from(grid.corner[axis]));
        let pairs = feature.lines.iter().flat_map(|line| line.windows(2));
        edges.extend(pairs.map(|pair| [vertex(pair[0]), vertex(pair[1])]));
        Ok(())
    })?;
    let structure = EdgeTree::of(rule, (grid.dimension, grid.bits), edges, limit as usize);
    let Some(structure) = structure else {
        bail!("{}: leaves have more than {limit} edges; raise --limit", shown(tree.path()))
    };
    let EdgeTreeCounts { empty, full, divided, stored, depth } = structure.counts();
    let mut text = String::new();
    if is_stats {
        // A node is a symbol of two bits, an edge in a leaf the 32-bit number of a segment.
        let bytes = (2 * (empty + full + divided)).div_ceil(8) + 4 * stored;
        writeln!(text, "leaves      {full} with edges, {empty} without")?;
        writeln!(text, "divided     {divided} nodes")?;
        writeln!(text, "depth       {depth}")?;
        writeln!(text, "edges       {stored} in leaves, {} in the file", tree.segments())?;
        writeln!(text, "bytes       {bytes}, besides the edges' vertices")?;
        push_file_stats(&mut text, tree)?;
        return Ok(text);
    }
    writeln!(text, "{}", structure.to_df_expression())?;
    let world = |at: [i64; 3]| {
        let at = [0, 1, 2].map(|axis| (at[axis] + i64::from(grid.corner[axis])) as i32);
        let numbers = grid.to_world(at);
        coordinates(tree, &numbers).iter().map(f64::to_string).collect::<Vec<_>>().join(",")
    };
    for leaf in structure.leaves() {
        write!(text, "{}\t{}", world(leaf.corner), leaf.side as f64 * grid.scale[0])?;
        for [a, b] in leaf.edges {
            write!(text, "\t{} {}", world(a), world(b))?;
        }
        text.push('\n');
    }
    Ok(text)
}
