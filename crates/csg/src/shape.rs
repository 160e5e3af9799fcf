//! Primitives in local coordinates: point tests, extents and classification of boxes.

use crate::box_state::BoxState;
use std::sync::Arc;

use crate::outline::Outline;
use crate::patches::{FacetTree, Shell};

/// A primitive in local coordinates.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// A box between two corners.
    Block { min: [f64; 3], max: [f64; 3] },
    /// A ball around the origin.
    Ball { radius: f64 },
    /// A truncated cone between z = 0 and `height`, with a radius at each end; a cylinder if they
    /// are equal.
    Cone { radii: [f64; 2], height: f64 },
    /// A torus around the z axis.
    Torus { ring: f64, tube: f64 },
    /// The points with z <= 0.
    HalfSpace,
    /// An outline in x and y, extruded between two heights.
    Prism { outline: Outline, heights: [f64; 2] },
    /// An outline in radius and z, revolved around the z axis.
    Revolved { outline: Outline },
    /// A solid in a shell of Bezier patches. Points and boxes are tested against facets, which
    /// [`BoundedSolid::facet_patches`](crate::bounded_solid::BoundedSolid::facet_patches) makes.
    Patches { shell: Arc<Shell>, facets: Arc<FacetTree> },
}

/// An interval: minimum and maximum.
pub(crate) type Interval = [f64; 2];

impl Shape {
    /// Returns the maximum magnitude of its numbers, which bounds rounding errors.
    pub(crate) fn magnitude(&self) -> f64 {
        let most = |numbers: &[f64]| numbers.iter().fold(0.0, |most: f64, number| most.max(number.abs()));
        match self {
            Shape::Block { min, max } => most(min).max(most(max)),
            Shape::Ball { radius } => *radius,
            Shape::Cone { radii, height } => most(radii).max(*height),
            Shape::Torus { ring, tube } => ring + tube,
            Shape::HalfSpace => 0.0,
            Shape::Prism { outline, heights } => outline.magnitude().max(most(heights)),
            Shape::Revolved { outline } => outline.magnitude(),
            Shape::Patches { shell, .. } => shell.points().map(|point| most(point)).fold(0.0, f64::max),
        }
    }

    /// Whether a point is inside. Faces at the minimum coordinates belong to blocks, prisms and
    /// cylinders, faces at the maximum do not. So each point on a common face is in exactly one of
    /// two adjacent shapes.
    // (Inlined because it is called for each sample.)
    #[inline(always)]
    pub(crate) fn has(&self, [x, y, z]: [f64; 3]) -> bool {
        match self {
            Shape::Block { min, max } => {
                (x >= min[0]) & (x < max[0]) & (y >= min[1]) & (y < max[1]) & (z >= min[2]) & (z < max[2])
            }
            Shape::Ball { radius } => x * x + y * y + z * z < radius * radius,
            Shape::Cone { radii: [low, high], height } => {
                let radius = low + (high - low) * (z / height);
                (z >= 0.0) & (z < *height) & (x * x + y * y < radius * radius)
            }
            Shape::Torus { ring, tube } => {
                let radial = (x * x + y * y).sqrt() - ring;
                radial * radial + z * z < tube * tube
            }
            Shape::HalfSpace => z <= 0.0,
            Shape::Prism { outline, heights } => z >= heights[0] && z < heights[1] && outline.has([x, y]),
            Shape::Revolved { outline } => outline.has([(x * x + y * y).sqrt(), z]),
            Shape::Patches { facets, .. } => facets.has([x, y, z]),
        }
    }

    /// Classifies a box, given by its centre and half widths, which include a margin for rounding.
    /// Uniform results are certain; mixed ones may not be.
    pub(crate) fn classify(&self, centre: [f64; 3], half: [f64; 3]) -> BoxState {
        let along: [Interval; 3] =
            [0, 1, 2].map(|axis| [centre[axis] - half[axis], centre[axis] + half[axis]]);
        match self {
            Shape::Block { min, max } => {
                all(&[0, 1, 2].map(|axis| between(along[axis], [min[axis], max[axis]])))
            }
            Shape::Ball { radius } => {
                let [low, high] = distance(&along);
                below([low - radius, high - radius])
            }
            Shape::Cone { radii: [low, high], height } => {
                let [near, far] = distance(&along[..2]);
                let at = |z: f64| low + (high - low) * (z.clamp(0.0, *height) / height);
                let [one, other] = along[2].map(at);
                let inside = below([near - one.max(other), far - one.min(other)]);
                all(&[between(along[2], [0.0, *height]), inside])
            }
            Shape::Torus { ring, tube } => {
                let radial = distance(&along[..2]).map(|far| far - ring);
                let [low, high] = distance(&[radial, along[2]]);
                below([low - tube, high - tube])
            }
            Shape::HalfSpace => below(along[2]),
            Shape::Prism { outline, heights } => match between(along[2], *heights) {
                BoxState::Void => BoxState::Void,
                z => all(&[z, outline.classify([centre[0], centre[1]], [half[0], half[1]])]),
            },
            Shape::Revolved { outline } => {
                let [near, far] = distance(&along[..2]);
                outline.classify([(near + far) / 2.0, centre[2]], [(far - near) / 2.0, half[2]])
            }
            Shape::Patches { facets, .. } => facets.classify(centre, half),
        }
    }

