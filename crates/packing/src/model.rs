//! Models of the values of nodes, and the coding of records with them.

use std::collections::HashMap;

use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule, SampleType, ValueType};
use spinney_container::{INNER, RecordLayout, VOID};

use crate::adaptive::Adaptive;
use crate::bits::BitCoder;
use crate::blocks::NumberBlock;
use crate::fullness::{FullnessContexts, code_inner_fullness};
use crate::masks::{MaskContexts, code_mask};
use crate::nodes::{
    BEYOND, FIRST_VALUE, MIXED, NOTHING, NewValues, NodeContexts, NodeForm, Nodes, ROOT, code_nodes,
};
use crate::plain::{Parsed, Rows, Writer, parse};
use crate::segment::Corruption;
use crate::values::{NumberValues, Numbers, TableValues, bytes, numbers, order};

/// Model of the values of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Model {
    /// Categories in a table. Dense blocks are coded like all other nodes.
    Names = 0,
    /// Fullness of a solid: LEAF nodes as categories. INNER and CUT nodes have a fullness, which is
    /// not in the table.
    Solid = 2,
    /// Numbers. Dense blocks are coded plane by plane, with stored tables. (1 and 3 belonged to
    /// versions that are no longer read.)
    Numbers = 4,
}

impl Model {
    /// Returns the model that writers choose. Readers accept any model, whatever the rule and the
    /// kind.
    pub(crate) fn of(value: ValueType, rule: Rule, kind: DataKind) -> Model {
        match (rule, kind) {
            (Rule::Occupancy, _) if can_be_solid(value) => Model::Solid,
            (Rule::Majority | Rule::Dominant, _) | (_, DataKind::Categorical) => Model::Names,
            (_, DataKind::Continuous) => Model::Numbers,
        }
    }

    /// Returns the model with a number.
    ///
    /// # Errors
    /// If there is no such model, or it does not support the values.
    pub(crate) fn from_number(number: u8, value: ValueType) -> Result<Model, Corruption> {
        match number {
            0 => Ok(Model::Names),
            1 | 3 => Err(Corruption::OLDER),
            2 if can_be_solid(value) => Ok(Model::Solid),
            4 => Ok(Model::Numbers),
            _ => Err(Corruption("an unknown model number")),
        }
    }

    /// Returns whether values are coded as indices of a table.
    pub(crate) fn has_table(self) -> bool {
        self != Model::Numbers
    }

    /// Returns whether a node has a fullness and no value: see [`MIXED`].
    fn is_mixed(self, nodes: &Nodes, node: u32) -> bool {
        self == Model::Solid && nodes.state(node) >= INNER
    }
}

fn can_be_solid(value: ValueType) -> bool {
    value.sample == SampleType::U8 && value.channels == 1
}

/// Parsed records to be written.
pub(crate) struct ParsedRecords<'r> {
    records: &'r [u8],
    parsed: Parsed,
    /// Distinct values of the nodes. The nodes' symbols are indices of this list until
    /// [`ParsedRecords::set_symbols`].
    values: Vec<Numbers>,
}

impl<'r> ParsedRecords<'r> {
    /// Parses records. Returns `None` if they are inconsistent.
    pub(crate) fn new(
        model: Model,
        layout: &RecordLayout,
        form: TreeType,
        records: &'r [u8],
    ) -> Option<ParsedRecords<'r>> {
        let mut parsed = parse(layout, records, model == Model::Numbers)?;
        let nodes = &mut parsed.nodes;
        let mut distinct = DistinctValues::default();
        for node in ROOT + 1..nodes.len() {
            let value = &records[parsed.values[node as usize] as usize..][..form.width()];
            let symbol = if nodes.state(node) == VOID {
                NOTHING
            } else if model.is_mixed(nodes, node) {
                nodes.set_fullness(node, value[0]);
                MIXED
            } else {
                FIRST_VALUE + distinct.number_of(value)
            };
            nodes.set_symbol(node, symbol);
        }
        let values = distinct.values.iter().map(|value| numbers(form, value)).collect();
        Some(ParsedRecords { records, parsed, values })
    }

    /// Yields the distinct values of the nodes.
    pub(crate) fn values(&self) -> impl Iterator<Item = Numbers> {
        self.values.iter().copied()
    }

    /// Sets the nodes' symbols to those of their values. Returns `None` if a value is not in
    /// `known`.
    pub(crate) fn set_symbols(&mut self, form: TreeType, known: &[Numbers]) -> Option<()> {
        let symbols = self.values.iter().map(|value| symbol_of(form, known, value));
        let symbols = symbols.collect::<Option<Vec<u32>>>()?;
        let nodes = &mut self.parsed.nodes;
        for node in ROOT + 1..nodes.len() {
            if let Some(number) = nodes.symbol(node).checked_sub(FIRST_VALUE) {
                nodes.set_symbol(node, symbols[number as usize]);
            }
        }
        Some(())
    }

    pub(crate) fn nodes(&self) -> &Nodes {
        &self.parsed.nodes
    }

    /// Returns the dense blocks that are coded separately, without the values of the nodes that
    /// they begin at.
    pub(crate) fn blocks(&self, layout: &RecordLayout) -> Vec<NumberBlock> {
        let blocks = self.parsed.blocks.iter().map(|(node, dense, place)| {
            NumberBlock::new(layout, *node, *dense, Some(&self.records[place * layout.size..]))
        });
        blocks.collect()
    }
}

