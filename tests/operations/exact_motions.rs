//! Transformed exact models, against models rebuilt from transformed faces.

use std::path::Path;
use std::sync::atomic::{AtomicI64, Ordering};

use spinney::brep::{Face, Faces, Grid, MassProperties, Motion, TransformOptions, transform};
use spinney::raw::brep::{FaceList, ModelBuilder, TransformReport};
use spinney::raw::ops::{AffineMap, Axis};
use spinney::raw::store::Tag;
use spinney::{Codec, Error, ExactModel, Metadata, Output, Progress, Result, ViewOperation};

use crate::common::Random;
use crate::common::exact::{cuboid, model_on, prism, push, turned};
use crate::common::sets::{Body, MEMORY, combined, grid, tetrahedron};

pub(super) fn motion(steps: &[&str]) -> Motion {
    let next =
        |map: AffineMap, step: &&str| map.then(&step.parse::<ViewOperation>().unwrap().as_map().unwrap());
    Motion::from_rows(steps.iter().fold(AffineMap::IDENTITY, next).to_rows()).unwrap()
}

fn inverse(motion: &Motion) -> Motion {
    Motion::from_rows(AffineMap::from_rows(motion.to_rows()).inverse().unwrap().to_rows()).unwrap()
}

/// Returns the transformed solid; on failure no file remains.
fn try_moved(body: &Body, motion: &Motion, options: &TransformOptions) -> Result<(Body, TransformReport)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("moved.goblin");
    let made = transform(&body.model, motion, options, Output::create(&path).unwrap(), &());
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), usize::from(made.is_ok()));
    made.map(|report| (Body::of_bytes(std::fs::read(&path).unwrap()), report))
}

pub(super) fn moved(body: &Body, motion: &Motion) -> (Body, TransformReport) {
    let (found, report) = try_moved(body, motion, &TransformOptions::new(MEMORY)).unwrap();
    assert_eq!((report.before, report.after), (body.model.len(), found.model.len()));
    assert_eq!(report.grid, *found.model.grid());
    found.check();
    (found, report)
}

/// Returns the quarter turns, mirrorings and permutations of axes.
pub(super) fn symmetries() -> Vec<Motion> {
    let axes = [Axis::X, Axis::Y, Axis::Z];
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let all = orders.into_iter().flat_map(|order| (0..8).map(move |bits| (order, bits)));
    all.map(|(order, bits)| {
        let mirror = [0, 1, 2].map(|axis| bits >> axis & 1 == 1);
        Motion::from_rows(
            AffineMap::symmetry(order.map(|axis| axes[axis]), mirror)
                .unwrap()
                .then(&AffineMap::translation([f64::from(bits), -7.0, 1000.0]))
                .to_rows(),
        )
        .unwrap()
    })
    .collect()
}

fn random_tetrahedra(bits: u8, count: u64) -> [Body; 2] {
    let mut random = Random(count);
    [(); 2].map(|()| {
        loop {
            let corners = [(); 4].map(|()| [(); 3].map(|()| random.below(1 << bits) as i32));
            if let Some(faces) = tetrahedron(corners) {
                return Body::of(&faces, bits);
            }
        }
    })
}

/// Returns solids on the grid.
pub(super) fn bodies() -> Vec<Body> {
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole = square(5, 9).into_iter().rev().collect();
    let hollow = [cuboid([1; 3], [14; 3]), turned(cuboid([3, 4, 5], [8, 9, 11]))].concat();
    let mut all = vec![
        Body::of(&prism(&[square(2, 12), hole], 3, 11), 4),
        Body::of(&hollow, 4),
        Body::of(&cuboid([0; 3], [15, 7, 3]), 4),
    ];
    all.extend(random_tetrahedra(26, 3));
    all.push(combined(12, &[&all[1]]));
    all
}

