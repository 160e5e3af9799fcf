//! Rows of cells as runs of one class, from uniform nodes of the tree and from windows of the
//! others.

use super::ClassGrid;
use crate::tree::Child;
use spinney_base::Result;
use spinney_base::io::batch;
use spinney_base::space::{Bounds, Code, Dimension};

/// A class: its value's bytes as a number. VOID sorts before all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Class {
    pub(super) is_valid: bool,
    pub(super) bits: u64,
}

impl Class {
    pub(super) const VOID: Class = Class { is_valid: false, bits: 0 };
}

/// A run: adjacent cells of a class up to the column `end`, exclusive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ClassSpan {
    bits: u64,
    pub(super) end: u32,
    is_valid: bool,
}

impl ClassSpan {
    pub(super) fn new(class: Class, end: u32) -> ClassSpan {
        ClassSpan { bits: class.bits, end, is_valid: class.is_valid }
    }

    pub(super) fn class(&self) -> Class {
        Class { is_valid: self.is_valid, bits: self.bits }
    }
}

/// Appends a run to a row, and merges it with the last one if the classes are equal.
fn push(row: &mut Vec<ClassSpan>, class: Class, end: u32) {
    match row.last_mut() {
        Some(last) if last.class() == class => last.end = end,
        _ => row.push(ClassSpan::new(class, end)),
    }
}

/// Base-2 logarithm of a tile's columns and of its maximum rows.
pub(super) const TILE_LEVELS: u8 = 8;

/// Cells of a strip's rows up to the column `end`, exclusive.
struct Tile {
    end: u32,
    cells: TileCells,
}

enum TileCells {
    Same(Class),
    Rows {
        runs: Vec<ClassSpan>,
        /// Range of each row in `runs`. Rows equal to the one above share its range.
        starts: Vec<(u32, u32)>,
    },
}

/// A strip: consecutive rows that are read together, as a sequence of tiles from left to right.
pub(super) struct Strip {
    tiles: Vec<Tile>,
    pub(super) rows: u32,
}

impl Strip {
    /// Returns whether a row equals the one above it in the strip.
    pub(super) fn is_repeated(&self, row: u32) -> bool {
        row > 0
            && self.tiles.iter().all(|tile| match &tile.cells {
                TileCells::Same(_) => true,
                TileCells::Rows { starts, .. } => starts[row as usize] == starts[row as usize - 1],
            })
    }

    /// Returns the runs of a row.
    pub(super) fn row(&self, row: u32, runs: &mut Vec<ClassSpan>) {
        runs.clear();
        for tile in &self.tiles {
            match &tile.cells {
                TileCells::Same(class) => push(runs, *class, tile.end),
                TileCells::Rows { runs: all, starts } => {
                    let (first, end) = starts[row as usize];
                    for run in &all[first as usize..end as usize] {
                        push(runs, run.class(), run.end);
                    }
                }
            }
        }
    }
}

/// Maximum memory of a cell in a strip in bytes, if no two neighbours are equal.
const CELL_BYTES: u64 = size_of::<ClassSpan>() as u64 + 8;

/// Returns the number of rows to read at a time.
pub(super) fn strip_rows(columns: u64, memory: u64) -> u32 {
    let rows = memory / columns.saturating_mul(CELL_BYTES).max(1);
    let max_rows = 1u64 << TILE_LEVELS;
    // (A power of two, so that strips do not cross tile borders.)
    1 << rows.clamp(1, max_rows).ilog2()
}

/// Reads `rows` rows from `first` on, which must not cross a tile border.
pub(super) fn read_strip(grid: &ClassGrid<'_>, first: u32, rows: u32) -> Result<Strip> {
    let level = grid.level.saturating_sub(TILE_LEVELS);
    let row = u64::from(first) >> (grid.level - level);
    let nodes = batch::run_batched(|| {
        let (mut nodes, mut is_unread) = (Vec::new(), false);
        visit(grid, level, Code::root(Dimension::Quad), row, &mut nodes, &mut is_unread)?;
        batch::finish_deferred(is_unread).map(|()| nodes)
    })?;
    let width = 1u64 << (grid.level - level);
    let columns = grid.size[0];
    let all: Vec<(u64, u64, Option<Class>)> = nodes
        .iter()
        .enumerate()
        .map(|(index, (column, class))| {
            let end = nodes.get(index + 1).map_or(columns, |(next, _)| (next * width).min(columns));
            (column * width, end, *class)
        })
        .collect();
    let tiles = batch::map(&all, |(start, end, class)| {
        let cells = match class {
            Some(class) => TileCells::Same(*class),
            None => {
                let min = [*start, u64::from(first), 0];
                read_tile(grid, &Bounds { min, max: [*end, u64::from(first + rows), 1] })?
            }
        };
        Ok(Tile { end: *end as u32, cells })
    })?;
    Ok(Strip { tiles, rows })
}

