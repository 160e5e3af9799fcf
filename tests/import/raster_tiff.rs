//! TIFF files of every kind against what GDAL reads from them.

use std::path::{Path, PathBuf};

use crate::common::tiff_file::{Ifd, Values, file, on_disk};
use sha2::{Digest, Sha256};
use spinney::raw::import::raster::{self, Order, Pixels, Raster, RasterInfo, RasterOptions};
use spinney::raw::space::Epsg;
use spinney::{Crs, DataKind, Error, Region, Result, SampleType};

use crate::common::with;

/// Files that GDAL reads and Spinney rejects, and why.
const REFUSED: [(&str, &str); 16] = [
    ("image_tiff/big_g4.tif", "the fax decoder takes at most 65535 rows of a strip"),
    ("image_tiff/logluv-3c-16b.tiff", "SGI LogLuv"),
    ("image_tiff/seq-1c-1b-fax3-71f6a21a.tiff", "CCITT group 3"),
    ("image_tiff/seq-1c-1b-fax3-fillbits-71f6a21a.tiff", "CCITT group 3"),
    ("image_tiff/seq-1c-1b-fax3-lsb-71f6a21a.tiff", "CCITT group 3"),
    ("gdal_gcore/byte_lerc.tif", "LERC"),
    ("gdal_gcore/cielab.tif", "CIE L*a*b*"),
    ("gdal_gcore/int24.tif", "signed 24 bits: GDAL drops the sign"),
    ("gdal_gcore/next_default_case.tif", "NeXT"),
    ("gdal_gcore/next_literalrow.tif", "NeXT"),
    ("gdal_gcore/next_literalspan.tif", "NeXT"),
    (
        "gdal_gcore/size_of_stripbytecount_at_1_and_lower_than_stripcount.tif",
        "GDAL reads zeros that are not there",
    ),
    ("gdal_gcore/size_of_stripbytecount_lower_than_stripcount.tif", "GDAL reads zeros that are not there"),
    ("gdal_gcore/thunder.tif", "ThunderScan"),
    ("gdal_gcore/uint16_sgilog.tif", "SGI LogLuv"),
    ("gdal_gcore/zackthecat.tif", "old-style JPEG"),
];

/// Files for which Spinney reports another EPSG code than GDAL, and why.
const OTHER_EPSG: [(&str, Option<Epsg>, &str); 6] = [
    (
        "gdal_gcore/epsg26711_3855_geotiff1_1.tif",
        Some(Epsg { horizontal: 26711, vertical: Some(3855) }),
        "a pair that has no number of its own",
    ),
    (
        "gdal_gcore/tiff_vertcs_scale_offset.tif",
        Some(Epsg { horizontal: 26711, vertical: Some(5773) }),
        "a pair, of which the table has the plane's part",
    ),
    (
        "gdal_gcore/vertcs_user_defined.tif",
        None,
        "heights by parameters, of which the table has the plane's part",
    ),
    ("gdal_gcore/spaf27_correct.tif", None, "given by parameters, whose number only a database knows"),
    ("gdal_gcore/spaf27_markedcorrect.tif", None, "given by parameters, whose number only a database knows"),
    ("nlcd_zion/nlcd2011.tif", None, "given by parameters, whose number only a database knows"),
];

fn data() -> Option<PathBuf> {
    let directory = std::env::var_os("SPINNEY_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let directory = directory.join("raster");
    if !directory.is_dir() {
        eprintln!("skipped: no test data in {}", directory.display());
        return None;
    }
    Some(directory)
}

/// One line of the table of GDAL's results.
struct Expected<'a> {
    file: &'a str,
    size: [u64; 2],
    bands: usize,
    nodata: Option<f64>,
    epsg: Option<u32>,
    transform: Option<[f64; 6]>,
    hash: &'a str,
    mean: f64,
}

impl Expected<'_> {
    fn parse(line: &str) -> Option<Expected<'_>> {
        let fields: Vec<_> = line.split('\t').collect();
        let &[file, width, height, bands, _, nodata, epsg, transform, _, hash, mean] = fields.as_slice()
        else {
            return None;
        };
        let transform: Vec<f64> = transform.split(',').filter_map(|number| number.parse().ok()).collect();
        Some(Expected {
            file,
            size: [width.parse().ok()?, height.parse().ok()?],
            bands: bands.parse().ok()?,
            nodata: nodata.parse().ok(),
            epsg: epsg.parse().ok(),
            transform: transform.try_into().ok(),
            hash,
            mean: mean.parse().ok()?,
        })
    }
}

