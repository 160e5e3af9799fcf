//! Tile addresses: zoom, column and row, their order along the Hilbert curve, and their position on
//! the globe.

use std::f64::consts::PI;

use spinney_base::{Error, Result};
use spinney_crs::WEB_MERCATOR_LATITUDE;

/// Maximum zoom. Tile numbers along the Hilbert curve fit easily into 64 bits there.
pub const MAX_ZOOM: u8 = 28;

/// Tile of the world square. Zoom `z` has `2^z` columns from west to east, and as many rows from
/// north to south.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileId {
    /// Zoom: the level of the tile's node in a tree whose root is the world.
    pub zoom: u8,
    /// Column, from the west.
    pub column: u32,
    /// Row, from the north.
    pub row: u32,
}

impl TileId {
    /// Returns the tile's number in `PMTiles` archives: zoom by zoom, each along the Hilbert curve.
    ///
    /// ```
    /// use spinney::raw::export::tiles::TileId;
    /// assert_eq!(TileId { zoom: 12, column: 3423, row: 1763 }.number(), 19_078_479);
    /// ```
    pub fn number(self) -> u64 {
        first_number(self.zoom) + self.along_curve()
    }

    /// Returns the tile with a number, or `None` if its zoom would exceed [`MAX_ZOOM`].
    pub fn from_number(number: u64) -> Option<TileId> {
        let zoom = (0..=MAX_ZOOM).rev().find(|zoom| first_number(*zoom) <= number)?;
        let along = number - first_number(zoom);
        (along < 1 << (2 * zoom)).then(|| TileId::on_curve(zoom, along))
    }

    /// Returns the distance along the Hilbert curve from the first tile of the zoom. The distances
    /// of a tile's children are the four from four times its own on.
    pub fn along_curve(self) -> u64 {
        let (mut x, mut y, mut along) = (self.column, self.row, 0);
        for bit in (0..self.zoom).rev() {
            let (right, down) = (x >> bit & 1, y >> bit & 1);
            along = along << 2 | u64::from((3 * right) ^ down);
            if down == 0 {
                if right == 1 {
                    // (Only the bits below this one matter from here on.)
                    (x, y) = (!x, !y);
                }
                (x, y) = (y, x);
            }
        }
        along
    }

    /// Returns the tile at a distance along the curve.
    pub fn on_curve(zoom: u8, along: u64) -> TileId {
        let (mut x, mut y) = (0, 0);
        for bit in 0..zoom {
            let digit = (along >> (2 * bit)) as u32;
            let right = digit >> 1 & 1;
            let down = (digit ^ right) & 1;
            if down == 0 {
                if right == 1 {
                    let last = (1 << bit) - 1;
                    (x, y) = (last - x, last - y);
                }
                (x, y) = (y, x);
            }
            x += right << bit;
            y += down << bit;
        }
        TileId { zoom, column: x, row: y }
    }
}

/// Returns the number of a zoom's first tile, which is the number of tiles of all zooms above it.
pub fn first_number(zoom: u8) -> u64 {
    ((1 << (2 * zoom)) - 1) / 3
}

/// Rectangle of tiles of one zoom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileRange {
    /// First column and row.
    pub min: [u32; 2],
    /// Column and row after the last.
    pub max: [u32; 2],
}

impl TileRange {
    /// Returns all tiles of a zoom.
    pub fn world(zoom: u8) -> TileRange {
        TileRange { min: [0; 2], max: [1 << zoom; 2] }
    }

    /// Returns the tiles of a zoom that overlap a box in degrees: west, south, east, north.
    pub fn of_degrees(zoom: u8, [west, south, east, north]: [f64; 4]) -> TileRange {
        let side = f64::from(1u32 << zoom);
        let column = |longitude: f64| (longitude + 180.0) / 360.0 * side;
        let row = |latitude: f64| {
            let latitude = latitude.clamp(-WEB_MERCATOR_LATITUDE, WEB_MERCATOR_LATITUDE).to_radians();
            (1.0 - latitude.tan().asinh() / PI) / 2.0 * side
        };
        // (A border that exceeds that of a tile by a rounding error does not add the next tile.)
        let first = |at: f64| (at + 1e-9).floor().clamp(0.0, side - 1.0) as u32;
        let end = |at: f64| (at - 1e-9).ceil().clamp(1.0, side) as u32;
        let min = [first(column(west)), first(row(north))];
        TileRange { min, max: [end(column(east)).max(min[0] + 1), end(row(south)).max(min[1] + 1)] }
    }

    /// Returns the tiles that are in both ranges.
    #[must_use]
    pub fn intersect(&self, other: &TileRange) -> TileRange {
        TileRange {
            min: std::array::from_fn(|axis| self.min[axis].max(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].min(other.max[axis])),
        }
    }

