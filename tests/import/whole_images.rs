//! Formats that are decoded as a whole: BMP, GIF, PNM, TGA, QOI, Radiance HDR and animated WebP.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::codecs::gif::GifEncoder;
use image::codecs::hdr::HdrEncoder;
use image::{DynamicImage, Frame as GifFrame, GrayImage, ImageFormat, Rgb, RgbImage, Rgba, RgbaImage};
use spinney::import::raster::{ImportOptions, plan};
use spinney::raw::import::raster::{Pixels, RasterInfo, RasterOptions, open};
use spinney::{Error, Frame, Number, Output, Region, Result, SampleType};

use crate::common::{Random, with};

const WIDTH: usize = 7;
const HEIGHT: usize = 5;

fn read(path: &Path, memory: u64) -> Result<(RasterInfo, Vec<u8>)> {
    let mut raster = open(path, &with(RasterOptions::new(), |it| it.memory = memory))?;
    let info = raster.info().clone();
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, info.width, info.height), &mut pixels)?;
    assert!(pixels.valid.is_none());
    Ok((info, pixels.bytes))
}

fn read_bytes(name: &str, bytes: &[u8]) -> Result<(RasterInfo, Vec<u8>)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    fs::write(&path, bytes).unwrap();
    read(&path, 1 << 20)
}

fn random_bytes(noise: &mut Random, count: usize) -> Vec<u8> {
    (0..count).map(|_| noise.next() as u8).collect()
}

fn pnm(header: &str, samples: &[u8]) -> Vec<u8> {
    [header.as_bytes(), samples].concat()
}

/// Returns a BMP file with 24 bits per pixel, or a palette of 256 colors. Rows are bottom-up unless
/// `is_top_down`.
fn bmp(size: [usize; 2], rgb: &[u8], palette: Option<&[[u8; 3]]>, is_top_down: bool) -> Vec<u8> {
    let [width, height] = size;
    let bits = if palette.is_some() { 8u16 } else { 24 };
    let row = (width * usize::from(bits) / 8).next_multiple_of(4);
    let offset = 54 + palette.map_or(0, |palette| 4 * palette.len());
    let signed = if is_top_down { -(height as i32) } else { height as i32 };
    let mut file = b"BM".to_vec();
    for word in [offset + row * height, 0, offset, 40, width] {
        file.extend((word as u32).to_le_bytes());
    }
    file.extend(signed.to_le_bytes());
    file.extend(1u16.to_le_bytes());
    file.extend(bits.to_le_bytes());
    for word in [0, row * height, 0, 0, palette.map_or(0, <[_]>::len), 0] {
        file.extend((word as u32).to_le_bytes());
    }
    for [red, green, blue] in palette.into_iter().flatten() {
        file.extend([*blue, *green, *red, 0]);
    }
    for y in 0..height {
        let y = if is_top_down { y } else { height - 1 - y };
        let pixels = rgb[3 * y * width..].chunks_exact(3).take(width);
        let start = file.len();
        match palette {
            None => file.extend(pixels.flat_map(|pixel| pixel.iter().rev())),
            Some(palette) => file
                .extend(pixels.map(|pixel| palette.iter().position(|entry| entry == pixel).unwrap() as u8)),
        }
        file.resize(start + row, 0);
    }
    file
}

/// Returns an uncompressed TGA file, top-down.
fn tga(channels: u8, samples: &[u8]) -> Vec<u8> {
    let is_color = channels >= 3;
    let alpha_bits = if channels.is_multiple_of(2) { 8 } else { 0 };
    let mut file = vec![0; 18];
    file[2] = if is_color { 2 } else { 3 };
    (file[12], file[14]) = (WIDTH as u8, HEIGHT as u8);
    (file[16], file[17]) = (8 * channels, 0x20 | alpha_bits);
    for pixel in samples.chunks_exact(channels.into()) {
        let mut pixel = pixel.to_vec();
        if is_color {
            pixel.swap(0, 2);
        }
        file.extend(pixel);
    }
    file
}

/// Returns a QOI file that stores each pixel in full.
fn qoi(channels: u8, samples: &[u8]) -> Vec<u8> {
    let mut file = b"qoif".to_vec();
    file.extend((WIDTH as u32).to_be_bytes());
    file.extend((HEIGHT as u32).to_be_bytes());
    file.extend([channels, 0]);
    for pixel in samples.chunks_exact(channels.into()) {
        file.push(if channels == 3 { 0xfe } else { 0xff });
        file.extend(pixel);
    }
    file.extend([0, 0, 0, 0, 0, 0, 0, 1]);
    file
}

