//! Queries of exact model files, against all of their faces.
#![allow(clippy::needless_range_loop)] // axes are indices of several arrays at once

use spinney::ExactModel;
use spinney::brep::{BoxLocation, Faces, Grid, Location, MassProperties};
use spinney::raw::brep::FaceList;
use spinney::raw::brep::query::{CoverageSums, Cube, Line, nearest_on_face};
use spinney::raw::geometry::{Box3, GridPolygon, Triangulator};

use crate::common::Random;
use crate::common::exact::{cuboid, file_of, model_on, snapped, turned};

/// Models with and without holes, with small and large cells, and one of a real mesh.
fn models() -> Vec<(&'static str, FaceList, ExactModel)> {
    let grid = |bits, step, origin| Grid { bits, origin, step, divisor: 1.0 };
    // A box with a tunnel along z, and a cavity.
    let mut tunnel = cuboid([3, 5, 7], [120, 90, 100]);
    let walls = turned(cuboid([40, 40, 7], [60, 70, 100]));
    tunnel[0].extend(walls[0].iter().cloned());
    tunnel[1].extend(walls[1].iter().cloned());
    tunnel.extend(walls[2..].iter().cloned());
    tunnel.extend(turned(cuboid([10, 10, 20], [30, 30, 31])));
    // Many small boxes on a large grid with units of one eighth.
    let mut random = Random(11);
    let mut boxes = Vec::new();
    for place in 0..125 {
        let min = [place % 5, place / 5 % 5, place / 25].map(|at| at * 13_000_000 + 17);
        // Every second one fills its grid position.
        let least = if place % 2 == 0 { 3_000_000 } else { 1 };
        let size = [0; 3].map(|_| least + random.below(1 << (10 + place % 14)) as i32);
        boxes.extend(cuboid(min, [0, 1, 2].map(|axis| min[axis] + size[axis])));
    }
    let mut lists = vec![
        ("tunnel", model_on(grid(7, 1.0, [0; 3]), &tunnel)),
        ("boxes", model_on(grid(26, 0.125, [-1000, 5, 77]), &boxes)),
    ];
    lists.extend(snapped("spot.ply", &|_| true).map(|list| ("spot", list)));
    lists.into_iter().map(|(name, list)| (name, list.clone(), file_of(&list))).collect()
}

/// Returns a random point in the grid or slightly outside, in world coordinates.
fn point(grid: &Grid, random: &mut Random) -> [f64; 3] {
    let side = (1u64 << grid.bits) as f64;
    [0, 1, 2].map(|axis| {
        let at = (random.below(1 << 20) as f64 / (1 << 20) as f64 * 1.2 - 0.1) * side;
        (at + grid.origin[axis] as f64) * grid.width()
    })
}

fn faces(list: &FaceList) -> impl Iterator<Item = spinney::brep::Face<'_>> {
    (0..list.len() as usize).map(|number| list.get(number))
}

#[test]
fn measures_of_a_file_are_those_of_its_faces() {
    for (name, list, model) in models() {
        let [expected, found] =
            [&list as &dyn Faces, &model].map(|faces| MassProperties::of(faces, &()).unwrap());
        assert_eq!(found, expected, "{name}");
        assert_eq!(Some(model.bounds().unwrap()), expected.bounds, "{name}");
    }
}

#[test]
fn nearest_points_are_those_of_all_faces() {
    for (name, list, model) in models() {
        let grid = list.grid();
        let mut random = Random(1);
        let (mut faces_read, cases) = (0, 300);
        for _ in 0..cases {
            let to = point(grid, &mut random);
            let expected = faces(&list)
                .map(|face| nearest_on_face(&face, grid.to_grid(to)))
                .min_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared).then(a.face.cmp(&b.face)))
                .unwrap();
            let found = model.nearest(to).unwrap().unwrap();
            assert_eq!(found.face, expected.face, "{name} {to:?}");
            let distance = expected.distance_squared.sqrt() * grid.width();
            assert_eq!(found.distance, distance, "{name} {to:?}");
            faces_read += found.visited.faces;
            let sign = if model.locate(to).unwrap() == Location::Inside { -1.0 } else { 1.0 };
            assert_eq!(model.signed_distance(to).unwrap(), sign * distance, "{name} {to:?}");
            assert_eq!(model.nearest_within(to, distance * 1.001).unwrap().unwrap().face, expected.face);
            if distance > 0.0 {
                assert_eq!(model.nearest_within(to, distance * 0.999).unwrap(), None);
            }
        }
        assert!(faces_read < cases * (10 + list.len() / 5), "{name}: {faces_read} faces");
        assert_eq!(model.nearest([f64::NAN; 3]).unwrap(), None);
    }
}

