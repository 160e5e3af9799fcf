//! OBJ: numbered vertices and polygons over them as text, with objects, groups and materials.

mod materials;
mod scan;
mod whole;

use self::materials::Materials;
pub(super) use self::materials::libraries;
use self::scan::{Item, Items, Scan};
use super::corners::{Corners, MAX_CORNERS};
use super::model_file::ModelFile;
use super::vertices::{Coordinates, Table, Vertices, VerticesBuilder};
use super::{MeshFace, Model, ModelInfo};
use spinney_base::Result;
use spinney_brep::Attributes;
use spinney_records::text::{self, Lines, shown};

/// Ratio of the memory that a file takes when read at once to its length.
const WHOLE_FACTOR: u64 = 4;

struct Obj {
    source: ModelFile,
    info: ModelInfo,
    scan: Scan,
    materials: Materials,
    content: Content,
    degenerate: u64,
}

enum Content {
    /// All of it, read by the `tobj` crate.
    Whole(Vec<whole::Piece>),
    /// The vertices; faces are read from the file each time.
    Vertices(Vertices),
}

/// Whether a file that has no name of a known kind looks like one of these.
pub(super) fn is_likely(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(4096)];
    let first = Lines::new(start, 0).filter_map(|line| text::words(line).next()).find(|word| word[0] != b'#');
    first.is_some_and(|word| {
        [&b"v"[..], b"vn", b"vt", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"].contains(&word)
    })
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let length = source.bytes().len() as u64;
    let mut scan = Scan::of(&source, memory, None)?;
    let materials = Materials::read(&source, &scan);
    let is_small = length.saturating_add(scan.pieces * 128).saturating_mul(WHOLE_FACTOR) <= memory;
    // What that crate makes of colours is right only if all vertices have one or none.
    let is_plain = scan.coloured == 0 || scan.coloured == scan.vertices;
    let pieces = if is_small && is_plain { whole::read(&source, &scan, &materials) } else { None };
    let content = match pieces {
        Some(pieces) => Content::Whole(pieces),
        None => {
            let is_coloured = scan.coloured > 0;
            let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, is_coloured, memory);
            scan = Scan::of(&source, memory, Some(&mut vertices))?;
            Content::Vertices(vertices.finish()?)
        }
    };
    let bounds = scan.bounds.get().ok_or_else(|| source.no_vertices())?;
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: "OBJ".into(),
        faces: Some(scan.faces),
        bounds,
        crs: None,
        unit: None,
        step: None,
        parts: scan.parts.names(),
        is_grouped: !scan.has_objects,
        attributes: Attributes::default(),
        is_coloured: scan.coloured > 0 || !materials.is_empty(),
        bytes: length,
    };
    Ok(Box::new(Obj { source, info, scan, materials, content, degenerate: 0 }))
}

impl Obj {
    /// Reads faces from the file.
    fn stream(
        source: &ModelFile,
        scan: &mut Scan,
        materials: &Materials,
        vertices: Table<'_>,
        corners: &mut Corners,
        each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>,
    ) -> Result<()> {
        let (mut known, mut number) = (0, 0u64);
        let mut items = Items::new(source, scan.has_objects);
        while let Some((line, item)) = items.next()? {
            match item {
                Item::Vertex(_) => known += 1,
                Item::Library(_) => {}
                Item::Face { words, part, material } => {
                    corners.clear();
                    let wrong = |found: String, expected: String| {
                        source.corrupt(format!("face {number}, line {line}"), found, expected)
                    };
                    for word in words {
                        let index = index(word, known).filter(|index| *index < vertices.len());
                        let Some(index) = index.filter(|_| corners.len() < MAX_CORNERS) else {
                            let expected =
                                format!("at most 2^20 corners that are one of {} vertices", vertices.len());
                            return Err(wrong(shown(word), expected));
                        };
                        corners.push(vertices.position(index));
                        if let Some(colour) = vertices.colour(index) {
                            corners.push_colour(colour);
                        }
                    }
                    if !vertices.is_coloured() && !materials.is_empty() {
                        corners.paint(materials.colour(material));
                    }
                    let part = scan.parts.number(source, part)?;
                    corners.hand_out(part, each)?;
                    number += 1;
                }
            }
        }
        Ok(())
    }
}

/// Index of the vertex of a corner such as `7`, `7/1`, `7//3` or `-1/-1`; `known` vertices come before it.
fn index(word: &[u8], known: u64) -> Option<u64> {
    let word = word.split(|byte| *byte == b'/').next()?;
    match text::whole(word)? {
        0 => None,
        number if number > 0 => Some(number as u64 - 1),
        number => known.checked_sub(number.unsigned_abs()),
    }
}

impl Model for Obj {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let mut corners = Corners::default();
        match &self.content {
            Content::Whole(pieces) => {
                pieces.iter().try_for_each(|piece| piece.faces(self.info.is_coloured, &mut corners, each))?;
            }
            Content::Vertices(vertices) => {
                let (source, materials, table) = (&self.source, &self.materials, vertices.table());
                Obj::stream(source, &mut self.scan, materials, table, &mut corners, each)?;
            }
        }
        self.degenerate = corners.degenerate;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }
}
