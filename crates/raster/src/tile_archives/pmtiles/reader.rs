//! Reader of archives, which are untrusted.

use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::directory::{self, DirectoryEntry, gunzip};
use super::header::{ByteRange, HEADER, Header};
use crate::tile_archives::encode::TileFormat;
use crate::tile_archives::provenance::{Digest, SpinneyMetadata};
use spinney_base::io::open_input;
use spinney_base::io::platform::read_exact_at;
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;
use spinney_tiles::{MAX_ZOOM, TileId, first_number};

/// An open archive.
pub struct Pmtiles {
    path: PathBuf,
    file: File,
    length: u64,
    header: Header,
    root: Vec<DirectoryEntry>,
    /// The last used leaf directory, by its offset.
    leaf: Mutex<Option<(u64, Vec<DirectoryEntry>)>>,
    metadata: serde_json::Value,
}

/// Maximum size of the JSON metadata in bytes.
const MAX_METADATA: u64 = 16 << 20;
/// Maximum size of a tile in bytes.
const MAX_TILE: u32 = 64 << 20;
/// Maximum size of a stored directory in bytes.
const MAX_DIRECTORY: u64 = 16 << 20;
/// Maximum number of nested directories.
const MAX_STEPS: usize = 4;

impl Pmtiles {
    /// Opens an archive of version 3 and reads its header, root directory and metadata.
    ///
    /// # Errors
    /// If the file cannot be read, is not such an archive, or is corrupt there.
    pub fn open(path: &Path) -> Result<Pmtiles> {
        let file = open_input(path)?;
        let length = file.metadata().map_err(Error::io(path, "read"))?.len();
        let mut bytes = [0; HEADER];
        if length < HEADER as u64 {
            return Err(Error::corrupt(path, "header", format!("{length} bytes"), "at least 127"));
        }
        read_exact_at(&file, &mut bytes, 0).map_err(Error::io(path, "read"))?;
        let header = Header::from_bytes(&bytes).ok_or_else(|| {
            Error::corrupt(path, "header", "another file type or version", "PMTiles version 3")
        })?;
        if header.compression > 2 || header.compression == 0 {
            let found = format!("compression {} of directories", header.compression);
            return Err(Error::unsupported(path, found, "create the archive with gzip"));
        }
        let mut archive = Pmtiles {
            path: path.to_path_buf(),
            file,
            length,
            header,
            root: Vec::new(),
            leaf: Mutex::default(),
            metadata: serde_json::Value::Null,
        };
        archive.root = archive.directory(header.root)?;
        let part = archive.part(header.metadata, MAX_METADATA, "metadata")?;
        let text = archive.unpacked(&part, MAX_METADATA, "metadata")?;
        archive.metadata = serde_json::from_slice(&text)
            .map_err(|error| archive.bad("metadata", error.to_string(), "JSON"))?;
        Ok(archive)
    }

    fn bad(&self, place: &str, found: impl Into<String>, expected: &str) -> Error {
        let found: String = found.into();
        Error::corrupt(self.path.as_path(), place, found, expected)
    }

    /// Reads a byte range, which must be within the file and at most `most` bytes long.
    fn part(&self, part: ByteRange, most: u64, what: &str) -> Result<Vec<u8>> {
        let end = part.offset.checked_add(part.length);
        if part.length > most || end.is_none_or(|end| end > self.length) {
            let found = format!("{} bytes at {}", part.length, part.offset);
            return Err(self.bad(what, found, "a byte range in the file, within the size limit"));
        }
        let mut bytes = vec![0; part.length as usize];
        read_exact_at(&self.file, &mut bytes, part.offset).map_err(Error::io(&self.path, "read"))?;
        Ok(bytes)
    }

    fn unpacked(&self, bytes: &[u8], most: u64, what: &str) -> Result<Vec<u8>> {
        if self.header.compression == 1 {
            return Ok(bytes.to_vec());
        }
        gunzip(bytes, most).ok_or_else(|| {
            self.bad(what, "bytes that cannot be decompressed", "gzip data within the size limit")
        })
    }

    fn directory(&self, part: ByteRange) -> Result<Vec<DirectoryEntry>> {
        let bytes = self.part(part, MAX_DIRECTORY, "directory")?;
        // Uncompressed directories are rare: compress them, since the decoder expects gzip.
        let bytes = if self.header.compression == 1 { directory::gzip(&bytes) } else { bytes };
        directory::from_bytes(&bytes)
            .map_err(|found| self.bad(&format!("directory at {}", part.offset), found, "entries in order"))
    }

