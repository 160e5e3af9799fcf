//! A directory with a file per tile, and `tiles.json` with the metadata of all of them.

mod edit;
mod pending;
mod sink;
mod verify;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

pub(super) use self::edit::DirectoryEdit;
pub(super) use self::sink::DirectorySink;
pub(super) use self::verify::verify;
use super::provenance::SpinneyMetadata;
use spinney_base::io::ConfinedDirectory;
use spinney_base::{Error, Result};
use spinney_tiles::TileId;

/// The document with the metadata of all tiles.
const DOCUMENT: &str = "tiles.json";
/// Maximum size of the document in bytes.
const MAX_DOCUMENT: u64 = 16 << 20;
/// Maximum size of a tile in bytes.
const MAX_TILE: u64 = 256 << 20;
/// Lock file of an update of the directory.
const LOCK: &str = ".lock";

/// Names of tiles below a directory: a pattern with `{z}`, `{x}` and `{y}`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileDirectory {
    base: PathBuf,
    pattern: String,
}

impl TileDirectory {
    /// Parses a pattern such as `map/{z}/{x}/{y}.png`. The base directory is the path before the
    /// first component with a field.
    ///
    /// # Errors
    /// If a field is missing or repeated, there is no directory before the first field, or the path
    /// leads to a parent directory.
    pub fn parse(text: &str) -> Result<TileDirectory> {
        let wrong = || {
            let expected =
                "a directory and a pattern below it with {z}, {x} and {y} once each: map/{z}/{x}/{y}.png";
            Error::invalid("pattern of tile paths", text, expected)
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
        Ok(TileDirectory { base: base.into(), pattern: pattern.to_owned() })
    }

    /// The base directory.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// The file name extension of the tiles.
    pub fn extension(&self) -> Option<&str> {
        Path::new(&self.pattern).extension()?.to_str()
    }

    fn name(&self, tile: TileId) -> String {
        let TileId { zoom, column, row } = tile;
        let name = self.pattern.replace("{z}", &zoom.to_string()).replace("{x}", &column.to_string());
        name.replace("{y}", &row.to_string())
    }

    /// Opens a directory that was written for a pattern of [`TileDirectory::parse`], which its
    /// document stores. Also returns the document.
    fn open(base: &Path) -> Result<(TileDirectory, SpinneyMetadata, Vec<u8>)> {
        let path = base.join(DOCUMENT);
        let corrupt = |found: &str| {
            Error::corrupt(path.as_path(), "document", found, "the TileJSON of an export by this version")
        };
        let text = ConfinedDirectory::new(base).read(DOCUMENT, MAX_DOCUMENT)?;
        let text = text.ok_or_else(|| Error::io(&path, "read")(ErrorKind::NotFound.into()))?;
        let json: serde_json::Value =
            serde_json::from_slice(&text).map_err(|_| corrupt("text that is not JSON"))?;
        let own = json.get("spinney").and_then(|own| serde_json::from_value(own.clone()).ok());
        let pattern = json.pointer("/tiles/0").and_then(serde_json::Value::as_str);
        let (Some(own), Some(pattern)) = (own, pattern) else { return Err(corrupt("another JSON document")) };
        let directory =
            TileDirectory::below(base, pattern).ok_or_else(|| corrupt("no pattern of tile paths"))?;
        Ok((directory, own, text))
    }

    /// Tiles with names of a pattern below a directory.
    fn below(base: &Path, pattern: &str) -> Option<TileDirectory> {
        let directory = TileDirectory::parse(&format!("./{pattern}")).ok()?;
        (directory.base == Path::new(".")).then(|| TileDirectory { base: base.into(), ..directory })
    }

    /// Parses the name of a tile.
    fn tile_of(&self, name: &str) -> Option<TileId> {
        let (mut pattern, mut name_left) = (self.pattern.as_str(), name);
        let mut found = [None; 3];
        while let Some(at) = pattern.find('{') {
            name_left = name_left.strip_prefix(&pattern[..at])?;
            let field = "zxy".find(pattern[at + 1..].chars().next()?)?;
            pattern = &pattern[at + 3..];
            let digits = name_left.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(name_left.len());
            found[field] = name_left[..digits].parse::<u32>().ok();
            name_left = &name_left[digits..];
        }
        let zoom = u8::try_from(found[0]?).ok().filter(|zoom| *zoom <= spinney_tiles::MAX_ZOOM)?;
        let (column, row) = (found[1]?, found[2]?);
        let tile = TileId { zoom, column, row };
        let is_tile = column >> zoom == 0 && row >> zoom == 0 && self.name(tile) == name;
        (is_tile && pattern == name_left).then_some(tile)
    }
}

/// Whether a directory has the document of a tile export.
pub fn is_tile_directory(path: &Path) -> bool {
    path.is_dir() && path.join(DOCUMENT).is_file()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_need_a_directory_and_each_field_once() {
        let directory = TileDirectory::parse("a/b/{z}/{x}/{y}.png").expect("a good pattern");
        assert_eq!((directory.base(), directory.extension()), (Path::new("a/b"), Some("png")));
        assert_eq!(directory.name(TileId { zoom: 3, column: 4, row: 5 }), "3/4/5.png");
        let flat = TileDirectory::parse("/t/{z}-{y}-{x}.webp").expect("a good pattern");
        assert_eq!(flat.name(TileId { zoom: 3, column: 4, row: 5 }), "3-5-4.webp");
        for bad in [
            "{z}/{x}/{y}.png",
            "a/{z}/{x}.png",
            "a/{z}/{x}/{y}{y}.png",
            "/{z}/{x}/{y}.png",
            "a/{z}/../{x}{y}",
        ] {
            assert!(TileDirectory::parse(bad).is_err(), "{bad}");
        }
    }
}
