//! Objects of the results of set operations: each face belongs to the object that it bounds.

use std::collections::BTreeMap;

use spinney::brep::{Faces, Grid};
use spinney::raw::brep::FaceList;

use crate::common::Random;
use crate::common::exact::{Ring, built_with_parts, bumpy_torus, cuboid, push};
use crate::common::sets::{Body, MEMORY, Solid, combined, grid, tetrahedron};

/// Returns a model with an object of a name for each solid.
fn city(grid: Grid, objects: &[(&str, Solid)]) -> Body {
    let mut list = FaceList::new(grid, objects.iter().map(|(name, _)| (*name).to_string()).collect());
    for (part, (_, faces)) in (0..).zip(objects) {
        faces.iter().for_each(|rings| push(&mut list, rings, part, None));
    }
    Body::of_bytes(built_with_parts(&list, MEMORY))
}

/// Returns the volumes of the objects that have faces, by name. All must be closed.
fn volumes(body: &Body) -> BTreeMap<String, f64> {
    let of_parts = body.model.part_measures(MEMORY, &()).unwrap();
    let of_part = of_parts.iter().map(|part| {
        let name = body.model.parts()[part.part as usize].clone();
        assert!(part.is_closed, "{name} is open");
        (name, part.measures.volume)
    });
    of_part.collect()
}

fn near(one: f64, other: f64) -> bool {
    (one - other).abs() <= 1e-9 * one.abs().max(other.abs()).max(1e6)
}

/// Each object of the owner is cut as if it were alone, also where objects touch and where the tool
/// has vertices off the grid in the result. Objects that the tool does not meet stay.
#[test]
fn objects_are_cut_one_by_one() {
    let mut random = Random(4711);
    const SIDE: i32 = 1 << 16;
    let boxes: Vec<(&str, [[i32; 3]; 2])> = vec![
        ("a", [[0, 0, 0], [20_000, 30_000, 30_000]]),
        ("b", [[20_000, 0, 0], [40_000, 30_000, 20_000]]),
        ("c", [[20_000, 0, 20_000], [40_000, 30_000, 40_000]]),
        ("d", [[50_000, 50_000, 50_000], [60_000, 60_000, 60_000]]),
    ];
    let solids: Vec<(&str, Solid)> = boxes.iter().map(|(name, [a, b])| (*name, cuboid(*a, *b))).collect();
    let all = city(grid(16), &solids);
    let mut cut = 0;
    for case in 0..12 {
        // (Some are on the planes of the walls.)
        let mut at = |axis: usize| {
            let wall = [20_000, 30_000, 20_000][axis];
            if random.below(5) == 0 { wall } else { random.below(SIDE as u64 * 2 / 3) as i32 }
        };
        let corners = [0; 4].map(|_: i32| [0, 1, 2].map(&mut at));
        let Some(faces) = tetrahedron(corners) else { continue };
        let tool = city(grid(16), &[("tool", faces)]);
        for operation in [1, 2] {
            let result = combined(operation, &[&all, &tool]);
            assert_eq!(result.model.verify(MEMORY, &()).unwrap(), [], "{case}");
            assert_eq!(result.model.parts(), all.model.parts(), "{case}");
            let found = volumes(&result);
            for solid in &solids {
                let alone =
                    combined(operation, &[&city(grid(16), std::slice::from_ref(solid)), &tool]).volume();
                let of_all = found.get(solid.0).copied().unwrap_or(0.0);
                assert!(near(of_all, alone), "{case}, operation {operation}, {}: {of_all} {alone}", solid.0);
                cut += u32::from(alone > 0.0 && operation == 1);
            }
            // The other way round, the second operand is the owner, and the complement has the same
            // objects as cavities.
            if operation == 2 {
                assert_eq!(volumes(&combined(4, &[&tool, &all])), found, "{case}");
            }
            let cavities = volumes(&combined(15 - operation, &[&all, &tool]));
            let are_same =
                cavities.iter().zip(&found).all(|(one, other)| one.0 == other.0 && near(*one.1, -other.1));
            assert!(cavities.len() == found.len() && are_same, "{case}: {cavities:?} {found:?}");
            // A result is an operand: the objects of both, together again, are the first ones.
            if operation == 2 {
                let kept = combined(1, &[&all, &tool]);
                let whole = combined(7, &[&result, &kept]);
                let volume: f64 = volumes(&whole).values().sum();
                assert!(near(volume, all.volume()), "{case}: {volume}");
            }
        }
    }
    assert!(cut > 10, "{cut}");
}

/// Faces of the tool that are far from the object, and are kept without being read, belong to the
/// object around them. The tool has more faces, so that its octree is reused.
#[test]
fn faces_far_from_others_belong_to_the_object_around_them() {
    let torus = bumpy_torus(60, 40, grid(16));
    let bytes = built_with_parts(&torus, MEMORY);
    let tool = Body::of_bytes(bytes);
    let solids = [
        ("left", cuboid([0, 0, 0], [29_400, 65_000, 65_000])),
        ("right", cuboid([29_400, 0, 0], [65_000, 65_000, 65_000])),
    ];
    let all = city(grid(16), &solids);
    for operation in [1, 2] {
        let result = combined(operation, &[&all, &tool]);
        assert_eq!(result.model.parts(), ["left", "right"]);
        let found = volumes(&result);
        for solid in &solids {
            let alone = combined(operation, &[&city(grid(16), std::slice::from_ref(solid)), &tool]);
            assert!(near(found[solid.0], alone.volume()), "{operation}, {}", solid.0);
        }
    }
    // In unions, what is inside of another object is part of it.
    let result = combined(7, &[&tool, &all]);
    assert_eq!(volumes(&result), [("torus".to_string(), all.volume())].into());
    assert_eq!(volumes(&combined(6, &[&all, &tool])), volumes(&combined(2, &[&all, &tool])));
}