    fn leaf(&self, entry: &DirectoryEntry) -> Result<Vec<DirectoryEntry>> {
        let offset = self.header.leaves.offset.checked_add(entry.offset);
        let is_inside =
            entry.offset.checked_add(entry.length.into()).is_some_and(|end| end <= self.header.leaves.length);
        let offset = offset.filter(|_| is_inside);
        let offset = offset
            .ok_or_else(|| self.bad("directory", "a leaf directory outside of its section", "one inside"))?;
        self.directory(ByteRange { offset, length: entry.length.into() })
    }

    fn content(&self, entry: &DirectoryEntry) -> Result<Vec<u8>> {
        let end = entry.offset.checked_add(entry.length.into());
        if end.is_none_or(|end| end > self.header.tiles.length) {
            return Err(self.bad(
                &format!("tile {}", entry.first),
                "bytes outside of the tile section",
                "bytes inside",
            ));
        }
        let offset = self.header.tiles.offset.saturating_add(entry.offset);
        self.part(ByteRange { offset, length: entry.length.into() }, MAX_TILE.into(), "tile")
    }

    /// Returns the bytes of a tile, or `None` if the archive does not have it.
    ///
    /// # Errors
    /// If the archive cannot be read or is corrupt there.
    pub fn tile(&self, tile: TileId) -> Result<Option<Vec<u8>>> {
        let number = tile.number();
        let Some(mut entry) = found(&self.root, number) else { return Ok(None) };
        for _ in 0..MAX_STEPS {
            if entry.run > 0 {
                let is_in_run = number - entry.first < entry.run.into();
                return if is_in_run { self.content(&entry).map(Some) } else { Ok(None) };
            }
            let mut cached = self.leaf.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            if cached.as_ref().is_none_or(|(offset, _)| *offset != entry.offset) {
                *cached = Some((entry.offset, self.leaf(&entry)?));
            }
            let below = cached.as_ref().and_then(|(_, leaf)| found(leaf, number));
            let Some(below) = below else { return Ok(None) };
            entry = below;
        }
        Err(self.bad("directory", "leaf directories that are nested too deep", "at most four levels"))
    }

    /// Returns the number of the first tile, if there is one.
    pub(in crate::tile_archives) fn first_tile(&self) -> Option<u64> {
        self.root.first().map(|entry| entry.first)
    }

    /// Returns Spinney's own metadata, if Spinney wrote the archive.
    pub(in crate::tile_archives) fn own(&self) -> Option<SpinneyMetadata> {
        serde_json::from_value(self.metadata.get("spinney")?.clone()).ok()
    }

    /// Returns the JSON metadata.
    pub fn metadata(&self) -> &serde_json::Value {
        &self.metadata
    }

    /// Checks the order of all entries, their offsets and counts, and the hash of all tiles if
    /// Spinney wrote the archive. Uses the memory of two directories and a tile.
    ///
    /// # Errors
    /// If the archive cannot be read, or on cancellation.
    pub fn verify(&self, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut check = Check {
            archive: self,
            findings: Vec::new(),
            next: 0,
            ends: 0,
            totals: [0; 3],
            digest: Digest::default(),
            known: HashMap::new(),
            budget: self.length.saturating_mul(16).saturating_add(1 << 28),
        };
        check.header();
        check.directory(&self.root, 0, progress)?;
        check.finish();
        Ok(check.findings)
    }
}

/// Finds the last entry that is not after a tile.
fn found(entries: &[DirectoryEntry], number: u64) -> Option<DirectoryEntry> {
    let after = entries.partition_point(|entry| entry.first <= number);
    after.checked_sub(1).map(|index| entries[index])
}

/// State of a verification.
struct Check<'a> {
    archive: &'a Pmtiles,
    findings: Vec<Finding>,
    /// The lowest tile number that may come next.
    next: u64,
    /// End of the contents so far.
    ends: u64,
    totals: [u64; 3],
    digest: Digest,
    /// Hashes of contents by offset and length, up to a limit.
    known: HashMap<(u64, u32), u128>,
    /// Bytes that may still be read. This bounds the time for archives with overlapping contents.
    budget: u64,
}

