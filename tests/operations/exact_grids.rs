//! Set operations on exact models without a common grid unit: operands are snapped to a common
//! grid, stay closed, and the maximum displacement of a vertex is reported.

use std::path::Path;
use std::sync::Mutex;

use spinney::brep::{Faces, Grid, combine};
use spinney::{Error, ExactModel, Output, Progress, SetOperation};

use crate::common::Random;
use crate::common::exact::{cuboid, model_on};
use crate::common::sets::{Body, MEMORY, Solid, combined, tetrahedron, try_combined};

fn grid(bits: u8, origin: [i64; 3], step: f64, divisor: f64) -> Grid {
    Grid { bits, origin, step, divisor }
}

fn on_grid(grid: &Grid, min: [i32; 3], max: [i32; 3]) -> Body {
    Body::of_list(&model_on(grid.clone(), &cuboid(min, max)))
}

/// Half the diagonal of a grid unit: the maximum displacement of a vertex to its nearest grid
/// point.
fn half_diagonal(unit: f64) -> f64 {
    unit * 3f64.sqrt() / 2.0
}

#[test]
fn units_with_a_common_fraction_are_exact() {
    let first = on_grid(&grid(4, [0; 3], 1.0, 100.0), [2; 3], [6; 3]);
    let second = on_grid(&grid(4, [0; 3], 25.0, 1000.0), [1; 3], [3; 3]);
    for bodies in [[&first, &second], [&second, &first]] {
        let (both, report) = try_combined(1, &bodies).unwrap();
        both.check();
        assert_eq!((report.snapped, report.grid.width()), (0.0, 0.005));
        assert!((both.volume() - 0.035f64.powi(3)).abs() < 1e-15, "{}", both.volume());
    }
}

#[test]
fn boxes_on_unlike_grids_are_combined() {
    let whole = on_grid(&grid(4, [0; 3], 1.0, 1.0), [2; 3], [6; 3]);
    for other in [
        grid(4, [0; 3], 1.0, 3.3),
        grid(4, [0; 3], std::f64::consts::PI, 1.0),
        grid(25, [0; 3], 1.0, f64::from(3 << 20)),
        grid(4, [-(1 << 21), 5, 7], std::f64::consts::SQRT_2, 1.0),
    ] {
        let second = on_grid(&other, [2; 3], [6; 3]);
        let expected = whole.volume() + second.volume();
        for bodies in [[&whole, &second], [&second, &whole]] {
            let (mut sum, mut snapped) = (0.0, 0.0f64);
            for operation in [1, 7] {
                let (result, report) = try_combined(operation, &bodies).unwrap();
                result.check();
                assert!(report.snapped <= half_diagonal(report.grid.width()));
                sum += result.volume();
                snapped = snapped.max(report.snapped);
            }
            // At most all faces swept by the displacement.
            let area = 6.0 * (whole.volume().powf(2.0 / 3.0) + second.volume().powf(2.0 / 3.0));
            assert!(
                (sum - expected).abs() < 1e-9 * expected + 2.0 * area * snapped,
                "{other:?}: {sum} {expected}"
            );
        }
    }
}

/// Operations on snapped operands are consistent, and the operands keep their volumes up to their
/// displacement.
#[test]
fn operations_agree_on_moved_operands() {
    let mut random = Random(23);
    for round in 0..40u32 {
        let mut solid = || loop {
            let corners = [(); 4].map(|()| [(); 3].map(|()| random.below(1 << 20) as i32));
            if let Some(faces) = tetrahedron(corners) {
                return faces;
            }
        };
        let steps = [1.0, 25.4, std::f64::consts::E, 0.61];
        let own = |solid: &Solid, step: f64| {
            Body::of_list(&model_on(grid(20, [-(1 << 19); 3], step, 1000.0), solid))
        };
        let a = own(&solid(), steps[round as usize % 4]);
        let b = own(&solid(), steps[(round as usize / 4 + 1) % 4] * 1.1);
        let results = [1, 2, 3, 4, 5, 6, 7, 8].map(|operation| try_combined(operation, &[&a, &b]).unwrap());
        let [both, a_only, all_of_a, b_only, all_of_b, one, any, neither] =
            [0, 1, 2, 3, 4, 5, 6, 7].map(|index: usize| results[index].0.volume());
        let scale = any.abs() * 1e-6;
        for (left, right) in [
            (both + a_only, all_of_a),
            (both + b_only, all_of_b),
            (a_only + b_only, one),
            (both + one, any),
            (-any, neither),
        ] {
            assert!((left - right).abs() <= scale, "{round}: {left} {right}");
        }
        for (body, moved) in [(&a, all_of_a), (&b, all_of_b)] {
            let report = &results[0].1;
            assert!(report.snapped <= half_diagonal(report.grid.width()));
            // At most all faces of the largest tetrahedron swept by the displacement.
            let size = f64::from(1 << 20) / 1000.0 * 25.4 * 1.1;
            let most = 1e-9 * body.volume() + 6.0 * size * size * report.snapped;
            assert!((body.volume() - moved).abs() <= most, "{round}: {} {moved}", body.volume());
        }
        for (result, _) in &results {
            assert_eq!(result.model.verify(MEMORY, &()).unwrap(), []);
        }
        // The results are valid operands, with solids on other grids, and for complements.
        let third = own(&solid(), 0.3);
        for (result, report) in [&results[0], &results[6], &results[7]] {
            let [common, all] = [1, 7].map(|operation| combined(operation, &[result, &third]));
            all.check();
            let infinite = f64::from(u8::from(report.is_unbounded));
            assert_eq!(all.model.is_unbounded(), report.is_unbounded);
            let sum = common.volume() + all.volume();
            let expected = result.volume() + third.volume();
            let size = any.abs() + third.volume() + infinite;
            assert!((sum - expected).abs() <= 1e-4 * size, "{round}: {sum} {expected}");
        }
    }
}

