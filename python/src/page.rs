//! Pages that show files in browsers and notebooks.

use std::path::PathBuf;

use pyo3::prelude::*;
use spinney::export::{PageFile, PageRequest, export_page};
use spinney::raw::dataset;
use spinney::raw::export::page::{
    PageConfiguration, PageContent, PageSource, PageStart, PageSummary, inline_page,
};
use spinney::raw::io::url_of;
use spinney::raw::store::file_is_tree;
use spinney::style::Style;

use crate::error::OrRaise;
use crate::files::check_output;
use crate::jobs::{self, Terms, access};

/// Initial layer, commit and style of a page.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Start {
    layer: Option<String>,
    commit: Option<u64>,
    style: Option<String>,
}

impl Start {
    fn page_start(self) -> PyResult<PageStart> {
        let style = self.style.map(|text| Style::given(&text)).transpose().or_raise()?;
        let style = style.map(|style| style.json().to_owned());
        Ok(PageStart { layer: self.layer, commit: self.commit, style })
    }
}

/// Writes a page for a file; returns the number of files written.
#[pyfunction]
pub(crate) fn write_page(
    py: Python<'_>,
    file: PathBuf,
    path: PathBuf,
    title: String,
    start: Start,
    self_contained: bool,
    terms: Terms,
) -> PyResult<u64> {
    check_output(std::slice::from_ref(&file), &path)?;
    if url_of(&file).is_none() && file_is_tree(&file, access()).or_raise()? {
        py.detach(|| dataset::open(&file, &access().into())?.check_movable()).or_raise()?;
    }
    let files = vec![PageFile { path: file, start: start.page_start()? }];
    let request = PageRequest { title, files, is_self_contained: self_contained };
    let made: PageSummary = jobs::run(py, terms, |work| export_page(&request, &path, work))?;
    Ok(made.files)
}

/// Returns the HTML of a page to be embedded in another one, from which it requests the file's
/// bytes.
#[pyfunction]
pub(crate) fn page_html(name: String, title: String, size: u64, start: Start) -> PyResult<String> {
    let start = start.page_start()?;
    let source = PageSource {
        name,
        title: title.clone(),
        url: "parent:".into(),
        size: Some(size),
        content: PageContent::Unknown,
        start,
    };
    let configuration = PageConfiguration { title, sources: vec![source], assets: String::new() };
    Ok(inline_page(&configuration))
}