/// Returns operands whose results have off-grid vertices, and these results.
pub(super) fn off_grid_bodies() -> [Body; 4] {
    let [a, b] = [
        tetrahedron([[0, 0, 0], [100, 7, 3], [11, 97, 1], [5, 13, 89]]).unwrap(),
        tetrahedron(
            [[10, 10, -10], [113, 31, 17], [19, 101, 23], [31, 29, 120]]
                .map(|at| at.map(|at: i32| at.max(0))),
        )
        .unwrap(),
    ]
    .map(|faces| Body::of(&faces, 7));
    let [both, rest] = [1, 2].map(|operation| combined(operation, &[&a, &b]));
    assert!(both.model.exact_faces().0 > 0 && rest.model.exact_faces().0 > 0);
    [a, b, both, rest]
}

/// Vertices, ends of rings, colours, part and source of a face.
type OwnedFace = (Vec<[i32; 3]>, Vec<usize>, Vec<[u8; 3]>, u32, u64);

fn faces(model: &ExactModel) -> Vec<OwnedFace> {
    let mut all = Vec::new();
    let mut take = |face: &Face<'_>| {
        all.push((
            face.points.to_vec(),
            face.ring_ends.to_vec(),
            face.colours.to_vec(),
            face.part,
            face.source,
        ));
        Ok(())
    };
    model.each(&mut take).unwrap();
    all
}

/// Returns a model's faces, transformed one by one in world coordinates, on a grid.
fn faces_moved(model: &ExactModel, motion: &Motion, grid: &Grid) -> FaceList {
    let [x, y, z] = motion.to_rows().map(|[a, b, c, _]| [a, b, c]);
    let across = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let is_mirrored = (0..3).map(|axis| across(x, y)[axis] * z[axis]).sum::<f64>() < 0.0;
    let mut list = FaceList::new(grid.clone(), model.parts().to_vec());
    let mut take = |face: &Face<'_>| {
        let mut rings: Vec<Vec<[i32; 3]>> = Vec::new();
        for ring in face.rings() {
            let at = |point: &[i32; 3]| {
                let there = motion.apply(model.grid().to_world(*point));
                let found = grid.snap(there).unwrap();
                assert_eq!(grid.to_world(found), there, "{point:?} goes to a point of the grid");
                found
            };
            let mut ring: Vec<[i32; 3]> = ring.iter().map(at).collect();
            if is_mirrored {
                ring.reverse();
            }
            rings.push(ring);
        }
        push(&mut list, &rings, face.part, None);
        Ok(())
    };
    model.each(&mut take).unwrap();
    list
}

/// Checks the measures that a motion preserves, and the new position.
fn assert_measures(before: &Body, after: &Body, motion: &Motion) {
    let [a, b] = [before, after].map(|body| MassProperties::of(&body.model, &()).unwrap());
    if before.model.exact_faces().0 == 0 {
        assert_eq!(a.volume, b.volume);
    }
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * (1.0 + a.abs().max(b.abs()));
    assert!(near(a.volume, b.volume) && near(a.area, b.area), "{a:?} {b:?}");
    let [there, found] = [motion.apply(a.centre.unwrap()), b.centre.unwrap()];
    assert!((0..3).all(|axis| (there[axis] - found[axis]).abs() < 1e-6), "{there:?} {found:?}");
}

#[test]
fn symmetries_and_whole_shifts_are_exact() {
    for (number, body) in bodies().iter().enumerate() {
        for (turn, motion) in symmetries().iter().enumerate().filter(|(turn, _)| number < 2 || turn % 5 == 0)
        {
            let (found, report) = moved(body, motion);
            assert!(report.is_exact && report.displacement == 0.0, "{report:?}");
            assert_measures(body, &found, motion);
            let expected = faces_moved(&body.model, motion, &report.grid);
            for (own, number) in faces(&found.model).iter().zip(0..) {
                let there = expected.get(number);
                assert!(own.0 == there.points && own.1 == there.ring_ends, "body {number}, symmetry {turn}");
            }
            if !body.model.is_unbounded() {
                assert!(*Body::of_list(&expected).model.nodes() == *found.model.nodes());
            }
            let (back, _) = moved(&found, &inverse(motion));
            assert_eq!(faces(&back.model), faces(&body.model), "body {number}, symmetry {turn}");
            assert_eq!((back.model.grid(), back.model.nodes()), (body.model.grid(), body.model.nodes()));
            assert_eq!(back.model.is_unbounded(), body.model.is_unbounded());
        }
    }
}

