//! Dense blocks: nodes of Goblin files that are stored as rows of values; all queries, checked
//! against arrays and trees in memory.

use std::sync::Arc;

use spinney::query::Condition;
use spinney::raw::ops::{self, Prefer, View, ViewSource};
use spinney::raw::store::goblin::Goblin;
use spinney::raw::tree::df;
use spinney::tree::{Child, MemTree, Source};
use spinney::{
    Bounds, Code, CombineOperation, DataKind, Dataset, Dimension, Output, Rule, SampleType, TreeType, Value,
    WriteOptions,
};

use crate::common::reference::{self, Cut};
use crate::common::{
    self, Cells, OCT, QUAD, Random, children, combined, goblin_bytes, goblin_from_combined, goblin_from_tree,
    goblin_from_view, made, oct, options, quad, same_trees, set_operation, value_types, view_of_file,
};
use crate::targets::seal;
use crate::targets::trees::query_goblin;

/// Contents of cells: uncorrelated values, with single cells VOID or with blocks of 4 cells along
/// each axis VOID.
#[derive(Clone, Copy, Debug)]
enum Content {
    Noise,
    Gradient,
    /// Single cells are VOID.
    Holes,
    /// Whole blocks are VOID in some octants or quadrants, uniform in others, and neither in the
    /// rest.
    Blocks,
}

fn content(form: TreeType, content: Content, seed: u64, size: [u64; 3]) -> Cells {
    // 250 is the nodata value.
    let hash = |[x, y, z]: [u64; 3]| Random(seed ^ (x + 1000 * (y + 1000 * z))).next() >> 7;
    // Quadrants or octants of the space.
    let half = size.iter().max().unwrap().next_power_of_two() / 2;
    made(form, size, |cell| {
        let noise = common::value(form.value, hash(cell) % 250);
        let block = hash(cell.map(|cell| cell / 4 + 500));
        let part = cell[0] / half + 2 * (cell[1] / half);
        match content {
            Content::Noise => Some(noise),
            Content::Gradient => {
                Some(common::value(form.value, (3 * cell[0] + 5 * cell[1] + 7 * cell[2]) % 250))
            }
            Content::Holes => (!hash(cell).is_multiple_of(9)).then_some(noise),
            Content::Blocks => match part {
                1 if block.is_multiple_of(3) => None,
                2 if block.is_multiple_of(3) => Some(common::value(form.value, block % 250)),
                3 => (!hash(cell).is_multiple_of(9)).then_some(noise),
                _ => Some(noise),
            },
        }
    })
}

/// Returns a file's dense blocks by kind number; its plain records are at 0.
fn kinds(file: &Goblin) -> [usize; 8] {
    let mut kinds = [0; 8];
    for index in 0..file.segments() {
        each_place(file, index, |_, dense, _| kinds[usize::from(dense)] += 1);
    }
    kinds
}

/// Calls `show` with number, mark and skip of all records of a segment, without payloads.
fn each_place(file: &Goblin, index: usize, mut show: impl FnMut(usize, u8, u32)) {
    let segment = file.segment(index).unwrap();
    let mut at = 0;
    while let Some(head) = file.layout().head(segment.records(), at) {
        show(at, head.dense, head.skip);
        at += if head.dense == 0 { 1 } else { head.skip as usize };
    }
}

/// Returns a random box in a level or across its border.
fn some_bounds(form: TreeType, side: u64, random: &mut Random) -> Bounds {
    let mut bounds = Bounds { min: [0; 3], max: [1; 3] };
    for axis in 0..form.axes() {
        bounds.min[axis] = random.below(side);
        bounds.max[axis] = bounds.min[axis] + 1 + random.below(side.min(40));
    }
    bounds
}

fn cells_of(bounds: &Bounds) -> impl Iterator<Item = [u64; 3]> {
    let Bounds { min, max } = *bounds;
    (min[2]..max[2])
        .flat_map(move |z| (min[1]..max[1]).flat_map(move |y| (min[0]..max[0]).map(move |x| [x, y, z])))
}

