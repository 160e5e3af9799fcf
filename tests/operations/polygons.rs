//! Polygons of classes with simplified borders: neighbours share one border, and junctions stay
//! fixed.

use std::collections::{BTreeMap, HashMap, HashSet};

use spinney::query::PolygonRequest;
use spinney::{DataKind, Rule};

use crate::common::{Cells, QUAD, Random, as_byte, byte, dataset, made};

/// Bound of the double-precision error of distances between vertices, which are integers below
/// 2^10.
const ROUNDING: f64 = 1e-9;

type Point = [f64; 2];

/// A region: its class and its closed rings.
struct Region {
    class: u64,
    cells: u64,
    rings: Vec<Vec<Point>>,
}

fn regions(cells: &Cells, request: &PolygonRequest) -> Vec<Region> {
    let tree = dataset(cells, Rule::Majority, DataKind::Categorical);
    let mut found = Vec::new();
    tree.polygons(request, &(), &mut |region| {
        let mut rings = vec![Vec::new(); region.parts()];
        for (part, ring) in rings.iter_mut().enumerate() {
            region.points(part, &mut |points| {
                ring.extend(points.iter().map(|[x, y, _]| [*x, *y]));
                Ok(())
            })?;
        }
        found.push(Region { class: region.class().to_f64() as u64, cells: region.cells(), rings });
        Ok(())
    })
    .unwrap();
    found
}

/// Returns a map of classes: waves with noise at their borders, some of it VOID.
fn map(seed: u64, size: [u64; 3], has_void: bool) -> Cells {
    let mut random = Random(seed);
    let waves: Vec<[f64; 3]> = (0..4)
        .map(|_| [0, 1, 2].map(|_| random.below(1000) as f64 / 1000.0))
        .map(|[a, b, c]| [(a - 0.5) / 3.0, (b - 0.5) / 3.0, c * 6.0])
        .collect();
    let noise: Vec<f64> = (0..size[0] * size[1]).map(|_| random.below(1000) as f64 / 2500.0).collect();
    made(QUAD, size, |[x, y, _]| {
        let height: f64 = waves.iter().map(|[a, b, c]| (a * x as f64 + b * y as f64 + c).sin()).sum();
        let class = (height + noise[(y * size[0] + x) as usize]).floor() as i64 + 6;
        Some(byte(class as u8)).filter(|_| !has_void || class != 5)
    })
}

fn area(ring: &[Point]) -> f64 {
    ring.windows(2).map(|pair| pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1]).sum::<f64>() / 2.0
}

fn key(point: Point) -> [u64; 2] {
    point.map(f64::to_bits)
}

/// Returns directed edges with their regions.
fn edges(regions: &[Region]) -> HashMap<[[u64; 2]; 2], usize> {
    let mut all = HashMap::new();
    for (number, region) in regions.iter().enumerate() {
        for pair in region.rings.iter().flat_map(|ring| ring.windows(2)) {
            assert_ne!(pair[0], pair[1]);
            let before = all.insert([key(pair[0]), key(pair[1])], number);
            assert_eq!(before, None, "an edge is gone along once in each direction: {pair:?}");
        }
    }
    all
}

/// Returns pairs of regions with a common border, and the length of that border; `None` is the
/// outside or VOID.
fn neighbours(edges: &HashMap<[[u64; 2]; 2], usize>) -> BTreeMap<(usize, Option<usize>), usize> {
    let mut pairs = BTreeMap::new();
    for ([a, b], own) in edges {
        *pairs.entry((*own, edges.get(&[*b, *a]).copied())).or_default() += 1;
    }
    pairs
}

/// Returns cell corners where three or four borders meet, and those of the raster.
fn junctions(cells: &Cells) -> HashSet<[u64; 2]> {
    let [width, height, _] = cells.size;
    let class = |x: u64, y: u64| match (x.checked_sub(1), y.checked_sub(1)) {
        (Some(x), Some(y)) if x < width && y < height => cells.get([x, y, 0]).map(as_byte),
        _ => None,
    };
    let mut found = HashSet::new();
    for (x, y) in (0..=width).flat_map(|x| (0..=height).map(move |y| (x, y))) {
        let around = [class(x, y), class(x + 1, y), class(x + 1, y + 1), class(x, y + 1)];
        let borders = (0..4).filter(|side| around[*side] != around[(side + 1) % 4]).count();
        let is_end = (x == 0 || x == width) && (y == 0 || y == height);
        if borders > 2 || borders > 0 && is_end {
            found.insert(key([x as f64, y as f64]));
        }
    }
    found
}

