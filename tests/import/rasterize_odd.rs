//! Odd shapes: across the antimeridian and around a pole, with reversed orientation, duplicate
//! vertices, spikes and crossings, empty, of mixed kinds.

use std::fs;
use std::path::Path;

use spinney::import::feature::{RasterizeOptions, plan_features};
use spinney::query::EdgeRule;
use spinney::raw::import::rasterize::{FeatureGrid, Overlaps};
use spinney::raw::ops::WarpGrid;
use spinney::{Crs, Dataset, Frame, Number, Output};

use crate::common::Random;

/// Returns the cells of features on a grid that are not VOID, as column and row.
fn cells(directory: &Path, geometries: &[&str], crs: &str, grid: &WarpGrid, edge: EdgeRule) -> Vec<[u64; 2]> {
    let path = directory.join("odd.geojson");
    let feature =
        |geometry: &&str| format!(r#"{{"type":"Feature","properties":{{}},"geometry":{geometry}}}"#);
    let features: Vec<String> = geometries.iter().map(feature).collect();
    let crs = format!(r#"{{"type":"name","properties":{{"name":"{crs}"}}}}"#);
    fs::write(
        &path,
        format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{}]}}"#, features.join(",")),
    )
    .unwrap();
    let mut options = RasterizeOptions::new(FeatureGrid::Like(grid.clone()));
    options.edge = edge;
    let output = directory.join("odd.goblin");
    plan_features(&[path], &options, &()).unwrap().build(Output::create(&output).unwrap(), &()).unwrap();
    let tree: Dataset = spinney::open(&output).unwrap();
    assert!(tree.verify(64 << 20, &()).unwrap().is_empty());
    let mut found = Vec::new();
    for row in 0..grid.extent[1] {
        for column in 0..grid.extent[0] {
            let mut value = [Number::default(); 4];
            if tree.point([column, row, 0], tree.depth(), &mut value).unwrap() {
                found.push([column, row]);
            }
        }
    }
    found
}

fn metres() -> WarpGrid {
    let frame = Frame { crs: Some(Crs::epsg(32633)), ..Frame::planar([1.0, 0.0, 0.0, 0.0, -1.0, 16.0]) };
    WarpGrid { frame, extent: [16, 16, 1] }
}

fn in_metres(geometries: &[&str], edge: EdgeRule) -> Vec<[u64; 2]> {
    let directory = tempfile::tempdir().unwrap();
    cells(directory.path(), geometries, "urn:ogc:def:crs:EPSG::32633", &metres(), edge)
}

#[test]
fn rings_mean_the_same_whichever_way_they_turn_and_however_often_they_say_it() {
    let plain = r#"{"type":"Polygon","coordinates":[[[2,2],[12,2],[12,12],[2,12],[2,2]],[[5,5],[5,9],[9,9],[9,5],[5,5]]]}"#;
    let expected = in_metres(&[plain], EdgeRule::Centre);
    assert_eq!(expected.len(), 100 - 16);
    for (what, same) in [
        (
            "turned",
            r#"{"type":"Polygon","coordinates":[[[2,2],[2,12],[12,12],[12,2],[2,2]],[[5,5],[9,5],[9,9],[5,9],[5,5]]]}"#,
        ),
        (
            "a hole as the shell",
            r#"{"type":"Polygon","coordinates":[[[2,2],[12,2],[12,12],[2,12],[2,2]],[[5,5],[9,5],[9,9],[5,9],[5,5]]]}"#,
        ),
        (
            "not closed",
            r#"{"type":"Polygon","coordinates":[[[2,2],[12,2],[12,12],[2,12]],[[5,5],[5,9],[9,9],[9,5]]]}"#,
        ),
        (
            "corners twice",
            r#"{"type":"Polygon","coordinates":[[[2,2],[2,2],[12,2],[12,2],[12,2],[12,12],[2,12],[2,12],[2,2],[2,2]],[[5,5],[5,9],[5,9],[9,9],[9,5],[5,5]]]}"#,
        ),
        (
            "corners between",
            r#"{"type":"Polygon","coordinates":[[[2,2],[7,2],[12,2],[12,3.3],[12,12],[2,12],[2,2]],[[5,5],[5,9],[9,9],[9,5],[5,5]]]}"#,
        ),
        (
            "a spike outwards",
            r#"{"type":"Polygon","coordinates":[[[2,2],[12,2],[12,7.5],[15.9,7.5],[12,7.5],[12,12],[2,12],[2,2]],[[5,5],[5,9],[9,9],[9,5],[5,5]]]}"#,
        ),
        (
            "a spike inwards",
            r#"{"type":"Polygon","coordinates":[[[2,2],[12,2],[12,3.5],[3.2,3.5],[12,3.5],[12,12],[2,12],[2,2]],[[5,5],[5,9],[9,9],[9,5],[5,5]]]}"#,
        ),
        (
            "a ring without an area",
            r#"{"type":"Polygon","coordinates":[[[2,2],[12,2],[12,12],[2,12],[2,2]],[[5,5],[5,9],[9,9],[9,5],[5,5]],[[3,3],[4,4],[3,3]]]}"#,
        ),
        (
            "heights",
            r#"{"type":"Polygon","coordinates":[[[2,2,1],[12,2,1],[12,12,1],[2,12,1],[2,2,1]],[[5,5,9],[5,9,9],[9,9,9],[9,5,9],[5,5,9]]]}"#,
        ),
    ] {
        for edge in [EdgeRule::Centre, EdgeRule::Area] {
            assert_eq!(in_metres(&[same], edge), expected, "{what}, {edge}");
        }
    }
}

