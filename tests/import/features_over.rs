//! Features over the cells of trees: fill, combine, search; compared with brute force per cell, and
//! with trees rasterized from the features.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use spinney::edit::{Edit, Note, edit};
use spinney::import::feature::{FeatureValue, RasterizeOptions, plan_features};
use spinney::query::{Condition, EdgeRule, Polygon};
use spinney::raw::dataset;
use spinney::raw::import::rasterize::{FeatureGrid, Overlaps};
use spinney::raw::ops::{MadeOperand, Prefer, TreeFile, ViewSource, WarpGrid, combine_with};
use spinney::{
    Bounds, CombineOperation, CombineOptions, Crs, DataKind, Dataset, Dimension, Frame, Header, Metadata,
    OpenOptions, Output, Rule, SampleType, SetOperation, TreeType, Value, ValueType, WriteOptions, combine,
};

use crate::common::{Cells, Random, cells_of, options, write_cells};

/// Extent in cells of one metre with north up; a feature's y is `EXTENT[1]` minus the row.
const EXTENT: [u64; 3] = [600, 420, 1];

fn frame() -> Frame {
    Frame { crs: Some(Crs::epsg(32633)), ..Frame::planar([1.0, 0.0, 0.0, 0.0, -1.0, EXTENT[1] as f64]) }
}

/// A feature's value and its rings.
type Star = (u64, Vec<Vec<[f64; 2]>>);

/// Overlapping stars, some with a hole, that extend beyond the tree: values and rings in metres.
fn stars(random: &mut Random, count: usize) -> Vec<Star> {
    let star = |random: &mut Random, middle: [f64; 2], radius: f64| -> Vec<[f64; 2]> {
        let corners = 3 + random.below(40);
        let corner = |number: u64| {
            let angle = number as f64 / corners as f64 * std::f64::consts::TAU;
            let away = radius * (0.4 + random.below(600) as f64 / 1000.0);
            // On a grid of cell fractions, and never on a cell centre.
            [middle[0] + away * angle.cos(), middle[1] + away * angle.sin()]
                .map(|at| (at * 1024.0).round() / 1024.0)
        };
        (0..corners).map(corner).collect()
    };
    let one = |random: &mut Random| {
        let middle = [random.below(640) as f64 - 20.0, random.below(460) as f64 - 20.0];
        let radius = 3.0 + random.below(120) as f64;
        let mut rings = vec![star(random, middle, radius)];
        if random.below(2) == 0 {
            rings.push(star(random, middle, radius * 0.3));
        }
        (random.below(200), rings)
    };
    (0..count).map(|_| one(random)).collect()
}

fn document(directory: &Path, stars: &[Star]) -> PathBuf {
    let path = directory.join("stars.geojson");
    let feature = |(number, (value, rings)): (usize, &Star)| {
        let closed: Vec<Vec<[f64; 2]>> = rings.iter().map(|ring| [&ring[..], &ring[..1]].concat()).collect();
        let geometry = format!(r#"{{"type":"Polygon","coordinates":{closed:?}}}"#);
        let properties = format!(r#"{{"v":{value},"odd":{}}}"#, number % 2);
        format!(r#"{{"type":"Feature","properties":{properties},"geometry":{geometry}}}"#)
    };
    let features: Vec<String> = stars.iter().enumerate().map(feature).collect();
    let crs = r#"{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::32633"}}"#;
    fs::write(
        &path,
        format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{}]}}"#, features.join(",")),
    )
    .unwrap();
    path
}

fn form() -> TreeType {
    TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1))
}

/// Writes a tree of classes in the format of its file name.
fn ground(path: &Path, seed: u64) -> Cells {
    let cells = Cells::random(form(), seed, EXTENT, 9, true);
    let mut metadata = Metadata { frame: frame(), ..Metadata::default() };
    metadata.class_names = [(3u64.into(), "wood".to_string()), (4u64.into(), "lake".to_string())].into();
    write_cells(path, &cells, &options(Rule::Majority, DataKind::Categorical, 10).metadata(metadata));
    cells
}

