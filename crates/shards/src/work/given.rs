//! Layers whose cells only the caller has: arrays in memory, or of another package.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::FileAccess;
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::Packing;

use super::{PartOfJob, Work};

/// Layers that the caller provides, as stored in a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Given {
    /// Identifies the cells.
    pub(crate) token: String,
    packing: Packing,
}

impl Given {
    pub(crate) fn of(token: &str, packing: Packing) -> Given {
        Given { token: token.into(), packing }
    }
}

impl Work for Given {
    fn files_of(&self, _: &Path, _: &FileAccess) -> Result<Vec<PathBuf>> {
        Ok(Vec::new())
    }

    fn build(&self, part: PartOfJob, _: u64, _: &dyn Progress) -> Result<()> {
        let advice = "build it with `spinney.dask.build` of the array, which goes on with this job";
        Err(Error::unsupported(part.head, "a shard of arrays, which are in no file,", advice))
    }
}
