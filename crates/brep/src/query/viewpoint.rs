//! Surfaces for a viewpoint: as fine as an eye sees them, coarser with the distance.

use std::collections::HashMap;

use super::detail::{DetailSurface, add_changes, smallest_with};
use crate::store::levels::{Cluster, NEVER};
use crate::{ExactModel, Faces, Grid};
use spinney_base::{Error, Result};

/// Where a surface is seen from, and how fine it must be.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// Position of the eye in the world.
    pub eye: [f64; 3],
    /// Maximum error of the surface per distance from the eye, such as the angle of a pixel.
    pub tolerance: f64,
    /// Half-spaces of the world: the points with `a x + b y + c z + d >= 0`, for each. What is seen
    /// is in all of them. The rest of the surface is as coarse as its connection to that allows.
    pub half_spaces: Vec<[f64; 4]>,
    /// Maximum number of faces. The tolerance is increased until there are no more.
    pub faces: u64,
}

/// Minimum and maximum coordinates.
type Bounds = [[i32; 3]; 2];

/// Identity of a group: the error of the clusters that replace it, as bits, and their level. Groups
/// with equal ones are treated as one.
type GroupKey = (u32, u8);

impl ExactModel {
    /// Chooses the surface for a viewpoint. It is closed, like those of levels, and finer where the
    /// eye is near: a cluster is replaced if the error that results is at most the tolerance, times
    /// the distance between the eye and the box of all faces that are replaced. Distances less than
    /// a grid unit count as one.
    ///
    /// Reads the tables of clusters from the coarsest level to the finest one that is needed.
    ///
    /// # Errors
    /// If the file has no levels, if the coarsest one has more faces than requested, if the
    /// viewpoint is invalid, or if the file is corrupt or cannot be read.
    pub fn at_view(&self, view: &Viewpoint) -> Result<DetailSurface<'_>> {
        let levels = self.count_detail_levels()?;
        let eye = Eye::new(view, self.grid())?;
        let mut finest = 0;
        loop {
            let (surface, is_fine) = self.view_to_level(&eye, view.faces, finest)?;
            finest += 1;
            if is_fine || finest == levels {
                return Ok(surface);
            }
        }
    }

    /// Chooses the surface for a viewpoint as if a level was the finest. Returns it, and whether
    /// finer levels would not change it.
    fn view_to_level(&self, eye: &Eye, faces: u64, finest: usize) -> Result<(DetailSurface<'_>, bool)> {
        let mut clusters: Vec<(u64, Cluster)> = Vec::new();
        self.each_distinct_cluster(finest, &mut |number, cluster| {
            if cluster.replaced_at == NEVER || usize::from(cluster.replaced_at) < finest {
                clusters.push((number, cluster.clone()));
            }
            Ok(())
        })?;
        // Invariant: the box of a group contains those of the groups that its clusters were made
        // of, so that a group is replaced only if these are. Otherwise the surface would have two
        // levels in one position, or none. Clusters ascend from the coarsest level to the finest:
        // backwards, the box of a group is complete before a cluster made of it follows.
        let mut boxes: HashMap<GroupKey, Bounds> = HashMap::new();
        for (_, cluster) in clusters.iter().rev() {
            let own = boxes
                .get(&replaced_group(cluster))
                .map_or(cluster.bounds, |below| joined(below, &cluster.bounds));
            boxes.entry(own_group(cluster)).and_modify(|all| *all = joined(all, &own)).or_insert(own);
        }
        let is_finest = |cluster: &Cluster| cluster.is_in_level(finest as u8);
        let seen = |error: f32, group: GroupKey, cluster: &Cluster| {
            eye.angle(error, boxes.get(&group).unwrap_or(&cluster.bounds))
        };
        // The tolerances from which on a cluster is shown, and from which on it is replaced.
        let range = |cluster: &Cluster| {
            let from = match is_finest(cluster) {
                true => 0.0,
                false => seen(cluster.error, replaced_group(cluster), cluster),
            };
            let to = match cluster.replaced_at {
                NEVER => f64::INFINITY,
                _ => seen(cluster.limit, own_group(cluster), cluster),
            };
            let from = from.max(eye.tolerance);
            from..to.max(from)
        };
        let mut changes = Vec::new();
        for (_, cluster) in &clusters {
            add_changes(&mut changes, &range(cluster), self.faces_of(cluster));
        }
        let tolerance = smallest_with(faces, changes)?;
        let mut surface = DetailSurface::empty(self);
        let mut is_fine = true;
        for (number, cluster) in clusters.iter().filter(|(_, cluster)| range(cluster).contains(&tolerance)) {
            is_fine &= !is_finest(cluster) || eye.angle(cluster.error, &cluster.bounds) <= tolerance;
            surface.push(*number, cluster);
        }
        Ok((surface, is_fine))
    }
}

/// Returns the group that a cluster is a member of.
fn own_group(cluster: &Cluster) -> GroupKey {
    (cluster.limit.to_bits(), cluster.replaced_at)
}

/// Returns the group that a cluster replaces, together with others.
fn replaced_group(cluster: &Cluster) -> GroupKey {
    (cluster.error.to_bits(), cluster.level)
}

fn joined([low, high]: &Bounds, [other_low, other_high]: &Bounds) -> Bounds {
    let axes = [0, 1, 2];
    [axes.map(|axis| low[axis].min(other_low[axis])), axes.map(|axis| high[axis].max(other_high[axis]))]
}

/// A viewpoint in grid units.
struct Eye {
    position: [f64; 3],
    tolerance: f64,
    half_spaces: Vec<[f64; 4]>,
}

impl Eye {
    fn new(view: &Viewpoint, grid: &Grid) -> Result<Eye> {
        let Viewpoint { eye, tolerance, half_spaces, .. } = view;
        if !(*tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(Error::invalid("tolerance", tolerance.to_string(), "a number of at least 0"));
        }
        // (Products of these are finite.)
        let is_number = |number: &f64| number.abs() <= f64::from(f32::MAX);
        if !eye.iter().chain(half_spaces.as_flattened()).all(is_number) {
            let found = format!("eye {eye:?}, half-spaces {half_spaces:?}");
            return Err(Error::invalid("viewpoint", found, "finite numbers, at most 3e38"));
        }
        let half_spaces = half_spaces.iter().map(|[a, b, c, d]| {
            let origin = grid.to_world([0; 3]);
            let constant = a * origin[0] + b * origin[1] + c * origin[2] + d;
            let [a, b, c] = [a, b, c].map(|factor| factor * grid.width());
            [a, b, c, constant]
        });
        Ok(Eye {
            position: grid.to_grid(*eye),
            tolerance: tolerance.abs(),
            half_spaces: half_spaces.collect(),
        })
    }

    /// Returns the largest angle that an error in a box has, seen from the eye; 0 if the box is not
    /// seen. Never less for a box that contains this one, or for a larger error.
    fn angle(&self, error: f32, bounds: &Bounds) -> f64 {
        let [low, high] = bounds.map(|corner| corner.map(f64::from));
        let is_seen = self.half_spaces.iter().all(|[a, b, c, d]| {
            let most = |axis: usize, factor: &f64| (factor * low[axis]).max(factor * high[axis]);
            most(0, a) + most(1, b) + most(2, c) + d >= 0.0
        });
        if !is_seen {
            return 0.0;
        }
        let gaps = [0, 1, 2]
            .map(|axis| (low[axis] - self.position[axis]).max(self.position[axis] - high[axis]).max(0.0));
        let distance = gaps.iter().map(|gap| gap * gap).sum::<f64>().sqrt();
        f64::from(error) / distance.max(1.0)
    }
}
