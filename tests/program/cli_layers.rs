//! Layers of a file side by side, as the program shows them.

use serde_json::Value as Json;
use spinney::io::Output;
use spinney::space::{Dimension, Frame};
use spinney::store::{Metadata, TreeWriter};
use spinney::tree::Form;
use spinney::value::{Kind, Rule, SampleType};

use crate::common::command::{complaint, spinney, stdout};
use crate::common::{Cells, QUAD, options, quad, value};

/// A layer to be written, of cells 2^coarser as large as the finest.
struct Layer {
    name: &'static str,
    time: Option<&'static str>,
    cells: Cells,
    kind: Kind,
    coarser: u8,
}

/// A folder with a file of layers.
struct Place(tempfile::TempDir);

impl Place {
    fn name(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().into()
    }

    fn write(name: &str, layers: &[Layer]) -> (Place, String) {
        let place = Place(tempfile::tempdir().unwrap());
        let path = place.name(name);
        let output = Output::create(path.as_ref()).unwrap();
        let mut file = TreeWriter::create(output, (Dimension::Quad, DEPTH), layers.len() as u32).unwrap();
        for layer in layers {
            let metadata = Metadata {
                name: layer.name.into(),
                time: layer.time.map(String::from),
                frame: Frame::identity().coarser(layer.coarser),
                ..Metadata::default()
            };
            let rule = if layer.kind == Kind::Categorical { Rule::Majority } else { Rule::Mean };
            let options = options(rule, layer.kind, DEPTH - layer.coarser).metadata(metadata);
            let nodata = value(layer.cells.form.value, 250);
            let mut slabs = layer.cells.slabs(nodata);
            file.slabs(layer.cells.form, &mut slabs, Some(nodata), &options, &()).unwrap();
        }
        file.finish().unwrap();
        (place, path)
    }
}

/// Levels of the files.
const DEPTH: u8 = 7;

fn cells(form: Form, seed: u64, size: u64) -> Cells {
    Cells::random(form, seed, [size, size - 3, 1], 9, true)
}

/// Heights twice, the second of larger cells and of another type, and classes.
fn series() -> Vec<Layer> {
    let (heights, kind) = (quad(SampleType::I16, 1), Kind::Continuous);
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
        Layer { name: "cover", time: None, cells: cells(QUAD, 3, 90), kind: Kind::Categorical, coarser: 0 },
    ]
}

fn json(words: &[&str]) -> Json {
    serde_json::from_str(&stdout(words)).unwrap()
}

/// A document of a square, a field that is named like nothing else, and one that lies elsewhere.
fn zones(place: &Place) -> String {
    let feature = |properties: &str, ring: &str| {
        format!(
            r#"{{"type":"Feature","id":7,"properties":{{{properties}}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}"#
        )
    };
    let features = [
        feature(r#""name":"square","crop":"rye""#, "[[4,4],[40,4],[40,40],[4,40]]"),
        feature(r#""name":"a \"field\", or two","crop":null"#, "[[50.3,10.1],[80.7,20.9],[60.2,71.7]]"),
        feature(r#""name":"elsewhere""#, "[[500,500],[510,500],[510,510]]"),
    ];
    let path = place.name("zones.geojson");
    let document = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","));
    std::fs::write(&path, document).unwrap();
    path
}

#[test]
fn zones_are_told_of_all_layers_with_their_times() {
    for name in ["series.goblin", "series.autumn"] {
        let (place, file) = Place::write(name, &series());
        let zones = zones(&place);
        for edge in ["centre", "touch", "area"] {
            let words = ["stats", &file, "--zones", &zones, "--in", "world", "--edge", edge, "--json"];
            let asked = |layers: &[&str]| json(&[&words[..], layers].concat());
            let found = asked(&[]);
            for (number, layer) in series().iter().enumerate() {
                // Each layer tells what it tells alone.
                let alone = asked(&["--layer", &number.to_string()]);
                for (zone, expected) in
                    found["zones"].as_array().unwrap().iter().zip(alone["zones"].as_array().unwrap())
                {
                    let mut row = zone["layers"][number].as_object().unwrap().clone();
                    assert_eq!(row.shift_remove("layer").unwrap(), layer.name);
                    assert_eq!(row.shift_remove("time").unwrap().as_str(), layer.time);
                    let mut whole = expected.as_object().unwrap().clone();
                    for told in ["id", "name", "properties"] {
                        assert_eq!(whole.shift_remove(told).unwrap(), zone[told]);
                    }
                    assert_eq!(row, whole, "{edge}");
                }
            }
            let some = asked(&["--layer", "cover,june"]);
            assert_eq!(some["zones"][1]["layers"][1], found["zones"][1]["layers"][0]);
            assert_eq!(some["zones"][1]["layers"].as_array().unwrap().len(), 2);
        }
    }
}

#[test]
fn zones_of_layers_become_tables() {
    let (place, file) = Place::write("series.goblin", &series());
    let zones = zones(&place);
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
    // The first zone: a row for each channel, with what JSON has.
    let layers = &found["zones"][0]["layers"];
    let row = |layer: usize, (name, time): (&str, &str), channel: usize| {
        let told = &layers[layer];
        let c = &told["channels"][channel];
        format!(
            "square,7,rye,{name},{time},{},,{},{},,{},{},{},{},",
            channel + 1,
            number(&c["cells"]),
            number(&told["void_cells"]),
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
    assert_eq!(table.lines().filter(|line| line.starts_with("elsewhere,7,,")).count(), 3);
    assert!(table.contains("\nelsewhere,7,,june,2024-06-01T10:20:30Z,,,0,0,,,,,,\n"), "{table}");
    // Text has a row for each zone and layer, too; of one layer it is what it was.
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
fn points_tell_layers_and_times() {
    let (_place, file) = Place::write("series.autumn", &series());
    let points = ["9,9", "30,51", "88,1", "200,3"];
    let words = [&["point", &file, "--in", "cells"], &points[..]].concat();
    let text = spinney(&words).success();
    let text = String::from_utf8(text.get_output().stdout.clone()).unwrap();
    let lines = stdout(&[&words[..], &["--json"]].concat());
    assert_eq!(lines.lines().count(), points.len());
    for (plain, line) in text.lines().zip(lines.lines()) {
        let told: Json = serde_json::from_str(line).unwrap();
        assert_eq!(told["outside"], plain.starts_with("outside"));
        let mut numbers = Vec::new();
        for (row, layer) in told["layers"].as_array().unwrap().iter().zip(series()) {
            assert_eq!((row["layer"].as_str(), row["time"].as_str()), (Some(layer.name), layer.time));
            match row["samples"].as_array() {
                Some(samples) => numbers.extend(samples.iter().map(Json::to_string)),
                None => numbers.push(if told["outside"] == true { "outside" } else { "void" }.into()),
            }
        }
        assert_eq!(numbers.join(","), plain);
    }
}
