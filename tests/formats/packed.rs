//! Packed segments: the same trees and query results in fewer bytes, and errors if they are
//! corrupt.

use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use spinney::edit::Note;
use spinney::query::{ContourLevels, ContourRequest, PointSamples, PolygonRequest};
use spinney::raw::query::LabelRequest;
use spinney::raw::store::Packing;
use spinney::raw::store::goblin::{Goblin, LevelBytes};
use spinney::raw::{dataset, ops};
use spinney::tree::build_slabs;
use spinney::{
    Bounds, BuildOptions, Codec, CombineOperation, CombineOptions, DataKind, Dataset, Dimension, Error,
    FileAccess, FileView, OpenOptions, Output, Rule, SampleType, TreeType, WriteOptions,
};

use super::attack_goblin::{TREE_FIELDS, changed, fields};
use super::malicious::truncate_and_flip;
use super::ranges::{self, Query, queries, query};
use crate::common::{
    Cells, QUAD, Random, bytes_of, goblin_bytes, oct, oct_size, options, quad, quad_size, value, value_types,
    write_cells,
};
use crate::targets::seal;
use crate::targets::trees::query_goblin;

const MEMORY: u64 = 64 << 20;

fn packing() -> WriteOptions {
    WriteOptions::new(MEMORY).packing(Packing::packed())
}

/// Returns a file's bytes with another packing.
fn converted(bytes: &[u8], how: WriteOptions) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let [from, to] = ["from.goblin", "to.goblin"].map(|name| directory.path().join(name));
    std::fs::write(&from, bytes).unwrap();
    spinney::convert(&from, false, Output::create(&to).unwrap(), how, &()).unwrap();
    std::fs::read(&to).unwrap()
}

pub(super) fn packed(bytes: &[u8]) -> Vec<u8> {
    converted(bytes, packing())
}

fn plain(bytes: &[u8]) -> Vec<u8> {
    converted(bytes, WriteOptions::new(MEMORY))
}

/// Returns the bytes of a packed file written from slabs.
fn built(cells: &Cells, rule: Rule, kind: DataKind, memory: u64) -> Vec<u8> {
    bytes_of(|path| {
        let how = packing();
        let options = options(rule, kind, cells.depth()).packing(how.packing).memory(memory);
        write_cells(path, cells, &options);
    })
}

fn open(bytes: &[u8]) -> Dataset {
    Dataset::of(Goblin::from_bytes(bytes.to_vec()).unwrap().into()).unwrap()
}

/// Counts segments and packed segments, and sums their stored and unpacked bytes.
fn sums(tree: &Dataset) -> [u64; 4] {
    let levels = tree.level_bytes(usize::MAX).unwrap().unwrap();
    let sum = |of: fn(&LevelBytes) -> u64| levels.iter().map(of).sum();
    [sum(|of| of.segments), sum(|of| of.packed), sum(|of| of.bytes), sum(|of| of.plain)]
}

fn kind_of(rule: Rule) -> DataKind {
    if rule == Rule::Majority { DataKind::Categorical } else { DataKind::Continuous }
}

/// Returns trees of several segments, of both dimensions and several types.
fn large_files() -> &'static [Large] {
    static ALL: LazyLock<Vec<Large>> = LazyLock::new(|| {
        let of = |cells: Cells, rule: Rule| {
            let plain = goblin_bytes(&cells, rule, kind_of(rule));
            Large { packed: Arc::new(packed(&plain)), plain }
        };
        vec![
            of(Cells::random(QUAD, 8, [600, 520, 1], 100, true), Rule::Mean),
            of(Cells::noise(QUAD, 3, [400, 300, 1], 30), Rule::Majority),
            of(Cells::noise(quad(SampleType::F32, 2), 4, [520, 300, 1], 30), Rule::Mean),
            of(Cells::noise(oct(SampleType::U16, 1), 5, [70, 90, 66], 30), Rule::Max),
        ]
    });
    &ALL
}

