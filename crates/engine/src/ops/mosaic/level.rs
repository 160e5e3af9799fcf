//! Boxes of nodes of a level: cells from the files, coarser levels from those of the files.

use super::Mosaic;
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Rule, Value, ZoneStats, representative};

/// If a file begins within a node, the node is computed from the file's own nodes this number of
/// levels below.
const FINER: u8 = 2;

/// Values of a box, and which of them are valid.
pub(super) struct DrawnBox {
    pub(super) bounds: Bounds,
    pub(super) values: Vec<u8>,
    pub(super) valid: Vec<bool>,
}

impl DrawnBox {
    fn void(bounds: Bounds, width: usize) -> DrawnBox {
        let cells = bounds.volume() as usize;
        DrawnBox { bounds, values: vec![0; cells * width], valid: vec![false; cells] }
    }

    /// Value at a position in the box.
    pub(super) fn value(&self, at: [u64; 3], width: usize) -> Option<Value> {
        let index = index(&self.bounds, at);
        self.valid[index].then(|| Value::from_bytes(&self.values[index * width..(index + 1) * width]))
    }
}

/// Index of a position among those of a box.
fn index(bounds: &Bounds, at: [u64; 3]) -> usize {
    let [columns, rows, _] = bounds.size();
    let [x, y, z] = [0, 1, 2].map(|axis| at[axis] - bounds.min[axis]);
    ((z * rows + y) * columns + x) as usize
}

/// Positions in a box, x fastest.
pub(super) fn positions(bounds: Bounds) -> impl Iterator<Item = [u64; 3]> {
    let Bounds { min, max } = bounds;
    let row = move |z, y| (min[0]..max[0]).map(move |x| [x, y, z]);
    (min[2]..max[2]).flat_map(move |z| (min[1]..max[1]).flat_map(move |y| row(z, y)))
}

impl Mosaic {
    /// Box of nodes, in nodes that are `by` levels below.
    fn finer(&self, bounds: &Bounds, by: u8) -> Bounds {
        let axes = self.header.form.axes();
        let scaled = |cell: [u64; 3]| {
            std::array::from_fn(|axis| if axis < axes { cell[axis] << by } else { cell[axis] })
        };
        Bounds { min: scaled(bounds.min), max: scaled(bounds.max) }
    }

    /// Nodes that are `by` levels above the cells and contain any of them.
    fn coarser(&self, cells: &Bounds, by: u8) -> Bounds {
        let axes = self.header.form.axes();
        let first = |axis: usize| if axis < axes { cells.min[axis] >> by } else { cells.min[axis] };
        let end = |axis: usize| {
            if axis < axes { cells.max[axis].div_ceil(1 << by) } else { cells.max[axis] }
        };
        Bounds { min: std::array::from_fn(first), max: std::array::from_fn(end) }
    }

    /// Whether a file begins at the border of a node `above` levels above its cells, and has nodes
    /// of that size.
    pub(super) fn lies_on_nodes(&self, number: u32, above: u8) -> bool {
        let entry = self.entry(number);
        let begins =
            entry.bounds.min[..self.header.form.axes()].iter().all(|cell| cell & ((1 << above) - 1) == 0);
        begins && above <= entry.depth
    }

    /// Reads a box of nodes of a level inside the tree's space, as
    /// [`Source::draw`](crate::tree::Source::draw) does.
    ///
    /// # Errors
    /// If a file is corrupt there, or does not match the manifest.
    pub(in crate::ops) fn draw_at(
        &self,
        level: u8,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        valid.fill(false);
        let above = self.header.depth() - level;
        let numbers = self.meeting(&self.finer(bounds, above));
        let goes_by_cells = !matches!(self.header.rule, Rule::Dominant | Rule::Nearest);
        if above == 0 || !goes_by_cells {
            for number in numbers {
                let part = self.coarser(&self.entry(number).bounds, above).intersect(bounds);
                let drawn = self.draw_file(number, above, part)?;
                self.paste(&drawn, bounds, (values, valid), &|_| true);
            }
            return Ok(());
        }
        // Nodes that intersect one file are that file's; those of several files are computed from
        // sums and counts.
        let mut owners = vec![0u8; valid.len()];
        let parts: Vec<(u32, Bounds)> = numbers
            .into_iter()
            .map(|number| (number, self.coarser(&self.entry(number).bounds, above).intersect(bounds)))
            .collect();
        for (number, part) in &parts {
            // (A file that is smaller than a node has no node of that size.)
            let more = if above > self.entry(*number).depth { 2 } else { 1 };
            for at in positions(*part) {
                let owners = &mut owners[index(bounds, at)];
                *owners = owners.saturating_add(more);
            }
        }
        for (number, part) in &parts {
            if positions(*part).any(|at| owners[index(bounds, at)] == 1) {
                let drawn = self.draw_file(*number, above, *part)?;
                self.paste(&drawn, bounds, (values, valid), &|index| owners[index] == 1);
            }
        }
        let (dimension, width) = (self.header.form.dimension, self.header.form.width());
        for at in positions(*bounds).filter(|at| owners[index(bounds, *at)] > 1) {
            let Some(code) = Code::from_cell(dimension, level, at.map(|cell| cell as u32)) else { continue };
            let tally = self.tally_of(code)?;
            if tally.cells > 0 {
                let to = index(bounds, at);
                valid[to] = true;
                let children = self.deciding_children(code, &tally)?;
                let value = value_of(self.header.rule, &children, &tally, dimension.cells(above));
                value.write(&mut values[to * width..(to + 1) * width]);
            }
        }
        Ok(())
    }

