//! Checks the chunks of compressed points before decoding. Decoders trust the sizes in a file and
//! allocate that much memory.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use laz::LazVlr;
use laz::laszip::{ChunkTable, LazItemType};

use spinney_base::guard::guard;
use spinney_base::{Error, Result};

/// Returns whether the points are one stream without chunks and a chunk table: the point-wise
/// compressor of early LASzip versions.
fn is_one_stream(record: &[u8]) -> bool {
    record.starts_with(&1u16.to_le_bytes())
}

/// Parses the LASzip record, which must match the record size, and returns whether the points are
/// in chunks.
pub(super) fn unpacking(path: &Path, size: usize, record: &[u8]) -> Result<(LazVlr, bool)> {
    let is_one_stream = is_one_stream(record);
    let record = guard(path, "laszip record", || {
        LazVlr::from_buffer(record).map_err(|error| corrupt(path, &error.to_string()))
    })?;
    if record.items_size() != size as u64 {
        return Err(corrupt(path, &format!("items of {} bytes for points of {size}", record.items_size())));
    }
    if !is_one_stream && record.chunk_size() == 0 {
        return Err(corrupt(path, "a chunk size of 0 points"));
    }
    // A layered stream without chunks has no uncompressed first point, and no decoder supports it.
    if is_one_stream && record.items().iter().any(|item| item.version() > 2) {
        return Err(corrupt(path, "layered compression without chunks"));
    }
    Ok((record, !is_one_stream))
}

pub(super) fn corrupt(path: &Path, found: &str) -> Error {
    Error::corrupt(path, "compressed points", found, "LASzip data")
}

/// Checks the chunk count, for which the decoder allocates memory before reading the chunks, and
/// the sizes of their layers.
pub(super) fn check_chunks(
    path: &Path,
    file: &mut BufReader<File>,
    (start, points): (u64, u64),
    record: &LazVlr,
) -> Result<()> {
    let length = file.get_ref().metadata().map_err(Error::io(path, "read"))?.len();
    let mut table = |at: u64| -> io::Result<u64> {
        file.seek(SeekFrom::Start(at))?;
        let mut bytes = [0; 8];
        file.read_exact(&mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    };
    let found = table(start).and_then(|first| {
        // Writers to pipes put the offset of the chunk table at the end of the file.
        let table_offset =
            if first as i64 <= start as i64 { table(length.saturating_sub(8))? } else { first };
        let count = if table_offset < length { table(table_offset)? >> 32 } else { 0 };
        Ok((table_offset, count))
    });
    let (table_offset, count) = found.map_err(|error| corrupt(path, &error.to_string()))?;
    // Each chunk contains an uncompressed point of at least 20 bytes.
    if table_offset <= start || table_offset >= length || count > length / 20 + 1 {
        return Err(corrupt(
            path,
            &format!("a table of {count} chunks at byte {table_offset} of a file of {length} bytes"),
        ));
    }
    let found = check_layers(file, (start, table_offset), points, record).map_err(Error::io(path, "read"))?;
    found.map_or(Ok(()), |found| Err(corrupt(path, &found)))?;
    file.seek(SeekFrom::Start(start)).map_err(Error::io(path, "read"))?;
    Ok(())
}

/// Returns the number of layers of an item in a chunk.
fn layers_of(item: LazItemType) -> u64 {
    match item {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(bytes) => bytes.into(),
        _ => 1,
    }
}

/// Traverses the chunks like a decoder. Each begins with an uncompressed point, a count and the
/// sizes of its layers. All layers must lie before the chunk table, and there must be chunks for
/// all points. Returns a description of the first problem.
fn check_layers(
    file: &mut BufReader<File>,
    (start, table): (u64, u64),
    points: u64,
    record: &LazVlr,
) -> io::Result<Option<String>> {
    if record.items().first().is_none_or(|item| item.version() < 3) {
        return Ok(None);
    }
    let mut counts = Vec::new();
    if record.uses_variable_size_chunks() {
        file.seek(SeekFrom::Start(start))?;
        match ChunkTable::read_from(&mut *file, record) {
            Ok(table) => counts.extend(table.as_ref().iter().map(|chunk| chunk.point_count)),
            Err(error) => return Ok(Some(error.to_string())),
        }
    }
    let mut counts = counts.into_iter();
    let layers: u64 = record.items().iter().map(|item| layers_of(item.item_type())).sum();
    let mut sizes = vec![0; 4 * layers as usize];
    let mut at = start + ChunkTable::OFFSET_SIZE as u64;
    let mut left = points;
    while left > 0 {
        let count =
            if record.uses_variable_size_chunks() { counts.next() } else { Some(record.chunk_size().into()) };
        let Some(count) = count else { return Ok(Some(format!("no chunks for {left} points"))) };
        let head = record.items_size() + 4 + sizes.len() as u64;
        if head > table.saturating_sub(at) {
            return Ok(Some(format!("no chunk for {left} points at byte {at}")));
        }
        file.seek(SeekFrom::Start(at + record.items_size() + 4))?;
        file.read_exact(&mut sizes)?;
        let bytes: u64 =
            sizes.as_chunks::<4>().0.iter().map(|size| u64::from(u32::from_le_bytes(*size))).sum();
        if bytes > table - at - head {
            return Ok(Some(format!(
                "layers of {bytes} bytes in a chunk at byte {at}, which overlap the chunk table at byte {table}"
            )));
        }
        at += head + bytes;
        left = left.saturating_sub(count);
    }
    Ok(None)
}
