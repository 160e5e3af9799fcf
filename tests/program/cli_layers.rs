//! Layers of a file, as the program shows them.

use std::fs::File;
use std::io::BufReader;

use serde_json::Value as Json;
use spinney::raw::store::TreeWriter;
use spinney::{DataKind, Dimension, Frame, Metadata, Output, Rule, SampleType, TreeType};

use crate::common::command::{complaint, spinney, stdout};
use crate::common::directory::TestDirectory;
use crate::common::{Cells, QUAD, options, quad, value};

/// A layer to be written, with cells 2^coarser times as large as the finest.
struct Layer {
    name: &'static str,
    time: Option<&'static str>,
    cells: Cells,
    kind: DataKind,
    coarser: u8,
}

/// Writes a file of layers in a new directory. Returns the directory and the path.
fn written(name: &str, layers: &[Layer]) -> (TestDirectory, String) {
    let temp = TestDirectory::new();
    let path = temp.name(name);
    let output = Output::create(path.as_ref()).unwrap();
    let mut file = TreeWriter::create(output, (Dimension::Quad, DEPTH), layers.len() as u32).unwrap();
    for layer in layers {
        let metadata = Metadata {
            name: layer.name.into(),
            time: layer.time.map(String::from),
            frame: Frame::identity().coarser(layer.coarser),
            ..Metadata::default()
        };
        let rule = if layer.kind == DataKind::Categorical { Rule::Majority } else { Rule::Mean };
        let options = options(rule, layer.kind, DEPTH - layer.coarser).metadata(metadata);
        let nodata = value(layer.cells.form.value, 250);
        let mut slabs = layer.cells.slabs(nodata);
        file.slabs(layer.cells.form, &mut slabs, Some(nodata), &options, &()).unwrap();
    }
    file.finish().unwrap();
    (temp, path)
}

/// Depth of the files.
const DEPTH: u8 = 7;

fn cells(form: TreeType, seed: u64, size: u64) -> Cells {
    Cells::random(form, seed, [size, size - 3, 1], 9, true)
}

/// Returns two height layers, the second with larger cells and another type, and classes.
fn series() -> Vec<Layer> {
    let (heights, kind) = (quad(SampleType::I16, 1), DataKind::Continuous);
    let june = Some("2024-06-01T10:20:30Z");
    vec![
        Layer { name: "june", time: june, cells: cells(heights, 1, 90), kind, coarser: 0 },
        Layer {
            name: "July, late",
            time: Some("2024-07-30"),
            cells: cells(quad(SampleType::F32, 2), 2, 45),
            kind,
            coarser: 1,
        },
        Layer {
            name: "cover",
            time: None,
            cells: cells(QUAD, 3, 90),
            kind: DataKind::Categorical,
            coarser: 0,
        },
    ]
}

fn json(words: &[&str]) -> Json {
    serde_json::from_str(&stdout(words)).unwrap()
}

