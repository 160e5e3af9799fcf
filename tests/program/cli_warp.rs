//! Rasters on other world grids: `build --grid xyz`, and the operations `grid=` and `like=`.

use std::fs;
use std::path::Path;

use spinney::raw::space::web_mercator_depth;
use spinney::{Bounds, Code, Dataset, Dimension};

use crate::common::command::{command, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;

const ELEVATION: &str = "fixtures/island_elevation.tif";
const CLASSES: &str = "fixtures/island_classes.tif";

/// Returns all cells of a level that are not VOID, and the position of the first.
fn cells(tree: &Dataset, level: u8, part: &Bounds) -> (Vec<u8>, Vec<bool>) {
    let count = part.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; count * tree.header().form.width()], vec![false; count]);
    tree.window(level, part, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    (bytes, valid)
}

#[test]
fn the_world_is_the_root() {
    let directory = TestDirectory::new();
    let file = directory.built(CLASSES, "tiles.goblin", &["--grid", "xyz", "--max-zoom", "11"]);
    assert_eq!(directory.files(), ["tiles.goblin"]);
    let tree = spinney::open(&file).unwrap();
    assert_eq!(web_mercator_depth(&tree.metadata().frame, tree.header().extent), Some(19));
    // The tile of zoom 8 around the island has its expected quadkey.
    let native = spinney::open(directory.built(CLASSES, "native.goblin", &[])).unwrap();
    let [width, height, _] = native.header().extent;
    let middle = native.metadata().frame.to_world([width as f64 / 2.0, height as f64 / 2.0, 0.0]);
    let projection =
        spinney::raw::space::Projection::new(native.metadata().frame.crs.as_ref().unwrap(), false).unwrap();
    let place = projection.inverse([middle[0], middle[1]]).unwrap();
    let x = ((place[0] + 180.0) / 360.0 * 256.0) as u32;
    let y = ((1.0 - place[1].to_radians().tan().asinh() / std::f64::consts::PI) / 2.0 * 256.0) as u32;
    let tile = Code::from_zxy(8, x, y).unwrap();
    let inside = tile.bounds(16);
    let (_, valid) = cells(&tree, 16, &inside);
    assert!(valid.contains(&true), "{}", tile.quadkey());
    // Other tiles are empty.
    let far = Code::from_cell(Dimension::Quad, 8, [x + 5, y, 0]).unwrap().bounds(16);
    assert!(!cells(&tree, 16, &far).1.contains(&true));
    spinney(&["verify", &file]).success();
}

#[test]
fn bytes_depend_on_nothing_but_input_and_options() {
    let directory = TestDirectory::new();
    let options = ["--grid", "xyz", "--resampling", "bilinear"];
    let first = fs::read(directory.built(ELEVATION, "a.goblin", &options)).unwrap();
    for (name, more) in [
        ("b.goblin", ["--threads", "1"]),
        ("c.goblin", ["--threads", "5"]),
        ("d.goblin", ["--memory", "16M"]),
    ] {
        let file = directory.built(ELEVATION, name, &[&options[..], &more[..]].concat());
        assert!(fs::read(file).unwrap() == first, "{more:?}");
    }
}