    /// Returns the extent in a direction: minimum and maximum scalar product with it.
    pub(crate) fn reach(&self, direction: [f64; 3]) -> Interval {
        let [x, y, z] = direction;
        let across = (x * x + y * y).sqrt();
        let length = (across * across + z * z).sqrt();
        let around = |far: f64| [-far, far];
        let hull = |points: &mut dyn Iterator<Item = Interval>| {
            points.fold([f64::INFINITY, f64::NEG_INFINITY], |all: Interval, [low, high]| {
                [all[0].min(low), all[1].max(high)]
            })
        };
        match self {
            Shape::Block { min, max } => {
                let ends = |axis: usize| [min[axis] * direction[axis], max[axis] * direction[axis]];
                (0..3).map(ends).fold([0.0; 2], |[low, high], [a, b]| [low + a.min(b), high + a.max(b)])
            }
            Shape::Ball { radius } => around(radius * length),
            Shape::Cone { radii, height } => {
                let disc = |end: usize| {
                    let middle = [0.0, *height][end] * z;
                    [middle - radii[end] * across, middle + radii[end] * across]
                };
                hull(&mut (0..2).map(disc))
            }
            Shape::Torus { ring, tube } => around(ring * across + tube * length),
            Shape::HalfSpace if across > 0.0 || z == 0.0 => around(f64::INFINITY),
            Shape::HalfSpace => {
                if z > 0.0 {
                    [f64::NEG_INFINITY, 0.0]
                } else {
                    [0.0, f64::INFINITY]
                }
            }
            Shape::Prism { outline, heights } => {
                let points = outline.rings.iter().flat_map(|ring| &ring.points);
                let [low, high] = hull(&mut points.map(|[a, b]| [a * x + b * y; 2]));
                let [one, other] = heights.map(|height| height * z);
                [low + one.min(other), high + one.max(other)]
            }
            Shape::Revolved { outline } => {
                let points = outline.rings.iter().flat_map(|ring| &ring.points);
                hull(&mut points.map(|[radius, at]| [at * z - radius * across, at * z + radius * across]))
            }
            Shape::Patches { shell, .. } => {
                hull(&mut shell.hull.iter().map(|[a, b, c]| [a * x + b * y + c * z; 2]))
            }
        }
    }
}

/// Classifies an interval of a function that is negative inside.
fn below([low, high]: Interval) -> BoxState {
    if low > 0.0 {
        BoxState::Void
    } else if high < 0.0 {
        BoxState::Full
    } else {
        BoxState::Mixed
    }
}

/// Classifies an interval relative to the inside range from `min` to `max`.
fn between([low, high]: Interval, [min, max]: Interval) -> BoxState {
    if high < min || low > max {
        BoxState::Void
    } else if low > min && high < max {
        BoxState::Full
    } else {
        BoxState::Mixed
    }
}

/// Returns the classification for an intersection.
fn all(states: &[BoxState]) -> BoxState {
    if states.contains(&BoxState::Void) {
        BoxState::Void
    } else if states.contains(&BoxState::Mixed) {
        BoxState::Mixed
    } else {
        BoxState::Full
    }
}

/// Returns the minimum and maximum distance of a box from the origin.
fn distance(along: &[Interval]) -> Interval {
    let nearest = |[low, high]: &Interval| if *low > 0.0 { *low } else { (-high).max(0.0) };
    let farthest = |[low, high]: &Interval| high.max(-low);
    let length =
        |of: &dyn Fn(&Interval) -> f64| along.iter().map(|along| of(along).powi(2)).sum::<f64>().sqrt();
    [length(&nearest), length(&farthest)]
}
