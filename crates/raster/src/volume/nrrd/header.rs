//! Parser of NRRD headers.

use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};

use super::super::array::ArrayLayout;
use super::MAGIC;
use super::field;
use super::frame_fields;
use spinney_base::{Error, Result};
use spinney_container::{Metadata, TagScope};

/// Maximum size of a header in bytes.
const MOST: u64 = 1 << 20;
/// The latest supported version of the format.
const NEWEST: u8 = b'5';
/// Domain of the tags that hold fields.
pub(super) const DOMAIN: &str = "NRRD";

/// Location of the samples.
#[derive(Debug, PartialEq)]
pub(super) enum DataLocation {
    /// After the header.
    Here,
    /// In a data file; the path is relative to the header's directory.
    File(String),
}

/// Encoding of the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    Raw,
    Gzip,
}

/// The header of a volume.
pub(super) struct Header {
    pub(super) layout: ArrayLayout,
    pub(super) encoding: Encoding,
    pub(super) data: DataLocation,
    /// Lines to skip before the samples.
    pub(super) line_skip: u64,
    /// Bytes to skip before the samples; `None` if the samples are the end of the file.
    pub(super) byte_skip: Option<u64>,
    /// Name of the sample type.
    pub(super) kind_words: String,
    pub(super) metadata: Metadata,
}

/// Fields with their line numbers.
pub(super) struct Fields<'a> {
    path: &'a Path,
    fields: BTreeMap<String, (u64, String)>,
}

impl Fields<'_> {
    /// Removes and returns a field, by one of its names.
    pub(super) fn take(&mut self, names: &[&str]) -> Option<(u64, String)> {
        names.iter().find_map(|name| self.fields.remove(*name))
    }

    /// Puts a field back, so that it becomes a tag.
    pub(super) fn keep(&mut self, name: &str, line: u64, text: String) {
        self.fields.insert(name.into(), (line, text));
    }

    /// Removes and returns a required field.
    fn needed(&mut self, name: &str) -> Result<(u64, String)> {
        self.take(&[name])
            .ok_or_else(|| Error::corrupt(self.path, "header", "the end", format!("the field `{name}`")))
    }

    /// The error for an invalid field.
    pub(super) fn wrong(&self, line: u64, found: &str, expected: impl Into<String>) -> Error {
        let found: String = found.chars().take(60).flat_map(char::escape_debug).collect();
        Error::corrupt(self.path, format!("line {line}"), format!("`{found}`"), expected)
    }
}

impl Header {
    /// The data file, if there is one. `path` is that of the header.
    pub(super) fn detached_data(&self, path: &Path) -> Option<PathBuf> {
        match &self.data {
            DataLocation::Here => None,
            DataLocation::File(name) => Some(path.parent().unwrap_or(Path::new("")).join(name)),
        }
    }

    /// Reads a header. `input` is left at the first byte after it.
    ///
    /// # Errors
    /// If it cannot be read, is longer than 1 MiB, violates the format, or describes anything but a
    /// volume that trees support.
    pub(super) fn read(input: &mut dyn BufRead, path: &Path) -> Result<Header> {
        let (mut fields, tags) = read_fields(input, path)?;
        let unsupported = |found: String, advice: &str| Error::unsupported(path, found, advice);

        let (line, kind_words) = fields.needed("type")?;
        let Some(format) = field::format(&kind_words) else {
            return Err(match &*kind_words {
                "block" => unsupported(
                    "samples of type block".into(),
                    "they are not numbers; convert them to another type",
                ),
                other => fields.wrong(line, other, "a type, as in `type: unsigned short`"),
            });
        };
        let (line, text) = fields.needed("dimension")?;
        let dimension: usize = match text.parse() {
            Ok(dimension @ 1..=16) => dimension,
            _ => return Err(fields.wrong(line, &text, "a number of axes from 1 to 16")),
        };
        let (line, text) = fields.needed("sizes")?;
        let sizes: Option<Vec<u64>> = field::words(&text, dimension)
            .and_then(|words| words.iter().map(|word| word.parse().ok().filter(|size| *size > 0)).collect());
        let sizes = sizes.ok_or_else(|| {
            fields.wrong(line, &text, format!("{dimension} numbers of samples, at least 1 each"))
        })?;
        let (channels, size) = match sizes[..] {
            [x, y, z] => (1, [x, y, z]),
            [channels @ 1..=4, x, y, z] => (channels as u8, [x, y, z]),
            _ => {
                let sizes = sizes.iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
                let advice = "volumes have three axes, or one of up to 4 channels before these: `unu permute` changes their order, `unu slice` selects a \
                              part; convert images to PNG or TIFF";
                return Err(unsupported(format!("an array of {sizes} samples"), advice));
            }
        };

        // A short time axis must not be taken for channels.
        let kinds = fields.fields.get("kinds").map(|(_, text)| text.to_ascii_lowercase());
        let is_place = |kind: &str| matches!(kind, "domain" | "space" | "time");
        if let ([_, _, _, _], Some(kinds)) = (&sizes[..], kinds)
            && kinds.split_ascii_whitespace().next().is_some_and(is_place)
        {
            let advice = "only channels may precede three spatial axes: `unu permute` changes the order of axes, `unu slice` selects a volume";
            return Err(unsupported(format!("four axes that are {kinds}"), advice));
        }

        let (line, text) = fields.needed("encoding")?;
        let encoding = match &*text.to_ascii_lowercase() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            "txt" | "text" | "ascii" | "hex" | "bz2" | "bzip2" => {
                let advice = "convert it: `unu save -f nrrd -e gzip -i IN -o OUT.nrrd`";
                return Err(unsupported(format!("the encoding {text}"), advice));
            }
            _ => return Err(fields.wrong(line, &text, "an encoding: raw or gzip")),
        };
        let is_big_endian = match (fields.take(&["endian"]), format.bits()) {
            (_, 8) => false,
            (Some((line, text)), _) => match &*text.to_ascii_lowercase() {
                "little" => false,
                "big" => true,
                _ => return Err(fields.wrong(line, &text, "little or big")),
            },
            (None, _) => {
                return Err(Error::corrupt(
                    path,
                    "header",
                    "the end",
                    "the field `endian`, since samples have several bytes",
                ));
            }
        };
        let data = match fields.take(&["data file", "datafile"]) {
            None => DataLocation::Here,
            // A list of files, or a pattern of names with a first and a last number.
            Some((_, text)) if text == "LIST" || text.starts_with("LIST ") || text.contains('%') => {
                let advice = "join them into one: `unu save -f nrrd -i IN.nhdr -o OUT.nrrd`";
                return Err(unsupported("samples in several files".into(), advice));
            }
            Some((line, text)) if text.is_empty() => {
                return Err(fields.wrong(line, &text, "a file name"));
            }
            Some((_, text)) => DataLocation::File(text),
        };
        let line_skip = match fields.take(&["line skip", "lineskip"]) {
            None => 0,
            Some((line, text)) => text.parse().map_err(|_| fields.wrong(line, &text, "a number of lines"))?,
        };
        let byte_skip = match fields.take(&["byte skip", "byteskip"]) {
            None => Some(0),
            Some((_, text)) if text == "-1" && encoding == Encoding::Raw => None,
            Some((line, text)) => Some(
                text.parse()
                    .map_err(|_| fields.wrong(line, &text, "a number of bytes, or -1 in raw files"))?,
            ),
        };

