//! The commit that last changed each cell, against a model of every cell.

use std::path::Path;

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::ops::blame;
use spinney::{Bounds, DataKind, Number, Output, Rule, TreeType, WriteOptions};

use crate::common::{Cells, OCT, QUAD, Random, options, write_cells};

const MEMORY: u64 = 1 << 24;

/// Returns the value of each cell; the first axis varies fastest.
fn values(path: &Path, size: [u64; 3]) -> Vec<Option<f64>> {
    let tree = spinney::open(path).unwrap();
    let mut found = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let mut value = [Number::default(); 4];
                let is_there = tree.point([x, y, z], tree.depth(), &mut value).unwrap();
                found.push(is_there.then_some(value[0].to_f64()));
            }
        }
    }
    found
}

fn ages(form: TreeType, size: [u64; 3], share: bool, seed: u64) {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    let path = name("t.autumn");
    let mut random = Random(seed);
    let cells = Cells::random(form, seed, size, 6, true);
    write_cells(&path, &cells, &options(Rule::Majority, DataKind::Categorical, cells.depth()).share(share));
    let mut last = values(&path, size);
    let mut expected: Vec<Option<f64>> = last.iter().map(|value| value.map(|_| 1.0)).collect();
    let mut history = vec![expected.clone()];
    while history.len() < 9 {
        let min: [u64; 3] = std::array::from_fn(|axis| random.below(size[axis]));
        let max = std::array::from_fn(|axis| min[axis] + 1 + random.below(size[axis] - min[axis]));
        let value = (random.below(4) > 0).then(|| vec![random.below(3).into()]);
        let change = Edit::Fill(FillRegion::Box(Bounds { min, max }), value);
        let Some(commit) = edit(&path, [Ok(change)], Note::default(), MEMORY, &()).unwrap() else { continue };
        let now = values(&path, size);
        for ((age, before), after) in expected.iter_mut().zip(&last).zip(&now) {
            if before != after {
                *age = Some(commit.number as f64);
            }
        }
        history.push(expected.clone());
        last = now;
    }
    for (index, expected) in history.iter().enumerate() {
        let number = index + 1;
        let out = name(&format!("age{number}.goblin"));
        let at = directory.path().join(format!("t.autumn@{number}"));
        blame(&at, Output::create(&out).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
        assert_eq!(values(&out, size), *expected, "{form} {share} {seed}: commit {number}");
    }
    let newest = name("newest.goblin");
    blame(&path, Output::create(&newest).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
    let last = name(&format!("age{}.goblin", history.len()));
    let cells_of = |path: &Path| values(path, size);
    assert_eq!(cells_of(&newest), cells_of(&last));
}

#[test]
fn ages_are_those_of_every_cell() {
    for seed in 0..6 {
        ages(QUAD, [37, 29, 1], seed % 2 == 0, seed);
    }
    for seed in 0..3 {
        ages(OCT, [11, 13, 9], seed % 2 == 0, 10 + seed);
    }
}

#[test]
fn files_without_commits_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    let cells = Cells::random(QUAD, 1, [9, 9, 1], 5, true);
    write_cells(&path, &cells, &options(Rule::Majority, DataKind::Categorical, cells.depth()));
    let out = directory.path().join("o.goblin");
    let error =
        blame(&path, Output::create(&out).unwrap(), WriteOptions::new(MEMORY), &()).unwrap_err().to_string();
    assert!(error.contains("commits"), "{error}");
    assert!(!out.exists());
}
