//! Metadata of tile archives: descriptions for maps, and provenance.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json, json};

use super::encode::TileFormat;
use spinney_base::io::without_query;
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;
use spinney_tiles::{GeographicExtent, TileColours};

/// The tree that an archive was made from, in one state.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceState {
    /// File name.
    pub file: String,
    /// Commit number of an Autumnal file.
    pub commit: Option<u64>,
    /// Identifies this state: no other state of the file has the same string.
    pub state: String,
}

impl SourceState {
    /// Determines the state of an open file. For an Autumnal file that is a hash of its commit. For
    /// others it is a hash of the end of the file, which has the checksums of everything else.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(tree: &Dataset) -> Result<SourceState> {
        let path = tree.name();
        let file = without_query(path).file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(commit) = tree.commit() {
            let state = format!("{} cells, {} records, {:?}", commit.cells, commit.inner_nodes, commit.note);
            return Ok(SourceState { file, commit: Some(commit.number), state: hashed(state.as_bytes()) });
        }
        if let Some(state) = tree.listed_state() {
            return Ok(SourceState { file, commit: None, state: format!("a manifest, {state:032x}") });
        }
        let ((input, _), length) = (tree.access().open(path, &[])?, tree.file_size());
        if input.len() < length {
            return Err(Error::Changed { path: path.to_path_buf(), what: "was cut short" });
        }
        let start = length.saturating_sub(4096);
        let tail = input.read(start, (length - start) as usize)?;
        Ok(SourceState { file, commit: None, state: format!("{length} bytes, {}", hashed(&tail)) })
    }
}

impl fmt::Display for SourceState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.commit {
            Some(commit) => write!(f, "commit {commit} of {}", self.file),
            None => write!(f, "{}", self.file),
        }
    }
}

fn hashed(bytes: &[u8]) -> String {
    format!("{:032x}", xxhash_rust::xxh3::xxh3_128(bytes))
}

/// Source and options of a tile archive. They must be equal to resume an export or update the
/// archive.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileProvenance {
    /// The tree.
    pub source: SourceState,
    /// The options as strings, by name.
    pub options: BTreeMap<String, String>,
    /// Mapping of values to colours; `None` if tiles are samples.
    pub(super) colours: Option<TileColours>,
}

impl TileProvenance {
    /// Fails if another export, which is to change the tiles of this one, has other options.
    pub(super) fn check_options(&self, now: &TileProvenance) -> Result<()> {
        let differs = |name: &&String| self.options.get(*name) != now.options.get(*name);
        let names: BTreeSet<&String> =
            self.options.keys().chain(now.options.keys()).filter(differs).collect();
        let listed = |options: &BTreeMap<String, String>| {
            let value =
                |name: &&&String| format!("{name} {}", options.get(**name).map_or("none", String::as_str));
            names.iter().map(|name| value(&name)).collect::<Vec<_>>().join(", ")
        };
        if names.is_empty() {
            return Ok(());
        }
        let expected = format!("the options of the tiles: {}", listed(&self.options));
        Err(Error::invalid("options of the update", listed(&now.options), expected))
    }
}

/// Hash of all tiles of an archive, independent of its format: a sum over tiles, from which
/// replaced tiles can be subtracted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Digest(u128);

impl Digest {
    /// Adds consecutive tiles with the same bytes.
    pub(super) fn add(&mut self, first: u64, count: u64, hash: u128) {
        self.0 = self.0.wrapping_add(Digest::of(first, count, hash));
    }

    /// Subtracts such tiles.
    pub(super) fn remove(&mut self, first: u64, count: u64, hash: u128) {
        self.0 = self.0.wrapping_sub(Digest::of(first, count, hash));
    }

    fn of(first: u64, count: u64, hash: u128) -> u128 {
        let bytes = [&first.to_le_bytes()[..], &count.to_le_bytes(), &hash.to_le_bytes()].concat();
        xxhash_rust::xxh3::xxh3_128(&bytes)
    }

    pub(super) fn text(self) -> String {
        format!("{:032x}", self.0)
    }

    pub(super) fn parse(text: &str) -> Option<Digest> {
        u128::from_str_radix(text, 16).ok().map(Digest)
    }
}

