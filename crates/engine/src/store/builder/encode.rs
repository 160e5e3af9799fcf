//! Encodes the levels of a block as a run of records, with dense blocks where these are not much
//! larger.
//!
//! There are two passes. The first goes from the bottom up and counts the record slots of every
//! INNER node: one more than its children need, or those of a dense block if they are few enough.
//! The second writes the records in preorder from the top. So the encoding depends only on the
//! nodes.

use std::mem;

use zerocopy::{FromBytes, IntoBytes};

use super::level::Level;
use super::reused::{ReusedNode, ReusedRecords};
use crate::store::records::dense::from_z_order;
use crate::store::records::subtree::RECORDS_ARE_CHECKED;
use crate::store::records::{Record, RecordHead, RunChildren, RunNode, Runs};
use spinney_base::array;
use spinney_container::{CUT, DenseKind, INNER, LEAF, MAX_DENSE_LEVELS, VOID, dense_levels};

/// Number of record slots of a node's subtree (0 unless it is INNER), whether it is a dense block,
/// and the states of its bottom nodes.
#[derive(Clone, Copy)]
pub(super) struct SubtreeSlots(u32);

impl SubtreeSlots {
    const COUNT: u32 = (1 << 24) - 1;
    const DENSE: u32 = 1 << 24;
    /// Position of the lowest state bit: state `s` has bit `s` after it.
    const STATES_AT: u32 = 28;

    /// Returns the value of a bottom node, or of a uniform node above the bottom. A bottom node
    /// that is INNER becomes CUT.
    #[inline]
    pub(super) fn of_state(state: u8) -> SubtreeSlots {
        let state = if state == INNER { CUT } else { state };
        SubtreeSlots(1 << (Self::STATES_AT + u32::from(state)))
    }

    /// Returns the values of bottom nodes, or of uniform nodes above the bottom.
    fn of_states(states: &[u8]) -> Vec<SubtreeSlots> {
        states.iter().map(|state| SubtreeSlots::of_state(*state)).collect()
    }

    /// Returns the value of a node with copied records.
    fn of_reused(node: &ReusedNode) -> SubtreeSlots {
        let void = if node.has_void { 1 << (Self::STATES_AT + u32::from(VOID)) } else { 0 };
        SubtreeSlots(node.len | 1 << (Self::STATES_AT + u32::from(LEAF)) | void)
    }

    /// Adds the slots of two nodes, and joins their states.
    #[inline]
    pub(super) fn join(self, other: SubtreeSlots) -> SubtreeSlots {
        // Invariant: counts stay below 2^24, since a block has some ten thousand INNER nodes, and a
        // dense block takes less than one record per node. A larger count would overflow into the
        // mark of dense blocks.
        debug_assert!(self.count() + other.count() <= Self::COUNT);
        SubtreeSlots(
            (self.count() + other.count()) | (self.0 | other.0) >> Self::STATES_AT << Self::STATES_AT,
        )
    }

    /// Returns the value of an INNER node from its children's sum and the sizes of dense blocks of
    /// its number of levels.
    #[inline]
    pub(super) fn parent(self, sizes: &DenseSizes) -> SubtreeSlots {
        let count = 1 + self.count();
        let dense = sizes[self.states()];
        // Invariant: the choice between records and a dense block depends only on what is below the
        // node: records, unless a dense block is less than 1/`SHARE` larger. So blocks in rows,
        // blocks in Z order and copied subtrees have the same encoding. Equal trees have equal
        // bytes, and an unchanged node is recognized in a file.
        let (taken, mark) = if dense < count + count / SHARE { (dense, Self::DENSE) } else { (count, 0) };
        SubtreeSlots(taken | mark | (self.states() as u32) << Self::STATES_AT)
    }

    #[inline]
    pub(super) fn count(self) -> u32 {
        self.0 & Self::COUNT
    }

    #[inline]
    fn states(self) -> usize {
        (self.0 >> Self::STATES_AT) as usize
    }

