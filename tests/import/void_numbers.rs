//! The nodata value of outputs: no value equals it, and VOID never becomes a value.

use std::path::{Path, PathBuf};

use spinney::export::{
    ArrayRequest, CogRequest, Detail, WindowRequest, export_array, export_cog, export_window,
};
use spinney::import::raster::{ImportOptions, plan};
use spinney::raw::export::image::{Format, ImageSpec, create};
use spinney::raw::export::{export_layers, void_number, window_rows};
use spinney::{
    DataKind, Dataset, Dimension, Error, Metadata, Number, Output, Progress, Rule, SampleType, TreeType,
    Value, ValueType,
};

use crate::common::{Cells, Random, options, shared_data, value_types, with, write_cells};

/// Columns and rows of the trees, not aligned to blocks.
const SIZE: [u64; 3] = [37, 21, 1];

/// Values of some cells, each with all its samples; `None` is VOID.
type Found = Vec<Option<Vec<u8>>>;

/// Returns a tree of cells with this nodata value.
fn tree(path: &Path, cells: &Cells, nodata: Option<Number>, rule: Rule) -> Dataset {
    let kind = if rule == Rule::Mean { DataKind::Continuous } else { DataKind::Categorical };
    let metadata = Metadata { nodata, ..Metadata::default() };
    write_cells(path, cells, &options(rule, kind, cells.depth()).metadata(metadata));
    spinney::open(path).unwrap()
}

/// Returns the cells of a window from the tree, by flags instead of nodata.
fn reference(tree: &Dataset, request: &WindowRequest) -> Found {
    let size = tree.header().form.value.size();
    let mut found = Vec::new();
    window_rows(tree, request, &(), &mut |bytes, valid| {
        let cells = bytes.chunks_exact(size).zip(valid);
        found.extend(cells.map(|(value, valid)| valid.then(|| value.to_vec())));
        Ok(())
    })
    .unwrap();
    found
}

/// Returns the cells of an image, with or without a trailing opacity sample that encodes VOID.
fn seen(path: &Path, value: ValueType) -> Found {
    let tree = built(path);
    let channels = tree.header().form.value.channels;
    assert!([value.channels, value.channels + 1].contains(&channels), "{channels} channels of {value}");
    assert_eq!(tree.header().form.value.sample, value.sample);
    let request = WindowRequest::new(tree.header().extent_bounds(), Detail::Level(tree.depth()));
    // Pixels of opacity 0 keep their colours.
    let is_seen =
        |bytes: &Vec<u8>| channels == value.channels || bytes[value.size()..].iter().any(|byte| *byte > 0);
    let cells = reference(&tree, &request).into_iter();
    cells.map(|cell| cell.filter(is_seen).map(|bytes| bytes[..value.size()].to_vec())).collect()
}

/// Returns the cells of a raster file, as an import reads them.
fn imported(path: &Path, size: usize) -> Found {
    let tree = built(path);
    assert_eq!(tree.header().form.value.size(), size);
    reference(&tree, &WindowRequest::new(tree.header().extent_bounds(), Detail::Level(tree.depth())))
}

/// Returns the tree of a raster file.
fn built(path: &Path) -> Dataset {
    let again = path.with_extension("goblin");
    plan(&[path.to_path_buf()], &ImportOptions::new())
        .unwrap()
        .build(Output::create(&again).unwrap(), &())
        .unwrap();
    spinney::open(&again).unwrap()
}

/// Returns the cells at the end of a file of samples with a nodata value.
fn samples(path: &Path, value: ValueType, cells: usize, void: Number) -> Found {
    let bytes = std::fs::read(path).unwrap();
    let void = value.nearest_numbers(|_| void).to_bytes();
    let is_void = |cell: &[u8]| cell == &void[..value.size()] || value.is_nan(Value::from_bytes(cell));
    let cells = bytes[bytes.len() - cells * value.size()..].chunks_exact(value.size());
    cells.map(|cell| (!is_void(cell)).then(|| cell.to_vec())).collect()
}

