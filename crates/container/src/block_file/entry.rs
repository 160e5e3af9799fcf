//! Entries of lists of blocks.

/// An entry of a list of blocks whose contents have places with so many axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockEntry<const AXES: usize> {
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
    /// Least and greatest place of what is in it, on the grid.
    pub bounds: [[i32; AXES]; 2],
}

impl<const AXES: usize> BlockEntry<AXES> {
    /// Bytes of an entry.
    pub const BYTES: usize = 28 + 8 * AXES;

    /// The entry's bytes.
    pub fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(Self::BYTES);
        bytes.extend_from_slice(&self.key.to_le_bytes());
        bytes.extend_from_slice(&self.offset.to_le_bytes());
        for number in [self.length, self.checksum, self.count] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        self.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    /// The entry of some bytes, in place of which there are zeros where they are too few: a mapped file was cut short since.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let four =
            |at: usize| bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or_default();
        let eight = |at: usize| {
            u64::from(u32::from_le_bytes(four(at))) | u64::from(u32::from_le_bytes(four(at + 4))) << 32
        };
        let place = |at: usize| std::array::from_fn(|axis| i32::from_le_bytes(four(at + 4 * axis)));
        BlockEntry {
            key: eight(0),
            offset: eight(8),
            length: u32::from_le_bytes(four(16)),
            checksum: u32::from_le_bytes(four(20)),
            count: u32::from_le_bytes(four(24)),
            bounds: [place(28), place(28 + 4 * AXES)],
        }
    }
}