/// A file, and the same packed.
struct Large {
    plain: Vec<u8>,
    packed: Arc<Vec<u8>>,
}

#[test]
fn packed_and_back_the_bytes_are_the_same() {
    let mut random = Random(71);
    let mut sum = [0; 4];
    for (number, value_type) in value_types().into_iter().enumerate() {
        for dimension in [Dimension::Quad, Dimension::Oct] {
            let form = TreeType::new(dimension, value_type);
            // Every second rule per type, to limit the run time.
            for rule in Rule::ALL.into_iter().skip((number + form.axes()) % 2).step_by(2) {
                let size = if form.axes() == 2 { quad_size(&mut random) } else { oct_size(&mut random) };
                let cells = Cells::random(form, number as u64 + 100, size, 60, true);
                let kind = kind_of(rule);
                let first = goblin_bytes(&cells, rule, kind);
                let small = packed(&first);
                let what = format!("{form}, {rule}, {size:?}");
                assert!(small == built(&cells, rule, kind, MEMORY), "{what}: built otherwise");
                assert!(plain(&small) == first, "{what}: not what it was");
                let (tree, same) = (open(&small), open(&first));
                assert_eq!(tree.header().codec, Codec::Packed, "{what}");
                assert_eq!(tree.verify(MEMORY, &()).unwrap(), [], "{what}");
                assert_eq!(tree.stored_records(), same.stored_records());
                let [segments, packed, bytes, unpacked] = sums(&tree);
                assert_eq!([segments, 0, unpacked, unpacked], sums(&same), "{what}");
                assert!(bytes <= unpacked);
                sum = [sum[0] + segments, sum[1] + packed, sum[2] + bytes, sum[3] + unpacked];
            }
        }
    }
    assert!(sum[1] > sum[0] / 2 && sum[2] < sum[3], "{sum:?}");
}

/// Queries in addition to those of the tests of remote files. Unsupported queries fail with the
/// same message.
fn more_queries() -> Vec<Query> {
    vec![
        query("all of it as text", |tree| tree.df_text(1 << 22)),
        query("the classic table", |tree| tree.classic_table(1 << 22)),
        query("codes of leaves", |tree| tree.leaf_codes(1 << 22)),
        query("nodes by level", |tree| {
            Ok(tree.level_counts(u64::MAX, &())?.map(|counts| counts.levels().to_vec()))
        }),
        query("rows as they are stored", |tree| {
            // Files without stored rows copy them.
            tree.stored_rows(tree.depth(), &Bounds { min: [0; 3], max: [16, 16, 1] }).map(|_| ())
        }),
        query("contours", |tree| {
            let (mut lines, levels) = (Vec::new(), ContourLevels::Every { step: 40.0, base: 0.5 });
            tree.contours(&ContourRequest::new(levels), &(), &mut |line| {
                lines.push((line.value(), line.count(0), line.is_closed()));
                Ok(())
            })?;
            Ok(lines)
        }),
        query("polygons", |tree| {
            let mut regions = Vec::new();
            tree.polygons(&PolygonRequest::new(), &(), &mut |region| {
                regions.push(region.cells());
                Ok(())
            })?;
            Ok(regions)
        }),
        query("labels", |tree| {
            let mut request = LabelRequest::new();
            request.connect = Some(if tree.header().form.axes() == 2 { "4" } else { "6" }.parse()?);
            let mut labels = Vec::new();
            tree.labels(&request, &(), &mut |label| {
                labels.push(label.cells());
                Ok(())
            })?;
            Ok(labels)
        }),
        query("a solid", |tree| tree.solid(tree.depth(), &()).map(|solid| format!("{solid:?}"))),
        query("verification of all", |tree| tree.verify(MEMORY, &())),
    ]
}

