//! PLY: elements, each of which has the same properties, as text or binary.

mod body;
mod header;

pub use body::{Body, Fault, Read, Visit, offset_behind, visit};
pub use header::{Element, Encoding, PlyHeader, Property, Scalar};
