//! Models with an open part: only that part costs time and changes.

use spinney::import::mesh::{Resolution, SolidOptions, open_all, plan_models};
use spinney::query::EdgeRule;
use spinney::raw::import::mesh::{Attribute, InsideTest};
use spinney::{Dataset, Output, Value};

use crate::common::solid::{Point, Polygons, Triangle, build, cells, cuboid, plain, unit_cells, winding};
use crate::common::{Random, shared_data, with};

type Faces = Vec<(Triangle, u32, [u8; 3])>;

fn object(triangles: Vec<Triangle>, part: u32) -> Faces {
    triangles.into_iter().map(|triangle| (triangle, part, [10 * part as u8 + 5, 0, part as u8])).collect()
}

/// A row of boxes, each an object, at a distance of `step`.
fn row(count: u32, step: f64) -> Vec<Faces> {
    let of = |part: u32| {
        let x = 1.0 + f64::from(part) * step;
        object(cuboid([x, 5.0, 5.0], [x + 6.0, 11.0, 11.0]), part)
    };
    (0..count).map(of).collect()
}

fn labels(faces: Vec<Faces>, options: &SolidOptions) -> (Vec<Option<Value>>, InsideTest) {
    let (tree, report) = build(Polygons::of_triangles(faces.concat()), options);
    (cells(&tree), report.inside)
}

/// Returns the coordinates of a cell in a grid of 64 x 64 x 64.
fn at(index: usize) -> [usize; 3] {
    [index % 64, index / 64 % 64, index / 4096]
}

#[test]
fn one_open_object_changes_only_itself() {
    for (step, attribute) in
        [(8.0, Attribute::PartNumber), (8.0, Attribute::Colour), (6.0, Attribute::PartNumber)]
    {
        for edge in [EdgeRule::Centre, EdgeRule::Touch] {
            let options = with(unit_cells(6), |it| {
                it.attribute = attribute;
                it.edge = edge;
            });
            let closed = row(7, step);
            let (expected, inside) = labels(closed.clone(), &options);
            assert_eq!(inside, InsideTest::Closed);
            for open in [0, 3, 6] {
                let mut faces = closed.clone();
                // The face perpendicular to y.
                faces[open].drain(4..6);
                let (found, inside) = labels(faces, &options);
                assert_eq!(inside, InsideTest::Open);
                let own: Vec<usize> = (0..found.len()).filter(|i| found[*i] != expected[*i]).collect();
                let first = 1 + open * step as usize;
                // The open box loses some cells at the hole, and gains none.
                for index in &own {
                    assert!((first..first + 6).contains(&at(*index)[0]) && found[*index].is_none(), "{open}");
                }
                assert!(own.len() < 6 * 6 * 3, "{open}: {} cells", own.len());
            }
        }
    }
}

/// Checks that cells are full if the winding field of some object is at least one half, and that
/// the first such object gives the label. Cells whose fields are within the error bound are not
/// checked.
fn check_objects(objects: &[Vec<Triangle>], found: &[Option<Value>], side: usize, what: &str) {
    let boxes = objects.iter().map(|triangles| {
        let extreme = |axis: usize, pick: fn(f64, f64) -> f64, from: f64| {
            triangles.iter().flatten().map(|corner| corner[axis]).fold(from, pick)
        };
        [0, 1, 2]
            .map(|axis| [extreme(axis, f64::min, f64::INFINITY), extreme(axis, f64::max, f64::NEG_INFINITY)])
    });
    let boxes: Vec<_> = boxes.collect();
    let mut inside = 0;
    for (index, cell) in found.iter().enumerate() {
        let at = [index % side, index / side % side, index / side / side].map(|x| x as f64);
        let field = |object: usize| {
            let is_outside = (0..3)
                .any(|axis| at[axis] >= boxes[object][axis][1] || at[axis] + 1.0 <= boxes[object][axis][0]);
            let point = [at[0] + 0.5 + 1e-6, at[1] + 0.5 + 1e-8, at[2] + 0.5 + 1e-10];
            if is_outside { 0.0 } else { winding(&objects[object], point).abs() }
        };
        let fields: Vec<f64> = (0..objects.len()).map(field).collect();
        if fields.iter().any(|field| (field - 0.5).abs() <= BOUND) {
            continue;
        }
        let first = fields.iter().position(|field| *field >= 0.5);
        assert_eq!(*cell, first.map(|part| Value::from([part as u8 + 1])), "{what}: {at:?} {fields:?}");
        inside += usize::from(first.is_some());
    }
    assert!(inside > 100, "{what}: {inside} cells");
}

