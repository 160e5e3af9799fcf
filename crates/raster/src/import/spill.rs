//! A raster that comes from the top down, put on disk so that it can be read anywhere.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::slabs::BLOCK;
use super::{Order, Pixels, Raster, RasterInfo};
use spinney_base::space::Region;
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::WantedCells;

/// Pixels of a block.
const AREA: u64 = BLOCK * BLOCK;

/// A raster in a temporary file: blocks of 256 x 256 pixels, those at the edges with room for as many.
///
/// Behind the samples of all blocks there may be a byte per pixel that is 1 where it is VOID by a mask.
struct Spilled {
    file: File,
    folder: PathBuf,
    raster: Box<dyn Raster>,
    info: RasterInfo,
    has_mask: bool,
    /// Rows of one block on their way from or to the file.
    buffer: Vec<u8>,
}

/// Reads a whole raster, band by band, into an unnamed temporary file in a folder; the result can be read
/// anywhere.
///
/// About `memory` bytes are used for a band, whose height is chosen by it.
///
/// # Errors
/// If the raster cannot be read or the file not be written, or on interruption.
pub fn spill(
    raster: Box<dyn Raster>,
    folder: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Box<dyn Raster>> {
    spill_wanted(raster, None, folder, memory, progress)
}

/// [`spill`] of what is wanted of a raster: of blocks of which nothing is, the file has nothing, and where any region can be read they
/// are not read.
pub(super) fn spill_wanted(
    raster: Box<dyn Raster>,
    wanted: Option<WantedCells>,
    folder: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Box<dyn Raster>> {
    let info = RasterInfo { order: Order::Anywhere, ..raster.info().clone() };
    let file = tempfile::tempfile_in(folder).map_err(failed(folder))?;
    let folder = folder.to_path_buf();
    let row = info.width * (info.pixel_bytes() as u64 + 1);
    let mut rows = BLOCK;
    while rows > 1 && rows * row > memory {
        rows /= 2;
    }
    let mut spilled = Spilled { file, folder, raster, info, has_mask: false, buffer: Vec::new() };
    // What is never written, such as a mask's part without VOID, reads as zeros.
    let all_pixels = spilled.mask() / spilled.info.pixel_bytes() as u64;
    spilled.file.set_len(spilled.mask() + all_pixels).map_err(failed(&spilled.folder))?;
    let (mut pixels, anywhere) = (Pixels::default(), spilled.raster.reads_anywhere());
    let [width, height] = [spilled.info.width, spilled.info.height];
    // Columns of which something is wanted in a row of blocks.
    let columns = |row: u64| {
        let Some(wanted) = wanted else { return Some((0, width)) };
        let mut blocks = (0..width.div_ceil(BLOCK))
            .filter(|column| wanted.touches([column * BLOCK, row * BLOCK, 0], BLOCK));
        let first = blocks.next()?;
        Some((first * BLOCK, ((blocks.next_back().unwrap_or(first) + 1) * BLOCK).min(width)))
    };
    let end = (0..height.div_ceil(BLOCK)).rev().find(|row| columns(*row).is_some());
    let end = end.map_or(0, |row| ((row + 1) * BLOCK).min(height));
    for y in (0..end).step_by(rows as usize) {
        progress.check()?;
        let mut band = Region::new(0, y, width, rows.min(height - y));
        match columns(y / BLOCK) {
            Some((left, right)) if anywhere => (band.x, band.width) = (left, right - left),
            None if anywhere => continue,
            _ => {}
        }
        spilled.raster.read(band, &mut pixels)?;
        spilled.write(band, wanted, &pixels).map_err(failed(&spilled.folder))?;
    }
    Ok(Box::new(spilled))
}

fn failed(folder: &Path) -> impl FnOnce(io::Error) -> Error {
    Error::io(folder, "use a temporary file for the picture")
}

/// A range of bytes of each row; rows have `row` bytes.
fn columns(bytes: &[u8], row: usize, columns: std::ops::Range<usize>) -> impl Iterator<Item = &[u8]> {
    bytes.chunks_exact(row).map(move |row| &row[columns.clone()])
}

impl Spilled {
    fn blocks_across(&self) -> u64 {
        self.info.width.div_ceil(BLOCK)
    }

    /// Offset of the mask in the file.
    fn mask(&self) -> u64 {
        self.blocks_across() * self.info.height.div_ceil(BLOCK) * AREA * self.info.pixel_bytes() as u64
    }

    /// The blocks that a region touches: what they have of it, and where that part's first whole row is in
    /// the file, in pixels. Rows of a block are always as long as a block.
    fn parts(&self, region: Region) -> impl Iterator<Item = (Region, u64)> + use<> {
        let across = self.blocks_across();
        let columns = region.x / BLOCK..region.right().div_ceil(BLOCK);
        let rows = region.y / BLOCK..region.bottom().div_ceil(BLOCK);
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y))).map(move |(x, y)| {
            let part = Region::new(x * BLOCK, y * BLOCK, BLOCK, BLOCK).intersect(&region);
            (part, (y * across + x) * AREA + (part.y - y * BLOCK) * BLOCK)
        })
    }

    /// Writes what is wanted of a band, which must not reach over edges of rows of blocks, and begins at one of a column.
    fn write(&mut self, band: Region, wanted: Option<WantedCells>, pixels: &Pixels) -> io::Result<()> {
        let size = self.info.pixel_bytes();
        let void: Option<Vec<u8>> =
            pixels.valid.as_ref().map(|valid| valid.iter().map(|valid| u8::from(!valid)).collect());
        self.has_mask |= void.is_some();
        for (part, first) in self.parts(band) {
            let block = [part.x, part.y / BLOCK * BLOCK, 0];
            if wanted.is_some_and(|wanted| !wanted.touches(block, BLOCK)) {
                continue;
            }
            self.write_part((0, first), (band, part), &pixels.bytes, size)?;
            if let Some(void) = &void {
                self.write_part((self.mask(), first), (band, part), void, 1)?;
            }
        }
        Ok(())
    }

    fn write_part(
        &mut self,
        (start, first): (u64, u64),
        (band, part): (Region, Region),
        bytes: &[u8],
        size: usize,
    ) -> io::Result<()> {
        self.buffer.clear();
        let from = (part.x - band.x) as usize * size..(part.right() - band.x) as usize * size;
        for row in columns(bytes, band.width as usize * size, from) {
            self.buffer.extend_from_slice(row);
            self.buffer.resize(self.buffer.len().next_multiple_of(BLOCK as usize * size), 0);
        }
        self.file.seek(SeekFrom::Start(start + first * size as u64))?;
        self.file.write_all(&self.buffer)
    }

    /// Reads what is `size` bytes per pixel and starts at `start` in the file.
    fn read_all(&mut self, start: u64, region: Region, out: &mut [u8], size: usize) -> io::Result<()> {
        for (part, first) in self.parts(region) {
            // A block's rows are read whole: that is one piece of the file.
            let row = BLOCK as usize * size;
            self.buffer.resize(part.height as usize * row, 0);
            self.file.seek(SeekFrom::Start(start + first * size as u64))?;
            self.file.read_exact(&mut self.buffer)?;
            let left = (part.x % BLOCK) as usize * size;
            let width = part.width as usize * size;
            let to = (part.x - region.x) as usize * size;
            let rows = out.chunks_exact_mut(region.width as usize * size).skip((part.y - region.y) as usize);
            for (from, out) in columns(&self.buffer, row, left..left + width).zip(rows) {
                out[to..to + width].copy_from_slice(from);
            }
        }
        Ok(())
    }
}

