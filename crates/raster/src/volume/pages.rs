//! Volumes in the pages of TIFF files: each is a plane.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::npy::Array;
use crate::import::{Pixels, Raster, RasterInfo, RasterOptions, SampleFormat, open, page_directories};
use spinney_base::space::Region;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Error, Progress, Result};

/// Rows that are read at once, if memory allows.
const ROWS: u64 = 256;

/// The pages of a file, which are alike.
pub(super) struct Pages {
    path: PathBuf,
    /// Offsets of their directories.
    directories: Vec<u64>,
    /// What is known of the first, which holds for all but for their words.
    pub(super) info: RasterInfo,
    /// Values as trees have them.
    pub(super) value: ValueType,
    memory: u64,
}

impl Pages {
    /// Reads the headers of all pages, with as much memory as may be used for one.
    pub(super) fn open(path: &Path, memory: u64) -> Result<Pages> {
        let directories = page_directories(path, memory)?;
        let mut pages = Pages {
            path: path.into(),
            directories,
            info: page(path, 0, None, memory)?.info().clone(),
            value: ValueType::new(SampleType::U8, 1),
            memory,
        };
        let about = |info: &RasterInfo| {
            format!(
                "{} x {} pixels of {} channels of {}",
                info.width, info.height, info.channels, info.stored_sample
            )
        };
        let first = about(&pages.info);
        for (number, directory) in pages.directories.iter().enumerate() {
            let found = about(page(path, number, Some(*directory), memory)?.info());
            if found != first {
                let found = format!("page {number} of {found}, the first of {first},");
                return Err(Error::unsupported(
                    path,
                    found,
                    "pages of a volume are alike; say --pages layers, or a number",
                ));
            }
        }
        let channels = u8::try_from(pages.info.channels).unwrap_or(u8::MAX);
        pages.value = ValueType::new(pages.info.sample, channels);
        if !pages.value.is_supported() {
            let found = format!("{} bands of {} as one value", pages.info.channels, pages.info.sample.name());
            return Err(Error::unsupported(path, found, "say --pages layers for a layer of each"));
        }
        if pages.info.alpha.is_some() {
            return Err(pages.with_mask("opacity"));
        }
        Ok(pages)
    }

    fn with_mask(&self, what: &str) -> Error {
        Error::unsupported(
            &self.path,
            format!("pages with {what} as a volume"),
            "say --pages layers for a layer of each",
        )
    }

    /// Cells along each axis.
    pub(super) fn size(&self) -> [u64; 3] {
        [self.info.width, self.info.height, self.directories.len() as u64]
    }

    /// The samples in a temporary file in a folder, one page after the other, where blocks of many pages are read at once.
    pub(super) fn spill(self, folder: &Path, progress: &dyn Progress) -> Result<Array> {
        let failed = |error| Error::io(folder, "use a temporary file for the volume")(error);
        let mut out = BufWriter::new(tempfile::tempfile_in(folder).map_err(failed)?);
        let [width, height, _] = self.size();
        let row = (width * self.value.size() as u64).max(1);
        let rows = (self.memory / 2 / row).clamp(1, ROWS);
        let mut pixels = Pixels::default();
        for (number, directory) in self.directories.iter().enumerate() {
            let mut raster = page(&self.path, number, Some(*directory), self.memory)?;
            for y in (0..height).step_by(rows as usize) {
                progress.check()?;
                raster.read(Region::new(0, y, width, rows.min(height - y)), &mut pixels)?;
                if pixels.valid.as_ref().is_some_and(|valid| valid.contains(&false)) {
                    return Err(self.with_mask("masks"));
                }
                out.write_all(&pixels.bytes).map_err(failed)?;
            }
        }
        let file = out.into_inner().map_err(|error| failed(error.into_error()))?;
        let format = match self.info.sample {
            SampleType::U8 => SampleFormat::Uint(8),
            SampleType::U16 => SampleFormat::Uint(16),
            SampleType::U32 => SampleFormat::Uint(32),
            SampleType::I16 => SampleFormat::Int(16),
            SampleType::I32 => SampleFormat::Int(32),
            SampleType::F32 => SampleFormat::Float(32),
            SampleType::F64 => SampleFormat::Float(64),
            SampleType::I8 => SampleFormat::Int(8),
            SampleType::U64 => SampleFormat::Uint(64),
            SampleType::I64 => SampleFormat::Int(64),
        };
        Ok(Array::of_samples(self.path.clone(), file, self.size(), self.value, format))
    }
}

/// A page of a file.
fn page(path: &Path, number: usize, directory: Option<u64>, memory: u64) -> Result<Box<dyn Raster>> {
    open(path, &RasterOptions { memory, page: Some(number), directory, ..RasterOptions::default() })
}
