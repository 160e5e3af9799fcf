//! The entire build.

use std::path::Path;

use super::MAX_NUMBERS;
use super::assembler::{Assembler, write_items, write_root};
use super::buckets::{BucketedRows, Buckets};
use super::encoder::Encoder;
use super::work::{Plan, Work};
use crate::attribute::position_of;
use crate::codec::MAX_POINTS;
use crate::grid::PointGrid;
use crate::source::{PointSchema, PointSource};
use crate::store::{PointWriter, Summary};
use serde::{Deserialize, Serialize};
use spinney_base::io::{Output, directory_of};
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;

/// Build options.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointBuildOptions {
    /// Maximum number of points of an undivided node, and of a block.
    pub leaf_size: usize,
    /// Approximate memory limit in bytes.
    #[serde(skip)]
    pub memory: u64,
}

impl Default for PointBuildOptions {
    fn default() -> PointBuildOptions {
        PointBuildOptions { leaf_size: 50_000, memory: 256 << 20 }
    }
}

impl PointBuildOptions {
    /// Checks that the leaf size is in range.
    pub(crate) fn check(&self) -> Result<()> {
        if (1..=MAX_POINTS).contains(&self.leaf_size) {
            return Ok(());
        }
        let expected = format!("1 to {MAX_POINTS} points");
        Err(Error::invalid("leaf size", self.leaf_size.to_string(), expected))
    }
}

/// Counts of a finished build.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildSummary {
    /// Number of points.
    pub points: u64,
    /// Number of points that repeat the position of another one: per position, all but one.
    pub duplicates: u64,
}

/// Number of points read at a time.
pub(crate) const BATCH: usize = 1 << 16;

/// Builds a point tree.
///
/// A node divides its side into 128 sampling cells (256 in a quadtree). Each point goes into the
/// coarsest node in which it is the first point of its sampling cell, in code order. Takes one pass
/// over the points, and a temporary file for them if they exceed the memory limit.
///
/// # Errors
/// If the points cannot be read, lie outside the bounds of the source's schema, or the output
/// cannot be written.
pub fn build(
    source: &mut dyn PointSource,
    options: &PointBuildOptions,
    metadata: &Metadata,
    output: Output,
    progress: &dyn Progress,
) -> Result<BuildSummary> {
    options.check()?;
    let temporary = directory_of(output.path()).to_path_buf();
    let (rows, points) = match read(source, (&temporary, options.memory), progress)? {
        Some(read) => read,
        None if source.survey()? => {
            let text =
                "has points outside the bounds in its header; the bounds were computed from all points";
            progress.warn(source.path(), text);
            let again = read(source, (&temporary, options.memory), progress)?;
            again.ok_or_else(|| beyond(source))?
        }
        None => return Err(beyond(source)),
    };
    let encoder = encoder_of(source.schema());
    let mut writer = PointWriter::new(output, &encoder.grid, options.memory / 16)?;
    let top = Code::root(encoder.grid.dimension);
    let plan = Plan { encoder: &encoder, options, progress };
    let mut work = Work { plan, temporary: &temporary, sink: &mut writer, total: 2 * points, duplicates: 0 };
    let mut assembler = Assembler::new(&encoder, options.leaf_size, top);
    work.assemble((&rows, &rows.buckets()), &mut assembler, &mut None)?;
    let summary = BuildSummary { points, duplicates: work.duplicates };
    let (assembled, items) = assembler.finish();
    write_items(items, &mut writer)?;
    write_root(&encoder, assembled.closed, &mut writer)?;
    let section = Summary::new(&encoder, options.leaf_size, summary);
    writer.finish(&section, metadata)?;
    Ok(summary)
}

/// Returns the encoder for the points of a schema.
pub(crate) fn encoder_of(schema: &PointSchema) -> Encoder {
    let grid = PointGrid::around(schema.scale, schema.offset, schema.bounds, schema.dimension);
    Encoder::new(schema.layout.clone(), grid)
}

/// Error for points outside the declared bounds.
fn beyond(source: &dyn PointSource) -> Error {
    let [least, most] = source.schema().bounds;
    let expected = format!("points from {least:?} to {most:?} on the grid, as in its header");
    Error::corrupt(source.path(), "points", "a point outside the bounds in the header", expected)
}

/// Reads and counts all points; `None` if one lies outside the declared bounds.
fn read(
    source: &mut dyn PointSource,
    (temporary, memory): (&Path, u64),
    progress: &dyn Progress,
) -> Result<Option<(BucketedRows, u64)>> {
    let encoder = encoder_of(source.schema());
    let total = source.schema().count.unwrap_or(0);
    let top = (Code::root(encoder.grid.dimension), encoder.grid.code_levels());
    let mut buckets = Buckets::new(temporary.to_path_buf(), encoder.stride(), top, memory / 3);
    let size = encoder.layout.size;
    let mut rows = Vec::new();
    let mut number = 0u64;
    loop {
        progress.check()?;
        rows.clear();
        let count = source.read(&mut rows, BATCH)?;
        if count == 0 {
            return Ok(Some((buckets.finish()?, number)));
        }
        for point in rows.chunks_exact(size) {
            let Some(code) = encoder.grid.code(position_of(point)) else { return Ok(None) };
            let bytes = number.to_le_bytes();
            buckets.push(code, point, bytes.first_chunk().expect("fewer than eight"))?;
            number += 1;
        }
        if number >= MAX_NUMBERS {
            let found = format!("{number} or more");
            return Err(Error::invalid("points", found, format!("fewer than {MAX_NUMBERS} in a file")));
        }
        progress.advance(count as u64, 2 * total.max(number));
    }
}
