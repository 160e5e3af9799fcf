//! Curves, areas and points where two solids' surfaces meet, against set operations and against
//! pairs of triangles.

use std::collections::HashMap;

use spinney::brep::{Faces, Location};
use spinney::raw::brep::surface_intersection::{LineKind, SurfaceIntersection, surface_intersection};

use crate::common::Random;
use crate::common::exact::{cuboid, prism, turned};
use crate::common::sets::{Body, MEMORY, Solid, combined, cut_at_edges, tetrahedron, triangulated};

type Point = [f64; 3];

fn found(a: &Body, b: &Body) -> SurfaceIntersection {
    let found = surface_intersection(&a.model, &b.model, MEMORY, &()).unwrap();
    let (of_a, of_b) = (triangles_of_sources(a), triangles_of_sources(b));
    for line in &found.lines {
        assert_eq!(line.faces.len() + 1, line.points.len());
        assert!(line.kind == LineKind::Touch || line.is_closed(), "{line:?}");
        for (ends, faces) in line.points.windows(2).zip(&line.faces) {
            assert_ne!(ends[0], ends[1]);
            for (sources, [left, right]) in [&of_a, &of_b].into_iter().zip(faces) {
                // Of faces with one number, some contain the segment.
                let along = minus(ends[1], ends[0]);
                let reach = |face: &u64| {
                    let heights = sources[face].iter().flat_map(|corners| {
                        let to_left = cross(normal([corners[0], corners[1], corners[2]]), along);
                        corners
                            .iter()
                            .map(move |corner| dot(to_left, minus(*corner, ends[0])) / size(to_left))
                    });
                    heights.fold([0.0, 0.0], |[low, high]: [f64; 2], at| [low.min(at), high.max(at)])
                };
                assert!(reach(left)[1] > 1e-6 && reach(right)[0] < -1e-6, "{left} {right}");
            }
        }
    }
    assert!(found.areas.iter().all(|area| area.polygon.area > 0.0));
    found
}

fn length(found: &SurfaceIntersection, kind: LineKind) -> f64 {
    found.lines.iter().filter(|line| line.kind == kind).map(|line| line.length()).sum()
}

fn area(found: &SurfaceIntersection, is_same_side: bool) -> f64 {
    let areas = found.areas.iter().filter(|area| area.is_same_side == is_same_side);
    areas.map(|area| area.polygon.area).sum()
}

fn minus(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

fn cross(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

fn size(a: Point) -> f64 {
    dot(a, a).sqrt()
}

/// The length of the edges between faces of the first solid and of the second in their
/// intersection: the first one's face edges that remain after cancelling opposite ones.
fn seam(a: &Body, b: &Body) -> f64 {
    let both = combined(1, &[a, b]);
    // (Sources of the second solid come after those of the first. All faces belong to its object.)
    let mut sources = 0;
    let count = &mut |face: &spinney::brep::Face<'_>| {
        sources = sources.max(face.source + 1);
        Ok(())
    };
    a.model.each(count).unwrap();
    let mut edges: HashMap<[[i32; 3]; 2], i32> = HashMap::new();
    let mut add = |face: &spinney::brep::Face<'_>| {
        for ring in face.rings().filter(|_| face.source < sources) {
            for i in 0..ring.len() {
                let (from, to) = (ring[i], ring[(i + 1) % ring.len()]);
                let (key, sign) = if from < to { ([from, to], 1) } else { ([to, from], -1) };
                *edges.entry(key).or_default() += sign;
            }
        }
        Ok(())
    };
    both.model.each(&mut add).unwrap();
    let world = |at: [i32; 3]| both.model.grid().to_world(at);
    let open = edges
        .iter()
        .map(|([from, to], count)| f64::from(count.abs()) * size(minus(world(*to), world(*from))));
    open.sum()
}