/// Adds the tiles of a row below a node: the first column of each, and its class if it is uniform.
/// Nodes whose bytes are missing are [deferred](batch::defer_missing).
fn visit(
    grid: &ClassGrid<'_>,
    level: u8,
    code: Code,
    row: u64,
    tiles: &mut Vec<(u64, Option<Class>)>,
    is_unread: &mut bool,
) -> Result<()> {
    let below = level - code.level();
    let first = u64::from(code.cell()[0]) << below;
    if first << (grid.level - level) >= grid.size[0] {
        return Ok(());
    }
    let Some(node) = batch::defer_missing(grid.cells.node(code), is_unread)? else { return Ok(()) };
    match node {
        Child::Inner { .. } if below > 0 => {
            let lower = (row >> (below - 1) & 1) as usize;
            visit(grid, level, code.child(2 * lower), row, tiles, is_unread)?;
            visit(grid, level, code.child(2 * lower + 1), row, tiles, is_unread)?;
        }
        Child::Inner { .. } => tiles.push((first, None)),
        uniform => {
            let class = uniform.value().map_or(Class::VOID, |value| {
                grid.class(Class { is_valid: true, bits: ClassGrid::bits(value) })
            });
            tiles.push((first, Some(class)));
        }
    }
    Ok(())
}

/// Reads the cells of a tile.
fn read_tile(grid: &ClassGrid<'_>, bounds: &Bounds) -> Result<TileCells> {
    let (bytes, valid) = grid.cells.window(bounds)?;
    Ok(match grid.width {
        1 => scan::<1>(grid, &bytes, &valid, bounds),
        2 => scan::<2>(grid, &bytes, &valid, bounds),
        4 => scan::<4>(grid, &bytes, &valid, bounds),
        _ => scan::<8>(grid, &bytes, &valid, bounds),
    })
}

/// Converts rows of cells with values of `WIDTH` bytes to runs.
fn scan<const WIDTH: usize>(
    grid: &ClassGrid<'_>,
    bytes: &[u8],
    valid: &[bool],
    bounds: &Bounds,
) -> TileCells {
    let columns = bounds.size()[0] as usize;
    let first = bounds.min[0] as u32;
    let values = bytes.as_chunks::<WIDTH>().0;
    let mut runs: Vec<ClassSpan> = Vec::new();
    let mut starts: Vec<(u32, u32)> = Vec::new();
    let mut above: Option<(&[[u8; WIDTH]], &[bool])> = None;
    for row in values.chunks_exact(columns).zip(valid.chunks_exact(columns)) {
        if let Some(last) = starts.last().copied()
            && above == Some(row)
        {
            starts.push(last);
            continue;
        }
        above = Some(row);
        let start = runs.len();
        let (values, valid) = row;
        let mut column = 0;
        while column < columns {
            let (value, is_valid) = (values[column], valid[column]);
            let mut end = column + 1;
            if is_valid {
                while end < columns && values[end] == value && valid[end] {
                    end += 1;
                }
            } else {
                while end < columns && !valid[end] {
                    end += 1;
                }
            }
            let class = if is_valid {
                let mut bits = [0; 8];
                bits[..WIDTH].copy_from_slice(&value);
                grid.class(Class { is_valid: true, bits: u64::from_le_bytes(bits) })
            } else {
                Class::VOID
            };
            // (Classes that are not distinguished merge to one run.)
            match runs[start..].last_mut() {
                Some(last) if last.class() == class => last.end = first + end as u32,
                _ => runs.push(ClassSpan::new(class, first + end as u32)),
            }
            column = end;
        }
        starts.push((start as u32, runs.len() as u32));
    }
    TileCells::Rows { runs, starts }
}
