//! Images written and read back, corrupt files, and conformance files of other programs.

use std::fs;
use std::path::{Path, PathBuf};

use spinney::raw::export::image::{Format, ImageSpec, create};
use spinney::raw::import::raster::{Order, Pixels, RasterInfo, RasterOptions, open};
use spinney::raw::value::Palette;
use spinney::{Crs, DataKind, Error, Frame, Metadata, Output, Region, Result, SampleType, ValueType};

use crate::common::tiff_file::{Ifd, file, on_disk};
use crate::common::with;

fn spec(width: u64, height: u64, sample: SampleType, channels: u8) -> ImageSpec {
    ImageSpec {
        width,
        height,
        value: ValueType::new(sample, channels),
        alpha: channels.is_multiple_of(2),
        void: false,
        metadata: Metadata::default(),
    }
}

/// Returns samples of all magnitudes; floats are integers, so that none is NaN.
fn samples(spec: &ImageSpec) -> Vec<u8> {
    let count = spec.width * spec.height * u64::from(spec.value.channels);
    let number = |i: u64| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as u32;
    let bytes = |i: u64| match spec.value.sample {
        SampleType::F32 => (number(i) as f32).to_le_bytes().to_vec(),
        SampleType::F64 => f64::from(number(i)).to_le_bytes().to_vec(),
        SampleType::U64 | SampleType::I64 => i.wrapping_mul(0x9e37_79b9_7f4a_7c15).to_le_bytes().to_vec(),
        other => number(i).to_le_bytes()[..other.size()].to_vec(),
    };
    (0..count).flat_map(bytes).collect()
}

/// Writes an image in bands of unequal heights.
fn write(path: &Path, format: Format, spec: &ImageSpec, bytes: &[u8], valid: Option<&[bool]>) -> Result<()> {
    let mut writer = create(Output::create(path)?, format, spec)?;
    let (width, pixel) = (spec.width as usize, spec.value.size());
    let (mut row, mut band) = (0, 1);
    while row < spec.height as usize {
        let rows = row..(row + band).min(spec.height as usize);
        let valid = valid.map(|valid| &valid[rows.start * width..rows.end * width]);
        writer.write_rows(&bytes[rows.start * width * pixel..rows.end * width * pixel], valid)?;
        row = rows.end;
        band = band % 7 + 2;
    }
    writer.finish()
}

/// Reads an image in bands of unequal heights.
fn read(path: &Path, options: &RasterOptions) -> Result<(RasterInfo, Pixels)> {
    let mut raster = open(path, options)?;
    let info = raster.info().clone();
    let mut all = Pixels::default();
    let mut band = Pixels::default();
    let (mut row, mut rows) = (0, 1);
    while row < info.height {
        rows = rows.min(info.height - row);
        raster.read(Region::new(0, row, info.width, rows), &mut band)?;
        all.bytes.extend_from_slice(&band.bytes);
        if let Some(valid) = &band.valid {
            all.valid.get_or_insert_default().extend_from_slice(valid);
        }
        row += rows;
        rows = rows % 5 + 3;
    }
    Ok((info, all))
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/import/images").join(name)
}

fn le_u16(numbers: impl IntoIterator<Item = u16>) -> Vec<u8> {
    numbers.into_iter().flat_map(u16::to_le_bytes).collect()
}

