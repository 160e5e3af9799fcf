//! The grid of web maps, as fine as a raster is.

use super::mapping::CellMap;
use super::source::WarpGrid;
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::{Frame, web_mercator};

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
