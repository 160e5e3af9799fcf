//! Repairs within little memory, compared with repairs in memory.

use super::regions::repair_in_regions;
use super::spool::FaceSpooler;
use super::*;
use crate::{ExactModel, Face, Grid};
use spinney_base::io::Output;
use spinney_container::Metadata;

type Triangle = [[i32; 3]; 3];

fn random(seed: u64) -> impl FnMut(i32) -> i32 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) as i32).rem_euclid(below)
    }
}

fn grid() -> Grid {
    Grid { bits: 26, origin: [0; 3], step: 1.0, divisor: 1.0 }
}

/// A closed surface in the shape of a box whose sides are divided into squares of two triangles.
/// Points are moved by `moved`.
fn crate_of(
    low: [i32; 3],
    sizes: [i32; 3],
    count: i32,
    moved: &dyn Fn([i32; 3]) -> [i32; 3],
) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        for (end, i, j) in (0..2).flat_map(|end| (0..count * count).map(move |n| (end, n / count, n % count)))
        {
            let at = |du: i32, dv: i32| {
                let mut point = low;
                point[axis] += end * sizes[axis];
                point[u] += (i + du) * sizes[u] / count;
                point[v] += (j + dv) * sizes[v] / count;
                moved(point)
            };
            let (a, b, c, d) = (at(0, 0), at(1, 0), at(1, 1), at(0, 1));
            let both = if end == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
            triangles.extend(both);
        }
    }
    triangles
}

fn turned(triangles: &mut [Triangle]) {
    triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
}

/// Outcome of a repair: its report, and the triangles in ascending order; or the error.
type Outcome = std::result::Result<(Repair, Vec<Vec<[i32; 3]>>, u64, f64), String>;

fn outcome(triangles: &[Triangle], rule: InsideRule, in_regions: bool) -> Outcome {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let memory = 256 << 20;
    let builder = ModelBuilder::new(Output::create(&path).unwrap(), grid(), memory).unwrap();
    let faces = triangles.iter().zip(0..).map(|(points, source)| Face {
        number: source,
        points,
        ring_ends: &[3],
        colours: &[],
        part: 0,
        source,
    });
    let made = if in_regions {
        let mut spooler = FaceSpooler::new(grid(), directory.path()).unwrap();
        faces.for_each(|face| spooler.push(&face, &[]).unwrap());
        repair_in_regions(&spooler.finish().unwrap(), rule, builder, Path::new("x"), memory, &())
    } else {
        let mut list = FaceList::new(grid(), Vec::new());
        faces.for_each(|face| list.push(&face));
        repair((list, false), rule, builder, Path::new("x"), memory, &())
    };
    let (builder, report) = made.map_err(|error| error.to_string())?;
    let exact = builder.has_exact_faces();
    let built = builder.finish(&mut Metadata::default(), &()).unwrap();
    if !exact && built.defect_count > 0 {
        return Err(format!("{} defects", built.defect_count));
    }
    let model = ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap();
    let mut faces = Vec::new();
    model
        .each(&mut |face| {
            let mut points = face.points.to_vec();
            let first = (0..points.len()).min_by_key(|index| points[*index]).unwrap();
            points.rotate_left(first);
            faces.push(points);
            Ok(())
        })
        .unwrap();
    faces.sort_unstable();
    let volume = faces.len() as f64 + model.volume_correction().unwrap();
    Ok((report, faces, model.exact_faces().0, volume))
}

/// Compares both repairs; returns whether they succeeded.
fn compare(triangles: &[Triangle], rule: InsideRule, name: &str) -> bool {
    match (outcome(triangles, rule, false), outcome(triangles, rule, true)) {
        (Ok(whole), Ok(regions)) => {
            assert_eq!(whole.1, regions.1, "{name}: faces");
            assert_eq!(whole.2, regions.2, "{name}: exact faces");
            // (Sums of numbers up to 10^13, whose rounding depends on the order of the faces.)
            assert!((whole.3 - regions.3).abs() < 1.0, "{name}: {} and {}", whole.3, regions.3);
            let (mut one, mut other) = (whole.0, regions.0);
            let near = |one: f64, other: f64| (one - other).abs() <= 1e-12 * one.abs();
            assert!(near(one.outside_share, other.outside_share), "{name}");
            assert!(near(one.volume, other.volume) && near(one.cells_volume, other.cells_volume), "{name}");
            for found in [&mut one, &mut other] {
                (found.outside_share, found.volume, found.cells_volume) = (0.0, 0.0, 0.0);
            }
            assert_eq!(one, other, "{name}");
            true
        }
        (whole, regions) => {
            assert_eq!(whole.err(), regions.err(), "{name}");
            false
        }
    }
}

