//! Levels of detail of exact models: each level and each cut is closed, per object, and within its
//! bound of the exact surface.

use std::collections::HashMap;
use std::path::Path;

use spinney::brep::{
    Faces, Grid, ModelSurface, Motion, SurfaceDetail, TransformOptions, add_levels, combine, transform,
    with_levels,
};
use spinney::raw::brep::query::nearest_on_face;
use spinney::raw::brep::{FaceList, ModelBuilder};
use spinney::{Codec, Error, ExactModel, Metadata, OpenOptions, Output, Progress, SetOperation};

use crate::common::Random;
use crate::common::exact::{bumpy_torus, cuboid, push, turned};

const MEMORY: u64 = 64 << 20;

/// Adds levels to a model; returns the bytes of the file.
fn levelled(model: &ExactModel, memory: u64) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("levels.goblin");
    add_levels(model, (Output::create(&path).unwrap(), model.codec()), memory, &()).unwrap();
    std::fs::read(&path).unwrap()
}

pub(super) fn with_levels_of(list: &FaceList) -> ExactModel {
    ExactModel::from_bytes(levelled(&built_model(list), MEMORY)).unwrap()
}

pub(super) fn built_model(list: &FaceList) -> ExactModel {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("model.goblin");
    let mut builder = ModelBuilder::new(Output::create(&path).unwrap(), list.grid().clone(), MEMORY).unwrap();
    list.each(&mut |face| builder.push(face)).unwrap();
    list.parts().iter().for_each(|part| builder.part(part, None).unwrap());
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(std::fs::read(&path).unwrap()).unwrap()
}

/// Returns a number from 0 to 1.
pub(super) fn unit(random: &mut Random) -> f64 {
    (random.next() >> 11) as f64 / (1u64 << 53) as f64
}

pub(super) fn grid(bits: u8) -> Grid {
    Grid { bits, origin: [-100, 0, 5], step: 1.0, divisor: 1000.0 }
}

/// A closed box whose sides are divided into `n` x `n` squares of two triangles, as one part.
fn divided_box(list: &mut FaceList, low: [i32; 3], side: i32, n: i32, part: u32) {
    for face in cuboid([0; 3], [n; 3]) {
        // (Each side is a square ring of four vertices.)
        let [o, _, _, _] = face[0][..] else { panic!("a square") };
        let [u, v] = [face[0][1], face[0][3]].map(|end| [0, 1, 2].map(|axis| (end[axis] - o[axis]) / n));
        let at = |i: i32, j: i32| {
            [0, 1, 2].map(|axis| low[axis] + side / n * (o[axis] + u[axis] * i + v[axis] * j))
        };
        for i in 0..n {
            for j in 0..n {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                push(list, &[vec![a, b, c]], part, None);
                push(list, &[vec![a, c, d]], part, None);
            }
        }
    }
}

/// How often each edge occurs in its direction more than in the other one.
pub(super) type Surpluses = HashMap<[[i32; 3]; 2], i32>;

/// The directed edges that do not cancel, and six times the volume, of each part.
pub(super) type PartSums = HashMap<u32, (Surpluses, i128)>;

pub(super) fn by_part(faces: &dyn Faces) -> PartSums {
    let mut parts = PartSums::new();
    faces
        .each(&mut |face| {
            let (edges, volume) = parts.entry(face.part).or_default();
            for ring in face.rings() {
                for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                    let (edge, sign) = if a < b { ([*a, *b], 1) } else { ([*b, *a], -1) };
                    *edges.entry(edge).or_default() += sign;
                }
            }
            *volume += face.six_volumes();
            Ok(())
        })
        .unwrap();
    parts.values_mut().for_each(|(edges, _)| edges.retain(|_, surplus| *surplus != 0));
    parts
}

