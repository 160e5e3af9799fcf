//! Windows of Goblin files.
//!
//! A window is drawn from the deepest segment that has all of it, and from there down to the segments of
//! children that reach deeper. Nearly all the time goes into nodes that lie wholly in the window and in one
//! segment, down at the cells: that part is compiled for each width of values and fan-out, and has no
//! branches that depend on the picture where those could be avoided.

use zerocopy::FromBytes;

use super::check_buffers;
use crate::Result;
use crate::query::check_level;
use crate::space::{Bounds, Code};
use crate::store::container::record::LOW_STATE_BITS;
use crate::store::container::{CUT, INNER, Record, VOID, with_record_type};
use crate::store::goblin::{Goblin, Located, Segment};
use crate::tree::Child;
use crate::value::Value;

impl Goblin {
    /// Writes the values of a box of cells of `level` to `values`, as they stand on disk: x fastest, then y,
    /// then z. VOID cells, and cells outside the tree's space, become `fill`, and `false` in `valid` if that
    /// is given. Returns how many segments were read: for an aligned box of 2^reach cells along each axis at
    /// most `1 + children^(stride - 1)`.
    ///
    /// Takes time proportional to the cells of the box that differ from their neighbours, whatever lies below
    /// them.
    ///
    /// # Errors
    /// If the file is damaged there, `level` is deeper than the tree, or a buffer has not the bytes of one
    /// value, or not one flag, per cell.
    pub fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: Value,
        values: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<usize> {
        check_level(level, self.header().depth())?;
        check_buffers(self.header().form.value, bounds, values, valid.as_deref())?;
        if bounds.is_empty() {
            return Ok(0);
        }
        let [width, height, _] = bounds.size().map(|size| size as usize);
        let strides = [1, width, width * height];
        let window = Window { tree: self, level, bounds: *bounds, strides, visited: Vec::new() };
        with_record_type!(*self.layout(), R => paint_window::<R>(window, fill, values, valid))
    }
}

/// Paints all of a window, of values whose width is known; returns how many segments were read.
fn paint_window<R: Record>(
    window: Window<'_>,
    fill: Value,
    values: &mut [u8],
    valid: Option<&mut [bool]>,
) -> Result<usize> {
    let values = <[R::Bytes]>::mut_from_bytes(values).expect("a whole number of values, as was checked");
    let (bounds, space) = (window.bounds, Bounds::space(R::DIMENSION, window.level));
    let mut painter = Painter::<R> { window, fill: bytes_of::<R>(fill), values, valid };
    // Nothing below is asked about cells outside the space: the tree has no nodes there.
    if !space.contains(&bounds) {
        painter.values.fill(painter.fill);
        if let Some(valid) = &mut painter.valid {
            valid.fill(false);
        }
    }
    let inside = bounds.intersect(&space);
    if !inside.is_empty() {
        painter.draw(&inside)?;
    }
    Ok(painter.window.visited.len())
}

/// The bytes of a value.
#[inline]
fn bytes_of<R: Record>(value: Value) -> R::Bytes {
    R::Bytes::read_from_prefix(&value.to_bytes()).map_or(R::ZERO, |(bytes, _)| bytes)
}

/// A box of cells of a level of a file.
struct Window<'a> {
    tree: &'a Goblin,
    level: u8,
    /// All of the box, which may stick out of the tree's space.
    bounds: Bounds,
    /// Growth of the index of a cell's value from a cell to the next along each axis.
    strides: [usize; 3],
    /// Indices of the segments read so far, each once.
    visited: Vec<usize>,
}

/// Cells of a node's lower or upper half that lie in a window, along one axis.
#[derive(Clone, Copy)]
struct Span {
    /// Summand of the first of them in the index of a cell's value; undefined if there are none.
    offset: usize,
    cells: usize,
}

