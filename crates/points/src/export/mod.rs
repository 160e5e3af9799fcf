//! Export of point trees to other formats.

mod csv;
mod las;
mod numbers;
mod tables;

use std::path::Path;

use crate::query::{PointColumns, Selection};
use crate::store::PointTree;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};

/// Point file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointFormat {
    /// LAS.
    Las,
    /// Compressed LAS.
    Laz,
    /// Comma-separated values with a header line.
    Csv,
    /// Binary PLY: coordinates as doubles, then the attributes.
    Ply,
    /// `NumPy` structured array.
    Npy,
}

impl PointFormat {
    /// Returns the format for a file name; `None` if the extension is unknown.
    pub fn of(path: &Path) -> Option<PointFormat> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match ending.as_str() {
            "las" => PointFormat::Las,
            "laz" => PointFormat::Laz,
            "csv" => PointFormat::Csv,
            "ply" => PointFormat::Ply,
            "npy" => PointFormat::Npy,
            _ => return None,
        })
    }
}

/// Writer of points.
trait PointSink {
    /// Writes some points.
    fn put(&mut self, points: &PointColumns) -> Result<()>;
    /// Completes the file and publishes it.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Writes the points of a selection, with some attributes or all. Returns the number of points.
///
/// LAS files keep scale, offset, coordinate system and the tags of the input. Attributes without a
/// LAS field become extra bytes.
///
/// # Errors
/// If the tree is corrupt, the output cannot be written, or the format has no space for an
/// attribute.
pub fn export_points(
    tree: &PointTree,
    selection: &Selection,
    attributes: Option<&[usize]>,
    output: Output,
    format: PointFormat,
    progress: &dyn Progress,
) -> Result<u64> {
    let all: Vec<usize> = (0..tree.attributes().len()).collect();
    let chosen = attributes.unwrap_or(&all).to_vec();
    if let Some(wrong) = chosen.iter().find(|attribute| **attribute >= all.len()) {
        return Err(Error::invalid("attribute", wrong.to_string(), format!("an index below {}", all.len())));
    }
    if !matches!(format, PointFormat::Las | PointFormat::Laz)
        && let Some(crs) = &tree.metadata().frame.crs
    {
        progress.warn(output.path(), &format!("stores no coordinate system; the points are in {crs}"));
    }
    // Headers store the point count. Without conditions, most of it comes from node statistics
    // without reading points.
    let count = || tree.count(selection, &());
    let mut sink: Box<dyn PointSink> = match format {
        PointFormat::Las | PointFormat::Laz => las::sink(tree, &chosen, output, format == PointFormat::Laz)?,
        PointFormat::Csv => Box::new(csv::CsvSink::new(tree, chosen, output)?),
        PointFormat::Ply => Box::new(tables::TableSink::ply(tree, chosen, count()?, output)?),
        PointFormat::Npy => Box::new(tables::TableSink::npy(tree, chosen, count()?, output)?),
    };
    let mut written = 0;
    tree.select(selection, attributes, progress, &mut |points| {
        written += points.len() as u64;
        sink.put(points)
    })?;
    sink.finish()?;
    Ok(written)
}
