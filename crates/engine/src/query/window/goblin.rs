//! Windows of Goblin files.
//!
//! A window is drawn from the deepest segment that contains all of it, and from there down to the
//! segments of descendants that reach deeper.

use super::check_buffers;
use super::painter::{AxisSpan, InvalidRecords, Painter, bytes_of};
use crate::query::check_level;
use crate::store::goblin::{Goblin, Located, Segment};
use crate::store::records::{Record, with_record_type};
use crate::tree::Child;
use spinney_base::array;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::{Bounds, Code};
use spinney_base::value::Value;
use spinney_base::{Error, Result};
use spinney_container::{CUT, INNER, VOID};

/// Maximum number of nodes along an axis that a part of a window is divided by.
const MAX_DIVIDED: u64 = 3;

impl Goblin {
    /// Writes the values of a box of cells of `level` to `values` in their stored form: x fastest,
    /// then y, then z. VOID cells, and cells outside of the tree's space, become `fill`, and
    /// `false` in `valid` if that is given. Returns how many segments were read. For a box of
    /// 2^reach cells along each axis these are at most `3^axes`, and for an aligned one `1 +
    /// children^(stride - 1)`.
    ///
    /// The time is proportional to the cells of the box that differ from their neighbours, whatever
    /// is below them.
    ///
    /// # Errors
    /// If the file is corrupt there, if `level` is deeper than the tree, or if a buffer does not
    /// have one value, or one flag, per cell.
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
        let window = Window { tree: self, level, bounds: *bounds, visited: Vec::new() };
        with_record_type!(*self.layout(), R => paint_window::<R>(window, fill, values, valid))
    }
}

/// Draws a whole window, for a record type of known value width. Returns how many segments were
/// read.
fn paint_window<R: Record>(
    window: Window<'_>,
    fill: Value,
    values: &mut [u8],
    valid: Option<&mut [bool]>,
) -> Result<usize> {
    let (bounds, space) = (window.bounds, Bounds::space(R::DIMENSION, window.level));
    let mut drawing = Drawing::<R> { window, painter: Painter::new(bounds, fill, values, valid) };
    // Cells outside of the space are never looked up: the tree has no nodes there.
    if !space.contains(&bounds) {
        drawing.painter.clear();
    }
    let inside = bounds.intersect(&space);
    if !inside.is_empty() {
        drawing.draw(&inside)?;
    }
    Ok(drawing.window.visited.len())
}

/// A box of cells of a file's level.
struct Window<'a> {
    tree: &'a Goblin,
    level: u8,
    /// The whole box, which may extend beyond the tree's space.
    bounds: Bounds,
    /// Indices of the segments read so far, without repetitions.
    visited: Vec<usize>,
}

impl<'a> Window<'a> {
    /// Returns the deepest node that contains a part of the window.
    fn node_around(&self, part: &Bounds) -> Code {
        let dimension = self.tree.header().form.dimension;
        let corner = |cell: [u64; 3]| {
            Code::from_cell(dimension, self.level, array::map(cell, |cell| cell as u32))
                .expect("inside the space")
        };
        // The codes of all cells of a box are between those of its first and last corner in Z
        // order, so the ancestor of these two is that of all.
        corner(part.min).common_ancestor(corner(part.max.map(|end| end - 1)))
    }

    /// Returns the level whose nodes divide a part of the window. Each of these nodes has its share
    /// of the part in one segment, while no segment has all of the part. If the part is on borders
    /// of large nodes, this avoids reading the segments on the path down from these nodes. Returns
    /// `None` if one segment has all, or if the part has so many such nodes that some may be
    /// resolved further up.
    fn divided_at(&self, part: &Bounds) -> Result<Option<u8>> {
        let shape = &self.tree.header().shape;
        let Some(least) = self.level.checked_sub(shape.reach).filter(|least| *least > 0) else {
            return Ok(None);
        };
        let level = (least..=shape.block_level()).find(|level| shape.is_candidate(*level));
        let Some(level) = level else { return Ok(None) };
        let below = self.level - level;
        let nodes = |axis: usize| ((part.max[axis] - 1) >> below) - (part.min[axis] >> below) + 1;
        let code = self.node_around(part);
        if code.level() >= level || (0..3).any(|axis| nodes(axis) > MAX_DIVIDED) {
            return Ok(None);
        }
        let index = match self.tree.find_segment(code) {
            Ok(Some(index)) => index,
            Ok(None) => return Ok(None),
            // (The division below reports the missing bytes in either case.)
            Err(Error::NotFetched) => return Ok(Some(level)),
            Err(error) => return Err(error),
        };
        let own = self.tree.segment_level(index)?;
        let has_all = shape.cut_level(own) >= self.level || shape.segment_level(code.level()) > own;
        Ok((!has_all).then_some(level))
    }

