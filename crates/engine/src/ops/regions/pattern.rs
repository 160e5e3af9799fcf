//! What is kept of blocks that were looked at: which component each cell belongs to, in a few bytes for each run of cells.

use std::ops::Range;

use super::local::Local;

/// The components of a block's cells.
pub(super) struct Pattern {
    side: u32,
    /// Bytes of a component's number.
    width: u8,
    /// Rows of pieces that end where the block does: the last cell of each, and the number of its component from 1 on; 0 is VOID.
    pieces: Box<[u8]>,
    /// Whether components have cells at the block's border.
    at_border: Box<[bool]>,
}

impl Pattern {
    /// That of a block, which has 256 cells along an edge at most.
    pub(super) fn new(local: &Local) -> Pattern {
        let count = local.components.len();
        let width = if count < 1 << 8 { 1 } else { if count < 1 << 16 { 2 } else { 4 } };
        let side = local.side();
        let mut pieces = Vec::new();
        let mut piece = |end: u32, number: u32| {
            pieces.push((end - 1) as u8);
            pieces.extend_from_slice(&number.to_le_bytes()[..usize::from(width)]);
        };
        // The row at hand, and where the next piece of it begins.
        let (mut at, mut start) = (0, 0);
        local.each_run(|row, cells, component| {
            while at < row {
                if start < side {
                    piece(side, 0);
                }
                (at, start) = (at + 1, 0);
            }
            if cells.start > start {
                piece(cells.start, 0);
            }
            piece(cells.end, component + 1);
            start = cells.end;
        });
        // (Rows behind the last piece are VOID.)
        let at_border = local.components.iter().map(|component| component.is_at_border).collect();
        Pattern { side, width, pieces: pieces.into(), at_border }
    }

    pub(super) fn at_border(&self) -> &[bool] {
        &self.at_border
    }

    /// About the bytes of memory that it takes.
    fn bytes(&self) -> u64 {
        (size_of::<Option<Pattern>>() + self.pieces.len() + self.at_border.len()) as u64
    }

    /// Hands out runs of cells with their components: the place of the first cell in rows, and the end.
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
        for piece in self.pieces.chunks_exact(1 + WIDTH) {
            let end = usize::from(piece[0]) + 1;
            let mut number = [0; 4];
            number[..WIDTH].copy_from_slice(&piece[1..]);
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

/// Patterns of blocks by the blocks' numbers, as far as there is room for them.
pub(super) struct Patterns {
    patterns: Vec<Option<Pattern>>,
    /// Bytes that are left.
    room: u64,
}

impl Patterns {
    /// No pattern yet, and room for so many bytes.
    pub(super) fn new(room: u64) -> Patterns {
        Patterns { patterns: Vec::new(), room }
    }

    /// Keeps the pattern of the block with a number, which is greater than those before, if there is room.
    pub(super) fn keep(&mut self, number: usize, local: &Local) {
        if self.room == 0 {
            return;
        }
        let pattern = Pattern::new(local);
        // (Once one has found no room, none behind it is looked at.)
        self.room = self.room.saturating_sub(pattern.bytes());
        if self.room > 0 {
            self.patterns.resize_with(number, || None);
            self.patterns.push(Some(pattern));
        }
    }

    /// The pattern of a block, if it was kept.
    pub(super) fn get(&self, number: usize) -> Option<&Pattern> {
        self.patterns.get(number)?.as_ref()
    }
}
