//! Compares point trees with linear searches of all points in memory.

use std::collections::HashMap;

use crate::attribute::{PointAttribute, RowLayout, position_of};
use crate::grid::spacing_levels;
use crate::query::{PointCondition, PointRegion, Relation, Selection};
use crate::source::{PointRows, PointSchema, PointSource};
use crate::store::PointTree;
use crate::{BuildSummary, PointBuildOptions, build};
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::SampleType;
use spinney_container::Metadata;

/// Random numbers with a fixed seed.
pub(crate) fn random(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let mixed = state ^ state >> 29;
        mixed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 16
    }
}

pub(crate) fn layout() -> RowLayout {
    let attribute = |(name, sample): &(&str, SampleType)| PointAttribute::new(*name, *sample);
    RowLayout::packed(
        [("classification", SampleType::U8), ("gps_time", SampleType::F64), ("height", SampleType::F32)]
            .iter()
            .map(attribute)
            .collect(),
    )
}

/// Returns rows of points at the positions; attributes derive from the index.
pub(crate) fn rows(positions: impl IntoIterator<Item = [i32; 3]>, layout: &RowLayout) -> Vec<u8> {
    let mut rows = Vec::new();
    for (number, position) in positions.into_iter().enumerate() {
        position.iter().for_each(|step| rows.extend_from_slice(&step.to_le_bytes()));
        for attribute in &layout.attributes {
            match attribute.sample {
                SampleType::U8 => rows.push((number % 5) as u8),
                SampleType::F64 => rows.extend_from_slice(&(1e5 + (number / 3) as f64 * 0.25).to_le_bytes()),
                _ => rows.extend_from_slice(&(position[2] as f32 * 0.5).to_le_bytes()),
            }
        }
    }
    rows
}

fn bytes_of(
    rows: &[u8],
    dimension: Dimension,
    options: &PointBuildOptions,
) -> Result<(Vec<u8>, BuildSummary)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("p.goblin");
    let mut source = PointRows::new(PointSchema::new(layout(), dimension), rows.to_vec())?;
    let built = build(&mut source, options, &Metadata::default(), Output::create(&path)?, &())?;
    Ok((std::fs::read(&path).unwrap(), built))
}

fn tree_of(rows: &[u8], dimension: Dimension, leaf_size: usize) -> PointTree {
    let (bytes, _) =
        bytes_of(rows, dimension, &PointBuildOptions { leaf_size, ..PointBuildOptions::default() }).unwrap();
    PointTree::from_bytes(bytes).unwrap()
}

/// Returns the rows of a selection, sorted as bytes.
fn selected(tree: &PointTree, selection: &Selection) -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    let layout = tree.layout();
    tree.select(selection, None, &(), &mut |points| {
        for point in 0..points.len() {
            let mut row = vec![0; layout.size];
            for (axis, step) in points.position(point).iter().enumerate() {
                row[4 * axis..4 * axis + 4].copy_from_slice(&step.to_le_bytes());
            }
            (0..layout.attributes.len()).for_each(|attribute| {
                layout.set_number(attribute, &mut row, points.columns[3 + attribute][point])
            });
            found.push(row);
        }
        Ok(())
    })
    .unwrap();
    found.sort();
    found
}

fn sorted(rows: &[u8], keep: impl Fn(&[u8]) -> bool) -> Vec<Vec<u8>> {
    let mut rows: Vec<Vec<u8>> =
        rows.chunks_exact(layout().size).filter(|row| keep(row)).map(<[u8]>::to_vec).collect();
    rows.sort();
    rows
}

/// Positions of all kinds: scattered, on a plane, in clumps, equal ones, on split planes.
pub(crate) fn scattered_positions(count: usize, seed: u64) -> Vec<[i32; 3]> {
    let mut random = random(seed);
    let mut number = |below: u64| (random() % below) as i32;
    (0..count)
        .map(|point| match point % 6 {
            0 => [number(1 << 20), number(1 << 20), number(1 << 20)],
            1 | 2 => [number(1 << 20), number(1 << 20), 5000 + number(40)],
            3 => [700_000 + number(3), 100 + number(3), number(2)],
            4 => [1 << 19, number(1 << 20), 1 << 19],
            _ => [-3, -3, -3],
        })
        .collect()
}

