//! Reading and writing of a chunk's numbers.

use spinney_packing::Columns;

/// Bytes that are read number by number, with zeros after the end.
#[derive(Clone, Copy)]
pub(super) struct Words<'a>(pub(super) &'a [u8]);

impl Words<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (bytes, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *bytes
    }

    pub(super) fn word(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    pub(super) fn long(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    /// Reads a number of four or two bytes.
    pub(super) fn number(&mut self, is_wide: bool) -> u32 {
        if is_wide { self.word() } else { u16::from_le_bytes(self.take()).into() }
    }

    pub(super) fn bytes(&mut self, out: &mut [u8]) {
        out.iter_mut().for_each(|byte| [*byte] = self.take());
    }
}

/// Appends words.
pub(super) fn push_words(bytes: &mut Vec<u8>, words: impl IntoIterator<Item = u32>) {
    words.into_iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
}

/// Appends numbers of four or two bytes.
pub(super) fn push_numbers(bytes: &mut Vec<u8>, numbers: &[u32], is_wide: bool) {
    for number in numbers {
        match is_wide {
            true => bytes.extend_from_slice(&number.to_le_bytes()),
            false => bytes.extend_from_slice(&(*number as u16).to_le_bytes()),
        }
    }
}

/// Codes the ends of lists, by the excess of each length over the minimum.
pub(super) fn code_ends(columns: &mut Columns<'_>, context: usize, least: u32, ends: &mut [u32]) {
    let mut end = 0u32;
    for next in ends {
        let more = columns.count(context, next.wrapping_sub(end).wrapping_sub(least).into());
        end = end.wrapping_add(least).wrapping_add(more as u32);
        *next = end;
    }
}

/// Codes parts of faces, by their differences.
pub(super) fn code_parts(columns: &mut Columns<'_>, context: usize, parts: &mut [u32]) {
    let mut last = 0u32;
    for part in parts {
        let more = i64::from(part.wrapping_sub(last) as i32);
        last = last.wrapping_add(columns.near(context, more) as u32);
        *part = last;
    }
}

/// Codes sources of faces, by their differences.
pub(super) fn code_sources(columns: &mut Columns<'_>, context: usize, sources: &mut [u64]) {
    let mut last = 0u64;
    for source in sources {
        let more = source.wrapping_sub(last) as i64;
        last = last.wrapping_add(columns.near(context, more) as u64);
        *source = last;
    }
}
