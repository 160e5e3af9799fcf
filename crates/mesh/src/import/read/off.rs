//! OFF: numbered vertices and polygons over them as text, either of them coloured.

use super::corners::{Corners, MAX_CORNERS, WHITE};
use super::model_file::ModelFile;
use super::vertices::{Coordinates, VertexBounds, Vertices, VerticesBuilder};
use super::{MeshFace, Model, ModelInfo};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;
use spinney_records::text::{Lines, line_number, real, shown, whole, words};

struct Off {
    source: ModelFile,
    info: ModelInfo,
    header: OffHeader,
    vertices: Vertices,
    /// Offset of the first face.
    start: usize,
    degenerate: u64,
}

#[derive(Clone, Copy)]
struct OffHeader {
    has_normals: bool,
    has_colours: bool,
    vertices: u64,
    faces: u64,
    /// Offset of the first vertex.
    body: usize,
}

/// Prefix before `OFF` in the first word of a file, and the digits that follow without a blank.
pub(super) fn keyword(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let line = content(&mut Lines::new(&bytes[..bytes.len().min(4096)], 0))?;
    let word = words(line).next()?;
    let at = word.windows(3).position(|bytes| bytes == b"OFF")?;
    let (before, behind) = (&word[..at], &word[at + 3..]);
    let is_known =
        before.iter().all(|byte| b"STCN4n".contains(byte)) && behind.iter().all(u8::is_ascii_digit);
    is_known.then_some((before, behind))
}

/// The next line that has more than a comment, without the comment.
fn content<'a>(lines: &mut Lines<'a>) -> Option<&'a [u8]> {
    lines
        .map(|line| line.split(|byte| *byte == b'#').next().unwrap_or_default().trim_ascii())
        .find(|line| !line.is_empty())
}

impl OffHeader {
    fn read(source: &ModelFile) -> Result<OffHeader> {
        let mut lines = Lines::new(source.bytes(), 0);
        let mut line = content(&mut lines).unwrap_or_default();
        let mut prefix: &[u8] = b"";
        if let Some((before, _)) = keyword(source.bytes()) {
            prefix = before;
            line = line[before.len() + 3..].trim_ascii();
            if line.is_empty() {
                line = content(&mut lines).unwrap_or_default();
            }
        }
        if !matches!(prefix, b"" | b"C" | b"N" | b"CN") || line.starts_with(b"BINARY") {
            let found = format!("OFF of the kind {}", shown(if prefix.is_empty() { line } else { prefix }));
            return Err(Error::unsupported(source.path(), found, "write it as plain OFF or COFF, as text"));
        }
        let mut counts = words(line).map(|word| whole(word).and_then(|count| u64::try_from(count).ok()));
        let (Some(Some(vertices)), Some(Some(faces))) = (counts.next(), counts.next()) else {
            let place =
                format!("OFF header, line {}", line_number(source.bytes(), lines.offset.saturating_sub(1)));
            return Err(source.corrupt(place, shown(line), "the numbers of vertices and faces"));
        };
        let (has_colours, has_normals) = (prefix.contains(&b'C'), prefix.contains(&b'N'));
        let header = OffHeader { has_normals, has_colours, vertices, faces, body: lines.offset };
        // "0 0 0\n" for a vertex, "0\n" for a face; the last line need not be ended.
        let (there, needed) =
            (source.bytes().len() - header.body, u128::from(vertices) * 6 + u128::from(faces) * 2);
        if needed > there as u128 + 1 {
            let (found, expected) = (format!("{there} bytes"), format!("at least {needed}"));
            return Err(source.corrupt("OFF, behind the header", found, expected));
        }
        Ok(header)
    }
}

/// The next vertex or face of a file. Reading the next line again after an error tells its number.
fn next<'a>(source: &ModelFile, lines: &mut Lines<'a>, what: &str, number: u64) -> Result<&'a [u8]> {
    content(lines)
        .ok_or_else(|| source.corrupt(format!("{what} {number}"), "the end of the file", "more lines"))
}

fn wrong(source: &ModelFile, lines: &Lines<'_>, what: &str, line: &[u8], expected: &str) -> Error {
    let place = format!("{what}, line {}", line_number(source.bytes(), lines.offset.saturating_sub(1)));
    source.corrupt(place, shown(line), expected)
}

