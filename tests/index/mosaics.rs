//! Indexes of several files: mosaics against a naive model, virtual rasters, stacks and pages.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use spinney::import::raster::{ImportOptions, StackOptions};
use spinney::{Bounds, Error};

use crate::common::command::{complaint, spinney};
use crate::common::{Random, with};
use crate::compare::{
    Directory, MEMORY, assert_equal, assert_equal_trees, assert_resolves, build, index, indexed, open, stack,
    tree, window,
};
use crate::tiffs::{Chunks, Packing, Samples, Tiff, pages};

/// Returns a random file of few different numbers, at a random position.
fn random_source(random: &mut Random, (samples, channels): (Samples, usize), has_alpha: bool) -> Tiff {
    let mut below = |bound| random.below(bound);
    let size = [1 + below(50), 1 + below(50)];
    let mut tiff = Tiff { samples, channels, has_alpha, ..Tiff::new(size, 1) };
    tiff.chunks = match below(3) {
        0 => Chunks::Strips(1 + below(9)),
        _ => Chunks::Tiles(16, 16 * (1 + below(2))),
    };
    tiff.packing = [Packing::None, Packing::Deflate, Packing::Lzw][below(3) as usize];
    tiff.origin = Some([below(60) as i64 - 30, below(60) as i64 - 30]);
    tiff.is_planar = channels > 1 && below(2) == 0;
    tiff.is_sparse = below(4) == 0;
    tiff.nodata = [None, Some("0"), Some("2"), Some("1")][below(4) as usize];
    if below(3) == 0 {
        tiff.mask = Some((0..size[0] * size[1]).map(|_| below(3) > 0).collect());
    }
    tiff.pixels = (0..size[0] * size[1] * channels as u64).map(|_| samples.of(2 * below(3) as i64)).collect();
    if matches!(samples, Samples::Float(_)) && below(2) == 0 {
        (0..20).for_each(|_| tiff.set(size.map(&mut below), samples.nan()));
    }
    tiff
}

/// Returns the samples of a pixel; `None` if it is VOID.
fn pixel(tiff: &Tiff, [x, y]: [u64; 2]) -> Option<&[u64]> {
    let at = (y * tiff.size[0] + x) as usize;
    let samples = &tiff.pixels[at * tiff.channels..(at + 1) * tiff.channels];
    let nodata = tiff.nodata.map(|text| match tiff.samples {
        Samples::Float(_) => tiff.samples.of(2 * text.parse::<i64>().unwrap()),
        _ => tiff.samples.of(text.parse().unwrap()),
    });
    let is_void = tiff.mask.as_ref().is_some_and(|mask| !mask[at])
        || nodata.is_some_and(|nodata| samples.iter().all(|sample| *sample == nodata))
        || tiff.has_alpha && samples.last() == Some(&0)
        || matches!(tiff.samples, Samples::Float(_)) && samples.contains(&tiff.samples.nan());
    (!is_void).then_some(samples)
}

