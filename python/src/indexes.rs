//! Indexes of TIFF files, whose cells stay in these.

use std::path::PathBuf;

use pyo3::prelude::*;
use spinney::import::raster::{plan, plan_stack};
use spinney::raw::import::raster::{self, IndexUpdate};

use crate::build::FileOptions;
use crate::files::{check_output, is_same_file};
use crate::jobs::{self, Terms, access};

/// Returns the files that paths, patterns and documents of STAC items name, and their times.
#[pyfunction]
pub(crate) fn expand_sources(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    asset: Option<&str>,
) -> PyResult<(Vec<PathBuf>, Vec<Option<String>>)> {
    let files = jobs::run_here(py, |_| raster::expand_sources(&paths, asset, access()))?;
    Ok(files.into_iter().map(|file| (file.path, file.time)).unzip())
}

/// Makes an index of files.
#[pyfunction]
pub(crate) fn build_index(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    out: PathBuf,
    options: FileOptions,
    terms: Terms,
) -> PyResult<()> {
    check_output(&paths, &out)?;
    if let Some(stack) = options.stack(&paths)? {
        return jobs::run(py, terms, |work| {
            raster::write_stack(&plan_stack(&paths, &stack)?, work.create_tree(&out)?, work)
        });
    }
    let options = options.raster_options()?;
    jobs::run(py, terms, |work| plan(&paths, &options)?.build(work.create_tree(&out)?, work))
}

/// Updates an index; returns the numbers of files that were not read, changed, added and removed.
#[pyfunction]
pub(crate) fn update_index(
    py: Python<'_>,
    index: PathBuf,
    paths: Option<Vec<PathBuf>>,
    out: PathBuf,
    prefixes: Vec<(String, String)>,
    memory: u64,
    terms: Terms,
) -> PyResult<(usize, usize, usize, usize)> {
    if !is_same_file(&out, &index) {
        let inputs = [vec![index.clone()], paths.clone().unwrap_or_default()].concat();
        check_output(&inputs, &out)?;
    }
    let mut update = IndexUpdate::default();
    (update.sources, update.prefixes, update.memory) = (paths, prefixes, memory);
    jobs::run(py, terms, |work| {
        let report = raster::update_index(&index, &update, work.create_tree(&out)?, work)?;
        Ok((report.unchanged, report.changed, report.added, report.removed))
    })
}
