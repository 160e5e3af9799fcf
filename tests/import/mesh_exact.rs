//! Exact models written as meshes, read back, and compared face by face.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use spinney::brep::{Face, Faces, Grid};
use spinney::export::{MeshFormat, export_exact};
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::brep::{FaceList, Triangulated};
use spinney::raw::export::mesh::ExactSummary;
use spinney::raw::geometry::split_bridges;
use spinney::raw::import::mesh::open;
use spinney::{Error, Output, Progress, Result};

use crate::common::Random;
use crate::common::exact::{Ring, cuboid, prism, push, snapped, whole_grid};

/// A vertex with its colour.
type Corner = ([i32; 3], Option<[u8; 3]>);

/// A face independent of where its rings begin and of the order of its holes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Canonical {
    rings: Vec<Vec<Corner>>,
    part: String,
}

fn canonical(face: &Face<'_>, parts: &[String], with_colours: bool, part: bool) -> Canonical {
    let mut start = 0;
    let mut rings = Vec::new();
    for &end in face.ring_ends {
        let colour = |i: usize| face.colours.get(i).copied().filter(|_| with_colours);
        let mut ring: Vec<_> = (start..end).map(|i| (face.points[i], colour(i))).collect();
        let least = (0..ring.len()).min_by_key(|&i| ring[i]).unwrap();
        ring.rotate_left(least);
        rings.push(ring);
        start = end;
    }
    rings[1..].sort();
    Canonical { rings, part: if part { parts[face.part as usize].clone() } else { String::new() } }
}

fn all(faces: &dyn Faces, with_colours: bool, with_parts: bool) -> Vec<Canonical> {
    let mut all = Vec::new();
    faces
        .each(&mut |face| {
            all.push(canonical(face, faces.parts(), with_colours, with_parts));
            Ok(())
        })
        .unwrap();
    all
}

/// Reads a file onto a grid; rings joined by bridges become separate rings.
fn read(path: &Path, grid: &Grid) -> FaceList {
    let mut model = open(path, 64 << 20).unwrap();
    let mut list = FaceList::new(grid.clone(), model.info().parts.clone());
    let mut number = 0;
    model
        .faces(&mut |face| {
            let snapped: Ring = face.points.iter().map(|point| grid.snap(*point).unwrap()).collect();
            let (mut points, mut colours, mut ring_ends) = (Vec::new(), Vec::new(), Vec::new());
            let mut start = 0;
            for &end in face.ring_ends {
                let wide: Vec<[i64; 3]> =
                    snapped[start..end].iter().map(|point| point.map(i64::from)).collect();
                for ring in split_bridges(&wide) {
                    for corner in ring {
                        points.push(snapped[start + corner as usize]);
                        colours.extend(face.colours.get(start + corner as usize));
                    }
                    ring_ends.push(points.len());
                }
                start = end;
            }
            let (part, source) = (face.part, number);
            list.push(&Face {
                number,
                points: &points,
                ring_ends: &ring_ends,
                colours: &colours,
                part,
                source,
            });
            number += 1;
            Ok(())
        })
        .unwrap();
    list
}

const NAMES: [&str; 4] = ["a.ply", "a.obj", "a.off", "a.city.json"];

fn write(faces: &dyn Faces, path: &Path) -> ExactSummary {
    let format = MeshFormat::of(path).unwrap();
    export_exact(faces, format, Output::create(path).unwrap(), &()).unwrap()
}

/// Writes all formats and reads them again.
fn round_trip(faces: &dyn Faces) {
    let directory = tempfile::tempdir().unwrap();
    let has_colours = all(faces, true, false).iter().any(|face| face.rings[0][0].1.is_some());
    for name in NAMES {
        let path = directory.path().join(name);
        let summary = write(faces, &path);
        let found = read(&path, faces.grid());
        let (is_json, is_obj) = (name.ends_with("json"), name.ends_with("obj"));
        let divided = match MeshFormat::of(&path) {
            Some(MeshFormat::Ply) => Some(Triangulated::of(faces).unwrap()),
            Some(MeshFormat::Obj | MeshFormat::Off) => Some(Triangulated::of_concave(faces).unwrap()),
            _ => None,
        };
        let faces = divided.as_ref().map_or(faces, |divided| divided);
        let (with_colours, with_parts) = (!is_json, is_obj || is_json);
        let (mut got, mut expected) =
            (all(&found, with_colours, with_parts), all(faces, with_colours, with_parts));
        if is_json {
            // Faces of a part are grouped.
            got.sort();
            expected.sort();
            assert_eq!(found.parts().len(), faces.parts().len());
        }
        assert_eq!(got, expected, "{name}");
        assert_eq!(summary.faces, faces.len());
        assert_eq!(summary.lost_colours, has_colours && is_json, "{name}");
        assert_eq!(summary.lost_parts, faces.parts().len() > 1 && !with_parts, "{name}");
        // Writing again gives the same bytes.
        let again = directory.path().join(format!("again-{name}"));
        write(&found, &again);
        if !is_json || faces.parts().len() == 1 {
            let same = std::fs::read(&again).unwrap().len() == std::fs::read(&path).unwrap().len();
            assert!(same, "{name}");
        }
    }
}

