//! Plans of stacks: the layers that files become, and their contents.

use std::fs;
use std::path::{Path, PathBuf};

use spinney::import::raster::{ImportOptions, Stack, StackOptions, plan_stack};
use spinney::import::volume::VolumeOptions;
use spinney::raw::import::raster::{Band, StackLayer, write_stack};
use spinney::raw::import::volume;
use spinney::raw::value::Mask;
use spinney::tree::{Slab, Slabs};
use spinney::{DataKind, Number, Output, Resampling, SampleType};

use crate::common::tiff_file::{Ifd, Values, file};
use crate::common::{Random, with};

/// A directory of images.
struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn new() -> TestDirectory {
        TestDirectory(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, ifds: &[Ifd]) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, file(ifds)).unwrap();
        path
    }

    fn options(&self, change: impl FnOnce(&mut StackOptions)) -> StackOptions {
        with(StackOptions::new(), change)
    }

    /// Returns the cells of a layer; `None` if they are VOID by flags.
    fn cells(&self, layer: &StackLayer) -> Vec<Option<Vec<u8>>> {
        let mut slabs = layer.slabs(self.0.path(), 1 << 24, &()).unwrap();
        assert_eq!(slabs.extent(), layer.extent);
        let [width, height, _] = layer.extent;
        let mut cells = vec![None; (width * height) as usize];
        let mut slab = Slab::default();
        let mut seen = 0;
        while slabs.next(&mut slab).unwrap() {
            for (i, bytes) in slab.bytes.chunks_exact(layer.value.size()).enumerate() {
                let (x, y) =
                    (slab.origin[0] + i as u64 % slab.size[0], slab.origin[1] + i as u64 / slab.size[0]);
                let valid = slab.valid.as_ref().is_none_or(|valid| valid[i]);
                cells[(y * width + x) as usize] = valid.then(|| bytes.to_vec());
                seen += 1;
            }
        }
        assert_eq!(seen, cells.len());
        cells
    }
}

/// Returns cells of bytes.
fn bytes(cells: Vec<Option<Vec<u8>>>) -> Vec<u8> {
    cells.into_iter().flat_map(|cell| cell.unwrap()).collect()
}

/// Georeferences an image by its corner and pixel width.
fn placed(ifd: Ifd, corner: [f64; 2], width: f64) -> Ifd {
    let keys = [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32632];
    ifd.tag(33550, Values::Double(vec![width, width, 0.0]))
        .tag(33922, Values::Double(vec![0.0, 0.0, 0.0, corner[0], corner[1], 0.0]))
        .short(34735, &keys)
}

const CORNER: [f64; 2] = [300000.0, 5000040.0];

fn noise(random: &mut Random, count: usize) -> Vec<u8> {
    (0..count).map(|_| random.below(256) as u8).collect()
}

fn names(stack: &Stack) -> Vec<&str> {
    stack.layers.iter().map(|layer| layer.name.as_str()).collect()
}

fn refused(inputs: &[PathBuf], options: &StackOptions) -> String {
    plan_stack(inputs, options).unwrap_err().to_string()
}

