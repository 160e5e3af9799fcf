//! Clusters of levels of detail: which there are, and where their faces are.

use std::ops::Range;

use super::model_surface::ModelSurface;
use crate::store::levels::{Cluster, TABLE_CLUSTERS};
use crate::{ExactModel, Face, FaceBuffer, Faces, ModelNode, ModelNodeState, curve};
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::{Error, Result, sort};

impl ExactModel {
    /// Returns the surface that consists of some clusters, by their numbers in the file: those of
    /// another surface, or some of them. It is closed only if the other one is, and has no others.
    ///
    /// # Errors
    /// If there is no such cluster, or the file is corrupt or cannot be read.
    pub fn of_clusters(&self, numbers: &[u64]) -> Result<ModelSurface<'_>> {
        self.count_detail_levels()?;
        let mut numbers = numbers.to_vec();
        sort::numbers64(&mut numbers);
        numbers.dedup();
        let wrong = |number: u64| Error::invalid("cluster", number.to_string(), "the number of a cluster");
        let table_of = |number: u64| usize::try_from(number / TABLE_CLUSTERS as u64).unwrap_or(usize::MAX);
        let tables: Vec<&[u64]> = numbers.chunk_by(|a, b| table_of(*a) == table_of(*b)).collect();
        if let Some(last) = numbers.last().filter(|last| table_of(**last) >= self.cluster_tables()) {
            return Err(wrong(*last));
        }
        self.fetch(tables.iter().map(|same| table_of(same[0])), &|table| {
            self.cluster_table(table).map(drop)
        })?;
        let mut surface = ModelSurface::without_clusters(self);
        let mut order = ClusterOrder::default();
        for same in &tables {
            let table = self.cluster_table(table_of(same[0]))?;
            for number in *same {
                let cluster = table.get((number % TABLE_CLUSTERS as u64) as usize);
                let cluster = cluster.ok_or_else(|| wrong(*number))?;
                order.check(self, cluster)?;
                surface.push(*number, cluster);
            }
        }
        Ok(surface)
    }

    /// Returns the number of levels, which is not 0.
    pub(super) fn count_detail_levels(&self) -> Result<usize> {
        match self.levels().len() {
            0 => {
                let advice = "add levels with `spinney transform FILE levels -o OUTPUT`";
                Err(Error::unsupported(self.path(), "an exact model without levels of detail", advice))
            }
            levels => Ok(levels),
        }
    }

    /// Visits all clusters of a level and of all coarser levels, and perhaps others, with their
    /// numbers.
    pub(super) fn each_distinct_cluster(
        &self,
        level: usize,
        each: &mut dyn FnMut(u64, &Cluster) -> Result<()>,
    ) -> Result<()> {
        let mut order = ClusterOrder::default();
        self.each_cluster(level, &mut |number, cluster| {
            order.check(self, cluster)?;
            each(number, cluster)
        })
    }

    pub(super) fn is_exact(&self, cluster: &Cluster) -> bool {
        usize::from(cluster.level) + 1 == self.levels().len()
    }

    pub(super) fn faces_of(&self, cluster: &Cluster) -> u64 {
        let slivers = if self.is_exact(cluster) { cluster.first } else { 0 };
        u64::from(cluster.faces) + u64::from(slivers)
    }

    /// Visits the faces with an area whose positions on the curve are in a range.
    pub(super) fn each_on_curve(
        &self,
        keys: &Range<u64>,
        root: &ModelNode<'_>,
        buffer: &mut FaceBuffer,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let bits = self.grid().bits;
        let is_wanted = |level, cell| meet(keys, &curve::positions_in(level, cell, bits));
        self.each_leaf(root, &is_wanted, &mut |node| {
            // Invariant: each face is visited once. The vertex that decides its position is inside
            // of one leaf's cell, which lists the face.
            let own = curve::positions_in(node.level(), node.position(), bits);
            for number in node.faces() {
                self.face(number, buffer)?;
                let face = buffer.face();
                let key = curve::position(&face, bits);
                if keys.contains(&key) && own.contains(&key) {
                    each(&face)?;
                }
            }
            Ok(())
        })
    }

    /// Reads all that [`ExactModel::each_on_curve`] reads.
    pub(super) fn read_on_curve(&self, keys: &Range<u64>) -> Result<()> {
        let bits = self.grid().bits;
        let is_wanted = |level, cell| meet(keys, &curve::positions_in(level, cell, bits));
        self.each_leaf(&self.root()?, &is_wanted, &mut |node| {
            let mut is_unread = false;
            for number in node.faces() {
                defer_missing(self.block_of(number), &mut is_unread)?;
            }
            finish_deferred(is_unread)
        })
    }

    /// Visits the nodes without children at or below a node. Of other nodes, levels and positions
    /// decide whether they are visited. Continues with the others if bytes of one are missing.
    pub(super) fn each_leaf(
        &self,
        node: &ModelNode<'_>,
        is_wanted: &dyn Fn(u8, [u32; 3]) -> bool,
        each: &mut dyn FnMut(&ModelNode<'_>) -> Result<()>,
    ) -> Result<()> {
        if node.state() != ModelNodeState::Inner {
            return each(node);
        }
        let mut is_unread = false;
        for number in 0..8 {
            // (Decided before the child is looked up, which may read its segment.)
            let at = [0, 1, 2].map(|axis| 2 * node.position()[axis] + (number >> axis & 1) as u32);
            if is_wanted(node.level() + 1, at) {
                let child = defer_missing(self.child(node, number), &mut is_unread)?;
                let visited = child.map_or(Ok(()), |child| self.each_leaf(&child, is_wanted, each));
                defer_missing(visited, &mut is_unread)?;
            }
        }
        finish_deferred(is_unread)
    }
}

/// Whether two ranges have a number in common.
fn meet(a: &Range<u64>, b: &Range<u64>) -> bool {
    a.start < b.end && b.start < a.end
}

/// Checks the order of a surface's clusters.
#[derive(Default)]
struct ClusterOrder {
    last_key: u64,
    last_face: (u32, u32),
}

impl ClusterOrder {
    fn check(&mut self, model: &ExactModel, cluster: &Cluster) -> Result<()> {
        // Invariant: no face is in two clusters, which bounds the faces of a surface by those of
        // the file: positions on the curve ascend, and so do faces of blocks.
        let face = (cluster.block, cluster.first);
        let is_next = match model.is_exact(cluster) {
            true => cluster.keys.start >= self.last_key && cluster.keys.end >= cluster.keys.start,
            false => face >= self.last_face,
        };
        if !is_next {
            return Err(model.wrong_cluster(cluster, "clusters that do not overlap"));
        }
        match model.is_exact(cluster) {
            true => self.last_key = cluster.keys.end,
            false => self.last_face = (face.0, face.1.saturating_add(cluster.faces)),
        }
        Ok(())
    }
}
