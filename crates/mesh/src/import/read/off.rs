//! OFF: indexed vertices and polygons as text, either of them coloured.

use super::colour_range::ColourRange;
use super::corners::{Corners, MAX_CORNERS, WHITE};
use super::model_file::ModelFile;
use super::vertices::{Coordinates, VertexBounds, Vertices, VerticesBuilder};
use super::{MeshFace, Model, ModelInfo};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;
use spinney_records::text::{Lines, line_number, real, shown, whole};

struct Off {
    source: ModelFile,
    info: ModelInfo,
    header: OffHeader,
    vertices: Vertices,
    range: ColourRange,
    /// Offset after the last vertex.
    start: usize,
    degenerate: u64,
}

#[derive(Clone, Copy)]
struct OffHeader {
    has_normals: bool,
    has_colours: bool,
    vertices: u64,
    faces: u64,
    /// Offset after the counts.
    body: usize,
    breaks: LineBreaks,
}

/// Meaning of line breaks among vertices and faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LineBreaks {
    /// Each vertex and face is a line, which may have extra words.
    EndRecords,
    /// Each starts on a new line and may continue on the following lines.
    BeginRecords,
    /// Line breaks have no meaning: the file has only the required words. Holds the count of
    /// numbers per vertex.
    Blanks(usize),
}

/// Prefix of `OFF` in the first word of a file, in upper case, and the digits that follow
/// immediately.
fn parse_keyword(word: &[u8]) -> Option<(Vec<u8>, &[u8])> {
    let at = word.windows(3).position(|bytes| bytes.eq_ignore_ascii_case(b"OFF"))?;
    let (before, after) = (&word[..at], &word[at + 3..]);
    // (After upper-case `OFF` only, a lower-case n means a number of dimensions.)
    let is_upper = &word[at..at + 3] == b"OFF";
    let before = if is_upper { before.to_vec() } else { before.to_ascii_uppercase() };
    let is_known = before.iter().all(|byte| b"STCN4n".contains(byte)) && after.iter().all(u8::is_ascii_digit);
    is_known.then_some((before, after))
}

/// Whether a file starts like OFF.
pub(super) fn has_keyword(bytes: &[u8]) -> bool {
    let mut start = Records::new(&bytes[..bytes.len().min(4096)], 0, LineBreaks::Blanks(0));
    start.word().is_some_and(|word| parse_keyword(word).is_some())
}

fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | 0x0b | 0x0c)
}

/// Words of a file without comments, record by record: the counts, a vertex or a face.
#[derive(Clone)]
struct Records<'a> {
    bytes: &'a [u8],
    /// Offset after the last word.
    at: usize,
    /// Offset of the first word of the record.
    start: usize,
    breaks: LineBreaks,
}

impl<'a> Records<'a> {
    fn new(bytes: &'a [u8], at: usize, breaks: LineBreaks) -> Records<'a> {
        Records { bytes, at, start: at, breaks }
    }

    /// Advances to the end of the line.
    fn skip_line(&mut self) {
        let rest = &self.bytes[self.at..];
        self.at += rest.iter().position(|byte| is_line_end(*byte)).unwrap_or(rest.len());
    }

    /// Advances to the next word, on the same line or on any line.
    fn skip_blanks(&mut self, crosses_lines: bool) {
        while let Some(byte) = self.bytes.get(self.at) {
            match byte {
                b'#' => self.skip_line(),
                byte if is_blank(*byte) || crosses_lines && is_line_end(*byte) => self.at += 1,
                _ => break,
            }
        }
    }

    /// Advances to the next record.
    fn begin(&mut self) {
        if !matches!(self.breaks, LineBreaks::Blanks(_)) {
            self.skip_line();
        }
        self.skip_blanks(true);
        self.start = self.at;
    }

    /// Next word of the record.
    fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_blanks(self.breaks != LineBreaks::EndRecords);
        let rest = &self.bytes[self.at..];
        let is_end = |byte: &u8| *byte == b'#' || is_blank(*byte) || is_line_end(*byte);
        let length = rest.iter().position(is_end).unwrap_or(rest.len());
        self.at += length;
        (length > 0).then_some(&rest[..length])
    }

    fn number(&mut self) -> Option<f64> {
        self.word().and_then(real)
    }

    fn count(&mut self) -> Option<u64> {
        self.word().and_then(whole).and_then(|count| u64::try_from(count).ok())
    }