#[test]
fn png_and_exr_round_trips() {
    let directory = tempfile::tempdir().unwrap();
    for sample in SampleType::ALL {
        for channels in 1..=4 {
            let spec = spec(19, 45, sample, channels);
            let bytes = samples(&spec);
            for (format, extension) in [(Format::Png, "png"), (Format::Exr, "exr")] {
                let path = directory.path().join(format!("{sample:?}{channels}.{extension}"));
                let fits = match format {
                    Format::Png => matches!(sample, SampleType::U8 | SampleType::U16),
                    _ => matches!(sample, SampleType::F32 | SampleType::U32),
                };
                let written = write(&path, format, &spec, &bytes, None);
                if !fits {
                    assert!(matches!(written, Err(Error::Unsupported { .. })), "{path:?}: {written:?}");
                    assert!(!path.exists());
                    continue;
                }
                written.unwrap();
                let (info, pixels) = read(&path, &RasterOptions::default()).unwrap();
                assert_eq!((info.width, info.height), (19, 45));
                assert_eq!((info.sample, info.channels), (sample, usize::from(channels)));
                assert_eq!(info.alpha, spec.alpha.then_some(usize::from(channels) - 1));
                assert!(pixels.bytes == bytes && pixels.valid.is_none(), "{path:?}");
            }
        }
    }
}

#[test]
fn npy_and_raw_hold_the_samples() {
    let directory = tempfile::tempdir().unwrap();
    let names = ["|u1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"];
    for (sample, name) in SampleType::ALL.into_iter().zip(names) {
        for (channels, shape) in [(1, "(5, 3)"), (3, "(5, 3, 3)")] {
            let spec = spec(3, 5, sample, channels);
            let bytes = samples(&spec);
            let path = directory.path().join("a.raw");
            write(&path, Format::Raw, &spec, &bytes, None).unwrap();
            assert_eq!(fs::read(&path).unwrap(), bytes);
            write(&path, Format::Npy, &spec, &bytes, None).unwrap();
            let written = fs::read(&path).unwrap();
            let length = usize::from(u16::from_le_bytes([written[8], written[9]]));
            assert_eq!((&written[..8], (10 + length) % 64), (&b"\x93NUMPY\x01\0"[..], 0));
            let header = std::str::from_utf8(&written[10..10 + length]).unwrap();
            let expected = format!("{{'descr': '{name}', 'fortran_order': False, 'shape': {shape}, }}");
            assert_eq!(header.trim_end(), expected);
            assert!(header.ends_with('\n') && written[10 + length..] == bytes);
        }
    }
}

#[test]
fn missing_and_excess_rows_are_errors() {
    let directory = tempfile::tempdir().unwrap();
    let spec = spec(3, 5, SampleType::F32, 1);
    let bytes = samples(&spec);
    for format in [Format::Tiff, Format::Exr, Format::Npy, Format::Raw] {
        let path = directory.path().join("a");
        let begin = || create(Output::create(&path).unwrap(), format, &spec).unwrap();
        let mut writer = begin();
        writer.write_rows(&bytes[..24], None).unwrap();
        assert!(matches!(writer.finish(), Err(Error::Invalid { .. })));
        assert!(begin().write_rows(&bytes[..25], None).is_err());
        let mut writer = begin();
        writer.write_rows(&bytes, None).unwrap();
        assert!(writer.write_rows(&bytes[..12], None).is_err());
        drop(writer);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "temporary files remain");
    }
}

#[test]
fn png_palette_keeps_colours_and_void() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let colours = vec![[1, 2, 3, 255], [4, 5, 6, 128], [7, 8, 9, 255]];
    let mut spec = spec(4, 1, SampleType::U8, 1);
    spec.metadata.palette = Some(Palette { colours: colours.clone() });
    write(&path, Format::Png, &spec, &[0, 1, 2, 3], None).unwrap();
    let (info, pixels) = read(&path, &RasterOptions::default()).unwrap();
    assert_eq!(info.palette.unwrap().colours[..3], colours);
    assert_eq!((info.kind, &pixels.bytes[..]), (Some(DataKind::Categorical), &[0, 1, 2, 3][..]));
    assert!(pixels.valid.unwrap().iter().all(|valid| *valid));

    spec.void = true;
    // No value is free for VOID: colours instead.
    write(&path, Format::Png, &spec, &[0, 3, 1, 2], Some(&[true, false, true, true])).unwrap();
    let (info, pixels) = read(&path, &RasterOptions::default()).unwrap();
    assert_eq!((info.channels, info.alpha, info.palette.is_none()), (4, Some(3), true));
    assert_eq!(pixels.bytes, [1, 2, 3, 255, 0, 0, 0, 0, 4, 5, 6, 128, 7, 8, 9, 255]);
    spec.metadata.nodata = Some(3.0.into());
    write(&path, Format::Png, &spec, &[0, 3, 2, 3], Some(&[true, false, true, false])).unwrap();
    let (_, pixels) = read(&path, &RasterOptions::default()).unwrap();
    assert_eq!((pixels.bytes, pixels.valid), (vec![0, 3, 2, 3], Some(vec![true, false, true, false])));
}

