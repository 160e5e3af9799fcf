//! Sources that STAC items name: the GeoTIFF asset of each item in an item's file, an item
//! collection, or a file of items (NDJSON).

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use super::sources::SourceFile;
use crate::import::stack::time::is_time;
use serde::Deserialize;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};
use spinney_base::io::{
    FileAccess, InputFile, gdal_url, listed_path, local_path, split_query, url_of, without_query,
};
use spinney_base::{Error, Result};

/// Maximum size of an item, and of what is between items, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Bytes that are read at a time. (Each read of a remote file takes a request.)
const BUFFER: usize = 4 << 20;

/// Maximum number of items.
const MAX_ITEMS: usize = 1_000_000;

/// Maximum number of assets of an item.
const MAX_ASSETS: usize = 10_000;

/// Extensions of files that are no STAC documents, so that these are not opened for it.
const RASTERS: [&str; 4] = ["tif", "tiff", "gtiff", "vrt"];

/// Returns the files of an asset of STAC items, in the items' order; `None` if a file has no STAC
/// items. Without the name of an asset, each item must have one GeoTIFF asset with the role "data".
///
/// # Errors
/// If the file is corrupt or too large, an item has no such asset, or its file is not a GeoTIFF; if
/// `access` refuses external files.
pub(super) fn assets_of(
    path: &Path,
    asset: Option<&str>,
    access: &FileAccess,
) -> Result<Option<Vec<SourceFile>>> {
    let extension = without_query(path).extension().unwrap_or_default();
    if RASTERS.iter().any(|raster| extension.eq_ignore_ascii_case(raster)) || local_path(path).is_dir() {
        return Ok(None);
    }
    let mut file = access.input(path)?;
    if !starts_as_object(path, &mut file)? {
        return Ok(None);
    }
    read_items(path, access.input(path)?, asset, access)
}

/// Whether the first character of a file opens a JSON object.
fn starts_as_object(path: &Path, file: &mut InputFile) -> Result<bool> {
    let mut start = Vec::new();
    file.take(64).read_to_end(&mut start).map_err(Error::io(path, "read"))?;
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start);
    Ok(text.trim_ascii_start().first() == Some(&b'{'))
}

fn read_items(
    path: &Path,
    file: impl Read,
    asset: Option<&str>,
    access: &FileAccess,
) -> Result<Option<Vec<SourceFile>>> {
    let mut text = BufReader::with_capacity(BUFFER, file);
    let has_mark = text.fill_buf().map_err(Error::io(path, "read"))?.starts_with(b"\xef\xbb\xbf");
    text.consume(if has_mark { 3 } else { 0 });
    let left = Cell::new(MAX_BYTES);
    let mut items = Items {
        path,
        asset,
        access,
        left: &left,
        files: Vec::new(),
        is_stac: false,
        has_others: false,
        failed: None,
    };
    let mut parser = serde_json::Deserializer::from_reader(Limited { text, left: &left });
    for number in 1.. {
        let parsed = Document { items: &mut items, is_listed: false }.deserialize(&mut parser);
        if let Some(error) = items.failed {
            return Err(error);
        }
        let problem = match parsed {
            Ok(_) if !items.is_stac => return Ok(None),
            Ok(()) => match parser.end() {
                Ok(()) => break,
                // Another item follows.
                Err(_) => continue,
            },
            Err(problem) => problem,
        };
        if left.get() == 0 && items.is_stac {
            let found = format!("a JSON document with a member of more than {MAX_BYTES} bytes");
            return Err(Error::unsupported(path, found, "write STAC items one a line (NDJSON)"));
        }
        if problem.is_io() && left.get() > 0 {
            return Err(Error::io(path, "read")(io::Error::from(problem)));
        }
        if !items.is_stac {
            // Other readers describe what is wrong.
            return Ok(None);
        }
        let found = format!("{problem} (document {number})");
        return Err(Error::corrupt(
            path,
            "STAC items",
            found,
            "JSON: an item, an item collection, or items, one a line",
        ));
    }
    if items.files.is_empty() || items.has_others {
        let found = if items.has_others { "other features" } else { "no items" };
        return Err(Error::corrupt(path, "STAC items", found, "items, and nothing else"));
    }
    Ok(Some(items.files))
}

