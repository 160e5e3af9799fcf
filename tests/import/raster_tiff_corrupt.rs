//! Corrupt TIFF files: an error or other pixels, but never a panic, a hang, or unbounded memory.

use std::path::Path;

use crate::common::command::{is_alone, own_peak_memory};
use crate::common::tiff_file::{Ifd, Values, file, on_disk};
use spinney::raw::import::raster::{self, Pixels, RasterOptions};
use spinney::{Region, Result};

use crate::common::with;

/// Opens and reads arbitrary bytes.
fn read(bytes: &[u8]) -> Result<Pixels> {
    let file = on_disk(bytes);
    let options = with(RasterOptions::new(), |it| it.memory = 4 << 20);
    let mut raster = raster::open(file.path(), &options)?;
    let info = raster.info();
    let region = Region::new(0, 0, info.width.min(200), info.height.min(200));
    let mut pixels = Pixels::default();
    // A pixel may have 65535 samples.
    if info.channels <= 16 {
        raster.read(region, &mut pixels)?;
    }
    Ok(pixels)
}

/// Small files that use many features of the format.
fn seeds() -> Vec<Vec<u8>> {
    let deflated = |bytes: &[u8]| {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        std::io::Write::write_all(&mut encoder, bytes).unwrap();
        encoder.finish().unwrap()
    };
    let tiles = Ifd::grey(20, 17, vec![])
        .short(258, &[16, 16])
        .short(277, &[2])
        .short(284, &[2])
        .short(317, &[2])
        .short(259, &[8])
        .short(322, &[16])
        .short(323, &[16])
        .tag(33550, Values::Double(vec![10.0, 10.0, 0.0]))
        .tag(33922, Values::Double(vec![0.0, 0.0, 0.0, 5.0, 6.0, 0.0]))
        .short(34735, &[1, 1, 0, 2, 1024, 0, 1, 1, 1026, 34737, 4, 0])
        .tag(34737, Values::Text("abc|"))
        .tag(
            42112,
            Values::Text(
                "<GDALMetadata><Item name=\"a\" sample=\"0\" role=\"scale\">2</Item></GDALMetadata>",
            ),
        )
        .tag(42113, Values::Text("-9999"))
        .chunks(&vec![deflated(&[7; 512]); 8]);
    let mask = Ifd::grey(20, 17, vec![0x55; 51])
        .short(254, &[4])
        .short(258, &[1])
        .short(278, &[4])
        .chunks(&[vec![0x55; 12], vec![0xaa; 12], vec![], vec![1; 12], vec![2; 3]]);
    let map: Vec<u16> = (0..48).map(|i| i * 1000).collect();
    let packbits = Ifd::grey(9, 3, vec![0xfc, 0x12, 0x04, 1, 2, 3, 4, 5, 0xfc, 9])
        .short(258, &[4])
        .short(262, &[3])
        .short(320, &map)
        .short(259, &[32773]);
    vec![file(&[tiles, mask]), file(&[packbits])]
}

#[test]
fn files_cut_at_any_byte() {
    for seed in seeds() {
        read(&seed).unwrap();
        for end in 0..seed.len() {
            let _ = read(&seed[..end]);
        }
    }
}

/// Pseudorandom numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % limit
    }
}

/// Reads a file with some of its bits flipped, many times.
fn flip(seed: &[u8], times: usize) {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    for _ in 0..times {
        let mut bytes = seed.to_vec();
        for _ in 0..=random.below(3) {
            bytes[random.below(seed.len())] ^= 1 << random.below(8);
        }
        let _ = read(&bytes);
    }
    assert!(own_peak_memory() < 100 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn files_with_turned_bits() {
    if !is_alone("raster_tiff_corrupt::files_with_turned_bits") {
        return;
    }
    for seed in seeds() {
        flip(&seed, 3000);
    }
}

#[test]
fn other_codecs_with_turned_bits() {
    if !is_alone("raster_tiff_corrupt::other_codecs_with_turned_bits") {
        return;
    }
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let data = std::env::var_os("SPINNEY_DATA").map_or(data, Into::into);
    for name in [
        "image_tiff/seq-1c-8b-lzw-hpredict-20f3db0c.tiff",
        "image_tiff/int16_zstd.tif",
        "image_tiff/fax4.tiff",
        "image_tiff/seq-1c-64f-deflate-fpredict-afa8560e.tiff",
        "gdal_gcore/byte_ovr_jpeg_tablesmode2.tif",
        "gdal_gcore/tif_jpeg_ycbcr_too_big_last_stripe.tif",
        "gdal_gcore/tif_webp.tif",
        "gdal_gcore/ycbcr_42_lzw.tif",
        "gdal_gcore/rgbsmall_cmyk.tif",
        "gdal_gcore/bigtiff_four_strip_be_short.tif",
    ] {
        match std::fs::read(data.join("raster").join(name)) {
            Ok(seed) => flip(&seed, 500),
            Err(_) => eprintln!("skipped: no {name}"),
        }
    }
}

#[test]
fn numbers_without_bound() {
    let long = |tag, value| file(&[Ifd::grey(4, 4, vec![0; 16]).tag(tag, Values::Long(vec![value]))]);
    for tag in [256, 257, 258, 277, 278, 317, 322, 338, 339, 34735, 42113] {
        for value in [0, 1, 1 << 16, 0x7fff_ffff, u32::MAX] {
            let _ = read(&long(tag, value));
        }
    }
    // 2^31 tiles of a pixel each, in a file of a few hundred bytes.
    let size = |tag, value| (tag, Values::Long(vec![value]));
    let tiles = [size(256, 1 << 16), size(257, 1 << 15), size(322, 1), size(323, 1)];
    let many = tiles.into_iter().fold(Ifd::grey(1, 1, vec![0]), |ifd, (tag, values)| ifd.tag(tag, values));
    assert!(read(&file(&[many])).is_err());
}

#[test]
fn directories_that_lead_to_themselves() {
    let image = Ifd::grey(4, 4, vec![3; 16]);
    let mut bytes = file(&[image.clone(), image]);
    let first = bytes[4..8].to_vec();
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&first);
    assert_eq!(read(&bytes).unwrap().bytes, [3; 16]);
}
