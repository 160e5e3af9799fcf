//! Bands of TIFF files, of any number and type, single and several.

use std::path::Path;

use spinney::import::raster::{ImportOptions, plan};
use spinney::raw::import::raster::{self, Band, Pixels, Raster};
use spinney::{Number, Output, Region};

use crate::common::tiff_file::{Ifd, Values, file, on_disk};
use crate::common::{Random, with};

/// Sample types: bits and format number in the file, and bytes per sample as read.
const TYPES: [(u16, u16, usize); 8] =
    [(8, 1, 1), (16, 1, 2), (16, 2, 2), (32, 1, 4), (32, 2, 4), (32, 3, 4), (64, 3, 8), (4, 1, 1)];

/// An image of random samples, and the samples of each band as read.
struct RandomImage {
    size: [usize; 2],
    bands: Vec<Vec<u8>>,
    sample: usize,
    /// Chunks; by plane if the image is planar.
    chunks: Vec<Vec<u8>>,
    ifd: Ifd,
}

/// Packs samples of half a byte, upper half first, row by row.
fn packed(samples: &[u8], row: usize) -> Vec<u8> {
    let rows = samples.chunks(row);
    rows.flat_map(|row| row.chunks(2).map(|pair| pair[0] << 4 | pair.get(1).copied().unwrap_or(0))).collect()
}

impl RandomImage {
    fn random(random: &mut Random, bands: usize, planar: bool, tiled: bool) -> RandomImage {
        let size = [1 + random.below(60) as usize, 1 + random.below(40) as usize];
        let (bits, format, sample) = TYPES[random.below(TYPES.len() as u64) as usize];
        let mut byte = || random.below(if bits == 4 { 16 } else { 256 }) as u8;
        let planes: Vec<Vec<u8>> =
            (0..bands).map(|_| (0..size[0] * size[1] * sample).map(|_| byte()).collect()).collect();
        let chunk = if tiled { [32, 16] } else { [size[0], 7.min(size[1])] };
        let mut chunks = Vec::new();
        let groups: Vec<Vec<usize>> =
            if planar { (0..bands).map(|band| vec![band]).collect() } else { vec![(0..bands).collect()] };
        for group in groups {
            for top in (0..size[1]).step_by(chunk[1]) {
                for left in (0..size[0]).step_by(chunk[0]) {
                    let bottom = if tiled { top + chunk[1] } else { (top + chunk[1]).min(size[1]) };
                    let mut samples = Vec::new();
                    for (y, x) in (top..bottom).flat_map(|y| (left..left + chunk[0]).map(move |x| (y, x))) {
                        for band in &group {
                            let at = (y * size[0] + x) * sample;
                            let inside = x < size[0] && y < size[1];
                            let found =
                                if inside { &planes[*band][at..at + sample] } else { &[0; 8][..sample] };
                            samples.extend(found);
                        }
                    }
                    let row = chunk[0] * group.len();
                    chunks.push(if bits == 4 { packed(&samples, row) } else { samples });
                }
            }
        }
        let each = |value: u16| vec![value; bands];
        let ifd = Ifd::grey(size[0] as u16, size[1] as u16, Vec::new())
            .short(258, &each(bits))
            .short(339, &each(format))
            .short(277, &[bands as u16])
            .short(284, &[if planar { 2 } else { 1 }]);
        let ifd = if tiled {
            ifd.short(322, &[chunk[0] as u16]).short(323, &[chunk[1] as u16])
        } else {
            ifd.short(278, &[chunk[1] as u16])
        };
        RandomImage { size, bands: planes, sample, chunks, ifd }
    }

    /// Returns the samples of some bands of a region, as read.
    fn pixels(&self, region: Region, chosen: &[usize]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for y in region.y..region.bottom() {
            for x in region.x..region.right() {
                let at = (y as usize * self.size[0] + x as usize) * self.sample;
                chosen.iter().for_each(|band| bytes.extend(&self.bands[*band][at..at + self.sample]));
            }
        }
        bytes
    }
}

fn open(path: &Path, bands: &[usize]) -> Box<dyn Raster> {
    let raster = raster::open(path, &Default::default()).unwrap();
    let bands: Vec<Band> = bands.iter().map(|band| Band::Number(band + 1)).collect();
    raster::select(raster, &bands).unwrap()
}

