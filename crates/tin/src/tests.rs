//! Surfaces compared with brute-force models.

use crate::{
    Duplicates, HeightGrid, Isoline, LayerInput, LayerOptions, LayerSurface, Smoothing, SurfaceInput, Tin,
    approximate, build_layers, triangulate,
};
use robust::{Coord, incircle};
use spinney_base::io::Output;
use spinney_brep::ExactModel;
use spinney_brep::query::MassProperties;

/// Pseudorandom numbers below a bound, from a seed.
pub(crate) fn random(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) % below
    }
}

/// Points with heights from a function, at positions that may repeat.
fn scattered(count: usize, below: u64, seed: u64, height: &dyn Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
    let mut random = random(seed);
    let mut place = || random(below) as f64;
    let positions = (0..count).map(|_| [place(), place()]);
    positions.map(|[x, y]| [x, y, height(x, y)]).collect()
}

fn of_points(points: Vec<[f64; 3]>) -> SurfaceInput {
    SurfaceInput { points, ..SurfaceInput::default() }
}

fn square(size: f64) -> Vec<Vec<Vec<[f64; 2]>>> {
    vec![vec![vec![[0.0, 0.0], [size, 0.0], [size, size], [0.0, size]]]]
}

fn area(points: &[[f64; 2]]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
}

/// The area of the convex hull, by gift wrapping.
fn hull_area(points: &[[f64; 2]]) -> f64 {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    let chain = |points: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while chain.len() > 1
                && crate::mesh::side(chain[chain.len() - 2], chain[chain.len() - 1], *point) <= 0.0
            {
                chain.pop();
            }
            chain.push(*point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter());
    hull.extend(chain(&mut sorted.iter().rev()));
    area(&hull)
}

/// Checks that triangles are counterclockwise and cover the area, and that no circumcircle contains
/// a point.
fn check_delaunay(tin: &Tin) {
    let points: Vec<[f64; 2]> = tin.vertices().map(|[x, y, _]| [x, y]).collect();
    let mut sum = 0.0;
    for corners in tin.triangles() {
        let corners = corners.map(|corner| points[corner as usize]);
        let own = area(&corners);
        assert!(own > 0.0, "{corners:?}");
        sum += own;
        let at = |[x, y]: [f64; 2]| Coord { x, y };
        let [a, b, c] = corners.map(at);
        assert!(points.iter().all(|point| incircle(a, b, c, at(*point)) <= 0.0), "{corners:?}");
    }
    assert_eq!(sum, hull_area(&points));
}

#[test]
fn triangulations_are_delaunay() {
    for (seed, below) in [(1, 3), (2, 5), (3, 12), (4, 1000), (5, 1 << 20)] {
        for count in [6, 20, 150] {
            let points = scattered(count, below, seed, &|x, y| 3.0 * x - y);
            let Ok((tin, report)) = triangulate(&of_points(points.clone())) else { continue };
            check_delaunay(&tin);
            assert_eq!(tin.vertices().len() as u64 + report.duplicates, points.len() as u64);
            for [x, y, z] in points {
                assert_eq!(tin.height([x, y]), Some(z));
            }
        }
    }
}

#[test]
fn breaklines_are_edges() {
    for seed in 0..40 {
        let points = scattered(60, 30, seed, &|x, y| x * y);
        let mut random = random(seed + 100);
        // Lines along rows and columns, which meet in grid points or not at all, and one without
        // heights.
        let row = random(30) as f64;
        let line = |y: f64| vec![[-1.0, y, -y], [12.0, y, 12.0 * y], [31.0, y, 31.0 * y]];
        let unknown = vec![[3.5, row + 0.25, f64::NAN], [9.5, row + 0.25, f64::NAN]];
        let mut input = of_points(points.clone());
        input.breaklines = vec![line(row), unknown.clone()];
        let (tin, _) = triangulate(&input).unwrap();
        let positions: Vec<[f64; 2]> = tin.vertices().map(|[x, y, _]| [x, y]).collect();
        let edges: Vec<[u32; 2]> =
            tin.triangles().iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
        for [a, b] in tin.constraints() {
            assert!(edges.contains(&[*a, *b]) || edges.contains(&[*b, *a]));
        }
        for line in &input.breaklines {
            for ends in line.windows(2) {
                let length: f64 = tin
                    .constraints()
                    .iter()
                    .map(|edge| edge.map(|end| positions[end as usize]))
                    .filter(|edge| {
                        edge.iter()
                            .all(|at| at[1] == ends[0][1] && (ends[0][0]..=ends[1][0]).contains(&at[0]))
                    })
                    .map(|[a, b]| (b[0] - a[0]).abs())
                    .sum();
                assert_eq!(length, ends[1][0] - ends[0][0]);
            }
        }
        let plain = triangulate(&of_points(tin_known(&points, &input.breaklines[0]))).unwrap().0;
        for [x, y, _] in unknown {
            let (found, expected) = (tin.height([x, y]), plain.height([x, y]));
            assert_eq!(found, expected);
        }
        let total: f64 =
            tin.triangles().iter().map(|corners| area(&corners.map(|at| positions[at as usize]))).sum();
        assert!((total - hull_area(&positions)).abs() < 1e-9 * total);
    }
}

