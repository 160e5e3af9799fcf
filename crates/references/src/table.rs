//! Tables of chunks: where their compressed bytes are in a source, and checksums of these.

use spinney_packing::Columns;

/// The compressed bytes of a chunk (a tile or strip) in a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// Offset of the first byte.
    pub offset: u64,
    /// Number of bytes; 0 if the chunk was never written.
    pub length: u64,
    /// CRC-32C of the bytes.
    pub checksum: u32,
}

/// A chunk that was never written.
pub const HOLE: Chunk = Chunk { offset: 0, length: 0, checksum: 0 };

/// Number of chunks in a page of a table.
pub(crate) const PAGE_CHUNKS: usize = 1024;
/// Maximum size in bytes of a page of a table.
pub(crate) const MAX_TABLE: usize = 64 << 10;

/// Encodes a table: the length of the columns, the columns (of each chunk, the gap between the end
/// of the chunk before and its beginning, and the difference of their lengths), and the checksums.
/// Chunks that were never written have no gap and no checksum.
pub(crate) fn encode(chunks: &[Chunk]) -> Vec<u8> {
    let mut columns = Columns::writer(1, 2);
    let (mut end, mut length) = (0u64, 0);
    for chunk in chunks {
        columns.near(1, chunk.length.wrapping_sub(length) as i64);
        length = chunk.length;
        if length > 0 {
            columns.near(0, chunk.offset.wrapping_sub(end) as i64);
            end = chunk.offset.wrapping_add(length);
        }
    }
    let columns = columns.finish();
    let mut bytes = (columns.len() as u32).to_le_bytes().to_vec();
    bytes.extend_from_slice(&columns);
    let written = chunks.iter().filter(|chunk| chunk.length > 0);
    written.for_each(|chunk| bytes.extend_from_slice(&chunk.checksum.to_le_bytes()));
    bytes
}

/// Decodes a table of `count` chunks, at most [`PAGE_CHUNKS`]; `None` if it is invalid.
pub(crate) fn decode(bytes: &[u8], count: usize) -> Option<Vec<Chunk>> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (columns, checksums) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let mut checksums = checksums.chunks_exact(4);
    let mut columns = Columns::reader(columns, 1, 2)?;
    let mut chunks = Vec::with_capacity(count.min(PAGE_CHUNKS));
    let (mut end, mut length) = (0u64, 0u64);
    for _ in 0..count {
        length = length.wrapping_add(columns.near(1, 0) as u64);
        if length == 0 {
            chunks.push(HOLE);
            continue;
        }
        let offset = end.wrapping_add(columns.near(0, 0) as u64);
        end = offset.checked_add(length)?;
        let checksum = u32::from_le_bytes(checksums.next()?.try_into().ok()?);
        chunks.push(Chunk { offset, length, checksum });
    }
    let is_whole = columns.is_whole() && checksums.next().is_none() && checksums.remainder().is_empty();
    is_whole.then_some(chunks)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn chunk() -> impl Strategy<Value = Chunk> {
        let chunk = (0u64..1 << 40, 1u64..1 << 20, any::<u32>());
        prop_oneof![
            3 => chunk.prop_map(|(offset, length, checksum)| Chunk { offset, length, checksum }),
            1 => Just(HOLE),
        ]
    }

    proptest! {
        #[test]
        fn tables_come_back(chunks in prop::collection::vec(chunk(), 0..60), cut in 0usize..100) {
            let bytes = encode(&chunks);
            prop_assert_eq!(decode(&bytes, chunks.len()), Some(chunks.clone()));
            prop_assert_eq!(decode(&bytes, chunks.len() + 1), None);
            let cut = cut % bytes.len();
            prop_assert!(decode(&bytes[..cut], chunks.len()).is_none());
        }
    }

    #[test]
    fn consecutive_chunks_take_few_bytes() {
        let chunk = |at: u64| Chunk { offset: 1000 + at * 500, length: 500, checksum: at as u32 };
        let chunks: Vec<Chunk> = (0..1000).map(chunk).collect();
        assert!(encode(&chunks).len() < 4 * 1000 + 200);
    }
}
