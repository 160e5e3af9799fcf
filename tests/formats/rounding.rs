//! Cells that are rounded when a tree is written.

use spinney::edit::Note;
use spinney::raw::ops;
use spinney::raw::store::goblin::Goblin;
use spinney::raw::store::{FileReference, Packing, build_tree};
use spinney::tree::MemTree;
use spinney::{
    BuildOptions, Code, DataKind, Dataset, Dimension, FileView, OpenOptions, Output, Rule, SampleType,
    TreeType, Value, ValueType, WriteOptions,
};

use crate::common::{Cells, as_byte, bytes_of, options, value_types, with, write_cells};

/// Rounds a number as documented: to the nearest multiple of the largest power of two that is at
/// most twice the error.
fn rounded(value_type: ValueType, cell: Value, most: f64) -> Value {
    let step = 2f64.powi((2.0 * most).log2().floor() as i32);
    if !value_type.sample.is_float() && step < 2.0 {
        return cell;
    }
    // All of these have few enough digits.
    value_type.nearest(|channel| {
        let number = value_type.numbers(cell)[channel].to_f64();
        let half = if value_type.sample.is_float() && number < 0.0 { -0.5 } else { 0.5 };
        let nearest = match value_type.sample.is_float() {
            // Zeros are positive.
            true => (number / step + half).trunc() * step + 0.0,
            false => (number / step + half).floor() * step,
        };
        let max = match value_type.sample {
            SampleType::U8 => 255.0,
            SampleType::I8 => 127.0,
            _ => f64::MAX,
        };
        match nearest > max {
            true if number - (nearest - step) <= step / 2.0 => nearest - step,
            true => number,
            false => nearest,
        }
    })
}

fn written(cells: &Cells, options: &BuildOptions) -> Vec<u8> {
    bytes_of(|path| write_cells(path, cells, options))
}

/// Returns the file of rounded cells, with the rounding in its metadata.
fn model(cells: &Cells, rule: Rule, most: f64) -> Vec<u8> {
    let round = |cell: Option<Value>| cell.map(|cell| rounded(cells.form.value, cell, most));
    let cells = Cells { cells: cells.cells.iter().map(|cell| round(*cell)).collect(), ..cells.clone() };
    let options = options(rule, DataKind::Continuous, cells.depth());
    written(
        &cells,
        &with(options, |options| {
            options.metadata.tags.insert("max_error".into(), most.to_string());
        }),
    )
}

#[test]
fn cells_are_rounded_before_all_else() {
    for (number, value_type) in value_types().into_iter().enumerate() {
        // 64-bit numbers have more digits than the model.
        if value_type.sample.size() == 8 && !value_type.sample.is_float() {
            continue;
        }
        for (form, size) in [
            (TreeType::new(Dimension::Quad, value_type), [300, 260, 1]),
            (TreeType::new(Dimension::Oct, value_type), [40, 70, 20]),
        ] {
            let (rule, most) = [(Rule::Mean, 0.3), (Rule::Max, 2.0), (Rule::Occupancy, 5.0)][number % 3];
            let cells = Cells::random(form, number as u64, size, 240, true);
            let expected = model(&cells, rule, most);
            let packing = Packing::default().max_error(Some(most));
            let how = options(rule, DataKind::Continuous, cells.depth()).packing(packing);
            let made = written(&cells, &how);
            assert!(made == expected, "{form}, {rule}, {most}");
            let tree = Goblin::from_bytes(made).unwrap();
            assert_eq!(tree.verify(1 << 20, &()).unwrap(), [], "{form}, {rule}, {most}");
            // Trees are rounded in the same way as slabs.
            let exact = written(&cells, &options(rule, DataKind::Continuous, cells.depth()));
            let directory = tempfile::tempdir().unwrap();
            let [from, to] = ["a.goblin", "b.goblin"].map(|name| directory.path().join(name));
            std::fs::write(&from, exact).unwrap();
            let how = WriteOptions::new(1 << 20).packing(packing);
            spinney::convert(&from, false, Output::create(&to).unwrap(), how, &()).unwrap();
            assert!(std::fs::read(&to).unwrap() == expected, "{form}, {rule}, {most} of a tree");
            // Rounding again changes only its record in the metadata.
            let again = directory.path().join("c.goblin");
            spinney::convert(&to, false, Output::create(&again).unwrap(), how, &()).unwrap();
            let again = Goblin::open(&again, &OpenOptions::new()).unwrap();
            assert_eq!(again.metadata().tags["max_error"], (2.0 * most).to_string());
            assert_eq!(again.root_child(), tree.root_child());
        }
    }
}

#[test]
fn no_cell_differs_by_more() {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
    let cell = |[x, y, _]: [u32; 3]| Value::from([(16 * y + x) as u8]);
    let cells = MemTree::from_cells(form, 4, Rule::Nearest, &|at| Some(cell(at)));
    for most in [1.0, 1.5, 2.0, 3.0, 7.0, 100.0] {
        let packing = Packing::default().max_error(Some(most));
        let how = options(Rule::Nearest, DataKind::Continuous, 4).packing(packing);
        let bytes = bytes_of(|path| {
            build_tree(&cells, [16, 16, 1], &how, Output::create(path).unwrap(), &()).unwrap();
        });
        let tree = Goblin::from_bytes(bytes).unwrap();
        for at in (0..256).map(|at| [at % 16, at / 16, 0]) {
            let code = Code::from_cell(form.dimension, 4, at).unwrap();
            let there = tree.value_at(code).unwrap().unwrap();
            let difference = as_byte(there).abs_diff(as_byte(cell(at)));
            assert!(f64::from(difference) <= most, "{most}: {difference} at {at:?}");
        }
    }
}

#[test]
fn layers_that_are_added_are_rounded_in_both_formats() {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, 1));
    let cells = Cells::noise(form, 5, [70, 40, 1], 200);
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let plain = options(Rule::Mean, DataKind::Continuous, cells.depth());
    write_cells(&at("other.goblin"), &cells, &plain);
    let expected = Goblin::from_bytes(model(&cells, Rule::Mean, 2.0)).unwrap();
    let expected = Dataset::of(expected.into()).unwrap().statistics(None, &()).unwrap();
    for name in ["file.goblin", "file.autumn"] {
        write_cells(&at(name), &cells, &plain);
        let how = WriteOptions::new(1 << 24).packing(Packing::default().max_error(Some(2.0)));
        let chain = FileView::of(&at("other.goblin"));
        ops::add_layer(&at(name), "rounded", &chain, Note::default(), how, &()).unwrap();
        let layer = spinney::open(FileReference::of(&at(name)).of_layer("rounded")).unwrap();
        assert_eq!(layer.metadata().tags["max_error"], "2", "{name}");
        assert_eq!(layer.statistics(None, &()).unwrap().channels, expected.channels, "{name}");
    }
}

#[test]
fn invalid_names_and_errors_are_rejected() {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
    let tree = Cells::random(form, 1, [8, 8, 1], 9, true).tree(Rule::Majority);
    for (kind, most, what) in [
        (DataKind::Categorical, 1.0, "maximum error: got 1 for a categorical tree"),
        (DataKind::Continuous, 0.0, "maximum error: got 0"),
        (DataKind::Continuous, f64::NAN, "maximum error: got NaN"),
        (DataKind::Continuous, -1.0, "maximum error: got -1"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.goblin");
        let how = BuildOptions::new(kind, 3).packing(Packing::default().max_error(Some(most)));
        let made = build_tree(&tree, [8, 8, 1], &how, Output::create(&path).unwrap(), &());
        let error = made.unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
        assert!(!path.exists());
    }
}
