//! Building trees of lines, for `spinney build`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::import::feature::FeatureOptions;
use spinney::lines::{LineBuildOptions, build};
use spinney::raw::import::feature::{FeatureLines, is_feature_file, open_feature_lines};
use spinney::raw::lines::LineSource as _;
use spinney::{Metadata, Output, Progress};

use super::super::report::warn;

/// A feature file that is open and checked, ready to be built.
pub(crate) struct LineImport {
    input: PathBuf,
    source: FeatureLines,
    metadata: Metadata,
    options: LineBuildOptions,
    description: Vec<(&'static str, String)>,
}

impl LineImport {
    /// Opens the features of a file, and plans the tree.
    pub(crate) fn plan(
        inputs: &[PathBuf],
        features: &FeatureOptions,
        crs: Option<spinney::Crs>,
        options: LineBuildOptions,
    ) -> Result<LineImport> {
        let [input] = inputs else {
            bail!("--index: got {} inputs, expected one; build a tree of each", inputs.len())
        };
        if !is_feature_file(input) {
            bail!("--index: {} is not a feature file", input.display());
        }
        let source = open_feature_lines(input, features)?;
        if source.is_rounded() {
            warn(&format!(
                "{}: vertices have more digits than a 32-bit grid, and are rounded to it",
                input.display()
            ));
        }
        let schema = source.schema();
        let mut metadata = Metadata::default();
        metadata.frame.crs = crs.or(schema.crs.clone());
        metadata.provenance = vec![input.display().to_string()];
        let names: Vec<&str> = schema.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        let mut description = Vec::new();
        if !names.is_empty() {
            description.push(("attributes", names.join(", ")));
        }
        Ok(LineImport { input: input.clone(), source, metadata, options, description })
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
        let built = build(&mut self.source, &self.options, &self.metadata, output, progress)?;
        let count = self.source.with_heights();
        if count > 0 {
            let input = self.input.display();
            warn(&format!("{input}: {count} features have heights or measures, which are ignored"));
        }
        let text =
            format!("{} features, {} segments, length {}", built.features, built.segments, built.length);
        Ok(vec![("lines", text)])
    }
}
