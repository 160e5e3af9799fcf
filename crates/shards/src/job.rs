//! Job in a local directory or in a bucket: the plan, the head file and the shards.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, shown, url_of};
use spinney_base::space::CodeRange;
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::goblin::{MergeOutput, Shard, ShardRange};

use crate::stamp::{PlannedFile, check};
use crate::work::{PlannedWork, Work};

/// File that records the work, its inputs and the shards.
const PLAN: &str = "plan.json";
/// Tree file with the layers' headers and metadata, without cells.
const HEAD: &str = "head.goblin";
/// Directory of shards.
const SHARDS: &str = "shards";
/// Maximum size of a plan in bytes.
pub(crate) const MAX_PLAN_BYTES: u64 = 64 << 20;
/// Version of the plan format.
const VERSION: u32 = 1;

/// Content of `plan.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Plan {
    /// Version of this format.
    spinney_job: u32,
    /// Version of the program. Another version might write other bytes for the same input.
    program: String,
    head: PlannedHead,
    pub(crate) work: PlannedWork,
    pub(crate) inputs: Vec<PlannedInput>,
    shards: Vec<Vec<PlannedRange>>,
}

/// Input, and the files that reading it involves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedInput {
    pub(crate) path: PathBuf,
    pub(crate) files: Vec<PlannedFile>,
}

impl PlannedInput {
    /// Total bytes of its files.
    pub(crate) fn bytes(&self) -> u64 {
        self.files.iter().fold(0, |sum: u64, file| sum.saturating_add(file.bytes))
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlannedHead {
    bytes: u64,
    xxh3: String,
}

/// Range of a layer's codes, with inclusive ends in hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlannedRange {
    layer: u32,
    first: String,
    last: String,
}

fn head_of(bytes: &[u8]) -> PlannedHead {
    PlannedHead { bytes: bytes.len() as u64, xxh3: format!("{:032x}", xxhash_rust::xxh3::xxh3_128(bytes)) }
}

impl Plan {
    /// Plan from its components; `head` is the content of the head file.
    pub(crate) fn new(
        head: &[u8],
        work: PlannedWork,
        inputs: Vec<PlannedInput>,
        shards: &[Vec<ShardRange>],
    ) -> Plan {
        let range = |range: &ShardRange| {
            let [first, last] = range.run.ends().map(|end| format!("{end:016x}"));
            PlannedRange { layer: range.layer, first, last }
        };
        Plan {
            spinney_job: VERSION,
            program: env!("CARGO_PKG_VERSION").into(),
            head: head_of(head),
            work,
            inputs,
            shards: shards.iter().map(|ranges| ranges.iter().map(range).collect()).collect(),
        }
    }

    /// Content of `plan.json`, without the secrets of URLs. Processes that build shards supply
    /// these again.
    pub(crate) fn to_text(&self, directory: &Path) -> Result<String> {
        let path = directory.join(PLAN);
        let unnamed = |error: serde_json::Error| {
            Error::unsupported(&path, error.to_string(), "rename the inputs to UTF-8 names")
        };
        let mut plan = serde_json::to_value(self).map_err(unnamed)?;
        hide_secrets(&mut plan);
        let text = serde_json::to_string_pretty(&plan).map_err(unnamed)?;
        let mut known: HashMap<Cow<'_, str>, &Path> = HashMap::new();
        for PlannedInput { path: input, .. } in &self.inputs {
            if known.insert(shown(input), input).is_some_and(|other| other != input) {
                let found = "a job of URLs that differ only in their queries, which plans do not store,";
                let advice = "download the files under different names";
                return Err(Error::unsupported(input, found, advice));
            }
        }
        if text.len() as u64 >= MAX_PLAN_BYTES {
            let advice =
                "combine the inputs to fewer virtual rasters (gdalbuildvrt), and plan a job of these";
            return Err(Error::unsupported(path, format!("a plan of {} bytes", text.len()), advice));
        }
        Ok(text + "\n")
    }
}

/// Removes the secrets from all strings that are URLs.
fn hide_secrets(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::String(text) if url_of(Path::new(text)).is_some() => {
            *text = shown(Path::new(text)).into_owned();
        }
        serde_json::Value::Array(all) => all.iter_mut().for_each(hide_secrets),
        serde_json::Value::Object(all) => all.values_mut().for_each(hide_secrets),
        _ => {}
    }
}

