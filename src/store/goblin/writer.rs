//! Writes a Goblin file: header, segments as they come, directory, metadata, trailer.

use std::io::{self, Write};
use std::path::PathBuf;

use zerocopy::IntoBytes;

use super::assemble::SegmentSink;
use super::directory::{Entry, entry_size};
use super::header::{Header, Section, Trailer};
use super::metadata::Metadata;
use super::record::{INNER, LEAF, Layout, VOID};
use super::segment::Segment;
use super::sorter::Sorter;
use crate::store::build::Sealed;
use crate::store::{Output, TreeFormat, folder};
use crate::tree::Child;
use crate::value::Value;
use crate::{Error, Result};

/// A Goblin file being written, append-only.
pub(in crate::store) struct Writer {
    out: Output,
    path: PathBuf,
    position: u64,
    sorter: Sorter,
    stored_records: u64,
}

impl Writer {
    /// Starts a file; about `memory` bytes hold directory entries before they go to a temporary file.
    pub(in crate::store) fn new(out: Output, header: &Header, memory: u64) -> Result<Writer> {
        let path = out.path().to_path_buf();
        let entry_size = entry_size(header.value.channels as usize);
        let sorter = Sorter::new(folder(&path), entry_size, memory);
        let mut writer = Writer { out, path, position: 0, sorter, stored_records: 0 };
        writer.write(&header.to_bytes(TreeFormat::Goblin), "write the header")?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Writes what stands after the segments and puts the file in its place.
    pub(in crate::store) fn finish<V: Value>(self, root: Child<V, ()>, metadata: &Metadata) -> Result<()> {
        let Writer { mut out, path, mut position, sorter, stored_records } = self;
        let metadata = metadata.to_bytes(&path)?;
        let segments = sorter.len();
        let mut section = |position: &mut u64, bytes: &mut dyn FnMut(&mut Checked) -> Result<()>| {
            let mut checked = Checked { out: &mut out, length: 0, checksum: 0 };
            bytes(&mut checked)?;
            let section = Section { offset: *position, length: checked.length, checksum: checked.checksum };
            *position += checked.length;
            Ok::<_, Error>(section)
        };
        let mut sorter = Some(sorter);
        let directory = section(&mut position, &mut |out| {
            let sorter = sorter.take().expect("called once");
            sorter.finish(|entry| out.write_all(entry).map_err(Error::io(&path, "write the directory")))
        })?;
        let metadata = section(&mut position, &mut |out| {
            out.write_all(&metadata).map_err(Error::io(&path, "write the metadata"))
        })?;
        let mut root_value = [0; 32];
        if let Some(value) = root.value() {
            let wire = value.to_wire();
            root_value[..size_of::<V::Wire>()].copy_from_slice(wire.as_bytes());
        }
        let root_state = match root {
            Child::Void => VOID,
            Child::Leaf(_) => LEAF,
            Child::Inner { .. } => INNER,
        };
        let trailer = Trailer { root_state, root_value, segments, stored_records, directory, metadata };
        out.write_all(&trailer.to_bytes(position)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}

impl<D: Layout, V: Value> SegmentSink<D, V> for Writer {
    fn segment(&mut self, segment: Sealed<D, V>) -> Result<()> {
        let offset = self.position;
        let Sealed { code, records, tally } = segment;
        let classes = class_bytes(&tally.classes);
        let checksum = crc32c::crc32c_append(crc32c::crc32c(records.as_bytes()), &classes);
        self.write(records.as_bytes(), "write a segment")?;
        self.write(&classes, "write a segment")?;
        self.stored_records += records.len() as u64;
        let entry: Entry<D, V> = Entry {
            code,
            offset,
            length: self.position - offset,
            records: records.len() as u32,
            classes: tally.classes.len() as u32,
            checksum,
            zone: tally,
        };
        self.sorter.push(code.bits(), entry.to_bytes())
    }

    fn copy(&mut self, segment: &Segment<'_, D, V>, mut entry: Entry<D, V>) -> Result<()> {
        entry.offset = self.position;
        self.write(segment.all_bytes(), "write a segment")?;
        self.stored_records += u64::from(entry.records);
        self.sorter.push(entry.code.bits(), entry.to_bytes())
    }
}

/// Class counts as they stand behind a segment's records: the value, then the cells in 8 bytes.
pub(in crate::store) fn class_bytes<V: Value>(classes: &[(V, u64)]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(classes.len() * (size_of::<V::Wire>() + 8));
    for (value, cells) in classes {
        bytes.extend_from_slice(value.to_wire().as_bytes());
        bytes.extend_from_slice(&cells.to_le_bytes());
    }
    bytes
}

/// Counts and checks what passes through.
struct Checked<'a> {
    out: &'a mut Output,
    length: u64,
    checksum: u32,
}

impl Write for Checked<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.length += written as u64;
        self.checksum = crc32c::crc32c_append(self.checksum, &bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
