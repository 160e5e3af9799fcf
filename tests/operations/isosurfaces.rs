//! Isosurfaces, against marching-squares lines on the faces of all cubes between adjacent cells.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::sync::atomic::{AtomicU64, Ordering};

use spinney::export::MeshFormat;
use spinney::query::{ContourLevels, ContourRequest};
use spinney::raw::export::mesh::{SurfaceMesh, export_isosurfaces, isosurface_mesh};
use spinney::raw::query::ContourEnds;
use spinney::{DataKind, Dataset, Error, Frame, Output, Progress, Rule, SampleType};

use crate::common::mesh_file::{cross, dot, minus, read_ply, read_stl};
use crate::common::{Cells, QUAD, Random, byte, made, oct, opened, options, with, write_cells, write_goblin};

type Cell = [i64; 3];

/// Numbers of a volume. Outside and VOID cells have none, or the minimum if the surface is closed.
struct Volume {
    size: [i64; 3],
    numbers: Vec<Option<f64>>,
    closes: bool,
}

impl Volume {
    /// Reads a level of a tree.
    fn of(tree: &Dataset, level: u8, closes: bool) -> Volume {
        let bounds = tree.extent_at(level);
        let cells = bounds.volume() as usize;
        let (mut bytes, mut valid) = (vec![0; cells * 4], vec![false; cells]);
        tree.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
        let number = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().unwrap()));
        let numbers = bytes.chunks(4).zip(valid).map(|(bytes, valid)| valid.then(|| number(bytes))).collect();
        Volume { size: bounds.max.map(|side| side as i64), numbers, closes }
    }

    fn at(&self, [x, y, z]: Cell) -> Option<f64> {
        let is_inside = (0..3).all(|axis| (0..self.size[axis]).contains(&[x, y, z][axis]));
        let index = (z * self.size[1] + y) * self.size[0] + x;
        let number = if is_inside { self.numbers[index as usize] } else { None };
        number.or_else(|| self.closes.then_some(f64::NEG_INFINITY))
    }

    /// Returns whether a cube, given by its first cell, can contain a surface.
    fn has_cube(&self, first: Cell) -> bool {
        let is_near = (0..3).all(|axis| (-1..self.size[axis]).contains(&first[axis]));
        is_near
            && (0..8)
                .all(|corner| self.at([0, 1, 2].map(|axis| first[axis] + (corner >> axis & 1))).is_some())
    }

    /// Returns where the surface crosses the edge from a cell to the next along an axis.
    fn crossing(&self, axis: usize, cell: Cell, level: f64) -> Option<f64> {
        let mut next = cell;
        next[axis] += 1;
        let (a, b) = (self.at(cell)?, self.at(next)?);
        let share = if a.is_finite() && b.is_finite() { (level - a) / (b - a) } else { 0.5 };
        ((a >= level) != (b >= level)).then_some(share.clamp(1e-6, 1.0 - 1e-6))
    }

    /// Returns the lines on cube faces: pairs of edges, and the number of cubes that share the
    /// face.
    fn lines(&self, level: f64) -> HashMap<[Edge; 2], usize> {
        let mut lines = HashMap::new();
        for axis in 0..3 {
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            for cell in self.all_cells() {
                let mut before = cell;
                before[axis] -= 1;
                let cubes = usize::from(self.has_cube(cell)) + usize::from(self.has_cube(before));
                if cubes == 0 {
                    continue;
                }
                let step = |along_b: i64, along_c: i64| {
                    let mut corner = cell;
                    corner[b] += along_b;
                    corner[c] += along_c;
                    corner
                };
                // Around the face; edge i joins corner i to the next one.
                let corners = [step(0, 0), step(1, 0), step(1, 1), step(0, 1)];
                let edges = [(b, corners[0]), (c, corners[1]), (b, corners[3]), (c, corners[0])];
                let numbers = corners.map(|corner| self.at(corner).unwrap());
                let crossed: Vec<Edge> = edges
                    .into_iter()
                    .filter(|(axis, cell)| self.crossing(*axis, *cell, level).is_some())
                    .collect();
                let mut add = |a: Edge, b: Edge| lines.insert([a.min(b), a.max(b)], cubes);
                if let [a, b] = crossed[..] {
                    add(a, b);
                } else if crossed.len() == 4 {
                    let mean = numbers.map(|number| number / 4.0).iter().sum::<f64>();
                    // The corners on the other side than the mean are cut off.
                    let first = usize::from((numbers[0] >= level) == (mean >= level));
                    add(edges[first], edges[(first + 3) % 4]);
                    add(edges[first + 1], edges[first + 2]);
                }
            }
        }
        lines
    }

    fn all_cells(&self) -> impl Iterator<Item = Cell> {
        let [width, height, depth] = self.size;
        (-1..=depth).flat_map(move |z| (-1..=height).flat_map(move |y| (-1..=width).map(move |x| [x, y, z])))
    }
}