fn gif(frames: &[RgbaImage]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = GifEncoder::new(&mut file);
    frames.iter().for_each(|frame| encoder.encode_frame(GifFrame::new(frame.clone())).unwrap());
    drop(encoder);
    file
}

/// Returns a Radiance file with uncompressed mantissas and exponents.
fn hdr(header: &str, rgbe: &[[u8; 4]]) -> Vec<u8> {
    [header.as_bytes(), format!("-Y {HEIGHT} +X {WIDTH}\n").as_bytes(), rgbe.as_flattened()].concat()
}

/// Few colors, so that GIF and palettes can store them; some are transparent.
fn rgba(seed: u64) -> RgbaImage {
    let mut noise = Random(seed);
    RgbaImage::from_fn(WIDTH as u32, HEIGHT as u32, |_, _| {
        let color = noise.below(20) as u8;
        if color == 0 { Rgba([0; 4]) } else { Rgba([color * 12, color ^ 77, 255 - color, 255]) }
    })
}

/// A file (name, bytes) with its expected samples: type, number of channels, bytes.
type ImageCase = (&'static str, Vec<u8>, SampleType, usize, Vec<u8>);

/// Returns a file of each kind.
fn files(seed: u64) -> Vec<ImageCase> {
    let mut noise = Random(seed);
    let pixels = WIDTH * HEIGHT;
    let gray = random_bytes(&mut noise, pixels);
    let rgb = random_bytes(&mut noise, 3 * pixels);
    let translucent = random_bytes(&mut noise, 4 * pixels);
    let deep = random_bytes(&mut noise, 2 * pixels);
    let little: Vec<u8> = deep.chunks_exact(2).flat_map(|pair| [pair[1], pair[0]]).collect();
    let few = rgba(seed);
    let few_rgb = DynamicImage::from(few.clone()).into_rgb8();
    let mut palette: Vec<[u8; 3]> = few_rgb.pixels().map(|pixel| pixel.0).collect();
    palette.sort();
    palette.dedup();
    let text: String = gray.iter().map(|sample| format!("{sample}\n")).collect();
    let size = format!("{WIDTH} {HEIGHT}");
    let pam = |depth: u8, maximum: u32, kind: &str| {
        format!("P7\nWIDTH {WIDTH}\nHEIGHT {HEIGHT}\nDEPTH {depth}\nMAXVAL {maximum}\n{kind}ENDHDR\n")
    };
    let encoded = |image: &DynamicImage, format| {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, format).unwrap();
        file.into_inner()
    };
    let dynamic: DynamicImage = RgbImage::from_raw(WIDTH as u32, HEIGHT as u32, rgb.clone()).unwrap().into();
    let dynamic_gray: DynamicImage =
        GrayImage::from_raw(WIDTH as u32, HEIGHT as u32, gray.clone()).unwrap().into();
    let rgbe: Vec<[u8; 4]> = rgb.chunks_exact(3).map(|c| [c[0], c[1] | 128, c[2], 120 + c[0] % 16]).collect();
    let floats = rgbe.iter().flat_map(|[r, g, b, e]| {
        let scale = 2f32.powi(i32::from(*e) - 128 - 8);
        [r, g, b].map(|mantissa| f32::from(*mantissa) * scale)
    });
    let floats: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
    use SampleType::{F32, U8, U16};
    vec![
        ("a.bmp", bmp([WIDTH, HEIGHT], &rgb, None, false), U8, 3, rgb.clone()),
        ("b.bmp", bmp([WIDTH, HEIGHT], &rgb, None, true), U8, 3, rgb.clone()),
        ("c.bmp", bmp([WIDTH, HEIGHT], &few_rgb, Some(&palette), false), U8, 3, few_rgb.to_vec()),
        ("d.bmp", encoded(&dynamic, ImageFormat::Bmp), U8, 3, rgb.clone()),
        ("a.gif", gif(std::slice::from_ref(&few)), U8, 4, few.to_vec()),
        ("a.pgm", pnm(&format!("P5 {size} 255\n"), &gray), U8, 1, gray.clone()),
        ("b.pgm", pnm(&format!("P5\n# one\n{size}\n65535\n"), &deep), U16, 1, little.clone()),
        ("c.pgm", pnm(&format!("P2\n{size} 255\n"), text.as_bytes()), U8, 1, gray.clone()),
        ("a.ppm", pnm(&format!("P6\n{size} 255\n"), &rgb), U8, 3, rgb.clone()),
        ("a.pam", pnm(&pam(4, 255, "TUPLTYPE RGB_ALPHA\n"), &translucent), U8, 4, translucent.clone()),
        ("b.pam", pnm(&pam(1, 65535, ""), &deep), U16, 1, little),
        ("a.tga", tga(1, &gray), U8, 1, gray.clone()),
        ("b.tga", tga(3, &rgb), U8, 3, rgb.clone()),
        ("c.tga", tga(4, &translucent), U8, 4, translucent.clone()),
        ("d.tga", encoded(&dynamic, ImageFormat::Tga), U8, 3, rgb.clone()),
        ("e.tga", encoded(&dynamic_gray, ImageFormat::Tga), U8, 1, gray),
        ("a.qoi", qoi(3, &rgb), U8, 3, rgb.clone()),
        ("b.qoi", qoi(4, &translucent), U8, 4, translucent),
        ("c.qoi", encoded(&dynamic, ImageFormat::Qoi), U8, 3, rgb),
        ("a.hdr", hdr("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n", &rgbe), F32, 3, floats.clone()),
        ("b.hdr", hdr("#?RGBE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n", &rgbe), F32, 3, floats),
    ]
}

