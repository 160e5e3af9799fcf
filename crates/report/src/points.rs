//! Samples of single cells, for all layers of a file.

use std::io::Write as _;

use serde_json::json;
use spinney_base::value::{Number, SampleType};
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PointSamples;

use crate::printable_json;

/// Cell of points outside the raster or volume.
pub const OUTSIDE: [u64; 3] = [u64::MAX; 3];

/// Layers that are queried for single cells, given as cells of the layer with the smallest cells,
/// at one level.
pub struct PointLayers<'a> {
    trees: &'a [&'a Dataset],
    /// Depth of the layer with the smallest cells.
    depth: u8,
    level: u8,
    axes: usize,
    locator: CellLocator,
}

impl<'a> PointLayers<'a> {
    /// Prepares queries of a file's layers, of which there is at least one, at points in some
    /// coordinates. The default level is the deepest.
    ///
    /// # Errors
    /// If there is no such level, or no transformation from the coordinates to the cells.
    ///
    /// # Panics
    /// If there are no layers.
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
                format!("0 to {depth}, the levels of the tree"),
            ));
        }
        let locator = CellLocator::new(coordinates, &finest.metadata().frame, finest.header().extent)?;
        Ok(PointLayers { trees, depth, level, axes: finest.header().form.axes(), locator })
    }

    /// Returns the number of coordinates of a point: two in quadtrees, three in octrees.
    pub fn axes(&self) -> usize {
        self.axes
    }

    /// Returns the transformation from the coordinates to cells.
    pub fn locator(&self) -> &CellLocator {
        &self.locator
    }

    /// Returns the cell of the level that contains a point, or [`OUTSIDE`].
    pub fn cell(&self, point: [f64; 3]) -> [u64; 3] {
        // (A quadtree has one layer of cells, so z is ignored.)
        let flat = |[x, y, z]: [f64; 3]| if self.axes == 3 { [x, y, z] } else { [x, y, 0.0] };
        let cell = self.locator.cell(point).map(flat).filter(|cell| self.locator.is_inside(*cell));
        let shift = self.depth - self.level;
        cell.map_or(OUTSIDE, |cell| cell.map(|coordinate| coordinate.floor() as u64 >> shift))
    }

    /// Reads the samples of some cells, for all layers.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn query<'c>(&self, cells: &'c [[u64; 3]]) -> Result<PointReport<'c>> {
        let of_layers = self.trees.iter().map(|tree| {
            // Layers with larger cells lack the deepest levels.
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

    /// Returns the beginning of each layer's result in JSON: its name and its time.
    pub fn headings(&self) -> Vec<String> {
        let heading = |tree: &&Dataset| {
            let (layer, time) = (json!(tree.metadata().name), json!(tree.metadata().time));
            printable_json(&format!("{{\"layer\":{layer},\"time\":{time},\"samples\":")).into_owned()
        };
        self.trees.iter().map(heading).collect()
    }
}

/// Samples of some cells, for all layers.
pub struct PointReport<'c> {
    cells: &'c [[u64; 3]],
    /// Samples of each layer, and whether they have double precision.
    of_layers: Vec<(PointSamples, bool)>,
}

impl PointReport<'_> {
    /// Writes the result of a cell as a text line: the samples of all layers, separated by commas,
    /// or `void`, or `outside`.
    ///
    /// # Panics
    /// If there are not so many cells.
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

    /// Writes the result of a cell as a line of JSON. `headings` are those of
    /// [`PointLayers::headings`].
    ///
    /// # Panics
    /// If there are not so many cells.
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
                        // (JSON cannot represent numbers that are not finite.)
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

/// Writes a number. Integers, the most frequent case, skip the slower floating-point formatting.
pub fn write_number(number: Number, is_double: bool, text: &mut Vec<u8>) {
    let written = match number {
        Number::Float(number) if number as i64 as f64 == number => write!(text, "{}", number as i64),
        Number::Float(number) if !is_double => write!(text, "{}", number as f32),
        number => write!(text, "{number}"),
    };
    debug_assert!(written.is_ok(), "writing to memory");
}