/// Distinct values, in the order of their first occurrence.
#[derive(Default)]
struct DistinctValues {
    values: Vec<[u8; 16]>,
    numbers: HashMap<u128, u32>,
    /// Cache of recent values, by their lowest bits: each with its index plus 1, or 0 if the slot
    /// is empty. Most values are among a few.
    recent: [(u128, u32); 32],
}

impl DistinctValues {
    fn number_of(&mut self, value: &[u8]) -> u32 {
        // (Copies of a known width are one instruction.)
        let key = match *value {
            [byte] => u128::from(byte),
            [a, b] => u16::from_le_bytes([a, b]).into(),
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]).into(),
            _ => {
                let mut bytes = [0; 16];
                bytes[..value.len()].copy_from_slice(value);
                u128::from_le_bytes(bytes)
            }
        };
        let slot = key as usize % self.recent.len();
        let (recent, next) = self.recent[slot];
        if let Some(number) = next.checked_sub(1).filter(|_| recent == key) {
            return number;
        }
        let number = *self.numbers.entry(key).or_insert_with(|| {
            self.values.push(key.to_le_bytes());
            self.values.len() as u32 - 1
        });
        self.recent[slot] = (key, number + 1);
        number
    }
}

/// Returns the symbol of a value among known ones, which are sorted.
pub(crate) fn symbol_of(form: TreeType, known: &[Numbers], value: &Numbers) -> Option<u32> {
    let key = order(form, value);
    let found = known.binary_search_by_key(&key, |numbers| order(form, numbers)).ok()?;
    Some(FIRST_VALUE + found as u32)
}

/// Returns the distinct values in ascending order.
pub(crate) fn distinct(form: TreeType, values: impl Iterator<Item = Numbers>) -> Vec<Numbers> {
    let mut known: Vec<Numbers> = values.collect();
    known.sort_unstable_by_key(|numbers| order(form, numbers));
    known.dedup();
    known
}

/// Coder of the nodes' values, by model.
enum Values {
    Table(TableValues),
    Numbers(NumberValues),
}

/// Coder of the records of runs. Its probabilities carry over from each run to the next.
pub(crate) struct ModelCoder {
    model: Model,
    form: TreeType,
    layout: RecordLayout,
    contexts: NodeContexts,
    masks: MaskContexts,
    fullness: FullnessContexts,
    values: Values,
    /// Bytes of the values, by symbol less [`FIRST_VALUE`].
    known: Vec<[u8; 16]>,
}

/// Limits of a run: levels down to the cells, levels down to nodes that may be CUT, and bytes of
/// its records.
#[derive(Clone, Copy)]
pub(crate) struct RunLimits {
    pub(crate) height: u8,
    pub(crate) reach: u8,
    pub(crate) length: usize,
}

impl ModelCoder {
    /// Creates a coder with the values of the table, or, without a table, with all values to be
    /// written.
    pub(crate) fn new(model: Model, form: TreeType, known: &[Numbers]) -> ModelCoder {
        let values = match model.has_table() {
            true => Values::Table(TableValues::new(known.len())),
            false => Values::Numbers(NumberValues::new(form, known.to_vec())),
        };
        ModelCoder {
            model,
            form,
            layout: RecordLayout::new(form),
            contexts: NodeContexts::new(form.children()),
            masks: [Adaptive::default(); 64],
            fullness: FullnessContexts::default(),
            values,
            known: known.iter().map(|value| bytes(form, *value)).collect(),
        }
    }

