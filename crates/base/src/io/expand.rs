//! Patterns of file names, in which `*` matches any characters of a name.

use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use super::access::FileAccess;
use crate::sort;
use crate::url::{decoded, local_path, split_query, url_of};
use crate::{Error, Result};

/// Maximum number of names that a pattern may match, and that are inspected for it.
pub const MAX_NAMES: usize = 1_000_000;

/// Verb for messages.
const EXPAND: &str = "expand the pattern";

impl FileAccess {
    /// Returns the files that a pattern names, sorted by name. `*` matches any characters within a
    /// name, but no dot at its start. A path without `*`, and the name of a file that exists, is
    /// returned unchanged.
    ///
    /// # Errors
    /// If no file matches, or more than [`MAX_NAMES`] do; if a directory cannot be read, or its
    /// host cannot list files.
    pub fn expand(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let mut found = match url_of(path) {
            Some(url) => match self.expand_url(path, url)? {
                Some(found) => found,
                None => return Ok(vec![path.into()]),
            },
            None => {
                let local = &*local_path(path);
                if !is_pattern(local.as_os_str()) || local.symlink_metadata().is_ok() {
                    return Ok(vec![path.into()]);
                }
                expand_local(path, local)?
            }
        };
        if found.is_empty() {
            let cause = io::Error::new(io::ErrorKind::NotFound, "no file has such a name");
            return Err(Error::io(path, EXPAND)(cause));
        }
        sort::by(&mut found, &mut Ord::cmp);
        Ok(found)
    }

    /// Returns the files that a URL names if it is a pattern.
    fn expand_url(&self, path: &Path, url: &str) -> Result<Option<Vec<PathBuf>>> {
        let (location, query) = split_query(url);
        let Some(star) = location.find('*') else { return Ok(None) };
        if self.stat_companions(&[path])?[0].is_some() {
            return Ok(None);
        }
        let (prefix, rest) = location.split_at(star);
        let host = prefix.find("://").map_or(0, |at| at + 3);
        if !prefix[host..].contains('/') {
            let advice = "name the bucket, and give a pattern of its files";
            return Err(Error::unsupported(path, "a pattern of buckets", advice));
        }
        let listed = self.client(path)?.list(prefix, rest.contains('/')).map_err(|error| match error {
            Error::Unsupported { found, advice, .. } => Error::unsupported(path, found, advice),
            other => other,
        })?;
        // (A host returns up to 1000 names per request.)
        self.ranges().count_traffic(1 + listed.len() as u64 / 1000, 0);
        let names = Names::of(location.split('/'));
        let fits = |name: &&String| names.fit(name.split('/'));
        Ok(Some(listed.iter().filter(fits).map(|name| format!("{name}{query}").into()).collect()))
    }
}

/// Whether a name is a pattern.
fn is_pattern(name: &OsStr) -> bool {
    name.as_encoded_bytes().contains(&b'*')
}

/// Returns the local files that a pattern names. `path` is for messages.
fn expand_local(path: &Path, pattern: &Path) -> Result<Vec<PathBuf>> {
    let mut found = vec![PathBuf::new()];
    for component in pattern.components() {
        match component {
            Component::Normal(name) if is_pattern(name) => {
                let pattern = Name::plain(name.as_encoded_bytes());
                let mut next = Vec::new();
                for directory in &found {
                    matching(directory, &pattern, &mut next)?;
                    if next.len() > MAX_NAMES {
                        return Err(too_many(path));
                    }
                }
                found = next;
            }
            other => found.iter_mut().for_each(|path| path.push(other)),
        }
    }
    found.retain(|path| path.is_file());
    Ok(found)
}

/// Appends the entries of a directory that fit. A missing directory has none.
fn matching(directory: &Path, pattern: &Name, found: &mut Vec<PathBuf>) -> Result<()> {
    let read = if directory.as_os_str().is_empty() { Path::new(".") } else { directory };
    let entries = match fs::read_dir(read) {
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(());
        }
        entries => entries.map_err(Error::io(read, "list"))?,
    };
    for entry in entries {
        let name = entry.map_err(Error::io(read, "list"))?.file_name();
        if pattern.fits(name.as_encoded_bytes()) {
            found.push(directory.join(name));
        }
        if found.len() > MAX_NAMES {
            break;
        }
    }
    Ok(())
}

/// The error for a pattern that matches too many names.
fn too_many(path: &Path) -> Error {
    let advice = "give parts of them, or list them in a file (@FILE)";
    Error::unsupported(path, format!("a pattern of more than {MAX_NAMES} names"), advice)
}

/// Patterns of the names in a path.
struct Names(Vec<Name>);