/// An edge from a cell to the next along an axis.
type Edge = (usize, Cell);

/// Returns the edge that contains a point, and the position on it; `None` for a point inside a
/// cube.
fn edge_of(point: [f64; 3]) -> Option<(Edge, f64)> {
    let centred = point.map(|at| at - 0.5);
    let whole: Vec<usize> =
        (0..3).filter(|axis| (centred[*axis] - centred[*axis].round()).abs() < 1e-8).collect();
    let axis = (0..3).find(|axis| !whole.contains(axis))?;
    let share = centred[axis] - centred[axis].floor();
    let cell = [0, 1, 2].map(|i| if i == axis { centred[i].floor() } else { centred[i].round() } as i64);
    (whole.len() == 2).then_some(((axis, cell), share))
}

/// Checks a surface in cell coordinates against a volume.
fn check(mesh: &SurfaceMesh, volume: &Volume, level: f64, what: &str) {
    let crossings: Vec<Option<(Edge, f64)>> = mesh.vertices.iter().map(|point| edge_of(*point)).collect();
    // Vertices are all crossings, each once, and points inside cubes.
    let mut edges = HashSet::new();
    for ((axis, cell), share) in crossings.iter().flatten() {
        assert!(edges.insert((*axis, *cell)), "{what}: {axis} {cell:?} twice");
        let expected =
            volume.crossing(*axis, *cell, level).unwrap_or_else(|| panic!("{what}: {axis} {cell:?}"));
        assert!((share - expected).abs() < 1e-8, "{what}: {share}, not {expected}");
    }
    // Edges are used once in each direction, except at the surface's border.
    let mut passed: HashMap<[u32; 2], u32> = HashMap::new();
    for [a, b, c] in &mesh.triangles {
        assert!(a != b && b != c && c != a, "{what}");
        for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert_eq!(
                passed.insert([*from, *to], *third),
                None,
                "{what}: an edge of more than two triangles"
            );
        }
    }
    let mut lines = volume.lines(level);
    let crossed: HashSet<Edge> = lines.keys().flatten().copied().collect();
    assert!(crossed == edges, "{what}: {} crossings, not {}", edges.len(), crossed.len());
    for ([from, to], third) in &passed {
        let is_open = !passed.contains_key(&[*to, *from]);
        let ends = [from, to].map(|end| crossings[*end as usize].map(|(edge, _)| edge));
        let [Some(a), Some(b)] = ends else {
            assert!(!is_open, "{what}");
            continue;
        };
        let Some(cubes) = lines.get(&[a.min(b), a.max(b)]) else {
            assert!(!is_open, "{what}: open inside of a cube");
            continue;
        };
        assert_eq!(*cubes == 1, is_open, "{what}: {a:?} {b:?}");
        // Seen from outside the triangle's cube, higher values are on the right.
        let [from, to, third] = [from, to, third].map(|vertex| mesh.vertices[*vertex as usize]);
        let axis = (0..3).find(|axis| from[*axis] == to[*axis] && a.0 != *axis && b.0 != *axis).unwrap();
        let mut outside = [0.0; 3];
        outside[axis] = from[axis] - third[axis];
        assert!(outside[axis].abs() > 1e-9, "{what}: a triangle on a face");
        let mut high = from;
        let first = volume.at(a.1).unwrap();
        high[a.0] = a.1[a.0] as f64 + if first >= level { 0.5 } else { 1.5 };
        assert!(dot(cross(minus(to, from), outside), minus(high, from)) > 0.0, "{what}: turned round");
    }
    let numbers: HashMap<Edge, u32> =
        (0..).zip(&crossings).filter_map(|(number, item)| item.map(|(edge, _)| (edge, number))).collect();
    lines.retain(|[a, b], _| {
        let (a, b) = (numbers[a], numbers[b]);
        !passed.contains_key(&[a, b]) && !passed.contains_key(&[b, a])
    });
    assert!(lines.is_empty(), "{what}: without {lines:?}");
}

