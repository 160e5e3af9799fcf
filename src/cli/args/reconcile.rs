//! How a second file is brought to the first.

use spinney::raw::ops::{ClassMatching, OutputExtent, ReconcileOptions};

/// Matching of what values mean.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct MeaningArgs {
    /// Classes of several files are matched by name (by colour where they have no names), or by number [default: name]
    #[arg(long, value_name = "HOW")]
    classes: Option<ClassMatching>,
    /// Numbers of several files are converted by scale, offset and unit, or taken as they are stored: convert or number
    /// [default: convert]
    #[arg(long, value_name = "HOW", value_parser = ["convert", "number"])]
    units: Option<String>,
}

impl MeaningArgs {
    /// Options with the first file's extent as it is said here.
    pub(crate) fn options(&self, extent: Option<OutputExtent>, round: bool) -> ReconcileOptions {
        ReconcileOptions {
            extent: extent.unwrap_or_default(),
            classes: self.classes.unwrap_or_default(),
            units_by_number: self.units.as_deref() == Some("number"),
            round,
        }
    }

    /// Options by name, and whether they are given.
    pub(crate) fn given(&self) -> [(&'static str, bool); 2] {
        [("--classes", self.classes.is_some()), ("--units", self.units.is_some())]
    }
}

/// Part of the world that a result covers, and matching of what values mean.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct ReconcileArgs {
    /// Part of the world that the result covers, on the first file's cells: that of the first (a), of the others (b), of all (union) or
    /// what all share (intersection) [default: union]
    #[arg(long, value_name = "PART")]
    extent: Option<OutputExtent>,
    #[command(flatten)]
    meaning: MeaningArgs,
}

impl ReconcileArgs {
    /// The options of the library.
    pub(crate) fn options(&self) -> ReconcileOptions {
        self.meaning.options(self.extent, false)
    }

    /// Options by name, and whether they are given.
    pub(crate) fn given(&self) -> [(&'static str, bool); 3] {
        let [classes, units] = self.meaning.given();
        [("--extent", self.extent.is_some()), classes, units]
    }
}
