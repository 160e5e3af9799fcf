//! Layers whose cells only the caller has: arrays in memory, or of another package.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::FileAccess;
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::Packing;

use super::{ShardTask, Work};

/// Layers that the caller provides, as stored in a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ArrayWork {
    /// Identifies the cells.
    pub(crate) token: String,
    packing: Packing,
}

impl ArrayWork {
    pub(crate) fn of(token: &str, packing: Packing) -> ArrayWork {
        ArrayWork { token: token.into(), packing }
    }
}

impl Work for ArrayWork {
    fn files_of(&self, _: &Path, _: &FileAccess) -> Result<Vec<PathBuf>> {
        Ok(Vec::new())
    }

    fn build(&self, part: ShardTask, _: u64, _: &dyn Progress) -> Result<()> {
        let advice = "continue the job with `spinney.dask.build` of the array";
        Err(Error::unsupported(part.head, "building a shard of arrays from the command line", advice))
    }
}
