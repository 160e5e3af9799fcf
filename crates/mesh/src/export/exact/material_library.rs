//! Colours of materials, as a library next to an OBJ file.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;

use crate::import::MAX_LIBRARY_BYTES;
use spinney_base::io::{Output, url_of};
use spinney_base::{Error, Result};

/// Colour of faces without a material.
const WHITE: [u8; 3] = [255; 3];

/// Colours by material, as far as all faces of each have the same, and the library is not larger
/// than readers read.
#[derive(Default)]
pub(super) struct MaterialLibrary {
    colours: BTreeMap<String, [u8; 3]>,
    bytes: u64,
    is_impossible: bool,
}

impl MaterialLibrary {
    /// Adds a face by its material, which is empty if it has none, and the colours of its vertices.
    pub(super) fn add(&mut self, material: &str, colours: &[[u8; 3]]) {
        let Some(first) = colours.first().filter(|_| !self.is_impossible) else {
            self.is_impossible = true;
            return;
        };
        let known = if material.is_empty() { Some(&WHITE) } else { self.colours.get(material) };
        let is_uniform = colours.iter().all(|colour| colour == known.unwrap_or(first));
        if known.is_none() {
            self.bytes += entry(material, *first).len() as u64;
            self.colours.insert(material.into(), *first);
        }
        if !is_uniform || self.bytes > MAX_LIBRARY_BYTES {
            (self.is_impossible, self.colours) = (true, BTreeMap::new());
        }
    }

    /// The text of the library, if there is one.
    pub(super) fn text(self) -> Option<String> {
        let all = self.colours.iter().map(|(name, colour)| entry(name, *colour));
        (!self.is_impossible && !self.colours.is_empty()).then(|| all.collect())
    }
}

/// Lines of a material. (Four decimals distinguish 256 values.)
fn entry(name: &str, colour: [u8; 3]) -> String {
    let [red, green, blue] = colour.map(|channel| f64::from(channel) / 255.0);
    format!("newmtl {name}\nKd {red:.4} {green:.4} {blue:.4}\n")
}

/// Path of the library of an OBJ file and its name there, if one can be written.
pub(super) fn library_path(output: &Output) -> Option<(PathBuf, String)> {
    let path = output.path().with_extension("mtl");
    let name = path.file_name()?.to_str()?.to_string();
    let is_line = name.trim() == name && !name.contains(char::is_control);
    (output.is_file() && url_of(&path).is_none() && is_line).then_some((path, name))
}

/// Starts the library next to a file; the caller commits it.
pub(super) fn start(output: &Output, path: PathBuf, text: &str) -> Result<Output> {
    let mut library = output.access().create(&path)?;
    let header = "# made by spinney\n";
    library.write_all(header.as_bytes()).map_err(Error::io(&path, "write"))?;
    library.write_all(text.as_bytes()).map_err(Error::io(&path, "write"))?;
    Ok(library)
}