    /// Returns whether there are no tiles.
    pub fn is_empty(&self) -> bool {
        (0..2).any(|axis| self.min[axis] >= self.max[axis])
    }

    /// Returns whether all tiles of another range are in this one.
    pub fn contains(&self, other: &TileRange) -> bool {
        (0..2).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
    }

    /// Returns the tiles below a tile, at a zoom that is deeper or its own.
    pub fn below(tile: TileId, zoom: u8) -> TileRange {
        let shift = zoom - tile.zoom;
        let min = [tile.column, tile.row];
        TileRange { min: min.map(|at| at << shift), max: min.map(|at| (at + 1) << shift) }
    }

    /// Returns west, south, east and north in degrees.
    pub fn degrees(&self, zoom: u8) -> [f64; 4] {
        let side = f64::from(1u32 << zoom);
        let longitude = |column: u32| f64::from(column) / side * 360.0 - 180.0;
        let latitude = |row: u32| (PI * (1.0 - 2.0 * f64::from(row) / side)).sinh().atan().to_degrees();
        [longitude(self.min[0]), latitude(self.max[1]), longitude(self.max[0]), latitude(self.min[1])]
    }
}

/// Checks that a box in degrees is given as west, south, east, north, lies on the globe, and has a
/// positive width and height.
///
/// # Errors
/// If it does not.
pub fn check_degrees(degrees: [f64; 4]) -> Result<()> {
    let [west, south, east, north] = degrees;
    let is_good =
        -180.0 <= west && west < east && east <= 180.0 && -90.0 <= south && south < north && north <= 90.0;
    let found = degrees.map(|number| number.to_string()).join(",");
    let expected = "west, south, east, north in degrees, with west < east within -180 to 180 and south < north \
                    within -90 to 90 (a box across the antimeridian is two exports)";
    if is_good { Ok(()) } else { Err(Error::invalid("box of tiles", found, expected)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples of the `PMTiles` specification, version 3.
    #[test]
    fn numbers_are_those_of_the_specification() {
        let examples =
            [([0, 0, 0], 0), ([1, 0, 0], 1), ([1, 0, 1], 2), ([1, 1, 1], 3), ([1, 1, 0], 4), ([2, 0, 0], 5)];
        for ([zoom, column, row], number) in examples {
            let tile = TileId { zoom: zoom as u8, column, row };
            assert_eq!((tile.number(), TileId::from_number(number)), (number, Some(tile)));
        }
        assert_eq!(TileId { zoom: 12, column: 3423, row: 1763 }.number(), 19_078_479);
    }

    #[test]
    fn the_curve_goes_through_neighbours_and_children_follow_each_other() {
        for zoom in 0..7 {
            let tiles: Vec<_> = (0..1 << (2 * zoom)).map(|along| TileId::on_curve(zoom, along)).collect();
            for (along, tile) in tiles.iter().enumerate() {
                assert_eq!(tile.along_curve(), along as u64);
                if zoom > 0 {
                    let parent = TileId { zoom: zoom - 1, column: tile.column / 2, row: tile.row / 2 };
                    assert_eq!(parent.along_curve(), along as u64 / 4);
                }
            }
            for pair in tiles.windows(2) {
                let step = pair[0].column.abs_diff(pair[1].column) + pair[0].row.abs_diff(pair[1].row);
                assert_eq!(step, 1);
            }
        }
        let last = TileId { zoom: MAX_ZOOM, column: 5, row: (1 << MAX_ZOOM) - 1 };
        assert_eq!(TileId::from_number(last.number()), Some(last));
        assert_eq!(TileId::from_number(first_number(MAX_ZOOM + 1)), None);
        assert_eq!(TileId::from_number(u64::MAX), None);
    }

    #[test]
    fn boxes_in_degrees_become_tiles_and_back() {
        let all = TileRange::of_degrees(3, [-180.0, -90.0, 180.0, 90.0]);
        assert_eq!(all, TileRange::world(3));
        let degrees = TileRange { min: [2, 1], max: [3, 4] }.degrees(3);
        assert_eq!(TileRange::of_degrees(3, degrees), TileRange { min: [2, 1], max: [3, 4] });
        assert_eq!(
            TileRange::of_degrees(1, [10.0, 10.0, 11.0, 11.0]),
            TileRange { min: [1, 0], max: [2, 1] }
        );
        assert!(check_degrees([10.0, 0.0, -10.0, 1.0]).is_err());
        assert!(check_degrees([f64::NAN, 0.0, 1.0, 1.0]).is_err());
    }
}