#[test]
fn all_points_are_stored_once() {
    for dimension in [Dimension::Oct, Dimension::Quad] {
        for (count, leaf_size) in
            [(0, 10), (1, 1), (7, 1), (3000, 1), (3000, 100), (20_000, 500), (3000, 5000)]
        {
            let rows = rows(scattered_positions(count, 5), &layout());
            let tree = tree_of(&rows, dimension, leaf_size);
            assert_eq!(tree.len(), count as u64);
            assert_eq!(
                selected(&tree, &Selection::default()),
                sorted(&rows, |_| true),
                "{dimension:?} {count} {leaf_size}"
            );
            let mut positions: Vec<[i32; 3]> = rows.chunks_exact(layout().size).map(position_of).collect();
            positions.sort();
            positions.dedup();
            assert_eq!(tree.duplicates(), (count - positions.len()) as u64);
            assert_eq!(tree.verify(&()).unwrap(), []);
        }
    }
}

#[test]
fn levels_have_points_in_all_sampling_cells() {
    for dimension in [Dimension::Oct, Dimension::Quad] {
        let rows = rows(scattered_positions(30_000, 8), &layout());
        // A leaf size of one: nodes are divided as far as possible.
        let tree = tree_of(&rows, dimension, 1);
        let grid = tree.grid();
        let deepest = grid.deepest();
        for level in 0..deepest {
            let part =
                |row: &[u8]| grid.code(position_of(row)).unwrap().ancestor(level + spacing_levels(dimension));
            let mut found: Vec<_> =
                selected(&tree, &Selection { level: Some(level), ..Selection::default() })
                    .iter()
                    .map(|row| part(row))
                    .collect();
            let all = found.len();
            found.sort();
            found.dedup();
            let mut expected: Vec<_> = rows.chunks_exact(layout().size).map(part).collect();
            expected.sort();
            expected.dedup();
            assert!(found == expected, "{dimension:?} {level}");
            // In addition to one point per sampling cell, there are leaves with one isolated point
            // each.
            let leaves = tree.counts().0;
            assert!(
                all <= found.len() + leaves,
                "{dimension:?} {level}: {all} points in {} parts",
                found.len()
            );
        }
    }
}

