//! Topology of exact models, against known counts and a naive model.

use std::collections::{HashMap, HashSet};

use spinney::brep::Faces;
use spinney::raw::brep::FaceList;
use spinney::raw::brep::topology::{Counts, Topology, TopologyOptions};
use spinney::{Error, Progress};

use crate::common::exact::{Ring, cuboid, model, prism, snapped, turned};
use crate::common::{Random, shared_data};

fn topology(faces: &dyn Faces) -> Topology {
    let made = Topology::of(faces, &TopologyOptions::default(), &()).unwrap();
    check(&made, faces);
    made
}

/// Checks the invariants of every topology.
fn check(made: &Topology, faces: &dyn Faces) {
    assert_eq!(u64::from(made.faces()), faces.len());
    let mut number = 0;
    let each = &mut |face: &spinney::brep::Face<'_>| {
        let mut corners: Vec<_> = made.vertices_of_face(number).map(|vertex| made.point(vertex)).collect();
        let mut expected = face.points.to_vec();
        corners.sort_unstable();
        expected.sort_unstable();
        assert_eq!(corners, expected);
        number += 1;
        Ok(())
    };
    faces.each(each).unwrap();
    let mut passed = vec![0; made.edges() as usize];
    for half_edge in 0..made.half_edges() {
        assert_eq!(made.previous(made.next(half_edge)), half_edge);
        assert_eq!(made.ring(made.next(half_edge)), made.ring(half_edge));
        assert!(made.half_edges_of_ring(made.ring(half_edge)).contains(&half_edge));
        passed[made.edge(half_edge) as usize] += 1;
        if let Some(twin) = made.twin(half_edge) {
            assert_eq!(made.twin(twin), Some(half_edge));
            assert_eq!(
                (made.origin(twin), made.target(twin)),
                (made.target(half_edge), made.origin(half_edge))
            );
            assert_eq!(made.shell_of_face(made.face(twin)), made.shell_of_face(made.face(half_edge)));
        }
    }
    for face in 0..made.faces() {
        let rings = made.rings_of_face(face);
        assert!(rings.clone().all(|ring| made.face_of_ring(ring) == face));
        let by_rings = rings.map(|ring| made.half_edges_of_ring(ring).count()).sum::<usize>();
        assert_eq!(made.half_edges_of_face(face).len(), by_rings);
        let edges = made.half_edges_of_face(face).map(|half_edge| made.edge(half_edge));
        assert!(made.edges_of_face(face).eq(edges));
    }
    for edge in 0..made.edges() {
        let (first, other) = made.half_edges_of_edge(edge);
        assert_eq!(made.vertices_of_edge(edge), [made.origin(first), made.target(first)]);
        assert_eq!(passed[edge as usize], if other.is_some() { 2 } else { 1 });
    }
    // Every half-edge is in one fan, and every fan's edges are those of its half-edges.
    let mut seen = HashSet::new();
    for vertex in 0..made.vertices() {
        for half_edge in made.half_edges_of_vertex(vertex) {
            assert_eq!(made.origin(half_edge), vertex);
            assert!(seen.insert(half_edge));
        }
        let edges: Vec<u32> = made.edges_of_vertex(vertex).collect();
        let (fan, open) = (made.faces_of_vertex(vertex).count(), made.neighbours_of_vertex(vertex).count());
        assert!(edges.len() == open && (open == fan || open == fan + 1));
        assert!(made.vertices_at(made.point(vertex)).contains(&vertex));
    }
    assert_eq!(seen.len(), made.half_edges() as usize);
    // Entities by shell are all entities, each once.
    let (mut all, mut vertices, mut edges) = (0, HashSet::new(), HashSet::new());
    for shell in 0..made.shells() {
        all += made.faces_of_shell(shell).len();
        made.faces_of_shell(shell).iter().for_each(|face| assert_eq!(made.shell_of_face(*face), shell));
        made.vertices_of_shell(shell).for_each(|vertex| assert!(vertices.insert(vertex)));
        made.vertices_of_shell(shell).for_each(|vertex| assert_eq!(made.shell_of_vertex(vertex), shell));
        let of_faces = made.faces_of_shell(shell).iter().map(|face| made.half_edges_of_face(*face).len());
        assert_eq!(made.half_edges_of_shell(shell).count(), of_faces.sum::<usize>());
        made.edges_of_shell(shell).for_each(|edge| assert!(edges.insert(edge)));
    }
    assert_eq!(all, made.faces() as usize);
    assert_eq!((vertices.len(), edges.len()), (made.vertices() as usize, made.edges() as usize));
    let lone = (0..made.half_edges()).filter(|half_edge| made.twin(*half_edge).is_none()).count();
    let chains: Vec<Vec<u32>> = made.boundaries().collect();
    assert_eq!(chains.iter().map(Vec::len).sum::<usize>(), lone);
    for chain in &chains {
        for (i, half_edge) in chain.iter().enumerate() {
            assert_eq!(made.target(*half_edge), made.origin(chain[(i + 1) % chain.len()]));
        }
    }
    assert_eq!(made.is_closed(), lone == 0);
    assert!(made.euler().genus.is_some(), "{:?}", made.counts_by_shell());
}

