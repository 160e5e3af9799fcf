//! Numbers of components: a forest of those at borders of blocks, from which each gets its number by its first cell in FD order.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::border::Run;
use super::local::Local;
use super::sweep::{Cells, Content, Sweeper, Unit};
use super::words::Words;
use spinney_base::space::Code;
use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result};

/// Bits of a word that tell what a component is united with. The others count the components that end inside of the block and come
/// between the last one at the border and this.
const PARENT_BITS: u32 = 40;
const PARENT: u64 = (1 << PARENT_BITS) - 1;

/// A block, or a larger node of one value, that is not VOID.
struct Entry {
    code: Code,
    /// The number of the first of its components that are at its border, and so many more.
    first: u64,
    at_border: u32,
    /// Components that are not.
    inside: u32,
    /// The label of the first component that begins in it; that of one that is uniform.
    base: u64,
    /// The value of one that is uniform.
    value: Option<Value>,
}

/// The labels of all components of some cells.
pub(super) struct Labels {
    entries: Vec<Entry>,
    /// Labels of the components at borders.
    at_borders: Mutex<Words>,
    /// Cells of these, if they are asked for.
    sizes: Option<Mutex<Words>>,
    pub(super) count: u64,
}

/// A node above the level of blocks, or at it, by its labels.
pub(super) enum Standing {
    Void,
    /// One component, with this label.
    Uniform(u64),
    /// A block with this number, or more of them below.
    Block(usize),
    Above,
}

impl Labels {
    /// Goes through some cells and numbers their components. About `memory` bytes are used besides those of the blocks at work; what does
    /// not fit goes to a temporary file in the folder.
    ///
    /// # Errors
    /// If the tree is damaged, the temporary file cannot be used, or on interruption.
    pub(super) fn of(
        cells: &Cells,
        with_sizes: bool,
        (folder, memory): (&Path, u64),
        progress: &dyn Progress,
    ) -> Result<Labels> {
        let part = if with_sizes { memory / 8 } else { memory / 4 };
        let mut forest = Forest {
            entries: Vec::new(),
            words: Words::new(folder, part),
            sizes: with_sizes.then(|| Words::new(folder, part)),
            depth: cells.view.depth(),
            name: cells.view.source().name().into(),
        };
        cells.sweep(false, memory / 2, &mut forest, progress)?;
        forest.number(progress)
    }

    /// The labels of a node that is not below a block.
    pub(super) fn at(&self, code: Code) -> Standing {
        let next = self.entries.partition_point(|entry| entry.code.bits() < code.bits());
        let is_inside = |entry: &&Entry| entry.code.bits() <= code.last_bits();
        match self.entries.get(next).filter(is_inside) {
            Some(entry) if entry.code == code => match entry.value {
                Some(_) => Standing::Uniform(entry.base),
                None => Standing::Block(next),
            },
            Some(_) => Standing::Above,
            None => match next.checked_sub(1).map(|before| &self.entries[before]) {
                Some(entry) if entry.code.contains(code) => match entry.value {
                    Some(_) => Standing::Uniform(entry.base),
                    None => Standing::Block(next - 1),
                },
                _ => Standing::Void,
            },
        }
    }

    /// The label of a node of one value, which is given by its number.
    pub(super) fn of_uniform(&self, number: usize) -> u64 {
        self.entries[number].base
    }

    /// The labels of the components of a block, which is given by its number.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub(super) fn of_block(&self, number: usize, local: &Local) -> Result<Vec<u64>> {
        let entry = &self.entries[number];
        let mut next = entry.base;
        let mut at_border = entry.first;
        let mut words = self.at_borders.lock().unwrap_or_else(PoisonError::into_inner);
        let mut labels = Vec::with_capacity(local.components.len());
        for component in &local.components {
            let label = match component.is_at_border {
                true => {
                    at_border += 1;
                    words.get(at_border - 1)?
                }
                false => next,
            };
            // Invariant: labels are given in this order, so that one that begins here has the next one, and no other has.
            next += u64::from(label == next);
            labels.push(label);
        }
        Ok(labels)
    }

    /// Cells of the components of a block, or of the one of a uniform node.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub(super) fn sizes_of(&self, number: usize, local: Option<&Local>) -> Result<Vec<u64>> {
        let Some(sizes) = &self.sizes else { return Ok(Vec::new()) };
        let mut sizes = sizes.lock().unwrap_or_else(PoisonError::into_inner);
        let mut at_border = self.entries[number].first;
        let mut next = || {
            at_border += 1;
            sizes.get(at_border - 1)
        };
        match local {
            None => Ok(vec![next()?]),
            Some(local) => local
                .components
                .iter()
                .map(|component| if component.is_at_border { next() } else { Ok(component.cells) })
                .collect(),
        }
    }

    /// The number of a node's entry, which there must be.
    pub(super) fn number_of(&self, code: Code) -> usize {
        self.entries.partition_point(|entry| entry.code.bits() < code.bits())
    }
}

