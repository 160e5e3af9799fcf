//! Names of sources: paths, patterns of names, and documents of STAC items.

use std::path::PathBuf;

use super::stac::assets_of;
use spinney_base::io::FileAccess;
use spinney_base::{Error, Result};

/// A source of an index.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SourceFile {
    /// Path or URL.
    pub path: PathBuf,
    /// Acquisition time in ISO 8601, of a file of a STAC item: the item's `datetime`, or the start
    /// of its range.
    pub time: Option<String>,
}

impl SourceFile {
    pub(super) fn new(path: PathBuf, time: Option<String>) -> SourceFile {
        SourceFile { path, time }
    }
}

/// Returns the files that names refer to, in their order: of a pattern those that match it
/// ([`FileAccess::expand`]), of a document of STAC items those of the items' `asset`. Without a
/// name of an asset, it is their only GeoTIFF with the role "data".
///
/// # Errors
/// If no file matches a pattern, a document of STAC items is corrupt or has no such asset, or an
/// asset is named but no document has items.
pub fn expand_sources(
    named: &[PathBuf],
    asset: Option<&str>,
    access: &FileAccess,
) -> Result<Vec<SourceFile>> {
    let (mut sources, mut has_items) = (Vec::new(), false);
    for name in named {
        for file in access.expand(name)? {
            match assets_of(&file, asset, access)? {
                Some(assets) => {
                    has_items = true;
                    sources.extend(assets);
                }
                None => sources.push(SourceFile::new(file, None)),
            }
        }
    }
    match asset.filter(|_| !has_items) {
        Some(asset) => {
            Err(Error::invalid("asset", asset, "a source with STAC items, which alone have assets"))
        }
        None => Ok(sources),
    }
}
