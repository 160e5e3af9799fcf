//! Surfaces at a level of detail, or for an error: sets of clusters.

use std::ops::Range;

use crate::store::levels::{Cluster, NO_BLOCK, TABLE_CLUSTERS};
use crate::{ExactModel, Face, FaceBuffer, Faces, Grid, ModelNode, ModelNodeState, curve};
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::{Error, Result, sort};

/// Number of blocks of coarse faces, or of exact clusters, that are fetched at once from a remote
/// file.
const FETCHED: usize = 64;

/// How much detail a surface has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detail {
    /// As few faces as possible, whose distance from the exact surface is at most this, in units of
    /// the world. Bodies whose diameter is at most this may be missing.
    Error(f64),
    /// The smallest error for which there are at most this many faces.
    Faces(u64),
    /// A level, from 0, the coarsest.
    Level(u8),
}

/// A surface of a model with levels of detail: closed, and near the exact surface. Coarse surfaces
/// may intersect themselves, within their error; they are for display.
///
/// Faces of coarse clusters are triangles without values.
pub struct DetailSurface<'a> {
    model: &'a ExactModel,
    clusters: Vec<Cluster>,
    /// Numbers of the clusters in the file.
    numbers: Vec<u64>,
    len: u64,
    error: f64,
}

impl ExactModel {
    /// Chooses a surface by its detail. In a box of the world, if there is one, it consists of all
    /// clusters that touch the box, and is not closed outside of it. Reads the tables of clusters,
    /// 64 bytes per 500 faces.
    ///
    /// # Errors
    /// If the file has no levels or not this one, if it is corrupt, or if it cannot be read.
    pub fn at_detail(&self, detail: Detail, within: Option<[[f64; 3]; 2]>) -> Result<DetailSurface<'_>> {
        let levels = self.count_detail_levels()?;
        let width = self.grid().width();
        let error = match detail {
            Detail::Level(level) if usize::from(level) >= levels => {
                let expected = format!("at most {}, the level of the exact surface", levels - 1);
                return Err(Error::invalid("level", level.to_string(), expected));
            }
            Detail::Level(_) => 0.0,
            // (The coarsest clusters are replaced at infinity.)
            Detail::Error(error) if error >= 0.0 => (error / width).min(f64::from(f32::MAX)),
            Detail::Error(error) => return Err(Error::invalid("error", error.to_string(), "0 or more")),
            Detail::Faces(most) => self.error_for(most)?,
        };
        let within = within.map(|corners| corners.map(|corner| self.grid().to_grid(corner)));
        let touches = |[low, high]: &[[i32; 3]; 2]| {
            within.is_none_or(|[min, max]| {
                (0..3).all(|axis| f64::from(low[axis]) <= max[axis] && f64::from(high[axis]) >= min[axis])
            })
        };
        let mut surface = DetailSurface::empty(self);
        // The surface for an error is nowhere finer than a level whose error is not larger.
        let finest = match detail {
            Detail::Level(level) => level.into(),
            _ => self.levels().iter().position(|level| level.error <= error).unwrap_or(levels - 1),
        };
        self.each_distinct_cluster(finest, &mut |number, cluster| {
            let is_in = match detail {
                Detail::Level(level) => cluster.is_in_level(level),
                _ => cluster.is_in_cut(error),
            };
            if is_in && touches(&cluster.bounds) {
                surface.push(number, cluster);
            }
            Ok(())
        })?;
        Ok(surface)
    }

    /// Returns the surface that consists of some clusters, by their numbers in the file: those of
    /// another surface, or some of them. It is closed only if the other one is, and has no others.
    ///
    /// # Errors
    /// If there is no such cluster, or the file is corrupt or cannot be read.
    pub fn of_clusters(&self, numbers: &[u64]) -> Result<DetailSurface<'_>> {
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
        let mut surface = DetailSurface::empty(self);
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

    /// Returns the smallest error for which the surface has at most `most` faces. Reads the tables
    /// from the coarsest level to the finest one that is needed.
    fn error_for(&self, most: u64) -> Result<f64> {
        let last = self.levels().len() - 1;
        let first = self.levels().iter().position(|level| level.faces > most).unwrap_or(last);
        let mut finest = first;
        loop {
            let mut changes = Vec::new();
            // Errors of the clusters of the finest level, and of those that replace them.
            let mut shown: Vec<Range<f64>> = Vec::new();
            self.each_cluster(finest, &mut |_, cluster| {
                let range = f64::from(cluster.error)..f64::from(cluster.limit);
                // (As if no level was finer.)
                if cluster.is_in_level(finest as u8) {
                    add_changes(&mut changes, &(0.0..range.end), self.faces_of(cluster));
                    shown.push(range);
                } else if usize::from(cluster.level) < finest {
                    add_changes(&mut changes, &range, self.faces_of(cluster));
                }
                Ok(())
            })?;
            let error = smallest_with(most, changes)?;
            let is_too_coarse = |range: &Range<f64>| range.start > error && error < range.end;
            if finest == last || !shown.iter().any(is_too_coarse) {
                return Ok(error);
            }
            finest += 1;
        }
    }

    fn is_exact(&self, cluster: &Cluster) -> bool {
        usize::from(cluster.level) + 1 == self.levels().len()
    }

    pub(super) fn faces_of(&self, cluster: &Cluster) -> u64 {
        let slivers = if self.is_exact(cluster) { cluster.first } else { 0 };
        u64::from(cluster.faces) + u64::from(slivers)
    }

    /// Visits the faces with an area whose positions on the curve are in a range.
    fn each_on_curve(
        &self,
        keys: &Range<u64>,
        root: &ModelNode<'_>,
        buffer: &mut FaceBuffer,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        self.each_leaf_on_curve(keys, root, &mut |node, own| {
            // Invariant: each face is visited once. The vertex that decides its position is inside
            // of one leaf's cell, which lists the face.
            for number in node.faces() {
                self.face(number, buffer)?;
                let face = buffer.face();
                let key = curve::position(&face, self.grid().bits);
                if keys.contains(&key) && own.contains(&key) {
                    each(&face)?;
                }
            }
            Ok(())
        })
    }

    /// Reads all that [`ExactModel::each_on_curve`] reads.
    fn read_on_curve(&self, keys: &Range<u64>) -> Result<()> {
        self.each_leaf_on_curve(keys, &self.root()?, &mut |node, _| {
            let mut is_unread = false;
            for number in node.faces() {
                defer_missing(self.block_of(number), &mut is_unread)?;
            }
            finish_deferred(is_unread)
        })
    }

    /// Visits the nodes without children whose positions on the curve, which it also passes, meet a
    /// range. Continues with the others if bytes of one are missing.
    fn each_leaf_on_curve(
        &self,
        keys: &Range<u64>,
        node: &ModelNode<'_>,
        each: &mut dyn FnMut(&ModelNode<'_>, &Range<u64>) -> Result<()>,
    ) -> Result<()> {
        let own = curve::positions_in(node.level(), node.position(), self.grid().bits);
        if node.state() != ModelNodeState::Inner {
            return each(node, &own);
        }
        let mut is_unread = false;
        let length = (own.end - own.start) / 8;
        for child in 0..8 {
            // (Compared before the child is looked up, which may read its segment.)
            let start = own.start + length * child as u64;
            if start < keys.end && start + length > keys.start {
                let child = defer_missing(self.child(node, child), &mut is_unread)?;
                let visited = child.map_or(Ok(()), |child| self.each_leaf_on_curve(keys, &child, each));
                defer_missing(visited, &mut is_unread)?;
            }
        }
        finish_deferred(is_unread)
    }
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

/// Adds the numbers at which the faces of a range are added and removed, as sortable bits: the
/// numbers are not negative.
pub(super) fn add_changes(changes: &mut Vec<(u64, i64)>, range: &Range<f64>, faces: u64) {
    changes.extend([(range.start.to_bits(), faces as i64), (range.end.to_bits(), -(faces as i64))]);
}

/// Returns the smallest finite number for which the ranges that contain it have at most `most`
/// faces.
pub(super) fn smallest_with(most: u64, mut changes: Vec<(u64, i64)>) -> Result<f64> {
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

impl<'a> DetailSurface<'a> {
    pub(super) fn empty(model: &'a ExactModel) -> DetailSurface<'a> {
        DetailSurface { model, clusters: Vec::new(), numbers: Vec::new(), len: 0, error: 0.0 }
    }

    pub(super) fn push(&mut self, number: u64, cluster: &Cluster) {
        self.len += self.model.faces_of(cluster);
        self.error = self.error.max(cluster.error.into());
        self.numbers.push(number);
        self.clusters.push(cluster.clone());
    }

    /// Returns the numbers of the clusters in the file, for [`ExactModel::of_clusters`].
    pub fn numbers(&self) -> &[u64] {
        &self.numbers
    }

    /// Returns each cluster as a surface of its own, in the order of their numbers. Fetches the
    /// faces of all clusters, if the file is remote.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn by_cluster(&self) -> Result<Vec<DetailSurface<'a>>> {
        self.fetch(&self.clusters)?;
        let alone = |(number, cluster): (&u64, &Cluster)| {
            let mut surface = DetailSurface::empty(self.model);
            surface.push(*number, cluster);
            surface
        };
        Ok(self.numbers.iter().zip(&self.clusters).map(alone).collect())
    }

    /// Fetches the faces of clusters from a remote file.
    fn fetch(&self, clusters: &[Cluster]) -> Result<()> {
        self.model.fetch(0..clusters.len(), &|index| {
            let (cluster, mut is_unread) = (&clusters[index], false);
            if cluster.block != NO_BLOCK {
                defer_missing(self.model.level_block(cluster.block as usize), &mut is_unread)?;
            }
            if self.model.is_exact(cluster) {
                defer_missing(self.model.read_on_curve(&cluster.keys), &mut is_unread)?;
            }
            finish_deferred(is_unread)
        })
    }

    /// Returns a bound of the distance between this surface and the exact one in units of the
    /// world, both ways, except for bodies that are missing: their diameter is at most this.
    pub fn error(&self) -> f64 {
        self.error * self.model.grid().width()
    }

    /// Returns the bound in grid units.
    pub(crate) fn grid_error(&self) -> f64 {
        self.error
    }

    /// Returns the number of clusters.
    pub(crate) fn clusters(&self) -> usize {
        self.clusters.len()
    }

    /// Returns whether all faces are those of the exact surface.
    pub fn is_exact(&self) -> bool {
        self.clusters.iter().all(|cluster| self.model.is_exact(cluster))
    }
}

impl Faces for DetailSurface<'_> {
    fn grid(&self) -> &Grid {
        self.model.grid()
    }

    fn parts(&self) -> &[String] {
        self.model.parts()
    }

    fn origin(&self) -> Option<&dyn Faces> {
        Some(self.model)
    }

    fn len(&self) -> u64 {
        self.len
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        let model = self.model;
        let mut buffer = FaceBuffer::default();
        let mut number = 0;
        let mut numbered = |face: &Face<'_>| {
            number += 1;
            each(&Face { number: number - 1, ..*face })
        };
        let blocks = self.clusters.chunk_by(|a, b| a.block == b.block);
        let blocks: Vec<&[Cluster]> = blocks.filter(|same| same[0].block != NO_BLOCK).collect();
        for (index, same) in blocks.iter().enumerate() {
            if index % FETCHED == 0 {
                let next = blocks[index..].iter().take(FETCHED).map(|same| same[0].block as usize);
                model.fetch(next, &|block| model.level_block(block).map(drop))?;
            }
            let block = model.level_block(same[0].block as usize)?;
            for cluster in *same {
                let faces = match model.is_exact(cluster) {
                    true => 0..cluster.first,
                    false => cluster.first..cluster.first.saturating_add(cluster.faces),
                };
                if faces.end as usize > block.len() {
                    let expected = format!("faces of a block of {}", block.len());
                    return Err(model.wrong_cluster(cluster, &expected));
                }
                for face in faces {
                    block.read(face as usize, &mut buffer);
                    numbered(&buffer.face())?;
                }
            }
        }
        let exact: Vec<&Cluster> = self.clusters.iter().filter(|cluster| model.is_exact(cluster)).collect();
        for fetched in exact.chunks(FETCHED) {
            model.fetch(0..fetched.len(), &|index| model.read_on_curve(&fetched[index].keys))?;
            let root = model.root()?;
            for contiguous in fetched.chunk_by(|a, b| a.keys.end == b.keys.start) {
                let keys = contiguous[0].keys.start..contiguous[contiguous.len() - 1].keys.end;
                model.each_on_curve(&keys, &root, &mut buffer, &mut numbered)?;
            }
        }
        Ok(())
    }
}
