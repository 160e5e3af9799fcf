//! Builds the tree of one block of cells: condense, average, emit records in preorder.
//!
//! A block is worked level by level in flat arrays in Z order, where the children of a node are consecutive. There
//! are no pointers and no recursion: the cells' level is reduced to the next one until one node is left, which gives
//! every node's state, value and number of records; then the levels are gone through from the top, each inner
//! node handing its children their places, and every record is written once, where it belongs.

use super::counts::LevelCounts;
use super::part::Part;
use super::record::{INNER, LEAF, Layout, Record, VOID};
use crate::Result;
use crate::space::{Code, Dimension};
use crate::tree::{Child, Source};
use crate::value::{Rule, Sample, Tally, Value, channelwise_max, channelwise_min, dominant, most_frequent};

/// The nodes of one level that were looked at, in Z order: the children of all expanded nodes of the level above.
struct Level<V> {
    state: Vec<u8>,
    value: Vec<V>,
    /// Records of each node's subtree; empty for the level of the cells.
    records: Vec<u32>,
    /// Places, in this level, of the nodes whose children make up the next one; `None`: all of them.
    expanded: Option<Vec<u32>>,
}

/// The nodes of a block, from its root down to its cells or to the leaves where a source had them.
pub(super) struct Block<D: Dimension, V: Value> {
    code: Code<D>,
    /// Levels from the block's root to the cells.
    height: u8,
    levels: Vec<Level<V>>,
}

impl<D: Layout, V: Value> Block<D, V> {
    /// The block under `code` of a tree of `depth` levels, from all its cells in Z order.
    pub(super) fn from_cells(code: Code<D>, height: u8, state: Vec<u8>, value: Vec<V>) -> Self {
        debug_assert_eq!(state.len(), 1 << (D::AXES * height as usize));
        let mut levels: Vec<Level<V>> =
            (0..height).map(|level| Level::new(1 << (D::AXES * level as usize))).collect();
        levels.push(Level { state, value, records: Vec::new(), expanded: None });
        Block { code, height, levels }
    }

    /// The block under `code`, whose root is the source's inner node `node`.
    pub(super) fn from_source<S: Source<Dim = D, Value = V>>(
        source: &S,
        code: Code<D>,
        height: u8,
        node: S::Node,
    ) -> Result<Self> {
        let mut levels = vec![Level { expanded: Some(vec![0]), ..Level::new(1) }];
        let mut nodes = vec![node];
        for below in (0..height).rev() {
            let mut level = Level::new(nodes.len() * D::CHILDREN);
            let mut expanded = Vec::new();
            let mut deeper = Vec::new();
            for (group, node) in nodes.iter().enumerate() {
                for (i, child) in source.children(node)?.into_iter().enumerate() {
                    let place = group * D::CHILDREN + i;
                    match child {
                        Child::Void => {}
                        Child::Inner { node, .. } if below > 0 => {
                            expanded.push(place as u32);
                            deeper.push(node);
                        }
                        Child::Leaf(value) | Child::Inner { representative: value, .. } => {
                            if !value.is_nan() {
                                level.state[place] = LEAF;
                                level.value[place] = value;
                            }
                        }
                    }
                }
            }
            nodes = deeper;
            level.expanded = Some(expanded);
            levels.push(level);
            if nodes.is_empty() {
                break;
            }
        }
        Ok(Block { code, height, levels })
    }

    /// Condenses and averages the block and turns it into records.
    pub(super) fn build(mut self, rule: Rule, count_classes: bool, counts: &mut LevelCounts) -> Part<D, V> {
        let classes = match rule {
            Rule::Mean => {
                self.reduce(&mut Means);
                None
            }
            Rule::Majority => {
                let mut majorities = Majorities { arena: Vec::new() };
                let root = self.reduce(&mut majorities);
                Some(majorities.list(root, &self.levels[0], self.cells_at(0)))
            }
            _ => {
                self.reduce(&mut Local(rule));
                None
            }
        };
        let classes = classes.or_else(|| count_classes.then(|| self.classes()));
        let mut tally = self.tally(classes.as_deref());
        tally.classes = classes.unwrap_or_default();
        let root = &self.levels[0];
        let child = match root.state[0] {
            VOID => Child::Void,
            LEAF => Child::Leaf(root.value[0]),
            _ => Child::Inner { representative: root.value[0], node: () },
        };
        let records = self.records(counts);
        Part { code: self.code, child, total: records.len() as u64, records, tally }
    }

    /// Cells per node of the level `index` levels below the block's root.
    fn cells_at(&self, index: usize) -> u32 {
        1 << (D::AXES * (self.height as usize - index))
    }

    /// Gives every expanded node its state, value and number of records, from the bottom up; returns what the
    /// averaging knows of the root.
    fn reduce<A: Averaging<V>>(&mut self, averaging: &mut A) -> A::Of {
        let mut below: Vec<A::Of> = Vec::new();
        for index in (1..self.levels.len()).rev() {
            let cells = self.cells_at(index);
            let (upper, lower) = self.levels.split_at_mut(index);
            let (parents, children) = (&mut upper[index - 1], &lower[0]);
            let mut known = vec![A::Of::default(); parents.state.len()];
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
            places = below;
        }
        records
    }