#[test]
fn resolutions_are_levels_and_repetitions() {
    let temp = TestDirectory::new();
    let mut random = Random(5);
    let mut inputs = Vec::new();
    let mut pixels = Vec::new();
    // Pixel widths, levels above the finest, and cells per pixel.
    let cases = [("B02", 10, 0, 1), ("B05", 20, 1, 1), ("B01", 60, 1, 3), ("B10", 50, 0, 5), ("W", 80, 3, 1)];
    for (name, width, ..) in cases {
        let side = 1200 / width;
        pixels.push(noise(&mut random, side * side));
        let ifd = Ifd::grey(side as u16, side as u16, pixels.last().unwrap().clone());
        inputs.push(temp.write(&format!("{name}.tif"), &[placed(ifd, CORNER, width as f64)]));
    }
    let stack = plan_stack(&inputs, &StackOptions::new()).unwrap();
    assert_eq!(names(&stack), ["B02", "B05", "B01", "B10", "W"]);
    assert_eq!((stack.extent, stack.depth), ([120, 120, 1], 7));
    assert_eq!(stack.frame.affine(), [10.0, 0.0, CORNER[0], 0.0, -10.0, CORNER[1]]);
    for ((layer, pixels), (_, width, coarser, repeat)) in stack.layers.iter().zip(&pixels).zip(cases) {
        assert_eq!((layer.coarser, layer.repeat), (coarser, repeat), "{}", layer.name);
        let side = 1200 / width;
        let wide = side as u64 * repeat;
        assert_eq!(layer.extent, [wide, wide, 1]);
        let cell = f64::from(10 << coarser);
        assert_eq!(layer.metadata.frame.affine(), [cell, 0.0, CORNER[0], 0.0, -cell, CORNER[1]]);
        let expected = (0..wide * wide)
            .map(|i| pixels[(i / wide / repeat) as usize * side + (i % wide / repeat) as usize]);
        assert!(bytes(temp.cells(layer)).into_iter().eq(expected), "{}", layer.name);
    }
    // Times apply to layers, or to files.
    let day = |day: usize| format!("2024-05-{day:02}");
    let with_times = |times: Vec<String>| {
        let mut options = StackOptions::new();
        options.times = Some(times);
        plan_stack(&inputs, &options)
    };
    let timed = with_times((1..=5).map(day).collect()).unwrap();
    let times = timed.layers.iter().map(|layer| layer.metadata.time.clone());
    assert!(times.eq((1..=5).map(|number| Some(day(number)))));
    for (text, about) in
        [("May", "`May`"), ("2024-05-01T1", "ISO 8601"), ("2024", "one for each of 5 layers, or of 5 files")]
    {
        let refusal = with_times(vec![text.into()]).unwrap_err().to_string();
        assert!(refusal.contains(about), "{refusal}");
    }
    let lines: Vec<_> = stack.description().iter().filter(|(heading, _)| *heading == "layer").collect();
    assert!(lines[2].1.contains("6 times as wide: 3 x 3 cells each"), "{lines:?}");
    // Sources that only read from top to bottom are repeated, too.
    let path = temp.0.path().join("P.png");
    let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 200, 300);
    encoder.set_color(png::ColorType::Grayscale);
    let grey = noise(&mut random, 200 * 300);
    encoder.write_header().unwrap().write_image_data(&grey).unwrap();
    fs::write(path.with_extension("pgw"), "30\n0\n0\n-30\n300015\n5000025\n").unwrap();
    fs::write(path.with_extension("prj"), "EPSG:32632").unwrap();
    let stack = plan_stack(&[inputs[0].clone(), path], &StackOptions::new()).unwrap();
    assert_eq!((stack.extent, stack.layers[1].repeat), ([600, 900, 1], 3));
    let expected = (0..600 * 900).map(|i| grey[i / 600 / 3 * 200 + i % 600 / 3]);
    assert!(bytes(temp.cells(&stack.layers[1])).into_iter().eq(expected));
}

#[test]
fn grids_that_do_not_fit_are_refused() {
    let temp = TestDirectory::new();
    let grey = |side: u16| Ifd::grey(side, side, vec![1; usize::from(side).pow(2)]);
    let first = temp.write("first.tif", &[placed(grey(30), CORNER, 10.0)]);
    let options = StackOptions::new();
    let with_first = |name: &str, ifd: Ifd| {
        let other = temp.write(name, &[ifd]);
        plan_stack(&[other, first.clone()], &options)
            .map(|stack| (stack.layers[0].coarser, stack.layers[0].repeat))
    };
    let [x, y] = CORNER;
    // A thousandth of a cell is tolerated; other extents are allowed.
    assert_eq!(with_first("near.tif", placed(grey(15), [x + 0.01, y], 20.0)).unwrap(), (1, 1));
    assert_eq!(with_first("small.tif", placed(grey(3), CORNER, 10.0)).unwrap(), (0, 1));
    for (name, corner, width) in [
        ("shifted", [x + 0.2, y], 10.0),
        ("half", CORNER, 15.0),
        ("odd", CORNER, 20.1),
        ("many", CORNER, 10010.0),
    ] {
        let error =
            with_first(&format!("{name}.tif"), placed(grey(15), corner, width)).unwrap_err().to_string();
        assert!(error.contains(&format!("{name}.tif")) && error.contains("first.tif"), "{error}");
        assert!(error.contains("--resampling"), "{error}");
    }
    let flat = placed(grey(15), CORNER, 20.0).tag(33550, Values::Double(vec![20.0, 10.0, 0.0]));
    assert!(with_first("flat.tif", flat).is_err());
    let other_zone =
        placed(grey(15), CORNER, 20.0).short(34735, &[1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32633]);
    assert!(with_first("zone.tif", other_zone).unwrap_err().to_string().contains("EPSG:32633"));
    assert!(with_first("nowhere.tif", grey(15)).unwrap_err().to_string().contains("nowhere.tif"));
    // Without georeferencing, sizes have to agree.
    let [a, b, c] =
        [("a.tif", 9), ("b.tif", 9), ("c.tif", 18)].map(|(name, side)| temp.write(name, &[grey(side)]));
    assert_eq!(plan_stack(&[a.clone(), b], &options).unwrap().extent, [9, 9, 1]);
    assert!(refused(&[a, c], &options).contains("world file"));
    assert!(refused(&[], &options).contains("at least one"));
}

