//! Tiles of rasters on any grid, warped as they are drawn, from the raster's own levels.

use std::sync::Arc;

use super::source::{GeographicExtent, TileContent, TileSamples, TileSource};
use super::tile_id::{MAX_ZOOM, TileId, TileRange};
use super::tree::TreeTiles;
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::ValueType;
use spinney_base::{Error, Progress, Result};
use spinney_crs::{Frame, Projection, WEB_MERCATOR_LATITUDE, web_mercator};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::{Resampling, ViewSource, WarpGrid, WarpOptions, Warped};
use spinney_engine::tree::Source as _;

/// Tiles of a raster that is not on the web mercator grid.
///
/// Each zoom reads the coarsest level of the raster that is fine enough. By default, that is one
/// with at least two cells along a pixel's side, or one cell if the resampling method does not
/// aggregate an area. So no tile reads many more cells than it has pixels.
pub struct WarpedTiles {
    /// Warped raster of each zoom.
    warped: Vec<Warped>,
    source_depth: u8,
    source_extent: [u64; 3],
    side: usize,
    max_zoom: u8,
    /// Zoom whose pixels are closest in size to the raster's cells.
    closest: u8,
    degrees: [f64; 4],
    /// Longitude and latitude of the raster's middle, where they are defined.
    middle: Option<[f64; 2]>,
}

impl WarpedTiles {
    /// Creates the tiles of a raster, with `side` cells a side, down to `max_zoom`; by default,
    /// down to the zoom whose cells are closest in size to the raster's. `frame` is the
    /// georeferencing of the raster's cells.
    ///
    /// # Errors
    /// If `max_zoom` is too deep, and those of [`Warped::new`].
    pub fn new(
        source: Arc<ViewSource>,
        frame: &Frame,
        side: usize,
        max_zoom: Option<u8>,
        options: &WarpOptions,
    ) -> Result<WarpedTiles> {
        let header = source.header();
        let (source_depth, source_extent) = (header.depth(), header.extent);
        let levels = side.trailing_zeros() as u8;
        if header.form.dimension != Dimension::Quad {
            let advice =
                "tiles of a map are images of a raster; write a solid as .ply, .glb or x/tileset.json";
            return Err(Error::unsupported(source.name(), "an octree as source of tiles", advice));
        }
        let finest = WarpGrid::web_mercator(None, frame, source_extent, options.allow_ballpark)
            .map_err(|error| error.of_file(source.name()))?;
        // (Tiles with twice the side have as many cells at one zoom less.)
        let closest = (finest.extent[0].trailing_zeros() as u8).saturating_sub(levels);
        let max_zoom = max_zoom.unwrap_or(closest);
        let most = MAX_ZOOM.min(Dimension::Quad.max_depth().saturating_sub(levels));
        if max_zoom > most {
            return Err(Error::invalid("zoom", max_zoom.to_string(), format!("at most {most}")));
        }
        let mut options = *options;
        options.level_cells.get_or_insert(2.0);
        let at = |zoom: u8| {
            let depth = zoom + levels;
            let grid = WarpGrid { frame: web_mercator(depth), extent: [1 << depth, 1 << depth, 1] };
            Warped::new(source.clone(), frame, &grid, &options)
        };
        let warped = (0..=max_zoom).map(at).collect::<Result<_>>()?;
        let degrees = degrees_of(frame, source_extent, options.allow_ballpark)?;
        let middle = middle_of(frame, source_extent, options.allow_ballpark)?;
        Ok(WarpedTiles { warped, source_depth, source_extent, side, max_zoom, closest, degrees, middle })
    }

    fn at(&self, zoom: u8) -> Result<&Warped> {
        self.warped.get(usize::from(zoom)).ok_or_else(|| {
            Error::invalid("zoom", zoom.to_string(), format!("at most {}", self.warped.len() - 1))
        })
    }

    /// Returns warnings about the accuracy of the raster's coordinate reference system.
    pub fn remarks(&self) -> Vec<String> {
        self.warped.first().map(Warped::remarks).unwrap_or_default()
    }
}

