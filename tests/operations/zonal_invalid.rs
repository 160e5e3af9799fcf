//! Statistics of zones whose rings cross, overlap and touch, against an independent definition:
//! rings of a part combined even-odd, parts united.

use spinney::query::{EdgeRule, Polygon, ZonalRequest, ZoneStatistics};
use spinney::raw::store::Packing;
use spinney::{DataKind, Dataset, Output, Rule, SampleType, WriteOptions, convert};

use crate::common::{Cells, Random, options, quad, write_cells};

type Point = [f64; 2];
type Parts = Vec<Vec<Vec<Point>>>;

const SIZE: [u64; 3] = [44, 37, 1];

/// Parts with few vertices, many of them on a grid of half cells, so that all kinds of contacts are
/// frequent; some extend beyond the raster.
fn parts(random: &mut Random) -> Parts {
    let on_grid = random.below(2) == 0;
    let (size, origin) = (4 + random.below(50), random.below(30) as f64 - 8.0);
    let at = |random: &mut Random| match on_grid {
        true => random.below(2 * size) as f64 / 2.0 + origin,
        // Multiples of 2^-16: sums and products in the definition below are then exact.
        false => random.below(size << 16) as f64 / 65536.0 + origin,
    };
    let ring = |random: &mut Random| -> Vec<Point> {
        if random.below(3) == 0 {
            let ([x, y], [w, h]) =
                ([at(random), at(random)], [1 + random.below(size), 1 + random.below(size)]);
            let (w, h) = (w as f64, h as f64);
            return vec![[x, y], [x + w, y], [x + w, y + h], [x, y + h]];
        }
        (0..3 + random.below(4)).map(|_| [at(random), at(random)]).collect()
    };
    (0..1 + random.below(3)).map(|_| (0..1 + random.below(2)).map(|_| ring(random)).collect()).collect()
}

fn edges(rings: &[Vec<Point>]) -> impl Iterator<Item = [Point; 2]> + '_ {
    rings
        .iter()
        .flat_map(|ring| ring.iter().copied().zip(ring.iter().copied().cycle().skip(1)))
        .map(|(a, b)| [a, b])
}

/// Returns whether a point is in some part.
fn has(parts: &Parts, [x, y]: Point) -> bool {
    parts.iter().any(|rings| {
        let crossed = edges(rings).filter(|[a, b]| {
            let (a, b) = if a[1] <= b[1] { (a, b) } else { (b, a) };
            let left = (y - a[1]) * (b[0] - a[0]) - (x - a[0]) * (b[1] - a[1]);
            (a[1] > y) != (b[1] > y) && left > 0.0
        });
        crossed.count() % 2 == 1
    })
}

/// Returns each cell's area that is in some part: between consecutive y at which edges begin, end
/// or cross, it consists of trapezoids.
fn areas(parts: &Parts) -> Vec<f64> {
    let (columns, rows) = (SIZE[0] as usize, SIZE[1] as usize);
    let mut areas = vec![0.0; columns * rows];
    let all: Vec<[Point; 2]> = parts.iter().flat_map(|rings| edges(rings)).collect();
    let mut levels: Vec<f64> = (0..=rows).map(|row| row as f64).collect();
    levels.extend(all.iter().map(|[a, _]| a[1]));
    for (index, [a, b]) in all.iter().enumerate() {
        for [c, d] in &all[..index] {
            let cross = |u: Point, v: Point| u[0] * v[1] - u[1] * v[0];
            let (u, v, w) =
                ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]], [c[0] - a[0], c[1] - a[1]]);
            let across = cross(u, v);
            if across != 0.0 {
                let (along, other) = (cross(w, v) / across, cross(w, u) / across);
                if (0.0..=1.0).contains(&along) && (0.0..=1.0).contains(&other) {
                    levels.push(a[1] + along * u[1]);
                }
            }
        }
    }
    levels.retain(|level| (0.0..=rows as f64).contains(level));
    levels.sort_by(f64::total_cmp);
    for pair in levels.windows(2) {
        let ([low, high], middle) = ([pair[0], pair[1]], (pair[0] + pair[1]) / 2.0);
        if low == high {
            continue;
        }
        // Edges from left to right, each with its part.
        let mut met: Vec<(f64, [f64; 2], usize)> = Vec::new();
        for (part, rings) in parts.iter().enumerate() {
            for [a, b] in edges(rings) {
                if (a[1] > middle) != (b[1] > middle) {
                    let at = |y: f64| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                    met.push((at(middle), [at(low), at(high)], part));
                }
            }
        }
        met.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut inside = vec![false; parts.len()];
        let row = middle.floor() as usize;
        let mut add = |[one, other]: [f64; 2], sign: f64| {
            // The area to the left of an edge, in each column.
            let (min, max) = (one.min(other), one.max(other));
            for column in 0..columns {
                let (left, right) = (column as f64, column as f64 + 1.0);
                let mean = if max <= left {
                    0.0
                } else if min >= right {
                    1.0
                } else if max - min < 1e-13 {
                    (min - left).clamp(0.0, 1.0)
                } else {
                    let (from, to) = (min.max(left), max.min(right));
                    ((to - from) * ((from + to) / 2.0 - left) + (max - right).max(0.0)) / (max - min)
                };
                areas[row * columns + column] += sign * mean * (high - low);
            }
        };
        for (_, ends, part) in met {
            let before = inside.iter().any(|is_in| *is_in);
            inside[part] ^= true;
            let after = inside.iter().any(|is_in| *is_in);
            match (before, after) {
                (false, true) => add(ends, -1.0),
                (true, false) => add(ends, 1.0),
                _ => {}
            }
        }
    }
    areas
}