    /// Values of a node's children in child order, as far as its majority depends on them: none
    /// without a tie, and none after the first that breaks it.
    fn deciding_children(&self, code: Code, tally: &ZoneStats) -> Result<Vec<Option<(Value, bool)>>> {
        let mut children = Vec::new();
        if self.header.rule != Rule::Majority || !tally.is_tied() {
            return Ok(children);
        }
        let width = self.header.form.width();
        for step in 0..self.header.form.children() {
            let child = code.child(step);
            let min = child.cell().map(u64::from);
            let mut drawn = DrawnBox::void(Bounds { min, max: min.map(|cell| cell + 1) }, width);
            self.draw_at(child.level(), &drawn.bounds, &mut drawn.values, &mut drawn.valid)?;
            let value = drawn.value(min, width);
            children.push(value.map(|value| (value, true)));
            if value.is_some_and(|value| tally.is_most_frequent(value)) {
                break;
            }
        }
        Ok(children)
    }

    /// Copies valid values to their positions in a box, where `is_wanted` selects them.
    fn paste(
        &self,
        drawn: &DrawnBox,
        bounds: &Bounds,
        (values, valid): (&mut [u8], &mut [bool]),
        is_wanted: &dyn Fn(usize) -> bool,
    ) {
        let width = self.header.form.width();
        for (from, at) in positions(drawn.bounds).enumerate().filter(|(from, _)| drawn.valid[*from]) {
            let to = index(bounds, at);
            if is_wanted(to) {
                valid[to] = true;
                values[to * width..(to + 1) * width]
                    .copy_from_slice(&drawn.values[from * width..(from + 1) * width]);
            }
        }
    }

    /// Cells of the mosaic in a box.
    pub(super) fn draw_cells(&self, bounds: Bounds) -> Result<DrawnBox> {
        let mut drawn = DrawnBox::void(bounds, self.header.form.width());
        self.draw_at(self.header.depth(), &bounds, &mut drawn.values, &mut drawn.valid)?;
        Ok(drawn)
    }

    /// Nodes of a file `above` levels above the cells, each of which contains some of the file's
    /// cells.
    fn draw_file(&self, number: u32, above: u8, part: Bounds) -> Result<DrawnBox> {
        let mut drawn = DrawnBox::void(part, self.header.form.width());
        let (axes, entry) = (self.header.form.axes(), self.entry(number));
        if self.lies_on_nodes(number, above) {
            let first =
                std::array::from_fn(|axis| if axis < axes { entry.bounds.min[axis] >> above } else { 0 });
            let own = part.within(&Bounds { min: first, max: [0; 3] });
            let file = self.file(number)?;
            let level = entry.depth - above;
            file.window(level, &own, Value::ZERO, &mut drawn.values, Some(&mut drawn.valid))?;
            return Ok(drawn);
        }
        self.draw_between(number, above, &mut drawn)?;
        Ok(drawn)
    }

