//! Exact models viewed through maps, against files of the transformed models.

use spinney::brep::{BoxLocation, CuttingPlane, Faces, Hit, MassProperties, Motion};
use spinney::raw::brep::ModelView;
use spinney::raw::brep::query::SectionPolygon;
use spinney::{Error, ExactModel};

use super::exact_motions::{bodies, motion, moved, off_grid_bodies, symmetries};
use crate::common::Random;
use crate::common::sets::{Body, MEMORY};

fn seen(body: &Body, map: &Motion) -> ModelView {
    ModelView::of(ExactModel::from_bytes(body.bytes.clone()).unwrap(), map).unwrap()
}

/// Returns an off-grid point in or around a box.
fn random_point(random: &mut Random, [low, high]: [[f64; 3]; 2]) -> [f64; 3] {
    [0, 1, 2].map(|axis| {
        let share = (random.below(1_400_000) as f64 + 0.31) / 1e6 - 0.2;
        low[axis] + share * (high[axis] - low[axis])
    })
}

fn direction(random: &mut Random) -> [f64; 3] {
    [(); 3].map(|()| (random.below(2001) as f64 - 999.7) / 500.0)
}

fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * (1.0 + a.abs().max(b.abs()))
}

fn are_near(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|axis| is_near(a[axis], b[axis]))
}

fn hits_are_near(a: &[Hit], b: &[Hit]) -> bool {
    let is_same = |(a, b): (&Hit, &Hit)| {
        is_near(a.share, b.share)
            && are_near(a.point, b.point)
            && a.is_entry == b.is_entry
            && a.part == b.part
    };
    a.len() == b.len() && a.iter().zip(b).all(is_same)
}

fn sections_are_near(a: &[SectionPolygon], b: &[SectionPolygon], normal: [f64; 3]) -> bool {
    let areas = |found: &[SectionPolygon]| {
        let mut areas: Vec<f64> = found.iter().map(|polygon| polygon.area).collect();
        areas.sort_by(f64::total_cmp);
        areas
    };
    // Rings have the right orientation, and enclose the reported area.
    let is_whole = |polygon: &SectionPolygon| {
        let mut doubled = 0.0;
        for ring in &polygon.rings {
            assert_eq!(ring.first(), ring.last());
            for ends in ring.windows(2) {
                let from = |end: usize| [0, 1, 2].map(|axis| ends[end][axis] - polygon.rings[0][0][axis]);
                let ([a, b, c], [x, y, z]) = (from(0), from(1));
                let across = [b * z - c * y, c * x - a * z, a * y - b * x];
                doubled += (0..3).map(|axis| across[axis] * normal[axis]).sum::<f64>();
            }
        }
        let length = normal.iter().map(|part| part * part).sum::<f64>().sqrt();
        (doubled / 2.0 / length - polygon.area).abs() <= 1e-9 * (1.0 + polygon.area)
    };
    let (own, others) = (areas(a), areas(b));
    own.len() == others.len()
        && own.iter().zip(&others).all(|(a, b)| is_near(*a, *b))
        && a.iter().all(is_whole)
}

/// Returns maps that preserve grids: signs and orders of coordinates, translations by whole units,
/// and one scale factor.
fn exact_maps() -> Vec<Motion> {
    let mut all = symmetries();
    let steps: [&[&str]; 5] = [
        &["translate=3,-4,500"],
        &["scale=25.4"],
        &["scale=0.5", "translate=8,0,0", "scale=0.25"],
        &["rotate=90,x@1,2,3", "mirror=z", "scale=4"],
        &["rotate=-90", "rotate=180,y", "translate=1,1,1"],
    ];
    all.extend(steps.iter().map(|steps| motion(steps)));
    all
}

