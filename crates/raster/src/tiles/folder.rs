//! A folder with a file for each tile, and `tiles.json` about all of them.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::encode::Encoded;
use super::journal::{Checkpoint, Entry, Journal};
use super::making::{About, Digest, Own};
use super::place::TileId;
use super::sink::{Stored, TileEdit, TileSink};
use super::walk::TileRun;
use spinney_base::io::{Unfinished, folder, partial_of, sync_folder};
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;

/// The document about all tiles.
const DOCUMENT: &str = "tiles.json";
const JOURNAL: &str = ".journal";
/// Bytes that the document may have.
const MOST_DOCUMENT: u64 = 16 << 20;

/// Names of tiles below a folder: a pattern with `{z}`, `{x}` and `{y}`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileFolder {
    base: PathBuf,
    pattern: String,
}

impl TileFolder {
    /// The folder of a pattern such as `map/{z}/{x}/{y}.png`: that before the first component with a field.
    ///
    /// # Errors
    /// If a field is missing or comes twice, there is nothing before the first, or the way leads up.
    pub fn parse(text: &str) -> Result<TileFolder> {
        let wrong = || {
            let expected =
                "a folder, and below it names with {z}, {x} and {y}, each once: map/{z}/{x}/{y}.png";
            Error::invalid("names of tiles", text, expected)
        };
        if ["{z}", "{x}", "{y}"].iter().any(|field| text.matches(field).count() != 1) {
            return Err(wrong());
        }
        let field = text.find('{').unwrap_or_default();
        let start = text[..field].rfind('/').ok_or_else(wrong)?;
        let (base, pattern) = (&text[..start], &text[start + 1..]);
        let leads_up = pattern.split('/').any(|part| matches!(part, "" | "." | ".."));
        if base.is_empty() || leads_up || pattern == DOCUMENT {
            return Err(wrong());
        }
        Ok(TileFolder { base: base.into(), pattern: pattern.to_owned() })
    }

    /// The folder.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// The end of the tiles' names.
    pub fn extension(&self) -> Option<&str> {
        Path::new(&self.pattern).extension()?.to_str()
    }

    fn name(&self, tile: TileId) -> String {
        let TileId { zoom, column, row } = tile;
        let name = self.pattern.replace("{z}", &zoom.to_string()).replace("{x}", &column.to_string());
        name.replace("{y}", &row.to_string())
    }

    /// The folder that [`TileFolder::parse`] made of a pattern, as its document says.
    fn open(base: &Path) -> Result<(TileFolder, Own)> {
        let path = base.join(DOCUMENT);
        let corrupt = |found: &str| {
            Error::corrupt(path.as_path(), "document", found, "the TileJSON of an export of ours")
        };
        let length = fs::metadata(&path).map_err(Error::io(&path, "read"))?.len();
        if length > MOST_DOCUMENT {
            return Err(corrupt("more than 16 MiB"));
        }
        let text = fs::read(&path).map_err(Error::io(&path, "read"))?;
        let json: serde_json::Value = serde_json::from_slice(&text).map_err(|_| corrupt("no JSON"))?;
        let own = json.get("spinney").and_then(|own| serde_json::from_value(own.clone()).ok());
        let pattern = json.pointer("/tiles/0").and_then(serde_json::Value::as_str);
        let (Some(own), Some(pattern)) = (own, pattern) else { return Err(corrupt("another document")) };
        let folder =
            TileFolder::parse(&format!("./{pattern}")).map_err(|_| corrupt("no pattern of names"))?;
        Ok((TileFolder { base: base.into(), ..folder }, own))
    }
}

/// Whether a folder has the document of an export.
pub fn is_tile_folder(path: &Path) -> bool {
    path.is_dir() && path.join(DOCUMENT).is_file()
}

