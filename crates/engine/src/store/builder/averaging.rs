//! Rules applied to a block: intermediate results from level to level, and representatives computed
//! from them.
//!
//! These are kernels: compiled for each value type or record width, and selected once per block.

use std::marker::PhantomData;

use smallvec::SmallVec;
use zerocopy::{FromBytes, IntoBytes};

use super::fold::fold;
use crate::store::records::Record;
use crate::store::records::subtree::{RECORDS_ARE_CHECKED, each_leaf};
use crate::tree::Child;
use spinney_base::sort;
use spinney_base::value::{Native, Rule, Value, ValueType, break_tie, dominant};
use spinney_container::{INNER, LEAF, VOID};

/// A rule that is applied to a block, from the bottom up.
pub(super) trait Averaging<R: Record> {
    /// Intermediate result of an INNER node: sums, class counts, or nothing.
    type Of: Copy + Default;

    /// Merges children: returns the intermediate result of their parent, and its representative.
    /// `known` is empty if no child is INNER; a child has `cells` cells.
    fn merge(
        &mut self,
        states: &[u8],
        values: &[R::Bytes],
        known: &[Self::Of],
        cells: u32,
    ) -> (Self::Of, R::Bytes);

    /// Returns the intermediate result of a subtree of checked records of `levels` levels.
    fn reused(&mut self, records: &[R], levels: u8) -> Self::Of;
}

/// Converts bytes to a value of a type known at compile time.
#[inline]
pub(super) fn decode<R: Record, V: Native>(bytes: R::Bytes) -> V {
    V::from_wire(V::Wire::read_from_bytes(bytes.as_bytes()).expect("records are as wide as values"))
}

/// Converts a value to its bytes.
#[inline]
pub(super) fn encode<R: Record, V: Native>(value: V) -> R::Bytes {
    R::Bytes::read_from_bytes(value.to_wire().as_bytes()).expect("records are as wide as values")
}

/// [`Rule::Mean`] and [`Rule::Occupancy`]: sums, and the number of cells to divide by.
pub(super) struct Means<V> {
    /// Whether VOID cells count.
    with_void: bool,
    value: PhantomData<V>,
}

impl<V> Means<V> {
    pub(super) fn new(with_void: bool) -> Self {
        Means { with_void, value: PhantomData }
    }
}

impl<V: Native, R: Record> Averaging<R> for Means<V> {
    type Of = (V::BlockSums, u32);

    #[inline]
    fn merge(
        &mut self,
        states: &[u8],
        values: &[R::Bytes],
        known: &[Self::Of],
        cells: u32,
    ) -> (Self::Of, R::Bytes) {
        let mut sums = [V::BlockSums::default(); 8];
        let mut count = 0;
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF => {
                    sums[i] = decode::<R, V>(values[i]).block_sums(cells);
                    count += cells;
                }
                INNER => {
                    sums[i] = known[i].0;
                    count += known[i].1;
                }
                _ if self.with_void => count += cells,
                _ => {}
            }
        }
        let sum = pairwise(&sums[..R::CHILDREN], V::add_block_sums);
        ((sum, count), encode::<R, V>(V::block_mean(sum, count)))
    }

    fn reused(&mut self, records: &[R], levels: u8) -> Self::Of {
        let leaf = |bytes, cells| (decode::<R, V>(bytes).block_sums(cells), cells);
        let (sum, count) = fold(records, levels, &leaf, &|sums: &[Self::Of]| {
            pairwise(sums, |a, b| (V::add_block_sums(a.0, b.0), a.1 + b.1))
        });
        (sum, if self.with_void { 1 << (R::AXES * levels as usize) } else { count })
    }
}

/// [`Rule::Majority`]: counts per class, as a range of one arena; in any order.
///
/// Compiled only once per width: the value type matters only where lists are sorted.
pub(super) struct Majorities<R: Record> {
    arena: Vec<(R::Bytes, u64)>,
    value_type: ValueType,
}

/// Lists of up to this many entries are searched linearly, longer ones sorted: measured with 12 and
/// with 200 random classes.
const LINEAR_SEARCH_MAX: u32 = 64;

impl<R: Record> Majorities<R> {
    pub(super) fn new(value_type: ValueType) -> Self {
        Majorities { arena: Vec::new(), value_type }
    }

    /// Returns the counts of a node, by ascending value.
    pub(super) fn list(
        &mut self,
        (start, len): (u32, u32),
        node: Child<()>,
        cells: u32,
    ) -> Vec<(Value, u64)> {
        match node {
            Child::Void => Vec::new(),
            Child::Leaf(value) => vec![(value, cells as u64)],
            Child::Inner { .. } => {
                // (The node is the root, whose list is the last of all.)
                self.arena.truncate((start + len) as usize);
                self.sum_from(start as usize);
                let counts = self.arena[start as usize..].iter();
                counts.map(|(bytes, cells)| (Value::from_bytes(bytes.as_bytes()), *cells)).collect()
            }
        }
    }

