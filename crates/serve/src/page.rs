//! `/`, its assets, and `/files.json`: lists of the served files, for people and for scripts.

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::json;
use spinney_site::{Asset, PageConfiguration, PageContent, PageSource, PageStart};
use xxhash_rust::xxh3::xxh3_64;

use crate::catalog::ServedFile;
use crate::failure::Failure;
use crate::response::QueryResponse;

/// Characters of names that are escaped in addresses.
pub(crate) const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// The files as JSON: their names in queries, file names, and sizes in bytes.
pub(crate) fn as_json(files: &[ServedFile]) -> String {
    let file = |file: &ServedFile| json!({ "name": file.name, "file": file.file, "bytes": file.bytes });
    format!("{:#}\n", json!({ "files": files.iter().map(file).collect::<Vec<_>>() }))
}

/// HTML page that shows the files, each with its content.
pub(crate) fn index(files: &[(ServedFile, PageContent)]) -> String {
    let source = |(ServedFile { name, file, .. }, content): &(ServedFile, PageContent)| PageSource {
        name: file.clone(),
        title: name.clone(),
        url: utf8_percent_encode(file, ESCAPED).to_string(),
        size: None,
        content: *content,
        start: PageStart::default(),
    };
    spinney_site::index(&PageConfiguration {
        title: "Spinney".into(),
        sources: files.iter().map(source).collect(),
        assets: "assets/".into(),
    })
}

/// Asset of the page, and its tag.
pub(crate) fn asset(name: &str) -> Result<(String, QueryResponse), Failure> {
    let Asset { bytes, media_type } = spinney_site::asset(name)
        .ok_or_else(|| Failure::missing(format!("`{}`: the page has no such file", name.escape_debug())))?;
    let tag = format!("\"{:016x}\"", xxh3_64(bytes));
    Ok((tag.clone(), QueryResponse::new(media_type, tag, bytes)))
}
