//! Built exact models: cells against all faces, points against winding numbers, and degenerate
//! families.

use spinney::ExactModel;
use spinney::brep::{FaceBuffer, Faces, Grid, Location};
use spinney::raw::brep::{DefectKind, FaceList, LEAF_SIZE, ModelNode, ModelNodeState, NodeKind};
use spinney::raw::geometry::{Box3, GridPolygon, Triangulator};

use crate::common::Random;
use crate::common::exact::{Ring, built, cuboid, file_of, model, model_on, prism, snapped, turned};

/// Translates all vertices.
fn moved(mut faces: Vec<Vec<Ring>>, by: [i32; 3]) -> Vec<Vec<Ring>> {
    for point in faces.iter_mut().flatten().flatten() {
        (0..3).for_each(|axis| point[axis] += by[axis]);
    }
    faces
}

/// A box without axis-parallel faces: its edges are orthogonal integer vectors.
fn turned_cube(origin: [i32; 3], scale: i32) -> Vec<Vec<Ring>> {
    let sides = [[2, 2, 1], [-2, 1, 2], [1, -2, 2]];
    let map = |p: &[i32; 3]| {
        [0, 1, 2]
            .map(|axis| origin[axis] + scale * (0..3).map(|side| p[side] * sides[side][axis]).sum::<i32>())
    };
    let faces = cuboid([0; 3], [1; 3]);
    faces.iter().map(|rings| rings.iter().map(|ring| ring.iter().map(map).collect()).collect()).collect()
}

/// Returns named degenerate solids.
fn families() -> Vec<(&'static str, Vec<Vec<Ring>>)> {
    let unit = |at: [i32; 3]| cuboid(at, at.map(|at| at + 100));
    let joined = |parts: &[Vec<Vec<Ring>>]| parts.concat();
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole = |low: i32, high: i32| square(low, high).into_iter().rev().collect::<Vec<_>>();
    vec![
        ("turned cube", turned_cube([300, 300, 300], 60)),
        ("two vertices in the smallest cell", joined(&[unit([0; 3]), cuboid([101, 0, 0], [102, 1, 1])])),
        ("plate of one unit", cuboid([0, 0, 511], [900, 900, 512])),
        ("slanted plate", {
            let up = |at: &[i32; 3]| [at[0], at[1], at[2] + 3 * at[0] + 5 * at[1]];
            cuboid([0, 0, 0], [90, 90, 1])
                .iter()
                .map(|rings| rings.iter().map(|ring| ring.iter().map(up).collect()).collect())
                .collect()
        }),
        ("faces on walls of cells", cuboid([256; 3], [512; 3])),
        ("two bodies that touch along an edge", joined(&[unit([100; 3]), unit([200, 200, 100])])),
        ("two bodies that touch in a vertex", joined(&[unit([100; 3]), unit([200; 3])])),
        ("two bodies that touch in a face", joined(&[unit([100; 3]), unit([200, 100, 100])])),
        (
            "two bodies that touch in a part of a face",
            joined(&[unit([100; 3]), cuboid([200, 150, 120], [260, 260, 160])]),
        ),
        (
            "a body on a roof's ridge",
            joined(&[turned_cube([300, 300, 300], 20), moved(cuboid([0; 3], [50; 3]), [340, 340, 340])]),
        ),
        ("a cavity", joined(&[cuboid([0; 3], [300; 3]), turned(cuboid([100; 3], [200; 3]))])),
        (
            "a body in a cavity",
            joined(&[
                cuboid([0; 3], [300; 3]),
                turned(cuboid([50; 3], [250; 3])),
                cuboid([100; 3], [200; 3]),
            ]),
        ),
        ("a hole through a box", prism(&[square(0, 300), hole(100, 200)], 10, 70)),
        (
            "a hole that touches its face's boundary",
            prism(&[vec![[0, 0], [300, 0], [300, 300], [0, 300]], vec![[0, 0], [40, 90], [90, 40]]], 0, 40),
        ),
    ]
}

/// Traverses a model's nodes.
fn walk<'a>(model: &'a ExactModel, node: &ModelNode<'a>, visit: &mut dyn FnMut(&ModelNode<'a>)) {
    visit(node);
    for child in model.children(node).unwrap().iter().flatten() {
        walk(model, child, visit);
    }
}

