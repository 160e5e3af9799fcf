//! Set operations on exact models made of whole cells, against cell counts.

use spinney::brep::{Faces, Location};

use crate::common::Random;
use crate::common::exact::{cuboid, prism, turned};
use crate::common::sets::{Body, Solid, combined, exchanged, holds};

/// Cells along each side of the space.
const SIDE: i32 = 12;

/// Faces, and the cells that they enclose, identified by their minimum corners.
struct Shape {
    faces: Solid,
    cells: Vec<bool>,
}

fn all_cells() -> impl Iterator<Item = [i32; 3]> {
    (0..SIDE.pow(3)).map(|i| [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE])
}

fn is_in(at: [i32; 3], [min, max]: [[i32; 3]; 2]) -> bool {
    (0..3).all(|axis| min[axis] <= at[axis] && at[axis] < max[axis])
}

impl Shape {
    fn of(faces: Solid, is_in: impl Fn([i32; 3]) -> bool) -> Shape {
        Shape { faces, cells: all_cells().map(is_in).collect() }
    }

    fn cuboid(min: [i32; 3], max: [i32; 3]) -> Shape {
        Shape::of(cuboid(min, max), |at| is_in(at, [min, max]))
    }

    /// A box with another one removed from its interior.
    fn hollow(outer: [[i32; 3]; 2], inner: [[i32; 3]; 2]) -> Shape {
        let faces = [cuboid(outer[0], outer[1]), turned(cuboid(inner[0], inner[1]))].concat();
        Shape::of(faces, |at| is_in(at, outer) && !is_in(at, inner))
    }

    /// A vertical square tube.
    fn tube([low, high]: [i32; 2], [from, to]: [i32; 2], [bottom, top]: [i32; 2]) -> Shape {
        let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
        let hole = square(from, to).into_iter().rev().collect();
        Shape::of(prism(&[square(low, high), hole], bottom, top), |at| {
            is_in(at, [[low, low, bottom], [high, high, top]])
                && !is_in(at, [[from, from, bottom], [to, to, top]])
        })
    }

    /// A box without a corner, from bottom to top.
    fn angle(from: [i32; 2], notch: [i32; 2], to: [i32; 2], [bottom, top]: [i32; 2]) -> Shape {
        let [[a, b], [c, d], [e, f]] = [from, notch, to];
        let ring = vec![[a, b], [e, b], [e, d], [c, d], [c, f], [a, f]];
        Shape::of(prism(&[ring], bottom, top), |at| {
            is_in(at, [[a, b, bottom], [e, f, top]]) && !is_in(at, [[c, d, bottom], [e, f, top]])
        })
    }

    fn body(&self) -> Body {
        Body::of(&self.faces, 4)
    }
}

/// Checks that a solid consists of the given cells, and of the space's exterior if `is_unbounded`.
fn assert_is(body: &Body, cells: &[bool], is_unbounded: bool, name: &str) {
    let count = cells.iter().filter(|cell| **cell != is_unbounded).count() as f64;
    let expected = if is_unbounded { -count } else { count };
    assert_eq!(body.model.is_unbounded(), is_unbounded, "{name}");
    assert!(body.is_closed(), "{name}");
    assert_eq!(body.volume(), expected, "{name}");
    assert!(count > 0.0 || body.model.is_empty(), "{name}: faces of nothing");
    let points: Vec<[f64; 3]> = all_cells().map(|at| at.map(|at| f64::from(at) + 0.5)).collect();
    let mut locations = Vec::new();
    body.model.locate_all(&points, &mut locations).unwrap();
    let location = |is_inside: bool| if is_inside { Location::Inside } else { Location::Outside };
    for ((point, found), expected) in points.iter().zip(locations).zip(cells) {
        assert_eq!(found, location(*expected), "{name} at {point:?}");
    }
    for far in [[-0.5; 3], [-1e9, 1.0, 1.0], [5.0, 5.0, f64::from(SIDE) + 2.5]] {
        assert_eq!(body.model.locate(far).unwrap(), location(is_unbounded), "{name} at {far:?}");
    }
    assert_eq!(body.model.verify(64 << 20, &()).unwrap(), [], "{name}");
}

