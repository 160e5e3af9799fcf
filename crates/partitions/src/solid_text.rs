//! Solids of half-spaces as text: BSP trees (`.bsp`), and octrees with planes in their leaves
//! (`.df`).
//!
//! The first line of both describes the grid of the coordinates:
//!
//! ```text
//! head  = kind ":xyz:" bits ":" step "/" divisor ":" x "," y "," z [ ":" unit ]
//! kind  = "bsp" | "df:planes"
//! bits  = bits of a coordinate: grid points are from 0 to 2^bits - 1
//! step  = width of a grid unit, divided by the divisor
//! x,y,z = world position of the grid point 0, 0, 0, in grid units from the world's origin
//! ```
//!
//! A plane is `a b c d`, integers: its back is where `a x + b y + c z + d` is negative. A `#`
//! begins a comment, which ends with the line.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{ExactPlane, Grid, MAX_BITS};

use crate::bsp::Bsp;
use crate::extended_octree;
use crate::text_file;

/// Maximum number of bits of the components of a plane's normal.
const NORMAL_BITS: u32 = 56;
/// Bytes of memory for each byte of a text: a line of at least two bytes becomes a node.
pub(crate) const NODE_BYTES: usize = 192;
/// Maximum length of a unit's name, in bytes.
const MAX_UNIT: usize = 16;

/// Solid of half-spaces, read from a text.
///
/// ```
/// use spinney::raw::partitions::SolidText;
///
/// // A tetrahedron: three planes through its corner at 1, 1, 1, and one opposite.
/// let text = "bsp:xyz:4:1/1:0,0,0\n-1 0 0 1\n 0 -1 0 1\n  0 0 -1 1\n   1 1 1 -9\n    in\n    out\n   out\n  out\n out\n";
/// let solid = SolidText::parse("corner.bsp".as_ref(), text)?;
/// assert!(solid.tree.is_inside([2, 2, 2]) && !solid.tree.is_inside([4, 4, 4]));
/// assert_eq!(solid.polygons(&())?.len(), 4);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct SolidText {
    /// Tree of the half-spaces.
    pub tree: Bsp,
    /// Grid of its coordinates.
    pub grid: Grid,
    /// Unit of length of the world.
    pub unit: Option<String>,
}

/// Kind of a text.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Bsp,
    ExtendedOctree,
}

impl SolidText {
    /// Whether a file begins with the first word of a solid's text.
    pub fn is_in(path: &Path) -> bool {
        let mut start = Vec::new();
        let file = File::open(path);
        // (Comments may come first.)
        let read = file.and_then(|file| file.take(1 << 12).read_to_end(&mut start));
        let text = String::from_utf8_lossy(&start);
        let mut lines = Lines::of(path, &text);
        let line = lines.next().unwrap_or_default();
        read.is_ok() && (line.starts_with("bsp:xyz:") || line.starts_with("df:planes:"))
    }

    /// Reads a file. Its text and its nodes may use at most `memory` bytes.
    ///
    /// # Errors
    /// If the file cannot be read or exceeds `memory`, and those of [`SolidText::parse`].
    pub fn read(path: &Path, memory: u64) -> Result<SolidText> {
        SolidText::parse(path, &text_file::read(path, "solid of half-spaces", NODE_BYTES, memory)?)
    }

    /// Parses a text. `path` is its origin, for messages.
    ///
    /// # Errors
    /// If the text is not one of a BSP tree of space, or of an octree with planes in its leaves.
    pub fn parse(path: &Path, text: &str) -> Result<SolidText> {
        let mut lines = Lines::of(path, text);
        let (kind, grid, unit) = lines.head()?;
        let tree = match kind {
            Kind::Bsp => Bsp::parse(&mut lines, Dimension::Oct)?,
            Kind::ExtendedOctree => extended_octree::parse(&mut lines, grid.bits)?,
        };
        Ok(SolidText { tree, grid, unit })
    }

    /// Returns the polygons around the solid, with holes, in the world: see [`Bsp::polygons`].
    ///
    /// # Errors
    /// Those of [`Bsp::polygons`].
    pub fn polygons(&self, progress: &dyn Progress) -> Result<Vec<Vec<Vec<[f64; 3]>>>> {
        let mut polygons = self.tree.polygons(progress)?;
        let Grid { origin, step, divisor, .. } = self.grid;
        for point in polygons.iter_mut().flatten().flatten() {
            *point = [0, 1, 2].map(|axis| (origin[axis] as f64 + point[axis]) * step / divisor);
        }
        Ok(polygons)
    }
}

/// Formats the first line of the text of a solid.
pub(crate) fn head(kind: &str, grid: &Grid, unit: Option<&str>) -> String {
    let Grid { bits, origin: [x, y, z], step, divisor } = grid;
    let mut text = format!("{kind}:xyz:{bits}:{step}/{divisor}:{x},{y},{z}");
    if let Some(unit) = unit.filter(|unit| is_unit(unit)) {
        let _ = write!(text, ":{unit}");
    }
    text.push('\n');
    text
}