#[test]
fn points_stay_on_the_side_of_the_surface_on_which_they_are() {
    let mut random = Random(5);
    for body in bodies().iter().take(3).chain(&off_grid_bodies()) {
        for motion in symmetries().iter().step_by(7) {
            let (found, _) = moved(body, motion);
            for _ in 0..200 {
                let point = [(); 3].map(|()| random.below(1000) as f64 / 10.0);
                let there = motion.apply(point).map(|at| (at * 10.0).round() / 10.0);
                assert_eq!(
                    body.model.locate(point).unwrap(),
                    found.model.locate(there).unwrap(),
                    "{point:?} {motion:?}"
                );
            }
        }
    }
}

/// Off-grid vertices are transformed exactly: reassembled components are bit-exact.
#[test]
fn off_grid_vertices_are_moved_exactly() {
    let [a, _, both, rest] = off_grid_bodies();
    for motion in symmetries() {
        let [a, both, rest] = [&a, &both, &rest].map(|body| {
            let (found, report) = moved(body, &motion);
            assert!(report.is_exact && report.rounded == 0);
            assert_eq!(found.model.exact_faces(), body.model.exact_faces());
            assert_measures(body, &found, &motion);
            let (back, _) = moved(&found, &inverse(&motion));
            assert_eq!(faces(&back.model), faces(&body.model));
            let sections = |body: &Body| {
                let all = body.model.sections();
                all.into_iter().filter(|(name, _)| *name == "list of exact faces").collect::<Vec<_>>()
            };
            assert_eq!(sections(&back), sections(body));
            found
        });
        let whole = combined(7, &[&both, &rest]);
        // Volumes of off-grid solids are doubles.
        assert!((whole.volume() / a.volume() - 1.0).abs() < 1e-14, "{motion:?}");
        assert_eq!(combined(6, &[&whole, &a]).model.len(), 0, "{motion:?}");
    }
}

#[test]
fn one_factor_changes_the_step_alone() {
    let [_, _, both, _] = off_grid_bodies();
    for body in bodies().iter().chain([&both]) {
        for factor in [0.001, 25.4, 1.0 / 3.0, 4.0, 0.777, 1e-9, 1e9] {
            let scale = motion(&[&format!("scale={factor}")]);
            let (found, report) = moved(body, &scale);
            assert!(report.is_exact && report.displacement == 0.0);
            assert_eq!(faces(&found.model), faces(&body.model));
            assert_eq!(found.model.nodes(), body.model.nodes());
            assert_eq!(report.grid.origin, body.model.grid().origin);
            assert!((report.grid.width() / body.model.grid().width() / factor - 1.0).abs() < 1e-15);
            let ratio = found.volume() / body.volume() / factor.powi(3);
            assert!((ratio - 1.0).abs() < 1e-14, "{ratio}");
        }
        let (inches, _) = moved(body, &motion(&["scale=25.4"]));
        assert_eq!(inches.model.grid().step / inches.model.grid().divisor, 25.4);
    }
    let decimals = Body::of_list(&model_on(
        Grid::over([[0.0; 3], [1.0; 3]], Some(0.001)).unwrap(),
        &cuboid([1; 3], [900, 100, 7]),
    ));
    let (there, _) = moved(&decimals, &motion(&["scale=1000"]));
    assert_eq!((there.model.grid().step, there.model.grid().divisor), (1.0, 1.0));
    let (back, _) = moved(&there, &motion(&["scale=0.001"]));
    assert_eq!((back.model.grid(), faces(&back.model)), (decimals.model.grid(), faces(&decimals.model)));
}

