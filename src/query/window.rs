//! Windows: the values of any box of cells at any level.

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
                self.node(&node.segment, node.segment.records(), node.record, code.level(), min)?;
            }
        }
        Ok(())
    }

    /// Draws the node whose record is `at`, which is at `level` and has its first cell at `min`.
    fn node(
        &mut self,
        segment: &Segment<'_, D, V>,
        records: &[D::Record<V>],
        at: usize,
        level: u8,
        min: [u64; 3],
    ) -> Result<()> {
        let record = &records[at];
        let below = self.level - level - 1;
        let inside = (0..D::AXES).all(|axis| {
            self.bounds.min[axis] <= min[axis] && min[axis] + (2 << below) <= self.bounds.max[axis]
        });
        let shape = &self.tree.header().shape;
        if inside && shape.cut_level(segment.code().level()) >= self.level {
            return self.whole(segment, records, at, below, self.place(min));
        }
        // The children may own segments that reach deeper.
        let jump = shape.is_candidate(level + 1) && shape.cut_level(segment.code().level()) < self.level;
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
                INNER if below > 0 && !jump => self.node(segment, records, place, level + 1, child_min)?,
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
        let states = record.states();
        if below == 0 {
            self.cells(record, states, start);
            return Ok(());
        }
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        for child in 0..D::CHILDREN {
            let offset =
                (0..D::AXES).map(|axis| ((child >> axis & 1) << below) * self.strides[axis]).sum::<usize>();
            match (states >> (2 * child)) as u8 & 3 {
                INNER => {
                    let skip =
                        records.get(next).filter(|_| next < end).map_or(0, |record| record.skip() as usize);
                    if skip == 0 || next + skip > end {
                        return Err(self.tree.bad_skip(segment, at));
                    }
                    if below == 1 {
                        // Three of four records are such: not worth a call.
                        let record = &records[next];
                        self.cells(record, record.states(), start + offset);
                    } else {
                        self.whole(segment, records, next, below - 1, start + offset)?;
                    }
                    next += skip;
                }
                CUT => return Err(self.tree.bad_cut(segment.code())),
                state => {
                    let value = (state != VOID).then(|| record.value(child));
                    let side = 1 << below;
                    self.fill(start + offset, [side, side, if D::AXES > 2 { side } else { 1 }], value);
                }
            }
        }
        Ok(())
    }

    /// The children of a record as single cells, in pairs along x.
    #[inline(always)]
    fn cells(&mut self, record: &D::Record<V>, states: u32, start: usize) {
        // Any bit of a child's state: it is not VOID.
        let some = states | states >> 1;
        let is_void = |child: usize| some >> (2 * child) & 1 == 0;
        for pair in 0..D::CHILDREN / 2 {
            let place = start + (pair & 1) * self.strides[1] + (pair >> 1) * self.strides[2];
            let wire = |child: usize| if is_void(child) { self.fill } else { record.value(child).to_wire() };
            let cells = &mut self.values[place..place + 2];
            cells[0] = wire(2 * pair);
            cells[1] = wire(2 * pair + 1);
            if let Some(valid) = &mut self.valid {
                valid[place..place + 2].copy_from_slice(&[!is_void(2 * pair), !is_void(2 * pair + 1)]);
            }
        }
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

    #[inline]
    fn fill(&mut self, start: usize, [width, height, depth]: [usize; 3], value: Option<V>) {
        let wire = value.map_or(self.fill, V::to_wire);
        for z in 0..depth {
            for y in 0..height {
                let row = start + z * self.strides[2] + y * self.strides[1];
                self.values[row..row + width].fill(wire);
                if let Some(valid) = &mut self.valid {
                    valid[row..row + width].fill(value.is_some());
                }
            }
        }
    }
}
