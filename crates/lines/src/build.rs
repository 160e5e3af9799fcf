//! Building a tree: sorts line segments by the codes of their nodes, and writes them in blocks.
//!
//! In this order, a node's own segments come before those of its descendants. So the open nodes are
//! the current node and its ancestors, and each holds at most one leaf's segments that are not yet
//! in a block.

use std::path::PathBuf;

use crate::codec::{
    LineSegment, MAX_FEATURES, MAX_SEGMENTS, MAX_TEXT, MAX_VERTICES, encode_features, encode_segments,
    text_bytes, weight,
};
use crate::geometry::bounds_of;
use crate::grid::LineGrid;
use crate::source::{LineFeature, LineSource};
use crate::statistics::Statistics;
use crate::store::{LineWriter, Summary};
use spinney_base::io::{Output, Sorter, directory_of};
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result, parallel, sort};
use spinney_container::Metadata;

/// Default maximum number of segments in a leaf, small enough for fast nearest-line search.
const DEFAULT_LEAF_SIZE: usize = 1024;

/// Options of [`build`].
#[derive(Clone, Debug)]
pub struct LineBuildOptions {
    /// Maximum number of segments in a leaf node, and in a block.
    pub leaf_size: usize,
    /// Approximate memory limit in bytes.
    pub memory: u64,
}

impl Default for LineBuildOptions {
    fn default() -> LineBuildOptions {
        LineBuildOptions { leaf_size: DEFAULT_LEAF_SIZE, memory: 256 << 20 }
    }
}

/// Counts of a tree that was built.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineBuildSummary {
    /// Number of features.
    pub features: u64,
    /// Number of line segments.
    pub segments: u64,
    /// Total length of all lines.
    pub length: f64,
}

/// Approximate bytes of features per block.
const FEATURE_BYTES: usize = 1 << 20;
/// Blocks of features per parallel batch, and segments per parallel batch.
const JOBS: usize = 8;
const TOGETHER: usize = 1 << 18;

/// Writes a segment of two or three axes for the sorter: feature, vertex, first level and ends.
fn to_row(segment: &LineSegment, axes: usize, row: &mut Vec<u8>) {
    row.clear();
    row.extend_from_slice(&segment.feature.to_le_bytes());
    row.extend_from_slice(&segment.vertex.to_le_bytes());
    row.push(segment.first);
    let numbers = segment.ends.iter().flat_map(|end| &end[..axes]);
    numbers.for_each(|number| row.extend_from_slice(&number.to_le_bytes()));
}

fn from_row(row: &[u8], axes: usize) -> LineSegment {
    let four = |at: usize| std::array::from_fn(|byte| row[at + byte]);
    let mut ends = [[0; 3]; 2];
    let numbers = ends.iter_mut().flat_map(|end| &mut end[..axes]);
    for (index, number) in numbers.enumerate() {
        *number = i32::from_le_bytes(four(13 + 4 * index));
    }
    LineSegment {
        ends,
        feature: u64::from_le_bytes(std::array::from_fn(|byte| row[byte])),
        vertex: u32::from_le_bytes(four(8)),
        first: row[12],
    }
}

/// Segments of a feature's lines with the codes of their nodes, sorted by code; `None` if a vertex
/// is outside of the grid.
pub(crate) fn segments_of(
    grid: &LineGrid,
    number: u64,
    feature: &LineFeature,
) -> Option<Vec<(Code, LineSegment)>> {
    let mut segments = Vec::new();
    let mut vertex = 0;
    for line in &feature.lines {
        for pair in line.windows(2) {
            let ends = [pair[0], pair[1]];
            segments.push((grid.code(ends)?, LineSegment { ends, feature: number, vertex, first: 0 }));
            vertex += 1;
        }
        vertex += 1;
    }
    sort::by_wide_key(&mut segments, |(code, segment)| {
        u128::from(code.bits()) << 32 | u128::from(segment.vertex)
    });
    let mut before: Option<Code> = None;
    for (code, segment) in &mut segments {
        // In this order, the previous segment shares the deepest common ancestor of all earlier
        // ones.
        segment.first = before.map_or(0, |before| before.common_ancestor(*code).level() + 1);
        before = Some(*code);
    }
    Some(segments)
}

