//! Contour lines and bands, against marching squares over the whole raster.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use spinney::query::{ContourLevels, ContourRequest};
use spinney::raw::query::{ContourEnds, ContourSummary};
use spinney::{DataKind, Dataset, Error, Frame, Progress, Rule, SampleType};

use crate::common::{Cells, OCT, Random, opened, options, quad, with, write_cells, write_goblin};

type Point = [f64; 2];

/// Numbers of a raster, row by row.
struct Raster {
    size: [usize; 2],
    numbers: Vec<Option<f64>>,
}

impl Raster {
    /// Reads a level of a tree.
    fn of(tree: &Dataset, level: u8) -> Raster {
        let bounds = tree.extent_at(level);
        let cells = bounds.volume() as usize;
        let (mut bytes, mut valid) = (vec![0; cells * 4], vec![false; cells]);
        tree.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
        let number = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().unwrap()));
        let numbers = bytes.chunks(4).zip(valid).map(|(bytes, valid)| valid.then(|| number(bytes))).collect();
        Raster { size: [bounds.max[0] as usize, bounds.max[1] as usize], numbers }
    }

    fn is_inside(&self, [x, y]: [i64; 2]) -> bool {
        (0..self.size[0] as i64).contains(&x) && (0..self.size[1] as i64).contains(&y)
    }

    fn at(&self, [x, y]: [i64; 2]) -> Option<f64> {
        if self.is_inside([x, y]) { self.numbers[y as usize * self.size[0] + x as usize] } else { None }
    }

    fn valid(&self) -> f64 {
        self.numbers.iter().flatten().count() as f64
    }

    /// Returns lines of a level, and the area at or above it. The higher side is on the right if
    /// rows go down.
    fn contours(&self, level: f64, nodata: ContourEnds) -> (Vec<[Point; 2]>, f64) {
        let (mut lines, mut area) = (Vec::new(), 0.0);
        let [width, height] = self.size.map(|side| side as i64);
        for y in -1..height {
            for x in -1..width {
                let cells = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
                let values = cells.map(|cell| self.at(cell));
                let positions = cells.map(|cell| cell.map(|at| at as f64 + 0.5));
                if let [Some(a), Some(b), Some(c), Some(d)] = values {
                    area += square(positions, [a, b, c, d], level, &mut lines);
                    continue;
                }
                let is_cut = cells.iter().any(|cell| self.is_inside(*cell) && self.at(*cell).is_none());
                if is_cut && nodata == ContourEnds::Open {
                    continue;
                }
                let mean = |corners: &[usize]| {
                    let there: Vec<f64> = corners.iter().filter_map(|corner| values[*corner]).collect();
                    there.iter().sum::<f64>() / there.len() as f64
                };
                let middle = |i: usize| {
                    let (a, b) = (positions[i], positions[(i + 1) % 4]);
                    ([(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0], mean(&[i, (i + 1) % 4]))
                };
                let centre = ([x as f64 + 1.0, y as f64 + 1.0], mean(&[0, 1, 2, 3]));
                for corner in 0..4 {
                    let Some(value) = values[corner] else { continue };
                    let quarter =
                        [(positions[corner], value), middle(corner), centre, middle((corner + 3) % 4)];
                    area +=
                        square(quarter.map(|(at, _)| at), quarter.map(|(_, value)| value), level, &mut lines);
                }
            }
        }
        (lines, area)
    }
}