/// Returns few or many distinct numbers, some VOID.
fn cells(seed: u64, size: [u64; 3]) -> Cells {
    let mut random = Random(seed);
    let form = oct(SampleType::F32, 1);
    let (holes, is_whole, side) = (random.below(3), random.below(2) == 0, 1 + random.below(5));
    let mut cells = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let patch = Random(seed ^ (x / side) ^ (y / side) << 20 ^ (z / side) << 40).next() % 6;
                let number = if random.below(4) == 0 { random.below(6) } else { patch };
                let part = if is_whole { 0.0 } else { random.below(1000) as f64 / 999.5 };
                let is_void = holes > 0 && random.below(if holes == 1 { 100 } else { 9 }) == 0;
                cells.push((!is_void).then(|| form.value.nearest(|_| number as f64 + part)));
            }
        }
    }
    Cells { form, size, cells }
}

fn tree_of(cells: &Cells) -> Dataset {
    opened(|path| write_goblin(path, cells, (Rule::Mean, DataKind::Continuous), Frame::identity()))
}

fn at(levels: &[f64]) -> ContourRequest {
    ContourRequest::new(ContourLevels::At(levels.to_vec()))
}

/// Returns the surface of a level of detail, in cells of that level.
fn surface(tree: &Dataset, request: &ContourRequest) -> SurfaceMesh {
    let mut mesh = isosurface_mesh(tree, request, &()).unwrap();
    let level = request.level.unwrap_or(tree.depth());
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    mesh.vertices.iter_mut().for_each(|point| *point = frame.to_cells(*point).unwrap());
    mesh
}

fn volume_of(mesh: &SurfaceMesh) -> f64 {
    let corners = |triangle: &[u32; 3]| triangle.map(|corner| mesh.vertices[corner as usize]);
    mesh.triangles.iter().map(corners).map(|[a, b, c]| dot(a, cross(b, c))).sum::<f64>() / 6.0
}

fn area_of(mesh: &SurfaceMesh) -> f64 {
    let corners = |triangle: &[u32; 3]| triangle.map(|corner| mesh.vertices[corner as usize]);
    let area = |[a, b, c]: [[f64; 3]; 3]| {
        let normal = cross(minus(b, a), minus(c, a));
        dot(normal, normal).sqrt() / 2.0
    };
    mesh.triangles.iter().map(corners).map(area).sum()
}

