//! Solids made of meshes, against brute force: winding numbers at every cell's centre.

mod common;

use std::path::PathBuf;

use common::Random;
use spinney::Result;
use spinney::import::mesh::{
    Attribute, Boundary, Decided, Face, Model, ModelInfo, Resolution, SolidOptions, SolidReport, plan_models,
};
use spinney::space::{Code, Frame, Oct};
use spinney::store::Output;
use spinney::store::goblin::{Goblin, OpenOptions};

type Point = [f64; 3];
type Triangle = [Point; 3];

/// A model from a list of triangles, each of a part.
struct Triangles {
    info: ModelInfo,
    faces: Vec<(Triangle, u32, [u8; 3])>,
}

impl Triangles {
    fn boxed(faces: Vec<(Triangle, u32, [u8; 3])>) -> Box<dyn Model> {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for point in faces.iter().flat_map(|(triangle, ..)| triangle) {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(point[axis]);
                bounds[1][axis] = bounds[1][axis].max(point[axis]);
            }
        }
        let parts = faces.iter().map(|(_, part, _)| part + 1).max().unwrap_or(1);
        let info = ModelInfo {
            path: PathBuf::from("test"),
            format: "triangles".into(),
            faces: Some(faces.len() as u64),
            bounds,
            epsg: None,
            unit: None,
            parts: (0..parts).map(|part| format!("part {part}")).collect(),
            is_coloured: true,
            bytes: 0,
        };
        Box::new(Triangles { info, faces })
    }
}

impl Model for Triangles {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.faces.iter().try_for_each(|(points, part, colour)| {
            each(&Face { points, ring_ends: &[3], colours: &[*colour], part: *part })
        })
    }
}

fn plain(triangles: &[Triangle]) -> Box<dyn Model> {
    Triangles::boxed(triangles.iter().map(|triangle| (*triangle, 0, [0; 3])).collect())
}

/// Builds a tree and opens it.
fn build<V: spinney::value::Value>(
    model: Box<dyn Model>,
    options: &SolidOptions,
) -> (Goblin<Oct, V>, SolidReport) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("solid.goblin");
    let report =
        plan_models(vec![model], options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
    let tree = Goblin::open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(tree.verify(64 << 20, &()).unwrap(), [], "what was built is a good file");
    (tree, report)
}

/// Cells of a space whose cells are the model's units.
fn unit_cells(depth: u8) -> SolidOptions {
    SolidOptions { resolution: Resolution::Like(Frame::identity(), depth), ..SolidOptions::default() }
}

fn cells<V: spinney::value::Value>(tree: &Goblin<Oct, V>) -> Vec<Option<V>> {
    let depth = tree.header().shape.depth;
    let side = 1u32 << depth;
    let all = (0..side * side * side).map(|i| [i % side, i / side % side, i / side / side]);
    all.map(|cell| tree.value_at(Code::from_cell(depth, cell).unwrap()).unwrap()).collect()
}

/// The box from one corner to the other, outward.
fn cuboid([x0, y0, z0]: Point, [x1, y1, z1]: Point) -> Vec<Triangle> {
    let p = |i: usize| [[x0, x1][i & 1], [y0, y1][i >> 1 & 1], [z0, z1][i >> 2]];
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.into_iter().flat_map(|[a, b, c, d]| [[p(a), p(b), p(c)], [p(a), p(c), p(d)]]).collect()
}

/// The winding number of a point by solid angles.
fn winding(triangles: &[Triangle], at: Point) -> f64 {
    let dot = |a: Point, b: Point| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = |a: Point, b: Point| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let angle = |triangle: &Triangle| {
        let [a, b, c] = triangle.map(|p| [p[0] - at[0], p[1] - at[1], p[2] - at[2]]);
        let [la, lb, lc] = [a, b, c].map(|p| dot(p, p).sqrt());
        let under = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        2.0 * dot(a, cross(b, c)).atan2(under)
    };
    triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Tetrahedra at random, some of them overlapping, some turned inside out as a whole.
fn tetrahedra(random: &mut Random, count: usize, side: f64, grid: f64) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    for _ in 0..count {
        let mut point =
            || -> Point { std::array::from_fn(|_| (random.below((side / grid) as u64 + 1) as f64) * grid) };
        let [a, b, c, d] = [point(), point(), point(), point()];
        triangles.extend([[a, c, b], [a, b, d], [b, c, d], [c, a, d]]);
    }
    triangles
}

