use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

use super::*;
use spinney_base::io::{Fetch, RangeCache, RangeFile, ReadBackend};
use spinney_base::value::SampleType;

/// A raster of classes; 0 is VOID.
struct ClassRaster {
    size: [u64; 2],
    cells: Vec<u8>,
}

impl ClassRaster {
    fn random(seed: u64, has_void: bool) -> ClassRaster {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) + 1;
        let mut next = |bound: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % bound
        };
        let size = [1 + next(20), 1 + next(20)];
        let (classes, block) = (1 + next(3), 1 + next(4));
        let coarse: Vec<u8> =
            (0..400).map(|_| (next(classes + u64::from(has_void)) + u64::from(!has_void)) as u8).collect();
        let cells = (0..size[0] * size[1])
            .map(|cell| coarse[(cell / size[0] / block * 20 + cell % size[0] / block) as usize])
            .collect();
        ClassRaster { size, cells }
    }

    fn of(rows: &[&str]) -> ClassRaster {
        let cells = rows.iter().flat_map(|row| row.bytes().map(|cell| cell - b'0')).collect();
        ClassRaster { size: [rows[0].len() as u64, rows.len() as u64], cells }
    }

    /// A diamond of class 1 in VOID. Its border has `8 * radius - 4` vertices.
    fn diamond(radius: u64) -> ClassRaster {
        let size = [2 * radius, 2 * radius];
        let from_middle = |at: u64| at.abs_diff(radius).max((at + 1).abs_diff(radius));
        let cell = |x: u64, y: u64| u8::from(from_middle(x) + from_middle(y) <= radius + 1);
        let cells = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| cell(x, y))).collect();
        ClassRaster { size, cells }
    }

    /// Number of cells of each region, with its class.
    fn regions(&self, has_corners: bool) -> HashSet<(u8, Vec<usize>)> {
        let [width, height] = self.size.map(|side| side as i64);
        let mut seen = vec![false; self.cells.len()];
        let mut regions = HashSet::new();
        for start in 0..self.cells.len() {
            if seen[start] || self.cells[start] == 0 {
                continue;
            }
            let (mut open, mut found) = (vec![start], Vec::new());
            seen[start] = true;
            while let Some(cell) = open.pop() {
                found.push(cell);
                let (x, y) = (cell as i64 % width, cell as i64 / width);
                for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                    let (x, y) = (x + dx, y + dy);
                    let is_near = has_corners || dx == 0 || dy == 0;
                    if is_near && (0..width).contains(&x) && (0..height).contains(&y) {
                        let other = (y * width + x) as usize;
                        if !seen[other] && self.cells[other] == self.cells[start] {
                            seen[other] = true;
                            open.push(other);
                        }
                    }
                }
            }
            found.sort_unstable();
            regions.insert((self.cells[start], found));
        }
        regions
    }
}

impl ClassCells for ClassRaster {
    fn node(&self, _: Code) -> Result<Child<()>> {
        Ok(Child::Inner { representative: Value::from([0u8]), node: () })
    }

    fn window(&self, bounds: &Bounds) -> Result<(Vec<u8>, Vec<bool>)> {
        let rows = bounds.min[1]..bounds.max[1];
        let bytes: Vec<u8> = rows
            .flat_map(|y| (bounds.min[0]..bounds.max[0]).map(move |x| (y * self.size[0] + x) as usize))
            .map(|cell| self.cells[cell])
            .collect();
        let valid = bytes.iter().map(|cell| *cell > 0).collect();
        Ok((bytes, valid))
    }
}

type Ring = Vec<[f64; 2]>;

/// A region: its class, cell count, and polygons.
#[derive(Debug, PartialEq)]
struct Found {
    class: f64,
    cells: u64,
    polygons: Vec<Vec<Ring>>,
}

fn find(raster: &ClassRaster, request: &PolygonRequest) -> Vec<Found> {
    let mut grid = ClassGrid {
        cells: raster,
        level: raster.size[0].max(raster.size[1]).next_power_of_two().ilog2().max(5) as u8,
        size: raster.size,
        frame: Frame::identity(),
        value: ValueType::new(SampleType::U8, 1),
        width: 1,
        classes: None,
    };
    let mut all = Vec::new();
    find_regions(&mut grid, request, &(), &mut |region| {
        let mut rings = Vec::new();
        for part in 0..region.parts() {
            let mut ring: Ring = Vec::new();
            region.points(part, &mut |points| {
                ring.extend(points.iter().map(|[x, y, _]| [*x, *y]));
                Ok(())
            })?;
            assert_eq!(ring.len() as u64, region.count(part));
            assert_eq!(ring.first(), ring.last());
            rings.push(ring);
        }
        let mut rings = rings.into_iter();
        let polygons = region.polygons().iter().map(|count| rings.by_ref().take(*count).collect()).collect();
        all.push(Found { class: region.class().to_f64(), cells: region.cells(), polygons });
        Ok(())
    })
    .unwrap();
    all
}