    /// Hands out the leaves that the block was made of, before condensing, with their cells.
    fn for_leaves(&self, mut leaf: impl FnMut(V, u32)) {
        for (index, level) in self.levels.iter().enumerate() {
            let cells = self.cells_at(index);
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
    fn new(places: usize) -> Level<V> {
        Level {
            state: vec![VOID; places],
            value: vec![V::default(); places],
            records: vec![0; places],
            expanded: None,
        }
    }
}

/// A rule at work on a block, from the bottom up.
trait Averaging<V: Value> {
    /// What is carried up for an INNER node.
    type Of: Copy + Default;

    /// The same for the parent of these children and its representative. `known` is empty if no child is INNER;
    /// a child has `cells` cells.
    fn merge(&mut self, states: &[u8], values: &[V], known: &[Self::Of], cells: u32) -> (Self::Of, V);
}

/// [`Rule::Mean`]: sums, and cells that are not VOID.
struct Means;

impl<V: Value> Averaging<V> for Means {
    type Of = (V::BlockSums, u32);

    #[inline]
    fn merge(&mut self, states: &[u8], values: &[V], known: &[Self::Of], cells: u32) -> (Self::Of, V) {
        let mut sums = [V::BlockSums::default(); 8];
        let mut count = 0;
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF => {
                    sums[i] = values[i].block_sums(cells);
                    count += cells;
                }
                INNER => {
                    sums[i] = known[i].0;
                    count += known[i].1;
                }
                _ => {}
            }
        }
        let sum = pairwise(&sums[..states.len()], V::add_block_sums);
        ((sum, count), V::block_mean(sum, count))
    }
}

/// [`Rule::Majority`]: counts per class, as a range of one arena; in any order.
struct Majorities<V> {
    arena: Vec<(V, u64)>,
}

/// Lists of up to so many entries are searched from end to end, longer ones sorted: measured with 12 and with 200
/// classes at random.
const FEW: u32 = 64;

impl<V: Value> Majorities<V> {
    /// The counts of a node, by ascending value.
    fn list(&self, (start, len): (u32, u32), level: &Level<V>, cells: u32) -> Vec<(V, u64)> {
        match level.state[0] {
            VOID => Vec::new(),
            LEAF => vec![(level.value[0], cells as u64)],
            _ => {
                let mut counts = self.arena[start as usize..][..len as usize].to_vec();
                sum_by_value(&mut counts);
                counts
            }
        }
    }

    /// Adds to the list that begins at `start` and is the arena's last.
    #[inline]
    fn add(&mut self, start: usize, value: V, cells: u64) {
        match self.arena[start..].iter_mut().find(|(other, _)| other.same(value)) {
            Some((_, sum)) => *sum += cells,
            None => self.arena.push((value, cells)),
        }
    }
}

impl<V: Value> Averaging<V> for Majorities<V> {
    type Of = (u32, u32);

    fn merge(&mut self, states: &[u8], values: &[V], known: &[Self::Of], cells: u32) -> (Self::Of, V) {
        let start = self.arena.len();
        let few = known.iter().map(|(_, len)| len).sum::<u32>() <= FEW;
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF if few => self.add(start, values[i], cells as u64),
                LEAF => self.arena.push((values[i], cells as u64)),
                INNER => {
                    let (first, len) = known[i];
                    let range = first as usize..(first + len) as usize;
                    if few {
                        for place in range {
                            let (value, cells) = self.arena[place];
                            self.add(start, value, cells);
                        }
                    } else {
                        self.arena.extend_from_within(range);
                    }
                }
                _ => {}
            }
        }
        if !few {
            let len = sum_by_value_in(&mut self.arena[start..]);
            self.arena.truncate(start + len);
        }
        let majority = most_frequent(self.arena[start..].iter().copied()).unwrap_or_default();
        ((start as u32, (self.arena.len() - start) as u32), majority)
    }
}

/// The rules that look at the children alone.
struct Local(Rule);

impl<V: Value> Averaging<V> for Local {
    type Of = ();

    fn merge(&mut self, states: &[u8], values: &[V], _: &[()], _: u32) -> ((), V) {
        let some = || states.iter().zip(values).filter(|(state, _)| **state != VOID);
        let values = || some().map(|(_, value)| *value);
        let representative = match self.0 {
            Rule::Min => values().reduce(channelwise_min),
            Rule::Max => values().reduce(channelwise_max),
            Rule::Dominant => Some(dominant(some().map(|(state, value)| (*value, *state == INNER)))),
            Rule::Nearest | Rule::Mean | Rule::Majority => values().next(),
        };
        ((), representative.unwrap_or_default())
    }
}

/// Adds neighbours, then neighbours of those, and so on.
#[inline]
fn pairwise<T: Copy>(items: &[T], add: impl Fn(T, T) -> T + Copy) -> T {
    match items {
        [a, b, c, d] => add(add(*a, *b), add(*c, *d)),
        _ => {
            let (left, right) = items.split_at(4);
            add(pairwise(left, add), pairwise(right, add))
        }
    }
}

/// Sorts a list of counts by value and makes one entry of equal values.
fn sum_by_value<V: Value>(counts: &mut Vec<(V, u64)>) {
    let len = sum_by_value_in(counts);
    counts.truncate(len);
}

/// The same within a slice; returns how many entries are left at its start.
fn sum_by_value_in<V: Value>(counts: &mut [(V, u64)]) -> usize {
    counts.sort_unstable_by(|a, b| a.0.order(b.0));
    let mut len = 0;
    let mut next = 0;
    while let Some(&(value, mut sum)) = counts.get(next) {
        next += 1;
        while let Some((_, count)) = counts.get(next).filter(|(other, _)| other.same(value)) {
            sum += *count;
            next += 1;
        }
        counts[len] = (value, sum);
        len += 1;
    }
    len
}