#[test]
fn all_queries_have_the_same_results() {
    let directory = tempfile::tempdir().unwrap();
    for (number, Large { plain: bytes, packed: small }) in large_files().iter().enumerate() {
        let path = directory.path().join(format!("{number}.goblin"));
        std::fs::write(&path, &**small).unwrap();
        let open_as = |options: &OpenOptions| dataset::open(&path, options).unwrap();
        let trees =
            [open(small), open_as(&OpenOptions::new()), open_as(&OpenOptions::new().positioned(1 << 20))];
        let (expected, [segments, packed, ..]) = (open(bytes), sums(&trees[0]));
        assert!(segments > 2 && packed > segments / 2, "{packed} of {segments} of file {number}");
        let name = path.display().to_string();
        for (what, query) in queries().into_iter().chain(more_queries()) {
            let result =
                |tree: &Dataset| query(tree).map_err(|error| error.to_string().replace(&name, "(memory)"));
            let right = result(&expected);
            // The first file in all ways, each of the others in one.
            let ways = if number == 0 { 0..3 } else { number - 1..number };
            for (way, tree) in trees.iter().enumerate().filter(|(way, _)| ways.contains(way)) {
                assert!(result(tree) == right, "{what} of file {number}, opened in way {way}");
            }
        }
    }
}

#[test]
fn remote_files_have_the_same_results() {
    for (number, Large { plain: bytes, packed: small }) in large_files().iter().enumerate() {
        let expected = open(bytes);
        for (what, query) in queries() {
            let right = query(&expected).unwrap();
            // Each with an empty cache, and with a cache that holds hardly anything.
            for cache in [64 << 20, 100_000] {
                let (file, batches) = ranges::far(small, cache);
                let found = ranges::opened(file).and_then(|tree| query(&tree)).unwrap();
                assert!(found == right, "{what} of file {number} with {cache} bytes");
                let batches = batches.lock().unwrap();
                assert!(cache < 64 << 20 || batches.len() <= 43, "{what}: {batches:?}");
            }
        }
    }
}

#[test]
fn operations_make_the_same_of_packed_files() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let create = |name: &str| Output::create(&path(name)).unwrap();
    for (number, Large { plain: bytes, packed: small }) in large_files().iter().enumerate() {
        let other = open(bytes);
        let form = other.header().form;
        let second = Cells::random(form, 77, other.header().extent, 20, true);
        let second = goblin_bytes(&second, other.header().rule, other.header().kind);
        for (name, bytes) in [
            ("a.goblin", bytes.clone()),
            ("b.goblin", second.clone()),
            ("pa.goblin", small.to_vec()),
            ("pb.goblin", packed(&second)),
        ] {
            std::fs::write(path(name), bytes).unwrap();
        }
        // The output depends on file names.
        let cells_of = |name: &str| {
            let tree = dataset::open(&path(name), &OpenOptions::new()).unwrap();
            let mut options = tree.build_options(MEMORY);
            options.metadata.provenance.clear();
            let bytes = bytes_of(|to| tree.build(&options, Output::create(to).unwrap(), &()).unwrap());
            (bytes, sums(&tree))
        };
        let shift = if form.axes() == 2 { "translate=64,64" } else { "translate=64,64,0" };
        // The first file with all operations, each of the others with one.
        let numbers = if number == 0 { 0..3 } else { number - 1..number };
        for step in &[None, Some(shift), Some("scale=0.5")][numbers] {
            let steps: Vec<spinney::ViewOperation> = step.iter().map(|step| step.parse().unwrap()).collect();
            let make = |name: &str, how| {
                let chain = FileView { steps: steps.clone(), ..FileView::of(&path(name)) };
                spinney::transform(&chain, create("out.goblin"), how, &()).unwrap();
                cells_of("out.goblin")
            };
            let [plain, packed] = [WriteOptions::new(MEMORY), packing()];
            let expected = make("a.goblin", plain);
            assert!(make("pa.goblin", plain) == expected, "{step:?} of file {number}");
            let small = make("a.goblin", packed);
            assert!(make("pa.goblin", packed) == small, "{step:?} of file {number}");
            assert!(small.0 == expected.0, "{step:?} of file {number}, packed");
        }
        for operation in [CombineOperation::Over, CombineOperation::Changed] {
            let made = [["a.goblin", "b.goblin"], ["pa.goblin", "b.goblin"], ["pa.goblin", "pb.goblin"]].map(
                |names| {
                    let files: Vec<PathBuf> = names.map(path).to_vec();
                    let how = packing();
                    let outcome = spinney::combine(
                        operation,
                        CombineOptions::default(),
                        &files,
                        create("out.goblin"),
                        how,
                        &(),
                    );
                    (outcome.unwrap(), cells_of("out.goblin"))
                },
            );
            assert!(made[0] == made[1] && made[0] == made[2], "{operation} of file {number}");
        }
    }
}

