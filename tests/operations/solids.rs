//! Queries of octrees against an array of cells: points, boxes, slices, measures of solids, rays,
//! images.

use std::path::Path;

use spinney::export::{
    ArrayRequest, Detail, RenderRequest, WindowRequest, export_array, export_window, render,
};
use spinney::query::{PointSamples, Ray};
use spinney::raw::export::CameraProjection;
use spinney::raw::export::image::Format;
use spinney::raw::import::raster::{self, Pixels};
use spinney::tree::MemTree;
use spinney::{
    Bounds, Code, DataKind, Dataset, Dimension, Number, Output, Region, Rule, SampleType, TreeType, Value,
};

use crate::common::{Cells, OCT, QUAD, Random, as_byte, byte, dataset, goblin, made, oct, value_types, with};

/// Returns blocks and isolated cells; existing cells are full.
pub(super) fn blocks(seed: u64, size: [u64; 3]) -> Cells {
    let random = Cells::random(OCT, seed, size, 6, true);
    made(OCT, size, |cell| random.get(cell).filter(|number| as_byte(*number) < 4).map(|_| byte(255)))
}

/// Returns a ball with this radius in cells, in a cube of `2^depth`.
pub(super) fn ball(depth: u8, radius: f64) -> Cells {
    let side = 1u64 << depth;
    let middle = side as f64 / 2.0;
    made(OCT, [side; 3], |cell| {
        let distance: f64 = cell.iter().map(|cell| (*cell as f64 + 0.5 - middle).powi(2)).sum();
        (distance < radius * radius).then(|| byte(255))
    })
}

/// The averaging rule of solids.
pub(super) const SOLID: (Rule, DataKind) = (Rule::Occupancy, DataKind::Continuous);

pub(super) fn solid(cells: &Cells) -> Dataset {
    dataset(cells, SOLID.0, SOLID.1)
}

fn at(model: &MemTree, level: u8, cell: [u64; 3]) -> Option<Value> {
    Code::from_cell(Dimension::Oct, level, cell.map(|cell| cell as u32)).and_then(|code| model.value_at(code))
}

/// Returns the byte of a cell, 0 for VOID.
pub(super) fn byte_at(model: &MemTree, level: u8, cell: [u64; 3]) -> u8 {
    at(model, level, cell).map_or(0, as_byte)
}

pub(super) fn every_cell(size: [u64; 3]) -> impl Iterator<Item = [u64; 3]> {
    let [width, height, depth] = size;
    (0..depth).flat_map(move |z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])))
}

fn all_points(
    cells: &Cells,
    (rule, kind): (Rule, DataKind),
    count: usize,
    expected: &dyn Fn(u8, [u64; 3]) -> Option<Value>,
) {
    let value_type = cells.form.value;
    let (file, tree) = (goblin(cells, rule, kind), dataset(cells, rule, kind));
    let depth = tree.depth();
    let mut random = Random(9);
    for level in 0..=depth {
        let side = (1u64 << level) + 1;
        let positions: Vec<[u32; 3]> =
            (0..count).map(|_| std::array::from_fn(|_| random.below(side) as u32)).collect();
        let mut values = vec![None; count];
        file.values_at(level, &positions, &mut values).unwrap();
        let mut samples = PointSamples::default();
        let positions64: Vec<_> = positions.iter().map(|cell| cell.map(u64::from)).collect();
        tree.points(&positions64, level, &mut samples).unwrap();
        for (i, (cell, value)) in positions64.iter().zip(&values).enumerate() {
            let expected = expected(level, *cell);
            assert_eq!(*value, expected, "level {level} {cell:?}");
            let numbers = expected.map(|value| value_type.numbers(value));
            assert_eq!(samples.get(i), numbers, "level {level} {cell:?}");
            let mut one = [Number::default(); 4];
            if i % 50 == 0 {
                assert_eq!(tree.point(*cell, level, &mut one).unwrap(), expected.is_some());
                assert!(numbers.is_none_or(|numbers| numbers[..] == one[..numbers.len()]));
            }
        }
    }
    assert!(file.values_at(depth + 1, &[], &mut []).is_err());
    assert!(file.values_at(depth, &[[0; 3]], &mut []).is_err());
}

