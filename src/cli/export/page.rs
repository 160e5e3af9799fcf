//! Pages that show a file in a browser.

use std::time::Instant;

use anyhow::{Result, bail};
use spinney::export::{PageFile, PageRequest, export_page};
use spinney::raw::export::page::PageStart;
use spinney::raw::io::url_of;
use spinney::raw::io::without_query;
use spinney::raw::store::FileReference;

use super::super::Global;
use super::super::args::check_output;
use super::super::report::{Work, report_output};
use super::Args;

/// Options of pages only.
#[derive(clap::Args)]
pub(super) struct PageOptions {
    /// Put everything into one file, including the data (at most 64 MiB), so that it opens from a
    /// disk
    #[arg(long)]
    self_contained: bool,
}

impl PageOptions {
    /// Returns the first given option.
    pub(super) fn given(&self) -> Option<&'static str> {
        self.self_contained.then_some("--self-contained")
    }
}

/// Writes the page.
pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if args.tree.is_viewed() {
        bail!(
            "--view: has no effect on pages, which show a stored file; write the view with `spinney transform` first"
        );
    }
    let (file, path) = (&args.tree.file, args.output.path());
    check_output([file.as_path()], path)?;
    // (Opening the file reports corruption here, not in the page.)
    if args.tree.open_model(global)?.is_none() {
        let tree = args.tree.open_any_layer(global)?;
        if url_of(file).is_none() {
            tree.check_movable()?;
        }
    }
    let reference = FileReference::of(file);
    let layer = args.tree.layer_text().map(str::to_owned).or(reference.layer);
    let style = args.archive.style().map(|style| style.json().to_owned());
    let files = vec![PageFile {
        path: reference.file.into_owned(),
        start: PageStart { layer, commit: reference.commit, style },
    }];
    let title = args.archive.name().map(str::to_owned);
    let title =
        title.or_else(|| Some(without_query(&files[0].path).file_stem()?.to_string_lossy().into_owned()));
    let is_self_contained = args.page.self_contained;
    let request = PageRequest { title: title.unwrap_or_default(), files, is_self_contained };
    let work = Work::start(global, "page")?;
    let made = export_page(&request, path, &work)?;
    work.finish();
    global.report("page", format_args!("{} files, {} bytes", made.files, made.bytes));
    report_output(global, path, start);
    Ok(())
}
