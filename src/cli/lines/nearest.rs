//! `spinney point` of a tree of lines: the nearest ones.

use std::io::{self, BufRead as _, Write as _};

use anyhow::{Context as _, Result};
use spinney::lines::LineTree;

use super::super::Global;
use super::super::args::numbers;
use super::super::report::Work;

/// Prints a line for each of the lines nearest to each place: the place's number, distance, the nearest place, the feature's number.
pub(crate) fn nearest(
    tree: &LineTree,
    places: &[String],
    (most, within): (usize, f64),
    global: &Global,
) -> Result<()> {
    let places = match places.is_empty() {
        false => places.iter().map(|text| parse(text)).collect::<Result<Vec<_>>>()?,
        true => io::stdin()
            .lock()
            .lines()
            .map_while(|line| match line {
                Ok(line) if line.trim().is_empty() => None,
                Ok(line) => Some(parse(&line)),
                Err(error) => Some(Err(error.into())),
            })
            .collect::<Result<Vec<_>>>()?,
    };
    let work = Work::start(global, "places")?;
    let found = tree.nearest(&places, (most, within), &work)?;
    work.finish();
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for (number, found) in found.iter().enumerate() {
        if found.is_empty() {
            writeln!(out, "{}\tnone", number + 1)?;
        }
        for line in found {
            let [x, y] = line.place;
            writeln!(out, "{}\t{}\t{x},{y}\t{}", number + 1, line.distance, line.feature)?;
        }
    }
    Ok(out.flush()?)
}

/// Reads two coordinates, with a comma or space between them.
fn parse(text: &str) -> Result<[f64; 2]> {
    let commas = text.split_whitespace().collect::<Vec<_>>().join(",");
    numbers(text)
        .or_else(|| numbers(&commas))
        .with_context(|| format!("{text}: expected coordinates, as in 100.5,200"))
}
