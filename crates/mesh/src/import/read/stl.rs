//! STL: independent facets, as text or binary.

use super::corners::Corners;
use super::model_file::ModelFile;
use super::parts::PartNames;
use super::vertices::VertexBounds;
use super::{MeshFace, Model, ModelInfo};
use spinney_base::Result;
use spinney_brep::Attributes;
use spinney_records::text::{Lines, Words, line_number, real, shown};

/// Bytes before the first facet of a binary file: arbitrary text and the number of facets.
const HEADER: usize = 84;

/// Bytes of a facet: normal, three vertices, and two attribute bytes that some programs use for
/// colours.
const FACET: usize = 50;

/// Callback for each facet: its vertices and part.
type Each<'a> = &'a mut dyn FnMut([[f64; 3]; 3], u32) -> Result<()>;

struct Stl {
    source: ModelFile,
    info: ModelInfo,
    is_text: bool,
    parts: PartNames,
    degenerate: u64,
}

/// Bytes in which the first facet of a text file is searched for: names of solids may be long.
const SEARCHED: usize = 1 << 20;

/// Whether a file has exactly the length of a binary file with its number of facets, or of several
/// concatenated ones.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    let (solids, end) = binary_solids(bytes);
    solids.first().is_some_and(|(_, count)| *count > 0) && end == bytes.len()
}

/// Whether a file starts like a text file: with `solid`, and a facet or an end before any zero
/// byte.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(SEARCHED)];
    let mut tokens = Tokens::new(start);
    tokens.next().is_some_and(|word| is_any(word, &["solid"]))
        && tokens
            .find(|word| word.contains(&0) || is_any(word, &["facet", "endsolid", "end"]))
            .is_some_and(|word| !word.contains(&0))
}

fn is_any(word: &[u8], keywords: &[&str]) -> bool {
    keywords.iter().any(|keyword| word.eq_ignore_ascii_case(keyword.as_bytes()))
}

/// Number of facets that a binary file's header declares.
fn announced(bytes: &[u8]) -> Option<u32> {
    bytes.get(80..HEADER)?.first_chunk().map(|count| u32::from_le_bytes(*count))
}

fn length(facets: u32) -> u64 {
    HEADER as u64 + u64::from(facets) * FACET as u64
}

/// Solids of a binary file, each by its offset and number of facets, and the end of the last one.
/// Concatenated files are used only if they end exactly with the file; otherwise only the first
/// solid.
fn binary_solids(bytes: &[u8]) -> (Vec<(usize, u32)>, usize) {
    let (mut solids, mut at) = (Vec::new(), 0);
    while let Some(count) = announced(&bytes[at..]).filter(|count| *count > 0 || at == 0)
        && length(count) <= (bytes.len() - at) as u64
    {
        solids.push((at, count));
        at += length(count) as usize;
    }
    if at != bytes.len() && solids.len() > 1 {
        solids.truncate(1);
        at = length(solids[0].1) as usize;
    }
    (solids, at)
}

/// Words of a text file without comments and colours.
struct Tokens<'a> {
    bytes: &'a [u8],
    words: Words<'a>,
}

impl<'a> Tokens<'a> {
    fn new(bytes: &'a [u8]) -> Tokens<'a> {
        Tokens { bytes, words: Words::new(bytes, 0) }
    }

    /// Consumes and returns the rest of the line.
    fn line_end(&mut self) -> &'a [u8] {
        let rest = &self.bytes[self.words.offset..];
        let length = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
        self.words.offset += length;
        &rest[..length]
    }

    /// Skips numbers.
    fn skip_numbers(&mut self) {
        let mut ahead = self.words.clone();
        while ahead.next().is_some_and(|word| real(word).is_some()) {
            self.words = ahead.clone();
        }
    }

