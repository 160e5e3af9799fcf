//! Corrupt and malicious Autumnal files: an error or the right result, within a time limit.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::query::Condition;
use spinney::raw::store::autumnal::Autumnal;
use spinney::tree::{Child, Source};
use spinney::{Bounds, Code, Dataset, Dimension, Number, OpenOptions, Output, WriteOptions, convert};

use super::counted::CountedFile;
use super::crafted::{
    CUT, Claims, FIRST, INNER, LEAF, Pointered, Record, crafted, crafted_after, dense, leaves, leb128,
    record, small, zone,
};
use crate::common::{CLASSIC, Cells, QUAD, assert_same, byte, cells_of, made, try_children};
use crate::targets::seal::FIRST_EXTENT;

/// Returns a small file with two commits, and their cells.
fn two_commits() -> (Vec<u8>, [Cells; 2]) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(1 << 20), &()).unwrap();
    let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [4, 6, 1] });
    edit(&path, [Ok(Edit::Fill(region, Some(vec![3.0.into()])))], Note::default(), 1 << 20, &()).unwrap();
    let first = made(QUAD, [8, 8, 1], |[x, y, _]| Some(byte(CLASSIC[y as usize][x as usize])));
    let is_filled = |x: u64, y: u64| (1..4).contains(&x) && (1..6).contains(&y);
    let second =
        made(QUAD, [8, 8, 1], |[x, y, z]| if is_filled(x, y) { Some(byte(3)) } else { first.get([x, y, z]) });
    (std::fs::read(&path).unwrap(), [first, second])
}

/// Opens a file as a dataset.
fn dataset(file: &Arc<Autumnal>) -> Dataset {
    Dataset::of(file.clone().into()).unwrap()
}

/// Runs all queries. Whatever they return, they neither panic nor hang.
fn query_all(tree: &Dataset) {
    let depth = tree.depth();
    let side = 1u64 << depth;
    let mut value = [Number::default(); 4];
    for cell in [[0; 3], [1, 1, 0], [side / 2, side / 3, 0], [side - 1, side - 1, 0]] {
        for level in [0, 1, depth] {
            let _ = tree.point(cell, level, &mut value);
        }
    }
    let window = Bounds { min: [0; 3], max: [8, 8, 1] };
    for level in [0, depth / 2, depth] {
        let _ = tree.window(level, &window, 0.0, &mut [0; 64], None);
    }
    let _ = tree.statistics(None, &());
    let _ = tree.statistics(Some(Bounds { min: [1, 1, 0], max: [side, side, 1] }), &());
    let _ = tree.histogram(&Bounds { min: [0; 3], max: [side, side, 1] }, 0.0, 9.0, 9, &());
    let mut count = 0;
    let _ = tree.find(Condition::Above(1.0.into()), None, &(), &mut |_| {
        count += 1;
        Ok(count < 10_000)
    });
    let _ = tree.df_text(1000);
    let _ = tree.classic_table(1000);
    let _ = tree.verify(1 << 20, &());
    let _ = tree.value_bounds();
}

/// Requires an error, or one of the commits unchanged.
fn error_or_truth(bytes: Vec<u8>, commits: &[Cells], what: &str) {
    let Ok(file) = Autumnal::from_bytes(bytes) else { return };
    let file = Arc::new(file);
    query_all(&dataset(&file));
    let Ok(root) = file.root() else { return };
    let Some(cells) = commits.get(file.commit().number as usize - 1) else { return };
    // All of it can be read, or reading returns an error.
    let mut pending = vec![root];
    while let Some(child) = pending.pop() {
        if let Child::Inner { node, .. } = child {
            match try_children(&*file, &node) {
                Ok(children) => pending.extend(children),
                Err(_) => return,
            }
        }
    }
    assert_same(&cells_of(&*file, cells.size), cells, what);
}

