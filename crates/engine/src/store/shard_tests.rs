//! Tests of shards: merged shards have the same bytes as a single-process build, and corrupt or
//! malicious shard files cause errors and nothing worse.

use std::fs;
use std::io;
use std::path::Path;

use super::builder::Packing;
use super::goblin::{Shard, ShardRange, merge_shards};
use super::{BuildOptions, Slab, Slabs, TreeWriter};
use crate::tree::{Child, Children, Source};
use spinney_base::io::Output;
use spinney_base::space::{Code, CodeRange, Dimension};
use spinney_base::value::{DataKind, Mask, Number, Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_container::{Codec, LevelCounts, Metadata, ShardSummary, SummaryWriter};

use crate::store::builder::ReusableSource;

/// A layer of a test, and whether it is built from slabs or from a source.
struct Layer {
    form: TreeType,
    extent: [u64; 3],
    depth: u8,
    kind: DataKind,
    rule: Rule,
    packing: Packing,
    /// Number of distinct values.
    values: u64,
    from_source: bool,
}

fn layer(dimension: Dimension, depth: u8, extent: [u64; 3]) -> Layer {
    let form = TreeType::new(dimension, ValueType::new(SampleType::U8, 1));
    let (kind, rule, packing) = (DataKind::Continuous, Rule::Mean, Packing::default());
    Layer { form, extent, depth, kind, rule, packing, values: 200, from_source: false }
}

fn mixed(seed: u64) -> u64 {
    let mut x = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

impl Layer {
    /// Returns the number in a cell; `None` is VOID. Some squares have one value, some are VOID,
    /// some are noise.
    fn number(&self, cell: [u64; 3]) -> Option<u64> {
        let square = mixed(cell[0] / 96 + ((cell[1] / 96) << 16) + ((cell[2] / 96) << 32));
        match square % 5 {
            0 => None,
            1 => Some(square / 5 % self.values),
            2 => Some((cell[0] / 7 + cell[1] / 5 + cell[2]) % self.values),
            _ => Some(mixed(cell[0] + (cell[1] << 20) + (cell[2] << 40) + 1) % self.values),
        }
    }

    fn put(&self, number: u64, bytes: &mut Vec<u8>) {
        let ValueType { sample, channels, .. } = self.form.value;
        for channel in 0..u64::from(channels) {
            let number = number + 3 * channel;
            match sample {
                SampleType::F32 => bytes.extend_from_slice(&(number as f32 * 0.37 - 5.0).to_le_bytes()),
                SampleType::F64 => bytes.extend_from_slice(&(number as f64 * 0.37 - 5.0).to_le_bytes()),
                _ => bytes.extend_from_slice(&number.to_le_bytes()[..sample.size()]),
            }
        }
    }

    fn options(&self, name: &str) -> BuildOptions {
        let metadata = Metadata { name: name.into(), ..Metadata::default() };
        BuildOptions::new(self.kind, self.depth)
            .rule(self.rule)
            .packing(self.packing)
            .memory(1 << 20)
            .metadata(metadata)
    }

    fn write(&self, file: &mut TreeWriter, name: &str) -> Result<()> {
        if self.from_source {
            return file.source(&Sparse(self), self.extent, &self.options(name), &()).map(|_| ());
        }
        let height = if self.form.dimension == Dimension::Quad { 8 } else { 6 };
        let blocks = self.depth.saturating_sub(height);
        let number = self.form.dimension.cells(blocks);
        let run = file.run();
        let codes = (0..number).map(|path| Code::from_path(self.form.dimension, blocks, path).unwrap());
        let codes = codes.filter(|code| run.is_some_and(|run| run.contains(*code)));
        let mut slabs = Blocks { layer: self, codes: codes.collect(), next: 0 };
        file.slabs(self.form, &mut slabs, None, &self.options(name), &())
    }
}

/// A layer, block by block.
struct Blocks<'l> {
    layer: &'l Layer,
    codes: Vec<Code>,
    next: usize,
}

impl Slabs for Blocks<'_> {
    fn extent(&self) -> [u64; 3] {
        self.layer.extent
    }

    fn are_in_order(&self) -> bool {
        true
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        loop {
            let Some(code) = self.codes.get(self.next) else { return Ok(false) };
            self.next += 1;
            let (bounds, extent) = (code.bounds(self.layer.depth), self.layer.extent);
            let max: [u64; 3] = std::array::from_fn(|axis| bounds.max[axis].min(extent[axis]));
            if (0..3).any(|axis| bounds.min[axis] >= max[axis]) {
                continue;
            }
            let (mut bytes, mut valid) = (Vec::new(), Vec::new());
            for z in bounds.min[2]..max[2] {
                for y in bounds.min[1]..max[1] {
                    for x in bounds.min[0]..max[0] {
                        let number = self.layer.number([x, y, z]);
                        valid.push(number.is_some());
                        self.layer.put(number.unwrap_or(0), &mut bytes);
                    }
                }
            }
            let size = std::array::from_fn(|axis| max[axis] - bounds.min[axis]);
            *slab = Slab { origin: bounds.min, size, bytes, valid: Some(valid) };
            return Ok(true);
        }
    }
}

