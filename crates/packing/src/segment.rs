//! Packing of a whole segment, with all its components in order.

use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule};
use spinney_container::RecordLayout;

use crate::bits::{BitCoder, BitReader, BitWriter};
use crate::blocks::{NumberBlock, copy_values, pack_blocks, unpack_blocks};
use crate::counts::{code_counts, parse_counts};
use crate::groups::Group;
use crate::model::{Model, ModelCoder, NO_VALUE, ParsedRecords, RunLimits, distinct};
use crate::nodes::Nodes;
use crate::values::{Numbers, code_table};

/// Properties of a segment that its bytes do not contain.
#[derive(Clone, Copy, Debug)]
pub struct SegmentForm {
    /// Quadtree or octree, and the type of the values.
    pub form: TreeType,
    /// Aggregation rule of the representatives.
    pub rule: Rule,
    /// Kind of the values: categorical or continuous.
    pub kind: DataKind,
    /// Levels from the segment's node down to the cells.
    pub height: u8,
    /// Levels from the segment's node down to the level whose nodes may be CUT.
    pub reach: u8,
}

/// Reason why bytes are not a packed segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corruption(pub &'static str);

impl Corruption {
    /// Not corruption, but numbers packed by an older version, which are no longer read.
    pub const OLDER: Corruption = Corruption("an obsolete encoding of packed numbers");
}

/// Maximum number of class counts of a segment.
const MAX_COUNTS: usize = 1024;

/// Length of the prefix: the checksum of the plain segment, and the model's number.
const START: usize = 5;

/// Packs a plain segment of `slots` record slots, followed by its class counts. Returns `None` if
/// the result is not smaller.
pub fn pack(segment: &SegmentForm, slots: u32, plain: &[u8]) -> Option<Vec<u8>> {
    pack_by(Model::of(segment.form.value, segment.rule, segment.kind), segment, slots, plain)
}

/// Packs a segment with any of the models that readers support.
pub(crate) fn pack_by(model: Model, segment: &SegmentForm, slots: u32, plain: &[u8]) -> Option<Vec<u8>> {
    let layout = RecordLayout::new(segment.form);
    let (records, counts) = plain.split_at_checked(slots as usize * layout.size)?;
    pack_as(model, segment, &layout, records, counts).filter(|packed| packed.len() < plain.len())
}

fn pack_as(
    model: Model,
    segment: &SegmentForm,
    layout: &RecordLayout,
    records: &[u8],
    counts: &[u8],
) -> Option<Vec<u8>> {
    let form = segment.form;
    let mut taken = ParsedRecords::new(model, layout, form, records)?;
    let counted = parse_counts(form, counts).into_iter().map(|(value, _)| value);
    // All values, sorted.
    let (known, table) = match model.has_table() {
        true => (distinct(form, taken.values().chain(counted)), Vec::new()),
        false => (distinct(form, taken.values()), distinct(form, counted)),
    };
    taken.set_symbols(form, &known)?;
    let mut blocks = taken.blocks(layout);
    let mut writer = BitWriter::default();
    let table = if model.has_table() { &known } else { &table };
    let contents = Contents { nodes: taken.nodes(), table, known: &known, counts };
    let (coder, nodes, coded_counts) =
        code_segment(&mut writer, model, segment, layout, records.len(), contents, &mut blocks)?;
    // Invariant: only what unpacks to the same bytes is written. Whatever the model cannot
    // represent (corrupt records, or those of another writer) stays plain. The check decodes
    // nothing. It compares records and class counts with those that follow from what the coder
    // returns, which is the same for a writer and a reader:
    // - all states, values, heads and class counts;
    // - of dense blocks of numbers, only heads, and zeros of VOID nodes and padding. Their values
    //   and masks are copied.
    // Entropy coders and predictions are reversible for all numbers. Tests verify that, and readers
    // compare the checksum.
    let mut written = Vec::with_capacity(records.len());
    coder.write(&nodes, &mut blocks, records.len() / layout.size, &mut written)?;
    if written.len() != records.len() {
        return None;
    }
    let groups = Group::all(layout, &blocks);
    copy_values(segment.form, (&blocks, &groups), records, &mut written);
    if written != records || coded_counts != counts {
        return None;
    }
    let mut packed = crc32c::crc32c_append(crc32c::crc32c(records), counts).to_le_bytes().to_vec();
    packed.push(model as u8);
    let numbers = (&blocks[..], &groups[..], records);
    write_ranges(writer, (model, segment.form, segment.rule), numbers, &mut packed);
    Some(packed)
}

