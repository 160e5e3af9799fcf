//! Tables of values in columns, whose rows are the parts or the faces of a model. Columns are
//! stored in chunks that a list locates, so that a single value can be read without the others.

use std::collections::BTreeMap;

use super::chunks::ChunkList;
use super::reader::ExactModel;
use spinney_base::Result;
use spinney_base::io::FileBytes;

/// The column with the names of the other columns.
pub(super) const COLUMN_NAMES: u32 = 2;
/// The first column that has a name.
pub(crate) const FIRST_NAMED: u32 = 16;
/// Maximum number of named columns.
pub(crate) const MAX_NAMED: u32 = 4096;

/// Maximum number of bytes of a value.
pub(crate) const MAX_BYTES: usize = 16 << 20;

/// Bytes of a chunk's header.
const HEAD: usize = 8;
const NUMBERS: u32 = 1;
const WIDE: u32 = 2;

/// Returns the key of a chunk: the column, and the row of the first value.
fn key(column: u32, row: u32) -> u64 {
    u64::from(column) << 32 | u64::from(row)
}

/// Receives a chunk with its key.
pub(crate) type ChunkVisitor<'a> = dyn FnMut(u64, &[u8]) -> Result<()> + 'a;

/// Collects the values of a table by column, and emits chunks.
#[derive(Default)]
pub(crate) struct TableWriter {
    open: BTreeMap<u32, OpenChunk>,
    /// Bytes of all incomplete chunks.
    open_bytes: usize,
}

#[derive(Default)]
struct OpenChunk {
    rows: Vec<u32>,
    ends: Vec<u32>,
    bytes: Vec<u8>,
}

impl OpenChunk {
    /// Returns the maximum number of bytes that it takes.
    fn size(&self) -> usize {
        HEAD + 6 * self.rows.len() + self.bytes.len()
    }

    fn to_bytes(&self) -> Vec<u8> {
        let OpenChunk { rows, ends, bytes } = self;
        let has_numbers = (rows[0]..).zip(rows).any(|(expected, row)| *row != expected);
        let is_wide = bytes.len() > usize::from(u16::MAX);
        let flags = if has_numbers { NUMBERS } else { 0 } | if is_wide { WIDE } else { 0 };
        let mut all = Vec::with_capacity(self.size());
        [rows.len() as u32, flags].iter().for_each(|word| all.extend_from_slice(&word.to_le_bytes()));
        if has_numbers {
            rows.iter().for_each(|row| all.extend_from_slice(&row.to_le_bytes()));
        }
        for end in ends {
            match is_wide {
                true => all.extend_from_slice(&end.to_le_bytes()),
                false => all.extend_from_slice(&(*end as u16).to_le_bytes()),
            }
        }
        all.extend_from_slice(bytes);
        all
    }
}

impl TableWriter {
    /// Maximum bytes of a chunk with more than one value.
    const MAX_CHUNK_BYTES: usize = 1 << 16;
    /// Maximum bytes of all incomplete chunks. It is a constant, since files depend on it.
    const MAX_OPEN_BYTES: usize = 8 << 20;

    /// Adds a value of at most [`MAX_BYTES`] bytes to a column; the rows of a column must ascend.
    pub(crate) fn push(
        &mut self,
        column: u32,
        row: u32,
        value: &[u8],
        take: &mut ChunkVisitor<'_>,
    ) -> Result<()> {
        let size = HEAD + 6 + value.len();
        if self.open.get(&column).is_some_and(|chunk| chunk.size() + size > Self::MAX_CHUNK_BYTES) {
            self.finish_chunk(column, take)?;
        }
        let chunk = self.open.entry(column).or_default();
        debug_assert!(chunk.rows.last().is_none_or(|last| *last < row) && value.len() <= MAX_BYTES);
        chunk.rows.push(row);
        chunk.bytes.extend_from_slice(value);
        chunk.ends.push(chunk.bytes.len() as u32);
        self.open_bytes += 6 + value.len();
        while self.open_bytes > Self::MAX_OPEN_BYTES {
            let largest = self.open.iter().max_by_key(|(_, chunk)| chunk.size());
            let Some(largest) = largest.map(|(column, _)| *column) else { break };
            self.finish_chunk(largest, take)?;
        }
        Ok(())
    }

    fn finish_chunk(&mut self, column: u32, take: &mut ChunkVisitor<'_>) -> Result<()> {
        let Some(chunk) = self.open.remove(&column) else { return Ok(()) };
        self.open_bytes -= chunk.size() - HEAD;
        take(key(column, chunk.rows[0]), &chunk.to_bytes())
    }

