//! URLs as paths: detection of remote files, components of URLs, removal of secrets.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// URL schemes of remote files.
const SCHEMES: [&str; 12] =
    ["http", "https", "s3", "s3a", "gs", "gcs", "az", "adl", "azure", "abfs", "abfss", "memory"];

/// Returns the URL of a remote file; `None` for local paths.
pub fn url_of(path: &Path) -> Option<&str> {
    let text = path.to_str()?;
    let (scheme, _) = text.split_once("://")?;
    SCHEMES.iter().any(|known| scheme.eq_ignore_ascii_case(known)).then_some(text)
}

/// Splits a URL before its query or fragment. The query may contain a signature.
pub fn split_query(url: &str) -> (&str, &str) {
    url.split_at(url.find(['?', '#']).unwrap_or(url.len()))
}

/// Returns the path without the query and fragment of a URL.
pub fn without_query(path: &Path) -> &Path {
    url_of(path).map_or(path, |url| Path::new(split_query(url).0))
}

/// Prefixes of remote files in GDAL's names, and the beginnings of their URLs.
const GDAL_PREFIXES: [(&str, &str); 6] = [
    ("/vsicurl/", ""),
    ("/vsis3/", "s3://"),
    ("/vsigs/", "gs://"),
    ("/vsiaz/", "az://"),
    ("/vsicurl_streaming/", ""),
    ("/vsis3_streaming/", "s3://"),
];

/// Returns the URL of a remote file that GDAL's virtual file system has by this name, such as
/// `/vsis3/bucket/file.tif`; `None` for other names.
pub fn gdal_url(name: &str) -> Option<String> {
    let url = |(prefix, url): &(&str, &str)| Some(format!("{url}{}", name.strip_prefix(prefix)?));
    GDAL_PREFIXES.iter().find_map(url).filter(|url| url_of(Path::new(url)).is_some())
}

/// Returns the path or URL of a file that a list names: an absolute path, one relative to the
/// list's directory, a URL, or the [name that GDAL has](gdal_url) for a URL. The directory of a
/// symbolic link is that of its target.
///
/// # Errors
/// If a remote list names a file of this machine: it is untrusted, and must not select local files.
pub fn listed_path(list: &Path, name: &str) -> Result<PathBuf> {
    if let Some(url) = gdal_url(name) {
        return Ok(url.into());
    }
    let own = Path::new(name);
    if url_of(own).is_some() {
        return Ok(own.into());
    }
    let Some(url) = url_of(list) else {
        let is_link = list.symlink_metadata().is_ok_and(|found| found.is_symlink());
        let target = if is_link { list.canonicalize().ok() } else { None };
        return Ok(target.as_deref().unwrap_or(list).parent().unwrap_or(Path::new("")).join(own));
    };
    if own.is_absolute() || name.starts_with("file:") {
        let found = format!("the local file {name} in a remote list");
        return Err(Error::unsupported(list, found, "list paths relative to the list, or URLs"));
    }
    let (url_path, query) = split_query(url);
    let directory = url_path.rsplit_once('/').map_or(url_path, |(directory, _)| directory);
    Ok(format!("{directory}/{name}{query}").into())
}

/// Characters that end a URL within a string.
const ENDS: [char; 7] = ['"', '<', '>', '`', '|', '{', '}'];

/// Characters that belong to the surrounding sentence if they follow a URL.
const PUNCTUATION: [char; 6] = [':', ',', ';', '.', ')', '\''];

/// Replacement of a secret. [`is_redacted`] recognizes it.
const REDACTED: &str = "...";

/// Returns the string without the secrets of the URLs in it.
///
/// User info, query and fragment are replaced by `...`, since a query may be a signature or a
/// token. Every string with a URL passes through this function before it is shown or stored. The
/// function is idempotent.
pub fn redacted(text: &str) -> Cow<'_, str> {
    let mut clean = String::new();
    let mut done = 0;
    while let Some(found) = text[done..].find("://") {
        let at = done + found + 3;
        let before = &text[..at - 3];
        let is_scheme = |c: char| c.is_ascii_alphanumeric() || "+.-".contains(c);
        let scheme = &before[before.trim_end_matches(is_scheme).len()..];
        let rest = &text[at..];
        let end = rest.find(|c: char| c.is_whitespace() || c.is_control() || ENDS.contains(&c));
        let url = rest[..end.unwrap_or(rest.len())].trim_end_matches(PUNCTUATION);
        clean.push_str(&text[done..at]);
        if scheme.is_empty() {
            clean.push_str(url)
        } else {
            push_redacted(&mut clean, scheme, url)
        }
        done = at + url.len();
    }
    if clean.is_empty() {
        return Cow::Borrowed(text);
    }
    clean.push_str(&text[done..]);
    Cow::Owned(clean)
}

