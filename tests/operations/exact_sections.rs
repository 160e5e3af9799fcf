//! Sections of exact models: areas and outlines against the solids.

use spinney::brep::{CuttingPlane, Faces};
use spinney::raw::brep::query::SectionPolygon;

use crate::common::Random;
use crate::common::exact::{cuboid, prism, snapped, turned};
use crate::common::sets::{Body, Solid, combined, cut_at_edges, tetrahedron, triangulated};

fn section(body: &Body, plane: CuttingPlane) -> Vec<SectionPolygon> {
    let found = body.model.section(&plane, &()).unwrap();
    for ring in found.iter().flat_map(|polygon| &polygon.rings) {
        assert!(ring.len() > 3 && ring.first() == ring.last());
        let length = plane.normal.iter().map(|part| part * part).sum::<f64>().sqrt();
        for point in ring {
            let height = (0..3).map(|axis| plane.normal[axis] * point[axis]).sum::<f64>() - plane.distance;
            assert!((height / length).abs() < 1e-6, "{point:?}: {height}");
        }
    }
    assert!(found.iter().all(|polygon| polygon.area > 0.0));
    found
}

fn area(polygons: &[SectionPolygon]) -> f64 {
    polygons.iter().map(|polygon| polygon.area).sum()
}

/// Checks that section areas add up to the volume: between vertex heights the area is quadratic in
/// the height, so two sections suffice (Gauss).
fn assert_volume(body: &Body, axis: usize, name: &str) {
    let mut heights = Vec::new();
    let mut add = |face: &spinney::brep::Face<'_>| {
        heights.extend(face.points.iter().map(|point| point[axis]));
        Ok(())
    };
    body.model.each(&mut add).unwrap();
    heights.sort_unstable();
    heights.dedup();
    let mut volume = 0.0;
    for pair in heights.windows(2) {
        let [low, high] = [0, 1].map(|end| body.model.grid().to_world([pair[end]; 3])[axis]);
        let (middle, reach) = ((low + high) / 2.0, (high - low) / 2.0 / 3f64.sqrt());
        let areas =
            [middle - reach, middle + reach].map(|at| area(&section(body, CuttingPlane::across(axis, at))));
        volume += (high - low) / 2.0 * (areas[0] + areas[1]);
    }
    let expected = body.volume();
    assert!((volume - expected).abs() < 1e-9 * expected, "{name}, axis {axis}: {volume} {expected}");
}

/// A square frame: a prism with a hole, and a cube in the hole.
fn frame() -> Solid {
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole = square(20, 80).into_iter().rev().collect();
    let mut faces = prism(&[square(10, 90), hole], 10, 50);
    faces.extend(cuboid([40, 40, 20], [60, 60, 40]));
    faces
}

#[test]
fn polygons_have_their_holes() {
    let body = Body::of(&frame(), 7);
    let mut found = section(&body, CuttingPlane::across(2, 30.5));
    found.sort_by(|a, b| a.area.total_cmp(&b.area));
    let areas: Vec<f64> = found.iter().map(|polygon| polygon.area).collect();
    assert_eq!(areas, [400.0, 6400.0 - 3600.0]);
    assert_eq!(found.iter().map(|polygon| polygon.rings.len()).collect::<Vec<_>>(), [1, 2]);
    // From the other side, outlines are the same with reversed orientation.
    let below = CuttingPlane { normal: [0.0, 0.0, -2.0], distance: -61.0 };
    assert_eq!(area(&section(&body, below)), 3200.0);
    // Just below a plane: what ends there counts, what starts there does not.
    for (height, expected) in
        [(10.0, 0.0), (20.0, 2800.0), (40.0, 3200.0), (50.0, 2800.0), (50.5, 0.0), (-7.0, 0.0)]
    {
        assert_eq!(area(&section(&body, CuttingPlane::across(2, height))), expected, "{height}");
    }
    for axis in 0..3 {
        assert_volume(&body, axis, "frame");
    }
    // Across a corner: a right triangle on each face.
    let corner = Body::of(&cuboid([0; 3], [8; 3]), 4);
    let found = section(&corner, CuttingPlane { normal: [1.0; 3], distance: 3.0 });
    assert!((area(&found) - 9.0 * 3f64.sqrt() / 2.0).abs() < 1e-12);
}

