//! Surface of solids: faces of cells, and the area of the smooth surface that they approximate.
//!
//! Space is traversed in blocks of 32 x 32 x 32 cells. For a divided block, the cells and those
//! around it are read once, faces are found in rows of bits, and normals come from sums over the
//! ball around each face. Large faces between uniform blocks are found by traversing neighbours in
//! parallel, as in the dual traversals of Ju, Losasso, Schaefer and Warren (Dual contouring of
//! hermite data, SIGGRAPH 2002). Memory is proportional to depth, time to the surface.

use glam::{DMat3, DVec3};

use super::check_level;
use super::neighbourhood::{BLOCK, Ball, Neighbourhood};
use super::occupancy::{Filling, HALF, check_octree};
use crate::tree::{Child, Children, Source, no_children};
use spinney_base::parallel::{self, Pool};
use spinney_base::{Progress, Result};
use spinney_crs::Frame;

/// Surface of a solid at one level of its octree: of the cells that are at least half full, or, in
/// trees of other rules than [`Rule::Occupancy`](spinney_base::value::Rule::Occupancy), of the
/// cells that are not VOID.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidSurface {
    /// The level.
    pub level: u8,
    /// Number of faces between cells inside and outside of the solid, across x, y and z: the
    /// surface of the cells as blocks.
    pub faces: [u64; 3],
    /// Number of blocks that were read, each with the cells around it.
    pub blocks: u64,
    /// See [`SolidSurface::smooth_area`].
    area: f64,
    /// Map from cells of the level to the world.
    frame: Frame,
}

impl SolidSurface {
    /// Returns the area of all faces in square world units. It exceeds the area of the smooth
    /// surface by up to one half.
    pub fn block_area(&self) -> f64 {
        let areas = self.frame.face_areas().map(DVec3::length);
        areas.iter().zip(self.faces).map(|(area, faces)| area * faces as f64).sum()
    }

    /// Returns the area of the smooth surface in square world units. Each face counts by its
    /// projection along the surface normal there, which is estimated from the occupancy within 4
    /// cells.
    ///
    /// This is a digital surface integration (Lenoir, Malgouyres, Revenu: Fast computation of the
    /// normal vector field of the surface of a 3-D discrete object, DGCI 1996). Flat faces along
    /// the axes are exact except within 4 cells of edges, where normals turn. The area of balls of
    /// more than 20 cells is one or two percent too large.
    pub fn smooth_area(&self) -> f64 {
        self.area
    }
}

/// Levels above the nodes that threads process one by one.
const SHARED: u8 = 3;

/// Children of an octree node.
const STEPS: std::ops::Range<usize> = 0..8;

/// Measures the surface of an octree at a level. `frame` is that of the deepest level. Progress
/// counts the cells of the space.
///
/// # Errors
/// If the source fails, is a quadtree or has no such level, or on cancellation.
pub(crate) fn measure_surface<S: Source>(
    source: &S,
    level: u8,
    filling: Filling,
    frame: &Frame,
    progress: &dyn Progress,
) -> Result<SolidSurface> {
    check_octree(source.form())?;
    check_level(level, source.depth())?;
    let frame = frame.coarser(source.depth() - level);
    let areas = frame.face_areas();
    let root = source.root()?;
    let block = level.min(BLOCK);
    let collector =
        TaskCollector { source, level, lowest: block.max(level.saturating_sub(SHARED)), tasks: Vec::new() };
    let tasks = collector.tasks(&root)?;
    let (neighbourhoods, balls) = (Pool::default(), [0, 1, 2].map(Ball::of));
    let total = 1u64 << (3 * level);
    let parts = parallel::map(&tasks, |task| {
        neighbourhoods.with(
            || Ok(Neighbourhood::new()),
            |neighbourhood| {
                let sums = Sums::default();
                let balls = &balls;
                let mut gather = Gather {
                    source,
                    root: &root,
                    level,
                    block,
                    filling,
                    areas,
                    balls,
                    neighbourhood,
                    progress,
                    sums,
                };
                match task {
                    Task::Node(node) => {
                        gather.node(node.as_ref())?;
                        progress.advance(1 << (3 * node.height), total);
                    }
                    Task::Face(low, high, axis) => gather.face(low.as_ref(), high.as_ref(), *axis)?,
                }
                Ok(gather.sums)
            },
        )
    });
    // Added in tree order, so that rounded sums do not depend on the threads.
    let sums =
        parts.into_iter().try_fold(Sums::default(), |sums, part: Result<Sums>| Ok(sums.add(&part?)))?;
    Ok(SolidSurface { level, faces: sums.faces, blocks: sums.blocks, area: sums.area, frame })
}