/// Returns the winding number of a point, in 64ths of grid units, by a ray that meets no edge;
/// `None` if the point lies on a face. Uses wide integers and signed volumes, unlike the library.
fn winding(faces: &FaceList, point: [i64; 3]) -> Option<i32> {
    let wide = |p: [i64; 3]| p.map(i128::from);
    let minus = |a: [i128; 3], b: [i128; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let volume = |a: [i128; 3], b: [i128; 3], c: [i128; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    let zero = i128::from(0);
    let sign = |x: i128| i32::from(x > zero) - i32::from(x < zero);
    let from = wide(point);
    'directions: for direction in [[1_000_003, 10_007, 101], [-7, 999_983, 31_337], [65_537, -257, 1_299_709]]
    {
        let direction = wide(direction);
        let mut winding = 0;
        for number in 0..faces.len() as usize {
            let face = faces.get(number);
            let points: Vec<[i64; 3]> = face.points.iter().map(|p| p.map(|at| 64 * i64::from(at))).collect();
            let mut triangles = Vec::new();
            assert!(Triangulator::new().triangulate(&points, face.ring_ends, &mut triangles));
            for triangle in triangles {
                let [a, b, c] = triangle.map(|corner| minus(wide(points[corner as usize]), from));
                let normal = |a: [i128; 3], b: [i128; 3]| volume(a, b, direction);
                let height = volume(a, b, c);
                let sides = [normal(a, b), normal(b, c), normal(c, a)].map(sign);
                if height == zero {
                    // In the plane: the point is on the triangle if no two edges have it on
                    // opposite sides.
                    let n = {
                        let (u, v) = (minus(b, a), minus(c, a));
                        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
                    };
                    let turns = [(a, b), (b, c), (c, a)].map(|(p, q)| sign(volume(p, q, n)));
                    if n != [zero; 3] && (turns.iter().all(|t| *t >= 0) || turns.iter().all(|t| *t <= 0)) {
                        return None;
                    }
                    continue;
                }
                if sides.contains(&0) {
                    // If the ray meets an edge, try another direction.
                    let around = sides.iter().all(|s| *s >= 0) || sides.iter().all(|s| *s <= 0);
                    if around {
                        continue 'directions;
                    }
                    continue;
                }
                if sides[0] == sides[1] && sides[1] == sides[2] && sides[0] == sign(height) {
                    winding += sides[0];
                }
            }
        }
        return Some(winding);
    }
    panic!("no direction misses all edges from {point:?}");
}

/// Random points and lattice points that include vertices, edges and faces, for all families, are
/// classified like their winding number.
#[test]
fn points_are_where_winding_numbers_say() {
    let mut random = Random(1);
    for (name, faces) in families() {
        let list = model(&faces);
        for leaf_size in [0, LEAF_SIZE] {
            let (bytes, report) = built(&list, 64 << 20, leaf_size);
            assert_eq!(report.defects, [], "{name}");
            let file = ExactModel::from_bytes(bytes.unwrap()).unwrap();
            assert_eq!(file.verify(1 << 20, &()).unwrap(), [], "{name}");
            let mut seen = [0; 3];
            for round in 0..400 {
                let corner = |random: &mut Random| {
                    let face = list.get(random.below(list.len()) as usize);
                    face.points[random.below(face.points.len() as u64) as usize].map(i64::from)
                };
                let point: [i64; 3] = match round % 4 {
                    // A random point.
                    0 => std::array::from_fn(|_| random.below(64 * 1000) as i64),
                    // A vertex, a midpoint of two, and mixed coordinates of several.
                    1 => corner(&mut random).map(|at| 64 * at),
                    2 => {
                        let (a, b) = (corner(&mut random), corner(&mut random));
                        [0, 1, 2].map(|axis| 32 * (a[axis] + b[axis]))
                    }
                    _ => {
                        let (a, b, c) = (corner(&mut random), corner(&mut random), corner(&mut random));
                        let near = random.below(3) as i64 - 1;
                        [64 * a[0] + near, 64 * b[1] - near, 32 * (b[2] + c[2])]
                    }
                };
                let expected = match winding(&list, point) {
                    None => Location::Boundary,
                    Some(0) => Location::Outside,
                    Some(1) => Location::Inside,
                    Some(other) => panic!("{name}: {other} times around {point:?}"),
                };
                let found = file.locate(point.map(|at| at as f64 / 64.0)).unwrap();
                assert_eq!(found, expected, "{name}, {leaf_size}: {point:?} in 64ths");
                seen[found as usize] += 1;
            }
            assert!(seen.iter().all(|times| *times > 0), "{name}: {seen:?}");
        }
    }
}

/// A point on a face that passes through an edge of the point's cell, and cuts only the adjacent
/// cells, is on the boundary.
#[test]
fn points_on_edges_of_cells_may_lie_on_faces() {
    let list = model(&prism(&[vec![[0, 0], [3, 0], [0, 3]]], 0, 4));
    for leaf_size in 0..8 {
        let file = ExactModel::from_bytes(built(&list, 64 << 20, leaf_size).0.unwrap()).unwrap();
        for z in [0.5, 1.0, 1.2, 1.5, 3.5] {
            assert_eq!(file.locate([1.5, 1.5, z]).unwrap(), Location::Boundary, "{leaf_size} {z}");
            assert_eq!(file.locate([1.5, 1.25, z]).unwrap(), Location::Inside);
            assert_eq!(file.locate([1.5, 1.75, z]).unwrap(), Location::Outside);
        }
    }
}

/// Each leaf has exactly the faces that cut its cell, by the five-stage test against all faces.
/// Cells without faces are inside or outside like their centres.
#[test]
fn leaves_have_the_faces_that_cut_them() {
    for (name, faces) in families() {
        let list = model(&faces);
        let mut triangulator = Triangulator::new();
        let polygons: Vec<GridPolygon> = (0..list.len() as usize)
            .map(|number| {
                let face = list.get(number);
                let points: Vec<[i64; 3]> =
                    face.points.iter().map(|p| p.map(|at| 2 * i64::from(at))).collect();
                GridPolygon::new(&points, face.ring_ends, &mut triangulator).unwrap()
            })
            .collect();
        for leaf_size in [0, 4] {
            let (bytes, report) = built(&list, 64 << 20, leaf_size);
            let file = ExactModel::from_bytes(bytes.unwrap()).unwrap();
            let mut kinds = [0u64; 4];
            walk(&file, &file.root().unwrap(), &mut |node| {
                let [min, max] = node.bounds(file.grid());
                let mut found: Vec<u64> = node.faces().collect();
                found.sort_unstable();
                if node.state() == ModelNodeState::Inner {
                    return;
                }
                let cut = |polygon: &GridPolygon| polygon.cuts(&Box3 { min, max }).cuts;
                let expected: Vec<u64> =
                    (0..).zip(&polygons).filter(|(_, p)| cut(p)).map(|(n, _)| n).collect();
                assert_eq!(found, expected, "{name}: {:?} at level {}", node.position(), node.level());
                match node.state() {
                    ModelNodeState::Leaf { kind, .. } => kinds[kind as usize] += 1,
                    state => {
                        let middle = [0, 1, 2].map(|axis| 16 * (min[axis] + max[axis]));
                        let inside = winding(&list, middle) == Some(1);
                        assert_eq!(state == ModelNodeState::Full, inside, "{name}: {middle:?}");
                    }
                }
            });
            let nodes = report.nodes;
            assert_eq!(kinds, [nodes.face, nodes.edge, nodes.vertex, nodes.boolean]);
        }
    }
}

/// Without the limit on faces per cell, the tree is the extended octree of the literature, with the
/// rule that a cell also ends if its planes meet in a point outside of it: 25 nodes were measured
/// for a rotated cube, 105 without the rule.
#[test]
fn a_turned_cube_has_few_nodes_of_all_kinds() {
    let grid = Grid::over([[0.0; 3], [f64::from((1 << 26) - 1); 3]], Some(1.0)).unwrap();
    let mut totals = Vec::new();
    // Quaternions give orthogonal integer edge vectors.
    for [a, b, c, d] in [[10, 1, 1, 0], [10, 2, 1, 1], [5, 1, 1, 1], [7, 3, 1, 2]] {
        let sides = [
            [a * a + b * b - c * c - d * d, 2 * (b * c + a * d), 2 * (b * d - a * c)],
            [2 * (b * c - a * d), a * a - b * b + c * c - d * d, 2 * (c * d + a * b)],
            [2 * (b * d + a * c), 2 * (c * d - a * b), a * a - b * b - c * c + d * d],
        ];
        let scale = 30_000_000 / (a * a + b * b + c * c + d * d);
        // Its centre is that of the space, up to a few grid units.
        let map = |p: &[i32; 3]| {
            [0, 1, 2].map(|axis| {
                let along = |side: usize| (2 * p[side] - 1) * sides[side][axis] * (scale / 2);
                (1 << 25) + 11 + (0..3).map(along).sum::<i32>()
            })
        };
        let faces: Vec<Vec<Ring>> = cuboid([0; 3], [1; 3])
            .iter()
            .map(|rings| rings.iter().map(|ring| ring.iter().map(map).collect()).collect())
            .collect();
        let list = model_on(grid.clone(), &faces);
        let (_, report) = built(&list, 64 << 20, 0);
        assert!(report.nodes.vertex > 0 && report.nodes.boolean == 0, "{:?}", report.nodes);
        totals.push(report.nodes.total());
        let (_, report) = built(&list, 64 << 20, LEAF_SIZE);
        assert_eq!((report.nodes.total(), report.nodes.boolean), (1, 1));
    }
    assert!(totals.iter().all(|total| *total <= 25), "{totals:?}");
}

/// Planes with a common line give EDGE cells, also if four faces meet in it; parallel planes meet
/// at infinity.
#[test]
fn leaf_kinds_follow_from_the_planes() {
    let two = [cuboid([100; 3], [200, 200, 900]), cuboid([200, 200, 100], [300, 300, 900])].concat();
    let file = ExactModel::from_bytes(built(&model(&two), 64 << 20, 0).0.unwrap()).unwrap();
    let mut most = 0;
    walk(&file, &file.root().unwrap(), &mut |node| {
        if let ModelNodeState::Leaf { kind: NodeKind::Edge, .. } = node.state() {
            most = most.max(node.faces().count());
        }
    });
    assert_eq!(most, 4, "faces around the edge that both share");
    let plate = cuboid([0, 0, 700], [900, 900, 701]);
    let (_, report) = built(&model(&plate), 64 << 20, 0);
    assert!(report.nodes.edge > 0 && report.nodes.total() < 400, "{:?}", report.nodes);
}

/// Surfaces that bound no solid are rejected with the positions of defects.
#[test]
fn surfaces_without_a_volume_are_rejected() {
    let at = |at: i32| cuboid([at; 3], [at + 100; 3]);
    let kinds = |faces: &[Vec<Ring>]| {
        let (file, report) = built(&model(faces), 64 << 20, LEAF_SIZE);
        assert!(file.is_none(), "{faces:?}");
        assert!(report.defect_count >= report.defects.len() as u64 && report.defects.len() <= 100);
        report.defects
    };
    let has = |faces: &[Vec<Ring>], kind: DefectKind| {
        let found = kinds(faces);
        assert!(found.iter().any(|defect| defect.kind == kind), "{kind:?}: {found:?}");
    };
    has(&[at(100), at(150)].concat(), DefectKind::Crossing);
    has(&turned(at(100)), DefectKind::Winding(-1));
    has(&[at(100), at(100)].concat(), DefectKind::Overlap);
    has(&[cuboid([0; 3], [300; 3]), cuboid([100; 3], [200; 3])].concat(), DefectKind::Winding(2));
    has(&turned(cuboid([0, 0, 511], [900, 900, 512])), DefectKind::Winding(-1));
    // Small and inside out, far from any cell corner.
    has(
        &[cuboid([0; 3], [900; 3]), cuboid([411, 333, 507], [412, 334, 508])].concat(),
        DefectKind::Winding(2),
    );
    has(&turned(turned_cube([300, 300, 300], 1)), DefectKind::Winding(-1));
    // Edges that meet edges and face diagonals exactly.
    for corners in [[150, 150, 150], [150, 150, 120], [100, 150, 150], [150, 100, 100], [150, 125, 110]] {
        assert!(!kinds(&[at(100), cuboid(corners, corners.map(|at| at + 100))].concat()).is_empty());
        let triangles = |faces: Vec<Vec<Ring>>| -> Vec<Vec<Ring>> {
            let cut = |rings: &Vec<Ring>| {
                let [a, b, c, d] = rings[0][..] else { panic!("a rectangle") };
                [vec![vec![a, b, c]], vec![vec![a, c, d]]]
            };
            faces.iter().flat_map(cut).collect()
        };
        let both = [triangles(at(100)), triangles(cuboid(corners, corners.map(|at| at + 100)))].concat();
        assert!(!kinds(&both).is_empty(), "{corners:?}");
    }
    // Defects are reported at their positions.
    let found = kinds(&[at(100), at(150)].concat());
    assert!(found.iter().all(|defect| defect.place.iter().all(|at| (95.0..255.0).contains(at))), "{found:?}");
}

/// Files depend neither on the memory limit nor on the thread count.
#[test]
fn bytes_depend_on_neither_memory_nor_threads() {
    let Some(list) = snapped("spot.ply", &|_| true) else { return };
    let file = |memory: u64, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| built(&list, memory, LEAF_SIZE).0.unwrap())
    };
    let expected = file(256 << 20, 1);
    for (memory, threads) in [(256 << 20, 4), (1 << 20, 2), (64 << 10, 3)] {
        assert!(file(memory, threads) == expected, "{memory} bytes, {threads} threads");
    }
}

