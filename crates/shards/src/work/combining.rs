//! Combination of several trees by an operation.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::{Progress, Result};
use spinney_container::Header;
use spinney_engine::ops::{CombineOperation, CombineOptions, Outcome, combine_with};
use spinney_engine::store::{Packing, TreeTarget, WriteOptions};

use super::trees::{LITTLE, description, files_of};
use super::{PlannedWork, ShardTask, Work, WorkPlan};

/// Operation, and the fill value and region for cells that no input has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Combining {
    operation: CombineOperation,
    options: CombineOptions,
    packing: Packing,
}

impl Combining {
    pub(super) fn of(operation: CombineOperation, options: CombineOptions, packing: Packing) -> Combining {
        Combining { operation, options, packing }
    }

    fn run(
        &self,
        paths: &[PathBuf],
        target: TreeTarget,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Outcome> {
        let how = WriteOptions::new(memory).packing(self.packing);
        combine_with(self.operation, self.options, paths, &[], target, how, progress)
    }
}

/// Writes the head file.
pub(super) fn write_head(
    paths: &[PathBuf],
    work: Combining,
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let outcome = work.run(paths, TreeTarget::Head(head), LITTLE, progress)?;
    let (work, description) = (PlannedWork::Combine(work), description(&outcome));
    Ok(WorkPlan { work, loads: Vec::new(), ranges: None, description })
}

impl Work for Combining {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        files_of(input, access)
    }

    fn check(&self, _: usize, _: &[Header]) -> Result<()> {
        Ok(())
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        self.run(&part.paths(), part.target(), memory, progress).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::SetOperation;
    use spinney_base::value::Number;
    use spinney_engine::ops::{Prefer, Universe};

    #[test]
    fn combining_work_survives_serialization() {
        let xor = CombineOperation::Set { operation: SetOperation::Equivalence, prefer: Prefer::Second };
        let within = Universe::Within([0.1, -1e-9, 0.0], [1.0 / 3.0, 7.0, 0.0]);
        let of = |fill, universe| CombineOptions { fill, universe, ..CombineOptions::default() };
        for how in [
            (xor, of(Some(Number::from(3)), within)),
            (CombineOperation::Changed, CombineOptions::default()),
            (CombineOperation::set(SetOperation::Complement), of(None, Universe::Margin(4))),
        ] {
            let (operation, options) = how;
            let planned = Combining::of(operation, options, Packing::default());
            let text = serde_json::to_string(&planned).unwrap();
            assert_eq!(serde_json::from_str::<Combining>(&text).unwrap(), planned);
        }
        let unknown = serde_json::to_string(&Combining::of(
            CombineOperation::set(SetOperation::Complement),
            CombineOptions::default(),
            Packing::default(),
        ))
        .unwrap()
        .replace("complement", "complements");
        assert!(serde_json::from_str::<Combining>(&unknown).is_err());
    }
}
