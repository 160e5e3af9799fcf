//! Levels of detail: coarser surfaces of a model, from which any part can be read at any error.
//!
//! The exact surface is divided into *clusters* of about 512 triangles. Several clusters form a
//! *group*, which is simplified to a quarter of its faces. Its border, where it meets other groups,
//! does not change. The result is divided into new clusters, which form the next level's groups.
//! These have other borders, so no border remains over several levels. (Batched
//! multi-triangulations: Cignoni et al., 2005. Karis, Stubbe and Wihlidal, "Nanite", 2021.)
//!
//! Each group has a bound of its distance from the exact surface: the largest bound of its input
//! plus a bound of the distance from its input, which is computed. So bounds never decrease from
//! level to level. For any error, the clusters whose bound is at most that error, and whose
//! replacement's bound is above, are a surface without gaps: it is the exact surface with some
//! groups replaced, and each replacement leaves the border of its group unchanged.

mod distance;
mod exact_clusters;
mod group;
mod grouping;
mod patch;
mod tree;
mod triangles;

use std::path::Path;

use self::exact_clusters::each_cluster;
use self::group::{Simplified, simplify};
use self::grouping::{Item, divide};
use self::triangles::{Triangle, TriangleFile};
use crate::boxes::{Bounds, bounds_of};
use crate::store::block::BlockBuilder;
use crate::store::chunks::Entry;
use crate::store::levels::{Cluster, MAX_LEVELS, NEVER, NO_BLOCK, TABLE_CLUSTERS, rounded_up};
use crate::store::summary::Summary;
use crate::store::writer::{List, ModelWriter, encoded};
use crate::{DetailLevel, ExactModel, Face, Faces};
use spinney_base::io::Output;
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Progress, Result, parallel, sort};
use spinney_container::Codec;

/// Maximum number of triangles of a cluster, except of exact faces whose vertices are closer than
/// positions on the curve.
const CLUSTER_FACES: usize = 512;
/// Maximum number of triangles of a group.
const GROUP_FACES: u32 = 16_384;
/// Factor by which a group's triangles become fewer.
const REDUCTION: usize = 4;
/// A level with at most this many triangles is the coarsest.
const COARSEST: u64 = 128;

/// Reduces the number of triangles of a mesh.
pub trait Simplifier: Sync {
    /// Returns about `goal` triangles between some of the points, that are near the given
    /// triangles, or more, if an estimate of the distance would exceed `error`. Their orientation
    /// is the same. Locked points are kept, with all edges between them that have a triangle on one
    /// side only.
    fn simplify(
        &self,
        points: &[[f32; 3]],
        triangles: &[[u32; 3]],
        locked: &[bool],
        goal: usize,
        error: f32,
    ) -> Vec<[u32; 3]>;
}

/// Copies a model with a codec, and adds levels of detail; existing ones are replaced. About
/// `memory` bytes are used, and temporary files next to the output. Time grows with the number of
/// faces.
///
/// # Errors
/// If the memory is not enough, if a file cannot be read or written, or on cancellation.
pub fn add_levels(
    model: &ExactModel,
    simplifier: &dyn Simplifier,
    (output, codec): (Output, Codec),
    memory: u64,
    progress: &dyn Progress,
) -> Result<Vec<DetailLevel>> {
    let directory = output.temporary_directory();
    let mut writer = ModelWriter::new(output, model.grid(), memory / 16)?;
    writer.set_codec(codec);
    model.copy_chunks(&mut writer, progress)?;
    let mut levels = LevelBuilder::of(model, &directory, memory, &mut writer, progress)?;
    while levels.add(model, simplifier, &mut writer, progress)? {}
    let LevelBuilder { clusters, blocks, summaries, .. } = levels;
    let summaries = finish(clusters, &blocks, summaries, &mut writer)?;
    let formula = model.formula()?.unwrap_or_default();
    let (summary, sums) = (Summary { codec, ..model.summary().clone() }, model.sums_section()?);
    writer.finish(&summary, &sums, &summaries, &formula, model.metadata())?;
    Ok(summaries)
}

