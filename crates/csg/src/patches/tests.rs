//! Shells of patches: volumes against formulas and numeric integrals, distances of facets, cracks,
//! refused shells, and untrusted files.

use std::collections::HashMap;
use std::path::Path;

use super::file::{patches as patches_of, text_of};
use super::patch::quadrature;
use super::*;
use crate::box_state::BoxState;
use crate::syntax::At;

/// Pseudorandom numbers from a fixed seed.
pub(super) struct Random(u64);

impl Random {
    /// Returns a number from -1 to 1.
    fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

const AT: At = At { line: 1, column: 1 };

/// The corners of the cube's sides, counterclockwise as seen from outside: origin and the two
/// directions.
fn cube_sides() -> [[Point; 3]; 6] {
    let e = |axis: usize| std::array::from_fn(|at| f64::from(u8::from(at == axis)));
    [0, 1, 2, 3, 4, 5].map(|side| {
        let (axis, u, v) = (side / 2, (side / 2 + 1) % 3, (side / 2 + 2) % 3);
        if side % 2 == 0 { [[0.0; 3], e(v), e(u)] } else { [e(axis), e(u), e(v)] }
    })
}

/// Returns the control points of a side of the unit cube, of a degree.
fn side_points([origin, along_u, along_v]: [Point; 3], degree: usize) -> Vec<Point> {
    let share = |index: usize| index as f64 / degree as f64;
    let point = |u: usize, v: usize| {
        [0, 1, 2].map(|axis| origin[axis] + share(u) * along_u[axis] + share(v) * along_v[axis])
    };
    (0..=degree).flat_map(|v| (0..=degree).map(move |u| point(u, v))).collect()
}

fn cube(degree: usize) -> Vec<Vec<Point>> {
    cube_sides().into_iter().map(|side| side_points(side, degree)).collect()
}

fn shells_of(points: &[Vec<Point>]) -> Result<Vec<Shell>> {
    let patches = points.iter().map(|points| Patch::new(points.clone(), AT).unwrap()).collect();
    shells(Path::new("test"), patches)
}

fn shell_of(points: &[Vec<Point>]) -> Shell {
    let mut all = shells_of(points).unwrap();
    assert_eq!(all.len(), 1);
    all.remove(0)
}

/// Returns the volume in facets.
fn facet_volume(facets: &super::facetting::Facets) -> f64 {
    let volume = |triangle: &[u32; 3]| {
        let [[a, b, c], [d, e, f], [g, h, i]] = triangle.map(|vertex| facets.vertices[vertex as usize]);
        a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    };
    facets.triangles.iter().map(volume).sum::<f64>() / 6.0
}

/// A map of the unit cube with a degree of at most `degree` in each coordinate.
struct Deformation {
    degree: usize,
    /// Coefficients of x^i y^j z^k, where i, j, k are at most `degree`.
    coefficients: Vec<Point>,
}

impl Deformation {
    fn random(random: &mut Random, degree: usize, size: f64) -> Deformation {
        let coefficients =
            (0..(degree + 1).pow(3)).map(|_| [(); 3].map(|()| size * random.number())).collect();
        Deformation { degree, coefficients }
    }

    fn apply(&self, at: Point) -> Point {
        let mut moved = at;
        for (number, coefficient) in self.coefficients.iter().enumerate() {
            let side = self.degree + 1;
            let powers = [number % side, number / side % side, number / side / side];
            let factor: f64 = (0..3).map(|axis| at[axis].powi(powers[axis] as i32)).product();
            (0..3).for_each(|axis| moved[axis] += coefficient[axis] * factor);
        }
        moved
    }

    /// Returns the determinant of the derivative, by central differences.
    fn stretch(&self, at: Point) -> f64 {
        const STEP: f64 = 1e-5;
        let column = |axis: usize| {
            let ends = [-STEP, STEP].map(|step| {
                let mut at = at;
                at[axis] += step;
                self.apply(at)
            });
            [0, 1, 2].map(|axis| (ends[1][axis] - ends[0][axis]) / (2.0 * STEP))
        };
        let [[a, b, c], [d, e, f], [g, h, i]] = [0, 1, 2].map(column);
        a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    }