/// Checks that a surface is closed where the exact one is, part by part, and oriented like it.
pub(super) fn check_surface(exact: &PartSums, surface: &ModelSurface, what: &str) {
    let found = by_part(surface);
    let mut count = 0;
    surface
        .each(&mut |face| {
            assert_eq!(face.number, count);
            count += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!(count, surface.len(), "{what}");
    // Parts that are not closed by themselves are closed together.
    let mut open = Surpluses::new();
    for (part, (edges, volume)) in &found {
        let (exact_edges, exact_volume) = &exact[part];
        if exact_edges.is_empty() {
            assert!(edges.is_empty(), "{what}, part {part}");
            assert_eq!(volume.signum(), exact_volume.signum(), "{what}, part {part}");
        }
        edges.iter().for_each(|(edge, surplus)| *open.entry(*edge).or_default() += surplus);
    }
    assert!(open.values().all(|surplus| *surplus == 0), "{what}");
}

fn check_closed(model: &ExactModel, exact: &PartSums, detail: SurfaceDetail) {
    let surface = model.surface(detail, None, &()).unwrap();
    check_surface(exact, &surface, &format!("{detail:?}"));
    let last = model.levels().len() - 1;
    if detail == SurfaceDetail::Level(last as u8) || detail == SurfaceDetail::Error(0.0) {
        assert_eq!(by_part(&surface).len(), exact.len());
        assert!(surface.is_exact() || surface.error() < 0.01);
    }
}

fn check_all_levels(model: &ExactModel, cuts: usize) {
    let levels = model.levels();
    assert!(levels.len() > 2, "{levels:?}");
    let exact = by_part(model);
    (0..levels.len()).for_each(|level| check_closed(model, &exact, SurfaceDetail::Level(level as u8)));
    let coarsest = levels[0].error * model.grid().width();
    let mut random = Random(7);
    for _ in 0..cuts {
        // (Small errors choose between more groups.)
        let error = coarsest * 1.2 * unit(&mut random).powi(4);
        check_closed(model, &exact, SurfaceDetail::Error(error));
    }
    assert_eq!(model.verify(MEMORY, &()).unwrap(), []);
}

/// Checks the distance from the exact surface at some points, both ways.
fn check_distances(model: &ExactModel) {
    let mut random = Random(3);
    for level in 0..model.levels().len() - 1 {
        let surface = model.surface(SurfaceDetail::Level(level as u8), None, &()).unwrap();
        let coarse = FaceList::of(&surface).unwrap();
        let bound = surface.error();
        let mut farthest: f64 = 0.0;
        let weights = |random: &mut Random| {
            let [a, b] = [unit(random), unit(random)];
            let [a, b] = if a + b > 1.0 { [1.0 - a, 1.0 - b] } else { [a, b] };
            [a, b, 1.0 - a - b]
        };
        let point = |points: &[[i32; 3]], weights: [f64; 3]| {
            [0, 1, 2].map(|axis| (0..3).map(|i| weights[i] * f64::from(points[i][axis])).sum::<f64>())
        };
        let width = model.grid().width();
        for _ in 0..200 {
            let face = coarse.get((random.next() % coarse.len()) as usize);
            let on_grid = point(face.points, weights(&mut random));
            let world = [0, 1, 2].map(|axis| (on_grid[axis] + model.grid().origin[axis] as f64) * width);
            farthest = farthest.max(model.signed_distance(world).unwrap().abs());
        }
        for _ in 0..60 {
            let mut buffer = spinney::brep::FaceBuffer::default();
            model.face(random.next() % model.len(), &mut buffer).unwrap();
            let from = point(&buffer.points, weights(&mut random));
            let square = |number: usize| {
                let at = nearest_on_face(&coarse.get(number), from).point;
                (0..3).map(|axis| (at[axis] - from[axis]).powi(2)).sum::<f64>()
            };
            let nearest = (0..coarse.len() as usize).map(square).fold(f64::INFINITY, f64::min);
            farthest = farthest.max(nearest.sqrt() * width);
        }
        assert!(farthest <= bound, "level {level}: {farthest}, bound {bound}");
        assert!(bound <= 6.0 * farthest + width, "level {level}: {farthest}, bound {bound}");
    }
}

#[test]
fn levels_and_cuts_of_a_scan_are_closed_and_within_their_bounds() {
    let model = with_levels_of(&bumpy_torus(160, 100, grid(16)));
    let levels = model.levels();
    assert!(levels.is_sorted_by(|coarse, fine| coarse.faces < fine.faces && coarse.error > fine.error));
    assert!(levels[0].faces <= 256 && levels.last().unwrap().error == 0.0, "{levels:?}");
    check_all_levels(&model, 250);
    check_distances(&model);
    assert!(model.surface(SurfaceDetail::Faces(u64::MAX), None, &()).unwrap().is_exact());
    for error in [1e300, f64::MAX, f64::INFINITY] {
        assert_eq!(model.surface(SurfaceDetail::Error(error), None, &()).unwrap().len(), levels[0].faces);
    }
    // A quarter of the faces remain at each level.
    let half = model.surface(SurfaceDetail::Faces(16_000), None, &()).unwrap();
    assert!((2000..=16_000).contains(&half.len()), "{}", half.len());
}

/// Boxes of many sizes, some of which share walls, around and in each other.
pub(super) fn boxes_that_touch() -> FaceList {
    let mut random = Random(5);
    let mut list = FaceList::new(grid(16), (0..300).map(|part| format!("box {part}")).collect());
    for part in 0..300i32 {
        let (row, column) = (part / 20, part % 20);
        let n = 1 + (random.next() % 5) as i32;
        // Every third box touches its neighbour.
        let side = if part % 3 == 0 { 3000 } else { 300 * n };
        divided_box(&mut list, [column * 3000 + 10, row * 3000 + 10, 50], side / n * n, n, part as u32);
    }
    list
}

#[test]
fn objects_are_simplified_apart_and_disappear_by_size() {
    let model = with_levels_of(&boxes_that_touch());
    check_all_levels(&model, 500);
    let levels = model.levels();
    let coarsest = &levels[0];
    assert!(coarsest.vanished > 0 && coarsest.vanished_diameter <= coarsest.error, "{coarsest:?}");
    // Boxes are divided without need: they become simpler without an error.
    let flat = model.surface(SurfaceDetail::Error(0.001), None, &()).unwrap();
    assert!(flat.len() * 2 < model.len(), "{} of {}", flat.len(), model.len());
}

/// A hollow body whose parts are materials that are not closed by themselves.
pub(super) fn materials_around_a_cavity() -> FaceList {
    let mut list = FaceList::new(grid(14), vec!["top".into(), "rest".into()]);
    let mut whole = FaceList::new(grid(14), vec!["one".into()]);
    divided_box(&mut whole, [100; 3], 12_000, 40, 0);
    let mut cavity = FaceList::new(grid(14), vec!["one".into()]);
    divided_box(&mut cavity, [4000; 3], 3000, 30, 0);
    for face in (0..whole.len()).map(|number| whole.get(number as usize)) {
        let is_top = face.points.iter().all(|point| point[2] == 12_100);
        push(&mut list, &[face.points.to_vec()], u32::from(!is_top), Some([200, 7, u8::from(is_top)]));
    }
    for face in (0..cavity.len()).map(|number| cavity.get(number as usize)) {
        push(&mut list, &turned(vec![vec![face.points.to_vec()]])[0], 1, Some([1, 2, 3]));
    }
    list
}

#[test]
fn cavities_and_materials_keep_their_borders() {
    let model = with_levels_of(&materials_around_a_cavity());
    let exact = by_part(&model);
    for level in 0..model.levels().len() {
        check_closed(&model, &exact, SurfaceDetail::Level(level as u8));
    }
    assert_eq!(model.verify(MEMORY, &()).unwrap(), []);
    let coarse = model.surface(SurfaceDetail::Level(0), None, &()).unwrap();
    assert!(coarse.len() * 8 < model.len(), "{} of {}", coarse.len(), model.len());
    coarse
        .each(&mut |face| {
            let expected = if face.part == 0 { [200, 7, 1] } else { face.colours[0] };
            assert!(face.colours.iter().all(|colour| *colour == expected), "{face:?}");
            Ok(())
        })
        .unwrap();
}

/// Faces without area are in no octree; cuts with exact faces have them nevertheless.
#[test]
fn slivers_keep_surfaces_closed() {
    let mut list = bumpy_torus(60, 40, grid(16));
    let n = list.len() as usize;
    let mut with_slivers = FaceList::new(grid(16), vec!["torus".into()]);
    for number in 0..n {
        push(&mut with_slivers, &[list.get(number).points.to_vec()], 0, None);
    }
    // A box with a vertex in the middle of an edge, on one side only.
    let mut rings = cuboid([60_000; 3], [60_010; 3]);
    rings.push(vec![vec![[60_000; 3], [60_005, 60_000, 60_000], [60_010, 60_000, 60_000]]]);
    let bottom = rings.iter_mut().find(|face| face[0].iter().all(|point| point[2] == 60_000)).unwrap();
    let ring = &mut bottom[0];
    let edge = (0..4).find(|at| ring[*at][1] == 60_000 && ring[(at + 1) % 4][1] == 60_000).unwrap();
    let is_forward = ring[edge][0] == 60_000;
    ring.insert(edge + 1, [60_005, 60_000, 60_000]);
    if is_forward {
        rings.last_mut().unwrap()[0].reverse();
    }
    rings.iter().for_each(|face| push(&mut with_slivers, face, 0, None));
    list = with_slivers;
    let model = with_levels_of(&list);
    check_all_levels(&model, 250);
}

#[test]
fn bytes_do_not_depend_on_memory_and_threads() {
    let model = built_model(&bumpy_torus(120, 90, grid(16)));
    let expected = levelled(&model, MEMORY);
    assert!(levelled(&model, 4 << 20) == expected, "less memory");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| levelled(&model, MEMORY)) == expected, "{threads} threads");
    }
    // Levels are replaced, not added to.
    let again = levelled(&ExactModel::from_bytes(expected.clone()).unwrap(), MEMORY);
    assert!(again == expected);
}

