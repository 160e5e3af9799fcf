//! Exact models as text: BSP trees, and extended octrees as modified DF-expressions. Both are read
//! back to the same model.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use spinney::brep::{Faces, MassProperties};
use spinney::raw::csg::{Csg, CsgExactOptions, import_exact_csg};
use spinney::raw::partitions::{Bsp, SolidText, extended_octree_text};
use spinney::{ExactModel, Output, SetOperation};

use crate::common::Random;
use crate::common::command::{complaint, stdout};

/// Solids with convex and concave edges and vertices, holes, cavities, several shells, thin walls,
/// and faces in common planes.
const SOLIDS: [&str; 7] = [
    "block(0,0,0, 3,5,7)",
    "difference(block(0,0,0, 8,4,4), block(1,1,2, 3,3,5), cylinder(5,2,-1, 5,2,9, 1))",
    "difference(block(0,0,0, 8,8,8), block(2,2,2, 6,6,6))",
    "union(block(0,0,0, 4,4,4), block(4,4,0, 8,8,4), block(9,0,0, 10,1,1))",
    "difference(block(0,0,0, 9,9,1), block(1,1,-1, 8,8,2), block(4,-1,0.5, 5,10,3))",
    "union(block(0,0,0, 4,8,2), block(4,3,0.5, 8,5,1.5), cone(2,4,2, 1.5, 2,4,5, 0))",
    "rotate(1,2,3, 40, prism([[0,0],[4,0],[4,1],[1,1],[1,3],[0,3]], 0, 2))",
];

fn volume_of(model: &ExactModel) -> f64 {
    MassProperties::of(model, &()).unwrap().volume
}

struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Returns the exact model of an expression, with units of 1/1024.
    fn model(&self, name: &str, csg: &str) -> ExactModel {
        let csg = Csg::parse(Path::new("test.csg"), csg).unwrap();
        let mut options = CsgExactOptions::new();
        (options.deviation, options.snap) = (Some(0.2), Some(1.0 / 1024.0));
        let path = self.path(name);
        import_exact_csg(&csg, &options, Output::create(&path).unwrap(), &()).unwrap();
        ExactModel::open(&path, &Default::default()).unwrap()
    }

    /// Returns the model that the program builds from a text.
    fn built(&self, name: &str, text: &str) -> ExactModel {
        let (input, tree) = (self.path(name), self.path(&format!("{name}.goblin")));
        std::fs::write(&input, text).unwrap();
        stdout(&["build", input.to_str().unwrap(), "-o", tree.to_str().unwrap(), "--brep"]);
        ExactModel::open(&tree, &Default::default()).unwrap()
    }
}

/// The rings of a model's faces in the world, each from its smallest vertex, sorted.
fn rings(model: &ExactModel) -> Vec<Vec<Vec<String>>> {
    let mut faces = Vec::new();
    model
        .each(&mut |face| {
            let ring = |ring: &[[i32; 3]]| {
                let mut points: Vec<String> =
                    ring.iter().map(|point| format!("{:?}", model.grid().to_world(*point))).collect();
                let least = (0..points.len()).min_by_key(|i| points[*i].clone()).unwrap();
                points.rotate_left(least);
                points
            };
            let mut rings: Vec<_> = face.rings().map(ring).collect();
            rings[1..].sort();
            faces.push(rings);
            Ok(())
        })
        .unwrap();
    faces.sort();
    faces
}

/// Text of both kinds gives the same faces, with holes, and without vertices where planes of other
/// nodes cut faces; and the same octree again. (Operations copy cells of their operands' octrees,
/// so those of results may be deeper.)
#[test]
fn item_42_text_is_read_back_to_the_same_model() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    for (number, csg) in SOLIDS.into_iter().enumerate() {
        let model = directory.model(&format!("{number}.goblin"), csg);
        let octree = extended_octree_text(&model, &()).unwrap();
        let (trees, grid) = Bsp::of_models(&[&model], &()).unwrap();
        let bsp = trees[0].to_text(&grid, None);
        for (name, text) in [("df", octree), ("bsp", bsp)] {
            let again = directory.built(&format!("{number}.{name}"), &text);
            assert_eq!(rings(&again), rings(&model), "{csg} as {name}");
            let more = directory
                .built(&format!("more_{name}_{number}.df"), &extended_octree_text(&again, &()).unwrap());
            assert_eq!(more.nodes().named(), again.nodes().named(), "{csg} as {name}");
            assert_eq!(again.verify(64 << 20, &()).unwrap(), vec![]);
        }
    }
}

