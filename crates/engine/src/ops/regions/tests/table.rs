//! Tables of labels against sums over the cells of a naive model.

use std::collections::BTreeMap;

use super::*;
use crate::ops::LabelRequest;
use crate::ops::regions::find_labels;
use crate::ops::regions::rows::{Row, Rows};
use crate::ops::regions::table::table_of;
use spinney_base::space::Bounds;
use spinney_base::value::Number;

/// Table entry of a label.
#[derive(Debug, PartialEq)]
struct TableEntry {
    label: Number,
    class: Option<Number>,
    cells: u64,
    bounds: Bounds,
    first: [u64; 3],
    neighbours: Vec<(Number, u64)>,
}

impl Model {
    /// Table of cells with labels; cells with `None` have no label.
    fn table(&self, labels: &[Option<Number>], class: impl Fn(Value) -> Option<Number>) -> Vec<TableEntry> {
        let cell = |path: usize| {
            Code::from_path(self.form.dimension, self.depth, path as u64).unwrap().cell().map(u64::from)
        };
        let mut table: BTreeMap<Number, TableEntry> = BTreeMap::new();
        let mut touches: BTreeMap<(Number, Number), u64> = BTreeMap::new();
        for (path, label) in labels.iter().enumerate() {
            let (Some(label), Some(value)) = (*label, self.cells[path]) else { continue };
            let bounds = Bounds { min: cell(path), max: cell(path).map(|cell| cell + 1) };
            let entry = table.entry(label).or_insert_with(|| TableEntry {
                label,
                class: class(value),
                cells: 0,
                bounds,
                first: cell(path),
                neighbours: Vec::new(),
            });
            entry.cells += 1;
            entry.bounds = entry.bounds.hull(&bounds);
            for other in self.around(path, 0).into_iter().filter_map(|other| labels[other]) {
                if other != label {
                    *touches.entry((label, other)).or_default() += 1;
                }
            }
        }
        for ((label, other), faces) in touches {
            table.get_mut(&label).unwrap().neighbours.push((other, faces));
        }
        table.into_values().collect()
    }
}

fn entries_of(cells: &Cells, request: &LabelRequest) -> Vec<TableEntry> {
    let mut table = Vec::new();
    let summary = table_of(cells, request, &(), &mut |label| {
        let mut neighbours = Vec::new();
        while let Some(neighbour) = label.next_neighbour()? {
            neighbours.push((neighbour.label, neighbour.faces));
        }
        table.push(TableEntry {
            label: label.label(),
            class: label.class().map(|class| class[0]),
            cells: label.cells(),
            bounds: label.bounds(),
            first: label.first_cell(),
            neighbours,
        });
        Ok(())
    })
    .unwrap();
    assert_eq!(summary.count, table.len() as u64);
    assert_eq!(summary.cells, table.iter().map(|entry| entry.cells).sum::<u64>());
    table
}

#[test]
fn tables_are_those_of_all_cells() {
    let mut random = Random(3);
    for round in 0..200 {
        let sample = SampleType::ALL[round % 10];
        let (dimension, depth) = if round % 3 == 0 { (Dimension::Oct, 3) } else { (QUAD, 4) };
        let mut model = Model::random(form(dimension, sample), depth, &mut random);
        if matches!(sample, SampleType::I8 | SampleType::I32 | SampleType::I64 | SampleType::F64) {
            // Some of the values less than 0.
            for value in model.cells.iter_mut().flatten() {
                let number = model.form.value.first_sample(*value) - 2.0;
                *value = model.form.value.nearest(|_| number);
            }
        }
        let mut request = LabelRequest::new();
        // (Some of them in a file.)
        request.memory = [64 << 20, 1 << 10][round / 2 % 2];
        let block_levels = random.below(5) as u8;
        let number = |value: Value| model.form.value.first_number(value);
        let values: Vec<_> = model.cells.iter().map(|value| value.map(number)).collect();
        let cells = Cells { block_levels, ..Cells::values(model.view(), 0) };
        assert_eq!(entries_of(&cells, &request), model.table(&values, |_| None), "{}", model.form);

        let reach = round as u32 / 3 % 2;
        request.connect = Some(crate::ops::Connectivity::of(dimension, reach > 0));
        let cells = Cells { block_levels, ..Cells::values(model.view(), reach) };
        let components = model.labels(reach);
        let components: Vec<_> =
            components.into_iter().map(|label| (label > 0).then_some(Number::Unsigned(label))).collect();
        let expected = model.table(&components, |value| Some(number(value)));
        assert_eq!(
            entries_of(&cells, &request),
            expected,
            "{} reach {reach} levels {block_levels}",
            model.form
        );
    }
}