#[test]
fn every_flipped_bit_is_detected() {
    let (bytes, commits) = two_commits();
    let meaning = |at: &usize| bytes[*at] != 0 || at % 512 < 64;
    let offsets =
        (0..80).chain(4096..4136).chain(8192..8232).chain(FIRST_EXTENT..bytes.len()).filter(meaning);
    for at in offsets {
        for bit in 0..8 {
            let mut bytes = bytes.clone();
            bytes[at] ^= 1 << bit;
            error_or_truth(bytes, &commits, &format!("bit {bit} of byte {at}"));
        }
    }
}

#[test]
fn truncated_files_are_rejected() {
    let (bytes, commits) = two_commits();
    for length in (0..bytes.len()).filter(|length| length % 37 == 0 || length % 512 < 2) {
        error_or_truth(bytes[..length].to_vec(), &commits, &format!("{length} bytes"));
    }
}

/// Runs all queries and returns whether the file was rejected, at the latest by verification. All
/// of it must be fast.
fn is_refused(what: &str, bytes: Vec<u8>) -> bool {
    let start = Instant::now();
    let found = match Autumnal::from_bytes(bytes.clone()) {
        Err(_) => true,
        Ok(file) => {
            let file = Arc::new(file);
            query_all(&dataset(&file));
            file.verify(1 << 20, &()).map_or(true, |findings| !findings.is_empty())
        }
    };
    // Writers of the whole tree stop, too.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    std::fs::write(&path, bytes).unwrap();
    let goblin = directory.path().join("t.goblin");
    let _ = convert(&path, false, Output::create(&goblin).unwrap(), WriteOptions::new(1 << 20), &());
    assert!(start.elapsed() < Duration::from_secs(20), "{what}: {:?}", start.elapsed());
    found
}

/// Returns a file whose claimed totals are those of valid small files.
fn claiming(depth: u8, records: &[u8], root: u64) -> Vec<u8> {
    crafted(records, Claims { depth, root: (root, 1), totals: (1 << (2 * depth), 2), previous: 0 })
}

/// A root of 64 x 64 cells with detail in the north-west, whose record follows that child's record.
struct Small {
    /// The bytes from the first record's offset on, such as the child's record.
    child: Vec<u8>,
    root: Pointered,
}

/// The classes of [`Small`] and their cell counts.
const CLASSES: [(u8, u128); 3] = [(1, 3072 + 512), (2, 256), (4, 256)];

impl Small {
    fn new() -> Small {
        let child = leaves([1, 1, 2, 4]);
        let root = Pointered {
            representative: 1,
            size: 1,
            bitmap: vec![1],
            back: vec![1 + 8],
            run: vec![record([(INNER, 1), (LEAF, 1), (LEAF, 1), (LEAF, 1)], 2), child],
            zone: zone(2, &CLASSES),
        };
        Small { child: small(1, &[child]), root }
    }

    /// Returns the file with a changed root record.
    fn with(change: impl FnOnce(&mut Pointered)) -> Vec<u8> {
        let mut small = Small::new();
        change(&mut small.root);
        small.file()
    }

    fn file(&self) -> Vec<u8> {
        let root = FIRST + self.child.len() as u64;
        claiming(6, &[&self.child[..], &self.root.bytes()].concat(), root)
    }
}

#[test]
fn a_valid_crafted_file_is_read() {
    let value = |file: &Autumnal, level, cell| {
        file.value_at(Code::from_cell(Dimension::Quad, level, cell).unwrap()).unwrap()
    };
    let claims = Claims { depth: 1, root: (FIRST, 1), totals: (4, 1), previous: 0 };
    let file = Autumnal::from_bytes(crafted(&small(1, &[leaves([1, 1, 2, 4])]), claims)).unwrap();
    assert_eq!(value(&file, 1, [1, 1, 0]), Some(byte(4)));
    assert_eq!(file.verify(1 << 20, &()).unwrap(), []);
    let file = Autumnal::from_bytes(Small::new().file()).unwrap();
    assert_eq!(value(&file, 6, [31, 31, 0]), Some(byte(4)));
    assert_eq!(value(&file, 2, [0, 1, 0]), Some(byte(2)));
    assert_eq!(value(&file, 6, [32, 31, 0]), Some(byte(1)));
    assert_eq!(file.verify(1 << 20, &()).unwrap(), []);
    // Pointers may be longer than necessary.
    for size in 2..=8 {
        let file = Autumnal::from_bytes(Small::with(|root| root.size = size)).unwrap();
        assert_eq!(value(&file, 6, [31, 31, 0]), Some(byte(4)));
        assert_eq!(file.verify(1 << 20, &()).unwrap(), []);
    }
}

