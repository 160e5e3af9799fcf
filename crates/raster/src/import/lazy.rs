//! Rasters whose files are open only while they are read, so that there can be any number of them.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use super::bands::select_channels;
use super::{Order, Pixels, Raster, RasterInfo, RasterOptions, SourceWindows, open};
use crate::index::SourceWindow;
use spinney_base::space::Region;
use spinney_base::{Error, Result};

/// Maximum number of open files of a pool.
pub(super) const MAX_POOL: usize = 64;
/// Maximum number of open files that can only be read from the top down, in addition to a pool's
/// limit. Reopening one of them means to read all rows above.
const MAX_SEQUENTIAL: usize = 128;
/// Rows of such files that are skipped at once.
const SKIPPED: u64 = 64;

/// The most recently read files, which are kept open.
pub(super) struct Pool {
    /// Maximum number of files that can be read anywhere.
    files: usize,
    /// Limit of the bytes that open files that can be read anywhere may hold.
    memory: u64,
    next: AtomicU64,
    /// The least recently used come first.
    open: Mutex<VecDeque<(u64, OpenRaster)>>,
}

/// An open file, and its next row if rows must be read in sequence.
struct OpenRaster {
    raster: Box<dyn Raster>,
    next_row: u64,
    /// Maximum number of bytes that its reader holds.
    held: u64,
}

impl Pool {
    /// A pool of at most `files` files that together hold at most `memory` bytes, or of one.
    pub(super) fn new(files: usize, memory: u64) -> Arc<Pool> {
        Arc::new(Pool { files, memory, next: AtomicU64::new(0), open: Mutex::default() })
    }

    fn take(&self, id: u64) -> Option<OpenRaster> {
        let mut open = self.open.lock().expect("no panic while held");
        let place = open.iter().position(|(other, _)| *other == id)?;
        open.remove(place).map(|(_, opened)| opened)
    }

    fn put(&self, id: u64, opened: OpenRaster) {
        let sequential = !opened.raster.reads_anywhere();
        let (files, memory) = if sequential { (MAX_SEQUENTIAL, u64::MAX) } else { (self.files, self.memory) };
        let mut open = self.open.lock().expect("no panic while held");
        open.push_back((id, opened));
        let alike = |(_, other): &(u64, OpenRaster)| other.raster.reads_anywhere() != sequential;
        let mut gone = Vec::new();
        loop {
            let (count, held) = open
                .iter()
                .filter(|other| alike(other))
                .fold((0, 0), |(count, held), other| (count + 1, other.1.held.saturating_add(held)));
            if count <= files && (held <= memory || count == 1) {
                break;
            }
            let oldest = open.iter().position(alike);
            gone.extend(oldest.and_then(|oldest| open.remove(oldest)));
        }
        // Closing a file may involve other pools, so release this one's lock first.
        drop(open);
        drop(gone);
    }
}

/// A raster whose file is opened on demand.
pub(super) struct Lazy {
    path: PathBuf,
    options: RasterOptions,
    /// The selected channels; `None` means all.
    chosen: Option<Vec<usize>>,
    info: RasterInfo,
    /// The windows of files with all channels.
    windows: SourceWindows,
    /// Whether any region can be read at any time. Otherwise rows are skipped, or read from the top
    /// again.
    anywhere: bool,
    pool: Arc<Pool>,
    id: u64,
}

impl Lazy {
    /// Opens a file to read its header, and closes it again.
    ///
    /// # Errors
    /// Those of [`open`].
    pub(super) fn open(path: &Path, options: &RasterOptions, pool: &Arc<Pool>) -> Result<Lazy> {
        let raster = open(path, options)?;
        Ok(Lazy {
            path: path.to_path_buf(),
            options: options.clone(),
            chosen: None,
            info: raster.info().clone(),
            windows: raster.source_windows(),
            anywhere: raster.reads_anywhere(),
            pool: Arc::clone(pool),
            id: pool.next.fetch_add(1, Ordering::Relaxed),
        })
    }

    /// The file, and the options to open it.
    pub(super) fn opened_as(&self) -> (&Path, RasterOptions) {
        (
            &self.path,
            RasterOptions { nesting: self.options.nesting.with_fresh_budget(), ..self.options.clone() },
        )
    }

    /// Another reader of the same file.
    pub(super) fn another(&self) -> Lazy {
        Lazy {
            path: self.path.clone(),
            options: self.options.clone(),
            chosen: self.chosen.clone(),
            info: self.info.clone(),
            windows: self.windows.clone(),
            anywhere: self.anywhere,
            pool: Arc::clone(&self.pool),
            id: self.pool.next.fetch_add(1, Ordering::Relaxed),
        }
    }

    /// Takes the open file from the pool, or opens it again.
    fn take_open(&self) -> Result<OpenRaster> {
        match self.pool.take(self.id) {
            Some(opened) => Ok(opened),
            None => self.reopen(),
        }
    }

    fn reopen(&self) -> Result<OpenRaster> {
        let nesting = self.options.nesting.with_fresh_budget();
        let mut raster = open(&self.path, &RasterOptions { nesting, ..self.options.clone() })?;
        if let Some(chosen) = &self.chosen {
            if chosen.iter().any(|channel| *channel >= raster.info().channels) {
                return Err(self.changed());
            }
            raster = select_channels(raster, chosen);
        }
        let about = |info: &RasterInfo| (info.width, info.height, info.sample, info.channels, info.alpha);
        if about(raster.info()) != about(&self.info) || raster.reads_anywhere() != self.anywhere {
            return Err(self.changed());
        }
        let held =
            self.options.memory.min(self.info.width * self.info.height * self.info.pixel_bytes() as u64);
        Ok(OpenRaster { raster, next_row: 0, held })
    }

