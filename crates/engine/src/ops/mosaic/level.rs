//! Boxes of nodes of a level: the cells from the files, coarser levels from the files' own.

use super::Mosaic;
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Rule, Value, ZoneStats, representative};

/// Levels between a node that a file begins within and the file's own nodes that it is made of.
const FINER: u8 = 2;

/// Values of a box, and which of them there are.
pub(super) struct Drawn {
    pub(super) bounds: Bounds,
    pub(super) values: Vec<u8>,
    pub(super) valid: Vec<bool>,
}

impl Drawn {
    fn void(bounds: Bounds, width: usize) -> Drawn {
        let cells = bounds.volume() as usize;
        Drawn { bounds, values: vec![0; cells * width], valid: vec![false; cells] }
    }

    /// The value at a place in the box.
    pub(super) fn value(&self, at: [u64; 3], width: usize) -> Option<Value> {
        let index = index(&self.bounds, at);
        self.valid[index].then(|| Value::from_bytes(&self.values[index * width..(index + 1) * width]))
    }
}

/// The number of a place among those of a box.
fn index(bounds: &Bounds, at: [u64; 3]) -> usize {
    let [columns, rows, _] = bounds.size();
    let [x, y, z] = [0, 1, 2].map(|axis| at[axis] - bounds.min[axis]);
    ((z * rows + y) * columns + x) as usize
}

/// The places of a box, x fastest.
pub(super) fn places(bounds: Bounds) -> impl Iterator<Item = [u64; 3]> {
    let Bounds { min, max } = bounds;
    let row = move |z, y| (min[0]..max[0]).map(move |x| [x, y, z]);
    (min[2]..max[2]).flat_map(move |z| (min[1]..max[1]).flat_map(move |y| row(z, y)))
}

impl Mosaic {
    /// A box whose numbers are those of nodes so many levels above others, in these.
    fn finer(&self, bounds: &Bounds, by: u8) -> Bounds {
        let axes = self.header.form.axes();
        let scaled = |cell: [u64; 3]| {
            std::array::from_fn(|axis| if axis < axes { cell[axis] << by } else { cell[axis] })
        };
        Bounds { min: scaled(bounds.min), max: scaled(bounds.max) }
    }

    /// The nodes so many levels above some cells that have any of them.
    fn coarser(&self, cells: &Bounds, by: u8) -> Bounds {
        let axes = self.header.form.axes();
        let first = |axis: usize| if axis < axes { cells.min[axis] >> by } else { cells.min[axis] };
        let end = |axis: usize| {
            if axis < axes { cells.max[axis].div_ceil(1 << by) } else { cells.max[axis] }
        };
        Bounds { min: std::array::from_fn(first), max: std::array::from_fn(end) }
    }

    /// Whether a file's cells begin with a node so many levels above them, and it has nodes of that size.
    pub(super) fn lies_on_nodes(&self, number: u32, above: u8) -> bool {
        let entry = self.entry(number);
        let begins =
            entry.bounds.min[..self.header.form.axes()].iter().all(|cell| cell & ((1 << above) - 1) == 0);
        begins && above <= entry.depth
    }

