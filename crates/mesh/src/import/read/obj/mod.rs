//! OBJ: indexed vertices and polygons as text, with objects, groups and materials.
//!
//! A single pass over the text builds tables of vertices and faces, which spill to temporary files.
//! The `tobj` crate reads the materials and is the reference in tests. It is not used for geometry,
//! because its errors have no line numbers, it treats groups as objects and lines as faces, and it
//! requires colours at all vertices or none.

mod faces;
mod materials;
mod statements;
#[cfg(test)]
mod tests;

use std::borrow::Cow;

use self::faces::{FaceHead, FaceList, FaceListBuilder};
pub(crate) use self::materials::MAX_LIBRARY_BYTES;
use self::materials::Materials;
pub(super) use self::materials::libraries;
use self::statements::{Statement, Statements, vertex};
use super::colour_range::ColourRange;
use super::corners::{Corners, MAX_CORNERS, WHITE};
use super::face_values::{MATERIAL, MAX_VALUE_BYTES};
use super::model_file::ModelFile;
use super::parts::PartNames;
use super::vertices::{Coordinates, VertexBounds, Vertices, VerticesBuilder};
use super::{MeshFace, Model, ModelInfo};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;
use spinney_records::text::{self, Lines, Words, shown};

struct Obj {
    info: ModelInfo,
    vertices: Vertices,
    faces: FaceList,
    /// Face colours by material number; empty if vertices have colours, or if there are none.
    colours: Vec<[u8; 3]>,
    /// Names of the materials as JSON, by material number; empty if there is none, or if it is too
    /// long.
    materials: Vec<String>,
    /// Material number of faces without a material, if there are any.
    no_material: Option<u32>,
    degenerate: u64,
    lost_values: u64,
}

/// Whether a file with an unknown extension looks like OBJ.
pub(super) fn is_likely(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(4096)];
    let first = Lines::new(start, 0).filter_map(|line| text::words(line).next()).find(|word| word[0] != b'#');
    first.is_some_and(|word| {
        [&b"v"[..], b"vn", b"vt", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"].contains(&word)
    })
}

/// Maximum number of material libraries that are read.
const MAX_LIBRARIES: usize = 64;

/// Name of the part with the faces before all objects or groups.
const NO_PART: &[u8] = b"mesh";

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, true, memory / 2);
    let mut faces = FaceListBuilder::new(source.path(), memory / 2);
    let (mut parts, mut materials) = (PartNames::new(memory), PartNames::new(memory));
    let (mut bounds, mut libraries) = (VertexBounds::new(), Vec::new());
    let (mut vertex_count, mut max_vertex) = (0, None);
    let (mut is_coloured, mut has_materials, mut has_objects) = (false, false, false);
    let mut range = ColourRange::default();
    let (mut part, mut material) = (NO_PART, &b""[..]);
    // Part and material numbers of the current names; assigned when the first face uses them.
    let mut head = None;
    let mut corners = Vec::new();
    let mut statements = Statements::new(&source);
    while let Some((line, statement)) = statements.next()? {
        match statement {
            Statement::Vertex(words) => {
                let Some((point, colour)) = vertex(words.clone()) else {
                    let found: Cow<'_, [u8]> = words.take(8).collect::<Vec<_>>().join(&b' ').into();
                    let place = format!("vertex {}, line {line}", vertex_count + 1);
                    let expected = "three finite numbers, optionally followed by a weight or a colour";
                    return Err(source.corrupt(place, shown(&found), expected));
                };
                vertex_count += 1;
                is_coloured |= colour.is_some();
                bounds.add(point);
                // (The range is assumed to be 0 to 1 until a larger value occurs.)
                colour.iter().flatten().for_each(|number| range.add(*number));
                vertices.push(point, colour.map_or(WHITE, |colour| range.colour(colour)))?;
            }
            Statement::Face(words) => {
                let head = match head {
                    Some(head) => head,
                    None => {
                        has_materials |= !material.is_empty();
                        let material = materials.number(&source, material)?;
                        *head.insert(FaceHead { part: parts.number(&source, part)?, material })
                    }
                };
                read_corners(words, vertex_count, u64::MAX, &mut corners).map_err(|word| {
                    let expected = "at most 2^20 corners, each a vertex number";
                    source.corrupt(format!("face {}, line {line}", faces.count()), shown(word), expected)
                })?;
                max_vertex = max_vertex.max(corners.iter().copied().max());
                faces.push(head, &corners)?;
            }
            Statement::Object(name) => {
                if !has_objects {
                    // If there are objects, groups are not parts.
                    (has_objects, parts) = (true, PartNames::new(memory));
                    faces.drop_parts();
                    if faces.count() > 0 {
                        parts.number(&source, NO_PART)?;
                    }
                }
                (part, head) = (name, None);
            }
            Statement::Group(name) if !has_objects => (part, head) = (name, None),
            Statement::Group(_) => {}
            Statement::Material(name) => (material, head) = (name, None),
            Statement::Library(name) if libraries.len() < MAX_LIBRARIES => libraries.push(name.to_vec()),
            Statement::Library(_) => {}
        }
    }
    let bounds = bounds.get().ok_or_else(|| source.no_vertices())?;
    if max_vertex >= Some(vertex_count) {
        return Err(missing_vertex(&source, vertex_count));
    }
    if range.has_bytes() {
        vertices = VerticesBuilder::new(source.path(), Coordinates::F64, true, memory / 2);
        let mut statements = Statements::new(&source);
        while let Some((_, statement)) = statements.next()? {
            let Statement::Vertex(words) = statement else { continue };
            let Some((point, colour)) = vertex(words) else { continue };
            vertices.push(point, colour.map_or(WHITE, |colour| range.colour(colour)))?;
        }
    }
    let mut vertices = vertices.finish()?;
    let mut colours = Vec::new();
    if !is_coloured {
        vertices = vertices.without_colours();
        let read = if has_materials { Materials::read(&source, &libraries) } else { Materials::default() };
        if !read.is_empty() {
            colours = materials.names().iter().map(|name| read.colour(name)).collect();
        }
    }
    let mut materials = materials.into_names();
    let no_material = materials.iter().position(String::is_empty).map(|number| number as u32);
    for name in &mut materials {
        let json = serde_json::Value::from(std::mem::take(name)).to_string();
        *name = if json.len() <= MAX_VALUE_BYTES && json != "\"\"" { json } else { String::new() };
    }
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: "OBJ".into(),
        faces: Some(faces.count()),
        bounds,
        crs: None,
        unit: None,
        step: None,
        parts: parts.names(),
        is_grouped: !has_objects,
        is_z_up: false,
        attributes: Attributes::default(),
        is_coloured: is_coloured || !colours.is_empty(),
        bytes: source.bytes().len() as u64,
    };
    let faces = faces.finish()?;
    Ok(Box::new(Obj {
        info,
        vertices,
        faces,
        colours,
        materials,
        no_material,
        degenerate: 0,
        lost_values: 0,
    }))
}

