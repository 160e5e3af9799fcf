//! Map tiles: squares of a grid at each zoom, with their positions, samples and colours.
//!
//! A [`TileSource`] provides the samples of tiles. The tiles divide either the world square of web
//! mercator or a tree's own square. World tiles come straight from a tree on that grid
//! ([`TreeTiles::world`]), or are warped as they are drawn ([`WarpedTiles`]); native tiles are
//! nodes of the tree ([`TreeTiles::native`]). A [`TilePainter`] is a style prepared for a tree's
//! tiles. [`draw_tile`] returns the pixels of one tile.
//!
//! ```
//! # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
//! use spinney::raw::export::tiles::{TileId, TilePainter, TreeTiles, draw_tile};
//! use spinney::style::Style;
//!
//! let map = spinney::open("fixtures/v1/classes.goblin")?;
//! let painter = TilePainter::new(&Style::default_for(&map), &map, &())?;
//! let tile = TileId { zoom: 0, column: 0, row: 0 };
//! let pixels = draw_tile(&TreeTiles::native(&map), &painter, tile, 256)?.expect("it has cells");
//! assert_eq!(pixels.len(), 256 * 256);
//! # Ok::<(), spinney::Error>(())
//! ```

mod paint;
mod source;
mod tile_id;
mod tree;
mod warped;

pub use paint::{TileColours, TilePainter, TilePixels, draw_tile};
pub use source::{GeographicExtent, TileContent, TileSamples, TileSource};
pub use tile_id::{MAX_ZOOM, TileId, TileRange, check_degrees, first_number};
pub use tree::TreeTiles;
pub use warped::{WarpedTiles, degrees_of, tile_source};