    /// Returns the kind of the node's dense block, if it becomes one.
    #[inline]
    pub(super) fn dense(self) -> Option<DenseKind> {
        if self.0 & Self::DENSE != 0 { DenseKind::of_states(self.states() as u8) } else { None }
    }
}

/// A dense block may be up to 1/`SHARE` larger than records. A few large blocks are drawn much
/// faster than many small ones with records in between: for 2 % more bytes, windows of a relief
/// take half of the time, and those of a photograph three quarters.
const SHARE: u32 = 8;

/// Record slots of dense blocks of some number of levels, their own record's included, by the set
/// of their bottom nodes' states.
pub(super) type DenseSizes = [u32; 16];

/// Returns the sizes of dense blocks with `levels` levels below their root, of which at most `most`
/// are allowed.
pub(super) fn dense_sizes<R: Record>(levels: u8, most: u8) -> DenseSizes {
    array::from_fn(|states| match DenseKind::of_states(states as u8) {
        Some(kind) if levels <= most && dense_levels(R::DIMENSION).contains(&levels) => {
            1 + R::RECORD_LAYOUT.dense_slots(kind, levels) as u32
        }
        _ => u32::MAX,
    })
}

/// A block and the record slots of its nodes, while it is encoded.
struct Encoder<'a, R: Record> {
    levels: &'a [Level],
    reused: &'a ReusedRecords,
    /// Levels from the root to the bottom.
    height: usize,
    /// Maximum number of levels of dense blocks.
    most_dense: u8,
    /// For each level above the bottom, by node.
    slots: Vec<Vec<SubtreeSlots>>,
    /// For each level, by node: index of the node's group of children in the next level. Empty if
    /// all nodes have a group.
    groups: Vec<Vec<u32>>,
    layout: std::marker::PhantomData<R>,
}

/// No group of children.
const NO_GROUP: u32 = u32::MAX;

/// Returns the records of a block whose first level is its root. The last level, the bottom, is at
/// most `height` levels below; INNER nodes there become CUT. Returns nothing if the root is not
/// INNER. Dense blocks have at most `most_dense` levels.
pub(super) fn encode<R: Record>(
    levels: &[Level],
    height: u8,
    most_dense: u8,
    reused: &ReusedRecords,
) -> Vec<u8> {
    if levels[0].states[0] != INNER {
        return Vec::new();
    }
    let mut encoder = Encoder::<R> {
        levels,
        reused,
        height: usize::from(height),
        most_dense,
        slots: Vec::new(),
        groups: levels.iter().map(Level::groups).collect(),
        layout: std::marker::PhantomData,
    };
    encoder.count();
    let mut bytes = vec![0; encoder.slots[0][0].count() as usize * size_of::<R>()];
    encoder.node(0, 0, <[R]>::mut_from_bytes(&mut bytes).expect("whole records"));
    bytes
}