#[test]
fn any_bands_are_read_alone() {
    let mut random = Random(41);
    for case in 0..120 {
        let bands = 1 + random.below(40) as usize;
        let (planar, tiled) = (case % 2 == 0, case % 4 < 2);
        let image = RandomImage::random(&mut random, bands, planar, tiled);
        let on_disk = on_disk(&file(&[image.ifd.clone().chunks(&image.chunks)]));
        for _ in 0..3 {
            let count = 1 + random.below(bands.min(5) as u64) as usize;
            let chosen: Vec<usize> = (0..count).map(|_| random.below(bands as u64) as usize).collect();
            let mut raster = open(on_disk.path(), &chosen);
            assert_eq!(raster.info().channels, count);
            let [width, height] = image.size.map(|side| side as u64);
            let mut pixels = Pixels::default();
            for _ in 0..3 {
                let (x, y) = (random.below(width), random.below(height));
                let region = Region::new(x, y, 1 + random.below(width - x), 1 + random.below(height - y));
                raster.read(region, &mut pixels).unwrap();
                let what = format!("case {case}: {bands} bands, {chosen:?} in {region:?}");
                assert!(pixels.bytes == image.pixels(region, &chosen), "{what}");
                // A selection of a selection.
                let mut first =
                    raster::select(open(on_disk.path(), &chosen), &[Band::Number(count)]).unwrap();
                first.read(region, &mut pixels).unwrap();
                assert!(pixels.bytes == image.pixels(region, &chosen[count - 1..]), "{what}");
            }
        }
    }
}

#[test]
fn planes_of_unselected_bands_are_not_read() {
    let mut random = Random(42);
    let mut image = RandomImage::random(&mut random, 6, true, true);
    // All planes except one are truncated.
    let tiles = image.chunks.len() / 6;
    for (index, chunk) in image.chunks.iter_mut().enumerate() {
        if index / tiles != 4 {
            chunk.truncate(1);
        }
    }
    let on_disk = on_disk(&file(&[image.ifd.clone().chunks(&image.chunks)]));
    let [width, height] = image.size.map(|side| side as u64);
    let whole = Region::new(0, 0, width, height);
    let mut pixels = Pixels::default();
    open(on_disk.path(), &[4]).read(whole, &mut pixels).unwrap();
    assert!(pixels.bytes == image.pixels(whole, &[4]));
    assert!(open(on_disk.path(), &[4, 3]).read(whole, &mut pixels).is_err());
}

#[test]
fn numbers_of_64_bits_are_read() {
    // 64-bit integers are unchanged in each band.
    let samples = [3u64, u64::MAX, 5, u64::MAX - 1].map(u64::to_le_bytes).concat();
    let ifd = Ifd::grey(2, 1, samples).short(258, &[64, 64]).short(277, &[2]).short(339, &[1, 1]);
    let on_disk = on_disk(&file(&[ifd]));
    let mut pixels = Pixels::default();
    open(on_disk.path(), &[0]).read(Region::new(0, 0, 2, 1), &mut pixels).unwrap();
    assert_eq!(pixels.bytes, [3u64, 5].map(u64::to_le_bytes).concat());
    open(on_disk.path(), &[1]).read(Region::new(0, 0, 2, 1), &mut pixels).unwrap();
    assert_eq!(pixels.bytes, [u64::MAX, u64::MAX - 1].map(u64::to_le_bytes).concat());
}

const NAMES: &str = "<GDALMetadata>
  <Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">B02, blue</Item>
  <Item name=\"DESCRIPTION\" sample=\"4\" role=\"description\">B08</Item>
</GDALMetadata>";

#[test]
fn names_choose_bands_and_many_are_refused() {
    let ifd = Ifd::grey(1, 1, vec![10, 20, 30, 40, 50]).short(258, &[8; 5]).short(277, &[5]);
    let input = on_disk(&file(&[ifd.tag(42112, Values::Text(NAMES))]));
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("t.goblin");
    let plan = |bands: Option<&str>| {
        let options = with(ImportOptions::new(), |it| {
            it.bands = bands.map(|bands| bands.split(',').map(|band| band.parse().unwrap()).collect());
        });
        plan(&[input.path().to_path_buf()], &options)
    };
    for (bands, expected) in [("B08", &[50.0][..]), ("B08,B02,2", &[50.0, 10.0, 20.0])] {
        plan(Some(bands)).unwrap().build(Output::create(&out).unwrap(), &()).unwrap();
        let mut found = [Number::default(); 4];
        assert!(spinney::open(&out).unwrap().point([0; 3], 0, &mut found).unwrap());
        let numbers: Vec<f64> = found[..expected.len()].iter().map(|number| number.to_f64()).collect();
        assert_eq!(numbers, expected);
    }
    let message = |bands| plan(bands).err().unwrap().to_string();
    assert!(message(Some("B03")).contains("1 (B02, blue), 2, 3, 4, 5 (B08)"), "{}", message(Some("B03")));
    let many = message(None);
    assert!(many.contains("5 bands") && many.contains("--stack") && many.contains("--band"), "{many}");
}
