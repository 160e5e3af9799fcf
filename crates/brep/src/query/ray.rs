//! Rays and lines through a model: visits cells from front to back.

use super::line::{Crossing, Line, Passage};
use super::model_cache::{ModelCache, Node};
use super::visited::Visited;
use crate::{ExactModel, Face, Faces};
use spinney_base::io::batch::run_batched;
use spinney_base::{Result, sort};
use std::collections::BTreeSet;

/// A point where a line crosses the surface of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Parameter of the point on the line; of a ray, in lengths of its direction.
    pub share: f64,
    /// The point, in world coordinates.
    pub point: [f64; 3],
    /// Whether the line enters the body.
    pub is_entry: bool,
    /// Number of the face.
    pub face: u64,
    /// Number of its part.
    pub part: u32,
}

impl ExactModel {
    /// Returns the first point where a ray in the world crosses the surface.
    ///
    /// The decision is consistent over all faces, so no ray passes between two of them. It is exact
    /// for the ray as rounded by [`Line`]: by less than 1 / 16384 of a grid unit on a grid with the
    /// maximum bits.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn ray(&self, from: [f64; 3], direction: [f64; 3]) -> Result<(Option<Hit>, Visited)> {
        let grid = self.grid();
        let steps = direction.map(|along| along * grid.divisor / grid.step);
        self.first_hit(Line::ray(grid, grid.to_grid(from), steps))
    }

    /// Returns the first point where the straight line between two points of the world crosses the
    /// surface, as [`ExactModel::ray`]: a line-of-sight test.
    ///
    /// # Errors
    /// The errors of [`ExactModel::ray`].
    pub fn between(&self, from: [f64; 3], to: [f64; 3]) -> Result<(Option<Hit>, Visited)> {
        let grid = self.grid();
        self.first_hit(Line::between(grid, grid.to_grid(from), grid.to_grid(to)))
    }

    /// Returns all points where the straight line between two points of the world crosses the
    /// surface, in order.
    ///
    /// # Errors
    /// The errors of [`ExactModel::ray`].
    pub fn crossings(&self, from: [f64; 3], to: [f64; 3]) -> Result<Vec<Hit>> {
        let grid = self.grid();
        self.all_hits(Line::between(grid, grid.to_grid(from), grid.to_grid(to)))
    }

    /// Returns all points where a ray in the world crosses the surface, in order: an odd number if
    /// it begins inside of a bounded body, otherwise an even number.
    ///
    /// # Errors
    /// The errors of [`ExactModel::ray`].
    pub fn ray_crossings(&self, from: [f64; 3], direction: [f64; 3]) -> Result<Vec<Hit>> {
        let grid = self.grid();
        let steps = direction.map(|along| along * grid.divisor / grid.step);
        self.all_hits(Line::ray(grid, grid.to_grid(from), steps))
    }

    fn all_hits(&self, line: Option<Line>) -> Result<Vec<Hit>> {
        let Some(line) = line else { return Ok(Vec::new()) };
        run_batched(|| {
            let mut cache = ModelCache::new(self, FEW);
            let mut traversal = RayTraversal::new(line, false, &mut cache);
            traversal.root()?;
            let mut all = std::mem::take(&mut traversal.found.all);
            sort::by_key(&mut all, |(number, _)| *number);
            all.dedup_by_key(|(number, _)| *number);
            // At equal parameters, exits precede entries.
            sort::by_wide_key(&mut all, |(_, passed)| {
                u128::from(sort::float_key(passed.share)) << 1 | u128::from(passed.is_entry)
            });
            all.into_iter().map(|(number, crossing)| cache.hit(&line, number, crossing)).collect()
        })
    }

    fn first_hit(&self, line: Option<Line>) -> Result<(Option<Hit>, Visited)> {
        let Some(line) = line else { return Ok((None, Visited::default())) };
        run_batched(|| {
            let mut cache = ModelCache::new(self, FEW);
            let mut traversal = RayTraversal::new(line, true, &mut cache);
            traversal.root()?;
            Ok((traversal.first()?, traversal.visited))
        })
    }

    /// Returns a caster of many rays through the model: see [`ModelRays`].
    pub fn rays(&self) -> ModelRays<'_> {
        ModelRays { model: self, cache: ModelCache::new(self, REMEMBERED) }
    }

    /// Returns a caster of many rays through some parts, as if the model had no other faces.
    pub fn rays_of_parts<'a>(&'a self, parts: &'a BTreeSet<u32>) -> ModelRays<'a> {
        ModelRays { model: self, cache: ModelCache::of_parts(self, REMEMBERED, parts) }
    }
}

