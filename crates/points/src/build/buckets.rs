//! Sorts rows into buckets by node at one level, out of core.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use super::NUMBER_BYTES;
use spinney_base::io::platform::read_exact_at;
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};

/// Contiguous rows of one node.
#[derive(Clone, Copy)]
struct Extent {
    /// Offset in the temporary file.
    offset: u64,
    rows: u32,
}

/// Collects rows. When memory is full, all rows are written to a temporary file, node by node, so
/// that a node's rows are read in few extents.
pub(crate) struct Buckets {
    directory: PathBuf,
    stride: usize,
    /// The node that contains all rows, and the level of the nodes that rows are sorted by.
    top: Code,
    level: u8,
    /// Maximum number of rows in memory.
    most: usize,
    rows: Vec<u8>,
    /// Bucket number of each row.
    nodes: Vec<u16>,
    file: Option<BufWriter<File>>,
    position: u64,
    extents: Vec<Vec<Extent>>,
    counts: Vec<u64>,
}

/// Bucket levels below the top node; that makes at most 2^15 buckets.
pub(crate) fn levels_below(dimension: Dimension) -> u8 {
    match dimension {
        Dimension::Quad => 7,
        Dimension::Oct => 5,
    }
}

impl Buckets {
    /// Creates a collector for rows of `stride` bytes. `top` contains all their codes, which end at
    /// level `deepest`. About `memory` bytes hold rows.
    pub(crate) fn new(directory: PathBuf, stride: usize, (top, deepest): (Code, u8), memory: u64) -> Buckets {
        let level = (top.level() + levels_below(top.dimension())).min(deepest);
        let nodes = 1 << (top.dimension().axes() * usize::from(level - top.level()));
        // Per row: its bucket number, and its index in bucket order.
        let most = (memory / (stride as u64 + 6)).clamp(1024, u32::MAX.into()) as usize;
        Buckets {
            directory,
            stride,
            top,
            level,
            most,
            rows: Vec::new(),
            nodes: Vec::new(),
            file: None,
            position: 0,
            extents: vec![Vec::new(); nodes],
            counts: vec![0; nodes],
        }
    }

    /// Adds a row and its input number, by the point's code.
    #[inline]
    pub(crate) fn push(&mut self, code: Code, row: &[u8], number: &[u8; NUMBER_BYTES]) -> Result<()> {
        let node = (code.ancestor(self.level).path() as usize) & (self.counts.len() - 1);
        self.rows.extend_from_slice(row);
        self.rows.extend_from_slice(number);
        self.nodes.push(node as u16);
        self.counts[node] += 1;
        if self.nodes.len() < self.most { Ok(()) } else { self.spill() }
    }

    /// Returns the indices of rows in bucket order.
    fn order(&self) -> Vec<u32> {
        let mut next = vec![0u32; self.counts.len()];
        self.nodes.iter().for_each(|node| next[usize::from(*node)] += 1);
        let mut before = 0;
        for count in &mut next {
            before += std::mem::replace(count, before);
        }
        let mut order = vec![0; self.nodes.len()];
        for (row, node) in self.nodes.iter().enumerate() {
            let place = &mut next[usize::from(*node)];
            order[*place as usize] = row as u32;
            *place += 1;
        }
        order
    }

    fn spill(&mut self) -> Result<()> {
        let failed = || Error::io(&self.directory, "use a temporary file in");
        if self.file.is_none() {
            let file = tempfile::tempfile_in(&self.directory).map_err(failed())?;
            self.file = Some(BufWriter::with_capacity(1 << 20, file));
        }
        let order = self.order();
        let out = self.file.as_mut().expect("it was made");
        for row in &order {
            let at = *row as usize * self.stride;
            out.write_all(&self.rows[at..at + self.stride])
                .map_err(Error::io(&self.directory, "use a temporary file in"))?;
            let extents = &mut self.extents[usize::from(self.nodes[*row as usize])];
            match extents.last_mut() {
                Some(last) if last.offset + u64::from(last.rows) * self.stride as u64 == self.position => {
                    last.rows += 1
                }
                _ => extents.push(Extent { offset: self.position, rows: 1 }),
            }
            self.position += self.stride as u64;
        }
        self.rows.clear();
        self.nodes.clear();
        Ok(())
    }

    /// Finishes collecting, and returns all rows by bucket.
    pub(crate) fn finish(mut self) -> Result<BucketedRows> {
        let order = self.order();
        let mut starts = Vec::with_capacity(self.counts.len() + 1);
        let mut held: Vec<u32> = vec![0; self.counts.len()];
        self.nodes.iter().for_each(|node| held[usize::from(*node)] += 1);
        let mut before = 0;
        for count in held {
            starts.push(before);
            before += count;
        }
        starts.push(before);
        let file = match self.file.take() {
            Some(file) => {
                let failed = Error::io(&self.directory, "use a temporary file in");
                Some(file.into_inner().map_err(|error| failed(error.into_error()))?)
            }
            None => None,
        };
        self.rows.shrink_to_fit();
        let Buckets { directory, stride, top, level, rows, extents, counts, .. } = self;
        Ok(BucketedRows { directory, stride, top, level, rows, order, starts, file, extents, counts })
    }
}

/// Rows by bucket.
pub(crate) struct BucketedRows {
    directory: PathBuf,
    stride: usize,
    top: Code,
    level: u8,
    /// The rows in memory, their bucket order, and where each bucket starts in it.
    rows: Vec<u8>,
    order: Vec<u32>,
    starts: Vec<u32>,
    file: Option<File>,
    extents: Vec<Vec<Extent>>,
    counts: Vec<u64>,
}

/// A node and its row count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bucket {
    pub code: Code,
    pub rows: u64,
    number: usize,
}

impl BucketedRows {
    /// Returns the non-empty buckets, in order.
    pub(crate) fn buckets(&self) -> Vec<Bucket> {
        let axes = self.top.dimension().axes();
        let bits = axes * usize::from(self.level - self.top.level());
        let bucket = |(number, rows): (usize, &u64)| {
            let path = self.top.path() << bits | number as u64;
            let code = Code::from_path(self.top.dimension(), self.level, path).expect("below the top node");
            Bucket { code, rows: *rows, number }
        };
        self.counts.iter().enumerate().filter(|(_, rows)| **rows > 0).map(bucket).collect()
    }

    /// Yields a bucket's rows in input order, at most `most` at a time.
    pub(crate) fn read(
        &self,
        bucket: &Bucket,
        most: usize,
        each: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut bytes = Vec::new();
        for extent in &self.extents[bucket.number] {
            let file = self.file.as_ref().expect("where there are extents there is a file");
            let (mut offset, mut left) = (extent.offset, extent.rows as usize);
            while left > 0 {
                let count = left.min(most.max(1));
                bytes.resize(count * self.stride, 0);
                read_exact_at(file, &mut bytes, offset)
                    .map_err(Error::io(&self.directory, "read a temporary file in"))?;
                each(&bytes)?;
                offset += bytes.len() as u64;
                left -= count;
            }
        }
        let [first, last] = [bucket.number, bucket.number + 1].map(|number| self.starts[number] as usize);
        for rows in self.order[first..last].chunks(most.max(1)) {
            bytes.clear();
            for row in rows {
                let at = *row as usize * self.stride;
                bytes.extend_from_slice(&self.rows[at..at + self.stride]);
            }
            each(&bytes)?;
        }
        Ok(())
    }
}
