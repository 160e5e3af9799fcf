//! Writer of tree files of either format, layer by layer.

use std::collections::HashSet;
use std::mem;
use std::path::Path;

use super::autumnal::NewFile;
use super::builder::{
    BuildOptions, Builder, EncodedSubtree, Fill, ReusableSource, Slab, Slabs, TreeSink, walk,
};
use super::goblin::{FileWriter, Goblin, Shard, ShardWriter};
use super::tree_target::ShardCheck;
use crate::tree::MemTree;
use spinney_base::TreeType;
use spinney_base::io::Output;
use spinney_base::parallel;
use spinney_base::space::{Bounds, Code, CodeRange, Dimension};
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Error, Progress, Result};
use spinney_container::{
    Codec, Content, FileHeader, LevelCounts, Metadata, Shape, TreeFormat, check_tree_name,
};

/// A tree file that is being written: one or more layers, consecutively. The name of the output
/// determines the format.
///
/// Layers are trees of one space; a layer of larger cells has fewer levels than the file. An
/// unfinished file is removed.
///
/// ```
/// use spinney::{BuildOptions, DataKind, Dimension, Metadata, Output, SampleType, TreeType, ValueType};
/// use spinney::raw::store::TreeWriter;
/// use spinney::tree::{Slab, Slabs};
///
/// /// A raster of 4 x 4 pixels of one grey.
/// struct Grey(u8);
///
/// impl Slabs for Grey {
///     fn extent(&self) -> [u64; 3] {
///         [4, 4, 1]
///     }
///     fn next(&mut self, slab: &mut Slab) -> spinney::Result<bool> {
///         let first = slab.bytes.is_empty();
///         *slab = Slab { origin: [0; 3], size: [4, 4, 1], bytes: vec![self.0; 16], valid: None };
///         Ok(first)
///     }
/// }
///
/// # fn main() -> spinney::Result<()> {
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("bands.goblin");
/// let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
/// let mut file = TreeWriter::create(Output::create(&path)?, (Dimension::Quad, 2), 2)?;
/// for (name, grey) in [("dark", 10), ("light", 200)] {
///     let metadata = Metadata { name: name.into(), ..Metadata::default() };
///     let options = BuildOptions::new(DataKind::Continuous, 2).metadata(metadata);
///     file.slabs(form, &mut Grey(grey), None, &options, &())?;
/// }
/// file.finish()?;
/// let light = spinney::open(&path.with_file_name("bands.goblin:light"))?;
/// assert_eq!(light.layers()?.len(), 2);
/// assert_eq!(light.statistics(None, &())?.channels[0].min, 200.0);
/// # Ok(())
/// # }
/// ```
pub struct TreeWriter {
    file: File,
    dimension: Dimension,
    depth: u8,
    layers: u32,
    /// Names of the layers written so far.
    names: HashSet<String>,
    /// A check before the file is finished.
    check: Option<ShardCheck>,
}

enum File {
    Goblin(Box<FileWriter>),
    Autumnal(Box<NewFile>),
    /// A Goblin file with headers and metadata of layers, but without their cells.
    Head(Box<FileWriter>),
    /// A shard of a Goblin file.
    Shard(Box<ShardWriter>),
}

impl TreeWriter {
    /// Starts a file of `layers` layers, whose space has the given dimension and depth.
    ///
    /// # Errors
    /// If the output cannot be written, or its name is that of another file type.
    pub fn create(output: Output, (dimension, depth): (Dimension, u8), layers: u32) -> Result<TreeWriter> {
        check_tree_name(output.path())?;
        let file = match TreeFormat::of(output.path()) {
            TreeFormat::Goblin => {
                let (format, content) = (TreeFormat::Goblin, Content::Cells);
                File::Goblin(Box::new(FileWriter::new(
                    output,
                    FileHeader { format, content, dimension, depth, layers },
                )?))
            }
            TreeFormat::Autumnal => File::Autumnal(Box::new(NewFile::new(output, depth))),
        };
        Ok(TreeWriter { file, dimension, depth, layers, names: HashSet::new(), check: None })
    }

