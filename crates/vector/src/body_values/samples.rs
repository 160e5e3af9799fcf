//! Reads samples: points in space, and intervals of vertical holes.

use std::path::{Path, PathBuf};

use crate::import::feature::{Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, open_features};
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_points::PointIndex;

/// Names of the attributes with a height, and with the depths of an interval's ends, in any case.
const HEIGHT: &str = "z";
const FROM: &str = "from";
const TO: &str = "to";

/// Samples in space.
#[derive(Clone, Debug, Default)]
pub struct BodySamples {
    /// File that they are from.
    pub path: PathBuf,
    /// Their positions.
    pub positions: Vec<[f64; 3]>,
    /// Their values.
    pub values: Vec<f64>,
    /// Whether they are intervals of vertical holes, at their middles.
    pub are_intervals: bool,
    /// Number of features that were left out because they have no number as their value.
    pub without_value: u64,
    /// Number of features that were left out because they have no position or depths.
    pub without_position: u64,
    /// Coordinate system, if known.
    pub crs: Option<Crs>,
}

impl BodySamples {
    /// Bytes of memory for each sample, including its entry in an index.
    const BYTES: u64 = size_of::<[f64; 4]>() as u64 + PointIndex::BYTES;

    /// Fails if the samples take more memory than a limit in bytes.
    pub(super) fn check_memory(&self, limit: u64) -> Result<()> {
        let needed = self.positions.len() as u64 * Self::BYTES;
        if needed <= limit && u32::try_from(self.positions.len()).is_ok() {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: self.path.clone(),
            what: "a list of samples".into(),
            needed,
            limit,
            advice: "allow more with --memory, or leave out samples with --where".into(),
        })
    }
}

/// Attributes of a sample, by their numbers.
struct Columns {
    value: usize,
    height: Option<usize>,
    interval: Option<[usize; 2]>,
}

/// Reads samples from point features. The value is that of an attribute. The third coordinate is
/// the height of the geometry, or else the attribute `z`.
///
/// If there are attributes `from` and `to`, the position is the mouth of a vertical hole, and the
/// sample is at the middle of the interval between these depths. At most `memory` bytes are used.
///
/// # Errors
/// Those of [`open_features`]; if the attribute does not exist, a feature is not a point, an
/// interval ends above its start, there is no sample, or the memory is exceeded.
pub fn read_samples(path: &Path, value: &str, options: &FeatureOptions, memory: u64) -> Result<BodySamples> {
    let mut reader = open_features(path, options)?;
    let columns = Columns::of(&reader.schema().attributes, path, value)?;
    let mut found = BodySamples {
        path: path.to_path_buf(),
        crs: reader.schema().crs.clone(),
        are_intervals: columns.interval.is_some(),
        ..BodySamples::default()
    };
    let mut number = 0u64;
    while let Some(feature) = reader.next()? {
        number += 1;
        found.push(&feature, &columns, number)?;
        if number.is_multiple_of(1 << 12) {
            found.check_memory(memory)?;
        }
    }
    found.check_memory(memory)?;
    if found.positions.is_empty() {
        let text = format!(
            "none in {} features: {} have no number in `{value}`, {} no position in space",
            number, found.without_value, found.without_position
        );
        let expected =
            "points with a third coordinate, as heights of geometries or an attribute z, and a value";
        return Err(Error::invalid(format!("{}: samples", path.display()), text, expected));
    }
    Ok(found)
}

impl Columns {
    fn of<T>(attributes: &[(String, T)], path: &Path, value: &str) -> Result<Columns> {
        let names = || attributes.iter().map(|(name, _)| name.as_str());
        let named = |wanted: &str| names().position(|name| name.eq_ignore_ascii_case(wanted));
        let Some(own) = names().position(|name| name == value) else {
            let known: Vec<&str> = names().take(20).collect();
            let expected = format!("an attribute of {}: {}", path.display(), known.join(", "));
            return Err(Error::invalid("value", format!("`{value}`"), expected));
        };
        let interval = match (named(FROM), named(TO)) {
            (Some(from), Some(to)) => Some([from, to]),
            (None, None) => None,
            (from, _) => {
                let [there, missing] = if from.is_some() { [FROM, TO] } else { [TO, FROM] };
                let found = format!("an attribute `{there}` without `{missing}`");
                let expected = "both, the depths of intervals, or neither";
                return Err(Error::invalid(format!("{}: intervals", path.display()), found, expected));
            }
        };
        Ok(Columns { value: own, height: named(HEIGHT), interval })
    }
}

/// Converts a value to a number, if it is finite.
fn number(feature: &Feature, column: usize) -> Option<f64> {
    match feature.attributes.get(column)? {
        FeatureAttribute::Integer(number) => Some(*number as f64),
        FeatureAttribute::Number(number) => Some(*number).filter(|number| number.is_finite()),
        _ => None,
    }
}

impl BodySamples {
    fn push(&mut self, feature: &Feature, columns: &Columns, count: u64) -> Result<()> {
        let points = match &feature.geometry {
            None => &[][..],
            Some(FeatureGeometry::Points(points)) => &points[..],
            Some(_) => {
                let advice = "samples are points: the mouths of holes with depths `from` and `to`, or positions in space";
                return Err(Error::unsupported(&self.path, "a feature that is not a point", advice));
            }
        };
        let Some(value) = number(feature, columns.value) else {
            self.without_value += 1;
            return Ok(());
        };
        let depth = match columns.interval.map(|ends| ends.map(|column| number(feature, column))) {
            None => Some(0.0),
            Some([Some(from), Some(to)]) if from > to => {
                let (place, found) = (format!("feature {count}"), format!("an interval from {from} to {to}"));
                return Err(Error::corrupt(&self.path, place, found, "depths that increase downwards"));
            }
            // (Halved first: the sum may overflow.)
            Some([Some(from), Some(to)]) => Some(from / 2.0 + to / 2.0),
            Some(_) => None,
        };
        let heights = &feature.heights.of_points;
        let height = columns.height.and_then(|column| number(feature, column));
        let height = |index: usize| if heights.len() == points.len() { Some(heights[index]) } else { height };
        let before = self.positions.len();
        for (index, [x, y]) in points.iter().enumerate() {
            let z = height(index).zip(depth).map(|(height, depth)| height - depth);
            if let Some(z) = z.filter(|z| z.is_finite() && x.is_finite() && y.is_finite()) {
                self.positions.push([*x, *y, z]);
                self.values.push(value);
            }
        }
        self.without_position += u64::from(self.positions.len() == before);
        Ok(())
    }
}
