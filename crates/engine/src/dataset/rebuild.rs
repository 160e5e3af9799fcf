//! Building a tree from a dataset: the same cells, optionally with other properties.

use super::{Dataset, Tree};
use crate::ops::{TreeFile, View, ViewSource, build_again};
use crate::store::{BuildOptions, TreeTarget};
use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::value::{DataKind, Rule};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Crs;

/// Properties of the new tree that replace those of the dataset it is built from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rebuild {
    /// Kind of the values. If it differs from the dataset's, the rule defaults to the kind's usual
    /// one.
    pub kind: Option<DataKind>,
    /// Rule for coarser levels, which are recomputed if it differs from the dataset's.
    pub rule: Option<Rule>,
    /// Levels of the tree.
    pub depth: Option<u8>,
    /// Map from cells to the world.
    #[serde(with = "spinney_base::text_fields")]
    pub matrix: Option<[[f64; 4]; 3]>,
    /// Coordinate system.
    pub crs: Option<Crs>,
}

impl Dataset {
    /// Returns the options for a tree with the dataset's properties, except for those in `other`.
    ///
    /// # Errors
    /// If the map to the world has no inverse, or the rule does not fit the kind.
    pub fn rebuild_options(&self, other: &Rebuild, memory: u64) -> Result<BuildOptions> {
        let mut options = self.build_options(memory);
        if let Some(kind) = other.kind
            && kind != options.kind
        {
            (options.kind, options.rule) = (kind, kind.default_rule());
        }
        if let Some(rule) = other.rule {
            options.kind.check_rule(rule, self.name())?;
            options.rule = rule;
        }
        options.depth = other.depth.unwrap_or(options.depth);
        let frame = &mut options.metadata.frame;
        frame.matrix = other.matrix.unwrap_or(frame.matrix);
        let is_finite = frame.matrix.iter().flatten().all(|number| number.is_finite());
        if !is_finite || frame.to_cells([0.0; 3]).is_none() {
            return Err(Error::invalid(
                "transform",
                "a map with no inverse",
                "an invertible map of finite numbers",
            ));
        }
        if let Some(crs) = &other.crs {
            frame.crs = Some(crs.clone());
        }
        Ok(options)
    }

    /// Returns the options for a tree with the dataset's properties: kind, rule, depth and
    /// metadata.
    pub fn build_options(&self, memory: u64) -> BuildOptions {
        BuildOptions::like(self.header(), memory).metadata(self.metadata().clone())
    }

    /// Builds a tree of the same cells (for a view, the cells as seen through it). The name of the
    /// output determines the format. With the dataset's rule, stored records are copied unchanged;
    /// with another one, coarser levels are recomputed from all cells. A larger depth extends the
    /// space at the far end of each axis.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::{Output, Rule};
    ///
    /// # let directory = tempfile::tempdir().unwrap();
    /// # let path = directory.path().join("largest.goblin");
    /// let heights = spinney::open("fixtures/v1/elevation.goblin")?;
    /// let options = heights.build_options(64 << 20).rule(Rule::Max);
    /// heights.build(&options, Output::create(&path)?, &())?;
    /// assert_eq!(spinney::open(&path)?.header().rule, Rule::Max);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the file cannot be read, the depth is too small for the cells, the output cannot be
    /// written, there is not enough space for all of its nodes, or on cancellation.
    pub fn build(&self, options: &BuildOptions, output: Output, progress: &dyn Progress) -> Result<()> {
        self.build_to(options, output.into(), progress)
    }

    /// Builds a tree, or one shard of it: see [`Dataset::build`].
    ///
    /// # Errors
    /// Those of [`Dataset::build`].
    pub fn build_to(
        &self,
        options: &BuildOptions,
        target: TreeTarget,
        progress: &dyn Progress,
    ) -> Result<()> {
        let file = match &self.tree {
            Tree::View(viewed) => {
                let view = viewed.view().clone().deepened(options.depth)?;
                return build_again(viewed.source(), &view, view.extent(), options, target, progress);
            }
            Tree::Goblin(file) => TreeFile::Goblin(file.clone()),
            Tree::Autumnal(file) => TreeFile::Autumnal(file.clone()),
        };
        let (source, extent) = (ViewSource::from(file.clone()), self.header().extent);
        if options.depth == self.depth() {
            return build_again(&source, &source, extent, options, target, progress);
        }
        let view = View::whole(file.into())?.deepened(options.depth)?;
        build_again(&source, &view, extent, options, target, progress)
    }
}