#[test]
fn many_points_at_every_level() {
    let cells = blocks(1, [13, 16, 9]);
    let tree = cells.tree(Rule::Occupancy);
    for count in [1, 100, 1000, 20_000] {
        all_points(&cells, SOLID, count, &|level, cell| at(&tree, level, cell));
    }
    let cells = Cells::random(oct(SampleType::U16, 3), 2, [20, 7, 30], 50, true);
    let tree = cells.tree(Rule::Mean);
    all_points(&cells, (Rule::Mean, DataKind::Continuous), 3000, &|level, cell| at(&tree, level, cell));
    for (seed, value) in (3..).zip(value_types()) {
        let cells = Cells::random(TreeType::new(Dimension::Oct, value), seed, [20, 7, 13], 50, true);
        let tree = cells.tree(Rule::Mean);
        all_points(&cells, (Rule::Mean, DataKind::Continuous), 300, &|level, cell| at(&tree, level, cell));
    }
}

#[test]
fn many_points_in_several_segments_below_each_other() {
    let mut random = Random(8);
    let cells = made(OCT, [260, 40, 40], |_| None);
    let noise =
        cells.cells.iter().map(|_| Some(byte(random.below(90) as u8)).filter(|value| as_byte(*value) < 80));
    let cells = Cells { cells: noise.collect(), ..cells };
    let of_classes = (Rule::Majority, DataKind::Categorical);
    let file = goblin(&cells, of_classes.0, of_classes.1);
    assert!(file.segments() > 4, "{}", file.segments());
    let one = |level, cell: [u64; 3]| {
        let code = Code::from_cell(Dimension::Oct, level, cell.map(|cell| cell as u32));
        code.and_then(|code| file.value_at(code).unwrap())
    };
    for count in [100, 5000] {
        all_points(&cells, of_classes, count, &one);
    }
}

fn array(tree: &Dataset, level: u8, bounds: Bounds, format: Format, memory: u64) -> spinney::Result<Vec<u8>> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a");
    let request = with(ArrayRequest::new(bounds, level), |it| it.memory = memory);
    export_array(tree, &request, Output::create(&path)?, format, &())?;
    Ok(std::fs::read(path).unwrap())
}

#[test]
fn boxes_at_every_level() {
    let cells = blocks(5, [21, 30, 17]);
    let (file, model) = (solid(&cells), cells.tree(Rule::Occupancy));
    let mut random = Random(6);
    for level in 0..=5 {
        let whole = file.extent_at(level);
        for round in 0..8 {
            let mut bounds = whole;
            if round > 0 {
                for axis in 0..3 {
                    bounds.min[axis] = random.below(whole.max[axis]);
                    bounds.max[axis] =
                        bounds.min[axis] + 1 + random.below(whole.max[axis] - bounds.min[axis]);
                }
            }
            let size = bounds.size();
            let memory = [1 << 20, 2 * size[0], 5 * size[0] * size[1]][round % 3];
            let bytes = array(&file, level, bounds, Format::Npy, memory).unwrap();
            let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            let text = String::from_utf8_lossy(&bytes[10..header]).into_owned();
            assert!(text.contains(&format!("'shape': ({}, {}, {})", size[2], size[1], size[0])), "{text}");
            assert_eq!(bytes[header..], array(&file, level, bounds, Format::Raw, memory).unwrap());
            for (byte, cell) in bytes[header..].iter().zip(every_cell(size)) {
                let cell = std::array::from_fn(|axis| bounds.min[axis] + cell[axis]);
                assert_eq!(*byte, byte_at(&model, level, cell), "level {level} {cell:?}");
            }
            assert_eq!(bytes.len() - header, bounds.volume() as usize);
        }
    }
    let outside = Bounds { min: [0; 3], max: [22, 30, 17] };
    let text = array(&file, 5, outside, Format::Npy, 1 << 20).unwrap_err().to_string();
    assert!(text.contains("22 x 30 x 17") && text.contains("21 x 30 x 17"), "{text}");
    let inside = file.extent_at(5);
    assert!(array(&file, 6, inside, Format::Npy, 1 << 20).is_err());
    assert!(array(&file, 5, inside, Format::Png, 1 << 20).unwrap_err().to_string().contains(".npy"));
    assert!(array(&file, 5, inside, Format::Npy, 41).unwrap_err().to_string().contains("a row of 21 cells"));
    assert!(array(&file, 5, Bounds { min: [3; 3], max: [3; 3] }, Format::Npy, 1 << 20).is_err());
}

