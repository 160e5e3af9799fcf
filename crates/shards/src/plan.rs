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
use crate::job::{Job, MOST, Plan, PlannedInput, head_path, plan_path, shards_path};
use crate::stamp::{absolute, look};
use crate::work::{Given, JobSpec, Load, PlannedWork, Told};

/// Bytes of input per shard if no number of shards is given.
const BYTES_OF_SHARD: u64 = 1 << 30;
/// Maximum number of shards by default, and if a number is given.
const MAX_DEFAULT: u64 = 4096;
const MAX_SHARDS: u32 = 1 << 16;

/// Result of planning a job.
#[derive(Debug)]
pub struct Planned {
    /// The job.
    pub job: Job,
    /// Whether the same plan existed already, so that nothing was written.
    pub was_there: bool,
    /// Description of the tree: pairs of a heading and its text.
    pub description: Vec<(&'static str, String)>,
}

/// Plans a job in directory `folder`, which is created if it is missing: what is built from the
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
    folder: &Path,
    shards: Option<u32>,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<Planned> {
    check_folder(folder, shards)?;
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
    let files = look(files, access)?;
    let inputs = paths.into_iter().zip(files).map(|(path, files)| PlannedInput { path, files });
    let inputs: Vec<_> = inputs.collect();
    let bytes = inputs.iter().fold(0, |sum: u64, input| sum.saturating_add(input.bytes()));
    let shards = number_of(shards, bytes);
    let (head, told) = head_of((folder, access), |head| spec.write_head((&inputs, shards), head, progress))?;
    write_plan((folder, access), (shards, bytes), &head, (inputs, told))
}

/// Layers whose cells only the caller can provide.
#[derive(Clone, Copy, Debug)]
pub struct GivenLayers<'a> {
    /// Identifies the cells and the metadata: shards belong to the same job only if their tokens
    /// are equal.
    pub token: &'a str,
    /// Compression of segments.
    pub packing: Packing,
    /// Bytes of all cells.
    pub bytes: u64,
}

/// Plans a job, as [`plan`] does, for layers that `write` provides; no cells are requested.
/// [`Job::build_given`] builds the shards.
///
/// # Errors
/// Those of `write`, and of [`plan`].
pub fn plan_given(
    layers: GivenLayers<'_>,
    folder: &Path,
    shards: Option<u32>,
    access: &FileAccess,
    write: &mut dyn FnMut(TreeTarget) -> Result<()>,
) -> Result<Planned> {
    let GivenLayers { token, packing, bytes } = layers;
    check_folder(folder, shards)?;
    let (head, ()) = head_of((folder, access), |head| write(TreeTarget::Head(head)))?;
    let work = PlannedWork::Given(Given::of(token, packing));
    let told = Told { work, loads: Vec::new(), pieces: None, description: Vec::new() };
    write_plan((folder, access), (number_of(shards, bytes), bytes), &head, (Vec::new(), told))
}

/// Number of shards for this many bytes of input, if none is given.
fn number_of(shards: Option<u32>, bytes: u64) -> u32 {
    shards.unwrap_or(bytes.div_ceil(BYTES_OF_SHARD).clamp(1, MAX_DEFAULT) as u32)
}

/// Bytes of the head file, and the result of the closure that writes it.
fn head_of<T>(
    (folder, access): (&Path, &FileAccess),
    write: impl FnOnce(Output) -> Result<T>,
) -> Result<(Vec<u8>, T)> {
    let kept = Kept::default();
    let head = Output::to_writer(&head_path(folder), Box::new(kept.clone()));
    let told = write(head.with_access(access))?;
    let bytes = mem::take(&mut *kept.0.lock().unwrap_or_else(PoisonError::into_inner));
    Ok((bytes, told))
}