#[test]
fn transform_and_build_share_the_warper() {
    let directory = TestDirectory::new();
    for (input, way) in [(ELEVATION, "cubic"), (CLASSES, "majority")] {
        let built = directory.built(input, "built.goblin", &["--grid", "xyz", "--resampling", way]);
        let native = directory.built(input, "native.goblin", &[]);
        let [step, like] = ["step.goblin", "like.goblin"].map(|name| directory.name(name));
        command(&["transform", "-q", &native, "grid=xyz", "--resampling", way, "-o", &step])
            .assert()
            .success();
        let like_step = format!("like={built}");
        command(&["transform", "-q", &native, &like_step, "--resampling", way, "-o", &like])
            .assert()
            .success();
        for other in [&step, &like] {
            assert!(stdout(&["diff", "-q", &built, other]).contains("blocks     0,"), "{other}");
        }
        // Warping back: the island is at its old position.
        let back = directory.name("back.goblin");
        let like_step = format!("like={native},extent=a");
        command(&["transform", "-q", &built, &like_step, "--resampling", "nearest", "-o", &back])
            .assert()
            .success();
        let (a, b) = (spinney::open(&native).unwrap(), spinney::open(&back).unwrap());
        let image = a.header().extent_bounds();
        let ((_, before), (_, after)) = (cells(&a, a.depth(), &image), cells(&b, b.depth(), &image));
        let differ = before.iter().zip(&after).filter(|(a, b)| a != b).count();
        assert!(differ * 50 < before.len(), "{differ} of {} cells came or went", before.len());
    }
}

#[test]
fn views_see_other_grids_without_a_file() {
    let directory = TestDirectory::new();
    let native = directory.built(ELEVATION, "native.goblin", &[]);
    let (file, seen) = (directory.name("file.npy"), directory.name("seen.npy"));
    let xyz = directory.name("xyz.goblin");
    command(&["transform", "-q", &native, "grid=xyz,9", "crop", "-o", &xyz]).assert().success();
    command(&["get", "-q", &xyz, &file]).assert().success();
    command(&["get", "-q", &native, &seen, "--view", "grid=xyz,9", "--view", "crop"]).assert().success();
    assert!(fs::read(file).unwrap() == fs::read(seen).unwrap());
}

#[test]
fn impossible_warps_are_rejected() {
    let directory = TestDirectory::new();
    let out = directory.name("out.goblin");
    let refusal = |arguments: &[&str]| {
        stderr(command(&["build", ELEVATION, "-o", &out]).args(arguments).assert().failure())
    };
    for (arguments, text) in [
        (&["--grid", "xyz", "--crs", "EPSG:27200"][..], "nzmg"),
        (&["--grid", "xyz", "--crs", "EPSG:4267"], "--allow-ballpark"),
        (&["--grid", "xyz", "--max-zoom", "22"], "0 to 21"),
        (&["--grid", "xyz", "--depth", "12"], "--max-zoom"),
        (&["--grid", "xyz", "--resampling", "lanczos"], "nearest, bilinear, cubic, area, majority"),
        (&["--snap", "0.5"], "--brep"),
        (&["--grid", "wgs84"], "wgs84"),
        (&["--max-zoom", "3"], "--grid"),
        (&["--resampling", "cubic"], "--grid"),
    ] {
        let message = refusal(arguments);
        assert!(message.contains(text), "{arguments:?}: {message}");
        assert_eq!(directory.files(), Vec::<String>::new());
    }
    let message =
        stderr(spinney(&["build", CLASSES, "-o", &out, "--grid", "xyz", "--resampling", "area"]).failure());
    assert!(message.contains("nearest or majority"), "{message}");
    // An image without georeferencing.
    let message =
        stderr(spinney(&["build", "fixtures/island_rgb.png", "-o", &out, "--grid", "xyz"]).failure());
    assert!(message.contains("--crs EPSG:NUMBER"), "{message}");
    assert!(!Path::new(&out).exists() && directory.files().is_empty());
    // Preceding operations would be lost.
    let native = directory.built(ELEVATION, "native.goblin", &[]);
    let message = stderr(spinney(&["transform", &native, "rotate=3", "grid=xyz", "-o", &out]).failure());
    assert!(message.contains("this operation first"), "{message}");
}

#[test]
fn ballpark_transformations_are_reported() {
    let directory = TestDirectory::new();
    let out = directory.name("out.goblin");
    let arguments =
        ["build", ELEVATION, "-o", &out, "--grid", "xyz", "--crs", "EPSG:26716", "--allow-ballpark"];
    let message = stderr(spinney(&arguments).success());
    assert!(message.contains("hundred metres"), "{message}");
}