#[test]
fn every_band_is_a_layer() {
    let temp = TestDirectory::new();
    let mut random = Random(6);
    for case in 0..30 {
        let bands = 1 + random.below(40) as usize;
        let planar = case % 2 == 0;
        let [width, height] = [1 + random.below(20), 1 + random.below(20)];
        let (bits, format, sample) =
            [(8, 1, SampleType::U8), (16, 2, SampleType::I16), (32, 3, SampleType::F32)][case % 3];
        let (area, size) = ((width * height) as usize, sample.size());
        let planes: Vec<Vec<u8>> = (0..bands).map(|_| noise(&mut random, area * size)).collect();
        let chunks = if planar {
            planes.clone()
        } else {
            let pixels =
                (0..area).flat_map(|i| planes.iter().map(move |plane| &plane[i * size..(i + 1) * size]));
            vec![pixels.flatten().copied().collect()]
        };
        let each = |value| vec![value; bands];
        let ifd = Ifd::grey(width as u16, height as u16, Vec::new()).chunks(&chunks);
        let ifd = ifd.short(258, &each(bits)).short(339, &each(format)).short(277, &[bands as u16]);
        let input = temp.write("scene.tif", &[ifd.short(284, &[if planar { 2 } else { 1 }])]);
        let stack = plan_stack(&[input], &StackOptions::new()).unwrap();
        assert_eq!(stack.layers.len(), bands);
        for (number, (layer, plane)) in stack.layers.iter().zip(&planes).enumerate() {
            let name = if bands == 1 { "scene".into() } else { format!("scene_{}", number + 1) };
            assert_eq!((&layer.name, layer.value.sample, layer.value.channels), (&name, sample, 1));
            assert!(&bytes(temp.cells(layer)) == plane, "{name} of {bands}");
        }
    }
}

const TAGS: &str = "<GDALMetadata>
  <Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">B04, red</Item>
  <Item name=\"DESCRIPTION\" sample=\"1\" role=\"description\">B08, near infrared</Item>
  <Item name=\"COLORINTERP\" sample=\"1\" role=\"colorinterp\">NIR</Item>
  <Item name=\"SCALE\" sample=\"1\" role=\"scale\">0.5</Item>
  <Item name=\"UNITTYPE\" sample=\"1\" role=\"unittype\">m</Item>
  <Item name=\"wave\" sample=\"1\">842</Item>
  <Item name=\"satellite\">S2</Item>
</GDALMetadata>";