    /// Emits the remaining chunks.
    pub(crate) fn finish(mut self, take: &mut ChunkVisitor<'_>) -> Result<()> {
        while let Some(column) = self.open.keys().next().copied() {
            self.finish_chunk(column, take)?;
        }
        Ok(())
    }
}

/// A chunk of a column.
pub(super) struct Values<'a> {
    bytes: FileBytes<'a>,
    first: u32,
    count: usize,
    flags: u32,
    ends: usize,
    values_start: usize,
}

impl<'a> Values<'a> {
    /// Wraps a chunk whose first value is that of row `first`; returns `None` if its lists do not
    /// fit its bytes.
    fn new(bytes: FileBytes<'a>, first: u32) -> Option<Values<'a>> {
        let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
        let (count, flags) = (word(0)? as usize, word(4)?);
        let ends = HEAD + if flags & NUMBERS != 0 { 4 * count } else { 0 };
        let values_start = ends + count * if flags & WIDE != 0 { 4 } else { 2 };
        let fits = values_start <= bytes.len() && count > 0 && flags <= NUMBERS | WIDE;
        fits.then_some(Values { bytes, first, count, flags, ends, values_start })
    }

    /// Checks a chunk of an untrusted file; returns the row of its last value. Errors describe the
    /// flaw.
    fn check(&self) -> Result<u32, String> {
        let mut end = 0;
        for index in 0..self.count {
            let next = self.end(index);
            if next < end || next - end > MAX_BYTES {
                return Err(format!("a value from byte {end} to {next}"));
            }
            end = next;
        }
        let length = self.bytes.len() - self.values_start;
        if end != length {
            return Err(format!("{length} bytes of values that end at {end}"));
        }
        let are_ascending = self.flags & NUMBERS == 0
            || (0..self.count - 1).all(|index| self.row(index) < self.row(index + 1));
        let last = u64::from(self.first) + self.count as u64 - 1;
        let fits = self.flags & NUMBERS != 0 || last <= u64::from(u32::MAX);
        if !are_ascending || !fits || self.row(0) != self.first {
            return Err("rows that do not ascend".into());
        }
        Ok(self.row(self.count - 1))
    }

    fn word(&self, at: usize) -> u32 {
        let four = self.bytes.get(at..at + 4);
        four.map_or(0, |four| u32::from_le_bytes(four.try_into().expect("four bytes")))
    }

    fn row(&self, index: usize) -> u32 {
        match self.flags & NUMBERS {
            0 => self.first.wrapping_add(index as u32),
            _ => self.word(HEAD + 4 * index),
        }
    }

    fn end(&self, index: usize) -> usize {
        if self.flags & WIDE != 0 {
            return self.word(self.ends + 4 * index) as usize;
        }
        let at = self.ends + 2 * index;
        self.bytes.get(at..at + 2).map_or(0, |two| u16::from_le_bytes([two[0], two[1]])) as usize
    }

    fn value(&self, index: usize) -> &[u8] {
        let start = if index == 0 { 0 } else { self.end(index - 1) };
        self.bytes.get(self.values_start + start..self.values_start + self.end(index)).unwrap_or_default()
    }

    /// Returns the value of a row.
    fn of_row(&self, row: u32) -> Option<&[u8]> {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = (low + high) / 2;
            if self.row(middle) < row { low = middle + 1 } else { high = middle }
        }
        (low < self.count && self.row(low) == row).then(|| self.value(low))
    }
}