fn slice(tree: &Dataset, across: usize, position: u64, detail: Detail, name: &str) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    let mut bounds = tree.header().extent_bounds();
    (bounds.min[across], bounds.max[across]) = (position, position + 1);
    let request = with(WindowRequest::new(bounds, detail), |it| {
        it.across = across;
        it.memory = 3000;
    });
    let format = spinney::raw::export::image::format_of(&path).unwrap();
    export_window(tree, &request, Output::create(&path).unwrap(), format, &()).unwrap();
    if name.ends_with("raw") { std::fs::read(path).unwrap() } else { samples(&path).1 }
}

#[test]
fn windows_outside_of_the_tree_are_refused() {
    let cells = Cells::random(OCT, 5, [12, 9, 10], 9, true);
    let tree = dataset(&cells, Rule::Mean, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    for axis in 0..3 {
        let mut bounds = tree.header().extent_bounds();
        (bounds.min[axis], bounds.max[axis]) = (12, 14);
        let request = WindowRequest::new(bounds, Detail::Level(4));
        let output = Output::create(&directory.path().join("x.raw")).unwrap();
        let error = export_window(&tree, &request, output, Format::Raw, &()).unwrap_err();
        assert!(error.to_string().contains("outside of the tree"), "{error}");
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}

/// Returns columns, rows and channels, and the samples.
fn samples(path: &Path) -> ([u64; 3], Vec<u8>) {
    let mut raster = raster::open(path, &Default::default()).unwrap();
    let mut pixels = Pixels::default();
    let (width, height) = (raster.info().width, raster.info().height);
    raster.read(Region::new(0, 0, width, height), &mut pixels).unwrap();
    ([width, height, pixels.bytes.len() as u64 / width / height], pixels.bytes)
}

#[test]
fn slices_across_every_axis_at_every_level() {
    let cells = blocks(7, [21, 30, 17]);
    let (file, model) = (solid(&cells), cells.tree(Rule::Occupancy));
    for level in 0..=5 {
        for across in 0..3 {
            let (u, v) = [(1, 2), (0, 2), (0, 1)][across];
            let size = file.extent_at(level).max;
            for position in [0, 7, 16] {
                let expected: Vec<u8> = every_cell([size[u], size[v], 1])
                    .map(|[column, row, _]| {
                        let mut cell = [position >> (5 - level); 3];
                        (cell[u], cell[v]) = (column, row);
                        byte_at(&model, level, cell)
                    })
                    .collect();
                assert_eq!(slice(&file, across, position, Detail::Level(level), "a.raw"), expected);
                let mut upright: Vec<&[u8]> = expected.chunks(size[u] as usize).collect();
                if across != 2 {
                    upright.reverse();
                }
                assert_eq!(slice(&file, across, position, Detail::Level(level), "a.png"), upright.concat());
            }
        }
    }
    // At any size; VOID counts as 0.
    let half = made(OCT, [8, 8, 8], |[x, _, _]| (x < 3).then(|| byte(255)));
    let row = &slice(&solid(&half), 1, 4, Detail::Size(4, 2), "a.png")[..4];
    assert_eq!(row, [255, 128, 0, 0]);
}

#[test]
fn quadtrees_are_no_solids() {
    let cells = Cells::random(QUAD, 1, [9, 9, 1], 9, true);
    let file = dataset(&cells, Rule::Mean, DataKind::Continuous);
    assert!(file.solid(2, &()).unwrap_err().to_string().contains("an octree"));
    assert!(file.solid_surface(2, &()).unwrap_err().to_string().contains("an octree"));
    assert!(file.rays(2).err().unwrap().to_string().contains("an octree"));
    let file = solid(&blocks(1, [5, 5, 5]));
    assert!(file.solid(4, &()).unwrap_err().to_string().contains("0 to 3"));
    assert!(file.rays(4).err().unwrap().to_string().contains("0 to 3"));
    // An empty octree.
    let empty = solid(&made(OCT, [5, 5, 5], |_| None));
    let found = empty.solid(3, &()).unwrap();
    assert_eq!((found.volume, found.centre, found.bounds), (0.0, None, None));
    assert_eq!(empty.solid_surface(3, &()).unwrap().smooth_area(), 0.0);
}

/// Returns the interval of a ray within a cell. A larger `to - from` is less sensitive to rounding.
fn within(ray: &Ray, cell: [u64; 3]) -> (f64, f64) {
    let (mut from, mut to) = (0.0, f64::INFINITY);
    for (axis, cell) in cell.iter().enumerate() {
        let (low, high) = (*cell as f64 - ray.origin[axis], *cell as f64 + 1.0 - ray.origin[axis]);
        if ray.direction[axis] == 0.0 {
            if low > 0.0 || high <= 0.0 {
                return (1.0, 0.0);
            }
            continue;
        }
        let (a, b) = (low / ray.direction[axis], high / ray.direction[axis]);
        from = f64::max(from, a.min(b));
        to = f64::min(to, a.max(b));
    }
    (from, to)
}

#[test]
fn rays_meet_the_first_cell() {
    for (seed, size) in [(1, [16, 16, 16]), (2, [7, 12, 10]), (3, [3, 20, 31])] {
        let cells = blocks(seed, size);
        // Sparse enough to see through.
        let cells = made(OCT, size, |cell| {
            cells.get(cell).filter(|_| (cell[0] + 2 * cell[1] + 3 * cell[2]) % 5 == 0)
        });
        let (file, model) = (solid(&cells), cells.tree(Rule::Occupancy));
        for level in 0..=cells.depth() {
            let side = 1u64 << level;
            let full: Vec<[u64; 3]> =
                every_cell([side; 3]).filter(|cell| byte_at(&model, level, *cell) >= 128).collect();
            let mut rays = file.rays(level).unwrap();
            let mut random = Random(seed + u64::from(level));
            for round in 0..250 {
                let mut number =
                    |scale: f64| (random.below(1 << 30) as f64 / (1u64 << 30) as f64 - 0.5) * scale;
                let middle = side as f64 / 2.0;
                let mut ray = Ray {
                    origin: [(); 3].map(|()| middle + number(3.0 * side as f64)),
                    direction: [(); 3].map(|()| number(2.0)),
                };
                if round % 3 > 0 {
                    // Towards the cells, not past all of them.
                    let aim = [(); 3].map(|()| middle + number(side as f64));
                    ray.direction = std::array::from_fn(|axis| aim[axis] - ray.origin[axis]);
                }
                if round % 5 == 0 {
                    // Along an axis, through cell centres.
                    ray.origin = ray.origin.map(|number| number.floor() + 0.5);
                    ray.direction = [0.0; 3];
                    ray.direction[round % 3] = if round % 2 == 0 { 0.7 } else { -0.7 };
                }
                let hits = full.iter().map(|cell| (within(&ray, *cell), *cell));
                let first = hits
                    .filter(|((from, to), _)| to - from > 1e-9)
                    .min_by(|((a, _), _), ((b, _), _)| a.total_cmp(b));
                let found = rays.cell(&ray).unwrap();
                let what = format!("seed {seed} level {level} {ray:?}");
                if let Some(found) = found {
                    let (from, to) = within(&ray, found.cell.map(u64::from));
                    assert!(full.contains(&found.cell.map(u64::from)), "{what}");
                    assert!((found.t - from).abs() < 1e-9 * (1.0 + from), "{what}: {found:?}");
                    if to - from <= 1e-9 {
                        continue;
                    }
                    assert_eq!(found.axis.is_none(), from == 0.0);
                }
                assert_eq!(found.map(|hit| hit.cell.map(u64::from)), first.map(|(_, cell)| cell), "{what}");
            }
        }
    }
}

#[test]
fn rays_meet_a_smooth_surface() {
    let file = solid(&ball(6, 25.0));
    for level in [4, 5, 6] {
        let scale = f64::from(1u32 << (6 - level));
        let mut rays = file.rays(level).unwrap();
        let mut random = Random(3);
        for _ in 0..300 {
            let mut number = || random.below(1 << 20) as f64 / (1 << 19) as f64 - 1.0;
            let direction = [number(), number(), number()];
            let length = direction.iter().map(|part| part * part).sum::<f64>().sqrt();
            if length < 0.1 {
                continue;
            }
            let out = direction.map(|part| part / length);
            let origin = out.map(|part| (32.0 + 90.0 * part) / scale);
            let hit = rays.surface(&Ray { origin, direction: out.map(|part| -part) }).unwrap().unwrap();
            let from: [f64; 3] = std::array::from_fn(|axis| hit.point[axis] * scale - 32.0);
            let radius = from.iter().map(|part| part * part).sum::<f64>().sqrt();
            assert!((radius - 25.0).abs() < 0.8 * scale, "level {level}: {radius}");
            let length = hit.inwards.iter().map(|part| part * part).sum::<f64>().sqrt();
            let cosine: f64 = -(0..3).map(|axis| hit.inwards[axis] * out[axis]).sum::<f64>() / length;
            assert!(cosine > 0.98, "level {level}: {cosine}");
            let expected = if level == 6 { 0.5 } else { 0.25 };
            assert!((rays.density(hit.point).unwrap() - expected).abs() < 0.02);
        }
        let miss = Ray { origin: [-5.0, 1.0, 1.0], direction: [1.0, 0.0, 0.0] };
        assert!(rays.surface(&miss).unwrap().is_none());
    }
}

/// The occupancy-weighted sum, over the cells in a ball of 3.5 cells, of a weight that falls to 0
/// at the sphere times the vector to them.
fn moment(cells: &Cells, side: u64, point: [f64; 3]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let around = |axis: usize| {
        let at = point[axis] as i64;
        (at - 5).clamp(0, side as i64) as u64..(at + 6).clamp(0, side as i64) as u64
    };
    for z in around(2) {
        for y in around(1) {
            for x in around(0) {
                let way: [f64; 3] = std::array::from_fn(|axis| [x, y, z][axis] as f64 + 0.5 - point[axis]);
                let weight = 3.5 * 3.5 - way.iter().map(|part| part * part).sum::<f64>();
                let occupancy = cells.get([x, y, z]).map_or(0.0, |value| f64::from(as_byte(value)));
                (0..3).for_each(|axis| sum[axis] += weight.max(0.0) * occupancy * way[axis]);
            }
        }
    }
    sum
}

/// Rays from anywhere through blocks of all sizes, also along axes and from inside, against
/// densities sampled densely along them.
#[test]
fn rays_find_the_surface_that_densities_have() {
    /// Distance between samples, in cells; features thinner than this may be missed.
    const STEP: f64 = 0.02;
    const HIDDEN: f64 = 0.6;
    let mut random = Random(8);
    let mut counts = [0; 3];
    for (seed, side) in [(1, 4u64), (2, 8), (3, 16), (4, 32), (5, 64)] {
        let cells = if side == 64 { ball(6, 27.0) } else { blocks(seed, [side; 3]) };
        let file = solid(&cells);
        let mut rays = file.rays(file.depth()).unwrap();
        for turn in 0..120 {
            let mut number = |most: f64| random.below(1 << 30) as f64 / (1 << 30) as f64 * most;
            let origin = [0; 3].map(|_| number(2.0) * side as f64 - side as f64 / 2.0);
            let target = [0; 3].map(|_| number(side as f64));
            let mut direction: [f64; 3] = std::array::from_fn(|axis| target[axis] - origin[axis]);
            if turn % 4 == 0 {
                direction[turn % 3] = 0.0;
                direction[(turn + 1) % 3] *= f64::from(u8::from(turn % 8 == 0));
            }
            let length = direction.iter().map(|part| part * part).sum::<f64>().sqrt();
            let ray = Ray { origin, direction: direction.map(|part| part / length) };
            // Where a sample is first inside, and where samples first stay inside for some
            // distance.
            let (mut first, mut lasting, mut since) = (f64::INFINITY, f64::INFINITY, None);
            for step in 0..(4.0 * side as f64 / STEP) as u64 {
                let t = step as f64 * STEP;
                if rays.density(ray.at(t)).unwrap() < 0.5 {
                    since = None;
                    continue;
                }
                first = first.min(t);
                if t - *since.get_or_insert(t) >= HIDDEN {
                    lasting = t - HIDDEN;
                    break;
                }
            }
            let hit = rays.surface(&ray).unwrap();
            let Some(hit) = hit else {
                assert!(lasting.is_infinite(), "{side} {ray:?}: {lasting}");
                counts[0] += 1;
                continue;
            };
            assert!(
                hit.t > first - 2.0 * STEP && hit.t < lasting + HIDDEN,
                "{side} {ray:?}: {} {first} {lasting}",
                hit.t
            );
            // A difference of a quarter of a cell is steep enough.
            let density = rays.density(hit.point).unwrap();
            assert!(hit.t == 0.0 || (density - 0.5).abs() < 0.06, "{side} {ray:?}: {density}");
            assert!(rays.value(hit.cell).unwrap()[0] > 0.0);
            let wanted = moment(&cells, side, hit.point);
            let length = |a: [f64; 3]| a.iter().map(|part| part * part).sum::<f64>().sqrt();
            let difference = length(std::array::from_fn(|axis| hit.inwards[axis] - wanted[axis]));
            assert!(difference < 1e-3 * length(wanted) + 0.5, "{side} {ray:?}: {:?} {wanted:?}", hit.inwards);
            counts[if hit.t == 0.0 { 1 } else { 2 }] += 1;
        }
    }
    assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
}

fn rendered(tree: &Dataset, request: &RenderRequest) -> (u8, [u64; 3], Vec<u8>) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let level = render(tree, request, Output::create(&path).unwrap(), Format::Png, &()).unwrap();
    let (size, bytes) = samples(&path);
    (level, size, bytes)
}

#[test]
fn the_silhouette_of_a_ball_is_a_disc() {
    let file = solid(&ball(6, 25.0));
    for (azimuth, elevation) in [(0.0, 0.0), (215.0, 30.0), (90.0, 90.0)] {
        let request = with(RenderRequest::new(120, 90), |it| {
            it.azimuth = azimuth;
            it.elevation = elevation;
            it.background = None;
            it.projection = CameraProjection::Orthographic;
        });
        let (level, size, pixels) = rendered(&file, &request);
        assert_eq!((level, size), (6, [120, 90, 4]));
        let area: f64 = pixels.chunks(4).map(|pixel| f64::from(pixel[3]) / 255.0).sum();
        // The cube around the ball fills the height, except for a margin; it is larger if seen
        // obliquely.
        if elevation != 30.0 {
            let radius = 0.92 * 90.0 / 2.0;
            let expected = std::f64::consts::PI * radius * radius;
            assert!((area / expected - 1.0).abs() < 0.02, "{}", area / expected);
        }
        let sum = |axis: usize| -> f64 {
            let weight =
                |(i, pixel): (usize, &[u8])| [i % 120, i / 120][axis] as f64 * f64::from(pixel[3]) / 255.0;
            pixels.chunks(4).enumerate().map(weight).sum()
        };
        assert!((sum(0) / area - 59.5).abs() < 0.3 && (sum(1) / area - 44.5).abs() < 0.3);
    }
}

#[test]
fn images_depend_on_the_request_alone() {
    let file = solid(&ball(6, 25.0));
    let request = RenderRequest::new(40, 30);
    let (level, size, pixels) = rendered(&file, &request);
    assert_eq!((level, size), (6, [40, 30, 3]));
    assert_eq!(pixels[..3], [255; 3]);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| rendered(&file, &request)).2 == pixels);
    }
    let small = with(request.clone(), |it| {
        it.width = 8;
        it.height = 8;
    });
    assert!(rendered(&file, &small).0 <= 4);
    let fine = with(request.clone(), |it| {
        it.level = Some(6);
        it.scale = 2.0;
        it.background = Some([9, 8, 7]);
    });
    let (level, _, zoomed) = rendered(&file, &fine);
    let seen =
        |pixels: &[u8], background: [u8; 3]| pixels.chunks(3).filter(|pixel| *pixel != background).count();
    assert_eq!(level, 6);
    // A ball that fills the image from top to bottom leaves the corners empty.
    assert!(5 * seen(&zoomed, [9, 8, 7]) > 6 * seen(&pixels, [255; 3]));
    let bad: [RenderRequest; 6] = [
        with(request.clone(), |it| it.width = 0),
        with(request.clone(), |it| it.height = 1 << 20),
        with(request.clone(), |it| it.level = Some(7)),
        with(request.clone(), |it| it.elevation = 91.0),
        with(request.clone(), |it| it.scale = 0.0),
        with(request.clone(), |it| it.samples = 0),
    ];
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    for request in bad {
        assert!(
            render(&file, &request, Output::create(&path).unwrap(), Format::Png, &()).is_err(),
            "{request:?}"
        );
    }
    assert!(!path.exists());
    // An empty scene is not an error.
    let empty = solid(&made(OCT, [5, 5, 5], |_| None));
    assert!(rendered(&empty, &request).2.iter().all(|sample| *sample == 255));
}

#[test]
fn colours_and_classes_are_seen() {
    let form = oct(SampleType::U8, 3);
    let red =
        made(form, [8, 8, 8], |[x, y, z]| (x > 1 && y > 1 && z > 1).then(|| Value::from([200u8, 20, 20])));
    let file = dataset(&red, Rule::Mean, DataKind::Continuous);
    let request = RenderRequest::new(30, 30);
    let (_, _, pixels) = rendered(&file, &request);
    let middle = &pixels[(15 * 30 + 15) * 3..][..3];
    assert!(middle[0] > 100 && middle[0] > 2 * middle[1], "{middle:?}");
    let classes = made(OCT, [8, 8, 8], |[x, _, _]| Some(byte((x / 4) as u8)));
    let file = dataset(&classes, Rule::Majority, DataKind::Categorical);
    let (_, _, pixels) = rendered(&file, &request);
    let pick = |x: usize, y: usize| pixels[(y * 30 + x) * 3..][..3].to_vec();
    assert_ne!(pick(10, 8), pick(20, 8));
}
