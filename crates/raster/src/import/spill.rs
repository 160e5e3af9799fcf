//! Temporary copy of a raster on disk, for random access or for access to some of its channels.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::slabs::BLOCK;
use super::{Order, Pixels, Raster, RasterInfo};
use spinney_base::space::{CodeRange, Dimension, Region};
use spinney_base::{Error, Progress, Result};
use spinney_engine::store::{SlabBoxes, WantedCells, depth_for};

/// Cells per side of the squares that are read from randomly accessible rasters, if memory allows.
const SIDE: u64 = 1024;

/// A temporary file of samples, one group of channels after the other, each in blocks of 256 x 256
/// pixels. Blocks at the right and lower edges are padded to that size, except in smaller rasters.
///
/// The samples may be followed by one byte per pixel, 1 where a mask makes it VOID.
struct SpillFile {
    file: Mutex<File>,
    directory: PathBuf,
    size: [u64; 2],
    /// File offset of the mask.
    mask: u64,
    has_mask: bool,
}

/// Groups of a raster's channels in a temporary file.
pub(super) struct SpilledChannels {
    file: Arc<SpillFile>,
    path: PathBuf,
    info: RasterInfo,
    /// The channels of each group, and the file offset of their samples.
    groups: Vec<(Vec<usize>, u64)>,
}

/// A group of channels in a temporary file.
struct Spilled {
    file: Arc<SpillFile>,
    /// File offset of the samples.
    start: u64,
    path: PathBuf,
    info: RasterInfo,
    /// Read buffer for rows of one block.
    buffer: Vec<u8>,
}

