//! Tests of polygons in cells against their definitions.

use std::collections::BTreeMap;

use super::*;

/// Pseudorandom numbers from 0 to `most`.
fn random(state: &mut u64, most: f64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as f64 / (1u64 << 31) as f64 * most
}

/// A star around a point, with a hole. No rings cross.
fn star(state: &mut u64, middle: [f64; 2], radius: f64) -> Vec<Vec<[f64; 2]>> {
    let ring = |state: &mut u64, least: f64, most: f64, is_turned: bool| -> Vec<[f64; 2]> {
        let count = 3 + random(state, 20.0) as usize;
        let corner = |i: usize| {
            let i = if is_turned { count - i } else { i };
            let angle = i as f64 / count as f64 * std::f64::consts::TAU;
            let away = least + random(state, most - least);
            [middle[0] + away * angle.cos(), middle[1] + away * angle.sin()]
        };
        (0..count).map(corner).collect()
    };
    let (a, b) = (random(state, 2.0) > 1.0, random(state, 2.0) > 1.0);
    // (The radii keep the rings apart: edges of the outer ring come closer to the middle than its
    // vertices do.)
    vec![ring(state, radius * 0.9, radius, a), ring(state, radius * 0.1, radius * 0.3, b)]
}

/// Twice the area of a ring, positive if it is counterclockwise.
fn signed_area(ring: &[[f64; 2]]) -> f64 {
    let ends = ring.iter().zip(ring.iter().cycle().skip(1));
    ends.map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum()
}

/// The area of a polygon in a box, by floating sums over its edges.
fn area_in(polygon: &Polygon, bounds: &Bounds) -> f64 {
    let [rows, columns] = [1, 0].map(|axis| [bounds.min[axis] as f64, bounds.max[axis] as f64]);
    polygon.edges.iter().map(|edge| area_left(edge, rows, columns)).sum::<f64>().abs()
}

/// Whether a point is inside, by the even-odd definition.
fn is_inside(rings: &[Vec<[f64; 2]>], [x, y]: [f64; 2]) -> bool {
    let edges = rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
    let crosses = edges
        .filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    crosses.count() % 2 == 1
}

#[test]
fn memory_is_proportional_to_the_number_of_edges() {
    // Every edge passes through all rows, or through half of them, or hardly any.
    for height in [4096.0, 2048.0, 1.0] {
        let zigzag: Vec<[f64; 2]> = (0..20_000)
            .map(|i| [f64::from(i) / 5.0, if i % 2 == 0 { 0.0 } else { height }])
            .chain([[4000.0, 4097.0], [-1.0, 4097.0]])
            .collect();
        let polygon = Polygon::new(&[zigzag]).unwrap();
        assert!(polygon.in_bands.len() <= BANDS_EACH * polygon.edges.len());
        assert_eq!(polygon.edges.len(), 20_002);
    }
}

#[test]
fn spans_of_centres_match_point_queries() {
    let mut state = 1;
    let mut crossings = Crossings::default();
    for _ in 0..60 {
        let middle = [random(&mut state, 40.0), random(&mut state, 40.0)];
        let radius = 1.0 + random(&mut state, 30.0);
        let rings = star(&mut state, middle, radius);
        let polygon = Polygon::of_parts(std::slice::from_ref(&rings)).unwrap();
        for _ in 0..20 {
            let min = [random(&mut state, 40.0) as u64, random(&mut state, 40.0) as u64, 0];
            let size = [1 + random(&mut state, 16.0) as u64, 1 + random(&mut state, 16.0) as u64];
            let bounds = Bounds { min, max: [min[0] + size[0], min[1] + size[1], 1] };
            let cells = (min[1]..bounds.max[1]).flat_map(|y| (min[0]..bounds.max[0]).map(move |x| (x, y)));
            let expected = cells.filter(|(x, y)| is_inside(&rings, [centre(*x), centre(*y)])).count() as u64;
            assert_eq!(polygon.count_centres(&bounds, &mut crossings), expected, "{bounds:?}");
            /// Area that rounding alone may leave in a cell that only touches a vertex. Random
            /// edges cut off far more.
            const ROUNDING: f64 = 1e-12;
            let cells = (min[1]..bounds.max[1]).flat_map(|y| (min[0]..bounds.max[0]).map(move |x| (x, y)));
            let cell = |(x, y): (u64, u64)| Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] };
            let touched = cells.filter(|at| area_in(&polygon, &cell(*at)) > ROUNDING).count() as u64;
            assert_eq!(polygon.count_touched(&bounds, &mut crossings), touched, "{bounds:?}");
            match polygon.cover_centres(&bounds) {
                Cover::Whole => assert_eq!(expected, size[0] * size[1]),
                Cover::Nothing => assert_eq!(expected, 0),
                Cover::Partial => assert!(size[0] * size[1] > 1),
            }
        }
    }
}

