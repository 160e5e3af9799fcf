//! `/` and `/files.json`: what is served, for people and for pages.

use std::fmt::Write as _;

use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::json;

use crate::catalog::Listed;

/// The files as JSON: names that questions have for them, the files' own, and their bytes.
pub(crate) fn as_json(files: &[Listed]) -> String {
    let file = |file: &Listed| json!({ "name": file.name, "file": file.file, "bytes": file.bytes });
    format!("{:#}\n", json!({ "files": files.iter().map(file).collect::<Vec<_>>() }))
}

/// A page with links to the files.
pub(crate) fn as_html(files: &[Listed]) -> String {
    let mut rows = String::new();
    for Listed { name, file, bytes } in files {
        let at = |text: &str| utf8_percent_encode(text, NON_ALPHANUMERIC).to_string();
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