/// A node or a uniform block, and its cells.
#[derive(Clone, Copy)]
struct At<T> {
    min: [i64; 3],
    /// Base-2 logarithm of the cells along each axis.
    height: u8,
    node: T,
}

impl<N> At<Child<N>> {
    fn as_ref(&self) -> At<&Child<N>> {
        At { min: self.min, height: self.height, node: &self.node }
    }
}

impl<'a, N> At<&'a Child<N>> {
    /// Returns a child of an INNER node with these children, or of a uniform block (`None`) the
    /// corresponding octant.
    #[inline]
    fn child(self, children: Option<&'a Children<N>>, step: usize) -> At<&'a Child<N>> {
        let half = 1i64 << (self.height - 1);
        let min = std::array::from_fn(|axis| self.min[axis] + (step as i64 >> axis & 1) * half);
        At { min, height: self.height - 1, node: children.map_or(self.node, |children| &children[step]) }
    }

    /// Reads the children of a node to a buffer, or returns `None` for a uniform block.
    #[inline]
    fn children<'r, S: Source<Node = N>>(
        self,
        source: &S,
        buffer: &'r mut Children<N>,
    ) -> Result<Option<&'r Children<N>>> {
        let Child::Inner { node, .. } = self.node else { return Ok(None) };
        source.children(node, buffer)?;
        Ok(Some(buffer))
    }
}

impl<N: Clone> At<&Child<N>> {
    fn cloned(self) -> At<Child<N>> {
        At { min: self.min, height: self.height, node: self.node.clone() }
    }
}

/// Numbers of a node's children on its low side along an axis. With the axis bit set, it is the
/// neighbour on the high side.
fn low_steps(axis: usize) -> impl Iterator<Item = usize> {
    STEPS.filter(move |step| step >> axis & 1 == 0)
}

/// A task of a thread.
enum Task<N> {
    Node(At<Child<N>>),
    Face(At<Child<N>>, At<Child<N>>, usize),
}

#[derive(Default)]
struct Sums {
    faces: [u64; 3],
    blocks: u64,
    area: f64,
}

impl Sums {
    fn add(mut self, other: &Sums) -> Sums {
        for axis in 0..3 {
            self.faces[axis] += other.faces[axis];
        }
        self.blocks += other.blocks;
        self.area += other.area;
        self
    }
}

/// Collects the tasks.
struct TaskCollector<'a, S: Source> {
    source: &'a S,
    level: u8,
    /// Height of the nodes that threads process.
    lowest: u8,
    tasks: Vec<Task<S::Node>>,
}

