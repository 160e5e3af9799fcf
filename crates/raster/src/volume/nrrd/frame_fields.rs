//! Georeferencing of an NRRD volume.

use super::field;
use super::header::Fields;
use spinney_base::Result;
use spinney_container::{Metadata, Tag};
use spinney_crs::Frame;

/// Units of length with names known to trees, and their other names.
const UNITS: [(&str, &[&str]); 6] = [
    ("mm", &["mm", "millimeter", "millimetre", "millimeters", "millimetres"]),
    ("cm", &["cm", "centimeter", "centimetre"]),
    ("m", &["m", "meter", "metre"]),
    ("km", &["km", "kilometer", "kilometre"]),
    ("in", &["in", "inch"]),
    ("ft", &["ft", "foot", "feet"]),
];

/// Converts georeferencing fields to metadata: directions and origin in space, or otherwise
/// spacings, minima and maxima along the axes; and the unit. The first `skipped` axes are not
/// spatial; `size` is the size of the others.
///
/// # Errors
/// If a field is invalid, or the transform of cells to the world has no inverse.
pub(super) fn read_frame(
    fields: &mut Fields<'_>,
    dimension: usize,
    skipped: usize,
    size: [u64; 3],
    metadata: &mut Metadata,
) -> Result<()> {
    let centers = fields.take(&["centers", "centerings"]);
    if let Some((line, text)) = &centers {
        let words = field::words(text, dimension);
        let words = words
            .ok_or_else(|| fields.wrong(*line, text, format!("{dimension} words, cell, node or ???")))?;
        metadata.frame.pixel_is_point = words[skipped..].iter().all(|word| *word == "node");
    }
    let directions = fields.take(&["space directions"]);
    let origin = fields.take(&["space origin"]);
    if let Some((line, text)) = directions {
        let expected = format!("{dimension} vectors of three numbers, as in (0.5,0,0), or none");
        let vectors =
            field::vectors(&text, dimension, 3).ok_or_else(|| fields.wrong(line, &text, &*expected))?;
        let axes: Option<Vec<Vec<f64>>> = vectors.into_iter().skip(skipped).collect();
        let axes = axes.ok_or_else(|| fields.wrong(line, &text, &*expected))?;
        let first = match origin {
            None => vec![0.0; 3],
            Some((line, text)) => {
                let vector = field::vectors(&text, 1, 3).and_then(|mut vectors| vectors.pop().flatten());
                vector.ok_or_else(|| {
                    fields.wrong(line, &text, "a vector of three numbers, as in (-120,-100,0)")
                })?
            }
        };
        // The origin is the centre of the first cell.
        metadata.frame.matrix = std::array::from_fn(|row| {
            let [x, y, z] = std::array::from_fn(|axis| axes[axis][row]);
            [x, y, z, first[row] - (x + y + z) / 2.0]
        });
        check(&metadata.frame).map_err(|expected| fields.wrong(line, &text, expected))?;
    } else {
        // NaN means unknown.
        let (mut widths, mut begins, mut ends) = ([f64::NAN; 3], [f64::NAN; 3], [f64::NAN; 3]);
        let mut line_of_widths = None;
        let numbers = |fields: &Fields<'_>, (line, text): &(u64, String)| -> Result<Vec<f64>> {
            let numbers: Option<Vec<f64>> = field::words(text, dimension)
                .and_then(|words| words.iter().map(|word| word.parse().ok()).collect());
            numbers.ok_or_else(|| fields.wrong(*line, text, format!("{dimension} numbers")))
        };
        for (names, list) in [
            (&["spacings"][..], &mut widths),
            (&["axis mins", "axismins"], &mut begins),
            (&["axis maxs", "axismaxs"], &mut ends),
        ] {
            if let Some(field) = fields.take(names) {
                list.copy_from_slice(&numbers(fields, &field)?[skipped..]);
                line_of_widths.get_or_insert(field);
            }
        }
        // Minimum and maximum are the outer edges of the first and last cell, or their centres in
        // node-centred volumes.
        let half = if metadata.frame.pixel_is_point { 0.5 } else { 0.0 };
        for axis in 0..3 {
            let known = |number: f64, other: f64| if number.is_nan() { other } else { number };
            let steps = size[axis] as f64 - 2.0 * half;
            let (begin, end) = (begins[axis], ends[axis]);
            // A single sample has no spacing.
            let between = if steps > 0.0 { (end - begin) / steps } else { f64::NAN };
            widths[axis] = known(known(widths[axis], between), 1.0);
            begins[axis] = known(known(begin, end - steps * widths[axis]), 0.0);
            metadata.frame.matrix[axis] = [0.0; 4];
            metadata.frame.matrix[axis][axis] = widths[axis];
            metadata.frame.matrix[axis][3] = begins[axis] - half * widths[axis];
        }
        if let Some((line, text)) = line_of_widths {
            check(&metadata.frame).map_err(|expected| fields.wrong(line, &text, expected))?;
        }
    }
    for name in ["space units", "units"] {
        let Some((line, text)) = fields.take(&[name]) else { continue };
        let (count, skipped) = if name == "units" { (dimension, skipped) } else { (3, 0) };
        let units = field::quoted(&text, count);
        let units =
            units.ok_or_else(|| fields.wrong(line, &text, format!("{count} strings in quotation marks")))?;
        let units = &units[skipped..];
        let known = UNITS
            .iter()
            .find(|(_, names)| units.iter().all(|unit| names.contains(&&*unit.to_ascii_lowercase())));
        match known {
            Some((unit, _)) => metadata.set_tag(Tag::Unit, *unit),
            None => fields.keep(name, line, text),
        }
    }
    Ok(())
}

/// Fails if the transform has no inverse.
fn check(frame: &Frame) -> Result<(), &'static str> {
    let is_finite = frame.matrix.iter().flatten().all(|number| number.is_finite());
    match is_finite && frame.to_cells([0.0; 3]).is_some() {
        true => Ok(()),
        false => Err("an invertible map from cells to the world"),
    }
}