impl<R: Record> Encoder<'_, R> {
    /// Counts the record slots of all nodes above the bottom.
    fn count(&mut self) {
        let mut slots: Vec<Vec<SubtreeSlots>> = Vec::with_capacity(self.levels.len());
        for (index, level) in self.levels.iter().enumerate().rev() {
            if index == self.height {
                continue;
            }
            debug_assert!(level.reused.is_sorted_by_key(|node| node.index));
            debug_assert!(level.expanded.as_ref().is_none_or(|expanded| expanded.is_sorted()));
            let sizes = dense_sizes::<R>((self.height - index) as u8, self.most_dense);
            let mut here = SubtreeSlots::of_states(&level.states);
            for node in &level.reused {
                here[node.index as usize] = SubtreeSlots::of_reused(node);
            }
            if let Some(children) = self.levels.get(index + 1) {
                let known = slots.last().filter(|_| index + 1 < self.height);
                for (group, states) in children.states.chunks_exact(R::CHILDREN).enumerate() {
                    let parent = level.parent(group);
                    if level.states[parent] != INNER {
                        continue;
                    }
                    let first = group * R::CHILDREN;
                    let mut together = SubtreeSlots(0);
                    for child in 0..R::CHILDREN {
                        together = together.join(match known {
                            Some(known) => known[first + child],
                            None => SubtreeSlots::of_state(states[child]),
                        });
                    }
                    here[parent] = together.parent(&sizes);
                }
            }
            slots.push(here);
        }
        slots.reverse();
        self.slots = slots;
    }

    /// Returns the index of an expanded node's first child in the next level.
    #[inline]
    fn first_child(&self, index: usize, node: usize) -> Option<usize> {
        let group = match self.groups[index].get(node) {
            None => node as u32,
            Some(group) => *group,
        };
        (group != NO_GROUP).then_some(group as usize * R::CHILDREN)
    }

    /// Writes an INNER node of a level to the first slots of `records`; returns the number of
    /// slots.
    fn node(&self, index: usize, node: usize, records: &mut [R]) -> usize {
        let slots = self.slots[index][node];
        let count = slots.count() as usize;
        let records = &mut records[..count];
        let Some(first) = self.first_child(index, node) else {
            let reused = self.reused_at(index, node).expect("INNER nodes are expanded or reused");
            records.copy_from_slice(R::of(self.reused.records(reused)));
            return count;
        };
        let children = &self.levels[index + 1];
        let is_cut = index + 1 == self.height;
        let mut next = 1;
        let mut states = 0;
        let dense = slots.dense();
        for (i, state) in children.states[first..first + R::CHILDREN].iter().enumerate() {
            let state = if *state == INNER && is_cut { CUT } else { *state };
            states |= u32::from(state) << (2 * i);
            if state == INNER && dense.is_none() {
                next += self.node(index + 1, first + i, &mut records[next..]);
            }
        }
        let head = RecordHead { states, skip: count as u32, dense: dense.map_or(0, DenseKind::number) };
        records[0] = R::new(head, &children.values_of::<R>()[first..first + R::CHILDREN]);
        if let Some(kind) = dense {
            self.dense(index, node, kind, records[1..].as_mut_bytes());
        }
        count
    }

    fn reused_at(&self, index: usize, node: usize) -> Option<&ReusedNode> {
        // (They are sorted by index.)
        let reused = &self.levels[index].reused;
        reused.binary_search_by_key(&node, |reused| reused.index as usize).ok().map(|at| &reused[at])
    }

    /// Writes the payload of a dense block.
    fn dense(&self, index: usize, node: usize, kind: DenseKind, payload: &mut [u8]) {
        let below = self.height - index;
        let mut rest = payload;
        let mut rows: [&mut [R::Bytes]; MAX_DENSE_LEVELS as usize + 1] = Default::default();
        for (level, rows) in rows[..below + 1].iter_mut().enumerate().skip(2) {
            let bytes = size_of::<R::Bytes>() << (R::AXES * level);
            let (head, tail) = mem::take(&mut rest).split_at_mut(bytes);
            (*rows, rest) = (<[R::Bytes]>::mut_from_bytes(head).expect("whole values"), tail);
        }
        let mut block = Payload { rows, mask: rest, below, kind };
        let is_complete = (index..self.height)
            .all(|index| self.levels[index].expanded.is_none() && self.levels[index].reused.is_empty());
        if is_complete {
            for level in 2..=below {
                let nodes = node << (R::AXES * level)..(node + 1) << (R::AXES * level);
                let values = &self.levels[index + level].values_of::<R>()[nodes];
                from_z_order::<R, _>(level, |z, row| block.rows[level][row] = values[z]);
            }
            let states = &self.levels[self.height].states;
            let states = &states[node << (R::AXES * below)..(node + 1) << (R::AXES * below)];
            block.mask_of::<R>(states);
        } else {
            self.paint(&mut block, (index, node), 0, [0; 3]);
        }
    }

    /// Paints a node into a dense block, at position `at` of the level `level` levels below the
    /// block's root.
    fn paint(
        &self,
        block: &mut Payload<'_, R::Bytes>,
        (index, node): (usize, usize),
        level: usize,
        at: [usize; 3],
    ) {
        let here = &self.levels[index];
        let state = here.states[node];
        let value = here.values_of::<R>()[node];
        if state != INNER || level == block.below {
            let state = if state == INNER { CUT } else { state };
            block.fill::<R>(level, at, (state, value));
            return;
        }
        block.put::<R>(level, at, value);
        let Some(first) = self.first_child(index, node) else {
            if let Some(reused) = self.reused_at(index, node) {
                let records = self.reused.records(reused);
                paint_run::<R>(block, (records, RunNode::default()), level, at);
            }
            return;
        };
        for step in 0..R::CHILDREN {
            self.paint(block, (index + 1, first + step), level + 1, child_at(at, step));
        }
    }
}

