//! Very many single cells at once.
//!
//! A cell alone costs two searches in the directory and a way down from its segment's root. For many cells the upper
//! levels are looked through once: a table has an entry per node of some level, which tells the value of a uniform
//! block or where the node's record is. Random cells of solids lie in large uniform blocks nearly always.

use crate::space::{Cell, Code};
use crate::store::goblin::{CUT, Goblin, INNER, LEAF, Layout, Record, Segment, VOID, child_place};
use crate::tree::{Child, Source};
use crate::value::{Sample, Value};
use crate::{Error, Result};

/// Answers to [`Tree::points`](super::Tree::points).
#[derive(Clone, Debug, Default)]
pub struct PointSamples {
    channels: usize,
    samples: Vec<f64>,
    found: Vec<bool>,
}

impl PointSamples {
    /// Samples of the `index`-th cell, one per channel; `None` is VOID.
    ///
    /// # Panics
    /// If there were not so many cells.
    pub fn get(&self, index: usize) -> Option<&[f64]> {
        self.found[index].then(|| &self.samples[index * self.channels..][..self.channels])
    }

    pub(super) fn start(&mut self, channels: usize) {
        self.channels = channels;
        self.samples.clear();
        self.found.clear();
    }

    pub(super) fn push(&mut self, value: Option<&[f64; 4]>) {
        self.samples.extend(&value.unwrap_or(&[0.0; 4])[..self.channels]);
        self.found.push(value.is_some());
    }

    pub(super) fn push_value<V: Value>(&mut self, value: Option<V>) {
        self.samples.extend(value.unwrap_or_default().samples().iter().map(|sample| sample.to_f64()));
        self.found.push(value.is_some());
    }
}

/// Answers for single cells of one level of a file, with a table of the upper levels; may be shared by threads.
pub struct Points<'a, D: Layout, V: Value> {
    tree: &'a Goblin<D, V>,
    level: u8,
    /// Level of the nodes in the table.
    top: u8,
    /// An entry per node, x fastest, then y, then z.
    table: Vec<Entry>,
    /// What uniform entries stand for.
    values: Vec<Option<V>>,
    /// Segments of all others.
    segments: Vec<Segment<'a, D, V>>,
}

/// A node of the table: its record in a segment, or a value.
#[derive(Clone, Copy)]
struct Entry {
    /// Place in [`Points::segments`], or [`UNIFORM`].
    segment: u32,
    /// Number of the record, or place in [`Points::values`].
    record: u32,
}

const UNIFORM: u32 = u32::MAX;
/// Nodes that the table has at most: 2 MiB of them stay in a processor's cache.
const MOST: u64 = 1 << 18;
/// Cells that must be asked for to make an entry worth its while.
const WORTH: u64 = 8;

impl<D: Layout, V: Value> Goblin<D, V> {
    /// The values of many cells of a level to `values`; `None` is VOID, as is everything outside the tree.
    ///
    /// # Errors
    /// If the level is deeper than the tree, there are not as many places as cells, or the file is damaged there.
    pub fn values_at(&self, level: u8, cells: &[Cell], values: &mut [Option<V>]) -> Result<()> {
        if cells.len() != values.len() {
            let found = format!("{} places for values", values.len());
            return Err(Error::invalid("points", found, format!("{}, one per cell", cells.len())));
        }
        let points = self.points_of(level, cells.len() as u64)?;
        for (cell, value) in cells.iter().zip(values) {
            *value = points.value(*cell)?;
        }
        Ok(())
    }

    /// Gets ready to answer for about `count` cells of a level, anywhere in the tree. The more there are the more of the
    /// upper levels is looked through first.
    ///
    /// # Errors
    /// If the level is deeper than the tree, or the file is damaged.
    pub fn points_of(&self, level: u8, count: u64) -> Result<Points<'_, D, V>> {
        let depth = self.header().shape.depth;
        if level > depth {
            return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
        }
        let nodes = |top: u8| 1u64 << (D::AXES * usize::from(top));
        let worth = (count / WORTH).min(MOST);
        // Segments that are not mapped stay in memory for as long as somebody has them: better one by one.
        let most = if self.is_mapped() { level } else { 0 };
        let top = (0..=most).take_while(|top| nodes(*top) <= worth).last().unwrap_or(0);
        let mut points =
            Points { tree: self, level, top, table: Vec::new(), values: Vec::new(), segments: Vec::new() };
        if top > 0 {
            points.table = vec![Entry { segment: UNIFORM, record: 0 }; nodes(top) as usize];
            points.values.push(None);
            points.fill(Code::ROOT, &self.root()?)?;
        }
        Ok(points)
    }
}