    /// Draws a box of nodes of a level inside the tree's space as [`Source::draw`](crate::tree::Source::draw) does.
    ///
    /// # Errors
    /// If a file is damaged there, or is not what the manifest tells.
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
        // Nodes of one file are that file's, those of several are made of sums and counts.
        let mut owners = vec![0u8; valid.len()];
        let parts: Vec<(u32, Bounds)> = numbers
            .into_iter()
            .map(|number| (number, self.coarser(&self.entry(number).bounds, above).intersect(bounds)))
            .collect();
        for (number, part) in &parts {
            // (One that is smaller than a node has no node of that size.)
            let more = if above > self.entry(*number).depth { 2 } else { 1 };
            for at in places(*part) {
                let owners = &mut owners[index(bounds, at)];
                *owners = owners.saturating_add(more);
            }
        }
        for (number, part) in &parts {
            if places(*part).any(|at| owners[index(bounds, at)] == 1) {
                let drawn = self.draw_file(*number, above, *part)?;
                self.paste(&drawn, bounds, (values, valid), &|index| owners[index] == 1);
            }
        }
        let (dimension, width) = (self.header.form.dimension, self.header.form.width());
        for at in places(*bounds).filter(|at| owners[index(bounds, *at)] > 1) {
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

    /// The values of the children of a node in child order, as far as its majority depends on them: none without a tie, and none after
    /// the first that decides it.
    fn deciding_children(&self, code: Code, tally: &ZoneStats) -> Result<Vec<Option<(Value, bool)>>> {
        let mut children = Vec::new();
        if self.header.rule != Rule::Majority || !tally.is_tied() {
            return Ok(children);
        }
        let width = self.header.form.width();
        for step in 0..self.header.form.children() {
            let child = code.child(step);
            let min = child.cell().map(u64::from);
            let mut drawn = Drawn::void(Bounds { min, max: min.map(|cell| cell + 1) }, width);
            self.draw_at(child.level(), &drawn.bounds, &mut drawn.values, &mut drawn.valid)?;
            let value = drawn.value(min, width);
            children.push(value.map(|value| (value, true)));
            if value.is_some_and(|value| tally.is_most_frequent(value)) {
                break;
            }
        }
        Ok(children)
    }

    /// Copies what is not VOID to its places in a box, where it is wanted.
    fn paste(
        &self,
        drawn: &Drawn,
        bounds: &Bounds,
        (values, valid): (&mut [u8], &mut [bool]),
        is_wanted: &dyn Fn(usize) -> bool,
    ) {
        let width = self.header.form.width();
        for (from, at) in places(drawn.bounds).enumerate().filter(|(from, _)| drawn.valid[*from]) {
            let to = index(bounds, at);
            if is_wanted(to) {
                valid[to] = true;
                values[to * width..(to + 1) * width]
                    .copy_from_slice(&drawn.values[from * width..(from + 1) * width]);
            }
        }
    }

    /// The cells of the mosaic in a box.
    pub(super) fn draw_cells(&self, bounds: Bounds) -> Result<Drawn> {
        let mut drawn = Drawn::void(bounds, self.header.form.width());
        self.draw_at(self.header.depth(), &bounds, &mut drawn.values, &mut drawn.valid)?;
        Ok(drawn)
    }

    /// Nodes of one file so many levels above the cells, each of which has some of its cells.
    fn draw_file(&self, number: u32, above: u8, part: Bounds) -> Result<Drawn> {
        let mut drawn = Drawn::void(part, self.header.form.width());
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

    /// Nodes that do not begin where the file's own do, from those of it that are finer: each counts in the node where most of it is.
    fn draw_between(&self, number: u32, above: u8, drawn: &mut Drawn) -> Result<()> {
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
        let own_extent = self.coarser(&Bounds::picture(entry.bounds.size()), below);
        let at_place = |min: [u64; 3]| -> [u64; 3] { std::array::from_fn(|axis| min[axis] + shift[axis]) };
        let there = Bounds { min: at_place(own_extent.min), max: at_place(own_extent.max) };
        let fine = self.finer(&drawn.bounds, finer).intersect(&there);
        if fine.is_empty() {
            return Ok(());
        }
        let mut own = Drawn::void(fine, width);
        let level = entry.depth - below;
        let bounds = fine.within(&Bounds { min: shift, max: [0; 3] });
        self.file(number)?.window(level, &bounds, Value::ZERO, &mut own.values, Some(&mut own.valid))?;
        let samples = self.header.form.dimension.cells(finer);
        for (to, at) in places(drawn.bounds).enumerate() {
            let node = Bounds { min: at, max: at.map(|cell| cell + 1) };
            let part = self.finer(&node, finer).intersect(&fine);
            let found: Vec<Value> = places(part).filter_map(|at| own.value(at, width)).collect();
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

    /// The majority and the tally of a box of samples, of `2^n` along each axis, as those of a node; `None` if it has none.
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

    /// The tally of some cells.
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

    /// Whether classes of a few cells are counted.
    fn counts_classes(&self) -> bool {
        self.header.counts_classes() || matches!(self.header.rule, Rule::Dominant | Rule::Nearest)
    }
}

/// The value of a node of so many cells by a rule; the children decide between classes with as many cells. (Rules that go by children
/// have the class of most cells.)
fn value_of(rule: Rule, children: &[Option<(Value, bool)>], tally: &ZoneStats, cells: u64) -> Value {
    match rule {
        Rule::Min => tally.min,
        Rule::Max => tally.max,
        Rule::Dominant | Rule::Nearest => representative(Rule::Majority, children, tally, cells),
        rule => representative(rule, children, tally, cells),
    }
}
