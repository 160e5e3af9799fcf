//! Intersections of a tree's lines with other lines, and lines near them.

use super::block_index::BlockIndex;
use crate::geometry::{
    FRACTION, FixedPosition, between, box_of, ends, extended, fixed_box, meet, meeting, meets_box,
    nearest_point,
};
use crate::grid::LineAxes;
use crate::store::LineTree;
use spinney_base::{Error, Progress, Result, parallel, sort};

/// Line segment of the tree that intersects a segment of another line, or is near it.
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
    /// Distance in the world; 0 if they intersect.
    pub distance: f64,
    /// In the world, the intersection point, one point of the overlap of collinear segments, or the
    /// point of the other line that is nearest to the tree's segment. In the plane, z is the height
    /// of the tree's segment at that point, 0 in a tree of two axes.
    pub position: [f64; 3],
}

/// Segment of another line, in the axes that count.
#[derive(Clone, Copy)]
struct OtherSegment {
    ends: [FixedPosition; 2],
    axes: LineAxes,
}

/// Segment of the tree, segment of other lines, their distance and intersection point.
struct SegmentCrossing {
    feature: u64,
    vertex: u32,
    segment: u32,
    distance: f64,
    position: [f64; 3],
}

impl LineTree {
    /// Finds all segments that cross or touch other lines, or are at most the distance `within`
    /// from them, sorted by the index of the other line, its segment, feature and vertex. Vertices
    /// of the other lines are rounded to 2^-16 of a grid unit; intersection tests are exact from
    /// there on, also in space, and distances are doubles. A line with a z that is NaN has no
    /// heights: it crosses lines at any height, and distances are those in x and y; likewise in a
    /// tree whose z is not in their unit
    /// ([`LineGrid::measures_space`](crate::LineGrid::measures_space)). A line with a single vertex
    /// intersects nothing.
    ///
    /// # Errors
    /// If x or y is NaN, the distance is not a finite number of at least 0, the other lines have
    /// 2^32 or more segments, the file is corrupt or cannot be read.
    pub fn crossings(
        &self,
        lines: &[Vec<[f64; 3]>],
        within: f64,
        progress: &dyn Progress,
    ) -> Result<Vec<LineCrossing>> {
        let grid = self.grid();
        if !within.is_finite() || within < 0.0 {
            return Err(Error::invalid("distance", within.to_string(), "a finite number of at least 0"));
        }
        let within = within / grid.scale[0] * FRACTION as f64;
        let mut segments: Vec<OtherSegment> = Vec::new();
        // Index of each line's first segment.
        let mut firsts: Vec<u32> = Vec::with_capacity(lines.len());
        for line in lines {
            if line.iter().any(|[x, y, _]| x.is_nan() || y.is_nan()) {
                return Err(Error::invalid("line", format!("{line:?}"), "coordinates without NaN"));
            }
            let axes = grid.axes_for(line);
            firsts.push(segments.len() as u32);
            let at = |position: [f64; 3]| grid.fixed(position, axes);
            segments
                .extend(line.windows(2).map(|pair| OtherSegment { ends: [at(pair[0]), at(pair[1])], axes }));
        }
        if segments.len() > u32::MAX as usize {
            let expected = "fewer than 2^32: query some of the lines at a time";
            return Err(Error::invalid("lines", format!("{} segments", segments.len()), expected));
        }
        let chosen = self.blocks_near(&segments, within, progress)?;
        let mut found = Vec::new();
        for batch in chosen.chunks(4 * parallel::threads()) {
            progress.check()?;
            for met in
                parallel::map(batch, |(block, wanted)| self.meetings(*block, wanted, &segments, within))
            {
                found.extend(met?);
            }
            progress.advance(batch.len() as u64, chosen.len() as u64);
        }
        sort::by_wide_key(&mut found, |met| {
            u128::from(met.segment) << 96 | u128::from(met.feature) << 32 | u128::from(met.vertex)
        });
        let crossing = |met: SegmentCrossing| {
            let line = firsts.partition_point(|first| *first <= met.segment) - 1;
            let SegmentCrossing { feature, vertex, distance, position, .. } = met;
            let segment = (met.segment - firsts[line]) as usize;
            LineCrossing { feature, vertex, line, segment, distance, position }
        };
        Ok(found.into_iter().map(crossing).collect())
    }

    /// Blocks whose bounds, extended by a distance in fixed point, intersect segments, each with
    /// the indices of these segments.
    fn blocks_near(
        &self,
        segments: &[OtherSegment],
        within: f64,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, Vec<u32>)>> {
        let mut chosen = Vec::new();
        let all: Vec<u32> = (0..segments.len() as u32).collect();
        let mut open: Vec<_> = self.root()?.map(|root| (root, all)).into_iter().collect();
        while let Some((node, wanted)) = open.pop() {
            progress.check()?;
            let near = |bounds| -> Vec<u32> {
                let is_near = |segment: &u32| {
                    let OtherSegment { ends, axes } = segments[*segment as usize];
                    meets_box(ends, extended(axes.of(fixed_box(bounds)), within))
                };
                wanted.iter().copied().filter(is_near).collect()
            };
            for block in self.blocks_of(node.code) {
                let own = near(self.block_entry(block).bounds);
                if !own.is_empty() {
                    chosen.push((block, own));
                }
            }
            for child in self.children(&node)? {
                let own = near(child.bounds);
                if !own.is_empty() {
                    open.push((child, own));
                }
            }
        }
        Ok(chosen)
    }

    /// Segments of a block that are at most a distance, in fixed point, from those in `wanted`.
    fn meetings(
        &self,
        block: usize,
        wanted: &[u32],
        segments: &[OtherSegment],
        within: f64,
    ) -> Result<Vec<SegmentCrossing>> {
        let index = BlockIndex::new(self.grid(), self.block(block)?);
        let mut found = Vec::new();
        for number in wanted {
            let OtherSegment { ends: line, axes } = segments[*number as usize];
            let mut around = extended(box_of(line), within);
            if axes == LineAxes::Plane {
                (around[0][2], around[1][2]) = (i64::MIN, i64::MAX);
            }
            index.each_in(around, &mut |segment| {
                let in_space = ends(segment.ends);
                let own = axes.of(in_space);
                let (square, mut at) = match meet(own, line) {
                    true => (0.0, meeting(line, own)),
                    false if within > 0.0 => between(line, own),
                    false => return,
                };
                if square <= within * within {
                    if axes == LineAxes::Plane {
                        at[2] = nearest_point(in_space, at.map(|number| number.round() as i64), axes)[2];
                    }
                    found.push(SegmentCrossing {
                        feature: segment.feature,
                        vertex: segment.vertex,
                        segment: *number,
                        distance: self.grid().units(square.sqrt() / FRACTION as f64),
                        position: self.grid().world(at.map(|number| number / FRACTION as f64)),
                    });
                }
            });
        }
        Ok(found)
    }
}
