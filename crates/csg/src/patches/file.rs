//! Files of Bezier patches, `.bpt`, as they are known from the Utah teapot: the number of patches,
//! and for each patch its two degrees and its control points.

use std::fmt::Write as _;
use std::path::Path;

use super::Patch;
#[cfg(test)]
use super::Point;
use crate::affine::MAX_NUMBER;
use crate::syntax::{At, wrong};
use spinney_base::Result;

/// Maximum number of patches of a file.
const MAX_PATCHES: u64 = 1 << 13;

/// Whether a file name has the extension of patches, `.bpt`.
pub(crate) fn is_patch_file(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bpt"))
}

/// Numbers of a text, with their positions.
struct Numbers<'a> {
    path: &'a Path,
    words: Box<dyn Iterator<Item = (At, &'a str)> + 'a>,
    /// Position after the last word.
    end: At,
}

impl<'a> Numbers<'a> {
    fn new(path: &'a Path, text: &'a str) -> Numbers<'a> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let words = (1u32..).zip(text.lines()).flat_map(|(line, content)| {
            content.split_whitespace().map(move |word| {
                let before = &content[..word.as_ptr() as usize - content.as_ptr() as usize];
                (At { line, column: before.chars().count() as u32 + 1 }, word)
            })
        });
        let end = At { line: text.lines().count() as u32 + 1, column: 1 };
        Numbers { path, words: Box::new(words), end }
    }

    /// Returns the next word and its position; an error at the end of the text.
    fn word(&mut self, expected: &str) -> Result<(At, &'a str)> {
        let next = self.words.next();
        next.ok_or_else(|| wrong(self.path, self.end, "the end of the file", expected))
    }

    /// Returns the error for a word.
    fn unexpected(&self, at: At, word: &str, expected: &str) -> spinney_base::Error {
        let shown: String = word.chars().take(40).collect();
        wrong(self.path, at, format!("`{shown}`"), expected)
    }

    fn integer(&mut self, expected: &str) -> Result<(At, u64)> {
        let (at, word) = self.word(expected)?;
        Ok((at, word.parse().map_err(|_| self.unexpected(at, word, expected))?))
    }

    fn coordinate(&mut self, expected: &str) -> Result<f64> {
        let (at, word) = self.word(expected)?;
        let number: Option<f64> = word.parse().ok();
        let number = number.filter(|number| number.abs() <= MAX_NUMBER);
        number.ok_or_else(|| self.unexpected(at, word, expected))
    }
}

/// Parses a file of patches.
///
/// # Errors
/// If the text is truncated or longer than its number of patches says, if a number is missing,
/// malformed, not finite or beyond 1e30, or if degrees are other than `2 2` and `3 3`. Messages
/// report line and column.
pub(super) fn patches(path: &Path, text: &str) -> Result<Vec<Patch>> {
    let mut numbers = Numbers::new(path, text);
    let expected = "the number of patches, from 1 to 8192";
    let (at, count) = numbers.integer(expected)?;
    if !(1..=MAX_PATCHES).contains(&count) {
        return Err(numbers.unexpected(at, &count.to_string(), expected));
    }
    let mut patches = Vec::new();
    for number in 1..=count {
        let expected =
            format!("the degrees of patch {number} of {count}: `3 3` (bicubic) or `2 2` (biquadratic)");
        let (at, degree) = numbers.integer(&expected)?;
        let (second_at, second) = numbers.integer(&expected)?;
        if !matches!(degree, 2 | 3) {
            return Err(numbers.unexpected(at, &degree.to_string(), &expected));
        }
        if second != degree {
            return Err(numbers.unexpected(second_at, &second.to_string(), &expected));
        }
        let total = (degree + 1) * (degree + 1);
        let mut points = Vec::new();
        for point in 1..=total {
            let expected = format!(
                "a coordinate of point {point} of {total} of patch {number}: a number from -1e30 to 1e30"
            );
            let [x, y, z] = [(); 3].map(|()| numbers.coordinate(&expected));
            points.push([x?, y?, z?]);
        }
        patches.extend(Patch::new(points, at));
    }
    match numbers.words.next() {
        Some((at, word)) => {
            Err(numbers.unexpected(at, word, &format!("the end of the file, after {count} patches")))
        }
        None => Ok(patches),
    }
}

/// Parses a file of patches, and returns them with the CSG text of their solid.
///
/// # Errors
/// Those of [`patches`].
pub(crate) fn csg_of_patches(path: &Path, text: &str) -> Result<(Vec<Patch>, String)> {
    let patches = patches(path, text)?;
    let mut csg = String::from("patches(");
    for (number, patch) in patches.iter().enumerate() {
        csg.push_str(if number == 0 { "\n  [" } else { ",\n  [" });
        for (index, [x, y, z]) in patch.points().iter().enumerate() {
            // (Writing to a string cannot fail.)
            let _ = write!(csg, "{}[{x},{y},{z}]", if index == 0 { "" } else { "," });
        }
        csg.push(']');
    }
    csg.push_str("\n);\n");
    Ok((patches, csg))
}

/// Returns the text of a file of patches.
#[cfg(test)]
pub(super) fn text_of(patches: &[Vec<Point>]) -> String {
    let mut text = format!("{}\n", patches.len());
    for points in patches {
        let degree = if points.len() == 9 { 2 } else { 3 };
        let _ = writeln!(text, "{degree} {degree}");
        for [x, y, z] in points {
            let _ = writeln!(text, "{x} {y} {z}");
        }
    }
    text
}
