//! Lines that cross others.

use super::block_index::BlockIndex;
use super::select::check_numbers;
use crate::geometry::{FRACTION, Place, box_of, ends, fixed_box, meet, meeting, meets_box};
use crate::store::LineTree;
use spinney_base::{Error, Progress, Result, parallel, sort};

/// A piece of a line that crosses a piece of another one, or touches it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineCrossing {
    /// Number of its feature.
    pub feature: u64,
    /// The place of its first vertex among all of its feature.
    pub vertex: u32,
    /// Which of the other lines it meets.
    pub line: usize,
    /// Which piece of that one.
    pub piece: usize,
    /// Where, in the world; of pieces that lie on each other one such place.
    pub place: [f64; 2],
}

/// A piece of the tree, a piece of other lines, and where they meet.
struct Meeting {
    feature: u64,
    vertex: u32,
    piece: u32,
    place: [f64; 2],
}

impl LineTree {
    /// All pieces of lines that cross or touch other lines: by these and their pieces, then by feature and vertex. The vertices of the others are taken to the nearest
    /// 2^-16 of a step of the grid; what meets what is exact from there on. A line of a single vertex meets nothing.
    ///
    /// # Errors
    /// If a coordinate is no number, there are 2^32 pieces or more of other lines, the file is damaged or cannot be read.
    pub fn crossings(&self, lines: &[Vec<[f64; 2]>], progress: &dyn Progress) -> Result<Vec<LineCrossing>> {
        let grid = self.grid();
        let mut pieces: Vec<[Place; 2]> = Vec::new();
        // The number of each line's first piece.
        let mut firsts: Vec<u32> = Vec::with_capacity(lines.len());
        for line in lines {
            check_numbers("line", line)?;
            firsts.push(pieces.len() as u32);
            pieces.extend(line.windows(2).map(|pair| [grid.fixed(pair[0]), grid.fixed(pair[1])]));
        }
        if pieces.len() > u32::MAX as usize {
            let expected = "fewer than 2^32: ask for some at a time";
            return Err(Error::invalid("lines", format!("{} pieces", pieces.len()), expected));
        }
        let chosen = self.blocks_near(&pieces, progress)?;
        let mut found = Vec::new();
        for batch in chosen.chunks(4 * parallel::threads()) {
            progress.check()?;
            for met in parallel::map(batch, |(block, wanted)| self.meetings(*block, wanted, &pieces)) {
                found.extend(met?);
            }
            progress.advance(batch.len() as u64, chosen.len() as u64);
        }
        sort::by_wide_key(&mut found, |met| {
            u128::from(met.piece) << 96 | u128::from(met.feature) << 32 | u128::from(met.vertex)
        });
        let crossing = |met: Meeting| {
            let line = firsts.partition_point(|first| *first <= met.piece) - 1;
            let Meeting { feature, vertex, place, .. } = met;
            LineCrossing { feature, vertex, line, piece: (met.piece - firsts[line]) as usize, place }
        };
        Ok(found.into_iter().map(crossing).collect())
    }

    /// Blocks whose bounds pieces meet, each with the numbers of these.
    fn blocks_near(&self, pieces: &[[Place; 2]], progress: &dyn Progress) -> Result<Vec<(usize, Vec<u32>)>> {
        let mut chosen = Vec::new();
        let all: Vec<u32> = (0..pieces.len() as u32).collect();
        let mut open: Vec<_> = self.root()?.map(|root| (root, all)).into_iter().collect();
        while let Some((node, wanted)) = open.pop() {
            progress.check()?;
            let within = |bounds| -> Vec<u32> {
                let bounds = fixed_box(bounds);
                wanted.iter().copied().filter(|piece| meets_box(pieces[*piece as usize], bounds)).collect()
            };
            for block in self.blocks_of(node.code) {
                let own = within(self.block_entry(block).bounds);
                if !own.is_empty() {
                    chosen.push((block, own));
                }
            }
            for child in self.children(&node)? {
                let own = within(child.bounds);
                if !own.is_empty() {
                    open.push((child, own));
                }
            }
        }
        Ok(chosen)
    }

    /// Where the pieces of a block meet those that are wanted.
    fn meetings(&self, block: usize, wanted: &[u32], pieces: &[[Place; 2]]) -> Result<Vec<Meeting>> {
        let index = BlockIndex::new(self.grid(), self.block(block)?);
        let mut found = Vec::new();
        for number in wanted {
            let line = pieces[*number as usize];
            index.each_in(box_of(line), &mut |piece| {
                let own = ends(piece.ends);
                if meet(own, line) {
                    let at = meeting(line, own);
                    let place = self.grid().world(at.map(|number| number / FRACTION as f64));
                    found.push(Meeting {
                        feature: piece.feature,
                        vertex: piece.place,
                        piece: *number,
                        place,
                    });
                }
            });
        }
        Ok(found)
    }
}
