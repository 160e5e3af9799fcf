//! Writing of stacks.

use super::Stack;
use spinney_base::io::{Output, folder};
use spinney_base::space::Dimension;
use spinney_base::{Error, Form, Progress, Result};
use spinney_container::check_tree_name;
use spinney_engine::store::{BuildOptions, build_slabs};

/// Writes a stack to a file, on the threads of the current rayon pool; progress counts cells.
///
/// # Errors
/// If a file cannot be read or has changed, or the output not be written, or on interruption; nothing is left behind then.
pub fn write_stack(stack: &Stack, output: Output, progress: &dyn Progress) -> Result<()> {
    check_tree_name(output.path())?;
    stack.remarks.iter().for_each(|(path, remark)| progress.warn(path, remark));
    let [layer] = &stack.layers[..] else {
        let found = format!("a stack of {} layers", stack.layers.len());
        return Err(Error::unsupported(output.path(), found, "build a file of each band, with --band"));
    };
    let options = BuildOptions::new(layer.kind, stack.depth - layer.coarser)
        .rule(layer.rule)
        .memory(stack.memory / 4)
        .metadata(layer.metadata.clone())
        .share(stack.share)
        .time(stack.time);
    let mut slabs = layer.slabs(folder(output.path()), stack.memory / 2, progress)?;
    let nodata = layer.nodata.and_then(|number| layer.value.splat(number));
    let form = Form::new(Dimension::Quad, layer.value);
    build_slabs(form, &mut slabs, nodata, &options, output, progress)
}
