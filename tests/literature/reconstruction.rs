//! Solids reconstructed from views: carving by silhouettes and depths from known directions, and
//! outlines at heights (S. P. Raya, J. K. Udupa, *Shape-based interpolation of multidimensional
//! objects*, 1990), against brute-force models of every cell.

use std::f64::consts::{PI, SQRT_2};
use std::fmt::Write as _;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use spinney::import::mesh::{Resolution, SolidOptions};
use spinney::raw::reconstruction::{ReconstructionImport, plan_outlines, plan_views};
use spinney::{Bounds, FileAccess, Output};

type Vector = [f64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|axis| {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        a[next] * b[last] - a[last] * b[next]
    })
}

fn unit(vector: Vector) -> Vector {
    let length = dot(vector, vector).sqrt();
    vector.map(|part| part / length)
}

/// The centre of the solids.
const MIDDLE: Vector = [0.25, -0.5, 1.0];
/// Half of the carved box's side.
const HALF: f64 = 1.5;

#[derive(Clone, Copy, PartialEq, Debug)]
enum Body {
    /// A ball of radius 1.
    Ball,
    /// A cube of side 2.
    Cube,
}

impl Body {
    /// Returns the distance along a ray from a point to where the ray enters the solid.
    fn entered(self, from: Vector, along: Vector) -> Option<f64> {
        let from = [0, 1, 2].map(|axis| from[axis] - MIDDLE[axis]);
        match self {
            Body::Ball => {
                let nearest = -dot(from, along);
                let left = 1.0 - (dot(from, from) - nearest * nearest);
                (left > 0.0).then(|| nearest - left.sqrt())
            }
            Body::Cube => {
                let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
                for (from, along) in from.into_iter().zip(along) {
                    if along == 0.0 {
                        if from.abs() >= 1.0 {
                            return None;
                        }
                        continue;
                    }
                    let ends = [-1.0, 1.0].map(|side| (side - from) / along);
                    enter = enter.max(ends[0].min(ends[1]));
                    leave = leave.min(ends[0].max(ends[1]));
                }
                (enter < leave).then_some(enter)
            }
        }
    }

    /// Returns the depth of a point inside the solid.
    fn deep(self, point: Vector) -> f64 {
        let point = [0, 1, 2].map(|axis| point[axis] - MIDDLE[axis]);
        match self {
            Body::Ball => 1.0 - dot(point, point).sqrt(),
            Body::Cube => 1.0 - point.iter().fold(0.0, |most: f64, at| most.max(at.abs())),
        }
    }
}

/// A view of a solid.
struct View {
    axes: [Vector; 3],
    pixels: u32,
    /// For each pixel the depth where the solid begins; `None` if it misses the solid.
    seen: Vec<Option<f64>>,
    is_depth: bool,
}

impl View {
    fn new(body: Body, direction: Vector, pixels: u32, is_depth: bool) -> View {
        let towards = unit(direction);
        let up = if direction[0] == 0.0 && direction[1] == 0.0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let right = unit(cross(up, towards));
        let axes = [right, cross(towards, right), towards];
        let mut view = View { axes, pixels, seen: Vec::new(), is_depth };
        for row in 0..pixels {
            for column in 0..pixels {
                let [across, down] =
                    [column, row].map(|at| (f64::from(at) + 0.5 - f64::from(pixels) / 2.0) * view.pixel());
                let point = [0, 1, 2].map(|axis| MIDDLE[axis] + across * right[axis] - down * axes[1][axis]);
                view.seen.push(body.entered(point, towards.map(|part| -part)));
            }
        }
        view
    }

    /// Returns the pixel width: the image shows a square of side 4.
    fn pixel(&self) -> f64 {
        4.0 / f64::from(self.pixels)
    }

    /// Returns a depth as a 16-bit sample.
    fn sample(depth: f64) -> u16 {
        ((depth + 3.0) * 1e4).round() as u16
    }

