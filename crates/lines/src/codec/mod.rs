//! Encoding of blocks of line segments, and of features.

mod features;
mod numbers;
mod segments;

pub(crate) use features::{
    MAX_FEATURES, MAX_TEXT, MAX_VERTICES, decode_features, encode_features, text_bytes, weight,
};
pub(crate) use segments::{LineSegment, MAX_SEGMENTS, decode_segments, encode_segments};