impl Names {
    /// Patterns of the components of a URL, which may have escapes such as `%20`.
    fn of<'t>(components: impl Iterator<Item = &'t str>) -> Names {
        let name =
            |component: &str| Name(component.split('*').map(|text| decoded(text).into_bytes()).collect());
        Names(components.map(name).collect())
    }

    /// Whether the components of a URL fit.
    fn fit<'t>(&self, components: impl Iterator<Item = &'t str>) -> bool {
        let mut names = self.0.iter();
        let mut fits = components
            .map(|component| names.next().is_some_and(|name| name.fits(decoded(component).as_bytes())));
        fits.all(|fits| fits) && names.next().is_none()
    }
}

/// Pattern of a name: the strings between its stars.
struct Name(Vec<Vec<u8>>);

impl Name {
    fn plain(name: &[u8]) -> Name {
        Name(name.split(|byte| *byte == b'*').map(<[u8]>::to_vec).collect())
    }

    fn fits(&self, name: &[u8]) -> bool {
        let last = self.0.len() - 1;
        if last == 0 {
            return self.0[0] == name;
        }
        if self.0[0].is_empty() && name.first() == Some(&b'.') {
            return false;
        }
        let rest = name.strip_prefix(&*self.0[0]).and_then(|rest| rest.strip_suffix(&*self.0[last]));
        let Some(mut rest) = rest else { return false };
        // The first position of each text leaves most characters for the others.
        self.0[1..last].iter().all(|text| {
            let found = (0..=rest.len().saturating_sub(text.len())).find(|at| rest[*at..].starts_with(text));
            found.inspect(|at| rest = &rest[at + text.len()..]).is_some()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_match_within_names() {
        let fits = |pattern: &str, name: &str| Name::plain(pattern.as_bytes()).fits(name.as_bytes());
        for (pattern, name) in [
            ("*.tif", "a.tif"),
            ("a*", "a"),
            ("a*b*c", "abbc"),
            ("*a*a*", "aa"),
            ("**", "x"),
            (".*", ".tif"),
            ("x", "x"),
            ("a*ab*b", "aaabb"),
        ] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [
            ("*.tif", ".tif"),
            ("*.tif", "a.tiff"),
            ("ab*ba", "aba"),
            ("*a*a*", "a"),
            ("a*ab*b", "aab"),
            ("x", "xx"),
        ] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn local_patterns_name_sorted_files() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        for name in ["b", "a", "c"] {
            fs::create_dir(path(name)).unwrap();
        }
        for name in
            ["b/2.tif", "b/1.tif", "a/3.tif", "b/1.txt", "b/.0.tif", "c/4.tif.aux", "b/x*.tif", "b/xy.tif"]
        {
            fs::write(path(name), "").unwrap();
        }
        fs::create_dir(path("c/d.tif")).unwrap();
        let access = FileAccess::new();
        let expand = |pattern: &str| access.expand(&path(pattern)).unwrap();
        let paths = |names: &[&str]| names.iter().map(|name| path(name)).collect::<Vec<_>>();
        assert_eq!(expand("*/*.tif"), paths(&["a/3.tif", "b/1.tif", "b/2.tif", "b/x*.tif", "b/xy.tif"]));
        assert_eq!(expand("*/1.tif"), paths(&["b/1.tif"]));
        assert_eq!(expand("b/x*.tif"), paths(&["b/x*.tif"]), "a file that exists is no pattern");
        assert_eq!(expand("none.tif"), paths(&["none.tif"]));
        let url = format!("file://{}/b/?.tif", directory.path().display());
        assert_eq!(access.expand(Path::new(&url)).unwrap(), [PathBuf::from(&url)]);
        for pattern in ["*.tif", "none/*.tif", "b/1.tif/*"] {
            let error = access.expand(&path(pattern)).unwrap_err();
            let Error::Io { cause, .. } = &error else { panic!("{error}") };
            assert_eq!(cause.kind(), io::ErrorKind::NotFound, "{error}");
        }
    }

    #[test]
    fn components_of_urls_fit_with_escapes() {
        let fits = |pattern: &str, name: &str| Names::of(pattern.split('/')).fit(name.split('/'));
        assert!(fits("s3://b/a%20b/*.tif", "s3://b/a b/%231.tif"));
        assert!(fits("s3://b/*/x.tif", "s3://b/a/x.tif"));
        assert!(!fits("s3://b/*/x.tif", "s3://b/a/b/x.tif"));
        assert!(!fits("s3://b/*/x.tif", "s3://b/a"));
        let error = FileAccess::new().expand(Path::new("s3://b/*.tif")).unwrap_err().to_string();
        assert!(error.contains("support for remote files"), "{error}");
    }
}