/// Reads the vertices of a face's corners. `known` vertices precede the face, and the file has
/// `count`. Returns an invalid word as the error.
fn read_corners<'w>(
    words: Words<'w>,
    known: u64,
    count: u64,
    corners: &mut Vec<u64>,
) -> std::result::Result<(), &'w [u8]> {
    corners.clear();
    for word in words {
        let index = index(word, known).filter(|index| *index < count && corners.len() < MAX_CORNERS);
        corners.push(index.ok_or(word)?);
    }
    Ok(())
}

/// Vertex index of a corner such as `7`, `7/1`, `7//3` or `-1/-1`; `known` vertices precede it.
fn index(word: &[u8], known: u64) -> Option<u64> {
    let word = word.split(|byte| *byte == b'/').next()?;
    match text::whole(word)? {
        0 => None,
        number if number > 0 => Some(number as u64 - 1),
        number => known.checked_sub(number.unsigned_abs()),
    }
}

/// Error for a face that uses a missing vertex. Vertices may come after faces, so the file is
/// searched again from its start once their number is known.
fn missing_vertex(source: &ModelFile, count: u64) -> Error {
    let expected = format!("at most 2^20 corners, each one of the {count} vertices");
    let (mut known, mut number, mut corners) = (0, 0u64, Vec::new());
    let mut statements = Statements::new(source);
    loop {
        match statements.next() {
            Err(error) => return error,
            Ok(None) => return source.corrupt("faces", "a vertex that does not exist", expected),
            Ok(Some((_, Statement::Vertex(_)))) => known += 1,
            Ok(Some((line, Statement::Face(words)))) => {
                if let Err(word) = read_corners(words, known, count, &mut corners) {
                    return source.corrupt(format!("face {number}, line {line}"), shown(word), expected);
                }
                number += 1;
            }
            Ok(Some(_)) => {}
        }
    }
}

impl Model for Obj {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let (table, mut faces) = (self.vertices.table(), self.faces.reader());
        let (mut corners, mut vertices) = (Corners::default(), Vec::new());
        let mut lost_values = 0;
        while let Some(head) = faces.next(&mut vertices) {
            corners.clear();
            for vertex in &vertices {
                corners.push(table.position(*vertex));
                if let Some(colour) = table.colour(*vertex) {
                    corners.push_colour(colour);
                }
            }
            if let Some(colour) = self.colours.get(head.material as usize) {
                corners.paint(*colour);
            }
            let name = self.materials.get(head.material as usize).filter(|name| !name.is_empty());
            let value = name.map(|name| (MATERIAL, name.as_str()));
            lost_values += u64::from(value.is_none() && self.no_material != Some(head.material));
            corners.hand_out(head.part, &mut |face| each(&MeshFace { values: value.as_slice(), ..*face }))?;
        }
        (self.degenerate, self.lost_values) = (corners.degenerate, lost_values);
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }

    fn lost_values(&self) -> u64 {
        self.lost_values
    }
}
