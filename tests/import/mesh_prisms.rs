//! Solids made of polygons: boxes and concave prisms with holes, against brute force in the plane.

use spinney::raw::geometry::Triangulator;
use spinney::raw::import::mesh::{InsideTest, MeshFace, Model, SolidReport};

use crate::common::Random;
use crate::common::solid::{Point, Polygon, Polygons, build, cells, unit_cells};

type Ring = Vec<[f64; 2]>;

/// Returns the prism over rings (the outer one counterclockwise, holes clockwise) between two
/// heights along an axis.
fn prism(rings: &[Ring], heights: [f64; 2], axis: usize) -> Vec<Polygon> {
    let point = |[u, v]: [f64; 2], height: f64| -> Point {
        let mut point = [0.0; 3];
        (point[(axis + 1) % 3], point[(axis + 2) % 3], point[axis]) = (u, v, height);
        point
    };
    let face = |rings| Polygon { rings, part: 0, colour: [0; 3] };
    let lid = |height: f64| -> Vec<Vec<Point>> {
        rings.iter().map(|ring| ring.iter().map(|at| point(*at, height)).collect()).collect()
    };
    let turned = |mut lid: Vec<Vec<Point>>| {
        lid.iter_mut().for_each(|ring| ring.reverse());
        lid
    };
    let mut faces = vec![face(turned(lid(heights[0]))), face(lid(heights[1]))];
    for ring in rings {
        for (i, from) in ring.iter().enumerate() {
            let to = ring[(i + 1) % ring.len()];
            let wall = [(*from, heights[0]), (to, heights[0]), (to, heights[1]), (*from, heights[1])];
            faces.push(face(vec![wall.map(|(at, height)| point(at, height)).to_vec()]));
        }
    }
    faces
}

/// Returns whether a point is inside an odd number of rings.
fn is_inside(rings: &[Ring], [u, v]: [f64; 2]) -> bool {
    let crossed = |ring: &Ring| {
        (0..ring.len())
            .filter(|i| {
                let ([a, b], [c, d]) = (ring[*i], ring[(i + 1) % ring.len()]);
                (b > v) != (d > v) && u < a + (v - b) / (d - b) * (c - a)
            })
            .count()
    };
    rings.iter().map(crossed).sum::<usize>() % 2 == 1
}

/// Builds a prism along each axis, in a space of 32 cells, and compares all cells.
fn check(rings: &[Ring], heights: [f64; 2], name: &str) {
    for axis in 0..3 {
        let (tree, SolidReport { inside, repaired, .. }) =
            build(Polygons::of_faces(prism(rings, heights, axis)), &unit_cells(5));
        assert_eq!((inside, repaired), (InsideTest::Closed, 0), "{name}");
        for (i, cell) in cells(&tree).into_iter().enumerate() {
            let at = [i % 32, i / 32 % 32, i / 1024].map(|at| at as f64 + 0.5);
            let expected = (heights[0]..heights[1]).contains(&at[axis])
                && is_inside(rings, [at[(axis + 1) % 3], at[(axis + 2) % 3]]);
            assert_eq!(cell.is_some(), expected, "{name} along axis {axis}: {at:?}");
        }
    }
}

/// A rectangle, counterclockwise.
fn rectangle([a, b]: [f64; 2], [c, d]: [f64; 2]) -> Ring {
    vec![[a, b], [c, b], [c, d], [a, d]]
}

fn hole(mut ring: Ring) -> Ring {
    ring.reverse();
    ring
}

#[test]
fn boxes_have_through_holes() {
    let outer = rectangle([2.0, 3.0], [30.0, 29.0]);
    let one = hole(rectangle([5.0, 6.0], [12.0, 20.0]));
    let two = hole(rectangle([15.25, 6.75], [27.0, 9.0]));
    check(&[outer.clone(), one.clone()], [4.0, 28.0], "one hole on the grid");
    check(&[outer, one, two], [4.25, 27.75], "two holes, one off the grid");
}