#[test]
fn self_crossing_rings_use_the_even_odd_rule() {
    // A bow tie, and a five-pointed star with winding number 2 in its centre.
    let bow = in_metres(
        &[r#"{"type":"Polygon","coordinates":[[[0,0],[16,16],[16,0],[0,16],[0,0]]]}"#],
        EdgeRule::Centre,
    );
    let inside = |[x, y]: [f64; 2]| (x - 8.0).abs() > (y - 8.0).abs();
    let all = (0..16u64).flat_map(|row| (0..16u64).map(move |column| [column, row]));
    let off_the_lines = |cell: &[u64; 2]| cell[0] != cell[1] && cell[0] + cell[1] != 15;
    let expected: Vec<[u64; 2]> =
        all.filter(|cell| inside(cell.map(|at| at as f64 + 0.5))).filter(off_the_lines).collect();
    let found: Vec<[u64; 2]> = bow.into_iter().filter(off_the_lines).collect();
    assert_eq!(found, expected);
    let corner = |number: usize| {
        let angle = (number * 2) as f64 / 5.0 * std::f64::consts::TAU;
        format!("[{},{}]", 8.0 + 7.9 * angle.sin(), 8.0 + 7.9 * angle.cos())
    };
    let ring: Vec<String> = (0..6).map(corner).collect();
    let star = in_metres(
        &[&format!(r#"{{"type":"Polygon","coordinates":[[{}]]}}"#, ring.join(","))],
        EdgeRule::Centre,
    );
    assert!(!star.contains(&[8, 8]) && !star.contains(&[7, 7]) && star.contains(&[8, 2]), "{star:?}");
}

#[test]
fn empty_geometries_count_for_nothing_and_mixed_ones_for_all_of_their_parts() {
    let empty = [
        "null",
        r#"{"type":"Polygon","coordinates":[]}"#,
        r#"{"type":"MultiPoint","coordinates":[]}"#,
        r#"{"type":"MultiPolygon","coordinates":[[]]}"#,
        r#"{"type":"GeometryCollection","geometries":[]}"#,
    ];
    let mixed = r#"{"type":"GeometryCollection","geometries":[{"type":"Point","coordinates":[0.5,15.5]},
        {"type":"LineString","coordinates":[[4.5,15.5],[7.5,15.5]]},{"type":"GeometryCollection","geometries":[
        {"type":"Polygon","coordinates":[[[10,0],[12,0],[12,2],[10,2],[10,0]]]}]}]}"#;
    let found = in_metres(&[&empty[..], &[mixed]].concat(), EdgeRule::Centre);
    let expected = [[0, 0], [4, 0], [5, 0], [6, 0], [7, 0], [10, 14], [11, 14], [10, 15], [11, 15]];
    assert_eq!(found, expected);
}

#[test]
fn the_world_has_no_edge_at_the_antimeridian_and_a_pole_is_a_place() {
    let directory = tempfile::tempdir().unwrap();
    let lonlat = "urn:ogc:def:crs:OGC:1.3:CRS84";
    // The whole world, in cells of 10 degrees.
    let world = |west: f64| WarpGrid {
        frame: Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([10.0, 0.0, west, 0.0, -10.0, 90.0]) },
        extent: [36, 18, 1],
    };
    // Beyond 180 degrees, and cut in two there as RFC 7946 requires: the same cells, also if the
    // tree's seam is at another meridian.
    let beyond = r#"{"type":"Polygon","coordinates":[[[160,0],[200,0],[200,20],[160,20],[160,0]]]}"#;
    let cut = r#"{"type":"MultiPolygon","coordinates":[[[[160,0],[180,0],[180,20],[160,20],[160,0]]],[[[-180,0],[-160,0],[-160,20],[-180,20],[-180,0]]]]}"#;
    for west in [-180.0, 0.0] {
        let found = cells(directory.path(), &[beyond], lonlat, &world(west), EdgeRule::Centre);
        assert_eq!(found, cells(directory.path(), &[cut], lonlat, &world(west), EdgeRule::Centre), "{west}");
        assert_eq!(found.len(), 8, "{found:?}");
        let columns: std::collections::BTreeSet<u64> = found.iter().map(|[column, _]| *column).collect();
        let expected: Vec<u64> = if west == 0.0 { vec![16, 17, 18, 19] } else { vec![0, 1, 34, 35] };
        assert_eq!(columns.into_iter().collect::<Vec<_>>(), expected);
    }
    // A polar cap on a polar grid: a circle around its centre.
    let polar = WarpGrid {
        frame: Frame {
            crs: Some(Crs::epsg(3031)),
            ..Frame::planar([500_000.0, 0.0, -4_000_000.0, 0.0, -500_000.0, 4_000_000.0])
        },
        extent: [16, 16, 1],
    };
    let cap = r#"{"type":"Polygon","coordinates":[[[-180,-90],[180,-90],[180,-75],[-180,-75],[-180,-90]]]}"#;
    let found = cells(directory.path(), &[cap], lonlat, &polar, EdgeRule::Centre);
    // The circle of 75 degrees south is 1,638,783 m from the pole there.
    let away = |at: u64| (at as f64 + 0.5) * 0.5 - 4.0;
    let all = (0..16u64).flat_map(|row| (0..16u64).map(move |column| [column, row]));
    let expected: Vec<[u64; 2]> =
        all.filter(|[column, row]| away(*column).hypot(away(*row)) < 1.638_783).collect();
    assert_eq!(found, expected);
}

