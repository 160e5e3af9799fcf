//! Cells that stay in rasters of other formats: the sections of an index that describe these
//! rasters, and the reader of their cells.
//!
//! An index is a Goblin file whose finest segments are references (see
//! `engine/src/store/goblin/reference.rs`). Two sections describe where the cells are:
//!
//! - The *list of sources* (`list`) is read when the file is opened. It has how chunks are stored,
//!   and per layer the *placements*: windows of sources, and the cells that they cover.
//! - *Pages* (`pages`) describe the sources, several in each: name, length, version, and tables of
//!   the chunks: offset, length and checksum. Tables of many chunks have pages of their own.
//!
//! [`register`] lets the engine read such cells.

mod cells;
mod contents;
mod list;
mod pages;
mod pixels;
mod placements;
mod sources;
mod table;

pub use self::cells::{open, register};
pub use self::contents::IndexContents;
pub use self::list::{IndexedFile, LayerCells, SOURCE_ADVICE, SourceList, check_format};
pub use self::pages::{DescribedSource, IndexedSource, SourceImage, write_pages};
pub use self::pixels::{PixelRule, paint};
pub use self::placements::{MappedWindow, MappedWindowIndex};
pub use self::table::{Chunk, HOLE};