/// A view through quarter turns, mirrorings, whole units and one factor returns the same results as
/// the file of the transformed model: containment and measures are equal, and ray hits up to each
/// file's rounding.
#[test]
fn views_of_grids_are_exact() {
    let mut random = Random(3);
    let [_, _, both, _] = off_grid_bodies();
    let all = bodies();
    for (number, body) in all.iter().take(3).chain([&both]).enumerate() {
        for map in exact_maps().iter().skip(number).step_by(3) {
            let ((file, _), view) = (moved(body, map), seen(body, map));
            let model = &file.model;
            assert!(view.is_exact() && view.rounding() == 0.0);
            let bounds = model.bounds().unwrap();
            assert_eq!(view.bounds().unwrap(), bounds, "{map:?}");
            let (a, b) = (view.mass(&()).unwrap(), MassProperties::of(model, &()).unwrap());
            // Volumes of off-grid solids are doubles.
            assert!(is_near(a.volume, b.volume));
            assert_eq!(MassProperties { volume: b.volume, ..a }, b, "{map:?}");
            let [own, others] = [view.part_measures(MEMORY, &()), model.part_measures(MEMORY, &())];
            assert_eq!(own.unwrap()[0].measures.bounds, others.unwrap()[0].measures.bounds);
            for _ in 0..40 {
                let point = random_point(&mut random, bounds);
                assert_eq!(view.locate(point).unwrap(), model.locate(point).unwrap());
                let (a, b) = (view.signed_distance(point).unwrap(), model.signed_distance(point).unwrap());
                assert!(is_near(a, b), "{a} {b}");
                let along = direction(&mut random);
                let (a, b) = (view.ray_crossings(point, along), model.ray_crossings(point, along));
                assert!(hits_are_near(&a.unwrap(), &b.unwrap()), "{map:?} {point:?} {along:?}");
                let rays = [[point, along], [point, along.map(|at| -at)]];
                let (a, b) = (view.rays().first_of(&rays).unwrap(), model.rays().first_of(&rays).unwrap());
                let list = |hits: &[Option<Hit>]| hits.iter().flatten().copied().collect::<Vec<_>>();
                assert!(hits_are_near(&list(&a), &list(&b)) && a[0].is_some() == b[0].is_some());
                let end = random_point(&mut random, bounds);
                let corners = [f64::min, f64::max].map(|of| [0, 1, 2].map(|axis| of(point[axis], end[axis])));
                let expected = model.locate_box(corners[0], corners[1]).unwrap().0;
                assert_eq!(view.locate_box(corners[0], corners[1]).unwrap(), expected);
            }
            if model.is_unbounded() {
                continue;
            }
            for normal in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, -2.0, 0.5]] {
                let point = random_point(&mut random, bounds);
                let distance = (0..3).map(|axis| normal[axis] * point[axis]).sum();
                let plane = CuttingPlane { normal, distance };
                let (a, b) = (view.section(&plane, &()).unwrap(), model.section(&plane, &()).unwrap());
                assert!(sections_are_near(&a, &b, normal), "{map:?} {plane:?}: {a:?} {b:?}");
            }
        }
    }
}

/// Grid points and points on faces are classified exactly, also for decimal grid units.
#[test]
fn what_lies_on_the_surface_does_so_in_exact_views() {
    use spinney::brep::{Grid, Location};

    use crate::common::exact::{cuboid, model_on};
    let grid = Grid::over([[0.0; 3], [1.0; 3]], Some(0.001)).unwrap();
    let body = Body::of_list(&model_on(grid, &cuboid([1; 3], [900, 100, 7])));
    for steps in
        [&["translate=25,-0.003,7"][..], &["rotate=90@0.1,0.2", "mirror=z"], &["scale=25.4", "axes=+y,-x,+z"]]
    {
        let (map, view) = (motion(steps), seen(&body, &motion(steps)));
        let (file, _) = moved(&body, &map);
        file.model
            .each(&mut |face| {
                for point in face.points {
                    let at = file.model.grid().to_world(*point);
                    assert_eq!(view.locate(at).unwrap(), Location::Boundary, "{steps:?} {at:?}");
                    assert_eq!(view.signed_distance(at).unwrap(), 0.0);
                }
                Ok(())
            })
            .unwrap();
    }
}

/// Arbitrary maps: results are those of the model's own points, mapped. Quantities that such a map
/// changes are recomputed, or rejected.
#[test]
fn views_through_any_map_carry_what_they_can() {
    let mut random = Random(8);
    let [_, _, both, _] = off_grid_bodies();
    let all = bodies();
    let maps: [(&[&str], Option<f64>); 6] = [
        (&["rotate=30,1,2,3@5,6,7"], Some(1.0)),
        (&["rotate=17,x", "mirror=y", "scale=3"], Some(3.0)),
        (&["translate=0.3141592,0,0"], Some(1.0)),
        (&["rotate=90", "translate=0.3141592,0,0"], Some(1.0)),
        (&["scale=1,2,0.5", "mirror=z"], None),
        (&["affine=-1,0.25,0,3,0,2,0,1,0,0.5,1,0"], None),
    ];
    for (steps, factor) in maps {
        let map = motion(steps);
        for body in all[..3].iter().chain([&both]) {
            let (view, model) = (seen(body, &map), &body.model);
            assert!(!view.is_exact() && (1e-18..1e-6).contains(&view.rounding()), "{}", view.rounding());
            let bounds = model.bounds().unwrap();
            for _ in 0..40 {
                let point = random_point(&mut random, bounds);
                let there = map.apply(point);
                assert_eq!(view.locate(there).unwrap(), model.locate(point).unwrap(), "{steps:?}");
                let end = random_point(&mut random, bounds);
                let along = [0, 1, 2].map(|axis| map.apply(end)[axis] - there[axis]);
                let own = [0, 1, 2].map(|axis| end[axis] - point[axis]);
                let expected = model.ray_crossings(point, own).unwrap();
                let expected: Vec<Hit> =
                    expected.into_iter().map(|hit| Hit { point: map.apply(hit.point), ..hit }).collect();
                let found = view.ray_crossings(there, along).unwrap();
                assert!(hits_are_near(&found, &expected), "{steps:?}: {found:?} {expected:?}");
                match factor {
                    Some(factor) => {
                        let distance = view.signed_distance(there).unwrap();
                        assert!(is_near(distance, factor * model.signed_distance(point).unwrap()));
                        let nearest = view.nearest(there).unwrap().unwrap();
                        assert!(is_near(nearest.distance, distance.abs()));
                    }
                    None => {
                        let error = view.signed_distance(there).unwrap_err().to_string();
                        assert!(error.contains("affine=") && error.contains("spinney transform"), "{error}");
                    }
                }
            }
            let contacts = view.object_contacts(MEMORY, &(), &mut |_| Ok(true));
            assert_eq!(contacts.is_ok(), factor.is_some());
        }
    }
    // Boxes stay boxes if axes are preserved.
    let view = seen(&all[2], &motion(&["scale=1,2,0.5", "mirror=z"]));
    assert_eq!(view.bounds().unwrap(), [[0.0, 0.0, -1.5], [15.0, 14.0, 0.0]]);
    assert_eq!(view.locate_box([1.0, 1.0, -1.25], [14.0, 13.0, -0.25]).unwrap(), BoxLocation::Inside);
    assert_eq!(view.locate_box([1.0, 1.0, -1.25], [14.0, 15.0, -0.25]).unwrap(), BoxLocation::Cut);
    let turned = seen(&all[2], &motion(&["rotate=1"]));
    assert!(matches!(turned.locate_box([0.0; 3], [1.0; 3]), Err(Error::Unsupported { .. })));
    assert!(matches!(turned.locate_box([1.0; 3], [0.0; 3]), Err(Error::Invalid { .. })));
    assert!(matches!(turned.as_model("rasters"), Err(Error::Unsupported { .. })));
    assert!(seen(&all[2], &motion(&["scale=3"])).as_model("rasters").is_ok());
}