/// The first cells of the diagonal, and a large square off the diagonal: a source for any depth.
struct Sparse<'l>(&'l Layer);

impl Sparse<'_> {
    fn node(&self, code: Code) -> Child<Code> {
        let depth = self.0.depth;
        let (cells, side) = (code.bounds(depth), 1u64 << depth);
        let mut bytes = Vec::new();
        self.0.put(7, &mut bytes);
        let (full, half) = (Value::from_bytes(&bytes), side / 2);
        let is_square = cells.min[0] >= half && cells.max[1] <= half;
        let axes = self.0.form.axes();
        let meets = cells.min[0] < 1000
            && (0..axes).all(|axis| cells.min[axis] < cells.max[0] && cells.min[0] < cells.max[axis]);
        match () {
            () if is_square => Child::Leaf(full),
            () if meets && code.level() == depth => Child::Leaf(full),
            () if meets || code.level() == 0 => Child::Inner { representative: full, node: code },
            () => Child::Void,
        }
    }
}

impl Source for Sparse<'_> {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.0.form
    }

    fn depth(&self) -> u8 {
        self.0.depth
    }

    fn root(&self) -> Result<Child<Code>> {
        Ok(self.node(Code::root(self.0.form.dimension)))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        let count = self.0.form.children();
        (0..count).for_each(|child| children[child] = self.node(node.child(child)));
        Ok(())
    }
}

impl ReusableSource for Sparse<'_> {}

/// Divides layers into shards, which are cut at random nodes of `shard_level`.
fn cut(directory: &Path, layers: &[Layer], count: u64, seed: u64) -> Vec<Shard> {
    // Node counts of all layers; nodes are numbered consecutively across layers.
    let nodes: Vec<u64> = layers
        .iter()
        .map(|layer| {
            layer
                .form
                .dimension
                .cells(layer.options("").header(layer.form, layer.extent).unwrap().shape.shard_level())
        })
        .collect();
    let all: u64 = nodes.iter().sum();
    let mut cuts: Vec<u64> = (1..count).map(|cut| mixed(seed * 1000 + cut) % (all + 1)).collect();
    cuts.extend([0, all]);
    cuts.sort_unstable();
    let shard = |(number, ends): (usize, &[u64])| {
        let (mut ranges, mut before) = (Vec::new(), 0);
        for ((number, layer), count) in (0..).zip(layers).zip(&nodes) {
            let first = ends[0].max(before) - before.min(ends[0].max(before));
            let end = ends[1].min(before + count).saturating_sub(before);
            if first < end {
                let header = layer.options("").header(layer.form, layer.extent).unwrap();
                let node =
                    |path| Code::from_path(layer.form.dimension, header.shape.shard_level(), path).unwrap();
                ranges.push(ShardRange {
                    layer: number,
                    run: CodeRange::of(node(first), node(end - 1)).unwrap(),
                });
            }
            before += count;
        }
        let (job, access) = (u128::from(seed) << 64 | 5, Default::default());
        Shard { directory: directory.into(), job, number: number as u32, ranges, access }
    };
    cuts.windows(2).enumerate().map(shard).collect()
}

