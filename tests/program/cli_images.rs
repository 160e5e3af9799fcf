//! Rendered images of values that image formats cannot store.

use std::path::Path;

use spinney::raw::export::image::{Format, ImageSpec, create};
use spinney::raw::import::raster::{self, Pixels};
use spinney::{DataKind, Metadata, Output, Region, Rule, SampleType, Value, ValueType};

use crate::common::command::{command, complaint, stderr};
use crate::common::{Cells, goblin_bytes, made, oct, quad, value_types};

/// Returns the samples of an image.
fn samples(path: &str) -> Vec<u8> {
    let mut raster = raster::open(Path::new(path), &Default::default()).unwrap();
    let mut pixels = Pixels::default();
    let (width, height) = (raster.info().width, raster.info().height);
    raster.read(Region::new(0, 0, width, height), &mut pixels).unwrap();
    pixels.bytes
}

/// Returns heights from -1000 on, with half a metre from cell to cell.
fn heights() -> Cells {
    made(quad(SampleType::F32, 1), [4, 2, 1], |[x, y, _]| {
        let height = -1000.0 + 0.5 * (x + 4 * y) as f32;
        Some(Value::from(height.to_le_bytes()))
    })
}

#[test]
fn every_value_type_becomes_an_image() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, out) = (name("t.goblin"), name("x.png"));
    for value in value_types() {
        for (seed, form) in [(3, quad(value.sample, value.channels)), (4, oct(value.sample, value.channels))]
        {
            for void in [false, true] {
                let cells =
                    Cells::random(form, seed, [9, 7, if form.axes() == 3 { 5 } else { 1 }], 200, void);
                std::fs::write(&tree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
                for size in [&["--size", "4x3"][..], &[], &["--size", "20x20"]] {
                    let run = command(&["get", &tree, &out]).args(size).assert().success().stdout("");
                    let fits = matches!(value.sample, SampleType::U8 | SampleType::U16);
                    assert_eq!(stderr(run).contains("see --style"), !fits, "{form:?}");
                    assert!(!samples(&out).is_empty());
                }
            }
        }
    }
}

#[test]
fn numbers_are_stretched_from_black_to_white() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, out) = (name("t.goblin"), name("x.png"));
    std::fs::write(&tree, goblin_bytes(&heights(), Rule::Mean, DataKind::Continuous)).unwrap();
    let get = |options: &[&str]| {
        let run = command(&["-q", "get", &tree, &out]).args(options).assert().success();
        (stderr(run), samples(&out))
    };
    let (said, greys) = get(&["--range", "-1000,-996.5"]);
    assert_eq!((said.as_str(), &greys[..]), ("", &[0, 36, 73, 109, 146, 182, 219, 255][..]));
    // Percentiles are those of the tree, not of the window.
    let style = r#"{"draw": "ramp", "ramp": "grey", "domain": ["min", "max"]}"#;
    assert_eq!(get(&["--style", style]).1, greys);
    assert_eq!(get(&["--style", style, "--window", "2,0,2,1"]).1, greys[2..4]);
    let (said, greys) = get(&["--range", "-1000,-998"]);
    assert_eq!((said.as_str(), &greys[..]), ("", &[0, 64, 128, 191, 255, 255, 255, 255][..]));
    assert_eq!(get(&["--range", "-998,-1000"]).1[..4], [255, 191, 128, 64]);
    let said = stderr(command(&["get", &tree, &out]).assert().success());
    assert!(said.contains("viridis") && said.contains("--range"), "{said}");
    assert_eq!(get(&["-q"]).0, "");
    // Non-finite values are black or white, and do not count.
    let cells = made(quad(SampleType::F64, 1), [2, 2, 1], |[x, y, _]| {
        let number = [[f64::NEG_INFINITY, 1.0], [2.0, f64::INFINITY]][y as usize][x as usize];
        Some(Value::from(number.to_le_bytes()))
    });
    std::fs::write(&tree, goblin_bytes(&cells, Rule::Nearest, DataKind::Continuous)).unwrap();
    assert_eq!(get(&["--range", "1,2"]).1, [0, 0, 255, 255]);
    // 8-bit values can be stretched, too.
    let cells = made(quad(SampleType::U8, 1), [2, 1, 1], |[x, _, _]| Some(Value::from([10 + x as u8])));
    std::fs::write(&tree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    assert_eq!(get(&[]), (String::new(), vec![10, 11]));
    assert_eq!(get(&["--range", "10,11"]).1, [0, 255]);
    for wrong in ["1,1", "1", "nan,1", "0,inf"] {
        assert!(complaint(&["get", &tree, &out, "--range", wrong], 2).contains("two numbers"), "{wrong}");
    }
    command(&["get", &tree, &name("x.tif"), "--range", "10,11"]).assert().success();
    assert_eq!(samples(&name("x.tif")), [0, 255]);
}

