//! Volumes as stacks of images: each plane is a file or a page of a TIFF file.

use std::path::{Path, PathBuf};

use super::array::{Array, ArrayLayout};
use super::section_names::{missing_numbers, sort_by_numbers};
use super::spill::BoxSpill;
use crate::import::{Pixels, Raster, RasterInfo, RasterOptions, SampleFormat, open, page_directories};
use spinney_base::space::{Bounds, Region};
use spinney_base::value::SampleType;
use spinney_base::{Error, Progress, Result};

/// Maximum number of rows read at once, if memory allows.
const ROWS: u64 = 256;

/// File name extensions of images in a directory of sections.
pub(super) const ENDINGS: [&str; 17] = [
    "bmp", "exr", "gif", "hdr", "jpeg", "jpg", "pam", "pbm", "pgm", "png", "pnm", "ppm", "qoi", "tga", "tif",
    "tiff", "webp",
];

/// A plane: a file and, in files of several pages, number and directory offset of the page.
struct Section {
    file: usize,
    page: Option<(usize, u64)>,
}

/// Images of the same size and type, stacked along z.
pub(super) struct Sections {
    pub(super) files: Vec<PathBuf>,
    sections: Vec<Section>,
    /// Number of other files in directories of sections.
    pub(super) others: u64,
    /// Report on missing numbers in the file names.
    pub(super) missing: Option<String>,
    /// Description of the first image. It holds for all, except for names and other strings.
    pub(super) info: RasterInfo,
    pub(super) layout: ArrayLayout,
    /// Options to open images, with the memory budget for one image.
    options: RasterOptions,
}

impl Sections {
    /// Reads the headers of all images.
    pub(super) fn open(inputs: &[PathBuf], options: RasterOptions) -> Result<Sections> {
        let (files, others) = image_files(inputs)?;
        let mut sections: Vec<Section> = Vec::new();
        let mut first: Option<(RasterInfo, String)> = None;
        for (file, path) in files.iter().enumerate() {
            let info = section(path, None, &options)?.info().clone();
            let pages = if info.pages > 1 { page_directories(path, &options)? } else { Vec::new() };
            let start = sections.len();
            match pages.is_empty() {
                true => sections.push(Section { file, page: None }),
                false => sections
                    .extend(pages.into_iter().enumerate().map(|page| Section { file, page: Some(page) })),
            }
            for Section { page, .. } in &sections[start..] {
                let info = match page {
                    Some(_) => section(path, *page, &options)?.info().clone(),
                    None => info.clone(),
                };
                let found = about(&info);
                let Some((_, expected)) = &first else {
                    first = Some((info, found));
                    continue;
                };
                if found != *expected {
                    return Err(unlike(path, (*page).filter(|_| file == 0), (found, expected), &files[0]));
                }
            }
        }
        let Some((info, _)) = first else {
            return Err(Error::invalid("sections", "none", "at least one image"));
        };
        let path = &files[0];
        let channels = u8::try_from(info.channels).unwrap_or(u8::MAX);
        let size = [info.width, info.height, sections.len() as u64];
        let layout = ArrayLayout { size, format: stored_format(info.sample), channels, is_big_endian: false };
        if !layout.value().is_supported() {
            let found = format!("a value of {} bands of type {}", info.channels, info.sample.name());
            return Err(Error::unsupported(
                path,
                found,
                "use --pages layers for a layer of each page, or --stack for a layer of each file",
            ));
        }
        if info.alpha.is_some() {
            return Err(with_mask(path, "opacity"));
        }
        let missing = missing_numbers(&files);
        Ok(Sections { files, sections, others, missing, info, layout, options })
    }

