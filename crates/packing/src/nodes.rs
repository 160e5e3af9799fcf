//! Nodes of a segment, coded level by level from the top, each in the context of its neighbours.

use crate::adaptive::{Adaptive, AdaptiveSymbols, SYMBOLS};
use crate::around::{Around, FACES, MAX_DIRECTIONS, SIBLING, pattern, to_center};
use crate::bits::BitCoder;
use spinney_base::space::Dimension;
use spinney_container::{CUT, DenseKind, INNER, LEAF, RecordLayout, VOID, dense_levels};

/// Index of no node.
pub(crate) const NONE: u32 = u32::MAX;
/// Node that represents everything outside the segment's node.
const OUTSIDE: u32 = 0;
/// The segment's own node.
pub(crate) const ROOT: u32 = 1;

/// Symbol of VOID.
pub(crate) const NOTHING: u32 = 0;
/// Symbol of [`OUTSIDE`] and [`ROOT`], which is no value.
pub(crate) const BEYOND: u32 = 1;
/// Symbol of INNER and CUT nodes of solids, which have a fullness and no value. That of a CUT node
/// is coded with the node; that of INNER nodes after all nodes, predicted from the nodes below
/// ([`crate::fullness`]).
pub(crate) const MIXED: u32 = 2;
/// Symbol of siblings that are not coded yet.
const UNKNOWN: u32 = 3;
/// Symbol of the first value; the others follow.
pub(crate) const FIRST_VALUE: u32 = 4;

/// Kind of a dense block, and its levels below the node that it begins at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Dense {
    pub(crate) kind: DenseKind,
    pub(crate) levels: u8,
}

impl Dense {
    /// Record slots that the block takes, including its head.
    pub(crate) fn slots(self, layout: &RecordLayout) -> usize {
        1 + layout.dense_slots(self.kind, self.levels)
    }
}

/// All nodes of a segment, level by level, with siblings contiguous.
#[derive(Default)]
pub(crate) struct Nodes {
    /// Per node: the state in bits 0 and 1, whether a dense block begins there in bit 2, and the
    /// symbol above.
    words: Vec<u32>,
    /// First child of each node, or [`NONE`].
    first: Vec<u32>,
    /// Dense blocks and the nodes that they begin at, in ascending order of nodes.
    dense: Vec<(u32, Dense)>,
    /// Fullness of CUT and INNER nodes of a solid, in 255ths; 0 where it is not set.
    fullness: Vec<u8>,
}

/// Bit of a word that is set for INNER and CUT.
const IS_INNER: u32 = 2;
const IS_DENSE: u32 = 4;
/// Number of bits below the symbol.
const SYMBOL_AT: u32 = 3;

#[inline(always)]
fn word(state: u8, symbol: u32) -> u32 {
    symbol << SYMBOL_AT | u32::from(state)
}

impl Nodes {
    /// Returns the two nodes that every segment has: [`OUTSIDE`] and [`ROOT`].
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

    /// Returns the first child of a node, if its children are known.
    #[inline]
    pub(crate) fn first(&self, node: u32) -> Option<u32> {
        Some(self.first[node as usize]).filter(|first| *first != NONE)
    }

    /// Returns a base and a mask: the child with an index is `base + (index & mask)`. A node
    /// without known children represents all of them itself.
    #[inline]
    pub(crate) fn children(&self, node: u32) -> (u32, u32) {
        match self.first[node as usize] {
            NONE => (node, 0),
            first => (first, u32::MAX),
        }
    }

    pub(crate) fn set_first(&mut self, node: u32, first: u32) {
        self.first[node as usize] = first;
    }

    /// Returns the dense blocks and the nodes that they begin at, in ascending order of nodes.
    pub(crate) fn dense_blocks(&self) -> &[(u32, Dense)] {
        &self.dense
    }

    /// Returns the dense block that begins at a node.
    #[inline]
    pub(crate) fn dense(&self, node: u32) -> Option<Dense> {
        if self.words[node as usize] & IS_DENSE == 0 {
            return None;
        }
        let found = self.dense.binary_search_by_key(&node, |(node, _)| *node).ok()?;
        Some(self.dense[found].1)
    }

    /// Records that a dense block begins at a node. Nodes must be in ascending order.
    pub(crate) fn push_dense(&mut self, node: u32, dense: Dense) {
        self.words[node as usize] |= IS_DENSE;
        self.dense.push((node, dense));
    }

