//! Round trips of segments of random trees.

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::{DataKind, Rule, SampleType, ValueType};

use spinney_container::{
    CUT, DenseBlock, DenseKind, INNER, LEAF, RecordHead, RecordLayout, VOID, dense_levels,
};

use crate::model::Model;
use crate::nodes::Dense;
use crate::runs::pack_runs_by;
use crate::segment::pack_by;
use crate::{Corruption, RunForm, RunRecords, SegmentForm, pack, pack_runs, unpack, unpack_runs};

/// Small random number generator (xorshift), so that tests are reproducible.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub(crate) fn below(&mut self, most: u64) -> u64 {
        (self.next() >> 16) % most
    }
}

/// Generator of the records of random trees.
struct Trees {
    layout: RecordLayout,
    height: u8,
    reach: u8,
    values: u64,
    random: Random,
}

impl Trees {
    fn value(&mut self) -> Vec<u8> {
        let number = self.random.below(self.values) * 7919;
        (0..self.layout.width).map(|at| (number >> (8 * (at % 8))) as u8).collect()
    }

    /// Appends the record of a node at a depth below the segment's node, and all below it.
    fn record(&mut self, depth: u8, records: &mut Vec<u8>) {
        let (layout, bottom) = (self.layout, self.height.min(self.reach) - depth);
        if dense_levels(layout.dimension).contains(&bottom) && self.random.below(3) == 0 {
            return self.block(bottom, records);
        }
        let start = records.len();
        records.resize(start + layout.size, 0);
        let mut states = 0;
        for child in 0..layout.children() {
            let state = match (self.random.below(6), depth + 1) {
                (0, _) => VOID,
                (1..4, below) if below < self.height.min(self.reach) => INNER,
                (1..4, below) if below == self.reach && below < self.height => CUT,
                _ => LEAF,
            };
            states |= u32::from(state) << (2 * child);
            if state != VOID {
                let value = self.value();
                records[start + child * layout.width..][..layout.width].copy_from_slice(&value);
            }
            if state == INNER {
                self.record(depth + 1, records);
            }
        }
        let skip = (records.len() - start) / layout.size;
        layout.write_head(
            &mut records[start..][..layout.size],
            RecordHead { states, skip: skip as u32, dense: 0 },
        );
    }

    /// Appends a dense block of a random kind.
    fn block(&mut self, levels: u8, records: &mut Vec<u8>) {
        let layout = self.layout;
        let marks: &[u8] = if self.height > self.reach { &[2, 4, 5] } else { &[1, 3] };
        let dense = Dense { kind: kind(marks[self.random.below(marks.len() as u64) as usize]), levels };
        let (start, skip) = (records.len(), dense.slots(&layout));
        records.resize(start + skip * layout.size, 0);
        if dense.kind.has_mask() {
            let bits = &mut records[start + layout.dense_mask_at(levels)..]
                [..(layout.dimension.cells(levels) as usize) / 8];
            bits.fill_with(|| self.random.next() as u8 | self.random.next() as u8);
        }
        for level in 1..=levels {
            for at in 0..(layout.dimension.cells(level) as usize) {
                let value = self.value();
                let to = start + layout.dense_values_at(level) + at * layout.width;
                if DenseBlock::new(layout, dense.kind, levels, &records[start..]).state(level, at) != VOID {
                    records[to..to + layout.width].copy_from_slice(&value);
                }
            }
        }
        // Nodes with uniform contents have the value of their cells.
        let block = &mut records[start..];
        for level in 1..levels {
            for at in 0..(layout.dimension.cells(level) as usize) {
                if DenseBlock::new(layout, dense.kind, levels, block).state(level, at) == LEAF {
                    let (mask, below) = ((1 << level) - 1, levels - level);
                    let [x, y, z] =
                        [at & mask, at >> level & mask, at >> (2 * level)].map(|place| place << below);
                    let from =
                        layout.dense_values_at(levels) + ((z << levels | y) << levels | x) * layout.width;
                    let to = layout.dense_values_at(level) + at * layout.width;
                    block.copy_within(from..from + layout.width, to);
                }
            }
        }
        let state = |child| {
            u32::from(DenseBlock::new(layout, dense.kind, levels, block).state(1, child)) << (2 * child)
        };
        let states = (0..layout.children()).map(state).sum();
        let head = RecordHead { states, skip: skip as u32, dense: dense.kind.number() };
        layout.write_head(&mut block[..layout.size], head);
    }
}

