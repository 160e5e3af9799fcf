//! Files of the page, embedded in the binary.

/// A file of the page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// File contents.
    pub bytes: &'static [u8],
    /// Media type for HTTP.
    pub media_type: &'static str,
}

/// HTML template of the page.
pub(crate) const TEMPLATE: &str = include_str!("../page/index.html");

/// Directory of the JavaScript package within the page's files.
pub(crate) const PACKAGE: &str = "spinney/";

/// Lists names and contents of files in `page/`.
macro_rules! files {
    ($($name:literal,)*) => {
        &[$(($name, include_bytes!(concat!("../page/", $name)))),*]
    };
}

/// All files that the page loads, and their licences. A test compares this list with the directory.
static FILES: &[(&str, &[u8])] = files![
    "js/detail.js",
    "js/ground.js",
    "js/history.js",
    "js/interface.js",
    "js/legend.js",
    "js/main.js",
    "js/map.js",
    "js/messages.js",
    "js/model.js",
    "js/notebook.js",
    "js/plane.js",
    "js/polygon.js",
    "js/scene.js",
    "js/settings.js",
    "js/shared.js",
    "js/solid.js",
    "page.css",
    "spinney/LICENSE-APACHE",
    "spinney/LICENSE-MIT",
    "spinney/dataset.js",
    "spinney/engine.js",
    "spinney/errors.js",
    "spinney/images.js",
    "spinney/index.js",
    "spinney/indexed.js",
    "spinney/module.js",
    "spinney/module_bg.wasm",
    "spinney/ranges.js",
    "spinney/remote.js",
    "spinney/sources.js",
    "spinney/worker.js",
    "vendor/LICENSE-MAPLIBRE",
    "vendor/LICENSE-THREE",
    "vendor/coastlines.txt",
    "vendor/maplibre-gl-worker.js",
    "vendor/maplibre-gl.css",
    "vendor/maplibre-gl.js",
    "vendor/three.js",
];

/// Returns the file with this name, such as `js/main.js` or `spinney/index.js`.
pub fn asset(name: &str) -> Option<Asset> {
    let (_, bytes) = FILES.iter().find(|(known, _)| *known == name)?;
    let media_type = match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "wasm" => "application/wasm",
        _ => "text/plain; charset=utf-8",
    };
    Some(Asset { bytes, media_type })
}

/// The names of all files, sorted.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    FILES.iter().map(|(name, _)| *name)
}

/// The contents of a file that must exist.
pub(crate) fn bytes(name: &str) -> &'static [u8] {
    asset(name).unwrap_or_else(|| panic!("the page has no file {name}")).bytes
}

/// The contents of a text file that must exist.
pub(crate) fn text(name: &str) -> &'static str {
    std::str::from_utf8(bytes(name)).expect("text files of the page are UTF-8")
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    /// Files in the directory that the page does not load.
    const OTHERS: [&str; 7] = [
        "index.html",
        "spinney/README.md",
        "spinney/index.d.ts",
        "spinney/module.sources",
        "spinney/package.json",
        "vendor/README.md",
        "vendor/three.entry.js",
    ];

    /// Collects the names of all files in a directory tree.
    fn files_of(directory: &Path, prefix: &str, found: &mut Vec<String>) {
        for entry in fs::read_dir(directory).unwrap() {
            let entry = entry.unwrap();
            let name = format!("{prefix}{}", entry.file_name().to_str().unwrap());
            match entry.file_type().unwrap().is_dir() {
                true => files_of(&entry.path(), &format!("{name}/"), found),
                false => found.push(name),
            }
        }
    }

    #[test]
    fn every_file_of_the_directory_is_listed() {
        let mut found = Vec::new();
        files_of(&Path::new(env!("CARGO_MANIFEST_DIR")).join("page"), "", &mut found);
        found.retain(|name| !OTHERS.contains(&name.as_str()));
        found.sort_unstable();
        assert_eq!(found, names().collect::<Vec<_>>());
    }

    #[test]
    fn the_package_has_the_licences_of_the_project() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for name in ["LICENSE-APACHE", "LICENSE-MIT"] {
            assert_eq!(bytes(&format!("{PACKAGE}{name}")), fs::read(root.join(name)).unwrap(), "{name}");
        }
    }
}
