//! Sizes of segments, according to the segment index.

use super::directory::SegmentLocation;
use super::reader::Goblin;
use spinney_base::Result;
use spinney_base::space::Code;
use spinney_container::Codec;

/// Maximum size in bytes of a segment index that is fetched at once.
const MAX_PREFETCHED: u64 = 2 << 20;

/// The segments of nodes at a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelBytes {
    /// The level.
    pub level: u8,
    /// Number of segments.
    pub segments: u64,
    /// Number of packed segments.
    pub packed: u64,
    /// Number of segments that are references to other files.
    pub references: u64,
    /// Size of all segments in the file, in bytes.
    pub bytes: u64,
    /// Size of all segments when unpacked, in bytes.
    pub plain: u64,
}

impl Goblin {
    /// Returns the sizes of all segments by the level of their nodes, from the root down. Reads the
    /// whole segment index, but no segment.
    ///
    /// # Errors
    /// If a page of the segment index is corrupt.
    pub fn level_bytes(&self) -> Result<Vec<LevelBytes>> {
        // (Pages follow each other.)
        let (run, directory) = (self.layer().run, self.layer().directory);
        if run.length - directory <= MAX_PREFETCHED {
            let range = run.offset + directory..run.offset + run.length;
            self.file.backend.prefetch(std::slice::from_ref(&range))?;
        }
        let mut levels: Vec<LevelBytes> = Vec::new();
        for index in 0..self.segments() {
            let entry =
                SegmentLocation::read(&self.entry_bytes(index)?).ok_or_else(|| self.changed(index))?;
            let node = Code::from_bits(self.layout.dimension, entry.code);
            let level = node.ok_or_else(|| self.changed(index))?.level();
            let at = levels.binary_search_by_key(&level, |known| known.level).unwrap_or_else(|at| {
                levels.insert(
                    at,
                    LevelBytes { level, segments: 0, packed: 0, references: 0, bytes: 0, plain: 0 },
                );
                at
            });
            let sum = &mut levels[at];
            sum.segments += 1;
            sum.packed += u64::from(entry.codec == Codec::Packed);
            sum.references += u64::from(entry.codec == Codec::Reference);
            sum.bytes = sum.bytes.saturating_add(entry.length);
            sum.plain = sum.plain.saturating_add(self.plain_length(entry.records, entry.classes));
        }
        Ok(levels)
    }
}