/// The rule for each of the sixteen operations, for two boxes that overlap.
#[test]
fn every_operation_has_its_objects() {
    let [a, b] = [0, 4].map(|low| cuboid([low; 3], [low + 8; 3]));
    let [a, b] = [("A", a), ("B", b)].map(|solid| city(grid(5), &[solid]));
    let (both, one) = (64.0, 512.0);
    let bounded: [&[(&str, f64)]; 8] = [
        &[],
        &[("A", both)],
        &[("A", one - both)],
        &[("A", one)],
        &[("B", one - both)],
        &[("B", one)],
        &[("A", one - both), ("B", one - both)],
        &[("A", 2.0 * one - both)],
    ];
    for operation in 0..16 {
        let (objects, sign) = match operation {
            8.. => (bounded[15 - usize::from(operation)], -1.0),
            _ => (bounded[usize::from(operation)], 1.0),
        };
        let expected: BTreeMap<String, f64> =
            objects.iter().map(|(name, volume)| ((*name).to_string(), sign * volume)).collect();
        assert_eq!(volumes(&combined(operation, &[&a, &b])), expected, "operation {operation}");
        // A complement has cavities for objects.
        let not_a = combined(12, &[&a]);
        let turned = [0, 1, 2, 3].iter().fold(0, |all, bit| {
            // Bit 0 is "both", 1 "A only", 2 "B only", 3 "neither": without A for A.
            all | (operation >> bit & 1) << [2, 3, 0, 1][*bit as usize]
        });
        assert_eq!(volumes(&combined(turned, &[&not_a, &b])), expected, "operation {turned} of not A");
    }
}

/// Objects of different operands that overlap or have a wall in common are one in a union; those
/// that only touch in an edge are not, and walls within an operand stay.
#[test]
fn unions_have_closed_objects() {
    let block = |low: [i32; 3], high: [i32; 3]| cuboid(low, high);
    let two = city(grid(6), &[("left", block([0; 3], [10, 8, 6])), ("right", block([10, 0, 0], [20, 8, 6]))]);
    let expected = |objects: &[(&str, f64)]| -> BTreeMap<String, f64> {
        objects.iter().map(|(name, volume)| ((*name).to_string(), *volume)).collect()
    };
    let walls = expected(&[("left", 480.0), ("right", 480.0)]);
    assert_eq!(volumes(&two), walls);
    assert_eq!(volumes(&combined(7, &[&two, &two])), walls);
    let of = |name, low, high| city(grid(6), &[(name, block(low, high))]);
    // On the roof of one of them, next to it along an edge, and across both.
    let roof = of("roof", [2, 2, 6], [8, 6, 9]);
    assert_eq!(volumes(&combined(7, &[&two, &roof])), expected(&[("left", 480.0 + 72.0), ("right", 480.0)]));
    let edge = of("edge", [0, 8, 6], [10, 12, 9]);
    let separate = expected(&[("left", 480.0), ("right", 480.0), ("edge", 120.0)]);
    assert_eq!(volumes(&combined(7, &[&two, &edge])), separate);
    let bridge = of("bridge", [8, 2, 4], [12, 6, 8]);
    assert_eq!(volumes(&combined(7, &[&two, &bridge])), expected(&[("left", 960.0 + 32.0)]));
    // The bridge is inside of both, and far from the other walls.
    let inside = of("inside", [9, 3, 2], [11, 5, 4]);
    assert_eq!(volumes(&combined(7, &[&inside, &two])), expected(&[("inside", 960.0)]));
    // Many operands.
    let all = combined(7, &[&two, &edge, &roof, &two, &of("far", [40; 3], [50; 3])]);
    assert_eq!(
        volumes(&all),
        expected(&[("left", 552.0), ("right", 480.0), ("edge", 120.0), ("far", 1000.0)])
    );
    let odd = combined(6, &[&two, &bridge, &roof]);
    assert!(volumes(&odd).values().sum::<f64>() > 900.0);
}

/// Parts that are not closed by themselves are no objects: new faces keep their own names.
#[test]
fn groups_of_faces_are_no_objects() {
    let mut list = FaceList::new(grid(5), vec!["roof".into(), "walls".into()]);
    for (number, rings) in cuboid([0; 3], [8; 3]).iter().enumerate() {
        push(&mut list, rings, u32::from(number > 0), None);
    }
    let house = Body::of_bytes(built_with_parts(&list, MEMORY));
    let tool = city(grid(5), &[("tool", cuboid([2, 2, 4], [6, 6, 12]))]);
    let cut = combined(2, &[&house, &tool]);
    assert_eq!(cut.model.parts(), ["roof", "walls", "tool"]);
    let mut counts = [0; 3];
    let mut rings: Vec<Ring> = Vec::new();
    cut.model
        .each(&mut |face| {
            counts[face.part as usize] += 1;
            rings.push(face.points.to_vec());
            Ok(())
        })
        .unwrap();
    assert_eq!((counts, rings.len()), ([1, 5, 5], 11));
}
