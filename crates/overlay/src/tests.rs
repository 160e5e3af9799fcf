//! Tests of the overlay against simple methods: points in polygons, all pairs of edges, and sums of
//! areas.

use std::path::Path;

use crate::edges::{Edge, PartLists, unite};
use crate::exact::{Cell, crossing_cell, do_cross, passes, turn};
use crate::{OverlayGrid, OverlayRegion, PolygonOverlay};

/// Pseudorandom numbers from a seed (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, most: u64) -> u64 {
        self.next() % most
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

type Polygon = Vec<Vec<[f64; 2]>>;

fn parts(grid: OverlayGrid, polygons: &[(u32, Polygon)]) -> (Vec<OverlayRegion>, f64) {
    let mut overlay = PolygonOverlay::new(grid, 1 << 30);
    for (source, rings) in polygons {
        overlay.add(Path::new("test"), *source, rings).unwrap();
    }
    let mut found = Vec::new();
    let summary = overlay.regions(&mut |own| Some(own.to_vec()), &(), &mut |part| {
        found.push(part);
        Ok(())
    });
    (found, summary.unwrap().area_bound)
}

fn is_in(rings: &[Vec<[f64; 2]>], [x, y]: [f64; 2]) -> bool {
    let mut is_in = false;
    for ring in rings {
        for index in 0..ring.len() {
            let ([ax, ay], [bx, by]) = (ring[index], ring[(index + 1) % ring.len()]);
            if (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax) {
                is_in = !is_in;
            }
        }
    }
    is_in
}

fn area(rings: &[Vec<[f64; 2]>]) -> f64 {
    let ring = |ring: &Vec<[f64; 2]>| {
        ring.windows(2).map(|pair| (pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1]) / 2.0).sum::<f64>()
    };
    rings.iter().map(ring).sum()
}

fn square(west: f64, south: f64, side: f64) -> Vec<[f64; 2]> {
    vec![[west, south], [west + side, south], [west + side, south + side], [west, south + side]]
}

#[test]
fn two_overlapping_squares_have_three_regions() {
    let polygons = [(0, vec![square(0.0, 0.0, 2.0)]), (1, vec![square(1.0, 1.0, 2.0)])];
    let (found, _) = parts(OverlayGrid::of_cells(0.001).unwrap(), &polygons);
    let areas: Vec<_> = found.iter().map(|part| (part.key.clone(), part.area)).collect();
    assert_eq!(areas, [(vec![0], 3.0), (vec![0, 1], 1.0), (vec![1], 3.0)]);
    let both = vec![[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0], [1.0, 1.0]];
    assert_eq!(found[1].polygons, [[both]]);
}

#[test]
fn holes_belong_to_the_enclosing_polygon_even_if_they_touch_it() {
    let hole = vec![[0.0, 1.0], [1.0, 0.5], [1.0, 1.5]];
    let polygons = [(7, vec![square(0.0, 0.0, 4.0), hole, square(2.0, 2.0, 1.0)])];
    let (found, _) = parts(OverlayGrid::of_cells(0.5).unwrap(), &polygons);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].polygons.len(), 1);
    assert_eq!(found[0].polygons[0].len(), 3);
    assert_eq!(found[0].area, 16.0 - 0.5 - 1.0);
}

#[test]
fn regions_that_touch_in_a_point_and_islands_in_holes_are_separate_polygons() {
    let polygons = [
        (0, vec![square(0.0, 0.0, 1.0)]),
        (0, vec![square(1.0, 1.0, 1.0)]),
        (0, vec![square(-5.0, -5.0, 20.0), square(-4.0, -4.0, 18.0)]),
    ];
    let (found, _) = parts(OverlayGrid::of_cells(1.0).unwrap(), &polygons);
    assert_eq!(found[0].polygons.len(), 3);
    assert_eq!(found[0].polygons.iter().map(Vec::len).collect::<Vec<_>>(), [2, 1, 1]);
    assert_eq!(found[0].area, 400.0 - 324.0 + 2.0);
}

