//! What operations do with cells: the tables of node kinds, and the leaves near several bodies.

use std::collections::{HashMap, HashSet};

use super::table::Fate;
use super::tests::{block, model_of_leaves, result, set, six_volumes};
use super::*;
use crate::store::segment::NodeKind;
use crate::{ModelNode, ModelNodeState};

/// Leaves of a model's octree: kinds, faces, and boxes in half units.
fn leaves(model: &ExactModel) -> Vec<(NodeKind, Vec<u64>, [[i64; 3]; 2])> {
    let (mut open, mut found) = (vec![model.root().unwrap()], Vec::new());
    while let Some(node) = open.pop() {
        if let ModelNodeState::Leaf { kind, .. } = node.state() {
            found.push((kind, node.faces().collect(), node.bounds(model.grid())));
        }
        open.extend(model.children(&node).unwrap().into_iter().flatten());
    }
    found
}

/// The winding number of a model throughout a box, -2 if it varies; `None` if there are faces in
/// it.
fn winding_in(model: &ExactModel, node: &ModelNode<'_>, [low, high]: &[[i64; 3]; 2]) -> Option<i32> {
    let cell = node.bounds(model.grid());
    if (0..3).any(|axis| cell[1][axis] < low[axis] || high[axis] < cell[0][axis]) {
        return Some(-1);
    }
    if node.state() != ModelNodeState::Inner {
        return node.winding();
    }
    let parts = model.children(node).unwrap().into_iter().flatten();
    let parts: Option<Vec<i32>> = parts.map(|part| winding_in(model, &part, &[*low, *high])).collect();
    parts?.into_iter().filter(|winding| *winding >= 0).reduce(|a, b| if a == b { a } else { -2 })
}

/// The tables of N. Navazo and others (six states of a cell by six). Where one body has faces of
/// any kind and the other is VOID or FULL, the cell's faces are kept, reversed or dropped by the
/// operation's table. Where both are VOID or FULL, so is the result.
#[test]
fn cells_are_as_the_tables_say() {
    /// The operations that depend on both bodies.
    const BOTH: [u8; 10] = [1, 2, 4, 6, 7, 8, 9, 11, 13, 14];
    let mut seen: HashSet<(u8, usize, u8, i32)> = Default::default();
    // Subdivision ends where all faces of a cell are coplanar. Such cells are large, and none is
    // within the other body.
    for (from, layers) in [([500, 520, 540], None), ([600, 620, 640], Some([10, 0]))] {
        let [first, second] = [0, 1].map(|body| layers.map(|layers| layers[body]));
        let bodies = [block(400, [100; 3], first), block(400, from, second)];
        let bodies = bodies.map(|faces| model_of_leaves(&faces, 4));
        let corners = |model: &ExactModel, number: u64| {
            let mut buffer = crate::FaceBuffer::default();
            model.face(number, &mut buffer).unwrap();
            buffer.points
        };
        // Per body: its leaves, the leaves of each face, and per leaf the other body's winding
        // number if that is far.
        let described = [0, 1].map(|own| {
            let (all, other) = (leaves(&bodies[own]), &bodies[1 - own]);
            let mut cells_of: HashMap<u64, Vec<usize>> = HashMap::new();
            for (index, (_, faces, _)) in all.iter().enumerate() {
                faces.iter().for_each(|face| cells_of.entry(*face).or_default().push(index));
            }
            let is_far = |cell: &[[i64; 3]; 2]| {
                let around = [cell[0].map(|at| at - 2), cell[1].map(|at| at + 2)];
                winding_in(other, &other.root().unwrap(), &around)
            };
            let sides: Vec<Option<i32>> = all.iter().map(|(_, _, cell)| is_far(cell)).collect();
            (all, cells_of, sides)
        });
        for operation in BOTH {
            let table = OperationTable::new(set(operation), 2).unwrap();
            let result = result(operation, &[&bodies[0], &bodies[1]]);
            let mut faces: HashSet<Vec<[i32; 3]>> = Default::default();
            result
                .each(&mut |face| {
                    faces.insert(face.points.to_vec());
                    Ok(())
                })
                .unwrap();
            let has = |ring: &[[i32; 3]]| {
                (0..ring.len()).any(|first| {
                    let mut ring = ring.to_vec();
                    ring.rotate_left(first);
                    faces.contains(&ring)
                })
            };
            let find = |at: [i64; 3]| result.leaf_at(at, 1).unwrap();
            for own in 0..2 {
                let (model, (all, cells_of, sides)) = (&bodies[own], &described[own]);
                // The cells of a face decide: if all are far, the face is unchanged.
                for (&face, cells) in cells_of {
                    let Some(sides) = cells.iter().map(|cell| sides[*cell]).collect::<Option<Vec<i32>>>()
                    else {
                        continue;
                    };
                    assert!(sides.iter().all(|side| *side == sides[0]), "{from:?}: {face} in {sides:?}");
                    let mut windings = [sides[0]; 2];
                    windings[own] = 0;
                    let fate = table.fate(own, &windings);
                    let ring = corners(model, face);
                    let turned: Vec<[i32; 3]> = ring.iter().rev().copied().collect();
                    let expected = [fate == Fate::Keep, fate == Fate::Reverse];
                    assert_eq!(
                        [has(&ring), has(&turned)],
                        expected,
                        "{from:?}: {operation}, face {face} of {own}"
                    );
                    cells.iter().for_each(|cell| {
                        seen.insert((operation, own, all[*cell].0 as u8, sides[0]));
                    });
                }
                // Points where both are VOID or FULL.
                for (_, _, [low, _]) in all.iter().step_by(7) {
                    for way in 0..6 {
                        let mut at = *low;
                        at[way / 2] += if way % 2 == 0 { -60 } else { 60 };
                        let Some(there) = find(at) else { continue };
                        let sides: Option<Vec<i32>> = bodies
                            .iter()
                            .map(|body| body.leaf_at(at, 1).unwrap().and_then(|node| node.winding()))
                            .collect();
                        let (Some(sides), Some(found)) = (sides, there.winding()) else { continue };
                        assert_eq!(found == 1, table.is_inside(&sides), "{from:?}: {operation} at {at:?}");
                    }
                }
            }
        }
    }
    for operation in BOTH {
        for kind in [NodeKind::Face, NodeKind::Edge, NodeKind::Vertex, NodeKind::Boolean] {
            for side in [0, 1] {
                // (Within the other body, leaves far from its surface have faces of several
                // planes.)
                let is_rare = (kind, side) == (NodeKind::Face, 1);
                let is_seen = is_rare || (0..2).any(|own| seen.contains(&(operation, own, kind as u8, side)));
                assert!(is_seen, "no cell of the kind {kind:?} with {side} in operation {operation}");
            }
        }
    }
}

