//! Surfaces by tolerance: of the clusters that replace each other, those whose error has at most a
//! size, which may depend on their position.

use std::collections::HashMap;
use std::ops::Range;

use super::model_surface::ModelSurface;
use crate::ExactModel;
use crate::boxes::{Bounds, union};
use crate::store::levels::{Cluster, NEVER};
use spinney_base::{Error, Result, sort};

/// Size of an error in a box of the grid.
pub(super) type Size<'f> = dyn Fn(f32, &Bounds) -> f64 + 'f;

/// Identity of a group: the error of the clusters that replace it, as bits, and their level. Groups
/// with equal ones are treated as one.
type GroupKey = (u32, u8);

impl ExactModel {
    /// Returns the smallest error for which the surface has at most `most` faces. Reads the tables
    /// from the coarsest level to the finest one that is needed.
    pub(super) fn error_for(&self, most: u64) -> Result<f64> {
        // (The surface has no level whose faces are too many.)
        let last = self.levels().len() - 1;
        let first = self.levels().iter().position(|level| level.faces > most).unwrap_or(last);
        Ok(self.within_tolerance(&|error, _| error.into(), 0.0, most, first)?.1)
    }

    /// Chooses the surface of the smallest tolerance, of at least `least`, that has at most `most`
    /// faces; also returns this tolerance. `size` is the size of an error in a box, which must not
    /// exceed the tolerance. It is never less for a box that contains another, or for a larger
    /// error. Reads the tables of level `first`, and of finer ones that are needed.
    pub(super) fn within_tolerance(
        &self,
        size: &Size<'_>,
        least: f64,
        most: u64,
        first: usize,
    ) -> Result<(ModelSurface<'_>, f64)> {
        let mut finest = first;
        loop {
            let (surface, tolerance, is_fine) = self.within_tolerance_at(size, least, most, finest)?;
            finest += 1;
            if is_fine || finest >= self.levels().len() {
                return Ok((surface, tolerance));
            }
        }
    }

    /// Chooses a surface as [`ExactModel::within_tolerance`] does, as if a level was the finest.
    /// Also returns the tolerance, and whether finer levels would not change the surface.
    fn within_tolerance_at(
        &self,
        size: &Size<'_>,
        least: f64,
        most: u64,
        finest: usize,
    ) -> Result<(ModelSurface<'_>, f64, bool)> {
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
                .map_or(cluster.bounds, |below| union(cluster.bounds, below));
            boxes.entry(own_group(cluster)).and_modify(|all| *all = union(*all, &own)).or_insert(own);
        }
        let is_finest = |cluster: &Cluster| cluster.is_in_level(finest as u8);
        let seen = |error: f32, group: GroupKey, cluster: &Cluster| {
            size(error, boxes.get(&group).unwrap_or(&cluster.bounds))
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
            let from = from.max(least);
            from..to.max(from)
        };
        let mut changes = Vec::new();
        for (_, cluster) in &clusters {
            add_changes(&mut changes, &range(cluster), self.faces_of(cluster));
        }
        let tolerance = smallest_with(most, changes)?;
        let mut surface = ModelSurface::without_clusters(self);
        let mut is_fine = true;
        for (number, cluster) in clusters.iter().filter(|(_, cluster)| range(cluster).contains(&tolerance)) {
            is_fine &= !is_finest(cluster) || size(cluster.error, &cluster.bounds) <= tolerance;
            surface.push(*number, cluster);
        }
        Ok((surface, tolerance, is_fine))
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

/// Adds the numbers at which the faces of a range are added and removed, as sortable bits: the
/// numbers are not negative.
fn add_changes(changes: &mut Vec<(u64, i64)>, range: &Range<f64>, faces: u64) {
    changes.extend([(range.start.to_bits(), faces as i64), (range.end.to_bits(), -(faces as i64))]);
}

/// Returns the smallest finite number for which the ranges that contain it have at most `most`
/// faces.
fn smallest_with(most: u64, mut changes: Vec<(u64, i64)>) -> Result<f64> {
    if changes.is_empty() {
        // A model without faces.
        return Ok(0.0);
    }
    sort::by_key(&mut changes, |change| change.0);
    let (mut faces, mut fewest) = (0, i64::MAX);
    for same in changes.chunk_by(|a, b| a.0 == b.0) {
        faces += same.iter().map(|change| change.1).sum::<i64>();
        let number = f64::from_bits(same[0].0);
        if !number.is_finite() {
            break;
        }
        if u64::try_from(faces).is_ok_and(|faces| faces <= most) {
            return Ok(number);
        }
        fewest = fewest.min(faces);
    }
    let expected = format!("at least {fewest}, those of the coarsest level");
    Err(Error::invalid("faces", most.to_string(), expected))
}
