//! `spinney build --tin` of boreholes in long form: a row for each borehole and layer.

use std::fmt::Write as _;
use std::fs;

use crate::common::command::{spinney, stderr, stdout};

const LONG: [&str; 4] = ["--layer-attribute", "layer", "--depth-attribute", "depth"];

/// Layers with their depths at a position.
fn depths(x: f64, y: f64) -> [(&'static str, f64); 3] {
    [("ground", 0.0), ("coal", 4.0 + x / 10.0), ("base", 20.0 + y / 5.0)]
}

/// Returns boreholes on a grid of 5 x 4, in wide and in long form.
fn boreholes() -> [String; 2] {
    let mut wide = String::from("x,y,ground,coal,base\n");
    let mut long = String::from("x,y,Z,layer,depth\n");
    for [column, row] in (0..20).map(|at| [at % 5, at / 5]) {
        let [x, y] = [column, row].map(|at| f64::from(at) * 10.0);
        let mouth = 100.0 + x / 2.0;
        let heights = depths(x, y).map(|(_, depth)| (mouth - depth).to_string());
        writeln!(wide, "{x},{y},{}", heights.join(",")).unwrap();
        for (layer, depth) in depths(x, y) {
            writeln!(long, "{x},{y},{mouth}, {layer} ,{depth}").unwrap();
        }
    }
    [wide, long]
}

#[test]
fn long_and_wide_form_make_the_same_models() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [wide, long, wkt, json] = ["wide.csv", "long.csv", "wkt.csv", "long.geojson"].map(at);
    let [of_wide, of_long] = ["wide.goblin", "long.goblin"].map(at);
    let [wide_text, long_text] = boreholes();
    fs::write(&wide, wide_text).unwrap();
    fs::write(&long, &long_text).unwrap();
    // The mouth's height may be the point's z.
    let (mut points, mut features) = (String::from("wkt,layer,depth\n"), Vec::new());
    for row in long_text.lines().skip(1) {
        let [x, y, z, layer, depth] = row.split(',').collect::<Vec<_>>()[..] else { panic!("{row}") };
        writeln!(points, "POINT Z ({x} {y} {z}),{layer},{depth}").unwrap();
        features.push(format!(
            r#"{{"type":"Feature","properties":{{"layer":"{layer}","depth":"{depth}"}},"geometry":{{"type":"Point","coordinates":[{x},{y},{z}]}}}}"#
        ));
    }
    fs::write(&wkt, points).unwrap();
    let text = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","));
    fs::write(&json, text).unwrap();

    let tin = ["--tin", "ground,coal,base", "--brep"];
    stdout(&[&["build", &wide, "-o", &of_wide][..], &tin].concat());
    let objects = stdout(&["stats", &of_wide, "--each"]);
    for input in [&long, &wkt, &json] {
        let more: &[&str] = if *input == json { &["--crs", "EPSG:25832"] } else { &[] };
        let arguments = [&["build", input, "-o", &of_long][..], &tin, &LONG, more].concat();
        let printed = stderr(spinney(&arguments).success());
        assert!(printed.contains("60 rows; heights are those of mouths"), "{printed}");
        let without_unit = |text: String| text.replace(" m^3", "").replace(" m^2", "");
        let own = without_unit(stdout(&["stats", &of_long, "--each"]));
        assert_eq!(own.lines().count(), objects.lines().count());
        assert_eq!(own.lines().nth(1), objects.lines().nth(1), "{input}");
        fs::remove_file(&of_long).unwrap();
    }

    let raster = at("raster.goblin");
    stdout(&[&["build", &long, "-o", &raster, "--tin", "coal", "--cell", "5"][..], &LONG].concat());
    // At a cell's centre, linear.
    assert_eq!(stdout(&["point", &raster, "12.5,12.5"]), format!("{}\n", 106.25 - 5.25));
}

