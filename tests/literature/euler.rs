//! Euler operators, with which the paper's modeller builds solids: a block, and a block with a
//! hole, from one point and back.

use std::collections::{BTreeMap, BTreeSet};

use crate::common::Random;
use spinney::brep::{Face, Grid};
use spinney::raw::brep::FaceList;
use spinney::raw::brep::euler::{EulerBody, EulerCorner, EulerText, TextLimits};
use spinney::raw::brep::topology::{Counts, Topology, TopologyOptions};

fn at(point: [i32; 3]) -> [f64; 3] {
    point.map(f64::from)
}

/// Returns the rings of all faces on the grid.
fn grid_faces(body: &EulerBody) -> Vec<Vec<Vec<[i32; 3]>>> {
    let ring = |ring: Vec<[f64; 3]>| ring.into_iter().map(|point| point.map(|at| at as i32)).collect();
    body.faces().into_iter().map(|rings| rings.into_iter().map(ring).collect()).collect()
}

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
        let moved = [0, 1, 2].map(|axis| point[axis] + f64::from(by[axis]));
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
    let first = body.make_edge_vertex(start, at(points[0])).unwrap();
    let last = points[1..].iter().fold(first, |last, point| {
        let next = body.next(last).unwrap();
        body.make_edge_vertex(EulerCorner::Of(next), at(*point)).unwrap()
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
    for rings in grid_faces(body) {
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
    let (_, ring) = body.make_solid([0.0; 3]).unwrap();
    let first = outline(body, EulerCorner::Lone(ring), [[8, 0, 0], [8, 8, 0], [0, 8, 0]], false);
    raise(body, first, [0, 0, 4]);
    // Via the adjacent side.
    let side = body.next(body.next(first).unwrap()).unwrap();
    [side ^ 1, first ^ 1]
}

/// Returns the rings of all faces, independent of their starts.
fn rings(body: &EulerBody) -> Vec<Vec<Vec<[i32; 3]>>> {
    let mut faces = grid_faces(body);
    for ring in faces.iter_mut().flatten() {
        let rotated = |by: usize| ring[by..].iter().chain(&ring[..by]);
        let least = (0..ring.len()).min_by(|a, b| rotated(*a).cmp(rotated(*b))).unwrap();
        ring.rotate_left(least);
    }
    faces
}

/// Undoes all operations and counts them.
fn undo(body: &mut EulerBody) -> u64 {
    let mut steps = 0;
    while body.undo().unwrap() {
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
    let faces = grid_faces(&body);
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
    let strut = body.make_edge_vertex(EulerCorner::Of(top), [2.0, 3.0, 4.0]).unwrap();
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
    assert!(body.undo().unwrap());
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
    let strut = body.make_edge_vertex(EulerCorner::Of(top), [2.0, 3.0, 4.0]).unwrap();
    body.kill_edge_vertex(strut).unwrap();
    assert_eq!(rings(&body), whole);
    // mef, kef: a diagonal.
    let across = body.next(body.next(top).unwrap()).unwrap();
    let diagonal = body.make_edge_face(top, across).unwrap();
    assert_eq!(body.counts().faces, counts.faces + 1);
    body.kill_edge_face(diagonal).unwrap();
    assert_eq!((body.counts(), rings(&body)), (counts, whole));
    // kemr, mekr: an isolated point in a face.
    let strut = body.make_edge_vertex(EulerCorner::Of(top), [2.0, 3.0, 4.0]).unwrap();
    let ring = body.kill_edge_make_ring(strut).unwrap();
    assert_eq!((body.counts().rings, body.shells()), (1, 1));
    body.make_edge_kill_ring(EulerCorner::Of(top), EulerCorner::Lone(ring)).unwrap();
    assert_eq!((body.counts().rings, body.is_lawful()), (0, true));
    // kfmrh of two solids: one shell, which is split again.
    let before = body.counts();
    let (face, _) = body.make_solid([20.0, 0.0, 0.0]).unwrap();
    let own = body.face(top).unwrap();
    assert!(body.kill_face_make_ring(own, face).is_err());
    body.kill_shell_face_make_ring(own, face).unwrap();
    assert_eq!((body.shells(), body.handles(), body.is_lawful()), (1, 0, true));
    assert!(body.undo().unwrap() && body.shells() == 2 && body.undo().unwrap());
    assert_eq!((body.shells(), body.counts()), (1, before));
    undo(&mut body);
}

#[test]
fn item_63_what_operators_refuse() {
    let mut body = EulerBody::default();
    let [top, bottom] = block(&mut body);
    let counts = body.counts();
    assert!(body.make_edge_vertex(EulerCorner::Of(999), [0.0; 3]).is_err());
    assert!(body.make_edge_vertex(EulerCorner::Lone(0), [0.0; 3]).is_err());
    assert!(body.make_edge_face(top, bottom).is_err() && body.make_edge_face(top, top).is_err());
    assert!(body.kill_edge_make_ring(top).is_err() && body.join_edges(top).is_err());
    assert!(body.kill_solid(body.face(top).unwrap()).is_err() && body.make_face_kill_ring(0).is_err());
    assert!(body.split_vertex(top, bottom, [0.0; 3]).is_err() && body.make_solid([f64::NAN; 3]).is_err());
    // An edge whose vertices have another common edge.
    let double = body.make_edge_face(top, body.next(top).unwrap()).unwrap();
    assert!(body.kill_edge_vertex(double).is_err() && body.kill_edge_vertex(top).is_err());
    assert!(body.undo().unwrap());
    let face = body.face(top).unwrap();
    assert!(body.kill_face_make_ring(face, face).is_err() && body.kill_face_make_ring(face, 99).is_err());
    assert!(body.make_edge_kill_ring(EulerCorner::Of(top), EulerCorner::Of(bottom)).is_err());
    assert_eq!(body.counts(), counts);
}

/// Returns the body that a text of operators builds.
fn built(text: &str) -> EulerBody {
    let limits = TextLimits { memory: 1 << 24, path: "body.euler".into() };
    let mut body = EulerText::default();
    body.apply(text.as_bytes(), &limits, &mut |_, line, body| assert!(body.is_lawful(), "{line}")).unwrap();
    body.check_rings(&limits.path).unwrap();
    body.body().clone()
}

/// Counts, shells, handles and six volumes of a body, from the operators and from its faces alone.
fn check_body(text: &str, expected: [u64; 6], volume: i128) {
    let body = built(text);
    let counts = body.counts();
    let of_operators =
        [counts.vertices, counts.edges, counts.faces, counts.rings, body.shells(), body.handles()];
    assert_eq!(of_operators, expected);
    assert_eq!(found(&body), (counts, expected[5]));
    let topology = topology(&body);
    assert_eq!(u64::from(topology.shells()), expected[4]);
    assert_eq!(topology.six_volumes(0), 6 * volume);
}

/// Figure 26 of the paper on boundaries and octrees: a body with a hole through it.
#[test]
fn item_53_a_body_with_a_hole() {
    let (block, hole) = ((80 * 60 * 40), (40 * 20 * 40));
    check_body(include_str!("../../fixtures/hole.euler"), [16, 24, 10, 2, 1, 1], block - hole);
}

/// Figure 27: a concave body.
#[test]
fn item_53_a_concave_body() {
    check_body(include_str!("../../fixtures/concave.euler"), [12, 18, 8, 0, 1, 0], (80 * 30 + 30 * 30) * 40);
}

/// Counts a body by its rings alone, whose vertices have different points: vertices, edges, faces,
/// rings and shells. A point identifies a vertex.
fn recount(body: &EulerBody) -> [u64; 5] {
    let faces = grid_faces(body);
    let mut shell_of: BTreeMap<[i32; 3], usize> = BTreeMap::new();
    let mut shells: Vec<BTreeSet<[i32; 3]>> = Vec::new();
    let (mut sides, mut rings) = (0, 0);
    for face in &faces {
        rings += face.len() - 1;
        let points: BTreeSet<[i32; 3]> = face.iter().flatten().copied().collect();
        sides += face.iter().map(|ring| if ring.len() > 1 { ring.len() } else { 0 }).sum::<usize>();
        let touched: BTreeSet<usize> =
            points.iter().filter_map(|point| shell_of.get(point).copied()).collect();
        let all = touched.iter().fold(points, |all, shell| &all | &std::mem::take(&mut shells[*shell]));
        shell_of.extend(all.iter().map(|point| (*point, shells.len())));
        shells.push(all);
    }
    let shells = shells.iter().filter(|shell| !shell.is_empty()).count();
    [shell_of.len(), sides / 2, faces.len(), rings, shells].map(|count| count as u64)
}

/// Random operators with random arguments: those that are not refused keep the formula, as a count
/// of the rings alone confirms, and undoing restores each state.
#[test]
fn item_63_random_operators_keep_the_formula() {
    for seed in 0..12 {
        let mut random = Random(seed);
        let mut number = |below: u64| (random.next() % below) as u32;
        let mut body = EulerBody::default();
        let mut states = Vec::new();
        let mut used = [0u64; 15];
        let mut points = 0;
        for _ in 0..600 {
            points += 1;
            let point = [f64::from(points), f64::from(number(100)), 0.0];
            let range = 2 * body.counts().edges + 8;
            let [a, b] = [number(range), number(range)];
            let corner = |at: u32, is_lone: bool| {
                if is_lone { EulerCorner::Lone(at / 4) } else { EulerCorner::Of(at) }
            };
            let (from, to) = (corner(a, number(3) == 0), corner(b, number(3) == 0));
            // (Corners of one vertex or ring are rare among random ones.)
            let near = (0..number(4)).try_fold(a, |at, _| body.next(at)).unwrap_or(b);
            let other_corner = body.next(a ^ 1).unwrap_or(b);
            let before = rings(&body);
            let operator = number(15) as usize;
            let done = match operator {
                0 if body.shells() < 4 => body.make_solid(point).is_ok(),
                0 => false,
                1 => body.kill_solid(a / 4).is_ok(),
                2 => body.make_edge_vertex(from, point).is_ok(),
                3 => body.split_vertex(a, other_corner, point).is_ok(),
                4 => body.kill_edge_vertex(a).is_ok(),
                5 | 14 => body.make_edge_face(a, near).is_ok(),
                6 => body.kill_edge_face(a).is_ok(),
                7 => body.kill_edge_make_ring(a).is_ok(),
                8 => body.make_edge_kill_ring(from, to).is_ok(),
                9 => body.kill_face_make_ring(a / 4, b / 4).is_ok(),
                10 => body.kill_shell_face_make_ring(a / 4, b / 4).is_ok(),
                11 => match number(2) {
                    0 => body.make_face_kill_ring(a / 4).is_ok(),
                    _ => body.make_shell_face_kill_ring(a / 4).is_ok(),
                },
                12 => match number(2) {
                    0 => body.split_edge(a, point).is_ok(),
                    _ => body.join_edges(a).is_ok(),
                },
                _ => body.move_ring(a / 4, b / 4).is_ok(),
            };
            let counts = body.counts();
            let Counts { vertices, edges, faces, rings: inner, .. } = counts;
            assert!(body.is_lawful());
            assert_eq!(recount(&body), [vertices, edges, faces, inner, body.shells()]);
            if done {
                used[operator] += 1;
                states.push(before);
            } else {
                assert_eq!(rings(&body), before);
            }
        }
        assert!(used.iter().filter(|count| **count > 0).count() > 9, "{used:?}");
        // (Rings that were killed come back as the last of their faces.)
        let sorted = |mut faces: Vec<Vec<Vec<[i32; 3]>>>| {
            faces.iter_mut().for_each(|rings| rings[1..].sort());
            faces
        };
        while let Some(state) = states.pop() {
            assert!(body.undo().unwrap());
            assert_eq!(sorted(rings(&body)), sorted(state));
        }
        assert!(!body.undo().unwrap());
        assert_eq!((body.counts(), body.shells(), body.handles()), (Counts::default(), 0, 0));
    }
}
