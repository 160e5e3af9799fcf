//! Runs of records, many together: what one of them has taught holds for the next ones.

use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule};
use spinney_container::RecordLayout;

use crate::adaptive::{Adaptive, AdaptiveSymbols, SYMBOLS};
use crate::bits::{BitCoder, BitReader, BitWriter};
use crate::blocks::{NumberBlock, copy_values};
use crate::model::{Model, ModelCoder, NO_VALUE, RunRoom, Taken, distinct, symbol_of};
use crate::nodes::{Nodes, ROOT};
use crate::plain::places;
use crate::segment::{Damage, Parts, write_parts};
use crate::values::{Numbers, code_table, numbers};

/// The meaning of runs.
#[derive(Clone, Copy, Debug)]
pub struct RunForm {
    /// Quadtree or octree, and the type of the values.
    pub form: TreeType,
    /// Rule of the representatives.
    pub rule: Rule,
    /// The meaning of the values.
    pub kind: DataKind,
    /// Levels of a run, where the cells are no nearer.
    pub reach: u8,
}

/// The records of a node and of those below it, down to some levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run<B> {
    /// Levels from the node down to the cells.
    pub height: u8,
    /// The node's value: so many bytes as one has.
    pub representative: B,
    /// Its records and those below it.
    pub records: B,
}

impl Run<Vec<u8>> {
    fn as_slices(&self) -> Run<&[u8]> {
        Run { height: self.height, representative: &self.representative, records: &self.records }
    }
}

/// Runs, and the bytes that belong to them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnpackedRuns {
    /// The runs, in the order in which they were packed.
    pub runs: Vec<Run<Vec<u8>>>,
    /// The bytes beside them.
    pub beside: Vec<u8>,
}

/// Bytes of the checksum of all that is packed and the number of the model, which come first.
const START: usize = 5;

/// Packs runs, and bytes that belong to them. `None` where these would not become fewer bytes.
pub fn pack_runs(form: &RunForm, runs: &[Run<&[u8]>], beside: &[u8]) -> Option<Vec<u8>> {
    pack_runs_by(Model::of(form.form.value, form.rule, form.kind), form, runs, beside)
}

/// Packs runs by any of the models that readers know.
pub(crate) fn pack_runs_by(
    model: Model,
    form: &RunForm,
    runs: &[Run<&[u8]>],
    beside: &[u8],
) -> Option<Vec<u8>> {
    let length = beside.len() + runs.iter().map(|run| run.records.len()).sum::<usize>();
    let packed = pack_as(model, form, runs, (beside, length))?;
    (packed.len() < length).then_some(packed)
}

fn pack_as(
    model: Model,
    form: &RunForm,
    runs: &[Run<&[u8]>],
    (beside, length): (&[u8], usize),
) -> Option<Vec<u8>> {
    let layout = RecordLayout::new(form.form);
    let taken = runs.iter().map(|run| Taken::new(model, &layout, form.form, run.records));
    let mut taken = taken.collect::<Option<Vec<_>>>()?;
    let own = runs.iter().filter(|_| model != Model::Solid).map(|run| numbers(form.form, run.representative));
    let known = distinct(form.form, taken.iter().flat_map(Taken::values).chain(own));
    taken.iter_mut().try_for_each(|taken| taken.set_symbols(form.form, &known))?;
    let mut writer = BitWriter::default();
    let contents = Contents { runs, taken: &taken, known: &known, beside };
    let (coded, mut blocks) = code_runs(&mut writer, model, form, (runs.len(), length, length), &contents)?;
    let mut packed = checksum(runs.iter().copied(), beside).to_le_bytes().to_vec();
    packed.push(model as u8);
    // (As it is with segments: nothing is written that does not become the same again.)
    let records = runs.iter().flat_map(|run| run.records).copied().collect::<Vec<u8>>();
    let (mut written, lengths) = coded.write(&layout, &mut blocks)?;
    let is_same = |((run, coded), length): ((&Run<&[u8]>, &CodedRun), usize)| {
        length == run.records.len() && coded.representative == run.representative
    };
    if written.len() != records.len() || !runs.iter().zip(&coded.runs).zip(lengths).all(is_same) {
        return None;
    }
    copy_values(form.form, &blocks, &records, &mut written);
    if written != records {
        return None;
    }
    write_parts(writer, (model, form.form, form.rule), (&blocks, &records), &mut packed);
    Some(packed)
}

