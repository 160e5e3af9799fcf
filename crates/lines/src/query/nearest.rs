//! The lines nearest to places.

use std::collections::{BTreeSet, BinaryHeap, HashMap};
use std::rc::Rc;

use super::select::fixed_box;
use crate::codec::Piece;
use crate::geometry::{FRACTION, Place, ends, square_distance, square_to_box};
use crate::store::LineTree;
use spinney_base::{Error, Progress, Result, parallel, sort};

/// A line near a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearLine {
    /// Number of its feature.
    pub feature: u64,
    /// The place, among all vertices of the feature, of the first one of the nearest piece.
    pub vertex: u32,
    /// How far away it is.
    pub distance: f64,
    /// The place on it that is nearest.
    pub place: [f64; 2],
}

/// A block or a node that may have nearer lines; the nearest is the greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    square: f64,
    what: What,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum What {
    Node(usize),
    Block(usize),
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Candidate) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Candidate) -> std::cmp::Ordering {
        other.square.total_cmp(&self.square).then(other.what.cmp(&self.what))
    }
}

/// The nearest piece of each of the best features so far.
struct Best {
    most: usize,
    /// Square of the distance that better ones have at most.
    limit: f64,
    pieces: HashMap<u64, (f64, Piece)>,
    /// Squares, as bits, which are in the same order, and features.
    order: BTreeSet<(u64, u64)>,
}

impl Best {
    fn look(&mut self, square: f64, piece: &Piece) {
        if square > self.limit {
            return;
        }
        let known = self.pieces.get(&piece.feature).copied();
        if let Some((before, old)) = known {
            if (before, old.place) <= (square, piece.place) {
                return;
            }
            self.order.remove(&(before.to_bits(), piece.feature));
        }
        self.pieces.insert(piece.feature, (square, *piece));
        self.order.insert((square.to_bits(), piece.feature));
        if self.order.len() > self.most
            && let Some((_, feature)) = self.order.pop_last()
        {
            self.pieces.remove(&feature);
        }
        if self.order.len() == self.most
            && let Some((bits, _)) = self.order.last()
        {
            self.limit = self.limit.min(f64::from_bits(*bits));
        }
    }
}

/// Questions that are answered by one thread, one after the other.
const TOGETHER: usize = 512;
/// Blocks that a thread keeps for further questions.
const KEPT: usize = 64;

