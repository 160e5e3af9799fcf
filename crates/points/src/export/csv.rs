//! Export of points as comma-separated values.

use std::fmt::Write as _;
use std::io::Write as _;

use super::PointSink;
use super::numbers::{coordinate, digits_of};
use crate::attribute::{PointAttribute, to_f64};
use crate::grid::PointGrid;
use crate::query::PointColumns;
use crate::store::PointTree;
use spinney_base::io::Output;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Writes lines of text.
pub(super) struct CsvSink {
    out: Output,
    grid: PointGrid,
    /// Exported attributes and their columns.
    attributes: Vec<(PointAttribute, usize)>,
    line: String,
}

impl CsvSink {
    pub(super) fn new(tree: &PointTree, chosen: Vec<usize>, out: Output) -> Result<CsvSink> {
        let attributes: Vec<_> =
            chosen.iter().map(|attribute| (tree.attributes()[*attribute].clone(), 3 + attribute)).collect();
        let mut line = String::from("x,y,z");
        for (attribute, _) in &attributes {
            let name = attribute.name.replace('"', "\"\"");
            match name.contains(['"', ',', '\n', '\r']) {
                true => line.extend([",\"", name.as_str(), "\""]),
                false => line.extend([",", name.as_str()]),
            }
        }
        let mut sink = CsvSink { out, grid: tree.grid().clone(), attributes, line };
        sink.end_line()?;
        Ok(sink)
    }

    fn end_line(&mut self) -> Result<()> {
        self.line.push('\n');
        let written = self.out.write_all(self.line.as_bytes());
        self.line.clear();
        written.map_err(Error::io(self.out.path(), "write"))
    }
}

impl PointSink for CsvSink {
    fn put(&mut self, points: &PointColumns) -> Result<()> {
        let digits = self.grid.scale.map(digits_of);
        for point in 0..points.len() {
            let world = self.grid.to_world(points.position(point));
            for axis in 0..3 {
                if axis > 0 {
                    self.line.push(',');
                }
                coordinate(&mut self.line, world[axis], digits[axis]);
            }
            for (attribute, column) in &self.attributes {
                let number = points.columns[*column][point];
                // Writing to a string cannot fail.
                let _ = match (attribute.scale_offset, attribute.sample) {
                    _ if attribute.no_data == Some(number) => write!(self.line, ","),
                    (None, SampleType::F32) => {
                        write!(self.line, ",{}", to_f64(attribute.sample, number) as f32)
                    }
                    (None, SampleType::U64) => write!(self.line, ",{}", number as u64 ^ 1 << 63),
                    (None, SampleType::F64) => write!(self.line, ",{}", to_f64(attribute.sample, number)),
                    (None, _) => write!(self.line, ",{number}"),
                    (Some(_), _) => write!(self.line, ",{}", attribute.quantity(number)),
                };
            }
            self.end_line()?;
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.out.commit()
    }
}