#[test]
fn areas_match_sampled_points() {
    let mut state = 2;
    for _ in 0..40 {
        let middle = [random(&mut state, 20.0), random(&mut state, 20.0)];
        let radius = 1.0 + random(&mut state, 12.0);
        let rings = star(&mut state, middle, radius);
        let polygon = Polygon::of_parts(std::slice::from_ref(&rings)).unwrap();
        let whole = Bounds { min: [0; 3], max: [40, 40, 1] };
        let mut sum = 0.0;
        for x in 0..40 {
            for y in 0..40 {
                let cell = Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] };
                let area = area_in(&polygon, &cell);
                sum += area;
                let points = (0..400).map(|i| {
                    [x as f64 + (i % 20) as f64 / 20.0 + 0.025, y as f64 + (i / 20) as f64 / 20.0 + 0.025]
                });
                let expected = points.filter(|point| is_inside(&rings, *point)).count() as f64 / 400.0;
                assert!((area - expected).abs() < 0.06, "{area}, not {expected}");
                match polygon.cover_area(&cell) {
                    Cover::Whole => assert!((area - 1.0).abs() < 1e-9, "{area}"),
                    Cover::Nothing => assert!(area < 1e-9, "{area}"),
                    Cover::Partial => {}
                }
            }
        }
        assert!((sum - area_in(&polygon, &whole)).abs() < 1e-9 * sum.max(1.0));
        if middle.iter().all(|at| *at > radius) {
            let exact = (signed_area(&rings[0]).abs() - signed_area(&rings[1]).abs()) / 2.0;
            assert!((sum - exact).abs() < 1e-9 * exact, "{sum}, not {exact}");
        }
    }
}

#[test]
fn shares_of_rows_are_the_areas_of_their_cells() {
    let mut state = 3;
    let mut crossings = Crossings::default();
    // (Vertices at cell centres and corners, at cell corners only, and anywhere.)
    for step in [0.5, 1.0, 1e-9] {
        for _ in 0..60 {
            let middle = [random(&mut state, 40.0), random(&mut state, 40.0)];
            let radius = 1.0 + random(&mut state, 30.0);
            let mut rings = star(&mut state, middle, radius);
            for at in rings.iter_mut().flatten().flatten() {
                *at = (*at / step).round() * step;
            }
            let polygon = Polygon::of_parts(std::slice::from_ref(&rings)).unwrap();
            let min = [random(&mut state, 40.0) as u64, random(&mut state, 40.0) as u64, 0];
            let size = [1 + random(&mut state, 30.0) as u64, 1 + random(&mut state, 30.0) as u64];
            let bounds = Bounds { min, max: [min[0] + size[0], min[1] + size[1], 1] };
            let mut shares = BTreeMap::new();
            polygon.shares(&bounds, &mut crossings, &mut |row, columns, share| {
                for column in columns {
                    assert!(shares.insert([column, row], share).is_none());
                }
            });
            for y in min[1]..bounds.max[1] {
                for x in min[0]..bounds.max[0] {
                    let area = area_in(&polygon, &Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] });
                    let share = shares.remove(&[x, y]).unwrap_or(0) as f64 / FULL_SHARE as f64;
                    assert!((share - area).abs() < 1e-9, "{share}, not {area}, at {x}, {y}");
                }
            }
            assert!(shares.is_empty());
        }
    }
}