impl TileSource for WarpedTiles {
    fn value_type(&self) -> ValueType {
        self.warped[0].form().value
    }

    fn overshoots(&self) -> bool {
        self.warped.iter().any(|warped| warped.resampling() == Resampling::Cubic)
    }

    /// Lists the resampling method of each zoom.
    fn signature(&self) -> String {
        let ways: Vec<&str> = self.warped.iter().map(|warped| warped.resampling().name()).collect();
        format!("warped {}", ways.join(","))
    }

    fn max_zoom(&self, _: usize) -> u8 {
        self.max_zoom
    }

    fn degrees(&self) -> [f64; 4] {
        self.degrees
    }

    fn data_place(&self) -> Result<GeographicExtent> {
        let place = GeographicExtent::of_bounds(self.degrees);
        // (A raster that crosses the antimeridian is on both sides of the map, so its middle is the
        // centre.)
        let is_split = self.degrees[0] == -180.0 && self.degrees[2] == 180.0;
        Ok(match self.middle {
            Some([longitude, _]) if is_split => {
                GeographicExtent { centre: [longitude, place.centre[1]], ..place }
            }
            _ => place,
        })
    }

    fn content(&self, tile: TileId) -> Result<TileContent> {
        let TileId { zoom, column, row } = tile;
        let code = Code::from_zxy(zoom, column, row);
        let code =
            code.ok_or_else(|| Error::invalid("tile", format!("{zoom}/{column}/{row}"), "one of the world"))?;
        Ok(match self.at(zoom)?.uniform(code)? {
            Some(Some(value)) => TileContent::Uniform(value),
            Some(None) => TileContent::Empty,
            None => TileContent::Detail,
        })
    }

    fn tile(&self, tile: TileId, side: usize, margin: usize, samples: &mut TileSamples) -> Result<()> {
        let warped = self.at(tile.zoom)?;
        samples.draw(tile, (side, margin), self.value_type().size(), true, &|cells, values, valid| {
            // (The warped source can draw any box.)
            warped.draw(cells, values, valid).map(|_| ())
        })
    }

    fn tiles_of(&self, block: Code, zoom: u8) -> TileRange {
        let cells = block.bounds(self.source_depth).intersect(&Bounds::of_extent(self.source_extent));
        let Ok(warped) = self.at(zoom) else { return TileRange::world(zoom) };
        let reached = warped.reached_from(&cells);
        let side = self.side as u64;
        TileRange {
            min: [0, 1].map(|axis| (reached.min[axis] / side) as u32),
            max: [0, 1].map(|axis| reached.max[axis].div_ceil(side) as u32),
        }
    }

    fn block_level(&self, zoom: u8) -> u8 {
        // At the closest zoom, a tile has about as many cells as pixels. Use nodes of half its
        // side.
        let cells =
            i16::from(self.side.trailing_zeros() as u8) - 1 + i16::from(self.closest) - i16::from(zoom);
        let depth = i16::from(self.source_depth);
        (depth - cells).clamp(0, depth) as u8
    }

    fn check_unchanged(&self) -> Result<()> {
        self.warped[0].source().check_unchanged()
    }
}

/// Returns the world tiles of a tree, with `side` cells a side. They are its nodes if it is on the
/// web mercator grid; otherwise they are warped, down to `max_zoom` ([`WarpedTiles::new`]).
///
/// # Errors
/// If resampling is requested for a tree that needs none, if the tree is a view on another grid, or
/// if it has no position in the world.
pub fn tile_source<'a>(
    tree: &'a Dataset,
    side: usize,
    max_zoom: Option<u8>,
    options: &WarpOptions,
    progress: &dyn Progress,
) -> Result<Box<dyn TileSource + 'a>> {
    let path = tree.name();
    if let Some(tiles) = TreeTiles::world(tree) {
        return match options.resampling {
            None => Ok(Box::new(tiles)),
            Some(way) => {
                let expected = format!("none: {} is on the grid of web maps already", path.display());
                Err(Error::invalid("resampling", way.name(), expected))
            }
        };
    }
    let Some(source) = tree.whole_source() else {
        let expected =
            format!("a file, which `spinney transform {} STEP ... -o OTHER` writes", path.display());
        return Err(Error::invalid(
            "source of tiles",
            "a view that is not on the grid of web maps",
            expected,
        ));
    };
    let tiles = WarpedTiles::new(source, &tree.metadata().frame, side, max_zoom, options)?;
    tiles.remarks().iter().for_each(|remark| progress.warn(path, remark));
    Ok(Box::new(tiles))
}

