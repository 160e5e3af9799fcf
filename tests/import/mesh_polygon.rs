//! Faces against octants, and triangulation of faces: worked cases, and random ones against an
//! exact reference.

use std::collections::{BTreeMap, BTreeSet};

use spinney::raw::geometry::{Box3, Flaw, GridPolygon, Intersection, Stage, Stages, Triangulator};

use crate::common;

type Point = [i64; 3];

const OCTANT: Box3 = Box3 { min: [0; 3], max: [4; 3] };

fn polygon(rings: &[&[Point]]) -> GridPolygon {
    let (points, ends) = joined(rings);
    GridPolygon::new(&points, &ends, &mut Triangulator::new()).unwrap()
}

fn joined<R: AsRef<[Point]>>(rings: &[R]) -> (Vec<Point>, Vec<usize>) {
    let mut points = Vec::new();
    let ends = rings.iter().map(|ring| {
        points.extend_from_slice(ring.as_ref());
        points.len()
    });
    let ends = ends.collect();
    (points, ends)
}

/// Returns a ring in the plane z = `z`.
fn at<const N: usize>(z: i64, ring: [[i64; 2]; N]) -> [Point; N] {
    ring.map(|[x, y]| [x, y, z])
}

fn square(z: i64, min: i64, max: i64) -> [Point; 4] {
    at(z, [[min, min], [max, min], [max, max], [min, max]])
}

#[track_caller]
fn decides(rings: &[&[Point]], cuts: bool, stage: Stage) {
    let face = polygon(rings);
    assert_eq!(face.cuts(&OCTANT), Intersection { cuts, stage }, "{rings:?}");
    // The same face reversed, its rings rotated, in each of the 48 orientations of a cube.
    for turned in 0..48 {
        let turn = |p: &Point| {
            let order = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]][turned % 6];
            [0, 1, 2].map(|i| if (turned / 6) >> i & 1 == 1 { 4 - p[order[i]] } else { p[order[i]] })
        };
        let rings: Vec<Vec<Point>> = rings
            .iter()
            .map(|ring| {
                let mut ring: Vec<Point> = ring.iter().map(turn).collect();
                ring.reverse();
                ring.rotate_left(turned % 3);
                ring
            })
            .collect();
        let rings: Vec<&[Point]> = rings.iter().map(Vec::as_slice).collect();
        assert_eq!(polygon(&rings).cuts(&OCTANT), Intersection { cuts, stage }, "{rings:?}");
    }
}

#[test]
fn test_1_boxes() {
    decides(&[&square(5, 1, 3)], false, Stage::Boxes);
    decides(&[&square(2, 4, 8)], false, Stage::Boxes);
    // In a wall: the open octant has no point in common with the face's bounds.
    decides(&[&square(0, 1, 3)], false, Stage::Boxes);
    decides(&[&square(4, -9, 9)], false, Stage::Boxes);
}

#[test]
fn test_2_planes() {
    // Only a corner, (4) with one vertex of the section, only an edge, with two, and nothing (5).
    decides(&[&[[-4, 4, 0], [4, -4, 0], [-4, -4, 8]]], false, Stage::Planes);
    decides(&[&[[-3, 3, -1], [3, -3, -1], [3, -3, 5], [-3, 3, 5]]], false, Stage::Planes);
    decides(&[&[[-9, 8, 1], [8, -9, 1], [8, -9, 5], [-9, 8, 5]]], false, Stage::Planes);
}

#[test]
fn test_3_vertices() {
    // (1) all inside, inside and on walls, all on walls.
    decides(&[&square(2, 1, 3)], true, Stage::Vertices);
    decides(&[&at(2, [[0, 0], [3, 1], [1, 3]])], true, Stage::Vertices);
    decides(&[&square(2, 0, 4)], true, Stage::Vertices);
    decides(&[&[[0, 2, 2], [4, 2, 2], [2, 4, 2]]], true, Stage::Vertices);
    // All on walls, with a hole in between.
    decides(&[&square(2, 0, 4), &at(2, [[0, 0], [0, 4], [4, 4]])], true, Stage::Vertices);
    // (2) some outside.
    decides(&[&square(2, 1, 9)], true, Stage::Vertices);
    // A vertex of a hole.
    decides(&[&square(2, -9, 9), &at(2, [[2, 2], [2, 8], [8, 2]])], true, Stage::Vertices);
}