    /// Returns the fullness of a node, in 255ths.
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

/// Properties of the coded nodes that the writer and the reader both know.
#[derive(Clone, Copy)]
pub(crate) struct NodeForm {
    /// Levels from the segment's node down to the cells.
    pub(crate) height: u8,
    /// Levels from the segment's node down to the level whose nodes may be CUT.
    pub(crate) reach: u8,
    /// Whether INNER and CUT nodes have a fullness and no value: see [`MIXED`].
    pub(crate) is_solid: bool,
    /// Whether the nodes below the roots of dense blocks are coded separately.
    pub(crate) dense_apart: bool,
    /// Maximum number of INNER nodes.
    pub(crate) most: usize,
}

/// Coder of values that no neighbour has.
pub(crate) trait NewValues {
    /// Writes or reads the symbol of a value, or of VOID if that is allowed. `near` has the symbols
    /// of the parent and the neighbours. Returns `None` if there is no such value.
    fn new_value<K: BitCoder>(
        &mut self,
        coder: &mut K,
        symbol: u32,
        may_be_void: bool,
        near: &[u32],
    ) -> Option<u32>;
}

/// Number of symbols of the parent and the neighbours that are tried before a value counts as new.
const CANDIDATES: usize = 4;
/// Number of levels above the cells with contexts of their own.
const HEIGHTS: usize = 8;

/// Adaptive probabilities by context.
pub(crate) struct NodeContexts {
    /// Number of children of a node.
    children: usize,
    splits: Vec<Adaptive>,
    cuts: Vec<Adaptive>,
    matches: Vec<Adaptive>,
    dense: Vec<Adaptive>,
    /// Upper four bits of the fullness of CUT nodes, by the numbers of LEAF and of VOID face
    /// neighbours; and the lower four bits, by the upper ones.
    fullness_upper: Vec<AdaptiveSymbols>,
    fullness_lower: Vec<AdaptiveSymbols>,
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
            fullness_upper: vec![AdaptiveSymbols::default(); (FACES + 1) * (FACES + 1)],
            fullness_lower: vec![AdaptiveSymbols::default(); SYMBOLS],
        }
    }
}

/// INNER node whose children are coded next.
#[derive(Clone, Copy)]
struct NextParent {
    node: u32,
    /// Index of the parent among the INNER nodes of its level, and index of the node among the
    /// parent's children.
    parent: u32,
    child: u8,
    /// Whether a dense block begins above the node. All nodes below it inherit this: no node leaves
    /// a block downwards, since bottom nodes are VOID, LEAF or CUT. (Only corrupt input has INNER
    /// ones: `Writer::fill` in `plain.rs` refuses such a block.)
    is_in_block: bool,
}

/// Neighbourhood of the children of an INNER node, as a grid.
struct Neighbourhood<const G: usize> {
    /// Words of the children and of their neighbours.
    words: [u32; G],
    /// Mask of the cells with INNER nodes, and of those with the symbol of the children's parent.
    inner: u64,
    alike: u64,
    symbol: u32,
}

impl<const G: usize> Neighbourhood<G> {
    /// Looks up the neighbours' children in `families`. Children of the node itself are unknown.
    #[inline(always)]
    fn new<const C: usize, const D: usize>(
        around: &Around<C, D>,
        families: &[[u32; C]],
        near: &[u32; D],
        symbol: u32,
    ) -> Neighbourhood<G> {
        let mut grid = Neighbourhood { words: [UNKNOWN << SYMBOL_AT; G], inner: 0, alike: 0, symbol };
        for (near, (cells, count)) in near.iter().zip(&around.cells) {
            let family = &families[*near as usize];
            for (cell, child) in &cells[..*count] {
                grid.set(*cell, family[usize::from(*child) % C]);
            }
        }
        grid
    }

    /// Sets the word of a cell that was unknown.
    #[inline(always)]
    fn set(&mut self, cell: u8, word: u32) {
        self.words[usize::from(cell) % G] = word;
        self.inner |= u64::from(word & IS_INNER != 0) << cell;
        self.alike |= u64::from(word >> SYMBOL_AT == self.symbol) << cell;
    }

    /// Returns the words of the neighbours of a child whose neighbourhood begins at a cell.
    #[inline(always)]
    fn around<'g>(&'g self, begin: usize, offsets: &'g [u8]) -> impl Iterator<Item = u32> + Clone + 'g {
        offsets.iter().map(move |offset| self.words[(begin + usize::from(*offset)) % G])
    }
}

