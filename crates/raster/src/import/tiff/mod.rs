//! TIFF and GeoTIFF files of any layout, read in parallel chunk by chunk.

mod cache;
mod geokeys;
mod ifd;
mod image;
mod layout;
mod pages;
mod record;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use self::geokeys::Georeferencing;
use self::ifd::{Directory, Input};
use self::image::Image;
use super::validity::sample_bytes;
use super::{Order, Pixels, Raster, RasterInfo, RasterOptions, SourceWindows, gdal};
use crate::index::{RecordedSource, SourceWindow};
use spinney_base::io::{FileStat, InputFile};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, Palette};
use spinney_base::{Error, Result};
use spinney_chunks::Colour;
pub(crate) use spinney_chunks::SampleFormat;
use spinney_chunks::spec::extra_samples::{ASSOCIATED_ALPHA, UNASSOCIATED_ALPHA};
use spinney_chunks::spec::{new_subfile_type, photometric, tag};
use spinney_references::PixelRule;

/// Opens one page of a TIFF file.
pub(crate) fn open(file: InputFile, path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let (input, first) = Input::new(file, path, options)?;
    if options.layer.is_some() {
        return Err(Error::unsupported(
            path,
            "--layer for a TIFF file",
            "it selects a layer of an OpenEXR file; select a page with --pages, from 0",
        ));
    }
    let (directory, next) = match (options.directory, options.page) {
        (Some(directory), _) => input.directory(directory)?,
        (None, None) => input.directory(first)?,
        (None, Some(page)) => pages::find(&input, first, page)?,
    };
    let mut image = Image::new(&input, &directory)?;
    let mut info = info(&directory, &image)?;
    // Other pages are irrelevant if one was selected.
    if options.page.is_none() {
        info.pages = pages::count(&input, next);
    }
    if let Some(nodata) = info.nodata {
        image.hole = sample_bytes(nodata, info.sample).unwrap_or(image.hole);
    }
    let mut mask = mask(&input, next, &image)?;
    let offset = directory.offset;
    drop(directory);
    let record = match &options.recorder {
        None => None,
        Some(recorder) => {
            [Some(&image), mask.as_ref()]
                .into_iter()
                .flatten()
                .try_for_each(|it| it.check_indexable(&input))?;
            let describe = |stat: FileStat| RecordedSource {
                path: path.to_path_buf(),
                page: options.page.unwrap_or(0) as u32,
                size: [image.layout.width, image.layout.height],
                image: image.record(&input),
                mask: mask.as_ref().map(|mask| mask.record(&input)),
                hole: image.hole.clone(),
                stat,
            };
            let (number, recorded) =
                recorder.record((path, offset), input.stat(&options.access)?, &describe)?;
            image.recorded = Some(recorded.image.chunks.clone());
            if let (Some(mask), Some(recorded)) = (&mut mask, &recorded.mask) {
                mask.recorded = Some(recorded.chunks.clone());
            }
            Some(number)
        }
    };
    let chosen = (0..info.channels).collect();
    Ok(Box::new(Tiff { file: Arc::new(OpenFile { input, image, mask, record }), chosen, info }))
}

/// Offsets of the directories of a file's pages.
pub(crate) fn page_directories(path: &Path, options: &RasterOptions) -> Result<Vec<u64>> {
    let (input, first) = Input::new(options.access.input(path)?, path, options)?;
    pages::directories(&input, first)
}

/// An open file with its chunk tables, shared by rasters of its channels.
struct OpenFile {
    input: Input,
    image: Image,
    mask: Option<Image>,
    /// Number of its record, if it is recorded for an index.
    record: Option<usize>,
}

/// Channels of an open TIFF file.
struct Tiff {
    file: Arc<OpenFile>,
    /// The selected channels of the image, in order.
    chosen: Vec<usize>,
    info: RasterInfo,
}