/// Returns triangles of faces, assumed convex, by the source face number.
fn triangles_of_sources(body: &Body) -> HashMap<u64, Vec<[Point; 3]>> {
    let mut all: HashMap<u64, Vec<[Point; 3]>> = HashMap::new();
    let mut add = |face: &spinney::brep::Face<'_>| {
        let ring: Vec<Point> =
            face.rings().next().unwrap().iter().map(|at| body.model.grid().to_world(*at)).collect();
        let fan = (2..ring.len()).map(|i| [ring[0], ring[i - 1], ring[i]]);
        all.entry(face.source).or_default().extend(fan.filter(|corners| size(normal(*corners)) > 0.0));
        Ok(())
    };
    body.model.each(&mut add).unwrap();
    all
}

/// Returns triangles of convex faces in world coordinates.
fn triangles(body: &Body) -> Vec<[Point; 3]> {
    let mut all = Vec::new();
    let mut add = |face: &spinney::brep::Face<'_>| {
        let world: Vec<Point> = face.points.iter().map(|point| body.model.grid().to_world(*point)).collect();
        all.extend((2..world.len()).map(|i| [world[0], world[i - 1], world[i]]));
        Ok(())
    };
    body.model.each(&mut add).unwrap();
    all
}

/// Clips a convex polygon to the half-space below a plane.
fn clipped(polygon: &[Point], normal: Point, base: Point) -> Vec<Point> {
    let height = |point: Point| dot(normal, minus(point, base)) / size(normal);
    let mut all = Vec::new();
    for i in 0..polygon.len() {
        let (from, to) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        let (a, b) = (height(from), height(to));
        if a <= 1e-6 {
            all.push(from);
        }
        if (a > 1e-6 && b < -1e-6) || (a < -1e-6 && b > 1e-6) {
            all.push([0, 1, 2].map(|axis| from[axis] + (to[axis] - from[axis]) * a / (a - b)));
        }
    }
    all
}

fn normal([a, b, c]: [Point; 3]) -> Point {
    cross(minus(b, a), minus(c, a))
}

/// Returns the vertices of the intersection of two triangles, which is convex.
fn common(a: [Point; 3], b: [Point; 3]) -> Vec<Point> {
    let mut polygon = a.to_vec();
    let plane = normal(b);
    for way in [plane, plane.map(|part| -part)] {
        polygon = clipped(&polygon, way, b[0]);
    }
    for i in 0..3 {
        polygon = clipped(&polygon, cross(minus(b[(i + 1) % 3], b[i]), plane), b[i]);
    }
    polygon
}

fn newell(polygon: &[Point]) -> f64 {
    let sums = (2..polygon.len()).map(|i| normal([polygon[0], polygon[i - 1], polygon[i]]));
    size(sums.fold([0.0; 3], |sum, part| [0, 1, 2].map(|axis| sum[axis] + part[axis]))) / 2.0
}

fn distance_to_segment(point: Point, ends: &[Point]) -> f64 {
    let (along, to) = (minus(ends[1], ends[0]), minus(point, ends[0]));
    let share = (dot(along, to) / dot(along, along)).clamp(0.0, 1.0);
    size(minus(to, along.map(|part| part * share)))
}