#[test]
fn packed_bytes_depend_only_on_the_content() {
    let cells = Cells::random(QUAD, 5, [1100, 700, 1], 9, true);
    let build = |threads, memory| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| built(&cells, Rule::Majority, DataKind::Categorical, memory))
    };
    let one = build(1, MEMORY);
    for (threads, memory) in [(2, MEMORY), (5, MEMORY), (1, 1 << 16), (3, 1 << 16), (2, 4 << 30)] {
        assert!(build(threads, memory) == one, "{threads} threads, {memory} bytes");
    }
    let plain = goblin_bytes(&cells, Rule::Majority, DataKind::Categorical);
    let convert = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| packed(&plain))
    };
    assert!(convert(1) == one && convert(4) == one);
}

#[test]
fn layers_are_copied_unchanged() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let cells = |seed| Cells::random(QUAD, seed, [700, 600, 1], 40, true);
    let [first, second] = [1, 2].map(|seed| goblin_bytes(&cells(seed), Rule::Mean, DataKind::Continuous));
    std::fs::write(path("a.goblin"), packed(&first)).unwrap();
    std::fs::write(path("b.goblin"), &second).unwrap();
    let before = sums(&dataset::open(&path("a.goblin"), &OpenOptions::new()).unwrap());
    let add = |name: &str, how| {
        let chain = FileView::of(&path("b.goblin"));
        ops::add_layer(&path("a.goblin"), name, &chain, Note::default(), how, &()).unwrap();
    };
    add("plain", WriteOptions::new(MEMORY));
    add("packed", packing());
    let all = dataset::open(&path("a.goblin"), &OpenOptions::new()).unwrap();
    let codecs = all.layers().unwrap().iter().map(|layer| layer.header.codec).collect::<Vec<_>>();
    assert_eq!(codecs, [Codec::Packed, Codec::Plain, Codec::Packed]);
    assert_eq!(all.verify(MEMORY, &()).unwrap(), []);
    assert_eq!(sums(&all.layer("a").unwrap()), before);
    assert_eq!(sums(&all.layer("plain").unwrap())[1], 0);
    let names = ["plain", "packed"].map(|name| all.layer(name).unwrap());
    for (_, query) in queries() {
        assert!(query(&names[0]).unwrap() == query(&names[1]).unwrap());
    }
    // Conversion does not inherit packing; its options decide.
    let how = WriteOptions::new(MEMORY);
    spinney::convert(&path("a.goblin"), false, Output::create(&path("c.goblin")).unwrap(), how, &()).unwrap();
    let all = dataset::open(&path("c.goblin"), &OpenOptions::new()).unwrap();
    assert!(all.layers().unwrap().iter().all(|layer| layer.header.codec == Codec::Plain));
    ops::drop_layer(&path("a.goblin"), "plain", Note::default(), &Default::default(), &()).unwrap();
    let all = dataset::open(&path("a.goblin"), &OpenOptions::new()).unwrap();
    assert!(all.layers().unwrap().iter().all(|layer| layer.header.codec == Codec::Packed));
}