/// Returns all samples of a raster, read by regions of at most this size.
fn read_by(raster: &mut dyn Raster, [width, height]: [u64; 2]) -> Result<Vec<u8>> {
    let info = raster.info().clone();
    let pixel = info.sample.size() * info.channels;
    let mut all = vec![0; info.width as usize * info.height as usize * pixel];
    let mut pixels = Pixels::default();
    for y in (0..info.height).step_by(height as usize) {
        for x in (0..info.width).step_by(width as usize) {
            let region = Region::new(x, y, width.min(info.width - x), height.min(info.height - y));
            raster.read(region, &mut pixels)?;
            assert_eq!(pixels.bytes.len() as u64, region.area() * pixel as u64);
            for (i, row) in pixels.bytes.chunks_exact(region.width as usize * pixel).enumerate() {
                let at = ((y as usize + i) * info.width as usize + x as usize) * pixel;
                all[at..at + row.len()].copy_from_slice(row);
            }
        }
    }
    Ok(all)
}

/// Returns the first 16 hexadecimal digits of the hash of all samples: band by band, in GDAL's
/// type.
fn hash(info: &RasterInfo, bytes: &[u8]) -> String {
    let size = info.sample.size();
    let mut hasher = Sha256::new();
    for channel in 0..info.channels {
        let samples = bytes.chunks_exact(size).skip(channel).step_by(info.channels);
        hasher.update(samples.flatten().copied().collect::<Vec<u8>>());
    }
    hasher.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect()
}

fn close(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-11 * a.abs().max(b.abs())
}

/// Lists differences from the expected result.
fn differences(expected: &Expected<'_>, path: &Path) -> Result<Vec<String>> {
    let mut raster = raster::open(path, &RasterOptions::default())?;
    let info = raster.info().clone();
    let mut wrong = Vec::new();
    let mut check = |what: &str, same: bool, found: String| {
        if !same {
            wrong.push(format!("{what}: {found}"));
        }
    };
    check("size", [info.width, info.height] == expected.size, format!("{}x{}", info.width, info.height));
    check("bands", info.channels == expected.bands, info.channels.to_string());
    let nodata = match (info.nodata, expected.nodata) {
        (Some(a), Some(b)) => close(a.to_f64(), b),
        (a, b) => a.is_none() && b.is_none(),
    };
    check("nodata", nodata, format!("{:?} for {:?}", info.nodata, expected.nodata));
    let other = OTHER_EPSG.iter().find(|(file, ..)| *file == expected.file);
    let epsg = other.map_or(expected.epsg.map(Epsg::new), |(_, epsg, _)| *epsg);
    let found = info.frame.crs.as_ref().and_then(Crs::numbers);
    let system = |epsg: Option<Epsg>| epsg.map(Crs::Epsg);
    let is_same = match (system(found), system(epsg)) {
        (Some(found), Some(epsg)) => found.is_same(&epsg),
        (found, epsg) => found == epsg,
    };
    check("epsg", is_same, format!("{found:?} for {epsg:?}"));
    let affine = info.frame.affine();
    let transform = expected.transform.unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    check("transform", affine.iter().zip(transform).all(|(a, b)| close(*a, b)), format!("{affine:?}"));
    let bands = read_by(&mut *raster, [info.width, 50])?;
    if info.layout.contains("jpeg") {
        // Decoders may differ in rounding and chroma upsampling, so samples are not equal.
        let first: Vec<_> = bands.iter().step_by(info.channels).map(|sample| f64::from(*sample)).collect();
        let mean = first.iter().sum::<f64>() / first.len() as f64;
        check("mean", (mean - expected.mean).abs() < 0.5, format!("{mean} for {}", expected.mean));
    } else {
        check("samples", hash(&info, &bands) == expected.hash, "another hash".into());
    }
    // Windows not aligned to chunks, small enough to revisit most chunks.
    let step = |length: u64| if length > 300 { 277 } else { 13 };
    let odd = read_by(&mut *raster, [step(info.width), step(info.height)])?;
    check("odd regions", odd == bands, "other samples".into());
    Ok(wrong)
}

