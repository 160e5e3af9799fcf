//! Lines with a width: cells whose centres are near enough, against the distance of each.

use std::fs;
use std::path::Path;

use spinney::import::feature::{RasterizeOptions, plan_features};
use spinney::query::EdgeRule;
use spinney::raw::import::rasterize::{FeatureGrid, LineWidth};
use spinney::raw::ops::WarpGrid;
use spinney::{Crs, Frame, Number, Output};

use crate::common::Random;

const ROWS: u64 = 300;
const COLUMNS: u64 = 330;
/// Metres per cell.
const CELL: f64 = 2.0;

type Line = Vec<[f64; 2]>;

fn written(path: &Path, lines: &[(Line, &str)]) {
    let feature = |(line, width): &(Line, &str)| {
        let geometry = format!(r#"{{"type":"LineString","coordinates":{line:?}}}"#);
        format!(r#"{{"type":"Feature","properties":{{"w":{width}}},"geometry":{geometry}}}"#)
    };
    let features: Vec<String> = lines.iter().map(feature).collect();
    let crs = r#"{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::32633"}}"#;
    let text = format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{}]}}"#, features.join(","));
    fs::write(path, text).unwrap();
}

fn options(width: LineWidth) -> RasterizeOptions {
    let frame = Frame::planar([CELL, 0.0, 0.0, 0.0, -CELL, ROWS as f64 * CELL]);
    let frame = Frame { crs: Some(Crs::epsg(32633)), ..frame };
    let mut options =
        RasterizeOptions::new(FeatureGrid::Like(WarpGrid { frame, extent: [COLUMNS, ROWS, 1] }));
    options.width = Some(width);
    options
}

/// Returns whether each cell, row by row, is covered by the lines.
fn cells(lines: &[(Line, &str)], width: LineWidth) -> Vec<bool> {
    let directory = tempfile::tempdir().unwrap();
    let (path, output) = (directory.path().join("lines.geojson"), directory.path().join("lines.goblin"));
    written(&path, lines);
    let plan = plan_features(&[path], &options(width), &()).unwrap();
    plan.build(Output::create(&output).unwrap(), &()).unwrap();
    let tree = spinney::open(&output).unwrap();
    let cell = |at: u64| {
        let mut value = [Number::default(); 4];
        tree.point([at % COLUMNS, at / COLUMNS, 0], tree.depth(), &mut value).unwrap()
    };
    (0..ROWS * COLUMNS).map(cell).collect()
}

/// Returns the distance of a point from a line.
fn distance(line: &Line, [x, y]: [f64; 2]) -> f64 {
    let of_edge = |ends: &[[f64; 2]]| {
        let ([ax, ay], [bx, by]) = (ends[0], ends[1]);
        let (dx, dy) = (bx - ax, by - ay);
        let length = dx * dx + dy * dy;
        let along =
            if length > 0.0 { (((x - ax) * dx + (y - ay) * dy) / length).clamp(0.0, 1.0) } else { 0.0 };
        (x - ax - along * dx).hypot(y - ay - along * dy)
    };
    line.windows(2).map(of_edge).fold(f64::INFINITY, f64::min)
}

fn centre(at: usize) -> [f64; 2] {
    let (column, row) = (at as u64 % COLUMNS, at as u64 / COLUMNS);
    [(column as f64 + 0.5) * CELL, (ROWS as f64 - row as f64 - 0.5) * CELL]
}

#[test]
fn lines_have_the_cells_whose_centres_are_within_half_of_their_width() {
    let mut random = Random(9);
    for width in [0.5, 3.0, 20.0, 90.0] {
        let lines: Vec<(Line, &str)> = (0..6)
            .map(|_| {
                // Some extend far beyond the tree, some have no length, some follow an axis.
                let mut at = [random.below(800) as f64 - 70.0, random.below(700) as f64 - 50.0];
                let mut line = vec![at];
                for _ in 0..1 + random.below(5) {
                    let step = [random.below(400) as f64 - 200.0, random.below(400) as f64 - 200.0];
                    let axis = random.below(4) as usize;
                    (0..2).filter(|other| *other != axis).for_each(|axis| at[axis] += step[axis]);
                    line.push(at);
                }
                (line, "null")
            })
            .collect();
        let mut count = 0;
        for (at, found) in cells(&lines, LineWidth::Number(width)).into_iter().enumerate() {
            let away = lines.iter().map(|(line, _)| distance(line, centre(at))).fold(f64::INFINITY, f64::min);
            // Vertices are snapped to cell fractions.
            if (away - width / 2.0).abs() > CELL / 32768.0 {
                assert_eq!(found, away < width / 2.0, "{width}: {away} at {:?}", centre(at));
                count += u64::from(found);
            }
        }
        assert!(count > 20 || width < 1.0, "{width}: {count}");
    }
}

