//! Interpolation in cubes of cells, by cubic polynomials along each axis.

/// The least levels of a cube that can be interpolated: it has twice as many cells along an axis as nodes.
pub(super) const LEAST: u8 = 3;
/// Nodes along an axis.
const NODES: usize = 4;
/// Nodes of a cube.
pub(super) const ALL: usize = NODES * NODES * NODES;

/// Interpolation between the centres of a cube's cells.
#[derive(Debug)]
pub(super) struct Cubic {
    /// The cells along an axis that are nodes: as near as cells are to Chebyshev's.
    nodes: [usize; NODES],
    /// The nodes' weights for each cell along an axis.
    weights: Vec<[f32; NODES]>,
    /// See [`Cubic::spread`].
    spread: f32,
}

impl Cubic {
    /// Interpolation in a cube of `2^height` cells along each axis.
    pub(super) fn new(height: u8) -> Cubic {
        let side = 1usize << height;
        let node = |number: usize| {
            let angle = (2 * number + 1) as f64 * std::f64::consts::PI / (2 * NODES) as f64;
            ((1.0 - angle.cos()) * side as f64 / 2.0 - 0.5).round().max(0.0) as usize
        };
        let nodes: [usize; NODES] = std::array::from_fn(node);
        let away = |cell: usize, other: usize| cell as f64 - other as f64;
        let weight = |cell: usize, node: usize| -> f64 {
            let others = nodes.iter().filter(|other| **other != node);
            others.map(|other| away(cell, *other) / away(node, *other)).product()
        };
        let weights: Vec<[f64; NODES]> = (0..side).map(|cell| nodes.map(|node| weight(cell, node))).collect();
        let product = |cell: usize| nodes.iter().map(|node| away(cell, *node)).product::<f64>().abs();
        let furthest = (0..side).map(product).fold(0.0, f64::max);
        let sum = |weights: &[f64; NODES]| weights.iter().map(|weight| weight.abs()).sum::<f64>();
        let sums = weights.iter().map(sum).fold(0.0, f64::max);
        let spread = furthest * (1.0 + sums + sums * sums);
        let weights = weights.iter().map(|weights| weights.map(|weight| weight as f32)).collect();
        Cubic { nodes, weights, spread: spread as f32 }
    }

    /// Bound of the error for a function whose fourth derivatives along the axes are at most 24.
    pub(super) fn spread(&self) -> f32 {
        self.spread
    }

    /// The cells that are nodes, x fastest, then y, then z.
    pub(super) fn cells(&self) -> impl Iterator<Item = [usize; 3]> {
        let at = |number: usize| self.nodes[number % NODES];
        (0..ALL).map(move |number| [at(number), at(number / NODES), at(number / (NODES * NODES))])
    }

    /// Values of all cells from those at the nodes, x fastest, then y, then z.
    pub(super) fn values(&self, nodes: &[f32; ALL]) -> Vec<f32> {
        let side = self.weights.len();
        let mut values = Vec::with_capacity(side * side * side);
        for z in &self.weights {
            let plane: [f32; NODES * NODES] =
                std::array::from_fn(|at| (0..NODES).map(|k| z[k] * nodes[k * NODES * NODES + at]).sum());
            for y in &self.weights {
                let line: [f32; NODES] =
                    std::array::from_fn(|at| (0..NODES).map(|k| y[k] * plane[k * NODES + at]).sum());
                values.extend(
                    self.weights
                        .iter()
                        .map(|x| x[0] * line[0] + x[1] * line[1] + x[2] * line[2] + x[3] * line[3]),
                );
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_functions_are_interpolated_and_others_within_the_bound() {
        for height in LEAST..=6 {
            let (cubic, side) = (Cubic::new(height), 1usize << height);
            let cell = |number: usize| {
                [number % side, number / side % side, number / side / side].map(|x| x as f64 / side as f64)
            };
            let exact = |[x, y, z]: [f64; 3]| (x * x * x - y) * (1.0 + y * z) + z * z * x;
            // Its fourth derivatives are at most 1 in cells: 24 times a 24th.
            let scale = 1.0 / side as f64;
            let wave = |[x, y, z]: [f64; 3]| ((x + y - z) / scale * 0.5).sin() * 16.0;
            for (function, bound) in
                [(&exact as &dyn Fn([f64; 3]) -> f64, 0.0), (&wave, cubic.spread() / 24.0)]
            {
                let mut nodes = [0.0; ALL];
                for (node, at) in nodes.iter_mut().zip(cubic.cells()) {
                    *node = function(at.map(|x| x as f64 / side as f64)) as f32;
                }
                let values = cubic.values(&nodes);
                for (number, value) in values.iter().enumerate() {
                    let off = (f64::from(*value) - function(cell(number))).abs();
                    assert!(off <= f64::from(bound) + 1e-4, "{height} {number}: {off}");
                }
            }
        }
    }
}
