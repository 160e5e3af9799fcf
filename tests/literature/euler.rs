//! Euler operators, with which the paper's modeller builds solids: a block, and a block with a
//! hole, from one point and back.

use spinney::brep::{Face, Grid};
use spinney::raw::brep::FaceList;
use spinney::raw::brep::topology::{Counts, EulerBody, EulerCorner, Topology, TopologyOptions};

/// Extrudes a ring, given by a half-edge, to the sides of a prism; the ring's face becomes the one
/// at the other end.
fn raise(body: &mut EulerBody, first: u32, by: [i32; 3]) {
    let mut ring = vec![first];
    loop {
        let next = body.next(*ring.last().unwrap()).unwrap();
        if next == first {
            break;
        }
        ring.push(next);
    }
    let mut up = Vec::new();
    for half in &ring {
        let point = body.point(*half).unwrap();
        let moved = [0, 1, 2].map(|axis| point[axis] + by[axis]);
        up.push(body.make_edge_vertex(EulerCorner::Of(*half), moved).unwrap());
    }
    for i in 0..up.len() {
        let to = body.next(up[(i + 1) % up.len()]).unwrap();
        body.make_edge_face(up[i] ^ 1, to).unwrap();
        assert!(body.is_lawful());
    }
}

/// Draws a counterclockwise ring from a corner's vertex through these points. Its inside becomes a
/// new face if `is_inner`, otherwise its outside. Returns a half-edge of the inside.
fn outline(body: &mut EulerBody, start: EulerCorner, points: [[i32; 3]; 3], is_inner: bool) -> u32 {
    let first = body.make_edge_vertex(start, points[0]).unwrap();
    let last = points[1..].iter().fold(first, |last, point| {
        let next = body.next(last).unwrap();
        body.make_edge_vertex(EulerCorner::Of(next), *point).unwrap()
    });
    let end = body.next(last).unwrap();
    match is_inner {
        true => body.make_edge_face(first, end).unwrap() ^ 1,
        false => body.make_edge_face(end, first).unwrap(),
    }
}

/// Returns the topology computed from the faces alone.
fn topology(body: &EulerBody) -> Topology {
    let mut faces = FaceList::new(Grid::over([[0.0; 3], [16.0; 3]], Some(1.0)).unwrap(), vec!["body".into()]);
    for rings in body.faces() {
        let points: Vec<_> = rings.concat();
        let ends: Vec<_> = rings
            .iter()
            .scan(0, |end, ring| {
                *end += ring.len();
                Some(*end)
            })
            .collect();
        let number = 0;
        faces.push(&Face { number, points: &points, ring_ends: &ends, colours: &[], part: 0, source: 0 });
    }
    Topology::of(&faces, &TopologyOptions::default(), &()).unwrap()
}

/// Returns its counts.
fn found(body: &EulerBody) -> (Counts, u64) {
    let topology = topology(body);
    assert!(topology.is_closed());
    let euler = topology.euler();
    let counts = Counts {
        vertices: euler.vertices,
        edges: euler.edges,
        faces: euler.faces,
        rings: euler.rings,
        boundaries: 0,
    };
    (counts, euler.genus.unwrap())
}

/// Makes a block. Returns half-edges of its upper and its lower face.
fn block(body: &mut EulerBody) -> [u32; 2] {
    let (_, ring) = body.make_solid([0, 0, 0]);
    let first = outline(body, EulerCorner::Lone(ring), [[8, 0, 0], [8, 8, 0], [0, 8, 0]], false);
    raise(body, first, [0, 0, 4]);
    // Via the adjacent side.
    let side = body.next(body.next(first).unwrap()).unwrap();
    [side ^ 1, first ^ 1]
}

/// Returns the rings of all faces, independent of their starts.
fn rings(body: &EulerBody) -> Vec<Vec<Vec<[i32; 3]>>> {
    let mut faces = body.faces();
    for ring in faces.iter_mut().flatten() {
        let least = (0..ring.len()).min_by_key(|i| ring[*i]).unwrap();
        ring.rotate_left(least);
    }
    faces
}

/// Undoes all operations and counts them.
fn undo(body: &mut EulerBody) -> u64 {
    let mut steps = 0;
    while body.undo() {
        steps += 1;
        assert!(body.is_lawful());
    }
    assert_eq!((body.counts(), body.shells(), body.handles()), (Counts::default(), 0, 0));
    assert!(body.faces().is_empty());
    steps
}

#[test]
fn item_59_a_block_by_euler_operators() {
    let mut body = EulerBody::default();
    block(&mut body);
    let counts = body.counts();
    assert_eq!((counts.vertices, counts.edges, counts.faces, counts.rings), (8, 12, 6, 0));
    assert_eq!(found(&body), (counts, 0));
    // One per edge, with a vertex or a face, and the initial one.
    assert_eq!(undo(&mut body), 1 + 12);
}

