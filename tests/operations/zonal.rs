//! Statistics of the cells in polygons, against brute force over all cells.

use std::collections::BTreeMap;

use spinney::query::{EdgeRule, Polygon, ZonalRequest, ZoneMeasure, ZoneStatistics};
use spinney::raw::query::{ZoneChannel, ZoneValues};
use spinney::{DataKind, Dataset, Number, Output, Rule, SampleType, TreeType, WriteOptions, convert};

use crate::common::{Cells, OCT, QUAD, Random, dataset, options, quad, value_types, write_cells};

/// Returns a ring around a point; vertices may be at cell centres and corners.
fn ring(random: &mut Random, [x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let count = 3 + random.below(12);
    let is_half = random.below(3) == 0;
    let corner = |i: u64| {
        let angle = i as f64 / count as f64 * std::f64::consts::TAU;
        let away = radius * (1.0 + random.below(100) as f64 / 300.0);
        let corner = [x + away * angle.cos(), y + away * angle.sin()];
        if is_half { corner.map(|at| (at * 2.0).round() / 2.0) } else { corner }
    };
    (0..count).map(corner).collect()
}

/// Returns disjoint parts, some with a hole, some outside of the raster.
fn parts(random: &mut Random, size: [u64; 3]) -> Vec<Vec<Vec<[f64; 2]>>> {
    let count = 1 + random.below(2);
    (0..count)
        .map(|part| {
            // Each in its own strip, so that they do not overlap.
            let strip = size[0] as f64 / count as f64;
            let radius = (strip / 3.0).min(size[1] as f64) * (random.below(90) + 10) as f64 / 100.0;
            let middle = [strip * (part as f64 + 0.5), random.below(size[1] + 8) as f64];
            let mut rings = vec![ring(random, middle, radius)];
            if random.below(2) == 0 {
                rings.push(ring(random, middle, radius * 0.3));
            }
            rings
        })
        .collect()
}

/// Returns whether a point is inside, by the definition.
fn has(parts: &[Vec<Vec<[f64; 2]>>], [x, y]: [f64; 2]) -> bool {
    let rings = parts.iter().flatten();
    let edges = rings.flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
    let crosses = edges
        .filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    crosses.count() % 2 == 1
}

/// Returns the area of parts in a box, by clipping rings to its sides; rings of a part after the
/// first are holes.
fn area(parts: &[Vec<Vec<[f64; 2]>>], low: [f64; 2], high: [f64; 2]) -> f64 {
    let clipped = |ring: &Vec<[f64; 2]>| {
        let mut ring = ring.clone();
        for (axis, limit, is_high) in
            [(0, low[0], false), (0, high[0], true), (1, low[1], false), (1, high[1], true)]
        {
            let inside = |at: &[f64; 2]| if is_high { at[axis] <= limit } else { at[axis] >= limit };
            let mut kept = Vec::new();
            for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                if inside(a) {
                    kept.push(*a);
                }
                if inside(a) != inside(b) {
                    let share = (limit - a[axis]) / (b[axis] - a[axis]);
                    let mut at = [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]));
                    at[axis] = limit;
                    kept.push(at);
                }
            }
            ring = kept;
        }
        let ends = ring.iter().zip(ring.iter().cycle().skip(1));
        ends.map(|(a, b)| (a[0] - low[0]) * (b[1] - low[1]) - (b[0] - low[0]) * (a[1] - low[1]))
            .sum::<f64>()
            .abs()
            / 2.0
    };
    parts.iter().map(|part| clipped(&part[0]) - part[1..].iter().map(clipped).sum::<f64>()).sum()
}

/// Returns whether an edge passes through the interior of a cell: a line clipped to its four sides.
fn is_cut(parts: &[Vec<Vec<[f64; 2]>>], cell: [f64; 2]) -> bool {
    let rings = parts.iter().flatten();
    let mut edges = rings.flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
    edges.any(|(a, b)| {
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for axis in 0..2 {
            let (start, along) = (a[axis] - cell[axis], b[axis] - a[axis]);
            if along == 0.0 {
                if start <= 0.0 || start >= 1.0 {
                    return false;
                }
            } else {
                let ends = [-start / along, (1.0 - start) / along];
                (from, to) = (from.max(ends[0].min(ends[1])), to.min(ends[0].max(ends[1])));
            }
        }
        from < to
    })
}

