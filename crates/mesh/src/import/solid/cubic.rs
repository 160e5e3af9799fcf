//! Interpolation in cubes by polynomials that are cubic along each axis.
//!
//! A cube has values at 4 x 4 x 4 nodes. Positions are relative to its centre, in half widths of
//! the cube.

/// Nodes along an axis.
pub(super) const NODES: usize = 4;
/// Nodes of a cube, x fastest, then y, then z.
pub(super) const ALL: usize = NODES * NODES * NODES;
/// Chebyshev nodes.
pub(super) const CHEBYSHEV: [f64; NODES] =
    [-0.923_879_532_511_286_7, -0.382_683_432_365_089_8, 0.382_683_432_365_089_8, 0.923_879_532_511_286_7];

/// Lagrange weights of the nodes along an axis at a position.
pub(super) fn weights(nodes: &[f64; NODES], at: f64) -> [f32; NODES] {
    std::array::from_fn(|node| {
        let others = (0..NODES).filter(|other| *other != node);
        others.map(|other| (at - nodes[other]) / (nodes[node] - nodes[other])).product::<f64>() as f32
    })
}

/// Interpolates values at a lattice of points. `weights` are the nodes' weights for the lattice
/// points along each axis. The result has x fastest, then y, then z.
pub(super) fn interpolate(nodes: &[f32; ALL], weights: [&[[f32; NODES]]; 3]) -> Vec<f32> {
    let [along_x, along_y, along_z] = weights;
    let mut values = Vec::with_capacity(along_x.len() * along_y.len() * along_z.len());
    for z in along_z {
        let plane: [f32; NODES * NODES] =
            std::array::from_fn(|at| (0..NODES).map(|k| z[k] * nodes[k * NODES * NODES + at]).sum());
        for y in along_y {
            let [a, b, c, d]: [f32; NODES] =
                std::array::from_fn(|at| (0..NODES).map(|k| y[k] * plane[k * NODES + at]).sum());
            values.extend(along_x.iter().map(|x| x[0] * a + x[1] * b + x[2] * c + x[3] * d));
        }
    }
    values
}

/// Interpolation between the centres of a cube's cells.
#[derive(Debug)]
pub(super) struct Cubic {
    /// Cells along an axis that are nodes: the closest ones to the Chebyshev nodes.
    pub(super) cells: [usize; NODES],
    /// Weights of the nodes for each cell along an axis.
    pub(super) weights: Vec<[f32; NODES]>,
    /// Bound of the sum of all nodes' absolute weights at a point (Lebesgue constant).
    pub(super) sum: f32,
    /// Error bound for a function whose fourth derivatives along the axes are at most 24, with a
    /// half width of 1.
    pub(super) spread: f64,
    nodes: [f64; NODES],
}

impl Cubic {
    /// Minimum height of a cube for interpolation: it then has twice as many cells along an axis as
    /// nodes.
    pub(super) const LEAST: u8 = 3;

    /// Interpolation in a cube of `2^height` cells along each axis.
    pub(super) fn new(height: u8) -> Cubic {
        let side = 1usize << height;
        let place = |cell: usize| (2 * cell + 1) as f64 / side as f64 - 1.0;
        let cells = CHEBYSHEV.map(|node| (((node + 1.0) * side as f64 - 1.0) / 2.0).round() as usize);
        let nodes = cells.map(place);
        let weights: Vec<_> = (0..side).map(|cell| weights(&nodes, place(cell))).collect();
        let product = |cell: usize| nodes.iter().map(|node| (place(cell) - node).abs()).product::<f64>();
        let furthest = (0..side).map(product).fold(0.0, f64::max);
        let sum = |weights: &[f32; NODES]| weights.iter().map(|weight| weight.abs()).sum::<f32>();
        let sum = weights.iter().map(sum).fold(0.0, f32::max);
        let spread = furthest * f64::from(1.0 + sum + sum * sum);
        Cubic { cells, weights, sum: sum * sum * sum, spread, nodes }
    }

    /// Weights of the nodes at a lattice with `points` points per cell along an axis.
    pub(super) fn finer(&self, points: usize) -> Vec<[f32; NODES]> {
        let count = self.weights.len() * points;
        (0..count).map(|at| weights(&self.nodes, (2 * at + 1) as f64 / count as f64 - 1.0)).collect()
    }

    /// Interpolates the values of all cells from those at the nodes; x fastest, then y, then z.
    pub(super) fn values(&self, nodes: &[f32; ALL]) -> Vec<f32> {
        interpolate(nodes, [&self.weights; 3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_functions_are_interpolated_and_others_within_the_bound() {
        for height in Cubic::LEAST..=6 {
            let (cubic, side) = (Cubic::new(height), 1usize << height);
            let place = |cell: usize| (2 * cell + 1) as f64 / side as f64 - 1.0;
            let exact = |[x, y, z]: [f64; 3]| (x * x * x - y) * (1.0 + y * z) + z * z * x;
            // Its fourth derivatives are at most 24.
            let wave = |[x, y, z]: [f64; 3]| (x + y - z + 0.3).sin() * 24.0;
            for (function, bound) in [(&exact as &dyn Fn([f64; 3]) -> f64, 0.0), (&wave, cubic.spread)] {
                let node = |number: usize| {
                    let at = [number % NODES, number / NODES % NODES, number / NODES / NODES];
                    function(at.map(|at| place(cubic.cells[at]))) as f32
                };
                let values = cubic.values(&std::array::from_fn(node));
                let finer = interpolate(&std::array::from_fn(node), [&cubic.finer(1); 3]);
                for (number, value) in values.iter().enumerate() {
                    let at = [number % side, number / side % side, number / side / side].map(place);
                    let off = (f64::from(*value) - function(at)).abs();
                    assert!(off <= bound + 1e-4, "{height} {at:?}: {off}");
                    assert!((finer[number] - value).abs() < 1e-4);
                }
            }
        }
    }
}
