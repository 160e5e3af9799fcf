//! Writer of (Geo)TIFF: compressed strips, followed by the directory, which is known only then.

use rayon::prelude::*;

use super::seekable::Seekable;
use super::tiff_coding::{Coder, Coding};
use super::tiff_tags::{self, IfdField};
use super::{ImageSpec, RowWriter, Rows, gdal_xml};
use spinney_base::io::Output;
use spinney_base::value::{Palette, SampleType};
use spinney_base::{Error, Result};
use spinney_chunks::spec::{
    compression, extra_samples, new_subfile_type, photometric, planar_configuration, sample_format, tag,
};

/// Uncompressed bytes per strip, unless a single row is longer.
const STRIP_BYTES: u64 = 512 << 10;

/// Uncompressed size in bytes from which on offsets may need more than 32 bits.
pub(crate) const BIG_BYTES: u64 = 3_900_000_000;

/// Level 4 is little larger than level 6, and much faster.
const CODER: Coder = Coder::Deflate { level: 4 };

/// Compression of masks, independent of that of samples.
pub(crate) const MASK_CODER: Coder = Coder::Deflate { level: 6 };

struct Tiff {
    output: Seekable,
    rows: Rows,
    big: bool,
    coding: Coding,
    rows_per_strip: u64,
    /// Rows of an incomplete strip, and a few complete strips.
    waiting: Vec<u8>,
    offsets: Vec<u64>,
    sizes: Vec<u64>,
    /// All tags except those of the strips.
    tags: Vec<(u16, IfdField)>,
    mask: Option<MaskStrips>,
}

/// The mask of valid pixels: an image of its own, with as many rows per strip.
struct MaskStrips {
    width: usize,
    height: u64,
    waiting: Vec<u8>,
    offsets: Vec<u64>,
    sizes: Vec<u64>,
}

pub(super) fn create(output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    create_as(
        output,
        spec,
        spec.width.saturating_mul(spec.height).saturating_mul(spec.value.size() as u64) > BIG_BYTES,
    )
}

fn create_as(output: Output, spec: &ImageSpec, big: bool) -> Result<Box<dyn RowWriter>> {
    let row_bytes = spec.width.saturating_mul(spec.value.size() as u64);
    if row_bytes > u64::from(u32::MAX) || spec.height > u64::from(u32::MAX) {
        return Err(Error::unsupported(output.path(), "TIFF with rows of 4 GiB, or 2^32 rows", "write .npy"));
    }
    let has_labels = palette(spec).is_some();
    let coding = Coding::new(spec.value, row_bytes as usize, has_labels, CODER);
    let rows_per_strip = (STRIP_BYTES / row_bytes).clamp(1, spec.height);
    // Without a file there is no sidecar either.
    let with_classes = !output.is_file();
    let mut tags = sample_tags(spec, &coding);
    tags.extend(descriptive_tags(spec, with_classes));
    tags.extend([
        (tag::IMAGE_WIDTH, IfdField::Long(vec![spec.width as u32])),
        (tag::IMAGE_LENGTH, IfdField::Long(vec![spec.height as u32])),
        (tag::ROWS_PER_STRIP, IfdField::Long(vec![rows_per_strip as u32])),
    ]);
    let mut output = Seekable::new(output)?;
    output.append(tiff_tags::header(big).0)?;
    let mask = spec.needs_mask().then(|| MaskStrips {
        width: spec.width as usize,
        height: spec.height,
        waiting: Vec::new(),
        offsets: Vec::new(),
        sizes: Vec::new(),
    });
    Ok(Box::new(Tiff {
        output,
        rows: Rows::new(spec),
        big,
        coding,
        rows_per_strip,
        waiting: Vec::new(),
        offsets: Vec::new(),
        sizes: Vec::new(),
        tags,
        mask,
    }))
}

/// The palette, if TIFF can hold it for values of this type.
fn palette(spec: &ImageSpec) -> Option<&Palette> {
    let fits = spec.value.channels == 1 && matches!(spec.value.sample, SampleType::U8 | SampleType::U16);
    spec.metadata.palette.as_ref().filter(|palette| fits && !palette.colours.is_empty())
}