/// Computes statistics by visiting every cell.
fn expected(
    cells: &Cells,
    size: [u64; 3],
    counts_classes: bool,
    weight: &dyn Fn([u64; 3]) -> f64,
) -> ZoneStatistics {
    let value_type = cells.form.value;
    let mut zone = ZoneStatistics::default();
    let mut classes: BTreeMap<Number, f64> = BTreeMap::new();
    let mut samples: Vec<Vec<(f64, Number)>> = vec![Vec::new(); usize::from(value_type.channels)];
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let weight = weight([x, y, z]);
                if weight == 0.0 {
                    continue;
                }
                let Some(value) = cells.get([x, y, z]) else {
                    zone.void_cells += weight;
                    continue;
                };
                zone.cells += weight;
                for (channel, sample) in samples.iter_mut().zip(value_type.numbers(value).iter()) {
                    channel.push((weight, *sample));
                }
                *classes.entry(value_type.first_number(value)).or_default() += weight;
            }
        }
    }
    if counts_classes && value_type.channels == 1 {
        zone.classes = classes.into_iter().collect();
    }
    for samples in samples.iter_mut().filter(|samples| !samples.is_empty()) {
        let weight: f64 = samples.iter().map(|(weight, _)| weight).sum();
        let mean = samples.iter().map(|(weight, sample)| weight * sample.to_f64()).sum::<f64>() / weight;
        let squares =
            samples.iter().map(|(weight, sample)| weight * (sample.to_f64() - mean).powi(2)).sum::<f64>();
        zone.channels.push(ZoneChannel {
            cells: weight,
            sum: mean * weight,
            values: Some(values_of(samples)),
            min: samples.iter().map(|(_, sample)| *sample).min().unwrap(),
            max: samples.iter().map(|(_, sample)| *sample).max().unwrap(),
            mean,
            standard_deviation: (squares / weight).sqrt(),
        });
    }
    zone
}

/// The requested quantiles, unordered.
const QUANTILES: [f64; 5] = [0.9, 0.0, 0.25, 1.0, 0.123];

fn request(edge: EdgeRule) -> ZonalRequest {
    ZonalRequest {
        edge,
        measures: vec![ZoneMeasure::Variety],
        quantiles: QUANTILES.to_vec(),
        ..ZonalRequest::default()
    }
}

/// Returns the statistics of weighted samples, by the definitions.
fn values_of(samples: &mut [(f64, Number)]) -> ZoneValues {
    samples.sort_by_key(|(_, sample)| *sample);
    let mut counts: Vec<(Number, f64)> = Vec::new();
    for (weight, sample) in samples.iter() {
        match counts.last_mut() {
            Some((last, cells)) if last == sample => *cells += weight,
            _ => counts.push((*sample, *weight)),
        }
    }
    let first = |better: &dyn Fn(f64, f64) -> bool| -> Number {
        let best =
            counts.iter().map(|(_, cells)| *cells).reduce(|a, b| if better(b, a) { b } else { a }).unwrap();
        // Sums that differ by rounding are tied.
        counts.iter().find(|(_, cells)| (cells - best).abs() < 1e-9).unwrap().0
    };
    let all: f64 = samples.iter().map(|(weight, _)| weight).sum();
    // The integral of the samples laid out consecutively, each as long as its weight.
    let sum_before = |rank: f64| {
        let (mut sum, mut at) = (0.0, 0.0);
        for (weight, sample) in samples.iter() {
            sum += sample.to_f64() * weight.min((rank - at).max(0.0));
            at += weight;
        }
        sum
    };
    let quantile = |quantile: f64| {
        let (length, from) = (all.min(1.0), (quantile * (all - 1.0)).max(0.0));
        (sum_before(from + length) - sum_before(from)) / length
    };
    ZoneValues {
        variety: counts.len() as u64,
        majority: first(&|a, b| a > b + 1e-9),
        minority: first(&|a, b| a < b - 1e-9),
        median: quantile(0.5),
        quantiles: QUANTILES.map(quantile).to_vec(),
    }
}

fn assert_values_alike(found: &ZoneValues, expected: &ZoneValues, what: &str) {
    let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-6 * (1.0 + b.abs());
    let all = |values: &ZoneValues| [&values.quantiles[..], &[values.median]].concat();
    assert_eq!(
        (found.variety, found.majority, found.minority),
        (expected.variety, expected.majority, expected.minority),
        "{what}"
    );
    assert!(all(found).iter().zip(&all(expected)).all(near), "{what}: {found:?}, not {expected:?}");
}