#[test]
fn a_centre_that_is_exactly_so_far_is_one_of_them() {
    // Along a cell side: centres are 1, 3, 5 ... metres from it, and also from its ends.
    let line = vec![[100.0, 100.0], [200.0, 100.0]];
    for (width, rows) in [(2.0, 2), (5.999, 2), (6.0, 4), (6.001, 4)] {
        let found = cells(&[(line.clone(), "null")], LineWidth::Number(width));
        let middle = (0..ROWS).filter(|row| found[(row * COLUMNS + 75) as usize]).count();
        assert_eq!(middle, rows, "{width}");
    }
    // A slope of 3 : 4 with centres at exactly 5 metres: decided in integers.
    let mut exact = 0;
    let line = vec![[0.0, 1.0], [4.0 * 140.0, 1.0 + 3.0 * 140.0]];
    for (at, found) in cells(&[(line, "null")], LineWidth::Number(10.0)).into_iter().enumerate() {
        let [x, y] = [centre(at)[0] as i64, centre(at)[1] as i64 - 1];
        if (1..3500).contains(&(4 * x + 3 * y)) && (3 * x - 4 * y).abs() == 25 {
            assert!(found, "{x}, {y}");
            exact += 1;
        }
    }
    assert!(exact > 20, "{exact}");
}

#[test]
fn widths_are_attributes_too_and_what_makes_no_sense_is_refused() {
    let line = |y: f64| vec![[100.0, y], [200.0, y]];
    let by_name = || "w".parse::<LineWidth>().unwrap();
    let found = cells(&[(line(101.0), "10"), (line(201.0), "null"), (line(301.0), "0")], by_name());
    let rows = |y: f64| {
        let near = (0..ROWS).filter(|row| (centre((row * COLUMNS) as usize)[1] - y).abs() < 40.0);
        near.filter(|row| found[(row * COLUMNS + 75) as usize]).count()
    };
    assert_eq!((rows(101.0), rows(201.0), rows(301.0)), (5, 1, 1));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("lines.geojson");
    for width in ["-1", "\"wide\""] {
        written(&path, &[(line(101.0), "3"), (line(201.0), width)]);
        let plan = plan_features(std::slice::from_ref(&path), &options(by_name()), &()).unwrap();
        let output = Output::create(&directory.path().join("x.goblin")).unwrap();
        let said = plan.build(output, &()).unwrap_err().to_string();
        assert!(said.contains("feature 2") && said.contains("width"), "{said}");
    }
    let mut shares = options(LineWidth::Number(3.0));
    shares.edge = EdgeRule::Area;
    assert!(plan_features(std::slice::from_ref(&path), &shares, &()).is_err());
    let mut oblong = options(LineWidth::Number(3.0));
    let frame = Frame { crs: Some(Crs::epsg(32633)), ..Frame::planar([2.0, 0.0, 0.0, 0.0, -3.0, 900.0]) };
    oblong.grid = FeatureGrid::Like(WarpGrid { frame, extent: [COLUMNS, ROWS, 1] });
    written(&path, &[(line(101.0), "3")]);
    let plan = plan_features(&[path], &oblong, &()).unwrap();
    let output = Output::create(&directory.path().join("x.goblin")).unwrap();
    assert!(plan.build(output, &()).unwrap_err().to_string().contains("square"));
    for wrong in ["", "0", "-2", "inf"] {
        assert!(wrong.parse::<LineWidth>().is_err(), "{wrong}");
    }
}
