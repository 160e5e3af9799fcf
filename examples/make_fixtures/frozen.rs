//! Contents of the frozen files.

use std::path::Path;

use spinney::brep::{Face, Grid, combine};
use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::brep::ModelBuilder;
use spinney::raw::space::{Cell, GeoKeys};
use spinney::raw::store::{TreeWriter, build_tree, depth_for};
use spinney::raw::value::Palette;
use spinney::tree::MemTree;
use spinney::{
    Bounds, BuildOptions, Codec, Crs, DataKind, Dimension, Error, ExactModel, Frame, Metadata, Output,
    Result, Rule, SampleType, SetOperation, TreeType, Value, ValueType,
};

use super::island::{self, Island};

/// Names of the Goblin files, without `.goblin`.
pub(crate) const FILES: [&str; 8] =
    ["classic", "classes", "elevation", "rgb", "rgba", "ball", "segments", "large"];

/// The raster of the survey's two ten-record tables.
pub(crate) const CLASSIC: [[u8; 8]; 8] = [
    [1, 1, 1, 3, 3, 1, 1, 1],
    [1, 1, 3, 3, 3, 3, 1, 1],
    [1, 1, 3, 3, 3, 2, 1, 1],
    [1, 1, 1, 2, 2, 2, 2, 2],
    [1, 1, 1, 1, 2, 2, 2, 2],
    [1, 1, 1, 1, 2, 2, 2, 2],
    [1, 1, 1, 1, 1, 1, 1, 2],
    [1, 1, 1, 1, 1, 1, 1, 1],
];

/// Stride of the pixels that are kept, in files that should be small.
pub(crate) const STEP: usize = 4;

const BYTE: ValueType = ValueType::new(SampleType::U8, 1);
const QUAD: TreeType = TreeType::new(Dimension::Quad, BYTE);

/// UTM zone 28 north, west of Africa.
pub(crate) fn frame() -> Frame {
    let matrix = [[50.0, 0.0, 0.0, 300_000.0], [0.0, -50.0, 0.0, 3_200_000.0], [0.0, 0.0, 1.0, 0.0]];
    // As in GeoTIFF files: projected, with a citation (at offset 0 of the string, 22 bytes), by its
    // EPSG number.
    let keys = [[1, 1, 0, 3], [1024, 0, 1, 1], [1026, 34737, 22, 0], [3072, 0, 1, 32628]];
    let crs = GeoKeys::new(keys.as_flattened(), &[], b"WGS 84 / UTM zone 28N|").map(Crs::GeoKeys);
    Frame { matrix, crs, pixel_is_point: false }
}