#[test]
fn files_read_as_gdal_reads_them() {
    let Some(directory) = data() else { return };
    let table = std::fs::read_to_string(directory.join("expected.tsv")).unwrap();
    let (mut wrong, mut refused) = (Vec::new(), Vec::new());
    for line in table.lines().skip(1) {
        let file = line.split('\t').next().unwrap();
        if !(file.ends_with(".tif") || file.ends_with(".tiff")) {
            continue;
        }
        let path = directory.join(file);
        let Some(expected) = Expected::parse(line) else {
            // GDAL fails for these, or they are too large: they must only terminate.
            let read = raster::open(&path, &RasterOptions::default()).and_then(|mut raster| {
                let info = raster.info().clone();
                let region = Region::new(0, 0, info.width.min(2000), info.height.min(2000));
                raster.read(region, &mut Pixels::default())
            });
            println!("{file}: {}", read.map_or_else(|error| error.to_string(), |()| "read".into()));
            continue;
        };
        match differences(&expected, &path) {
            Ok(differences) => wrong.extend(differences.iter().map(|what| format!("{file}: {what}"))),
            Err(Error::Unsupported { .. } | Error::Corrupt { .. })
                if REFUSED.iter().any(|(f, _)| *f == file) =>
            {
                refused.push(file);
            }
            Err(error) => wrong.push(format!("{file}: {error}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert_eq!(refused, REFUSED.map(|(file, _)| file));
}

/// Opens a crafted file and reads it completely.
fn whole(bytes: &[u8], memory: u64) -> Result<(RasterInfo, Pixels)> {
    let file = on_disk(bytes);
    let mut raster = raster::open(file.path(), &with(RasterOptions::new(), |it| it.memory = memory))?;
    let info = raster.info().clone();
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, info.width, info.height), &mut pixels)?;
    Ok((info, pixels))
}

const MEMORY: u64 = 1 << 20;

#[test]
fn a_mask_marks_valid_samples() {
    let mask =
        Ifd::grey(3, 2, vec![0b1010_0000, 0b0110_0000]).short(254, &[4]).short(258, &[1]).short(262, &[4]);
    let overview = Ifd::grey(2, 1, vec![7, 7]).short(254, &[1]);
    let image = Ifd::grey(3, 2, vec![1, 2, 3, 4, 5, 6]);
    let (_, pixels) = whole(&file(&[image.clone(), overview.clone(), mask]), MEMORY).unwrap();
    assert_eq!(pixels.bytes, [1, 2, 3, 4, 5, 6]);
    assert_eq!(pixels.valid, Some(vec![true, false, true, false, true, true]));
    let (_, pixels) = whole(&file(&[image, overview]), MEMORY).unwrap();
    assert_eq!(pixels.valid, None);
}

#[test]
fn tiles_that_were_never_written_are_nodata() {
    let tiles = |width| Ifd::grey(width, 16, vec![]).short(322, &[16]).short(323, &[16]);
    let image = tiles(20).chunks(&[vec![5; 256], vec![]]);
    let (info, pixels) = whole(&file(&[image.clone().tag(42113, Values::Text("9"))]), MEMORY).unwrap();
    assert_eq!((info.nodata, info.order), (Some(9.into()), Order::Anywhere));
    assert_eq!(pixels.bytes[..20], [[5; 16].as_slice(), &[9; 4]].concat());
    let (_, pixels) = whole(&file(&[image]), MEMORY).unwrap();
    assert_eq!(pixels.bytes[16..20], [0; 4]);
}

#[test]
fn integers_of_64_bits_are_preserved() {
    let image = |number: u64| Ifd::grey(1, 1, number.to_le_bytes().to_vec()).short(258, &[64]);
    for number in [0, 1 << 53, (1 << 53) + 1, (1 << 63) + 3, u64::MAX] {
        let (info, pixels) = whole(&file(&[image(number)]), MEMORY).unwrap();
        assert_eq!((info.sample, info.stored_sample.as_str()), (SampleType::U64, "uint64"));
        assert_eq!(pixels.bytes, number.to_le_bytes());
        let signed = image(number).short(339, &[2]).tag(42113, Values::Text("-9007199254740993"));
        let (info, pixels) = whole(&file(&[signed]), MEMORY).unwrap();
        assert_eq!((info.sample, info.nodata), (SampleType::I64, Some((-9_007_199_254_740_993i64).into())));
        assert_eq!(pixels.bytes, number.to_le_bytes());
    }
}

#[test]
fn small_samples_become_the_next_wider_type() {
    let image = |bits, format, strip: &[u8]| {
        let (info, pixels) = whole(
            &file(&[Ifd::grey(2, 1, strip.to_vec()).short(258, &[bits]).short(339, &[format])]),
            MEMORY,
        )
        .unwrap();
        (info.stored_sample, info.sample, pixels.bytes)
    };
    assert_eq!(image(3, 1, &[0b1010_1000]), ("uint3".into(), SampleType::U8, vec![5, 2]));
    assert_eq!(
        image(12, 1, &[0xab, 0xcd, 0xef]),
        ("uint12".into(), SampleType::U16, vec![0xbc, 0x0a, 0xef, 0x0d])
    );
    assert_eq!(image(8, 2, &[0xff, 1]), ("int8".into(), SampleType::I8, vec![0xff, 1]));
    let halves = [1f32, -2.0].map(f32::to_le_bytes).concat();
    assert_eq!(image(16, 3, &[0, 0x3c, 0, 0xc0]), ("half".into(), SampleType::F32, halves.clone()));
    assert_eq!(image(24, 3, &[0, 0, 0x3f, 0, 0, 0xc0]), ("float24".into(), SampleType::F32, halves));
}

#[test]
fn samples_that_are_not_read_have_a_command_that_converts_them() {
    for (image, expected) in [
        (Ifd::grey(1, 1, vec![0; 8]).short(258, &[64]).short(339, &[6]), "DERIVED_SUBDATASET:REAL:"),
        (Ifd::grey(1, 1, vec![0; 8]).short(258, &[64]).short(339, &[9]), "`gdal_translate -ot Float64 /"),
        (Ifd::grey(1, 1, vec![0; 2]).short(258, &[16]).short(262, &[6]), "YCbCr other than 3 samples"),
    ] {
        let Err(error) = whole(&file(&[image]), MEMORY) else { panic!("read: {expected}") };
        let text = error.to_string();
        assert!(
            text.contains(expected) && text.contains("gdal_translate") && !text.contains("IN "),
            "{text}"
        );
    }
}

#[test]
fn codings_that_are_not_read_are_named() {
    let deflate = |image: Ifd| image.short(259, &[8]);
    let grey = || Ifd::grey(2, 2, vec![0; 16]);
    for (image, expected) in [
        (deflate(grey()).short(317, &[4]), "predictor 4 (unknown)"),
        (deflate(grey()).short(258, &[12]).short(317, &[2]), "predictor 2 for uint12 samples, deflate"),
        (deflate(grey()).short(317, &[3]), "predictor 3 for uint8 samples, deflate"),
        (grey().short(259, &[7]).short(258, &[16]), "jpeg of uint16 samples"),
        (grey().short(259, &[4]), "fax of 1 uint8 samples"),
        (grey().short(259, &[34887]), "compression 34887 (LERC)"),
        (
            deflate(grey()).short(262, &[6]).short(258, &[8; 3]).short(277, &[3]).short(317, &[2]),
            "subsampled colour with a predictor",
        ),
        (
            grey().short(262, &[5]).short(277, &[4]).short(284, &[2]).chunks(&vec![vec![0; 4]; 4]),
            "CMYK colour in 4 planes of 4 uint8 samples",
        ),
    ] {
        let Err(error) = whole(&file(&[image]), MEMORY) else { panic!("read: {expected}") };
        let text = error.to_string();
        assert!(matches!(error, Error::Unsupported { .. }) && text.contains(expected), "{text}");
        assert!(text.contains("gdal_translate -co COMPRESS=ZSTD"), "{text}");
    }
}

#[test]
fn gdal_metadata_name_bands_and_classes() {
    let xml = "<GDALMetadata><Item name=\"A\">x &lt; y</Item>\
        <Item name=\"DESCRIPTION\" sample=\"1\" role=\"description\">near &amp;lt; infrared</Item>\
        <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.5</Item>\
        <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">-3</Item>\
        <GDALRasterAttributeTable>\
        <FieldDefn index=\"0\"><Name>V</Name><Usage>5</Usage></FieldDefn>\
        <FieldDefn index=\"1\"><Name>N</Name><Usage>2</Usage></FieldDefn>\
        <Row index=\"0\"><F>11</F><F>Open water</F></Row><Row index=\"1\"><F>12</F><F></F></Row>\
        </GDALRasterAttributeTable></GDALMetadata>";
    let image = Ifd::grey(1, 1, vec![1, 2]).short(277, &[2]).tag(42112, Values::Text(xml));
    let (info, _) = whole(&file(&[image.short(338, &[2])]), MEMORY).unwrap();
    // GDAL escapes values twice.
    assert_eq!(info.band_names, ["", "near < infrared"]);
    assert_eq!(info.scale_offset, [(0.5, -3.0), (1.0, 0.0)]);
    assert_eq!(info.class_names, [(11.into(), "Open water".into()), (12.into(), "".into())]);
    assert_eq!(info.tags, [("A".into(), "x < y".into())].into());
    assert_eq!((info.channels, info.alpha), (2, Some(1)));
}

#[test]
fn palettes_have_eight_bits_and_clear_nodata() {
    let map: Vec<u16> = [0, 1, 2, 3].iter().flat_map(|n| [n * 257; 4]).take(12).collect();
    let image = Ifd::grey(4, 1, vec![0b0001_1011]).short(258, &[2]).short(262, &[3]).short(320, &map);
    let (info, pixels) = whole(&file(&[image.tag(42113, Values::Text("2"))]), MEMORY).unwrap();
    assert_eq!(info.palette.unwrap().colours, [[0, 1, 2, 255], [0, 1, 2, 255], [0, 1, 2, 0], [0, 1, 2, 255]]);
    assert_eq!(info.kind, Some(DataKind::Categorical));
    assert_eq!(pixels.bytes, [0, 1, 2, 3]);
}

#[test]
fn white_is_zero_stays_so_and_has_grey_levels() {
    let (info, pixels) =
        whole(&file(&[Ifd::grey(2, 1, vec![0x3f]).short(258, &[4]).short(262, &[0])]), MEMORY).unwrap();
    assert_eq!(pixels.bytes, [3, 15]);
    assert_eq!(info.palette.unwrap().colours[3], [204, 204, 204, 255]);
    assert_eq!(info.kind, None);
}

#[test]
fn large_plain_strips_need_little_memory() {
    let strip: Vec<u8> = (0..4000 * 1000).map(|i| (i / 4000 % 251) as u8).collect();
    let bytes = file(&[Ifd::grey(4000, 1000, strip.clone())]);
    let (info, pixels) = whole(&bytes, MEMORY).unwrap();
    assert_eq!((pixels.bytes, info.order), (strip.clone(), Order::Bands));
    let strips = [strip[..600 * 4000].to_vec(), strip[600 * 4000..].to_vec()];
    let two = Ifd::grey(4000, 1000, vec![]).short(278, &[600]).chunks(&strips);
    assert_eq!(whole(&file(&[two]), MEMORY).unwrap().1.bytes, strip);
    // A compressed strip has to be decoded as a whole.
    let error = whole(&file(&[Ifd::grey(4000, 1000, strip).short(259, &[8])]), MEMORY).unwrap_err();
    assert!(matches!(error, Error::TooLarge { needed: 4_000_000, .. }), "{error}");
    assert!(error.to_string().contains("--memory"));
}

#[test]
fn missing_data_are_an_error_that_names_the_place() {
    let image = Ifd::grey(4, 4, vec![]).short(278, &[2]);
    let mut bytes = file(&[image.chunks(&[vec![1; 8], vec![2; 8]])]);
    // The second strip's offset in the table, which is the first out-of-line value.
    bytes[8 + 16 + 4..8 + 16 + 8].copy_from_slice(&1000u32.to_le_bytes());
    let file = on_disk(&bytes);
    let mut raster = raster::open(file.path(), &RasterOptions::default()).unwrap();
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, 4, 2), &mut pixels).unwrap();
    assert_eq!(pixels.bytes, [1; 8]);
    let error = raster.read(Region::new(0, 1, 4, 2), &mut pixels).unwrap_err();
    assert!(
        matches!(&error, Error::Corrupt { location: place, .. } if place == "strip at column 0, row 2"),
        "{error}"
    );
    assert!(matches!(raster.read(Region::new(1, 0, 4, 1), &mut pixels), Err(Error::Invalid { .. })));
}
