//! Names of operations on several trees.

use spinney::CombineOperation;
use spinney::raw::ops::Prefer;

/// The name of an operation, as it was written.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OperationName(pub(crate) String);

impl OperationName {
    /// Whether it is the one that makes no tree, but a table.
    pub(crate) fn is_table(&self) -> bool {
        self.0 == "cross"
    }

    /// Whether it is the one that is for polygons alone.
    pub(crate) fn is_partition(&self) -> bool {
        self.0 == "partition"
    }

    /// The operation of that name; `None` if it makes no tree.
    pub(crate) fn operation(&self, prefer: Prefer) -> Option<CombineOperation> {
        CombineOperation::named(&self.0, prefer)
    }
}

/// Reads a name that means something.
pub(crate) fn parse_operation(text: &str) -> Result<OperationName, String> {
    let name = OperationName(text.into());
    let is_known = name.is_table() || name.is_partition() || name.operation(Prefer::First).is_some();
    is_known.then_some(name).ok_or_else(|| "no such operation; see the list in --help".into())
}