/// The tags that describe the samples and their coding.
pub(crate) fn sample_tags(spec: &ImageSpec, coding: &Coding) -> Vec<(u16, IfdField)> {
    use IfdField::Short;
    let channels = usize::from(spec.value.channels);
    let format = match spec.value.sample {
        SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64 => sample_format::UNSIGNED,
        SampleType::I8 | SampleType::I16 | SampleType::I32 | SampleType::I64 => sample_format::SIGNED,
        SampleType::F32 | SampleType::F64 => sample_format::FLOAT,
    };
    let is_rgb = channels >= 3
        && matches!(spec.value.sample, SampleType::U8 | SampleType::U16)
        && spec.metadata.rgb_channels() == [0, 1, 2];
    let photometric = if palette(spec).is_some() {
        photometric::RGB_PALETTE
    } else if is_rgb {
        photometric::RGB
    } else {
        photometric::BLACK_IS_ZERO
    };
    let mut tags = vec![
        (tag::BITS_PER_SAMPLE, Short(vec![spec.value.sample.size() as u16 * 8; channels])),
        (tag::COMPRESSION, Short(vec![coding.coder.number()])),
        (tag::PHOTOMETRIC_INTERPRETATION, Short(vec![photometric as u16])),
        (tag::SAMPLES_PER_PIXEL, Short(vec![channels as u16])),
        (tag::PLANAR_CONFIGURATION, Short(vec![planar_configuration::CHUNKY as u16])),
        (tag::PREDICTOR, Short(vec![coding.predictor.number() as u16])),
        (tag::SAMPLE_FORMAT, Short(vec![format as u16; channels])),
    ];
    let mut extra = vec![extra_samples::UNSPECIFIED as u16; channels - if is_rgb { 3 } else { 1 }];
    if let Some(last) = extra.last_mut() {
        if spec.alpha {
            *last = extra_samples::UNASSOCIATED_ALPHA as u16;
        }
        tags.push((tag::EXTRA_SAMPLES, Short(extra)));
    }
    if let Some(palette) = palette(spec) {
        let entries = 1 << (8 * spec.value.sample.size());
        let colour = |i: usize| palette.colours.get(i).copied().unwrap_or_default();
        let channel = |c: usize| (0..entries).map(move |i| u16::from(colour(i)[c]) * 257);
        tags.push((tag::COLOR_MAP, Short((0..3).flat_map(channel).collect())));
    }
    tags.extend(spec.metadata.nodata.map(tiff_tags::nodata_tag));
    tags
}

/// The tags with georeferencing and other metadata.
pub(crate) fn descriptive_tags(spec: &ImageSpec, with_classes: bool) -> Vec<(u16, IfdField)> {
    let metadata = &spec.metadata;
    let mut tags = match &metadata.control_points {
        Some(points) => tiff_tags::control_point_tags(points),
        None => tiff_tags::geo_tags(&metadata.frame),
    };
    tags.extend(tiff_tags::text_tags(&metadata.tags));
    let about = gdal_xml::metadata(metadata, with_classes);
    tags.extend(about.map(|xml| (tag::GDAL_METADATA, IfdField::Ascii(xml.into_bytes()))));
    tags
}

/// The tags of a mask: a bit per pixel, 1 for valid pixels.
pub(crate) fn mask_tags() -> Vec<(u16, IfdField)> {
    use IfdField::Short;
    vec![
        (tag::BITS_PER_SAMPLE, Short(vec![1])),
        (tag::COMPRESSION, Short(vec![compression::ADOBE_DEFLATE as u16])),
        (tag::PHOTOMETRIC_INTERPRETATION, Short(vec![photometric::TRANSPARENCY_MASK as u16])),
        (tag::SAMPLES_PER_PIXEL, Short(vec![1])),
        (tag::PLANAR_CONFIGURATION, Short(vec![planar_configuration::CHUNKY as u16])),
        (tag::SAMPLE_FORMAT, Short(vec![sample_format::UNSIGNED as u16])),
    ]
}