#[test]
fn selections_equal_those_of_a_full_scan() {
    let rows = rows(scattered_positions(20_000, 3), &layout());
    let tree = tree_of(&rows, Dimension::Oct, 300);
    let within = |position: [i32; 3], least: [i32; 3], most: [i32; 3]| {
        (0..3).all(|axis| (least[axis]..=most[axis]).contains(&position[axis]))
    };
    let mut random = random(77);
    for _ in 0..60 {
        let mut number = |below: u64| (random() % below) as i32;
        let least = [number(1 << 20) - 9, number(1 << 20) - 9, number(1 << 14) - 9];
        let most = std::array::from_fn(|axis| least[axis] + number(1 << 18));
        let corners = [least, most].map(|corner| corner.map(f64::from));
        let region = PointRegion::Box(corners);
        let class = f64::from(number(6));
        let relations = [
            (Relation::Equal, 0u8),
            (Relation::Unequal, 1),
            (Relation::Less, 2),
            (Relation::AtMost, 3),
            (Relation::Greater, 4),
            (Relation::AtLeast, 5),
        ];
        let (relation, kind) = relations[number(6) as usize];
        let holds = |class_of: f64| {
            [
                class_of == class,
                class_of != class,
                class_of < class,
                class_of <= class,
                class_of > class,
                class_of >= class,
            ][usize::from(kind)]
        };
        let conditions = vec![PointCondition { attribute: 0, relation, number: class }];
        let selection = Selection { region, level: None, conditions };
        let expected = sorted(&rows, |row| within(position_of(row), least, most) && holds(row[12].into()));
        assert_eq!(selected(&tree, &selection), expected);
        assert_eq!(tree.count(&selection, &()).unwrap(), expected.len() as u64);

        let (centre, radius) = (corners[0], f64::from(number(1 << 18)));
        let square = |row: &[u8]| {
            (0..3).map(|axis| (f64::from(position_of(row)[axis]) - centre[axis]).powi(2)).sum::<f64>()
        };
        let selection = Selection { region: PointRegion::Ball(centre, radius), ..Selection::default() };
        let expected = sorted(&rows, |row| square(row) <= radius * radius);
        assert_eq!(tree.count(&selection, &()).unwrap(), expected.len() as u64);
        assert_eq!(selected(&tree, &selection), expected);

        // Off-grid corners, so that no point is on an edge.
        let corner = |x: i32, y: i32| [f64::from(x) + 0.25, f64::from(y) + 0.37];
        let triangle = [
            corner(least[0], least[1]),
            corner(most[0], least[1] + number(99)),
            corner(number(1 << 20), most[1]),
        ];
        let side = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
            (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0.0
        };
        let inside = |row: &[u8]| {
            let at = [f64::from(position_of(row)[0]), f64::from(position_of(row)[1])];
            let sides = [0, 1, 2].map(|edge| side(triangle[edge], triangle[(edge + 1) % 3], at));
            sides == [true; 3] || sides == [false; 3]
        };
        let selection = Selection {
            region: PointRegion::Polygons(vec![vec![triangle.to_vec()]]),
            ..Selection::default()
        };
        assert_eq!(selected(&tree, &selection), sorted(&rows, inside));
        let statistics = tree.statistics(&selection, &()).unwrap();
        let expected = sorted(&rows, inside);
        assert_eq!(statistics.points, expected.len() as u64);
        if let Some(height) = &statistics.columns[2] {
            let heights: Vec<f64> = expected.iter().map(|row| position_of(row)[2].into()).collect();
            assert_eq!(height.max, heights.iter().copied().fold(f64::MIN, f64::max));
            let mean = heights.iter().sum::<f64>() / heights.len() as f64;
            assert!((height.mean - mean).abs() <= 1e-9 * mean.abs().max(1.0), "{} {mean}", height.mean);
        }
    }
}

#[test]
fn bytes_are_the_same_with_little_memory_and_many_threads() {
    let rows = rows(scattered_positions(60_000, 21), &layout());
    for dimension in [Dimension::Oct, Dimension::Quad] {
        let options = |memory: u64| PointBuildOptions { leaf_size: 700, memory };
        let (expected, built) = bytes_of(&rows, dimension, &options(1 << 30)).unwrap();
        for (memory, threads) in [(1 << 30, 5), (1, 1), (1 << 18, 3)] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (found, same) = pool.install(|| bytes_of(&rows, dimension, &options(memory))).unwrap();
            assert_eq!(same, built);
            assert!(found == expected, "{dimension:?} {memory} {threads}");
        }
    }
}

/// Clumps of points across space, at all scales. Most nodes have more points than fit into the
/// memory limit.
pub(crate) fn clumped_positions(count: usize, seed: u64) -> Vec<[i32; 3]> {
    let mut random = random(seed);
    let clumps = [(16, 700_000), (12, 30_000), (9, 31_500), (20, 0)];
    (0..count)
        .map(|_| {
            let (bits, corner) = clumps[(random() % 7).min(3) as usize];
            [0; 3].map(|_: i32| corner + (random() % (1 << bits)) as i32)
        })
        .collect()
}