#[test]
fn layers_have_the_metadata_of_their_bands() {
    let temp = TestDirectory::new();
    let ifd = Ifd::grey(2, 1, vec![1, 2, 3, 4, 5, 6]).short(258, &[8; 3]).short(277, &[3]);
    let input = temp.write("s.tif", &[ifd.tag(42112, Values::Text(TAGS)).tag(42113, Values::Text("6"))]);
    let sidecar = "<PAMDataset><PAMRasterBand band=\"3\"><NoDataValue>3</NoDataValue><CategoryNames><Category>a</Category></CategoryNames>\
        <ColorTable><Entry c1=\"1\" c2=\"2\" c3=\"3\"/></ColorTable></PAMRasterBand></PAMDataset>";
    fs::write(temp.0.path().join("s.tif.aux.xml"), sidecar).unwrap();
    let stack = plan_stack(std::slice::from_ref(&input), &StackOptions::new()).unwrap();
    assert_eq!(names(&stack), ["B04", "B08", "s_3"]);
    let [red, infrared, classes] = &stack.layers[..] else { panic!() };
    assert_eq!(
        (red.nodata, red.kind, red.description.as_str()),
        (Some(6.into()), DataKind::Continuous, "B04, red")
    );
    assert_eq!((infrared.colour_role.as_str(), infrared.nodata), ("NIR", Some(6.into())));
    assert_eq!(infrared.metadata.scale_offset, [(0.5, 0.0)]);
    assert_eq!(
        (infrared.metadata.units[0].as_str(), infrared.metadata.tags["satellite"].as_str()),
        ("m", "S2")
    );
    assert_eq!(infrared.metadata.scoped_tags.len(), 1);
    assert!(red.metadata.scoped_tags.is_empty() && red.metadata.scale_offset.is_empty());
    assert_eq!(
        (classes.nodata, classes.kind, classes.rule.name()),
        (Some(3.into()), DataKind::Categorical, "majority")
    );
    assert!(classes.metadata.palette.is_some() && classes.metadata.class_names.len() == 1);
    assert!(red.metadata.palette.is_none() && red.metadata.class_names.is_empty());
    // Bands by name, in another order, with other nodata values and names.
    let options = temp.options(|it| {
        it.import.bands = Some(vec![Band::Name("B08".into()), Band::Number(1)]);
        it.import.nodata = Some(1.into());
        it.names = Some(vec!["x".into(), "y".into()]);
    });
    let stack = plan_stack(std::slice::from_ref(&input), &options).unwrap();
    assert_eq!(names(&stack), ["x", "y"]);
    assert_eq!(stack.layers[0].nodata, Some(1.into()));
    assert_eq!(bytes(temp.cells(&stack.layers[0])), [2, 5]);
    // Invalid names.
    let named = |names: &[&str]| {
        temp.options(|it| it.names = Some(names.iter().map(|name| name.to_string()).collect()))
    };
    let inputs = std::slice::from_ref(&input);
    assert!(refused(inputs, &named(&["a", "b"])).contains("3, one per layer"));
    assert!(
        refused(inputs, &named(&["a", "b", "a"])).contains("band 1 of")
            && refused(inputs, &named(&["a", " ", "c"])).contains("band 2")
    );
    assert!(refused(&[input.clone(), input.clone()], &StackOptions::new()).contains("--names"));
}

#[test]
fn colour_images_are_one_layer() {
    let temp = TestDirectory::new();
    let pixels = vec![1, 2, 3, 0, 4, 5, 6, 9];
    let rgba = Ifd::grey(2, 1, pixels).short(258, &[8; 4]).short(277, &[4]).short(262, &[2]).short(338, &[2]);
    let colour = temp.write("colour.tif", std::slice::from_ref(&rgba));
    let stack = plan_stack(std::slice::from_ref(&colour), &StackOptions::new()).unwrap();
    assert_eq!((names(&stack), stack.layers[0].value.channels), (vec!["colour"], 4));
    assert_eq!(stack.layers[0].value.mask, Mask::Alpha);
    assert_eq!(temp.cells(&stack.layers[0]), [Some(vec![1, 2, 3, 0]), Some(vec![4, 5, 6, 9])]);
    // Selected bands become separate layers.
    let options = temp.options(|it| it.import.bands = Some(vec![3.into(), 4.into()]));
    let stack = plan_stack(&[colour], &options).unwrap();
    assert_eq!(names(&stack), ["colour_3", "colour_4"]);
    assert_eq!(bytes(temp.cells(&stack.layers[0])), [3, 6]);
    // Opacity of other bands is a layer, and they are VOID where it is 0.
    let opacity = temp.write("other.tif", &[rgba.short(262, &[1]).short(338, &[0, 0, 2])]);
    let stack = plan_stack(std::slice::from_ref(&opacity), &StackOptions::new()).unwrap();
    let cells: Vec<_> = stack.layers.iter().map(|layer| temp.cells(layer)).collect();
    let one = |first: Option<u8>, second: u8| vec![first.map(|byte| vec![byte]), Some(vec![second])];
    assert_eq!(cells, [one(None, 4), one(None, 5), one(None, 6), one(Some(0), 9)]);
    let options = temp.options(|it| it.import.keep_transparent = true);
    let stack = plan_stack(&[opacity], &options).unwrap();
    assert_eq!(bytes(temp.cells(&stack.layers[1])), [2, 5]);
}