/// A colour of three numbers, from 0 to 255 if they are whole, else from 0 to 1; opacity behind it does not
/// count.
fn colour(words: &[&[u8]]) -> Option<[u8; 3]> {
    let words = words.first_chunk::<3>()?;
    let is_whole = words.iter().all(|word| whole(word).is_some());
    let channel = |word| Some((real(word)? * if is_whole { 1.0 } else { 255.0 }).round() as u8);
    Some([channel(words[0])?, channel(words[1])?, channel(words[2])?])
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let header = OffHeader::read(&source)?;
    let mut lines = Lines::new(source.bytes(), header.body);
    let mut bounds = VertexBounds::new();
    let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, header.has_colours, memory);
    for number in 0..header.vertices {
        source.passed(number);
        let line = next(&source, &mut lines, "vertex", number)?;
        let wrong = |expected| wrong(&source, &lines, &format!("vertex {number}"), line, expected);
        let mut words = words(line);
        let mut coordinate = || words.next().and_then(real).ok_or_else(|| wrong("three finite numbers"));
        let point = [coordinate()?, coordinate()?, coordinate()?];
        let mut shade = WHITE;
        if header.has_colours {
            let rest: Vec<&[u8]> = words.skip(if header.has_normals { 3 } else { 0 }).take(4).collect();
            shade = colour(&rest).ok_or_else(|| wrong("coordinates and a colour"))?;
        }
        bounds.add(point);
        vertices.push(point, shade)?;
    }
    let (vertices, start) = (vertices.finish()?, lines.offset);
    let bounds = bounds.get().ok_or_else(|| source.no_vertices())?;
    let mut is_coloured = header.has_colours;
    for number in 0..header.faces {
        if is_coloured {
            break;
        }
        is_coloured =
            Words::of(next(&source, &mut lines, "face", number)?).is_some_and(|face| face.colour.is_some());
    }
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: if header.has_colours { "COFF" } else { "OFF" }.into(),
        faces: Some(header.faces),
        bounds,
        crs: None,
        unit: None,
        step: None,
        parts: vec!["mesh".into()],
        is_grouped: false,
        attributes: Attributes::default(),
        is_coloured,
        bytes: source.bytes().len() as u64,
    };
    Ok(Box::new(Off { source, info, header, vertices, start, degenerate: 0 }))
}

/// A face's line.
struct Words<'a> {
    corners: spinney_records::text::Words<'a>,
    count: usize,
    colour: Option<[u8; 3]>,
}

impl<'a> Words<'a> {
    /// Parses a line; `None` if it does not begin with a number of corners within bounds.
    fn of(line: &'a [u8]) -> Option<Words<'a>> {
        let mut corners = words(line);
        let count =
            usize::try_from(corners.next().and_then(whole)?).ok().filter(|count| *count <= MAX_CORNERS)?;
        let rest: Vec<&[u8]> = corners.clone().skip(count).take(4).collect();
        Some(Words { corners, count, colour: colour(&rest) })
    }
}

impl Model for Off {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let (source, table) = (&self.source, self.vertices.table());
        let mut lines = Lines::new(source.bytes(), self.start);
        let mut corners = Corners::default();
        for number in 0..self.header.faces {
            source.passed(number);
            let line = next(source, &mut lines, "face", number)?;
            let wrong = |expected: &str| wrong(source, &lines, &format!("face {number}"), line, expected);
            let face = Words::of(line).ok_or_else(|| wrong("a number of corners from 0 to 2^20"))?;
            corners.clear();
            let mut indices = face.corners;
            for _ in 0..face.count {
                let index = indices.next().and_then(whole).and_then(|index| u64::try_from(index).ok());
                let Some(index) = index.filter(|index| *index < table.len()) else {
                    return Err(wrong(&format!("{} vertices below {}", face.count, table.len())));
                };
                corners.push(table.position(index));
                if let Some(colour) = table.colour(index) {
                    corners.push_colour(colour);
                }
            }
            if self.info.is_coloured && !self.header.has_colours {
                corners.paint(face.colour.unwrap_or(WHITE));
            }
            corners.hand_out(0, each)?;
        }
        self.degenerate = corners.degenerate;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }
}
