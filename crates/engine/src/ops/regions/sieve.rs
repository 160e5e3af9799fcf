//! Sieve: merges small components into their largest neighbours, one at a time.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use super::border::ComponentSpan;
use super::local::root;
use super::sweep::{Cells, Content, Sweeper, Unit};
use super::units::Units;
use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result, sort};

/// Bytes of a component of a block, and of a pair of them that touch.
const COMPONENT_BYTES: u64 = 28;
const PAIR_BYTES: u64 = 16;

/// No component.
const NONE: u32 = u32::MAX;

/// Values of the components after all small ones have been merged.
pub(super) struct Sieved {
    pub(super) units: Units,
    /// Number of the first component of each unit.
    firsts: Vec<u32>,
    values: Vec<Value>,
    /// Value index of each component.
    of_components: Vec<u32>,
}

impl Sieved {
    /// Value of the `index`-th component of a unit.
    pub(super) fn value(&self, unit: usize, index: usize) -> Value {
        self.values[self.of_components[self.firsts[unit] as usize + index] as usize]
    }

    /// Values of a unit's first `count` components.
    pub(super) fn values(&self, unit: usize, count: usize) -> Vec<Value> {
        (0..count).map(|index| self.value(unit, index)).collect()
    }

    /// Sieves components of fewer cells than `least`. Uses about `memory` bytes in addition to
    /// those of the blocks in progress.
    ///
    /// # Errors
    /// If they need more memory than that, the tree is corrupt, or on cancellation.
    pub(super) fn of(cells: &Cells, least: u64, memory: u64, progress: &dyn Progress) -> Result<Sieved> {
        let mut fragments = Fragments {
            units: Units::new(memory / 4),
            firsts: Vec::new(),
            depth: cells.view.depth(),
            least,
            forest: Forest::default(),
            of_fragments: Vec::new(),
            values: Vec::new(),
            numbers: HashMap::new(),
            pairs: Vec::new(),
            memory_limit: memory / 2,
            name: cells.view.source().name().into(),
        };
        cells.sweep(true, memory / 4, &mut fragments, progress)?;
        let Fragments { units, firsts, forest, of_fragments: mut of_components, values, pairs, .. } =
            fragments;
        let mut graph = Graph::new(forest, pairs, least);
        graph.merge(&of_components, least, progress)?;
        for component in 0..of_components.len() as u32 {
            // (A component into which others were merged keeps its value.)
            let root = graph.forest.root(component);
            of_components[component as usize] = of_components[root as usize];
        }
        Ok(Sieved { units, firsts, values, of_components })
    }
}

/// Union-find forest of components of blocks: each has another one as parent that it is united
/// with, or itself.
#[derive(Default)]
struct Forest {
    parents: Vec<u32>,
    /// Number of cells of the roots.
    sizes: Vec<u64>,
}

impl Forest {
    fn root(&mut self, number: u32) -> u32 {
        root(&mut self.parents, number)
    }

    /// Makes one root the child of another.
    fn give(&mut self, component: u32, to: u32) {
        self.parents[component as usize] = to;
        self.sizes[to as usize] += self.sizes[component as usize];
    }

    fn size(&self, component: u32) -> u64 {
        self.sizes[component as usize]
    }
}

/// Collects the components of units, which may be fragments of larger ones, and which of them are
/// adjacent.
///
/// Components are united with earlier ones, so that a root is numbered by its first cell.
struct Fragments {
    units: Units,
    firsts: Vec<u32>,
    depth: u8,
    least: u64,
    forest: Forest,
    /// Value index of each fragment.
    of_fragments: Vec<u32>,
    values: Vec<Value>,
    numbers: HashMap<Value, u32>,
    /// Pairs that touch, of which one may be small.
    pairs: Vec<u64>,
    /// Memory limit in bytes.
    memory_limit: u64,
    name: PathBuf,
}

