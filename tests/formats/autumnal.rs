//! Autumnal files against Goblin files and the tree in memory: building, reading, conversion,
//! sharing.

use std::path::Path;

use spinney::query::Condition;
use spinney::raw::dataset;
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::build_tree;
use spinney::tree::{Child, MemTree, Source};
use spinney::{
    Bounds, Code, DataKind, Dataset, Dimension, Number, OpenOptions, Output, Rule, SampleType, TreeType,
    WriteOptions, convert,
};

use crate::common::{
    self, CLASSIC, Cells, OCT, QUAD, Random, byte, children, goblin_bytes, made, oct, options, quad,
    same_trees, value_types,
};

/// Writes cells to a file, as slabs.
fn write_cells(path: &Path, cells: &Cells, (rule, kind): (Rule, DataKind), share: bool) {
    common::write_cells(path, cells, &options(rule, kind, cells.depth()).share(share));
}

/// Writes a tree to a file.
fn write_tree(path: &Path, tree: &MemTree, extent: [u64; 3], (rule, kind): (Rule, DataKind), share: bool) {
    let options = options(rule, kind, tree.depth()).share(share);
    build_tree(tree, extent, &options, Output::create(path).unwrap(), &()).unwrap();
}

fn open(path: &Path) -> Autumnal {
    Autumnal::open(path, &OpenOptions::new()).unwrap()
}

/// Counts the INNER nodes that have records of their own: the root, and nodes of certain heights.
/// Files that store equal subtrees once have smaller records.
fn nodes_with_records(tree: &MemTree, share: bool) -> u64 {
    let depth = tree.depth();
    let first = match tree.form().dimension {
        _ if share => 2,
        Dimension::Quad => 5,
        Dimension::Oct => 3,
    };
    let step = 2;
    let mut open = vec![(tree.root().unwrap(), depth)];
    let mut found = 0;
    while let Some((subtree, height)) = open.pop() {
        let Child::Inner { node, .. } = subtree else { continue };
        found += u64::from(height == depth || height >= first && (height - first).is_multiple_of(step));
        open.extend(children(tree, &node).into_iter().map(|child| (child, height - 1)));
    }
    found
}

fn round_trip(form: TreeType, seed: u64, size: [u64; 3], rule: Rule, kind: DataKind) {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name);
    let cells = Cells::random(form, seed, size, 4 + seed % 60, !seed.is_multiple_of(3));
    let tree = cells.tree(rule);
    let published = goblin_bytes(&cells, rule, kind);
    let goblin_path = file("t.goblin");
    std::fs::write(&goblin_path, &published).unwrap();
    for share in [false, true] {
        let path = file(&format!("{share}.autumn"));
        convert(&goblin_path, share, Output::create(&path).unwrap(), WriteOptions::new(1 << 24), &())
            .unwrap();
        let autumnal = open(&path);
        same_trees(&autumnal, &tree);
        assert_eq!(autumnal.commit().inner_nodes, tree.inner_nodes() as u64);
        assert_eq!(autumnal.commit().number, 1);
        assert_good(&path);
        let written = autumnal.commit().written;
        assert_eq!(written.records + written.shared, nodes_with_records(&tree, share));
        assert!(share || written.shared == 0);
        // Converting back gives the same bytes.
        let back = file("back.goblin");
        convert(&path, false, Output::create(&back).unwrap(), WriteOptions::new(1 << 24), &()).unwrap();
        assert!(std::fs::read(&back).unwrap() == published, "{form} {rule} {kind} {size:?}");
    }
    let positioned = OpenOptions::new().positioned(64 << 20);
    assert_same_results(&file("false.autumn"), &goblin_path, &OpenOptions::new(), seed);
    assert_same_results(&file("true.autumn"), &goblin_path, &positioned, seed);
}

fn assert_good(path: &Path) {
    let tree = dataset::open(path, &OpenOptions::default()).unwrap();
    assert_eq!(tree.verify(1 << 24, &()).unwrap(), []);
}

