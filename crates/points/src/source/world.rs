//! Points at arbitrary world positions, snapped to an integer grid.

use std::path::Path;

use super::{PointSchema, PointSource};
use crate::attribute::{PointAttribute, RowLayout};
use spinney_base::space::{CoordinateAxis, Dimension};
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Points with coordinates as doubles, which can be read more than once.
pub trait WorldPoints {
    /// Returns the attributes of the points. Their numbers are in the order of
    /// [`ordered_number`](crate::ordered_number).
    fn attributes(&self) -> &[PointAttribute];

    /// Returns whether z is one of the axes that are divided.
    fn dimension(&self) -> Dimension;

    /// Returns the coordinate system, if known.
    fn crs(&self) -> Option<&Crs>;

    /// Returns the source file, for messages.
    fn path(&self) -> &Path;

    /// Returns the coordinates of the next point, and writes its attributes into `numbers`; `None`
    /// after the last.
    ///
    /// # Errors
    /// If it cannot be read, or violates the rules of its format.
    fn next(&mut self, numbers: &mut [i64]) -> Result<Option<[f64; 3]>>;

    /// Restarts at the first point.
    ///
    /// # Errors
    /// If that fails.
    fn rewind(&mut self) -> Result<()>;
}

/// World points as rows on a grid. The scale is that of the coordinates' decimal places if they are
/// few, else that of their binary digits, else the finest that spans all points.
pub struct GriddedPoints {
    points: Box<dyn WorldPoints>,
    schema: PointSchema,
    is_rounded: bool,
    skipped: u64,
    numbers: Vec<i64>,
}

impl GriddedPoints {
    /// Reads all points once to find their grid. Points with a coordinate that is not finite are
    /// skipped and counted.
    ///
    /// # Errors
    /// If they cannot be read, or none of them has coordinates.
    pub fn new(mut points: Box<dyn WorldPoints>) -> Result<GriddedPoints> {
        let attributes = points.attributes().to_vec();
        let mut numbers = vec![0; attributes.len()];
        let mut axes = [CoordinateAxis::NONE; 3];
        let (mut count, mut skipped) = (0u64, 0u64);
        while let Some(position) = points.next(&mut numbers)? {
            if !is_finite(position) {
                skipped += 1;
                continue;
            }
            count += 1;
            axes.iter_mut().zip(position).for_each(|(axis, number)| axis.include(number));
        }
        if count == 0 && skipped > 0 {
            let found = format!("{skipped} points, all with empty or non-finite coordinates");
            return Err(Error::corrupt(points.path(), "points", found, "finite coordinates"));
        }
        points.rewind()?;
        let grids = axes.map(|axis| axis.grid());
        let mut schema = PointSchema::new(RowLayout::packed(attributes), points.dimension());
        schema.scale = grids.map(|grid| grid.scale);
        schema.offset = grids.map(|grid| grid.offset);
        let corner = |end: [f64; 3]| std::array::from_fn(|axis| step(&schema, axis, end[axis]));
        schema.bounds = match count {
            0 => [[0; 3]; 2],
            _ => [corner(axes.map(|axis| axis.least)), corner(axes.map(|axis| axis.most))],
        };
        schema.count = Some(count);
        schema.crs = points.crs().cloned();
        let is_rounded = grids.iter().any(|grid| !grid.is_exact);
        Ok(GriddedPoints { points, schema, is_rounded, skipped, numbers })
    }

    /// Returns the number of points skipped because a coordinate is empty, NaN or infinite.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Returns remarks on skipped points and on rounding.
    pub fn remarks(&self) -> Vec<String> {
        let skipped = (self.skipped > 0).then(|| {
            format!("{} points with an empty, NaN or infinite coordinate are skipped", self.skipped)
        });
        skipped.into_iter().chain(self.rounding().map(String::from)).collect()
    }

    /// Returns a remark if positions are rounded to the grid, by at most half a grid unit.
    pub fn rounding(&self) -> Option<&'static str> {
        self.is_rounded.then_some("coordinates have more digits than a 32-bit grid; they are rounded to it")
    }
}

fn is_finite(position: [f64; 3]) -> bool {
    position.iter().all(|number| number.is_finite())
}

fn step(schema: &PointSchema, axis: usize, number: f64) -> i32 {
    ((number - schema.offset[axis]) / schema.scale[axis]).round() as i32
}

impl PointSource for GriddedPoints {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        self.points.path()
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        let size = self.schema.layout.size;
        let mut count = 0;
        while count < most {
            let Some(position) = self.points.next(&mut self.numbers)? else { return Ok(count) };
            if !is_finite(position) {
                continue;
            }
            count += 1;
            let before = rows.len();
            rows.resize(before + size, 0);
            let row = &mut rows[before..];
            for axis in 0..3 {
                row[4 * axis..4 * axis + 4]
                    .copy_from_slice(&step(&self.schema, axis, position[axis]).to_le_bytes());
            }
            for (attribute, number) in self.numbers.iter().enumerate() {
                self.schema.layout.set_number(attribute, row, *number);
            }
        }
        Ok(most)
    }
}