#[test]
fn prisms_are_concave_and_have_holes() {
    let star: Ring = (0..14)
        .map(|i| {
            let (angle, radius) = (i as f64 * std::f64::consts::TAU / 14.0 + 0.1, [14.7, 6.1][i % 2]);
            [15.3 + radius * angle.cos(), 15.9 + radius * angle.sin()]
        })
        .collect();
    let triangle = |u: f64, v: f64| hole(vec![[u, v], [u + 3.3, v + 0.4], [u + 1.2, v + 2.9]]);
    check(std::slice::from_ref(&star), [3.3, 20.1], "a star");
    check(
        &[star, triangle(12.1, 12.2), triangle(16.2, 13.1), triangle(14.1, 17.3)],
        [3.3, 20.1],
        "a star with holes",
    );
    let comb: Ring = [[2.2, 2.1], [29.1, 2.3]]
        .into_iter()
        .chain((0..9).rev().flat_map(|i| {
            let u = 2.2 + 3.0 * f64::from(i);
            [[u + 2.1, 28.7], [u + 1.1, 5.3]]
        }))
        .collect();
    check(&[comb], [1.7, 30.9], "a comb");
}

#[test]
fn holes_touch_the_rim_and_each_other() {
    let outer = rectangle([2.0, 2.0], [30.0, 30.0]);
    // With a vertex on the boundary, and on a vertex of another hole.
    let at_rim = hole(vec![[2.0, 16.0], [9.3, 12.1], [9.7, 19.9]]);
    let one = hole(vec![[12.0, 12.2], [18.0, 12.0], [18.0, 18.0]]);
    let two = hole(vec![[18.0, 18.0], [24.0, 18.5], [24.0, 23.8]]);
    check(&[outer.clone(), at_rim.clone()], [5.0, 9.0], "a hole at the rim");
    check(&[outer, at_rim, one, two], [5.0, 9.0], "holes at the rim and each other");
}

#[test]
fn polygons_and_their_triangles_give_the_same_cells() {
    const GRID: f64 = 64.0;
    let mut random = Random(31);
    let mut triangulator = Triangulator::default();
    for _ in 0..20 {
        // A star around a point, with one small hole at it.
        let corners = 5 + random.below(12) as usize;
        let mut ring = |radius: f64| -> Ring {
            (0..corners)
                .map(|i| {
                    let angle = (i as f64 + random.below(900) as f64 / 1000.0) * std::f64::consts::TAU
                        / corners as f64;
                    let radius = radius * (1.0 + random.below(1000) as f64 / 1000.0);
                    [(16.0 + radius * angle.cos()) * GRID, (16.0 + radius * angle.sin()) * GRID]
                        .map(|at| at.round() / GRID)
                })
                .collect()
        };
        let faces = prism(&[ring(8.0), hole(ring(1.1))], [3.25, 21.5], 2);
        let mut triangles = Vec::new();
        for face in &faces {
            // On the grid they are integers.
            let corners: Vec<[i64; 3]> =
                face.rings.concat().into_iter().map(|point| point.map(|at| (at * GRID) as i64)).collect();
            let mut end = 0;
            let ends: Vec<usize> = face
                .rings
                .iter()
                .map(|ring| {
                    end += ring.len();
                    end
                })
                .collect();
            let mut found = Vec::new();
            assert!(triangulator.triangulate(&corners, &ends, &mut found));
            let corner = |corner: u32| corners[corner as usize].map(|at| at as f64 / GRID);
            triangles.extend(found.into_iter().map(|triangle| (triangle.map(corner), 0, [0; 3])));
        }
        let of = |model: Box<dyn Model>| cells(&build(model, &unit_cells(5)).0);
        assert!(of(Polygons::of_faces(faces)) == of(Polygons::of_triangles(triangles)));
    }
}

#[test]
fn faces_are_what_was_given() {
    // The helper above: consecutive rings, with their ends.
    let faces = prism(&[rectangle([0.0; 2], [4.0; 2]), hole(rectangle([1.0; 2], [2.0; 2]))], [0.0, 1.0], 2);
    let mut lids = 0;
    let mut count = |face: &MeshFace<'_>| {
        lids += usize::from(face.ring_ends == [4, 8] && face.points.len() == 8);
        Ok(())
    };
    Polygons::of_faces(faces).faces(&mut count).unwrap();
    assert_eq!(lids, 2);
}