/// Writes a square, a field with an unusual name, and one outside of the tree.
fn zones(temp: &TestDirectory) -> String {
    let feature = |properties: &str, ring: &str| {
        format!(
            r#"{{"type":"Feature","id":7,"properties":{{{properties}}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}"#
        )
    };
    let features = [
        feature(r#""name":"square","crop":"rye""#, "[[4,4],[40,4],[40,40],[4,40]]"),
        feature(r#""name":"a \"field\", or two","crop":null"#, "[[50.3,10.1],[80.7,20.9],[60.2,71.7]]"),
        feature(r#""name":"outside""#, "[[500,500],[510,500],[510,510]]"),
    ];
    let path = temp.name("zones.geojson");
    let document = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","));
    std::fs::write(&path, document).unwrap();
    path
}

#[test]
fn zone_statistics_cover_all_layers_with_their_times() {
    for name in ["series.goblin", "series.autumn"] {
        let (temp, file) = written(name, &series());
        let zones = zones(&temp);
        for edge in ["centre", "touch", "area"] {
            let words = ["stats", &file, "--zones", &zones, "--in", "world", "--edge", edge, "--json"];
            let queried = |layers: &[&str]| json(&[&words[..], layers].concat());
            let found = queried(&[]);
            for (number, layer) in series().iter().enumerate() {
                // Each layer gives the same result as alone.
                let alone = queried(&["--layer", &number.to_string()]);
                for (zone, expected) in
                    found["zones"].as_array().unwrap().iter().zip(alone["zones"].as_array().unwrap())
                {
                    let mut row = zone["layers"][number].as_object().unwrap().clone();
                    assert_eq!(row.shift_remove("layer").unwrap(), layer.name);
                    assert_eq!(row.shift_remove("time").unwrap().as_str(), layer.time);
                    let mut whole = expected.as_object().unwrap().clone();
                    for key in ["id", "name", "properties"] {
                        assert_eq!(whole.shift_remove(key).unwrap(), zone[key]);
                    }
                    assert_eq!(row, whole, "{edge}");
                }
            }
            let some = queried(&["--layer", "cover,june"]);
            assert_eq!(some["zones"][1]["layers"][1], found["zones"][1]["layers"][0]);
            assert_eq!(some["zones"][1]["layers"].as_array().unwrap().len(), 2);
        }
    }
}

#[test]
fn zones_of_layers_become_tables() {
    let (temp, file) = written("series.goblin", &series());
    let zones = zones(&temp);
    let words = ["stats", &file, "--zones", &zones, "--in", "world"];
    let found = json(&[&words[..], &["--json"]].concat());
    let table = stdout(&[&words[..], &["--csv", "--attribute", "crop"]].concat());
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some(
            "zone,id,crop,layer,time,channel,class,cells,void_cells,area_m2,min,max,mean,standard_deviation,class_name"
        )
    );
    let lines: Vec<&str> = lines.collect();
    let number = |number: &Json| number.to_string().trim_end_matches(".0").to_string();
    // The first zone: a row per channel, with the content of JSON.
    let layers = &found["zones"][0]["layers"];
    let row = |layer: usize, (name, time): (&str, &str), channel: usize| {
        let statistics = &layers[layer];
        let c = &statistics["channels"][channel];
        format!(
            "square,7,rye,{name},{time},{},,{},{},,{},{},{},{},",
            channel + 1,
            number(&c["cells"]),
            number(&statistics["void_cells"]),
            number(&c["min"]),
            number(&c["max"]),
            number(&c["mean"]),
            number(&c["standard_deviation"])
        )
    };
    assert_eq!(lines[0], row(0, ("june", "2024-06-01T10:20:30Z"), 0));
    assert_eq!(lines[1], row(1, ("\"July, late\"", "2024-07-30"), 0));
    assert_eq!(lines[2], row(1, ("\"July, late\"", "2024-07-30"), 1));
    for (line, class) in lines[3..].iter().zip(layers[2]["classes"].as_array().unwrap()) {
        let cells = [number(&class["value"]), number(&class["cells"])].join(",");
        assert!(line.starts_with(&format!("square,7,rye,cover,,,{cells},")), "{line}");
    }
    assert!(table.contains("\n\"a \"\"field\"\", or two\",7,,june,"), "{table}");
    assert_eq!(table.lines().filter(|line| line.starts_with("outside,7,,")).count(), 3);
    assert!(table.contains("\noutside,7,,june,2024-06-01T10:20:30Z,,,0,0,,,,,,\n"), "{table}");
    // The text format also has a row per zone and layer; for one layer it is unchanged.
    let text = stdout(&words);
    assert!(text.contains("square  July, late  2024-07-30  ") && text.contains("square  cover  "), "{text}");
    let alone = stdout(&[&words[..], &["--layer", "june"]].concat());
    let rows = |text: &str| text.lines().filter(|line| line.starts_with("square")).count();
    assert_eq!((rows(&text), rows(&alone)), (3, 1));
    assert!(alone.starts_with("square  ") && !alone.contains("june"), "{alone}");
    for more in [&["--csv", "--json"][..], &["--csv", "--layer", "none"]] {
        let code = if more.contains(&"--json") { 2 } else { 1 };
        complaint(&[&words[..], more].concat(), code);
    }
    complaint(&["stats", &file, "--csv"], 2);
}

