//! The nodes of a segment: coded level by level from the top, each in the context of its neighbours.

use crate::adaptive::{Adaptive, AdaptiveSymbols, SYMBOLS};
use crate::around::{SIBLING, Step, steps};
use crate::bits::BitCoder;
use spinney_base::space::Dimension;
use spinney_container::{CUT, DenseKind, INNER, LEAF, RecordLayout, VOID, dense_levels};

/// No node.
pub(crate) const NONE: u32 = u32::MAX;
/// The node that stands for all that lies outside of the segment's node.
const OUTSIDE: u32 = 0;
/// The segment's own node.
pub(crate) const ROOT: u32 = 1;

/// The symbol of VOID.
pub(crate) const NOTHING: u32 = 0;
/// The symbol of what lies outside of the segment's node, and of that one.
pub(crate) const BEYOND: u32 = 1;
/// The symbol of INNER nodes whose values are made of what is below them.
pub(crate) const MIXED: u32 = 2;
/// The symbol of siblings that come later.
const UNKNOWN: u32 = 3;
/// The symbol of the first value.
pub(crate) const FIRST_VALUE: u32 = 4;

/// A dense block: its kind, and its levels below the node that it begins at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Dense {
    pub(crate) kind: DenseKind,
    pub(crate) levels: u8,
}

impl Dense {
    /// Places that it takes.
    pub(crate) fn places(self, layout: &RecordLayout) -> usize {
        1 + layout.dense_places(self.kind, self.levels)
    }
}

/// All nodes of a segment: those of a level one behind the other, siblings together.
#[derive(Default)]
pub(crate) struct Nodes {
    /// The state of each node in two bits, whether a dense block begins at it in the next, and its symbol above.
    words: Vec<u32>,
    /// The first child of each node.
    first: Vec<u32>,
    /// The dense blocks, by the nodes that they begin at.
    dense: Vec<(u32, Dense)>,
    /// How full nodes are, of 255: of those that are CUT and INNER in a solid, as far as that has been said.
    fullness: Vec<u8>,
}

/// The bit of a word for INNER and CUT.
const IS_INNER: u32 = 2;
const IS_DENSE: u32 = 4;
/// Bits below the symbol.
const SYMBOL_AT: u32 = 3;

#[inline(always)]
fn word(state: u8, symbol: u32) -> u32 {
    symbol << SYMBOL_AT | u32::from(state)
}

impl Nodes {
    /// The two nodes that all segments have.
    pub(crate) fn new() -> Nodes {
        let words = vec![word(VOID, BEYOND), word(INNER, BEYOND)];
        Nodes { words, first: vec![NONE; 2], ..Nodes::default() }
    }

    pub(crate) fn push(&mut self, state: u8, symbol: u32) {
        self.words.push(word(state, symbol));
        self.first.push(NONE);
    }

    pub(crate) fn len(&self) -> u32 {
        self.words.len() as u32
    }

    #[inline]
    pub(crate) fn state(&self, node: u32) -> u8 {
        self.words[node as usize] as u8 & 3
    }

    #[inline]
    pub(crate) fn symbol(&self, node: u32) -> u32 {
        self.words[node as usize] >> SYMBOL_AT
    }

    pub(crate) fn set_symbol(&mut self, node: u32, symbol: u32) {
        let word = &mut self.words[node as usize];
        *word = symbol << SYMBOL_AT | *word & ((1 << SYMBOL_AT) - 1);
    }

    /// The first child of a node, if its children are known.
    #[inline]
    pub(crate) fn first(&self, node: u32) -> Option<u32> {
        Some(self.first[node as usize]).filter(|first| *first != NONE)
    }

    pub(crate) fn set_first(&mut self, node: u32, first: u32) {
        self.first[node as usize] = first;
    }

    /// The dense blocks and the nodes that they begin at, in ascending order.
    pub(crate) fn dense_blocks(&self) -> &[(u32, Dense)] {
        &self.dense
    }

    /// The dense block that begins at a node.
    #[inline]
    pub(crate) fn dense(&self, node: u32) -> Option<Dense> {
        if self.words[node as usize] & IS_DENSE == 0 {
            return None;
        }
        let found = self.dense.binary_search_by_key(&node, |(node, _)| *node).ok()?;
        Some(self.dense[found].1)
    }