/// The counts of pairs, compared with each leaf's surroundings: a leaf near the other surface is
/// met once in an entry "face by face". Where one model decides, only the roots are met.
#[test]
fn counts_of_pairs_are_those_of_leaves() {
    let bodies = [block(400, [100; 3], None), block(401, [500, 520, 540], None)];
    let bodies = bodies.map(|faces| model_of_leaves(&faces, 4));
    let models = [&bodies[0], &bodies[1]];
    let near = [0, 1].map(|own: usize| {
        let (model, other) = (models[own], models[1 - own]);
        let mut near = [0; 4];
        for (kind, _, cell) in leaves(model) {
            let around = [cell[0].map(|at| at - 2), cell[1].map(|at| at + 2)];
            if winding_in(other, &other.root().unwrap(), &around).is_none() {
                near[kind as usize] += 1;
            }
        }
        near
    });
    let directory = tempfile::tempdir().unwrap();
    for operation in [0, 2, 3, 10, 14].map(set) {
        let output = Output::create(&directory.path().join(format!("{}.goblin", operation.index()))).unwrap();
        let (report, pairs) =
            combine_explained(operation, models, output, Codec::Plain, 64 << 20, &()).unwrap();
        let count = |own: usize, is_counted: &dyn Fn([OperandKind; 2], TableEntry) -> bool| -> u64 {
            let counted = pairs.iter().filter(|pair| is_counted(pair.kinds, pair.entry));
            counted.map(|pair| pair.met[own]).sum()
        };
        if !matches!(operation.index(), 2 | 14) {
            assert_eq!([0, 1].map(|own| count(own, &|_, _| true)), [1, 1], "{operation}: the roots decide");
            continue;
        }
        assert!(report.near > 20, "{operation}");
        for own in 0..2 {
            let kinds = [OperandKind::Face, OperandKind::Edge, OperandKind::Vertex, OperandKind::Boolean];
            for (index, operand) in kinds.into_iter().enumerate() {
                let found = count(own, &|kinds, entry| kinds[own] == operand && entry == TableEntry::Faces);
                assert_eq!(found, near[own][index], "{operation}: {operand:?} of {own}");
            }
            assert!(near[own].iter().sum::<u64>() > 20);
            let divided = count(own, &|_, entry| entry == TableEntry::Divide);
            let settled = count(own, &|kinds, entry| {
                !kinds[own].is_uniform() && kinds[1 - own].is_uniform() && entry.fate(own).is_some()
            });
            assert!(divided > 20 && settled > 20, "{operation}: {divided} and {settled}");
        }
    }
}

/// Leaves that are near several bodies: three at once are as two after each other.
#[test]
fn three_bodies_are_combined_as_pairs() {
    let blocks =
        [block(1, [100; 3], Some(10)), block(2, [500, 520, 540], Some(0)), block(3, [480, 130, 90], Some(0))];
    let [a, b, c] = blocks.map(|faces| model_of_leaves(&faces, 4));
    let at_once = result(1, &[&a, &b, &c]);
    let pair = result(1, &[&a, &b]);
    let found = six_volumes(&at_once);
    assert_eq!(found, six_volumes(&result(1, &[&pair, &c])));
    assert_ne!(found, six_volumes(&pair));
}