fn tin_known(points: &[[f64; 3]], line: &[[f64; 3]]) -> Vec<[f64; 3]> {
    points.iter().chain(line).copied().collect()
}

#[test]
fn outlines_bound_the_surface() {
    let mut points = scattered(300, 100, 7, &|x, y| x + 2.0 * y);
    points.extend([[0.0, 0.0, 0.0], [100.0, 0.0, 100.0], [0.0, 100.0, 200.0], [100.0, 100.0, 300.0]]);
    let mut input = of_points(points);
    let outer = vec![[10.0, 10.0], [90.0, 20.0], [80.0, 85.0], [50.0, 40.0], [15.0, 70.0], [10.0, 10.0]];
    let hole = vec![[30.0, 20.0], [40.0, 20.0], [40.0, 30.0], [30.0, 30.0]];
    // A fault extends beyond the outline.
    input.breaklines = vec![vec![[0.0, 33.5, f64::NAN], [100.0, 36.5, f64::NAN]]];
    input.outlines = vec![vec![outer.clone(), hole.clone()]];
    let (tin, report) = triangulate(&input).unwrap();
    let expected = area(&outer).abs() - area(&hole).abs();
    let (found, volume) = tin.integral();
    assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
    assert!(volume > 0.0 && report.crossings >= 2 && report.extended == 0, "{report:?}");
    assert_eq!(tin.height([35.0, 25.0]), None);
    assert_eq!(tin.height([50.0, 60.0]), None);
    for [x, y, z] in tin.vertices() {
        assert!((z - x - 2.0 * y).abs() < 1e-9);
    }
    // Outside of the convex hull, heights are those of the nearest point on it, and the report
    // counts these vertices.
    input.outlines = vec![vec![vec![[-50.0, 40.0], [20.0, 40.0], [20.0, 50.0], [-50.0, 50.0]]]];
    let (tin, report) = triangulate(&input).unwrap();
    assert_eq!(report.extended, 2);
    assert!((tin.height([-50.0, 40.0]).unwrap() - 80.0).abs() < 1e-9);
}

#[test]
fn crossing_lines_are_reported() {
    let mut input = of_points(scattered(50, 100, 3, &|x, _| x));
    input.breaklines =
        vec![vec![[10.5, 10.5, 0.0], [90.5, 90.5, 0.0]], vec![[10.5, 90.5, 0.0], [90.5, 10.5, 0.0]]];
    let error = triangulate(&input).unwrap_err().to_string();
    assert!(error.contains("crosses") && error.contains("10.5, 90.5"), "{error}");
    // Lines that meet in a common point are valid.
    input.breaklines = vec![
        vec![[10.5, 10.5, 0.0], [50.5, 50.5, 0.0], [90.5, 90.5, 0.0]],
        vec![[10.5, 90.5, 0.0], [50.5, 50.5, 0.0], [90.5, 10.5, 0.0]],
    ];
    assert!(triangulate(&input).is_ok());
}

#[test]
fn different_heights_at_a_position_are_reported_or_averaged() {
    let mut points =
        vec![[0.0, 0.0, 1.0], [4.0, 0.0, 2.0], [0.0, 4.0, 3.0], [4.0, 0.0, 5.0], [0.0, 0.0, 1.0]];
    let error = triangulate(&of_points(points.clone())).unwrap_err().to_string();
    assert!(error.contains("2 to 5 at 4, 0"), "{error}");
    let input = SurfaceInput { duplicates: Duplicates::Mean, ..of_points(points.clone()) };
    let (tin, report) = triangulate(&input).unwrap();
    assert_eq!((tin.height([4.0, 0.0]), report.averaged, report.duplicates), (Some(3.5), 1, 2));
    points[4][1] = -0.0;
    points.remove(3);
    assert_eq!(triangulate(&of_points(points)).unwrap().1.duplicates, 1);
}

