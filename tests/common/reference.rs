//! Writes Goblin files from trees in memory as formats.md specifies, with any reach, stride and
//! threshold, which Spinney's writer does not offer. Values are integers of at most 32 bits.

use std::collections::BTreeMap;

use spinney::raw::tree::no_children;
use spinney::tree::{Child, MemTree, Source};
use spinney::{Code, DataKind, Dimension, Number, Rule, Value, ValueType};

/// Parameters of how a tree is cut into segments.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    pub reach: u8,
    pub stride: u8,
    pub threshold: u32,
}

impl Cut {
    /// The maximum number of CUT children.
    pub const EVERYWHERE: Cut = Cut { reach: 2, stride: 1, threshold: 1 };

    fn is_candidate(self, depth: u8, level: u8) -> bool {
        level > 0 && level + self.reach <= depth && (depth - self.reach - level).is_multiple_of(self.stride)
    }
}

/// An INNER node with its subtree.
struct Inner {
    code: Code,
    children: Vec<Subtree>,
    /// INNER nodes of the subtree.
    records: u64,
    sums: Sums,
}

enum Subtree {
    Void,
    Leaf(Value),
    Inner(Value, Box<Inner>),
}

impl Subtree {
    fn value(&self) -> Value {
        match self {
            Subtree::Void => Value::ZERO,
            Subtree::Leaf(value) | Subtree::Inner(value, _) => *value,
        }
    }
}

/// A dense block under construction: the values of each level in rows, and the states of the bottom
/// nodes.
struct DenseRows {
    levels: u8,
    rows: Vec<Vec<Vec<u8>>>,
    states: Vec<u8>,
}

/// Statistics of the cells below a node.
#[derive(Clone, Default)]
struct Sums {
    cells: u64,
    /// Minimum, maximum, sum and sum of squares per channel.
    channels: Vec<(i128, i128, i128, i128)>,
    classes: BTreeMap<Vec<u8>, u64>,
}

struct Writer<'a> {
    tree: &'a MemTree,
    cut: Cut,
    counts_classes: bool,
    /// VOID, LEAF and INNER nodes by level.
    levels: Vec<[u64; 3]>,
    file: Vec<u8>,
    /// Entries of the segment index, by code.
    entries: BTreeMap<u64, Vec<u8>>,
    stored: u64,
}

/// Returns the bytes of a file. Classes are counted where the specification requires it.
pub fn goblin(tree: &MemTree, extent: [u64; 3], (rule, kind): (Rule, DataKind), cut: Cut) -> Vec<u8> {
    let counts_classes = kind == DataKind::Categorical || rule == Rule::Majority;
    let (levels, entries) = (vec![[0; 3]; usize::from(tree.depth()) + 1], BTreeMap::new());
    let file = header(tree);
    let mut writer = Writer { tree, cut, counts_classes, levels, file, entries, stored: 0 };
    let root = writer.subtree(Code::root(tree.form().dimension), tree.root().unwrap());
    let mut top_levels = writer.file.len();
    if let Subtree::Inner(_, node) = &root {
        writer.segments(node, true, false);
        top_levels = writer.file.len();
        writer.segments(node, true, true);
    }
    let header = tree_header(tree, extent, (rule, kind), cut);
    writer.finish(&root, header, top_levels)
}

/// The file's header.
fn header(tree: &MemTree) -> Vec<u8> {
    let mut file = b"\x93Goblin\n\x01\0\0\0".to_vec();
    let axes = if tree.form().dimension == Dimension::Quad { 2 } else { 3 };
    file.extend([axes, 0, tree.depth(), 0, 1, 0, 0, 0]);
    file.extend(crc32c::crc32c(&file).to_le_bytes());
    file
}