fn assert_alike(found: &ZoneStatistics, expected: &ZoneStatistics, what: &str) {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * (1.0 + a.abs().max(b.abs()));
    assert!(near(found.cells, expected.cells), "{what}: {found:?}, not {expected:?}");
    assert!(near(found.void_cells, expected.void_cells), "{what}: {found:?}, not {expected:?}");
    assert!(near(found.outside_cells, expected.outside_cells), "{what}: {found:?}, not {expected:?}");
    assert_eq!(found.channels.len(), expected.channels.len(), "{what}");
    for (found, expected) in found.channels.iter().zip(&expected.channels) {
        for (a, b) in [
            (found.cells, expected.cells),
            (found.min.to_f64(), expected.min.to_f64()),
            (found.max.to_f64(), expected.max.to_f64()),
            (found.mean, expected.mean),
            (found.sum, expected.sum),
        ] {
            assert!(near(a, b), "{what}: {found:?}, not {expected:?}");
        }
        // For large integers, the precision is that of f64 at the largest.
        let (a, b) = (found.standard_deviation, expected.standard_deviation);
        let lost = 1e-15 * expected.min.to_f64().abs().max(expected.max.to_f64().abs());
        assert!((a - b).abs() <= 1e-6 * (1.0 + b) + lost, "{what}: {found:?}, not {expected:?}");
        let (found, expected) = (found.values.as_ref().unwrap(), expected.values.as_ref().unwrap());
        assert_values_alike(found, expected, what);
    }
    assert_eq!(found.classes.len(), expected.classes.len(), "{what}: {found:?}, not {expected:?}");
    for ((class, cells), (other, count)) in found.classes.iter().zip(&expected.classes) {
        assert!(class == other && near(*cells, *count), "{what}: {found:?}, not {expected:?}");
    }
}

fn zones(form: TreeType, seed: u64, size: [u64; 3], (rule, kind): (Rule, DataKind)) {
    let directory = tempfile::tempdir().unwrap();
    let [goblin, autumnal] = ["t.goblin", "t.autumn"].map(|name| directory.path().join(name));
    let cells = Cells::random(form, seed, size, 5 + seed % 30, true);
    write_cells(&goblin, &cells, &options(rule, kind, cells.depth()));
    convert(&goblin, false, Output::create(&autumnal).unwrap(), WriteOptions::new(1 << 24), &()).unwrap();
    let files: Vec<Dataset> = [&goblin, &autumnal].map(|path| spinney::open(path).unwrap()).into();
    let view = spinney::open(&goblin).unwrap().view(&["translate=0,0".parse().unwrap()]).unwrap();
    let counts_classes = files[0].header().counts_classes();
    let mut random = Random(seed);
    let zones: Vec<_> = (0..12).map(|_| parts(&mut random, size)).collect();
    let polygons: Vec<Polygon> = zones.iter().map(|parts| Polygon::of_parts(parts).unwrap()).collect();
    let some: Vec<Option<Polygon>> = polygons.iter().cloned().map(Some).collect();
    for edge in EdgeRule::ALL {
        // A query of all layers returns the same as separate ones.
        let layers: Vec<(&Dataset, &[Option<Polygon>])> =
            files.iter().chain([&view]).map(|layer| (layer, &some[..])).collect();
        let mut all: Vec<Vec<ZoneStatistics>> = vec![Vec::new(); layers.len()];
        Dataset::zonal_layers(&layers, &request(edge), &(), &mut |zone| {
            all.iter_mut().zip(zone).for_each(|(all, zone)| all.push(zone));
            Ok(())
        })
        .unwrap();
        for (layer, found) in layers.iter().zip(&all) {
            let alone = layer.0.zonal(&polygons, &request(edge), &()).unwrap();
            // Partial sums may be added in another order.
            alone.iter().zip(found).for_each(|(alone, found)| assert_alike(found, alone, "all at once"));
        }
        let found_in = |dataset: &Dataset| dataset.zonal(&polygons, &request(edge), &()).unwrap();
        let found = ["goblin", "autumnal", "view"].iter().zip(files.iter().chain([&view]).map(found_in));
        let found: Vec<_> = found.collect();
        for (number, parts) in zones.iter().enumerate() {
            let weight = |[x, y, _]: [u64; 3]| match edge {
                EdgeRule::Centre => f64::from(u8::from(has(parts, [x as f64 + 0.5, y as f64 + 0.5]))),
                // The area is tested separately, against points.
                EdgeRule::Area => {
                    let (low, high) = ([x as f64, y as f64], [(x + 1) as f64, (y + 1) as f64]);
                    let area = area(parts, low, high);
                    if area < 1e-9 { 0.0 } else { area }
                }
                EdgeRule::Touch => {
                    let at = [x as f64, y as f64];
                    f64::from(u8::from(has(parts, at.map(|at| at + 0.5)) || is_cut(parts, at)))
                }
            };
            let everywhere = area(parts, [-1e4; 2], [1e4; 2]);
            let inside = area(parts, [0.0; 2], [size[0] as f64, size[1] as f64]);
            let mut expected = expected(&cells, size, counts_classes, &weight);
            expected.outside_cells = (everywhere - inside) * size[2] as f64;
            for (name, found) in &found {
                let found = &found[number];
                let found = ZoneStatistics {
                    classes: found.classes.iter().copied().filter(|(_, cells)| *cells >= 1e-9).collect(),
                    ..found.clone()
                };
                assert_alike(&found, &expected, &format!("{form} {seed} {edge:?} {name}"));
            }
            // Exactly equal: all numbers depend on the cells alone.
            let [one, others @ ..] = &found[..] else { unreachable!("three of them") };
            for (name, other) in others {
                let (one, other) = (format!("{:?}", one.1[number]), format!("{:?}", other[number]));
                assert_eq!(one, other, "{form} {seed} {edge:?} {name}");
            }
        }
    }
}

