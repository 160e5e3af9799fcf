//! Counts in trees with more nodes than their files have space for. A record that represents
//! several nodes is read once and counted once per occurrence.

use super::walk::{Halt, Visitor, Walked, Zone};
use crate::store::autumnal::{Autumnal, AutumnalNode, OccurrenceVisitor};
use crate::tree::Source;
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Value, ZoneStats};

/// Traverses `bounds` (cells of the deepest level) for a visitor that counts cells independently of
/// their positions: the codes passed to it are meaningless. The time is proportional to the
/// records, not to the nodes.
pub(super) fn walk_folded(tree: &Autumnal, bounds: &Bounds, visitor: &mut impl Visitor) -> Result<()> {
    let root = Code::root(tree.form().dimension);
    tree.each_distinct(bounds, &mut CountedZones { tree, root, visitor })
}

/// Adapter that passes the nodes in the box to a visitor.
struct CountedZones<'a, V> {
    tree: &'a Autumnal,
    root: Code,
    visitor: &'a mut V,
}

impl<V: Visitor> OccurrenceVisitor for CountedZones<'_, V> {
    fn inner(&mut self, node: AutumnalNode, times: u64) -> Result<bool> {
        let Some(tally) = self.tree.tally(&node)? else { return Ok(true) };
        unhalted(self.visitor.zone(self.root, &RepeatedZone { tally, times })).map(|will_do| !will_do)
    }

    fn uniform(&mut self, value: Option<Value>, _: u8, _: u64, cells: u64) -> Result<()> {
        unhalted(self.visitor.block(self.root, value, cells, None).map(|()| true)).map(drop)
    }
}

/// Unwraps a visitor's result. A visitor that stopped needs no descendants.
fn unhalted(walked: Walked<bool>) -> Result<bool> {
    match walked {
        Ok(result) => Ok(result),
        Err(Halt::Stopped) => Ok(true),
        Err(Halt::Failed(error)) => Err(error),
    }
}

/// Zone of a node that occurs several times: the cells of all occurrences.
struct RepeatedZone {
    tally: ZoneStats,
    times: u64,
}

impl Zone for RepeatedZone {
    fn tally(&self) -> Result<ZoneStats> {
        Ok(repeated(&ZoneStats { classes: Vec::new(), ..self.tally }, self.times))
    }

    fn classes(&self) -> Result<Vec<(Value, u64)>> {
        Ok(self.tally.classes.iter().map(|(value, cells)| (*value, cells * self.times)).collect())
    }
}

/// Returns the tally of `times` equal subtrees, added up pairwise as siblings are.
fn repeated(part: &ZoneStats, times: u64) -> ZoneStats {
    if times == 0 {
        return ZoneStats::void(part.value_type);
    }
    let half = repeated(part, times / 2);
    let twice = ZoneStats::merge(&[&half, &half]);
    if times.is_multiple_of(2) { twice } else { ZoneStats::merge(&[&twice, part]) }
}
