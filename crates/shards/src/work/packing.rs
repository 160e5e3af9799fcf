//! Packing as plans tell it.

use serde::{Deserialize, Serialize};
use spinney_base::Result;
use spinney_container::Codec;
use spinney_engine::store::Packing;

use super::number;

/// The way in which segments are packed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlannedPacking {
    codec: String,
    max_error: Option<String>,
}

impl PlannedPacking {
    pub(super) fn of(packing: Packing) -> PlannedPacking {
        PlannedPacking {
            codec: packing.codec.name().into(),
            max_error: packing.max_error.map(|most| most.to_string()),
        }
    }

    pub(super) fn packing(&self) -> Result<Packing> {
        let mut packing = Packing::default();
        packing.codec = self.codec.parse::<Codec>()?;
        packing.max_error = self.max_error.as_deref().map(number).transpose()?;
        Ok(packing)
    }
}
