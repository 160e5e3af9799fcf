//! Open files of a mosaic.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::store::goblin::Goblin;
use spinney_base::io::batch::outside_batch;
use spinney_base::{Error, Result};
use spinney_container::{FileHeader, FileReference, Header, OpenOptions, TreeFormat};
use spinney_manifest::{FileTag, ListedFile};

/// Maximum number of open files.
pub(super) const MAX_OPEN: usize = 64;

/// Most recently used files.
#[derive(Default)]
pub(super) struct OpenFiles(Mutex<Vec<(u32, Arc<Goblin>)>>);

impl OpenFiles {
    /// Returns a file, which becomes the most recently used; opens it if it is not open.
    pub(super) fn get(&self, number: u32, open: &dyn Fn() -> Result<Goblin>) -> Result<Arc<Goblin>> {
        if let Some(file) = self.kept(number) {
            return Ok(file);
        }
        // (Without the lock: other threads continue, and in the worst case two open the same file.
        // Outside of the current batch, which would open the file again in each attempt.)
        let file = Arc::new(outside_batch(open)?);
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= MAX_OPEN {
            kept.remove(0);
        }
        kept.push((number, file.clone()));
        Ok(file)
    }

    fn kept(&self, number: u32) -> Option<Arc<Goblin>> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let index = kept.iter().rposition(|(other, _)| *other == number)?;
        let found = kept.remove(index);
        kept.push(found);
        kept.last().map(|(_, file)| file.clone())
    }

    /// All open files.
    pub(super) fn all(&self) -> Vec<Arc<Goblin>> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().map(|(_, file)| file.clone()).collect()
    }
}

/// Opens a file of one tree or one of its layers, with its tag.
pub(super) fn open_goblin(
    file: &Path,
    layer: Option<&str>,
    options: &OpenOptions,
) -> Result<(Goblin, FileTag)> {
    let backend = options.open(file)?;
    if FileHeader::read_cells(file, &*backend)?.format == TreeFormat::Autumnal {
        let advice = "convert it first (`spinney convert MAP.autumn -o MAP.goblin`), since edits would change the mosaic";
        return Err(Error::unsupported(file, "an Autumnal file in a manifest", advice));
    }
    let tag = FileTag::of(&*backend)?;
    let first = Goblin::from_backend(file, backend, options)?;
    let place = FileReference { file: file.into(), commit: None, layer: layer.map(Into::into) };
    let number = place.layer_number(first.layers().iter().map(|layer| &*layer.name))?;
    Ok((if number == 0 { first } else { first.open_layer(number)? }, tag))
}

/// Adds the manifest to the error for a listed file that does not exist.
fn if_missing(error: Error, entry: &ListedFile, manifest: &Path) -> Error {
    match error {
        Error::Io { path, doing, cause } if cause.kind() == ErrorKind::NotFound => {
            let (list, name) = (manifest.display(), &entry.path);
            let advice = format!(
                "{list} lists it: restore the file, or remove it from the list: `spinney manifest -o {list} --remove {name}`"
            );
            Error::Io { path, doing, cause: io::Error::new(cause.kind(), format!("{cause}; {advice}")) }
        }
        other => other,
    }
}

/// Opens a file of a manifest and checks it against the manifest's entry.
pub(super) fn open_listed(
    entry: &ListedFile,
    (manifest, common): (&Path, &Header),
    options: &OpenOptions,
) -> Result<Goblin> {
    let path: PathBuf = entry.file(manifest)?;
    options.access.check_external(manifest, &path)?;
    let opened = open_goblin(&path, entry.layer.as_deref(), options);
    let (file, tag) = opened.map_err(|error| if_missing(error, entry, manifest))?;
    let header = file.header();
    let is_same = tag == entry.tag
        && header.depth() == entry.depth
        && header.extent == entry.bounds.size()
        && (header.form, header.rule, header.kind) == (common.form, common.rule, common.kind);
    if is_same {
        return Ok(file);
    }
    let show = |tag: FileTag| format!("{} bytes with tag {:08x}", tag.length, tag.checksum);
    let found = format!("{1}, unlike the entry in {0}", manifest.display(), show(tag));
    let expected = format!(
        "{}; to use the file as it is now: `spinney manifest --add {} -o {}`",
        show(entry.tag),
        path.display(),
        manifest.display()
    );
    Err(Error::invalid(path.display().to_string(), found, expected))
}