/// Components at borders of blocks, each of which leads to one before it that it is united with, or to itself.
struct Forest {
    entries: Vec<Entry>,
    words: Words,
    sizes: Option<Words>,
    depth: u8,
    name: PathBuf,
}

impl Forest {
    fn add(&mut self, inside: u32, cells: u64) -> Result<u64> {
        let id = self.words.len();
        if id > PARENT {
            let advice = "take windows of it";
            return Err(Error::unsupported(
                &self.name,
                "a tree of more than 2^40 components at borders of blocks",
                advice,
            ));
        }
        self.words.push(u64::from(inside) << PARENT_BITS | id)?;
        self.sizes.as_mut().map_or(Ok(()), |sizes| sizes.push(cells))?;
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

    /// Gives all components their labels.
    fn number(mut self, progress: &dyn Progress) -> Result<Labels> {
        let mut count = 0;
        for entry in &mut self.entries {
            progress.check()?;
            entry.base = count + 1;
            let mut begun = 0;
            for id in entry.first..entry.first + u64::from(entry.at_border) {
                let word = self.words.get(id)?;
                let parent = word & PARENT;
                // Invariant: what a component leads to comes before it, so that its label is known.
                let label = match parent == id {
                    true => {
                        begun += 1;
                        entry.base + (word >> PARENT_BITS) + begun - 1
                    }
                    false => {
                        if let Some(sizes) = &mut self.sizes {
                            let cells = sizes.get(parent)?;
                            sizes.set(id, cells)?;
                        }
                        self.words.get(parent)?
                    }
                };
                self.words.set(id, label)?;
                if entry.value.is_some() {
                    entry.base = label;
                }
            }
            count += begun + u64::from(entry.inside);
        }
        let sizes = self.sizes.map(Mutex::new);
        Ok(Labels { entries: self.entries, at_borders: Mutex::new(self.words), sizes, count })
    }
}

impl Sweeper for Forest {
    fn take(&mut self, unit: &Unit<'_>) -> Result<Vec<u64>> {
        let first = self.words.len();
        let mut entry = Entry { code: unit.code, first, at_border: 0, inside: 0, base: 0, value: None };
        let mut ids = Vec::new();
        match unit.content {
            Content::Uniform(value) => {
                entry.value = Some(value);
                let cells = unit.code.dimension().cells(self.depth - unit.code.level());
                ids.push(self.add(0, cells)?);
                entry.at_border = 1;
            }
            Content::Block(local, _) => {
                for component in &local.components {
                    if component.is_at_border {
                        ids.push(self.add(entry.inside, component.cells)?);
                        entry.at_border += 1;
                    } else {
                        ids.push(u64::MAX);
                        entry.inside += 1;
                    }
                }
            }
        }
        self.entries.push(entry);
        Ok(ids)
    }

    fn meet(&mut self, a: &Run, b: &Run, _: u64) -> Result<()> {
        if a.value != b.value {
            return Ok(());
        }
        let (a, b) = (self.root(a.id)?, self.root(b.id)?);
        if a != b {
            let (first, second) = (a.min(b), a.max(b));
            let word = self.words.get(second)?;
            self.words.set(second, word & !PARENT | first)?;
            if let Some(sizes) = &mut self.sizes {
                let cells = sizes.get(first)? + sizes.get(second)?;
                sizes.set(first, cells)?;
            }
        }
        Ok(())
    }
}