/// Job that has been planned.
#[derive(Debug)]
pub struct Job {
    directory: PathBuf,
    pub(crate) plan: Plan,
    /// Identifier of the job in all of its shards: a hash of the plan, which includes a hash of the
    /// head file.
    id: u128,
    /// Headers of the layers.
    pub(crate) layers: Vec<Header>,
    ranges: Vec<Vec<ShardRange>>,
    /// Access to its files and inputs.
    pub(crate) access: FileAccess,
}

impl Job {
    /// Opens the job in a directory.
    ///
    /// # Errors
    /// If there is none, if it is corrupt, or if another version of the program planned it.
    pub fn open(directory: &Path) -> Result<Job> {
        Job::open_with(directory, &FileAccess::default())
    }

    /// Opens the job in a directory. Its files and its inputs are opened with `access`.
    ///
    /// # Errors
    /// Those of [`Job::open`].
    pub fn open_with(directory: &Path, access: &FileAccess) -> Result<Job> {
        Job::find(directory, access)?.ok_or_else(|| {
            let advice = "create the job first: `spinney shard plan`";
            Error::unsupported(directory, "a directory without a job", advice)
        })
    }

    /// Opens the job in a directory, if there is one.
    ///
    /// # Errors
    /// If the path is that of a file, if the job is corrupt, or if another version of the program
    /// planned it.
    pub fn find(directory: &Path, access: &FileAccess) -> Result<Option<Job>> {
        if directory.is_file() {
            let expected = "the directory of a job, which `spinney shard plan` creates";
            return Err(Error::invalid(directory.display().to_string(), "a file", expected));
        }
        let path = directory.join(PLAN);
        let Some(text) = access.read_whole(&path, MAX_PLAN_BYTES)? else { return Ok(None) };
        let corrupt = |found: String, expected: &str| Error::corrupt(&path, "plan", found, expected);
        let plan: Plan =
            serde_json::from_slice(&text).map_err(|error| corrupt(error.to_string(), "a plan"))?;
        let own = (VERSION, env!("CARGO_PKG_VERSION"));
        if (plan.spinney_job, &*plan.program) != own {
            return Err(Error::PlanMismatch {
                path,
                found: format!("this is version {} of the program", own.1),
                expected: format!("version {}", plan.program),
                advice: "build all shards with one version, or plan another job",
            });
        }
        let (mut ranges, mut known) = (Vec::with_capacity(plan.shards.len()), Vec::new());
        for shard in &plan.shards {
            let shard: Option<Vec<ShardRange>> = shard.iter().map(PlannedRange::range).collect();
            let shard = shard.ok_or_else(|| corrupt("invalid ends of code ranges".into(), "code ranges"))?;
            known.extend_from_slice(&shard);
            ranges.push(shard);
        }
        let id = xxhash_rust::xxh3::xxh3_128(&text);
        let work = plan.work.work();
        let layers = work.layers(planned_head(directory, &plan.head, access)?)?;
        if !work.are_all(&known, &layers) || ranges.is_empty() {
            return Err(corrupt(
                "code ranges with gaps or overlaps".into(),
                "ranges that cover each layer once",
            ));
        }
        work.check(plan.inputs.len(), &layers)?;
        let (directory, access) = (directory.to_path_buf(), access.clone());
        Ok(Some(Job { directory, plan, id, layers, ranges, access }))
    }

    /// Work that the shards do.
    pub(crate) fn work(&self) -> &dyn Work {
        self.plan.work.work()
    }

