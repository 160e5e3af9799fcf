//! Files of several layers: each layer equals the tree that it would be alone, whatever the other
//! layers are.

use std::path::{Path, PathBuf};

use spinney::edit::{Edit, FillRegion, Note};
use spinney::raw::ops;
use spinney::raw::store::autumnal::{Autumnal, History};
use spinney::raw::store::goblin::Goblin;
use spinney::raw::store::{FileReference, TreeWriter};
use spinney::{
    Bounds, Code, DataKind, Dataset, Dimension, FileView, Frame, Metadata, OpenOptions, Output, Rule,
    SampleType, TreeType, ValueType, WriteOptions,
};

use crate::common::command::{is_alone, own_peak_memory};
use crate::common::reference::{self, Cut};
use crate::common::{
    Cells, QUAD, Random, byte, goblin_bytes, made, options, quad, value, value_types, write_cells,
};
use crate::targets::{seal, trees::query_goblin};

/// A layer to be written.
struct Layer {
    name: String,
    cells: Cells,
    rule: Rule,
    kind: DataKind,
    depth: u8,
}

/// Returns layers of all types, some with larger cells, in a space of 2^9 cells.
fn random_layers(count: usize, seed: u64) -> Vec<Layer> {
    layers_of(300, count, seed)
}

/// Returns such layers of about `most` of the smallest cells per side.
fn layers_of(most: u64, count: usize, seed: u64) -> Vec<Layer> {
    let mut random = Random(seed);
    let types = value_types();
    let layer = |number: usize| {
        let value = types[random.below(types.len() as u64) as usize];
        let coarser = random.below(3) as u8;
        let side = most >> coarser;
        let size = [side + random.below(9), side - random.below(9), 1];
        let cells = Cells::random(TreeType::new(Dimension::Quad, value), random.next(), size, 9, true);
        let rule = Rule::ALL[random.below(6) as usize];
        let kind = if random.below(2) == 0 { DataKind::Categorical } else { DataKind::Continuous };
        Layer { name: format!("layer {number}"), cells, rule, kind, depth: 9 - coarser }
    };
    (0..count).map(layer).collect()
}

fn write(layers: &[Layer], path: &Path) {
    let output = Output::create(path).unwrap();
    let mut file = TreeWriter::create(output, (Dimension::Quad, 9), layers.len() as u32).unwrap();
    for layer in layers {
        let frame = Frame::identity().coarser(9 - layer.depth);
        let metadata = Metadata { name: layer.name.clone(), frame, ..Metadata::default() };
        let options = options(layer.rule, layer.kind, layer.depth).metadata(metadata);
        let nodata = value(layer.cells.form.value, 250);
        let mut slabs = layer.cells.slabs(nodata);
        file.slabs(layer.cells.form, &mut slabs, Some(nodata), &options, &()).unwrap();
    }
    file.finish().unwrap();
}

/// Returns all cells of a dataset, and those of some coarser levels.
fn windows(tree: &Dataset) -> Vec<(Vec<u8>, Vec<bool>)> {
    let window = |level: u8| {
        let bounds = tree.extent_at(level);
        let cells = bounds.volume() as usize;
        let (mut bytes, mut valid) = (vec![0; cells * tree.header().form.width()], vec![false; cells]);
        tree.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
        (bytes, valid)
    };
    [tree.depth(), 4, 1, 0].map(window).to_vec()
}

fn same(found: &Dataset, expected: &Dataset) {
    assert_eq!(found.header(), expected.header());
    assert!(windows(found) == windows(expected), "{}", found.name().display());
    let [mut found, mut expected] = [found, expected].map(|tree| tree.statistics(None, &()).unwrap());
    (found.segments_read, expected.segments_read) = (0, 0);
    assert_eq!(found, expected);
}

/// Returns the run of a layer in a file's bytes.
fn run(file: &[u8], number: usize) -> &[u8] {
    let layer = seal::layers(file)[number];
    let (start, length) = (seal::long(file, layer + 88) as usize, seal::long(file, layer + 96) as usize);
    &file[start..start + length]
}

