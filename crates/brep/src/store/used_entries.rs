//! Entries of a block's lists that some of its faces use.

/// New numbers of the used entries of a list, by first use.
pub(super) struct UsedEntries {
    numbers: Vec<u32>,
    used: Vec<usize>,
}

impl UsedEntries {
    const UNUSED: u32 = u32::MAX;

    /// Creates the numbers for a list of `count` entries, none of them used.
    pub(super) fn new(count: usize) -> UsedEntries {
        UsedEntries { numbers: vec![Self::UNUSED; count], used: Vec::new() }
    }

    /// Returns the new number of an entry; `None` if there is no such entry.
    pub(super) fn number(&mut self, entry: usize) -> Option<u32> {
        let number = self.numbers.get_mut(entry)?;
        if *number == Self::UNUSED {
            *number = self.used.len() as u32;
            self.used.push(entry);
        }
        Some(*number)
    }

    /// Returns the used entries in the order of their new numbers.
    pub(super) fn used(&self) -> &[usize] {
        &self.used
    }

    /// Returns the bytes of the used entries, of a list that starts at an offset.
    pub(super) fn bytes(&self, all: &[u8], start: usize, size: usize) -> Option<Vec<u8>> {
        let mut bytes = Vec::with_capacity(size * self.used.len());
        for entry in &self.used {
            bytes.extend_from_slice(all.get(start + size * entry..start + size * (entry + 1))?);
        }
        Some(bytes)
    }
}
