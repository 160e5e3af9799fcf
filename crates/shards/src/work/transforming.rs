//! Trees of operations applied to another tree.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::ops::{FileView, ViewOperation, WarpOptions, transform_to};
use spinney_engine::store::{Packing, TreeTarget, WriteOptions};

use super::trees::{LITTLE, description, files_of};
use super::{PlannedWork, ShardTask, Work, WorkPlan};
use crate::stamp::absolute;

/// Chain of operations without its tree, which is the first input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Transforming {
    /// Operations as strings; file names in them are absolute.
    steps: Vec<String>,
    moves: bool,
    warp: WarpOptions,
    packing: Packing,
}

/// Files of a chain: its tree, and those of its operations.
pub(super) fn files(chain: &FileView) -> Vec<PathBuf> {
    let of_steps = chain.steps.iter().flat_map(ViewOperation::files);
    [&*chain.path].into_iter().chain(of_steps).map(Path::to_path_buf).collect()
}

impl Transforming {
    pub(super) fn of(chain: &FileView, packing: Packing) -> Result<Transforming> {
        let written = |step: &ViewOperation| {
            let step = step.with_files(&absolute)?;
            let text = step.to_string();
            if text.parse::<ViewOperation>().ok().as_ref() != Some(&step) {
                let advice = "apply it in a single process first, and the others in shards";
                return Err(Error::unsupported(
                    &chain.path,
                    format!("the operation {text}, which has no exact text form,"),
                    advice,
                ));
            }
            Ok(text)
        };
        Ok(Transforming {
            steps: chain.steps.iter().map(written).collect::<Result<_>>()?,
            moves: chain.moves,
            warp: chain.warp,
            packing,
        })
    }

    /// Applies the chain to the tree at a path.
    fn chain(&self, path: &Path, access: &FileAccess) -> Result<FileView> {
        let steps = self.steps.iter().map(|step| step.parse()).collect::<Result<_>>()?;
        Ok(FileView {
            path: path.into(),
            name: None,
            steps,
            moves: self.moves,
            warp: self.warp,
            unit: None,
            access: access.clone(),
        })
    }
}

/// Writes the head file.
pub(super) fn write_head(
    chain: &FileView,
    packing: Packing,
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let how = WriteOptions::new(LITTLE).packing(packing);
    let outcome = transform_to(
        &FileView { access: head.access().clone(), ..chain.clone() },
        TreeTarget::Head(head),
        how,
        progress,
    )?;
    let work = PlannedWork::Transform(Transforming::of(chain, packing)?);
    Ok(WorkPlan { work, loads: Vec::new(), ranges: None, description: description(&outcome) })
}

impl Work for Transforming {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        files_of(input, access)
    }

    fn check(&self, inputs: usize, _: &[Header]) -> Result<()> {
        let found = files(&self.chain(Path::new(""), &FileAccess::default())?).len();
        if found == inputs {
            return Ok(());
        }
        Err(Error::invalid(
            "inputs",
            inputs.to_string(),
            format!("{found}: a tree and the files of its operations"),
        ))
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let chain = self.chain(&part.inputs[0].1, &part.shard.access)?;
        let how = WriteOptions::new(memory).packing(self.packing);
        transform_to(&chain, part.target(), how, progress).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_engine::ops::Resampling;

    #[test]
    fn chains_survive_serialization() {
        let mut chain = FileView::of(Path::new("/a/b.goblin"));
        let steps = ["rotate=0.1@2.5,3e-7", "like=/x, y.goblin", "calc=(a-b1)/3,a=\"/c, d.goblin\",type=f64"];
        chain.steps = steps.iter().map(|step| step.parse().unwrap()).collect();
        chain.moves = true;
        chain.warp.resampling = Some(Resampling::Cubic);
        chain.warp.level_cells = Some(WarpOptions::PREVIEW);
        let planned = Transforming::of(&chain, Packing::default()).unwrap();
        let text = serde_json::to_string(&planned).unwrap();
        let again: Transforming = serde_json::from_str(&text).unwrap();
        assert_eq!(again.chain(&chain.path, &chain.access).unwrap(), chain);
        assert_eq!(files(&chain), ["/a/b.goblin", "/x, y.goblin", "/c, d.goblin"].map(PathBuf::from));
        again.check(3, &[]).unwrap();
        again.check(2, &[]).unwrap_err();
    }
}
