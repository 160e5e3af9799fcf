//! Set operations and their kin: several trees over the same space settled into one.

use smallvec::SmallVec;

use crate::space::{Code, Dimension};
use crate::store::autumnal::Kept;
use crate::store::goblin::Layout;
use crate::tree::{CellBlock, Child, Overlay, Source, Stored, Verdict, Verdicts};
use crate::value::{Sample, SampleType, Tally, Value, channelwise_max, channelwise_min};
use crate::{Error, Result};

/// Whose value counts where both have one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prefer {
    /// The first tree's.
    First,
    /// The second tree's.
    Second,
}

/// How trees are settled into one, cell by cell; a cell is present if it is not VOID.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// One of the sixteen set operations on presence (Tyukachev): bit 0 of the number says that cells of both belong
    /// to the result, bit 1 those of the first alone, bit 2 those of the second alone, bit 3 those of neither. So 1 is
    /// the intersection, 2 and 4 the differences, 6 the symmetric difference, 7 the union, 12 the complement of
    /// the first, which needs no second.
    Set {
        /// The number, 0 to 15.
        number: u8,
        /// Whose value stands where both are present.
        prefer: Prefer,
    },
    /// The first of any number of trees that is present.
    Over,
    /// The least value per channel, where all are present.
    Min,
    /// The largest value per channel, where all are present.
    Max,
    /// The sum per channel, where all are present; kept within what the type can hold.
    Add,
    /// The first minus all others, where all are present; kept within what the type can hold.
    Subtract,
    /// The cells in which two trees have the same value.
    Equal,
    /// The cells in which two trees differ, with the second's value, or the first's where the second is VOID.
    Changed,
}

/// What is known of a node without looking below it.
enum Settled<V> {
    Void,
    Leaf(V),
    /// As this tree has it.
    Take(usize),
    Split,
}

/// A set operation's verdicts for nodes inside the extent, outside, and across its border.
fn verdicts(number: u8, prefer: Prefer) -> [Verdicts; 3] {
    let places = [(true, false), (false, true), (true, true)];
    places.map(|place| Verdicts::of(|kinds| verdict(number, prefer, kinds, place)))
}

/// Goes through all combinations of presence that are possible below a node.
fn verdict(number: u8, prefer: Prefer, kinds: [usize; 2], (inside, outside): (bool, bool)) -> Verdict {
    // Whether cells may be present, and VOID.
    let [first, second] = kinds.map(|kind| [(false, true), (true, false), (true, true)][kind]);
    // Whether a cell may be VOID, or of the first, the second, or of neither; whether it is just a tree as it is.
    let (mut void, mut of) = (false, [false; 3]);
    let mut is = [true; 2];
    for (a, b) in [(true, true), (true, false), (false, true), (false, false)] {
        let possible = if a { first.0 } else { first.1 } && if b { second.0 } else { second.1 };
        if !possible {
            continue;
        }
        let (bit, whose) = match (a, b) {
            (true, true) => (0, Some(if prefer == Prefer::First { 0 } else { 1 })),
            (true, false) => (1, Some(0)),
            (false, true) => (2, Some(1)),
            (false, false) => (3, None),
        };
        let belongs = number >> bit & 1 != 0;
        match whose {
            Some(whose) if belongs => of[whose] = true,
            None if belongs => {
                of[2] |= inside;
                void |= outside;
            }
            _ => void = true,
        }
        let filled = belongs && whose.is_none() && inside;
        for (tree, present) in [a, b].into_iter().enumerate() {
            let as_is = if present {
                belongs && whose == Some(tree)
            } else {
                !belongs || !(filled || whose.is_some())
            };
            is[tree] &= as_is;
        }
    }
    match (void, of) {
        (true, [false, false, false]) => Verdict::Void,
        (false, [true, false, false]) if kinds[0] == 1 => Verdict::Take(0),
        (false, [false, true, false]) if kinds[1] == 1 => Verdict::Take(1),
        (false, [false, false, true]) => Verdict::Fill,
        _ if is[0] => Verdict::Take(0),
        _ if is[1] => Verdict::Take(1),
        _ => Verdict::Split,
    }
}