/// Builds one of [`FILES`] at `path`.
pub(crate) fn make(name: &str, island: &Island, path: &Path) -> Result<()> {
    let colours = island::COLOURS.to_vec();
    let class_names =
        island::NAMES.iter().enumerate().map(|(i, name)| ((i as u64).into(), name.to_string())).collect();
    let small = [island::WIDTH.div_ceil(STEP) as u64, island::HEIGHT.div_ceil(STEP) as u64, 1];
    let coarse = |[x, y, _]: [u32; 3]| {
        let inside = (x as u64) < small[0] && (y as u64) < small[1];
        inside.then(|| y as usize * STEP * island::WIDTH + x as usize * STEP)
    };
    match name {
        "classic" => {
            let what = (QUAD, Rule::Dominant, DataKind::Categorical, Metadata::default());
            file(path, [8, 8, 1], what, &|[x, y, _]| Some(Value::from([CLASSIC[y as usize][x as usize]])))
        }
        "classes" => {
            let metadata = Metadata {
                frame: frame(),
                nodata: Some(0.into()),
                palette: Some(Palette { colours }),
                class_names,
                band_names: vec!["land cover".into()],
                provenance: vec!["made by examples/make_fixtures".into()],
                tags: [("AREA_OR_POINT".into(), "Area".into())].into(),
                ..Metadata::default()
            };
            let size = [island::WIDTH as u64, island::HEIGHT as u64, 1];
            file(path, size, (QUAD, Rule::Majority, DataKind::Categorical, metadata), &|[x, y, _]| {
                let inside = (x as usize) < island::WIDTH && (y as usize) < island::HEIGHT;
                let class = inside.then(|| island.cover[y as usize * island::WIDTH + x as usize] as u8);
                class.filter(|class| *class != 0).map(|class| Value::from([class]))
            })
        }
        "elevation" => {
            let elevation = island.elevation();
            let metadata = Metadata {
                frame: frame().coarser(2),
                nodata: Some((-9999).into()),
                band_names: vec!["height".into()],
                scale_offset: vec![(1.0, 0.0)],
                ..Metadata::default()
            };
            let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, 1));
            file(path, small, (form, Rule::Mean, DataKind::Continuous, metadata), &|cell| {
                coarse(cell).and_then(|i| elevation[i]).map(|height| Value::from([height]))
            })
        }
        "rgb" => {
            let image = island.image();
            let band_names = ["red", "green", "blue"].map(String::from).to_vec();
            let metadata = Metadata { frame: frame().coarser(2), band_names, ..Metadata::default() };
            let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 3));
            file(path, small, (form, Rule::Mean, DataKind::Continuous, metadata), &|cell| {
                coarse(cell).map(|i| Value::from(image[i]))
            })
        }
        // The sea is transparent but has a colour; snow is half transparent.
        "rgba" => {
            let image = island.image();
            let band_names = ["red", "green", "blue", "opacity"].map(String::from).to_vec();
            let metadata =
                Metadata { frame: frame().coarser(2), band_names, alpha: Some(3), ..Metadata::default() };
            let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 4).with_alpha());
            file(path, small, (form, Rule::Mean, DataKind::Continuous, metadata), &|cell| {
                coarse(cell).map(|i| rgba(island.cover[i], image[i]))
            })
        }
        "ball" => {
            let form = TreeType::new(Dimension::Oct, BYTE);
            file(path, [32; 3], (form, Rule::Mean, DataKind::Continuous, Metadata::default()), &|cell| {
                let square = |x: u32| (2 * x as i64 - 31) * (2 * x as i64 - 31);
                (cell.into_iter().map(square).sum::<i64>() <= 29 * 29).then_some(Value::from([255u8]))
            })
        }
        // One block with more records than a subtree without its own segment may have, in a tree
        // deep enough to be cut.
        "segments" => {
            let what = (QUAD, Rule::Mean, DataKind::Continuous, Metadata::default());
            file(path, [1000, 300, 1], what, &|[x, y, _]| {
                let speckled = (256..512).contains(&x) && y < 256;
                let number = if speckled { (x / 2 + y / 2) % 2 * 100 } else { x / 256 * 40 };
                (x < 1000 && y < 300).then(|| Value::from([number as u8]))
            })
        }
        // Numbers that are much larger than their differences.
        "large" => {
            let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F64, 1));
            let what = (form, Rule::Mean, DataKind::Continuous, Metadata::default());
            file(path, [50, 30, 1], what, &|[x, y, _]| (x < 50 && y < 30).then(|| Value::from([large(x, y)])))
        }
        other => panic!("no frozen file is called {other}"),
    }
}

/// Returns a cell of "large", whose patches are uniform.
pub(crate) fn large(x: u32, y: u32) -> f64 {
    let difference = if (x / 8 + y / 8).is_multiple_of(3) { 3 } else { (x * x + 3 * y) % 7 };
    4e15 + 0.5 * f64::from(difference)
}

/// Returns the value of a pixel of the image with opacity.
pub(crate) fn rgba(cover: island::Cover, [red, green, blue]: [u8; 3]) -> Value {
    let opacity = match cover {
        island::Cover::Unknown | island::Cover::ShallowSea => 0,
        island::Cover::Snow => 128,
        _ => 255,
    };
    Value::from([red, green, blue, opacity])
}

/// Properties of a file that are set before its cells.
type What = (TreeType, Rule, DataKind, Metadata);

fn file(
    path: &Path,
    size: [u64; 3],
    (form, rule, kind, metadata): What,
    cell: &dyn Fn(Cell) -> Option<Value>,
) -> Result<()> {
    let depth = depth_for(size);
    let tree = MemTree::from_cells(form, depth, rule, cell);
    let options = BuildOptions::new(kind, depth).rule(rule).memory(16 << 20).metadata(metadata);
    build_tree(&tree, size, &options, Output::create(path)?, &()).map(|_| ())
}

