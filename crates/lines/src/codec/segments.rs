//! Blocks of line segments.

use super::numbers::{Reader, write};
use crate::geometry::Segment;
use spinney_base::sort;

/// Maximum number of segments in a block.
pub(crate) const MAX_SEGMENTS: usize = 1 << 16;

/// Line segment between two consecutive vertices of a feature's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LineSegment {
    pub ends: Segment,
    /// Number of its feature.
    pub feature: u64,
    /// Index of its first vertex among all vertices of the feature.
    pub vertex: u32,
    /// Minimum level at which the segment is the first one of its feature in its ancestor node, in
    /// the order of codes. Counting these per node gives the number of distinct features.
    pub first: u8,
}

/// Context of coordinates of a segment that continues the previous one.
const GOES_ON: u8 = 1;

/// Encodes segments in seven columns, after sorting them by feature and vertex.
pub(crate) fn encode_segments(segments: &mut [LineSegment]) -> Vec<u8> {
    sort::by_wide_key(segments, |segment| u128::from(segment.feature) << 32 | u128::from(segment.vertex));
    let mut columns: [Vec<i64>; 7] = std::array::from_fn(|_| Vec::with_capacity(segments.len()));
    let mut contexts = Vec::with_capacity(segments.len());
    let mut before = LineSegment { ends: [[0; 2]; 2], feature: 0, vertex: 0, first: 0 };
    for segment in &*segments {
        let steps = (segment.feature - before.feature) as i64;
        let vertex = i64::from(segment.vertex) - if steps == 0 { i64::from(before.vertex) } else { 0 };
        columns[0].push(steps);
        columns[1].push(vertex);
        contexts.push(if steps == 0 && vertex == 1 { GOES_ON } else { 0 });
        for axis in 0..2 {
            let number = |end: [i32; 2]| i64::from(end[axis]);
            columns[2 + axis].push(number(segment.ends[0]) - number(before.ends[1]));
            columns[4 + axis].push(number(segment.ends[1]) - number(segment.ends[0]));
        }
        columns[6].push(segment.first.into());
        before = *segment;
    }
    let mut bytes = Vec::new();
    for (number, column) in columns.iter().enumerate() {
        let contexts = if (2..4).contains(&number) { &contexts[..] } else { &[] };
        write(column, contexts, &mut bytes);
    }
    bytes
}

/// Decodes `count` segments; `None` if the bytes are invalid.
pub(crate) fn decode_segments(bytes: &[u8], count: usize) -> Option<Vec<LineSegment>> {
    if count > MAX_SEGMENTS {
        return None;
    }
    let mut reader = Reader::new(bytes);
    let features = reader.numbers(count, &[])?;
    let vertices = reader.numbers(count, &[])?;
    let goes_on = |(feature, vertex): (&i64, &i64)| if *feature == 0 && *vertex == 1 { GOES_ON } else { 0 };
    let contexts: Vec<u8> = features.iter().zip(&vertices).map(goes_on).collect();
    let mut columns = Vec::with_capacity(5);
    for number in 2..7 {
        columns.push(reader.numbers(count, if number < 4 { &contexts } else { &[] })?);
    }
    if !reader.is_whole() {
        return None;
    }
    let mut before = LineSegment { ends: [[0; 2]; 2], feature: 0, vertex: 0, first: 0 };
    let mut segments = Vec::with_capacity(count);
    for index in 0..count {
        let steps = u64::try_from(features[index]).ok()?;
        let vertex = vertices[index].checked_add(if steps == 0 { before.vertex.into() } else { 0 })?;
        let mut ends = [[0; 2]; 2];
        for axis in 0..2 {
            let start = columns[axis][index].checked_add(before.ends[1][axis].into())?;
            ends[0][axis] = i32::try_from(start).ok()?;
            ends[1][axis] = i32::try_from(columns[2 + axis][index].checked_add(start)?).ok()?;
        }
        before = LineSegment {
            ends,
            feature: before.feature.checked_add(steps)?,
            vertex: u32::try_from(vertex).ok()?,
            first: u8::try_from(columns[4][index]).ok()?,
        };
        segments.push(before);
    }
    Some(segments)
}
