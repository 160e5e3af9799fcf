//! `spinney point` of a tree of points: the nearest ones.

use std::io::{self, BufRead as _, Write as _};

use anyhow::{Context as _, Result, ensure};
use spinney::points::PointTree;

use super::super::Global;
use super::super::args::DEFAULT_MEMORY;
use super::super::report::Work;

/// Prints a line for each of the points nearest to each place: the place's number, distance, coordinates.
pub(crate) fn nearest(
    tree: &PointTree,
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
    let found = tree.nearest(&places, (most, within), DEFAULT_MEMORY, &work)?;
    work.finish();
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for (number, found) in found.iter().enumerate() {
        if found.is_empty() {
            writeln!(out, "{}\tnone", number + 1)?;
        }
        for point in found {
            let [x, y, z] = point.place;
            writeln!(out, "{}\t{}\t{x},{y},{z}", number + 1, point.distance)?;
        }
    }
    Ok(out.flush()?)
}

/// Reads two or three coordinates.
fn parse(text: &str) -> Result<[f64; 3]> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
    let numbers =
        numbers.ok().with_context(|| format!("{text}: expected coordinates, as in 100.5,200,30"))?;
    ensure!((2..=3).contains(&numbers.len()), "{text}: expected X,Y,Z or X,Y");
    Ok([numbers[0], numbers[1], numbers.get(2).copied().unwrap_or(0.0)])
}