    /// Says that a dense block begins at a node, which comes behind all of which that was said before.
    pub(crate) fn push_dense(&mut self, node: u32, dense: Dense) {
        self.words[node as usize] |= IS_DENSE;
        self.dense.push((node, dense));
    }

    /// How full a node is.
    #[inline]
    pub(crate) fn fullness(&self, node: u32) -> u8 {
        self.fullness.get(node as usize).copied().unwrap_or_default()
    }

    pub(crate) fn set_fullness(&mut self, node: u32, fullness: u8) {
        if self.fullness.len() <= node as usize {
            self.fullness.resize(self.words.len().max(node as usize + 1), 0);
        }
        self.fullness[node as usize] = fullness;
    }
}

/// Properties of the nodes that are coded, which both sides know.
#[derive(Clone, Copy)]
pub(crate) struct NodeForm {
    /// Levels down to the cells.
    pub(crate) height: u8,
    /// Levels down to where what is heavy is cut off.
    pub(crate) reach: u8,
    /// Whether INNER and CUT nodes get their values later.
    pub(crate) is_mixed: bool,
    /// Whether the nodes below the roots of dense blocks come later.
    pub(crate) dense_apart: bool,
    /// INNER nodes at most.
    pub(crate) most: usize,
}

/// Codes values that no neighbour has.
pub(crate) trait NewValues {
    /// Writes or reads the symbol of a value, or of VOID if that may be; `near` are symbols of the parent and of neighbours. `None` if
    /// there is no such value.
    fn new_value<K: BitCoder>(
        &mut self,
        coder: &mut K,
        symbol: u32,
        may_be_void: bool,
        near: &[u32],
    ) -> Option<u32>;
}

/// Neighbours' symbols that are tried before a value counts as new.
const CANDIDATES: usize = 4;
/// Directions across faces of an octree's node, which come first.
const FACES: usize = 6;
/// Levels above the cells that have contexts of their own.
const HEIGHTS: usize = 8;

/// Probabilities by context.
pub(crate) struct NodeContexts {
    /// Children of a node.
    children: usize,
    splits: Vec<Adaptive>,
    cuts: Vec<Adaptive>,
    matches: Vec<Adaptive>,
    dense: Vec<Adaptive>,
    /// Of how full CUT nodes are: sixteenths by how many neighbours are full and empty, and sixteenths of these by themselves.
    sixteenths: Vec<AdaptiveSymbols>,
    parts: Vec<AdaptiveSymbols>,
}

impl NodeContexts {
    pub(crate) fn new(children: usize) -> NodeContexts {
        let some = |count| vec![Adaptive::default(); count];
        let by_neighbours = children << 8;
        NodeContexts {
            children,
            splits: some(HEIGHTS * by_neighbours),
            cuts: some(children),
            matches: some(2 * 2 * CANDIDATES * by_neighbours),
            dense: some(HEIGHTS * 64),
            sixteenths: vec![AdaptiveSymbols::default(); (FACES + 1) * (FACES + 1)],
            parts: vec![AdaptiveSymbols::default(); SYMBOLS],
        }
    }
}

/// The neighbours of which something is true, in 8 bits: of a quadtree's eight one each; of an octree's six across faces one each, and
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

