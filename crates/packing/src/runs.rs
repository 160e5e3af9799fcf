//! Runs of records, packed together: adaptive probabilities carry over from each run to the next.

use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule};
use spinney_container::RecordLayout;

use crate::adaptive::{Adaptive, AdaptiveSymbols, SYMBOLS};
use crate::bits::{BitCoder, BitReader, BitWriter};
use crate::blocks::{NumberBlock, copy_values};
use crate::groups::Group;
use crate::model::{Model, ModelCoder, NO_VALUE, ParsedRecords, RunLimits, distinct, symbol_of};
use crate::nodes::{Nodes, ROOT};
use crate::plain::slots;
use crate::segment::{Corruption, PackedRanges, write_ranges};
use crate::values::{Numbers, code_table, numbers};

/// Common properties of runs.
#[derive(Clone, Copy, Debug)]
pub struct RunForm {
    /// Quadtree or octree, and the type of the values.
    pub form: TreeType,
    /// Aggregation rule of the representatives.
    pub rule: Rule,
    /// Kind of the values: categorical or continuous.
    pub kind: DataKind,
    /// Levels of a run, unless the cells are closer.
    pub reach: u8,
}

/// Records of a node and of the nodes below it, down to a given number of levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunRecords<B> {
    /// Levels from the node down to the cells.
    pub height: u8,
    /// Value of the node, with the width of a value.
    pub representative: B,
    /// Records of the node and those below it.
    pub records: B,
}

impl RunRecords<Vec<u8>> {
    fn as_slices(&self) -> RunRecords<&[u8]> {
        RunRecords { height: self.height, representative: &self.representative, records: &self.records }
    }
}

/// Unpacked runs, and the bytes stored with them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnpackedRuns {
    /// Runs, in packing order.
    pub runs: Vec<RunRecords<Vec<u8>>>,
    /// Additional bytes that were packed with the runs.
    pub side_bytes: Vec<u8>,
}

/// Length of the prefix: the checksum of all that is packed, and the model's number.
const START: usize = 5;

/// Packs runs, and additional bytes. Returns `None` if the result is not smaller.
pub fn pack_runs(form: &RunForm, runs: &[RunRecords<&[u8]>], side_bytes: &[u8]) -> Option<Vec<u8>> {
    pack_runs_by(Model::of(form.form.value, form.rule, form.kind), form, runs, side_bytes)
}

/// Packs runs with any of the models that readers support.
pub(crate) fn pack_runs_by(
    model: Model,
    form: &RunForm,
    runs: &[RunRecords<&[u8]>],
    side_bytes: &[u8],
) -> Option<Vec<u8>> {
    let length = side_bytes.len() + runs.iter().map(|run| run.records.len()).sum::<usize>();
    let packed = pack_as(model, form, runs, (side_bytes, length))?;
    (packed.len() < length).then_some(packed)
}

fn pack_as(
    model: Model,
    form: &RunForm,
    runs: &[RunRecords<&[u8]>],
    (side_bytes, length): (&[u8], usize),
) -> Option<Vec<u8>> {
    let layout = RecordLayout::new(form.form);
    let taken = runs.iter().map(|run| ParsedRecords::new(model, &layout, form.form, run.records));
    let mut taken = taken.collect::<Option<Vec<_>>>()?;
    let own = runs.iter().filter(|_| model != Model::Solid).map(|run| numbers(form.form, run.representative));
    let known = distinct(form.form, taken.iter().flat_map(ParsedRecords::values).chain(own));
    taken.iter_mut().try_for_each(|taken| taken.set_symbols(form.form, &known))?;
    let mut writer = BitWriter::default();
    let contents = Contents { runs, taken: &taken, known: &known, side_bytes };
    let (coded, mut blocks) = code_runs(&mut writer, model, form, (runs.len(), length, length), &contents)?;
    let mut packed = checksum(runs.iter().copied(), side_bytes).to_le_bytes().to_vec();
    packed.push(model as u8);
    // (Only what unpacks to the same bytes is written. See `pack_as` in `segment.rs` for what this
    // check covers.)
    let records = runs.iter().flat_map(|run| run.records).copied().collect::<Vec<u8>>();
    let (mut written, lengths) = coded.write(&layout, &mut blocks)?;
    let is_same = |((run, coded), length): ((&RunRecords<&[u8]>, &RunNodes), usize)| {
        length == run.records.len() && coded.representative == run.representative
    };
    if written.len() != records.len() || !runs.iter().zip(&coded.runs).zip(lengths).all(is_same) {
        return None;
    }
    let groups = Group::all(&layout, &blocks);
    copy_values(form.form, (&blocks, &groups), &records, &mut written);
    if written != records {
        return None;
    }
    let numbers = (&blocks[..], &groups[..], &records[..]);
    write_ranges(writer, (model, form.form, form.rule), numbers, &mut packed);
    Some(packed)
}