/// Checks that exactly the intersections of triangle pairs are found; grid units are about one.
fn check_by_pairs(a: &Body, b: &Body, name: &str) -> SurfaceIntersection {
    let found = found(a, b);
    let tolerance = 1e-5;
    let rings = found.areas.iter().flat_map(|area| &area.polygon.rings);
    let segments: Vec<&[Point]> = found
        .lines
        .iter()
        .map(|line| &line.points)
        .chain(rings)
        .flat_map(|points| points.windows(2))
        .collect();
    let (mut same, mut turned, mut midpoints) = (0.0, 0.0, Vec::new());
    for one in triangles(a) {
        for other in triangles(b) {
            let shared = common(one, other);
            let (n, m) = (normal(one), normal(other));
            if size(cross(n, m)) < 1e-9 * size(n) * size(m) {
                let sum = if dot(n, m) > 0.0 { &mut same } else { &mut turned };
                *sum += newell(&shared);
                continue;
            }
            // Vertices and midpoints: a segment may have several vertices at nearly the same
            // position.
            for from in &shared {
                for to in &shared {
                    midpoints.push([0, 1, 2].map(|axis| (from[axis] + to[axis]) / 2.0));
                }
            }
        }
    }
    for midpoint in midpoints {
        let nearest = segments.iter().map(|ends| distance_to_segment(midpoint, ends));
        let points = found.points.iter().map(|point| size(minus(point.point, midpoint)));
        let nearest = nearest.chain(points).fold(f64::INFINITY, f64::min);
        // Edges within an area are not reported.
        let is_in_area = || {
            found.areas.iter().any(|area| {
                let ring = &area.polygon.rings[0];
                let normal = (2..ring.len()).map(|i| normal([ring[0], ring[i - 1], ring[i]]));
                let normal = normal.fold([0.0; 3], |sum, part| [0, 1, 2].map(|axis| sum[axis] + part[axis]));
                dot(normal, minus(midpoint, ring[0])).abs() < tolerance * size(normal)
            })
        };
        assert!(nearest < tolerance || is_in_area(), "{name}: {midpoint:?} is missing, {nearest}, {found:?}");
    }
    let near = |a: f64, b: f64| (a - b).abs() < tolerance * (1.0 + a + b);
    assert!(near(area(&found, true), same), "{name}: {} {same}", area(&found, true));
    assert!(near(area(&found, false), turned), "{name}: {} {turned}", area(&found, false));
    // All of it is on both surfaces.
    let middle = |ends: &[Point]| [0, 1, 2].map(|axis| (ends[0][axis] + ends[1][axis]) / 2.0);
    let points = segments.iter().flat_map(|ends| [ends[0], middle(ends)]);
    for point in points.chain(found.points.iter().map(|point| point.point)) {
        for body in [a, b] {
            let distance = body.model.signed_distance(point).unwrap();
            assert!(distance.abs() < tolerance, "{name}: {point:?} is off by {distance}");
        }
    }
    found
}

fn check(a: &Body, b: &Body, name: &str) -> SurfaceIntersection {
    let found = check_by_pairs(a, b, name);
    let (length, seam) = (length(&found, LineKind::Crossing), seam(a, b));
    assert!(
        (length - seam).abs() < 1e-4 * (1.0 + seam),
        "{name}: {length}, edges of the intersection {seam}"
    );
    found
}