/// Codes all nodes below one with the symbol `root`: `truth` has those to be written. `None` if there are more than there can be, or values that are
/// none.
///
/// Nodes come level by level, parents in the order in which they came as children. So all of the level above is known, and of
/// a node's own level what comes before it.
///
/// The neighbours of an INNER node are found from those of its parent, which took the same way: a neighbour is a sibling, or a child of a
/// neighbour of the parent, or that one itself where it has no children. So no node is ever searched for.
pub(crate) fn code_nodes<K: BitCoder, const C: usize, const D: usize>(
    form: &NodeForm,
    coder: &mut K,
    contexts: &mut NodeContexts,
    (truth, root): (&Nodes, u32),
    values: &mut impl NewValues,
) -> Option<Nodes> {
    let steps: &[[Step; D]; C] = &const { steps::<C, D>() };
    let mut nodes = Nodes::new();
    nodes.set_symbol(ROOT, root);
    let mut true_dense = truth.dense.iter().peekable();
    let true_fullness = |node| truth.fullness(node);
    // Of each INNER node of the level above: its neighbours.
    let mut above: Vec<[u32; D]> = Vec::new();
    // The INNER nodes of this level: the parent's place in `above`, the number among its children, and whether it is in a
    // dense block.
    let mut level = vec![(ROOT, 0, 0, false)];
    let (mut count, mut depth) = (0, 0);
    while !level.is_empty() {
        depth += 1;
        count += level.len();
        // Invariant: no node is deeper than the cells, and there are no more than the plain segment has room for: a few hostile bytes
        // cannot make many nodes of likely bits, which cost nearly nothing.
        if depth > form.height || count > form.most {
            return None;
        }
        let is_bottom = depth == form.height;
        let height = usize::from(form.height - depth).min(HEIGHTS - 1);
        let may_be_cut = depth == form.reach && !is_bottom;
        let mut neighbours: Vec<[u32; D]> = Vec::with_capacity(level.len());
        let mut next = Vec::new();
        for &(node, parent, child, mut is_in_block) in &level {
            let mut near = [OUTSIDE; D];
            if node != ROOT {
                let siblings = node - child as u32;
                let of_parent = &above[parent as usize];
                for (near, step) in near.iter_mut().zip(&steps[child]) {
                    *near = match step.towards {
                        SIBLING => siblings + u32::from(step.child),
                        towards => {
                            let there = of_parent[usize::from(towards)];
                            match nodes.first[there as usize] {
                                NONE => there,
                                first => first + u32::from(step.child),
                            }
                        }
                    };
                }
            }
            if !is_in_block {
                let dense = true_dense.next_if(|(begin, _)| *begin == node).map(|(_, dense)| *dense);
                let of_height = &mut contexts.dense[64 * height..][..64];
                if let Some(dense) = code_dense(coder, of_height, C, dense)? {
                    nodes.push_dense(node, dense);
                    is_in_block = true;
                    if form.dense_apart {
                        continue;
                    }
                }
            }
            let symbol = nodes.symbol(node);
            let first = nodes.words.len();
            // The neighbours' children, if these are known, else the neighbours.
            // Invariant: a node has its first child's number only when all of its children are there, which is when they have been coded. So
            // a reader, who has no others, finds the same; and a neighbour whose turn comes later counts as it is seen from above.
            let firsts = near.map(|near| nodes.first[near as usize]);
            let own = near.map(|near| nodes.words[near as usize]);
            let mut children = [UNKNOWN << SYMBOL_AT; C];
            for (child, steps) in steps.iter().enumerate() {
                let mut words = [0; D];
                for (word, step) in words.iter_mut().zip(steps) {
                    *word = match step.towards {
                        SIBLING => children[usize::from(step.child) % C],
                        towards => match firsts[usize::from(towards) % D] {
                            NONE => own[usize::from(towards) % D],
                            first => nodes.words[first as usize + usize::from(step.child)],
                        },
                    };
                }
                let truth = if K::READS { 0 } else { truth.words[first + child] };
                let mut state = LEAF;
                if !is_bottom {
                    let context = (height * C + child) << 8 | pattern(&words, |word| word & IS_INNER != 0);
                    if coder.bit(&mut contexts.splits[context], truth & IS_INNER != 0) {
                        state = INNER;
                        if may_be_cut && coder.bit(&mut contexts.cuts[child], truth as u8 & 3 == CUT) {
                            state = CUT;
                        }
                    }
                }
                let mut found = MIXED;
                if state == LEAF || !form.is_mixed {
                    let place = Place { symbol, child, state, is_bottom };
                    found = code_value(coder, contexts, values, place, &words, truth >> SYMBOL_AT)?;
                    if found == NOTHING {
                        state = VOID;
                    }
                } else if state == CUT {
                    let this = (first + child) as u32;
                    nodes.set_fullness(this, code_fullness(coder, contexts, &words, true_fullness(this)));
                }
                children[child] = word(state, found);
                if state == INNER {
                    next.push(((first + child) as u32, neighbours.len() as u32, child, is_in_block));
                }
            }
            nodes.words.extend_from_slice(&children);
            nodes.first.extend_from_slice(&[NONE; C]);
            nodes.set_first(node, first as u32);
            neighbours.push(near);
        }
        (above, level) = (neighbours, next);
    }
    Some(nodes)
}

