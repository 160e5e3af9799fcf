//! LAS and LAZ files: point clouds as surveyors pass them on (ASPRS LAS 1.0 to 1.4; LAZ by laz-rs).

mod format;
mod header;
mod read;

pub use read::LasReader;