/// Several trees of one kind settled into one by an [`Operation`].
///
/// Trees are walked side by side; where one side decides, the others' detail is not read, and what is stored below is
/// handed through. Time is proportional to the nodes that are looked at, at most the sum over all trees.
#[derive(Clone, Debug)]
pub struct Combined<S: Source> {
    sources: Vec<S>,
    operation: Operation,
    /// Of a set operation, or one that comes to the same: see [`verdicts`].
    verdicts: [Verdicts; 3],
    /// The value of cells that are present in neither tree.
    fill: S::Value,
    /// Cells along each axis; cells of none of the trees are present only in here.
    extent: [u64; 3],
}

type Place<S> = Child<<S as Source>::Value, <S as Source>::Node>;

/// An INNER node of combined trees.
#[derive(Clone, Debug)]
pub enum CombinedNode<D: Dimension, V: Value, N: Clone + std::fmt::Debug + Send + Sync> {
    /// A node of one of the trees as it is.
    Same(usize, N),
    /// Places that are still to be settled, with the numbers of their trees.
    Open(Code<D>, SmallVec<[(usize, Child<V, N>); 2]>),
}

type Open<S> = SmallVec<[(usize, Place<S>); 2]>;

impl<S: Source> Combined<S> {
    /// Combines trees of one depth, whose pictures lie within `extent`.
    ///
    /// # Errors
    /// If depths differ, or the operation takes another number of trees.
    pub fn new(sources: Vec<S>, operation: Operation, extent: [u64; 3]) -> Result<Combined<S>> {
        let takes = match operation {
            Operation::Set { number, .. } if number > 15 => {
                return Err(Error::invalid("set operation", number.to_string(), "0 to 15"));
            }
            Operation::Set { number: 12, .. } => 1..=2,
            Operation::Set { .. } | Operation::Equal | Operation::Changed => 2..=2,
            _ => 1..=usize::MAX,
        };
        if !takes.contains(&sources.len()) {
            let expected = if *takes.end() == 2 { "two" } else { "at least one" };
            return Err(Error::invalid("trees to combine", sources.len().to_string(), expected));
        }
        let depth = sources[0].depth();
        if let Some(other) = sources.iter().find(|source| source.depth() != depth) {
            let expected = format!("{depth}, as the first tree has; deepen the view of the shallower one");
            return Err(Error::invalid("depth of a tree", other.depth().to_string(), expected));
        }
        let full = if <S::Value as Value>::Sample::TYPE == SampleType::U8 { 255.0 } else { 1.0 };
        let fill = S::Value::from_channels(|_| Sample::from_f64_lossy(full));
        let verdicts = match operation {
            Operation::Set { number, prefer } => verdicts(number, prefer),
            _ => verdicts(7, Prefer::First),
        };
        Ok(Combined { sources, operation, verdicts, fill, extent })
    }

    /// Chooses the value of cells that a set operation makes present and neither tree has; it is 255 for bytes, which
    /// says full in solids, and 1 for other types unless chosen.
    pub fn filled_with(self, fill: S::Value) -> Combined<S> {
        Combined { fill, ..self }
    }

    /// The trees.
    pub fn sources(&self) -> &[S] {
        &self.sources
    }

    /// Whether both of two places are one node of one file.
    fn is_one_node(&self, places: &[(usize, Place<S>)]) -> bool {
        let kept = |(tree, place): &(usize, Place<S>)| match place {
            Child::Inner { node, .. } => self.sources[*tree].kept(node),
            _ => None,
        };
        let [first, second] = places else { return false };
        kept(first).is_some_and(|node| kept(second) == Some(node))
    }

    /// What becomes of a node that both trees have as it is, if that is known.
    fn settle_same(&self) -> Option<Settled<S::Value>> {
        match self.operation {
            Operation::Set { number, .. } if number & 9 == 1 => Some(Settled::Take(0)),
            Operation::Set { number, .. } if number & 9 == 0 => Some(Settled::Void),
            Operation::Over | Operation::Min | Operation::Max | Operation::Equal => Some(Settled::Take(0)),
            Operation::Changed => Some(Settled::Void),
            _ => None,
        }
    }

