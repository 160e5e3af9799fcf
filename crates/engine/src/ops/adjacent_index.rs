//! Indexes next to their source: `map.tif.goblin` is used where `map.tif` is named.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::tree_file::TreeFile;
use crate::store::goblin::Goblin;
use spinney_base::io::{ReadBackend, listed_path, sibling_path, url_of, without_query};
use spinney_base::{Error, Result};
use spinney_container::{FileHeader, FileReference, OpenOptions, TreeFormat, shell_word};

/// First bytes of the files that an index can have: TIFF and BigTIFF, in both byte orders.
const TIFF: [&[u8; 4]; 4] = [b"II*\0", b"II+\0", b"MM\0*", b"MM\0+"];

/// Maximum number of sources of such an index: the pages of the file.
const MAX_SOURCES: usize = 1024;

/// Opens the index next to a TIFF file, which is open as `raster`; `None` if there is none that has
/// only this source.
///
/// # Errors
/// If the index is corrupt, or was made of a file of another length.
pub(super) fn open_adjacent_index(
    place: &FileReference<'_>,
    raster: &dyn ReadBackend,
    options: &OpenOptions,
) -> Result<Option<TreeFile>> {
    let first = raster.read(0, raster.len().min(4) as usize)?;
    let is_tiff = TIFF.iter().any(|mark| first[..] == mark[..]);
    drop(first);
    // (A custom source has only the bytes of the file that is named.)
    if !is_tiff || place.commit.is_some() || options.source.is_some() {
        return Ok(None);
    }
    let path = index_path(&place.file);
    let opened = match options.open(&path) {
        Err(error) if is_missing(&path, &error) => return Ok(None),
        opened => opened?,
    };
    match FileHeader::read_cells(&path, &*opened) {
        Ok(header) if header.format == TreeFormat::Goblin => {}
        Ok(_) | Err(Error::Corrupt { .. } | Error::Unsupported { .. } | Error::NotATree { .. }) => {
            return Ok(None);
        }
        Err(error) => return Err(error),
    }
    let index = Goblin::from_backend(&path, opened, options)?;
    if !is_index_of(&index, &place.file, raster)? {
        return Ok(None);
    }
    let number = place.layer_number(index.layers().iter().map(|layer| &*layer.name))?;
    Ok(Some(if number == 0 { index } else { index.open_layer(number)? }.into()))
}

/// Path of the index next to a file.
fn index_path(file: &Path) -> PathBuf {
    sibling_path(file, |file| {
        let mut name = file.as_os_str().to_os_string();
        name.push(".goblin");
        name.into()
    })
}

/// Whether an index has this source only.
///
/// # Errors
/// If it has, but the file had another length.
fn is_index_of(index: &Goblin, file: &Path, raster: &dyn ReadBackend) -> Result<bool> {
    let Some((cells, bytes)) = index.references() else { return Ok(false) };
    if cells.sources() == 0 || cells.sources() > MAX_SOURCES {
        return Ok(false);
    }
    let mut indexed = None;
    cells.visit_sources(bytes, &mut |name, stat| {
        let is_own = listed_path(index.path(), name).is_ok_and(|source| is_same(&source, file));
        indexed = is_own.then_some(stat);
        Ok(is_own)
    })?;
    let Some(indexed) = indexed else { return Ok(false) };
    let update = format!("`spinney index --update {}`", shell_word(index.path()));
    if indexed.length != raster.len() {
        let expected = format!("{} bytes, as indexed ({update} reads it again)", indexed.length);
        return Err(Error::corrupt(file, "length", format!("{} bytes", raster.len()), expected));
    }
    // (An index of a local file may have been uploaded with it.)
    let is_other = raster.stat()?.is_some_and(|found| !found.agrees(&indexed));
    if is_other {
        let text = format!(
            "was written again after its index was made, whose statistics may be out of date ({update})"
        );
        index.access().warn(file, &text);
    }
    Ok(true)
}

/// Whether two paths or URLs name a file. Names in indexes have no queries.
fn is_same(a: &Path, b: &Path) -> bool {
    let [plain_a, plain_b] = [a, b].map(without_query);
    let is_local = url_of(a).is_none() && url_of(b).is_none();
    plain_a == plain_b || is_local && matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Whether an error means that there is no file. Stores deny access to missing files if the caller
/// may not list files.
fn is_missing(path: &Path, error: &Error) -> bool {
    let Error::Io { cause, .. } = error else { return false };
    cause.kind() == ErrorKind::NotFound
        || cause.kind() == ErrorKind::PermissionDenied && url_of(path).is_some()
}
