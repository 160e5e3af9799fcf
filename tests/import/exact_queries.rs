//! Queries of exact models of real meshes: measures against rational numbers, and results against
//! all faces.
#![allow(clippy::needless_range_loop)] // axes are indices of several arrays at once

use bnum::types::I512;
use spinney::brep::{Faces, MassProperties};
use spinney::raw::brep::FaceList;
use spinney::raw::brep::query::{CoverageSums, Cube, Line, nearest_on_face};

use crate::common::exact::snapped;
use crate::common::{Random, shared_data};

/// The closed meshes of `expected.tsv`: name, volume, area, and number of triangles.
fn closed() -> Vec<(String, f64, f64, f64)> {
    let Some(data) = shared_data() else { return Vec::new() };
    let table = std::fs::read_to_string(data.join("mesh/expected.tsv")).unwrap();
    let rows = table.lines().skip(1).map(|line| line.split('\t').collect::<Vec<_>>());
    rows.filter(|cells| cells[3] == "True" && cells[4] == "True")
        .map(|cells| {
            let number = |cell: usize| cells[cell].parse::<f64>().unwrap();
            (cells[0].to_string(), number(7), number(8), number(1))
        })
        .collect()
}

/// Twice the area vector of a triangle.
fn area_of(corners: &[[i32; 3]; 3]) -> [i64; 3] {
    let [a, b, c] = corners.map(|corner| corner.map(i64::from));
    let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// Integrals over a solid, each times a constant, by Gauss' theorem along one axis: integrals of
/// coordinate powers over the faces.
struct Rational {
    volume: I512,
    first: [I512; 3],
    second: [[I512; 3]; 3],
}

fn wide(number: impl Into<i128>) -> I512 {
    use bnum::cast::As;
    number.into().as_()
}

impl Rational {
    /// 6 times the volume, 24 times the first and 120 times the second moments.
    fn of(list: &FaceList) -> Rational {
        let mut sums = Rational { volume: wide(0), first: [wide(0); 3], second: [[wide(0); 3]; 3] };
        list.each(&mut |face| {
            let corners: [[i32; 3]; 3] = face.points.try_into().unwrap();
            let normal = area_of(&corners).map(wide);
            let at = |corner: usize, axis: usize| i64::from(corners[corner][axis]);
            sums.volume += normal[0] * wide((0..3).map(|corner| at(corner, 0)).sum::<i64>());
            for axis in 0..3 {
                // Twelve times the mean of the square, so 24 times that of half of it.
                let mut square = 0;
                for (i, j) in (0..3).flat_map(|i| (0..=i).map(move |j| (i, j))) {
                    square += at(i, axis) * at(j, axis);
                }
                sums.first[axis] += normal[axis] * wide(square);
            }
            for axis in 0..3 {
                for other in 0..3 {
                    // 60 times the mean of the coordinate's square times the other coordinate.
                    let mut cube = 0i128;
                    for (i, j, k) in (0..27).map(|n| (n % 3, n / 3 % 3, n / 9)) {
                        let times = match (i == j, j == k, i == k) {
                            (true, true, true) => 6,
                            (false, false, false) => 1,
                            _ => 2,
                        };
                        cube += i128::from(times * at(i, axis) * at(j, axis)) * i128::from(at(k, other));
                    }
                    sums.second[axis][other] += normal[axis] * wide(cube);
                }
            }
            Ok(())
        })
        .unwrap();
        // Integrated along the axis, xx is a third of the cube, and xy half of xxy; the area is
        // half of the normal.
        for (axis, row) in sums.second.iter_mut().enumerate() {
            for (other, sum) in row.iter_mut().enumerate() {
                *sum /= if axis == other { wide(3) } else { wide(2) };
            }
        }
        sums
    }
}

/// Returns the double nearest to a quotient, computed via its decimals.
fn quotient(number: I512, divisor: I512) -> f64 {
    let is_negative = (number < wide(0)) != (divisor < wide(0));
    let (number, divisor) = (number.unsigned_abs(), divisor.unsigned_abs());
    let mut digits = format!("{}.", number / divisor);
    let (mut rest, ten) = (number % divisor, wide(10).unsigned_abs());
    for _ in 0..60 {
        rest *= ten;
        digits.push_str(&(rest / divisor).to_string());
        rest %= divisor;
    }
    let number: f64 = digits.parse().unwrap();
    if is_negative { -number } else { number }
}

#[test]
fn measures_of_real_meshes_are_the_rational_numbers_rounded_once() {
    let meshes = closed();
    for (path, volume, area, triangles) in &meshes {
        let list = snapped(path, &|_| true).unwrap();
        let found = MassProperties::of(&list, &()).unwrap();
        let grid = list.grid();
        // The grid unit is a power of two, so scaling does not round.
        let (width, expected) = (grid.width(), Rational::of(&list));
        assert_eq!(found.volume, quotient(expected.volume, wide(6)) * width.powi(3), "{path:?}");
        let weight = expected.volume * wide(4);
        let centre = [0, 1, 2]
            .map(|axis| quotient(weight * wide(grid.origin[axis]) + expected.first[axis], weight) * width);
        assert_eq!(found.centre, Some(centre), "{path:?}");
        for i in 0..3 {
            for j in 0..3 {
                let about_origin = weight * expected.second[i][j];
                let number = about_origin - wide(5) * expected.first[i] * expected.first[j];
                let moment = quotient(number, expected.volume * wide(480)) * width.powi(5);
                assert_eq!(found.second_moments[i][j], moment, "{path:?} {i} {j}");
                if i != j {
                    assert_eq!(found.inertia[i][j], -moment, "{path:?}");
                }
            }
        }
        // Moving vertices by half a grid unit along each axis changes the volume by at most the
        // area times that.
        let moved = 2.0 * area * width + volume.abs() * 1e-9;
        assert!((found.volume - volume).abs() < moved, "{path:?}: {} {volume}", found.volume);
        assert!(
            (found.area - area).abs() < area * 1e-6 + triangles * width,
            "{path:?}: {} {area}",
            found.area
        );
        assert!(found.inertia.iter().enumerate().all(|(axis, row)| row[axis] > 0.0), "{path:?}");
    }
    assert!(meshes.is_empty() || meshes.len() >= 8, "{}", meshes.len());
}

/// The coverage of a level's cells adds up to the solid, and lines and points agree with it.
#[test]
fn cells_of_a_real_mesh_add_up() {
    let Some(list) = snapped("spot.ply", &|_| true) else { return };
    let grid = list.grid();
    let mass = MassProperties::of(&list, &()).unwrap();
    let level = 3;
    let side = 1u32 << (grid.bits - level);
    let bounds: Vec<[[i32; 3]; 2]> = (0..list.len() as usize)
        .map(|number| {
            let face = list.get(number);
            let extreme = |pick: fn(i32, i32) -> i32| {
                [0, 1, 2].map(|axis| face.points.iter().map(|p| p[axis]).reduce(pick).unwrap())
            };
            [extreme(i32::min), extreme(i32::max)]
        })
        .collect();
    let (mut volume, mut moments, mut cut) = (0.0, [0.0; 3], 0);
    for cell in 0..1i32 << (3 * level) {
        let min =
            [0, 1, 2].map(|axis| (cell >> (axis * i32::from(level)) & ((1 << level) - 1)) * side as i32);
        let mut sums = CoverageSums::new(Cube { min, side });
        for (number, [low, high]) in bounds.iter().enumerate() {
            if (0..3).all(|axis| low[axis] < min[axis] + side as i32 && high[axis] >= min[axis]) {
                sums.add_face(&list.get(number));
                cut += 1;
            }
        }
        let winding: i32 = Line::between_corners(grid, [0; 3], min).map_or(0, |line| {
            let crossings = (0..list.len() as usize).filter_map(|number| line.crossing(&list.get(number)));
            crossings.map(|crossing| if crossing.is_entry { 1 } else { -1 }).sum()
        });
        assert!(winding == 0 || winding == 1, "{winding}");
        let part = sums.coverage(winding == 1);
        let full = f64::from(side).powi(3);
        assert!(part.volume > -1e-9 * full && part.volume < full * (1.0 + 1e-9), "{}", part.volume / full);
        volume += part.volume;
        for axis in 0..3 {
            moments[axis] += part.moments[axis] + (f64::from(min[axis]) - 0.5) * part.volume;
        }
    }
    assert!(cut > 5856);
    let scale = grid.width().powi(3);
    assert!((volume * scale / mass.volume - 1.0).abs() < 1e-12, "{}", volume * scale / mass.volume - 1.0);
    for axis in 0..3 {
        let centre = (moments[axis] / volume + grid.origin[axis] as f64) * grid.width();
        assert!((centre - mass.centre.unwrap()[axis]).abs() < 1e-12);
    }
}

/// No line passes between two faces, even exactly through edges and vertices.
#[test]
fn lines_through_a_real_mesh_enter_as_often_as_they_leave() {
    let Some(list) = snapped("spot.ply", &|_| true) else { return };
    let mut random = Random(5);
    let mut met = 0;
    for round in 0..400 {
        let mut corner = || {
            let points = list.get(random.below(list.len()) as usize).points;
            points[random.below(3) as usize].map(f64::from)
        };
        let (a, b) = (corner(), corner());
        let mut direction = [0, 1, 2].map(|axis| b[axis] - a[axis]);
        // Along an axis, or between two vertices.
        if round % 2 == 0 {
            direction = [0.0; 3];
            direction[round / 2 % 3] = 1e6;
        }
        let from = [0, 1, 2].map(|axis| a[axis] - 100.0 * direction[axis]);
        let Some(line) = Line::ray(list.grid(), from, direction) else { continue };
        let mut crossings: Vec<_> =
            (0..list.len() as usize).filter_map(|number| line.crossing(&list.get(number))).collect();
        crossings.sort_by(|a, b| a.share.total_cmp(&b.share));
        let mut inside = 0;
        for crossing in &crossings {
            inside += if crossing.is_entry { 1 } else { -1 };
        }
        assert_eq!(inside, 0, "{from:?} {direction:?}");
        met += crossings.len();
    }
    assert!(met > 500, "{met}");
}

/// A line's first hit is no nearer than the nearest point.
#[test]
fn nearest_points_are_nearer_than_what_lines_meet() {
    let Some(list) = snapped("suzanne.ply", &|_| true) else { return };
    let mut random = Random(6);
    let (mut met, side) = (0, 1u64 << list.grid().bits);
    for _ in 0..300 {
        let from = [0; 3].map(|_| random.below(side) as f64);
        let nearest = (0..list.len() as usize)
            .map(|number| nearest_on_face(&list.get(number), from))
            .min_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared))
            .unwrap();
        let distance = nearest.distance_squared.sqrt();
        // A little past the nearest point: the line meets a face there, and none before.
        let direction = [0, 1, 2].map(|axis| (nearest.point[axis] - from[axis]) / distance);
        let Some(line) = Line::ray(list.grid(), from, direction) else { continue };
        let first = (0..list.len() as usize)
            .filter_map(|number| line.crossing(&list.get(number)))
            .map(|crossing| crossing.share)
            .fold(f64::INFINITY, f64::min);
        assert!(first > distance - 1e-3, "{first} {distance}");
        met += usize::from(first < distance + 1e-3);
    }
    assert!(met > 200, "{met}");
}
