//! `spinney build` of images from known directions, and of outlines at heights.

use std::fs;
use std::path::Path;

use crate::common::command::{complaint, spinney, stderr, stdout};

/// A square of 2 x 2 pixels in the middle of 4 x 4.
const SQUARE: &str = "freeman-chain-code 1\ndirections 4\nsize 4 4\nregion 1 1 1\n33001122\nend\n";

fn view(from: &str, rest: &str) -> String {
    format!(
        r#"{{"image": "square.chain", "kind": "silhouette", "from": [{from}], "centre": [0,0,0], "pixel": 1{rest}}}"#
    )
}

#[test]
fn silhouettes_carve_solids() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [square, text, out] = ["square.chain", "cube.views", "cube.goblin"].map(at);
    fs::write(&square, SQUARE).unwrap();
    let write = |views: &[String]| {
        let views = views.join(",");
        fs::write(&text, format!(r#"{{"bounds": [-2,-2,-2,2,2,2], "unit": "cm", "views": [{views}]}}"#))
            .unwrap();
    };
    write(&[view("180, 0", ""), view("90, 0", ""), view("0, 90", "")]);
    let printed = stderr(spinney(&["build", &text, "-o", &out, "--cells", "16"]).success());
    assert!(
        printed.contains("3 silhouettes, 0 depth images") && printed.contains("0.25 cm wide"),
        "{printed}"
    );
    let printed = stdout(&["stats", &out, "--solid"]);
    assert!(printed.contains("8 cm3") && printed.contains("-1, -1, -1 to 1, 1, 1"), "{printed}");
    stdout(&["verify", &out]);
    // Another tree's cells.
    let again = at("again.goblin");
    stdout(&["build", &text, "-o", &again, "--grid", &out]);
    stdout(&["combine", "xor", &out, &again, "-o", &at("none.goblin")]);
    assert_eq!(spinney::open(at("none.goblin")).unwrap().statistics(None, &()).unwrap().cells, 0);

    // Images drawn by `render`: the background is transparent.
    let block = at("block.csg");
    fs::write(&block, "block(-1,-1,-1, 1,1,1);").unwrap();
    stdout(&["build", &block, "-o", &again, "--cells", "32"]);
    let mut views = Vec::new();
    for (number, from) in ["180,0", "90,0", "0,90"].iter().enumerate() {
        let image = at(&format!("{number}.png"));
        let drawn =
            ["render", &again, &image, "--from", from, "--orthographic", "--background", "transparent"];
        stdout(&[&drawn[..], &["--size", "100x100"]].concat());
        // The solid fills 92 of 100 pixels.
        views.push(format!(
            r#"{{"image": "{number}.png", "kind": "silhouette", "from": [{from}], "centre": [0,0,0], "pixel": {}}}"#,
            2.0 / 92.0
        ));
    }
    write(&views);
    stdout(&["build", &text, "-o", &out, "--cell", "0.25"]);
    let printed = stdout(&["stats", &out, "--solid"]);
    assert!(printed.contains("volume   8 cm3"), "{printed}");
}

#[test]
fn invalid_views_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [text, out] = ["cube.views", "cube.goblin"].map(at);
    fs::write(at("square.chain"), SQUARE).unwrap();
    fs::write(at("text.png"), "no image").unwrap();
    let good = view("0, 0", "");
    let none = good.replace("square.chain", "none.png");
    let not_an_image = good.replace("square.chain", "text.png");
    for (view, expected) in [
        (none.as_str(), "cube.views, view 2, `picture`: got "),
        (&not_an_image, "text.png"),
        (&view("0, 0", r#", "scale": 1"#), "cube.views, view 2, scale: got a number"),
        (&view("0, 100", ""), "cube.views, view 2, from: got [0, 100]"),
        (&good.replace(r#""pixel": 1"#, r#""pixel": 1e-320"#), "cube.views, view 2: got centre"),
        ("7", "cube.views, view 2: got invalid type"),
    ] {
        fs::write(&text, format!(r#"{{"bounds": [-2,-2,-2,2,2,2], "views": [{good}, {view}]}}"#)).unwrap();
        let message = complaint(&["build", &text, "-o", &out], 1);
        assert!(message.contains(expected), "{view}: {message}");
        assert!(!Path::new(&out).exists());
    }
    fs::write(&text, format!(r#"{{"bounds": [-2,-2,-2,2,2,2], "views": [{good}]}}"#)).unwrap();
    let cases: [(&[&str], &str); 9] = [
        (&["--shell"], "--shell"),
        (&["--edge", "area"], "centre"),
        (&["--attribute", "part"], "--attribute"),
        (&["--up", "y"], "--up"),
        (&["--brep"], "--brep"),
        (&["--leaf-size", "3"], "--leaf-size: works only with exact models"),
        (&["--kind", "categorical"], "--kind: works only with rasters and volumes"),
        (&["--heights", "z"], "--heights: works only with polygon features"),
        (&["--grid", "xyz"], "--grid xyz"),
    ];
    for (options, expected) in cases {
        let message = complaint(&[&["build", &text, "-o", &out], options].concat(), 1);
        assert!(message.contains(expected), "{options:?}: {message}");
    }
    let message = complaint(&["build", &text, &text, "-o", &out], 1);
    assert!(message.contains("got 2 inputs, expected one .views file"), "{message}");
}

#[test]
fn outlines_become_solids() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [text, out] = ["sections.csv", "body.goblin"].map(at);
    let square = |half: u32| {
        format!(
            "\"POLYGON ((-{half} -{half}, {half} -{half}, {half} {half}, -{half} {half}, -{half} -{half}))\""
        )
    };
    let (wide, narrow) = (square(4), square(2));
    fs::write(&text, format!("wkt,z,part\n{wide},0,a\n{wide},4,a\n{narrow},8,a\n{narrow},,a\n{wide},9,b\n"))
        .unwrap();
    let build = ["build", &text, "-o", &out, "--heights", "z"];
    let printed = stderr(
        spinney(&[&build[..], &["--cell", "1", "--where", "part=a", "--unit", "m"]].concat()).success(),
    );
    assert!(printed.contains("at 3 heights from 0 to 8, 12 sides; 1 features without"), "{printed}");
    let printed = stdout(&["stats", &out, "--solid"]);
    // Eight layers of cells with their centres inside: five of 8 x 8, two of 6 x 6 and one of 4 x
    // 4.
    assert!(printed.contains("volume   408 m3"), "{printed}");
    stdout(&["verify", &out]);

    let cases: [(&[&str], &str); 9] = [
        (&["--heights", "part"], "at 0 heights"),
        (&["--heights", "depth"], "depth"),
        (&["--heights", "z", "--tin", "z"], "cannot be used with"),
        (&["--heights", "z", "--value", "part"], "--value: has no effect"),
        (&["--heights", "z", "--index", "points"], "--index: has no effect"),
        (&["--heights", "z", "--edge", "touch"], "centre"),
        (&["--heights", "z", "--brep"], "--brep"),
        (&["--heights", "z", "--where", "z=4"], "at least two heights"),
        (&["--heights", "z", "--nodata", "0"], "--nodata: has no effect"),
    ];
    for (options, expected) in cases {
        let printed = stderr(spinney(&[&["build", &text, "-o", &out], options].concat()).failure());
        assert!(printed.contains(expected), "{options:?}: {printed}");
    }
    let points = at("points.csv");
    fs::write(&points, "x,y,z\n0,0,1\n1,1,2\n").unwrap();
    let printed = complaint(&["build", &points, "-o", &out, "--heights", "z"], 1);
    assert!(printed.contains("not a polygon"), "{printed}");
}
