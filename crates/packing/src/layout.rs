//! Records and dense blocks as they stand in a plain segment (sections 6 and 7 of formats.md).

use spinney_base::Form;

pub(crate) const VOID: u8 = 0;
pub(crate) const LEAF: u8 = 1;
pub(crate) const INNER: u8 = 2;
pub(crate) const CUT: u8 = 3;

/// Sizes and places of what is in records.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub(crate) axes: usize,
    pub(crate) children: usize,
    /// Bytes of a value.
    pub(crate) width: usize,
    /// Bytes of a record.
    pub(crate) size: usize,
}

/// States, places and mark of a record.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Head {
    pub(crate) states: u32,
    pub(crate) skip: usize,
    /// The kind of dense block that begins here; 0 if none does.
    pub(crate) mark: u8,
}

/// States of the bottom nodes of a dense block by its mark: those whose bit is set, and all others.
const BOTTOM: [(u8, u8); 6] =
    [(LEAF, LEAF), (LEAF, LEAF), (CUT, CUT), (LEAF, VOID), (CUT, VOID), (CUT, LEAF)];

impl Head {
    pub(crate) fn state(self, child: usize) -> u8 {
        (self.states >> (2 * child) & 3) as u8
    }
}

/// A kind of dense block with so many levels below its root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Dense {
    pub(crate) mark: u8,
    pub(crate) levels: u8,
}

impl Dense {
    /// States of the bottom nodes whose bit is set, and of all others.
    pub(crate) fn bottom(self) -> (u8, u8) {
        BOTTOM[usize::from(self.mark)]
    }

    /// Whether bottom nodes have a bit each.
    pub(crate) fn has_bits(self) -> bool {
        self.mark >= 3
    }
}

impl Layout {
    pub(crate) fn new(form: Form) -> Layout {
        let (axes, children, width) = (form.axes(), form.children(), form.width());
        Layout { axes, children, width, size: children * width + if axes == 2 { 4 } else { 8 } }
    }

    /// Nodes of a whole level, so many levels below one node.
    pub(crate) fn nodes(&self, levels: u8) -> usize {
        1 << (self.axes * usize::from(levels))
    }

    /// The numbers of levels that dense blocks have.
    pub(crate) fn dense_levels(&self) -> std::ops::RangeInclusive<u8> {
        if self.axes == 2 { 3..=8 } else { 2..=4 }
    }

    /// Values behind the record of a dense block down to a level below its root.
    pub(crate) fn values_to(&self, level: u8) -> usize {
        (2..=level).map(|level| self.nodes(level)).sum()
    }

    /// Places that a dense block takes.
    pub(crate) fn dense_places(&self, dense: Dense) -> usize {
        let bits = if dense.has_bits() { self.nodes(dense.levels) / 8 } else { 0 };
        1 + (self.values_to(dense.levels) * self.width + bits).div_ceil(self.size)
    }

    /// The head of the record at a place.
    pub(crate) fn head(&self, records: &[u8], place: usize) -> Option<Head> {
        let start = place.checked_mul(self.size)?.checked_add(self.children * self.width)?;
        if self.axes == 2 {
            let word = u32::from_le_bytes(*records.get(start..)?.first_chunk()?);
            let skip = word >> 8;
            Some(Head { states: word & 0xff, skip: (skip & 0x1f_ffff) as usize, mark: (skip >> 21) as u8 })
        } else {
            let word = u64::from_le_bytes(*records.get(start..)?.first_chunk()?);
            let skip = (word >> 32) as u32;
            let states = word as u32 & 0xffff;
            Some(Head { states, skip: (skip & 0x1fff_ffff) as usize, mark: (skip >> 29) as u8 })
        }
    }

    /// Writes a head into a record's bytes.
    pub(crate) fn write_head(&self, record: &mut [u8], head: Head) {
        let (bytes, skip, mark) =
            (&mut record[self.children * self.width..self.size], head.skip as u32, u32::from(head.mark));
        if self.axes == 2 {
            bytes.copy_from_slice(&(head.states | (skip | mark << 21) << 8).to_le_bytes());
        } else {
            let word = u64::from(head.states) | u64::from(skip | mark << 29) << 32;
            bytes.copy_from_slice(&word.to_le_bytes());
        }
    }

    /// The dense block that a head begins.
    pub(crate) fn dense(&self, head: Head) -> Option<Dense> {
        let of = |levels| Dense { mark: head.mark, levels };
        let is_kind = (1..BOTTOM.len()).contains(&usize::from(head.mark));
        self.dense_levels().map(of).find(|dense| is_kind && self.dense_places(*dense) == head.skip)
    }

    /// Where the values of a level of a dense block begin, from the block's first byte on.
    pub(crate) fn dense_values(&self, level: u8) -> usize {
        // (Those of the children are in the record.)
        if level == 1 { 0 } else { self.size + self.values_to(level - 1) * self.width }
    }

    /// Where the bits of the bottom nodes begin.
    pub(crate) fn dense_bits(&self, levels: u8) -> usize {
        self.size + self.values_to(levels) * self.width
    }

    /// The number in its level of a dense block of the child of a node with a number in the level above.
    pub(crate) fn dense_child(&self, level: u8, parent: usize, child: usize) -> usize {
        let above = level - 1;
        let mask = (1 << above) - 1;
        let (x, y, z) = (parent & mask, parent >> above & mask, parent >> (2 * above));
        let (x, y, z) = (2 * x + (child & 1), 2 * y + (child >> 1 & 1), 2 * z + (child >> 2));
        (z << level | y) << level | x
    }
}
