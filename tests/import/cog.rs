//! Cloud-optimized GeoTIFF against the tree: this test parses the file, and the `tiff` crate
//! decodes tiles.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

use spinney::export::{CogCompression, CogRequest, export_cog};
use spinney::raw::dataset::open;
use spinney::raw::tree::df::from_text;
use spinney::raw::value::Palette;
use spinney::{
    Bounds, Crs, DataKind, Dataset, Frame, Metadata, OpenOptions, Output, Rule, SampleType, Value,
};
use tiff::decoder::{Decoder, DecodingResult, Limits};

use crate::common::{Cells, QUAD, dataset, made, opened, options, quad, value_types, with, write_cells};

const OFFSETS: u16 = 324;
const COUNTS: u16 = 325;

/// A directory: the numbers of each tag. Strings are numbers, too.
type Tags = BTreeMap<u16, Vec<u64>>;

/// A parsed file.
struct ParsedTiff {
    bytes: Vec<u8>,
    big: bool,
    directories: Vec<(u64, Tags)>,
}

impl ParsedTiff {
    fn of(bytes: Vec<u8>) -> ParsedTiff {
        let big = match &bytes[..4] {
            b"II*\0" => false,
            b"II+\0" => true,
            other => panic!("{other:?} is no TIFF"),
        };
        let number = |at: u64, size: u64| {
            let mut word = [0; 8];
            word[..size as usize].copy_from_slice(&bytes[at as usize..(at + size) as usize]);
            u64::from_le_bytes(word)
        };
        let (word, count) = if big { (8, 8) } else { (4, 2) };
        let mut directories = Vec::new();
        let mut at = number(if big { 8 } else { 4 }, word);
        while at != 0 {
            let (mut tags, entries) = (Tags::new(), number(at, count));
            let mut entry = at + count;
            let mut last = 0;
            for _ in 0..entries {
                let (tag, kind) = (number(entry, 2) as u16, number(entry + 2, 2));
                assert!(tag > last, "tags in order");
                last = tag;
                let size = [0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8][kind as usize];
                let values = number(entry + 4, word);
                let value_offset = entry + 4 + word;
                let value_offset =
                    if values * size > word { number(value_offset, word) } else { value_offset };
                tags.insert(tag, (0..values).map(|i| number(value_offset + i * size, size)).collect());
                entry += 4 + 2 * word;
            }
            directories.push((at, tags));
            at = number(entry, word);
        }
        ParsedTiff { bytes, big, directories }
    }

    fn text(&self, directory: usize, tag: u16) -> Option<String> {
        let bytes: Vec<u8> =
            self.directories[directory].1.get(&tag)?.iter().map(|byte| *byte as u8).collect();
        Some(String::from_utf8(bytes).unwrap().trim_end_matches('\0').to_string())
    }

    /// Checks what GDAL's layout description promises.
    fn check_layout(&self) {
        let header = if self.big { 16 } else { 8 };
        let ghost = std::str::from_utf8(&self.bytes[header..header + 43]).unwrap();
        let size: usize = ghost["GDAL_STRUCTURAL_METADATA_SIZE=".len()..][..6].parse().unwrap();
        let ghost = std::str::from_utf8(&self.bytes[header + 43..][..size]).unwrap();
        assert!(
            ghost.starts_with("LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\n")
        );
        let is_mask = |tags: &Tags| tags.get(&254).is_some_and(|kind| kind[0] & 4 != 0);
        let has_masks = self.directories.iter().any(|(_, tags)| is_mask(tags));
        assert_eq!(ghost.ends_with("MASK_INTERLEAVED_WITH_IMAGERY=YES\n"), has_masks);
        assert!(self.directories.is_sorted_by_key(|(at, _)| *at));
        assert_eq!(self.directories[0].0, (header + 43 + size).next_multiple_of(2) as u64);
        let step = if has_masks { 2 } else { 1 };
        // Tiles are contiguous, the smallest overview's first; mask tiles follow those of the
        // image.
        let mut expected = None;
        for level in self.directories.chunks(step).rev() {
            for tile in 0..level[0].1[&OFFSETS].len() {
                for (_, tags) in level {
                    let (offset, length) = (tags[&OFFSETS][tile], tags[&COUNTS][tile]);
                    assert_eq!(offset == 0, length == 0);
                    if offset == 0 {
                        continue;
                    }
                    let at = offset as usize;
                    assert!(expected.is_none_or(|expected| expected == offset));
                    assert_eq!(self.bytes[at - 4..at], (length as u32).to_le_bytes());
                    let end = at + length as usize;
                    assert_eq!(self.bytes[end - 4..end], self.bytes[end..end + 4]);
                    expected = Some(end as u64 + 8);
                }
            }
        }
        let directories_end = self.directories.last().unwrap().0;
        let first = self.directories.iter().flat_map(|(_, tags)| &tags[&OFFSETS]).filter(|at| **at > 0).min();
        assert!(first.is_none_or(|first| *first > directories_end));
        assert!(expected.is_none_or(|end| end - 4 == self.bytes.len() as u64), "bytes after the last tile");
    }