#[test]
fn samples_are_those_of_the_file() {
    for seed in 1..=20 {
        for (name, bytes, sample, channels, samples) in files(seed) {
            let (info, found) = read_bytes(name, &bytes).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!((info.width, info.height), (WIDTH as u64, HEIGHT as u64), "{name}");
            assert_eq!((info.sample, info.channels), (sample, channels), "{name}");
            assert_eq!(info.alpha, (channels == 4).then_some(3), "{name}");
            assert_eq!(info.stored_sample, if sample == SampleType::F32 { "rgbe" } else { sample.name() });
            assert_eq!(info.remark, None, "{name}");
            assert!(found == samples, "{name}, seed {seed}");
        }
    }
}

#[test]
fn trees_have_the_pixels_of_the_image() {
    let directory = tempfile::tempdir().unwrap();
    let tree = directory.path().join("t.goblin");
    for (name, bytes, sample, channels, samples) in files(3) {
        let path = directory.path().join(name);
        fs::write(&path, bytes).unwrap();
        plan(&[path], &ImportOptions::new()).unwrap().build(Output::create(&tree).unwrap(), &()).unwrap();
        let opened = spinney::open(&tree).unwrap();
        for (pixel, at) in samples.chunks_exact(sample.size() * channels).zip(0..) {
            let (x, y) = (at % WIDTH as u64, at / WIDTH as u64);
            let mut numbers = [Number::default(); 4];
            let is_there = opened.point([x, y, 0], opened.depth(), &mut numbers).unwrap();
            let is_transparent = channels == 4 && pixel[3] == 0;
            assert_eq!(is_there, !is_transparent, "{name}: {x}, {y}");
            let expected = pixel.chunks_exact(sample.size()).map(|bytes| match *bytes {
                [byte] => f64::from(byte),
                [low, high] => f64::from(u16::from_le_bytes([low, high])),
                _ => f64::from(f32::from_le_bytes(bytes.try_into().unwrap())),
            });
            for (found, expected) in numbers.iter().zip(expected).filter(|_| is_there) {
                assert_eq!(found.to_f64(), expected, "{name}: {x}, {y}");
            }
        }
    }
}