#[test]
fn mosaics_equal_a_model() {
    let directory = Directory::new();
    let mut random = Random(66);
    for case in 0..72 {
        let samples = [Samples::Uint(8), Samples::Int(16), Samples::Float(32)][case % 3];
        // (Opacity has another meaning in a single file.)
        let channels = if case % 3 == 1 { 1 } else { [1, 3, 2][case / 3 % 3] };
        let count = 1 + random.below(6).max(u64::from(channels == 2));
        let sources: Vec<Tiff> =
            (0..count).map(|_| random_source(&mut random, (samples, channels), channels == 2)).collect();
        let paths: Vec<PathBuf> = (0..count).map(|number| directory.path(&format!("{number}.tif"))).collect();
        sources.iter().zip(&paths).for_each(|(source, path)| source.write(path));
        let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| directory.path(name));
        build(&paths, &made, &indexed([1, 2, 4][case % 3])).unwrap();
        tree(&paths, &whole);
        let what = format!("case {case}");
        assert_equal(&made, &whole, &what);
        assert_resolves(&made, &whole, &what);

        let starts = |axis: usize| sources.iter().map(move |source| source.origin.unwrap()[axis]);
        let ends = |axis: usize| {
            sources.iter().map(move |source| source.origin.unwrap()[axis] + source.size[axis] as i64)
        };
        let [left, top] = [0, 1].map(|axis| starts(axis).min().unwrap());
        let [right, bottom] = [0, 1].map(|axis| ends(axis).max().unwrap());
        let found = open(&made);
        let extent = [(right - left) as u64, (bottom - top) as u64, 1];
        assert_eq!(found.header().extent, extent);
        let (bytes, valid) = window(&found, found.depth(), &Bounds::of_extent(extent)).unwrap();
        let width = found.header().form.width();
        for (at, (bytes, valid)) in bytes.chunks_exact(width).zip(valid).enumerate() {
            let cell = [left + (at as u64 % extent[0]) as i64, top + (at as u64 / extent[0]) as i64];
            let expected = sources.iter().rev().find_map(|source| {
                let at = [0, 1].map(|axis| u64::try_from(cell[axis] - source.origin.unwrap()[axis]).ok());
                let [Some(x), Some(y)] = at else { return None };
                if x < source.size[0] && y < source.size[1] { pixel(source, [x, y]) } else { None }
            });
            let expected = expected.map(|samples| {
                let size = width / channels;
                samples.iter().flat_map(|sample| sample.to_le_bytes()[..size].to_vec()).collect::<Vec<u8>>()
            });
            assert_eq!(valid.then_some(bytes), expected.as_deref(), "{what}: cell {at}");
        }
    }
}

/// Files that others hide are not read, also if a block has cells that no file has.
#[test]
fn hidden_sources_are_not_read() {
    let cases: [&[([u64; 2], [i64; 2])]; 2] = [
        &[([400, 300], [0, 0]), ([400, 300], [0, 0])],
        &[([64, 64], [0, 0]), ([64, 64], [0, 0]), ([32, 32], [96, 96])],
    ];
    for files in cases {
        let directory = Directory::new();
        let paths: Vec<PathBuf> =
            (0..files.len()).map(|number| directory.path(&format!("{number}.tif"))).collect();
        for (path, (size, origin)) in paths.iter().zip(files) {
            Tiff { origin: Some(*origin), ..Tiff::new(*size, 5) }.filled(size[0]).write(path);
        }
        let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| directory.path(name));
        index(&paths, &made);
        tree(&paths, &whole);
        std::fs::remove_file(&paths[0]).unwrap();
        assert_equal_trees(&open(&made), &open(&whole), &format!("{files:?}"));
    }
}

/// Pages that describe sources are checked even if no cell needs them.
#[test]
fn corrupt_pages_of_hidden_sources_are_found() {
    let directory = Directory::new();
    let path = |number: u32| directory.path(&format!("{number:0100}.tif"));
    let paths: Vec<PathBuf> = (0..200).map(path).collect();
    paths.iter().for_each(|path| Tiff { origin: Some([0, 0]), ..Tiff::new([8, 8], 5) }.filled(3).write(path));
    let made = directory.path("x.goblin");
    index(&paths, &made);
    let mut bytes = std::fs::read(&made).unwrap();
    let name = format!("{:0100}.tif", 7);
    let at = bytes.windows(name.len()).position(|found| found == name.as_bytes()).unwrap();
    bytes[at] ^= 1;
    std::fs::write(&made, bytes).unwrap();
    let tree = open(&made);
    window(&tree, tree.depth(), &Bounds::of_extent([8, 8, 1])).unwrap();
    let findings = [tree.verify(MEMORY, &()).unwrap(), tree.verify_quickly(MEMORY, &()).unwrap()];
    for findings in findings {
        assert!(findings.len() == 1 && findings[0].problem.contains("page of sources"), "{findings:?}");
    }
}

