//! Dense blocks: subtrees stored as rows of values instead of records (section 6 of formats.md).

use std::ops::RangeInclusive;

use spinney_base::space::{Cell, Dimension};
use spinney_base::value::Value;

use super::record_layout::{RecordHead, RecordLayout};
use super::state::{CUT, INNER, LEAF, VOID};

/// Maximum number of levels below the root of a dense block.
pub const MAX_DENSE_LEVELS: u8 = 8;

/// Returns the valid numbers of levels below the root of a dense block: 8 to 256 values along each
/// axis of a quadtree, 4 to 16 of an octree.
pub const fn dense_levels(dimension: Dimension) -> RangeInclusive<u8> {
    match dimension {
        Dimension::Quad => 3..=MAX_DENSE_LEVELS,
        Dimension::Oct => 2..=4,
    }
}

/// States of the bottom nodes, indexed by the number in the record; 0 marks a record that is not a
/// dense block. Nodes whose mask bit is set have the first state, the others the second. Without a
/// second state, there is no mask and all nodes have the first.
const BOTTOM_STATES: [Option<(u8, Option<u8>)>; 6] = [
    None,
    Some((LEAF, None)),
    Some((CUT, None)),
    Some((LEAF, Some(VOID))),
    Some((CUT, Some(VOID))),
    Some((CUT, Some(LEAF))),
];

/// Kind of a dense block: the states that its bottom nodes have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DenseKind(u8);

impl DenseKind {
    /// All bottom nodes are LEAF.
    pub const ALL_LEAF: DenseKind = DenseKind(1);
    /// Bottom nodes are LEAF or VOID.
    pub const LEAF_OR_VOID: DenseKind = DenseKind(3);

    /// Returns whether blocks of this kind have a mask with one bit per bottom node.
    #[inline]
    pub const fn has_mask(self) -> bool {
        matches!(BOTTOM_STATES[self.0 as usize], Some((_, Some(_))))
    }

    /// Returns whether no bottom node is CUT.
    #[inline]
    pub fn is_leaves(self) -> bool {
        self == DenseKind::ALL_LEAF || self == DenseKind::LEAF_OR_VOID
    }

    /// Returns the kind with this number, if there is one.
    #[inline]
    pub fn from_number(number: u8) -> Option<DenseKind> {
        BOTTOM_STATES.get(usize::from(number)).copied().flatten().map(|_| DenseKind(number))
    }

    /// Returns the kind for a set of bottom states, given as bits 1 (VOID), 2 (LEAF) and 8 (CUT);
    /// `None` if no kind has this set.
    #[inline]
    pub fn of_states(states: u8) -> Option<DenseKind> {
        let of = |(first, second): (u8, Option<u8>)| 1 << first | second.map_or(0, |second| 1 << second);
        let number = BOTTOM_STATES.iter().position(|kind| kind.map(of) == Some(states));
        number.map(|number| DenseKind(number as u8))
    }

    /// The number in the record.
    #[inline]
    pub fn number(self) -> u8 {
        self.0
    }

    /// State of the bottom nodes, and the state of those whose mask bit is not set.
    #[inline]
    pub fn states(self) -> (u8, Option<u8>) {
        BOTTOM_STATES[usize::from(self.0)].unwrap_or((VOID, None))
    }
}

impl RecordLayout {
    /// Number of nodes of levels 2 to `levels` of a dense block.
    #[inline]
    const fn dense_nodes(&self, levels: u8) -> usize {
        // A geometric sum: c^2 + c^3 ... for c children.
        let children = self.children();
        (self.dimension.cells(levels + 1) as usize - children * children) / (children - 1)
    }

    /// Number of record slots that a dense block occupies after its own record.
    #[inline]
    pub const fn dense_slots(&self, kind: DenseKind, levels: u8) -> usize {
        let mask = if kind.has_mask() { self.dimension.cells(levels) as usize / 8 } else { 0 };
        (self.dense_nodes(levels) * self.width + mask).div_ceil(self.size)
    }

