//! Builds the tree of one block of cells: condense, average, hand over to [`encode`](super::encode).
//!
//! A block is worked level by level in flat arrays in Z order, where the children of a node are consecutive.
//! There are no pointers and no recursion: the cells' level is reduced to the next one until one node is
//! left, which gives every node's state and value.
//!
//! Arrays hold values as bytes, so that a block is the same for all types; what is done with them is compiled
//! for each type ([`averaging`](super::averaging), [`tally`](super::tally)) or width and chosen once per
//! block.

use zerocopy::{FromBytes, IntoBytes};

use super::averaging::{Averaging, Local, Majorities, Means, sum_by_value};
use super::encode::encode;
use super::masked::{MaskedExtremes, MaskedMeans};
use super::part::Part;
use super::reused::{ReusedNode, ReusedRecords};
use super::tally;
use crate::store::records::subtree::{RECORDS_ARE_CHECKED, each_leaf};
use crate::store::records::{Record, RecordLayout, with_form_type, with_record_type};
use crate::tree::Child;
use spinney_base::Form;
use spinney_base::space::Code;
use spinney_base::value::{Native, Rule, Value};
use spinney_container::{INNER, LEAF, LevelCounts, VOID};

/// The nodes of one level that were looked at, in Z order: the children of all expanded nodes of the level
/// above.
pub(super) struct Level {
    pub(super) states: Vec<u8>,
    /// The values' bytes. Invariant: zeros where a node is VOID. Levels begin as zeros, and whoever makes a
    /// node a LEAF writes its value. So bytes of files do not depend on what nobody sees; uniform VOID
    /// children make a VOID parent of the same bytes; and who draws dense blocks need not ask for the state
    /// of a value that is not zero.
    pub(super) values: Vec<u8>,
    /// Indices, in this level, of the nodes whose children make up the next one; `None`: all of them.
    pub(super) expanded: Option<Vec<u32>>,
    /// INNER nodes that came as a whole. Invariant: ascending, as those that were expanded are, since nodes
    /// are gone through in Z order. Groups of children in the next level are told by this order, and records
    /// are found by it: with another, nodes would get the children of others.
    pub(super) reused: Vec<ReusedNode>,
}

/// The nodes of a block, from its root down to its cells or to the leaves where a source had them.
pub(super) struct Block {
    form: Form,
    code: Code,
    /// Levels from the block's root to the cells.
    pub(super) height: u8,
    pub(super) levels: Vec<Level>,
    pub(super) reused: ReusedRecords,
    /// Nodes of each level below the root, which is at level 0; known once the block is reduced.
    counts: LevelCounts,
}

impl Level {
    /// A level of so many VOID nodes.
    pub(super) fn new(form: Form, nodes: usize) -> Level {
        Level {
            states: vec![VOID; nodes],
            values: vec![0; nodes * form.width()],
            expanded: None,
            reused: Vec::new(),
        }
    }

    /// The level of a block's root, which is INNER as far as is known.
    pub(super) fn root(form: Form) -> Level {
        Level { expanded: Some(vec![0]), ..Level::new(form, 1) }
    }

    /// The values, with their width known at compile time.
    #[inline]
    pub(super) fn values_of<R: Record>(&self) -> &[R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(&self.values).expect("whole values")
    }

    /// A node's value.
    #[inline]
    fn value(&self, form: Form, index: usize) -> Value {
        Value::read(&self.values[index * form.width()..], form.width()).expect("a value per node")
    }

    /// Makes a node a LEAF.
    #[inline]
    pub(super) fn put_leaf(&mut self, form: Form, index: usize, value: Value) {
        // (NaN is VOID.)
        if !form.value.is_nan(value) {
            self.states[index] = LEAF;
            value.write(&mut self.values[index * form.width()..][..form.width()]);
        }
    }

    /// Makes a node one whose records are taken over.
    pub(super) fn put_reused(&mut self, form: Form, representative: Value, node: ReusedNode) {
        let index = node.index as usize;
        self.states[index] = INNER;
        representative.write(&mut self.values[index * form.width()..][..form.width()]);
        self.reused.push(node);
    }

    /// The index of the node whose children are the `group`-th group of the next level.
    #[inline]
    pub(super) fn parent(&self, group: usize) -> usize {
        self.expanded.as_ref().map_or(group, |expanded| expanded[group] as usize)
    }
}

impl Block {
    /// A block from the levels that a source had.
    pub(super) fn new(form: Form, code: Code, height: u8, levels: Vec<Level>, reused: ReusedRecords) -> Self {
        Block { form, code, height, levels, reused, counts: LevelCounts::default() }
    }