    /// Writes the image, and returns the view's JSON.
    fn write(&self, directory: &Path, number: usize) -> String {
        let name = format!("{number}.png");
        let file = BufWriter::new(File::create(directory.join(&name)).unwrap());
        let mut encoder = png::Encoder::new(file, self.pixels, self.pixels);
        encoder.set_color(png::ColorType::Grayscale);
        let bytes: Vec<u8> = if self.is_depth {
            encoder.set_depth(png::BitDepth::Sixteen);
            self.seen.iter().flat_map(|seen| seen.map_or(0, View::sample).to_be_bytes()).collect()
        } else {
            encoder.set_depth(png::BitDepth::Eight);
            self.seen.iter().map(|seen| if seen.is_some() { 200 } else { 0 }).collect()
        };
        encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
        let [_, up, towards] = self.axes;
        let kind = match self.is_depth {
            true => r#""depth", "scale": 1e-4, "offset": -3, "nodata": 0"#,
            false => r#""silhouette""#,
        };
        format!(
            r#"{{"image": "{name}", "kind": {kind}, "direction": {towards:?}, "up": {up:?}, "centre": {MIDDLE:?}, "pixel": {}}}"#,
            self.pixel()
        )
    }

    /// Returns whether a view keeps a point, by the documented definition.
    fn leaves(&self, point: Vector) -> bool {
        let from_middle = [0, 1, 2].map(|axis| point[axis] - MIDDLE[axis]);
        let [right, up, towards] = self.axes.map(|axis| dot(axis, from_middle));
        let [column, row] = [right, -up].map(|at| (at / self.pixel() + f64::from(self.pixels) / 2.0).floor());
        let side = f64::from(self.pixels);
        if !(0.0..side).contains(&column) || !(0.0..side).contains(&row) {
            return false;
        }
        match self.seen[row as usize * self.pixels as usize + column as usize] {
            None => false,
            Some(depth) => !self.is_depth || -towards >= f64::from(View::sample(depth)) * 1e-4 - 3.0,
        }
    }
}

/// Returns the six axis directions, or these and those in between.
fn directions(count: usize) -> Vec<Vector> {
    let sides = [-1.0, 0.0, 1.0];
    let all = sides.into_iter().flat_map(|x| sides.map(|y| sides.map(|z| [x, y, z]))).flatten();
    let wanted = |vector: &Vector| match vector.iter().filter(|part| **part != 0.0).count() {
        0 => false,
        1 => true,
        _ => count == 26,
    };
    let found: Vec<Vector> = all.filter(wanted).collect();
    assert_eq!(found.len(), count);
    found
}

fn options(cells: u64) -> SolidOptions {
    let mut options = SolidOptions::new();
    options.resolution = Resolution::Cells(cells);
    options
}

/// Returns which cells of a cube are full.
fn full(import: ReconstructionImport, path: &Path, cells: usize) -> Vec<bool> {
    import.build(Output::create(path).unwrap(), &()).unwrap();
    let tree = spinney::open(path).unwrap();
    let mut values = vec![0u8; cells.pow(3)];
    let all = Bounds { min: [0; 3], max: [cells as u64; 3] };
    tree.window(tree.depth(), &all, 0.0, &mut values, None).unwrap();
    values.into_iter().map(|value| value == 255).collect()
}

/// Returns the centre of a cell in a box, by its index.
fn centre(index: usize, cells: usize, low: Vector, cell: f64) -> Vector {
    let at = [index % cells, index / cells % cells, index / cells / cells];
    [0, 1, 2].map(|axis| low[axis] + (at[axis] as f64 + 0.5) * cell)
}

