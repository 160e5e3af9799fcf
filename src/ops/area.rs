//! The value of a cell that covers several cells of a source, each as far as it is covered.

use glam::DVec3;

use crate::Result;
use crate::space::Dimension;
use crate::tree::{Child, Source};
use crate::value::{Rule, Sample, Value, channelwise_max, channelwise_min};

use super::view::TINY;

/// Gathers what lies in a box of the source.
pub(super) struct Area<'a, S: Source> {
    source: &'a S,
    rule: Rule,
    /// The box, in cells of the source.
    min: DVec3,
    max: DVec3,
    area: f64,
    sums: [f64; 4],
    /// Area of each value.
    shares: Vec<(S::Value, f64)>,
    extreme: Option<S::Value>,
    /// The value of the one node that is the whole box.
    exact: Option<S::Value>,
}

impl<'a, S: Source> Area<'a, S> {
    pub(super) fn new(source: &'a S, rule: Rule, (min, max): (DVec3, DVec3)) -> Self {
        let sums = [0.0; 4];
        Area { source, rule, min, max, area: 0.0, sums, shares: Vec::new(), extreme: None, exact: None }
    }

    /// Adds what a source node with its first cell at `at` and `2^size` cells along each axis has in the box.
    pub(super) fn add(&mut self, place: &Child<S::Value, S::Node>, at: [i64; 3], size: u8) -> Result<()> {
        let axes = S::Dim::AXES;
        let side = (1i64 << size) as f64;
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
        match place {
            Child::Void => {}
            Child::Leaf(value) => self.count(*value, share),
            // What the source has for the whole node was made by the same rule.
            Child::Inner { representative, .. } if inside && all => self.exact = Some(*representative),
            Child::Inner { node, .. } => {
                let children = self.source.children(node)?;
                for (step, child) in children.as_ref().iter().enumerate() {
                    let half = 1i64 << (size - 1);
                    let at = std::array::from_fn(|axis| at[axis] + (step as i64 >> axis & 1) * half);
                    self.add(child, at, size - 1)?;
                }
            }
        }
        Ok(())
    }

    fn count(&mut self, value: S::Value, share: f64) {
        self.area += share;
        match self.rule {
            Rule::Mean | Rule::Occupancy => {
                for (sum, sample) in self.sums.iter_mut().zip(value.samples()) {
                    *sum += share * sample.to_f64();
                }
            }
            Rule::Min => {
                self.extreme = Some(self.extreme.map_or(value, |least| channelwise_min(least, value)))
            }
            Rule::Max => self.extreme = Some(self.extreme.map_or(value, |most| channelwise_max(most, value))),
            Rule::Majority | Rule::Dominant | Rule::Nearest => {
                match self.shares.iter_mut().find(|(other, _)| other.same(value)) {
                    Some((_, sum)) => *sum += share,
                    None => self.shares.push((value, share)),
                }
            }
        }
    }

    fn box_area(&self) -> f64 {
        (0..S::Dim::AXES).map(|axis| self.max[axis] - self.min[axis]).product()
    }

    /// The box's value; `None` is VOID.
    pub(super) fn value(self) -> Option<S::Value> {
        if self.exact.is_some() {
            return self.exact;
        }
        if self.area == 0.0 {
            return None;
        }
        match self.rule {
            Rule::Mean | Rule::Occupancy => Some(S::Value::from_channels(|channel| {
                let area = if self.rule == Rule::Occupancy { self.box_area() } else { self.area };
                let mean = self.sums[channel] / area;
                let is_float = <<S::Value as Value>::Sample as Sample>::TYPE.is_float();
                Sample::from_f64_lossy(if is_float { mean } else { (mean + 0.5).floor() })
            })),
            Rule::Min | Rule::Max => self.extreme,
            Rule::Majority | Rule::Dominant | Rule::Nearest => {
                // Areas that differ by rounding alone are equal; the least value wins, as in counting.
                let most = self.shares.iter().map(|(_, area)| *area).fold(0.0, f64::max);
                let best = self.shares.iter().filter(|(_, area)| *area >= most - TINY);
                best.map(|(value, _)| *value).min_by(|a, b| a.order(*b))
            }
        }
    }
}
