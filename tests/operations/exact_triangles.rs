//! Triangulated faces: the worked examples of N. A. Tyukachev, and random faces with holes.

use spinney::brep::Faces;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::brep::{FaceList, Triangulated};

use crate::common::exact::{Ring, model, prism};

/// Returns triangles as lists of vertices.
fn triangles(list: &FaceList) -> Vec<[[i32; 3]; 3]> {
    let cut = Triangulated::of(list).unwrap();
    let mut found = Vec::new();
    cut.each(&mut |face| {
        found.push(<[[i32; 3]; 3]>::try_from(face.points).unwrap());
        assert_eq!(face.number + 1, found.len() as u64);
        Ok(())
    })
    .unwrap();
    assert_eq!(cut.len(), found.len() as u64);
    found
}

/// Twice the area of a triangle in the plane z = 0, seen from above.
fn area(corners: &[[i32; 3]; 3]) -> i64 {
    let [a, b, c] = corners.map(|at| at.map(i64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The face 5-6-7 with the triangle 8-9-10 in it becomes seven triangles: 2 * 6 - 2 - 3.
#[test]
fn a_face_around_a_triangle() {
    let outer: Ring = vec![[0, 0, 0], [30, 0, 0], [0, 30, 0]];
    let inner: Ring = vec![[5, 5, 0], [10, 5, 0], [5, 10, 0]];
    let hole: Ring = inner.iter().rev().copied().collect();
    let found = triangles(&model(&[vec![outer, hole], vec![inner.clone()]]));
    assert_eq!(found.len(), 7);
    assert!(found.iter().all(|triangle| area(triangle) > 0));
    assert_eq!(found.iter().map(area).sum::<i64>(), 900);
    // No triangle crosses the inner one: its edges are used from both sides.
    for i in 0..3 {
        let (from, to) = (inner[i], inner[(i + 1) % 3]);
        let has = |edge: [[i32; 3]; 2]| found.iter().any(|t| (0..3).any(|k| [t[k], t[(k + 1) % 3]] == edge));
        assert!(has([from, to]) && has([to, from]));
    }
}

/// The box of sixteen triangles has ten vertices: two faces have one in the middle.
#[test]
fn a_box_of_sixteen_triangles() {
    let ring = vec![[0, 0], [8, 0], [8, 8], [0, 8]];
    let mut faces = prism(&[ring], 0, 8);
    for cap in 0..2 {
        let corners = faces[cap][0].clone();
        let middle = [4, 4, corners[0][2]];
        faces.extend((0..4).map(|i| vec![vec![corners[i], corners[(i + 1) % 4], middle]]));
    }
    let list = model(&faces[2..]);
    let cut = Triangulated::of(&list).unwrap();
    let topology = Topology::of(&cut, &TopologyOptions::default(), &()).unwrap();
    let euler = topology.euler();
    assert_eq!((euler.vertices, euler.edges, euler.faces, euler.boundaries), (10, 24, 16, 0));
    assert_eq!(euler.vertices + euler.faces - euler.edges, 2);
    assert_eq!(topology.six_volumes(0), 6 * 512);
}

/// A square with many square holes: the number of triangles follows from vertices and holes, none
/// is reversed, and the area is preserved.
#[test]
fn a_face_with_many_holes() {
    let square = |x: i32, y: i32, side: i32| -> Ring {
        vec![[x, y, 0], [x + side, y, 0], [x + side, y + side, 0], [x, y + side, 0]]
    };
    let mut rings = vec![square(0, 0, 100)];
    for hole in 0..25 {
        let mut ring = square(4 + hole % 5 * 20, 5 + hole / 5 * 19, 3 + hole % 7);
        ring.reverse();
        rings.push(ring);
    }
    let holes: i64 = (0..25).map(|hole| i64::from(3 + hole % 7).pow(2)).sum();
    let found = triangles(&model(&[rings]));
    assert_eq!(found.len(), 104 + 2 * 25 - 2);
    assert!(found.iter().all(|triangle| area(triangle) > 0));
    assert_eq!(found.iter().map(area).sum::<i64>(), 2 * (10_000 - holes));
}