    /// Directory of the job.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Path of the head file, which has no cells.
    pub(crate) fn head_path(&self) -> PathBuf {
        head_path(&self.directory)
    }

    /// Number of shards.
    pub fn shards(&self) -> u32 {
        self.ranges.len() as u32
    }

    /// Number of shards that have cells to build. All others cover no range of any layer, and are
    /// built instantly.
    pub fn busy_shards(&self) -> u32 {
        self.ranges.iter().filter(|ranges| !ranges.is_empty()).count() as u32
    }

    /// Total bytes of all input files.
    pub fn input_bytes(&self) -> u64 {
        self.plan.inputs.iter().fold(0, |sum: u64, input| sum.saturating_add(input.bytes()))
    }

    /// Returns a shard by its number, from 0.
    ///
    /// # Errors
    /// If there is no such shard.
    pub(crate) fn shard(&self, number: u32) -> Result<Shard> {
        let Some(ranges) = self.ranges.get(number as usize) else {
            let expected = format!("0 to {}", self.shards() - 1);
            return Err(Error::invalid("shard", number.to_string(), expected));
        };
        Ok(Shard {
            directory: self.directory.join(SHARDS),
            job: self.id,
            number,
            ranges: ranges.clone(),
            access: self.access.clone(),
        })
    }

    /// Numbers of the shards that are not built, or lack a file.
    ///
    /// # Errors
    /// If one is corrupt, or belongs to another job.
    pub fn missing(&self) -> Result<Vec<u32>> {
        self.work().missing(&self.all_shards()?, None)
    }

    fn all_shards(&self) -> Result<Vec<Shard>> {
        (0..self.shards()).map(|number| self.shard(number)).collect()
    }

    /// Removes the job: all files that it may have, the plan last, so that an aborted call can be
    /// repeated. A local directory is removed too, unless it has other files.
    ///
    /// # Errors
    /// If something cannot be removed, or on cancellation.
    pub fn remove(self) -> Result<()> {
        remove_files(&self.directory, &self.all_shards()?, &self.access)
    }

    /// Removes the remains of job `job`, which may be incomplete. Another job's plan is left
    /// unchanged. Without a plan, only empty local directories are removed.
    ///
    /// # Errors
    /// Those of [`Job::remove`].
    pub(crate) fn remove_if(directory: &Path, job: u128, access: &FileAccess) -> Result<()> {
        let path = plan_path(directory);
        let Some(text) = access.read_whole(&path, MAX_PLAN_BYTES)? else {
            // `remove_dir` fails for directories that are not empty, which stay.
            if url_of(directory).is_none() {
                for empty in [&*shards_path(directory), directory] {
                    std::fs::remove_dir(empty).unwrap_or_default();
                }
            }
            return Ok(());
        };
        if xxhash_rust::xxh3::xxh3_128(&text) != job {
            return Ok(());
        }
        let plan: Plan = serde_json::from_slice(&text)
            .map_err(|error| Error::corrupt(&path, "plan", error.to_string(), "a plan"))?;
        let ranges = |shard: &Vec<PlannedRange>| shard.iter().filter_map(PlannedRange::range).collect();
        let shard = |(number, ranges): (u32, Vec<ShardRange>)| Shard {
            directory: shards_path(directory),
            job,
            number,
            ranges,
            access: access.clone(),
        };
        let shards: Vec<Shard> = (0..).zip(plan.shards.iter().map(ranges)).map(shard).collect();
        remove_files(directory, &shards, access)
    }

