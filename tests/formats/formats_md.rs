//! The hex dumps in `formats.md` equal what is written.

use std::collections::BTreeMap;
use std::path::Path;

use spinney::brep::{Face, Grid, Location};
use spinney::raw::brep::ModelBuilder;
use spinney::raw::store::goblin::Goblin;
use spinney::raw::store::{Packing, build_tree};
use spinney::tree::MemTree;
use spinney::{BuildOptions, Code, DataKind, Dimension, ExactModel, Metadata, Output, Rule, WriteOptions};

use crate::common::reference::{self, Cut};
use crate::common::{QUAD, byte};

/// Reads a text file of the project.
fn text(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// The specification: `formats.md`, then its pages in the order of their sections.
fn formats() -> String {
    let pages =
        ["goblin", "autumnal", "exact-model", "packed", "points", "lines", "manifest", "shards", "index"];
    pages.iter().fold(text("formats.md"), |all, page| all + &text(&format!("docs/format/{page}.md")))
}

/// The fenced block after a marker.
fn block<'a>(text: &'a str, marker: &str) -> &'a str {
    let (_, after) = text.split_once(marker).expect("the marker");
    let (_, after) = after.split_once("```text\n").expect("a block");
    after.split_once("\n```").expect("its end").0
}

/// Returns the bytes of a dump whose lines are offset, bytes, meaning, separated by two or more
/// spaces. A line of dots represents bytes copied from `whole`.
fn dumped_of(dump: &str, whole: &[u8]) -> Vec<u8> {
    let mut bytes = whole[..usize::from_str_radix(dump.split("  ").next().unwrap(), 16).unwrap()].to_vec();
    let mut lines = dump.lines();
    while let Some(line) = lines.next() {
        if line == "..." {
            let next = lines.clone().next().and_then(|line| line.split("  ").next());
            let end = next.map_or(whole.len(), |offset| usize::from_str_radix(offset, 16).unwrap());
            bytes.extend(&whole[bytes.len()..end]);
            continue;
        }
        let mut columns = line.splitn(3, "  ");
        let offset = usize::from_str_radix(columns.next().unwrap(), 16).unwrap();
        assert_eq!(offset, bytes.len(), "{line}");
        let pairs = columns.next().unwrap().split(' ');
        bytes.extend(pairs.map(|pair| u8::from_str_radix(pair, 16).unwrap()));
    }
    bytes
}

/// Returns the bytes of a dump without omissions.
fn dumped(dump: &str) -> Vec<u8> {
    dumped_of(dump, &[])
}

/// Returns the image of section 16.
fn classic_cells(formats: &str) -> Vec<u8> {
    let (_, section) = formats.split_once("## 16.").unwrap();
    let rows = section.lines().filter(|line| line.starts_with("    ")).take(8);
    rows.flat_map(|row| row.split_whitespace().map(|cell| cell.parse::<u8>().unwrap())).collect()
}

