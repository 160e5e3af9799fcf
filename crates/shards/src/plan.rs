//! Planning of jobs.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::io::{InputFile, Output, url_of};
use spinney_base::space::Bounds;
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::goblin::Goblin;

use crate::balance::cut;
use crate::job::{Job, MOST, Plan, PlannedInput, head_path, plan_path, shards_path};
use crate::stamp::{absolute, look};
use crate::work::{JobSpec, Load, PlannedWork, Told};

/// Bytes of input for which there is a shard, where nobody says how many there are to be.
const BYTES_OF_SHARD: u64 = 1 << 30;
/// Shards, if nobody says how many, and if somebody does.
const MOST_UNASKED: u64 = 4096;
const MOST_SHARDS: u32 = 1 << 16;

/// A job that was planned.
#[derive(Debug)]
pub struct Planned {
    /// The job.
    pub job: Job,
    /// Whether the same plan was there already, and nothing was done.
    pub was_there: bool,
    /// Description of the tree: pairs of a heading and its text.
    pub description: Vec<(&'static str, String)>,
}

/// Plans a job in a folder, which is made if there is none: what is built of the inputs, and by which shards, of which there are about one for
/// each gibibyte of input unless a number is given. No cell is read. The same plan may be made again, also if it was cut off.
///
/// # Errors
/// If the inputs cannot be read or do not fit together, if they are to be built in a way that shards do not have, if the folder has
/// another plan or something else, or if it cannot be written.
pub fn plan(spec: &JobSpec, folder: &Path, shards: Option<u32>, progress: &dyn Progress) -> Result<Planned> {
    if shards.is_some_and(|shards| shards == 0 || shards > MOST_SHARDS) {
        let found = shards.unwrap_or_default().to_string();
        return Err(Error::invalid("shards", found, format!("1 to {MOST_SHARDS}")));
    }
    // (What was looked at before the headers are read cannot be of a later state than these.)
    let work = PlannedWork::of(spec)?;
    let name = |input: &PathBuf| {
        let path = absolute(input)?;
        let files = work.work().files_of(&path)?;
        progress.check()?;
        Ok((path, files))
    };
    let (paths, files): (Vec<_>, Vec<_>) =
        spec.inputs().iter().map(name).collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let files = look(files)?;
    let planned = paths.into_iter().zip(files).map(|(path, files)| PlannedInput { path, files });
    let planned: Vec<_> = planned.collect();
    check_folder(folder)?;
    let kept = Kept::default();
    let head = Output::to_writer(&head_path(folder), Box::new(kept.clone()));
    let Told { work, mut loads, description } = spec.write_head(&planned, head, progress)?;
    let head = kept.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let layers = Goblin::from_bytes(head.clone())?;
    let layers: Vec<_> = layers.layers().iter().map(|layer| layer.header.clone()).collect();
    let bytes = planned.iter().fold(0, |sum: u64, input| sum.saturating_add(input.bytes()));
    let shards = shards.unwrap_or(bytes.div_ceil(BYTES_OF_SHARD).clamp(1, MOST_UNASKED) as u32);
    if loads.is_empty() {
        loads = spread(bytes, &layers);
    }
    let pieces = cut(&layers, &loads, shards);
    let plan = Plan::new(&head, work, planned, &pieces);
    let text = plan.to_text(folder)?;
    let was_there = is_planned(folder, &text)? || !write_job(folder, &head, &text)?;
    Ok(Planned { job: Job::open(folder)?, was_there, description })
}

/// Whether a folder has this plan, and no other one.
fn is_planned(folder: &Path, text: &str) -> Result<bool> {
    match InputFile::read_whole(&plan_path(folder), MOST)? {
        None => Ok(false),
        Some(there) if there == text.as_bytes() => Ok(true),
        Some(_) => Err(Error::NotPlanned {
            path: folder.to_path_buf(),
            found: "this is another job".into(),
            expected: "something else".into(),
            advice: "choose another folder, or remove this one",
        }),
    }
}

/// Writes a job. Returns `false` if somebody else has planned the same meanwhile.
fn write_job(folder: &Path, head: &[u8], text: &str) -> Result<bool> {
    let shards = shards_path(folder);
    if url_of(folder).is_none() {
        fs::create_dir_all(&shards).map_err(Error::io(&shards, "make a folder"))?;
    }
    write_file(&head_path(folder), head, false)?;
    // Last, since a job is what has a plan; and only if there is none, since somebody else may plan another one at the same time.
    match write_file(&plan_path(folder), text.as_bytes(), true) {
        Err(error) if !is_planned(folder, text)? => Err(error),
        done => Ok(done.is_ok()),
    }
}

/// Bytes of input spread over all cells of some layers.
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

/// Makes sure that a folder has nothing but a job, whole or not, if there is one.
fn check_folder(folder: &Path) -> Result<()> {
    if folder == Path::new("-") {
        return Err(Error::unsupported(folder, "a job on standard output", "a job is a folder: name one"));
    }
    if url_of(folder).is_some() {
        // (In a bucket names do not come in each other's way; shards of another job are known by what is in them, and refused.)
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

fn write_file(path: &Path, bytes: &[u8], must_be_new: bool) -> Result<()> {
    let mut output = Output::create(path)?;
    if must_be_new {
        output.keep_existing();
    }
    output.write_all(bytes).map_err(Error::io(path, "write"))?;
    output.commit()
}

/// Bytes that are written to memory.
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
