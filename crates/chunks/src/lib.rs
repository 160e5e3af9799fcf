//! Decoding of the chunks of TIFF images: tiles and strips.
//!
//! A [`ChunkFormat`] describes how the chunks of an image are stored. It decodes the bytes of a
//! chunk, and copies samples of the chunk to rows of pixels. This crate reads no files, and no
//! directories of tags.
//!
//! Without the feature `native`, it compiles for browsers.

mod codec;
mod colour;
mod copy;
mod format;
#[cfg(feature = "native")]
mod native;
#[cfg(not(feature = "native"))]
mod portable;
mod predictor;
mod samples;
#[expect(missing_docs, reason = "the names are those of the specification")]
pub mod spec;
#[cfg(test)]
mod tests;

pub use self::codec::{Compression, DecoderStates};
pub use self::colour::{Colour, Yuv};
pub use self::copy::{ChunkSelection, set_len};
pub use self::format::ChunkFormat;
pub use self::predictor::Predictor;
pub use self::samples::SampleFormat;