#[test]
fn cells_with_corners_and_edges_on_rings_count_once() {
    // Two squares that share a side, along rows and columns of centres.
    let square = |x: f64| vec![vec![[x, 2.5], [x + 4.0, 2.5], [x + 4.0, 8.5], [x, 8.5]]];
    let all = Bounds { min: [0; 3], max: [20, 20, 1] };
    let mut crossings = Crossings::default();
    let [a, b] = [3.5, 7.5].map(|x| Polygon::of_parts(&[square(x)]).unwrap());
    let both = Polygon::of_parts(&[square(3.5), square(7.5)]).unwrap();
    let counts = [&a, &b, &both].map(|polygon| polygon.count_centres(&all, &mut crossings));
    assert_eq!(counts, [24, 24, 48]);
    assert_eq!([area_in(&a, &all), area_in(&b, &all), area_in(&both, &all)], [24.0, 24.0, 48.0]);
    assert!(Polygon::new(&[vec![[0.0, 0.0], [1.0, f64::NAN], [1.0, 1.0]]]).is_err());
    assert!(Polygon::new(&[]).is_err() && Polygon::of_parts(&[vec![vec![[0.0; 2]; 2]]]).is_err());
}

/// Shares of the cells of a square, each queried by a box of one cell.
fn shares_by_cell(polygon: &Polygon, side: u64) -> Vec<u64> {
    let mut crossings = Crossings::default();
    let mut shares = vec![0; (side * side) as usize];
    for y in 0..side {
        for x in 0..side {
            let cell = Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] };
            polygon.shares(&cell, &mut crossings, &mut |_, _, share| shares[(y * side + x) as usize] = share);
        }
    }
    shares
}

/// Shares of the cells of a square, queried by its quarters, recursively down to a size.
fn shares_by_blocks(polygon: &Polygon, bounds: Bounds, smallest: u64, side: u64, shares: &mut [u64]) {
    let size = bounds.size();
    if size[0] <= smallest {
        let each = &mut |row: u64, columns: Range<u64>, share: u64| {
            columns.for_each(|column| shares[(row * side + column) as usize] = share);
        };
        return polygon.shares(&bounds, &mut Crossings::default(), each);
    }
    let half = size[0] / 2;
    for quarter in 0..4 {
        let min = [bounds.min[0] + quarter % 2 * half, bounds.min[1] + quarter / 2 * half, 0];
        let part = Bounds { min, max: [min[0] + half, min[1] + half, 1] };
        shares_by_blocks(polygon, part, smallest, side, shares);
    }
}

#[test]
fn the_share_of_a_cell_does_not_depend_on_the_box_around_it() {
    let mut state = 5;
    for _ in 0..40 {
        let middle = [random(&mut state, 64.0), random(&mut state, 64.0)];
        let radius = 1.0 + random(&mut state, 40.0);
        let polygon = Polygon::of_parts(&[star(&mut state, middle, radius)]).unwrap();
        let cells = shares_by_cell(&polygon, 64);
        for smallest in [2, 16, 64] {
            let mut shares = vec![0; 64 * 64];
            let all = Bounds { min: [0; 3], max: [64, 64, 1] };
            shares_by_blocks(&polygon, all, smallest, 64, &mut shares);
            assert!(shares == cells, "blocks of {smallest}");
        }
    }
}

fn square(x: f64, y: f64, side: f64) -> Vec<[f64; 2]> {
    vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]]
}

