//! Writes a tree file of either format, layer after layer.

use std::mem;

use super::autumnal::NewFile;
use super::builder::{BuildOptions, Builder, Fill, ReusableSource, Slab, Slabs, TreeSink, walk};
use super::goblin::{FileWriter, Goblin};
use crate::tree::MemTree;
use spinney_base::Form;
use spinney_base::io::Output;
use spinney_base::parallel;
use spinney_base::space::Dimension;
use spinney_base::value::{Tally, Value};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Content, FileHeader, Metadata, TreeFormat, check_tree_name};

/// A tree file that is being written: one or more layers, one after the other, in the format that its name asks for.
///
/// Layers are trees of one space; those of larger cells have fewer levels than the file. What is not finished leaves nothing behind.
///
/// ```
/// use spinney::io::Output;
/// use spinney::space::Dimension;
/// use spinney::store::{BuildOptions, Metadata, Slab, Slabs, TreeWriter};
/// use spinney::tree::Form;
/// use spinney::value::{Kind, SampleType, ValueType};
///
/// /// One picture of 4 x 4 pixels of a grey.
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
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("bands.goblin");
/// let form = Form::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
/// let mut file = TreeWriter::create(Output::create(&path)?, (Dimension::Quad, 2), 2)?;
/// for (name, grey) in [("dark", 10), ("light", 200)] {
///     let metadata = Metadata { name: name.into(), ..Metadata::default() };
///     let options = BuildOptions::new(Kind::Continuous, 2).metadata(metadata);
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
    /// Names of the layers so far.
    names: Vec<String>,
}

enum File {
    Goblin(Box<FileWriter>),
    Autumnal(Box<NewFile>),
}

impl TreeWriter {
    /// Starts a file of so many layers, whose space has so many levels.
    ///
    /// # Errors
    /// If the output cannot be written, or its name is that of another kind of files.
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
        Ok(TreeWriter { file, dimension, depth, layers, names: Vec::new() })
    }

    /// Makes sure that a layer may come next.
    fn check(&mut self, form: Form, depth: u8, name: &str) -> Result<()> {
        let wrong = |found: String, expected: String| Err(Error::invalid("layer", found, expected));
        if form.dimension != self.dimension || depth > self.depth {
            let found = format!("a {} of depth {depth}", form.dimension.tree_name());
            return wrong(found, format!("a {} of depth {} at most", self.dimension.tree_name(), self.depth));
        }
        if self.layers > 1 && (name.is_empty() || self.names.iter().any(|other| other == name)) {
            return wrong(format!("the name `{name}`"), "one that no other layer has".into());
        }
        if self.names.len() >= self.layers as usize {
            return wrong(format!("layer {}", self.names.len() + 1), format!("{}", self.layers));
        }
        self.names.push(name.into());
        Ok(())
    }

    /// Makes the next layer of parts that `fill` hands over: beside the picture's extent stands that of the parts that
    /// come (what is outside is VOID), and whether they come in FD order. The layer's name is that of the metadata.
    pub(super) fn layer(
        &mut self,
        form: Form,
        options: &BuildOptions,
        (extent, covered, in_order): (&[u64; 3], [u64; 3], bool),
        fill: &mut Fill<'_>,
        complete: &mut dyn FnMut(&mut Metadata),
    ) -> Result<Tally> {
        let header = options.header(form, *extent)?;
        self.check(form, header.depth(), &options.metadata.name)?;
        let mut complete = |metadata: &mut Metadata| {
            complete(metadata);
            options.packing.tell(metadata);
        };
        match &mut self.file {
            File::Goblin(file) if options.share => Err(Error::unsupported(
                file.path(),
                "storing equal subtrees once in a Goblin file",
                "give the output a name that ends with .autumn",
            )),
            File::Goblin(file) => file.layer(options, &header, (covered, in_order), fill, &mut complete),
            File::Autumnal(file) => file.layer(options, &header, covered, fill, &mut complete),
        }
    }

    /// Makes the next layer of slabs of samples, in one pass; `nodata` is the value that means VOID (NaN always does).
    ///
    /// # Errors
    /// Those of [`build_slabs`](super::build_slabs); also if a layer of that name is there already.
    pub fn slabs(
        &mut self,
        form: Form,
        slabs: &mut dyn Slabs,
        nodata: Option<Value>,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<()> {
        let extent = slabs.extent();
        let (total, in_order) = (extent.iter().product(), slabs.are_in_order());
        let mut fill = |sink: &mut dyn TreeSink, shape| {
            let mut builder = Builder::new(form, options, shape, sink)?;
            let (mut current, mut next) = (Slab::default(), Slab::default());
            let mut more = slabs.next(&mut current)?;
            while more {
                // The next slab is read while this one is built.
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

    /// Makes the next layer of a tree in memory: see [`build_tree`](super::build_tree).
    ///
    /// # Errors
    /// Those of [`TreeWriter::slabs`].
    pub fn tree(
        &mut self,
        tree: &MemTree,
        extent: [u64; 3],
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Tally> {
        self.source(tree, extent, options, progress)
    }

    /// Makes the next layer of any source: see [`build`](super::write::build).
    pub(crate) fn source<S: ReusableSource>(
        &mut self,
        source: &S,
        extent: [u64; 3],
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Tally> {
        let mut fill = |sink: &mut dyn TreeSink, shape| walk(source, options, shape, true, sink, progress);
        let parts = (&extent, [u64::MAX; 3], true);
        self.layer(source.form(), options, parts, &mut fill, &mut |_| {})
    }

    /// Takes over a layer of a Goblin file as it is, with metadata that may be others; `false` if this is no Goblin file, and nothing was done.
    ///
    /// # Errors
    /// If the layer cannot be read, does not fit, or the file cannot be written.
    pub(crate) fn copy(
        &mut self,
        from: &Goblin,
        metadata: &Metadata,
        progress: &dyn Progress,
    ) -> Result<bool> {
        if !matches!(self.file, File::Goblin(_)) {
            return Ok(false);
        }
        self.check(from.header().form, from.header().depth(), &metadata.name)?;
        match &mut self.file {
            File::Goblin(file) => file.copy(from, metadata, progress).map(|()| true),
            File::Autumnal(_) => Ok(false),
        }
    }

    /// Writes what stands behind the layers, and puts the file in its place.
    ///
    /// # Errors
    /// If the file cannot be written, or layers are missing.
    pub fn finish(self) -> Result<()> {
        if self.names.len() != self.layers as usize {
            let found = format!("{} layers", self.names.len());
            return Err(Error::invalid("file", found, format!("{}, as was said", self.layers)));
        }
        match self.file {
            File::Goblin(file) => file.finish(),
            File::Autumnal(file) => file.finish(),
        }
    }
}
