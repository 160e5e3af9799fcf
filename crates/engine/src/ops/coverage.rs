//! Set operations on coverage, for solids that fill cells partially.

use crate::store::builder::{
    FULL_COVERAGE, Join, MergeAction, MergeState, MergeTable, Merging, joined_coverage,
};
use spinney_base::value::{Rule, SampleType, Value};
use spinney_base::{SetOperation, TreeType};

/// Value of a full cell in trees whose cells store coverage; `None` for other trees.
pub(super) fn full(form: TreeType, rule: Rule) -> Option<Value> {
    let is_coverage =
        rule == Rule::Occupancy && form.value.sample == SampleType::U8 && !form.value.is_masked();
    is_coverage.then(|| form.value.nearest(|_| FULL_COVERAGE.into()))
}

/// How to merge two trees by a set operation inside the universe, outside, and across its border.
pub(super) fn mergings(operation: SetOperation) -> [Merging; 3] {
    // Nothing is filled outside.
    let without = operation.bounded();
    let across = |states| {
        let (inside, outside) = (action(operation, states), action(without, states));
        if inside == outside && inside != MergeAction::Join { inside } else { MergeAction::Split }
    };
    let merging = |actions, operation| Merging { actions, join: Join::Coverage(operation), full: None };
    [
        merging(MergeTable::new(|states| action(operation, states)), operation),
        merging(MergeTable::new(|states| action(without, states)), without),
        // (A single cell is on one side of the border, so no values are joined across it.)
        merging(MergeTable::new(across), without),
    ]
}

/// Action for a pair of nodes: one that is correct for all coverages that their cells can have.
fn action(operation: SetOperation, states: [MergeState; 2]) -> MergeAction {
    /// Samples that suffice: the result is linear in both coverages between empty, equal and full.
    const ANY: [u8; 5] = [0, 60, 128, 200, FULL_COVERAGE];
    let [first, second] = states.map(|state| match state {
        MergeState::Void => &[0][..],
        MergeState::Leaf => &[FULL_COVERAGE],
        MergeState::Partial | MergeState::Inner => &ANY,
    });
    let always = |is: fn(u8, [u8; 2]) -> bool| {
        let holds = |a: u8, b: u8| is(joined_coverage(operation, a, b), [a, b]);
        first.iter().all(|a| second.iter().all(|b| holds(*a, *b)))
    };
    match states {
        _ if always(|result, _| result == 0) => MergeAction::Void,
        _ if always(|result, [a, _]| result == a) => MergeAction::Keep(0),
        _ if always(|result, [_, b]| result == b) => MergeAction::Keep(1),
        _ if always(|result, _| result == FULL_COVERAGE) => MergeAction::Fill,
        [MergeState::Inner, _] | [_, MergeState::Inner] => MergeAction::Split,
        _ => MergeAction::Join,
    }
}