#[test]
fn png_text_bombs_are_skipped_and_reported() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.add_text_chunk("Title".into(), "a pixel".into()).unwrap();
    encoder.add_ztxt_chunk("bomb".into(), "a".repeat(9 << 20)).unwrap();
    encoder.add_itxt_chunk("Comment".into(), "small".into()).unwrap();
    encoder.write_header().unwrap().write_image_data(&[7]).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    std::fs::write(&path, bytes).unwrap();
    let raster = spinney::raw::import::raster::open(&path, &Default::default()).unwrap();
    let names: Vec<_> = raster.info().tags.keys().map(String::as_str).collect();
    assert_eq!(names, ["Comment", "Title"]);
    assert!(raster.info().layout.ends_with("longer than 8 MiB: 1"), "{}", raster.info().layout);
}

#[test]
fn png_void_becomes_opacity() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let cases = [
        (1, vec![10, 20], vec![10, 0xffff, 20, 0]),
        (2, vec![1, 2, 3, 4], vec![1, 2, 3, 0]),
        (3, vec![1, 2, 3, 4, 5, 6], vec![1, 2, 3, 0xffff, 4, 5, 6, 0]),
        (4, vec![1, 2, 3, 4, 5, 6, 7, 8], vec![1, 2, 3, 4, 5, 6, 7, 0]),
    ];
    for (channels, given, expected) in cases {
        let mut spec = spec(2, 1, SampleType::U16, channels);
        spec.void = true;
        write(&path, Format::Png, &spec, &le_u16(given), Some(&[true, false])).unwrap();
        let (info, pixels) = read(&path, &RasterOptions::default()).unwrap();
        assert_eq!(pixels.bytes, le_u16(expected));
        assert_eq!(info.alpha, Some(info.channels - 1));
    }
}

#[test]
fn png_colour_key_and_text() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let write_keyed = |colour, depth, key: &[u8], data: &[u8]| {
        let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 2, 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        encoder.set_trns(key.to_vec());
        encoder.add_text_chunk("Author".into(), "an author".into()).unwrap();
        encoder.add_ztxt_chunk("Comment".into(), "packed".into()).unwrap();
        encoder.write_header().unwrap().write_image_data(data).unwrap();
    };
    write_keyed(png::ColorType::Grayscale, png::BitDepth::Four, &[0, 9], &[0x93]);
    let (info, pixels) = read(&path, &RasterOptions::default()).unwrap();
    assert_eq!((pixels.bytes, pixels.valid), (vec![9, 3], Some(vec![false, true])));
    assert_eq!(info.stored_sample, "uint4");
    let tag = |name: &str, text: &str| (name.to_string(), text.to_string());
    assert_eq!(info.tags, [tag("Author", "an author"), tag("Comment", "packed")].into());

    let key = [0, 1, 0, 2, 3, 4];
    write_keyed(png::ColorType::Rgb, png::BitDepth::Sixteen, &key, &[0, 1, 0, 2, 3, 4, 0, 1, 0, 2, 4, 3]);
    let (_, pixels) = read(&path, &RasterOptions::default()).unwrap();
    assert_eq!(pixels.bytes, le_u16([1, 2, 0x304, 1, 2, 0x403]));
    assert_eq!(pixels.valid, Some(vec![false, true]));
}

