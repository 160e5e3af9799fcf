//! OBJ files that fit the memory, read at once by the `tobj` crate.
//!
//! That crate gets the statements that matter, made uniform: it takes lines for faces and groups for objects,
//! loses names behind blanks, and refuses comments behind numbers.

use std::io::{BufReader, Read};

use super::super::corners::{Corners, MAX_CORNERS};
use super::super::model_file::ModelFile;
use super::materials::Materials;
use super::scan::{Item, Items, Scan, channel};
use crate::import::MeshFace;
use spinney_base::guard::guard;
use spinney_base::{Error, Result};

/// Faces of the same part and material.
pub(super) struct Piece {
    part: u32,
    colour: [u8; 3],
    mesh: tobj::Mesh,
}

/// All pieces of a file, or nothing if it has something that the crate does not take.
pub(super) fn read(source: &ModelFile, scan: &Scan, materials: &Materials) -> Option<Vec<Piece>> {
    let feed = Feed {
        items: Items::new(source, scan.has_objects),
        scan,
        materials,
        last: None,
        text: Vec::new(),
        at: 0,
    };
    let options = tobj::LoadOptions { triangulate: false, single_index: false, ..Default::default() };
    let (models, _) = guard(source.path(), "OBJ", || {
        tobj::load_obj_buf(&mut BufReader::new(feed), &options, |_| Err(tobj::LoadError::OpenFileFailed))
            .map_err(|error| Error::corrupt(source.path(), "OBJ", error.to_string(), "an OBJ file"))
    })
    .ok()?;
    models.into_iter().map(|model| Piece::of(&model.name, model.mesh)).collect()
}

impl Piece {
    /// A piece whose name is what [`Feed`] has made of its part and colour.
    fn of(name: &str, mesh: tobj::Mesh) -> Option<Piece> {
        let mut words = name.split(' ');
        let part = words.next()?.parse().ok()?;
        let mut channel = || words.next()?.parse().ok();
        // The streaming reader refuses it, and knows where it is.
        if mesh.face_arities.iter().any(|arity| *arity as usize > MAX_CORNERS) {
            return None;
        }
        Some(Piece { part, colour: [channel()?, channel()?, channel()?], mesh })
    }

    pub(super) fn faces(
        &self,
        is_coloured: bool,
        corners: &mut Corners,
        each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>,
    ) -> Result<()> {
        let mesh = &self.mesh;
        let (points, _) = mesh.positions.as_chunks::<3>();
        let (colours, _) = mesh.vertex_color.as_chunks::<3>();
        let mut indices = mesh.indices.as_slice();
        // Without arities, all are triangles.
        let mut arities = mesh.face_arities.iter();
        while !indices.is_empty() || arities.len() > 0 {
            let arity = arities.next().map_or(3, |arity| *arity as usize).min(indices.len());
            let face;
            (face, indices) = indices.split_at(arity);
            corners.clear();
            for index in face {
                corners.push(points[*index as usize]);
                if let Some(colour) = colours.get(*index as usize) {
                    corners.push_colour(colour.map(channel));
                }
            }
            if is_coloured && colours.is_empty() {
                corners.paint(self.colour);
            }
            corners.hand_out(self.part, each)?;
        }
        Ok(())
    }
}

/// Statements as text for the crate: vertices, faces of bare vertex numbers, and an object, named by the
/// part's number and the material's colour, wherever one of these changes.
struct Feed<'a> {
    items: Items<'a>,
    scan: &'a Scan,
    materials: &'a Materials,
    last: Option<(usize, usize)>,
    text: Vec<u8>,
    /// Bytes of the text that have been taken.
    at: usize,
}

impl Feed<'_> {
    /// Makes the text of the next statement; false at the end.
    fn advance(&mut self) -> Result<bool> {
        self.text.clear();
        self.at = 0;
        match self.items.next()?.map(|(_, item)| item) {
            None => return Ok(false),
            Some(Item::Library(_)) => {}
            Some(Item::Vertex(words)) => {
                self.text.push(b'v');
                // A seventh number is a colour's opacity.
                words.take(6).for_each(|word| self.text.extend([b" ", word].concat()));
            }
            Some(Item::Face { words, part, material }) => {
                let here = (part.as_ptr() as usize, material.as_ptr() as usize);
                if self.last != Some(here) {
                    self.last = Some(here);
                    let part = self.scan.parts.get(part).unwrap_or(0);
                    let [r, g, b] = self.materials.colour(material);
                    self.text.extend(format!("o {part} {r} {g} {b}\n").as_bytes());
                }
                self.text.push(b'f');
                for word in words {
                    let vertex = word.split(|byte| *byte == b'/').next().unwrap_or_default();
                    // One that is missing must not go unnoticed.
                    let vertex = if vertex.is_empty() { b"?" } else { vertex };
                    self.text.extend([b" ", vertex].concat());
                }
            }
        }
        self.text.push(b'\n');
        Ok(true)
    }
}

impl Read for Feed<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        while self.at == self.text.len() {
            if !self.advance().map_err(std::io::Error::other)? {
                return Ok(0);
            }
        }
        let length = out.len().min(self.text.len() - self.at);
        out[..length].copy_from_slice(&self.text[self.at..][..length]);
        self.at += length;
        Ok(length)
    }
}