    /// Compares every tile of every level with the tree.
    fn check_tiles(&self, tree: &Dataset, request: &CogRequest) {
        let side = u64::from(request.tile_size);
        let width = tree.header().form.width();
        let mut decoder = Decoder::new(Cursor::new(&self.bytes)).unwrap().with_limits(Limits::unlimited());
        let masks = self.directories.iter().any(|(_, tags)| tags.get(&254) == Some(&vec![4]));
        let step = if masks { 2 } else { 1 };
        let nodata = self.text(0, 42113).map(|text| text.parse::<f64>().unwrap());
        for (above, directories) in self.directories.chunks(step).enumerate() {
            let level = tree.depth() - above as u8;
            let tags = &directories[0].1;
            let [columns, rows, _] = tree.extent_at(level).max;
            assert_eq!((tags[&256][0], tags[&257][0]), (columns, rows));
            assert_eq!((tags[&322][0], tags[&323][0]), (side, side));
            assert_eq!(tags.get(&254).map(|kind| kind[0]), (above > 0).then_some(1));
            decoder.seek_to_image(above * step).unwrap();
            for tile in 0..tags[&OFFSETS].len() as u64 {
                let across = columns.div_ceil(side);
                let [x, y] = [tile % across * side, tile / across * side];
                let max = [columns.min(x + side), rows.min(y + side), 1];
                let bounds = Bounds { min: [x, y, 0], max };
                let cells = bounds.volume() as usize;
                let (mut bytes, mut valid) = (vec![0; cells * width], vec![false; cells]);
                let fill = nodata.unwrap_or(0.0);
                tree.window(level, &bounds, fill, &mut bytes, Some(&mut valid)).unwrap();
                let is_stored = tags[&OFFSETS][tile as usize] != 0;
                assert_eq!(is_stored, valid.contains(&true), "tile {tile} of level {level}");
                if is_stored {
                    let found = decoded(decoder.read_chunk(tile as u32).unwrap());
                    let value = tree.header().form.value;
                    assert!(found == bytes, "tile {tile} of level {level}: {value}, {request:?}");
                }
                if masks {
                    let tags = &directories[1].1;
                    assert_eq!(tags[&254][0], if above > 0 { 5 } else { 4 });
                    assert_eq!((tags[&256][0], tags[&257][0], tags[&258][0]), (columns, rows, 1));
                    assert_eq!(tags[&OFFSETS][tile as usize] != 0, is_stored);
                    if is_stored {
                        let at = tags[&OFFSETS][tile as usize] as usize;
                        let mut bits = Vec::new();
                        flate2::read::ZlibDecoder::new(&self.bytes[at..]).read_to_end(&mut bits).unwrap();
                        assert_eq!(bits.len() as u64, side * side / 8);
                        for (index, valid) in valid.iter().enumerate() {
                            let (column, row) = (index as u64 % (max[0] - x), index as u64 / (max[0] - x));
                            let byte = bits[((row * side + column) / 8) as usize];
                            assert_eq!(byte >> (7 - column % 8) & 1 == 1, *valid);
                        }
                    }
                }
            }
        }
    }
}

/// Returns the samples in the byte order of the file.
fn decoded(samples: DecodingResult) -> Vec<u8> {
    use DecodingResult::*;
    match samples {
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
        _ => panic!("unexpected samples"),
    }
}

fn request(tile_size: u32, compression: CogCompression) -> CogRequest {
    with(CogRequest::new(), |request| (request.tile_size, request.compression) = (tile_size, compression))
}

/// Returns the exported file of a tree.
fn exported(tree: &Dataset, request: &CogRequest) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.tif");
    export_cog(tree, request, Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(&path).unwrap()
}

/// Exports a tree and checks the whole file.
fn checked(tree: &Dataset, request: &CogRequest) -> ParsedTiff {
    let parts = ParsedTiff::of(exported(tree, request));
    parts.check_layout();
    parts.check_tiles(tree, request);
    parts
}

