//! Light files: all of a shard but its segments' bytes.
//!
//! A head, what each piece of the shard has (entries of segments and parts of nodes, in the order in which they were finished), a
//! table of the pieces, and an end. They are read by other processes than those that have written them, perhaps much later: nothing in
//! them is believed.

use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use zerocopy::little_endian::{U32, U64, U128};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::shard::{Shard, ShardPiece};
use spinney_base::io::{FileAccess, InputFile, Output};
use spinney_base::parallel;
use spinney_base::space::CodeRun;
use spinney_base::{Error, Result};
use spinney_container::LevelCounts;

/// First bytes of the file.
const MAGIC: [u8; 8] = *b"\x93Shard\r\n";
const VERSION: u32 = 1;
/// Bytes that the table has at most.
const MAX_TABLE: u64 = 64 << 20;
/// Levels that are counted at most.
const MAX_LEVELS: usize = 32;

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct Head {
    magic: [u8; 8],
    version: U32,
    number: U32,
    job: U128,
}

/// Row of the table, for a piece; nodes per level follow.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawPiece {
    layer: U32,
    levels: U32,
    first: U64,
    last: U64,
    run_bytes: U64,
    length: U64,
    checksum: U32,
    zero: U32,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct End {
    /// Where the table is.
    table: U64,
    pieces: U32,
    /// CRC-32C of head, table, and the two numbers before.
    checksum: U32,
}

const HEAD: u64 = size_of::<Head>() as u64;
const END: u64 = size_of::<End>() as u64;

/// Piece of a light file, as the table tells of it.
#[derive(Clone, Debug)]
pub(super) struct LightPiece {
    pub(super) piece: ShardPiece,
    /// Bytes of its run file.
    pub(super) run_bytes: u64,
    /// Nodes per level, but for those that only the whole tree has.
    pub(super) counts: LevelCounts,
    /// Where in the light file its entries and parts are.
    pub(super) items: Range<u64>,
    /// Their CRC-32C.
    pub(super) checksum: u32,
}

/// A light file being written; it appears under its name when it is finished.
pub(super) struct LightWriter {
    out: Output,
    head: Head,
    position: u64,
    pieces: Vec<LightPiece>,
}

impl LightWriter {
    /// Starts the light file of a shard.
    pub(super) fn new(shard: &Shard) -> Result<LightWriter> {
        let (number, job) = (shard.number.into(), shard.job.into());
        let head = Head { magic: MAGIC, version: VERSION.into(), number, job };
        let out = shard.access.append_only(&shard.light_path())?;
        let mut writer = LightWriter { out, head, position: HEAD, pieces: Vec::new() };
        let head = writer.head.as_bytes().to_vec();
        writer.put(&head)?;
        Ok(writer)
    }

    /// How the files of the shard are written.
    pub(super) fn access(&self) -> &FileAccess {
        self.out.access()
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let LightWriter { out, .. } = self;
        out.write_all(bytes).map_err(Error::io(out.path().to_path_buf(), "write what is known of a shard"))
    }

    /// Starts a piece.
    pub(super) fn begin(&mut self, piece: ShardPiece) {
        let items = self.position..self.position;
        let counts = LevelCounts::default();
        self.pieces.push(LightPiece { piece, run_bytes: 0, counts, items, checksum: 0 });
    }

    /// Adds some bytes of an entry or a part of the piece that was started last.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.put(bytes)?;
        self.position += bytes.len() as u64;
        let piece = self.pieces.last_mut().expect("a piece was started");
        piece.items.end = self.position;
        piece.checksum = crc32c::crc32c_append(piece.checksum, bytes);
        Ok(())
    }

    /// Ends the piece that was started last.
    pub(super) fn end(&mut self, run_bytes: u64, counts: LevelCounts) {
        let piece = self.pieces.last_mut().expect("a piece was started");
        (piece.run_bytes, piece.counts) = (run_bytes, counts);
    }

    /// Writes table and end, and puts the file in its place.
    pub(super) fn finish(mut self) -> Result<()> {
        let mut table = Vec::new();
        for LightPiece { piece, run_bytes, counts, items, checksum } in &self.pieces {
            let [first, last] = piece.run.ends();
            let levels = counts.levels();
            let raw = RawPiece {
                layer: piece.layer.into(),
                levels: (levels.len() as u32).into(),
                first: first.into(),
                last: last.into(),
                run_bytes: (*run_bytes).into(),
                length: (items.end - items.start).into(),
                checksum: (*checksum).into(),
                zero: 0.into(),
            };
            table.extend_from_slice(raw.as_bytes());
            table.extend(levels.as_flattened().iter().flat_map(|nodes| nodes.to_le_bytes()));
        }
        let mut end = End {
            table: self.position.into(),
            pieces: (self.pieces.len() as u32).into(),
            checksum: 0.into(),
        };
        end.checksum = checksum(&self.head, &table, &end).into();
        self.put(&table)?;
        self.put(end.as_bytes())?;
        self.out.commit()
    }
}

