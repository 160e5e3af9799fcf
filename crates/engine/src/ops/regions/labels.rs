//! Labels of components: a union-find forest of those at borders of blocks, which numbers all
//! components by their first cell in FD order.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::border::ComponentSpan;
use super::sweep::{Cells, Content, Sweeper, Unit};
use super::units::Units;
use super::words::Words;
use spinney_base::{Error, Progress, Result};

/// Bits of a word that hold the parent of a component. The other bits count those components before
/// this one that lie fully inside of its block.
const PARENT_BITS: u32 = 40;
const PARENT: u64 = (1 << PARENT_BITS) - 1;

/// Components of a unit.
struct Entry {
    /// Number of the first of its components at the border; the others follow.
    first: u64,
    at_border: u32,
    /// Number of components that are not at the border.
    inside: u32,
    /// Label of the first component that begins in the unit; for a uniform unit, that of its
    /// component.
    base: u64,
    is_uniform: bool,
}

/// Labels of all components.
pub(super) struct Labels {
    pub(super) units: Units,
    entries: Vec<Entry>,
    /// Labels of the components at borders.
    at_borders: Mutex<Words>,
    pub(super) count: u64,
}

impl Labels {
    /// Scans all cells and labels their components. Uses about `memory` bytes in addition to those
    /// of the blocks in progress; the excess goes to a temporary file in `directory`. Up to `kept`
    /// of these bytes hold patterns of blocks, for later reads of their cells.
    ///
    /// # Errors
    /// If the tree is corrupt, the temporary file cannot be used, or on cancellation.
    pub(super) fn of(
        cells: &Cells,
        kept: u64,
        (directory, memory): (&Path, u64),
        progress: &dyn Progress,
    ) -> Result<Labels> {
        let mut forest = Forest {
            units: Units::new(kept),
            entries: Vec::new(),
            words: Words::new(directory, memory / 4),
            name: cells.view.source().name().into(),
        };
        cells.sweep(false, memory / 2, &mut forest, progress)?;
        forest.number(progress)
    }

    /// Label of a uniform node, given by its index.
    pub(super) fn of_uniform(&self, number: usize) -> u64 {
        self.entries[number].base
    }

    /// Labels of the components of a block, given by its index and which of its components are at
    /// its border.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub(super) fn of_block(
        &self,
        number: usize,
        is_at_border: impl Iterator<Item = bool>,
    ) -> Result<Vec<u64>> {
        let entry = &self.entries[number];
        let mut next = entry.base;
        let mut at_border = entry.first;
        let mut words = self.at_borders.lock().unwrap_or_else(PoisonError::into_inner);
        let mut labels = Vec::with_capacity(entry.at_border as usize + entry.inside as usize);
        for is_at_border in is_at_border {
            let label = match is_at_border {
                true => {
                    at_border += 1;
                    words.get(at_border - 1)?
                }
                false => next,
            };
            // Invariant: labels are assigned in this order. A component that begins here gets the
            // next label, and no other component has that label.
            next += u64::from(label == next);
            labels.push(label);
        }
        Ok(labels)
    }
}

/// Components at borders of blocks. Each has as parent an earlier component that it is united with,
/// or itself.
struct Forest {
    units: Units,
    entries: Vec<Entry>,
    words: Words,
    name: PathBuf,
}

impl Forest {
    fn add(&mut self, inside: u32) -> Result<u64> {
        let id = self.words.len();
        if id > PARENT {
            let advice = "process windows of it";
            return Err(Error::unsupported(
                &self.name,
                "a tree with more than 2^40 components at block borders",
                advice,
            ));
        }
        self.words.push(u64::from(inside) << PARENT_BITS | id)?;
        Ok(id)
    }

    fn root(&mut self, mut id: u64) -> Result<u64> {
        let mut word = self.words.get(id)?;
        while word & PARENT != id {
            let parent = word & PARENT;
            let above = self.words.get(parent)?;
            if above & PARENT == parent {
                return Ok(parent);
            }
            self.words.set(id, word & !PARENT | above & PARENT)?;
            id = above & PARENT;
            word = self.words.get(id)?;
        }
        Ok(id)
    }

    /// Assigns labels to all components.
    fn number(mut self, progress: &dyn Progress) -> Result<Labels> {
        let mut count = 0;
        for entry in &mut self.entries {
            progress.check()?;
            entry.base = count + 1;
            let mut begun = 0;
            for id in entry.first..entry.first + u64::from(entry.at_border) {
                let word = self.words.get(id)?;
                let parent = word & PARENT;
                // Invariant: a parent comes before its children, so its label is known.
                let label = match parent == id {
                    true => {
                        begun += 1;
                        entry.base + (word >> PARENT_BITS) + begun - 1
                    }
                    false => self.words.get(parent)?,
                };
                self.words.set(id, label)?;
                if entry.is_uniform {
                    entry.base = label;
                }
            }
            count += begun + u64::from(entry.inside);
        }
        Ok(Labels { units: self.units, entries: self.entries, at_borders: Mutex::new(self.words), count })
    }
}

impl Sweeper for Forest {
    fn take(&mut self, unit: &Unit<'_>) -> Result<Vec<u64>> {
        let first = self.words.len();
        let mut entry = Entry { first, at_border: 0, inside: 0, base: 0, is_uniform: false };
        let mut ids = Vec::new();
        match unit.content {
            Content::Uniform(_) => {
                entry.is_uniform = true;
                ids.push(self.add(0)?);
                entry.at_border = 1;
            }
            Content::Block(local, _) => {
                for component in &local.components {
                    if component.is_at_border {
                        ids.push(self.add(entry.inside)?);
                        entry.at_border += 1;
                    } else {
                        ids.push(u64::MAX);
                        entry.inside += 1;
                    }
                }
            }
        }
        self.units.push(unit);
        self.entries.push(entry);
        Ok(ids)
    }

    fn meet(&mut self, a: &ComponentSpan, b: &ComponentSpan, _: u64) -> Result<()> {
        if a.value != b.value {
            return Ok(());
        }
        let (a, b) = (self.root(a.id)?, self.root(b.id)?);
        if a != b {
            let (first, second) = (a.min(b), a.max(b));
            let word = self.words.get(second)?;
            self.words.set(second, word & !PARENT | first)?;
        }
        Ok(())
    }
}