/// Adds the lines through a square, and returns the area above the level.
fn square(positions: [Point; 4], values: [f64; 4], level: f64, lines: &mut Vec<[Point; 2]>) -> f64 {
    let is_high = values.map(|value| value >= level);
    let crossing = |i: usize| {
        let (a, b) = (i, (i + 1) % 4);
        let share = (level - values[a]) / (values[b] - values[a]);
        [0, 1].map(|axis| positions[a][axis] + share * (positions[b][axis] - positions[a][axis]))
    };
    let changes: Vec<usize> = (0..4).filter(|i| is_high[*i] != is_high[(*i + 1) % 4]).collect();
    let is_joined = values.iter().map(|value| 0.25 * value).sum::<f64>() >= level;
    let mut all = Vec::new();
    for i in 0..4 {
        if is_high[i] {
            all.push(positions[i]);
        }
        if changes.contains(&i) {
            all.push(crossing(i));
        }
    }
    match changes.len() {
        0 => {}
        2 => {
            let (a, b) = (changes[0], changes[1]);
            let (start, end) = if is_high[a] { (a, b) } else { (b, a) };
            lines.push([crossing(start), crossing(end)]);
        }
        _ => {
            let mut corners = 0.0;
            for i in (0..4).filter(|i| is_high[*i]) {
                let before = (i + 3) % 4;
                let end = if is_joined { (i + 1) % 4 } else { before };
                lines.push([crossing(i), crossing(end)]);
                corners += shoelace(&[crossing(before), positions[i], crossing(i)]);
            }
            return if is_joined { shoelace(&all) } else { corners };
        }
    }
    shoelace(&all)
}

/// Area of a ring, positive if clockwise with rows going down.
fn shoelace(ring: &[Point]) -> f64 {
    let edges = ring.iter().zip(ring.iter().cycle().skip(1));
    0.5 * edges.map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>()
}

/// Returns sorted segments without degenerate ones; coordinates are compared with a tolerance.
fn segments(lines: impl Iterator<Item = (f64, [Point; 2])>) -> Vec<[i64; 5]> {
    let mut all: Vec<_> = lines
        .filter(|(_, [a, b])| (a[0] - b[0]).hypot(a[1] - b[1]) > 1e-4)
        .map(|(value, [a, b])| {
            [value, a[0], a[1], b[0], b[1]].map(|number| (number * 1234.567).round() as i64)
        })
        .collect();
    all.sort_unstable();
    all
}

/// A line or polygon: minimum and maximum value, and its lines or rings in cells of a level.
type Found = ([f64; 2], Vec<Vec<Point>>);

/// Returns all lines or bands of a tree.
fn found(tree: &Dataset, request: &ContourRequest, is_bands: bool) -> (Vec<Found>, ContourSummary) {
    let level = request.level.unwrap_or(tree.depth());
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    let mut all = Vec::new();
    let mut each = |contour: &spinney::query::Contour<'_>| {
        let mut parts = Vec::new();
        for part in 0..contour.parts() {
            let mut points: Vec<Point> = Vec::new();
            contour.points(part, &mut |some| {
                points.extend(some.iter().map(|point| {
                    let [x, y, _] = frame.to_cells([point[0], point[1], 0.0]).unwrap();
                    [x, y]
                }));
                Ok(())
            })?;
            assert_eq!(points.len() as u64, contour.count(part));
            assert!(points.len() > 1);
            parts.push(points);
        }
        let is_closed = parts.iter().all(|points| points[0] == points[points.len() - 1]);
        assert_eq!(contour.is_closed(), is_closed);
        all.push((contour.range(), parts));
        Ok(())
    };
    let summary = match is_bands {
        false => tree.contours(request, &(), &mut each),
        true => tree.contour_bands(request, &(), &mut each),
    };
    (all, summary.unwrap())
}

/// Returns a raster of few or of many different numbers, some VOID.
fn cells(seed: u64, size: [u64; 2]) -> Cells {
    let mut random = Random(seed);
    let form = quad(SampleType::F32, 1);
    let (holes, is_whole, side) = (random.below(3), random.below(2) == 0, 1 + random.below(5));
    let number = |random: &mut Random, x: u64, y: u64| {
        let patch = Random(seed ^ (x / side) ^ (y / side) << 20).next() % 6;
        let number = if random.below(4) == 0 { random.below(6) } else { patch };
        if is_whole { number as f32 } else { number as f32 + random.below(1000) as f32 / 999.5 }
    };
    let mut cells = Vec::new();
    for y in 0..size[1] {
        for x in 0..size[0] {
            let is_void = holes > 0 && random.below(if holes == 1 { 30 } else { 4 }) == 0;
            let number = number(&mut random, x, y);
            cells.push((!is_void).then(|| form.value.splat(number).unwrap()));
        }
    }
    Cells { form, size: [size[0], size[1], 1], cells }
}