impl ExactModel {
    /// Loads a chunk of a table.
    pub(super) fn values(&self, table: &ChunkList, index: usize) -> Result<Values<'_>> {
        let wrong = |found: String| {
            self.corrupt(format!("{} {index}", table.name()), found, "values as in formats.md")
        };
        let bytes = table.load(&self.path, &*self.backend, index)?;
        let own = table.entry(&self.path, &*self.backend, index)?.key;
        let values = Values::new(bytes, own as u32).ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !table.is_checked(index) {
            let last = values.check().map_err(wrong)?;
            if index + 1 < table.len() {
                let next = table.entry(&self.path, &*self.backend, index + 1)?.key;
                if next >> 32 == own >> 32 && next as u32 <= last {
                    return Err(wrong(format!(
                        "row {last}, which the next chunk's first row does not exceed"
                    )));
                }
            }
            table.set_checked(index);
        }
        Ok(values)
    }

    /// Reads the value of a row in a column of a table.
    pub(super) fn value(&self, table: &ChunkList, column: u32, row: u32) -> Result<Option<Vec<u8>>> {
        let Some(index) = table.find(&self.path, &*self.backend, key(column, row))? else { return Ok(None) };
        if table.entry(&self.path, &*self.backend, index)?.key >> 32 != u64::from(column) {
            return Ok(None);
        }
        Ok(self.values(table, index)?.of_row(row).map(<[u8]>::to_vec))
    }

    /// Visits all values of a column of a table, with their rows.
    pub(super) fn each_value(
        &self,
        table: &ChunkList,
        column: u32,
        each: &mut dyn FnMut(u32, &[u8]) -> Result<()>,
    ) -> Result<()> {
        let before = match key(column, 0).checked_sub(1) {
            Some(key) => table.find(&self.path, &*self.backend, key)?,
            None => None,
        };
        for index in before.map_or(0, |before| before + 1)..table.len() {
            if table.entry(&self.path, &*self.backend, index)?.key >> 32 != u64::from(column) {
                break;
            }
            let values = self.values(table, index)?;
            (0..values.count).try_for_each(|index| each(values.row(index), values.value(index)))?;
        }
        Ok(())
    }

    /// Reads all values of a column as strings; rows must be numbered from 0 without gaps, and
    /// there may be at most `most`.
    pub(super) fn list_of_strings(&self, table: &ChunkList, column: u32, most: u64) -> Result<Vec<String>> {
        let mut strings: Vec<String> = Vec::new();
        self.each_value(table, column, &mut |row, value| {
            if row as usize != strings.len() || u64::from(row) >= most {
                let expected = format!("at most {most} rows, without gaps");
                return Err(self.corrupt(table.name().into(), format!("row {row}"), &expected));
            }
            strings.push(self.text(table, value.to_vec())?);
            Ok(())
        })?;
        Ok(strings)
    }

    /// Decodes a value that is a string.
    pub(super) fn text(&self, table: &ChunkList, value: Vec<u8>) -> Result<String> {
        let wrong = |_| self.corrupt(table.name().into(), "bytes that are not UTF-8", "UTF-8");
        String::from_utf8(value).map_err(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of several columns are restored, whichever are missing, and whatever their lengths.
    #[test]
    fn values_come_back() {
        let mut writer = TableWriter::default();
        let mut chunks: BTreeMap<u64, Vec<u8>> = BTreeMap::new();
        let mut take = |key: u64, bytes: &[u8]| {
            assert!(chunks.insert(key, bytes.to_vec()).is_none());
            Ok(())
        };
        let value = |column: u32, row: u32| -> Option<Vec<u8>> {
            let is_there = column == 0 || row.wrapping_mul(2_654_435_761) >> 28 & 1 == 0;
            let length = match (column, row % 1000) {
                (1, 77) => 200_000,
                _ => (row % 7 * column) as usize,
            };
            is_there.then(|| vec![row as u8; length])
        };
        for row in 0..30_000 {
            for column in 0..3 {
                if let Some(value) = value(column, row) {
                    writer.push(column, row, &value, &mut take).unwrap();
                }
            }
        }
        writer.finish(&mut take).unwrap();
        assert!(chunks.len() > 8);
        let mut next = [0; 3];
        for (key, bytes) in &chunks {
            assert!(bytes.len() <= TableWriter::MAX_CHUNK_BYTES + 16 || bytes[0] == 1, "{}", bytes.len());
            let column = (key >> 32) as u32;
            let values = Values::new(FileBytes::Mapped(bytes), *key as u32).unwrap();
            let last = values.check().unwrap();
            for row in *key as u32..=last {
                assert_eq!(values.of_row(row).map(<[u8]>::to_vec), value(column, row), "{column} {row}");
                next[column as usize] = row;
            }
            assert_eq!(values.of_row(last.wrapping_add(1)), None);
        }
        assert!(next.iter().all(|last| *last > 29_900), "{next:?}");
    }

    /// A changed byte is either detected, or yields other valid values.
    #[test]
    fn corruption_is_found_or_harmless() {
        let mut writer = TableWriter::default();
        let mut chunk = Vec::new();
        for (row, value) in [(3, "a"), (4, ""), (9, "long")] {
            writer.push(7, row, value.as_bytes(), &mut |_, _| Ok(())).unwrap();
        }
        let mut take = |_, bytes: &[u8]| {
            chunk = bytes.to_vec();
            Ok(())
        };
        writer.finish(&mut take).unwrap();
        for at in 0..chunk.len() {
            for to in [0, 1, 2, 4, 0x7f, 0xff] {
                let mut bytes = chunk.clone();
                bytes[at] = to;
                let Some(values) = Values::new(FileBytes::Mapped(&bytes), 3) else { continue };
                if values.check().is_ok() {
                    let read = (0..12).filter_map(|row| values.of_row(row)).map(<[u8]>::len).sum::<usize>();
                    assert!(read <= 5);
                }
            }
        }
    }
}
