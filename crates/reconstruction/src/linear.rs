//! Linear functions of cell coordinates, and boxes of these.

use crate::source::{Block, BlockState};

/// A linear function of cell coordinates: a world or image coordinate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear {
    factors: [f64; 3],
    summand: f64,
    /// Maximum rounding error of a value.
    pub(crate) slack: f64,
}

impl Linear {
    /// Creates a function that is linear in world coordinates, over the cells of a frame with
    /// `cells` cells along a side.
    pub(crate) fn new(world: [f64; 3], summand: f64, frame: &[[f64; 4]; 3], cells: f64) -> Linear {
        let of = |column: usize| (0..3).map(|axis| world[axis] * frame[axis][column]).sum::<f64>();
        let [x, y, z, shift] = [of(0), of(1), of(2), of(3)];
        let summand = shift + summand;
        // A bound on a few consecutive roundings to 53 bits.
        let most = (x.abs() + y.abs() + z.abs()) * cells + shift.abs() + summand.abs();
        Linear { factors: [x, y, z], summand, slack: most / (1u64 << 46) as f64 }
    }

    /// Whether all values are finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.slack.is_finite()
    }

    /// Whether the function depends on a single axis of the cells only.
    pub(crate) fn is_along(&self, axis: usize) -> bool {
        (0..3).all(|other| other == axis || self.factors[other] == 0.0)
    }

    /// Returns the value at a position.
    pub(crate) fn at(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [by_x, by_y, by_z] = self.factors;
        x * by_x + y * by_y + z * by_z + self.summand
    }

    /// Returns the maximum difference between the values at the centres of a block's cells and the
    /// value at the block's centre.
    pub(crate) fn reach(&self, block: Block) -> f64 {
        self.factors.iter().map(|factor| factor.abs()).sum::<f64>() * block.reach()
    }

    /// Returns bounds of the values at the centres of a block's cells.
    pub(crate) fn range(&self, block: Block) -> [f64; 2] {
        let (middle, reach) = (self.at(block.centre()), self.reach(block) + self.slack);
        [middle - reach, middle + reach]
    }
}

/// A box in world coordinates. It contains the cells whose centres are inside.
pub(crate) struct Limits {
    axes: [(Linear, [f64; 2]); 3],
}

impl Limits {
    pub(crate) fn new([min, max]: [[f64; 3]; 2], frame: &[[f64; 4]; 3], cells: f64) -> Limits {
        let axis = |axis: usize| {
            let mut world = [0.0; 3];
            world[axis] = 1.0;
            (Linear::new(world, 0.0, frame, cells), [min[axis], max[axis]])
        };
        Limits { axes: [axis(0), axis(1), axis(2)] }
    }

    /// Classifies a block of cells.
    pub(crate) fn classify(&self, block: Block) -> BlockState {
        let mut state = BlockState::Full;
        for (coordinate, [min, max]) in &self.axes {
            let [least, most] = coordinate.range(block);
            if most < *min || least > *max {
                return BlockState::Void;
            }
            if least < *min || most > *max {
                state = BlockState::Mixed;
            }
        }
        state
    }

    /// Whether a position in cell coordinates is inside.
    pub(crate) fn has(&self, position: [f64; 3]) -> bool {
        self.axes.iter().all(|(coordinate, [min, max])| (*min..=*max).contains(&coordinate.at(position)))
    }
}
