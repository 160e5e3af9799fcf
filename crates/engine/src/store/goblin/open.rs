//! Opening of a file: header, trailer, table of layers, metadata, and the top of the page index.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use super::index::Directory;
use super::reader::{Goblin, OpenFile};
use super::reference::{open_references, trailer_sections};
use crate::store::records::{RecordLayout, descend_in};
use crate::tree::Child;
use spinney_base::io::{ReadBackend, Unpacked};
use spinney_base::value::Value;
use spinney_base::{Error, Result};
use spinney_container::{
    FIRST_BYTES, FileHeader, LEAF, Layer, LayerTable, Metadata, OpenOptions, TAIL, Trailer, TreeFormat, VOID,
};
use spinney_packing::PLAIN_BITS;

impl Goblin {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is not a Goblin file, or is corrupt.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Goblin> {
        Goblin::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// Those of [`Goblin::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Goblin> {
        Goblin::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens a file through any backend; `path` is for messages.
    ///
    /// # Errors
    /// Those of [`Goblin::open`].
    pub fn from_backend(path: &Path, backend: Box<dyn ReadBackend>, options: &OpenOptions) -> Result<Goblin> {
        let backend = options.access.cached(backend);
        // Before any read.
        let version = backend.version()?;
        let (length, tail) = (backend.len(), backend.len().min(TAIL as u64));
        backend.prefetch(&[0..length.min(FIRST_BYTES as u64), length - tail..length])?;
        let header = FileHeader::read_cells(path, &*backend)?;
        if header.format != TreeFormat::Goblin {
            return Err(Error::corrupt(path, "header", "an Autumnal file", "a Goblin file"));
        }
        let trailer = Trailer::from_bytes(path, &backend.read(length - tail, tail as usize)?, length)?;
        if trailer.header != header {
            return Err(Error::corrupt(path, "trailer", "a different header", "a copy of the file's header"));
        }
        let table = trailer.section(LayerTable::TAG);
        let layers =
            LayerTable::from_bytes(path, &header, length, &table.read(path, &*backend, "table of layers")?)?;
        let references = open_references(path, &*backend, (&trailer, &layers), &options.access)?;
        if references.is_some() {
            backend.reads_small_ranges();
        }
        let path = path.to_path_buf();
        let file = OpenFile {
            path,
            backend,
            version,
            layers,
            table,
            check: options.check,
            access: options.access.clone(),
            reference_sections: references.is_some().then(|| trailer_sections(&trailer)),
            references,
        };
        Goblin::of_file(Arc::new(file), 0)
    }

    /// Opens another layer of the same file.
    ///
    /// # Errors
    /// If its metadata or the top of its page index cannot be read.
    ///
    /// # Panics
    /// If there is no layer of that index.
    pub fn open_layer(&self, number: usize) -> Result<Goblin> {
        Goblin::of_file(self.file.clone(), number)
    }

    fn of_file(file: Arc<OpenFile>, number: usize) -> Result<Goblin> {
        let (path, layer) = (&file.path, &file.layers[number]);
        Metadata::check_length(path, layer.metadata.length)?;
        file.backend.prefetch(&[layer.metadata.range(), layer.top.range()])?;
        let metadata = layer.metadata.read(path, &*file.backend, "metadata")?;
        let metadata = Metadata { name: layer.name.clone(), ..Metadata::from_bytes(path, &metadata)? };
        let top = layer.top.read(path, &*file.backend, "top of the index")?;
        let directory = Directory::new(layer, &top, &file.access).ok_or_else(|| {
            let found = format!("{} segments", layer.segments);
            Error::corrupt(
                path,
                "table of layers",
                found,
                "the number that fits the size of the directory and its index",
            )
        })?;
        let checked = (0..layer.segments.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let header = layer.header.clone();
        let layout = RecordLayout::new(header.form);
        let root = root(layer, layout.width);
        Ok(Goblin {
            layout,
            descend: descend_in(layout),
            root,
            header,
            number,
            metadata,
            directory,
            checked,
            checked_bytes: AtomicU64::new(0),
            unpacked: Unpacked::new(&file.access, PLAIN_BITS),
            file,
        })
    }
}

/// Returns the tree's root; its value has `width` bytes.
fn root(layer: &Layer, width: usize) -> Child<()> {
    let value = Value::from_bytes(&layer.root_value[..width]);
    match layer.root_state {
        VOID => Child::Void,
        LEAF => Child::Leaf(value),
        _ => Child::Inner { representative: value, node: () },
    }
}