    /// Codes the value of a run's own node, and returns its symbol. It is likely to be near that of
    /// the run before.
    pub(crate) fn representative<K: BitCoder>(
        &mut self,
        coder: &mut K,
        symbol: u32,
        before: Option<u32>,
    ) -> Option<u32> {
        let near = before.as_slice();
        let found = match &mut self.values {
            Values::Table(values) => values.new_value(coder, symbol, false, near),
            Values::Numbers(values) => values.new_value(coder, symbol, false, near),
        };
        self.learn();
        found.filter(|symbol| *symbol >= FIRST_VALUE)
    }

    /// Returns the bytes of the value with a symbol.
    pub(crate) fn value(&self, symbol: u32) -> [u8; 16] {
        let at = symbol.wrapping_sub(FIRST_VALUE) as usize;
        self.known.get(at).copied().unwrap_or_default()
    }

    /// Adds the bytes of values that a reader has found since the last call to `known`.
    fn learn(&mut self) {
        if let Values::Numbers(values) = &self.values {
            let new = values.known.iter().skip(self.known.len()).map(|value| bytes(self.form, *value));
            self.known.extend(new);
        }
    }

    /// Codes records below a node with the symbol `root`, and the bits of the dense blocks that are
    /// coded separately. The numbers of these blocks come later.
    pub(crate) fn run<K: BitCoder>(
        &mut self,
        coder: &mut K,
        limits: RunLimits,
        (truth, root): (&Nodes, u32),
        blocks: &mut Vec<NumberBlock>,
    ) -> Option<Nodes> {
        let form = NodeForm {
            height: limits.height,
            reach: limits.reach,
            is_solid: self.model == Model::Solid,
            dense_apart: self.model == Model::Numbers,
            // An INNER node has at least the values of its children, in a record or a dense block.
            most: limits.length / (self.layout.children() * self.layout.width),
        };
        let (axes, contexts) = (self.layout.dimension.axes(), &mut self.contexts);
        let mut nodes = match &mut self.values {
            Values::Table(values) => code_all(&form, coder, axes, contexts, (truth, root), values)?,
            Values::Numbers(values) => code_all(&form, coder, axes, contexts, (truth, root), values)?,
        };
        self.learn();
        if self.model == Model::Solid {
            let leaves: Vec<u8> = self.known.iter().map(|value| value[0]).collect();
            code_inner_fullness(coder, &mut nodes, (axes, limits.height), truth, &leaves, &mut self.fullness);
        }
        if self.model == Model::Numbers {
            self.code_masks(coder, limits.length, &nodes, blocks)?;
        }
        Some(nodes)
    }

    /// Codes the bits of the dense blocks that are coded separately.
    fn code_masks<K: BitCoder>(
        &mut self,
        coder: &mut K,
        length: usize,
        nodes: &Nodes,
        blocks: &mut Vec<NumberBlock>,
    ) -> Option<()> {
        let mut rest = length;
        for (number, (node, dense)) in nodes.dense_blocks().iter().copied().enumerate() {
            let size = dense.slots(&self.layout) * self.layout.size;
            rest = rest.checked_sub(size)?;
            if K::READS {
                blocks.push(NumberBlock::new(&self.layout, node, dense, None));
            }
            let block = &mut blocks[number];
            block.root = self.value(nodes.symbol(node));
            if dense.kind.has_mask() {
                let form = (self.layout.dimension.axes(), dense.levels);
                code_mask(coder, &mut self.masks, form, &mut block.mask);
            }
        }
        Some(())
    }

    /// Appends the records of nodes, as long as they take at most `most` slots. Dense blocks that
    /// are coded separately get their offsets, but no numbers yet. Returns `None` if there are too
    /// few slots, or if nodes do not form the dense block that they should.
    pub(crate) fn write(
        &self,
        nodes: &Nodes,
        blocks: &mut [NumberBlock],
        most: usize,
        records: &mut Vec<u8>,
    ) -> Option<()> {
        let rows = Rows::default();
        Writer { layout: &self.layout, nodes, values: &self.known, rows }.write(ROOT, records, most, blocks)
    }
}

/// Symbol of a node whose value is not given.
pub(crate) const NO_VALUE: u32 = BEYOND;

fn code_all<K: BitCoder>(
    form: &NodeForm,
    coder: &mut K,
    axes: usize,
    contexts: &mut NodeContexts,
    truth: (&Nodes, u32),
    values: &mut impl NewValues,
) -> Option<Nodes> {
    match axes {
        2 => code_nodes::<K, 4, 8, 16>(form, coder, contexts, truth, values),
        _ => code_nodes::<K, 8, 18, 64>(form, coder, contexts, truth, values),
    }
}
