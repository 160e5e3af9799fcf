//! How few bytes a tree is to take, and what it may lose for that.

use std::path::Path;

use super::rounding::Rounding;
use spinney_base::value::{DataKind, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{Codec, Metadata, TreeFormat};
use spinney_packing::Effort;

/// How few bytes a tree is to take, and what it may lose for that: plain segments, and nothing, unless something else is said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Packing {
    /// Packing of segments; only Goblin files can have packed ones.
    pub codec: Codec,
    /// Effort of packing.
    pub effort: Effort,
    /// By how much samples of cells may differ from what they were: they are rounded to multiples of a power of two, of which packed
    /// segments store no more digits than they have. Coarser levels and statistics are those of the rounded cells. Nothing is rounded
    /// without it.
    pub max_error: Option<f64>,
}

impl Packing {
    /// Packed segments, made with an effort.
    pub fn packed(effort: Effort) -> Packing {
        Packing { codec: Codec::Packed, effort, max_error: None }
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

    /// The effort of a name: fast or small.
    ///
    /// # Errors
    /// If it is none.
    pub fn effort_named(name: &str) -> Result<Effort> {
        match name {
            "fast" => Ok(Effort::Fast),
            "small" => Ok(Effort::Small),
            _ => Err(Error::invalid("effort", format!("`{name}`"), "fast or small")),
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