impl LineTree {
    /// Finds the lines nearest to each of some places: of at most `most` features, each no farther than `within`; the nearest first, of those that are equally far
    /// the one whose feature comes first.
    ///
    /// Places are taken to the nearest 2^-16 of a step of the grid. Whether a vertex or a place between is nearest is decided exactly, and lines that meet in the nearest vertex
    /// are equally far; otherwise squares of distances are doubles.
    ///
    /// # Errors
    /// If a coordinate is no number or very far away from the lines, the file is damaged or cannot be read.
    pub fn nearest(
        &self,
        places: &[[f64; 2]],
        (most, within): (usize, f64),
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<NearLine>>> {
        let is_wrong =
            |place: &&[f64; 2]| !place.iter().all(|number| number.is_finite()) || self.grid().is_far(**place);
        if let Some(place) = places.iter().find(is_wrong) {
            let expected = "coordinates of the system that the lines are in";
            return Err(Error::invalid("place", format!("{place:?}"), expected));
        }
        let mut found = vec![Vec::new(); places.len()];
        if most == 0 || within.is_nan() || within < 0.0 {
            return Ok(found);
        }
        let steps = within / self.grid().scale * FRACTION as f64;
        let order = self.order(places);
        let parts: Vec<&[u32]> = order.chunks(TOGETHER).collect();
        for batch in parts.chunks(4 * parallel::threads()) {
            progress.check()?;
            let answers = parallel::map(batch, |part| self.answer(part, places, (most, steps * steps)));
            for (part, answers) in batch.iter().zip(answers) {
                for (place, answer) in part.iter().zip(answers?) {
                    found[*place as usize] = answer;
                }
                progress.advance(part.len() as u64, places.len() as u64);
            }
        }
        Ok(found)
    }

    /// The numbers of places in the order of the codes nearest to them, so that a block is unpacked for many of them.
    fn order(&self, places: &[[f64; 2]]) -> Vec<u32> {
        let grid = self.grid();
        let far = (1i64 << grid.bits) - 1;
        let key = |place: &[f64; 2]| {
            let fixed = grid.fixed(*place);
            let step = std::array::from_fn(|axis| {
                let corner = i64::from(grid.corner[axis]);
                (fixed[axis] / FRACTION - corner)
                    .clamp(0, far)
                    .saturating_add(corner)
                    .clamp(i32::MIN.into(), i32::MAX.into()) as i32
            });
            grid.code([step; 2]).map_or(0, |code| code.bits())
        };
        let number = |(number, place)| u128::from(key(place)) << 32 | number as u128;
        let mut order: Vec<u128> = places.iter().enumerate().map(number).collect();
        sort::numbers128(&mut order);
        order.into_iter().map(|key| key as u32).collect()
    }

    fn answer(
        &self,
        part: &[u32],
        places: &[[f64; 2]],
        (most, limit): (usize, f64),
    ) -> Result<Vec<Vec<NearLine>>> {
        let mut kept: HashMap<usize, Rc<Vec<Piece>>> = HashMap::new();
        let mut answers = Vec::with_capacity(part.len());
        for place in part {
            let from = self.grid().fixed(places[*place as usize]);
            let best = Best { most, limit, pieces: HashMap::new(), order: BTreeSet::new() };
            answers.push(self.look(from, best, &mut kept)?);
        }
        Ok(answers)
    }

    /// Looks at nodes and blocks, the nearest first, until none can have a nearer line.
    fn look(
        &self,
        from: Place,
        mut best: Best,
        kept: &mut HashMap<usize, Rc<Vec<Piece>>>,
    ) -> Result<Vec<NearLine>> {
        let candidate = |bounds, what| Candidate { square: square_to_box(fixed_box(bounds), from), what };
        let mut open = BinaryHeap::new();
        open.extend(self.root()?.map(|root| candidate(root.bounds, What::Node(root.index))));
        while let Some(Candidate { square, what }) = open.pop() {
            if square > best.limit {
                break;
            }
            match what {
                What::Node(index) => {
                    let node = self.node(index)?;
                    let blocks = self.blocks_of(node.code);
                    open.extend(
                        blocks.map(|block| candidate(self.block_entry(block).bounds, What::Block(block))),
                    );
                    let children = self.children(&node)?;
                    open.extend(
                        children.iter().map(|child| candidate(child.bounds, What::Node(child.index))),
                    );
                }
                What::Block(block) => {
                    let pieces = match kept.get(&block) {
                        Some(pieces) => pieces.clone(),
                        None => {
                            if kept.len() >= KEPT {
                                kept.clear();
                            }
                            let pieces = Rc::new(self.block(block)?);
                            kept.insert(block, pieces.clone());
                            pieces
                        }
                    };
                    for piece in pieces.iter() {
                        best.look(square_distance(ends(piece.ends), from), piece);
                    }
                }
            }
        }
        let Best { pieces, order, .. } = best;
        let grid = self.grid();
        let near = |(_, feature): (u64, u64)| {
            let (square, piece) = pieces.get(&feature)?;
            let place = nearest_place(ends(piece.ends), from);
            Some(NearLine {
                feature,
                vertex: piece.place,
                distance: grid.units(square.sqrt() / FRACTION as f64),
                place: grid.world(place.map(|number| number / FRACTION as f64)),
            })
        };
        Ok(order.into_iter().filter_map(near).collect())
    }
}

/// The place of a line that is nearest to another place.
fn nearest_place([a, b]: [Place; 2], from: Place) -> [f64; 2] {
    let along = [0, 1].map(|axis| (b[axis] - a[axis]) as f64);
    let to = [0, 1].map(|axis| (from[axis] - a[axis]) as f64);
    let square = along[0] * along[0] + along[1] * along[1];
    let share = ((along[0] * to[0] + along[1] * to[1]) / square).clamp(0.0, 1.0);
    let share = if share.is_nan() { 0.0 } else { share };
    std::array::from_fn(|axis| a[axis] as f64 + share * along[axis])
}
