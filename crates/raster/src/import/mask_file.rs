//! Mask files, GDAL's `.msk` next to a raster: TIFF files of the same size whose samples are 0
//! where a pixel is VOID.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::{Pixels, Raster, RasterInfo, RasterOptions, SourceWindows, tiff};
use spinney_base::io::sibling_path;
use spinney_base::space::Region;
use spinney_base::{Error, Result};

/// A raster with the mask of another file.
struct Masked {
    raster: Box<dyn Raster>,
    /// Shared with other rasters of the same file.
    mask: Arc<Mutex<Box<dyn Raster>>>,
    flags: Pixels,
}

/// The mask file of a raster: `a.tif.msk` for `a.tif`.
pub(super) fn mask_of(raster: &Path) -> PathBuf {
    sibling_path(raster, |path| {
        let mut name = path.as_os_str().to_owned();
        name.push(".msk");
        name.into()
    })
}

/// Adds the mask file, which exists, to a raster. A mask inside the raster's own file takes
/// precedence, as in GDAL.
///
/// # Errors
/// If the mask file cannot be read, or has another size than the raster.
pub(super) fn masked(raster: Box<dyn Raster>, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let path = mask_of(raster.path());
    // The mask file belongs to the first page.
    if options.page.is_some_and(|page| page > 0) {
        return Ok(raster);
    }
    let options = RasterOptions { layer: None, page: None, directory: None, ..options.clone() };
    let mask = tiff::open(options.access.input(&path)?, &path, &options)?;
    let (info, found) = (raster.info(), mask.info());
    if (info.width, info.height) != (found.width, found.height) {
        let size = format!("{} x {} pixels", found.width, found.height);
        let expected = format!(
            "the size of its raster, {} x {} (to read it without the mask, move the mask file away)",
            info.width, info.height
        );
        return Err(Error::corrupt(&path, "mask file", size, expected));
    }
    Ok(Box::new(Masked { raster, mask: Arc::new(Mutex::new(mask)), flags: Pixels::default() }))
}

impl Raster for Masked {
    fn info(&self) -> &RasterInfo {
        self.raster.info()
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.raster.read(region, pixels)?;
        if pixels.valid.is_some() || region.is_empty() {
            return Ok(());
        }
        let mut mask = self.mask.lock().expect("no panic while held");
        mask.read(region, &mut self.flags)?;
        let flags = self.flags.bytes.chunks_exact(mask.info().pixel_bytes());
        pixels.valid = Some(flags.map(|flags| flags.iter().any(|flag| *flag != 0)).collect());
        Ok(())
    }

    fn choose(&mut self, channels: &[usize]) -> bool {
        self.raster.choose(channels)
    }

    fn separate_channels(&self, channels: &[usize]) -> Option<Box<dyn Raster>> {
        let raster = self.raster.separate_channels(channels)?;
        Some(Box::new(Masked { raster, mask: Arc::clone(&self.mask), flags: Pixels::default() }))
    }

    fn has_separate_channels(&self) -> bool {
        self.raster.has_separate_channels()
    }

    fn reads_anywhere(&self) -> bool {
        self.raster.reads_anywhere()
    }

    fn source_windows(&self) -> SourceWindows {
        let mask = mask_of(self.path());
        Err(format!("a raster whose mask is in another file ({})", mask.display()))
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        let mut mask = self.mask.lock().expect("no panic while held");
        let taken = self.raster.prefetch(regions)?;
        mask.prefetch(&regions[..taken])
    }
}
