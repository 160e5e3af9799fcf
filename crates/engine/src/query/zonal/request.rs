//! Questions about zones, and their answers.

use std::fmt;
use std::str::FromStr;

use spinney_base::space::EdgeRule;
use spinney_base::value::Number;
use spinney_base::{Error, Result};

/// A question about the cells in polygons.
///
/// ```
/// use spinney::query::{EdgeRule, Polygon, ZonalRequest};
///
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let triangle = Polygon::new(&[vec![[40.0, 40.0], [180.0, 60.0], [90.0, 170.0]]])?;
/// let request = ZonalRequest {
///     edge: EdgeRule::Area,
///     measures: vec!["majority".parse()?, "median".parse()?],
///     quantiles: vec![0.1, 0.9],
///     ..ZonalRequest::default()
/// };
/// let zones = map.zonal(&[triangle], &request, &())?;
/// let values = zones[0].channels[0].values.as_ref().unwrap();
/// assert!(values.variety > 1 && values.quantiles[0] <= values.median && values.median <= values.quantiles[1]);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ZonalRequest {
    /// Which cells at the edge of a polygon count.
    pub edge: EdgeRule,
    /// Measures that are asked for. All that are not [`ZoneMeasure::needs_values`] come whether they are or not.
    pub measures: Vec<ZoneMeasure>,
    /// Quantiles that are asked for, from 0 to 1.
    pub quantiles: Vec<f64>,
    /// Bytes of memory for the values of zones that are worked on at the same time; what does not fit goes to temporary files.
    pub memory: u64,
}

impl Default for ZonalRequest {
    fn default() -> ZonalRequest {
        ZonalRequest {
            edge: EdgeRule::Centre,
            measures: Vec::new(),
            quantiles: Vec::new(),
            memory: 256 << 20,
        }
    }
}

impl From<EdgeRule> for ZonalRequest {
    fn from(edge: EdgeRule) -> ZonalRequest {
        ZonalRequest { edge, ..ZonalRequest::default() }
    }
}

impl ZonalRequest {
    /// Whether single values have to be counted.
    pub fn needs_values(&self) -> bool {
        !self.quantiles.is_empty() || self.measures.iter().any(|measure| measure.needs_values())
    }

    /// Fails if a quantile is none.
    pub(super) fn check(&self) -> Result<()> {
        if self.quantiles.len() > MAX_QUANTILES {
            let found = format!("{} of them", self.quantiles.len());
            return Err(Error::invalid("quantiles", found, format!("at most {MAX_QUANTILES}")));
        }
        match self.quantiles.iter().find(|quantile| !(0.0..=1.0).contains(*quantile)) {
            Some(wrong) => Err(Error::invalid("quantile", wrong.to_string(), "a number from 0 to 1")),
            None => Ok(()),
        }
    }
}

/// Quantiles that are computed at once, at most.
const MAX_QUANTILES: usize = 1000;

/// A number that is told of a zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZoneMeasure {
    /// Cells that are not VOID.
    Count,
    /// Cells within the picture that are VOID.
    Void,
    /// The part of the cells within the picture that is VOID.
    VoidShare,
    /// The area outside of the picture, in cells.
    Outside,
    /// Sum of the samples.
    Sum,
    /// Least sample.
    Min,
    /// Greatest sample.
    Max,
    /// Mean of the samples.
    Mean,
    /// Standard deviation, that of the population.
    Deviation,
    /// The sample that most cells have; of several the least.
    Majority,
    /// The sample that the fewest cells have; of several the least.
    Minority,
    /// Number of different samples.
    Variety,
    /// The quantile 0.5.
    Median,
    /// Cells of each class, or their areas.
    Classes,
}

impl ZoneMeasure {
    /// All of them.
    pub const ALL: [ZoneMeasure; 14] = [
        ZoneMeasure::Count,
        ZoneMeasure::Void,
        ZoneMeasure::VoidShare,
        ZoneMeasure::Outside,
        ZoneMeasure::Sum,
        ZoneMeasure::Min,
        ZoneMeasure::Max,
        ZoneMeasure::Mean,
        ZoneMeasure::Deviation,
        ZoneMeasure::Majority,
        ZoneMeasure::Minority,
        ZoneMeasure::Variety,
        ZoneMeasure::Median,
        ZoneMeasure::Classes,
    ];