/// V, E, F, R, S, G of a closed model.
fn euler(faces: &FaceList) -> [u64; 6] {
    let made = topology(faces);
    assert!(made.check_closed("model".as_ref()).is_ok());
    let euler = made.euler();
    [euler.vertices, euler.edges, euler.faces, euler.rings, euler.shells, euler.genus.unwrap()]
}

#[test]
fn a_cube() {
    let cube = model(&cuboid([0; 3], [4; 3]));
    assert_eq!(euler(&cube), [8, 12, 6, 0, 1, 0]);
    let made = topology(&cube);
    let top: HashSet<u32> = made.neighbours_of_face(0).collect();
    assert_eq!(top, HashSet::from([2, 3, 4, 5]));
    let corner = made.vertices_at([0, 0, 0]);
    assert_eq!(corner.len(), 1);
    assert_eq!(made.neighbours_of_vertex(corner.start).count(), 3);
    assert!(made.vertices_at([1, 0, 0]).is_empty());
    let (left, right) = made.faces_of_edge(0);
    assert_ne!(Some(left), right);
}

fn square(min: i32, max: i32) -> Vec<[i32; 2]> {
    vec![[min, min], [max, min], [max, max], [min, max]]
}

fn reversed(mut ring: Vec<[i32; 2]>) -> Vec<[i32; 2]> {
    ring.reverse();
    ring
}

#[test]
fn holes_through_a_cube() {
    let one = prism(&[square(0, 9), reversed(square(3, 6))], 0, 9);
    assert_eq!(euler(&model(&one)), [16, 24, 10, 2, 1, 1]);
    let two = prism(&[square(0, 9), reversed(square(1, 4)), reversed(square(5, 8))], 0, 9);
    assert_eq!(euler(&model(&two)), [24, 36, 14, 4, 1, 2]);
}

#[test]
fn a_cavity_is_a_shell() {
    let mut faces = cuboid([0; 3], [9; 3]);
    faces.extend(turned(cuboid([3; 3], [6; 3])));
    assert_eq!(euler(&model(&faces)), [16, 24, 12, 0, 2, 0]);
    let made = topology(&model(&faces));
    assert_eq!([0, 1].map(|shell| made.six_volumes(shell)), [6 * 729, -6 * 27]);
}

#[test]
fn cubes_that_touch_stay_apart() {
    for (at, shared) in [([4, 4, 0], "edge"), ([4, 4, 4], "corner"), ([4, 0, 0], "face")] {
        let mut faces = cuboid([0; 3], [4; 3]);
        faces.extend(cuboid(at, at.map(|x| x + 4)));
        assert_eq!(euler(&model(&faces)), [16, 24, 12, 0, 2, 0], "{shared}");
        // In any order, and from inside: cavities that touch in an edge are one.
        faces.rotate_left(5);
        faces.swap(1, 7);
        assert_eq!(euler(&model(&faces))[4..], [2, 0], "{shared}");
    }
    // All four around an edge, and all eight around a corner.
    let mut faces = Vec::new();
    for corner in 0..8 {
        let at = [0, 1, 2].map(|axis| 4 * (corner >> axis & 1));
        faces.extend(cuboid(at, at.map(|x| x + 4)));
        let made = euler(&model(&faces));
        assert_eq!(made[4..], [corner as u64 + 1, 0]);
    }
}