#[test]
fn zones_are_as_their_cells() {
    let classes = (Rule::Majority, DataKind::Categorical);
    let heights = (Rule::Mean, DataKind::Continuous);
    for seed in 0..6 {
        zones(QUAD, seed, [150 + seed, 90, 1], classes);
        zones(quad(SampleType::I16, 1), seed, [70, 130, 1], heights);
    }
    zones(quad(SampleType::F32, 2), 7, [140, 60, 1], heights);
    zones(quad(SampleType::U8, 4), 8, [60, 60, 1], heights);
    zones(OCT, 9, [40, 33, 7], classes);
}

#[test]
fn values_of_all_types_are_as_their_cells() {
    let types = value_types().into_iter().zip(0..);
    for (value, seed) in types {
        let form = TreeType { dimension: QUAD.dimension, value };
        let rules = [(Rule::Mean, DataKind::Continuous), (Rule::Majority, DataKind::Categorical)];
        zones(form, 40 + seed, [50, 40, 1], rules[seed as usize % 2]);
    }
}

#[test]
fn values_that_exceed_memory_have_the_same_measures() {
    for sample in [SampleType::F32, SampleType::I16, SampleType::U64] {
        let form = quad(sample, 1);
        let size = [220, 210, 1];
        // Each value occurs a few times, far apart, so that it is spread over temporary files.
        let cells = Cells::noise(form, 3, size, 15_000);
        let file = dataset(&cells, Rule::Mean, DataKind::Continuous);
        let ring = vec![[-3.0, 5.5], [219.5, -2.0], [217.25, 208.0], [20.0, 200.0]];
        let polygon = Polygon::new(&[ring]).unwrap();
        for edge in EdgeRule::ALL {
            let with = |memory: u64| {
                let request = ZonalRequest { memory, ..request(edge) };
                file.zonal(std::slice::from_ref(&polygon), &request, &()).unwrap().remove(0)
            };
            let (large, small) = (with(1 << 30), with(0));
            assert_alike(&small, &large, &format!("{sample:?} {edge:?}"));
            assert!(
                large.channels[0].values.as_ref().unwrap().variety
                    > if sample == SampleType::I16 { 250 } else { 10_000 }
            );
        }
    }
}

#[test]
fn measures_have_names_and_quantiles_are_from_0_to_1() {
    for measure in ZoneMeasure::ALL {
        assert_eq!(measure.to_string().parse::<ZoneMeasure>().unwrap(), measure);
    }
    let message = "middle".parse::<ZoneMeasure>().unwrap_err().to_string();
    assert!(message.contains("middle") && message.contains("median"), "{message}");
    let cells = Cells::random(QUAD, 1, [9, 9, 1], 9, false);
    let file = dataset(&cells, Rule::Majority, DataKind::Categorical);
    for wrong in [-0.1, 1.1, f64::NAN] {
        let request = ZonalRequest { quantiles: vec![0.5, wrong], ..ZonalRequest::default() };
        let message = file.zonal(&[], &request, &()).unwrap_err().to_string();
        assert!(message.contains("from 0 to 1"), "{message}");
    }
    // Quantities that are not requested are not counted.
    let square = Polygon::new(&[vec![[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]]]).unwrap();
    let zone = file.zonal(&[square], &ZonalRequest::default(), &()).unwrap().remove(0);
    assert_eq!(zone.channels[0].values, None);
    assert_eq!(zone.number(ZoneMeasure::Median, 0), None);
    assert_eq!(zone.number(ZoneMeasure::Count, 0), Some(81.into()));
    assert_eq!(zone.number(ZoneMeasure::Mean, 0).unwrap().to_f64(), zone.channels[0].mean);
    assert_eq!(ZoneStatistics::default().number(ZoneMeasure::Sum, 0), Some(0.into()));
}

