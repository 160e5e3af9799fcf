//! Legends as pictures.

use super::super::blend::Blend;
use super::font::{ADVANCE, HEIGHT, WIDTH, glyph, width};
use super::{Key, Legend};

/// A picture: red, green, blue and straight opacity of each pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Four bytes per pixel.
    pub rgba: Vec<u8>,
}

/// In dots of the font: the edge, the height of a line, the side of a colour's box, the width of a band.
const PADDING: usize = 6;
const LINE: usize = 12;
const BOX: usize = 9;
const BAND: usize = 160;
/// Letters of a line; others are left out.
const MOST_LETTERS: usize = 80;

/// Draws a legend on white, in so many pixels per dot.
pub(super) fn picture(legend: &Legend, dot: usize) -> LegendImage {
    // (First its size, then its dots.)
    let mut size = Canvas { dot, columns: 0, rows: 0, rgba: None };
    content(legend, &mut size);
    let (columns, rows) = (size.columns + PADDING, size.rows + PADDING);
    let (width, height) = (columns * dot, rows * dot);
    let mut canvas = Canvas { dot, columns, rows, rgba: Some(vec![255; 4 * width * height]) };
    content(legend, &mut canvas);
    LegendImage { width, height, rgba: canvas.rgba.unwrap_or_default() }
}

fn content(legend: &Legend, canvas: &mut Canvas) {
    let mut y = PADDING;
    if !legend.title.is_empty() {
        // (Bold: twice, one dot apart.)
        canvas.text(PADDING, y, &legend.title);
        canvas.text(PADDING + 1, y, &legend.title);
        y += LINE + 2;
    }
    for section in &legend.sections {
        if !section.title.is_empty() {
            canvas.text(PADDING, y, &section.title);
            y += LINE;
        }
        match &section.key {
            Key::Classes(classes) => {
                for (code, name) in classes {
                    canvas.framed(PADDING, y - 1, BOX, &[*code]);
                    canvas.text(PADDING + BOX + 4, y, name);
                    y += LINE;
                }
            }
            Key::Ramp { colours, ticks } => {
                canvas.framed(PADDING, y - 1, BAND, colours);
                y += BOX;
                let mut free = 0;
                for tick in ticks {
                    let x = PADDING + (tick.at.clamp(0.0, 1.0) * (BAND - 1) as f64).round() as usize;
                    canvas.fill([x, y - 1, 1, 3], [0, 0, 0, 255]);
                    let length = width(&tick.label);
                    let start = (x.saturating_sub(length / 2))
                        .max(PADDING)
                        .min((PADDING + BAND).saturating_sub(length));
                    // Labels that would lie on others are left out.
                    if start >= free {
                        canvas.text(start, y + 4, &tick.label);
                        free = start + length + ADVANCE / 2;
                    }
                }
                y += LINE + 4;
            }
        }
        y += 3;
    }
}

/// Dots to be drawn on; without pixels, only how many are needed.
struct Canvas {
    dot: usize,
    columns: usize,
    rows: usize,
    rgba: Option<Vec<u8>>,
}

impl Canvas {
    /// Fills columns and rows of dots with a colour, over what is there.
    fn fill(&mut self, [x, y, columns, rows]: [usize; 4], colour: [u8; 4]) {
        let Canvas { dot, .. } = *self;
        let Some(rgba) = &mut self.rgba else {
            self.columns = self.columns.max(x + columns);
            self.rows = self.rows.max(y + rows);
            return;
        };
        let width = self.columns * dot;
        let (pixels, _) = rgba.as_chunks_mut::<4>();
        for row in y * dot..(y + rows) * dot {
            for pixel in &mut pixels[row * width + x * dot..][..columns * dot] {
                *pixel = Blend::Normal.over(*pixel, colour);
            }
        }
    }

    /// A box with colours side by side, and a frame of one dot.
    fn framed(&mut self, x: usize, y: usize, columns: usize, colours: &[[u8; 4]]) {
        self.fill([x, y, columns, BOX], [0x60, 0x60, 0x60, 255]);
        self.fill([x + 1, y + 1, columns - 2, BOX - 2], [255; 4]);
        for column in 0..columns - 2 {
            let colour = colours[column * (colours.len() - 1) / (columns - 3)];
            self.fill([x + 1 + column, y + 1, 1, BOX - 2], colour);
        }
    }

    /// A line of text, whose highest dots are in row `y`.
    fn text(&mut self, x: usize, y: usize, text: &str) {
        for (index, letter) in text.chars().take(MOST_LETTERS).enumerate() {
            let left = x + index * ADVANCE;
            for (row, dots) in glyph(letter).into_iter().enumerate() {
                for column in (0..WIDTH).filter(|column| dots >> (WIDTH - 1 - column) & 1 == 1) {
                    self.fill([left + column, y + row, 1, 1], [0, 0, 0, 255]);
                }
            }
        }
        // (Letters take their room also where they have no dots.)
        self.fill([x, y, text.chars().count().min(MOST_LETTERS) * ADVANCE, HEIGHT], [0; 4]);
    }
}