/// Measures and sections against a file of the transformed model, on a grid with little rounding.
#[test]
fn measures_and_sections_are_those_of_what_was_moved() {
    use spinney::brep::Grid;

    use crate::common::exact::{cuboid, model_on, prism};
    let grid = Grid { bits: 26, origin: [-500, 0, 1000], step: 1.0, divisor: 1_000_000.0 };
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole = square(3_000_000, 5_000_000).into_iter().rev().collect();
    let mut faces = prism(&[square(1_000_000, 9_000_000), hole], 300_000, 11_000_000);
    faces.extend(cuboid([9_500_000, 0, 0], [9_800_000, 2_000_000, 9_000_000]));
    let body = Body::of_list(&model_on(grid, &faces));
    for steps in [
        &["rotate=30,1,2,3@5,6,7"][..],
        &["scale=1,2,0.5", "mirror=z", "rotate=10,y"],
        &["affine=-1,0.25,0,3,0,2,0,1,0,0.5,1,0"],
    ] {
        let map = motion(steps);
        let ((file, _), view) = (moved(&body, &map), seen(&body, &map));
        let (a, b) = (view.mass(&()).unwrap(), MassProperties::of(&file.model, &()).unwrap());
        let is_like = |a: f64, b: f64| (a - b).abs() < 1e-5 * (1.0 + b.abs());
        let pairs = a.inertia.as_flattened().iter().zip(b.inertia.as_flattened());
        assert!(pairs.clone().all(|(a, b)| is_like(*a, *b)), "{steps:?} {a:?} {b:?}");
        assert!(is_like(a.volume, b.volume) && is_like(a.area, b.area), "{a:?} {b:?}");
        let corners = [a.bounds, b.bounds].map(|bounds| bounds.unwrap().as_flattened().to_vec());
        assert!(corners[0].iter().zip(&corners[1]).all(|(a, b)| is_like(*a, *b)), "{corners:?}");
        let parts = view.part_measures(MEMORY, &()).unwrap();
        assert!(is_like(parts[0].measures.area, b.area) && parts[0].measures.bounds == a.bounds);
        let centre = b.centre.unwrap();
        for normal in [[0.0, 0.0, 1.0], [1.0, -2.0, 0.5]] {
            let middle: f64 = (0..3).map(|axis| normal[axis] * centre[axis]).sum();
            let mut planes = Vec::new();
            let mut distances = (0..3).map(|number| middle + f64::from(number) * 0.37);
            view.plane_sections(normal, &mut distances, false, &(), &mut |_, found| {
                planes.push(found.to_vec());
                Ok(())
            })
            .unwrap();
            for (number, found) in planes.iter().enumerate() {
                let distance = middle + number as f64 * 0.37;
                let expected = file.model.section(&CuttingPlane { normal, distance }, &()).unwrap();
                let area = |found: &[SectionPolygon]| found.iter().map(|polygon| polygon.area).sum::<f64>();
                assert!(is_like(area(found), area(&expected)), "{steps:?} {normal:?} {number}");
                assert!(sections_are_near(found, found, normal));
            }
        }
    }
}
