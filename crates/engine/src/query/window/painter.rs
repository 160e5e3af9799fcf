//! Draws runs of records. Windows of both formats spend most of their time here.
//!
//! Nearly all of that goes into nodes near the cells that are entirely in the window. That code is
//! compiled for each value width and fan-out, and avoids branches that depend on the data.

use zerocopy::FromBytes;

use crate::store::records::Record;
use crate::store::records::dense::{DenseBlock, DenseRows, dense_block};
use crate::store::records::record::LOW_STATE_BITS;
use spinney_base::array;
use spinney_base::space::Bounds;
use spinney_base::value::Value;
use spinney_container::{CUT, INNER, VOID};

/// Contradiction in a run.
#[derive(Clone, Copy, Debug)]
pub(super) enum InvalidRecords {
    /// At the record with this number.
    Skip(usize),
    /// A node is CUT above the cells to draw.
    Cut,
}

/// Result of drawing.
pub(super) type Drawn = Result<(), InvalidRecords>;

/// Cells of a node, or of its lower or upper half, that are in a window, along one axis.
#[derive(Clone, Copy, Default)]
pub(super) struct AxisSpan {
    /// Contribution of the first of them to the index of a cell's value; undefined if there are
    /// none.
    pub(super) offset: usize,
    pub(super) cells: usize,
}

/// A box of cells to draw on, with values of a known width.
pub(super) struct Painter<'a, R: Record> {
    /// The whole box, which may extend beyond the tree's space.
    pub(super) bounds: Bounds,
    /// Increment of a value's index per cell along each axis.
    strides: [usize; 3],
    /// The value for VOID cells.
    fill: R::Bytes,
    values: &'a mut [R::Bytes],
    valid: Option<&'a mut [bool]>,
}

/// Returns the bytes of a value.
#[inline]
pub(super) fn bytes_of<R: Record>(value: Value) -> R::Bytes {
    R::Bytes::read_from_prefix(&value.to_bytes()).map_or(R::ZERO, |(bytes, _)| bytes)
}