/// Reads until there are no bytes left in the budget.
struct Limited<'l, R> {
    text: R,
    left: &'l Cell<u64>,
}

impl<R: Read> Read for Limited<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let most = buffer.len().min(self.left.get() as usize);
        if most == 0 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let read = self.text.read(&mut buffer[..most])?;
        self.left.set(self.left.get() - read as u64);
        Ok(read)
    }
}

/// The items that were read so far.
struct Items<'i> {
    path: &'i Path,
    asset: Option<&'i str>,
    access: &'i FileAccess,
    /// Bytes that may be read until the next item is complete.
    left: &'i Cell<u64>,
    files: Vec<SourceFile>,
    is_stac: bool,
    /// Whether there are features that are no items.
    has_others: bool,
    /// Why reading ends. (Errors of parsers are strings.)
    failed: Option<Error>,
}

/// A document: an item, or a collection of items. Only members that matter are kept in memory.
struct Document<'d, 'i> {
    items: &'d mut Items<'i>,
    /// Whether it is an item in a collection.
    is_listed: bool,
}

/// The items of a collection.
struct Features<'d, 'i>(&'d mut Items<'i>);

#[derive(Default)]
struct Item {
    kind: String,
    id: String,
    is_stac: bool,
    assets: BTreeMap<String, Asset>,
    time: Option<String>,
    /// URL of the item.
    own: Option<String>,
    /// Whether it is in a collection.
    is_listed: bool,
}

#[derive(Deserialize)]
struct Asset {
    href: String,
    #[serde(rename = "type")]
    media: Option<String>,
    #[serde(default)]
    roles: Option<Vec<String>>,
}

#[derive(Deserialize)]
struct Properties {
    #[serde(default)]
    datetime: serde_json::Value,
    #[serde(default)]
    start_datetime: serde_json::Value,
}

#[derive(Deserialize)]
struct Link {
    #[serde(default)]
    rel: String,
    #[serde(default)]
    href: String,
}

impl<'de> DeserializeSeed<'de> for Document<'_, '_> {
    type Value = ();

    fn deserialize<D: serde::Deserializer<'de>>(self, parser: D) -> std::result::Result<(), D::Error> {
        parser.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Document<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a STAC item")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> std::result::Result<(), M::Error> {
        let Document { items, is_listed } = self;
        let mut item = Item { is_listed, ..Item::default() };
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "type" => item.kind = map.next_value()?,
                "id" => item.id = map.next_value::<serde_json::Value>()?.as_str().unwrap_or_default().into(),
                "stac_version" => {
                    map.next_value::<IgnoredAny>()?;
                    item.is_stac = true;
                    items.is_stac = true;
                }
                "assets" => item.assets = map.next_value()?,
                "properties" => {
                    let found: Option<Properties> = map.next_value()?;
                    let times = found.map(|found| [found.datetime, found.start_datetime]);
                    let mut times = times.iter().flatten().filter_map(|time| time.as_str());
                    item.time = times.next().filter(|time| is_time(time)).map(str::to_string);
                }
                "links" => {
                    let links: Vec<Link> = map.next_value()?;
                    item.own = links.into_iter().find(|link| link.rel == "self").map(|link| link.href);
                }
                "features" if !is_listed => map.next_value_seed(Features(items))?,
                _ => {
                    map.next_value::<IgnoredAny>()?;
                }
            }
        }
        items.add(item).map_err(|error| {
            items.failed = Some(error);
            serde::de::Error::custom("an item")
        })
    }
}

impl<'de> DeserializeSeed<'de> for Features<'_, '_> {
    type Value = ();

