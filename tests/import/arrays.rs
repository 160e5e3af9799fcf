//! Octrees from arrays: sections in images, raw samples, and NRRD files, which are also written.

use std::fs;
use std::path::{Path, PathBuf};

use spinney::export::{ArrayRequest, export_array};
use spinney::import::volume::{VolumeImport, VolumeOptions, plan};
use spinney::raw::export::image::Format;
use spinney::raw::import::volume::{RawLayout, plan_raw, plan_sections};
use spinney::{Bounds, Dataset, Number, Output, SampleType};

use crate::common::{Random, with};

fn png(path: &Path, [width, height]: [u32; 2], colour: png::ColorType, samples: &[u8]) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(samples).unwrap();
}

fn built(import: spinney::Result<VolumeImport>, directory: &Path) -> spinney::Result<Dataset> {
    let path = directory.join("built.goblin");
    import?.build(Output::create(&path)?, &())?;
    spinney::open(&path)
}

/// Returns all cells; x varies fastest.
fn cells(tree: &Dataset) -> Vec<u8> {
    let bounds = Bounds::of_extent(tree.header().extent);
    let mut bytes = vec![0; bounds.volume() as usize * tree.header().form.value.size()];
    tree.window(tree.depth(), &bounds, 0.0, &mut bytes, None).unwrap();
    bytes
}

#[test]
fn sections_are_planes_in_the_order_of_their_numbers() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let sections = directory.join("sections");
    fs::create_dir(&sections).unwrap();
    let mut random = Random(18);
    let planes: Vec<Vec<u8>> =
        (0..12).map(|_| (0..70 * 41).map(|_| random.below(256) as u8).collect()).collect();
    let paths: Vec<PathBuf> = (0..12).map(|number| sections.join(format!("slice{number}.png"))).collect();
    for (path, plane) in paths.iter().zip(&planes) {
        png(path, [70, 41], png::ColorType::Grayscale, plane);
    }
    fs::write(sections.join("notes.txt"), "not an image").unwrap();
    fs::write(sections.join(".hidden.png"), "not an image").unwrap();
    let expected = planes.concat();
    let options = with(VolumeOptions::new(), |it| {
        it.transform = Some([[0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]]);
    });
    let import = plan_sections(std::slice::from_ref(&sections), &options);
    let layout = &import.as_ref().unwrap().description()[1].1;
    assert!(
        layout.starts_with("12 sections in 12 files: PNG")
            && layout.ends_with("1 other files in directories are left out"),
        "{layout}"
    );
    let tree = built(import, directory).unwrap();
    assert_eq!((tree.header().extent, tree.metadata().frame.matrix[2]), ([70, 41, 12], [0.0, 0.0, 2.0, 0.0]));
    assert_eq!(cells(&tree), expected);
    // In the order of a shell's pattern, and in another order; with little memory.
    let mut listed = paths.clone();
    listed.sort();
    assert_eq!(listed[2], paths[10]);
    let options = with(VolumeOptions::new(), |it| it.memory = Some(1 << 16));
    assert_eq!(cells(&built(plan_sections(&listed, &options), directory).unwrap()), expected);
    listed = paths.iter().rev().cloned().collect();
    let reversed: Vec<u8> = planes.iter().rev().flatten().copied().collect();
    assert_eq!(cells(&built(plan_sections(&listed, &options), directory).unwrap()), reversed);

    let refuse = |inputs: &[PathBuf], expected: &str| {
        let error = built(plan_sections(inputs, &VolumeOptions::new()), directory).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}\nexpected: {expected}");
    };
    png(&paths[7], [70, 40], png::ColorType::Grayscale, &planes[7][..70 * 40]);
    refuse(
        std::slice::from_ref(&sections),
        "slice7.png: a section of 70 x 40 pixels of 1 channels of u8 in a volume with ",
    );
    png(&paths[7], [70, 41], png::ColorType::Rgb, &planes[..3].concat());
    refuse(std::slice::from_ref(&sections), "slice7.png: a section of 70 x 41 pixels of 3 channels of u8");
    fs::write(&paths[7], &fs::read(&paths[8]).unwrap()[..200]).unwrap();
    refuse(std::slice::from_ref(&sections), "slice7.png");
    png(&paths[0], [70, 41], png::ColorType::GrayscaleAlpha, &planes[..2].concat());
    refuse(&paths[..1], "a section of a volume with opacity");
    let empty = directory.join("empty");
    fs::create_dir(&empty).unwrap();
    refuse(&[empty], "a directory without images");
    refuse(&[directory.join("missing")], "missing: cannot open");
}

