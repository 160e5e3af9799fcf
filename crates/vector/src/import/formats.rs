//! Detection of feature formats by their first bytes and file names.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use super::feature::{FeatureOptions, FeatureReader, RequestedAttributes};
#[cfg(feature = "flatgeobuf")]
use super::flatgeobuf;
#[cfg(feature = "geopackage")]
use super::geopackage;
use super::{csv, geojson, shapefile};
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, OtherFormat};

/// Opens a file with the reader of its format.
pub(super) fn open(
    path: &Path,
    options: &FeatureOptions,
    wanted: &mut RequestedAttributes,
) -> Result<Box<dyn FeatureReader>> {
    let (path, layer) = divided(path);
    let layer = layer.or_else(|| options.layer.clone());
    let mut file = regular(&path)?;
    let mut first = Vec::new();
    (&mut file).take(FIRST_BYTES as u64).read_to_end(&mut first).map_err(Error::io(&path, "read"))?;
    file.rewind().map_err(Error::io(&path, "read"))?;
    if is_geopackage(&first) {
        return open_geopackage(&path, layer.as_deref(), options, wanted);
    }
    let reader: Box<dyn FeatureReader> = if shapefile::is_one(&first) {
        Box::new(shapefile::Shapefile::open(file, &path, options, wanted)?)
    } else if first.starts_with(b"fgb") {
        open_flatgeobuf(file, &first, &path, options, wanted)?
    } else if first_sign(&first) == Some(b'{') {
        Box::new(geojson::GeoJson::open(Box::new(file), &path, options, wanted)?)
    } else if is_table(&path) && !(first.contains(&0) && OtherFormat::is_marked(&first)) {
        Box::new(csv::Csv::open(file, &path, options, wanted)?)
    } else {
        let read = "features in GeoJSON, GeoPackage, FlatGeobuf, a shapefile (.shp) or a table (.csv)";
        let found = if first.is_empty() { "nothing" } else { "another format" };
        let other = || Error::corrupt(&path, "first bytes", found, read);
        let marked = || OtherFormat::refuse_content(&path, &first, read);
        return Err(OtherFormat::refuse_unread(&path, &first).or_else(marked).unwrap_or_else(other));
    };
    match layer {
        Some(layer) if layer != reader.schema().name => {
            let expected = format!("{}, the only layer of the file", reader.schema().name);
            Err(Error::invalid("layer", layer, expected))
        }
        _ => Ok(reader),
    }
}

/// Returns whether a file is a feature file, by its name; for `.json`, which city models use, too,
/// also by its first bytes. Plain text files may contain anything: only
/// [`open_features`](super::feature::open_features) reads them as tables.
pub fn is_feature_file(path: &Path) -> bool {
    let (path, layer) = divided(path);
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ending.as_str() {
        "geojson" | "geojsonl" | "geojsons" | "geojsonseq" | "ndjson" | "fgb" | "gpkg" | "shp" | "csv"
        | "tsv" => true,
        "json" => {
            let mut first = Vec::new();
            let read =
                File::open(path).and_then(|file| file.take(FIRST_BYTES as u64).read_to_end(&mut first));
            let text = String::from_utf8_lossy(&first);
            read.is_ok() && !text.contains("CityJSON") && text.contains("\"Feature")
        }
        _ => layer.is_some(),
    }
}

/// Splits a path into file and layer name, unless the path itself exists.
fn divided(path: &Path) -> (PathBuf, Option<String>) {
    let text = path.to_str().filter(|_| !path.exists());
    let Some(at) = text.and_then(|text| text.to_ascii_lowercase().rfind(".gpkg:")) else {
        return (path.into(), None);
    };
    let text = text.unwrap_or_default();
    let end = at + ".gpkg".len();
    (text[..end].into(), Some(text[end + 1..].into()))
}

/// Returns the first non-blank byte of text.
fn first_sign(first: &[u8]) -> Option<u8> {
    let begin = first.strip_prefix(b"\xef\xbb\xbf").unwrap_or(first).iter();
    begin.copied().find(|byte| !byte.is_ascii_whitespace() && *byte != 0x1e)
}

fn is_table(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    ["csv", "tsv", "tab", "psv", "txt"].iter().any(|own| own.eq_ignore_ascii_case(ending))
}

fn is_geopackage(first: &[u8]) -> bool {
    first.starts_with(b"SQLite format 3\0")
}

#[cfg(feature = "geopackage")]
fn open_geopackage(
    path: &Path,
    layer: Option<&str>,
    options: &FeatureOptions,
    wanted: &mut RequestedAttributes,
) -> Result<Box<dyn FeatureReader>> {
    Ok(Box::new(geopackage::GeoPackage::open(path, layer, options, wanted)?))
}

#[cfg(not(feature = "geopackage"))]
fn open_geopackage(
    path: &Path,
    _: Option<&str>,
    _: &FeatureOptions,
    _: &mut RequestedAttributes,
) -> Result<Box<dyn FeatureReader>> {
    Err(Error::unsupported(
        path,
        "reading GeoPackage",
        "use a build with support for it, or convert the file to GeoJSON",
    ))
}

#[cfg(feature = "flatgeobuf")]
fn open_flatgeobuf(
    file: File,
    first: &[u8],
    path: &Path,
    options: &FeatureOptions,
    wanted: &mut RequestedAttributes,
) -> Result<Box<dyn FeatureReader>> {
    if !flatgeobuf::is_one(first) {
        let advice = "convert it with a newer program (ogr2ogr new.fgb old.fgb)";
        return Err(Error::unsupported(path, "a FlatGeobuf version other than 3", advice));
    }
    Ok(Box::new(flatgeobuf::FlatGeobuf::open(file, path, options, wanted)?))
}

#[cfg(not(feature = "flatgeobuf"))]
fn open_flatgeobuf(
    _: File,
    _: &[u8],
    path: &Path,
    _: &FeatureOptions,
    _: &mut RequestedAttributes,
) -> Result<Box<dyn FeatureReader>> {
    Err(Error::unsupported(
        path,
        "reading FlatGeobuf",
        "use a build with support for it, or convert the file to GeoJSON",
    ))
}

/// Opens a file that can be read more than once. A stream is copied to a temporary file.
fn regular(path: &Path) -> Result<File> {
    let mut file = File::open(path).map_err(Error::io(path, "open"))?;
    if file.metadata().is_ok_and(|metadata| metadata.is_file() || metadata.is_dir()) {
        return Ok(file);
    }
    let mut copy =
        tempfile::tempfile().map_err(Error::io(std::env::temp_dir(), "create a temporary file"))?;
    std::io::copy(&mut file, &mut copy).map_err(Error::io(path, "read"))?;
    copy.rewind().map_err(Error::io(path, "read"))?;
    Ok(copy)
}
