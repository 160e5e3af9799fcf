//! Intersections of a tree's lines with other lines.

use super::block_index::BlockIndex;
use super::select::check_numbers;
use crate::geometry::{FRACTION, FixedPosition, box_of, ends, fixed_box, meet, meeting, meets_box};
use crate::store::LineTree;
use spinney_base::{Error, Progress, Result, parallel, sort};

/// Intersection of a line segment of the tree with a segment of another line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineCrossing {
    /// Number of the feature.
    pub feature: u64,
    /// Index of the segment's first vertex among all vertices of the feature.
    pub vertex: u32,
    /// Index of the other line.
    pub line: usize,
    /// Index of the segment in the other line.
    pub segment: usize,
    /// Intersection point in the world; for collinear segments, one point of the overlap.
    pub position: [f64; 2],
}

/// Segment of the tree, segment of other lines, and their intersection point.
struct SegmentCrossing {
    feature: u64,
    vertex: u32,
    segment: u32,
    position: [f64; 2],
}

impl LineTree {
    /// Finds all segments that cross or touch other lines, sorted by the index of the other line,
    /// its segment, feature and vertex. Vertices of the other lines are rounded to 2^-16 of a grid
    /// unit; intersection tests are exact from there on. A line with a single vertex intersects
    /// nothing.
    ///
    /// # Errors
    /// If a coordinate is NaN, the other lines have 2^32 or more segments, the file is corrupt or
    /// cannot be read.
    pub fn crossings(&self, lines: &[Vec<[f64; 2]>], progress: &dyn Progress) -> Result<Vec<LineCrossing>> {
        let grid = self.grid();
        let mut segments: Vec<[FixedPosition; 2]> = Vec::new();
        // Index of each line's first segment.
        let mut firsts: Vec<u32> = Vec::with_capacity(lines.len());
        for line in lines {
            check_numbers("line", line)?;
            firsts.push(segments.len() as u32);
            segments.extend(line.windows(2).map(|pair| [grid.fixed(pair[0]), grid.fixed(pair[1])]));
        }
        if segments.len() > u32::MAX as usize {
            let expected = "fewer than 2^32: query some of the lines at a time";
            return Err(Error::invalid("lines", format!("{} segments", segments.len()), expected));
        }
        let chosen = self.blocks_near(&segments, progress)?;
        let mut found = Vec::new();
        for batch in chosen.chunks(4 * parallel::threads()) {
            progress.check()?;
            for met in parallel::map(batch, |(block, wanted)| self.meetings(*block, wanted, &segments)) {
                found.extend(met?);
            }
            progress.advance(batch.len() as u64, chosen.len() as u64);
        }
        sort::by_wide_key(&mut found, |met| {
            u128::from(met.segment) << 96 | u128::from(met.feature) << 32 | u128::from(met.vertex)
        });
        let crossing = |met: SegmentCrossing| {
            let line = firsts.partition_point(|first| *first <= met.segment) - 1;
            let SegmentCrossing { feature, vertex, position, .. } = met;
            LineCrossing { feature, vertex, line, segment: (met.segment - firsts[line]) as usize, position }
        };
        Ok(found.into_iter().map(crossing).collect())
    }

    /// Blocks whose bounds intersect segments, each with the indices of these segments.
    fn blocks_near(
        &self,
        segments: &[[FixedPosition; 2]],
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, Vec<u32>)>> {
        let mut chosen = Vec::new();
        let all: Vec<u32> = (0..segments.len() as u32).collect();
        let mut open: Vec<_> = self.root()?.map(|root| (root, all)).into_iter().collect();
        while let Some((node, wanted)) = open.pop() {
            progress.check()?;
            let within = |bounds| -> Vec<u32> {
                let bounds = fixed_box(bounds);
                wanted
                    .iter()
                    .copied()
                    .filter(|segment| meets_box(segments[*segment as usize], bounds))
                    .collect()
            };
            for block in self.blocks_of(node.code) {
                let own = within(self.block_entry(block).bounds);
                if !own.is_empty() {
                    chosen.push((block, own));
                }
            }
            for child in self.children(&node)? {
                let own = within(child.bounds);
                if !own.is_empty() {
                    open.push((child, own));
                }
            }
        }
        Ok(chosen)
    }

    /// Intersections of a block's segments with the segments in `wanted`.
    fn meetings(
        &self,
        block: usize,
        wanted: &[u32],
        segments: &[[FixedPosition; 2]],
    ) -> Result<Vec<SegmentCrossing>> {
        let index = BlockIndex::new(self.grid(), self.block(block)?);
        let mut found = Vec::new();
        for number in wanted {
            let line = segments[*number as usize];
            index.each_in(box_of(line), &mut |segment| {
                let own = ends(segment.ends);
                if meet(own, line) {
                    let at = meeting(line, own);
                    let position = self.grid().world(at.map(|number| number / FRACTION as f64));
                    found.push(SegmentCrossing {
                        feature: segment.feature,
                        vertex: segment.vertex,
                        segment: *number,
                        position,
                    });
                }
            });
        }
        Ok(found)
    }
}
