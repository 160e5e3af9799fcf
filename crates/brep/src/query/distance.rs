//! The nearest point of a model's surface: cells in the order of their distances.

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
    /// The point in the world.
    pub point: [f64; 3],
    /// Its distance from where it was asked for, in units of the world.
    pub distance: f64,
    /// Number of the face on which it lies.
    pub face: u64,
    /// Nodes and faces that were looked at for it.
    pub visited: Visited,
}

impl ExactModel {
    /// The point of the surface that is nearest to a point of the world; of several it is that of the face with the least
    /// number, as far as their distances do not differ by rounding. `None` without faces, or if the point is no number.
    ///
    /// Distance and point are rounded as [`nearest_on_face`] and a point's way to the grid and back are: the error is some
    /// 2^-48 of the coordinates and the distance. Only cells are visited that are nearer than the surface, and faces in
    /// them.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub fn nearest(&self, to: [f64; 3]) -> Result<Option<SurfacePoint>> {
        self.nearest_within(to, f64::INFINITY)
    }

    /// The distance of a point of the world from the surface, as [`ExactModel::nearest`] tells it: negative inside, 0 on the
    /// surface, infinite without faces.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub fn signed_distance(&self, from: [f64; 3]) -> Result<f64> {
        let distance = self.nearest(from)?.map_or(f64::INFINITY, |nearest| nearest.distance);
        Ok(match self.locate(from)? {
            Location::Outside => distance,
            Location::Inside => -distance,
            Location::Boundary => 0.0,
        })
    }

    /// The nearest point of the surface as [`ExactModel::nearest`], if it is no farther than so much.
    ///
    /// # Errors
    /// Those of [`ExactModel::nearest`].
    pub fn nearest_within(&self, to: [f64; 3], most: f64) -> Result<Option<SurfacePoint>> {
        let grid = self.grid();
        let from = grid.to_grid(to);
        if from.iter().any(|at| !at.is_finite()) {
            return Ok(None);
        }
        run_batched(|| self.nearest_from(from, most))
    }

    /// The nearest point of the surface to a place of the grid, if it is no farther than so much in the world.
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
                    // (Before the child is looked up, which takes longer.)
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

/// Square of the distance of a box in half steps, in grid steps.
fn distance_squared([min, max]: [[i64; 3]; 2], from: [f64; 3]) -> f64 {
    let along = |axis: usize| {
        let (low, high) = (min[axis] as f64 / 2.0, max[axis] as f64 / 2.0);
        (low - from[axis]).max(from[axis] - high).max(0.0)
    };
    let [x, y, z] = [0, 1, 2].map(along);
    x * x + y * y + z * z
}

/// Square of the distance of the least box around corners, less what is rounded of a face's.
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

/// A node that is still to be visited.
struct Open<'a> {
    distance: f64,
    node: ModelNode<'a>,
}

/// The nearest is the greatest, as heaps have it.
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