    fn settle(&self, code: Code<S::Dim>, places: &[(usize, Place<S>)]) -> Settled<S::Value> {
        if self.is_one_node(places)
            && let Some(settled) = self.settle_same()
        {
            return settled;
        }
        let all_leaves = |join: fn(S::Value, S::Value) -> S::Value| {
            let mut result: Option<S::Value> = None;
            let mut inner = false;
            for (_, place) in places {
                match place {
                    Child::Void => return Settled::Void,
                    Child::Inner { .. } => inner = true,
                    Child::Leaf(value) => result = Some(result.map_or(*value, |before| join(before, *value))),
                }
            }
            match result {
                Some(value) if !inner => Settled::Leaf(value),
                _ if places.len() == 1 => Settled::Take(0),
                _ => Settled::Split,
            }
        };
        match self.operation {
            Operation::Set { number, .. } => {
                // Only complements reach beyond what the trees have.
                let border = if number & 8 == 0 {
                    0
                } else {
                    match self.where_is(code) {
                        (true, false) => 0,
                        (false, _) => 1,
                        (true, true) => 2,
                    }
                };
                let kind = |tree: usize| places.get(tree).map_or(0, |(_, place)| place.kind());
                match self.verdicts[border].get([kind(0), kind(1)]) {
                    Verdict::Void => Settled::Void,
                    Verdict::Take(tree) => Settled::Take(tree),
                    Verdict::Fill => Settled::Leaf(self.fill),
                    Verdict::Split => Settled::Split,
                }
            }
            Operation::Over => match places {
                [] => Settled::Void,
                [(_, Child::Leaf(value)), ..] => Settled::Leaf(*value),
                [(_, Child::Inner { .. })] => Settled::Take(0),
                _ => Settled::Split,
            },
            Operation::Min => all_leaves(channelwise_min),
            Operation::Max => all_leaves(channelwise_max),
            Operation::Add => all_leaves(|a, b| by_channel(a, b, |a, b| a + b)),
            Operation::Subtract => all_leaves(|a, b| by_channel(a, b, |a, b| a - b)),
            Operation::Equal => match places {
                [(_, Child::Leaf(a)), (_, Child::Leaf(b))] if a.same(*b) => Settled::Leaf(*a),
                [(_, Child::Leaf(_)), (_, Child::Leaf(_))] => Settled::Void,
                [(_, Child::Void), _] | [_, (_, Child::Void)] => Settled::Void,
                _ => Settled::Split,
            },
            Operation::Changed => match places {
                [(_, Child::Void), (_, Child::Void)] => Settled::Void,
                [(_, Child::Leaf(a)), (_, Child::Leaf(b))] if a.same(*b) => Settled::Void,
                [(_, Child::Leaf(_)), (_, Child::Leaf(b))] => Settled::Leaf(*b),
                [_, (_, Child::Void)] => take(places, 0),
                [(_, Child::Void), _] => take(places, 1),
                _ => Settled::Split,
            },
        }
    }

    /// Whether some of a node's cells lie inside the extent, and outside.
    fn where_is(&self, code: Code<S::Dim>) -> (bool, bool) {
        let size = self.depth() - code.level();
        let (mut inside, mut outside) = (true, false);
        for (cell, extent) in code.cell().into_iter().zip(self.extent).take(S::Dim::AXES) {
            inside &= u64::from(cell) << size < extent;
            outside |= (u64::from(cell) + 1) << size > extent;
        }
        (inside, outside)
    }

    fn place(&self, code: Code<S::Dim>, mut places: Open<S>) -> Place<Self> {
        if self.operation == Operation::Over {
            // What is below the first present one does not count.
            places.retain(|(_, place)| !matches!(place, Child::Void));
            if let Some(first) = places.iter().position(|(_, place)| matches!(place, Child::Leaf(_))) {
                places.truncate(first + 1);
            }
        }
        match self.settle(code, &places) {
            Settled::Void => Child::Void,
            Settled::Leaf(value) => Child::Leaf(value),
            Settled::Take(at) => {
                let (tree, place) = places.swap_remove(at);
                place.map_node(|node| CombinedNode::Same(tree, node))
            }
            Settled::Split => {
                let representative = places.iter().find_map(|(_, place)| place.value()).unwrap_or_default();
                Child::Inner { representative, node: CombinedNode::Open(code, places) }
            }
        }
    }
}

