//! Packing of the trees that are written.

use std::path::Path;

use anyhow::Result;
use spinney::raw::store;
use spinney::{Codec, WriteOptions};

use super::super::exact;
use super::Memory;

/// Packing of the trees that are written.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Packing {
    /// Packing of the output's segments, and of exact models' blocks and tables: plain ones are used where they are in the file, packed ones
    /// take few bytes and are unpacked when they are used; for .goblin files
    #[arg(long, value_name = "plain|packed", default_value = "plain")]
    codec: Codec,
    /// By how much samples of cells may differ from what they were: they are rounded to multiples of a power of two, which packed
    /// segments need few digits for; coarser levels and statistics are those of the rounded cells. Not for classes
    #[arg(long, value_name = "E")]
    max_error: Option<f64>,
}

impl Packing {
    /// Codec and maximum error.
    pub(crate) fn choice(&self) -> store::Packing {
        packing(self.codec).max_error(self.max_error)
    }

    /// Options for writing a tree with so much memory.
    pub(crate) fn with(&self, memory: Memory) -> WriteOptions {
        WriteOptions::new(memory.bytes).packing(self.choice())
    }

    /// The codec of an exact model. `input`, one of its sources, is for messages.
    ///
    /// # Errors
    /// If a maximum error is given: nothing in exact models is rounded.
    pub(crate) fn of_model(&self, input: &Path) -> Result<Codec> {
        exact::refuse(input, &[("--max-error", self.max_error.is_some())])?;
        Ok(self.codec)
    }

    /// The options that were given, for outputs that have no segments.
    pub(crate) fn given(&self) -> [(&'static str, bool); 2] {
        [("--codec", self.codec != Codec::Plain), ("--max-error", self.max_error.is_some())]
    }
}

/// Packing with a codec, where no sample is changed.
pub(crate) fn packing(codec: Codec) -> store::Packing {
    match codec {
        Codec::Plain => store::Packing::default(),
        Codec::Packed => store::Packing::packed(),
    }
}
