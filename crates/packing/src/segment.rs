//! A whole segment: what it is taken for, and all of its parts in order.

use spinney_base::Form;
use spinney_base::value::{Kind, Rule, SampleType, ValueType};
use spinney_container::{INNER, RecordLayout, VOID};

use crate::bits::{BitCoder, BitReader, BitWriter};
use crate::blocks::{BlockContexts, NumberBlock, code_block};
use crate::counts::{code_counts, parse_counts};
use crate::fullness::code_fullness;
use crate::nodes::{FIRST_VALUE, MIXED, NOTHING, NewValues, NodeForm, Nodes, ROOT, code_nodes};
use crate::plain::{Parsed, Writer, parse};
use crate::values::{NumberValues, Numbers, TableValues, bytes, code_table, numbers, order};

/// The meaning of a segment's bytes.
#[derive(Clone, Copy, Debug)]
pub struct SegmentForm {
    /// Quadtree or octree, and the type of the values.
    pub form: Form,
    /// Rule of the representatives.
    pub rule: Rule,
    /// The meaning of the values.
    pub kind: Kind,
    /// Levels from the segment's node down to the cells.
    pub height: u8,
    /// Levels from the segment's node down to where what is heavy is cut off.
    pub reach: u8,
}

/// Effort of packing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// Little time for most of the gain.
    #[default]
    Fast,
    /// As few bytes as can be: all ways that there are are tried.
    Small,
}

/// The reason why bytes are no packed segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damage(pub &'static str);

/// A way to take the values of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Model {
    /// Names, in a table; dense blocks are nodes like all others.
    Names,
    /// Numbers; dense blocks are coded plane by plane.
    Numbers,
    /// How full a solid is: as names, but that INNER nodes have what is below them.
    Solid,
}

impl Model {
    const ALL: [Model; 3] = [Model::Names, Model::Numbers, Model::Solid];

    /// Those worth a try.
    fn candidates(segment: &SegmentForm, effort: Effort) -> Vec<Model> {
        let one = |model| vec![model];
        match (segment.rule, segment.kind, effort) {
            (Rule::Occupancy, ..) if can_be_solid(segment.form.value) => one(Model::Solid),
            (.., Effort::Small) => vec![Model::Names, Model::Numbers],
            (Rule::Majority | Rule::Dominant, ..) | (_, Kind::Categorical, _) => one(Model::Names),
            (_, Kind::Continuous, _) => one(Model::Numbers),
        }
    }
}

fn can_be_solid(value: ValueType) -> bool {
    value.sample == SampleType::U8 && value.channels == 1
}

/// Class counts that a segment lists, at most.
const MOST_COUNTS: usize = 1024;

/// Bytes of the checksum of the plain segment and the number of the model, which come first.
const START: usize = 5;

/// Packs a segment of so many places, whose class counts follow its records. `None` where it would not shrink.
pub fn pack(segment: &SegmentForm, places: u32, plain: &[u8], effort: Effort) -> Option<Vec<u8>> {
    let layout = RecordLayout::new(segment.form);
    let (records, counts) = plain.split_at_checked(places as usize * layout.size)?;
    let candidates = Model::candidates(segment, effort).into_iter();
    let packed = candidates.filter_map(|model| pack_as(model, segment, &layout, records, counts));
    let packed = packed.min_by_key(Vec::len).filter(|packed| packed.len() < plain.len())?;
    // Invariant: nothing is written that does not become the same bytes again. What the model has no words for (another writer's
    // records, or damaged ones) stays plain; and a mistake in here loses no data.
    let classes = (counts.len() / (layout.width + 8)) as u16;
    let is_same = unpack(segment, places, classes, &packed).is_ok_and(|unpacked| unpacked == plain);
    is_same.then_some(packed)
}