#[test]
fn surfaces_are_those_of_marching_cubes() {
    let mut count = 0;
    for seed in 0..40 {
        let mut random = Random(seed ^ 99);
        let mut size = std::array::from_fn(|_| 1 + random.below(9));
        // Some span several tiles.
        if seed % 4 == 0 {
            size[random.below(3) as usize] = 60 + random.below(80);
        }
        size = match seed {
            4 => [64, 3, 5],
            8 => [8, 8, 8],
            12 => [65, 66, 3],
            _ => size,
        };
        let tree = tree_of(&cells(seed, size));
        for level in tree.depth().saturating_sub(2)..=tree.depth() {
            for nodata in [ContourEnds::Open, ContourEnds::Close] {
                let volume = Volume::of(&tree, level, nodata == ContourEnds::Close);
                for value in [0.0, 1.0, 2.5, 4.0, 7.0] {
                    let request = with(at(&[value]), |request| {
                        (request.level, request.ends) = (Some(level), nodata);
                    });
                    let mesh = surface(&tree, &request);
                    check(&mesh, &volume, value, &format!("{seed} {size:?} {level} {nodata:?} {value}"));
                    count += mesh.triangles.len();
                }
            }
        }
    }
    assert!(count > 100_000, "{count}");
}

/// Returns a ball in a volume of `side` cells per side: its radius minus the distance from a point
/// near the centre.
fn ball(side: u64, radius: f64) -> Cells {
    ball_around(side as f64 / 2.0, [side; 3], radius)
}

/// Returns a ball around a point near the one with equal coordinates `middle`.
fn ball_around(middle: f64, size: [u64; 3], radius: f64) -> Cells {
    let form = oct(SampleType::F32, 1);
    let middle = middle + 0.3;
    made(form, size, |cell| {
        let away = cell.map(|at| at as f64 + 0.5 - middle);
        Some(form.value.nearest(|_| radius - dot(away, away).sqrt()))
    })
}

#[test]
fn a_ball_has_its_volume_and_area() {
    let mirrored = Frame {
        matrix: [[0.0, -0.5, 0.0, 100.0], [-0.5, 0.0, 0.0, 7.0], [0.0, 0.0, -0.5, 3.0]],
        ..Frame::identity()
    };
    assert!(mirrored.linear().determinant() > 0.0);
    let upside_down = Frame {
        matrix: [[0.5, 0.0, 0.0, 9.0], [0.0, -0.5, 0.0, 7.0], [0.0, 0.0, 0.5, 3.0]],
        ..Frame::identity()
    };
    let cells = ball(76, 30.0);
    for frame in [mirrored, upside_down] {
        let tree =
            opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), frame.clone()));
        for level in tree.depth() - 2..=tree.depth() {
            for value in [0.0, 12.0, -5.0] {
                let request = with(at(&[value]), |request| request.level = Some(level));
                let mesh = isosurface_mesh(&tree, &request, &()).unwrap();
                let radius = (30.0 - value) / 2.0;
                // The chord error is quadratic in the cell size.
                let slack = (f64::from(1u32 << (tree.depth() - level)) / (30.0 - value)).powi(2);
                let (volume, area) = (
                    std::f64::consts::PI * radius.powi(3) * 4.0 / 3.0,
                    std::f64::consts::PI * radius * radius * 4.0,
                );
                let (found, around) = (volume_of(&mesh), area_of(&mesh));
                assert!((found / volume - 1.0).abs() < slack, "{level} {value}: {found}, not {volume}");
                assert!((around / area - 1.0).abs() < slack, "{level} {value}: {around}, not {area}");
                // The Euler characteristic of a ball's surface.
                let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
                assert_eq!(vertices, 2 + triangles / 2);
            }
        }
    }
}