/// Checks windows, aligned and not, with and without flags.
fn windows(file: &Goblin, tree: &MemTree, random: &mut Random) {
    let form = tree.form();
    let (width, fill) = (form.width(), common::value(form.value, 77));
    for level in 0..=tree.depth() {
        let side = 1u64 << level;
        let mut boxes =
            vec![Bounds { min: [0; 3], max: [side, side, if form.axes() > 2 { side } else { 1 }] }];
        boxes.extend((0..3).map(|_| some_bounds(form, side, random)));
        for bounds in boxes {
            let len = bounds.volume() as usize;
            let (mut values, mut valid) = (vec![0; len * width], vec![true; len]);
            file.window(level, &bounds, fill, &mut values, Some(&mut valid)).unwrap();
            let mut plain = vec![0; len * width];
            file.window(level, &bounds, fill, &mut plain, None).unwrap();
            assert!(plain == values, "{form} level {level} {bounds:?}");
            for (i, (cell, value)) in cells_of(&bounds).zip(values.chunks_exact(width)).enumerate() {
                let code = Code::from_cell(form.dimension, level, cell.map(|cell| cell as u32));
                let expected = code.and_then(|code| tree.value_at(code));
                assert_eq!(valid[i], expected.is_some(), "{form} level {level} cell {cell:?}");
                let found = Value::from_bytes(value);
                assert_eq!(found, expected.unwrap_or(fill), "{form} level {level} cell {cell:?}");
            }
        }
    }
}

/// Checks single cells and batches so large that nodes in dense blocks are in the table of the
/// upper levels.
fn points(file: &Goblin, tree: &MemTree, random: &mut Random) {
    let dimension = tree.form().dimension;
    for level in 0..=tree.depth() {
        for count in [3, 600, 4500] {
            let axis = |_| random.below(1 << level) as u32;
            let mut cells: Vec<[u32; 3]> =
                (0..3 * count).map(axis).collect::<Vec<_>>().as_chunks().0.to_vec();
            if dimension == Dimension::Quad {
                cells.iter_mut().for_each(|cell| cell[2] = 0);
            }
            let mut values = vec![None; cells.len()];
            file.values_at(level, &cells, &mut values).unwrap();
            for (i, (cell, value)) in cells.iter().zip(values).enumerate() {
                let code = Code::from_cell(dimension, level, *cell).unwrap();
                let expected = tree.value_at(code);
                assert_eq!(value, expected, "{} level {level} cell {cell:?} of {count}", tree.form());
                if i < 300 {
                    assert_eq!(file.value_at(code).unwrap(), expected, "{code}");
                }
            }
        }
    }
}

/// Checks statistics, histograms and searches in boxes, with numbers whose sums are exact.
fn counts(file: &Goblin, cells: &Cells, random: &mut Random) {
    let value_type = cells.form.value;
    for _ in 0..8 {
        let bounds = some_bounds(cells.form, cells.size[0], random).intersect(&Bounds::of_extent(cells.size));
        let values = cells_of(&bounds).filter_map(|cell| cells.get(cell));
        let numbers: Vec<f64> = values.map(|value| value_type.samples(value)[0]).collect();
        let found = file.statistics(Some(bounds), &()).unwrap();
        assert_eq!(found.cells, numbers.len() as u64);
        assert_eq!(found.void_cells, bounds.volume() - found.cells);
        if let Some(channel) = found.channels.first() {
            let mean = numbers.iter().sum::<f64>() / numbers.len() as f64;
            let extreme = |choose: fn(f64, f64) -> f64| numbers.iter().copied().reduce(choose).unwrap();
            assert_eq!((channel.min.to_f64(), channel.max.to_f64()), (extreme(f64::min), extreme(f64::max)));
            assert!((channel.mean - mean).abs() < 1e-9 * (1.0 + mean.abs()), "{} {mean}", channel.mean);
        }
        for (class, count) in found.classes {
            assert_eq!(numbers.iter().filter(|number| **number == class).count() as u64, count);
        }
        let mut bins = vec![0; 7];
        for number in &numbers {
            bins[((number - 10.0) * (7.0 / 200.0)).clamp(0.0, 6.0) as usize] += 1;
        }
        assert_eq!(file.histogram(&bounds, 10.0, 210.0, 7, &()).unwrap(), bins);
        let (mut count, above) = (0, |value| value_type.samples(value)[0] > 90.0);
        file.find(Condition::Above(90.0.into()), Some(bounds), &(), &mut |block| {
            assert!(cells_of(&block.bounds).all(|cell| cells.get(cell).is_some_and(above)), "{block:?}");
            count += block.bounds.volume();
            Ok(true)
        })
        .unwrap();
        assert_eq!(count, numbers.iter().filter(|number| **number > 90.0).count() as u64);
    }
}