/// Where a value is coded.
#[derive(Clone, Copy)]
struct Place {
    /// The parent's symbol.
    symbol: u32,
    /// The number among the parent's children.
    child: usize,
    state: u8,
    is_bottom: bool,
}

/// Codes the symbol of a node that has a value or is VOID. `None` if it is a value that is none.
#[inline(always)]
fn code_value<K: BitCoder, const D: usize>(
    coder: &mut K,
    contexts: &mut NodeContexts,
    values: &mut impl NewValues,
    place: Place,
    words: &[u32; D],
    truth: u32,
) -> Option<u32> {
    let is_inner = place.state >= INNER;
    let kind = (usize::from(is_inner) * 2 + usize::from(place.is_bottom)) * CANDIDATES;
    let mut candidates = [NONE; CANDIDATES];
    let mut tried = 0;
    let around = words.iter().map(|word| word >> SYMBOL_AT);
    for candidate in std::iter::once(place.symbol).chain(around) {
        // (What is INNER is not VOID.)
        let is_value = candidate >= FIRST_VALUE || candidate == NOTHING && !is_inner;
        if !is_value || candidates[..tried].contains(&candidate) {
            continue;
        }
        let rank = if candidate == place.symbol { 0 } else { 1 + tried.min(2) };
        let alike = pattern(words, |word| word >> SYMBOL_AT == candidate);
        let context = ((kind + rank) * contexts.children + place.child) << 8 | alike;
        if coder.bit(&mut contexts.matches[context], truth == candidate) {
            return Some(candidate);
        }
        candidates[tried] = candidate;
        tried += 1;
        if tried == CANDIDATES {
            break;
        }
    }
    let new = values.new_value(coder, truth, !is_inner, &candidates[..tried])?;
    (new != NOTHING || !is_inner).then_some(new)
}

/// Codes which dense block begins at a node of a tree whose nodes have so many children: by a bit whether one does, then by six for what kind and
/// how many levels. `None` if there is no such block.
fn code_dense<K: BitCoder>(
    coder: &mut K,
    contexts: &mut [Adaptive],
    children: usize,
    dense: Option<Dense>,
) -> Option<Option<Dense>> {
    if !coder.bit(&mut contexts[0], dense.is_some()) {
        return Some(None);
    }
    let number = dense.map_or(0, |dense| dense.kind.number() | (dense.levels - 1) << 3);
    let mut path = 1;
    for bit in (0..6).rev() {
        let is_set = coder.bit(&mut contexts[path & 63], number >> bit & 1 == 1);
        path = path << 1 | usize::from(is_set);
    }
    let (number, levels) = (path as u8 & 7, (path as u8 >> 3 & 7) + 1);
    let dimension = if children == 4 { Dimension::Quad } else { Dimension::Oct };
    let kind = DenseKind::from_number(number).filter(|_| dense_levels(dimension).contains(&levels))?;
    Some(Some(Dense { kind, levels }))
}

/// Codes how full a CUT node is.
fn code_fullness<K: BitCoder, const D: usize>(
    coder: &mut K,
    contexts: &mut NodeContexts,
    words: &[u32; D],
    fullness: u8,
) -> u8 {
    let faces = words[..FACES].iter();
    let is_value = |word: &&u32| **word & IS_INNER == 0 && **word >> SYMBOL_AT >= FIRST_VALUE;
    let is_void = |found: &&u32| **found == word(VOID, NOTHING);
    let (full, empty) = (faces.clone().filter(is_value).count(), faces.filter(is_void).count());
    let context = &mut contexts.sixteenths[full * (FACES + 1) + empty];
    let upper = coder.symbol(context, usize::from(fullness >> 4));
    let lower = coder.symbol(&mut contexts.parts[upper], usize::from(fullness & 15));
    (upper << 4 | lower) as u8
}