#[test]
fn tiles_without_a_surface_are_not_read() {
    // Tiles have 64 cells per side: eight of twelve meet here.
    let tree = tree_of(&ball_around(64.0, [192, 128, 128], 20.0));
    let found = |request: &ContourRequest| {
        let directory = tempfile::tempdir().unwrap();
        let output = Output::create(&directory.path().join("a.ply")).unwrap();
        export_isosurfaces(&tree, request, output, MeshFormat::Ply, &()).unwrap()
    };
    let summary = found(&at(&[0.0]));
    assert_eq!((summary.surfaces, summary.tiles, summary.tiles_read), (1, 12, 8));
    assert!(summary.triangles > 5000 && summary.vertices == 2 + summary.triangles / 2);
    // Values that are never reached.
    for level in [30.0, -1000.0] {
        let summary = found(&at(&[level]));
        assert_eq!((summary.triangles, summary.vertices, summary.tiles_read), (0, 0, 0));
    }
    // Around all cells with a value.
    let closed = with(at(&[-1000.0]), |request| request.ends = ContourEnds::Close);
    assert_eq!(found(&closed).tiles_read, 0);
    let mesh = surface(&tree, &closed);
    // Edges are bevelled.
    let expected = 192.0 * 128.0 * 128.0 - 4.0 * (191.0 + 127.0 + 127.0) / 8.0;
    assert!((volume_of(&mesh) - expected).abs() < 20.0, "{}, not {expected}", volume_of(&mesh));
    // All multiples that are reached; the minimum is far below the ball's values.
    let every = ContourRequest::new(ContourLevels::Every { step: 5.0, base: 0.5 });
    let least = tree.value_bounds().unwrap()[0].0;
    let summary = found(&every);
    assert_eq!(
        summary.surfaces,
        ((20.0 - 0.5) / 5.0_f64).floor() as u64 + ((0.5 - least) / 5.0).floor() as u64 + 1
    );
}

#[test]
fn uniform_cells_are_as_many_small_ones() {
    // An octant is one leaf, and its neighbours are noise.
    let form = oct(SampleType::F32, 1);
    let cells = made(form, [32; 3], |cell| {
        let number = if cell.iter().all(|at| *at < 16) {
            3
        } else {
            Random(cell[0] << 40 | cell[1] << 20 | cell[2]).next() % 6
        };
        Some(form.value.nearest(|_| number as f64))
    });
    let tree = tree_of(&cells);
    for level in 0..=tree.depth() {
        let request = with(at(&[2.5]), |request| request.level = Some(level));
        check(&surface(&tree, &request), &Volume::of(&tree, level, false), 2.5, &format!("{level}"));
    }
}

#[test]
fn formats_and_views_and_threads_give_the_same_bytes() {
    // Four tiles.
    let cells = cells(12, [70, 12, 66]);
    let tree = tree_of(&cells);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    write_cells(&path, &cells, &options(Rule::Mean, DataKind::Continuous, cells.depth()));
    let out = directory.path().join("out");
    let request = with(at(&[2.5, 1.0, 4.0]), |request| request.ends = ContourEnds::Close);
    let bytes = |tree: &Dataset, format: MeshFormat, threads: usize, memory: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let request = with(request.clone(), |request| request.memory = memory);
        pool.install(|| {
            export_isosurfaces(tree, &request, Output::create(&out).unwrap(), format, &()).unwrap();
        });
        fs::read(&out).unwrap()
    };
    for format in [MeshFormat::Ply, MeshFormat::Obj] {
        let one = bytes(&tree, format, 1, 64 << 20);
        assert!(bytes(&tree, format, 3, 1 << 30) == one);
        assert!(bytes(&tree, format, 2, 1) == one);
        assert!(bytes(&spinney::open(&path).unwrap(), format, 2, 64 << 20) == one);
    }
    let one = bytes(&tree, MeshFormat::Obj, 1, 64 << 20);
    let view = tree.view(&["translate=0,0,0".parse().unwrap()]).unwrap();
    assert!(bytes(&view, MeshFormat::Obj, 2, 64 << 20) == one);
    let text = String::from_utf8(one).unwrap();
    let parts: Vec<&str> = text.lines().filter(|line| line.starts_with("o ")).collect();
    assert_eq!(parts, ["o level_1", "o level_2.5", "o level_4"]);
    // Empty surfaces are not written as objects.
    let request = at(&[2.5, 1000.0]);
    export_isosurfaces(
        &spinney::open(&path).unwrap(),
        &request,
        Output::create(&out).unwrap(),
        MeshFormat::Obj,
        &(),
    )
    .unwrap();
    let text = fs::read_to_string(&out).unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("o ")).collect::<Vec<_>>(), ["o level_2.5"]);
}