    fn deserialize<D: serde::Deserializer<'de>>(self, parser: D) -> std::result::Result<(), D::Error> {
        parser.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Features<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an array of STAC items")
    }

    fn visit_seq<S: SeqAccess<'de>>(self, mut features: S) -> std::result::Result<(), S::Error> {
        while features.next_element_seed(Document { items: &mut *self.0, is_listed: true })?.is_some() {}
        Ok(())
    }
}

impl Items<'_> {
    /// Adds the file of an item's asset.
    fn add(&mut self, item: Item) -> Result<()> {
        self.left.set(MAX_BYTES);
        match (&*item.kind, item.is_stac) {
            ("Feature", true) => {}
            // Its features are items, of which each has been added.
            ("FeatureCollection", _) => return Ok(()),
            ("Collection" | "Catalog", true) => {
                let found = format!("a STAC {}, which has no rasters,", item.kind.to_lowercase());
                let advice = "save the items that you need in one file, such as the result of a search";
                return Err(Error::unsupported(self.path, found, advice));
            }
            _ if self.is_stac => {
                let found =
                    format!("type {:?}, {}", item.kind, if item.is_stac { "an item" } else { "no item" });
                return Err(Error::corrupt(
                    self.path,
                    item.place(),
                    found,
                    "a STAC item (type \"Feature\" and stac_version)",
                ));
            }
            // Nothing is known of the next ones.
            _ => {
                self.has_others = true;
                return Ok(());
            }
        }
        if self.files.len() == MAX_ITEMS || item.assets.len() > MAX_ASSETS {
            let found = format!("more than {MAX_ITEMS} items, or {MAX_ASSETS} assets of one,");
            return Err(Error::unsupported(self.path, found, "divide the items into several files"));
        }
        let (name, asset) = self.choose(&item)?;
        if !asset.is_geotiff() {
            let found = format!("asset {name} of type {}", asset.media.as_deref().unwrap_or("(none)"));
            let advice = format!("choose a GeoTIFF with --asset NAME: {}", item.listed(Asset::is_geotiff));
            return Err(Error::unsupported(self.path, format!("{}, {found},", item.place()), advice));
        }
        let file = self.file_of(&item, asset)?;
        self.access.check_external(self.path, &file)?;
        self.files.push(SourceFile::new(file, item.time));
        Ok(())
    }

    /// Chooses an asset.
    fn choose<'a>(&self, item: &'a Item) -> Result<(&'a str, &'a Asset)> {
        if let Some(name) = self.asset {
            let found = item.assets.get_key_value(name).map(|(name, asset)| (&**name, asset));
            return found.ok_or_else(|| {
                let found = format!("{} without an asset {name}", item.place());
                Error::unsupported(self.path, found, format!("its assets are: {}", item.listed(|_| true)))
            });
        }
        let mut data = item.assets.iter().filter(|(_, asset)| asset.is_geotiff() && asset.is_data());
        match (data.next(), data.next()) {
            (Some((name, asset)), None) => Ok((name, asset)),
            (first, _) => {
                let many = if first.is_some() { "several" } else { "no" };
                let found = format!("{} with {many} GeoTIFF assets of the role \"data\"", item.place());
                let advice = format!("choose one with --asset NAME: {}", item.listed(Asset::is_geotiff));
                Err(Error::unsupported(self.path, found, advice))
            }
        }
    }

    /// Returns the path or URL of an asset's file. Relative names are relative to the item.
    fn file_of(&self, item: &Item, asset: &Asset) -> Result<PathBuf> {
        let href = &*asset.href;
        let invalid = |found: String| {
            let expected = "a path, or the URL of a file on a web server or in a bucket";
            Err(Error::corrupt(self.path, item.place(), found, expected))
        };
        if href.is_empty() || href.len() > 1 << 13 || href.contains(char::is_control) {
            return invalid(format!("a name of {} bytes", href.len()));
        }
        let url = gdal_url(href);
        let href = url.as_deref().unwrap_or(href);
        if url_of(Path::new(href)).is_some() {
            return Ok(href.into());
        }
        if href.starts_with("/vsi") || href.contains("://") && !href.starts_with("file://") {
            return invalid(format!("the name {href}"));
        }
        if url_of(self.path).is_none() && href.starts_with("file://") {
            return Ok(href.into());
        }
        let plain = href.trim_start_matches("./");
        let own = item.own.as_deref().map(Path::new).filter(|own| url_of(own).is_some());
        // An item of a collection is relative to its own URL. One in a file of its own is relative
        // to this file, unless it was copied without its assets.
        if let Some(own) = own {
            let near = listed_path(self.path, plain);
            let is_copy = item.is_listed
                || url_of(self.path).is_none() && near.as_ref().is_ok_and(|near| !local_path(near).exists());
            return if is_copy { listed_path(own, plain) } else { near };
        }
        listed_path(self.path, plain)
    }
}