/// Builds the frozen Autumnal file: the classic raster, edited and reverted.
pub(crate) fn make_history(island: &Island, path: &Path) -> Result<()> {
    make("classic", island, path)?;
    let note =
        |time, message: &str| Note { time: Some(time), author: "Spinney".into(), message: message.into() };
    let region = FillRegion::Box(Bounds { min: [2, 1, 0], max: [6, 5, 1] });
    edit(path, [Ok(Edit::Fill(region, Some(vec![3.into()])))], note(1, "Fill a box"), 1 << 20, &())?;
    let cells = vec![([0, 0, 0], None), ([7, 7, 0], Some(vec![2.into()]))];
    edit(path, [Ok(Edit::Set(cells))], note(2, "Set two cells"), 1 << 20, &())?;
    edit(path, [Ok(Edit::Revert(1))], note(3, "Back to the beginning"), 1 << 20, &())?;
    // The first page records the editor, which differs each time.
    let mut bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
    bytes[2048..2304].fill(0);
    std::fs::write(path, bytes).map_err(Error::io(path, "write"))
}

/// Names of the frozen files of several layers.
pub(crate) const STACKS: [&str; 2] = ["stack.goblin", "stack.autumn"];

/// Builds a file of several layers, in the format of its name: land cover, heights and colours on
/// cells four times as wide, and 64-bit numbers.
pub(crate) fn make_stack(island: &Island, path: &Path) -> Result<()> {
    let size = [island::WIDTH as u64, island::HEIGHT as u64, 1];
    let small = [size[0].div_ceil(4), size[1].div_ceil(4), 1];
    let depth = depth_for(size);
    let coarse = |[x, y, _]: [u32; 3]| {
        let inside = u64::from(x) < small[0] && u64::from(y) < small[1];
        inside.then(|| y as usize * STEP * island::WIDTH + x as usize * STEP)
    };
    let class = |[x, y, _]: [u32; 3]| {
        let inside = (x as usize) < island::WIDTH && (y as usize) < island::HEIGHT;
        let class = inside.then(|| island.cover[y as usize * island::WIDTH + x as usize] as u8);
        class.filter(|class| *class != 0)
    };
    let named = |name: &str, levels: u8| Metadata {
        name: name.into(),
        frame: frame().coarser(levels),
        time: Some("2020-06-21".into()),
        ..Metadata::default()
    };
    let options = |kind: DataKind, levels: u8, metadata: Metadata| {
        BuildOptions::new(kind, depth - levels).memory(16 << 20).metadata(metadata)
    };
    let mut file = TreeWriter::create(Output::create(path)?, (Dimension::Quad, depth), 4)?;
    let tree = |form, depth, rule, cell: &dyn Fn(Cell) -> Option<Value>| {
        MemTree::from_cells(form, depth, rule, cell)
    };
    let cover = tree(QUAD, depth, Rule::Majority, &|cell| class(cell).map(|class| Value::from([class])));
    let metadata =
        Metadata { palette: Some(Palette { colours: island::COLOURS.to_vec() }), ..named("cover", 0) };
    file.tree(&cover, size, &options(DataKind::Categorical, 0, metadata), &())?;
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, 1));
    let elevation = island.elevation();
    let heights = |cell| coarse(cell).and_then(|i| elevation[i]).map(|height| Value::from([height]));
    let metadata = Metadata { nodata: Some((-9999).into()), units: vec!["m".into()], ..named("height", 2) };
    file.tree(
        &tree(form, depth - 2, Rule::Mean, &heights),
        small,
        &options(DataKind::Continuous, 2, metadata),
        &(),
    )?;
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 3));
    let image = island.image();
    let colours = tree(form, depth - 2, Rule::Mean, &|cell| coarse(cell).map(|i| Value::from(image[i])));
    file.tree(&colours, small, &options(DataKind::Continuous, 2, named("colour", 2)), &())?;
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U64, 1));
    let labels = tree(form, depth, Rule::Majority, &|cell| {
        let patch = u64::from(cell[0] / 32 + 100 * (cell[1] / 32));
        class(cell).map(|class| Value::from([(1 << 63) + (patch << 8) + u64::from(class)]))
    });
    file.tree(&labels, size, &options(DataKind::Categorical, 0, named("label", 0)), &())?;
    file.finish()
}

/// Name of the frozen exact model, without `.goblin`.
pub(crate) const MODEL: &str = "chapel";

/// Names of the model's parts.
pub(crate) const PARTS: [&str; 2] = ["nave", "dome"];

/// Colours of the model's parts.
pub(crate) const PAINT: [[u8; 3]; 2] = [[200, 190, 170], [90, 130, 110]];