#[test]
fn single_precision_keeps_points_apart() {
    // Levels equal to cell values: around such a cell there are points next to its centre.
    let cells = cells(5, [20, 18, 16]);
    let mut frame = Frame::identity();
    (frame.matrix[0][3], frame.matrix[1][3]) = (130_000.3, -70_000.9);
    let tree = opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), frame));
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("out");
    for level in [2.0, 3.0] {
        let request = with(at(&[level]), |request| request.ends = ContourEnds::Close);
        for format in [MeshFormat::Stl, MeshFormat::Ply] {
            export_isosurfaces(&tree, &request, Output::create(&out).unwrap(), format, &()).unwrap();
            let bytes = fs::read(&out).unwrap();
            let read = if format == MeshFormat::Stl { read_stl(&bytes) } else { read_ply(&bytes) };
            assert!(read.faces.len() > 1000);
            read.check_manifold(&format!("{format:?}, level {level}"));
        }
    }
}

#[test]
fn solids_have_surfaces_of_their_occupancy() {
    // VOID counts as zero.
    let form = oct(SampleType::U8, 1);
    let cells = made(form, [20; 3], |cell| {
        let away = cell.map(|at| at as f64 - 9.5);
        let share = (8.0 - dot(away, away).sqrt() + 0.5).clamp(0.0, 1.0);
        (share > 0.0).then(|| byte((share * 255.0) as u8))
    });
    let tree =
        opened(|path| write_goblin(path, &cells, (Rule::Occupancy, DataKind::Continuous), Frame::identity()));
    let mesh = surface(&tree, &at(&[127.5]));
    let expected = std::f64::consts::PI * 512.0 * 4.0 / 3.0;
    assert!((volume_of(&mesh) / expected - 1.0).abs() < 0.01, "{}, not {expected}", volume_of(&mesh));
    // Also if they fill the whole extent, even one that ends at a tile border.
    for side in [5, 32, 64, 70] {
        let cells = made(form, [side; 3], |_| Some(byte(255)));
        let tree = opened(|path| {
            write_goblin(path, &cells, (Rule::Occupancy, DataKind::Continuous), Frame::identity())
        });
        for nodata in [ContourEnds::Open, ContourEnds::Close] {
            let mesh = surface(&tree, &with(at(&[127.5]), |request| request.ends = nodata));
            assert_eq!(mesh.vertices.len(), 2 + mesh.triangles.len() / 2);
            let expected = (side as f64).powi(3) - 12.0 * (side as f64 - 1.0) / 8.0;
            assert!((volume_of(&mesh) - expected).abs() < 2.0, "{side}: {}", volume_of(&mesh));
        }
    }
}

#[test]
fn numbers_that_are_none_end_a_surface() {
    let form = oct(SampleType::F64, 1);
    let numbers = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for (hole, number) in numbers.into_iter().enumerate() {
        let cells = made(form, [6; 3], |[x, y, z]| {
            let is_hole = [x, y, z] == [2, 3, 3];
            Some(form.value.nearest(|_| if is_hole { number } else { x as f64 }))
        });
        let tree = tree_of(&cells);
        let mesh = surface(&tree, &at(&[2.25]));
        // 5 x 5 squares at x = 2.75, without the four around the hole.
        assert_eq!((mesh.triangles.len(), area_of(&mesh)), (2 * 21, 21.0), "{hole}");
        let closed = with(at(&[2.25]), |request| request.ends = ContourEnds::Close);
        let mesh = surface(&tree, &closed);
        assert_eq!(mesh.vertices.len(), 2 + mesh.triangles.len() / 2, "{hole}");
    }
    // The minimum and maximum numbers.
    let ends = [f64::MIN, f64::MAX, 5e-324, 0.0].map(|number| form.value.splat(number));
    let cells = Cells { form, size: [2; 3], cells: [ends, [ends[0]; 4]].concat() };
    let tree = tree_of(&cells);
    for level in [0.0, 5e-324, f64::MAX, f64::MIN, -0.0] {
        let mesh = surface(&tree, &at(&[level]));
        assert!(mesh.vertices.iter().flatten().all(|at| (0.5..=1.5).contains(at)), "{level}");
    }
}