    /// Rest of the line after `solid`, or up to a facet or `endsolid` on the same line.
    fn name(&mut self) -> &'a [u8] {
        let (start, mut ahead) = (self.words.offset, self.words.clone());
        while let Some((at, word)) = self.next_in_line(&mut ahead) {
            let is_facet = is_any(word, &["facet"])
                && ahead.clone().next().is_some_and(|next| is_any(next, &["normal"]));
            if is_facet || is_any(word, &["endsolid"]) {
                self.words.offset = at;
                return self.bytes[start..at].trim_ascii();
            }
        }
        self.line_end().trim_ascii()
    }

    /// Skips the name after `endsolid`: the rest of the line, or up to `solid` if facets follow on
    /// the same line.
    fn end_name(&mut self) {
        let (mut ahead, mut solid) = (self.words.clone(), None);
        while let Some((at, word)) = self.next_in_line(&mut ahead) {
            match solid {
                None if is_any(word, &["solid"]) => solid = Some(at),
                Some(solid) if is_any(word, &["facet", "endsolid"]) => {
                    self.words.offset = solid;
                    return;
                }
                _ => {}
            }
        }
        self.line_end();
    }

    /// Next word on the same line, and its offset.
    fn next_in_line(&self, ahead: &mut Words<'a>) -> Option<(usize, &'a [u8])> {
        let before = ahead.offset;
        let word = ahead.next()?;
        let at = ahead.offset - word.len();
        let has_ended = self.bytes[before..at].iter().any(|byte| matches!(byte, b'\n' | b'\r'));
        (!has_ended).then_some((at, word))
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        loop {
            let word = self.words.next()?;
            let is_comment = matches!(word.first(), Some(b'#' | b';' | b'!'))
                || word.starts_with(b"//")
                || is_any(word, &["comment"]);
            if is_comment {
                self.line_end();
            } else if is_any(word, &["color", "colour"]) {
                self.skip_numbers();
            } else {
                return Some(word);
            }
        }
    }
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let is_text = !is_binary(source.bytes()) && is_text(source.bytes());
    let (mut bounds, mut faces) = (VertexBounds::new(), 0);
    let mut parts = PartNames::new(memory);
    read(&source, is_text, &mut parts, &mut |corners, _| {
        corners.iter().for_each(|corner| bounds.add(*corner));
        faces += 1;
        Ok(())
    })?;
    let bounds = bounds.get().ok_or_else(|| source.no_vertices())?;
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: if is_text { "STL, text" } else { "STL, binary" }.into(),
        faces: Some(faces),
        bounds,
        crs: None,
        unit: None,
        step: None,
        parts: parts.names(),
        is_grouped: false,
        is_z_up: false,
        attributes: Attributes::default(),
        is_coloured: false,
        bytes: source.bytes().len() as u64,
    };
    Ok(Box::new(Stl { source, info, is_text, parts, degenerate: 0 }))
}

fn read(source: &ModelFile, is_text: bool, parts: &mut PartNames, each: Each<'_>) -> Result<()> {
    if is_text { read_text(source, parts, each) } else { read_binary(source, parts, each) }
}

fn read_binary(source: &ModelFile, parts: &mut PartNames, each: Each<'_>) -> Result<()> {
    let bytes = source.bytes();
    let Some(count) = announced(bytes) else {
        return Err(source.corrupt("STL header", format!("{} bytes", bytes.len()), "84 bytes, or `solid`"));
    };
    let (solids, _) = binary_solids(bytes);
    if solids.is_empty() {
        let expected = format!("{} for {count} facets", length(count));
        return Err(source.corrupt("STL file", format!("{} bytes", bytes.len()), expected));
    }
    let mut number = 0;
    for (solid, (start, count)) in solids.iter().enumerate() {
        let part = match solids.len() {
            1 => 0,
            _ => parts.number(source, format!("solid {}", solid + 1).as_bytes())?,
        };
        let facets = bytes[start + HEADER..].chunks_exact(FACET).take(*count as usize);
        for (own, facet) in facets.enumerate() {
            source.passed(number);
            number += 1;
            let mut corners = [[0f64; 3]; 3];
            for (coordinate, bytes) in
                corners.as_flattened_mut().iter_mut().zip(facet[12..].as_chunks::<4>().0)
            {
                *coordinate = f32::from_le_bytes(*bytes).into();
            }
            if !corners.as_flattened().iter().all(|coordinate| coordinate.is_finite()) {
                let place = format!("facet {own}, byte {}", start + HEADER + own * FACET);
                return Err(source.corrupt(place, format!("{corners:?}"), "finite coordinates"));
            }
            each(corners, part)?;
        }
    }
    Ok(())
}