#[test]
fn boxes_on_the_grid_become_their_cells() {
    for boundary in [Boundary::Full, Boundary::Centre, Boundary::Coverage] {
        let options = SolidOptions { boundary, ..unit_cells(7) };
        let (tree, report) =
            build::<[u8; 1]>(plain(&cuboid([8.0, 16.0, 64.0], [72.0, 80.0, 96.0])), &options);
        assert_eq!((report.inside, report.triangles, report.displacement), (Decided::Closed, 12, 0.0));
        let found = cells(&tree);
        for (i, cell) in found.iter().enumerate() {
            let [x, y, z] = [i % 128, i / 128 % 128, i / 128 / 128];
            let expected = (8..72).contains(&x) && (16..80).contains(&y) && (64..96).contains(&z);
            assert_eq!(*cell, expected.then_some([255]), "{x} {y} {z} {boundary:?}");
        }
    }
    // The whole space: nothing is cut, nothing is divided.
    let (tree, _) = build::<[u8; 1]>(plain(&cuboid([0.0; 3], [128.0; 3])), &unit_cells(7));
    assert_eq!(tree.header().extent, [128; 3]);
    assert_eq!(tree.metadata().counts.levels(), [[0, 1, 0]]);
}

#[test]
fn cells_are_inside_where_their_centre_has_a_winding_number() {
    let mut random = Random(11);
    for (depth, count, grid) in [(3, 3, 1.0), (4, 4, 0.5), (5, 9, 0.37), (7, 3, 0.013), (7, 12, 8.0)] {
        let side = f64::from(1u32 << depth);
        let triangles = tetrahedra(&mut random, count, side, grid);
        let (tree, report) = build::<[u8; 1]>(plain(&triangles), &unit_cells(depth));
        assert_eq!(report.inside, Decided::Closed);
        let side = 1usize << depth;
        let (mut full, mut checked) = (0, 0);
        for (i, cell) in cells(&tree).into_iter().enumerate() {
            if depth == 7 && random.below(50) != 0 {
                continue;
            }
            let [x, y, z] = [i % side, i / side % side, i / side / side];
            // On the surface itself the lattice counts as moved a little, x most.
            let at = [x as f64 + 0.5 + 1e-4, y as f64 + 0.5 + 1e-6, z as f64 + 0.5 + 1e-8];
            let expected = winding(&triangles, at);
            if (expected - expected.round()).abs() > 0.01 {
                continue;
            }
            checked += 1;
            full += usize::from(cell.is_some());
            assert_eq!(
                cell,
                (expected.round() != 0.0).then_some([255]),
                "{at:?} has {expected}, depth {depth}"
            );
        }
        assert!(full > 0 && checked > side, "{full} of {checked}");
    }
}

#[test]
fn nested_shells_are_cavities_and_bodies_may_overlap() {
    let mut inner = cuboid([20.3, 20.3, 20.3], [40.1, 40.2, 40.3]);
    inner.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    let triangles = [cuboid([4.1; 3], [60.2; 3]), inner, cuboid([50.5; 3], [63.9; 3])].concat();
    let (tree, _) = build::<[u8; 1]>(plain(&triangles), &unit_cells(6));
    let at = |cell: u32| tree.value_at(Code::from_cell(6, [cell; 3]).unwrap()).unwrap();
    assert_eq!(
        [2, 10, 30, 45, 55, 62].map(at),
        [None, Some([255]), None, Some([255]), Some([255]), Some([255])]
    );
}

#[test]
fn coverage_adds_up_to_the_volume() {
    let mut random = Random(5);
    for _ in 0..6 {
        let triangles = tetrahedra(&mut random, 1, 60.0, 0.731);
        let volume = |[a, b, c]: &Triangle| {
            (a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0]))
                / 6.0
        };
        let expected = triangles.iter().map(volume).sum::<f64>().abs();
        let options = SolidOptions { boundary: Boundary::Coverage, ..unit_cells(6) };
        let (tree, _) = build::<[u8; 1]>(plain(&triangles), &options);
        let found = cells(&tree).into_iter().flatten().map(|[value]| f64::from(value) / 255.0).sum::<f64>();
        assert!((found - expected).abs() < 0.003 * expected + 5.0, "{found}, expected {expected}");
    }
}