#[test]
fn files_off_the_grid_are_refused() {
    let directory = Directory::new();
    let paths: Vec<PathBuf> = ["a.tif", "b.tif"].iter().map(|name| directory.path(name)).collect();
    let first = Tiff { origin: Some([0, 0]), ..Tiff::new([40, 30], 5) };
    first.write(&paths[0]);
    let other = |change: &dyn Fn(&mut Tiff)| with(first.clone(), |it| change(it));
    for (what, second) in [
        ("without georeference", other(&|it| it.origin = None)),
        ("type", other(&|it| *it = Tiff { samples: Samples::Int(16), ..it.clone() }.filled(1))),
        ("channels", other(&|it| *it = Tiff { channels: 3, ..it.clone() }.filled(1))),
    ] {
        second.write(&paths[1]);
        let error = build(&paths, &directory.path("x.goblin"), &indexed(2)).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. } | Error::Unsupported { .. }), "{what}: {error}");
        assert!(!directory.path("x.goblin").exists());
    }
}

/// Returns the XML of a virtual raster of 70 x 60 pixels with a band.
fn virtual_raster(kind: &str, bands: &[String]) -> String {
    let mut xml = String::from("<VRTDataset rasterXSize=\"70\" rasterYSize=\"60\">\n");
    for (number, sources) in (1..).zip(bands) {
        writeln!(xml, "<VRTRasterBand dataType=\"{kind}\" band=\"{number}\">{sources}</VRTRasterBand>")
            .unwrap();
    }
    xml + "</VRTDataset>\n"
}

/// Returns the XML of a source: its element and inner text, file, band, window, and where it is.
fn source(element: (&str, &str), (file, band): (&str, usize), from: [i64; 4], to: [i64; 4]) -> String {
    let (element, inner) = element;
    let rectangle = |name: &str, [x, y, width, height]: [i64; 4]| {
        format!("<{name} xOff=\"{x}\" yOff=\"{y}\" xSize=\"{width}\" ySize=\"{height}\"/>")
    };
    format!(
        "<{element}><SourceFilename relativeToVRT=\"1\">{file}</SourceFilename><SourceBand>{band}</SourceBand>\
         {}{}{inner}</{element}>",
        rectangle("SrcRect", from),
        rectangle("DstRect", to)
    )
}

const SIMPLE: (&str, &str) = ("SimpleSource", "");

#[test]
fn virtual_rasters() {
    let directory = Directory::new();
    Tiff { mask: Some((0..50 * 40).map(|at| at % 3 > 0).collect()), ..Tiff::new([50, 40], 2) }
        .write(&directory.path("a.tif"));
    Tiff { channels: 3, is_planar: true, ..Tiff::new([64, 33], 1) }.filled(7).write(&directory.path("b.tif"));
    Tiff { samples: Samples::Int(16), ..Tiff::new([50, 40], 1) }.filled(8).write(&directory.path("c.tif"));
    let simple = |file, band, from, to| source(SIMPLE, (file, band), from, to);
    let whole = [0, 0, 50, 40];
    let a = simple("a.tif", 1, whole, whole);
    let two = a.clone() + &simple("b.tif", 2, [5, 3, 40, 30], [30, 25, 40, 30]);
    let beyond = simple("a.tif", 1, whole, [-7, -9, 50, 40]) + &simple("a.tif", 1, whole, [40, 35, 50, 40]);
    let complex = |inner| source(("ComplexSource", inner), ("a.tif", 1), whole, [10, 15, 50, 40]);
    let missing = simple("b.tif", 1, [0, 0, 64, 33], [0, 0, 64, 33]) + &complex("<NODATA>2</NODATA>");
    let nodata = "<NoDataValue>3</NoDataValue>".to_string() + &two;
    let bands = |first: usize| -> Vec<String> {
        let band = |number| simple("b.tif", number, [0, 1, 60, 30], [3, 4, 60, 30]);
        [0, 1, 2].map(|shift| band((first + shift) % 3 + 1)).into()
    };
    for (what, kind, bands) in [
        ("whole", "Byte", vec![a.clone()]),
        ("two", "Byte", vec![two.clone()]),
        ("beyond", "Byte", vec![beyond]),
        ("missing", "Byte", vec![missing]),
        ("nodata", "Byte", vec![nodata]),
        ("bands", "Byte", bands(0)),
        ("other order", "Byte", bands(1)),
        ("no source", "Byte", vec!["<NoDataValue>3</NoDataValue>".into()]),
        ("i16", "Int16", vec![simple("c.tif", 1, whole, whole)]),
    ] {
        let [path, made, tree_path] = ["v.vrt", "x.goblin", "whole.goblin"].map(|name| directory.path(name));
        std::fs::write(&path, virtual_raster(kind, &bands)).unwrap();
        let path = [path];
        build(&path, &made, &indexed(2)).unwrap_or_else(|error| panic!("{what}: {error}"));
        tree(&path, &tree_path);
        assert_equal(&made, &tree_path, what);
        assert_resolves(&made, &tree_path, what);
    }
    // Several virtual rasters, and a file with one.
    std::fs::write(directory.path("w.vrt"), virtual_raster("Byte", std::slice::from_ref(&a))).unwrap();
    let scaled = simple("a.tif", 1, [0, 0, 20, 20], [0, 0, 40, 40]);
    let unlike = {
        let mut unlike = bands(0);
        unlike[1] = simple("b.tif", 1, [0, 0, 60, 30], [3, 4, 60, 30]);
        unlike
    };
    for (what, kind, bands) in [
        ("scaled pixels", "Byte", vec![scaled]),
        ("another type", "Float32", vec![a.clone()]),
        ("a virtual raster", "Byte", vec![simple("w.vrt", 1, [0, 0, 70, 60], [0, 0, 70, 60])]),
        ("unlike bands", "Byte", unlike),
    ] {
        let path = [directory.path("v.vrt")];
        std::fs::write(&path[0], virtual_raster(kind, &bands)).unwrap();
        let made = directory.path("refused.goblin");
        match build(&path, &made, &indexed(2)) {
            Err(error @ Error::Unsupported { .. }) => {
                assert!(error.to_string().contains("`spinney build`"), "{what}: {error}");
                assert!(!made.exists());
                tree(&path, &directory.path("whole.goblin"));
            }
            other => panic!("{what}: {other:?}"),
        }
    }
    let name = directory.name("v.vrt");
    let message = complaint(&["index", &name, "-o", &directory.name("x.goblin"), "--no-external"], 1);
    assert!(message.contains("--no-external"), "{message}");
}