/// Bodies that touch in a face become one: both sides of the wall between them are inside.
#[test]
fn item_42_walls_between_bodies_vanish() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    let mesh = directory.path("boxes.obj");
    let mut text = String::new();
    for x in 0..2 {
        text += &format!("o box{x}\n");
        for corner in 0..8 {
            let [dx, dy, dz] = [0, 1, 2].map(|axis| corner >> axis & 1);
            text += &format!("v {} {} {}\n", 4 * (x + dx), (4 + 2 * x) * dy, 3 * dz);
        }
        for face in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
            text += &format!("f {}\n", face.map(|corner| (corner + 8 * x).to_string()).join(" "));
        }
    }
    std::fs::write(&mesh, text).unwrap();
    let tree = directory.path("boxes.goblin");
    let (mesh, tree) = (mesh.to_str().unwrap(), tree.to_str().unwrap());
    stdout(&["build", mesh, "-o", tree, "--brep", "--snap", "1"]);
    for structure in ["df", "bsp"] {
        let text = stdout(&["dump", tree, "--as", structure]);
        let model = directory.built(&format!("boxes.{structure}"), &text);
        assert_eq!(volume_of(&model), 4.0 * 4.0 * 3.0 + 4.0 * 6.0 * 3.0, "{structure}");
        // Of the wall, the part of the larger box beyond the smaller one stays.
        assert_eq!(model.len(), 8, "{structure}");
    }
}

/// A cube in a grid of 8: eight octants of one vertex each, with three planes.
#[test]
fn item_42_vertices_have_three_planes() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    let (input, tree) = (directory.path("cube.off"), directory.path("cube.goblin"));
    let corners = (0..8).map(|i| [1, 2, 4].map(|bit| if i & bit > 0 { "6" } else { "1" }).join(" "));
    let faces =
        ["0 2 3 1", "4 5 7 6", "0 1 5 4", "2 6 7 3", "0 4 6 2", "1 3 7 5"].map(|face| format!("4 {face}"));
    let lines: Vec<String> = corners.chain(faces).collect();
    std::fs::write(&input, format!("OFF\n8 6 0\n{}\n", lines.join("\n"))).unwrap();
    let (input, tree) = (input.to_str().unwrap(), tree.to_str().unwrap());
    stdout(&["build", input, "-o", tree, "--brep", "--snap", "1", "--leaf-size", "0"]);
    let text = stdout(&["dump", tree, "--as", "df"]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!((lines[0], lines.len()), ("df:planes:xyz:3:1/1:1,1,1", 8), "{text}");
    let leaf = |x: usize, y: usize, z: usize| {
        let number = |normal: [i64; 3], d: i64| {
            let [a, b, c] = normal;
            lines[1..7].iter().position(|line| line.ends_with(&format!(": {a} {b} {c} {d}"))).unwrap() + 1
        };
        let low = [number([-1, 0, 0], 0), number([0, -1, 0], 0), number([0, 0, -1], 0)];
        let high = [number([1, 0, 0], -5), number([0, 1, 0], -5), number([0, 0, 1], -5)];
        let mut planes = [[low, high][x][0], [low, high][y][1], [low, high][z][2]];
        planes.sort_unstable();
        format!("X[{}&{}&{}]", planes[0], planes[1], planes[2])
    };
    let octants = (0..8).map(|octant| leaf(octant & 1, octant >> 1 & 1, octant >> 2));
    assert_eq!(lines[7], format!("M{}", octants.collect::<String>()), "{text}");
}

/// All sixteen operations on BSP trees of bounded results match those on exact models.
#[test]
fn item_14_set_operations_are_those_of_exact_models() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    let models = [SOLIDS[1], "block(2,2,1, 6,6,3)"];
    let models = [0, 1].map(|number| directory.model(&format!("{number}.goblin"), models[number]));
    let (trees, grid) = Bsp::of_models(&[&models[0], &models[1]], &()).unwrap();
    for operation in SetOperation::ALL.into_iter().filter(|operation| !operation.is_unbounded()) {
        let made = trees[0].combine(&trees[1], operation, &()).unwrap();
        let path = directory.path(&format!("combined{}.goblin", operation.index()));
        let codec = spinney::Codec::default();
        let output = Output::create(&path).unwrap();
        spinney::brep::combine(operation, &[&models[0], &models[1]], output, codec, 64 << 20, &()).unwrap();
        let combined = ExactModel::open(&path, &Default::default()).unwrap();
        if operation == SetOperation::Empty {
            assert!(made.polygons(&()).unwrap().is_empty() && combined.is_empty());
            continue;
        }
        let built = directory.built(&format!("{}.bsp", operation.index()), &made.to_text(&grid, None));
        let [found, expected] = [&built, &combined].map(volume_of);
        // (New vertices may be off the grid, by half a unit.)
        let most = MassProperties::of(&combined, &()).unwrap().area / 1024.0;
        assert!((found - expected).abs() <= most, "{operation}: {found}, expected {expected}");
    }
}

