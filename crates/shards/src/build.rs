//! Building of one shard of a job.

use spinney_base::{Progress, Result};
use spinney_engine::store::TreeWriter;
use spinney_engine::store::goblin::LightFile;
use spinney_raster::import::{plan as plan_pictures, plan_stack, write_layers};

use crate::job::Job;
use crate::options::ShardedImport;
use crate::stamp::check;

/// What has become of a shard.
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
        let check = || check(&self.plan.inputs, &self.raster_options(), &self.plan.files);
        check()?;
        let (folder, inputs) = (shard.folder.clone(), &self.plan.inputs);
        let mut file = TreeWriter::shard(&self.head_path(), shard.clone())?;
        match self.import.clone().with_memory(memory) {
            ShardedImport::Pictures(options) => {
                plan_pictures(inputs, &options)?.write(&mut file, &folder, progress)?;
            }
            ShardedImport::Stack(options) => {
                write_layers(&plan_stack(inputs, &options)?, &mut file, &folder, progress)?;
            }
        }
        // Once more, since the shard has to be of one state of them.
        check()?;
        file.finish()?;
        Ok(Built { was_there: false, bytes: LightFile::find(&shard)?.map_or(0, |light| light.run_bytes()) })
    }
}
