//! A whole segment: what it is taken for, and all of its parts in order.

use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule};
use spinney_container::RecordLayout;

use crate::bits::{BitCoder, BitReader, BitWriter};
use crate::blocks::{NumberBlock, copy_values, pack_blocks, unpack_blocks};
use crate::counts::{code_counts, parse_counts};
use crate::model::{Model, ModelCoder, NO_VALUE, RunRoom, Taken, distinct};
use crate::nodes::Nodes;
use crate::values::{Numbers, code_table};

/// The meaning of a segment's bytes.
#[derive(Clone, Copy, Debug)]
pub struct SegmentForm {
    /// Quadtree or octree, and the type of the values.
    pub form: TreeType,
    /// Rule of the representatives.
    pub rule: Rule,
    /// The meaning of the values.
    pub kind: DataKind,
    /// Levels from the segment's node down to the cells.
    pub height: u8,
    /// Levels from the segment's node down to where what is heavy is cut off.
    pub reach: u8,
}

/// The reason why bytes are no packed segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damage(pub &'static str);

impl Damage {
    /// None, but numbers as older versions packed them.
    pub const OLDER: Damage = Damage("the packing of numbers by an older version");
}

/// Class counts that a segment lists, at most.
const MAX_COUNTS: usize = 1024;

/// Bytes of the checksum of the plain segment and the number of the model, which come first.
const START: usize = 5;

/// Packs a segment of so many places, whose class counts follow its records. `None` where it would not shrink.
pub fn pack(segment: &SegmentForm, places: u32, plain: &[u8]) -> Option<Vec<u8>> {
    pack_by(Model::of(segment.form.value, segment.rule, segment.kind), segment, places, plain)
}

/// Packs a segment by any of the models that readers know.
pub(crate) fn pack_by(model: Model, segment: &SegmentForm, places: u32, plain: &[u8]) -> Option<Vec<u8>> {
    let layout = RecordLayout::new(segment.form);
    let (records, counts) = plain.split_at_checked(places as usize * layout.size)?;
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
    let mut taken = Taken::new(model, layout, form, records)?;
    let counted = parse_counts(form, counts).into_iter().map(|(value, _)| value);
    // The values that there are, sorted.
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
    // Invariant: nothing is written that does not become the same bytes again. What the model has no words for (another writer's records,
    // or damaged ones) stays plain.
    let mut written = Vec::with_capacity(records.len());
    coder.write(&nodes, &mut blocks, records.len() / layout.size, &mut written)?;
    if written.len() != records.len() {
        return None;
    }
    copy_values(segment.form, &blocks, records, &mut written);
    if written != records || coded_counts != counts {
        return None;
    }
    let mut packed = crc32c::crc32c_append(crc32c::crc32c(records), counts).to_le_bytes().to_vec();
    packed.push(model as u8);
    write_parts(writer, (model, segment.form, segment.rule), (&blocks, records), &mut packed);
    Some(packed)
}

/// Unpacks a segment that has so many places and class counts.
///
/// # Errors
/// If the bytes are not those of such a segment.
pub fn unpack(segment: &SegmentForm, places: u32, classes: u16, packed: &[u8]) -> Result<Vec<u8>, Damage> {
    let layout = RecordLayout::new(segment.form);
    let length = places as usize * layout.size;
    let (start, rest) = packed.split_at_checked(START).ok_or(Damage("too few bytes"))?;
    let model = Model::from_number(start[4], segment.form.value)?;
    let parts = Parts::of(model, rest).ok_or(Damage("parts that cannot be"))?;
    let mut reader = BitReader::new(parts.nodes).ok_or(Damage("no states"))?;
    let mut blocks = Vec::new();
    let none = Nodes::default();
    let contents = Contents { nodes: &none, table: &[], known: &[], counts: &[] };
    let coded = code_segment(&mut reader, model, segment, &layout, length, contents, &mut blocks);
    let (coder, nodes, counts) = coded.ok_or(Damage("nodes that cannot be"))?;
    let mut plain = Vec::with_capacity(length + counts.len());
    let written = coder.write(&nodes, &mut blocks, places as usize, &mut plain);
    written.ok_or(Damage("records that cannot be"))?;
    let numbers = parts.unpack_blocks(segment.form, segment.rule, (&blocks, &mut plain));
    numbers.ok_or(Damage("numbers that cannot be"))?;
    let is_whole = reader.is_whole() && plain.len() == length;
    plain.extend_from_slice(&counts);
    if !is_whole || counts.len() != usize::from(classes) * (layout.width + 8) {
        return Err(Damage("another length"));
    }
    if crc32c::crc32c(&plain).to_le_bytes() != start[..4] {
        return Err(Damage("another checksum"));
    }
    Ok(plain)
}

/// Bytes of what is adaptive, and of the numbers of dense blocks, if there are some.
pub(crate) struct Parts<'p> {
    /// Bytes of a [`BitReader`].
    pub(crate) nodes: &'p [u8],
    /// Of the numbers of dense blocks the header, and the streams.
    numbers: (&'p [u8], &'p [u8]),
}

/// Writes all parts; with numbers the lengths of all but the last.
pub(crate) fn write_parts(
    writer: BitWriter,
    (model, form, rule): (Model, TreeType, Rule),
    (blocks, records): (&[NumberBlock], &[u8]),
    packed: &mut Vec<u8>,
) {
    if model != Model::Numbers {
        return writer.finish(packed);
    }
    let mut nodes = Vec::new();
    writer.finish(&mut nodes);
    let (header, streams) = match blocks {
        [] => Default::default(),
        _ => pack_blocks(form, rule, blocks, records),
    };
    for length in [nodes.len(), header.len()] {
        write_length(length, packed);
    }
    [nodes, header, streams].iter().for_each(|part| packed.extend_from_slice(part));
}

/// Writes a length in LEB128: seven bits per byte from the lowest up, and a bit whether more follow.
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

impl<'p> Parts<'p> {
    pub(crate) fn of(model: Model, mut bytes: &'p [u8]) -> Option<Parts<'p>> {
        if model != Model::Numbers {
            return Some(Parts { nodes: bytes, numbers: Default::default() });
        }
        let (nodes, header) = (read_length(&mut bytes)?, read_length(&mut bytes)?);
        let (nodes, rest) = bytes.split_at_checked(nodes)?;
        Some(Parts { nodes, numbers: rest.split_at_checked(header)? })
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

/// All that is to be written; nothing where it is read.
struct Contents<'c> {
    nodes: &'c Nodes,
    /// Values with numbers: of all nodes, or of class counts alone where the nodes' are numbers.
    table: &'c [Numbers],
    /// Values by their symbols.
    known: &'c [Numbers],
    counts: &'c [u8],
}

/// Codes all parts of a segment, in their order: its records take `length` bytes. Tells its nodes, with the coder that knows their values, and its
/// class counts.
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
    // (Each value takes its width, in records or class counts.)
    let table = code_table(coder, form, contents.table, length / layout.width + MAX_COUNTS)?;
    let known = if model.has_table() { &table } else { contents.known };
    let mut model_coder = ModelCoder::new(model, form, known);
    let room = RunRoom { height, reach, length };
    let nodes = model_coder.run(coder, room, (contents.nodes, NO_VALUE), blocks)?;
    let all = model.has_table().then_some(&nodes);
    let counts = code_counts(coder, (form, height), &table, all, contents.counts);
    Some((model_coder, nodes, counts))
}