#[test]
fn rows_that_are_not_used_are_counted() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [holes, raster] = ["holes.csv", "raster.goblin"].map(at);
    let build = |text: &str| {
        fs::write(&holes, text).unwrap();
        let _ = fs::remove_file(&raster);
        [&["build", &holes, "-o", &raster, "--tin", "coal", "--cell", "1"][..], &LONG].concat()
    };
    let corners = "0,0,9,coal,1\n8,0,9,coal,2\n0,8,9,coal,3\n8,8,9,coal,4\n";
    let text = format!(
        "x,y,z,layer,depth\n{corners}8,8,9,coal,4.0\n3,3,9,clay,2\n4,3,9,sand,3\n4,4,9,clay,3\n5,5,9,,3\n\
         2,2,9,coal,\n2,3,9,coal,none\n2,4,9,coal,nan\n,,9,coal,3\n3,4,,coal,3\n"
    );
    let arguments = build(&text);
    let printed = stderr(spinney(&arguments).success());
    for expected in [
        "14 rows; heights are those of mouths",
        "1 rows have the borehole, layer and depth of another one",
        "3 rows are of layers that --tin does not name, and left out: clay, sand ...",
        "1 rows have no name of a layer",
        "1 rows have no position",
        "1 rows have no height of the mouth",
        "coal: 4 points, 3 without a depth",
    ] {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
    // Without heights of mouths.
    let text = format!("x,y,layer,depth\n{}", corners.replace(",9,", ","));
    let arguments = build(&text);
    let printed = stderr(spinney(&arguments).success());
    assert!(printed.contains("mouths have no heights: heights are negative depths"), "{printed}");
    assert_eq!(stdout(&["point", &raster, "0.5,0.5"]), "-1.1875\n");

    for (text, expected) in [
        ("x,y,z,layer,depth\n0,0,9,coal,1\n0,0,9,coal,2\n", "`coal` with the heights 7 and 8 at 0, 0"),
        ("x,y,z,layer,depth\n0,0,9,coal,-1\n", "-1 of `coal` at 0, 0"),
        ("x,y,z,layer,depth\n0,0,9,clay,1\n", "`coal` without any"),
        ("x,y,z,layer\n0,0,9,coal\n", "depth, which no feature"),
        ("x,y,z,depth\n0,0,9,1\n", "layer, which no feature"),
        ("x,y,z,layer,depth\n0,0,9,coal,1\n1,1,9,coal,1\n2,2,9,coal,1\n", "not on one line"),
        ("wkt,layer,depth\n\"LINESTRING (0 0, 1 1)\",coal,1\n", "a feature that is not a point"),
        ("x,y,z,layer,depth\n", "`coal` without any"),
        ("x,y,z,layer,depth\n1e400,0,9,coal,1\n", "coordinate"),
        ("x,y,z,layer,depth\n0,0,9,coal\n", "`coal` without any"),
        ("x,y,z,layer,depth\n0,0,9,\"coal,1\n", "holes.csv"),
        ("x,y,z,layer,depth\n1e308,0,9,coal,1\n-1e308,0,9,coal,1\n0,1e308,9,coal,1\n", "2^201"),
        ("x,y,z,layer,depth\n0,0,1e308,coal,1e308\n0,1,-1e308,coal,1e308\n1,0,0,coal,1\n", "finite"),
    ] {
        let arguments = build(text);
        let printed = stderr(spinney(&arguments).failure());
        assert!(printed.contains(expected), "{text}: {printed}");
        assert!(!printed.contains("panicked"), "{printed}");
        assert!(fs::metadata(&raster).is_err());
    }
    let wide: String = (0..5000).map(|column| format!(",c{column}")).collect();
    let arguments = build(&format!("x,y,layer,depth{wide}\n"));
    assert!(stderr(spinney(&arguments).failure()).contains("columns"));
    let text = format!("x,y,z,layer,depth\n{}", "0,0,1,coal,1\n".repeat(20_000));
    let arguments = build(&text);
    assert!(stderr(spinney(&arguments).failure()).contains("at one position"));
    let one = ["build", &holes, "-o", &raster, "--tin", "coal", "--cell", "1", "--depth-attribute", "depth"];
    assert!(stderr(spinney(&one).failure()).contains("--layer-attribute"));
}