#[test]
fn pnm_keeps_samples_below_the_full_range() {
    let (info, samples) = read_bytes("a.pgm", b"P5 3 1 1023\n\x00\x00\x03\xff\x01\x02").unwrap();
    assert_eq!((info.sample, info.stored_sample.as_str()), (SampleType::U16, "uint10"));
    assert_eq!(info.layout, "PGM, maximum 1023");
    assert_eq!(samples, [0, 0, 0xff, 3, 2, 1]);
    let (info, samples) = read_bytes("a.pgm", b"P2 # text\n3 1\n15\n0 15 7\n").unwrap();
    assert_eq!((info.stored_sample.as_str(), info.layout.as_str()), ("uint4", "PGM, text, maximum 15"));
    assert_eq!(samples, [0, 15, 7]);
    assert_eq!(read_bytes("a.ppm", b"P6 1 1 99\n\x01\x02\x63").unwrap().1, [1, 2, 99]);
    // Opacity is a share of the maximum; colors are numbers.
    let pam = b"P7\nWIDTH 3\nHEIGHT 1\nDEPTH 2\nMAXVAL 100\nTUPLTYPE GRAYSCALE_ALPHA\nENDHDR\n\x00\x00\x05\x64\x64\x32";
    let (info, samples) = read_bytes("a.pam", pam).unwrap();
    assert_eq!((info.alpha, samples), (Some(1), vec![0, 0, 5, 255, 100, 128]));
    // For single bits, 255 is white.
    let (info, samples) = read_bytes("a.pbm", b"P4 10 2\n\xaa\x80\x00\x40").unwrap();
    assert_eq!((info.stored_sample.as_str(), info.layout.as_str()), ("uint1", "PBM"));
    assert_eq!(samples[..10], [0, 255, 0, 255, 0, 255, 0, 255, 0, 255]);
    assert_eq!(samples[18..], [255, 0]);
    assert_eq!(read_bytes("a.pbm", b"P1\n3 1\n1 01\n").unwrap().1, [0, 255, 0]);
    for (name, file) in [
        ("above the maximum", &b"P5 1 1 1023\n\x04\x00"[..]),
        ("above the maximum", b"P2 1 1 15\n16\n"),
        ("no maximum", b"P5 1 1 0\n\x00"),
        ("a maximum of 17 bits", b"P5 1 1 65536\n\x00\x00\x00"),
        ("no pixels", b"P5 0 1 255\n"),
        ("letters", b"P5 a 1 255\n\x00"),
        ("less than it needs", b"P6 1 1 255\n\x00\x00"),
    ] {
        assert!(matches!(read_bytes("a", file), Err(Error::Corrupt { .. })), "{name}");
    }
    let five = b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 5\nMAXVAL 255\nTUPLTYPE BANDS\nENDHDR\n\x01\x02\x03\x04\x05";
    assert!(matches!(read_bytes("a", five), Err(Error::Unsupported { .. })));
}

#[test]
fn ignored_content_is_warned_about() {
    let remark = |name: &str, bytes: &[u8]| read_bytes(name, bytes).unwrap().0.remark;
    let frames = gif(&[rgba(1), rgba(2), rgba(3)]);
    assert_eq!(read_bytes("a.gif", &frames).unwrap().1, rgba(1).to_vec());
    assert_eq!(remark("a.gif", &frames).as_deref(), Some("frames after the first of 3 are not read"));
    let images = b"P5 1 1 255\n\x07P5 1 1 255\n\x08";
    assert_eq!(remark("a.pgm", images).as_deref(), Some("images after the first are not read"));
    assert_eq!(remark("a.pgm", b"P5 1 1 255\n\x07\n"), None);
    // 10 bits of red, green and blue.
    let mut deep = bmp([1, 1], &[0; 3], None, false);
    (deep[28], deep[30]) = (32, 3);
    let offset = 54 + 12;
    deep[10] = offset;
    deep.truncate(54);
    deep.extend(
        [1023u32 << 20, 1023 << 10, 1023, 1023 << 20 | 512 << 10].iter().flat_map(|word| word.to_le_bytes()),
    );
    let (info, samples) = read_bytes("a.bmp", &deep).unwrap();
    assert_eq!(samples, [255, 128, 0]);
    assert!(info.remark.is_some_and(|remark| remark.contains("bits of samples after the eighth")));
    // A comment, and a frame that is smaller than the image.
    let mut commented = gif(&[rgba(1)]);
    let trailer = commented.pop().unwrap();
    commented.extend(b"\x21\xfe\x05hello\x02, \x00");
    commented.push(trailer);
    assert_eq!(read_bytes("a.gif", &commented).unwrap().0.tags["Comment"], "hello,");
}

