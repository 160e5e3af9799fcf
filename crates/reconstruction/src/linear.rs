//! Numbers that depend on a place in cells alone, and boxes of these.

use crate::source::{Block, Place};

/// A number that is linear in the coordinates of cells: a coordinate in the world, or in a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear {
    factors: [f64; 3],
    summand: f64,
    /// How far a number may be off, as it is rounded.
    pub(crate) slack: f64,
}

impl Linear {
    /// A number that is linear in coordinates of the world, over the cells of a frame, so many along a side.
    pub(crate) fn new(world: [f64; 3], summand: f64, frame: &[[f64; 4]; 3], cells: f64) -> Linear {
        let of = |column: usize| (0..3).map(|axis| world[axis] * frame[axis][column]).sum::<f64>();
        let [x, y, z, shift] = [of(0), of(1), of(2), of(3)];
        let summand = shift + summand;
        // Numbers are rounded to 53 bits, few times in a row.
        let most = (x.abs() + y.abs() + z.abs()) * cells + shift.abs() + summand.abs();
        Linear { factors: [x, y, z], summand, slack: most / (1u64 << 46) as f64 }
    }

    /// Whether the number is one all over.
    pub(crate) fn is_finite(&self) -> bool {
        self.slack.is_finite()
    }

    /// Whether it depends on one axis of the cells alone.
    pub(crate) fn is_along(&self, axis: usize) -> bool {
        (0..3).all(|other| other == axis || self.factors[other] == 0.0)
    }

    /// The number at a place.
    pub(crate) fn at(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [by_x, by_y, by_z] = self.factors;
        x * by_x + y * by_y + z * by_z + self.summand
    }

    /// How far the numbers of the centres of a block's cells are from that of its own.
    pub(crate) fn reach(&self, block: Block) -> f64 {
        self.factors.iter().map(|factor| factor.abs()).sum::<f64>() * block.reach()
    }

    /// Bounds of the numbers of the centres of a block's cells.
    pub(crate) fn range(&self, block: Block) -> [f64; 2] {
        let (middle, reach) = (self.at(block.centre()), self.reach(block) + self.slack);
        [middle - reach, middle + reach]
    }
}

/// A box in the world: cells are in it whose centres are.
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

    /// Where a block lies.
    pub(crate) fn place(&self, block: Block) -> Place {
        let mut place = Place::Full;
        for (coordinate, [min, max]) in &self.axes {
            let [least, most] = coordinate.range(block);
            if most < *min || least > *max {
                return Place::Void;
            }
            if least < *min || most > *max {
                place = Place::Mixed;
            }
        }
        place
    }

    /// Whether a place in cells is in it.
    pub(crate) fn has(&self, place: [f64; 3]) -> bool {
        self.axes.iter().all(|(coordinate, [min, max])| (*min..=*max).contains(&coordinate.at(place)))
    }
}