#[test]
fn each_layer_is_the_tree_that_it_would_be_alone() {
    let directory = tempfile::tempdir().unwrap();
    for (round, count) in [1, 2, 5, 13, 40].into_iter().enumerate() {
        let layers = random_layers(count, round as u64);
        let [goblin, autumn, back] = ["s.goblin", "s.autumn", "back.goblin"]
            .map(|name| directory.path().join(format!("{round}{name}")));
        write(&layers, &goblin);
        write(&layers, &autumn);
        let bytes = std::fs::read(&goblin).unwrap();
        let alone = |number: usize| directory.path().join(format!("{round} {number} alone.goblin"));
        for (number, layer) in layers.iter().enumerate() {
            write(std::slice::from_ref(layer), &alone(number));
        }
        for path in [&goblin, &autumn] {
            let file = spinney::open(path).unwrap();
            assert_eq!(file.verify(1 << 24, &()).unwrap(), [], "{}", path.display());
            let names: Vec<String> = file.layers().unwrap().into_iter().map(|layer| layer.name).collect();
            assert!(names.iter().eq(layers.iter().map(|layer| &layer.name)));
            for (number, layer) in layers.iter().enumerate() {
                let expected = spinney::open(alone(number)).unwrap();
                same(&file.layer(&layer.name).unwrap(), &expected);
                same(&file.layer(&number.to_string()).unwrap(), &expected);
                let reference = FileReference::of(path).of_layer(&layer.name);
                same(&spinney::open(&reference).unwrap(), &expected);
                if path == &goblin {
                    assert!(run(&bytes, number) == run(&std::fs::read(alone(number)).unwrap(), 0));
                }
            }
            assert!(file.layer("no such").is_err());
        }
        // Converting to the other format and back gives the same bytes.
        spinney::convert(&autumn, false, Output::create(&back).unwrap(), WriteOptions::new(1 << 24), &())
            .unwrap();
        assert!(std::fs::read(&back).unwrap() == bytes);
    }
}

