//! Pages that describe sources.

use std::ops::Range;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::list::SourceList;
use super::table::{self, Chunk, PAGE_CHUNKS};
use spinney_base::Result;
use spinney_base::io::FileVersion;
use spinney_container::VersionedSection;

/// Maximum size of a page of sources in bytes.
pub(crate) const MAX_PAGE: usize = 16 << 20;

/// Name and version of a page of sources, and its maximum size.
pub(crate) const SOURCE_PAGE: VersionedSection<MAX_PAGE> =
    VersionedSection { name: "page of sources", version: 1 };

/// Size in bytes from which a page of sources is complete.
const PAGE_BYTES: usize = 8 << 10;

/// A raster that has cells.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndexedSource {
    /// Path relative to the index's directory, absolute path, or URL without query.
    pub name: String,
    /// Length in bytes.
    pub length: u64,
    /// Version when it was indexed.
    pub version: FileVersion,
    /// Number of its page, from 0, in a file of several.
    pub page: u32,
    /// Columns and rows.
    pub size: [u64; 2],
    /// Its pixels.
    pub image: SourceImage,
    /// Its mask: pixels without a sample other than 0 are VOID.
    pub mask: Option<SourceImage>,
    /// Bytes of the sample of chunks that were never written.
    pub hole: Vec<u8>,
    /// Name and version of the decoder, if the compression is lossy: other decoders may give other
    /// values.
    pub decoder: Option<String>,
}

/// An image of a source: its pixels or its mask.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceImage {
    /// Number of its format in the list.
    pub format: u32,
    /// Number of its chunks. Set by [`write_pages`].
    pub(crate) chunks: u64,
    /// Pages of 1024 chunks of its table. Set by [`write_pages`].
    pub(crate) table: Vec<Table>,
}

/// A page of a table of chunks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Table {
    /// Its bytes.
    Here(Vec<u8>),
    /// The location of its bytes in the section.
    At(Location),
}

/// Location of a page in the section.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Location {
    /// Offset from the section's beginning.
    pub(crate) offset: u64,
    /// Number of bytes.
    pub(crate) length: u32,
    /// CRC-32C of the bytes.
    pub(crate) checksum: u32,
}

/// A page of sources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PageEntry {
    /// Number of sources.
    pub(crate) sources: u32,
    pub(crate) location: Location,
}

impl Location {
    /// Returns the bytes of the page in a section of `length` bytes; `None` if it is not within it,
    /// or longer than `max`.
    pub(crate) fn within(&self, length: u64, max: usize) -> Option<Range<u64>> {
        let end = self.offset.checked_add(self.length.into())?;
        (end <= length && self.length as usize <= max).then_some(self.offset..end)
    }
}

impl SourceImage {
    /// An image whose chunks have a format.
    pub fn new(format: u32) -> SourceImage {
        SourceImage { format, ..SourceImage::default() }
    }
}

/// A source, and the chunks of its image and of its mask.
pub type DescribedSource = (IndexedSource, [Vec<Chunk>; 2]);

/// Writes the sections of an index: the list, which it completes, and the pages. `path` is for
/// messages; `next` returns the next source with the chunks of its image and mask.
///
/// # Errors
/// Those of `next`, and if there are too many sources.
pub fn write_pages(
    path: &Path,
    mut list: SourceList,
    next: &mut dyn FnMut() -> Result<Option<DescribedSource>>,
) -> Result<(Vec<u8>, Vec<u8>)> {
    let mut bytes = Vec::new();
    let mut page: Vec<IndexedSource> = Vec::new();
    let mut held = 0;
    (list.sources, list.pages) = (0, Vec::new());
    loop {
        let described = next()?;
        if let Some((mut source, [image, mask])) = described {
            held += source.name.len() + 64 + fill(&mut source.image, &image, &mut bytes);
            if let Some(image) = &mut source.mask {
                held += fill(image, &mask, &mut bytes);
            }
            page.push(source);
            list.sources += 1;
            if held < PAGE_BYTES {
                continue;
            }
        } else if page.is_empty() {
            break;
        }
        let encoded = SOURCE_PAGE.encode(&page).expect("a page is small");
        list.pages.push(PageEntry { sources: page.len() as u32, location: append(&mut bytes, &encoded) });
        (held, page) = (0, Vec::new());
    }
    Ok((list.to_bytes(path)?, bytes))
}

