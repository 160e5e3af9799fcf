//! Building trees of lines, for `spinney build`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use spinney::lines::{LineBuildOptions, build};
use spinney::raw::lines::LineSource;
use spinney::{Metadata, Output, Progress};

use super::super::report::warn;

/// Lines that are open and checked, ready to be built.
pub(crate) struct LineImport {
    input: PathBuf,
    source: Box<dyn LineSource>,
    metadata: Metadata,
    options: LineBuildOptions,
    description: Vec<(&'static str, String)>,
}

impl LineImport {
    /// Plans the tree of the lines of a file.
    pub(crate) fn plan(input: &Path, source: Box<dyn LineSource>, options: LineBuildOptions) -> LineImport {
        let schema = source.schema();
        let mut metadata = Metadata::default();
        metadata.frame.crs = schema.crs.clone();
        metadata.provenance = vec![input.display().to_string()];
        let names: Vec<&str> = schema.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        let mut description = vec![("axes", schema.dimension.axes().to_string())];
        if !names.is_empty() {
            description.push(("attributes", names.join(", ")));
        }
        LineImport { input: input.to_path_buf(), source, metadata, options, description }
    }

    /// Returns lines about the input, each with its heading.
    pub(crate) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Builds the tree. Returns lines about it.
    pub(crate) fn build(
        mut self,
        output: Output,
        progress: &dyn Progress,
    ) -> Result<Vec<(&'static str, String)>> {
        let built = build(&mut *self.source, &self.options, &self.metadata, output, progress)?;
        for remark in self.source.remarks() {
            warn(&format!("{}: {remark}", self.input.display()));
        }
        let text =
            format!("{} features, {} segments, length {}", built.features, built.segments, built.length);
        Ok(vec![("lines", text)])
    }
}