impl Level {
    /// Returns the index of each node's group of children; empty if all nodes have a group.
    fn groups(&self) -> Vec<u32> {
        let Some(expanded) = &self.expanded else { return Vec::new() };
        let mut groups = vec![NO_GROUP; self.states.len()];
        (0..).zip(expanded).for_each(|(group, node)| groups[*node as usize] = group);
        groups
    }
}

/// Returns the position of a child.
#[inline]
fn child_at(at: [usize; 3], step: usize) -> [usize; 3] {
    array::from_fn(|axis| at[axis] << 1 | step >> axis & 1)
}

/// The payload of a dense block that is being written.
struct Payload<'p, B> {
    /// Values of each level in rows; empty for the first two levels.
    rows: [&'p mut [B]; MAX_DENSE_LEVELS as usize + 1],
    /// Bits of the bottom nodes, if the kind has a mask.
    mask: &'p mut [u8],
    /// Levels below the root.
    below: usize,
    kind: DenseKind,
}

impl<B: Copy> Payload<'_, B> {
    /// Sets the value of a node.
    fn put<R: Record<Bytes = B>>(&mut self, level: usize, [x, y, z]: [usize; 3], value: B) {
        if level >= 2 {
            self.rows[level][(z << level | y) << level | x] = value;
        }
    }

    /// Sets value and state of a node and all nodes below it.
    fn fill<R: Record<Bytes = B>>(&mut self, level: usize, at: [usize; 3], (state, value): (u8, B)) {
        self.put::<R>(level, at, value);
        if level < self.below {
            for step in 0..R::CHILDREN {
                self.fill::<R>(level + 1, child_at(at, step), (state, value));
            }
            return;
        }
        let (first, second) = self.kind.states();
        if second.is_some() && state == first {
            let bit = (at[2] << level | at[1]) << level | at[0];
            self.mask[bit / 8] |= 1 << (bit % 8);
        }
    }

    /// Sets the bits of all bottom nodes, whose states are given in Z order.
    fn mask_of<R: Record<Bytes = B>>(&mut self, states: &[u8]) {
        let (first, second) = self.kind.states();
        if second.is_none() {
            return;
        }
        let mask = &mut *self.mask;
        from_z_order::<R, _>(self.below, |z, row| {
            let state = if states[z] == INNER { CUT } else { states[z] };
            mask[row / 8] |= u8::from(state == first) << (row % 8);
        });
    }
}

/// Paints the descendants of a node of a run that reaches down to the cells.
fn paint_run<R: Record>(
    block: &mut Payload<'_, R::Bytes>,
    (records, node): (&[u8], RunNode),
    level: usize,
    at: [usize; 3],
) {
    let mut children = RunChildren::default();
    R::RECORD_LAYOUT.run_children(records, node, &mut children).expect(RECORDS_ARE_CHECKED);
    for (step, child) in children[..R::CHILDREN].iter().enumerate() {
        let value = super::averaging::from_value::<R>(child.value);
        let at = child_at(at, step);
        if child.state == INNER {
            block.put::<R>(level + 1, at, value);
            paint_run::<R>(block, (records, child.node), level + 1, at);
        } else {
            block.fill::<R>(level + 1, at, (child.state, value));
        }
    }
}
