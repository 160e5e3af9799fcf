//! Packing of output trees.

use std::path::Path;

use anyhow::Result;
use spinney::raw::store;
use spinney::{Codec, WriteOptions};

use super::super::exact;
use super::Memory;

/// Packing of output trees.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Packing {
    /// Packing of the output's segments: plain (mapped and read in place) or packed (smaller,
    /// unpacked when read); for .goblin files; in exact models of blocks and tables
    #[arg(long, value_name = "plain|packed", default_value = "plain")]
    codec: Codec,
    /// Maximum error of cell samples: they are rounded to multiples of a power of two, so that
    /// packed segments are smaller. Coarser levels and statistics are computed from the rounded
    /// cells. Not for classes
    #[arg(long, value_name = "E")]
    max_error: Option<f64>,
}

impl Packing {
    /// Returns codec and maximum error.
    pub(crate) fn choice(&self) -> store::Packing {
        packing(self.codec).max_error(self.max_error)
    }

    /// Returns options for writing a tree with a memory limit.
    pub(crate) fn with(&self, memory: Memory) -> WriteOptions {
        WriteOptions::new(memory.bytes).packing(self.choice())
    }

    /// Returns the codec of an exact model. `input`, one of its sources, is for messages.
    ///
    /// # Errors
    /// If a maximum error is given: exact models are never rounded.
    pub(crate) fn of_model(&self, input: &Path) -> Result<Codec> {
        exact::refuse(input, &[("--max-error", self.max_error.is_some())])?;
        Ok(self.codec)
    }

    /// Option names, and whether they were given: for outputs without segments.
    pub(crate) fn given(&self) -> [(&'static str, bool); 2] {
        [("--codec", self.codec != Codec::Plain), ("--max-error", self.max_error.is_some())]
    }
}

/// Returns lossless packing with a codec.
pub(crate) fn packing(codec: Codec) -> store::Packing {
    match codec {
        Codec::Plain => store::Packing::default(),
        Codec::Packed | Codec::Reference => store::Packing::packed(),
    }
}