#[test]
fn interlaced_pngs_need_memory() {
    let (rows, pixels) = read(&fixture("rows.png"), &RasterOptions::default()).unwrap();
    let (adam7, same) = read(&fixture("adam7.png"), &RasterOptions::default()).unwrap();
    assert_eq!((rows.order, adam7.order), (Order::Bands, Order::Bands));
    assert_eq!(pixels, same);
    let (_, grey) = read(&fixture("adam7_grey2.png"), &RasterOptions::default()).unwrap();
    assert!(grey.bytes.len() == 220 && grey.bytes.iter().all(|&grey| grey < 4));
    assert!(grey.bytes.contains(&1) && grey.bytes.contains(&2));
    let little = with(RasterOptions::new(), |it| it.memory = 300);
    assert!(matches!(open(&fixture("adam7.png"), &little), Err(Error::TooLarge { .. })));
}

/// libjpeg-turbo's decoding of `chroma.jpg`, which has one chroma sample per 2 x 2 luma samples:
/// ranges of a row and of a column, across colour edges. Nearest-neighbour chroma would be off by
/// more than 50 there.
#[test]
fn subsampled_chroma_is_brought_to_size_by_a_triangle_filter() {
    const ROW: [[u8; 3]; 7] = [
        [57, 124, 55],
        [52, 122, 59],
        [61, 115, 66],
        [99, 98, 80],
        [166, 74, 99],
        [202, 64, 113],
        [201, 59, 117],
    ];
    const COLUMN: [[u8; 3]; 7] = [
        [52, 121, 66],
        [49, 124, 65],
        [42, 111, 106],
        [37, 88, 195],
        [35, 78, 232],
        [36, 82, 217],
        [39, 84, 211],
    ];
    let jpeg = fs::read(fixture("chroma.jpg")).unwrap();
    let strip =
        Ifd::grey(32, 32, jpeg).short(258, &[8; 3]).short(277, &[3]).short(262, &[6]).short(259, &[7]);
    let tiff = on_disk(&file(&[strip.short(530, &[2, 2])]));
    for path in [fixture("chroma.jpg"), tiff.path().into()] {
        let (_, pixels) = read(&path, &RasterOptions::default()).unwrap();
        let pixel = |x: usize, y: usize| &pixels.bytes[(y * 32 + x) * 3..][..3];
        let row = ROW.iter().enumerate().map(|(i, colour)| (pixel(10 + i, 5), colour));
        let column = COLUMN.iter().enumerate().map(|(i, colour)| (pixel(4, 15 + i), colour));
        for (found, expected) in row.chain(column) {
            let near = found.iter().zip(expected).all(|(a, b)| a.abs_diff(*b) <= 4);
            assert!(near, "{}: {found:?}, not {expected:?}", path.display());
        }
    }
}

#[test]
fn jpeg_and_webp() {
    let (_, original) = read(&fixture("rows.png"), &RasterOptions::default()).unwrap();
    for (name, channels, alpha, far) in [
        ("rgb.jpg", 3, None, 40),
        ("progressive.jpg", 3, None, 40),
        ("grey.jpg", 1, None, 255),
        ("cmyk.jpg", 3, None, 255),
        ("lossless.webp", 3, None, 0),
        ("lossy.webp", 3, None, 80),
        ("alpha.webp", 4, Some(3), 255),
    ] {
        let (info, pixels) = read(&fixture(name), &RasterOptions::default()).unwrap();
        assert_eq!((info.width, info.height, info.channels, info.alpha), (20, 11, channels, alpha), "{name}");
        assert_eq!(pixels.bytes.len(), 220 * channels);
        let difference = pixels.bytes.iter().zip(&original.bytes).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(difference <= Some(far), "{name}: {difference:?}");
        if let Some(alpha) = alpha {
            assert!([9, 10].map(|x| pixels.bytes[4 * x + alpha]) == [255, 40]);
        }
        let little = with(RasterOptions::new(), |it| it.memory = 219);
        assert!(matches!(open(&fixture(name), &little), Err(Error::TooLarge { .. })), "{name}");
        // Any region in any order.
        let mut raster = open(&fixture(name), &RasterOptions::default()).unwrap();
        let mut part = Pixels::default();
        raster.read(Region::new(3, 4, 2, 1), &mut part).unwrap();
        assert_eq!(part.bytes, pixels.bytes[(4 * 20 + 3) * channels..][..2 * channels]);
        assert!(raster.read(Region::new(3, 4, 18, 1), &mut part).is_err());
    }
}

