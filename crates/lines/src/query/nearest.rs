//! Nearest-line queries.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::best::Best;
use super::block_index::BlockIndex;
use crate::codec::LineSegment;
use crate::geometry::{
    FRACTION, FixedPosition, ends, fixed_box, nearest_point, square_distance, square_to_box,
};
use crate::grid::LineAxes;
use crate::store::LineTree;
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result, parallel, sort};

/// Line near a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearLine {
    /// Number of the feature.
    pub feature: u64,
    /// Index of the nearest segment's first vertex among all vertices of the feature.
    pub vertex: u32,
    /// Distance in the world.
    pub distance: f64,
    /// Nearest point on the line, with its height; z is 0 in a tree of two axes.
    pub position: [f64; 3],
}

/// Node in memory, for searches.
struct NearNode {
    /// End (exclusive) of the subtree in preorder.
    end: u32,
    /// Range of the blocks with its own segments.
    blocks: (u32, u32),
    /// Minimum and maximum corner of all segments in its subtree.
    corners: [[i32; 3]; 2],
}

/// Cache of block indexes for further queries.
#[derive(Default)]
struct BlockIndexCache {
    blocks: HashMap<u32, Arc<BlockIndex>>,
    bytes: u64,
}

/// Nearest-line search that caches decoded blocks between queries.
pub struct NearestLines<'t> {
    tree: &'t LineTree,
    nodes: Vec<NearNode>,
    block_corners: Vec<[[i32; 3]; 2]>,
    max_bytes: u64,
    cache: Mutex<BlockIndexCache>,
}

/// Query points per task; a task processes its points sequentially.
const TOGETHER: usize = 1024;
/// Query points between checks for cancellation, since some take long.
const CHECKED: usize = 32;
/// Default size of the block cache in bytes.
const MEMORY: u64 = 256 << 20;

impl LineTree {
    /// Finds the lines nearest to each of several points, as [`NearestLines::find`] does.
    ///
    /// # Errors
    /// Those of [`NearestLines::new`] and [`NearestLines::find`].
    pub fn nearest(
        &self,
        positions: &[[f64; 3]],
        most: usize,
        within: f64,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<NearLine>>> {
        NearestLines::new(self, MEMORY)?.find(positions, most, within, progress)
    }
}

impl<'t> NearestLines<'t> {
    /// Prepares searches with a block cache of about `memory` bytes.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub fn new(tree: &'t LineTree, memory: u64) -> Result<NearestLines<'t>> {
        let (nodes, blocks, _) = tree.counts();
        let mut near: Vec<NearNode> = Vec::with_capacity(nodes);
        let mut open: Vec<(Code, usize)> = Vec::new();
        for index in 0..nodes {
            let node = tree.node(index)?;
            while let Some((_, above)) = open.pop_if(|(code, _)| !code.contains(node.code)) {
                near[above].end = index as u32;
            }
            let blocks = tree.blocks_of(node.code);
            let blocks = (blocks.start as u32, blocks.end as u32);
            near.push(NearNode { end: nodes as u32, blocks, corners: node.bounds });
            open.push((node.code, index));
        }
        let block_corners = (0..blocks).map(|block| tree.block_entry(block).bounds).collect();
        let cache = Mutex::default();
        Ok(NearestLines { tree, nodes: near, block_corners, max_bytes: memory, cache })
    }

