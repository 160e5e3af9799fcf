//! Statements of an OBJ file, and a summary of them from a first pass.

use std::borrow::Cow;

use super::super::corners::WHITE;
use super::super::model_file::ModelFile;
use super::super::parts::Parts;
use super::super::vertices::{VertexBounds, VerticesBuilder};
use spinney_base::Result;
use spinney_records::text::{Lines, Words, real, shown, words};

/// Longest statement over several lines.
const MAX_BYTES: usize = 64 << 20;

/// A statement that matters here.
pub(super) enum Item<'a> {
    Vertex(Words<'a>),
    /// A polygon's corners; the part and the material that hold for it.
    Face {
        words: Words<'a>,
        part: &'a [u8],
        material: &'a [u8],
    },
    /// Names of files with materials.
    Library(&'a [u8]),
}

/// Goes through the statements of a file.
pub(super) struct Items<'a> {
    source: &'a ModelFile,
    lines: Lines<'a>,
    /// Lines so far.
    count: u64,
    /// Parts are objects, else groups.
    has_objects: bool,
    part: &'a [u8],
    material: &'a [u8],
    /// The statement, if it is joined of several lines.
    joined: Vec<u8>,
}

impl<'a> Items<'a> {
    pub(super) fn new(source: &'a ModelFile, has_objects: bool) -> Items<'a> {
        let lines = Lines::new(source.bytes(), 0);
        Items { source, lines, count: 0, has_objects, part: b"mesh", material: b"", joined: Vec::new() }
    }

    /// The next statement, and the number of the line that it ends in.
    pub(super) fn next(&mut self) -> Result<Option<(u64, Item<'_>)>> {
        loop {
            let Some(mut line) = self.lines.next() else { return Ok(None) };
            self.count += 1;
            self.source.passed(self.count);
            self.joined.clear();
            let mut is_joined = false;
            while let Some(start) = line.strip_suffix(b"\\") {
                is_joined = true;
                self.joined.extend_from_slice(start);
                self.joined.push(b' ');
                line = self.lines.next().unwrap_or_default();
                self.count += 1;
                if self.joined.len() > MAX_BYTES {
                    let found = format!("a statement of more than {MAX_BYTES} bytes");
                    return Err(self.source.corrupt(format!("line {}", self.count), found, "a shorter one"));
                }
            }
            let mut rest = words(line);
            let mut keyword = rest.next().unwrap_or_default();
            if is_joined {
                self.joined.extend_from_slice(line);
                // Names are not continued on other lines; only what has many numbers is.
                keyword = words(&self.joined).next().map_or(b"", |word| match word {
                    b"v" => b"v",
                    b"f" => b"f",
                    _ => b"",
                });
            }
            let name = |line: &'a [u8]| line.get(rest.offset..).unwrap_or_default().trim_ascii();
            match keyword {
                b"o" if self.has_objects => self.part = name(line),
                b"g" if !self.has_objects => self.part = name(line),
                b"usemtl" => self.material = name(line),
                b"mtllib" => return Ok(Some((self.count, Item::Library(name(line))))),
                b"v" | b"f" => {
                    let whole: &[u8] = if is_joined { &self.joined } else { line };
                    let whole = whole.split(|byte| *byte == b'#').next().unwrap_or_default();
                    let mut words = words(whole);
                    words.next();
                    if keyword == b"v" {
                        return Ok(Some((self.count, Item::Vertex(words))));
                    }
                    let face = Item::Face { words, part: self.part, material: self.material };
                    return Ok(Some((self.count, face)));
                }
                _ => {}
            }
        }
    }
}

/// Summary of a file from its first pass.
pub(super) struct Scan {
    pub(super) has_objects: bool,
    pub(super) parts: Parts,
    pub(super) vertices: u64,
    /// Vertices with colours.
    pub(super) coloured: u64,
    pub(super) faces: u64,
    /// Runs of faces with the same part and material.
    pub(super) pieces: u64,
    pub(super) bounds: VertexBounds,
    /// Names of files with materials, none of them if faces have no material.
    pub(super) libraries: Vec<Vec<u8>>,
}

/// Most files with materials that are looked at.
const MAX_LIBRARIES: usize = 64;

impl Scan {
    /// Reads everything but the corners of faces, and puts the vertices into a store if there is one.
    pub(super) fn of(
        source: &ModelFile,
        memory: u64,
        mut store: Option<&mut VerticesBuilder>,
    ) -> Result<Scan> {
        let has_objects = Lines::new(source.bytes(), 0).any(|line| words(line).next() == Some(b"o"));
        let mut scan = Scan {
            has_objects,
            parts: Parts::new(memory),
            vertices: 0,
            coloured: 0,
            faces: 0,
            pieces: 0,
            bounds: VertexBounds::new(),
            libraries: Vec::new(),
        };
        let mut last = None;
        let mut has_materials = false;
        let mut items = Items::new(source, has_objects);
        while let Some((line, item)) = items.next()? {
            match item {
                Item::Vertex(words) => {
                    let Some((point, colour)) = vertex(words.clone()) else {
                        let found: Cow<'_, [u8]> = words.take(8).collect::<Vec<_>>().join(&b' ').into();
                        let place = format!("vertex {}, line {}", scan.vertices + 1, line);
                        let expected = "three finite numbers, perhaps a weight or a colour";
                        return Err(source.corrupt(place, shown(&found), expected));
                    };
                    scan.vertices += 1;
                    scan.coloured += u64::from(colour.is_some());
                    scan.bounds.add(point);
                    if let Some(store) = &mut store {
                        store.push(point, colour.unwrap_or(WHITE))?;
                    }
                }
                Item::Face { part, material, .. } => {
                    scan.faces += 1;
                    has_materials |= !material.is_empty();
                    // Names are slices of the file: where they start tells statements apart.
                    let here = (part.as_ptr() as usize, material.as_ptr() as usize);
                    if last != Some(here) {
                        last = Some(here);
                        scan.pieces += 1;
                        scan.parts.number(source, part)?;
                    }
                }
                Item::Library(name) if scan.libraries.len() < MAX_LIBRARIES => {
                    scan.libraries.push(name.to_vec());
                }
                Item::Library(_) => {}
            }
        }
        if !has_materials {
            scan.libraries.clear();
        }
        Ok(scan)
    }
}

/// Coordinates of a vertex, which a fourth number divides, and its colour.
pub(super) fn vertex(mut words: Words<'_>) -> Option<([f64; 3], Option<[u8; 3]>)> {
    let mut numbers = [0.0; 7];
    let mut count = 0;
    for word in &mut words {
        *numbers.get_mut(count)? = real(word)?;
        count += 1;
    }
    let [x, y, z, a, b, c, _] = numbers;
    let (point, colour) = match count {
        3 => ([x, y, z], None),
        4 => ([x / a, y / a, z / a], None),
        6 | 7 => ([x, y, z], Some([a, b, c].map(channel))),
        _ => return None,
    };
    point.iter().all(|coordinate: &f64| coordinate.is_finite()).then_some((point, colour))
}

/// A channel of a colour, from 0 to 255, from a number from 0 to 1.
pub(super) fn channel(number: f64) -> u8 {
    (number * 255.0).round() as u8
}