/// Statistics of the segments of a block, added in their order.
pub(crate) fn statistics_of(grid: &LineGrid, segments: &[LineSegment]) -> Statistics {
    let mut all = Statistics::NONE;
    for segment in segments {
        all.segments += 1;
        all.length += grid.length(segment.ends);
        if let Some(firsts) = all.firsts.get_mut(usize::from(segment.first)) {
            *firsts += 1;
        }
        all.reach(bounds_of(segment.ends));
    }
    all
}

/// Builds a tree of lines.
///
/// Reads the features in one pass. Sorts their segments in memory, or in a temporary file if they
/// exceed the memory limit.
///
/// # Errors
/// If the features cannot be read, are outside of the bounds in the source's schema, or the output
/// cannot be written.
pub fn build(
    source: &mut dyn LineSource,
    options: &LineBuildOptions,
    metadata: &Metadata,
    output: Output,
    progress: &dyn Progress,
) -> Result<LineBuildSummary> {
    if !(1..=MAX_SEGMENTS).contains(&options.leaf_size) {
        let expected = format!("1 to {MAX_SEGMENTS} segments");
        return Err(Error::invalid("leaf size", options.leaf_size.to_string(), expected));
    }
    let schema = source.schema().clone();
    let grid = LineGrid::around(
        (schema.scale, schema.offset),
        schema.bounds,
        (schema.dimension, schema.has_one_unit),
    );
    let temporary: PathBuf = directory_of(output.path()).to_path_buf();
    let mut writer = LineWriter::new(output, &grid, options.memory / 16)?;
    let mut rows = Sorter::new(&temporary, options.memory / 2);
    let features = read(source, &grid, (&mut writer, &mut rows), progress)?;
    let segments = rows.len();
    let mut assembler =
        Assembler { leaf_size: options.leaf_size, open: Vec::new(), made: Vec::new(), rows: 0 };
    let mut totals = Totals { grid: &grid, writer, open: Vec::new(), closed: Vec::new() };
    rows.finish(&mut |row| {
        let segment = from_row(row, grid.axes());
        let code = grid.code(segment.ends).unwrap_or(Code::root(grid.dimension));
        assembler.add(code, segment);
        if assembler.rows > TOGETHER {
            progress.check()?;
            progress.advance(assembler.rows as u64, segments);
            assembler.rows = 0;
            totals.take(std::mem::take(&mut assembler.made))?;
        }
        Ok(())
    })?;
    totals.take(assembler.finish())?;
    let length = totals.closed.iter().fold(0.0, |sum, (_, statistics)| sum + statistics.length);
    let summary = Summary::new(&grid, &schema.attributes, (features, segments), options.leaf_size);
    totals.writer.finish(&summary, metadata)?;
    Ok(LineBuildSummary { features, segments, length })
}