/// The tree's header.
fn tree_header(tree: &MemTree, extent: [u64; 3], (rule, kind): (Rule, DataKind), cut: Cut) -> Vec<u8> {
    let value = tree.form().value;
    let number = |rule| Rule::ALL.iter().position(|other| *other == rule).unwrap() as u8;
    let kind = if kind == DataKind::Categorical { 0 } else { 1 };
    let mut header = vec![value.sample as u8, value.channels, number(rule), kind, 0];
    header.extend([tree.depth(), cut.reach, cut.stride]);
    header.extend(cut.threshold.to_le_bytes());
    header.extend([0; 12]);
    extent.iter().for_each(|cells| header.extend(cells.to_le_bytes()));
    header
}

/// Returns whether the node with code `below` is the node `above` or a descendant, with `bits` bits
/// per level.
fn contains(above: u64, below: u64, bits: u64) -> bool {
    above <= below && below <= above | (u64::MAX >> 1 >> (bits * (above & 31)).min(63))
}

/// Returns the pages of a segment index, followed by the lower levels of the index over them; and
/// the top level. The first page starts at offset `start` of the run.
pub fn directory(entries: &[Vec<u8>], bits: u64, start: u64) -> (Vec<u8>, Vec<u8>) {
    let code = |entry: &Vec<u8>| u64::from_le_bytes(entry[..8].try_into().unwrap());
    let (mut pages, mut top) = (Vec::new(), Vec::new());
    for (number, own) in entries.chunks(128).enumerate() {
        let before = &entries[..128 * number];
        let above = |entry: &&Vec<u8>| contains(code(entry), code(&own[0]), bits);
        let copies: Vec<&Vec<u8>> = before.iter().filter(above).collect();
        let numbers = before.iter().enumerate().filter(|(_, entry)| above(entry)).map(|(number, _)| number);
        let mut page = (copies.len() as u16).to_le_bytes().to_vec();
        page.extend((own.len() as u16).to_le_bytes());
        page.extend([0; 4]);
        numbers.for_each(|number| page.extend((number as u64).to_le_bytes()));
        copies.into_iter().chain(own).for_each(|entry| page.extend(entry));
        top.extend(code(&own[0]).to_le_bytes());
        top.extend((start + pages.len() as u64).to_le_bytes());
        top.extend((page.len() as u32).to_le_bytes());
        top.extend(crc32c::crc32c(&page).to_le_bytes());
        pages.extend(page);
    }
    while top.len() > 256 * 24 {
        let mut above = Vec::new();
        for page in top.chunks(256 * 24) {
            above.extend(&page[..8]);
            above.extend((start + pages.len() as u64).to_le_bytes());
            above.extend((page.len() as u32).to_le_bytes());
            above.extend(crc32c::crc32c(page).to_le_bytes());
            pages.extend(page);
        }
        top = above;
    }
    (pages, top)
}

/// Appends the trailer of a file: the section table and what follows it.
pub fn trailer(file: &mut Vec<u8>, sections: &[([u8; 4], std::ops::Range<usize>)]) {
    let mut trailer = file[..24].to_vec();
    let length = 24 + 8 + 4 + 24 * sections.len();
    trailer.extend(((file.len() + length + 16) as u64).to_le_bytes());
    trailer.extend((sections.len() as u32).to_le_bytes());
    for (tag, range) in sections {
        trailer.extend(tag);
        trailer.extend(crc32c::crc32c(&file[range.clone()]).to_le_bytes());
        trailer.extend((range.start as u64).to_le_bytes());
        trailer.extend((range.len() as u64).to_le_bytes());
    }
    file.extend(&trailer);
    file.extend((length as u32).to_le_bytes());
    file.extend(crc32c::crc32c(&trailer).to_le_bytes());
    file.extend(b"\nnilboG\x93");
}

