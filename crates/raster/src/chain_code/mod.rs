//! Freeman chain codes: regions of classes as texts of steps around them, in and out, and lines as chains of cells. `docs/chain_codes.md` has the grammar.
//!
//! Rows go down, directions are counted counterclockwise from east. With 4 directions chains go along the sides of cells (cracks), from corner to corner; with 8
//! from centre to centre of the cells at a region's border. The region is on the left: outer chains are counterclockwise, holes clockwise.
//!
//! Out, chains are made of the rings of the engine's polygons (`ring.rs`, `write.rs`), in, of each chain the places where a row crosses it (`parse.rs`), which are
//! sorted (`crossings.rs`) and make a picture from the top down (`raster.rs`).

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

/// The word that texts begin with, and the version of their grammar.
pub(crate) const MAGIC: &str = "freeman-chain-code";
const VERSION: &str = "1";

/// Directions that a chain's steps have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainDirections {
    /// East, north, west and south: along the sides of cells.
    Four,
    /// These and those between them: from cell to cell.
    Eight,
}

impl ChainDirections {
    /// Their number.
    pub fn count(self) -> u8 {
        match self {
            ChainDirections::Four => 4,
            ChainDirections::Eight => 8,
        }
    }

    /// The step of a code along columns and rows; `None` if there is no such code.
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

/// The code of a step among 8 directions, to one of the 8 cells around.
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
