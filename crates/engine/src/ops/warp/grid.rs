//! Grids in other coordinate systems, at the resolution of a raster: where its data land, or that
//! of web maps.

use std::fmt;
use std::str::FromStr;

use super::landing::Landing;
use super::mapping::CellMap;
use super::options::Resampling;
use super::source::WarpGrid;
use spinney_base::space::{Bounds, Dimension};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame, web_mercator};

/// Coordinate system to which a raster is to be warped, with options.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpTarget {
    /// Coordinate system.
    pub crs: Crs,
    /// Width of a cell, in the system's unit. Default: as large as the raster's cell in its middle.
    pub cell: Option<f64>,
    /// Resampling, if it differs from that of [`WarpOptions`](super::WarpOptions).
    pub resampling: Option<Resampling>,
}

/// Levels of a tile of 256 x 256 cells.
const TILE_LEVELS: u8 = 8;

/// Maximum zoom of web maps whose tiles trees can hold.
pub const MAX_ZOOM: u8 = Dimension::Quad.max_depth() - TILE_LEVELS;

impl WarpGrid {
    /// Grid with the world in web mercator as the root, and tiles of 256 x 256 cells at a zoom.
    /// Without a zoom, uses the one whose cells are closest in size to those of a raster with this
    /// frame and extent, in its middle.
    ///
    /// # Errors
    /// If the zoom exceeds the maximum, or the raster has no position in the world.
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
    /// Splits the string of a target, `DEF,cell=WIDTH,resampling=WAY`, into the system's definition
    /// and the options.
    ///
    /// # Errors
    /// If the cell width is invalid, or a parameter or the resampling is unknown.
    pub fn split(text: &str) -> Result<(&str, Option<f64>, Option<Resampling>)> {
        let (mut definition, mut cell, mut resampling) = (text, None, None);
        while let Some((before, last)) = definition.rsplit_once(',') {
            if let Some(width) = last.strip_prefix("cell=") {
                let found = width.parse().ok().filter(|width: &f64| *width > 0.0 && width.is_finite());
                let wrong = || {
                    Error::invalid(
                        "cell",
                        format!("`{width}`"),
                        "a width above 0, in the unit of the coordinate system",
                    )
                };
                cell = Some(found.ok_or_else(wrong)?);
            } else if let Some(way) = last.strip_prefix("resampling=") {
                resampling = Some(way.parse()?);
            } else if let Some(name) = parameter(last) {
                return Err(Error::invalid("parameter of warp=", format!("`{name}`"), "cell or resampling"));
            } else {
                break;
            }
            definition = before;
        }
        Ok((definition, cell, resampling))
    }

    /// Grid of square cells on which some cells of a raster with this frame and extent land. Its
    /// corners are multiples of the cell width.
    ///
    /// # Errors
    /// If a system cannot be computed, nothing lands anywhere, or the grid exceeds the maximum size
    /// of trees.
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
            let expected = format!("a position inside the area of {}", self.crs);
            Error::invalid("position of the raster", "a position outside, or none", expected)
        };
        let landing = Landing::of(&map, frame, data, &self.crs);
        let Landing { low, high, unit } = landing.ok_or_else(nowhere)?;
        let cell = self.cell.unwrap_or(unit);
        let most = 1u64 << Dimension::Quad.max_depth();
        // (Corners that exceed a line by a rounding error are on it.)
        let first = [0, 1].map(|axis| (low[axis] / cell + 1e-6).floor());
        let last = [0, 1].map(|axis| (high[axis] / cell - 1e-6).ceil());
        let cells = [0, 1].map(|axis| (last[axis] - first[axis]).max(1.0));
        if !cells.iter().all(|cells| (1.0..=most as f64).contains(cells)) {
            let found = format!("{:.0} x {:.0} cells of {cell}", cells[0], cells[1]);
            let expected = format!("at most {most} along each axis; choose a larger cell");
            return Err(Error::invalid("size of the result", found, expected));
        }
        let frame = Frame::planar([cell, 0.0, first[0] * cell, 0.0, -cell, last[1] * cell]);
        let frame = Frame { crs: Some(self.crs.clone()), ..frame };
        Ok(WarpGrid { frame, extent: [cells[0] as u64, cells[1] as u64, 1] })
    }
}

/// Returns the name of a parameter `name=value`. Definitions of systems have `=` only in PROJ
/// strings, after a plus sign, and in names, before a quote.
fn parameter(text: &str) -> Option<&str> {
    let (name, value) = text.split_once('=')?;
    let is_name = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_lowercase());
    (is_name && !value.contains(['"', '+'])).then_some(name)
}