fn take<V, N>(places: &[(usize, Child<V, N>)], at: usize) -> Settled<V>
where
    V: Copy,
{
    match &places[at].1 {
        Child::Void => Settled::Void,
        Child::Leaf(value) => Settled::Leaf(*value),
        Child::Inner { .. } => Settled::Take(at),
    }
}

fn by_channel<V: Value>(a: V, b: V, join: fn(f64, f64) -> f64) -> V {
    V::from_channels(|channel| {
        Sample::from_f64_lossy(join(a.samples()[channel].to_f64(), b.samples()[channel].to_f64()))
    })
}

impl<S: Source> Source for Combined<S> {
    type Dim = S::Dim;
    type Value = S::Value;
    type Node = CombinedNode<S::Dim, S::Value, S::Node>;

    fn depth(&self) -> u8 {
        self.sources[0].depth()
    }

    fn root(&self) -> Result<Place<Self>> {
        let places = self.sources.iter().enumerate();
        let places: Result<Open<S>> = places.map(|(tree, source)| Ok((tree, source.root()?))).collect();
        Ok(self.place(Code::ROOT, places?))
    }

    fn each_child(
        &self,
        node: &Self::Node,
        mut each: impl FnMut(usize, Place<Self>) -> Result<()>,
    ) -> Result<()> {
        match node {
            CombinedNode::Same(tree, node) => self.sources[*tree].each_child(node, |step, child| {
                each(step, child.map_node(|node| CombinedNode::Same(*tree, node)))
            }),
            CombinedNode::Open(code, places) => {
                let mut open: <S::Dim as Dimension>::Array<Open<S>> = S::Dim::array(|_| SmallVec::new());
                for (tree, place) in places {
                    let open = open.as_mut();
                    match place {
                        Child::Void => open.iter_mut().for_each(|open| open.push((*tree, Child::Void))),
                        Child::Leaf(value) => {
                            open.iter_mut().for_each(|open| open.push((*tree, Child::Leaf(*value))));
                        }
                        Child::Inner { node, .. } => {
                            self.sources[*tree].each_child(node, |step, child| {
                                open[step].push((*tree, child));
                                Ok(())
                            })?
                        }
                    }
                }
                let mut open = open.into_iter().enumerate();
                open.try_for_each(|(step, open)| each(step, self.place(code.child(step), open)))
            }
        }
    }

    fn cells(&self, node: &Self::Node, levels: u8) -> Result<Option<CellBlock<S::Value>>> {
        match node {
            CombinedNode::Same(tree, node) => self.sources[*tree].cells(node, levels),
            CombinedNode::Open(..) => Ok(None),
        }
    }

    fn kept(&self, node: &Self::Node) -> Option<Kept> {
        match node {
            CombinedNode::Same(tree, node) => self.sources[*tree].kept(node),
            CombinedNode::Open(..) => None,
        }
    }

    fn tally(&self, node: &Self::Node) -> Result<Option<Tally<S::Value>>> {
        match node {
            CombinedNode::Same(tree, node) => self.sources[*tree].tally(node),
            CombinedNode::Open(..) => Ok(None),
        }
    }

    fn stored(&self, node: &Self::Node) -> Option<Stored<'_, S::Dim, S::Value>>
    where
        S::Dim: Layout,
    {
        match node {
            CombinedNode::Same(tree, node) => self.sources[*tree].stored(node),
            CombinedNode::Open(..) => None,
        }
    }

    fn overlay(&self, node: &Self::Node) -> Option<Overlay<'_, S::Dim, S::Value>>
    where
        S::Dim: Layout,
    {
        let CombinedNode::Open(_, places) = node else { return None };
        let settled = match self.operation {
            Operation::Set { number, .. } => number < 8,
            operation => operation == Operation::Over,
        };
        let [first, second] = &places[..] else { return None };
        let stored = |(tree, place): &(usize, Place<S>)| {
            Some(match place {
                Child::Void => Child::Void,
                Child::Leaf(value) => Child::Leaf(*value),
                Child::Inner { representative, node } => {
                    let node = self.sources[*tree].stored(node)?;
                    Child::Inner { representative: *representative, node }
                }
            })
        };
        let places = settled.then(|| Some([stored(first)?, stored(second)?]))??;
        Some(Overlay { places, verdicts: self.verdicts[0] })
    }
}