/// Appends rows of a mask: a bit per pixel, most significant bit first, rows padded to whole bytes.
pub(crate) fn mask_rows(valid: &[bool], width: usize, rows: &mut Vec<u8>) {
    for row in valid.chunks_exact(width) {
        rows.extend(row.chunks(8).map(|flags| {
            let bits = flags.iter().fold(0, |bits, flag| bits << 1 | u8::from(*flag));
            bits << (8 - flags.len())
        }));
    }
}

/// Offsets or sizes in the word width of the file.
fn words(numbers: Vec<u64>, big: bool) -> IfdField {
    match big {
        true => IfdField::Long8(numbers),
        false => IfdField::Long(numbers.into_iter().map(|number| number as u32).collect()),
    }
}

impl Tiff {
    /// Compresses and writes the buffered rows.
    fn write_strips(&mut self) -> Result<()> {
        let strip = self.rows_per_strip as usize * self.coding.row_bytes;
        let coding = self.coding;
        let strips: Vec<Vec<u8>> =
            self.waiting.par_chunks(strip).map(|rows| coding.compress(rows.to_vec())).collect();
        for strip in strips {
            self.offsets.push(self.output.position());
            self.sizes.push(strip.len() as u64);
            self.output.append(&strip)?;
        }
        self.waiting.clear();
        let Some(mask) = &mut self.mask else { return Ok(()) };
        for rows in mask.waiting.chunks(self.rows_per_strip as usize * mask.width.div_ceil(8)) {
            let strip = MASK_CODER.compress(rows.to_vec());
            mask.offsets.push(self.output.position());
            mask.sizes.push(strip.len() as u64);
            self.output.append(&strip)?;
        }
        mask.waiting.clear();
        Ok(())
    }
}