impl Writer<'_> {
    fn value_type(&self) -> ValueType {
        self.tree.form().value
    }

    fn bytes(&self, value: Value) -> Vec<u8> {
        value.to_bytes()[..self.value_type().size()].to_vec()
    }

    /// Returns a node with its subtree, counted.
    fn subtree(&mut self, code: Code, child: Child<<MemTree as Source>::Node>) -> Subtree {
        let level = usize::from(code.level());
        self.levels[level][child.state() as usize] += 1;
        match child {
            Child::Void => Subtree::Void,
            Child::Leaf(value) => Subtree::Leaf(value),
            Child::Inner { representative, node } => {
                let mut children = no_children();
                self.tree.children(&node, &mut children).unwrap();
                let count = self.tree.form().children();
                let numbered = children.into_iter().take(count).enumerate();
                let children: Vec<Subtree> =
                    numbered.map(|(step, child)| self.subtree(code.child(step), child)).collect();
                let mut inner = Inner { code, records: 1, sums: Sums::default(), children };
                for child in &inner.children {
                    if let Subtree::Inner(_, below) = child {
                        inner.records += below.records;
                    }
                    inner.sums.add(&self.sums(code.level() + 1, child));
                }
                Subtree::Inner(representative, Box::new(inner))
            }
        }
    }

    fn sums(&self, level: u8, subtree: &Subtree) -> Sums {
        match subtree {
            Subtree::Void => Sums::default(),
            Subtree::Inner(_, inner) => inner.sums.clone(),
            Subtree::Leaf(value) => {
                let cells = self.tree.form().dimension.cells(self.tree.depth() - level);
                let samples = self.value_type().numbers(*value);
                let sums = |sample: &Number| {
                    let (number, cells) = (sample.to_integer().unwrap(), i128::from(cells));
                    (number, number, number * cells, number * number * cells)
                };
                let classes = [(self.bytes(*value), cells)].into();
                Sums { cells, channels: samples.iter().map(sums).collect(), classes }
            }
        }
    }

    fn is_heavy(&self, node: &Inner) -> bool {
        node.records > u64::from(self.cut.threshold)
    }

    fn is_candidate(&self, level: u8) -> bool {
        self.cut.is_candidate(self.tree.depth(), level)
    }

    /// The level above which segments belong to the top levels.
    fn shard_level(&self) -> u8 {
        let (depth, reach) = (self.tree.depth(), self.cut.reach);
        if depth <= reach { 0 } else { (depth - reach).saturating_sub(6).max((depth - reach).min(3)) }
    }

    /// Writes the segments of all nodes below a node, then its own, if it has one; those of the top
    /// levels, or the others.
    fn segments(&mut self, node: &Inner, is_root: bool, in_top_levels: bool) {
        for child in &node.children {
            if let Subtree::Inner(_, node) = child {
                self.segments(node, false, in_top_levels);
            }
        }
        let owns = is_root || self.is_candidate(node.code.level()) && self.is_heavy(node);
        if owns && (node.code.level() < self.shard_level()) == in_top_levels {
            self.segment(node);
        }
    }

    fn segment(&mut self, node: &Inner) {
        let (top, depth) = (node.code.level(), self.tree.depth());
        // Without candidates below it, the node takes the role of the missing candidate.
        let bottom = (top + self.cut.reach >= depth).then_some(depth);
        let records = self.records(node, top, bottom);
        let count = (records.len() / self.record_size()) as u32;
        let start = self.file.len();
        self.file.extend(records);
        let is_listed = self.counts_classes && node.sums.classes.len() <= 1024;
        let classes = if is_listed { node.sums.classes.clone() } else { BTreeMap::new() };
        let listed = if self.counts_classes && !is_listed { u16::MAX } else { classes.len() as u16 };
        // By value: for unsigned bytes the byte order is the numeric order.
        for (value, cells) in &classes {
            self.file.extend(value);
            self.file.extend(cells.to_le_bytes());
        }
        self.stored += u64::from(count);
        let mut entry = node.code.bits().to_le_bytes().to_vec();
        entry.extend((start as u64 - 24).to_le_bytes());
        entry.extend(((self.file.len() - start) as u64).to_le_bytes());
        entry.extend(count.to_le_bytes());
        entry.extend(listed.to_le_bytes());
        entry.extend([0; 2]);
        entry.extend(crc32c::crc32c(&self.file[start..]).to_le_bytes());
        entry.extend(node.sums.cells.to_le_bytes());
        for (min, max, sum, squares) in &node.sums.channels {
            entry.extend(&min.to_le_bytes()[..self.value_type().sample.size()]);
            entry.extend(&max.to_le_bytes()[..self.value_type().sample.size()]);
            entry.extend(sum.to_le_bytes());
            entry.extend(squares.to_le_bytes());
        }
        self.entries.insert(node.code.bits(), entry);
    }

    fn record_size(&self) -> usize {
        let form = self.tree.form();
        form.children() * form.width() + if form.dimension == Dimension::Oct { 8 } else { 4 }
    }

    /// Returns the records of a node in a segment of level `top`, or a dense block if that takes
    /// less than an eighth more records. `bottom` is the bottom of the candidate at the next
    /// candidate level that contains the node, or `None` above that level.
    fn records(&self, node: &Inner, top: u8, bottom: Option<u8>) -> Vec<u8> {
        let is_octree = self.tree.form().dimension == Dimension::Oct;
        let (mut states, mut below) = (0u32, Vec::new());
        for (step, child) in node.children.iter().enumerate() {
            let state = match child {
                Subtree::Void => 0,
                Subtree::Leaf(_) => 1,
                Subtree::Inner(_, inner) => {
                    let level = inner.code.level();
                    let bottom = bottom.or_else(|| {
                        let deepest =
                            if self.is_heavy(inner) { top + self.cut.reach } else { self.tree.depth() };
                        self.is_candidate(level).then_some(deepest)
                    });
                    if level < bottom.unwrap_or(top + self.cut.reach) {
                        below.extend(self.records(inner, top, bottom));
                        2
                    } else {
                        3
                    }
                }
            };
            states |= state << (2 * step);
        }
        let size = self.record_size();
        let (mut kind, mut skip) = (0, 1 + below.len() / size);
        let levels = bottom.map_or(0, |bottom| bottom - node.code.level());
        if (if is_octree { 2..=4 } else { 3..=8 }).contains(&levels)
            && levels <= self.cut.reach
            && let Some((number, payload)) = self.dense(node, levels)
            && 1 + payload.len().div_ceil(size) < skip + skip / 8
        {
            skip = 1 + payload.len().div_ceil(size);
            (kind, below) = (number, payload);
            below.resize((skip - 1) * size, 0);
        }
        let mut record: Vec<u8> = node.children.iter().flat_map(|child| self.bytes(child.value())).collect();
        if is_octree {
            record.extend(states.to_le_bytes());
            record.extend((skip as u32 | kind << 29).to_le_bytes());
        } else {
            record.push(states as u8);
            record.extend(&(skip as u32 | kind << 21).to_le_bytes()[..3]);
        }
        record.extend(below);
        record
    }

    /// Returns the kind and the payload of a node as a dense block of `levels` levels; `None` if no
    /// kind fits.
    fn dense(&self, node: &Inner, levels: u8) -> Option<(u32, Vec<u8>)> {
        let mut block = DenseRows { levels, rows: Vec::new(), states: Vec::new() };
        for level in 0..=levels {
            let cells = self.tree.form().dimension.cells(level) as usize;
            block.rows.push(vec![vec![0; self.tree.form().width()]; cells]);
            block.states = vec![0; cells];
        }
        for (step, child) in node.children.iter().enumerate() {
            self.paint(child, 1, [0; 3], step, &mut block);
        }
        let has = |state: u8| block.states.contains(&state);
        // The state of the nodes whose bits are set.
        let (kind, set) = match (has(0), has(1), has(3)) {
            (false, true, false) => (1, None),
            (false, false, true) => (2, None),
            (true, true, false) => (3, Some(1)),
            (true, false, true) => (4, Some(3)),
            (false, true, true) => (5, Some(3)),
            _ => return None,
        };
        let mut payload = block.rows[2..].concat().concat();
        if let Some(set) = set {
            let bit = |(i, state): (usize, &u8)| u8::from(*state == set) << i;
            payload.extend(block.states.chunks(8).map(|eight| eight.iter().enumerate().map(bit).sum::<u8>()));
        }
        Some((kind, payload))
    }

    /// Writes a child, at a position of the level above, and its subtree to the rows.
    fn paint(&self, subtree: &Subtree, level: u8, above: [usize; 3], step: usize, block: &mut DenseRows) {
        let at: [usize; 3] = std::array::from_fn(|axis| 2 * above[axis] + (step >> axis & 1));
        let side = 1 << level;
        let index = (at[2] * side + at[1]) * side + at[0];
        block.rows[usize::from(level)][index] = self.bytes(subtree.value());
        if level == block.levels {
            block.states[index] = match subtree {
                Subtree::Void => 0,
                Subtree::Leaf(_) => 1,
                Subtree::Inner(..) => 3,
            };
            return;
        }
        for step in 0..self.tree.form().children() {
            let child = if let Subtree::Inner(_, inner) = subtree { &inner.children[step] } else { subtree };
            self.paint(child, level + 1, at, step, block);
        }
    }

    /// Returns the metadata: version, frame (the identity), no description of the data, and nodes
    /// per level.
    fn metadata(&self) -> Vec<u8> {
        let mut metadata = vec![1];
        for row in 0..3 {
            (0..4).for_each(|column| metadata.extend(f64::from(u8::from(row == column)).to_le_bytes()));
        }
        metadata.extend([0; 9]);
        let deepest = self.levels.iter().rposition(|nodes| *nodes != [0; 3]).map_or(0, |level| level + 1);
        metadata.push(deepest as u8);
        for number in self.levels[..deepest].iter().flatten() {
            match number {
                0..=250 => metadata.push(*number as u8),
                251..=0xffff => metadata.extend([&[251][..], &(*number as u16).to_le_bytes()].concat()),
                _ => metadata.extend([&[252][..], &(*number as u32).to_le_bytes()].concat()),
            }
        }
        metadata.extend([0, 0, 0, 0, 0, 1]);
        metadata
    }

    fn finish(mut self, root: &Subtree, header: Vec<u8>, top_levels: usize) -> Vec<u8> {
        let metadata = self.metadata();
        let start = self.file.len();
        let entries: Vec<Vec<u8>> = self.entries.values().cloned().collect();
        let bits = if self.tree.form().dimension == Dimension::Quad { 2 } else { 3 };
        let (pages, top) = directory(&entries, bits, start as u64 - 24);
        self.file.extend(pages);
        let run = self.file.len() - 24;
        let metadata_at = self.file.len();
        self.file.extend(&metadata);
        let top_at = self.file.len();
        self.file.extend(&top);
        let (state, value) = match root {
            Subtree::Void => (0, Value::ZERO),
            Subtree::Leaf(value) => (1, *value),
            Subtree::Inner(value, _) => (2, *value),
        };
        let mut layer = header;
        layer.extend([state, 0, 0, 0, 0, 0, 0, 0]);
        layer.extend(self.bytes(value));
        layer.resize(72, 0);
        let numbers =
            [entries.len() as u64, self.stored, 24, run as u64, top_levels as u64 - 24, start as u64 - 24];
        numbers.iter().for_each(|number| layer.extend(number.to_le_bytes()));
        for (at, bytes) in [(top_at, &top), (metadata_at, &metadata)] {
            layer.extend((at as u64).to_le_bytes());
            layer.extend((bytes.len() as u32).to_le_bytes());
            layer.extend(crc32c::crc32c(bytes).to_le_bytes());
        }
        let table = self.file.len();
        self.file.extend(layer);
        let table = table..self.file.len();
        trailer(&mut self.file, &[(*b"LAYR", table)]);
        self.file
    }
}

impl Sums {
    fn add(&mut self, other: &Sums) {
        self.cells += other.cells;
        if self.channels.is_empty() {
            self.channels = other.channels.clone();
        } else {
            for (mine, theirs) in self.channels.iter_mut().zip(&other.channels) {
                *mine = (mine.0.min(theirs.0), mine.1.max(theirs.1), mine.2 + theirs.2, mine.3 + theirs.3);
            }
        }
        other
            .classes
            .iter()
            .for_each(|(value, cells)| *self.classes.entry(value.clone()).or_default() += cells);
    }
}