/// Polygons that cross themselves and each other, with coordinates of few and of many digits.
#[test]
fn regions_cover_the_points_of_their_sources() {
    let mut random = Random(1);
    for round in 0..300u64 {
        let span = [8.0, 100.0, 1e7][round as usize % 3];
        let is_whole = round % 2 == 0;
        let coordinate = |random: &mut Random| {
            let at = random.unit() * span - span / 3.0;
            if is_whole { at.round() } else { at }
        };
        let count = 1 + random.below(5);
        let polygons: Vec<(u32, Polygon)> = (0..count)
            .map(|_| {
                let rings = 1 + random.below(2);
                let ring = |random: &mut Random| {
                    let corners = 3 + random.below(12);
                    (0..corners).map(|_| [coordinate(random), coordinate(random)]).collect()
                };
                (random.below(3) as u32, (0..rings).map(|_| ring(&mut random)).collect())
            })
            .collect();
        let grid = if round % 5 == 0 {
            OverlayGrid::of_cells(0.5).unwrap()
        } else {
            OverlayGrid::for_coordinates(span)
        };
        let (found, bound) = parts(grid, &polygons);
        check_rings(&found, grid);
        if grid.width() < 0.01 * span / 100.0 {
            for _ in 0..200 {
                let place =
                    [random.unit() * span - span / 3.0 + 1e-5, random.unit() * span - span / 3.0 + 1e-5];
                let mut wanted: Vec<u32> = polygons
                    .iter()
                    .filter(|(_, rings)| is_in(rings, place))
                    .map(|(source, _)| *source)
                    .collect();
                wanted.sort_unstable();
                wanted.dedup();
                let own: Vec<_> = found
                    .iter()
                    .filter(|part| part.polygons.iter().any(|polygon| is_in(polygon, place)))
                    .map(|part| part.key.clone())
                    .collect();
                let wanted: Vec<Vec<u32>> = if wanted.is_empty() { vec![] } else { vec![wanted] };
                assert_eq!(own, wanted, "round {round} at {place:?}");
            }
        }
        // The regions' areas add up to the area of each source.
        for source in 0..3 {
            let of_source: Vec<_> = polygons.iter().filter(|(own, _)| *own == source).cloned().collect();
            let whole: f64 = parts(grid, &of_source).0.iter().map(|part| part.area).sum();
            let sum: f64 = found.iter().filter(|part| part.key.contains(&source)).map(|part| part.area).sum();
            assert!(
                (whole - sum).abs() <= 2.0 * bound + 1e-9 * span * span,
                "round {round}: {whole} and {sum}"
            );
        }
    }
}

/// Checks that edges neither cross nor overlap, that rings are oriented correctly, and that areas
/// match.
fn check_rings(found: &[OverlayRegion], grid: OverlayGrid) {
    let cell = |point: [f64; 2]| -> Cell { point.map(|at| (at / grid.width()).round() as i64) };
    let mut edges: Vec<[Cell; 2]> = Vec::new();
    for part in found {
        let mut sum = 0.0;
        for polygon in &part.polygons {
            for (index, ring) in polygon.iter().enumerate() {
                assert_eq!(ring.first(), ring.last());
                assert!(ring.len() >= 4);
                let own = area(std::slice::from_ref(ring));
                assert!(if index == 0 { own > 0.0 } else { own < 0.0 }, "{own} {ring:?}");
                sum += own;
                let mut corners = ring[1..].to_vec();
                corners.sort_by(|one, other| one.partial_cmp(other).unwrap());
                corners.dedup();
                assert_eq!(corners.len(), ring.len() - 1, "a ring touches itself");
                for pair in ring.windows(2) {
                    let [a, b] = [cell(pair[0]), cell(pair[1])];
                    edges.push(if a <= b { [a, b] } else { [b, a] });
                }
            }
        }
        assert!((sum - part.area).abs() <= 1e-6 * part.area.abs().max(1.0), "{sum} {}", part.area);
    }
    edges.sort_unstable();
    edges.dedup();
    for (index, [a, b]) in edges.iter().enumerate() {
        for [c, d] in &edges[index + 1..] {
            let crosses = turn(*a, *b, *c) * turn(*a, *b, *d) < 0 && turn(*c, *d, *a) * turn(*c, *d, *b) < 0;
            assert!(!crosses, "{a:?} {b:?} and {c:?} {d:?} cross");
            for (ends, point) in [([a, b], c), ([a, b], d), ([c, d], a), ([c, d], b)] {
                let is_between = turn(*ends[0], *ends[1], *point) == 0 && ends[0] < point && point < ends[1];
                assert!(!is_between, "{point:?} lies on {ends:?}");
            }
        }
    }
}

