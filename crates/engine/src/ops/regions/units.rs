//! Units in which components are found: blocks, and larger uniform nodes, in FD order.

use super::local::Local;
use super::pattern::{Pattern, Patterns};
use super::sweep::{Content, Unit};
use spinney_base::space::Code;

/// Block, or larger uniform node, that is not VOID.
struct Entry {
    code: Code,
    is_block: bool,
}

/// All units, with indices from 0 on.
pub(super) struct Units {
    entries: Vec<Entry>,
    patterns: Patterns,
}

/// State of a node above the block level, or at it, by the units there.
pub(super) enum UnitState {
    Void,
    /// Uniform node with this index, or a descendant of it.
    Uniform(usize),
    /// Block with this index, or a node below it.
    Block(usize),
    Above,
}

impl Units {
    /// No units yet. Patterns of blocks are kept within `memory` bytes.
    pub(super) fn new(memory: u64) -> Units {
        Units { entries: Vec::new(), patterns: Patterns::new(memory) }
    }

    /// Adds the next unit in FD order.
    pub(super) fn push(&mut self, unit: &Unit<'_>) {
        let block: Option<&Local> = match unit.content {
            Content::Uniform(_) => None,
            Content::Block(local, _) => Some(local),
        };
        if let Some(local) = block {
            self.patterns.keep(self.entries.len(), local);
        }
        self.entries.push(Entry { code: unit.code, is_block: block.is_some() });
    }

    /// State of a node that is not below a block.
    pub(super) fn at(&self, code: Code) -> UnitState {
        let next = self.number_of(code);
        let is_inside = |entry: &&Entry| entry.code.bits() <= code.last_bits();
        let (number, entry) = match self.entries.get(next).filter(is_inside) {
            Some(entry) if entry.code == code => (next, entry),
            Some(_) => return UnitState::Above,
            None => match next.checked_sub(1).map(|before| (before, &self.entries[before])) {
                Some((before, entry)) if entry.code.contains(code) => (before, entry),
                _ => return UnitState::Void,
            },
        };
        if entry.is_block { UnitState::Block(number) } else { UnitState::Uniform(number) }
    }

    /// Index of a unit, which must exist.
    pub(super) fn number_of(&self, code: Code) -> usize {
        self.entries.partition_point(|entry| entry.code.bits() < code.bits())
    }

    /// Pattern of a block, if it was kept.
    pub(super) fn pattern(&self, number: usize) -> Option<&Pattern> {
        self.patterns.get(number)
    }
}