/// If two cavities touch along an edge, the solid continues between them: they are one.
#[test]
fn cavities_that_touch_join() {
    let mut faces = cuboid([0; 3], [20; 3]);
    faces.extend(turned(cuboid([4; 3], [8; 3])));
    faces.extend(turned(cuboid([8, 8, 4], [12, 12, 8])));
    // The two have 8 vertices and 12 edges each; the common edge remains two edges over four
    // vertices, each of which joins both.
    let made = topology(&model(&faces));
    assert_eq!(made.shells(), 2);
    assert!(made.is_closed());
    assert_eq!(made.vertices_at([8, 8, 4]).len(), 1);
}

#[test]
fn tilted_cubes_stay_apart_along_an_edge() {
    // Six prisms like slices of a cake, for any direction of the edge.
    let around = [[9, 1], [2, 9], [-8, 5], [-9, -4], [1, -9], [8, -7]];
    for up in [[0, 0, 5], [7, 1, 3], [-2, 8, -7], [-9, -9, 1]] {
        let mut faces = Vec::new();
        for i in 0..6 {
            let [[a, b], [c, d]] = [around[i], around[(i + 1) % 6]];
            // Two vectors that form a right-handed skew basis with `up`.
            let (u, v) =
                if up[2] > 0 && up[0] >= 0 { ([1, 0, 0], [0, 1, 0]) } else { ([0, 0, 1], [1, 0, 0]) };
            let is_right = determinant(u, v, up) > 0;
            let at = |x: i32, y: i32, z: i32| -> [i32; 3] {
                [0, 1, 2].map(|axis| 100 + x * u[axis] + y * v[axis] + z * up[axis])
            };
            let [o, p, q] = [[0, 0], [a, b], [c, d]].map(|[x, y]| [at(x, y, 0), at(x, y, 1)]);
            let mut slice: Vec<Vec<Ring>> = vec![
                vec![vec![q[0], p[0], o[0]]],
                vec![vec![o[1], p[1], q[1]]],
                vec![vec![o[0], p[0], p[1], o[1]]],
                vec![vec![p[0], q[0], q[1], p[1]]],
                vec![vec![q[0], o[0], o[1], q[1]]],
            ];
            if !is_right {
                slice = turned(slice);
            }
            faces.extend(slice);
            assert_eq!(euler(&model(&faces))[4..], [i as u64 + 1, 0], "{up:?}");
        }
    }
}

fn determinant(a: [i32; 3], b: [i32; 3], c: [i32; 3]) -> i32 {
    (0..3).map(|i| a[i] * (b[(i + 1) % 3] * c[(i + 2) % 3] - b[(i + 2) % 3] * c[(i + 1) % 3])).sum()
}

/// A hole that touches the outline along the whole height: the solid is a ring that is cut there.
#[test]
fn a_hole_through_a_corner_opens_the_ring() {
    let hole = vec![[0, 0], [4, 8], [8, 4]];
    let made = euler(&model(&prism(&[square(0, 12), hole], 0, 5)));
    assert_eq!(made, [14, 21, 9, 0, 1, 0]);
}

#[test]
fn boundaries_of_open_surfaces_are_listed() {
    let mut faces = cuboid([0; 3], [4; 3]);
    faces.remove(0);
    let made = topology(&model(&faces));
    let chains: Vec<Vec<u32>> = made.boundaries().collect();
    assert_eq!(chains.len(), 1);
    let points: HashSet<[i32; 3]> = chains[0].iter().map(|&at| made.point(made.origin(at))).collect();
    assert_eq!(points, HashSet::from([[0, 0, 4], [4, 0, 4], [4, 4, 4], [0, 4, 4]]));
    let error = made.check_closed("box.brep".as_ref()).unwrap_err().to_string();
    assert!(error.contains("box.brep") && error.contains("4 edges") && error.contains("1 chains"), "{error}");
    assert_eq!(made.counts_by_shell()[0].genus(), Some(0));
    // A reversed face is a separate shell.
    let mut faces = cuboid([0; 3], [4; 3]);
    faces[3][0].reverse();
    let made = topology(&model(&faces));
    assert_eq!((made.shells(), made.boundaries().count()), (2, 2));
}