/// Returns the longitude, from -180 to 180, and the latitude of a raster's middle.
fn middle_of(frame: &Frame, extent: [u64; 3], allow_ballpark: bool) -> Result<Option<[f64; 2]>> {
    let Some(crs) = &frame.crs else { return Ok(None) };
    let [x, y, _] = frame.to_world(extent.map(|cells| cells as f64 / 2.0));
    let middle = Projection::new(crs, allow_ballpark)?.inverse([x, y]);
    Ok(middle.map(|[longitude, latitude]| [(longitude + 180.0).rem_euclid(360.0) - 180.0, latitude]))
}

/// Returns west, south, east and north of a raster in degrees. They bound a lattice of its points,
/// with a small margin for edges that curve between these. Returns the whole world if that is not
/// conclusive.
pub fn degrees_of(frame: &Frame, extent: [u64; 3], allow_ballpark: bool) -> Result<[f64; 4]> {
    const STEPS: u32 = 256;
    const HAIR: f64 = 1e-5;
    const WORLD: [f64; 4] = [-180.0, -WEB_MERCATOR_LATITUDE, 180.0, WEB_MERCATOR_LATITUDE];
    let Some(crs) = &frame.crs else { return Ok(WORLD) };
    let projection = Projection::new(crs, allow_ballpark)?;
    let place = |x: u32, y: u32| {
        let at = |step: u32, axis: usize| extent[axis] as f64 * f64::from(step) / f64::from(STEPS);
        let [x, y, _] = frame.to_world([at(x, 0), at(y, 1), 0.0]);
        projection.inverse([x, y])
    };
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut above: Vec<f64> = Vec::new();
    for y in 0..=STEPS {
        let row: Option<Vec<[f64; 2]>> = (0..=STEPS).map(|x| place(x, y)).collect();
        let Some(row) = row else { return Ok(WORLD) };
        for point in &row {
            (low, high) = (
                [0, 1].map(|axis| low[axis].min(point[axis])),
                [0, 1].map(|axis| high[axis].max(point[axis])),
            );
        }
        let longitudes: Vec<f64> = row.iter().map(|point| point[0]).collect();
        let jumps = |a: &f64, b: &f64| (a - b).abs() > 90.0;
        let has_seam = longitudes.windows(2).any(|pair| jumps(&pair[0], &pair[1]))
            || above.iter().zip(&longitudes).any(|(a, b)| jumps(a, b));
        if has_seam {
            return Ok(WORLD);
        }
        above = longitudes;
    }
    let hair = [0, 1].map(|axis| HAIR * (high[axis] - low[axis]));
    if low[0] - hair[0] < -180.0 || high[0] + hair[0] > 180.0 {
        // (A raster that extends beyond the antimeridian is on both sides of the map, unless it
        // ends there.)
        let ends_there = low[0] >= -180.0 - 1e-9 && high[0] <= 180.0 + 1e-9;
        (low[0], high[0]) =
            if ends_there { (low[0].max(-180.0), high[0].min(180.0)) } else { (-180.0, 180.0) };
    }
    let latitude = |number: f64| number.clamp(-WEB_MERCATOR_LATITUDE, WEB_MERCATOR_LATITUDE);
    let west = (low[0] - hair[0]).max(-180.0);
    Ok([west, latitude(low[1] - hair[1]), (high[0] + hair[0]).min(180.0), latitude(high[1] + hair[1])])
}