#[test]
fn history_is_not_packed() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let cells = Cells::random(QUAD, 1, [90, 60, 1], 9, true);
    std::fs::write(path("a.goblin"), goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    let create = || Output::create(&path("a.autumn")).unwrap();
    let how = packing();
    let converted = spinney::convert(&path("a.goblin"), false, create(), how, &());
    let options = BuildOptions::new(DataKind::Continuous, 7).packing(how.packing);
    let nodata = Some(value(QUAD.value, 250));
    let built = build_slabs(QUAD, &mut cells.slabs(value(QUAD.value, 250)), nodata, &options, create(), &());
    for refused in [converted, built] {
        let text = refused.unwrap_err().to_string();
        assert!(text.contains("compact") && text.contains(".goblin"), "{text}");
        assert!(!path("a.autumn").exists());
    }
    spinney::convert(&path("a.goblin"), false, create(), WriteOptions::new(MEMORY), &()).unwrap();
    let chain = FileView::of(&path("a.goblin"));
    let added = ops::add_layer(&path("a.autumn"), "more", &chain, Note::default(), how, &());
    assert!(matches!(added, Err(Error::Unsupported { .. })));
    // From an Autumnal file, too.
    spinney::convert(&path("a.autumn"), false, Output::create(&path("b.goblin")).unwrap(), how, &()).unwrap();
    assert!(std::fs::read(path("b.goblin")).unwrap() == packed(&std::fs::read(path("a.goblin")).unwrap()));
}

#[test]
fn corruption_is_detected() {
    for bytes in [
        goblin_bytes(&Cells::random(QUAD, 3, [600, 500, 1], 30, true), Rule::Majority, DataKind::Categorical),
        goblin_bytes(
            &Cells::random(oct(SampleType::I16, 1), 4, [90, 40, 66], 9, true),
            Rule::Mean,
            DataKind::Continuous,
        ),
    ] {
        truncate_and_flip(&packed(&bytes), 997, 15);
    }
    let tiny = goblin_bytes(&Cells::random(QUAD, 9, [30, 20, 1], 4, true), Rule::Mean, DataKind::Continuous);
    truncate_and_flip(&packed(&tiny), 100, 100);
}

/// Returns the offsets of the segment index entries of a file's only layer.
fn entries(file: &[u8]) -> Vec<usize> {
    let layer = seal::layers(file)[0];
    let size = seal::entry_size(file, layer);
    let pages = seal::pages(file, layer);
    pages.iter().flat_map(|(_, page)| seal::entries(file, page, size)).collect()
}

/// Sets each packing field of a segment, and bytes of packed segments, to malicious values with
/// valid checksums.
#[test]
fn malicious_entries_of_packed_segments_are_harmless() {
    let cells = Cells::random(QUAD, 3, [500, 300, 1], 5, true);
    let file = packed(&goblin_bytes(&cells, Rule::Majority, DataKind::Categorical));
    let mut all = fields("the tree's header", seal::layers(&file)[0], &TREE_FIELDS);
    for entry in entries(&file) {
        all.extend(fields("an entry", entry, &[8, 8, 8, 4, 2, 1, 1, 4, 8]));
    }
    let query = |mut file: Vec<u8>, what: String| {
        let start = Instant::now();
        seal::goblin(&mut file);
        query_goblin(file);
        assert!(start.elapsed() < Duration::from_secs(10), "{what} took {:?}", start.elapsed());
    };
    for field in all {
        changed(&file, &field, &mut |file, what| query(file, what));
    }
    let mut random = Random(5);
    let run = seal::long(&file, seal::layers(&file)[0] + 88) as usize;
    for entry in entries(&file) {
        let (start, length) = (run + seal::long(&file, entry + 8) as usize, seal::long(&file, entry + 16));
        for _ in 0..30 {
            let at = start + random.below(length) as usize;
            let mut file = file.clone();
            file[at] ^= 1 << random.below(8);
            query(file, format!("byte {at} of a segment"));
        }
    }
}

