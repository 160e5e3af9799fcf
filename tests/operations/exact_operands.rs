//! Properties that set operations on exact models keep, and the errors for incompatible
//! operands.

use std::path::Path;
use std::sync::atomic::{AtomicI64, Ordering};

use spinney::brep::{Faces, Grid, MassProperties, combine};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::{Error, ExactModel, Output, Progress, SetOperation};

use crate::common::Random;
use crate::common::exact::{cuboid, model_on};
use crate::common::sets::{Body, MEMORY, combined, tetrahedron, try_combined};

/// Imports a mesh file as a solid.
fn imported(name: &str, text: &str) -> Body {
    let directory = tempfile::tempdir().unwrap();
    let [mesh, path] = [name, "x.goblin"].map(|name| directory.path().join(name));
    std::fs::write(&mesh, text).unwrap();
    let mut options = ExactOptions::new();
    options.snap = Some(1.0 / 1024.0);
    import_exact(open_all(&[mesh], MEMORY).unwrap(), &options, Output::create(&path).unwrap(), &()).unwrap();
    Body::of_bytes(std::fs::read(path).unwrap())
}

/// Imports a CityJSON file with a tetrahedron and an object without geometry.
fn city(name: &str, shift: i32) -> Body {
    imported("a.city.json", &city_text(name, shift))
}

fn city_text(name: &str, shift: i32) -> String {
    let [a, b, c] = [shift, shift + 40, shift + 1];
    format!(
        r#"{{"type":"CityJSON","version":"2.0","transform":{{"scale":[1,1,1],"translate":[0,0,0]}},
        "metadata":{{"title":"{name}"}},"CityObjects":{{"{name}":{{"type":"Road","attributes":{{"lanes":2}},
        "geometry":[{{"type":"Solid","lod":"2","boundaries":[[[[0,2,1]],[[0,1,3]],[[0,3,2]],[[1,2,3]]]]}}]}},
        "{name}-x":{{"type":"GenericCityObject"}}}},
        "vertices":[[{a},{a},{a}],[{b},{c},{a}],[{a},{b},{c}],[{c},{a},{b}]]}}"#
    )
}

#[test]
fn parts_and_attributes_are_those_of_all() {
    let [a, b, c] = [("one", 0), ("two", 7), ("three", 11)].map(|(name, shift)| city(name, shift));
    for (operation, bodies) in [(7, vec![&a, &b]), (6, vec![&a, &b, &c]), (8, vec![&b, &a])] {
        let result = combined(operation, &bodies);
        // All tetrahedra overlap, and so are one object. Objects without geometry stay.
        let all = bodies.iter().enumerate().flat_map(|(number, body)| {
            body.model.parts().iter().enumerate().map(move |(part, name)| (number, part, name.clone()))
        });
        let parts: Vec<(usize, usize, String)> =
            all.filter(|(number, part, _)| *number == 0 || *part == 1).collect();
        let names: Vec<&String> = parts.iter().map(|(.., name)| name).collect();
        assert_eq!(result.model.parts().iter().collect::<Vec<_>>(), names);
        let part = |model: &ExactModel, part: usize| model.part_attributes(part as u32).unwrap();
        let files_of = |model: &ExactModel| model.file_attributes().unwrap();
        for (number, (body, own, _)) in parts.iter().enumerate() {
            assert_eq!(part(&result.model, number), part(&bodies[*body].model, *own), "part {number}");
        }
        let files: Vec<String> = bodies.iter().flat_map(|body| files_of(&body.model)).collect();
        assert_eq!(files_of(&result.model), files);
        let formula = result.model.formula().unwrap().unwrap();
        let names = vec![" \"(memory)\""; bodies.len()].concat();
        assert_eq!(formula, format!("(op{operation}{names})"));
        // Faces keep their sources: four each, file by file.
        let mut counts = vec![0; bodies.len()];
        let mut add = |face: &spinney::brep::Face<'_>| {
            assert_eq!(face.part, 0);
            counts[face.source as usize / 4] += 1;
            Ok(())
        };
        result.model.each(&mut add).unwrap();
        assert!(counts.iter().all(|count| *count > 0), "{counts:?}");
        // Results keep their objects in further operations; a tool's objects are none of the
        // result, except that its cavities are united with those of a complement.
        let again = combined(2, &[&result, &c]);
        let more = if operation == 8 { &c.model.parts()[1..] } else { &[] };
        assert_eq!(again.model.parts(), [result.model.parts(), more].concat());
        assert_eq!(files_of(&again.model).len(), files.len() + files_of(&c.model).len());
        assert_eq!(again.model.formula().unwrap().unwrap(), format!("(op2 {formula} \"(memory)\")"));
    }
}

