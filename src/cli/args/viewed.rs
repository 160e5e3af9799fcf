//! Files as they are, or views of them.

use std::path::PathBuf;

use clap::Args;
use spinney::dataset::Dataset;
use spinney::ops::{Step, WarpTarget};

use super::super::open;
use super::parse_crs;

/// A tree file, and the steps that it is seen through.
#[derive(Args, Clone, Debug)]
pub(crate) struct ViewedTree {
    /// Tree file
    pub(crate) file: PathBuf,
    /// See the file through a step of `transform`, such as rotate=30; may be given several times. Nothing is
    /// made beforehand
    #[arg(long = "view", value_name = "STEP", value_parser = parse_step)]
    steps: Vec<Step>,
}

impl ViewedTree {
    /// Whether there are steps.
    pub(crate) fn is_viewed(&self) -> bool {
        !self.steps.is_empty()
    }

    /// The steps as text: another one for other steps.
    pub(crate) fn steps_text(&self) -> String {
        if self.steps.is_empty() { String::new() } else { format!(", view {:?}", self.steps) }
    }

    /// Opens the file, once, with or without steps.
    pub(crate) fn open(&self) -> anyhow::Result<Dataset> {
        let tree = open(&self.file)?;
        // (A file as it is answers faster than a view of it.)
        if self.steps.is_empty() { Ok(tree) } else { Ok(tree.view(&self.steps)?) }
    }
}

/// Reads a step; a coordinate system may stand in a file.
pub(crate) fn parse_step(text: &str) -> Result<Step, String> {
    if let Some(definition) = text.strip_prefix("crs=") {
        return parse_crs(definition).map(Step::Crs);
    }
    if let Some(target) = text.strip_prefix("warp=") {
        let (definition, cell, resampling) = WarpTarget::split(target).map_err(|error| error.to_string())?;
        return parse_crs(definition).map(|crs| Step::Warp(WarpTarget { crs, cell, resampling }));
    }
    text.parse().map_err(|error: spinney::Error| error.to_string())
}