fn checksum(head: &Head, table: &[u8], end: &End) -> u32 {
    let checked = crc32c::crc32c_append(crc32c::crc32c(head.as_bytes()), table);
    crc32c::crc32c_append(checked, &end.as_bytes()[..size_of::<End>() - 4])
}

/// A light file that is there, and what its table says.
#[derive(Debug)]
pub struct LightFile {
    pub(super) path: PathBuf,
    job: u128,
    pub(super) pieces: Vec<LightPiece>,
    access: FileAccess,
}

impl LightFile {
    /// Reads the table of a shard's light file, and makes sure that it is that of this shard, and that its run files have their lengths;
    /// `None` if the shard is not made yet, or not all of it is there.
    ///
    /// # Errors
    /// If the light file cannot be read or is damaged, or if it is that of another job.
    pub fn find(shard: &Shard) -> Result<Option<LightFile>> {
        LightFile::find_all(std::slice::from_ref(shard))?.pop().expect("as many as were asked for")
    }

    /// Does [`LightFile::find`] for several shards, in their order.
    ///
    /// # Errors
    /// On interruption. Of each shard, those of [`LightFile::find`].
    pub fn find_all(shards: &[Shard]) -> Result<Vec<Result<Option<LightFile>>>> {
        let mut all = parallel::map(shards, LightFile::find_light);
        // Run files of all of them are looked at together.
        let mut runs = Vec::new();
        for (number, (shard, found)) in shards.iter().zip(&all).enumerate() {
            let Ok(Some(light)) = found else { continue };
            let told = light.pieces.iter().filter(|light| light.run_bytes > 0);
            runs.extend(told.map(|light| (number, shard.run_path(light.piece.layer), light.run_bytes)));
        }
        let paths: Vec<&Path> = runs.iter().map(|(_, path, _)| &**path).collect();
        let Some(Shard { access, .. }) = shards.first() else { return Ok(all) };
        for ((number, _, bytes), state) in runs.iter().zip(access.stat(&paths)?) {
            match state {
                Ok(Some(state)) if state.length == *bytes => {}
                Ok(_) if all[*number].is_ok() => all[*number] = Ok(None),
                Ok(_) => {}
                Err(error) => all[*number] = Err(error),
            }
        }
        Ok(all)
    }

    /// The light file of a shard, without a look at its run files: see [`LightFile::find`].
    pub(super) fn find_light(shard: &Shard) -> Result<Option<LightFile>> {
        let path = shard.light_path();
        let Some(file) = shard.access.find(&path)? else { return Ok(None) };
        let light = LightFile::read(file, &path, shard)?;
        if light.job != shard.job
            || light.pieces.iter().map(|light| light.piece).ne(shard.pieces.iter().copied())
        {
            let advice = format!("remove the folder {}, and build its shards again", shard.folder.display());
            return Err(Error::unsupported(&path, "a shard of another job", advice));
        }
        Ok(Some(light))
    }

    /// Bytes of all run files.
    pub fn run_bytes(&self) -> u64 {
        self.pieces.iter().fold(0, |sum: u64, light| sum.saturating_add(light.run_bytes))
    }

    fn read(mut file: InputFile, path: &Path, shard: &Shard) -> Result<LightFile> {
        let corrupt =
            |place: &str, found: String, expected: &str| Error::corrupt(path, place, found, expected);
        let io = || Error::io(path, "read what is known of a shard");
        let length = file.len();
        if length < HEAD + END {
            return Err(corrupt("length", format!("{length} bytes"), "those of a shard's light file"));
        }
        let (mut head, mut end) = ([0; HEAD as usize], [0; END as usize]);
        file.read_exact(&mut head).map_err(io())?;
        let head: Head = zerocopy::transmute!(head);
        if head.magic != MAGIC {
            return Err(corrupt(
                "first bytes",
                format!("{:02x?}", head.magic),
                "those of a shard's light file",
            ));
        }
        if head.version.get() != VERSION {
            let found = format!("version {} of light files", head.version);
            return Err(Error::unsupported(path, found, "use the program that has built the shard"));
        }
        file.seek(SeekFrom::Start(length - END)).and_then(|_| file.read_exact(&mut end)).map_err(io())?;
        let end: End = zerocopy::transmute!(end);
        let table_at = end.table.get();
        let size = (length - END).checked_sub(table_at).filter(|size| table_at >= HEAD && *size <= MAX_TABLE);
        let Some(size) = size else {
            return Err(corrupt("end", format!("a table at byte {table_at}"), "a place in the file"));
        };
        let mut table = vec![0; size as usize];
        file.seek(SeekFrom::Start(table_at)).and_then(|_| file.read_exact(&mut table)).map_err(io())?;
        let found = checksum(&head, &table, &end);
        if found != end.checksum.get() {
            let expected = format!("checksum {:08x}", end.checksum);
            return Err(corrupt("table", format!("checksum {found:08x}"), &expected));
        }
        let number = shard.number;
        if head.number.get() != number {
            return Err(corrupt("head", format!("shard {}", head.number), &format!("shard {number}")));
        }
        let pieces = read_table(&table, table_at, end.pieces.get());
        let pieces =
            pieces.ok_or_else(|| corrupt("table", "numbers that do not fit".into(), "pieces in order"))?;
        Ok(LightFile { path: path.to_path_buf(), job: head.job.get(), pieces, access: shard.access.clone() })
    }
}

