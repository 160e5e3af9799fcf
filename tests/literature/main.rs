//! What the literature describes, item by item.

#[path = "../common/mod.rs"]
mod common;

#[cfg(feature = "csg")]
mod csg;
