//! Surfaces in patches, solids without volume, cavities that touch the exterior, and shells in
//! walls between cells.

use std::path::Path;

use spinney::brep::MassProperties;
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::store::Tag;
use spinney::{Error, ExactModel, Output, Result};

use crate::common::solid::{Polygon, Polygons, Triangle, build, cells, cuboid, plain, unit_cells};
use crate::common::with;

/// Returns the volume of an exact model of faces with parts, after comparing it with that of the
/// cells, if any.
fn volume(faces: &[(Triangle, u32)], change: impl FnOnce(&mut ExactOptions)) -> Result<f64> {
    let (volume, cells) = volumes(faces, change)?;
    if let Some([found, error]) = cells {
        assert!((found - volume).abs() <= error + 1e-9, "{volume}, but cells have {found} +- {error}");
    }
    Ok(volume)
}

/// Returns the volume of an exact model of faces with parts, and that of the cells with its error.
fn volumes(
    faces: &[(Triangle, u32)],
    change: impl FnOnce(&mut ExactOptions),
) -> Result<(f64, Option<[f64; 2]>)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let polygon = |(triangle, part): &(Triangle, u32)| Polygon {
        rings: vec![triangle.to_vec()],
        part: *part,
        colour: [0; 3],
    };
    let model = Polygons::of_faces(faces.iter().map(polygon).collect());
    let options = with(ExactOptions::new(), change);
    let made = import_exact(vec![model], &options, Output::create(&path).unwrap(), &());
    assert_eq!(path.exists(), made.is_ok());
    let report = made?;
    let model = ExactModel::open(&path, &Default::default()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    assert!(model.metadata().tag(Tag::ModelDisplacement).is_some());
    Ok((MassProperties::of(&model, &()).unwrap().volume, report.cells))
}

#[test]
fn patches_of_one_surface_are_joined_before_holes_are_closed() {
    // Each part is a side of two triangles.
    let sides: Vec<(Triangle, u32)> =
        cuboid([0.0; 3], [2.0, 3.0, 5.0]).into_iter().zip(0..).map(|(face, i)| (face, i / 2)).collect();
    for close in [false, true] {
        assert_eq!(volume(&sides, |it| it.close = close).unwrap(), 30.0);
    }
    assert_eq!(volume(&sides, |it| (it.close, it.repair) = (true, true)).unwrap(), 30.0);
    // Without a side: the open surface is closed.
    for missing in 0..6 {
        let open: Vec<_> = sides.iter().copied().filter(|(_, part)| *part != missing).collect();
        let (volume, cells) = volumes(&open, |it| it.close = true).unwrap();
        // Cells treat the patches as one surface, too.
        let [found, error] = cells.unwrap();
        assert_eq!(volume, 30.0, "without {missing}");
        assert!((found - 30.0).abs() <= error && error < 1.0, "without {missing}: {found} +- {error}");
        let error = self::volume(&open, |_| ()).unwrap_err();
        assert!(matches!(error, Error::NotASolid { .. }), "{error}");
    }
    // Two boxes in patches, and --skip-bad, which treats patches of one surface as one solid.
    let other = sides.iter().map(|(face, part)| (face.map(|[x, y, z]| [x + 9.0, y, z]), part + 6));
    let both: Vec<_> = sides.iter().copied().chain(other).collect();
    assert_eq!(volume(&both, |it| it.close = true).unwrap(), 60.0);
    assert_eq!(volume(&both, |it| (it.close, it.skip_bad) = (true, true)).unwrap(), 60.0);
}

#[test]
fn bodies_without_volume_are_errors() {
    let [a, b, c, d] = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0]];
    let sheet = [([a, b, c], 0), ([a, c, d], 0)];
    let double = [&sheet[..], &[([a, c, b], 0), ([a, d, c], 0)]].concat();
    for (faces, close) in [(&sheet[..], true), (&double, false), (&double, true)] {
        let error = volume(faces, |it| it.close = close).unwrap_err();
        assert!(matches!(&error, Error::NotASolid { .. }), "{error}");
        assert!(error.to_string().contains("no volume"), "{error}");
    }
    // One of several objects.
    let solid = cuboid([5.0; 3], [6.0; 3]).into_iter().map(|face| (face, 1));
    let all: Vec<_> = sheet.iter().copied().chain(solid).collect();
    let error = volume(&all, |it| it.close = true).unwrap_err();
    let Error::NotASolid { locations, advice, .. } = &error else { panic!("{error}") };
    assert!(
        locations.iter().any(|location| location.contains("part 0")) && advice.contains("--skip-bad"),
        "{error}"
    );
    assert_eq!(volume(&all, |it| (it.close, it.skip_bad) = (true, true)).unwrap(), 1.0);
}

