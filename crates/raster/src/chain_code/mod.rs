//! Freeman chain codes: regions of classes as steps along their borders, and lines as chains of
//! cells. `docs/chain_codes.md` has the grammar.
//!
//! Rows go down; directions are counted counterclockwise from east. With 4 directions chains follow
//! the sides of cells (cracks), from corner to corner. With 8 directions they go from centre to
//! centre of the cells at a region's border. The region is on the left: outer chains are
//! counterclockwise, holes clockwise.
//!
//! Export makes chains from the rings of the engine's polygons (`ring.rs`, `write.rs`). Import
//! computes where each chain crosses a row (`parse.rs`), sorts these crossings (`crossings.rs`) and
//! fills the raster from the top down (`raster.rs`).

mod crossings;
mod line;
mod parse;
mod raster;
mod ring;
#[cfg(test)]
mod tests;
mod text;
mod write;

use std::str::FromStr;

pub(crate) use self::raster::open;
pub use self::write::{ChainWriter, export_chain_code};
use spinney_base::Error;

/// Magic word of the files, and the version of their grammar.
pub(crate) const MAGIC: &str = "freeman-chain-code";
const VERSION: &str = "1";

/// Directions of a chain's steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainDirections {
    /// East, north, west and south: along the sides of cells.
    Four,
    /// Also the diagonals between them: from cell to cell.
    Eight,
}

impl ChainDirections {
    /// Returns the number of directions.
    pub fn count(self) -> u8 {
        match self {
            ChainDirections::Four => 4,
            ChainDirections::Eight => 8,
        }
    }

    /// Returns the step of a code along columns and rows, or `None` if there is no such code.
    fn step(self, code: u8) -> Option<[i64; 2]> {
        const STEPS: [[i64; 2]; 8] = [[1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1], [0, 1], [1, 1]];
        let place = usize::from(code) * if self == ChainDirections::Four { 2 } else { 1 };
        STEPS.get(place).copied()
    }
}

impl FromStr for ChainDirections {
    type Err = Error;

    fn from_str(text: &str) -> Result<ChainDirections, Error> {
        match text {
            "4" => Ok(ChainDirections::Four),
            "8" => Ok(ChainDirections::Eight),
            _ => Err(Error::invalid("number of directions", text, "4 or 8")),
        }
    }
}

/// Returns the code of a step to one of the 8 neighbours.
fn code_of([x, y]: [i64; 2]) -> u8 {
    match (x, y) {
        (1, 0) => 0,
        (1, -1) => 1,
        (0, -1) => 2,
        (-1, -1) => 3,
        (-1, 0) => 4,
        (-1, 1) => 5,
        (0, 1) => 6,
        _ => 7,
    }
}
