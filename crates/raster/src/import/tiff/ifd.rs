//! Access to the file's bytes, its directories (IFDs) and the values of their tags.

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::import::RasterOptions;
use crate::index::stat;
use spinney_base::io::{FileAccess, FileStat, InputFile};
use spinney_base::{Error, Result};
use spinney_chunks::spec::field_type as field;
use spinney_container::shell_word;

/// Maximum number of directories of a file; there may be many pages.
const MAX_DIRECTORIES: usize = 1 << 16;
/// Maximum number of entries in all directories together.
const MAX_CHAINED: u64 = 1 << 20;
/// Maximum number of entries of one directory; the limit of the classic format.
const MAX_ENTRIES: u64 = u16::MAX as u64;

/// An open file, readable from any thread.
pub(super) struct Input {
    file: InputFile,
    /// Length of the file in bytes.
    pub(super) len: u64,
    pub(super) path: PathBuf,
    /// Memory budget in bytes.
    pub(super) memory: u64,
    pub(super) big_endian: bool,
    big: bool,
}

impl Input {
    /// Reads the header of 8 or 16 bytes of a file; also returns the offset of the first directory.
    pub(super) fn new(file: InputFile, path: &Path, options: &RasterOptions) -> Result<(Input, u64)> {
        let len = file.len();
        let (path, memory) = (path.to_path_buf(), options.memory);
        let mut input = Input { file, len, path, memory, big_endian: false, big: false };
        let magic: [u8; 4] = input.bytes_at(0, "header")?;
        (input.big_endian, input.big) = match &magic {
            b"II*\0" => (false, false),
            b"MM\0*" => (true, false),
            b"II+\0" => (false, true),
            b"MM\0+" => (true, true),
            _ => return Err(input.corrupt("header", format!("{magic:02x?}"), "II or MM, then 42 or 43")),
        };
        let first = if input.big { input.u64_at(8, "header")? } else { input.u32_at(4, "header")?.into() };
        Ok((input, first))
    }

    /// Returns length and version of the file.
    pub(super) fn stat(&self, access: &FileAccess) -> Result<FileStat> {
        match self.file.stat(&self.path)? {
            Some(stat) => Ok(stat),
            None => stat(&self.path, access),
        }
    }

    /// The error for a corrupt file.
    pub(super) fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// The error for an unsupported storage of samples.
    pub(super) fn unsupported(&self, found: impl Into<String>) -> Error {
        let file = shell_word(&self.path);
        let advice = format!("rewrite it first (`gdal_translate -co COMPRESS=ZSTD {file} OUT.tif`)");
        Error::unsupported(&self.path, found, advice)
    }

    /// The error for an unsupported sample format.
    pub(super) fn odd_samples(&self, found: impl Into<String>) -> Error {
        let file = shell_word(&self.path);
        let advice = format!("convert its samples first (`gdal_translate -ot Float64 {file} OUT.tif`)");
        Error::unsupported(&self.path, found, advice)
    }

    /// The error for complex numbers.
    pub(super) fn complex_samples(&self, found: impl Into<String>) -> Error {
        let file = shell_word(&self.path);
        let advice = format!(
            "make a file of each part first (`gdal_translate DERIVED_SUBDATASET:REAL:{file} REAL.tif`, and the same with IMAG, AMPLITUDE or PHASE), \
                and build a tree with --stack"
        );
        Error::unsupported(&self.path, found, advice)
    }

    /// The error for data that exceed the memory budget.
    pub(super) fn too_large(&self, what: impl Into<String>, needed: u64) -> Error {
        Error::TooLarge {
            path: self.path.clone(),
            what: what.into(),
            needed,
            limit: self.memory,
            advice: "allow more with `--memory`, or rewrite the file with small tiles".into(),
        }
    }

    /// Fails unless the file has `length` bytes at `offset`.
    pub(super) fn check(&self, offset: u64, length: u64, place: impl Fn() -> String) -> Result<()> {
        match offset.checked_add(length) {
            Some(end) if end <= self.len => Ok(()),
            _ => Err(self.corrupt(
                place(),
                format!("{length} bytes at offset {offset}"),
                format!("an end within the file's {} bytes", self.len),
            )),
        }
    }

    /// Fills `buffer` from `offset`.
    pub(super) fn read_at(&self, offset: u64, buffer: &mut [u8], place: impl Fn() -> String) -> Result<()> {
        self.check(offset, buffer.len() as u64, place)?;
        self.file.read_at(offset, buffer).map_err(Error::io(&self.path, "read"))
    }

