//! Material colours of an OBJ file.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use super::super::colour_range::ColourRange;
use super::super::corners::WHITE;
use super::super::model_file::{BYTE_ORDER_MARK, ModelFile};
use super::super::parts::decoded;
use spinney_base::Error;
use spinney_base::guard::guard;

/// Diffuse colours by material name.
#[derive(Default)]
pub(super) struct Materials(HashMap<String, [u8; 3]>);

/// Path of a material library. Returns `None` if it is not in the model's directory or below: an
/// untrusted model must not cause other files to be opened.
fn library_path(source: &ModelFile, name: &[u8]) -> Option<PathBuf> {
    let name = String::from_utf8_lossy(name);
    let name = Path::new(&*name);
    let is_below = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    is_below.then(|| source.path().parent().unwrap_or(Path::new("")).join(name))
}

/// Paths of all libraries that a file names, whether they exist or not.
pub(in super::super) fn libraries(source: &ModelFile) -> Vec<PathBuf> {
    let lines = source.bytes().split(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let names = lines.filter_map(|line| line.strip_prefix(b"mtllib"));
    names.filter_map(|name| library_path(source, name.trim_ascii())).collect()
}

/// Maximum bytes that are read of a material library.
pub(crate) const MAX_LIBRARY_BYTES: u64 = 4 << 20;

impl Materials {
    /// Reads the libraries that a file names. They must be in the model's directory or below it. A
    /// missing or corrupt library results in no colours, since the geometry does not depend on it.
    pub(super) fn read(source: &ModelFile, libraries: &[Vec<u8>]) -> Materials {
        let mut materials = Materials::default();
        for library in libraries {
            let path = library_path(source, library);
            if let Some(path) = path.filter(|path| path.metadata().is_ok_and(|about| about.is_file())) {
                materials.add(&path);
            }
        }
        materials
    }

    fn add(&mut self, path: &Path) {
        let Ok(file) = File::open(path) else { return };
        let mut bytes = Vec::new();
        if file.take(MAX_LIBRARY_BYTES).read_to_end(&mut bytes).is_err() {
            return;
        }
        let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes);
        // (Lines are decoded as names in models are.)
        let text: Vec<_> = bytes.split(|byte| *byte == b'\n').map(decoded).collect();
        let text = text.join("\n");
        let mut reader = text.as_bytes();
        let read = guard(path, "materials", || {
            tobj::load_mtl_buf(&mut reader)
                .map_err(|error| Error::corrupt(path, "materials", error.to_string(), "materials"))
        });
        for material in read.map(|(materials, _)| materials).unwrap_or_default() {
            if let Some(colour) = material.diffuse {
                self.0.insert(material.name, ColourRange::default().colour(colour));
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn colour(&self, name: &str) -> [u8; 3] {
        self.0.get(name).copied().unwrap_or(WHITE)
    }
}
