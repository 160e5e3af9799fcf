//! `spinney point` of an exact model.

use std::io::{self, BufRead as _, Write};

use anyhow::{Context as _, Result, anyhow};
use rayon::prelude::*;
use spinney::brep::ExactModel;
use spinney::brep::query::Location;

/// Points that are answered at a time.
const BATCH: usize = 1 << 16;

/// Says of each point, given in the world, whether it is inside of the body: those of the command line, or of standard
/// input if there are none.
pub(crate) fn points(model: &ExactModel, points: &[String]) -> Result<()> {
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    if !points.is_empty() {
        let points = points.iter().zip(1..).map(|(text, number)| parse(text, "point", number));
        answer(model, &points.collect::<Result<Vec<_>>>()?, &mut out)?;
    } else {
        let mut batch = Vec::with_capacity(BATCH);
        for (line, number) in io::stdin().lock().lines().zip(1..) {
            let line = line.context("standard input")?;
            if line.trim().is_empty() {
                continue;
            }
            batch.push(parse(&line, "standard input, line", number)?);
            if batch.len() == BATCH {
                answer(model, &batch, &mut out)?;
                batch.clear();
            }
        }
        answer(model, &batch, &mut out)?;
    }
    out.flush()?;
    Ok(model.check_unchanged()?)
}

fn parse(line: &str, from: &str, number: u64) -> Result<[f64; 3]> {
    let wrong = || anyhow!("{from} {number}: `{}` is not X,Y,Z", line.trim());
    let words = line.split([',', ' ', '\t', ';']).map(str::trim).filter(|word| !word.is_empty());
    let numbers: Vec<f64> = words
        .map(|word| word.parse().ok().filter(|number: &f64| number.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(wrong)?;
    numbers.try_into().map_err(|_| wrong())
}

fn answer(model: &ExactModel, points: &[[f64; 3]], out: &mut impl Write) -> Result<()> {
    let parts: Vec<_> = points
        .par_chunks(1 << 12)
        .map(|part| {
            let mut locations = Vec::with_capacity(part.len());
            model.locate_all(part, &mut locations).map(|()| locations)
        })
        .collect();
    for part in parts {
        for location in part? {
            let text: &[u8] = match location {
                Location::Inside => b"inside\n",
                Location::Outside => b"outside\n",
                Location::Boundary => b"boundary\n",
            };
            out.write_all(text)?;
        }
    }
    Ok(())
}