#[test]
fn open_objects_are_independent() {
    let options = with(unit_cells(6), |it| it.attribute = Attribute::PartNumber);
    // Boxes without a wall, next to each other with and without common edges, and nested.
    let box_of = |low: Point, high: Point, without: &[usize]| -> Vec<Triangle> {
        let faces = cuboid(low, high).into_iter().enumerate();
        faces.filter(|(index, _)| !without.contains(index)).map(|(_, face)| face).collect()
    };
    for step in [6.0, 7.0, 4.0] {
        let objects: Vec<Vec<Triangle>> = (0..5u8)
            .map(|part| {
                let x = 1.0 + f64::from(part) * step;
                let without: &[usize] = [&[2, 3][..], &[0, 1], &[6], &[2, 3, 8, 9], &[]][usize::from(part)];
                box_of([x, 5.0, 5.0], [x + 6.0, 11.0, 11.0 + f64::from(part)], without)
            })
            .collect();
        let faces = objects.iter().zip(0..).map(|(triangles, part)| object(triangles.clone(), part));
        let (found, inside) = labels(faces.collect(), &options);
        assert_eq!(inside, InsideTest::Open);
        // Closed objects take precedence over open ones.
        let order = [4usize, 0, 1, 2, 3];
        let relabel = |cell: &Option<Value>| {
            cell.map(|value| {
                let part = (0..5u8).find(|part| value == Value::from([part + 1])).unwrap();
                Value::from([order.iter().position(|at| *at == usize::from(part)).unwrap() as u8 + 1])
            })
        };
        let found: Vec<Option<Value>> = found.iter().map(relabel).collect();
        let ordered: Vec<Vec<Triangle>> = order.iter().map(|at| objects[*at].clone()).collect();
        check_objects(&ordered, &found, 64, &format!("step {step}"));
    }
}

#[test]
#[cfg(feature = "mesh")]
fn groups_are_of_one_object_and_objects_are_not() {
    // A box whose walls are separate objects, with a missing triangle.
    let text = |word: &str| {
        let (mut corners, mut text) = (0, String::new());
        for (index, triangle) in cuboid([0.0; 3], [4.0, 4.0, 8.0]).into_iter().enumerate().skip(1) {
            text += &format!("{word} wall {}\n", index / 2);
            for [x, y, z] in triangle {
                text += &format!("v {x} {y} {z}\n");
            }
            text += &format!("f {} {} {}\n", corners + 1, corners + 2, corners + 3);
            corners += 3;
        }
        text
    };
    let directory = tempfile::tempdir().unwrap();
    let [as_groups, as_objects] = ["g", "o"].map(|word| {
        let (path, output) = (directory.path().join("a.obj"), directory.path().join("a.goblin"));
        std::fs::write(&path, text(word)).unwrap();
        let options = with(SolidOptions::new(), |it| it.resolution = Resolution::Cell(0.5));
        let models = open_all(&[path], 64 << 20).unwrap();
        let plan = plan_models(models, &options).unwrap();
        plan.build(Output::create(&output).unwrap(), &()).unwrap().cells
    });
    assert!(as_groups > 900, "{as_groups} of 1024");
    assert!(as_objects < 750, "{as_objects} of 1024");
}

#[test]
#[cfg(feature = "mesh")]
fn houses_of_a_city_are_independent() {
    let Some(path) = shared_data().map(|directory| directory.join("mesh/cityjson/rotterdam_subset.json"))
    else {
        return;
    };
    if !path.is_file() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let mut model = open_all(&[path], 64 << 20).unwrap().remove(0);
    let origin = model.info().bounds[0];
    let mut objects = vec![Vec::new(); model.info().parts.len()];
    let mut faces = Vec::new();
    model
        .faces(&mut |face| {
            let mut first = 0;
            for end in face.ring_ends {
                // A cell is 4 m wide. For flat faces, fans give the same field as triangles.
                let ring = face.points[first..*end].iter();
                let ring: Vec<Point> =
                    ring.map(|point| [0, 1, 2].map(|axis| (point[axis] - origin[axis]) / 4.0)).collect();
                let fan = (2..ring.len()).map(|corner| [ring[0], ring[corner - 1], ring[corner]]);
                objects[face.part as usize].extend(fan.clone());
                faces.extend(fan.map(|triangle| (triangle, face.part, [0; 3])));
                first = *end;
            }
            Ok(())
        })
        .unwrap();
    let options = with(unit_cells(7), |it| it.attribute = Attribute::PartNumber);
    let (tree, report) = build(Polygons::of_triangles(faces), &options);
    assert_eq!(report.inside, InsideTest::Open);
    check_objects(&objects, &cells(&tree), 128, "Rotterdam");
}