#[test]
fn cavities_that_touch_the_exterior_stay() {
    let body = cuboid([0.0; 3], [8.0; 3]);
    let hollow = |low: [f64; 3], high: [f64; 3]| {
        let mut cavity = cuboid(low, high);
        cavity.iter_mut().for_each(|triangle| triangle.swap(0, 1));
        cavity
    };
    let repaired = |faces: &[Triangle]| {
        let faces: Vec<_> = faces.iter().map(|face| (*face, 0)).collect();
        volume(&faces, |it| it.repair = true).unwrap()
    };
    for (low, high) in [
        // In a face, an edge, three faces, and not at all.
        ([2.0, 2.0, 4.0], [6.0, 6.0, 8.0]),
        ([2.0, 2.0, 0.0], [4.0, 4.0, 2.0]),
        ([0.0, 2.0, 0.0], [4.0, 4.0, 2.0]),
        ([0.0; 3], [2.0, 4.0, 2.0]),
        ([1.0; 3], [2.0, 4.0, 2.0]),
    ] {
        let size: f64 = (0..3).map(|axis| high[axis] - low[axis]).product();
        let all = [body.clone(), hollow(low, high)].concat();
        assert_eq!(repaired(&all), 512.0 - size, "{low:?} {high:?}");
        // Everything inside out.
        let turned: Vec<Triangle> = all.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        assert_eq!(repaired(&turned), 512.0 - size, "{low:?} {high:?}");
    }
    // An octahedron whose vertices lie on the solid's faces.
    let mut octahedron: Vec<Triangle> = Vec::new();
    let at = |axis: usize, end: f64| {
        let mut point = [4.0; 3];
        point[axis] = end;
        point
    };
    for signs in 0..8 {
        let ends = [0, 1, 2].map(|axis| at(axis, if signs >> axis & 1 == 1 { 8.0 } else { 0.0 }));
        let [a, b, c] = ends;
        octahedron.push(if i32::count_ones(signs) % 2 == 1 { [a, c, b] } else { [a, b, c] });
    }
    let all = [body.clone(), octahedron].concat();
    let found = repaired(&all);
    assert!((found - (512.0 - 256.0 / 3.0)).abs() < 1e-4, "{found}");
    // Solids that touch from outside are oriented separately.
    let adjacent = [body.clone(), hollow([8.0, 0.0, 0.0], [10.0, 8.0, 8.0])].concat();
    assert_eq!(repaired(&adjacent), 640.0);
}

#[test]
fn shells_have_the_inner_cells_of_faces_on_cell_walls() {
    let options = with(unit_cells(4), |it| it.shell = true);
    let count = |triangles: &[Triangle]| {
        let (tree, _) = build(plain(triangles), &options);
        cells(&tree).iter().flatten().count()
    };
    // A cube on cell walls, oriented outward: the inner cells along its sides.
    let cube = cuboid([2.0; 3], [7.0; 3]);
    assert_eq!(count(&cube), 125 - 27);
    // Oriented inward: the outer ones.
    let inward: Vec<Triangle> = cube.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    assert_eq!(count(&inward), 6 * 25);
    // At the border of the tree only one side has cells.
    let all = cuboid([0.0; 3], [16.0; 3]);
    let inward: Vec<Triangle> = all.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    assert_eq!(count(&all), 16 * 16 * 16 - 14 * 14 * 14);
    assert_eq!(count(&inward), count(&all));
    // Two boxes with a duplicated common wall.
    let two = [cuboid([2.0; 3], [5.0, 7.0, 7.0]), cuboid([5.0, 2.0, 2.0], [8.0, 7.0, 7.0])].concat();
    assert_eq!(count(&two), 2 * (75 - 9));
}

#[test]
fn reported_models_are_right() {
    let Some(directory) = crate::common::reported_models() else { return };
    let of = |name: &str, change: &dyn Fn(&mut ExactOptions)| {
        let out = tempfile::tempdir().unwrap();
        let path = out.path().join("x.goblin");
        let options = with(ExactOptions::new(), |it| change(it));
        let models = open_all(&[directory.join(Path::new(name))], 64 << 20).unwrap();
        import_exact(models, &options, Output::create(&path).unwrap(), &()).unwrap();
        MassProperties::of(&ExactModel::open(&path, &Default::default()).unwrap(), &()).unwrap().volume
    };
    assert_eq!(of("turn_face.off", &|it| it.repair = true), 504.0);
    // A cube of 8 with a pit of 4 x 4 x 4, as its cells have it.
    assert_eq!(of("t2_pit.off", &|it| it.repair = true), 448.0);
    assert_eq!(of("patches.stl", &|it| it.close = true), 24.0);
}