/// Tiles that are being written, below a folder with another name.
pub(super) struct FolderSink {
    folder: TileFolder,
    /// The folder until it is finished.
    place: PathBuf,
    journal: Journal,
    at: Checkpoint,
    /// Whether it stays if the export is interrupted.
    is_kept: bool,
    unfinished: Option<Unfinished>,
    /// The subfolder that was made last.
    made: PathBuf,
}

impl FolderSink {
    /// Starts a folder; with `making`, which describes the export, goes on with one that was interrupted.
    pub(super) fn create(target: &TileFolder, making: Option<&str>) -> Result<FolderSink> {
        let base = target.base();
        let is_taken = fs::read_dir(base).is_ok_and(|mut entries| entries.next().is_some()) || base.is_file();
        if is_taken {
            let advice = "choose another folder, remove it, or see --update";
            return Err(Error::unsupported(base, "writing tiles where something is", advice));
        }
        let (place, journal, at) = match making {
            Some(making) => {
                let place = partial_of(base);
                fs::create_dir_all(&place).map_err(Error::io(&place, "make the folder"))?;
                let (journal, at) = Journal::resumable(&place.join(JOURNAL), making, &mut |_| {})?;
                (place, journal, at)
            }
            None => {
                let above = folder(base);
                fs::create_dir_all(above).map_err(Error::io(above, "make the folder"))?;
                let prefix = format!(".{}.", base.file_name().unwrap_or_default().to_string_lossy());
                let mut names = tempfile::Builder::new();
                let made =
                    names.prefix(&prefix).suffix(".partial").make_in(above, |path| fs::create_dir(path));
                let failed = || Error::io(base, "make a temporary folder beside");
                let place = made.map_err(failed())?.into_temp_path().keep();
                let place = place.map_err(|error| failed()(error.error))?;
                (place, Journal::temporary(above)?, Checkpoint::default())
            }
        };
        let is_kept = making.is_some();
        let unfinished = (!is_kept).then(|| Unfinished::new(&place));
        Ok(FolderSink {
            folder: target.clone(),
            place,
            journal,
            at,
            is_kept,
            unfinished,
            made: PathBuf::new(),
        })
    }

    fn write(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.place.join(name);
        let above = folder(&path);
        if above != self.made {
            fs::create_dir_all(above).map_err(Error::io(above, "make the folder"))?;
            self.made = above.to_path_buf();
        }
        fs::write(&path, bytes).map_err(Error::io(&path, "write"))
    }

    /// Makes all files durable.
    fn sync(&self) -> Result<()> {
        spinney_base::io::platform::sync_all_below(&self.place).map_err(Error::io(&self.place, "sync"))
    }
}

impl TileSink for FolderSink {
    fn done(&self) -> u64 {
        self.at.runs
    }

    fn push(&mut self, run: &TileRun, tile: Option<&Encoded>) -> Result<()> {
        self.at.runs += 1;
        let Some(tile) = tile else { return Ok(()) };
        for number in run.first..run.first + run.count {
            let place = TileId::from_number(number).expect("a run of tiles");
            let name = self.folder.name(place);
            self.write(&name, &tile.bytes)?;
        }
        let (offset, length) = (self.at.bytes, tile.bytes.len() as u32);
        self.at.bytes += u64::from(length) * run.count;
        self.journal.push(&Entry { first: run.first, count: run.count, offset, length, hash: tile.hash })
    }

    fn checkpoint(&mut self) -> Result<()> {
        if !self.is_kept {
            return Ok(());
        }
        self.sync()?;
        self.journal.checkpoint(self.at)
    }

