//! Rays and lines through a model: cells from front to back.

use super::line::{Crossing, Line, Passage};
use super::plane::Plane;
use super::visited::{Recent, Visited};
use crate::{ExactModel, Face, FaceBuffer, Faces, ModelNode, ModelNodeState};
use spinney_base::io::rounds::ask;
use spinney_base::{Result, sort};

/// A place where a line passes through the surface of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Share of the line that lies before it; of a ray, in lengths of its direction.
    pub share: f64,
    /// The place in the world.
    pub point: [f64; 3],
    /// Whether the line comes from outside.
    pub is_entry: bool,
    /// Number of the face.
    pub face: u64,
}

impl ExactModel {
    /// The first place where a ray in the world meets the surface.
    ///
    /// That it does is decided for all faces together, so that no ray slips through between two of them, for the ray as
    /// [`Line`] rounds it: on a grid of the most bits by less than 1 / 16384 of a step.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub fn ray(&self, from: [f64; 3], direction: [f64; 3]) -> Result<(Option<Hit>, Visited)> {
        let grid = self.grid();
        let steps = direction.map(|along| along * grid.divisor / grid.step);
        self.first_hit(Line::ray(grid, grid.to_grid(from), steps))
    }

    /// The first place where the straight way between two points of the world meets the surface, as
    /// [`ExactModel::ray`]: whether one sees the other.
    ///
    /// # Errors
    /// Those of [`ExactModel::ray`].
    pub fn between(&self, from: [f64; 3], to: [f64; 3]) -> Result<(Option<Hit>, Visited)> {
        let grid = self.grid();
        self.first_hit(Line::between(grid, grid.to_grid(from), grid.to_grid(to)))
    }

    /// All places where the straight way between two points of the world passes through the surface, in their order.
    ///
    /// # Errors
    /// Those of [`ExactModel::ray`].
    pub fn crossings(&self, from: [f64; 3], to: [f64; 3]) -> Result<Vec<Hit>> {
        let grid = self.grid();
        let Some(line) = Line::between(grid, grid.to_grid(from), grid.to_grid(to)) else {
            return Ok(Vec::new());
        };
        let mut all = ask(|| {
            let mut remembered = Remembered::new(1);
            let mut walk = Walk::new(self, line, false, &mut remembered);
            walk.root()?;
            Ok(walk.found)
        })?;
        sort::by_key(&mut all, |(number, _)| *number);
        all.dedup_by_key(|(number, _)| *number);
        // Of those at one place one comes out before another is entered.
        sort::by_wide_key(&mut all, |(_, passed)| {
            u128::from(sort::float_key(passed.share)) << 1 | u128::from(passed.is_entry)
        });
        Ok(all.into_iter().map(|(number, crossing)| self.hit(&line, number, crossing)).collect())
    }

    fn first_hit(&self, line: Option<Line>) -> Result<(Option<Hit>, Visited)> {
        let Some(line) = line else { return Ok((None, Visited::default())) };
        ask(|| {
            let mut remembered = Remembered::new(1);
            let mut walk = Walk::new(self, line, true, &mut remembered);
            walk.root()?;
            Ok((walk.first(), walk.visited))
        })
    }

    /// Casts many rays through the model: see [`ModelRays`].
    pub fn rays(&self) -> ModelRays<'_> {
        ModelRays { model: self, remembered: Remembered::new(REMEMBERED) }
    }

    fn hit(&self, line: &Line, face: u64, Crossing { share, is_entry }: Crossing) -> Hit {
        Hit { share, point: self.grid().to_world_between(line.at(share)), is_entry, face }
    }
}

/// Casts rays through a model, one thread at a time, because it remembers faces that were read; the answers do not depend on that.
pub struct ModelRays<'a> {
    model: &'a ExactModel,
    remembered: Remembered,
}

impl ModelRays<'_> {
    /// The first place where a ray in the world meets the surface: [`ExactModel::ray`].
    ///
    /// # Errors
    /// Those of [`ExactModel::ray`].
    pub fn first(&mut self, from: [f64; 3], direction: [f64; 3]) -> Result<Option<Hit>> {
        let grid = self.model.grid();
        let steps = direction.map(|along| along * grid.divisor / grid.step);
        let Some(line) = Line::ray(grid, grid.to_grid(from), steps) else { return Ok(None) };
        let mut walk = Walk::new(self.model, line, true, &mut self.remembered);
        walk.root()?;
        Ok(walk.first())
    }

    /// A face, and its normal on the grid, of any length, outwards.
    ///
    /// # Errors
    /// If there is none of that number, or the file is damaged or cannot be read.
    pub fn face(&mut self, number: u64) -> Result<(Face<'_>, [i64; 3])> {
        let seen = self.remembered.face(self.model, number)?;
        Ok((seen.buffer.face(), seen.plane.normal))
    }
}

/// Faces that are remembered from one ray to the next.
const REMEMBERED: usize = 1 << 10;
/// Corners of a face that is remembered, at most: others are read again.
const MOST_CORNERS: usize = 64;

