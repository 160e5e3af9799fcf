//! Value of a cell that covers several source cells, each weighted by the covered area.

use glam::DVec3;

use super::polyhedron::Polyhedron;
use super::view::TINY;
use crate::ops::view_source::{ViewSource, ViewSourceNode};
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::value::{Rule, Value, ValueType};

/// Accumulates the source cells in a box.
pub(super) struct Area<'a> {
    source: &'a ViewSource,
    form: TreeType,
    rule: Rule,
    /// The box, in cells of the source.
    min: DVec3,
    max: DVec3,
    /// Volume of the cell in cells of the source, of which the box may be a part.
    whole: f64,
    /// Area (or volume) of the cells that are not VOID.
    area: f64,
    /// Area of each channel's samples that are present.
    areas: [f64; 4],
    /// Sums of the samples of each channel, weighted by area.
    sums: [f64; 4],
    /// Samples are summed relative to this value: see [`ValueType::samples_from`].
    base: Option<Value>,
    /// Area of each value, and its first cell in the box, ordered by z, y and x.
    shares: Vec<(Value, f64, [i64; 3])>,
    /// Minimum or maximum sample of each channel.
    extreme: Option<Value>,
    /// Value of the node that is the whole box, if there is one.
    exact: Option<Value>,
    /// Whether the source's values of INNER nodes must not be used.
    goes_to_cells: bool,
}