/// DF-expression and FD codes are those of the condensed tree.
fn check_strings(file: Goblin, tree: &MemTree) {
    let mut pending = vec![(Code::root(tree.form().dimension), tree.root().unwrap())];
    let mut leaves = Vec::new();
    while let Some((code, node)) = pending.pop() {
        match node {
            Child::Void => {}
            Child::Leaf(_) => leaves.push(code.bits().to_string()),
            Child::Inner { node, .. } => {
                let children = children(tree, &node).into_iter().enumerate().rev();
                pending.extend(children.map(|(step, child)| (code.child(step), child)));
            }
        }
    }
    let file = Dataset::of(file.into()).unwrap();
    let text = file.leaf_codes(1 << 20).unwrap();
    let codes: Vec<&str> = text.lines().map(|line| line.split(' ').nth(1).unwrap()).collect();
    assert_eq!(codes, leaves);
    let full = tree.form().value.splat(255u8);
    assert_eq!(file.df_text(1 << 20).unwrap(), df::to_text(tree, full).unwrap());
}

#[test]
fn every_type_round_trips() {
    let contents = [Content::Noise, Content::Gradient, Content::Holes, Content::Blocks];
    for (i, value) in value_types().into_iter().enumerate() {
        for (dimension, size) in [(Dimension::Quad, [75, 66, 1]), (Dimension::Oct, [17, 19, 18])] {
            let seed = 2 * i as u64 + dimension.axes() as u64;
            let form = TreeType::new(dimension, value);
            let rule = Rule::ALL[i % Rule::ALL.len()];
            let kind = if i % 2 == 0 { DataKind::Continuous } else { DataKind::Categorical };
            let cells = content(form, contents[seed as usize / 2 % 4], seed, size);
            let tree = cells.tree(rule);
            let bytes = goblin_bytes(&cells, rule, kind);
            assert!(goblin_from_tree(&tree, size, rule, kind) == bytes, "{form} {rule}");
            let file = Goblin::from_bytes(bytes.clone()).unwrap();
            let [_, leaves, _, holes, ..] = kinds(&file);
            assert!(leaves + holes > 0, "{form}: {leaves} and {holes} dense blocks");
            same_trees(&file, &tree);
            assert_eq!(file.verify(1 << 20, &()).unwrap(), []);
            assert_eq!(file.metadata().counts.records(), tree.inner_nodes() as u64);
            let mut random = Random(seed);
            windows(&file, &tree, &mut random);
            let view = view_of_file(file, size);
            assert!(goblin_from_view(&view, rule, kind) == bytes, "{form} {rule}");
        }
    }
}

/// Returns files whose segments have all kinds of dense blocks.
fn files_of_all_kinds() -> Vec<(Vec<u8>, Cells, MemTree)> {
    let mut files = Vec::new();
    for (form, side, reach, stride) in [
        (QUAD, 64, 4, 1),
        (quad(SampleType::I16, 1), 256, 6, 2),
        (OCT, 32, 3, 1),
        (oct(SampleType::U16, 3), 32, 3, 1),
    ] {
        let size = if form.axes() > 2 { [side; 3] } else { [side, side, 1] };
        let cells = content(form, Content::Blocks, side, size);
        let (rule, kind) = (Rule::Max, DataKind::Categorical);
        let tree = cells.tree(rule);
        // By value, multi-byte classes would need another sort order.
        let kind = if form.width() == 1 { kind } else { DataKind::Continuous };
        let cut = Cut { reach, stride, threshold: 1 };
        files.push((reference::goblin(&tree, size, (rule, kind), cut), cells, tree));
    }
    files
}