#[test]
fn bytes_do_not_depend_on_the_order_of_the_input() {
    let directory = tempfile::tempdir().unwrap();
    let cells = Cells::random(quad(SampleType::U16, 1), 5, [1100, 700, 1], 9, true);
    let [rows, tree] = ["rows.goblin", "tree.goblin"].map(|name| directory.path().join(name));
    // In bands of rows, which differs from the file's order, and node by node.
    std::fs::write(&rows, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    spinney::convert(&rows, false, Output::create(&tree).unwrap(), WriteOptions::new(1 << 24), &()).unwrap();
    assert!(std::fs::read(&rows).unwrap() == std::fs::read(&tree).unwrap());
}

#[test]
fn layers_are_added_and_removed() {
    let directory = tempfile::tempdir().unwrap();
    let layers = random_layers(4, 77);
    for name in ["s.goblin", "s.autumn"] {
        let [path, all] = [directory.path().join(name), directory.path().join(format!("all.{name}"))];
        write(&layers[..2], &path);
        write(&layers, &all);
        for layer in &layers[2..] {
            let alone = directory.path().join("alone.goblin");
            write(std::slice::from_ref(layer), &alone);
            let chain = FileView::of(&alone);
            let commit =
                ops::add_layer(&path, &layer.name, &chain, Note::default(), WriteOptions::new(1 << 24), &())
                    .unwrap();
            assert_eq!(commit.is_some(), name.ends_with("autumn"));
            assert!(
                ops::add_layer(&path, &layer.name, &chain, Note::default(), WriteOptions::new(1 << 24), &())
                    .is_err()
            );
        }
        let (found, expected) = (spinney::open(&path).unwrap(), spinney::open(&all).unwrap());
        assert_eq!(found.verify(1 << 24, &()).unwrap(), []);
        for layer in &layers {
            same(&found.layer(&layer.name).unwrap(), &expected.layer(&layer.name).unwrap());
        }
        ops::drop_layer(&path, "layer 1", Note::default(), &Default::default(), &()).unwrap();
        let found = spinney::open(&path).unwrap();
        let names: Vec<String> = found.layers().unwrap().into_iter().map(|layer| layer.name).collect();
        assert_eq!(names, ["layer 0", "layer 2", "layer 3"]);
        assert_eq!(found.verify(1 << 24, &()).unwrap(), []);
        same(&found.layer("layer 3").unwrap(), &expected.layer("layer 3").unwrap());
        let error =
            ops::drop_layer(&path, "layer 1", Note::default(), &Default::default(), &()).err().unwrap();
        assert!(error.to_string().contains("`layer 2`"), "{error}");
    }
}

/// A layer whose grid does not match the file's is rejected; one with larger cells is accepted.
#[test]
fn layers_share_one_frame() {
    let directory = tempfile::tempdir().unwrap();
    let [path, other] = ["s.goblin", "other.goblin"].map(|name| directory.path().join(name));
    let layers = random_layers(1, 3);
    write(&layers, &path);
    // Cells of 3 and of half a cell are resampled to the file's.
    for (matrix, begins_before) in
        [(1.0, false), (2.0, false), (8.0, false), (3.0, false), (0.5, false), (3.5, true)]
    {
        let cells = Cells::random(QUAD, 1, [30, 30, 1], 9, true);
        let mut metadata = Metadata::default();
        (metadata.frame.matrix[0][0], metadata.frame.matrix[1][1]) = (matrix, matrix);
        metadata.frame.matrix[0][3] = if begins_before { -20.0 } else { 0.0 };
        let options = options(Rule::Mean, DataKind::Continuous, 5).metadata(metadata);
        write_cells(&other, &cells, &options);
        let name = format!("by {matrix}");
        let added = ops::add_layer(
            &path,
            &name,
            &FileView::of(&other),
            Note::default(),
            WriteOptions::new(1 << 24),
            &(),
        );
        assert_eq!(added.is_ok(), !begins_before, "{matrix}: {:?}", added.err());
    }
    let file = spinney::open(&path).unwrap();
    let depth = spinney::open(&path).unwrap().depth();
    let depths: Vec<u8> = file.layers().unwrap().iter().map(|layer| layer.header.depth()).collect();
    assert_eq!(depths, [depth, depth, depth - 1, depth - 3, depth, depth]);
}

/// Each commit is one state of all layers; a layer that an edit does not change keeps its root.
#[test]
fn edits_of_one_layer_leave_the_others() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.autumn");
    let layers = random_layers(3, 8);
    write(&layers, &path);
    let before: Vec<_> = (0..3).map(|number| windows(&layer_of(&path, number))).collect();
    let name = FileReference::of(&path).of_layer("layer 1");
    let bounds = Bounds { min: [3, 4, 0], max: [40, 30, 1] };
    let fill = || Ok(Edit::Fill(FillRegion::Box(bounds), None));
    spinney::edit::edit(&name, [fill()], Note::default(), 1 << 24, &()).unwrap().unwrap();
    // A file of several layers is edited by the layer's name.
    let file = spinney::open(&path).unwrap();
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    for (number, before) in before.iter().enumerate() {
        assert_eq!(windows(&layer_of(&path, number)) == *before, number != 1, "layer {number}");
        let old = directory.path().join("s.autumn@1");
        assert!(
            windows(&spinney::open(FileReference::of(&old).of_layer(&layers[number].name)).unwrap())
                == *before
        );
    }
    let commits: Vec<_> =
        History::open(&path, &OpenOptions::new()).unwrap().commits().map(Result::unwrap).collect();
    assert!(commits.iter().all(|commit| commit.layers().len() == 3));
    assert!(commits[0].written.bytes < commits[1].written.bytes / 4, "{commits:?}");
    // Revert to the first commit: one layer is restored.
    spinney::edit::edit(&name, [Ok(Edit::Revert(1))], Note::default(), 1 << 24, &()).unwrap().unwrap();
    assert!(windows(&layer_of(&path, 1)) == before[1]);
    // Compacted, with all layers.
    let compact = directory.path().join("c.autumn");
    let keep = spinney::raw::store::autumnal::Keep::Last(2);
    let output = Output::create(&compact).unwrap();
    spinney::raw::store::autumnal::compact(
        &path,
        &spinney::raw::store::autumnal::CompactOptions::new(&keep, 1 << 24),
        output,
        &(),
    )
    .unwrap();
    assert_eq!(spinney::open(&compact).unwrap().verify(1 << 24, &()).unwrap(), []);
    for (number, before) in before.iter().enumerate() {
        assert!(windows(&layer_of(&compact, number)) == *before);
    }
}

