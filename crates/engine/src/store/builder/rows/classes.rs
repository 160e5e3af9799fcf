//! Majorities of blocks in rows, from class counts of each level's nodes.
//!
//! For each class in ascending order, its cells are counted in the nodes of all levels, and it
//! becomes the winner of every node where its count exceeds those of all previous classes. So
//! counts are bytes in rows, and the loops have no branches. Nodes where several classes have the
//! maximum are marked. Ties are resolved at the end from the bottom up, since the children's values
//! decide (see [`break_tie`]).

use std::ops::{BitOr, Range};

use smallvec::SmallVec;
use zerocopy::IntoBytes;

use super::{RowBlock, child_rows, neighbours, reduce};
use spinney_base::value::{SampleType, Value, break_tie};

/// Maximum number of cells that are counted in bytes, as a power of two: twice as many must fit
/// into a byte.
const BYTE_BITS: usize = 6;

/// Number of bands of rows (in octrees: of slices) that a block is divided into, as a power of two.
/// A class is counted only in the bands from its first to its last cell: in maps, most classes have
/// a limited extent.
const BAND_BITS: usize = 3;

/// Counts of the nodes of a level. All counts are twice the number of cells.
struct Counts<T> {
    /// The most frequent class so far, and its count; plus 1 if another class has as many cells.
    winners: Vec<u8>,
    best: Vec<T>,
    /// The count of the current class.
    counted: Vec<T>,
}

impl<T: Copy + Default + PartialOrd + BitOr<Output = T> + From<bool> + Into<u32>> Counts<T> {
    fn new(nodes: usize) -> Counts<T> {
        Counts {
            winners: vec![0; nodes],
            best: vec![T::default(); nodes],
            counted: vec![T::default(); nodes],
        }
    }

    /// Makes a class the winner of those nodes where it has more cells than all previous ones.
    #[inline]
    fn take_over(&mut self, class: u8, nodes: Range<usize>) {
        let winners = self.winners[nodes.clone()].iter_mut().zip(&mut self.best[nodes.clone()]);
        for ((winner, best), count) in winners.zip(&self.counted[nodes]) {
            // (A bit mask, since selecting bytes would be compiled to branches.)
            let is_more = u8::from(*count > *best).wrapping_neg();
            // (An odd number is not equal to any count, and stays until a larger count replaces it.
            // Every node has more than 0 cells of some class.)
            let is_tied = T::from(*count == *best);
            *best = (if *count > *best { *count } else { *best }) | is_tied;
            *winner = *winner & !is_more | class & is_more;
        }
    }

    /// Returns the values of the nodes `up` levels above the cells, once all classes are counted;
    /// `below` has the values of their children.
    fn settle(mut self, cells: &Cells<'_>, up: usize, below: &[u8]) -> Vec<u8> {
        /// Number of nodes that are skipped together if none has a tie.
        const SPAN: usize = 16;
        let side = cells.side >> up;
        let is_odd = |best: T| best.into() & 1 == 1;
        for row in 0..self.winners.len() / side {
            let children = child_rows(cells.axes, 2 * side, below, row);
            let nodes = row * side..(row + 1) * side;
            let spans = self.winners[nodes.clone()].chunks_mut(SPAN).zip(self.best[nodes].chunks(SPAN));
            for (span, (winners, best)) in spans.enumerate() {
                if is_odd(best.iter().fold(T::default(), |any, best| any | *best)) {
                    for (x, (winner, best)) in (span * SPAN..).zip(winners.iter_mut().zip(best)) {
                        if is_odd(*best) {
                            let node = [x, row % side, row / side];
                            *winner = cells.winner(node, up, &children, (*best).into() / 2);
                        }
                    }
                }
            }
        }
        self.winners
    }
}

impl Counts<u8> {
    /// [`Counts::settle`] for the nodes directly above the cells of a quadtree. In a tie among four
    /// cells, two classes have two cells each, or all four differ: in both cases the first cell has
    /// one of the tied classes.
    fn settle_fours(mut self, cells: &Cells<'_>) -> Vec<u8> {
        let side = cells.side / 2;
        let nodes = self.winners.chunks_exact_mut(side).zip(self.best.chunks_exact(side));
        for ((winners, best), rows) in nodes.zip(cells.values.chunks_exact(4 * side)) {
            for ((winner, best), pair) in winners.iter_mut().zip(best).zip(neighbours(&rows[..2 * side])) {
                let is_tied = (best & 1).wrapping_neg();
                *winner = *winner & !is_tied | pair as u8 & is_tied;
            }
        }
        self.winners
    }
}

/// The cells of a block, in rows.
struct Cells<'a> {
    axes: usize,
    side: usize,
    values: &'a [u8],
}

/// The value 1 in each byte of a word.
const ONES: u64 = u64::MAX / 255;
/// All bits of a word except the highest one of each byte.
const LOW: u64 = 0x7F * ONES;