#[test]
fn zones_of_nothing_and_everything() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    let cells = Cells::random(QUAD, 3, [100, 80, 1], 9, false);
    write_cells(&path, &cells, &options(Rule::Majority, DataKind::Categorical, cells.depth()));
    let file = spinney::open(&path).unwrap();
    let square = |low: f64, high: f64| {
        Polygon::new(&[vec![[low, low], [high, low], [high, high], [low, high]]]).unwrap()
    };
    let polygons = [square(-1e12, 1e12), square(200.0, 300.0), square(-50.0, -1.0), square(10.2, 10.4)];
    let all = file.statistics(None, &()).unwrap();
    for edge in EdgeRule::ALL {
        let found = file.zonal(&polygons, &edge.into(), &()).unwrap();
        assert_eq!((found[0].cells, found[0].void_cells), (all.cells as f64, all.void_cells as f64));
        let outside = found[0].outside_cells / 4e24;
        assert!((outside - 1.0).abs() < 1e-9, "{outside}");
        let classes: Vec<_> = all.classes.iter().map(|(class, cells)| (*class, *cells as f64)).collect();
        assert_eq!(found[0].classes, classes);
        let nothing = |outside_cells: f64| ZoneStatistics { outside_cells, ..ZoneStatistics::default() };
        assert_eq!([&found[1], &found[2]], [&nothing(10_000.0), &nothing(49.0 * 49.0)]);
        assert!(found[1].void_share().is_nan() && found[0].void_share() < 1.0);
        let inside = match edge {
            EdgeRule::Centre => 0.0,
            EdgeRule::Touch => 1.0,
            EdgeRule::Area => 0.04,
        };
        assert!((found[3].cells - inside).abs() < 1e-9, "{:?}", found[3]);
    }
    assert_eq!(file.zonal(&[], &EdgeRule::Area.into(), &()).unwrap(), []);
}

#[test]
fn zones_of_layers_with_cells_of_their_own() {
    let (heights, mean) = (quad(SampleType::F32, 1), (Rule::Mean, DataKind::Continuous));
    let fine = Cells::random(heights, 1, [90, 80, 1], 9, true);
    let coarse = Cells::random(quad(SampleType::U16, 1), 2, [45, 40, 1], 9, true);
    let [fine, coarse] = [&fine, &coarse].map(|cells| dataset(cells, mean.0, mean.1));
    let ring = |factor: f64| {
        vec![[[3.0, 2.5], [77.0, 11.0], [40.3, 70.9]].iter().map(|at| at.map(|at| at * factor)).collect()]
    };
    let polygons = [1.0, 0.5].map(|factor| [Some(Polygon::new(&ring(factor)).unwrap()), None]);
    let layers: [(&Dataset, &[Option<Polygon>]); 3] =
        [(&fine, &polygons[0]), (&coarse, &polygons[1]), (&fine, &polygons[0])];
    for edge in EdgeRule::ALL {
        let mut zones = Vec::new();
        let take = &mut |zone| {
            zones.push(zone);
            Ok(())
        };
        Dataset::zonal_layers(&layers, &edge.into(), &(), take).unwrap();
        let alone = |layer: &Dataset, polygons: &[Option<Polygon>; 2]| {
            layer.zonal(&[polygons[0].clone().unwrap()], &edge.into(), &()).unwrap().remove(0)
        };
        let (of_fine, of_coarse) = (alone(&fine, &polygons[0]), alone(&coarse, &polygons[1]));
        assert!(of_fine.cells > 1000.0 && of_coarse.cells > 250.0);
        assert_eq!(zones, [vec![of_fine.clone(), of_coarse, of_fine], vec![ZoneStatistics::default(); 3]]);
    }
    let uneven = [(&fine, &polygons[0][..]), (&coarse, &polygons[1][..1])];
    let error = Dataset::zonal_layers(&uneven, &ZonalRequest::default(), &(), &mut |_| Ok(())).unwrap_err();
    assert!(error.to_string().contains("the same polygons"), "{error}");
}