/// The Ukrainian paper's row of an edge: both ends, the faces to its left and right, and the
/// previous and next edges in these, which are traversed clockwise there.
#[test]
fn item_63_the_winged_edge_row() {
    let mut body = EulerBody::default();
    block(&mut body);
    let found = topology(&body);
    let faces = body.faces();
    let ends = |half: u32| [found.origin(half), found.target(half)].map(|vertex| found.point(vertex));
    // The next and the previous edge of an edge in a clockwise traversal of a face.
    let neighbours = |from: [i32; 3], to: [i32; 3]| {
        let clockwise = |rings: &Vec<Vec<[i32; 3]>>| rings[0].iter().rev().copied().collect::<Vec<_>>();
        let ring = faces
            .iter()
            .map(clockwise)
            .find(|ring| (0..ring.len()).any(|i| [ring[i], ring[(i + 1) % ring.len()]] == [from, to]));
        let ring = ring.unwrap();
        let at = ring.iter().position(|point| *point == from).unwrap();
        [ring[(at + 3) % 4], ring[(at + 2) % 4]]
    };
    for half in 0..found.half_edges() {
        let (twin, [x, y]) = (found.twin(half).unwrap(), ends(half));
        assert_eq!(ends(twin), [y, x]);
        // In the left face, the edge is traversed from Y to X.
        for (side, from, to) in [(half, y, x), (twin, x, y)] {
            let [before, after] = neighbours(from, to);
            assert_eq!(ends(found.next(side)), [from, before]);
            assert_eq!(ends(found.previous(side)), [after, to]);
        }
        assert_ne!(found.face(half), found.face(twin));
        assert_eq!(found.edge(half), found.edge(twin));
    }
}

/// The paper's solid with a hole: a ring on the upper face is sunk to the lower one, where its
/// floor becomes a hole.
#[test]
fn item_63_a_block_with_a_hole_by_euler_operators() {
    let mut body = EulerBody::default();
    let [top, bottom] = block(&mut body);
    let strut = body.make_edge_vertex(EulerCorner::Of(top), [2, 3, 4]).unwrap();
    let inside = outline(&mut body, EulerCorner::Of(strut ^ 1), [[6, 3, 4], [6, 5, 4], [2, 5, 4]], true);
    let ring = body.kill_edge_make_ring(strut).unwrap();
    assert_eq!(body.ring(inside ^ 1).unwrap(), ring);
    assert_eq!(found(&body), (body.counts(), 0));
    let floor = body.face(inside).unwrap();
    raise(&mut body, inside, [0, 0, -4]);
    let before = rings(&body);
    body.kill_face_make_ring(body.face(bottom).unwrap(), floor).unwrap();
    let counts = body.counts();
    assert_eq!((counts.vertices, counts.edges, counts.faces, counts.rings), (16, 24, 10, 2));
    assert_eq!((body.shells(), body.handles()), (1, 1));
    assert_eq!(found(&body), (counts, 1));
    // Undo and redo.
    assert!(body.undo());
    assert_eq!((rings(&body), body.handles()), (before, 0));
    body.kill_face_make_ring(body.face(bottom).unwrap(), floor).unwrap();
    // 24 edges with a vertex or a face each, one killed edge, the initial operation, and the
    // handle.
    assert_eq!(undo(&mut body), 24 + 2 + 1 + 1);
}

/// Each operator and its inverse, called directly.
#[test]
fn item_63_operators_have_inverses() {
    let mut body = EulerBody::default();
    let [top, _] = block(&mut body);
    let (whole, counts) = (rings(&body), body.counts());
    // mev, kev.
    let strut = body.make_edge_vertex(EulerCorner::Of(top), [2, 3, 4]).unwrap();
    body.kill_edge_vertex(strut).unwrap();
    assert_eq!(rings(&body), whole);
    // mef, kef: a diagonal.
    let across = body.next(body.next(top).unwrap()).unwrap();
    let diagonal = body.make_edge_face(top, across).unwrap();
    assert_eq!(body.counts().faces, counts.faces + 1);
    body.kill_edge_face(diagonal).unwrap();
    assert_eq!((body.counts(), rings(&body)), (counts, whole));
    // kemr, mekr: an isolated point in a face.
    let strut = body.make_edge_vertex(EulerCorner::Of(top), [2, 3, 4]).unwrap();
    let ring = body.kill_edge_make_ring(strut).unwrap();
    assert_eq!((body.counts().rings, body.shells()), (1, 1));
    body.make_edge_kill_ring(EulerCorner::Of(top), EulerCorner::Lone(ring)).unwrap();
    assert_eq!((body.counts().rings, body.is_lawful()), (0, true));
    // kfmrh of two solids: one shell, which is split again.
    let before = body.counts();
    let (face, _) = body.make_solid([20, 0, 0]);
    let own = body.face(top).unwrap();
    body.kill_face_make_ring(own, face).unwrap();
    assert_eq!((body.shells(), body.handles(), body.is_lawful()), (1, 0, true));
    assert!(body.undo() && body.shells() == 2 && body.undo());
    assert_eq!((body.shells(), body.counts()), (1, before));
    undo(&mut body);
}

#[test]
fn item_63_what_operators_refuse() {
    let mut body = EulerBody::default();
    let [top, bottom] = block(&mut body);
    let counts = body.counts();
    assert!(body.make_edge_vertex(EulerCorner::Of(999), [0; 3]).is_err());
    assert!(body.make_edge_vertex(EulerCorner::Lone(0), [0; 3]).is_err());
    assert!(body.make_edge_face(top, bottom).is_err() && body.make_edge_face(top, top).is_err());
    assert!(body.kill_edge_vertex(top).is_err() && body.kill_edge_make_ring(top).is_err());
    let face = body.face(top).unwrap();
    assert!(body.kill_face_make_ring(face, face).is_err() && body.kill_face_make_ring(face, 99).is_err());
    assert!(body.make_edge_kill_ring(EulerCorner::Of(top), EulerCorner::Of(bottom)).is_err());
    assert_eq!(body.counts(), counts);
}
