//! Trees of points.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output, url_of};
use spinney_base::space::CodeRange;
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::goblin::{MergeOutput, Shard, ShardRange};
use spinney_points::shard::{self, PointCut, PointShard};
use spinney_points::{PointImport, PointImportOptions, PointTree};
use spinney_vector::import::feature::FeatureOptions;
use spinney_vector::import::filter::FeatureFilter;
use spinney_vector::import::plan_point_files;

use super::{PlannedWork, ShardTask, Work, WorkPlan, check_is_local, missing_of};

/// LAS and LAZ files that are built to one tree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Points {
    options: PointImportOptions,
    /// Conditions in their command-line syntax; `None` if all points are kept.
    filter: Option<String>,
    /// Level of the nodes at which shards are cut.
    level: u8,
    /// Total number of points, if the file headers have it.
    points: Option<u64>,
}

impl Points {
    pub(super) fn of(options: &PointImportOptions, filter: &FeatureFilter) -> Points {
        Points {
            options: options.clone(),
            filter: (!filter.conditions.is_empty()).then(|| filter.to_string()),
            level: 0,
            points: None,
        }
    }

    fn filter(&self) -> Result<FeatureFilter> {
        self.filter.as_deref().map_or(Ok(FeatureFilter::default()), str::parse)
    }

    /// Shard with the data that point trees need.
    fn shard(&self, shard: &Shard) -> PointShard {
        PointShard { shard: shard.clone(), level: self.level }
    }
}

fn import_of(paths: &[PathBuf], options: &PointImportOptions, filter: FeatureFilter) -> Result<PointImport> {
    plan_point_files(paths, &FeatureOptions { filter, ..FeatureOptions::default() }, options)
}

/// Writes the head file, and cuts the tree into `shards` shards.
pub(super) fn write_head(
    paths: &[PathBuf],
    (options, filter): (&PointImportOptions, &FeatureFilter),
    (head, shards): (Output, u32),
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    if url_of(head.path()).is_some() {
        let advice = "choose a directory that all machines can access";
        return Err(Error::unsupported(head.path(), "a job of point files in a bucket", advice));
    }
    let import = import_of(paths, options, filter.clone())?;
    let PointCut { level, runs, points } = shard::cut(&import, shards)?;
    import.warn_of_remarks(progress);
    shard::write_head(&import, head)?;
    let range = |run: &Option<CodeRange>| run.iter().map(|run| ShardRange { layer: 0, run: *run }).collect();
    let work = PlannedWork::Points(Points { level, points, ..Points::of(options, filter) });
    let (ranges, description) = (Some(runs.iter().map(range).collect()), import.description().to_vec());
    Ok(WorkPlan { work, loads: Vec::new(), ranges, description })
}

impl Work for Points {
    fn files_of(&self, input: &Path, _: &FileAccess) -> Result<Vec<PathBuf>> {
        check_is_local(input)?;
        Ok(vec![input.to_path_buf()])
    }

    /// Always empty: point trees have no layers.
    fn layers(&self, head: Vec<u8>) -> Result<Vec<Header>> {
        PointTree::from_bytes(head).map(|_| Vec::new())
    }

    fn check(&self, _inputs: usize, _layers: &[Header]) -> Result<()> {
        self.filter().map(|_| ())
    }

    fn are_all(&self, ranges: &[ShardRange], _layers: &[Header]) -> bool {
        let mut next = 0;
        for ShardRange { layer, run } in ranges {
            let [first, last] = run.ends();
            if *layer != 0 || first != next {
                return false;
            }
            next = last + 1;
        }
        next > CodeRange::ALL.ends()[1]
    }

    fn find(&self, shard: &Shard) -> Result<Option<u64>> {
        shard::find_shard(&self.shard(shard))
    }

    fn missing(&self, shards: &[Shard], _output: Option<&MergeOutput>) -> Result<Vec<u32>> {
        missing_of(shards, shards.iter().map(|shard| Ok(self.find(shard)?.is_some())))
    }

    fn build_empty(&self, head: &Path, shard: Shard) -> Result<()> {
        shard::build_empty_shard(head, &self.shard(&shard))
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let mut options = self.options.clone();
        options.build.memory = memory;
        let import = import_of(&part.paths(), &options, self.filter()?)?;
        shard::build_shard(&import, (&part.head, &self.shard(&part.shard)), &part.check, progress)
    }

    fn merge(
        &self,
        head: &Path,
        shards: &[Shard],
        (_, output, memory): (&[PathBuf], MergeOutput, u64),
        progress: &dyn Progress,
    ) -> Result<()> {
        let output = match output {
            MergeOutput::Keep(output) => output,
            // Shards are removed once the file is complete, which is written in a single pass.
            MergeOutput::Remove(mut output, _) => {
                let path = output.path().to_path_buf();
                output.truncate(0).map_err(Error::io(path, "truncate"))?;
                output
            }
        };
        let shards: Vec<PointShard> = shards.iter().map(|shard| self.shard(shard)).collect();
        shard::merge_shards(head, &shards, self.points, (output, memory / 16), progress).map(|_| ())
    }
}
