//! Writer of OpenEXR: rows in ZIP-compressed blocks.

use exr::block::{BlockIndex, UncompressedBlock};
use exr::meta::attribute::{ChannelDescription, LineOrder, SampleType as ExrType, Text};
use exr::meta::header::{Header, LayerAttributes};
use exr::meta::{BlockDescription, Headers, MetaData, magic_number};
use exr::prelude::{Compression, Vec2};
use rayon::prelude::*;

use super::seekable::Seekable;
use super::{ImageSpec, RowWriter, Rows};
use spinney_base::io::Output;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Rows per block, as defined by ZIP compression.
const BLOCK_ROWS: usize = 16;

struct Exr {
    output: Seekable,
    rows: Rows,
    headers: Headers,
    /// Index among the samples of a pixel, for each channel of the file. OpenEXR sorts channels by
    /// name.
    order: &'static [usize],
    /// Rows of an incomplete block, and a few complete blocks.
    waiting: Vec<u8>,
    /// Index of the first buffered row.
    first_row: usize,
    /// File offset of the block offset table, and the table.
    table_at: u64,
    table: Vec<u8>,
}

pub(super) fn create(output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    let sample = match spec.value.sample {
        SampleType::F32 => ExrType::F32,
        SampleType::U32 => ExrType::U32,
        other => {
            let advice = match other {
                SampleType::U8 | SampleType::U16 => "write .png, .tif or .npy",
                _ => "write .tif or .npy",
            };
            return Err(Error::unsupported(
                output.path(),
                format!("EXR with {} samples", other.name()),
                advice,
            ));
        }
    };
    let (names, order): (&[&str], &[usize]) = match spec.value.channels {
        1 => (&["Y"], &[0]),
        2 => (&["A", "Y"], &[1, 0]),
        3 => (&["B", "G", "R"], &[2, 1, 0]),
        _ => (&["A", "B", "G", "R"], &[3, 2, 1, 0]),
    };
    // The format's own limit.
    let limit = (i32::MAX / 2) as u64;
    if spec.width >= limit || spec.height >= limit {
        return Err(Error::unsupported(output.path(), "EXR with 2^30 or more rows or columns", "write .tif"));
    }
    let channels = names.iter().map(|&name| ChannelDescription::named(name, sample)).collect();
    let header = Header::new(Text::from(""), (spec.width as usize, spec.height as usize), channels)
        .with_attributes(LayerAttributes::default())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing);
    let blocks = header.chunk_count;
    let headers = Headers::from_iter([header]);

    let mut output = Seekable::new(output)?;
    let mut start = Vec::new();
    MetaData::validate(&headers, true)
        .and_then(|requirements| {
            magic_number::write(&mut start)?;
            requirements.write(&mut start)?;
            Header::write_all(&headers, &mut start, false)
        })
        .map_err(|error| failed(&output, error))?;
    output.append(&start)?;
    let table_at = output.position();
    for _ in 0..blocks {
        output.append(&[0; 8])?;
    }
    let (rows, waiting, table) = (Rows::new(spec), Vec::new(), Vec::new());
    Ok(Box::new(Exr { output, rows, headers, order, waiting, first_row: 0, table_at, table }))
}

impl Exr {
    /// Compresses and writes the buffered rows.
    fn write_blocks(&mut self) -> Result<()> {
        let row_bytes = self.rows.row_bytes as usize;
        let (waiting, headers, order) = (&self.waiting, &self.headers, self.order);
        let first_row = self.first_row;
        let compress = |(i, rows): (usize, &[u8])| {
            let index = BlockIndex {
                layer: 0,
                pixel_position: Vec2(0, first_row + i * BLOCK_ROWS),
                pixel_size: Vec2(headers[0].layer_size.0, rows.len() / row_bytes),
                level: Vec2(0, 0),
            };
            let data = rows.chunks_exact(row_bytes).flat_map(|row| planes(row, order)).collect();
            let mut bytes = Vec::new();
            UncompressedBlock { index, data }.compress_to_chunk(headers)?.write(&mut bytes, 1)?;
            Ok(bytes)
        };
        let blocks = waiting.par_chunks(BLOCK_ROWS * row_bytes).enumerate().map(compress);
        let blocks: Vec<Vec<u8>> =
            blocks.collect::<Result<_, _>>().map_err(|error| failed(&self.output, error))?;
        for block in blocks {
            self.table.extend(self.output.position().to_le_bytes());
            self.output.append(&block)?;
        }
        self.first_row += self.waiting.len() / row_bytes;
        self.waiting.clear();
        Ok(())
    }
}

/// Yields a row channel by channel in native byte order, as the encoder requires.
#[allow(clippy::host_endian_bytes)] // the encoder's interface is in native byte order
fn planes(row: &[u8], order: &'static [usize]) -> impl Iterator<Item = u8> {
    let samples = row.as_chunks::<4>().0;
    order.iter().flat_map(move |&channel| {
        let channel = samples.iter().skip(channel).step_by(order.len());
        channel.flat_map(|&sample| u32::from_le_bytes(sample).to_ne_bytes())
    })
}

fn failed(output: &Seekable, error: exr::error::Error) -> Error {
    Error::io(output.path(), "write")(std::io::Error::other(error))
}

impl RowWriter for Exr {
    fn write_rows(&mut self, bytes: &[u8], _: Option<&[bool]>) -> Result<()> {
        self.rows.take(bytes)?;
        let row_bytes = self.rows.row_bytes as usize;
        // Enough blocks for all threads, but only one if blocks are large.
        let batch = ((8 << 20) / (BLOCK_ROWS * row_bytes)).max(1) * BLOCK_ROWS * row_bytes;
        for row in bytes.chunks_exact(row_bytes) {
            self.waiting.extend_from_slice(row);
            if self.waiting.len() == batch {
                self.write_blocks()?;
            }
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.rows.finish()?;
        self.write_blocks()?;
        self.output.patch(self.table_at, &self.table)?;
        self.output.commit()
    }
}
