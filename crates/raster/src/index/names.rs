//! Names of sources in an index.

use std::path::{Component, Path, PathBuf};

use spinney_base::io::{directory_of, redacted, split_query, url_of};
use spinney_base::{Error, Result};

/// Returns the name of a source in an index: relative to the index's directory if possible, so that
/// both can be moved together. URLs have no query and no user.
///
/// # Errors
/// If the index is remote and the source is a file of this machine, or the index is written to
/// standard output.
pub(super) fn name_in_index(index: &Path, source: &Path) -> Result<String> {
    if index == Path::new("-") {
        let expected = "a file name: an index names its sources relative to itself";
        return Err(Error::invalid("output", "standard output", expected));
    }
    match (url_of(index), url_of(source)) {
        (index, Some(source)) => {
            let source = split_query(source).0;
            // (The text for messages has no user either.)
            let source = redacted(source).into_owned();
            let directory = index.and_then(|url| split_query(url).0.rsplit_once('/'));
            let below =
                directory.and_then(|(directory, _)| source.strip_prefix(directory)?.strip_prefix('/'));
            Ok(below.map_or(source.clone(), str::to_string))
        }
        (Some(_), None) => {
            let found = format!("an index in a store of {}, a file of this machine", source.display());
            Err(Error::unsupported(index, found, "write the index next to its sources, or index them by URL"))
        }
        (None, None) => {
            // (Readers follow a link to an index, too.)
            let index = index.canonicalize().unwrap_or_else(|_| index.to_path_buf());
            let [from, to] = [directory_of(&index), source].map(absolute);
            Ok(relative(&from, &to).unwrap_or(to).to_string_lossy().into_owned())
        }
    }
}

/// Returns a path from the root, without links in its directory.
fn absolute(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    if whole.is_dir() {
        return whole.canonicalize().unwrap_or(whole);
    }
    let directory = whole.parent().and_then(|directory| directory.canonicalize().ok());
    match (directory, whole.file_name()) {
        (Some(directory), Some(name)) => directory.join(name),
        _ => whole,
    }
}

/// Returns the path from a directory to a file; `None` if they are on different drives.
fn relative(from: &Path, to: &Path) -> Option<PathBuf> {
    let (mut from, mut to) = (from.components().peekable(), to.components().peekable());
    while from.peek().is_some() && from.peek() == to.peek() {
        from.next();
        to.next();
    }
    let is_other = |part: &Component<'_>| matches!(part, Component::Prefix(_) | Component::RootDir);
    if from.peek().is_some_and(is_other) || to.peek().is_some_and(is_other) {
        return None;
    }
    Some(from.map(|_| Component::ParentDir).chain(to).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(index: &str, source: &str) -> String {
        name_in_index(Path::new(index), Path::new(source)).unwrap()
    }

    #[test]
    fn names_are_relative_where_possible() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
        std::fs::create_dir_all(at("a/b")).unwrap();
        assert_eq!(
            name(&at("x.goblin"), &at("a/b/c.tif")),
            Path::new("a").join("b").join("c.tif").to_str().unwrap()
        );
        assert_eq!(name(&at("a/x.goblin"), &at("c.tif")), Path::new("..").join("c.tif").to_str().unwrap());
        assert_eq!(name("s3://b/x.goblin", "s3://b/t/c.tif"), "t/c.tif");
        assert_eq!(name("s3://b/x/x.goblin?sig=1", "s3://b/t/c.tif?sig=2"), "s3://b/t/c.tif");
        assert_eq!(name("x.goblin", "https://h/t/c.tif?sig=2"), "https://h/t/c.tif");
        assert!(name_in_index(Path::new("s3://b/x.goblin"), Path::new("c.tif")).is_err());
    }
}