#[test]
fn input_without_area_is_rejected() {
    let line: Vec<[f64; 3]> = (0..100_000).map(|at| [f64::from(at), 2.0 * f64::from(at), 0.0]).collect();
    let cases = [
        Vec::new(),
        vec![[1.0, 2.0, 3.0]],
        vec![[1.0, 2.0, 3.0]; 100_000],
        vec![[1.0, 2.0, 3.0], [5.0, 2.0, 3.0]],
        line,
        vec![[0.0, 0.0, 0.0], [1.0, 0.0, f64::NAN], [0.0, 1.0, 0.0]],
        vec![[0.0, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0], [0.0, 1.0, 0.0]],
        vec![[0.0, 0.0, 0.0], [1e300, 0.0, 0.0], [0.0, 1.0, 0.0]],
        vec![[0.0, 0.0, 0.0], [1e-300, 0.0, 0.0], [0.0, 1.0, 0.0]],
    ];
    for points in cases {
        let count = points.len();
        assert!(triangulate(&of_points(points)).is_err(), "{count} points");
    }
}

#[test]
fn nearly_collinear_points_are_triangulated_in_bounded_time() {
    let mut points: Vec<[f64; 3]> = (0..100_000).map(|at| [f64::from(at), 0.0, 0.0]).collect();
    points.push([10.0, 1e-9, 1.0]);
    let (tin, _) = triangulate(&of_points(points)).unwrap();
    assert_eq!(tin.triangles().len(), 99_999);
}

#[test]
fn integrals_match_the_function() {
    // The integral of x² + y² over the unit square is 2/3. A triangulation of its points is above
    // by at most h²/2.
    let mut input = of_points(Vec::new());
    let steps = 64;
    for row in 0..=steps {
        for column in 0..=steps {
            let [x, y] = [column, row].map(|at| f64::from(at) / f64::from(steps));
            input.points.push([x, y, x * x + y * y]);
        }
    }
    let (area, volume) = triangulate(&input).unwrap().0.integral();
    let most = 1.0 / f64::from(steps).powi(2) / 2.0;
    assert!((area - 1.0).abs() < 1e-12);
    assert!((0.0..most).contains(&(volume - 2.0 / 3.0)), "{volume}");
}

/// A north-up grid of heights from a function.
fn grid_of(columns: usize, rows: usize, height: &dyn Fn(f64, f64) -> f64) -> HeightGrid {
    let mut grid = HeightGrid::new([columns, rows], [2.0, 0.0, 1000.0, 0.0, -2.0, 5000.0]).unwrap();
    for row in 0..rows {
        for column in 0..columns {
            grid.heights[row * columns + column] = height(column as f64, row as f64);
        }
    }
    grid
}

#[test]
fn approximations_keep_the_maximum_error() {
    let waves = |x: f64, y: f64| 40.0 * (x / 9.0).sin() * (y / 14.0).cos() + x / 3.0;
    let lake = |x: f64, y: f64| {
        if (x - 30.0).hypot(y - 20.0) < 9.0 || x + y < 6.0 { f64::NAN } else { waves(x, y) }
    };
    let lone = |x: f64, y: f64| if (x, y) == (17.0, 11.0) { 5.0 } else { f64::NAN };
    let step = |x: f64, _: f64| if x < 20.0 { 0.0 } else { 100.0 };
    let functions: [&dyn Fn(f64, f64) -> f64; 4] = [&waves, &lake, &lone, &step];
    for height in functions {
        let mut before = usize::MAX;
        for most in [0.0, 0.01, 1.0, 5.0, 1000.0] {
            let grid = grid_of(61, 47, height);
            let tin = approximate(&grid, most, &()).unwrap();
            let mut back = HeightGrid::new([61, 47], grid.transform).unwrap();
            tin.fill(&mut back);
            for (found, expected) in back.heights.iter().zip(&grid.heights) {
                if expected.is_finite() {
                    assert!((found - expected).abs() <= most + 1e-12, "{found} {expected} {most}");
                }
            }
            assert!(tin.vertices().len() <= before);
            before = tin.vertices().len();
        }
    }
    // A plane needs only its corners.
    let plane = approximate(&grid_of(50, 40, &|x, y| 3.0 * x - y), 1e-9, &()).unwrap();
    assert_eq!(plane.triangles().len(), 2);
    // The middle of a lake has no triangles.
    let tin = approximate(&grid_of(61, 47, &lake), 0.5, &()).unwrap();
    assert_eq!(tin.height([1061.0, 4959.0]), None);
}

