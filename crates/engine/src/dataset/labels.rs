//! Label tables of a dataset.

use super::{Dataset, Tree};
use crate::ops::{LabelRequest, LabelSummary, LabelVisitor, TreeFile, View, find_labels};
use spinney_base::{Progress, Result};

impl Dataset {
    /// Passes the labels of a tree to `each`, in order, each with its size, box and neighbours.
    /// Labels are cell values, or connected components of cells of equal value, which are numbered
    /// first.
    ///
    /// Scans all cells block by block (twice if components are numbered), but not below uniform
    /// nodes. Uses all threads of the current pool. What exceeds `request.memory` is summed up in
    /// temporary files.
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
    /// If values are to be labels but have several channels, the requested connectivity does not
    /// exist for the tree's dimension, the tree is corrupt, a temporary file fails, `each` fails,
    /// or on cancellation.
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