fn opened(path: &Path) -> Dataset {
    dataset::open(path, &OpenOptions::new()).unwrap()
}

fn cells_in(path: &Path) -> Cells {
    cells_of(&TreeFile::open(path, &OpenOptions::new()).unwrap(), EXTENT)
}

fn over(tree: &Dataset, change: impl FnOnce(&mut RasterizeOptions)) -> RasterizeOptions {
    let mut options = RasterizeOptions::over(tree.header(), tree.metadata(), None).unwrap();
    options.memory = 64 << 20;
    change(&mut options);
    options
}

fn overlay(file: &Path, options: &RasterizeOptions) -> Arc<ViewSource> {
    Arc::new(plan_features(&[file.into()], options, &()).unwrap().tree(&()).unwrap().tree)
}

/// Returns, for each cell, the values of the stars that contain its centre, in the stars' order.
fn at_centres(stars: &[Star]) -> Vec<Vec<u64>> {
    at_centres_of(stars, [EXTENT[0], EXTENT[1]])
}

/// Returns the same for the first columns and rows of the cells.
fn at_centres_of(stars: &[Star], [columns, rows]: [u64; 2]) -> Vec<Vec<u64>> {
    let mut found = vec![Vec::new(); (columns * rows) as usize];
    for (value, rings) in stars {
        let in_cells: Vec<Vec<[f64; 2]>> =
            rings.iter().map(|ring| ring.iter().map(|[x, y]| [*x, EXTENT[1] as f64 - y]).collect()).collect();
        let polygon = Polygon::new(&in_cells).unwrap();
        for row in 0..rows {
            for column in 0..columns {
                let cell = Bounds { min: [column, row, 0], max: [column + 1, row + 1, 1] };
                if polygon.cover_centres(&cell) == spinney::raw::space::Cover::Whole {
                    found[(row * columns + column) as usize].push(*value);
                }
            }
        }
    }
    found
}

fn byte(number: u64) -> Option<Value> {
    Some(Value::from([number as u8]))
}

#[test]
fn features_fill_the_cells_that_they_have_in_one_commit() {
    let directory = tempfile::tempdir().unwrap();
    let stars = stars(&mut Random(3), 14);
    let (file, path) = (document(directory.path(), &stars), directory.path().join("map.autumn"));
    let mut cells = ground(&path, 1);
    let all = at_centres(&stars);
    let mut commits = 1;
    for overlaps in
        [Overlaps::Last, Overlaps::First, Overlaps::Max, Overlaps::Min, Overlaps::Count, Overlaps::Sum]
    {
        let zones = overlay(
            &file,
            &over(&opened(&path), |options| {
                (options.value, options.overlaps) = (FeatureValue::Attribute("v".into()), overlaps);
            }),
        );
        let made = edit(&path, [Ok(Edit::Cover(zones))], Note::default(), 16 << 20, &()).unwrap();
        commits += 1;
        assert_eq!(made.unwrap().number, commits);
        for (cell, values) in cells.cells.iter_mut().zip(&all) {
            let value = match overlaps {
                Overlaps::Last => values.last().copied(),
                Overlaps::First => values.first().copied(),
                Overlaps::Max => values.iter().max().copied(),
                Overlaps::Min => values.iter().min().copied(),
                Overlaps::Count => Some(values.len() as u64).filter(|count| *count > 0),
                _ => (!values.is_empty()).then(|| values.iter().sum::<u64>().min(255)),
            };
            *cell = value.map_or(*cell, byte);
        }
        crate::common::assert_same(&cells_in(&path), &cells, &format!("{overlaps}"));
    }
    // Again: nothing changes, so there is no commit.
    let zones = || {
        overlay(
            &file,
            &over(&opened(&path), |options| {
                options.value = FeatureValue::Attribute("v".into());
                options.overlaps = Overlaps::Sum;
            }),
        )
    };
    assert!(edit(&path, [Ok(Edit::Cover(zones()))], Note::default(), 16 << 20, &()).unwrap().is_none());
    // VOID inside every second star.
    let odd: Vec<_> = stars.iter().skip(1).step_by(2).cloned().collect();
    let zones =
        overlay(&file, &over(&opened(&path), |options| options.features.filter = "odd=1".parse().unwrap()));
    let without = CombineOperation::set(SetOperation::Difference);
    edit(&path, [Ok(Edit::Merge(without, zones))], Note::default(), 16 << 20, &()).unwrap();
    for (cell, values) in cells.cells.iter_mut().zip(at_centres(&odd)) {
        *cell = cell.filter(|_| values.is_empty());
    }
    crate::common::assert_same(&cells_in(&path), &cells, "void");
    assert!(opened(&path).verify(64 << 20, &()).unwrap().is_empty());
}

