//! The two meta slots: which commit is the newest.

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::pages::{FIRST_EXTENT, PAGE};
use spinney_base::Result;
use spinney_base::io::ReadBackend;

/// The content of a slot: where the newest commit was when it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Meta {
    /// Number of commits up to this one; odd ones stand in the first slot.
    pub(super) sequence: u64,
    /// Offset of the commit's extent.
    pub(super) commit: u64,
    /// End of the commit.
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

/// Bytes of a slot.
pub(super) const SLOT_SIZE: usize = size_of::<RawMeta>();

/// Offsets of the slots: in pages of their own, so that writing one cannot damage the other.
pub(super) const SLOT_OFFSETS: [u64; 2] = [PAGE, 2 * PAGE];

/// Both slots, the first one first.
pub(super) fn slots(bytes: &dyn ReadBackend) -> Result<[Slot; 2]> {
    let mut slots = [Slot::Empty; 2];
    // (A file may have been cut since somebody looked at its length.)
    if bytes.len() >= FIRST_EXTENT {
        for (slot, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
            *slot = Meta::from_bytes(&bytes.read(offset, SLOT_SIZE)?, offset);
        }
    }
    Ok(slots)
}

impl Meta {
    /// Offset of this slot: odd sequences and even ones take turns, so that the slot before stays as it is.
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

    /// The content of the slot at an offset.
    pub(super) fn from_bytes(bytes: &[u8], offset: u64) -> Slot {
        let Ok(raw) = RawMeta::ref_from_bytes(bytes) else { return Slot::Damaged };
        if bytes.iter().all(|byte| *byte == 0) {
            return Slot::Empty;
        }
        let good = raw.magic == MAGIC && raw.checksum.get() == crc32c::crc32c(&bytes[..SLOT_SIZE - 4]);
        let meta = Meta { sequence: raw.sequence.get(), commit: raw.commit.get(), end: raw.end.get() };
        let fits =
            meta.sequence > 0 && meta.offset() == offset && (FIRST_EXTENT..meta.end).contains(&meta.commit);
        if good && fits { Slot::Whole(meta) } else { Slot::Damaged }
    }
}

/// Content of a slot's page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Slot {
    /// Nothing was ever written there, or it was lost.
    Empty,
    Whole(Meta),
    /// Half a slot, as a crash leaves it, or one that was damaged since.
    Damaged,
}
