//! `spinney point` of an exact model.

use std::io::{self, BufRead as _, Write};

use anyhow::{Context as _, Result, anyhow};
use rayon::prelude::*;
use spinney::brep::{FaceBuffer, Faces, Location};
use spinney::raw::brep::ModelView;

use super::super::report::PrintableWriter;

/// Points that are located together.
const BATCH: usize = 1 << 16;

/// A query of points.
#[derive(Clone, Copy)]
pub(crate) enum PointQuery {
    /// Their location: inside, boundary or outside.
    Position,
    /// Their location, and the object with the nearest face.
    Object,
    /// Their distance from the surface.
    Distance,
}

/// Prints a result for each point, given in the world: points of the command line, or of standard
/// input if there are none.
pub(crate) fn points(view: &ModelView, points: &[String], query: PointQuery) -> Result<()> {
    each_batch(view, points, "X,Y,Z", &mut |points, _, out| match query {
        PointQuery::Position => print_locations(view, points, out),
        PointQuery::Object => print_objects(view, points, out),
        PointQuery::Distance => print_distances(view, points, out),
    })
}

/// Prints the hits of rays, each an origin and a direction in the world: the first hit, or all.
pub(crate) fn rays(view: &ModelView, rays: &[String], is_all: bool) -> Result<()> {
    let mut is_begun = false;
    each_batch(view, rays, "X,Y,Z,DX,DY,DZ", &mut |rays: &[[f64; 6]], first, out| {
        if !std::mem::replace(&mut is_begun, true) {
            out.write_all(b"ray,distance,x,y,z,face,part,enters\n")?;
        }
        let parts: Vec<spinney::Result<Vec<u8>>> = rays
            .par_chunks(1 << 10)
            .enumerate()
            .map(|(part, rays)| format_rays(view, rays, first + (part << 10) as u64, is_all))
            .collect();
        parts.into_iter().try_for_each(|part| Ok(out.write_all(&part?)?))
    })
}

/// Function that prints results for lines of `N` numbers. The second argument is the first line's
/// number.
type LinePrinter<'a, const N: usize> = dyn FnMut(&[[f64; N]], u64, &mut dyn Write) -> Result<()> + 'a;

/// Reads lines of numbers of the command line, or of standard input if there are none, and
/// processes them in batches.
fn each_batch<const N: usize>(
    view: &ModelView,
    lines: &[String],
    wanted: &str,
    print: &mut LinePrinter<'_, N>,
) -> Result<()> {
    let mut out = PrintableWriter::new(io::BufWriter::with_capacity(1 << 20, io::stdout().lock()));
    if !lines.is_empty() {
        let lines = lines.iter().zip(1..).map(|(text, number)| parse(text, "point", number, wanted));
        print(&lines.collect::<Result<Vec<_>>>()?, 1, &mut out)?;
    } else {
        let (mut batch, mut first) = (Vec::with_capacity(BATCH), 1);
        for (line, number) in io::stdin().lock().lines().zip(1..) {
            let line = line.context("standard input")?;
            if line.trim().is_empty() {
                continue;
            }
            batch.push(parse(&line, "standard input, line", number, wanted)?);
            if batch.len() == BATCH {
                print(&batch, first, &mut out)?;
                first += batch.len() as u64;
                batch.clear();
            }
        }
        print(&batch, first, &mut out)?;
    }
    out.flush()?;
    Ok(view.file().check_unchanged()?)
}

fn parse<const N: usize>(line: &str, from: &str, number: u64, wanted: &str) -> Result<[f64; N]> {
    let wrong = || anyhow!("{from} {number}: got `{}`, expected {wanted}", line.trim());
    let words = line.split([',', ' ', '\t', ';']).map(str::trim).filter(|word| !word.is_empty());
    let numbers: Vec<f64> = words
        .map(|word| word.parse().ok().filter(|number: &f64| number.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(wrong)?;
    let numbers: [f64; N] = numbers.try_into().map_err(|_| wrong())?;
    // (A zero direction is invalid.)
    if N == 6 && numbers[3..].iter().all(|along| *along == 0.0) { Err(wrong()) } else { Ok(numbers) }
}

fn print_locations(view: &ModelView, points: &[[f64; 3]], out: &mut dyn Write) -> Result<()> {
    let parts: Vec<_> = points
        .par_chunks(1 << 12)
        .map(|part| {
            let mut locations = Vec::with_capacity(part.len());
            view.locate_all(part, &mut locations).map(|()| locations)
        })
        .collect();
    for part in parts {
        for location in part? {
            writeln!(out, "{}", name_of(location))?;
        }
    }
    Ok(())
}

fn name_of(location: Location) -> &'static str {
    match location {
        Location::Inside => "inside",
        Location::Outside => "outside",
        Location::Boundary => "boundary",
    }
}

fn print_objects(view: &ModelView, points: &[[f64; 3]], out: &mut dyn Write) -> Result<()> {
    let object = |point: &[f64; 3]| -> spinney::Result<(Location, Option<u32>)> {
        let location = view.locate(*point)?;
        let nearest = if location == Location::Outside { None } else { view.nearest(*point)? };
        let Some(nearest) = nearest else { return Ok((location, None)) };
        let mut buffer = FaceBuffer::default();
        view.file().face(nearest.face, &mut buffer)?;
        Ok((location, Some(buffer.face().part)))
    };
    let found: Vec<spinney::Result<(Location, Option<u32>)>> =
        points.par_iter().with_min_len(1 << 6).map(object).collect();
    for found in found {
        let (location, part) = found?;
        let name = part.and_then(|part| view.file().parts().get(part as usize));
        writeln!(out, "{}{}", name_of(location), name.map_or(String::new(), |name| format!("\t{name}")))?;
    }
    Ok(())
}

fn print_distances(view: &ModelView, points: &[[f64; 3]], out: &mut dyn Write) -> Result<()> {
    let distances: Vec<spinney::Result<f64>> =
        points.par_iter().with_min_len(1 << 6).map(|point| view.signed_distance(*point)).collect();
    distances.into_iter().try_for_each(|distance| Ok(writeln!(out, "{}", distance?)?))
}

/// Formats the hits of rays. `first` is the first ray's number.
fn format_rays(view: &ModelView, rays: &[[f64; 6]], first: u64, is_all: bool) -> spinney::Result<Vec<u8>> {
    let (mut text, mut caster) = (Vec::new(), view.rays());
    for ([x, y, z, u, v, w], ray) in rays.iter().zip(first..) {
        let (from, along) = ([*x, *y, *z], [*u, *v, *w]);
        let hits = match is_all {
            true => view.ray_crossings(from, along)?,
            false => caster.first(from, along)?.into_iter().collect(),
        };
        for hit in hits {
            let ([x, y, z], enters) = (hit.point, u8::from(hit.is_entry));
            let line = format!("{ray},{},{x},{y},{z},{},{},{enters}\n", hit.share, hit.face, hit.part);
            text.extend_from_slice(line.as_bytes());
        }
    }
    Ok(text)
}
