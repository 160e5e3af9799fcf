//! Assembles the rows of many nodes, out of core and with all threads.

use std::path::Path;

use super::NodeSink;
use super::assembler::{Assembled, Assembler, BuiltItem, node_level, write_items};
use super::buckets::{Bucket, BucketedRows, Buckets};
use super::encoder::Encoder;
use super::order::order_of;
use super::run::{BATCH, PointBuildOptions};
use crate::attribute::position_of;
use spinney_base::io::Sorter;
use spinney_base::space::Code;
use spinney_base::{Progress, Result, parallel};

/// Encoder and options, shared by all threads.
#[derive(Clone, Copy)]
pub(crate) struct Plan<'a> {
    pub encoder: &'a Encoder,
    pub options: &'a PointBuildOptions,
    pub progress: &'a dyn Progress,
}

/// Returns a key that is unique to the position.
fn position_key([x, y, z]: [i32; 3]) -> u128 {
    u128::from(x as u32) << 64 | u128::from(y as u32) << 32 | u128::from(z as u32)
}

/// Counts repeated positions, and clears the list.
fn duplicates_of(positions: &mut Vec<u128>) -> u64 {
    spinney_base::sort::numbers128(positions);
    let count = positions.windows(2).filter(|pair| pair[0] == pair[1]).count();
    positions.clear();
    count as u64
}

/// Assembly of the rows of many nodes, and the destination of the result.
pub(crate) struct Work<'a> {
    pub plan: Plan<'a>,
    /// Directory of temporary files.
    pub temporary: &'a Path,
    pub sink: &'a mut dyn NodeSink,
    /// Progress total: points read plus points assembled.
    pub total: u64,
    /// Assembled points that repeat the position of another one.
    pub duplicates: u64,
}

/// Result for the rows of one node: the assembled node, its finished blocks and nodes, and its
/// duplicate count.
type AssembledBucket = (Assembled, Vec<BuiltItem>, u64);

impl Plan<'_> {
    /// Maximum number of rows that one thread sorts at a time.
    fn share(&self) -> u64 {
        // Counted: rows as read and as held by nodes, and codes with indices. The columns of a
        // block are few.
        let row = 2 * self.encoder.stride() as u64 + 32;
        (self.options.memory / 3 / parallel::threads() as u64 / row).max(4096)
    }

    /// Assembles the subtree of one bucket in memory.
    fn assemble_one(
        &self,
        rows: &BucketedRows,
        bucket: &Bucket,
        before: Option<Code>,
    ) -> Result<AssembledBucket> {
        self.progress.check()?;
        let stride = self.encoder.stride();
        let mut bytes = Vec::with_capacity(bucket.rows as usize * stride);
        rows.read(bucket, 1 << 16, &mut |rows| {
            bytes.extend_from_slice(rows);
            Ok(())
        })?;
        let grid = &self.encoder.grid;
        let code = |row| grid.code(position_of(row)).expect("it was in the root when it was read");
        let codes: Vec<u64> = bytes.chunks_exact(stride).map(|row| code(row).bits()).collect();
        let mut duplicates = 0;
        let mut assembler = Assembler::new(self.encoder, self.options.leaf_size, bucket.code);
        let mut same = before.map(|before| before.common_ancestor(bucket.code).level());
        let mut last: Option<Code> = None;
        // Positions of the points with the last code.
        let mut positions = Vec::new();
        for index in order_of(&codes) {
            let code = Code::from_bits(grid.dimension, codes[index as usize]).expect("it was one");
            let row = &bytes[index as usize * stride..][..stride];
            if let Some(before) = last {
                same = Some(before.common_ancestor(code).level());
                if before != code {
                    duplicates += duplicates_of(&mut positions);
                }
            }
            positions.push(position_key(position_of(row)));
            assembler.advance(code);
            assembler.add(code, node_level(self.encoder, same), row);
            last = Some(code);
        }
        duplicates += duplicates_of(&mut positions);
        let (assembled, items) = assembler.finish();
        Ok((assembled, items, duplicates))
    }
}