/// Faces that were read last, and their planes: one for each number modulo how many there are.
struct Remembered {
    faces: Vec<SeenFace>,
    /// One with too many corners to be kept.
    large: SeenFace,
}

/// A face that was read.
struct SeenFace {
    /// Its number, if there is one.
    number: Option<u64>,
    buffer: FaceBuffer,
    plane: Plane,
}

impl SeenFace {
    fn none() -> SeenFace {
        SeenFace {
            number: None,
            buffer: FaceBuffer::default(),
            plane: Plane { normal: [0; 3], through: [0; 3] },
        }
    }
}

impl Remembered {
    fn new(most: usize) -> Remembered {
        Remembered { faces: (0..most).map(|_| SeenFace::none()).collect(), large: SeenFace::none() }
    }

    /// A face of the model.
    fn face(&mut self, model: &ExactModel, number: u64) -> Result<&SeenFace> {
        let Remembered { faces, large } = self;
        let place = (number % faces.len() as u64) as usize;
        if faces[place].number == Some(number) {
            return Ok(&faces[place]);
        }
        // Invariant: a face with a number has been read whole, and so has its plane; what fails on the way leaves none.
        large.number = None;
        model.face(number, &mut large.buffer)?;
        large.plane = Plane::of(&large.buffer.face());
        large.number = Some(number);
        if large.buffer.points.len() > MOST_CORNERS {
            return Ok(large);
        }
        std::mem::swap(&mut faces[place], large);
        Ok(&faces[place])
    }
}

/// A way along a line.
struct Walk<'a, 'r> {
    model: &'a ExactModel,
    line: Line,
    /// Whether only the first crossing is wanted.
    is_first: bool,
    /// Crossings by the numbers of their faces; one, or all, some of them more than once.
    found: Vec<(u64, Crossing)>,
    recent: Recent,
    remembered: &'r mut Remembered,
    visited: Visited,
}

impl<'a, 'r> Walk<'a, 'r> {
    /// A way that looks for the first crossing, or for all.
    fn new(
        model: &'a ExactModel,
        line: Line,
        is_first: bool,
        remembered: &'r mut Remembered,
    ) -> Walk<'a, 'r> {
        let (recent, visited) = (Recent::new(), Visited::default());
        Walk { model, line, is_first, found: Vec::new(), recent, remembered, visited }
    }

    /// The first crossing that was found.
    fn first(&self) -> Option<Hit> {
        self.found.first().map(|(number, crossing)| self.model.hit(&self.line, *number, *crossing))
    }

    fn root(&mut self) -> Result<()> {
        let root = self.model.root()?;
        let [min, max] = root.bounds(self.model.grid()).map(|corner| corner.map(|at| at as f64 / 2.0));
        let passages = [0, 1, 2].map(|axis| self.line.passage(axis, min[axis], max[axis]));
        if self.is_wanted(&passages) { self.node(&root, &passages) } else { Ok(()) }
    }

    /// Goes through a node, from front to back, given its cell's passages along each axis.
    ///
    /// Invariant: passages are those of the walls themselves, each divided once, and not of the parent's passages: so two cells agree
    /// about the wall between them, and no ray is lost between these.
    fn node(&mut self, node: &ModelNode<'_>, passages: &[Passage; 3]) -> Result<()> {
        self.visited.nodes += 1;
        if node.state() != ModelNodeState::Inner {
            return self.leaf(node);
        }
        let [min, max] = node.bounds(self.model.grid());
        // (In half steps: a quarter of the sum is the middle in steps.)
        let middle = |axis: usize| (min[axis] + max[axis]) as f64 / 4.0;
        let halves = [0, 1, 2].map(|axis| self.line.halves(axis, passages[axis], middle(axis)));
        // Along each axis that half first in which the line begins.
        let turned = self.line.turned();
        for child in (0..8).map(|child| child ^ turned) {
            let passages = [0, 1, 2].map(|axis| halves[axis][child >> axis & 1]);
            // (Before the child is looked up, which takes longer.)
            if self.is_wanted(&passages) {
                self.node(&self.model.child(node, child)?, &passages)?;
            }
        }
        Ok(())
    }

    /// Whether the line passes through a cell before what was found.
    fn is_wanted(&self, passages: &[Passage; 3]) -> bool {
        let Some([first, _]) = self.line.within_all(passages) else { return false };
        !(self.is_first && self.found.first().is_some_and(|(_, found)| found.share < first))
    }

    fn leaf(&mut self, node: &ModelNode<'_>) -> Result<()> {
        for number in node.faces() {
            if self.recent.is_known(number) {
                continue;
            }
            self.visited.faces += 1;
            let seen = self.remembered.face(self.model, number)?;
            let Some(crossing) = self.line.crossing_of(&seen.buffer.face(), &seen.plane) else { continue };
            match self.found.first_mut() {
                Some(first) if self.is_first => {
                    let is_before = crossing.share.total_cmp(&first.1.share).then(number.cmp(&first.0));
                    if is_before.is_lt() {
                        *first = (number, crossing);
                    }
                }
                _ => self.found.push((number, crossing)),
            }
        }
        Ok(())
    }
}