/// Runs the same queries on both files and compares the results.
fn assert_same_results(a: &Path, b: &Path, options: &OpenOptions, seed: u64) {
    let mut random = Random(seed + 1);
    let (a, b) = (dataset::open(a, options).unwrap(), dataset::open(b, options).unwrap());
    let (a, b): (&Dataset, &Dataset) = (&a, &b);
    let (depth, extent, form) = (b.depth(), b.header().extent, b.header().form);
    let (value, is_octree) = (form.value, form.dimension == Dimension::Oct);
    for _ in 0..12 {
        let level = random.below(u64::from(depth) + 1) as u8;
        let min: [u64; 3] = std::array::from_fn(|axis| random.below(extent[axis]));
        let max = std::array::from_fn(|axis| {
            min[axis] + 1 + random.below(extent[axis] + 5 - min[axis].min(extent[axis]))
        });
        let bounds = Bounds { min, max: if is_octree { max } else { [max[0], max[1], 1] } };
        let bounds =
            Bounds { min: bounds.min, max: std::array::from_fn(|i| bounds.max[i].max(bounds.min[i] + 1)) };
        let mut statistics = [a, b].map(|tree| tree.statistics(Some(bounds), &()).unwrap());
        statistics.iter_mut().for_each(|statistics| statistics.segments_read = 0);
        if !value.sample.is_float() {
            assert_eq!(statistics[0], statistics[1]);
        }
        assert_eq!(statistics[0].cells, statistics[1].cells);
        let histograms = [a, b].map(|tree| tree.histogram(&bounds, 0.0, 64.0, 7, &()).unwrap());
        assert_eq!(histograms[0], histograms[1]);
        let shown = Bounds {
            min: bounds.min.map(|x| x >> (depth - level)),
            max: bounds.max.map(|x| (x >> (depth - level)) + 1),
        };
        let shown = if is_octree {
            shown
        } else {
            Bounds { min: [shown.min[0], shown.min[1], 0], max: [shown.max[0], shown.max[1], 1] }
        };
        let windows = [a, b].map(|tree| {
            let mut bytes = vec![0; shown.volume() as usize * value.size()];
            let mut valid = vec![false; shown.volume() as usize];
            tree.window(level, &shown, 9.0, &mut bytes, Some(&mut valid)).unwrap();
            (bytes, valid)
        });
        assert!(windows[0] == windows[1], "{shown:?} at level {level}");
        let cells: Vec<[u64; 3]> =
            (0..50).map(|_| std::array::from_fn(|axis| random.below(shown.max[axis] + 2))).collect();
        for cell in cells {
            let points = [a, b].map(|tree| {
                let mut samples = [Number::default(); 4];
                let found = tree.point(cell, level, &mut samples).unwrap();
                (found, samples)
            });
            assert_eq!(points[0].0, points[1].0, "{cell:?}");
            assert!(!points[0].0 || points[0] == points[1], "{cell:?}");
        }
    }
    let found = [a, b].map(|tree| {
        let mut found = Vec::new();
        tree.find(Condition::Above(2.0.into()), None, &(), &mut |block| {
            // The formats differ in which blocks have a zone that does not determine a value.
            found.push((block.code, block.bounds));
            Ok(true)
        })
        .unwrap();
        found
    });
    assert_eq!(found[0], found[1]);
}

#[test]
fn quadtrees_of_every_type_and_rule_round_trip() {
    use DataKind::{Categorical, Continuous};
    use SampleType::*;
    for seed in 0..4 {
        let size = [1 + 137 * seed, 300 - 40 * seed, 1];
        round_trip(QUAD, seed, size, Rule::Majority, Categorical);
        round_trip(quad(F32, 1), seed, size, Rule::Mean, Continuous);
        round_trip(quad(I16, 1), seed, size, Rule::ALL[seed as usize], Continuous);
    }
    round_trip(QUAD, 7, [513, 700, 1], Rule::Mean, Categorical);
    round_trip(quad(U16, 4), 7, [200, 300, 1], Rule::Mean, Continuous);
    round_trip(quad(U16, 1), 8, [300, 300, 1], Rule::Dominant, Categorical);
    round_trip(quad(F64, 1), 11, [257, 256, 1], Rule::Mean, Continuous);
    round_trip(quad(U8, 2), 13, [1, 1, 1], Rule::Mean, Continuous);
    round_trip(quad(U8, 4), 14, [2, 1, 1], Rule::Nearest, Continuous);
}

