//! Colours of the materials of an OBJ file.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Component, Path};

use super::super::corners::WHITE;
use super::super::model_file::{BYTE_ORDER_MARK, ModelFile};
use super::scan::{Scan, channel};
use spinney_base::Error;
use spinney_base::guard::guard;

/// Diffuse colours by the materials' names.
#[derive(Default)]
pub(super) struct Materials(HashMap<Vec<u8>, [u8; 3]>);

/// Longest file of materials that is read.
const MOST_BYTES: u64 = 4 << 20;

impl Materials {
    /// Reads the libraries that a file names. They lie beside it or below; what is missing or broken gives no
    /// colours, since the shape is the same without them. If vertices have colours, materials do not count.
    pub(super) fn read(source: &ModelFile, scan: &Scan) -> Materials {
        let mut materials = Materials::default();
        if scan.coloured > 0 {
            return materials;
        }
        for library in &scan.libraries {
            let name = String::from_utf8_lossy(library);
            let name = Path::new(&*name);
            // A model must not make us open files anywhere else.
            if !name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
                continue;
            }
            let path = source.path().parent().unwrap_or(Path::new("")).join(name);
            if path.metadata().is_ok_and(|about| about.is_file()) {
                materials.add(&path);
            }
        }
        materials
    }

    fn add(&mut self, path: &Path) {
        let Ok(file) = File::open(path) else { return };
        let mut reader = BufReader::new(file.take(MOST_BYTES));
        if reader.fill_buf().is_ok_and(|bytes| bytes.starts_with(BYTE_ORDER_MARK)) {
            reader.consume(BYTE_ORDER_MARK.len());
        }
        let read = guard(path, "materials", || {
            tobj::load_mtl_buf(&mut reader)
                .map_err(|error| Error::corrupt(path, "materials", error.to_string(), "materials"))
        });
        for material in read.map(|(materials, _)| materials).unwrap_or_default() {
            if let Some(colour) = material.diffuse {
                self.0.insert(material.name.into_bytes(), colour.map(channel));
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn colour(&self, name: &[u8]) -> [u8; 3] {
        self.0.get(name).copied().unwrap_or(WHITE)
    }
}