    /// Starts a file that has headers and metadata of `layers` layers, but none of their cells;
    /// [`TreeWriter::run`] requests no cells from importers. Shards of these layers are built from
    /// this file: see [`TreeWriter::shard`].
    ///
    /// # Errors
    /// Those of [`TreeWriter::create`]; also if the name is that of an Autumnal file.
    pub fn head(output: Output, (dimension, depth): (Dimension, u8), layers: u32) -> Result<TreeWriter> {
        if TreeFormat::of(output.path()) == TreeFormat::Autumnal {
            let advice = "give it a name that ends with .goblin";
            return Err(Error::unsupported(output.path(), "a sharded build of an Autumnal file", advice));
        }
        let mut head = TreeWriter::create(output, (dimension, depth), layers)?;
        head.file = match head.file {
            File::Goblin(file) => File::Head(file),
            other => other,
        };
        Ok(head)
    }

    /// Starts a shard of the file that a [head](TreeWriter::head) describes. The caller writes the
    /// same layers as for the head, but only the cells in the shard's runs are requested;
    /// [`merge_shards`](super::goblin::merge_shards) merges the shards.
    ///
    /// ```
    /// use spinney::{BuildOptions, DataKind, Dimension, Output, Rule, SampleType, TreeType, ValueType};
    /// use spinney::raw::space::CodeRange;
    /// use spinney::raw::store::goblin::{Shard, ShardRange, merge_shards};
    /// use spinney::raw::store::TreeWriter;
    /// use spinney::tree::MemTree;
    ///
    /// # fn main() -> spinney::Result<()> {
    /// # let directory = tempfile::tempdir().unwrap();
    /// # let directory = directory.path();
    /// let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
    /// let tree = MemTree::from_cells(form, 1, Rule::Mean, &|cell| Some([cell[0] as u8].into()));
    /// let write = |mut file: TreeWriter| {
    ///     file.tree(&tree, [2, 2, 1], &BuildOptions::new(DataKind::Continuous, 1), &())?;
    ///     file.finish()
    /// };
    /// write(TreeWriter::create(Output::create(&directory.join("whole.goblin"))?, (Dimension::Quad, 1), 1)?)?;
    ///
    /// let head = directory.join("head.goblin");
    /// write(TreeWriter::head(Output::create(&head)?, (Dimension::Quad, 1), 1)?)?;
    /// // A tree as small as this can only be cut at its root.
    /// let ranges = vec![ShardRange { layer: 0, run: CodeRange::ALL }];
    /// let shard = Shard { directory: directory.into(), job: 1, number: 0, ranges, access: Default::default() };
    /// write(TreeWriter::shard(&head, shard.clone())?)?;
    /// let merged = directory.join("merged.goblin");
    /// merge_shards(&head, &[shard], Output::create(&merged)?.into(), 1 << 20, &())?;
    /// assert_eq!(std::fs::read(merged).unwrap(), std::fs::read(directory.join("whole.goblin")).unwrap());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If the head cannot be read, or the shard's files cannot be written.
    pub fn shard(head: &Path, shard: Shard) -> Result<TreeWriter> {
        let planned = Goblin::open(head, &(&shard.access).into())?;
        let (dimension, layers) = (planned.header().form.dimension, planned.layers().len() as u32);
        let depth = planned.layers().iter().map(|layer| layer.header.depth()).max().unwrap_or(0);
        let file = File::Shard(Box::new(ShardWriter::new(&planned, shard)?));
        Ok(TreeWriter { file, dimension, depth, layers, names: HashSet::new(), check: None })
    }

    /// Adds a check, without which [`TreeWriter::finish`] fails and leaves no valid output.
    pub(super) fn checked(self, check: ShardCheck) -> TreeWriter {
        TreeWriter { check: Some(check), ..self }
    }

    /// Returns the run of nodes whose cells the next layer requests: all of the space, unless this
    /// is a shard; `None` if only header and metadata are written. A slab may have other cells,
    /// too, which are ignored.
    pub fn run(&self) -> Option<CodeRange> {
        match &self.file {
            File::Goblin(_) | File::Autumnal(_) => Some(CodeRange::ALL),
            File::Head(_) => None,
            File::Shard(shard) => shard.run(),
        }
    }