    fn finish(mut self: Box<Self>, about: &About) -> Result<Stored> {
        let (mut stored, mut digest) = (Stored::default(), Digest::default());
        self.journal.entries(|entry| {
            stored.tiles += entry.count;
            (entry.first..entry.first + entry.count).for_each(|number| digest.add(number, 1, entry.hash));
            Ok(())
        })?;
        (stored.contents, stored.bytes) = (stored.tiles, self.at.bytes);
        let document = about.tile_json(&self.folder.pattern, stored.tiles, digest);
        self.write(DOCUMENT, document.as_bytes())?;
        self.sync()?;
        let base = self.folder.base().to_path_buf();
        if self.is_kept {
            let journal = self.place.join(JOURNAL);
            fs::remove_file(&journal).map_err(Error::io(&journal, "remove"))?;
        }
        // (An empty folder may be in its place.)
        let _ = fs::remove_dir(&base);
        fs::rename(&self.place, &base).map_err(Error::io(&base, "put in place"))?;
        self.unfinished = None;
        sync_folder(folder(&base)).map_err(Error::io(&base, "sync the folder"))?;
        Ok(stored)
    }
}

impl Drop for FolderSink {
    fn drop(&mut self) {
        if self.unfinished.is_some() {
            let _ = fs::remove_dir_all(&self.place);
        }
    }
}

/// Tiles that are in their folder already and get replaced, one by one.
pub(super) struct FolderEdit {
    folder: TileFolder,
    own: Own,
    digest: Digest,
}

impl FolderEdit {
    pub(super) fn open(base: &Path) -> Result<FolderEdit> {
        let (folder, own) = TileFolder::open(base)?;
        let digest = Digest::parse(&own.digest);
        let bad = || Error::corrupt(base, "document", "no hash", "that of all tiles");
        Ok(FolderEdit { folder, digest: digest.ok_or_else(bad)?, own })
    }
}

impl TileEdit for FolderEdit {
    fn own(&self) -> &Own {
        &self.own
    }

    fn replace(&mut self, tile: TileId, made: Option<&Encoded>) -> Result<()> {
        let path = self.folder.base.join(self.folder.name(tile));
        let old = match fs::read(&path) {
            Ok(bytes) => Some(bytes),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(Error::io(&path, "read")(error)),
        };
        let number = tile.number();
        if let Some(old) = &old {
            self.digest.remove(number, 1, xxhash_rust::xxh3::xxh3_128(old));
            self.own.tiles = self.own.tiles.saturating_sub(1);
        }
        match made {
            Some(made) => {
                self.digest.add(number, 1, made.hash);
                self.own.tiles += 1;
                // (Half a tile must not be seen.)
                let above = folder(&path);
                fs::create_dir_all(above).map_err(Error::io(above, "make the folder"))?;
                let mut file = tempfile::NamedTempFile::new_in(above).map_err(Error::io(&path, "write"))?;
                file.write_all(&made.bytes).map_err(Error::io(&path, "write"))?;
                spinney_base::io::platform::set_output_permissions(file.as_file(), &path)
                    .map_err(Error::io(&path, "set the permissions"))?;
                file.persist(&path).map_err(|error| Error::io(&path, "put in place")(error.error))?;
            }
            None if old.is_some() => fs::remove_file(&path).map_err(Error::io(&path, "remove"))?,
            None => {}
        }
        Ok(())
    }

    fn finish(self: Box<Self>, about: &About) -> Result<Stored> {
        let base = self.folder.base();
        spinney_base::io::platform::sync_all_below(base).map_err(Error::io(base, "sync"))?;
        let document = about.tile_json(&self.folder.pattern, self.own.tiles, self.digest);
        let mut output = spinney_base::io::Output::create(&base.join(DOCUMENT))?;
        output.write_all(document.as_bytes()).map_err(Error::io(base, "write"))?;
        output.commit()?;
        Ok(Stored { tiles: self.own.tiles, contents: self.own.tiles, ..Stored::default() })
    }
}

/// Checks that a folder has the tiles that were written, and their bytes.
///
/// # Errors
/// If it cannot be read, is no folder of ours, or on interruption.
pub(super) fn verify(base: &Path, progress: &dyn Progress) -> Result<Vec<Finding>> {
    let (names, own) = TileFolder::open(base)?;
    let mut check =
        Walked { names: &names, tiles: 0, digest: Digest::default(), total: own.tiles, findings: Vec::new() };
    check.folder(base, &mut Vec::new(), progress)?;
    if (check.tiles, Some(check.digest)) != (own.tiles, Digest::parse(&own.digest)) {
        let problem = format!(
            "not the tiles that were written: there are {}, there were {}; or the hash of their bytes is another one",
            check.tiles, own.tiles
        );
        check.findings.push(Finding { place: "tiles".into(), problem });
    }
    Ok(check.findings)
}