#[test]
fn bands_of_a_virtual_raster_have_types_of_their_own() {
    let temp = TestDirectory::new();
    temp.write("a.tif", &[Ifd::grey(2, 1, vec![1, 2])]);
    temp.write("b.tif", &[Ifd::grey(2, 1, vec![1, 0, 0, 1]).short(258, &[16])]);
    let band = |number: u8, kind: &str, name: &str| {
        format!(
            "<VRTRasterBand dataType=\"{kind}\" band=\"{number}\"><Description>{name}</Description><SimpleSource>\
             <SourceFilename relativeToVRT=\"1\">{name}.tif</SourceFilename></SimpleSource></VRTRasterBand>"
        )
    };
    let bands = [band(1, "Byte", "a"), band(2, "UInt16", "b")].concat();
    let path = temp.0.path().join("v.vrt");
    fs::write(&path, format!("<VRTDataset rasterXSize=\"2\" rasterYSize=\"1\">{bands}</VRTDataset>"))
        .unwrap();
    let stack = plan_stack(&[path], &StackOptions::new()).unwrap();
    let about: Vec<_> = stack.layers.iter().map(|layer| (layer.name.as_str(), layer.value.sample)).collect();
    assert_eq!(about, [("a", SampleType::U8), ("b", SampleType::U16)]);
    assert_eq!(
        (bytes(temp.cells(&stack.layers[0])), bytes(temp.cells(&stack.layers[1]))),
        (vec![1, 2], vec![1, 0, 0, 1])
    );
}

#[test]
fn pages_are_layers() {
    let temp = TestDirectory::new();
    let page = |value: u8| Ifd::grey(2, 2, vec![value; 4]);
    let overview = Ifd::grey(1, 1, vec![9]).short(254, &[1]);
    let mask = Ifd::grey(2, 2, vec![1, 0, 1, 1]).short(254, &[4]);
    let input = temp.write("p.tif", &[page(1), overview, page(2), mask, page(3)]);
    assert!(refused(std::slice::from_ref(&input), &StackOptions::new()).contains("--pages"));
    let options = temp.options(|it| it.every_page = true);
    let stack = plan_stack(std::slice::from_ref(&input), &options).unwrap();
    assert_eq!(names(&stack), ["p_0", "p_1", "p_2"]);
    // The mask belongs to the page before it.
    let cell = |value: u8| Some(vec![value]);
    assert_eq!(temp.cells(&stack.layers[0]), vec![cell(1); 4]);
    assert_eq!(temp.cells(&stack.layers[1]), [cell(2), None, cell(2), cell(2)]);
    assert_eq!(temp.cells(&stack.layers[2]), vec![cell(3); 4]);
    let options = temp.options(|it| it.import.page = Some(2));
    assert_eq!(bytes(temp.cells(&plan_stack(&[input], &options).unwrap().layers[0])), [3; 4]);
    // No limit on the number of pages.
    let many: Vec<Ifd> = (0..3000u16).map(|number| Ifd::grey(1, 1, vec![number as u8])).collect();
    let input = temp.write("many.tif", &many);
    let stack = plan_stack(&[input], &temp.options(|it| it.every_page = true)).unwrap();
    assert_eq!(stack.layers.len(), 3000);
    assert_eq!(bytes(temp.cells(&stack.layers[2999])), [2999u16 as u8]);
}