#[test]
fn slabs_and_sources_make_the_same_tree() {
    let directory = tempfile::tempdir().unwrap();
    let (slabs, source) = (directory.path().join("slabs.autumn"), directory.path().join("source.autumn"));
    for seed in 0..5 {
        let size = [1 + 137 * seed, 300 - 40 * seed, 1];
        let cells = Cells::random(QUAD, seed, size, 9, true);
        let tree = cells.tree(Rule::Mean);
        write_cells(&slabs, &cells, (Rule::Mean, DataKind::Continuous), seed % 2 == 0);
        write_tree(&source, &tree, size, (Rule::Mean, DataKind::Continuous), seed % 2 == 0);
        for path in [&slabs, &source] {
            let file = open(path);
            same_trees(&file, &tree);
            assert_good(path);
            drop(file);
            std::fs::remove_file(path).unwrap();
        }
    }
}

#[test]
fn octrees_round_trip() {
    for seed in 0..3 {
        let size = [1 + 13 * seed, 70 - 9 * seed, 1 + 17 * seed];
        round_trip(OCT, seed, size, Rule::Occupancy, DataKind::Continuous);
        round_trip(OCT, seed, size, Rule::ALL[seed as usize], DataKind::Categorical);
    }
    round_trip(oct(SampleType::F32, 3), 3, [65, 20, 70], Rule::Mean, DataKind::Continuous);
}

/// Each file selects its records, kernels and rules at run time: every combination must be covered.
#[test]
fn every_type_round_trips_in_both_dimensions() {
    for (i, value) in value_types().into_iter().enumerate() {
        let (seed, rule) = (i as u64, Rule::ALL[i % Rule::ALL.len()]);
        let kind = if i % 2 == 0 { DataKind::Continuous } else { DataKind::Categorical };
        round_trip(TreeType::new(Dimension::Quad, value), seed, [90, 71, 1], rule, kind);
        round_trip(TreeType::new(Dimension::Oct, value), seed, [13, 18, 9], rule, kind);
    }
}

#[test]
fn the_table_of_the_literature() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("classic.autumn");
    let raster =
        made(QUAD, [8, 8, 1], |[x, y, _]| Some(byte(CLASSIC[y as usize][x as usize]))).tree(Rule::Dominant);
    write_tree(&path, &raster, [8, 8, 1], (Rule::Dominant, DataKind::Categorical), false);
    let file = dataset::open(&path, &OpenOptions::default()).unwrap();
    let table = file.classic_table(100).unwrap();
    let rows: Vec<Vec<i32>> = table
        .lines()
        .map(|line| line.split_whitespace().map(|number| number.parse().unwrap()).collect())
        .collect();
    // Number, four children (leaf < 0, record > 0), representative.
    let expected = [
        [1, 2, 5, -1, 9, 1],
        [2, -1, 3, -1, 4, 1],
        [3, -1, -3, -3, -3, 3],
        [4, -3, -3, -1, -2, 3],
        [5, 6, -1, 7, 8, 1],
        [6, -3, -1, -3, -3, 3],
        [7, -3, -2, -2, -2, 2],
        [8, -1, -1, -2, -2, 1],
        [9, -2, -2, -1, 10, 2],
        [10, -1, -2, -1, -1, 1],
    ];
    assert_eq!(rows, expected);
    // The survey's count: a point query needs 2.125 records on average, at most 3.
    let reads = |cell: u32| {
        let code = Code::from_cell(Dimension::Quad, 3, [cell % 8, cell / 8, 0]).unwrap();
        let mut subtree = raster.root().unwrap();
        let mut reads = 0;
        for step in code.digits() {
            let Child::Inner { node, .. } = subtree else { break };
            reads += 1;
            subtree = children(&raster, &node)[step];
        }
        reads
    };
    let reads: Vec<u32> = (0..64).map(reads).collect();
    assert_eq!((reads.iter().sum::<u32>(), reads.iter().max()), (136, Some(&3)));
}

