//! Majorities of blocks in rows, from counts of classes that are carried up.
//!
//! Class after class is counted in the nodes of all levels, in ascending order, and takes a node over where it has more cells
//! than all before: so counts are bytes in rows, whose loops are without branches. Nodes where several classes have most cells
//! are marked on the way, and settled at the end from the bottom up, since the values of their children decide (see [`break_tie`]).

use std::ops::{BitOr, Range};

use smallvec::SmallVec;

use super::{RowBlock, child_rows, neighbours, reduce};
use spinney_base::value::{SampleType, Value, break_tie};

/// Cells that are counted in bytes, as a power of two: twice as many are a byte, too.
const BYTE_BITS: usize = 6;

/// Bands of rows (in octrees: of slices) that a block is cut into, as a power of two. A class is counted in those alone from
/// its first cell to its last: in maps, most classes are at few places.
const BAND_BITS: usize = 3;

/// Knowledge of the nodes of a level. All counts are twice the cells.
struct Counts<T> {
    /// The most frequent class so far, and its count; 1 more if another class has as many cells.
    winners: Vec<u8>,
    best: Vec<T>,
    /// The count of the class that is being counted.
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

    /// Gives a class those of some nodes in which it has more cells than all before.
    #[inline]
    fn take_over(&mut self, class: u8, nodes: Range<usize>) {
        let winners = self.winners[nodes.clone()].iter_mut().zip(&mut self.best[nodes.clone()]);
        for ((winner, best), count) in winners.zip(&self.counted[nodes]) {
            // (A mask of bits, since a choice of bytes would be compiled to branches.)
            let is_more = u8::from(*count > *best).wrapping_neg();
            // (What is odd is no count, and stays odd until more is counted. A node has more than 0 of some class.)
            let is_tied = T::from(*count == *best);
            *best = (if *count > *best { *count } else { *best }) | is_tied;
            *winner = *winner & !is_more | class & is_more;
        }
    }

    /// The values of the nodes, `up` levels above the cells, once all classes are counted; `below` has those of their children.
    fn settle(mut self, cells: &Cells<'_>, up: usize, below: &[u8]) -> Vec<u8> {
        let side = cells.side >> up;
        let odd = |best: T| best.into() & 1 == 1;
        for row in 0..self.winners.len() / side {
            let nodes = row * side..(row + 1) * side;
            // (Few are tied: rows without any are passed over fast.)
            if !odd(self.best[nodes.clone()].iter().fold(T::default(), |any, best| any | *best)) {
                continue;
            }
            let children = child_rows(cells.axes, 2 * side, below, row);
            for (x, node) in nodes.enumerate() {
                let best = self.best[node];
                if odd(best) {
                    self.winners[node] =
                        cells.winner([x, row % side, row / side], up, &children, best.into() / 2);
                }
            }
        }
        self.winners
    }
}

/// The values of the nodes above the cells of a quadtree. Of four cells the most frequent class is that of the first, if another
/// one has it, too, or if all differ; else that of two others, if any are alike.
fn values_of_four(cells: &[u8], side: usize) -> Vec<u8> {
    let mut values = vec![0; cells.len() / 4];
    let mut columns = [(); 4].map(|()| vec![0; side / 2]);
    let alike = |a: u8, b: u8| u8::from(a == b).wrapping_neg();
    for (values, rows) in values.chunks_exact_mut(side / 2).zip(cells.chunks_exact(2 * side)) {
        let (upper, lower) = rows.split_at(side);
        // (Columns first, so that there are instructions for all that follows.)
        let [a, b, c, d] = &mut columns;
        for (first, second, row) in [(&mut *a, &mut *b, upper), (&mut *c, &mut *d, lower)] {
            first.iter_mut().zip(neighbours(row)).for_each(|(first, pair)| *first = pair as u8);
            second.iter_mut().zip(neighbours(row)).for_each(|(second, pair)| *second = (pair >> 8) as u8);
        }
        for ((((value, a), b), c), d) in values.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            let (a, b, c, d) = (*a, *b, *c, *d);
            let is_first = alike(a, b) | alike(a, c) | alike(a, d);
            let is_second = alike(b, c) | alike(b, d);
            let is_third = alike(c, d);
            let others = b & is_second | (c & is_third | a & !is_third) & !is_second;
            *value = a & is_first | others & !is_first;
        }
    }
    values
}

/// The cells of a block, in rows.
struct Cells<'a> {
    axes: usize,
    side: usize,
    values: &'a [u8],
}

