//! Indexes: trees whose cells stay in TIFF files.

#[path = "../common/mod.rs"]
mod common;
#[allow(dead_code, unreachable_pub)] // what fuzzing alone uses
#[path = "../../fuzz/targets/mod.rs"]
mod targets;

mod compare;
mod corpus;
mod faults;
mod kills;
mod limits;
mod malicious;
mod mosaics;
mod remote;
mod resources;
mod tiffs;
mod update_refusals;
mod updates;
mod variants;
mod writers;
