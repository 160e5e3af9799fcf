//! Builds the tree of one block of cells: condense, average, emit records in preorder.
//!
//! A block is worked level by level in flat arrays in Z order, where the children of a node are consecutive. There
//! are no pointers and no recursion: the cells' level is reduced to the next one until one node is left, which gives
//! every node's state, value and number of records; then the levels are gone through from the top, each inner
//! node handing its children their places, and every record is written once, where it belongs.

use super::averaging::{Averaging, Local, Majorities, Means, pairwise, sum_by_value};
use super::counts::LevelCounts;
use super::part::Part;
use super::subtree::{CHECKED, each_leaf};
use super::take::{Splice, Taken};
use crate::space::Code;
use crate::store::goblin::{INNER, LEAF, Layout, Record, VOID};
use crate::tree::Child;
use crate::value::{Rule, Sample, Tally, Value, channelwise_max, channelwise_min};

/// The nodes of one level that were looked at, in Z order: the children of all expanded nodes of the level above.
pub(in crate::store) struct Level<V> {
    pub(in crate::store) state: Vec<u8>,
    pub(in crate::store) value: Vec<V>,
    /// Records of each node's subtree; empty for the level of the cells.
    records: Vec<u32>,
    /// Places, in this level, of the nodes whose children make up the next one; `None`: all of them.
    pub(in crate::store) expanded: Option<Vec<u32>>,
    /// INNER nodes that came as a whole, in order.
    spliced: Vec<Splice>,
}

/// The nodes of a block, from its root down to its cells or to the leaves where a source had them.
pub(in crate::store) struct Block<D: Layout, V: Value> {
    pub(in crate::store) code: Code<D>,
    /// Levels from the block's root to the cells.
    pub(in crate::store) height: u8,
    pub(in crate::store) levels: Vec<Level<V>>,
    pub(in crate::store) taken: Taken<D, V>,
}

impl<D: Layout, V: Value> Block<D, V> {
    /// The block under `code` of a tree of `depth` levels, from all its cells in Z order.
    pub(in crate::store) fn from_cells(code: Code<D>, height: u8, state: Vec<u8>, value: Vec<V>) -> Self {
        debug_assert_eq!(state.len(), 1 << (D::AXES * height as usize));
        let mut levels: Vec<Level<V>> =
            (0..height).map(|level| Level::new(1 << (D::AXES * level as usize))).collect();
        levels.push(Level { state, value, records: Vec::new(), expanded: None, spliced: Vec::new() });
        Block { code, height, levels, taken: Taken::new(height) }
    }

    /// Condenses and averages the block and turns it into records.
    pub(in crate::store) fn build(
        mut self,
        rule: Rule,
        count_classes: bool,
        counts: &mut LevelCounts,
    ) -> Part<D, V> {
        let classes = match rule {
            Rule::Mean => {
                self.reduce(&mut Means { with_void: false });
                None
            }
            Rule::Occupancy => {
                self.reduce(&mut Means { with_void: true });
                None
            }
            Rule::Majority => {
                let mut majorities = Majorities { arena: Vec::new() };
                let root = self.reduce(&mut majorities);
                Some(majorities.list(root, self.root(), self.cells_at(0)))
            }
            _ => {
                self.reduce(&mut Local(rule));
                None
            }
        };
        let classes = classes.or_else(|| count_classes.then(|| self.classes()));
        let mut tally = self.tally(classes.as_deref());
        tally.classes = classes.unwrap_or_default();
        let child = self.root();
        let records = self.records(counts);
        Part { code: self.code, child, total: records.len() as u64, records, tally }
    }

    /// The block's root, once it is reduced.
    fn root(&self) -> Child<V, ()> {
        let root = &self.levels[0];
        match root.state[0] {
            VOID => Child::Void,
            LEAF => Child::Leaf(root.value[0]),
            _ => Child::Inner { representative: root.value[0], node: () },
        }
    }

    /// Cells per node of the level `index` levels below the block's root.
    fn cells_at(&self, index: usize) -> u32 {
        1 << (D::AXES * (self.height as usize - index))
    }