fn pack_as(
    model: Model,
    segment: &SegmentForm,
    layout: &RecordLayout,
    records: &[u8],
    counts: &[u8],
) -> Option<Vec<u8>> {
    let form = segment.form;
    let Parsed { mut nodes, values, blocks } = parse(layout, records, model == Model::Numbers)?;
    let value = |node: u32| &records[values[node as usize] as usize..][..layout.width];
    let is_mixed = |nodes: &Nodes, node| model == Model::Solid && nodes.state(node) >= INNER;
    // The values that there are, sorted.
    let has_value = |node: &u32| nodes.state(*node) != VOID && !is_mixed(&nodes, *node);
    let of_nodes = (ROOT + 1..nodes.len()).filter(has_value).map(|node| numbers(form, value(node)));
    let counted = parse_counts(form, counts).into_iter().map(|(value, _)| value);
    let in_table = model != Model::Numbers;
    let (known, table) = match in_table {
        true => (distinct(form, of_nodes.chain(counted)), Vec::new()),
        false => (distinct(form, of_nodes), distinct(form, counted)),
    };
    // (Neighbours are often alike.)
    let mut last = None;
    for node in ROOT + 1..nodes.len() {
        let symbol = if nodes.state(node) == VOID {
            NOTHING
        } else if is_mixed(&nodes, node) {
            nodes.set_fullness(node, value(node)[0]);
            MIXED
        } else {
            let value = value(node);
            match last {
                Some((before, symbol)) if before == value => symbol,
                _ => {
                    let key = order(form, &numbers(form, value));
                    let found = known.binary_search_by_key(&key, |numbers| order(form, numbers)).ok()?;
                    let symbol = FIRST_VALUE + found as u32;
                    last = Some((value, symbol));
                    symbol
                }
            }
        };
        nodes.set_symbol(node, symbol);
    }
    let mut blocks = blocks
        .into_iter()
        .map(|(node, dense, place)| {
            let start = place * layout.size;
            (node, records[start..][..dense.places(layout) * layout.size].to_vec())
        })
        .collect();
    let mut writer = BitWriter::default();
    let contents =
        Contents { nodes: &nodes, table: if in_table { &known } else { &table }, known: &known, counts };
    code_segment(&mut writer, model, segment, layout, records.len(), contents, &mut blocks)?;
    let mut packed = crc32c::crc32c_append(crc32c::crc32c(records), counts).to_le_bytes().to_vec();
    packed.push(model as u8);
    writer.finish(&mut packed);
    Some(packed)
}

/// Values in ascending order, each once.
fn distinct(form: Form, values: impl Iterator<Item = Numbers>) -> Vec<Numbers> {
    let mut known: Vec<Numbers> = Vec::new();
    let sort = |known: &mut Vec<Numbers>| {
        known.sort_unstable_by_key(|numbers| order(form, numbers));
        known.dedup();
    };
    // (Those that come again and again are not all held.)
    let mut room = 4096;
    for value in values {
        if known.last() != Some(&value) {
            known.push(value);
        }
        if known.len() >= room {
            sort(&mut known);
            room = 2 * known.len().max(room / 2);
        }
    }
    sort(&mut known);
    known
}

/// Unpacks a segment that has so many places and class counts.
///
/// # Errors
/// If the bytes are not those of such a segment.
pub fn unpack(segment: &SegmentForm, places: u32, classes: u16, packed: &[u8]) -> Result<Vec<u8>, Damage> {
    let layout = RecordLayout::new(segment.form);
    let length = places as usize * layout.size;
    let (start, rest) = packed.split_at_checked(START).ok_or(Damage("too few bytes"))?;
    let model = Model::ALL
        .get(usize::from(start[4]))
        .filter(|model| **model != Model::Solid || can_be_solid(segment.form.value));
    let model = *model.ok_or(Damage("no such model"))?;
    let mut reader = BitReader::new(rest).ok_or(Damage("no states"))?;
    let mut blocks = Vec::new();
    let none = Nodes::default();
    let contents = Contents { nodes: &none, table: &[], known: &[], counts: &[] };
    let coded = code_segment(&mut reader, model, segment, &layout, length, contents, &mut blocks);
    let Coded { nodes, values, counts } = coded.ok_or(Damage("nodes that cannot be"))?;
    let mut plain = Vec::with_capacity(length + counts.len());
    let writer = Writer { layout: &layout, nodes: &nodes, values: &values, blocks: &blocks };
    writer.write(ROOT, &mut plain, places as usize).ok_or(Damage("records that cannot be"))?;
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

/// All that is to be written; nothing where it is read.
struct Contents<'c> {
    nodes: &'c Nodes,
    /// Values with numbers: of all nodes, or of class counts alone where the nodes' are numbers.
    table: &'c [Numbers],
    /// Values by their symbols.
    known: &'c [Numbers],
    counts: &'c [u8],
}

