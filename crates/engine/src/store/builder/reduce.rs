//! Builds the tree of one block of cells: condenses it, computes representatives, and passes it to
//! [`encode`](super::encode).
//!
//! A block is processed level by level in flat arrays in Z order, where the children of a node are
//! consecutive. There are no pointers and no recursion: the cells' level is reduced to the next one
//! until one node is left, which determines every node's state and value.
//!
//! Blocks store values as bytes. Code that computes with values is compiled for each type
//! ([`averaging`](super::averaging), [`tally`](super::tally)) or width and selected once per block.

use zerocopy::{FromBytes, IntoBytes};

use super::averaging::{Averaging, Local, Majorities, Means};
use super::block::{Block, for_nodes};
use super::counts::ValueCounts;
use super::encode::encode;
use super::encoded_subtree::EncodedSubtree;
use super::level::Level;
use super::masked::MaskedMeans;
use super::tally;
use crate::store::records::{Record, RecordLayout, with_block_type, with_record_type};
use spinney_base::value::{Native, Rule, Value};
use spinney_container::{INNER, LevelCounts, VOID};

impl Block {
    /// Condenses the block, computes representatives, and encodes it as records, with dense blocks
    /// of at most `most_dense` levels.
    pub(super) fn build(
        mut self,
        rule: Rule,
        count_classes: bool,
        most_dense: u8,
        counts: &mut LevelCounts,
    ) -> EncodedSubtree {
        let (form, code) = (self.form, self.code);
        let is_masked = form.value.channels > 1 && form.value.is_masked();
        let layout = RecordLayout::new(form);
        let classes = match rule {
            Rule::Mean | Rule::Occupancy if is_masked => {
                with_block_type!(form, V, R => if V::CHANNELS > 1 {
                    reduce::<R, _>(&mut self, &mut MaskedMeans::<V>::new(form.value, rule == Rule::Occupancy));
                });
                None
            }
            Rule::Mean | Rule::Occupancy => {
                with_block_type!(form, V, R => {
                    reduce::<R, _>(&mut self, &mut Means::<V>::new(rule == Rule::Occupancy));
                });
                None
            }
            Rule::Majority => with_record_type!(layout, R => {
                let mut majorities = Majorities::<R>::new(form.value);
                let root = reduce::<R, _>(&mut self, &mut majorities);
                Some(majorities.list(root, self.root(), self.cells_at(0)))
            }),
            Rule::Dominant | Rule::Min | Rule::Max | Rule::Nearest => {
                with_block_type!(form, V, R => {
                    reduce::<R, _>(&mut self, &mut Local::<R>::new::<V>(rule, form.value));
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
        // (The root itself is counted where it is merged with its siblings, so `counts` gets only
        // the nodes below it.)
        let total = self.counts.records() + u64::from(child.is_inner());
        counts.merge_below(code.level(), &self.counts);
        EncodedSubtree { code, child, total, records, tally }
    }

    /// Returns the number of cells per value.
    fn classes(&self) -> Vec<(Value, u64)> {
        let mut leaves = ValueCounts::default();
        with_record_type!(RecordLayout::new(self.form), R => {
            let (mut last, mut sum) = (R::ZERO, 0);
            for_nodes::<R>(self, &mut |value, cells| {
                // Adjacent leaves often have equal values.
                if value != last {
                    leaves.add(last.as_bytes(), sum);
                    (last, sum) = (value, 0);
                }
                sum += u64::from(cells);
            });
            leaves.add(last.as_bytes(), sum);
        });
        leaves.finish(self.form.value)
    }
}

/// Computes state and value of every expanded node, from the bottom up, and counts nodes. Returns
/// the rule's intermediate result for the root.
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

/// Computes states and values of the parents of one level of nodes; a child has `cells` cells.
/// `below` has the intermediate results of the INNER children, `known` receives those of the
/// parents. Returns the numbers of VOID, LEAF and INNER nodes in the children's level.
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
        let parent = match &expanded {
            Some(expanded) => expanded[group] as usize,
            None => group,
        };
        let first = child_states[0];
        if first != INNER && are_alike(child_states) && (first == VOID || are_alike(child_values)) {
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
        for state in child_states {
            void += u64::from(*state == VOID);
            inner += u64::from(*state == INNER);
        }
    }
    parents.expanded = expanded;
    [void, nodes - void - inner, inner]
}

/// Returns whether all siblings equal the first. (Without an early exit, so that several are
/// compared at a time.)
#[inline]
fn are_alike<T: PartialEq>(siblings: &[T]) -> bool {
    let mut alike = true;
    for sibling in siblings {
        alike &= *sibling == siblings[0];
    }
    alike
}