/// Pastes of one layer over another one with the same value type: records of the pasted layer have
/// representatives by another rule, zones without class counts, or a root at a height where the
/// other layer has no records, so they cannot be kept.
#[test]
fn records_of_other_layers_are_kept_only_if_they_mean_the_same() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.autumn");
    let layer = |name: &str, rule, kind, size: u64, depth, seed| {
        let cells = Cells::random(QUAD, seed, [size, size, 1], 9, true);
        Layer { name: name.into(), cells, rule, kind, depth }
    };
    let layers = [
        layer("a", Rule::Mean, DataKind::Continuous, 512, 9, 1),
        layer("b", Rule::Nearest, DataKind::Continuous, 512, 9, 2),
        layer("c", Rule::Majority, DataKind::Continuous, 512, 9, 3),
        layer("d", Rule::Mean, DataKind::Continuous, 256, 8, 4),
        layer("e", Rule::Mean, DataKind::Continuous, 512, 9, 5),
    ];
    for (target, patch) in [(0, 1), (0, 2), (2, 0), (0, 3), (0, 4)] {
        let mut file = TreeWriter::create(Output::create(&path).unwrap(), (Dimension::Quad, 9), 5).unwrap();
        for layer in &layers {
            let metadata = Metadata { name: layer.name.clone(), ..Metadata::default() };
            let options = options(layer.rule, layer.kind, layer.depth).metadata(metadata);
            let nodata = value(layer.cells.form.value, 250);
            let mut slabs = layer.cells.slabs(nodata);
            file.slabs(layer.cells.form, &mut slabs, Some(nodata), &options, &()).unwrap();
        }
        file.finish().unwrap();
        let of = |number: usize| FileReference::of(&path).of_layer(&layers[number].name);
        let paste = Edit::Paste {
            patch: FileView::of(&of(patch)),
            at: Some([0; 3]),
            void: true,
            options: Default::default(),
        };
        let commit = spinney::edit::edit(&of(target), [Ok(paste)], Note::default(), 1 << 24, &());
        let commit = commit.unwrap().unwrap();
        let file = spinney::open(&path).unwrap();
        assert_eq!(file.verify(1 << 24, &()).unwrap(), [], "{patch} over {target}");
        // A layer that differs in its cells alone is kept as a whole.
        assert_eq!(commit.written.records == 0, patch == 4, "{patch} over {target}");
        std::fs::remove_file(&path).unwrap();
    }
}

fn layer_of(path: &Path, number: usize) -> Dataset {
    spinney::open(path).unwrap().layer(&number.to_string()).unwrap()
}

#[test]
fn names_of_layers_are_different_ones() {
    let directory = tempfile::tempdir().unwrap();
    for names in [["a", "a"], ["a", ""]] {
        for file in ["s.goblin", "s.autumn"] {
            let path = directory.path().join(file);
            let output = Output::create(&path).unwrap();
            let mut writer = TreeWriter::create(output, (Dimension::Quad, 9), 2).unwrap();
            let results = names.map(|name| {
                let layer = &random_layers(1, 5)[0];
                let metadata = Metadata { name: name.into(), ..Metadata::default() };
                let options = options(layer.rule, layer.kind, layer.depth).metadata(metadata);
                let nodata = value(layer.cells.form.value, 250);
                let mut slabs = layer.cells.slabs(nodata);
                writer.slabs(layer.cells.form, &mut slabs, Some(nodata), &options, &())
            });
            assert!(results[0].is_ok() && results[1].is_err(), "{names:?}");
            assert!(writer.finish().is_err() && !path.exists());
        }
    }
}