#[test]
fn features_among_operands_are_what_trees_of_them_would_be() {
    let directory = tempfile::tempdir().unwrap();
    let file = document(directory.path(), &stars(&mut Random(5), 9));
    let [map, coarse, built, expected, found] =
        ["map.goblin", "coarse.goblin", "built.goblin", "expected.goblin", "found.goblin"]
            .map(|name| directory.path().join(name));
    ground(&map, 2);
    // A tree of cells four times as large, over a larger area.
    let wide = Cells::random(form(), 7, [200, 150, 1], 5, true);
    let metadata = Metadata {
        frame: Frame { crs: frame().crs, ..Frame::planar([4.0, 0.0, -80.0, 0.0, -4.0, 500.0]) },
        ..Metadata::default()
    };
    write_cells(&coarse, &wide, &options(Rule::Majority, DataKind::Categorical, 8).metadata(metadata));
    let both = [map.clone(), coarse.clone()];
    let edges = [EdgeRule::Centre, EdgeRule::Touch, EdgeRule::Area];
    let operations = [
        (&both[..1], 1, "union"),
        (&both[..1], 0, "union"),
        (&both[..1], 1, "and"),
        (&both[..1], 0, "and"),
        (&both[..1], 1, "a-b"),
        (&both[..1], 0, "a-b"),
        (&both[..1], 1, "xor"),
        (&both[..1], 1, "over"),
        (&both[..1], 0, "over"),
        (&both[..1], 1, "min"),
        (&both[..1], 1, "add"),
        (&both[..1], 0, "subtract"),
        (&both[..1], 1, "equal"),
        (&both[..1], 1, "changed"),
        (&both[..1], 1, "xnor"),
        (&both[..1], 1, "b|!a"),
        (&both[..], 1, "over"),
        (&both[..], 0, "union"),
        (&both[..], 2, "max"),
    ];
    for (number, (trees, place, operation)) in operations.into_iter().enumerate() {
        let edge = edges[number % 3];
        let operation = CombineOperation::named(operation, Prefer::First).unwrap();
        // On the grid of the combined trees, as the union of the trees has it.
        let union = directory.path().join("union.goblin");
        let create = |path: &Path| Output::create(path).unwrap();
        combine(
            CombineOperation::Over,
            CombineOptions::default(),
            trees,
            create(&union),
            WriteOptions::new(32 << 20),
            &(),
        )
        .unwrap();
        let like = opened(&union);
        let cells = WarpGrid { frame: like.metadata().frame.clone(), extent: like.header().extent };
        let mut options = RasterizeOptions::new(FeatureGrid::Like(cells));
        (options.edge, options.value) = (edge, FeatureValue::Attribute("v".into()));
        (options.rule, options.kind) = (Some(Rule::Majority), Some(DataKind::Categorical));
        options.sample = Some(like.header().form.value.sample);
        plan_features(std::slice::from_ref(&file), &options, &())
            .unwrap()
            .build(create(&built), &())
            .unwrap();
        let mut files = trees.to_vec();
        files.insert(place, built.clone());
        combine(
            operation,
            CombineOptions::default(),
            &files,
            create(&expected),
            WriteOptions::new(32 << 20),
            &(),
        )
        .unwrap();
        let make = |header: &Header, metadata: &Metadata| {
            let mut options = RasterizeOptions::over(header, metadata, None)?;
            (options.edge, options.value) = (edge, FeatureValue::Attribute("v".into()));
            Ok(plan_features(std::slice::from_ref(&file), &options, &())?.tree(&())?.tree)
        };
        let made = [MadeOperand { place, name: "stars".into(), make: &make }];
        let outcome = combine_with(
            operation,
            CombineOptions::default(),
            trees,
            &made,
            create(&found).into(),
            WriteOptions::new(32 << 20),
            &(),
        )
        .unwrap();
        let (expected, found) = (opened(&expected), opened(&found));
        assert_eq!(outcome.after, expected.statistics(None, &()).unwrap().cells);
        assert_eq!(found.header(), expected.header());
        let extent = found.header().extent;
        let cells = |tree: &Dataset| cells_of(&tree.as_file().unwrap(), extent);
        crate::common::assert_same(&cells(&found), &cells(&expected), &format!("{operation} {edge}"));
    }
}

