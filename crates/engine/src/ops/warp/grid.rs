//! Grids in other coordinate systems, as fine as a raster is: where its data land, or that of web maps.

use std::fmt;
use std::str::FromStr;

use super::mapping::CellMap;
use super::options::Resampling;
use super::source::WarpGrid;
use spinney_base::space::{Bounds, Dimension};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame, web_mercator};

/// A coordinate system that a raster is to be brought to, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpTarget {
    /// The system.
    pub crs: Crs,
    /// Width of a cell, in the system's unit; as large as the raster's in its middle if not given.
    pub cell: Option<f64>,
    /// The way of resampling, if it is not that of [`WarpOptions`](super::WarpOptions).
    pub resampling: Option<Resampling>,
}

/// Levels of a tile of 256 x 256 cells.
const TILE_LEVELS: u8 = 8;

/// The deepest zoom of web maps whose tiles trees can have.
pub const MAX_ZOOM: u8 = Dimension::Quad.max_depth() - TILE_LEVELS;

impl WarpGrid {
    /// The world in web mercator as the root, with tiles of 256 x 256 cells at a zoom; without one at the zoom whose cells are
    /// closest in size to those of a raster with this frame and extent, in its middle.
    ///
    /// # Errors
    /// If the zoom is deeper than trees are, or the raster has no place in the world.
    pub fn web_mercator(
        max_zoom: Option<u8>,
        frame: &Frame,
        extent: [u64; 3],
        allow_ballpark: bool,
    ) -> Result<WarpGrid> {
        let zoom = match max_zoom {
            Some(zoom) if zoom <= MAX_ZOOM => zoom,
            Some(zoom) => {
                return Err(Error::invalid("max zoom", zoom.to_string(), format!("0 to {MAX_ZOOM}")));
            }
            None => closest_zoom(frame, extent, allow_ballpark)?,
        };
        let depth = zoom + TILE_LEVELS;
        Ok(WarpGrid { frame: web_mercator(depth), extent: [1 << depth, 1 << depth, 1] })
    }
}

impl WarpTarget {
    /// Splits the text of a target, `DEF,cell=WIDTH,resampling=WAY`, into the definition of the system and what else is said.
    ///
    /// # Errors
    /// If the cell is no width, or there is no such way of resampling.
    pub fn split(text: &str) -> Result<(&str, Option<f64>, Option<Resampling>)> {
        let (mut definition, mut cell, mut resampling) = (text, None, None);
        while let Some((before, last)) = definition.rsplit_once(',') {
            if let Some(width) = last.strip_prefix("cell=") {
                let found = width.parse().ok().filter(|width: &f64| *width > 0.0 && width.is_finite());
                let wrong =
                    || Error::invalid("cell", format!("`{width}`"), "a width in the system's unit, above 0");
                cell = Some(found.ok_or_else(wrong)?);
            } else if let Some(way) = last.strip_prefix("resampling=") {
                resampling = Some(way.parse()?);
            } else {
                break;
            }
            definition = before;
        }
        Ok((definition, cell, resampling))
    }

    /// The grid of square cells that some cells of a raster with this frame and extent land on: its corners are multiples of the
    /// cell's width.
    ///
    /// # Errors
    /// If a system cannot be computed, nothing lands anywhere, or the grid is larger than trees are.
    pub(crate) fn grid(
        &self,
        frame: &Frame,
        extent: [u64; 3],
        data: &Bounds,
        allow_ballpark: bool,
    ) -> Result<WarpGrid> {
        // Cells of this "target" are units of the system.
        let world = Frame { crs: Some(self.crs.clone()), ..Frame::identity() };
        let map = CellMap::new(&world, frame, extent[0], allow_ballpark)?;
        let nowhere = || {
            let expected = format!("one that {} has", self.crs);
            Error::invalid("place of the raster", "another one, or none", expected)
        };
        let Landing { low, high, unit } = Landing::of(&map, data, self.crs.turn()).ok_or_else(nowhere)?;
        let cell = self.cell.unwrap_or(unit);
        let most = 1u64 << Dimension::Quad.max_depth();
        // (Corners that are a rounding error beyond a line lie on it.)
        let first = [0, 1].map(|axis| (low[axis] / cell + 1e-6).floor());
        let last = [0, 1].map(|axis| (high[axis] / cell - 1e-6).ceil());
        let cells = [0, 1].map(|axis| (last[axis] - first[axis]).max(1.0));
        if !cells.iter().all(|cells| (1.0..=most as f64).contains(cells)) {
            let found = format!("{:.0} x {:.0} cells of {cell}", cells[0], cells[1]);
            let expected = format!("at most {most} along each axis: say a larger cell");
            return Err(Error::invalid("size of the result", found, expected));
        }
        let frame = Frame::planar([cell, 0.0, first[0] * cell, 0.0, -cell, last[1] * cell]);
        let frame = Frame { crs: Some(self.crs.clone()), ..frame };
        Ok(WarpGrid { frame, extent: [cells[0] as u64, cells[1] as u64, 1] })
    }
}

impl FromStr for WarpTarget {
    type Err = Error;

    fn from_str(text: &str) -> Result<WarpTarget> {
        let (definition, cell, resampling) = WarpTarget::split(text)?;
        let crs = Crs::parse(definition)?;
        crs.check_registered()?;
        Ok(WarpTarget { crs, cell, resampling })
    }
}

