//! Tiles: squares of a grid, zoom by zoom, as maps ask for them: where they lie, their samples and their colours.
//!
//! A [`TileSource`] gives the samples of tiles: those of the world's square in web mercator, straight from a tree that lies on it
//! ([`TreeTiles::world`]) or warped as they are drawn ([`WarpedTiles`]); or those of a tree's own square ([`TreeTiles::native`]). A
//! [`TilePainter`] is a style made ready for them, and [`draw_tile`] gives the pixels of one tile.
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
mod place;
mod source;
mod tree;
mod warped;

pub use paint::{TileColours, TilePainter, TilePixels, draw_tile};
pub use place::{MAX_ZOOM, TileId, TileRange, check_degrees, first_number};
pub use source::{GeographicExtent, TileContent, TileSamples, TileSource};
pub use tree::TreeTiles;
pub use warped::{WarpedTiles, degrees_of, tile_source};
