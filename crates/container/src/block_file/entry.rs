//! Entries of block lists.

/// Location of a block in its file, its checksum and its number of items.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockLocation {
    /// Code of the node that owns the block, or another sort key of the list.
    pub key: u64,
    /// Offset of the first byte in the file.
    pub offset: u64,
    /// Length in bytes.
    pub length: u32,
    /// CRC-32C of the block's bytes.
    pub checksum: u32,
    /// Number of items in the block.
    pub count: u32,
}

impl BlockLocation {
    /// Bytes of an encoded location. Every entry begins with one.
    const BYTES: usize = 28;

    /// Decodes a location. Missing bytes read as zeros: a mapped file may have been truncated since
    /// it was opened.
    pub(crate) fn from_bytes(bytes: &[u8]) -> BlockLocation {
        let four = |at| u32::from_le_bytes(four_at(bytes, at));
        let eight = |at| u64::from(four(at)) | u64::from(four(at + 4)) << 32;
        BlockLocation {
            key: eight(0),
            offset: eight(8),
            length: four(16),
            checksum: four(20),
            count: four(24),
        }
    }
}

/// The four bytes at `at`, or zeros if there are fewer.
fn four_at(bytes: &[u8], at: usize) -> [u8; 4] {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or_default()
}

/// An entry of a block list whose items have coordinates with `AXES` axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockEntry<const AXES: usize> {
    /// Location of the block.
    pub block: BlockLocation,
    /// Minimum and maximum corner of the items, in grid coordinates.
    pub bounds: [[i32; AXES]; 2],
}

impl<const AXES: usize> BlockEntry<AXES> {
    /// Bytes of an entry.
    pub const BYTES: usize = BlockLocation::BYTES + 8 * AXES;

    /// Encodes the entry.
    pub fn to_bytes(self) -> Vec<u8> {
        let BlockLocation { key, offset, length, checksum, count } = self.block;
        let mut bytes = Vec::with_capacity(Self::BYTES);
        bytes.extend_from_slice(&key.to_le_bytes());
        bytes.extend_from_slice(&offset.to_le_bytes());
        [length, checksum, count].iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        self.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    /// Decodes an entry. Missing bytes read as zeros.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let corner =
            |at: usize| std::array::from_fn(|axis| i32::from_le_bytes(four_at(bytes, at + 4 * axis)));
        let bounds = [corner(BlockLocation::BYTES), corner(BlockLocation::BYTES + 4 * AXES)];
        BlockEntry { block: BlockLocation::from_bytes(bytes), bounds }
    }
}