/// The pieces of a table behind whose items it stands; `None` if its numbers do not fit.
fn read_table(mut table: &[u8], table_at: u64, count: u32) -> Option<Vec<LightPiece>> {
    let mut pieces: Vec<LightPiece> = Vec::new();
    let mut position = HEAD;
    for _ in 0..count {
        let (raw, rest) = RawPiece::ref_from_prefix(table).ok()?;
        let levels = raw.levels.get() as usize;
        let (counted, rest) = rest.split_at_checked(levels.checked_mul(24)?)?;
        let end = position.checked_add(raw.length.get()).filter(|end| *end <= table_at)?;
        let layer = raw.layer.get();
        let run = CodeRun::new(raw.first.get(), raw.last.get())?;
        let follows = pieces.last().is_none_or(|before| before.piece.layer < layer);
        if levels > MAX_LEVELS || !follows {
            return None;
        }
        let mut counts = LevelCounts::default();
        for (level, nodes) in (0..).zip(counted.chunks_exact(24)) {
            let number = |state: usize| nodes[8 * state..][..8].try_into().map(u64::from_le_bytes);
            let nodes = [number(0).ok()?, number(1).ok()?, number(2).ok()?];
            // (There are no more nodes, so that sums stay numbers.)
            if nodes.iter().any(|nodes| *nodes > 1 << 62) {
                return None;
            }
            counts.add(level, nodes);
        }
        let piece = ShardPiece { layer, run };
        let checksum = raw.checksum.get();
        pieces.push(LightPiece {
            piece,
            run_bytes: raw.run_bytes.get(),
            counts,
            items: position..end,
            checksum,
        });
        (table, position) = (rest, end);
    }
    (table.is_empty() && position == table_at).then_some(pieces)
}

/// The bytes of a piece's entries and parts, from the first to the last.
pub(super) struct ItemBytes {
    path: PathBuf,
    file: BufReader<InputFile>,
    left: u64,
    checksum: u32,
    expected: u32,
}

impl ItemBytes {
    /// Those of a piece of a light file.
    pub(super) fn of(light: &LightFile, piece: &LightPiece) -> Result<ItemBytes> {
        let mut file = BufReader::with_capacity(1 << 16, light.access.input(&light.path)?);
        file.seek(SeekFrom::Start(piece.items.start)).map_err(Error::io(&light.path, "read"))?;
        let left = piece.items.end - piece.items.start;
        Ok(ItemBytes { path: light.path.clone(), file, left, checksum: 0, expected: piece.checksum })
    }

    /// Whether all have been taken.
    ///
    /// # Errors
    /// If they have, and their checksum is not what the table says.
    pub(super) fn is_over(&self) -> Result<bool> {
        if self.left > 0 {
            return Ok(false);
        }
        match self.checksum == self.expected {
            true => Ok(true),
            false => {
                let expected = format!("{:08x}", self.expected);
                Err(self.corrupt(format!("checksum {:08x}", self.checksum), expected))
            }
        }
    }

    /// Takes some.
    ///
    /// # Errors
    /// If there are not so many left, or they cannot be read.
    pub(super) fn take(&mut self, length: u64) -> Result<Vec<u8>> {
        if length > self.left {
            return Err(self
                .corrupt(format!("{length} bytes of an entry or a part"), format!("at most {}", self.left)));
        }
        // (Room for what is there, and not for what a number says.)
        let mut bytes = Vec::new();
        let read = self.file.by_ref().take(length).read_to_end(&mut bytes);
        read.map_err(Error::io(&self.path, "read what is known of a shard"))?;
        if bytes.len() as u64 != length {
            return Err(self.corrupt(format!("{} bytes", bytes.len()), format!("{length}")));
        }
        self.left -= length;
        self.checksum = crc32c::crc32c_append(self.checksum, &bytes);
        Ok(bytes)
    }

    /// The error for something in them that makes no sense.
    pub(super) fn corrupt(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::corrupt(&self.path, "entries and parts", found, expected)
    }

    /// The file, for messages.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}
