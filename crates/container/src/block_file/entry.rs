//! Entries of lists of blocks.

/// Location of a block in its file, its checksum and its number of items.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockLocation {
    /// The code of the node whose block this is, or another number by which the list is sorted.
    pub key: u64,
    /// First byte in the file.
    pub offset: u64,
    /// Bytes.
    pub length: u32,
    /// CRC-32C of the bytes.
    pub checksum: u32,
    /// How many things are in it.
    pub count: u32,
}

impl BlockLocation {
    /// Bytes of a place, with which an entry begins.
    const BYTES: usize = 28;

    /// The place of some bytes, in place of which there are zeros where they are too few: a mapped file was cut short since.
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

/// Four bytes from one on; zeros if there are fewer.
fn four_at(bytes: &[u8], at: usize) -> [u8; 4] {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or_default()
}

/// An entry of a list of blocks whose contents have places with so many axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockEntry<const AXES: usize> {
    /// The block.
    pub block: BlockLocation,
    /// Least and greatest place of what is in it, on the grid.
    pub bounds: [[i32; AXES]; 2],
}

impl<const AXES: usize> BlockEntry<AXES> {
    /// Bytes of an entry.
    pub const BYTES: usize = BlockLocation::BYTES + 8 * AXES;

    /// The entry's bytes.
    pub fn to_bytes(self) -> Vec<u8> {
        let BlockLocation { key, offset, length, checksum, count } = self.block;
        let mut bytes = Vec::with_capacity(Self::BYTES);
        bytes.extend_from_slice(&key.to_le_bytes());
        bytes.extend_from_slice(&offset.to_le_bytes());
        [length, checksum, count].iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        self.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    /// The entry of some bytes, in place of which there are zeros where they are too few.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let corner =
            |at: usize| std::array::from_fn(|axis| i32::from_le_bytes(four_at(bytes, at + 4 * axis)));
        let bounds = [corner(BlockLocation::BYTES), corner(BlockLocation::BYTES + 4 * AXES)];
        BlockEntry { block: BlockLocation::from_bytes(bytes), bounds }
    }
}