#[test]
fn all_values_in_all_codings() {
    use CogCompression::{Deflate, None, Zstd};
    for (seed, value) in value_types().into_iter().enumerate() {
        for void in [false, true] {
            let form = quad(value.sample, value.channels);
            let cells = Cells::random(form, seed as u64, [333, 200, 1], 200, void);
            // The decoder returns a fourth sample if it is opacity.
            let alpha = (value.channels == 4).then_some(3);
            let metadata = Metadata { alpha, ..Metadata::default() };
            let options = options(Rule::Mean, DataKind::Continuous, cells.depth()).metadata(metadata);
            let tree = opened(|path| write_cells(path, &cells, &options));
            for compression in [Deflate, Zstd, None] {
                let parts = checked(&tree, &request(64, compression));
                assert_eq!(parts.directories.len(), 4, "333, 167, 84 and 42 columns");
            }
        }
    }
}

#[test]
fn tiny_and_odd_sizes() {
    for size in [[1, 1], [513, 7], [7, 513], [512, 512], [64, 65], [1025, 1]] {
        let cells = Cells::random(QUAD, 5, [size[0], size[1], 1], 9, true);
        for rule in [Rule::Majority, Rule::Mean] {
            let kind = if rule == Rule::Mean { DataKind::Continuous } else { DataKind::Categorical };
            let tree = dataset(&cells, rule, kind);
            if cells.count() == 0 {
                continue;
            }
            for side in [64, 512] {
                let parts = checked(&tree, &request(side, CogCompression::Deflate));
                let longest = u64::from(size[0].max(size[1]) as u32);
                let levels = (0..).find(|shift| longest.div_ceil(1 << shift) <= u64::from(side)).unwrap();
                assert_eq!(parts.directories.len(), levels + 1, "{size:?} in tiles of {side}");
            }
        }
    }
}

#[test]
fn masks_where_every_number_is_in_use() {
    // All values of a byte, and scattered VOID cells, including a whole tile of them.
    let cells = made(QUAD, [300, 200, 1], |[x, y, _]| {
        let is_void = x % 7 == 0 || ((128..192).contains(&x) && y < 64);
        (!is_void).then(|| Value::from([(x * 31 + y * 17) as u8]))
    });
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    let options = options(Rule::Majority, DataKind::Categorical, cells.depth());
    spinney::raw::store::build_tree(
        &cells.tree(Rule::Majority),
        cells.size,
        &options,
        Output::create(&path).unwrap(),
        &(),
    )
    .unwrap();
    let tree = open(&path, &OpenOptions::new()).unwrap();
    let parts = checked(&tree, &request(64, CogCompression::Zstd));
    assert_eq!(parts.directories.len(), 8, "four levels, each with a mask");
    assert_eq!(parts.text(0, 42113), None);
    assert_eq!(parts.directories[0].1[&OFFSETS][2], 0, "an empty tile");
    assert_eq!(parts.directories[1].1[&259], [8], "masks are deflated");
    // A value that occurs in cells cannot be nodata.
    let with_nodata = with(request(64, CogCompression::Zstd), |request| request.nodata = Some(7.0.into()));
    let output = Output::create(&directory.path().join("x.tif")).unwrap();
    let error = export_cog(&tree, &with_nodata, output, &()).unwrap_err().to_string();
    assert!(error.contains('7') && !directory.path().join("x.tif").exists(), "{error}");
}

