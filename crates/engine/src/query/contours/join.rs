//! Pieces of lines of neighbouring tiles, joined to whole lines.

use std::collections::{BTreeMap, HashMap};

use super::pieces::{LinePieces, PieceNumber};
use super::tile::{EdgeKey, LinePiece};
use spinney_base::Result;

/// A line that has come to its end, or a part of one.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContourLine {
    /// Number of the level, or of the band.
    pub(super) class: i32,
    /// The first of its pieces, and the last.
    pub(super) first: PieceNumber,
    last: PieceNumber,
    /// Number of its points, as they are handed out.
    pub(super) count: u64,
    pub(super) is_ring: bool,
    /// Where it may go on.
    ends: [Option<EdgeKey>; 2],
}

impl ContourLine {
    /// A ring, by its first piece.
    pub(super) fn ring(class: i32, first: PieceNumber, count: u64) -> ContourLine {
        ContourLine { class, first, last: first, count, is_ring: true, ends: [None; 2] }
    }
}

/// Lines in the making.
#[derive(Default)]
pub(super) struct Joiner {
    lines: HashMap<u64, ContourLine>,
    /// Lines that may go on, by the points where: at their starts, and at their ends.
    waiting: [BTreeMap<EdgeKey, u64>; 2],
    /// Lines so far.
    number: u64,
}

impl Joiner {
    /// Takes a piece, joins it to what it meets, and hands out the line if that is whole.
    ///
    /// # Errors
    /// If the pieces cannot be kept.
    pub(super) fn push(&mut self, piece: LinePiece, pieces: &mut LinePieces) -> Result<Option<ContourLine>> {
        let LinePiece { class, points, ends, is_ring } = piece;
        let count = points.len() as u64;
        let number = pieces.add(points)?;
        let mut line = ContourLine { class, first: number, last: number, count, is_ring, ends };
        // What comes before it ends where it starts.
        if let Some(before) = line.ends[0].and_then(|start| self.take(1, start)) {
            line = joined(before, line, pieces);
        }
        let [start, end] = line.ends;
        if end.is_some() && start == end {
            line.is_ring = true;
            line.ends = [None; 2];
        } else if let Some(after) = end.and_then(|end| self.take(0, end)) {
            line = joined(line, after, pieces);
            let [start, end] = line.ends;
            if end.is_some() && start == end {
                line.is_ring = true;
                line.ends = [None; 2];
            }
        }
        if line.ends == [None; 2] {
            return Ok(Some(line));
        }
        self.number += 1;
        for (waiting, end) in self.waiting.iter_mut().zip(line.ends) {
            if let Some(end) = end {
                waiting.insert(end, self.number);
            }
        }
        self.lines.insert(self.number, line);
        Ok(None)
    }

    /// Takes the line out that starts (0) or ends (1) at a point.
    fn take(&mut self, side: usize, at: EdgeKey) -> Option<ContourLine> {
        let number = self.waiting[side].get(&at)?;
        let line = self.lines.remove(number)?;
        for (waiting, end) in self.waiting.iter_mut().zip(line.ends) {
            if let Some(end) = end {
                waiting.remove(&end);
            }
        }
        Some(line)
    }

    /// Lets lines end that could only have gone on above a row, and hands out those that are whole.
    pub(super) fn settle(&mut self, row: i64) -> Vec<ContourLine> {
        let mut whole = Vec::new();
        for side in 0..2 {
            while let Some(entry) = self.waiting[side].first_entry().filter(|entry| entry.key().row < row) {
                let number = entry.remove();
                if let Some(line) = self.lines.get_mut(&number) {
                    line.ends[side] = None;
                    if line.ends == [None; 2] {
                        whole.extend(self.lines.remove(&number));
                    }
                }
            }
        }
        whole
    }
}

/// A line and what comes after it.
fn joined(before: ContourLine, after: ContourLine, pieces: &mut LinePieces) -> ContourLine {
    pieces.link(before.last, after.first);
    let ends = [before.ends[0], after.ends[1]];
    ContourLine { last: after.last, count: before.count + after.count - 1, ends, ..before }
}