fn is_unit(unit: &str) -> bool {
    !unit.is_empty() && unit.len() <= MAX_UNIT && unit.bytes().all(|byte| byte.is_ascii_alphanumeric())
}

/// Formats a plane, without a line break.
pub(crate) fn push_plane(text: &mut String, plane: &ExactPlane) {
    let plane = plane.reduced();
    let ([a, b, c], d) = (plane.normal, -plane.offset);
    let _ = write!(text, "{a} {b} {c} {d}");
}

/// Lines of a text, for parsing.
pub(crate) struct Lines<'a> {
    path: &'a Path,
    lines: std::str::Lines<'a>,
    number: u64,
}

impl<'a> Lines<'a> {
    pub(crate) fn of(path: &'a Path, text: &'a str) -> Lines<'a> {
        Lines { path, lines: text.lines(), number: 0 }
    }

    /// Returns the next line that is not empty, without comment and surrounding white space.
    pub(crate) fn next(&mut self) -> Option<&'a str> {
        loop {
            self.number += 1;
            let line = self.lines.next()?;
            let line = line.split('#').next().unwrap_or_default().trim();
            if !line.is_empty() {
                return Some(line);
            }
        }
    }

    /// Error of the current line.
    pub(crate) fn bad(&self, found: &str, expected: impl Into<String>) -> Error {
        let found = match found.char_indices().nth(40) {
            Some((end, _)) => format!("`{}...`", &found[..end]),
            None if found.is_empty() => "the end of the text".into(),
            None => format!("`{found}`"),
        };
        Error::invalid(format!("{}, line {}", self.path.display(), self.number), found, expected)
    }

    fn head(&mut self) -> Result<(Kind, Grid, Option<String>)> {
        let line = self.next().unwrap_or_default();
        let expected = "`bsp:xyz:BITS:STEP/DIVISOR:X,Y,Z[:UNIT]`, or `df:planes:xyz:...`";
        let bad = || self.bad(line, expected);
        let (kind, rest) = match (line.strip_prefix("bsp:xyz:"), line.strip_prefix("df:planes:xyz:")) {
            (Some(rest), _) => (Kind::Bsp, rest),
            (_, Some(rest)) => (Kind::ExtendedOctree, rest),
            _ => return Err(bad()),
        };
        let words: Vec<&str> = rest.split(':').collect();
        let (bits, step, origin, unit) = match words[..] {
            [bits, step, origin] => (bits, step, origin, None),
            [bits, step, origin, unit] if is_unit(unit) => (bits, step, origin, Some(unit.to_string())),
            _ => return Err(bad()),
        };
        let bits: u8 = bits.parse().ok().filter(|bits| (1..=MAX_BITS).contains(bits)).ok_or_else(bad)?;
        let (step, divisor) = step.split_once('/').ok_or_else(bad)?;
        let length = |text: &str| {
            let number: Option<f64> = text.parse().ok();
            number.filter(|number| (1e-100..1e100).contains(number)).ok_or_else(bad)
        };
        let (step, divisor) = (length(step)?, length(divisor)?);
        let origin: Option<Vec<i64>> = origin.split(',').map(|at| at.parse().ok()).collect();
        let origin = origin.filter(|all| all.iter().all(|at| at.unsigned_abs() <= 1 << 53));
        let Some([x, y, z]) = origin.as_deref() else { return Err(bad()) };
        Ok((kind, Grid { bits, origin: [*x, *y, *z], step, divisor }, unit))
    }

    /// Parses the plane of the current line: `A B C D`, or `A B D` in the plane.
    pub(crate) fn plane(&self, line: &str, dimension: Dimension) -> Result<ExactPlane> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let parsed = match (&words[..], dimension) {
            ([a, b, d], Dimension::Quad) => plane_of([a, b, "0"], d),
            ([a, b, c, d], Dimension::Oct) => plane_of([a, b, c], d),
            _ => None,
        };
        parsed.ok_or_else(|| {
            let numbers =
                if dimension == Dimension::Quad { "a line, `A B D`," } else { "a plane, `A B C D`," };
            self.bad(line, format!("{numbers} with integers of at most 56 bits, D of 84"))
        })
    }
}

fn plane_of(normal: [&str; 3], d: &str) -> Option<ExactPlane> {
    let mut parts = [0i64; 3];
    for (part, text) in parts.iter_mut().zip(normal) {
        *part = text.parse().ok().filter(|part: &i64| part.unsigned_abs() < 1 << NORMAL_BITS)?;
    }
    let most = 1u128 << (NORMAL_BITS + u32::from(MAX_BITS) + 2);
    let d: i128 = d.parse().ok().filter(|d: &i128| d.unsigned_abs() < most)?;
    (parts != [0; 3]).then_some(ExactPlane { normal: parts, offset: -d })
}