#[test]
fn codecs_are_those_that_are_known() {
    let cells = Cells::random(QUAD, 3, [500, 300, 1], 5, true);
    let file = packed(&goblin_bytes(&cells, Rule::Mean, DataKind::Continuous));
    let changed = |at: usize, byte: u8| {
        let mut file = file.clone();
        file[at] = byte;
        seal::goblin(&mut file);
        Goblin::from_bytes(file)
    };
    let layer = seal::layers(&file)[0];
    let unknown = changed(layer + 4, 3);
    assert!(matches!(unknown, Err(Error::Unsupported { found, .. }) if found == "codec number 3"));
    // A flag in the header marks trees with packed segments.
    let text = |file: Goblin| file.segment(0).map(drop).unwrap_err().to_string();
    assert!(text(changed(layer + 4, 0).unwrap()).contains("a packed segment"));
    let entry = entries(&file)[0];
    assert!(text(changed(entry + 30, 3).unwrap()).contains("codec number 3 of a segment"));
    // (References are in indexes only.)
    assert!(text(changed(entry + 30, 2).unwrap()).contains("reference segment at level"));
    assert!(text(changed(entry + 30, 0).unwrap()).contains("bytes, "));
    assert!(Goblin::from_bytes(file).unwrap().segment(0).is_ok());
}

#[test]
fn few_bytes_do_not_become_very_many() {
    let cells = Cells::random(QUAD, 3, [500, 300, 1], 5, true);
    let file = packed(&goblin_bytes(&cells, Rule::Mean, DataKind::Continuous));
    for slots in [u32::MAX, 1 << 24, 1 << 23] {
        let mut bomb = file.clone();
        for entry in entries(&file) {
            seal::set_short(&mut bomb, entry + 24, slots);
        }
        seal::goblin(&mut bomb);
        let bomb = Goblin::from_bytes(bomb).unwrap();
        for index in 0..bomb.segments() {
            let refused = bomb.segment(index).map(drop).unwrap_err();
            assert!(matches!(refused, Error::Corrupt { .. }), "{refused}");
        }
        assert!(!open_goblin(bomb).verify(MEMORY, &()).unwrap().is_empty());
    }
}

fn open_goblin(file: Goblin) -> Dataset {
    Dataset::of(file.into()).unwrap()
}

/// Unpacked bytes stay within the limit across threads, and all results are right.
#[test]
fn threads_share_unpacked_segments() {
    let bytes =
        goblin_bytes(&Cells::random(QUAD, 8, [2100, 1500, 1], 200, false), Rule::Mean, DataKind::Continuous);
    let access = FileAccess::new().unpacked_cache(2 << 20);
    let options = OpenOptions::new().access(access.clone());
    let tree = Goblin::from_backend(Path::new("t"), Box::new(packed(&bytes)), &options);
    let (tree, expected) = (open_goblin(tree.unwrap()), open(&bytes));
    let cache = access.unpacked();
    std::thread::scope(|scope| {
        for thread in 0..8u64 {
            let (tree, expected) = (&tree, &expected);
            scope.spawn(move || {
                let mut random = Random(thread + 1);
                let (mut found, mut right) = (vec![0u8; 1 << 14], vec![0u8; 1 << 14]);
                let [mut points, mut right_points] = [PointSamples::default(), PointSamples::default()];
                for _ in 0..4 {
                    let min = [random.below(1900), random.below(1300), 0];
                    let bounds = Bounds { min, max: [min[0] + 128, min[1] + 128, 1] };
                    tree.window(tree.depth(), &bounds, 0.0, &mut found, None).unwrap();
                    expected.window(tree.depth(), &bounds, 0.0, &mut right, None).unwrap();
                    assert!(found == right);
                    let cells: Vec<[u64; 3]> =
                        (0..200).map(|_| [random.below(2200), random.below(1600), 0]).collect();
                    tree.points(&cells, tree.depth(), &mut points).unwrap();
                    expected.points(&cells, tree.depth(), &mut right_points).unwrap();
                    assert!((0..200).all(|at| points.value(at) == right_points.value(at)));
                    // A single segment may exceed the limit.
                    assert!(cache.held() <= 8 << 20, "{}", cache.held());
                }
            });
        }
    });
}
