//! Bytes of buffer views: in the file, in sibling files, embedded as base64, or compressed.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::super::model_file::ModelFile;
use super::super::spill::{SpillBuffer, SpilledBytes};
use super::compressed::decompress;
use super::document::{Buffer, Document, item, string};
use spinney_base::io::FileAccess;
use spinney_base::{Error, Result};

/// Maximum number of sibling files of a model. Each one stays open.
const MAX_FILES: usize = 256;

/// Bytes of all buffer views that are used.
pub(super) struct Buffers {
    /// Bytes of each view; `None` for compressed views until they are decompressed.
    views: BTreeMap<u32, Section>,
    files: Vec<ModelFile>,
    /// Decoded base64.
    embedded: SpilledBytes,
    decompressed: SpilledBytes,
}

/// Bytes of a buffer or view, by the storage that has them.
#[derive(Clone, Debug)]
enum Section {
    Source(Range<usize>),
    File(usize, Range<usize>),
    Embedded(Range<usize>),
    Decompressed(Range<usize>),
}

impl Section {
    /// Part of the section. The range must be within it.
    fn part(&self, part: Range<usize>) -> Section {
        let within = |range: &Range<usize>| range.start + part.start..range.start + part.end;
        match self {
            Section::Source(range) => Section::Source(within(range)),
            Section::File(file, range) => Section::File(*file, within(range)),
            Section::Embedded(range) => Section::Embedded(within(range)),
            Section::Decompressed(range) => Section::Decompressed(within(range)),
        }
    }
}

impl Buffers {
    /// Loads the views with the given indices.
    pub(super) fn load(
        source: &ModelFile,
        document: &Document<'_>,
        binary: Option<Range<usize>>,
        used: &BTreeSet<u32>,
        access: &FileAccess,
        memory: u64,
    ) -> Result<Buffers> {
        let mut needed = BTreeSet::new();
        for index in used {
            let view = item(source, &document.buffer_views, ("buffer view", *index), &"accessors")?;
            let meshopt = view.extensions.as_ref().and_then(|extensions| extensions.meshopt.as_ref());
            needed.insert(meshopt.map_or(view.buffer, |compression| compression.buffer));
        }
        let (mut files, mut sections) = (Vec::new(), BTreeMap::new());
        let mut embedded = Embedded { source, bytes: SpillBuffer::new(source.path(), memory / 2), end: 0 };
        for index in needed {
            let buffer = item(source, &document.buffers, ("buffer", index), &"buffer views")?;
            let place = format!("buffer {index}");
            let text = buffer.uri.map(|uri| string(uri).ok_or(uri)).transpose();
            let uri = text.map_err(|uri| source.corrupt(&place, shown(uri.get()), "a URI in quotes"))?;
            let (section, length) = match uri.as_deref() {
                None => match &binary {
                    Some(range) if index == 0 => (Section::Source(range.clone()), range.len()),
                    _ => return Err(source.corrupt(place, "no URI", "bytes of the buffer")),
                },
                Some(uri) if uri.starts_with("data:") => {
                    let range = embedded.decode(&place, uri)?;
                    let length = range.len();
                    (Section::Embedded(range), length)
                }
                Some(uri) => {
                    if files.len() >= MAX_FILES {
                        let found = format!("glTF with more than {MAX_FILES} files of buffers");
                        return Err(Error::unsupported(source.path(), found, "convert it to binary glTF"));
                    }
                    let path = sibling(source, uri).ok_or_else(|| {
                        let found = format!("a buffer at {}", shown(uri));
                        let advice = "buffers must be in the directory of the model or below it: convert it to binary glTF (.glb)";
                        Error::unsupported(source.path(), found, advice)
                    })?;
                    let file = ModelFile::open(&path, access)?;
                    let length = file.bytes().len();
                    files.push(file);
                    (Section::File(files.len() - 1, 0..length), length)
                }
            };
            let length = length as u64;
            if buffer.byte_length > length {
                let place = match &section {
                    Section::File(file, _) => format!("{place}, {}", files[*file].path().display()),
                    _ => place,
                };
                let found = format!("{length} bytes");
                return Err(source.corrupt(place, found, format!("{}", buffer.byte_length)));
            }
            sections.insert(index, section.part(0..buffer.byte_length as usize));
        }
        let nothing = SpillBuffer::new(source.path(), 0).finish()?;
        let embedded = embedded.bytes.finish()?;
        let mut buffers = Buffers { views: BTreeMap::new(), files, embedded, decompressed: nothing };
        buffers.find_views(source, document, used, &sections, memory)?;
        Ok(buffers)
    }

