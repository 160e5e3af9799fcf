//! Stacks: several rasters as layers of one file.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::{Bounds, Dimension};
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::TreeWriter;
use spinney_raster::import::{Stack as RasterStack, StackLayer, StackOptions, plan_stack, write_layers};

use super::rasters::files_of;
use super::{Load, PlannedWork, ShardTask, Work, WorkPlan};
use crate::job::PlannedInput;

/// Layers of a file, one or more per input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Stack {
    options: StackOptions,
}

impl Stack {
    pub(super) fn of(options: &StackOptions) -> Stack {
        Stack { options: options.clone() }
    }
}

/// Writes the head file.
pub(super) fn write_head(
    (paths, inputs): (&[PathBuf], &[PlannedInput]),
    options: &StackOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let mut options = options.clone();
    options.import.access = head.access().clone();
    if options.import.referenced.is_some() {
        let advice = "index the files without shards (`spinney index --stack`)";
        return Err(Error::unsupported(head.path(), "an index of several layers in shards", advice));
    }
    let stack = plan_stack(paths, &options)?;
    if let Some(layer) = stack.layers.iter().find(|layer| layer.is_warped()) {
        let found = "a stack of layers on different grids in shards";
        let advice = "first warp this file to the grid of the finest layer: `spinney build --grid`";
        return Err(Error::unsupported(layer.path(), found, advice));
    }
    let mut file = TreeWriter::head(head, (Dimension::Quad, stack.depth), stack.layers.len() as u32)?;
    write_layers(&stack, &mut file, Path::new(""), progress)?;
    file.finish()?;
    let size_of = |path: &Path| {
        let input = paths.iter().position(|input| input == path);
        input.map_or(0, |input| inputs[input].bytes())
    };
    let (loads, description) = (loads(&stack, size_of), stack.description().to_vec());
    Ok(WorkPlan { work: PlannedWork::Stack(Box::new(Stack::of(&options))), loads, ranges: None, description })
}

/// Layers of a stack, each with its share of its file's bytes.
fn loads(stack: &RasterStack, size_of: impl Fn(&Path) -> u64) -> Vec<Load> {
    let load = |(layer, found): (usize, &StackLayer)| {
        let of_file = stack.layers.iter().filter(|other| other.path() == found.path()).count() as u64;
        Load { layer, cells: Bounds::of_extent(found.extent), bytes: size_of(found.path()) / of_file.max(1) }
    };
    stack.layers.iter().enumerate().map(load).collect()
}

impl Work for Stack {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        files_of(input, &self.options.import, access)
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let mut options = self.options.clone();
        options.import.memory = Some(memory);
        options.import.access = part.shard.access.clone();
        let stack = plan_stack(&part.paths(), &options)?;
        let directory = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Quad, stack.depth), stack.layers.len() as u32)?;
        write_layers(&stack, &mut file, &directory, progress)?;
        file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stack_work_survives_serialization() {
        let mut stack = StackOptions::new();
        stack.every_page = true;
        (stack.names, stack.times) = (Some(vec!["a".into()]), Some(vec!["2024-05-31".into()]));
        let text = serde_json::to_string(&Stack::of(&stack)).unwrap();
        let again: Stack = serde_json::from_str(&text).unwrap();
        assert_eq!(again.options, stack);
    }
}