/// Returns the number of bytes equal to a class in some words, at most eight.
#[inline]
fn count_in(words: &[u64], class: u8) -> u32 {
    let pattern = ONES * u64::from(class);
    let mut sum = 0;
    for word in words {
        let word = word ^ pattern;
        // 1 in each byte where the word's byte is 0.
        sum += (!(((word & LOW) + LOW) | word) >> 7) & ONES;
    }
    (sum.wrapping_mul(ONES) >> 56) as u32
}

impl Cells<'_> {
    /// Returns the class that wins the tie of a node, `up` levels above the cells, whose most
    /// frequent classes have `most` cells each.
    #[inline]
    fn winner(&self, node: [usize; 3], up: usize, children: &[&[u8]; 4], most: u32) -> u8 {
        let (mut values, rows) = ([0; 8], 1 << (self.axes - 1));
        for (pair, row) in values.as_chunks_mut::<2>().0.iter_mut().zip(&children[..rows]) {
            pair.copy_from_slice(&row[2 * node[0]..][..2]);
        }
        let values = &values[..2 * rows];
        if self.axes * up <= BYTE_BITS {
            let mut words = [0; 8];
            let words = self.words(node, up, &mut words);
            let has_most = |class: &&u8| count_in(words, **class) == most;
            return match values.iter().find(has_most) {
                Some(first) => *first,
                None => hashed(words.as_bytes(), values, most),
            };
        }
        let has_most =
            |class: &&u8| self.rows(node, up).map(|row| count_of(row, **class)).sum::<u32>() == most;
        match values.iter().find(has_most) {
            Some(first) => *first,
            None => hashed(&self.rows(node, up).collect::<Vec<_>>().concat(), values, most),
        }
    }

    /// Returns the cells of a node as words. The node has at least eight cells and at most
    /// 2^[`BYTE_BITS`].
    #[inline]
    fn words<'w>(&self, [x, y, z]: [usize; 3], up: usize, words: &'w mut [u64; 8]) -> &'w [u64] {
        let first = (((z << up) * self.side) + (y << up)) * self.side + (x << up);
        let values = &self.values[first..];
        let row = |slice: usize, row: usize| &values[(slice * self.side + row) * self.side..];
        let two = |row: &[u8]| u64::from(u16::from_le_bytes(*row.first_chunk().expect("two cells")));
        let four = |row: &[u8]| u64::from(u32::from_le_bytes(*row.first_chunk().expect("four cells")));
        let eight = |row: &[u8]| u64::from_le_bytes(*row.first_chunk().expect("eight cells"));
        match (self.axes, up) {
            (2, 2) => {
                words[0] = four(row(0, 0)) | four(row(0, 1)) << 32;
                words[1] = four(row(0, 2)) | four(row(0, 3)) << 32;
                &words[..2]
            }
            (2, _) => {
                words.iter_mut().enumerate().for_each(|(at, word)| *word = eight(row(0, at)));
                words
            }
            (_, 1) => {
                let slice = |slice| two(row(slice, 0)) | two(row(slice, 1)) << 16;
                words[0] = slice(0) | slice(1) << 32;
                &words[..1]
            }
            _ => {
                for (at, word) in words.iter_mut().enumerate() {
                    let (slice, first) = (at / 2, at % 2 * 2);
                    *word = four(row(slice, first)) | four(row(slice, first + 1)) << 32;
                }
                words
            }
        }
    }

    /// Returns the rows of cells of a node.
    fn rows(&self, [x, y, z]: [usize; 3], up: usize) -> impl Iterator<Item = &[u8]> {
        let (side, slices) = (self.side, if self.axes == 2 { 1 } else { 1 << up });
        (0..slices).flat_map(move |slice| {
            let first = (((z << up) + slice) * side + (y << up)) * side + (x << up);
            (0..1 << up).map(move |row| &self.values[first + row * side..][..1 << up])
        })
    }
}

/// Returns the number of cells of a class in a row of at least eight cells.
#[inline]
fn count_of(row: &[u8], class: u8) -> u32 {
    let (chunks, rest) = row.as_chunks::<16>();
    let of = |cells: &[u8]| u32::from(cells.iter().map(|cell| u8::from(*cell == class)).sum::<u8>());
    chunks.iter().map(|chunk| of(chunk)).sum::<u32>() + of(rest)
}

/// Returns the class that wins a tie of classes with `most` cells each, if no child has one of the
/// tied classes.
#[cold]
fn hashed(cells: &[u8], children: &[u8], most: u32) -> u8 {
    let mut counts = [0; 256];
    cells.iter().for_each(|cell| counts[usize::from(*cell)] += 1);
    let tied = (0..=u8::MAX).zip(counts).filter(|(_, count)| *count == most);
    let tied: SmallVec<[Value; 8]> = tied.map(|(class, _)| Value::from([class])).collect();
    break_tie(children.iter().map(|value| Value::from([*value])), &tied, most.into()).to_bytes()[0]
}