/// A cluster while levels are made.
struct OpenCluster {
    /// `level` and `replaced_at` are counted from the exact surface here.
    stored: Cluster,
    centre: [i64; 3],
    /// Position in the file of triangles.
    first: u64,
    triangles: u32,
}

struct LevelBuilder {
    file: TriangleFile,
    clusters: Vec<OpenCluster>,
    /// Indices of the clusters that the last level consists of.
    current: Vec<u32>,
    /// The object of each part.
    objects: Vec<u32>,
    /// From the exact surface on.
    summaries: Vec<DetailLevel>,
    /// Bound of the exact surface's distance from the faces in the octree.
    base_error: f64,
    is_coloured: bool,
    memory: u64,
    /// Entries of the blocks that were written, without their keys.
    blocks: Vec<Entry>,
    /// Number of levels in a row that had almost as many faces as the previous one.
    weak: usize,
}

impl LevelBuilder {
    /// Divides the exact surface into clusters.
    fn of(
        model: &ExactModel,
        directory: &Path,
        memory: u64,
        writer: &mut ModelWriter,
        progress: &dyn Progress,
    ) -> Result<LevelBuilder> {
        let (sorter, objects) = exact_clusters::sorted(model, directory, memory / 5, progress)?;
        let base_error = if model.has_exact_faces() { f64::from(model.reach()) * 3f64.sqrt() } else { 0.0 };
        let mut builder = LevelBuilder {
            file: TriangleFile::create(directory)?,
            clusters: Vec::new(),
            current: Vec::new(),
            objects,
            summaries: Vec::new(),
            base_error,
            is_coloured: model.is_coloured()?,
            memory,
            blocks: Vec::new(),
            weak: 0,
        };
        each_cluster(sorter, &mut |cluster| {
            progress.check()?;
            let mut number = NO_BLOCK;
            if !cluster.slivers.is_empty() {
                number = builder.blocks.len() as u32;
                let plain = block(cluster.slivers.iter(), builder.is_coloured);
                let stored = encoded(writer.codec(), List::LevelFaces, &plain);
                builder.blocks.push(writer.append(List::LevelFaces, &stored)?);
            }
            builder.push(
                model,
                &cluster.triangles,
                Cluster {
                    error: 0.0,
                    limit: f32::INFINITY,
                    level: 0,
                    replaced_at: NEVER,
                    block: number,
                    first: cluster.slivers.len() as u32,
                    faces: cluster.faces,
                    bounds: bounds(&cluster.triangles),
                    keys: cluster.keys,
                },
            )
        })?;
        builder.file.flush()?;
        let clusters = builder.clusters.len() as u64;
        builder.current = (0..clusters as u32).collect();
        builder.summaries.push(DetailLevel {
            faces: builder.faces(),
            error: 0.0,
            bytes: 0,
            vanished: 0,
            vanished_diameter: 0.0,
            clusters,
        });
        Ok(builder)
    }

    fn push(&mut self, model: &ExactModel, triangles: &[Triangle], stored: Cluster) -> Result<()> {
        let needed = (self.clusters.len() as u64 + 1) * size_of::<OpenCluster>() as u64 * 2;
        if needed > self.memory / 2 || self.clusters.len() >= u32::MAX as usize {
            return Err(Error::TooLarge {
                path: model.path().to_path_buf(),
                what: "making levels of detail".into(),
                needed,
                limit: self.memory / 2,
                advice: "allow more with --memory".into(),
            });
        }
        let [min, max] = stored.bounds;
        let centre = [0, 1, 2].map(|axis| (i64::from(min[axis]) + i64::from(max[axis])) / 2);
        let first = self.file.push(triangles)?;
        self.clusters.push(OpenCluster { stored, centre, first, triangles: triangles.len() as u32 });
        Ok(())
    }

