//! Readers of boundary representations, against hand-written, real and malicious files.

#[path = "mesh_files/mod.rs"]
mod mesh_files;

#[path = "mesh_files/cityjson.rs"]
mod cityjson;
#[path = "mesh_files/gltf.rs"]
mod gltf;
#[path = "mesh_files/gltf_round_trips.rs"]
mod gltf_round_trips;
#[path = "mesh_files/malicious.rs"]
mod malicious;
#[path = "mesh_files/obj.rs"]
mod obj;
#[path = "mesh_files/off.rs"]
mod off;
#[path = "mesh_files/ply.rs"]
mod ply;
#[path = "mesh_files/real.rs"]
mod real;
#[path = "mesh_files/stl.rs"]
mod stl;
