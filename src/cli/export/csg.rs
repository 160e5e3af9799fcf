//! The CSG text that a solid was built from.

use std::io::Write as _;
use std::time::Instant;

use anyhow::{Result, bail};
use spinney::Metadata;
use spinney::raw::store::Tag;

use super::super::Global;
use super::super::args::check_output;
use super::super::report::report_output;
use super::Args;

/// Writes the text.
pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if args.tree.is_viewed() {
        bail!("--view: has no effect on .csg, the text that the whole solid was built from");
    }
    let (file, path) = (&args.tree.file, args.output.path());
    check_output([file.as_path()], path)?;
    let write = |metadata: &Metadata| -> Result<()> {
        let Some(text) = metadata.tag(Tag::Csg) else {
            bail!("{}: has no CSG text; only solids built from .csg files have one", file.display());
        };
        let mut output = global.access().create(path)?;
        output.write_all(text.as_bytes()).map_err(spinney::Error::io(path, "write"))?;
        output.commit()?;
        // (Operations and edits keep tags unchanged, and add to the provenance.)
        if let [_, later @ ..] = &metadata.provenance[..]
            && !later.is_empty()
        {
            let later = later.join("; ");
            global.report(
                "warning",
                format_args!("the CSG text is that of the solid as built, before: {later}"),
            );
        }
        Ok(())
    };
    match args.tree.open_model(global)? {
        Some(view) => write(view.as_model("the CSG text")?.metadata())?,
        None => write(args.tree.open(global)?.metadata())?,
    }
    report_output(global, path, start);
    Ok(())
}