#[test]
fn grids_without_a_surface_are_rejected() {
    assert!(approximate(&grid_of(1, 9, &|x, _| x), 1.0, &()).is_err());
    assert!(approximate(&grid_of(9, 9, &|_, _| f64::NAN), 1.0, &()).is_err());
    for most in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(approximate(&grid_of(9, 9, &|x, _| x), most, &()).is_err());
    }
    for size in [[0, 4], [usize::MAX, 2], [1 << 20, 1 << 20]] {
        assert!(HeightGrid::new(size, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).is_err());
    }
    assert!(HeightGrid::new([4, 4], [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]).is_err());
}

#[test]
fn cells_have_the_heights_of_their_centres() {
    for seed in 0..20 {
        let points = scattered(80, 60, seed, &|x, y| (x * y).sin());
        let (tin, _) = triangulate(&of_points(points)).unwrap();
        // Rotated and sheared, too.
        let turned = [0.9, 0.31, -7.0, 0.4, -1.1, 40.0];
        for transform in [[1.0, 0.0, -3.0, 0.0, -1.0, 62.0], [1.0, 0.0, -2.5, 0.0, 1.0, -1.5], turned] {
            let mut grid = HeightGrid::new([66, 70], transform).unwrap();
            tin.fill(&mut grid);
            for row in 0..70 {
                for column in 0..66 {
                    let (found, expected) =
                        (grid.heights[row * 66 + column], tin.height(grid.centre(column, row)));
                    match expected {
                        None => assert!(found.is_nan()),
                        Some(expected) => assert!((found - expected).abs() < 1e-9),
                    }
                }
            }
        }
    }
}

#[test]
fn isolines_have_the_height_of_the_surface() {
    let cone = |x: f64, y: f64| 100.0 - (x - 50.0).hypot(y - 50.0);
    let (tin, _) = triangulate(&of_points(scattered(3000, 101, 11, &cone))).unwrap();
    let mut lines: Vec<Isoline> = Vec::new();
    let levels = [40.0, 60.0, 75.0, 90.0];
    tin.isolines(&levels, &mut |line| {
        lines.push(line);
        Ok(())
    })
    .unwrap();
    for line in &lines {
        for point in &line.points {
            // (A rounded point on a boundary edge may be outside of the surface.)
            let Some(height) = tin.height(*point) else { continue };
            assert!((height - line.level).abs() < 1e-9);
        }
        for ends in line.points.windows(2) {
            // Higher terrain is to the right.
            let [a, b] = [ends[0], ends[1]];
            let long = (b[0] - a[0]).hypot(b[1] - a[1]);
            if long > 0.2 {
                let right = [(b[1] - a[1]) / long, -(b[0] - a[0]) / long];
                let right_of_line = [0, 1].map(|axis| (a[axis] + b[axis]) / 2.0 + 1e-6 * right[axis]);
                assert!(tin.height(right_of_line).unwrap() >= line.level - 1e-9);
            }
        }
    }
    for level in [75.0, 90.0] {
        let of_level: Vec<&Isoline> = lines.iter().filter(|line| line.level == level).collect();
        assert_eq!(of_level.len(), 1, "{level}");
        assert!(of_level[0].is_closed());
        // Clockwise, with about the area of a circle.
        let radius = 100.0 - level;
        let found = -area(&of_level[0].points);
        assert!((found / (std::f64::consts::PI * radius * radius) - 1.0).abs() < 0.05, "{found}");
    }
    // Tracing each triangle separately yields the same total length.
    for level in levels {
        let mut sum = 0.0;
        let vertices: Vec<[f64; 3]> = tin.vertices().collect();
        for corners in tin.triangles() {
            let corners = corners.map(|corner| vertices[corner as usize]);
            let mut ends = Vec::new();
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (corners[a], corners[b])) {
                if (a[2] >= level) != (b[2] >= level) {
                    let share = (level - a[2]) / (b[2] - a[2]);
                    ends.push([0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis])));
                }
            }
            if let [a, b] = ends[..] {
                sum += (a[0] - b[0]).hypot(a[1] - b[1]);
            }
        }
        let of_level = lines.iter().filter(|line| line.level == level);
        let length: f64 = of_level
            .flat_map(|line| line.points.windows(2))
            .map(|ends| (ends[0][0] - ends[1][0]).hypot(ends[0][1] - ends[1][1]))
            .sum();
        assert!((length - sum).abs() < 1e-6 * sum, "{level}: {length} {sum}");
    }
    assert!(tin.isolines(&[1.0, 1.0], &mut |_| Ok(())).is_err());
    assert!(tin.isolines(&[f64::NAN], &mut |_| Ok(())).is_err());
}

