//! Planning of jobs.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::io::Output;
use spinney_base::space::{Bounds, Dimension, Region};
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::TreeWriter;
use spinney_engine::store::goblin::Goblin;
use spinney_raster::import::{MosaicPlan, Stack, plan as plan_pictures, plan_stack, write_layers};

use crate::balance::{Load, cut};
use crate::job::{Job, Plan, PlannedInput, head_path, plan_path, raster_options, shards_path};
use crate::options::{PlannedOptions, ShardedImport};
use crate::stamp::{absolute, look};

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
pub fn plan(
    inputs: &[PathBuf],
    import: &ShardedImport,
    folder: &Path,
    shards: Option<u32>,
    progress: &dyn Progress,
) -> Result<Planned> {
    if shards.is_some_and(|shards| shards == 0 || shards > MOST_SHARDS) {
        let found = shards.unwrap_or_default().to_string();
        return Err(Error::invalid("shards", found, format!("1 to {MOST_SHARDS}")));
    }
    // (What was looked at before the headers are read cannot be of a later state than these.)
    let look = |input: &PathBuf| {
        let place = absolute(input)?;
        let files = look(&place, &raster_options(import))?;
        Ok(PlannedInput::new(place, files))
    };
    let planned = inputs.iter().map(look).collect::<Result<Vec<_>>>()?;
    check_folder(folder)?;
    let kept = Kept::default();
    let head = Output::to_writer(&head_path(folder), Box::new(kept.clone()));
    let Told { loads, mosaic, description } = write_head((inputs, &planned), import, head, progress)?;
    let head = kept.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let layers = Goblin::from_bytes(head.clone())?;
    let layers: Vec<_> = layers.layers().iter().map(|layer| layer.header.clone()).collect();
    let bytes = planned.iter().fold(0, |sum: u64, input| sum.saturating_add(input.bytes()));
    let shards = shards.unwrap_or(bytes.div_ceil(BYTES_OF_SHARD).clamp(1, MOST_UNASKED) as u32);
    let pieces = cut(&layers, &loads, shards);
    let plan = Plan::new(&head, PlannedOptions::of(import), (planned, mosaic.as_ref()), &pieces);
    let text = plan.to_text(folder)?;
    let path = plan_path(folder);
    let was_there = path.exists();
    if was_there {
        if fs::read(&path).map_err(Error::io(&path, "read"))? != text.as_bytes() {
            return Err(Error::NotPlanned {
                path: folder.to_path_buf(),
                found: "this is another job".into(),
                expected: "something else".into(),
                advice: "choose another folder, or remove this one",
            });
        }
    } else {
        let shards = shards_path(folder);
        fs::create_dir_all(&shards).map_err(Error::io(&shards, "make a folder"))?;
        write_file(&head_path(folder), &head)?;
        // Last, since a job is what has a plan.
        write_file(&path, text.as_bytes())?;
    }
    Ok(Planned { job: Job::open(folder)?, was_there, description })
}

/// Knowledge of a job when what is told of its layers is written.
struct Told {
    /// Which input makes which cells.
    loads: Vec<Load>,
    /// Mosaic of several pictures.
    mosaic: Option<MosaicPlan>,
    description: Vec<(&'static str, String)>,
}

/// Writes what is told of the layers.
fn write_head(
    (inputs, planned): (&[PathBuf], &[PlannedInput]),
    import: &ShardedImport,
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    match import {
        ShardedImport::Pictures(options) => {
            let picture = plan_pictures(inputs, options)?;
            let (description, mosaic) = (picture.description().to_vec(), picture.mosaic().cloned());
            let whole = [Region::new(0, 0, picture.info().width, picture.info().height)];
            let regions = mosaic.as_ref().map_or(&whole[..], |mosaic| &mosaic.regions);
            let loads = regions.iter().zip(planned).map(|(region, input)| {
                let (min, max) = ([region.x, region.y, 0], [region.right(), region.bottom(), 1]);
                Load { layer: 0, cells: Bounds { min, max }, bytes: input.bytes() }
            });
            let loads = loads.collect();
            let mut file = TreeWriter::head(head, (Dimension::Quad, picture.options().depth), 1)?;
            picture.write(&mut file, Path::new(""), progress)?;
            file.finish()?;
            Ok(Told { loads, mosaic, description })
        }
        ShardedImport::Stack(options) => {
            let stack = plan_stack(inputs, options)?;
            if let Some(layer) = stack.layers.iter().find(|layer| layer.is_warped()) {
                let found = "a layer on another grid than the finest, in shards,";
                let advice = "build its file by itself with --grid first, and stack the others";
                return Err(Error::unsupported(layer.path(), found, advice));
            }
            let layers = stack.layers.len() as u32;
            let mut file = TreeWriter::head(head, (Dimension::Quad, stack.depth), layers)?;
            write_layers(&stack, &mut file, Path::new(""), progress)?;
            file.finish()?;
            let size_of = |path: &Path| {
                let input = inputs.iter().position(|input| input == path);
                input.map_or(0, |input| planned[input].bytes())
            };
            let (loads, description) = (stack_loads(&stack, size_of), stack.description().to_vec());
            Ok(Told { loads, mosaic: None, description })
        }
    }
}

/// The layers of a stack, each with its share of its file's bytes.
fn stack_loads(stack: &Stack, size_of: impl Fn(&Path) -> u64) -> Vec<Load> {
    let load = |(layer, found): (usize, &spinney_raster::import::StackLayer)| {
        let of_file = stack.layers.iter().filter(|other| other.path() == found.path()).count() as u64;
        Load { layer, cells: Bounds::picture(found.extent), bytes: size_of(found.path()) / of_file.max(1) }
    };
    stack.layers.iter().enumerate().map(load).collect()
}

/// Makes sure that a folder has nothing but a job, whole or not, if there is one.
fn check_folder(folder: &Path) -> Result<()> {
    if folder == Path::new("-") {
        return Err(Error::unsupported(folder, "a job on standard output", "a job is a folder: name one"));
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

fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut output = Output::create(path)?;
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
