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
    range: ColourRange,
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
    /// Offset behind the counts.
    body: usize,
    /// Whether line breaks mean nothing: several vertices or faces are in one line.
    is_free: bool,
}

/// Prefix before `OFF` in the first word of a file, in upper case, and the digits that follow without a blank.
fn parse_keyword(word: &[u8]) -> Option<(Vec<u8>, &[u8])> {
    let at = word.windows(3).position(|bytes| bytes.eq_ignore_ascii_case(b"OFF"))?;
    let (before, behind) = (&word[..at], &word[at + 3..]);
    // (In headers of upper case letters, a small n says that there are dimensions.)
    let is_lower = &word[at..at + 3] == b"off";
    let before = if is_lower { before.to_ascii_uppercase() } else { before.to_vec() };
    let is_known =
        before.iter().all(|byte| b"STCN4n".contains(byte)) && behind.iter().all(u8::is_ascii_digit);
    is_known.then_some((before, behind))
}

/// Whether a file begins as OFF files do.
pub(super) fn has_keyword(bytes: &[u8]) -> bool {
    Items::new(&bytes[..bytes.len().min(4096)], 0).word().is_some_and(|word| parse_keyword(word).is_some())
}

/// Words of a file without comments, vertex by vertex and face by face.
#[derive(Clone)]
struct Items<'a> {
    bytes: &'a [u8],
    /// Offset behind the last word.
    at: usize,
    /// Offset of the first word of the vertex or face.
    start: usize,
    /// Whether it began in an earlier line than that of the last word.
    has_crossed: bool,
    is_free: bool,
}

impl<'a> Items<'a> {
    fn new(bytes: &'a [u8], at: usize) -> Items<'a> {
        Items { bytes, at, start: at, has_crossed: false, is_free: false }
    }

    /// Goes to the next word.
    fn skip_blanks(&mut self) {
        while let Some(byte) = self.bytes.get(self.at) {
            match byte {
                b'#' => self.skip_line(),
                b'\n' | b'\r' => {
                    self.has_crossed = true;
                    self.at += 1;
                }
                b' ' | b'\t' | 0x0b | 0x0c => self.at += 1,
                _ => break,
            }
        }
    }

    /// Goes to the end of the line.
    fn skip_line(&mut self) {
        let rest = &self.bytes[self.at..];
        self.at += rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
    }

    fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let is_end = |byte: &u8| matches!(byte, b'#' | b'\n' | b'\r' | b' ' | b'\t' | 0x0b | 0x0c);
        let length = rest.iter().position(is_end).unwrap_or(rest.len());
        self.at += length;
        (length > 0).then_some(&rest[..length])
    }

    /// Begins with the next vertex or face, in a line of its own unless line breaks mean nothing.
    fn begin(&mut self) {
        if !self.is_free {
            self.skip_line();
        }
        self.skip_blanks();
        (self.start, self.has_crossed) = (self.at, false);
    }

    /// The words that are left in the line, which colours are; none where line breaks mean nothing.
    fn rest(&self) -> Vec<&'a [u8]> {
        let mut line = self.clone();
        line.skip_line();
        match self.is_free {
            true => Vec::new(),
            false => {
                words(&self.bytes[self.at..line.at]).take_while(|word| word[0] != b'#').take(4).collect()
            }
        }
    }

    fn number(&mut self) -> Option<f64> {
        self.word().and_then(real)
    }

    fn count(&mut self) -> Option<u64> {
        self.word().and_then(whole).and_then(|count| u64::try_from(count).ok())
    }

    /// Whether what takes more than one line takes these as a whole.
    fn is_complete(&self) -> bool {
        self.is_free || !self.has_crossed || self.rest().is_empty()
    }

    fn is_at_end(&self) -> bool {
        self.start >= self.bytes.len()
    }
}