    /// Up to four remaining words of the line; none if line breaks have no meaning.
    fn rest(&self) -> Vec<&'a [u8]> {
        if matches!(self.breaks, LineBreaks::Blanks(_)) {
            return Vec::new();
        }
        let mut line = Records { breaks: LineBreaks::EndRecords, ..*self };
        std::iter::from_fn(|| line.word()).take(4).collect()
    }

    /// Error for the record.
    fn wrong(&self, source: &ModelFile, what: &str, expected: &str) -> Error {
        if self.start >= self.bytes.len() {
            return source.corrupt(what, "the end of the file", "more lines");
        }
        let line = Lines::new(self.bytes, self.start).next().unwrap_or_default();
        let position = format!("{what}, line {}", line_number(self.bytes, self.start));
        source.corrupt(position, shown(line), expected)
    }
}

impl OffHeader {
    fn read(source: &ModelFile) -> Result<OffHeader> {
        let bytes = source.bytes();
        let mut records = Records::new(bytes, 0, LineBreaks::BeginRecords);
        let mut prefix = Vec::new();
        if let Some((before, after)) = records.clone().word().and_then(parse_keyword) {
            records.word();
            records.at -= after.len();
            prefix = before;
        }
        let is_binary = records.rest().first().is_some_and(|word| word.starts_with(b"BINARY"));
        if !matches!(&prefix[..], b"" | b"C" | b"N" | b"CN") || is_binary {
            let kind = if prefix.is_empty() { &b"BINARY"[..] } else { &prefix[..] };
            let found = format!("OFF of the kind {}", shown(kind));
            return Err(Error::unsupported(source.path(), found, "convert it to OFF or COFF in text form"));
        }
        records.skip_blanks(true);
        records.start = records.at;
        let (Some(vertices), Some(faces)) = (records.count(), records.count()) else {
            return Err(records.wrong(source, "OFF header", "the numbers of vertices and faces"));
        };
        // Number of edges, which may be wrong or missing. It is on the same line, or alone on the
        // next one.
        let mut edges = records.clone();
        if edges.count().is_some() && (!records.rest().is_empty() || edges.rest().is_empty()) {
            records = edges;
        }
        let mut header = OffHeader {
            has_normals: prefix.contains(&b'N'),
            has_colours: prefix.contains(&b'C'),
            vertices,
            faces,
            body: records.at,
            breaks: LineBreaks::EndRecords,
        };
        // Minimum bytes: "\n0 0 0" per vertex, "\n0" per face.
        let (there, needed) = (bytes.len() - header.body, u128::from(vertices) * 6 + u128::from(faces) * 2);
        if needed > there as u128 {
            let (found, expected) = (format!("{there} bytes"), format!("at least {needed}"));
            return Err(source.corrupt("OFF, after the header", found, expected));
        }
        header.breaks = header.find_breaks(source);
        Ok(header)
    }

    /// Determines the meaning of line breaks: as most programs write it if there are as many lines
    /// as vertices and faces.
    fn find_breaks(&self, source: &ModelFile) -> LineBreaks {
        let (records, mut lines) = (self.vertices + self.faces, 0);
        let mut all = Records::new(source.bytes(), self.body, LineBreaks::EndRecords);
        loop {
            source.passed(lines);
            all.begin();
            if all.start >= all.bytes.len() {
                break;
            }
            lines += 1;
        }
        if lines == records {
            return LineBreaks::EndRecords;
        }
        // (Colours have four numbers, or three without opacity.)
        let sizes = if self.has_colours { &[4, 3][..] } else { &[0] };
        let numbers = if self.has_normals { 6 } else { 3 };
        let blanks = sizes.iter().map(|colour| LineBreaks::Blanks(numbers + colour));
        let other = if lines < records { LineBreaks::EndRecords } else { LineBreaks::BeginRecords };
        blanks.into_iter().find(|breaks| self.fits(source, *breaks)).unwrap_or(other)
    }

    /// Whether vertices and faces take exactly all words of the file, regardless of lines.
    fn fits(&self, source: &ModelFile, breaks: LineBreaks) -> bool {
        let LineBreaks::Blanks(size) = breaks else { return false };
        let mut words = Records::new(source.bytes(), self.body, breaks);
        let mut skip = |count: u64| (0..count).all(|_| words.word().is_some());
        for number in 0..self.vertices {
            source.passed(number);
            if !skip(size as u64) {
                return false;
            }
        }
        for number in 0..self.faces {
            source.passed(number);
            let corners = words.count().filter(|count| *count <= MAX_CORNERS as u64);
            if !corners.is_some_and(|corners| (0..corners).all(|_| words.word().is_some())) {
                return false;
            }
        }
        words.word().is_none()
    }