/// Casts rays through a model, from one thread at a time, with a cache of what was read. Results do
/// not depend on the cache.
pub struct ModelRays<'a> {
    model: &'a ExactModel,
    cache: ModelCache<'a>,
}

impl ModelRays<'_> {
    /// Returns the first point where a ray in the world crosses the surface: [`ExactModel::ray`].
    ///
    /// # Errors
    /// The errors of [`ExactModel::ray`].
    pub fn first(&mut self, from: [f64; 3], direction: [f64; 3]) -> Result<Option<Hit>> {
        let grid = self.model.grid();
        let steps = direction.map(|along| along * grid.divisor / grid.step);
        let Some(line) = Line::ray(grid, grid.to_grid(from), steps) else { return Ok(None) };
        let mut traversal = RayTraversal::new(line, true, &mut self.cache);
        traversal.root()?;
        traversal.first()
    }

    /// Returns the first points where many rays cross the surface, as [`ModelRays::first`], in the
    /// rays' order. Each ray is an origin and a direction.
    ///
    /// Rays are cast in the order of the points where they enter and leave the model's space, so
    /// that consecutive rays read the same pages.
    ///
    /// # Errors
    /// The errors of [`ExactModel::ray`].
    pub fn first_of(&mut self, rays: &[[[f64; 3]; 2]]) -> Result<Vec<Option<Hit>>> {
        let grid = self.model.grid();
        let [low, high] = [[0; 3], [((1u64 << grid.bits) - 1) as i32; 3]].map(|corner| grid.to_world(corner));
        // (Positions along the curve, above the rays' indices.)
        let mut order: Vec<u64> =
            rays.iter().zip(0..).map(|(ray, index)| place_of(ray, low, high) << 32 | index).collect();
        sort::numbers64(&mut order);
        let mut hits = vec![None; rays.len()];
        for place in order {
            let index = place as u32 as usize;
            let [from, direction] = rays[index];
            hits[index] = self.first(from, direction)?;
        }
        Ok(hits)
    }

    /// Returns a face, and its outward normal on the grid, of any length.
    ///
    /// # Errors
    /// If there is no such face, or the file is corrupt or cannot be read.
    pub fn face(&mut self, number: u64) -> Result<(Face<'_>, [i64; 3])> {
        self.cache.face(number)
    }
}

/// Number of cached blocks and faces, each, for a single ray.
const FEW: usize = 16;
/// Number of cached blocks and faces, each, for many rays.
const REMEMBERED: usize = 1 << 8;