#[test]
fn test_4_section() {
    // (7) strictly inside.
    decides(&[&square(2, -9, 9)], true, Stage::Section);
    // Edges cross the section.
    decides(&[&at(2, [[-9, 1], [9, 1], [9, 3], [-9, 3]])], true, Stage::Section);
    decides(&[&at(2, [[-9, 3], [9, 3], [9, 9], [-9, 9]])], true, Stage::Section);
    // (8) the section's vertices are all on the face's boundary: the face around it, and a face
    // that is bent around it.
    decides(&[&at(2, [[0, 0], [4, 0], [9, 4], [4, 4], [0, 4]])], true, Stage::Section);
    let bent = at(2, [[0, 0], [0, 4], [4, 4], [4, 0], [9, 0], [9, 9], [-9, 9], [-9, 0]]);
    decides(&[&bent], false, Stage::Section);
    // (9) on the boundary and inside.
    decides(&[&at(2, [[0, 0], [9, 0], [9, 9], [0, 9]])], true, Stage::Section);
    // (10) on the boundary and outside, and all outside.
    decides(&[&at(2, [[4, -9], [9, -9], [9, 9], [4, 9]])], false, Stage::Boxes);
    decides(&[&at(2, [[-8, 4], [4, 4], [-8, 8], [-9, -9], [-7, 3]])], false, Stage::Section);
    decides(&[&at(2, [[-9, 7], [7, -9], [9, 9], [8, -8], [-8, 8]])], false, Stage::Section);
    // Only a corner of the section touches an edge.
    decides(&[&at(2, [[-4, 4], [4, -4], [-9, -9]])], false, Stage::Section);
}

#[test]
fn test_5_holes() {
    let face = square(2, -9, 9);
    let hole = |hole: &[[i64; 2]]| -> Vec<Point> { hole.iter().map(|&[x, y]| [x, y, 2]).collect() };
    let with = |holes: &[&[[i64; 2]]], cuts: bool| {
        let holes: Vec<Vec<Point>> = holes.iter().map(|ring| hole(ring)).collect();
        let mut rings: Vec<&[Point]> = vec![&face];
        rings.extend(holes.iter().map(Vec::as_slice));
        decides(&rings, cuts, Stage::Holes);
    };
    // (11) and (12): equal to the section.
    with(&[&[[0, 0], [0, 4], [4, 4], [4, 0]]], false);
    // (13): the section's vertices on the hole's boundary, the section inside it, and next to it.
    with(&[&[[0, 0], [0, 4], [1, 5], [4, 4], [5, 0]]], false);
    with(&[&[[0, 0], [0, 4], [4, 4], [4, 5], [-1, 5], [-1, 0]]], true);
    // (13): the hole within the section.
    with(&[&[[0, 0], [0, 4], [4, 4]]], true);
    // (14): the section in the hole.
    with(&[&[[0, 0], [0, 8], [8, 8], [8, 0]]], false);
    with(&[&[[-1, -1], [-1, 5], [5, 5], [5, -1]]], false);
    // (15) and (16): touching from outside.
    with(&[&[[4, 0], [4, 4], [8, 4], [8, 0]]], true);
    with(&[&[[4, 4], [4, 8], [8, 4]]], true);
    // (17): strictly outside; and the next hole decides.
    with(&[&[[5, 5], [5, 8], [8, 5]]], true);
    with(&[&[[5, 5], [5, 8], [8, 5]], &[[-1, -1], [-1, 5], [4, 4], [5, -1]]], false);
    with(&[&[[5, 5], [5, 8], [8, 5]], &[[-8, -8], [-8, -7], [-7, -8]]], true);
    // An edge crosses.
    with(&[&[[-1, -1], [-1, 5], [5, 5]]], true);
    // Holes that touch the face's boundary, which the paper considers impossible.
    with(&[&[[-9, 0], [0, 4], [0, 0]]], true);
    with(&[&[[-9, 0], [0, 4], [4, 4], [4, 0]]], false);
    with(&[&[[-9, 2], [-1, 6], [6, 6], [6, -1], [-1, -1]]], false);
    with(&[&[[-9, -9], [-9, 9], [9, 9], [9, -9]]], false);
}

