//! The layer table of a Goblin file: one entry per tree.

use std::io::Write;
use std::path::Path;

use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::file_header::{FileHeader, HEADER_SIZE};
use super::header::{Header, TREE_HEADER_SIZE};
use super::trailer::Section;
use crate::INNER;
use spinney_base::{Error, Result, sort};

/// One tree of a file, as described by the layer table alone.
///
/// Its segments, segment index and the lower levels of the index over the segment index are one
/// contiguous range of bytes, the *run*. All offsets in the run are relative to its start, so it
/// can be copied to another file unchanged.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name; may be empty if it is the only layer.
    pub name: String,
    /// Header of the tree.
    pub header: Header,
    /// State of the root: VOID, LEAF or INNER.
    pub root_state: u8,
    /// Value or representative of the root in the on-disk encoding, padded with zeros.
    pub root_value: [u8; 16],
    /// Number of segments, and of entries in the segment index.
    pub segments: u64,
    /// Number of record slots in all segments.
    pub stored_records: u64,
    /// Location of the run. Its checksum is not used.
    pub run: Section,
    /// Offset in the run of the segments of the top levels.
    pub top_levels: u64,
    /// Offset in the run of the segment index, which follows the segments.
    pub directory: u64,
    /// The top of the index over the pages of the segment index.
    pub top: Section,
    /// The metadata.
    pub metadata: Section,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawLayer {
    header: [u8; TREE_HEADER_SIZE],
    root_state: u8,
    zero: [u8; 5],
    /// Bytes of the name.
    name: U16,
    root_value: [u8; 16],
    segments: U64,
    stored_records: U64,
    run_offset: U64,
    run_length: U64,
    top_levels: U64,
    directory: U64,
    top_offset: U64,
    top_length: U32,
    top_checksum: U32,
    metadata_offset: U64,
    metadata_length: U32,
    metadata_checksum: U32,
}

const _: () = assert!(size_of::<RawLayer>() == 152);

/// Encoder and decoder of a file's layer table.
pub struct LayerTable;

impl LayerTable {
    /// Tag of the section.
    pub const TAG: [u8; 4] = *b"LAYR";