impl<'a> Window<'a> {
    /// The deepest node that has all of a part of the window, and what is known of it.
    fn locate(&mut self, part: &Bounds) -> Result<(Code, Child<Located<'a>>)> {
        let dimension = self.tree.header().form.dimension;
        let corner = |cell: [u64; 3]| {
            Code::from_cell(dimension, self.level, cell.map(|cell| cell as u32)).expect("inside the space")
        };
        // The codes of all cells of a box lie between those of its two extreme corners in Z order: the
        // ancestor of these two is that of all.
        let code = corner(part.min).common_ancestor(corner(part.max.map(|end| end - 1)));
        if code.level() == self.level {
            return Ok((code, Child::uniform(self.tree.value_at(code)?)));
        }
        let found = self.tree.locate(code)?;
        if let Child::Inner { node, .. } = &found
            && !self.visited.contains(&node.segment.index())
        {
            self.visited.push(node.segment.index());
        }
        Ok((code, found))
    }

    /// Whether nothing below a node of a level, which has its record in a segment, is in another segment. The
    /// segment must be the deepest one with that record.
    fn is_inline(&self, segment: &Segment<'_>, level: u8) -> bool {
        // The node, or one above it, might own a segment and does not: it is too small to be cut anywhere.
        self.tree.header().shape.segment_level(level) > segment.code().level()
    }

    /// Whether there is a deeper segment than this one for a node that is cut off: drawing must get on.
    fn has_deeper(&self, segment: &Segment<'_>, code: Option<Code>) -> bool {
        let deeper = code.and_then(|code| self.tree.find_segment(code));
        deeper.is_some_and(|index| index != segment.index())
    }

    /// Those of `side` cells from `start` along an axis that lie in the window.
    #[inline]
    fn span(&self, axis: usize, start: u64, side: u64) -> Span {
        let (min, max) = (self.bounds.min[axis], self.bounds.max[axis]);
        let (first, end) = (start.max(min).min(max), (start + side).min(max));
        let offset = (first - min) as usize * self.strides[axis];
        Span { offset, cells: end.saturating_sub(first) as usize }
    }
}

struct Painter<'a, R: Record> {
    window: Window<'a>,
    /// The value that stands for VOID.
    fill: R::Bytes,
    values: &'a mut [R::Bytes],
    valid: Option<&'a mut [bool]>,
}

