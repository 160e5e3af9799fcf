//! URLs as paths: which paths are URLs of remote files, and the parts of these.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Schemes of the URLs of remote files.
const SCHEMES: [&str; 12] =
    ["http", "https", "s3", "s3a", "gs", "gcs", "az", "adl", "azure", "abfs", "abfss", "memory"];

/// The URL that a path is, if the file is remote.
pub fn url_of(path: &Path) -> Option<&str> {
    let text = path.to_str()?;
    let (scheme, _) = text.split_once("://")?;
    SCHEMES.iter().any(|known| scheme.eq_ignore_ascii_case(known)).then_some(text)
}

/// A URL up to its query, and the query, which may have a signature.
pub fn split_query(url: &str) -> (&str, &str) {
    url.split_at(url.find(['?', '#']).unwrap_or(url.len()))
}

/// A path without the query that a URL may have.
pub fn without_query(path: &Path) -> &Path {
    url_of(path).map_or(path, |url| Path::new(split_query(url).0))
}

/// The path of a local file, which may be given as a `file://` URL.
pub fn local_path(path: &Path) -> Cow<'_, Path> {
    let url = path.to_str().and_then(|text| text.strip_prefix("file://"));
    match url.map(|rest| rest.strip_prefix("localhost").unwrap_or(rest)) {
        Some(rest) => Cow::Owned(PathBuf::from(decoded(rest))),
        None => Cow::Borrowed(path),
    }
}

/// Part of a URL with its escapes, such as `%20`, decoded.
fn decoded(text: &str) -> String {
    let bytes = text.as_bytes();
    let hex = |at: usize| bytes.get(at).and_then(|digit| (*digit as char).to_digit(16));
    let (mut plain, mut at) = (Vec::with_capacity(bytes.len()), 0);
    while at < bytes.len() {
        match (bytes[at], hex(at + 1), hex(at + 2)) {
            (b'%', Some(high), Some(low)) => {
                plain.push((high << 4 | low) as u8);
                at += 3;
            }
            (byte, ..) => {
                plain.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&plain).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_distinguished_from_paths() {
        let is_url = |text: &str| url_of(Path::new(text)).is_some();
        assert!(is_url("https://host/x.goblin?sig=a:b") && is_url("S3://bucket/x") && is_url("az://c/x"));
        assert!(!is_url("x.goblin") && !is_url("/a:b//c") && !is_url("file:///x") && !is_url("C://x"));
        assert_eq!(*local_path(Path::new("file:///a%20b/c%C3%A4%")), *Path::new("/a b/cä%"));
        assert_eq!(*local_path(Path::new("a%20b")), *Path::new("a%20b"));
    }
}