/// Counts the vertices of a square section by their location in a convex counterclockwise face: the
/// paper's NPM, MPM and ZPM (inside, on the boundary, outside).
fn paper_counts(face: &[Point], section: [[i64; 2]; 4]) -> [usize; 3] {
    let mut counts = [0; 3];
    for [x, y] in section {
        let sides = (0..face.len()).map(|i| {
            let (a, b) = (face[i], face[(i + 1) % face.len()]);
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
        });
        let place = match sides.min().unwrap() {
            1.. => 0,
            0 => 1,
            _ => 2,
        };
        counts[place] += 1;
    }
    counts
}

/// The paper has no rule for the first face, and its rule (10) classifies the second one as
/// outside, though it covers half of the section. In neither case does an edge of the section
/// strictly cross an edge of the face: both times it passes through two of the face's vertices.
#[test]
fn faces_that_the_paper_gets_wrong() {
    let section = [[0, 0], [4, 0], [4, 4], [0, 4]];
    let undecided = at(2, [[-4, -4], [8, -4], [8, 8]]);
    assert_eq!(paper_counts(&undecided, section), [1, 2, 1], "no rule for inside and outside together");
    decides(&[&undecided], true, Stage::Section);

    let wrong = at(2, [[-4, -4], [-4, -8], [8, 4], [8, 8]]);
    let [inside, on_rim, outside] = paper_counts(&wrong, section);
    assert_eq!([inside, on_rim, outside], [0, 3, 1]);
    let rule_10_says_outside = inside == 0 && outside != 0;
    assert!(rule_10_says_outside);
    decides(&[&wrong], true, Stage::Section);
}

#[test]
fn concave_faces_go_round_octants() {
    let u = at(2, [[-9, -9], [9, -9], [9, 9], [4, 9], [4, 0], [0, 0], [0, 9], [-9, 9]]);
    decides(&[&u], false, Stage::Section);
    let one_unit_more = at(2, [[-9, -9], [9, -9], [9, 9], [4, 9], [4, 1], [0, 1], [0, 9], [-9, 9]]);
    decides(&[&one_unit_more], true, Stage::Section);
}

#[test]
fn slanted_planes() {
    // Through three corners, through two edges, and through six edges' midpoints; the boundary is
    // far outside.
    let around = |a: Point, b: Point, c: Point| [a, b, c];
    for face in [
        around([-20, 12, 12], [12, -20, 12], [12, 12, -20]),
        around([-20, -20, -20], [20, 20, -20], [0, 0, 40]),
        around([-20, 13, 13], [13, -20, 13], [13, 13, -20]),
    ] {
        decides(&[&face], true, Stage::Section);
    }
}

#[test]
fn a_bent_face_is_its_triangles() {
    let bent = [[-9, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 3]];
    let face = polygon(&[&bent]);
    assert!(!face.is_planar());
    assert_eq!(face.cuts(&OCTANT), Intersection { cuts: true, stage: Stage::Triangles });
    assert!(!face.cuts(&Box3 { min: [4, -5, 2], max: [5, -4, 3] }).cuts);
    assert!(face.cuts(&Box3 { min: [-9, 8, 2], max: [-8, 9, 3] }).cuts);
    assert_eq!(face.bounds(), Box3 { min: [-9, -9, 2], max: [9, 9, 3] });
}

#[test]
fn flaws() {
    let new = |ring: &[Point]| GridPolygon::new(ring, &[ring.len()], &mut Triangulator::new()).map(|_| ());
    assert_eq!(new(&[[0, 0, 0], [1, 1, 1], [2, 2, 2], [1, 1, 1]]), Err(Flaw::NoArea));
    assert_eq!(new(&at(0, [[0, 0], [4, 4], [4, 0], [0, 4]])), Err(Flaw::NoArea));
    assert_eq!(new(&[[0, 0, 0], [6, 6, 0], [6, 0, 0], [0, 4, 1]]), Err(Flaw::NotSimple));
}

#[test]
fn verdicts_are_counted() {
    let mut stages = Stages::default();
    stages.count(polygon(&[&square(2, 1, 3)]).cuts(&OCTANT));
    stages.count(polygon(&[&square(5, 1, 3)]).cuts(&OCTANT));
    let twice = stages;
    stages.add(&twice);
    assert_eq!(stages, Stages { disjoint: [2, 0, 0, 0, 0, 0], cutting: [0, 0, 2, 0, 0, 0] });
}