/// Builds the frozen exact model: a nave with a passage and a closed crypt, and a separate hollow
/// dome, in centimetres.
pub(crate) fn make_model(path: &Path, codec: Codec) -> Result<()> {
    let grid = Grid { bits: 12, origin: [265_000_000, 125_000_000, -100], step: 1.0, divisor: 100.0 };
    // Rings in x and z along y; clockwise ones are holes.
    let gable = vec![[100, 100], [1100, 100], [1100, 900], [600, 1400], [100, 900]];
    let passage = vec![[400, 300], [400, 700], [800, 700], [800, 300]];
    let crypt = vec![[150, 150], [150, 250], [350, 250], [350, 150]];
    let mut faces = along_y(&[gable, passage], 100, 2100);
    faces.extend(along_y(&[crypt], 500, 900));
    let nave = faces.len();
    // So thin that cells along the edges have faces of both sides; there are many of these.
    faces.extend(dome([2400, 1200, 100], [[20, 0], [18, 180], [14, 290], [8, 370]], 400));
    let mut inside = dome([2400, 1200, 100], [[19, 20], [17, 170], [13, 275], [7, 350]], 380);
    inside.iter_mut().flatten().for_each(|ring| ring.reverse());
    faces.extend(inside);
    let output = Output::create(path)?;
    let mut builder = ModelBuilder::new(output, grid, 16 << 20)?.codec(codec).leaf_size(0);
    for (number, rings) in (0..).zip(&faces) {
        let points = rings.concat();
        let mut end = 0;
        let ring_ends: Vec<usize> = rings.iter().map(|ring| (end += ring.len(), end).1).collect();
        let part = u32::from(number >= nave as u64);
        let colours = vec![PAINT[part as usize]; points.len()];
        // (As if the file had two more faces.)
        let source = number + 2 * u64::from(part);
        builder.push(&Face {
            number,
            points: &points,
            ring_ends: &ring_ends,
            colours: &colours,
            part,
            source,
        })?;
    }
    let crs = Some(Crs::parse("EPSG:2056")?);
    let half = |steps: f64| (steps - 0.5) / 100.0;
    let matrix = [
        [0.01, 0.0, 0.0, half(265_000_000.0)],
        [0.0, 0.01, 0.0, half(125_000_000.0)],
        [0.0, 0.0, 0.01, half(-100.0)],
    ];
    let mut metadata = Metadata {
        frame: Frame { matrix, crs, pixel_is_point: false },
        provenance: vec!["made by examples/make_fixtures".into()],
        tags: [("unit".into(), "m".into())].into(),
        ..Metadata::default()
    };
    PARTS.iter().try_for_each(|name| builder.part(name, None))?;
    builder.finish(&mut metadata, &()).map(drop)
}

/// Faces, each a list of rings.
type Faces = Vec<Vec<Vec<[i32; 3]>>>;

/// Returns walls over rings of x and z, from one y to another: facing outwards if the ring is
/// counterclockwise with z upwards.
fn along_y(rings: &[Vec<[i32; 2]>], from: i32, to: i32) -> Faces {
    let at = |y: i32| move |[x, z]: &[i32; 2]| [*x, y, *z];
    let front: Vec<Vec<[i32; 3]>> = rings.iter().map(|ring| ring.iter().map(at(from)).collect()).collect();
    let back: Vec<Vec<[i32; 3]>> = rings.iter().map(|ring| ring.iter().rev().map(at(to)).collect()).collect();
    let mut faces = vec![front, back];
    for ring in rings {
        for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            faces.push(vec![vec![at(from)(b), at(from)(a), at(to)(a), at(to)(b)]]);
        }
    }
    faces
}

/// Returns a dome of triangles over a twelve-sided polygon: rings of a radius, in twentieths of
/// 400, and a height, and its own height.
fn dome([x, y, z]: [i32; 3], heights: [[i32; 2]; 4], height: i32) -> Faces {
    const QUARTER: [[i32; 2]; 3] = [[20, 0], [17, 10], [10, 17]];
    let around = |i: usize| {
        let [a, b] = QUARTER[i % 3];
        [[a, b], [-b, a], [-a, -b], [b, -a]][i / 3 % 4]
    };
    let at = |ring: usize, i: usize| {
        let ([a, b], [radius, height]) = (around(i), heights[ring]);
        [x + radius * a, y + radius * b, z + height]
    };
    let top = [x, y, z + height];
    let mut faces = vec![vec![(0..12).rev().map(|i| at(0, i)).collect()]];
    for i in 0..12 {
        for ring in 0..heights.len() - 1 {
            let [a, b] = [at(ring, i), at(ring, i + 1)];
            let [c, d] = [at(ring + 1, i + 1), at(ring + 1, i)];
            faces.extend([vec![vec![a, b, c]], vec![vec![a, c, d]]]);
        }
        faces.push(vec![vec![at(heights.len() - 1, i), at(heights.len() - 1, i + 1), top]]);
    }
    faces
}

