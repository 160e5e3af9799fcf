//! Volumes in NPY files, read cube by cube.

use std::fs::File;
use std::io::{self, Seek};
use std::path::{Path, PathBuf};

use super::super::npy::Header;
use crate::import::SampleFormat;
use spinney_base::io::platform::read_exact_at;
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_engine::store::{Slab, Slabs};

/// Cells along a side of the builder's blocks.
const BLOCK: u64 = 64;
/// Cells along a side of the largest cubes that are read at once: room for all threads.
const MOST: u64 = 256;

/// The samples that a type's name means, and whether they are big-endian.
fn sample_format(descr: &str) -> Option<(SampleFormat, bool)> {
    let (order, name) = descr.split_at_checked(1)?;
    let format = match name {
        "b1" | "u1" => SampleFormat::Uint(8),
        "u2" => SampleFormat::Uint(16),
        "u4" => SampleFormat::Uint(32),
        "u8" => SampleFormat::Uint(64),
        "i1" => SampleFormat::Int(8),
        "i2" => SampleFormat::Int(16),
        "i4" => SampleFormat::Int(32),
        "i8" => SampleFormat::Int(64),
        "f2" => SampleFormat::Float(16),
        "f4" => SampleFormat::Float(32),
        "f8" => SampleFormat::Float(64),
        _ => return None,
    };
    let is_known = matches!(order, "<" | ">") || order == "|" && name.ends_with('1');
    is_known.then_some((format, order == ">"))
}

/// An NPY file of a volume, whose header and length are in order.
pub(super) struct Array {
    path: PathBuf,
    file: File,
    /// Cells along x, y and z.
    pub(super) size: [u64; 3],
    /// Values as trees have them.
    pub(super) value: ValueType,
    /// Description of the file's samples.
    pub(super) layout: String,
    /// Samples in the file.
    pub(super) format: SampleFormat,
    is_big_endian: bool,
    /// Bytes before the samples.
    start: u64,
}

impl Array {
    /// Opens a file, and makes sure that it has all samples that its header tells of.
    pub(super) fn open(path: &Path) -> Result<Array> {
        let mut file = File::open(path).map_err(Error::io(path, "open"))?;
        let header = Header::read(&mut file, path)?;
        let start = file.stream_position().map_err(Error::io(path, "read"))?;
        let unsupported = |found: String, advice: &str| Err(Error::unsupported(path, found, advice));
        if header.fortran_order {
            let advice = "save it in C order: numpy.save(path, numpy.ascontiguousarray(array))";
            return unsupported("an array in Fortran order".into(), advice);
        }
        let shape = header.shape_text();
        let (size, channels) = match header.shape[..] {
            [z, y, x] => ([x, y, z], 1),
            [z, y, x, channels @ 1..=4] => ([x, y, z], channels as u8),
            _ => {
                let advice = "volumes have the dimensions z, y, x, or z, y, x and up to 4 channels; a plane is one \
                              as array[None], a picture as TIFF or PNG";
                return unsupported(format!("an array of shape {shape}"), advice);
            }
        };
        let Some((format, is_big_endian)) = sample_format(&header.descr) else {
            let advice = "convert it with array.astype, to bool, or to integers or floats of at most 8 bytes";
            return unsupported(format!("an array of type `{}`", header.descr.escape_debug()), advice);
        };
        let value = ValueType::new(format.sample(), channels);
        if !value.is_supported() {
            let advice = "several channels can be of 1 or 2 bytes without a sign, or of floats of 2 or 4";
            return unsupported(format!("an array of {channels} channels of `{}`", header.descr), advice);
        }
        if size.contains(&0) {
            return unsupported(
                format!("an array without cells, of shape {shape}"),
                "trees have at least one",
            );
        }
        let cell = format.bits() as u64 / 8 * u64::from(channels);
        let bytes = size.into_iter().try_fold(cell, u64::checked_mul);
        let Some(end) = bytes.and_then(|bytes| bytes.checked_add(start)) else {
            let found = format!("shape {shape}");
            return Err(Error::corrupt(path, "the header", found, "a shape that some file has room for"));
        };
        let length = file.metadata().map_err(Error::io(path, "read the size of"))?.len();
        if length != end {
            let expected = format!("{end} for an array of shape {shape} of `{}`", header.descr);
            return Err(Error::corrupt(path, "the whole file", format!("{length} bytes"), expected));
        }
        Ok(Array {
            path: path.to_path_buf(),
            file,
            size,
            value,
            layout: format!("NPY of {}", header.descr),
            format,
            is_big_endian,
            start,
        })
    }