#[test]
fn unsupported_values_name_a_format_that_supports_them() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let tree = name("t.goblin");
    for sample in SampleType::ALL {
        let cells = Cells::random(quad(sample, 1), 3, [5, 5, 1], 9, true);
        std::fs::write(&tree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
        let holds = matches!(sample, SampleType::F32 | SampleType::U32);
        let run = command(&["get", &tree, &name("x.exr")]).assert().code(if holds { 0 } else { 1 });
        let said = stderr(run);
        assert!(holds || said.contains("write .png") || said.contains("write .tif"), "{said}");
    }
    for other in ["x.jpg", "x.gif", "x", "x.ply"] {
        let said = complaint(&["get", &tree, &name(other)], 1);
        assert!(said.contains(".png, .webp, .tif, .exr, .npy, .nrrd or .raw"), "{said}");
    }
}

#[test]
fn black_stays_black_with_opacity() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    // Transparent, black, half black, white.
    let cells = [[0, 0, 0, 0], [0, 0, 0, 255], [0, 0, 0, 128], [255, 255, 255, 255]];
    let spec = ImageSpec {
        width: 4,
        height: 1,
        value: ValueType::new(SampleType::U8, 4),
        alpha: true,
        void: false,
        metadata: Metadata::default(),
    };
    let image = name("in.tif");
    let mut writer = create(Output::create(image.as_ref()).unwrap(), Format::Tiff, &spec).unwrap();
    writer.write_rows(&cells.concat(), None).unwrap();
    writer.finish().unwrap();
    command(&["-q", "build", &image, "-o", &name("t.goblin")]).assert().success();
    for out in ["out.tif", "out.png"].map(name) {
        command(&["-q", "get", &name("t.goblin"), &out]).assert().success();
        assert_eq!(samples(&out), cells.concat(), "{out}");
        let raster = raster::open(out.as_ref(), &Default::default()).unwrap();
        assert_eq!((raster.info().nodata, raster.info().alpha), (None, Some(3)), "{out}");
    }
}

#[test]
fn class_names_have_no_sidecar_on_standard_output() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("out.tif");
    let classes = "fixtures/v1/classes.goblin";
    let run = command(&["-q", "get", classes, "-", "--format", "tif"]).assert().success();
    std::fs::write(&path, &run.get_output().stdout).unwrap();
    let info = raster::open(&path, &Default::default()).unwrap().info().clone();
    assert!(info.class_names.contains(&(4.into(), "forest".into())));
    // A sidecar file has one.
    command(&["-q", "get", classes, path.to_str().unwrap()]).assert().success();
    assert!(directory.path().join("out.tif.aux.xml").exists());
    let sidecar = raster::open(&path, &Default::default()).unwrap().info().clone();
    assert_eq!(sidecar.class_names, info.class_names);
}