/// Number of cells by centre, number of touched cells, and area.
fn counts(polygon: &Polygon, side: u64) -> (u64, u64, f64) {
    let (all, mut crossings) = (Bounds { min: [0; 3], max: [side, side, 1] }, Crossings::default());
    let (cells, shares) = polygon.sum_shares(&all, &mut crossings);
    let area = cells as f64 + shares as f64 / FULL_SHARE as f64;
    (polygon.count_centres(&all, &mut crossings), polygon.count_touched(&all, &mut crossings), area)
}

#[test]
fn parts_are_united_and_the_rings_of_a_part_are_combined_by_even_odd() {
    let of = |parts: &[Vec<Vec<[f64; 2]>>]| Polygon::of_parts(parts).unwrap();
    let one = |ring: Vec<[f64; 2]>| vec![ring];
    // Two squares of 10 x 10 that overlap by 5 x 5; the same square twice; a square within another.
    let polygon = of(&[one(square(0.0, 0.0, 10.0)), one(square(5.0, 5.0, 10.0))]);
    assert!(polygon.was_invalid());
    assert_eq!(counts(&polygon, 20), (175, 175, 175.0));
    let polygon = of(&[one(square(0.0, 0.0, 10.0)), one(square(0.0, 0.0, 10.0))]);
    assert_eq!(counts(&polygon, 20), (100, 100, 100.0));
    let polygon = of(&[one(square(0.0, 0.0, 10.0)), one(square(2.0, 2.0, 3.0))]);
    assert_eq!(counts(&polygon, 20), (100, 100, 100.0));
    // A hole, in either direction and order; an island in it, as a separate part and as a ring.
    let (outer, hole, island) = (square(0.0, 0.0, 10.0), square(2.0, 2.0, 6.0), square(4.0, 4.0, 2.0));
    let reversed = |ring: &[[f64; 2]]| ring.iter().rev().copied().collect::<Vec<_>>();
    for hole in [hole.clone(), reversed(&hole)] {
        for outer in [outer.clone(), reversed(&outer)] {
            let polygon = of(&[vec![outer.clone(), hole.clone()]]);
            assert!(!polygon.was_invalid());
            assert_eq!(counts(&polygon, 20), (64, 64, 64.0));
            assert_eq!(counts(&of(&[vec![hole.clone(), outer.clone()]]), 20), (64, 64, 64.0));
            let both = [
                of(&[vec![outer.clone(), hole.clone()], one(island.clone())]),
                of(&[vec![outer, hole.clone(), island.clone()]]),
            ];
            for polygon in both {
                assert!(!polygon.was_invalid());
                assert_eq!(counts(&polygon, 20), (68, 68, 68.0));
            }
        }
    }
    // A bow tie, whose two triangles meet in its middle; and one whose crossing is a vertex of
    // both.
    let bow = of(&[one(vec![[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]])]);
    let pinched =
        of(&[one(vec![[0.0, 0.0], [5.0, 5.0], [10.0, 10.0], [10.0, 0.0], [5.0, 5.0], [0.0, 10.0]])]);
    for polygon in [bow, pinched] {
        assert!(polygon.was_invalid());
        assert_eq!(counts(&polygon, 20).2, 50.0);
    }
    // Neighbours with a common side; a ring that retraces an edge; a ring without an area.
    let polygon = of(&[one(square(0.0, 0.0, 4.0)), one(square(4.0, 0.0, 4.0))]);
    assert_eq!(counts(&polygon, 20), (32, 32, 32.0));
    let spike = vec![[0.0, 0.0], [4.0, 0.0], [9.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
    assert_eq!(counts(&of(&[one(spike)]), 20), (16, 16, 16.0));
    let line = vec![[0.5, 0.5], [4.5, 4.5], [9.5, 9.5]];
    assert_eq!(counts(&of(&[one(line)]), 20), (0, 0, 0.0));
}

#[test]
fn exactly_the_crossing_or_touching_rings_are_detected() {
    let mut state = 9;
    let mut found = [0; 2];
    for _ in 0..2000 {
        // Few vertices on a coarse grid, so that all kinds of contacts are frequent.
        let count = 3 + random(&mut state, 5.0) as usize;
        let size = if random(&mut state, 1.0) < 0.5 { 6.0 } else { 40.0 };
        let ring: Vec<[f64; 2]> =
            (0..count).map(|_| [0; 2].map(|_| random(&mut state, size).floor())).collect();
        let ring = without_repeats(&ring);
        if ring.len() < 3 {
            continue;
        }
        let is_valid = simple::reversed_rings(&[vec![ring.clone()]]).is_some();
        assert_eq!(is_valid, is_simple(&ring), "{ring:?}");
        found[usize::from(is_valid)] += 1;
    }
    assert!(found.iter().all(|count| *count > 300), "{found:?}");
}

/// Whether a ring with vertices on a grid is simple, by testing all pairs of edges.
fn is_simple(ring: &[[f64; 2]]) -> bool {
    let count = ring.len();
    let edge = |index: usize| [ring[index], ring[(index + 1) % count]];
    let turn =
        |[a, b]: Edge, p: [f64; 2]| ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])).signum();
    let turn = |edge: Edge, p: [f64; 2]| {
        if turn(edge, p).abs() == 1.0 && cross_is_zero(edge, p) { 0.0 } else { turn(edge, p) }
    };
    let is_on = |[a, b]: Edge, p: [f64; 2]| {
        turn([a, b], p) == 0.0
            && (0..2).all(|axis| a[axis].min(b[axis]) <= p[axis] && p[axis] <= a[axis].max(b[axis]))
    };
    for one in 0..count {
        for other in one + 1..count {
            let ([a, b], [c, d]) = (edge(one), edge(other));
            let is_next = other == one + 1;
            let is_before = one == 0 && other == count - 1;
            let touches = match (is_next, is_before) {
                (true, _) => is_on([a, b], d) || is_on([c, d], a),
                (_, true) => is_on([a, b], c) || is_on([c, d], b),
                _ => {
                    is_on([a, b], c)
                        || is_on([a, b], d)
                        || is_on([c, d], a)
                        || is_on([c, d], b)
                        || (turn([a, b], c) * turn([a, b], d) < 0.0
                            && turn([c, d], a) * turn([c, d], b) < 0.0)
                }
            };
            if touches {
                return false;
            }
        }
    }
    true
}

