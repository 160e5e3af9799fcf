//! `spinney point` of an exact model.

use std::io::{self, BufRead as _, Write};

use anyhow::{Context as _, Result, anyhow, bail};
use rayon::prelude::*;
use spinney::ExactModel;
use spinney::brep::{FaceBuffer, Faces, Location};
use spinney::raw::brep::ModelView;

use super::super::report::{PrintableWriter, csv_field};

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
/// input if there are none. `attribute` is the names of columns of face values that follow.
pub(crate) fn points(
    view: &ModelView,
    points: &[String],
    query: PointQuery,
    attribute: Option<&str>,
) -> Result<()> {
    let columns = PrintedColumns::of(view.file(), attribute)?;
    each_batch(view, points, "X,Y,Z", &mut |points, _, out| match query {
        PointQuery::Position if columns.names.is_empty() => print_locations(view, points, out),
        PointQuery::Position | PointQuery::Object => {
            let is_object = matches!(query, PointQuery::Object);
            print_faces(points, out, &|point| location_of_face(view, point, is_object, &columns))
        }
        PointQuery::Distance => print_faces(points, out, &|point| distance(view, point, &columns)),
    })
}

/// Prints the hits of rays, each an origin and a direction in the world: the first hit, or all.
/// `attribute` is the names of columns of face values that follow.
pub(crate) fn rays(view: &ModelView, rays: &[String], is_all: bool, attribute: Option<&str>) -> Result<()> {
    let columns = PrintedColumns::of(view.file(), attribute)?;
    let mut is_begun = false;
    each_batch(view, rays, "X,Y,Z,DX,DY,DZ", &mut |rays: &[[f64; 6]], first, out| {
        if !std::mem::replace(&mut is_begun, true) {
            let names: String = columns.names.iter().map(|name| format!(",{}", csv_field(name))).collect();
            writeln!(out, "ray,distance,x,y,z,face,part,enters{names}")?;
        }
        let parts: Vec<spinney::Result<Vec<u8>>> = rays
            .par_chunks(1 << 10)
            .enumerate()
            .map(|(part, rays)| format_rays(view, rays, first + (part << 10) as u64, is_all, &columns))
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

/// Columns of face values that are printed.
struct PrintedColumns {
    /// Number of each in the model.
    numbers: Vec<u32>,
    names: Vec<String>,
}

impl PrintedColumns {
    /// Finds columns by their names, as in `material,type`.
    fn of(model: &ExactModel, attribute: Option<&str>) -> Result<PrintedColumns> {
        let mut columns = PrintedColumns { numbers: Vec::new(), names: Vec::new() };
        let Some(attribute) = attribute else { return Ok(columns) };
        let all = model.value_columns()?;
        for name in attribute.split(',').map(str::trim) {
            let Some(number) = all.iter().position(|own| own == name) else {
                let known: Vec<&str> = all.iter().take(20).map(String::as_str).collect();
                let known = if known.is_empty() { "none".into() } else { known.join(", ") };
                bail!(
                    "{}: --attribute {name}: its faces have no such value; they have {known}",
                    model.path().display()
                );
            };
            // (Models have at most 4096 columns.)
            columns.numbers.push(number as u32);
            columns.names.push(name.into());
        }
        Ok(columns)
    }

    /// Returns the values of a face, each after the separator.
    fn of_face(&self, model: &ExactModel, face: u64, separator: char) -> spinney::Result<String> {
        let mut text = String::new();
        for column in &self.numbers {
            // (Models have less than 2^32 faces.)
            let value = model.face_value(*column, face as u32)?.map_or(String::new(), printed);
            text.push(separator);
            text.push_str(&if separator == ',' { csv_field(&value) } else { value.as_str().into() });
        }
        Ok(text)
    }
}

/// Returns the string in JSON, or the JSON if it is something else, or has control characters.
fn printed(json: String) -> String {
    match serde_json::from_str::<String>(&json) {
        Ok(text) if !text.contains(char::is_control) => text,
        _ => json,
    }
}

/// Function that returns the line of a point.
type PointLine<'a> = dyn Fn([f64; 3]) -> spinney::Result<String> + Sync + 'a;

fn print_faces(points: &[[f64; 3]], out: &mut dyn Write, line: &PointLine<'_>) -> Result<()> {
    let lines: Vec<spinney::Result<String>> =
        points.par_iter().with_min_len(1 << 6).map(|point| line(*point)).collect();
    lines.into_iter().try_for_each(|line| Ok(writeln!(out, "{}", line?)?))
}

/// Returns the location of a point and, if it is in or on the body, the object and the values of
/// the nearest face.
fn location_of_face(
    view: &ModelView,
    point: [f64; 3],
    is_object: bool,
    columns: &PrintedColumns,
) -> spinney::Result<String> {
    let location = view.locate(point)?;
    let mut line = name_of(location).to_string();
    let nearest = if location == Location::Outside { None } else { view.nearest(point)? };
    let Some(nearest) = nearest else { return Ok(line) };
    if is_object {
        let mut buffer = FaceBuffer::default();
        view.file().face(nearest.face, &mut buffer)?;
        let name = view.file().parts().get(buffer.face().part as usize);
        line += &name.map_or(String::new(), |name| format!("\t{name}"));
    }
    Ok(line + &columns.of_face(view.file(), nearest.face, '\t')?)
}

/// Returns the distance of a point and the values of the nearest face.
fn distance(view: &ModelView, point: [f64; 3], columns: &PrintedColumns) -> spinney::Result<String> {
    let distance = view.signed_distance(point)?.to_string();
    let nearest = if columns.names.is_empty() { None } else { view.nearest(point)? };
    let values = nearest.map(|nearest| columns.of_face(view.file(), nearest.face, '\t'));
    Ok(distance + &values.transpose()?.unwrap_or_default())
}

/// Formats the hits of rays. `first` is the first ray's number.
fn format_rays(
    view: &ModelView,
    rays: &[[f64; 6]],
    first: u64,
    is_all: bool,
    columns: &PrintedColumns,
) -> spinney::Result<Vec<u8>> {
    let (mut text, mut caster) = (Vec::new(), view.rays());
    for ([x, y, z, u, v, w], ray) in rays.iter().zip(first..) {
        let (from, along) = ([*x, *y, *z], [*u, *v, *w]);
        let hits = match is_all {
            true => view.ray_crossings(from, along)?,
            false => caster.first(from, along)?.into_iter().collect(),
        };
        for hit in hits {
            let ([x, y, z], enters) = (hit.point, u8::from(hit.is_entry));
            let values = columns.of_face(view.file(), hit.face, ',')?;
            let line =
                format!("{ray},{},{x},{y},{z},{},{},{enters}{values}\n", hit.share, hit.face, hit.part);
            text.extend_from_slice(line.as_bytes());
        }
    }
    Ok(text)
}