    /// Returns whether cells must be delivered in the order of FD codes: see
    /// [`Slabs::are_in_order`].
    pub fn needs_order(&self) -> bool {
        matches!(self.file, File::Shard(_))
    }

    /// Writes header and metadata of the next layer, none of whose cells are requested: see
    /// [`TreeWriter::run`].
    ///
    /// # Errors
    /// Those of [`TreeWriter::slabs`]; also if cells of the layer are requested.
    pub fn write_layer_header(
        &mut self,
        form: TreeType,
        extent: [u64; 3],
        options: &BuildOptions,
    ) -> Result<()> {
        if self.run().is_some() {
            return Err(Error::invalid("layer", "no cells", "all cells that are requested"));
        }
        self.layer(form, options, (&extent, extent, true), &mut |_, _| Ok(()), &mut |_| {}).map(|_| ())
    }

    /// Checks that a layer may be the next one.
    fn check(&mut self, form: TreeType, depth: u8, name: &str) -> Result<()> {
        let wrong = |found: String, expected: String| Err(Error::invalid("layer", found, expected));
        if form.dimension != self.dimension || depth > self.depth {
            let found = format!("a {} of depth {depth}", form.dimension.tree_name());
            return wrong(found, format!("a {} of at most depth {}", self.dimension.tree_name(), self.depth));
        }
        if self.layers > 1 && (name.is_empty() || self.names.contains(name)) {
            return wrong(format!("the name `{name}`"), "a name that no other layer has".into());
        }
        if self.names.len() >= self.layers as usize {
            return wrong(
                format!("layer {}", self.names.len() + 1),
                format!("at most {} layers", self.layers),
            );
        }
        self.names.insert(name.into());
        Ok(())
    }

    /// Writes the next layer from the parts that `fill` pushes. The tuple has the layer's extent,
    /// the extent of the pushed parts (all cells outside are VOID), and whether parts are pushed in
    /// FD order. The metadata have the layer's name.
    pub(super) fn layer(
        &mut self,
        form: TreeType,
        options: &BuildOptions,
        (extent, covered, in_order): (&[u64; 3], [u64; 3], bool),
        fill: &mut Fill<'_>,
        complete: &mut dyn FnMut(&mut Metadata),
    ) -> Result<ZoneStats> {
        let header = options.header(form, *extent)?;
        self.check(form, header.depth(), &options.metadata.name)?;
        let mut complete = |metadata: &mut Metadata| {
            complete(metadata);
            options.packing.record_in(metadata);
        };
        match &mut self.file {
            File::Goblin(file) | File::Head(file) if options.share => Err(Error::unsupported(
                file.path(),
                "storing equal subtrees once in a Goblin file",
                "give the output a name that ends with .autumn",
            )),
            File::Goblin(file) => file.layer(options, &header, (covered, in_order), fill, &mut complete),
            File::Autumnal(file) => file.layer(options, &header, covered, fill, &mut complete),
            File::Head(file) => {
                let mut nothing = |sink: &mut dyn TreeSink, shape: Shape| {
                    let root = EncodedSubtree::uniform(
                        Code::root(form.dimension),
                        shape.depth,
                        form.value,
                        None,
                        false,
                    );
                    sink.push((root, None, LevelCounts::default()))
                };
                file.layer(options, &header, ([u64::MAX; 3], true), &mut nothing, &mut complete)
            }
            File::Shard(shard) => {
                shard.layer(options, &header, (covered, in_order), fill, &mut complete)?;
                // (The statistics are known only after all shards are merged.)
                Ok(ZoneStats::void(form.value))
            }
        }
    }