fn pairs() -> Vec<(&'static str, Shape, Shape)> {
    let cube = || Shape::cuboid([2; 3], [8; 3]);
    vec![
        ("apart", Shape::cuboid([0; 3], [4; 3]), Shape::cuboid([6; 3], [11; 3])),
        ("a corner over another", cube(), Shape::cuboid([5; 3], [11; 3])),
        ("inside", cube(), Shape::cuboid([3; 3], [5; 3])),
        ("the same", cube(), cube()),
        ("a face in common", cube(), Shape::cuboid([8, 2, 2], [11, 8, 8])),
        ("a face in common from inside", cube(), Shape::cuboid([2, 2, 5], [8, 8, 8])),
        ("a part of a face", cube(), Shape::cuboid([8, 3, 4], [11, 6, 10])),
        ("a part of a face from inside", cube(), Shape::cuboid([5, 3, 4], [8, 6, 7])),
        ("an edge in common", cube(), Shape::cuboid([8, 8, 2], [11, 11, 8])),
        ("a part of an edge", cube(), Shape::cuboid([8, 8, 4], [11, 11, 11])),
        ("an edge in common from inside", cube(), Shape::cuboid([5, 5, 2], [8, 8, 8])),
        ("a corner in common", cube(), Shape::cuboid([8; 3], [10; 3])),
        ("a corner in common from inside", cube(), Shape::cuboid([4; 3], [8; 3])),
        ("faces in one plane", cube(), Shape::cuboid([5, 2, 2], [11, 8, 8])),
        ("some faces in one plane", cube(), Shape::cuboid([5, 4, 2], [11, 10, 8])),
        ("through", cube(), Shape::cuboid([4, 5, 0], [6, 7, 11])),
        ("through along a wall", cube(), Shape::cuboid([2, 5, 0], [6, 7, 11])),
        ("a cross", Shape::cuboid([0, 4, 4], [12, 8, 8]), Shape::cuboid([4, 0, 4], [8, 12, 8])),
        ("a cavity", Shape::hollow([[1; 3], [10; 3]], [[3; 3], [8; 3]]), Shape::cuboid([4; 3], [6; 3])),
        ("a full cavity", Shape::hollow([[1; 3], [10; 3]], [[3; 3], [8; 3]]), Shape::cuboid([3; 3], [8; 3])),
        ("into a cavity", Shape::hollow([[1; 3], [10; 3]], [[3; 3], [8; 3]]), Shape::cuboid([5; 3], [12; 3])),
        (
            "two cavities",
            Shape::hollow([[0; 3], [8; 3]], [[2; 3], [6; 3]]),
            Shape::hollow([[3; 3], [12; 3]], [[5; 3], [9; 3]]),
        ),
        ("a plug", Shape::tube([1, 10], [4, 7], [2, 9]), Shape::cuboid([4, 4, 2], [7, 7, 9])),
        ("a longer plug", Shape::tube([1, 10], [4, 7], [2, 9]), Shape::cuboid([4, 4, 0], [7, 7, 11])),
        ("across a hole", Shape::tube([1, 10], [4, 7], [2, 9]), Shape::cuboid([0, 5, 4], [12, 6, 6])),
        (
            "a notch filled",
            Shape::angle([1, 1], [4, 5], [9, 10], [2, 7]),
            Shape::cuboid([4, 5, 2], [9, 10, 7]),
        ),
        (
            "angles",
            Shape::angle([1, 1], [4, 5], [9, 10], [2, 7]),
            Shape::angle([2, 2], [5, 4], [11, 12], [4, 9]),
        ),
        (
            "a tube and an angle",
            Shape::tube([1, 10], [4, 7], [2, 9]),
            Shape::angle([4, 4], [7, 7], [11, 12], [0, 5]),
        ),
    ]
}

#[test]
fn operations_are_those_of_cells() {
    pairs().into_iter().step_by(2).for_each(assert_operations);
}

#[test]
fn operations_are_those_of_other_cells() {
    pairs().into_iter().skip(1).step_by(2).for_each(assert_operations);
}

fn assert_operations((name, a, b): (&str, Shape, Shape)) {
    let (one, other) = (a.body(), b.body());
    for operation in 0..16 {
        let name = format!("{name}, operation {operation}");
        let result = combined(operation, &[&one, &other]);
        let cells: Vec<bool> =
            a.cells.iter().zip(&b.cells).map(|(a, b)| holds(operation, [*a, *b])).collect();
        assert_is(&result, &cells, operation >= 8, &name);
        // Of coincident faces, the first solid's are kept: their number depends on the order.
        if ![1, 2, 4, 7, 9].contains(&operation) {
            continue;
        }
        let back = combined(exchanged(operation), &[&other, &one]);
        assert_is(&back, &cells, operation >= 8, &format!("{name}, in the other order"));
    }
}

#[test]
fn operations_of_one_body() {
    let shape = Shape::hollow([[1; 3], [10; 3]], [[3; 3], [8; 3]]);
    let body = shape.body();
    for operation in [0, 3, 12, 15] {
        let result = combined(operation, &[&body]);
        let cells: Vec<bool> = shape.cells.iter().map(|is_in| holds(operation, [*is_in, false])).collect();
        assert_is(&result, &cells, operation >= 8, &operation.to_string());
        assert_eq!(result.model.len(), if operation % 3 == 0 && operation % 15 != 0 { 12 } else { 0 });
    }
    // The complement of the complement is the solid, face by face.
    let same = combined(12, &[&combined(12, &[&body])]);
    let faces = |body: &Body| {
        let mut faces = Vec::new();
        let mut add = |face: &spinney::brep::Face<'_>| {
            faces.push((face.points.to_vec(), face.ring_ends.to_vec(), face.part, face.source));
            Ok(())
        };
        body.model.each(&mut add).unwrap();
        faces
    };
    assert_eq!(faces(&same), faces(&body));
}

