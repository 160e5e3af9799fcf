//! Points as they come in, row by row.

use std::collections::BTreeMap;

use crate::attribute::RowLayout;
use spinney_base::Result;
use spinney_base::space::Dimension;
use spinney_crs::Crs;

/// Description of points that come in.
#[derive(Clone, Debug)]
pub struct PointSchema {
    /// What stands in a row.
    pub layout: RowLayout,
    /// Whether z counts as one of the axes.
    pub dimension: Dimension,
    /// Units of the world that a step of the grid has.
    pub scale: [f64; 3],
    /// Place in the world of the grid's origin.
    pub offset: [f64; 3],
    /// Least and greatest place on the grid. Points beyond them are an error.
    pub bounds: [[i32; 3]; 2],
    /// Number of the points, where known.
    pub count: Option<u64>,
    /// The coordinate system, where known.
    pub crs: Option<Crs>,
    /// Anything else that is said of the points.
    pub tags: BTreeMap<String, String>,
}

/// Points that come in, in any order.
pub trait PointSource: Send {
    /// Description of the points.
    fn schema(&self) -> &PointSchema;

    /// Appends rows, at most so many; none behind the last.
    ///
    /// # Errors
    /// If they cannot be read, or break the rules of their format.
    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize>;
}
