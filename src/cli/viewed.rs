//! Files as they are, or seen through steps.

use std::path::PathBuf;

use clap::Args;
use spinney::dataset::open_view;
use spinney::ops::{Chain, Step};
use spinney::dataset::Dataset;

use super::{Result, open};

/// A tree file, and how to look at it.
#[derive(Args, Clone, Debug)]
pub(crate) struct Viewed {
    /// Tree file
    pub(crate) file: PathBuf,
    /// Look at the file through a step of `transform`, such as rotate=30; may be given several times. Nothing is made
    /// beforehand
    #[arg(long = "view", value_name = "STEP", value_parser = step)]
    steps: Vec<Step>,
}

impl Viewed {
    pub(crate) fn open(&self) -> Result<Dataset> {
        if self.steps.is_empty() {
            return open(&self.file);
        }
        let chain = Chain { steps: self.steps.clone(), ..Chain::of(&self.file) };
        Ok(open_view(&chain)?)
    }
}

/// A step as it is written.
pub(crate) fn step(text: &str) -> Result<Step, String> {
    text.parse().map_err(|error: spinney::Error| error.to_string())
}
