//! Tests with many random segments. They take minutes:
//!
//!     cargo test --release -p spinney-packing -- --ignored

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::{DataKind, Rule, ValueType};

use crate::model::Model;
use crate::segment::{SegmentForm, pack_by, unpack};
use crate::tests::{Random, corrupted, random_segment, segment, value_types};
use crate::vectorized::baseline_only;

/// Returns a form of any type, and a model that suits it.
fn random_form(types: &[ValueType], random: &mut Random) -> (SegmentForm, Model) {
    let dimension = if random.below(2) == 0 { Dimension::Quad } else { Dimension::Oct };
    let form = TreeType::new(dimension, types[random.below(types.len() as u64) as usize]);
    let (kind, rule, model) = match random.below(4) {
        0 => (DataKind::Categorical, Rule::Majority, Model::Names),
        1 => (
            DataKind::Continuous,
            Rule::Occupancy,
            Model::of(form.value, Rule::Occupancy, DataKind::Continuous),
        ),
        2 => (DataKind::Continuous, Rule::Max, Model::Numbers),
        _ => (DataKind::Continuous, Rule::Mean, Model::Numbers),
    };
    (segment(form, 3 + random.below(4) as u8, kind, rule), model)
}

#[test]
#[ignore = "heavy: 100,000 segments"]
fn segments_are_the_same_by_all_processors_ways() {
    let (types, mut random) = (value_types().collect::<Vec<_>>(), Random(61));
    let mut packed_count = 0;
    for seed in 0..100_000 {
        let (form, model) = random_form(&types, &mut random);
        let (slots, plain) = random_segment(form, 1 + random.below(6), seed);
        let packed = pack_by(model, &form, slots, &plain);
        assert!(packed == baseline_only(|| pack_by(model, &form, slots, &plain)), "{form:?} {seed}");
        let Some(packed) = packed else { continue };
        packed_count += 1;
        assert!(unpack(&form, slots, 0, &packed).as_ref() == Ok(&plain), "{form:?} {seed}");
        let simple = baseline_only(|| unpack(&form, slots, 0, &packed));
        assert!(simple.as_ref() == Ok(&plain), "{form:?} {seed}");
    }
    assert!(packed_count > 50_000, "{packed_count}");
}

#[test]
#[ignore = "heavy: 1,000,000 corrupt segments"]
fn corrupt_segments_are_refused_or_the_same() {
    let (types, mut random) = (value_types().collect::<Vec<_>>(), Random(67));
    let mut tried = 0;
    for seed in 0.. {
        let (form, model) = random_form(&types, &mut random);
        let (slots, plain) = random_segment(form, 1 + random.below(6), seed);
        let Some(packed) = pack_by(model, &form, slots, &plain) else { continue };
        for _ in 0..100 {
            // (Some bits have no effect.)
            if let Ok(found) = unpack(&form, slots, 0, &corrupted(&packed, &mut random)) {
                assert!(found == plain, "{form:?} {seed}");
            }
        }
        tried += 100;
        if tried == 1_000_000 {
            break;
        }
    }
}