impl Raster for Tiff {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.file.input.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        if !Region::new(0, 0, self.info.width, self.info.height).contains(&region) {
            return Err(Error::invalid(
                "region",
                format!("{region:?}"),
                format!("a region within {}x{} pixels", self.info.width, self.info.height),
            ));
        }
        self.resize(&mut pixels.bytes, region, self.info.pixel_bytes())?;
        pixels.valid = None;
        if region.is_empty() {
            return Ok(());
        }
        let OpenFile { input, image, mask, .. } = &*self.file;
        image.read(input, region, &self.chosen, &mut pixels.bytes)?;
        if let Some(mask) = mask {
            let mut samples = Vec::new();
            self.resize(&mut samples, region, mask.format.pixel_bytes())?;
            let channels = mask.format.channels();
            let all: Vec<usize> = (0..channels).collect();
            mask.read(input, region, &all, &mut samples)?;
            let flags = samples.chunks_exact(channels);
            pixels.valid = Some(flags.map(|flags| flags.iter().any(|flag| *flag != 0)).collect());
        }
        Ok(())
    }

    fn choose(&mut self, channels: &[usize]) -> bool {
        self.info = self.info.of_channels(channels);
        self.chosen = channels.iter().map(|channel| self.chosen[*channel]).collect();
        true
    }

    fn separate_channels(&self, channels: &[usize]) -> Option<Box<dyn Raster>> {
        let chosen = channels.iter().map(|channel| self.chosen[*channel]).collect();
        let info = self.info.of_channels(channels);
        Some(Box::new(Tiff { file: Arc::clone(&self.file), chosen, info }))
    }

    fn has_separate_channels(&self) -> bool {
        self.file.image.layout.planes > 1
    }

    fn reads_anywhere(&self) -> bool {
        true
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        let OpenFile { input, image, mask, .. } = &*self.file;
        if !input.is_remote() {
            return Ok(regions.len());
        }
        let mut ranges = Vec::new();
        for region in regions {
            image.ranges(*region, &self.chosen, &mut ranges);
            if let Some(mask) = mask {
                mask.ranges(*region, &[0], &mut ranges);
            }
        }
        input.prefetch(&ranges)?;
        Ok(regions.len())
    }

    fn source_windows(&self) -> SourceWindows {
        let cells = Region::new(0, 0, self.info.width, self.info.height);
        let channels = self.chosen.clone();
        let source = self.file.record.ok_or("a file that was not recorded")?;
        Ok(vec![SourceWindow { source, channels, rule: PixelRule::default(), cells, from: [0; 2] }])
    }
}

impl Tiff {
    /// Resizes a buffer for a region, if there is enough memory.
    fn resize(&self, bytes: &mut Vec<u8>, region: Region, pixel: usize) -> Result<()> {
        let needed = region.area().saturating_mul(pixel as u64);
        let length = usize::try_from(needed)
            .ok()
            .filter(|needed| bytes.try_reserve_exact(needed.saturating_sub(bytes.len())).is_ok());
        let length = length.ok_or_else(|| self.file.input.too_large("the requested region", needed))?;
        // Remaining content is overwritten later.
        bytes.resize(length, 0);
        Ok(())
    }
}

/// Finds the mask of an image, in the directories that follow it.
fn mask(input: &Input, next: u64, image: &Image) -> Result<Option<Image>> {
    for directory in input.chain(next) {
        let (directory, _) = directory?;
        // Directories after the next page belong to that page.
        if pages::is_page(&directory) {
            break;
        }
        let is = |tag, value: u64| Ok::<bool, Error>(directory.number(tag)? == Some(value));
        // (An overview's mask has another bit as well.)
        let wanted = is(tag::NEW_SUBFILE_TYPE, new_subfile_type::TRANSPARENCY_MASK)?
            && is(tag::IMAGE_WIDTH, image.layout.width)?
            && is(tag::IMAGE_LENGTH, image.layout.height)?;
        if wanted {
            let mask = Image::new(input, &directory)?;
            return match mask.format.sample_format {
                SampleFormat::Uint(1..=8) => Ok(Some(mask)),
                format => Err(input.unsupported(format!("a mask of {} samples", format.name()))),
            };
        }
    }
    Ok(None)
}

