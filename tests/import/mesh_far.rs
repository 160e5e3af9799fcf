//! Solids far from the origin, and in millimetres: cells and exact models equal those of the same
//! solid at the origin.

use spinney::brep::MassProperties;
use spinney::import::mesh::{ExactOptions, Resolution, SolidOptions, import_exact};
use spinney::query::EdgeRule;
use spinney::{ExactModel, Output};

use crate::common::solid::{Point, Triangle, build, cells, cuboid, plain, tetrahedra};
use crate::common::{Random, reported_models, with};

/// Distances from the origin.
const OFFSETS: [Point; 3] = [[1e6; 3], [1e9, -1e9, 1e9], [1e9, 0.0, 1e6]];

fn moved(triangles: &[Triangle], factor: f64, offset: Point) -> Vec<Triangle> {
    let point = |point: Point| [0, 1, 2].map(|axis| factor * (point[axis] + offset[axis]));
    triangles.iter().map(|triangle| triangle.map(point)).collect()
}

/// Solids whose coordinates are multiples of 1/64 and therefore exact at any offset.
fn solids() -> Vec<Vec<Triangle>> {
    let mut cavity = cuboid([4.5; 3], [11.25, 9.5, 20.0]);
    cavity.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    let mut random = Random(62);
    vec![
        cuboid([0.0; 3], [100.0; 3]),
        cuboid([0.25, 1.5, -3.75], [17.5, 9.0, 21.625]),
        [cuboid([0.5; 3], [24.0; 3]), cavity].concat(),
        tetrahedra(&mut random, 1, 64.0, 0.25),
        tetrahedra(&mut random, 6, 64.0, 0.125),
    ]
}

#[test]
fn cells_far_from_the_origin_are_those_at_the_origin() {
    for (number, solid) in solids().iter().enumerate() {
        for factor in [1.0, 1000.0] {
            for resolution in [
                Resolution::Cells(16),
                Resolution::Cell(4.0 * factor),
                Resolution::Depth(3),
                Resolution::Cells(13),
            ] {
                for (edge, shell) in [
                    (EdgeRule::Area, false),
                    (EdgeRule::Touch, false),
                    (EdgeRule::Centre, false),
                    (EdgeRule::Touch, true),
                ] {
                    let options = with(SolidOptions::new(), |it| {
                        (it.resolution, it.edge, it.shell) = (resolution.clone(), edge, shell);
                    });
                    let of = |offset: Point| {
                        let (tree, report) = build(plain(&moved(solid, factor, offset)), &options);
                        (tree.header().extent, report.triangles, cells(&tree))
                    };
                    let expected = of([0.0; 3]);
                    for offset in OFFSETS {
                        let found = of(offset);
                        assert!(found == expected, "solid {number} at {offset:?}, {factor}, {options:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn cells_of_decimal_widths_far_from_the_origin_fill_the_box() {
    for offset in [0.0, 1e6, 1e9] {
        for cell in [0.1, 0.3, 0.7, 1.1] {
            // Walls of the box are at multiples of the cell, up to double precision.
            let wall = |cells: f64| (f64::round(offset / cell) + cells) * cell;
            let solid = cuboid([wall(0.0); 3], [wall(20.0), wall(30.0), wall(10.0)]);
            let options = with(SolidOptions::new(), |it| it.resolution = Resolution::Cell(cell));
            let (tree, _) = build(plain(&solid), &options);
            assert_eq!(tree.header().extent, [20, 30, 10], "{cell} at {offset}");
            assert_eq!(cells(&tree).iter().flatten().count(), 6000, "{cell} at {offset}");
        }
    }
}

#[test]
fn exact_models_far_from_the_origin_have_the_same_volume() {
    let volume = |triangles: &[Triangle]| {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x.goblin");
        let mut options = ExactOptions::new();
        options.repair = true;
        let output = Output::create(&path).unwrap();
        import_exact(vec![plain(triangles)], &options, output, &()).unwrap();
        let model = ExactModel::open(&path, &Default::default()).unwrap();
        MassProperties::of(&model, &()).unwrap().volume
    };
    for (number, solid) in solids().iter().enumerate() {
        for factor in [1.0, 1000.0] {
            let expected = volume(&moved(solid, factor, [0.0; 3]));
            for offset in OFFSETS {
                let found = volume(&moved(solid, factor, offset));
                assert!(
                    (found - expected).abs() <= 1e-9 * expected,
                    "solid {number} at {offset:?}: {found} {expected}"
                );
            }
        }
    }
}

/// A house in millimetres, in UTM coordinates.
#[test]
fn a_house_in_millimetres_keeps_its_volume() {
    let Some(path) = reported_models().map(|models| models.join("house_mm_utm.off")) else { return };
    for resolution in
        [Resolution::Cells(64), Resolution::Cells(50), Resolution::Cell(200.0), Resolution::Cell(300.0)]
    {
        let options = with(SolidOptions::new(), |it| it.resolution = resolution.clone());
        let model = spinney::raw::import::mesh::open(&path, 64 << 20).unwrap();
        let (tree, _) = build(model, &options);
        let cell = tree.metadata().frame.matrix[0][0];
        let share: f64 =
            cells(&tree).iter().flatten().map(|cell| f64::from(crate::common::as_byte(*cell)) / 255.0).sum();
        let volume = share * cell.powi(3);
        // Walls pass through cells whose centres decide.
        assert!((volume / 1e12 - 1.0).abs() < 0.01 + cell / 1e4, "{resolution:?}: {volume}");
    }
}
