//! Trees of several others, merged by an operation.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::value::Number;
use spinney_base::{Error, Progress, Result, SetOperation};
use spinney_container::Header;
use spinney_engine::ops::{CombineOperation, CombineOptions, Prefer, Universe, combine_with};
use spinney_engine::store::{Packing, TreeTarget, WriteOptions};

use super::packing::PlannedPacking;
use super::trees::{LITTLE, description, files_of};
use super::{PartOfJob, PlannedWork, Told, Work, number};

/// Operation on trees. Numbers that are no whole ones are texts, so that every digit of them stays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Combining {
    operation: String,
    /// Whether cells of two trees get the second's value.
    prefers_second: bool,
    fill: Option<String>,
    /// Cells around the pictures that are filled.
    margin: Option<u32>,
    /// Box of the world that is filled.
    within: Option<[[String; 3]; 2]>,
    packing: PlannedPacking,
}

/// An operation, with the value that it fills cells with, and where.
pub(super) type How = (CombineOperation, CombineOptions);

impl Combining {
    pub(super) fn of(
        operation: CombineOperation,
        CombineOptions { fill, universe }: CombineOptions,
        packing: Packing,
    ) -> Combining {
        let (name, prefer) = match operation {
            CombineOperation::Set { operation, prefer } => (operation.index().to_string(), prefer),
            operation => (operation.to_string(), Prefer::First),
        };
        let (margin, within) = match universe {
            Universe::Usual => (None, None),
            Universe::Margin(cells) => (Some(cells), None),
            Universe::Within(low, high) => {
                (None, Some([low, high].map(|corner| corner.map(|number| number.to_string()))))
            }
        };
        let (fill, packing) = (fill.map(|fill| fill.to_string()), PlannedPacking::of(packing));
        let prefers_second = prefer == Prefer::Second;
        Combining { operation: name, prefers_second, fill, margin, within, packing }
    }

    fn how(&self) -> Result<How> {
        let prefer = if self.prefers_second { Prefer::Second } else { Prefer::First };
        let operation = CombineOperation::named(&self.operation, prefer).ok_or_else(|| {
            Error::invalid("operation", format!("`{}`", self.operation), "a name, or a number from 0 to 15")
        })?;
        let fill = self.fill.as_deref().map(number).transpose()?;
        let universe = match (self.margin, &self.within) {
            (None, None) => Universe::Usual,
            (Some(cells), _) => Universe::Margin(cells),
            (None, Some(corners)) => {
                let mut numbers = [[0.0; 3]; 2];
                for (number_of, text) in numbers.as_flattened_mut().iter_mut().zip(corners.as_flattened()) {
                    *number_of = number(text)?;
                }
                Universe::Within(numbers[0], numbers[1])
            }
        };
        Ok((operation, CombineOptions { fill, universe }))
    }
}

/// Writes a file that tells of the layers.
pub(super) fn write_head(
    paths: &[PathBuf],
    (operation, options): How,
    packing: Packing,
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    let (target, how) = (TreeTarget::Head(head), WriteOptions::new(LITTLE).packing(packing));
    let outcome = combine_with(operation, options, paths, &[], target, how, progress)?;
    let work = PlannedWork::Combine(Combining::of(operation, options, packing));
    Ok(Told { work, loads: Vec::new(), pieces: None, description: description(&outcome) })
}

impl Work for Combining {
    fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        files_of(input)
    }

    fn packing(&self) -> Result<Packing> {
        self.packing.packing()
    }

    fn check(&self, _: usize, _: &[Header]) -> Result<()> {
        self.packing()?;
        self.how().map(|_| ())
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        let (operation, options) = self.how()?;
        let (paths, how) = (part.paths(), WriteOptions::new(memory).packing(self.packing()?));
        combine_with(operation, options, &paths, &[], part.target(), how, progress).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_come_back() {
        let xor = CombineOperation::Set { operation: SetOperation::Equivalence, prefer: Prefer::Second };
        let within = Universe::Within([0.1, -1e-9, 0.0], [1.0 / 3.0, 7.0, 0.0]);
        let of = |fill, universe| CombineOptions { fill, universe };
        for how in [
            (xor, of(Some(Number::from(3)), within)),
            (CombineOperation::Changed, CombineOptions::default()),
            (CombineOperation::set(SetOperation::Complement), of(None, Universe::Margin(4))),
        ] {
            let (operation, options) = how;
            let planned = Combining::of(operation, options, Packing::default());
            let text = serde_json::to_string(&planned).unwrap();
            assert_eq!(serde_json::from_str::<Combining>(&text).unwrap().how().unwrap(), how);
        }
    }
}
