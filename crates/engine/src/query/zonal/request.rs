//! Requests for zonal statistics, and their results.

use std::fmt;
use std::str::FromStr;

use spinney_base::space::EdgeRule;
use spinney_base::value::Number;
use spinney_base::{Error, Result};

/// Request for statistics of the cells in polygons.
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
    /// Rule for which cells at the edge of a polygon count.
    pub edge: EdgeRule,
    /// Requested measures. Measures without [`ZoneMeasure::needs_values`] are always computed.
    pub measures: Vec<ZoneMeasure>,
    /// Requested quantiles, from 0 to 1.
    pub quantiles: Vec<f64>,
    /// Memory limit in bytes for the values of all zones in progress; any excess goes to temporary
    /// files.
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
    /// Returns whether single values must be counted.
    pub fn needs_values(&self) -> bool {
        !self.quantiles.is_empty() || self.measures.iter().any(|measure| measure.needs_values())
    }

    /// Fails if a quantile is out of range or there are too many.
    pub(super) fn check(&self) -> Result<()> {
        if self.quantiles.len() > MAX_QUANTILES {
            let found = format!("{} quantiles", self.quantiles.len());
            return Err(Error::invalid("quantiles", found, format!("at most {MAX_QUANTILES}")));
        }
        match self.quantiles.iter().find(|quantile| !(0.0..=1.0).contains(*quantile)) {
            Some(wrong) => Err(Error::invalid("quantile", wrong.to_string(), "a number from 0 to 1")),
            None => Ok(()),
        }
    }
}

/// Maximum number of quantiles per request.
const MAX_QUANTILES: usize = 1000;

/// A measure of a zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZoneMeasure {
    /// Number of cells that are not VOID.
    Count,
    /// Number of VOID cells within the raster.
    Void,
    /// Share of VOID cells among the cells within the raster.
    VoidShare,
    /// Area outside of the raster in cells.
    Outside,
    /// Sum of the samples.
    Sum,
    /// Minimum sample.
    Min,
    /// Maximum sample.
    Max,
    /// Mean of the samples.
    Mean,
    /// Population standard deviation.
    Deviation,
    /// The most frequent sample; the smallest one on ties.
    Majority,
    /// The least frequent sample; the smallest one on ties.
    Minority,
    /// Number of distinct samples.
    Variety,
    /// The 0.5 quantile.
    Median,
    /// Number of cells of each class, or their areas.
    Classes,
}

impl ZoneMeasure {
    /// All measures.
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

    /// Returns the measure's name, as in `std`.
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

    /// Returns whether the measure needs the cell count of each sample. All cells of a zone are
    /// read for this unless the file counts classes.
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
    /// Number of cells that are not VOID. (With [`EdgeRule::Area`], this and all other cell counts
    /// may be fractional.)
    pub cells: f64,
    /// Number of VOID cells within the raster.
    pub void_cells: f64,
    /// Area of the polygon outside of the raster in cells, independent of the edge rule.
    pub outside_cells: f64,
    /// Statistics of each channel; empty if there are no cells.
    pub channels: Vec<ZoneChannel>,
    /// Number of cells of each value, by ascending value; only for one-channel files that count
    /// classes.
    pub classes: Vec<(Number, f64)>,
}

/// Statistics of one channel in a polygon. The standard deviation is that of the population.
#[derive(Clone, Debug, Default, PartialEq)]
#[allow(missing_docs)] // names are self-explanatory
pub struct ZoneChannel {
    /// Number of cells that have a sample. If it is 0, all other numbers are NaN and the sum is 0.
    pub cells: f64,
    pub min: Number,
    pub max: Number,
    pub sum: f64,
    pub mean: f64,
    pub standard_deviation: f64,
    /// Measures from the cell count of each sample, if they were requested and there are samples.
    pub values: Option<ZoneValues>,
}

/// Measures of a channel in a polygon from the cell count of each sample.
///
/// Quantiles are linearly interpolated as in NumPy, weighted by the cells' shares: of the sorted
/// samples with a total weight of `n` cells, the quantile `q` is the mean over the interval of one
/// cell that starts at `q * (n - 1)`. If `n` is less than one, it is the mean of all. Quantiles are
/// exact for any number of values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ZoneValues {
    /// Number of distinct samples.
    pub variety: u64,
    /// The most frequent sample; the smallest one on ties.
    pub majority: Number,
    /// The least frequent sample; the smallest one on ties.
    pub minority: Number,
    /// The 0.5 quantile.
    pub median: f64,
    /// The requested quantiles, in the order of the request.
    pub quantiles: Vec<f64>,
}

impl ZoneStatistics {
    /// Returns the share of VOID cells among the cells within the raster, or NaN if there are none.
    pub fn void_share(&self) -> f64 {
        self.void_cells / (self.cells + self.void_cells)
    }

    /// Returns the value of a measure, for a channel if the measure is per channel. Returns `None`
    /// if it has no value or was not requested.
    pub fn number(&self, measure: ZoneMeasure, channel: usize) -> Option<Number> {
        let channel = self.channels.get(channel);
        let values = channel.and_then(|channel| channel.values.as_ref());
        let number: Number = match measure {
            ZoneMeasure::Count => self.cells.into(),
            ZoneMeasure::Void => self.void_cells.into(),
            ZoneMeasure::VoidShare => self.void_share().into(),
            ZoneMeasure::Outside => self.outside_cells.into(),
            // (The sum of no samples is 0.)
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
