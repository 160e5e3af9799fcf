//! Trees with cells two, four, ... times as large or small as the file's: identical to the file's
//! own levels.

use spinney::{Bounds, DataKind, Dataset, FileView, Output, Rule, SampleType, TreeType, WriteOptions};

use crate::common::{Cells, Random, oct, options, quad, with, write_cells};

/// Returns all cells of a level.
fn level(tree: &Dataset, level: u8) -> (Vec<u8>, Vec<bool>) {
    let form = tree.header().form;
    let space = Bounds::space(form.dimension, level);
    let cells = space.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; cells * form.width()], vec![false; cells]);
    tree.window(level, &space, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    (bytes, valid)
}

fn forms() -> Vec<(TreeType, Rule, DataKind)> {
    let mut forms = Vec::new();
    for sample in [SampleType::U8, SampleType::I16, SampleType::F32, SampleType::F64] {
        for form in [quad(sample, 1), quad(sample, 3), oct(sample, 1)] {
            if form.value.is_supported() {
                forms.push((form, Rule::Mean, DataKind::Continuous));
            }
        }
    }
    for rule in [Rule::Majority, Rule::Min, Rule::Max] {
        forms.push((quad(SampleType::U8, 1), rule, DataKind::Categorical));
    }
    forms
}

#[test]
fn halves_are_the_levels_of_the_file() {
    let mut random = Random(5);
    for (number, (form, rule, kind)) in forms().into_iter().enumerate() {
        let directory = tempfile::tempdir().unwrap();
        let depth = if form.axes() == 3 { 4 } else { 6 };
        let size = std::array::from_fn(|axis| {
            if axis < form.axes() { (1 << depth) - random.below(1 << (depth - 1)) } else { 1 }
        });
        let cells = Cells::random(form, random.next(), size, 40, number % 2 == 0);
        let path = directory.path().join("file.goblin");
        write_cells(&path, &cells, &options(rule, kind, depth));
        let tree = spinney::open(&path).unwrap();
        for above in 1..3u8 {
            let factor = 1.0 / f64::from(1u32 << above);
            for step in [format!("scale={factor}"), format!("depth={}", depth - above)] {
                let made = directory.path().join("made.goblin");
                let chain = with(FileView::of(&path), |it| it.steps = vec![step.parse().unwrap()]);
                let how = WriteOptions::new(64 << 20);
                spinney::transform(&chain, Output::create(&made).unwrap(), how, &()).unwrap();
                let made = spinney::open(&made).unwrap();
                assert_eq!(made.depth(), depth - above);
                assert!(level(&made, depth - above) == level(&tree, depth - above), "{form} {rule:?} {step}");
                let frame = tree.metadata().frame.coarser(above);
                assert_eq!(made.metadata().frame.affine(), frame.affine());
            }
        }
    }
}

/// Windows aligned to nodes, and others with partial nodes.
#[test]
fn halves_of_windows_are_those_of_their_cells() {
    let directory = tempfile::tempdir().unwrap();
    let form = quad(SampleType::F32, 1);
    let cells = Cells::random(form, 8, [61, 50, 1], 40, true);
    let path = directory.path().join("file.goblin");
    write_cells(&path, &cells, &options(Rule::Mean, DataKind::Continuous, 6));
    let transformed = |name: &str, from: &str, steps: &[&str]| {
        let to = directory.path().join(name);
        let chain = with(FileView::of(&directory.path().join(from)), |it| {
            it.steps = steps.iter().map(|step| step.parse().unwrap()).collect();
        });
        spinney::transform(&chain, Output::create(&to).unwrap(), WriteOptions::new(64 << 20), &()).unwrap();
        spinney::open(&to).unwrap()
    };
    for window in
        ["8,4,40,36", "8,4,53,46", "9,4,40,36", "7,3,33,31", "-4,-8,40,40", "0,0,61,50", "30,10,200,90"]
    {
        let window = format!("window={window}");
        // A file of the window has only the window's cells.
        transformed("window.goblin", "file.goblin", &[&window]);
        let expected = transformed("expected.goblin", "window.goblin", &["scale=0.5"]);
        let found = transformed("found.goblin", "file.goblin", &[&window, "scale=0.5"]);
        assert_eq!(found.header().extent, expected.header().extent, "{window}");
        assert!(level(&found, found.depth()) == level(&expected, expected.depth()), "{window}");
        assert_eq!(found.metadata().frame, expected.metadata().frame, "{window}");
    }
}

#[test]
fn doubled_cells_are_the_cells_of_the_file() {
    let directory = tempfile::tempdir().unwrap();
    for (form, kind, rule) in [
        (quad(SampleType::F32, 1), DataKind::Continuous, Rule::Mean),
        (quad(SampleType::U8, 1), DataKind::Categorical, Rule::Majority),
        (oct(SampleType::U16, 1), DataKind::Continuous, Rule::Mean),
    ] {
        let size = [13, 9, if form.axes() == 3 { 11 } else { 1 }];
        let path = directory.path().join("file.goblin");
        write_cells(&path, &Cells::random(form, 4, size, 40, true), &options(rule, kind, 4));
        let chain = with(FileView::of(&path), |it| it.steps = vec!["scale=4".parse().unwrap()]);
        let made = directory.path().join("made.goblin");
        spinney::transform(&chain, Output::create(&made).unwrap(), WriteOptions::new(64 << 20), &()).unwrap();
        let (tree, made) = (spinney::open(&path).unwrap(), spinney::open(&made).unwrap());
        assert_eq!(made.depth(), 6);
        for shallow in 0..=4 {
            assert!(level(&made, shallow) == level(&tree, shallow), "{form}");
        }
        let (bytes, valid) = level(&made, 6);
        let (old, old_valid) = level(&tree, 4);
        let width = form.width();
        for (index, is_valid) in valid.iter().enumerate() {
            let [x, y, z] = [index % 64, index / 64 % 64, index / 4096].map(|cell| cell / 4);
            let old_index = (z * 16 + y) * 16 + x;
            assert_eq!(*is_valid, old_valid[old_index]);
            if *is_valid {
                assert_eq!(bytes[index * width..][..width], old[old_index * width..][..width]);
            }
        }
    }
}