/// Returns the neighbours of a node. `above` has those of its parent.
#[inline(always)]
fn neighbours_of<const C: usize, const D: usize>(
    around: &Around<C, D>,
    nodes: &Nodes,
    above: &[[u32; D]],
    pending: &NextParent,
) -> [u32; D] {
    let Some(near_parent) = above.get(pending.parent as usize) else { return [OUTSIDE; D] };
    // The children of the parent's neighbours, and last the parent's own: see `Nodes::children`.
    let mut of_parent = [(OUTSIDE, 0); MAX_DIRECTIONS + 1];
    for (children, near) in of_parent.iter_mut().zip(near_parent) {
        *children = nodes.children(*near);
    }
    of_parent[usize::from(SIBLING)] = (pending.node - u32::from(pending.child), u32::MAX);
    around.of_child[usize::from(pending.child)].map(|neighbour| {
        let (base, mask) = of_parent[usize::from(neighbour.towards)];
        base + (u32::from(neighbour.child) & mask)
    })
}

/// Codes all nodes below a root with the symbol `root`. A writer takes them from `truth`; a reader
/// ignores it. Returns `None` if there are too many nodes or levels, or if a value does not exist.
///
/// Nodes are coded level by level, and parents in the order in which they were coded as children.
/// Hence the whole level above is known, and all earlier nodes of the same level.
///
/// The neighbours of an INNER node are derived from its parent's neighbours. A neighbour is a
/// sibling, a child of a neighbour of the parent, or that neighbour itself if it has no children.
/// So no node is ever searched for.
pub(crate) fn code_nodes<K: BitCoder, const C: usize, const D: usize, const G: usize>(
    form: &NodeForm,
    coder: &mut K,
    contexts: &mut NodeContexts,
    (truth, root): (&Nodes, u32),
    values: &mut impl NewValues,
) -> Option<Nodes> {
    let around: &Around<C, D> = const { &Around::new() };
    let mut nodes = Nodes::new();
    nodes.set_symbol(ROOT, root);
    // Words of the children of each node above the bottom, as neighbours see them. A node without
    // known children repeats its own word.
    // Invariant: a node has a family only once all of its children are coded. So a reader finds the
    // same families as the writer, and a neighbour that is coded later counts with its own word.
    let mut families: Vec<[u32; C]> = nodes.words.iter().map(|word| [*word; C]).collect();
    let mut true_dense = truth.dense.iter().peekable();
    // Neighbours of each INNER node of the level above.
    let mut above: Vec<[u32; D]> = Vec::new();
    let mut level = vec![NextParent { node: ROOT, parent: 0, child: 0, is_in_block: false }];
    let (mut count, mut depth) = (0, 0);
    while !level.is_empty() {
        depth += 1;
        count += level.len();
        // Invariant: no node is deeper than the cells, and there are no more nodes than fit into
        // the plain segment. Likely bits cost nearly nothing, so without this limit a few bytes of
        // an untrusted file could make many nodes.
        if depth > form.height || count > form.most {
            return None;
        }
        let is_bottom = depth == form.height;
        let height = usize::from(form.height - depth).min(HEIGHTS - 1);
        let may_be_cut = depth == form.reach && !is_bottom;
        let (mut neighbours, mut next) = (Vec::new(), Vec::new());
        for pending in &level {
            let NextParent { node, mut is_in_block, .. } = *pending;
            let near = neighbours_of(around, &nodes, &above, pending);
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
            let mut grid = Neighbourhood::<G>::new(around, &families, &near, symbol);
            let mut children = [0; C];
            for (child, center) in around.centers.iter().enumerate() {
                let begin = usize::from(*center) - to_center::<D>();
                let truth_word = if K::READS { 0 } else { truth.words[first + child] };
                let mut state = LEAF;
                if !is_bottom {
                    let context = (height * C + child) << 8 | pattern::<D>(grid.inner >> begin);
                    if coder.bit(&mut contexts.splits[context], truth_word & IS_INNER != 0) {
                        state = INNER;
                        if may_be_cut && coder.bit(&mut contexts.cuts[child], truth_word as u8 & 3 == CUT) {
                            state = CUT;
                        }
                    }
                }
                let mut found = MIXED;
                if state == LEAF || !form.is_solid {
                    let (is_inner, alike) = (state >= INNER, grid.alike >> begin);
                    let at = ChildContext { symbol, alike, child, begin, is_inner, is_bottom };
                    let around = (&grid.words, &around.offsets);
                    found = code_value(coder, contexts, values, at, around, truth_word >> SYMBOL_AT)?;
                    if found == NOTHING {
                        state = VOID;
                    }
                } else if state == CUT {
                    let this = (first + child) as u32;
                    let faces = grid.around(begin, &around.offsets[..FACES]);
                    nodes.set_fullness(this, code_cut_fullness(coder, contexts, faces, truth.fullness(this)));
                }
                children[child] = word(state, found);
                grid.set(*center, children[child]);
                if !is_bottom && state == INNER {
                    let (node, parent) = ((first + child) as u32, neighbours.len() as u32);
                    next.push(NextParent { node, parent, child: child as u8, is_in_block });
                }
            }
            nodes.words.extend_from_slice(&children);
            nodes.first.extend_from_slice(&[NONE; C]);
            nodes.set_first(node, first as u32);
            families[node as usize] = children;
            if !is_bottom {
                families.extend(children.map(|word| [word; C]));
                neighbours.push(near);
            }
        }
        (above, level) = (neighbours, next);
    }
    Some(nodes)
}