/// Both edges pass through the cell of their crossing.
#[test]
fn crossings_are_in_the_cells_that_both_edges_pass() {
    let mut random = Random(2);
    let mut count = 0;
    while count < 20_000 {
        let span = [4u64, 50, 1 << 20, 1 << 44][random.below(4) as usize];
        let coordinate = |random: &mut Random| {
            let whole = random.below(span) as f64;
            match random.below(4) {
                0 => whole,
                1 => whole + 0.5,
                2 => whole + random.unit(),
                _ => whole / 8.0,
            }
        };
        let mut point = || [coordinate(&mut random), coordinate(&mut random)];
        let (one, other) = ([point(), point()], [point(), point()]);
        if do_cross(one, other) {
            count += 1;
            let cell = crossing_cell(one, other);
            assert!(passes(one, cell) && passes(other, cell), "{one:?} {other:?} {cell:?}");
        }
    }
}

/// Compares `passes` with clipping in integers, in units of half cells.
#[test]
fn passages_of_cells_are_those_of_clipped_edges() {
    let mut random = Random(3);
    for _ in 0..200_000 {
        let mut number = || random.below(13) as i64 - 6;
        let [a, b] = [[number(), number()], [number(), number()]];
        let cell = [number() / 2, number() / 2];
        // In units of half cells, relative to the cell's lower left corner: the cell is 0 <= x, y <
        // 2.
        let [p, q] = [a, b].map(|point| [point[0] - 2 * cell[0] + 1, point[1] - 2 * cell[1] + 1]);
        // Parameter interval, times a common denominator, in which the edge is within the cell, and
        // whether each of its ends belongs to it.
        let denominators = [0, 1].map(|axis| (q[axis] - p[axis]).abs());
        let common = denominators.iter().map(|own| own.max(&1)).product::<i64>() * 2;
        let (mut least, mut most, mut least_counts, mut most_counts) = (0, common, true, true);
        let mut is_outside = false;
        for axis in 0..2 {
            let along = q[axis] - p[axis];
            if along == 0 {
                is_outside |= !(0..2).contains(&p[axis]);
                continue;
            }
            let at = |border: i64| (border - p[axis]) * common / along;
            let (enter, leave) = if along > 0 { (at(0), at(2)) } else { (at(2), at(0)) };
            // (An upward edge enters at 0, which belongs to the cell; a downward edge enters at 2,
            // which does not.)
            if enter > least {
                (least, least_counts) = (enter, along > 0);
            } else if enter == least {
                least_counts &= along > 0;
            }
            if leave < most {
                (most, most_counts) = (leave, along < 0);
            } else if leave == most {
                most_counts &= along < 0;
            }
        }
        let wanted = !is_outside && (least < most || (least == most && least_counts && most_counts));
        let ends = [a, b].map(|point| point.map(|at| at as f64 / 2.0));
        assert_eq!(passes(ends, cell), wanted, "{ends:?} {cell:?}");
    }
}

#[test]
fn edges_that_occur_twice_in_a_polygon_cancel_out() {
    let mut lists = PartLists::default();
    let (one, two) = (lists.number(&[1]), lists.number(&[2]));
    let ends = [[0.0, 0.0], [1.0, 1.0]];
    let edge = |parts| Edge { ends, parts };
    assert!(unite(vec![edge(one), edge(one)], &mut lists).is_empty());
    let joined = unite(vec![edge(one), edge(two), edge(one), edge(two), edge(two)], &mut lists);
    assert_eq!(joined.len(), 1);
    assert_eq!(lists.list(joined[0].parts), [2]);
}

