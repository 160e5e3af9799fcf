//! Round trips of dense blocks of numbers of any size, with the vectorized and the baseline
//! functions.

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::{Rule, SampleType, ValueType};
use spinney_container::{DenseKind, LEAF, RecordLayout, dense_levels};

use crate::blocks::{NumberBlock, copy_values, pack_blocks, unpack_blocks};
use crate::groups::Group;
use crate::nodes::Dense;
use crate::tests::Random;
use crate::vectorized::baseline_only;

/// Pattern of the samples of a block.
#[derive(Clone, Copy, Debug)]
enum Content {
    /// Random bits.
    Noise,
    /// Minimum, maximum, and special bit patterns.
    Extremes,
    /// Slopes with some noise.
    Slopes,
    /// Multiples of 64 at the bottom.
    Steps,
    /// One number.
    Uniform,
}

const CONTENTS: [Content; 5] =
    [Content::Noise, Content::Extremes, Content::Slopes, Content::Steps, Content::Uniform];

/// Returns the bits of a sample at a position.
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

/// Returns blocks with random bits, and their records.
fn blocks(form: TreeType, content: Content, random: &mut Random) -> (Vec<NumberBlock>, Vec<u8>) {
    let count = 1 + random.below(6) as u32;
    some_blocks(form, content, (count, 3), random)
}

/// Returns `count` blocks of several sizes.
fn some_blocks(
    form: TreeType,
    content: Content,
    (count, sizes): (u32, u64),
    random: &mut Random,
) -> (Vec<NumberBlock>, Vec<u8>) {
    let layout = RecordLayout::new(form);
    let (mut blocks, mut records) = (Vec::new(), Vec::new());
    let size = form.value.sample.size();
    for node in 1..=count {
        let all = dense_levels(form.dimension);
        let levels = (*all.start() + random.below(sizes) as u8).min(*all.end());
        let kind = if random.below(2) == 0 { DenseKind::ALL_LEAF } else { DenseKind::LEAF_OR_VOID };
        assert!(kind.states().0 == LEAF);
        let dense = Dense { kind, levels };
        let start = records.len();
        records.resize(start + dense.slots(&layout) * layout.size, 0);
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
    // (VOID nodes have zeros, and the heads are rewritten.)
    let from = records.clone();
    let groups = Group::all(&layout, &blocks);
    copy_values(form, (&blocks, &groups), &from, &mut records);
    (blocks, records)
}

#[test]
fn numbers_of_any_size_come_back_by_all_ways() {
    let (mut random, mut digest) = (Random(41), 0);
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
                    let (header, streams) = check(form, rule, &blocks, &records);
                    digest = crc32c::crc32c_append(crc32c::crc32c_append(digest, &header), &streams);
                }
            }
        }
    }
    // Packed bytes are equal on all processors. (Change the number if the coding changes.)
    assert_eq!(digest, 1_563_524_774);
}

/// Packs and unpacks blocks with the vectorized and the baseline functions.
fn check(form: TreeType, rule: Rule, blocks: &[NumberBlock], records: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let groups = Group::all(&RecordLayout::new(form), blocks);
    let pack = || pack_blocks(form, rule, (blocks, &groups), records);
    let (packed, simple) = (pack(), baseline_only(pack));
    assert!(packed == simple, "{form:?} {rule:?}");
    let unpack = || {
        let mut found = vec![0; records.len()];
        let mut own: Vec<NumberBlock> = Vec::new();
        for block in blocks {
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
    assert!(is_read && found == records, "{form:?} {rule:?}");
    assert!(baseline_only(unpack) == (true, found), "{form:?} {rule:?}");
    packed
}

#[test]
fn more_blocks_than_a_group_has_come_back() {
    let mut random = Random(47);
    for (dimension, sample) in [(Dimension::Quad, SampleType::I16), (Dimension::Oct, SampleType::U8)] {
        let form = TreeType::new(dimension, ValueType::new(sample, 1));
        let (blocks, records) = some_blocks(form, Content::Slopes, (2100, 1), &mut random);
        check(form, Rule::Mean, &blocks, &records);
    }
}

/// Unpacks blocks from an arbitrary header and streams, with the vectorized and the baseline
/// functions.
fn check_bytes(
    form: TreeType,
    (blocks, records): (&[NumberBlock], &[u8]),
    (header, streams): (&[u8], &[u8]),
) {
    let unpack = || {
        let mut found = records.to_vec();
        (unpack_blocks(form, Rule::Mean, (blocks, &mut found), (header, streams)), found)
    };
    // (The test requires only that nothing panics, and that both results are equal. Checksums find
    // all other errors.)
    assert!(unpack() == baseline_only(unpack), "{form:?}");
}

#[test]
fn tables_and_weights_of_any_bits_mean_the_same_to_all_processors() {
    let mut random = Random(53);
    for dimension in [Dimension::Quad, Dimension::Oct] {
        for sample in SampleType::ALL {
            let form = TreeType::new(dimension, ValueType::new(sample, 1));
            let (blocks, records) = blocks(form, Content::Extremes, &mut random);
            for bits in 0..8 {
                // Ones are rare in some headers and zeros in others: maximum weights and steps, few
                // and many tables.
                let mut noise = |count: u64| -> Vec<u8> {
                    let byte = |random: &mut Random| match bits {
                        0 => u8::MAX,
                        1 | 2 => (random.next() & random.next()) as u8,
                        3 | 4 => (random.next() | random.next()) as u8,
                        _ => random.next() as u8,
                    };
                    (0..count).map(|_| byte(&mut random)).collect()
                };
                let (header, mut streams) = (noise(2000), noise(4000));
                streams[8..12].copy_from_slice(&3000u32.to_le_bytes());
                check_bytes(form, (&blocks, &records), (&header, &streams));
            }
        }
    }
}

#[test]
fn corrupt_streams_are_refused_or_become_other_numbers() {
    let mut random = Random(43);
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::I16, 1));
    let (blocks, records) = blocks(form, Content::Slopes, &mut random);
    let (header, streams) = check(form, Rule::Mean, &blocks, &records);
    for _ in 0..1000 {
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
        check_bytes(form, (&blocks, &records), (&header, &streams));
    }
}