#[test]
fn random_virtual_rasters() {
    let directory = Directory::new();
    let mut random = Random(5);
    for number in 0..3 {
        let tiff = Tiff { channels: 2, ..Tiff::new([30, 25], 1) }.filled(number);
        tiff.write(&directory.path(&format!("{number}.tif")));
    }
    let mut refused = BTreeSet::new();
    let mut indexed_ones = 0;
    for case in 0..60 {
        let mut below = |bound: u64| random.below(bound) as i64;
        let count = 1 + below(2);
        let mut bands = vec![String::new(); count as usize];
        for _ in 0..1 + below(4) {
            let from = [below(20), below(20), 1 + below(10), 1 + below(5)];
            let factor = 1 + below(8) / 7;
            let to = [below(75) - 5, below(65) - 5, from[2] * factor, from[3] * factor];
            let file = format!("{}.tif", below(3));
            let inner = if below(3) == 0 { "<NODATA>1</NODATA>" } else { "" };
            for (number, band) in (1..).zip(&mut bands) {
                let element = if inner.is_empty() { SIMPLE } else { ("ComplexSource", inner) };
                *band += &source(element, (&file, number), from, to);
            }
        }
        let [path, made, whole] = ["v.vrt", "x.goblin", "whole.goblin"].map(|name| directory.path(name));
        std::fs::write(&path, virtual_raster("Byte", &bands)).unwrap();
        let path = [path];
        tree(&path, &whole);
        match build(&path, &made, &indexed(2)) {
            Ok(()) => {
                assert_equal(&made, &whole, &format!("case {case}"));
                indexed_ones += 1;
            }
            Err(error @ Error::Unsupported { .. }) => {
                refused.insert(error.to_string());
            }
            Err(error) => panic!("case {case}: {error}"),
        }
    }
    let are_named = refused.iter().all(|message| message.contains("v.vrt: a virtual raster"));
    assert!(indexed_ones > 20 && refused.len() > 1 && are_named, "{indexed_ones} {refused:?}");
}