impl Fragments {
    fn add(&mut self, cells: u64, value: Value) -> u64 {
        let next = self.values.len() as u32;
        let number = *self.numbers.entry(value).or_insert(next);
        if number == next {
            self.values.push(value);
        }
        let fragment = self.forest.parents.len() as u32;
        self.forest.parents.push(fragment);
        self.forest.sizes.push(cells);
        self.of_fragments.push(number);
        fragment.into()
    }

    /// Records that two components touch, unless both are known to be large.
    fn pair(&mut self, a: u32, b: u32) {
        if self.forest.size(a).min(self.forest.size(b)) < self.least {
            self.pairs.push(u64::from(a) << 32 | u64::from(b));
        }
    }

    fn needed(&self) -> u64 {
        self.forest.parents.len() as u64 * COMPONENT_BYTES + self.pairs.len() as u64 * PAIR_BYTES
    }

    /// Checks that there is memory for more.
    fn check_memory(&mut self) -> Result<()> {
        let count = self.forest.parents.len().max(self.pairs.len());
        if self.needed() <= self.memory_limit && count < NONE as usize / 2 {
            return Ok(());
        }
        self.compact();
        let count = self.forest.parents.len().max(self.pairs.len());
        // (An eighth has to remain free, so that pairs are not sorted again and again.)
        if self.needed() <= self.memory_limit - self.memory_limit / 8 && count < NONE as usize / 4 {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: self.name.clone(),
            what: "a sieve of that many components".into(),
            needed: 2 * self.needed(),
            limit: 2 * self.memory_limit,
            advice: "allow more with --memory, or sieve windows of it".into(),
        })
    }

    /// Removes duplicate pairs, and pairs of components that are both large by now.
    fn compact(&mut self) {
        let (forest, least) = (&mut self.forest, self.least);
        for pair in &mut self.pairs {
            let (a, b) = (forest.root((*pair >> 32) as u32), forest.root(*pair as u32));
            *pair = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
        }
        let is_wanted = |pair: &u64| {
            let (a, b) = ((*pair >> 32) as u32, *pair as u32);
            a != b && forest.size(a).min(forest.size(b)) < least
        };
        self.pairs.retain(is_wanted);
        sort::numbers64(&mut self.pairs);
        self.pairs.dedup();
    }
}

impl Sweeper for Fragments {
    fn take(&mut self, unit: &Unit<'_>) -> Result<Vec<u64>> {
        self.units.push(unit);
        let first = self.forest.parents.len() as u32;
        self.firsts.push(first);
        let ids = match unit.content {
            Content::Uniform(value) => {
                let cells = unit.code.dimension().cells(self.depth - unit.code.level());
                vec![self.add(cells, value)]
            }
            Content::Block(local, pairs) => {
                let components = local.components.iter();
                let ids = components.map(|component| self.add(component.cells, component.value)).collect();
                for pair in pairs {
                    let [a, b] = pair.components;
                    self.pair(first + a, first + b);
                }
                ids
            }
        };
        self.check_memory()?;
        Ok(ids)
    }

    fn meet(&mut self, a: &ComponentSpan, b: &ComponentSpan, _: u64) -> Result<()> {
        let (a, b, is_one) = (a.id as u32, b.id as u32, a.value == b.value);
        if !is_one {
            self.pair(a, b);
            return Ok(());
        }
        let (a, b) = (self.forest.root(a), self.forest.root(b));
        if a != b {
            self.forest.give(a.max(b), a.min(b));
        }
        Ok(())
    }
}

/// Components during merging.
struct Graph {
    forest: Forest,
    /// Neighbours of small components, contiguous, and the start of each component's neighbours
    /// with a final end.
    neighbours: Vec<u32>,
    begin: Vec<u32>,
    /// Linked list of the components that were merged into a small one, starting from it: the next,
    /// and the last.
    next: Vec<u32>,
    last: Vec<u32>,
}