/// A wall thinner than a unit of the common grid intersects itself there, which is resolved.
#[test]
fn surfaces_that_intersect_themselves_on_the_common_grid_stay_closed() {
    let mut inner = cuboid([2, 3, 4], [897, 895, 893]);
    inner.iter_mut().flatten().for_each(|ring| ring.reverse());
    // Tilted, so that walls cross when vertices are snapped.
    let mut wall: Solid = [cuboid([0; 3], [900; 3]), inner].concat();
    for point in wall.iter_mut().flatten().flatten() {
        let [x, y, z] = *point;
        *point = [8 * x + 3 * y - z + 1000, -3 * x + 8 * y + 2 * z + 3000, x - 2 * y + 8 * z + 2000];
    }
    let wall = Body::of_list(&model_on(grid(14, [0; 3], std::f64::consts::E, 1.0), &wall));
    let far = on_grid(&grid(26, [0; 3], 1000.0, 1.0), [0; 3], [40_000_000; 3]);
    for unit in [1.0, 300.0, 3000.0] {
        let far = on_grid(&grid(26, [0; 3], unit, 1.0), [60_000_000; 3], [60_000_010; 3]);
        let result = try_combined(7, &[&wall, &far]);
        let (result, report) = result.unwrap_or_else(|error| panic!("{unit}: {error}"));
        result.check();
        assert!(report.snapped > 0.0, "{unit}");
        assert!(result.volume() > far.volume(), "{unit}");
    }
    let complement = combined(12, &[&wall, &far]);
    for unit in [300.0, 3000.0] {
        let far = on_grid(&grid(26, [0; 3], unit, 1.0), [60_000_000; 3], [60_000_010; 3]);
        let result = combined(2, &[&complement, &far]);
        result.check();
        assert!(result.model.is_unbounded() && result.volume() < -far.volume());
    }
}

#[test]
fn many_operands_of_many_units_are_combined() {
    let mut random = Random(7);
    let bodies: Vec<Body> = (0..40)
        .map(|number| {
            let step = 1.0 + random.below(1 << 30) as f64 / f64::from(1 << 30);
            let own = grid(10, [number * 900, 0, 0], step, 1024.0);
            on_grid(&own, [0; 3], [10 + random.below(1000) as i32, 500, 900])
        })
        .collect();
    let bodies: Vec<&Body> = bodies.iter().collect();
    let (all, report) = try_combined(7, &bodies).unwrap();
    all.check();
    assert!(report.snapped > 0.0 && report.snapped <= half_diagonal(report.grid.width()));
    let largest = bodies.iter().map(|body| body.volume()).fold(0.0, f64::max);
    assert!(all.volume() >= largest * 0.9999);
}

/// Warnings of an operation.
#[derive(Default)]
struct Warnings(Mutex<Vec<String>>);

impl Progress for Warnings {
    fn warn(&self, file: &Path, text: &str) {
        self.0.lock().unwrap().push(format!("{}: {text}", file.display()));
    }
}

#[test]
fn the_displacement_is_reported_and_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("c.goblin");
    let a = on_grid(&grid(4, [0; 3], 1.0, 1.0), [2; 3], [6; 3]);
    let b = on_grid(&grid(4, [0; 3], 1.0, 3.3), [2; 3], [6; 3]);
    let warnings = Warnings::default();
    let models: [&ExactModel; 5] = [&a.model, &a.model, &b.model, &a.model, &b.model];
    let output = Output::create(&path).unwrap();
    let report =
        combine(SetOperation::Union, &models, output, spinney::Codec::Plain, MEMORY, &warnings).unwrap();
    let warnings = warnings.0.into_inner().unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("2 of 5 models") && warnings[0].contains(&report.snapped.to_string()));
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
    let made = ExactModel::open(&path, &Default::default()).unwrap();
    let kept =
        made.metadata().tag(spinney::raw::store::Tag::ModelDisplacement).unwrap().parse::<f64>().unwrap();
    assert_eq!(kept, report.displacement + report.snapped);
    assert_eq!(made.formula().unwrap().unwrap(), format!("(op7{})", " \"(memory)\"".repeat(5)));
    assert_eq!(made.len(), report.after);
}

#[test]
fn models_that_no_grid_holds_are_refused_with_advice() {
    let whole = on_grid(&grid(4, [0; 3], 1.0, 1.0), [2; 3], [6; 3]);
    for other in [
        grid(4, [1 << 40, 0, 0], 1.0, 1.0),
        grid(4, [0, 0, 1 << 50], 1024.0, 1.0),
        grid(4, [0; 3], 1.0, (1u64 << 40) as f64),
    ] {
        let second = on_grid(&other, [2; 3], [6; 3]);
        for bodies in [[&whole, &second], [&second, &whole]] {
            let error = try_combined(7, &bodies).err().unwrap_or_else(|| panic!("{other:?}"));
            let Error::NotASolid { advice, .. } = &error else { panic!("{error}") };
            assert!(advice.contains("without --brep"), "{advice}");
        }
    }
}
