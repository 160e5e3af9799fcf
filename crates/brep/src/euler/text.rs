//! Text format of Euler operators, one a line.

use std::path::{Path, PathBuf};

use super::body::{EulerBody, EulerCorner};
use super::names::{Kind, Names, Unnamed};
use crate::Grid;
use crate::topology::Counts;
use spinney_base::{Error, Result};

/// Maximum number of words of a line.
const MAX_WORDS: usize = 9;

/// Limits for reading operators in the text format.
#[derive(Clone, Debug)]
pub struct TextLimits {
    /// Maximum bytes of memory.
    pub memory: u64,
    /// The file of the text, for messages.
    pub path: PathBuf,
}

/// A body, the names of its entities, and properties that a text of operators defines.
///
/// ```
/// use spinney::raw::brep::euler::{EulerText, TextLimits};
///
/// let text = "
///     mvfs v1 f1 0 0 0       # a point
///     mev v1 v2 e1 4 0 0     # an edge from it
///     mev v2 v3 e2 0 4 0
///     mef v3 v1 e3 f2        # closes the triangle, whose other side is a face of its own
/// ";
/// let limits = TextLimits { memory: 1 << 20, path: "triangle.euler".into() };
/// let mut body = EulerText::default();
/// body.apply(text.as_bytes(), &limits, &mut |_, _, _| {})?;
/// assert_eq!(body.body().counts().faces, 2);
/// let error = body.apply(b"kef e3 f7", &limits, &mut |_, _, _| {}).unwrap_err();
/// assert_eq!(error.to_string(), "triangle.euler, line 1: got f7, expected a name that an operator gave before");
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct EulerText {
    pub(super) body: EulerBody,
    pub(super) names: Names,
    /// The grid of the body's coordinates, if the body is a model's.
    pub(super) grid: Option<Grid>,
    /// Maximum distance of a point from its position in the text, if there is a grid.
    pub(super) displacement: f64,
    unit: Option<String>,
    step: Option<f64>,
    parts: Vec<String>,
    part_bytes: u64,
}

/// Receives the points of a face's rings, the ends of these in the points, and the part.
type FaceVisitor<'a> = dyn FnMut(&[[f64; 3]], &[usize], u32) -> Result<()> + 'a;

/// A line of a text: its number from 1, and its words.
pub(super) struct Line<'a> {
    pub(super) number: u32,
    pub(super) text: &'a str,
    pub(super) words: Vec<&'a str>,
    path: &'a Path,
}

impl Line<'_> {
    pub(super) fn wrong(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::invalid(format!("{}, line {}", self.path.display(), self.number), found, expected)
    }

    /// Returns a word for a message: short, with escapes.
    pub(super) fn shown(text: &str) -> String {
        const MAX_SHOWN: usize = 40;
        let start: String = text.chars().take(MAX_SHOWN).collect();
        let more = if start.len() < text.len() { "..." } else { "" };
        format!("{}{more}", start.escape_debug())
    }

    /// Fails unless the operator has its number of words.
    pub(super) fn check(&self, usage: &'static str) -> Result<()> {
        let expected = usage.split(' ').count();
        match self.words.len() == expected {
            true => Ok(()),
            false => Err(self.wrong(Line::shown(self.text), format!("`{usage}`"))),
        }
    }

    fn number(&self, word: usize) -> Result<f64> {
        let number = self.words[word].parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| self.wrong(Line::shown(self.words[word]), "a finite number"))
    }

    /// Rewrites the refusal of an operator, to name the line.
    pub(super) fn refusal(&self, error: Error) -> Error {
        match error {
            Error::Invalid { expected, .. } => self.wrong(Line::shown(self.text), expected),
            error => error,
        }
    }
}

impl EulerText {
    /// Creates the text state of a body with names, whose coordinates are those of a grid.
    pub(super) fn of(body: EulerBody, names: Names, grid: Grid) -> EulerText {
        EulerText { body, names, grid: Some(grid), ..EulerText::default() }
    }

    /// Returns the body.
    pub fn body(&self) -> &EulerBody {
        &self.body
    }

    /// Returns the unit of length, if the text has one.
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Returns the grid unit of the coordinates, if the text has one.
    pub fn step(&self) -> Option<f64> {
        self.step
    }

    /// Returns the names of the parts, if the text has any.
    pub fn parts(&self) -> &[String] {
        &self.parts
    }