    /// Whether reads of other ranges each take a request.
    pub(super) fn is_remote(&self) -> bool {
        self.file.is_remote()
    }

    /// Fetches ranges that will be read, as far as they are inside the file.
    pub(super) fn prefetch(&self, ranges: &[Range<u64>]) -> Result<()> {
        let inside: Vec<_> = ranges.iter().filter(|range| range.end <= self.len).cloned().collect();
        self.file.prefetch(&inside)
    }

    fn bytes_at<const N: usize>(&self, offset: u64, place: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.read_at(offset, &mut bytes, || place.to_string())?;
        Ok(bytes)
    }

    fn u16_at(&self, offset: u64, place: &str) -> Result<u16> {
        let bytes = self.bytes_at(offset, place)?;
        Ok(if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn u32_at(&self, offset: u64, place: &str) -> Result<u32> {
        let bytes = self.bytes_at(offset, place)?;
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn u64_at(&self, offset: u64, place: &str) -> Result<u64> {
        let bytes = self.bytes_at(offset, place)?;
        Ok(if self.big_endian { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) })
    }

    /// Reads the directory at `offset`, and the offset of the next one (0 if none).
    pub(super) fn directory(&self, offset: u64) -> Result<(Directory<'_>, u64)> {
        let place = format!("directory at {offset}");
        let (entries, start, size) = if self.big {
            (self.u64_at(offset, &place)?, offset.saturating_add(8), 20)
        } else {
            (self.u16_at(offset, &place)?.into(), offset.saturating_add(2), 12)
        };
        if entries > MAX_ENTRIES {
            return Err(self.corrupt(place, format!("{entries} entries"), format!("at most {MAX_ENTRIES}")));
        }
        let mut table = vec![0; (entries * size) as usize];
        self.read_at(start, &mut table, || place.clone())?;
        let mut directory = Directory { input: self, offset, listed: entries, entries: BTreeMap::new() };
        for (i, bytes) in table.chunks_exact(size as usize).enumerate() {
            let at = start + i as u64 * size;
            let (tag, kind) = (self.number(&bytes[..2]) as u16, self.number(&bytes[2..4]) as u16);
            let value = if self.big { 12 } else { 8 };
            let count = self.number(&bytes[4..value]);
            let inline = bytes.len() - value;
            let Some(width) = width(kind) else { continue };
            let Some(length) = count.checked_mul(width) else { continue };
            let at = if length <= inline as u64 { at + value as u64 } else { self.number(&bytes[value..]) };
            // Of several entries with one tag the first is used, as in libtiff.
            directory.entries.entry(tag).or_insert(Entry { kind, count, at });
        }
        let end = start + entries * size;
        // Many writers omit the end of the chain if nothing follows.
        let next = if self.big { self.u64_at(end, &place) } else { self.u32_at(end, &place).map(u64::from) };
        Ok((directory, next.unwrap_or(0)))
    }

    /// Iterates over the directories from `offset` on. Stops at a loop or after an error, such as
    /// too many directories.
    pub(super) fn chain(&self, mut offset: u64) -> impl Iterator<Item = Result<LinkedDirectory<'_>>> {
        let (mut seen, mut entries) = (HashSet::new(), 0);
        std::iter::from_fn(move || {
            if offset == 0 || !seen.insert(offset) {
                return None;
            }
            let directory = self.directory(offset);
            entries += directory.as_ref().map_or(0, |(directory, _)| directory.listed);
            if seen.len() > MAX_DIRECTORIES || entries > MAX_CHAINED {
                offset = 0;
                let found =
                    format!("more than {MAX_DIRECTORIES} directories, or {MAX_CHAINED} entries in them,");
                let advice = "write its pages as several files (`tiffsplit`)";
                return Some(Err(Error::unsupported(&self.path, found, advice)));
            }
            offset = directory.as_ref().map_or(0, |(_, next)| *next);
            Some(directory)
        })
    }

    /// Decodes an unsigned number of 1 to 8 bytes in the file's byte order.
    fn number(&self, bytes: &[u8]) -> u64 {
        let push = |n: u64, byte: &u8| n << 8 | *byte as u64;
        if self.big_endian { bytes.iter().fold(0, push) } else { bytes.iter().rev().fold(0, push) }
    }
}

/// Bytes of one value of a TIFF type.
fn width(kind: u16) -> Option<u64> {
    Some(match kind {
        field::BYTE | field::ASCII | field::SBYTE | field::UNDEFINED => 1,
        field::SHORT | field::SSHORT => 2,
        field::LONG | field::SLONG | field::FLOAT | field::IFD => 4,
        field::RATIONAL | field::SRATIONAL | field::DOUBLE | field::LONG8 | field::SLONG8 | field::IFD8 => 8,
        _ => return None,
    })
}

/// Directory entry: type, count and offset of a tag's values.
#[derive(Clone, Copy)]
struct Entry {
    kind: u16,
    count: u64,
    at: u64,
}

/// A directory, and the offset of the next one, or 0.
pub(super) type LinkedDirectory<'a> = (Directory<'a>, u64);