/// A triangle without area between a long edge and two short ones closes a surface, also along an
/// edge of two solids.
#[test]
fn slivers_take_part() {
    let with_sliver = |mut faces: Vec<Vec<Ring>>, a: [i32; 3], b: [i32; 3], c: [i32; 3]| {
        // The face with the edge from a to c gets b between them; a sliver leads back.
        let (ring, at) = faces
            .iter_mut()
            .flatten()
            .find_map(|ring| {
                let at = (0..ring.len()).find(|&i| ring[i] == a && ring[(i + 1) % ring.len()] == c)?;
                Some((ring, at))
            })
            .unwrap();
        ring.insert(at + 1, b);
        faces.push(vec![vec![a, c, b]]);
        faces
    };
    // The half-edge from a to c is that of the long side's twin.
    let cube = with_sliver(cuboid([0; 3], [4; 3]), [4, 4, 0], [4, 4, 1], [4, 4, 4]);
    assert_eq!(euler(&model(&cube)), [9, 14, 7, 0, 1, 0]);
    for swapped in [false, true] {
        let ends = if swapped { [[4, 4, 4], [4, 4, 0]] } else { [[4, 4, 0], [4, 4, 4]] };
        let mut faces = with_sliver(cuboid([0; 3], [4; 3]), ends[0], [4, 4, 1], ends[1]);
        faces.extend(cuboid([4, 4, 0], [8, 8, 4]));
        assert_eq!(euler(&model(&faces))[4..], [2, 0]);
        faces.rotate_right(6);
        assert_eq!(euler(&model(&faces))[4..], [2, 0]);
    }
}

/// Random sets of cells of a grid: a naive model finds the face-connected solids.
#[test]
fn unions_of_cells() {
    let mut random = Random(5);
    for round in 0..60 {
        let side = 2 + round % 3;
        let cells: HashSet<[i32; 3]> = (0..side * side * side)
            .map(|n| [n % side, n / side % side, n / side / side])
            .filter(|_| random.below(100) < 45)
            .collect();
        if cells.is_empty() {
            continue;
        }
        // Squares between solid cells and empty ones.
        let mut faces = Vec::new();
        for &cell in &cells {
            let walls = cuboid(cell, cell.map(|x| x + 1));
            let offsets = [[0, 0, 1], [0, 0, -1], [0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]];
            for (wall, by) in walls.into_iter().zip(offsets) {
                if !cells.contains(&[0, 1, 2].map(|axis| cell[axis] + by[axis])) {
                    faces.push(wall);
                }
            }
        }
        let made = topology(&model(&faces));
        assert!(made.is_closed());
        // Shells never mix walls of cells that are not face-connected.
        let bodies = bodies(&cells);
        let mut body_of_shell = HashMap::new();
        let mut number = 0;
        for &cell in &cells {
            for by in [[0, 0, 1], [0, 0, -1], [0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]] {
                if !cells.contains(&[0, 1, 2].map(|axis| cell[axis] + by[axis])) {
                    let shell = made.shell_of_face(number);
                    assert_eq!(*body_of_shell.entry(shell).or_insert(bodies[&cell]), bodies[&cell]);
                    number += 1;
                }
            }
        }
        let count = bodies.values().collect::<HashSet<_>>().len();
        assert!(body_of_shell.len() >= count);
    }
}

/// Assigns one number to each face-connected set of cells.
fn bodies(cells: &HashSet<[i32; 3]>) -> HashMap<[i32; 3], usize> {
    let mut bodies = HashMap::new();
    for (number, &first) in cells.iter().enumerate() {
        let mut pending = vec![first];
        while let Some(cell) = pending.pop() {
            if !cells.contains(&cell) || bodies.contains_key(&cell) {
                continue;
            }
            bodies.insert(cell, number);
            for axis in 0..3 {
                for by in [-1, 1] {
                    let mut offsets = cell;
                    offsets[axis] += by;
                    pending.push(offsets);
                }
            }
        }
    }
    bodies
}