/// Cancels after a few checks.
struct Impatient(AtomicU64);

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) > 6
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let tree = tree_of(&ball(70, 20.0));
    let trace = |request: &ContourRequest| isosurface_mesh(&tree, request, &());
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(matches!(trace(&at(&[1.0, number])), Err(Error::Invalid { .. })));
    }
    assert!(matches!(trace(&at(&[])), Err(Error::Invalid { .. })));
    let every = |step: f64, base: f64| trace(&ContourRequest::new(ContourLevels::Every { step, base }));
    for (step, base) in
        [(0.0, 0.0), (-1.0, 0.0), (f64::NAN, 0.0), (1.0, f64::INFINITY), (1e-9, 0.0), (1e-300, 0.0)]
    {
        assert!(matches!(every(step, base), Err(Error::Invalid { .. })), "{step} {base}");
    }
    let extend = with(at(&[1.0]), |request| request.ends = ContourEnds::Extend);
    assert!(matches!(trace(&extend), Err(Error::Invalid { .. })));
    assert!(trace(&with(at(&[1.0]), |request| request.level = Some(tree.depth() + 1))).is_err());
    let stopped = isosurface_mesh(&tree, &at(&[1.0]), &Impatient(AtomicU64::new(0)));
    assert!(matches!(stopped, Err(Error::Interrupted)));
    let quadtree = tree_of(&Cells::random(QUAD, 1, [5, 5, 1], 9, true));
    assert!(matches!(isosurface_mesh(&quadtree, &at(&[1.0]), &()), Err(Error::Unsupported { .. })));
    let directory = tempfile::tempdir().unwrap();
    for (name, levels) in [("a.stl", vec![1.0, 2.0]), ("a.off", vec![1.0, 2.0]), ("a.city.json", vec![1.0])] {
        let path = directory.path().join(name);
        let format = MeshFormat::of(&path).unwrap();
        let refused = export_isosurfaces(&tree, &at(&levels), Output::create(&path).unwrap(), format, &());
        assert!(matches!(refused, Err(Error::Unsupported { .. })), "{name}");
        assert!(!path.exists());
    }
}

#[test]
fn corrupt_files_give_errors() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    write_goblin(&path, &cells(3, [40, 30, 20]), (Rule::Mean, DataKind::Continuous), Frame::identity());
    let bytes = fs::read(&path).unwrap();
    let request = with(at(&[2.5]), |request| request.ends = ContourEnds::Close);
    let expected = isosurface_mesh(&spinney::open(&path).unwrap(), &request, &()).unwrap();
    for seed in 0..60 {
        let mut random = Random(seed);
        let mut bad = bytes.clone();
        if seed % 3 == 0 {
            bad.truncate(random.below(bytes.len() as u64) as usize);
        } else {
            bad[random.below(bytes.len() as u64) as usize] ^= 1 << random.below(8);
        }
        fs::write(&path, bad).unwrap();
        // Corruption of unneeded segments goes unnoticed.
        if let Ok(mesh) = spinney::open(&path).and_then(|tree| isosurface_mesh(&tree, &request, &())) {
            assert!(mesh.triangles.len() == expected.triangles.len() && seed % 3 > 0, "{seed}");
        }
    }
}
