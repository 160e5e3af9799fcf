//! A web page that shows tree files: maps, octrees and exact models. It reads the files directly in
//! the browser; no server computes anything.
//!
//! The page consists of plain files (`page/`), which are embedded in the binary: HTML, CSS,
//! modules, third-party libraries (`vendor/`), and the JavaScript package (`spinney/`) with the
//! WebAssembly module that `wasm/build.sh` builds. [`export_page`] writes them next to a copy of
//! the data, or everything as one file. A server returns the same files with [`asset`] and
//! [`index`].

mod asset;
mod configuration;
mod content;
mod export;
mod inline;

pub use asset::{Asset, asset};
pub use configuration::{PageConfiguration, PageSource, PageStart, index};
pub use content::PageContent;
pub use export::{PageFile, PageRequest, PageSummary, export_page, inline_page};
