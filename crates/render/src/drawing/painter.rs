//! Rasterizes drawings: each sample has the colour of the last mark that covers it.

use super::marks::{Ink, LINE_WIDTH, Marks};
use crate::{RenderRequest, colours_of};
use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_raster::image::{Format, create};
use spinney_style::{to_linear, to_srgb};

/// Maximum number of samples in memory, unless a single row has more.
const SAMPLES: u64 = 1 << 22;

/// Colour of samples that no mark covers.
const NOTHING: u32 = u32::MAX;

/// Rows of samples that are painted together. Coordinates are in samples from the image's upper
/// left corner.
struct Band {
    columns: usize,
    first: usize,
    rows: usize,
    samples: Vec<u32>,
    /// Scratch buffer: x coordinates at which a row crosses a polygon.
    crossings: Vec<f64>,
}

/// Rasterizes marks and writes the image in bands of rows.
pub(super) fn write(
    marks: &Marks,
    request: &RenderRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let (width, height, samples) = (request.width, request.height, u64::from(request.samples));
    let spec = colours_of(width, height, marks.background.is_some());
    let mut writer = create(output, format, &spec)?;
    let rows = (SAMPLES / (width * samples * samples)).clamp(1, height);
    let mut band = Band {
        columns: (width * samples) as usize,
        first: 0,
        rows: 0,
        samples: Vec::new(),
        crossings: Vec::new(),
    };
    for first in (0..height).step_by(rows as usize) {
        let rows = rows.min(height - first);
        (band.first, band.rows) = ((first * samples) as usize, (rows * samples) as usize);
        band.samples.clear();
        band.samples.resize(band.columns * band.rows, NOTHING);
        band.paint(marks, samples as f64, progress)?;
        writer.write_rows(&band.pixels(marks.background, samples as usize), None)?;
        progress.advance(rows * width, width * height);
    }
    writer.finish()
}

fn packed([red, green, blue]: [u8; 3]) -> u32 {
    u32::from_be_bytes([0, red, green, blue])
}

/// Marks between checks for cancellation.
const OFTEN: usize = 1 << 12;

impl Band {
    fn paint(&mut self, marks: &Marks, samples: f64, progress: &dyn Progress) -> Result<()> {
        let line = packed(marks.line_colour());
        for (number, (ink, points)) in marks.each().enumerate() {
            if number.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            match ink {
                Ink::Fill(colour) => {
                    self.polygon(points.iter().map(|point| point.map(|at| at * samples)), packed(colour))
                }
                Ink::Lines => {
                    for segment in points.chunks_exact(2) {
                        let ends = [segment[0], segment[1]].map(|end| end.map(|at| at * samples));
                        self.polygon(stroke(ends, LINE_WIDTH / 2.0 * samples).into_iter(), line);
                    }
                }
            }
        }
        Ok(())
    }

    /// Fills the samples inside of a convex polygon with a colour.
    fn polygon(&mut self, corners: impl Iterator<Item = [f64; 2]> + Clone, colour: u32) {
        let heights = corners.clone().map(|[_, y]| y);
        let (low, high) =
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
        // Rows with centres from `low` to `high`. (A polygon whose coordinates are all NaN has
        // none.)
        let row =
            |y: f64| (y - 0.5).ceil().clamp(self.first as f64, (self.first + self.rows) as f64) as usize;
        let (from, to) = (row(low), row(high));
        for row in from..to {
            let y = row as f64 + 0.5;
            self.crossings.clear();
            let ends = corners.clone().zip(corners.clone().cycle().skip(1));
            self.crossings.extend(
                ends.filter(|([_, a], [_, b])| (*a <= y) != (*b <= y))
                    .map(|([ax, ay], [bx, by])| ax + (bx - ax) * ((y - ay) / (by - ay))),
            );
            let (left, right) = self
                .crossings
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(left, right), x| (left.min(*x), right.max(*x)));
            let column = |x: f64| (x - 0.5).ceil().clamp(0.0, self.columns as f64) as usize;
            let (from, to) = (column(left), column(right));
            if from < to {
                let start = (row - self.first) * self.columns;
                self.samples[start + from..start + to].fill(colour);
            }
        }
    }

    /// Pixels of the band: the mean of their samples' linear light. Without a background, the
    /// fraction of covered samples is the opacity.
    fn pixels(&self, background: Option<[u8; 3]>, samples: usize) -> Vec<u8> {
        let (columns, rows) = (self.columns / samples, self.rows / samples);
        let mut pixels = Vec::with_capacity(columns * rows * if background.is_some() { 3 } else { 4 });
        let unpacked = |colour: u32| {
            let [_, red, green, blue] = colour.to_be_bytes();
            [red, green, blue]
        };
        for row in 0..rows {
            for column in 0..columns {
                let of_row = |i: usize| {
                    let start = (row * samples + i) * self.columns + column * samples;
                    &self.samples[start..start + samples]
                };
                let all = (0..samples).flat_map(of_row);
                let first = of_row(0)[0];
                if all.clone().all(|sample| *sample == first) {
                    match (first == NOTHING, background) {
                        (true, None) => pixels.extend([0; 4]),
                        (true, Some(background)) => pixels.extend(background),
                        (false, None) => pixels.extend(unpacked(first).into_iter().chain([255])),
                        (false, Some(_)) => pixels.extend(unpacked(first)),
                    }
                    continue;
                }
                let (mut sum, mut count) = ([0.0; 3], 0.0);
                for sample in all {
                    let colour = if *sample == NOTHING { background } else { Some(unpacked(*sample)) };
                    if let Some(colour) = colour {
                        (0..3).for_each(|i| sum[i] += to_linear(f64::from(colour[i]) / 255.0));
                        count += 1.0;
                    }
                }
                pixels.extend(sum.map(|sum| to_srgb(sum / count)));
                if background.is_none() {
                    pixels.push((count / (samples * samples) as f64 * 255.0 + 0.5) as u8);
                }
            }
        }
        pixels
    }
}

/// Rectangle around a line segment, extended by a quarter of the line width so that lines meet at
/// corners.
fn stroke([[ax, ay], [bx, by]]: [[f64; 2]; 2], half: f64) -> [[f64; 2]; 4] {
    let length = (bx - ax).hypot(by - ay);
    let [x, y] =
        if length > 0.0 { [(bx - ax) / length * half, (by - ay) / length * half] } else { [half, 0.0] };
    let longer = 0.5;
    let (from, to) = ([ax - longer * x, ay - longer * y], [bx + longer * x, by + longer * y]);
    [[from[0] - y, from[1] + x], [to[0] - y, to[1] + x], [to[0] + y, to[1] - x], [from[0] + y, from[1] - x]]
}