    fn changed(&self) -> Error {
        Error::Changed { path: self.path.clone(), what: "was overwritten" }
    }

    /// Reads a region, also of a raster that can only be read from the top down.
    fn read_from(&self, opened: &mut OpenRaster, region: Region, pixels: &mut Pixels) -> Result<()> {
        if self.anywhere {
            return opened.raster.read(region, pixels);
        }
        if opened.next_row > region.y {
            *opened = self.reopen()?;
        }
        let width = self.info.width;
        while opened.next_row < region.y {
            let skipped = Region::new(0, opened.next_row, width, SKIPPED.min(region.y - opened.next_row));
            opened.raster.read(skipped, pixels)?;
            opened.next_row = skipped.bottom();
        }
        opened.raster.read(Region::new(0, region.y, width, region.height), pixels)?;
        opened.next_row = region.bottom();
        if region.width < width {
            let (from, to) = (region.x as usize, region.right() as usize);
            let size = self.info.pixel_bytes();
            let rows = pixels.bytes.chunks_exact(width as usize * size);
            pixels.bytes = rows.flat_map(|row| &row[from * size..to * size]).copied().collect();
            let flags = pixels.valid.take();
            pixels.valid = flags.map(|flags| {
                flags.chunks_exact(width as usize).flat_map(|row| &row[from..to]).copied().collect()
            });
        }
        Ok(())
    }
}

impl Raster for Lazy {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        if region.is_empty() {
            *pixels = Pixels::default();
            return Ok(());
        }
        let mut opened = self.take_open()?;
        self.read_from(&mut opened, region, pixels)?;
        // A raster that was read to its end is usually not needed again.
        if self.info.order == Order::Anywhere || region.bottom() < self.info.height {
            self.pool.put(self.id, opened);
        }
        Ok(())
    }

    fn choose(&mut self, channels: &[usize]) -> bool {
        let all: Vec<usize> = (0..self.info.channels).collect();
        let old = self.chosen.as_ref().unwrap_or(&all);
        let chosen = channels.iter().map(|channel| old[*channel]).collect();
        self.chosen = Some(chosen);
        self.info = self.info.of_channels(channels);
        self.pool.take(self.id);
        true
    }

    fn reads_anywhere(&self) -> bool {
        true
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        if !self.anywhere {
            return Ok(regions.len());
        }
        let mut opened = self.take_open()?;
        let taken = opened.raster.prefetch(regions)?;
        self.pool.put(self.id, opened);
        Ok(taken)
    }

    fn forget_properties(&mut self) {
        self.info.forget();
    }

    fn source_windows(&self) -> SourceWindows {
        let Some(chosen) = &self.chosen else { return self.windows.clone() };
        let Ok(windows) = &self.windows else {
            // Some bands of a virtual raster may have windows, even if others have not.
            return self.reopen().map_err(|error| error.to_string())?.raster.source_windows();
        };
        let chosen = |window: &SourceWindow| SourceWindow {
            channels: chosen.iter().map(|channel| window.channels[*channel]).collect(),
            ..window.clone()
        };
        Ok(windows.iter().map(chosen).collect())
    }
}

impl Drop for Lazy {
    fn drop(&mut self) {
        self.pool.take(self.id);
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::BufWriter;

    use super::*;

    fn grey_png(path: &Path, width: u32, height: u32, first: u8) {
        let mut encoder = png::Encoder::new(BufWriter::new(File::create(path).unwrap()), width, height);
        encoder.set_color(png::ColorType::Grayscale);
        let pixels: Vec<u8> =
            (0..width * height).map(|i| (i as u8).wrapping_mul(7).wrapping_add(first)).collect();
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    }

    #[test]
    fn rows_from_the_top_are_read_in_any_order() {
        let directory = tempfile::tempdir().unwrap();
        let (width, height) = (9, 300);
        let pool = Pool::new(2, u64::MAX);
        let mut lazies: Vec<Lazy> = (0..4)
            .map(|number| {
                let path = directory.path().join(format!("{number}.png"));
                grey_png(&path, width, height, number);
                Lazy::open(&path, &RasterOptions::default(), &pool).unwrap()
            })
            .collect();
        let mut pixels = Pixels::default();
        for (x, y, w, h) in
            [(0, 0, 9, 5), (2, 7, 3, 100), (1, 3, 8, 1), (0, 299, 9, 1), (5, 0, 4, 300), (0, 1, 1, 1)]
        {
            for (number, lazy) in (0..).zip(&mut lazies) {
                lazy.read(Region::new(x, y, w, h), &mut pixels).unwrap();
                let at = (y..y + h).flat_map(|y| (x..x + w).map(move |x| y * u64::from(width) + x));
                let expected: Vec<u8> = at.map(|i| (i as u8).wrapping_mul(7).wrapping_add(number)).collect();
                assert!(pixels.bytes == expected, "{number}: {x} {y} {w} {h}");
            }
        }
    }

    #[test]
    fn changed_files_are_detected() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        grey_png(&path, 5, 5, 0);
        let mut lazy = Lazy::open(&path, &RasterOptions::default(), &Pool::new(1, u64::MAX)).unwrap();
        grey_png(&path, 5, 6, 0);
        let read = lazy.read(Region::new(0, 0, 5, 5), &mut Pixels::default());
        assert!(matches!(read, Err(Error::Changed { .. })));
    }
}
