//! Quadtrees rasterized from features: values, overlaps, edges, grids, and rejected inputs.

use std::fs;
use std::path::{Path, PathBuf};

use spinney::import::feature::{FeatureValue, RasterizeOptions, plan_features};
use spinney::query::EdgeRule;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::rasterize::{FeatureGrid, Overlaps};
use spinney::raw::ops::WarpGrid;
use spinney::{Crs, DataKind, Dataset, Frame, Number, Output, SampleType};

/// Returns a GeoJSON feature.
fn feature(properties: &str, geometry: &str) -> String {
    format!(r#"{{"type":"Feature","properties":{properties},"geometry":{geometry}}}"#)
}

fn polygon(rings: &str) -> String {
    format!(r#"{{"type":"Polygon","coordinates":{rings}}}"#)
}

/// Returns a square polygon ring, given two opposite corners.
fn square(x: f64, y: f64, end_x: f64, end_y: f64) -> String {
    polygon(&format!("[[[{x},{y}],[{end_x},{y}],[{end_x},{end_y}],[{x},{end_y}],[{x},{y}]]]"))
}

/// Writes a file of features in metres.
fn document(directory: &Path, features: &[String]) -> PathBuf {
    let path = directory.join("features.geojson");
    let crs = r#"{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::32633"}}"#;
    let features = features.join(",");
    fs::write(&path, format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{features}]}}"#))
        .unwrap();
    path
}

/// Options for ten by ten cells of a metre.
fn metres() -> RasterizeOptions {
    let frame = Frame { crs: Some(Crs::epsg(32633)), ..Frame::planar([1.0, 0.0, 0.0, 0.0, -1.0, 10.0]) };
    let mut options = RasterizeOptions::new(FeatureGrid::Like(WarpGrid { frame, extent: [10, 10, 1] }));
    options.value = FeatureValue::Attribute("v".into());
    options
}

/// Returns options with a change.
fn changed(mut options: RasterizeOptions, change: impl FnOnce(&mut RasterizeOptions)) -> RasterizeOptions {
    change(&mut options);
    options
}

fn built(path: &Path, options: &RasterizeOptions) -> Dataset {
    let output = path.with_extension("goblin");
    plan_features(&[path.into()], options, &())
        .unwrap()
        .build(Output::create(&output).unwrap(), &())
        .unwrap();
    let tree = spinney::open(&output).unwrap();
    assert!(tree.verify(64 << 20, &()).unwrap().is_empty());
    tree
}

/// Returns the value of each cell, row by row; `None` is VOID.
fn cells(tree: &Dataset) -> Vec<Vec<Option<f64>>> {
    let [width, height, _] = tree.header().extent;
    let cell = |x: u64, y: u64| {
        let mut value = [Number::default(); 4];
        tree.point([x, y, 0], tree.depth(), &mut value).unwrap().then(|| value[0].to_f64())
    };
    (0..height).map(|y| (0..width).map(|x| cell(x, y)).collect()).collect()
}