/// Returns a frame with rows up or down, or a rotated one.
fn frame(seed: u64) -> Frame {
    match seed % 3 {
        0 => Frame::planar([2.0, 0.0, 500_000.0, 0.0, -2.0, 4_000_000.0]),
        1 => Frame::planar([0.5, 0.0, -7.0, 0.0, 0.25, 3.0]),
        _ => Frame::planar([0.6, 0.8, 100.0, 0.8, -0.6, 50.0]),
    }
}

/// Returns a tree of a raster, a level of it, and whether it is mirrored.
fn tree(seed: u64) -> (Dataset, u8, bool) {
    let mut random = Random(seed ^ 77);
    let long = if seed.is_multiple_of(4) { 250 + random.below(300) } else { 1 + random.below(40) };
    let size = if random.below(2) == 0 { [long, 1 + random.below(30)] } else { [1 + random.below(30), long] };
    let size = if seed == 8 { [256, 256] } else { size };
    let (cells, frame) = (cells(seed, size), frame(seed));
    let is_mirrored = seed % 3 == 1;
    let tree = opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), frame));
    let level = tree.depth() - random.below(u64::from(tree.depth()).min(2) + 1) as u8;
    (tree, level, is_mirrored)
}

const VALUES: [f64; 6] = [0.0, 1.0, 2.0, 2.5, 4.0, 5.0];

fn request(level: u8, nodata: ContourEnds) -> ContourRequest {
    let request = ContourRequest::new(ContourLevels::At(VALUES.to_vec()));
    with(request, |request| (request.level, request.ends) = (Some(level), nodata))
}

#[test]
fn lines_are_those_of_marching_squares() {
    for seed in 0..60 {
        let (tree, level, is_mirrored) = tree(seed);
        let raster = Raster::of(&tree, level);
        for nodata in [ContourEnds::Open, ContourEnds::Extend] {
            let (lines, _) = found(&tree, &request(level, nodata), false);
            let ours = lines.iter().flat_map(|([value, _], parts)| {
                parts[0].windows(2).map(|pair| {
                    let pair = [pair[0], pair[1]];
                    // Higher values are on the right in world coordinates.
                    (*value, if is_mirrored { [pair[1], pair[0]] } else { pair })
                })
            });
            let theirs = VALUES.into_iter().flat_map(|value| {
                raster.contours(value, nodata).0.into_iter().map(move |line| (value, line))
            });
            let (ours, theirs) = (segments(ours), segments(theirs));
            let missing = |all: &[[i64; 5]], from: &[[i64; 5]]| -> Vec<[i64; 5]> {
                all.iter().filter(|segment| from.binary_search(segment).is_err()).copied().collect()
            };
            // Segments that differ only by rounding are not missing.
            let (left, right) = (missing(&ours, &theirs), missing(&theirs, &ours));
            let is_near = |a: &[i64; 5], b: &[i64; 5]| a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1);
            let all_near = left.iter().all(|a| right.iter().any(|b| is_near(a, b)));
            let is_alike = ours.len() == theirs.len() && left.len() == right.len() && all_near;
            assert!(is_alike, "{seed} {nodata:?}: only one has {left:?}, {right:?}");
            // Lines are joined to maximum length.
            let bits = |point: Point| point.map(f64::to_bits);
            let open: Vec<_> =
                lines.iter().filter(|(_, parts)| parts[0].first() != parts[0].last()).collect();
            for (value, parts) in &open {
                let end = bits(*parts[0].last().unwrap());
                let goes_on = open.iter().any(|(other, parts)| value == other && bits(parts[0][0]) == end);
                assert!(!goes_on, "{seed} {nodata:?}");
            }
        }
    }
}