    /// Finds the lines nearest to each of several points: at most `most` features, none farther
    /// than `within`, nearest first. On equal distances, the feature with the lower number comes
    /// first. Distances are those in x and y if z is NaN, or is not in their unit:
    /// [`LineGrid::measures_space`](crate::LineGrid::measures_space).
    ///
    /// Points are rounded to 2^-16 of a grid unit. Whether a vertex or an interior point of a
    /// segment is nearest is decided exactly, and lines that share the nearest vertex have equal
    /// distances; otherwise squared distances are doubles. Points are processed in the order of
    /// their codes, so that each block is decoded about once.
    ///
    /// # Errors
    /// If a coordinate is not finite or too distant from the lines, the file is corrupt or cannot
    /// be read.
    pub fn find(
        &self,
        positions: &[[f64; 3]],
        most: usize,
        within: f64,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<NearLine>>> {
        let grid = self.tree.grid();
        let is_wrong = |position: &&[f64; 3]| {
            let [x, y, z] = **position;
            !(x.is_finite() && y.is_finite() && !z.is_infinite())
                || grid.is_far(**position, grid.axes_for(&[**position]))
        };
        if let Some(position) = positions.iter().find(is_wrong) {
            let expected = "finite coordinates in the coordinate system of the lines, and near them";
            return Err(Error::invalid("position", format!("{position:?}"), expected));
        }
        let mut found = vec![Vec::new(); positions.len()];
        if most == 0 || within.is_nan() || within < 0.0 {
            return Ok(found);
        }
        let steps = within / grid.scale[0] * FRACTION as f64;
        let order = self.order(positions);
        let batches: Vec<&[u32]> = order.chunks(TOGETHER).collect();
        for batch in batches.chunks(8 * parallel::threads()) {
            progress.check()?;
            let terms = (most, steps * steps);
            let results = parallel::map(batch, |queries| self.run(queries, positions, terms, progress));
            for (queries, results) in batch.iter().zip(results) {
                for (query, nearest) in queries.iter().zip(results?) {
                    found[*query as usize] = nearest;
                }
                progress.advance(queries.len() as u64, positions.len() as u64);
            }
        }
        Ok(found)
    }

    /// Indices of points, sorted by the codes of their cells, clamped to the root.
    fn order(&self, positions: &[[f64; 3]]) -> Vec<u32> {
        let grid = self.tree.grid();
        let far = (1i64 << grid.bits) - 1;
        let key = |position: &[f64; 3]| {
            let fixed = grid.fixed(*position, grid.axes_for(&[*position]));
            let step = std::array::from_fn(|axis| {
                let corner = i64::from(grid.corner[axis]);
                let step = (fixed[axis] / FRACTION - corner).clamp(0, far) + corner;
                step.clamp(i32::MIN.into(), i32::MAX.into()) as i32
            });
            grid.code([step; 2]).map_or(0, |code| code.bits())
        };
        let number = |(number, position)| u128::from(key(position)) << 32 | number as u128;
        let mut order: Vec<u128> = positions.iter().enumerate().map(number).collect();
        sort::numbers128(&mut order);
        order.into_iter().map(|key| key as u32).collect()
    }

    /// Processes query points that are near each other, given by their indices. The result for one
    /// point is the initial set for the next.
    fn run(
        &self,
        queries: &[u32],
        positions: &[[f64; 3]],
        (most, limit): (usize, f64),
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<NearLine>>> {
        // Block indexes that this thread already has need no lock.
        let mut at_hand = HashMap::new();
        let mut before: Vec<(f64, LineSegment)> = Vec::new();
        let grid = self.tree.grid();
        let mut results = Vec::with_capacity(queries.len());
        for (number, query) in queries.iter().enumerate() {
            if number % CHECKED == 0 {
                progress.check()?;
            }
            let position = positions[*query as usize];
            let axes = grid.axes_for(&[position]);
            let from = grid.fixed(position, axes);
            let mut best = Best::new(most, limit);
            for (_, segment) in &before {
                best.offer(square_distance(axes.of(ends(segment.ends)), from), segment);
            }
            if !self.nodes.is_empty() {
                self.search_node(0, (from, axes), &mut best, &mut at_hand)?;
            }
            before = best.finish();
            let near = |(square, segment): &(f64, LineSegment)| NearLine {
                feature: segment.feature,
                vertex: segment.vertex,
                distance: grid.units(square.sqrt() / FRACTION as f64),
                position: grid
                    .world(nearest_point(ends(segment.ends), from, axes).map(|at| at / FRACTION as f64)),
            };
            results.push(before.iter().map(near).collect());
        }
        Ok(results)
    }

    /// Searches a node: its children first, nearest first, since the deepest levels have the most
    /// segments.
    fn search_node(
        &self,
        index: usize,
        (from, axes): (FixedPosition, LineAxes),
        best: &mut Best,
        at_hand: &mut HashMap<u32, Arc<BlockIndex>>,
    ) -> Result<()> {
        let node = &self.nodes[index];
        let square = |corners: [[i32; 3]; 2]| square_to_box(axes.of(fixed_box(corners)), from);
        let mut children = [(0.0, 0usize); 8];
        let mut count = 0;
        let mut child = index + 1;
        while child < node.end as usize {
            // In an untrusted file, nodes may lack parents, so that a node seems to have more than
            // eight children. The excess is ignored.
            let Some(slot) = children.get_mut(count) else { break };
            *slot = (square(self.nodes[child].corners), child);
            count += 1;
            child = (self.nodes[child].end as usize).max(child + 1);
        }
        let children = &mut children[..count];
        children.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (square, child) in children {
            if *square <= best.limit() {
                self.search_node(*child, (from, axes), best, at_hand)?;
            }
        }
        for block in node.blocks.0..node.blocks.1 {
            if square(self.block_corners[block as usize]) <= best.limit() {
                let index = match at_hand.get(&block) {
                    Some(index) => index,
                    None => {
                        let index = self.block(block)?;
                        at_hand.entry(block).or_insert(index)
                    }
                };
                index.search(from, axes, best);
            }
        }
        Ok(())
    }

    /// Index of a block, cached.
    fn block(&self, block: u32) -> Result<Arc<BlockIndex>> {
        let cache = || self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = cache().blocks.get(&block) {
            return Ok(index.clone());
        }
        let index = Arc::new(BlockIndex::new(self.tree.grid(), self.tree.block(block as usize)?));
        let mut cache = cache();
        if cache.bytes + index.bytes() > self.max_bytes {
            // Points come in the order of codes, so blocks cached for earlier ones are seldom
            // needed again.
            cache.blocks.clear();
            cache.bytes = 0;
        }
        cache.bytes += index.bytes();
        cache.blocks.insert(block, index.clone());
        Ok(index)
    }
}
