//! Readers of boundary representations, against hand-written files, real ones and hostile ones.
#![cfg(feature = "mesh")]

mod mesh_files;

#[path = "mesh_files/ply.rs"]
mod ply;
#[path = "mesh_files/real.rs"]
mod real;
