//! Indexes and trees of files, and comparison of the two.

use std::path::{Path, PathBuf};

use spinney::import::raster::{ImportOptions, StackOptions, plan, plan_stack};
use spinney::query::{
    ChannelStatistics, Condition, ContourLevels, ContourRequest, EdgeRule, PointSamples, Polygon,
    PolygonRequest, Statistics, ZonalRequest,
};
use spinney::raw::import::raster::{IndexUpdate, UpdateReport, update_index, write_stack};
use spinney::raw::query::ZoneChannel;
use spinney::{
    Bounds, Codec, DataKind, Dataset, FileView, Metadata, Number, OpenOptions, Output, Result, WriteOptions,
};

use crate::common::{Random, with};

/// Memory for queries.
pub(crate) const MEMORY: u64 = 64 << 20;

/// A directory of a test.
pub(crate) struct Directory(tempfile::TempDir);

impl Directory {
    pub(crate) fn new() -> Directory {
        spinney::raw::register();
        Directory(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Returns the path of a file as an argument of the program.
    pub(crate) fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().into()
    }
}

/// Options of an index with levels between the cells and the finest stored ones.
pub(crate) fn indexed(levels: u8) -> ImportOptions {
    with(ImportOptions::new(), |it| (it.referenced, it.memory) = (Some(levels), Some(MEMORY)))
}

/// Makes a tree or an index of files.
pub(crate) fn build(sources: &[PathBuf], output: &Path, options: &ImportOptions) -> Result<()> {
    plan(sources, options)?.build(Output::create(output)?, &())
}

/// Makes an index of files with two levels between the cells and the finest stored ones.
pub(crate) fn index(sources: &[PathBuf], output: &Path) {
    build(sources, output, &indexed(2)).unwrap();
}

/// Makes a tree of files.
pub(crate) fn tree(sources: &[PathBuf], output: &Path) {
    build(sources, output, &ImportOptions::new()).unwrap();
}

/// Makes a tree or an index whose layers are files and their bands.
pub(crate) fn stack(sources: &[PathBuf], output: &Path, options: &StackOptions) -> Result<()> {
    write_stack(&plan_stack(sources, options)?, Output::create(output)?, &())
}

/// Updates an index.
pub(crate) fn update(
    index: &Path,
    output: &Path,
    change: impl FnOnce(&mut IndexUpdate),
) -> Result<UpdateReport> {
    let update = with(IndexUpdate::default(), |it| it.memory = MEMORY);
    update_index(index, &with(update, change), Output::create(output)?, &())
}

/// Opens a tree, without files that others have opened.
pub(crate) fn open(path: &Path) -> Dataset {
    spinney::open_with(path, &OpenOptions::new()).unwrap()
}

/// Returns the bytes of a window, and which cells are not VOID.
pub(crate) fn window(tree: &Dataset, level: u8, bounds: &Bounds) -> Result<(Vec<u8>, Vec<bool>)> {
    let cells = bounds.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; cells * tree.header().form.width()], vec![false; cells]);
    tree.window(level, bounds, 7.0, &mut bytes, Some(&mut valid))?;
    Ok((bytes, valid))
}

/// Returns a random box of cells within a size.
pub(crate) fn random_box(random: &mut Random, size: [u64; 3]) -> Bounds {
    let min = [0, 1].map(|axis| random.below(size[axis]));
    let max = [0, 1].map(|axis| min[axis] + 1 + random.below(size[axis] - min[axis]));
    Bounds { min: [min[0], min[1], 0], max: [max[0], max[1], 1] }
}

/// Checks that two trees of the same cells return the same results.
pub(crate) fn assert_equal(found: &Path, expected: &Path, what: &str) {
    let (found, expected) = (open(found), open(expected));
    assert_equal_trees(&found, &expected, what);
    assert_eq!(found.verify(MEMORY, &()).unwrap(), [], "{what}");
}

