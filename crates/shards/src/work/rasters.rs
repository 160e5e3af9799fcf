//! Trees of rasters; several rasters are a mosaic.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::{Bounds, Dimension, Region};
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::TreeWriter;
use spinney_engine::store::goblin::{Goblin, MergeOutput, Shard, merge_index_shards, merge_shards};
use spinney_raster::import::{self, ImportOptions, MosaicPlan, RasterOptions, plan, plan_part};
use spinney_raster::index::sections_of_shards;

use super::{Load, PlannedWork, ShardTask, Work, WorkPlan};
use crate::job::PlannedInput;

/// Raster, or a mosaic of several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rasters {
    options: ImportOptions,
    mosaic: Option<MosaicPlan>,
}

/// Whether a mosaic matches the only layer and the number of inputs.
fn fits(mosaic: &MosaicPlan, inputs: usize, layers: &[Header]) -> bool {
    let is_inside = |Region { x, y, width, height }: &Region| {
        x.checked_add(*width).is_some_and(|right| right <= mosaic.size[0])
            && y.checked_add(*height).is_some_and(|bottom| bottom <= mosaic.size[1])
    };
    let is_layer = matches!(layers, [header] if header.extent[..2] == mosaic.size && header.form.axes() == 2);
    is_layer && mosaic.regions.len() == inputs && mosaic.regions.iter().all(is_inside)
}

impl Rasters {
    pub(super) fn of(options: &ImportOptions) -> Rasters {
        Rasters { options: options.clone(), mosaic: None }
    }
}

/// Files that reading a raster involves.
pub(super) fn files_of(input: &Path, import: &ImportOptions, access: &FileAccess) -> Result<Vec<PathBuf>> {
    let mut options = RasterOptions::new();
    options.layer.clone_from(&import.layer);
    options.page = import.page;
    options.access = access.clone();
    import::files_of(input, &options)
}

/// Writes the head file.
pub(super) fn write_head(
    (paths, inputs): (&[PathBuf], &[PlannedInput]),
    options: &ImportOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let mut options = options.clone();
    options.access = head.access().clone();
    let import_plan = plan(paths, &options)?;
    let whole = [Region::new(0, 0, import_plan.info().width, import_plan.info().height)];
    let regions = import_plan.mosaic().map_or(&whole[..], |mosaic| &mosaic.regions);
    let loads = regions.iter().zip(inputs).map(|(region, input)| {
        let (min, max) = ([region.x, region.y, 0], [region.right(), region.bottom(), 1]);
        Load { layer: 0, cells: Bounds { min, max }, bytes: input.bytes() }
    });
    let (loads, description) = (loads.collect(), import_plan.description().to_vec());
    let mosaic = import_plan.mosaic().cloned();
    let mut file = TreeWriter::head(head, (Dimension::Quad, import_plan.options().depth), 1)?;
    import_plan.write(&mut file, Path::new(""), progress)?;
    file.finish()?;
    let work = PlannedWork::Rasters(Box::new(Rasters { mosaic, ..Rasters::of(&options) }));
    Ok(WorkPlan { work, loads, ranges: None, description })
}

impl Work for Rasters {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        files_of(input, &self.options, access)
    }

    fn check(&self, inputs: usize, layers: &[Header]) -> Result<()> {
        match &self.mosaic {
            Some(mosaic) if !fits(mosaic, inputs, layers) => Err(Error::invalid(
                "mosaic",
                "regions that do not fit",
                "one region per input, within its size",
            )),
            _ => Ok(()),
        }
    }

    /// For a mosaic, only the inputs with pixels in the shard.
    fn touched(&self, inputs: usize, shard: &Shard, layers: &[Header]) -> Vec<usize> {
        let Some(mosaic) = &self.mosaic else { return (0..inputs).collect() };
        let depth = layers.first().map_or(0, Header::depth);
        let touches = |region: Region| {
            let cells = Bounds { min: [region.x, region.y, 0], max: [region.right(), region.bottom(), 1] };
            shard.ranges.iter().any(|range| range.run.cells(Dimension::Quad, depth, &cells) > 0)
        };
        (0..inputs).filter(|input| touches(mosaic.regions[*input])).collect()
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let mut options = self.options.clone();
        options.memory = Some(memory);
        options.access = part.shard.access.clone();
        let paths = part.paths();
        let import_plan = match &self.mosaic {
            None => plan(&paths, &options)?,
            Some(mosaic) => {
                let regions = part.inputs.iter().map(|(number, _)| mosaic.regions[*number]).collect();
                let mut mosaic = mosaic.clone();
                mosaic.regions = regions;
                let head = Goblin::open(&part.head, &(&options.access).into())?;
                plan_part(&paths, &mosaic, (head.header(), head.metadata()), &options)?
            }
        };
        let (shard, recorder) = (part.shard.clone(), import_plan.recorder());
        let directory = shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Quad, import_plan.options().depth), 1)?;
        import_plan.write(&mut file, &directory, progress)?;
        // (The summary, which completes the shard, is written last.)
        if let Some(recorder) = recorder {
            let path = shard.sources_path();
            let mut output = shard.access.append_only(&path)?;
            output.write_all(&recorder.checksums(&path)?).map_err(Error::io(&path, "write"))?;
            output.commit()?;
        }
        file.finish()
    }

    fn reads_inputs_to_merge(&self) -> bool {
        self.options.referenced.is_some()
    }

    fn merge(
        &self,
        head: &Path,
        shards: &[Shard],
        (inputs, output, memory): (&[PathBuf], MergeOutput, u64),
        progress: &dyn Progress,
    ) -> Result<()> {
        if self.options.referenced.is_none() {
            return merge_shards(head, shards, output, memory / 8, progress);
        }
        let mut options = self.options.clone();
        options.access = output.access().clone();
        options.memory = Some(memory);
        let mut checksums = shards.iter().filter(|shard| !shard.ranges.is_empty()).map(|shard| {
            let path = shard.sources_path();
            let bytes = shard.access.read_whole(&path, MAX_CHECKSUMS)?.ok_or_else(|| shard.not_built())?;
            Ok((path, bytes))
        });
        let references = sections_of_shards(output.path(), inputs, &options, &mut checksums, progress)?;
        merge_index_shards(head, shards, (output, memory / 8), references, progress)
    }
}

/// Maximum number of bytes of a shard's checksums.
const MAX_CHECKSUMS: u64 = 256 << 20;
