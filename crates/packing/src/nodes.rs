//! The nodes of a segment: coded level by level from the top, each in the context of its neighbours.

use crate::around::{SIBLING, Step, steps};
use crate::bits::{Adaptive, AdaptiveSymbols, BitCoder, SYMBOLS};
use crate::layout::{CUT, Dense, INNER, LEAF, VOID};

/// No node.
pub(crate) const NONE: u32 = u32::MAX;
/// The node that stands for all that lies outside of the segment's node.
const OUTSIDE: u32 = 0;
/// The segment's own node.
pub(crate) const ROOT: u32 = 1;

/// The symbol of VOID.
pub(crate) const NOTHING: u32 = 0;
/// The symbol of what lies outside of the segment's node.
const BEYOND: u32 = 1;
/// The symbol of INNER nodes whose values are made of what is below them.
pub(crate) const MIXED: u32 = 2;
/// The symbol of siblings that come later.
const UNKNOWN: u32 = 3;
/// The symbol of the first value.
pub(crate) const FIRST_VALUE: u32 = 4;

/// All nodes of a segment: those of a level one behind the other, siblings together.
#[derive(Default)]
pub(crate) struct Nodes {
    states: Vec<u8>,
    /// The symbol of each node, and in the lowest bit whether it is INNER or CUT.
    words: Vec<u32>,
    /// The first child of each node.
    first: Vec<u32>,
    /// The dense block that a node is the root of: its mark, and above these three bits its levels less one. 0 if there is none.
    dense: Vec<u8>,
    /// How full nodes are, of 255: of CUT nodes where the values of INNER and CUT nodes come later, else nothing.
    pub fullness: Vec<u8>,
}

impl Nodes {
    /// The two nodes that all segments have.
    pub(crate) fn new() -> Nodes {
        let mut nodes = Nodes::default();
        nodes.push(VOID, BEYOND);
        nodes.push(INNER, BEYOND);
        nodes
    }

    pub(crate) fn push(&mut self, state: u8, symbol: u32) {
        self.states.push(state);
        self.words.push(symbol << 1 | u32::from(state >= INNER));
        self.first.push(NONE);
        self.dense.push(0);
        self.fullness.push(0);
    }

    pub(crate) fn len(&self) -> u32 {
        self.states.len() as u32
    }

    #[inline]
    pub(crate) fn state(&self, node: u32) -> u8 {
        self.states[node as usize]
    }

    #[inline]
    pub(crate) fn symbol(&self, node: u32) -> u32 {
        self.words[node as usize] >> 1
    }

    pub(crate) fn set_symbol(&mut self, node: u32, symbol: u32) {
        let word = &mut self.words[node as usize];
        *word = symbol << 1 | *word & 1;
    }

    /// The first child of a node, if its children are known.
    #[inline]
    pub(crate) fn first(&self, node: u32) -> Option<u32> {
        Some(self.first[node as usize]).filter(|first| *first != NONE)
    }

    pub(crate) fn set_first(&mut self, node: u32, first: u32) {
        self.first[node as usize] = first;
    }

    /// The dense block that a node is the root of.
    pub(crate) fn dense(&self, node: u32) -> Option<Dense> {
        let dense = self.dense[node as usize];
        (dense != 0).then_some(Dense { mark: dense & 7, levels: (dense >> 3) + 1 })
    }

    pub(crate) fn set_dense(&mut self, node: u32, dense: Dense) {
        self.dense[node as usize] = dense.mark | (dense.levels - 1) << 3;
    }

    /// The node that a step leads to from a child of a node's neighbour: the neighbour's child if it has any, else itself.
    #[inline(always)]
    fn step(&self, neighbour: u32, child: u8) -> u32 {
        match self.first[neighbour as usize] {
            NONE => neighbour,
            first => first + u32::from(child),
        }
    }
}

/// What is coded.
#[derive(Clone, Copy)]
pub(crate) struct NodeForm {
    /// Levels down to the cells.
    pub height: u8,
    /// Levels down to where what is heavy is cut off.
    pub reach: u8,
    /// Whether INNER and CUT nodes get their values later.
    pub is_mixed: bool,
    /// Whether the nodes below the roots of dense blocks come later.
    pub dense_apart: bool,
    /// INNER nodes at most.
    pub most: usize,
}

