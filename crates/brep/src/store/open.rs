//! Opening of model files: header, trailer, metadata and chunk lists.

use std::path::Path;

use super::chunks::{ChunkList, ENTRY, List, check_total};
use super::exact::EXACT;
use super::formula::{FORMULA, MAX_FORMULA};
use super::levels::{CLUSTERS, DetailLevel, LEVEL_FACES, LEVELS};
use super::objects::{FACE_VALUES, OBJECTS, SchemaCell};
use super::reader::ExactModel;
use super::summary::{DIRECTORY, FACES, METADATA, SUMMARY, Summary};
use spinney_base::io::{FileAccess, ReadBackend};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_container::OpenOptions;
/// Tag of the section of template instances, which is reserved.
const INSTANCES: [u8; 4] = *b"INST";

use spinney_container::{Content, FileHeader, HEADER_SIZE, Metadata, Section, TAIL, Trailer};

/// Returns whether a file is an exact model, whatever its name.
///
/// # Errors
/// If the file system or the file's host fails: see [`FileHeader::find`].
pub fn is_model_file(path: &Path, access: &FileAccess) -> Result<bool> {
    Ok(FileHeader::find(path, access)?.is_some_and(|header| header.content == Content::Model))
}

impl ExactModel {
    /// Opens a file.
    ///
    /// ```
    /// use spinney::ExactModel;
    /// use spinney::brep::Faces;
    /// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
    /// # use spinney::Output;
    /// # let directory = tempfile::tempdir().unwrap();
    /// # let [mesh, path] = ["tetrahedron.off", "tetrahedron.goblin"].map(|name| directory.path().join(name));
    /// # let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    /// # std::fs::write(&mesh, text).unwrap();
    /// # import_exact(open_all(&[mesh], 64 << 20)?, &ExactOptions::new(), Output::create(&path)?, &())?;
    /// let model = ExactModel::open(&path, &Default::default())?;
    /// assert_eq!(model.len(), 4);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If it cannot be read, is not an exact model, or is corrupt.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<ExactModel> {
        ExactModel::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// The errors of [`ExactModel::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<ExactModel> {
        ExactModel::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens a file of any backend; `path` is for messages.
    ///
    /// # Errors
    /// The errors of [`ExactModel::open`].
    pub fn from_backend(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        options: &OpenOptions,
    ) -> Result<ExactModel> {
        let backend = options.access.cached(backend);
        // The version must be read before anything else.
        let version = backend.version()?;
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
        let others = [EXACT, OBJECTS, FACE_VALUES, CLUSTERS, LEVEL_FACES];
        let lists = others.map(|tag| trailer.section(tag)).into_iter().filter(|list| list.length > 0);
        let first_lists = trailer.section(FACES).offset.min(trailer.section(DIRECTORY).offset);
        let end = lists.map(|list| list.offset).fold(first_lists, u64::min);
        let chunk_list = |list: List, section: Section, is_needed: Option<bool>| {
            let is_list = is_needed.is_none_or(|is_needed| is_needed == (section.length > 0))
                && section.length.is_multiple_of(ENTRY as u64)
                && (section.offset >= HEADER_SIZE as u64 || section.length == 0);
            if !is_list {
                let found = format!("a list of {} bytes", section.length);
                let expected =
                    if is_needed != Some(false) { "one or more entries of 24 bytes" } else { "nothing" };
                return Err(Error::corrupt(path, list.chunk_name(), found, expected));
            }
            let (location, is_mapped) = ((section.offset, section.length), backend.bytes().is_some());
            Ok(ChunkList::new(list, summary.codec, location, is_mapped, end, options))
        };
        let segments = chunk_list(List::Segments, trailer.section(DIRECTORY), Some(true))?;
        let blocks = chunk_list(List::Faces, trailer.section(FACES), Some(summary.faces > 0))?;
        let exact = chunk_list(List::Exact, trailer.section(EXACT), Some(summary.exact_faces > 0))?;
        let objects = chunk_list(List::Objects, trailer.section(OBJECTS), None)?;
        let face_values = chunk_list(List::FaceValues, trailer.section(FACE_VALUES), None)?;
        let section = trailer.section(LEVELS);
        let levels = match section.length {
            0 => Vec::new().into(),
            1..=4096 => section.read(path, &*backend, "levels")?,
            length => {
                let found = format!("{length} bytes");
                return Err(Error::corrupt(path, "levels", found, "at most 4096"));
            }
        };
        let levels = DetailLevel::from_bytes(&levels)
            .map_err(|found| Error::corrupt(path, "levels", found, "levels as in formats.md"))?;
        // (Models with few faces have the exact level alone, and those without faces no clusters.)
        let has_clusters = Some(!levels.is_empty() && summary.faces > 0);
        let no_levels = levels.is_empty().then_some(false);
        let clusters = chunk_list(List::Clusters, trailer.section(CLUSTERS), has_clusters)?;
        let level_faces = chunk_list(List::LevelFaces, trailer.section(LEVEL_FACES), no_levels)?;
        let mut bytes = 0u64;
        for list in [&segments, &blocks, &exact, &objects, &face_values, &clusters, &level_faces] {
            bytes = bytes.saturating_add(list.check(path, &*backend)?);
        }
        check_total(path, bytes, end)?;
        if trailer.section(INSTANCES).length > 0 {
            let advice = "replace its templates by their instances with the program that wrote it";
            return Err(Error::unsupported(path, "a model with templates", advice));
        }
        let formula = trailer.section(FORMULA);
        if formula.length > MAX_FORMULA {
            let found = format!("{} bytes", formula.length);
            return Err(Error::corrupt(path, "formula", found, format!("at most {MAX_FORMULA}")));
        }
        let mut model = ExactModel {
            path: path.to_path_buf(),
            backend,
            version,
            trailer,
            metadata,
            summary,
            parts: Vec::new(),
            segments,
            blocks,
            exact,
            objects,
            face_values,
            levels,
            clusters,
            level_faces,
            schema: SchemaCell::new(),
        };
        model.parts = model.read_parts()?;
        Ok(model)
    }
}

/// Reads and checks the header of an exact model; returns the depth of its octree.
fn model_depth(path: &Path, file: &dyn ReadBackend) -> Result<u8> {
    let header = FileHeader::read(path, file)?;
    match (header.content, header.dimension) {
        (Content::Model, Dimension::Oct) => Ok(header.depth),
        _ => Err(Error::corrupt(path, "header", "a tree of cells", "an exact model")),
    }
}