/// Context of a child's value, apart from the words of its neighbours.
#[derive(Clone, Copy)]
struct ChildContext {
    /// Symbol of the parent, and which cells have it too, from the first of the neighbourhood on.
    symbol: u32,
    alike: u64,
    /// Index among the parent's children, and the first grid cell of the neighbourhood.
    child: usize,
    begin: usize,
    is_inner: bool,
    is_bottom: bool,
}

/// Codes the symbol of a node that has a value or is VOID. Returns `None` if there is no such
/// value.
#[inline(always)]
fn code_value<K: BitCoder, const D: usize, const G: usize>(
    coder: &mut K,
    contexts: &mut NodeContexts,
    values: &mut impl NewValues,
    ChildContext { symbol, alike, child, begin, is_inner, is_bottom }: ChildContext,
    (words, offsets): (&[u32; G], &[u8; D]),
    truth: u32,
) -> Option<u32> {
    let kind = (usize::from(is_inner) * 2 + usize::from(is_bottom)) * CANDIDATES;
    let mut candidates = [NONE; CANDIDATES];
    let mut tried = 0;
    // (An INNER node is not VOID.)
    let is_value = |symbol: u32| symbol >= FIRST_VALUE || symbol == NOTHING && !is_inner;
    let mut is_it = |candidate, rank, alike: u64| {
        let context = ((kind + rank) * contexts.children + child) << 8 | pattern::<D>(alike);
        coder.bit(&mut contexts.matches[context], truth == candidate)
    };
    // The parent's symbol comes first: most children have it, and its mask is there.
    if is_value(symbol) {
        if is_it(symbol, 0, alike) {
            return Some(symbol);
        }
        candidates[0] = symbol;
        tried = 1;
    }
    let symbol_at = |offset: &u8| words[(begin + usize::from(*offset)) % G] >> SYMBOL_AT;
    for candidate in offsets.iter().map(symbol_at) {
        if !is_value(candidate) || candidates[..tried].contains(&candidate) {
            continue;
        }
        let alike = offsets
            .iter()
            .fold(0, |alike, offset| alike | u64::from(symbol_at(offset) == candidate) << offset);
        if is_it(candidate, 1 + tried.min(2), alike) {
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

/// Codes which dense block begins at a node of a tree with so many children per node: a bit whether
/// there is one, then six bits for its kind and levels. Returns `None` if there is no such block.
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

/// Codes the fullness of a CUT node.
fn code_cut_fullness<K: BitCoder>(
    coder: &mut K,
    contexts: &mut NodeContexts,
    faces: impl Iterator<Item = u32> + Clone,
    fullness: u8,
) -> u8 {
    let is_value = |word: &u32| *word & IS_INNER == 0 && *word >> SYMBOL_AT >= FIRST_VALUE;
    let is_void = |found: &u32| *found == word(VOID, NOTHING);
    let (full, empty) = (faces.clone().filter(is_value).count(), faces.filter(is_void).count());
    let context = &mut contexts.fullness_upper[full * (FACES + 1) + empty];
    let upper = coder.symbol(context, usize::from(fullness >> 4));
    let lower = coder.symbol(&mut contexts.fullness_lower[upper], usize::from(fullness & 15));
    (upper << 4 | lower) as u8
}
