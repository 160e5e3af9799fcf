//! Reads of indexes, whose cells are in another file.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::{Duration, SystemTime};

use spinney::import::raster::{ImportOptions, plan};
use spinney::{Dataset, OpenOptions, Output};

use super::{seal, trees};

/// Tags of the sections that describe sources.
const TAGS: [&[u8; 4]; 2] = [b"SRCS", b"SRCP"];
/// Bytes before the sections of an input: the length of the first one.
const HEAD: usize = 2;

/// An index, whose source is next to it.
pub struct SmallIndex {
    directory: tempfile::TempDir,
    /// The bytes of the index.
    pub bytes: Vec<u8>,
}

impl SmallIndex {
    /// Makes the index of a small file: two pages of a table of chunks, of which some are not
    /// written, and a mask. The bytes are the same every time.
    fn new() -> SmallIndex {
        spinney::raw::register();
        let directory = tempfile::tempdir().unwrap();
        let source = directory.path().join("a.tif");
        std::fs::write(&source, source_bytes()).unwrap();
        let file = std::fs::File::options().append(true).open(&source).unwrap();
        file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000)).unwrap();
        let mut options = ImportOptions::new();
        options.referenced = Some(2);
        let path = directory.path().join("x.goblin");
        plan(&[source], &options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
        SmallIndex { bytes: std::fs::read(path).unwrap(), directory }
    }

    /// Returns the path of the index.
    pub fn path(&self) -> PathBuf {
        self.directory.path().join("x.goblin")
    }

    /// Returns the two sections.
    pub fn sections(&self) -> [&[u8]; 2] {
        TAGS.map(|tag| {
            let (_, start, length) = seal::section(&self.bytes, tag).unwrap();
            &self.bytes[start..start + length]
        })
    }

    /// Returns the sections as an input of [`index_sections`].
    pub fn input(&self) -> Vec<u8> {
        let [list, pages] = self.sections();
        [&(list.len() as u16).to_le_bytes(), list, pages].concat()
    }

    /// Opens an index with other bytes, which are in memory.
    pub fn open(&self, bytes: Vec<u8>) -> spinney::Result<Dataset> {
        use spinney::raw::store::goblin::Goblin;
        // (Without the cells of earlier indexes.)
        let access = spinney::FileAccess::new().unpacked_cache(8 << 20);
        let backend = trees::backend(bytes);
        Dataset::of(Goblin::from_backend(&self.path(), backend, &OpenOptions::new().access(access))?.into())
    }
}

/// The index whose sections are replaced.
pub fn small_index() -> &'static SmallIndex {
    static INDEX: OnceLock<SmallIndex> = OnceLock::new();
    INDEX.get_or_init(SmallIndex::new)
}

/// A grey image of 40 x 300 pixels in strips of a row, without compression, with a mask.
fn source_bytes() -> Vec<u8> {
    let (width, height) = (40u32, 300u32);
    let mut bytes = b"II*\0\0\0\0\0".to_vec();
    let mut strips = Vec::new();
    for y in 0..height {
        let is_written = y % 7 > 0;
        strips.push((if is_written { bytes.len() as u32 } else { 0 }, if is_written { width } else { 0 }));
        if is_written {
            bytes.extend((0..width).map(|x| ((x / 9) ^ (y / 20)) as u8));
        }
    }
    let mask = bytes.len() as u32;
    bytes.extend((0..height * width.div_ceil(8)).map(|at| if at % 11 == 0 { 0x5a } else { 0xff }));
    let list = |bytes: &mut Vec<u8>, numbers: Vec<u32>| {
        let at = bytes.len() as u32;
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        at
    };
    let offsets = list(&mut bytes, strips.iter().map(|(offset, _)| *offset).collect());
    let lengths = list(&mut bytes, strips.iter().map(|(_, length)| *length).collect());
    let size = |bits: u32| vec![(256, 1, width), (257, 1, height), (258, 1, bits), (259, 1, 1)];
    let image = [(262, 1, 1), (273, height, offsets), (278, 1, 1), (279, height, lengths)];
    let of_mask = [(262, 1, 4), (273, 1, mask), (278, 1, height), (279, 1, height * width.div_ceil(8))];
    let directories =
        [[size(8), image.into()].concat(), [vec![(254, 1, 4)], size(1), of_mask.into()].concat()];
    let mut link = 4;
    for tags in directories {
        let here = (bytes.len() as u32).to_le_bytes();
        bytes[link..link + 4].copy_from_slice(&here);
        bytes.extend((tags.len() as u16).to_le_bytes());
        for (tag, count, value) in tags {
            bytes.extend([&(tag as u16).to_le_bytes()[..], &[4, 0]].concat());
            bytes.extend([u32::to_le_bytes(count), u32::to_le_bytes(value)].concat());
        }
        link = bytes.len();
        bytes.extend([0; 4]);
    }
    bytes
}