fn square(x: i32, y: i32, side: i32) -> Vec<[i32; 2]> {
    vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]]
}

fn hole(x: i32, y: i32, side: i32) -> Vec<[i32; 2]> {
    let mut ring = square(x, y, side);
    ring.reverse();
    ring
}

#[test]
fn faces_round_trip() {
    let mut list = FaceList::new(whole_grid(), vec!["mesh".into()]);
    for rings in prism(&[square(0, 0, 90), hole(10, 10, 9), hole(50, 5, 30), hole(7, 60, 20)], 0, 33) {
        push(&mut list, &rings, 0, None);
    }
    round_trip(&list);
    round_trip(&FaceList::new(whole_grid(), vec!["mesh".into()]).with(&[vec![vec![
        [0, 0, 0],
        [5, 5, 5],
        [9, 0, 1],
    ]]]));
}

trait With {
    fn with(self, faces: &[Vec<Ring>]) -> Self;
}

impl With for FaceList {
    fn with(mut self, faces: &[Vec<Ring>]) -> FaceList {
        faces.iter().for_each(|rings| push(&mut self, rings, 0, None));
        self
    }
}

#[test]
fn colours_and_parts_round_trip() {
    let names = ["roof", "wall \"south\"", "Dach \u{e4}\u{4e2d}", "empty", "last one"];
    let mut list = FaceList::new(whole_grid(), names.iter().map(|name| name.to_string()).collect());
    let part = [0, 1, 2, 4];
    for (i, rings) in prism(&[square(0, 0, 90), hole(10, 10, 9)], 0, 33).iter().enumerate() {
        push(&mut list, rings, part[i % 4], Some([i as u8, 255 - i as u8, 7]));
    }
    round_trip(&list);
    // Vertices of a face with different colours.
    let mut shaded = FaceList::new(whole_grid(), vec!["mesh".into()]);
    let mut random = Random(1);
    list.each(&mut |face| {
        let colours: Vec<[u8; 3]> = face.points.iter().map(|_| [0; 3].map(|_| random.next() as u8)).collect();
        shaded.push(&Face { colours: &colours, part: 0, ..*face });
        Ok(())
    })
    .unwrap();
    round_trip(&shaded);
}

