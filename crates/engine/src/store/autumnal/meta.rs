//! The two meta slots, which locate the newest commit.

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::pages::{FIRST_EXTENT, PAGE};
use spinney_base::Result;
use spinney_base::io::ReadBackend;

/// Content of a slot: location of the newest commit at the time of writing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Meta {
    /// Number of commits up to this one. Odd ones are stored in the first slot, even ones in the
    /// second.
    pub(super) sequence: u64,
    /// Offset of the commit's extent.
    pub(super) commit: u64,
    /// End of the commit: all of its bytes are before this offset. The next commit starts here,
    /// rounded up to a page, and is searched for there if its slot is lost.
    pub(super) end: u64,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawMeta {
    magic: [u8; 8],
    sequence: U64,
    commit: U64,
    end: U64,
    zero: [u8; 4],
    checksum: U32,
}

const MAGIC: [u8; 8] = *b"AutuMeta";

/// Size of a slot in bytes.
pub(super) const SLOT_SIZE: usize = size_of::<RawMeta>();

/// Offsets of the slots. Each has its own page, so that a write to one cannot corrupt the other.
pub(super) const SLOT_OFFSETS: [u64; 2] = [PAGE, 2 * PAGE];

/// Reads both slots in file order.
pub(super) fn slots(bytes: &dyn ReadBackend) -> Result<[Slot; 2]> {
    let mut slots = [Slot::Empty; 2];
    // (The file may have been truncated since its length was read.)
    if bytes.len() >= FIRST_EXTENT {
        for (slot, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
            *slot = Meta::from_bytes(&bytes.read(offset, SLOT_SIZE)?, offset);
        }
    }
    Ok(slots)
}

impl Meta {
    /// Returns the offset of this slot. Odd and even sequences alternate, so that a commit leaves
    /// the slot before unchanged.
    pub(super) fn offset(&self) -> u64 {
        SLOT_OFFSETS[usize::from(self.sequence.is_multiple_of(2))]
    }

    pub(super) fn to_bytes(self) -> [u8; SLOT_SIZE] {
        let mut raw = RawMeta {
            magic: MAGIC,
            sequence: self.sequence.into(),
            commit: self.commit.into(),
            end: self.end.into(),
            zero: [0; 4],
            checksum: 0.into(),
        };
        raw.checksum = crc32c::crc32c(&raw.as_bytes()[..SLOT_SIZE - 4]).into();
        raw.as_bytes().try_into().expect("as long as it is")
    }

    /// Decodes and checks the slot at `offset`.
    pub(super) fn from_bytes(bytes: &[u8], offset: u64) -> Slot {
        let Ok(raw) = RawMeta::ref_from_bytes(bytes) else { return Slot::Corrupt };
        if bytes.iter().all(|byte| *byte == 0) {
            return Slot::Empty;
        }
        let good = raw.magic == MAGIC && raw.checksum.get() == crc32c::crc32c(&bytes[..SLOT_SIZE - 4]);
        let meta = Meta { sequence: raw.sequence.get(), commit: raw.commit.get(), end: raw.end.get() };
        let fits =
            meta.sequence > 0 && meta.offset() == offset && (FIRST_EXTENT..meta.end).contains(&meta.commit);
        if good && fits { Slot::Whole(meta) } else { Slot::Corrupt }
    }
}

/// State of a slot's page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Slot {
    /// Never written, or lost.
    Empty,
    Whole(Meta),
    /// Incomplete after a crash, or corrupt.
    Corrupt,
}
