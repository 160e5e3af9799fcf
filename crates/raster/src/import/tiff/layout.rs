//! Division of an image into chunks (strips or tiles), and their locations in the file.

use super::ifd::{Directory, Input};
use spinney_base::Result;
use spinney_base::sort;
use spinney_base::space::Region;
use spinney_chunks::spec::tag;

/// Uncompressed strips may be of any size, so they are read in chunks of about this many bytes.
const CHUNK_BYTES: u64 = 1 << 20;

/// The grid of chunks of an image.
pub(super) struct ChunkLayout {
    pub(super) width: u64,
    pub(super) height: u64,
    /// Columns and rows of a chunk; tiles may exceed the image's edges.
    pub(super) chunk_width: u64,
    pub(super) chunk_height: u64,
    pub(super) tiled: bool,
    /// Number of planes with chunks of their own: 1, or the samples per pixel.
    pub(super) planes: u64,
    /// Chunks per strip; 1 unless strips are uncompressed and large.
    chunks_per_strip: u64,
    chunk_bytes: u64,
    offsets: Vec<u64>,
    counts: Option<Vec<u64>>,
    /// Whether several chunks share the same bytes.
    pub(super) repeats: bool,
}

/// Plane, column and row of a chunk.
pub(super) type ChunkPosition = (u64, u64, u64);

/// Location of a chunk's bytes in the file.
pub(super) enum ChunkLocation {
    /// Offset, and length if the file has it.
    At(u64, Option<u64>),
    /// No location: the chunk was never written.
    Hole,
}

impl ChunkLayout {
    /// Reads the size and the chunk tables. `row_bits` returns the bits of a number of pixels in a
    /// row of one plane.
    pub(super) fn read(
        input: &Input,
        directory: &Directory<'_>,
        planes: u64,
        raw: bool,
        row_bits: impl Fn(u64) -> u64,
    ) -> Result<ChunkLayout> {
        let size = |tag: u16, name: &str| -> Result<u64> {
            match directory.number(tag)? {
                Some(n @ 1..=0x7fff_ffff) => Ok(n),
                n => {
                    let found = n.map_or("nothing".into(), |n| n.to_string());
                    Err(input.corrupt(format!("tag {tag} ({name})"), found, "1 to 2147483647"))
                }
            }
        };
        let (width, height) =
            (size(tag::IMAGE_WIDTH, "image width")?, size(tag::IMAGE_LENGTH, "image length")?);
        let tiled = directory.has(tag::TILE_WIDTH);
        let (chunk_width, rows) = if tiled {
            (size(tag::TILE_WIDTH, "tile width")?, size(tag::TILE_LENGTH, "tile length")?)
        } else {
            let rows = directory.number(tag::ROWS_PER_STRIP)?.unwrap_or(height).min(height);
            if rows == 0 {
                let place = format!("tag {} (rows per strip)", tag::ROWS_PER_STRIP);
                return Err(input.corrupt(place, "0", "at least 1"));
            }
            (width, rows)
        };
        // Some writers store the tables of tiles in the tags for strips.
        let table = |tile: u16, strip: u16| if tiled && directory.has(tile) { tile } else { strip };
        let Some(offsets) = directory.numbers(table(tag::TILE_OFFSETS, tag::STRIP_OFFSETS))? else {
            let expected = format!("tag {} or {}", tag::STRIP_OFFSETS, tag::TILE_OFFSETS);
            return Err(input.corrupt("directory", "no chunk offsets", expected));
        };
        let counts = directory.numbers(table(tag::TILE_BYTE_COUNTS, tag::STRIP_BYTE_COUNTS))?;
        // Old writers omitted the length of a single strip.
        let counts = counts.filter(|counts| offsets.len() > 1 || offsets == [0] || counts != &[0]);

        let row_bytes = row_bits(chunk_width).div_ceil(8);
        let chunk_height = if raw && !tiled { chunk_rows(rows, row_bytes, rows == height) } else { rows };
        let layout = ChunkLayout {
            width,
            height,
            chunk_width,
            chunk_height,
            tiled,
            planes,
            chunks_per_strip: rows.div_ceil(chunk_height),
            chunk_bytes: row_bytes.saturating_mul(chunk_height),
            repeats: repeats(&offsets),
            offsets,
            counts,
        };
        let strips = layout.across() * height.div_ceil(rows);
        let chunks = strips.saturating_mul(planes);
        let tables = [("offsets", Some(&layout.offsets)), ("byte counts", layout.counts.as_ref())];
        for (name, table) in tables {
            if let Some(table) = table.filter(|table| (table.len() as u64) < chunks) {
                return Err(input.corrupt(
                    format!("table of chunk {name}"),
                    format!("{} {name}", table.len()),
                    format!("{chunks}, for {width}x{height} pixels"),
                ));
            }
        }
        Ok(layout)
    }