fn area(ring: &Ring) -> f64 {
    ring.windows(2).map(|pair| pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1]).sum::<f64>() / 2.0
}

fn is_inside(rings: &[Ring], [x, y]: [f64; 2]) -> bool {
    let mut is_inside = false;
    for pair in rings.iter().flat_map(|ring| ring.windows(2)) {
        let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
        if (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax) {
            is_inside = !is_inside;
        }
    }
    is_inside
}

/// Compares exact polygons with regions found by flood fill.
fn check(raster: &ClassRaster, across_corners: bool) {
    let mut request = PolygonRequest::new();
    request.across_corners = across_corners;
    let found = find(raster, &request);
    request.memory = 1;
    assert_eq!(found, find(raster, &request), "memory changes nothing");
    let mut regions = HashSet::new();
    for Found { class, cells, polygons } in &found {
        let mut own = Vec::new();
        for rings in polygons {
            for (index, ring) in rings.iter().enumerate() {
                assert_eq!(area(ring) > 0.0, index == 0, "outer rings are counterclockwise, others not");
                let corners: HashSet<_> = ring[1..].iter().map(|point| point.map(f64::to_bits)).collect();
                assert_eq!(corners.len(), ring.len() - 1, "a ring comes through a point once");
                let around = ring.windows(3).map(|three| [three[0], three[1], three[2]]);
                let last = [ring[ring.len() - 2], ring[0], ring[1]];
                for [a, b, c] in around.chain([last]) {
                    assert!((a[0] == b[0]) != (b[0] == c[0]), "each point is a corner");
                }
                if index > 0 {
                    let [x, y] = ring[0];
                    let near =
                        [[x - 0.5, y - 0.5], [x + 0.5, y - 0.5], [x - 0.5, y + 0.5], [x + 0.5, y + 0.5]];
                    assert!(near.iter().any(|at| is_inside(&rings[..1], *at)), "holes lie inside");
                }
            }
            let width = raster.size[0];
            own.extend((0..raster.cells.len()).filter(|cell| {
                let cell = *cell as u64;
                is_inside(rings, [(cell % width) as f64 + 0.5, (cell / width) as f64 + 0.5])
            }));
        }
        own.sort_unstable();
        assert_eq!(polygons.iter().flatten().map(area).sum::<f64>(), *cells as f64);
        assert_eq!(own.len() as u64, *cells);
        assert!(across_corners || polygons.len() == 1);
        regions.insert((*class as u8, own));
    }
    assert_eq!(regions.len(), found.len());
    assert_eq!(regions, raster.regions(across_corners));
}

#[test]
fn polygons_are_the_regions_of_random_rasters() {
    for seed in 0..400 {
        let raster = ClassRaster::random(seed, true);
        check(&raster, false);
        check(&raster, true);
    }
}

#[test]
fn polygons_are_the_regions_of_difficult_rasters() {
    for rows in [
        &["1111"][..],
        &["1212", "2121", "1212", "2121"],
        &["1010", "0101", "1010", "0101"],
        // Nested rings.
        &[
            "111111111",
            "122222221",
            "121111121",
            "121222121",
            "121212121",
            "121222121",
            "121111121",
            "122222221",
            "111111111",
        ],
        // A spiral.
        &["1111111", "1000001", "1011101", "1010101", "1010001", "1011111", "1000000"],
        // Holes that touch the outer ring, each other, and themselves.
        &["11110", "11101", "10111", "11011", "11111"],
        &["111111", "102011", "120211", "112011", "111111"],
        &["0111", "1011", "1101", "1110"],
    ] {
        check(&ClassRaster::of(rows), false);
        check(&ClassRaster::of(rows), true);
    }
}

/// Returns whether two segments share more than an end.
fn meet([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let side =
        |a: [f64; 2], b: [f64; 2], p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    let is_on = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
        p != a
            && p != b
            && side(a, b, p) == 0.0
            && (0..2).all(|i| a[i].min(b[i]) <= p[i] && p[i] <= a[i].max(b[i]))
    };
    let crosses = side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0;
    crosses || is_on(a, b, c) || is_on(a, b, d) || is_on(c, d, a) || is_on(c, d, b)
}