/// Polygons of which many edges meet in a point, nearly overlap, or cross all others.
#[test]
fn dense_edges_are_overlaid_in_bounded_time() {
    let mut random = Random(4);
    // Thin triangles with a common vertex: a star.
    let star: Vec<(u32, Polygon)> = (0..2000u32)
        .map(|number| {
            let turn = std::f64::consts::TAU * f64::from(number) / 2000.0;
            let at = |turn: f64| [1000.0 * turn.cos(), 1000.0 * turn.sin()];
            (number % 7, vec![vec![[0.0, 0.0], at(turn), at(turn + 0.002)]])
        })
        .collect();
    // Strips across the whole plane that nearly overlap.
    let bundle: Vec<(u32, Polygon)> = (0..150u32)
        .map(|number| {
            let mut near = || 1e-4 * random.unit();
            let (first, last) = (near(), near());
            let ring = vec![
                [-1e6, -3e5 + first],
                [1e6, 3e5 + last],
                [1e6, 3e5 + last + 1e-5],
                [-1e6, -3e5 + first + 1e-5],
            ];
            (number % 3, vec![ring])
        })
        .collect();
    // A lattice of strips: each crosses all strips of the other direction.
    let lattice: Vec<(u32, Polygon)> = (0..80u32)
        .flat_map(|number| {
            let at = f64::from(number) * 10.0 + 0.3;
            let strip = |turned: bool| {
                let ring = [[at, 0.0], [at + 5.0, 1.0], [at + 5.0, 801.0], [at, 800.0]];
                vec![ring.map(|[x, y]| if turned { [y, x] } else { [x, y] }).to_vec()]
            };
            [(0, strip(false)), (1, strip(true))]
        })
        .collect();
    for (name, polygons) in [("star", star), ("bundle", bundle), ("lattice", lattice)] {
        let (found, bound) = parts(OverlayGrid::for_coordinates(1e6), &polygons);
        if name == "lattice" {
            let both = found.iter().find(|part| part.key == [0, 1]).unwrap();
            assert_eq!(both.polygons.len(), 80 * 80);
        }
        for source in 0..2 {
            let own: Vec<_> = polygons.iter().filter(|(own, _)| *own == source).cloned().collect();
            let whole: f64 =
                parts(OverlayGrid::for_coordinates(1e6), &own).0.iter().map(|part| part.area).sum();
            let sum: f64 = found.iter().filter(|part| part.key.contains(&source)).map(|part| part.area).sum();
            assert!((whole - sum).abs() <= 2.0 * bound, "{name}: {whole} and {sum}");
        }
    }
}

#[test]
fn coordinates_of_all_sizes_have_grids() {
    for scale in [1e-150, 1e-9, 1.0, 1e9, 1e150] {
        let scaled =
            |ring: Vec<[f64; 2]>| ring.iter().map(|point| point.map(|at| at * scale)).collect::<Vec<_>>();
        let polygons = [(0, vec![scaled(square(0.0, 0.0, 2.0))]), (1, vec![scaled(square(1.0, 1.0, 2.0))])];
        let (found, _) = parts(OverlayGrid::for_coordinates(3.0 * scale), &polygons);
        assert!((found[1].area / scale / scale - 1.0).abs() < 1e-9, "{scale}");
    }
    let mut overlay = PolygonOverlay::new(OverlayGrid::of_cells(1e-9).unwrap(), 1 << 20);
    for far in [1e9, f64::NAN, f64::INFINITY] {
        let error = overlay.add(Path::new("far"), 0, &[square(far, 0.0, 1.0)]).unwrap_err();
        assert!(error.to_string().contains("far"), "{error}");
    }
    for width in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(OverlayGrid::of_cells(width).is_err(), "{width}");
    }
}

#[test]
fn crossings_beyond_the_memory_limit_are_rejected() {
    let mut overlay = PolygonOverlay::new(OverlayGrid::for_coordinates(1e4), 4 << 20);
    for number in 0..1000 {
        let at = f64::from(number) * 10.0;
        overlay
            .add(Path::new("upright"), 0, &[vec![[at, 0.0], [at + 5.0, 0.0], [at + 5.0, 1e4], [at, 1e4]]])
            .unwrap();
        overlay
            .add(Path::new("across"), 1, &[vec![[0.0, at], [1e4, at], [1e4, at + 5.0], [0.0, at + 5.0]]])
            .unwrap();
    }
    let error = overlay.regions(&mut |own| Some(own.to_vec()), &(), &mut |_| Ok(())).unwrap_err();
    assert!(matches!(error, spinney_base::Error::TooLarge { .. }), "{error}");
}