/// Very many adjacent rings: quadrangles between randomly moved vertices, as features and as one
/// multipolygon, cover each cell once.
#[test]
fn rings_that_touch_have_neither_gaps_nor_cells_twice() {
    const SIDE: usize = 80;
    let mut random = Random(5);
    // Vertices along the border stay, so that all together form a square.
    let corners: Vec<[f64; 2]> = (0..=SIDE)
        .flat_map(|y| (0..=SIDE).map(move |x| [x, y]))
        .map(|at| {
            at.map(|at| match at {
                0 | SIDE => at as f64,
                at => at as f64 + random.below(1000) as f64 / 2500.0 - 0.2,
            })
        })
        .collect();
    let ring = |number: usize| {
        let first = number / SIDE * (SIDE + 1) + number % SIDE;
        let turn = [first, first + 1, first + SIDE + 2, first + SIDE + 1, first];
        format!("[{:?}]", turn.map(|corner| corners[corner]))
    };
    let rings: Vec<String> = (0..SIDE * SIDE).map(ring).collect();
    let polygon = |ring: &String| format!(r#"{{"type":"Polygon","coordinates":{ring}}}"#);
    let each: Vec<String> = rings.iter().map(polygon).collect();
    let whole = format!(r#"{{"type":"MultiPolygon","coordinates":[{}]}}"#, rings.join(","));
    let directory = tempfile::tempdir().unwrap();
    let (path, output) =
        (directory.path().join("touching.geojson"), directory.path().join("touching.goblin"));
    for (geometries, count) in [(each, SIDE * SIDE), (vec![whole], 1)] {
        let feature =
            |geometry: &String| format!(r#"{{"type":"Feature","properties":{{}},"geometry":{geometry}}}"#);
        let features: Vec<String> = geometries.iter().map(feature).collect();
        let crs = r#"{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::32633"}}"#;
        let text =
            format!(r#"{{"type":"FeatureCollection","crs":{crs},"features":[{}]}}"#, features.join(","));
        fs::write(&path, text).unwrap();
        for edge in [EdgeRule::Centre, EdgeRule::Area] {
            let mut options = RasterizeOptions::new(FeatureGrid::Cell(0.3125));
            options.edge = edge;
            if edge == EdgeRule::Centre {
                options.overlaps = Overlaps::Count;
            }
            let plan = plan_features(std::slice::from_ref(&path), &options, &()).unwrap();
            plan.build(Output::create(&output).unwrap(), &()).unwrap();
            let tree = spinney::open(&output).unwrap();
            let found = tree.statistics(None, &()).unwrap();
            assert_eq!(found.cells, 256 * 256, "{count} {edge}");
            let [least, most] = [found.channels[0].min, found.channels[0].max];
            assert_eq!([least, most], [Number::from(1u64); 2], "{count} {edge}");
        }
    }
}