fn write(mut file: TreeWriter, layers: &[Layer]) -> Result<()> {
    for (number, layer) in layers.iter().enumerate() {
        let name = if layers.len() > 1 { format!("layer {number}") } else { String::new() };
        layer.write(&mut file, &name)?;
    }
    file.finish()
}

/// Builds layers in a single process and with each number of shards: the bytes must be the same.
fn compare(layers: &[Layer], counts: &[u64]) {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let space = (layers[0].form.dimension, layers.iter().map(|layer| layer.depth).max().unwrap());
    let output = |name: &str| Output::create(&directory.join(name)).unwrap();
    let many = layers.len() as u32;
    write(TreeWriter::create(output("whole.goblin"), space, many).unwrap(), layers).unwrap();
    let whole = fs::read(directory.join("whole.goblin")).unwrap();
    let head = directory.join("head.goblin");
    write(TreeWriter::head(output("head.goblin"), space, many).unwrap(), layers).unwrap();
    for count in counts {
        let shards = directory.join(format!("{count}"));
        fs::create_dir(&shards).unwrap();
        let shards = cut(&shards, layers, *count, count + 17);
        assert!(shards.iter().all(|shard| ShardSummary::<LevelCounts>::find(shard).unwrap().is_none()));
        for shard in shards.iter().rev() {
            write(TreeWriter::shard(&head, shard.clone()).unwrap(), layers).unwrap();
        }
        merge_shards(&head, &shards, output("merged.goblin").into(), 1 << 20, &()).unwrap();
        assert!(fs::read(directory.join("merged.goblin")).unwrap() == whole, "{count} shards");
    }
}

const COUNTS: [u64; 4] = [1, 2, 7, 64];

#[test]
fn shards_make_the_bytes_of_one_build() {
    use Dimension::{Oct, Quad};
    for (depth, extent) in [
        (0, [1, 1, 1]),
        (5, [20, 32, 1]),
        (8, [256, 200, 1]),
        (9, [512, 260, 1]),
        (10, [260, 1024, 1]),
        (11, [1030, 300, 1]),
        (12, [2060, 20, 1]),
        (13, [10, 8000, 1]),
    ] {
        compare(&[layer(Quad, depth, extent)], &COUNTS);
    }
    for (depth, extent) in
        [(0, [1, 1, 1]), (6, [64, 50, 33]), (7, [128, 66, 20]), (8, [130, 66, 65]), (10, [1000, 66, 2])]
    {
        compare(&[layer(Oct, depth, extent)], &COUNTS);
    }
}

#[test]
fn shards_make_them_by_all_rules_and_types() {
    let types = [
        ValueType::new(SampleType::U8, 3),
        ValueType::new(SampleType::F32, 1),
        ValueType::new(SampleType::F32, 3),
        ValueType::new(SampleType::F64, 1),
        ValueType::new(SampleType::U64, 1),
        ValueType::new(SampleType::U16, 3).with_missing(Number::Unsigned(3)),
        ValueType::new(SampleType::U8, 4).with_alpha(),
    ];
    for (number, value) in types.into_iter().enumerate() {
        let rule = Rule::ALL[number % Rule::ALL.len()];
        let mut layer = layer(Dimension::Quad, 10, [520, 260, 1]);
        (layer.form.value, layer.rule) = (value, rule);
        assert!(value.mask != Mask::None || number < 5);
        compare(&[layer], &[1, 7]);
    }
    for rule in Rule::ALL {
        let mut layer = layer(Dimension::Oct, 8, [130, 66, 20]);
        layer.rule = rule;
        compare(&[layer], &[7]);
    }
}