#[test]
fn thousands_of_files_are_closed() {
    let temp = TestDirectory::new();
    let inputs: Vec<PathBuf> = (0..3000u16)
        .map(|number| temp.write(&format!("{number}.tif"), &[Ifd::grey(1, 1, vec![number as u8])]))
        .collect();
    let open_files = || fs::read_dir("/proc/self/fd").map_or(0, |files| files.count());
    let before = open_files();
    let stack = plan_stack(&inputs, &StackOptions::new()).unwrap();
    assert_eq!(stack.layers.len(), 3000);
    // Concurrent tests open files, too.
    assert!(open_files() < before + 500);
    assert_eq!(bytes(temp.cells(&stack.layers[1234])), [1234u16 as u8]);
    // A file that has changed since.
    temp.write("1234.tif", &[Ifd::grey(2, 1, vec![1, 2])]);
    assert!(stack.layers[1234].slabs(Path::new("."), 1 << 24, &()).is_err());
    assert!(
        stack.description().iter().any(|(heading, text)| *heading == "input" && text.ends_with("2988 more"))
    );
}

#[test]
fn a_stack_of_one_raster_equals_the_raster() {
    let temp = TestDirectory::new();
    let mut random = Random(9);
    let image = placed(Ifd::grey(300, 280, noise(&mut random, 300 * 280)), CORNER, 10.0);
    let input = temp.write("b.tif", &[image.tag(42113, Values::Text("7"))]);
    let inputs = std::slice::from_ref(&input);
    let [one, other] = ["one.goblin", "other.goblin"].map(|name| temp.0.path().join(name));
    let stack = plan_stack(inputs, &StackOptions::new()).unwrap();
    write_stack(&stack, Output::create(&one).unwrap(), &()).unwrap();
    spinney::import::raster::plan(inputs, &ImportOptions::new())
        .unwrap()
        .build(Output::create(&other).unwrap(), &())
        .unwrap();
    assert!(fs::read(one).unwrap() == fs::read(other).unwrap());
}

#[test]
fn pages_are_planes_of_a_volume() {
    let temp = TestDirectory::new();
    let mut random = Random(11);
    let out = temp.0.path().join("v.goblin");
    for (bits, bands) in [(8u16, 1usize), (16, 1), (8, 3)] {
        let size = bits as usize / 8 * bands;
        let planes: Vec<Vec<u8>> = (0..5).map(|_| noise(&mut random, 70 * 66 * size)).collect();
        let page = |plane: &Vec<u8>| {
            let rows: Vec<Vec<u8>> = plane.chunks(70 * 9 * size).map(<[u8]>::to_vec).collect();
            let ifd =
                Ifd::grey(70, 66, Vec::new()).chunks(&rows).short(278, &[9]).short(258, &vec![bits; bands]);
            placed(ifd.short(277, &[bands as u16]).short(262, &[if bands == 3 { 2 } else { 1 }]), CORNER, 2.0)
        };
        let input = temp.write("v.tif", &planes.iter().map(page).collect::<Vec<_>>());
        let options = with(VolumeOptions::new(), |it| it.nodata = (bands == 1).then_some(5.into()));
        volume::plan_sections(std::slice::from_ref(&input), &options)
            .unwrap()
            .build(Output::create(&out).unwrap(), &())
            .unwrap();
        let tree = spinney::open(&out).unwrap();
        assert_eq!((tree.header().extent, tree.depth()), ([70, 66, 5], 7));
        assert_eq!(tree.metadata().frame.matrix[0], [2.0, 0.0, 0.0, CORNER[0]]);
        assert_eq!(tree.metadata().frame.matrix[2], [0.0, 0.0, 1.0, 0.0]);
        for _ in 0..300 {
            let [x, y, z] = [random.below(70), random.below(66), random.below(5)];
            let at = (y * 70 + x) as usize * size;
            let bytes = &planes[z as usize][at..at + size];
            let expected: Vec<f64> = match bits {
                8 => bytes.iter().map(|byte| f64::from(*byte)).collect(),
                _ => vec![f64::from(u16::from_le_bytes([bytes[0], bytes[1]]))],
            };
            let mut found = [Number::default(); 4];
            let is_there = tree.point([x, y, z], tree.depth(), &mut found).unwrap();
            assert_eq!(is_there, bands > 1 || expected != [5.0], "{x} {y} {z}");
            assert!(!is_there || found[..bands].iter().map(|n| n.to_f64()).eq(expected), "{x} {y} {z}");
        }
    }
    // Pages of different sizes, or with masks.
    let grey = |side: u16| Ifd::grey(side, side, vec![1; usize::from(side).pow(2)]);
    let uneven = temp.write("uneven.tif", &[grey(3), grey(3), grey(4)]);
    let error = volume::plan_sections(std::slice::from_ref(&uneven), &VolumeOptions::new())
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("page 2 has 4 x 4"), "{error}");
    let mask = grey(3).short(254, &[4]).chunks(&[vec![0; 9]]);
    let masked = temp.write("masked.tif", &[grey(3), mask, grey(3)]);
    let made = volume::plan_sections(std::slice::from_ref(&masked), &VolumeOptions::new())
        .unwrap()
        .build(Output::create(&out).unwrap(), &());
    assert!(made.unwrap_err().to_string().contains("masks"));
}