impl Graph {
    fn new(mut forest: Forest, mut pairs: Vec<u64>, least: u64) -> Graph {
        let count = forest.parents.len();
        let mut begin = vec![0u32; count + 1];
        for pair in &mut pairs {
            let (a, b) = (forest.root((*pair >> 32) as u32), forest.root(*pair as u32));
            *pair = u64::from(a) << 32 | u64::from(b);
            for one in [a, b] {
                begin[one as usize + 1] += u32::from(a != b && forest.size(one) < least);
            }
        }
        for at in 0..count {
            begin[at + 1] += begin[at];
        }
        // Entries are filled backwards from the start of the next component's.
        let mut neighbours = vec![0; begin[count] as usize];
        for pair in pairs {
            let (a, b) = ((pair >> 32) as u32, pair as u32);
            for (one, other) in [(a, b), (b, a)] {
                if a != b && forest.size(one) < least {
                    begin[one as usize + 1] -= 1;
                    neighbours[begin[one as usize + 1] as usize] = other;
                }
            }
        }
        begin.remove(0);
        begin.push(neighbours.len() as u32);
        Graph { forest, neighbours, begin, next: vec![NONE; count], last: (0..count as u32).collect() }
    }

    /// Neighbours of a small component, each once, in order.
    fn around(&mut self, small: u32, found: &mut Vec<u32>) {
        found.clear();
        let mut member = small;
        while member != NONE {
            let neighbours = self.begin[member as usize] as usize..self.begin[member as usize + 1] as usize;
            for at in neighbours {
                let other = self.forest.root(self.neighbours[at]);
                if other != small {
                    found.push(other);
                }
            }
            member = self.next[member as usize];
        }
        sort::numbers32(found);
        found.dedup();
    }

    /// Merges components of fewer cells than `least` into their largest neighbours (of equal ones,
    /// into the one with the lower number), the smallest first (of equal ones, that with the lower
    /// number), until no small component has a neighbour.
    fn merge(&mut self, values: &[u32], least: u64, progress: &dyn Progress) -> Result<()> {
        // Invariant: a component that grows becomes larger than the merged one, so no component
        // returns to a size that was processed.
        let mut of_sizes: BTreeMap<u64, Vec<u32>> = BTreeMap::new();
        for (component, size) in self.forest.sizes.iter().enumerate().filter(|(_, size)| **size < least) {
            if self.forest.parents[component] == component as u32 {
                of_sizes.entry(*size).or_default().push(component as u32);
            }
        }
        while let Some((size, mut components)) = of_sizes.pop_first() {
            sort::numbers32(&mut components);
            self.merge_alike((size, &components), (values, least), &mut of_sizes, progress)?;
        }
        Ok(())
    }

    /// Merges the components of one size, in order. Those that grow and stay small are queued under
    /// their new size.
    fn merge_alike(
        &mut self,
        (size, components): (u64, &[u32]),
        (values, least): (&[u32], u64),
        of_sizes: &mut BTreeMap<u64, Vec<u32>>,
        progress: &dyn Progress,
    ) -> Result<()> {
        let mut around = Vec::new();
        for (step, component) in components.iter().copied().enumerate() {
            if step.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            // (Skips components that have grown or were merged.)
            if self.forest.parents[component as usize] != component || self.forest.size(component) != size {
                continue;
            }
            self.around(component, &mut around);
            let by_size = |other: &&u32| (self.forest.size(**other), Reverse(**other));
            let Some(&largest) = around.iter().max_by_key(by_size) else { continue };
            let value = values[largest as usize];
            self.give(component, largest, least);
            // Neighbours of the same value are united with it, now that they touch.
            for other in &around {
                if *other != largest && values[*other as usize] == value {
                    self.give(*other, largest, least);
                }
            }
            let grown = self.forest.size(largest);
            if grown < least {
                of_sizes.entry(grown).or_default().push(largest);
            }
        }
        Ok(())
    }

    fn give(&mut self, component: u32, to: u32, least: u64) {
        self.forest.give(component, to);
        // (The neighbours of a large component are never needed.)
        if self.forest.size(to) < least {
            let last = self.last[to as usize];
            self.next[last as usize] = component;
            self.last[to as usize] = self.last[component as usize];
        }
    }
}