#[test]
fn rays_hit_the_same_faces_as_a_full_scan() {
    for (name, list, model) in models() {
        let grid = list.grid();
        let mut random = Random(2);
        let (mut met, mut faces_read, cases) = (0, 0, 400);
        // Rays share cached reads, which must not change results.
        let (mut rays, mut queries, mut results) = (model.rays(), Vec::new(), Vec::new());
        for case in 0..cases {
            let (mut from, mut to) = (point(grid, &mut random), point(grid, &mut random));
            // Also exactly along edges and through vertices.
            if case % 2 == 0 {
                let corners = faces(&list).nth(random.below(list.len()) as usize).unwrap().points;
                let corner = |random: &mut Random| corners[random.below(corners.len() as u64) as usize];
                let (a, b) = (corner(&mut random), corner(&mut random));
                let at = |share: i32| [0, 1, 2].map(|axis| a[axis] + share * (b[axis] - a[axis]));
                (from, to) = (grid.to_world(at(-5)), grid.to_world(at(3)));
            }
            let direction = [0, 1, 2].map(|axis| to[axis] - from[axis]);
            let expected = |line: Option<Line>| {
                let Some(line) = line else { return Vec::new() };
                let crossings = faces(&list).filter_map(|face| Some((face.number, line.crossing(&face)?)));
                let mut all: Vec<_> = crossings.collect();
                all.sort_by(|a, b| a.1.share.total_cmp(&b.1.share).then(a.0.cmp(&b.0)));
                all
            };
            let steps = direction.map(|along| along / grid.width());
            let (found, visited) = model.ray(from, direction).unwrap();
            let first = expected(Line::ray(grid, grid.to_grid(from), steps)).first().copied();
            let place = found.map(|hit| (hit.face, hit.share, hit.is_entry));
            assert_eq!(
                place,
                first.map(|(face, it)| (face, it.share, it.is_entry)),
                "{name} {from:?} {to:?}"
            );
            assert_eq!(rays.first(from, direction).unwrap(), found, "{name} {from:?} {to:?}");
            assert_eq!(
                model.ray_crossings(from, direction).unwrap().first().map(|hit| hit.share),
                found.map(|hit| hit.share)
            );
            queries.push([from, direction]);
            results.push(found);
            if let Some(hit) = found {
                let (face, normal) = rays.face(hit.face).unwrap();
                assert_eq!(face.number, hit.face);
                let along: f64 = (0..3).map(|axis| normal[axis] as f64 * direction[axis]).sum();
                assert!(along == 0.0 || hit.is_entry == (along < 0.0), "{name} {from:?} {to:?}");
            }
            faces_read += visited.faces;
            met += u64::from(found.is_some());
            let all = expected(Line::between(grid, grid.to_grid(from), grid.to_grid(to)));
            let found = model.crossings(from, to).unwrap();
            assert_eq!(found.len(), all.len(), "{name}");
            assert!(found.iter().zip(&all).all(|(found, (_, it))| found.share == it.share));
            let first = model.between(from, to).unwrap().0;
            assert_eq!(first.map(|hit| hit.face), all.first().map(|it| it.0));
            let winding: i32 = found.iter().map(|hit| if hit.is_entry { 1 } else { -1 }).sum();
            assert!((-1..=1).contains(&winding));
        }
        queries.push([[f64::NAN; 3], [1.0; 3]]);
        results.push(None);
        assert_eq!(rays.first_of(&queries).unwrap(), results, "{name}");
        assert!(met > cases / 5, "{name}: {met}");
        assert!(faces_read < cases * (12 + list.len() / 5), "{name}: {faces_read} faces");
    }
}

/// Returns whether a grid cell's minimum corner is inside, by rays from outside.
fn is_inside(list: &FaceList, min: [i32; 3]) -> bool {
    let Some(line) = Line::between_corners(list.grid(), [0; 3], min) else { return false };
    let crossings = faces(list).filter_map(|face| line.crossing(&face));
    crossings.map(|crossing| if crossing.is_entry { 1 } else { -1 }).sum::<i32>() > 0
}