/// Checks that two trees return the same results to all queries.
pub(crate) fn assert_equal_trees(found: &Dataset, expected: &Dataset, what: &str) {
    let (header, other) = (found.header(), expected.header());
    let of =
        |header: &spinney::Header| (header.form, header.kind, header.rule, header.extent, header.depth());
    assert_eq!(of(header), of(other), "{what}");
    let described =
        |tree: &Dataset| Metadata { provenance: Vec::new(), name: String::new(), ..tree.metadata().clone() };
    assert_eq!(described(found), described(expected), "{what}");
    let mut random = Random(header.extent[0] ^ header.extent[1] << 20);
    for level in 0..=found.depth() {
        let all = expected.extent_at(level);
        let boxes = [(); 3].map(|()| random_box(&mut random, all.max));
        for bounds in [all].iter().chain(&boxes).filter(|bounds| bounds.volume() <= 1 << 20) {
            let [found, expected] = [found, expected].map(|tree| window(tree, level, bounds).unwrap());
            assert!(found == expected, "{what}: window {bounds:?} of level {level}");
        }
        let cells: Vec<[u64; 3]> =
            (0..20).map(|_| [random.below(all.max[0] + 1), random.below(all.max[1] + 1), 0]).collect();
        let points = |tree: &Dataset| {
            let mut samples = PointSamples::default();
            tree.points(&cells, level, &mut samples).unwrap();
            let mut number = [Number::default(); 4];
            let single = tree.point(cells[0], level, &mut number).unwrap();
            format!("{samples:?} {single} {number:?}")
        };
        assert_eq!(points(found), points(expected), "{what}: points of level {level}");
    }
    assert_equal_statistics(found, expected, &mut random, what);
    assert_equal_shapes(found, expected, what);
}

/// Compares statistics of boxes and zones, histograms, and blocks by value.
fn assert_equal_statistics(found: &Dataset, expected: &Dataset, random: &mut Random, what: &str) {
    let size = expected.header().extent;
    let all = Bounds::of_extent(size);
    let boxes = [(); 4].map(|()| Some(random_box(random, size)));
    for bounds in [None, Some(all)].into_iter().chain(boxes) {
        let [found, expected] = [found, expected].map(|tree| tree.statistics(bounds, &()).unwrap());
        assert!(alike(&found, &expected), "{what}: {bounds:?}: {found:?}, expected {expected:?}");
    }
    let histogram = |tree: &Dataset| tree.histogram(&all, -2.0, 9.0, 11, &()).unwrap();
    assert_eq!(histogram(found), histogram(expected), "{what}");
    for condition in
        [Condition::Above(3.5.into()), Condition::Below(1.0.into()), Condition::Equal(2.0.into())]
    {
        let blocks = |tree: &Dataset| {
            let mut blocks = Vec::new();
            tree.find(condition, None, &(), &mut |block| {
                blocks.push((block.code, block.value));
                Ok(blocks.len() < 3000)
            })
            .unwrap();
            blocks
        };
        assert!(blocks(found) == blocks(expected), "{what}: {condition:?}");
    }
    let bounds = |tree: &Dataset| format!("{:?}", tree.value_bounds().unwrap());
    assert_eq!(bounds(found), bounds(expected), "{what}");
    let [width, height] = [0, 1].map(|axis| size[axis] as f64);
    let corners = vec![[-0.3, 0.1], [width * 0.9, height * 0.2], [width * 0.4, height * 0.95]];
    let zone = [Polygon::new(&[corners]).unwrap()];
    for edge in [EdgeRule::Centre, EdgeRule::Area] {
        let measures = vec!["majority".parse().unwrap(), "median".parse().unwrap()];
        let request = ZonalRequest { edge, measures, ..ZonalRequest::default() };
        let zones = |tree: &Dataset| tree.zonal(&zone, &request, &()).unwrap().remove(0);
        let (found, expected) = (zones(found), zones(expected));
        assert!(
            is_near(found.cells, expected.cells) && is_near(found.void_cells, expected.void_cells),
            "{what}"
        );
        assert_eq!(found.classes, expected.classes, "{what}");
        for (found, expected) in found.channels.iter().zip(&expected.channels) {
            let extremes = |it: &ZoneChannel| format!("{:?} {:?}", it.min, it.max);
            assert_eq!(extremes(found), extremes(expected), "{what}");
            assert!(is_near(found.sum, expected.sum), "{what}: {found:?}, expected {expected:?}");
            assert_eq!(format!("{:?}", found.values), format!("{:?}", expected.values), "{what}");
        }
    }
}