    /// Adds cells to the arena's last list, which begins at `start`.
    #[inline]
    fn add(&mut self, start: usize, value: R::Bytes, cells: u64) {
        match self.arena[start..].iter_mut().find(|(other, _)| *other == value) {
            Some((_, sum)) => *sum += cells,
            None => self.arena.push((value, cells)),
        }
    }

    /// Returns the value with the highest count in the arena's last list, which begins at `start`.
    /// The children decide ties.
    #[inline]
    fn most_frequent(&self, start: usize, states: &[u8], values: &[R::Bytes]) -> Option<R::Bytes> {
        let list = &self.arena[start..];
        let (mut best, mut is_tied) = (*list.first()?, false);
        for (value, cells) in &list[1..] {
            is_tied = *cells == best.1 || is_tied && *cells < best.1;
            if *cells > best.1 {
                best = (*value, *cells);
            }
        }
        Some(if is_tied { self.winner(list, best.1, states, values) } else { best.0 })
    }

    /// Returns the class that wins a tie of all classes with `most` cells: see [`break_tie`].
    fn winner(&self, list: &[(R::Bytes, u64)], most: u64, states: &[u8], values: &[R::Bytes]) -> R::Bytes {
        let children =
            || states.iter().zip(values).filter(|(state, _)| **state != VOID).map(|(_, value)| value);
        if let Some(first) = children().find(|child| list.contains(&(**child, most))) {
            return *first;
        }
        let best = list.iter().filter(|(_, cells)| *cells == most);
        let mut tied: Vec<_> = best.map(|(value, _)| Value::from_bytes(value.as_bytes())).collect();
        tied.sort_unstable_by_key(|value| self.value_type.order_key(*value));
        from_value::<R>(break_tie(children().map(|value| Value::from_bytes(value.as_bytes())), &tied, most))
    }

    /// Sorts the arena's last list, which begins at `start`, and merges entries of equal values.
    fn sum_from(&mut self, start: usize) {
        // Sorted by integer keys, so that sorting is compiled once for all types.
        let mut list = Vec::with_capacity(self.arena.len() - start);
        for (bytes, cells) in &self.arena[start..] {
            let value = Value::from_bytes(bytes.as_bytes());
            list.push((self.value_type.order_key(value), value, *cells));
        }
        sum_by_key(&mut list);
        self.arena.truncate(start);
        for (_, value, cells) in list {
            self.arena.push((from_value::<R>(value), cells));
        }
    }
}

impl<R: Record> Averaging<R> for Majorities<R> {
    type Of = (u32, u32);