#[test]
fn nodata_of_one_band_counts_nowhere() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    // Half of the pixels have nodata in red.
    let pixels: Vec<u8> =
        (0..64 * 64).flat_map(|i| [if i % 2 == 0 { 0 } else { 100 }, 50, 1 + (i % 64) as u8]).collect();
    let metadata = Metadata { nodata: Some(0.0.into()), ..Metadata::default() };
    let value = ValueType::new(SampleType::U8, 3);
    let spec = ImageSpec { width: 64, height: 64, value, alpha: false, void: false, metadata };
    let mut writer = create(Output::create(name("in.tif").as_ref()).unwrap(), Format::Tiff, &spec).unwrap();
    writer.write_rows(&pixels, None).unwrap();
    writer.finish().unwrap();
    for tree in ["t.goblin", "t.autumn"].map(name) {
        command(&["-q", "build", &name("in.tif"), "-o", &tree]).assert().success();
        let stats = |options: &[&str]| {
            let run = command(&[&["stats", &tree, "--json"], options].concat()).assert().success();
            let json: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
            let channel = |i: usize| json["channels"][i].clone();
            let number = |i: usize, name: &str| channel(i)[name].as_f64();
            (
                json["cells"].as_u64(),
                number(0, "cells"),
                number(0, "min"),
                number(0, "mean"),
                number(2, "mean"),
            )
        };
        assert_eq!(stats(&[]), (Some(4096), Some(2048.0), Some(100.0), Some(100.0), Some(32.5)));
        assert_eq!(stats(&["--window", "0,0,1,1"]), (Some(1), Some(0.0), None, None, Some(1.0)));
        let point = command(&["point", &tree, "--in", "cells", "0,0", "--level", "0"]).assert().success();
        assert_eq!(String::from_utf8_lossy(&point.get_output().stdout).trim(), "100,50,33");
        if tree.ends_with("autumn") {
            // Edits keep the metadata of whole nodes right.
            command(&["-q", "edit", &tree, "fill", "--window", "0,0,2,1", "--value", "0,7,9"])
                .assert()
                .success();
            let mean = (32.5 * 4096.0 - 3.0 + 18.0) / 4096.0;
            assert_eq!(stats(&[]), (Some(4096), Some(2047.0), Some(100.0), Some(100.0), Some(mean)));
        }
        command(&["-q", "verify", &tree]).assert().success();
        command(&["-q", "get", &tree, &name("out.tif")]).assert().success();
        let raster = raster::open(name("out.tif").as_ref(), &Default::default()).unwrap();
        assert_eq!(raster.info().nodata, Some(0.into()));
        assert!(tree.ends_with("autumn") || samples(&name("out.tif")) == pixels);
    }
}

#[test]
fn colours_below_opacity_are_kept_unless_steps_say_else() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    // Transparent red, black and no colour at all; half blue.
    let cells = [[200, 10, 0, 0], [0, 0, 0, 0], [9, 9, 9, 0], [0, 0, 250, 128]];
    let value = ValueType::new(SampleType::U8, 4);
    let spec =
        ImageSpec { width: 4, height: 1, value, alpha: true, void: false, metadata: Metadata::default() };
    let image = name("in.png");
    let mut writer = create(Output::create(image.as_ref()).unwrap(), Format::Png, &spec).unwrap();
    writer.write_rows(&cells.concat(), None).unwrap();
    writer.finish().unwrap();
    let built = |options: &[&str], view: &[&str]| {
        command(&[&["-q", "build", &image, "-o", &name("t.goblin")], options].concat()).assert().success();
        let outputs = ["out.tif", "out.png"].map(name);
        outputs.map(|out| {
            command(&[&["-q", "get", &name("t.goblin"), &out], view].concat()).assert().success();
            samples(&out)
        })
    };
    let void = [[0; 4], [0; 4], [0; 4], cells[3]].concat();
    assert_eq!(built(&[], &["--view", "opaque"]), [void.clone(), void]);
    for options in [&[][..], &["--keep-transparent"]] {
        assert_eq!(built(options, &[]), [cells.concat(), cells.concat()]);
    }
    let raster = raster::open(name("out.tif").as_ref(), &Default::default()).unwrap();
    assert_eq!((raster.info().nodata, raster.info().alpha), (None, Some(3)));
}

