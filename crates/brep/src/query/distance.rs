//! The nearest point of a model's surface: visits cells in the order of their distances.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::contains::Location;
use super::nearest::{Nearest, nearest_on_face};
use super::visited::{Recent, Visited, half_of};
use crate::exact::bounds::DISTANCE_ROUNDING;
use crate::{ExactModel, FaceBuffer, Faces, ModelNode, ModelNodeState};
use spinney_base::Result;
use spinney_base::io::batch::run_batched;

/// A point of a model's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point, in world coordinates.
    pub point: [f64; 3],
    /// Its distance from the query point, in world units.
    pub distance: f64,
    /// Number of the face that contains it.
    pub face: u64,
    /// Nodes and faces visited.
    pub visited: Visited,
}

impl ExactModel {
    /// Returns the point of the surface that is nearest to a point of the world. If several are
    /// equally near, except for rounding, it is that of the face with the smallest number. Returns
    /// `None` without faces, or if the point is not finite.
    ///
    /// Distance and point are rounded like [`nearest_on_face`] and the conversion of a point to the
    /// grid and back: the error is about 2^-48 of the coordinates and the distance. Visits only
    /// cells that are nearer than the surface, and faces in them.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn nearest(&self, to: [f64; 3]) -> Result<Option<SurfacePoint>> {
        self.nearest_within(to, f64::INFINITY)
    }

    /// Returns the signed distance of a point of the world from the surface, based on
    /// [`ExactModel::nearest`]: negative inside, 0 on the surface, infinite without faces.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn signed_distance(&self, from: [f64; 3]) -> Result<f64> {
        let distance = self.nearest(from)?.map_or(f64::INFINITY, |nearest| nearest.distance);
        Ok(match self.locate(from)? {
            Location::Outside => distance,
            Location::Inside => -distance,
            Location::Boundary => 0.0,
        })
    }

    /// Returns the nearest point of the surface as [`ExactModel::nearest`], if its distance is at
    /// most `most`.
    ///
    /// # Errors
    /// The errors of [`ExactModel::nearest`].
    pub fn nearest_within(&self, to: [f64; 3], most: f64) -> Result<Option<SurfacePoint>> {
        let grid = self.grid();
        let from = grid.to_grid(to);
        if from.iter().any(|at| !at.is_finite()) {
            return Ok(None);
        }
        run_batched(|| self.nearest_from(from, most))
    }

    /// Returns the nearest point of the surface to a point in grid units, if its world distance is
    /// at most `most`.
    fn nearest_from(&self, from: [f64; 3], most: f64) -> Result<Option<SurfacePoint>> {
        let grid = self.grid();
        let limit = (most / grid.width()).powi(2);
        let mut visited = Visited::default();
        let (mut recent, mut buffer) = (Recent::new(), FaceBuffer::default());
        let mut best: Option<Nearest> = None;
        let mut open = BinaryHeap::new();
        let root = self.root()?;
        open.push(Open { distance: distance_squared(root.bounds(grid), from), node: root });
        while let Some(Open { distance, node }) = open.pop() {
            if distance > best.map_or(limit, |best| best.distance_squared) {
                break;
            }
            visited.nodes += 1;
            if node.state() == ModelNodeState::Inner {
                let most = best.map_or(limit, |best| best.distance_squared);
                let bounds = node.bounds(grid);
                for child in 0..8 {
                    // (Tested before the child is looked up, which takes longer.)
                    let distance = distance_squared(half_of(&bounds, child), from);
                    if distance > most {
                        continue;
                    }
                    let node = self.child(&node, child)?;
                    if matches!(node.state(), ModelNodeState::Inner | ModelNodeState::Leaf { .. }) {
                        open.push(Open { distance, node });
                    }
                }
                continue;
            }
            for number in node.faces() {
                if recent.is_known(number) {
                    continue;
                }
                visited.faces += 1;
                self.face(number, &mut buffer)?;
                let most = best.map_or(limit, |best| best.distance_squared);
                if distance_of_bounds(&buffer.points, from) > most {
                    continue;
                }
                let found = nearest_on_face(&buffer.face(), from);
                let is_nearer = best.is_none_or(|best| {
                    let order = found.distance_squared.total_cmp(&best.distance_squared);
                    order.then(number.cmp(&best.face)) == Ordering::Less
                });
                if is_nearer && found.distance_squared <= limit {
                    best = Some(found);
                }
            }
        }
        Ok(best.map(|best| SurfacePoint {
            point: grid.to_world_between(best.point),
            distance: best.distance_squared.sqrt() * grid.width(),
            face: best.face,
            visited,
        }))
    }
}

/// Returns the squared distance, in grid units, of a box in half grid units.
fn distance_squared([min, max]: [[i64; 3]; 2], from: [f64; 3]) -> f64 {
    let along = |axis: usize| {
        let (low, high) = (min[axis] as f64 / 2.0, max[axis] as f64 / 2.0);
        (low - from[axis]).max(from[axis] - high).max(0.0)
    };
    let [x, y, z] = [0, 1, 2].map(along);
    x * x + y * y + z * z
}

/// Returns the squared distance of the vertices' bounding box, minus the rounding error of a face's
/// distance.
fn distance_of_bounds(points: &[[i32; 3]], from: [f64; 3]) -> f64 {
    let (mut min, mut max) = ([i32::MAX; 3], [i32::MIN; 3]);
    for point in points {
        for axis in 0..3 {
            min[axis] = min[axis].min(point[axis]);
            max[axis] = max[axis].max(point[axis]);
        }
    }
    let [min, max] = [min, max].map(|corner| corner.map(|at| 2 * i64::from(at)));
    distance_squared([min, max], from) * (1.0 - DISTANCE_ROUNDING)
}

/// A node to visit.
struct Open<'a> {
    distance: f64,
    node: ModelNode<'a>,
}

/// The nearest node is the largest, as the max-heap requires.
impl Ord for Open<'_> {
    fn cmp(&self, other: &Self) -> Ordering {
        other.distance.total_cmp(&self.distance)
    }
}

impl PartialOrd for Open<'_> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Open<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Open<'_> {}
