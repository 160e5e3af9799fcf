//! Trees of several others, merged by an operation.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::value::Number;
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::ops::{Operation, Outcome, Universe, combine_with};
use spinney_engine::store::{Packing, TreeTarget, WriteOptions};

use super::trees::{LITTLE, description, files_of};
use super::{PartOfJob, PlannedWork, Told, Work};

/// Operation on trees, and what it fills cells with, and where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Combining {
    operation: Operation,
    #[serde(with = "spinney_base::text_fields")]
    fill: Option<Number>,
    universe: Universe,
    packing: Packing,
}

impl Combining {
    pub(super) fn of(
        operation: Operation,
        fill: Option<Number>,
        universe: Universe,
        packing: Packing,
    ) -> Combining {
        Combining { operation, fill, universe, packing }
    }

    fn run(
        &self,
        paths: &[PathBuf],
        target: TreeTarget,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Outcome> {
        let (universe, how) = ((self.fill, self.universe), WriteOptions::new(memory).packing(self.packing));
        combine_with(self.operation, universe, paths, &[], target, how, progress)
    }
}

/// Writes a file that tells of the layers.
pub(super) fn write_head(
    paths: &[PathBuf],
    work: Combining,
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    let outcome = work.run(paths, TreeTarget::Head(head), LITTLE, progress)?;
    let (work, description) = (PlannedWork::Combine(work), description(&outcome));
    Ok(Told { work, loads: Vec::new(), pieces: None, description })
}

impl Work for Combining {
    fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        files_of(input)
    }

    fn check(&self, _: usize, _: &[Header]) -> Result<()> {
        match self.operation {
            Operation::Set { number, .. } if number > 15 => {
                Err(Error::invalid("operation", number.to_string(), "a number from 0 to 15"))
            }
            _ => Ok(()),
        }
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        self.run(&part.paths(), part.target(), memory, progress).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_engine::ops::Prefer;

    #[test]
    fn operations_come_back() {
        let xor = Operation::Set { number: 9, prefer: Prefer::Second };
        let within = Universe::Within([0.1, -1e-9, 0.0], [1.0 / 3.0, 7.0, 0.0]);
        for how in [
            (xor, Some(Number::from(3)), within),
            (Operation::Changed, None, Universe::Usual),
            (Operation::Set { number: 12, prefer: Prefer::First }, None, Universe::Margin(4)),
        ] {
            let (operation, fill, universe) = how;
            let planned = Combining::of(operation, fill, universe, Packing::default());
            let text = serde_json::to_string(&planned).unwrap();
            assert_eq!(serde_json::from_str::<Combining>(&text).unwrap(), planned);
        }
        let too_large = Operation::Set { number: 16, prefer: Prefer::First };
        Combining::of(too_large, None, Universe::Usual, Packing::default()).check(2, &[]).unwrap_err();
    }
}
