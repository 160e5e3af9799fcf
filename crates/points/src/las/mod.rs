//! LAS and LAZ files, the exchange formats of survey point clouds (ASPRS LAS 1.0 to 1.4; LAZ by
//! laz-rs).

mod chunks;
mod format;
mod header;
mod read;
mod several;
#[cfg(test)]
pub(crate) mod tests;
mod write;

pub use read::LasReader;
pub use several::LasFiles;
pub(crate) use write::{Fields, LasFile};
