//! Nearest-neighbour queries.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::block_index::{Best, BlockIndex, IndexedPoint};
use crate::store::PointTree;
use spinney_base::{Error, Progress, Result, parallel, sort};

/// Result of a nearest-neighbour query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearPoint {
    /// Position, in the coordinates of the points.
    pub position: [f64; 3],
    /// Distance; along x and y only in a quadtree, or if the query position has no z.
    pub distance: f64,
    /// Block number and index in the block, which together identify the point in the file.
    pub number: (u32, u32),
}

/// Node of a search.
struct NearNode {
    /// Index of the first node after its subtree, in preorder.
    end: u32,
    /// Range of the blocks of its own points.
    blocks: (u32, u32),
    /// World bounding box of all points in it and below.
    corners: [[f64; 3]; 2],
}

/// Block indexes that are cached for further queries.
#[derive(Default)]
struct BlockIndexCache {
    blocks: HashMap<u32, Arc<BlockIndex>>,
    bytes: u64,
}

struct Search<'t> {
    tree: &'t PointTree,
    nodes: Vec<NearNode>,
    block_corners: Vec<[[f64; 3]; 2]>,
    axes: usize,
    max_bytes: u64,
    cache: Mutex<BlockIndexCache>,
}

/// Number of queries that one thread runs in sequence.
const TOGETHER: usize = 1024;