    /// Makes the next level; returns whether there may be another one.
    fn add(
        &mut self,
        model: &ExactModel,
        simplifier: &dyn Simplifier,
        writer: &mut ModelWriter,
        progress: &dyn Progress,
    ) -> Result<bool> {
        let level = self.summaries.len();
        let before = self.triangles();
        if before <= COARSEST || level >= MAX_LEVELS || self.weak >= 2 {
            return Ok(false);
        }
        let mut next = Vec::new();
        let mut kept = Vec::new();
        let mut stored = 0;
        let (mut vanished, mut diameter) = (0, 0.0f64);
        let groups = self.groups(model, level);
        let codec = writer.codec();
        for batch in groups.chunks(4 * parallel::threads()) {
            progress.check()?;
            let simplified =
                parallel::map(batch, |group| self.simplified(group, level, simplifier, codec, progress));
            for (group, found) in batch.iter().zip(simplified) {
                let Some(SimplifiedGroup { simplified, error, block }) = found? else {
                    kept.extend_from_slice(group);
                    continue;
                };
                let number = self.blocks.len() as u32;
                self.blocks.push(writer.append(List::LevelFaces, &block)?);
                stored += block.len() as u64;
                for index in group {
                    let cluster = &mut self.clusters[*index as usize].stored;
                    (cluster.limit, cluster.replaced_at) = (error, level as u8);
                }
                let mut first = 0;
                for triangles in &simplified.clusters {
                    let faces = triangles.len() as u32;
                    next.push(self.clusters.len() as u32);
                    self.push(
                        model,
                        triangles,
                        Cluster {
                            error,
                            limit: f32::INFINITY,
                            level: level as u8,
                            replaced_at: NEVER,
                            block: number,
                            first,
                            faces,
                            bounds: bounds(triangles),
                            keys: 0..0,
                        },
                    )?;
                    first += faces;
                }
                vanished += simplified.vanished;
                diameter = diameter.max(simplified.diameter);
            }
            let done = batch.iter().flatten().map(|index| self.clusters[*index as usize].triangles);
            progress.advance(done.map(u64::from).sum(), model.len() * 3 / 2);
        }
        if next.is_empty() {
            return Ok(false);
        }
        self.file.flush()?;
        self.current = kept;
        self.current.append(&mut next);
        let error = self.current.iter().map(|index| self.clusters[*index as usize].stored.error);
        let last = self.summaries.last().expect("the exact surface");
        let faces = self.faces();
        self.weak = if self.triangles() * 10 > before * 9 { self.weak + 1 } else { 0 };
        self.summaries.push(DetailLevel {
            faces,
            error: error.fold(0.0, f32::max).into(),
            bytes: stored,
            vanished: last.vanished + vanished,
            vanished_diameter: last.vanished_diameter.max(diameter),
            clusters: self.current.len() as u64,
        });
        Ok(true)
    }

    /// Returns the number of faces of the last level. (Those of exact clusters may be polygons.)
    fn faces(&self) -> u64 {
        let of = |stored: &Cluster| {
            let slivers = if stored.level == 0 { stored.first } else { 0 };
            u64::from(stored.faces) + u64::from(slivers)
        };
        self.current.iter().map(|index| of(&self.clusters[*index as usize].stored)).sum()
    }

    /// Returns the number of triangles of the last level.
    fn triangles(&self) -> u64 {
        self.current.iter().map(|index| u64::from(self.clusters[*index as usize].triangles)).sum()
    }

    /// Divides the last level's clusters into groups, in the order of the smallest octree nodes
    /// that contain them.
    fn groups(&self, model: &ExactModel, level: usize) -> Vec<Vec<u32>> {
        let item = |index: &u32| {
            let cluster = &self.clusters[*index as usize];
            Item { centre: cluster.centre, faces: cluster.triangles, index: *index }
        };
        let mut groups = divide(self.current.iter().map(item).collect(), GROUP_FACES, level);
        let node = |group: &Vec<u32>| {
            let bounds = group.iter().map(|index| self.clusters[*index as usize].stored.bounds);
            let all: Vec<[i32; 3]> = bounds.flatten().collect();
            node_of(model, &bounds_of(&all, 0))
        };
        sort::by_key(&mut groups, node);
        groups
    }