impl fmt::Display for WarpTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.crs.definition())?;
        self.cell.map_or(Ok(()), |cell| write!(f, ",cell={cell}"))?;
        self.resampling.map_or(Ok(()), |way| write!(f, ",resampling={way}"))
    }
}

/// The place of a raster's data in another system.
struct Landing {
    low: [f64; 2],
    high: [f64; 2],
    /// Side of a square of the area of a raster's cell, in the data's middle.
    unit: f64,
}

impl Landing {
    /// The landing of a box of cells; `None` if no place of it has one in the system. First coordinates that differ by a `turn` are
    /// one place: those next to the middle's are taken, or all round the world if data are on all sides.
    fn of(map: &CellMap, data: &Bounds, turn: Option<f64>) -> Option<Landing> {
        const STEPS: usize = 128;
        let at = |axis: usize, step: f64| {
            data.min[axis] as f64 + (data.max[axis] - data.min[axis]) as f64 * step / STEPS as f64
        };
        let place = |column: f64, row: f64| map.to_target([at(0, column), at(1, row)]);
        let parts = [0.5, 0.25, 0.75, 0.1, 0.9].map(|part| part * STEPS as f64);
        let middles = parts.into_iter().flat_map(|row| parts.into_iter().map(move |column| (column, row)));
        let (middle, unit) = middles.clone().find_map(|(column, row)| {
            let middle = place(column, row)?;
            // (A thousandth of the target's turn, or of its unit, is more than rounding.)
            let ratio = map.ratio_over(middle, turn.map_or(1.0, |turn| turn * 1e-6))?;
            Some((middle, 1.0 / ratio))
        })?;
        let beside = |[x, y]: [f64; 2]| match turn {
            Some(turn) => [middle[0] + (x - middle[0] + turn / 2.0).rem_euclid(turn) - turn / 2.0, y],
            None => [x, y],
        };
        let rows: Vec<Vec<Option<[f64; 2]>>> = (0..=STEPS)
            .map(|row| (0..=STEPS).map(|column| place(column as f64, row as f64).map(beside)).collect())
            .collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        rows.iter().flatten().flatten().for_each(|place| {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(place[axis]), high[axis].max(place[axis]));
            }
        });
        // Between two places a curve reaches beyond both by an eighth of the second difference, or so.
        let mut bend = [0f64; 2];
        let columns = (0..=STEPS).map(|column| rows.iter().map(|row| row[column]).collect::<Vec<_>>());
        for line in rows.iter().cloned().chain(columns) {
            for three in line.windows(3) {
                match three {
                    [Some(a), Some(b), Some(c)] => {
                        for axis in 0..2 {
                            bend[axis] = bend[axis].max((a[axis] - 2.0 * b[axis] + c[axis]).abs());
                        }
                    }
                    // Next to places without a place it may reach as far again.
                    [Some(a), Some(b), None] | [None, Some(a), Some(b)] => {
                        for axis in 0..2 {
                            bend[axis] = bend[axis].max(8.0 * (a[axis] - b[axis]).abs());
                        }
                    }
                    _ => {}
                }
            }
        }
        let is_flat = (0..2).all(|axis| bend[axis] < unit * 1e-3);
        for axis in 0..2 {
            let margin = if is_flat { 0.0 } else { bend[axis] / 4.0 };
            (low[axis], high[axis]) = (low[axis] - margin, high[axis] + margin);
        }
        let Some(turn) = turn else { return Some(Landing { low, high, unit }) };
        // All round the world, once. (What lies around a pole does, up to the pole.)
        if high[0] - low[0] > 0.9 * turn {
            (low[0], high[0]) = (-turn / 2.0, turn / 2.0);
        }
        let poles = [([0.0, -90.0], 0), ([0.0, 90.0], 1)];
        for (pole, end) in poles {
            let is_in = |[column, row]: [f64; 2]| {
                (data.min[0] as f64..data.max[0] as f64).contains(&column)
                    && (data.min[1] as f64..data.max[1] as f64).contains(&row)
            };
            if turn == 360.0 && map.to_source(pole).is_some_and(is_in) {
                if end == 0 { low[1] = -90.0 } else { high[1] = 90.0 }
            }
        }
        if turn == 360.0 {
            (low[1], high[1]) = (low[1].max(-90.0), high[1].min(90.0));
        }
        Some(Landing { low, high, unit })
    }
}

fn closest_zoom(frame: &Frame, extent: [u64; 3], allow_ballpark: bool) -> Result<u8> {
    let deepest = MAX_ZOOM + TILE_LEVELS;
    let map = CellMap::new(&web_mercator(deepest), frame, extent[0], allow_ballpark)?;
    // The middle, or else another place that the map of the world has.
    let places = [(0.5, 0.5), (0.25, 0.25), (0.75, 0.75), (0.25, 0.75), (0.75, 0.25), (0.1, 0.5), (0.9, 0.5)];
    let mut ratios = places.into_iter().filter_map(|(u, v)| {
        let place = map.to_target([extent[0] as f64 * u, extent[1] as f64 * v])?;
        map.ratio_at(place)
    });
    let ratio = ratios.next().ok_or_else(|| {
        let expected = "one that web mercator has, from 85 degrees south to 85 degrees north";
        Error::invalid("place of the raster", "another one, or none", expected)
    })?;
    // A deepest cell has so many source cells along a side.
    let zoom = f64::from(MAX_ZOOM) + ratio.log2();
    Ok(zoom.round().clamp(0.0, MAX_ZOOM.into()) as u8)
}
