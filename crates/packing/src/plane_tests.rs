//! Dense blocks of numbers of any size, round and round, by all processors' ways.

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::{Rule, SampleType, ValueType};
use spinney_container::{DenseKind, LEAF, RecordLayout, dense_levels};

use crate::blocks::{NumberBlock, copy_values, pack_blocks, unpack_blocks};
use crate::nodes::Dense;
use crate::tests::Random;
use crate::vectorized::baseline_only;

/// Samples of a block.
#[derive(Clone, Copy, Debug)]
enum Content {
    /// Any bits.
    Noise,
    /// The minimum, the maximum, and special bits.
    Extremes,
    /// Slopes, with some noise.
    Slopes,
    /// Multiples of 64 at the bottom.
    Steps,
    /// One number.
    Uniform,
}

const CONTENTS: [Content; 5] =
    [Content::Noise, Content::Extremes, Content::Slopes, Content::Steps, Content::Uniform];

/// Bits of a sample at a place.
fn sample(content: Content, sample: SampleType, [x, y, z]: [usize; 3], random: &mut Random) -> u64 {
    let number = match content {
        Content::Noise => return random.next(),
        Content::Extremes => {
            return [0, u64::MAX, 1 << (8 * sample.size() - 1), 0x7ff0_0000_0000_0000]
                [random.below(4) as usize];
        }
        Content::Slopes => 3 * x + 2 * y + z + random.below(3) as usize,
        Content::Steps => (x / 3 + y + 2 * z) * 64,
        Content::Uniform => 17,
    };
    match sample {
        SampleType::F32 => u64::from((number as f32 / 8.0).to_bits()),
        SampleType::F64 => (number as f64 / 8.0).to_bits(),
        _ => number as u64,
    }
}

/// Blocks with random bits, and their records.
fn blocks(form: TreeType, content: Content, random: &mut Random) -> (Vec<NumberBlock>, Vec<u8>) {
    let layout = RecordLayout::new(form);
    let (mut blocks, mut records) = (Vec::new(), Vec::new());
    let size = form.value.sample.size();
    for node in 1..=1 + random.below(2) as u32 {
        let all = dense_levels(form.dimension);
        let levels = (*all.start() + random.below(3) as u8).min(*all.end());
        let kind = if random.below(2) == 0 { DenseKind::ALL_LEAF } else { DenseKind::LEAF_OR_VOID };
        assert!(kind.states().0 == LEAF);
        let dense = Dense { kind, levels };
        let start = records.len();
        records.resize(start + dense.places(&layout) * layout.size, 0);
        for level in 1..=levels {
            for at in 0..layout.dimension.cells(level) as usize {
                let mask = (1 << level) - 1;
                let place = [at & mask, at >> level & mask, at >> (2 * level)];
                for channel in 0..usize::from(form.value.channels) {
                    let bits = sample(content, form.value.sample, place, random);
                    let to = start + layout.dense_values_at(level) + at * layout.width + channel * size;
                    records[to..to + size].copy_from_slice(&bits.to_le_bytes()[..size]);
                }
            }
        }
        let mut block = NumberBlock::new(&layout, node, dense, None);
        block.mask.fill_with(|| (random.next() | random.next()) as u8);
        block.root.fill_with(|| random.next() as u8);
        block.begin(&layout, start, &mut records[start..]);
        blocks.push(block);
    }
    // (VOID nodes have zeros, and heads say what is there.)
    let from = records.clone();
    copy_values(form, &blocks, &from, &mut records);
    (blocks, records)
}

#[test]
fn numbers_of_any_size_come_back_by_all_ways() {
    let mut random = Random(41);
    for dimension in [Dimension::Quad, Dimension::Oct] {
        for value in
            SampleType::ALL.into_iter().flat_map(|sample| [1, 3].map(|count| ValueType::new(sample, count)))
        {
            if !value.is_supported() {
                continue;
            }
            let form = TreeType::new(dimension, value);
            for content in CONTENTS {
                for rule in [Rule::Mean, Rule::Max] {
                    let (blocks, records) = blocks(form, content, &mut random);
                    let packed = pack_blocks(form, rule, &blocks, &records);
                    let simple = baseline_only(|| pack_blocks(form, rule, &blocks, &records));
                    assert!(packed == simple, "{form:?} {content:?}");
                    let unpack = || {
                        let mut found = vec![0; records.len()];
                        let mut own: Vec<NumberBlock> = Vec::new();
                        for block in &blocks {
                            let layout = RecordLayout::new(form);
                            let mut copy = NumberBlock::new(&layout, block.node, block.dense, None);
                            (copy.mask, copy.root) = (block.mask.clone(), block.root);
                            copy.begin(&layout, block.start, &mut found[block.start..]);
                            own.push(copy);
                        }
                        let parts = (&packed.0[..], &packed.1[..]);
                        let is_read = unpack_blocks(form, rule, (&own, &mut found), parts).is_some();
                        (is_read, found)
                    };
                    let (is_read, found) = unpack();
                    assert!(is_read && found == records, "{form:?} {content:?} {rule:?}");
                    assert!(baseline_only(unpack) == (true, found), "{form:?} {content:?} {rule:?}");
                }
            }
        }
    }
}

#[test]
fn corrupt_streams_are_refused_or_become_other_numbers() {
    let mut random = Random(43);
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::I16, 1));
    let (blocks, records) = blocks(form, Content::Slopes, &mut random);
    let (header, streams) = pack_blocks(form, Rule::Mean, &blocks, &records);
    for _ in 0..2000 {
        let (mut header, mut streams) = (header.clone(), streams.clone());
        match random.below(4) {
            0 => header.truncate(random.below(header.len() as u64) as usize),
            1 => streams.truncate(random.below(streams.len() as u64) as usize),
            2 => {
                let at = random.below(header.len() as u64) as usize;
                header[at] ^= 1 << random.below(8);
            }
            _ => {
                let at = random.below(streams.len() as u64) as usize;
                streams[at] ^= 1 << random.below(8);
            }
        }
        // (Nothing more than no panic: checksums find the rest.)
        let mut found = records.clone();
        let _ = unpack_blocks(form, Rule::Mean, (&blocks, &mut found), (&header, &streams));
    }
}