#[test]
fn boxes_in_all_ways() {
    let bits = 7;
    let a = Body::of(&cuboid([20; 3], [60; 3]), bits);
    let with = |min: [i32; 3], max: [i32; 3], name: &str| {
        let b = Body::of(&cuboid(min, max), bits);
        let found = check(&a, &b, name);
        check(&b, &a, name);
        let lines = |kind: LineKind| found.lines.iter().filter(|line| line.kind == kind).count();
        (
            [lines(LineKind::Crossing), lines(LineKind::Touch), found.areas.len(), found.points.len()],
            [length(&found, LineKind::Crossing), length(&found, LineKind::Touch)],
            [area(&found, true), area(&found, false)],
        )
    };
    let none = ([0; 4], [0.0; 2], [0.0; 2]);
    assert_eq!(with([0; 3], [10; 3], "apart"), none);
    assert_eq!(with([30; 3], [50; 3], "inside"), none);
    assert_eq!(with([40; 3], [80; 3], "corner in corner"), ([1, 0, 0, 0], [120.0, 0.0], [0.0; 2]));
    assert_eq!(with([30, 30, 0], [50, 50, 99], "through"), ([2, 0, 0, 0], [160.0, 0.0], [0.0; 2]));
    assert_eq!(with([60; 3], [80; 3], "corner at corner"), ([0, 0, 0, 1], [0.0; 2], [0.0; 2]));
    assert_eq!(with([60, 60, 20], [80, 80, 60], "edge at edge"), ([0, 1, 0, 0], [0.0, 40.0], [0.0; 2]));
    assert_eq!(with([60, 60, 30], [80, 80, 90], "part of an edge"), ([0, 1, 0, 0], [0.0, 30.0], [0.0; 2]));
    assert_eq!(with([60, 30, 30], [80, 50, 50], "on a wall"), ([0, 0, 1, 0], [0.0; 2], [0.0, 400.0]));
    assert_eq!(with([60, 20, 20], [80, 60, 60], "side by side"), ([0, 0, 1, 0], [0.0; 2], [0.0, 1600.0]));
    // To the left of a line, seen from outside, the first surface continues into the second solid.
    let b = Body::of(&cuboid([40; 3], [80; 3]), bits);
    let faces = triangles_of_sources(&a);
    let line = &found(&a, &b).lines[0];
    for (ends, [[left, _], _]) in line.points.windows(2).zip(&line.faces) {
        let along = minus(ends[1], ends[0]);
        let to_left = cross(normal(faces[left][0]), along);
        let next_to_line = |way: f64| {
            [0, 1, 2].map(|axis| (ends[0][axis] + ends[1][axis] + way * to_left[axis] / size(to_left)) / 2.0)
        };
        assert!(b.is_inside(next_to_line(1.0)) && !b.is_inside(next_to_line(-1.0)));
    }
    // Inside with a common wall: no line, since points on the wall count as inside.
    assert_eq!(with([40, 30, 30], [60, 50, 50], "inside at a wall").2, [400.0, 0.0]);
    // Half inside: walls continue, and areas are bounded by the inner region.
    let found = with([40, 30, 20], [80, 50, 60], "in a groove");
    assert_eq!((found.0[2], found.2), (2, [800.0, 0.0]));
    assert_eq!(with([20; 3], [60; 3], "the same").2, [9600.0, 0.0]);
}

/// Solids of the same shape on one another: areas with holes, areas around them, and curves through
/// both.
#[test]
fn frames_lie_on_frames() {
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole = |low: i32, high: i32| square(low, high).into_iter().rev().collect::<Vec<_>>();
    let frame = |low: i32, high: i32, bottom: i32, top: i32| {
        Body::of(&prism(&[square(low, high), hole(low + 10, high - 10)], bottom, top), 7)
    };
    let a = frame(10, 90, 10, 40);
    let found = found(&a, &frame(10, 90, 40, 60));
    assert_eq!((found.lines.len(), found.areas.len(), area(&found, false)), (0, 1, 6400.0 - 3600.0));
    assert_eq!(found.areas[0].polygon.rings.len(), 2);
    // One that covers the hole.
    let lid = Body::of(&cuboid([15, 15, 40], [85, 85, 50]), 7);
    let found = surface_intersection(&a.model, &lid.model, MEMORY, &()).unwrap();
    assert_eq!((found.areas.len(), area(&found, false)), (1, 4900.0 - 3600.0));
    // Around two bars of the first: one curve for each bar's inner region.
    let found = check_scaled(&a, &Body::of(&frame_upright(), 7), 1.0, "links of a chain");
    assert_eq!((found.lines.len(), found.areas.len()), (2, 0));
    assert!(found.lines.iter().all(|line| line.kind == LineKind::Crossing && line.is_closed()));
}

/// A frame inside another one, whose bars it cuts from outside and from below.
fn frame_upright() -> Solid {
    let faces = prism(
        &[vec![[0, 0], [100, 0], [100, 60], [0, 60]], vec![[14, 20], [14, 50], [86, 50], [86, 20]]],
        42,
        58,
    );
    // y goes up, z to the back.
    let turned = |[x, y, z]: [i32; 3]| [x, z, y];
    let faces = faces
        .iter()
        .map(|rings| rings.iter().map(|ring| ring.iter().rev().map(|at| turned(*at)).collect()).collect());
    faces.collect()
}

