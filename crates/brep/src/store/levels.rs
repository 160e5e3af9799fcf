//! Levels of detail in a file: their summary, and clusters of faces, each with the range of errors
//! for which it is part of the surface.

use std::ops::Range;

use super::block::Block;
use super::chunks::Entry;
use super::reader::ExactModel;
use spinney_base::io::batch::{defer_missing, finish_deferred, run_batched};
use spinney_base::{Error, Progress, Result};

/// Tag of the section with the summary of the levels.
pub(crate) const LEVELS: [u8; 4] = *b"LEVS";
/// Tag of the section with the list of cluster tables.
pub(crate) const CLUSTERS: [u8; 4] = *b"LEVC";
/// Tag of the section with the list of blocks of coarse faces.
pub(crate) const LEVEL_FACES: [u8; 4] = *b"LEVF";

/// Maximum number of levels.
pub(crate) const MAX_LEVELS: usize = 64;
/// Number of a level that no cluster is replaced at.
pub(crate) const NEVER: u8 = u8::MAX;
/// Number of a block that a cluster does not have.
pub(crate) const NO_BLOCK: u32 = u32::MAX;
/// Maximum number of clusters of a table.
pub(crate) const TABLE_CLUSTERS: usize = 1024;

/// Bytes of a level in the summary.
const LEVEL: usize = 48;
/// Bytes of a cluster.
const CLUSTER: usize = 64;

/// A level of detail of an exact model: a closed surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct DetailLevel {
    /// Number of faces. Those of coarser levels are triangles.
    pub faces: u64,
    /// Bound of the distance between the level and the exact surface in grid units, both ways,
    /// except for bodies that vanished: their diameter is at most this.
    pub error: f64,
    /// Bytes of the faces that are stored for this level.
    pub bytes: u64,
    /// Number of bodies, connected surfaces of an object, that have no faces in this level.
    pub vanished: u64,
    /// Bound of the largest diameter of these in grid units.
    pub vanished_diameter: f64,
    /// Number of clusters that the level consists of.
    pub(crate) clusters: u64,
}

/// Faces that are chosen together. The clusters for which a number is at least `error` and less
/// than `limit` are a closed surface, whose distance from the exact surface is at most that number.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cluster {
    /// Bound of the distance from the exact surface in grid units.
    pub(crate) error: f32,
    /// The error of the faces that replace the cluster: infinity if there are none.
    pub(crate) limit: f32,
    /// The finest coarse level that has the cluster. The exact surface is the last level.
    pub(crate) level: u8,
    /// The coarser level that has faces instead of the cluster, or [`NEVER`].
    pub(crate) replaced_at: u8,
    /// Number of the block with its faces. Clusters of exact faces have a block if some of these
    /// are not in the octree.
    pub(crate) block: u32,
    /// Number of its first face in the block. For exact faces: the number of faces of the block.
    pub(crate) first: u32,
    /// Number of its faces, without those of an exact cluster's block.
    pub(crate) faces: u32,
    /// Minimum and maximum coordinates of its faces.
    pub(crate) bounds: [[i32; 3]; 2],
    /// For exact faces: the positions on the curve of all faces of the cluster, and of no others.
    pub(crate) keys: Range<u64>,
}

impl DetailLevel {
    pub(crate) fn to_bytes(levels: &[DetailLevel]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(LEVEL * levels.len());
        for level in levels {
            let DetailLevel { faces, error, bytes: stored, vanished, vanished_diameter, clusters } = level;
            let words = [*faces, error.to_bits(), *stored, *vanished, vanished_diameter.to_bits(), *clusters];
            words.iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
        }
        bytes
    }