impl Item {
    /// Names the item in messages.
    fn place(&self) -> String {
        let id: String = self.id.chars().take(200).collect();
        format!("STAC item {id}")
    }

    /// Names of assets in messages.
    fn listed(&self, is_one: impl Fn(&Asset) -> bool) -> String {
        let mut names = self.assets.iter().filter(|(_, asset)| is_one(asset)).map(|(name, _)| &**name);
        let some: Vec<&str> = names.by_ref().take(40).collect();
        match (some.is_empty(), names.next()) {
            (true, _) => "(it has none)".into(),
            (_, None) => some.join(", "),
            (_, Some(_)) => format!("{}, ...", some.join(", ")),
        }
    }
}

impl Asset {
    /// Whether it is a GeoTIFF by its type, or without a type by its name.
    fn is_geotiff(&self) -> bool {
        let Some(media) = &self.media else {
            let name = Path::new(split_query(&self.href).0);
            let is_one =
                |ending: &&str| name.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
            return ["tif", "tiff"].iter().any(is_one);
        };
        media.split(';').next().unwrap_or_default().trim().eq_ignore_ascii_case("image/tiff")
    }

    fn is_data(&self) -> bool {
        self.roles.iter().flatten().any(|role| role == "data")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIFF: &str = "image/tiff; application=geotiff; profile=cloud-optimized";

    /// Assets as JSON: name, href, type, role.
    fn item(id: &str, own: Option<&str>, assets: &[[&str; 4]]) -> String {
        let assets = assets.iter().map(|[name, href, media, role]| {
            let media = (!media.is_empty()).then_some(*media);
            (*name, serde_json::json!({ "href": href, "type": media, "roles": [role, "x"] }))
        });
        let assets: BTreeMap<_, _> = assets.collect();
        let links: Vec<_> = own.iter().map(|own| serde_json::json!({ "rel": "self", "href": own })).collect();
        serde_json::json!({
            "type": "Feature", "stac_version": "1.0.0", "id": id, "geometry": { "type": "Point" },
            "assets": assets, "links": links, "properties": { "type": "x", "features": [1] },
        })
        .to_string()
    }

    fn read_at(path: &str, text: &str, asset: Option<&str>) -> Result<Option<Vec<String>>> {
        let files = read_items(Path::new(path), text.as_bytes(), asset, &FileAccess::new())?;
        Ok(files.map(|files| files.iter().map(|file| file.path.to_str().unwrap().into()).collect()))
    }

    fn read(text: &str, asset: Option<&str>) -> Result<Option<Vec<String>>> {
        read_at("d/items.json", text, asset)
    }

    #[test]
    fn items_name_their_only_data() {
        let first =
            item("a", None, &[["dem", "./a.tif", TIFF, "data"], ["preview", "a.png", "image/png", "data"]]);
        let assets =
            [["B04", "https://h/b.tif?s=1", "image/tiff", "data"], ["thumb", "b_t.tif", "", "overview"]];
        let second = item("b", None, &assets);
        assert_eq!(read(&first, None).unwrap().unwrap(), ["d/a.tif"]);
        let both = ["d/a.tif", "https://h/b.tif?s=1"];
        for text in [
            format!("\u{feff}{first}\n{second}\n\n"),
            format!("{first}{second}"),
            format!("{{\"type\":\"FeatureCollection\",\"features\":[{first},{second}]}}"),
            format!("{{\"features\":[{first},{second}],\"links\":[{{}}],\"type\":\"FeatureCollection\"}}"),
        ] {
            assert_eq!(read(&text, None).unwrap().unwrap(), both, "{text}");
        }
        assert_eq!(read(&second, Some("thumb")).unwrap().unwrap(), ["d/b_t.tif"]);
        assert_eq!(read(&second, Some("B04")).unwrap().unwrap(), ["https://h/b.tif?s=1"]);
    }

    #[test]
    fn items_have_times() {
        for (properties, expected) in [
            ("{\"datetime\":\"2024-05-31T10:30:00Z\",\"x\":[1]}", Some("2024-05-31T10:30:00Z")),
            ("{\"datetime\":null,\"start_datetime\":\"2024-05-31\"}", Some("2024-05-31")),
            ("{\"datetime\":\"yesterday\"}", None),
            ("null", None),
            ("{}", None),
        ] {
            let text = item("a", None, &[["dem", "a.tif", TIFF, "data"]]);
            let (last, text) = (format!(",\"properties\":{properties}}}"), text.strip_suffix('}').unwrap());
            let text = text.to_string() + &last;
            let found =
                read_items(Path::new("i"), text.as_bytes(), None, &FileAccess::new()).unwrap().unwrap();
            assert_eq!(found[0].time.as_deref(), expected, "{properties}");
        }
    }

    #[test]
    fn other_documents_have_no_items() {
        for text in [
            "{}",
            "{\"type\":\"Feature\"}",
            "{\"type\":\"FeatureCollection\",\"features\":[]}",
            "{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\",\"assets\":{}}]}",
            "{\"type\":7}",
            "{\"a\"",
            "{\"type\":\"FeatureCollection\",\"features\":7}",
            "{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\"},{\"a\":1}]}",
        ] {
            assert_eq!(read(text, None).unwrap(), None, "{text}");
        }
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("x");
        for text in ["", " [1]", "II*\0", "{}"] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(assets_of(&path, None, &FileAccess::new()).unwrap(), None);
        }
        std::fs::write(&path, item("a", None, &[["dem", "a.tif", "", "data"]])).unwrap();
        assert_eq!(
            assets_of(&path, None, &FileAccess::new()).unwrap(),
            Some(vec![SourceFile::new(temp.path().join("a.tif"), None)])
        );
        let error = assets_of(&path, None, &FileAccess::new().no_external()).unwrap_err().to_string();
        assert!(error.contains("--no-external") && error.contains("a.tif"), "{error}");
        assert_eq!(assets_of(temp.path(), None, &FileAccess::new()).unwrap(), None);
        assert_eq!(assets_of(Path::new("none.tif"), None, &FileAccess::new()).unwrap(), None);
    }