/// Writes all features, and adds their segments to the sorter. Returns the number of features.
fn read(
    source: &mut dyn LineSource,
    grid: &LineGrid,
    (writer, rows): (&mut LineWriter, &mut Sorter),
    progress: &dyn Progress,
) -> Result<u64> {
    let (attributes, axes) = (source.schema().attributes.len(), grid.axes());
    let (mut number, mut bytes, mut vertices) = (0u64, 0, 0);
    let mut row = Vec::new();
    let mut blocks: Vec<(u64, Vec<LineFeature>)> = vec![(0, Vec::new())];
    let write = |blocks: Vec<(u64, Vec<LineFeature>)>, writer: &mut LineWriter| {
        let encoded = parallel::map(&blocks, |(_, features)| encode_features(features, attributes, axes));
        for ((first, features), bytes) in blocks.iter().zip(encoded) {
            if !features.is_empty() {
                writer.features(*first, &bytes, features.len())?;
            }
        }
        Ok::<(), Error>(())
    };
    while let Some(feature) = source.next()? {
        let own: usize = feature.lines.iter().map(Vec::len).sum();
        let text = text_bytes(&feature);
        let limits = [("vertices", own, MAX_VERTICES, 12), ("bytes of text", text, MAX_TEXT, 1)];
        for (what, found, most, bytes) in limits {
            if found > most {
                return Err(Error::TooLarge {
                    path: source.path().to_path_buf(),
                    what: format!("feature {}, with {found} {what},", number + 1),
                    needed: bytes * found as u64,
                    limit: bytes * most as u64,
                    advice: "divide it, or exclude it with --where".into(),
                });
            }
        }
        if let Some(line) = feature.lines.iter().find(|line| line.len() < 2) {
            let found = format!("a line of {} vertices", line.len());
            return Err(Error::corrupt(
                source.path(),
                format!("feature {}", number + 1),
                found,
                "at least 2",
            ));
        }
        let Some(segments) = segments_of(grid, number, &feature) else {
            let [least, most] = source.schema().bounds;
            let expected = format!("vertices from {least:?} to {most:?} on the grid");
            let found = "a vertex outside these bounds";
            return Err(Error::corrupt(source.path(), format!("feature {}", number + 1), found, expected));
        };
        for (code, segment) in segments {
            to_row(&segment, axes, &mut row);
            rows.push(code.bits(), &row)?;
        }
        let heavy = weight(&feature);
        let last = &blocks[blocks.len() - 1].1;
        if last.len() == MAX_FEATURES || vertices + own > MAX_VERTICES || bytes + heavy > FEATURE_BYTES {
            (bytes, vertices) = (0, 0);
            if blocks.len() >= JOBS {
                write(std::mem::take(&mut blocks), writer)?;
                progress.check()?;
            }
            blocks.push((number, Vec::new()));
        }
        let last = blocks.len() - 1;
        blocks[last].1.push(feature);
        bytes += heavy;
        vertices += own;
        number += 1;
    }
    write(blocks, writer)?;
    Ok(number)
}

/// Output of an assembler: blocks of nodes in order, and each node after all blocks of its subtree.
enum BuiltItem {
    Block(Code, Vec<LineSegment>),
    Node(Code),
}

/// Node whose segments are incomplete.
struct Open {
    code: Code,
    /// Its own segments that are not in a block yet.
    own: Vec<LineSegment>,
    /// Descendants that may still be merged into it, and their total number of segments.
    pending: Vec<(Code, Vec<LineSegment>)>,
    waiting: usize,
    /// Whether it has too many segments for a leaf.
    is_divided: bool,
}

/// Assembles nodes from segments in the order of their codes, in which a code precedes those of its
/// descendants.
///
/// Invariants: the open nodes are the path from the root to the last segment's node, one per level.
/// `waiting` is the number of segments in `pending`. If a node is divided, its ancestors are too,
/// and nothing is pending in divided nodes. A node or block is output when it is closed, after all
/// that precede it and before the node that contains it. So the output is in postorder, and blocks
/// of a node are in the order of their segments.
struct Assembler {
    leaf_size: usize,
    open: Vec<Open>,
    made: Vec<BuiltItem>,
    /// Segments since the output was last taken.
    rows: usize,
}

impl Assembler {
    fn push(&mut self, code: Code) {
        self.open.push(Open { code, own: Vec::new(), pending: Vec::new(), waiting: 0, is_divided: false });
    }

