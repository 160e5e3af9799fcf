//! `MBTiles`, version 1.3: an archive of tiles as an `SQLite` database. The table `images` has each
//! content once, by its hash, and `map` assigns contents to tiles; `tiles` is a view of both. Rows
//! are counted from the south, as in TMS.

use std::path::{Path, PathBuf};

use rusqlite::{Connection, OpenFlags, OptionalExtension, params};

use super::encode::Encoded;
use super::journal::{not_ours, other_export};
use super::provenance::{Digest, SpinneyMetadata, TilesetMetadata};
use super::sink::{TileArchiveSummary, TileEdit, TileSink};
use super::walk::TileSpan;
use spinney_base::io::{FileAccess, Output};
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;
use spinney_tiles::{MAX_ZOOM, TileId};

/// The tables. The application ID is that of `MBTiles` ("MPBX").
const SCHEMA: &str = "
PRAGMA application_id = 0x4d504258;
CREATE TABLE metadata (name TEXT NOT NULL PRIMARY KEY, value TEXT) WITHOUT ROWID;
CREATE TABLE images (tile_id TEXT NOT NULL PRIMARY KEY, tile_data BLOB NOT NULL);
CREATE TABLE map (zoom_level INTEGER NOT NULL, tile_column INTEGER NOT NULL, tile_row INTEGER NOT NULL, tile_id TEXT NOT NULL,
  PRIMARY KEY (zoom_level, tile_column, tile_row)) WITHOUT ROWID;
CREATE VIEW tiles AS SELECT map.zoom_level AS zoom_level, map.tile_column AS tile_column, map.tile_row AS tile_row,
  images.tile_data AS tile_data FROM map JOIN images ON images.tile_id = map.tile_id;
";

/// The row of `metadata` that describes an unfinished export.
const PARTIAL: &str = "spinney_partial";

/// Offsets of the change counters in a database's header (`SQLite` file format, 1.3.7).
const CHANGE_COUNTERS: [u64; 2] = [24, 92];

/// An archive that is being written.
pub(super) struct MbtilesSink {
    output: Output,
    path: PathBuf,
    connection: Connection,
    runs: u64,
    /// Whether it is kept if the export is interrupted.
    is_kept: bool,
}

fn failed(path: &Path, doing: &'static str) -> impl FnOnce(rusqlite::Error) -> Error {
    let path = path.to_path_buf();
    move |error| match error.sqlite_error_code() {
        Some(rusqlite::ErrorCode::DiskFull) => {
            Error::Io { path, doing, cause: std::io::Error::new(std::io::ErrorKind::StorageFull, error) }
        }
        Some(rusqlite::ErrorCode::DatabaseBusy | rusqlite::ErrorCode::DatabaseLocked) => {
            Error::Locked { path, holder: "another process".into() }
        }
        Some(rusqlite::ErrorCode::DatabaseCorrupt | rusqlite::ErrorCode::NotADatabase) => {
            Error::corrupt(path.as_path(), "database", error.to_string(), "an SQLite database")
        }
        _ => Error::Io { path, doing, cause: std::io::Error::other(error) },
    }
}

impl MbtilesSink {
    /// Starts the archive of an export that `provenance` describes, or resumes an interrupted one.
    pub(super) fn create(
        path: &Path,
        provenance: &str,
        (resume, access): (bool, &FileAccess),
    ) -> Result<MbtilesSink> {
        let output = if resume { Output::resumable(path)?.0 } else { access.create(path)? };
        let Some(place) = output.unfinished_path().map(Path::to_path_buf) else {
            let advice = "give a file name, since MBTiles are a database";
            return Err(Error::unsupported(path, "writing MBTiles to a stream", advice));
        };
        let connection = Connection::open(&place).map_err(failed(&place, "open"))?;
        if resume {
            check_own(&connection, &place)?;
        }
        // A file without a name needs no journal of `SQLite`, unless the export is resumable.
        let safety = if resume { "NORMAL" } else { "OFF" };
        let settings = format!(
            "PRAGMA page_size = 4096; PRAGMA journal_mode = {}; PRAGMA synchronous = {safety}; \
             PRAGMA secure_delete = ON; PRAGMA cache_size = -32768; PRAGMA temp_store = MEMORY;",
            if resume { "DELETE" } else { "OFF" }
        );
        let set = connection.execute_batch(&settings);
        set.map_err(failed(&place, "start"))?;
        let mut sink = MbtilesSink { output, path: place, connection, runs: 0, is_kept: resume };
        let tables: i64 = sink.read_number("SELECT count(*) FROM sqlite_master")?;
        if tables == 0 {
            sink.run(&format!("BEGIN; {SCHEMA}"))?;
            sink.insert_metadata(PARTIAL, provenance)?;
            sink.run("COMMIT")?;
        } else {
            let found: Option<String> = sink
                .connection
                .query_row("SELECT value FROM metadata WHERE name = ?1", [PARTIAL], |row| row.get(0))
                .optional()
                .map_err(failed(&sink.path, "read"))?;
            if found.as_deref() != Some(provenance) {
                return Err(other_export(&sink.path));
            }
            sink.runs = sink.read_number::<i64>("PRAGMA user_version")?.max(0) as u64;
        }
        sink.run("BEGIN")?;
        Ok(sink)
    }

