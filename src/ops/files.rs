//! Operations on files of any type, from files to files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::align::align;
use super::combine::{Combined, Operation};
use super::cross::cross;
use super::step::Step;
use super::view::{Sampling, View};
use super::viewed::Viewed;
use crate::query::{Tree, as_tree};
use crate::space::Frame;
use crate::store::build::{BuildOptions, build};
use crate::store::goblin::{Header, Layout, Metadata, OpenOptions, read_header};
use crate::store::{File, Output, Typed, split_commit, typed};
use crate::value::{Sample, Value};
use crate::{Error, Progress, Result};

/// A file and the steps of what is done to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chain {
    /// The file.
    pub path: PathBuf,
    /// What is done, in order.
    pub steps: Vec<Step>,
    /// Takes the value at the centre of each new cell, also where the file's rule would average.
    pub nearest: bool,
    /// Moves the picture in the world as its cells are moved, instead of leaving everything where it is.
    pub moves: bool,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Cells along each axis.
    pub extent: [u64; 3],
    /// Levels below the root.
    pub depth: u8,
    /// Cells of each input that are not VOID.
    pub before: Vec<u64>,
    /// Cells of the result that are not VOID.
    pub after: u64,
    /// Cells that the first input's would be after scaling, if none were cut off or decided at cells' centres.
    pub expected: Option<f64>,
}

/// A pair of values and the cells in which they meet: the first tree's, the second's (`None` is VOID), by channel.
pub type PairOfSamples = (Option<Vec<f64>>, Option<Vec<f64>>, u64);

/// Makes a tree of a file and the steps of what is done to it; without steps a condensed copy. `memory` is as in
/// [`BuildOptions`].
///
/// # Errors
/// If the file cannot be read, a step cannot be done, the output not be written, or on interruption.
pub fn transform(chain: &Chain, output: Output, memory: u64, progress: &dyn Progress) -> Result<Outcome> {
    let job = Job { paths: vec![chain.path.clone()], chain: Some(chain), operation: None };
    job.run(Store { output, memory, progress })
}

/// Settles files into one; those over other places or with coarser cells are aligned with the finest. `fill` is the number
/// for [`Combined::filled_with`].
///
/// # Errors
/// As [`transform`]; also if types differ or grids cannot be matched.
pub fn combine(
    operation: Operation,
    fill: Option<f64>,
    paths: &[PathBuf],
    output: Output,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let job = Job { paths: paths.to_vec(), chain: None, operation: Some((operation, fill)) };
    job.run(Store { output, memory, progress })
}

/// Counts which values of one file meet which of another: see [`cross`].
///
/// # Errors
/// As [`combine`]; also if there are too many pairs.
pub fn cross_files(first: &Path, second: &Path) -> Result<Vec<PairOfSamples>> {
    let job = Job { paths: vec![first.into(), second.into()], chain: None, operation: None };
    job.run(Cross)
}

/// A file and how to look at it.
type FileView<D, V> = View<Arc<File<D, V>>>;

/// What is wanted of the sources that a job makes.
trait Want {
    type Out;
    fn of<D: Layout, V: Value>(self, views: Vec<FileView<D, V>>, job: &Job<'_>) -> Result<Self::Out>;
}

struct Job<'a> {
    paths: Vec<PathBuf>,
    chain: Option<&'a Chain>,
    operation: Option<(Operation, Option<f64>)>,
}

fn header_of(path: &Path) -> Result<Header> {
    let (file, _) = split_commit(path);
    Ok(read_header(&file, &*OpenOptions::default().storage(&file)?)?.1)
}

impl Job<'_> {
    /// Opens the files with the types that they have.
    fn run<W: Want>(&self, want: W) -> Result<W::Out> {
        let first = self.paths.first().ok_or_else(|| Error::invalid("files", "none", "at least one"))?;
        let header = header_of(first)?;
        for path in &self.paths[1..] {
            let other = header_of(path)?;
            if (other.axes, other.value) != (header.axes, header.value) {
                let kind = |header: &Header| {
                    let tree = if header.axes == 2 { "a quadtree" } else { "an octree" };
                    format!("{tree} of {}", header.value)
                };
                let expected = format!("{}, as {} is", kind(&header), first.display());
                return Err(Error::invalid(path.display().to_string(), kind(&other), expected));
            }
        }
        typed(first, Typing { job: self, want })
    }
}

/// A job and what is wanted of it, whatever the types are.
struct Typing<'a, W> {
    job: &'a Job<'a>,
    want: W,
}

impl<W: Want> Typed for Typing<'_, W> {
    type Out = W::Out;

    fn of<D: Layout, V: Value>(self) -> Result<W::Out> {
        let Typing { job, want } = self;
        let open = |path: &PathBuf| Ok(Arc::new(File::<D, V>::open(path, &OpenOptions::default())?));
        let files: Vec<_> = job.paths.iter().map(open).collect::<Result<_>>()?;
        let views = match (job.chain, files.into_iter()) {
            (Some(chain), files) => files.map(|file| chained(chain, file)).collect::<Result<_>>()?,
            (None, files) => aligned(files.collect())?,
        };
        want.of(views, job)
    }
}

/// Frame and extent of another file.
fn place_of(path: &Path) -> Result<(Frame, [u64; 3])> {
    let tree = crate::query::open(path, &OpenOptions::default())?;
    Ok((tree.metadata().frame.clone(), tree.header().extent))
}

