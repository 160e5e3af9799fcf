//! The metadata section: everything about a file that navigation does not need.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::level_counts::LevelCounts;
use super::versioned::VersionedSection;
use spinney_base::io::redacted;
use spinney_base::value::{Number, Palette};
use spinney_base::{Error, Result};
use spinney_crs::{ControlPoints, Frame};

/// Georeferencing, meaning and provenance of the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// Name of the tree in its file; may be empty if there is only one. Stored in the layer table,
    /// not in this section.
    #[serde(skip)]
    pub name: String,
    /// Georeferencing of the cells.
    pub frame: Frame,
    /// Nodata value of the input. Outputs that need one use it for VOID.
    pub nodata: Option<Number>,
    /// Colours of the values.
    pub palette: Option<Palette>,
    /// Names of the values.
    pub class_names: BTreeMap<Number, String>,
    /// A name per channel; an empty string if unknown. The list may be empty.
    pub band_names: Vec<String>,
    /// Scale and offset per channel, which convert samples to physical units. Empty if samples need
    /// no conversion.
    pub scale_offset: Vec<(f64, f64)>,
    /// Unit of the converted samples per channel; an empty string if unknown. The list may be
    /// empty.
    pub units: Vec<String>,
    /// Index of the opacity channel.
    pub alpha: Option<u8>,
    /// Node counts per level.
    pub counts: LevelCounts,
    /// Provenance of the data, in order: one line per input or operation. Secrets in URLs are
    /// removed when the section is written.
    pub provenance: Vec<String>,
    /// Other metadata.
    pub tags: BTreeMap<String, String>,
    /// Other metadata of one channel or domain.
    pub scoped_tags: ScopedTags,
    /// Ground control points.
    pub control_points: Option<ControlPoints>,
    /// Acquisition time in ISO 8601.
    pub time: Option<String>,
    /// Number of cells along an axis that repeat one sample of the input: 3 if 60 m data was
    /// resampled to a grid of 20 m.
    pub repeated: u32,
}

/// Tags by scope.
pub type ScopedTags = BTreeMap<TagScope, BTreeMap<String, String>>;

/// Scope of some tags: a channel, a domain (a namespace of names, as in GDAL), or both.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct TagScope {
    /// The channel, from 0; `None` is the whole raster.
    pub channel: Option<u16>,
    /// The domain; empty is the default one.
    pub domain: String,
}

impl Default for Metadata {
    fn default() -> Self {
        Metadata {
            name: String::new(),
            frame: Frame::identity(),
            nodata: None,
            palette: None,
            class_names: BTreeMap::new(),
            band_names: Vec::new(),
            scale_offset: Vec::new(),
            units: Vec::new(),
            alpha: None,
            counts: LevelCounts::default(),
            provenance: Vec::new(),
            tags: BTreeMap::new(),
            scoped_tags: BTreeMap::new(),
            control_points: None,
            time: None,
            repeated: 1,
        }
    }
}

/// Maximum size of metadata in bytes, on disk and decoded. It limits the memory that an untrusted
/// length can allocate.
const LIMIT: usize = 16 << 20;
const SECTION: VersionedSection<LIMIT> = VersionedSection { name: "metadata", version: 1 };

impl Metadata {
    /// Encodes the section.
    ///
    /// # Errors
    /// If it would have more than 16 MiB.
    pub fn to_bytes(&self, path: &Path) -> Result<Vec<u8>> {
        let is_clean = self.provenance.iter().all(|line| matches!(redacted(line), Cow::Borrowed(_)));
        let own = match is_clean {
            true => Cow::Borrowed(self),
            false => Cow::Owned(Metadata { provenance: self.clean_provenance(), ..self.clone() }),
        };
        SECTION.encode(&*own).ok_or_else(|| Error::TooLarge {
            path: path.to_path_buf(),
            what: "the metadata (coordinate system, palette, names, tags, control points)".into(),
            needed: LIMIT as u64 + 1,
            limit: LIMIT as u64,
            advice: "remove tags or class names".into(),
        })
    }

    /// The provenance without secrets in URLs: see [`redacted`].
    pub fn clean_provenance(&self) -> Vec<String> {
        self.provenance.iter().map(|line| redacted(line).into_owned()).collect()
    }

    /// Checks the section's length. Callers must do so before they allocate a buffer for its bytes.
    pub fn check_length(path: &Path, length: u64) -> Result<()> {
        let fits = length <= LIMIT as u64;
        let found = || format!("{length} bytes");
        fits.then_some(()).ok_or_else(|| Error::corrupt(path, "metadata", found(), "at most 16 MiB"))
    }

    /// Decodes the section.
    ///
    /// # Errors
    /// If it is corrupt, or of a newer version.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Metadata> {
        Metadata::check_length(path, bytes.len() as u64)?;
        SECTION.decode(path, bytes).map(|(metadata, _)| metadata)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_of_urls_are_not_stored() {
        let line = "raster https://user:SECRET@host/x.tif?sig=SECRET (8x8)".to_string();
        let metadata = Metadata { provenance: vec![line], ..Metadata::default() };
        let path = Path::new("x.goblin");
        let stored = Metadata::from_bytes(path, &metadata.to_bytes(path).unwrap()).unwrap();
        assert_eq!(stored.provenance, ["raster https://...@host/x.tif?... (8x8)"]);
        assert_eq!(stored.provenance, metadata.clean_provenance());
        assert_eq!(stored.to_bytes(path).unwrap(), metadata.to_bytes(path).unwrap());
    }
}
