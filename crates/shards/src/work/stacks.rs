//! Stacks: several rasters as layers of one file.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::{Bounds, Dimension};
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::TreeWriter;
use spinney_raster::import::{Stack as RasterStack, StackLayer, StackOptions, plan_stack, write_layers};

use super::pictures::files_of;
use super::{Load, PartOfJob, PlannedWork, Told, Work};
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
) -> Result<Told> {
    let mut options = options.clone();
    options.import.access = head.access().clone();
    let stack = plan_stack(paths, &options)?;
    if let Some(layer) = stack.layers.iter().find(|layer| layer.is_warped()) {
        let found = "a layer on another grid than the finest, in shards,";
        let advice = "build its file by itself with --grid first, and stack the others";
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
    Ok(Told { work: PlannedWork::Stack(Box::new(Stack::of(&options))), loads, pieces: None, description })
}

/// Layers of a stack, each with its share of its file's bytes.
fn loads(stack: &RasterStack, size_of: impl Fn(&Path) -> u64) -> Vec<Load> {
    let load = |(layer, found): (usize, &StackLayer)| {
        let of_file = stack.layers.iter().filter(|other| other.path() == found.path()).count() as u64;
        Load { layer, cells: Bounds::picture(found.extent), bytes: size_of(found.path()) / of_file.max(1) }
    };
    stack.layers.iter().enumerate().map(load).collect()
}

impl Work for Stack {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        files_of(input, &self.options.import, access)
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        let mut options = self.options.clone();
        options.import.memory = Some(memory);
        options.import.access = part.shard.access.clone();
        let stack = plan_stack(&part.paths(), &options)?;
        let folder = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Quad, stack.depth), stack.layers.len() as u32)?;
        write_layers(&stack, &mut file, &folder, progress)?;
        file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_back() {
        let mut stack = StackOptions::new();
        stack.every_page = true;
        (stack.names, stack.times) = (Some(vec!["a".into()]), Some(vec!["2024-05-31".into()]));
        let text = serde_json::to_string(&Stack::of(&stack)).unwrap();
        let again: Stack = serde_json::from_str(&text).unwrap();
        assert_eq!(again.options, stack);
    }
}