fn read_text(source: &ModelFile, parts: &mut PartNames, each: Each<'_>) -> Result<()> {
    let bytes = source.bytes();
    let mut part = None;
    let mut is_in_facet = false;
    let mut corners: Vec<[f64; 3]> = Vec::new();
    let mut tokens = Tokens::new(bytes);
    let mut number = 0;
    while let Some(word) = tokens.next() {
        number += 1;
        source.passed(number);
        let start = tokens.words.offset - word.len();
        let wrong = |expected: &str| {
            let line = Lines::new(bytes, line_start(bytes, start)).next().unwrap_or_default();
            source.corrupt(format!("line {}", line_number(bytes, start)), shown(line), expected)
        };
        // (Some programs write `end solid`, `end facet`, `end loop`.)
        let is_end = is_any(word, &["end"]);
        let word = if is_end { tokens.next().unwrap_or_default() } else { word };
        let begins = |keyword: &str| !is_end && is_any(word, &[keyword]);
        let ends = |keyword: &str| {
            let after = if is_end { Some(word) } else { word.split_at_checked(3).map(|(_, after)| after) };
            (is_end || word.get(..3).is_some_and(|start| start.eq_ignore_ascii_case(b"end")))
                && after.is_some_and(|after| is_any(after, &[keyword]))
        };
        match part {
            None if begins("solid") => part = Some(parts.number(source, tokens.name())?),
            None => return Err(wrong("`solid`")),
            Some(_) if ends("solid") && !is_in_facet => {
                tokens.end_name();
                part = None;
            }
            Some(_) if begins("facet") && !is_in_facet => {
                is_in_facet = true;
                corners.clear();
                let mut normal = tokens.words.clone();
                if normal.next().is_some_and(|word| is_any(word, &["normal"])) {
                    // (Normals are ignored, and may be invalid.)
                    for _ in 0..3 {
                        let before = normal.offset;
                        if normal.next().is_some_and(|word| is_any(word, &["outer", "vertex"])) {
                            normal.offset = before;
                        }
                    }
                    tokens.words = normal;
                }
            }
            Some(part) if ends("facet") && is_in_facet => {
                let Ok(corners) = <[[f64; 3]; 3]>::try_from(corners.as_slice()) else {
                    let found = format!("a facet of {} corners", corners.len());
                    let line = format!("line {}", line_number(bytes, start));
                    return Err(source.corrupt(line, found, "three corners"));
                };
                is_in_facet = false;
                each(corners, part)?;
            }
            Some(_) if begins("vertex") && is_in_facet && corners.len() < 3 => {
                let mut next = || tokens.words.next().and_then(real);
                let (Some(x), Some(y), Some(z)) = (next(), next(), next()) else {
                    return Err(wrong("`vertex` and three finite numbers"));
                };
                corners.push([x, y, z]);
            }
            Some(_) if (begins("outer") || begins("loop") || ends("loop")) && is_in_facet => {}
            Some(_) => return Err(wrong("a facet of three vertices, or `endsolid`")),
        }
    }
    if part.is_some() {
        let line = format!("line {}", line_number(bytes, bytes.len()));
        return Err(source.corrupt(line, "the end of the file", "`endsolid`"));
    }
    Ok(())
}

/// Offset of the start of the line that contains `offset`.
fn line_start(bytes: &[u8], offset: usize) -> usize {
    bytes[..offset].iter().rposition(|byte| matches!(byte, b'\n' | b'\r')).map_or(0, |end| end + 1)
}

impl Model for Stl {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let mut face = Corners::default();
        read(&self.source, self.is_text, &mut self.parts, &mut |corners, part| {
            face.clear();
            corners.iter().for_each(|corner| face.push(*corner));
            face.hand_out(part, each)
        })?;
        self.degenerate = face.degenerate;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }

    fn remarks(&self) -> Vec<String> {
        let bytes = self.source.bytes();
        let (solids, end) = binary_solids(bytes);
        let more = if self.is_text { 0 } else { (bytes.len() - end) / FACET };
        let declared = solids.first().map_or(0, |(_, count)| *count);
        match more {
            0 => Vec::new(),
            _ => vec![format!(
                "the header declares {declared} facets; the {} bytes after them, enough for {more} facets, were not read: if they belong to the surface, correct the count at byte 80",
                bytes.len() - end
            )],
        }
    }
}