    /// Reads the summary. Errors describe the flaw.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Vec<DetailLevel>, String> {
        let levels = bytes.chunks_exact(LEVEL).map(|bytes| {
            let word = |index: usize| {
                u64::from_le_bytes(bytes[8 * index..8 * index + 8].try_into().expect("eight bytes"))
            };
            DetailLevel {
                faces: word(0),
                error: f64::from_bits(word(1)),
                bytes: word(2),
                vanished: word(3),
                vanished_diameter: f64::from_bits(word(4)),
                clusters: word(5),
            }
        });
        let levels: Vec<DetailLevel> = levels.collect();
        let is_length = |length: f64| (0.0..=f64::from(f32::MAX)).contains(&length);
        let is_valid = levels.len() <= MAX_LEVELS
            && bytes.len().is_multiple_of(LEVEL)
            && levels.is_sorted_by(|coarse, fine| coarse.error >= fine.error)
            && levels.iter().all(|level| {
                is_length(level.error)
                    && is_length(level.vanished_diameter)
                    && level.faces < 1 << 40
                    && level.clusters < 1 << 32
            });
        if is_valid { Ok(levels) } else { Err(format!("{} bytes of levels", bytes.len())) }
    }
}

impl Cluster {
    pub(crate) fn write(&self, bytes: &mut Vec<u8>) {
        let Cluster { error, limit, level, replaced_at, block, first, faces, bounds, keys } = self;
        [*error, *limit].iter().for_each(|error| bytes.extend_from_slice(&error.to_le_bytes()));
        bytes.extend_from_slice(&[*level, *replaced_at, 0, 0]);
        [*block, *first, *faces].iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
        bounds.as_flattened().iter().for_each(|at| bytes.extend_from_slice(&at.to_le_bytes()));
        [keys.start, keys.end].iter().for_each(|key| bytes.extend_from_slice(&key.to_le_bytes()));
    }

    fn read(bytes: &[u8]) -> Cluster {
        let four = |at: usize| <[u8; 4]>::try_from(&bytes[at..at + 4]).expect("four bytes");
        let word = |at: usize| u32::from_le_bytes(four(at));
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        let point = |at: usize| [0, 4, 8].map(|axis| i32::from_le_bytes(four(at + axis)));
        Cluster {
            error: f32::from_le_bytes(four(0)),
            limit: f32::from_le_bytes(four(4)),
            level: bytes[8],
            replaced_at: bytes[9],
            block: word(12),
            first: word(16),
            faces: word(20),
            bounds: [24, 36].map(point),
            keys: long(48)..long(56),
        }
    }

    /// Returns whether the cluster belongs to a level's surface.
    pub(crate) fn is_in_level(&self, level: u8) -> bool {
        self.level >= level && (self.replaced_at == NEVER || self.replaced_at < level)
    }

    /// Returns whether the cluster belongs to the surface for an error.
    pub(crate) fn is_in_cut(&self, error: f64) -> bool {
        f64::from(self.error) <= error && error < f64::from(self.limit)
    }
}

impl ExactModel {
    /// Returns the levels of detail, the coarsest first; the last one is the exact surface. Empty
    /// for files without levels.
    pub fn levels(&self) -> &[DetailLevel] {
        &self.levels
    }

    /// Warns that a result of an operation does not have the levels of detail, if there are any.
    pub(crate) fn warn_levels(&self, progress: &dyn Progress) {
        if !self.levels.is_empty() {
            let text = "the result has no levels of detail: add them with `spinney transform RESULT levels -o OUTPUT`";
            progress.warn(&self.path, text);
        }
    }

    /// Visits all clusters of a level and of all coarser levels, and perhaps others, with their
    /// numbers. The first tables have the coarsest clusters; those of finer levels are not read.
    pub(crate) fn each_cluster(
        &self,
        level: usize,
        each: &mut dyn FnMut(u64, &Cluster) -> Result<()>,
    ) -> Result<()> {
        // (Blocks of coarse faces follow: both lists are fetched in one batch.)
        let lists = [&self.clusters, &self.level_faces];
        self.fetch((0..2).filter(|list| lists[*list].len() > 0), &|list| {
            lists[list].entry(&self.path, &*self.backend, 0).map(drop)
        })?;
        // Most clusters of a level are made for it, after those of all coarser levels.
        let before: u64 = self.levels.iter().take(level + 1).map(|level| level.clusters).sum();
        let likely = before.div_ceil(TABLE_CLUSTERS as u64).min(self.clusters.len() as u64) as usize;
        self.fetch(0..likely, &|table| self.cluster_table(table).map(drop))?;
        let mut missing = self.levels.get(level).map_or(0, |level| level.clusters);
        for index in 0..self.clusters.len() {
            for (number, cluster) in ((index * TABLE_CLUSTERS) as u64..).zip(self.cluster_table(index)?) {
                missing = missing.saturating_sub(cluster.is_in_level(level as u8).into());
                each(number, &cluster)?;
            }
            if missing == 0 {
                break;
            }
        }
        Ok(())
    }