#[test]
fn raw_samples_have_the_declared_layout() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let raw = directory.join("volume.raw");
    let mut random = Random(3);
    for sample in SampleType::ALL {
        for (channels, is_big_endian, skip) in [(1, false, 0), (1, true, 13), (2, true, 512)] {
            let layout = with(RawLayout::new([9, 70, 5], sample), |it| {
                (it.channels, it.is_big_endian, it.skip) = (channels, is_big_endian, skip);
            });
            let size = sample.size();
            // Small integers, so that floating-point samples are numbers.
            let numbers: Vec<u64> =
                (0..9 * 70 * 5 * u64::from(channels)).map(|_| random.below(100)).collect();
            let bytes: Vec<u8> = numbers
                .iter()
                .flat_map(|number| match sample {
                    SampleType::F32 => (*number as f32).to_le_bytes().to_vec(),
                    SampleType::F64 => (*number as f64).to_le_bytes().to_vec(),
                    _ => number.to_le_bytes()[..size].to_vec(),
                })
                .collect();
            let mut stored = vec![7; skip as usize];
            for sample in bytes.chunks(size) {
                stored.extend_from_slice(sample);
                if is_big_endian {
                    let end = stored.len();
                    stored[end - size..].reverse();
                }
            }
            fs::write(&raw, &stored).unwrap();
            let import = plan_raw(&raw, &layout, &VolumeOptions::new());
            let is_known =
                channels == 1 || matches!(sample, SampleType::U8 | SampleType::U16 | SampleType::F32);
            if !is_known {
                let error = import.err().unwrap().to_string();
                assert!(error.contains("2 channels of"), "{error}");
                continue;
            }
            let tree = built(import, directory).unwrap();
            assert_eq!((tree.header().extent, tree.header().form.value.sample), ([9, 70, 5], sample));
            assert_eq!(cells(&tree), bytes, "{sample:?} {channels}");
        }
    }
    let refuse = |layout: &RawLayout, expected: &str| {
        let error = plan_raw(&raw, layout, &VolumeOptions::new()).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}\nexpected: {expected}");
    };
    fs::write(&raw, vec![0; 24]).unwrap();
    let layout = RawLayout::new([3, 2, 2], SampleType::U16);
    assert!(plan_raw(&raw, &layout, &VolumeOptions::new()).is_ok());
    let expected = "found 24 bytes, expected 25 for 3 x 2 x 2 cells of 1 samples of u16 after 1 bytes";
    refuse(&with(layout, |it| it.skip = 1), expected);
    refuse(&with(layout, |it| it.size = [3, 2, 1]), "expected 12");
    refuse(&with(layout, |it| it.size = [3, 0, 2]), "an empty array");
    refuse(&with(layout, |it| it.size = [u64::MAX, 2, 2]), "a size in bytes that is a 64-bit number");
    refuse(&with(layout, |it| it.skip = u64::MAX), "a size in bytes that is a 64-bit number");
    refuse(&with(layout, |it| it.channels = 9), "9 channels");
}

#[test]
fn volumes_round_trip_through_nrrd() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let (input, output) = (directory.join("in.nrrd"), directory.join("out.nrrd"));
    let head = "NRRD0004\ntype: short\ndimension: 3\nspace: right-anterior-superior\nsizes: 20 70 9\nspace directions: (0.5,0,0) (0,0.25,0) (0,0.5,2)\n\
                space origin: (-10,20,30)\nspace units: \"mm\" \"mm\" \"mm\"\nsample units: HU\nendian: big\nencoding: raw\nscanner:=a\\nb\\\\n: c\n\n";
    let mut random = Random(7);
    let numbers: Vec<i16> = (0..20 * 70 * 9).map(|_| random.below(4000) as i16 - 1000).collect();
    let samples: Vec<u8> = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
    fs::write(&input, [head.as_bytes(), &samples].concat()).unwrap();
    let tree = built(plan(&input, &VolumeOptions::new()), directory).unwrap();
    let write = |bounds: Bounds, level: u8| {
        let output = Output::create(&output).unwrap();
        export_array(&tree, &ArrayRequest::new(bounds, level), output, Format::Nrrd, &()).unwrap();
    };
    write(Bounds::of_extent(tree.header().extent), tree.depth());
    let again = directory.join("again.goblin");
    plan(&output, &VolumeOptions::new()).unwrap().build(Output::create(&again).unwrap(), &()).unwrap();
    let again = spinney::open(&again).unwrap();
    let (read, known) = (again.metadata(), tree.metadata());
    assert_eq!((&read.frame, &read.tags, &read.units), (&known.frame, &known.tags, &known.units));
    assert_eq!(read.tags["scanner"], "a\nb\\n: c");
    assert_eq!(cells(&again), cells(&tree));
    // A window, and a coarser level: cells keep their positions.
    let level = tree.depth() - 1;
    write(Bounds { min: [2, 3, 1], max: [5, 9, 3] }, level);
    let part = directory.join("part.goblin");
    plan(&output, &VolumeOptions::new()).unwrap().build(Output::create(&part).unwrap(), &()).unwrap();
    let part = spinney::open(&part).unwrap();
    assert_eq!(part.header().extent, [3, 6, 2]);
    assert_eq!(
        part.metadata().frame.to_world([1.0, 2.0, 1.0]),
        known.frame.coarser(1).to_world([3.0, 5.0, 2.0])
    );
    let (mut found, mut expected) = ([Number::default(); 4], [Number::default(); 4]);
    assert!(part.point([1, 2, 1], part.depth(), &mut found).unwrap());
    assert!(tree.point([3, 5, 2], level, &mut expected).unwrap());
    assert_eq!(found, expected);
}
