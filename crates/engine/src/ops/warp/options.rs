//! Ways of resampling.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use spinney_base::value::DataKind;
use spinney_base::{Error, Result};

/// The way a cell of the target gets its value from the cells of the source around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resampling {
    /// The source cell at the cell's centre.
    Nearest,
    /// Linear interpolation between the centres of the four source cells around the cell's centre; those that are VOID are left
    /// out. The cell is VOID where the source cell at its centre is.
    Bilinear,
    /// Cubic convolution of 16 source cells (Keys 1981, a = -0.5); linear where one of them is VOID.
    Cubic,
    /// The mean of all source cells that the cell covers, each by the area that is covered, exactly (the cell's edges taken for
    /// straight lines in the source). VOID counts for nothing.
    Area,
    /// The value with the largest area in the cell, the least of several; areas are exact, too.
    Majority,
}

impl Resampling {
    /// All ways.
    pub const ALL: [Resampling; 5] = {
        use Resampling::*;
        [Nearest, Bilinear, Cubic, Area, Majority]
    };

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        ["nearest", "bilinear", "cubic", "area", "majority"][self as usize]
    }

    /// The usual way, where a cell of the target has `ratio` cells of the source along a side: for few the nearest class or
    /// bilinear amounts, for more the majority or the mean of the area.
    pub(super) fn usual(kind: DataKind, ratio: f64) -> Resampling {
        /// Beyond, cells of the source would be left out.
        const FEW: f64 = 1.5;
        match (kind, ratio <= FEW) {
            (DataKind::Categorical, true) => Resampling::Nearest,
            (DataKind::Categorical, false) => Resampling::Majority,
            (DataKind::Continuous, true) => Resampling::Bilinear,
            (DataKind::Continuous, false) => Resampling::Area,
        }
    }

    /// Whether the way makes no new numbers of classes.
    pub(in crate::ops) fn fits(self, kind: DataKind) -> bool {
        let makes_numbers = matches!(self, Resampling::Bilinear | Resampling::Cubic | Resampling::Area);
        kind != DataKind::Categorical || !makes_numbers
    }

    /// Fails if the way makes numbers of classes.
    pub(super) fn check(self, kind: DataKind) -> Result<()> {
        if !self.fits(kind) {
            let found = format!("{self}, which makes new numbers, of classes");
            return Err(Error::invalid("resampling", found, "nearest or majority"));
        }
        Ok(())
    }

    /// Source cells beyond a point that count for it.
    pub(super) fn reach(self) -> f64 {
        match self {
            Resampling::Nearest | Resampling::Area | Resampling::Majority => 0.0,
            Resampling::Bilinear => 1.0,
            Resampling::Cubic => 2.0,
        }
    }

    /// Whether the cell's area counts, not its centre alone.
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
    /// The way of resampling; chosen by the kind of the values and the cells' sizes if not given.
    pub resampling: Option<Resampling>,
    /// Takes datums for WGS 84 whose shift to it is unknown or needs a grid: see
    /// [`Projection::new`](spinney_crs::Projection::new).
    pub allow_ballpark: bool,
    /// Takes the values of each block from the coarsest level of the source with at least so many cells along each side of a cell (about one at most where
    /// the way is of no area), instead of always from its cells: 2 for overviews that are kept, [`WarpOptions::LOOK`] for those that are only looked at.
    #[serde(with = "spinney_base::text_fields")]
    pub level_cells: Option<f32>,
}

impl WarpOptions {
    /// Cells of a level along a side of a cell that do for a look: a level may be 1.2 times as coarse as what is drawn from it, as GDAL's warper has it. A
    /// tile reads a quarter of what two cells take, or less.
    pub const LOOK: f32 = 1.0 / 1.2;
}