#[test]
fn every_kind_is_written_and_read() {
    for (bytes, cells, tree) in files_of_all_kinds() {
        let file = Goblin::from_bytes(bytes).unwrap();
        assert!(kinds(&file)[..6].iter().all(|count| *count > 0), "{}: {:?}", cells.form, kinds(&file));
        // Verification compares all bytes with those that the library writes.
        assert_eq!(file.verify(1 << 20, &()).unwrap(), []);
        same_trees(&file, &tree);
        let mut random = Random(3);
        windows(&file, &tree, &mut random);
        points(&file, &tree, &mut random);
        counts(&file, &cells, &mut random);
        check_strings(file, &tree);
    }
}

#[test]
fn files_of_several_segments_round_trip() {
    // Blocks of 256 cells along each axis are heavy: the root's segment has them cut off, as dense
    // blocks.
    let size = [900, 530, 1];
    let cells = content(QUAD, Content::Noise, 5, size);
    let tree = cells.tree(Rule::Mean);
    let bytes = goblin_bytes(&cells, Rule::Mean, DataKind::Continuous);
    let file = Goblin::from_bytes(bytes).unwrap();
    let kinds = kinds(&file);
    assert!(file.segments() > 8 && kinds[1] > 40 && kinds[2] + kinds[4] > 8, "{kinds:?}");
    same_trees(&file, &tree);
    let mut random = Random(6);
    windows(&file, &tree, &mut random);
    points(&file, &tree, &mut random);
    counts(&file, &cells, &mut random);
    // Sources yield FD code order, slabs do not, and segments yield their own order.
    let in_order = goblin_from_tree(&tree, size, Rule::Mean, DataKind::Continuous);
    let view = view_of_file(file, size);
    assert!(goblin_from_view(&view, Rule::Mean, DataKind::Continuous) == in_order);
}

#[test]
fn set_operations_and_views_make_the_files_of_arrays() {
    for (form, size) in [(QUAD, [130, 100, 1]), (oct(SampleType::I32, 1), [20, 33, 17])] {
        let (rule, kind) = (Rule::Mean, DataKind::Continuous);
        let pair = [content(form, Content::Blocks, 1, size), content(form, Content::Holes, 2, size)];
        let view = |cells: &Cells| view_of_file(common::goblin(cells, rule, kind), size);
        let views = pair.each_ref().map(view);
        for (number, prefer) in
            [(7, Prefer::First), (1, Prefer::Second), (2, Prefer::First), (6, Prefer::First)]
        {
            let operation = CombineOperation::Set { operation: set_operation(number), prefer };
            let made_of = combined(views.to_vec(), operation, size);
            let expected = made(form, size, |cell| {
                let (a, b) = (pair[0].get(cell), pair[1].get(cell));
                let bit = [[3, 2], [1, 0]][usize::from(a.is_some())][usize::from(b.is_some())];
                let value = if prefer == Prefer::First { a.or(b) } else { b.or(a) };
                value.filter(|_| number >> bit & 1 > 0)
            });
            let found = goblin_from_combined(&made_of, rule, kind);
            assert!(found == goblin_bytes(&expected, rule, kind), "{form}, operation {number} {prefer:?}");
        }
        // Combine views, one moved by whole blocks or single cells, or contained in the other.
        for by in [[8, 16, 0], [3, 1, 0], [64, 0, 0]] {
            let moved = views[1].clone().translate(by.map(|by| by as f64)).unwrap();
            let expected = made(form, size, |cell| {
                let from: [i64; 3] = std::array::from_fn(|axis| cell[axis] as i64 - by[axis]);
                pair[0].get(cell).or(pair[1].at(from))
            });
            let views = vec![views[0].clone(), moved.window([0; 3], size).unwrap()];
            let found = goblin_from_combined(&combined(views, CombineOperation::Over, size), rule, kind);
            assert!(found == goblin_bytes(&expected, rule, kind), "{form} moved by {by:?}");
        }
        for (min, size) in [([32, 32, 0], [40, 50, 1]), ([5, 2, 0], [100, 64, 1])] {
            let size = if form.axes() > 2 { size.map(|cells| 1 + cells / 8) } else { size };
            let min = if form.axes() > 2 { min.map(|cells| cells / 4) } else { min };
            let found = views[0].clone().window(min, size).unwrap();
            let expected = made(form, size, |cell| {
                pair[0].at(std::array::from_fn(|axis| cell[axis] as i64 + min[axis]))
            });
            common::assert_same(&common::seen(&found), &expected, "a window");
            let found = goblin_from_view(&found, rule, kind);
            assert!(found == goblin_bytes(&expected, rule, kind), "{form} from {min:?}");
        }
    }
}