/// A solid with off-grid vertices is copied unchanged by all operations if it is disjoint from the
/// other one.
#[test]
fn disjoint_parts_stay_unchanged() {
    let [a, b] = [city("one", 0), city("two", 7)];
    let cut = combined(2, &[&a, &b]);
    assert!(cut.model.volume_correction().unwrap() != 0.0);
    let far = imported(
        "far.off",
        "OFF\n4 4 0\n200 3 3\n270 4 4\n207 40 5\n208 8 41\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n",
    );
    let volume = |body: &Body| MassProperties::of(&body.model, &()).unwrap().volume;
    let close = |one: f64, other: f64| (one - other).abs() < 1e-9 * one.abs().max(1.0);
    let sum = volume(&cut) + volume(&far);
    for (operation, expected) in
        [(7, sum), (6, sum), (2, volume(&cut)), (4, volume(&far)), (1, 0.0), (8, -sum)]
    {
        for (operation, bodies) in [(operation, [&cut, &far]), (operation, [&far, &cut])] {
            let is_turned = std::ptr::eq(bodies[0], &far);
            let expected = match (operation, is_turned) {
                (2, true) => volume(&far),
                (4, true) => volume(&cut),
                _ => expected,
            };
            let result = combined(operation, &bodies);
            assert!(close(volume(&result), expected), "{operation}: {} {expected}", volume(&result));
            assert_eq!(result.model.verify(MEMORY, &()).unwrap(), [], "{operation}");
            // The copy can be an operand again.
            if operation == 7 {
                let again = combined(2, &[&result, &b]);
                assert!(close(volume(&again), sum), "{} {sum}", volume(&again));
            }
        }
    }
}

const COLOURED: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\n\
    property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n60 1 0 255 0 0\n1 60 0 255 0 0\n\
    0 1 60 255 0 0\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
const PLAIN: &str = "OFF\n4 4 0\n-20 3 3\n70 4 4\n7 40 5\n8 8 41\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

#[test]
fn colours_stay_and_others_are_white() {
    let (red, plain) = (imported("a.ply", COLOURED), imported("b.off", PLAIN));
    for (operation, bodies) in
        [(7, [&red, &plain]), (7, [&plain, &red]), (6, [&red, &plain]), (2, [&plain, &red])]
    {
        let is_first = std::ptr::eq(bodies[0], &red);
        // In sequence, so that colours of off-grid vertices are also read back from a file.
        let far = Body::of_list(&model_on(red.model.grid().clone(), &cuboid([0; 3], [9; 3])));
        let result = combined(operation, &bodies);
        for result in [combined(7, &[&result, &far]), result] {
            assert!(result.model.is_coloured().unwrap());
            let mut counts = [0; 2];
            let mut visit = |face: &spinney::brep::Face<'_>| {
                // (Four faces each, operand by operand.)
                let is_red = (face.source < 4) == is_first && face.source < 8;
                let expected = if is_red { [255, 0, 0] } else { [255; 3] };
                assert!(face.colours.len() == face.points.len());
                assert!(face.colours.iter().all(|colour| *colour == expected), "{face:?}");
                counts[usize::from(is_red)] += 1;
                Ok(())
            };
            result.model.each(&mut visit).unwrap();
            assert!(counts[0] > 0 && counts[1] > 0, "{counts:?}");
        }
    }
    assert!(!combined(7, &[&plain, &plain]).model.is_coloured().unwrap());
}

