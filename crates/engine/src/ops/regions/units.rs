//! The nodes that components are told in: blocks, and larger nodes of one value, in FD order.

use super::local::Local;
use super::pattern::{Pattern, Patterns};
use super::sweep::{Content, Unit};
use spinney_base::space::Code;

/// A block, or a larger node of one value, that is not VOID.
struct Entry {
    code: Code,
    is_block: bool,
}

/// All such nodes, with numbers from 0 on.
pub(super) struct Units {
    entries: Vec<Entry>,
    patterns: Patterns,
}

/// A node above the level of blocks, or at it, by the units there.
pub(super) enum Standing {
    Void,
    /// A node of one value, or a part of one, with this number.
    Uniform(usize),
    /// A block with this number, or a part of one.
    Block(usize),
    Above,
}

impl Units {
    /// No units yet. Patterns of blocks are kept if they take no more than so many bytes.
    pub(super) fn new(room: u64) -> Units {
        Units { entries: Vec::new(), patterns: Patterns::new(room) }
    }

    /// Adds the next one in FD order.
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

    /// The units at a node that is not below a block.
    pub(super) fn at(&self, code: Code) -> Standing {
        let next = self.number_of(code);
        let is_inside = |entry: &&Entry| entry.code.bits() <= code.last_bits();
        let (number, entry) = match self.entries.get(next).filter(is_inside) {
            Some(entry) if entry.code == code => (next, entry),
            Some(_) => return Standing::Above,
            None => match next.checked_sub(1).map(|before| (before, &self.entries[before])) {
                Some((before, entry)) if entry.code.contains(code) => (before, entry),
                _ => return Standing::Void,
            },
        };
        if entry.is_block { Standing::Block(number) } else { Standing::Uniform(number) }
    }

    /// The number of a unit, which there must be.
    pub(super) fn number_of(&self, code: Code) -> usize {
        self.entries.partition_point(|entry| entry.code.bits() < code.bits())
    }

    /// The pattern of a block, if it was kept.
    pub(super) fn pattern(&self, number: usize) -> Option<&Pattern> {
        self.patterns.get(number)
    }
}