#[test]
fn smoothing_keeps_lines_boundary_and_planes() {
    let plane = triangulate(&of_points(scattered(200, 50, 1, &|_, _| 7.0))).unwrap().0;
    assert!(plane.smoothed(&Smoothing::of_passes(9), &()).unwrap().0.vertices().all(|[_, _, z]| z == 7.0));
    let mut input =
        of_points(scattered(300, 64, 5, &|x, y| if ((x + y) as u64).is_multiple_of(2) { 0.0 } else { 10.0 }));
    input.breaklines = vec![vec![[5.0, 20.5, 100.0], [60.0, 20.5, 100.0]]];
    let (tin, _) = triangulate(&input).unwrap();
    let (smooth, moved) = tin.smoothed(&Smoothing::of_passes(5), &()).unwrap();
    assert!(moved > 0.0);
    let (before, after): (Vec<_>, Vec<_>) = (tin.vertices().collect(), smooth.vertices().collect());
    for edge in tin.constraints().iter().flatten() {
        assert_eq!(before[*edge as usize], after[*edge as usize]);
    }
    assert_eq!(tin.triangles(), smooth.triangles());
    let (least, most) = smooth.range().unwrap();
    assert!(least >= 0.0 && most <= 100.0);
    // (The sum of squared height differences between neighbours.)
    let roughness = |vertices: &[[f64; 3]]| -> f64 {
        let edges = tin.triangles().iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
        edges.map(|[a, b]| (vertices[a as usize][2] - vertices[b as usize][2]).powi(2)).sum()
    };
    assert!(roughness(&after) < roughness(&before));
}

#[test]
fn surfaces_of_triangles_must_be_over_the_plane() {
    let [a, b, c, d] = [[0.0, 0.0, 1.0], [4.0, 0.0, 2.0], [0.0, 4.0, 3.0], [4.0, 4.0, 0.0]];
    let tin = Tin::from_triangles(&[[a, c, b], [b, d, c], [a, a, b]]).unwrap();
    assert_eq!((tin.vertices().len(), tin.triangles().len()), (4, 2));
    assert_eq!(tin.height([2.0, 2.0]), Some(2.5));
    assert!(Tin::from_triangles(&[[a, c, b], [a, b, d]]).is_err());
    assert!(Tin::from_triangles(&[[a, c, b], [b, d, [0.0, 4.0, 5.0]]]).is_err());
    assert!(Tin::from_triangles(&[[a, c, [f64::NAN; 3]]]).is_err());
}

/// Builds layers and opens the model.
fn layers(input: &LayerInput) -> (crate::LayerReport, ExactModel, tempfile::TempDir) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("layers.goblin");
    let report = build_layers(input, &LayerOptions::new(), Output::create(&path).unwrap(), &()).unwrap();
    let model = ExactModel::open(&path, &Default::default()).unwrap();
    (report, model, directory)
}

/// A surface by its name and height function.
type Named<'a> = (&'a str, &'a dyn Fn(f64, f64) -> f64);

