//! Kinds of work of shards. One file per kind plans it and builds a shard of it.

mod arrays;
mod combining;
mod points;
mod rasters;
mod rebuilding;
mod solids;
mod stacks;
mod transforming;
mod trees;
mod volumes;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output, url_of};
use spinney_base::space::{Bounds, CodeRange};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, LevelCounts, ShardSummary};
use spinney_engine::dataset::Rebuild;
use spinney_engine::ops::{CombineOperation, CombineOptions, FileView};
use spinney_engine::store::goblin::{Goblin, MergeOutput, Shard, ShardRange, merge_shards};
use spinney_engine::store::{Packing, ShardCheck, TreeTarget, TreeWriter};
use spinney_mesh::import::SolidOptions;
use spinney_points::PointImportOptions;
use spinney_raster::import::{ImportOptions, StackOptions};
use spinney_raster::volume::{VolumeInput, VolumeOptions};
use spinney_vector::import::filter::FeatureFilter;

pub(crate) use self::arrays::ArrayWork;
use self::combining::Combining;
use self::points::Points;
use self::rasters::Rasters;
use self::rebuilding::Rebuilding;
use self::solids::Solid;
use self::stacks::Stack;
use self::transforming::Transforming;
use self::volumes::Volume;
use crate::job::PlannedInput;

/// Specification of a job: the kind of work, its inputs and options. A plan does not store the
/// options for memory and for sharing equal subtrees.
#[derive(Clone, Debug)]
pub enum JobSpec {
    /// Quadtree with one layer, of a raster or of several rasters on one grid.
    Rasters {
        /// Rasters; the last one is on top.
        inputs: Vec<PathBuf>,
        /// Import options.
        options: ImportOptions,
    },
    /// Several rasters, each a layer of one file.
    Stack {
        /// Files of the layers.
        inputs: Vec<PathBuf>,
        /// Import options.
        options: StackOptions,
    },
    /// Octree of a volume.
    Volume {
        /// Files of the volume, and how they are read.
        input: VolumeInput,
        /// Import options.
        options: VolumeOptions,
    },
    /// Octree of the solid that models with a closed surface enclose.
    Solid {
        /// Files of the models, which are combined to one solid.
        inputs: Vec<PathBuf>,
        /// Import options.
        options: SolidOptions,
    },
    /// Tree of the points of LAS and LAZ files.
    Points {
        /// Files of the points.
        inputs: Vec<PathBuf>,
        /// Import options.
        options: PointImportOptions,
        /// Conditions that points must satisfy.
        filter: FeatureFilter,
    },
    /// Tree with the cells of another tree and other properties: see
    /// [`Dataset::build`](spinney_engine::dataset::Dataset::build).
    Rebuild {
        /// Input tree.
        input: PathBuf,
        /// Properties that change.
        other: Rebuild,
        /// Compression of segments.
        packing: Packing,
    },
    /// Tree with operations applied: see [`transform`](spinney_engine::ops::transform).
    Transform {
        /// Input tree, and the operations.
        chain: FileView,
        /// Compression of segments.
        packing: Packing,
    },
    /// Combination of several trees: see [`combine`](spinney_engine::ops::combine).
    Combine {
        /// Input trees.
        inputs: Vec<PathBuf>,
        /// Operation that combines them.
        operation: CombineOperation,
        /// Handling of cells that no input has.
        options: CombineOptions,
        /// Compression of segments.
        packing: Packing,
    },
}

impl JobSpec {
    /// Paths of the input files, as given: all files of a mosaic, a stack or a combination; for a
    /// chain, the input tree and the files of its operations.
    pub fn inputs(&self) -> Vec<PathBuf> {
        match self {
            JobSpec::Rasters { inputs, .. }
            | JobSpec::Stack { inputs, .. }
            | JobSpec::Solid { inputs, .. }
            | JobSpec::Points { inputs, .. }
            | JobSpec::Combine { inputs, .. } => inputs.clone(),
            JobSpec::Volume { input, .. } => input.paths().to_vec(),
            JobSpec::Rebuild { input, .. } => vec![input.clone()],
            JobSpec::Transform { chain, .. } => transforming::files(chain),
        }
    }

