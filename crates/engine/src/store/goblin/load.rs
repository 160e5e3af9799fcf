//! Segments as they are needed: checked when they are used first, loaded from wherever the file's bytes are.

use std::sync::atomic::Ordering;

use super::directory::{NOT_COUNTED, SegmentLocation};
use super::reader::Goblin;
use super::segment::{COUNT_SIZE, Segment};
use spinney_base::Result;
use spinney_base::io::FileBytes;
use spinney_base::space::Code;

impl Goblin {
    /// One segment.
    ///
    /// # Errors
    /// If it is damaged or cannot be read.
    ///
    /// # Panics
    /// If there is no such segment.
    #[inline]
    pub fn segment(&self, index: usize) -> Result<Segment<'_>> {
        if self.is_checked(index) { self.load(index) } else { self.check_segment(index) }
    }

    /// Whether a segment was found to be good.
    #[inline]
    fn is_checked(&self, index: usize) -> bool {
        self.checked[index / 64].load(Ordering::Relaxed) >> (index % 64) & 1 != 0
    }

    /// Loads a segment that is used for the first time, and checks all that does not depend on where in it a
    /// walk goes.
    #[cold]
    fn check_segment(&self, index: usize) -> Result<Segment<'_>> {
        let entry = self.entry(index)?;
        let part = || format!("segment {} (entry {index})", entry.code);
        let listed = if entry.classes == NOT_COUNTED { 0 } else { entry.classes };
        let classes = u64::from(listed) * (self.layout.width + COUNT_SIZE) as u64;
        let records = u64::from(entry.records) * self.layout.size as u64;
        if entry.records == 0 || entry.length != records + classes {
            let found = format!("{} bytes, {} records", entry.length, entry.records);
            return Err(self.corrupt(part(), found, "as many bytes as the records and class counts need"));
        }
        let room = self.layer().directory;
        if entry.offset.checked_add(entry.length).is_none_or(|end| end > room) {
            let found = format!("bytes {} + {}", entry.offset, entry.length);
            return Err(self.corrupt(part(), found, "bytes before the directory"));
        }
        let level = entry.code.level();
        if self.header.shape.segment_level(level) != level {
            return Err(self.corrupt(part(), format!("level {level}"), "a segment's level"));
        }
        // Segments lie beside each other. Else a small file could claim many large ones, and take hours to
        // walk.
        // (Another thread may have checked this one meanwhile: it sets the segment's bit before it adds
        // the bytes, so that who sees them sees the bit.)
        if self.checked_bytes.load(Ordering::Acquire) + entry.length > room && !self.is_checked(index) {
            return Err(self.corrupt(part(), "bytes of another segment", "segments that do not overlap"));
        }
        let segment = self.load(index)?;
        if self.file.check {
            let checksum = crc32c::crc32c(segment.all_bytes());
            if checksum != entry.checksum {
                let expected = format!("{:08x}", entry.checksum);
                return Err(self.corrupt(part(), format!("checksum {checksum:08x}"), &expected));
            }
        }
        // All walks start from here: with the first record's extent known, each step down can check the next
        // one's.
        let skip = self.layout.head(segment.records(), 0).map_or(0, |head| head.skip);
        if skip != entry.records {
            let expected = format!("{}, all records", entry.records);
            return Err(self.corrupt(part(), format!("a first skip of {skip}"), &expected));
        }
        let counted = segment.classes().iter().try_fold(0u64, |sum, (_, cells)| sum.checked_add(*cells));
        if entry.classes == 0 && self.header.counts_classes() {
            return Err(self.corrupt(part(), "no class counts", "some, or the number that means very many"));
        }
        if listed > 0 && counted != Some(entry.zone.cells) {
            let expected = format!("{}, as the directory has it", entry.zone.cells);
            return Err(self.corrupt(part(), format!("class counts of {counted:?} cells"), &expected));
        }
        // Two threads may have checked it at the same time: the one that sets the bit counts the bytes, once.
        let bit = 1u64 << (index % 64);
        if self.checked[index / 64].fetch_or(bit, Ordering::Relaxed) & bit == 0 {
            self.checked_bytes.fetch_add(entry.length, Ordering::Release);
        }
        Ok(segment)
    }

    /// A segment whose entry is known to be good.
    #[inline]
    fn load(&self, index: usize) -> Result<Segment<'_>> {
        // The mapped bytes of a file can change after they were checked. They must not lead out of it then.
        let changed = || {
            let part = format!("directory entry {index}");
            self.corrupt(part, "other numbers than before", "a file that nobody writes to")
        };
        let entry = SegmentLocation::read(&self.entry_bytes(index)?).ok_or_else(changed)?;
        let code = Code::from_bits(self.layout.dimension, entry.code).ok_or_else(changed)?;
        // (No overflow: both were within the run when they were checked; and if they changed, nothing is there.)
        let (offset, length) = (self.layer().run.offset.wrapping_add(entry.offset), entry.length as usize);
        let bytes = match self.file.backend.bytes() {
            Some(all) => {
                let bytes = all.get(offset as usize..).and_then(|rest| rest.get(..length));
                FileBytes::Mapped(bytes.ok_or_else(changed)?)
            }
            None => self.file.backend.share(offset, length)?,
        };
        let record_bytes = entry.records as usize * self.layout.size;
        if record_bytes > bytes.len() {
            return Err(changed());
        }
        Ok(Segment { code, index, bytes, record_bytes, width: self.layout.width })
    }
}