    /// Writes the next layer from slabs of samples, in one pass; `nodata` is the value that means
    /// VOID (NaN always does).
    ///
    /// # Errors
    /// Those of [`build_slabs`](super::build_slabs); also if the file already has a layer of that
    /// name.
    pub fn slabs(
        &mut self,
        form: TreeType,
        slabs: &mut dyn Slabs,
        nodata: Option<Value>,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<()> {
        let extent = slabs.extent();
        let (run, in_order) = (self.run(), slabs.are_in_order());
        let all = Bounds::of_extent(extent);
        let total = run.map_or(0, |run| run.cells(form.dimension, options.depth, &all));
        let mut fill = |sink: &mut dyn TreeSink, shape| {
            let Some(run) = run else { return Ok(()) };
            let mut builder = Builder::new(form, options, (shape, run), sink)?;
            let (mut current, mut next) = (Slab::default(), Slab::default());
            let mut more = slabs.next(&mut current)?;
            while more {
                // Reads the next slab while this one is built.
                let (read, built) = parallel::join(
                    || slabs.next(&mut next),
                    || builder.slab(&current, nodata, total, progress),
                );
                built?;
                more = read?;
                mem::swap(&mut current, &mut next);
            }
            Ok(())
        };
        self.layer(form, options, (&extent, extent, in_order), &mut fill, &mut |_| {}).map(|_| ())
    }

    /// Writes the next layer from a tree in memory: see [`build_tree`](super::build_tree).
    ///
    /// # Errors
    /// Those of [`TreeWriter::slabs`].
    pub fn tree(
        &mut self,
        tree: &MemTree,
        extent: [u64; 3],
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<ZoneStats> {
        self.source(tree, extent, options, progress)
    }

    /// Writes the next layer from any source: see [`build`](super::write::build).
    pub(crate) fn source<S: ReusableSource>(
        &mut self,
        source: &S,
        extent: [u64; 3],
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<ZoneStats> {
        self.source_with(source, extent, options, progress, &mut |_| {})
    }

    /// Writes the next layer from any source. `complete` can complete the metadata after the source
    /// has been traversed; for a shard they must be complete before.
    ///
    /// # Errors
    /// Those of [`TreeWriter::slabs`]; also if the source fails.
    pub fn source_with<S: ReusableSource>(
        &mut self,
        source: &S,
        extent: [u64; 3],
        options: &BuildOptions,
        progress: &dyn Progress,
        complete: &mut dyn FnMut(&mut Metadata),
    ) -> Result<ZoneStats> {
        let run = self.run();
        let mut fill = |sink: &mut dyn TreeSink, shape| match run {
            Some(run) => walk(source, options, (shape, run), true, sink, progress),
            None => Ok(()),
        };
        let parts = (&extent, [u64::MAX; 3], true);
        self.layer(source.form(), options, parts, &mut fill, complete)
    }

    /// Copies a layer of a Goblin file unchanged, optionally with other metadata. Returns `false`,
    /// and does nothing, if this is not a Goblin file, or the layer's cells are in other files.
    ///
    /// # Errors
    /// If the layer cannot be read or does not fit, or the file cannot be written.
    pub(crate) fn copy(
        &mut self,
        from: &Goblin,
        metadata: &Metadata,
        progress: &dyn Progress,
    ) -> Result<bool> {
        if !matches!(self.file, File::Goblin(_)) || from.header().codec == Codec::Reference {
            return Ok(false);
        }
        self.check(from.header().form, from.header().depth(), &metadata.name)?;
        match &mut self.file {
            File::Goblin(file) => file.copy(from, metadata, progress).map(|()| true),
            _ => Ok(false),
        }
    }

    /// Sets the sections that describe the files that have the cells of layers with
    /// [references](BuildOptions::referenced): the list of these files, and pages about them.
    /// Without an effect in other files.
    pub fn set_references(&mut self, sources: Vec<u8>, pages: Vec<u8>) {
        if let File::Goblin(file) | File::Head(file) = &mut self.file {
            file.set_references(sources, pages);
        }
    }

    /// Writes the end of the file after the layers, and moves the file to its final path. A shard
    /// without cells of any layer may be finished without writing layers.
    ///
    /// # Errors
    /// If the file cannot be written, or layers are missing.
    pub fn finish(self) -> Result<()> {
        let is_nothing =
            self.names.is_empty() && matches!(&self.file, File::Shard(shard) if shard.is_empty());
        if self.names.len() != self.layers as usize && !is_nothing {
            let found = format!("{} layers", self.names.len());
            return Err(Error::invalid("file", found, format!("{} layers, as announced", self.layers)));
        }
        self.check.map_or(Ok(()), |check| check())?;
        match self.file {
            File::Goblin(file) | File::Head(file) => file.finish(),
            File::Autumnal(file) => file.finish(),
            File::Shard(shard) => shard.finish(),
        }
    }
}
