//! The metadata section: everything about a file that is not needed to find its way in it.

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

/// Georeference, meaning and provenance of the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// The name of the tree among those of its file; empty where it needs none. (Tables of layers have it, not the section.)
    #[serde(skip)]
    pub name: String,
    /// Georeference of the cells.
    pub frame: Frame,
    /// The number that VOID had in the input, and gets in outputs that need one.
    pub nodata: Option<Number>,
    /// Colours of the values.
    pub palette: Option<Palette>,
    /// Names of the values.
    pub class_names: BTreeMap<Number, String>,
    /// A name per channel; empty strings or nothing where unknown.
    pub band_names: Vec<String>,
    /// Factor and summand per channel that make physical units of samples; nothing where there is nothing to
    /// do.
    pub scale_offset: Vec<(f64, f64)>,
    /// Unit per channel of what scale and offset make; empty strings or nothing where unknown.
    pub units: Vec<String>,
    /// Number of the channel that is opacity.
    pub alpha: Option<u8>,
    /// Nodes per level.
    pub counts: LevelCounts,
    /// Provenance of the data, in order: one line per input or operation. The section has no secrets of URLs in it.
    pub provenance: Vec<String>,
    /// Anything else.
    pub tags: BTreeMap<String, String>,
    /// Anything else that is said of one channel, or in a domain.
    pub scoped_tags: ScopedTags,
    /// Ground control points.
    pub control_points: Option<ControlPoints>,
    /// The time of what is seen, as ISO 8601 writes it.
    pub time: Option<String>,
    /// Cells along an axis that each sample of the input has been repeated to: 3 if 60 m came onto a grid of 20 m.
    pub repeated: u32,
}

/// Tags by what they are about.
pub type ScopedTags = BTreeMap<TagScope, BTreeMap<String, String>>;

/// The subject of some tags: one channel, a domain (a room of its own for names, as in GDAL), or both.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct TagScope {
    /// The channel, from 0; `None` is the whole picture.
    pub channel: Option<u16>,
    /// The domain; empty is the usual one.
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

/// Bytes that metadata may have, on disk and decoded: a hostile length must not ask for more.
const LIMIT: usize = 16 << 20;
const SECTION: VersionedSection<LIMIT> = VersionedSection { name: "metadata", version: 1 };

impl Metadata {
    /// The section's bytes.
    ///
    /// # Errors
    /// If there are more than 16 MiB.
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
            advice: "leave out tags or class names".into(),
        })
    }

    /// The provenance without secrets of URLs: see [`redacted`].
    pub fn clean_provenance(&self) -> Vec<String> {
        self.provenance.iter().map(|line| redacted(line).into_owned()).collect()
    }

    /// Checks the section's length, which must be done before anybody makes room for its bytes.
    pub fn check_length(path: &Path, length: u64) -> Result<()> {
        let fits = length <= LIMIT as u64;
        let found = || format!("{length} bytes");
        fits.then_some(()).ok_or_else(|| Error::corrupt(path, "metadata", found(), "at most 16 MiB"))
    }

    /// Reads the section.
    ///
    /// # Errors
    /// If it is damaged, or of a newer version.
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