/// Collects warnings.
#[derive(Default)]
struct Warnings(std::sync::Mutex<Vec<String>>);

impl Progress for Warnings {
    fn warn(&self, _: &Path, text: &str) {
        self.0.lock().unwrap().push(text.into());
    }
}

/// Returns cells with all values of a byte in each channel, or with few values; some are VOID.
fn cells_of(value: ValueType, seed: u64, is_full: bool) -> Cells {
    let form = TreeType::new(Dimension::Quad, value);
    let mut cells = Cells::noise(form, seed, SIZE, 40);
    if is_full {
        let mut random = Random(seed);
        for cell in cells.cells.iter_mut().flatten() {
            let mut bytes = [0; 16];
            bytes[..value.size()].fill_with(|| random.next() as u8);
            *cell = Value::from_bytes(&bytes[..value.size()]);
        }
        // Each channel has both extremes in any case.
        let ends = [f64::NEG_INFINITY, f64::INFINITY].map(|end| value.sample.nearest(end.into()));
        let mut values = cells.cells.iter_mut().flatten();
        for end in ends {
            *values.next().unwrap() = value.nearest_numbers(|_| end);
        }
    }
    cells
}

#[test]
fn void_stays_void_and_values_stay_values_in_every_format() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    for (index, value) in value_types().into_iter().enumerate() {
        for is_full in [false, true] {
            if is_full && value.sample.is_float() {
                continue;
            }
            let cells = cells_of(value, index as u64, is_full);
            let inside = value.first_number(cells.cells.iter().flatten().nth(3).copied().unwrap());
            let high = value.sample.nearest(f64::INFINITY.into());
            let free = if value.sample.is_float() { Number::from(-9999.0) } else { high };
            for (rule, nodata) in [
                (Rule::Mean, None),
                (Rule::Mean, Some(inside)),
                (Rule::Majority, Some(free)),
                (Rule::Majority, Some(inside)),
                (Rule::Mean, Some((-12_345_678).into())),
            ] {
                let tree = tree(&name("t.goblin"), &cells, nodata, rule);
                let void = void_number(&tree).unwrap();
                assert_eq!(void.is_none(), is_full, "{value} {nodata:?}");
                for detail in
                    [Detail::Level(tree.depth()), Detail::Level(tree.depth() - 1), Detail::Size(9, 5)]
                {
                    let what = format!("{value} {rule} {nodata:?} {detail:?} {is_full}");
                    let request = WindowRequest::new(tree.header().extent_bounds(), detail);
                    let expected = reference(&tree, &request);
                    export_window(
                        &tree,
                        &request,
                        Output::create(&name("a.tif")).unwrap(),
                        Format::Tiff,
                        &(),
                    )
                    .unwrap();
                    assert!(imported(&name("a.tif"), value.size()) == expected, "{what}");
                    let has_opacity = matches!(value.sample, SampleType::U8 | SampleType::U16);
                    if has_opacity && [1, 3].contains(&value.channels) {
                        let output = Output::create(&name("a.png")).unwrap();
                        export_window(&tree, &request, output, Format::Png, &()).unwrap();
                        assert!(seen(&name("a.png"), value) == expected, "PNG: {what}");
                    }
                    if value.sample == SampleType::F32 {
                        let output = Output::create(&name("a.exr")).unwrap();
                        export_window(&tree, &request, output, Format::Exr, &()).unwrap();
                        assert!(seen(&name("a.exr"), value) == expected, "EXR: {what}");
                    }
                    for (format, end) in [(Format::Npy, "a.npy"), (Format::Raw, "a.raw")] {
                        let written =
                            export_window(&tree, &request, Output::create(&name(end)).unwrap(), format, &());
                        match (void, expected.contains(&None)) {
                            (None, true) => {
                                assert!(matches!(written, Err(Error::Unsupported { .. })), "{what}")
                            }
                            (None, false) => {}
                            (Some(void), _) => {
                                written.unwrap();
                                assert!(
                                    samples(&name(end), value, expected.len(), void) == expected,
                                    "{what}"
                                );
                            }
                        }
                    }
                }
                let request = WindowRequest::new(tree.header().extent_bounds(), Detail::Level(tree.depth()));
                let summary =
                    export_cog(&tree, &CogRequest::new(), Output::create(&name("c.tif")).unwrap(), &())
                        .unwrap();
                assert_eq!(summary.has_masks, is_full);
                assert!(imported(&name("c.tif"), value.size()) == reference(&tree, &request));
                // Explicit nodata values.
                for (number, is_good) in [(inside, false), (free, !is_full)] {
                    let request = with(request.clone(), |it| it.nodata = Some(number));
                    for format in [Format::Tiff, Format::Npy] {
                        let output = Output::create(&name("b")).unwrap();
                        let written = export_window(&tree, &request, output, format, &());
                        assert_eq!(written.is_ok(), is_good, "{value} {number} {written:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn boxes_of_octrees_have_a_free_number_for_void() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    let value = ValueType::new(SampleType::I16, 1);
    let cells = Cells::noise(TreeType::new(Dimension::Oct, value), 7, [9, 8, 7], 40);
    let tree = tree(&name("t.goblin"), &cells, Some(0.into()), Rule::Mean);
    let void = void_number(&tree).unwrap().unwrap();
    assert_eq!(void, f64::from(i16::MIN));
    let warnings = Warnings::default();
    for level in [tree.depth(), tree.depth() - 1] {
        let request = ArrayRequest::new(tree.extent_at(level), level);
        let bounds = request.bounds;
        let mut valid = vec![false; bounds.volume() as usize];
        let mut bytes = vec![0; 2 * valid.len()];
        tree.window(level, &bounds, 1, &mut bytes, Some(&mut valid)).unwrap();
        let cells = bytes.chunks_exact(2).zip(&valid).map(|(cell, valid)| valid.then(|| cell.to_vec()));
        let expected: Found = cells.collect();
        for (end, format) in [("npy", Format::Npy), ("raw", Format::Raw), ("nrrd", Format::Nrrd)] {
            let path = name(&format!("a.{end}"));
            export_array(&tree, &request, Output::create(&path).unwrap(), format, &warnings).unwrap();
            assert!(samples(&path, value, expected.len(), void) == expected, "{end}");
        }
        let number = with(request, |it| it.nodata = Some(0.into()));
        let error = export_array(&tree, &number, Output::create(&name("b.npy")).unwrap(), Format::Npy, &());
        assert!(error.unwrap_err().to_string().contains("within the values"));
    }
    assert!(warnings.0.lock().unwrap()[0].contains("-32768 as nodata number, since 0"));
}

/// Returns the directory of rasters from public reports.
fn reports(data: &Path) -> PathBuf {
    data.join("hostile/reports/maps")
}

#[test]
fn reported_maps_keep_void_and_values() {
    let Some(data) = shared_data() else { return };
    let data = reports(&data);
    if !data.is_dir() {
        eprintln!("skipped: {} is not there", data.display());
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    let build = |input: &str| {
        let path = name(input).with_extension("goblin");
        let import = plan(&[data.join(input)], &ImportOptions::new()).unwrap();
        import.build(Output::create(&path).unwrap(), &()).unwrap();
        spinney::open(&path).unwrap()
    };
    // Values -10 and 10, whose means equal the nodata value.
    let map = build("mean_nd.tif");
    let whole =
        |tree: &Dataset, level: u8| WindowRequest::new(tree.header().extent_bounds(), Detail::Level(level));
    let mut zeros = 0;
    for level in 0..=map.depth() {
        let request = whole(&map, level);
        let expected = reference(&map, &request);
        zeros += expected.iter().flatten().filter(|value| **value == [0, 0]).count();
        export_window(&map, &request, Output::create(&name("a.tif")).unwrap(), Format::Tiff, &()).unwrap();
        assert!(imported(&name("a.tif"), 2) == expected, "level {level}");
    }
    assert!(zeros > 0);
    // All values of a byte, and a mask.
    let full = build("full_mask.tif");
    let request = whole(&full, full.depth());
    let expected = reference(&full, &request);
    assert!(expected.contains(&None));
    assert_eq!(expected.iter().flatten().collect::<std::collections::BTreeSet<_>>().len(), 256);
    export_window(&full, &request, Output::create(&name("a.tif")).unwrap(), Format::Tiff, &()).unwrap();
    assert!(imported(&name("a.tif"), 1) == expected);
    for format in [Format::Npy, Format::Raw] {
        let written = export_window(&full, &request, Output::create(&name("a")).unwrap(), format, &());
        let error = written.unwrap_err().to_string();
        assert!(error.contains("every number of type u8 is a value") && error.contains(".tif"), "{error}");
    }
    // Two layers whose common nodata value is within the range of values.
    let layers = [build("ndvi0.tif"), build("ndvi1.tif")];
    let request = whole(&layers[0], layers[0].depth());
    export_layers(&layers, &request, Output::create(&name("s.tif")).unwrap(), Format::Tiff, &()).unwrap();
    let value = layers[0].header().form.value;
    let both = imported(&name("s.tif"), 2 * value.size());
    let [first, second] = [0, 1].map(|layer| reference(&layers[layer], &request));
    let stack = plan(&[name("s.tif")], &ImportOptions::new()).unwrap().info().nodata.unwrap();
    let void = value.nearest_numbers(|_| stack).to_bytes()[..value.size()].to_vec();
    for (cell, (first, second)) in both.iter().zip(first.iter().zip(&second)) {
        let expected =
            [first.clone().unwrap_or(void.clone()), second.clone().unwrap_or(void.clone())].concat();
        assert_eq!(cell.clone().unwrap_or([void.clone(), void.clone()].concat()), expected);
    }
}

#[test]
fn mask_files_of_rasters_are_applied() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name);
    let write_image = |path: &Path, [width, height]: [u64; 2], sample: &dyn Fn(u64) -> u8| {
        let value = ValueType::new(SampleType::U8, 1);
        let metadata = Metadata::default();
        let spec = ImageSpec { width, height, value, alpha: false, void: false, metadata };
        let mut writer = create(Output::create(path).unwrap(), Format::Tiff, &spec).unwrap();
        let bytes: Vec<u8> = (0..width * height).map(sample).collect();
        writer.write_rows(&bytes, None).unwrap();
        writer.finish().unwrap();
    };
    write_image(&name("a.tif"), [40, 30], &|at| at as u8);
    write_image(&name("mask.tif"), [40, 30], &|at| if at % 7 == 0 { 0 } else { 255 });
    std::fs::rename(name("mask.tif"), name("a.tif.msk")).unwrap();
    let expected: Found = (0..1200u64).map(|at| (at % 7 != 0).then(|| vec![at as u8])).collect();
    assert!(imported(&name("a.tif"), 1) == expected);
    // A mask of another size is ignored.
    write_image(&name("mask.tif"), [40, 29], &|_| 255);
    std::fs::rename(name("mask.tif"), name("a.tif.msk")).unwrap();
    let error = plan(&[name("a.tif")], &ImportOptions::new()).err().unwrap().to_string();
    assert!(error.contains("40 x 29 pixels") && error.contains("40 x 30"), "{error}");
    if let Some(data) = shared_data().map(|data| reports(&data).join("outer.tif"))
        && data.is_file()
    {
        let import = plan(&[data], &ImportOptions::new()).unwrap();
        import.build(Output::create(&name("o.goblin")).unwrap(), &()).unwrap();
        let tree = spinney::open(name("o.goblin")).unwrap();
        assert!(tree.may_have_void(tree.header().extent_bounds()).unwrap());
    }
}