    /// Kind and levels of the dense block with this record head; `None` if it is not a dense block.
    #[inline]
    fn dense_kind(&self, head: RecordHead) -> Option<(DenseKind, u8)> {
        let kind = DenseKind::from_number(head.dense)?;
        // The number of levels is not stored: it follows from the length. Blocks of one kind with
        // different numbers of levels have different lengths, since each further level has four (or
        // eight) times as many values.
        let levels = dense_levels(self.dimension)
            .find(|levels| self.dense_slots(kind, *levels) + 1 == head.skip as usize)?;
        Some((kind, levels))
    }

    /// Returns the dense block of the record with index `at` and this head. `None` if it is not a
    /// dense block, or not contained in `records` completely.
    #[inline]
    pub fn dense<'r>(&self, records: &'r [u8], at: usize, head: RecordHead) -> Option<DenseBlock<'r>> {
        let (kind, levels) = self.dense_kind(head)?;
        let bytes = self.subtree(records, at, head.skip)?;
        Some(DenseBlock { layout: *self, kind, levels, bytes })
    }

    /// Byte offset of a level's values in a dense block.
    #[inline]
    pub const fn dense_values_at(&self, level: u8) -> usize {
        // The root's record has the values of its children. Z order of two nodes along each axis
        // equals row order.
        if level > 1 { self.size + self.dense_nodes(level - 1) * self.width } else { 0 }
    }

    /// Byte offset of the mask of a dense block with `levels` levels, if its kind has a mask.
    #[inline]
    pub const fn dense_mask_at(&self, levels: u8) -> usize {
        self.size + self.dense_nodes(levels) * self.width
    }
}

/// Index of a node in its level of a dense block by position: x fastest, then y, then z.
#[inline]
const fn dense_index(level: u8, [x, y, z]: [usize; 3]) -> usize {
    // In quadtrees z is 0.
    (z << level | y) << level | x
}

/// Position of the node with this index in its level of a dense block.
#[inline]
const fn dense_place(level: u8, index: usize) -> [usize; 3] {
    let mask = (1 << level) - 1;
    [index & mask, index >> level & mask, index >> (2 * level)]
}

/// Returns the index in `level` of the child `step` of the node `parent` one level above. Level 0
/// is the root, which has index 0.
#[inline]
pub const fn dense_child(level: u8, parent: usize, step: usize) -> usize {
    let [x, y, z] = dense_place(level - 1, parent);
    dense_index(level, [x << 1 | step & 1, y << 1 | step >> 1 & 1, z << 1 | step >> 2])
}

/// A dense block in a slice of records.
#[derive(Clone, Copy)]
pub struct DenseBlock<'r> {
    /// Layout of its record.
    pub layout: RecordLayout,
    /// States of its bottom nodes.
    pub kind: DenseKind,
    /// Number of levels below the root.
    pub levels: u8,
    /// The record and the payload.
    bytes: &'r [u8],
}

impl<'r> DenseBlock<'r> {
    /// Creates a block of `levels` levels from its bytes: the record and the payload that follows
    /// it.
    #[inline]
    pub fn new(layout: RecordLayout, kind: DenseKind, levels: u8, bytes: &'r [u8]) -> DenseBlock<'r> {
        DenseBlock { layout, kind, levels, bytes }
    }

    /// The values of all nodes of a level below the root, in rows: x fastest, then y, then z.
    /// Values of VOID nodes are zeros.
    #[inline]
    pub fn values(&self, level: u8) -> &'r [u8] {
        let layout = &self.layout;
        let nodes = layout.dimension.cells(level) as usize;
        let start = layout.dense_values_at(level);
        &self.bytes[start..start + nodes * layout.width]
    }