    /// Finds the bytes of all views, and decompresses those that are compressed.
    fn find_views(
        &mut self,
        source: &ModelFile,
        document: &Document<'_>,
        used: &BTreeSet<u32>,
        sections: &BTreeMap<u32, Section>,
        memory: u64,
    ) -> Result<()> {
        let (mut decompressed, mut end) = (SpillBuffer::new(source.path(), memory / 2), 0);
        for index in used {
            let place = format!("buffer view {index}");
            let view = item(source, &document.buffer_views, ("buffer view", *index), &"accessors")?;
            let meshopt = view.extensions.as_ref().and_then(|extensions| extensions.meshopt.as_ref());
            let (buffer, start, length) = match meshopt {
                Some(packed) => (packed.buffer, packed.byte_offset, packed.byte_length),
                None => (view.buffer, view.byte_offset, view.byte_length),
            };
            let section = sections.get(&buffer).filter(|_| (buffer as usize) < document.buffers.len());
            let size = section.map_or(0, |section| self.bytes_of(source, section).len() as u64);
            let part = start.checked_add(length).filter(|stop| *stop <= size);
            let (Some(section), Some(stop)) = (section, part) else {
                let found = format!("{length} bytes from byte {start}");
                return Err(source.corrupt(
                    place,
                    found,
                    format!("bytes of buffer {buffer}, which has {size}"),
                ));
            };
            let section = section.part(start as usize..stop as usize);
            let section = match meshopt {
                None => section,
                Some(packed) => {
                    let bytes = self.bytes_of(source, &section);
                    let plain = decompress(source, &place, view, packed, bytes, memory)?;
                    // (A few bytes at once: the buffer does not grow by large steps.)
                    plain.chunks(4096).try_for_each(|chunk| decompressed.push(chunk))?;
                    end += plain.len();
                    Section::Decompressed(end - plain.len()..end)
                }
            };
            self.views.insert(*index, section);
        }
        self.decompressed = decompressed.finish()?;
        Ok(())
    }

    fn bytes_of<'a>(&'a self, source: &'a ModelFile, section: &Section) -> &'a [u8] {
        let (bytes, range) = match section {
            Section::Source(range) => (source.bytes(), range),
            Section::File(file, range) => (self.files[*file].bytes(), range),
            Section::Embedded(range) => (self.embedded.bytes(), range),
            Section::Decompressed(range) => (self.decompressed.bytes(), range),
        };
        bytes.get(range.clone()).unwrap_or_default()
    }

    /// Bytes of a view; none if it has not been loaded.
    pub(super) fn view<'a>(&'a self, source: &'a ModelFile, index: u32) -> &'a [u8] {
        self.views.get(&index).map_or(&[], |section| self.bytes_of(source, section))
    }

    /// Reports each face or vertex that is read, as [`ModelFile::passed`] does, for all files.
    pub(super) fn passed(&self, number: u64) {
        self.files.iter().for_each(|file| file.passed(number));
    }
}

/// Decoder of embedded buffers.
struct Embedded<'a> {
    source: &'a ModelFile,
    bytes: SpillBuffer,
    /// Number of bytes so far.
    end: usize,
}

impl Embedded<'_> {
    /// Decodes `data:...;base64,...`; returns the range of the bytes.
    fn decode(&mut self, place: &str, uri: &str) -> Result<Range<usize>> {
        // (A multiple of four characters.)
        const CHUNK: usize = 4096;
        let config = GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
        let engine = GeneralPurpose::new(&base64::alphabet::STANDARD, config);
        let Some((head, text)) = uri.split_once(',').filter(|(head, _)| head.ends_with(";base64")) else {
            return Err(self.source.corrupt(place, shown(uri), "data:application/octet-stream;base64,..."));
        };
        let (start, mut plain) = (self.end, Vec::with_capacity(CHUNK));
        for (number, chunk) in text.as_bytes().chunks(CHUNK).enumerate() {
            plain.clear();
            engine.decode_vec(chunk, &mut plain).map_err(|error| {
                let position = format!("{place}, after character {}", head.len() + 1 + number * CHUNK);
                self.source.corrupt(position, error.to_string(), "base64")
            })?;
            self.bytes.push(&plain)?;
            self.end += plain.len();
        }
        Ok(start..self.end)
    }
}

/// Start of a URI, for messages.
fn shown(uri: &str) -> String {
    let start: String = uri.chars().take(60).collect();
    if start.len() < uri.len() { format!("{start:?}...") } else { format!("{start:?}") }
}

/// Path of a sibling file. Returns `None` unless it is in the model's directory or below it: an
/// untrusted model must not cause other files to be opened.
fn sibling(source: &ModelFile, uri: &str) -> Option<PathBuf> {
    let name = unescaped(uri)?;
    // (Schemes, and drives of Windows.)
    if name.is_empty() || name.contains([':', '\\', '\0']) {
        return None;
    }
    let name = Path::new(&name);
    let is_below = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    is_below.then(|| source.path().parent().unwrap_or(Path::new("")).join(name))
}

/// URI with its percent escapes replaced.
fn unescaped(uri: &str) -> Option<String> {
    let (mut bytes, mut rest) = (Vec::new(), uri.as_bytes());
    while let [first, after @ ..] = rest {
        let escaped = after.get(..2).filter(|_| *first == b'%').and_then(|two| std::str::from_utf8(two).ok());
        let escaped = escaped.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(escaped.unwrap_or(*first));
        rest = if escaped.is_some() { &after[2..] } else { after };
    }
    String::from_utf8(bytes).ok()
}

/// Paths of all sibling files that buffers are in, whether they exist or not.
pub(super) fn siblings(source: &ModelFile, buffers: &[Buffer<'_>]) -> Vec<PathBuf> {
    let uris = buffers.iter().filter_map(|buffer| string(buffer.uri?));
    uris.filter(|uri| !uri.starts_with("data:")).filter_map(|uri| sibling(source, &uri)).collect()
}
