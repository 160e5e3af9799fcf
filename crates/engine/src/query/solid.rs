//! Measures of solids from their nodes: volume, centre of gravity, bounds.

use super::check_level;
use super::occupancy::{Filling, check_octree};
use super::world_bounds::world_bounds;
use crate::tree::{Child, Source, no_children};
use spinney_base::parallel;
use spinney_base::space::Bounds;
use spinney_base::{Progress, Result};
use spinney_crs::Frame;

/// Volume, centre of gravity and bounds of a solid at one level of its octree, in cells of that
/// level.
///
/// In trees of [`Rule::Occupancy`](spinney_base::value::Rule::Occupancy), cells count by their
/// occupancy. In all other trees, cells that are not VOID are full.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidStatistics {
    /// The level.
    pub level: u8,
    /// Number of cells that are not empty.
    pub cells: u64,
    /// Volume: the sum of all cells' occupancies, exact up to a final rounding.
    pub volume: f64,
    /// Centre of gravity, exact up to a final rounding; `None` if the solid is empty.
    pub centre: Option<[f64; 3]>,
    /// Smallest box around all cells that are not empty; `None` if there are none.
    pub bounds: Option<Bounds>,
    /// Number of INNER nodes that were visited: all on the levels above.
    pub nodes: u64,
    /// Map from cells of the level to the world.
    frame: Frame,
    world_bounds: Option<[[f64; 3]; 2]>,
}

impl SolidStatistics {
    /// Returns the map from cells to the world, for further measures.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Returns the volume in cubic world units.
    pub fn world_volume(&self) -> f64 {
        self.volume * self.frame.linear().determinant().abs()
    }

    /// Returns the centre of gravity in world coordinates.
    pub fn world_centre(&self) -> Option<[f64; 3]> {
        self.centre.map(|centre| self.frame.to_world(centre))
    }

    /// Returns minimum and maximum world coordinates of all cells that are not empty. They are
    /// those of the cells' corners, also if the tree is turned in the world.
    pub fn world_bounds(&self) -> Option<[[f64; 3]; 2]> {
        self.world_bounds
    }
}

/// Levels above the nodes that threads process one by one.
const SHARED: u8 = 3;
/// Levels of a subtree whose sums fit 64 bits: those of its 2^18 cells, each 255 times twice a
/// coordinate of 20 bits, are below 2^47.
const SMALL: u8 = 6;

/// Measures the nodes of an octree down to a level. `frame` is that of the deepest level. The time
/// is proportional to the INNER nodes above the level, the memory to the depth.
///
/// # Errors
/// If the source fails, is a quadtree or has no such level, or on cancellation.
pub(crate) fn measure<S: Source>(
    source: &S,
    level: u8,
    filling: Filling,
    frame: &Frame,
    progress: &dyn Progress,
) -> Result<SolidStatistics> {
    check_octree(source.form())?;
    check_level(level, source.depth())?;
    let mut tasks = Vec::new();
    let mut top = Gather { source, filling, sums: Sums::default(), progress };
    top.split(&source.root()?, [0; 3], level, level.saturating_sub(SHARED), &mut tasks)?;
    let parts = parallel::map(&tasks, |(node, min, height)| {
        let mut gather = Gather { source, filling, sums: Sums::default(), progress };
        gather.node(node, *min, *height)?;
        Ok(gather.sums)
    });
    let sums = parts.into_iter().try_fold(top.sums, |sums, part: Result<Sums>| Ok(sums.add(part?)))?;
    let frame = frame.coarser(source.depth() - level);
    let is_upright =
        frame.matrix.iter().all(|row| row[..3].iter().filter(|number| **number != 0.0).count() == 1);
    let world_bounds = match sums.bounds {
        Some(bounds) if is_upright => Some(frame.world_box(&bounds)),
        Some(_) => world_bounds(source, level, filling, &frame, progress)?,
        None => None,
    };
    let centre = |axis: usize| sums.moments[axis] as f64 / (2.0 * sums.fills as f64);
    Ok(SolidStatistics {
        level,
        cells: sums.cells,
        volume: sums.fills as f64 / 255.0,
        centre: (sums.fills > 0).then(|| std::array::from_fn(centre)),
        bounds: sums.bounds,
        nodes: sums.nodes,
        frame,
        world_bounds,
    })
}

#[derive(Default)]
struct Sums {
    cells: u64,
    /// Sum of the occupancies, 255 for a full cell.
    fills: u128,
    /// Sum of occupancy times twice the coordinate of the cell's centre.
    moments: [u128; 3],
    bounds: Option<Bounds>,
    nodes: u64,
}

impl Sums {
    fn add(mut self, other: Sums) -> Sums {
        self.cells += other.cells;
        self.fills += other.fills;
        self.nodes += other.nodes;
        for axis in 0..3 {
            self.moments[axis] += other.moments[axis];
        }
        if let Some(bounds) = other.bounds {
            self.enclose(bounds);
        }
        self
    }

    #[inline]
    fn enclose(&mut self, bounds: Bounds) {
        let all = self.bounds.get_or_insert(bounds);
        for axis in 0..3 {
            all.min[axis] = all.min[axis].min(bounds.min[axis]);
            all.max[axis] = all.max[axis].max(bounds.max[axis]);
        }
    }

