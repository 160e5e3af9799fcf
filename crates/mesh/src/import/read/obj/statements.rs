//! Statements of an OBJ file.

use super::super::model_file::ModelFile;
use spinney_base::Result;
use spinney_records::text::{Lines, Words, real, words};

/// Maximum length in bytes of a statement over several lines.
const MAX_BYTES: usize = 64 << 20;

/// Statement that is used: its words, possibly from several lines, or a name in the file.
pub(super) enum Statement<'s, 'a> {
    Vertex(Words<'s>),
    Face(Words<'s>),
    Object(&'a [u8]),
    Group(&'a [u8]),
    Material(&'a [u8]),
    /// Name of a material library.
    Library(&'a [u8]),
}

/// Iterates over the statements of a file.
pub(super) struct Statements<'a> {
    source: &'a ModelFile,
    lines: Lines<'a>,
    /// Number of lines so far.
    count: u64,
    /// Current statement if it is joined from several lines.
    joined: Vec<u8>,
}

impl<'a> Statements<'a> {
    pub(super) fn new(source: &'a ModelFile) -> Statements<'a> {
        Statements { source, lines: Lines::new(source.bytes(), 0), count: 0, joined: Vec::new() }
    }

    /// Next statement, and the number of its last line.
    pub(super) fn next(&mut self) -> Result<Option<(u64, Statement<'_, 'a>)>> {
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
                    return Err(self.source.corrupt(format!("line {}", self.count), found, "at most that"));
                }
            }
            let mut rest = words(line);
            let mut keyword = rest.next().unwrap_or_default();
            if is_joined {
                self.joined.extend_from_slice(line);
                // Only vertices and faces may continue on other lines, since they may have many
                // numbers. Names may not.
                keyword = words(&self.joined).next().map_or(b"", |word| match word {
                    b"v" => b"v",
                    b"f" => b"f",
                    _ => b"",
                });
            }
            let name = line.get(rest.offset..).unwrap_or_default().trim_ascii();
            let statement = match keyword {
                b"v" | b"f" => {
                    let whole: &[u8] = if is_joined { &self.joined } else { line };
                    let whole = whole.split(|byte| *byte == b'#').next().unwrap_or_default();
                    let mut words = words(whole);
                    words.next();
                    let statement = match keyword {
                        b"v" => Statement::Vertex(words),
                        _ => Statement::Face(words),
                    };
                    return Ok(Some((self.count, statement)));
                }
                b"o" => Statement::Object(name),
                b"g" => Statement::Group(name),
                b"usemtl" => Statement::Material(name),
                b"mtllib" => Statement::Library(name),
                _ => continue,
            };
            return Ok(Some((self.count, statement)));
        }
    }
}

/// Vertex coordinates, divided by the weight if there are four numbers, and the colour values.
pub(super) fn vertex(mut words: Words<'_>) -> Option<([f64; 3], Option<[f64; 3]>)> {
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
        6 | 7 => ([x, y, z], Some([a, b, c])),
        _ => return None,
    };
    point.iter().all(|coordinate: &f64| coordinate.is_finite()).then_some((point, colour))
}