#[test]
fn shards_count_more_classes_than_files_list() {
    for rule in [Rule::Majority, Rule::Dominant] {
        let mut layer = layer(Dimension::Quad, 11, [1030, 260, 1]);
        layer.form.value = ValueType::new(SampleType::U16, 1);
        (layer.kind, layer.rule, layer.values) = (DataKind::Categorical, rule, 5000);
        compare(&[layer], &[1, 7, 64]);
    }
}

#[test]
fn shards_are_packed_and_rounded_as_files_are() {
    for (max_error, sample) in [(None, SampleType::U8), (Some(0.5), SampleType::F32)] {
        let mut layer = layer(Dimension::Quad, 10, [520, 260, 1]);
        layer.form.value = ValueType::new(sample, 1);
        layer.packing = Packing { codec: Codec::Packed, max_error };
        compare(&[layer], &[1, 7]);
    }
}

#[test]
fn shards_of_sources_and_of_layers_of_several_depths() {
    for (dimension, depth) in
        [(Dimension::Quad, 18), (Dimension::Quad, 12), (Dimension::Oct, 13), (Dimension::Quad, 3)]
    {
        let side = 1 << depth;
        let mut layer =
            layer(dimension, depth, [side, side, if dimension == Dimension::Oct { side } else { 1 }]);
        layer.from_source = true;
        compare(&[layer], &COUNTS);
    }
    let mut coarse = layer(Dimension::Quad, 9, [400, 300, 1]);
    coarse.form.value = ValueType::new(SampleType::F32, 1);
    let layers =
        [layer(Dimension::Quad, 11, [1030, 260, 1]), coarse, layer(Dimension::Quad, 7, [100, 75, 1])];
    compare(&layers, &COUNTS);
}

/// A job of two small shards.
fn small_job(directory: &Path) -> (std::path::PathBuf, Vec<Shard>) {
    let mut layer = layer(Dimension::Quad, 10, [1024, 1024, 1]);
    (layer.from_source, layer.kind, layer.rule) = (true, DataKind::Categorical, Rule::Majority);
    let layers = [layer];
    let head = directory.join("head.goblin");
    write(TreeWriter::head(Output::create(&head).unwrap(), (Dimension::Quad, 10), 1).unwrap(), &layers)
        .unwrap();
    let node = |path| Code::from_path(Dimension::Quad, 2, path).unwrap();
    let shard = |(number, first, last)| {
        let run = CodeRange::of(node(first), node(last)).unwrap();
        let (ranges, access) = (vec![ShardRange { layer: 0, run }], Default::default());
        Shard { directory: directory.into(), job: 77, number, ranges, access }
    };
    let shards: Vec<Shard> = [(0, 0, 5), (1, 6, 15)].map(shard).into();
    for shard in &shards {
        write(TreeWriter::shard(&head, shard.clone()).unwrap(), &layers).unwrap();
    }
    (head, shards)
}

fn merge(head: &Path, shards: &[Shard]) -> Result<()> {
    let output = Output::to_writer(Path::new("merged.goblin"), Box::new(io::sink()));
    merge_shards(head, shards, output.into(), 1 << 20, &())
}

#[test]
fn corrupt_shard_files_are_detected() {
    let directory = tempfile::tempdir().unwrap();
    let (head, shards) = small_job(directory.path());
    merge(&head, &shards).unwrap();
    let files =
        [shards[0].summary_path(), shards[1].summary_path(), shards[0].run_path(0), shards[1].run_path(0)];
    for path in files.iter().filter(|path| path.exists()) {
        let good = fs::read(path).unwrap();
        for at in (0..good.len()).step_by(1 + good.len() / 1200) {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            fs::write(path, &bad).unwrap();
            let error = merge(&head, &shards).expect_err("a bit was flipped").to_string();
            assert!(!error.is_empty(), "byte {at}");
        }
        for length in (0..good.len()).step_by(1 + good.len() / 200) {
            fs::write(path, &good[..length]).unwrap();
            merge(&head, &shards).expect_err("bytes are missing");
        }
        fs::write(path, &good).unwrap();
    }
    fs::remove_file(shards[1].summary_path()).unwrap();
    assert!(matches!(merge(&head, &shards), Err(Error::Unsupported { .. })));
}