    /// The block under `code`, of `height` levels, from all its cells in Z order.
    pub(super) fn from_cells(form: Form, code: Code, height: u8, states: Vec<u8>, values: Vec<u8>) -> Self {
        debug_assert_eq!(states.len() as u64, form.dimension.cells(height));
        let mut levels: Vec<Level> =
            (0..height).map(|level| Level::new(form, form.dimension.cells(level) as usize)).collect();
        levels.push(Level { states, values, expanded: None, reused: Vec::new() });
        let reused = ReusedRecords::new(RecordLayout::new(form), height);
        Block { form, code, height, levels, reused, counts: LevelCounts::default() }
    }

    /// Condenses and averages the block and turns it into records, with dense blocks of so many levels at most.
    pub(super) fn build(
        mut self,
        rule: Rule,
        count_classes: bool,
        most_dense: u8,
        counts: &mut LevelCounts,
    ) -> Part {
        let (form, code) = (self.form, self.code);
        let is_masked = form.value.channels > 1 && form.value.missing.is_some();
        let layout = RecordLayout::new(form);
        let classes = match rule {
            Rule::Mean if is_masked => {
                with_form_type!(form, V, R => if V::CHANNELS > 1 {
                    reduce::<R, _>(&mut self, &mut MaskedMeans::<V>::new(form.value));
                });
                None
            }
            Rule::Mean | Rule::Occupancy => {
                with_form_type!(form, V, R => {
                    reduce::<R, _>(&mut self, &mut Means::<V>::new(rule == Rule::Occupancy));
                });
                None
            }
            Rule::Majority => with_record_type!(layout, R => {
                let mut majorities = Majorities::<R>::new(form.value);
                let root = reduce::<R, _>(&mut self, &mut majorities);
                Some(majorities.list(root, self.root(), self.cells_at(0)))
            }),
            Rule::Min | Rule::Max if is_masked => {
                with_record_type!(layout, R => {
                    reduce::<R, _>(&mut self, &mut MaskedExtremes::new(form.value, rule));
                });
                None
            }
            Rule::Dominant | Rule::Min | Rule::Max | Rule::Nearest => {
                with_record_type!(layout, R => {
                    reduce::<R, _>(&mut self, &mut Local::new(rule, form.value));
                });
                None
            }
        };
        let classes = classes.or_else(|| count_classes.then(|| self.classes()));
        let tally = tally::of_block(&self, classes);
        let child = self.root();
        let records = with_record_type!(RecordLayout::new(form), R => {
            encode::<R>(&self.levels, self.height, most_dense, &self.reused)
        });
        // (Of the root, whoever merges it with its siblings counts all but what is below.)
        let total = self.counts.records() + u64::from(child.is_inner());
        counts.merge_below(code.level(), &self.counts);
        Part { code, child, total, records, tally }
    }

    pub(super) fn form(&self) -> Form {
        self.form
    }

    /// The block's root, once it is reduced.
    fn root(&self) -> Child<()> {
        let root = &self.levels[0];
        let value = root.value(self.form, 0);
        match root.states[0] {
            VOID => Child::Void,
            LEAF => Child::Leaf(value),
            _ => Child::Inner { representative: value, node: () },
        }
    }

    /// Cells per node of the level `index` levels below the block's root.
    pub(super) fn cells_at(&self, index: usize) -> u32 {
        self.form.dimension.cells(self.height - index as u8) as u32
    }

    /// Cells of each value.
    fn classes(&self) -> Vec<(Value, u64)> {
        let mut leaves: Vec<(Value, u64)> = Vec::new();
        with_record_type!(RecordLayout::new(self.form), R => {
            for_leaves::<R>(self, &mut |value, cells| {
                let value = Value::from_bytes(value.as_bytes());
                match leaves.last_mut() {
                    // Neighbours are alike.
                    Some(last) if last.0 == value => last.1 += u64::from(cells),
                    _ => leaves.push((value, u64::from(cells))),
                }
            });
        });
        sum_by_value(self.form.value, &mut leaves);
        leaves
    }

    /// The records of a node that were taken over.
    pub(super) fn reused_records<R: Record>(&self, node: &ReusedNode) -> &[R] {
        R::of(self.reused.records(node))
    }
}

