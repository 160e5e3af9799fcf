//! Pictures and solids that are larger than memory, kept as quadtrees and octrees on disk: any part at any level of
//! detail, straight from mapped files.
//!
//! A quadtree halves a picture along both axes until a block has one value all over; an octree does the same with three.
//! A block with more detail keeps one value that stands for it, its *representative*, so that coarse views are read from
//! the upper levels and never touch the cells.
//!
//! # A tour
//!
//! A tree is built in one pass from anything that can hand out its samples, here the rows of a small picture
//! ([`store::build_slabs`]; picture files and meshes: [`import`]):
//!
//! ```
//! use spinney::io::Output;
//! use spinney::space::{Bounds, Dimension};
//! use spinney::store::{BuildOptions, Slab, Slabs, build_slabs, depth_for};
//! use spinney::tree::Form;
//! use spinney::value::{Kind, SampleType, ValueType};
//!
//! /// A picture of 300 x 200 cells: class 1 in the west, class 2 in the east.
//! struct Picture {
//!     next_row: u64,
//! }
//!
//! impl Slabs for Picture {
//!     fn extent(&self) -> [u64; 3] {
//!         [300, 200, 1]
//!     }
//!
//!     // Slabs are rows of blocks: 256 rows, or those that are left.
//!     fn next(&mut self, slab: &mut Slab) -> spinney::Result<bool> {
//!         let rows = (200 - self.next_row).min(256);
//!         slab.origin = [0, self.next_row, 0];
//!         slab.size = [300, rows, 1];
//!         slab.bytes = (0..300 * rows).map(|cell| if cell % 300 < 120 { 1 } else { 2 }).collect();
//!         self.next_row += rows;
//!         Ok(rows > 0)
//!     }
//! }
//!
//! # fn main() -> spinney::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("halves.goblin");
//! let form = Form::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
//! let options = BuildOptions::new(Kind::Categorical, depth_for([300, 200, 1]));
//! build_slabs(form, &mut Picture { next_row: 0 }, None, &options, Output::create(&path)?, &())?;
//!
//! // Whatever the file holds, it is opened by one function; see [`Dataset`](dataset::Dataset) for what can be asked.
//! let map = spinney::open(&path)?;
//! assert_eq!(map.header().form.to_string(), "a quadtree of u8");
//!
//! // A window of any size at any level: here 4 x 2 cells that are 64 times as large as the picture's.
//! let level = map.depth() - 6;
//! let window = Bounds { min: [0, 0, 0], max: [4, 2, 1] };
//! let mut samples = [0; 8];
//! map.window(level, &window, 0.0, &mut samples, None)?;
//! assert_eq!(samples, [1, 1, 2, 2, 1, 1, 2, 2]);
//!
//! // Exact statistics of any part, without looking at its cells.
//! let statistics = map.statistics(None)?;
//! assert_eq!(statistics.classes, [(1.0, 24_000), (2.0, 36_000)]);
//! # Ok(())
//! # }
//! ```
//!
//! # The two formats
//!
//! - [`store::goblin`]: compact and read-only. Records of one size stand in preorder in segments that a directory finds;
//!   statistics stand beside each segment.
//! - [`store::autumnal`]: pointered and edited. Files are append-only; a commit is durable when it returns, and every
//!   commit stays readable. Names that end with `.autumn` get this format, wherever something is written.
//!
//! Both are specified in `formats.md`, and [`open()`] opens both. A Goblin file may hold an exact model instead of a tree of
//! cells: [`brep::ExactModel`] opens it.
//!
//! # Where to look
//!
//! | module | what is there |
//! | --- | --- |
//! | [`dataset`] | a file, or a view of one, and all that can be asked of it |
//! | [`ops`] | views (windows, scaling, rotation), set operations, edits: from files to files |
//! | [`import`], [`export`] | picture files, volumes, meshes and arrays in and out |
//! | `style` | how values become colours, whatever is drawn |
//! | [`store`] | the formats, and building |
//! | [`brep`] | exact models: planar faces on an integer grid, their files, and what can be asked of them |
//! | [`geometry`] | polygons with holes on an integer grid: triangles, bridges, sections with octants |
//! | [`tree`] | sources: everything that can be walked from the root down |
//! | [`space`], [`value`] | codes and boxes of nodes, types of values and how they are averaged |
//! | [`io`] | output that appears whole or not at all, reading mapped or at positions |
//!
//! # Features
//!
//! `raster` has the readers and writers of picture files, and the reader of volumes, `mesh` those of meshes, `cli` the program `spinney`. Without them
//! the library is the trees and their formats alone.

#[cfg(feature = "mesh")]
pub mod brep;
pub mod dataset;
mod error;
pub mod export;
#[cfg(feature = "mesh")]
pub mod geometry;
pub mod import;
pub mod io;
pub mod ops;
mod parallel;
mod progress;
pub mod query;
pub mod space;
pub mod store;
#[cfg(feature = "raster")]
pub mod style;
pub mod tree;
pub mod value;

use std::path::Path;

pub use error::{Error, Result};
#[cfg(feature = "raster")]
pub(crate) use progress::PartOfWork;
pub use progress::Progress;

/// Opens a tree file of either format and any type, or a commit of one: `map.autumn@12` is commit 12 of `map.autumn`.
/// [`dataset::open`] takes options.
///
/// ```
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let mut class = [0.0; 4];
/// assert!(map.point([20, 20, 0], map.depth(), &mut class)?);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If it cannot be read, is no tree file, is damaged, or of a newer version.
pub fn open(path: impl AsRef<Path>) -> Result<dataset::Dataset> {
    dataset::open(path.as_ref(), &store::OpenOptions::new())
}

/// Compiles the README's Rust blocks.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
