//! Windows of Goblin files.

use crate::space::{Bounds, Code};
use crate::store::goblin::{CUT, Goblin, INNER, Layout, Record, Segment, VOID};
use crate::tree::Child;
use crate::value::Value;
use crate::{Error, Result};

impl<D: Layout, V: Value> Goblin<D, V> {
    /// Writes the values of a box of cells of `level` to `values`, as they stand on disk: x fastest, then y, then z.
    /// VOID cells, and cells outside the tree's space, become `fill`, and `false` in `valid` if that is given.
    /// Returns how many segments were looked into: for an aligned box of 2^reach cells along each axis at most
    /// `1 + CHILDREN^(stride - 1)`.
    ///
    /// Takes time proportional to the cells of the box that differ from their neighbours, whatever lies below them.
    ///
    /// # Errors
    /// If the file is damaged there, `level` is deeper than the tree, or a buffer has not one item per cell.
    pub fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: V,
        values: &mut [V::Wire],
        valid: Option<&mut [bool]>,
    ) -> Result<usize> {
        let depth = self.header().shape.depth;
        if level > depth {
            return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
        }
        let cells = bounds.volume();
        let flags = valid.as_ref().map_or(cells, |valid| valid.len() as u64);
        if values.len() as u64 != cells || flags != cells {
            let found = format!("{} values and {flags} flags", values.len());
            return Err(Error::invalid("window buffer", found, format!("{cells}")));
        }
        if bounds.is_empty() {
            return Ok(0);
        }
        let side = 1u64 << level;
        let space =
            Bounds { min: [0; 3], max: std::array::from_fn(|axis| if axis < D::AXES { side } else { 1 }) };
        let size = bounds.size();
        let fill = fill.to_wire();
        let strides = [1, size[0] as usize, (size[0] * size[1]) as usize];
        let mut painter =
            Painter { tree: self, level, bounds: *bounds, strides, fill, values, valid, seen: Vec::new() };
        if !space.contains(bounds) {
            painter.values.fill(fill);
            if let Some(valid) = &mut painter.valid {
                valid.fill(false);
            }
        }
        let inside = bounds.intersect(&space);
        if !inside.is_empty() {
            painter.draw(&inside)?;
        }
        Ok(painter.seen.len())
    }
}

/// Times a state: a record's states where all children have this one.
const ALIKE: u32 = 0x5555_5555;

struct Painter<'a, D: Layout, V: Value> {
    tree: &'a Goblin<D, V>,
    level: u8,
    /// The whole window.
    bounds: Bounds,
    /// Places in `values` from a cell to the next along each axis.
    strides: [usize; 3],
    fill: V::Wire,
    values: &'a mut [V::Wire],
    valid: Option<&'a mut [bool]>,
    /// Numbers of the segments looked into.
    seen: Vec<usize>,
}