    /// Writes the head file. `inputs` are the [planned ones](JobSpec::inputs), and `shards` is the
    /// requested number of shards.
    pub(crate) fn write_head(
        &self,
        (inputs, shards): (&[PlannedInput], u32),
        head: Output,
        progress: &dyn Progress,
    ) -> Result<WorkPlan> {
        match self {
            JobSpec::Rasters { inputs: paths, options } => {
                rasters::write_head((paths, inputs), options, head, progress)
            }
            JobSpec::Stack { inputs: paths, options } => {
                stacks::write_head((paths, inputs), options, head, progress)
            }
            JobSpec::Volume { input, options } => volumes::write_head(input, options, head, progress),
            JobSpec::Solid { inputs: paths, options } => {
                solids::write_head((paths, inputs), options, head, progress)
            }
            JobSpec::Points { inputs: paths, options, filter } => {
                points::write_head(paths, (options, filter), (head, shards), progress)
            }
            JobSpec::Rebuild { input, other, packing } => {
                rebuilding::write_head(input, (other, *packing), head, progress)
            }
            JobSpec::Transform { chain, packing } => {
                transforming::write_head(chain, *packing, head, progress)
            }
            JobSpec::Combine { inputs: paths, operation, options, packing } => {
                combining::write_head(paths, Combining::of(*operation, *options, *packing), head, progress)
            }
        }
    }
}

/// Bytes of input for the cells in a box of a layer.
pub(crate) struct Load {
    pub(crate) layer: usize,
    pub(crate) cells: Bounds,
    pub(crate) bytes: u64,
}

/// Information about a job that is known once its head file is written.
pub(crate) struct WorkPlan {
    /// Work, as stored in the plan.
    pub(crate) work: PlannedWork,
    /// Distribution of the input over cells. If empty, all input is assumed to be spread evenly
    /// over all cells.
    pub(crate) loads: Vec<Load>,
    /// Code ranges of each shard if the work has its own method of cutting; otherwise layers are
    /// cut by `loads`.
    pub(crate) ranges: Option<Vec<Vec<ShardRange>>>,
    /// Description of the tree: pairs of a heading and its text.
    pub(crate) description: Vec<(&'static str, String)>,
}

/// Work, as stored in a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PlannedWork {
    Rasters(Box<Rasters>),
    Stack(Box<Stack>),
    Volume(Box<Volume>),
    Solid(Box<Solid>),
    Points(Points),
    Rebuild(Box<Rebuilding>),
    Transform(Transforming),
    Combine(Combining),
    Arrays(ArrayWork),
}

impl PlannedWork {
    /// Work of a specification, as far as it is known before inputs are read.
    pub(crate) fn of(spec: &JobSpec) -> Result<PlannedWork> {
        Ok(match spec {
            JobSpec::Rasters { options, .. } => PlannedWork::Rasters(Box::new(Rasters::of(options))),
            JobSpec::Stack { options, .. } => PlannedWork::Stack(Box::new(Stack::of(options))),
            JobSpec::Volume { input, options } => PlannedWork::Volume(Box::new(Volume::of(input, options))),
            JobSpec::Solid { inputs, options } => PlannedWork::Solid(Box::new(Solid::of(inputs, options)?)),
            JobSpec::Points { options, filter, .. } => PlannedWork::Points(Points::of(options, filter)),
            JobSpec::Rebuild { other, packing, .. } => {
                PlannedWork::Rebuild(Box::new(Rebuilding::of(other, *packing)))
            }
            JobSpec::Transform { chain, packing } => {
                PlannedWork::Transform(Transforming::of(chain, *packing)?)
            }
            JobSpec::Combine { operation, options, packing, .. } => {
                PlannedWork::Combine(Combining::of(*operation, *options, *packing))
            }
        })
    }

    pub(crate) fn work(&self) -> &dyn Work {
        match self {
            PlannedWork::Rasters(work) => &**work,
            PlannedWork::Stack(work) => &**work,
            PlannedWork::Volume(work) => &**work,
            PlannedWork::Solid(work) => &**work,
            PlannedWork::Points(work) => work,
            PlannedWork::Rebuild(work) => &**work,
            PlannedWork::Transform(work) => work,
            PlannedWork::Combine(work) => work,
            PlannedWork::Arrays(work) => work,
        }
    }
}

/// Kind of work. Everything deserialized from a plan may be corrupt.
pub(crate) trait Work {
    /// Files that reading an input involves, including the input itself.
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>>;