/// Stores the table of an image's chunks; returns the number of bytes that are in the image itself.
fn fill(image: &mut SourceImage, chunks: &[Chunk], bytes: &mut Vec<u8>) -> usize {
    image.chunks = chunks.len() as u64;
    let is_short = chunks.len() <= PAGE_CHUNKS / 4;
    let store = |chunks: &[Chunk]| match table::encode(chunks) {
        table if is_short => Table::Here(table),
        table => Table::At(append(bytes, &table)),
    };
    image.table = chunks.chunks(PAGE_CHUNKS).map(store).collect();
    image.table.iter().map(|page| if let Table::Here(table) = page { table.len() } else { 16 }).sum()
}

fn append(bytes: &mut Vec<u8>, page: &[u8]) -> Location {
    let offset = bytes.len() as u64;
    bytes.extend_from_slice(page);
    Location { offset, length: page.len() as u32, checksum: crc32c::crc32c(page) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::Error;

    fn source(number: u64) -> IndexedSource {
        IndexedSource {
            name: format!("tiles/{number}.tif"),
            length: 1000 + number,
            version: match number % 2 {
                0 => FileVersion::Modified(-5),
                _ => FileVersion::Tag("\"abc\"".into()),
            },
            page: number as u32 % 3,
            size: [7, 9],
            image: SourceImage::new(0),
            mask: number.is_multiple_of(3).then(|| SourceImage::new(1)),
            hole: vec![0, 1],
            decoder: number.is_multiple_of(4).then(|| "zune-jpeg 0.5.15".into()),
        }
    }

    /// Chunks of a table, some never written.
    fn chunks(count: u64) -> Vec<Chunk> {
        let chunk = |number: u64| match number % 5 {
            0 => table::HOLE,
            _ => Chunk { offset: 8 + number * 100, length: 90 + number % 7, checksum: number as u32 },
        };
        (0..count).map(chunk).collect()
    }

    fn page_at(bytes: &[u8], at: Location) -> &[u8] {
        let page = &bytes[at.offset as usize..][..at.length as usize];
        assert_eq!(crc32c::crc32c(page), at.checksum);
        page
    }

    #[test]
    fn pages_come_back() -> Result<()> {
        let path = Path::new("x.goblin");
        // Tables within the description, in one page, and in several.
        for (count, sizes) in [(0, [1, 1]), (1, [3, 1]), (5, [256, 300]), (3, [2500, 1024]), (200, [40, 60])]
        {
            let mut numbers = 0..count;
            let mut next = || {
                let described = |number| (source(number), sizes.map(chunks));
                Ok(numbers.next().map(described))
            };
            let (list, bytes) = write_pages(path, SourceList::default(), &mut next)?;
            let (list, used): (SourceList, usize) =
                VersionedSection::<{ 256 << 20 }> { name: "list of sources", version: 1 }
                    .decode(path, &list)?;
            assert_eq!((u64::from(list.sources), used > 0), (count, true));
            let mut found = Vec::new();
            for entry in &list.pages {
                let page: (Vec<IndexedSource>, usize) =
                    SOURCE_PAGE.decode(path, page_at(&bytes, entry.location))?;
                assert_eq!(page.0.len() as u32, entry.sources);
                found.extend(page.0);
            }
            assert!(count < 100 || list.pages.len() > 1);
            assert_eq!(found.len() as u64, count);
            for (number, found) in (0..).zip(found) {
                let images = [Some(&found.image), found.mask.as_ref()];
                for (image, size) in images.into_iter().zip(sizes) {
                    let Some(image) = image else { continue };
                    assert_eq!(image.chunks, size);
                    let mut decoded = Vec::new();
                    for (stored, known) in image.table.iter().zip(chunks(size).chunks(PAGE_CHUNKS)) {
                        let stored = match stored {
                            Table::Here(stored) => stored,
                            Table::At(at) => page_at(&bytes, *at),
                        };
                        decoded.extend(table::decode(stored, known.len()).unwrap());
                    }
                    assert_eq!(decoded, chunks(size));
                }
                let plain = |image: &SourceImage| SourceImage::new(image.format);
                let mask = found.mask.as_ref().map(plain);
                assert_eq!(IndexedSource { image: plain(&found.image), mask, ..found }, source(number));
            }
        }
        Ok(())
    }

    #[test]
    fn errors_of_sources_are_returned() {
        let mut fail = || Err(Error::Interrupted);
        let written = write_pages(Path::new("x.goblin"), SourceList::default(), &mut fail);
        assert!(matches!(written, Err(Error::Interrupted)));
    }
}
