//! Standard deviations of numbers that are much larger than their differences, against those of the
//! differences.

use spinney::query::{EdgeRule, Polygon, ZonalRequest};
use spinney::{Codec, DataKind, Dataset, Output, Rule, SampleType, Value, WriteOptions, convert};

use crate::common::{Cells, dataset, options, quad, with, write_cells};

/// Cells along each side, more than one segment has.
const SIDE: u64 = 300;

/// Returns a cell's difference from the base: 0 to 6, in patches, so that nodes of all sizes are
/// uniform.
fn difference([x, y, _]: [u64; 3]) -> u64 {
    if x / 64 == y / 64 { 3 } else { (x / 3 * x / 3 + 5 * y) % 7 }
}

/// Returns a sample of a type that exceeds the base by `more`.
fn sample(sample: SampleType, base: i128, more: u64) -> Value {
    let number = base + i128::from(more);
    match sample {
        SampleType::F64 => Value::from((number as f64).to_le_bytes()),
        SampleType::U64 => Value::from((number as u64).to_le_bytes()),
        _ => Value::from((number as i64).to_le_bytes()),
    }
}

/// Returns the standard deviation of weighted numbers.
fn deviation(numbers: &[(u64, f64)]) -> f64 {
    let weight: f64 = numbers.iter().map(|(_, weight)| weight).sum();
    let mean = numbers.iter().map(|(number, weight)| *number as f64 * weight).sum::<f64>() / weight;
    let square = |(number, weight): &(u64, f64)| (*number as f64 - mean).powi(2) * weight;
    (numbers.iter().map(square).sum::<f64>() / weight).sqrt()
}

fn check(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-8 * expected, "{what}: {found}, but it is {expected}");
}

/// Checks the whole file, a box, zones by centres and by shares, and uniform cells.
fn check_file(file: &Dataset, what: &str) {
    let weighed = |[low, high]: [[f64; 2]; 2]| {
        let cells = (0..SIDE * SIDE).map(|index| [index % SIDE, index / SIDE]);
        let share = |cell: [u64; 2]| {
            (0..2).map(move |axis| {
                (high[axis].min(cell[axis] as f64 + 1.0) - low[axis].max(cell[axis] as f64)).max(0.0)
            })
        };
        let numbers = cells.map(|[x, y]| (difference([x, y, 0]), share([x, y]).product::<f64>()));
        deviation(&numbers.collect::<Vec<_>>())
    };
    let side = SIDE as f64;
    let all = file.statistics(None, &()).unwrap();
    check(all.channels[0].standard_deviation, weighed([[0.0; 2], [side; 2]]), what);
    for (low, high, edge) in [
        ([3.0, 10.0], [291.0, 270.0], EdgeRule::Centre),
        ([3.25, 10.5], [291.125, 270.75], EdgeRule::Area),
        ([70.25, 140.0], [70.5, 187.0], EdgeRule::Area),
    ] {
        let ring = vec![low, [high[0], low[1]], high, [low[0], high[1]]];
        let request = ZonalRequest { edge, ..ZonalRequest::default() };
        let zone = &file.zonal(&[Polygon::new(&[ring]).unwrap()], &request, &()).unwrap()[0];
        check(zone.channels[0].standard_deviation, weighed([low, high]), &format!("{what} {edge:?}"));
    }
    let request = ZonalRequest { edge: EdgeRule::Area, ..ZonalRequest::default() };
    let ring = vec![[65.5, 65.25], [127.125, 65.25], [120.0, 127.5]];
    let zone = &file.zonal(&[Polygon::new(&[ring]).unwrap()], &request, &()).unwrap()[0];
    assert_eq!(zone.channels[0].standard_deviation, 0.0, "{what}");
}

#[test]
fn deviations_are_those_of_the_differences() {
    for (of, base) in [
        (SampleType::F64, 0),
        (SampleType::F64, 1_000_000_000_000_000),
        (SampleType::F64, 4_000_000_000_000_000),
        (SampleType::F64, -8_000_000_000_000_000),
        (SampleType::F64, (1 << 53) - 7),
        (SampleType::U64, 4_000_000_000_000_000),
        (SampleType::U64, i128::from(u64::MAX) - 7),
        (SampleType::I64, -8_000_000_000_000_000),
        (SampleType::I64, i128::from(i64::MIN)),
    ] {
        let cells = (0..SIDE * SIDE).map(|index| [index % SIDE, index / SIDE, 0]);
        let cells = cells.map(|cell| Some(sample(of, base, difference(cell)))).collect();
        let cells = Cells { form: quad(of, 1), size: [SIDE, SIDE, 1], cells };
        let directory = tempfile::tempdir().unwrap();
        let [plain, packed, edited] =
            ["a.goblin", "b.goblin", "c.autumn"].map(|name| directory.path().join(name));
        write_cells(&plain, &cells, &options(Rule::Mean, DataKind::Continuous, cells.depth()));
        let write = |path, is_packed: bool| {
            let options = with(WriteOptions::new(1 << 24), |it| {
                if is_packed {
                    it.packing.codec = Codec::Packed;
                }
            });
            convert(&plain, false, Output::create(path).unwrap(), options, &()).unwrap();
        };
        write(&packed, true);
        write(&edited, false);
        for path in [&plain, &packed, &edited] {
            let file = spinney::open(path).unwrap();
            check_file(&file, &format!("{of:?} {base} {}", path.display()));
        }
        check_file(&dataset(&cells, Rule::Mean, DataKind::Continuous), &format!("{of:?} {base}"));
    }
}
