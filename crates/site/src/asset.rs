//! Files of the page, which are part of the program.

use std::borrow::Cow;

use rust_embed::RustEmbed;
use spinney_base::{Error, Result, sort};

#[derive(RustEmbed)]
#[folder = "page"]
struct Page;

/// The package for browsers, if it was built.
#[derive(RustEmbed)]
#[folder = "../../wasm/dist"]
#[allow_missing = true]
struct Package;

/// Folder of the package among the page's files.
pub(crate) const PACKAGE: &str = "spinney/";

/// A file of the page.
#[derive(Clone, Debug)]
pub struct Asset {
    /// Its bytes.
    pub bytes: Cow<'static, [u8]>,
    /// Its media type, as HTTP has it.
    pub media_type: &'static str,
}

/// The file of the page with a name such as `js/main.js` or `spinney/index.js`, if there is one.
pub fn asset(name: &str) -> Option<Asset> {
    let file = match name.strip_prefix(PACKAGE) {
        Some(name) => Package::get(name),
        None => Page::get(name),
    }?;
    let media_type = match name.rsplit_once('.').map_or("", |(_, end)| end) {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "wasm" => "application/wasm",
        _ => "text/plain; charset=utf-8",
    };
    Some(Asset { bytes: file.data, media_type })
}

/// Names of all files that the page loads, in order.
pub(crate) fn names() -> Vec<String> {
    // (Beside what the page loads stand licences, types, and what they were built of.)
    let is_loaded = |name: &str| {
        let end = name.rsplit_once('.').map(|(_, end)| end);
        matches!(end, Some("css" | "js" | "wasm")) && !name.ends_with(".entry.js")
            || name == "vendor/coastlines.txt"
            || name.contains("LICENSE")
    };
    let page = Page::iter().map(Cow::into_owned);
    let package = Package::iter().map(|name| format!("{PACKAGE}{name}"));
    let mut names: Vec<String> = page.chain(package).filter(|name| is_loaded(name)).collect();
    sort::by(&mut names, &mut Ord::cmp);
    names
}

/// A file of the page that must be there.
pub(crate) fn needed(name: &str) -> Result<Cow<'static, [u8]>> {
    let missing = || {
        let expected = "one that was compiled after `wasm/build.sh` had built the package for browsers";
        Error::invalid("page", format!("a program without {name}"), expected)
    };
    Ok(asset(name).ok_or_else(missing)?.bytes)
}

/// A text of the page that must be there.
pub(crate) fn needed_text(name: &str) -> Result<String> {
    let bytes = needed(name)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