#[test]
fn closed_lines_go_around_what_is_higher() {
    for seed in 0..60 {
        let (tree, level, is_mirrored) = tree(seed);
        let raster = Raster::of(&tree, level);
        let (lines, _) = found(&tree, &request(level, ContourEnds::Close), false);
        let mut areas: BTreeMap<u64, f64> = BTreeMap::new();
        for ([value, _], parts) in &lines {
            assert_eq!(parts[0].first(), parts[0].last(), "{seed}");
            *areas.entry(value.to_bits()).or_default() +=
                shoelace(&parts[0]) * if is_mirrored { -1.0 } else { 1.0 };
        }
        for value in VALUES {
            let (_, expected) = raster.contours(value, ContourEnds::Extend);
            let area = areas.get(&value.to_bits()).copied().unwrap_or(0.0);
            // A level below all values has no border except the raster's.
            let least = tree.value_bounds().unwrap().first().map_or(f64::INFINITY, |(least, _)| *least);
            if value > least {
                assert!(
                    (area - expected).abs() < 1e-3 * (1.0 + raster.valid()),
                    "{seed} {value}: {area}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn bands_cover_every_cell_once() {
    for seed in 0..60 {
        let (tree, level, is_mirrored) = tree(seed);
        let raster = Raster::of(&tree, level);
        let (bands, summary) = found(&tree, &request(level, ContourEnds::Open), true);
        assert_eq!(summary.count, bands.len() as u64);
        let (mut areas, mut all): (BTreeMap<u64, f64>, f64) = Default::default();
        for ([_, high], rings) in &bands {
            // Outer rings are counterclockwise in world coordinates, which is clockwise if rows go
            // up.
            let turn = if is_mirrored { 1.0 } else { -1.0 };
            let sizes: Vec<f64> = rings.iter().map(|ring| turn * shoelace(ring)).collect();
            assert!(sizes[0] > 0.0 && sizes[1..].iter().all(|size| *size < 0.0), "{seed}");
            for hole in &rings[1..] {
                assert!(has(&rings[0], hole[0]), "{seed}: a hole outside");
            }
            let size: f64 = sizes.iter().sum();
            assert!(size > 0.0, "{seed}: holes larger than what is around them");
            *areas.entry(high.to_bits()).or_default() += size;
            all += size;
        }
        let near = |a: f64, b: f64| (a - b).abs() < 1e-3 * (1.0 + raster.valid());
        assert!(near(all, raster.valid()), "{seed}: {all}, not {}", raster.valid());
        let mut above = raster.valid();
        for value in VALUES {
            let (_, higher) = raster.contours(value, ContourEnds::Extend);
            let area = areas.get(&value.to_bits()).copied().unwrap_or(0.0);
            // The last band may end at the last value, too.
            if value < VALUES[5] {
                assert!(near(area, above - higher), "{seed} {value}: {area}, not {}", above - higher);
            }
            above = higher;
        }
    }
}

/// Returns whether a ring contains a point, by crossings to the left.
fn has(ring: &[Point], [x, y]: Point) -> bool {
    let crosses = |pair: &&[Point]| {
        let (a, b) = (pair[0], pair[1]);
        (a[1] > y) != (b[1] > y) && a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) < x
    };
    ring.windows(2).filter(crosses).count() % 2 == 1
}

#[test]
fn order_does_not_depend_on_threads_or_memory() {
    let cells = cells(12, [530, 300]);
    let tree = opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), frame(0)));
    for is_bands in [false, true] {
        let request = request(tree.depth(), ContourEnds::Close);
        let in_pool = |threads: usize, memory: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let request = with(request.clone(), |request| request.memory = memory);
            pool.install(|| found(&tree, &request, is_bands))
        };
        let one = in_pool(1, 64 << 20);
        assert!(one.0.len() > 1000);
        assert!(in_pool(2, 64 << 20) == one);
        // All pending lines are spilled to a file.
        assert!(in_pool(2, 1) == one);
    }
}

#[test]
fn both_formats_and_views_have_the_same_lines() {
    let cells = cells(9, [330, 290]);
    let goblin =
        opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), Frame::identity()));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    write_cells(&path, &cells, &options(Rule::Mean, DataKind::Continuous, cells.depth()));
    let request = request(goblin.depth(), ContourEnds::Extend);
    let autumnal = found(&spinney::open(&path).unwrap(), &request, false).0;
    assert!(found(&goblin, &request, false).0 == autumnal);
    let goblin = goblin.view(&["translate=0,0".parse().unwrap()]).unwrap();
    assert!(found(&goblin, &request, false).0 == autumnal);
}

