//! Gives small components to their largest neighbours, one after the other.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

use super::border::Run;
use super::labels::Labels;
use super::sweep::{Cells, Content, Sweeper, Unit};
use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result, sort};

/// Bytes of a component, and of a pair of a small component and a neighbour.
const COMPONENT_BYTES: u64 = 28;
const PAIR_BYTES: u64 = 8;

/// No component.
const NONE: u32 = u32::MAX;

/// The values that components have when all small ones have been given away.
pub(super) struct Sieved {
    values: Vec<Value>,
    /// Numbers of the values of components, by their labels.
    of_labels: Vec<u32>,
}

impl Sieved {
    /// The value of a component.
    pub(super) fn value(&self, label: u64) -> Value {
        self.values[self.of_labels[label as usize - 1] as usize]
    }

    /// Sieves components of fewer cells than `least`.
    ///
    /// # Errors
    /// If they need more memory than there is, the tree is damaged, or on interruption.
    pub(super) fn of(
        cells: &Cells,
        labels: &Labels,
        least: u64,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Sieved> {
        let room = memory / 2;
        let name = cells.view.source().name();
        if labels.count >= u64::from(NONE) || labels.count * COMPONENT_BYTES > room {
            return Err(too_large(name, labels.count * COMPONENT_BYTES, room));
        }
        let count = labels.count as usize;
        let mut neighbours = Neighbours {
            labels,
            least,
            sizes: vec![0; count],
            of_labels: vec![0; count],
            values: Vec::new(),
            numbers: HashMap::new(),
            pairs: Vec::new(),
            compacted: 1 << 16,
            most: ((room - labels.count * COMPONENT_BYTES) / PAIR_BYTES) as usize,
            name,
        };
        cells.sweep(true, memory / 4, &mut neighbours, progress)?;
        neighbours.compact();
        let Neighbours { sizes, of_labels, values, pairs, .. } = neighbours;
        let mut graph = Graph::new(sizes, of_labels, pairs);
        graph.merge(least, progress)?;
        let of_labels = (0..count as u32).map(|component| graph.value(component)).collect();
        Ok(Sieved { values, of_labels })
    }
}

fn too_large(name: &std::path::Path, needed: u64, room: u64) -> Error {
    Error::TooLarge {
        path: name.into(),
        what: "sieving so many components".into(),
        needed: 2 * needed,
        limit: 2 * room,
        advice: "allow more with --memory, or sieve windows of it".into(),
    }
}

/// Collects sizes and values of components, and which small ones are beside which others.
struct Neighbours<'a> {
    labels: &'a Labels,
    least: u64,
    sizes: Vec<u64>,
    of_labels: Vec<u32>,
    values: Vec<Value>,
    /// Numbers of values.
    numbers: HashMap<Value, u32>,
    /// Components that are small, each with one beside it: those of different labels less 1.
    pairs: Vec<u64>,
    /// Pairs of which there were none twice.
    compacted: usize,
    most: usize,
    name: &'a std::path::Path,
}

impl Neighbours<'_> {
    fn note(&mut self, label: u64, size: u64, value: Value) {
        let next = self.values.len() as u32;
        let number = *self.numbers.entry(value).or_insert(next);
        if number == next {
            self.values.push(value);
        }
        self.sizes[label as usize - 1] = size;
        self.of_labels[label as usize - 1] = number;
    }

    fn pair(&mut self, a: u64, b: u64) -> Result<()> {
        if a == b {
            return Ok(());
        }
        for (small, other) in [(a - 1, b - 1), (b - 1, a - 1)] {
            if self.sizes[small as usize] < self.least {
                self.pairs.push(small << 32 | other);
            }
        }
        if self.pairs.len() >= 2 * self.compacted || self.pairs.len() > self.most {
            self.compact();
            if self.pairs.len() > self.most {
                let needed = self.labels.count * COMPONENT_BYTES + 2 * self.pairs.len() as u64 * PAIR_BYTES;
                return Err(too_large(
                    self.name,
                    needed,
                    self.labels.count * COMPONENT_BYTES + self.most as u64 * PAIR_BYTES,
                ));
            }
        }
        Ok(())
    }

    fn compact(&mut self) {
        sort::numbers64(&mut self.pairs);
        self.pairs.dedup();
        self.compacted = self.pairs.len().max(1 << 16);
    }
}

