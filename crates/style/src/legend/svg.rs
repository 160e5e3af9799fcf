//! Legends in SVG.

use std::fmt::Write as _;

use super::super::colour;
use super::{Key, Legend, LegendClass};

/// Line height, and side of a colour box.
const LINE: usize = 20;
const BOX: usize = 14;
const PADDING: usize = 10;
/// Width of a colour ramp, and maximum width of a letter.
const WIDTH: usize = 260;
const LETTER: usize = 8;
/// Number of gradient stops of a ramp.
const STOPS: usize = 33;

/// Formats the legend as an SVG document.
pub(super) fn document(legend: &Legend) -> String {
    let mut body = String::new();
    let (mut y, mut width) = (PADDING, WIDTH);
    let mut line = |body: &mut String, y: &mut usize, text: &str, weight: &str| {
        if !text.is_empty() {
            let _ = writeln!(
                body,
                "<text x=\"{PADDING}\" y=\"{}\" font-weight=\"{weight}\">{}</text>",
                *y + BOX,
                escaped(text)
            );
            *y += LINE;
            width = width.max(text.chars().count() * LETTER);
        }
    };
    line(&mut body, &mut y, &legend.title, "bold");
    let mut widest = 0;
    for (index, section) in legend.sections.iter().enumerate() {
        line(&mut body, &mut y, &section.title, "normal");
        match &section.key {
            Key::Classes(classes) => {
                for LegendClass { colour: code, name, .. } in classes {
                    let _ = writeln!(
                        body,
                        "<rect x=\"{PADDING}\" y=\"{y}\" width=\"{BOX}\" height=\"{BOX}\" {} stroke=\"#000000\" \
                         stroke-width=\"0.5\"/>\n<text x=\"{}\" y=\"{}\">{}</text>",
                        paint("fill", "fill-opacity", *code),
                        PADDING + LINE,
                        y + BOX - 2,
                        escaped(name)
                    );
                    y += LINE;
                    widest = widest.max(LINE + name.chars().count() * LETTER);
                }
            }
            Key::Ramp { colours, ticks } => {
                let _ = writeln!(body, "<linearGradient id=\"band{index}\">");
                for stop in 0..STOPS {
                    let code = colours[stop * (colours.len() - 1) / (STOPS - 1)];
                    let _ = writeln!(
                        body,
                        "<stop offset=\"{}\" {}/>",
                        stop as f64 / (STOPS - 1) as f64,
                        paint("stop-color", "stop-opacity", code)
                    );
                }
                let _ = writeln!(
                    body,
                    "</linearGradient>\n<rect x=\"{PADDING}\" y=\"{y}\" width=\"{WIDTH}\" height=\"{BOX}\" \
                     fill=\"url(#band{index})\" stroke=\"#000000\" stroke-width=\"0.5\"/>"
                );
                for tick in ticks {
                    let x = PADDING as f64 + tick.at * WIDTH as f64;
                    let anchor = match tick.at {
                        at if at < 0.05 => "start",
                        at if at > 0.95 => "end",
                        _ => "middle",
                    };
                    let _ = writeln!(
                        body,
                        "<path d=\"M{x:.1} {}v4\" stroke=\"#000000\"/>\n\
                         <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
                        y + BOX,
                        y + 2 * BOX + 3,
                        escaped(&tick.label)
                    );
                }
                y += 2 * LINE;
            }
        }
        y += PADDING / 2;
    }
    let (width, height) = (width.max(widest) + 2 * PADDING, y + PADDING / 2);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n\
         {body}</svg>\n"
    )
}

/// Attributes of a colour and its opacity.
fn paint(colour: &str, opacity: &str, code: [u8; 4]) -> String {
    let [red, green, blue, alpha] = code;
    let opaque = colour::text([red, green, blue, 255]);
    if alpha == 255 {
        return format!("{colour}=\"{opaque}\"");
    }
    format!("{colour}=\"{opaque}\" {opacity}=\"{:.3}\"", f64::from(alpha) / 255.0)
}

/// Escapes a string for XML, without characters that XML forbids.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '\u{fffe}' | '\u{ffff}' => {}
            other if other.is_control() => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}
