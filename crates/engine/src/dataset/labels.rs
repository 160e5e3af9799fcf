//! Tables of labels of any dataset.

use super::{Dataset, Tree};
use crate::ops::{LabelRequest, LabelSummary, LabelVisitor, TreeFile, View, find_labels};
use spinney_base::{Progress, Result};

impl Dataset {
    /// Hands out the labels of a tree, each with size, box and neighbours, in order: the values that cells have, or components of cells of
    /// equal value, which are counted first.
    ///
    /// Goes through all cells block by block (twice, if components are counted), but not through those of nodes of one value, on all threads of the
    /// current pool. What is larger than `request.memory` is added up in temporary files.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::raw::query::LabelRequest;
    ///
    /// let map = spinney::open("fixtures/v1/classes.goblin")?;
    /// let mut request = LabelRequest::new();
    /// request.connect = Some("4".parse()?);
    /// let (mut largest, mut borders) = (0, 0);
    /// let found = map.labels(&request, &(), &mut |label| {
    ///     largest = largest.max(label.cells());
    ///     while let Some(neighbour) = label.next_neighbour()? {
    ///         borders += neighbour.faces;
    ///     }
    ///     Ok(())
    /// })?;
    /// assert_eq!(found.cells, map.statistics(None, &())?.cells);
    /// assert!(largest <= found.cells && borders > 0);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If values are to be labels and have several channels, cells of such trees have not so many neighbours, the tree is damaged, a temporary file
    /// fails, `each` does, or on interruption.
    pub fn labels(
        &self,
        request: &LabelRequest,
        progress: &dyn Progress,
        each: &mut LabelVisitor<'_>,
    ) -> Result<LabelSummary> {
        let view = match &self.tree {
            Tree::Goblin(file) => View::whole(TreeFile::Goblin(file.clone()).into())?,
            Tree::Autumnal(file) => View::whole(TreeFile::Autumnal(file.clone()).into())?,
            Tree::View(viewed) => viewed.view().clone(),
        };
        let summary = find_labels(&view, request, progress, each)?;
        self.check_unchanged()?;
        Ok(summary)
    }
}