    /// Gives every expanded node its state, value and number of records, from the bottom up; returns what the
    /// averaging knows of the root.
    fn reduce<A: Averaging<V>>(&mut self, averaging: &mut A) -> A::Of {
        let mut below: Vec<A::Of> = Vec::new();
        let height = self.height;
        let taken = &self.taken.records;
        let splices = |level: &Level<V>, index: usize, known: &mut Vec<A::Of>, averaging: &mut A| {
            for splice in &level.spliced {
                known.resize(level.state.len(), A::Of::default());
                let records = &taken[splice.start as usize..][..splice.len as usize];
                known[splice.place as usize] = averaging.taken::<D>(records, height - index as u8);
            }
        };
        if let Some(last) = self.levels.last() {
            splices(last, self.levels.len() - 1, &mut below, averaging);
        }
        for index in (1..self.levels.len()).rev() {
            let cells = 1 << (D::AXES * (height as usize - index));
            let (upper, lower) = self.levels.split_at_mut(index);
            let (parents, children) = (&mut upper[index - 1], &lower[0]);
            let mut known = vec![A::Of::default(); parents.state.len()];
            splices(parents, index - 1, &mut known, averaging);
            let groups =
                children.state.chunks_exact(D::CHILDREN).zip(children.value.chunks_exact(D::CHILDREN));
            for (group, (states, values)) in groups.enumerate() {
                let place = parents.expanded.as_ref().map_or(group, |expanded| expanded[group] as usize);
                let first = states[0];
                let uniform = first != INNER
                    && states.iter().all(|state| *state == first)
                    && (first == VOID || values.iter().all(|value| value.same(values[0])));
                if uniform {
                    parents.state[place] = first;
                    parents.value[place] = values[0];
                    continue;
                }
                let range = group * D::CHILDREN..(group + 1) * D::CHILDREN;
                let known_below = below.get(range.clone()).unwrap_or(&[]);
                let (of, representative) = averaging.merge(states, values, known_below, cells);
                known[place] = of;
                parents.state[place] = INNER;
                parents.value[place] = representative;
                parents.records[place] = 1 + children.records.get(range).unwrap_or(&[]).iter().sum::<u32>();
            }
            below = known;
        }
        below.first().copied().unwrap_or_default()
    }

    /// The records of all inner nodes, in preorder.
    fn records(&self, counts: &mut LevelCounts) -> Vec<D::Record<V>> {
        let root = &self.levels[0];
        if root.state[0] != INNER {
            return Vec::new();
        }
        let mut records = vec![D::Record::<V>::new(0, |_| V::default(), 0); root.records[0] as usize];
        let mut places = vec![0u32];
        self.put_spliced(0, &places, &mut records);
        counts.merge_below(self.code.level(), &self.taken.counts);
        for index in 1..self.levels.len() {
            let (parents, children) = (&self.levels[index - 1], &self.levels[index]);
            let level = self.code.level() + index as u8;
            let mut below = vec![0u32; if children.records.is_empty() { 0 } else { children.state.len() }];
            let mut tallied = [0u64; 3];
            for group in 0..children.state.len() / D::CHILDREN {
                let parent = parents.expanded.as_ref().map_or(group, |expanded| expanded[group] as usize);
                if parents.state[parent] != INNER {
                    continue;
                }
                let place = places[parent];
                let start = group * D::CHILDREN;
                let mut next = place + 1;
                let mut states = 0;
                for i in 0..D::CHILDREN {
                    let state = children.state[start + i];
                    states |= (state as u32) << (2 * i);
                    tallied[state as usize] += 1;
                    if state == INNER {
                        below[start + i] = next;
                        next += children.records[start + i];
                    }
                }
                records[place as usize] =
                    D::Record::<V>::new(states, |i| children.value[start + i], parents.records[parent]);
            }
            counts.add(level, tallied);
            self.put_spliced(index, &below, &mut records);
            places = below;
        }
        records
    }

    /// Puts the records that were taken over at a level where they belong.
    fn put_spliced(&self, index: usize, places: &[u32], records: &mut [D::Record<V>]) {
        for splice in &self.levels[index].spliced {
            let taken = self.taken(splice);
            records[places[splice.place as usize] as usize..][..taken.len()].copy_from_slice(taken);
        }
    }

    fn taken(&self, splice: &Splice) -> &[D::Record<V>] {
        &self.taken.records[splice.start as usize..][..splice.len as usize]
    }

    /// Hands out the leaves that the block was made of, before condensing, with their cells.
    fn for_leaves(&self, mut leaf: impl FnMut(V, u32)) {
        for (index, level) in self.levels.iter().enumerate() {
            let cells = self.cells_at(index);
            for splice in &level.spliced {
                let taken = self.taken(splice);
                each_leaf::<D, V>(taken, self.height - index as u8, |value, cells| leaf(value, cells as u32))
                    .expect(CHECKED);
            }
            let leaves = level.state.iter().zip(&level.value);
            match &level.expanded {
                Some(expanded) => {
                    let mut expanded = expanded.iter().map(|place| *place as usize).peekable();
                    for (place, (state, value)) in leaves.enumerate() {
                        if expanded.next_if_eq(&place).is_none() && *state == LEAF {
                            leaf(*value, cells);
                        }
                    }
                }
                None if index + 1 < self.levels.len() => {}
                // The level of the cells, mostly without VOID.
                None if !level.state.contains(&VOID) => level.value.iter().for_each(|value| leaf(*value, 1)),
                None => leaves.filter(|(state, _)| **state == LEAF).for_each(|(_, value)| leaf(*value, 1)),
            }
        }
    }

