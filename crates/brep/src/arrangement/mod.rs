//! Arrangement of a surface's faces: where they pass through each other or lie on each other they are divided, and what
//! bounds the body is kept. Exact, up to the rounding of new vertices to the grid.
//!
//! Pairs of faces whose boxes touch are looked for in a tree; what their triangles have in common ([`meeting`]) divides
//! each of the two into regions ([`overlay`]); for a point of each region ([`sample`]) the winding numbers on both sides
//! are counted along a line, and the region stays if one side is inside and the other is not. Faces that meet nothing
//! stay or go together with those beside them. (The scheme is that of Zhou, Grinspun, Zorin and Jacobson, "Mesh
//! Arrangements for Solid Geometry", 2016, but for the winding numbers, which need no order around edges here.)

mod contact;
mod contacts;
mod delaunay;
mod exact_face;
mod fate;
mod meeting;
mod orientation;
mod overlay;
mod point;
mod polygons;
mod rounding;
mod rounds;
mod sample;
mod seams;
mod snapping;
mod surface;
mod world;

pub(crate) use contact::Contact;
pub(crate) use delaunay::flip_in_plane;
pub(crate) use exact_face::ExactFace;
pub(crate) use exact_face::ExactFaces;
pub(crate) use overlay::{Corner, VertexKey, Vertices};
pub(crate) use overlay::{PlaneRegion, PlaneSegment, regions};
pub use point::{ExactPlane, ExactPoint};
pub(crate) use point::{cross, wide};
pub(crate) use rounds::Turner;
pub(crate) use rounds::{Rounded, Surroundings, divide, round};
pub(crate) use sample::SamplePoint;
pub(crate) use seams::Seams;
pub(crate) use surface::Resolved;
pub(crate) use surface::{FACE, Operands, Surface};