    /// Returns the patches of the deformed cube, by interpolation of its sides.
    fn patches(&self) -> Vec<Vec<Point>> {
        let side = |[origin, along_u, along_v]: [Point; 3]| {
            let at = |u: f64, v: f64| {
                self.apply([0, 1, 2].map(|axis| origin[axis] + u * along_u[axis] + v * along_v[axis]))
            };
            let share = |index: usize| index as f64 / self.degree as f64;
            let mut points: Vec<Point> = (0..=self.degree)
                .flat_map(|v| (0..=self.degree).map(move |u| (share(u), share(v))))
                .map(|(u, v)| at(u, v))
                .collect();
            let row = self.degree + 1;
            for line in 0..row {
                interpolate(&mut points, line * row, 1, self.degree);
            }
            for line in 0..row {
                interpolate(&mut points, line, row, self.degree);
            }
            points
        };
        // (Adjacent sides have equal boundaries but for rounding, which is taken away.)
        let round = |point: Point| point.map(|at: f64| (at * 1e9).round() / 1e9);
        cube_sides().into_iter().map(|corners| side(corners).into_iter().map(round).collect()).collect()
    }
}

/// Replaces points of a curve at equal distances of the parameter by its control points.
fn interpolate(points: &mut [Point], first: usize, step: usize, degree: usize) {
    let at = |index: usize, axis: usize| points[first + index * step][axis];
    let inner: Vec<Point> = match degree {
        2 => vec![[0, 1, 2].map(|axis| 2.0 * at(1, axis) - (at(0, axis) + at(2, axis)) / 2.0)],
        _ => {
            let third = |axis: usize, ends: [usize; 2], [near, far]: [usize; 2]| {
                (-5.0 * at(ends[0], axis) + 18.0 * at(near, axis) - 9.0 * at(far, axis)
                    + 2.0 * at(ends[1], axis))
                    / 6.0
            };
            vec![
                [0, 1, 2].map(|axis| third(axis, [0, 3], [1, 2])),
                [0, 1, 2].map(|axis| third(axis, [3, 0], [2, 1])),
            ]
        }
    };
    for (index, point) in inner.into_iter().enumerate() {
        points[first + (index + 1) * step] = point;
    }
}

#[test]
fn cubes_have_their_volume_and_twelve_facets() {
    for degree in [2, 3] {
        let shell = shell_of(&cube(degree));
        assert!((shell.volume - 1.0).abs() < 1e-14, "{}", shell.volume);
        let facets = shell.facets(1e-3);
        // (Of degree 3, coordinates such as 1/3 are rounded, and second differences are not zero.)
        assert_eq!((facets.triangles.len(), facets.vertices.len()), (12, 8), "degree {degree}");
        assert!((facet_volume(&facets) - 1.0).abs() < 1e-14);
    }
    assert!(!shell_of(&cube(2)).is_curved());
}

/// A box with a roof of z = 1 + 16 h (u - u²) (v - v²): the volume is 1 + 4 h / 9.
#[test]
fn parabolic_roofs_have_the_volume_of_the_formula() {
    for height in [0.5, 2.0, -0.25] {
        let mut points = cube(2);
        // (The middle of the roof rises by a quarter of its inner control point.)
        points[5][4][2] += 4.0 * height;
        let shell = shell_of(&points);
        let exact = 1.0 + 4.0 / 9.0 * height;
        assert!((shell.volume - exact).abs() < 1e-14, "{} instead of {exact}", shell.volume);
        let top = shell.hull.iter().fold(0.0, |top: f64, point| top.max(point[2]));
        let peak = 1.0 + height.max(0.0);
        assert!(top >= peak && top < peak + 0.02 * height.abs(), "{top} above {peak}");
        for within in [0.1, 0.01, 0.001] {
            let facets = shell.facets(within);
            let found = facet_volume(&facets);
            // (The roof is over an area of 1.)
            assert!((found - exact).abs() <= within, "{found} instead of {exact} within {within}");
            assert!(facets.triangles.len() as f64 <= shell.facet_count(within));
        }
    }
}

/// Random smooth shells: volume against the numeric integral of the deformation, facets closed,
/// oriented, and within the distance.
#[test]
fn random_shells_agree_with_numeric_integrals() {
    let mut random = Random(42);
    for round in 0..6 {
        let degree = 2 + round % 2;
        let deformation = Deformation::random(&mut random, degree, 0.06);
        let mut points = deformation.patches();
        // Any orientation and order of parameters is right.
        for points in &mut points {
            if random.number() > 0.0 {
                let row = degree + 1;
                *points = (0..row * row).map(|at| points[at % row * row + at / row]).collect();
            }
        }
        let shell = shell_of(&points);
        const CELLS: usize = 3;
        let mut exact = 0.0;
        for cell in 0..CELLS.pow(3) {
            let first = [cell % CELLS, cell / CELLS % CELLS, cell / CELLS / CELLS];
            for (x, wx) in quadrature() {
                for (y, wy) in quadrature() {
                    for (z, wz) in quadrature() {
                        let at = [x, y, z];
                        let at = [0, 1, 2].map(|axis| (first[axis] as f64 + at[axis]) / CELLS as f64);
                        exact += wx * wy * wz * deformation.stretch(at);
                    }
                }
            }
        }
        exact /= CELLS.pow(3) as f64;
        assert!((shell.volume - exact).abs() < 1e-7, "{round}: {} instead of {exact}", shell.volume);
        for within in [0.02, 0.002] {
            check_facets(&shell, within);
        }
    }
}

/// Checks that facets are closed and oriented, and within a distance of the patches. The parameters
/// of their samples are found by a search on the patch, from the nearest of a grid of points.
fn check_facets(shell: &Shell, within: f64) {
    let facets = shell.facets(within);
    let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
    for triangle in &facets.triangles {
        for corner in 0..3 {
            let [from, to] = [triangle[corner], triangle[(corner + 1) % 3]];
            *edges.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
        }
    }
    assert!(edges.values().all(|sum| *sum == 0), "cracks within {within}");
    let positions: std::collections::HashSet<[u64; 3]> =
        facets.vertices.iter().map(|vertex| vertex.map(f64::to_bits)).collect();
    assert_eq!(positions.len(), facets.vertices.len(), "vertices at the same position");
    let error = (facet_volume(&facets) - shell.volume).abs();
    assert!(error < 20.0 * within && facets.triangles.len() as f64 <= shell.facet_count(within));
    let step = (facets.triangles.len() / 12).max(1);
    for triangle in facets.triangles.iter().step_by(step) {
        let corners = triangle.map(|vertex| facets.vertices[vertex as usize]);
        for weights in [[1.0 / 3.0; 3], [0.5, 0.5, 0.0], [0.1, 0.2, 0.7]] {
            let sample = [0, 1, 2].map(|axis| (0..3).map(|at| weights[at] * corners[at][axis]).sum());
            let distance = distance_to(shell, sample);
            assert!(distance <= within * 1.0001, "{distance}, more than {within}");
        }
    }
}

/// Returns the distance of a point from a shell.
fn distance_to(shell: &Shell, point: Point) -> f64 {
    const PARTS: usize = 8;
    let distance = |patch: &Patch, u: f64, v: f64| {
        let at = patch.at(u, v);
        (0..3).map(|axis| (at[axis] - point[axis]).powi(2)).sum::<f64>().sqrt()
    };
    let mut best = f64::INFINITY;
    for ShellPatch { patch, .. } in &shell.patches {
        let share = |at: usize| at as f64 / PARTS as f64;
        let starts = (0..=PARTS).flat_map(|v| (0..=PARTS).map(move |u| (share(u), share(v))));
        let (mut u, mut v) =
            starts.min_by(|a, b| distance(patch, a.0, a.1).total_cmp(&distance(patch, b.0, b.1))).unwrap();
        let (mut found, mut step) = (distance(patch, u, v), share(1));
        while step > 1e-5 {
            let around = [(-step, 0.0), (step, 0.0), (0.0, -step), (0.0, step)];
            let around = around.map(|(a, b)| ((u + a).clamp(0.0, 1.0), (v + b).clamp(0.0, 1.0)));
            let nearest = around
                .into_iter()
                .min_by(|a, b| distance(patch, a.0, a.1).total_cmp(&distance(patch, b.0, b.1)));
            let (next_u, next_v) = nearest.unwrap();
            let next = distance(patch, next_u, next_v);
            if next < found {
                (u, v, found) = (next_u, next_v, next);
            } else {
                step /= 2.0;
            }
        }
        best = best.min(found);
    }
    best
}

/// A lens: two patches with four common boundaries, one with a bulge. And a shell whose patches
/// have poles: a cone over a square.
#[test]
fn lenses_and_poles() {
    let flat = side_points(cube_sides()[5], 2);
    let mut bulge = flat.clone();
    bulge[4][2] += 1.0;
    let shell = shell_of(&[flat.clone(), bulge]);
    // (A bump of 1/4 in the middle.)
    assert!((shell.volume - 1.0 / 9.0).abs() < 1e-14, "{}", shell.volume);
    check_facets(&shell, 0.001);
    // A pyramid: each wall has its side v = 1 in the apex. One wall bulges.
    for bulge in [0.0, 0.25] {
        let base = side_points(cube_sides()[5], 2);
        let corners = [base[0], base[2], base[8], base[6]];
        let apex = [0.5, 0.5, 2.0];
        let mut all = vec![base];
        for wall in 0..4 {
            let [from, to] = [corners[wall], corners[(wall + 1) % 4]];
            let mix =
                |a: Point, b: Point, share: f64| [0, 1, 2].map(|axis| a[axis] + share * (b[axis] - a[axis]));
            let rows = [0.0, 0.5, 1.0];
            let mut points: Vec<Point> = rows
                .iter()
                .flat_map(|v| rows.iter().map(move |u| (*u, *v)))
                .map(|(u, v)| mix(mix(from, to, u), apex, v))
                .collect();
            if wall == 0 {
                points[4][1] -= bulge;
            }
            all.push(points);
        }
        let shell = shell_of(&all);
        let extra = shell.volume - 1.0 / 3.0;
        assert!(if bulge == 0.0 { extra.abs() < 1e-14 } else { extra > 0.01 }, "{extra}");
        check_facets(&shell, 0.002);
    }
}

/// Curves of one patch that need few segments, next to a patch that needs many, are the same.
#[test]
fn strips_join_fine_grids_to_coarse_boundaries() {
    let mut points = cube(3);
    [5, 6, 9, 10].into_iter().for_each(|at| points[5][at][2] += 3.0);
    let shell = shell_of(&points);
    check_facets(&shell, 0.02);
    let facets = shell.facets(0.001);
    assert!(facets.triangles.len() > 1000 && facets.vertices.iter().filter(|at| at[2] == 0.0).count() == 4);
}

/// Points and boxes: against the formula of a box with a parabolic roof.
#[test]
fn points_are_in_the_facets() {
    let mut points = cube(2);
    points[5][4][2] += 2.0;
    let tree = FacetTree::of(&shell_of(&points).facets(1e-4));
    let roof = |x: f64, y: f64| 1.0 + 8.0 * x * (1.0 - x) * y * (1.0 - y);
    let mut random = Random(7);
    let (mut inside, mut uniform) = (0, 0);
    for _ in 0..4000 {
        let at = [(); 3].map(|()| 0.5 + 0.8 * random.number());
        let [x, y, z] = at;
        let is_inside = (0.0..1.0).contains(&x) && (0.0..1.0).contains(&y) && z > 0.0 && z < roof(x, y);
        if (z - roof(x, y)).abs() > 1e-4 {
            assert_eq!(tree.has(at), is_inside, "{at:?}");
        }
        inside += u32::from(is_inside);
        let half = 0.1 * random.number().abs();
        let state = tree.classify(at, [half; 3]);
        if state != BoxState::Mixed {
            uniform += 1;
            for _ in 0..8 {
                let at = at.map(|at| at + half * random.number());
                assert_eq!(tree.has(at), state == BoxState::Full);
            }
        }
    }
    assert!(inside > 500 && uniform > 500, "{inside} and {uniform}");
    // Rays through vertices and edges.
    assert!(tree.has([0.5, 0.5, 0.5]) && !tree.has([0.5, 0.5, 3.0]) && !tree.has([0.5, 0.5, -1.0]));
    assert_eq!(FacetTree::default().classify([0.0; 3], [1.0; 3]), BoxState::Void);
}

fn message(points: &[Vec<Point>]) -> String {
    shells_of(points).unwrap_err().to_string()
}

#[test]
fn shells_that_enclose_nothing_are_refused() {
    let all = cube(2);
    let found = message(&all[..5]);
    assert!(found.contains("open shell: the boundary") && found.contains("from (0, 0, 1) to"), "{found}");
    let mut unequal = all.clone();
    unequal[5][1][1] += 0.125;
    let found = message(&unequal);
    assert!(found.contains("different boundary curves of the patches") && found.contains("6"), "{found}");
    let mut twice = all.clone();
    twice.extend(cube(2));
    let found = message(&twice);
    assert!(found.contains("of 4 patches"), "{found}");
    let found = message(&[all[0].clone(), all[0].clone()]);
    assert!(found.contains("without a volume"), "{found}");
    let mut back = all.clone();
    back[0][2] = back[0][0];
    assert!(message(&back).contains("returns along itself"), "{}", message(&back));
    // A Klein bottle of one patch: two sides have the same curve in the same direction.
    let [p, a, b, c, d] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]];
    let bottle = vec![p, a, b, p, c, [3.0; 3], [4.0; 3], c, d, [5.0; 3], [6.0; 3], d, p, b, a, p];
    let found = message(&[bottle]);
    assert!(found.contains("patches 1 and 1 on a surface with a single side"), "{found}");
    // Separate shells are separate solids.
    let far = all.iter().map(|points| points.iter().map(|at| [at[0] + 5.0, at[1], at[2]]).collect());
    let two: Vec<Vec<Point>> = all.iter().cloned().chain(far).collect();
    assert_eq!(shells_of(&two).unwrap().len(), 2);
}

