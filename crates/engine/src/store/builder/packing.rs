//! Packing of a tree, and the precision that may be lost.

use std::path::Path;

use super::rounding::Rounding;
use serde::{Deserialize, Serialize};
use spinney_base::value::{DataKind, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{Codec, Metadata, TreeFormat};

/// Packing of a tree, and the precision that may be lost. The default is plain segments without
/// loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Packing {
    /// Packing of segments; only Goblin files can have packed ones.
    pub codec: Codec,
    /// Maximum absolute difference of a cell's sample from the original. Samples are rounded to
    /// multiples of a power of two, and packed segments store only the remaining digits. Coarser
    /// levels and statistics are those of the rounded cells. `None` rounds nothing.
    #[serde(with = "spinney_base::text_fields")]
    pub max_error: Option<f64>,
}

impl Packing {
    /// Returns packing of segments without loss.
    pub fn packed() -> Packing {
        Packing { codec: Codec::Packed, max_error: None }
    }

    /// Sets the maximum difference of samples from the originals.
    #[must_use]
    pub fn max_error(self, max_error: Option<f64>) -> Packing {
        Packing { max_error, ..self }
    }

    /// Records the maximum error of cells in a tree's metadata.
    pub(crate) fn record_in(&self, metadata: &mut Metadata) {
        if let Some(most) = self.max_error {
            metadata.add_error(most);
        }
    }

    /// Checks that a file of this name can have a tree packed like this.
    ///
    /// # Errors
    /// If it would be an Autumnal file, which has no segments.
    pub fn check_output(&self, path: &Path) -> Result<()> {
        match (self.codec, TreeFormat::of(path)) {
            (Codec::Packed | Codec::Reference, TreeFormat::Autumnal) => Err(no_segments(path)),
            _ => Ok(()),
        }
    }

    /// Returns the rounding of cells, by type and kind of their values.
    ///
    /// # Errors
    /// If values are classes, which cannot be rounded, or the maximum error is not a positive
    /// number.
    pub(in crate::store) fn rounding(&self, value: ValueType, kind: DataKind) -> Result<Option<Rounding>> {
        match self.max_error {
            None => Ok(None),
            Some(most) if kind == DataKind::Categorical => {
                let found = format!("{most} for a categorical tree");
                Err(Error::invalid("maximum error", found, "continuous values, or no maximum error"))
            }
            Some(most) => Rounding::new(value, most),
        }
    }
}

/// Returns the error for packing in an Autumnal file.
pub(in crate::store) fn no_segments(path: &Path) -> Error {
    let advice = "give the output a name that ends with .goblin; `spinney compact --pack` packs the history of an Autumnal file";
    Error::unsupported(path, "packing in an Autumnal file", advice)
}