    /// Applies the operators of a text. After each, `each` receives the line's number, the line and
    /// the body.
    ///
    /// # Errors
    /// If a line is wrong or its operator is refused, which leaves the body as the lines before it
    /// made it; or if the body needs more memory than allowed.
    pub fn apply(
        &mut self,
        text: &[u8],
        limits: &TextLimits,
        each: &mut dyn FnMut(u32, &str, &EulerBody),
    ) -> Result<()> {
        self.body.forgets = true;
        let is_end = |byte: &u8| matches!(byte, b'\n' | b';');
        let mut number = 1u32;
        for line in text.split_inclusive(is_end) {
            let mut ended = 0;
            let line = match line {
                [before @ .., b'\n'] => {
                    ended = 1;
                    before
                }
                [before @ .., b';'] => before,
                line => line,
            };
            self.line(line, number, limits, each)?;
            number = number.saturating_add(ended);
        }
        Ok(())
    }

    fn line(
        &mut self,
        line: &[u8],
        number: u32,
        limits: &TextLimits,
        each: &mut dyn FnMut(u32, &str, &EulerBody),
    ) -> Result<()> {
        let text = line.split(|byte| *byte == b'#').next().unwrap_or_default();
        let path = &*limits.path;
        let Ok(text) = str::from_utf8(text) else {
            let found = format!("the bytes {}", text[..text.len().min(20)].escape_ascii());
            return Err(Error::invalid(format!("{}, line {number}", path.display()), found, "UTF-8"));
        };
        let text = text.trim();
        let words: Vec<&str> = text.split_ascii_whitespace().take(MAX_WORDS + 1).collect();
        if words.is_empty() {
            return Ok(());
        }
        let line = Line { number, text, words, path };
        if !self.property(&line)? {
            self.operator(&line)?;
            if !self.body.is_lawful() {
                let Counts { vertices, edges, faces, rings, .. } = self.body.counts();
                let found =
                    format!("V {vertices}, E {edges}, F {faces}, R {rings} after {}", Line::shown(text));
                return Err(line.wrong(found, "V - E + F - R = 2 (S - G)"));
            }
            each(number, text, &self.body);
        }
        let needed = self.bytes();
        if needed > limits.memory {
            let (path, limit) = (limits.path.clone(), limits.memory);
            let (what, advice) =
                ("holding the body of the operators".into(), "allow more with --memory".into());
            return Err(Error::TooLarge { path, what, needed, limit, advice });
        }
        Ok(())
    }

    /// Returns the bytes of memory in use.
    fn bytes(&self) -> u64 {
        let EulerBody { half_edges, vertices, rings, faces, .. } = &self.body;
        let entities = [half_edges.slots(), vertices.slots(), rings.slots() + faces.slots()];
        let body: u64 =
            entities.into_iter().zip([48, 48, 56]).map(|(count, bytes)| count as u64 * bytes).sum();
        body + self.names.bytes() + self.part_bytes
    }

    /// Reads a line that defines a property; returns whether it is one.
    fn property(&mut self, line: &Line<'_>) -> Result<bool> {
        let word = line.words[0];
        if !matches!(word, "unit" | "step" | "part") {
            return Ok(false);
        }
        if self.grid.is_some() {
            return Err(line.wrong(word, "an operator; the model has its own unit, grid and parts"));
        }
        match word {
            "unit" => {
                line.check("unit UNIT")?;
                let units = ["mm", "cm", "m", "km", "in", "ft"];
                let unit = units.into_iter().find(|unit| *unit == line.words[1]);
                let unit =
                    unit.ok_or_else(|| line.wrong(Line::shown(line.words[1]), "mm, cm, m, km, in or ft"))?;
                self.unit = Some(unit.into());
            }
            "step" => {
                line.check("step WIDTH")?;
                let step = line.number(1)?;
                if !(step.is_normal() && step > 0.0) {
                    return Err(line.wrong(step.to_string(), "a width above zero"));
                }
                self.step = Some(step);
            }
            _ => {
                let rest =
                    line.text.split_ascii_whitespace().next().map_or("", |word| &line.text[word.len()..]);
                let rest = rest.trim_start();
                let (face, name) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                let (_, face) = self.entity(line, Kind::Face, face)?;
                let name = name.trim();
                if name.is_empty() {
                    return Err(line.wrong(Line::shown(line.text), "`part FACE NAME`"));
                }
                let part = match self.parts.iter().rposition(|part| part == name) {
                    Some(part) => part,
                    None => {
                        if self.parts.len() >= 1 << 16 {
                            return Err(line.wrong("65537 parts", "at most 65536"));
                        }
                        self.part_bytes += name.len() as u64 + 24;
                        self.parts.push(name.into());
                        self.parts.len() - 1
                    }
                };
                if let Some(face) = self.body.faces.get_mut(face) {
                    face.source = Some(part as u32);
                }
            }
        }
        Ok(true)
    }

