//! PLY files, in text or binary: elements, each a list of records with the same properties.

mod body;
mod header;

pub use body::{Body, Fault, Read, Visit, offset_after, visit};
pub use header::{Element, Encoding, PlyHeader, Property, Scalar};