    /// The mask with one bit per bottom node, if bottom nodes have two states.
    #[inline]
    pub fn mask(&self) -> Option<&'r [u8]> {
        self.kind.states().1?;
        let layout = &self.layout;
        let start = layout.dense_mask_at(self.levels);
        Some(&self.bytes[start..start + layout.dimension.cells(self.levels) as usize / 8])
    }

    /// Number of children of a node.
    #[inline]
    pub fn children(&self) -> usize {
        self.layout.children()
    }

    /// Returns whether no node of the block is VOID.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.kind.states().1 != Some(VOID)
    }

    /// State of a bottom node: VOID, LEAF or CUT.
    #[inline]
    pub fn bottom_state(&self, index: usize) -> u8 {
        match (self.kind.states(), self.mask()) {
            ((_, Some(other)), Some(mask)) if mask[index / 8] >> (index % 8) & 1 == 0 => other,
            ((state, _), _) => state,
        }
    }

    /// Index in its level of the node at a position.
    #[inline]
    pub fn index(&self, level: u8, place: [usize; 3]) -> usize {
        dense_index(level, place)
    }

    /// Position of the node with this index in its level.
    #[inline]
    pub fn place(&self, level: u8, index: usize) -> [usize; 3] {
        dense_place(level, index)
    }

    /// State of a node of a level below the root.
    #[inline]
    pub fn state(&self, level: u8, index: usize) -> u8 {
        let below = self.levels - level;
        if below == 0 {
            return self.bottom_state(index);
        }
        let width = self.layout.width;
        let values = self.values(self.levels);
        let value_at = |index: usize| &values[index * width..(index + 1) * width];
        let [x, y, z] = self.place(level, index).map(|cell| cell << below);
        let depth = if self.layout.dimension == Dimension::Oct { 1 << below } else { 1 };
        let first = self.index(self.levels, [x, y, z]);
        let (state, value) = (self.bottom_state(first), value_at(first));
        let rows = (z..z + depth).flat_map(|z| (y..y + (1 << below)).map(move |y| (y, z)));
        for (y, z) in rows {
            let start = self.index(self.levels, [x, y, z]);
            for index in start..start + (1 << below) {
                // Subtrees of CUT nodes are not uniform.
                let is_same = state != CUT
                    && self.bottom_state(index) == state
                    && (state == VOID || value_at(index) == value);
                if !is_same {
                    return INNER;
                }
            }
        }
        state
    }

    /// Returns whether all bottom nodes under a node are VOID.
    #[inline]
    pub fn is_void(&self, level: u8, index: usize) -> bool {
        if self.is_full() {
            return false;
        }
        let below = self.levels - level;
        let [x, y, z] = self.place(level, index).map(|cell| cell << below);
        let depth = if self.layout.dimension == Dimension::Oct { 1 << below } else { 1 };
        let mut rows = (z..z + depth).flat_map(|z| (y..y + (1 << below)).map(move |y| (y, z)));
        rows.all(|(y, z)| {
            let start = self.index(self.levels, [x, y, z]);
            (start..start + (1 << below)).all(|index| self.bottom_state(index) == VOID)
        })
    }

    /// Value of a node of a level below the root.
    #[inline]
    pub fn value(&self, level: u8, index: usize) -> Value {
        let width = self.layout.width;
        Value::read(&self.values(level)[index * width..], width).expect("a value for each node")
    }

    /// Value of the node of `level` with these cell coordinates, of which only the low `level` bits
    /// count; `None` if it is VOID.
    #[inline]
    pub fn value_at(&self, level: u8, cell: Cell) -> Option<Value> {
        let index = self.index(level, cell.map(|cell| cell as usize & ((1 << level) - 1)));
        (!self.is_void(level, index)).then(|| self.value(level, index))
    }

    /// Index in `level` of the child `step` of the node `parent` one level above. Level 0 is the
    /// root, which has index 0.
    #[inline]
    pub fn child(&self, level: u8, parent: usize, step: usize) -> usize {
        dense_child(level, parent, step)
    }

    /// Origin and size of the whole bottom level.
    #[inline]
    pub fn whole(&self) -> ([usize; 3], [usize; 3]) {
        let side = 1 << self.levels;
        ([0; 3], [side, side, if self.layout.dimension == Dimension::Oct { side } else { 1 }])
    }
}