#[test]
fn world_files_georeference_images() {
    let directory = tempfile::tempdir().unwrap();
    for (name, world) in [("rgb.jpg", "rgb.jgw"), ("rows.png", "rows.pgw"), ("lossy.webp", "lossy.wld")] {
        fs::copy(fixture(name), directory.path().join(name)).unwrap();
        fs::write(directory.path().join(world), "2\n0\n0\n-2\n101\n199\n").unwrap();
        let raster = open(&directory.path().join(name), &RasterOptions::default()).unwrap();
        assert_eq!(raster.info().frame, Frame::planar([2.0, 0.0, 100.0, 0.0, -2.0, 200.0]));
    }
}

/// Far from the equator, the spacing along parallels is larger.
#[test]
fn hgt_tiles_of_other_sizes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("N71E025.hgt");
    let open_of = |samples: u64| {
        fs::File::create(&path).unwrap().set_len(2 * samples).unwrap();
        open(&path, &RasterOptions::default())
    };
    for [width, height] in [[1801, 3601], [1201, 3601], [3601, 3601], [7201, 7201]] {
        let raster = open_of(width * height).unwrap();
        let info = raster.info();
        assert_eq!([info.width, info.height], [width, height]);
        let corner = info.frame.to_world([width as f64 - 0.5, height as f64 - 0.5, 0.0]);
        assert!((corner[0] - 26.0).abs() < 1e-9 && (corner[1] - 71.0).abs() < 1e-9, "{corner:?}");
        let first = info.frame.to_world([0.5, 0.5, 0.0]);
        assert!((first[0] - 25.0).abs() < 1e-9 && (first[1] - 72.0).abs() < 1e-9, "{first:?}");
    }
    let error = open_of(1801 * 3600).err().unwrap().to_string();
    assert!(error.contains("(1801 x 3601 samples)"), "{error}");
}

#[test]
fn hgt_tiles() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("N46E008.hgt");
    fs::write(&path, (0..1201 * 1201u32).flat_map(|i| (i as u16).to_be_bytes()).collect::<Vec<u8>>())
        .unwrap();
    let mut raster = open(&path, &RasterOptions::default()).unwrap();
    let frame = &raster.info().frame;
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near(frame.to_world([0.5, 0.5, 0.0]), [8.0, 47.0, 0.0]));
    assert!(near(frame.to_world([1200.5, 1200.5, 0.0]), [9.0, 46.0, 0.0]));
    assert_eq!((frame.crs.clone(), raster.info().nodata), (Some(Crs::epsg(4326)), Some((-32768).into())));
    let mut pixels = Pixels::default();
    raster.read(Region::new(5, 2, 2, 2), &mut pixels).unwrap();
    assert_eq!(pixels.bytes, le_u16([2407, 2408, 3608, 3609]));

    fs::write(&path, [0; 100]).unwrap();
    assert!(matches!(open(&path, &RasterOptions::default()), Err(Error::Corrupt { .. })));
}

#[test]
fn files_that_are_no_rasters_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a");
    let options = RasterOptions::default();
    assert!(matches!(open(&path, &options), Err(Error::Io { .. })));
    assert!(matches!(open(directory.path(), &options), Err(Error::Unsupported { .. })));
    fs::write(&path, "").unwrap();
    assert!(matches!(open(&path, &options), Err(Error::Corrupt { .. })));
    fs::write(&path, "some text that is no image").unwrap();
    assert!(matches!(open(&path, &options), Err(Error::Unsupported { .. })));
}

