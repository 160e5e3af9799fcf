//! What the literature describes, item by item, beside the worked examples of the two formats (`formats/literature.rs`).

#[path = "../common/mod.rs"]
mod common;

mod bintrees;
mod bsp;
mod points;