#[test]
fn tiles_are_exported_from_any_grid() {
    let directory = TestDirectory::new();
    let native = directory.built(CLASSES, "native.goblin", &[]);
    let archive = directory.name("island.pmtiles");
    spinney(&["export", "-q", &native, &archive]).success();
    spinney(&["verify", &archive]).success();
    let again = directory.name("again.pmtiles");
    spinney(&["export", "-q", &native, &again, "--threads", "3"]).success();
    assert!(fs::read(&archive).unwrap() == fs::read(&again).unwrap());
    // A zoom at which the island is within one tile.
    let pattern = directory.name("tiles/{z}/{x}/{y}.png");
    spinney(&["export", "-q", &native, &pattern, "--zoom", "0..2"]).success();
    for zoom in 0..3 {
        let columns = fs::read_dir(directory.name(&format!("tiles/{zoom}"))).unwrap().count();
        assert_eq!(columns, 1, "zoom {zoom}");
    }
    // A window in any coordinates: the western half of the island.
    let tiles = |name: &str, window: &[&str]| {
        let pattern = directory.name(&format!("{name}/{{z}}/{{x}}/{{y}}.png"));
        spinney(&[&["export", "-q", &native, &pattern, "--zoom", "13"], window].concat()).success();
        let columns = fs::read_dir(directory.name(&format!("{name}/13"))).unwrap();
        let mut columns: Vec<_> = columns.map(|column| column.unwrap().file_name()).collect();
        columns.sort();
        columns
    };
    let (all, cells) = (tiles("all", &[]), tiles("cells", &["--window", "0,0,128,200"]));
    let world = tiles("world", &["--in", "world", "--window", "300000,3190000,306400,3200000"]);
    let lonlat = tiles("lonlat", &["--in", "lonlat", "--window", "-17.05,28.82,-16.985,28.92"]);
    assert!(cells == world && cells.len() < all.len() && all.starts_with(&cells), "{cells:?} of {all:?}");
    assert!(lonlat == all[1..3], "{lonlat:?} of {all:?}");
    let xyz = directory.built(CLASSES, "xyz.goblin", &["--grid", "xyz"]);
    let refusal = stderr(spinney(&["export", &xyz, &archive, "--resampling", "majority"]).failure());
    assert!(refusal.contains("grid of web maps already"), "{refusal}");
    let plain = directory.built("fixtures/island_rgb.png", "plain.goblin", &[]);
    let refusal = stderr(spinney(&["export", &plain, &directory.name("plain.pmtiles")]).failure());
    let expected = format!("{plain}: coordinate system of the raster: got none");
    assert!(refusal.contains(&expected) && refusal.contains("crs=EPSG:NUMBER"), "{refusal}");
    let octree = "fixtures/v1/ball.goblin";
    let refusal = stderr(spinney(&["export", octree, &directory.name("plain.pmtiles")]).failure());
    assert!(refusal.contains(&format!("{octree}: an octree as source of tiles")), "{refusal}");
    assert!(!Path::new(&directory.name("plain.pmtiles")).exists());
}

/// Builds a tree of bytes with square cells, given its corner and cell width.
fn raster(
    directory: &TestDirectory,
    name: &str,
    side: usize,
    cells: &[u8],
    (corner, width): ([f64; 2], f64),
) -> String {
    let image = directory.name(&format!("{name}.pgm"));
    fs::write(&image, [format!("P5 {side} {side} 255\n").as_bytes(), cells].concat()).unwrap();
    let [x, y] = corner;
    let place = format!("{width},0,{x},0,-{width},{y}");
    let crs = ["--crs", "EPSG:32633", "--kind", "continuous", "--transform", &place];
    directory.built(&image, &format!("{name}.goblin"), &crs)
}