    /// Merges the shards into a file. `memory` is the limit in bytes for the segment index, beyond
    /// which it goes to temporary files. Progress counts bytes.
    ///
    /// # Errors
    /// If a shard is missing or corrupt, if the output cannot be written, or on cancellation. Then
    /// there is no output, and the job keeps all data that is not yet in the output.
    ///
    /// If shards are removed, returns the path of the file that marks the output as complete; the
    /// caller removes it after the job.
    pub fn merge(
        &self,
        mut output: MergeOutput,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Option<PathBuf>> {
        let shards = self.all_shards()?;
        let missing = self.work().missing(&shards, Some(&output))?;
        if !missing.is_empty() {
            output.abandon();
            let what = format!("shards of {}", self.directory.display());
            let are = if missing.len() == 1 { "is" } else { "are" };
            let (made, list) = (self.shards() - missing.len() as u32, list_of_ranges(&missing));
            let found = format!("{made} of {}, {list} {are} missing", self.shards());
            let expected =
                format!("all of them; build shard K: `spinney shard build {} K`", self.directory.display());
            return Err(Error::invalid(what, found, expected));
        }
        let mark = output.claim(self.id)?;
        let inputs: Vec<&PlannedInput> = self.plan.inputs.iter().collect();
        let paths: Vec<PathBuf> = inputs.iter().map(|input| input.path.clone()).collect();
        if self.work().reads_inputs_to_merge() {
            check(&inputs, self.work(), &self.access)?;
        }
        self.work().merge(&self.head_path(), &shards, (&paths, output, memory), progress)?;
        Ok(mark)
    }
}

/// Removes the files of a job, the plan last, so that an aborted call can be repeated.
fn remove_files(directory: &Path, shards: &[Shard], access: &FileAccess) -> Result<()> {
    let files: Vec<PathBuf> = shards.iter().flat_map(Shard::files).collect();
    let files: Vec<&Path> = files.iter().map(|file| &**file).collect();
    access.remove(&files)?;
    let is_local = url_of(directory).is_none();
    if is_local {
        // Includes leftovers of aborted shards.
        let shards = shards_path(directory);
        match std::fs::remove_dir_all(&shards) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => {
                return Err(Error::io(shards, "remove")(cause));
            }
            _ => {}
        }
    }
    access.remove(&[&head_path(directory)])?;
    access.remove(&[&plan_path(directory)])?;
    if is_local {
        std::fs::remove_dir(directory).unwrap_or_default();
    }
    Ok(())
}

/// Reads a job's head file, and checks it against the plan.
fn planned_head(directory: &Path, planned: &PlannedHead, access: &FileAccess) -> Result<Vec<u8>> {
    let path = head_path(directory);
    let found = access.read_whole(&path, MAX_PLAN_BYTES)?.filter(|bytes| head_of(bytes) == *planned);
    found.ok_or_else(|| {
        let expected = format!("{} bytes with hash {}", planned.bytes, planned.xxh3);
        Error::corrupt(path, "the entire file", "other bytes", expected)
    })
}

pub(crate) fn head_path(directory: &Path) -> PathBuf {
    directory.join(HEAD)
}

pub(crate) fn plan_path(directory: &Path) -> PathBuf {
    directory.join(PLAN)
}

pub(crate) fn shards_path(directory: &Path) -> PathBuf {
    directory.join(SHARDS)
}

impl PlannedRange {
    /// The parsed range; `None` if the digits are not a valid range.
    fn range(&self) -> Option<ShardRange> {
        let end = |digits: &str| u64::from_str_radix(digits, 16).ok();
        Some(ShardRange { layer: self.layer, run: CodeRange::new(end(&self.first)?, end(&self.last)?)? })
    }
}

/// Formats ascending numbers as ranges: "3, 7 to 9".
fn list_of_ranges(numbers: &[u32]) -> String {
    let mut text = String::new();
    for run in numbers.chunk_by(|a, b| a + 1 == *b) {
        let comma = if text.is_empty() { "" } else { ", " };
        match run {
            [only] => write!(text, "{comma}{only}"),
            [first, .., last] => write!(text, "{comma}{first} to {last}"),
            [] => Ok(()),
        }
        .expect("writing to a string succeeds");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_shards_are_listed_as_ranges() {
        assert_eq!(list_of_ranges(&[3]), "3");
        assert_eq!(list_of_ranges(&[0, 1, 2, 5, 7, 8]), "0 to 2, 5, 7 to 8");
    }
}