/// Scenes on one grid with different extents: the stack covers their bounding box.
#[test]
fn scenes_on_one_grid_have_their_union() {
    let temp = TestDirectory::new();
    let mut random = Random(31);
    let [x, y] = CORNER;
    // Corners in cells of 10 m, pixel width in cells, pixels per side.
    let scenes = [
        ([3, 2], 1, 20usize),
        ([0, 5], 1, 7),
        ([4, 8], 2, 6),
        ([5, 1], 4, 3),
        ([40, 30], 3, 2),
        ([8, 5], 4, 3),
    ];
    let (mut paths, mut all) = (Vec::new(), Vec::new());
    for (number, (corner, wide, side)) in scenes.into_iter().enumerate() {
        let pixels = noise(&mut random, side * side);
        let corner = [x + 10.0 * f64::from(corner[0]), y - 10.0 * f64::from(corner[1])];
        let grey = Ifd::grey(side as u16, side as u16, pixels.clone());
        paths.push(temp.write(&format!("{number}.tif"), &[placed(grey, corner, 10.0 * f64::from(wide))]));
        all.push(pixels);
    }
    let stack = plan_stack(&paths, &StackOptions::new()).unwrap();
    assert_eq!(stack.extent, [46, 35, 1]);
    assert_eq!(stack.frame.affine(), [10.0, 0.0, x, 0.0, -10.0, y - 10.0]);
    for ((layer, pixels), (corner, wide, side)) in stack.layers.iter().zip(all).zip(scenes) {
        let cell = 1usize << layer.coarser;
        let [across, down, _] = layer.extent.map(|cells| cells as usize);
        let cells = temp.cells(layer);
        assert_eq!(cells.len(), across * down);
        for (index, found) in cells.into_iter().enumerate() {
            let [column, row] = [index % across * cell, index / across * cell];
            let pixel = |at: usize, first: i32| {
                let into = at.checked_sub(first as usize)? / wide as usize;
                (into < side).then_some(into)
            };
            let expected = match (pixel(column, corner[0]), pixel(row, corner[1] - 1)) {
                (Some(x), Some(y)) => Some(vec![pixels[y * side + x]]),
                _ => None,
            };
            assert_eq!(found, expected, "{} at {column}, {row}", layer.name);
        }
    }
    // The largest cells that divide both the corner and the pixels.
    let levels: Vec<_> = stack.layers.iter().map(|layer| (layer.coarser, layer.repeat)).collect();
    assert_eq!(levels, [(0, 1), (0, 1), (0, 2), (0, 4), (0, 3), (2, 1)]);
}

/// Bands that do not form one value become layers, without `--stack`.
#[test]
fn bands_that_are_no_colours_become_layers() {
    let temp = TestDirectory::new();
    let out = temp.0.path().join("out.goblin");
    for (bands, bits, format) in [(13u16, 16u16, 1u16), (2, 16, 2), (3, 64, 3), (3, 32, 1)] {
        let bytes = vec![7u8; 16 * usize::from(bands) * usize::from(bits / 8)];
        let ifd = Ifd::grey(4, 4, bytes)
            .short(258, &vec![bits; bands.into()])
            .short(277, &[bands])
            .short(339, &vec![format; bands.into()]);
        let path = temp.write("bands.tif", &[ifd]);
        let path = path.to_str().unwrap();
        let build = |more: &[&str]| {
            let args = [&["build", path, "-o", out.to_str().unwrap()], more].concat();
            crate::common::command::command(&args).output().unwrap()
        };
        let made = build(&[]);
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let said = String::from_utf8(made.stdout).unwrap() + &String::from_utf8(made.stderr).unwrap();
        assert!(said.contains("a layer of each"), "{said}");
        let layers = spinney::raw::ops::TreeFile::open(&out, &Default::default()).unwrap().layers().unwrap();
        assert_eq!(layers.len(), usize::from(bands));
        spinney::build(path, &out).unwrap();
        assert_eq!(
            spinney::raw::ops::TreeFile::open(&out, &Default::default()).unwrap().layers().unwrap(),
            layers
        );
        // A single selected band is a tree.
        assert!(build(&["--band", "2"]).status.success());
        let layers = spinney::raw::ops::TreeFile::open(&out, &Default::default()).unwrap().layers().unwrap();
        assert_eq!(layers.len(), 1);
    }
}

