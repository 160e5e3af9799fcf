//! Points as they come in, row by row.

mod chosen;
mod world;

use std::collections::BTreeMap;
use std::path::Path;

use crate::attribute::{POSITION_BYTES, RowLayout, place_of};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

pub use chosen::ChosenPoints;
pub use world::{GriddedPoints, WorldPoints};

/// Description of points that come in.
#[derive(Clone, Debug)]
pub struct PointSchema {
    /// The layout of rows.
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
    /// Remarks on what their file says and is not kept.
    pub losses: Vec<String>,
}

impl PointSchema {
    /// A schema of rows on a grid whose steps are units of the world, of which nothing else is known.
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

/// A part of the points that can be read by itself, such as a file, as far as it is known before that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointPart {
    /// Number of the points that are looked at: conditions may leave some out.
    pub count: u64,
    /// Least and greatest place on the grid.
    pub bounds: [[i32; 3]; 2],
}

/// Points that come in, in any order.
pub trait PointSource {
    /// Description of the points.
    fn schema(&self) -> &PointSchema;

    /// The file that they come from, for messages.
    fn path(&self) -> &Path {
        Path::new("(memory)")
    }

    /// Appends rows, at most so many; none behind the last.
    ///
    /// # Errors
    /// If they cannot be read, or break the rules of their format.
    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize>;

    /// The parts that all points are in, which come in one after the other; none where that is not known before points are read.
    fn parts(&self) -> &[PointPart] {
        &[]
    }

    /// The points of one of the parts, as rows like those of all.
    ///
    /// # Errors
    /// If it cannot be read, or there are no parts.
    fn part(&self, _number: usize) -> Result<Box<dyn PointSource>> {
        Err(Error::unsupported(self.path(), "points that are not in parts", "read all of them"))
    }

    /// Begins anew, with bounds that were found by looking at all points: those of headers are wrong now and then. `false` if that cannot be done.
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
    /// Rows as the schema describes them. Bounds and number of points are those of the rows, whatever the schema says.
    ///
    /// # Errors
    /// If they are no whole rows.
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
                format!("rows of {size} bytes, of {POSITION_BYTES} or more"),
            ));
        }
        schema.bounds = bounds_of(&rows, size).unwrap_or([[0; 3]; 2]);
        schema.count = Some((rows.len() / size) as u64);
        Ok(PointRows { schema, rows, at: 0 })
    }
}

/// The places that two lots of points have, each of which may be none.
pub(crate) fn both_bounds(a: Option<[[i32; 3]; 2]>, b: Option<[[i32; 3]; 2]>) -> Option<[[i32; 3]; 2]> {
    let (Some([low, high]), Some([lower, higher])) = (a, b) else { return a.or(b) };
    Some([
        std::array::from_fn(|axis| low[axis].min(lower[axis])),
        std::array::from_fn(|axis| high[axis].max(higher[axis])),
    ])
}

/// Least and greatest place of rows of so many bytes; `None` if there are none.
pub(crate) fn bounds_of(rows: &[u8], size: usize) -> Option<[[i32; 3]; 2]> {
    let mut bounds: Option<[[i32; 3]; 2]> = None;
    for row in rows.chunks_exact(size) {
        let place = place_of(row);
        let [least, most] = bounds.get_or_insert([place; 2]);
        for axis in 0..3 {
            least[axis] = least[axis].min(place[axis]);
            most[axis] = most[axis].max(place[axis]);
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