/// Returns a box on a grid, with corners in grid units.
fn on_grid(grid: &Grid, min: [i32; 3], max: [i32; 3]) -> Body {
    Body::of_list(&model_on(grid.clone(), &cuboid(min, max)))
}

fn grid(bits: u8, origin: [i64; 3], step: f64, divisor: f64) -> Grid {
    Grid { bits, origin, step, divisor }
}

#[test]
fn grids_that_fit_become_one() {
    let whole = grid(4, [0; 3], 1.0, 1.0);
    // The box from 2 to 6, on several grids.
    let first = on_grid(&whole, [2; 3], [6; 3]);
    let cases = [
        (grid(4, [-3, 5, 0], 1.0, 1.0), [7, -1, 4], 1.0),
        (grid(8, [-64, -64, -64], 0.25, 1.0), [80; 3], 0.25),
        (grid(10, [0; 3], 1.0, 10.0), [40; 3], 0.1),
        (grid(3, [0; 3], 2.0, 1.0), [2; 3], 1.0),
        (grid(4, [-100, 0, 100], 1.0, 1.0), [4; 3], 1.0),
    ];
    for (other, min, width) in cases {
        let min = [0, 1, 2].map(|axis| min[axis].max(0));
        let steps = (2.0 / other.width()).round() as i32;
        let max = min.map(|at| at + steps);
        let second = on_grid(&other, min, max);
        let [low, high] = [min, max].map(|point| other.to_world(point));
        let common: f64 = (0..3).map(|axis| (high[axis].min(6.0) - low[axis].max(2.0)).max(0.0)).product();
        for (a, b) in [(&first, &second), (&second, &first)] {
            let [both, all] = [1, 7].map(|operation| combined(operation, &[a, b]));
            assert!((both.volume() - common).abs() < 1e-12, "{other:?}: {} {common}", both.volume());
            assert!((all.volume() - (64.0 + 8.0 - common)).abs() < 1e-12, "{other:?}");
            assert_eq!(all.model.grid().width(), width);
            all.check();
            for point in [[2.5; 3], [5.5; 3], [1.5; 3], [0, 1, 2].map(|axis| low[axis] + 0.55)] {
                let is_in = |[low, high]: [[f64; 3]; 2]| {
                    (0..3).all(|axis| low[axis] < point[axis] && point[axis] < high[axis])
                };
                let inside_flags = [is_in([[2.0; 3], [6.0; 3]]), is_in([low, high])];
                assert_eq!(
                    all.is_inside(point),
                    inside_flags[0] || inside_flags[1],
                    "{other:?} at {point:?}"
                );
                assert_eq!(
                    both.is_inside(point),
                    inside_flags[0] && inside_flags[1],
                    "{other:?} at {point:?}"
                );
            }
        }
    }
}

/// Off-grid vertices are kept exactly on another grid.
#[test]
fn exact_corners_go_to_other_grids() {
    let coarse = grid(8, [0; 3], 1.0, 1.0);
    let body =
        |corners: [[i32; 3]; 4]| Body::of_list(&model_on(coarse.clone(), &tetrahedron(corners).unwrap()));
    let a = body([[10, 20, 30], [200, 11, 17], [31, 222, 40], [50, 60, 201]]);
    let b = body([[0, 90, 31], [207, 71, 99], [61, 22, 140], [150, 160, 91]]);
    let both = combined(1, &[&a, &b]);
    for other in
        [grid(10, [0; 3], 0.25, 1.0), grid(4, [-7, -9, 300], 1.0, 1.0), grid(12, [-900, 4, 5], 1.0, 16.0)]
    {
        let cube = on_grid(&other, [1; 3], [5; 3]);
        let single = cube.volume();
        for bodies in [[&both, &cube], [&cube, &both]] {
            let [common, all] = [1, 7].map(|operation| combined(operation, &bodies).volume());
            let expected = both.volume() + single;
            assert!(
                (common + all - expected).abs() < 1e-9 * expected,
                "{other:?}: {common} {all} {expected}"
            );
        }
    }
}

