//! Points of line fragments, in memory up to a limit and then in a temporary file.

use std::fs::File;
use std::path::PathBuf;

use zerocopy::IntoBytes;

use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result};

/// Number of a fragment.
pub(super) type FragmentId = usize;

/// Line fragments, linked to their successors.
pub(super) struct FragmentStore {
    slots: Vec<Slot>,
    free: Vec<FragmentId>,
    /// Bytes of points in memory, and their limit.
    held: usize,
    most: usize,
    /// Number of fragments in the file.
    spooled: usize,
    file: Option<File>,
    /// End of the used bytes of the file.
    end: u64,
    directory: PathBuf,
}

struct Slot {
    storage: FragmentStorage,
    next: Option<FragmentId>,
}

enum FragmentStorage {
    Free,
    Memory(Vec<[f64; 2]>),
    /// Offset and number of points.
    File(u64, usize),
}

impl FragmentStore {
    /// Creates an empty set of fragments that may use `most` bytes of memory. The temporary file is
    /// created in `directory`.
    pub(super) fn new(most: usize, directory: PathBuf) -> FragmentStore {
        FragmentStore {
            slots: Vec::new(),
            free: Vec::new(),
            held: 0,
            most,
            spooled: 0,
            file: None,
            end: 0,
            directory,
        }
    }

    /// Adds a fragment.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub(super) fn add(&mut self, points: Vec<[f64; 2]>) -> Result<FragmentId> {
        self.held += points.capacity() * size_of::<[f64; 2]>();
        let slot = Slot { storage: FragmentStorage::Memory(points), next: None };
        let number = match self.free.pop() {
            Some(number) => {
                self.slots[number] = slot;
                number
            }
            None => {
                self.slots.push(slot);
                self.slots.len() - 1
            }
        };
        if self.held > self.most {
            self.spool()?;
        }
        Ok(number)
    }

    /// Moves all fragments to the file.
    fn spool(&mut self) -> Result<()> {
        let failed = || Error::io(&self.directory, "write a temporary file");
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile_in(&self.directory).map_err(failed())?),
        };
        let mut buffer: Vec<u8> = Vec::new();
        let mut written = self.end;
        for slot in &mut self.slots {
            let FragmentStorage::Memory(points) = &slot.storage else { continue };
            let storage = FragmentStorage::File(self.end, points.len());
            buffer.extend_from_slice(points.as_bytes());
            self.end += points.as_bytes().len() as u64;
            self.spooled += 1;
            slot.storage = storage;
            if buffer.len() >= 1 << 18 {
                write_all_at(file, &buffer, written).map_err(failed())?;
                (written, buffer) = (self.end, Vec::new());
            }
        }
        write_all_at(file, &buffer, written).map_err(failed())?;
        self.held = 0;
        Ok(())
    }

    /// Makes a fragment the successor of another one.
    pub(super) fn link(&mut self, from: FragmentId, to: FragmentId) {
        self.slots[from].next = Some(to);
    }

    /// Passes the points of a fragment and all its successors to `each`, in chunks. A point shared
    /// by two consecutive fragments is passed once.
    ///
    /// # Errors
    /// If the temporary file cannot be read, or `each` fails.
    pub(super) fn each(
        &self,
        first: FragmentId,
        each: &mut dyn FnMut(&[[f64; 2]]) -> Result<()>,
    ) -> Result<()> {
        const PART: usize = 1 << 12;
        let mut fragment = Some(first);
        let mut part = Vec::new();
        while let Some(number) = fragment {
            let slot = &self.slots[number];
            let skipped = usize::from(number != first);
            match &slot.storage {
                FragmentStorage::Free => {}
                FragmentStorage::Memory(points) => each(points.get(skipped..).unwrap_or(&[]))?,
                FragmentStorage::File(offset, count) => {
                    let file = self.file.as_ref().expect("the file has fragments");
                    for start in (skipped..*count).step_by(PART) {
                        part.clear();
                        part.resize(PART.min(count - start), [0.0; 2]);
                        let at = offset + (start * size_of::<[f64; 2]>()) as u64;
                        let read = read_exact_at(file, <[[f64; 2]]>::as_mut_bytes(&mut part), at);
                        read.map_err(Error::io(&self.directory, "read a temporary file"))?;
                        each(&part)?;
                    }
                }
            }
            fragment = slot.next;
        }
        Ok(())
    }

    /// Removes a fragment and all its successors.
    pub(super) fn remove(&mut self, first: FragmentId) {
        let mut fragment = Some(first);
        while let Some(number) = fragment {
            let slot = std::mem::replace(
                &mut self.slots[number],
                Slot { storage: FragmentStorage::Free, next: None },
            );
            match slot.storage {
                FragmentStorage::Free => {}
                FragmentStorage::Memory(points) => {
                    self.held = self.held.saturating_sub(points.capacity() * size_of::<[f64; 2]>());
                }
                FragmentStorage::File(..) => self.spooled -= 1,
            }
            self.free.push(number);
            fragment = slot.next;
        }
        // Reuse the file's space once nothing is in it.
        if self.spooled == 0 {
            self.end = 0;
        }
    }
}
