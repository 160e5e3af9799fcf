//! Two files: every operation with every kind of difference, and advice that works as printed.

use std::path::Path;

use spinney::raw::store::{Tag, Unit};
use spinney::{Crs, DataKind, Dimension, Frame, Metadata, Number, Rule, SampleType, TreeType, ValueType};

use crate::common::command::command;
use crate::common::directory::TestDirectory;
use crate::common::{Cells, options, write_cells};

/// Cells along each axis of both files.
const SIZE: [u64; 3] = [12, 10, 1];

/// The meaning of all cells of the first file, and of the second.
const FIRST: f64 = 7.5;
const SECOND: f64 = 24.0;

/// A file whose cells all mean the same.
struct Uniform {
    sample: SampleType,
    meaning: f64,
    scale: (f64, f64),
    unit: &'static str,
    frame: Frame,
    kind: DataKind,
    size: [u64; 3],
    names: &'static [(u64, &'static str)],
    dimension: Dimension,
}

impl Uniform {
    fn new(sample: SampleType, meaning: f64, frame: Frame) -> Uniform {
        let (scale, kind) = ((1.0, 0.0), DataKind::Continuous);
        let (unit, size, names, dimension) = ("", SIZE, &[][..], Dimension::Quad);
        Uniform { sample, meaning, scale, unit, frame, kind, size, names, dimension }
    }

    fn write(&self, path: &Path) {
        let form = TreeType::new(self.dimension, ValueType::new(self.sample, 1));
        let stored = (self.meaning - self.scale.1) / self.scale.0;
        let value = form.value.nearest(|_| stored);
        assert_eq!(form.value.samples(value)[0], stored, "a number of the type");
        let count = self.size.iter().product::<u64>() as usize;
        let cells = Cells { form, size: self.size, cells: vec![Some(value); count] };
        let mut options = options(self.kind.default_rule(), self.kind, cells.depth());
        options.metadata = Metadata {
            frame: self.frame.clone(),
            scale_offset: if self.scale == (1.0, 0.0) { Vec::new() } else { vec![self.scale] },
            units: if self.unit.is_empty() { Vec::new() } else { vec![self.unit.into()] },
            class_names: self
                .names
                .iter()
                .map(|(number, name)| (Number::from(*number), name.to_string()))
                .collect(),
            ..Metadata::default()
        };
        write_cells(path, &cells, &options);
    }
}

/// Returns a frame of cells of `cell` metres at a position.
fn frame(cell: f64, x: f64, y: f64) -> Frame {
    Frame { crs: Some(Crs::epsg(32632)), ..Frame::planar([cell, 0.0, x, 0.0, -cell, y]) }
}

impl TestDirectory {
    /// Runs the program in the directory. Returns whether it succeeded, and its messages.
    fn run(&self, arguments: &[&str]) -> (bool, String) {
        let output = command(arguments).current_dir(self.root()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code().is_some(), "{arguments:?} ended by a signal");
        (output.status.success(), said.into_owned())
    }

    fn done(&self, arguments: &[&str]) -> String {
        let (is_done, said) = self.run(arguments);
        assert!(is_done, "{arguments:?}: {said}");
        said
    }

    /// Returns a file's value at a world position, in metres if it is a length; `None` is VOID or
    /// outside.
    fn meaning(&self, name: &str, x: f64, y: f64) -> Option<f64> {
        let said = self.done(&["-q", "point", name, &format!("{x},{y}")]);
        let stored: f64 = said.trim().parse().ok()?;
        let tree = spinney::open(self.path(name)).unwrap();
        let (scale, offset) = tree.metadata().scale_offset.first().copied().unwrap_or((1.0, 0.0));
        let unit = tree.metadata().units.first().and_then(|unit| Unit::parse(unit));
        Some((stored * scale + offset) * unit.and_then(Unit::metres).unwrap_or(1.0))
    }
}