    /// Returns the name and the number of an entity that exists.
    pub(super) fn entity(&self, line: &Line<'_>, kind: Kind, word: &str) -> Result<(u32, u32)> {
        let name = Names::parse(kind, word);
        let name = name.ok_or_else(|| line.wrong(Line::shown(word), kind.expected()))?;
        match self.names.get(kind, name) {
            Ok(entity) => Ok((name, entity)),
            Err(Unnamed::Unknown) => Err(line.wrong(word, "a name that an operator gave before")),
            Err(Unnamed::Killed(at)) => {
                Err(line.wrong(word, format!("a name that is in use: line {at} killed {word}")))
            }
        }
    }

    /// Returns a name that was never given.
    pub(super) fn new_name(&self, line: &Line<'_>, kind: Kind, word: &str) -> Result<u32> {
        let name = Names::parse(kind, word);
        let name = name.ok_or_else(|| line.wrong(Line::shown(word), kind.expected()))?;
        match self.names.is_new(kind, name) {
            true => Ok(name),
            false => Err(line.wrong(word, "a new name; names are given once")),
        }
    }

    /// Returns the point in the last three words.
    pub(super) fn point(&mut self, line: &Line<'_>) -> Result<[f64; 3]> {
        let first = line.words.len() - 3;
        let point = [line.number(first)?, line.number(first + 1)?, line.number(first + 2)?];
        let Some(grid) = &self.grid else { return Ok(point) };
        let exact = grid.to_grid(point);
        let nearest = exact.map(f64::round_ties_even);
        if nearest.iter().any(|at| at.abs() >= (1u64 << 52) as f64) {
            return Err(line.wrong(format!("{point:?}"), "a point near the model"));
        }
        let world = grid.to_world_between(nearest);
        let squares = (0..3).map(|axis| (world[axis] - point[axis]).powi(2));
        let moved = if exact == nearest { 0.0 } else { squares.sum::<f64>().sqrt() };
        self.displacement = self.displacement.max(moved);
        Ok(nearest)
    }

    /// Returns all corners that a word denotes: `v4`, those of a vertex; `v4@f2`, those in a face;
    /// `v4:e3`, the one at which a ring leaves along an edge.
    pub(super) fn corners(&self, line: &Line<'_>, word: &str) -> Result<Vec<EulerCorner>> {
        let (vertex, rest) = word.find([':', '@']).map_or((word, ""), |at| word.split_at(at));
        let (_, vertex) = self.entity(line, Kind::Vertex, vertex)?;
        let body = &self.body;
        if let Some(edge) = rest.strip_prefix(':') {
            let (_, edge) = self.entity(line, Kind::Edge, edge)?;
            let half = [2 * edge, 2 * edge + 1].into_iter().find(|half| body.half(*half).origin == vertex);
            let half = half.ok_or_else(|| line.wrong(Line::shown(word), "an edge of the vertex"))?;
            return Ok(vec![EulerCorner::Of(half)]);
        }
        let face = match rest.strip_prefix('@') {
            Some(face) => Some(self.entity(line, Kind::Face, face)?.1),
            None => None,
        };
        let all: Vec<EulerCorner> = match body.vertices.get(vertex).map(|vertex| vertex.corner) {
            Some(lone @ EulerCorner::Lone(_)) => vec![lone],
            _ => body.half_edges_of(vertex).map(EulerCorner::Of).collect(),
        };
        let is_there =
            |corner: &EulerCorner| face.is_none_or(|face| body.face_of(self.ring(*corner)) == face);
        let found: Vec<EulerCorner> = all.into_iter().filter(is_there).collect();
        match found.is_empty() {
            true => Err(line.wrong(Line::shown(word), "a vertex of the face")),
            false => Ok(found),
        }
    }