/// Compares all layers of two files.
fn assert_equal_layers(found: &Path, expected: &Path, count: usize) {
    let (found, expected) = (open(found), open(expected));
    let layers = expected.layers().unwrap();
    assert_eq!(layers.len(), count);
    let names = |layers: Vec<spinney::raw::ops::LayerInfo>| {
        layers.into_iter().map(|layer| layer.name).collect::<Vec<_>>()
    };
    assert_eq!(names(found.layers().unwrap()), names(expected.layers().unwrap()));
    for layer in layers {
        let [found, expected] = [&found, &expected].map(|file| file.layer(&layer.name).unwrap());
        assert_equal_trees(&found, &expected, &layer.name);
        assert_eq!(found.verify(1 << 20, &()).unwrap(), [], "{}", layer.name);
    }
}

#[test]
fn stacks() {
    let directory = Directory::new();
    let placed = |tiff: Tiff| Tiff { origin: Some([3, 4]), ..tiff };
    let size = [300, 90];
    placed(Tiff { channels: 2, is_planar: true, ..Tiff::new(size, 1) }.filled(3))
        .write(&directory.path("a.tif"));
    placed(
        Tiff { samples: Samples::Float(32), predictor: 3, nodata: Some("nan"), ..Tiff::new(size, 1) }
            .filled(4),
    )
    .write(&directory.path("b.tif"));
    placed(Tiff { samples: Samples::Int(16), nodata: Some("2"), ..Tiff::new(size, 1) }.filled(5))
        .write(&directory.path("c.tif"));
    placed(Tiff { channels: 3, ..Tiff::new(size, 1) }.filled(5)).write(&directory.path("d.tif"));
    let paths: Vec<PathBuf> = ["a", "b", "c", "d"].map(|name| directory.path(&format!("{name}.tif"))).into();
    let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| directory.path(name));
    let options = |import: ImportOptions| with(StackOptions::new(), |it| it.import = import);
    for levels in [1, 2, 4] {
        stack(&paths, &made, &options(indexed(levels))).unwrap();
        stack(&paths, &whole, &options(ImportOptions::new())).unwrap();
        assert_equal_layers(&made, &whole, 5);
    }
    let name = |name: &str| directory.name(name);
    let (a, b, c, made, whole) =
        (name("a.tif"), name("b.tif"), name("c.tif"), name("x.goblin"), name("whole.goblin"));
    let named = ["--names", "red,green,height,depth", "-q", "--stack"];
    for (command, output) in [("index", &made), ("build", &whole)] {
        spinney(&[&[command, &a, &b, &c, "-o", output], &named[..]].concat()).success();
    }
    assert_equal_layers(Path::new(&made), Path::new(&whole), 4);
    assert_eq!(open(Path::new(&made)).layers().unwrap()[2].name, "height");
    // A file whose bands differ needs no option, and layers have times.
    let message = complaint(&["index", &b, "--names", "x", "-o", &made], 1);
    assert!(message.contains("--stack"), "{message}");
}

#[test]
fn pages_of_a_file() {
    let directory = Directory::new();
    let images: Vec<Tiff> = (0..3).map(|seed| Tiff::new([280, 60], seed)).collect();
    let masked = Tiff { mask: Some((0..280 * 60).map(|at| at % 7 > 0).collect()), ..images[1].clone() };
    std::fs::write(directory.path("a.tif"), pages(&[images[0].clone(), masked, images[2].clone()])).unwrap();
    let source = [directory.path("a.tif")];
    let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| directory.path(name));
    let error = build(&source, &made, &indexed(2)).unwrap_err().to_string();
    assert!(error.contains("--pages"), "{error}");
    for page in 0..3 {
        let of_page = |options: ImportOptions| with(options, |it| it.page = Some(page));
        build(&source, &made, &of_page(indexed(2))).unwrap();
        build(&source, &whole, &of_page(ImportOptions::new())).unwrap();
        assert_equal(&made, &whole, &format!("page {page}"));
    }
    let all =
        |import: ImportOptions| with(StackOptions::new(), |it| (it.import, it.every_page) = (import, true));
    stack(&source, &made, &all(indexed(2))).unwrap();
    stack(&source, &whole, &all(ImportOptions::new())).unwrap();
    assert_equal_layers(&made, &whole, 3);
}
