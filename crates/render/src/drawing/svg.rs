//! Drawings as SVG 1.1.

use std::fmt::Write as _;
use std::io::Write as _;

use super::marks::{Ink, LINE_WIDTH, Marks};
use crate::RenderRequest;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};

/// Limit of coordinates, in hundredths of a pixel. Farther points are clamped.
const FAR: f64 = 1e12;

/// Bytes that are buffered before they are written.
const PART: usize = 1 << 16;

/// Width of the stroke around polygons, in their colour. Without it, antialiasing lets the
/// background show through between adjacent polygons.
const SEAM: f64 = 0.5;

/// Writes marks as paths. Coordinates have two decimal places, so that smaller differences between
/// machines do not show.
pub(super) fn write(
    marks: &Marks,
    request: &RenderRequest,
    mut output: Output,
    progress: &dyn Progress,
) -> Result<()> {
    let path = output.path().to_path_buf();
    let (width, height) = (request.width, request.height);
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\">\n"
    );
    if let Some(background) = marks.background {
        let colour = hex(background);
        // Writing to a `String` does not fail.
        let _ = writeln!(text, "<rect width=\"{width}\" height=\"{height}\" fill=\"{colour}\"/>");
    }
    text.push_str("<g stroke-linejoin=\"round\" stroke-linecap=\"round\">\n");
    let line = hex(marks.line_colour());
    for (ink, points) in marks.each() {
        match ink {
            Ink::Fill(colour) => {
                let colour = hex(colour);
                let _ =
                    write!(text, "<path fill=\"{colour}\" stroke=\"{colour}\" stroke-width=\"{SEAM}\" d=\"");
                for (number, point) in points.iter().enumerate() {
                    push_point(&mut text, if number == 0 { 'M' } else { 'L' }, *point);
                }
                text.push_str("Z\"/>\n");
            }
            Ink::Lines => {
                let _ =
                    write!(text, "<path fill=\"none\" stroke=\"{line}\" stroke-width=\"{LINE_WIDTH}\" d=\"");
                for (number, segment) in points.chunks_exact(2).enumerate() {
                    if number == 0 || points[2 * number - 1] != segment[0] {
                        push_point(&mut text, 'M', segment[0]);
                    }
                    push_point(&mut text, 'L', segment[1]);
                }
                text.push_str("\"/>\n");
            }
        }
        if text.len() > PART {
            progress.check()?;
            output.write_all(text.as_bytes()).map_err(Error::io(&path, "write"))?;
            text.clear();
        }
    }
    text.push_str("</g>\n</svg>\n");
    output.write_all(text.as_bytes()).map_err(Error::io(&path, "write"))?;
    output.commit()
}

fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn push_point(text: &mut String, command: char, [x, y]: [f64; 2]) {
    text.push(command);
    push_number(text, x);
    text.push(' ');
    push_number(text, y);
}

/// Appends a number with at most two decimal places.
fn push_number(text: &mut String, number: f64) {
    let hundredths = (number * 100.0).round().clamp(-FAR, FAR) as i64;
    let (whole, rest) = (hundredths.unsigned_abs() / 100, hundredths.unsigned_abs() % 100);
    let sign = if hundredths < 0 { "-" } else { "" };
    let _ = match (rest, rest % 10) {
        (0, _) => write!(text, "{sign}{whole}"),
        (_, 0) => write!(text, "{sign}{whole}.{}", rest / 10),
        _ => write!(text, "{sign}{whole}.{rest:02}"),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_two_digits_at_most() {
        let text = |number: f64| {
            let mut text = String::new();
            push_number(&mut text, number);
            text
        };
        let numbers = [0.0, -0.001, 1.5, -0.25, 12.999, 0.05, -100.0, 1e300, f64::NAN].map(text);
        assert_eq!(numbers, ["0", "0", "1.5", "-0.25", "13", "0.05", "-100", "10000000000", "0"]);
    }
}
