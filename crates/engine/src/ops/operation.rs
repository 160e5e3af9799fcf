//! Operations that merge trees cell by cell, and the actions on nodes that follow from them.

use std::fmt;

use super::coverage;
use crate::store::builder::{Join, MergeAction, MergeState, MergeTable, Merging};
use serde::{Deserialize, Serialize};
use spinney_base::SetOperation;
use spinney_base::value::{Rule, Value};

/// Whose value a cell gets where both trees have one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prefer {
    /// The first tree's.
    First,
    /// The second tree's.
    Second,
}

/// Operation that merges trees into one, cell by cell. A cell is present if it is not VOID.
///
/// ```
/// use spinney::{CombineOperation, SetOperation};
/// use spinney::raw::ops::Prefer;
/// let union = CombineOperation::named("or", Prefer::First);
/// assert_eq!(union, Some(CombineOperation::set(SetOperation::Union)));
/// assert_eq!(union.unwrap().to_string(), "union");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CombineOperation {
    /// Set operation on presence. Those that [take any number](SetOperation::takes_many) of trees
    /// are applied to the first two, then to the result and the next tree; the complement needs no
    /// second tree.
    ///
    /// In trees of bytes with [`Rule::Occupancy`](spinney_base::value::Rule::Occupancy), cells
    /// store the coverage by solids, 255 being full. Set operations then apply to the solids, which
    /// are assumed to overlap as far as possible: see
    /// [`joined_coverage`](crate::store::builder::joined_coverage). In cells that both surfaces
    /// cross, the intersection is at most half a cell too large, and the union at most half a cell
    /// too small. All other cells are exact.
    Set {
        /// The operation.
        operation: SetOperation,
        /// Whose value is taken where both trees are present.
        prefer: Prefer,
    },
    /// Value of the first tree that is present, out of any number of trees.
    Over,
    /// Minimum per channel where all trees are present.
    Min,
    /// Maximum per channel where all trees are present.
    Max,
    /// Sum per channel where all trees are present, clamped to the sample type's range.
    Add,
    /// First tree minus all others where all are present, clamped to the sample type's range.
    Subtract,
    /// Cells in which two trees have the same value.
    Equal,
    /// Cells in which two trees differ, with the second tree's value, or the first's where the
    /// second is VOID.
    Changed,
}

impl CombineOperation {
    /// Whether the result keeps all of the first tree's cells with their values. It then has about
    /// as many nodes or more.
    pub(super) fn keeps_first(self, rule: Rule) -> bool {
        match self {
            // (Of joined solids, one can hide the other.)
            CombineOperation::Set { operation, prefer } => {
                let keeps = operation.contains(true, true) && operation.contains(true, false);
                keeps && prefer == Prefer::First && rule != Rule::Occupancy
            }
            CombineOperation::Over => true,
            _ => false,
        }
    }

    /// Whether the result contains cells that are in none of the trees, which requires a universe.
    pub fn needs_universe(self) -> bool {
        matches!(self, CombineOperation::Set { operation, .. } if operation.is_unbounded())
    }
}

/// Operations that are no set operations, with their names.
const OTHERS: [(&str, CombineOperation); 7] = [
    ("over", CombineOperation::Over),
    ("min", CombineOperation::Min),
    ("max", CombineOperation::Max),
    ("add", CombineOperation::Add),
    ("subtract", CombineOperation::Subtract),
    ("equal", CombineOperation::Equal),
    ("changed", CombineOperation::Changed),
];

impl CombineOperation {
    /// Set operation that prefers the first tree's value where both have one.
    pub const fn set(operation: SetOperation) -> CombineOperation {
        CombineOperation::Set { operation, prefer: Prefer::First }
    }

    /// Operation with this name or index (0 to 15), as in `union`, `a-b`, `min`. `prefer` applies
    /// to set operations. `mask` is the intersection with the first tree's values. Returns `None`
    /// for unknown names.
    pub fn named(name: &str, prefer: Prefer) -> Option<CombineOperation> {
        if name == "mask" {
            return Some(CombineOperation::set(SetOperation::Intersection));
        }
        match name.parse() {
            Ok(operation) => Some(CombineOperation::Set { operation, prefer }),
            Err(_) => OTHERS.iter().find(|(other, _)| *other == name).map(|(_, operation)| *operation),
        }
    }

    /// How values are joined where both trees have one, if the operation computes values.
    pub(super) fn join(self) -> Option<Join> {
        match self {
            CombineOperation::Min => Some(Join::Min),
            CombineOperation::Max => Some(Join::Max),
            CombineOperation::Add => Some(Join::Add),
            CombineOperation::Subtract => Some(Join::Subtract),
            CombineOperation::Equal => Some(Join::Equal),
            CombineOperation::Changed => Some(Join::Changed),
            CombineOperation::Set { .. } | CombineOperation::Over => None,
        }
    }

    /// How to merge two trees inside the universe, outside, and across its border. `full` is the
    /// value of full cells, if cells store coverage.
    pub(super) fn mergings(self, full: Option<Value>) -> [Merging; 3] {
        let of = |actions, join| Merging { actions, join, full: None };
        match (self, full) {
            (CombineOperation::Set { operation, .. }, Some(_)) => {
                coverage::mergings(operation).map(|merging| Merging { full, ..merging })
            }
            // (No values are joined here: any join will do.)
            (CombineOperation::Set { operation, prefer }, None) => {
                merge_tables(operation, prefer).map(|actions| of(actions, Join::Equal))
            }
            // The first of two trees that is present: same as the union.
            (CombineOperation::Over, _) => {
                merge_tables(SetOperation::Union, Prefer::First).map(|actions| of(actions, Join::Equal))
            }
            _ => {
                let actions =
                    MergeTable::new(|states| join_action(self == CombineOperation::Changed, states));
                [of(actions, self.join().unwrap_or(Join::Equal)); 3]
            }
        }
    }