/// A box query returns the clusters that touch the box.
#[test]
fn a_box_has_the_faces_that_touch_it() {
    let model = with_levels_of(&bumpy_torus(160, 100, grid(16)));
    let within = [[10.0, 10.0, 0.0], [20.0, 30.0, 60.0]];
    let last = model.levels().len() as u8 - 1;
    for detail in [SurfaceDetail::Level(last - 1), SurfaceDetail::Error(0.01), SurfaceDetail::Error(0.0)] {
        let (all, some) =
            (model.surface(detail, None, &()).unwrap(), model.surface(detail, Some(within), &()).unwrap());
        let touching = |faces: &dyn Faces| {
            let mut found = Vec::new();
            let low = model.grid().to_grid(within[0]);
            let high = model.grid().to_grid(within[1]);
            faces
                .each(&mut |face| {
                    let is_in = (0..3).all(|axis| {
                        face.points.iter().any(|point| f64::from(point[axis]) >= low[axis])
                            && face.points.iter().any(|point| f64::from(point[axis]) <= high[axis])
                    });
                    found.extend(is_in.then(|| face.points.to_vec()));
                    Ok(())
                })
                .unwrap();
            found.sort();
            found
        };
        assert_eq!(touching(&all), touching(&some), "{detail:?}");
        assert!(some.len() < all.len() && !touching(&some).is_empty());
    }
}