#[test]
fn shifts_of_parts_of_steps_make_finer_ones_or_go_to_whole_ones() {
    let body = Body::of_list(&model_on(
        Grid::over([[0.0; 3], [1.0; 3]], Some(0.001)).unwrap(),
        &cuboid([1; 3], [900, 100, 7]),
    ));
    let (found, report) = moved(&body, &motion(&["translate=0.1,-7.003,40"]));
    assert_eq!((report.displacement, report.grid.origin), (0.0, [100, -7003, 40_000]));
    assert_eq!(faces(&found.model), faces(&body.model));
    // A quarter of a grid unit: the grid must be four times as fine.
    let (found, report) = moved(&body, &motion(&["translate=0.00025,0,1"]));
    assert!(report.is_exact && report.displacement == 0.0 && report.grid.width() == 0.00025);
    assert_eq!(found.model.grid().to_world(faces(&found.model)[0].0[0])[0], 0.00125);
    assert_eq!(found.volume(), body.volume());
    // Centres far from the origin, where doubles are rounded.
    let grid = Grid { bits: 12, origin: [2_650_001_007, 1_250_001_001, 5], step: 1.0, divisor: 1000.0 };
    let city = Body::of_list(&model_on(grid, &cuboid([0; 3], [4000, 3000, 10])));
    for centre in ["2650014.123,1250011.456", "2650000.1,1250000.3", "-7.007,2650014.999"] {
        let turn = motion(&[&format!("rotate=90@{centre}")]);
        let (found, report) = moved(&city, &turn);
        assert!(report.is_exact && report.displacement == 0.0, "{report:?}");
        let (back, _) = moved(&found, &motion(&[&format!("rotate=-90@{centre}")]));
        assert_eq!((back.model.grid(), faces(&back.model)), (city.model.grid(), faces(&city.model)));
    }
    // No space in the grid, or no matching grid unit.
    let [fine, _] = random_tetrahedra(26, 3);
    for (body, shift) in [(&fine, "translate=0.3,0,0"), (&body, "translate=0.0003141592,0,0")] {
        let (found, report) = moved(body, &motion(&[shift]));
        assert!(report.is_exact && report.displacement > 0.0);
        assert!(report.displacement <= body.model.grid().width() / 2.0, "{report:?}");
        assert_eq!((faces(&found.model), found.volume()), (faces(&body.model), body.volume()));
        let stored = found.model.metadata().tag(Tag::ModelDisplacement).unwrap().parse::<f64>().unwrap();
        assert_eq!(stored, report.displacement);
    }
}

#[test]
fn other_maps_recompute_vertices() {
    let fine = |faces: &crate::common::sets::Solid| {
        Body::of_list(&model_on(
            Grid { bits: 26, origin: [-500, 0, 1000], step: 1.0, divisor: 1000.0 },
            faces,
        ))
    };
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole = square(300_000, 500_000).into_iter().rev().collect();
    let ring = fine(&prism(&[square(100_000, 900_000), hole], 30_000, 110_000));
    let hollow = fine(&[cuboid([0; 3], [900_000; 3]), turned(cuboid([300_000; 3], [500_000; 3]))].concat());
    let [_, _, both, _] = off_grid_bodies();
    for body in [&ring, &hollow, &both] {
        for (steps, volume) in [
            (&["rotate=30,1,2,3@5,6,7"][..], 1.0),
            (&["rotate=30", "rotate=60"], 1.0),
            (&["rotate=12.5,x", "mirror=y"], 1.0),
            (&["scale=1,2,0.5", "rotate=1,y"], 1.0),
            (&["affine=-1,0.25,0,3,0,2,0,1,0,0.5,1,0"], 2.0),
        ] {
            let map = motion(steps);
            let (found, report) = moved(body, &map);
            let is_quarter = steps.len() == 2 && steps[1] == "rotate=60";
            assert_eq!(report.is_exact, is_quarter, "{steps:?}");
            let half = report.grid.width() * 0.75f64.sqrt() * 1.000001;
            assert!(report.displacement <= half, "{report:?}");
            let share = found.volume() / body.volume() / volume;
            let most = if std::ptr::eq(body, &both) { 0.2 } else { 1e-5 };
            assert!((share - 1.0).abs() < most && share > 0.0, "{steps:?}: {share}");
            if std::ptr::eq(body, &both) && !is_quarter {
                assert_eq!(report.rounded, both.model.exact_faces().0);
            }
            // Forth and back: as close as both roundings permit.
            let (back, _) = moved(&found, &inverse(&map));
            let share = back.volume() / body.volume();
            assert!((share - 1.0).abs() < 2.0 * most, "{steps:?}: {share}");
        }
    }
    // A coarser grid, and a case where the model's own unit would exceed the limit.
    let mut options = TransformOptions::new(MEMORY);
    options.snap = Some(0.5);
    let (found, report) = try_moved(&ring, &motion(&[]), &options).unwrap();
    assert_eq!((report.is_exact, report.displacement, report.grid.width()), (false, 0.0, 0.5));
    assert_eq!((found.volume(), report.after), (ring.volume(), ring.model.len()));
    let (_, report) = moved(&ring, &motion(&["scale=1000,1,1"]));
    assert!(report.grid.width() > 0.001 && report.grid.bits <= 26, "{report:?}");
}