fn info(directory: &Directory<'_>, image: &Image) -> Result<RasterInfo> {
    let Image { layout, format: chunk_format, .. } = image;
    let (sample_format, channels) = (chunk_format.sample_format, chunk_format.channels());
    let nodata =
        directory.text(tag::GDAL_NODATA)?.and_then(|text| gdal::nodata(&text, sample_format.sample()));
    let colours = if channels == 1 { colour_map(directory, sample_format)? } else { None };
    let kind = match (sample_format, image.photometric) {
        _ if colours.is_some() => Some(DataKind::Categorical),
        (SampleFormat::Uint(1), _) => Some(DataKind::Categorical),
        (
            SampleFormat::Uint(2..=8) | SampleFormat::Int(8),
            photometric::WHITE_IS_ZERO
            | photometric::BLACK_IS_ZERO
            | photometric::RGB_PALETTE
            | photometric::TRANSPARENCY_MASK,
        ) => None,
        _ => Some(DataKind::Continuous),
    };
    let mut palette = colours.or_else(|| ramp(image));
    if let (Some(palette), Some(nodata)) = (&mut palette, nodata)
        && nodata >= 0.0.into()
        && let Some(colour) = palette.colours.get_mut(nodata.to_f64() as usize)
    {
        colour[3] = 0;
    }
    let chunks = if layout.tiled {
        format!("{}x{} tiles", layout.chunk_width, layout.chunk_height)
    } else {
        "strips".into()
    };
    let Georeferencing { frame, control_points } = Georeferencing::read(directory)?;
    let format = if frame.is_identity() && frame.crs.is_none() { "TIFF" } else { "GeoTIFF" };
    let mut info = RasterInfo {
        stored_sample: sample_format.name(),
        alpha: alpha(directory, image)?,
        frame,
        nodata,
        palette,
        kind,
        layout: format!("{format}, {chunks}, {}", chunk_format.compression.name()),
        tags: tags(directory)?,
        control_points,
        order: if layout.tiled { Order::Anywhere } else { Order::Bands },
        ..RasterInfo::plain([layout.width, layout.height], sample_format.sample(), channels)
    };
    if image.photometric == photometric::RGB || chunk_format.colour != Colour::Keep {
        info = info.in_colour();
    }
    gdal::apply(&directory.text(tag::GDAL_METADATA)?.unwrap_or_default(), &mut info);
    if directory.has(tag::RPC_COEFFICIENTS) {
        info.remark = Some("rational polynomial coefficients (RPC) are not kept".into());
    }
    Ok(info)
}

/// The index of the opacity channel.
fn alpha(directory: &Directory<'_>, image: &Image) -> Result<Option<usize>> {
    if image.format.colour == Colour::Cmyk {
        return Ok(Some(3));
    }
    let extra = directory.numbers(tag::EXTRA_SAMPLES)?.unwrap_or_default();
    // Extra samples are the last ones of a pixel.
    let index = extra.iter().position(|meaning| matches!(*meaning, ASSOCIATED_ALPHA | UNASSOCIATED_ALPHA));
    Ok(index.and_then(|index| (image.format.channels() + index).checked_sub(extra.len())))
}

/// The palette of a one-channel image, if it has a colour map.
fn colour_map(directory: &Directory<'_>, sample_format: SampleFormat) -> Result<Option<Palette>> {
    let map = match (sample_format, directory.numbers(tag::COLOR_MAP)?) {
        (SampleFormat::Uint(bits @ 1..=16), Some(map)) if map.len() == 3 << bits => map,
        _ => return Ok(None),
    };
    // The map has 16 bits; some writers store 8 bits there, or shift them left.
    let divisor = match map.iter().max() {
        Some(0..=255) => 1,
        _ if map.iter().all(|level| level % 256 == 0) => 256,
        _ => 257,
    };
    let count = map.len() / 3;
    let level = |channel: usize, i: usize| (map[channel * count + i] / divisor) as u8;
    let colours = (0..count).map(|i| [level(0, i), level(1, i), level(2, i), 255]).collect();
    Ok(Some(Palette { colours }))
}

