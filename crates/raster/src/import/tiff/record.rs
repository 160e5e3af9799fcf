//! Records of images for an index.

use std::sync::Arc;

use super::super::plan::depth_of;
use super::ifd::Input;
use super::image::Image;
use super::layout::{ChunkLocation, ChunkPosition};
use crate::index::{RecordedChunks, RecordedImage};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_chunks::Compression;
use spinney_references::{SOURCE_ADVICE, check_format};

/// Bytes of memory for the record of a chunk.
const RECORD_BYTES: u64 = 24;

impl Image {
    /// Checks that readers of an index accept the image, before any cell is read for one.
    ///
    /// # Errors
    /// If they do not, or the records of the chunks exceed the memory.
    pub(super) fn check_indexable(&self, input: &Input) -> Result<()> {
        let [width, height] = [self.layout.width, self.layout.height];
        let size = format!("{width} x {height} pixels");
        depth_of(Dimension::Quad, [width, height, 1], (&input.path, &size), None)?;
        check_format(&input.path, &self.format)?;
        // Strips without compression are divided, so a file of few bytes may have any number of
        // chunks.
        let needed = self.layout.count().saturating_mul(RECORD_BYTES);
        if needed > input.memory {
            return Err(input.too_large("the record of its tiles or strips", needed));
        }
        let limit = self.format.max_stored_bytes();
        for chunk in self.layout.chunks() {
            let (offset, length) = self.stored(input, chunk);
            let (plane, across, down) = chunk;
            let name = || self.layout.name(plane, across, down);
            input.check(offset, length, name)?;
            if length > limit {
                let found = format!("an index of a {} of {length} bytes, more than {limit},", name());
                return Err(Error::unsupported(&input.path, found, SOURCE_ADVICE));
            }
        }
        Ok(())
    }

    /// Returns a record of an image that [`Image::check_indexable`] accepts.
    pub(super) fn record(&self, input: &Input) -> RecordedImage {
        let chunks = self.layout.chunks().map(|chunk| self.stored(input, chunk)).collect();
        RecordedImage { format: self.format.clone(), chunks: Arc::new(RecordedChunks::new(chunks)) }
    }

    /// Returns the offset and the number of the bytes that are read of a chunk; 0 bytes if it was
    /// never written.
    fn stored(&self, input: &Input, (plane, across, down): ChunkPosition) -> (u64, u64) {
        let ChunkLocation::At(offset, count) = self.layout.location(plane, across, down) else {
            return (0, 0);
        };
        let length = match self.format.compression {
            // A strip's byte count may include more rows; readers require exactly the bytes of the
            // chunk's rows.
            Compression::None => {
                let rows = self.layout.region(across, down).height as usize;
                self.format.decoded_bytes(rows).0 as u64
            }
            _ => count.unwrap_or_else(|| self.assumed_length(input, offset)),
        };
        (offset, length)
    }
}
