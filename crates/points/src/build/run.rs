//! The whole of building.

use std::path::{Path, PathBuf};

use super::MOST_NUMBERS;
use super::assembler::{Assembled, Assembler, BuiltPiece, Closed, leaf, node_level};
use super::buckets::{Bucket, BucketedRows, Buckets};
use super::encoder::Encoder;
use super::order::order_of;
use crate::attribute::place_of;
use crate::codec::MOST_POINTS;
use crate::grid::PointGrid;
use crate::source::{PointSchema, PointSource};
use crate::store::{PointWriter, Summary};
use spinney_base::io::{Output, Sorter, folder};
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result, parallel};
use spinney_container::Metadata;

/// Options of building.
#[derive(Clone, Debug)]
pub struct PointBuildOptions {
    /// Points of a node that is not divided, at most; blocks have no more.
    pub leaf_size: usize,
    /// Bytes of memory that may be used, about.
    pub memory: u64,
}

impl Default for PointBuildOptions {
    fn default() -> PointBuildOptions {
        PointBuildOptions { leaf_size: 50_000, memory: 256 << 20 }
    }
}

/// Counts of a tree that was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildSummary {
    /// Number of points.
    pub points: u64,
    /// Points at the place of another one: for each place, all but one.
    pub duplicates: u64,
}

/// Points that are read at a time.
const BATCH: usize = 1 << 16;

/// Builds a tree of points.
///
/// Each point goes into the coarsest node in which it is the first, by the order of codes, of its part of 1/128 of the node's side (1/256 in
/// quadtrees). Takes a pass over the points and a temporary file of them, if they do not fit into memory.
///
/// # Errors
/// If the points cannot be read, lie beyond the bounds that their source says, or the output cannot be written.
pub fn build(
    source: &mut dyn PointSource,
    options: &PointBuildOptions,
    metadata: &Metadata,
    output: Output,
    progress: &dyn Progress,
) -> Result<BuildSummary> {
    if !(1..=MOST_POINTS).contains(&options.leaf_size) {
        let expected = format!("1 to {MOST_POINTS} points");
        return Err(Error::invalid("leaf size", options.leaf_size.to_string(), expected));
    }
    let temporary = folder(output.path()).to_path_buf();
    let (rows, points) = match read(source, (&temporary, options.memory), progress)? {
        Some(read) => read,
        None if source.survey()? => {
            let text = "its header is wrong about where its points are; all of them were looked at first";
            progress.warn(source.path(), text);
            let again = read(source, (&temporary, options.memory), progress)?;
            again.ok_or_else(|| beyond(source))?
        }
        None => return Err(beyond(source)),
    };
    let encoder = encoder_of(source.schema());
    let writer = PointWriter::new(output, &encoder.grid, encoder.block.columns, options.memory / 16)?;
    let top = Code::root(encoder.grid.dimension);
    let plan = Plan { encoder: &encoder, options, progress };
    let mut work = Work { plan, temporary, writer, total: 2 * points, duplicates: 0 };
    let mut assembler = Assembler::new(&encoder, options.leaf_size, top);
    let mut last = None;
    work.assemble(&rows, &mut assembler, &mut last)?;
    let (assembled, pieces) = assembler.finish();
    work.write(pieces)?;
    let mut pieces = Vec::new();
    if let Closed::Few(pending) = assembled.closed
        && !pending.rows.is_empty()
    {
        leaf(&encoder, pending, &mut pieces);
    }
    work.write(pieces)?;
    let summary = BuildSummary { points, duplicates: work.duplicates };
    let section = Summary::new(&encoder, options.leaf_size, summary);
    work.writer.finish(&section, metadata)?;
    Ok(summary)
}

fn encoder_of(schema: &PointSchema) -> Encoder {
    let grid = PointGrid::around(schema.scale, schema.offset, schema.bounds, schema.dimension);
    Encoder::new(schema.layout.clone(), grid)
}

/// The error that points lie beyond the bounds that were told.
fn beyond(source: &dyn PointSource) -> Error {
    let [least, most] = source.schema().bounds;
    let expected = format!("points from {least:?} to {most:?} on the grid, as its header says");
    Error::corrupt(source.path(), "points", "points beyond these bounds", expected)
}