fn cross_is_zero([a, b]: Edge, p: [f64; 2]) -> bool {
    (b[0] - a[0]) * (p[1] - a[1]) == (b[1] - a[1]) * (p[0] - a[0])
}

#[test]
fn covers_of_arbitrary_parts_match_point_queries() {
    let mut state = 11;
    for round in 0..300 {
        let size = if round % 2 == 0 { 12.0 } else { 30.0 };
        let on_grid = round % 3 == 0;
        let parts: Vec<Vec<Vec<[f64; 2]>>> = (0..1 + random(&mut state, 3.0) as usize)
            .map(|_| {
                let ring = |state: &mut u64| {
                    let count = 3 + random(state, 4.0) as usize;
                    let at = |state: &mut u64| {
                        let at = random(state, size);
                        if on_grid { at.floor() } else { at }
                    };
                    (0..count).map(|_| [at(state), at(state)]).collect::<Vec<_>>()
                };
                (0..1 + random(&mut state, 2.0) as usize).map(|_| ring(&mut state)).collect()
            })
            .collect();
        let polygon = Polygon::of_parts(&parts).unwrap();
        for _ in 0..60 {
            let point = [random(&mut state, size), random(&mut state, size)];
            let expected = parts.iter().any(|rings| is_inside(rings, point));
            assert_eq!(polygon.contains(point), expected, "{point:?} in {parts:?}");
        }
        // Compares areas with many sample points per cell.
        let shares = shares_by_cell(&polygon, 30);
        for (index, share) in shares.iter().enumerate() {
            let (x, y) = ((index % 30) as f64, (index / 30) as f64);
            let points =
                (0..64).map(|i| [x + f64::from(i % 8) / 8.0 + 0.0625, y + f64::from(i / 8) / 8.0 + 0.0625]);
            let inside = points.filter(|point| parts.iter().any(|rings| is_inside(rings, *point))).count();
            let share = *share as f64 / FULL_SHARE as f64;
            assert!(
                (share - inside as f64 / 64.0).abs() < 0.3,
                "{share}, not {inside} of 64, at {x}, {y} of {parts:?}"
            );
        }
    }
}

