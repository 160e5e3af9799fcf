//! STL: facets that each stand alone, as text or binary.

use super::corners::Corners;
use super::model_file::ModelFile;
use super::parts::Parts;
use super::vertices::VertexBounds;
use super::{MeshFace, Model, ModelInfo};
use spinney_base::Result;
use spinney_brep::Attributes;
use spinney_records::text::{Lines, real, shown, words};

/// Bytes before the first facet of a binary file: a free text and the number of facets.
const HEADER: usize = 84;

/// Bytes of a facet: normal, three corners, and two that some programs use for colours of their own.
const FACET: usize = 50;

/// Callback for each facet: its corners and part.
type Each<'a> = &'a mut dyn FnMut([[f64; 3]; 3], u32) -> Result<()>;

struct Stl {
    source: ModelFile,
    info: ModelInfo,
    is_text: bool,
    parts: Parts,
    degenerate: u64,
}

/// Whether a file has exactly the length that a binary one with its number of facets has.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    announced(bytes).is_some_and(|count| count > 0 && length(count) == bytes.len() as u64)
}

/// Whether a file starts like a text one.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(4096)];
    let mut lines = Lines::new(start, 0).map(words).filter_map(|mut words| words.next());
    lines.next().is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
        && lines
            .next()
            .is_some_and(|word| [&b"facet"[..], b"endsolid"].iter().any(|w| word.eq_ignore_ascii_case(w)))
}

/// Number of facets that a binary file's header tells.
fn announced(bytes: &[u8]) -> Option<u32> {
    bytes.get(80..HEADER)?.first_chunk().map(|count| u32::from_le_bytes(*count))
}

fn length(facets: u32) -> u64 {
    HEADER as u64 + u64::from(facets) * FACET as u64
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let is_text = !is_binary(source.bytes()) && is_text(source.bytes());
    let (mut bounds, mut faces) = (VertexBounds::new(), 0);
    let mut parts = Parts::new(memory);
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
        attributes: Attributes::default(),
        is_coloured: false,
        bytes: source.bytes().len() as u64,
    };
    Ok(Box::new(Stl { source, info, is_text, parts, degenerate: 0 }))
}

fn read(source: &ModelFile, is_text: bool, parts: &mut Parts, each: Each<'_>) -> Result<()> {
    if is_text { read_text(source, parts, each) } else { read_binary(source, each) }
}

fn read_binary(source: &ModelFile, each: Each<'_>) -> Result<()> {
    let bytes = source.bytes();
    let Some(count) = announced(bytes) else {
        return Err(source.corrupt("STL header", format!("{} bytes", bytes.len()), "84 bytes, or `solid`"));
    };
    if (bytes.len() as u64) < length(count) {
        let expected = format!("{} for {count} facets", length(count));
        return Err(source.corrupt("the whole STL file", format!("{} bytes", bytes.len()), expected));
    }
    let facets = bytes[HEADER..].chunks_exact(FACET).take(count as usize);
    for (number, facet) in facets.enumerate() {
        source.passed(number as u64);
        let mut corners = [[0f64; 3]; 3];
        for (coordinate, bytes) in corners.as_flattened_mut().iter_mut().zip(facet[12..].as_chunks::<4>().0) {
            *coordinate = f32::from_le_bytes(*bytes).into();
        }
        if !corners.as_flattened().iter().all(|coordinate| coordinate.is_finite()) {
            let place = format!("facet {number}, byte {}", HEADER + number * FACET);
            return Err(source.corrupt(place, format!("{corners:?}"), "finite coordinates"));
        }
        each(corners, 0)?;
    }
    Ok(())
}

fn read_text(source: &ModelFile, parts: &mut Parts, each: Each<'_>) -> Result<()> {
    let mut part = None;
    let mut is_in_facet = false;
    let mut corners: Vec<[f64; 3]> = Vec::new();
    let mut number = 0;
    for line in Lines::new(source.bytes(), 0) {
        number += 1;
        source.passed(number);
        let mut words = words(line);
        let Some(keyword) = words.next() else { continue };
        let wrong = |expected: &str| source.corrupt(format!("line {number}"), shown(line), expected);
        let is = |word: &str| keyword.eq_ignore_ascii_case(word.as_bytes());
        match part {
            None if is("solid") => part = Some(parts.number(source, line[words.offset..].trim_ascii())?),
            None => return Err(wrong("`solid`")),
            Some(_) if is("endsolid") && !is_in_facet => part = None,
            Some(_) if is("facet") && !is_in_facet => {
                is_in_facet = true;
                corners.clear();
            }
            Some(part) if is("endfacet") && is_in_facet => {
                let Ok(corners) = <[[f64; 3]; 3]>::try_from(corners.as_slice()) else {
                    let found = format!("a facet of {} corners", corners.len());
                    return Err(source.corrupt(format!("line {number}"), found, "three corners"));
                };
                is_in_facet = false;
                each(corners, part)?;
            }
            Some(_) if is("vertex") && is_in_facet && corners.len() < 3 => {
                let mut next = || words.next().and_then(real);
                let (Some(x), Some(y), Some(z)) = (next(), next(), next()) else {
                    return Err(wrong("`vertex` and three finite numbers"));
                };
                corners.push([x, y, z]);
            }
            Some(_) if (is("outer") || is("endloop")) && is_in_facet => {}
            Some(_) => return Err(wrong("a facet of three vertices, or `endsolid`")),
        }
    }
    if part.is_some() {
        return Err(source.corrupt(format!("line {number}"), "the end of the file", "`endsolid`"));
    }
    Ok(())
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
}