/// Gives every expanded node its state and value, from the bottom up, and counts nodes; returns what the averaging
/// knows of the root.
fn reduce<R: Record, A: Averaging<R>>(block: &mut Block, averaging: &mut A) -> A::Of {
    let mut below: Vec<A::Of> = Vec::new();
    let height = block.height;
    let (levels, reused) = (&mut block.levels, &block.reused);
    let add_reused = |level: &Level, index: usize, known: &mut Vec<A::Of>, averaging: &mut A| {
        for node in &level.reused {
            known.resize(level.states.len(), A::Of::default());
            known[node.index as usize] = averaging.reused(R::of(reused.records(node)), height - index as u8);
        }
    };
    if let Some(last) = levels.last() {
        add_reused(last, levels.len() - 1, &mut below, averaging);
    }
    block.counts.merge(&reused.counts);
    for index in (1..levels.len()).rev() {
        let cells = 1 << (R::AXES * (height as usize - index));
        let (upper, lower) = levels.split_at_mut(index);
        let (parents, children) = (&mut upper[index - 1], &lower[0]);
        let mut known = vec![A::Of::default(); parents.states.len()];
        add_reused(parents, index - 1, &mut known, averaging);
        let nodes = reduce_level::<R, A>(parents, children, (&below, &mut known), cells, averaging);
        block.counts.add(index as u8, nodes);
        below = known;
    }
    below.first().copied().unwrap_or_default()
}

/// Gives the parents of one level of nodes their states and values; a child has `cells` cells. `below` is what is known of
/// the INNER children, `known` of the parents. Returns the VOID, LEAF and INNER nodes of the children's level.
fn reduce_level<R: Record, A: Averaging<R>>(
    parents: &mut Level,
    children: &Level,
    (below, known): (&[A::Of], &mut [A::Of]),
    cells: u32,
    averaging: &mut A,
) -> [u64; 3] {
    let expanded = parents.expanded.take();
    let states = &mut parents.states;
    let representatives = <[R::Bytes]>::mut_from_bytes(&mut parents.values).expect("whole values");
    let values = children.values_of::<R>();
    let groups = children.states.chunks_exact(R::CHILDREN).zip(values.chunks_exact(R::CHILDREN));
    let (mut nodes, mut void, mut inner) = (0, 0, 0);
    for (group, (child_states, child_values)) in groups.enumerate() {
        let parent = expanded.as_ref().map_or(group, |expanded| expanded[group] as usize);
        let first = child_states[0];
        let uniform = first != INNER
            && child_states.iter().all(|state| *state == first)
            && (first == VOID || child_values.iter().all(|value| *value == child_values[0]));
        if uniform {
            states[parent] = first;
            representatives[parent] = child_values[0];
            continue;
        }
        let range = group * R::CHILDREN..(group + 1) * R::CHILDREN;
        let known_below = below.get(range).unwrap_or(&[]);
        let (of, representative) = averaging.merge(child_states, child_values, known_below, cells);
        known[parent] = of;
        states[parent] = INNER;
        representatives[parent] = representative;
        nodes += R::CHILDREN as u64;
        void += child_states.iter().map(|state| u64::from(*state == VOID)).sum::<u64>();
        inner += child_states.iter().map(|state| u64::from(*state == INNER)).sum::<u64>();
    }
    parents.expanded = expanded;
    [void, nodes - void - inner, inner]
}

/// Hands out the leaves that the block was made of, before condensing, with their cells.
#[inline]
pub(super) fn for_leaves<R: Record>(block: &Block, leaf: &mut impl FnMut(R::Bytes, u32)) {
    for (index, level) in block.levels.iter().enumerate() {
        let cells = block.cells_at(index);
        for node in &level.reused {
            let reused = block.reused_records::<R>(node);
            reused_leaves(reused, block.height - index as u8, &mut |value, cells| leaf(value, cells));
        }
        let values = level.values_of::<R>();
        let leaves = level.states.iter().zip(values);
        match &level.expanded {
            Some(expanded) => {
                let mut expanded = expanded.iter().map(|index| *index as usize).peekable();
                for (index, (state, value)) in leaves.enumerate() {
                    if expanded.next_if_eq(&index).is_none() && *state == LEAF {
                        leaf(*value, cells);
                    }
                }
            }
            None if index + 1 < block.levels.len() => {}
            // The level of the cells.
            None => leaves.filter(|(state, _)| **state == LEAF).for_each(|(_, value)| leaf(*value, 1)),
        }
    }
}

/// Hands out the leaves of records that were taken over. (By a pointer: what is done with them is compiled for very many types.)
fn reused_leaves<R: Record>(records: &[R], levels: u8, leaf: &mut dyn FnMut(R::Bytes, u32)) {
    each_leaf(records, levels, |value, cells| leaf(value, cells as u32)).expect(RECORDS_ARE_CHECKED);
}
