//! Patterns of blocks that were read: the component of each cell, in a few bytes per run of cells.

use std::ops::Range;

use super::local::Local;

/// Components of a block's cells.
pub(super) struct Pattern {
    side: u32,
    /// Bytes of a component's number.
    width: u8,
    /// Runs of cells in rows; the last one of a row ends at the block's edge. Each is the index of
    /// its last cell, and the number of its component from 1 on; 0 is VOID.
    spans: Box<[u8]>,
    /// Whether components have cells at the block's border.
    at_border: Box<[bool]>,
}

impl Pattern {
    /// Pattern of a block, which has at most 256 cells along an edge.
    pub(super) fn new(local: &Local) -> Pattern {
        let count = local.components.len();
        let width = if count < 1 << 8 { 1 } else { if count < 1 << 16 { 2 } else { 4 } };
        let side = local.side();
        let mut spans = Vec::new();
        let mut span = |end: u32, number: u32| {
            spans.push((end - 1) as u8);
            spans.extend_from_slice(&number.to_le_bytes()[..usize::from(width)]);
        };
        // Current row, and the start of its next run.
        let (mut at, mut start) = (0, 0);
        local.each_run(|row, cells, component| {
            while at < row {
                if start < side {
                    span(side, 0);
                }
                (at, start) = (at + 1, 0);
            }
            if cells.start > start {
                span(cells.start, 0);
            }
            span(cells.end, component + 1);
            start = cells.end;
        });
        // (Rows after the last run are VOID.)
        let at_border = local.components.iter().map(|component| component.is_at_border).collect();
        Pattern { side, width, spans: spans.into(), at_border }
    }

    pub(super) fn at_border(&self) -> &[bool] {
        &self.at_border
    }

    /// Approximate memory use in bytes.
    fn bytes(&self) -> u64 {
        (size_of::<Option<Pattern>>() + self.spans.len() + self.at_border.len()) as u64
    }

    /// Calls `each` for runs of cells with their components: the range of cell indices.
    #[inline]
    pub(super) fn each_run(&self, each: impl FnMut(Range<usize>, usize)) {
        match self.width {
            1 => self.each_of::<1>(each),
            2 => self.each_of::<2>(each),
            _ => self.each_of::<4>(each),
        }
    }

    #[inline]
    fn each_of<const WIDTH: usize>(&self, mut each: impl FnMut(Range<usize>, usize)) {
        let (mut row, mut start) = (0, 0);
        for span in self.spans.chunks_exact(1 + WIDTH) {
            let end = usize::from(span[0]) + 1;
            let mut number = [0; 4];
            number[..WIDTH].copy_from_slice(&span[1..]);
            let number = u32::from_le_bytes(number) as usize;
            if number > 0 {
                each(row + start..row + end, number - 1);
            }
            start = end;
            if end == self.side as usize {
                (row, start) = (row + end, 0);
            }
        }
    }
}

/// Patterns of blocks by block index, within a memory limit.
pub(super) struct Patterns {
    patterns: Vec<Option<Pattern>>,
    /// Remaining bytes.
    available: u64,
}

impl Patterns {
    /// No patterns yet, and a limit in bytes.
    pub(super) fn new(available: u64) -> Patterns {
        Patterns { patterns: Vec::new(), available }
    }

    /// Keeps the pattern of a block if there is enough memory. Indices must be ascending.
    pub(super) fn keep(&mut self, number: usize, local: &Local) {
        if self.available == 0 {
            return;
        }
        let pattern = Pattern::new(local);
        // (Once a pattern did not fit, later ones are not computed.)
        self.available = self.available.saturating_sub(pattern.bytes());
        if self.available > 0 {
            self.patterns.resize_with(number, || None);
            self.patterns.push(Some(pattern));
        }
    }

    /// Pattern of a block, if it was kept.
    pub(super) fn get(&self, number: usize) -> Option<&Pattern> {
        self.patterns.get(number)?.as_ref()
    }
}
