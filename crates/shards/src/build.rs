//! Building one shard of a job.

use spinney_base::{Error, Progress, Result};
use spinney_engine::store::TreeTarget;
use spinney_engine::store::goblin::Shard;

use crate::job::Job;
use crate::stamp::check;
use crate::work::{PlannedWork, ShardTask};

/// Outcome of building a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShardOutcome {
    /// Whether the shard existed already, so that nothing was built.
    pub existed: bool,
    /// Bytes of its segments.
    pub bytes: u64,
}

impl Job {
    /// Builds a shard unless it exists, on the threads of the current rayon pool and with about
    /// `memory` bytes. Leftovers of an aborted process are overwritten. If two processes build the
    /// same shard, both write the same bytes. Progress counts cells.
    ///
    /// # Errors
    /// If there is no such shard, if inputs differ from the plan, if they cannot be read or the
    /// shard cannot be written, or on cancellation. The shard does not exist then.
    pub fn build(&self, number: u32, memory: u64, progress: &dyn Progress) -> Result<ShardOutcome> {
        let shard = self.shard(number)?;
        if let Some(bytes) = self.work().find(&shard)? {
            return Ok(ShardOutcome { existed: true, bytes });
        }
        if shard.ranges.is_empty() {
            self.work().build_empty(&self.head_path(), shard)?;
            return Ok(ShardOutcome { existed: false, bytes: 0 });
        }
        let (work, planned) = (self.plan.work.clone(), &self.plan.inputs);
        let touched = work.work().touched(planned.len(), &shard, &self.layers);
        let touched: Vec<_> = touched.iter().map(|input| (*input, planned[*input].clone())).collect();
        let inputs = touched.iter().map(|(number, input)| (*number, input.path.clone())).collect();
        let access = self.access.clone();
        let check = move || {
            let touched: Vec<_> = touched.iter().map(|(_, input)| input).collect();
            check(&touched, work.work(), &access)
        };
        // The inputs are checked now, and again before the shard becomes visible, so that it
        // depends on a single version of them.
        check()?;
        let task = ShardTask { inputs, head: self.head_path(), shard: shard.clone(), check: Box::new(check) };
        self.work().build(task, memory, progress)?;
        self.built(&shard)
    }

    /// Builds a shard of layers that `write` provides, as [planned](crate::plan_arrays), unless it
    /// exists. `write` should query the target for the cells that are needed.
    ///
    /// # Errors
    /// Those of [`Job::build`], and of `write`; also if the job was planned for other layers.
    pub fn build_arrays(
        &self,
        number: u32,
        token: &str,
        write: &mut dyn FnMut(TreeTarget) -> Result<()>,
    ) -> Result<ShardOutcome> {
        let planned = match &self.plan.work {
            PlannedWork::Arrays(arrays) => &*arrays.token,
            _ => "files",
        };
        if planned != token {
            return Err(Error::PlanMismatch {
                path: self.directory().to_path_buf(),
                found: format!("the arrays have the token {token}"),
                expected: planned.into(),
                advice: "plan another job in another directory",
            });
        }
        let shard = self.shard(number)?;
        if let Some(bytes) = self.work().find(&shard)? {
            return Ok(ShardOutcome { existed: true, bytes });
        }
        let check = Box::new(|| Ok(()));
        write(TreeTarget::Shard { head: self.head_path(), shard: shard.clone(), check })?;
        self.built(&shard)
    }

    /// Outcome for a shard that has just been built.
    fn built(&self, shard: &Shard) -> Result<ShardOutcome> {
        Ok(ShardOutcome { existed: false, bytes: self.work().find(shard)?.unwrap_or(0) })
    }
}
