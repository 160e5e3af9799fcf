//! Window queries; counts and lengths.

use std::collections::BTreeSet;

use crate::codec::LineSegment;
use crate::geometry::{FixedPosition, box_of, boxes_meet, ends, fixed_box, meets_box};
use crate::grid::LineAxes;
use crate::store::{LineNode, LineTree};
use spinney_base::{Error, Progress, Result, parallel};

/// Totals of the nodes of a level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelTotals {
    /// Number of nodes.
    pub nodes: u64,
    /// Number of segments in the nodes themselves, without descendants.
    pub segments: u64,
    /// Total length of these segments.
    pub length: f64,
    /// Maximum number of segments in a node's subtree.
    pub most_segments: u64,
    /// Maximum number of features in a node's subtree.
    pub most_features: u64,
}

impl LineTree {
    /// Returns the numbers of the features with a line that intersects a window, including its
    /// border, in ascending order. The window's corners, which may be infinite, are rounded to
    /// 2^-16 of a grid unit; tests are exact from there on. In a tree of two axes, z is ignored.
    ///
    /// # Errors
    /// If a coordinate is NaN, the file is corrupt or cannot be read.
    pub fn window(&self, [least, most]: [[f64; 3]; 2], progress: &dyn Progress) -> Result<Vec<u64>> {
        if least.iter().chain(&most).any(|number| number.is_nan()) {
            return Err(Error::invalid("window", format!("{least:?} {most:?}"), "coordinates without NaN"));
        }
        let window = [least, most].map(|corner| self.grid().fixed(corner, LineAxes::Space));
        let mut found = BTreeSet::new();
        if (0..self.grid().axes()).any(|axis| least[axis] > most[axis]) {
            return Ok(Vec::new());
        }
        let is_inside = |[low, high]: [FixedPosition; 2]| {
            (0..3).all(|axis| window[0][axis] <= low[axis] && high[axis] <= window[1][axis])
        };
        self.each_block(
            &|bounds| boxes_meet(bounds, window),
            &mut |segments| {
                for segment in segments {
                    let line = ends(segment.ends);
                    if !found.contains(&segment.feature)
                        && (is_inside(box_of(line)) || meets_box(line, window))
                    {
                        found.insert(segment.feature);
                    }
                }
            },
            progress,
        )?;
        Ok(found.into_iter().collect())
    }

    /// Calls `each` with the segments of all blocks whose bounds satisfy `is_wanted`.
    fn each_block(
        &self,
        is_wanted: &dyn Fn([FixedPosition; 2]) -> bool,
        each: &mut dyn FnMut(&[LineSegment]),
        progress: &dyn Progress,
    ) -> Result<()> {
        let mut chosen = Vec::new();
        let mut open: Vec<LineNode> = self.root()?.into_iter().collect();
        while let Some(node) = open.pop() {
            if is_wanted(fixed_box(node.bounds)) {
                let blocks = self.blocks_of(node.code);
                chosen.extend(blocks.filter(|block| is_wanted(fixed_box(self.block_entry(*block).bounds))));
                open.extend(self.children(&node)?);
            }
        }
        for batch in chosen.chunks(4 * parallel::threads()) {
            progress.check()?;
            for segments in parallel::map(batch, |block| self.block(*block)) {
                each(&segments?);
            }
            progress.advance(batch.len() as u64, chosen.len() as u64);
        }
        Ok(())
    }

    /// Returns the total length of all lines, as stored in the root. Reads no lines.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub fn length(&self) -> Result<f64> {
        Ok(self.root()?.map_or(0.0, |root| root.length))
    }

    /// Returns totals of the nodes of each level, from the root down. Reads no lines.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub fn levels(&self) -> Result<Vec<LevelTotals>> {
        let mut levels: Vec<LevelTotals> = Vec::new();
        // Ancestors of the current node.
        let mut above: Vec<LineNode> = Vec::new();
        for index in 0..self.counts().0 {
            let node = self.node(index)?;
            let level = usize::from(node.code.level());
            if levels.len() <= level {
                levels.resize(level + 1, LevelTotals::default());
            }
            let own = &mut levels[level];
            own.nodes += 1;
            own.segments = own.segments.wrapping_add(node.segments);
            own.length += node.length;
            own.most_segments = own.most_segments.max(node.segments);
            own.most_features = own.most_features.max(node.features);
            while above.pop_if(|above| !above.code.contains(node.code)).is_some() {}
            if let Some(parent) = above.last() {
                // Counts of a node include its descendants.
                let parent = &mut levels[usize::from(parent.code.level())];
                parent.segments = parent.segments.wrapping_sub(node.segments);
                parent.length -= node.length;
            }
            above.push(node);
        }
        Ok(levels)
    }
}