    fn run(&self, statements: &str) -> Result<()> {
        self.connection.execute_batch(statements).map_err(failed(&self.path, "write"))
    }

    fn read_number<T: rusqlite::types::FromSql>(&self, sql: &str) -> Result<T> {
        self.connection.query_row(sql, [], |row| row.get(0)).map_err(failed(&self.path, "read"))
    }

    fn insert_metadata(&self, name: &str, value: &str) -> Result<()> {
        let inserted = self.connection.execute("INSERT INTO metadata VALUES (?1, ?2)", [name, value]);
        inserted.map(drop).map_err(failed(&self.path, "write"))
    }
}

/// Fails without changing anything unless a database is empty or has an interrupted export.
fn check_own(connection: &Connection, path: &Path) -> Result<()> {
    let read_number = |sql: &str| connection.query_row(sql, [], |row| row.get::<_, i64>(0));
    let is_empty = read_number("PRAGMA page_count") == Ok(0);
    let rows = format!("SELECT count(*) FROM metadata WHERE name = '{PARTIAL}'");
    if is_empty || read_number(&rows) == Ok(1) { Ok(()) } else { Err(not_ours(path)) }
}

/// Key of a content in `images`.
fn name_of(hash: u128) -> String {
    format!("{hash:032x}")
}

/// Row of a tile, counted from the south.
fn tms_row(tile: TileId) -> u32 {
    (1 << tile.zoom) - 1 - tile.row
}

/// Inserts a content, unless it exists, and the tiles that have it.
fn insert(
    connection: &Connection,
    tiles: impl Iterator<Item = TileId>,
    made: &Encoded,
) -> rusqlite::Result<()> {
    let name = name_of(made.hash);
    connection
        .prepare_cached("INSERT OR IGNORE INTO images VALUES (?1, ?2)")?
        .execute(params![name, made.bytes])?;
    let mut statement = connection.prepare_cached("INSERT INTO map VALUES (?1, ?2, ?3, ?4)")?;
    for tile in tiles {
        statement.execute(params![tile.zoom, tile.column, tms_row(tile), name])?;
    }
    Ok(())
}

/// Yields number and hash of every tile of an archive.
fn each_tile(
    connection: &Connection,
    mut each: impl FnMut(u64, u128) -> Result<()>,
    path: &Path,
) -> Result<()> {
    let mut statement = connection
        .prepare("SELECT zoom_level, tile_column, tile_row, tile_id FROM map")
        .map_err(failed(path, "read"))?;
    let mut rows = statement.query([]).map_err(failed(path, "read"))?;
    while let Some(row) = rows.next().map_err(failed(path, "read"))? {
        let number = |at: usize| row.get::<_, i64>(at).map_err(failed(path, "read"));
        let (zoom, column, row_number) = (number(0)?, number(1)?, number(2)?);
        let name: String = row.get(3).map_err(failed(path, "read"))?;
        let place = || format!("tile {zoom}/{column}/{row_number}");
        let is_tile = (0..=i64::from(MAX_ZOOM)).contains(&zoom)
            && [column, row_number].iter().all(|at| (0..1 << zoom).contains(at));
        let hash = u128::from_str_radix(&name, 16).ok().filter(|hash| name == name_of(*hash));
        let (true, Some(hash)) = (is_tile, hash) else {
            return Err(Error::corrupt(path, place(), format!("content {name:.40}"), "a tile and a hash"));
        };
        let row = ((1 << zoom) - 1 - row_number) as u32;
        each(TileId { zoom: zoom as u8, column: column as u32, row }.number(), hash)?;
    }
    Ok(())
}