#[test]
fn a_flipped_object_changes_no_labels() {
    let options = with(unit_cells(6), |it| it.attribute = Attribute::PartNumber);
    let closed = row(7, 8.0);
    let (expected, _) = labels(closed.clone(), &options);
    let mut faces = closed.clone();
    faces[2][8].0.swap(0, 1);
    faces[4].iter_mut().for_each(|(triangle, ..)| triangle.swap(0, 1));
    assert_eq!(labels(faces.clone(), &options), (expected.clone(), InsideTest::Flipped));
    // With an open object next to them.
    faces[6].drain(0..2);
    let (found, inside) = labels(faces, &options);
    assert_eq!(inside, InsideTest::Open);
    assert!((0..found.len()).all(|i| at(i)[0] >= 49 || found[i] == expected[i]));
}

#[test]
fn threads_do_not_change_the_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let mut faces = row(7, 6.0);
    faces[1].drain(2..4);
    faces[2].drain(2..4);
    faces[5].drain(0..1);
    let options = with(unit_cells(7), |it| it.attribute = Attribute::Colour);
    let bytes = [1, 3].map(|threads| {
        let path = directory.path().join("solid.goblin");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let import = plan_models(vec![Polygons::of_triangles(faces.concat())], &options).unwrap();
        pool.install(|| import.build(Output::create(&path).unwrap(), &())).unwrap();
        std::fs::read(&path).unwrap()
    });
    assert!(bytes[0] == bytes[1]);
}

#[test]
fn ground_and_houses_and_hollow_bodies() {
    // The ground is a bowl, deep enough to be full; the house in it is complete.
    let ground: Vec<Triangle> = cuboid([2.0, 2.0, 2.0], [60.0, 60.0, 40.0]).into_iter().skip(4).collect();
    let ground: Vec<Triangle> = ground.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let house = |low: Point, high: Point| cuboid(low, high);
    let faces = vec![object(ground, 0), object(house([20.0, 20.0, 41.0], [30.0, 30.0, 50.0]), 1)];
    let options = with(unit_cells(6), |it| it.attribute = Attribute::PartNumber);
    let (found, _) = labels(faces, &options);
    assert_eq!(found.iter().filter(|cell| **cell == Some(Value::from([2u8]))).count(), 10 * 10 * 9);
    // A cavity in a solid with a hole in another region of its surface remains a cavity.
    let mut inner = cuboid([20.0; 3], [40.0; 3]);
    inner.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    let outer = cuboid([4.0; 3], [60.0; 3]);
    // One of the two has a hole.
    let without = |faces: &[Triangle]| [&faces[..3], &faces[4..]].concat();
    for both in [[without(&outer), inner.clone()], [outer.clone(), without(&inner)]] {
        let (found, inside) = labels(vec![object(both.concat(), 0)], &options);
        assert_eq!(inside, InsideTest::Open);
        for (i, cell) in found.iter().enumerate() {
            let (cell, at) = (cell.is_some(), at(i));
            assert!(!cell || at.iter().any(|x| !(20..34).contains(x)), "{at:?}");
            assert!(cell || at.iter().any(|x| !(6..20).contains(x)), "{at:?}");
        }
    }
}

#[test]
#[cfg(feature = "mesh")]
fn files_with_open_objects() {
    let Some(directory) = shared_data().map(|directory| directory.join("hostile/mesh")) else { return };
    let build = |name: &str, attribute: Attribute, resolution: Resolution| -> Option<Dataset> {
        let path = directory.join(name);
        if !path.is_file() {
            eprintln!("skipped: {} is not there", path.display());
            return None;
        }
        let options = with(SolidOptions::new(), |it| {
            it.attribute = attribute;
            it.resolution = resolution;
        });
        let directory = tempfile::tempdir().unwrap();
        let output = directory.path().join("solid.goblin");
        let models = open_all(&[path], 64 << 20).unwrap();
        plan_models(models, &options).unwrap().build(Output::create(&output).unwrap(), &()).unwrap();
        Some(spinney::open(&output).unwrap())
    };
    let classes = |tree: &Dataset| tree.statistics(None, &()).unwrap().classes;
    let [open, closed] = ["parts_open1.obj", "parts_closed.obj"]
        .map(|name| build(name, Attribute::PartNumber, Resolution::Cell(0.25)));
    if let (Some(open), Some(closed)) = (open, closed) {
        let (found, expected) = (classes(&open), classes(&closed));
        assert_eq!((found.len(), expected.len()), (20, 20));
        assert_eq!(found[..19], expected[..19]);
    }
    if let Some(tree) = build("colo.obj", Attribute::Colour, Resolution::Cell(0.25)) {
        let stats = tree.statistics(None, &()).unwrap();
        assert!(stats.channels.iter().all(|channel| (channel.min, channel.max) == (0.into(), 255.into())));
    }
    if let Some(tree) = build("DELFSHAVEN.city.json", Attribute::PartNumber, Resolution::Cells(256)) {
        let labels = classes(&tree).len();
        assert!(labels > 700, "{labels} labels");
    }
}

