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

/// Encodes segments after sorting them by feature and vertex: columns of features, vertices, starts
/// and steps along each of two or three axes, and first levels.
pub(crate) fn encode_segments(segments: &mut [LineSegment], axes: usize) -> Vec<u8> {
    sort::by_wide_key(segments, |segment| u128::from(segment.feature) << 32 | u128::from(segment.vertex));
    let column = || Vec::with_capacity(segments.len());
    let (mut features, mut vertices, mut firsts) = (column(), column(), column());
    let mut starts: [Vec<i64>; 3] = std::array::from_fn(|_| column());
    let mut steps: [Vec<i64>; 3] = std::array::from_fn(|_| column());
    let mut contexts = Vec::with_capacity(segments.len());
    let mut before = LineSegment { ends: [[0; 3]; 2], feature: 0, vertex: 0, first: 0 };
    for segment in &*segments {
        let feature = (segment.feature - before.feature) as i64;
        let vertex = i64::from(segment.vertex) - if feature == 0 { i64::from(before.vertex) } else { 0 };
        features.push(feature);
        vertices.push(vertex);
        contexts.push(if feature == 0 && vertex == 1 { GOES_ON } else { 0 });
        for axis in 0..axes {
            let number = |end: [i32; 3]| i64::from(end[axis]);
            starts[axis].push(number(segment.ends[0]) - number(before.ends[1]));
            steps[axis].push(number(segment.ends[1]) - number(segment.ends[0]));
        }
        firsts.push(segment.first.into());
        before = *segment;
    }
    let mut bytes = Vec::new();
    write(&features, &[], &mut bytes);
    write(&vertices, &[], &mut bytes);
    starts[..axes].iter().for_each(|column| write(column, &contexts, &mut bytes));
    steps[..axes].iter().for_each(|column| write(column, &[], &mut bytes));
    write(&firsts, &[], &mut bytes);
    bytes
}

/// Decodes `count` segments of two or three axes; `None` if the bytes are invalid.
pub(crate) fn decode_segments(bytes: &[u8], count: usize, axes: usize) -> Option<Vec<LineSegment>> {
    if count > MAX_SEGMENTS {
        return None;
    }
    let mut reader = Reader::new(bytes);
    let features = reader.numbers(count, &[])?;
    let vertices = reader.numbers(count, &[])?;
    let goes_on = |(feature, vertex): (&i64, &i64)| if *feature == 0 && *vertex == 1 { GOES_ON } else { 0 };
    let contexts: Vec<u8> = features.iter().zip(&vertices).map(goes_on).collect();
    let mut columns = |contexts: &[u8]| {
        (0..axes).map(|_| reader.numbers(count, contexts)).collect::<Option<Vec<Vec<i64>>>>()
    };
    let (starts, lengths) = (columns(&contexts)?, columns(&[])?);
    let firsts = reader.numbers(count, &[])?;
    if !reader.is_whole() {
        return None;
    }
    let mut before = LineSegment { ends: [[0; 3]; 2], feature: 0, vertex: 0, first: 0 };
    let mut segments = Vec::with_capacity(count);
    for index in 0..count {
        let steps = u64::try_from(features[index]).ok()?;
        let vertex = vertices[index].checked_add(if steps == 0 { before.vertex.into() } else { 0 })?;
        let mut ends = [[0; 3]; 2];
        for axis in 0..axes {
            let start = starts[axis][index].checked_add(before.ends[1][axis].into())?;
            ends[0][axis] = i32::try_from(start).ok()?;
            ends[1][axis] = i32::try_from(lengths[axis][index].checked_add(start)?).ok()?;
        }
        before = LineSegment {
            ends,
            feature: before.feature.checked_add(steps)?,
            vertex: u32::try_from(vertex).ok()?,
            first: u8::try_from(firsts[index]).ok()?,
        };
        segments.push(before);
    }
    Some(segments)
}