impl RowWriter for Tiff {
    fn write_rows(&mut self, bytes: &[u8], mut valid: Option<&[bool]>) -> Result<()> {
        self.rows.take(bytes)?;
        let strip = self.rows_per_strip as usize * self.coding.row_bytes;
        // Enough strips for all threads, but only one if strips are large.
        let batch = (16 * STRIP_BYTES as usize / strip).max(1) * strip;
        let mut rest = bytes;
        while !rest.is_empty() {
            let (now, later) = rest.split_at(rest.len().min(batch - self.waiting.len()));
            self.waiting.extend_from_slice(now);
            rest = later;
            if let Some(mask) = &mut self.mask {
                // Only whole rows are split off.
                let pixels = now.len() / self.coding.row_bytes * mask.width;
                match &mut valid {
                    Some(valid) => {
                        let (flags, others) = valid.split_at(pixels);
                        mask_rows(flags, mask.width, &mut mask.waiting);
                        *valid = others;
                    }
                    None => mask_rows(&vec![true; pixels], mask.width, &mut mask.waiting),
                }
            }
            if self.waiting.len() == batch {
                self.write_strips()?;
            }
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.rows.finish()?;
        self.write_strips()?;
        let Tiff { mut output, mut tags, offsets, sizes, big, mask, rows_per_strip, .. } = *self;
        if output.position() % 2 == 1 {
            output.append(&[0])?;
        }
        tags.push((tag::STRIP_OFFSETS, words(offsets, big)));
        tags.push((tag::STRIP_BYTE_COUNTS, words(sizes, big)));
        let at = output.position();
        match mask {
            None => output.append(&tiff_tags::directory(tags, at, 0, big))?,
            Some(mask) => {
                // The length does not depend on the offset of the next directory.
                let next = at + tiff_tags::directory(tags.clone(), at, 0, big).len() as u64;
                output.append(&tiff_tags::directory(tags, at, next, big))?;
                let mut tags = mask_tags();
                tags.extend([
                    (tag::NEW_SUBFILE_TYPE, IfdField::Long(vec![new_subfile_type::TRANSPARENCY_MASK as u32])),
                    (tag::IMAGE_WIDTH, IfdField::Long(vec![mask.width as u32])),
                    (tag::IMAGE_LENGTH, IfdField::Long(vec![mask.height as u32])),
                    (tag::ROWS_PER_STRIP, IfdField::Long(vec![rows_per_strip as u32])),
                    (tag::STRIP_OFFSETS, words(mask.offsets, big)),
                    (tag::STRIP_BYTE_COUNTS, words(mask.sizes, big)),
                ]);
                output.append(&tiff_tags::directory(tags, next, 0, big))?;
            }
        }
        output.patch(tiff_tags::header(big).1, &tiff_tags::word(at, big))?;
        output.commit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::ValueType;
    use spinney_container::Metadata;

    fn spec(sample: SampleType, channels: u8) -> ImageSpec {
        ImageSpec {
            width: 37,
            height: 61,
            value: ValueType::new(sample, channels),
            alpha: channels.is_multiple_of(2),
            void: false,
            metadata: Metadata::default(),
        }
    }

    /// Samples in file order, as decoded by another library.
    fn decode(path: &std::path::Path) -> Vec<u8> {
        use tiff::decoder::DecodingResult::*;
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut decoder = tiff::decoder::Decoder::new(file).unwrap();
        match decoder.read_image().unwrap() {
            U8(samples) => samples,
            U16(samples) => samples.into_iter().flat_map(u16::to_le_bytes).collect(),
            U32(samples) => samples.into_iter().flat_map(u32::to_le_bytes).collect(),
            I16(samples) => samples.into_iter().flat_map(i16::to_le_bytes).collect(),
            I32(samples) => samples.into_iter().flat_map(i32::to_le_bytes).collect(),
            F32(samples) => samples.into_iter().flat_map(f32::to_le_bytes).collect(),
            F64(samples) => samples.into_iter().flat_map(f64::to_le_bytes).collect(),
            I8(samples) => samples.into_iter().flat_map(i8::to_le_bytes).collect(),
            U64(samples) => samples.into_iter().flat_map(u64::to_le_bytes).collect(),
            I64(samples) => samples.into_iter().flat_map(i64::to_le_bytes).collect(),
            other => panic!("unexpected samples: {other:?}"),
        }
    }

    #[test]
    fn samples_survive_a_round_trip() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.tif");
        for sample in SampleType::ALL {
            for (channels, big) in [(1, false), (2, true), (3, true), (4, false)] {
                let spec = spec(sample, channels);
                let bytes: Vec<u8> = (0..37 * 61 * spec.value.size() as u32)
                    .map(|i| (i.wrapping_mul(0x9e37_79b9) >> 25) as u8)
                    .collect();
                let mut writer = create_as(Output::create(&path).unwrap(), &spec, big).unwrap();
                bytes
                    .chunks(37 * spec.value.size() * 9)
                    .for_each(|rows| writer.write_rows(rows, None).unwrap());
                writer.finish().unwrap();
                let version = std::fs::read(&path).unwrap()[2];
                assert_eq!(version, if big { 43 } else { 42 });
                assert!(decode(&path) == bytes, "{} big: {big}", spec.value);
            }
        }
    }

    #[test]
    fn masks_have_a_bit_per_pixel() {
        let mut rows = Vec::new();
        let valid: Vec<bool> = (0..22).map(|pixel| pixel % 11 % 3 != 0).collect();
        mask_rows(&valid, 11, &mut rows);
        assert_eq!(rows, [0b0110_1101, 0b1010_0000, 0b0110_1101, 0b1010_0000]);
    }

    #[test]
    fn many_strips_are_in_order() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.tif");
        let mut spec = spec(SampleType::U16, 1);
        (spec.width, spec.height) = (70_000, 91);
        let bytes: Vec<u8> = (0..70_000 * 91u32).flat_map(|i| ((i / 251) as u16).to_le_bytes()).collect();
        let mut writer = create(Output::create(&path).unwrap(), &spec).unwrap();
        bytes.chunks(140_000 * 20).for_each(|rows| writer.write_rows(rows, None).unwrap());
        writer.finish().unwrap();
        assert!(decode(&path) == bytes);
    }

    #[test]
    fn rows_of_4_gib_are_rejected() {
        let directory = tempfile::tempdir().unwrap();
        let mut spec = spec(SampleType::F64, 4);
        spec.width = 1 << 40;
        let output = Output::create(&directory.path().join("a.tif")).unwrap();
        assert!(matches!(create(output, &spec), Err(Error::Unsupported { .. })));
    }
}