    /// Writes the samples of a box to a temporary file in a directory, plane by plane, so that
    /// cubes across many planes can be read. Planes outside of the box are not read; of others only
    /// the box is read, if the format allows it.
    pub(super) fn spill(self, cells: Bounds, directory: &Path, progress: &dyn Progress) -> Result<Array> {
        let mut out = BoxSpill::new(self.layout, cells, directory)?;
        if let Some(report) = &self.missing {
            progress.warn(self.files[0].parent().unwrap_or(&self.files[0]), report);
        }
        let [width, height, _] = self.layout.size;
        let cell = self.layout.cell() as u64;
        let rows = (self.options.memory / 2 / (width * cell).max(1)).clamp(1, ROWS);
        let mut pixels = Pixels::default();
        for (Section { file, page }, z) in self.sections.iter().zip(0..) {
            if !(cells.min[2]..cells.max[2]).contains(&z) {
                continue;
            }
            let path = &self.files[*file];
            let mut raster = section(path, *page, &self.options)?;
            if about(raster.info()) != about(&self.info) {
                return Err(Error::corrupt(path, "the whole file", about(raster.info()), about(&self.info)));
            }
            if let Some(remark) = &raster.info().remark {
                progress.warn(path, remark);
            }
            let ([left, top, _], [right, bottom, _]) = match raster.reads_anywhere() {
                true => (cells.min, cells.max),
                false => ([0; 3], [width, cells.max[1], 0]),
            };
            for y in (top..bottom).step_by(rows as usize) {
                progress.check()?;
                let region = Region::new(left, y, right - left, rows.min(bottom - y));
                raster.read(region, &mut pixels)?;
                if pixels.valid.as_ref().is_some_and(|valid| valid.contains(&false)) {
                    return Err(with_mask(path, "masks"));
                }
                let row = (region.width * cell) as usize;
                for (y, row) in (y..).zip(pixels.bytes.chunks_exact(row)) {
                    out.write(((z * height + y) * width + left) * cell, row)?;
                }
            }
        }
        out.finish(&self.files[0])
    }
}

/// Describes the properties that sections share.
fn about(info: &RasterInfo) -> String {
    format!("{} x {} pixels of {} channels of {}", info.width, info.height, info.channels, info.stored_sample)
}

/// The error that a section differs from the first one.
fn unlike(path: &Path, page: Option<(usize, u64)>, (found, expected): (String, &str), first: &Path) -> Error {
    match page {
        Some((number, _)) => {
            let found = format!("a volume whose page {number} has {found}, and the first {expected},");
            Error::unsupported(
                path,
                found,
                "pages of a volume must be alike; use --pages layers, or a page number",
            )
        }
        None => {
            let found = format!("a section of {found} in a volume with {} of {expected},", first.display());
            Error::unsupported(
                path,
                found,
                "sections of a volume must be alike: omit this one, or convert it to the size and type of the others",
            )
        }
    }
}

fn with_mask(path: &Path, what: &str) -> Error {
    let found = format!("a section of a volume with {what}");
    Error::unsupported(
        path,
        found,
        "use --pages layers for a layer of each page, or --stack for a layer of each file",
    )
}

/// Opens an image, or a page of it.
fn section(path: &Path, page: Option<(usize, u64)>, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let (page, directory) = page.unzip();
    open(path, &RasterOptions { page, directory, ..options.clone() })
}

/// Format of samples after decoding.
fn stored_format(sample: SampleType) -> SampleFormat {
    match sample {
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
    }
}

/// Lists the images, and counts the other files in directories. Images of a directory are sorted by
/// the numbers in their names, with signs, decimals and units of length. Files that are given in
/// alphabetical order, as by a shell pattern, are sorted in the same way, so that `z2` comes before
/// `z10`. Any other given order is kept.
pub(super) fn image_files(inputs: &[PathBuf]) -> Result<(Vec<PathBuf>, u64)> {
    let (mut files, mut others) = (Vec::new(), 0);
    for input in inputs {
        if !input.is_dir() {
            files.push(input.clone());
            continue;
        }
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(input).map_err(Error::io(input, "list its files"))? {
            let path = entry.map_err(Error::io(input, "list its files"))?.path();
            let is_dotfile = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
            let is_image = ending.is_some_and(|ending| ENDINGS.contains(&&*ending));
            match is_image && !is_dotfile && path.is_file() {
                true => inside.push(path),
                false => others += u64::from(!is_dotfile),
            }
        }
        if inside.is_empty() {
            let advice = format!("sections are images with these extensions: .{}", ENDINGS.join(", ."));
            return Err(Error::unsupported(input, "a directory without images", advice));
        }
        sort_by_numbers(&mut inside);
        files.extend(inside);
    }
    if files.is_sorted() {
        sort_by_numbers(&mut files);
    }
    Ok((files, others))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chosen_orders_are_kept() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let files = |names: &[&str]| image_files(&paths(names)).unwrap().0;
        assert_eq!(files(&["z1.png", "z10.png", "z2.png"]), paths(&["z1.png", "z2.png", "z10.png"]));
        assert_eq!(files(&["z+5", "z-10", "z-5", "z0"]), paths(&["z-10", "z-5", "z0", "z+5"]));
        assert_eq!(files(&["z3", "z2", "z1"]), paths(&["z3", "z2", "z1"]));
    }
}