/// Unpacks a segment of `slots` record slots and `classes` class counts.
///
/// # Errors
/// If the bytes are not those of such a segment.
pub fn unpack(segment: &SegmentForm, slots: u32, classes: u16, packed: &[u8]) -> Result<Vec<u8>, Corruption> {
    let layout = RecordLayout::new(segment.form);
    let length = slots as usize * layout.size;
    let (start, rest) = packed.split_at_checked(START).ok_or(Corruption("too few bytes"))?;
    let model = Model::from_number(start[4], segment.form.value)?;
    let ranges = PackedRanges::of(model, rest).ok_or(Corruption("invalid lengths of packed ranges"))?;
    let mut reader = BitReader::new(ranges.nodes).ok_or(Corruption("too few bytes of coder states"))?;
    let mut blocks = Vec::new();
    let none = Nodes::default();
    let contents = Contents { nodes: &none, table: &[], known: &[], counts: &[] };
    let coded = code_segment(&mut reader, model, segment, &layout, length, contents, &mut blocks);
    let (coder, nodes, counts) = coded.ok_or(Corruption("invalid node states or values"))?;
    let mut plain = Vec::with_capacity(length + counts.len());
    let written = coder.write(&nodes, &mut blocks, slots as usize, &mut plain);
    written.ok_or(Corruption("invalid records"))?;
    let numbers = ranges.unpack_blocks(segment.form, segment.rule, (&blocks, &mut plain));
    numbers.ok_or(Corruption("invalid numbers"))?;
    let is_whole = reader.is_whole() && plain.len() == length;
    plain.extend_from_slice(&counts);
    if !is_whole || counts.len() != usize::from(classes) * (layout.width + 8) {
        return Err(Corruption("a different unpacked length"));
    }
    if crc32c::crc32c(&plain).to_le_bytes() != start[..4] {
        return Err(Corruption("a different checksum"));
    }
    Ok(plain)
}

/// Byte ranges of the adaptive coder, and of the numbers of dense blocks, if any.
pub(crate) struct PackedRanges<'p> {
    /// Bytes of a [`BitReader`].
    pub(crate) nodes: &'p [u8],
    /// Header and streams of the numbers of dense blocks.
    numbers: (&'p [u8], &'p [u8]),
}

/// Writes all byte ranges. With numbers, the lengths of all but the last precede them.
pub(crate) fn write_ranges(
    writer: BitWriter,
    (model, form, rule): (Model, TreeType, Rule),
    (blocks, groups, records): (&[NumberBlock], &[Group], &[u8]),
    packed: &mut Vec<u8>,
) {
    if model != Model::Numbers {
        return writer.finish(packed);
    }
    let mut nodes = Vec::new();
    writer.finish(&mut nodes);
    let (header, streams) = match blocks {
        [] => Default::default(),
        _ => pack_blocks(form, rule, (blocks, groups), records),
    };
    for length in [nodes.len(), header.len()] {
        write_length(length, packed);
    }
    [nodes, header, streams].iter().for_each(|part| packed.extend_from_slice(part));
}

/// Writes a length in LEB128: seven bits per byte, from the lowest up, and a bit whether more
/// follow.
fn write_length(mut length: usize, bytes: &mut Vec<u8>) {
    while length >= 0x80 {
        bytes.push(length as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
}

fn read_length(bytes: &mut &[u8]) -> Option<usize> {
    let mut length = 0;
    for at in 0..5 {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        length |= usize::from(byte & 0x7f) << (7 * at);
        if byte & 0x80 == 0 {
            return Some(length);
        }
    }
    None
}

impl<'p> PackedRanges<'p> {
    pub(crate) fn of(model: Model, mut bytes: &'p [u8]) -> Option<PackedRanges<'p>> {
        if model != Model::Numbers {
            return Some(PackedRanges { nodes: bytes, numbers: Default::default() });
        }
        let (nodes, header) = (read_length(&mut bytes)?, read_length(&mut bytes)?);
        let (nodes, rest) = bytes.split_at_checked(nodes)?;
        Some(PackedRanges { nodes, numbers: rest.split_at_checked(header)? })
    }

    /// Reads the numbers of dense blocks into records.
    pub(crate) fn unpack_blocks(
        &self,
        form: TreeType,
        rule: Rule,
        blocks: (&[NumberBlock], &mut [u8]),
    ) -> Option<()> {
        match blocks.0 {
            [] => (self.numbers.0.is_empty() && self.numbers.1.is_empty()).then_some(()),
            _ => unpack_blocks(form, rule, blocks, self.numbers),
        }
    }
}

/// Contents to be written; empty for a reader.
struct Contents<'c> {
    nodes: &'c Nodes,
    /// Values of the table: all values, or only those of class counts if the nodes' values are
    /// numbers.
    table: &'c [Numbers],
    /// Values, by symbol less [`crate::nodes::FIRST_VALUE`].
    known: &'c [Numbers],
    counts: &'c [u8],
}

/// Codes all components of a segment in order. Its records take `length` bytes. Returns the coder,
/// which knows the nodes' values, the nodes, and the class counts.
fn code_segment<K: BitCoder>(
    coder: &mut K,
    model: Model,
    segment: &SegmentForm,
    layout: &RecordLayout,
    length: usize,
    contents: Contents<'_>,
    blocks: &mut Vec<NumberBlock>,
) -> Option<(ModelCoder, Nodes, Vec<u8>)> {
    let SegmentForm { form, height, reach, .. } = *segment;
    // (Each value takes its width in the records or in the class counts.)
    let table = code_table(coder, form, contents.table, length / layout.width + MAX_COUNTS)?;
    let known = if model.has_table() { &table } else { contents.known };
    let mut model_coder = ModelCoder::new(model, form, known);
    let limits = RunLimits { height, reach, length };
    let nodes = model_coder.run(coder, limits, (contents.nodes, NO_VALUE), blocks)?;
    let all = model.has_table().then_some(&nodes);
    let counts = code_counts(coder, (form, height), &table, all, contents.counts);
    Some((model_coder, nodes, counts))
}