/// Returns the same content stored in all ways.
fn stored(
    directory: &std::path::Path,
    name: &str,
    cells: &Cells,
    (rule, kind): (Rule, DataKind),
) -> Vec<Dataset> {
    let path = |extension: &str| directory.join(format!("{name}.{extension}"));
    let (plain, packed, autumnal) = (path("goblin"), path("packed.goblin"), path("autumn"));
    write_cells(&plain, cells, &options(rule, kind, cells.depth()));
    for (to, packing) in [(&packed, Packing::packed()), (&autumnal, Packing::default())] {
        let options = WriteOptions::new(1 << 24).packing(packing);
        convert(&plain, false, Output::create(to).unwrap(), options, &()).unwrap();
    }
    let mut files: Vec<Dataset> =
        [&plain, &packed, &autumnal].into_iter().map(|path| spinney::open(path).unwrap()).collect();
    files.push(spinney::open(&plain).unwrap().view(&["translate=0,0".parse().unwrap()]).unwrap());
    files
}

fn near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-9 * (1.0 + expected.abs()), "{what}: {found}, not {expected}");
}

#[test]
fn zones_that_overlap_and_cross_themselves_are_the_same_in_all_files() {
    let directory = tempfile::tempdir().unwrap();
    let form = quad(SampleType::I16, 1);
    let (means, classes) = ((Rule::Mean, DataKind::Continuous), (Rule::Majority, DataKind::Categorical));
    let mut contents = Vec::new();
    let mut add = |name: &str, cells: Cells, how: (Rule, DataKind)| {
        let files = stored(directory.path(), name, &cells, how);
        contents.push((name.to_string(), cells, files));
    };
    let noise = Cells::noise(form, 1, SIZE, 250);
    let full = |value: &dyn Fn(u64, u64) -> u64| {
        let cells = (0..SIZE[0] * SIZE[1]).map(|at| {
            let number = value(at % SIZE[0], at / SIZE[0]);
            Some(form.value.nearest(|_| number as f64))
        });
        Cells { form, size: SIZE, cells: cells.collect() }
    };
    add("uniform", full(&|_, _| 7), means);
    add("noise", full(&|x, y| Random(x * 1000 + y).next() % 250), means);
    add("blocks", full(&|x, y| (x / 16 + 5 * (y / 16)) * 11), means);
    add("void", noise, means);
    add("classes", Cells::random(form, 4, SIZE, 6, true), classes);

    let mut random = Random(62);
    let zones: Vec<Parts> = (0..COUNT).map(|_| parts(&mut random)).collect();
    let polygons: Vec<Polygon> = zones.iter().map(|parts| Polygon::of_parts(parts).unwrap()).collect();
    let invalid = polygons.iter().filter(|polygon| polygon.was_invalid()).count();
    assert!(invalid > COUNT / 2 && invalid < COUNT);
    let by_area: Vec<Vec<f64>> = zones.iter().map(areas).collect();
    for edge in EdgeRule::ALL {
        let request = ZonalRequest { edge, ..ZonalRequest::default() };
        let found: Vec<Vec<Vec<ZoneStatistics>>> = contents
            .iter()
            .map(|(_, _, files)| {
                files.iter().map(|file| file.zonal(&polygons, &request, &()).unwrap()).collect()
            })
            .collect();
        for (number, parts) in zones.iter().enumerate() {
            let what = format!("{edge:?} {number} {parts:?}");
            for ((_, cells, _), found) in contents.iter().zip(&found) {
                // All storages give bit-identical results.
                let first = &found[0][number];
                let text = format!("{first:?}");
                for other in &found[1..] {
                    assert_eq!(text, format!("{:?}", other[number]), "{what}");
                }
                if edge == EdgeRule::Touch {
                    continue;
                }
                let (mut count, mut void, mut sum) = (0.0, 0.0, 0.0);
                for (at, value) in cells.cells.iter().enumerate() {
                    let (x, y) = (at as u64 % SIZE[0], at as u64 / SIZE[0]);
                    let weight = match edge {
                        EdgeRule::Area => by_area[number][at],
                        _ => f64::from(u8::from(has(parts, [x as f64 + 0.5, y as f64 + 0.5]))),
                    };
                    match value {
                        Some(value) => {
                            count += weight;
                            sum += weight * form.value.numbers(*value)[0].to_f64();
                        }
                        None => void += weight,
                    }
                }
                near(first.cells, count, &what);
                near(first.void_cells, void, &what);
                near(first.channels.first().map_or(0.0, |channel| channel.sum), sum, &what);
            }
            // Without VOID cells, counts depend only on the polygon.
            let counts =
                |content: usize| (found[content][0][number].cells, found[content][0][number].outside_cells);
            assert!(counts(0) == counts(1) && counts(1) == counts(2), "{what}");
        }
    }
}

/// Number of polygons.
const COUNT: usize = 400;