#[test]
fn other_grids_are_warped_if_that_is_said() {
    let temp = TestDirectory::new();
    let mut random = Random(12);
    let first = temp.write("first.tif", &[placed(Ifd::grey(30, 30, vec![1; 900]), CORNER, 10.0)]);
    let pixels = noise(&mut random, 256);
    // Pixels of 15 m, one to the right of and below the corner; and of 45 m.
    let [x, y] = CORNER;
    let second =
        temp.write("second.tif", &[placed(Ifd::grey(16, 16, pixels.clone()), [x + 15.0, y - 15.0], 15.0)]);
    let coarse = noise(&mut random, 36);
    let third = temp.write("third.tif", &[placed(Ifd::grey(6, 6, coarse.clone()), [x + 1.0, y], 45.0)]);
    let options = temp.options(|it| it.resampling = Some(Resampling::Nearest));
    let stack = plan_stack(&[first, second.clone(), third], &options).unwrap();
    let about: Vec<_> =
        stack.layers.iter().map(|layer| (layer.coarser, layer.repeat, layer.extent)).collect();
    assert_eq!(about, [(0, 1, [30, 30, 1]), (0, 0, [30, 30, 1]), (2, 0, [8, 8, 1])]);
    assert_eq!(stack.layers[2].metadata.frame.affine(), [40.0, 0.0, x, 0.0, -40.0, y]);
    let check = |layer: &StackLayer, cell: f64, start: f64, width: f64, side: usize, pixels: &[u8]| {
        let [across, ..] = layer.extent;
        let pixel = |at: u64, start: f64| {
            let found = ((at as f64 + 0.5) * cell - start) / width;
            (found >= 0.0 && found < side as f64).then_some(found as usize)
        };
        for (at, found) in (0..).zip(temp.cells(layer)) {
            let start_y = if start == 1.0 { 0.0 } else { start };
            let source = (pixel(at % across, start), pixel(at / across, start_y));
            let expected =
                if let (Some(x), Some(y)) = source { Some(vec![pixels[y * side + x]]) } else { None };
            assert_eq!(found, expected, "{at} of {}", layer.name);
        }
    };
    check(&stack.layers[1], 10.0, 15.0, 15.0, 16, &pixels);
    check(&stack.layers[2], 40.0, 1.0, 45.0, 6, &coarse);
    assert!(stack.layers[2].to_string().ends_with("warped to cells 4 times as wide"), "{}", stack.layers[2]);
    // Another coordinate system: the next zone, whose grid is rotated.
    let keys = [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32633];
    let zone = placed(Ifd::grey(400, 400, noise(&mut random, 160_000)), [-180_000.0, 5_040_000.0], 50.0)
        .short(34735, &keys);
    let zone = temp.write("zone.tif", &[zone]);
    let stack = plan_stack(&[second, zone.clone()], &options).unwrap();
    assert_eq!((stack.layers[1].extent, stack.layers[1].repeat), ([16, 16, 1], 0));
    assert!(temp.cells(&stack.layers[1]).iter().any(Option::is_some));
    // An image without a frame cannot be warped.
    let nowhere = temp.write("nowhere.tif", &[Ifd::grey(3, 3, vec![1; 9])]);
    assert!(plan_stack(&[zone, nowhere], &options).is_err());
    assert!(
        fs::read_dir(temp.0.path()).unwrap().all(|entry| !entry
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with(".spinney"))
    );
}