/// Unpacks so many runs, and the bytes that belong to them, which take `most` bytes together at most.
///
/// # Errors
/// If the bytes are not those of such runs.
pub fn unpack_runs(form: &RunForm, count: usize, most: usize, packed: &[u8]) -> Result<UnpackedRuns, Damage> {
    let (start, rest) = packed.split_at_checked(START).ok_or(Damage("too few bytes"))?;
    let model = Model::from_number(start[4], form.form.value)?;
    let parts = Parts::of(model, rest).ok_or(Damage("parts that cannot be"))?;
    let mut reader = BitReader::new(parts.nodes).ok_or(Damage("no states"))?;
    let contents = Contents { runs: &[], taken: &[], known: &[], beside: &[] };
    let coded = code_runs(&mut reader, model, form, (count, most, 0), &contents);
    let (coded, mut blocks) = coded.ok_or(Damage("records that cannot be"))?;
    if !reader.is_whole() {
        return Err(Damage("another length"));
    }
    let (mut records, lengths) =
        coded.write(&RecordLayout::new(form.form), &mut blocks).ok_or(Damage("records that cannot be"))?;
    let numbers = parts.unpack_blocks(form.form, form.rule, (&blocks, &mut records));
    numbers.ok_or(Damage("numbers that cannot be"))?;
    let mut rest = &records[..];
    let runs = coded.runs.into_iter().zip(lengths).map(|(run, length)| {
        let (records, others) = rest.split_at(length);
        rest = others;
        Run { height: run.height, representative: run.representative, records: records.to_vec() }
    });
    let unpacked = UnpackedRuns { runs: runs.collect(), beside: coded.beside };
    let found = checksum(unpacked.runs.iter().map(Run::as_slices), &unpacked.beside);
    if found.to_le_bytes() != start[..4] {
        return Err(Damage("another checksum"));
    }
    Ok(unpacked)
}

/// The checksum of runs, one behind the other, and of what is beside them.
fn checksum<'r>(runs: impl Iterator<Item = Run<&'r [u8]>>, beside: &[u8]) -> u32 {
    let of_runs = runs.fold(0, |sum, run| {
        let sum = crc32c::crc32c_append(sum, &[run.height]);
        crc32c::crc32c_append(crc32c::crc32c_append(sum, run.representative), run.records)
    });
    crc32c::crc32c_append(of_runs, beside)
}

/// All that is to be written; nothing where it is read.
struct Contents<'c> {
    runs: &'c [Run<&'c [u8]>],
    taken: &'c [Taken<'c>],
    /// Values by their symbols.
    known: &'c [Numbers],
    beside: &'c [u8],
}

/// Runs as nodes.
struct CodedRuns {
    coder: ModelCoder,
    runs: Vec<CodedRun>,
    /// Bytes of all records at most.
    length: usize,
    beside: Vec<u8>,
}

/// A run as nodes.
struct CodedRun {
    height: u8,
    representative: Vec<u8>,
    nodes: Nodes,
    /// Dense blocks of numbers.
    blocks: usize,
}

impl CodedRuns {
    /// The records of all runs, and how many bytes each takes; dense blocks have no numbers yet, and get their offsets.
    /// `None` if they take another length than is stored.
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

/// Codes runs, of which there are so many, that take `length` bytes, and no more than `most`, with what is beside them. Tells both, and the dense
/// blocks of numbers in their order.
fn code_runs<K: BitCoder>(
    coder: &mut K,
    model: Model,
    form: &RunForm,
    (count, most, length): (usize, usize, usize),
    contents: &Contents<'_>,
) -> Option<(CodedRuns, Vec<NumberBlock>)> {
    let layout = RecordLayout::new(form.form);
    let length = usize::try_from(coder.number(length as u64)).ok().filter(|length| *length <= most)?;
    let (mut rest, mut heights) = (length, [Adaptive::default(); 1 << HEIGHT_BITS]);
    let beside = code_bytes(coder, contents.beside, &mut rest)?;
    // (Each value takes its width in records, but for those of the runs' own nodes.)
    let table = match model.has_table() {
        true => code_table(coder, form.form, contents.known, length / layout.width + count)?,
        false => contents.known.to_vec(),
    };
    let mut model_coder = ModelCoder::new(model, form.form, &table);
    let (mut before, none, records) = (None, Nodes::default(), rest);
    let (mut runs, mut all_blocks) = (Vec::new(), Vec::new());
    for number in 0..count {
        let truth = contents.runs.get(number);
        let nodes = contents.taken.get(number).map_or(&none, Taken::nodes);
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
        let room = RunRoom { height, reach: form.reach, length: rest };
        let mut blocks = contents.taken.get(number).map_or(Vec::new(), |taken| taken.blocks(&layout));
        let nodes = model_coder.run(coder, room, (nodes, root), &mut blocks)?;
        // Invariant: what runs may take gets less by what each takes. So however many runs there are said to be, all of them
        // together take no more than their bytes do.
        rest = rest.checked_sub(places(&layout, &nodes, ROOT)? * layout.size)?;
        let representative = value[..layout.width].to_vec();
        runs.push(CodedRun { height, representative, nodes, blocks: blocks.len() });
        all_blocks.append(&mut blocks);
    }
    Some((CodedRuns { coder: model_coder, runs, length: records, beside }, all_blocks))
}

/// Bits of a run's height.
const HEIGHT_BITS: u32 = 5;

/// Codes a height, bit by bit in the context of those above. `None` if it is that of a cell.
fn code_height<K: BitCoder>(coder: &mut K, contexts: &mut [Adaptive], height: u8) -> Option<u8> {
    let mut path = 1;
    for bit in (0..HEIGHT_BITS).rev() {
        let is_set = coder.bit(&mut contexts[path], height >> bit & 1 == 1);
        path = path << 1 | usize::from(is_set);
    }
    Some((path & 31) as u8).filter(|height| *height > 0)
}

/// Codes bytes, each by its upper four bits and by the lower ones in the context of these; no more than there is room for.
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