fn random_tetrahedron(random: &mut Random, below: u64, scale: i32) -> Option<Solid> {
    let mut point = || [0; 3].map(|_| random.below(below) as i32 * scale + scale);
    tetrahedron([point(), point(), point(), point()])
}

/// Tetrahedra on few points: vertices, edges and faces meet in all possible ways.
#[test]
fn tetrahedra_on_few_points() {
    let mut random = Random(41);
    let (mut pairs, mut kinds) = (0, [0; 4]);
    while pairs < 250 {
        let below = [3, 4, 6][pairs % 3];
        let scale = 1 << 20;
        let mut one = || random_tetrahedron(&mut random, below, scale);
        let (Some(a), Some(b)) = (one(), one()) else { continue };
        let [a, b] = [a, b].map(|faces| Body::of(&faces, 24));
        let found = check_scaled(&a, &b, f64::from(scale), &format!("pair {pairs}"));
        pairs += 1;
        kinds[0] += usize::from(length(&found, LineKind::Crossing) > 0.0);
        kinds[1] += usize::from(length(&found, LineKind::Touch) > 0.0);
        kinds[2] += usize::from(!found.areas.is_empty());
        kinds[3] += usize::from(!found.points.is_empty());
    }
    assert!(kinds.iter().all(|count| *count > 5), "{kinds:?}");
}

/// [`check`] without the pairs, for large coordinates, so that rounding of the operation's result
/// does not matter.
fn check_scaled(a: &Body, b: &Body, scale: f64, name: &str) -> SurfaceIntersection {
    let found = found(a, b);
    let (length, seam) = (length(&found, LineKind::Crossing) / scale, seam(a, b) / scale);
    assert!((length - seam).abs() < 1e-4, "{name}: {length}, edges of the intersection {seam}");
    found
}

/// Surfaces split at edges where others are not, and hollow solids, pair by pair.
#[test]
fn cut_edges_and_hollow_bodies() {
    let mut random = Random(7);
    let mut pairs = 0;
    while pairs < 60 {
        let scale = 60;
        let (Some(a), Some(b)) =
            (random_tetrahedron(&mut random, 4, scale), random_tetrahedron(&mut random, 4, scale))
        else {
            continue;
        };
        let name = format!("pair {pairs}");
        let a = if pairs % 2 == 0 { cut_at_edges(&a, 6, &mut random) } else { a };
        let b = if pairs % 3 == 0 { cut_at_edges(&b, 6, &mut random) } else { b };
        check_by_pairs(&Body::of(&a, 9), &Body::of(&b, 9), &name);
        pairs += 1;
    }
    let hollow = [cuboid([10; 3], [90; 3]), turned(cuboid([30; 3], [70; 3]))].concat();
    let hollow = Body::of(&triangulated(&hollow), 7);
    for (min, max) in
        [([20; 3], [50; 3]), ([30; 3], [70; 3]), ([30, 30, 40], [70, 70, 60]), ([0, 40, 40], [99, 60, 60])]
    {
        check(&hollow, &Body::of(&triangulated(&cuboid(min, max)), 7), &format!("{min:?}"));
    }
}

/// A solid of adjacent boxes, whose inner walls exist twice with opposite orientation: these bound
/// nothing.
#[test]
fn walls_in_one_place_bound_nothing() {
    let mut random = Random(23);
    let (scale, mut pairs) = (1 << 18, 0);
    while pairs < 60 {
        let cut = 1 + random.below(4) as i32;
        let box_of =
            |low: [i32; 3], high: [i32; 3]| cuboid(low.map(|at| at * scale), high.map(|at| at * scale));
        let faces = [box_of([1, 1, 1], [1 + cut, 6, 6]), box_of([1 + cut, 1, 1], [6, 6, 6])].concat();
        let Some(other) = random_tetrahedron(&mut random, 7, scale) else { continue };
        let whole = Body::of(&box_of([1; 3], [6; 3]), 23);
        let [divided, other] = [faces, other].map(|faces| Body::of(&faces, 23));
        for (divided, whole) in
            [([&divided, &other], [&whole, &other]), ([&other, &divided], [&other, &whole])]
        {
            let [found, expected] =
                [divided, whole].map(|[a, b]| surface_intersection(&a.model, &b.model, MEMORY, &()).unwrap());
            let lengths = [&found, &expected].map(|found| length(found, LineKind::Crossing));
            assert!((lengths[0] - lengths[1]).abs() < 1e-9 * (1.0 + lengths[1]), "pair {pairs}: {lengths:?}");
        }
        pairs += 1;
    }
}