#[test]
fn conversion_there_and_back_gives_the_same_bytes() {
    for (form, size) in [(QUAD, [300, 90, 1]), (quad(SampleType::F32, 3), [70, 70, 1]), (OCT, [33, 20, 40])] {
        for (i, content) in [Content::Noise, Content::Holes, Content::Blocks].into_iter().enumerate() {
            let cells = self::content(form, content, i as u64, size);
            let bytes = goblin_bytes(&cells, Rule::Mean, DataKind::Continuous);
            for share in [false, true] {
                let directory = tempfile::tempdir().unwrap();
                let path = |name: &str| directory.path().join(name);
                std::fs::write(path("a.goblin"), &bytes).unwrap();
                let output = |name| Output::create(&path(name)).unwrap();
                spinney::convert(
                    &path("a.goblin"),
                    share,
                    output("b.autumn"),
                    WriteOptions::new(1 << 24),
                    &(),
                )
                .unwrap();
                spinney::convert(
                    &path("b.autumn"),
                    false,
                    output("c.goblin"),
                    WriteOptions::new(1 << 24),
                    &(),
                )
                .unwrap();
                assert!(std::fs::read(path("c.goblin")).unwrap() == bytes, "{form} {content:?}");
            }
        }
    }
}

#[test]
fn the_bytes_do_not_depend_on_threads() {
    let cells = content(QUAD, Content::Blocks, 4, [600, 500, 1]);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| goblin_bytes(&cells, Rule::Majority, DataKind::Categorical))
    };
    let one = build(1);
    assert!(one == build(2) && one == build(5));
}

/// Runs all queries on a file with valid checksums, and builds other files from it.
fn survives(mut file: Vec<u8>) {
    seal::goblin(&mut file);
    query_goblin(file.clone());
    let Ok(file) = Goblin::from_bytes(file) else { return };
    let (size, form, depth) = (file.header().extent, file.header().form, file.depth());
    let side = 1u64 << depth;
    let all = Bounds { min: [0; 3], max: [side, side, if form.axes() > 2 { side } else { 1 }] };
    let mut bytes = vec![0; all.volume() as usize * form.width()];
    let _ = file.window(depth, &all, Value::ZERO, &mut bytes, None);
    let cells: Vec<[u32; 3]> = cells_of(&all)
        .step_by(1 + all.volume() as usize / 3000)
        .map(|cell| cell.map(|cell| cell as u32))
        .collect();
    let _ = file.values_at(depth, &cells, &mut vec![None; cells.len()]);
    let file: Arc<ViewSource> = Arc::new(file.into());
    let view = View::new(file, size).unwrap();
    let half = view.clone().window([4, 0, 0], size).unwrap();
    for operation in [CombineOperation::Over, CombineOperation::Min] {
        let both = combined(vec![view.clone(), half.clone()], operation, size);
        let directory = tempfile::tempdir().unwrap();
        let output = Output::create(&directory.path().join("t.goblin")).unwrap();
        let _ = ops::build(&both, &options(Rule::Mean, DataKind::Continuous, depth), output, &());
    }
}