    /// Returns the deepest node that contains a part of the window, and its location.
    fn locate(&mut self, part: &Bounds) -> Result<(Code, Child<Located<'a>>)> {
        let code = self.node_around(part);
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

    /// Returns whether all descendants of a node are in this segment. The segment must be the
    /// deepest one with the node's record.
    fn is_inline(&self, segment: &Segment<'_>, level: u8) -> bool {
        // Invariant: a candidate that owns no segment is light, and is stored entirely in the
        // segment of its nearest heavy ancestor. This segment is the deepest one with the record,
        // and the node or one of its ancestors is a candidate below the segment's node. So all
        // descendants are here, down to the cells. Otherwise, if another segment had more of the
        // node, its children would be missing here, or would appear uniform.
        self.tree.header().shape.segment_level(level) > segment.code().level()
    }

    /// Returns whether a CUT node has a deeper segment than this one. Otherwise drawing would not
    /// terminate.
    fn has_deeper(&self, segment: &Segment<'_>, code: Option<Code>) -> Result<bool> {
        let deeper = code.map_or(Ok(None), |code| self.tree.find_segment(code))?;
        Ok(deeper.is_some_and(|index| index != segment.index()))
    }
}

/// A window in progress.
struct Drawing<'w, 'a, R: Record> {
    window: Window<'w>,
    painter: Painter<'a, R>,
}

impl<R: Record> Drawing<'_, '_, R> {
    /// Draws a part of the window.
    fn draw(&mut self, part: &Bounds) -> Result<()> {
        let Some(level) = self.window.divided_at(part)? else { return self.draw_down(part) };
        let side = 1u64 << (self.window.level - level);
        let nodes = |axis: usize| part.min[axis] / side..part.max[axis].div_ceil(side);
        let mut is_unread = false;
        for z in nodes(2) {
            for y in nodes(1) {
                for x in nodes(0) {
                    // (A quadtree has a single node along z.)
                    let min = array::map([x, y, z], |node| node * side);
                    let node = Bounds { min, max: array::map(min, |min| min + side) };
                    defer_missing(self.draw_down(&node.intersect(part)), &mut is_unread)?;
                }
            }
        }
        finish_deferred(is_unread)
    }

    /// Draws a part of the window, starting from the deepest segment that contains all of it.
    fn draw_down(&mut self, part: &Bounds) -> Result<()> {
        let (code, found) = self.window.locate(part)?;
        match found {
            Child::Void => self.painter.paint(part, None),
            Child::Leaf(value) => self.painter.paint(part, Some(bytes_of::<R>(value))),
            Child::Inner { node: Located { segment, record, level }, .. } => {
                let min = code.ancestor(level).bounds(self.window.level).min;
                let records = R::of(segment.records());
                let shape = &self.window.tree.header().shape;
                // Whether everything to draw is in this segment.
                let is_complete = self.window.is_inline(&segment, level)
                    || shape.cut_level(segment.code().level()) >= self.window.level;
                if is_complete {
                    let drawn = self.painter.run(records, record, self.window.level - level - 1, min);
                    return drawn.map_err(|bad| match bad {
                        InvalidRecords::Skip(at) => self.window.tree.bad_skip(&segment, at),
                        InvalidRecords::Cut => self.window.tree.bad_cut(segment.code()),
                    });
                }
                self.node(&segment, records, record, level, min)?;
            }
        }
        Ok(())
    }

    /// Draws a node from a segment that does not reach down to the cells: its descendants may own
    /// segments that do. `at` is the node's record, `level` its level, and `min` its first cell.
    fn node(
        &mut self,
        segment: &Segment<'_>,
        records: &[R],
        at: usize,
        level: u8,
        min: [u64; 3],
    ) -> Result<()> {
        let record = &records[at];
        let tree = self.window.tree;
        let below = self.window.level - level - 1;
        // Invariant: nodes between a segment's node and the next candidates are never dense blocks,
        // since they are merged from blocks. So descendants that own segments are found record by
        // record.
        if record.is_dense() {
            return Err(tree.bad_skip(segment, at));
        }
        let jump = tree.header().shape.is_candidate(level + 1);
        let halves = self.painter.halves(min, below);
        let end = at + record.skip() as usize;
        let mut next = at + 1;
        let mut is_unread = false;
        for child in 0..R::CHILDREN {
            let state = record.state(child);
            let under = next;
            if state == INNER && below > 0 {
                // Children outside of the window are skipped, but their skips are checked as well.
                let skip = if next < end { records[next].skip() as usize } else { 0 };
                if skip == 0 || next + skip > end {
                    return Err(tree.bad_skip(segment, at));
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
                VOID => self.painter.fill(start, size, None),
                INNER | CUT if below > 0 => {
                    let child_min = array::from_fn(|axis| min[axis] + ((child as u64 >> axis & 1) << below));
                    if state == INNER && !jump {
                        let drawn = self.node(segment, records, under, level + 1, child_min);
                        defer_missing(drawn, &mut is_unread)?;
                        continue;
                    }
                    let cell = array::map(child_min, |cell| (cell >> below) as u32);
                    let code = Code::from_cell(R::DIMENSION, level + 1, cell);
                    let deeper = if state == CUT { self.window.has_deeper(segment, code) } else { Ok(true) };
                    let Some(deeper) = defer_missing(deeper, &mut is_unread)? else { continue };
                    if !deeper {
                        return Err(tree.bad_cut(code.unwrap_or(Code::root(R::DIMENSION))));
                    }
                    let side = |axis: usize| if axis < R::AXES { 1 << below } else { 1 };
                    let max = array::from_fn(|axis| child_min[axis] + side(axis));
                    let part = Bounds { min: child_min, max }.intersect(&self.window.bounds);
                    defer_missing(self.draw(&part), &mut is_unread)?;
                }
                _ => self.painter.fill(start, size, Some(record.values()[child])),
            }
        }
        finish_deferred(is_unread)
    }
}