#[test]
fn values_at_points_have_layers_and_times() {
    let (_place, file) = written("series.autumn", &series());
    let points = ["9,9", "30,51", "88,1", "200,3"];
    let words = [&["point", &file, "--in", "cells"], &points[..]].concat();
    let text = spinney(&words).success();
    let text = String::from_utf8(text.get_output().stdout.clone()).unwrap();
    let lines = stdout(&[&words[..], &["--json"]].concat());
    assert_eq!(lines.lines().count(), points.len());
    for (plain, line) in text.lines().zip(lines.lines()) {
        let json: Json = serde_json::from_str(line).unwrap();
        assert_eq!(json["outside"], plain.starts_with("outside"));
        let mut numbers = Vec::new();
        for (row, layer) in json["layers"].as_array().unwrap().iter().zip(series()) {
            assert_eq!((row["layer"].as_str(), row["time"].as_str()), (Some(layer.name), layer.time));
            match row["samples"].as_array() {
                Some(samples) => numbers.extend(samples.iter().map(Json::to_string)),
                None => numbers.push(if json["outside"] == true { "outside" } else { "void" }.into()),
            }
        }
        assert_eq!(numbers.join(","), plain);
    }
}

/// Returns 16-bit bands, of which the second has larger cells.
fn bands() -> Vec<Layer> {
    let layer = |name, seed, size, coarser| {
        let cells = Cells::random(quad(SampleType::U16, 1), seed, [size, size, 1], 200, true);
        Layer { name, time: None, cells, kind: DataKind::Continuous, coarser }
    };
    vec![layer("B04", 4, 96, 0), layer("B05", 5, 48, 1), layer("B08", 8, 96, 0)]
}

/// Returns the columns and pixels of a PNG file: red, green, blue and opacity.
fn pixels(path: &str) -> (usize, Vec<[u8; 4]>) {
    let mut decoder = png::Decoder::new(BufReader::new(File::open(path).unwrap()));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let grey = |[grey, alpha]: &[u8; 2]| [*grey, *grey, *grey, *alpha];
    let pixels = match info.color_type {
        png::ColorType::GrayscaleAlpha => bytes.as_chunks().0.iter().map(grey).collect(),
        png::ColorType::Rgba => bytes.as_chunks().0.to_vec(),
        other => panic!("{other:?}"),
    };
    (info.width as usize, pixels)
}

#[test]
fn images_have_layers_as_colours() {
    for name in ["bands.goblin", "bands.autumn"] {
        let (temp, file) = written(name, &bands());
        let (out, names) = (temp.name("rgb.png"), ["B08", "B05", "B04"]);
        for more in [&["--range", "10,180"][..], &["--range", "10,180", "--level", "5"]] {
            let get = |layer: &str, out: &str| {
                spinney(&[&["-q", "get", &file, out, "--layer", layer], more].concat()).success();
                pixels(out)
            };
            let (columns, found) = get(&names.join(","), &out);
            let greys = names.map(|name| get(name, &temp.name("grey.png")));
            // A layer of larger cells has fewer of them.
            let grey = |band: usize, index: usize| {
                let (own, pixels) = &greys[band];
                let [x, y] = [index % columns, index / columns].map(|at| at * own / columns);
                pixels[y * own + x]
            };
            let mut parts = 0;
            for (index, pixel) in found.iter().enumerate() {
                let greys = [0, 1, 2].map(|band| grey(band, index));
                let [red, green, blue] = greys.map(|[grey, _, _, alpha]| if alpha == 0 { 0 } else { grey });
                let alpha = greys.iter().map(|grey| grey[3]).max().unwrap_or(0);
                parts += u32::from(alpha > 0 && greys.iter().any(|grey| grey[3] == 0));
                assert_eq!(*pixel, [red, green, blue, alpha], "{more:?} {index}");
            }
            assert!(parts > 0);
        }
    }
}

