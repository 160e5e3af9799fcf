//! Trees built by many processes.

use std::path::PathBuf;

use pyo3::prelude::*;
use spinney::CombineOptions;
use spinney::raw::ops::Prefer;
use spinney::raw::shards::{Job, JobSpec, MergeOptions, merge, plan};

use crate::build::FileOptions;
use crate::error::{OrRaise, invalid};
use crate::files::{chain_of, check_output, named, steps_of, universe_of};
use crate::jobs::{self, Terms, access};
use crate::numbers::PyNumber;
use crate::packing::Packing;

/// Plans a job in a directory; returns whether the same job was there already.
#[pyfunction]
pub(crate) fn plan_shards(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    job: PathBuf,
    options: FileOptions,
    shards: Option<u32>,
    terms: Terms,
) -> PyResult<bool> {
    let spec = match options.stack(&inputs)? {
        Some(options) => JobSpec::Stack { inputs, options },
        None => JobSpec::Rasters { inputs, options: options.raster_options()? },
    };
    jobs::run(py, terms, |work| Ok(plan(&spec, &job, shards, access(), work)?.existed))
}

/// Plans a job for a file and view operations; returns whether the same job was there already.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn plan_transform(
    py: Python<'_>,
    path: PathBuf,
    steps: Vec<String>,
    job: PathBuf,
    resampling: Option<String>,
    allow_ballpark: bool,
    moves: bool,
    packing: Packing,
    shards: Option<u32>,
    terms: Terms,
) -> PyResult<bool> {
    let chain = chain_of(&path, steps_of(&steps)?, (resampling.as_deref(), allow_ballpark), moves)?;
    let spec = JobSpec::Transform { chain, packing: packing.0 };
    jobs::run(py, terms, |work| Ok(plan(&spec, &job, shards, access(), work)?.existed))
}

/// Plans a job that combines trees; returns whether the same job was there already.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn plan_combine(
    py: Python<'_>,
    operation: &str,
    inputs: Vec<PathBuf>,
    job: PathBuf,
    prefer_second: bool,
    fill: Option<PyNumber>,
    within: Option<Vec<f64>>,
    margin: Option<u32>,
    packing: Packing,
    shards: Option<u32>,
    terms: Terms,
) -> PyResult<bool> {
    let prefer = if prefer_second { Prefer::Second } else { Prefer::First };
    let operation = named(operation, prefer)?;
    let universe = universe_of(operation, within.as_deref(), margin)?.unwrap_or_default();
    let fill = fill.map(|number| number.0);
    let options = CombineOptions { fill, universe, ..CombineOptions::default() };
    let spec = JobSpec::Combine { inputs, operation, options, packing: packing.0 };
    jobs::run(py, terms, |work| Ok(plan(&spec, &job, shards, access(), work)?.existed))
}

/// Returns the number of a job's shards, of those that have something to build, and the bytes of
/// input.
#[pyfunction]
pub(crate) fn job_counts(py: Python<'_>, job: PathBuf) -> PyResult<(u32, u32, u64)> {
    let job = py.detach(|| Job::open_with(&job, access())).or_raise()?;
    Ok((job.shards(), job.busy_shards(), job.input_bytes()))
}

/// Returns whether a directory has a job.
#[pyfunction]
pub(crate) fn is_job(py: Python<'_>, job: PathBuf) -> PyResult<bool> {
    Ok(py.detach(|| Job::find(&job, access())).or_raise()?.is_some())
}

/// Removes a job.
#[pyfunction]
pub(crate) fn remove_job(py: Python<'_>, job: PathBuf) -> PyResult<()> {
    py.detach(|| Job::open_with(&job, access())?.remove()).or_raise()
}

/// Builds a shard unless it exists already; returns whether it was built, and the bytes of its
/// segments.
#[pyfunction]
pub(crate) fn build_shard(
    py: Python<'_>,
    job: PathBuf,
    number: u32,
    memory: u64,
    terms: Terms,
) -> PyResult<(bool, u64)> {
    jobs::run(py, terms, |work| {
        let built = Job::open_with(&job, access())?.build(number, memory, work)?;
        Ok((built.existed, built.bytes))
    })
}

/// Returns the numbers of the missing shards.
#[pyfunction]
pub(crate) fn missing_shards(py: Python<'_>, job: PathBuf) -> PyResult<Vec<u32>> {
    py.detach(|| Job::open_with(&job, access())?.missing()).or_raise()
}

/// Merges the shards of a job, and on request removes the job.
#[pyfunction]
pub(crate) fn merge_shards(
    py: Python<'_>,
    job: PathBuf,
    out: PathBuf,
    removes: bool,
    memory: u64,
    terms: Terms,
) -> PyResult<()> {
    if out.extension().is_some_and(|ending| ending == "autumn") {
        return Err(invalid("out: expected a .goblin file; build() converts it to an .autumn file"));
    }
    check_output(std::slice::from_ref(&job), &out)?;
    jobs::run(py, terms, |work| {
        let options = MergeOptions { limit: work.max_bytes(), removes, memory };
        merge(&job, &out, options, access(), work).map(|_| ())
    })
}