        let mut metadata = Metadata { tags, ..Metadata::default() };
        frame_fields::read_frame(&mut fields, dimension, usize::from(dimension == 4), size, &mut metadata)?;
        if let Some((_, unit)) = fields.take(&["sample units", "sampleunits"]) {
            metadata.units = vec![unit; usize::from(channels)];
        }
        let others: BTreeMap<String, String> =
            std::mem::take(&mut fields.fields).into_iter().map(|(name, (_, text))| (name, text)).collect();
        if !others.is_empty() {
            metadata.scoped_tags.insert(TagScope { channel: None, domain: DOMAIN.into() }, others);
        }
        let layout = ArrayLayout { size, format, channels, is_big_endian };
        Ok(Header { layout, encoding, data, line_skip, byte_skip, kind_words, metadata })
    }
}

/// Reads all lines: fields by their lowercase names, and key/value pairs by their keys.
fn read_fields<'a>(
    input: &mut dyn BufRead,
    path: &'a Path,
) -> Result<(Fields<'a>, BTreeMap<String, String>)> {
    let mut input = input.take(MOST);
    let mut fields = Fields { path, fields: BTreeMap::new() };
    let mut tags = BTreeMap::new();
    let (mut line, mut number) = (Vec::new(), 0u64);
    loop {
        line.clear();
        number += 1;
        let count = input.read_until(b'\n', &mut line).map_err(Error::io(path, "read the header"))?;
        if count == 0 && input.limit() == 0 {
            return Err(Error::corrupt(path, "header", "more than 1 MiB", "an empty line after it"));
        }
        while line.last().is_some_and(|byte| matches!(byte, b'\n' | b'\r')) {
            line.pop();
        }
        if number == 1 {
            if !matches!(line[..], [b'N', b'R', b'R', b'D', b'0', b'0', b'0', b'1'..=NEWEST]) {
                let found: String =
                    String::from_utf8_lossy(&line).chars().take(60).flat_map(char::escape_debug).collect();
                let magic = String::from_utf8_lossy(MAGIC);
                return Err(Error::corrupt(
                    path,
                    "line 1",
                    format!("`{found}`"),
                    format!("`{magic}1` to `{magic}5`"),
                ));
            }
            continue;
        }
        // A header with a data file ends with its file.
        if line.is_empty() {
            return Ok((fields, tags));
        }
        // Older programs wrote other encodings than UTF-8.
        let text = String::from_utf8_lossy(&line);
        if text.starts_with('#') {
            continue;
        }
        // A key/value pair, which any program may add, or a field.
        let name_end =
            [text.find(":="), text.find(": ").or_else(|| text.ends_with(':').then(|| text.len() - 1))];
        match name_end {
            [Some(key), field] if field.is_none_or(|field| key < field) => {
                tags.insert(field::unescaped(&text[..key]), field::unescaped(&text[key + 2..]));
            }
            [_, Some(field)] => {
                let (name, value) =
                    (text[..field].trim().to_ascii_lowercase(), text[field + 1..].trim().to_owned());
                if fields.fields.insert(name.clone(), (number, value)).is_some() {
                    return Err(fields.wrong(number, &name, "each field once"));
                }
            }
            _ => return Err(fields.wrong(number, &text, "a field, as in `sizes: 64 64 32`")),
        }
    }
}
