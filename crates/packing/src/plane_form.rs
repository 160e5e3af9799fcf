//! Planes of a level, in coding order, and the features that predict them.
//!
//! Opposite children are coded consecutively (0 and 7, 1 and 6, ...), so that later ones lie
//! between finished ones. Order, features and weights are empirical, from elevation rasters and
//! photographs. All of them are part of the format (tables of section 39 of formats.md), so they
//! must not change.

/// Child of a neighbour, and the offset to that neighbour.
type NearChild = (usize, [isize; 3]);

/// Plane of children, and the features that predict it.
pub(crate) struct Plane {
    pub(crate) child: usize,
    /// Siblings whose deviations are features, and their default weights in 16ths.
    pub(crate) own: &'static [(usize, i8)],
    /// Children of neighbours whose deviations are features: single ones, or pairs that share a
    /// default weight in 16ths.
    pub(crate) near: &'static [(&'static [NearChild], i8)],
    /// Base-2 logarithm of the weight of each sibling's deviation in the expected size, in 64ths.
    ///
    /// The expected size is the expected magnitude of a residual, in 64ths of the unit of numbers.
    /// It is a weighted sum of magnitudes: deviations of siblings (together a quarter to three
    /// quarters of their mean), deviations of neighbours' children (a 16th each), and unevenness
    /// of the parents (a 64th). Weights are powers of two, so that they are shifts.
    pub(crate) own_size: u32,
}

/// Base-2 logarithm of the weight of the deviation of each neighbour's child in the expected size,
/// in 64ths.
pub(crate) const NEAR_SIZE: u32 = 2;

const QUAD_PLANES: [Plane; 4] = [
    Plane { child: 0, own: &[], near: &[], own_size: 0 },
    Plane {
        child: 3,
        own: &[(0, -12)],
        near: &[(&[(0, [1, 0, 0]), (0, [0, 1, 0])], 0), (&[(0, [1, 1, 0])], 0)],
        own_size: 5,
    },
    Plane {
        child: 1,
        own: &[(0, -4), (3, -8)],
        near: &[(&[(0, [1, 0, 0]), (3, [0, -1, 0])], 2), (&[(0, [0, 1, 0]), (3, [-1, 0, 0])], 0)],
        own_size: 4,
    },
    Plane {
        child: 2,
        own: &[(0, -8), (3, -8), (1, -11)],
        near: &[(&[(0, [0, 1, 0]), (3, [-1, 0, 0])], 1)],
        own_size: 3,
    },
];

const OCT_PLANES: [Plane; 8] = [
    Plane { child: 0, own: &[], near: &[], own_size: 0 },
    Plane { child: 7, own: &[(0, -12)], near: &[(&[(0, [1, 1, 1])], 0)], own_size: 5 },
    Plane { child: 1, own: &[(0, 1), (7, -3)], near: &[(&[(0, [1, 0, 0])], 2)], own_size: 4 },
    Plane { child: 6, own: &[(1, -10), (7, 1)], near: &[(&[(7, [-1, 0, 0])], 2)], own_size: 3 },
    Plane { child: 2, own: &[(0, 1), (7, -1), (6, 1)], near: &[(&[(0, [0, 1, 0])], 2)], own_size: 3 },
    Plane { child: 5, own: &[(2, -10), (7, 1)], near: &[(&[(7, [0, -1, 0])], 2)], own_size: 3 },
    Plane {
        child: 3,
        own: &[(7, 4), (1, 4), (2, 4), (0, -4), (6, -4), (5, -4)],
        near: &[(&[(7, [0, 0, -1])], 2)],
        own_size: 3,
    },
    Plane {
        child: 4,
        own: &[(3, -11), (0, -2), (7, -2), (1, -2), (6, -2), (2, -2), (5, -2)],
        near: &[(&[(0, [0, 0, 1])], 1)],
        own_size: 2,
    },
];

/// Returns the planes of trees with so many axes, in coding order.
pub(crate) fn planes(axes: usize) -> &'static [Plane] {
    if axes == 2 { &QUAD_PLANES } else { &OCT_PLANES }
}

/// Maximum number of features of a plane.
pub(crate) const MAX_FEATURES: usize = 16;
/// Bits of a stored weight of a feature.
pub(crate) const WEIGHT_BITS: u32 = 6;

/// Weights of the features of all planes, in 16ths.
pub(crate) type Weights = [[i8; MAX_FEATURES]; 8];

impl Plane {
    /// Returns the number of features: slopes, the mixed second difference (in quadtrees),
    /// curvatures, siblings, and neighbours' children.
    pub(crate) fn features(&self, axes: usize) -> usize {
        2 * axes + usize::from(axes == 2) + self.own.len() + self.near.len()
    }
}

/// Returns the weights if none are stored: linear interpolation, corrected by the deviations of
/// siblings and neighbours' children.
pub(crate) fn default_weights(axes: usize) -> Weights {
    let mut all = [[0; MAX_FEATURES]; 8];
    for (plane, weights) in planes(axes).iter().zip(&mut all) {
        let sign = |axis: usize| if plane.child >> axis & 1 == 1 { 1 } else { -1 };
        let slopes = (0..axes).map(|axis| 16 * sign(axis));
        let across = (axes == 2).then(|| 16 * sign(0) * sign(1));
        let curved = (0..axes).map(|_| 0);
        let others =
            plane.own.iter().map(|(_, weight)| *weight).chain(plane.near.iter().map(|(_, weight)| *weight));
        let features = slopes.chain(across).chain(curved).chain(others);
        weights.iter_mut().zip(features).for_each(|(weight, feature)| *weight = feature);
    }
    all
}

/// Fraction bits and weights with which the nodes of a channel are predicted.
#[derive(Clone, Copy)]
pub(crate) struct Predictor {
    /// Fraction bits of features, at least [`MIN_FRACTION`].
    pub(crate) fraction: u32,
    pub(crate) weights: Weights,
}

/// Minimum number of fraction bits of features. Predictions have this many fewer than features:
/// [`crate::lanes::Lane::times`] drops them.
pub(crate) const MIN_FRACTION: u32 = 2;
pub(crate) const MAX_FRACTION: u32 = 6;