    /// Advances to the next vertex: its coordinates and the words of its colour. The error is a
    /// description of what is expected.
    fn vertex<'a>(
        &self,
        records: &mut Records<'a>,
    ) -> std::result::Result<([f64; 3], Vec<&'a [u8]>), &'static str> {
        records.begin();
        let mut point = [0.0; 3];
        for coordinate in &mut point {
            *coordinate = records.number().ok_or("three finite numbers")?;
        }
        // (Without colours, the rest of the line is ignored.)
        let more = match (records.breaks, self.has_colours) {
            (LineBreaks::Blanks(size), _) => size - 3,
            (_, true) => 3 + if self.has_normals { 3 } else { 0 },
            (_, false) => 0,
        };
        let expected = "coordinates, a normal in NOFF, and a colour in COFF";
        let mut words = Vec::new();
        for _ in 0..more {
            words.push(records.word().ok_or(expected)?);
        }
        if self.has_colours {
            words.extend(records.rest().first().filter(|word| real(word).is_some()));
            words.drain(..if self.has_normals { 3 } else { 0 });
        }
        Ok((point, words))
    }
}

/// Advances to the next face: its vertex indices, and the words after them, such as a colour. The
/// error is a description of what is expected.
fn face<'a>(
    records: &mut Records<'a>,
    vertices: u64,
    indices: &mut Vec<u64>,
) -> std::result::Result<Vec<&'a [u8]>, String> {
    records.begin();
    indices.clear();
    let count = records.count().filter(|count| *count <= MAX_CORNERS as u64);
    let count = count.ok_or("a number of corners from 0 to 2^20")?;
    for _ in 0..count {
        let index = records.count().filter(|index| *index < vertices);
        indices.push(index.ok_or_else(|| format!("{count} vertex indices below {vertices}"))?);
    }
    Ok(records.rest())
}

/// Values of a colour, without opacity.
fn numbers(words: &[&[u8]]) -> Option<[f64; 3]> {
    let [r, g, b] = words.first_chunk::<3>()?;
    Some([real(r)?, real(g)?, real(b)?])
}

/// Takes a colour into account for the file's colour range. (Opacity has the same range: after
/// three integers up to 1, an opacity of 255 means bytes.)
fn add_colour(range: &mut ColourRange, words: &[&[u8]]) {
    let Some(channels) = numbers(words) else { return };
    channels.iter().for_each(|number| range.add(*number));
    if words[..3].iter().all(|word| whole(word).is_some()) {
        words.get(3).and_then(|word| real(word)).into_iter().for_each(|opacity| range.add(opacity));
    }
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let header = OffHeader::read(&source)?;
    let mut records = Records::new(source.bytes(), header.body, header.breaks);
    let mut range = ColourRange::default();
    if header.has_colours {
        let mut all = records.clone();
        for number in 0..header.vertices {
            source.passed(number);
            // (Invalid vertices are reported when they are read.)
            let Ok((_, words)) = header.vertex(&mut all) else { break };
            add_colour(&mut range, &words);
        }
    }
    let mut bounds = VertexBounds::new();
    let mut vertices = VerticesBuilder::new(source.path(), Coordinates::F64, header.has_colours, memory);
    for number in 0..header.vertices {
        source.passed(number);
        let found = header.vertex(&mut records);
        let wrong = |expected| records.wrong(&source, &format!("vertex {number}"), expected);
        let (point, words) = found.map_err(wrong)?;
        let shade = match header.has_colours {
            true => numbers(&words).ok_or_else(|| wrong("coordinates and a colour"))?,
            false => [0.0; 3],
        };
        bounds.add(point);
        vertices.push(point, range.colour(shade))?;
    }
    let (vertices, start) = (vertices.finish()?, records.at);
    let bounds = bounds.get().ok_or_else(|| source.no_vertices())?;
    let mut is_coloured = header.has_colours;
    if !header.has_colours {
        let mut indices = Vec::new();
        for number in 0..header.faces {
            source.passed(number);
            let words = face(&mut records, header.vertices, &mut indices)
                .map_err(|expected| records.wrong(&source, &format!("face {number}"), &expected))?;
            add_colour(&mut range, &words);
            is_coloured |= numbers(&words).is_some();
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
        is_z_up: false,
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
        let mut records = Records::new(source.bytes(), self.start, self.header.breaks);
        let (mut corners, mut indices) = (Corners::default(), Vec::new());
        for number in 0..self.header.faces {
            source.passed(number);
            let words = face(&mut records, table.len(), &mut indices)
                .map_err(|expected| records.wrong(source, &format!("face {number}"), &expected))?;
            corners.clear();
            for index in &indices {
                corners.push(table.position(*index));
                if let Some(colour) = table.colour(*index) {
                    corners.push_colour(colour);
                }
            }
            if self.info.is_coloured && !self.header.has_colours {
                corners.paint(numbers(&words).map_or(WHITE, |numbers| self.range.colour(numbers)));
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