/// A palette of grey levels, where samples alone would be displayed wrong: for bits, and if 0 is
/// white.
fn ramp(image: &Image) -> Option<Palette> {
    let SampleFormat::Uint(bits @ 1..=8) = image.format.sample_format else { return None };
    let white_is_zero = image.photometric == photometric::WHITE_IS_ZERO;
    if image.format.channels() != 1 || !(white_is_zero || bits == 1) {
        return None;
    }
    let last = (1u32 << bits) - 1;
    let level = |i: u32| (if white_is_zero { last - i } else { i } * 255 / last) as u8;
    let colours = (0..=last).map(|i| [level(i), level(i), level(i), 255]).collect();
    Some(Palette { colours })
}

/// Text tags that are kept, by GDAL's names.
fn tags(directory: &Directory<'_>) -> Result<BTreeMap<String, String>> {
    let mut tags = BTreeMap::new();
    for (tag, name) in [
        (tag::DOCUMENT_NAME, "TIFFTAG_DOCUMENTNAME"),
        (tag::IMAGE_DESCRIPTION, "TIFFTAG_IMAGEDESCRIPTION"),
        (tag::SOFTWARE, "TIFFTAG_SOFTWARE"),
        (tag::DATE_TIME, "TIFFTAG_DATETIME"),
        (tag::ARTIST, "TIFFTAG_ARTIST"),
        (tag::HOST_COMPUTER, "TIFFTAG_HOSTCOMPUTER"),
        (tag::COPYRIGHT, "TIFFTAG_COPYRIGHT"),
    ] {
        if let Some(text) = directory.text(tag)?.filter(|text| !text.is_empty()) {
            tags.insert(name.to_string(), text);
        }
    }
    Ok(tags)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;

    /// A file whose tiles of 16 x 16 bytes all have the same offset.
    fn repeated(tiles: u32) -> Vec<u8> {
        let side = tiles * 16;
        let data = 8u32;
        let tags = data + 256;
        let tables = tags + 2 + 9 * 12 + 4;
        let mut bytes = b"II*\0".to_vec();
        bytes.extend(tags.to_le_bytes());
        bytes.extend((0..=255u8).map(|pixel| pixel / 3));
        bytes.extend(9u16.to_le_bytes());
        let count = tiles * tiles;
        // Type 4 is a 32-bit number.
        for (tag, count, value) in [
            (256u16, 1, side),
            (257, 1, side),
            (258, 1, 8),
            (259, 1, 1),
            (262, 1, 1),
            (322, 1, 16),
            (323, 1, 16),
            (324, count, tables),
            (325, count, tables + 4 * count),
        ] {
            bytes.extend(tag.to_le_bytes());
            bytes.extend(4u16.to_le_bytes());
            bytes.extend(u32::to_le_bytes(count));
            bytes.extend(u32::to_le_bytes(value));
        }
        bytes.extend([0; 4]);
        (0..count).for_each(|_| bytes.extend(data.to_le_bytes()));
        (0..count).for_each(|_| bytes.extend(256u32.to_le_bytes()));
        bytes
    }

    #[test]
    fn tiles_of_the_same_bytes_are_decoded_once() {
        let temporary = tempfile::tempdir().unwrap();
        let path = temporary.path().join("t.tif");
        let tiles = 200;
        std::fs::write(&path, repeated(tiles)).unwrap();
        let (input, first) = Input::new(
            spinney_base::io::FileAccess::new().input(&path).unwrap(),
            &path,
            &RasterOptions::new(),
        )
        .unwrap();
        let (directory, _) = input.directory(first).unwrap();
        let image = Image::new(&input, &directory).unwrap();
        let side = u64::from(tiles) * 16;
        let mut rows = vec![0; side as usize * 64];
        for y in (0..side).step_by(64) {
            image.read(&input, Region::new(0, y, side, 64.min(side - y)), &[0], &mut rows).unwrap();
            for (index, pixel) in rows.iter().enumerate() {
                let (x, y) = (index as u64 % side, index as u64 / side);
                assert_eq!(u64::from(*pixel), (x % 16 + y % 16 * 16) / 3, "{x}, {y}");
            }
        }
        // Several threads may have decoded it at the same time.
        let most = rayon::current_num_threads() as u64;
        assert!((1..=most).contains(&image.decoded.load(Ordering::Relaxed)));
    }
}