/// Appends the rest of a URL after its scheme, without secrets.
fn push_redacted(clean: &mut String, scheme: &str, url: &str) {
    let (place, query) = split_query(url);
    let host_end = place.find('/').unwrap_or(place.len());
    // A slash in a password ends the host too early. Such a "host" has a port that is no number.
    let is_host = place[..host_end]
        .rsplit_once(':')
        .is_none_or(|(_, port)| port.ends_with(']') || port.bytes().all(|byte| byte.is_ascii_digit()));
    let in_host = place[..host_end].rfind('@');
    let user_end = if is_host || in_host.is_some() { in_host } else { place.rfind('@') };
    // In Azure URLs the user info is the container's name.
    let is_container = scheme.starts_with("abfs") || scheme.starts_with("wasb");
    match user_end.filter(|end| !is_container || place[..*end].contains(':')) {
        Some(end) => {
            clean.push_str(REDACTED);
            clean.push_str(&place[end..]);
        }
        None => clean.push_str(place),
    }
    let mut query = query.chars();
    clean.extend(query.next());
    if !query.as_str().is_empty() {
        clean.push_str(REDACTED);
    }
}

/// Returns a path as it is shown or stored: URLs without secrets, see [`redacted`].
pub fn shown(path: &Path) -> Cow<'_, str> {
    let Some(url) = url_of(path) else {
        return match path.to_string_lossy() {
            Cow::Borrowed(text) => redacted(text),
            Cow::Owned(text) => Cow::Owned(redacted(&text).into_owned()),
        };
    };
    // The whole path is the URL, including any white space and quotes.
    let (scheme, rest) = url.split_once("://").unwrap_or(("", url));
    let mut clean = format!("{scheme}://");
    push_redacted(&mut clean, scheme, rest);
    if clean == url { Cow::Borrowed(url) } else { Cow::Owned(clean) }
}

/// Whether [`shown`] has removed the secrets of a URL, so that it can no longer be opened.
pub fn is_redacted(url: &str) -> bool {
    let (place, query) = split_query(url);
    let host = place.split_once("://").map_or("", |(_, rest)| rest);
    query.get(1..) == Some(REDACTED) || host.starts_with("...@")
}

/// Returns the path of a local file, which may be given as a `file://` URL.
pub fn local_path(path: &Path) -> Cow<'_, Path> {
    let url = path.to_str().and_then(|text| text.strip_prefix("file://"));
    match url.map(|rest| rest.strip_prefix("localhost").unwrap_or(rest)) {
        Some(rest) => Cow::Owned(PathBuf::from(decoded(rest))),
        None => Cow::Borrowed(path),
    }
}

/// Decodes the escapes of a URL component, such as `%20`.
pub(crate) fn decoded(text: &str) -> String {
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
    fn urls_are_shown_without_secrets() {
        for (text, expected) in [
            ("https://host/x.goblin", "https://host/x.goblin"),
            ("https://host/x?X-Amz-Signature=SECRET&token=b", "https://host/x?..."),
            ("http://user:SECRET@host:80/x", "http://...@host:80/x"),
            ("HTTP://SECRET@host", "HTTP://...@host"),
            ("http://user:SEC/RET@host/x", "http://...@host/x"),
            ("http://u:SEC@RET@host/a@3:B?SECRET#SECRET", "http://...@host/a@3:B?..."),
            ("http://[::1]/x@2", "http://[::1]/x@2"),
            ("https://host/x#SECRET", "https://host/x#..."),
            (
                "abfss://container@account.dfs.core.windows.net/x?",
                "abfss://container@account.dfs.core.windows.net/x?",
            ),
            ("/vsicurl/https://host/x?SECRET", "/vsicurl/https://host/x?..."),
            ("GET https://host/x?SECRET: 403", "GET https://host/x?...: 403"),
            (
                "\"https://host/x?SECRET\", (socks5://a:SECRET@proxy:1).",
                "\"https://host/x?...\", (socks5://...@proxy:1).",
            ),
            ("a://b ://c? no URL: ä?x=1", "a://b ://c? no URL: ä?x=1"),
        ] {
            assert_eq!(redacted(text), expected);
            assert_eq!(redacted(expected), expected, "twice");
        }
        let odd = Path::new("https://host/x?a \" b=SECRET");
        assert_eq!(shown(odd), "https://host/x?...");
        assert_eq!(shown(Path::new("a?b=c")), "a?b=c");
        assert!(is_redacted("https://host/x?...") && is_redacted("http://...@host/x"));
        assert!(!is_redacted("https://host/x...") && !is_redacted("https://host/x?a=..."));
    }

    #[test]
    fn urls_are_distinguished_from_paths() {
        let is_url = |text: &str| url_of(Path::new(text)).is_some();
        assert!(is_url("https://host/x.goblin?sig=a:b") && is_url("S3://bucket/x") && is_url("az://c/x"));
        assert!(!is_url("x.goblin") && !is_url("/a:b//c") && !is_url("file:///x") && !is_url("C://x"));
        assert_eq!(*local_path(Path::new("file:///a%20b/c%C3%A4%")), *Path::new("/a b/cä%"));
        assert_eq!(*local_path(Path::new("a%20b")), *Path::new("a%20b"));
    }
}