    /// Returns the ring of a corner.
    pub(super) fn ring(&self, corner: EulerCorner) -> u32 {
        match corner {
            EulerCorner::Of(half) => self.body.half(half).ring,
            EulerCorner::Lone(ring) => ring,
        }
    }

    /// Returns the only corner that a word denotes.
    pub(super) fn corner(&self, line: &Line<'_>, word: &str) -> Result<EulerCorner> {
        match &self.corners(line, word)?[..] {
            [corner] => Ok(*corner),
            corners => Err(self.ambiguous(line, word, corners)),
        }
    }

    /// Creates the error of a word that denotes several corners.
    pub(super) fn ambiguous(&self, line: &Line<'_>, word: &str, corners: &[EulerCorner]) -> Error {
        let vertex = word.split([':', '@']).next().unwrap_or(word);
        let first = corners.iter().find_map(|corner| match corner {
            EulerCorner::Of(half) => Some(self.names.name_of(Kind::Edge, half / 2)),
            EulerCorner::Lone(_) => None,
        });
        let found = format!("{}, which has {} corners there", Line::shown(word), corners.len());
        let example = first.map_or(String::new(), |edge| format!(", such as {vertex}:{edge}"));
        line.wrong(found, format!("one corner, {vertex}@FACE or {vertex}:EDGE{example}"))
    }

    /// Returns the only pair of half-edges that two words denote and that begin in one ring.
    pub(super) fn pair_in_ring(&self, line: &Line<'_>, words: [&str; 2]) -> Result<[u32; 2]> {
        let mut found = [self.corners(line, words[0])?, self.corners(line, words[1])?];
        if words[0] == words[1] {
            return Err(line.wrong(Line::shown(line.text), "corners of two vertices"));
        }
        let rings = [0, 1].map(|side| {
            let mut rings: Vec<u32> = found[side].iter().map(|corner| self.ring(*corner)).collect();
            rings.sort_unstable();
            rings
        });
        for side in 0..2 {
            found[side].retain(|corner| rings[1 - side].binary_search(&self.ring(*corner)).is_ok());
        }
        match (&found[0][..], &found[1][..]) {
            ([EulerCorner::Of(from)], [EulerCorner::Of(to)]) => Ok([*from, *to]),
            ([], _) | (_, []) | ([_], [_]) => {
                Err(line.wrong(Line::shown(line.text), "two corners of one ring, at different vertices"))
            }
            ([_], several) => Err(self.ambiguous(line, words[1], several)),
            (several, _) => Err(self.ambiguous(line, words[0], several)),
        }
    }

    /// Returns an edge's half-edge with a vertex at one of its sides: at its end, or its start.
    pub(super) fn half_at(&self, edge: u32, vertex: u32, is_end: bool) -> Option<u32> {
        let at = |half: u32| self.body.ends(half)[usize::from(is_end)];
        [2 * edge, 2 * edge + 1].into_iter().find(|half| at(*half) == vertex)
    }

    /// Checks that all rings have at least three edges.
    ///
    /// # Errors
    /// If one has fewer, as after an incomplete text.
    pub fn check_rings(&self, path: &Path) -> Result<()> {
        for face in self.body.faces.numbers() {
            for ring in self.body.faces.get(face).into_iter().flat_map(|face| &face.rings) {
                let count = self.body.points_of(*ring).len();
                if count < 3 {
                    let found = format!(
                        "a face {} with a ring of {count} vertices",
                        self.names.name_of(Kind::Face, face)
                    );
                    return Err(Error::invalid(path.display().to_string(), found, "at least 3"));
                }
            }
        }
        Ok(())
    }

    /// Visits all faces: the points of their rings, the ends of these in the points, and the part.
    ///
    /// # Errors
    /// Errors of `each`.
    pub fn each_face(&self, each: &mut FaceVisitor<'_>) -> Result<()> {
        let (mut points, mut ends) = (Vec::new(), Vec::new());
        for face in self.body.faces.numbers() {
            points.clear();
            ends.clear();
            for ring in self.body.faces.get(face).into_iter().flat_map(|face| &face.rings) {
                points.extend(self.body.points_of(*ring));
                ends.push(points.len());
            }
            each(&points, &ends, self.body.source_of(face).unwrap_or(0))?;
        }
        Ok(())
    }
}