/// Returns a solid with colours, parts with attributes, and face values.
fn described() -> Body {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("model.goblin");
    let mut list = FaceList::new(grid(10), Vec::new());
    for (part, faces) in [cuboid([0; 3], [300; 3]), cuboid([400; 3], [1000, 900, 800])].iter().enumerate() {
        faces.iter().for_each(|rings| push(&mut list, rings, part as u32, Some([part as u8, 7, 200])));
    }
    let mut builder = ModelBuilder::new(Output::create(&path).unwrap(), grid(10), MEMORY).unwrap();
    let add = &mut |face: &Face<'_>| {
        builder.push(face)?;
        builder.face_value("number", &face.number.to_string())?;
        if face.number.is_multiple_of(3) { builder.face_value("material", "\"oak\"") } else { Ok(()) }
    };
    list.each(add).unwrap();
    builder.part("low", Some("{\"type\":\"Road\",\"attributes\":{\"lanes\":2}}")).unwrap();
    builder.part("high", None).unwrap();
    builder.about_file("{\"metadata\":{\"title\":\"two\"}}").unwrap();
    let mut metadata = Metadata::default();
    metadata.set_tag(Tag::Unit, "inch");
    metadata.provenance.push("two.city.json".into());
    builder.finish(&mut metadata, &()).unwrap();
    Body::of_bytes(std::fs::read(&path).unwrap())
}

#[test]
fn all_that_is_said_of_parts_and_faces_is_kept() {
    let body = described();
    for (steps, is_exact) in [
        (&["mirror=x", "translate=5,6,7"][..], true),
        (&["rotate=33,1,1,0"], false),
        (&["scale=2,1,1", "mirror=z"], false),
    ] {
        let mut options = TransformOptions::new(MEMORY);
        (options.codec, options.unit) = (Codec::Packed, (!is_exact).then(|| "mm".into()));
        let (found, report) = try_moved(&body, &motion(steps), &options).unwrap();
        found.check();
        assert_eq!(report.is_exact, is_exact);
        let (old, new) = (&body.model, &found.model);
        assert_eq!((new.parts(), new.codec()), (old.parts(), Codec::Packed));
        assert_eq!(new.part_attributes(0).unwrap(), old.part_attributes(0).unwrap());
        assert_eq!(new.file_attributes().unwrap(), old.file_attributes().unwrap());
        assert_eq!(new.face_columns().unwrap(), old.face_columns().unwrap());
        assert_eq!(new.metadata().tag(Tag::Unit), Some(if is_exact { "inch" } else { "mm" }));
        let [first, second] = &new.metadata().provenance[..] else { panic!("two lines") };
        assert!(first == "two.city.json" && second.starts_with("view of (memory): affine="), "{second}");
        let formula = new.formula().unwrap().unwrap();
        assert!(formula.starts_with("(map ") && formula.ends_with(" \"(memory)\")"), "{formula}");
        let olds = faces(old);
        for (number, face) in (0..).zip(faces(new)) {
            // Sources are face numbers here.
            let before = &olds[face.4 as usize];
            assert_eq!((face.3, face.2[0]), (before.3, before.2[0]));
            for column in 0..2 {
                let value = old.face_value(column, face.4 as u32).unwrap();
                assert_eq!(new.face_value(column, number).unwrap(), value, "face {number}");
            }
        }
    }
}