#[test]
fn labels_without_neighbours_and_neighbours_that_are_not_requested() {
    let mut random = Random(8);
    let model = Model::new(form(QUAD, SampleType::U8), 6, &mut |_| {
        let class = random.below(4) as u8;
        (class > 0).then(|| Value::from([class]))
    });
    let mut request = LabelRequest::new();
    request.connect = Some("4".parse().unwrap());
    let all = entries_of(&Cells::values(model.view(), 0), &request);
    let mut next = all.iter();
    find_labels(&model.view(), &request, &(), &mut |label| {
        let expected = next.next().unwrap();
        assert_eq!((label.label(), label.cells()), (expected.label, expected.cells));
        if label.cells() % 2 == 0 {
            let first = label.next_neighbour()?.map(|neighbour| (neighbour.label, neighbour.faces));
            assert_eq!(first, expected.neighbours.first().copied());
        }
        Ok(())
    })
    .unwrap();
    request.neighbours = false;
    let alone = entries_of(&Cells::values(model.view(), 0), &request);
    assert!(all.iter().any(|entry| !entry.neighbours.is_empty()));
    assert!(alone.iter().all(|entry| entry.neighbours.is_empty()));
    assert_eq!(alone.len(), all.len());
}

#[test]
fn what_has_no_table_is_said() {
    let colours = TreeType::new(QUAD, ValueType::new(SampleType::U8, 3));
    let view = || Model::random(colours, 3, &mut Random(4)).view();
    let mut request = LabelRequest::new();
    let error = find_labels(&view(), &request, &(), &mut |_| Ok(())).unwrap_err().to_string();
    assert!(error.contains("several channels"), "{error}");
    request.connect = Some("26".parse().unwrap());
    let error = find_labels(&view(), &request, &(), &mut |_| Ok(())).unwrap_err().to_string();
    assert!(error.contains("4 or 8"), "{error}");
    request.connect = Some("8".parse().unwrap());
    let found = find_labels(&view(), &request, &(), &mut |label| {
        assert_eq!(label.class().unwrap().len(), 3);
        Ok(())
    });
    assert!(found.unwrap().count > 0);
    let stops = Stops(Default::default(), 1);
    assert!(matches!(find_labels(&view(), &request, &stops, &mut |_| Ok(())), Err(Error::Interrupted)));
}

#[derive(Clone, Copy, zerocopy::FromBytes, zerocopy::IntoBytes, zerocopy::Immutable)]
#[repr(C)]
struct Count {
    key: u64,
    count: u64,
}

impl Row for Count {
    fn key(&self) -> u128 {
        self.key.into()
    }

    fn add(&mut self, other: &Count) {
        self.count += other.count;
    }
}

#[test]
fn rows_beyond_memory_are_added_up() {
    let directory = tempfile::tempdir().unwrap();
    let mut random = Random(12);
    for (memory, keys) in [(0, 50_000), (1 << 12, 500), (1 << 24, 50_000), (1 << 10, 1)] {
        let mut rows = Rows::new(directory.path(), memory);
        let mut expected: BTreeMap<u64, u64> = BTreeMap::new();
        for _ in 0..100_000 {
            let (key, count) = (random.below(keys), random.below(9));
            rows.push(Count { key, count }).unwrap();
            *expected.entry(key).or_default() += count;
        }
        let mut sorted = rows.sorted().unwrap();
        for (key, count) in expected {
            assert_eq!(sorted.peek(), Some(key.into()));
            let row = sorted.next().unwrap().unwrap();
            assert_eq!((row.key, row.count), (key, count));
        }
        assert!(sorted.peek().is_none() && sorted.next().unwrap().is_none());
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}