/// Returns the kind of dense blocks with a number.
fn kind(number: u8) -> DenseKind {
    DenseKind::from_number(number).unwrap()
}

/// Yields all value types.
pub(crate) fn value_types() -> impl Iterator<Item = ValueType> {
    let of = |sample| (1..=4).map(move |channels| ValueType::new(sample, channels));
    SampleType::ALL.into_iter().flat_map(of).filter(|value| value.is_supported())
}

pub(crate) fn segment(form: TreeType, height: u8, kind: DataKind, rule: Rule) -> SegmentForm {
    SegmentForm { form, rule, kind, height, reach: 5 }
}

/// Returns a plain segment with `values` different values. Representatives are random, not means of
/// their children.
pub(crate) fn random_segment(form: SegmentForm, values: u64, seed: u64) -> (u32, Vec<u8>) {
    let layout = RecordLayout::new(form.form);
    let mut trees = Trees {
        layout,
        height: form.height,
        reach: form.reach,
        values,
        random: Random(seed * 0x9E37_79B9 + 1),
    };
    let mut records = Vec::new();
    trees.record(0, &mut records);
    ((records.len() / layout.size) as u32, records)
}

#[test]
fn random_segments_of_all_types_come_back() {
    let (mut seed, mut digest) = (0, 0);
    for dimension in [Dimension::Quad, Dimension::Oct] {
        for value in value_types() {
            for (kind, rule) in [
                (DataKind::Categorical, Rule::Majority),
                (DataKind::Continuous, Rule::Mean),
                (DataKind::Continuous, Rule::Occupancy),
                (DataKind::Continuous, Rule::Max),
            ] {
                for height in [4, 7] {
                    seed += 1;
                    let form = segment(TreeType::new(dimension, value), height, kind, rule);
                    let (slots, plain) = random_segment(form, 3, seed);
                    let packed = pack(&form, slots, &plain);
                    // (Random categories repeat often; random numbers cannot be predicted, and may
                    // stay plain.)
                    let may_stay = kind == DataKind::Continuous || plain.len() < 400;
                    assert!(packed.is_some() || may_stay, "{form:?} {} bytes", plain.len());
                    // Readers support each model with every rule and kind, since other writers may
                    // choose another one.
                    let others = [Model::Names, Model::Numbers];
                    let others = others.map(|model| pack_by(model, &form, slots, &plain));
                    for packed in others.into_iter().chain([packed]).flatten() {
                        assert_eq!(unpack(&form, slots, 0, &packed).as_ref(), Ok(&plain), "{form:?}");
                        digest = crc32c::crc32c_append(digest, &packed);
                    }
                }
            }
        }
    }
    // Packed bytes are equal on all processors. (Change the number if the coding changes.)
    assert_eq!(digest, 2_183_789_429);
}

#[test]
fn class_counts_come_back() {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::I16, 1));
    for height in [4, 7] {
        let form = segment(form, height, DataKind::Categorical, Rule::Majority);
        let (slots, mut plain) = random_segment(form, 5, 3);
        for (value, cells) in [(-7919i16, 3u64), (0, 1 << 40), (7919, 17), (15838, 1)] {
            plain.extend_from_slice(&value.to_le_bytes());
            plain.extend_from_slice(&cells.to_le_bytes());
        }
        let packed = pack(&form, slots, &plain).unwrap();
        assert_eq!(unpack(&form, slots, 4, &packed), Ok(plain));
        assert_eq!(unpack(&form, slots, 3, &packed), Err(Corruption("a different unpacked length")));
    }
}

#[test]
fn noise_stays_plain() {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F64, 1));
    let form = segment(form, 5, DataKind::Continuous, Rule::Mean);
    let layout = RecordLayout::new(form.form);
    let mut random = Random(7);
    let dense = Dense { kind: DenseKind::ALL_LEAF, levels: 5 };
    let mut plain: Vec<u8> = (0..dense.slots(&layout) * layout.size).map(|_| random.next() as u8).collect();
    let states = (0..4).map(|child| u32::from(INNER) << (2 * child)).sum();
    layout.write_head(
        &mut plain[..layout.size],
        RecordHead { states, skip: (dense.slots(&layout)) as u32, dense: 1 },
    );
    let slots = dense.slots(&layout) as u32;
    if let Some(packed) = pack(&form, slots, &plain) {
        assert!(packed.len() < plain.len());
        assert_eq!(unpack(&form, slots, 0, &packed), Ok(plain));
    }
}