#[test]
fn areas_add_up_to_volumes() {
    let mut random = Random(12);
    let mut corner = || [0; 3].map(|_: i32| random.below(1000) as i32);
    let mut bodies = Vec::new();
    while bodies.len() < 6 {
        let corners = [corner(), corner(), corner(), corner()];
        bodies.extend(tetrahedron(corners).map(|faces| Body::of(&faces, 10)));
    }
    for pair in bodies.chunks(2) {
        // For results, the proxies of their exact faces are cut: vertices move by half a grid unit.
        let of = |body: &Body, at: f64| area(&section(body, CuttingPlane::across(1, at)));
        let [union, common] = [7, 1].map(|operation| combined(operation, &[&pair[0], &pair[1]]));
        for at in (0..20).map(|step| f64::from(step) * 50.0 + 25.0) {
            let parts = of(&pair[0], at) + of(&pair[1], at) - of(&common, at);
            assert!((of(&union, at) - parts).abs() < 2500.0, "{at}: {} {parts}", of(&union, at));
        }
        pair.iter().for_each(|body| (0..3).for_each(|axis| assert_volume(body, axis, "tetrahedron")));
    }
    // A cavity, and edges whose other face has no area.
    let cube = cuboid([60; 3], [960; 3]);
    let hollow: Solid = cube.iter().cloned().chain(turned(cuboid([160; 3], [500; 3]))).collect();
    assert_volume(&Body::of(&hollow, 10), 0, "hollow");
    let cut = cut_at_edges(&triangulated(&cube), 60, &mut random);
    (0..3).for_each(|axis| assert_volume(&Body::of(&cut, 10), axis, "vertices on edges"));
    for name in ["fandisk.ply", "suzanne.ply"] {
        let Some(list) = snapped(name, &|_| true) else {
            eprintln!("skipped: no {name}");
            continue;
        };
        let (bytes, _) = crate::common::exact::built(&list, 64 << 20, 12);
        let Some(bytes) = bytes else { continue };
        let body = Body::of_bytes(bytes);
        let [low, high] = body.model.bounds().unwrap();
        let steps = 500;
        let width = (high[1] - low[1]) / f64::from(steps);
        let mut heights = (0..steps as usize).map(|step| low[1] + (step as f64 + 0.5) * width);
        let (mut volume, mut next) = (0.0, 0);
        let mut each = |number: usize, polygons: &[SectionPolygon]| {
            assert_eq!(number, next);
            next += 1;
            volume += area(polygons) * width;
            // Individual sections are the same.
            if number.is_multiple_of(100) {
                let at = low[1] + (number as f64 + 0.5) * width;
                assert_eq!(section(&body, CuttingPlane::across(1, at)), polygons);
            }
            Ok(())
        };
        body.model.plane_sections([0.0, 1.0, 0.0], &mut heights, false, &(), &mut each).unwrap();
        assert!((volume - body.volume()).abs() < 1e-4 * body.volume(), "{name}: {volume} {}", body.volume());
    }
}

/// Points on oblique planes are in polygons if and only if they are in the solid.
#[test]
fn points_in_sections_are_in_bodies() {
    let mut random = Random(3);
    let body = Body::of(&frame(), 7);
    let mut unit = || random.below(2001) as f64 / 1000.0 - 1.0;
    for _ in 0..60 {
        let plane = CuttingPlane { normal: [unit(), unit(), unit() + 0.003], distance: 40.0 * unit() };
        let found = section(&body, plane);
        let [u, v] = plane.axes();
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|axis| a[axis] * b[axis]).sum::<f64>();
        let scale = plane.distance / dot(plane.normal, plane.normal);
        for _ in 0..50 {
            let (along, up) = (90.0 * unit(), 90.0 * unit());
            let point = [0, 1, 2].map(|axis| plane.normal[axis] * scale + along * u[axis] + up * v[axis]);
            let (x, y) = (dot(point, u), dot(point, v));
            let mut inside = false;
            for ends in found.iter().flat_map(|polygon| &polygon.rings).flat_map(|ring| ring.windows(2)) {
                let [a, b] = [0, 1].map(|end| [dot(ends[end], u), dot(ends[end], v)]);
                if (a[1] > y) != (b[1] > y) {
                    inside ^= a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) > x;
                }
            }
            assert_eq!(inside, body.is_inside(point), "{plane:?} {point:?}");
        }
    }
}

#[test]
fn trees_without_sections_are_rejected() {
    let body = Body::of(&cuboid([1; 3], [5; 3]), 4);
    for plane in [
        CuttingPlane { normal: [0.0; 3], distance: 1.0 },
        CuttingPlane { normal: [f64::NAN, 0.0, 1.0], distance: 1.0 },
        CuttingPlane { normal: [1.0, 0.0, 0.0], distance: f64::INFINITY },
    ] {
        assert!(body.model.section(&plane, &()).unwrap_err().to_string().contains("plane"), "{plane:?}");
    }
    let outside = combined(12, &[&body]);
    assert!(
        outside
            .model
            .section(&CuttingPlane::across(0, 3.0), &())
            .unwrap_err()
            .to_string()
            .contains("complement")
    );
}