/// Returns the distance of a point from a segment.
fn distance([x, y]: Point, [a, b]: [Point; 2]) -> f64 {
    let [across, down] = [b[0] - a[0], b[1] - a[1]];
    let along = ((x - a[0]) * across + (y - a[1]) * down) / (across * across + down * down);
    let along = along.clamp(0.0, 1.0);
    (x - a[0] - along * across).hypot(y - a[1] - along * down)
}

#[test]
fn simplified_borders_are_those_of_both_neighbours() {
    let (mut points, mut kept) = (0, 0);
    for seed in 0..12 {
        let has_void = seed % 3 == 1;
        // The last one is so large that borders cross many blocks, and are simplified in sections.
        let size = if seed == 11 { [700, 520, 1] } else { [90 + 7 * seed, 60 + 5 * seed, 1] };
        let cells = map(seed, size, has_void);
        let exact = regions(&cells, &PolygonRequest::new());
        let tolerance = [0.8, 1.5, 4.0][seed as usize % 3];
        let mut request = PolygonRequest::new();
        request.simplify = Some(tolerance);
        let found = regions(&cells, &request);

        let summary = |all: &[Region]| all.iter().map(|own| (own.class, own.cells)).collect::<Vec<_>>();
        assert_eq!(summary(&found), summary(&exact), "{seed}");
        let (before, after) = (edges(&exact), edges(&found));
        (points, kept) = (points + before.len(), kept + after.len());

        // Regions that shared a border still do, and each border has both regions on it; all other
        // borders are at VOID or the outside, as before.
        let (was, is) = (neighbours(&before), neighbours(&after));
        assert_eq!(is.keys().collect::<Vec<_>>(), was.keys().collect::<Vec<_>>(), "{seed}");
        for ((own, other), count) in &is {
            if let Some(other) = other {
                assert_eq!(is[&(*other, Some(*own))], *count, "{seed}: as many edges on both sides");
            }
        }

        // Vertices are a subset of the old ones; no junction has moved, and no removed vertex is
        // farther from the border than the tolerance.
        let corners = |edges: &HashMap<[[u64; 2]; 2], usize>| -> HashSet<[u64; 2]> {
            edges.keys().map(|[from, _]| *from).collect()
        };
        let (was, is) = (corners(&before), corners(&after));
        assert!(is.is_subset(&was), "{seed}");
        let junctions = junctions(&cells);
        assert!(junctions.is_subset(&is), "{seed}: {} junctions", junctions.difference(&is).count());
        assert!(junctions.len() > 20, "{seed}");
        for (own, simple) in exact.iter().zip(&found) {
            assert_eq!(own.rings.len(), simple.rings.len(), "{seed}");
            for (ring, simple) in own.rings.iter().zip(&simple.rings) {
                // The same ring, with the same orientation.
                assert_eq!(area(ring) > 0.0, area(simple) > 0.0, "{seed}");
                let near = |point: &&Point| {
                    simple
                        .windows(2)
                        .any(|pair| distance(**point, [pair[0], pair[1]]) <= tolerance + ROUNDING)
                };
                assert_eq!(ring.iter().find(|point| !near(point)), None, "{seed}");
            }
        }

        // Areas are only exchanged between regions; without VOID they add up to the whole raster.
        let sum = |all: &[Region]| all.iter().flat_map(|own| &own.rings).map(|ring| area(ring)).sum::<f64>();
        assert_eq!(sum(&exact), cells.count() as f64);
        if !has_void {
            assert_eq!(sum(&found), (size[0] * size[1]) as f64, "{seed}");
        }
    }
    assert!(kept * 2 < points, "{kept} of {points}");
}
