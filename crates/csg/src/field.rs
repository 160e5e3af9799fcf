//! Primitives over a grid of cells: classifies boxes of cells and tests blocks of 512 samples.

use std::sync::Arc;

use crate::affine::Affine;
use crate::bounded_solid::BoundedSolid;
use crate::box_state::BoxState;
use crate::expression::{Instruction, Pruner, fold};
use crate::model::Primitive;

/// Number of samples along a side of a block.
pub(crate) const SAMPLES: u32 = 8;

/// Sample bits: one word per octant of the block, in Z order, with the octant's 64 samples in Z
/// order.
pub(crate) type Bits = [u64; 8];

/// A primitive over the cells.
struct GridPrimitive {
    primitive: u32,
    /// Transform from cells to local coordinates.
    to_local: Affine,
    /// Margin for rounding, in local coordinates, that is added along each axis to half the width
    /// of a box.
    slack: [f64; 3],
}

/// All primitives over the cells.
pub(crate) struct Field {
    primitives: Arc<Vec<Primitive>>,
    grid_primitives: Vec<GridPrimitive>,
}

impl Field {
    /// Returns the primitives over a frame with `cells` cells along a side.
    pub(crate) fn new(bounded: &BoundedSolid, frame: &[[f64; 4]; 3], cells: f64) -> Field {
        let frame = Affine { rows: *frame };
        let of = |instance: &crate::lowered::Instance| {
            let to_local = instance.to_local.after(&frame);
            let shape = &bounded.primitives[instance.primitive as usize].shape;
            // A bound on a few consecutive roundings to 53 bits.
            let slack = to_local.rows.map(|[x, y, z, shift]| {
                let most = (x.abs() + y.abs() + z.abs()) * cells + shift.abs() + shape.magnitude();
                most / (1u64 << 44) as f64
            });
            GridPrimitive { primitive: instance.primitive, to_local, slack }
        };
        let grid_primitives = bounded.lowered.instances.iter().map(of).collect();
        Field { primitives: bounded.primitives.clone(), grid_primitives }
    }

    /// Classifies a box of cells, given by its centre and half of its width.
    pub(crate) fn classify(&self, number: u32, centre: [f64; 3], half: f64) -> BoxState {
        let GridPrimitive { primitive, to_local, slack } = &self.grid_primitives[number as usize];
        let local = to_local.apply(centre);
        let reach = [0, 1, 2].map(|row| {
            let [x, y, z, _] = to_local.rows[row];
            (x.abs() + y.abs() + z.abs()) * half + slack[row]
        });
        self.primitives[*primitive as usize].shape.classify(local, reach)
    }

    /// Whether a point is inside an expression.
    pub(crate) fn has(&self, instructions: &[Instruction], point: [f64; 3]) -> bool {
        let primitive = |number: u32, is_negated| {
            let GridPrimitive { primitive, to_local, .. } = &self.grid_primitives[number as usize];
            self.primitives[*primitive as usize].shape.has(to_local.apply(point)) != is_negated
        };
        let operation = |step: Instruction, of: &[bool]| match step {
            Instruction::All(_) => of.iter().all(|inside| *inside),
            Instruction::Odd(_, is_even) => of.iter().fold(is_even, |odd, inside| odd != *inside),
            _ => of.iter().any(|inside| *inside),
        };
        fold(instructions, &mut Vec::new(), primitive, operation).unwrap_or(false)
    }

    /// Simplifies an expression for a box of cells: see [`Pruner::prune`].
    pub(crate) fn prune(
        &self,
        pruner: &mut Pruner,
        instructions: &[Instruction],
        centre: [f64; 3],
        half: f64,
    ) -> BoxState {
        pruner.prune(instructions, |number| self.classify(number, centre, half))
    }

    /// Tests which samples of a block are inside an expression. `first` is the first sample, `step`
    /// the distance between samples.
    pub(crate) fn samples(&self, instructions: &[Instruction], first: [f64; 3], step: f64) -> Bits {
        let primitive = |number: u32, is_negated| {
            let bits = self.samples_of(number, first, step);
            if is_negated { bits.map(|word| !word) } else { bits }
        };
        let operation = |step: Instruction, of: &[Bits]| {
            let join = |of: &[Bits], start: u64, join: fn(u64, u64) -> u64| -> Bits {
                std::array::from_fn(|word| of.iter().fold(start, |all, bits| join(all, bits[word])))
            };
            match step {
                Instruction::All(_) => join(of, !0, |a, b| a & b),
                Instruction::Odd(_, is_even) => join(of, if is_even { !0 } else { 0 }, |a, b| a ^ b),
                _ => join(of, 0, |a, b| a | b),
            }
        };
        fold(instructions, &mut Vec::new(), primitive, operation).unwrap_or([0; 8])
    }

    fn samples_of(&self, number: u32, first: [f64; 3], step: f64) -> Bits {
        let grid_primitive = &self.grid_primitives[number as usize];
        let shape = &self.primitives[grid_primitive.primitive as usize].shape;
        let rows = &grid_primitive.to_local.rows;
        let mut bits = [0; 8];
        for (octant, word) in (0u8..).zip(&mut bits) {
            let first = [0, 1, 2].map(|axis| first[axis] + f64::from((octant >> axis & 1) * 4) * step);
            match self.classify(number, first.map(|first| first + 1.5 * step), 1.5 * step) {
                BoxState::Void => continue,
                BoxState::Full => {
                    *word = !0;
                    continue;
                }
                BoxState::Mixed => {}
            }
            for z in 0..4u8 {
                for y in 0..4u8 {
                    // (In the order of operations of `Affine::apply`, so that a sample's result
                    // does not depend on the code path.)
                    let base = grid_primitive
                        .to_local
                        .at(first[1] + f64::from(y) * step, first[2] + f64::from(z) * step);
                    let mut row = 0;
                    for x in 0..4u8 {
                        let at = first[0] + f64::from(x) * step;
                        let local = [0, 1, 2].map(|axis| rows[axis][0] * at + base[axis]);
                        row |= usize::from(shape.has(local)) << x;
                    }
                    let shift = (y & 1) << 1 | (y >> 1) << 4 | (z & 1) << 2 | (z >> 1) << 5;
                    *word |= SPREAD[row] << shift;
                }
            }
        }
        bits
    }
}

/// Spreads four bits along x into Z order.
const SPREAD: [u64; 16] = {
    let mut spread = [0; 16];
    let mut row = 0;
    while row < 16 {
        let bit = row as u64;
        spread[row] = bit & 3 | (bit & 4) << 6 | (bit & 8) << 6;
        row += 1;
    }
    spread
};