impl<'a, R: Record> Painter<'a, R> {
    /// Creates a painter that has drawn nothing yet. `values` has the bytes of a value, and `valid`
    /// a flag, for each cell.
    pub(super) fn new(
        bounds: Bounds,
        fill: Value,
        values: &'a mut [u8],
        valid: Option<&'a mut [bool]>,
    ) -> Painter<'a, R> {
        let [width, height, _] = array::map(bounds.size(), |size| size as usize);
        let values = <[R::Bytes]>::mut_from_bytes(values).expect("whole values, as the caller checked");
        let strides = [1, width, width * height];
        Painter { bounds, strides, fill: bytes_of::<R>(fill), values, valid }
    }

    /// Makes all cells VOID.
    pub(super) fn clear(&mut self) {
        self.values.fill(self.fill);
        if let Some(valid) = &mut self.valid {
            valid.fill(false);
        }
    }

    /// Clips `side` cells from `start` along an axis to the window.
    #[inline]
    pub(super) fn span(&self, axis: usize, start: u64, side: u64) -> AxisSpan {
        let (min, max) = (self.bounds.min[axis], self.bounds.max[axis]);
        let (first, end) = (start.max(min).min(max), (start + side).min(max));
        let offset = (first - min) as usize * self.strides[axis];
        AxisSpan { offset, cells: end.saturating_sub(first) as usize }
    }

    /// Clips both halves of a node along each axis to the window; a half has `2^below` cells. A
    /// child is one half of the node along each axis, so this clips all children at once.
    #[inline]
    pub(super) fn halves(&self, min: [u64; 3], below: u8) -> [[AxisSpan; 2]; 3] {
        let mut halves = [[AxisSpan { offset: 0, cells: 1 }; 2]; 3];
        for (axis, halves) in halves[..R::AXES].iter_mut().enumerate() {
            let side = 1 << below;
            *halves = [self.span(axis, min[axis], side), self.span(axis, min[axis] + side, side)];
        }
        halves
    }

    /// Draws the node whose record is `at` and which has `2 << below` cells along each axis; the
    /// first cell is `min`. No node may be CUT above the cells.
    pub(super) fn run(&mut self, records: &[R], at: usize, below: u8, min: [u64; 3]) -> Drawn {
        // Invariant: the extent of `at` is within the records: it was checked when the segment was
        // loaded or when its parent was drawn. Extents of children, including those outside of the
        // window, are checked here to be contiguous within it. So no index leads out of the
        // records, and every record is drawn once.
        let record = &records[at];
        let bounds = &self.bounds;
        let inside = (0..R::AXES)
            .all(|axis| bounds.min[axis] <= min[axis] && min[axis] + (2 << below) <= bounds.max[axis]);
        if inside {
            return self.whole(records, at, below, self.index_of(min));
        }
        if record.is_dense() && below > 0 {
            return self.dense(records, at, below, min);
        }
        let halves = self.halves(min, below);
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        for child in 0..R::CHILDREN {
            let state = record.state(child);
            let under = next;
            if state == INNER && below > 0 {
                // Children outside of the window are skipped, but their skips are checked as well.
                let skip = if next < end { records[next].skip() as usize } else { 0 };
                if skip == 0 || next + skip > end {
                    return Err(InvalidRecords::Skip(at));
                }
                next += skip;
            }
            let spans: [AxisSpan; 3] = array::from_fn(|axis| halves[axis][child >> axis & 1]);
            let size = array::map(spans, |span| span.cells);
            if size.contains(&0) {
                continue;
            }
            let start = spans[0].offset + spans[1].offset + spans[2].offset;
            match state {
                VOID => self.fill(start, size, None),
                INNER if below > 0 => {
                    let min = array::from_fn(|axis| min[axis] + ((child as u64 >> axis & 1) << below));
                    self.run(records, under, below - 1, min)?;
                }
                CUT if below > 0 => return Err(InvalidRecords::Cut),
                _ => self.fill(start, size, Some(record.values()[child])),
            }
        }
        Ok(())
    }

    /// Draws a node that is entirely in the window and needs no other segment: the hot path of
    /// tiles. `start` is the index of its first cell. Its children have `2^below` cells along each
    /// axis.
    fn whole(&mut self, records: &[R], at: usize, below: u8, start: usize) -> Drawn {
        let record = &records[at];
        match below {
            0 => {
                self.cells(record.values(), record.states(), start);
                return Ok(());
            }
            1 if !record.is_dense() => return self.patch(records, at, start),
            _ if record.is_dense() => return self.whole_dense(records, at, below, start),
            _ => {}
        }
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        for child in 0..R::CHILDREN {
            let start = start + self.offset(child, 1 << below);
            match record.state(child) {
                INNER => {
                    let skip =
                        records.get(next).filter(|_| next < end).map_or(0, |record| record.skip() as usize);
                    if skip == 0 || next + skip > end {
                        return Err(InvalidRecords::Skip(at));
                    }
                    self.whole(records, next, below - 1, start)?;
                    next += skip;
                }
                CUT => return Err(InvalidRecords::Cut),
                state => {
                    let value = (state != VOID).then(|| record.values()[child]);
                    let side = 1 << below;
                    self.fill(start, [side, side, if R::AXES > 2 { side } else { 1 }], value);
                }
            }
        }
        Ok(())
    }

    /// Returns the dense block at a record if it contains the window's cells, which are `below + 1`
    /// levels below its root.
    fn dense_rows<'s>(
        records: &'s [R],
        at: usize,
        below: u8,
    ) -> std::result::Result<DenseBlock<'s>, InvalidRecords> {
        let block = dense_block(records, at);
        block.filter(|block| block.levels > below).ok_or(InvalidRecords::Skip(at))
    }

    /// Draws a dense block that is entirely in the window by copying its rows: the common case for
    /// continuous data. `start` is the index of its first cell.
    fn whole_dense(&mut self, records: &[R], at: usize, below: u8, start: usize) -> Drawn {
        let block = Self::dense_rows(records, at, below)?;
        let strides = self.strides;
        if !block.is_full() || self.valid.is_some() {
            let side = 2 << below;
            let size = [side, side, if R::AXES > 2 { side } else { 1 }];
            self.dense_and_void(&block, below + 1, ([0; 3], size), start);
            return Ok(());
        }
        // Copying rows of a constant length takes no function call.
        let rows = block.values_of::<R>(below + 1);
        match below {
            1 => copy_rows::<_, 4>(self.values, start, R::AXES, strides, rows),
            2 => copy_rows::<_, 8>(self.values, start, R::AXES, strides, rows),
            3 => copy_rows::<_, 16>(self.values, start, R::AXES, strides, rows),
            4 => copy_rows::<_, 32>(self.values, start, R::AXES, strides, rows),
            _ => {
                let side = 2 << below;
                let size = [side, side, if R::AXES > 2 { side } else { 1 }];
                let mut from = rows.chunks_exact(side);
                self::rows(self.values, start, size, strides, |row| {
                    from.next().into_iter().for_each(|from| row.copy_from_slice(from));
                });
            }
        }
        Ok(())
    }

    /// Draws the cells of a dense block that are in the window. `min` is the block's first cell.
    fn dense(&mut self, records: &[R], at: usize, below: u8, min: [u64; 3]) -> Drawn {
        let block = Self::dense_rows(records, at, below)?;
        let level = below + 1;
        let spans: [AxisSpan; 3] = array::from_fn(|axis| {
            let side = if axis < R::AXES { 1 << level } else { 1 };
            self.span(axis, min[axis], side)
        });
        let size = array::map(spans, |span| span.cells);
        if size.contains(&0) {
            return Ok(());
        }
        let start = spans[0].offset + spans[1].offset + spans[2].offset;
        let bounds = &self.bounds;
        let first = array::from_fn(|axis| bounds.min[axis].saturating_sub(min[axis]) as usize);
        if !block.is_full() || self.valid.is_some() {
            self.dense_and_void(&block, level, (first, size), start);
            return Ok(());
        }
        let (rows, strides) = (block.values_of::<R>(level), self.strides);
        for z in 0..size[2] {
            for y in 0..size[1] {
                let from = block.index(level, [first[0], first[1] + y, first[2] + z]);
                let to = start + z * strides[2] + y * strides[1];
                self.values[to..to + size[0]].copy_from_slice(&rows[from..from + size[0]]);
            }
        }
        Ok(())
    }

    /// Draws a part of a dense block's level, given by its first node and size along each axis, if
    /// some nodes may be VOID or flags are requested.
    #[inline(never)]
    fn dense_and_void(
        &mut self,
        block: &DenseBlock<'_>,
        level: u8,
        (first, size): ([usize; 3], [usize; 3]),
        start: usize,
    ) {
        let (rows, strides) = (block.values_of::<R>(level), self.strides);
        for z in 0..size[2] {
            for y in 0..size[1] {
                let from = block.index(level, [first[0], first[1] + y, first[2] + z]);
                let to = start + z * strides[2] + y * strides[1];
                let row = &rows[from..from + size[0]];
                if block.is_full() {
                    self.values[to..to + size[0]].copy_from_slice(row);
                    if let Some(valid) = &mut self.valid {
                        valid[to..to + size[0]].fill(true);
                    }
                    continue;
                }
                for (x, value) in row.iter().enumerate() {
                    // Invariant: the builder stores zeros as the values of VOID nodes in a dense
                    // block. A nonzero value therefore needs no look-up of its state, which takes
                    // longer than drawing it.
                    let is_there = *value != R::ZERO || !block.is_void(level, from + x);
                    self.values[to + x] = if is_there { *value } else { self.fill };
                    if let Some(valid) = &mut self.valid {
                        valid[to + x] = is_there;
                    }
                }
            }
        }
    }

    /// Draws a node of four cells along each axis, which are nearly all records of a detailed tile.
    /// Which children are uniform is practically random, so nothing here branches on it: a
    /// misprediction costs more than four cells.
    fn patch(&mut self, records: &[R], at: usize, start: usize) -> Drawn {
        let record = &records[at];
        let states = record.states();
        let under = records.get(at + 1..at + record.skip() as usize).unwrap_or(&[]);
        let mut next = 0;
        for child in 0..R::CHILDREN {
            let state = record.state(child);
            // If there is none, any record will do: its values are not used.
            let below = under.get(next).unwrap_or(record);
            // A uniform child is drawn as if it had a record with its value and state four (or
            // eight) times.
            let uniform = R::alike(record.values()[child]);
            let (values, states, skip) = if state == INNER {
                (below.values(), below.states(), below.skip())
            } else {
                (uniform.as_ref(), u32::from(state) * LOW_STATE_BITS, 0)
            };
            self.cells(values, states, start + self.offset(child, 2));
            next += skip as usize;
        }
        // Invariant: every read above is bounds-checked, whatever the records contain, and an error
        // discards what was drawn. So corruption is tested once at the end, and the loop does not
        // branch on it. (CUT has both bits of a state set.)
        if states & states >> 1 & LOW_STATE_BITS != 0 {
            return Err(InvalidRecords::Cut);
        }
        if next == under.len() { Ok(()) } else { Err(InvalidRecords::Skip(at)) }
    }

    /// Draws the children of a node as single cells, in pairs along x.
    #[inline(always)]
    fn cells(&mut self, values: &[R::Bytes], states: u32, start: usize) {
        // Either bit of a child's state is set: the child is not VOID.
        let some = (states | states >> 1) & LOW_STATE_BITS;
        // (Shifted so that only a quadtree's four children are compared.)
        if some << (32 - 2 * R::CHILDREN) != LOW_STATE_BITS << (32 - 2 * R::CHILDREN) || self.valid.is_some()
        {
            return self.cells_and_void(values, some, start);
        }
        for (pair, values) in values[..R::CHILDREN].as_chunks::<2>().0.iter().enumerate() {
            let index = self.pair_index(pair, start);
            self.values[index..index + 2].copy_from_slice(values);
        }
    }

    /// Draws the children of a node as single cells if some may be VOID or flags are requested. In
    /// `some`, the low bit of each bit pair is set if the child is not VOID. Separate from
    /// [`Self::cells`] to keep the common case small.
    #[inline(never)]
    fn cells_and_void(&mut self, values: &[R::Bytes], some: u32, start: usize) {
        for (pair, values) in values[..R::CHILDREN].as_chunks::<2>().0.iter().enumerate() {
            let index = self.pair_index(pair, start);
            let flags = array::map([0, 1], |child| some >> (4 * pair + 2 * child) & 1 != 0);
            for child in 0..2 {
                self.values[index + child] = if flags[child] { values[child] } else { self.fill };
            }
            if let Some(valid) = &mut self.valid {
                valid[index..index + 2].copy_from_slice(&flags);
            }
        }
    }

    /// Returns the index of the first value of a pair of children that are cells.
    #[inline]
    fn pair_index(&self, pair: usize, start: usize) -> usize {
        start + (pair & 1) * self.strides[1] + (pair >> 1) * self.strides[2]
    }

    /// Returns the distance in `values` from a node's first cell to a child's. Children have `side`
    /// cells along each axis.
    #[inline]
    fn offset(&self, child: usize, side: usize) -> usize {
        (0..R::AXES).map(|axis| (child >> axis & 1) * side * self.strides[axis]).sum()
    }

    /// Returns the index of a window cell's value.
    #[inline]
    fn index_of(&self, cell: [u64; 3]) -> usize {
        let Painter { bounds, strides, .. } = self;
        (0..R::AXES).map(|axis| (cell[axis] - bounds.min[axis]) as usize * strides[axis]).sum()
    }

    /// Sets all cells of a box to one value; `None` is VOID.
    pub(super) fn paint(&mut self, part: &Bounds, value: Option<R::Bytes>) {
        self.fill(self.index_of(part.min), array::map(part.size(), |size| size as usize), value);
    }

    /// Sets a block of `size` cells along each axis to one value. `start` is the index of its first
    /// cell.
    pub(super) fn fill(&mut self, start: usize, size: [usize; 3], value: Option<R::Bytes>) {
        let bytes = value.unwrap_or(self.fill);
        let strides = self.strides;
        // Small blocks are frequent: stores of a constant length save a call per row.
        match size[0] {
            // One or two cells: both ends of the row.
            1 | 2 => {
                rows(self.values, start, size, strides, |row| (row[0], row[row.len() - 1]) = (bytes, bytes))
            }
            4 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[bytes; 4])),
            8 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[bytes; 8])),
            16 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[bytes; 16])),
            width => {
                // Copying rows is faster than writing values of an odd width one by one.
                let first = start..start + width;
                self.values[first.clone()].fill(bytes);
                for z in 0..size[2] {
                    for y in 0..size[1] {
                        let row = start + z * strides[2] + y * strides[1];
                        if row > start {
                            self.values.copy_within(first.clone(), row);
                        }
                    }
                }
            }
        }
        if let Some(valid) = &mut self.valid {
            rows(valid, start, size, strides, |row| row.fill(value.is_some()));
        }
    }
}

/// Copies a block of `SIDE` cells along each axis from contiguous rows.
#[inline(always)]
fn copy_rows<B: Copy, const SIDE: usize>(
    cells: &mut [B],
    start: usize,
    axes: usize,
    strides: [usize; 3],
    rows: &[B],
) {
    let size = [SIDE, SIDE, if axes > 2 { SIDE } else { 1 }];
    let mut from = rows.as_chunks::<SIDE>().0.iter();
    self::rows(cells, start, size, strides, |row| {
        if let (Ok(row), Some(from)) = (<&mut [B; SIDE]>::try_from(row), from.next()) {
            *row = *from;
        }
    });
}

/// Calls `each` for each row of a block.
#[inline(always)]
fn rows<T>(
    cells: &mut [T],
    start: usize,
    [width, height, depth]: [usize; 3],
    strides: [usize; 3],
    mut each: impl FnMut(&mut [T]),
) {
    for z in 0..depth {
        for y in 0..height {
            let row = start + z * strides[2] + y * strides[1];
            each(&mut cells[row..row + width]);
        }
    }
}