/// Builders reject invalid faces.
#[test]
fn degenerate_faces_are_rejected() {
    let list = |rings: &[Ring]| model(&[rings.to_vec()]);
    let bent = vec![[0, 0, 0], [9, 0, 0], [9, 9, 1], [0, 9, 0]];
    let crossing = vec![[0, 0, 0], [9, 9, 0], [9, 0, 0], [0, 9, 0], [4, 12, 0]];
    let outside = vec![[0, 0, 0], [2000, 0, 0], [0, 9, 0]];
    for ring in [bent, crossing, outside] {
        let directory = tempfile::tempdir().unwrap();
        let output = spinney::Output::create(&directory.path().join("x.goblin")).unwrap();
        let faces = list(std::slice::from_ref(&ring));
        let mut builder =
            spinney::raw::brep::ModelBuilder::new(output, faces.grid().clone(), 1 << 20).unwrap();
        assert!(builder.push(&faces.get(0)).is_err(), "{ring:?}");
    }
}

/// No changed byte causes a panic or a hang: the corruption is found, or results differ.
#[test]
fn corrupt_files_are_detected() {
    let list = model(&families()[12].1);
    let bytes = built(&list, 64 << 20, 0).0.unwrap();
    let mut random = Random(5);
    let mut found = 0;
    for round in 0..4_000 {
        let mut corrupt = bytes.clone();
        match round % 8 {
            0 => corrupt.truncate(random.below(bytes.len() as u64) as usize),
            _ => {
                let at = random.below(bytes.len() as u64) as usize;
                corrupt[at] ^= 1 << random.below(8);
            }
        }
        let Ok(file) = ExactModel::from_bytes(corrupt) else {
            found += 1;
            continue;
        };
        found += usize::from(!file.verify(1 << 20, &()).unwrap().is_empty());
        let mut buffer = FaceBuffer::default();
        for number in 0..file.len().min(40) {
            let _ = file.face(number, &mut buffer);
        }
        for point in [[150.0; 3], [50.0, 50.0, 50.0], [300.0, 0.0, 10.0]] {
            let _ = file.locate(point);
        }
    }
    assert_eq!(found, 4_000, "every change is found: all bytes have a checksum");
}

/// With all faces in one block, queries for face numbers out of range are errors.
#[test]
fn faces_that_are_not_there_are_errors() {
    let file = file_of(&model(&cuboid([0; 3], [100; 3])));
    let mut buffer = FaceBuffer::default();
    assert!(file.face(5, &mut buffer).is_ok() && file.face(6, &mut buffer).is_err());
    assert!(file.face(u64::MAX, &mut buffer).is_err());
}
