//! Cells as lines of text.

use std::io::{BufRead, Read};
use std::path::Path;

use super::coordinate;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_engine::ops::CellValue;

/// Maximum length of a line in bytes.
const LONGEST: u64 = 4096;

/// Parses one cell per non-empty line.
pub(super) fn rows<R: BufRead>(
    mut input: R,
    path: &Path,
    axes: usize,
    channels: usize,
) -> impl Iterator<Item = Result<CellValue>> + use<R> {
    let path = path.to_path_buf();
    let mut number = 0u64;
    let mut line = Vec::new();
    std::iter::from_fn(move || {
        loop {
            line.clear();
            number += 1;
            match input.by_ref().take(LONGEST).read_until(b'\n', &mut line) {
                Ok(0) => return None,
                Ok(_) => {}
                Err(error) => return Some(Err(Error::io(&path, "read")(error))),
            }
            let text = String::from_utf8_lossy(&line);
            let text = text.trim();
            if text.is_empty() {
                continue;
            }
            return Some(row(text, axes, channels).ok_or_else(|| {
                let axes = if axes == 3 { "X,Y,Z" } else { "X,Y" };
                let found =
                    format!("`{}`", text.chars().take(60).flat_map(char::escape_debug).collect::<String>());
                let values = if channels == 1 { "a number".into() } else { format!("{channels} numbers") };
                let expected = format!("{axes} and {values}, or {axes} and `void`");
                Error::invalid(format!("{}: line {number}", path.display()), found, expected)
            }));
        }
    })
}

fn row(text: &str, axes: usize, channels: usize) -> Option<CellValue> {
    let mut words = text.split([',', ';', ' ', '\t']).filter(|word| !word.is_empty());
    let mut cell = [0; 3];
    for axis in &mut cell[..axes] {
        *axis = coordinate(words.next()?.parse().ok()?)?;
    }
    let rest: Vec<&str> = words.collect();
    if rest == ["void"] {
        return Some((cell, None));
    }
    let values: Option<Vec<Number>> = rest.iter().map(|word| word.parse().ok()).collect();
    values.filter(|values| values.len() == channels).map(|values| (cell, Some(values)))
}
