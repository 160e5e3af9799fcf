//! Selects the tiles that may have lines by the extremes of nodes, without reading their cells.

use super::levels::Levels;
use super::nodes::Tracing;
use super::{Extremes, Relief};
use crate::tree::Child;
use spinney_base::Result;
use spinney_base::io::batch;
use spinney_base::space::{Code, Dimension};

/// Adjacent tiles of a row with the same extremes, up to `end`, exclusive.
#[derive(Clone, Copy)]
struct TileSpan {
    end: u64,
    extremes: Extremes,
}

/// Rows of tiles, from the first on.
pub(super) struct TileRows<'a> {
    relief: &'a dyn Relief,
    levels: &'a Levels,
    tracing: Tracing,
    /// Level whose nodes are tiles.
    level: u8,
    /// Columns and rows of tiles.
    tiles: [u64; 2],
    /// The row above.
    above: Vec<TileSpan>,
}

impl<'a> TileRows<'a> {
    pub(super) fn new(
        relief: &'a dyn Relief,
        levels: &'a Levels,
        tracing: Tracing,
        level: u8,
        tiles: [u64; 2],
    ) -> TileRows<'a> {
        let above = vec![TileSpan { end: tiles[0], extremes: Extremes::NONE }];
        TileRows { relief, levels, tracing, level, tiles, above }
    }

    /// Returns the tiles of the next row that may have lines. A tile also has the squares to the
    /// left of and above its cells.
    ///
    /// # Errors
    /// If the tree is corrupt there.
    pub(super) fn next(&mut self, row: u64) -> Result<Vec<u64>> {
        let runs = self.runs(row)?;
        let is_border_row = row == 0 || row + 1 == self.tiles[1];
        let mut wanted = Vec::new();
        let (mut here, mut above) = (0, 0);
        let mut column = 0;
        while let (Some(run), Some(upper)) = (runs.get(here), self.above.get(above)) {
            if column >= self.tiles[0] {
                break;
            }
            let before = |runs: &[TileSpan], index: usize, start: u64| match index {
                0 => Extremes::NONE,
                _ if start == column => runs[index - 1].extremes,
                _ => runs[index].extremes,
            };
            let start =
                |runs: &[TileSpan], index: usize| index.checked_sub(1).map_or(0, |index| runs[index].end);
            let all = [
                run.extremes,
                upper.extremes,
                before(&runs, here, start(&runs, here)),
                before(&self.above, above, start(&self.above, above)),
            ];
            let all = all.into_iter().fold(Extremes::NONE, Extremes::with);
            let is_border = is_border_row || column == 0 || column + 1 == self.tiles[0];
            if self.has_lines(&all, is_border) {
                wanted.push(column);
                column += 1;
            } else {
                // The following tiles depend on the same extremes. (The last tile is at the
                // border.)
                let end = run.end.min(upper.end);
                column = if column + 1 < end { end.min(self.tiles[0] - 1).max(column + 1) } else { end };
            }
            here += usize::from(column >= run.end);
            above += usize::from(column >= upper.end);
        }
        self.above = runs;
        Ok(wanted)
    }

    /// Returns whether there may be lines if all cells have these extremes.
    fn has_lines(&self, all: &Extremes, is_border: bool) -> bool {
        let crosses = || {
            let is_known = all.min.is_finite() && all.max.is_finite();
            !is_known || self.levels.rank(all.min) != self.levels.rank(all.max)
        };
        all.has_values && (self.tracing.has_borders() && (all.has_void || is_border) || crosses())
    }

    /// Returns the extremes of all tiles of a row.
    fn runs(&self, row: u64) -> Result<Vec<TileSpan>> {
        let mut runs = Vec::new();
        self.visit(Code::root(Dimension::Quad), row, &mut runs)?;
        let unknown: Vec<u64> =
            runs.iter().filter(|(_, extremes)| extremes.is_none()).map(|(column, _)| *column).collect();
        let found = batch::map(&unknown, |column| {
            let code = Code::from_cell(Dimension::Quad, self.level, [*column as u32, row as u32, 0]);
            code.map_or(Ok(Extremes::NONE), |code| self.relief.extremes(code))
        })?;
        let mut found = found.into_iter();
        let mut all: Vec<TileSpan> = Vec::with_capacity(runs.len());
        for (column, extremes) in &runs {
            let extremes = match extremes {
                Some(extremes) => *extremes,
                None => found.next().unwrap_or(Extremes::NONE),
            };
            if let Some(last) = all.last_mut() {
                last.end = *column;
            }
            all.push(TileSpan { end: self.tiles[0], extremes });
        }
        Ok(all)
    }

    /// Adds the tiles of a row below a node: the first column of each run, and its extremes if they
    /// are known.
    fn visit(&self, code: Code, row: u64, runs: &mut Vec<(u64, Option<Extremes>)>) -> Result<()> {
        let below = self.level - code.level();
        let first = u64::from(code.cell()[0]) << below;
        if first >= self.tiles[0] {
            return Ok(());
        }
        if below == 0 {
            runs.push((first, None));
            return Ok(());
        }
        match self.relief.node(code)? {
            Child::Inner { .. } => {
                let lower = (row >> (below - 1) & 1) as usize;
                self.visit(code.child(2 * lower), row, runs)?;
                self.visit(code.child(2 * lower + 1), row, runs)
            }
            _ => {
                // (The node is uniform but may extend beyond the raster.)
                runs.push((first, Some(self.relief.extremes(code)?)));
                Ok(())
            }
        }
    }
}