/// A record that continues in the unchecked bytes after its extent. Whether a reader notices
/// depends on whether the file is mapped; verification always does.
#[test]
fn verification_reports_a_record_that_exceeds_its_extent() {
    let run = [record([(INNER, 1), (LEAF, 2), (LEAF, 4), (LEAF, 4)], 2), leaves([1, 1, 1, 3])];
    let claims = Claims { depth: 2, root: (FIRST, 4), totals: (16, 2), previous: 0 };
    let whole = Autumnal::from_bytes(crafted(&small(4, &run), claims)).unwrap();
    assert_eq!(whole.verify(1 << 20, &()).unwrap(), []);
    let mut bytes = crafted(&small(4, &run[..1]), claims);
    bytes[FIRST as usize + 9..][..8].copy_from_slice(&run[1]);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    std::fs::write(&path, bytes).unwrap();
    let cell = Code::from_cell(Dimension::Quad, 2, [1, 1, 0]).unwrap();
    for (options, is_mapped) in [(OpenOptions::new(), true), (OpenOptions::new().positioned(1 << 20), false)]
    {
        let file = Autumnal::open(&path, &options).unwrap();
        assert_eq!(file.value_at(cell).ok(), is_mapped.then_some(Some(byte(3))));
        assert_eq!(file.verify(1 << 20, &()).unwrap().len(), 1);
    }
}

#[test]
fn invalid_pointers_are_rejected() {
    let root = FIRST + 9;
    for (what, size, back) in [
        ("itself, near", 1, 0),
        ("itself, far", 8, 0),
        ("forward, by going round", 8, u64::MAX),
        ("before the file", 2, 65535),
        ("after the end of the file, by overflow", 8, 1 << 63),
        ("the start of the file", 3, root),
        ("the header", 3, root - 60),
        ("a meta slot", 3, root - 4096),
        ("the head of an extent", 1, 9 + 3),
        ("the record's second byte", 1, 8),
    ] {
        let file = Small::with(|root| {
            root.size = size;
            root.back = vec![back];
        });
        assert!(is_refused(what, file), "{what}");
    }
    let leaf = small(1, &[leaves([1, 1, 2, 4])]);
    for (what, root) in [
        ("the root after the end of the file", 1 << 40),
        ("the root in the metadata", FIRST + 512),
        ("the root in the header", 100),
        ("a root that is cut short", FIRST + 5),
    ] {
        assert!(is_refused(what, claiming(1, &leaf, root)), "{what}");
    }
    // Two records that point to each other cannot both point back.
    let mut first = Small::new().root;
    (first.size, first.back) = (8, vec![0]);
    let length = first.bytes().len() as u64;
    first.back = vec![length.wrapping_neg()];
    let second = Pointered { back: vec![length], ..first.clone() };
    let cycle = [first.bytes(), second.bytes()].concat();
    assert!(is_refused("a cycle", claiming(11, &cycle, FIRST + length)));
    // A record belongs to one height: at this height it should have pointers.
    let Small { child, root } = Small::new();
    let records = [child, root.bytes()].concat();
    assert!(is_refused("the record of a node of another height", claiming(9, &records, FIRST + 9)));
    // INNER and CUT states where only cells are possible.
    for state in [INNER, CUT] {
        let run = [record([(state, 1), (LEAF, 1), (LEAF, 2), (LEAF, 4)], 2), leaves([1, 1, 2, 4])];
        assert!(is_refused("too deep", claiming(1, &small(1, &run), FIRST)));
        let run = [record([(state, 1), (LEAF, 1), (LEAF, 2), (LEAF, 4)], 1)];
        assert!(is_refused("too deep", claiming(1, &small(1, &run), FIRST)));
    }
    let chain = |skip| record([(INNER, 1), (LEAF, 1), (LEAF, 2), (LEAF, 4)], skip);
    let run: Vec<Record> = (0..6).map(|level| chain(6 - level)).collect();
    assert!(is_refused("too deep by one", claiming(5, &small(1, &run), FIRST)));
}