#[test]
fn header_variables_of_radiance_maps_are_tags() {
    let header =
        "#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE=0.5\npfilt -1 a.hdr\n\n";
    let file = hdr(header, &[[1, 2, 3, 128]; WIDTH * HEIGHT]);
    let tags = read_bytes("a.hdr", &file).unwrap().0.tags;
    assert_eq!((tags["EXPOSURE"].as_str(), tags["commands"].as_str()), ("2\n0.5", "pfilt -1 a.hdr"));
    let mut compressed = Vec::new();
    let colors: Vec<Rgb<f32>> = (0..WIDTH * HEIGHT).map(|i| Rgb([i as f32, 0.5, 1e6])).collect();
    HdrEncoder::new(&mut compressed).encode(&colors, WIDTH, HEIGHT).unwrap();
    let (_, samples) = read_bytes("a.hdr", &compressed).unwrap();
    for (found, color) in samples.chunks_exact(12).zip(&colors) {
        let blue = f32::from_le_bytes(found[8..].try_into().unwrap());
        assert!((blue - color.0[2]).abs() < 1e4);
    }
    for wrong in ["FORMAT=32-bit_rle_xyze\n\n", "\n+Y 1 +X 1\n"] {
        let file = [b"#?RADIANCE\n", wrong.as_bytes(), b"-Y 1 +X 1\n\0\0\0\0"].concat();
        assert!(matches!(read_bytes("a.hdr", &file), Err(Error::Unsupported { .. })), "{wrong}");
    }
}

#[test]
fn content_decides_and_not_the_name() {
    let named: Vec<_> = files(5).into_iter().filter(|(name, ..)| !name.ends_with(".tga")).collect();
    for (name, bytes, _, _, samples) in &named {
        for other in ["x.png", "x", "x.tga", "x.HDR"] {
            assert!(read_bytes(other, bytes).unwrap().1 == *samples, "{name} as {other}");
        }
    }
    let (_, tga, _, _, samples) = files(5).into_iter().find(|(name, ..)| *name == "b.tga").unwrap();
    assert_eq!(read_bytes("x.TGA", &tga).unwrap().1, samples);
    assert!(matches!(read_bytes("x.bmp", &tga), Err(Error::Unsupported { .. })));
    assert!(read_bytes("x.tga", b"some text that is no image").is_err());
    // Text that begins with the letters of a format.
    for text in ["BMX is a sport, and more than that", "P5", "P8 1 1 255\n1", "GIF80a", "#!RADIANCE"] {
        let read = read_bytes("x", text.as_bytes());
        assert!(matches!(read, Err(Error::Unsupported { .. } | Error::Corrupt { .. })), "{text}");
    }
}

#[test]
fn sidecars_georeference_images() {
    let directory = tempfile::tempdir().unwrap();
    let worlds = ["bpw", "gfw", "pmw", "ppmw", "tgaw", "qoiw", "wld"];
    let names = ["a.bmp", "a.gif", "a.pgm", "a.ppm", "a.tga", "a.qoi", "a.hdr"];
    for (name, world) in names.into_iter().zip(worlds) {
        let (_, bytes, ..) = files(7).into_iter().find(|(other, ..)| *other == name).unwrap();
        let path = directory.path().join(name);
        fs::write(&path, bytes).unwrap();
        fs::write(path.with_extension(world), "2\n0\n0\n-2\n101\n199\n").unwrap();
        let xml = "<PAMDataset><PAMRasterBand band=\"1\"><Description>first</Description></PAMRasterBand></PAMDataset>";
        fs::write(directory.path().join(format!("{name}.aux.xml")), xml).unwrap();
        let raster = open(&path, &RasterOptions::default()).unwrap();
        assert_eq!(raster.info().frame, Frame::planar([2.0, 0.0, 100.0, 0.0, -2.0, 200.0]), "{name}");
        assert_eq!(raster.info().band_names[0], "first");
        fs::remove_file(path.with_extension(world)).unwrap();
    }
}

/// A truncated file gives the samples of the complete file, or an error.
#[test]
fn truncated_files_are_errors() {
    // The first digits of a number in text are a different number.
    for (name, bytes, _, _, samples) in files(11).into_iter().filter(|(name, ..)| *name != "c.pgm") {
        for length in 0..bytes.len() {
            // Bytes after the samples may be missing.
            if let Ok((_, found)) = read_bytes(name, &bytes[..length]) {
                assert!(found == samples && bytes.len() - length <= 8, "{name}: {length} of {}", bytes.len());
            }
        }
    }
}

