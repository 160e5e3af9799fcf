//! Query positions: arguments, or lines of standard input.

use std::io::{self, BufRead as _};

use anyhow::{Result, bail};

/// Parses positions from arguments, or from lines of standard input if there are none. Skips empty
/// lines.
pub(crate) fn positions<const AXES: usize>(arguments: &[String]) -> Result<Vec<[f64; AXES]>> {
    if !arguments.is_empty() {
        return arguments.iter().map(|text| position(text)).collect();
    }
    let lines = io::stdin().lock().lines();
    let lines = lines.filter(|line| !line.as_ref().is_ok_and(|line| line.trim().is_empty()));
    lines.map(|line| position(&line?)).collect()
}

/// Parses two or more coordinates, separated by commas or blanks. A missing z becomes NaN.
fn position<const AXES: usize>(text: &str) -> Result<[f64; AXES]> {
    let words = text.split([',', ' ', '\t']).filter(|word| !word.is_empty());
    let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
    let mut position = [f64::NAN; AXES];
    match numbers {
        Some(numbers) if (2..=AXES).contains(&numbers.len()) => {
            position[..numbers.len()].copy_from_slice(&numbers)
        }
        _ => bail!(
            "point: got `{text}`, expected coordinates, such as {}",
            if AXES == 2 { "100.5,200" } else { "100.5,200,30 or 100.5,200" }
        ),
    }
    Ok(position)
}
