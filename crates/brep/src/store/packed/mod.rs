//! Packed chunks: contents of blocks, segments and tables as columns of numbers that are coded in
//! the context of nearby values.

mod bytes;
mod corners;
mod exact;
mod faces;
mod lists;
mod positions;
mod segments;
#[cfg(test)]
mod tests;
mod vertices;
mod words;

use spinney_packing::{Columns, may_unpack};

use self::exact::Exact;
use self::faces::Faces;
use self::segments::Segment;
use super::chunks::List;

/// First byte of a chunk in a file with packed chunks: plain or packed bytes follow.
pub(super) const PLAIN: u8 = 0;
pub(super) const PACKED: u8 = 1;

/// Bytes of a packed chunk before its columns: the first byte, the plain chunk's checksum, and its
/// length.
const HEAD: usize = 9;

/// Maximum plain bytes of a packed table chunk or block of exact faces, whose decoding takes a
/// multiple of this memory.
const MAX_BYTES: u64 = 1 << 20;

/// Returns whether a chunk of `plain` bytes may be packed into `packed` bytes.
fn may_be_packed(list: List, packed: u64, plain: u64) -> bool {
    let is_short = matches!(list, List::Faces | List::Segments | List::LevelFaces) || plain <= MAX_BYTES;
    is_short && may_unpack(packed, plain)
}

/// The reason why bytes are not a packed chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corruption(pub(super) &'static str);

/// Packs a chunk, if possible, for a file with packed chunks.
pub(crate) fn pack(list: List, plain: &[u8]) -> Vec<u8> {
    // Invariant: every packed chunk unpacks to the same bytes, which is verified here. Contents
    // that columns cannot represent (of other writers, or corrupt) stay plain, and a bug in the
    // coder loses no data.
    let packed = packed(list, plain).filter(|packed| packed.len() <= plain.len());
    let packed = packed.filter(|packed| unpack(list, packed).is_ok_and(|unpacked| unpacked == plain));
    packed.unwrap_or_else(|| [&[PLAIN], plain].concat())
}

fn packed(list: List, plain: &[u8]) -> Option<Vec<u8>> {
    // (Do not pack what readers would reject.)
    let bytes = plain.len() as u64;
    let length = u32::try_from(bytes).ok().filter(|_| may_be_packed(list, bytes, bytes))?;
    let (bits, numbers) = contexts(list);
    let mut columns = Columns::writer(bits, numbers);
    code(list, &mut columns, plain.len(), plain)?;
    let mut packed = vec![PACKED];
    packed.extend_from_slice(&crc32c::crc32c(plain).to_le_bytes());
    packed.extend_from_slice(&length.to_le_bytes());
    packed.extend_from_slice(&columns.finish());
    Some(packed)
}

/// Unpacks a chunk.
pub(super) fn unpack(list: List, packed: &[u8]) -> Result<Vec<u8>, Corruption> {
    let (head, columns) = packed.split_first_chunk::<HEAD>().ok_or(Corruption("too few bytes"))?;
    let word = |at: usize| u32::from_le_bytes(head[at..at + 4].try_into().expect("four bytes"));
    let (checksum, length) = (word(1), word(5));
    if head[0] != PACKED || !may_be_packed(list, packed.len() as u64, length.into()) {
        return Err(Corruption("a header that is not that of a packed chunk, or declares too many bytes"));
    }
    let (bits, numbers) = contexts(list);
    let mut columns = Columns::reader(columns, bits, numbers).ok_or(Corruption("no coder states"))?;
    let plain = code(list, &mut columns, length as usize, &[]).ok_or(Corruption("invalid lists"))?;
    if !columns.is_whole() || plain.len() != length as usize {
        return Err(Corruption("another unpacked length than declared"));
    }
    if crc32c::crc32c(&plain) != checksum {
        return Err(Corruption("another checksum of the unpacked bytes"));
    }
    Ok(plain)
}

/// Returns the numbers of contexts of bits and of numbers for a list's chunks.
fn contexts(list: List) -> (usize, usize) {
    match list {
        List::Faces | List::LevelFaces => faces::CONTEXTS,
        List::Segments => segments::CONTEXTS,
        List::Exact => exact::CONTEXTS,
        List::Objects | List::FaceValues | List::Clusters => bytes::CONTEXTS,
    }
}

/// Codes a chunk of `length` bytes; writes `plain`. Returns `None` if it is invalid.
fn code(list: List, columns: &mut Columns<'_>, length: usize, plain: &[u8]) -> Option<Vec<u8>> {
    match list {
        List::Faces | List::LevelFaces => Faces::code(columns, length, plain),
        List::Segments => Segment::code(columns, length, plain),
        List::Exact => Exact::code(columns, length, plain),
        List::Objects | List::FaceValues | List::Clusters => Some(bytes::code(columns, length, plain)),
    }
}