/// Writes small files of all formats.
fn small_files(directory: &Path) -> Vec<PathBuf> {
    let mut spec = spec(9, 35, SampleType::F32, 3);
    write(&directory.join("a.exr"), Format::Exr, &spec, &samples(&spec), None).unwrap();
    spec.value = ValueType::new(SampleType::U8, 1);
    spec.metadata.palette = Some(Palette { colours: vec![[1, 2, 3, 4]; 7] });
    write(&directory.join("a.png"), Format::Png, &spec, &samples(&spec), None).unwrap();
    let names = "adam7.png adam7_grey2.png rows.png grey.jpg rgb.jpg progressive.jpg cmyk.jpg lossy.webp \
                 lossless.webp alpha.webp";
    let fixtures = names.split_whitespace().map(fixture);
    [directory.join("a.exr"), directory.join("a.png")].into_iter().chain(fixtures).collect()
}

#[test]
fn truncated_files_are_errors() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("corrupt");
    let options = with(RasterOptions::new(), |it| it.memory = 1 << 20);
    for file in small_files(directory.path()) {
        let bytes = fs::read(&file).unwrap();
        // Every length in the headers and at the end, a sample in between.
        let (start, end) = (300, bytes.len().saturating_sub(100));
        for length in (0..bytes.len()).filter(|cut| *cut < start || *cut > end || cut % 7 == 0) {
            fs::write(&path, &bytes[..length]).unwrap();
            let result = read(&path, &options);
            assert!(result.is_err(), "{} of {} bytes of {}", length, bytes.len(), file.display());
        }
    }
}

#[test]
fn altered_files_are_harmless() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("corrupt");
    let options = with(RasterOptions::new(), |it| it.memory = 1 << 20);
    let mut seed = 1u64;
    let mut random = |below: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    };
    for file in small_files(directory.path()) {
        let bytes = fs::read(&file).unwrap();
        for _ in 0..250 {
            let mut altered = bytes.clone();
            for _ in 0..=random(3) {
                // Headers are the most sensitive.
                let reach = if random(2) == 0 { bytes.len() } else { bytes.len().min(400) };
                altered[random(reach)] ^= 1 << random(8);
            }
            fs::write(&path, &altered).unwrap();
            // Only the format determines whether it is still an image, but reading ends.
            let size = open(&path, &options).map(|raster| raster.info().width * raster.info().height);
            if size.is_ok_and(|size| size < 1 << 22) {
                let _ = read(&path, &options);
            }
        }
    }
}

#[test]
fn exr_conformance_files() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/exr/basic");
    let Ok(files) = fs::read_dir(&directory) else {
        eprintln!("skipped: there is no {}", directory.display());
        return;
    };
    for file in files.map(|file| file.unwrap().path()) {
        match read(&file, &RasterOptions::default()) {
            Ok((info, pixels)) => {
                let bytes = info.width * info.height * (info.sample.size() * info.channels) as u64;
                assert_eq!(pixels.bytes.len() as u64, bytes, "{}", file.display());
                // A region in the middle is the same, whatever the blocks are.
                let part = Region::new(info.width / 3, info.height / 3, info.width / 2, info.height / 2);
                let mut alone = Pixels::default();
                open(&file, &RasterOptions::default()).unwrap().read(part, &mut alone).unwrap();
                let pixel = info.sample.size() * info.channels;
                let row = |y: u64| &pixels.bytes[(y * info.width + part.x) as usize * pixel..];
                let cut = (part.y..part.bottom()).flat_map(|y| &row(y)[..part.width as usize * pixel]);
                assert!(cut.eq(&alone.bytes), "{}", file.display());
            }
            Err(Error::Unsupported { found, .. }) => eprintln!("{}: {found}", file.display()),
            Err(error) => panic!("{error}"),
        }
    }
}
