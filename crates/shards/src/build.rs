//! Building of one shard of a job.

use spinney_base::{Error, Progress, Result};
use spinney_engine::store::TreeTarget;
use spinney_engine::store::goblin::Shard;

use crate::job::Job;
use crate::stamp::check;
use crate::work::{PartOfJob, PlannedWork};

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
        if let Some(bytes) = self.work().find(&shard)? {
            return Ok(Built { was_there: true, bytes });
        }
        if shard.pieces.is_empty() {
            self.work().build_empty(&self.head_path(), shard)?;
            return Ok(Built { was_there: false, bytes: 0 });
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
        // Once more before it counts as made, since it has to be of one state of them.
        check()?;
        let part = PartOfJob { inputs, head: self.head_path(), shard: shard.clone(), check: Box::new(check) };
        self.work().build(part, memory, progress)?;
        self.built(&shard)
    }

    /// Builds a shard of layers that `write` makes, as they were [planned](crate::plan_given), unless it is made already. Of the place that it is given it
    /// is to ask which cells are wanted.
    ///
    /// # Errors
    /// Those of [`Job::build`], and of `write`; also if the job is one of other layers.
    pub fn build_given(
        &self,
        number: u32,
        token: &str,
        write: &mut dyn FnMut(TreeTarget) -> Result<()>,
    ) -> Result<Built> {
        let planned = match &self.plan.work {
            PlannedWork::Given(given) => &*given.token,
            _ => "files",
        };
        if planned != token {
            return Err(Error::PlanMismatch {
                path: self.folder().to_path_buf(),
                found: format!("these are the arrays {token}"),
                expected: planned.into(),
                advice: "plan another job in another folder",
            });
        }
        let shard = self.shard(number)?;
        if let Some(bytes) = self.work().find(&shard)? {
            return Ok(Built { was_there: true, bytes });
        }
        let check = Box::new(|| Ok(()));
        write(TreeTarget::Shard { head: self.head_path(), shard: shard.clone(), check })?;
        self.built(&shard)
    }

    /// Outcome of a shard that was just built.
    fn built(&self, shard: &Shard) -> Result<Built> {
        Ok(Built { was_there: false, bytes: self.work().find(shard)?.unwrap_or(0) })
    }
}