#[test]
fn descriptions_go_along() {
    let cells = Cells::random(QUAD, 2, [600, 40, 1], 5, false);
    let metadata = Metadata {
        frame: Frame { crs: Some(Crs::epsg(2056)), ..Frame::planar([10.0, 0.0, 2e6, 0.0, -10.0, 1e6]) },
        palette: Some(Palette { colours: vec![[1, 2, 3, 255], [40, 50, 60, 255]] }),
        class_names: [(0.into(), "water".to_string()), (1.into(), "land".to_string())].into(),
        band_names: vec!["cover".into()],
        ..Metadata::default()
    };
    let options = options(Rule::Majority, DataKind::Categorical, cells.depth()).metadata(metadata);
    let tree = opened(|path| write_cells(path, &cells, &options));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.tif");
    export_cog(&tree, &request(64, CogCompression::Deflate), Output::create(&path).unwrap(), &()).unwrap();
    let parts = ParsedTiff::of(std::fs::read(&path).unwrap());
    parts.check_layout();
    let xml = parts.text(0, 42112).unwrap();
    let statistics = tree.statistics(None, &()).unwrap().channels[0];
    for (name, number) in [
        ("MINIMUM", statistics.min),
        ("MAXIMUM", statistics.max),
        ("MEAN", statistics.mean.into()),
        ("STDDEV", statistics.standard_deviation.into()),
        ("VALID_PERCENT", 100.into()),
    ] {
        assert!(
            xml.contains(&format!("<Item name=\"STATISTICS_{name}\" sample=\"0\">{number}</Item>")),
            "{xml}"
        );
    }
    assert!(xml.contains(">cover<") && xml.contains("<F>water</F>"), "{xml}");
    assert!(
        std::fs::read_to_string(directory.path().join("x.tif.aux.xml")).unwrap().contains("<Category>land<")
    );
    for (_, tags) in &parts.directories {
        assert_eq!((tags[&262][0], tags[&320].len()), (3, 3 * 256));
        assert_eq!(tags[&320][..2], [257, 40 * 257]);
        assert_eq!(tags.get(&317), Some(&vec![1]), "differences of classes mean nothing");
    }
    let keys = &parts.directories[0].1[&34735];
    assert!(keys.chunks(4).any(|key| key[0] == 3072 && key[3] == 2056));
    assert!(parts.directories[1..].iter().all(|(_, tags)| !tags.contains_key(&34735)));
}

#[test]
fn bytes_do_not_depend_on_threads_or_memory() {
    let cells = Cells::random(quad(SampleType::U16, 3), 9, [700, 500, 1], 99, true);
    let tree = dataset(&cells, Rule::Mean, DataKind::Continuous);
    let request = request(64, CogCompression::Deflate);
    let expected = exported(&tree, &request);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| exported(&tree, &request)) == expected, "{threads} threads");
    }
    let little = with(request.clone(), |request| request.memory = 100_000);
    assert!(exported(&tree, &little) == expected);
    let none = with(request, |request| request.memory = 10_000);
    let output = Output::create(Path::new("-")).unwrap();
    assert!(export_cog(&tree, &none, output, &()).unwrap_err().to_string().contains("smaller tiles"));
}

#[test]
fn views_and_large_files() {
    let cells = Cells::random(QUAD, 3, [400, 300, 1], 40, true);
    let tree = dataset(&cells, Rule::Mean, DataKind::Continuous);
    let tree = tree.view(&["window=13,27,333,222".parse().unwrap()]).unwrap();
    checked(&tree, &request(64, CogCompression::Deflate));
    // Few cells in a large space: 64-bit offsets and missing tiles.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    let text = format!("{}BWWW{}", "G".repeat(16), "WWW".repeat(15));
    let tree = from_text(QUAD, &text, 16, Value::from([9]), Rule::Nearest).unwrap();
    let options = options(Rule::Nearest, DataKind::Categorical, 16);
    let output = Output::create(&path).unwrap();
    spinney::raw::store::build_tree(&tree, [1 << 16, 60_000, 1], &options, output, &()).unwrap();
    let tree = open(&path, &OpenOptions::new()).unwrap();
    let parts = ParsedTiff::of(exported(&tree, &request(512, CogCompression::Deflate)));
    parts.check_layout();
    assert!(parts.big);
    assert_eq!(parts.directories.len(), 8);
    assert!(
        parts.directories.iter().all(|(_, tags)| tags[&OFFSETS].iter().filter(|at| **at > 0).count() == 1)
    );
}

#[test]
fn unsupported_exports_are_rejected() {
    let octree = opened(|path| {
        let cells = Cells::random(crate::common::OCT, 1, [4, 4, 4], 9, false);
        write_cells(path, &cells, &options(Rule::Mean, DataKind::Continuous, 2));
    });
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.tif");
    let error = |tree: &Dataset, request: &CogRequest| {
        let failed = export_cog(tree, request, Output::create(&path).unwrap(), &()).unwrap_err().to_string();
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0, "nothing is left");
        failed
    };
    assert!(error(&octree, &CogRequest::new()).contains("octree"));
    let tree = dataset(&Cells::random(QUAD, 1, [9, 9, 1], 9, false), Rule::Mean, DataKind::Continuous);
    for side in [0, 48, 100, 8192] {
        assert!(error(&tree, &request(side, CogCompression::Zstd)).contains("multiple of 16"), "{side}");
    }
}