#[test]
fn other_coordinate_systems_are_reported() {
    let of = |number: u32| {
        let known =
            format!(r#""metadata":{{"referenceSystem":"https://www.opengis.net/def/crs/EPSG/0/{number}","#);
        imported("a.city.json", &city_text("one", 0).replace(r#""metadata":{"#, &known))
    };
    let (here, there, anywhere) = (of(7415), of(28992), city("one", 5));
    let error = try_combined(7, &[&here, &there]).err().unwrap();
    assert!(error.to_string().contains("28992") && error.to_string().contains("7415"), "{error}");
    // An operand without a coordinate system is compatible with both.
    for known in [&here, &there] {
        let result = combined(7, &[&anywhere, known]);
        assert_eq!(result.model.crs(), known.model.crs());
        assert!(result.model.crs().is_some());
    }
}

/// Returns intersecting tetrahedra.
fn heap(seed: u64, count: usize) -> Vec<Body> {
    let mut random = Random(seed);
    let mut point = || [0; 3].map(|_| random.below(1 << 16) as i32);
    let solids = (0..).map(|_| tetrahedron([point(), point(), point(), point()]));
    let bodies: Vec<Body> =
        solids.into_iter().flatten().take(count).map(|faces| Body::of(&faces, 17)).collect();
    bodies
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let bodies = heap(1, 6);
    let bodies: Vec<&Body> = bodies.iter().collect();
    for operation in [7, 2, 6] {
        let bytes = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| combined(operation, &bodies).bytes)
        });
        assert!(bytes[0] == bytes[1], "operation {operation}");
    }
}

/// Combines solids and overwrites an existing file.
fn over(bodies: &[&Body], memory: u64, progress: &dyn Progress, path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::write(path, "as it was").unwrap();
    let models: Vec<&ExactModel> = bodies.iter().map(|body| &body.model).collect();
    let result = combine(
        SetOperation::Union,
        &models,
        Output::create(path).unwrap(),
        spinney::Codec::Plain,
        memory,
        progress,
    );
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    assert_eq!(bytes == b"as it was", result.is_err());
    result.map(|_| bytes)
}

#[test]
fn insufficient_memory_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("c.goblin");
    let bodies = heap(2, 12);
    let bodies: Vec<&Body> = bodies.iter().collect();
    let enough = over(&bodies, MEMORY, &(), &path).unwrap();
    let mut too_little = 0;
    for bits in 10..28 {
        match over(&bodies, 1 << bits, &(), &path) {
            Ok(bytes) => assert!(bytes == enough, "{bits}"),
            Err(Error::TooLarge { limit, .. }) => {
                assert!(limit <= 1 << bits);
                too_little += 1;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(too_little > 2 && too_little < 16, "{too_little}");
}

/// Cancels after a number of checks.
struct Stop(AtomicI64);

impl Progress for Stop {
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, Ordering::Relaxed) <= 0
    }
}

#[test]
fn cancellation_leaves_no_files() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("c.goblin");
    let bodies = heap(3, 4);
    let bodies: Vec<&Body> = bodies.iter().collect();
    let expected = over(&bodies, MEMORY, &(), &path).unwrap();
    let mut checks = 0i64;
    let found = loop {
        match over(&bodies, MEMORY, &Stop(checks.into()), &path) {
            Ok(bytes) => break bytes,
            Err(error) => assert!(matches!(error, Error::Interrupted), "{error}"),
        }
        checks += 1 + checks / 8;
    };
    assert!(checks > 10, "{checks}");
    assert!(found == expected);
}

#[test]
fn wrong_numbers_of_bodies_are_reported() {
    let body = on_grid(&grid(4, [0; 3], 1.0, 1.0), [1; 3], [5; 3]);
    let cases: [(u8, usize); 7] = [(7, 0), (7, 1), (1, 1), (5, 1), (3, 3), (4, 3), (10, 3)];
    for (operation, count) in cases {
        let error = try_combined(operation, &vec![&body; count]).err().unwrap();
        assert!(error.to_string().contains("bodies"), "{error}");
    }
}
