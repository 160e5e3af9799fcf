//! Availability of tiles of an implicit octree, in binary subtree files of 3D Tiles 1.1.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};

/// Tiles of each level, by their position in Z order, and whether they have content.
pub(super) type Tiles = Vec<BTreeMap<u64, bool>>;

/// Levels of tiles in a subtree.
pub(super) const SUBTREE_LEVELS: usize = 4;

/// The subtrees of a tileset: level and place of the root, and bytes.
pub(super) fn subtrees(tiles: &Tiles, levels: usize) -> impl Iterator<Item = (usize, [u32; 3], Vec<u8>)> {
    let roots = (0..tiles.len()).step_by(levels);
    roots.flat_map(move |level| {
        let bytes = move |root: &u64| (level, place(*root), subtree(tiles, levels, level, *root));
        tiles[level].keys().map(bytes).collect::<Vec<_>>()
    })
}

/// The place of a position in Z order.
pub(super) fn place(order: u64) -> [u32; 3] {
    let bit = |axis: usize, level: usize| ((order >> (3 * level + axis)) as u32 & 1) << level;
    [0, 1, 2].map(|axis| (0..21).map(|level| bit(axis, level)).sum())
}

fn subtree(tiles: &Tiles, levels: usize, level: usize, root: u64) -> Vec<u8> {
    let count = |below: usize| 1usize << (3 * below);
    let before = |below: usize| (count(below) - 1) / 7;
    let (mut available, mut contents) = (Bits::new(before(levels)), Bits::new(before(levels)));
    for below in 0..levels {
        let first = root << (3 * below);
        let here = tiles.get(level + below).into_iter();
        for (order, has_content) in here.flat_map(|tiles| tiles.range(first..first + count(below) as u64)) {
            let index = before(below) + (order - first) as usize;
            available.set(index);
            if *has_content {
                contents.set(index);
            }
        }
    }
    let mut children = Bits::new(count(levels));
    let first = root << (3 * levels);
    let next = tiles.get(level + levels).into_iter();
    for (order, _) in next.flat_map(|tiles| tiles.range(first..first + count(levels) as u64)) {
        children.set((order - first) as usize);
    }
    let (mut bin, mut views) = (Vec::new(), Vec::new());
    let mut availability = |bits: &Bits| -> Json {
        if bits.set == 0 || bits.set == bits.count {
            return json!({ "constant": u8::from(bits.set > 0) });
        }
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bits.bytes.len() }));
        bin.extend_from_slice(&bits.bytes);
        bin.resize(bin.len().next_multiple_of(8), 0);
        json!({ "bitstream": views.len() - 1, "availableCount": bits.set })
    };
    let mut text = json!({
        "tileAvailability": availability(&available),
        "contentAvailability": [availability(&contents)],
        "childSubtreeAvailability": availability(&children),
    });
    if !bin.is_empty() {
        text["buffers"] = json!([{ "byteLength": bin.len() }]);
        text["bufferViews"] = views.into();
    }
    let mut text = text.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(8), b' ');
    let mut file = b"subt\x01\0\0\0".to_vec();
    file.extend((text.len() as u64).to_le_bytes());
    file.extend((bin.len() as u64).to_le_bytes());
    file.extend(text);
    file.extend(bin);
    file
}

/// Bits, the first the lowest of its byte.
struct Bits {
    bytes: Vec<u8>,
    count: usize,
    set: usize,
}

impl Bits {
    fn new(count: usize) -> Bits {
        Bits { bytes: vec![0; count.div_ceil(8)], count, set: 0 }
    }

    fn set(&mut self, index: usize) {
        self.bytes[index / 8] |= 1 << (index % 8);
        self.set += 1;
    }
}
