//! Compares blocks in rows with blocks in Z order.

use super::super::block::Block;
use super::super::sink::BuiltBlock;
use super::super::slab::{BlockContent, Slab};
use super::*;
use spinney_base::space::Dimension;
use spinney_base::value::{SampleType, ValueType};
use spinney_container::MAX_DENSE_LEVELS;

const DEPTH: u8 = 9;

/// Returns the next number of a linear congruential generator.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *state >> 33
}

/// Returns a slab of one block, with some uniform areas.
fn slab(form: TreeType, first: [u64; 3], side: u64, spread: u64) -> Slab {
    let size = std::array::from_fn(|axis| if axis < form.axes() { side } else { 1 });
    let mut state = spread;
    let mut bytes = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                for channel in 0..u64::from(form.value.channels) {
                    // One quarter is noise, one quarter squares, the rest uniform except for single
                    // cells.
                    let noise = random(&mut state);
                    let number = match (x * 2 / side, y * 2 / side) {
                        (0, 0) => noise % spread,
                        (1, 0) => (x / 4 * 3 + y / 8 * 5 + z / 2 * 7) % spread,
                        _ => {
                            if noise.is_multiple_of(50) {
                                noise / 64 % spread
                            } else {
                                1
                            }
                        }
                    } + channel;
                    let signed = number as i64 - 3;
                    match form.value.sample {
                        SampleType::U8 => bytes.push(number as u8),
                        SampleType::U16 => bytes.extend((number as u16).wrapping_mul(641).to_le_bytes()),
                        SampleType::I16 => bytes.extend((signed as i16).wrapping_mul(641).to_le_bytes()),
                        SampleType::U32 => bytes.extend((number as u32).wrapping_mul(1 << 25).to_le_bytes()),
                        SampleType::I32 => bytes.extend((signed as i32).wrapping_mul(1 << 25).to_le_bytes()),
                        SampleType::F32 => bytes.extend((signed as f32 * -1.3e37).to_le_bytes()),
                        SampleType::F64 => bytes.extend((signed as f64 * f64::MAX / 4.0).to_le_bytes()),
                        SampleType::I8 => bytes.push((signed as i8).wrapping_mul(37) as u8),
                        SampleType::U64 => bytes.extend(number.wrapping_mul(0x9E37_79B9 << 31).to_le_bytes()),
                        SampleType::I64 => bytes.extend(signed.wrapping_mul(0x9E37_79B9 << 31).to_le_bytes()),
                    }
                }
            }
        }
    }
    Slab { origin: first, size, bytes, valid: None }
}

fn in_z_order(block: Block, rule: Rule, count_classes: bool, shape: &Shape) -> BuiltBlock {
    let mut counts = LevelCounts::default();
    let mut part = block.build(rule, count_classes, MAX_DENSE_LEVELS, &mut counts);
    let sealed = part.seal(shape).unwrap();
    (part, sealed, counts)
}

#[test]
fn blocks_in_rows_are_those_in_z_order() {
    let one = |sample| ValueType::new(sample, 1);
    let types = SampleType::ALL.map(one).into_iter().chain([
        ValueType::new(SampleType::U8, 3),
        ValueType::new(SampleType::U16, 2),
        ValueType::new(SampleType::F32, 4),
    ]);
    let mut built = 0;
    for (type_number, value) in types.enumerate() {
        for (dimension, reach, stride) in
            [(Dimension::Quad, 8, 2), (Dimension::Quad, 2, 1), (Dimension::Oct, 6, 2), (Dimension::Oct, 2, 1)]
        {
            let form = TreeType::new(dimension, value);
            let shape = Shape { depth: DEPTH, reach, stride, heavy_threshold: 20 };
            let level = shape.block_level();
            let code = Code::from_cell(dimension, level, [1, 0, 0]).unwrap();
            let height = DEPTH - level;
            for (number, (spread, rule)) in [
                (7, Rule::Mean),
                (200, Rule::Occupancy),
                (12, Rule::Majority),
                (255, Rule::Majority),
                (200, Rule::Nearest),
            ]
            .into_iter()
            .enumerate()
            {
                // (Of large blocks, only means and every second of the others, alternating between
                // types.)
                if reach > 2 && number > 0 && (type_number + number).is_multiple_of(2) {
                    continue;
                }
                let count_classes = matches!(rule, Rule::Majority | Rule::Nearest);
                if !RowBlock::supports(form, rule, count_classes) {
                    continue;
                }
                let slab = slab(form, [1 << height, 0, 0], 1 << height, spread);
                let name = format!("{dimension:?} {value} {height} levels, {rule}");
                let classify = |in_rows| slab.classify(form, code, height, None, in_rows);
                let (BlockContent::Mixed(block), BlockContent::Full(rows)) =
                    (classify(false), classify(true))
                else {
                    panic!("{name}: not mixed");
                };
                let (part, sealed, counts) = rows.build(rule, &shape, MAX_DENSE_LEVELS);
                let (other, other_sealed, other_counts) = in_z_order(block, rule, count_classes, &shape);
                assert!(part.records == other.records, "{name}: records");
                // (As strings, because NaN is not equal to itself.)
                assert_eq!(format!("{:?}", part.tally), format!("{:?}", other.tally), "{name}");
                assert_eq!((part.child, part.total), (other.child, other.total), "{name}");
                assert_eq!(counts, other_counts, "{name}");
                assert_eq!(sealed.is_some(), other_sealed.is_some(), "{name}");
                if let (Some(sealed), Some(other)) = (sealed, other_sealed) {
                    assert!(sealed.records == other.records, "{name}: records of the segment");
                    built += 1;
                }
            }
        }
    }
    assert!(built > 20, "{built} segments");
}

#[test]
fn cells_that_are_void_are_found() {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, 1));
    let content = |slab: &Slab, nodata| {
        let code = Code::from_cell(form.dimension, DEPTH - 2, [0; 3]).unwrap();
        matches!(slab.classify(form, code, 2, nodata, true), BlockContent::Full(_))
    };
    let mut slab = slab(form, [0; 3], 4, 9);
    assert!(content(&slab, None));
    assert!(content(&slab, Some(Value::from_bytes(&5f32.to_le_bytes()))));
    let last: [u8; 4] = slab.bytes[60..].try_into().unwrap();
    assert!(!content(&slab, Some(Value::from_bytes(&last))));
    slab.valid = Some(vec![true; 16]);
    assert!(content(&slab, None));
    slab.valid = Some((0..16).map(|cell| cell != 6).collect());
    assert!(!content(&slab, None));
    slab.valid = None;
    slab.bytes[20..24].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(!content(&slab, None));
}