#[test]
fn boxes_are_inside_or_outside_or_cut() {
    for (name, list, model) in models() {
        let grid = list.grid();
        let mut random = Random(3);
        let mut counts = [0; 3];
        let mut triangulator = Triangulator::new();
        for case in 0..600 {
            // Walls half way between grid points keep the computation exact.
            let side = 1u64 << random.below(u64::from(grid.bits));
            let min = if case % 4 == 0 {
                // Near a vertex, where small boxes are cut.
                let points = faces(&list).nth(random.below(list.len()) as usize).unwrap().points;
                points[0].map(|at| at + random.below(side + 3) as i32 - side as i32 - 1)
            } else {
                [0; 3].map(|_| random.below(1 << grid.bits) as i32)
            };
            let min = min.map(|at| at.max(0));
            let low = min.map(|at| 2 * i64::from(at) - 1);
            let bounds = Box3 { min: low, max: low.map(|at| at + 2 * side as i64) };
            let is_cut = faces(&list).any(|face| {
                let points: Vec<[i64; 3]> =
                    face.points.iter().map(|point| point.map(|at| 2 * i64::from(at))).collect();
                GridPolygon::new(&points, face.ring_ends, &mut triangulator).unwrap().cuts(&bounds).cuts
            });
            let expected = match is_cut {
                true => BoxLocation::Cut,
                false if is_inside(&list, min) => BoxLocation::Inside,
                false => BoxLocation::Outside,
            };
            let [low, high] = [bounds.min, bounds.max].map(|corner| {
                [0, 1, 2].map(|axis| (corner[axis] as f64 / 2.0 + grid.origin[axis] as f64) * grid.width())
            });
            let (found, visited) = model.locate_box(low, high).unwrap();
            assert_eq!(found, expected, "{name} {bounds:?}");
            counts[found as usize] += 1;
            assert!(visited.faces <= list.len() * 4);
        }
        assert!(counts.iter().all(|count| *count > 2), "{name} {counts:?}");
        let [low, high] = [[-1e9; 3], [1e9; 3]];
        assert_eq!(model.locate_box(low, high).unwrap().0, BoxLocation::Cut);
        assert_eq!(model.locate_box([1e8; 3], high).unwrap().0, BoxLocation::Outside);
        assert!(model.locate_box(high, low).is_err());
        assert!(model.locate_box([f64::NAN; 3], high).is_err());
    }
}

#[test]
fn coverage_of_cells_is_that_of_all_faces() {
    for (name, list, model) in models() {
        let grid = list.grid();
        let mut random = Random(4);
        let mut partly = 0;
        for case in 0..400 {
            let level = random.below(u64::from(grid.bits) + 1) as u8;
            let mut position = [0; 3].map(|_| random.below(1 << level) as u32);
            if case % 2 == 0 {
                let points = faces(&list).nth(random.below(list.len()) as usize).unwrap().points;
                position = points[0].map(|at| at as u32 >> (grid.bits - level));
            }
            let side = 1u32 << (grid.bits - level);
            let cube = Cube { min: position.map(|at| (at * side) as i32), side };
            let mut sums = CoverageSums::new(cube);
            faces(&list).for_each(|face| sums.add_face(&face));
            let expected = sums.coverage(is_inside(&list, cube.min));
            let found = model.cell_coverage(level, position, &()).unwrap();
            let share = expected.volume / f64::from(side).powi(3);
            // Large faces and small cells: see the error bounds.
            let tolerance = 1e-13 + f64::from(1 << grid.bits) / f64::from(side) * 1e-14;
            assert!((found.share - share).abs() < tolerance, "{name} {cube:?} {} {share}", found.share);
            assert!((found.volume / (f64::from(side) * grid.width()).powi(3) - found.share).abs() < 1e-12);
            if share > 1e-3 && share < 0.999 {
                partly += 1;
                let centre = found.centre.unwrap();
                for axis in 0..3 {
                    let at = (expected.moments[axis] / expected.volume - 0.5) + f64::from(cube.min[axis]);
                    let found = centre[axis] / grid.width() - grid.origin[axis] as f64;
                    assert!(
                        (found - at).abs() < 1e-3 * f64::from(side) * tolerance / 1e-13,
                        "{name} {found} {at}"
                    );
                }
            }
        }
        assert!(partly > 60, "{name} {partly}");
        let all = model.cell_coverage(0, [0; 3], &()).unwrap();
        let mass = MassProperties::of(&list, &()).unwrap();
        assert!((all.volume / mass.volume - 1.0).abs() < 1e-12, "{name}");
        let (centre, expected) = (all.centre.unwrap(), mass.centre.unwrap());
        assert!(
            (0..3).all(|axis| (centre[axis] - expected[axis]).abs()
                < 1e-9 * (1u64 << grid.bits) as f64 * grid.width())
        );
        assert!(model.cell_coverage(grid.bits + 1, [0; 3], &()).is_err());
        assert!(model.cell_coverage(1, [0, 2, 0], &()).is_err());
    }
}