impl Raster for Spilled {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let size = self.info.pixel_bytes();
        pixels.bytes.resize(region.area() as usize * size, 0);
        self.read_all(0, region, &mut pixels.bytes, size).map_err(failed(&self.folder))?;
        pixels.valid = None;
        if self.has_mask {
            let mut void = vec![0; region.area() as usize];
            self.read_all(self.mask(), region, &mut void, 1).map_err(failed(&self.folder))?;
            pixels.valid = void.contains(&1).then(|| void.iter().map(|void| *void == 0).collect());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake::Fake;
    use super::*;
    use spinney_base::space::{Code, CodeRun, Dimension};
    use spinney_base::value::SampleType;

    #[test]
    fn any_region_comes_back() {
        let (width, height) = (700, 520);
        let info = RasterInfo::plain([width, height], SampleType::I16, 1);
        let bytes: Vec<u8> = (0..width * height * 2).map(|i| (i * i / 7) as u8).collect();
        // The mask has gaps only far down, so that the first bands come without any.
        let valid: Vec<bool> = (0..width * height).map(|i| i < 500 * width || i % 3 > 0).collect();
        let folder = tempfile::tempdir().unwrap();
        for (memory, mask) in [(0, None), (30_000, Some(&valid)), (1 << 30, Some(&valid))] {
            let fake = |order| {
                let fake = Fake::new(RasterInfo { order, ..info.clone() }, bytes.clone());
                match mask {
                    Some(valid) => fake.with_mask(valid.clone()),
                    None => fake,
                }
            };
            let (source, mut direct) = (fake(Order::Bands), fake(Order::Anywhere));
            let mut spilled = spill(Box::new(source), folder.path(), memory, &()).unwrap();
            assert_eq!(spilled.info().order, Order::Anywhere);
            let (mut found, mut expected) = (Pixels::default(), Pixels::default());
            for region in [[0, 0, width, height], [256, 256, 256, 256], [699, 519, 1, 1], [200, 490, 400, 30]]
            {
                let [x, y, width, height] = region;
                let region = Region::new(x, y, width, height);
                spilled.read(region, &mut found).unwrap();
                direct.read(region, &mut expected).unwrap();
                expected.valid = expected.valid.filter(|valid| valid.contains(&false));
                assert!(found == expected, "{region:?}");
            }
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_is_wanted_comes_back() {
        let info = RasterInfo::plain([1000, 700], SampleType::U8, 1);
        let bytes: Vec<u8> = (0..700_000u64).map(|i| (i * i / 7) as u8).collect();
        let folder = tempfile::tempdir().unwrap();
        let root = Code::root(Dimension::Quad);
        // The blocks at 256, 256 and from 512, 0 to 767, 511.
        let run = CodeRun::of(root.child(0).child(3), root.child(1).child(2)).unwrap();
        for order in [Order::Bands, Order::Anywhere] {
            let fake = Fake::new(RasterInfo { order, ..info.clone() }, bytes.clone());
            let wanted = Some(WantedCells { dimension: Dimension::Quad, depth: 10, run });
            let mut spilled = spill_wanted(Box::new(fake), wanted, folder.path(), 100_000, &()).unwrap();
            let mut direct = Fake::new(RasterInfo { order: Order::Anywhere, ..info.clone() }, bytes.clone());
            let (mut found, mut expected) = (Pixels::default(), Pixels::default());
            for (x, y) in [(256, 256), (512, 0), (512, 256), (768, 0)] {
                let region = Region::new(x, y, BLOCK.min(1000 - x), BLOCK);
                spilled.read(region, &mut found).unwrap();
                direct.read(region, &mut expected).unwrap();
                assert!(found == expected, "{region:?}");
            }
            spilled.read(Region::new(0, 512, 256, 100), &mut found).unwrap();
            assert!(found.bytes.iter().all(|byte| *byte == 0), "nobody has asked for it");
        }
    }
}