fn surfaces(of: &[Named<'_>], count: usize) -> Vec<LayerSurface> {
    let make = |(number, (name, height)): (u64, &Named<'_>)| {
        let mut points = scattered(count, 65, 20 + number, height);
        for corner in [[0.0, 0.0], [64.0, 0.0], [0.0, 64.0], [64.0, 64.0]] {
            points.push([corner[0], corner[1], height(corner[0], corner[1])]);
        }
        LayerSurface { name: (*name).into(), points }
    };
    (0..).zip(of).map(make).collect()
}

#[test]
fn layers_of_planes_have_their_volumes() {
    // Volumes between planes are known exactly.
    let of: [Named<'_>; 3] =
        [("top", &|x, _| 30.0 + x / 4.0), ("coal", &|_, y| 10.0 + y / 8.0), ("base", &|_, _| 0.0)];
    let input = LayerInput { surfaces: surfaces(&of, 40), ..LayerInput::default() };
    let (report, model, _directory) = layers(&input);
    let square = 64.0 * 64.0;
    let expected = [(30.0 + 8.0 - 10.0 - 4.0) * square, (10.0 + 4.0) * square];
    for (layer, expected) in report.layers.iter().zip(expected) {
        assert!((layer.volume - expected).abs() < 1e-3, "{layer:?} {expected}");
        assert!((layer.area - square).abs() < 1e-3);
    }
    assert_eq!(report.layers[0].name, "top to coal");
    assert_eq!(report.clipped, 0);
    let measured = MassProperties::of(&model, &()).unwrap().volume;
    assert!((measured - expected[0] - expected[1]).abs() < 1e-3, "{measured}");
}

#[test]
fn upper_surfaces_are_moved_up_to_lower_ones_where_they_cross() {
    // The upper plane is below the lower one where x < 32. What remains is a wedge over half of the
    // square.
    let of: [Named<'_>; 3] = [("top", &|x, _| x - 32.0), ("base", &|_, _| 0.0), ("deep", &|_, _| -5.0)];
    let input = LayerInput { surfaces: surfaces(&of, 60), ..LayerInput::default() };
    let (report, model, _directory) = layers(&input);
    let wedge = 32.0 * 32.0 / 2.0 * 64.0;
    assert!((report.layers[0].volume - wedge).abs() < 1e-2, "{report:?}");
    assert!((report.layers[0].area - 32.0 * 64.0).abs() < 1e-2);
    assert!((report.layers[1].volume - 5.0 * 64.0 * 64.0).abs() < 1e-2);
    assert!(report.clipped > 0);
    let measured = MassProperties::of(&model, &()).unwrap().volume;
    assert!((measured - wedge - 5.0 * 64.0 * 64.0).abs() < 1e-2, "{measured}");
}

#[test]
fn layers_with_outlines_and_waves_are_bodies() {
    let top = |x: f64, y: f64| 4.0 * (x / 7.0).sin() + 3.0 * (y / 9.0).cos();
    let middle = |x: f64, y: f64| 3.0 * (x / 11.0).cos() - (y / 5.0).sin();
    let of: [Named<'_>; 3] = [("top", &top), ("middle", &middle), ("base", &|x, y| (x - y) / 20.0)];
    for count in [20, 400] {
        let mut input = LayerInput { surfaces: surfaces(&of, count), ..LayerInput::default() };
        input.breaklines = vec![vec![[-5.0, 30.3], [33.3, 41.0], [70.0, 20.0]]];
        input.outlines = vec![vec![
            vec![[5.0, 5.0], [60.0, 3.0], [61.0, 60.0], [30.0, 35.0], [8.0, 55.0]],
            vec![[20.0, 12.0], [30.0, 12.0], [25.0, 20.0]],
        ]];
        let (report, model, _directory) = layers(&input);
        let sum: f64 = report.layers.iter().map(|layer| layer.volume).sum();
        let measured = MassProperties::of(&model, &()).unwrap().volume;
        assert!((measured - sum).abs() < 1e-6 * sum && report.clipped > 0, "{measured} {sum}");
    }
}

#[test]
fn invalid_layers_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("layers.goblin");
    let refused = |input: &LayerInput| {
        let output = Output::create(&path).unwrap();
        let error = build_layers(input, &LayerOptions::new(), output, &()).unwrap_err().to_string();
        assert!(!path.exists());
        error
    };
    let flat: Named<'_> = ("flat", &|_, _| 1.0);
    assert!(refused(&LayerInput::default()).contains("at least 2"));
    let input = LayerInput { surfaces: surfaces(&[flat, flat], 30), ..LayerInput::default() };
    assert!(refused(&input).contains("no layer with a thickness"));
    let mut input = LayerInput { surfaces: surfaces(&[flat, flat], 30), ..LayerInput::default() };
    input.surfaces[1].points.truncate(2);
    assert!(refused(&input).contains("surface flat"));
    input.surfaces[1].points = vec![[0.0, 0.0, f64::NAN]; 3];
    assert!(refused(&input).contains("finite"));
    let outlines = square(0.0);
    let input = LayerInput {
        surfaces: surfaces(&[flat, ("low", &|_, _| 0.0)], 30),
        outlines,
        ..LayerInput::default()
    };
    assert!(refused(&input).contains("outline"));
}
