//! The nearest point of a model's surface: cells in the order of their distances.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::nearest::{Nearest, nearest_on_face};
use super::visited::{Recent, Visited};
use crate::Result;
use crate::brep::{ExactModel, FaceBuffer, Faces, Node, NodeState};

/// A point of a model's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point in the world.
    pub point: [f64; 3],
    /// Its distance from where it was asked for, in units of the world.
    pub distance: f64,
    /// Number of the face on which it lies.
    pub face: u64,
    /// What was looked at for it.
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

    /// The nearest point of the surface as [`ExactModel::nearest`], if it is no farther than so much.
    ///
    /// # Errors
    /// As [`ExactModel::nearest`].
    pub fn nearest_within(&self, to: [f64; 3], most: f64) -> Result<Option<SurfacePoint>> {
        let grid = self.grid();
        let from = grid.to_grid(to);
        if from.iter().any(|at| !at.is_finite()) {
            return Ok(None);
        }
        let limit = (most / grid.width()).powi(2);
        let mut visited = Visited::default();
        let (mut recent, mut buffer) = (Recent::new(), FaceBuffer::default());
        let mut best: Option<Nearest> = None;
        let mut open = BinaryHeap::new();
        let root = self.root()?;
        open.push(Open { distance: self.distance_squared(&root, from), node: root });
        while let Some(Open { distance, node }) = open.pop() {
            if distance > best.map_or(limit, |best| best.distance_squared) {
                break;
            }
            visited.nodes += 1;
            if let Some(children) = self.children(&node)? {
                let most = best.map_or(limit, |best| best.distance_squared);
                for node in children {
                    if matches!(node.state(), NodeState::Inner | NodeState::Leaf { .. }) {
                        let distance = self.distance_squared(&node, from);
                        if distance <= most {
                            open.push(Open { distance, node });
                        }
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

    /// Square of the distance of a node's cell, in grid steps.
    fn distance_squared(&self, node: &Node<'_>, from: [f64; 3]) -> f64 {
        let [min, max] = node.bounds(self.grid());
        let along = |axis: usize| {
            let (low, high) = (min[axis] as f64 / 2.0, max[axis] as f64 / 2.0);
            (low - from[axis]).max(from[axis] - high).max(0.0)
        };
        let [x, y, z] = [0, 1, 2].map(along);
        x * x + y * y + z * z
    }
}

/// A node that is still to be visited.
struct Open<'a> {
    distance: f64,
    node: Node<'a>,
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
