//! The beginning of a cloud-optimized GeoTIFF: GDAL's description of the layout, the directories,
//! and space for the tile tables. The offsets of these are known before the first tile is encoded.

use crate::image::ImageSpec;
use crate::image::tiff::{descriptive_tags, mask_tags, sample_tags};
use crate::image::tiff_coding::Coding;
use crate::image::tiff_tags::{self, IfdField, WordWidth, directory, value_place, word};
use spinney_chunks::spec::{new_subfile_type, tag};

/// A level of the tree in tiles, in row-major order from the upper left.
pub(super) struct LevelTiles {
    pub(super) level: u8,
    pub(super) width: u64,
    pub(super) height: u64,
    /// Columns and rows of a tile.
    pub(super) side: u64,
}

impl LevelTiles {
    pub(super) fn cells(&self) -> u64 {
        self.width * self.height
    }

    /// Tiles per row.
    fn across(&self) -> u64 {
        self.width.div_ceil(self.side)
    }

    pub(super) fn count(&self) -> u64 {
        self.across() * self.height.div_ceil(self.side)
    }

    /// First column and row of a tile.
    pub(super) fn corner(&self, number: u64) -> [u64; 2] {
        [number % self.across(), number / self.across()].map(|index| index * self.side)
    }

    /// Number of cells of a tile inside the raster.
    pub(super) fn cells_of(&self, number: u64) -> u64 {
        let [column, row] = self.corner(number);
        (self.width - column).min(self.side) * (self.height - row).min(self.side)
    }
}

/// Set of the stored tiles of a level, one bit per tile.
pub(super) struct StoredTiles<'a> {
    level: &'a LevelTiles,
    bits: Vec<u64>,
}

impl StoredTiles<'_> {
    pub(super) fn new(level: &LevelTiles) -> StoredTiles<'_> {
        StoredTiles { level, bits: vec![0; level.count().div_ceil(64) as usize] }
    }

    pub(super) fn insert(&mut self, number: u64) {
        self.bits[(number / 64) as usize] |= 1 << (number % 64);
    }

    /// Whether the set has the parent of a tile of the next deeper level.
    pub(super) fn is_above(&self, level: &LevelTiles, number: u64) -> bool {
        let [column, row] = level.corner(number).map(|cell| cell / (2 * level.side));
        let above = row * self.level.across() + column;
        self.bits[(above / 64) as usize] >> (above % 64) & 1 == 1
    }
}

/// File offsets of the two tile tables of an image.
#[derive(Clone, Copy)]
pub(super) struct Table {
    pub(super) offsets: u64,
    pub(super) lengths: u64,
}

/// Tables of a level's image and of its mask.
pub(super) struct Tables {
    pub(super) cells: Table,
    pub(super) mask: Option<Table>,
}

/// The beginning of the file.
pub(super) struct FileStart {
    pub(super) big: bool,
    pub(super) bytes: Vec<u8>,
    /// End of the tile tables, which follow the directories: offset of the first tile.
    pub(super) end: u64,
    pub(super) tables: Vec<Tables>,
}