/// Points are inside of a BSP tree where the model says so; the program prints the way there.
#[test]
fn item_14_points_are_located() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    let model = directory.model("comb.goblin", SOLIDS[1]);
    let tree = directory.path("comb.goblin");
    let (trees, grid) = Bsp::of_models(&[&model], &()).unwrap();
    let mut random = Random(43);
    let mut inside = 0;
    for _ in 0..2000 {
        let at = [8.0, 4.0, 4.0].map(|size| size * random.below(4096) as f64 / 4096.0);
        let point = grid.snap(at).unwrap();
        // (Points between grid points are on no face that is parallel to axes.)
        let location = model.locate(grid.to_world(point)).unwrap();
        if location == spinney::brep::Location::Boundary {
            continue;
        }
        inside += usize::from(trees[0].is_inside(point));
        assert_eq!(trees[0].is_inside(point), location == spinney::brep::Location::Inside, "{point:?}");
    }
    assert!((500..1900).contains(&inside), "{inside}");
    let located = |point: &str| stdout(&["dump", tree.to_str().unwrap(), "--as", "bsp", "--locate", point]);
    assert!(
        located("7,2,1").ends_with("cell        in\n") && located("5,2,1").ends_with("cell        out\n")
    );
    assert!(located("-100,2,1").ends_with("cell        out\n"));
}

/// Wrong text is refused with its line, and without a panic.
#[test]
fn item_42_wrong_text_is_refused() {
    let head = "df:planes:xyz:3:1/1:0,0,0";
    let planes = format!("{head}\n1: 1 0 0 -5\n2: 0 1 0 -5\n");
    let deep = format!("{planes}A[{}1{}]", "(1?".repeat(3000), ":out)".repeat(3000));
    let long = format!("{planes}A[{}1]", "1&".repeat(3000));
    let nested = format!("{head}\n{}", "M".repeat(100));
    for (text, expected) in [
        ("", "`bsp:xyz:BITS:STEP/DIVISOR:X,Y,Z[:UNIT]`"),
        ("bsp:xyz:27:1/1:0,0,0\nin", "`bsp:xyz:BITS"),
        ("bsp:xyz:3:0/1:0,0,0\nin", "`bsp:xyz:BITS"),
        ("bsp:xyz:3:1/nan:0,0,0\nin", "`bsp:xyz:BITS"),
        ("bsp:xyz:3:1/1:0,0\nin", "`bsp:xyz:BITS"),
        ("bsp:xyz:3:1/1:0,0,99999999999999999\nin", "`bsp:xyz:BITS"),
        ("bsp:xyz:3:1/1:0,0,0:m m\nin", "`bsp:xyz:BITS"),
        ("bsp:xyz:3:1/1:0,0,0\n1 0 0 -3\nin", "line 4: got the end of the text, expected 1 more nodes"),
        ("bsp:xyz:3:1/1:0,0,0\nin\nin", "the tree is complete"),
        ("bsp:xyz:3:1/1:0,0,0\n0 0 0 -3\nin\nout", "expected a plane"),
        ("bsp:xyz:3:1/1:0,0,0\n99999999999999999 0 0 -3\nin\nout", "expected a plane"),
        ("bsp:xyz:3:1/1:0,0,0\nmaybe", "expected a plane"),
        (&format!("{head}\n2: 1 0 0 -5\nV"), "the number 1 of the next plane"),
        (&format!("{planes}A[3]"), "the number of a plane, 1 to 2"),
        (&format!("{planes}A[0]"), "the number of a plane, 1 to 2"),
        (&format!("{planes}A[99999999999999999999999]"), "the number of a plane"),
        (&format!("{planes}A[1&2|1]"), "parentheses around one of the operators"),
        (&format!("{planes}A[1&2"), "expected `]`"),
        (&format!("{planes}A[(1?in)]"), "expected `:`"),
        (&format!("{planes}A1"), "expected `[`"),
        (&format!("{planes}MVVV"), "a symbol: eight follow each M"),
        (&format!("{planes}VV"), "the tree is complete"),
        (&format!("{planes}W"), "one of M V F A E X B"),
        (&deep, "at most 1024"),
        (&long, "at most 1024"),
        (&nested, "a cell of one grid unit is not divided"),
    ] {
        let error = SolidText::parse(Path::new("wrong.df"), text).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("wrong.df"), "{text}: {error}");
    }
    for unbounded in ["bsp:xyz:3:1/1:0,0,0\nin", "bsp:xyz:3:1/1:0,0,0\n1 0 0 -3\nin\nout"] {
        let solid = SolidText::parse(Path::new("half.bsp"), unbounded).unwrap();
        let error = solid.polygons(&()).unwrap_err().to_string();
        assert!(error.contains("an inside that extends beyond the grid"), "{error}");
    }
}