/// Returns the position of a ray along a curve through the points where rays enter and leave a box,
/// of 30 bits; the maximum for rays that miss the box or are invalid.
fn place_of([from, direction]: &[[f64; 3]; 2], low: [f64; 3], high: [f64; 3]) -> u64 {
    let (mut first, mut last) = (0f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [low, high].map(|wall| (wall[axis] - from[axis]) / direction[axis]);
        // (`max` and `min` ignore NaN.)
        (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
    }
    if !(first <= last && last.is_finite()) {
        return u32::MAX.into();
    }
    let mut rank = 0;
    for (end, share) in [first, last].into_iter().enumerate() {
        for axis in 0..3 {
            let at = (from[axis] + direction[axis] * share - low[axis]) / (high[axis] - low[axis]);
            rank |= SPREAD[(at.clamp(0.0, 1.0) * 31.0) as usize] << (3 * end + axis);
        }
    }
    rank.into()
}

/// Numbers of five bits, with five zeros between consecutive bits.
const SPREAD: [u32; 32] = {
    let mut spread = [0; 32];
    let mut number = 0;
    while number < 32 {
        let mut bit = 0;
        while bit < 5 {
            spread[number] |= (number as u32 >> bit & 1) << (6 * bit);
            bit += 1;
        }
        number += 1;
    }
    spread
};

/// Children in a selection of the halves along each axis: a bit for each child.
const ALONG: [[u8; 4]; 3] = [[0, 0x55, 0xaa, 0xff], [0, 0x33, 0xcc, 0xff], [0, 0x0f, 0xf0, 0xff]];

/// Returns the bits of children in the order of a line whose first child has the number `turned`.
#[inline]
fn mirrored(mut children: u8, turned: usize) -> u8 {
    for (axis, half) in [0x55, 0x33, 0x0f].into_iter().enumerate() {
        if turned >> axis & 1 == 1 {
            let shift = 1 << axis;
            children = (children & half) << shift | children >> shift & half;
        }
    }
    children
}

/// Traversal of the octree along a line.
struct RayTraversal<'a, 'r> {
    line: Line,
    /// The child of a cell in which a line through all children would begin.
    turned: usize,
    found: Found,
    cache: &'r mut ModelCache<'a>,
    visited: Visited,
}

/// Crossings that were found.
struct Found {
    /// Whether only the first crossing is wanted.
    is_first: bool,
    /// The first crossing, if only that is wanted, and the number of its face.
    first: Option<(u64, Crossing)>,
    /// All crossings, if these are wanted; some occur more than once.
    all: Vec<(u64, Crossing)>,
}

/// A cell on the line.
struct Cell {
    level: u8,
    /// Its walls at the minimum along each axis, and half of its size, in grid units. (Walls are
    /// half a grid unit before grid points.)
    low: [f64; 3],
    half: f64,
    /// Parameters at which the line passes the walls across each axis.
    ///
    /// Invariant: passages are computed from each wall itself, once per wall, and not from the
    /// parent's passages. So two cells agree on the wall between them, and no ray is lost there.
    passages: [Passage; 3],
    /// The line's parameter range within it.
    part: [f64; 2],
}

impl<'a, 'r> RayTraversal<'a, 'r> {
    /// Creates a traversal that finds the first crossing, or all.
    fn new(line: Line, is_first: bool, cache: &'r mut ModelCache<'a>) -> RayTraversal<'a, 'r> {
        let found = Found { is_first, first: None, all: Vec::new() };
        RayTraversal { line, turned: line.turned(), found, cache, visited: Visited::default() }
    }

    /// Returns the first crossing that was found.
    fn first(&mut self) -> Result<Option<Hit>> {
        let Some((number, crossing)) = self.found.first else { return Ok(None) };
        self.cache.hit(&self.line, number, crossing).map(Some)
    }

    fn root(&mut self) -> Result<()> {
        let size = (1u64 << self.cache.model().grid().bits) as f64;
        let passages = [0, 1, 2].map(|axis| self.line.passage(axis, -0.5, size - 0.5));
        let Some(part) = Line::part_within(&passages) else { return Ok(()) };
        let root = self.cache.begin();
        self.node(root, &Cell { level: 0, low: [-0.5; 3], half: size / 2.0, passages, part })
    }

    /// Visits a node, from front to back.
    fn node(&mut self, node: usize, cell: &Cell) -> Result<()> {
        self.visited.nodes += 1;
        let position = || cell.low.map(|low| ((low + 0.5) / (2.0 * cell.half)) as u32);
        let (children, present) = match self.cache.node(node, cell.level, position)? {
            Node::Empty => return Ok(()),
            Node::Leaf(leaf) => return self.leaf(leaf),
            Node::Inner(children, present) => (children, present),
        };
        let middle = cell.low.map(|low| low + cell.half);
        let halves = |axis: usize| self.line.halves(axis, cell.passages[axis], middle[axis]);
        let halves = [halves(0), halves(1), halves(2)];
        let there = |axis: usize| usize::from(Line::halves_within(&halves[axis], cell.part));
        // A bit for each child that the line may pass, in the order from its beginning.
        let mut ahead = ALONG[0][there(0)] & ALONG[1][there(1)] & ALONG[2][there(2)];
        ahead &= mirrored(present, self.turned);
        while ahead != 0 {
            let rank = ahead.trailing_zeros() as usize;
            ahead &= ahead - 1;
            let child = rank ^ self.turned;
            let passages = [halves[0][rank & 1], halves[1][rank >> 1 & 1], halves[2][rank >> 2]];
            let Some(part) = self.wanted(&passages) else { continue };
            let low = [0, 1, 2].map(|axis| [cell.low, middle][child >> axis & 1][axis]);
            let inner = Cell { level: cell.level + 1, low, half: cell.half / 2.0, passages, part };
            self.node(children + child, &inner)?;
        }
        Ok(())
    }

    /// Returns the line's parameter range within a cell, unless it is after the crossing that was
    /// found.
    #[inline]
    fn wanted(&self, passages: &[Passage; 3]) -> Option<[f64; 2]> {
        let part = Line::part_within(passages)?;
        let is_after = |(_, first): (u64, Crossing)| first.share < self.line.share_of(part[0]);
        (!self.found.first.is_some_and(is_after)).then_some(part)
    }

    #[inline]
    fn leaf(&mut self, leaf: usize) -> Result<()> {
        let found = &mut self.found;
        let mut take = |number, crossing| found.take(number, crossing);
        self.visited.faces += self.cache.crossings(&self.line, leaf, &mut take)?;
        Ok(())
    }
}

impl Found {
    #[inline]
    fn take(&mut self, number: u64, crossing: Crossing) {
        if !self.is_first {
            self.all.push((number, crossing));
            return;
        }
        let is_before = |(other, first): (u64, Crossing)| {
            crossing.share.total_cmp(&first.share).then(number.cmp(&other)).is_lt()
        };
        if self.first.is_none_or(is_before) {
            self.first = Some((number, crossing));
        }
    }
}