    /// Adds a block of equal cells.
    fn block(&mut self, fill: u8, min: [u64; 3], height: u8) {
        if fill == 0 {
            return;
        }
        let cells = 1u64 << (3 * height);
        let side = 1u64 << height;
        self.cells += cells;
        // Integers make the sums exact and independent of their order: up to 2^57 cells of 255,
        // times twice a coordinate of 19 bits, stay below 2^86. A block's moment is that of its
        // centre, at `min + side / 2`.
        let fills = u128::from(fill) * u128::from(cells);
        self.fills += fills;
        for (moment, min) in self.moments.iter_mut().zip(min) {
            *moment += fills * u128::from(2 * min + side);
        }
        self.enclose(Bounds { min, max: min.map(|min| min + side) });
    }

    fn subtree(&mut self, small: &SmallSums) {
        if small.cells == 0 {
            return;
        }
        self.cells += small.cells;
        self.fills += u128::from(small.fills);
        for axis in 0..3 {
            self.moments[axis] += u128::from(small.moments[axis]);
        }
        self.enclose(Bounds { min: small.low, max: small.high });
    }
}

/// [`Sums`] of a subtree of few levels.
struct SmallSums {
    cells: u64,
    fills: u64,
    moments: [u64; 3],
    low: [u64; 3],
    high: [u64; 3],
    nodes: u64,
}

impl SmallSums {
    fn new() -> SmallSums {
        SmallSums { cells: 0, fills: 0, moments: [0; 3], low: [u64::MAX; 3], high: [0; 3], nodes: 0 }
    }

    #[inline]
    fn block(&mut self, fill: u8, min: [u64; 3], height: u8) {
        if fill == 0 {
            return;
        }
        let (cells, side) = (1u64 << (3 * height), 1u64 << height);
        self.cells += cells;
        let fills = u64::from(fill) * cells;
        self.fills += fills;
        for (axis, min) in min.into_iter().enumerate() {
            self.moments[axis] += fills * (2 * min + side);
            self.low[axis] = self.low[axis].min(min);
            self.high[axis] = self.high[axis].max(min + side);
        }
    }
}

/// State of a task.
struct Gather<'a, S: Source> {
    source: &'a S,
    filling: Filling,
    sums: Sums,
    /// Checked at each node above the small subtrees, since one task may be nearly all of a tree.
    progress: &'a dyn Progress,
}

/// A node, its first cell, and its levels above the cells.
type Task<N> = (Child<N>, [u64; 3], u8);

/// Returns the first cell of a node's child.
#[inline]
fn child_at(min: [u64; 3], height: u8, step: usize) -> [u64; 3] {
    std::array::from_fn(|axis| min[axis] + ((step as u64 >> axis & 1) << (height - 1)))
}

impl<S: Source> Gather<'_, S> {
    /// Collects the INNER nodes `lowest` levels above the cells, and measures what is above them.
    fn split(
        &mut self,
        node: &Child<S::Node>,
        min: [u64; 3],
        height: u8,
        lowest: u8,
        tasks: &mut Vec<Task<S::Node>>,
    ) -> Result<()> {
        let Child::Inner { node: inner, .. } = node else {
            self.sums.block(self.filling.fill(node.value()), min, height);
            return Ok(());
        };
        if height <= lowest {
            tasks.push((node.clone(), min, height));
            return Ok(());
        }
        self.sums.nodes += 1;
        let mut children = no_children();
        self.source.children(inner, &mut children)?;
        for (step, child) in children.iter().enumerate() {
            self.split(child, child_at(min, height, step), height - 1, lowest, tasks)?;
        }
        Ok(())
    }

    fn node(&mut self, node: &Child<S::Node>, min: [u64; 3], height: u8) -> Result<()> {
        let inner = match node {
            Child::Inner { node, .. } if height > 0 => node,
            _ => {
                self.sums.block(self.filling.fill(node.value()), min, height);
                return Ok(());
            }
        };
        self.progress.check()?;
        if height <= SMALL {
            let mut sums = SmallSums::new();
            self.small(inner, min, height, &mut sums)?;
            self.sums.nodes += sums.nodes;
            self.sums.subtree(&sums);
            return Ok(());
        }
        self.sums.nodes += 1;
        let mut children = no_children();
        self.source.children(inner, &mut children)?;
        for (step, child) in children.iter().enumerate() {
            self.node(child, child_at(min, height, step), height - 1)?;
        }
        Ok(())
    }

    fn small(&self, node: &S::Node, min: [u64; 3], height: u8, sums: &mut SmallSums) -> Result<()> {
        sums.nodes += 1;
        let mut children = no_children();
        self.source.children(node, &mut children)?;
        for (step, child) in children.iter().enumerate() {
            let (min, height) = (child_at(min, height, step), height - 1);
            match child {
                Child::Void => {}
                Child::Inner { node, .. } if height > 0 => self.small(node, min, height, sums)?,
                _ => sums.block(self.filling.fill(child.value()), min, height),
            }
        }
        Ok(())
    }
}
