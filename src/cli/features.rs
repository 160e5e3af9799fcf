//! Feature files as inputs of commands for trees: rasterized to a tree's cells for `edit`,
//! `combine` and `find`, or reprojected for `transform`.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail, ensure};
use spinney::import::feature::{
    FeatureFilter, FeatureOptions, FeatureValue, RasterizeOptions, plan_features,
};
use spinney::query::EdgeRule;
use spinney::raw::import::feature::{ReprojectOptions, SystemChange, is_feature_file, reproject_features};
use spinney::raw::import::rasterize::Overlaps;
use spinney::raw::ops::{MadeOperand, Outcome, ViewSource, combine_with};
use spinney::{
    CombineOperation, CombineOptions, Coordinates, Header, Metadata, Number, Output, Progress, Rule,
    ViewOperation, WriteOptions,
};

use super::Global;
use super::args::{OutputLimit, vector_format_of};
use super::report::{Work, report_output};

/// Options that select features, and the rule for their cells.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct FeatureCells {
    /// Cells at the edge of a polygon: centre (those whose centre is inside), touch (all that the
    /// polygon touches) or area (by the largest share) [default: centre]
    #[arg(long, value_name = "RULE")]
    edge: Option<EdgeRule>,
    /// Only features for which all conditions hold, as in 'type=Building,height>=10': an
    /// attribute, one of =, !=, <, <=, > and >=, and a value
    #[arg(long = "where", value_name = "CONDITION,...")]
    filter: Option<FeatureFilter>,
}

/// The value that features give their cells.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct FeatureValues {
    /// Value that features give their cells: a number, or an attribute, whose strings are names of
    /// the tree's classes [default: 1; 255 where cells have coverage]
    #[arg(long, value_name = "NUMBER|ATTRIBUTE", allow_hyphen_values = true)]
    value: Option<FeatureValue>,
    /// Value of cells where features overlap: last, first, min, max, sum, count or mean [default:
    /// last]
    #[arg(long, value_name = "RULE")]
    overlaps: Option<Overlaps>,
}

impl FeatureCells {
    /// Fails if an option for features was given, where there are none.
    pub(crate) fn refuse(&self, reason: &str) -> Result<()> {
        let given = [("--edge", self.edge.is_some()), ("--where", self.filter.is_some())];
        refuse(&given, reason)
    }

    /// Rasterizes the features of files to a tree's cells. Returns them with the feature count.
    pub(crate) fn over(
        &self,
        files: &[PathBuf],
        (header, metadata): (&Header, &Metadata),
        how: &FeatureTerms,
        progress: &dyn Progress,
    ) -> spinney::Result<(ViewSource, u64)> {
        let mut options = RasterizeOptions::over(header, metadata, how.coordinates.clone())?;
        options.value = how.value.clone().unwrap_or_else(|| FeatureValue::Number(full(header)));
        (options.overlaps, options.edge) = (how.overlaps, self.edge.unwrap_or_default());
        options.features.filter = self.filter.clone().unwrap_or_default();
        options.memory = how.memory;
        let laid = plan_features(files, &options, progress)?.tree(progress)?;
        if how.warns_of_cells_outside && laid.beyond > 0 {
            let text = format!(
                "{} features extend beyond the cells of the trees; the parts outside are ignored",
                laid.beyond
            );
            progress.warn(&files[0], &text);
        }
        Ok((laid.tree, laid.features))
    }
}

/// Options for rasterizing features to a tree's cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct FeatureTerms {
    /// The value of their cells; by default the value for presence, see [`full`].
    pub(crate) value: Option<FeatureValue>,
    pub(crate) overlaps: Overlaps,
    /// Their coordinates; by default those of their file.
    pub(crate) coordinates: Option<Coordinates>,
    pub(crate) memory: u64,
    /// Whether to report features that extend beyond the tree.
    pub(crate) warns_of_cells_outside: bool,
}

/// Returns the number that marks a cell as present.
fn full(header: &Header) -> Number {
    if header.rule == Rule::Occupancy { 255u64.into() } else { 1u64.into() }
}

fn refuse(given: &[(&str, bool)], reason: &str) -> Result<()> {
    match given.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("{option}: {reason}"),
        None => Ok(()),
    }
}

/// Options for features that are combined with trees.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct FeatureOperands {
    #[command(flatten)]
    values: FeatureValues,
    #[command(flatten)]
    cells: FeatureCells,
}

/// Whether some files are features, and some are not.
pub(crate) fn are_mixed(files: &[PathBuf]) -> bool {
    files.iter().any(|file| is_feature_file(file)) && !files.iter().all(|file| is_feature_file(file))
}

