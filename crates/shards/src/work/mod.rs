//! Kinds of work that shards do: for each there is a file that plans it and builds a shard of it.

mod combining;
mod given;
mod pictures;
mod points;
mod rebuilding;
mod solids;
mod stacks;
mod transforming;
mod trees;
mod volumes;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output, url_of};
use spinney_base::space::{Bounds, CodeRun};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, LevelCounts, ShardSummary};
use spinney_engine::dataset::Rebuild;
use spinney_engine::ops::{CombineOperation, CombineOptions, FileView};
use spinney_engine::store::goblin::{Goblin, MergeOutput, Shard, ShardPiece, merge_shards};
use spinney_engine::store::{Packing, ShardCheck, TreeTarget, TreeWriter};
use spinney_mesh::import::SolidOptions;
use spinney_points::PointImportOptions;
use spinney_raster::import::{ImportOptions, StackOptions};
use spinney_raster::volume::{VolumeInput, VolumeOptions};
use spinney_vector::import::filter::FeatureFilter;

use self::combining::Combining;
pub(crate) use self::given::Given;
use self::pictures::Pictures;
use self::points::Points;
use self::rebuilding::Rebuilding;
use self::solids::Solid;
use self::stacks::Stack;
use self::transforming::Transforming;
use self::volumes::Volume;
use crate::job::PlannedInput;

/// Specification of a job: what is made, and of what. Memory and sharing of equal subtrees that options tell are no part of a plan.
#[derive(Clone, Debug)]
pub enum JobSpec {
    /// A tree of a picture, or of several on one grid, as one layer.
    Pictures {
        /// The pictures; the last lies on top.
        inputs: Vec<PathBuf>,
        /// Options of their import.
        options: ImportOptions,
    },
    /// Pictures beside each other, as layers.
    Stack {
        /// Files of the layers.
        inputs: Vec<PathBuf>,
        /// Options of their import.
        options: StackOptions,
    },
    /// An octree of a volume.
    Volume {
        /// Its files, and the way in which they are read.
        input: VolumeInput,
        /// Options of its import.
        options: VolumeOptions,
    },
    /// An octree of what models enclose, whose surface is closed.
    Solid {
        /// Files of the models, which become one solid.
        inputs: Vec<PathBuf>,
        /// Options of their import.
        options: SolidOptions,
    },
    /// A tree of the points of LAS and LAZ files.
    Points {
        /// The files.
        inputs: Vec<PathBuf>,
        /// Options of their import.
        options: PointImportOptions,
        /// Conditions that hold for the points that are kept.
        filter: FeatureFilter,
    },
    /// A tree of the same cells as another, of which something else is said: see [`Dataset::build`](spinney_engine::dataset::Dataset::build).
    Rebuild {
        /// The tree.
        input: PathBuf,
        /// Properties that are to be other.
        other: Rebuild,
        /// The way in which segments are packed.
        packing: Packing,
    },
    /// A tree with steps done to it: see [`transform`](spinney_engine::ops::transform).
    Transform {
        /// The tree, and the steps.
        chain: FileView,
        /// The way in which segments are packed.
        packing: Packing,
    },
    /// One tree of several: see [`combine`](spinney_engine::ops::combine).
    Combine {
        /// The trees.
        inputs: Vec<PathBuf>,
        /// The way in which they are merged.
        operation: CombineOperation,
        /// Handling of cells that no input has.
        options: CombineOptions,
        /// The way in which segments are packed.
        packing: Packing,
    },
}

impl JobSpec {
    /// The files that are read, as they are named: each of a mosaic, of a stack and of trees that are combined; the tree of a chain, and those of its steps.
    pub fn inputs(&self) -> Vec<PathBuf> {
        match self {
            JobSpec::Pictures { inputs, .. }
            | JobSpec::Stack { inputs, .. }
            | JobSpec::Solid { inputs, .. }
            | JobSpec::Points { inputs, .. }
            | JobSpec::Combine { inputs, .. } => inputs.clone(),
            JobSpec::Volume { input, .. } => input.paths().to_vec(),
            JobSpec::Rebuild { input, .. } => vec![input.clone()],
            JobSpec::Transform { chain, .. } => transforming::files(chain),
        }
    }

