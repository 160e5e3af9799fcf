//! JSON format of manifests.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::listed_file::{FileTag, ListedFile};
use super::manifest::{MARK, MAX_FILES, Manifest, VERSION};
use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::{Number, Palette, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_container::{Codec, HEAVY_THRESHOLD, Header, Metadata, STRIDE, Shape, reach};
use spinney_crs::Frame;

/// The document. Fields are in output order.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    spinney_manifest: u32,
    axes: u8,
    values: ValueType,
    kind: String,
    rule: String,
    depth: u8,
    extent: [u64; 3],
    frame: Frame,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    nodata: Option<String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    class_names: BTreeMap<String, String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    palette: Option<Palette>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    band_names: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    scale_offset: Vec<(f64, f64)>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    units: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    alpha: Option<u8>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    tags: BTreeMap<String, String>,
    files: Vec<FileDocument>,
}

/// A file. `at` is its first cell in the common space.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileDocument {
    path: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layer: Option<String>,
    at: [u64; 3],
    size: [u64; 3],
    depth: u8,
    bytes: u64,
    tag: String,
}

/// Formats a manifest as JSON, with one line per file for readable diffs.
pub(super) fn write(manifest: &Manifest) -> String {
    let Manifest { header, metadata, entries } = manifest;
    let document = Document {
        spinney_manifest: VERSION,
        axes: header.form.axes() as u8,
        values: header.form.value,
        kind: header.kind.to_string(),
        rule: header.rule.to_string(),
        depth: header.depth(),
        extent: header.extent,
        frame: metadata.frame.clone(),
        nodata: metadata.nodata.map(|number| number.to_string()),
        class_names: metadata.class_names.iter().map(|(at, name)| (at.to_string(), name.clone())).collect(),
        palette: metadata.palette.clone(),
        band_names: metadata.band_names.clone(),
        scale_offset: metadata.scale_offset.clone(),
        units: metadata.units.clone(),
        alpha: metadata.alpha,
        time: metadata.time.clone(),
        tags: metadata.tags.clone(),
        files: Vec::new(),
    };
    let head = serde_json::to_value(&document).unwrap_or_default();
    let mut lines = Vec::new();
    for (name, value) in head.as_object().into_iter().flatten().filter(|(name, _)| *name != "files") {
        lines.push(format!("  \"{name}\": {value}"));
    }
    let file = |entry: &ListedFile| FileDocument {
        path: entry.path.clone(),
        layer: entry.layer.clone(),
        at: entry.bounds.min,
        size: entry.bounds.size(),
        depth: entry.depth,
        bytes: entry.tag.length,
        tag: format!("{:08x}", entry.tag.checksum),
    };
    let files = entries.iter().map(|entry| serde_json::to_string(&file(entry)).unwrap_or_default());
    let files: Vec<String> = files.map(|file| format!("    {file}")).collect();
    format!("{{\n{},\n  \"files\": [\n{}\n  ]\n}}\n", lines.join(",\n"), files.join(",\n"))
}