/// Box of a grid's cells, with fractions, in which some cells of a raster in another coordinate
/// system land.
///
/// # Errors
/// If a system cannot be computed, or nothing lands anywhere.
pub(in crate::ops) fn landing_in_cells(
    grid: &Frame,
    (frame, columns): (&Frame, u64),
    data: &Bounds,
    allow_ballpark: bool,
) -> Result<([f64; 2], [f64; 2])> {
    // Cells of this grid are units of the system.
    let world = Frame { crs: grid.crs.clone(), ..Frame::identity() };
    let crs = grid.crs.as_ref().map_or("none".into(), Crs::to_string);
    let nowhere = || {
        Error::invalid(
            "position of the raster",
            "a position outside, or none",
            format!("a position inside the area of {crs}"),
        )
    };
    let map = CellMap::new(&world, frame, columns, allow_ballpark)?;
    let landing = grid.crs.as_ref().and_then(|crs| Landing::of(&map, frame, data, crs));
    let Landing { low, high, .. } = landing.ok_or_else(nowhere)?;
    let (mut first, mut end) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in [low, [low[0], high[1]], [high[0], low[1]], high] {
        let [x, y, _] = grid.to_cells([corner[0], corner[1], 0.0]).ok_or_else(nowhere)?;
        for (axis, at) in [x, y].into_iter().enumerate() {
            (first[axis], end[axis]) = (first[axis].min(at), end[axis].max(at));
        }
    }
    Ok((first, end))
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

fn closest_zoom(frame: &Frame, extent: [u64; 3], allow_ballpark: bool) -> Result<u8> {
    let deepest = MAX_ZOOM + TILE_LEVELS;
    let map = CellMap::new(&web_mercator(deepest), frame, extent[0], allow_ballpark)?;
    // The middle, or else another position that exists on the world map.
    let positions =
        [(0.5, 0.5), (0.25, 0.25), (0.75, 0.75), (0.25, 0.75), (0.75, 0.25), (0.1, 0.5), (0.9, 0.5)];
    let mut ratios = positions.into_iter().filter_map(|(u, v)| {
        let position = map.to_target([extent[0] as f64 * u, extent[1] as f64 * v])?;
        map.ratio_at(position)
    });
    let ratio = ratios.next().ok_or_else(|| {
        let expected = "a position on the web mercator map, from 85 degrees south to 85 degrees north";
        Error::invalid("position of the raster", "a position outside, or none", expected)
    })?;
    // Number of source cells along a side of a cell at the maximum zoom.
    let zoom = f64::from(MAX_ZOOM) + ratio.log2();
    Ok(zoom.round().clamp(0.0, MAX_ZOOM.into()) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of 100 km that the world, in degrees, has in another system.
    fn cells_of_world(epsg: u32, south_up: bool) -> ([u64; 2], [f64; 6]) {
        let (step, top) = if south_up { (1.0, -90.0) } else { (-1.0, 90.0) };
        let frame = Frame::planar([1.0, 0.0, -180.0, 0.0, step, top]);
        let frame = Frame { crs: Some(Crs::epsg(4326)), ..frame };
        let target = WarpTarget { crs: Crs::epsg(epsg), cell: Some(1e5), resampling: None };
        let data = Bounds { min: [0; 3], max: [360, 180, 1] };
        let grid = target.grid(&frame, [360, 180, 1], &data, true).unwrap();
        ([grid.extent[0], grid.extent[1]], grid.frame.affine())
    }

    #[test]
    fn unknown_parameters_are_refused() {
        for text in ["EPSG:3035,cel=30", "+proj=utm +zone=28,cell=3,way=area", "EPSG:3035,cel=30,cell=5"] {
            let message = WarpTarget::split(text).unwrap_err().to_string();
            assert!(message.contains("expected cell or resampling"), "{message}");
        }
        for text in ["+proj=utm +zone=32,33", "LOCAL_CS[\"a,b=c\",UNIT[\"m\",1]]"] {
            assert_eq!(WarpTarget::split(text).unwrap().0, text);
        }
    }

    #[test]
    fn the_world_is_clipped_to_areas_of_use() {
        // In polar stereographic projections, the hemisphere: two radii of the equator, 12,367 km
        // (true to scale at 70 and 71 degrees).
        for (epsg, cells) in
            [(3413, [248; 2]), (3031, [250; 2]), (3995, [252; 2]), (3857, [402; 2]), (6933, [348, 148])]
        {
            for south_up in [false, true] {
                let (found, frame) = cells_of_world(epsg, south_up);
                assert!((0..2).all(|axis| found[axis].abs_diff(cells[axis]) <= 4), "{epsg}: {found:?}");
                let middle =
                    [0, 1].map(|axis| frame[2 + 3 * axis] + frame[4 * axis] * found[axis] as f64 / 2.0);
                assert!(middle.iter().all(|middle| middle.abs() <= 3e5), "{epsg}: {middle:?}");
            }
        }
        // Within 60 degrees of the meridian, and for conic projections far from the other pole.
        for (epsg, most) in [(32633, 250), (3034, 500), (2154, 500), (27700, 250), (31467, 250)] {
            let (found, _) = cells_of_world(epsg, false);
            assert!(found.iter().all(|cells| *cells <= most), "{epsg}: {found:?}");
        }
        // The whole world: two diameters of the earth across, plus what curves may exceed the last
        // position before the antipode.
        let (found, _) = cells_of_world(3035, false);
        assert!(found.iter().all(|cells| (255..400).contains(cells)), "{found:?}");
    }

    /// Data within the area of use get the same grid as without the limit, and so do data wholly
    /// beyond it.
    #[test]
    fn data_on_one_side_are_not_clipped() {
        let frame = Frame::planar([0.1, 0.0, -80.0, 0.0, -0.1, -20.0]);
        let frame = Frame { crs: Some(Crs::epsg(4326)), ..frame };
        let data = Bounds { min: [0; 3], max: [100, 100, 1] };
        for epsg in [3413, 3031, 32718, 3857] {
            let crs = Crs::epsg(epsg);
            let target = WarpTarget { crs: crs.clone(), cell: Some(1e4), resampling: None };
            let grid = target.grid(&frame, [100, 100, 1], &data, true).unwrap();
            let projection = spinney_crs::Projection::new(&crs, true).unwrap();
            for position in [[-80.0, -20.0], [-70.0, -20.0], [-80.0, -30.0], [-70.0, -30.0], [-75.0, -25.0]] {
                let [x, y] = projection.forward(position).unwrap();
                let [column, row, _] = grid.frame.to_cells([x, y, 0.0]).unwrap();
                let is_in = |at: f64, cells: u64| at >= -1e-6 && at <= cells as f64 + 1e-6;
                assert!(is_in(column, grid.extent[0]) && is_in(row, grid.extent[1]), "{epsg}: {position:?}");
            }
        }
    }
}