/// Codes values that no neighbour has.
pub(crate) trait NewValues {
    /// Writes or reads a value's symbol; `near` are symbols of the parent and of neighbours. `None` if there is no such value.
    fn new_value<K: BitCoder>(&mut self, coder: &mut K, symbol: u32, near: &[u32]) -> Option<u32>;
}

/// Neighbours' symbols that are tried before a value counts as new.
const CANDIDATES: usize = 4;
/// Directions across faces of an octree's node, which come first.
const FACES: usize = 6;
/// Levels above the cells that have contexts of their own.
const HEIGHTS: usize = 8;

/// Probabilities by context.
struct Contexts {
    splits: Vec<Adaptive>,
    cuts: Vec<Adaptive>,
    matches: Vec<Adaptive>,
    dense: Vec<Adaptive>,
    /// Of how full CUT nodes are: sixteenths by how many neighbours are full and empty, and sixteenths of these by themselves.
    sixteenths: Vec<AdaptiveSymbols>,
    parts: Vec<AdaptiveSymbols>,
}

impl Contexts {
    fn new(children: usize) -> Contexts {
        let some = |count| vec![Adaptive::default(); count];
        let by_neighbours = children << 8;
        Contexts {
            splits: some(HEIGHTS * by_neighbours),
            cuts: some(children),
            matches: some(2 * 2 * CANDIDATES * by_neighbours),
            dense: some(HEIGHTS * 64),
            sixteenths: vec![AdaptiveSymbols::default(); (FACES + 1) * (FACES + 1)],
            parts: vec![AdaptiveSymbols::default(); SYMBOLS],
        }
    }
}

/// What is true of each neighbour, in 8 bits: of a quadtree's eight one each; of an octree's six across faces one each, and
/// of those across edges about how many there are.
#[inline(always)]
fn pattern<const D: usize>(words: &[u32; D], is_true: impl Fn(u32) -> bool) -> usize {
    let bits = |words: &[u32]| words.iter().fold(0, |bits, word| bits << 1 | usize::from(is_true(*word)));
    if D == 8 {
        bits(words)
    } else {
        let edges: usize = words[FACES..].iter().map(|word| usize::from(is_true(*word))).sum();
        (bits(&words[..FACES]) << 2) | (edges.min(11) / 3)
    }
}