#[test]
fn what_is_smooth_becomes_small() {
    let sizes = [SampleType::U8, SampleType::I16, SampleType::F32, SampleType::F64].map(|sample| {
        let form = TreeType::new(Dimension::Quad, ValueType::new(sample, 1));
        let form = segment(form, 5, DataKind::Continuous, Rule::Mean);
        let layout = RecordLayout::new(form.form);
        let dense = Dense { kind: DenseKind::ALL_LEAF, levels: 5 };
        let slots = dense.slots(&layout);
        let mut plain = vec![0; slots * layout.size];
        for level in 1..=5 {
            let side = 1usize << level;
            for at in 0..side * side {
                let (x, y) = ((at % side) as f64 + 0.5, (at / side) as f64 + 0.5);
                let height = (100.0 + (3.0 * x + 2.0 * y) * 32.0 / side as f64 / 4.0).floor();
                let bytes = match sample {
                    SampleType::U8 => vec![height as u8],
                    SampleType::I16 => (height as i16).to_le_bytes().to_vec(),
                    SampleType::F32 => (height as f32).to_le_bytes().to_vec(),
                    _ => height.to_le_bytes().to_vec(),
                };
                let to = layout.dense_values_at(level) + at * layout.width;
                plain[to..to + layout.width].copy_from_slice(&bytes);
            }
        }
        let states = (0..4).map(|child| u32::from(INNER) << (2 * child)).sum();
        layout.write_head(&mut plain[..layout.size], RecordHead { states, skip: (slots) as u32, dense: 1 });
        let packed = pack(&form, slots as u32, &plain).unwrap();
        assert_eq!(unpack(&form, slots as u32, 0, &packed).as_ref(), Ok(&plain));
        plain.len() / packed.len()
    });
    assert!(sizes[0] >= 2 && sizes[1] >= 4, "{sizes:?}");
}

/// Returns bytes of which 1 to 3 bits are flipped.
pub(crate) fn corrupted(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut corrupted = bytes.to_vec();
    for _ in 0..1 + random.below(3) {
        let at = random.below(corrupted.len() as u64) as usize;
        corrupted[at] ^= 1 << random.below(8);
    }
    corrupted
}

#[test]
fn corrupt_segments_are_refused() {
    let mut random = Random(11);
    for (dimension, kind, rule) in [
        (Dimension::Quad, DataKind::Categorical, Rule::Majority),
        (Dimension::Quad, DataKind::Continuous, Rule::Mean),
        (Dimension::Oct, DataKind::Continuous, Rule::Mean),
        (Dimension::Oct, DataKind::Categorical, Rule::Dominant),
    ] {
        let form = TreeType::new(dimension, ValueType::new(SampleType::U8, 1));
        let form = segment(form, 7, kind, rule);
        let (slots, plain) = random_segment(form, 3, 5);
        let models = [Model::Names, Model::Numbers].map(|model| pack_by(model, &form, slots, &plain));
        let packed = models.into_iter().flatten().min_by_key(Vec::len).unwrap();
        for length in 0..packed.len().min(64) {
            assert!(unpack(&form, slots, 0, &packed[..length]).is_err());
        }
        for _ in 0..500 {
            let corrupted = corrupted(&packed, &mut random);
            // (Some bits have no effect: then the segment is the same.)
            if let Ok(unpacked) = unpack(&form, slots, 0, &corrupted) {
                assert_eq!(unpacked, plain);
            }
        }
        for _ in 0..500 {
            let noise: Vec<u8> = (0..random.below(200)).map(|_| random.next() as u8).collect();
            let model = [noise.get(..4).unwrap_or(&[0; 4]), &[random.below(5) as u8], &noise].concat();
            assert!(unpack(&form, slots, 3, &model).is_err());
        }
        for wrong in [0, 1, slots - 1, slots + 1] {
            assert!(unpack(&form, wrong, 0, &packed).is_err());
        }
    }
}

#[test]
fn records_that_claim_others_are_not_packed() {
    let form = segment(
        TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1)),
        20,
        DataKind::Categorical,
        Rule::Majority,
    );
    let layout = RecordLayout::new(form.form);
    // All children of each record are INNER, but take no record slots.
    let mut plain = vec![0; 64 * layout.size];
    for record in plain.chunks_exact_mut(layout.size) {
        layout.write_head(record, RecordHead { states: 0b1010_1010, skip: 0, dense: 0 });
    }
    assert_eq!(pack(&form, 64, &plain), None);
    assert_eq!(pack(&form, 65, &plain), None);
}