#[test]
fn invalid_bitmaps_are_rejected() {
    for (what, size, bitmap, back) in [
        ("no pointer for what is INNER", 1, 0, vec![]),
        ("a pointer for what is uniform", 1, 0b11, vec![9, 9]),
        ("pointers for all", 1, 0b1111, vec![9; 4]),
        ("a pointer for another node", 1, 0b10, vec![9]),
        ("nodes that cannot be", 1, 0b10001, vec![9; 2]),
        ("very many nodes that cannot be", 1, 255, vec![9; 8]),
        ("pointers without bytes", 0, 1, vec![9]),
        ("pointers of nine bytes", 9, 1, vec![9]),
        ("pointers of 255 bytes", 255, 1, vec![9]),
        ("more pointers than there are", 8, 0b1111, vec![9]),
    ] {
        let file = Small::with(|root| (root.size, root.bitmap, root.back) = (size, vec![bitmap], back));
        assert!(is_refused(what, file), "{what}");
    }
}

#[test]
fn inconsistent_runs_are_rejected() {
    let inner = |state, skip| record([(state, 1), (LEAF, 1), (LEAF, 1), (LEAF, 1)], skip);
    let leaf = leaves([1, 1, 2, 4]);
    for (what, run) in [
        ("no record at all", vec![inner(INNER, 0), leaf]),
        ("a child's record is missing", vec![inner(INNER, 1)]),
        ("a child that is cut off", vec![inner(CUT, 1)]),
        ("more records than there can be", vec![inner(INNER, 342), leaf]),
        ("more records than there are bytes", vec![inner(INNER, 341), leaf]),
        ("a child's record ends after its parent's", vec![inner(INNER, 2), record([(LEAF, 1); 4], 2), leaf]),
        ("a child's record has no end", vec![inner(INNER, 2), record([(LEAF, 1); 4], 0)]),
        ("a record without a parent", vec![inner(LEAF, 2), leaf]),
        ("other leaves than the child's own record", vec![inner(INNER, 2), leaves([1, 1, 2, 3])]),
        ("another representative", vec![record([(INNER, 2), (LEAF, 1), (LEAF, 1), (LEAF, 1)], 2), leaf]),
        ("a block of no length that blocks have", vec![dense(1, 1, 2), leaf]),
        ("a block of no kind", [vec![dense(6, 1, 11)], vec![leaf; 10]].concat()),
        ("a block above the run's bottom", [vec![dense(1, 1, 11)], vec![leaf; 10]].concat()),
    ] {
        let file = Small::with(|root| root.run = run.clone());
        assert!(is_refused(what, file), "{what}");
        // The same in a record that consists of one run.
        if !what.starts_with("other") && !what.starts_with("another") {
            assert!(is_refused(what, claiming(5, &small(1, &run), FIRST)), "{what}");
        }
    }
    // Cut off above the nodes that pointers lead to.
    let above = Pointered { run: vec![inner(CUT, 1)], ..Small::new().root };
    let records = [small(1, &[leaf]), above.bytes()].concat();
    assert!(is_refused("a child that is cut off too high", claiming(7, &records, FIRST + 9)));
    // Blocks that extend below cell level.
    for (levels, skip) in [(3, 11), (4, 43), (5, 171)] {
        let run = [vec![dense(1, 1, skip)], vec![leaf; skip as usize - 1]].concat();
        let what = format!("a block of {levels} levels");
        assert!(is_refused(&what, claiming(levels - 1, &small(1, &run), FIRST)), "{what}");
    }
}