/// The exact surface in a box, of files with and without levels, also read at positions: all faces
/// with a vertex in the box, others only if their boxes touch it; with their numbers and values.
#[test]
fn a_box_has_exact_faces_with_their_values() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("model.goblin");
    let list = bumpy_torus(80, 50, grid(16));
    let mut builder = ModelBuilder::new(Output::create(&path).unwrap(), list.grid().clone(), MEMORY).unwrap();
    let add = &mut |face: &spinney::brep::Face<'_>| {
        builder.push(face)?;
        builder.face_value("number", &face.number.to_string())
    };
    list.each(add).unwrap();
    builder.finish(&mut Metadata::default(), &()).unwrap();
    let plain = ExactModel::open(&path, &OpenOptions::new().positioned(1 << 16)).unwrap();
    let levels = ExactModel::from_bytes(levelled(&plain, MEMORY)).unwrap();
    for model in [&plain, &levels] {
        for within in
            [[[10.0, 10.0, 0.0], [20.0, 30.0, 60.0]], [[-1e300; 3], [1e300; 3]], [[900.0; 3], [901.0; 3]]]
        {
            let surface = model.surface(SurfaceDetail::Exact, Some(within), &()).unwrap();
            assert!(surface.is_exact() && surface.error() == 0.0 && surface.numbers().is_empty());
            assert_eq!(surface.value_columns().unwrap(), ["number"]);
            let mut expected = surface.numbers_of_faces().unwrap();
            let mut found = std::collections::BTreeSet::new();
            let check = &mut |face: &spinney::brep::Face<'_>, values: &[Option<String>]| {
                assert_eq!(face.number, found.len() as u64);
                let number = u64::from(expected.next().unwrap());
                assert_eq!(values, [Some(number.to_string())]);
                assert_eq!(face.points, list.get(number as usize).points);
                found.insert(number);
                Ok(())
            };
            surface.each_with_values(&["number"], check).unwrap();
            assert_eq!(found.len() as u64, surface.len());
            let world = |point: &[i32; 3]| model.grid().to_world(*point);
            for number in 0..list.len() {
                let points: Vec<[f64; 3]> = list.get(number as usize).points.iter().map(world).collect();
                let is_within = |at: &[f64; 3]| {
                    (0..3).all(|axis| (within[0][axis]..=within[1][axis]).contains(&at[axis]))
                };
                let touches = (0..3).all(|axis| {
                    points.iter().any(|at| at[axis] >= within[0][axis])
                        && points.iter().any(|at| at[axis] <= within[1][axis])
                });
                let is_found = found.contains(&number);
                assert!(is_found || !points.iter().any(is_within), "face {number}");
                assert!(!is_found || touches, "face {number}");
            }
        }
        for wrong in [[[1.0; 3], [0.0; 3]], [[f64::NAN; 3], [1.0; 3]]] {
            let error = model.surface(SurfaceDetail::Exact, Some(wrong), &()).err().unwrap().to_string();
            assert!(error.contains("minimum coordinates"), "{error}");
        }
        let whole = model.surface(SurfaceDetail::Exact, None, &()).unwrap();
        assert_eq!((whole.len(), by_part(&whole)), (model.len(), by_part(model)));
    }
}

