//! Styles and legends with the program; reliefs as `gdaldem` computes them.

use std::path::Path;
use std::process::Command;

use spinney::raw::import::raster::{self, Pixels};
use spinney::raw::style::{Ground, SampleBlock, StylePainter};
use spinney::style::Style;
use spinney::{Bounds, DataKind, Dataset, Region, Rule, SampleType, Value};

use crate::common::command::{command, complaint, stdout};
use crate::common::{Cells, dataset, goblin_bytes, made, oct, quad, shared_data, value_types};

/// Returns the samples of an image.
fn samples(path: &Path) -> Vec<u8> {
    let mut raster = raster::open(path, &Default::default()).unwrap();
    let mut pixels = Pixels::default();
    let (width, height) = (raster.info().width, raster.info().height);
    raster.read(Region::new(0, 0, width, height), &mut pixels).unwrap();
    pixels.bytes
}

/// Paints a window of a tree with the library, with its existing neighbours.
fn painted(tree: &Dataset, painter: &StylePainter, part: Bounds) -> Vec<[u8; 4]> {
    let margin = painter.margin();
    let extent = tree.header().extent;
    let (width, height) = (part.size()[0] as usize, part.size()[1] as usize);
    let size = tree.header().form.width();
    let (mut bytes, mut valid) = (Vec::new(), Vec::new());
    for y in part.min[1] as i64 - margin as i64..(part.max[1] + margin) as i64 {
        for x in part.min[0] as i64 - margin as i64..(part.max[0] + margin) as i64 {
            let (mut cell, mut flag) = (vec![0; size], [false]);
            if x >= 0 && y >= 0 && (x as u64) < extent[0] && (y as u64) < extent[1] {
                let (x, y) = (x as u64, y as u64);
                let one = Bounds { min: [x, y, part.min[2]], max: [x + 1, y + 1, part.min[2] + 1] };
                tree.window(tree.depth(), &one, 0.0, &mut cell, Some(&mut flag)).unwrap();
            }
            bytes.extend(cell);
            valid.extend(flag);
        }
    }
    let block = SampleBlock {
        width,
        height,
        margin: margin as usize,
        bytes: &bytes,
        valid: &valid,
        ground: &[Ground::PIXEL],
    };
    let mut rgba = vec![0; 4 * width * height];
    painter.paint(&block, &mut rgba).unwrap();
    if let Some(palette) = painter.palette() {
        let mut indices = vec![0; width * height];
        painter.paint_indices(&block, &mut indices).unwrap();
        let colours: Vec<[u8; 4]> = indices.iter().map(|index| palette[usize::from(*index)]).collect();
        assert_eq!(colours, rgba.as_chunks::<4>().0);
    }
    rgba.as_chunks::<4>().0.to_vec()
}

/// Light, slopes and aspects are those of the ground, whatever the order and direction of a file's
/// rows and columns.
#[test]
fn hillshade_and_aspect_use_north() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let north_up = name("north_up.goblin");
    command(&["-q", "build", "fixtures/island_elevation.tif", "-o", &north_up]).assert().success();
    let pixels = |tree: &str, style: &str| {
        let out = name("out.tif");
        command(&["-q", "get", tree, "-o", &out, "--style", style]).assert().success();
        samples(out.as_ref())
    };
    let [width, height, _] =
        spinney::open(Path::new(&north_up)).unwrap().header().extent.map(|side| side as usize);
    // The index of a pixel after each of the operations.
    type Index = fn([usize; 2], [usize; 2]) -> usize;
    let moved: [(&str, Index); 4] = [
        ("rotate=180", |[x, y], [w, h]| (h - 1 - y) * w + w - 1 - x),
        ("mirror=y", |[x, y], [w, h]| (h - 1 - y) * w + x),
        ("mirror=x", |[x, y], [w, _]| y * w + w - 1 - x),
        ("transpose", |[x, y], [_, h]| x * h + y),
    ];
    for style in ["hillshade", "aspect", "slope"] {
        let expected = pixels(&north_up, style);
        let channels = expected.len() / (width * height);
        for (step, index_of) in moved {
            let turned = name("turned.goblin");
            command(&["-q", "transform", &north_up, "-o", &turned, step]).assert().success();
            let found = pixels(&turned, style);
            assert_eq!(found.len(), expected.len());
            let differing = expected.chunks(channels).enumerate().filter(|(index, pixel)| {
                let there = index_of([index % width, index / width], [width, height]);
                let found = &found[there * channels..][..channels];
                // Sums in another order are rounded differently.
                found.iter().zip(*pixel).any(|(one, other)| one.abs_diff(*other) > 1)
            });
            assert_eq!(differing.count(), 0, "{style}, {step}");
        }
    }
}

