//! The journal of an export. It lists what was written so far in a file, so that it takes no memory
//! and the export can be resumed.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use spinney_base::io::open_regular;
use spinney_base::{Error, Result};

/// Consecutive equal tiles, and the location of their bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) first: u64,
    pub(super) count: u64,
    /// Offset from the first byte of all tiles.
    pub(super) offset: u64,
    pub(super) length: u32,
    pub(super) hash: u128,
}

/// A point from which an export can be resumed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Checkpoint {
    /// Runs of the tile traversal that are done.
    pub(super) runs: u64,
    /// Bytes of tiles written.
    pub(super) bytes: u64,
}

/// Bytes of a record: an entry, or a checkpoint, whose first tile is `u64::MAX`.
const RECORD: usize = 44;
const MAGIC: [u8; 8] = *b"spinney\x01";

/// A journal that is being written.
pub(super) struct Journal {
    path: PathBuf,
    out: BufWriter<File>,
    /// Bytes before the first record.
    start: u64,
    records: u64,
    /// Whether the file has a name and outlives the process.
    is_kept: bool,
}

impl Journal {
    /// A temporary journal in a directory, removed when the process ends.
    pub(super) fn temporary(directory: &Path) -> Result<Journal> {
        let file =
            tempfile::tempfile_in(directory).map_err(Error::io(directory, "create a temporary file"))?;
        let out = BufWriter::with_capacity(1 << 16, file);
        Ok(Journal { path: directory.to_path_buf(), out, start: 0, records: 0, is_kept: false })
    }

    /// Starts the journal of an export that `making` describes, or resumes an existing one. Passes
    /// the entries up to the last checkpoint to `entry`, and returns that checkpoint. With
    /// `restart`, the existing journal is overwritten, also if it belongs to another export.
    ///
    /// # Errors
    /// If the existing file is the journal of another export, or no journal.
    pub(super) fn resumable(
        path: &Path,
        making: &str,
        restart: bool,
        entry: &mut dyn FnMut(Entry),
    ) -> Result<(Journal, Checkpoint)> {
        let failed = || Error::io(path, "use the journal");
        let mut options = File::options();
        let mut file = open_regular(options.read(true).write(true).create(true).truncate(false), path)?;
        let length = file.metadata().map_err(failed())?.len();
        let head: Vec<u8> = [&MAGIC[..], &(making.len() as u32).to_le_bytes(), making.as_bytes()].concat();
        let start = head.len() as u64;
        let (mut records, mut last) = (0, Checkpoint::default());
        let mut found = vec![0; length.min(start) as usize];
        file.read_exact(&mut found).map_err(failed())?;
        let is_ours = found.starts_with(&MAGIC[..MAGIC.len().min(found.len())]);
        if !is_ours {
            return Err(not_ours(path));
        }
        let is_same = head.starts_with(&found);
        if !is_same && !restart {
            return Err(other_export(path));
        }
        if is_same && length >= start && !restart {
            // Records after the last checkpoint are dropped.
            let mut input = BufReader::new(&file);
            let mut all = 0;
            let mut record = [0; RECORD];
            while input.read_exact(&mut record).is_ok() {
                all += 1;
                if let Some(checkpoint) = checkpoint_of(&record) {
                    (records, last) = (all, checkpoint);
                }
            }
            drop(input);
            file.seek(SeekFrom::Start(start)).map_err(failed())?;
            let mut input = BufReader::new(&file);
            for _ in 0..records {
                input.read_exact(&mut record).map_err(failed())?;
                if checkpoint_of(&record).is_none() {
                    entry(entry_of(&record));
                }
            }
        } else {
            // A journal shorter than its head has no content.
            let started = file.set_len(0).and_then(|()| file.seek(SeekFrom::Start(0)));
            started.and_then(|_| file.write_all(&head)).map_err(failed())?;
        }
        file.set_len(start + records * RECORD as u64).map_err(failed())?;
        file.seek(SeekFrom::End(0)).map_err(failed())?;
        let out = BufWriter::with_capacity(1 << 16, file);
        Ok((Journal { path: path.to_path_buf(), out, start, records, is_kept: true }, last))
    }