/// Parses and checks a manifest.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Manifest> {
    let corrupt = |found: String, expected: &str| Error::corrupt(path, "manifest", found, expected);
    // Check the version first: a newer document is not corrupt.
    #[derive(Deserialize)]
    struct Mark {
        spinney_manifest: u32,
    }
    let invalid_json =
        |error: serde_json::Error| corrupt(error.to_string(), "the fields of docs/format/manifest.md");
    let version = serde_json::from_slice::<Mark>(bytes).map_err(invalid_json)?.spinney_manifest;
    if version != VERSION {
        let found = format!("{MARK} version {version}");
        return Err(Error::unsupported(path, found, "update the program"));
    }
    let document: Document = serde_json::from_slice(bytes).map_err(invalid_json)?;
    let number = |text: &str| {
        text.parse::<Number>().map_err(|_| corrupt(format!("the string `{text}`"), "a number as a string"))
    };
    let dimension = Dimension::from_axes(document.axes);
    let dimension = dimension.ok_or_else(|| corrupt(format!("axes {}", document.axes), "2 or 3"))?;
    let shape = Shape {
        depth: document.depth,
        reach: reach(dimension),
        stride: STRIDE,
        heavy_threshold: HEAVY_THRESHOLD,
    };
    let unknown_name = |error: Error| corrupt(error.to_string(), "a name that docs/format/manifest.md lists");
    let header = Header {
        form: TreeType::new(dimension, document.values),
        rule: document.rule.parse().map_err(unknown_name)?,
        kind: document.kind.parse().map_err(unknown_name)?,
        codec: Codec::Plain,
        shape,
        extent: document.extent,
    };
    // Validate like the header of a tree file.
    let header = match document.values.is_supported() {
        true => Header::from_bytes(path, "manifest", &header.to_bytes(), (dimension, dimension.max_depth()))?,
        false => return Err(corrupt(format!("value type {}", document.values), "a value type of trees")),
    };
    let class_names = document.class_names.into_iter().map(|(at, name)| Ok((number(&at)?, name)));
    let metadata = Metadata {
        frame: document.frame,
        nodata: document.nodata.as_deref().map(number).transpose()?,
        class_names: class_names.collect::<Result<_>>()?,
        palette: document.palette,
        band_names: document.band_names,
        scale_offset: document.scale_offset,
        units: document.units,
        alpha: document.alpha,
        time: document.time,
        tags: document.tags,
        ..Metadata::default()
    };
    if metadata.palette.as_ref().is_some_and(|palette| palette.colours.len() > 1 << 16) {
        return Err(corrupt("more than 65536 colours".into(), "at most 65536"));
    }
    if document.files.is_empty() || document.files.len() > MAX_FILES {
        let expected = format!("1 to {MAX_FILES}");
        return Err(corrupt(format!("{} files", document.files.len()), &expected));
    }
    let entries = document.files.into_iter().map(|file| entry(path, &header, file));
    let entries = entries.collect::<Result<Vec<ListedFile>>>()?;
    let mut names = HashSet::with_capacity(entries.len());
    if let Some(twice) = entries.iter().find(|entry| !names.insert((&entry.path, &entry.layer))) {
        return Err(corrupt(format!("{} twice", twice.path), "each file and layer once"));
    }
    Ok(Manifest { header, metadata, entries })
}

/// Checks the fields of a file entry against the common space.
fn entry(path: &Path, header: &Header, file: FileDocument) -> Result<ListedFile> {
    let corrupt = |found: String, expected: String| {
        Error::corrupt(path, format!("file {}", file.path), found, expected)
    };
    let mut max = [1; 3];
    for (axis, last) in max.iter_mut().enumerate() {
        let (at, size, extent) = (file.at[axis], file.size[axis], header.extent[axis]);
        *last = at.checked_add(size).filter(|end| size > 0 && *end <= extent).ok_or_else(|| {
            corrupt(
                format!("{size} cells from {at} along axis {axis}"),
                format!("at least 1, within {extent}"),
            )
        })?;
        let fits = axis >= header.form.axes() || file.depth < 32 && size <= 1 << file.depth;
        if !fits || file.depth > header.form.dimension.max_depth() {
            let found = format!("{size} cells in a tree of depth {}", file.depth);
            return Err(corrupt(found, "a deeper tree".into()));
        }
    }
    let checksum = u32::from_str_radix(&file.tag, 16)
        .map_err(|_| corrupt(format!("tag `{}`", file.tag), "eight hexadecimal digits".into()))?;
    if file.path.is_empty() || file.path.contains('\0') {
        return Err(corrupt(format!("path `{}`", file.path.escape_debug()), "a path or a URL".into()));
    }
    Ok(ListedFile {
        bounds: Bounds { min: file.at, max },
        depth: file.depth,
        tag: FileTag { length: file.bytes, checksum },
        path: file.path,
        layer: file.layer,
    })
}