    fn merge(
        &mut self,
        states: &[u8],
        values: &[R::Bytes],
        known: &[Self::Of],
        cells: u32,
    ) -> (Self::Of, R::Bytes) {
        // Lists of the level below are not freed: lists of the children of later parents follow
        // them, and the arena is freed with the block.
        let start = self.arena.len();
        let few = known.iter().map(|(_, len)| len).sum::<u32>() <= LINEAR_SEARCH_MAX;
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF if few => self.add(start, values[i], cells as u64),
                LEAF => self.arena.push((values[i], cells as u64)),
                INNER => {
                    let (first, len) = known[i];
                    let range = first as usize..(first + len) as usize;
                    if few {
                        for index in range {
                            let (value, cells) = self.arena[index];
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
            self.sum_from(start);
        }
        let majority = self.most_frequent(start, states, values).unwrap_or(R::ZERO);
        ((start as u32, (self.arena.len() - start) as u32), majority)
    }

    fn reused(&mut self, records: &[R], levels: u8) -> Self::Of {
        let start = self.arena.len();
        let mut last = start;
        each_leaf(records, levels, |value, cells| {
            // Adjacent leaves often have equal values.
            if self.arena.get(last).is_none_or(|(other, _)| *other != value) {
                self.add(start, value, 0);
                let index = self.arena[start..].iter().position(|(other, _)| *other == value);
                last = start + index.unwrap_or(0);
            }
            self.arena[last].1 += cells;
        })
        .expect(RECORDS_ARE_CHECKED);
        (start as u32, (self.arena.len() - start) as u32)
    }
}

/// Chooses the representative of children that are not all VOID, from their states and values.
type Choice<R> = fn(&Local<R>, &[u8], &[<R as Record>::Bytes]) -> <R as Record>::Bytes;

/// Rules that need only the direct children. Compiled for each width; a function pointer selects
/// code that depends on the value type.
pub(super) struct Local<R: Record> {
    choose: Choice<R>,
    value_type: ValueType,
}

impl<R: Record> Local<R> {
    /// Returns a rule for values of type `V`, the type of the records' values. Some of their
    /// samples may be missing.
    pub(super) fn new<V: Native>(rule: Rule, value_type: ValueType) -> Self {
        let is_masked = value_type.channels > 1 && value_type.is_masked();
        let choose = match rule {
            Rule::Min if is_masked => choose_present::<R, true>,
            Rule::Max if is_masked => choose_present::<R, false>,
            Rule::Min => choose_extreme::<V, R, true>,
            Rule::Max => choose_extreme::<V, R, false>,
            Rule::Dominant => choose_dominant::<R>,
            Rule::Nearest | Rule::Mean | Rule::Majority | Rule::Occupancy => choose_first::<R>,
        };
        Local { choose, value_type }
    }
}

impl<R: Record> Averaging<R> for Local<R> {
    type Of = ();

    #[inline]
    fn merge(&mut self, states: &[u8], values: &[R::Bytes], _: &[()], _: u32) -> ((), R::Bytes) {
        ((), (self.choose)(self, states, values))
    }

    fn reused(&mut self, _: &[R], _: u8) {}
}

/// Values of the children that are not VOID, and whether each is INNER.
type SomeChildren = SmallVec<[(Value, bool); 8]>;

fn some_of<R: Record>(states: &[u8], values: &[R::Bytes]) -> SomeChildren {
    let mut some = SomeChildren::new();
    for (state, value) in states.iter().zip(values) {
        if *state != VOID {
            some.push((Value::from_bytes(value.as_bytes()), *state == INNER));
        }
    }
    some
}

/// [`Rule::Min`] and [`Rule::Max`].
fn choose_extreme<V: Native, R: Record, const IS_MIN: bool>(
    _: &Local<R>,
    states: &[u8],
    values: &[R::Bytes],
) -> R::Bytes {
    // (Plain loops, because this is compiled twice for each type.)
    let mut extreme: Option<V> = None;
    for (state, value) in states.iter().zip(values) {
        if *state != VOID {
            let value = decode::<R, V>(*value);
            extreme = Some(match extreme {
                None => value,
                Some(other) if IS_MIN => other.min(value),
                Some(other) => other.max(value),
            });
        }
    }
    extreme.map_or(R::ZERO, encode::<R, V>)
}

/// [`Rule::Min`] and [`Rule::Max`] of the samples that are present.
fn choose_present<R: Record, const IS_MIN: bool>(
    local: &Local<R>,
    states: &[u8],
    values: &[R::Bytes],
) -> R::Bytes {
    let join = if IS_MIN { ValueType::min } else { ValueType::max };
    from_value::<R>(join_present(local.value_type, &some_of::<R>(states, values), join))
}

fn join_present(
    value_type: ValueType,
    some: &SomeChildren,
    join: fn(ValueType, Value, Value) -> Value,
) -> Value {
    value_type.join_all(some.iter().map(|(value, _)| *value), join).unwrap_or_default()
}

/// [`Rule::Dominant`].
fn choose_dominant<R: Record>(_: &Local<R>, states: &[u8], values: &[R::Bytes]) -> R::Bytes {
    from_value::<R>(dominant(&some_of::<R>(states, values)))
}

/// [`Rule::Nearest`], and rules that leave the choice open.
fn choose_first<R: Record>(_: &Local<R>, states: &[u8], values: &[R::Bytes]) -> R::Bytes {
    match states.iter().position(|state| *state != VOID) {
        Some(first) => values[first],
        None => R::ZERO,
    }
}

/// Sums pairs of adjacent items, then pairs of those sums, and so on. This order defines the sums
/// of floating-point samples.
#[inline]
pub(super) fn pairwise<T: Copy>(items: &[T], add: impl Fn(T, T) -> T + Copy) -> T {
    match items {
        [a, b, c, d] => add(add(*a, *b), add(*c, *d)),
        _ => {
            let (left, right) = items.split_at(4);
            add(pairwise(left, add), pairwise(right, add))
        }
    }
}

/// Returns the bytes of a value whose type is known at run time.
#[inline]
pub(super) fn from_value<R: Record>(value: Value) -> R::Bytes {
    R::Bytes::read_from_prefix(&value.to_bytes()).expect("16 bytes hold any value").0
}

/// Sorts a list of counts by value and merges entries of equal values.
pub(super) fn sum_by_value(value_type: ValueType, counts: &mut Vec<(Value, u64)>) {
    let keyed = counts.drain(..).map(|(value, cells)| (value_type.order_key(value), value, cells));
    let mut keyed: Vec<(u128, Value, u64)> = keyed.collect();
    sum_by_key(&mut keyed);
    counts.extend(keyed.into_iter().map(|(_, value, cells)| (value, cells)));
}

/// Sorts counts by their values' keys (equal keys mean equal values) and merges equal ones.
#[inline(never)]
fn sum_by_key(counts: &mut Vec<(u128, Value, u64)>) {
    sort::by_wide_key(counts, |(key, _, _)| *key);
    counts.dedup_by(|next, sum| {
        let same = next.0 == sum.0;
        if same {
            sum.2 += next.2;
        }
        same
    });
}