impl OffHeader {
    fn read(source: &ModelFile) -> Result<OffHeader> {
        let bytes = source.bytes();
        let mut items = Items::new(bytes, 0);
        items.begin();
        let (mut prefix, first) = (Vec::new(), items.clone());
        match items.word().and_then(parse_keyword) {
            Some((before, behind)) => {
                prefix = before;
                items.at -= behind.len();
            }
            None => items = first,
        }
        let is_binary = items.clone().word() == Some(b"BINARY");
        if !matches!(&prefix[..], b"" | b"C" | b"N" | b"CN") || is_binary {
            let kind = if prefix.is_empty() { &b"BINARY"[..] } else { &prefix[..] };
            let found = format!("OFF of the kind {}", shown(kind));
            return Err(Error::unsupported(source.path(), found, "write it as plain OFF or COFF, as text"));
        }
        items.skip_blanks();
        (items.start, items.has_crossed) = (items.at, false);
        let (vertices, faces) = (items.count(), items.count());
        let is_split = items.has_crossed;
        let (Some(vertices), Some(faces)) = (vertices, faces) else {
            return Err(wrong(source, &items, "OFF header", "the numbers of vertices and faces"));
        };
        // The number of edges, which need not be there, nor be right: in a line of its own if the others are.
        let mut behind = items.clone();
        let is_number = behind.count().is_some();
        if is_number && (!items.rest().is_empty() || is_split && behind.rest().is_empty()) {
            items = behind;
        }
        let (has_colours, has_normals) = (prefix.contains(&b'C'), prefix.contains(&b'N'));
        let mut header =
            OffHeader { has_normals, has_colours, vertices, faces, body: items.at, is_free: false };
        // "0 0 0\n" for a vertex, "0\n" for a face; the last line need not be ended.
        let (there, needed) = (bytes.len() - header.body, u128::from(vertices) * 6 + u128::from(faces) * 2);
        if needed > there as u128 + 2 {
            let (found, expected) = (format!("{there} bytes"), format!("at least {needed}"));
            return Err(source.corrupt("OFF, behind the header", found, expected));
        }
        header.is_free = !items.rest().is_empty() || header.has_long_lines(bytes);
        Ok(header)
    }

    /// Numbers of a vertex, without those of its colour.
    fn numbers(&self) -> usize {
        if self.has_normals { 6 } else { 3 }
    }

    /// Whether the first line has several vertices, and there are fewer lines than vertices and faces.
    fn has_long_lines(&self, bytes: &[u8]) -> bool {
        let mut items = Items::new(bytes, self.body);
        items.begin();
        let first = Lines::new(bytes, items.at).next().map_or(0, |line| words(line).take(20).count());
        let mut lines = Lines::new(bytes, items.at);
        first > self.numbers() + 4 && first >= 2 * self.numbers() && {
            let count = (0..self.vertices + self.faces).take_while(|_| content(&mut lines).is_some()).count();
            (count as u64) < self.vertices + self.faces
        }
    }

    fn items<'a>(&self, bytes: &'a [u8], at: usize) -> Items<'a> {
        Items { is_free: self.is_free, ..Items::new(bytes, at) }
    }
}

/// The next line that has more than a comment, without the comment.
fn content<'a>(lines: &mut Lines<'a>) -> Option<&'a [u8]> {
    lines
        .map(|line| line.split(|byte| *byte == b'#').next().unwrap_or_default().trim_ascii())
        .find(|line| !line.is_empty())
}

/// The error for a vertex or face that is not as it should be.
fn wrong(source: &ModelFile, items: &Items<'_>, what: &str, expected: &str) -> Error {
    if items.is_at_end() {
        return source.corrupt(what, "the end of the file", "more lines");
    }
    let line = Lines::new(items.bytes, items.start).next().unwrap_or_default();
    let place = format!("{what}, line {}", line_number(items.bytes, items.start));
    source.corrupt(place, shown(line), expected)
}

/// The range of the numbers of all colours of a file: from 0 to 1 if none is greater, else from 0 to 255.
#[derive(Clone, Copy, Default)]
struct ColourRange {
    is_beyond_1: bool,
    has_fractions: bool,
}

impl ColourRange {
    fn add(&mut self, words: &[&[u8]]) {
        let Some(channels) = words.first_chunk::<3>() else { return };
        self.is_beyond_1 |= channels.iter().any(|word| real(word).is_some_and(|number| number > 1.0));
        self.has_fractions |= channels.iter().any(|word| whole(word).is_none());
        // (Opacity has the range of the others: 255 after three numbers up to 1 speaks of bytes.)
        if let Some(opacity) = words.get(3).and_then(|word| whole(word)) {
            self.is_beyond_1 |= opacity > 1 && !self.has_fractions;
        }
    }