/// Random expressions never panic, and what they describe has a closed surface.
#[test]
fn item_42_random_octrees_have_closed_surfaces() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    let mut random = Random(42);
    let mut built = 0;
    for round in 0..30 {
        let mut text = String::from("df:planes:xyz:3:1/1:0,0,0\n");
        for number in 1..=6 {
            let mut part = || random.below(5) as i64 - 2;
            let normal = [part(), part(), part()];
            let [a, b, c] = if normal == [0; 3] { [1, 0, 0] } else { normal };
            text += &format!("{number}: {a} {b} {c} {}\n", -(a + b + c) * (2 + random.below(4) as i64));
        }
        let mut symbols = |leaf: usize| -> String {
            let mut number = || 1 + random.below(6);
            let (a, b, c) = (number(), number(), number());
            match (leaf + number() as usize) % 7 {
                0 | 1 => "V".into(),
                2 => "F".into(),
                3 => format!("A[{a}]"),
                4 => format!("E[{a}&!{b}]"),
                5 => format!("X[{a}|({b}&{c})]"),
                _ => format!("B[({a}?!{b}|{c}:{c})]"),
            }
        };
        let octants: Vec<String> = (0..8).map(&mut symbols).collect();
        text += &format!("M{}", octants.concat());
        let solid = SolidText::parse(Path::new("random.df"), &text).unwrap();
        let polygons = solid.polygons(&()).unwrap();
        // The area vectors of a closed surface cancel.
        let mut sum = [0.0; 3];
        for ring in polygons.iter().flatten() {
            for i in 0..ring.len() {
                let (p, q) = (ring[i], ring[(i + 1) % ring.len()]);
                (0..3).for_each(|axis| {
                    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                    sum[axis] += p[u] * q[v] - p[v] * q[u];
                });
            }
        }
        assert!(sum.iter().all(|part: &f64| part.abs() < 1e-9), "{round}: {sum:?}\n{text}");
        built += usize::from(!polygons.is_empty());
    }
    assert!(built > 20, "{built}");
    let (input, tree) = (directory.path("nothing.df"), directory.path("nothing.goblin"));
    std::fs::write(&input, "df:planes:xyz:3:1/1:0,0,0\nV\n").unwrap();
    let message = complaint(&["build", input.to_str().unwrap(), "-o", tree.to_str().unwrap(), "--brep"], 1);
    assert!(message.contains("no half-space is inside"), "{message}");
}

/// The winged edges that the program prints: each line says of its neighbours what their lines say
/// of it.
#[test]
fn item_63_winged_edges_are_printed() {
    let directory = TestDirectory(tempfile::tempdir().unwrap());
    // A block through which a hole goes: 16 vertices, 24 edges, 10 faces, two of them with a ring.
    directory.model("hole.goblin", "difference(block(0,0,0, 9,9,3), block(3,3,-1, 6,6,4))");
    let text = stdout(&["dump", directory.path("hole.goblin").to_str().unwrap(), "--as", "winged-edge"]);
    let rows: HashMap<&str, Vec<Vec<&str>>> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let mut cells = line.split('\t');
            (cells.next().unwrap(), cells.map(|cell| cell.split(' ').collect()).collect())
        })
        .collect();
    let count = |letter: char| rows.keys().filter(|name| name.starts_with(letter)).count();
    assert_eq!(['v', 'e', 'f', 's'].map(count), [16, 24, 10, 1], "{text}");
    assert_eq!(rows["s0"].concat(), ["216", "10", "24", "48", "16"]);
    for (name, cells) in &rows {
        match name.as_bytes()[0] {
            b'v' => {
                let [_, shell, edges, faces, neighbours] = &cells[..] else { panic!("{cells:?}") };
                assert_eq!(
                    (shell[..] == ["s0"], edges.len(), faces.len(), neighbours.len()),
                    (true, 3, 3, 3)
                );
                assert!(edges.iter().all(|edge| rows[edge][0].contains(name)), "{name}");
                assert!(faces.iter().all(|face| rows[face][0].contains(name)), "{name}");
                assert!(neighbours.iter().all(|other| rows[other][4].contains(name)), "{name}");
            }
            b'e' => {
                let [ends, faces, left, right] = &cells[..] else { panic!("{cells:?}") };
                assert!(faces.iter().all(|face| rows[face][1].contains(name)), "{name}");
                for (face, around) in faces.iter().zip([left, right]) {
                    // Edges before and after it share a vertex with it, and are in the same face.
                    assert!(around.iter().all(|edge| rows[edge][1].contains(face)), "{name}");
                    assert!(around.iter().all(|edge| rows[edge][0].iter().any(|end| ends.contains(end))));
                }
            }
            b'f' => {
                let [vertices, edges, neighbours] = &cells[..] else { panic!("{cells:?}") };
                assert_eq!(vertices.len(), edges.len());
                assert!(neighbours.iter().all(|other| rows[other][2].contains(name)), "{name}");
            }
            _ => {}
        }
    }
}