    /// Encodes the section: an entry for each layer, then all names.
    ///
    /// # Errors
    /// If a name has more than 65535 bytes.
    pub fn to_bytes(path: &Path, layers: &[Layer]) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(layers.len() * (size_of::<RawLayer>() + 8));
        for layer in layers {
            let Ok(name) = u16::try_from(layer.name.len()) else {
                let found = format!("a name of {} bytes", layer.name.len());
                return Err(Error::unsupported(path, found, "use at most 65535 bytes"));
            };
            let raw = RawLayer {
                header: layer.header.to_bytes(),
                root_state: layer.root_state,
                zero: [0; 5],
                name: name.into(),
                root_value: layer.root_value,
                segments: layer.segments.into(),
                stored_records: layer.stored_records.into(),
                run_offset: layer.run.offset.into(),
                run_length: layer.run.length.into(),
                top_levels: layer.top_levels.into(),
                directory: layer.directory.into(),
                top_offset: layer.top.offset.into(),
                top_length: (layer.top.length as u32).into(),
                top_checksum: layer.top.checksum.into(),
                metadata_offset: layer.metadata.offset.into(),
                metadata_length: (layer.metadata.length as u32).into(),
                metadata_checksum: layer.metadata.checksum.into(),
            };
            bytes.extend_from_slice(raw.as_bytes());
        }
        layers.iter().try_for_each(|layer| bytes.write_all(layer.name.as_bytes())).expect("a vector grows");
        Ok(bytes)
    }

    /// Checks and decodes the section. `file_length` is the file size in bytes.
    ///
    /// # Errors
    /// If an entry is invalid or a layer is not inside the file or its run is not in order, if
    /// names are missing or not unique, or if ranges of layers overlap.
    pub fn from_bytes(path: &Path, file: &FileHeader, file_length: u64, bytes: &[u8]) -> Result<Vec<Layer>> {
        let corrupt =
            |place: &str, found: String, expected: &str| Error::corrupt(path, place, found, expected);
        let count = file.layers as usize;
        let Ok((list, mut names)) = <[RawLayer]>::ref_from_prefix_with_elems(bytes, count) else {
            let found = format!("{} bytes for {count} layers", bytes.len());
            return Err(corrupt("table of layers", found, "152 bytes for each"));
        };
        let mut layers = Vec::with_capacity(count);
        for (number, raw) in list.iter().enumerate() {
            let place = if count > 1 { format!("layer {number}") } else { "tree header".into() };
            let header = Header::from_bytes(path, &place, &raw.header, (file.dimension, file.depth))?;
            let section =
                |offset: U64, length: u64, checksum: u32| Section { offset: offset.get(), length, checksum };
            let name = match names.split_at_checked(raw.name.get().into()) {
                Some((name, rest)) => {
                    names = rest;
                    std::str::from_utf8(name).ok()
                }
                None => None,
            };
            let Some(name) = name else {
                return Err(corrupt(
                    &place,
                    format!("a name of {} bytes", raw.name),
                    "a UTF-8 name inside the table",
                ));
            };
            let layer = Layer {
                name: name.into(),
                header,
                root_state: raw.root_state,
                root_value: raw.root_value,
                segments: raw.segments.get(),
                stored_records: raw.stored_records.get(),
                run: section(raw.run_offset, raw.run_length.get(), 0),
                top_levels: raw.top_levels.get(),
                directory: raw.directory.get(),
                top: section(raw.top_offset, raw.top_length.get().into(), raw.top_checksum.get()),
                metadata: section(
                    raw.metadata_offset,
                    raw.metadata_length.get().into(),
                    raw.metadata_checksum.get(),
                ),
            };
            if layer.root_state > INNER || (layer.root_state == INNER) != (layer.segments > 0) {
                let found = format!("root state {} and {} segments", layer.root_state, layer.segments);
                return Err(corrupt(&place, found, "0, 1 or 2, and segments if it is 2"));
            }
            let is_inside = |section: &Section| {
                let end = section.offset.checked_add(section.length);
                section.offset >= HEADER_SIZE as u64 && end.is_some_and(|end| end <= file_length)
            };
            let is_ordered = layer.top_levels <= layer.directory && layer.directory <= layer.run.length;
            if ![layer.run, layer.top, layer.metadata].iter().all(is_inside) || !is_ordered {
                let found = format!("{} bytes of segments at {}", layer.run.length, layer.run.offset);
                return Err(corrupt(
                    &place,
                    found,
                    "sections inside the file, and segments before the segment index",
                ));
            }
            layers.push(layer);
        }
        // Several layers must have unique, non-empty names.
        let mut seen = std::collections::HashSet::new();
        if count > 1
            && let Some(layer) =
                layers.iter().find(|layer| layer.name.is_empty() || !seen.insert(&layer.name))
        {
            return Err(corrupt(
                "table of layers",
                format!("the name `{}`", layer.name),
                "unique names that are not empty",
            ));
        }
        if !names.is_empty() {
            let found = format!("{} bytes after the names", names.len());
            return Err(corrupt("table of layers", found, "none"));
        }
        // Otherwise a small file could make a reader read large overlapping layers many times.
        let mut parts: Vec<Section> = layers
            .iter()
            .flat_map(|layer| [layer.run, layer.top, layer.metadata])
            .filter(|part| part.length > 0)
            .collect();
        sort::by_key(&mut parts, |part| part.offset);
        if let Some(pair) = parts.windows(2).find(|pair| pair[0].offset + pair[0].length > pair[1].offset) {
            let [Section { offset, length, .. }, second] = [pair[0], pair[1]];
            let found = format!("{length} bytes at {offset} and others at {}", second.offset);
            return Err(corrupt("table of layers", found, "sections of layers that do not overlap"));
        }
        Ok(layers)
    }
}