#[test]
fn invalid_rings_are_harmless() {
    let rings: [&[Ring]; 6] = [
        &[],
        &[vec![[1, 1, 1]]],
        &[vec![[1, 1, 1], [1, 1, 1], [2, 2, 2]]],
        &[vec![[1, 1, 1], [2, 2, 2]]],
        &[vec![[0, 0, 0], [4, 4, 0], [4, 0, 0], [0, 4, 0]]],
        &[vec![[0, 0, 0], [4, 4, 0], [0, 0, 0], [4, 4, 9], [4, 4, 0]], vec![], vec![[4, 4, 0], [0, 0, 0]]],
    ];
    let mut random = Random(3);
    for _ in 0..200 {
        let faces: Vec<Vec<Ring>> = (0..12).map(|_| rings[random.below(6) as usize].to_vec()).collect();
        let made = Topology::of(&model(&faces), &TopologyOptions::default(), &()).unwrap();
        made.euler();
        made.boundaries().for_each(drop);
    }
    // Random triangles over few points: everything touches.
    for _ in 0..300 {
        let mut point = || [0; 3].map(|_: i32| random.below(3) as i32);
        let faces: Vec<Vec<Ring>> = (0..60).map(|_| vec![vec![point(), point(), point()]]).collect();
        let list = model(&faces);
        let made = Topology::of(&list, &TopologyOptions::default(), &()).unwrap();
        check(&made, &list);
    }
}

#[test]
fn memory_is_bounded() {
    let cube = model(&cuboid([0; 3], [4; 3]));
    let options = TopologyOptions { memory: 1000, path: "cube.brep".into() };
    let error = Topology::of(&cube, &options, &()).unwrap_err();
    assert!(matches!(error, Error::TooLarge { limit: 1000, .. }), "{error}");
}

/// Cancels after a number of checks.
struct Stop(std::sync::atomic::AtomicI64);

impl Progress for Stop {
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) <= 0
    }
}

#[test]
fn work_can_be_interrupted() {
    let cube = model(&cuboid([0; 3], [4; 3]));
    let make = |checks: i64| Topology::of(&cube, &TopologyOptions::default(), &Stop(checks.into()));
    let enough = (0..100).find(|&checks| !matches!(make(checks), Err(Error::Interrupted))).unwrap();
    assert!(enough > 3 && make(enough).is_ok());
}

/// Closed meshes, against results of `trimesh`.
#[test]
fn real_meshes() {
    let Some(directory) = shared_data() else { return };
    let table = std::fs::read_to_string(directory.join("mesh/expected.tsv")).unwrap();
    for row in table.lines().skip(1) {
        let fields: Vec<&str> = row.split('\t').collect();
        let Some(faces) = snapped(fields[0], &|_| true) else { continue };
        let made = topology(&faces);
        let euler = made.euler();
        let number = |field: usize| fields[field].parse::<i64>().unwrap();
        let sum = euler.vertices as i64 - euler.edges as i64 + euler.faces as i64;
        println!("{}: {euler:?}", fields[0]);
        if fields[3] == "True" && fields[4] == "True" {
            let cube = faces.grid().width().powi(3);
            let volume: f64 =
                (0..made.shells()).map(|shell| made.six_volumes(shell) as f64 / 6.0 * cube).sum();
            let expected: f64 = fields[7].parse().unwrap();
            assert!((volume - expected).abs() < 1e-6 * expected, "{}: {volume}", fields[0]);
            assert!(made.is_closed(), "{}", fields[0]);
            assert_eq!((sum, euler.shells as i64), (number(5), number(6)), "{}", fields[0]);
        } else if fields[4] == "False" {
            assert!(!made.is_closed(), "{}", fields[0]);
        }
    }
}

/// City solids: separate buildings, with holes in faces.
#[test]
fn city_solids() {
    for name in ["cityjson/delft.json", "cityjson/rotterdam_subset.json", "cityjson/DH_01_subs.city.json"] {
        let Some(all) = snapped(name, &|_| true) else { continue };
        let mut closed = 0;
        let mut by_part = HashMap::<u32, FaceList>::new();
        all.each(&mut |face| {
            let part = by_part.entry(face.part);
            part.or_insert_with(|| FaceList::new(all.grid().clone(), all.parts().to_vec())).push(face);
            Ok(())
        })
        .unwrap();
        for faces in by_part.values() {
            let made = topology(faces);
            let shells: Vec<Counts> = made.counts_by_shell();
            assert!(shells.iter().all(|counts| counts.genus().is_some()));
            closed += usize::from(made.is_closed());
        }
        println!("{name}: {closed} of {} parts are closed", by_part.len());
        let whole = topology(&all);
        println!("{name}: {:?}", whole.euler());
        assert!(closed > 0 || !name.contains("DH_01"), "{name}");
    }
}