/// All that was read, or written.
struct Coded {
    nodes: Nodes,
    values: Vec<[u8; 16]>,
    counts: Vec<u8>,
}

/// Codes all parts of a segment, in their order. Its records take `length` bytes.
fn code_segment<K: BitCoder>(
    coder: &mut K,
    model: Model,
    segment: &SegmentForm,
    layout: &RecordLayout,
    length: usize,
    contents: Contents<'_>,
    blocks: &mut Vec<(u32, Vec<u8>)>,
) -> Option<Coded> {
    let SegmentForm { form, rule, height, reach, .. } = *segment;
    // (Each value takes its width, in records or class counts.)
    let table = code_table(coder, form, contents.table, length / layout.width + MOST_COUNTS)?;
    let node_form = NodeForm {
        height,
        reach,
        is_mixed: model == Model::Solid,
        dense_apart: model == Model::Numbers,
        // An INNER node has at least the values of its children, in a record or a dense block.
        most: length / (layout.children() * layout.width),
    };
    let (mut nodes, known) = match model {
        Model::Numbers => {
            let mut values = NumberValues::new(form, contents.known.to_vec());
            (code_all(&node_form, coder, contents.nodes, &mut values, layout.dimension.axes())?, values.known)
        }
        Model::Names | Model::Solid => {
            let mut values = TableValues::new(table.len());
            (
                code_all(&node_form, coder, contents.nodes, &mut values, layout.dimension.axes())?,
                table.clone(),
            )
        }
    };
    let values: Vec<[u8; 16]> = known.into_iter().map(|value| bytes(form, value)).collect();
    if model == Model::Solid {
        let leaves: Vec<u8> = values.iter().map(|value| value[0]).collect();
        code_fullness(coder, &mut nodes, (layout.dimension.axes(), height), contents.nodes, &leaves);
    }
    if model == Model::Numbers {
        code_blocks(coder, (form, rule), layout, length, &nodes, &values, blocks)?;
    }
    let all = (model != Model::Numbers).then_some(&nodes);
    let counts = code_counts(coder, (form, height), &table, all, contents.counts);
    Some(Coded { nodes, values, counts })
}

fn code_all<K: BitCoder>(
    form: &NodeForm,
    coder: &mut K,
    truth: &Nodes,
    values: &mut impl NewValues,
    axes: usize,
) -> Option<Nodes> {
    match axes {
        2 => code_nodes::<K, 4, 8>(form, coder, truth, values),
        _ => code_nodes::<K, 8, 18>(form, coder, truth, values),
    }
}

/// Codes the dense blocks that are apart.
fn code_blocks<K: BitCoder>(
    coder: &mut K,
    (form, rule): (Form, Rule),
    layout: &RecordLayout,
    length: usize,
    nodes: &Nodes,
    values: &[[u8; 16]],
    blocks: &mut Vec<(u32, Vec<u8>)>,
) -> Option<()> {
    let mut contexts = BlockContexts::new(form);
    let (mut rest, mut number) = (length, 0);
    for (node, dense) in nodes.dense_blocks().iter().copied() {
        let size = dense.places(layout) * layout.size;
        rest = rest.checked_sub(size)?;
        if K::READS {
            blocks.push((node, vec![0; size]));
        }
        let root =
            values.get(nodes.symbol(node).wrapping_sub(FIRST_VALUE) as usize).copied().unwrap_or_default();
        let block = NumberBlock { form, rule, dense, root: &root, bytes: &mut blocks[number].1 };
        code_block(coder, &mut contexts, block);
        number += 1;
    }
    Some(())
}
