//! Trees built of datasets: the same cells, with other properties if wanted.

use super::{Dataset, Tree};
use crate::ops::{TreeFile, View, ViewSource, build_again};
use crate::store::BuildOptions;
use spinney_base::io::Output;
use spinney_base::{Progress, Result};

impl Dataset {
    /// Options for a tree of the same properties: kind, rule, depth, and all that is told about the data.
    pub fn build_options(&self, memory: u64) -> BuildOptions {
        BuildOptions::like(self.header(), memory).metadata(self.metadata().clone())
    }

    /// Builds a tree of the same cells, those of a view as they are seen, in the format that the output's name asks for. With the
    /// rule of the dataset, what its file has stored is copied as it is; with another one coarser levels are made anew, of all
    /// cells. A greater depth gives room for more cells on the far sides.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::io::Output;
    /// use spinney::value::Rule;
    ///
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let path = folder.path().join("largest.goblin");
    /// let heights = spinney::open("fixtures/v1/elevation.goblin")?;
    /// let options = heights.build_options(64 << 20).rule(Rule::Max);
    /// heights.build(&options, Output::create(&path)?, &())?;
    /// assert_eq!(spinney::open(&path)?.header().rule, Rule::Max);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the file cannot be read, the depth is too small for the cells, the output cannot be written, there is no room for all of
    /// its nodes, or on interruption.
    pub fn build(&self, options: &BuildOptions, output: Output, progress: &dyn Progress) -> Result<()> {
        let file = match &self.tree {
            Tree::View(viewed) => {
                let view = viewed.view().clone().deepened(options.depth)?;
                return build_again(viewed.source(), &view, view.extent(), options, output, progress);
            }
            Tree::Goblin(file) => TreeFile::Goblin(file.clone()),
            Tree::Autumnal(file) => TreeFile::Autumnal(file.clone()),
        };
        let (source, extent) = (ViewSource::from(file.clone()), self.header().extent);
        if options.depth == self.depth() {
            return build_again(&source, &source, extent, options, output, progress);
        }
        let view = View::whole(file.into())?.deepened(options.depth)?;
        build_again(&source, &view, extent, options, output, progress)
    }
}