    /// What is below the block's root, but for class counts; from these where they are known and sums are exact.
    fn tally(&self, classes: Option<&[(V, u64)]>) -> Tally<V> {
        let is_float = V::Sample::TYPE.is_float();
        if let Some(classes) = classes.filter(|_| !is_float) {
            let classes = classes.iter().map(|(value, cells)| Tally::leaf(*value, *cells, false));
            return classes.fold(Tally::void(), |sum, class| Tally::merge(&[&sum, &class]));
        }
        let mut count = 0u64;
        // Some leaf's value, to start from.
        let (mut min, mut max) = (V::default(), V::default());
        let any = self.levels.iter().find_map(|level| {
            level.state.iter().position(|state| *state == LEAF).map(|place| level.value[place])
        });
        let any = any.or_else(|| {
            let mut any = None;
            self.for_leaves(|value, _| any = any.or(Some(value)));
            any
        });
        if let Some(value) = any {
            (min, max) = (value, value);
        }
        let mut sums = V::BlockSums::default();
        let mut squares = V::BlockSquares::default();
        self.for_leaves(|value, cells| {
            count += cells as u64;
            min = channelwise_min(min, value);
            max = channelwise_max(max, value);
            if !is_float {
                sums = V::add_block_sums(sums, value.block_sums(cells));
                squares = V::add_block_squares(squares, value.block_squares(cells));
            }
        });
        let (sum, squares) = if is_float {
            (self.pairwise(Tally::leaf_sums), self.pairwise(Tally::leaf_squares))
        } else {
            (V::widen(sums), V::widen_squares(squares))
        };
        Tally { cells: count, min, max, sum, squares, classes: Vec::new() }
    }

    /// Cells of each value.
    fn classes(&self) -> Vec<(V, u64)> {
        let mut leaves = Vec::new();
        self.for_leaves(|value, cells| leaves.push((value, cells as u64)));
        sum_by_value(&mut leaves);
        leaves
    }

    /// Adds something of every leaf, pairwise in Z order: see [`Tally`].
    fn pairwise(&self, of_leaf: impl Fn(V, u64) -> V::TotalSums) -> V::TotalSums {
        let mut below: Vec<V::TotalSums> = Vec::new();
        for (index, level) in self.levels.iter().enumerate().rev() {
            let cells = self.cells_at(index) as u64;
            let is_last = index + 1 == self.levels.len();
            let mut sums = vec![V::TotalSums::default(); level.state.len()];
            if is_last || level.expanded.is_some() {
                for (sum, (state, value)) in sums.iter_mut().zip(level.state.iter().zip(&level.value)) {
                    if *state == LEAF {
                        *sum = of_leaf(*value, cells);
                    }
                }
            }
            for splice in &level.spliced {
                let taken = self.taken(splice);
                let height = self.height - index as u8;
                sums[splice.place as usize] = pairwise_taken::<D, V>(taken, 0, height, &of_leaf);
            }
            for (group, children) in below.chunks_exact(D::CHILDREN).enumerate() {
                let place = level.expanded.as_ref().map_or(group, |expanded| expanded[group] as usize);
                sums[place] = pairwise(children, V::add_sums);
            }
            below = sums;
        }
        below.first().copied().unwrap_or_default()
    }
}

impl<V: Value> Level<V> {
    /// `places` VOID nodes.
    pub(in crate::store) fn new(places: usize) -> Level<V> {
        Level {
            state: vec![VOID; places],
            value: vec![V::default(); places],
            records: vec![0; places],
            expanded: None,
            spliced: Vec::new(),
        }
    }

    /// The level of a block's root, which is INNER as far as is known.
    pub(in crate::store) fn root() -> Level<V> {
        Level { expanded: Some(vec![0]), ..Level::new(1) }
    }

    /// Puts a LEAF in its place; NaN is VOID.
    #[inline]
    pub(in crate::store) fn put_leaf(&mut self, place: usize, value: V) {
        if !value.is_nan() {
            self.state[place] = LEAF;
            self.value[place] = value;
        }
    }

    /// Puts a node that was taken over in its place.
    pub(in crate::store) fn take(&mut self, representative: V, splice: Splice) {
        let place = splice.place as usize;
        self.state[place] = INNER;
        self.value[place] = representative;
        self.records[place] = splice.len;
        self.spliced.push(splice);
    }
}

/// Adds something of every leaf of a subtree of records that were checked, pairwise in Z order.
fn pairwise_taken<D: Layout, V: Value>(
    records: &[D::Record<V>],
    at: usize,
    height: u8,
    of_leaf: &impl Fn(V, u64) -> V::TotalSums,
) -> V::TotalSums {
    let record = &records[at];
    let mut next = at + 1;
    let children = D::array(|child| match record.state(child) {
        LEAF => of_leaf(record.value(child), 1 << (D::AXES * (height as usize - 1))),
        INNER => {
            let sum = pairwise_taken::<D, V>(records, next, height - 1, of_leaf);
            next += records[next].skip() as usize;
            sum
        }
        _ => V::TotalSums::default(),
    });
    pairwise(children.as_ref(), V::add_sums)
}