/// Unpacks `count` runs, and the additional bytes, which take at most `most` bytes together.
///
/// # Errors
/// If the bytes are not those of such runs.
pub fn unpack_runs(
    form: &RunForm,
    count: usize,
    most: usize,
    packed: &[u8],
) -> Result<UnpackedRuns, Corruption> {
    let (start, rest) = packed.split_at_checked(START).ok_or(Corruption("too few bytes"))?;
    let model = Model::from_number(start[4], form.form.value)?;
    let ranges = PackedRanges::of(model, rest).ok_or(Corruption("invalid lengths of packed ranges"))?;
    let mut reader = BitReader::new(ranges.nodes).ok_or(Corruption("too few bytes of coder states"))?;
    let contents = Contents { runs: &[], taken: &[], known: &[], side_bytes: &[] };
    let coded = code_runs(&mut reader, model, form, (count, most, 0), &contents);
    let (coded, mut blocks) = coded.ok_or(Corruption("invalid records"))?;
    if !reader.is_whole() {
        return Err(Corruption("a different unpacked length"));
    }
    let (mut records, lengths) =
        coded.write(&RecordLayout::new(form.form), &mut blocks).ok_or(Corruption("invalid records"))?;
    let numbers = ranges.unpack_blocks(form.form, form.rule, (&blocks, &mut records));
    numbers.ok_or(Corruption("invalid numbers"))?;
    let mut rest = &records[..];
    let runs = coded.runs.into_iter().zip(lengths).map(|(run, length)| {
        let (records, others) = rest.split_at(length);
        rest = others;
        RunRecords { height: run.height, representative: run.representative, records: records.to_vec() }
    });
    let unpacked = UnpackedRuns { runs: runs.collect(), side_bytes: coded.side_bytes };
    let found = checksum(unpacked.runs.iter().map(RunRecords::as_slices), &unpacked.side_bytes);
    if found.to_le_bytes() != start[..4] {
        return Err(Corruption("a different checksum"));
    }
    Ok(unpacked)
}

/// Computes the checksum of consecutive runs and of the additional bytes.
fn checksum<'r>(runs: impl Iterator<Item = RunRecords<&'r [u8]>>, side_bytes: &[u8]) -> u32 {
    let of_runs = runs.fold(0, |sum, run| {
        let sum = crc32c::crc32c_append(sum, &[run.height]);
        crc32c::crc32c_append(crc32c::crc32c_append(sum, run.representative), run.records)
    });
    crc32c::crc32c_append(of_runs, side_bytes)
}

/// Contents to be written; empty for a reader.
struct Contents<'c> {
    runs: &'c [RunRecords<&'c [u8]>],
    taken: &'c [ParsedRecords<'c>],
    /// Values, by symbol less [`crate::nodes::FIRST_VALUE`].
    known: &'c [Numbers],
    side_bytes: &'c [u8],
}

/// Runs as nodes.
struct AllRunNodes {
    coder: ModelCoder,
    runs: Vec<RunNodes>,
    /// Total length of all records, in bytes.
    length: usize,
    side_bytes: Vec<u8>,
}

/// Run as nodes.
struct RunNodes {
    height: u8,
    representative: Vec<u8>,
    nodes: Nodes,
    /// Number of dense blocks of numbers.
    blocks: usize,
}

impl AllRunNodes {
    /// Writes the records of all runs. Returns them with the length of each run. Dense blocks get
    /// their offsets, but no numbers yet. Returns `None` if the total length is not the stored one.
    fn write(&self, layout: &RecordLayout, blocks: &mut [NumberBlock]) -> Option<(Vec<u8>, Vec<usize>)> {
        let (mut records, mut lengths, mut blocks) = (Vec::new(), Vec::new(), blocks);
        for run in &self.runs {
            let (own, others) = blocks.split_at_mut_checked(run.blocks)?;
            blocks = others;
            let start = records.len();
            self.coder.write(&run.nodes, own, self.length / layout.size, &mut records)?;
            lengths.push(records.len() - start);
        }
        (records.len() == self.length).then_some((records, lengths))
    }
}

