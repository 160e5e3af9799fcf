//! Opening a file: header, trailer, metadata, and where the lists are.

use std::path::Path;

use super::pieces::{ENTRY, Pieces};
use super::reader::ExactModel;
use super::summary::{DIRECTORY, FACES, METADATA, SUMMARY, Summary};
use spinney_base::io::{Positioned, ReadBackend};
use spinney_base::space::Dimension;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_container::OpenOptions;
use spinney_container::{Content, FileHeader, HEADER_SIZE, Metadata, Section, TAIL, Trailer};

/// Whether a file is an exact model, whatever its name.
pub fn is_model_file(path: &Path) -> bool {
    Positioned::open(path).and_then(|file| model_depth(path, &file)).is_ok()
}

impl ExactModel {
    /// Opens a file.
    ///
    /// ```
    /// use spinney::brep::{ExactModel, Faces};
    /// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
    /// # use spinney::io::Output;
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let [mesh, path] = ["tetrahedron.off", "tetrahedron.goblin"].map(|name| folder.path().join(name));
    /// # let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    /// # std::fs::write(&mesh, text).unwrap();
    /// # import_exact(open_all(&[mesh], 64 << 20)?, &ExactOptions::new(), Output::create(&path)?, &())?;
    /// let model = ExactModel::open(&path, &Default::default())?;
    /// assert_eq!(model.len(), 4);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If it cannot be read, is no exact model, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<ExactModel> {
        ExactModel::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file that is in memory.
    ///
    /// # Errors
    /// Those of [`ExactModel::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<ExactModel> {
        ExactModel::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens whatever a backend reads; `path` is for messages.
    ///
    /// # Errors
    /// Those of [`ExactModel::open`].
    pub fn from_backend(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        options: &OpenOptions,
    ) -> Result<ExactModel> {
        // Before anything is read.
        let stamp = backend.stamp()?;
        let depth = model_depth(path, &*backend)?;
        let length = backend.len();
        let tail = length.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &backend.read(length - tail, tail as usize)?, length)?;
        Metadata::check_length(path, trailer.section(METADATA).length)?;
        let metadata =
            Metadata::from_bytes(path, &trailer.section(METADATA).read(path, &*backend, "metadata")?)?;
        let section = trailer.section(SUMMARY);
        if section.length > 4096 {
            let found = format!("{} bytes", section.length);
            return Err(Error::corrupt(path, "model", found, "at most 4096"));
        }
        let summary = Summary::from_bytes(path, &section.read(path, &*backend, "model")?)?;
        if depth != summary.grid.depth() {
            let expected = format!("{} for a grid of {} bits", summary.grid.depth(), summary.grid.bits);
            return Err(Error::corrupt(path, "header", format!("depth {depth}"), expected));
        }
        let end = trailer.section(FACES).offset.min(trailer.section(DIRECTORY).offset);
        let pieces = |name: &'static str, section: Section| {
            // (Nothing and everything have no faces.)
            let is_list = (section.length > 0 || (name != "segment" && summary.faces == 0))
                && section.length.is_multiple_of(ENTRY as u64)
                && section.offset >= HEADER_SIZE as u64;
            if !is_list {
                let found = format!("a list of {} bytes", section.length);
                return Err(Error::corrupt(path, name, found, "one or more entries of 24 bytes"));
            }
            let held = match backend.bytes() {
                Some(_) => None,
                None => Some(section.read(path, &*backend, name)?.into_owned()),
            };
            let place = (section.offset, section.length);
            Ok(Pieces::new(name, place, held, end, (options.check, options.cache / 2)))
        };
        let segments = pieces("segment", trailer.section(DIRECTORY))?;
        let blocks = pieces("block of faces", trailer.section(FACES))?;
        // Pieces that are stored once each: the work of going through all of them goes with the file's size.
        let bytes = segments.check(path, &*backend)?.saturating_add(blocks.check(path, &*backend)?);
        let room = end.saturating_sub(HEADER_SIZE as u64);
        if bytes > room {
            let found = format!("{bytes} bytes of faces and segments");
            return Err(Error::corrupt(path, "lists", found, format!("at most the {room} before the lists")));
        }
        // Part numbers stand for the names; one that has none is as good as a name.
        let names = &metadata.class_names;
        let count = names
            .last_key_value()
            .map_or(1, |(last, _)| (last.to_f64() as i64).saturating_add(1).clamp(1, 1 << 24));
        let named =
            names.range(Number::default()..count.into()).map(|(_, name)| name.clone()).collect::<Vec<_>>();
        if named.len() as i64 != count && !names.is_empty() {
            let found = format!("{} names of {count} parts", named.len());
            return Err(Error::corrupt(path, "metadata", found, "a name for each part"));
        }
        let parts = if named.is_empty() { vec!["mesh".into()] } else { named };
        Ok(ExactModel {
            path: path.to_path_buf(),
            backend,
            stamp,
            trailer,
            metadata,
            summary,
            parts,
            segments,
            blocks,
        })
    }
}

/// Reads and checks the header of an exact model; returns the levels of its octree.
fn model_depth(path: &Path, file: &dyn ReadBackend) -> Result<u8> {
    let header = FileHeader::read(path, file)?;
    match (header.content, header.dimension) {
        (Content::Model, Dimension::Oct) => Ok(header.depth),
        _ => Err(Error::corrupt(path, "header", "a tree of cells", "an exact model")),
    }
}