    /// Samples in a file of nothing else, little-endian, in the order of an array of shape (z, y, x, channels).
    pub(super) fn of_samples(
        path: PathBuf,
        file: File,
        size: [u64; 3],
        value: ValueType,
        format: SampleFormat,
    ) -> Array {
        Array { path, file, size, value, layout: String::new(), format, is_big_endian: false, start: 0 }
    }

    /// The cells in cubes, so small that two of them fit in `memory` bytes, if possible.
    pub(super) fn slabs(self, memory: u64) -> ArraySlabs {
        let mut side = MOST;
        while side > BLOCK && 2 * side.pow(3) * self.value.size() as u64 > memory {
            side /= 2;
        }
        let whole = self.size.into_iter().max().unwrap_or(1).next_power_of_two().max(side);
        ArraySlabs { array: self, cubes: vec![([0; 3], whole)], side, stored: Vec::new() }
    }

    /// Reads the samples of a box of the array into `bytes`, by way of some as the file has them.
    fn read(&self, first: [u64; 3], size: [u64; 3], stored: &mut Vec<u8>, bytes: &mut Vec<u8>) -> Result<()> {
        let [width, height, _] = self.size;
        let sample = self.format.bits() / 8;
        let cell = sample * usize::from(self.value.channels);
        // Rows that follow each other in the file are read at once.
        let rows = if size[0] == width { size[1] } else { 1 };
        let run = (rows * size[0]) as usize;
        stored.resize(run * cell, 0);
        bytes.resize(size.iter().product::<u64>() as usize * self.value.size(), 0);
        let parts = bytes.chunks_exact_mut(run * self.value.size());
        for (row, part) in (0..).step_by(rows as usize).zip(parts) {
            let (y, z) = (first[1] + row % size[1], first[2] + row / size[1]);
            let at = self.start + ((z * height + y) * width + first[0]) * cell as u64;
            read_exact_at(&self.file, stored, at).map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof => {
                    let expected = format!("samples to byte {}", at + stored.len() as u64);
                    Error::corrupt(&self.path, "the samples", "the end of the file", expected)
                }
                _ => Error::io(&self.path, "read")(error),
            })?;
            if self.is_big_endian {
                stored.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
            }
            self.format.widen(stored, 0, part);
        }
        Ok(())
    }
}

/// An array cube by cube, in FD order, so that parts of the tree are finished early.
pub(super) struct ArraySlabs {
    array: Array,
    /// Cubes that are still to be read, the next one last; larger ones than `side` are divided when their turn comes.
    cubes: Vec<([u64; 3], u64)>,
    side: u64,
    /// Samples as the file has them, of a row or of rows that follow each other.
    stored: Vec<u8>,
}

impl ArraySlabs {
    /// First cell and size of the next cube, as far as it is in the array.
    fn next_cube(&mut self) -> Option<([u64; 3], [u64; 3])> {
        let extent = self.array.size;
        loop {
            let (first, side) = self.cubes.pop()?;
            if first.iter().zip(extent).any(|(first, end)| *first >= end) {
                continue;
            }
            if side <= self.side {
                return Some((first, std::array::from_fn(|axis| side.min(extent[axis] - first[axis]))));
            }
            let half = side / 2;
            let child = |place: u64| std::array::from_fn(|axis| first[axis] + half * (place >> axis & 1));
            // In reverse, since the last one is taken first.
            self.cubes.extend((0..8).rev().map(|place| (child(place), half)));
        }
    }
}

impl Slabs for ArraySlabs {
    fn extent(&self) -> [u64; 3] {
        self.array.size
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let Some((origin, size)) = self.next_cube() else { return Ok(false) };
        (slab.origin, slab.size) = (origin, size);
        self.array.read(origin, size, &mut self.stored, &mut slab.bytes)?;
        Ok(true)
    }
}
