//! File formats, and paths that name a commit or a layer of a file.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::file_header::{Content, FileHeader};
use spinney_base::io::{FileAccess, local_path, split_query, url_of};
use spinney_base::{Error, Result};

/// The format of a tree file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeFormat {
    /// Compact, read-only, for publication.
    Goblin,
    /// Pointer-based, editable, with history.
    Autumnal,
}

impl TreeFormat {
    /// Returns the format that a file of this name is written in: Autumnal if it ends with
    /// `.autumn`, else Goblin.
    pub fn of(path: &Path) -> TreeFormat {
        let path = url_of(path).map_or(path, |url| Path::new(split_query(url).0));
        let is_autumnal = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("autumn"));
        if is_autumnal { TreeFormat::Autumnal } else { TreeFormat::Goblin }
    }

    /// The magic number at the start of every file: a byte that is not valid in text, the name, and
    /// an end of line.
    pub fn magic(self) -> [u8; 8] {
        match self {
            TreeFormat::Goblin => *b"\x93Goblin\n",
            TreeFormat::Autumnal => *b"\x93Autumn\n",
        }
    }

    /// The format's name.
    pub fn name(self) -> &'static str {
        match self {
            TreeFormat::Goblin => "Goblin",
            TreeFormat::Autumnal => "Autumnal",
        }
    }
}

/// File, commit and layer that a path refers to.
///
/// `map.autumn@12` is commit 12 of `map.autumn`, `stack.goblin:B08` is layer `B08` of
/// `stack.goblin`, and `stack.autumn@12:B08` is that layer of a commit. A local path that exists
/// always refers to the file itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileReference<'p> {
    /// The file.
    pub file: Cow<'p, Path>,
    /// Commit number; `None` is the newest commit.
    pub commit: Option<u64>,
    /// Name or 0-based number of the layer; `None` is the first layer.
    pub layer: Option<String>,
}

