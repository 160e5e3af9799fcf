//! Copying of samples from decoded chunks.

use crate::{ChunkFormat, DecoderStates};

/// Pixels and channels of a decoded chunk.
pub struct ChunkSelection<'a> {
    /// The first column, within the chunk.
    pub left: usize,
    /// The first row, within the chunk.
    pub top: usize,
    /// Columns to copy.
    pub width: usize,
    /// Channels of each output pixel.
    pub chosen: &'a [usize],
    /// If planes have chunks of their own: index in `chosen` of the chunk's channel.
    pub slot: usize,
}

impl ChunkFormat {
    /// Widens samples of a decoded chunk into rows of `selection.width` pixels, which have the
    /// chosen channels. If planes have chunks of their own, only the samples of the channel at
    /// `selection.slot` are written.
    ///
    /// # Panics
    /// If the selection is not within the chunk, a chosen channel does not exist, or a row has
    /// another length.
    pub fn copy(
        &self,
        states: &mut DecoderStates,
        chunk: &[u8],
        selection: &ChunkSelection<'_>,
        rows: &mut [&mut [u8]],
    ) {
        let ChunkSelection { left, top, width, chosen, slot } = *selection;
        let buffer = &mut states.row;
        let planar = self.planes > 1;
        let samples = if planar { 1 } else { self.channels() };
        let row_bytes = self.converted_row_bytes();
        let left = left * samples;
        let size = self.sample_format.sample().size();
        let all = chosen.iter().copied().eq(0..samples);
        for (from, to) in chunk.chunks_exact(row_bytes).skip(top).zip(rows) {
            match self.sample_format.bytes() {
                _ if planar && chosen.len() == 1 || !planar && all => {
                    self.sample_format.widen(from, left, to);
                }
                _ if planar => {
                    set_len(buffer, width * size);
                    self.sample_format.widen(from, left, buffer);
                    let targets = to.chunks_exact_mut(size).skip(slot).step_by(chosen.len());
                    let each = buffer.chunks_exact(size).zip(targets);
                    each.for_each(|(sample, target)| target.copy_from_slice(sample));
                }
                // Pick samples before widening, so that the others are not converted.
                Some(stored) => {
                    set_len(buffer, width * chosen.len() * stored);
                    let pixels = from[left * stored..].chunks_exact(samples * stored);
                    pick(pixels, chosen, stored, buffer);
                    self.sample_format.widen(buffer, 0, to);
                }
                None => {
                    set_len(buffer, width * samples * size);
                    self.sample_format.widen(from, left, buffer);
                    pick(buffer.chunks_exact(samples * size), chosen, size, to);
                }
            }
        }
    }
}

/// Copies the chosen samples of each pixel, of `size` bytes each, to `out`, until that is full.
fn pick<'a>(pixels: impl Iterator<Item = &'a [u8]>, chosen: &[usize], size: usize, out: &mut [u8]) {
    // The usual case: one channel of many.
    if let [channel] = chosen {
        for (pixel, out) in pixels.zip(out.chunks_exact_mut(size)) {
            out.copy_from_slice(&pixel[channel * size..][..size]);
        }
        return;
    }
    for (pixel, out) in pixels.zip(out.chunks_exact_mut(chosen.len() * size)) {
        for (channel, out) in chosen.iter().zip(out.chunks_exact_mut(size)) {
            out.copy_from_slice(&pixel[channel * size..][..size]);
        }
    }
}

/// Sets the length of a buffer whose content will be overwritten.
pub fn set_len(buffer: &mut Vec<u8>, len: usize) {
    if buffer.capacity() < len {
        *buffer = vec![0; len];
    }
    buffer.resize(len, 0);
}