/// Returns the bytes of a summary's only layer.
fn layer_bytes(shard: &Shard) -> Vec<u8> {
    let summary = ShardSummary::<LevelCounts>::find(shard).unwrap().unwrap();
    let mut stream = summary.bytes_of(&summary.ranges[0]).unwrap();
    let mut bytes = Vec::new();
    while !stream.is_over() {
        bytes.extend(stream.take(1).unwrap());
    }
    bytes
}

/// Writes a summary with other bytes and correct checksums.
fn forge(shard: &Shard, bytes: &[u8], run_bytes: u64, totals: LevelCounts) {
    let mut writer = SummaryWriter::new(shard).unwrap();
    writer.begin(shard.ranges[0]);
    writer.write(bytes).unwrap();
    writer.end(run_bytes, totals).unwrap();
    writer.finish().unwrap();
}

#[test]
fn corrupt_summaries_with_valid_checksums_are_handled() {
    let directory = tempfile::tempdir().unwrap();
    let (head, shards) = small_job(directory.path());
    let mut errors = 0;
    for shard in &shards {
        let path = shard.summary_path();
        let (file, good) = (fs::read(&path).unwrap(), layer_bytes(shard));
        let summary = ShardSummary::<LevelCounts>::find(shard).unwrap().unwrap();
        let (run_bytes, totals) = (summary.ranges[0].run_bytes, summary.ranges[0].totals.clone());
        forge(shard, &good, run_bytes, totals.clone());
        assert!(fs::read(&path).unwrap() == file, "a summary is rewritten unchanged");
        for at in (0..good.len()).step_by(1 + good.len() / 1200) {
            for byte in [0, 1, 0x7f, 0xff, good[at] ^ 1, good[at].wrapping_add(1)] {
                let mut bad = good.clone();
                bad[at] = byte;
                if bad != good {
                    forge(shard, &bad, run_bytes, totals.clone());
                    // (The bytes may describe another valid tree, which is no error.)
                    errors += u32::from(merge(&head, &shards).is_err());
                }
            }
        }
        for (run_bytes, counts) in [(u64::MAX, [0; 3]), (run_bytes, [u64::MAX; 3]), (run_bytes + 1, [0; 3])] {
            let mut totals = LevelCounts::default();
            totals.add(9, counts);
            forge(shard, &good, run_bytes, totals);
            merge(&head, &shards).expect_err("totals are wrong");
        }
        fs::write(&path, &file).unwrap();
    }
    assert!(errors > 100);
    merge(&head, &shards).unwrap();
}

#[test]
fn shards_that_do_not_fit_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (head, shards) = small_job(directory.path());
    let refused = |shards: &[Shard], word: &str| {
        let error = merge(&head, shards).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    };
    refused(&shards[..1], "up to the last code");
    refused(&shards[1..], "begins at");
    let other = Shard { job: 9, ..shards[0].clone() };
    refused(&[other, shards[1].clone()], "another job");
    // A tree other than the head's.
    let mut layer = layer(Dimension::Quad, 10, [1024, 1023, 1]);
    (layer.from_source, layer.kind, layer.rule) = (true, DataKind::Categorical, Rule::Majority);
    let error =
        write(TreeWriter::shard(&head, shards[0].clone()).unwrap(), &[layer]).unwrap_err().to_string();
    assert!(error.contains("was planned"), "{error}");
    merge(&head, &shards).unwrap();
}