    pub(super) fn push(&mut self, entry: &Entry) -> Result<()> {
        let mut record = [0; RECORD];
        record[..8].copy_from_slice(&entry.first.to_le_bytes());
        record[8..16].copy_from_slice(&entry.count.to_le_bytes());
        record[16..24].copy_from_slice(&entry.offset.to_le_bytes());
        record[24..28].copy_from_slice(&entry.length.to_le_bytes());
        record[28..].copy_from_slice(&entry.hash.to_le_bytes());
        self.write(&record)
    }

    /// Marks a point from which the export can be resumed. Everything written so far must already
    /// be durable.
    pub(super) fn checkpoint(&mut self, at: Checkpoint) -> Result<()> {
        if !self.is_kept {
            return Ok(());
        }
        let mut record = [0xff; RECORD];
        record[8..16].copy_from_slice(&at.runs.to_le_bytes());
        record[16..24].copy_from_slice(&at.bytes.to_le_bytes());
        let checksum = crc32c::crc32c(&record[..24]);
        record[24..28].copy_from_slice(&checksum.to_le_bytes());
        self.write(&record)?;
        let synced = self.out.flush().and_then(|()| self.out.get_ref().sync_data());
        synced.map_err(Error::io(&self.path, "write the journal"))
    }

    fn write(&mut self, record: &[u8; RECORD]) -> Result<()> {
        self.records += 1;
        self.out.write_all(record).map_err(Error::io(&self.path, "write the journal"))
    }

    /// Yields all entries in order.
    pub(super) fn entries(&mut self, mut entry: impl FnMut(Entry) -> Result<()>) -> Result<()> {
        let failed = || Error::io(&self.path, "read the journal");
        self.out.flush().map_err(failed())?;
        let mut file = self.out.get_ref();
        file.seek(SeekFrom::Start(self.start)).map_err(failed())?;
        let mut input = BufReader::with_capacity(1 << 16, file);
        let mut record = [0; RECORD];
        for _ in 0..self.records {
            input.read_exact(&mut record).map_err(failed())?;
            if checkpoint_of(&record).is_none() {
                entry(entry_of(&record))?;
            }
        }
        Ok(())
    }

    /// Removes the journal of a finished export.
    pub(super) fn remove(self) -> io::Result<()> {
        if self.is_kept { std::fs::remove_file(&self.path) } else { Ok(()) }
    }
}

/// The error if the file belongs to another export.
pub(super) fn other_export(path: &Path) -> Error {
    let advice = "remove it to start again, or give the source and options that it was started with";
    Error::unsupported(path, "resuming an export of another source or with other options", advice)
}

/// The error if the file was not left by an export, so that it is not overwritten.
pub(super) fn not_ours(path: &Path) -> Error {
    let advice = "move it away, or choose another name; it was not changed";
    Error::unsupported(path, "resuming from a file that is not an interrupted export", advice)
}

fn number(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|at| bytes[at]))
}

fn entry_of(record: &[u8; RECORD]) -> Entry {
    Entry {
        first: number(&record[..8]),
        count: number(&record[8..16]),
        offset: number(&record[16..24]),
        length: u32::from_le_bytes(std::array::from_fn(|at| record[24 + at])),
        hash: u128::from_le_bytes(std::array::from_fn(|at| record[28 + at])),
    }
}

fn checkpoint_of(record: &[u8; RECORD]) -> Option<Checkpoint> {
    let is_checkpoint =
        record[..8] == [0xff; 8] && record[24..28] == crc32c::crc32c(&record[..24]).to_le_bytes();
    is_checkpoint.then(|| Checkpoint { runs: number(&record[8..16]), bytes: number(&record[16..24]) })
}