    /// A colour of three numbers; opacity behind it does not count.
    fn colour(self, words: &[&[u8]]) -> Option<[u8; 3]> {
        let words = words.first_chunk::<3>()?;
        let channel = |word| Some((real(word)? * if self.is_beyond_1 { 1.0 } else { 255.0 }).round() as u8);
        Some([channel(words[0])?, channel(words[1])?, channel(words[2])?])
    }
}

/// The next vertex: its coordinates, and the words of its colour.
fn vertex<'a>(
    items: &mut Items<'a>,
    header: &OffHeader,
) -> std::result::Result<([f64; 3], Vec<&'a [u8]>), &'static str> {
    items.begin();
    let expected = "three finite numbers";
    let mut point = [0.0; 3];
    for coordinate in &mut point {
        *coordinate = items.number().ok_or(expected)?;
    }
    let mut colour = Vec::new();
    if header.has_normals && header.has_colours {
        (0..3).try_for_each(|_| items.word().map(drop)).ok_or("coordinates, a normal and a colour")?;
    }
    if header.has_colours {
        colour = match items.is_free {
            true => (0..4).map_while(|_| items.word()).collect(),
            false => items.rest(),
        };
    } else if header.has_normals && items.is_free {
        (0..3).try_for_each(|_| items.word().map(drop)).ok_or("coordinates and a normal")?;
    }
    if !header.has_colours && !items.is_complete() {
        return Err(expected);
    }
    Ok((point, colour))
}

/// The next face: its corners, and the words of its colour.
fn face<'a>(
    items: &mut Items<'a>,
    vertices: u64,
    corners: &mut Vec<u64>,
) -> std::result::Result<Vec<&'a [u8]>, String> {
    items.begin();
    corners.clear();
    let count = items.count().filter(|count| *count <= MAX_CORNERS as u64);
    let count = count.ok_or("a number of corners from 0 to 2^20")?;
    let expected = || format!("{count} vertices below {vertices}");
    for _ in 0..count {
        corners.push(items.count().filter(|index| *index < vertices).ok_or_else(expected)?);
    }
    if !items.is_complete() {
        return Err(expected());
    }
    Ok(items.rest())
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let header = OffHeader::read(&source)?;
    let mut items = header.items(source.bytes(), header.body);
    let mut range = ColourRange::default();
    if header.has_colours {
        let mut all = items.clone();
        (0..header.vertices)
            .map_while(|_| vertex(&mut all, &header).ok())
            .for_each(|(_, words)| range.add(&words));
    }
    let mut bounds = VertexBounds::new();
    let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, header.has_colours, memory);
    for number in 0..header.vertices {
        source.passed(number);
        let found = vertex(&mut items, &header);
        let wrong = |expected| wrong(&source, &items, &format!("vertex {number}"), expected);
        let (point, words) = found.map_err(wrong)?;
        let mut shade = WHITE;
        if header.has_colours {
            shade = range.colour(&words).ok_or_else(|| wrong("coordinates and a colour"))?;
        }
        bounds.add(point);
        vertices.push(point, shade)?;
    }
    let (vertices, start) = (vertices.finish()?, items.at);
    let bounds = bounds.get().ok_or_else(|| source.no_vertices())?;
    let mut is_coloured = header.has_colours;
    if !header.has_colours {
        let mut corners = Vec::new();
        for number in 0..header.faces {
            // (Whatever is wrong with a face is reported when it is read.)
            let Ok(words) = face(&mut items, header.vertices, &mut corners) else {
                if items.is_at_end() {
                    return Err(wrong(&source, &items, &format!("face {number}"), "more faces"));
                }
                break;
            };
            source.passed(number);
            range.add(&words);
            is_coloured |= range.colour(&words).is_some();
        }
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
    Ok(Box::new(Off { source, info, header, vertices, range, start, degenerate: 0 }))
}

impl Model for Off {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let (source, table) = (&self.source, self.vertices.table());
        let mut items = self.header.items(source.bytes(), self.start);
        let (mut corners, mut indices) = (Corners::default(), Vec::new());
        for number in 0..self.header.faces {
            source.passed(number);
            let words = face(&mut items, table.len(), &mut indices)
                .map_err(|expected| wrong(source, &items, &format!("face {number}"), &expected))?;
            corners.clear();
            for index in &indices {
                corners.push(table.position(*index));
                if let Some(colour) = table.colour(*index) {
                    corners.push_colour(colour);
                }
            }
            if self.info.is_coloured && !self.header.has_colours {
                corners.paint(self.range.colour(&words).unwrap_or(WHITE));
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
