//! Input points, row by row.

mod chosen;
mod world;

use std::collections::BTreeMap;
use std::path::Path;

use crate::attribute::{POSITION_BYTES, RowLayout, position_of};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

pub use chosen::ChosenPoints;
pub use world::{GriddedPoints, WorldPoints};

/// Description of input points.
#[derive(Clone, Debug)]
pub struct PointSchema {
    /// Row layout.
    pub layout: RowLayout,
    /// Whether z is one of the axes that are divided.
    pub dimension: Dimension,
    /// Size of a grid unit in world units.
    pub scale: [f64; 3],
    /// World coordinates of the grid's origin.
    pub offset: [f64; 3],
    /// Minimum and maximum position on the grid. Points outside are an error.
    pub bounds: [[i32; 3]; 2],
    /// Number of points, if known.
    pub count: Option<u64>,
    /// Coordinate system, if known.
    pub crs: Option<Crs>,
    /// Other information about the points.
    pub tags: BTreeMap<String, String>,
    /// Remarks on contents of the file that are not kept.
    pub losses: Vec<String>,
}

impl PointSchema {
    /// Creates a schema of rows on a grid with scale 1 and offset 0; nothing else is known.
    pub fn new(layout: RowLayout, dimension: Dimension) -> PointSchema {
        let (scale, offset, bounds) = ([1.0; 3], [0.0; 3], [[0; 3]; 2]);
        PointSchema {
            layout,
            dimension,
            scale,
            offset,
            bounds,
            count: None,
            crs: None,
            tags: BTreeMap::new(),
            losses: Vec::new(),
        }
    }
}

/// Subset of the points that can be read independently, such as a file, as known before reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointSubset {
    /// Number of points read; conditions may exclude some.
    pub count: u64,
    /// Minimum and maximum position on the grid.
    pub bounds: [[i32; 3]; 2],
}

/// Source of points, in any order.
pub trait PointSource {
    /// Returns the description of the points.
    fn schema(&self) -> &PointSchema;

    /// Returns the source file, for messages.
    fn path(&self) -> &Path {
        Path::new("(memory)")
    }

    /// Appends at most `most` rows, and returns their number; 0 after the last.
    ///
    /// # Errors
    /// If they cannot be read, or violate the rules of their format.
    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize>;

    /// Returns the subsets of the points, in reading order; empty if they are not known before
    /// reading.
    fn subsets(&self) -> &[PointSubset] {
        &[]
    }

    /// Returns the points of one subset, as rows of the same schema.
    ///
    /// # Errors
    /// If it cannot be read, or there are no subsets.
    fn subset(&self, _number: usize) -> Result<Box<dyn PointSource>> {
        Err(Error::unsupported(self.path(), "reading a subset of these points", "read all points"))
    }

    /// Restarts, with bounds found by reading all points, since those of headers are sometimes
    /// wrong. Returns `false` if not supported.
    ///
    /// # Errors
    /// Those of [`PointSource::read`].
    fn survey(&mut self) -> Result<bool> {
        Ok(false)
    }
}

/// Points in memory.
#[derive(Clone, Debug)]
pub struct PointRows {
    schema: PointSchema,
    rows: Vec<u8>,
    at: usize,
}

impl PointRows {
    /// Takes rows in the layout of the schema. The bounds and the count in the schema are replaced
    /// by those of the rows.
    ///
    /// # Errors
    /// If the length is not a multiple of the row size.
    ///
    /// ```
    /// use spinney_points::{PointRows, PointSchema, RowLayout};
    /// use spinney_base::space::Dimension;
    ///
    /// let rows: Vec<u8> = [[1i32, 2, 3], [4, 5, 6]].as_flattened().iter().flat_map(|number| number.to_le_bytes()).collect();
    /// let points = PointRows::new(PointSchema::new(RowLayout::packed(vec![]), Dimension::Oct), rows)?;
    /// # Ok::<(), spinney_base::Error>(())
    /// ```
    pub fn new(mut schema: PointSchema, rows: Vec<u8>) -> Result<PointRows> {
        let size = schema.layout.size;
        if size < POSITION_BYTES || !rows.len().is_multiple_of(size) {
            let found = format!("{} bytes", rows.len());
            return Err(Error::invalid(
                "rows of points",
                found,
                format!("a multiple of the row size ({size} bytes), which is at least {POSITION_BYTES}"),
            ));
        }
        schema.bounds = bounds_of(&rows, size).unwrap_or([[0; 3]; 2]);
        schema.count = Some((rows.len() / size) as u64);
        Ok(PointRows { schema, rows, at: 0 })
    }
}

/// Returns the union of two bounds, each of which may be empty.
pub(crate) fn both_bounds(a: Option<[[i32; 3]; 2]>, b: Option<[[i32; 3]; 2]>) -> Option<[[i32; 3]; 2]> {
    let (Some([low, high]), Some([lower, higher])) = (a, b) else { return a.or(b) };
    Some([
        std::array::from_fn(|axis| low[axis].min(lower[axis])),
        std::array::from_fn(|axis| high[axis].max(higher[axis])),
    ])
}

/// Returns the minimum and maximum position of rows of `size` bytes; `None` if there are none.
pub(crate) fn bounds_of(rows: &[u8], size: usize) -> Option<[[i32; 3]; 2]> {
    let mut bounds: Option<[[i32; 3]; 2]> = None;
    for row in rows.chunks_exact(size) {
        let position = position_of(row);
        let [least, most] = bounds.get_or_insert([position; 2]);
        for axis in 0..3 {
            least[axis] = least[axis].min(position[axis]);
            most[axis] = most[axis].max(position[axis]);
        }
    }
    bounds
}

impl PointSource for PointRows {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        let size = self.schema.layout.size;
        let rest = &self.rows[self.at..];
        let bytes = rest.len().min(most.saturating_mul(size));
        rows.extend_from_slice(&rest[..bytes]);
        self.at += bytes;
        Ok(bytes / size)
    }
}