/// Returns Keys' kernel with a = -0.5, at a distance.
fn keys(x: f64) -> f64 {
    match x.abs() {
        x if x < 1.0 => 1.5 * x.powi(3) - 2.5 * x.powi(2) + 1.0,
        x if x < 2.0 => -0.5 * x.powi(3) + 2.5 * x.powi(2) - 4.0 * x + 2.0,
        _ => 0.0,
    }
}

#[test]
fn like_resamples_in_one_coordinate_system_by_each_method() {
    const SIDE: usize = 8;
    let directory = TestDirectory::new();
    // Multiples of 64, so that linear interpolation gives integers.
    let cells: Vec<u8> = (0..SIDE * SIDE).map(|cell| (cell * cell * 7 % 4 * 64) as u8).collect();
    let here = raster(&directory, "here", SIDE, &cells, ([500_000.0, 5_000_000.0], 10.0));
    // 16 x 16 cells, four per source cell along a side, starting at its third ones.
    let there = raster(&directory, "there", 16, &[1; 256], ([500_020.0, 4_999_980.0], 2.5));
    let value = |x: usize, y: usize| f64::from(cells[y * SIDE + x]);
    let by_kernel = |x: f64, y: f64, kernel: &dyn Fn(f64) -> f64| -> f64 {
        let each = (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| (column, row)));
        each.map(|(column, row)| {
            value(column, row) * kernel(column as f64 + 0.5 - x) * kernel(row as f64 + 0.5 - y)
        })
        .sum()
    };
    let resampled = |way: &[&str]| {
        let out = directory.name("out.goblin");
        command(&["transform", "-q", &here, &format!("like={there},extent=a"), "-o", &out])
            .args(way)
            .assert()
            .success();
        let (out, there) = (spinney::open(&out).unwrap(), spinney::open(&there).unwrap());
        assert_eq!(out.metadata().frame.matrix, there.metadata().frame.matrix);
        cells_of(&out)
    };
    let nearest = resampled(&["--resampling", "nearest"]);
    let bilinear = resampled(&["--resampling", "bilinear"]);
    let cubic = resampled(&["--resampling", "cubic"]);
    for (number, ((nearest, bilinear), cubic)) in nearest.iter().zip(&bilinear).zip(&cubic).enumerate() {
        let [x, y] = [number % 16, number / 16].map(|cell| 2.0 + (cell as f64 + 0.5) / 4.0);
        assert_eq!(f64::from(*nearest), value(x as usize, y as usize));
        assert_eq!(f64::from(*bilinear), by_kernel(x, y, &|d| (1.0 - d.abs()).max(0.0)));
        let expected = by_kernel(x, y, &keys).clamp(0.0, 255.0);
        assert!((f64::from(*cubic) - expected).abs() <= 1.0, "{cubic} at {x}, {y} for {expected}");
    }
    // By default the file's rule applies, by which cells within one source cell have its value.
    assert_eq!(resampled(&[]), nearest);
    assert_eq!(resampled(&["--resampling", "area"]), nearest);
}

fn cells_of(tree: &Dataset) -> Vec<u8> {
    cells(tree, tree.depth(), &tree.header().extent_bounds()).0
}

#[test]
fn like_takes_cells_of_any_width() {
    let directory = TestDirectory::new();
    let corner = [500_000.0, 5_000_000.0];
    let here = raster(&directory, "here", 8, &[7; 64], (corner, 10.0));
    for width in [7.0, 2.9, 14.7, 0.7, 1.1, 3.3] {
        let there = raster(&directory, "there", 3, &[1; 9], (corner, width));
        let [out, both] = ["out.goblin", "both.goblin"].map(|name| directory.name(name));
        command(&["transform", "-q", &here, &format!("like={there},extent=a"), "-o", &out])
            .assert()
            .success();
        assert_eq!(cells_of(&spinney::open(&out).unwrap()), [7; 9], "{width}");
        command(&["combine", "-q", "add", &out, &there, "-o", &both]).assert().success();
        assert_eq!(cells_of(&spinney::open(&both).unwrap()), [8; 9], "{width}");
    }
}