/// Returns whether a convex face cuts an octant: the face clipped to the octant is not within a
/// wall. Exact, in homogeneous coordinates.
fn convex_cuts(points: &[Point], octant: &Box3) -> bool {
    let mut face: Vec<[i128; 4]> =
        points.iter().map(|p| [p[0].into(), p[1].into(), p[2].into(), 1]).collect();
    let walls: Vec<_> = (0..3)
        .flat_map(|i| [(i, 1, i128::from(octant.min[i])), (i, -1, i128::from(octant.max[i]))])
        .collect();
    let height = |p: &[i128; 4], (axis, sign, at): (usize, i128, i128)| sign * (p[axis] - at * p[3]);
    for &wall in &walls {
        let mut kept = Vec::new();
        for (i, p) in face.iter().enumerate() {
            let q = &face[(i + 1) % face.len()];
            let (hp, hq) = (height(p, wall), height(q, wall));
            if hp >= 0 {
                kept.push(*p);
            }
            if hp.signum() * hq.signum() < 0 {
                let cut = [0, 1, 2, 3].map(|i| hp.abs() * q[i] + hq.abs() * p[i]);
                let divisor = cut.iter().fold(0, |a, &b| gcd(a, b));
                kept.push(cut.map(|x| x / divisor));
            }
        }
        face = kept;
    }
    walls.iter().all(|&wall| face.iter().any(|p| height(p, wall) > 0))
}

fn gcd(a: i128, b: i128) -> i128 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}

struct Random(common::Random);

impl Random {
    fn below(&mut self, below: i64) -> i64 {
        self.0.below(below as u64) as i64
    }

    fn within(&mut self, range: i64) -> i64 {
        self.below(2 * range + 1) - range
    }

    fn vector(&mut self, range: i64) -> Point {
        [self.within(range), self.within(range), self.within(range)]
    }
}

fn octant_at(random: &mut Random, near: Point) -> Box3 {
    let side = 1 << random.below(4);
    let min = near.map(|x| (x + random.within(1)).div_euclid(side) * side);
    Box3 { min, max: min.map(|x| x + side) }
}

/// A random connected set of cells: concave, with holes that touch its boundary and one another in
/// corners.
fn cells(random: &mut Random) -> BTreeSet<[i64; 2]> {
    let side = 3 + random.below(5);
    let mut set = BTreeSet::from([[0, 0]]);
    for _ in 0..side * side * 2 {
        let cell = [random.below(side), random.below(side)];
        let mut around =
            [[0, 1], [1, 0], [0, -1], [-1, 0]].map(|d| [cell[0] + d[0], cell[1] + d[1]]).into_iter();
        if around.any(|neighbour| set.contains(&neighbour)) {
            set.insert(cell);
        }
    }
    set
}

