//! Writer of archives.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use super::directory::{self, DirectoryEntry};
use super::header::{ByteRange, HEADER, Header, START, tile_type};
use crate::tile_archives::encode::Encoded;
use crate::tile_archives::journal::{Checkpoint, Entry, Journal, not_ours, other_export};
use crate::tile_archives::provenance::{Digest, TilesetMetadata};
use crate::tile_archives::sink::{TileArchiveSummary, TileSink};
use crate::tile_archives::walk::TileSpan;
use spinney_base::io::{Output, directory_of, partial_of};
use spinney_base::{Error, Result};
use spinney_tiles::TileId;

/// An archive that is being written.
pub(in crate::tile_archives) struct PmtilesSink {
    output: Output,
    journal: Journal,
    at: Checkpoint,
    /// Offset and length of contents, by their hash, up to a limit.
    known: HashMap<u128, (u64, u32)>,
}

/// Maximum number of remembered contents. Repetitions of these are stored once.
const MAX_REMEMBERED: usize = 1 << 19;

/// Entries per leaf directory in the first attempt.
const LEAF: usize = 4096;

impl PmtilesSink {
    /// Starts an archive, or resumes an interrupted one with `provenance`, which describes the
    /// export.
    pub(in crate::tile_archives) fn create(output: Output, provenance: Option<&str>) -> Result<PmtilesSink> {
        let path = output.path().to_path_buf();
        if !output.is_file() {
            let advice = "give a file name, since the start of an archive is written last";
            return Err(Error::unsupported(path, "writing an archive of tiles to a stream", advice));
        }
        let mut known = HashMap::new();
        let Some(provenance) = provenance else {
            let journal = Journal::temporary(directory_of(&path))?;
            let mut sink = PmtilesSink { output, journal, at: Checkpoint::default(), known };
            sink.start()?;
            return Ok(sink);
        };
        drop(output);
        let (output, there) = Output::resumable(&path)?;
        let partial = partial_of(&path);
        let mut name = partial.clone().into_os_string();
        name.push(".journal");
        let mut remember = |entry: Entry| {
            if known.len() < MAX_REMEMBERED {
                known.entry(entry.hash).or_insert((entry.offset, entry.length));
            }
        };
        let name = Path::new(&name);
        if there > 0 && !name.exists() {
            return Err(not_ours(&partial));
        }
        // A journal without an archive belongs to an export that was finished or removed.
        let (journal, at) = Journal::resumable(name, provenance, there == 0, &mut remember)?;
        let needed = if at.runs == 0 { 0 } else { START as u64 + at.bytes };
        if there < needed {
            return Err(other_export(&partial));
        }
        let mut sink = PmtilesSink { output, journal, at, known };
        sink.output.truncate(needed).map_err(Error::io(&path, "write"))?;
        if at.runs == 0 {
            sink.start()?;
        }
        Ok(sink)
    }

    /// Reserves space for the header and the root directory.
    fn start(&mut self) -> Result<()> {
        self.write(&[0; START])
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.output.write_all(bytes).map_err(Error::io(self.output.path(), "write"))
    }

    /// Yields entries for directories. Adjacent equal entries are merged, as long as their count
    /// fits 32 bits.
    fn merged(&mut self, mut each: impl FnMut(DirectoryEntry, u128) -> Result<()>) -> Result<()> {
        let mut last: Option<Entry> = None;
        let mut emit = |entry: Entry| {
            let mut at = entry.first;
            let end = entry.first + entry.count;
            while at < end {
                let run = (end - at).min(u32::MAX.into()) as u32;
                each(
                    DirectoryEntry { first: at, offset: entry.offset, length: entry.length, run },
                    entry.hash,
                )?;
                at += u64::from(run);
            }
            Ok(())
        };
        self.journal.entries(|entry| {
            if let Some(last) = &mut last
                && last.first + last.count == entry.first
                && last.offset == entry.offset
            {
                last.count += entry.count;
                return Ok(());
            }
            last.replace(entry).map_or(Ok(()), &mut emit)
        })?;
        last.map_or(Ok(()), emit)
    }