#[test]
fn tiles_without_lines_are_not_read() {
    // A hill in a plain of 4 x 4 tiles.
    let form = quad(SampleType::F32, 1);
    let height = |x: u64, y: u64| {
        let away = (x as f64 - 380.0).hypot(y as f64 - 640.0);
        if away < 60.0 { 60.0 - away } else { (x % 2) as f64 * 0.01 }
    };
    let number = |at: u64| form.value.nearest(|_| height(at % 1024, at / 1024));
    let cells =
        Cells { form, size: [1024, 1024, 1], cells: (0..1 << 20).map(|at| Some(number(at))).collect() };
    let tree =
        opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), Frame::identity()));
    let every = |base| ContourRequest::new(ContourLevels::Every { step: 10.0, base });
    let (lines, summary) = found(&tree, &every(5.0), false);
    assert_eq!((lines.len(), summary.tiles, summary.tiles_read), (6, 16, 4));
    // Bands also follow the raster's border, but do not read uniform tiles inside.
    let (bands, summary) = found(&tree, &every(5.0), true);
    assert_eq!((bands.len(), summary.tiles_read), (7, 12 + 2));
    // Nothing is read if nothing can be found.
    let high = ContourRequest::new(ContourLevels::At(vec![100.0]));
    assert_eq!(found(&tree, &high, false).1.tiles_read, 0);
}

/// Cancels after a few checks.
struct Impatient(AtomicU64);

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) > 3
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let cells = cells(5, [600, 600]);
    let tree =
        opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), Frame::identity()));
    let trace = |request: &ContourRequest| tree.contours(request, &(), &mut |_| Ok(()));
    let levels = |levels| trace(&ContourRequest::new(levels));
    assert!(matches!(levels(ContourLevels::At(vec![])), Err(Error::Invalid { .. })));
    assert!(matches!(levels(ContourLevels::Every { step: -1.0, base: 0.0 }), Err(Error::Invalid { .. })));
    assert!(matches!(levels(ContourLevels::Every { step: 1e-9, base: 0.0 }), Err(Error::Invalid { .. })));
    assert!(trace(&request(tree.depth() + 1, ContourEnds::Open)).is_err());
    let every = ContourRequest::new(ContourLevels::Every { step: 1.0, base: 0.0 });
    let stopped = tree.contours(&every, &Impatient(AtomicU64::new(0)), &mut |_| Ok(()));
    assert!(matches!(stopped, Err(Error::Interrupted)));
    let octree = Cells::random(OCT, 1, [5, 5, 5], 9, true);
    let octree =
        opened(|path| write_goblin(path, &octree, (Rule::Mean, DataKind::Continuous), Frame::identity()));
    assert!(matches!(octree.contours(&every, &(), &mut |_| Ok(())), Err(Error::Unsupported { .. })));
}

#[test]
fn contours_of_small_rasters_reach_the_edges() {
    let form = quad(SampleType::F32, 1);
    let pair = [0.0, 1.0].map(|number| form.value.splat(number));
    let cells = Cells { form, size: [2, 1, 1], cells: pair.to_vec() };
    let tree =
        opened(|path| write_goblin(path, &cells, (Rule::Mean, DataKind::Continuous), Frame::identity()));
    let request = ContourRequest::new(ContourLevels::At(vec![0.25]));
    // Upwards in world coordinates, where y equals rows.
    let (lines, _) = found(&tree, &request, false);
    assert_eq!(lines, [([0.25; 2], vec![vec![[0.75, 0.0], [0.75, 0.5], [0.75, 1.0]]])]);
    let (bands, _) = found(&tree, &request, true);
    assert_eq!(bands.iter().map(|(range, _)| *range).collect::<Vec<_>>(), [[0.0, 0.25], [0.25, 1.0]]);
}