#[test]
fn images_of_any_size_are_averages_of_the_covered_cells() {
    let (columns, rows) = (1000, 600);
    // Hills, and roughness.
    let height = |x: u64, y: u64| {
        let rough = ((x * 2_654_435_761) ^ (y * 40_503)).wrapping_mul(2_246_822_519) >> 13 & 63;
        (1000.0 * (x as f64 / 37.0).sin() * (y as f64 / 23.0).cos() + rough as f64) as f32
    };
    let cells = made(quad(SampleType::F32, 1), [columns, rows, 1], |[x, y, _]| {
        Some(Value::from(height(x, y).to_le_bytes()))
    });
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, out) = (name("t.goblin"), name("x.raw"));
    std::fs::write(&tree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    // The mean deviation of a pixel from its area's mean; differences are at most 2000. It is 0 if
    // each pixel has an integer number of the level's cells.
    let error = |width: u64, height_: u64, exact: &[&str]| {
        let size = format!("{width}x{height_}");
        command(&["get", "-q", &tree, &out, "--size", &size]).args(exact).assert().success();
        let bytes = std::fs::read(&out).unwrap();
        let pixels = bytes.chunks(4).map(|bytes| f64::from(f32::from_le_bytes(bytes.try_into().unwrap())));
        let mut sum = 0.0;
        for (i, pixel) in pixels.enumerate() {
            let (column, row) = (i as u64 % width, i as u64 / width);
            let span = |i: u64, cells: u64, pixels: u64| (i as f64, cells as f64 / pixels as f64);
            let ((u, du), (v, dv)) = (span(column, columns, width), span(row, rows, height_));
            let (mut total, mut area) = (0.0, 0.0);
            for y in (v * dv) as u64..(((v + 1.0) * dv).ceil() as u64).min(rows) {
                for x in (u * du) as u64..(((u + 1.0) * du).ceil() as u64).min(columns) {
                    let share = |at: u64, first: f64, step: f64| {
                        ((at + 1) as f64).min((first + 1.0) * step) - (at as f64).max(first * step)
                    };
                    let weight = share(x, u, du) * share(y, v, dv);
                    total += weight * f64::from(height(x, y));
                    area += weight;
                }
            }
            sum += (pixel - total / area).abs();
        }
        sum / (width * height_) as f64
    };
    for (width, height, most) in [
        (300, 170, 0.001),
        (43, 21, 20.0),
        (90, 50, 20.0),
        (125, 75, 0.001),
        (250, 75, 0.001),
        (17, 11, 20.0),
    ] {
        let rough = error(width, height, &[]);
        assert!(rough < most, "{width} x {height}: {rough}");
        let exact = error(width, height, &["--exact"]);
        assert!(exact < 0.0001, "{width} x {height}, exact: {exact}");
    }
}

/// Writes a gray image in each format that is decoded as a whole, in addition to PNG.
fn in_all_formats(directory: &Path) -> Vec<String> {
    let gray = image::GrayImage::from_fn(40, 30, |x, y| image::Luma([(x * 5 + y) as u8]));
    let gray = image::DynamicImage::from(gray);
    let write = |name: &str, image: &image::DynamicImage| {
        let path = directory.join(name).to_str().unwrap().to_string();
        image.save(&path).unwrap();
        path
    };
    let rgb = gray.to_rgb8().into();
    let mut names = vec![write("a.pgm", &gray), write("a.tga", &gray)];
    names.extend(["a.bmp", "a.ppm", "a.qoi", "a.webp", "b.tga"].map(|name| write(name, &rgb)));
    names.push(write("a.gif", &gray.to_rgba8().into()));
    names.push(write("a.hdr", &gray.to_rgb32f().into()));
    names
}

#[test]
fn images_that_are_decoded_as_a_whole() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, out) = (name("t.goblin"), name("x.tif"));
    for file in in_all_formats(directory.path()) {
        command(&["-q", "build", &file, "-o", &tree]).assert().success().stderr("");
        command(&["-q", "get", &tree, &out]).assert().success();
        assert!(samples(&out) == samples(&file), "{file}");
        // Neither a tree nor a name of one.
        assert!(complaint(&["info", &file], 1).contains("spinney build"), "{file}");
        assert!(complaint(&["build", &file, "-o", &name("t.bmp")], 1).contains("t.goblin"));
        if !file.ends_with(".webp") {
            assert!(complaint(&["get", &tree, &file], 1).contains("unknown format"), "{file}");
        }
    }
    // Mosaics of several formats, georeferenced by world files.
    for (number, file) in ["a.bmp", "a.ppm", "a.qoi"].iter().enumerate() {
        let world = format!("1\n0\n0\n-1\n{}.5\n99.5\n", 40 * number);
        std::fs::write(directory.path().join(file).with_extension(["bpw", "pmw", "qoiw"][number]), world)
            .unwrap();
    }
    let inputs = [name("a.bmp"), name("a.ppm"), name("a.qoi")];
    let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
    command(&[&["-q", "build", "-o", &tree][..], &inputs].concat()).assert().success();
    command(&["-q", "get", &tree, &out, "--window", "80,0,40,30"]).assert().success();
    assert!(samples(&out) == samples(inputs[2]));
    command(&["-q", "build", "--stack", "-o", &tree, &name("a.gif"), &name("b.tga")]).assert().success();
    // A warning reports what is not read.
    let frames = "tests/import/images/whole/frames.gif";
    let said = stderr(command(&["build", frames, "-o", &tree]).assert().success());
    assert!(said.contains("frames after the first of 2 are not read"), "{said}");
}