/// Maximum number of cached hashes.
const MAX_REMEMBERED: usize = 1 << 16;

/// Maximum number of reported findings.
const MAX_FINDINGS: usize = 100;

impl Check<'_> {
    fn report(&mut self, place: String, problem: &str) {
        if self.findings.len() < MAX_FINDINGS {
            self.findings.push(Finding { place, problem: problem.into() });
        }
    }

    fn header(&mut self) {
        let Header { zooms: [least, most], tile_type, .. } = self.archive.header;
        if least > most || most > MAX_ZOOM {
            self.report("header".into(), "an invalid range of zooms");
        }
        let format =
            self.archive.metadata.get("format").and_then(|name| name.as_str()?.parse::<TileFormat>().ok());
        if format.is_some_and(|format| super::header::tile_type(format) != tile_type) {
            self.report("header".into(), "a tile type that differs from the metadata");
        }
    }

    fn directory(&mut self, entries: &[DirectoryEntry], step: usize, progress: &dyn Progress) -> Result<()> {
        for entry in entries {
            if entry.run == 0 {
                if step >= MAX_STEPS {
                    self.report(format!("tile {}", entry.first), "leaf directories that are nested too deep");
                    return Ok(());
                }
                match self.archive.leaf(entry) {
                    Ok(leaf) if leaf.first().is_some_and(|first| first.first == entry.first) => {
                        self.directory(&leaf, step + 1, progress)?;
                    }
                    Ok(_) => self.report(
                        format!("tile {}", entry.first),
                        "a leaf directory that starts with another tile",
                    ),
                    Err(Error::Corrupt { location: place, found, .. }) => self.report(place, &found),
                    Err(error) => return Err(error),
                }
                // Do not read on if corruption repeats.
                if self.findings.len() >= MAX_FINDINGS {
                    return Ok(());
                }
                continue;
            }
            progress.check()?;
            self.entry(entry)?;
            progress.advance(entry.run.into(), self.archive.header.counts[0]);
        }
        Ok(())
    }

    fn entry(&mut self, entry: &DirectoryEntry) -> Result<()> {
        let place = format!("tile {}", entry.first);
        let [least, most] = self.archive.header.zooms.map(|zoom| zoom.min(MAX_ZOOM));
        let end = entry.first.saturating_add(entry.run.into());
        if entry.first < self.next {
            self.report(place.clone(), "a duplicate tile, or one out of order");
        }
        if entry.first < first_number(least) || end > first_number(most + 1) {
            self.report(place.clone(), "a zoom outside of the header's range");
        }
        self.next = self.next.max(end);
        if entry.offset == self.ends {
            self.ends += u64::from(entry.length);
            self.totals[2] += 1;
        } else if entry.offset > self.ends && self.archive.header.is_clustered {
            self.report(place.clone(), "bytes out of tile order");
        }
        self.totals[0] += u64::from(entry.run);
        self.totals[1] += 1;
        let at = (entry.offset, entry.length);
        let hash = match self.known.get(&at) {
            Some(hash) => *hash,
            None if self.budget < entry.length.into() => {
                self.report(place, "bytes that overlap those of too many tiles");
                return Ok(());
            }
            None => match self.archive.content(entry) {
                Ok(bytes) => {
                    self.budget -= u64::from(entry.length);
                    xxhash_rust::xxh3::xxh3_128(&bytes)
                }
                Err(Error::Corrupt { found, .. }) => {
                    self.report(place, &found);
                    return Ok(());
                }
                Err(error) => return Err(error),
            },
        };
        if self.known.len() < MAX_REMEMBERED {
            self.known.insert(at, hash);
        }
        self.digest.add(entry.first, entry.run.into(), hash);
        Ok(())
    }

    fn finish(&mut self) {
        let counts = self.archive.header.counts;
        for (at, what) in ["tiles", "entries", "contents"].into_iter().enumerate() {
            // 0 means unknown.
            if counts[at] != 0 && counts[at] != self.totals[at] {
                self.report(
                    "header".into(),
                    &format!("{} {what}, but there are {}", counts[at], self.totals[at]),
                );
            }
        }
        if let Some(own) = self.archive.own()
            && (own.tiles != self.totals[0] || Digest::parse(&own.digest) != Some(self.digest))
        {
            self.report("tiles".into(), "the hash of their bytes differs from that of the export");
        }
    }
}
