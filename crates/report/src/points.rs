//! Samples of single cells, of all layers of a file.

use std::io::Write as _;

use serde_json::json;
use spinney_base::value::{Number, SampleType};
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PointSamples;

use crate::printable_json;

/// The cell of points that are outside of the picture.
pub const OUTSIDE: [u64; 3] = [u64::MAX; 3];

/// Layers that are asked for single cells: those of the layer with the smallest cells, at one level.
pub struct PointLayers<'a> {
    trees: &'a [&'a Dataset],
    /// Levels of the one with the smallest cells.
    depth: u8,
    level: u8,
    axes: usize,
    places: CellLocator,
}

impl<'a> PointLayers<'a> {
    /// The layers of a file, of which there is at least one, and places in some coordinates; without a level the deepest.
    ///
    /// # Errors
    /// If there is no such level, or no way from the coordinates to the cells.
    pub fn new(
        trees: &'a [&'a Dataset],
        coordinates: &Coordinates,
        level: Option<u8>,
    ) -> Result<PointLayers<'a>> {
        let finest = trees.iter().max_by_key(|tree| tree.depth()).expect("a file has a layer");
        let depth = finest.depth();
        let level = level.unwrap_or(depth);
        if level > depth {
            return Err(Error::invalid(
                "level",
                level.to_string(),
                format!("one of the tree's, 0 to {depth}"),
            ));
        }
        let places = CellLocator::new(coordinates, &finest.metadata().frame, finest.header().extent)?;
        Ok(PointLayers { trees, depth, level, axes: finest.header().form.axes(), places })
    }

    /// Coordinates that a point has: two in quadtrees, three in octrees.
    pub fn axes(&self) -> usize {
        self.axes
    }

    /// The way from the coordinates to cells.
    pub fn places(&self) -> &CellLocator {
        &self.places
    }

    /// The cell of the level in which a point lies; [`OUTSIDE`] if that is not in the picture.
    pub fn cell(&self, point: [f64; 3]) -> [u64; 3] {
        // (Quadtrees have one layer, wherever that is.)
        let flat = |[x, y, z]: [f64; 3]| if self.axes == 3 { [x, y, z] } else { [x, y, 0.0] };
        let cell = self.places.cell(point).map(flat).filter(|cell| self.places.is_inside(*cell));
        let shift = self.depth - self.level;
        cell.map_or(OUTSIDE, |cell| cell.map(|coordinate| coordinate.floor() as u64 >> shift))
    }

    /// Samples of some cells, of all layers.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn ask<'c>(&self, cells: &'c [[u64; 3]]) -> Result<PointReport<'c>> {
        let of_layers = self.trees.iter().map(|tree| {
            // A layer of larger cells has the same levels, but for the deepest.
            let shift = self.level.saturating_sub(tree.depth());
            let (level, mut samples) = (self.level - shift, PointSamples::default());
            let coarser =
                |cell: &[u64; 3]| if *cell == OUTSIDE { OUTSIDE } else { cell.map(|at| at >> shift) };
            let cells: Vec<[u64; 3]> = cells.iter().map(coarser).collect();
            tree.points(&cells, level, &mut samples)?;
            Ok((samples, tree.header().form.value.sample == SampleType::F64))
        });
        Ok(PointReport { cells, of_layers: of_layers.collect::<Result<_>>()? })
    }

    /// The beginning of each layer's answer in JSON: its name and its time.
    pub fn headings(&self) -> Vec<String> {
        let heading = |tree: &&Dataset| {
            let (layer, time) = (json!(tree.metadata().name), json!(tree.metadata().time));
            printable_json(&format!("{{\"layer\":{layer},\"time\":{time},\"samples\":")).into_owned()
        };
        self.trees.iter().map(heading).collect()
    }
}

/// Samples of some cells, of all layers.
pub struct PointReport<'c> {
    cells: &'c [[u64; 3]],
    /// With whether samples are of double precision.
    of_layers: Vec<(PointSamples, bool)>,
}

impl PointReport<'_> {
    /// Writes a cell's answer as text: samples of all layers with commas between, `void` or `outside`.
    ///
    /// # Panics
    /// If there were not so many cells.
    pub fn write_text(&self, index: usize, text: &mut Vec<u8>) {
        for (layer, (samples, is_double)) in self.of_layers.iter().enumerate() {
            if layer > 0 {
                text.push(b',');
            }
            match samples.get(index) {
                Some(numbers) => {
                    for (channel, number) in numbers.iter().enumerate() {
                        if channel > 0 {
                            text.push(b',');
                        }
                        write_number(*number, *is_double, text);
                    }
                }
                None if self.cells[index] == OUTSIDE => text.extend(b"outside"),
                None => text.extend(b"void"),
            }
        }
        text.push(b'\n');
    }

    /// Writes a cell's answer as a line of JSON: `headings` are those of [`PointLayers::headings`].
    ///
    /// # Panics
    /// If there were not so many cells.
    pub fn write_json(&self, headings: &[String], index: usize, text: &mut Vec<u8>) {
        let is_outside = if self.cells[index] == OUTSIDE { "true" } else { "false" };
        text.extend(format!("{{\"outside\":{is_outside},\"layers\":[").bytes());
        for (layer, (heading, (samples, is_double))) in headings.iter().zip(&self.of_layers).enumerate() {
            if layer > 0 {
                text.push(b',');
            }
            text.extend(heading.bytes());
            match samples.get(index) {
                Some(numbers) => {
                    for (channel, number) in numbers.iter().enumerate() {
                        text.push(if channel > 0 { b',' } else { b'[' });
                        // (JSON has no word for what is not finite.)
                        if number.is_finite() {
                            write_number(*number, *is_double, text);
                        } else {
                            text.extend(b"null");
                        }
                    }
                    text.extend(b"]}");
                }
                None => text.extend(b"null}"),
            }
        }
        text.extend(b"]}\n");
    }
}

/// Writes a number; a whole one, as most are, without the detour over floating-point printing.
pub fn write_number(number: Number, is_double: bool, text: &mut Vec<u8>) {
    let written = match number {
        Number::Float(number) if number as i64 as f64 == number => write!(text, "{}", number as i64),
        Number::Float(number) if !is_double => write!(text, "{}", number as f32),
        number => write!(text, "{number}"),
    };
    debug_assert!(written.is_ok(), "writing to memory");
}