#[test]
fn files_round_trip_and_malformed_ones_are_refused() {
    let path = Path::new("test.bpt");
    let text = text_of(&[cube(2), cube(3)].concat());
    let read = patches_of(path, &text).unwrap();
    let points: Vec<Vec<Point>> = read.iter().map(|patch| patch.points().to_vec()).collect();
    assert_eq!(points, [cube(2), cube(3)].concat());
    let (_, csg) = csg_of_patches(path, &text_of(&cube(2))).unwrap();
    let again = crate::Csg::parse(path, &csg).unwrap();
    let direct = crate::Csg::of_patches(path, &text_of(&cube(2))).unwrap();
    assert_eq!((again.text(), again.primitives()), (direct.text(), direct.primitives()));
    for (wrong, expected) in [
        ("", "line 1, column 1: got the end of the file, expected the number of patches"),
        ("0", "the number of patches, from 1 to 8192"),
        ("-3", "the number of patches"),
        ("18446744073709551615", "the number of patches"),
        ("99999999999999999999999", "the number of patches"),
        ("1\n3 2\n", "line 2, column 3: got `2`, expected the degrees of patch 1 of 1"),
        ("1\n65536 65536\n", "`3 3` (bicubic)"),
        ("8192\n3 3\n0 0 0\n1 NaN 0", "line 4, column 3: got `NaN`"),
        ("1\n2 2\n0 inf 0", "got `inf`"),
        ("1\n2 2\n0 1e31 0", "got `1e31`"),
        ("1\n2 2\n0 é 0", "got `é`"),
        ("2\n2 2\n0 0 0\n", "got the end of the file, expected a coordinate of point 2 of 9 of patch 1"),
    ] {
        let found = crate::Csg::of_patches(path, wrong).unwrap_err().to_string();
        assert!(found.contains(expected) && found.starts_with("test.bpt, line "), "{wrong:?}: {found}");
    }
    // All truncated files are refused, and so is more than the number of patches says.
    let text = text_of(&cube(2));
    for end in (0..text.trim_end().len()).step_by(7) {
        assert!(crate::Csg::of_patches(path, &text[..end]).is_err(), "{end}");
    }
    assert!(crate::Csg::of_patches(path, &(text.clone() + "7")).unwrap_err().to_string().contains("got `7`"));
    // Changed bytes never do harm.
    let mut random = Random(3);
    for _ in 0..400 {
        let mut bytes = text.clone().into_bytes();
        let at = ((random.number() + 1.0) / 2.0 * bytes.len() as f64) as usize % bytes.len();
        bytes[at] = b"0123456789 .-e\n"[((random.number() + 1.0) * 7.4) as usize];
        let _ = crate::Csg::of_patches(path, &String::from_utf8(bytes).unwrap());
    }
}