    /// Writes a file that tells of the layers. Inputs are the [planned ones](JobSpec::inputs), and there are to be so many shards.
    pub(crate) fn write_head(
        &self,
        (inputs, shards): (&[PlannedInput], u32),
        head: Output,
        progress: &dyn Progress,
    ) -> Result<Told> {
        match self {
            JobSpec::Pictures { inputs: paths, options } => {
                pictures::write_head((paths, inputs), options, head, progress)
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

/// Bytes of input that make the cells in a box of a layer.
pub(crate) struct Load {
    pub(crate) layer: usize,
    pub(crate) cells: Bounds,
    pub(crate) bytes: u64,
}

/// Knowledge of a job when what is told of its layers is written.
pub(crate) struct Told {
    /// The work, as the plan says it.
    pub(crate) work: PlannedWork,
    /// Which input makes which cells; where nothing is known of that, all input is taken to be spread over all cells.
    pub(crate) loads: Vec<Load>,
    /// The pieces of each shard, where the work has a way of its own to cut; else layers are cut by loads.
    pub(crate) pieces: Option<Vec<Vec<ShardPiece>>>,
    /// Description of the tree: pairs of a heading and its text.
    pub(crate) description: Vec<(&'static str, String)>,
}

/// Work as a plan tells it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PlannedWork {
    Pictures(Box<Pictures>),
    Stack(Box<Stack>),
    Volume(Box<Volume>),
    Solid(Box<Solid>),
    Points(Points),
    Rebuild(Box<Rebuilding>),
    Transform(Transforming),
    Combine(Combining),
    Given(Given),
}

impl PlannedWork {
    /// The work of a specification, as far as it is known before inputs are looked at.
    pub(crate) fn of(spec: &JobSpec) -> Result<PlannedWork> {
        Ok(match spec {
            JobSpec::Pictures { options, .. } => PlannedWork::Pictures(Box::new(Pictures::of(options))),
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
            PlannedWork::Pictures(work) => &**work,
            PlannedWork::Stack(work) => &**work,
            PlannedWork::Volume(work) => &**work,
            PlannedWork::Solid(work) => &**work,
            PlannedWork::Points(work) => work,
            PlannedWork::Rebuild(work) => &**work,
            PlannedWork::Transform(work) => work,
            PlannedWork::Combine(work) => work,
            PlannedWork::Given(work) => work,
        }
    }
}

/// Kind of work. All that it is told by a plan may be damaged.
pub(crate) trait Work {
    /// The files that reading an input looks at, itself among them.
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>>;

    /// Headers of the layers that a head tells of.
    fn layers(&self, head: Vec<u8>) -> Result<Vec<Header>> {
        let head = Goblin::from_bytes(head)?;
        Ok(head.layers().iter().map(|layer| layer.header.clone()).collect())
    }

    /// Whether pieces have all of each layer, one behind the other, and are cut where they may be.
    fn are_all(&self, pieces: &[ShardPiece], layers: &[Header]) -> bool {
        are_all(pieces, layers)
    }

    /// Bytes of a shard, if it is made and all of it is there.
    fn find(&self, shard: &Shard) -> Result<Option<u64>> {
        Ok(ShardSummary::<LevelCounts>::find(shard)?.map(|summary| summary.run_bytes()))
    }

    /// Numbers of the shards that are not made, or of which something is not there that is needed, perhaps for an output that may have some of it.
    fn missing(&self, shards: &[Shard], output: Option<&MergeOutput>) -> Result<Vec<u32>> {
        let found = output.map_or_else(|| ShardSummary::find_all(shards), |output| output.find(shards))?;
        missing_of(shards, found.into_iter().map(|found| Ok(found?.is_some())))
    }

    /// Makes a shard that has no piece of any layer.
    fn build_empty(&self, head: &Path, shard: Shard) -> Result<()> {
        TreeWriter::shard(head, shard)?.finish()
    }

    /// Puts shards together with about so many bytes of memory.
    fn merge(
        &self,
        head: &Path,
        shards: &[Shard],
        (output, memory): (MergeOutput, u64),
        progress: &dyn Progress,
    ) -> Result<()> {
        merge_shards(head, shards, output, memory / 8, progress)
    }

    /// Makes sure that all that is told fits so many inputs and these layers.
    fn check(&self, _inputs: usize, _layers: &[Header]) -> Result<()> {
        Ok(())
    }

    /// Numbers of the inputs that a shard is made of.
    fn touched(&self, inputs: usize, _shard: &Shard, _layers: &[Header]) -> Vec<usize> {
        (0..inputs).collect()
    }

    /// Makes a shard.
    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()>;
}

/// Numbers of the shards that are not made, of which it is known whether each is.
fn missing_of(shards: &[Shard], made: impl Iterator<Item = Result<bool>>) -> Result<Vec<u32>> {
    let mut missing = Vec::new();
    for (shard, is_made) in shards.iter().zip(made) {
        if !is_made? {
            missing.push(shard.number);
        }
    }
    Ok(missing)
}

/// A shard that is to be made.
pub(crate) struct PartOfJob {
    /// The inputs that it is made of, each with its number.
    pub(crate) inputs: Vec<(usize, PathBuf)>,
    /// The file that tells of the layers.
    pub(crate) head: PathBuf,
    pub(crate) shard: Shard,
    /// Makes sure that the inputs are those that were planned.
    pub(crate) check: ShardCheck,
}

impl PartOfJob {
    /// Paths of the inputs.
    fn paths(&self) -> Vec<PathBuf> {
        self.inputs.iter().map(|(_, path)| path.clone()).collect()
    }

    /// The shard as a place where trees are written to.
    fn target(self) -> TreeTarget {
        let PartOfJob { head, shard, check, .. } = self;
        TreeTarget::Shard { head, shard, check }
    }
}

/// Makes sure that an input of a kind that is read where it is mapped is not elsewhere.
fn check_is_here(input: &Path) -> Result<()> {
    match url_of(input) {
        None => Ok(()),
        Some(_) => Err(Error::unsupported(input, "a file elsewhere", "copy it to this machine first")),
    }
}

/// Whether pieces have all of each layer, one behind the other, and are cut where they may be.
fn are_all(pieces: &[ShardPiece], layers: &[Header]) -> bool {
    let mut pieces = pieces.iter();
    for (number, header) in (0..).zip(layers) {
        let mut next = 0;
        while next <= CodeRun::ALL.ends()[1] {
            let Some(piece) = pieces.next() else { return false };
            let [first, last] = piece.run.ends();
            let is_cut = piece.run.is_cut_at(header.form.dimension, header.shape.crown_level());
            if piece.layer != number || first != next || !is_cut {
                return false;
            }
            next = last + 1;
        }
    }
    pieces.next().is_none()
}
