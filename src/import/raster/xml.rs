//! As much of XML as GDAL writes.

/// Elements of a name, at any depth: attributes and content. GDAL nests none of these in themselves.
pub(super) fn elements<'a>(xml: &'a str, name: &'a str) -> impl Iterator<Item = (&'a str, &'a str)> {
    let (open, close) = (format!("<{name}"), format!("</{name}>"));
    let mut rest = xml;
    std::iter::from_fn(move || {
        loop {
            let (_, found) = rest.split_once(&open)?;
            rest = found;
            if !found.starts_with([' ', '>', '/', '\n', '\t']) {
                continue;
            }
            let (attributes, content) = found.split_once('>')?;
            if attributes.ends_with('/') {
                rest = content;
                return Some((attributes, ""));
            }
            let (content, after) = content.split_once(&close)?;
            rest = after;
            return Some((attributes, content));
        }
    })
}

/// An attribute's value.
pub(super) fn attribute(attributes: &str, name: &str) -> Option<String> {
    let (_, value) = attributes.split_once(&format!(" {name}=\""))?;
    Some(unescape(value.split_once('"')?.0))
}

/// A text without XML's escapes.
pub(super) fn unescape(text: &str) -> String {
    let pairs = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    pairs.iter().fold(text.to_string(), |text, (from, to)| text.replace(from, to))
}