/// Carves a solid, compares it with a model that tests every cell in all views, and returns its
/// volume.
fn carved(body: Body, count: usize, is_depth: bool, (cells, pixels): (usize, u32)) -> f64 {
    let directory = tempfile::tempdir().unwrap();
    let views: Vec<View> =
        directions(count).into_iter().map(|direction| View::new(body, direction, pixels, is_depth)).collect();
    let view_list: Vec<String> =
        views.iter().enumerate().map(|(number, view)| view.write(directory.path(), number)).collect();
    // No cell centre is on a border between pixels, where rounding would decide.
    let corner = |side: f64| {
        let shift = [0.0012, 0.0007, -0.0009];
        [0, 1, 2].map(|axis| MIDDLE[axis] + side + shift[axis])
    };
    let [low, high] = [-HALF, HALF].map(corner);
    let text = directory.path().join("body.views");
    let [x, y, z] = low;
    let [to_x, to_y, to_z] = high;
    let bounds = [x, y, z, to_x, to_y, to_z];
    std::fs::write(&text, format!(r#"{{"bounds": {bounds:?}, "views": [{}]}}"#, view_list.join(",")))
        .unwrap();
    let import = plan_views(&text, &options(cells as u64), &FileAccess::default()).unwrap();
    let found = full(import, &directory.path().join("body.goblin"), cells);
    let cell = 2.0 * HALF / cells as f64;
    for (index, is_full) in found.iter().enumerate() {
        let point = centre(index, cells, low, cell);
        assert_eq!(
            *is_full,
            views.iter().all(|view| view.leaves(point)),
            "{body:?} {count} {is_depth} {point:?}"
        );
        // The result contains the true solid, except for points nearer to its surface than a pixel
        // width.
        let deep = body.deep(point);
        assert!(*is_full || deep < views[0].pixel(), "{body:?} {count} {is_depth} {point:?}: {deep}");
    }
    found.iter().filter(|is_full| **is_full).count() as f64 * cell.powi(3)
}

#[test]
fn a_ball_is_carved_from_6_and_26_directions() {
    let ball = 4.0 / 3.0 * PI;
    // Three cylinders (Steinmetz).
    let cylinders = 8.0 * (2.0 - SQRT_2);
    let sizes = [(24, 32), (48, 64), (96, 128)];
    let errors = sizes.map(|size| (carved(Body::Ball, 6, false, size) / cylinders - 1.0).abs());
    assert!(errors[2] < 0.006 && errors[1] < 0.02 && errors[2] < errors[1], "{errors:?}");
    let silhouettes = carved(Body::Ball, 26, false, sizes[1]);
    assert!((ball..1.03 * ball).contains(&silhouettes), "{}", silhouettes / ball);
    for count in [6, 26] {
        for size in [sizes[0], sizes[1]] {
            // The error is at most one pixel thick, over the whole surface.
            let most = 3.0 * 4.0 / f64::from(size.1);
            let error = carved(Body::Ball, count, true, size) / ball - 1.0;
            assert!(error.abs() < most / 2.0, "{count} {size:?}: {error}");
        }
    }
}

#[test]
fn a_cube_is_carved_from_6_and_26_directions() {
    for is_depth in [false, true] {
        // Sides of pixels and of cells coincide with those of the cube.
        assert_eq!(carved(Body::Cube, 6, is_depth, (48, 64)), 8.0);
        let found = carved(Body::Cube, 26, is_depth, (48, 64));
        assert!((7.7..=8.0).contains(&found), "{found}");
    }
}

#[test]
fn carving_does_not_depend_on_threads() {
    let directory = tempfile::tempdir().unwrap();
    let views: Vec<String> = (directions(26).into_iter().enumerate())
        .map(|(number, direction)| {
            View::new(Body::Ball, direction, 64, number % 2 == 0).write(directory.path(), number)
        })
        .collect();
    let text = directory.path().join("body.views");
    std::fs::write(&text, format!(r#"{{"bounds": [-1,-2,-1,2,1,2.5], "views": [{}]}}"#, views.join(",")))
        .unwrap();
    let path = directory.path().join("body.goblin");
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let import = plan_views(&text, &options(150), &FileAccess::default()).unwrap();
        pool.install(|| import.build(Output::create(&path).unwrap(), &())).unwrap();
        std::fs::read(&path).unwrap()
    };
    assert!(build(1) == build(5));
    // Images that exceed the memory limit are rejected before they are read.
    let mut little = options(150);
    little.memory = 100_000;
    let error = plan_views(&text, &little, &FileAccess::default()).err().unwrap().to_string();
    assert!(error.contains("body.views, view ") && error.contains("--memory"), "{error}");
}

/// Returns a ring of vertices as text.
fn ring(corners: &[[f64; 2]]) -> String {
    let closed = corners.iter().chain(&corners[..1]);
    format!("({})", closed.map(|[x, y]| format!("{x} {y}")).collect::<Vec<_>>().join(", "))
}

fn circle(radius: f64) -> Vec<[f64; 2]> {
    let corner = |number: u32| f64::from(number) / 256.0 * 2.0 * PI;
    (0..256).map(corner).map(|angle| [radius * angle.cos(), radius * angle.sin()]).collect()
}

fn square(low: f64, high: f64) -> Vec<[f64; 2]> {
    vec![[low, low], [high, low], [high, high], [low, high]]
}

/// Writes polygons, each with its height and rings.
fn outlines(directory: &Path, polygons: &[(f64, Vec<Vec<[f64; 2]>>)]) -> PathBuf {
    let mut text = String::from("wkt,height\n");
    for (height, rings) in polygons {
        let rings: Vec<String> = rings.iter().map(|corners| ring(corners)).collect();
        writeln!(text, "\"POLYGON ({})\",{height}", rings.join(", ")).unwrap();
    }
    let path = directory.join("outlines.csv");
    std::fs::write(&path, text).unwrap();
    path
}

/// Returns the volume of the solid of outlines.
fn solid(polygons: &[(f64, Vec<Vec<[f64; 2]>>)], resolution: Resolution) -> f64 {
    let directory = tempfile::tempdir().unwrap();
    let path = outlines(directory.path(), polygons);
    let mut options = SolidOptions::new();
    options.resolution = resolution;
    let import = plan_outlines(&path, "height", &Default::default(), &options).unwrap();
    let made = directory.path().join("solid.goblin");
    import.build(Output::create(&made).unwrap(), &()).unwrap();
    let tree = spinney::open(&made).unwrap();
    tree.solid(tree.depth(), &()).unwrap().world_volume()
}

#[test]
fn stacked_circles_are_a_cone_and_a_cylinder() {
    // The area of a polygon with 256 vertices relative to its circle.
    let share = 128.0 * (PI / 128.0).sin() / PI;
    let cone: Vec<_> = [0.0, 0.7, 1.5, 3.0].map(|z| (z, vec![circle(2.0 - z / 2.0)])).into();
    let frustum = share * PI * 3.0 / 3.0 * (4.0 + 2.0 * 0.5 + 0.25);
    let cylinder: Vec<_> = [-1.0, 2.0].map(|z| (z, vec![circle(1.0)])).into();
    for (polygons, exact) in [(cone, frustum), (cylinder, 3.0 * share * PI)] {
        let errors = [5, 6, 7].map(|depth| (solid(&polygons, Resolution::Depth(depth)) / exact - 1.0).abs());
        assert!(errors[2] < 0.002 && errors[2] <= errors[0].max(0.001), "{errors:?}");
    }
    // A cone to a point, approximated by a tiny circle.
    let cone = [(0.0, vec![circle(1.0)]), (2.0, vec![circle(1e-6)])];
    let exact = share * PI * 2.0 / 3.0;
    let found = solid(&cone, Resolution::Cells(128));
    assert!((found / exact - 1.0).abs() < 0.003, "{}", found / exact);
}

#[test]
fn squares_with_holes_and_polygons_that_lie_on_each_other() {
    let cell = Resolution::Cell(0.25);
    let tube = |z: f64| (z, vec![square(0.0, 4.0), square(1.0, 3.0)]);
    assert_eq!(solid(&[tube(0.0), tube(2.0)], cell.clone()), 2.0 * 12.0);
    // Two equal ones, one that overlaps, and one next to them.
    let several = [
        tube(0.0),
        tube(0.0),
        (0.0, vec![square(2.0, 6.0)]),
        (0.0, vec![square(8.0, 9.0)]),
        (1.0, vec![square(0.0, 4.0), square(1.0, 3.0)]),
        (1.0, vec![square(2.0, 6.0)]),
        (1.0, vec![square(8.0, 9.0)]),
    ];
    assert_eq!(solid(&several, cell), 12.0 + 16.0 - 3.0 + 1.0);
}

#[test]
fn outlines_are_interpolated_by_their_distances() {
    let star = |radius: f64, turn: f64| -> Vec<[f64; 2]> {
        let corner = |number: u32| {
            let radius = if number.is_multiple_of(2) { radius } else { 0.4 * radius };
            let angle = f64::from(number) / 5.0 * PI + turn;
            [radius * angle.cos() + 0.013, radius * angle.sin() - 0.007]
        };
        (0..10).map(corner).collect()
    };
    let polygons = [
        (-1.0, vec![star(2.0, 0.1)]),
        (-0.3, vec![star(1.5, 0.9), square(-0.3, 0.2)]),
        (0.01, vec![square(0.5, 1.5)]),
        (1.1, vec![star(1.9, 0.4)]),
    ];
    let directory = tempfile::tempdir().unwrap();
    let path = outlines(directory.path(), &polygons);
    let import = plan_outlines(&path, "height", &Default::default(), &options(90)).unwrap();
    let made = directory.path().join("solid.goblin");
    import.build(Output::create(&made).unwrap(), &()).unwrap();
    let tree = spinney::open(&made).unwrap();
    let extent = tree.header().extent;
    let mut values = vec![0u8; extent.iter().product::<u64>() as usize];
    tree.window(tree.depth(), &Bounds { min: [0; 3], max: extent }, 0.0, &mut values, None).unwrap();

    let signed = |rings: &[Vec<[f64; 2]>], [x, y]: [f64; 2]| {
        let (mut nearest, mut is_inside) = (f64::INFINITY, false);
        for corners in rings {
            for (number, [to_x, to_y]) in corners.iter().enumerate() {
                let [from_x, from_y] = corners[(number + corners.len() - 1) % corners.len()];
                let (along_x, along_y) = (to_x - from_x, to_y - from_y);
                let share =
                    ((x - from_x) * along_x + (y - from_y) * along_y) / along_x.hypot(along_y).powi(2);
                let share = share.clamp(0.0, 1.0);
                nearest = nearest.min((x - from_x - share * along_x).hypot(y - from_y - share * along_y));
                let crossing = from_x + (y - from_y) / along_y * along_x;
                is_inside ^= (from_y <= y) != (*to_y <= y) && x < crossing;
            }
        }
        if is_inside { nearest } else { -nearest }
    };
    let matrix = tree.metadata().frame.matrix;
    let (mut index, mut inside) = (0, 0);
    for z in 0..extent[2] {
        for y in 0..extent[1] {
            for x in 0..extent[0] {
                let at = [x, y, z].map(|at| at as f64 + 0.5);
                let [x, y, z] = [0, 1, 2].map(|axis| matrix[axis][axis] * at[axis] + matrix[axis][3]);
                let above = polygons.iter().position(|(height, _)| *height > z);
                let sum = above.map_or(-1.0, |above| {
                    let [(low, lower), (high, upper)] = [&polygons[above - 1], &polygons[above]];
                    signed(lower, [x, y]) * (high - z) + signed(upper, [x, y]) * (z - low)
                });
                assert_eq!(values[index] == 255, sum > 0.0, "{x} {y} {z}: {sum}");
                inside += u32::from(sum > 0.0);
                index += 1;
            }
        }
    }
    assert!(inside > 10_000);

    // On a grid rotated against world axes, cells keep their world positions.
    let mut turned = SolidOptions::new();
    let mut frame = tree.metadata().frame.clone();
    for row in &mut frame.matrix[..2] {
        (row[0], row[1]) = (0.8 * row[0] + 0.6 * row[1], 0.8 * row[1] - 0.6 * row[0]);
    }
    let corner = frame.matrix[0][0] * 64.0 + frame.matrix[0][1] * 64.0;
    frame.matrix[0][3] = -corner;
    frame.matrix[1][3] = -(frame.matrix[1][0] * 64.0 + frame.matrix[1][1] * 64.0);
    turned.resolution = Resolution::Like(frame, 7);
    let import = plan_outlines(&path, "height", &Default::default(), &turned).unwrap();
    let cells = import.build(Output::create(&made).unwrap(), &()).unwrap();
    assert!((cells as f64 / f64::from(inside) - 1.0).abs() < 0.02, "{cells} {inside}");
}

#[test]
fn invalid_outlines_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let plan = |polygons: &[(f64, Vec<Vec<[f64; 2]>>)], memory: u64| {
        let path = outlines(directory.path(), polygons);
        let mut options = SolidOptions::new();
        options.memory = memory;
        plan_outlines(&path, "height", &Default::default(), &options).err().unwrap().to_string()
    };
    let one = (1.0, vec![square(0.0, 1.0)]);
    let flat = (2.0, vec![vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]]);
    let message = plan(std::slice::from_ref(&one), 1 << 30);
    assert!(
        message.contains("outlines.csv: got outlines at 1 heights") && message.contains("two heights"),
        "{message}"
    );
    let message = plan(&[one.clone(), flat], 1 << 30);
    assert!(message.contains("an outline without an area, at height 2,"), "{message}");
    let message = plan(&[one, (2.0, vec![circle(1.0)])], 40_000);
    assert!(message.contains("--memory"), "{message}");
}
