//! Legends as raster images.

use super::super::blend::Blend;
use super::text::Letters;
use super::{Key, Legend, LegendClass};

/// A raster image: red, green, blue and straight alpha of each pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Four bytes per pixel.
    pub rgba: Vec<u8>,
}

/// In pixels at scale 1: padding, line height, side of a colour box, width of a ramp, gap between
/// labels.
const PADDING: usize = 6;
const LINE: usize = 13;
const BOX: usize = 9;
const BAND: usize = 180;
const GAP: usize = 4;
/// How far text extends above the colour box next to it.
const RAISED: usize = 2;

/// Draws a legend on white, enlarged by the factor `scale`.
pub(super) fn draw_image(legend: &Legend, scale: usize) -> LegendImage {
    let letters = Letters::new(scale);
    // Measure first, then draw.
    let mut size = Canvas { scale, letters: &letters, width: 0, height: 0, rgba: None };
    content(legend, &mut size);
    let (width, height) = (size.width + PADDING * scale, size.height + PADDING * scale);
    let rgba = Some(vec![255; 4 * width * height]);
    let mut canvas = Canvas { scale, letters: &letters, width, height, rgba };
    content(legend, &mut canvas);
    LegendImage { width, height, rgba: canvas.rgba.unwrap_or_default() }
}

fn content(legend: &Legend, canvas: &mut Canvas<'_>) {
    let scale = canvas.scale;
    let mut y = PADDING;
    if !legend.title.is_empty() {
        // Bold: drawn twice with an offset.
        canvas.text(PADDING * scale, y, &legend.title);
        canvas.text(PADDING * scale + scale.div_ceil(3), y, &legend.title);
        y += LINE + 2;
    }
    for section in &legend.sections {
        if !section.title.is_empty() {
            canvas.text(PADDING * scale, y, &section.title);
            y += LINE;
        }
        match &section.key {
            Key::Classes(classes) => {
                for LegendClass { colour: code, name, .. } in classes {
                    canvas.framed(PADDING, y, BOX, &[*code]);
                    canvas.text((PADDING + BOX + GAP) * scale, y - RAISED, name);
                    y += LINE;
                }
            }
            Key::Ramp { colours, ticks } => {
                canvas.framed(PADDING, y, BAND, colours);
                y += BOX;
                let (begin, end) = (PADDING * scale, (PADDING + BAND) * scale);
                let mut free = 0;
                for tick in ticks {
                    let x = PADDING + (tick.at.clamp(0.0, 1.0) * (BAND - 1) as f64).round() as usize;
                    canvas.fill([x, y, 1, 3], [0, 0, 0, 255]);
                    let width = canvas.letters.line(&tick.label).width;
                    let middle = x * scale + scale / 2;
                    let start = middle.saturating_sub(width / 2).min(end.saturating_sub(width)).max(begin);
                    // Omit labels that would overlap others.
                    if start >= free {
                        canvas.text(start, y + GAP, &tick.label);
                        free = start + width + GAP * scale;
                    }
                }
                y += LINE + GAP;
            }
        }
        y += 3;
    }
}

/// An image to draw on; without pixels, it only measures the required size.
struct Canvas<'a> {
    scale: usize,
    letters: &'a Letters,
    width: usize,
    height: usize,
    rgba: Option<Vec<u8>>,
}

impl Canvas<'_> {
    /// Extends the measured size to these columns and rows of pixels.
    fn extend(&mut self, width: usize, height: usize) {
        self.width = self.width.max(width);
        self.height = self.height.max(height);
    }

    /// Blends a colour over a rectangle (x, y, columns, rows), in pixels at scale 1.
    fn fill(&mut self, part: [usize; 4], colour: [u8; 4]) {
        let [x, y, columns, rows] = part.map(|pixels| pixels * self.scale);
        let Some(rgba) = &mut self.rgba else { return self.extend(x + columns, y + rows) };
        let (pixels, _) = rgba.as_chunks_mut::<4>();
        for row in y..y + rows {
            for pixel in &mut pixels[row * self.width + x..][..columns] {
                *pixel = Blend::Normal.over(*pixel, colour);
            }
        }
    }

    /// A framed box with a row of colours.
    fn framed(&mut self, x: usize, y: usize, columns: usize, colours: &[[u8; 4]]) {
        self.fill([x, y, columns, BOX], [0x60, 0x60, 0x60, 255]);
        self.fill([x + 1, y + 1, columns - 2, BOX - 2], [255; 4]);
        for column in 0..columns - 2 {
            let colour = colours[column * (colours.len() - 1) / (columns - 3)];
            self.fill([x + 1 + column, y + 1, 1, BOX - 2], colour);
        }
    }

    /// A line of text that starts at pixel column `x`, below pixel row `y` at scale 1.
    fn text(&mut self, x: usize, y: usize, text: &str) {
        let line = self.letters.line(text);
        let top = y * self.scale;
        let Some(rgba) = &mut self.rgba else { return self.extend(x + line.width, (y + LINE) * self.scale) };
        let (pixels, _) = rgba.as_chunks_mut::<4>();
        line.draw(&mut |[column, row], cover| {
            // Clip letters at the image border.
            let place = [x as i64 + i64::from(column), top as i64 + i64::from(row)];
            let inside =
                (0..self.width as i64).contains(&place[0]) && (0..self.height as i64).contains(&place[1]);
            if inside {
                let pixel = &mut pixels[place[1] as usize * self.width + place[0] as usize];
                *pixel = Blend::Normal.over(*pixel, [0, 0, 0, (cover * 255.0 + 0.5) as u8]);
            }
        });
    }
}