    /// Draws nodes whose borders do not coincide with the file's own nodes, from the file's finer
    /// nodes: each of these counts in the node that contains most of it.
    fn draw_between(&self, number: u32, above: u8, drawn: &mut DrawnBox) -> Result<()> {
        let (axes, entry, width) = (self.header.form.axes(), self.entry(number), self.header.form.width());
        let finer = FINER.max(above.saturating_sub(entry.depth)).min(above);
        let below = above - finer;
        let side = 1u64 << below;
        let shift: [u64; 3] =
            std::array::from_fn(
                |axis| {
                    if axis < axes { (entry.bounds.min[axis] + side / 2) >> below } else { 0 }
                },
            );
        let own_extent = self.coarser(&Bounds::of_extent(entry.bounds.size()), below);
        let at_place = |min: [u64; 3]| -> [u64; 3] { std::array::from_fn(|axis| min[axis] + shift[axis]) };
        let there = Bounds { min: at_place(own_extent.min), max: at_place(own_extent.max) };
        let fine = self.finer(&drawn.bounds, finer).intersect(&there);
        if fine.is_empty() {
            return Ok(());
        }
        let mut own = DrawnBox::void(fine, width);
        let level = entry.depth - below;
        let bounds = fine.within(&Bounds { min: shift, max: [0; 3] });
        self.file(number)?.window(level, &bounds, Value::ZERO, &mut own.values, Some(&mut own.valid))?;
        let samples = self.header.form.dimension.cells(finer);
        for (to, at) in positions(drawn.bounds).enumerate() {
            let node = Bounds { min: at, max: at.map(|cell| cell + 1) };
            let part = self.finer(&node, finer).intersect(&fine);
            let found: Vec<Value> = positions(part).filter_map(|at| own.value(at, width)).collect();
            let Some(first) = found.first() else { continue };
            let is_uniform = found.iter().all(|value| value == first)
                && (found.len() as u64 == samples || self.header.rule != Rule::Occupancy);
            let value = if is_uniform {
                *first
            } else if self.header.rule == Rule::Majority {
                let sample = |min: [u64; 3]| {
                    let sample = Bounds { min, max: min.map(|cell| cell + 1) };
                    part.contains(&sample).then(|| own.value(min, width)).flatten()
                };
                self.majority_of(&self.finer(&node, finer), &sample).map_or(*first, |(value, _)| value)
            } else {
                let children: Vec<_> = found.iter().map(|value| Some((*value, false))).collect();
                value_of(self.header.rule, &children, &self.count(&found), samples)
            };
            drawn.valid[to] = true;
            value.write(&mut drawn.values[to * width..(to + 1) * width]);
        }
        Ok(())
    }

    /// Majority and tally of a box of samples, `2^n` along each axis, computed as for a node;
    /// `None` if there are no samples.
    fn majority_of(
        &self,
        samples: &Bounds,
        sample: &dyn Fn([u64; 3]) -> Option<Value>,
    ) -> Option<(Value, ZoneStats)> {
        let form = self.header.form;
        let half = samples.size()[0] / 2;
        if half == 0 {
            let value = sample(samples.min)?;
            return Some((value, ZoneStats::leaf(form.value, value, 1, true)));
        }
        let children: Vec<_> = (0..form.children())
            .map(|step| {
                let min: [u64; 3] =
                    std::array::from_fn(|axis| samples.min[axis] + (step as u64 >> axis & 1) * half);
                let max =
                    std::array::from_fn(
                        |axis| if axis < form.axes() { min[axis] + half } else { min[axis] + 1 },
                    );
                self.majority_of(&Bounds { min, max }, sample)
            })
            .collect();
        let tallies: Vec<_> = children.iter().flatten().map(|(_, tally)| tally).collect();
        if tallies.is_empty() {
            return None;
        }
        let tally = ZoneStats::merge(&tallies);
        let values: Vec<_> =
            children.iter().map(|child| child.as_ref().map(|(value, _)| (*value, true))).collect();
        Some((representative(Rule::Majority, &values, &tally, 0), tally))
    }

    /// Tally of some cells.
    pub(super) fn count(&self, values: &[Value]) -> ZoneStats {
        let value_type = self.header.form.value;
        match values {
            [] => ZoneStats::void(value_type),
            [value] => ZoneStats::leaf(value_type, *value, 1, self.counts_classes()),
            _ => {
                let (first, last) = values.split_at(values.len() / 2);
                ZoneStats::merge(&[&self.count(first), &self.count(last)])
            }
        }
    }

    /// Whether classes are counted for a few cells.
    fn counts_classes(&self) -> bool {
        self.header.counts_classes() || matches!(self.header.rule, Rule::Dominant | Rule::Nearest)
    }
}

/// Value of a node with this number of cells by a rule; ties between classes are broken by the
/// children. (Rules that depend on nodes instead of cells use the majority class.)
fn value_of(rule: Rule, children: &[Option<(Value, bool)>], tally: &ZoneStats, cells: u64) -> Value {
    match rule {
        Rule::Min => tally.min,
        Rule::Max => tally.max,
        Rule::Dominant | Rule::Nearest => representative(Rule::Majority, children, tally, cells),
        rule => representative(rule, children, tally, cells),
    }
}
