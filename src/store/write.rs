//! From slabs of samples, or from any source, to a tree file of either format.

use std::mem;

use super::builder::{BuildOptions, Builder, Fill, ReusableSource, Slab, Slabs, TreeSink, walk};
use super::container::{Metadata, TreeFormat};
use super::{autumnal, goblin};
use crate::io::Output;
use crate::parallel;
use crate::tree::{Form, MemTree};
use crate::value::{Tally, Value};
use crate::{Error, Progress, Result};

/// Builds a file from slabs of samples, in one pass; `nodata` is the value that means VOID (NaN always does).
///
/// Work is spread over the threads of the current rayon pool; the bytes written do not depend on their number.
/// Progress counts cells.
///
/// # Errors
/// If the input cannot be read, the output not be written, the depth does not hold the extent, or on interruption;
/// nothing is left behind then.
pub fn build_slabs(
    form: Form,
    slabs: &mut dyn Slabs,
    nodata: Option<Value>,
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<()> {
    let extent = slabs.extent();
    let total = extent.iter().product();
    let mut fill = |sink: &mut dyn TreeSink, shape| {
        let mut builder = Builder::new(form, options, shape, sink);
        let (mut current, mut next) = (Slab::default(), Slab::default());
        let mut more = slabs.next(&mut current)?;
        while more {
            // The next slab is read while this one is built.
            let (read, built) =
                parallel::join(|| slabs.next(&mut next), || builder.slab(&current, nodata, total, progress));
            built?;
            more = read?;
            mem::swap(&mut current, &mut next);
        }
        Ok(())
    };
    write_file(form, options, (extent, extent), output, &mut fill, &mut |_| {}).map(|_| ())
}

/// Builds a file from any source.
///
/// `extent` is what the header tells as the picture's size; cells outside must be VOID. Returns what is known of all
/// cells. What the source has stored in a file of the same rule is copied as it is.
///
/// # Errors
/// As [`build_slabs`].
pub(crate) fn build<S: ReusableSource>(
    source: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<Tally> {
    build_with(source, extent, options, output, progress, &mut |_| {})
}

/// Builds a file from a tree in memory: see [`build_slabs`] for what is too large for that.
///
/// # Errors
/// As [`build_slabs`].
pub fn build_tree(
    tree: &MemTree,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<Tally> {
    build(tree, extent, options, output, progress)
}

/// As [`build`]; the metadata can be completed when the source has been walked.
///
/// # Errors
/// As [`build_slabs`].
pub(crate) fn build_with<S: ReusableSource>(
    source: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<Tally> {
    let mut fill = |sink: &mut dyn TreeSink, shape| walk(source, options, shape, true, sink, progress);
    write_file(source.form(), options, (extent, [u64::MAX; 3]), output, &mut fill, complete)
}

/// Starts a file, has it filled, and finishes it. Beside the picture's extent stands that of the parts that come; what is
/// outside is VOID.
fn write_file(
    form: Form,
    options: &BuildOptions,
    (extent, covered): ([u64; 3], [u64; 3]),
    output: Output,
    fill: &mut Fill<'_>,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<Tally> {
    let header = options.header(form, extent)?;
    match TreeFormat::of(output.path()) {
        TreeFormat::Goblin if options.share => Err(Error::unsupported(
            output.path(),
            "storing equal subtrees once in a Goblin file",
            "give the output a name that ends with .autumn",
        )),
        TreeFormat::Goblin => goblin::write(options, header, covered, output, fill, complete),
        TreeFormat::Autumnal => autumnal::write(options, header, covered, output, fill, complete),
    }
}