#[test]
fn patches_in_a_csg_text() {
    let parse = |text: &str| crate::Csg::parse(Path::new("t"), text);
    let (_, text) = csg_of_patches(Path::new("t"), &text_of(&cube(3))).unwrap();
    assert_eq!(
        parse(&format!("let a = {text} difference(a, translate(0.5,0,0, a))")).unwrap().primitives(),
        2
    );
    for (wrong, expected) in [
        ("patches()", "a patch of 9 or 16 points of three numbers"),
        ("patches([[0,0],[1,0],[0,1]])", "a patch of 9 or 16 points of three numbers"),
        ("patches([[0,0,0],[1,0,0]])", "got 2 points of patch 1, expected 9 points (biquadratic)"),
        ("patches([[0,0,0],[1,0]])", "got a point of two numbers, expected three, as before"),
        ("prism([[0,0],[1,0,2],[0,1]], 0, 1)", "got a point of three numbers, expected two, as before"),
        ("prism([[0,0,0],[1,0,2],[0,1,0]], 0, 1)", "expected an outline"),
        ("patches([[0,0,0,0]])", "`]`: the point at line 1, column 10 has two or three numbers"),
        ("patches([[0]])", "`,`: the point at line 1, column 10"),
    ] {
        let found = parse(wrong).unwrap_err().to_string();
        assert!(found.contains(expected), "{wrong}: {found}");
    }
}