#[test]
fn a_pointer_into_a_hole_is_not_followed_to_its_beginning() {
    let hole = 40 << 20;
    let root = FIRST + hole;
    let record = Pointered { size: 4, back: vec![1 << 20], ..Small::new().root };
    let claims = Claims { depth: 6, root: (root, 1), totals: (1 << 12, 2), previous: 0 };
    let file = crafted_after(hole as usize, &record.bytes(), claims);
    let CountedFile { editor, work, .. } = &CountedFile::new(file);
    let code = Code::from_cell(Dimension::Quad, 6, [0, 0, 0]).unwrap();
    let (found, reads) = work.of(|| editor.tree().value_at(code));
    // The search stops at the maximum length of an extent, sector by sector.
    assert!(found.is_err() && reads < (16 << 20) / 512 + 100, "{reads}");
}

#[test]
fn cyclic_commits_are_rejected() {
    for previous in [FIRST, FIRST_EXTENT as u64, 1 << 40, u64::MAX, 100] {
        let claims = Claims { depth: 1, root: (FIRST, 1), totals: (4, 1), previous };
        let bytes = crafted(&small(1, &[leaves([1, 1, 2, 4])]), claims);
        assert!(is_refused("a commit before", bytes.clone()), "{previous}");
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.autumn");
        std::fs::write(&path, bytes).unwrap();
        let name = format!("{}@0", path.display());
        assert!(Autumnal::open(name.as_ref(), &Default::default()).is_err());
    }
}

/// Returns the five levels below a node, with all nodes of a level alike, as a dense block whose
/// bottom nodes have a state.
fn folded_run(state: u8, cells_of_four: [u8; 4]) -> Vec<Record> {
    let (kind, bottom) = if state == CUT { (2, [2; 4]) } else { (1, cells_of_four) };
    let mut payload = vec![2; 16 + 64 + 256];
    // Rows of the bottom level.
    payload.extend((0..1024).map(|i| bottom[i % 2 + i / 32 % 2 * 2]));
    [&[dense(kind, 2, 171)][..], payload.as_chunks::<8>().0].concat()
}

/// The cells of each bottom node in folded trees.
const PATTERN: [u8; 4] = [1, 2, 2, 3];

/// Returns a tree of a depth in which all nodes of a level share one record. `records` gives the
/// count that zones claim per height.
pub(super) fn folded(depth: u8, records: impl Fn(u8) -> u128) -> Vec<u8> {
    folded_of(depth, PATTERN, records)
}

/// Returns a [`folded`] tree of other cells, which its zones do not reflect.
pub(super) fn folded_of(depth: u8, cells_of_four: [u8; 4], records: impl Fn(u8) -> u128) -> Vec<u8> {
    let mut bytes = small(2, &folded_run(LEAF, cells_of_four));
    let (mut at, mut height) = (0, 5);
    while height < depth {
        let here = bytes.len();
        let above = (height + 2).min(depth);
        let nodes: usize = 1 << (2 * (above - height));
        let quarter = 1 << (2 * above - 2);
        let record = Pointered {
            representative: 2,
            size: 2,
            bitmap: (u64::MAX >> (64 - nodes)).to_le_bytes()[..nodes.div_ceil(8)].to_vec(),
            back: vec![(here - at) as u64; nodes],
            run: folded_run(CUT, cells_of_four),
            zone: zone(records(above), &[(1, quarter), (2, 2 * quarter), (3, quarter)]),
        };
        bytes.extend(record.bytes());
        (at, height) = (here, above);
    }
    let totals = (1 << (2 * depth), full(depth) as u64);
    crafted(&bytes, Claims { depth, root: (FIRST + at as u64, 2), totals, previous: 0 })
}