impl<R: Record> Painter<'_, R> {
    /// Draws a part of the window, starting from the deepest segment that has all of it.
    fn draw(&mut self, part: &Bounds) -> Result<()> {
        let (code, found) = self.window.locate(part)?;
        match found {
            Child::Void => self.paint(part, None),
            Child::Leaf(value) => self.paint(part, Some(bytes_of::<R>(value))),
            Child::Inner { node: Located { segment, record }, .. } => {
                let min = code.bounds(self.window.level).min;
                let inline = self.window.is_inline(&segment, code.level());
                self.node(&segment, R::of(segment.records()), record, code.level(), min, inline)?;
            }
        }
        Ok(())
    }

    /// Draws the node whose record is `at`, which is at `level` and has its first cell at `min`; if it is
    /// `inline`, nothing below it is in another segment.
    fn node(
        &mut self,
        segment: &Segment<'_>,
        records: &[R],
        at: usize,
        level: u8,
        min: [u64; 3],
        inline: bool,
    ) -> Result<()> {
        let record = &records[at];
        let (tree, bounds) = (self.window.tree, &self.window.bounds);
        let below = self.window.level - level - 1;
        let inside = (0..R::AXES)
            .all(|axis| bounds.min[axis] <= min[axis] && min[axis] + (2 << below) <= bounds.max[axis]);
        let shape = &tree.header().shape;
        let complete = inline || shape.cut_level(segment.code().level()) >= self.window.level;
        if inside && complete {
            return self.whole(segment, records, at, below, self.index_of(min));
        }
        // The children may own segments that reach deeper.
        let jump = !complete && shape.is_candidate(level + 1);
        // A child is one half of the node along each axis: both are cut to the window once, for all children.
        let mut halves = [[Span { offset: 0, cells: 1 }; 2]; 3];
        for (axis, halves) in halves[..R::AXES].iter_mut().enumerate() {
            let side = 1 << below;
            *halves = [min[axis], min[axis] + side].map(|start| self.window.span(axis, start, side));
        }
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        for child in 0..R::CHILDREN {
            let state = record.state(child);
            let under = next;
            if state == INNER && below > 0 {
                // Children outside the window are stepped over, and their skips checked like all others.
                let skip = if next < end { records[next].skip() as usize } else { 0 };
                if skip == 0 || next + skip > end {
                    return Err(tree.bad_skip(segment, at));
                }
                next += skip;
            }
            let spans: [Span; 3] = std::array::from_fn(|axis| halves[axis][child >> axis & 1]);
            let size = spans.map(|span| span.cells);
            if size.contains(&0) {
                continue;
            }
            let start = spans[0].offset + spans[1].offset + spans[2].offset;
            match state {
                VOID => self.fill(start, size, None),
                INNER | CUT if below > 0 => {
                    let child_min =
                        std::array::from_fn(|axis| min[axis] + ((child as u64 >> axis & 1) << below));
                    if state == INNER && !jump {
                        self.node(segment, records, under, level + 1, child_min, inline)?;
                        continue;
                    }
                    let cell = child_min.map(|cell| (cell >> below) as u32);
                    let code = Code::from_cell(R::DIMENSION, level + 1, cell);
                    if state == CUT && !self.window.has_deeper(segment, code) {
                        return Err(tree.bad_cut(code.unwrap_or(Code::root(R::DIMENSION))));
                    }
                    let side = |axis: usize| if axis < R::AXES { 1 << below } else { 1 };
                    let max = std::array::from_fn(|axis| child_min[axis] + side(axis));
                    self.draw(&Bounds { min: child_min, max }.intersect(&self.window.bounds))?;
                }
                _ => self.fill(start, size, Some(record.values()[child])),
            }
        }
        Ok(())
    }

    /// Draws a node that lies wholly in the window and needs no other segment: the hot path of tiles. Its
    /// first cell goes to `start`; its children have `2^below` cells along each axis.
    fn whole(
        &mut self,
        segment: &Segment<'_>,
        records: &[R],
        at: usize,
        below: u8,
        start: usize,
    ) -> Result<()> {
        let record = &records[at];
        match below {
            0 => {
                self.cells(record.values(), record.states(), start);
                return Ok(());
            }
            1 => return self.patch(segment, records, at, start),
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
                        return Err(self.window.tree.bad_skip(segment, at));
                    }
                    self.whole(segment, records, next, below - 1, start)?;
                    next += skip;
                }
                CUT => return Err(self.window.tree.bad_cut(segment.code())),
                state => {
                    let value = (state != VOID).then(|| record.values()[child]);
                    let side = 1 << below;
                    self.fill(start, [side, side, if R::AXES > 2 { side } else { 1 }], value);
                }
            }
        }
        Ok(())
    }

    /// A node of four cells along each axis, where nearly all records of a detailed tile are. Which of its
    /// children are uniform is as good as random, so nothing here branches on it: a wrong guess costs more
    /// than four cells.
    fn patch(&mut self, segment: &Segment<'_>, records: &[R], at: usize, start: usize) -> Result<()> {
        let record = &records[at];
        let states = record.states();
        let under = records.get(at + 1..at + record.skip() as usize).unwrap_or(&[]);
        let mut next = 0;
        for child in 0..R::CHILDREN {
            let state = record.state(child);
            // Any record will do where there is none: its values are not used then.
            let below = under.get(next).unwrap_or(record);
            // A uniform child is drawn as if it had a record, with four times (or eight times) its value and
            // state.
            let uniform = R::alike(record.values()[child]);
            let (values, states, skip) = if state == INNER {
                (below.values(), below.states(), below.skip())
            } else {
                (uniform.as_ref(), u32::from(state) * LOW_STATE_BITS, 0)
            };
            self.cells(values, states, start + self.offset(child, 2));
            next += skip as usize;
        }
        // Both bits of a state are set: CUT. Damage is tested for once, at the end: every read above is
        // checked, and an error says that the buffers do not count.
        if states & states >> 1 & LOW_STATE_BITS != 0 {
            return Err(self.window.tree.bad_cut(segment.code()));
        }
        if next == under.len() { Ok(()) } else { Err(self.window.tree.bad_skip(segment, at)) }
    }

    /// The children of a node as single cells, in pairs along x.
    #[inline(always)]
    fn cells(&mut self, values: &[R::Bytes], states: u32, start: usize) {
        // Either bit of a child's state: it is not VOID.
        let some = (states | states >> 1) & LOW_STATE_BITS;
        // (Shifted so that a quadtree's four children are all that is compared.)
        if some << (32 - 2 * R::CHILDREN) != LOW_STATE_BITS << (32 - 2 * R::CHILDREN) || self.valid.is_some()
        {
            return self.cells_and_void(values, some, start);
        }
        for (pair, values) in values[..R::CHILDREN].as_chunks::<2>().0.iter().enumerate() {
            let index = self.pair_index(pair, start);
            self.values[index..index + 2].copy_from_slice(values);
        }
    }

    /// The children of a node as single cells where some may be VOID or flags are asked for; one bit in two
    /// of `some` is set for a child that is not VOID. Apart from [`Self::cells`] to keep the usual case
    /// small.
    #[inline(never)]
    fn cells_and_void(&mut self, values: &[R::Bytes], some: u32, start: usize) {
        for (pair, values) in values[..R::CHILDREN].as_chunks::<2>().0.iter().enumerate() {
            let index = self.pair_index(pair, start);
            let flags = [0, 1].map(|child| some >> (4 * pair + 2 * child) & 1 != 0);
            self.values[index..index + 2]
                .copy_from_slice(&[0, 1].map(|child| if flags[child] { values[child] } else { self.fill }));
            if let Some(valid) = &mut self.valid {
                valid[index..index + 2].copy_from_slice(&flags);
            }
        }
    }

    /// Index of the first value of a pair of children that are cells.
    #[inline]
    fn pair_index(&self, pair: usize, start: usize) -> usize {
        start + (pair & 1) * self.window.strides[1] + (pair >> 1) * self.window.strides[2]
    }

    /// Distance in `values` from a node's first cell to a child's; children have `side` cells along each
    /// axis.
    #[inline]
    fn offset(&self, child: usize, side: usize) -> usize {
        (0..R::AXES).map(|axis| (child >> axis & 1) * side * self.window.strides[axis]).sum()
    }

    /// Index of the value of a cell of the window.
    #[inline]
    fn index_of(&self, cell: [u64; 3]) -> usize {
        let Window { bounds, strides, .. } = &self.window;
        (0..R::AXES).map(|axis| (cell[axis] - bounds.min[axis]) as usize * strides[axis]).sum()
    }

    /// Gives all cells of a part one value; `None` is VOID.
    fn paint(&mut self, part: &Bounds, value: Option<R::Bytes>) {
        self.fill(self.index_of(part.min), part.size().map(|size| size as usize), value);
    }

    /// Gives one value to a block of so many cells along each axis, the first of which has an index.
    fn fill(&mut self, start: usize, size: [usize; 3], value: Option<R::Bytes>) {
        let bytes = value.unwrap_or(self.fill);
        let strides = self.window.strides;
        // Small blocks are many: stores of a known length save them a call for each row.
        match size[0] {
            // One cell or two: both ends of the row.
            1 | 2 => {
                rows(self.values, start, size, strides, |row| (row[0], row[row.len() - 1]) = (bytes, bytes))
            }
            4 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[bytes; 4])),
            8 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[bytes; 8])),
            16 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[bytes; 16])),
            _ => rows(self.values, start, size, strides, |row| row.fill(bytes)),
        }
        if let Some(valid) = &mut self.valid {
            rows(valid, start, size, strides, |row| row.fill(value.is_some()));
        }
    }
}

/// Does something to each row of a block of `size` cells.
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