#[test]
fn packed_files_have_the_same_levels() {
    let model = built_model(&bumpy_torus(100, 60, grid(16)));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("packed.goblin");
    add_levels(&model, (Output::create(&path).unwrap(), Codec::Packed), MEMORY, &()).unwrap();
    let packed = ExactModel::open(&path, &OpenOptions::new()).unwrap();
    let plain = ExactModel::from_bytes(levelled(&model, MEMORY)).unwrap();
    assert_eq!(packed.verify(MEMORY, &()).unwrap(), []);
    assert!(packed.file_size() * 2 < plain.file_size());
    for level in 0..plain.levels().len() {
        let faces = |model: &ExactModel| {
            let surface = model.surface(SurfaceDetail::Level(level as u8), None, &()).unwrap();
            let mut found = Vec::new();
            surface
                .each(&mut |face| {
                    found.push((face.points.to_vec(), face.part));
                    Ok(())
                })
                .unwrap();
            found
        };
        assert_eq!(faces(&packed), faces(&plain), "level {level}");
    }
}

/// Corrupt coarse faces are reported where they are used, and leave exact results as they are.
#[test]
fn corrupt_levels_are_reported_and_leave_exact_results() {
    let model = with_levels_of(&bumpy_torus(80, 50, grid(16)));
    let bytes = levelled(&model, MEMORY);
    let exact = FaceList::of(&model).unwrap();
    let plain = built_model(&bumpy_torus(80, 50, grid(16))).file_size();
    let mut random = Random(1);
    let mut reported = 0;
    for _ in 0..200 {
        // (Coarse faces are written after all else but the lists.)
        let mut bytes = bytes.clone();
        let end = bytes.len() as u64 - 2000;
        let at = (plain - 2000 + random.next() % (end - plain + 2000)) as usize;
        bytes[at] ^= 1 << (random.next() % 8);
        let Ok(model) = ExactModel::from_bytes(bytes) else { continue };
        let read: Vec<_> = (0..model.levels().len() - 1)
            .map(|level| {
                model
                    .surface(SurfaceDetail::Level(level as u8), None, &())
                    .and_then(|surface| FaceList::of(&surface))
            })
            .collect();
        let failed = read.iter().any(|read| matches!(read, Err(Error::Corrupt { .. })));
        assert!(read.iter().all(|read| matches!(read, Ok(_) | Err(Error::Corrupt { .. }))));
        if failed {
            reported += 1;
            assert_ne!(model.verify(MEMORY, &()).unwrap(), []);
            let same = FaceList::of(&model).unwrap();
            assert_eq!(same.get(77), exact.get(77));
        }
    }
    assert!(reported > 20, "{reported}");
}

