//! Packing of the trees that are written.

use anyhow::{Result, ensure};
use spinney::store::{Codec, Effort, WriteOptions};

use super::Memory;

/// Packing of the trees that are written.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Packing {
    /// Packing of the output's segments: plain ones are used where they are in the file, packed ones take few bytes and are unpacked
    /// when they are used; for .goblin files
    #[arg(long, value_name = "plain|packed", default_value = "plain")]
    codec: Codec,
    /// Effort of packing: fast, or small for fewer bytes in more time [default: fast]
    #[arg(long, value_name = "fast|small", value_parser = WriteOptions::effort_named)]
    effort: Option<Effort>,
}

impl Packing {
    /// Codec and effort.
    ///
    /// # Errors
    /// If there is nothing to make an effort at.
    pub(crate) fn choice(&self) -> Result<(Codec, Effort)> {
        let is_plain = self.codec == Codec::Plain;
        ensure!(!(is_plain && self.effort.is_some()), "--effort is for --codec packed");
        Ok((self.codec, self.effort.unwrap_or_default()))
    }

    /// The way in which a tree is written, with so much memory.
    ///
    /// # Errors
    /// Those of [`Packing::choice`].
    pub(crate) fn with(&self, memory: Memory) -> Result<WriteOptions> {
        let (codec, effort) = self.choice()?;
        Ok(WriteOptions::new(memory.bytes).packed(codec, effort))
    }

    /// The options that were given, for outputs that have no segments.
    pub(crate) fn given(&self) -> [(&'static str, bool); 2] {
        [("--codec", self.codec != Codec::Plain), ("--effort", self.effort.is_some())]
    }
}
