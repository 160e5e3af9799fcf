//! Arrangement of a surface's faces: faces that intersect or coincide are divided, and what bounds
//! the body is kept. Exact, up to the rounding of new vertices to the grid.
//!
//! A box tree finds pairs of faces whose boxes touch. The points that two faces have in common
//! ([`meeting`]) divide each of them into regions ([`overlay`]). For a sample point of each region
//! ([`sample`]), the winding numbers on both sides are counted along a ray. The region stays if
//! exactly one side is inside. Faces without contacts stay or go with their neighbours. (The method
//! follows Zhou, Grinspun, Zorin and Jacobson, "Mesh Arrangements for Solid Geometry", 2016, except
//! for the winding numbers: rays need no order of faces around edges.)

mod contact;
mod contacts;
mod copies;
mod delaunay;
mod exact_face;
mod facets;
mod fate;
mod grid_rounding;
mod meeting;
mod operands;
mod orientation;
mod overlay;
mod owner;
mod point;
mod polygons;
mod resolve;
mod rounding;
mod sample;
mod seams;
mod snapping;
mod surface;
mod world;

pub(crate) use contact::Contact;
pub(crate) use delaunay::flip_in_plane;
pub(crate) use exact_face::ExactFace;
pub(crate) use exact_face::ExactFaces;
pub use facets::{UnitedVertex, unite_facets};
pub(crate) use fate::{RegionFate, sample_of_face};
pub(crate) use grid_rounding::Turner;
pub(crate) use grid_rounding::{Rounded, Surroundings, divide, round};
pub(crate) use operands::Operands;
pub(crate) use orientation::{SAMPLES, SurfaceComponents, Turned, root_components};
pub(crate) use overlay::{Corner, VertexKey, Vertices};
pub(crate) use overlay::{PlaneRegion, PlaneSegment, regions};
pub(crate) use owner::{FaceAtSample, FaceOwner, OwnerRule};
pub use point::{ExactPlane, ExactPoint};
pub(crate) use point::{MODULUS, cross, fraction_bits, wide};
pub(crate) use resolve::Resolved;
pub(crate) use sample::{SamplePoint, StoredSample};
pub(crate) use seams::Seams;
pub(crate) use surface::contacts_of;
pub(crate) use surface::{FACE, Surface};