#[test]
fn areas_outside_of_a_box_are_measured_separately() {
    let all = Bounds { min: [0; 3], max: [10, 10, 1] };
    let polygon = Polygon::new(&[square(-5.0, -5.0, 10.0)]).unwrap();
    assert_eq!(polygon.area_outside(&all), 75.0);
    let polygon = Polygon::new(&[square(-5.0, -5.0, 30.0)]).unwrap();
    assert_eq!(polygon.area_outside(&all), 800.0);
    let polygon = Polygon::new(&[square(1.0, 1.0, 9.0)]).unwrap();
    assert_eq!(polygon.area_outside(&all), 0.0);
    let polygon = Polygon::new(&[square(20.0, 1.0, 9.0)]).unwrap();
    assert_eq!(polygon.area_outside(&all), 81.0);
}

#[test]
fn spans_of_crossing_rings_match_point_queries() {
    let mut state = 13;
    let all = Bounds { min: [0; 3], max: [44, 37, 1] };
    for _ in 0..300 {
        let ring: Vec<[f64; 2]> =
            (0..5).map(|_| [0; 2].map(|_| (random(&mut state, 60.0)).floor() / 2.0 - 8.0)).collect();
        let polygon = Polygon::new(std::slice::from_ref(&ring)).unwrap();
        let mut found = vec![];
        polygon.spans(&all, &mut Crossings::default(), &mut |row, span| {
            found.extend(span.map(|column| [column, row]))
        });
        let cells = (0..37).flat_map(|y| (0..44).map(move |x| [x, y]));
        let expected: Vec<[u64; 2]> =
            cells.filter(|at| is_inside(std::slice::from_ref(&ring), at.map(centre))).collect();
        assert_eq!(found, expected, "{ring:?}");
        for at in expected {
            let cell = Bounds { min: [at[0], at[1], 0], max: [at[0] + 1, at[1] + 1, 1] };
            assert_eq!(polygon.cover_centres(&cell), Cover::Whole, "{at:?} of {ring:?}");
        }
        for (at, side) in [0, 8, 16, 32]
            .into_iter()
            .flat_map(|x| [0, 8, 16, 32].map(|y| [x, y]))
            .flat_map(|at| [2, 4, 8, 16].map(|side| (at, side)))
        {
            let block = Bounds { min: [at[0], at[1], 0], max: [at[0] + side, at[1] + side, 1] };
            let cells = (0..side).flat_map(|y| (0..side).map(move |x| [at[0] + x, at[1] + y]));
            let expected =
                cells.filter(|at| is_inside(std::slice::from_ref(&ring), at.map(centre))).count() as u64;
            assert_eq!(
                polygon.count_centres(&block, &mut Crossings::default()),
                expected,
                "{block:?} of {ring:?}"
            );
            match polygon.cover_centres(&block) {
                Cover::Whole => assert_eq!(expected, side * side, "{block:?} of {ring:?}"),
                Cover::Nothing => assert_eq!(expected, 0, "{block:?} of {ring:?}"),
                Cover::Partial => {}
            }
        }
    }
}

