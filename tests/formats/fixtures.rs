//! The images in `fixtures/` are read with their source values.

use std::path::Path;

use spinney::raw::import::raster::{self, Pixels, RasterInfo, RasterOptions};
use spinney::{DataKind, Region, SampleType};

use crate::frozen_files as frozen;
use crate::island::{self, COLOURS, HEIGHT, WIDTH};

fn read(name: &str) -> (RasterInfo, Pixels) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
    let mut raster = raster::open(&path, &RasterOptions::default()).unwrap();
    let info = raster.info().clone();
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, info.width, info.height), &mut pixels).unwrap();
    (info, pixels)
}

#[test]
fn classes() {
    let classes: Vec<u8> = island::make().cover.iter().map(|cover| *cover as u8).collect();
    for name in ["island_classes.png", "island_classes.tif"] {
        let (info, pixels) = read(name);
        assert_eq!((info.width, info.height), (WIDTH as u64, HEIGHT as u64));
        assert_eq!((info.sample, info.channels, info.kind), (SampleType::U8, 1, Some(DataKind::Categorical)));
        let colours = info.palette.unwrap().colours;
        assert_eq!(colours[1..8], COLOURS[1..]);
        assert!(pixels.bytes == classes, "{name}");
        let void =
            |i: usize| info.nodata == Some(classes[i].into()) || pixels.valid.as_ref().is_some_and(|v| !v[i]);
        assert!((0..classes.len()).all(|i| void(i) == (classes[i] == 0)), "{name}");
    }
    assert_eq!(read("island_classes.tif").0.frame, frozen::frame());
}

#[test]
fn elevation() {
    let (info, pixels) = read("island_elevation.tif");
    assert_eq!(
        (info.sample, info.nodata, info.frame),
        (SampleType::F32, Some((-9999).into()), frozen::frame())
    );
    let heights: Vec<u8> = island::make()
        .elevation()
        .iter()
        .flat_map(|height| height.unwrap_or(-9999.0).to_le_bytes())
        .collect();
    assert!(pixels.bytes == heights);
}

#[test]
fn rgb() {
    let (info, pixels) = read("island_rgb.png");
    assert_eq!((info.sample, info.channels, info.alpha), (SampleType::U8, 3, None));
    assert!(pixels.bytes == island::make().image().concat());
}

#[test]
fn classic() {
    let (info, pixels) = read("classic.png");
    assert_eq!(info.kind, Some(DataKind::Categorical));
    assert_eq!(pixels.bytes, frozen::CLASSIC.concat());
}