impl TileSink for MbtilesSink {
    fn done(&self) -> u64 {
        self.runs
    }

    fn push(&mut self, run: &TileSpan, tile: Option<&Encoded>) -> Result<()> {
        self.runs += 1;
        let Some(tile) = tile else { return Ok(()) };
        let tiles = (run.first..run.first + run.count)
            .map(|number| TileId::from_number(number).expect("spans have valid tile numbers"));
        insert(&self.connection, tiles, tile).map_err(failed(&self.path, "write"))
    }

    fn checkpoint(&mut self) -> Result<()> {
        // The user version has 32 bits; an export with more runs resumes from an earlier one.
        let runs = i32::try_from(self.runs).unwrap_or(i32::MAX);
        if !self.is_kept || runs == i32::MAX {
            return Ok(());
        }
        self.run(&format!("PRAGMA user_version = {runs}; COMMIT; BEGIN"))
    }

    fn finish(self: Box<Self>, about: &TilesetMetadata) -> Result<TileArchiveSummary> {
        let (mut stored, mut digest) = (TileArchiveSummary::default(), Digest::default());
        each_tile(
            &self.connection,
            |number, hash| {
                digest.add(number, 1, hash);
                stored.tiles += 1;
                Ok(())
            },
            &self.path,
        )?;
        stored.contents = self.read_number::<i64>("SELECT count(*) FROM images")?.max(0) as u64;
        self.run(&format!("DELETE FROM metadata WHERE name = '{PARTIAL}'"))?;
        for (name, value) in about.mbtiles_rows(stored.tiles, digest) {
            self.insert_metadata(&name, &value)?;
        }
        self.run("PRAGMA user_version = 0; COMMIT")?;
        let MbtilesSink { output, path, connection, .. } = *self;
        connection.close().map_err(|(_, error)| failed(&path, "close")(error))?;
        stored.bytes = std::fs::metadata(&path).map_err(Error::io(&path, "read"))?.len();
        // Reset the header's change counter and the counter that its file size is valid for. The
        // bytes are then the same no matter how often the export was resumed.
        let (mut output, counter) = (output, 1u32.to_be_bytes());
        for place in CHANGE_COUNTERS {
            output.overwrite(place, &counter).map_err(Error::io(output.path(), "write"))?;
        }
        output.commit()?;
        Ok(stored)
    }
}

/// An archive in which tiles are replaced: all at once, or none.
pub(super) struct MbtilesEdit {
    path: PathBuf,
    connection: Connection,
    own: SpinneyMetadata,
    digest: Digest,
}

impl MbtilesEdit {
    pub(super) fn open(path: &Path) -> Result<MbtilesEdit> {
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(failed(path, "open"))?;
        // Do not wait for a lock: the state of the tree that was read may be outdated by then.
        connection.busy_timeout(std::time::Duration::ZERO).map_err(failed(path, "open"))?;
        connection.execute_batch("BEGIN IMMEDIATE").map_err(failed(path, "lock"))?;
        let own = own(&connection, path)?;
        let digest = Digest::parse(&own.digest);
        let digest =
            digest.ok_or_else(|| Error::corrupt(path, "metadata", "no hash", "the hash of all tiles"))?;
        Ok(MbtilesEdit { path: path.to_path_buf(), connection, own, digest })
    }
}

impl TileEdit for MbtilesEdit {
    fn own(&self) -> &SpinneyMetadata {
        &self.own
    }

    fn replace(&mut self, tile: TileId, made: Option<&Encoded>) -> Result<()> {
        let number = tile.number();
        let at = params![tile.zoom, tile.column, tms_row(tile)];
        let found: Option<String> = self
            .connection
            .prepare_cached(
                "DELETE FROM map WHERE zoom_level = ?1 AND tile_column = ?2 AND tile_row = ?3 RETURNING tile_id",
            )
            .and_then(|mut statement| statement.query_row(at, |row| row.get(0)).optional())
            .map_err(failed(&self.path, "write"))?;
        if let Some(hash) = found.and_then(|name| u128::from_str_radix(&name, 16).ok()) {
            self.digest.remove(number, 1, hash);
            self.own.tiles = self.own.tiles.saturating_sub(1);
        }
        if let Some(made) = made {
            insert(&self.connection, std::iter::once(tile), made).map_err(failed(&self.path, "write"))?;
            self.digest.add(number, 1, made.hash);
            self.own.tiles += 1;
        }
        Ok(())
    }