    /// Its name, as in `std`.
    pub fn name(self) -> &'static str {
        match self {
            ZoneMeasure::Count => "count",
            ZoneMeasure::Void => "void",
            ZoneMeasure::VoidShare => "void_share",
            ZoneMeasure::Outside => "outside",
            ZoneMeasure::Sum => "sum",
            ZoneMeasure::Min => "min",
            ZoneMeasure::Max => "max",
            ZoneMeasure::Mean => "mean",
            ZoneMeasure::Deviation => "std",
            ZoneMeasure::Majority => "majority",
            ZoneMeasure::Minority => "minority",
            ZoneMeasure::Variety => "variety",
            ZoneMeasure::Median => "median",
            ZoneMeasure::Classes => "classes",
        }
    }

    /// Whether it needs the cells of each sample to be counted, for which all cells of a zone are read unless the file counts classes.
    pub fn needs_values(self) -> bool {
        matches!(
            self,
            ZoneMeasure::Majority | ZoneMeasure::Minority | ZoneMeasure::Variety | ZoneMeasure::Median
        )
    }
}

impl fmt::Display for ZoneMeasure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ZoneMeasure {
    type Err = Error;

    fn from_str(name: &str) -> Result<ZoneMeasure> {
        let found = ZoneMeasure::ALL.iter().find(|measure| measure.name() == name);
        found.copied().ok_or_else(|| {
            let names: Vec<&str> = ZoneMeasure::ALL.iter().map(|measure| measure.name()).collect();
            Error::invalid("measure", name, names.join(", "))
        })
    }
}

/// Statistics of the cells in a polygon.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ZoneStatistics {
    /// Cells that are not VOID. (By [`EdgeRule::Area`] these, and all other numbers of cells, need not be whole.)
    pub cells: f64,
    /// Cells within the picture that are VOID.
    pub void_cells: f64,
    /// Area of the polygon outside of the picture, in cells, by whatever rule the others count.
    pub outside_cells: f64,
    /// Statistics of each channel; nothing if there are no cells.
    pub channels: Vec<ZoneChannel>,
    /// Cells of each value, by ascending value; only for one-channel files that count classes.
    pub classes: Vec<(Number, f64)>,
}

/// Statistics of one channel in a polygon; the standard deviation is that of the population.
#[derive(Clone, Debug, Default, PartialEq)]
#[allow(missing_docs)] // the names say it
pub struct ZoneChannel {
    /// Cells that have a sample. All other numbers are not a number if there are none, and the sum is 0.
    pub cells: f64,
    pub min: Number,
    pub max: Number,
    pub sum: f64,
    pub mean: f64,
    pub standard_deviation: f64,
    /// Measures by the cells of each sample, if they were asked for and there are samples.
    pub values: Option<ZoneValues>,
}

/// Measures of a channel in a polygon by the cells of each sample.
///
/// Quantiles are those that NumPy interpolates linearly, with shares of cells as weights: with all samples in order, each as long as its cells are
/// many, of `n` cells in all, the quantile `q` is the mean of what lies between `q * (n - 1)` and one cell more; the mean of all if `n` is less
/// than one. They are exact, of however many values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ZoneValues {
    /// Number of different samples.
    pub variety: u64,
    /// The sample that most cells have; of several the least.
    pub majority: Number,
    /// The sample that the fewest cells have; of several the least.
    pub minority: Number,
    /// The quantile 0.5.
    pub median: f64,
    /// Quantiles, as many as were asked for, in the same order.
    pub quantiles: Vec<f64>,
}

impl ZoneStatistics {
    /// The part of the cells within the picture that is VOID; not a number if there are none.
    pub fn void_share(&self) -> f64 {
        self.void_cells / (self.cells + self.void_cells)
    }

    /// The number that a measure is, of a channel where it is one of channels; `None` if there is no such number, or it was not asked for.
    pub fn number(&self, measure: ZoneMeasure, channel: usize) -> Option<Number> {
        let channel = self.channels.get(channel);
        let values = channel.and_then(|channel| channel.values.as_ref());
        let number: Number = match measure {
            ZoneMeasure::Count => self.cells.into(),
            ZoneMeasure::Void => self.void_cells.into(),
            ZoneMeasure::VoidShare => self.void_share().into(),
            ZoneMeasure::Outside => self.outside_cells.into(),
            // (The sum of nothing is known.)
            ZoneMeasure::Sum => channel.map_or(0.0, |channel| channel.sum).into(),
            ZoneMeasure::Min => channel?.min,
            ZoneMeasure::Max => channel?.max,
            ZoneMeasure::Mean => channel?.mean.into(),
            ZoneMeasure::Deviation => channel?.standard_deviation.into(),
            ZoneMeasure::Majority => values?.majority,
            ZoneMeasure::Minority => values?.minority,
            ZoneMeasure::Variety => values?.variety.into(),
            ZoneMeasure::Median => values?.median.into(),
            ZoneMeasure::Classes => return None,
        };
        (!number.is_nan()).then_some(number)
    }
}
