//! How few bytes a tree is to take, and what it may lose for that.

use std::path::Path;

use super::rounding::Rounding;
use serde::{Deserialize, Serialize};
use spinney_base::value::{DataKind, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{Codec, Metadata, TreeFormat};

/// How few bytes a tree is to take, and what it may lose for that: plain segments, and nothing, unless something else is said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Packing {
    /// Packing of segments; only Goblin files can have packed ones.
    pub codec: Codec,
    /// By how much samples of cells may differ from what they were: they are rounded to multiples of a power of two, of which packed
    /// segments store no more digits than they have. Coarser levels and statistics are those of the rounded cells. Nothing is rounded
    /// without it.
    #[serde(with = "spinney_base::text_fields")]
    pub max_error: Option<f64>,
}

impl Packing {
    /// Packed segments.
    pub fn packed() -> Packing {
        Packing { codec: Codec::Packed, max_error: None }
    }

    /// Chooses by how much samples may differ from what they were.
    #[must_use]
    pub fn max_error(self, max_error: Option<f64>) -> Packing {
        Packing { max_error, ..self }
    }

    /// Tells in a tree's metadata by how much its cells may differ from what they were.
    pub(crate) fn tell(&self, metadata: &mut Metadata) {
        if let Some(most) = self.max_error {
            metadata.add_error(most);
        }
    }

    /// Makes sure that a file of this name can have a tree that is packed like this.
    ///
    /// # Errors
    /// If it would be an Autumnal file, which has no segments.
    pub fn check_output(&self, path: &Path) -> Result<()> {
        match (self.codec, TreeFormat::of(path)) {
            (Codec::Packed, TreeFormat::Autumnal) => Err(no_segments(path)),
            _ => Ok(()),
        }
    }

    /// The rounding of cells with values of a type and a kind.
    ///
    /// # Errors
    /// If values are names, which cannot be rounded, or the greatest error is no number above 0.
    pub(in crate::store) fn rounding(&self, value: ValueType, kind: DataKind) -> Result<Option<Rounding>> {
        match self.max_error {
            None => Ok(None),
            Some(most) if kind == DataKind::Categorical => {
                let found = format!("{most} for classes");
                Err(Error::invalid("greatest error", found, "values that are amounts, or no greatest error"))
            }
            Some(most) => Rounding::new(value, most),
        }
    }
}

/// The error for packing in an Autumnal file.
pub(in crate::store) fn no_segments(path: &Path) -> Error {
    let advice =
        "history is made smaller by `spinney compact --pack`; give the output a name that ends with .goblin";
    Error::unsupported(path, "packing in an Autumnal file", advice)
}