    #[test]
    fn errors_name_items_and_assets() {
        let assets = [
            ["red", "r.tif", TIFF, "data"],
            ["nir", "n.tif", TIFF, "data"],
            ["meta", "m.xml", "text/xml", "metadata"],
        ];
        let good = item("S2A", None, &assets);
        let no_data =
            item("S2B", None, &[["red", "r.tif", TIFF, "other"], ["jp2", "r.jp2", "image/jp2", "data"]]);
        for (text, asset, expected) in [
            (
                good.clone(),
                None,
                "item S2A with several GeoTIFF assets of the role \"data\" is not supported; choose one with --asset NAME: nir, red",
            ),
            (
                no_data.clone(),
                None,
                "item S2B with no GeoTIFF assets of the role \"data\" is not supported; choose one with --asset NAME: red",
            ),
            (
                good.clone(),
                Some("blue"),
                "item S2A without an asset blue is not supported; its assets are: meta, nir, red",
            ),
            (
                good.clone(),
                Some("meta"),
                "asset meta of type text/xml, is not supported; choose a GeoTIFF with --asset NAME: nir, red",
            ),
            (format!("{good}\n{{"), Some("red"), "document 2"),
            (format!("{good}\n{{\"x\":\"{}", "x".repeat(17 << 20)), Some("red"), "one a line"),
            (
                format!("{{\"type\":\"FeatureCollection\",\"features\":[{{\"type\":\"Feature\"}},{good}]}}"),
                Some("red"),
                "other features",
            ),
            (
                "{\"type\":\"FeatureCollection\",\"stac_version\":\"1\",\"features\":[]}".into(),
                None,
                "no items",
            ),
            (
                format!("{good}\n{{\"type\":\"Feature\",\"id\":\"x\"}}"),
                Some("red"),
                "STAC item x: found type \"Feature\", no item",
            ),
            ("{\"stac_version\":\"1.0.0\",\"type\":\"Collection\"}".into(), None, "a STAC collection"),
            (
                "{\"stac_version\":\"1.0.0\",\"type\":\"Feature\",\"assets\":[]}".into(),
                None,
                "invalid type: sequence",
            ),
        ] {
            let error = read(&text, asset).unwrap_err().to_string();
            assert!(error.starts_with("d/items.json: ") && error.contains(expected), "{expected}: {error}");
        }
    }