const LAYERS: &str = r##"{"title": "Hills", "nodata": "#11223344", "layers": [
    {"draw": "ramp", "ramp": [["min", "#004400"], ["50%", "#ffff00"], ["max", "#ffffff80"]]},
    {"draw": "hillshade", "blend": "multiply", "opacity": 0.7},
    {"draw": "contours", "interval": 7, "hide": [[0, 20]]}]}"##;

#[test]
fn every_tree_is_painted_in_every_style() {
    let styles: Vec<Style> = Style::names()
        .into_iter()
        .chain([LAYERS, r#"{"draw": "rgb", "bands": [1, 1, 1]}"#])
        .map(|style| Style::parse(style).unwrap())
        .collect();
    for value in value_types() {
        for (form, depth) in [(quad(value.sample, value.channels), 1), (oct(value.sample, value.channels), 3)]
        {
            for (rule, kind) in [
                (Rule::Mean, DataKind::Continuous),
                (Rule::Majority, DataKind::Categorical),
                (Rule::Occupancy, DataKind::Continuous),
            ] {
                let tree = dataset(&Cells::random(form, 5, [13, 11, depth], 100, true), rule, kind);
                for style in &styles {
                    let painter = match StylePainter::new(style, &tree, &()) {
                        Ok(painter) => painter,
                        Err(error) => {
                            // Colours need three channels.
                            assert!(error.to_string().contains("the tree's channels 1 to"), "{error}");
                            assert!(style.json().contains("rgb") && value.channels < 3);
                            continue;
                        }
                    };
                    // Whole, and in windows of any size.
                    let whole = painted(&tree, &painter, Bounds { min: [0; 3], max: [13, 11, 1] });
                    for (x, y, width, height) in [(0, 0, 5, 4), (5, 0, 8, 11), (3, 7, 1, 4), (12, 10, 1, 1)] {
                        let part = Bounds { min: [x, y, 0], max: [x + width, y + height, 1] };
                        for (index, colour) in painted(&tree, &painter, part).into_iter().enumerate() {
                            let (column, row) = (x + index as u64 % width, y + index as u64 / width);
                            assert_eq!(
                                colour,
                                whole[(row * 13 + column) as usize],
                                "{form:?} {}",
                                style.json()
                            );
                        }
                    }
                    painter.legend(&tree).unwrap();
                }
                let default = StylePainter::new(&Style::default_for(&tree), &tree, &()).unwrap();
                assert_eq!(default.margin(), 0);
            }
        }
    }
}

#[test]
fn windows_and_bands_of_an_image_match_the_whole() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    // So wide that memory only suffices for a few rows at a time.
    let cells = made(quad(SampleType::F32, 1), [3000, 70, 1], |[x, y, _]| {
        let height = 300.0 * (x as f32 / 9.0).sin() * (y as f32 / 7.0).cos() + (x * 7 % 13) as f32;
        (x % 61 > 3).then_some(Value::from(height.to_le_bytes()))
    });
    let tree = name("t.goblin");
    std::fs::write(&tree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    let get = |options: &[&str]| {
        let out = name("x.tif");
        command(&["-q", "get", tree.to_str().unwrap(), out.to_str().unwrap()])
            .args(options)
            .assert()
            .success();
        samples(&out)
    };
    for style in [LAYERS, "slope", "multidirectional", "contours"] {
        let whole = get(&["--style", style]);
        let bytes = whole.len() / (3000 * 70);
        let part = get(&["--style", style, "--window", "1000,20,300,30"]);
        for row in 0..30 {
            let start = ((20 + row) * 3000 + 1000) * bytes;
            assert!(
                part[row * 300 * bytes..][..300 * bytes] == whole[start..][..300 * bytes],
                "{style} {row}"
            );
        }
        // Pixels of another size, whose neighbours are pixels.
        let coarse = get(&["--style", style, "--size", "300x7"]);
        let part = get(&["--style", style, "--size", "100x3", "--window", "1000,20,1000,30"]);
        for row in 0..3 {
            let start = ((2 + row) * 300 + 100) * bytes;
            assert!(
                part[row * 100 * bytes..][..100 * bytes] == coarse[start..][..100 * bytes],
                "{style} {row}"
            );
        }
    }
}

#[test]
fn malicious_styles_are_rejected_with_the_position() {
    let long = format!("{{\"draw\": \"{}\"}}", "x".repeat(2 << 20));
    let layers = format!("{{\"layers\": [{}]}}", vec!["{\"draw\": \"slope\"}"; 17].join(","));
    let stops = format!("{{\"draw\": \"ramp\", \"ramp\": [{}]}}", vec!["\"#fff\""; 1025].join(","));
    let deep = format!("{}{}", "{\"layers\": [".repeat(500), "]}".repeat(500));
    for (text, said) in [
        ("", "a JSON document, or one of"),
        ("{", "EOF"),
        ("{}", "style: draw"),
        (r#"{"draw": 3}"#, "got 3, expected default, palette"),
        (r#"{"draw": "ramp", "rampe": 1}"#, "got `rampe`, expected one of"),
        (r#"{"draw": "ramp", "ramp": "rainbow"}"#, "viridis"),
        (r##"{"draw": "ramp", "ramp": ["#fff"]}"##, "at least two"),
        (r##"{"draw": "ramp", "ramp": [[1, "#fff"], [0, "#000"]]}"##, "ascending"),
        (r##"{"draw": "ramp", "ramp": [[1, "#fff"], [2, "black"]]}"##, "style: ramp[1]: got \"black\""),
        (r##"{"draw": "ramp", "ramp": [[1, "#fff"], [2, "#000"]], "domain": [0, 1]}"##, "style: domain"),
        (r#"{"draw": "ramp", "domain": ["101%", 5]}"#, "percentile"),
        (r#"{"draw": "ramp", "domain": [1e999, 5]}"#, "number out of range"),
        (r#"{"draw": "ramp", "domain": [1]}"#, "two numbers"),
        (r#"{"draw": "slope", "domain": ["1%", "2%"]}"#, "a number"),
        (r#"{"draw": "ramp", "band": 0}"#, "1 to 4"),
        (r#"{"draw": "ramp", "opacity": 1.5}"#, "0 to 1"),
        (r#"{"draw": "ramp", "show": [[5, 1]]}"#, "style: show[0]"),
        (r#"{"draw": "rgb", "bands": [1, 2]}"#, "style: bands"),
        (r#"{"draw": "hillshade", "altitude": -1}"#, "0 to 90"),
        (r#"{"draw": "hillshade", "light": "multidirectional", "azimuth": 3}"#, "`azimuth`"),
        (r#"{"draw": "hillshade", "z": 0}"#, "style: z"),
        (r#"{"draw": "contours", "interval": 0}"#, "style: interval"),
        (r#"{"draw": "contours", "interval": -5}"#, "style: interval"),
        (r#"{"draw": "palette", "classes": []}"#, "at least one"),
        (r#"{"draw": "palette", "classes": [{"value": 1}]}"#, "style: classes[0].color"),
        (
            r##"{"draw": "palette", "classes": [{"value": 0, "color": "#fff"}, {"value": -0.0, "color": "#fff"}]}"##,
            "0 twice",
        ),
        (r#"{"layers": []}"#, "at least one layer"),
        (r#"{"layers": [{"draw": "slope"}, 7]}"#, "style: layers[1]: got 7"),
        (r#"{"layers": [{"draw": "slope"}], "draw": "slope"}"#, "`draw`"),
        (&layers, "17 entries, expected at most 16"),
        (&stops, "1025 entries"),
        (&deep, "recursion"),
        (&long, "1 MiB"),
    ] {
        let error = Style::parse(text).unwrap_err().to_string();
        assert!(error.contains(said) && error.len() < 600, "{}: {error}", &text[..text.len().min(80)]);
    }
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("bad.json");
    std::fs::write(&file, r#"{"draw": "hillshade", "sun": 1}"#).unwrap();
    let out = directory.path().join("x.png");
    let get =
        ["get", "fixtures/v1/elevation.goblin", out.to_str().unwrap(), "--style", file.to_str().unwrap()];
    let said = complaint(&get, 2);
    assert!(said.contains("bad.json: style: got `sun`"), "{said}");
    let said = complaint(&["get", "fixtures/v1/classes.goblin", out.to_str().unwrap(), "--style", "rgb"], 1);
    assert!(said.contains("got channel 2, expected the tree's channels 1 to 1"), "{said}");
}

#[test]
fn legends_are_written_in_three_forms() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    let classes = "fixtures/v1/classes.goblin";
    let text = stdout(&["-q", "legend", classes, "-", "--format", "json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let listed = json["sections"][0]["classes"].as_array().unwrap();
    assert!(listed.iter().any(|class| class["name"] == "forest"), "{text}");
    let style = r##"{"title": "A < B", "draw": "ramp", "ramp": [[0, "#000"], [100, "#fff"]]}"##;
    let svg = stdout(&["-q", "legend", classes, "-", "--format", "svg", "--style", style]);
    assert!(svg.starts_with("<svg") && svg.contains("A &lt; B") && svg.contains(">20</text>"), "{svg}");
    let mut sizes = Vec::new();
    for scale in ["1", "3"] {
        let out = name("legend.png");
        command(&["legend", classes, out.to_str().unwrap(), "--scale", scale]).assert().success();
        let raster = raster::open(&out, &Default::default()).unwrap();
        sizes.push(raster.info().width);
        // White, black letters, and colours.
        assert!(samples(&out).chunks(4).any(|pixel| pixel == [0, 0, 0, 255]));
    }
    assert_eq!(sizes[1], 3 * sizes[0]);
    assert!(complaint(&["legend", classes, "x.gif"], 1).contains(".png, .svg or .json"));
}

/// Returns whether `gdaldem` is installed.
fn has_gdaldem() -> bool {
    let is_there = Command::new("gdaldem").arg("--version").output().is_ok();
    if !is_there {
        eprintln!("skipped: there is no gdaldem");
    }
    is_there
}

#[test]
fn reliefs_are_those_of_gdaldem() {
    let Some(data) = shared_data().filter(|_| has_gdaldem()) else { return };
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    let dem = data.join("raster/srtm3/N46E008.tif");
    let tree = name("t.goblin");
    command(&["-q", "build", dem.to_str().unwrap(), "-o", tree.to_str().unwrap()]).assert().success();
    let tree = spinney::open(&tree).unwrap();
    let [width, height, _] = tree.header().extent.map(|side| side as usize);
    let (mut bytes, mut valid) = (vec![0; 2 * width * height], vec![true; width * height]);
    let all = tree.header().extent_bounds();
    tree.window(tree.depth(), &all, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    // The raster with a border of VOID cells.
    let columns = width + 2;
    let (mut framed, mut flags) = (vec![0; 2 * columns * (height + 2)], vec![false; columns * (height + 2)]);
    for row in 0..height {
        let start = (row + 1) * columns + 1;
        framed[2 * start..][..2 * width].copy_from_slice(&bytes[2 * row * width..][..2 * width]);
        flags[start..][..width].copy_from_slice(&valid[row * width..][..width]);
    }
    // As in gdaldem: a constant number of metres per degree along both axes.
    let metres = 0.000_833_333_333_333_333_4 * 111_120.0;
    let block = SampleBlock {
        width,
        height,
        margin: 1,
        bytes: &framed,
        valid: &flags,
        ground: &[[[metres, 0.0], [0.0, -metres]]],
    };
    let paint = |style: &str| {
        let painter = StylePainter::new(&Style::parse(style).unwrap(), &tree, &()).unwrap();
        let mut rgba = vec![0; 4 * width * height];
        painter.paint(&block, &mut rgba).unwrap();
        rgba
    };
    let gdaldem = |mode: &str, options: &[&str]| {
        let out = name("gdal.tif");
        let mut run = Command::new("gdaldem");
        run.arg(mode).arg(&dem);
        for option in options.iter().filter(|option| option.ends_with(".txt")) {
            run.arg(option);
        }
        run.arg(&out).arg("-q");
        for option in options.iter().filter(|option| !option.ends_with(".txt")) {
            run.arg(option);
        }
        assert!(run.output().unwrap().status.success(), "{mode} {options:?}");
        samples(&out)
    };
    // A cell with all its neighbours, or at an edge of the raster (where both extrapolate), but not
    // at a corner.
    let is_sure = |index: usize| {
        let (x, y) = (index % width, index / width);
        let edges = usize::from(x == 0 || x + 1 == width) + usize::from(y == 0 || y + 1 == height);
        let around = |x: usize, y: usize| {
            let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
            let mut rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
            rows.all(|row| columns.clone().all(|column| valid[row * width + column]))
        };
        edges < 2 && around(x, y)
    };
    let cells: Vec<usize> = (0..width * height).filter(|index| is_sure(*index)).collect();
    assert!(cells.len() > 1_000_000);
    let common = ["-s", "111120", "-compute_edges"];
    for (style, mode, options) in [
        (r#"{"draw": "hillshade"}"#, "hillshade", &[][..]),
        (
            r#"{"draw": "hillshade", "azimuth": 200, "altitude": 30, "z": 2.5}"#,
            "hillshade",
            &["-az", "200", "-alt", "30", "-z", "2.5"],
        ),
        (r#"{"draw": "hillshade", "light": "multidirectional"}"#, "hillshade", &["-multidirectional"]),
        (r#"{"draw": "hillshade", "light": "combined"}"#, "hillshade", &["-combined"]),
    ] {
        let (ours, theirs) = (paint(style), gdaldem(mode, &[&common[..], options].concat()));
        let differ = |index: &&usize| ours[4 * **index].abs_diff(theirs[**index]) > 0;
        let most = cells.iter().map(|index| ours[4 * index].abs_diff(theirs[*index])).max();
        let others = cells.iter().filter(differ).count();
        eprintln!("{style}: {others} of {} differ, by {most:?} at most", cells.len());
        assert!(most <= Some(1) && others * 1000 < cells.len(), "{style}");
    }
    // Slopes and aspects are numbers: 256 greys resolve them to half a grey step.
    for (style, mode, options, step) in [
        (r##"{"draw": "slope", "ramp": "grey", "domain": [0, 51]}"##, "slope", &common[..], 0.2),
        (
            r##"{"draw": "slope", "unit": "percent", "ramp": "grey", "domain": [0, 127.5]}"##,
            "slope",
            &["-s", "111120", "-compute_edges", "-p"],
            0.5,
        ),
        (r##"{"draw": "aspect", "ramp": "grey", "domain": [0, 510]}"##, "aspect", &["-compute_edges"], 2.0),
    ] {
        let (ours, theirs) = (paint(style), gdaldem(mode, options));
        for index in &cells {
            let theirs = f32::from_le_bytes(theirs[4 * index..][..4].try_into().unwrap());
            let [grey, _, _, alpha] = ours[4 * index..][..4].try_into().unwrap();
            if theirs == -9999.0 {
                assert_eq!(alpha, 0, "{style}: flat");
            } else {
                let expected = (f64::from(theirs) / step).min(255.0);
                assert!((expected - f64::from(grey)).abs() < 0.5001, "{style}: {theirs} {grey}");
            }
        }
    }
    let table = name("ramp.txt");
    std::fs::write(&table, "200 0 60 20\n1000 250 240 90\n2500.5 120 60 30\n4000 255 255 255\n").unwrap();
    let style = r##"{"draw": "ramp", "ramp": [[200, "#003c14"], [1000, "#faf05a"], [2500.5, "#783c1e"], [4000, "#ffffff"]]}"##;
    let (ours, theirs) = (paint(style), gdaldem("color-relief", &[table.to_str().unwrap()]));
    for index in &cells {
        let (ours, theirs) = (&ours[4 * index..][..3], &theirs[3 * index..][..3]);
        assert!(ours.iter().zip(theirs).all(|(a, b)| a.abs_diff(*b) <= 1), "{ours:?} {theirs:?}");
    }
}