impl<'p> FileReference<'p> {
    /// Parses a path.
    pub fn of(path: &'p Path) -> FileReference<'p> {
        let whole = |path| FileReference { file: path, commit: None, layer: None };
        if let Some(url) = url_of(path) {
            return FileReference::of_url(url);
        }
        let path = match local_path(path) {
            Cow::Owned(local) => return FileReference::of(&local).into_owned(),
            Cow::Borrowed(path) => path,
        };
        if path.exists() {
            return whole(Cow::Borrowed(path));
        }
        // Layer names may also contain colons, slashes and `@`: the shortest prefix that is a file
        // wins.
        let text = path.to_str().unwrap_or_default();
        for (at, _) in text.match_indices(':').filter(|(at, _)| *at > 0) {
            let file = Path::new(&text[..at]);
            let layer = Some(text[at + 1..].to_string()).filter(|layer| !layer.is_empty());
            if file.is_file() {
                return FileReference { layer, ..whole(Cow::Borrowed(file)) };
            }
            if let Some((file, commit)) = split_commit(file).filter(|(file, _)| file.is_file()) {
                return FileReference { commit: Some(commit), layer, file: Cow::Owned(file) };
            }
        }
        match split_commit(path) {
            Some((file, commit)) => FileReference { commit: Some(commit), ..whole(Cow::Owned(file)) },
            None => whole(Cow::Borrowed(path)),
        }
    }

    /// Parses a URL. Commit and layer follow the last name of its path, before any query.
    fn of_url(url: &'p str) -> FileReference<'p> {
        let (before, query) = split_query(url);
        let name = before.rfind('/').map_or(0, |slash| slash + 1);
        let (file, layer) = match before[name..].split_once(':') {
            Some((file, layer)) => (&before[..name + file.len()], Some(layer.to_string())),
            None => (before, None),
        };
        let split = split_commit(Path::new(&file[name..]));
        let (file, commit) = match split.as_ref().and_then(|(name, commit)| Some((name.to_str()?, *commit))) {
            Some((split, commit)) => (&file[..name + split.len()], Some(commit)),
            None => (file, None),
        };
        let layer = layer.filter(|layer| !layer.is_empty());
        let file = match file.len() == before.len() {
            true => Cow::Borrowed(Path::new(url)),
            false => Cow::Owned(format!("{file}{query}").into()),
        };
        FileReference { file, commit, layer }
    }

    /// Clones borrowed data.
    fn into_owned<'o>(self) -> FileReference<'o> {
        let FileReference { file, commit, layer } = self;
        FileReference { file: Cow::Owned(file.into_owned()), commit, layer }
    }

    /// Returns the path of a layer of this file and commit.
    pub fn of_layer(&self, name: &str) -> PathBuf {
        self.with(&format!(":{name}"))
    }

    /// Returns the path of this file and commit.
    pub fn of_commit(&self) -> PathBuf {
        self.with("")
    }

    /// Path of the file and commit with a suffix, which goes before a URL's query.
    fn with(&self, more: &str) -> PathBuf {
        let commit = self.commit.map_or(String::new(), |commit| format!("@{commit}"));
        if let Some(url) = url_of(&self.file) {
            let (before, query) = split_query(url);
            return format!("{before}{commit}{more}{query}").into();
        }
        let mut path = self.file.clone().into_owned().into_os_string();
        path.push(format!("{commit}{more}"));
        path.into()
    }

    /// Resolves the layer to its number, given the names of all layers.
    ///
    /// # Errors
    /// If no layer has that name or number.
    pub fn layer_number<'n>(&self, names: impl ExactSizeIterator<Item = &'n str> + Clone) -> Result<usize> {
        let Some(layer) = &self.layer else { return Ok(0) };
        let named = names.clone().position(|name| name == layer);
        let numbered = || layer.parse().ok().filter(|number| *number < names.len());
        named.or_else(numbered).ok_or_else(|| {
            let given = names.clone().filter(|name| !name.is_empty());
            let mut known: Vec<String> = given.take(20).map(|name| format!("`{name}`")).collect();
            if names.len() > 20 {
                known.push("...".into());
            }
            let place = format!("{}: layer", self.file.display());
            let known = known.join(", ");
            let expected = match known.is_empty() {
                true => "no layer name: the file has a single layer without a name".into(),
                false => format!("{known}, or a number less than {}", names.len()),
            };
            Error::invalid(place, format!("`{layer}`"), expected)
        })
    }
}

/// Splits a path that ends with `@` and a number.
fn split_commit(path: &Path) -> Option<(PathBuf, u64)> {
    let name = path.file_name()?.to_str()?;
    let (name, number) = name.rsplit_once('@')?;
    let is_number = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
    let number = number.parse().ok().filter(|_| is_number && !name.is_empty())?;
    Some((path.with_file_name(name), number))
}

/// Returns the file that a path refers to, without commit and layer.
pub fn file_of(path: &Path) -> Cow<'_, Path> {
    FileReference::of(path).file
}

/// Returns whether a path refers to a file with cells, of either format. The file name does not
/// matter.
///
/// # Errors
/// If the file system or the remote host fails: see [`FileHeader::find`].
pub fn file_is_tree(path: &Path, access: &FileAccess) -> Result<bool> {
    Ok(FileHeader::find(&file_of(path), access)?.is_some_and(|header| header.content == Content::Cells))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commits_and_layers_of_urls_precede_the_query() {
        let place = |url: &'static str| {
            let FileReference { file, commit, layer } = FileReference::of(Path::new(url));
            (file.to_str().unwrap().to_string(), commit, layer)
        };
        let layer = |name: &str| Some(name.to_string());
        let plain = "https://host:8000/a/x.goblin";
        assert_eq!(place("https://host:8000/a/x.goblin"), (plain.into(), None, None));
        assert_eq!(place("https://host:8000/a/x.goblin:B:8"), (plain.into(), None, layer("B:8")));
        let signed = "s3://bucket/x.autumn?sig=a@1:b/c";
        assert_eq!(place("s3://bucket/x.autumn?sig=a@1:b/c"), (signed.into(), None, None));
        assert_eq!(place("s3://bucket/x.autumn@12:B?sig=a@1:b/c"), (signed.into(), Some(12), layer("B")));
        assert_eq!(TreeFormat::of(Path::new(signed)), TreeFormat::Autumnal);
        let path =
            FileReference { file: Path::new(signed).into(), commit: Some(3), layer: None }.of_layer("B");
        assert_eq!(path.to_str(), Some("s3://bucket/x.autumn@3:B?sig=a@1:b/c"));
    }
}