#[test]
fn simplified_borders_are_shared_and_never_cross() {
    let mut saved = 0;
    for seed in 0..300 {
        let raster = ClassRaster::random(seed, false);
        let mut request = PolygonRequest::new();
        let exact = find(&raster, &request);
        request.simplify = Some([0.6, 1.0, 2.0, 9.0][seed as usize % 4]);
        let found = find(&raster, &request);
        assert_eq!(found.len(), exact.len());
        type Seen = (u32, [[f64; 2]; 2]);
        let mut segments: HashMap<[[u64; 2]; 2], Seen> = HashMap::new();
        let mut total = 0.0;
        for (region, exact) in found.iter().zip(&exact) {
            assert_eq!((region.class, region.cells), (exact.class, exact.cells));
            let rings = region.polygons.iter().flatten();
            total += rings.clone().map(area).sum::<f64>();
            let points = |found: &Found| found.polygons.iter().flatten().map(Vec::len).sum::<usize>();
            saved += points(exact).saturating_sub(points(region));
            for rings in &region.polygons {
                assert!(rings.iter().enumerate().all(|(index, ring)| (area(ring) > 0.0) == (index == 0)));
            }
            for pair in rings.flat_map(|ring| ring.windows(2)) {
                let mut ends = [pair[0], pair[1]].map(|point| point.map(f64::to_bits));
                ends.sort_unstable();
                segments.entry(ends).or_insert((0, [pair[0], pair[1]])).0 += 1;
            }
        }
        assert_eq!(total, (raster.size[0] * raster.size[1]) as f64, "{seed}");
        for (count, [a, b]) in segments.values() {
            let is_edge = (0..2)
                .any(|axis| a[axis] == b[axis] && (a[axis] == 0.0 || a[axis] == raster.size[axis] as f64));
            assert_eq!(*count, if is_edge { 1 } else { 2 }, "{seed}: {a:?} {b:?}");
        }
        let all: Vec<_> = segments.values().map(|(_, ends)| *ends).collect();
        for (index, one) in all.iter().enumerate() {
            assert!(all[..index].iter().all(|other| !meet(*one, *other)), "{seed}: {one:?}");
        }
    }
    assert!(saved > 1000, "{saved}");
}

#[test]
fn simplified_rings_of_all_lengths_keep_an_area() {
    // Rings of 4,097 to 8,191 points consist of two chunks, longer ones of more.
    for radius in [3, 400, 800, 1030, 1200] {
        let mut request = PolygonRequest::new();
        request.simplify = Some(1e6);
        let found = find(&ClassRaster::diamond(radius), &request);
        let rings: Vec<&Ring> = found.iter().flat_map(|region| region.polygons.iter().flatten()).collect();
        assert_eq!(rings.len(), 1);
        assert!(rings[0].len() >= 4 && area(rings[0]) > 0.0, "{radius}: {rings:?}");
    }
}

/// Nodes and tiles of VOID cells, with a byte each in a remote file.
struct RemoteRaster(RangeFile);

impl ClassCells for RemoteRaster {
    fn node(&self, code: Code) -> Result<Child<()>> {
        self.0.share(100 * u64::from(code.level()) + u64::from(code.cell()[0]) * 10, 1)?;
        Ok(Child::Inner { representative: Value::from([0u8]), node: () })
    }

    fn window(&self, bounds: &Bounds) -> Result<(Vec<u8>, Vec<bool>)> {
        self.0.share(1000 + bounds.min[0], 1)?;
        let cells = bounds.volume() as usize;
        Ok((vec![0; cells], vec![false; cells]))
    }
}

/// Numbers of ranges of each fetch.
struct Fetched(Arc<Mutex<Vec<usize>>>);

impl Fetch for Fetched {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        self.0.lock().unwrap().push(ranges.len());
        Ok(ranges.iter().map(|range| vec![0; (range.end - range.start) as usize]).collect())
    }
}

#[test]
fn strips_of_remote_trees_take_a_batch_per_level_and_one_for_tiles() {
    let fetched = Arc::default();
    let cache = (Arc::new(RangeCache::new(1 << 20)), RangeCache::file_number());
    let fetch = Box::new(Fetched(Arc::clone(&fetched)));
    let file = RangeFile::new(Path::new("(remote)"), 1 << 16, fetch, cache, 0);
    let mut grid = ClassGrid {
        cells: &RemoteRaster(file),
        level: 10,
        size: [1024, 1],
        frame: Frame::identity(),
        value: ValueType::new(SampleType::U8, 1),
        width: 1,
        classes: None,
    };
    find_regions(&mut grid, &PolygonRequest::new(), &(), &mut |_| Ok(())).unwrap();
    assert_eq!(*fetched.lock().unwrap(), [1, 2, 4, 4]);
}