/// Returns runs of random trees of several heights.
fn random_runs(form: &RunForm, count: u64, seed: u64) -> Vec<RunRecords<Vec<u8>>> {
    let run = |number| {
        let height = if number % 7 == 6 { form.reach + 2 } else { form.reach };
        let segment =
            SegmentForm { form: form.form, rule: form.rule, kind: form.kind, height, reach: form.reach };
        let (_, records) = random_segment(segment, 3, seed * 100 + number);
        RunRecords { height, representative: records[..form.form.width()].to_vec(), records }
    };
    (0..count).map(run).collect()
}

fn as_slices(runs: &[RunRecords<Vec<u8>>]) -> Vec<RunRecords<&[u8]>> {
    runs.iter()
        .map(|run| RunRecords {
            height: run.height,
            representative: &run.representative[..],
            records: &run.records[..],
        })
        .collect()
}

#[test]
fn runs_come_back_in_fewer_bytes_than_one_by_one() {
    let mut seed = 0;
    for dimension in [Dimension::Quad, Dimension::Oct] {
        for value in value_types() {
            for (kind, rule) in [
                (DataKind::Categorical, Rule::Majority),
                (DataKind::Continuous, Rule::Mean),
                (DataKind::Continuous, Rule::Occupancy),
            ] {
                seed += 1;
                let form = RunForm { form: TreeType::new(dimension, value), rule, kind, reach: 3 };
                let runs = random_runs(&form, 12, seed);
                let side_bytes: Vec<u8> = (0..seed * 3).map(|at| (at % 5) as u8).collect();
                let length = side_bytes.len() + runs.iter().map(|run| run.records.len()).sum::<usize>();
                let slices = as_slices(&runs);
                let Some(packed) = pack_runs(&form, &slices, &side_bytes) else {
                    assert_ne!(kind, DataKind::Categorical, "{form:?}");
                    continue;
                };
                let others = [Model::Names, Model::Numbers];
                let others = others.map(|model| pack_runs_by(model, &form, &slices, &side_bytes));
                for packed in others.iter().flatten().chain([&packed]) {
                    let unpacked = unpack_runs(&form, runs.len(), length, packed).unwrap();
                    assert_eq!((&unpacked.runs, &unpacked.side_bytes), (&runs, &side_bytes), "{form:?}");
                }
                let alone = slices.iter().map(|run| pack_runs(&form, &[*run], &[]));
                let alone: usize =
                    alone.zip(&runs).map(|(one, run)| one.map_or(run.records.len(), |one| one.len())).sum();
                assert!(kind == DataKind::Continuous || packed.len() < alone, "{} {alone}", packed.len());
            }
        }
    }
}

#[test]
fn corrupt_runs_are_refused() {
    let mut random = Random(13);
    for (dimension, kind, rule) in [
        (Dimension::Quad, DataKind::Categorical, Rule::Majority),
        (Dimension::Oct, DataKind::Continuous, Rule::Mean),
        (Dimension::Quad, DataKind::Continuous, Rule::Mean),
    ] {
        let form = RunForm {
            form: TreeType::new(dimension, ValueType::new(SampleType::U8, 1)),
            rule,
            kind,
            reach: 3,
        };
        let runs = random_runs(&form, 20, 5);
        let side_bytes = b"the side bytes, etc.".repeat(3);
        let length = side_bytes.len() + runs.iter().map(|run| run.records.len()).sum::<usize>();
        let slices = as_slices(&runs);
        let models =
            [Model::Names, Model::Numbers].map(|model| pack_runs_by(model, &form, &slices, &side_bytes));
        let packed = models.into_iter().flatten().min_by_key(Vec::len).unwrap();
        for _ in 0..500 {
            let corrupted = corrupted(&packed, &mut random);
            if let Ok(unpacked) = unpack_runs(&form, runs.len(), length, &corrupted) {
                assert_eq!((unpacked.runs, unpacked.side_bytes), (runs.clone(), side_bytes.clone()));
            }
        }
        for (count, length) in [(19, length), (21, length), (20, length - 1), (20, 0)] {
            assert!(unpack_runs(&form, count, length, &packed).is_err());
        }
        for _ in 0..500 {
            let noise: Vec<u8> = (0..random.below(200)).map(|_| random.next() as u8).collect();
            let start = [&[0; 4][..], &[random.below(5) as u8], &noise].concat();
            assert!(unpack_runs(&form, 20, 1 << 20, &start).is_err());
        }
    }
}