    /// Whether values of the tree with this index can become values of the result. For solids,
    /// coverage always counts.
    pub(super) fn takes_values_of(self, tree: usize, are_bodies: bool) -> bool {
        let CombineOperation::Set { operation, prefer } = self else { return true };
        let (alone, prefers) = match tree {
            0 => (operation.contains(true, false), prefer == Prefer::First),
            _ => (operation.contains(false, true), prefer == Prefer::Second),
        };
        are_bodies || alone || prefers && operation.contains(true, true)
    }

    /// The operation, or its complement if the operation fills cells that no tree has.
    pub(super) fn without_complement(self) -> CombineOperation {
        match self {
            CombineOperation::Set { operation, prefer } if operation.is_unbounded() => {
                CombineOperation::Set { operation: operation.complement(), prefer }
            }
            _ => self,
        }
    }

    /// Accepted numbers of trees.
    pub(super) fn takes(self) -> std::ops::RangeInclusive<usize> {
        match self {
            CombineOperation::Set { operation: SetOperation::Complement, .. } => 1..=2,
            CombineOperation::Set { operation: SetOperation::Union, prefer: Prefer::First } => 1..=usize::MAX,
            // (As exact models: operations that are applied to the result and the next tree.)
            CombineOperation::Set { operation, .. } if operation.takes_many() => 2..=usize::MAX,
            CombineOperation::Set { .. } | CombineOperation::Equal | CombineOperation::Changed => 2..=2,
            _ => 1..=usize::MAX,
        }
    }
}

impl From<SetOperation> for CombineOperation {
    fn from(operation: SetOperation) -> CombineOperation {
        CombineOperation::set(operation)
    }
}

/// Writes the name that [`CombineOperation::named`] accepts, and whose values are preferred if
/// these are not the first tree's.
impl fmt::Display for CombineOperation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let CombineOperation::Set { operation, prefer } = *self else {
            let name = OTHERS.iter().find(|(_, operation)| operation == self).map_or("", |(name, _)| name);
            return f.write_str(name);
        };
        f.write_str(operation.name())?;
        // If no cell has both values, the preference has no effect.
        if prefer == Prefer::Second && operation.contains(true, true) {
            f.write_str(" --values b")
        } else {
            Ok(())
        }
    }
}

/// Action for a pair of nodes whose values are joined: VOID where one tree is VOID; with `or_one`,
/// the other tree's node instead.
fn join_action(or_one: bool, states: [MergeState; 2]) -> MergeAction {
    match states {
        [MergeState::Void, MergeState::Void] => MergeAction::Void,
        [MergeState::Void, _] if or_one => MergeAction::Keep(1),
        [_, MergeState::Void] if or_one => MergeAction::Keep(0),
        [MergeState::Void, _] | [_, MergeState::Void] => MergeAction::Void,
        [MergeState::Inner, _] | [_, MergeState::Inner] => MergeAction::Split,
        _ => MergeAction::Join,
    }
}

/// States that the cells below a node can have, given the node's own state.
#[derive(Clone, Copy)]
struct Possible {
    present: bool,
    void: bool,
}

impl Possible {
    fn of(state: MergeState) -> Possible {
        Possible {
            present: state != MergeState::Void,
            void: matches!(state, MergeState::Void | MergeState::Inner),
        }
    }
}

/// A set operation's actions for nodes inside the universe, outside, and across its border.
fn merge_tables(operation: SetOperation, prefer: Prefer) -> [MergeTable; 3] {
    let parts = [(true, false), (false, true), (true, true)];
    parts.map(|part| MergeTable::new(|states| merge_action(operation, prefer, states, part)))
}

/// Action for a pair of nodes with cells inside the universe, outside, or both. Tries all
/// combinations of presence that can occur below the nodes.
fn merge_action(
    operation: SetOperation,
    prefer: Prefer,
    states: [MergeState; 2],
    (inside, outside): (bool, bool),
) -> MergeAction {
    // Below an INNER node cells may be present or VOID. Each combination that can occur adds an
    // outcome. If all cells have the same outcome, the node needs no split.
    let [first, second] = states.map(Possible::of);
    // Whether a cell of the result may be VOID; whether it may come from the first tree, the
    // second, or neither (filled).
    let (mut void, mut of) = (false, [false; 3]);
    // Whether the result equals one of the trees: then its whole subtree can be reused.
    let mut is = [true; 2];
    for (a, b) in [(true, true), (true, false), (false, true), (false, false)] {
        let possible =
            if a { first.present } else { first.void } && if b { second.present } else { second.void };
        if !possible {
            continue;
        }
        let whose = match (a, b) {
            (true, true) => Some(if prefer == Prefer::First { 0 } else { 1 }),
            (true, false) => Some(0),
            (false, true) => Some(1),
            (false, false) => None,
        };
        let belongs = operation.contains(a, b);
        match whose {
            Some(whose) if belongs => of[whose] = true,
            None if belongs => {
                // Nothing is filled outside the universe.
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
        (true, [false, false, false]) => MergeAction::Void,
        (false, [true, false, false]) if states[0] == MergeState::Leaf => MergeAction::Keep(0),
        (false, [false, true, false]) if states[1] == MergeState::Leaf => MergeAction::Keep(1),
        (false, [false, false, true]) => MergeAction::Fill,
        _ if is[0] => MergeAction::Keep(0),
        _ if is[1] => MergeAction::Keep(1),
        _ => MergeAction::Split,
    }
}