    fn simplified(
        &self,
        group: &[u32],
        level: usize,
        simplifier: &dyn Simplifier,
        codec: Codec,
        progress: &dyn Progress,
    ) -> Result<Option<SimplifiedGroup>> {
        progress.check()?;
        let mut triangles = Vec::new();
        let mut error = self.base_error;
        for index in group {
            let cluster = &self.clusters[*index as usize];
            self.file.read(cluster.first, cluster.triangles, &mut triangles)?;
            error = error.max(cluster.stored.error.into());
        }
        let Some(simplified) = simplify(&triangles, error, &self.objects, simplifier, level) else {
            return Ok(None);
        };
        let error = rounded_up(error + simplified.distance);
        let plain = block(simplified.clusters.iter().flatten(), self.is_coloured);
        let block = encoded(codec, List::LevelFaces, &plain).into_owned();
        Ok(Some(SimplifiedGroup { simplified, error, block }))
    }
}

struct SimplifiedGroup {
    simplified: Simplified,
    error: f32,
    /// Stored bytes of its faces.
    block: Vec<u8>,
}

/// Returns a block of faces.
fn block<'a>(triangles: impl Iterator<Item = &'a Triangle>, is_coloured: bool) -> Vec<u8> {
    let mut block = BlockBuilder::default();
    for (number, Triangle { points, colours, part }) in (0..).zip(triangles) {
        let colours = if is_coloured { &colours[..] } else { &[] };
        block.push(&Face { number, points, ring_ends: &[3], colours, part: *part, source: number }, false);
    }
    block.finish().1
}

fn bounds(triangles: &[Triangle]) -> Bounds {
    let points: Vec<[i32; 3]> = triangles.iter().flat_map(|triangle| triangle.points).collect();
    bounds_of(&points, 0)
}

/// Returns the code of the smallest octree node that contains a box.
fn node_of(model: &ExactModel, [min, max]: &Bounds) -> u64 {
    let (depth, bits) = (model.depth(), model.grid().bits);
    let differing =
        (0..3).map(|axis| (min[axis] ^ max[axis]) >> (bits - depth)).fold(0, |all, one| all | one);
    let up = 32 - differing.leading_zeros();
    let position = min.map(|at| (at >> (bits - depth)) as u32 >> up);
    Code::from_cell(Dimension::Oct, depth - up as u8, position).map_or(0, Code::bits)
}

/// Numbers levels, blocks and clusters from the coarsest on, and writes the tables of clusters.
/// Returns the levels in this order.
fn finish(
    mut clusters: Vec<OpenCluster>,
    blocks: &[Entry],
    mut levels: Vec<DetailLevel>,
    writer: &mut ModelWriter,
) -> Result<Vec<DetailLevel>> {
    let last = levels.len() - 1;
    levels.reverse();
    let mut order: Vec<u32> = (0..clusters.len() as u32).collect();
    sort::by_key(&mut order, |index| MAX_LEVELS as u64 - u64::from(clusters[*index as usize].stored.level));
    // Final numbers of the blocks.
    let mut numbers = vec![NO_BLOCK; blocks.len()];
    let mut count = 0;
    for index in &order {
        let block = clusters[*index as usize].stored.block;
        if block != NO_BLOCK && numbers[block as usize] == NO_BLOCK {
            numbers[block as usize] = count;
            writer.entry(List::LevelFaces, Entry { key: count.into(), ..blocks[block as usize] })?;
            count += 1;
        }
    }
    let mut bytes = Vec::new();
    for (table, indices) in (0..).zip(order.chunks(TABLE_CLUSTERS)) {
        bytes.clear();
        for index in indices {
            let cluster = &mut clusters[*index as usize].stored;
            cluster.level = (last - usize::from(cluster.level)) as u8;
            if cluster.replaced_at != NEVER {
                cluster.replaced_at = (last - usize::from(cluster.replaced_at)) as u8;
            }
            if cluster.block != NO_BLOCK {
                cluster.block = numbers[cluster.block as usize];
            }
            cluster.write(&mut bytes);
        }
        writer.chunk(List::Clusters, table * TABLE_CLUSTERS as u64, &bytes)?;
    }
    Ok(levels)
}