/// Error bound of the winding field: cells with a field nearer to one half may be inside or
/// outside.
const BOUND: f64 = 0.01;

/// Builds open triangles in cells of width 1, and compares every `every`-th cell with the field at
/// its centre.
fn compare(triangles: &[Triangle], depth: u8, every: usize, what: &str) {
    let (tree, report) = build(plain(triangles), &unit_cells(depth));
    assert_eq!(report.inside, InsideTest::Open, "{what}");
    let side = 1usize << depth;
    let extreme = |axis: usize, pick: fn(f64, f64) -> f64, from: f64| {
        triangles.iter().flatten().map(|corner| corner[axis]).fold(from, pick)
    };
    let low = [0, 1, 2].map(|axis| extreme(axis, f64::min, f64::INFINITY));
    let high = [0, 1, 2].map(|axis| extreme(axis, f64::max, f64::NEG_INFINITY));
    let (mut inside, mut outside) = (0, 0);
    for (index, cell) in cells(&tree).into_iter().enumerate().step_by(every) {
        let at = [index % side, index / side % side, index / side / side].map(|x| x as f64);
        if (0..3).any(|axis| at[axis] >= high[axis] || at[axis] + 1.0 <= low[axis]) {
            assert!(cell.is_none(), "{what}: {at:?} outside of the surface");
            continue;
        }
        // Points on a triangle are perturbed, most along x and least along z.
        let expected =
            winding(triangles, [at[0] + 0.5 + 1e-6, at[1] + 0.5 + 1e-8, at[2] + 0.5 + 1e-10]).abs();
        if (expected - 0.5).abs() > BOUND {
            assert_eq!(cell.is_some(), expected >= 0.5, "{what}: {at:?} {expected}");
        }
        inside += usize::from(cell.is_some());
        outside += usize::from(cell.is_none());
    }
    assert!(inside > 0 && outside > 0, "{what}");
}

#[test]
fn cells_are_as_the_exact_field_says() {
    let mut random = Random(5);
    let mut number = |from: f64, below: u64| from + random.below(below * 64) as f64 / 64.0;
    for (count, size) in [(1, 24), (12, 20), (150, 9), (700, 5)] {
        let mut soup: Vec<Triangle> = (0..count)
            .map(|_| {
                let from: Point = [0; 3].map(|_| number(0.0, 31));
                [0; 3].map(|_| from.map(|x| number(x, size).min(31.25)))
            })
            .collect();
        // A box without one triangle, so that there is an inside.
        soup.extend(cuboid([5.25, 6.0, 7.25], [16.0, 20.25, 14.0]).into_iter().skip(1));
        compare(&soup, 5, 1 + count / 50, &format!("{count} loose triangles"));
    }
    // Boxes without a side or two, also inside out, with sides and diagonals through cell centres.
    for (low, high) in [([10.25, 20.75, 12.0], [50.0, 44.25, 49.125]), ([9.5, 9.5, 9.5], [41.5, 41.5, 41.5])]
    {
        for skipped in [vec![0, 1], vec![3], vec![7, 8]] {
            let faces = cuboid(low, high).into_iter().enumerate();
            let mut open: Vec<Triangle> =
                faces.filter(|(index, _)| !skipped.contains(index)).map(|(_, face)| face).collect();
            compare(&open, 6, 3, &format!("{low:?} without {skipped:?}"));
            open.iter_mut().for_each(|triangle| triangle.swap(0, 1));
            compare(&open, 6, 3, &format!("{low:?} inside out, without {skipped:?}"));
        }
    }
}