/// Returns the rings of a set of cells, inside on their left, the outer one first. With `merged`,
/// rings that touch become one. Collinear vertices are kept or removed.
fn rings(cells: &BTreeSet<[i64; 2]>, merged: bool, keep_straight: bool) -> Vec<Vec<[i64; 2]>> {
    let mut edges: BTreeMap<[i64; 2], Vec<[i64; 2]>> = BTreeMap::new();
    for &[x, y] in cells {
        for (d, from, to) in [
            ([0, -1], [x, y], [x + 1, y]),
            ([1, 0], [x + 1, y], [x + 1, y + 1]),
            ([0, 1], [x + 1, y + 1], [x, y + 1]),
            ([-1, 0], [x, y + 1], [x, y]),
        ] {
            if !cells.contains(&[x + d[0], y + d[1]]) {
                edges.entry(from).or_default().push(to);
            }
        }
    }
    let turn =
        |a: [i64; 2], b: [i64; 2], c: [i64; 2]| (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
    let mut found = Vec::new();
    while let Some((&start, _)) = edges.iter().find(|(_, to)| to.len() == 1) {
        let mut ring = vec![start];
        let mut to = edges.remove(&start).unwrap()[0];
        while to != start {
            let from = *ring.last().unwrap();
            ring.push(to);
            let ways = edges.get_mut(&to).unwrap();
            let left = ways.iter().position(|&next| turn(from, to, next) > 0).unwrap_or(0);
            let next = ways.remove(if ways.len() == 2 && merged { 1 - left } else { left });
            if ways.is_empty() {
                edges.remove(&to);
            }
            to = next;
        }
        found.push(ring);
    }
    assert!(edges.is_empty());
    for ring in &mut found {
        let all = ring.clone();
        let corner = |i: usize| turn(all[(i + all.len() - 1) % all.len()], all[i], all[(i + 1) % all.len()]);
        if !keep_straight {
            *ring = (0..all.len()).filter(|&i| corner(i) != 0).map(|i| all[i]).collect();
        }
    }
    found.sort_by_key(|ring| -area(ring));
    assert!(area(&found[0]) > 0 && found[1..].iter().all(|ring| area(ring) < 0));
    found
}

fn area(ring: &[[i64; 2]]) -> i64 {
    (0..ring.len())
        .map(|i| (ring[i], ring[(i + 1) % ring.len()]))
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum()
}

/// Returns the edges used more often in one direction than in the other, by their end points.
fn outline(loops: impl Iterator<Item = Vec<Point>>) -> BTreeMap<[Point; 2], i64> {
    let mut edges = BTreeMap::new();
    for ring in loops {
        for i in 0..ring.len() {
            let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += if a < b { 1 } else { -1 };
        }
    }
    edges.retain(|[a, b], times| *times != 0 && a != b);
    edges
}

fn doubled_area(ring: &[Point]) -> [i128; 3] {
    let mut sum = [0; 3];
    for i in 0..ring.len() {
        let [a, b] = [ring[i], ring[(i + 1) % ring.len()]].map(|p| p.map(i128::from));
        for (axis, part) in sum.iter_mut().enumerate() {
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            *part += a[j] * b[k] - a[k] * b[j];
        }
    }
    sum
}

/// Triangulates, and checks that all triangles have the face's orientation, and together its area
/// and edges.
#[track_caller]
fn triangles(rings: &[Vec<Point>]) -> Vec<[Point; 3]> {
    let (points, ends) = joined(rings);
    let mut out = vec![[7; 3]];
    assert!(Triangulator::new().triangulate(&points, &ends, &mut out), "{rings:?}");
    assert_eq!(out.remove(0), [7; 3], "what was there stays");
    let triangles: Vec<[Point; 3]> = out.iter().map(|t| t.map(|corner| points[corner as usize])).collect();
    let add = |a: [i128; 3], b: [i128; 3]| [0, 1, 2].map(|i| a[i] + b[i]);
    let areas = triangles.iter().map(|triangle| doubled_area(triangle));
    let normal = rings.iter().map(|ring| doubled_area(ring)).fold([0; 3], add);
    assert_eq!(areas.clone().fold([0; 3], add), normal, "{rings:?}");
    let axis = (0..3).max_by_key(|&axis| normal[axis].abs()).unwrap();
    assert!(areas.clone().all(|area| area[axis] * normal[axis].signum() >= 0), "{rings:?}");
    assert_eq!(
        outline(triangles.iter().map(|t| t.to_vec())),
        outline(rings.iter().cloned()),
        "{rings:?} {triangles:?}"
    );
    triangles
}

/// Cells in a random plane, their triangles, and random octants: the reference tests each cell
/// separately.
#[test]
fn random_faces_agree_with_their_cells() {
    let mut random = Random(common::Random(7));
    let mut stages = Stages::default();
    for round in 0..600 {
        let cells = cells(&mut random);
        let flat = rings(&cells, round % 2 == 0, round % 3 == 0);
        let (origin, scale) = (random.vector(6), 1 + random.below(8));
        let (mut u, mut v) = (random.vector(2), random.vector(2));
        while doubled_area(&[[0; 3], u, v]) == [0; 3] {
            (u, v) = (random.vector(2), random.vector(2));
        }
        let place = |[x, y]: [i64; 2]| [0, 1, 2].map(|i| origin[i] + scale * (x * u[i] + y * v[i]));
        let rings: Vec<Vec<Point>> =
            flat.iter().map(|ring| ring.iter().map(|&corner| place(corner)).collect()).collect();
        triangles(&rings);
        let (points, ends) = joined(&rings);
        let face = GridPolygon::new(&points, &ends, &mut Triangulator::new()).unwrap();
        assert!(face.is_planar());
        for _ in 0..20 {
            // The cells lie within eight by eight.
            let (x, y) = (random.below(8 * scale), random.below(8 * scale));
            let near = [0, 1, 2].map(|i| origin[i] + x * u[i] + y * v[i]);
            let octant = octant_at(&mut random, near);
            let expected = cells.iter().any(|&[x, y]| {
                convex_cuts(&[[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(place), &octant)
            });
            let verdict = face.cuts(&octant);
            assert_eq!(verdict.cuts, expected, "{rings:?} {octant:?} {verdict:?}");
            stages.count(verdict);
        }
    }
    assert!(stages.disjoint[..5].iter().enumerate().all(|(i, &times)| times > 0 || i == 2), "{stages:?}");
    assert!(stages.cutting[2..5].iter().all(|&times| times > 40), "{stages:?}");
}

/// Snapped vertices are not exactly coplanar: triangles still have all edges, and define the face.
#[test]
fn bent_faces_agree_with_their_triangles() {
    let mut random = Random(common::Random(8));
    for round in 0..100 {
        let cells = cells(&mut random);
        let bend: BTreeMap<[i64; 2], i64> = (0..100).map(|i| ([i % 10, i / 10], random.within(1))).collect();
        let place = |&[x, y]: &[i64; 2]| [4 * x, 4 * y + x, 2 * x + y + bend[&[x, y]]];
        let rings: Vec<Vec<Point>> =
            rings(&cells, round % 2 == 0, true).iter().map(|ring| ring.iter().map(place).collect()).collect();
        let triangles = triangles(&rings);
        let (points, ends) = joined(&rings);
        let face = GridPolygon::new(&points, &ends, &mut Triangulator::new()).unwrap();
        for _ in 0..6 {
            let near = points[random.below(points.len() as i64) as usize];
            let octant = octant_at(&mut random, near);
            let expected = triangles.iter().any(|triangle| convex_cuts(triangle, &octant));
            assert_eq!(face.cuts(&octant).cuts, expected, "{rings:?} {octant:?}");
        }
    }
}

/// Parses nested lists of numbers as rings of points.
fn read_rings(text: &str) -> Vec<Vec<[f64; 2]>> {
    let (mut rings, mut numbers, mut depth) = (Vec::new(), Vec::new(), 0);
    for part in text.split_inclusive(['[', ']', ',']) {
        let (number, mark) = part.split_at(part.len() - 1);
        if let Ok(number) = number.trim().parse::<f64>() {
            numbers.push(number);
        }
        depth += i32::from(mark == "[") - i32::from(mark == "]");
        if mark == "]" && depth == 1 {
            rings.push(numbers.chunks_exact(2).map(|xy| [xy[0], xy[1]]).collect());
            numbers.clear();
        }
    }
    rings
}

/// Polygons collected as failures of a triangulation program, snapped to the grid in a slanted
/// plane: valid ones are triangulated, and octants cut them like their triangles.
#[test]
fn collected_polygons() {
    let Some(directory) = common::shared_data() else { return };
    let mut files: Vec<_> = std::fs::read_dir(directory.join("poly2d/earcut"))
        .unwrap()
        .map(|file| file.unwrap().path())
        .collect();
    files.sort();
    let mut random = Random(common::Random(9));
    let mut failed = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        if text.len() > 20_000 {
            continue; // checking takes long there
        }
        let flat = read_rings(&text);
        let place = |[x, y]: [i64; 2]| [3 * x + y, 2 * y - x, x + y - 7];
        let snap = |[x, y]: &[f64; 2]| [(x * 8.0).round() as i64, (y * 8.0).round() as i64];
        let mut rings: Vec<Vec<Point>> = Vec::new();
        for ring in &flat {
            let mut ring: Vec<[i64; 2]> = ring.iter().map(snap).collect();
            if (area(&ring) > 0) != rings.is_empty() {
                ring.reverse();
            }
            rings.push(ring.into_iter().map(place).collect());
        }
        let (points, ends) = joined(&rings);
        if !Triangulator::new().triangulate(&points, &ends, &mut Vec::new()) {
            failed.push(file.file_stem().unwrap().to_str().unwrap().to_owned());
            continue;
        }
        let triangles = triangles(&rings);
        let face = GridPolygon::new(&points, &ends, &mut Triangulator::new()).unwrap();
        let size = face.bounds().max[0] - face.bounds().min[0];
        for _ in 0..10 {
            let near = points[random.below(points.len() as i64) as usize];
            let side = 1 + random.below(size / 8 + 2);
            let min = near.map(|x| x + random.within(size / 4) - side / 2);
            let octant = Box3 { min, max: min.map(|x| x + side) };
            let expected = triangles.iter().any(|triangle| convex_cuts(triangle, &octant));
            assert_eq!(face.cuts(&octant).cuts, expected, "{file:?} {octant:?}");
        }
    }
    // Rings that cross or enclose nothing; collinear overlaps are accepted.
    assert_eq!(failed, ["bad-hole", "degenerate", "issue107", "issue142"]);
}