/// Record count of a full tree.
pub(super) fn full(height: u8) -> u128 {
    ((1 << (2 * u32::from(height))) - 1) / 3
}

#[test]
fn subtrees_shared_beyond_all_bounds_take_no_time() {
    // 20 kB represent as many nodes as a file of 2^60 bytes has: feasible queries return results.
    let bytes = folded(29, full);
    assert!(bytes.len() < 40_000, "{}", bytes.len());
    let file = Arc::new(Autumnal::from_bytes(bytes.clone()).unwrap());
    for cell in [[0, 0, 0], [1 << 28, 12_345_679, 0], [(1 << 29) - 1, (1 << 29) - 1, 0]] {
        let expected = PATTERN[((cell[0] & 1) + 2 * (cell[1] & 1)) as usize];
        assert_eq!(
            file.value_at(Code::from_cell(Dimension::Quad, 29, cell).unwrap()).unwrap(),
            Some(byte(expected))
        );
    }
    let statistics = dataset(&file).statistics(None, &()).unwrap();
    assert_eq!(statistics.cells, 1 << 58);
    assert_eq!(statistics.classes, [(1.into(), 1 << 56), (2.into(), 1 << 57), (3.into(), 1 << 56)]);
    is_refused("honest", bytes);
    // Claims that are too small are found during the traversal.
    assert!(is_refused("one record each", folded(29, |_| 1)));
    assert!(is_refused("few records each", folded(29, |height| full(8) * u128::from(height))));
    assert!(is_refused("none", folded(29, |_| 0)));
    assert!(is_refused("more than fit", folded(29, |_| u128::from(u64::MAX) + 1)));
    // The minimum that their pointers allow is still too many.
    let least = |height: u8| (17 << (2 * (height - 7))) + full(height - 7);
    assert!(is_refused("the least that is possible", folded(29, least)));
    // Fewer than that, with no zones below.
    assert!(is_refused("fewer than pointers", folded(7, |_| 16)));
    assert!(is_refused("a wrong number that is possible", folded(7, |_| 17)));
    // A tree that is small enough to traverse is read completely.
    for depth in [5, 6, 7, 8, 9] {
        let small = Autumnal::from_bytes(folded(depth, full)).unwrap();
        let cell = |[x, y, _]: [u64; 3]| Some(byte(PATTERN[((x & 1) + 2 * (y & 1)) as usize]));
        let expected = made(QUAD, [1 << depth, 1 << depth, 1], cell);
        assert_same(&cells_of(&small, expected.size), &expected, "folded");
        // Nodes that share a record share a position, also in the rebuilt tree.
        assert_eq!(small.verify(1 << 24, &()).unwrap(), [], "{depth}");
    }
}

#[test]
fn oversized_zones_and_lengths_are_rejected() {
    for (what, zone) in [
        ("nothing", vec![]),
        ("a number without end", vec![255; 40]),
        ("more cells than there are", [leb128(2), leb128(5000)].concat()),
        ("very many classes", [leb128(2), leb128(4096), vec![1, 3, 0, 0], leb128(1 << 60)].concat()),
        ("classes that are not there", [leb128(2), leb128(4096), vec![1, 3, 0, 0], leb128(4000)].concat()),
        ("as many records as no tree has", zone(full(6) + 1, &CLASSES)),
        ("fewer records than pointers", zone(1, &CLASSES)),
        ("a record that is not there", zone(3, &CLASSES)),
    ] {
        assert!(is_refused(what, Small::with(|root| root.zone = zone)), "{what}");
    }
    // An extent longer than the file, with a valid head.
    let mut file = Small::new().file();
    let start = FIRST_EXTENT;
    file[start + 16..start + 24].copy_from_slice(&u64::MAX.to_le_bytes());
    let checksum = crc32c::crc32c(&file[start..start + 28]);
    file[start + 28..start + 32].copy_from_slice(&checksum.to_le_bytes());
    assert!(is_refused("a long extent", file));
}