    #[test]
    fn relative_names_are_resolved() {
        let at = |path: &str, own: Option<&str>, href: &str| {
            let text = item("a", own, &[["dem", href, TIFF, "data"]]);
            let listed = format!("{{\"type\":\"FeatureCollection\",\"features\":[{text}]}}");
            let [item, listed] =
                [text, listed].map(|text| read_at(path, &text, None).map(|found| found.unwrap().remove(0)));
            (item.map_err(|error| error.to_string()), listed.map_err(|error| error.to_string()))
        };
        let both = |text: &str| (Ok(text.to_string()), Ok(text.to_string()));
        assert_eq!(at("d/a.json", None, "../x.tif"), both("d/../x.tif"));
        assert_eq!(at("d/a.json", None, "/e/x.tif"), both("/e/x.tif"));
        assert_eq!(at("d/a.json", None, "file:///e/x.tif"), both("file:///e/x.tif"));
        assert_eq!(at("https://h/d/a.json?s=1", None, "./x.tif"), both("https://h/d/x.tif?s=1"));
        assert_eq!(at("d/a.json", None, "/vsicurl/https://h/x.tif"), both("https://h/x.tif"));
        assert_eq!(at("d/a.json", None, "/vsis3/b/x.tif"), both("s3://b/x.tif"));
        assert_eq!(at("s3://b/a.json", None, "/vsigs/b/x.tif"), both("gs://b/x.tif"));
        // (There is no d/x.tif.)
        assert_eq!(at("d/a.json", Some("https://h/i/a.json"), "x.tif"), both("https://h/i/x.tif"));
        let two = at("https://g/a.json", Some("https://h/i/a.json"), "x.tif");
        assert_eq!(two, (Ok("https://g/x.tif".into()), Ok("https://h/i/x.tif".into())));
        assert_eq!(at("d/a.json", Some("/i/a.json"), "x.tif"), both("d/x.tif"));
        for (path, href) in [
            ("https://h/a.json", "/etc/x.tif"),
            ("https://h/a.json", "file:///etc/x.tif"),
            ("a.json", "ftp://h/x.tif"),
            ("a.json", "/vsizip/x.zip/x.tif"),
            ("a.json", "/vsicurl/x.tif"),
            ("a.json", ""),
            ("a.json", "a\nb.tif"),
        ] {
            let (item, listed) = at(path, None, href);
            assert!(item.is_err() && listed.is_err(), "{href}: {item:?}");
        }
        let (item, _) = at("a.json", Some("https://h/a.json"), "/etc/x.tif");
        assert!(item.is_err(), "{item:?}");
    }
}