impl<D: Layout, V: Value> Painter<'_, D, V> {
    /// Draws a part of the window, starting from the deepest segment that has all of it.
    fn draw(&mut self, part: &Bounds) -> Result<()> {
        let corner = |cell: [u64; 3]| {
            Code::<D>::from_cell(self.level, cell.map(|cell| cell as u32)).expect("inside the space")
        };
        let code = corner(part.min).common_ancestor(corner(part.max.map(|end| end - 1)));
        if code.level() == self.level {
            let value = self.tree.value_at(code)?;
            self.paint(part, value);
            return Ok(());
        }
        match self.tree.locate(code)? {
            Child::Void => self.paint(part, None),
            Child::Leaf(value) => self.paint(part, Some(value)),
            Child::Inner { node, .. } => {
                if !self.seen.contains(&node.segment.index()) {
                    self.seen.push(node.segment.index());
                }
                let size = self.level - code.level();
                let min = code.cell().map(|cell| (cell as u64) << size);
                // A node that might own a segment and does not is light: all that is below it is in this one.
                let light =
                    self.tree.header().shape.segment_level(code.level()) > node.segment.code().level();
                self.node(&node.segment, node.segment.records(), node.record, code.level(), min, light)?;
            }
        }
        Ok(())
    }

    /// Draws the node whose record is `at`, which is at `level` and has its first cell at `min`; if it is `light`,
    /// nothing below it is in another segment.
    fn node(
        &mut self,
        segment: &Segment<'_, D, V>,
        records: &[D::Record<V>],
        at: usize,
        level: u8,
        min: [u64; 3],
        light: bool,
    ) -> Result<()> {
        let record = &records[at];
        let below = self.level - level - 1;
        let inside = (0..D::AXES).all(|axis| {
            self.bounds.min[axis] <= min[axis] && min[axis] + (2 << below) <= self.bounds.max[axis]
        });
        let shape = &self.tree.header().shape;
        let complete = light || shape.cut_level(segment.code().level()) >= self.level;
        if inside && complete {
            return self.whole(segment, records, at, below, self.place(min));
        }
        // The children may own segments that reach deeper.
        let jump = !complete && shape.is_candidate(level + 1);
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        for child in 0..D::CHILDREN {
            let state = record.state(child);
            let place = next;
            if state == INNER && below > 0 {
                let skip = if next < end { records[next].skip() as usize } else { 0 };
                if skip == 0 || next + skip > end {
                    return Err(self.tree.bad_skip(segment, at));
                }
                next += skip;
            }
            let child_min: [u64; 3] =
                std::array::from_fn(|axis| min[axis] + ((child as u64 >> axis & 1) << below));
            let extent = |axis: usize| if axis < D::AXES { 1 << below } else { 1 };
            let whole =
                Bounds { min: child_min, max: std::array::from_fn(|axis| child_min[axis] + extent(axis)) };
            let part = whole.intersect(&self.bounds);
            if part.is_empty() {
                continue;
            }
            match state {
                VOID => self.paint(&part, None),
                INNER if below > 0 && !jump => {
                    self.node(segment, records, place, level + 1, child_min, light)?;
                }
                INNER | CUT if below > 0 => {
                    if state == CUT && !self.deeper(segment, level + 1, child_min, below) {
                        let code = Code::from_cell(level + 1, child_min.map(|cell| (cell >> below) as u32));
                        return Err(self.tree.bad_cut(code.unwrap_or(Code::ROOT)));
                    }
                    self.draw(&part)?;
                }
                _ => self.paint(&part, Some(record.value(child))),
            }
        }
        Ok(())
    }

    /// Whether there is a deeper segment than this one for a child that is cut: drawing must get on.
    fn deeper(&self, segment: &Segment<'_, D, V>, level: u8, min: [u64; 3], below: u8) -> bool {
        let code = Code::<D>::from_cell(level, min.map(|cell| (cell >> below) as u32));
        code.and_then(|code| self.tree.find_segment(code)).is_some_and(|index| index != segment.index())
    }

    /// Draws a node that lies wholly in the window and needs no other segment: the hot path of tiles. Its first cell
    /// goes to `start`; its children have `2^below` cells along each axis.
    fn whole(
        &mut self,
        segment: &Segment<'_, D, V>,
        records: &[D::Record<V>],
        at: usize,
        below: u8,
        start: usize,
    ) -> Result<()> {
        let record = &records[at];
        match below {
            0 => {
                self.cells(record.wires(), record.states(), start);
                return Ok(());
            }
            1 => return self.patch(segment, records, at, start),
            _ => {}
        }
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        for child in 0..D::CHILDREN {
            let start = start + self.offset(child, 1 << below);
            match record.state(child) {
                INNER => {
                    let skip =
                        records.get(next).filter(|_| next < end).map_or(0, |record| record.skip() as usize);
                    if skip == 0 || next + skip > end {
                        return Err(self.tree.bad_skip(segment, at));
                    }
                    self.whole(segment, records, next, below - 1, start)?;
                    next += skip;
                }
                CUT => return Err(self.tree.bad_cut(segment.code())),
                state => {
                    let value = (state != VOID).then(|| record.value(child));
                    let side = 1 << below;
                    self.fill(start, [side, side, if D::AXES > 2 { side } else { 1 }], value);
                }
            }
        }
        Ok(())
    }

    /// A node of four cells along each axis, where nearly all records of a detailed tile are. Which of its children are
    /// uniform is as good as random, so nothing here branches on it: a wrong guess costs more than four cells.
    fn patch(
        &mut self,
        segment: &Segment<'_, D, V>,
        records: &[D::Record<V>],
        at: usize,
        start: usize,
    ) -> Result<()> {
        let record = &records[at];
        let states = record.states();
        let under = records.get(at + 1..at + record.skip() as usize).unwrap_or(&[]);
        let mut next = 0;
        for child in 0..D::CHILDREN {
            let state = record.state(child);
            let below = under.get(next).unwrap_or(record);
            let value = record.wires()[child];
            let uniform = D::array(|_| value);
            let (wires, states, skip) = if state == INNER {
                (below.wires(), below.states(), below.skip())
            } else {
                (uniform.as_ref(), u32::from(state) * ALIKE, 0)
            };
            self.cells(wires, states, start + self.offset(child, 2));
            next += skip as usize;
        }
        if states & states >> 1 & ALIKE != 0 {
            return Err(self.tree.bad_cut(segment.code()));
        }
        if next == under.len() { Ok(()) } else { Err(self.tree.bad_skip(segment, at)) }
    }

    /// The children of a node as single cells, in pairs along x.
    #[inline(always)]
    fn cells(&mut self, wires: &[V::Wire], states: u32, start: usize) {
        // Either bit of a child's state: it is not VOID.
        let some = (states | states >> 1) & ALIKE;
        if some << (32 - 2 * D::CHILDREN) != ALIKE << (32 - 2 * D::CHILDREN) || self.valid.is_some() {
            return self.cells_and_void(wires, some, start);
        }
        for (pair, wires) in wires[..D::CHILDREN].as_chunks::<2>().0.iter().enumerate() {
            let place = self.pair_place(pair, start);
            self.values[place..place + 2].copy_from_slice(wires);
        }
    }

    /// As [`Self::cells`], where some may be VOID or flags are asked for; one bit in two of `some` is set for a child
    /// that is not VOID. Apart from it to keep the usual case small.
    #[inline(never)]
    fn cells_and_void(&mut self, wires: &[V::Wire], some: u32, start: usize) {
        for (pair, wires) in wires[..D::CHILDREN].as_chunks::<2>().0.iter().enumerate() {
            let place = self.pair_place(pair, start);
            let flags = [0, 1].map(|child| some >> (4 * pair + 2 * child) & 1 != 0);
            self.values[place..place + 2]
                .copy_from_slice(&[0, 1].map(|child| if flags[child] { wires[child] } else { self.fill }));
            if let Some(valid) = &mut self.valid {
                valid[place..place + 2].copy_from_slice(&flags);
            }
        }
    }

    /// Where a pair of children that are cells goes.
    #[inline]
    fn pair_place(&self, pair: usize, start: usize) -> usize {
        start + (pair & 1) * self.strides[1] + (pair >> 1) * self.strides[2]
    }

    /// Places in `values` from a node's first cell to a child's, whose children have `side` cells along each axis.
    #[inline]
    fn offset(&self, child: usize, side: usize) -> usize {
        (0..D::AXES).map(|axis| (child >> axis & 1) * side * self.strides[axis]).sum()
    }

    /// Where a cell's value goes.
    #[inline]
    fn place(&self, cell: [u64; 3]) -> usize {
        (0..D::AXES).map(|axis| (cell[axis] - self.bounds.min[axis]) as usize * self.strides[axis]).sum()
    }

    /// Gives all cells of a part one value.
    fn paint(&mut self, part: &Bounds, value: Option<V>) {
        self.fill(self.place(part.min), part.size().map(|size| size as usize), value);
    }

    fn fill(&mut self, start: usize, size: [usize; 3], value: Option<V>) {
        let wire = value.map_or(self.fill, V::to_wire);
        let strides = self.strides;
        // Small blocks are many: stores of a known length save them a call for each row.
        match size[0] {
            4 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[wire; 4])),
            8 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[wire; 8])),
            16 => rows(self.values, start, size, strides, |row| row.copy_from_slice(&[wire; 16])),
            _ => rows(self.values, start, size, strides, |row| row.fill(wire)),
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
