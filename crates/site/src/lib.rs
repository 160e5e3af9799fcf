//! The page that shows tree files in a browser: maps, solids and exact models, answered from the file where it lies, without a server.
//!
//! The page is plain files (`page/`), all compiled into the program: HTML, CSS, modules, libraries of other projects (`vendor/`), and the
//! JavaScript package (`spinney/`), whose WebAssembly module `wasm/build.sh` builds. [`export_page`] writes them next to a copy of the data,
//! or everything as one file; a server returns the same files from [`asset`] and [`index`].

mod asset;
mod configuration;
mod content;
mod export;
mod inline;

pub use asset::{Asset, asset};
pub use configuration::{PageConfiguration, PageSource, PageStart, index};
pub use content::PageContent;
pub use export::{PageFile, PageRequest, PageSummary, export_page, inline_page};