    /// Chunks per row.
    pub(super) fn across(&self) -> u64 {
        self.width.div_ceil(self.chunk_width)
    }

    /// Chunks per column.
    fn down(&self) -> u64 {
        self.height.div_ceil(self.chunk_height)
    }

    /// The pixels of a chunk inside the image.
    pub(super) fn region(&self, across: u64, down: u64) -> Region {
        let (x, y) = (across * self.chunk_width, down * self.chunk_height);
        Region::new(x, y, self.chunk_width.min(self.width - x), self.chunk_height.min(self.height - y))
    }

    /// Number of chunks.
    pub(super) fn count(&self) -> u64 {
        (self.across() * self.down()).saturating_mul(self.planes)
    }

    /// All chunks, in the order of their numbers.
    pub(super) fn chunks(&self) -> impl Iterator<Item = ChunkPosition> {
        let (across, down) = (self.across(), self.down());
        let rows = (0..self.planes).flat_map(move |plane| (0..down).map(move |row| (plane, row)));
        rows.flat_map(move |(plane, row)| (0..across).map(move |column| (plane, column, row)))
    }

    /// Number of a chunk: row by row, plane by plane.
    pub(super) fn number(&self, plane: u64, across: u64, down: u64) -> u64 {
        (plane * self.down() + down) * self.across() + across
    }

    /// Location of a chunk in the file.
    pub(super) fn location(&self, plane: u64, across: u64, down: u64) -> ChunkLocation {
        let strips_down = if self.chunks_per_strip == 1 {
            self.down()
        } else {
            self.down().div_ceil(self.chunks_per_strip)
        };
        let strip = (plane * strips_down + down / self.chunks_per_strip) * self.across() + across;
        let offset = self.offsets[strip as usize];
        let count = self.counts.as_ref().map(|counts| counts[strip as usize]);
        if count == Some(0) || offset == 0 && count.is_none() {
            return ChunkLocation::Hole;
        }
        let skip = (down % self.chunks_per_strip).saturating_mul(self.chunk_bytes);
        ChunkLocation::At(offset.saturating_add(skip), count.map(|count| count.saturating_sub(skip)))
    }

    /// Describes the chunk in messages.
    pub(super) fn name(&self, plane: u64, across: u64, down: u64) -> String {
        let kind = if self.tiled { "tile" } else { "strip" };
        let region = self.region(across, down);
        let plane = if self.planes > 1 { format!(" of plane {plane}") } else { String::new() };
        format!("{kind} at column {}, row {}{plane}", region.x, region.y)
    }
}

/// Whether an offset is repeated, except for 0, which means that there is no chunk.
fn repeats(offsets: &[u64]) -> bool {
    // The usual case: offsets increase.
    if offsets.windows(2).all(|pair| pair[0] < pair[1]) {
        return false;
    }
    let mut sorted: Vec<u64> = offsets.iter().copied().filter(|offset| *offset != 0).collect();
    sort::numbers64(&mut sorted);
    sorted.windows(2).any(|pair| pair[0] == pair[1])
}

/// Rows to read at once from strips of `rows` rows. They divide strips evenly, unless there is only
/// one.
fn chunk_rows(rows: u64, row_bytes: u64, single: bool) -> u64 {
    let limit = (CHUNK_BYTES / row_bytes.max(1)).max(1);
    match limit {
        _ if rows <= limit => rows,
        _ if single => limit,
        _ => (1..=limit).rev().find(|candidate| rows.is_multiple_of(*candidate)).unwrap_or(1),
    }
}