/// Reads all points, and counts them; `None` if one lies beyond the bounds that were told.
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
            let Some(code) = encoder.grid.code(place_of(point)) else { return Ok(None) };
            let bytes = number.to_le_bytes();
            buckets.push(code, point, bytes.first_chunk().expect("fewer than eight"))?;
            number += 1;
        }
        if number >= MOST_NUMBERS {
            let found = format!("{number} points and more");
            return Err(Error::invalid("points", found, format!("at most {MOST_NUMBERS} in a file")));
        }
        progress.advance(count as u64, 2 * total.max(number));
    }
}

/// The encoder and the options, for all threads.
#[derive(Clone, Copy)]
struct Plan<'a> {
    encoder: &'a Encoder,
    options: &'a PointBuildOptions,
    progress: &'a dyn Progress,
}

/// A number that no other place has.
fn place_key([x, y, z]: [i32; 3]) -> u128 {
    u128::from(x as u32) << 64 | u128::from(y as u32) << 32 | u128::from(z as u32)
}

/// Number of places that are there once more; takes all.
fn duplicates_of(places: &mut Vec<u128>) -> u64 {
    spinney_base::sort::numbers128(places);
    let count = places.windows(2).filter(|pair| pair[0] == pair[1]).count();
    places.clear();
    count as u64
}

struct Work<'a> {
    plan: Plan<'a>,
    temporary: PathBuf,
    writer: PointWriter,
    /// Points that are read and assembled.
    total: u64,
    duplicates: u64,
}

/// The outcome of the rows of a node: what became of it, what came out, and its duplicates.
type Outcome = (Assembled, Vec<BuiltPiece>, u64);

impl Plan<'_> {
    /// Rows that may be sorted by a thread at a time.
    fn share(&self) -> u64 {
        // (Rows as they are read and as nodes have them; codes with places; columns of a block are few.)
        let row = 2 * self.encoder.stride() as u64 + 32;
        (self.options.memory / 3 / parallel::threads() as u64 / row).max(4096)
    }

    /// Assembles the nodes of a node's rows in memory.
    fn assemble_one(&self, rows: &BucketedRows, bucket: &Bucket, before: Option<Code>) -> Result<Outcome> {
        self.progress.check()?;
        let stride = self.encoder.stride();
        let mut bytes = Vec::with_capacity(bucket.rows as usize * stride);
        rows.read(bucket, 1 << 16, &mut |rows| {
            bytes.extend_from_slice(rows);
            Ok(())
        })?;
        let grid = &self.encoder.grid;
        let code = |row| grid.code(place_of(row)).expect("it was in the root when it was read");
        let codes: Vec<u64> = bytes.chunks_exact(stride).map(|row| code(row).bits()).collect();
        let mut duplicates = 0;
        let mut assembler = Assembler::new(self.encoder, self.options.leaf_size, bucket.code);
        let mut same = before.map(|before| before.common_ancestor(bucket.code).level());
        let mut last: Option<Code> = None;
        // Places of points with the last code.
        let mut places = Vec::new();
        for place in order_of(&codes) {
            let code = Code::from_bits(grid.dimension, codes[place as usize]).expect("it was one");
            let row = &bytes[place as usize * stride..][..stride];
            if let Some(before) = last {
                same = Some(before.common_ancestor(code).level());
                if before != code {
                    duplicates += duplicates_of(&mut places);
                }
            }
            places.push(place_key(place_of(row)));
            assembler.advance(code);
            assembler.add(code, node_level(self.encoder, same), row);
            last = Some(code);
        }
        duplicates += duplicates_of(&mut places);
        let (assembled, pieces) = assembler.finish();
        Ok((assembled, pieces, duplicates))
    }
}