#[test]
fn searches_stay_within_features() {
    let directory = tempfile::tempdir().unwrap();
    let stars = stars(&mut Random(8), 12);
    let file = document(directory.path(), &stars);
    let all = at_centres(&stars);
    for name in ["map.goblin", "map.autumn"] {
        let path = directory.path().join(name);
        let cells = ground(&path, 4);
        let tree = opened(&path);
        let zones = overlay(&file, &over(&tree, |_| {}));
        for bounds in [None, Some(Bounds { min: [100, 50, 0], max: [400, 300, 1] })] {
            let within = bounds.unwrap_or(Bounds::of_extent(EXTENT));
            let mut found = vec![false; all.len()];
            let wanted = u64::from(cells.cells.iter().flatten().next().unwrap().to_bytes()[0]);
            tree.find_within(Condition::Equal(wanted.into()), &zones, bounds, &(), &mut |block| {
                for row in block.bounds.min[1]..block.bounds.max[1] {
                    for column in block.bounds.min[0]..block.bounds.max[0] {
                        let at = (row * EXTENT[0] + column) as usize;
                        assert!(!found[at], "twice: {}", block.code);
                        found[at] = true;
                    }
                }
                Ok(true)
            })
            .unwrap();
            let mut count = 0;
            for (at, (cell, values)) in cells.cells.iter().zip(&all).enumerate() {
                let place = [at as u64 % EXTENT[0], at as u64 / EXTENT[0], 0];
                let is_in = (0..2).all(|axis| (within.min[axis]..within.max[axis]).contains(&place[axis]));
                let is_wanted = is_in && !values.is_empty() && *cell == byte(wanted);
                assert_eq!(found[at], is_wanted, "{name} {place:?}");
                count += u64::from(is_wanted);
            }
            assert!(count > 0);
        }
    }
}