/// Boxes with fine sides that intersect, touch, contain each other, are duplicated or inside out,
/// with faces that are doubled in both directions.
#[test]
fn regions_are_repaired_as_the_whole_surface() {
    let mut repaired = 0;
    for seed in 0..6 {
        let mut next = random(seed + 5);
        let mut all: Vec<Triangle> = Vec::new();
        for _ in 0..2 + next(4) {
            let low = [0; 3].map(|_| 10_000 + 100 * next(400));
            let sizes = [0; 3].map(|_| 4_000 + 400 * next(60));
            let skew = next(3);
            let moved = move |[x, y, z]: [i32; 3]| [x + skew * (z / 7), y + skew * (x / 5), z];
            let mut own = crate_of(low, sizes, 3 + next(4), &moved);
            if next(4) == 0 {
                turned(&mut own);
            }
            all.extend(&own);
            if next(5) == 0 {
                all.extend(&own);
            }
            // A face that is there in both directions once more, as closing a reversed face makes.
            let mut pair = [own[next(own.len() as i32) as usize]; 2];
            turned(&mut pair[1..]);
            all.extend(pair);
        }
        let rule = [InsideRule::Nonzero, InsideRule::Positive, InsideRule::Odd][seed as usize % 3];
        repaired += u32::from(compare(&all, rule, &format!("seed {seed}")));
    }
    assert!(repaired >= 4, "only {repaired} were repaired");
}

/// Nested shells: an inside-out shell is reversed with the cavity in it; a cavity that touches the
/// shell around it stays one.
#[test]
fn nested_shells_are_reversed_together() {
    let whole = |point| point;
    let shell = |low: i32, size: i32, is_turned: bool| {
        let mut made = crate_of([low; 3], [size; 3], 4, &whole);
        if is_turned {
            turned(&mut made);
        }
        made
    };
    let of =
        |outer: bool, inner: bool, at: i32| [shell(1000, 40_000, outer), shell(at, 12_000, inner)].concat();
    for (outer, inner) in [(false, true), (true, false), (true, true)] {
        assert!(compare(&of(outer, inner, 9000), InsideRule::Nonzero, &format!("{outer} {inner}")));
    }
    // (The inner one shares a vertex with the outer one.)
    assert!(compare(&of(true, false, 1000), InsideRule::Positive, "touching"));
    assert!(!compare(&shell(1000, 40_000, false)[3..3], InsideRule::Nonzero, "empty"));
}

/// Equal bodies are tested as one body: the number of pairs is linear. But each of them counts.
#[test]
fn equal_bodies_are_not_tested_in_pairs() {
    const COPIES: usize = 200;
    let body = |low: i32| crate_of([low; 3], [4000; 3], 1, &|point| point);
    let one = outcome(&body(1000), InsideRule::Nonzero, false).unwrap();
    let many = body(1000).repeat(COPIES);
    for in_regions in [false, true] {
        let made = outcome(&many, InsideRule::Positive, in_regions).unwrap();
        assert_eq!((&made.1, made.3), (&one.1, one.3));
        let extra = 12 * (COPIES as u64 - 1);
        assert_eq!((made.0.pairs, made.0.removed, made.0.outside), (extra, extra, 0));
        assert_eq!(made.0.volume_before, 4000f64.powi(3) * COPIES as f64);
    }
    // Twice one body and once another: by the rule `odd`, only the other one is inside.
    let larger = crate_of([3000; 3], [8000; 3], 1, &|point| point);
    let overlapping = [body(1000), larger, body(1000)].concat();
    assert!(compare(&overlapping, InsideRule::Odd, "two and one"));
    let (report, ..) = outcome(&overlapping, InsideRule::Odd, false).unwrap();
    assert_eq!(report.volume, 8000f64.powi(3));
    let even = outcome(&body(1000).repeat(2), InsideRule::Odd, false).unwrap_err();
    assert!(even.contains("nothing is inside"), "{even}");
    // Equal bodies that are inside out are reversed together.
    let mut inverted = body(1000).repeat(3);
    turned(&mut inverted);
    assert!(compare(&inverted, InsideRule::Positive, "inverted"));
}