impl<'a, D: Layout, V: Value> Points<'a, D, V> {
    /// The value of a cell of the level; `None` is VOID, as is everything outside the tree.
    ///
    /// # Errors
    /// If the file is damaged there.
    #[inline]
    pub fn value(&self, cell: Cell) -> Result<Option<V>> {
        let side = 1u32 << self.level;
        if (0..3).any(|axis| cell[axis] >= if axis < D::AXES { side } else { 1 }) {
            return Ok(None);
        }
        if self.top == 0 {
            return self.far(cell);
        }
        let Entry { segment, record } = self.table[self.place(cell, self.level - self.top)];
        if segment == UNIFORM {
            return Ok(self.values[record as usize]);
        }
        let segment = &self.segments[segment as usize];
        let records = segment.records();
        let mut at = record as usize;
        let mut bit = self.level - self.top;
        while bit > 0 {
            bit -= 1;
            let step = (0..D::AXES).fold(0, |step, axis| step | (cell[axis] as usize >> bit & 1) << axis);
            let record = &records[at];
            match record.state(step) {
                VOID => return Ok(None),
                LEAF => return Ok(Some(record.value(step))),
                _ if bit == 0 => return Ok(Some(record.value(step))),
                INNER => {
                    let place = child_place::<D, V>(records, at, step);
                    at = place.ok_or_else(|| self.tree.bad_skip(segment, at))?;
                }
                _ => {
                    debug_assert!(record.state(step) == CUT);
                    return self.far(cell);
                }
            }
        }
        Ok(None)
    }

    /// A cell that no entry of the table leads to.
    #[cold]
    fn far(&self, cell: Cell) -> Result<Option<V>> {
        Code::from_cell(self.level, cell).map_or(Ok(None), |code| self.tree.value_at(code))
    }

    /// Where the table has the node of a cell, so many levels above it.
    #[inline]
    fn place(&self, cell: Cell, up: u8) -> usize {
        (0..D::AXES)
            .fold(0, |place, axis| place | (cell[axis] as usize >> up) << (axis * usize::from(self.top)))
    }

    /// Fills the entries of all that is below a node.
    fn fill(&mut self, code: Code<D>, child: &Child<V, <Goblin<D, V> as Source>::Node>) -> Result<()> {
        let node = match child {
            Child::Inner { node, .. } => node,
            _ => {
                let entry = self.uniform(child.value());
                return self.spread(code, entry);
            }
        };
        if code.level() < self.top {
            let tree = self.tree;
            return tree.each_child(node, |step, child| self.fill(code.child(step), &child));
        }
        if self.top == self.level {
            let entry = self.uniform(child.value());
            return self.spread(code, entry);
        }
        let (index, record) = node.place();
        // In preorder, a segment's nodes come one after the other.
        let known = self.segments.iter().rposition(|segment| segment.index() == index);
        let segment = match known {
            Some(known) => known,
            None => {
                self.segments.push(self.tree.segment(index)?);
                self.segments.len() - 1
            }
        };
        self.spread(code, Entry { segment: segment as u32, record: record as u32 })
    }

    fn uniform(&mut self, value: Option<V>) -> Entry {
        let same = |known: &Option<V>| match (known, value) {
            (Some(known), Some(value)) => known.same(value),
            (None, None) => true,
            _ => false,
        };
        // Mostly it is VOID, or what came last.
        let recent = self.values.len().saturating_sub(4)..self.values.len();
        let place = std::iter::once(0).chain(recent.rev()).find(|place| same(&self.values[*place]));
        let record = place.unwrap_or_else(|| {
            self.values.push(value);
            self.values.len() - 1
        });
        Entry { segment: UNIFORM, record: record as u32 }
    }

    /// Sets the entries of all nodes of the table that are below a node.
    fn spread(&mut self, code: Code<D>, entry: Entry) -> Result<()> {
        let size = 1u32 << (self.top - code.level());
        let extent = |axis: usize| if axis < D::AXES { size } else { 1 };
        let min: [u32; 3] = std::array::from_fn(|axis| code.cell()[axis] * extent(axis));
        for z in min[2]..min[2] + extent(2) {
            for y in min[1]..min[1] + extent(1) {
                let place = self.place([min[0], y, z], 0);
                self.table[place..place + size as usize].fill(entry);
            }
        }
        Ok(())
    }
}