/// The tags of one image of the file. Values are read on demand.
pub(super) struct Directory<'a> {
    input: &'a Input,
    /// Its offset in the file.
    pub(super) offset: u64,
    /// Number of entries in the file.
    listed: u64,
    entries: BTreeMap<u16, Entry>,
}

impl Directory<'_> {
    pub(super) fn has(&self, tag: u16) -> bool {
        self.entries.contains_key(&tag)
    }

    /// Reads a tag's entry and the bytes of its values.
    fn raw(&self, tag: u16) -> Result<Option<(Entry, Vec<u8>)>> {
        let Some(&entry) = self.entries.get(&tag) else { return Ok(None) };
        let length = entry.count.saturating_mul(width(entry.kind).unwrap_or(1));
        let place = || format!("tag {tag}");
        // Check first: allocate memory only for tables that are inside the file.
        self.input.check(entry.at, length, place)?;
        // Each number takes 8 bytes once it is decoded.
        let needed = entry.count.saturating_mul(8);
        if needed > self.input.memory {
            return Err(self.input.too_large(place(), needed));
        }
        let mut bytes = vec![0; length as usize];
        self.input.read_at(entry.at, &mut bytes, place)?;
        Ok(Some((entry, bytes)))
    }

    /// A tag's bytes, whatever their type.
    pub(super) fn bytes(&self, tag: u16) -> Result<Option<Vec<u8>>> {
        Ok(self.raw(tag)?.map(|(_, bytes)| bytes))
    }

    /// A tag's text, up to its first NUL.
    pub(super) fn text(&self, tag: u16) -> Result<Option<String>> {
        Ok(self.bytes(tag)?.map(|bytes| {
            let text = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
            String::from_utf8_lossy(text).into_owned()
        }))
    }

    /// A tag's values as unsigned numbers.
    pub(super) fn numbers(&self, tag: u16) -> Result<Option<Vec<u64>>> {
        let Some((entry, bytes)) = self.raw(tag)? else { return Ok(None) };
        let is_whole = matches!(
            entry.kind,
            field::BYTE
                | field::SBYTE
                | field::UNDEFINED
                | field::SHORT
                | field::SSHORT
                | field::LONG
                | field::SLONG
                | field::IFD
                | field::LONG8
                | field::SLONG8
                | field::IFD8
        );
        if !is_whole {
            return Err(self.input.corrupt(
                format!("tag {tag}"),
                format!("values of type {}", entry.kind),
                "integers",
            ));
        }
        let width = width(entry.kind).unwrap_or(1) as usize;
        Ok(Some(bytes.chunks_exact(width).map(|value| self.input.number(value)).collect()))
    }

    /// The first value of a tag as an unsigned number.
    pub(super) fn number(&self, tag: u16) -> Result<Option<u64>> {
        Ok(self.numbers(tag)?.and_then(|values| values.first().copied()))
    }

    /// A tag's values as floating-point numbers; empty unless they are DOUBLE or RATIONAL.
    pub(super) fn doubles(&self, tag: u16) -> Result<Vec<f64>> {
        let Some((entry, bytes)) = self.raw(tag)? else { return Ok(Vec::new()) };
        let number = |bytes: &[u8]| self.input.number(bytes);
        let double: &dyn Fn(&[u8]) -> f64 = match entry.kind {
            field::RATIONAL => &|value| number(&value[..4]) as f64 / number(&value[4..]) as f64,
            field::DOUBLE => &|value| f64::from_bits(number(value)),
            _ => return Ok(Vec::new()),
        };
        Ok(bytes.chunks_exact(8).map(double).collect())
    }
}
