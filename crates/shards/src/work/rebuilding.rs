//! Trees with the cells of another tree and other properties.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::dataset::{Rebuild, open};
use spinney_engine::store::{Packing, TreeTarget};

use super::trees::{LITTLE, files_of};
use super::{PlannedWork, ShardTask, Work, WorkPlan};

/// Properties that differ from the input tree's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rebuilding {
    other: Rebuild,
    packing: Packing,
}

impl Rebuilding {
    pub(super) fn of(other: &Rebuild, packing: Packing) -> Rebuilding {
        Rebuilding { other: other.clone(), packing }
    }
}

/// Builds the tree, or the subset that `target` requests.
fn build(
    path: &Path,
    (other, packing): (&Rebuild, Packing),
    memory: u64,
    target: TreeTarget,
    progress: &dyn Progress,
) -> Result<[(&'static str, String); 3]> {
    let tree = open(path, &target.access().into())?;
    let mut options = tree.rebuild_options(other, memory)?;
    options.packing = packing;
    tree.build_to(&options, target, progress)?;
    Ok([
        ("kind", options.kind.to_string()),
        ("rule", options.rule.to_string()),
        ("depth", format!("{} levels", options.depth)),
    ])
}

/// Writes the head file.
pub(super) fn write_head(
    path: &Path,
    (other, packing): (&Rebuild, Packing),
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let described = build(path, (other, packing), LITTLE, TreeTarget::Head(head), progress)?;
    let work = PlannedWork::Rebuild(Box::new(Rebuilding::of(other, packing)));
    Ok(WorkPlan { work, loads: Vec::new(), ranges: None, description: described.into() })
}

impl Work for Rebuilding {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        files_of(input, access)
    }

    fn check(&self, inputs: usize, _: &[Header]) -> Result<()> {
        match inputs {
            1 => Ok(()),
            _ => Err(Error::invalid("inputs", inputs.to_string(), "1 tree")),
        }
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let (_, path) = part.inputs[0].clone();
        build(&path, (&self.other, self.packing), memory, part.target(), progress).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::{DataKind, Rule};
    use spinney_crs::Crs;

    #[test]
    fn rebuilding_work_survives_serialization() {
        let matrix = [[0.1, 0.0, 0.0, 1e-300], [0.0, -1.0 / 3.0, 0.0, 5.0], [0.0, 0.0, 1.0, 0.0]];
        let (kind, rule) = (Some(DataKind::Categorical), Some(Rule::Max));
        let other = Rebuild { kind, rule, depth: Some(12), matrix: Some(matrix), crs: Some(Crs::epsg(4326)) };
        for other in [other, Rebuild::default()] {
            let text = serde_json::to_string(&Rebuilding::of(&other, Packing::default())).unwrap();
            let again: Rebuilding = serde_json::from_str(&text).unwrap();
            assert_eq!(again.other, other);
        }
    }
}
