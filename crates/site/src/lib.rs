//! The page that shows tree files in a browser: maps, solids and exact models, answered from the file where it lies, without a server.
//!
//! The page is plain files (`page/`): one of HTML, one of CSS, modules, and libraries of others as they were built. With them goes the package for
//! browsers as `wasm/build.sh` makes it, if that was done before this crate was compiled. [`export_page`] writes all of it beside a copy
//! of the data, or as one file; a server gives the same files from [`asset`] and [`index`].

mod asset;
mod configuration;
mod export;
mod inline;

pub use asset::{Asset, asset};
pub use configuration::{PageConfiguration, PageSource, PageStart, index};
pub use export::{PageFile, PageRequest, PageSummary, export_page, inline_page, is_map};