    fn finish(self: Box<Self>, about: &TilesetMetadata, _: &dyn Progress) -> Result<TileArchiveSummary> {
        let wrong = || failed(&self.path, "write");
        let run = |statements: &str| self.connection.execute_batch(statements).map_err(wrong());
        // Contents that no tile refers to any more.
        run("DELETE FROM images WHERE tile_id NOT IN (SELECT tile_id FROM map); DELETE FROM metadata")?;
        for (name, value) in about.mbtiles_rows(self.own.tiles, self.digest) {
            let inserted = self.connection.execute("INSERT INTO metadata VALUES (?1, ?2)", [name, value]);
            inserted.map_err(wrong())?;
        }
        run("COMMIT")?;
        let contents: i64 = self
            .connection
            .query_row("SELECT count(*) FROM images", [], |row| row.get(0))
            .map_err(failed(&self.path, "read"))?;
        let bytes = std::fs::metadata(&self.path).map_err(Error::io(&self.path, "read"))?.len();
        Ok(TileArchiveSummary { tiles: self.own.tiles, contents: contents.max(0) as u64, bytes, copied: 0 })
    }
}

/// Reads Spinney's own metadata of an archive.
fn own(connection: &Connection, path: &Path) -> Result<SpinneyMetadata> {
    let text: Option<String> = connection
        .query_row("SELECT value FROM metadata WHERE name = 'spinney'", [], |row| row.get(0))
        .optional()
        .map_err(failed(path, "read"))?;
    let own = text.and_then(|text| serde_json::from_str(&text).ok());
    own.ok_or_else(|| {
        let advice = "only archives by `spinney export` record how they were made";
        Error::unsupported(path, "an archive by another program", advice)
    })
}

/// Maximum number of reported findings.
const MAX_FINDINGS: usize = 100;

/// Checks the database, that all tiles exist, and that contents match the hashes in their keys.
///
/// # Errors
/// If the archive cannot be read or was not written by Spinney, or on cancellation.
pub(super) fn verify(path: &Path, progress: &dyn Progress) -> Result<Vec<Finding>> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags).map_err(failed(path, "open"))?;
    // The schema is untrusted: it must not execute anything.
    let set = connection
        .execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0");
    set.map_err(failed(path, "read"))?;
    let own = own(&connection, path)?;
    let mut findings = Vec::new();
    let mut report = |place: String, problem: String| {
        if findings.len() < MAX_FINDINGS {
            findings.push(Finding { place, problem });
        }
    };
    let sound: String =
        connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0)).map_err(failed(path, "read"))?;
    if sound != "ok" {
        report("database".into(), sound);
    }
    let mut statement =
        connection.prepare("SELECT tile_id, tile_data FROM images").map_err(failed(path, "read"))?;
    let mut rows = statement.query([]).map_err(failed(path, "read"))?;
    while let Some(row) = rows.next().map_err(failed(path, "read"))? {
        progress.check()?;
        let name: String = row.get(0).map_err(failed(path, "read"))?;
        let bytes = row.get_ref(1).map_err(failed(path, "read"))?;
        let hash = bytes.as_blob().ok().map(xxhash_rust::xxh3::xxh3_128);
        if hash.is_none_or(|hash| name != name_of(hash)) {
            report(
                format!("image {name:.40}"),
                "the hash of its bytes differs from that of the export".into(),
            );
        }
    }
    let (mut tiles, mut digest) = (0, Digest::default());
    let walked = each_tile(
        &connection,
        |number, hash| {
            progress.check()?;
            progress.advance(1, own.tiles);
            digest.add(number, 1, hash);
            tiles += 1;
            Ok(())
        },
        path,
    );
    match walked {
        Ok(()) => {}
        Err(Error::Corrupt { location: place, found, .. }) => report(place, found),
        Err(error) => return Err(error),
    }
    if (tiles, Some(digest)) != (own.tiles, Digest::parse(&own.digest)) {
        report(
            "tiles".into(),
            format!("found {tiles} tiles, the export wrote {}, or their images differ", own.tiles),
        );
    }
    let lost: i64 = connection
        .query_row("SELECT count(*) FROM map WHERE tile_id NOT IN (SELECT tile_id FROM images)", [], |row| {
            row.get(0)
        })
        .map_err(failed(path, "read"))?;
    if lost > 0 {
        report("tiles".into(), format!("{lost} of them have no image"));
    }
    Ok(findings)
}