pub(super) fn chained<D: Layout, V: Value>(chain: &Chain, file: Arc<File<D, V>>) -> Result<FileView<D, V>> {
    let header = file.header();
    let mut view = View::new(file.clone(), header.extent)?;
    for step in &chain.steps {
        view = step.apply(view, &file.metadata().frame, place_of)?;
    }
    if chain.steps.is_empty() {
        view = view.deepened(header.shape.depth)?;
    }
    if chain.nearest { Ok(view) } else { view.sampled(Sampling::Area(header.rule)) }
}

fn aligned<D: Layout, V: Value>(files: Vec<Arc<File<D, V>>>) -> Result<Vec<FileView<D, V>>> {
    let names: Vec<String> = files.iter().map(|file| file.path().display().to_string()).collect();
    let trees: Vec<_> = files
        .iter()
        .zip(&names)
        .map(|(file, name)| (name.as_str(), &file.metadata().frame, file.header().extent))
        .collect();
    let alignments = align(&trees)?;
    // Deeper than needed if one of the files is: what it has stored fits as it is.
    let deepest = files.iter().map(|file| file.header().shape.depth).max().unwrap_or(0);
    files
        .into_iter()
        .zip(alignments)
        .map(|(file, alignment)| {
            let extent = file.header().extent;
            let view = View::new(file, extent)?.onto(&alignment.map, alignment.extent)?;
            let depth = view.depth().max(deepest);
            view.deepened(depth)
        })
        .collect()
}

struct Store<'a> {
    output: Output,
    memory: u64,
    progress: &'a dyn Progress,
}

impl Want for Store<'_> {
    type Out = Outcome;

    fn of<D: Layout, V: Value>(self, views: Vec<FileView<D, V>>, job: &Job<'_>) -> Result<Outcome> {
        let first = &views[0];
        let header = first.source().header().clone();
        let (extent, to_source) = (first.extent(), first.to_source());
        let depth = views.iter().map(View::depth).max().unwrap_or(0);
        let moves = job.chain.is_some_and(|chain| chain.moves);
        let told = first.source().metadata();
        let mut metadata = Metadata { frame: first.frame(&told.frame, moves), ..told.clone() };
        metadata.provenance.push(job.story());
        let before: Result<Vec<u64>> =
            views.iter().map(|view| Ok(as_tree(&**view.source()).statistics(None)?.cells)).collect();
        let before = before?;
        let volume = to_source.0.matrix3.determinant().abs();
        let whole = job.chain.is_some() && !first.is_cut();
        let expected = whole.then(|| before[0] as f64 / volume);
        let (operation, fill) = job.operation.unwrap_or((Operation::Over, None));
        let mut source = Combined::new(views, operation, extent)?;
        if let Some(fill) = fill {
            let value = V::splat_f64(fill);
            source = source.filled_with(value.ok_or_else(|| {
                let expected = format!("a number that {} can hold", V::TYPE);
                Error::invalid("fill value", fill.to_string(), expected)
            })?);
        }
        let options = BuildOptions { depth, metadata, ..BuildOptions::like(&header, self.memory) };
        let tally = build(&source, extent, &options, self.output, self.progress)?;
        Ok(Outcome { extent, depth, before, after: tally.cells, expected })
    }
}

impl Job<'_> {
    /// A line for the result's provenance.
    fn story(&self) -> String {
        let names: Vec<String> = self.paths.iter().map(|path| path.display().to_string()).collect();
        match (self.chain, self.operation) {
            (Some(chain), _) => {
                let steps: Vec<String> = chain.steps.iter().map(|step| format!("{step:?}")).collect();
                format!("view of {}: {}", names.join(" "), steps.join(", "))
            }
            (None, Some((operation, _))) => format!("{operation:?} of {}", names.join(" ")),
            (None, None) => names.join(" "),
        }
    }
}

/// A file seen through a chain of steps, for any question: nothing is made beforehand.
///
/// # Errors
/// If the file cannot be read, or a step cannot be done.
pub fn open_view(chain: &Chain) -> Result<Box<dyn Tree>> {
    let job = Job { paths: vec![chain.path.clone()], chain: Some(chain), operation: None };
    job.run(Look)
}

struct Look;

impl Want for Look {
    type Out = Box<dyn Tree>;

    fn of<D: Layout, V: Value>(self, mut views: Vec<FileView<D, V>>, job: &Job<'_>) -> Result<Self::Out> {
        let view = views.swap_remove(0);
        let moves = job.chain.is_some_and(|chain| chain.moves);
        let frame = view.frame(&view.source().metadata().frame, moves);
        Ok(Box::new(Viewed::new(view, frame)))
    }
}

struct Cross;

impl Want for Cross {
    type Out = Vec<PairOfSamples>;

    fn of<D: Layout, V: Value>(self, views: Vec<FileView<D, V>>, _: &Job<'_>) -> Result<Self::Out> {
        let samples = |value: Option<V>| {
            value.map(|value| value.samples().iter().map(|sample| sample.to_f64()).collect::<Vec<f64>>())
        };
        let pairs = cross(&views[0], &views[1])?;
        Ok(pairs.into_iter().map(|pair| (samples(pair.first), samples(pair.second), pair.cells)).collect())
    }
}

impl Chain {
    /// A file with nothing done to it yet.
    pub fn of(path: &Path) -> Chain {
        Chain { path: path.into(), ..Chain::default() }
    }
}