    /// Fetches what a function reads for each number, if the file is remote, in one batch.
    pub(crate) fn fetch(
        &self,
        numbers: impl IntoIterator<Item = usize> + Clone,
        read: &dyn Fn(usize) -> Result<()>,
    ) -> Result<()> {
        if self.backend.bytes().is_some() {
            return Ok(());
        }
        run_batched(|| {
            let mut is_unread = false;
            for number in numbers.clone() {
                defer_missing(read(number), &mut is_unread)?;
            }
            finish_deferred(is_unread)
        })
    }

    /// Returns the number of tables of clusters.
    pub(crate) fn cluster_tables(&self) -> usize {
        self.clusters.len()
    }

    /// Loads and checks a table of clusters.
    pub(crate) fn cluster_table(&self, index: usize) -> Result<Vec<Cluster>> {
        let bytes = self.clusters.load(&self.path, &*self.backend, index)?;
        let wrong = |found: String| {
            self.corrupt(format!("table of clusters {index}"), found, "clusters as in formats.md")
        };
        let key = self.clusters.entry(&self.path, &*self.backend, index)?.key;
        let is_table = bytes.len().is_multiple_of(CLUSTER)
            && (1..=TABLE_CLUSTERS).contains(&(bytes.len() / CLUSTER))
            && key == (index * TABLE_CLUSTERS) as u64;
        if !is_table {
            return Err(wrong(format!("{} bytes from cluster {key} on", bytes.len())));
        }
        let clusters: Vec<Cluster> = bytes.chunks_exact(CLUSTER).map(Cluster::read).collect();
        let last = self.levels.len().saturating_sub(1);
        let is_reserved = |cluster: &[u8]| cluster[10..12] == [0; 2];
        if !bytes.chunks_exact(CLUSTER).all(is_reserved)
            || index + 1 < self.clusters.len() && clusters.len() < TABLE_CLUSTERS
        {
            return Err(wrong(format!("{} clusters from cluster {key} on", clusters.len())));
        }
        for cluster in &clusters {
            let Cluster { error, limit, level, replaced_at, block, bounds: [min, max], .. } = cluster.clone();
            let is_valid = error >= 0.0
                && error.is_sign_positive()
                && error <= limit
                && usize::from(level) <= last
                && (replaced_at < level || replaced_at == NEVER)
                && (replaced_at == NEVER) == (limit == f32::INFINITY)
                && (block == NO_BLOCK && usize::from(level) == last
                    || (block as usize) < self.level_faces.len())
                && (0..3).all(|axis| {
                    0 <= min[axis] && min[axis] <= max[axis] && max[axis] >> self.summary.grid.bits == 0
                });
            if !is_valid {
                return Err(wrong(format!("{cluster:?}")));
            }
        }
        Ok(clusters)
    }

    pub(crate) fn wrong_cluster(&self, cluster: &Cluster, expected: &str) -> Error {
        self.corrupt("table of clusters".into(), format!("{cluster:?}"), expected)
    }

    /// Loads a block of coarse faces.
    pub(crate) fn level_block(&self, index: usize) -> Result<Block<'_>> {
        let bytes = self.level_faces.load(&self.path, &*self.backend, index)?;
        let wrong = |found: String| {
            self.corrupt(format!("block of coarse faces {index}"), found, "a block as in formats.md")
        };
        let block = Block::new(bytes, 0).ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.level_faces.is_checked(index) {
            block.check(self.summary.grid.bits, self.parts.len() as u64).map_err(wrong)?;
            let Entry { key, .. } = self.level_faces.entry(&self.path, &*self.backend, index)?;
            if key != index as u64 {
                return Err(wrong(format!("key {key}")));
            }
            self.level_faces.set_checked(index);
        }
        Ok(block)
    }
}

/// Returns a distance as a number of single precision that is not smaller.
pub(crate) fn rounded_up(distance: f64) -> f32 {
    let near = distance as f32;
    if f64::from(near) < distance { near.next_up() } else { near }
}