impl<'a> Area<'a> {
    pub(super) fn new(
        source: &'a ViewSource,
        form: TreeType,
        rule: Rule,
        (min, max): (DVec3, DVec3),
        whole: f64,
    ) -> Area<'a> {
        // (The rest of a cell that lies outside is empty in trees of occupancy.)
        let is_part = rule == Rule::Occupancy && (max - min).element_product() < whole - TINY;
        Area {
            source,
            form,
            rule,
            min,
            max,
            whole,
            area: 0.0,
            areas: [0.0; 4],
            sums: [0.0; 4],
            base: None,
            shares: Vec::new(),
            extreme: None,
            exact: None,
            goes_to_cells: is_part,
        }
    }

    /// Uses the values of cells only, since those of INNER nodes are approximate.
    pub(super) fn go_to_cells(&mut self) {
        self.goes_to_cells = true;
    }

    /// Adds the part of a source node that lies in a polyhedron instead of the box.
    pub(super) fn add_turned(
        &mut self,
        child: &Child<ViewSourceNode>,
        (at, size): ([i64; 3], u8),
        turned: &Polyhedron,
    ) -> Result<()> {
        let axes = self.form.axes();
        if matches!(child, Child::Void) {
            return Ok(());
        }
        let start = DVec3::from(at.map(|cell| cell as f64));
        let side = (1i64 << size) as f64;
        let end = start + DVec3::from_array(std::array::from_fn(|axis| if axis < axes { side } else { 1.0 }));
        let Some(part) = turned.in_box(start, end) else { return Ok(()) };
        match child {
            Child::Void => {}
            Child::Leaf(value) => self.count(*value, part.volume(), at),
            Child::Inner { node, .. } => {
                let mut children = no_children();
                self.source.children(node, &mut children)?;
                for (step, child) in children[..self.form.children()].iter().enumerate() {
                    self.add_turned(child, (child_at(at, size, step), size - 1), &part)?;
                }
            }
        }
        Ok(())
    }

    /// Adds the part of a source node that lies in the box. The node's first cell is `at`; it has
    /// `2^size` cells along each axis.
    pub(super) fn add(&mut self, child: &Child<ViewSourceNode>, at: [i64; 3], size: u8) -> Result<()> {
        if matches!(child, Child::Void) {
            return Ok(());
        }
        let axes = self.form.axes();
        let side = (1i64 << size) as f64;
        // Size of the intersection of node and box, whether that is the whole node, and whether the
        // node contains the whole box.
        let mut share = 1.0;
        let (mut inside, mut all) = (true, true);
        for (axis, at) in at.iter().enumerate().take(axes) {
            let (start, end) = (*at as f64, *at as f64 + side);
            let part = self.max[axis].min(end) - self.min[axis].max(start);
            if part <= TINY {
                return Ok(());
            }
            inside &= part >= side - TINY;
            all &= self.max[axis] - self.min[axis] <= side + TINY;
            share *= part;
        }
        match child {
            Child::Void => {}
            Child::Leaf(value) => {
                let first = |axis: usize| at[axis].max((self.min[axis] + TINY).floor() as i64);
                self.count(*value, share, [2, 1, 0].map(|axis| if axis < axes { first(axis) } else { 0 }));
            }
            // The source has computed the node's value by the same rule.
            Child::Inner { representative, node } if inside && all && !self.goes_to_cells => {
                self.exact = Some(self.source.representative(node, *representative)?);
            }
            Child::Inner { node, .. } => {
                let mut children = no_children();
                self.source.children(node, &mut children)?;
                for (step, child) in children[..self.form.children()].iter().enumerate() {
                    self.add(child, child_at(at, size, step), size - 1)?;
                }
            }
        }
        Ok(())
    }

    fn count(&mut self, value: Value, share: f64, cell: [i64; 3]) {
        let value_type = self.form.value;
        self.area += share;
        match self.rule {
            Rule::Mean | Rule::Occupancy => {
                // (A mean does not depend on the origin of its numbers; a sum does.)
                let first = if self.rule == Rule::Mean { value } else { Value::ZERO };
                let base = *self.base.get_or_insert(first);
                let (samples, present) = (value_type.samples_from(base, value), value_type.present(value));
                for (channel, sample) in samples.iter().enumerate().filter(|(channel, _)| present[*channel]) {
                    self.sums[channel] += share * sample;
                    self.areas[channel] += share;
                }
            }
            Rule::Min => {
                self.extreme = Some(
                    self.extreme.map_or(value, |least| value_type.join_present(least, value, ValueType::min)),
                );
            }
            Rule::Max => {
                self.extreme = Some(
                    self.extreme.map_or(value, |most| value_type.join_present(most, value, ValueType::max)),
                );
            }
            Rule::Majority | Rule::Dominant | Rule::Nearest => {
                match self.shares.iter_mut().find(|(other, ..)| *other == value) {
                    Some((_, sum, first)) => (*sum, *first) = (*sum + share, cell.min(*first)),
                    None => self.shares.push((value, share, cell)),
                }
            }
        }
    }

    /// Value of the box; `None` is VOID.
    pub(super) fn value(self) -> Option<Value> {
        if self.exact.is_some() {
            return self.exact;
        }
        if self.area == 0.0 {
            return None;
        }
        let value_type = self.form.value;
        match self.rule {
            Rule::Mean | Rule::Occupancy => {
                let base = self.base.unwrap_or_default();
                let none = value_type.mean_of_none().map(|value| value_type.samples_from(base, value));
                let is_occupancy = self.rule == Rule::Occupancy;
                let value = value_type.nearest_from(base, |channel| {
                    // Occupancy counts VOID as empty, and everything outside.
                    let area = if is_occupancy { self.whole } else { self.areas[channel] };
                    if let (true, Some(none)) = (area == 0.0, none) {
                        return none[channel];
                    }
                    // (Means of integers are rounded half up, as for whole cells.)
                    self.sums[channel] / area
                });
                // (Too little of a solid for the value type is nothing.)
                let is_nothing = is_occupancy && !value_type.is_masked() && value == Value::ZERO;
                (!is_nothing).then_some(value)
            }
            Rule::Min | Rule::Max => value_type.join_all(self.extreme.into_iter(), ValueType::min),
            Rule::Majority | Rule::Dominant | Rule::Nearest => {
                // Areas that differ by rounding errors only are equal. The value of the first cell
                // in row order wins, so that no value is preferred for its number. (The first cell
                // in Z order would depend on how the source is stored.)
                let most = self.shares.iter().map(|(_, area, _)| *area).fold(0.0, f64::max);
                let best = self.shares.iter().filter(|(_, area, _)| *area >= most - TINY);
                best.min_by_key(|(.., first)| *first).map(|(value, ..)| *value)
            }
        }
    }
}

/// First cell of the child of a node of `2^size` cells along each axis.
pub(super) fn child_at(at: [i64; 3], size: u8, step: usize) -> [i64; 3] {
    std::array::from_fn(|axis| at[axis] + ((step as i64 >> axis & 1) << (size - 1)))
}