struct Walked<'a> {
    names: &'a TileFolder,
    tiles: u64,
    digest: Digest,
    total: u64,
    findings: Vec<Finding>,
}

impl Walked<'_> {
    fn folder(&mut self, path: &Path, above: &mut Vec<String>, progress: &dyn Progress) -> Result<()> {
        let failed = || Error::io(path, "read the folder");
        for entry in fs::read_dir(path).map_err(failed())? {
            progress.check()?;
            let entry = entry.map_err(failed())?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let kind = entry.file_type().map_err(failed())?;
            let path = entry.path();
            above.push(name);
            let parts = self.names.pattern.split('/').count();
            if kind.is_dir() && above.len() < parts {
                self.folder(&path, above, progress)?;
            } else if kind.is_file() && above.len() == parts {
                match self.tile(&above.join("/")) {
                    Some(tile) => {
                        let bytes = fs::read(&path).map_err(Error::io(&path, "read"))?;
                        self.digest.add(tile.number(), 1, xxhash_rust::xxh3::xxh3_128(&bytes));
                        self.tiles += 1;
                        progress.advance(1, self.total);
                    }
                    None => self.stranger(&path),
                }
            } else if !(above.len() == 1 && above[0] == DOCUMENT) {
                self.stranger(&path);
            }
            above.pop();
        }
        Ok(())
    }

    fn stranger(&mut self, path: &Path) {
        if self.findings.len() < 100 {
            let problem = "no tile, and nothing that an export writes".into();
            self.findings.push(Finding { place: path.display().to_string(), problem });
        }
    }

    /// The tile with a name.
    fn tile(&self, name: &str) -> Option<TileId> {
        let (mut pattern, mut name_left) = (self.names.pattern.as_str(), name);
        let mut found = [None; 3];
        while let Some(at) = pattern.find('{') {
            name_left = name_left.strip_prefix(&pattern[..at])?;
            let field = "zxy".find(pattern[at + 1..].chars().next()?)?;
            pattern = &pattern[at + 3..];
            let digits = name_left.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(name_left.len());
            found[field] = name_left[..digits].parse::<u32>().ok();
            name_left = &name_left[digits..];
        }
        let zoom = u8::try_from(found[0]?).ok().filter(|zoom| *zoom <= super::place::MAX_ZOOM)?;
        let (column, row) = (found[1]?, found[2]?);
        let tile = TileId { zoom, column, row };
        let is_tile = column >> zoom == 0 && row >> zoom == 0 && self.names.name(tile) == name;
        (is_tile && pattern == name_left).then_some(tile)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_need_a_folder_and_each_field_once() {
        let folder = TileFolder::parse("a/b/{z}/{x}/{y}.png").expect("a good pattern");
        assert_eq!((folder.base(), folder.extension()), (Path::new("a/b"), Some("png")));
        assert_eq!(folder.name(TileId { zoom: 3, column: 4, row: 5 }), "3/4/5.png");
        let flat = TileFolder::parse("/t/{z}-{y}-{x}.webp").expect("a good pattern");
        assert_eq!(flat.name(TileId { zoom: 3, column: 4, row: 5 }), "3-5-4.webp");
        for bad in [
            "{z}/{x}/{y}.png",
            "a/{z}/{x}.png",
            "a/{z}/{x}/{y}{y}.png",
            "/{z}/{x}/{y}.png",
            "a/{z}/../{x}{y}",
        ] {
            assert!(TileFolder::parse(bad).is_err(), "{bad}");
        }
    }
}