/// Segment indexes so large that the index over their pages has two levels.
#[test]
fn directories_of_very_many_segments_are_found() {
    let size = [700, 690, 1];
    let cells = made(QUAD, size, |[x, y, _]| Some(byte(((x * 7 + y * 31 + x * y % 11) % 249) as u8)));
    let tree = cells.tree(Rule::Mean);
    let file = reference::goblin(&tree, size, (Rule::Mean, DataKind::Continuous), Cut::EVERYWHERE);
    let expected = Dataset::of(
        Goblin::from_bytes(goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap().into(),
    );
    let expected = expected.unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cut.goblin");
    std::fs::write(&path, &file).unwrap();
    for options in [OpenOptions::new(), OpenOptions::new().positioned(1 << 20)] {
        let file = Goblin::open(&path, &options).unwrap();
        assert!(file.segments() > 256 * 128, "{} segments", file.segments());
        let mut random = Random(4);
        for _ in 0..500 {
            let cell = [random.below(700) as u32, random.below(690) as u32, 0];
            let code = Code::from_cell(Dimension::Quad, 10, cell).unwrap();
            let found = file.value_at(code).unwrap();
            assert_eq!(found, cells.get(cell.map(u64::from)), "{cell:?}");
        }
        assert!(windows(&Dataset::of(file.into()).unwrap()) == windows(&expected));
    }
    let file = Goblin::from_bytes(file).unwrap();
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
}

/// Layer tables with false entries: an error or a harmless result.
#[test]
fn invalid_layer_tables_are_rejected() {
    if !is_alone("layers::invalid_layer_tables_are_rejected") {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.goblin");
    // The layers are small, because all queries run on each of thousands of files.
    write(&layers_of(90, 3, 21), &path);
    let file = std::fs::read(&path).unwrap();
    let tables = seal::layers(&file);
    assert_eq!(tables.len(), 3);
    let mut random = Random(6);
    for layer in tables {
        for at in 0..seal::LAYER {
            for wrong in [0, 1, 0x7f, 0xff, file[layer + at] ^ 1 << random.below(8)] {
                let mut file = file.clone();
                file[layer + at] = wrong;
                seal::goblin(&mut file);
                if let Ok(first) = Goblin::from_bytes(file.clone()) {
                    (0..first.layers().len()).for_each(|number| drop(first.open_layer(number)));
                }
                query_goblin(file);
            }
        }
    }
    // Overlapping runs, and a duplicate layer.
    let [first, second] = [0, 1].map(|number| seal::layers(&file)[number]);
    let mut twice = file.clone();
    twice.copy_within(first..first + 54, second);
    twice.copy_within(first + 56..first + seal::LAYER, second + 56);
    seal::goblin(&mut twice);
    drop(Goblin::from_bytes(twice));
    assert!(own_peak_memory() < 1 << 30, "{} bytes", own_peak_memory());
}

/// A hundred layers are open at once, and read one by one.
#[test]
fn a_hundred_layers() {
    let directory = tempfile::tempdir().unwrap();
    let [path, autumn]: [PathBuf; 2] = ["s.goblin", "s.autumn"].map(|name| directory.path().join(name));
    let layers: Vec<Layer> = (0..100)
        .map(|number| Layer {
            name: format!("2020-{number:03}"),
            cells: Cells::random(
                TreeType::new(Dimension::Quad, ValueType::new(SampleType::U16, 1)),
                number,
                [20, 20, 1],
                9,
                true,
            ),
            rule: Rule::Mean,
            kind: DataKind::Continuous,
            depth: 9,
        })
        .collect();
    write(&layers, &path);
    write(&layers, &autumn);
    assert_eq!(Autumnal::open(&autumn, &OpenOptions::new()).unwrap().commit().layers().len(), 100);
    let file = Goblin::open(&path, &OpenOptions::new()).unwrap();
    for (number, layer) in layers.iter().enumerate() {
        let tree = file.open_layer(number).unwrap();
        let code = Code::from_cell(Dimension::Quad, 9, [7, 9, 0]).unwrap();
        assert_eq!(tree.value_at(code).unwrap(), layer.cells.get([7, 9, 0]));
    }
}

/// The shortest path that names an existing file wins, so that layer names may contain any
/// characters of paths and commits.
#[test]
fn file_names_select_commits_and_layers() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    for name in ["s.goblin", "s.autumn", "odd@7", "odd@7:x"] {
        std::fs::write(path(name), "").unwrap();
    }
    std::fs::create_dir(path("directory:1")).unwrap();
    std::fs::write(path("directory:1/t.autumn"), "").unwrap();
    for (text, file, commit, layer) in [
        ("s.goblin", "s.goblin", None, None),
        ("s.goblin:B08", "s.goblin", None, Some("B08")),
        ("s.goblin:B08@12", "s.goblin", None, Some("B08@12")),
        ("s.goblin:a:b@c/d@1", "s.goblin", None, Some("a:b@c/d@1")),
        ("s.goblin:", "s.goblin", None, None),
        ("s.autumn@12", "s.autumn", Some(12), None),
        ("s.autumn@12:B08", "s.autumn", Some(12), Some("B08")),
        ("s.autumn@12:B08@3", "s.autumn", Some(12), Some("B08@3")),
        ("s.autumn:B08@3", "s.autumn", None, Some("B08@3")),
        ("s.autumn:@3", "s.autumn", None, Some("@3")),
        // Existing files take precedence.
        ("odd@7", "odd@7", None, None),
        ("odd@7:x", "odd@7:x", None, None),
        ("odd@7:y@8", "odd@7", None, Some("y@8")),
        ("directory:1/t.autumn@2:x", "directory:1/t.autumn", Some(2), Some("x")),
        ("directory:1/t.autumn:x@2", "directory:1/t.autumn", None, Some("x@2")),
        // Without a file, a commit is parsed, but no layer.
        ("gone.autumn@2", "gone.autumn", Some(2), None),
        ("gone.autumn:x", "gone.autumn:x", None, None),
        ("s.autumn@x", "s.autumn@x", None, None),
        ("s.autumn@+1", "s.autumn@+1", None, None),
    ] {
        let whole = path(text);
        let reference = FileReference::of(&whole);
        let found = (reference.file.to_path_buf(), reference.commit, reference.layer.as_deref());
        assert_eq!(found, (path(file), commit, layer), "{text}");
        // The inverse.
        if let Some(layer) = layer {
            assert_eq!(reference.of_layer(layer), whole);
        }
    }
}

/// Layers whose names look like commits are found, also within commits.
#[test]
fn layers_are_named_like_commits() {
    let directory = tempfile::tempdir().unwrap();
    let mut layers = random_layers(3, 31);
    for (layer, name) in layers.iter_mut().zip(["a", "a@1", "0"]) {
        layer.name = name.into();
    }
    for name in ["s.goblin", "s.autumn"] {
        let path = directory.path().join(name);
        write(&layers, &path);
        let open = |text: &str| spinney::open(format!("{}{text}", path.display())).unwrap();
        for (number, name) in ["a", "a@1", "0"].into_iter().enumerate() {
            assert_eq!(open(&format!(":{name}")).layer_number(), number);
            if path.display().to_string().ends_with("autumn") {
                assert_eq!(open(&format!("@1:{name}")).layer_number(), number);
            }
        }
    }
}