#[test]
fn bytes_are_the_same_however_nodes_are_divided() {
    // Each clump has more than the 4096 points that are always assembled in memory, and all clumps
    // together exceed 2 MiB.
    let rows = rows(clumped_positions(35_000, 4), &layout());
    for dimension in [Dimension::Oct, Dimension::Quad] {
        for leaf_size in [20, 300, 3000] {
            let options = |memory: u64| PointBuildOptions { leaf_size, memory };
            let (expected, built) = bytes_of(&rows, dimension, &options(1 << 30)).unwrap();
            for (memory, threads) in [(1, 1), (1, 3), (2 << 20, 2)] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let (found, same) = pool.install(|| bytes_of(&rows, dimension, &options(memory))).unwrap();
                assert_eq!(same, built);
                let differs = found.iter().zip(&expected).position(|(found, expected)| found != expected);
                assert!(found == expected, "{dimension:?} {leaf_size} {memory} {threads}: {differs:?}");
            }
            let tree = PointTree::from_bytes(expected).unwrap();
            assert_eq!(tree.verify(&()).unwrap(), []);
            // Nodes are in postorder, and a node's blocks follow everything below it.
            let mut blocks: Vec<_> = (0..tree.counts().1).map(|block| tree.entry(block).block).collect();
            blocks.sort_by_key(|block| block.offset);
            let end = |key| {
                let code = Code::from_bits(dimension, key).unwrap();
                (code.last_bits(), std::cmp::Reverse(code.level()))
            };
            assert!(blocks.is_sorted_by_key(|block| end(block.key)));
        }
    }
}

#[test]
fn many_points_may_have_one_position() {
    let mut positions = vec![[7, 8, 9]; 1_000_000];
    positions.extend([[0; 3], [1 << 20; 3]]);
    let rows = rows(positions, &layout());
    let options = PointBuildOptions { leaf_size: 50_000, memory: 8 << 20 };
    let (bytes, built) = bytes_of(&rows, Dimension::Oct, &options).unwrap();
    assert_eq!(built, BuildSummary { points: 1_000_002, duplicates: 999_999 });
    // Only evenly spaced times and labels distinguish the points.
    assert!(bytes.len() < 800_000, "{}", bytes.len());
    let tree = PointTree::from_bytes(bytes).unwrap();
    let region = PointRegion::Ball([7.0, 8.0, 9.0], 0.5);
    assert_eq!(tree.count(&Selection { region, ..Selection::default() }, &()).unwrap(), 1_000_000);
    let counts =
        selected(&tree, &Selection::default()).into_iter().fold(HashMap::new(), |mut counts, row| {
            *counts.entry(row[12]).or_insert(0) += 1;
            counts
        });
    assert_eq!(counts[&0], 200_001);
}

#[test]
fn all_points_may_have_one_position() {
    for count in [1, 10, 11, 35] {
        let rows = rows(vec![[7, 8, 9]; count], &layout());
        let tree = tree_of(&rows, Dimension::Oct, 10);
        assert_eq!((tree.len(), tree.duplicates()), (count as u64, count as u64 - 1));
        assert_eq!(tree.verify(&()).unwrap(), []);
        assert_eq!(selected(&tree, &Selection::default()), sorted(&rows, |_| true));
    }
}

#[test]
fn points_outside_the_declared_bounds_are_an_error() {
    struct WrongBounds(PointRows, PointSchema);
    impl PointSource for WrongBounds {
        fn schema(&self) -> &PointSchema {
            &self.1
        }
        fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
            self.0.read(rows, most)
        }
    }
    let rows = PointRows::new(PointSchema::new(layout(), Dimension::Oct), rows([[0; 3], [9; 3]], &layout()))
        .unwrap();
    let schema = PointSchema { bounds: [[0; 3], [7; 3]], ..rows.schema().clone() };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("p.goblin");
    let output = Output::create(&path).unwrap();
    let error = build(
        &mut WrongBounds(rows, schema),
        &PointBuildOptions::default(),
        &Metadata::default(),
        output,
        &(),
    )
    .unwrap_err();
    assert!(error.to_string().contains("[7, 7, 7]"), "{error}");
    assert!(!path.exists());
}