impl Cells<'_> {
    /// The class that wins the tie of a node, `up` levels above the cells, whose most frequent classes have so many cells each.
    #[inline]
    fn winner(&self, node: [usize; 3], up: usize, children: &[&[u8]; 4], most: u32) -> u8 {
        let (mut values, rows) = ([0; 8], 1 << (self.axes - 1));
        for (pair, row) in values.as_chunks_mut::<2>().0.iter_mut().zip(&children[..rows]) {
            pair.copy_from_slice(&row[2 * node[0]..][..2]);
        }
        let values = &values[..2 * rows];
        let mut last = None;
        for value in values {
            if last != Some(*value) && self.count(node, up, *value) == most {
                return *value;
            }
            last = Some(*value);
        }
        self.hashed(node, up, values, most)
    }

    /// The same where no child has one of the classes.
    #[cold]
    fn hashed(&self, node: [usize; 3], up: usize, children: &[u8], most: u32) -> u8 {
        let mut has = [0u64; 4];
        for first in self.slices(node, up) {
            for row in 0..1 << up {
                let cells = &self.values[first + row * self.side..][..1 << up];
                cells.iter().for_each(|cell| has[usize::from(cell >> 6)] |= 1 << (cell & 63));
            }
        }
        let is_tied = |class: &u8| {
            has[usize::from(class >> 6)] >> (class & 63) & 1 == 1 && self.count(node, up, *class) == most
        };
        let tied: SmallVec<[Value; 8]> =
            (0..=u8::MAX).filter(is_tied).map(|class| Value::from([class])).collect();
        break_tie(children.iter().map(|value| Value::from([*value])), &tied, most.into()).to_bytes()[0]
    }

    /// How many cells of a node have a class.
    #[inline]
    fn count(&self, node: [usize; 3], up: usize, class: u8) -> u32 {
        const LOW: u64 = u64::MAX / 255;
        let (pattern, other) = (LOW * u64::from(class), LOW * u64::from(!class));
        // Bytes of 1 where those of a word are the class, of 0 where they are not.
        let flags = |word: u64| {
            let word = word ^ pattern;
            !((word & 0x7F * LOW) + 0x7F * LOW | word) >> 7 & LOW
        };
        let mut count = 0;
        for first in self.slices(node, up) {
            let values = &self.values[first..];
            let pair = |row: usize| u64::from(u16::from_le_bytes(*cells_at(values, row * self.side)));
            let four = |row: usize| u64::from(u32::from_le_bytes(*cells_at(values, row * self.side)));
            let eight = |row: usize| u64::from_le_bytes(*cells_at(values, row * self.side));
            let sum = match up {
                1 => flags(pair(0) | pair(1) << 16 | other << 32),
                2 => flags(four(0) | four(1) << 32) + flags(four(2) | four(3) << 32),
                3 => (0..8).map(|row| flags(eight(row))).sum(),
                _ => {
                    for row in 0..1 << up {
                        let (chunks, _) = values[row * self.side..][..1 << up].as_chunks::<16>();
                        for chunk in chunks {
                            let found = chunk.iter().map(|cell| u8::from(*cell == class)).sum::<u8>();
                            count += u32::from(found);
                        }
                    }
                    0
                }
            };
            // (The sum of all bytes, which is no more than 64.)
            count += (sum.wrapping_mul(LOW) >> 56) as u32;
        }
        count
    }

    /// The indices of the first cells of a node, of each slice that it has.
    #[inline]
    fn slices(&self, [x, y, z]: [usize; 3], up: usize) -> impl Iterator<Item = usize> {
        let (side, axes) = (self.side, self.axes);
        let slices = if axes == 2 { 1 } else { 1 << up };
        (0..slices).map(move |slice| (((z << up) + slice) * side + (y << up)) * side + (x << up))
    }
}

/// So many cells from one on.
#[inline]
fn cells_at<const N: usize>(cells: &[u8], at: usize) -> &[u8; N] {
    cells[at..].first_chunk().expect("a node's row has all of its cells")
}

/// Gives all nodes of a block, whose values are single bytes, their majorities; returns the cells of each value.
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
            // Where a band is less than a row, all nodes are looked at: there are few.
            let is_banded = up + band_bits <= height;
            let nodes_at = |up: usize| {
                let nodes = nodes(up);
                if is_banded { first * (nodes >> band_bits)..end * (nodes >> band_bits) } else { 0..nodes }
            };
            // Invariant: of the cells of the class before, nothing is left where counts are read. In levels
            // with bands only those are read that were written for this class; the last of these levels, all
            // of which the next one reads, is zeroed before. Otherwise nodes beside a class' bands would
            // count cells of another one.
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
                // (What four cells have, they say at once.)
                if up > 1 || axes > 2 {
                    level.take_over(class, here);
                }
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
            (1, 2) => values_of_four(cells.values, cells.side),
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

/// Adds up what the children of each node count, in no more than a byte; there is a column for each child of a row.
#[inline]
fn count(axes: usize, children: &[u8], counts: &mut [u8], columns: &mut [u8], of: impl Fn(u8) -> u8) {
    let side = columns.len();
    for (row, counts) in counts.chunks_exact_mut(side / 2).enumerate() {
        columns.fill(0);
        for children in child_rows(axes, side, children, row) {
            columns.iter_mut().zip(children).for_each(|(column, child)| *column += of(*child));
        }
        // Invariant: no sum is more than twice 2^BYTE_BITS, which is what a node has of cells in the levels
        // that are counted in bytes. So nothing is carried from one column to its neighbour.
        for (count, columns) in counts.iter_mut().zip(neighbours(columns)) {
            *count = (columns + (columns >> 8)) as u8;
        }
    }
}

/// The cells of each value.
fn histogram(cells: &[u8]) -> [u32; 256] {
    // Several tables: to count the same value again a processor waits for the last sum.
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