/// Codes all nodes: `truth` has those to be written. `None` if there are more than there can be, or values that are none.
///
/// Nodes come level by level, parents in the order in which they came as children. So all of the level above is known, and of
/// a node's own level what comes before it.
pub(crate) fn code_nodes<K: BitCoder, const C: usize, const D: usize>(
    form: &NodeForm,
    coder: &mut K,
    truth: &Nodes,
    values: &mut impl NewValues,
) -> Option<Nodes> {
    let steps: &[[Step; D]; C] = &const { steps::<C, D>() };
    let mut nodes = Nodes::new();
    let mut contexts = Contexts::new(C);
    // Of each INNER node of the level above: its neighbours.
    let mut above: Vec<[u32; D]> = Vec::new();
    // The INNER nodes of this level: the parent's place in `above`, the number among its children, and whether it is in a
    // dense block.
    let mut level = vec![(ROOT, 0, 0, false)];
    let (mut count, mut depth) = (0, 0);
    while !level.is_empty() {
        depth += 1;
        if depth > form.height {
            return None;
        }
        let is_bottom = depth == form.height;
        let height = usize::from(form.height - depth).min(HEIGHTS - 1);
        let may_be_cut = depth == form.reach && !is_bottom;
        let mut neighbours: Vec<[u32; D]> = Vec::with_capacity(level.len());
        let mut next = Vec::new();
        for &(node, parent, child, is_in_block) in &level {
            count += 1;
            if count > form.most {
                return None;
            }
            let mut near = [OUTSIDE; D];
            if node != ROOT {
                let siblings = node - u32::from(child);
                let of_parent = &above[parent as usize];
                for (near, step) in near.iter_mut().zip(&steps[usize::from(child)]) {
                    *near = match step.towards {
                        SIBLING => siblings + u32::from(step.child),
                        towards => nodes.step(of_parent[usize::from(towards)], step.child),
                    };
                }
            }
            let mut is_in_block = is_in_block;
            if !is_in_block {
                let dense = truth.dense.get(node as usize).copied().unwrap_or_default();
                let dense = code_dense(coder, &mut contexts.dense[64 * height..][..64], dense);
                nodes.dense[node as usize] = dense;
                is_in_block = dense != 0;
                if is_in_block && form.dense_apart {
                    continue;
                }
            }
            let symbol = nodes.symbol(node);
            let first = nodes.len();
            for (child, steps) in steps.iter().enumerate() {
                let mut words = [UNKNOWN << 1; D];
                for (word, step) in words.iter_mut().zip(steps) {
                    if step.towards != SIBLING {
                        *word = nodes.words[nodes.step(near[usize::from(step.towards)], step.child) as usize];
                    } else if usize::from(step.child) < child {
                        *word = nodes.words[(first + u32::from(step.child)) as usize];
                    }
                }
                let this = first as usize + child;
                let (true_state, true_symbol) =
                    if K::READS { (VOID, NOTHING) } else { (truth.states[this], truth.words[this] >> 1) };
                let mut state = LEAF;
                if !is_bottom {
                    let context = (height * C + child) << 8 | pattern(&words, |word| word & 1 == 1);
                    if coder.bit(&mut contexts.splits[context], true_state >= INNER) {
                        let is_cut = may_be_cut && coder.bit(&mut contexts.cuts[child], true_state == CUT);
                        state = if is_cut { CUT } else { INNER };
                    }
                }
                let is_inner = state >= INNER;
                let kind = (usize::from(is_inner) * 2 + usize::from(is_bottom)) * CANDIDATES;
                let mut found = if is_inner && form.is_mixed { MIXED } else { NONE };
                let mut candidates = [NONE; CANDIDATES];
                let mut tried = 0;
                let around = words.iter().map(|word| word >> 1);
                for candidate in std::iter::once(symbol).chain(around) {
                    if found != NONE || tried == CANDIDATES {
                        break;
                    }
                    // (What is INNER is not VOID.)
                    let is_value = candidate >= FIRST_VALUE || candidate == NOTHING && !is_inner;
                    if !is_value || candidates[..tried].contains(&candidate) {
                        continue;
                    }
                    candidates[tried] = candidate;
                    let rank = if candidate == symbol { 0 } else { 1 + tried.min(2) };
                    let alike = pattern(&words, |word| word >> 1 == candidate);
                    let context = ((kind + rank) * C + child) << 8 | alike;
                    if coder.bit(&mut contexts.matches[context], true_symbol == candidate) {
                        found = candidate;
                    }
                    tried += 1;
                }
                if found == NONE {
                    found = values.new_value(coder, true_symbol, &candidates[..tried])?;
                }
                if found == NOTHING {
                    if is_inner {
                        return None;
                    }
                    state = VOID;
                }
                nodes.push(state, found);
                if found == MIXED && state == CUT {
                    let truth = truth.fullness.get(this).copied().unwrap_or_default();
                    nodes.fullness[this] = code_fullness(coder, &mut contexts, &words, truth);
                }
                if state == INNER {
                    let parent = neighbours.len() as u32;
                    next.push((first + child as u32, parent, child as u8, is_in_block));
                }
            }
            nodes.set_first(node, first);
            neighbours.push(near);
        }
        (above, level) = (neighbours, next);
    }
    Some(nodes)
}

/// Codes which dense block begins at a node: by a bit whether one does, then by six for what kind and how many levels.
fn code_dense<K: BitCoder>(coder: &mut K, contexts: &mut [Adaptive], dense: u8) -> u8 {
    if !coder.bit(&mut contexts[0], dense != 0) {
        return 0;
    }
    let mut path = 1;
    for bit in (0..6).rev() {
        let is_set = coder.bit(&mut contexts[path & 63], dense >> bit & 1 == 1);
        path = path << 1 | usize::from(is_set);
    }
    (path & 63) as u8
}

/// Codes how full a CUT node is.
fn code_fullness<K: BitCoder, const D: usize>(
    coder: &mut K,
    contexts: &mut Contexts,
    words: &[u32; D],
    fullness: u8,
) -> u8 {
    let faces = words[..FACES].iter();
    let is_value = |word: &&u32| **word & 1 == 0 && **word >> 1 >= FIRST_VALUE;
    let (full, empty) =
        (faces.clone().filter(is_value).count(), faces.filter(|word| **word == NOTHING << 1).count());
    let context = &mut contexts.sixteenths[full * (FACES + 1) + empty];
    let upper = coder.symbol(context, usize::from(fullness >> 4));
    let lower = coder.symbol(&mut contexts.parts[upper], usize::from(fullness & 15));
    (upper << 4 | lower) as u8
}
