//! Files that are kept open while they are unchanged.

use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use spinney_base::io::{FileAccess, directory_of, listed_path, url_of};
use spinney_base::{Error, Result};
use spinney_container::FileReference;
use spinney_engine::dataset::{self, Dataset};
use spinney_engine::ops::{Calculation, TreeFile, ViewOperation};

use crate::drawn::DrawableTree;
use crate::version::FileVersion;

/// Version of a file, or of one of its commits, open for queries. It stays valid for its users
/// after the file changes.
pub(crate) struct OpenTree {
    pub(crate) version: FileVersion,
    first: Arc<Dataset>,
    /// Names of the layers, and the layers once they are first requested.
    names: Vec<String>,
    layers: OnceLock<Vec<Arc<Dataset>>>,
    /// Trees for drawing, by the `layer` parameter.
    drawn: Mutex<HashMap<String, Arc<DrawableTree>>>,
}

/// Maximum number of trees for drawing that are cached per file.
const MAX_DRAWN: usize = 16;

impl OpenTree {
    fn open(path: &Path, version: FileVersion, access: &FileAccess) -> Result<OpenTree> {
        let first = Arc::new(dataset::open(path, &access.into())?);
        let names = first.layers()?.into_iter().map(|layer| layer.name).collect();
        Ok(OpenTree { version, first, names, layers: OnceLock::new(), drawn: Mutex::default() })
    }

    /// Checks that all reads were of this version. Called once after each response is computed.
    ///
    /// # Errors
    /// If the file was overwritten in place.
    pub(crate) fn check_unchanged(&self) -> Result<()> {
        self.first.check_unchanged()
    }

    /// All layers.
    fn all(&self) -> Result<&[Arc<Dataset>]> {
        if let Some(layers) = self.layers.get() {
            return Ok(layers);
        }
        let layers = match self.names[..] {
            [_] => vec![self.first.clone()],
            _ => self.names.iter().map(|name| self.first.layer(name).map(Arc::new)).collect::<Result<_>>()?,
        };
        Ok(self.layers.get_or_init(|| layers))
    }

    /// Layers by name, or by index from 0, separated by commas. All layers if `named` is `None`.
    ///
    /// # Errors
    /// If there is no such layer, or one is corrupt.
    pub(crate) fn layers(&self, named: Option<&str>) -> Result<Vec<&Dataset>> {
        Ok(self.shared(named)?.into_iter().map(|layer| &**layer).collect())
    }

    fn shared(&self, named: Option<&str>) -> Result<Vec<&Arc<Dataset>>> {
        let all = self.all()?;
        let Some(named) = named else { return Ok(all.iter().collect()) };
        let number = |name: &str| {
            let file = self.first.name().into();
            let reference = FileReference { file, commit: None, layer: Some(name.to_owned()) };
            reference.layer_number(self.names.iter().map(String::as_str))
        };
        // A name may contain commas.
        let numbers = match self.names.iter().position(|name| name == named) {
            Some(number) => vec![number],
            None => named.split(',').map(|name| number(name.trim())).collect::<Result<_>>()?,
        };
        Ok(numbers.into_iter().map(|number| &all[number]).collect())
    }

    /// Tree to draw: a single layer, or a composite whose colours are two to four layers.
    ///
    /// # Errors
    /// Those of [`OpenTree::layers`]; if the file has several layers and none is named, or if more
    /// are named than can be colours.
    pub(crate) fn drawn(&self, named: Option<&str>) -> Result<Arc<DrawableTree>> {
        let key = named.unwrap_or_default();
        if let Some(drawn) = self.kept().get(key) {
            return Ok(drawn.clone());
        }
        let (tree, is_composite) = match &self.shared(named)?[..] {
            [one] => ((*one).clone(), false),
            _ if named.is_none() => {
                let expected = format!("one or more of {}, separated by commas", self.names.join(", "));
                return Err(Error::invalid("layer", "none", expected));
            }
            several => {
                let names: Vec<String> = several.iter().map(|layer| layer.metadata().name.clone()).collect();
                // The composite has the cells of the layer with the smallest cells.
                let finest = several.iter().max_by_key(|layer| layer.depth());
                let finest = finest.map_or("", |layer| layer.metadata().name.as_str());
                let composite = ViewOperation::Calculation(Box::new(Calculation::composite(&names)?));
                (Arc::new(self.first.layer(finest)?.view(&[composite])?), true)
            }
        };
        let drawn = Arc::new(DrawableTree::new(tree, is_composite));
        let mut kept = self.kept();
        if kept.len() >= MAX_DRAWN {
            kept.clear();
        }
        kept.insert(key.to_owned(), drawn.clone());
        Ok(drawn)
    }