#[test]
fn full_boundaries_and_surfaces_hold_every_cell_that_is_cut() {
    // Of a box off the grid the cells that are cut are known.
    let (low, high) = ([3.25, 4.5, 5.0], [20.5, 9.75, 11.0]);
    let triangles = cuboid(low, high);
    let options = SolidOptions { boundary: Boundary::Full, ..unit_cells(5) };
    let (full, _) = build::<[u8; 1]>(plain(&triangles), &options);
    let (shell, report) =
        build::<[u8; 1]>(plain(&triangles), &SolidOptions { surface: true, ..unit_cells(5) });
    assert_eq!(report.inside, Decided::Surface);
    for (i, (full, shell)) in cells(&full).into_iter().zip(cells(&shell)).enumerate() {
        let cell = [i % 32, i / 32 % 32, i / 32 / 32].map(|x| x as f64);
        let overlaps = (0..3).all(|axis| low[axis] < cell[axis] + 1.0 && cell[axis] < high[axis]);
        let inside = (0..3).all(|axis| low[axis] <= cell[axis] && cell[axis] + 1.0 <= high[axis]);
        assert_eq!(full.is_some(), overlaps, "{cell:?}");
        assert_eq!(shell.is_some(), overlaps && !inside, "{cell:?}");
    }
}

#[test]
fn parts_and_colours_are_kept() {
    let coloured = |triangles: Vec<Triangle>, part: u32, colour: [u8; 3]| {
        triangles.into_iter().map(move |triangle| (triangle, part, colour))
    };
    let faces: Vec<_> = coloured(cuboid([2.0; 3], [10.0; 3]), 0, [200, 10, 10])
        .chain(coloured(cuboid([10.0, 2.0, 2.0], [30.0, 10.0, 10.0]), 1, [10, 200, 10]))
        .collect();
    let options = SolidOptions { attribute: Attribute::Part, ..unit_cells(5) };
    let (tree, _) = build::<[u8; 1]>(Triangles::boxed(faces.clone()), &options);
    assert_eq!(tree.metadata().class_names[&2], "part 1");
    let options = SolidOptions { attribute: Attribute::Colour, ..unit_cells(5) };
    let (colours, _) = build::<[u8; 3]>(Triangles::boxed(faces), &options);
    for (i, (part, colour)) in cells(&tree).into_iter().zip(cells(&colours)).enumerate() {
        let [x, y, z] = [i % 32, i / 32 % 32, i / 32 / 32];
        let inside = (2..10).contains(&y) && (2..10).contains(&z);
        let expected = match x {
            2..10 if inside => Some(([1], [200, 10, 10])),
            10..30 if inside => Some(([2], [10, 200, 10])),
            _ => None,
        };
        assert_eq!(part.zip(colour), expected, "{x} {y} {z}");
    }
}

#[test]
fn flipped_faces_are_parity_and_holes_a_field() {
    let mut triangles = cuboid([4.0, 5.0, 6.0], [52.0, 53.0, 54.0]);
    let inside = |tree: &Goblin<Oct, [u8; 1]>, cell: [u32; 3]| {
        tree.value_at(Code::from_cell(6, cell).unwrap()).unwrap().is_some()
    };
    triangles[3].swap(0, 1);
    let (tree, report) = build(plain(&triangles), &unit_cells(6));
    assert_eq!(report.inside, Decided::Flipped);
    assert_eq!(cells::<[u8; 1]>(&tree).iter().flatten().count(), 48 * 48 * 48);
    triangles[3].swap(0, 1);
    triangles.remove(5);
    let (tree, report) = build(plain(&triangles), &unit_cells(6));
    assert_eq!(report.inside, Decided::Open);
    assert!(report.undecided > 0);
    assert!(inside(&tree, [28, 40, 30]) && inside(&tree, [5, 6, 7]) && !inside(&tree, [60, 60, 60]));
    assert!(tree.metadata().tags["solid.surface"].starts_with("open"));
}

#[test]
fn memory_and_threads_do_not_change_the_bytes() {
    let mut random = Random(99);
    let triangles = tetrahedra(&mut random, 400, 500.0, 0.37);
    let folder = tempfile::tempdir().unwrap();
    let mut first: Option<Vec<u8>> = None;
    for (memory, threads) in [(256 << 20, 1), (256 << 20, 3), (40_000, 2), (20_000, 1)] {
        let path = folder.path().join("solid.goblin");
        let options = SolidOptions { memory, ..unit_cells(9) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let import = plan_models(vec![plain(&triangles)], &options).unwrap();
        pool.install(|| import.build(Output::create(&path).unwrap(), &())).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(first.get_or_insert_with(|| bytes.clone()) == &bytes, "memory {memory}, {threads} threads");
    }
}