    /// Writes leaf directories of `size` entries each, if their root directory fits its reserved
    /// space. Returns the root directory and the leaf directories' length.
    fn leaves(&mut self, size: usize) -> Result<Option<(Vec<u8>, u64)>> {
        let (mut root, mut leaf, mut written) = (Vec::new(), Vec::new(), 0);
        let output_path = self.output.path().to_path_buf();
        let mut pending = Vec::new();
        let mut file = tempfile::tempfile_in(directory_of(&output_path))
            .map_err(Error::io(&output_path, "create a temporary file next to it"))?;
        let mut flush = |leaf: &mut Vec<DirectoryEntry>| -> Result<()> {
            let Some(first) = leaf.first().map(|entry| entry.first) else { return Ok(()) };
            let bytes = directory::to_bytes(leaf);
            root.push(DirectoryEntry { first, offset: written, length: bytes.len() as u32, run: 0 });
            written += bytes.len() as u64;
            file.write_all(&bytes).map_err(Error::io(&output_path, "use a temporary file next to it"))?;
            leaf.clear();
            Ok(())
        };
        self.merged(|entry, _| {
            leaf.push(entry);
            if leaf.len() == size { flush(&mut leaf) } else { Ok(()) }
        })?;
        flush(&mut leaf)?;
        let root = directory::to_bytes(&root);
        if HEADER + root.len() > START {
            return Ok(None);
        }
        let failed = || Error::io(&output_path, "use a temporary file next to it");
        std::io::Seek::rewind(&mut file).map_err(failed())?;
        pending.resize(1 << 16, 0);
        loop {
            let count = std::io::Read::read(&mut file, &mut pending).map_err(failed())?;
            if count == 0 {
                return Ok(Some((root, written)));
            }
            self.write(&pending[..count])?;
        }
    }
}

impl TileSink for PmtilesSink {
    fn done(&self) -> u64 {
        self.at.runs
    }

    fn push(&mut self, run: &TileSpan, tile: Option<&Encoded>) -> Result<()> {
        self.at.runs += 1;
        let Some(tile) = tile else { return Ok(()) };
        let (offset, length) = match self.known.get(&tile.hash) {
            Some(known) => *known,
            None => {
                let place = (self.at.bytes, tile.bytes.len() as u32);
                self.write(&tile.bytes)?;
                self.at.bytes += tile.bytes.len() as u64;
                if self.known.len() < MAX_REMEMBERED {
                    self.known.insert(tile.hash, place);
                }
                place
            }
        };
        self.journal.push(&Entry { first: run.first, count: run.count, offset, length, hash: tile.hash })
    }

    fn checkpoint(&mut self) -> Result<()> {
        self.output.sync().map_err(Error::io(self.output.path(), "sync"))?;
        self.journal.checkpoint(self.at)
    }

    fn finish(mut self: Box<Self>, about: &TilesetMetadata) -> Result<TileArchiveSummary> {
        let mut stored = TileArchiveSummary::default();
        let mut digest = Digest::default();
        let (mut entries, mut few, mut next) = (0u64, Vec::new(), 0);
        self.merged(|entry, hash| {
            entries += 1;
            stored.tiles += u64::from(entry.run);
            // A content that was not stored before follows all others.
            if entry.offset == next {
                next += u64::from(entry.length);
                stored.contents += 1;
            }
            digest.add(entry.first, entry.run.into(), hash);
            // A root directory cannot hold more: each entry takes at least two bytes.
            if few.len() < START / 2 {
                few.push(entry);
            }
            Ok(())
        })?;
        let start = START as u64;
        let tiles = ByteRange { offset: start, length: self.at.bytes };
        let mut root = directory::to_bytes(&few);
        let mut leaves = ByteRange { offset: start + self.at.bytes, length: 0 };
        if entries > few.len() as u64 || HEADER + root.len() > START {
            let mut size = LEAF;
            (root, leaves.length) = loop {
                if let Some(done) = self.leaves(size)? {
                    break done;
                }
                size += size / 4;
            };
        }
        let text = directory::gzip(about.pmtiles_json(stored.tiles, digest).as_bytes());
        let metadata = ByteRange { offset: leaves.offset + leaves.length, length: text.len() as u64 };
        self.write(&text)?;
        // Viewers request the tiles of all zooms in the header, so leave out zooms without tiles.
        let first = few.first().and_then(|entry| TileId::from_number(entry.first));
        let [least, most] = about.zooms;
        let least = first.map_or(least, |tile| tile.zoom.clamp(least, most));
        let header = Header {
            root: ByteRange { offset: HEADER as u64, length: root.len() as u64 },
            metadata,
            leaves,
            tiles,
            counts: [stored.tiles, entries, stored.contents],
            is_clustered: true,
            compression: 2,
            tile_compression: 1,
            tile_type: tile_type(about.format),
            zooms: [least, most],
            degrees: about.place.bounds,
            centre_zoom: about.centre_zoom().max(least),
            centre: about.place.centre,
        };
        let head = [header.to_bytes(), root].concat();
        let path = self.output.path().to_path_buf();
        self.output.overwrite(0, &head).map_err(Error::io(&path, "write"))?;
        stored.bytes = metadata.offset + metadata.length;
        self.output.commit()?;
        self.journal.remove().map_err(Error::io(&path, "remove the journal"))?;
        Ok(stored)
    }
}