/// Codecs of the frozen exact models, and the suffixes of their names before `.goblin`.
pub(crate) const CODECS: [(Codec, &str); 2] = [(Codec::Plain, ""), (Codec::Packed, "_packed")];

/// Name of the frozen model with off-grid vertices, without `.goblin`.
pub(crate) const CROSSING: &str = "crossing";

/// Attributes of that model's parts, and of its source file.
pub(crate) const ABOUT: [(&str, Option<&str>); 3] = [
    (
        "tower",
        Some(r#"{"type":"Building","attributes":{"height":18.50,"name":"T\u00fcrm"},"children":["spire"]}"#),
    ),
    ("spire", Some(r#"{"type":"BuildingPart","parents":["tower"],"attributes":{"height":21.00}}"#)),
    ("mast", None),
];
pub(crate) const ABOUT_FILE: &str = r#"{"metadata":{"title":"A tower"}}"#;

/// Builds the frozen model with off-grid vertices: the union of a box and a tetrahedron through it,
/// which become one object, and of two blocks next to them, without another tetrahedron.
pub(crate) fn make_crossing(path: &Path, codec: Codec) -> Result<()> {
    let through = [[4, 20, 9], [58, 12, 14], [23, 57, 11], [29, 24, 61]];
    let cut = [[60, 33, 37], [31, 2, 40], [28, 60, 45], [40, 25, 3]];
    let square = |low: i32, high: [i32; 2]| vec![[low, low], [high[0], low], high, [low, high[1]]];
    let [(first, about), (second, more), (third, _)] = ABOUT;
    let bodies = [
        model(path, &along_y(&[square(10, [45, 41])], 12, 52), (first, about), Some(ABOUT_FILE))?,
        model(path, &tetrahedron(through), ("roof", None), None)?,
        model(path, &along_y(&[square(1, [4, 4])], 1, 4), (second, more), None)?,
        model(path, &along_y(&[square(58, [61, 61])], 58, 61), (third, None), None)?,
    ];
    let cut = model(path, &tetrahedron(cut), ("cut", None), None)?;
    let bodies: Vec<&ExactModel> = bodies.iter().collect();
    combine(SetOperation::Union, &bodies, Output::create(path)?, Codec::Plain, 16 << 20, &())?;
    let all = in_memory(path)?;
    combine(SetOperation::Difference, &[&all, &cut], Output::create(path)?, codec, 16 << 20, &()).map(drop)
}

/// Reads the model of a file that is to be rewritten.
fn in_memory(path: &Path) -> Result<ExactModel> {
    ExactModel::from_bytes(std::fs::read(path).map_err(Error::io(path, "read"))?)
}

/// Builds a model with one part, in memory; the file at `path` is overwritten.
fn model(
    path: &Path,
    faces: &Faces,
    (name, about): (&str, Option<&str>),
    file: Option<&str>,
) -> Result<ExactModel> {
    let grid = Grid { bits: 6, origin: [0; 3], step: 0.5, divisor: 1.0 };
    let mut builder = ModelBuilder::new(Output::create(path)?, grid, 16 << 20)?;
    for (number, rings) in (0..).zip(faces) {
        let (points, colours, part) = (&rings.concat()[..], &[][..], 0);
        builder.push(&Face { number, points, ring_ends: &[points.len()], colours, part, source: number })?;
    }
    builder.part(name, about)?;
    file.iter().try_for_each(|text| builder.about_file(text))?;
    let mut metadata = Metadata { tags: [("unit".into(), "m".into())].into(), ..Metadata::default() };
    let report = builder.finish(&mut metadata, &())?;
    assert_eq!(report.defects, [], "{name}");
    in_memory(path)
}

/// Returns the faces of a tetrahedron whose first three vertices are counterclockwise as seen from
/// the last.
fn tetrahedron([a, b, c, d]: [[i32; 3]; 4]) -> Faces {
    [[a, c, b], [a, b, d], [b, c, d], [c, a, d]].map(|ring| vec![ring.to_vec()]).to_vec()
}
