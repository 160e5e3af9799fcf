//! Data of the source that a mesh format cannot store, reported in one warning.

use std::path::{Path, PathBuf};

use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_container::{Metadata, Tag};
use spinney_crs::Crs;
use spinney_engine::dataset::Dataset;

/// List of lost data of a file.
pub(super) struct Losses {
    path: PathBuf,
    lost: Vec<String>,
}

impl Losses {
    pub(super) fn of(output: &Output) -> Losses {
        Losses::in_file(output.path())
    }

    pub(super) fn in_file(path: &Path) -> Losses {
        Losses { path: path.to_path_buf(), lost: Vec::new() }
    }

    /// Adds `what` if it is lost.
    pub(super) fn add(&mut self, is_lost: bool, what: impl Into<String>) {
        if is_lost {
            self.lost.push(what.into());
        }
    }

    pub(super) fn add_crs(&mut self, crs: Option<&Crs>) {
        self.lost.extend(crs.map(|crs| format!("the coordinate system {crs}")));
    }

    /// Adds the unit of length, unless it is the one that the format implies.
    pub(super) fn add_unit(&mut self, unit: Option<&str>, taken: Option<&str>) {
        let lost = unit.filter(|unit| Some(*unit) != taken);
        self.lost.extend(lost.map(|unit| format!("the unit of length {unit}")));
    }

    /// Adds the values of a tree's cells, unless all are equal.
    ///
    /// # Errors
    /// If the tree is corrupt.
    pub(super) fn add_values(&mut self, tree: &Dataset, what: &str) -> Result<()> {
        let has_several = tree.value_bounds()?.iter().any(|(least, most)| least < most);
        self.add(has_several, what);
        Ok(())
    }

    /// Adds the coordinate system and the unit of a tree, which most formats do not store.
    pub(super) fn add_place(&mut self, metadata: &Metadata) {
        self.add_crs(metadata.frame.crs.as_ref());
        self.add_unit(metadata.tag(Tag::Unit), None);
    }

    /// Reports the losses, if any. To be called after the file is written.
    pub(super) fn report(self, progress: &dyn Progress) {
        if let Some((last, others)) = self.lost.split_last() {
            let others =
                if others.is_empty() { String::new() } else { format!("{} and ", others.join(", ")) };
            progress.warn(&self.path, &format!("the format cannot store {others}{last}"));
        }
    }
}