/// Results of operations have off-grid vertices, and walls in common with their operands.
#[test]
fn results_of_operations_are_operands() {
    let a = Body::of(&tetrahedron([[3, 5, 7], [120, 11, 9], [13, 101, 4], [31, 37, 119]]).unwrap(), 7);
    let b = Body::of(&tetrahedron([[100, 90, 80], [1, 70, 6], [90, 2, 11], [40, 50, 125]]).unwrap(), 7);
    let crossing = found(&a, &b);
    let without = combined(2, &[&a, &b]);
    assert_ne!(without.model.volume_correction().unwrap(), 0.0);
    // The cut wall is entirely a wall of the other solid, from the other side; the rest of the
    // first one's boundary coincides with its own walls.
    let cut = found(&without, &b);
    let kept = found(&without, &a);
    let both = combined(1, &[&a, &b]);
    let of_both = found(&both, &b);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (a + b), "{a} {b}");
    near(area(&cut, false), area(&of_both, true));
    near(area(&found(&both, &a), true) + area(&kept, true), area(&found(&a, &a), true));
    // Boundaries of areas are no curves if the surfaces do not cross.
    assert_eq!(cut.lines, []);
    let rims = |found: &SurfaceIntersection| -> f64 {
        let rings = found.areas.iter().flat_map(|area| &area.polygon.rings).flat_map(|ring| ring.windows(2));
        rings.map(|ends| size(minus(ends[1], ends[0]))).sum()
    };
    // Interior walls are split by the solid's edges.
    assert!(rims(&cut) >= length(&crossing, LineKind::Crossing) - 1e-9);
    for line in &crossing.lines {
        for point in &line.points {
            let midpoint = a.model.locate(*point).unwrap();
            assert!(midpoint != Location::Inside || a.model.signed_distance(*point).unwrap().abs() < 1e-9);
        }
    }
}

#[test]
fn threads_do_not_change_results_and_insufficient_memory_is_reported() {
    let mut random = Random(3);
    let mut faces = Vec::new();
    for x in 0..12 {
        for y in 0..12 {
            let [x, y] = [x * 40, y * 40];
            let mut at = |low: i32| low + random.below(20) as i32;
            let corners =
                [[x + at(0), y, 0], [x + 39, y + at(0), 9], [x, y + 39, at(5)], [x + 20, y + 20, at(300)]];
            faces.extend(tetrahedron(corners).unwrap());
        }
    }
    let a = Body::of(&faces, 9);
    let b = Body::of(&cuboid([7, 7, 13], [470, 470, 200]), 9);
    let first = found(&a, &b);
    assert!(first.lines.len() > 100);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(first, pool.install(|| found(&a, &b)));
    }
    let error = surface_intersection(&a.model, &b.model, 20_000, &()).unwrap_err().to_string();
    assert!(error.contains("--memory"), "{error}");
    let far = Body::of_list(&crate::common::exact::model_on(
        spinney::brep::Grid { step: 0.3, ..crate::common::sets::grid(7) },
        &cuboid([0; 3], [9; 3]),
    ));
    let error = surface_intersection(&a.model, &far.model, MEMORY, &()).unwrap_err().to_string();
    assert!(error.contains("grid"), "{error}");
}