/// Returns a file whose sections of sources are replaced. The new ones are before the trailer.
pub fn with_sections(file: &[u8], sections: [&[u8]; 2]) -> Vec<u8> {
    let start = seal::trailer(file).unwrap();
    let mut new = file[..start].to_vec();
    let positions = sections.map(|section| {
        new.extend(section);
        (new.len() - section.len(), section.len())
    });
    let shift = new.len() - start;
    new.extend(&file[start..]);
    for (tag, (offset, length)) in TAGS.into_iter().zip(positions) {
        let (at, ..) = seal::section(file, tag).unwrap();
        seal::set_long(&mut new, at + shift + 8, offset as u64);
        seal::set_long(&mut new, at + shift + 16, length as u64);
    }
    seal::goblin_end(&mut new);
    seal::goblin(&mut new);
    new
}

/// Corrects the checksums of pages: of tables in the pages of sources, then of pages in the list.
/// They are found by what they look like: a number of four bytes after an offset and a length
/// within the pages.
pub fn seal_pages(list: &mut [u8], pages: &mut [u8]) {
    for at in 0..pages.len() {
        // (The number of the variant is before the offset.)
        if let Some((range, start)) = checksum_at(pages, at, pages.len())
            && range.end < start
            && start > 0
            && pages[start - 1] == 1
        {
            let checksum = crc32c::crc32c(&pages[range]);
            seal::set_short(pages, at + 1, checksum);
        }
    }
    // Entries of pages are the end of the list: number of sources, offset, length, checksum.
    let mut end = list.len();
    while let Some(at) = end.checked_sub(5)
        && let Some((range, start)) = checksum_at(list, at, pages.len())
        && let Some((_, start)) = number_before(list, start)
    {
        let checksum = crc32c::crc32c(&pages[range]);
        seal::set_short(list, at + 1, checksum);
        end = start;
    }
}

/// Returns the range of the pages whose checksum may be after the byte at `at`, and where the range
/// is stored.
fn checksum_at(bytes: &[u8], at: usize, pages: usize) -> Option<(std::ops::Range<usize>, usize)> {
    (bytes[at] == 252 && at + 5 <= bytes.len()).then_some(())?;
    let (length, before) = number_before(bytes, at)?;
    let (offset, start) = number_before(bytes, before)?;
    let end = offset.checked_add(length).filter(|end| *end <= pages && length > 32)?;
    Some((offset..end, start))
}

/// Returns the encoded number before a position, and where it begins.
fn number_before(bytes: &[u8], end: usize) -> Option<(usize, usize)> {
    match bytes.get(..end)? {
        [.., 251, low, high] => Some((usize::from(u16::from_le_bytes([*low, *high])), end - 3)),
        [.., byte @ 0..=250] => Some((usize::from(*byte), end - 1)),
        _ => None,
    }
}

/// The sections of an index that describe its sources, whose checksums are corrected: the length of
/// the first one, then both.
pub fn index_sections(bytes: &[u8]) {
    let Some((head, rest)) = bytes.split_first_chunk::<HEAD>() else { return };
    let at = usize::from(u16::from_le_bytes(*head)).min(rest.len());
    let (list, pages) = rest.split_at(at);
    let (mut list, mut pages) = (list.to_vec(), pages.to_vec());
    seal_pages(&mut list, &mut pages);
    query_index(with_sections(&small_index().bytes, [&list, &pages]));
}

/// Runs all queries of an index next to the source of [`small_index`]. Windows that are read have
/// the indexed values.
pub fn query_index(file: Vec<u8>) {
    static EXPECTED: OnceLock<Vec<u8>> = OnceLock::new();
    let index = small_index();
    let Ok(tree) = index.open(file) else { return };
    let all = spinney::Bounds::of_extent(tree.header().extent);
    let mut cells = vec![0; all.volume() as usize * tree.header().form.width()];
    let read = tree.window(tree.depth(), &all, 0.0, &mut cells, None);
    let expected = EXPECTED.get_or_init(|| {
        let tree = index.open(index.bytes.clone()).unwrap();
        let mut cells = vec![0; all.volume() as usize];
        tree.window(tree.depth(), &all, 0.0, &mut cells, None).unwrap();
        cells
    });
    assert!(read.is_err() || cells == *expected, "other values than were indexed");
    trees::query_tree(&tree);
}