/// The empty set, the whole space and complements are valid operands.
#[test]
fn operations_on_nothing_everything_and_complements() {
    let shape = Shape::cuboid([2; 3], [8; 3]);
    let other = Shape::cuboid([5; 3], [11; 3]);
    let body = shape.body();
    let everywhere = all_cells().map(|_| true).collect::<Vec<_>>();
    let nowhere = all_cells().map(|_| false).collect::<Vec<_>>();
    let complement: Vec<bool> = shape.cells.iter().map(|is_in| !is_in).collect();
    let operands = [
        (body.model.is_unbounded(), shape.cells.clone(), shape.body()),
        (false, other.cells.clone(), other.body()),
        (true, complement, combined(12, &[&body])),
        (true, everywhere, combined(15, &[&body, &body])),
        (false, nowhere, combined(2, &[&body, &body])),
    ];
    for (i, (far_a, cells_a, a)) in operands.iter().enumerate() {
        for (j, (far_b, cells_b, b)) in operands.iter().enumerate() {
            for operation in 0..16 {
                let cells: Vec<bool> =
                    cells_a.iter().zip(cells_b).map(|(a, b)| holds(operation, [*a, *b])).collect();
                let far = holds(operation, [*far_a, *far_b]);
                assert_is(&combined(operation, &[a, b]), &cells, far, &format!("{i} {j} {operation}"));
            }
        }
    }
}

/// Returns a random box.
fn random_box(random: &mut Random, most: i32) -> Shape {
    let mut number = |below: i32| random.below(below as u64) as i32;
    let size = [0; 3].map(|_| 1 + number(most));
    let min = size.map(|size| number(SIDE - size + 1));
    Shape::cuboid(min, [0, 1, 2].map(|axis| min[axis] + size[axis]))
}

/// Returns whether the result of an operation on many solids contains a point, by the number of
/// solids that contain it.
fn holds_of_many(operation: u8, is_in: &[bool]) -> bool {
    let count = is_in.iter().filter(|is_in| **is_in).count();
    let inside = match if operation >= 8 { 15 - operation } else { operation } {
        1 => count == is_in.len(),
        2 => is_in[0] && count == 1,
        6 => count % 2 == 1,
        7 => count > 0,
        _ => false,
    };
    inside != (operation >= 8)
}

#[test]
fn many_bodies_at_once() {
    let mut random = Random(20);
    for round in 0..3 {
        let mut shapes = vec![Shape::cuboid([1; 3], [11; 3])];
        shapes.extend((1..20).map(|_| random_box(&mut random, 5)));
        let bodies: Vec<Body> = shapes.iter().map(Shape::body).collect();
        let bodies: Vec<&Body> = bodies.iter().collect();
        for operation in [0, 1, 2, 6, 7, 8, 9, 13, 14, 15] {
            let cells: Vec<bool> = (0..shapes[0].cells.len())
                .map(|cell| {
                    let is_in: Vec<bool> = shapes.iter().map(|shape| shape.cells[cell]).collect();
                    holds_of_many(operation, &is_in)
                })
                .collect();
            let result = combined(operation, &bodies);
            assert_is(&result, &cells, operation >= 8, &format!("round {round}, operation {operation}"));
        }
    }
    // The solids that all have in common.
    let shapes = [[0, 8], [1, 9], [2, 10], [3, 12]].map(|[low, high]| Shape::cuboid([low; 3], [high; 3]));
    let bodies = shapes.each_ref().map(Shape::body);
    assert_eq!(combined(1, &bodies.each_ref()).volume(), 125.0);
}

/// A sequence of operations, which may also make complements.
#[test]
fn operations_one_after_the_other() {
    let mut random = Random(60);
    let first = random_box(&mut random, 9);
    let (mut cells, mut far, mut body) = (first.cells.clone(), false, first.body());
    let mut most = 0;
    for step in 0..60 {
        let next = random_box(&mut random, 6);
        let operation = match random.below(8) {
            0..3 => 7,
            3..5 => 2,
            5..7 => 6,
            _ => [4, 9, 11, 13, 14, 12][random.below(6) as usize],
        };
        cells = cells.iter().zip(&next.cells).map(|(a, b)| holds(operation, [*a, *b])).collect();
        far = holds(operation, [far, false]);
        body = combined(operation, &[&body, &next.body()]);
        assert_is(&body, &cells, far, &format!("step {step}, operation {operation}"));
        most = most.max(body.bytes.len());
    }
    // No more faces than cell walls.
    assert!(most < 200_000, "{most} bytes");
}