fn is_near(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-12 * a.abs().max(b.abs())
}

/// Whether statistics are equal, but for the order in which numbers were added.
fn alike(a: &Statistics, b: &Statistics) -> bool {
    let channels = a.channels.iter().zip(&b.channels).all(|(a, b)| {
        // (NaN is not equal to itself.)
        let extremes = |it: &ChannelStatistics| format!("{} {:?} {:?}", it.cells, it.min, it.max);
        extremes(a) == extremes(b)
            && is_near(a.mean, b.mean)
            && (is_near(a.standard_deviation, b.standard_deviation)
                || (a.standard_deviation - b.standard_deviation).abs() <= 1e-9 * a.mean.abs().max(1.0))
    });
    (a.cells, a.void_cells, &a.classes) == (b.cells, b.void_cells, &b.classes)
        && channels
        && a.channels.len() == b.channels.len()
}

/// Compares contours of continuous values, and polygons of classes.
fn assert_equal_shapes(found: &Dataset, expected: &Dataset, what: &str) {
    let shapes = |tree: &Dataset| {
        let mut shapes = Vec::new();
        if tree.header().kind == DataKind::Categorical {
            let request = PolygonRequest::new();
            let done = tree.polygons(&request, &(), &mut |region| {
                let mut points = Vec::new();
                for ring in 0..region.parts() {
                    region.points(ring, &mut |some| {
                        points.extend(some.iter().map(|point| format!("{point:?}")));
                        Ok(())
                    })?;
                }
                shapes.push((format!("{:?} {}", region.class(), region.cells()), points));
                Ok(())
            });
            // (Values of several channels have none.)
            return done.map(|_| shapes).map_err(|error| error.to_string());
        }
        let request = ContourRequest::new(ContourLevels::At(vec![1.25, 2.75]));
        let done = tree.contours(&request, &(), &mut |contour| {
            let mut points = Vec::new();
            for part in 0..contour.parts() {
                contour.points(part, &mut |some| {
                    points.extend(some.iter().map(|point| format!("{point:?}")));
                    Ok(())
                })?;
            }
            shapes.push((format!("{:?}", contour.range()), points));
            Ok(())
        });
        done.map(|_| shapes).map_err(|error| error.to_string())
    };
    let unnamed = |tree: &Dataset| {
        let name = tree.name().display().to_string();
        shapes(tree).map_err(|error| error.replace(&name, ""))
    };
    assert!(unnamed(found) == unnamed(expected), "{what}: contours or polygons");
}

/// Returns the bytes of a file from its header to its metadata: all segments and their index.
pub(crate) fn segments(file: &Path) -> Vec<u8> {
    let bytes = std::fs::read(file).unwrap();
    let layers = crate::targets::seal::layers(&bytes);
    let metadata = crate::targets::seal::long(&bytes, layers[0] + 136) as usize;
    bytes[..metadata].to_vec()
}

/// Checks that a file has no references.
pub(crate) fn assert_whole(file: &Path) {
    let tree = open(file);
    for layer in tree.layers().unwrap() {
        let codec = tree.layer(&layer.name).unwrap().header().codec;
        assert!(matches!(codec, Codec::Plain | Codec::Packed), "{}: {codec:?}", file.display());
    }
    let bytes = std::fs::read(file).unwrap();
    for tag in [b"SRCS", b"SRCP"] {
        assert!(crate::targets::seal::section(&bytes, tag).is_none(), "{}", file.display());
    }
}

/// Writes an index as an ordinary tree, and checks that the segments are those of the tree of its
/// sources.
pub(crate) fn assert_resolves(index: &Path, tree: &Path, what: &str) {
    let whole = index.with_extension("whole.goblin");
    let output = Output::create(&whole).unwrap();
    spinney::transform(&FileView::of(index), output, WriteOptions::new(MEMORY), &()).unwrap();
    assert_whole(&whole);
    assert!(segments(&whole) == segments(tree), "{what}: other segments");
    let described = |path: &Path| Metadata { provenance: Vec::new(), ..open(path).metadata().clone() };
    assert_eq!(described(&whole), described(tree), "{what}");
    std::fs::remove_file(whole).unwrap();
}