#[test]
fn names_that_make_trouble() {
    let names = ["", "a", "a", "back\\", "two\nlines", "a (2)"];
    let mut list = FaceList::new(whole_grid(), names.iter().map(|name| name.to_string()).collect());
    for part in 0..6 {
        let at = 10 * part as i32;
        push(&mut list, &[vec![[at, 0, 0], [at + 5, 0, 0], [at, 5, 0]]], part, None);
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.city.json");
    write(&list, &path);
    let found = read(&path, list.grid());
    assert_eq!(found.parts(), ["", "a", "a (2)", "back\\", "two\nlines", "a (2) (2)"]);
    assert_eq!(all(&found, false, false), all(&list, false, false));
    let path = directory.path().join("a.obj");
    write(&list, &path);
    let found = read(&path, list.grid());
    assert_eq!(found.parts(), ["", "a", "back_", "two_lines", "a (2)"]);
    assert_eq!(all(&found, false, false), all(&list, false, false));
}

/// Grids of decimals, of powers of two, and far from the origin.
#[test]
fn coordinates_round_trip() {
    for (bounds, width) in [
        ([[84_000.001, 446_000.123, -3.7], [84_900.5, 446_999.25, 120.0]], Some(0.001)),
        ([[-0.435, -0.57, -0.38], [0.4, 0.42, 0.38]], None),
        ([[1e9, -1e9, 0.0], [1e9 + 5.0, 5.0 - 1e9, 1.0]], None),
    ] {
        let grid = Grid::over(bounds, width).unwrap();
        let mut random = Random(9);
        let mut list = FaceList::new(grid.clone(), vec!["mesh".into()]);
        let directory = tempfile::tempdir().unwrap();
        for _ in 0..500 {
            let mut point = || {
                [0, 1, 2].map(|axis| {
                    let (low, high) = (bounds[0][axis], bounds[1][axis]);
                    low + (high - low) * random.below(1 << 30) as f64 / (1u64 << 30) as f64
                })
            };
            let ring: Ring = (0..3).map(|_| grid.snap(point()).unwrap()).collect();
            if ring[0] != ring[1] && ring[1] != ring[2] && ring[2] != ring[0] {
                push(&mut list, &[ring], 0, None);
            }
        }
        for name in NAMES {
            let path = directory.path().join(name);
            write(&list, &path);
            assert_eq!(all(&read(&path, &grid), false, false), all(&list, false, false), "{name}");
            // Bit-exact, except for CityJSON.
            if !name.ends_with("json") {
                let mut model = open(&path, 1 << 20).unwrap();
                model
                    .faces(&mut |face| {
                        for point in face.points {
                            assert_eq!(grid.to_world(grid.snap(*point).unwrap()), *point);
                        }
                        Ok(())
                    })
                    .unwrap();
            }
        }
    }
}

#[test]
fn faces_with_very_many_corners() {
    let mut outline = Vec::new();
    for i in 0..400 {
        outline.push([i, 0]);
    }
    for i in (0..400).rev() {
        outline.push([i, 300 + i % 2]);
    }
    let list =
        FaceList::new(whole_grid(), vec!["mesh".into()]).with(&prism(&[outline, hole(9, 9, 100)], 0, 9));
    round_trip(&list);
}

/// A file has each vertex of the model once.
#[test]
fn vertices_are_shared() {
    let mut list = FaceList::new(whole_grid(), vec!["mesh".into()]);
    for (i, rings) in cuboid([0; 3], [9; 3]).iter().enumerate() {
        push(&mut list, rings, 0, Some([i as u8, 0, 0]));
    }
    let directory = tempfile::tempdir().unwrap();
    let vertices: BTreeMap<&str, u64> =
        NAMES.iter().map(|name| (*name, write(&list, &directory.path().join(name)).vertices)).collect();
    // PLY and OFF store colours per face, OBJ per vertex.
    assert_eq!(vertices, BTreeMap::from([("a.ply", 8), ("a.obj", 24), ("a.off", 8), ("a.city.json", 8)]));
    let text = std::fs::read_to_string(directory.path().join("a.city.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["CityObjects"]["mesh"]["geometry"][0]["type"], "Solid");
    let mut open = FaceList::new(whole_grid(), vec!["mesh".into()]);
    cuboid([0; 3], [9; 3])[1..].iter().for_each(|rings| push(&mut open, rings, 0, None));
    write(&open, &directory.path().join("b.json"));
    let text = std::fs::read_to_string(directory.path().join("b.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["CityObjects"]["mesh"]["geometry"][0]["type"], "MultiSurface");
}

/// An STL file is closed like the faces if single precision is exact for all coordinates.
#[test]
fn stl_is_closed() {
    let mut faces = prism(&[square(0, 0, 90), hole(10, 10, 9), hole(50, 5, 30)], 0, 33);
    // A sliver of five vertices that fills a gap.
    let side = faces[2][0].clone();
    let [a, b] = [side[0], side[1]];
    let middle = [1, 2, 3].map(|i| [0, 1, 2].map(|axis| a[axis] + (b[axis] - a[axis]) / 90 * 10 * i));
    faces[2][0].splice(1..1, middle);
    faces.push(vec![vec![a, b, middle[2], middle[1], middle[0]]]);
    let list = FaceList::new(whole_grid(), vec!["mesh".into()]).with(&faces);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.stl");
    let summary = write(&list, &path);
    assert_eq!((summary.moved, summary.farthest, summary.collapsed), (0, 0.0, 0));
    let found = read(&path, list.grid());
    assert_eq!(found.len(), summary.faces);
    let (before, after) = [&list, &found]
        .map(|faces| {
            let made = Topology::of(faces, &TopologyOptions::default(), &()).unwrap();
            assert!(made.is_closed());
            (made.shells(), made.euler().genus)
        })
        .into();
    assert_eq!(before, after);
}

#[test]
fn stl_reports_moved_vertices() {
    let grid = Grid::over([[1e6, 0.0, 0.0], [1e6 + 1.0, 1000.0, 1.0]], Some(0.001)).unwrap();
    let mut list = FaceList::new(grid, vec!["a".into(), "b".into()]);
    // Single precision has a resolution of one sixteenth there.
    push(&mut list, &[vec![[0, 0, 0], [501, 0, 0], [0, 1_000_000, 0]]], 0, Some([1; 3]));
    push(&mut list, &[vec![[0, 0, 0], [1, 0, 0], [0, 1_000_000, 0]]], 1, Some([1; 3]));
    let directory = tempfile::tempdir().unwrap();
    let summary = write(&list, &directory.path().join("a.stl"));
    assert_eq!((summary.faces, summary.collapsed, summary.moved), (1, 1, 1));
    assert!((summary.farthest - 0.001).abs() < 1e-9, "{}", summary.farthest);
    assert!(summary.lost_colours && summary.lost_parts);
}

/// A plate of unit height with a round hole whose vertices single precision moves: all triangles of
/// the lid keep its orientation, and their areas sum to that of the moved polygon.
#[test]
fn stl_triangles_are_those_of_the_moved_polygon() {
    let mut random = Random(3);
    for count in [16, 48, 64, 80] {
        let grid = Grid::over([[0.0; 3], [100.0; 3]], Some(2e-6)).unwrap();
        let mut list = FaceList::new(grid, vec!["mesh".into()]);
        let radius = 2e6 + f64::from(random.below(4_000_000) as u32);
        let circle: Vec<[i32; 2]> = (0..count)
            .rev()
            .map(|i| f64::from(i) * std::f64::consts::TAU / f64::from(count))
            .map(|angle| [angle.cos(), angle.sin()].map(|at| (2.5e7 + radius * at) as i32))
            .collect();
        let rings = prism(&[square(0, 0, 50_000_000 - 1), circle.clone()], 0, 500_000);
        rings.iter().for_each(|rings| push(&mut list, rings, 0, None));
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.stl");
        let summary = write(&list, &path);
        assert!(summary.moved > 0 && summary.reversed == 0 && summary.collapsed == 0, "{summary:?}");
        let mut area = 0.0;
        open(&path, 1 << 20)
            .unwrap()
            .faces(&mut |face| {
                let [a, b, c] = [0, 1, 2].map(|corner| face.points[corner]);
                if [a, b, c].iter().all(|point| point[2] == 1.0) {
                    let doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                    assert!(doubled >= 0.0, "{count}: a triangle of {doubled}");
                    area += doubled / 2.0;
                }
                Ok(())
            })
            .unwrap();
        // Shoelace formula of the moved rings.
        let moved = |ring: &[[i32; 2]]| -> f64 {
            let at: Vec<[f64; 2]> =
                ring.iter().map(|point| point.map(|at| f64::from((f64::from(at) / 5e5) as f32))).collect();
            let pairs = at.iter().zip(at.iter().cycle().skip(1));
            pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
        };
        let expected = moved(&square(0, 0, 50_000_000 - 1)) + moved(&circle);
        assert!((area - expected).abs() < 1e-9 * expected, "{count}: {area}, expected {expected}");
    }
}

#[test]
fn real_models_round_trip() {
    for name in ["fandisk.ply", "spot.obj", "cityjson/DH_01_subs.city.json", "cityjson/rotterdam_subset.json"]
    {
        let Some(faces) = snapped(name, &|_| true) else { continue };
        let directory = tempfile::tempdir().unwrap();
        for to in NAMES {
            let path = directory.path().join(to);
            let summary = write(&faces, &path);
            println!("{name} to {to}: {summary:?}");
            let found = read(&path, faces.grid());
            let count = |faces: &FaceList| {
                let mut count = HashMap::new();
                all(faces, false, false)
                    .into_iter()
                    .for_each(|face| *count.entry(format!("{face:?}")).or_insert(0) += 1);
                count
            };
            let divided = match to.rsplit('.').next() {
                Some("ply") => Some(Triangulated::of(&faces).unwrap()),
                Some("obj" | "off") => Some(Triangulated::of_concave(&faces).unwrap()),
                _ => None,
            };
            let mut expected = FaceList::new(faces.grid().clone(), faces.parts().to_vec());
            let mut take = |face: &Face<'_>| {
                expected.push(face);
                Ok(())
            };
            match &divided {
                Some(divided) => divided.each(&mut take).unwrap(),
                None => faces.each(&mut take).unwrap(),
            }
            assert!(count(&found) == count(&expected), "{name} to {to}");
        }
    }
}

/// Cancels after a number of checks.
struct Stop(std::sync::atomic::AtomicI64);

impl Progress for Stop {
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) <= 0
    }
}

#[test]
fn cancellation_leaves_no_files() {
    let list = FaceList::new(whole_grid(), vec!["mesh".into()]).with(&cuboid([0; 3], [9; 3]));
    let directory = tempfile::tempdir().unwrap();
    for name in ["a.ply", "a.obj", "a.off", "a.city.json", "a.stl"] {
        let path = directory.path().join(name);
        let mut checks = 0;
        loop {
            let output = Output::create(&path).unwrap();
            let format = MeshFormat::of(&path).unwrap();
            let result: Result<_> = export_exact(&list, format, output, &Stop(checks.into()));
            match result {
                Ok(_) => break,
                Err(Error::Interrupted) => assert!(!path.exists()),
                Err(error) => panic!("{error}"),
            }
            checks += 1;
        }
        assert!(checks > 0 && path.exists());
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
        std::fs::remove_file(&path).unwrap();
    }
}
