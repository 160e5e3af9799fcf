//! Availability of tiles of an implicit octree, as binary subtree files of 3D Tiles 1.1.

use serde_json::{Value as Json, json};

use super::tiles::Tile;

/// Available tiles of a subtree.
pub(super) struct Subtree {
    root: Tile,
    levels: u8,
    /// Tiles by level, and in Z order within each level; with whether the tile has content.
    tiles: Vec<(Tile, bool)>,
    /// Roots of the child subtrees.
    children: Vec<Tile>,
}

impl Subtree {
    /// Subtree with up to `levels` levels of tiles, and its child subtrees. Tiles are given by
    /// level and in Z order within each level. Tiles without content and without needed descendants
    /// are left out, except for the root of the tileset.
    pub(super) fn of(root: Tile, levels: u8, mut tiles: Vec<(Tile, bool)>, children: Vec<Tile>) -> Subtree {
        // Bottom-up, since a tile is needed if a tile of the next level is.
        let mut needed: Vec<u64> = children.iter().map(|tile| tile.order >> 3).collect();
        for level in (root.level..root.level + levels).rev() {
            tiles.retain(|(tile, has_content)| {
                tile.level != level || *has_content || needed.binary_search(&tile.order).is_ok()
            });
            let here = tiles.iter().filter(|(tile, _)| tile.level == level);
            needed = here.map(|(tile, _)| tile.order >> 3).collect();
        }
        if tiles.is_empty() && root == Tile::ROOT {
            // Readers start with the root.
            tiles.push((root, false));
        }
        Subtree { root, levels, tiles, children }
    }

    /// Whether the subtree has no tiles.
    pub(super) fn is_empty(&self) -> bool {
        self.tiles.is_empty()
    }

    /// Bytes of the subtree file. `bounds` returns a tile's own bounding box in the format of
    /// `tileset.json`; `None` if tiles have no own boxes.
    pub(super) fn to_bytes(&self, bounds: Option<&dyn Fn(Tile) -> [f64; 12]>) -> Vec<u8> {
        let count = |below: u8| 1usize << (3 * below);
        let before = |below: u8| (count(below) - 1) / 7;
        let first = |below: u8| self.root.order << (3 * below);
        let (mut available, mut contents) = (Bits::new(before(self.levels)), Bits::new(before(self.levels)));
        for (tile, has_content) in &self.tiles {
            let below = tile.level - self.root.level;
            let index = before(below) + (tile.order - first(below)) as usize;
            available.set(index);
            if *has_content {
                contents.set(index);
            }
        }
        let mut children = Bits::new(count(self.levels));
        for child in &self.children {
            children.set((child.order - first(self.levels)) as usize);
        }
        let mut buffer = SubtreeBuffer::default();
        let mut text = json!({
            "tileAvailability": buffer.availability(&available),
            "contentAvailability": [buffer.availability(&contents)],
            "childSubtreeAvailability": buffer.availability(&children),
        });
        if let Some(bounds) = bounds {
            let numbers = self.tiles.iter().flat_map(|(tile, _)| bounds(*tile));
            let view = buffer.append(&numbers.flat_map(f64::to_le_bytes).collect::<Vec<u8>>());
            text["tileMetadata"] = 0.into();
            text["propertyTables"] = json!([{ "class": "tile", "count": self.tiles.len(),
                "properties": { "boundingBox": { "values": view } } }]);
        }
        if !buffer.views.is_empty() {
            text["buffers"] = json!([{ "byteLength": buffer.bytes.len() }]);
            text["bufferViews"] = buffer.views.into();
        }
        let mut text = text.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        let mut file = b"subt\x01\0\0\0".to_vec();
        file.extend((text.len() as u64).to_le_bytes());
        file.extend((buffer.bytes.len() as u64).to_le_bytes());
        file.extend(text);
        file.extend(buffer.bytes);
        file
    }
}

/// Binary buffer of a subtree file.
#[derive(Default)]
struct SubtreeBuffer {
    bytes: Vec<u8>,
    views: Vec<Json>,
}

impl SubtreeBuffer {
    fn availability(&mut self, bits: &Bits) -> Json {
        if bits.set == 0 || bits.set == bits.count {
            return json!({ "constant": u8::from(bits.set > 0) });
        }
        json!({ "bitstream": self.append(&bits.bytes), "availableCount": bits.set })
    }

    /// Appends a view with these bytes; returns its index.
    fn append(&mut self, bytes: &[u8]) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        self.views.push(view);
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        self.views.len() - 1
    }
}

/// Bit array, least significant bit first.
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
