//! Names of operations on several trees.

use spinney::CombineOperation;
use spinney::raw::ops::Prefer;

/// The name of an operation, as on the command line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OperationName(pub(crate) String);

impl OperationName {
    /// Whether the operation makes a table, not a tree.
    pub(crate) fn is_table(&self) -> bool {
        self.0 == "cross"
    }

    /// Whether the operation is for polygons only.
    pub(crate) fn is_partition(&self) -> bool {
        self.0 == "partition"
    }

    /// Returns the operation of that name; `None` if it makes no tree.
    pub(crate) fn operation(&self, prefer: Prefer) -> Option<CombineOperation> {
        CombineOperation::named(&self.0, prefer)
    }
}

/// Parses the name of an operation.
pub(crate) fn parse_operation(text: &str) -> Result<OperationName, String> {
    let name = OperationName(text.into());
    let is_known = name.is_table() || name.is_partition() || name.operation(Prefer::First).is_some();
    is_known.then_some(name).ok_or_else(|| "unknown operation; `spinney help combine` lists them".into())
}