#[test]
fn strings_are_classes_of_the_tree_and_misfits_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("map.autumn");
    ground(&path, 1);
    let tree = opened(&path);
    let file = directory.path().join("named.geojson");
    let square = r#"{"type":"Polygon","coordinates":[[[10,10],[20,10],[20,20],[10,20],[10,10]]]}"#;
    let crs = r#"{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::32633"}}"#;
    let with = |value: &str| {
        let feature = format!(r#"{{"type":"Feature","properties":{{"v":{value}}},"geometry":{square}}}"#);
        let text = format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{feature}]}}"#);
        fs::write(&file, text).unwrap();
        let options = over(&tree, |options| options.value = FeatureValue::Attribute("v".into()));
        plan_features(std::slice::from_ref(&file), &options, &())
    };
    let refused = |value: &str| with(value).err().unwrap().to_string();
    let said = refused(r#""moor""#);
    assert!(said.contains("`moor`") && said.contains("wood, lake"), "{said}");
    for value in ["256", "-1", "0.5"] {
        let said = refused(value);
        assert!(said.contains(value) && said.contains("u8"), "{said}");
    }
    let zones = with(r#""lake""#).unwrap().tree(&()).unwrap();
    assert_eq!((zones.features, zones.beyond), (1, 0));
    edit(&path, [Ok(Edit::Cover(Arc::new(zones.tree)))], Note::default(), 16 << 20, &()).unwrap();
    let cells = cells_in(&path);
    assert!((400..410).all(|row| (10..20).all(|x| cells.get([x, row, 0]) == byte(4))));
    // Numbers, too: one or one per channel, within the value range.
    for value in [FeatureValue::Number(300u64.into()), FeatureValue::Samples(vec![1u64.into(), 2u64.into()])]
    {
        let options = over(&tree, |options| options.value = value.clone());
        assert!(plan_features(std::slice::from_ref(&file), &options, &()).is_err(), "{value:?}");
    }
}

/// In an octree, each feature covers all layers, whatever the heights of the layers.
#[test]
fn features_are_columns_of_an_octree() {
    let directory = tempfile::tempdir().unwrap();
    let stars = stars(&mut Random(12), 60);
    let (file, path) = (document(directory.path(), &stars), directory.path().join("solid.autumn"));
    let extent = [120, 90, 40];
    let mut frame = frame();
    frame.matrix[2] = [0.0, 0.0, -2.0, 50.0];
    let form = TreeType::new(Dimension::Oct, ValueType::new(SampleType::U8, 1));
    let mut cells = Cells::random(form, 1, extent, 9, true);
    let metadata = Metadata { frame: frame.clone(), ..Metadata::default() };
    write_cells(&path, &cells, &options(Rule::Majority, DataKind::Categorical, 7).metadata(metadata.clone()));
    let all = at_centres_of(&stars, [120, 90]);
    let values_at = |at: usize| &all[at % (120 * 90)];
    let tree = opened(&path);
    let zones = overlay(&file, &over(&tree, |options| options.value = FeatureValue::Attribute("v".into())));
    let mut found = vec![false; cells.cells.len()];
    tree.find_within(Condition::Above(0u64.into()), &zones, None, &(), &mut |block| {
        let Bounds { min, max } = block.bounds;
        for (z, y, x) in (min[2]..max[2])
            .flat_map(|z| (min[1]..max[1]).flat_map(move |y| (min[0]..max[0]).map(move |x| (z, y, x))))
        {
            found[((z * extent[1] + y) * extent[0] + x) as usize] = true;
        }
        Ok(true)
    })
    .unwrap();
    assert!(found.contains(&true));
    for (at, cell) in cells.cells.iter().enumerate() {
        let is_wanted = !values_at(at).is_empty() && cell.is_some_and(|value| value.to_bytes()[0] > 0);
        assert_eq!(found[at], is_wanted, "cell {at}");
    }
    edit(&path, [Ok(Edit::Cover(zones))], Note::default(), 16 << 20, &()).unwrap();
    for (at, cell) in cells.cells.iter_mut().enumerate() {
        *cell = values_at(at).last().map_or(*cell, |value| byte(*value));
    }
    let after = cells_of(&TreeFile::open(&path, &OpenOptions::new()).unwrap(), extent);
    crate::common::assert_same(&after, &cells, "fill");
    assert!(opened(&path).verify(64 << 20, &()).unwrap().is_empty());
    // Polygons would not cover columns of cells that are not vertical, beyond rounding.
    frame.matrix[0][2] = 1e-16;
    let rounded = Metadata { frame: frame.clone(), ..metadata.clone() };
    assert!(RasterizeOptions::over(tree.header(), &rounded, None).is_ok());
    frame.matrix[0][2] = 0.5;
    let tilted = Metadata { frame, ..metadata };
    let error = RasterizeOptions::over(tree.header(), &tilted, None).err().unwrap().to_string();
    assert!(error.contains("not vertical"), "{error}");
}
