//! `/`, its files, and `/files.json`: what is served, for people and for pages.

use std::fmt::Write as _;

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::json;
use spinney_site::{Asset, PageConfiguration, PageSource, PageStart};
use xxhash_rust::xxh3::xxh3_64;

use crate::answer::Answer;
use crate::catalog::Listed;
use crate::failure::Failure;

/// Characters of names that are escaped in addresses.
pub(crate) const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// The files as JSON: names that questions have for them, the files' own, and their bytes.
pub(crate) fn as_json(files: &[Listed]) -> String {
    let file = |file: &Listed| json!({ "name": file.name, "file": file.file, "bytes": file.bytes });
    format!("{:#}\n", json!({ "files": files.iter().map(file).collect::<Vec<_>>() }))
}

/// The page that shows the files, of which the first may be a raster, or, if the program was built without it or there is nothing to show, a list of them.
pub(crate) fn index(files: &[Listed], is_map: bool) -> String {
    let has_page = spinney_site::asset("spinney/module_bg.wasm").is_some() && !files.is_empty();
    let source = |Listed { name, file, .. }: &Listed| PageSource {
        name: file.clone(),
        title: name.clone(),
        url: utf8_percent_encode(file, ESCAPED).to_string(),
        size: None,
        is_map,
        start: PageStart::default(),
    };
    let configuration = || PageConfiguration {
        title: "Spinney".into(),
        sources: files.iter().map(source).collect(),
        assets: "assets/".into(),
    };
    let page = has_page.then(|| spinney_site::index(&configuration()).ok()).flatten();
    page.unwrap_or_else(|| as_html(files))
}

/// A file of the page, and its tag.
pub(crate) fn asset(name: &str) -> Result<(String, Answer), Failure> {
    let Asset { bytes, media_type } = spinney_site::asset(name)
        .ok_or_else(|| Failure::missing(format!("`{}`: is no file of the page", name.escape_debug())))?;
    let tag = format!("\"{:016x}\"", xxh3_64(&bytes));
    Ok((tag.clone(), Answer::new(media_type, tag, bytes.into_owned())))
}

/// A page with links to the files.
fn as_html(files: &[Listed]) -> String {
    let mut rows = String::new();
    for Listed { name, file, bytes } in files {
        let at = |text: &str| utf8_percent_encode(text, ESCAPED).to_string();
        let _ = writeln!(
            rows,
            "<tr><td><a href=\"/{}\">{}</a></td><td>{bytes} bytes</td><td><a href=\"/tiles/{}.json\">tiles</a></td></tr>",
            at(file),
            escaped(file),
            at(name)
        );
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>Spinney</title>\n<style>:root {{ color-scheme: light dark; font-family: sans-serif }} td {{ padding: .2em 1em .2em 0 }}</style>\n\
         <h1>Spinney</h1>\n<table>\n{rows}</table>\n</html>\n"
    )
}

/// Text as HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