impl Work<'_> {
    /// Assembles nodes of the rows of many nodes, in order. `last` is the node that had points before.
    fn assemble(
        &mut self,
        rows: &BucketedRows,
        assembler: &mut Assembler<'_>,
        last: &mut Option<Code>,
    ) -> Result<()> {
        let plan = self.plan;
        let share = plan.share();
        let buckets = rows.buckets();
        let mut rest = &buckets[..];
        while let Some(first) = rest.first() {
            self.plan.progress.check()?;
            // (One of the top node itself has all points in one place.)
            if first.rows > share || first.code == assembler.top() {
                self.divide(rows, first, assembler, last)?;
                *last = Some(first.code);
                rest = &rest[1..];
                continue;
            }
            // As many as there is room for, each of them assembled by one thread.
            let room = share * parallel::threads() as u64;
            let mut sum = 0;
            let fits = |bucket: &&Bucket| {
                sum += bucket.rows;
                bucket.rows <= share && sum <= room
            };
            let count = rest.iter().take_while(fits).count().max(1);
            let (batch, behind) = rest.split_at(count);
            rest = behind;
            let befores = std::iter::once(*last).chain(batch.iter().map(|bucket| Some(bucket.code)));
            let jobs: Vec<(Bucket, Option<Code>)> = batch.iter().copied().zip(befores).collect();
            let made = parallel::map(&jobs, |(bucket, before)| plan.assemble_one(rows, bucket, *before));
            for ((bucket, _), made) in jobs.iter().zip(made) {
                let (assembled, pieces, duplicates) = made?;
                self.duplicates += duplicates;
                assembler.reach(bucket.code, &assembled.closed);
                self.write(std::mem::take(&mut assembler.pieces))?;
                self.write(pieces)?;
                assembler.join(bucket.code, assembled);
                self.write(std::mem::take(&mut assembler.pieces))?;
                self.plan.progress.advance(bucket.rows, self.total);
            }
            *last = batch.last().map(|bucket| bucket.code);
        }
        Ok(())
    }

    /// Assembles the nodes of more rows than there is room for: by nodes below.
    fn divide(
        &mut self,
        rows: &BucketedRows,
        bucket: &Bucket,
        assembler: &mut Assembler<'_>,
        last: &mut Option<Code>,
    ) -> Result<()> {
        let deepest = self.plan.encoder.grid.code_levels();
        let stride = self.plan.encoder.stride();
        if bucket.code.level() == deepest {
            // All have one code: they come as they are.
            return self.stream(rows, bucket, assembler, *last);
        }
        let mut buckets = Buckets::new(
            self.temporary.clone(),
            stride,
            (bucket.code, deepest),
            self.plan.options.memory / 3,
        );
        rows.read(bucket, BATCH, &mut |rows| {
            self.plan.progress.check()?;
            rows.chunks_exact(stride).try_for_each(|row| {
                let code =
                    self.plan.encoder.grid.code(place_of(row)).expect("it was in the root when it was read");
                let (point, number) = row.split_last_chunk().expect("rows have one");
                buckets.push(code, point, number)
            })
        })?;
        self.assemble(&buckets.finish()?, assembler, last)
    }

    /// Adds rows that all have one code to the nodes that they belong to.
    fn stream(
        &mut self,
        rows: &BucketedRows,
        bucket: &Bucket,
        assembler: &mut Assembler<'_>,
        last: Option<Code>,
    ) -> Result<()> {
        assembler.advance(bucket.code);
        let mut same = last.map(|last| last.common_ancestor(bucket.code).level());
        let stride = self.plan.encoder.stride();
        // (Where codes do not tell all of a place, what they leave has fewer than 64 bits.)
        let mut places = Sorter::new(&self.temporary, 8, self.plan.options.memory / 16);
        let corner = self.plan.encoder.grid.node_box(bucket.code)[0];
        rows.read(bucket, BATCH, &mut |rows| {
            self.plan.progress.check()?;
            for row in rows.chunks_exact(stride) {
                let place = place_of(row);
                let low = |axis: usize| u64::from(place[axis].wrapping_sub(corner[axis]) as u32);
                let key = low(0) << 48 | low(1) << 32 | low(2);
                places.push(key, key.to_le_bytes().to_vec())?;
                assembler.add(bucket.code, node_level(self.plan.encoder, same), row);
                same = Some(bucket.code.level());
            }
            self.plan.progress.advance((rows.len() / stride) as u64, self.total);
            self.write(std::mem::take(&mut assembler.pieces))
        })?;
        let mut before = None;
        places.finish(&mut |place| {
            let place = Some(place.to_vec());
            self.duplicates += u64::from(before == place);
            before = place;
            Ok(())
        })
    }

    fn write(&mut self, pieces: Vec<BuiltPiece>) -> Result<()> {
        pieces.into_iter().try_for_each(|piece| match piece {
            BuiltPiece::Block(code, bytes, statistics) => self.writer.block(code, &bytes, &statistics),
            BuiltPiece::Node(code, statistics) => self.writer.node(code, &statistics),
        })
    }
}