#[test]
fn what_cannot_be_done_is_refused() {
    let [a, _, both, _] = off_grid_bodies();
    let options = TransformOptions::new(MEMORY);
    let refuse = |body: &Body, steps: &[&str], options: &TransformOptions| {
        try_moved(body, &motion(steps), options).map(|_| ()).unwrap_err()
    };
    let error = refuse(&a, &["translate=1e16,0,0"], &options);
    assert!(matches!(&error, Error::Invalid { .. }) && error.to_string().contains("2^53"), "{error}");
    let error = refuse(&a, &["scale=1e-320"], &options);
    assert!(error.to_string().contains("number"), "{error}");
    let error = refuse(&a, &["rotate=7", "scale=1e308"], &options);
    assert!(error.to_string().contains("coordinates that are not finite"), "{error}");
    let mut coarse = options.clone();
    coarse.snap = Some(1e-9);
    assert!(refuse(&a, &["rotate=7"], &coarse).to_string().contains("2^26"));
    coarse.snap = Some(1e6);
    for error in [refuse(&a, &[], &coarse), refuse(&a, &["scale=1,1,1e-4"], &options)] {
        assert!(matches!(&error, Error::NotASolid { .. }), "{error}");
        assert!(error.to_string().contains("no volume"), "{error}");
    }
    // Walls thinner than a grid unit become coincident or intersect.
    let wall = [cuboid([0; 3], [900; 3]), turned(cuboid([2, 3, 4], [897; 3]))].concat();
    coarse.snap = Some(40.0);
    let error = refuse(&Body::of(&wall, 10), &["rotate=7,1,2,3"], &coarse);
    let Error::NotASolid { count, locations, advice, .. } = &error else { panic!("{error}") };
    assert!(*count > 0 && !locations.is_empty() && advice.contains("--snap"), "{error}");
    // Memory limit for faces with off-grid vertices.
    let error = refuse(&both, &["mirror=x"], &TransformOptions::new(1 << 10));
    assert!(matches!(&error, Error::TooLarge { advice, .. } if advice.contains("--memory")), "{error}");
    // Operations that are not maps.
    for step in ["crop", "window=0,0,1,1", "depth=3", "components=4"] {
        let error = step.parse::<ViewOperation>().unwrap().as_map().unwrap_err();
        assert!(error.to_string().contains(step) && error.to_string().contains("translate="), "{error}");
    }
}

/// Cancels after a number of checks.
struct Patience(AtomicI64);

impl Progress for Patience {
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, Ordering::Relaxed) <= 0
    }
}

#[test]
fn work_can_be_interrupted_and_threads_do_not_matter() {
    let [_, _, both, _] = off_grid_bodies();
    let maps = [motion(&["axes=+y,-x,+z"]), motion(&["rotate=9"])];
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("moved.goblin");
    let make = |body: &Body, map: &Motion, path: &Path, progress: &dyn Progress| {
        let output = Output::create(path).unwrap();
        transform(&body.model, map, &TransformOptions::new(MEMORY), output, progress)
    };
    for map in &maps {
        let mut checks = 0;
        while let Err(error) = make(&both, map, &path, &Patience(checks.into())) {
            assert!(matches!(error, Error::Interrupted), "{error}");
            assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
            checks += 1;
        }
        assert!(checks > 3, "{checks}");
        let first = std::fs::read(&path).unwrap();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| make(&both, map, &path, &())).unwrap();
            assert!(std::fs::read(&path).unwrap() == first);
        }
        std::fs::remove_file(&path).unwrap();
    }
}