impl Sweeper for Neighbours<'_> {
    fn take(&mut self, unit: &Unit<'_>) -> Result<Vec<u64>> {
        let number = self.labels.number_of(unit.code);
        match unit.content {
            Content::Uniform(value) => {
                let label = self.labels.of_uniform(number);
                self.note(label, self.labels.sizes_of(number, None)?[0], value);
                Ok(vec![label])
            }
            Content::Block(local, pairs) => {
                let labels = self.labels.of_block(number, local)?;
                let sizes = self.labels.sizes_of(number, Some(local))?;
                for ((label, size), component) in labels.iter().zip(sizes).zip(&local.components) {
                    self.note(*label, size, component.value);
                }
                for pair in pairs {
                    let [a, b] = pair.components.map(|component| labels[component as usize]);
                    self.pair(a, b)?;
                }
                Ok(labels)
            }
        }
    }

    fn meet(&mut self, a: &Run, b: &Run, _: u64) -> Result<()> {
        self.pair(a.id, b.id)
    }
}

/// Components that become fewer: each is one of the numbers, or was given to another.
struct Graph {
    /// The component that each was given to; itself, if it is there.
    parents: Vec<u32>,
    sizes: Vec<u64>,
    of_labels: Vec<u32>,
    /// Sorted pairs of small components and neighbours.
    pairs: Vec<u64>,
    /// Those that were given to a small component, as a list from it on: the next, and the last.
    next: Vec<u32>,
    last: Vec<u32>,
}

impl Graph {
    fn new(sizes: Vec<u64>, of_labels: Vec<u32>, pairs: Vec<u64>) -> Graph {
        let count = sizes.len() as u32;
        Graph {
            parents: (0..count).collect(),
            sizes,
            of_labels,
            pairs,
            next: vec![NONE; count as usize],
            last: (0..count).collect(),
        }
    }

    fn root(&mut self, mut number: u32) -> u32 {
        while self.parents[number as usize] != number {
            let above = self.parents[self.parents[number as usize] as usize];
            self.parents[number as usize] = above;
            number = above;
        }
        number
    }

    /// The number of the value that a component has in the end.
    fn value(&mut self, component: u32) -> u32 {
        let root = self.root(component);
        self.of_labels[root as usize]
    }

    /// The components beside a small one, each once, in order.
    fn around(&mut self, small: u32) -> Vec<u32> {
        let mut found = Vec::new();
        let mut member = small;
        while member != NONE {
            let first = self.pairs.partition_point(|pair| *pair < u64::from(member) << 32);
            for at in first..self.pairs.len() {
                let pair = self.pairs[at];
                if pair >> 32 != u64::from(member) {
                    break;
                }
                let other = self.root(pair as u32);
                if other != small {
                    found.push(other);
                }
            }
            member = self.next[member as usize];
        }
        sort::numbers32(&mut found);
        found.dedup();
        found
    }

    /// Gives components of fewer cells than `least` to their largest neighbours (of two alike to the one with the lower label), the
    /// smallest first (of two alike the one with the lower label), until none that is so small has a neighbour.
    fn merge(&mut self, least: u64, progress: &dyn Progress) -> Result<()> {
        // Invariant: what grows becomes larger than what it was given, so that nothing comes to a size that was gone through.
        let mut of_sizes: BTreeMap<u64, Vec<u32>> = BTreeMap::new();
        for (component, size) in self.sizes.iter().enumerate().filter(|(_, size)| **size < least) {
            of_sizes.entry(*size).or_default().push(component as u32);
        }
        while let Some((size, mut components)) = of_sizes.pop_first() {
            sort::numbers32(&mut components);
            self.merge_alike((size, &components), least, &mut of_sizes, progress)?;
        }
        Ok(())
    }

    /// Does so with the components of a size, in order; those that grow and stay small go to others of theirs.
    fn merge_alike(
        &mut self,
        (size, components): (u64, &[u32]),
        least: u64,
        of_sizes: &mut BTreeMap<u64, Vec<u32>>,
        progress: &dyn Progress,
    ) -> Result<()> {
        for (step, component) in components.iter().copied().enumerate() {
            if step.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            // (Those that have grown, or were given away, are no longer what they were.)
            if self.parents[component as usize] != component || self.sizes[component as usize] != size {
                continue;
            }
            let around = self.around(component);
            let by_size = |other: &&u32| (self.sizes[**other as usize], Reverse(**other));
            let Some(&largest) = around.iter().max_by_key(by_size) else { continue };
            let value = self.of_labels[largest as usize];
            self.give(component, largest, least);
            // What has the same value is one with it, now that they touch.
            for other in around {
                if other != largest && self.of_labels[other as usize] == value {
                    self.give(other, largest, least);
                }
            }
            let grown = self.sizes[largest as usize];
            if grown < least {
                of_sizes.entry(grown).or_default().push(largest);
            }
        }
        Ok(())
    }

    fn give(&mut self, component: u32, to: u32, least: u64) {
        self.parents[component as usize] = to;
        self.sizes[to as usize] += self.sizes[component as usize];
        // (Nobody asks for the neighbours of one that is large.)
        if self.sizes[to as usize] < least {
            let last = self.last[to as usize];
            self.next[last as usize] = component;
            self.last[to as usize] = self.last[component as usize];
        }
    }
}