impl Work<'_> {
    /// Assembles buckets, in order. `last` is the preceding node that had points.
    pub(crate) fn assemble(
        &mut self,
        (rows, buckets): (&BucketedRows, &[Bucket]),
        assembler: &mut Assembler<'_>,
        last: &mut Option<Code>,
    ) -> Result<()> {
        let plan = self.plan;
        let share = plan.share();
        let mut rest = buckets;
        while let Some(first) = rest.first() {
            self.plan.progress.check()?;
            // A bucket of the top node itself holds points that all have one code.
            if first.rows > share || first.code == assembler.top() {
                self.divide(rows, first, assembler, last)?;
                *last = Some(first.code);
                rest = &rest[1..];
                continue;
            }
            // As many buckets as fit into memory, each assembled by one thread.
            let max_rows = share * parallel::threads() as u64;
            let mut sum = 0;
            let fits = |bucket: &&Bucket| {
                sum += bucket.rows;
                bucket.rows <= share && sum <= max_rows
            };
            let count = rest.iter().take_while(fits).count().max(1);
            let (batch, remaining) = rest.split_at(count);
            rest = remaining;
            let befores = std::iter::once(*last).chain(batch.iter().map(|bucket| Some(bucket.code)));
            let jobs: Vec<(Bucket, Option<Code>)> = batch.iter().copied().zip(befores).collect();
            let made = parallel::map(&jobs, |(bucket, before)| plan.assemble_one(rows, bucket, *before));
            for ((bucket, _), made) in jobs.iter().zip(made) {
                let (assembled, items, duplicates) = made?;
                self.duplicates += duplicates;
                assembler.reach(bucket.code, &assembled.closed);
                self.write(std::mem::take(&mut assembler.items))?;
                self.write(items)?;
                assembler.join(bucket.code, assembled);
                self.write(std::mem::take(&mut assembler.items))?;
                self.plan.progress.advance(bucket.rows, self.total);
            }
            *last = batch.last().map(|bucket| bucket.code);
        }
        Ok(())
    }

    /// Assembles a bucket that exceeds memory: sorts its rows into buckets of deeper nodes.
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
            // All rows have one code, so they are added in input order.
            return self.stream(rows, bucket, assembler, *last);
        }
        let mut buckets = Buckets::new(
            self.temporary.to_path_buf(),
            stride,
            (bucket.code, deepest),
            self.plan.options.memory / 3,
        );
        rows.read(bucket, BATCH, &mut |rows| {
            self.plan.progress.check()?;
            rows.chunks_exact(stride).try_for_each(|row| {
                let code = self
                    .plan
                    .encoder
                    .grid
                    .code(position_of(row))
                    .expect("it was in the root when it was read");
                let (point, number) = row.split_last_chunk().expect("rows have one");
                buckets.push(code, point, number)
            })
        })?;
        let rows = buckets.finish()?;
        self.assemble((&rows, &rows.buckets()), assembler, last)
    }

    /// Adds rows with a single code to their nodes.
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
        // Where a code does not determine the position, the remaining offset has fewer than 64
        // bits.
        let mut positions = Sorter::new(self.temporary, self.plan.options.memory / 16);
        let corner = self.plan.encoder.grid.node_box(bucket.code)[0];
        rows.read(bucket, BATCH, &mut |rows| {
            self.plan.progress.check()?;
            for row in rows.chunks_exact(stride) {
                let position = position_of(row);
                let low = |axis: usize| u64::from(position[axis].wrapping_sub(corner[axis]) as u32);
                let key = low(0) << 48 | low(1) << 32 | low(2);
                positions.push(key, &key.to_le_bytes())?;
                assembler.add(bucket.code, node_level(self.plan.encoder, same), row);
                same = Some(bucket.code.level());
            }
            self.plan.progress.advance((rows.len() / stride) as u64, self.total);
            self.write(std::mem::take(&mut assembler.items))
        })?;
        let mut before = None;
        positions.finish(&mut |key| {
            let key = Some(key.to_vec());
            self.duplicates += u64::from(before == key);
            before = key;
            Ok(())
        })
    }

    fn write(&mut self, items: Vec<BuiltItem>) -> Result<()> {
        write_items(items, self.sink)
    }
}