#[test]
fn overlaps_follow_the_requested_rule() {
    let directory = tempfile::tempdir().unwrap();
    let features = [
        feature(r#"{"v":5}"#, &square(0.0, 0.0, 6.0, 6.0)),
        feature(r#"{"v":-9}"#, &square(2.0, 2.0, 8.0, 8.0)),
        feature(r#"{"v":7}"#, &square(4.0, 4.0, 10.0, 10.0)),
    ];
    let path = document(directory.path(), &features);
    let squares = [(0, 6, 5.0), (2, 8, -9.0), (4, 10, 7.0)];
    for (overlaps, sample) in [
        (Overlaps::Last, SampleType::I32),
        (Overlaps::First, SampleType::I32),
        (Overlaps::Min, SampleType::I32),
        (Overlaps::Max, SampleType::I32),
        (Overlaps::Sum, SampleType::F64),
        (Overlaps::Count, SampleType::U32),
        (Overlaps::Mean, SampleType::F64),
    ] {
        let tree = built(
            &path,
            &changed(metres(), |options| {
                options.overlaps = overlaps;
            }),
        );
        assert_eq!(tree.header().form.value.sample, sample);
        for (row, cells) in cells(&tree).into_iter().enumerate() {
            for (x, found) in cells.into_iter().enumerate() {
                // Row 0 is the northernmost.
                let y = 9 - row;
                let here = squares
                    .iter()
                    .filter(|(low, high, _)| (*low..*high).contains(&x) && (*low..*high).contains(&y));
                let values: Vec<f64> = here.map(|(_, _, value)| *value).collect();
                let sum = || values.iter().sum::<f64>();
                let expected = match overlaps {
                    _ if values.is_empty() => None,
                    Overlaps::Last => values.last().copied(),
                    Overlaps::First => values.first().copied(),
                    Overlaps::Min => values.iter().copied().reduce(f64::min),
                    Overlaps::Max => values.iter().copied().reduce(f64::max),
                    Overlaps::Sum => Some(sum()),
                    Overlaps::Count => Some(values.len() as f64),
                    Overlaps::Mean => Some(sum() / values.len() as f64),
                };
                assert_eq!(found, expected, "{overlaps} at {x}, {y}");
            }
        }
    }
}

#[test]
fn strings_are_classes_and_omissions_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let features = [
        feature(r#"{"v":"wood"}"#, &square(0.0, 0.0, 4.0, 4.0)),
        feature(r#"{"v":"lake"}"#, &square(4.0, 4.0, 8.0, 8.0)),
        feature(r#"{"v":null}"#, &square(0.0, 0.0, 10.0, 10.0)),
        feature(r#"{"v":"wood"}"#, "null"),
    ];
    let path = document(directory.path(), &features);
    let plan = plan_features(std::slice::from_ref(&path), &metres(), &()).unwrap();
    let lines: Vec<&str> = plan
        .description()
        .iter()
        .filter(|(heading, _)| *heading == "left out")
        .map(|(_, text)| &text[..])
        .collect();
    assert_eq!(lines, ["1 features with no geometry", "1 features with no value"]);
    let tree = built(&path, &metres());
    let names: Vec<_> =
        tree.metadata().class_names.iter().map(|(class, name)| (class.to_f64(), &name[..])).collect();
    assert_eq!(names, [(1.0, "lake"), (2.0, "wood")]);
    // A class's colour does not depend on the other classes.
    let colours = &tree.metadata().palette.as_ref().unwrap().colours;
    assert_eq!(colours[..], [[0; 4], [0, 114, 178, 255], [230, 159, 0, 255]]);
    assert_eq!(tree.header().kind, DataKind::Categorical);
    let classes = tree.statistics(None, &()).unwrap().classes;
    assert_eq!(classes, [(1.into(), 16), (2.into(), 16)]);
    // The sample type does not depend on which numbers occur, except for those beyond 32 bits.
    // Numbers mixed with strings are rejected.
    for (values, sample) in [
        (["1", "255"], SampleType::I32),
        (["1", "2147483647"], SampleType::I32),
        (["-1", "2147483648"], SampleType::I64),
        (["true", "false"], SampleType::U8),
        (["0.5", "2"], SampleType::F64),
        (["0.1", "2"], SampleType::F64),
        (["1", "9007199254740993"], SampleType::I64),
        (["-1", "9007199254740993"], SampleType::I64),
    ] {
        let features =
            values.map(|value| feature(&format!(r#"{{"v":{value}}}"#), &square(0.0, 0.0, 4.0, 4.0)));
        let tree = built(&document(directory.path(), &features), &metres());
        assert_eq!(tree.header().form.value.sample, sample, "{values:?}");
        let expected: Number = match values[1] {
            "false" => 0u8.into(),
            text => text.parse().unwrap(),
        };
        let mut value = [Number::default(); 4];
        assert!(tree.point([1, 8, 0], tree.depth(), &mut value).unwrap());
        assert_eq!(value[0], expected);
    }
    let mixed =
        ["1", "\"a\""].map(|value| feature(&format!(r#"{{"v":{value}}}"#), &square(0.0, 0.0, 4.0, 4.0)));
    let refusal =
        plan_features(&[document(directory.path(), &mixed)], &metres(), &()).err().unwrap().to_string();
    assert!(refusal.contains("numbers and strings"), "{refusal}");
}

#[test]
fn edges_count_by_centre_touch_and_share() {
    let directory = tempfile::tempdir().unwrap();
    // Columns 2 to 5 completely, a quarter of column 1, three quarters of column 6.
    let features = [feature(r#"{"v":3}"#, &square(1.75, 0.0, 6.75, 10.0))];
    let path = document(directory.path(), &features);
    let row = |options: RasterizeOptions| cells(&built(&path, &options)).swap_remove(4);
    let of = |edge: EdgeRule| {
        row(changed(metres(), |options| {
            options.edge = edge;
        }))
    };
    let columns =
        |cells: Vec<Option<f64>>| -> Vec<usize> { (0..10).filter(|x| cells[*x].is_some()).collect() };
    assert_eq!(columns(of(EdgeRule::Centre)), [2, 3, 4, 5, 6]);
    assert_eq!(columns(of(EdgeRule::Touch)), [1, 2, 3, 4, 5, 6]);
    assert_eq!(columns(of(EdgeRule::Area)), [2, 3, 4, 5, 6]);
    let shares = row(changed(metres(), |options| {
        options.fractions = true;
        options.value = FeatureValue::default();
    }));
    let expected = [0.0, 0.25, 1.0, 1.0, 1.0, 1.0, 0.75, 0.0, 0.0, 0.0];
    assert!(shares.iter().zip(expected).all(|(share, expected)| *share == Some(expected)), "{shares:?}");
    // Three features in a cell: the two with equal values together cover more of it than the third,
    // and more than is uncovered.
    let features = [
        feature(r#"{"v":1}"#, &square(0.0, 0.0, 0.3, 1.0)),
        feature(r#"{"v":2}"#, &square(0.3, 0.0, 0.7, 1.0)),
        feature(r#"{"v":1}"#, &square(0.7, 0.0, 0.9, 1.0)),
        feature(r#"{"v":4}"#, &square(5.0, 5.0, 5.4, 6.0)),
    ];
    let path = document(directory.path(), &features);
    let found = cells(&built(
        &path,
        &changed(metres(), |options| {
            options.edge = EdgeRule::Area;
        }),
    ));
    assert_eq!((found[9][0], found[4][5]), (Some(1.0), None));
}

#[test]
fn features_that_overlap_share_a_cell_once() {
    let directory = tempfile::tempdir().unwrap();
    // Two that cover the same half, two that overlap in a quarter, two next to each other, and a
    // line over half a cell.
    let features = [
        feature(r#"{"v":1}"#, &square(0.0, 0.0, 0.5, 1.0)),
        feature(r#"{"v":2}"#, &square(0.0, 0.0, 0.5, 1.0)),
        feature(r#"{"v":1}"#, &square(2.0, 0.0, 2.5, 1.0)),
        feature(r#"{"v":1}"#, &square(2.25, 0.0, 2.75, 1.0)),
        feature(r#"{"v":1}"#, &square(4.0, 0.0, 4.5, 1.0)),
        feature(r#"{"v":1}"#, &square(4.5, 0.0, 5.0, 1.0)),
        feature(r#"{"v":1}"#, &square(6.0, 0.0, 6.4, 1.0)),
        feature(r#"{"v":2}"#, &square(6.0, 0.0, 6.4, 1.0)),
        feature(r#"{"v":3}"#, &square(6.1, 0.0, 6.3, 1.0)),
    ];
    let path = document(directory.path(), &features);
    let shares = cells(&built(
        &path,
        &changed(metres(), |options| {
            options.fractions = true;
            options.value = FeatureValue::default();
        }),
    ));
    for (column, expected) in [(0, 0.5), (2, 0.75), (4, 1.0), (6, 0.4)] {
        let share = shares.last().unwrap()[column].unwrap();
        assert!((share - expected).abs() < 1e-5, "{share} in column {column}, not {expected}");
    }
    // For values that overlap in less than half of a cell, the remainder is the largest share.
    let found = cells(&built(&path, &changed(metres(), |options| options.edge = EdgeRule::Area)));
    let row = found.last().unwrap();
    assert_eq!([0, 2, 4, 6].map(|column| row[column]), [Some(1.0), Some(1.0), Some(1.0), None]);
}

#[test]
fn lines_and_points_and_collections_become_cells() {
    let directory = tempfile::tempdir().unwrap();
    let point = r#"{"type":"MultiPoint","coordinates":[[0.5,0.5],[0.6,0.4],[9.5,9.5]]}"#;
    let line = r#"{"type":"LineString","coordinates":[[2.5,2.5],[5.5,2.5],[5.5,4.5]]}"#;
    let collection = format!(
        r#"{{"type":"GeometryCollection","geometries":[{},{{"type":"Point","coordinates":[0.5,9.5]}}]}}"#,
        square(7.0, 7.0, 8.0, 8.0)
    );
    let features =
        [feature(r#"{"v":1}"#, point), feature(r#"{"v":2}"#, line), feature(r#"{"v":3}"#, &collection)];
    let path = document(directory.path(), &features);
    let found = cells(&built(
        &path,
        &changed(metres(), |options| {
            options.overlaps = Overlaps::Count;
        }),
    ));
    let mut expected = vec![vec![None; 10]; 10];
    for (x, y, count) in [(0, 0, 2.0), (9, 9, 1.0), (7, 7, 1.0), (0, 9, 1.0)] {
        expected[9 - y][x] = Some(count);
    }
    for (x, y) in [(2, 2), (3, 2), (4, 2), (5, 2), (5, 3), (5, 4)] {
        expected[9 - y][x] = Some(1.0);
    }
    assert_eq!(found, expected);
}

#[test]
fn grids_are_by_width_count_and_tree() {
    let directory = tempfile::tempdir().unwrap();
    let path = document(directory.path(), &[feature(r#"{"v":1}"#, &square(503.0, 1001.0, 517.0, 1009.0))]);
    let of = |grid: FeatureGrid| {
        let mut options = RasterizeOptions::new(grid);
        options.value = FeatureValue::Number(Number::Unsigned(300));
        built(&path, &options)
    };
    let by_width = of(FeatureGrid::Cell(5.0));
    assert_eq!(by_width.metadata().frame.affine(), [5.0, 0.0, 500.0, 0.0, -5.0, 1010.0]);
    assert_eq!((by_width.header().extent, by_width.header().form.value.sample), ([4, 2, 1], SampleType::U16));
    assert_eq!(by_width.metadata().frame.crs, Some(Crs::epsg(32633)));
    let by_count = of(FeatureGrid::Cells(28));
    assert_eq!(by_count.metadata().frame.affine(), [0.5, 0.0, 503.0, 0.0, -0.5, 1009.0]);
    assert_eq!(by_count.statistics(None, &()).unwrap().channels[0].cells, 28 * 16);
    // On the cells of a tree in another coordinate system: those with centres in the square.
    let frame =
        Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([1e-6, 0.0, 10.515, 0.0, -1e-6, 0.0095]) };
    let grid = WarpGrid { frame: frame.clone(), extent: [1000, 1000, 1] };
    let tree = of(FeatureGrid::Like(grid));
    let locator = spinney::CellLocator::new(
        &spinney::Coordinates::System(Crs::epsg(4326)),
        &by_count.metadata().frame,
        [28, 16, 1],
    )
    .unwrap();
    let (mut differ, mut inside) = (0, 0);
    for (row, cells) in cells(&tree).into_iter().enumerate() {
        for (column, found) in cells.into_iter().enumerate() {
            let [lon, lat, _] = frame.to_world([column as f64 + 0.5, row as f64 + 0.5, 0.0]);
            let cell = locator.cell([lon, lat, 0.0]).unwrap();
            let expected = locator.is_inside([cell[0], cell[1], 0.5]);
            inside += usize::from(expected);
            differ += usize::from(expected != found.is_some());
        }
    }
    // The sides are curves there, approximated to a hundredth of a cell.
    assert!(inside > 5000 && differ < 20, "{differ} of {inside}");
}

#[test]
fn bytes_do_not_depend_on_memory_and_threads() {
    let directory = tempfile::tempdir().unwrap();
    let ring: Vec<String> = (0..5000)
        .map(|i| {
            let (angle, away) =
                (f64::from(i) / 5000.0 * std::f64::consts::TAU, 500.0 + f64::from(i * 7919 % 997) / 4.0);
            format!("[{},{}]", 1000.0 + away * angle.cos(), 1000.0 + away * angle.sin())
        })
        .collect();
    let polygon = polygon(&format!("[[{},{}]]", ring.join(","), ring[0]));
    let path = document(
        directory.path(),
        &[feature(r#"{"v":1}"#, &polygon), feature(r#"{"v":2}"#, &square(0.0, 900.0, 2000.0, 950.0))],
    );
    let mut options = RasterizeOptions::new(FeatureGrid::Cell(1.0));
    options.value = FeatureValue::Attribute("v".into());
    let bytes = |memory: u64, threads: usize| {
        let output = directory.path().join("o.goblin");
        let plan = plan_features(
            std::slice::from_ref(&path),
            &changed(options.clone(), |options| {
                options.memory = memory;
            }),
            &(),
        )
        .unwrap();
        let build = || plan.build(Output::create(&output).unwrap(), &());
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(build).unwrap();
        fs::read(&output).unwrap()
    };
    let first = bytes(256 << 20, 1);
    assert!(first == bytes(16 << 20, 2) && first == bytes(1 << 30, 3));
}

#[test]
fn contradictions_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = document(directory.path(), &[feature(r#"{"v":1}"#, &square(0.0, 0.0, 4.0, 4.0))]);
    let refused = |options: RasterizeOptions, about: &str| {
        let refusal = plan_features(std::slice::from_ref(&path), &options, &()).err().unwrap().to_string();
        assert!(refusal.contains(about), "{refusal}");
    };
    refused(
        changed(metres(), |options| {
            options.edge = EdgeRule::Area;
            options.overlaps = Overlaps::Sum;
        }),
        "overlaps",
    );
    refused(
        changed(metres(), |options| {
            options.fractions = true;
        }),
        "fractions",
    );
    refused(
        changed(metres(), |options| {
            options.value = FeatureValue::Attribute("w".into());
        }),
        "w, which no feature has",
    );
    refused(
        changed(metres(), |options| {
            options.grid = FeatureGrid::Cell(0.0);
        }),
        "above zero",
    );
    refused(
        changed(metres(), |options| {
            options.grid = FeatureGrid::Cell(1e-9);
        }),
        "2^29",
    );
    refused(
        changed(metres(), |options| {
            options.grid = FeatureGrid::Cells(0);
        }),
        "1 to",
    );
    refused(
        changed(metres(), |options| {
            options.memory = 100;
        }),
        "allow more",
    );
    let none = document(directory.path(), &[feature(r#"{"v":1}"#, "null")]);
    assert!(
        plan_features(&[none], &metres(), &())
            .err()
            .unwrap()
            .to_string()
            .contains("no feature with a geometry")
    );
    let far = document(directory.path(), &[feature(r#"{"v":1}"#, &square(0.0, 0.0, 1e15, 4.0))]);
    let output = Output::create(&directory.path().join("far.goblin")).unwrap();
    let refusal = plan_features(&[far], &metres(), &()).unwrap().build(output, &()).unwrap_err().to_string();
    assert!(refusal.contains("feature 1") && refusal.contains("cells from"), "{refusal}");
    assert!(!directory.path().join("far.goblin").exists());
    fs::write(directory.path().join("city.json"), r#"{"type":"CityJSON","version":"2.0"}"#).unwrap();
    fs::write(directory.path().join("zones.json"), r#"{"type": "FeatureCollection", "features": []}"#)
        .unwrap();
    let is = |name: &str| is_feature_file(&directory.path().join(name));
    assert!(is("zones.json") && is("a.gpkg:roads") && is("b.SHP") && !is("city.json") && !is("c.tif"));
}