/// Sets the values of all nodes of a block to their majorities. Values are single bytes. Returns
/// the number of cells per value.
pub(super) fn majorities(block: &mut RowBlock) -> Vec<(Value, u64)> {
    debug_assert_eq!(block.form.value.sample, SampleType::U8);
    let (axes, height) = (block.form.axes(), block.height);
    let cells = &block.levels[0].values;
    let nodes = |up: usize| cells.len() >> (axes * up);
    let narrow_levels = height.min(BYTE_BITS / axes);
    let mut narrow: Vec<Counts<u8>> = (1..=narrow_levels).map(|up| Counts::new(nodes(up))).collect();
    let mut wide: Vec<Counts<u32>> = (narrow_levels + 1..=height).map(|up| Counts::new(nodes(up))).collect();
    let mut columns = vec![0; block.side(0)];

    let band_bits = BAND_BITS.min(height);
    let bands: Vec<[u32; 256]> = cells.chunks_exact(cells.len() >> band_bits).map(histogram).collect();
    let mut classes = Vec::new();
    for class in 0..=u8::MAX {
        let cells_in = |band: &[u32; 256]| band[usize::from(class)];
        let Some(first) = bands.iter().position(|band| cells_in(band) > 0) else { continue };
        let end = bands.iter().rposition(|band| cells_in(band) > 0).unwrap_or(first) + 1;
        classes.push((Value::from_bytes(&[class]), bands.iter().map(|band| u64::from(cells_in(band))).sum()));
        for up in 1..=height {
            // If a band is smaller than a row, all nodes are processed: there are few.
            let is_banded = up + band_bits <= height;
            let nodes_at = |up: usize| {
                let nodes = nodes(up);
                if is_banded { first * (nodes >> band_bits)..end * (nodes >> band_bits) } else { 0..nodes }
            };
            // Invariant: no counts of the previous class are left where counts are read. In levels
            // with bands, only counts written for this class are read. The last of these levels is
            // zeroed before, because the next level reads all of it. Otherwise nodes next to a
            // class's bands would count cells of another class.
            let clear = up + band_bits == height;
            let (here, below, side) = (nodes_at(up), nodes_at(up - 1), block.side(up - 1));
            if up <= narrow_levels {
                let (lower, level) = narrow.split_at_mut(up - 1);
                let level = &mut level[0];
                if clear {
                    level.counted.fill(0);
                }
                let (counted, columns) = (&mut level.counted[here.clone()], &mut columns[..side]);
                match lower.last() {
                    None => count(axes, &cells[below], counted, columns, |cell| 2 * u8::from(cell == class)),
                    Some(lower) => count(axes, &lower.counted[below], counted, columns, |count| count),
                }
                level.take_over(class, here);
            } else {
                let (lower, level) = wide.split_at_mut(up - narrow_levels - 1);
                let level = &mut level[0];
                if clear {
                    level.counted.fill(0);
                }
                let counted = &mut level.counted[here.clone()];
                match lower.last() {
                    None => {
                        let lower = &narrow[narrow_levels - 1].counted[below];
                        reduce(axes, side, lower, counted, u32::from, |a, b| a + b);
                    }
                    Some(lower) => {
                        reduce(axes, side, &lower.counted[below], counted, |count| count, |a, b| a + b);
                    }
                }
                level.take_over(class, here);
            }
        }
    }
    let cells = Cells { axes, side: block.side(0), values: cells };
    let mut winners: Vec<Vec<u8>> = Vec::with_capacity(height);
    for (up, level) in (1..).zip(narrow) {
        let below = winners.last().map_or(cells.values, |below| below);
        winners.push(match (up, axes) {
            (1, 2) => level.settle_fours(&cells),
            _ => level.settle(&cells, up, below),
        });
    }
    for (up, level) in (narrow_levels + 1..).zip(wide) {
        let below = winners.last().map_or(cells.values, |below| below);
        winners.push(level.settle(&cells, up, below));
    }
    for winners in winners {
        block.push_level();
        block.last_two().1.values = winners;
    }
    classes
}

/// Sums the counts of each node's children, in bytes; there is a column for each child of a row.
#[inline]
fn count(axes: usize, children: &[u8], counts: &mut [u8], columns: &mut [u8], of: impl Fn(u8) -> u8) {
    let side = columns.len();
    for (row, counts) in counts.chunks_exact_mut(side / 2).enumerate() {
        columns.fill(0);
        for children in child_rows(axes, side, children, row) {
            columns.iter_mut().zip(children).for_each(|(column, child)| *column += of(*child));
        }
        // Invariant: no sum exceeds twice 2^BYTE_BITS, the maximum number of a node's cells in
        // levels that are counted in bytes. So no column carries into the next one.
        for (count, columns) in counts.iter_mut().zip(neighbours(columns)) {
            *count = (columns + (columns >> 8)) as u8;
        }
    }
}

/// Returns the number of cells per value.
fn histogram(cells: &[u8]) -> [u32; 256] {
    // Several tables, because a processor that increments the same counter again has to wait for
    // the previous sum.
    let mut tables = [[0; 256]; 4];
    let (fours, rest) = cells.as_chunks::<4>();
    for four in fours {
        for (table, cell) in tables.iter_mut().zip(four) {
            table[usize::from(*cell)] += 1;
        }
    }
    rest.iter().for_each(|cell| tables[0][usize::from(*cell)] += 1);
    std::array::from_fn(|value| tables.iter().map(|table| table[value]).sum())
}
