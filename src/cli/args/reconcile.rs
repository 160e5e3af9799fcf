//! Options for reconciling other files with the first one.

use spinney::raw::ops::{ClassMatching, OutputExtent, ReconcileOptions};

/// Options for matching classes and units.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct MeaningArgs {
    /// Classes of several files: match them by name (by colour where they have no names) or by
    /// number [default: name]
    #[arg(long, value_name = "HOW")]
    classes: Option<ClassMatching>,
    /// Numbers of several files: convert (by scale, offset and unit) or number (as stored)
    /// [default: convert]
    #[arg(long, value_name = "HOW", value_parser = ["convert", "number"])]
    units: Option<String>,
}

impl MeaningArgs {
    /// Returns reconcile options with an extent.
    pub(crate) fn options(&self, extent: Option<OutputExtent>, round: bool) -> ReconcileOptions {
        ReconcileOptions {
            extent: extent.unwrap_or_default(),
            classes: self.classes.unwrap_or_default(),
            units_by_number: self.units.as_deref() == Some("number"),
            round,
        }
    }

    /// Option names, and whether they were given.
    pub(crate) fn given(&self) -> [(&'static str, bool); 2] {
        [("--classes", self.classes.is_some()), ("--units", self.units.is_some())]
    }
}

/// The result's extent, and the options for matching classes and units.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct ReconcileArgs {
    /// Extent of the result, on the first file's cells: of the first (a), of the others (b), of all
    /// (union) or common to all (intersection) [default: union]
    #[arg(long, value_name = "EXTENT")]
    extent: Option<OutputExtent>,
    #[command(flatten)]
    meaning: MeaningArgs,
}

impl ReconcileArgs {
    /// Returns the library's options.
    pub(crate) fn options(&self) -> ReconcileOptions {
        self.meaning.options(self.extent, false)
    }

    /// Option names, and whether they were given.
    pub(crate) fn given(&self) -> [(&'static str, bool); 3] {
        let [classes, units] = self.meaning.given();
        [("--extent", self.extent.is_some()), classes, units]
    }
}