    /// Adds a segment of a node. Codes must not decrease.
    fn add(&mut self, code: Code, segment: LineSegment) {
        self.rows += 1;
        while self.open.last().is_some_and(|open| !open.code.contains(code)) {
            self.close();
        }
        // Opens the nodes on the path that have no segments yet.
        while self.open.len() <= usize::from(code.level()) {
            self.push(code.ancestor(self.open.len() as u8));
        }
        let index = usize::from(code.level());
        self.open[index].own.push(segment);
        if self.open[index].own.len() > self.leaf_size {
            self.divide(index);
            let rest = self.open[index].own.split_off(self.leaf_size);
            let block = std::mem::replace(&mut self.open[index].own, rest);
            self.made.push(BuiltItem::Block(code, block));
        }
    }

    /// Marks a node and its ancestors as having too many segments for a leaf. Pending descendants
    /// are output first, so that nodes stay in the order of their codes.
    fn divide(&mut self, index: usize) {
        for open in &mut self.open[..=index] {
            open.is_divided = true;
            open.waiting = 0;
            for (code, segments) in open.pending.drain(..) {
                self.made.push(BuiltItem::Block(code, segments));
                self.made.push(BuiltItem::Node(code));
            }
        }
    }

    /// Closes the deepest open node.
    fn close(&mut self) {
        let index = self.open.len() - 1;
        if self.open[index].own.len() + self.open[index].waiting > self.leaf_size {
            self.divide(index);
        }
        let Some(mut open) = self.open.pop() else { return };
        if open.is_divided {
            if !open.own.is_empty() {
                self.made.push(BuiltItem::Block(open.code, open.own));
            }
            self.made.push(BuiltItem::Node(open.code));
            return;
        }
        for (_, segments) in open.pending {
            open.own.extend(segments);
        }
        if open.own.is_empty() {
            return;
        }
        match self.open.last_mut() {
            Some(above) if !above.is_divided => {
                above.waiting += open.own.len();
                above.pending.push((open.code, open.own));
                if above.waiting + above.own.len() > self.leaf_size {
                    self.divide(index - 1);
                }
            }
            _ => {
                self.made.push(BuiltItem::Block(open.code, open.own));
                self.made.push(BuiltItem::Node(open.code));
            }
        }
    }

    fn finish(mut self) -> Vec<BuiltItem> {
        while !self.open.is_empty() {
            self.close();
        }
        self.made
    }
}

/// Encodes and writes an assembler's output, and accumulates the statistics of nodes.
struct Totals<'g> {
    grid: &'g LineGrid,
    writer: LineWriter,
    /// Statistics of the own segments of incomplete nodes.
    open: Vec<(Code, Statistics)>,
    /// Complete nodes whose parents are incomplete.
    closed: Vec<(Code, Statistics)>,
}

impl Totals<'_> {
    fn take(&mut self, made: Vec<BuiltItem>) -> Result<()> {
        let encoded = parallel::map(&made, |made| match made {
            BuiltItem::Node(_) => (Vec::new(), Statistics::NONE),
            BuiltItem::Block(_, segments) => {
                let mut segments = segments.clone();
                let bytes = encode_segments(&mut segments, self.grid.axes());
                (bytes, statistics_of(self.grid, &segments))
            }
        });
        for (made, (bytes, statistics)) in made.iter().zip(encoded) {
            match made {
                BuiltItem::Block(code, _) => {
                    self.writer.block(*code, &bytes, &statistics)?;
                    match self.open.iter_mut().find(|(open, _)| open == code) {
                        Some((_, own)) => own.add(&statistics),
                        None => self.open.push((*code, statistics)),
                    }
                }
                BuiltItem::Node(code) => {
                    let own = self.open.iter().position(|(open, _)| open == code);
                    let mut all = own.map_or(Statistics::NONE, |own| self.open.swap_remove(own).1);
                    let first = self.closed.iter().rposition(|(closed, _)| !code.contains(*closed));
                    let mut below = Statistics::NONE;
                    self.closed
                        .drain(first.map_or(0, |before| before + 1)..)
                        .for_each(|(_, statistics)| below.add(&statistics));
                    all.add(&below);
                    self.writer.node(*code, &all)?;
                    self.closed.push((*code, all));
                }
            }
        }
        Ok(())
    }
}
