//! Packing of the trees that are written.

use std::path::Path;

use anyhow::{Result, ensure};
use spinney::raw::store::{self, Effort};
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
    /// Effort of packing: fast, or small for fewer bytes in more time, but for exact models, where both are one [default: fast]
    #[arg(long, value_name = "fast|small", value_parser = store::Packing::effort_named)]
    effort: Option<Effort>,
    /// By how much samples of cells may differ from what they were: they are rounded to multiples of a power of two, which packed
    /// segments need few digits for; coarser levels and statistics are those of the rounded cells. Not for classes
    #[arg(long, value_name = "E")]
    max_error: Option<f64>,
}

impl Packing {
    /// Codec, effort, and greatest error.
    ///
    /// # Errors
    /// If there is nothing to make an effort at.
    pub(crate) fn choice(&self) -> Result<store::Packing> {
        let is_plain = self.codec == Codec::Plain;
        ensure!(!(is_plain && self.effort.is_some()), "--effort is for --codec packed");
        let packing = match self.codec {
            Codec::Plain => store::Packing::default(),
            Codec::Packed => store::Packing::packed(self.effort.unwrap_or_default()),
        };
        Ok(packing.max_error(self.max_error))
    }

    /// The way in which a tree is written, with so much memory.
    ///
    /// # Errors
    /// Those of [`Packing::choice`].
    pub(crate) fn with(&self, memory: Memory) -> Result<WriteOptions> {
        Ok(WriteOptions::new(memory.bytes).packing(self.choice()?))
    }

    /// The codec of an exact model, in which nothing is rounded and there is one effort; one of the models that it is made of is told.
    ///
    /// # Errors
    /// Those of [`Packing::choice`], and if something is to be rounded.
    pub(crate) fn of_model(&self, input: &Path) -> Result<Codec> {
        let store::Packing { codec, max_error, .. } = self.choice()?;
        exact::refuse(input, &[("--max-error", max_error.is_some())])?;
        Ok(codec)
    }

    /// The options that were given, for outputs that have no segments.
    pub(crate) fn given(&self) -> [(&'static str, bool); 3] {
        [
            ("--codec", self.codec != Codec::Plain),
            ("--effort", self.effort.is_some()),
            ("--max-error", self.max_error.is_some()),
        ]
    }
}
