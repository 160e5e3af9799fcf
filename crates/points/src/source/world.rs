//! Points at arbitrary world positions, snapped to an integer grid.

use std::path::Path;

use super::{PointSchema, PointSource};
use crate::attribute::{PointAttribute, RowLayout};
use spinney_base::space::Dimension;
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

/// Extremes and precision of the coordinates along an axis.
#[derive(Clone, Copy)]
struct Axis {
    least: f64,
    most: f64,
    /// Maximum number of decimal places; `None` if more than [`MAX_DIGITS`].
    digits: Option<i32>,
    /// Maximum number of binary fraction digits.
    bits: i32,
}

/// Maximum number of decimal places of a decimal grid.
const MAX_DIGITS: i32 = 9;
/// Maximum grid coordinate.
const MAX_STEPS: f64 = (1u64 << 31) as f64 - 1.0;

impl Axis {
    const NONE: Axis = Axis { least: f64::INFINITY, most: f64::NEG_INFINITY, digits: Some(0), bits: 0 };

    fn include(&mut self, number: f64) {
        self.least = self.least.min(number);
        self.most = self.most.max(number);
        while let Some(digits) = self.digits
            && !has_digits(number, digits)
        {
            self.digits = Some(digits + 1).filter(|digits| *digits <= MAX_DIGITS);
        }
        self.bits = self.bits.max(fraction_bits(number));
    }

    /// Returns scale and offset of a grid that contains all coordinates exactly, or else of the
    /// finest that spans them, and whether it is exact.
    fn grid(&self) -> (f64, f64, bool) {
        if self.least > self.most {
            return (1.0, 0.0, true);
        }
        // The offset is an integer, so that grid units stay aligned with the coordinates.
        let reach = self.least.abs().max(self.most.abs());
        let fits = |scale: f64| {
            let offset = if reach / scale <= MAX_STEPS { 0.0 } else { self.least.floor() };
            ((self.most - offset) / scale <= MAX_STEPS).then_some(offset)
        };
        let decimal = self.digits.map(|digits| 10f64.powi(-digits));
        let binary = (self.bits <= 40).then(|| 2f64.powi(-self.bits));
        for scale in [decimal, binary].into_iter().flatten() {
            if let Some(offset) = fits(scale) {
                return (scale, offset, true);
            }
        }
        let scale = (-40..=1023).map(|power| 2f64.powi(power)).find_map(|scale| Some((scale, fits(scale)?)));
        let (scale, offset) = scale.unwrap_or((f64::MAX, 0.0));
        (scale, offset, false)
    }
}

/// Returns whether a number has at most `digits` decimal places, within double precision.
fn has_digits(number: f64, digits: i32) -> bool {
    let steps = number * 10f64.powi(digits);
    (steps - steps.round()).abs() <= steps.abs() * 4.0 * f64::EPSILON
}

/// Returns the number of binary fraction digits of a number.
fn fraction_bits(number: f64) -> i32 {
    if number == 0.0 {
        return 0;
    }
    let bits = number.to_bits();
    let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, bits & ((1 << 52) - 1));
    let zeros = if fraction == 0 { 52 } else { fraction.trailing_zeros() as i32 };
    (1075 - exponent.max(1) - zeros).max(0)
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
        let mut axes = [Axis::NONE; 3];
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
        schema.scale = grids.map(|(scale, ..)| scale);
        schema.offset = grids.map(|(_, offset, _)| offset);
        let corner = |end: [f64; 3]| std::array::from_fn(|axis| step(&schema, axis, end[axis]));
        schema.bounds = match count {
            0 => [[0; 3]; 2],
            _ => [corner(axes.map(|axis| axis.least)), corner(axes.map(|axis| axis.most))],
        };
        schema.count = Some(count);
        schema.crs = points.crs().cloned();
        let is_rounded = grids.iter().any(|(.., has_all)| !has_all);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(numbers: &[f64]) -> (f64, f64, bool) {
        let mut axis = Axis::NONE;
        numbers.iter().for_each(|number| axis.include(*number));
        axis.grid()
    }

    #[test]
    fn grids_are_those_of_digits_or_bits() {
        assert_eq!(grid(&[]), (1.0, 0.0, true));
        assert_eq!(grid(&[500_000.123, 500_001.5, -3.0]), (0.001, 0.0, true));
        assert_eq!(grid(&[5_200_000.123_4, 5_200_001.5]), (0.000_1, 5_200_000.0, true));
        assert_eq!(grid(&[-179.123_456_7, 179.0]), (1e-7, 0.0, true));
        assert_eq!(grid(&[0.1f32.into(), 0.7f32.into()]), (2f64.powi(-27), 0.0, true));
        let (scale, _, has_all) = grid(&[std::f64::consts::PI, 1000.0]);
        assert!(!has_all && scale <= 1000.0 / 2f64.powi(30), "{scale}");
        let (scale, offset, _) = grid(&[-1e300, 1e300]);
        assert!(2e300 / scale <= 2f64.powi(32) && offset <= 0.0);
        assert_eq!(grid(&[7.0, 7.0]), (1.0, 0.0, true));
        assert_eq!(
            (fraction_bits(0.375), fraction_bits(-3.0), fraction_bits(f64::MIN_POSITIVE / 2.0)),
            (3, 0, 1023)
        );
    }
}
