//! The operations `components=4`, `sieve=100`, `sieve=5000m2,connect=8`.

use std::fmt;
use std::str::FromStr;

use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::Frame;

/// Connectivity: the neighbours that a cell is connected with. These are the 4 in a quadtree that
/// share an edge, the 6 in an octree that share a face, or all 8 or 26 around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Connectivity(u8);

impl Connectivity {
    /// Connectivity in a tree of this dimension; with `across`, also across corners (and edges).
    pub fn of(dimension: Dimension, across: bool) -> Connectivity {
        Connectivity(match (dimension, across) {
            (Dimension::Quad, false) => 4,
            (Dimension::Quad, true) => 8,
            (Dimension::Oct, false) => 6,
            (Dimension::Oct, true) => 26,
        })
    }

    /// Number of neighbours.
    pub fn neighbours(self) -> u8 {
        self.0
    }

    /// Maximum distance of neighbours along the other axes, in cells.
    ///
    /// # Errors
    /// If the connectivity does not exist for this dimension.
    pub(super) fn reach(self, dimension: Dimension) -> Result<u32> {
        let numbers = [false, true].map(|across| Connectivity::of(dimension, across));
        let reach = numbers.iter().position(|number| *number == self);
        reach.map(|reach| reach as u32).ok_or_else(|| {
            let expected = format!("{} or {} for {}s", numbers[0], numbers[1], dimension.tree_name());
            Error::invalid("number of neighbours", self.to_string(), expected)
        })
    }
}

impl FromStr for Connectivity {
    type Err = Error;

    fn from_str(text: &str) -> Result<Connectivity> {
        let number = text.trim().parse().ok().filter(|number| [4, 8, 6, 26].contains(number));
        number.map(Connectivity).ok_or_else(|| {
            let expected = "4 or 8, for octrees 6 or 26";
            Error::invalid("number of neighbours", format!("`{text}`"), expected)
        })
    }
}

impl fmt::Display for Connectivity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Minimum size of components that are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Least {
    Cells(u64),
    SquareMetres(f64),
}

/// Sieve: merges components below a size into their largest neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sieve {
    least: Least,
    connect: Option<Connectivity>,
}

impl Sieve {
    /// Maximum distance of neighbours along the other axes, in cells. Default connectivity: cells
    /// that share an edge (in octrees a face).
    pub(super) fn reach(&self, dimension: Dimension) -> Result<u32> {
        self.connect.map_or(Ok(0), |connect| connect.reach(dimension))
    }

    /// Minimum number of cells of components that are kept.
    ///
    /// # Errors
    /// If the size is in square metres and the frame does not determine the area of a cell.
    pub(super) fn cells(&self, dimension: Dimension, frame: &Frame) -> Result<u64> {
        let metres = match self.least {
            Least::Cells(cells) => return Ok(cells),
            Least::SquareMetres(metres) => metres,
        };
        let area = match dimension {
            Dimension::Quad => frame.cell_square_metres(),
            Dimension::Oct => Err("cells of octrees have no area"),
        };
        let area = area.map_err(|reason| {
            let expected = format!("a number of cells, as in sieve=100 ({reason})");
            Error::invalid("sieve", "square metres", expected)
        })?;
        Ok((metres / area).ceil() as u64)
    }
}

impl FromStr for Sieve {
    type Err = Error;

    fn from_str(text: &str) -> Result<Sieve> {
        let wrong = || {
            let expected = "sieve=CELLS or sieve=AREAm2, optionally with ,connect=8: smaller components are merged into a neighbour";
            Error::invalid("operation", format!("`sieve={text}`"), expected)
        };
        let (size, connect) = match text.split_once(',') {
            None => (text, None),
            Some((size, more)) => {
                (size, Some(more.trim().strip_prefix("connect=").ok_or_else(wrong)?.parse()?))
            }
        };
        let size = size.trim();
        let least = match size.strip_suffix("m2") {
            Some(metres) => metres
                .parse()
                .ok()
                .filter(|metres: &f64| metres.is_finite() && *metres > 0.0)
                .map(Least::SquareMetres),
            None => size
                .strip_suffix("cells")
                .unwrap_or(size)
                .parse()
                .ok()
                .filter(|cells| *cells > 0)
                .map(Least::Cells),
        };
        Ok(Sieve { least: least.ok_or_else(wrong)?, connect })
    }
}

impl fmt::Display for Sieve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.least {
            Least::Cells(cells) => write!(f, "sieve={cells}")?,
            Least::SquareMetres(metres) => write!(f, "sieve={metres}m2")?,
        }
        self.connect.map_or(Ok(()), |connect| write!(f, ",connect={connect}"))
    }
}