    fn kept(&self) -> MutexGuard<'_, HashMap<String, Arc<DrawableTree>>> {
        self.drawn.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// File, and the number of a commit if one is requested.
type Key = (PathBuf, Option<u64>);

/// Open files, each in its latest known version.
pub(crate) struct OpenTrees {
    /// Whether manifests may be opened. Their files may be anywhere, so this is allowed for a
    /// single served file, but not for files of a directory.
    allows_manifests: bool,
    access: FileAccess,
    trees: Mutex<HashMap<Key, Arc<OpenTree>>>,
    /// Serializes opening, so that concurrent requests for a file share one tree.
    opening: Mutex<()>,
}

/// Refuses files of a served directory whose cells may be in files outside of it.
fn check_is_inside(path: &Path, tree: &Dataset) -> Result<()> {
    let directory = directory_of(path);
    let is_outside = |name: &str| {
        let is_plain = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
        // (Symbolic links must not leave the directory.)
        let source = || listed_path(path, name).ok()?.canonicalize().ok();
        let leaves = || match (directory.canonicalize(), source()) {
            (Ok(directory), Some(source)) => !source.starts_with(directory),
            _ => false,
        };
        url_of(Path::new(name)).is_some() || !is_plain || leaves()
    };
    let found = match tree.as_file() {
        Some(TreeFile::Mosaic(_)) => "a manifest in a served directory (its files may be outside)".into(),
        Some(TreeFile::Goblin(file)) => match file.find_source(&is_outside)? {
            Some(name) => {
                format!("an index in a served directory with a source that may be outside ({name})")
            }
            None => return Ok(()),
        },
        _ => return Ok(()),
    };
    let advice = "serve it alone, or convert it to a tree: `spinney transform`";
    Err(Error::unsupported(path, found, advice))
}

/// Maximum number of files that are kept open.
const MAX_OPEN: usize = 64;

/// Cache per file in bytes. (Files are not mapped: truncating a mapped file would crash the
/// server.)
const CACHE: u64 = 1 << 20;

/// Maximum number of attempts to open a file that is being modified.
const TIMES: usize = 20;

impl OpenTrees {
    pub(crate) fn new(allows_manifests: bool, access: &FileAccess) -> OpenTrees {
        let access = access.clone().positioned(CACHE);
        OpenTrees { allows_manifests, access, trees: Mutex::default(), opening: Mutex::default() }
    }

    /// Returns a file, or a commit of it, in its current version.
    ///
    /// # Errors
    /// If it cannot be opened, or changes during every attempt.
    pub(crate) fn get(&self, path: &Path, commit: Option<u64>) -> Result<Arc<OpenTree>> {
        let stat = || std::fs::metadata(path);
        let key = (path.to_path_buf(), commit);
        let reference = FileReference { file: path.into(), commit, layer: None }.of_commit();
        for _ in 0..TIMES {
            let (version, is_settled) = match FileVersion::settled(path, stat) {
                Ok(found) => found,
                Err(error) => {
                    self.trees().remove(&key);
                    return Err(error);
                }
            };
            if let Some(tree) = self.known(&key, version) {
                return Ok(tree);
            }
            let _one = self.opening.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(tree) = self.known(&key, version) {
                return Ok(tree);
            }
            let opened = OpenTree::open(&reference, version, &self.access);
            // The opened file may differ from the one that was stat'ed.
            if FileVersion::at(path)? != version {
                continue;
            }
            let tree = Arc::new(opened?);
            if !self.allows_manifests {
                check_is_inside(path, &tree.first)?;
            }
            if !is_settled {
                return Ok(tree);
            }
            let mut trees = self.trees();
            // Closes files that were replaced or removed.
            trees
                .retain(|(path, _), tree| FileVersion::at(path).is_ok_and(|version| version == tree.version));
            if trees.len() >= MAX_OPEN && !trees.contains_key(&key) {
                // Evicts an arbitrary file. Its users keep it, and it is opened again on request.
                let other = trees.keys().next().cloned();
                other.and_then(|other| trees.remove(&other));
            }
            trees.insert(key, tree.clone());
            return Ok(tree);
        }
        Err(Error::Changed { path: path.to_path_buf(), what: "was changed repeatedly" })
    }

    fn trees(&self) -> MutexGuard<'_, HashMap<Key, Arc<OpenTree>>> {
        self.trees.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn known(&self, key: &Key, version: FileVersion) -> Option<Arc<OpenTree>> {
        self.trees().get(key).filter(|tree| tree.version == version).cloned()
    }
}
