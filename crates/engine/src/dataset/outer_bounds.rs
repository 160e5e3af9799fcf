//! Bounds that hold for the values of all levels.

use super::{Dataset, Tree};
use crate::ops::{Resampling, ViewSource};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::{Number, Value};

/// Maximum overshoot of cubic convolution, as a fraction of its samples' range. Per axis, the
/// positive weights (Keys 1981, a = -0.5) sum to at most 1.125 and the negative ones to -0.125, so
/// along two axes they sum to at most 1.28125 and -0.28125.
const CUBIC_OVERSHOOT: f64 = 0.28125;
/// Cells per side of the blocks in which a level is scanned.
const BLOCK_SIDE: u64 = 512;

impl Dataset {
    /// Returns bounds for the values of all levels, per channel; empty if there are no values. They
    /// are wider than [`Dataset::exact_bounds`] where cubic convolution overshoots, or where
    /// coarser levels are calculated from coarser operands. With `convolved`, they also hold for a
    /// cubic convolution of the cells.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn outer_bounds(&self, convolved: bool) -> Result<Vec<(Number, Number)>> {
        let mut bounds = self.exact_bounds()?;
        let source = match &self.tree {
            Tree::View(viewed) => Some(viewed.source()),
            _ => None,
        };
        if let Some(ViewSource::Calculated(_)) = source {
            for level in 0..self.depth() {
                self.widen_by_level(level, &mut bounds)?;
            }
        }
        let is_cubic =
            matches!(source, Some(ViewSource::Warped(tree)) if tree.resampling() == Resampling::Cubic);
        let times = u8::from(is_cubic) + u8::from(convolved);
        let sample = self.header().form.value.sample;
        for (min, max) in &mut bounds {
            for _ in 0..times {
                let (low, high) = (min.to_f64(), max.to_f64());
                let overshoot = CUBIC_OVERSHOOT * (high - low) + 1.0;
                *min = sample.nearest((low - overshoot).into()).min(*min);
                *max = sample.nearest((high + overshoot).into()).max(*max);
            }
        }
        Ok(bounds)
    }

    /// Extends bounds, per channel, by the values of a level.
    fn widen_by_level(&self, level: u8, bounds: &mut Vec<(Number, Number)>) -> Result<()> {
        let (value, all) = (self.header().form.value, self.extent_at(level));
        let size = value.sample.size();
        for z in all.min[2]..all.max[2] {
            for y in (all.min[1]..all.max[1]).step_by(BLOCK_SIDE as usize) {
                for x in (all.min[0]..all.max[0]).step_by(BLOCK_SIDE as usize) {
                    let max = [all.max[0].min(x + BLOCK_SIDE), all.max[1].min(y + BLOCK_SIDE), z + 1];
                    let part = Bounds { min: [x, y, z], max };
                    let cells = part.volume() as usize;
                    let (mut bytes, mut valid) = (vec![0; cells * value.size()], vec![false; cells]);
                    self.window(level, &part, Number::default(), &mut bytes, Some(&mut valid))?;
                    let values = bytes.chunks_exact(value.size()).zip(&valid);
                    for (value_bytes, _) in values.filter(|(_, is_valid)| **is_valid) {
                        let found = Value::from_bytes(value_bytes);
                        let present = value.present(found);
                        let numbers = value_bytes
                            .chunks_exact(size)
                            .map(|sample| value.first_number(Value::from_bytes(sample)));
                        for (channel, number) in numbers.enumerate().filter(|(channel, _)| present[*channel])
                        {
                            match bounds.get_mut(channel) {
                                Some((min, max)) => (*min, *max) = ((*min).min(number), (*max).max(number)),
                                None => bounds.push((number, number)),
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }
}
