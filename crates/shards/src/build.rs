//! Building of one shard of a job.

use std::path::PathBuf;

use spinney_base::space::{Bounds, Dimension, Region};
use spinney_base::{Progress, Result};
use spinney_container::OpenOptions;
use spinney_engine::store::TreeWriter;
use spinney_engine::store::goblin::{Goblin, LightFile, Shard};
use spinney_raster::import::{MosaicPlan, plan as plan_pictures, plan_part, plan_stack, write_layers};

use crate::job::{Job, PlannedInput};
use crate::options::ShardedImport;
use crate::stamp::check;

/// Outcome of building a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Built {
    /// Whether it was made already, and nothing was done.
    pub was_there: bool,
    /// Bytes of its segments.
    pub bytes: u64,
}

impl Job {
    /// Builds a shard, unless it is made already, on the threads of the current rayon pool and with about `memory` bytes. Whatever was left of
    /// it by a process that was cut off is overwritten; if two processes build it, both write the same. Progress counts cells.
    ///
    /// # Errors
    /// If there is no such shard, if inputs are not those that were planned, if they cannot be read or the shard not be written, or on
    /// interruption; the shard is not made then.
    pub fn build(&self, number: u32, memory: u64, progress: &dyn Progress) -> Result<Built> {
        let shard = self.shard(number)?;
        if let Some(light) = LightFile::find(&shard)? {
            return Ok(Built { was_there: true, bytes: light.run_bytes() });
        }
        let inputs = self.inputs_of(&shard);
        let check = || {
            let options = self.raster_options();
            inputs.iter().try_for_each(|input| {
                progress.check()?;
                check(&input.path, &options, &input.files)
            })
        };
        check()?;
        let paths: Vec<PathBuf> = inputs.iter().map(|input| input.path.clone()).collect();
        let folder = shard.folder.clone();
        let mut file = TreeWriter::shard(&self.head_path(), shard.clone())?;
        match (self.import.clone().with_memory(memory), self.mosaic_of(&shard)) {
            (ShardedImport::Pictures(options), Some(mosaic)) => {
                let head = Goblin::open(&self.head_path(), &OpenOptions::default())?;
                let planned = (head.header(), head.metadata());
                plan_part(&paths, &mosaic, planned, &options)?.write(&mut file, &folder, progress)?;
            }
            (ShardedImport::Pictures(options), None) => {
                plan_pictures(&paths, &options)?.write(&mut file, &folder, progress)?;
            }
            (ShardedImport::Stack(options), _) => {
                write_layers(&plan_stack(&paths, &options)?, &mut file, &folder, progress)?;
            }
        }
        // Once more, since the shard has to be of one state of them.
        check()?;
        file.finish()?;
        Ok(Built { was_there: false, bytes: LightFile::find(&shard)?.map_or(0, |light| light.run_bytes()) })
    }

    /// Numbers of the inputs that a shard is made of: of a mosaic those alone that have pixels in it.
    fn touched(&self, shard: &Shard) -> Vec<usize> {
        let Some(mosaic) = &self.mosaic else { return (0..self.plan.inputs.len()).collect() };
        let depth = self.depth;
        let touches = |region: &Region| {
            let cells = Bounds { min: [region.x, region.y, 0], max: [region.right(), region.bottom(), 1] };
            shard.pieces.iter().any(|piece| piece.run.cells(Dimension::Quad, depth, &cells) > 0)
        };
        (0..mosaic.regions.len()).filter(|input| touches(&mosaic.regions[*input])).collect()
    }

    fn inputs_of(&self, shard: &Shard) -> Vec<&PlannedInput> {
        self.touched(shard).into_iter().map(|input| &self.plan.inputs[input]).collect()
    }

    /// The mosaic of these inputs.
    fn mosaic_of(&self, shard: &Shard) -> Option<MosaicPlan> {
        let mut mosaic = self.mosaic.clone()?;
        mosaic.regions = self.touched(shard).into_iter().map(|input| mosaic.regions[input]).collect();
        Some(mosaic)
    }
}