#[test]
fn colours_of_16_bits_are_stretched_and_others_reported() {
    let (temp, file) = written("bands.goblin", &bands());
    let out = temp.name("rgb.png");
    let run = spinney(&["get", &file, &out, "--layer", "B08,B05,B04"]).success();
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(said.contains(r#"{"draw":"rgb"}"#), "{said}");
    // Each channel ranges from black to white.
    let (_, found) = pixels(&out);
    for channel in 0..3 {
        let of_channel = || found.iter().filter(|pixel| pixel[3] > 0).map(|pixel| pixel[channel]);
        assert_eq!((of_channel().min(), of_channel().max()), (Some(0), Some(255)));
    }
    let drawn = |words: &[&str]| {
        spinney(&[&["-q", "get", &file, &out], words].concat()).success();
        pixels(&out).1
    };
    // By number; of two layers, the second is cyan.
    assert_eq!(drawn(&["--layer", "2,1,0"]), found);
    let two = drawn(&["--layer", "2,1"]);
    assert!(two.iter().all(|pixel| pixel[1] == pixel[2]));
    assert!(two.iter().zip(&found).all(|(two, three)| two[3] == 0 || two[..2] == three[..2]));
    // As a view, or written and drawn in other ways.
    assert_eq!(drawn(&["--layer", "B08", "--view", "composite=B08,B05,B04", "--style", "rgb"]), found);
    let legend = temp.name("legend.json");
    spinney(&["legend", &file, &legend, "--layer", "B08,B05,B04"]).success();
    let legend = std::fs::read_to_string(legend).unwrap();
    assert!(["B08", "B05", "B04"].iter().all(|name| legend.contains(name)), "{legend}");
    assert!(!stdout(&["show", &file, "--layer", "B08,B05,B04"]).is_empty());
    let cog = temp.name("cog.tif");
    spinney(&["-q", "export", &file, &cog, "--layer", "B08,B05,B04"]).success();
    let back = temp.name("back.goblin");
    spinney(&["-q", "build", &cog, "-o", &back]).success();
    spinney(&["-q", "get", &back, &out, "--style", "rgb"]).success();
    assert_eq!(pixels(&out).1, found);
    for (words, expected) in [
        (&["--layer", "B08,B05,B04,B04,B04"][..], "2 to 4 layers"),
        (&["--layer", "B08,none"], "none"),
        (&[], "--layer A,B,C"),
    ] {
        let text = complaint(&[&["get", &file, &out], words].concat(), 1);
        assert!(text.contains(expected), "{text}");
    }
    let (_place, mixed) = written("series.goblin", &series());
    let text = complaint(&["get", &mixed, &out, "--layer", "june,cover"], 1);
    assert!(text.contains("`june` of i16, `cover` of u8, expected layers of one type"), "{text}");
}

#[test]
fn tiles_of_layers_are_those_of_a_tree_with_their_channels() {
    let temp = TestDirectory::new();
    let [stack, tree] = ["stack.goblin", "tree.goblin"].map(|name| temp.name(name));
    let classes = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
    let elevation = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");
    let words = ["-q", "build", classes, elevation, classes, "-o", &stack, "--stack", "--names", "a,h,b"];
    spinney(&words).success();
    spinney(&["-q", "transform", &format!("{stack}:a"), "composite=a,b,a", "-o", &tree]).success();
    let files = |tree: &str, directory: &str, more: &[&str]| {
        let directory = temp.name(directory);
        let pattern = format!("{directory}/{{z}}/{{x}}/{{y}}.png");
        spinney(&[&["-q", "export", tree, &pattern, "--zoom", "7..11"], more].concat()).success();
        let mut found = Vec::new();
        let mut pending = vec![std::path::PathBuf::from(&directory)];
        while let Some(next) = pending.pop() {
            for entry in std::fs::read_dir(next).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    pending.push(path);
                } else if path.extension().is_some_and(|extension| extension == "png") {
                    found.push((
                        path.strip_prefix(&directory).unwrap().to_owned(),
                        std::fs::read(&path).unwrap(),
                    ));
                }
            }
        }
        found.sort();
        found
    };
    let found = files(&stack, "stack", &["--layer", "a,b,a"]);
    assert!(found.len() > 4);
    assert!(found == files(&tree, "tree", &[]));
    let update = ["export", &stack, &temp.name("t.pmtiles"), "--layer", "a,b", "--update", &tree];
    assert!(complaint(&update, 1).contains("several layers"));
    // All layers need the same type.
    let text = complaint(&["export", &stack, &temp.name("t.pmtiles"), "--layer", "a,h"], 1);
    assert!(text.contains("`h` of f32") && text.contains("calc=b1,type=f32"), "{text}");
}