#[test]
fn sizes_in_headers_cause_no_allocation() {
    let word =
        |file: &mut [u8], at: usize, value: u32| file[at..at + 4].copy_from_slice(&value.to_le_bytes());
    let mut large_bmp = bmp([1, 1], &[1, 2, 3], None, false);
    word(&mut large_bmp, 18, 65_535);
    word(&mut large_bmp, 22, 65_535);
    let mut large_gif = gif(&[rgba(1)]);
    large_gif[6..10].fill(0xff);
    let mut large_tga = tga(3, &[0; 3 * WIDTH * HEIGHT]);
    large_tga[12..16].fill(0xff);
    let mut large_qoi = qoi(4, &[0; 4 * WIDTH * HEIGHT]);
    large_qoi[5] = 0x7f;
    for (name, file) in [
        ("a.bmp", large_bmp),
        ("a.gif", large_gif),
        ("a.tga", large_tga),
        ("a.qoi", large_qoi),
        ("a.pgm", b"P2 4000000000 4000000000 65535\n1 2".to_vec()),
        ("b.pgm", b"P5 65536 65536 65535\n\0\0".to_vec()),
        ("a.pbm", b"P1 4294967295 4294967295\n1".to_vec()),
        ("a.hdr", b"#?RADIANCE\n\n-Y 4000000000 +X 1000000000\n\0\0\0\0".to_vec()),
    ] {
        match read_bytes(name, &file) {
            Err(Error::TooLarge { advice, .. }) => assert!(advice.contains("--memory"), "{name}"),
            Err(Error::Corrupt { .. } | Error::Unsupported { .. }) => {}
            other => panic!("{name}: {other:?}"),
        }
    }
    // A frame that is larger than the image takes its own memory.
    let mut wide = gif(&[rgba(1)]);
    let frame = wide.windows(10).position(|part| part[0] == 0x2c && part[1..5] == [0; 4]).unwrap();
    wide[frame + 5..frame + 9].fill(0xff);
    assert!(matches!(read_bytes("a.gif", &wide), Err(Error::Unsupported { .. } | Error::Corrupt { .. })));
    // Unterminated text headers.
    for start in ["#?RADIANCE\n", "P7\nWIDTH 1\n#", "P5 1"] {
        let mut file = start.as_bytes().to_vec();
        file.resize(3 << 20, if start.starts_with("P5") { b'0' } else { b'a' });
        assert!(read_bytes("a", &file).is_err(), "{start}");
    }
    assert!(read_bytes("a.gif", b"GIF89a\x01\0\x01\0\0\0\0;").is_err(), "no frame");
}

#[test]
fn altered_files_are_harmless() {
    let mut noise = Random(17);
    for (name, bytes, ..) in files(13) {
        for _ in 0..200 {
            let mut altered = bytes.clone();
            for _ in 0..=noise.below(3) {
                let reach = if noise.below(2) == 0 { bytes.len() } else { bytes.len().min(64) };
                altered[noise.below(reach as u64) as usize] ^= 1 << noise.below(8);
            }
            // An image or an error.
            let _ = read_bytes(name, &altered);
        }
    }
}

/// Images of other programs, and their pixels as these programs decode them.
#[test]
fn images_of_other_programs() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/import/images/whole");
    let mut files: Vec<PathBuf> =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let (referees, images): (Vec<_>, Vec<_>) =
        files.into_iter().partition(|path| path.extension().is_some_and(|extension| extension == "png"));
    assert!(images.len() == referees.len() && images.len() >= 10);
    for (image, referee) in images.iter().zip(&referees) {
        let name = image.display();
        assert_eq!(referee.file_stem(), image.file_name());
        let (info, samples) = read(image, 1 << 20).unwrap();
        let (expected, expected_samples) = read(referee, 1 << 20).unwrap();
        assert_eq!((info.channels, info.sample), (expected.channels, expected.sample), "{name}");
        // Colors of transparent pixels are the decoder's choice.
        let visible = |samples: &[u8]| -> Vec<u8> {
            let pixels = samples.chunks_exact(info.channels * info.sample.size());
            pixels
                .flat_map(|pixel| match info.alpha {
                    Some(alpha) if pixel[alpha] == 0 => vec![0; pixel.len()],
                    _ => pixel.to_vec(),
                })
                .collect()
        };
        assert!(visible(&samples) == visible(&expected_samples), "{name}");
    }
}