#[test]
fn the_bytes_do_not_depend_on_threads() {
    let directory = tempfile::tempdir().unwrap();
    let cells = Cells::random(QUAD, 3, [700, 600, 1], 5, true);
    let files: Vec<Vec<u8>> = [1, 2, 5]
        .into_iter()
        .map(|threads| {
            let path = directory.path().join(format!("{threads}.autumn"));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| write_cells(&path, &cells, (Rule::Majority, DataKind::Categorical), true));
            std::fs::read(&path).unwrap()
        })
        .collect();
    assert!(files[1..].iter().all(|file| *file == files[0]));
}

/// The file has many more distinct subtrees than fit in the memory limit, each twice.
#[test]
fn which_subtrees_are_shared_does_not_depend_on_the_memory() {
    let directory = tempfile::tempdir().unwrap();
    let part = Cells::random(QUAD, 1, [1024, 512, 1], 4, false);
    let twice = made(QUAD, [1024, 1024, 1], |[x, y, _]| part.get([x, y % 512, 0]));
    let files = [1 << 20, 1 << 28].map(|memory| {
        let path = directory.path().join(format!("{memory}.autumn"));
        let options =
            options(Rule::Majority, DataKind::Categorical, twice.depth()).share(true).memory(memory);
        common::write_cells(&path, &twice, &options);
        let written = open(&path).commit().written;
        assert!(written.shared >= 1 << 14, "{written:?}");
        std::fs::read(path).unwrap()
    });
    assert!(files[0] == files[1]);
    // Copies depend on the source file: they record its identity.
    let source = directory.path().join(format!("{}.autumn", 1 << 20));
    let copies = [1 << 20, 1 << 28].map(|memory| {
        let copy = directory.path().join(format!("copy-{memory}.autumn"));
        convert(&source, true, Output::create(&copy).unwrap(), WriteOptions::new(memory), &()).unwrap();
        std::fs::read(copy).unwrap()
    });
    assert!(copies[0] == copies[1]);
}

#[test]
fn equal_subtrees_are_stored_once() {
    let directory = tempfile::tempdir().unwrap();
    // An image of 64 equal tiles.
    let part = Cells::random(QUAD, 1, [64, 64, 1], 4, false);
    let tiled = made(QUAD, [512, 512, 1], |[x, y, _]| part.get([x % 64, y % 64, 0]));
    let records = [false, true].map(|share| {
        let path = directory.path().join(format!("{share}.autumn"));
        write_cells(&path, &tiled, (Rule::Majority, DataKind::Categorical), share);
        let file = open(&path);
        let written = file.commit().written;
        assert_eq!(written.records + written.shared, nodes_with_records(&tiled.tree(Rule::Majority), share));
        (written.records, written.bytes)
    });
    // At most the records of 4 x 4 and 16 x 16 cells of one tile, one each of 64 x 64 and 256 x
    // 256, and the root's.
    assert_eq!(records[0].0, 256 + 16 + 1, "{records:?}");
    assert!(records[1].0 <= 256 + 16 + 1 + 1 + 1, "{records:?}");
    // Including pages and heads.
    assert!(records[1].1 < records[0].1 / 16, "{records:?}");
    // Equal subtrees may be small: a symbol repeated at unrelated positions.
    let mut random = Random(5);
    let mut signs = vec![false; 128 * 128];
    (0..2000).for_each(|_| signs[random.below(128 * 128) as usize] = true);
    let scattered = made(QUAD, [512, 512, 1], |[x, y, _]| {
        if signs[(y / 4 * 128 + x / 4) as usize] { part.get([x % 4, y % 4, 0]) } else { Some(byte(1)) }
    });
    let [alone, shared] = [false, true].map(|share| {
        let path = directory.path().join(format!("scattered-{share}.autumn"));
        write_cells(&path, &scattered, (Rule::Majority, DataKind::Categorical), share);
        assert_good(&path);
        open(&path).commit().written.bytes
    });
    assert!(shared < alone / 2, "{shared} of {alone}");
}

#[test]
fn levels_are_counted_up_to_a_limit() {
    let tree = spinney::open(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/history.autumn")).unwrap();
    assert!(tree.level_counts(3, &()).unwrap().is_none());
    assert_eq!(tree.level_counts(u64::MAX, &()).unwrap().unwrap().levels().len(), 4);
}