impl<S: Source> TaskCollector<'_, S> {
    fn tasks(mut self, root: &Child<S::Node>) -> Result<Vec<Task<S::Node>>> {
        let side = 1i64 << self.level;
        let root = At { min: [0; 3], height: self.level, node: root };
        self.node(root)?;
        // VOID surrounds the space: a VOID node on each side makes the faces of cells at the border
        // count.
        for axis in 0..3 {
            for (is_before, shift) in [(true, -side), (false, side)] {
                let mut min = [0; 3];
                min[axis] = shift;
                let empty = At { min, height: self.level, node: &Child::Void };
                let (low, high) = if is_before { (empty, root) } else { (root, empty) };
                self.face(low, high, axis)?;
            }
        }
        Ok(self.tasks)
    }

    fn node(&mut self, node: At<&Child<S::Node>>) -> Result<()> {
        if node.height <= self.lowest || !node.node.is_inner() {
            self.tasks.push(Task::Node(node.cloned()));
            return Ok(());
        }
        let mut buffer = no_children();
        let children = node.children(self.source, &mut buffer)?;
        for step in STEPS {
            self.node(node.child(children, step))?;
        }
        for axis in 0..3 {
            for step in low_steps(axis) {
                let (low, high) = (node.child(children, step), node.child(children, step | 1 << axis));
                self.face(low, high, axis)?;
            }
        }
        Ok(())
    }

    fn face(&mut self, low: At<&Child<S::Node>>, high: At<&Child<S::Node>>, axis: usize) -> Result<()> {
        if low.height <= self.lowest || !(low.node.is_inner() || high.node.is_inner()) {
            self.tasks.push(Task::Face(low.cloned(), high.cloned(), axis));
            return Ok(());
        }
        let mut buffers = [no_children(), no_children()];
        let [below, above] = &mut buffers;
        let (below, above) = (low.children(self.source, below)?, high.children(self.source, above)?);
        for step in low_steps(axis) {
            self.face(low.child(below, step | 1 << axis), high.child(above, step), axis)?;
        }
        Ok(())
    }
}

/// State of a task. The faces of a divided block are counted with the block, except for those on
/// its upper sides that it shares with another divided block. Faces between uniform blocks are
/// counted separately.
struct Gather<'a, 'r, S: Source> {
    source: &'a S,
    root: &'a Child<S::Node>,
    level: u8,
    /// Height of a block.
    block: u8,
    filling: Filling,
    /// Area vectors of a cell's faces: see [`Frame::face_areas`].
    areas: [DVec3; 3],
    balls: &'a [Ball; 3],
    neighbourhood: &'r mut Neighbourhood,
    /// Checked at each node, since one task may be nearly all of a tree.
    progress: &'a dyn Progress,
    sums: Sums,
}

impl<S: Source> Gather<'_, '_, S> {
    fn node(&mut self, node: At<&Child<S::Node>>) -> Result<()> {
        if !node.node.is_inner() {
            return Ok(());
        }
        self.progress.check()?;
        if node.height == self.block {
            return self.divided(node.min);
        }
        let mut buffer = no_children();
        let children = node.children(self.source, &mut buffer)?;
        for step in STEPS {
            self.node(node.child(children, step))?;
        }
        for axis in 0..3 {
            for step in low_steps(axis) {
                let (low, high) = (node.child(children, step), node.child(children, step | 1 << axis));
                self.face(low, high, axis)?;
            }
        }
        Ok(())
    }

    fn face(&mut self, low: At<&Child<S::Node>>, high: At<&Child<S::Node>>, axis: usize) -> Result<()> {
        if !(low.node.is_inner() || high.node.is_inner()) {
            let [inside, outside] = [low, high].map(|at| self.filling.fill(at.node.value()) >= HALF);
            return if inside == outside { Ok(()) } else { self.between(high.min, high.height, axis) };
        }
        if low.height == self.block {
            return Ok(());
        }
        self.progress.check()?;
        let mut buffers = [no_children(), no_children()];
        let [below, above] = &mut buffers;
        let (below, above) = (low.children(self.source, below)?, high.children(self.source, above)?);
        for step in low_steps(axis) {
            self.face(low.child(below, step | 1 << axis), high.child(above, step), axis)?;
        }
        Ok(())
    }

    /// Adds the faces of a divided block.
    fn divided(&mut self, min: [i64; 3]) -> Result<()> {
        self.read(min)?;
        let side = 1usize << self.block;
        for axis in 0..3 {
            let mut next = min;
            next[axis] += side as i64;
            let end = if self.is_divided(next)? { side } else { side + 1 };
            self.planes(axis, 0..end)?;
        }
        Ok(())
    }