impl PointTree {
    /// Finds up to `most` nearest points for each of the positions, none farther than `within`.
    /// Results are sorted by distance; ties are in file order. z does not count in a quadtree, nor
    /// for positions whose z is NaN.
    ///
    /// Queries run in code order, so that each block is decompressed about once. About `memory`
    /// bytes of block indexes are cached.
    ///
    /// # Errors
    /// If a coordinate is not a number, or the file is corrupt or cannot be read.
    pub fn nearest(
        &self,
        positions: &[[f64; 3]],
        most: usize,
        within: f64,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<NearPoint>>> {
        if let Some(position) =
            positions.iter().find(|[x, y, z]| !(x.is_finite() && y.is_finite() && !z.is_infinite()))
        {
            let found = format!("{position:?}");
            return Err(Error::invalid("position", found, "finite x and y, and z that is finite or NaN"));
        }
        if most == 0 || within.is_nan() {
            return Ok(vec![Vec::new(); positions.len()]);
        }
        let search = Search::new(self, memory)?;
        let order = self.order(positions);
        let mut found = vec![Vec::new(); positions.len()];
        let batches: Vec<&[u32]> = order.chunks(TOGETHER).collect();
        for batch in batches.chunks(8 * parallel::threads()) {
            progress.check()?;
            let results =
                parallel::map(batch, |queries| search.run(queries, positions, (most, within * within)));
            for (queries, results) in batch.iter().zip(results) {
                for (query, nearest) in queries.iter().zip(results?) {
                    found[*query as usize] = nearest;
                }
                progress.advance(queries.len() as u64, positions.len() as u64);
            }
        }
        Ok(found)
    }

    /// Returns the indices of positions in the order of their codes, clamped to the root.
    fn order(&self, positions: &[[f64; 3]]) -> Vec<u32> {
        let grid = self.grid();
        let far = grid.node_box(spinney_base::space::Code::root(grid.dimension));
        let key = |position: &[f64; 3]| {
            let step: [i32; 3] = std::array::from_fn(|axis| {
                let step = ((position[axis] - grid.offset[axis]) / grid.scale[axis]) as i64;
                step.clamp(far[0][axis].into(), far[1][axis].into()) as i32
            });
            grid.code(step).map_or(0, |code| code.bits())
        };
        let mut order: Vec<u128> = positions
            .iter()
            .enumerate()
            .map(|(number, position)| u128::from(key(position)) << 32 | number as u128)
            .collect();
        sort::numbers128(&mut order);
        order.into_iter().map(|key| key as u32).collect()
    }
}

impl Search<'_> {
    fn new(tree: &PointTree, memory: u64) -> Result<Search<'_>> {
        let (nodes, blocks) = tree.counts();
        let world = |[least, most]: [[i32; 3]; 2]| [tree.grid().to_world(least), tree.grid().to_world(most)];
        let mut near: Vec<NearNode> = Vec::with_capacity(nodes);
        let mut open: Vec<(spinney_base::space::Code, usize)> = Vec::new();
        for index in 0..nodes {
            let node = tree.node(index)?;
            while let Some((code, above)) = open.last().copied().filter(|(code, _)| !code.contains(node.code))
            {
                near[above].end = index as u32;
                debug_assert!(!code.contains(node.code));
                open.pop();
            }
            let blocks = tree.blocks_of(node.code);
            let corners = world(node.statistics.bounds());
            near.push(NearNode {
                end: nodes as u32,
                blocks: (blocks.start as u32, blocks.end as u32),
                corners,
            });
            open.push((node.code, index));
        }
        let block_corners = (0..blocks).map(|block| world(tree.entry(block).bounds)).collect();
        let axes = tree.dimension().axes();
        Ok(Search { tree, nodes: near, block_corners, axes, max_bytes: memory, cache: Mutex::default() })
    }

    /// Returns the squared distance to a box along each axis that counts.
    #[inline]
    fn squares(&self, from: [f64; 3], [low, high]: &[[f64; 3]; 2]) -> [f64; 3] {
        std::array::from_fn(|axis| match axis < self.axes_of(from) {
            true => (low[axis] - from[axis]).max(from[axis] - high[axis]).max(0.0).powi(2),
            false => 0.0,
        })
    }

    /// Returns the number of axes that count for a position.
    #[inline]
    fn axes_of(&self, position: [f64; 3]) -> usize {
        if position[2].is_nan() { 2 } else { self.axes }
    }

    /// Returns the squared distance to a box.
    #[inline]
    fn distance(&self, from: [f64; 3], corners: &[[f64; 3]; 2]) -> f64 {
        let [x, y, z] = self.squares(from, corners);
        x + y + z
    }

    /// Runs queries, given as indices of positions.
    fn run(
        &self,
        queries: &[u32],
        positions: &[[f64; 3]],
        (most, limit): (usize, f64),
    ) -> Result<Vec<Vec<NearPoint>>> {
        // This thread's own cache needs no lock.
        let mut at_hand = HashMap::new();
        let near = |query: &u32| {
            let from = positions[*query as usize];
            let mut best = Best::new(most, limit, self.axes_of(from));
            if !self.nodes.is_empty() {
                self.search_node(0, from, &mut best, &mut at_hand)?;
            }
            let point = |found: super::block_index::Candidate| NearPoint {
                position: found.position,
                distance: found.square.sqrt(),
                number: found.number,
            };
            Ok(best.finish().into_iter().map(point).collect())
        };
        queries.iter().map(near).collect()
    }

    /// Searches a node for better points. Children come first, nearest child first, since the
    /// finest levels have the most points.
    fn search_node(
        &self,
        index: usize,
        from: [f64; 3],
        best: &mut Best,
        at_hand: &mut HashMap<u32, Arc<BlockIndex>>,
    ) -> Result<()> {
        let node = &self.nodes[index];
        let mut children = [(0.0, 0usize); 8];
        let mut count = 0;
        let mut child = index + 1;
        while child < node.end as usize {
            // In a corrupt or malicious node list, parents may be missing. No more nodes are
            // visited than there can be children.
            let Some(slot) = children.get_mut(count) else { break };
            *slot = (self.distance(from, &self.nodes[child].corners), child);
            count += 1;
            child = (self.nodes[child].end as usize).max(child + 1);
        }
        let children = &mut children[..count];
        children.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (distance, child) in children {
            if *distance <= best.limit {
                self.search_node(*child, from, best, at_hand)?;
            }
        }
        for block in node.blocks.0..node.blocks.1 {
            let squares = self.squares(from, &self.block_corners[block as usize]);
            if squares.iter().sum::<f64>() <= best.limit {
                let index = match at_hand.get(&block) {
                    Some(index) => index,
                    None => {
                        let index = self.block(block)?;
                        at_hand.entry(block).or_insert(index)
                    }
                };
                index.search(block, from, squares, best);
            }
        }
        Ok(())
    }

    /// Returns the index of a block.
    fn block(&self, block: u32) -> Result<Arc<BlockIndex>> {
        let cache = || self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = cache().blocks.get(&block) {
            return Ok(index.clone());
        }
        let wanted: Vec<bool> = (0..self.tree.columns()).map(|column| column < 3).collect();
        let columns = self.tree.block(block as usize, &wanted)?;
        let grid = self.tree.grid();
        let point = |number: usize| IndexedPoint {
            position: grid.to_world(std::array::from_fn(|axis| columns[axis][number] as i32)),
            number: number as u32,
            axis: 0,
        };
        let index = Arc::new(BlockIndex::new((0..columns[0].len()).map(point).collect(), self.axes));
        let mut cache = cache();
        if cache.bytes + index.bytes() > self.max_bytes {
            // Queries are sorted, so most cached blocks of earlier queries are not needed again.
            cache.blocks.clear();
            cache.bytes = 0;
        }
        cache.bytes += index.bytes();
        cache.blocks.insert(block, index.clone());
        Ok(index)
    }
}