/// Returns the words of a command as a shell parses them.
fn words(command: &str) -> Vec<String> {
    let (mut found, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for letter in command.chars() {
        match (letter, quote) {
            (letter, Some(open)) if letter == open => quote = None,
            ('\'' | '"', None) => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (' ', None) => found.extend(word.take()),
            _ => word.get_or_insert_default().push(letter),
        }
    }
    found.extend(word);
    found
}

/// Returns the commands in a message: text in backticks that begins with the program's name.
fn commands(message: &str) -> Vec<Vec<String>> {
    let quoted = message.split('`').skip(1).step_by(2);
    quoted.filter_map(|text| text.strip_prefix("spinney ")).map(words).collect()
}

/// The operations, as commands that read `a.goblin` and another file, and write `out.goblin` if
/// they write a tree.
const OPERATIONS: [&[&str]; 18] = [
    &["combine", "over", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "union", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "and", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "and", "a.goblin", "OTHER", "--values", "b", "-o", "out.goblin"],
    &["combine", "a-b", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "b-a", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "xor", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "mask", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "max", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "add", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "changed", "a.goblin", "OTHER", "-o", "out.goblin"],
    &["combine", "cross", "a.goblin", "OTHER"],
    &["diff", "a.goblin", "OTHER"],
    &["transform", "a.goblin", "calc=b1+b,b=OTHER", "-o", "out.goblin"],
    &["transform", "OTHER", "like=a.goblin", "-o", "out.goblin"],
    &["edit", "a.autumn", "paste", "OTHER"],
    &["edit", "a.autumn", "apply", "max", "OTHER"],
    &["edit", "a.autumn", "add-layer", "OTHER", "second"],
];

/// Returns an operation's results from both meanings: with only the first file, with both, and with
/// only the second. `None` if the result is not a number, or nothing is written.
fn expected(operation: &[&str]) -> Option<[Option<f64>; 3]> {
    let [a, b] = [Some(FIRST), Some(SECOND)];
    Some(match (operation[0], operation[1], operation.contains(&"--values")) {
        ("combine", "over" | "union", _) => [a, a, b],
        ("combine", "and", true) => [None, b, None],
        ("combine", "and" | "mask", _) => [None, a, None],
        ("combine", "a-b", _) => [a, None, None],
        ("combine", "b-a", _) => [None, None, b],
        ("combine", "xor", _) => [a, None, b],
        ("combine", "max", _) => [None, b, None],
        ("combine", "add", _) => [None, Some(FIRST + SECOND), None],
        ("combine", "changed", _) => [a, b, b],
        ("transform", "a.goblin", _) => [None, Some(FIRST + SECOND), None],
        ("transform", ..) => [None, b, b],
        _ => return None,
    })
}

#[test]
fn every_operation_converts_every_difference_or_says_how() {
    let here = || frame(10.0, 500_000.0, 5_200_000.0);
    let moved = |cell: f64, x: f64, y: f64| frame(cell, 500_000.0 + x, 5_200_000.0 + y);
    let of = |sample, frame| Uniform::new(sample, SECOND, frame);
    let i16s = || of(SampleType::I16, moved(10.0, 60.0, 0.0));
    let without_crs = |frame: Frame| Frame { crs: None, ..frame };
    let differences: Vec<(&str, Uniform)> = vec![
        ("extent", i16s()),
        ("part of a cell", of(SampleType::I16, moved(10.0, 63.0, -2.0))),
        ("other cells", of(SampleType::I16, moved(7.0, 60.0, 0.0))),
        ("larger cells", Uniform { size: [6, 5, 1], ..of(SampleType::I16, moved(20.0, 60.0, 0.0)) }),
        ("smaller cells", Uniform { size: [24, 20, 1], ..of(SampleType::I16, moved(5.0, 60.0, 0.0)) }),
        ("u8", of(SampleType::U8, moved(10.0, 60.0, 0.0))),
        ("f32", of(SampleType::F32, moved(10.0, 60.0, 0.0))),
        ("f64", of(SampleType::F64, moved(10.0, 60.0, 0.0))),
        ("i64", of(SampleType::I64, moved(10.0, 60.0, 0.0))),
        ("scale", Uniform { scale: (0.5, 0.0), ..i16s() }),
        ("fine scale", Uniform { scale: (0.01, 5.0), ..i16s() }),
        ("odd scale", Uniform { scale: (0.75, 0.0), ..i16s() }),
        ("unit", Uniform { unit: "cm", meaning: SECOND * 100.0, ..i16s() }),
        ("no unit", Uniform { unit: "", ..i16s() }),
        ("unit of something else", Uniform { unit: "degC", ..i16s() }),
        ("no coordinate system", of(SampleType::I16, without_crs(moved(10.0, 60.0, 0.0)))),
        ("classes", Uniform { kind: DataKind::Categorical, names: &[(24, "wood")], ..i16s() }),
        ("three axes", Uniform { dimension: Dimension::Oct, size: [4, 4, 4], ..i16s() }),
    ];
    let mut wrong = Vec::new();
    for (difference, second) in &differences {
        for operation in OPERATIONS {
            let temp = TestDirectory::new();
            let first =
                Uniform { scale: (0.1, 0.0), unit: "m", ..Uniform::new(SampleType::I16, FIRST, here()) };
            first.write(&temp.path("a.goblin"));
            second.write(&temp.path("b.goblin"));
            temp.done(&["-q", "convert", "a.goblin", "a.autumn"]);
            let with = |other: &str, more: &[&str]| -> Vec<String> {
                let words = operation.iter().map(|word| word.replace("OTHER", other));
                words.chain(more.iter().map(ToString::to_string)).collect()
            };
            let run = |words: &[String]| temp.run(&words.iter().map(String::as_str).collect::<Vec<_>>());
            let name = format!("{difference}, {}", operation.join(" "));
            let (mut is_done, mut said) = run(&with("b.goblin", &[]));
            if !is_done {
                // Follows the advice, repeatedly if necessary: commands make another second file,
                // options are added.
                let (mut other, mut option) = ("b.goblin".to_string(), Vec::new());
                for _ in 0..3 {
                    let before = (other.clone(), option.len());
                    for advised in commands(&said) {
                        let (is_advised, says) = run(&advised);
                        if !is_advised {
                            wrong.push(format!("{name}: {said}  advised {advised:?}: {says}"));
                        }
                        other = advised.last().unwrap().clone();
                    }
                    let options =
                        ["--units number", "--round"].into_iter().filter(|option| said.contains(option));
                    option.extend(options.flat_map(|option| option.split(' ')));
                    if before == (other.clone(), option.len()) {
                        break;
                    }
                    (is_done, said) = run(&with(&other, &option));
                    if is_done {
                        break;
                    }
                }
                if !is_done && *difference != "three axes" {
                    wrong.push(format!("{name}, as advised: {said}"));
                }
                continue;
            }
            if *difference == "three axes" {
                wrong.push(format!("{name}: done: {said}"));
                continue;
            }
            let Some(expected) = expected(operation).filter(|_| *difference != "classes") else { continue };
            // Calculated values have no scale; numbers of both are in the first file's unit.
            let positions = [(500_005.0, 5_199_985.0), (500_095.0, 5_199_965.0), (500_135.0, 5_199_965.0)];
            for (expected, (x, y)) in expected.into_iter().zip(positions) {
                let found = temp.meaning("out.goblin", x, y);
                let fits = match (found, expected) {
                    (Some(found), Some(expected)) => (found - expected).abs() < 1e-5,
                    (found, expected) => found == expected,
                };
                if !fits {
                    wrong.push(format!("{name}: {found:?} at {x},{y}, expected {expected:?}: {said}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

/// Advice for single commands: a command fails, and succeeds after the commands of the message are
/// run in order.
#[test]
fn advice_is_a_command_that_works() {
    let temp = TestDirectory::new();
    let here = frame(10.0, 500_000.0, 5_200_000.0);
    let off = frame(10.0, 500_003.0, 5_200_000.0);
    Uniform::new(SampleType::F32, 7.5, here.clone()).write(&temp.path("dem.goblin"));
    Uniform::new(SampleType::F32, 7.5, off).write(&temp.path("off.goblin"));
    let solid = Uniform {
        dimension: Dimension::Oct,
        size: [4, 4, 4],
        ..Uniform::new(SampleType::U8, 1.0, Frame::identity())
    };
    solid.write(&temp.path("solid.goblin"));
    let fixture = |name: &str| format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::copy(fixture("island_rgb.png"), temp.path("rgb.png")).unwrap();
    std::fs::copy(fixture("island_classes.tif"), temp.path("classes.tif")).unwrap();
    temp.done(&["-q", "build", "classes.tif", "-o", "classes.goblin"]);
    temp.done(&["-q", "convert", "dem.goblin", "dem.autumn"]);
    // Zeros outside of the mask, and no VOID.
    let bytes = [&b"P5 12 10 255\n"[..], &[0; 60], &[1; 60]].concat();
    std::fs::write(temp.path("mask.pgm"), bytes).unwrap();
    let corners = "10,0,500000,0,-10,5200000";
    let crs = "EPSG:32632";
    temp.done(&["-q", "build", "rgb.png", "--crs", crs, "--transform", corners, "-o", "rgb.goblin"]);
    temp.done(&[
        "-q",
        "build",
        "mask.pgm",
        "--kind",
        "categorical",
        "--crs",
        crs,
        "--transform",
        corners,
        "-o",
        "mask.goblin",
    ]);
    temp.done(&["-q", "build", "mask.pgm", "--crs", crs, "--transform", corners, "-o", "lonely.goblin"]);
    let scaled = |scale: &str| {
        let source =
            "<SourceFilename relativeToVRT=\"1\">classes.tif</SourceFilename><SourceBand>1</SourceBand>";
        format!(
            "<VRTDataset rasterXSize=\"256\" rasterYSize=\"200\"><SRS>EPSG:32628</SRS><GeoTransform>300000,50,0,3200000,0,-50</GeoTransform><VRTRasterBand dataType=\"Byte\" band=\"1\"><Scale>{scale}</Scale><SimpleSource>{source}</SimpleSource></VRTRasterBand></VRTDataset>"
        )
    };
    std::fs::write(temp.path("tenths.vrt"), scaled("0.1")).unwrap();
    std::fs::write(temp.path("ones.vrt"), scaled("1")).unwrap();
    let cases: [(&[&str], &[&str]); 10] = [
        (
            &["export", "solid.goblin", "p.geojson", "--polygons"],
            &["export", "layer.goblin", "p.geojson", "--polygons"],
        ),
        (
            &["export", "rgb.goblin", "p.geojson", "--polygons"],
            &["export", "classes.goblin", "p.geojson", "--polygons"],
        ),
        (
            &["export", "dem.goblin", "p.geojson", "--polygons"],
            &["export", "classes.goblin", "p.geojson", "--polygons"],
        ),
        (&["transform", "classes.tif", "like=dem.goblin", "-o", "x.goblin"], &["info", "classes.goblin"]),
        (
            &["manifest", "-o", "all.manifest.json", "dem.goblin", "off.goblin"],
            &["manifest", "-o", "all.manifest.json", "dem.goblin", "OTHER.goblin"],
        ),
        (&["build", "tenths.vrt", "ones.vrt", "-o", "x.goblin"], &["verify", "both.goblin"]),
        // The first channel for colours, the heights repeated in three channels for heights.
        (&["edit", "dem.autumn", "paste", "rgb.goblin"], &["info", "OTHER.goblin"]),
        (
            &["combine", "over", "rgb.goblin", "mask.goblin", "-o", "x.goblin"],
            &["combine", "over", "rgb.goblin", "OTHER.goblin", "--extent", "a", "-o", "x.goblin"],
        ),
        (
            &["combine", "and", "dem.goblin", "mask.goblin", "-o", "x.goblin"],
            &["combine", "and", "dem.goblin", "mask_0.goblin", "-o", "x.goblin"],
        ),
        (
            &["get", "dem.goblin", "x.tif", "--window", "500000,5199900,500100,5200000"],
            &["get", "dem.goblin", "x.tif", "--window", "500000,5199900,500100,5200000", "--in", "world"],
        ),
    ];
    for (command, then) in cases {
        let (is_done, said) = temp.run(command);
        let is_warning = command[1] == "and";
        assert_eq!(is_done, is_warning, "{command:?}: {said}");
        assert!(
            said.contains("--in world") || then.is_empty() || !commands(&said).is_empty(),
            "{command:?}: {said}"
        );
        for advised in commands(&said) {
            temp.done(&advised.iter().map(String::as_str).collect::<Vec<_>>());
        }
        if !then.is_empty() {
            temp.done(then);
        }
    }
    assert_eq!(
        spinney::open(temp.path("x.goblin")).unwrap().statistics(None, &()).unwrap().cells,
        60,
        "what the mask has"
    );
    // A document without a coordinate system is read back without one.
    let plain = Uniform {
        kind: DataKind::Categorical,
        frame: Frame { crs: None, ..here },
        ..Uniform::new(SampleType::U8, 3.0, Frame::identity())
    };
    plain.write(&temp.path("plain.goblin"));
    temp.done(&["-q", "export", "plain.goblin", "plain.geojson", "--polygons"]);
    temp.done(&["-q", "build", "plain.geojson", "--value", "class", "--cell", "10", "-o", "back.goblin"]);
    assert!(temp.done(&["diff", "plain.goblin", "back.goblin"]).contains("blocks     0,"));
}

#[test]
fn classes_are_matched_by_name() {
    let temp = TestDirectory::new();
    let at = |x: f64| frame(10.0, 500_000.0 + x, 5_200_000.0);
    let classes = |number: f64, x: f64, names| Uniform {
        kind: DataKind::Categorical,
        names,
        ..Uniform::new(SampleType::U8, number, at(x))
    };
    classes(1.0, 0.0, &[(1, "forest"), (2, "lake")]).write(&temp.path("a.goblin"));
    classes(1.0, 120.0, &[(1, "lake"), (2, "meadow")]).write(&temp.path("b.goblin"));
    classes(2.0, 240.0, &[(1, "lake"), (2, "meadow")]).write(&temp.path("c.goblin"));
    let said = temp.done(&["combine", "over", "a.goblin", "b.goblin", "c.goblin", "-o", "out.goblin"]);
    assert!(said.contains("lake 1 becomes 2") && said.contains("meadow 2 becomes 3"), "{said}");
    let tree = spinney::open(temp.path("out.goblin")).unwrap();
    let names: Vec<String> =
        tree.metadata().class_names.iter().map(|(number, name)| format!("{number} {name}")).collect();
    assert_eq!(names, ["1 forest", "2 lake", "3 meadow"]);
    let found: Vec<String> = tree
        .statistics(None, &())
        .unwrap()
        .classes
        .iter()
        .map(|(number, cells)| format!("{number}: {cells}"))
        .collect();
    assert_eq!(found, ["1: 120", "2: 120", "3: 120"]);
    // By number, if requested.
    temp.done(&["-q", "combine", "over", "a.goblin", "b.goblin", "-o", "out.goblin", "--classes", "number"]);
    let tree = spinney::open(temp.path("out.goblin")).unwrap();
    assert_eq!(tree.statistics(None, &()).unwrap().classes, [(Number::from(1), 240)]);
    // In an edited file, new names are added with the cells.
    temp.done(&["-q", "combine", "over", "a.goblin", "b.goblin", "-o", "land.autumn"]);
    temp.done(&["-q", "transform", "c.goblin", "translate=0,0", "-o", "moved.goblin"]);
    temp.done(&["edit", "land.autumn", "paste", "c.goblin", "--at", "3,2"]);
    let tree = spinney::open(temp.path("land.autumn")).unwrap();
    assert_eq!(tree.metadata().class_names.values().collect::<Vec<_>>(), ["forest", "lake", "meadow"]);
    assert!(tree.statistics(None, &()).unwrap().classes.iter().any(|(number, _)| *number == Number::from(3)));
    // A table of pairs uses the first file's numbers.
    temp.done(&["-q", "edit", "land.autumn", "paste", "a.goblin"]);
    let table = temp.done(&["-q", "combine", "cross", "land.autumn", "b.goblin", "--json"]);
    assert!(table.contains("\"second\":[2]") || table.contains("\"second\": [\n      2"), "{table}");
}

#[test]
fn colours_with_opacity_lie_over_colours_without() {
    let temp = TestDirectory::new();
    let rgba = [0, 64, 128, 255].map(|opacity| [200, 100, 50, opacity]).as_flattened().repeat(4);
    let header = "P7\nWIDTH 4\nHEIGHT 4\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n";
    std::fs::write(temp.path("rgba.pam"), [header.as_bytes(), &rgba].concat()).unwrap();
    std::fs::write(temp.path("rgb.pam"), [&b"P6 4 4 255\n"[..], &[10, 20, 30].repeat(16)].concat()).unwrap();
    for name in ["rgba", "rgb"] {
        let (from, to) = (format!("{name}.pam"), format!("{name}.goblin"));
        let corner = "10,0,500000,0,-10,5200000";
        temp.done(&["-q", "build", &from, "--crs", "EPSG:32632", "--transform", corner, "-o", &to]);
    }
    let row = |files: [&str; 2]| {
        let said = temp.done(&["combine", "over", files[0], files[1], "-o", "out.goblin"]);
        assert!(said.contains("u8x3 as u8x4"), "{said}");
        [5.0, 15.0, 25.0, 35.0].map(|x| {
            let position = format!("{},5199995", 500_000.0 + x);
            temp.done(&["point", "out.goblin", "--in", "world", &position]).trim().to_string()
        })
    };
    let under = "10,20,30,255";
    assert_eq!(
        row(["rgba.goblin", "rgb.goblin"]),
        [under, "200,100,50,64", "200,100,50,128", "200,100,50,255"]
    );
    assert_eq!(row(["rgb.goblin", "rgba.goblin"]), [under; 4]);
}

#[test]
fn lengths_of_solids_are_converted() {
    let temp = TestDirectory::new();
    let unit = |name: &str, cell: f64| {
        let solid = Uniform {
            dimension: Dimension::Oct,
            size: [10, 10, 10],
            frame: Frame {
                matrix: [[cell, 0.0, 0.0, 0.0], [0.0, cell, 0.0, 0.0], [0.0, 0.0, cell, 0.0]],
                ..Frame::identity()
            },
            ..Uniform::new(SampleType::U8, 255.0, Frame::identity())
        };
        let form = TreeType::new(Dimension::Oct, ValueType::new(SampleType::U8, 1));
        let cells = Cells { form, size: solid.size, cells: vec![Some(form.value.nearest(|_| 255.0)); 1000] };
        let mut options = options(Rule::Occupancy, DataKind::Continuous, cells.depth());
        options.metadata.frame = solid.frame.clone();
        options.metadata.set_tag(Tag::Unit, name);
        write_cells(&temp.path(&format!("{name}.goblin")), &cells, &options);
    };
    unit("m", 0.1);
    unit("mm", 100.0);
    for operation in ["union", "and"] {
        temp.done(&["-q", "combine", operation, "m.goblin", "mm.goblin", "-o", "out.goblin"]);
        let tree = spinney::open(temp.path("out.goblin")).unwrap();
        assert_eq!(
            (tree.header().extent, tree.statistics(None, &()).unwrap().cells),
            ([10; 3], 1000),
            "{operation}"
        );
    }
    assert!(temp.done(&["diff", "m.goblin", "mm.goblin"]).contains("blocks     0,"));
}

/// Boxes on cells of other sizes and directions, against analytic volumes.
#[test]
fn solids_on_other_cells_are_combined() {
    let temp = TestDirectory::new();
    let block = |name: &str, text: &str, cell: &str| {
        std::fs::write(temp.path("block.csg"), text).unwrap();
        temp.done(&["-q", "build", "block.csg", "--cell", cell, "--edge", "area", "-o", name]);
    };
    block("a.goblin", "block(0,0,0, 8,8,8);", "0.25");
    block("b.goblin", "block(4.1,1,2, 12.3,9,10);", "0.3");
    temp.done(&["-q", "transform", "b.goblin", "rotate=90,x", "-o", "turned.goblin"]);
    let volume = |name: &str| {
        let tree = spinney::open(temp.path(name)).unwrap();
        let cell = tree.metadata().frame.linear().determinant().abs();
        let mean = tree.statistics(None, &()).unwrap();
        mean.channels[0].mean / 255.0 * mean.cells as f64 * cell
    };
    let (own, other) = (512.0, 8.2 * 8.0 * 8.0);
    // Their intersection: x from 4.1 to 8, y from 1 to 8, z from 2 to 8.
    let shared = 3.9 * 7.0 * 6.0;
    for second in ["b.goblin", "turned.goblin"] {
        for (operation, expected) in [
            ("union", own + other - shared),
            ("and", shared),
            ("a-b", own - shared),
            ("xor", own + other - 2.0 * shared),
        ] {
            temp.done(&["-q", "combine", operation, "a.goblin", second, "-o", "out.goblin"]);
            let found = volume("out.goblin");
            assert!(
                (found / expected - 1.0).abs() < 0.04,
                "{operation} {second}: {found}, expected {expected}"
            );
        }
    }
}

#[test]
fn a_file_of_web_maps_is_exported_around_its_data() {
    let temp = TestDirectory::new();
    let input = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");
    temp.done(&["-q", "build", input, "--grid", "xyz", "-o", "world.goblin"]);
    temp.done(&["-q", "export", "world.goblin", "island.tif"]);
    temp.done(&["-q", "build", "island.tif", "-o", "back.goblin"]);
    let [world, back] = ["world.goblin", "back.goblin"].map(|name| spinney::open(temp.path(name)).unwrap());
    assert!(back.header().extent.iter().all(|cells| *cells < 1000) && world.header().extent[0] > 100_000);
    assert!(temp.done(&["diff", "world.goblin", "back.goblin"]).contains("blocks     0,"));
}

#[test]
fn longitudes_go_round_the_world_once() {
    let temp = TestDirectory::new();
    let world = |name: &str, west: f64| {
        let frame =
            Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([10.0, 0.0, west, 0.0, -10.0, 90.0]) };
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, 1));
        let longitude = |index: u64| {
            let east = west + 10.0 * (index % 36) as f64;
            if east >= 180.0 { east - 360.0 } else { east }
        };
        let cells = (0..36 * 18).map(|index| Some(form.value.nearest(|_| longitude(index)))).collect();
        let cells = Cells { form, size: [36, 18, 1], cells };
        let mut options = options(Rule::Mean, DataKind::Continuous, cells.depth());
        options.metadata.frame = frame;
        write_cells(&temp.path(name), &cells, &options);
    };
    world("east.goblin", 0.0);
    world("west.goblin", -180.0);
    assert!(temp.done(&["diff", "west.goblin", "east.goblin"]).contains("blocks     0,"));
    assert!(temp.done(&["diff", "east.goblin", "west.goblin"]).contains("blocks     0,"));
    for step in ["like=west.goblin", "like=west.goblin,extent=a"] {
        temp.done(&["-q", "transform", "east.goblin", step, "-o", "out.goblin"]);
        assert!(temp.done(&["diff", "west.goblin", "out.goblin"]).contains("blocks     0,"), "{step}");
    }
    temp.done(&["-q", "combine", "over", "west.goblin", "east.goblin", "-o", "out.goblin"]);
    assert_eq!(spinney::open(temp.path("out.goblin")).unwrap().header().extent, [36, 18, 1]);
    // A window beyond the seam becomes adjacent to the other one.
    temp.done(&["-q", "transform", "east.goblin", "window=30,0,6,18", "-o", "part.goblin"]);
    temp.done(&["-q", "transform", "west.goblin", "window=18,0,6,18", "-o", "near.goblin"]);
    temp.done(&["-q", "combine", "over", "near.goblin", "part.goblin", "-o", "out.goblin"]);
    assert_eq!(spinney::open(temp.path("out.goblin")).unwrap().header().extent, [12, 18, 1]);
}