/// Cuts layers into shards, and writes the job to its directory.
fn write_plan(
    (folder, access): (&Path, &FileAccess),
    (shards, bytes): (u32, u64),
    head: &[u8],
    (inputs, told): (Vec<PlannedInput>, Told),
) -> Result<Planned> {
    let Told { work, mut loads, pieces, description } = told;
    let layers = work.work().layers(head.to_vec())?;
    if loads.is_empty() {
        loads = spread(bytes, &layers);
    }
    let pieces = pieces.unwrap_or_else(|| cut(&layers, &loads, shards));
    let plan = Plan::new(head, work, inputs, &pieces);
    let text = plan.to_text(folder)?;
    let was_there = is_planned(folder, &text, access)? || !write_job((folder, access), head, &text)?;
    Ok(Planned { job: Job::open_with(folder, access)?, was_there, description })
}

/// Whether a directory has this plan. Fails if it has another one.
fn is_planned(folder: &Path, text: &str, access: &FileAccess) -> Result<bool> {
    match access.read_whole(&plan_path(folder), MOST)? {
        None => Ok(false),
        Some(there) if there == text.as_bytes() => Ok(true),
        Some(_) => Err(Error::PlanMismatch {
            path: folder.to_path_buf(),
            found: "this is another job".into(),
            expected: "something else".into(),
            advice: "choose another folder, or remove this one",
        }),
    }
}

/// Writes a job. Returns `false` if another process has planned the same job meanwhile.
fn write_job((folder, access): (&Path, &FileAccess), head: &[u8], text: &str) -> Result<bool> {
    let shards = shards_path(folder);
    if url_of(folder).is_none() {
        fs::create_dir_all(&shards).map_err(Error::io(&shards, "make a folder"))?;
    }
    write_file(access.create(&head_path(folder))?, head)?;
    // The plan is written last, since it makes the directory a job, and only if there is none,
    // since another process may plan a different job at the same time.
    let mut plan = access.create(&plan_path(folder))?;
    plan.keep_existing();
    match write_file(plan, text.as_bytes()) {
        Err(error) if !is_planned(folder, text, access)? => Err(error),
        done => Ok(done.is_ok()),
    }
}

/// Distributes the bytes of input evenly over all cells of the layers.
fn spread(bytes: u64, layers: &[Header]) -> Vec<Load> {
    let cells = |header: &Header| Bounds::picture(header.extent).volume();
    let all = layers.iter().fold(0u64, |sum, header| sum.saturating_add(cells(header))).max(1);
    let share = |header: &Header| (u128::from(bytes) * u128::from(cells(header)) / u128::from(all)) as u64;
    let load = |(layer, header): (usize, &Header)| Load {
        layer,
        cells: Bounds::picture(header.extent),
        bytes: share(header),
    };
    layers.iter().enumerate().map(load).collect()
}

/// Checks that a directory contains nothing but a complete or incomplete job, and that the number
/// of shards is valid.
fn check_folder(folder: &Path, shards: Option<u32>) -> Result<()> {
    if let Some(shards) = shards.filter(|shards| *shards == 0 || *shards > MAX_SHARDS) {
        return Err(Error::invalid("shards", shards.to_string(), format!("1 to {MAX_SHARDS}")));
    }
    if folder == Path::new("-") {
        return Err(Error::unsupported(folder, "a job on standard output", "a job is a folder: name one"));
    }
    if url_of(folder).is_some() {
        // In a bucket, other objects do not interfere. Shards of another job are identified by
        // their content and rejected.
        return Ok(());
    }
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(Error::io(folder, "look into")(error)),
    };
    let known = [plan_path(folder), head_path(folder), shards_path(folder)];
    for entry in entries {
        let entry = entry.map_err(Error::io(folder, "look into"))?.path();
        let is_temporary = entry.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if !is_temporary && !known.contains(&entry) {
            let found = format!("a job in a folder that has something else ({})", entry.display());
            return Err(Error::unsupported(folder, found, "name one that is empty, or that there is not"));
        }
    }
    let is_empty = |path: &Path| fs::read_dir(path).map_or(true, |mut entries| entries.next().is_none());
    if !plan_path(folder).exists() && !is_empty(&shards_path(folder)) {
        let advice = "remove the folder, or name another one";
        return Err(Error::unsupported(folder, "shards without a plan", advice));
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
struct Kept(Arc<Mutex<Vec<u8>>>);

impl Write for Kept {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