/// Returns the file of section 16.
fn classic(packing: Packing) -> Vec<u8> {
    let cells = classic_cells(&formats());
    assert_eq!(cells.len(), 64);
    let cell = |[x, y, _]: [u32; 3]| Some(byte(cells[(8 * y + x) as usize]));
    let tree = MemTree::from_cells(QUAD, 3, Rule::Dominant, &cell);
    let options =
        BuildOptions::new(DataKind::Categorical, 3).rule(Rule::Dominant).packing(packing).memory(1 << 20);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("classic.goblin");
    build_tree(&tree, [8, 8, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn the_dump_matches_the_builder() {
    let written = classic(Packing::default());
    assert_eq!(dumped(block(&formats(), "<!-- dump: classic.goblin -->")), written);
    let frozen = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    assert_eq!(std::fs::read(frozen).unwrap(), written);
}

#[test]
fn the_dump_of_a_packed_segment_matches_the_builder() {
    // It covers all bytes between the header and the segment index.
    assert_eq!(assert_dumped("packed segment", &classic(Packing::packed()), 24), 37);
}

/// Checks that a file has the bytes of a named dump at an offset. Returns their number.
fn assert_dumped(name: &str, file: &[u8], offset: usize) -> usize {
    let expected = dumped(block(&formats(), &format!("<!-- dump: {name} -->")));
    assert!(file[offset..].starts_with(&expected), "{name}");
    expected.len()
}

#[test]
fn the_dump_of_dense_blocks_matches_the_reference_writer() {
    let cell = |[x, y, _]: [u32; 3]| (x < 8 && y < 8 && x != y).then(|| byte((8 * y + x) as u8));
    let tree = MemTree::from_cells(QUAD, 5, Rule::Mean, &cell);
    let cut = Cut { reach: 4, stride: 2, threshold: 1 };
    let written = reference::goblin(&tree, [8, 8, 1], (Rule::Mean, DataKind::Continuous), cut);
    let formats = formats();
    assert_eq!(dumped_of(block(&formats, "<!-- dump: dense blocks -->"), &written), written);
    // The library writes the same bytes for these cells and cut parameters.
    assert_eq!(Goblin::from_bytes(written).unwrap().verify(1 << 20, &()).unwrap(), []);
}

#[test]
fn the_dumps_of_pointered_records_match_the_writer() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("classic.autumn");
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    spinney::convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(1 << 20), &())
        .unwrap();
    let is_end = |file: &[u8], length: usize| {
        // The extent ends there, and the dump has all of it.
        let stored = u64::from_le_bytes(file[12288 + 16..][..8].try_into().unwrap());
        assert_eq!(32 + stored as usize, length);
    };
    let file = std::fs::read(&path).unwrap();
    is_end(&file, assert_dumped("classic.autumn", &file, 12288));
    // The same image with 8 x 8 cells per pixel.
    let cells = classic_cells(&formats());
    let cell = |[x, y, _]: [u32; 3]| Some(byte(cells[(y / 8 * 8 + x / 8) as usize]));
    let tree = MemTree::from_cells(QUAD, 6, Rule::Dominant, &cell);
    let options = BuildOptions::new(DataKind::Categorical, 6).rule(Rule::Dominant).memory(1 << 20);
    let path = directory.path().join("large.autumn");
    build_tree(&tree, [64, 64, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    let file = std::fs::read(&path).unwrap();
    is_end(&file, assert_dumped("large.autumn", &file, 12288));
}

#[test]
fn the_dumps_of_pages_and_commits_are_those_of_the_frozen_file() {
    let file =
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/history.autumn")).unwrap();
    assert_eq!(assert_dumped("header page", &file, 0), 72);
    assert_eq!(assert_dumped("meta slot", &file, 8192), 40);
    let commit = u64::from_le_bytes(file[8192 + 16..][..8].try_into().unwrap()) as usize;
    let length = u64::from_le_bytes(file[commit + 16..][..8].try_into().unwrap()) as usize;
    assert_eq!(assert_dumped("commit", &file, commit), 32 + length);
}

/// Builds the tetrahedron of `formats.md` as described there.
fn tetrahedron(path: &Path) {
    let grid = Grid { bits: 1, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let output = Output::create(path).unwrap();
    let mut builder = ModelBuilder::new(output, grid, 1 << 20).unwrap().leaf_size(0);
    let corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for (number, face) in (0..).zip([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]) {
        let points = face.map(|corner: usize| corners[corner]);
        let (ring_ends, colours) = (&[3], &[]);
        builder.push(&Face { number, points: &points, ring_ends, colours, part: 0, source: number }).unwrap();
    }
    let mut metadata = Metadata::default();
    (0..3).for_each(|axis| metadata.frame.matrix[axis][3] = -0.5);
    builder.finish(&mut metadata, &()).unwrap();
}

#[test]
fn the_dump_of_an_exact_model_matches_the_builder() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("tetrahedron.goblin");
    tetrahedron(&path);
    let written = std::fs::read(&path).unwrap();
    assert_eq!(dumped(block(&formats(), "<!-- dump: tetrahedron.goblin -->")), written);
    let model = ExactModel::open(&path, &Default::default()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    let locate = |at: [f64; 3]| model.locate(at).unwrap();
    assert_eq!(locate([0.125; 3]), Location::Inside);
    assert_eq!(locate([0.25, 0.25, 0.625]), Location::Outside);
    assert_eq!(locate([0.25, 0.25, 0.0]), Location::Boundary);
}

#[test]
fn tables_of_byte_positions_add_up() {
    // In every table whose first columns are a position and a length, each row starts where the
    // previous one ended.
    let formats = formats();
    let (mut tables, mut expected) = (BTreeMap::new(), None);
    for line in formats.lines() {
        let columns: Vec<&str> = line.split('|').map(str::trim).collect();
        match columns[..] {
            ["", at, "bytes", ..] if at.ends_with("at") => expected = Some(0),
            ["", at, bytes, ..] if expected.is_some() => {
                let Ok(at) = at.parse::<u64>() else { continue };
                assert_eq!(Some(at), expected, "{line}");
                expected = bytes.parse().ok().map(|bytes: u64| at + bytes);
                tables.insert(line.as_ptr() as usize, at);
            }
            [""] | [_] => expected = None,
            _ => {}
        }
    }
    assert!(tables.len() > 30, "{} rows", tables.len());
}

#[test]
fn the_checksum_is_the_one_described() {
    assert_eq!(crc32c::crc32c(b"123456789"), 0xE306_9283);
}

#[test]
fn codes_of_the_table() {
    let formats = formats();
    let row = |name: &str| -> [u64; 2] {
        let line = formats.lines().find(|line| line.starts_with(&format!("| {name} |"))).unwrap();
        let numbers = line.split('`').filter_map(|part| u64::from_str_radix(part, 16).ok());
        numbers.collect::<Vec<_>>().try_into().unwrap()
    };
    let codes = |path: &[usize]| {
        [Dimension::Quad, Dimension::Oct]
            .map(|dimension| Code::from_digits(dimension, path.iter().copied()).unwrap().bits())
    };
    assert_eq!(row("root"), codes(&[]));
    assert_eq!(row("its child 0"), codes(&[0]));
    assert_eq!(row("its child 3"), codes(&[3]));
    assert_eq!(row("its last child"), [codes(&[3])[0], Code::root(Dimension::Oct).child(7).bits()]);
    assert_eq!(row("path 1, 0, 2, 3"), codes(&[1, 0, 2, 3]));
    assert_eq!(Code::from_digits(Dimension::Quad, [1, 0, 2, 3]).unwrap().cell(), [9, 3, 0]);
}