    /// Headers of the layers in a head file.
    fn layers(&self, head: Vec<u8>) -> Result<Vec<Header>> {
        let head = Goblin::from_bytes(head)?;
        Ok(head.layers().iter().map(|layer| layer.header.clone()).collect())
    }

    /// Whether code ranges cover each layer exactly once, in order, and are cut only at permitted
    /// positions.
    fn are_all(&self, ranges: &[ShardRange], layers: &[Header]) -> bool {
        are_all(ranges, layers)
    }

    /// Bytes of a shard's segments; `None` if it is not built or incomplete.
    fn find(&self, shard: &Shard) -> Result<Option<u64>> {
        Ok(ShardSummary::<LevelCounts>::find(shard)?.map(|summary| summary.run_bytes()))
    }

    /// Numbers of the shards that are not built or lack a required file. Segments that `output`
    /// already has are not required.
    fn missing(&self, shards: &[Shard], output: Option<&MergeOutput>) -> Result<Vec<u32>> {
        let found = output.map_or_else(|| ShardSummary::find_all(shards), |output| output.find(shards))?;
        missing_of(shards, found.into_iter().map(|found| Ok(found?.is_some())))
    }

    /// Builds a shard that covers no range of any layer.
    fn build_empty(&self, head: &Path, shard: Shard) -> Result<()> {
        TreeWriter::shard(head, shard)?.finish()
    }

    /// Whether merging reads the inputs again.
    fn reads_inputs_to_merge(&self) -> bool {
        false
    }

    /// Merges shards of a tree of these inputs with about `memory` bytes.
    fn merge(
        &self,
        head: &Path,
        shards: &[Shard],
        (_, output, memory): (&[PathBuf], MergeOutput, u64),
        progress: &dyn Progress,
    ) -> Result<()> {
        merge_shards(head, shards, output, memory / 8, progress)
    }

    /// Checks that the plan's data fits the number of inputs and these layers.
    fn check(&self, _inputs: usize, _layers: &[Header]) -> Result<()> {
        Ok(())
    }

    /// Indices of the inputs that a shard depends on.
    fn touched(&self, inputs: usize, _shard: &Shard, _layers: &[Header]) -> Vec<usize> {
        (0..inputs).collect()
    }

    /// Builds a shard.
    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()>;
}

/// Numbers of the shards for which `made` is false.
fn missing_of(shards: &[Shard], made: impl Iterator<Item = Result<bool>>) -> Result<Vec<u32>> {
    let mut missing = Vec::new();
    for (shard, is_made) in shards.iter().zip(made) {
        if !is_made? {
            missing.push(shard.number);
        }
    }
    Ok(missing)
}

/// Shard to build.
pub(crate) struct ShardTask {
    /// Inputs that the shard depends on, each with its index.
    pub(crate) inputs: Vec<(usize, PathBuf)>,
    /// Head file of the job.
    pub(crate) head: PathBuf,
    pub(crate) shard: Shard,
    /// Checks that the inputs match the plan.
    pub(crate) check: ShardCheck,
}

impl ShardTask {
    /// Paths of the inputs.
    fn paths(&self) -> Vec<PathBuf> {
        self.inputs.iter().map(|(_, path)| path.clone()).collect()
    }

    /// Target for writing the shard's trees.
    fn target(self) -> TreeTarget {
        let ShardTask { head, shard, check, .. } = self;
        TreeTarget::Shard { head, shard, check }
    }
}

/// Fails if an input that must be memory-mapped is remote.
fn check_is_local(input: &Path) -> Result<()> {
    match url_of(input) {
        None => Ok(()),
        Some(_) => {
            Err(Error::unsupported(input, "reading this format from a URL in shards", "download it first"))
        }
    }
}

/// Whether code ranges cover each layer exactly once, in order, and are cut only at permitted
/// positions.
fn are_all(ranges: &[ShardRange], layers: &[Header]) -> bool {
    let mut ranges = ranges.iter();
    for (number, header) in (0..).zip(layers) {
        let mut next = 0;
        while next <= CodeRange::ALL.ends()[1] {
            let Some(range) = ranges.next() else { return false };
            let [first, last] = range.run.ends();
            let is_cut = range.run.is_cut_at(header.form.dimension, header.shape.shard_level());
            if range.layer != number || first != next || !is_cut {
                return false;
            }
            next = last + 1;
        }
    }
    ranges.next().is_none()
}