#[test]
fn malicious_dense_blocks_are_harmless() {
    let plain = content(QUAD, Content::Blocks, 9, [64, 40, 1]);
    let plain = (
        goblin_bytes(&plain, Rule::Majority, DataKind::Categorical),
        plain.clone(),
        plain.tree(Rule::Majority),
    );
    let files = files_of_all_kinds().into_iter().filter(|(_, cells, _)| cells.size[0] <= 64);
    for (bytes, cells, _) in files.chain([plain]) {
        let file = Goblin::from_bytes(bytes.clone()).unwrap();
        let (layout, quad) = (*file.layout(), cells.form.axes() == 2);
        let (skip_bits, skip_bytes) = if quad { (21, 3) } else { (29, 4) };
        let mut random = Random(11);
        let mut records = Vec::new();
        for index in 0..file.segments() {
            let entry = file.entry(index).unwrap();
            each_place(&file, index, |at, dense, skip| {
                records.push((entry.offset as usize + (at + 1) * layout.size - skip_bytes, dense, skip));
            });
        }
        // The lengths of all kinds of dense blocks with their numbers of levels.
        let lengths: Vec<u32> = records.iter().filter(|record| record.1 > 0).map(|record| record.2).collect();
        for round in 0..45 {
            let mut bytes = bytes.clone();
            for _ in 0..1 + round % 3 {
                let dense = random.below(3) > 0;
                let some: Vec<_> = records.iter().filter(|record| (record.1 > 0) == dense).collect();
                let (at, mark, skip) = *some[random.below(some.len() as u64) as usize];
                let (mark, skip) = match random.below(6) {
                    // Another kind, an unknown kind, or none.
                    0 => (random.below(8) as u8, skip),
                    // Longer or shorter, up to beyond the segment.
                    1 => (mark, skip + 1),
                    2 => (
                        mark.max(1),
                        [0, 1, skip.saturating_sub(1), 2 * skip, (1 << skip_bits) - 1][round % 5],
                    ),
                    // The length of another block, with other levels, or of records.
                    3 => (1 + random.below(5) as u8, lengths[random.below(lengths.len() as u64) as usize]),
                    _ => {
                        // Changed masks, values and records.
                        let end = (at + skip as usize * layout.size).min(bytes.len());
                        for _ in 0..40 {
                            let byte = at + random.below((end - at) as u64) as usize;
                            bytes[byte] = [0, 255, random.next() as u8][random.below(3) as usize];
                        }
                        continue;
                    }
                };
                let word = (u32::from(mark) << skip_bits | skip & ((1 << skip_bits) - 1)).to_le_bytes();
                bytes[at..at + skip_bytes].copy_from_slice(&word[..skip_bytes]);
            }
            survives(bytes);
        }
    }
}

#[test]
fn a_segment_has_no_more_records_than_can_be_counted() {
    let cells = content(QUAD, Content::Noise, 1, [8, 8, 1]);
    let file = |reach, stride, threshold| {
        let cut = Cut { reach, stride, threshold };
        let file =
            reference::goblin(&cells.tree(Rule::Mean), cells.size, (Rule::Mean, DataKind::Continuous), cut);
        Goblin::from_bytes(file).map(|_| ()).map_err(|error| error.to_string())
    };
    for good in [(10, 5, 1 << 10), (8, 2, 1 << 16), (10, 1, 1 << 18)] {
        assert_eq!(file(good.0, good.1, good.2), Ok(()));
    }
    for bad in [(10, 5, (1 << 10) + 1), (8, 2, 1 << 17), (10, 1, 1 << 19), (12, 2, 4096)] {
        assert!(file(bad.0, bad.1, bad.2).unwrap_err().contains("heavy threshold"), "{bad:?}");
    }
}