/// Lays out the beginning of the file: a directory per level and mask, from the deepest level up.
pub(super) fn lay_out(
    spec: &ImageSpec,
    coding: &Coding,
    levels: &[LevelTiles],
    side: u32,
    has_masks: bool,
    big: bool,
) -> FileStart {
    let mut bytes = tiff_tags::header(big).0.to_vec();
    bytes.extend(ghost(has_masks).bytes());
    // Validators expect the first directory at the first even offset.
    bytes.resize(bytes.len().next_multiple_of(2), 0);
    let first = word(bytes.len() as u64, big);
    let place = tiff_tags::header(big).1 as usize;
    bytes[place..place + first.len()].copy_from_slice(&first);
    let mut directories = Vec::new();
    for (above, level) in levels.iter().enumerate() {
        let mut tags = sample_tags(spec, coding);
        if above == 0 {
            tags.extend(descriptive_tags(spec, true));
        }
        let kind = if above > 0 { new_subfile_type::REDUCED_RESOLUTION } else { 0 };
        directories.push(Directory::new(level, side, tags, kind));
        if has_masks {
            let kind = kind | new_subfile_type::TRANSPARENCY_MASK;
            directories.push(Directory::new(level, side, mask_tags(), kind));
        }
    }
    // Lengths of directories do not depend on offsets.
    let lengths: Vec<u64> =
        directories.iter().map(|one| directory(one.tags(big, 0, 0), 0, 0, big).len() as u64).collect();
    let mut tables_at = (bytes.len() as u64 + lengths.iter().sum::<u64>()).next_multiple_of(8);
    let mut table_positions = Vec::new();
    for (index, one) in directories.iter().enumerate() {
        let at = bytes.len() as u64;
        let next = if index + 1 < directories.len() { at + lengths[index] } else { 0 };
        let offsets_at = tables_at;
        tables_at += (one.tiles * offset_width(big) as u64).next_multiple_of(8);
        let lengths_at = tables_at;
        tables_at += (one.tiles * WordWidth::Four as u64).next_multiple_of(8);
        let tags = one.tags(big, offsets_at, lengths_at);
        // Tables that fit are in the directory itself.
        let place = |number: u16, width: WordWidth, outside: u64| {
            let fits = one.tiles * width as u64 <= offset_width(big) as u64;
            if fits { value_place(&tags, number, at, big) } else { outside }
        };
        table_positions.push(Table {
            offsets: place(tag::TILE_OFFSETS, offset_width(big), offsets_at),
            lengths: place(tag::TILE_BYTE_COUNTS, WordWidth::Four, lengths_at),
        });
        bytes.extend(directory(tags, at, next, big));
    }
    let of_level = |tables: &[Table]| Tables { cells: tables[0], mask: tables.get(1).copied() };
    let tables = table_positions.chunks(if has_masks { 2 } else { 1 }).map(of_level).collect();
    FileStart { big, bytes, end: tables_at, tables }
}

/// Text after the header by which GDAL's readers recognize the layout.
fn ghost(has_masks: bool) -> String {
    // The blank leaves space for a YES instead of the NO, for programs that edit the file.
    let mut text = "LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\n\
                    BLOCK_TRAILER=LAST_4_BYTES_REPEATED\nKNOWN_INCOMPATIBLE_EDITION=NO\n "
        .to_string();
    if has_masks {
        text += "MASK_INTERLEAVED_WITH_IMAGERY=YES\n";
    }
    format!("GDAL_STRUCTURAL_METADATA_SIZE={:06} bytes\n{text}", text.len())
}

fn offset_width(big: bool) -> WordWidth {
    if big { WordWidth::Eight } else { WordWidth::Four }
}

/// A directory without its tile tables.
struct Directory {
    tags: Vec<(u16, IfdField)>,
    tiles: u64,
}

impl Directory {
    fn new(level: &LevelTiles, side: u32, mut tags: Vec<(u16, IfdField)>, kind: u64) -> Directory {
        use IfdField::Long;
        if kind != 0 {
            tags.push((tag::NEW_SUBFILE_TYPE, Long(vec![kind as u32])));
        }
        tags.extend([
            (tag::IMAGE_WIDTH, Long(vec![level.width as u32])),
            (tag::IMAGE_LENGTH, Long(vec![level.height as u32])),
            (tag::TILE_WIDTH, Long(vec![side])),
            (tag::TILE_LENGTH, Long(vec![side])),
        ]);
        Directory { tags, tiles: level.count() }
    }

    /// All tags, with tables at these offsets.
    fn tags(&self, big: bool, offsets_at: u64, lengths_at: u64) -> Vec<(u16, IfdField)> {
        let later = |width, at| IfdField::Later { width, count: self.tiles, at };
        let mut tags = self.tags.clone();
        tags.push((tag::TILE_OFFSETS, later(offset_width(big), offsets_at)));
        tags.push((tag::TILE_BYTE_COUNTS, later(WordWidth::Four, lengths_at)));
        tags
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_text_declares_its_own_size() {
        for (has_masks, size) in [(false, 140), (true, 174)] {
            let text = ghost(has_masks);
            assert!(text.starts_with(&format!("GDAL_STRUCTURAL_METADATA_SIZE=000{size} bytes\n")), "{text}");
            assert_eq!(text.len(), 43 + size);
        }
    }

    #[test]
    fn tiles_are_numbered_row_by_row() {
        let level = LevelTiles { level: 9, width: 300, height: 129, side: 128 };
        assert_eq!(level.count(), 6);
        assert_eq!(level.corner(5), [256, 128]);
        let cells: Vec<u64> = (0..6).map(|number| level.cells_of(number)).collect();
        assert_eq!(cells, [128 * 128, 128 * 128, 44 * 128, 128, 128, 44]);
    }
}