/// Copies a whole raster band by band into an unnamed temporary file in a directory. The result
/// allows random access.
///
/// Uses about `memory` bytes per band, which determines the band's height.
///
/// # Errors
/// If the raster cannot be read, the file cannot be written, or on cancellation.
pub fn spill(
    raster: Box<dyn Raster>,
    directory: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Box<dyn Raster>> {
    spill_wanted(raster, None, directory, memory, progress)
}

/// Like [`spill`], but only for the wanted cells. Blocks without wanted cells are not written, and
/// not read if the raster allows random access.
pub(super) fn spill_wanted(
    raster: Box<dyn Raster>,
    wanted: Option<WantedCells>,
    directory: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Box<dyn Raster>> {
    let all = (0..raster.info().channels).collect();
    Ok(spill_channels(raster, vec![all], wanted, directory, memory, progress)?.group(0))
}

/// Copies a raster once into a temporary file with separate groups of channels: see
/// [`spill_wanted`].
///
/// # Errors
/// Those of [`spill`].
pub(super) fn spill_channels(
    mut raster: Box<dyn Raster>,
    groups: Vec<Vec<usize>>,
    wanted: Option<WantedCells>,
    directory: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<SpilledChannels> {
    let info = RasterInfo { order: Order::Anywhere, ..raster.info().clone() };
    let file = tempfile::tempfile_in(directory).map_err(failed(directory))?;
    let mut spilled = SpillFile {
        file: Mutex::new(file),
        directory: directory.into(),
        size: [info.width, info.height],
        mask: 0,
        has_mask: false,
    };
    let (pixels, sample) = (spilled.pixels(), info.sample.size());
    let mut start = 0;
    let groups: Vec<(Vec<usize>, u64)> = groups
        .into_iter()
        .map(|channels| {
            let first = start;
            start += pixels * (channels.len() * sample) as u64;
            (channels, first)
        })
        .collect();
    spilled.mask = start;
    // Unwritten ranges read as zeros, such as those of a mask without VOID.
    let file = spilled.file.get_mut().expect("no panic while held");
    file.set_len(start + pixels).map_err(failed(directory))?;
    let (mut part, mut buffer) = (Pixels::default(), Vec::new());
    for region in regions(&*raster, wanted, memory) {
        progress.check()?;
        raster.read(region, &mut part)?;
        spilled.write(region, (wanted, &groups), &info, &part, &mut buffer).map_err(failed(directory))?;
    }
    let path = raster.path().to_path_buf();
    Ok(SpilledChannels { file: Arc::new(spilled), path, info, groups })
}

/// Regions that cover the wanted cells of a raster, each pixel once, in a cheap order. The samples
/// of a region take at most about `memory` bytes, if possible.
fn regions(raster: &dyn Raster, wanted: Option<WantedCells>, memory: u64) -> Vec<Region> {
    let info = raster.info();
    let [width, height] = [info.width, info.height];
    // A validity flag per pixel may be added to the samples.
    let pixel = info.pixel_bytes() as u64 + 1;
    let mut regions = Vec::new();
    if info.order == Order::Anywhere {
        let extent = [width, height, 1];
        let all = WantedCells { dimension: Dimension::Quad, depth: depth_for(extent), run: CodeRange::ALL };
        let mut side = SIDE;
        while side > BLOCK && side * side * pixel > memory {
            side /= 2;
        }
        for ([x, y, _], [width, height, _]) in SlabBoxes::new(extent, wanted.unwrap_or(all), side) {
            divide(Region::new(x, y, width, height), pixel, memory, &mut regions);
        }
        return regions;
    }
    // The range of columns with wanted cells in a row of blocks.
    let columns = |row: u64| {
        let Some(wanted) = wanted else { return Some((0, width)) };
        let mut blocks = (0..width.div_ceil(BLOCK))
            .filter(|column| wanted.touches([column * BLOCK, row * BLOCK, 0], BLOCK));
        let first = blocks.next()?;
        Some((first * BLOCK, ((blocks.next_back().unwrap_or(first) + 1) * BLOCK).min(width)))
    };
    let wanted: Vec<_> = (0..height.div_ceil(BLOCK)).map(columns).collect();
    let end = wanted.iter().rposition(Option::is_some).map_or(0, |row| row + 1);
    for (y, columns) in (0..height).step_by(BLOCK as usize).zip(&wanted[..end]) {
        let rows = BLOCK.min(height - y);
        match columns {
            Some((left, right)) if raster.reads_anywhere() => {
                divide(Region::new(*left, y, right - left, rows), pixel, memory, &mut regions);
            }
            None if raster.reads_anywhere() => {}
            _ => {
                let few = (memory / (width * pixel)).clamp(1, rows);
                let starts = (y..y + rows).step_by(few as usize);
                regions.extend(starts.map(|top| Region::new(0, top, width, few.min(y + rows - top))));
            }
        }
    }
    regions
}

/// Divides a region so that the pixels of each fragment take at most `memory` bytes, if possible:
/// first into rows, then along these.
fn divide(region: Region, pixel: u64, memory: u64, regions: &mut Vec<Region>) {
    let pixels = (memory / pixel).max(1);
    let width = region.width.min(pixels);
    let height = (pixels / width).clamp(1, region.height);
    for y in (region.y..region.bottom()).step_by(height as usize) {
        for x in (region.x..region.right()).step_by(width as usize) {
            regions.push(Region::new(x, y, width, height).intersect(&region));
        }
    }
}

fn failed(directory: &Path) -> impl FnOnce(io::Error) -> Error {
    Error::io(directory, "use a temporary file for the image")
}

/// A range of bytes of each row; rows have `row` bytes.
fn columns(bytes: &[u8], row: usize, columns: std::ops::Range<usize>) -> impl Iterator<Item = &[u8]> {
    bytes.chunks_exact(row).map(move |row| &row[columns.clone()])
}

impl SpilledChannels {
    /// The raster of a group of channels, by its index.
    pub(super) fn group(&self, number: usize) -> Box<dyn Raster> {
        let (channels, start) = &self.groups[number];
        // All groups have the common type of the channels.
        let info = RasterInfo { sample: self.info.sample, ..self.info.of_channels(channels) };
        let (file, path) = (Arc::clone(&self.file), self.path.clone());
        Box::new(Spilled { file, start: *start, path, info, buffer: Vec::new() })
    }
}

impl SpillFile {
    /// Columns and rows of a block.
    fn block(&self) -> [u64; 2] {
        self.size.map(|side| side.clamp(1, BLOCK))
    }

    /// Pixels of all blocks, with padding.
    fn pixels(&self) -> u64 {
        let [width, height] = self.block();
        self.size.map(|side| side.div_ceil(BLOCK)).iter().product::<u64>() * width * height
    }

    /// The blocks that a region intersects: the intersection, and the file offset in pixels of the
    /// block's row where it begins. Block rows always have the full block width.
    fn parts(&self, region: Region) -> impl Iterator<Item = (Region, u64)> + use<> {
        let (across, [width, height]) = (self.size[0].div_ceil(BLOCK), self.block());
        let columns = region.x / BLOCK..region.right().div_ceil(BLOCK);
        let rows = region.y / BLOCK..region.bottom().div_ceil(BLOCK);
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y))).map(move |(x, y)| {
            let part = Region::new(x * BLOCK, y * BLOCK, BLOCK, BLOCK).intersect(&region);
            (part, (y * across + x) * width * height + (part.y - y * BLOCK) * width)
        })
    }

    /// Writes the wanted pixels of a region, group by group. The region must begin and end at block
    /// edges in each row, or the file must have the row already.
    fn write(
        &mut self,
        region: Region,
        (wanted, groups): (Option<WantedCells>, &[(Vec<usize>, u64)]),
        info: &RasterInfo,
        pixels: &Pixels,
        buffer: &mut Vec<u8>,
    ) -> io::Result<()> {
        let (size, all) = (info.sample.size(), info.pixel_bytes());
        let void: Option<Vec<u8>> =
            pixels.valid.as_ref().map(|valid| valid.iter().map(|valid| u8::from(!valid)).collect());
        self.has_mask |= void.is_some();
        for (part, first) in self.parts(region) {
            let block = [part.x / BLOCK * BLOCK, part.y / BLOCK * BLOCK, 0];
            if wanted.is_some_and(|wanted| !wanted.touches(block, BLOCK)) {
                continue;
            }
            for (channels, start) in groups {
                let pixel = channels.len() * size;
                let is_all = channels.iter().copied().eq(0..info.channels);
                let to = (*start, first, pixel);
                self.write_part(to, (region, part), (&pixels.bytes, all), buffer, |row, buffer| {
                    if is_all {
                        buffer.extend_from_slice(row);
                        return;
                    }
                    for samples in row.chunks_exact(all) {
                        for channel in channels {
                            buffer.extend_from_slice(&samples[channel * size..][..size]);
                        }
                    }
                })?;
            }
            if let Some(void) = &void {
                let to = (self.mask, first, 1);
                self.write_part(to, (region, part), (void, 1), buffer, |row, buffer| {
                    buffer.extend_from_slice(row);
                })?;
            }
        }
        Ok(())
    }

    /// Writes the intersection of a region with a block. `start` is the file offset of samples with
    /// `size` bytes per pixel, and `first` the index of the first pixel there.
    fn write_part(
        &mut self,
        (start, first, size): (u64, u64, usize),
        (region, part): (Region, Region),
        (bytes, pixel): (&[u8], usize),
        buffer: &mut Vec<u8>,
        append: impl Fn(&[u8], &mut Vec<u8>),
    ) -> io::Result<()> {
        let block = self.block()[0];
        let left = part.x % BLOCK;
        let is_whole = left == 0 && (part.width == block || part.right() == self.size[0]);
        let from = (part.x - region.x) as usize * pixel..(part.right() - region.x) as usize * pixel;
        let rows = columns(bytes, region.width as usize * pixel, from);
        let rows = rows.skip((part.y - region.y) as usize).take(part.height as usize);
        let file = self.file.get_mut().expect("no panic while held");
        buffer.clear();
        for (row, number) in rows.zip(0..) {
            append(row, buffer);
            if is_whole {
                buffer.resize(buffer.len().next_multiple_of(block as usize * size), 0);
            } else {
                file.seek(SeekFrom::Start(start + (first + number * block + left) * size as u64))?;
                file.write_all(buffer)?;
                buffer.clear();
            }
        }
        file.seek(SeekFrom::Start(start + first * size as u64))?;
        file.write_all(buffer)
    }

    /// Reads a region of data with `size` bytes per pixel that begin at `start` in the file.
    fn read_all(
        &self,
        start: u64,
        region: Region,
        out: &mut [u8],
        size: usize,
        buffer: &mut Vec<u8>,
    ) -> io::Result<()> {
        let mut file = self.file.lock().expect("no panic while held");
        for (part, first) in self.parts(region) {
            // Whole rows of a block are read, since they are contiguous in the file.
            let row = self.block()[0] as usize * size;
            buffer.resize(part.height as usize * row, 0);
            file.seek(SeekFrom::Start(start + first * size as u64))?;
            file.read_exact(buffer)?;
            let left = (part.x % BLOCK) as usize * size;
            let width = part.width as usize * size;
            let to = (part.x - region.x) as usize * size;
            let rows = out.chunks_exact_mut(region.width as usize * size).skip((part.y - region.y) as usize);
            for (from, out) in columns(buffer, row, left..left + width).zip(rows) {
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
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let (file, buffer, size) = (&self.file, &mut self.buffer, self.info.pixel_bytes());
        let failed = || failed(&file.directory);
        pixels.bytes.resize(region.area() as usize * size, 0);
        file.read_all(self.start, region, &mut pixels.bytes, size, buffer).map_err(failed())?;
        pixels.valid = None;
        if file.has_mask {
            let mut void = vec![0; region.area() as usize];
            file.read_all(file.mask, region, &mut void, 1, buffer).map_err(failed())?;
            pixels.valid = void.contains(&1).then(|| void.iter().map(|void| *void == 0).collect());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake::Fake;
    use super::*;
    use spinney_base::space::{Code, CodeRange, Dimension};
    use spinney_base::value::SampleType;

    #[test]
    fn spilled_regions_equal_the_input() {
        let (width, height) = (700, 520);
        let info = RasterInfo::plain([width, height], SampleType::I16, 1);
        let bytes: Vec<u8> = (0..width * height * 2).map(|i| (i * i / 7) as u8).collect();
        // The mask has gaps only far down, so the first bands have none.
        let valid: Vec<bool> = (0..width * height).map(|i| i < 500 * width || i % 3 > 0).collect();
        let directory = tempfile::tempdir().unwrap();
        for (memory, mask) in [(0, None), (30_000, Some(&valid)), (1 << 30, Some(&valid))] {
            let fake = |order| {
                let fake = Fake::new(RasterInfo { order, ..info.clone() }, bytes.clone());
                match mask {
                    Some(valid) => fake.with_mask(valid.clone()),
                    None => fake,
                }
            };
            let (source, mut direct) = (fake(Order::Bands), fake(Order::Anywhere));
            let mut spilled = spill(Box::new(source), directory.path(), memory, &()).unwrap();
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
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
    }

    #[test]
    fn spilled_wanted_cells_equal_the_input() {
        let info = RasterInfo::plain([1000, 700], SampleType::U8, 1);
        let bytes: Vec<u8> = (0..700_000u64).map(|i| (i * i / 7) as u8).collect();
        let directory = tempfile::tempdir().unwrap();
        let root = Code::root(Dimension::Quad);
        // The blocks at 256, 256 and from 512, 0 to 767, 511.
        let run = CodeRange::of(root.child(0).child(3), root.child(1).child(2)).unwrap();
        for order in [Order::Bands, Order::Anywhere] {
            let fake = Fake::new(RasterInfo { order, ..info.clone() }, bytes.clone());
            let wanted = Some(WantedCells { dimension: Dimension::Quad, depth: 10, run });
            let mut spilled = spill_wanted(Box::new(fake), wanted, directory.path(), 100_000, &()).unwrap();
            let mut direct = Fake::new(RasterInfo { order: Order::Anywhere, ..info.clone() }, bytes.clone());
            let (mut found, mut expected) = (Pixels::default(), Pixels::default());
            for (x, y) in [(256, 256), (512, 0), (512, 256), (768, 0)] {
                let region = Region::new(x, y, BLOCK.min(1000 - x), BLOCK);
                spilled.read(region, &mut found).unwrap();
                direct.read(region, &mut expected).unwrap();
                assert!(found == expected, "{region:?}");
            }
            spilled.read(Region::new(0, 512, 256, 100), &mut found).unwrap();
            assert!(found.bytes.iter().all(|byte| *byte == 0), "these cells were not requested");
        }
    }

    #[test]
    fn channels_are_spilled_separately_in_one_pass() {
        let (width, height, channels) = (600, 300, 5);
        let info = RasterInfo::plain([width, height], SampleType::I16, channels);
        let bytes: Vec<u8> = (0..width * height * channels as u64 * 2).map(|i| (i * i / 7) as u8).collect();
        let valid: Vec<bool> = (0..width * height).map(|i| i % 1000 > 0).collect();
        let directory = tempfile::tempdir().unwrap();
        let groups = [vec![3], vec![4, 0], vec![1, 2, 3]];
        for memory in [0, 1000, 100_000, 1 << 30] {
            for order in [Order::Bands, Order::Anywhere] {
                let fake = |order| {
                    let info = RasterInfo { order, ..info.clone() };
                    Fake::new(info, bytes.clone()).with_mask(valid.clone())
                };
                let spilled = spill_channels(
                    Box::new(fake(order)),
                    groups.to_vec(),
                    None,
                    directory.path(),
                    memory,
                    &(),
                );
                let spilled = spilled.unwrap();
                let read = regions(&fake(order), None, memory);
                assert_eq!(read.iter().map(Region::area).sum::<u64>(), width * height, "{memory}");
                for (number, chosen) in groups.iter().enumerate() {
                    let mut group = spilled.group(number);
                    let mut direct =
                        super::super::bands::select_channels(Box::new(fake(Order::Anywhere)), chosen);
                    let (mut found, mut expected) = (Pixels::default(), Pixels::default());
                    for [x, y, width, height] in
                        [[0, 0, width, height], [250, 200, 100, 100], [599, 299, 1, 1]]
                    {
                        let region = Region::new(x, y, width, height);
                        group.read(region, &mut found).unwrap();
                        direct.read(region, &mut expected).unwrap();
                        expected.valid = expected.valid.filter(|valid| valid.contains(&false));
                        assert!(found == expected, "{memory} {order:?} {chosen:?} {region:?}");
                    }
                }
            }
        }
    }
}