#[test]
fn large_coordinates_have_exact_cells_and_shares() {
    // Where doubles have few bits for fractions of cells, rounding must not change the result for a
    // box.
    let mut state = 17;
    for exponent in [20, 28, 29] {
        let origin = (1u64 << exponent) - 64;
        for round in 0..30 {
            let middle = [origin as f64 + random(&mut state, 64.0), origin as f64 + random(&mut state, 64.0)];
            let radius = 1.0 + random(&mut state, 40.0);
            let mut parts = vec![star(&mut state, middle, radius)];
            if round % 2 == 1 {
                parts.push(star(&mut state, middle.map(|at| at + radius * 0.5), radius));
            }
            let polygon = Polygon::of_parts(&parts).unwrap();
            assert_eq!(polygon.was_invalid(), round % 2 == 1);
            let mut crossings = Crossings::default();
            let mut cells = BTreeMap::new();
            let block = |at: [u64; 2], side: u64| {
                let min = [origin + at[0], origin + at[1], 0];
                Bounds { min, max: [min[0] + side, min[1] + side, 1] }
            };
            for (y, x) in (0..64).flat_map(|y| (0..64).map(move |x| (y, x))) {
                let bounds = block([x, y], 1);
                let share = in_shares(polygon.sum_shares(&bounds, &mut crossings));
                let is_inside = polygon.contains([bounds.min[0], bounds.min[1]].map(centre));
                assert_eq!(polygon.count_centres(&bounds, &mut crossings), u64::from(is_inside));
                cells.insert([x, y], (share, u64::from(is_inside)));
            }
            for side in [2, 8, 32, 64] {
                for (y, x) in (0..64 / side).flat_map(|y| (0..64 / side).map(move |x| (y * side, x * side))) {
                    let bounds = block([x, y], side);
                    let own =
                        (y..y + side).flat_map(|y| (x..x + side).map(move |x| [x, y])).map(|at| cells[&at]);
                    let (shares, centres) = own.fold((0, 0), |sum, cell| (sum.0 + cell.0, sum.1 + cell.1));
                    assert_eq!(in_shares(polygon.sum_shares(&bounds, &mut crossings)), shares);
                    assert_eq!(polygon.count_centres(&bounds, &mut crossings), centres);
                    let all = side * side;
                    match polygon.cover_area(&bounds) {
                        Cover::Whole => assert_eq!(shares, u128::from(all) * u128::from(FULL_SHARE)),
                        Cover::Nothing => assert_eq!(shares, 0),
                        Cover::Partial => {}
                    }
                    match polygon.cover_centres(&bounds) {
                        Cover::Whole => assert_eq!(centres, all),
                        Cover::Nothing => assert_eq!(centres, 0),
                        Cover::Partial => {}
                    }
                }
            }
        }
    }
}

fn in_shares((cells, shares): (u64, u128)) -> u128 {
    u128::from(cells) * u128::from(FULL_SHARE) + shares
}

#[test]
fn many_touching_parts_are_covered() {
    // As when regions of cells become polygons: a multipolygon of squares that touch at their
    // corners.
    let side = 256;
    let parts: Vec<Vec<Vec<[f64; 2]>>> = (0..side * side)
        .filter(|at| (at % side + at / side) % 2 == 0)
        .map(|at| vec![square((at % side) as f64, (at / side) as f64, 1.0)])
        .collect();
    let polygon = Polygon::of_parts(&parts).unwrap();
    assert!(polygon.was_invalid());
    let mut crossings = Crossings::default();
    let mut cells = 0;
    for (y, x) in (0..side).step_by(4).flat_map(|y| (0..side).step_by(4).map(move |x| (y, x))) {
        let bounds = Bounds { min: [x, y, 0], max: [x + 4, y + 4, 1] };
        cells += polygon.count_centres(&bounds, &mut crossings);
    }
    assert_eq!(cells, side * side / 2);
}
