//! A raster in memory, for tests.

use std::path::{Path, PathBuf};

use super::{Order, Pixels, Raster, RasterInfo};
use spinney_base::Result;
use spinney_base::space::Region;

/// A raster in memory that enforces its declared order.
pub(super) struct Fake {
    info: RasterInfo,
    bytes: Vec<u8>,
    valid: Option<Vec<bool>>,
    next_row: u64,
}

impl Fake {
    pub(super) fn new(info: RasterInfo, bytes: Vec<u8>) -> Fake {
        Fake { info, bytes, valid: None, next_row: 0 }
    }

    pub(super) fn with_mask(self, valid: Vec<bool>) -> Fake {
        Fake { valid: Some(valid), ..self }
    }
}

impl Raster for Fake {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        static PATH: std::sync::LazyLock<PathBuf> = std::sync::LazyLock::new(|| "fake".into());
        &PATH
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        if self.info.order == Order::Bands {
            assert_eq!((region.x, region.width, region.y), (0, self.info.width, self.next_row));
            self.next_row = region.bottom();
        }
        let rows = (region.y..region.bottom()).map(|y| {
            let start = (y * self.info.width + region.x) as usize;
            start..start + region.width as usize
        });
        let size = self.info.pixel_bytes();
        let bytes = |row: std::ops::Range<usize>| &self.bytes[row.start * size..row.end * size];
        pixels.bytes = rows.clone().flat_map(bytes).copied().collect();
        pixels.valid = self.valid.as_ref().map(|valid| rows.flat_map(|row| &valid[row]).copied().collect());
        Ok(())
    }
}