/// Codes `count` runs and the additional bytes, which take `length` bytes together, and at most
/// `most`. Returns both, and the dense blocks of numbers in their order.
fn code_runs<K: BitCoder>(
    coder: &mut K,
    model: Model,
    form: &RunForm,
    (count, most, length): (usize, usize, usize),
    contents: &Contents<'_>,
) -> Option<(AllRunNodes, Vec<NumberBlock>)> {
    let layout = RecordLayout::new(form.form);
    let length = usize::try_from(coder.number(length as u64)).ok().filter(|length| *length <= most)?;
    let (mut rest, mut heights) = (length, [Adaptive::default(); 1 << HEIGHT_BITS]);
    let side_bytes = code_bytes(coder, contents.side_bytes, &mut rest)?;
    // (Each value takes its width in the records, except those of the runs' own nodes.)
    let table = match model.has_table() {
        true => code_table(coder, form.form, contents.known, length / layout.width + count)?,
        false => contents.known.to_vec(),
    };
    let mut model_coder = ModelCoder::new(model, form.form, &table);
    let (mut before, none, records) = (None, Nodes::default(), rest);
    let (mut runs, mut all_blocks) = (Vec::new(), Vec::new());
    for number in 0..count {
        let truth = contents.runs.get(number);
        let nodes = contents.taken.get(number).map_or(&none, ParsedRecords::nodes);
        let height = code_height(coder, &mut heights, truth.map_or(1, |run| run.height))?;
        let own = truth.map_or(&[0; 16][..], |run| run.representative);
        let (root, value) = match model {
            Model::Solid => (NO_VALUE, [coder.short(own[0].into(), 8) as u8; 16]),
            _ => {
                let symbol = truth
                    .map_or(Some(0), |_| symbol_of(form.form, contents.known, &numbers(form.form, own)))?;
                let symbol = model_coder.representative(coder, symbol, before)?;
                before = Some(symbol);
                (symbol, model_coder.value(symbol))
            }
        };
        let limits = RunLimits { height, reach: form.reach, length: rest };
        let mut blocks = contents.taken.get(number).map_or(Vec::new(), |taken| taken.blocks(&layout));
        let nodes = model_coder.run(coder, limits, (nodes, root), &mut blocks)?;
        // Invariant: each run reduces the bytes left for the others. So however many runs a file
        // claims, together they take no more than `most` bytes.
        rest = rest.checked_sub(slots(&layout, &nodes, ROOT)? * layout.size)?;
        let representative = value[..layout.width].to_vec();
        runs.push(RunNodes { height, representative, nodes, blocks: blocks.len() });
        all_blocks.append(&mut blocks);
    }
    Some((AllRunNodes { coder: model_coder, runs, length: records, side_bytes }, all_blocks))
}

/// Bits of a run's height.
const HEIGHT_BITS: u32 = 5;

/// Codes a height, bit by bit, each in the context of those above. Returns `None` if it is 0, that
/// of a cell.
fn code_height<K: BitCoder>(coder: &mut K, contexts: &mut [Adaptive], height: u8) -> Option<u8> {
    let mut path = 1;
    for bit in (0..HEIGHT_BITS).rev() {
        let is_set = coder.bit(&mut contexts[path], height >> bit & 1 == 1);
        path = path << 1 | usize::from(is_set);
    }
    Some((path & 31) as u8).filter(|height| *height > 0)
}

/// Codes bytes: the upper four bits of each, then the lower four in the context of the upper ones.
/// Returns `None` if more than `rest` bytes are left.
fn code_bytes<K: BitCoder>(coder: &mut K, bytes: &[u8], rest: &mut usize) -> Option<Vec<u8>> {
    let count = usize::try_from(coder.number(bytes.len() as u64)).ok()?;
    *rest = rest.checked_sub(count)?;
    let (mut upper, mut lower) = (AdaptiveSymbols::default(), [AdaptiveSymbols::default(); SYMBOLS]);
    let mut coded = Vec::with_capacity(count);
    for at in 0..count {
        let byte = bytes.get(at).copied().unwrap_or_default();
        let high = coder.symbol(&mut upper, usize::from(byte >> 4));
        let low = coder.symbol(&mut lower[high], usize::from(byte & 15));
        coded.push((high << 4 | low) as u8);
    }
    Some(coded)
}
