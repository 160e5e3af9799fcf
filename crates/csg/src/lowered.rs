//! A solid without names and hierarchy: each primitive in world coordinates, and one expression
//! over all of them.

use std::path::Path;

use crate::affine::Affine;
use crate::expression::{Instruction, fold};
use crate::model::{Node, Primitive, Tree};
use crate::syntax::wrong;
use spinney_base::Result;

/// A box: minimum and maximum coordinates.
pub(crate) type Bounds = [[f64; 3]; 2];

/// All of space.
const EVERYWHERE: Bounds = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
/// The empty box.
const NOWHERE: Bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// A primitive in world coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    /// Index of the primitive in the CSG text.
    pub(crate) primitive: u32,
    /// Transform from local to world coordinates.
    pub(crate) to_world: Affine,
    /// The inverse transform.
    pub(crate) to_local: Affine,
}

/// Primitives in world coordinates, and the expression that combines them.
#[derive(Clone, Debug)]
pub(crate) struct Lowered {
    pub(crate) instances: Vec<Instance>,
    pub(crate) instructions: Vec<Instruction>,
}

/// Kind of an operation. Nested operations of the same kind are merged, and complements are pushed
/// down to the primitives.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Any,
    All,
    Odd,
}

/// A pending traversal task.
enum Task {
    /// Visit a node, or its complement, with a transform, as an operand of an operation of kind
    /// `within`.
    Enter { node: u32, map: usize, is_negated: bool, within: Option<Kind> },
    /// Finish an operation.
    End(Kind),
}

impl Lowered {
    pub(crate) fn of(path: &Path, tree: &Tree) -> Result<Lowered> {
        let (mut instances, mut instructions) = (Vec::new(), Vec::new());
        let mut maps = vec![Affine::IDENTITY];
        // For each open operation, its operand count so far, and whether an even count of operands
        // is inside.
        let mut open = vec![(0u32, false)];
        let mut tasks = vec![Task::Enter { node: tree.root, map: 0, is_negated: false, within: None }];
        while let Some(task) = tasks.pop() {
            let (node, map, is_negated, within) = match task {
                Task::Enter { node, map, is_negated, within } => (node, map, is_negated, within),
                Task::End(kind) => {
                    let Some((count, is_even)) = open.pop() else { continue };
                    match kind {
                        Kind::Any => instructions.push(Instruction::Any(count)),
                        Kind::All => instructions.push(Instruction::All(count)),
                        Kind::Odd => instructions.push(Instruction::Odd(count, is_even)),
                    }
                    open.iter_mut().last().into_iter().for_each(|(count, _)| *count += 1);
                    continue;
                }
            };
            let (kind, links) = match tree.nodes[node as usize] {
                Node::Primitive(number) => {
                    let primitive = &tree.primitives[number as usize];
                    let to_world = maps[map].after(&primitive.map);
                    let Some(to_local) = to_world.inverse().filter(|_| to_world.is_bounded()) else {
                        let found = "a primitive whose transformed coordinates are too large or too small";
                        return Err(wrong(path, primitive.at, found, "another transform"));
                    };
                    instructions.push(Instruction::Primitive(instances.len() as u32, is_negated));
                    instances.push(Instance { primitive: number, to_world, to_local });
                    open.iter_mut().last().into_iter().for_each(|(count, _)| *count += 1);
                    continue;
                }
                Node::Not(node) => {
                    tasks.push(Task::Enter { node, map, is_negated: !is_negated, within });
                    continue;
                }
                Node::Moved(number, node) => {
                    maps.push(maps[map].after(&tree.maps[number as usize]));
                    tasks.push(Task::Enter { node, map: maps.len() - 1, is_negated, within });
                    continue;
                }
                // (De Morgan: the complement of a union is the intersection of the complements.)
                Node::Any(first, end) => (if is_negated { Kind::All } else { Kind::Any }, first..end),
                Node::All(first, end) => (if is_negated { Kind::Any } else { Kind::All }, first..end),
                Node::Odd(first, end) => (Kind::Odd, first..end),
            };
            let is_even = kind == Kind::Odd && is_negated;
            if within == Some(kind) {
                open.iter_mut().last().into_iter().for_each(|(_, even)| *even ^= is_even);
            } else {
                open.push((0, is_even));
                tasks.push(Task::End(kind));
            }
            let links = links.rev().map(|link| tree.links[link as usize]);
            let is_negated = is_negated && kind != Kind::Odd;
            tasks.extend(links.map(|node| Task::Enter { node, map, is_negated, within: Some(kind) }));
        }
        Ok(Lowered { instances, instructions })
    }

    /// Returns the bounding box of each primitive.
    pub(crate) fn boxes(&self, primitives: &[Primitive]) -> Vec<Bounds> {
        let of = |instance: &Instance| {
            let shape = &primitives[instance.primitive as usize].shape;
            let reach =
                instance.to_world.rows.map(|[x, y, z, shift]| shape.reach([x, y, z]).map(|end| end + shift));
            [0, 1].map(|end| reach.map(|reach| reach[end]))
        };
        self.instances.iter().map(of).collect()
    }

    /// Returns a bounding box of the solid, which may be infinite or empty.
    pub(crate) fn bounds(&self, boxes: &[Bounds]) -> Bounds {
        let mut stack = Vec::new();
        let primitive =
            |number: u32, is_negated| if is_negated { EVERYWHERE } else { boxes[number as usize] };
        let operation = |step: Instruction, all: &[Bounds]| match step {
            Instruction::All(_) => all.iter().fold(EVERYWHERE, |one, other| meet(&one, other)),
            Instruction::Odd(_, true) => EVERYWHERE,
            _ => all.iter().fold(NOWHERE, |one, other| hull(&one, other)),
        };
        fold(&self.instructions, &mut stack, primitive, operation).unwrap_or(NOWHERE)
    }
}

/// Returns the box around two boxes.
pub(crate) fn hull(one: &Bounds, other: &Bounds) -> Bounds {
    let min = [0, 1, 2].map(|axis| one[0][axis].min(other[0][axis]));
    [min, [0, 1, 2].map(|axis| one[1][axis].max(other[1][axis]))]
}

/// Returns the intersection of two boxes.
fn meet(one: &Bounds, other: &Bounds) -> Bounds {
    let min = [0, 1, 2].map(|axis| one[0][axis].max(other[0][axis]));
    let both = [min, [0, 1, 2].map(|axis| one[1][axis].min(other[1][axis]))];
    if has_volume(&both) { both } else { NOWHERE }
}

/// Whether a box has a volume.
pub(crate) fn has_volume([min, max]: &Bounds) -> bool {
    (0..3).all(|axis| min[axis] < max[axis])
}

/// Whether a box is finite.
pub(crate) fn is_finite(bounds: &Bounds) -> bool {
    bounds.iter().flatten().all(|at| at.is_finite())
}
