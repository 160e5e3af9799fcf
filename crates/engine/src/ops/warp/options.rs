//! Resampling methods.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use spinney_base::value::DataKind;
use spinney_base::{Error, Result};

/// How a target cell gets its value from the source cells around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resampling {
    /// Value of the source cell at the cell's centre.
    Nearest,
    /// Bilinear interpolation between the centres of the four source cells around the cell's
    /// centre, ignoring VOID cells. The cell is VOID where the source cell at its centre is.
    Bilinear,
    /// Cubic convolution of 16 source cells (Keys 1981, a = -0.5); bilinear where one of them is
    /// VOID.
    Cubic,
    /// Mean of all source cells that the cell covers, weighted by the exactly covered area (with
    /// the cell's edges as straight lines in the source). VOID is ignored.
    Area,
    /// Value with the largest area in the cell, of equal areas the first in row order of the
    /// source. Areas are exact, too.
    Majority,
}

impl Resampling {
    /// All methods.
    pub const ALL: [Resampling; 5] = {
        use Resampling::*;
        [Nearest, Bilinear, Cubic, Area, Majority]
    };

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        ["nearest", "bilinear", "cubic", "area", "majority"][self as usize]
    }

    /// Default method if a target cell has `ratio` source cells along a side: for few, nearest for
    /// classes or bilinear for continuous values; for more, the majority or the mean of the area.
    pub(super) fn usual(kind: DataKind, ratio: f64) -> Resampling {
        /// Maximum ratio at which no source cells are skipped.
        const MAX_RATIO: f64 = 1.5;
        match (kind, ratio <= MAX_RATIO) {
            (DataKind::Categorical, true) => Resampling::Nearest,
            (DataKind::Categorical, false) => Resampling::Majority,
            (DataKind::Continuous, true) => Resampling::Bilinear,
            (DataKind::Continuous, false) => Resampling::Area,
        }
    }

    /// Whether the method creates no new class numbers.
    pub(in crate::ops) fn fits(self, kind: DataKind) -> bool {
        let makes_numbers = matches!(self, Resampling::Bilinear | Resampling::Cubic | Resampling::Area);
        kind != DataKind::Categorical || !makes_numbers
    }

    /// Fails if the method would create new class numbers.
    pub(super) fn check(self, kind: DataKind) -> Result<()> {
        if !self.fits(kind) {
            let found = format!("{self} for a categorical tree, which would make new class numbers");
            return Err(Error::invalid("resampling", found, "nearest or majority"));
        }
        Ok(())
    }

    /// Number of source cells around a point that contribute to it.
    pub(super) fn reach(self) -> f64 {
        match self {
            Resampling::Nearest | Resampling::Area | Resampling::Majority => 0.0,
            Resampling::Bilinear => 1.0,
            Resampling::Cubic => 2.0,
        }
    }

    /// Whether the cell's area counts, not only its centre.
    pub(super) fn is_of_area(self) -> bool {
        matches!(self, Resampling::Area | Resampling::Majority)
    }
}

impl fmt::Display for Resampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Resampling {
    type Err = Error;

    fn from_str(name: &str) -> Result<Resampling, Error> {
        let found = Resampling::ALL.into_iter().find(|way| way.name() == name);
        found.ok_or_else(|| {
            Error::invalid(
                "resampling",
                format!("`{name}`"),
                Resampling::ALL.map(Resampling::name).join(", "),
            )
        })
    }
}

/// Options for warping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct WarpOptions {
    /// Resampling method; by default, it depends on the kind of the values and the cell sizes.
    pub resampling: Option<Resampling>,
    /// Treats datums as WGS 84 whose shift to it is unknown or needs a grid: see
    /// [`Projection::new`](spinney_crs::Projection::new).
    pub allow_ballpark: bool,
    /// Reads each block from the coarsest level of the source with at least this many cells along
    /// each side of a target cell (at most about one for methods that do not average areas),
    /// instead of always from its cells. Use 2 for overviews that are stored, and
    /// [`WarpOptions::PREVIEW`] for previews.
    #[serde(with = "spinney_base::text_fields")]
    pub level_cells: Option<f32>,
}

impl WarpOptions {
    /// Level cells along a side of a target cell that suffice for previews: a level may be 1.2
    /// times as coarse as the result, as in GDAL's warper. A tile then reads at most a quarter of
    /// what two cells would require.
    pub const PREVIEW: f32 = 1.0 / 1.2;
}