    /// Adds the faces at the low side of a uniform node, next to a different uniform node.
    fn between(&mut self, min: [i64; 3], height: u8, axis: usize) -> Result<()> {
        let blocks = 1i64 << (height - self.block);
        let side = 1i64 << self.block;
        let whole = self.areas[axis].length();
        for v in 0..blocks {
            self.progress.check()?;
            let is_inner = |block: i64| (1..blocks - 1).contains(&block);
            let mut u = 0;
            while u < blocks {
                if is_inner(u) && is_inner(v) {
                    // The balls for the normals only meet this plane, so faces count with their
                    // full area.
                    let faces = (blocks - 1 - u) * side * side;
                    self.sums.faces[axis] += faces as u64;
                    self.sums.area += whole * faces as f64;
                    u = blocks - 1;
                    continue;
                }
                let mut at = min;
                at[(axis + 1) % 3] += u * side;
                at[(axis + 2) % 3] += v * side;
                self.read(at)?;
                self.planes(axis, 0..1)?;
                u += 1;
            }
        }
        Ok(())
    }

    /// Counts and weighs the faces across an axis in some planes of the block that was read. Plane
    /// 0 is its low side.
    fn planes(&mut self, axis: usize, planes: std::ops::Range<usize>) -> Result<()> {
        self.progress.check()?;
        let (neighbourhood, sums) = (&*self.neighbourhood, &mut self.sums);
        let [a, b, c] = self.areas;
        // Normals transform by the inverse transpose. The area vectors are its columns up to a
        // factor.
        let turn = DMat3::from_cols(a, b, c);
        let area = self.areas[axis];
        let whole = area.length();
        let ball = &self.balls[axis];
        neighbourhood.each_face(axis, 1 << self.block, planes, |cell| {
            sums.faces[axis] += 1;
            let normal = turn * DVec3::from(neighbourhood.gradient(ball, cell));
            sums.area += normal.try_normalize().map_or(whole, |normal| area.dot(normal).abs());
        });
        Ok(())
    }

    /// Returns whether the block that starts at a cell is divided.
    fn is_divided(&self, min: [i64; 3]) -> Result<bool> {
        let space = 1i64 << self.level;
        if min.iter().any(|min| !(0..space).contains(min)) {
            return Ok(false);
        }
        let mut node = self.root.clone();
        for height in (self.block..self.level).rev() {
            let Child::Inner { node: inner, .. } = &node else { return Ok(false) };
            let mut children = no_children();
            self.source.children(inner, &mut children)?;
            let step = (0..3).fold(0, |step, axis| step | (min[axis] as usize >> height & 1) << axis);
            node = std::mem::take(&mut children[step]);
        }
        Ok(node.is_inner())
    }

    /// Reads the block that starts at a cell, and the cells around it.
    fn read(&mut self, min: [i64; 3]) -> Result<()> {
        self.sums.blocks += 1;
        self.neighbourhood.clear(min);
        let is_finest = self.level == self.source.depth();
        self.paint(self.root, [0; 3], self.level, is_finest)
    }

    /// Paints the cells of a node that are in the neighbourhood.
    fn paint(&mut self, node: &Child<S::Node>, min: [i64; 3], height: u8, is_finest: bool) -> Result<()> {
        if matches!(node, Child::Void) || !self.neighbourhood.meets(min, height) {
            return Ok(());
        }
        let fill = self.filling.fill(node.value());
        let inner = match node {
            Child::Inner { node, .. } if height > 0 || (self.filling == Filling::Present && !is_finest) => {
                node
            }
            _ => {
                self.neighbourhood.paint(min, height, fill >= HALF, fill);
                return Ok(());
            }
        };
        let mut children = no_children();
        self.source.children(inner, &mut children)?;
        if height == 0 {
            // Values do not store how full the node is; its children give an estimate.
            let parts = children.iter().filter(|child| !matches!(child, Child::Void)).count();
            self.neighbourhood.paint(min, 0, fill >= HALF, (parts * 32).min(255) as u8);
            return Ok(());
        }
        for (step, child) in children.iter().enumerate() {
            let half = 1i64 << (height - 1);
            let min = std::array::from_fn(|axis| min[axis] + (step as i64 >> axis & 1) * half);
            self.paint(child, min, height - 1, is_finest)?;
        }
        Ok(())
    }
}