#[test]
fn files_without_levels_say_how_to_add_them() {
    let model = built_model(&bumpy_torus(20, 10, grid(16)));
    assert!(model.levels().is_empty());
    let error = model.surface(SurfaceDetail::Faces(10), None, &()).err().unwrap().to_string();
    assert!(error.contains("without levels of detail") && error.contains("transform FILE levels"), "{error}");
    let model = with_levels_of(&bumpy_torus(40, 30, grid(16)));
    for (detail, expected) in [
        (SurfaceDetail::Level(9), "level: got 9, expected at most"),
        (SurfaceDetail::Error(-1.0), "error: got -1"),
        (SurfaceDetail::Error(f64::NAN), "error: got NaN"),
        (SurfaceDetail::Faces(3), "faces: got 3, expected at least"),
    ] {
        let error = model.surface(detail, None, &()).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// A model that is not written, since it has defects, gets no levels and leaves no files.
#[test]
fn models_with_defects_leave_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let report = with_levels(Output::create(&path).unwrap(), MEMORY, &(), |output| {
        let mut builder = ModelBuilder::new(output, grid(10), MEMORY).unwrap();
        let mut faces = FaceList::new(grid(10), vec!["crossing".into()]);
        let boxes = [cuboid([1; 3], [9; 3]), cuboid([5; 3], [12; 3])].concat();
        boxes.iter().for_each(|face| push(&mut faces, face, 0, None));
        faces.each(&mut |face| builder.push(face))?;
        builder.finish(&mut Metadata::default(), &())
    });
    assert!(report.unwrap().defect_count > 0);
    assert_eq!(files_in(directory.path()), 0);
}

fn files_in(directory: &Path) -> usize {
    std::fs::read_dir(directory).unwrap().count()
}

/// Exact clusters that stay in coarser levels have polygons there.
#[test]
fn levels_of_polygons_have_the_faces_that_they_state() {
    let parts = 600;
    let mut list = FaceList::new(grid(16), (0..parts).map(|part| format!("box {part}")).collect());
    let mut random = Random(9);
    for part in 0..parts {
        let [x, y] = [part % 30, part / 30].map(|at| at as i32 * 2000 + 5);
        let side = 100 + (random.next() % 1800) as i32;
        cuboid([x, y, 7], [x + side, y + side, 7 + side])
            .iter()
            .for_each(|face| push(&mut list, face, part, None));
    }
    let model = with_levels_of(&list);
    assert_eq!(model.verify(MEMORY, &()).unwrap(), []);
    let exact = by_part(&model);
    for (number, level) in model.levels().iter().enumerate() {
        let surface = model.surface(SurfaceDetail::Level(number as u8), None, &()).unwrap();
        assert_eq!(FaceList::of(&surface).unwrap().len(), level.faces);
        check_closed(&model, &exact, SurfaceDetail::Level(number as u8));
    }
}

#[test]
fn models_without_faces_have_the_exact_level() {
    let model = built_model(&FaceList::new(grid(10), vec![]));
    let model = ExactModel::from_bytes(levelled(&model, MEMORY)).unwrap();
    assert_eq!((model.levels().len(), model.verify(MEMORY, &()).unwrap()), (1, vec![]));
    for detail in [SurfaceDetail::Level(0), SurfaceDetail::Error(1.0), SurfaceDetail::Faces(0)] {
        assert_eq!(model.surface(detail, None, &()).unwrap().len(), 0);
    }
}

/// Warnings.
#[derive(Default)]
struct Warnings(std::sync::Mutex<Vec<String>>);

impl Progress for Warnings {
    fn warn(&self, _: &Path, text: &str) {
        self.0.lock().unwrap().push(text.into());
    }
}

#[test]
fn operations_that_drop_levels_say_so() {
    let mut list = FaceList::new(grid(16), vec!["box".into()]);
    divided_box(&mut list, [100; 3], 4096, 16, 0);
    let (plain, with_levels) = (built_model(&list), with_levels_of(&list));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("made.goblin");
    let mirror =
        Motion::from_rows([[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).unwrap();
    let mut replaced = TransformOptions::new(MEMORY);
    replaced.levels = true;
    for (model, count) in [(&plain, 0), (&with_levels, 1)] {
        let warnings = Warnings::default();
        let output = || Output::create(&path).unwrap();
        transform(model, &mirror, &TransformOptions::new(MEMORY), output(), &warnings).unwrap();
        let made = ExactModel::open(&path, &OpenOptions::new()).unwrap();
        let lines = &made.metadata().provenance;
        assert!(made.levels().is_empty() && !lines.iter().any(|line| line.contains("levels")), "{lines:?}");
        let union = SetOperation::ALL[7];
        combine(union, &[model, &plain], output(), Codec::Plain, MEMORY, &warnings).unwrap();
        transform(model, &mirror, &replaced, output(), &warnings).unwrap();
        let warnings = warnings.0.into_inner().unwrap();
        assert_eq!(warnings.len(), 2 * count, "{warnings:?}");
        assert!(
            warnings
                .iter()
                .all(|text| text.contains("no levels of detail") && text.contains("transform RESULT levels"))
        );
    }
}