#[test]
fn clocks_have_numbers_of_any_type() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("p.goblin");
    let mut random = random(29);
    for sample in SampleType::ALL {
        let attributes = [("label", SampleType::U8), ("gps_time", sample), ("value", SampleType::I16)];
        let attributes = attributes.map(|(name, sample)| PointAttribute::new(name, sample)).to_vec();
        let layout = RowLayout::packed(attributes);
        let mut rows = Vec::new();
        for number in 0..500u64 {
            let position = [number as i32, (number * number % 97) as i32, 7];
            rows.extend(position.into_iter().flat_map(i32::to_le_bytes));
            // Floats without NaN.
            rows.push((random() % 3) as u8);
            rows.extend(match sample {
                SampleType::F32 => (number as f32).to_le_bytes().to_vec(),
                SampleType::F64 => (number as f64).to_le_bytes().to_vec(),
                _ => (number / 2).to_le_bytes()[..sample.size()].to_vec(),
            });
            rows.extend((random() as i16).to_le_bytes());
        }
        let mut source = PointRows::new(PointSchema::new(layout, Dimension::Oct), rows.clone()).unwrap();
        let options = PointBuildOptions { leaf_size: 64, ..PointBuildOptions::default() };
        build(&mut source, &options, &Metadata::default(), Output::create(&path).unwrap(), &()).unwrap();
        let tree = PointTree::from_bytes(std::fs::read(&path).unwrap()).unwrap();
        assert!(tree.verify(&()).unwrap().is_empty(), "{sample:?}");
        let mut expected: Vec<Vec<u8>> = rows.chunks_exact(tree.layout().size).map(<[u8]>::to_vec).collect();
        expected.sort();
        assert!(selected(&tree, &Selection::default()) == expected, "{sample:?}");
    }
}

#[test]
fn corrupt_files_are_refused() {
    let rows = rows(scattered_positions(3000, 4), &layout());
    let (bytes, _) = bytes_of(
        &rows,
        Dimension::Oct,
        &PointBuildOptions { leaf_size: 200, ..PointBuildOptions::default() },
    )
    .unwrap();
    let mut random = random(9);
    for round in 0..400 {
        let mut corrupted = bytes.clone();
        match round % 3 {
            0 => corrupted.truncate(random() as usize % bytes.len()),
            _ => corrupted[random() as usize % bytes.len()] ^= 1 << (random() % 8),
        }
        let found = PointTree::from_bytes(corrupted).and_then(|tree| {
            let mut points = 0;
            tree.select(&Selection::default(), None, &(), &mut |found| {
                points += found.len();
                Ok(())
            })?;
            Ok(points)
        });
        assert!(found.is_err(), "{round}");
    }
}

#[test]
fn nearest_points_equal_those_of_a_full_scan() {
    for dimension in [Dimension::Oct, Dimension::Quad] {
        let rows = rows(scattered_positions(4000, 15), &layout());
        let tree = tree_of(&rows, dimension, 60);
        let mut random = random(6);
        let mut position = || [0; 3].map(|_: i32| (random() % (1 << 21)) as f64 / 1.5 - 2e5);
        let mut queries: Vec<[f64; 3]> = (0..100).map(|_| position()).collect();
        queries.push([-3.0; 3]);
        for (most, within) in [(1, f64::INFINITY), (5, 1e5), (900, f64::INFINITY), (3, 0.0), (0, 1.0)] {
            let found = tree.nearest(&queries, most, within, 1 << 16, &()).unwrap();
            for (from, found) in queries.iter().zip(found) {
                let mut expected: Vec<f64> = rows
                    .chunks_exact(layout().size)
                    .map(|row| {
                        let axes = 0..dimension.axes();
                        axes.map(|axis| (f64::from(position_of(row)[axis]) - from[axis]).powi(2))
                            .sum::<f64>()
                            .sqrt()
                    })
                    .filter(|distance| *distance <= within)
                    .collect();
                expected.sort_by(f64::total_cmp);
                expected.truncate(most);
                let distances: Vec<f64> = found.iter().map(|point| point.distance).collect();
                assert_eq!(distances, expected, "{dimension:?} {most} {within}");
            }
        }
        assert!(tree.nearest(&[[f64::NAN; 3]], 1, 1.0, 0, &()).is_err());
    }
    let none = tree_of(&[], Dimension::Oct, 60);
    assert_eq!(none.nearest(&[[0.0; 3]], 1, 1.0, 0, &()).unwrap(), vec![vec![]]);
}
