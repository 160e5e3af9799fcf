//! Planning of jobs.

use std::fs;
use std::io::{self, Write};
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::io::{FileAccess, Output, url_of};
use spinney_base::space::Bounds;
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::{Packing, TreeTarget};

use crate::balance::cut;
use crate::job::{Job, MAX_PLAN_BYTES, Plan, PlannedInput, head_path, plan_path, shards_path};
use crate::stamp::{absolute, stat_inputs};
use crate::work::{ArrayWork, JobSpec, Load, PlannedWork, WorkPlan};

/// Bytes of input per shard if no number of shards is given.
const BYTES_OF_SHARD: u64 = 1 << 30;
/// Maximum number of shards by default, and if a number is given.
const MAX_DEFAULT: u64 = 4096;
const MAX_SHARDS: u32 = 1 << 16;

/// Result of planning a job.
#[derive(Debug)]
pub struct PlanOutcome {
    /// The job.
    pub job: Job,
    /// Whether the same plan existed already, so that nothing was written.
    pub existed: bool,
    /// Description of the tree: pairs of a heading and its text.
    pub description: Vec<(&'static str, String)>,
}

/// Plans a job in directory `directory`, which is created if it is missing: what is built from the
/// inputs, and by which shards. The default is about one shard per gibibyte of input. No cells are
/// read. The same plan may be repeated, also after an aborted call.
///
/// # Errors
/// If the inputs cannot be read or are incompatible, if the work is not supported in shards, if the
/// directory has another plan or other files, or if it cannot be written.
///
/// The files of the job and its inputs are opened with `access`, which overrides the options of the
/// specification.
pub fn plan(
    spec: &JobSpec,
    directory: &Path,
    shards: Option<u32>,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<PlanOutcome> {
    check_directory(directory, shards)?;
    // Files are stat'ed before their headers are read, so that the recorded version is not newer
    // than the headers.
    let work = PlannedWork::of(spec)?;
    let name = |input: &PathBuf| {
        let path = absolute(input)?;
        let files = work.work().files_of(&path, access)?;
        progress.check()?;
        Ok((path, files))
    };
    let (paths, files): (Vec<_>, Vec<_>) =
        spec.inputs().iter().map(name).collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let files = stat_inputs(files, access)?;
    let inputs = paths.into_iter().zip(files).map(|(path, files)| PlannedInput { path, files });
    let inputs: Vec<_> = inputs.collect();
    let bytes = inputs.iter().fold(0, |sum: u64, input| sum.saturating_add(input.bytes()));
    let shards = number_of(shards, bytes);
    let (head, work_plan) =
        head_of((directory, access), |head| spec.write_head((&inputs, shards), head, progress))?;
    write_plan((directory, access), (shards, bytes), &head, (inputs, work_plan))
}

/// Layers whose cells only the caller can provide.
#[derive(Clone, Copy, Debug)]
pub struct ArrayLayers<'a> {
    /// Identifies the cells and the metadata: shards belong to the same job only if their tokens
    /// are equal.
    pub token: &'a str,
    /// Compression of segments.
    pub packing: Packing,
    /// Bytes of all cells.
    pub bytes: u64,
}

/// Plans a job, as [`plan`] does, for layers that `write` provides; no cells are requested.
/// [`Job::build_arrays`] builds the shards.
///
/// # Errors
/// Those of `write`, and of [`plan`].
pub fn plan_arrays(
    layers: ArrayLayers<'_>,
    directory: &Path,
    shards: Option<u32>,
    access: &FileAccess,
    write: &mut dyn FnMut(TreeTarget) -> Result<()>,
) -> Result<PlanOutcome> {
    let ArrayLayers { token, packing, bytes } = layers;
    check_directory(directory, shards)?;
    let (head, ()) = head_of((directory, access), |head| write(TreeTarget::Head(head)))?;
    let work = PlannedWork::Arrays(ArrayWork::of(token, packing));
    let work_plan = WorkPlan { work, loads: Vec::new(), ranges: None, description: Vec::new() };
    write_plan((directory, access), (number_of(shards, bytes), bytes), &head, (Vec::new(), work_plan))
}

/// Number of shards for this many bytes of input, if none is given.
fn number_of(shards: Option<u32>, bytes: u64) -> u32 {
    shards.unwrap_or(bytes.div_ceil(BYTES_OF_SHARD).clamp(1, MAX_DEFAULT) as u32)
}

/// Bytes of the head file, and the result of the closure that writes it.
fn head_of<T>(
    (directory, access): (&Path, &FileAccess),
    write: impl FnOnce(Output) -> Result<T>,
) -> Result<(Vec<u8>, T)> {
    let buffer = MemoryOutput::default();
    let head = Output::to_writer(&head_path(directory), Box::new(buffer.clone()));
    let work_plan = write(head.with_access(access))?;
    let bytes = mem::take(&mut *buffer.0.lock().unwrap_or_else(PoisonError::into_inner));
    Ok((bytes, work_plan))
}

/// Cuts layers into shards, and writes the job to its directory.
fn write_plan(
    (directory, access): (&Path, &FileAccess),
    (shards, bytes): (u32, u64),
    head: &[u8],
    (inputs, work_plan): (Vec<PlannedInput>, WorkPlan),
) -> Result<PlanOutcome> {
    let WorkPlan { work, mut loads, ranges, description } = work_plan;
    let layers = work.work().layers(head.to_vec())?;
    if loads.is_empty() {
        loads = spread(bytes, &layers);
    }
    let ranges = ranges.unwrap_or_else(|| cut(&layers, &loads, shards));
    let plan = Plan::new(head, work, inputs, &ranges);
    let text = plan.to_text(directory)?;
    let existed = is_planned(directory, &text, access)? || !write_job((directory, access), head, &text)?;
    Ok(PlanOutcome { job: Job::open_with(directory, access)?, existed, description })
}

/// Whether a directory has this plan. Fails if it has another one.
fn is_planned(directory: &Path, text: &str, access: &FileAccess) -> Result<bool> {
    match access.read_whole(&plan_path(directory), MAX_PLAN_BYTES)? {
        None => Ok(false),
        Some(stored) if stored == text.as_bytes() => Ok(true),
        Some(_) => Err(Error::PlanMismatch {
            path: directory.to_path_buf(),
            found: "this job is requested".into(),
            expected: "another job".into(),
            advice: "choose another directory, or remove this one",
        }),
    }
}

/// Writes a job. Returns `false` if another process has planned the same job meanwhile.
fn write_job((directory, access): (&Path, &FileAccess), head: &[u8], text: &str) -> Result<bool> {
    let shards = shards_path(directory);
    if url_of(directory).is_none() {
        fs::create_dir_all(&shards).map_err(Error::io(&shards, "create the directory"))?;
    }
    write_file(access.create(&head_path(directory))?, head)?;
    // The plan is written last, since it makes the directory a job, and only if there is none,
    // since another process may plan a different job at the same time.
    let mut plan = access.create(&plan_path(directory))?;
    plan.keep_existing();
    match write_file(plan, text.as_bytes()) {
        Err(error) if !is_planned(directory, text, access)? => Err(error),
        done => Ok(done.is_ok()),
    }
}

/// Distributes the bytes of input evenly over all cells of the layers.
fn spread(bytes: u64, layers: &[Header]) -> Vec<Load> {
    let cells = |header: &Header| Bounds::of_extent(header.extent).volume();
    let all = layers.iter().fold(0u64, |sum, header| sum.saturating_add(cells(header))).max(1);
    let share = |header: &Header| (u128::from(bytes) * u128::from(cells(header)) / u128::from(all)) as u64;
    let load = |(layer, header): (usize, &Header)| Load {
        layer,
        cells: Bounds::of_extent(header.extent),
        bytes: share(header),
    };
    layers.iter().enumerate().map(load).collect()
}

/// Checks that a directory contains nothing but a complete or incomplete job, and that the number
/// of shards is valid.
fn check_directory(directory: &Path, shards: Option<u32>) -> Result<()> {
    if let Some(shards) = shards.filter(|shards| *shards == 0 || *shards > MAX_SHARDS) {
        return Err(Error::invalid("shards", shards.to_string(), format!("1 to {MAX_SHARDS}")));
    }
    if directory == Path::new("-") {
        return Err(Error::unsupported(
            directory,
            "a job on standard output",
            "pass a directory for the job",
        ));
    }
    if url_of(directory).is_some() {
        // In a bucket, other objects do not interfere. Shards of another job are identified by
        // their content and rejected.
        return Ok(());
    }
    let entries = match fs::read_dir(directory) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(Error::io(directory, "list")(error)),
    };
    let known = [plan_path(directory), head_path(directory), shards_path(directory)];
    for entry in entries {
        let entry = entry.map_err(Error::io(directory, "list"))?.path();
        let is_temporary = entry.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if !is_temporary && !known.contains(&entry) {
            let found = format!("a job in a directory with other files ({})", entry.display());
            return Err(Error::unsupported(directory, found, "choose an empty or a new directory"));
        }
    }
    let is_empty = |path: &Path| fs::read_dir(path).map_or(true, |mut entries| entries.next().is_none());
    if !plan_path(directory).exists() && !is_empty(&shards_path(directory)) {
        let advice = "remove the directory, or choose another one";
        return Err(Error::unsupported(directory, "shards without a plan", advice));
    }
    Ok(())
}

fn write_file(mut output: Output, bytes: &[u8]) -> Result<()> {
    let written = output.write_all(bytes);
    written.map_err(Error::io(output.path(), "write"))?;
    output.commit()
}

/// In-memory output.
#[derive(Clone, Default)]
struct MemoryOutput(Arc<Mutex<Vec<u8>>>);

impl Write for MemoryOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