impl FeatureOperands {
    /// Returns the filter. Fails if an option for cells was given, since there are no trees.
    pub(crate) fn filter_alone(&self) -> Result<FeatureFilter> {
        let given = [
            ("--value", self.values.value.is_some()),
            ("--overlaps", self.values.overlaps.is_some()),
            ("--edge", self.cells.edge.is_some()),
        ];
        refuse(&given, "works only with features that are combined with trees")?;
        Ok(self.cells.filter.clone().unwrap_or_default())
    }

    /// Fails if an option for features was given, where there are none.
    pub(crate) fn refuse(&self) -> Result<()> {
        let reason = "works only with features that are combined with trees";
        let given =
            [("--value", self.values.value.is_some()), ("--overlaps", self.values.overlaps.is_some())];
        refuse(&given, reason)?;
        self.cells.refuse(reason)
    }

    /// Combines trees with features, which are rasterized to the trees' cells. Returns also the
    /// feature count of each feature file.
    pub(crate) fn combine(
        &self,
        operation: CombineOperation,
        options: CombineOptions,
        files: &[PathBuf],
        output: Output,
        how: WriteOptions,
        work: &Work,
    ) -> Result<(Outcome, Vec<Option<u64>>)> {
        let is_feature: Vec<bool> = files.iter().map(|file| is_feature_file(file)).collect();
        let counts: Vec<Cell<u64>> = files.iter().map(|_| Cell::new(0)).collect();
        let terms = FeatureTerms {
            value: self.values.value.clone(),
            overlaps: self.values.overlaps.unwrap_or_default(),
            coordinates: None,
            memory: how.memory,
            warns_of_cells_outside: true,
        };
        let make = |number: usize, header: &Header, metadata: &Metadata| {
            let file = std::slice::from_ref(&files[number]);
            let (tree, features) = self.cells.over(file, (header, metadata), &terms, work)?;
            counts[number].set(features);
            Ok(tree)
        };
        let features: Vec<usize> = (0..files.len()).filter(|number| is_feature[*number]).collect();
        let makers: Vec<_> = features
            .iter()
            .map(|number| move |header: &Header, metadata: &Metadata| make(*number, header, metadata))
            .collect();
        let made: Vec<MadeOperand<'_>> = features
            .iter()
            .zip(&makers)
            .map(|(number, make)| MadeOperand {
                place: *number,
                name: files[*number].display().to_string(),
                make,
            })
            .collect();
        let trees: Vec<PathBuf> = files.iter().filter(|file| !is_feature_file(file)).cloned().collect();
        let outcome = combine_with(operation, options, &trees, &made, output.into(), how, work)?;
        let counts = counts.iter().zip(is_feature).map(|(count, is)| is.then(|| count.get())).collect();
        Ok((outcome, counts))
    }
}

/// Parses the value that `edit fill` gives cells of features: numbers, or an attribute.
pub(crate) fn feature_value(value_strings: &[String]) -> Result<FeatureValue> {
    let numbers: Result<Vec<Number>, _> =
        value_strings.iter().map(|text| text.trim().parse::<Number>()).collect();
    match (numbers, value_strings) {
        (Ok(numbers), [_]) => Ok(FeatureValue::Number(numbers[0])),
        (Ok(numbers), _) => Ok(FeatureValue::Samples(numbers)),
        (Err(_), [name]) => Ok(FeatureValue::Attribute(name.clone())),
        (Err(error), _) => bail!("--value: {error}"),
    }
}

/// Fails unless a file is a feature file.
pub(crate) fn check_features(file: &Path, option: &str) -> Result<()> {
    ensure!(
        is_feature_file(file),
        "{option}: {} is not a feature file (GeoJSON, FlatGeobuf, GeoPackage, shapefile, CSV)",
        file.display()
    );
    Ok(())
}

/// A feature file to be reprojected.
pub(crate) struct Reprojection<'a> {
    pub(crate) file: &'a Path,
    pub(crate) steps: &'a [ViewOperation],
    pub(crate) allow_ballpark: bool,
}

impl Reprojection<'_> {
    /// Writes the features, in the format of the output's name.
    pub(crate) fn write(&self, path: &Path, memory: u64, limit: &OutputLimit, global: &Global) -> Result<()> {
        let start = Instant::now();
        global.check_options(self.file, "a feature file", &["--allow-ballpark"])?;
        let steps = SystemChange::of_view(self.file, self.steps)?;
        let features = FeatureOptions { memory, ..FeatureOptions::default() };
        let options = ReprojectOptions { operations: steps, allow_ballpark: self.allow_ballpark, features };
        let format = vector_format_of(path)?;
        let output = limit.create(path, global)?;
        let work = Work::start(global, "features")?;
        let written = reproject_features(self.file, &options, output, format, &work)?;
        work.finish();
        global.report("features", written);
        report_output(global, path, start);
        Ok(())
    }
}