/// Metadata of an archive as a whole.
#[derive(Clone, Debug)]
pub(super) struct TilesetMetadata {
    pub(super) format: TileFormat,
    pub(super) zooms: [u8; 2],
    pub(super) place: GeographicExtent,
    pub(super) side: usize,
    pub(super) name: String,
    pub(super) description: String,
    pub(super) attribution: String,
    /// Meaning of the colours, as plain text or HTML.
    pub(super) legend: String,
    pub(super) provenance: TileProvenance,
}

/// Spinney's own metadata in an archive.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct SpinneyMetadata {
    #[serde(rename = "making")]
    pub(super) provenance: TileProvenance,
    pub(super) tiles: u64,
    pub(super) digest: String,
}

impl TilesetMetadata {
    pub(super) fn centre_zoom(&self) -> u8 {
        self.zooms[0]
    }

    /// Spinney's own metadata.
    pub(super) fn own(&self, tiles: u64, digest: Digest) -> SpinneyMetadata {
        SpinneyMetadata { provenance: self.provenance.clone(), tiles, digest: digest.text() }
    }

    /// Non-empty descriptions of the map.
    fn descriptions(&self) -> Map<String, Json> {
        let descriptions = [
            ("name", &self.name),
            ("description", &self.description),
            ("attribution", &self.attribution),
            ("legend", &self.legend),
        ];
        let there = descriptions.into_iter().filter(|(_, text)| !text.is_empty());
        there.map(|(name, text)| (name.to_owned(), json!(text))).collect()
    }

    /// The JSON metadata of `PMTiles`.
    pub(super) fn pmtiles_json(&self, tiles: u64, digest: Digest) -> String {
        let mut object = self.descriptions();
        object.insert("type".into(), json!("overlay"));
        object.insert("format".into(), json!(self.format.extension()));
        object.insert("tileSize".into(), json!(self.side));
        object.insert("spinney".into(), json!(self.own(tiles, digest)));
        Json::Object(object).to_string()
    }

    /// The `TileJSON` 3.0 document of a tile directory.
    pub(super) fn tile_json(&self, pattern: &str, tiles: u64, digest: Digest) -> String {
        let mut object = Map::new();
        object.insert("tilejson".into(), json!("3.0.0"));
        object.extend(self.descriptions());
        let [longitude, latitude] = self.place.centre;
        object.insert("tiles".into(), json!([pattern]));
        object.insert("minzoom".into(), json!(self.zooms[0]));
        object.insert("maxzoom".into(), json!(self.zooms[1]));
        object.insert("bounds".into(), json!(self.place.bounds));
        object.insert("center".into(), json!([longitude, latitude, self.centre_zoom()]));
        object.insert("format".into(), json!(self.format.extension()));
        object.insert("tileSize".into(), json!(self.side));
        object.insert("vector_layers".into(), json!([]));
        object.insert("spinney".into(), json!(self.own(tiles, digest)));
        serde_json::to_string_pretty(&Json::Object(object)).expect("names are strings") + "\n"
    }

    /// Rows of the table `metadata` of `MBTiles`.
    #[cfg(feature = "mbtiles")]
    pub(super) fn mbtiles_rows(&self, tiles: u64, digest: Digest) -> Vec<(String, String)> {
        let [west, south, east, north] = self.place.bounds;
        let [longitude, latitude] = self.place.centre;
        let mut rows: Vec<(String, String)> = vec![
            ("bounds".into(), format!("{west},{south},{east},{north}")),
            ("center".into(), format!("{longitude},{latitude},{}", self.centre_zoom())),
            ("format".into(), self.format.extension().into()),
            ("maxzoom".into(), self.zooms[1].to_string()),
            ("minzoom".into(), self.zooms[0].to_string()),
            ("type".into(), "overlay".into()),
            ("version".into(), "1".into()),
            ("spinney".into(), json!(self.own(tiles, digest)).to_string()),
        ];
        // The specification requires a name.
        if self.name.is_empty() {
            rows.push(("name".into(), self.provenance.source.file.clone()));
        }
        let text = |text: Json| text.as_str().unwrap_or_default().to_owned();
        rows.extend(self.descriptions().into_iter().map(|(name, value)| (name, text(value))));
        spinney_base::sort::by(&mut rows, &mut Ord::cmp);
        rows
    }
}
