//! Tests of formats: checked, decoded, copied.

use std::io::Write;

use proptest::prelude::*;

use super::*;

/// Tiles of 4 x 2 pixels of one byte.
fn plain() -> ChunkFormat {
    ChunkFormat {
        chunk_width: 4,
        chunk_height: 2,
        samples: 1,
        planes: 1,
        sample_format: SampleFormat::Uint(8),
        compression: Compression::None,
        predictor: Predictor::None,
        colour: Colour::Keep,
        big_endian: false,
        lowest_first: false,
    }
}

fn jpeg_yuv() -> Yuv {
    Yuv::new([0.299, 0.587, 0.114])
}

fn decoded(format: &ChunkFormat, raw: &[u8], rows: usize) -> Result<Vec<u8>, String> {
    format.check().unwrap();
    let mut chunk = Vec::new();
    let result = format.decode(&mut DecoderStates::default(), &mut raw.to_vec(), rows, &mut chunk);
    result.map(|()| chunk)
}

fn copied(format: &ChunkFormat, chunk: &[u8], selection: &ChunkSelection<'_>, rows: usize) -> Vec<u8> {
    let pixel = format.sample_format.sample().size() * selection.chosen.len();
    let mut out = vec![0; selection.width * pixel * rows];
    let mut rows: Vec<&mut [u8]> = out.chunks_exact_mut(selection.width * pixel).collect();
    format.copy(&mut DecoderStates::default(), chunk, selection, &mut rows);
    out
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn invalid_formats_are_refused_with_a_reason() {
    type Change = fn(&mut ChunkFormat);
    let cases: &[(Change, &str)] = &[
        (|f| f.chunk_width = 0, "chunks of 0 columns"),
        (|f| f.chunk_height = 1 << 31, "chunks of 2147483648 rows"),
        (|f| f.samples = 0, "0 samples per pixel"),
        (|f| f.samples = 65536, "65536 samples per pixel"),
        (|f| (f.samples, f.planes) = (3, 2), "2 planes of 3 samples"),
        (|f| f.planes = 0, "0 planes"),
        (|f| f.sample_format = SampleFormat::Uint(0), "samples of 0 bits"),
        (|f| f.sample_format = SampleFormat::Uint(33), "samples of 33 bits"),
        (|f| f.sample_format = SampleFormat::Int(7), "samples of 7 bits"),
        (|f| f.sample_format = SampleFormat::Float(8), "samples of 8 bits"),
        (|f| f.predictor = Predictor::Horizontal, "predictor 2 for uint8 samples, uncompressed"),
        (
            |f| (f.predictor, f.compression) = (Predictor::Float, Compression::Lzw),
            "predictor 3 for uint8 samples, lzw",
        ),
        (
            |f| (f.compression, f.sample_format) = (Compression::WebP, SampleFormat::Uint(16)),
            "webp of uint16",
        ),
        (|f| f.compression = Compression::Fax4, "fax of 1 uint8"),
        (
            |f| {
                (f.compression, f.sample_format) = (Compression::Fax4, SampleFormat::Uint(1));
                f.chunk_width = 65536;
            },
            "fax of more than 65535",
        ),
        (|f| (f.compression, f.lowest_first) = (Compression::WebP, true), "webp with reversed bits"),
        (|f| f.colour = Colour::Cmyk, "CMYK colour in 1 planes of 1 uint8 samples"),
        (|f| (f.samples, f.colour) = (3, Colour::Jpeg), "YCbCr colour"),
        (|f| (f.samples, f.colour) = (3, Colour::Blocks(jpeg_yuv(), 3, 1)), "blocks of 3x1"),
        (
            |f| (f.samples, f.colour) = (3, Colour::Blocks(Yuv::new([f32::NAN, 1.0, 0.0]), 2, 2)),
            "shares of colours",
        ),
        (
            |f| {
                (f.samples, f.colour) = (3, Colour::Blocks(jpeg_yuv(), 2, 2));
                (f.predictor, f.compression) = (Predictor::Horizontal, Compression::Lzw);
            },
            "subsampled colour with a predictor",
        ),
        (
            |f| {
                (f.chunk_width, f.chunk_height) = (0x7fff_ffff, 0x7fff_ffff);
                (f.samples, f.sample_format) = (65535, SampleFormat::Uint(64));
            },
            "exceed the address space",
        ),
    ];
    for (change, reason) in cases {
        let mut format = plain();
        change(&mut format);
        let error = format.check().unwrap_err();
        assert!(error.contains(reason), "{error:?} should contain {reason:?}");
    }
}

#[test]
fn formats_are_serialized() {
    let format = ChunkFormat {
        samples: 3,
        colour: Colour::Blocks(Yuv::new([0.25, 0.5, 0.125]), 4, 2),
        compression: Compression::Deflate,
        big_endian: true,
        ..plain()
    };
    let text = serde_json::to_string(&format).unwrap();
    assert!(text.contains(r#"{"Blocks":[[0.25,0.5,0.125],4,2]}"#), "{text}");
    assert_eq!(serde_json::from_str::<ChunkFormat>(&text).unwrap(), format);
    let jpeg = ChunkFormat { compression: Compression::Jpeg(vec![1, 2]), ..plain() };
    let text = serde_json::to_string(&jpeg).unwrap();
    assert_eq!(serde_json::from_str::<ChunkFormat>(&text).unwrap(), jpeg);
    assert!(jpeg.lossy_decoder().unwrap().starts_with("zune-jpeg 0."));
    assert_eq!(format.lossy_decoder(), None);
}

#[test]
fn sizes_are_those_of_decoded_chunks() {
    let blocks =
        ChunkFormat { chunk_width: 5, samples: 3, colour: Colour::Blocks(jpeg_yuv(), 2, 2), ..plain() };
    assert_eq!((blocks.channels(), blocks.pixel_bytes(), blocks.chunk_bytes()), (3, 3, 30));
    assert_eq!(blocks.max_stored_bytes(), 60 + 65536);
    // Three blocks of 4 + 2 bytes; one row of blocks.
    assert_eq!(blocks.decoded_bytes(1), (18, 15));
    let grey = [100, 100, 100, 100, 128, 128].repeat(3);
    assert_eq!(decoded(&blocks, &grey, 1).unwrap(), [100; 15]);

    let cmyk = ChunkFormat { samples: 5, colour: Colour::Cmyk, ..plain() };
    assert_eq!((cmyk.channels(), cmyk.decoded_bytes(2)), (4, (40, 32)));
    assert_eq!(decoded(&cmyk, &[0; 40], 2).unwrap(), [255; 32]);

    let bits = ChunkFormat { chunk_width: 9, sample_format: SampleFormat::Uint(12), ..plain() };
    assert_eq!((bits.pixel_bytes(), bits.chunk_bytes(), bits.decoded_bytes(1)), (2, 28, (14, 14)));
}

#[test]
fn predictors_and_byte_order_are_undone() {
    let format = ChunkFormat {
        sample_format: SampleFormat::Uint(16),
        compression: Compression::Deflate,
        predictor: Predictor::Horizontal,
        big_endian: true,
        ..plain()
    };
    let raw = deflated(&[1, 0, 0, 1, 0, 1, 0, 1]);
    let chunk = decoded(&format, &raw, 1).unwrap();
    assert_eq!(chunk, [0, 1, 1, 1, 2, 1, 3, 1]);
    let error = decoded(&format, &raw, 2).unwrap_err();
    assert!(error.contains("end after 8 bytes"), "{error}");
    assert!(decoded(&format, &raw, 3).unwrap_err().contains("3 rows"));
    assert!(decoded(&format, &raw, 0).unwrap_err().contains("0 rows"));
    assert!(decoded(&format, &[1, 2, 3], 1).unwrap_err().contains("bad deflate data"));
}

#[test]
fn uncompressed_chunks_are_restored_in_place() {
    let format = ChunkFormat { sample_format: SampleFormat::Uint(4), lowest_first: true, ..plain() };
    let mut chunk = vec![0x80, 0x0c, 0x20, 0x00];
    assert_eq!(decoded(&format, &chunk, 2).unwrap(), [0x01, 0x30, 0x04, 0x00]);
    format.restore(&mut chunk, 2);
    assert_eq!(chunk, [0x01, 0x30, 0x04, 0x00]);
    assert_eq!(decoded(&format, &[0; 3], 2).unwrap_err(), "only 3 bytes");
    // The middle of the second row.
    let selection = ChunkSelection { left: 1, top: 1, width: 2, chosen: &[0], slot: 0 };
    assert_eq!(copied(&format, &chunk, &selection, 1), [4, 0]);
}

#[test]
fn channels_are_chosen() {
    let format = ChunkFormat { samples: 3, sample_format: SampleFormat::Uint(16), ..plain() };
    let chunk: Vec<u8> = (0..24u16).flat_map(u16::to_le_bytes).collect();
    let numbers = |bytes: Vec<u8>| -> Vec<u8> { bytes.into_iter().step_by(2).collect() };
    let selection = |chosen, slot| ChunkSelection { left: 1, top: 0, width: 2, chosen, slot };
    assert_eq!(numbers(copied(&format, &chunk, &selection(&[2, 0], 0), 2)), [5, 3, 8, 6, 17, 15, 20, 18]);
    assert_eq!(numbers(copied(&format, &chunk, &selection(&[1], 0), 2)), [4, 7, 16, 19]);
    assert_eq!(
        numbers(copied(&format, &chunk, &selection(&[0, 1, 2], 0), 2)),
        [3, 4, 5, 6, 7, 8, 15, 16, 17, 18, 19, 20]
    );
    let planar = ChunkFormat { planes: 3, ..format };
    let chunk = &chunk[..16];
    assert_eq!(numbers(copied(&planar, chunk, &selection(&[2, 0], 1), 2)), [0, 1, 0, 2, 0, 5, 0, 6]);
    assert_eq!(numbers(copied(&planar, chunk, &selection(&[2], 0), 2)), [1, 2, 5, 6]);
}

#[cfg(any(feature = "native", feature = "portable"))]
#[test]
fn zstd_is_decoded_from_any_frames() {
    let format =
        ChunkFormat { chunk_width: 1000, chunk_height: 300, compression: Compression::Zstd, ..plain() };
    let bytes: Vec<u8> = (0..300_000u32).map(|i| (i.wrapping_mul(i) >> 7) as u8).collect();
    let compress = |bytes: &[u8]| {
        let mut encoder = zstd::Encoder::new(Vec::new(), 3).unwrap();
        encoder.include_checksum(true).unwrap();
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    };
    let whole = compress(&bytes);
    assert_eq!(decoded(&format, &whole, 300).unwrap(), bytes);
    // More rows than needed.
    assert_eq!(decoded(&format, &whole, 7).unwrap(), bytes[..7000]);
    let skipped = b"\x50\x2a\x4d\x18\x03\0\0\0abc".to_vec();
    let frames = [compress(&bytes[..1234]), skipped, compress(&[]), compress(&bytes[1234..])].concat();
    assert_eq!(decoded(&format, &frames, 300).unwrap(), bytes);

    let short = compress(&bytes[..299_999]);
    let error = decoded(&format, &short, 300).unwrap_err();
    assert!(error.contains("end after 299999 bytes"), "{error}");
    assert!(decoded(&format, &whole[..whole.len() / 2], 300).unwrap_err().contains("bad zstd data"));
    assert!(decoded(&format, b"other bytes", 300).unwrap_err().contains("bad zstd data"));
    assert!(decoded(&format, &skipped_too_far(), 300).is_err());
    let mut corrupt = whole.clone();
    *corrupt.last_mut().unwrap() ^= 1;
    #[cfg(not(feature = "native"))]
    assert!(decoded(&format, &corrupt, 300).unwrap_err().contains("checksum"));

    // A state is reused, also after an error.
    let (mut states, mut chunk) = (DecoderStates::default(), Vec::new());
    for mut raw in [short, corrupt, whole] {
        let result = format.decode(&mut states, &mut raw, 300, &mut chunk);
        assert!(result.is_err() || chunk == bytes);
    }
    assert_eq!(chunk, bytes);
}

#[cfg(any(feature = "native", feature = "portable"))]
fn skipped_too_far() -> Vec<u8> {
    b"\x50\x2a\x4d\x18\xff\xff\xff\xffabc".to_vec()
}

#[cfg(not(feature = "native"))]
#[test]
fn other_compressions_are_refused_by_name() {
    let bits = SampleFormat::Uint(1);
    let [jpeg, webp, pack_bits] = [Compression::Jpeg(Vec::new()), Compression::WebP, Compression::PackBits]
        .map(|compression| ChunkFormat { compression, ..plain() });
    let fax = ChunkFormat { compression: Compression::Fax4, sample_format: bits, ..plain() };
    for format in [jpeg, webp, pack_bits, fax] {
        let error = decoded(&format, &[0; 100], 1).unwrap_err();
        let name = format.compression.name();
        assert_eq!(error, format!("{name} compression, which this build of Spinney cannot decode"));
    }
}

#[cfg(feature = "native")]
#[test]
fn run_lengths_and_images_are_decoded_or_refused() {
    let packed = ChunkFormat { compression: Compression::PackBits, ..plain() };
    // Three times 9, then two literal bytes, then three times 1.
    assert_eq!(decoded(&packed, &[254, 9, 1, 5, 6, 254, 1], 2).unwrap(), [9, 9, 9, 5, 6, 1, 1, 1]);
    assert!(decoded(&packed, &[254, 9], 2).unwrap_err().contains("bad packbits data"));
    let jpeg = ChunkFormat { compression: Compression::Jpeg(Vec::new()), ..plain() };
    assert_eq!(decoded(&jpeg, &[0; 9], 2).unwrap_err(), "no JPEG frame header");
    let frame = b"\xff\xd8\xff\xc0\0\x0b\x08\0\x03\0\x04\x01\x01\x11\0";
    assert_eq!(decoded(&jpeg, frame, 2).unwrap_err(), "an image of 4x3 in a chunk of 4x2");
    let webp = ChunkFormat { compression: Compression::WebP, ..plain() };
    assert_eq!(decoded(&webp, &[0; 9], 2).unwrap_err(), "no WebP header");
}

/// Formats that are valid, nearly so, or arbitrary in one or more fields.
fn formats() -> impl Strategy<Value = ChunkFormat> {
    let side = || prop_oneof![30 => 1u64..40, 1 => any::<u64>(), 1 => Just(0), 1 => Just(0x7fff_ffff)];
    let count = || prop_oneof![30 => 1usize..6, 1 => any::<usize>(), 1 => Just(65535)];
    let bits = || prop_oneof![2 => Just(8u8), 2 => 1u8..65, 1 => any::<u8>(), 1 => Just(32)];
    let sample_format = prop_oneof![
        6 => Just(SampleFormat::Uint(8)),
        3 => bits().prop_map(SampleFormat::Uint),
        1 => bits().prop_map(SampleFormat::Int),
        2 => bits().prop_map(SampleFormat::Float),
    ];
    let compression = prop_oneof![
        Just(Compression::None),
        Just(Compression::Deflate),
        Just(Compression::Zstd),
        Just(Compression::Lzw),
        Just(Compression::PackBits),
        Just(Compression::Fax4),
        Just(Compression::WebP),
        prop::collection::vec(any::<u8>(), 0..9).prop_map(Compression::Jpeg),
    ];
    let predictor = prop_oneof![5 => Just(Predictor::None), 1 => Just(Predictor::Horizontal), 1 => Just(Predictor::Float)];
    let block = || prop_oneof![5 => Just(2usize), 3 => Just(1), 3 => Just(4), 1 => any::<usize>()];
    let colour = prop_oneof![
        4 => Just(Colour::Keep),
        1 => Just(Colour::Jpeg),
        1 => Just(Colour::Cmyk),
        3 => ([-1f32..2.0, -1f32..2.0, -1f32..2.0], block(), block())
            .prop_map(|(shares, h, v)| Colour::Blocks(Yuv::new(shares), h, v)),
    ];
    let planes = prop_oneof![4 => Just(None), 12 => Just(Some(1)), 1 => any::<usize>().prop_map(Some)];
    let fields = (side(), side(), count(), planes, sample_format, compression, predictor, colour);
    (fields, any::<bool>(), prop::bool::weighted(0.3)).prop_map(|(fields, big_endian, lowest_first)| {
        let (chunk_width, chunk_height, samples, planes, sample_format, compression, predictor, colour) =
            fields;
        ChunkFormat {
            chunk_width,
            chunk_height,
            samples,
            planes: planes.unwrap_or(samples),
            sample_format,
            compression,
            predictor,
            colour,
            big_endian,
            lowest_first,
        }
    })
}

/// Decodes bytes as one chunk, and copies all of it and a part of it.
fn use_all(format: &ChunkFormat, bytes: &[u8]) {
    let rows = format.chunk_height as usize;
    let (mut states, mut chunk) = (DecoderStates::default(), Vec::new());
    let mut raw = match format.compression {
        Compression::Deflate => deflated(bytes),
        Compression::Zstd => zstd::bulk::compress(bytes, 1).unwrap(),
        Compression::Lzw => {
            let order = weezl::BitOrder::Msb;
            weezl::encode::Encoder::with_tiff_size_switch(order, 8).encode(bytes).unwrap()
        }
        _ => bytes.to_vec(),
    };
    // (As the bytes would be in a file.)
    if format.lowest_first {
        raw.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
    }
    if format.decode(&mut states, &mut raw, rows, &mut chunk).is_err() {
        return;
    }
    assert_eq!(chunk.len(), format.decoded_bytes(rows).1);
    let (width, last) = (format.chunk_width as usize, format.channels() - 1);
    let all: Vec<usize> = (0..=last).collect();
    let whole = ChunkSelection { left: 0, top: 0, width, chosen: &all, slot: last };
    let corner = ChunkSelection { left: width - 1, top: rows - 1, width: 1, chosen: &[last], slot: 0 };
    copied(format, &chunk, &whole, rows);
    copied(format, &chunk, &corner, 1);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4_000, failure_persistence: None, ..Default::default() })]

    #[test]
    fn formats_that_pass_the_check_do_not_panic(format in formats(), seed: u64) {
        if format.check().is_ok() && format.chunk_bytes() < 1 << 16 && format.pixel_bytes() < 1 << 12 {
            let mut state = seed;
            let bytes: Vec<u8> = std::iter::repeat_with(|| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            })
            .take(1 << 17)
            .collect();
            use_all(&format, &bytes);
        }
    }
}
