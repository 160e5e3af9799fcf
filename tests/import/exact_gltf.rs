//! Exact models as binary glTF and 3D Tiles: read back by our reader and by an independent one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use spinney::brep::{Detail, Faces, Grid, Motion, TransformOptions, add_levels, transform};
use spinney::export::{GltfOptions, export_model_glb, export_model_tileset};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::{FaceList, ModelBuilder, Triangulated};
use spinney::raw::io::OutputDirectory;
use spinney::{Crs, ExactModel, Metadata, OpenOptions, Output};

use crate::common::exact::{cuboid, push};

const MEMORY: u64 = 64 << 20;

type Point = [f64; 3];

fn add(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|axis| a[axis] + b[axis])
}

fn distance(a: Point, b: Point) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

/// Returns twice the area.
fn double_area([a, b, c]: [Point; 3]) -> f64 {
    let [u, v] = [b, c].map(|p| [0, 1, 2].map(|axis| p[axis] - a[axis]));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    distance(cross, [0.0; 3])
}

/// Returns six times the volume, computed near the first vertex.
fn six_volumes(triangles: &[[Point; 3]]) -> f64 {
    let origin = triangles[0][0].map(|at| -at);
    let of = |triangle: &[Point; 3]| {
        let [a, b, c] = triangle.map(|p| add(p, origin));
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    triangles.iter().map(of).sum()
}

/// Triangles of a binary glTF file with z up, read without our reader.
struct Read {
    json: Json,
    bin: Vec<u8>,
    triangles: Vec<[Point; 3]>,
    /// Row of each triangle's vertices in the table of objects.
    rows: Vec<[usize; 3]>,
    /// Linear colours of each triangle's vertices.
    colours: Vec<[Point; 3]>,
    /// Translations of nodes with meshes, with z up.
    origins: Vec<Point>,
}

impl Read {
    fn of(path: &Path) -> Read {
        let bytes = std::fs::read(path).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (b"glTF".as_slice(), 2, bytes.len()));
        let end = 20 + word(12);
        let json: Json = serde_json::from_slice(&bytes[20..end]).unwrap();
        assert_eq!(&bytes[end + 4..end + 8], b"BIN\0");
        let mut read = Read {
            json,
            bin: bytes[end + 8..].to_vec(),
            triangles: Vec::new(),
            rows: Vec::new(),
            colours: Vec::new(),
            origins: Vec::new(),
        };
        assert!(read.json["nodes"][0]["translation"].is_null() && read.json["nodes"][0]["matrix"].is_null());
        for node in read.json["nodes"].as_array().unwrap().clone() {
            if let Some(mesh) = node["mesh"].as_u64() {
                read.mesh(&node, mesh as usize);
            }
        }
        read
    }

    fn mesh(&mut self, node: &Json, mesh: usize) {
        let up = |p: &[f64]| [p[0], -p[2], p[1]];
        let origin: Vec<f64> = (0..3).map(|axis| node["translation"][axis].as_f64().unwrap()).collect();
        let origin = up(&origin);
        let primitive = self.json["meshes"][mesh]["primitives"][0].clone();
        let read = |name: &str| {
            primitive["attributes"][name].as_u64().map(|accessor| self.numbers(accessor as usize))
        };
        let positions = read("POSITION").unwrap();
        // Accessors declare the range of their positions.
        let about = &self.json["accessors"][primitive["attributes"]["POSITION"].as_u64().unwrap() as usize];
        for axis in 0..3 {
            let all = || positions.iter().map(|position| position[axis]);
            let [min, max] = ["min", "max"].map(|key| about[key][axis].as_f64().unwrap() as f32);
            assert_eq!(f64::from(min), all().fold(f64::INFINITY, f64::min));
            assert_eq!(f64::from(max), all().fold(f64::NEG_INFINITY, f64::max));
        }
        let (rows, colours) = (read("_FEATURE_ID_0").unwrap(), read("COLOR_0"));
        let indices = self.numbers(primitive["indices"].as_u64().unwrap() as usize);
        for corners in indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|corner: usize| corners[corner][0] as usize);
            self.triangles.push(corners.map(|corner| add(up(&positions[corner]), origin)));
            self.rows.push(corners.map(|corner| rows[corner][0] as usize));
            if let Some(colours) = &colours {
                self.colours.push(corners.map(|corner| [0, 1, 2].map(|of| colours[corner][of] / 65535.0)));
            }
        }
        self.origins.push(origin);
    }

    fn numbers(&self, accessor: usize) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][accessor];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let width = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let kind = accessor["componentType"].as_u64().unwrap();
        let size = if kind == 5123 { 2 } else { 4 };
        let stride = view["byteStride"].as_u64().map_or(width * size, |stride| stride as usize);
        let first = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let number = |at: usize| match kind {
            5123 => f64::from(u16::from_le_bytes(self.bin[at..at + 2].try_into().unwrap())),
            5125 => f64::from(u32::from_le_bytes(self.bin[at..at + 4].try_into().unwrap())),
            5126 => f64::from(f32::from_le_bytes(self.bin[at..at + 4].try_into().unwrap())),
            other => panic!("component type {other}"),
        };
        let count = accessor["count"].as_u64().unwrap() as usize;
        (0..count)
            .map(|at| (0..width).map(|part| number(first + at * stride + part * size)).collect())
            .collect()
    }

    fn view(&self, index: &Json) -> &[u8] {
        let view = &self.json["bufferViews"][index.as_u64().unwrap() as usize];
        let first = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        &self.bin[first..first + view["byteLength"].as_u64().unwrap() as usize]
    }

    /// Returns the columns of the table of objects by name.
    fn table(&self) -> BTreeMap<String, Vec<Json>> {
        let root = &self.json["extensions"]["EXT_structural_metadata"];
        let table = &root["propertyTables"][0];
        let count = table["count"].as_u64().unwrap() as usize;
        let properties = root["schema"]["classes"]["object"]["properties"].as_object().unwrap();
        let mut columns = BTreeMap::new();
        for (id, about) in properties {
            let column = &table["properties"][id];
            let values = self.view(&column["values"]);
            let rows: Vec<Json> = if about["type"] == "STRING" {
                let offsets = self.view(&column["stringOffsets"]).chunks_exact(4);
                let offsets: Vec<usize> =
                    offsets.map(|it| u32::from_le_bytes(it.try_into().unwrap()) as usize).collect();
                assert_eq!(offsets.len(), count + 1);
                let text = |pair: &[usize]| std::str::from_utf8(&values[pair[0]..pair[1]]).unwrap().into();
                offsets.windows(2).map(text).collect()
            } else {
                assert_eq!(about["componentType"], "FLOAT64");
                let of = |it: &[u8]| f64::from_le_bytes(it.try_into().unwrap()).into();
                values.chunks_exact(8).map(of).collect()
            };
            assert_eq!(rows.len(), count);
            columns.insert(about["name"].as_str().unwrap().to_owned(), rows);
        }
        columns
    }
}

fn grid(origin: [i64; 3], step: f64, bits: u8) -> Grid {
    Grid { bits, origin, step, divisor: 1.0 }
}

/// Builds a file with the parts of a list.
fn file_of(list: &FaceList) -> ExactModel {
    described(list, &vec![None; list.parts().len()])
}

/// Builds a file with the parts of a list, and their attributes.
fn described(list: &FaceList, attributes: &[Option<&str>]) -> ExactModel {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("model.goblin");
    let mut builder = ModelBuilder::new(Output::create(&path).unwrap(), list.grid().clone(), MEMORY).unwrap();
    list.each(&mut |face| builder.push(face)).unwrap();
    for (part, attributes) in list.parts().iter().zip(attributes) {
        builder.part(part, *attributes).unwrap();
    }
    let report = builder.finish(&mut Metadata::default(), &(), &mut |_, _| ()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(std::fs::read(&path).unwrap()).unwrap()
}

/// Three boxes of different colours, as objects.
fn boxes(grid: Grid) -> FaceList {
    let mut list = FaceList::new(grid, vec!["low".into(), "a \"name\"".into(), "häuser/3".into()]);
    for (part, colour) in [[255, 0, 0], [0, 128, 255], [12, 200, 34]].into_iter().enumerate() {
        let low = [1000 * part as i32 + 7, 20, 30];
        for face in cuboid(low, [low[0] + 800, 320 + 100 * part as i32, 531]) {
            push(&mut list, &face, part as u32, Some(colour));
        }
    }
    list
}

/// Returns a copy of a model with a unit and a coordinate system.
fn placed(model: &ExactModel, directory: &Path, unit: Option<&str>, crs: Option<Crs>) -> ExactModel {
    let path = directory.join("placed.goblin");
    let mut options = TransformOptions::new(MEMORY);
    (options.unit, options.crs) = (unit.map(str::to_owned), crs);
    let same = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let motion = Motion::from_rows(same).unwrap();
    transform(model, &motion, &options, Output::create(&path).unwrap(), &()).unwrap();
    ExactModel::open(&path, &OpenOptions::new()).unwrap()
}

fn exported(faces: &dyn Faces, path: &Path, meshopt: bool) -> u64 {
    let mut options = GltfOptions::new();
    options.meshopt = meshopt;
    export_model_glb(faces, &options, Output::create(path).unwrap(), &()).unwrap()
}

/// Builds an exact model of a file with our reader.
fn rebuilt(path: &Path) -> ExactModel {
    let out = path.with_extension("goblin");
    let models = open_all(&[path.to_path_buf()], MEMORY).unwrap();
    let report = import_exact(models, &ExactOptions::new(), Output::create(&out).unwrap(), &()).unwrap();
    assert_eq!(report.built.defects, []);
    ExactModel::open(&out, &OpenOptions::new()).unwrap()
}

fn volume(model: &ExactModel) -> f64 {
    let mut sum = 0;
    model
        .each(&mut |face| {
            sum += face.six_volumes();
            Ok(())
        })
        .unwrap();
    sum as f64 / 6.0 * model.grid().width().powi(3)
}

#[test]
fn models_are_read_back_with_objects_and_colours() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let path = directory.path().join("boxes.glb");
    assert_eq!(exported(&model, &path, false), 36);
    let read = Read::of(&path);
    assert_eq!(read.triangles.len(), 36);
    assert!((six_volumes(&read.triangles) / 6.0 - volume(&model)).abs() < 1e-6 * volume(&model));
    let names: Vec<Json> = model.parts().iter().map(|name| name.as_str().into()).collect();
    assert_eq!(read.table()["name"], names);
    let linear = |value: u8| {
        let value = f64::from(value) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let colours = [[255, 0, 0], [0, 128, 255], [12, 200, 34]].map(|colour| colour.map(linear));
    for ((rows, found), triangle) in read.rows.iter().zip(&read.colours).zip(&read.triangles) {
        assert!(rows.iter().all(|row| *row == rows[0]));
        assert_eq!(rows[0], (triangle[0][0] / 125.0) as usize, "{triangle:?}");
        assert!(found.iter().all(|found| distance(*found, colours[rows[0]]) < 1e-4), "{found:?}");
    }
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        let again = rebuilt(&path);
        assert!((volume(&again) - volume(&model)).abs() < 1e-6 * volume(&model), "{meshopt}");
        let mut colours = BTreeSet::new();
        again
            .each(&mut |face| {
                colours.extend(face.colours.iter().copied());
                Ok(())
            })
            .unwrap();
        assert_eq!(colours, [[0, 128, 255], [12, 200, 34], [255, 0, 0]].into(), "{meshopt}");
        std::fs::remove_file(path.with_extension("goblin")).unwrap();
    }
}

#[test]
fn attributes_are_columns() {
    let directory = tempfile::tempdir().unwrap();
    let attributes = [
        Some(
            r#"{"type": "Building", "attributes": {"height": 5.5, "übung": 1, "roof": "flat", "list": [1, 2]}}"#,
        ),
        Some(r#"{"type": "Bridge", "attributes": {"height": -3, "übung": "two", "roof": null}}"#),
        Some(r#"{"type": "Building", "attributes": {"height": 1e9, "roof": true}}"#),
    ];
    let model = described(&boxes(grid([0; 3], 0.125, 12)), &attributes);
    let path = directory.path().join("boxes.glb");
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        if !meshopt {
            let table = Read::of(&path).table();
            let expected = [
                ("name", serde_json::json!(model.parts())),
                ("type", serde_json::json!(["Building", "Bridge", "Building"])),
                ("height", serde_json::json!([5.5, -3.0, 1e9])),
                // Columns that are not all numbers are strings.
                ("übung", serde_json::json!(["1", "two", ""])),
                ("roof", serde_json::json!(["flat", "", "true"])),
                ("list", serde_json::json!(["[1,2]", "", ""])),
            ];
            assert_eq!(table.len(), expected.len(), "{table:?}");
            for (name, values) in expected {
                assert_eq!(serde_json::json!(table[name]), values, "{name}");
            }
        }
        std::fs::remove_file(&path).unwrap();
    }
    // Parts without attributes, and attributes that are not JSON objects.
    let odd = described(&boxes(grid([0; 3], 0.125, 12)), &[None, Some("[1]"), Some(r#"{"height": 2}"#)]);
    exported(&odd, &path, false);
    let table = Read::of(&path).table();
    assert_eq!(serde_json::json!(table["height"]), serde_json::json!(["", "", "2"]));
}

#[test]
fn units_become_metres() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let path = directory.path().join("mm.glb");
    let units = [
        (Some("mm"), None, 0.001),
        (Some("m"), None, 1.0),
        (Some("ft"), None, 0.3048),
        (None, None, 1.0),
        // Survey feet.
        (None, Some(2263), 1200.0 / 3937.0),
    ];
    for (unit, crs, metres) in units {
        let placed = placed(&model, directory.path(), unit, crs.map(Crs::epsg));
        exported(&placed, &path, false);
        let found = six_volumes(&Read::of(&path).triangles) / 6.0;
        let expected = volume(&model) * f64::powi(metres, 3);
        assert!((found - expected).abs() < 1e-6 * expected, "{unit:?}: {found}, expected {expected}");
        std::fs::remove_file(directory.path().join("placed.goblin")).unwrap();
    }
}

#[test]
fn distant_coordinates_keep_their_precision() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("far.glb");
    // Millimetres at 4,000 km.
    let list =
        boxes(Grid { bits: 12, origin: [4_000_000_000, 4_000_000_000, -7], step: 1.0, divisor: 1000.0 });
    let model = file_of(&list);
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        if !meshopt {
            let read = Read::of(&path);
            assert!(read.origins[0][0] > 3e6);
            let exact: BTreeSet<[i64; 3]> = (0..list.len())
                .flat_map(|number| list.get(number as usize).points.to_vec())
                .map(|point| model.grid().to_world(point).map(|at| (at * 1000.0).round() as i64))
                .collect();
            for point in read.triangles.as_flattened() {
                let nearest = point.map(|at| (at * 1000.0).round() as i64);
                assert!(exact.contains(&nearest), "{point:?}");
                assert!((0..3).all(|axis| (point[axis] * 1000.0 - nearest[axis] as f64).abs() < 3e-3));
            }
        }
        let again = rebuilt(&path);
        assert!((volume(&again) - volume(&model)).abs() < 1e-5 * volume(&model), "{meshopt}");
        std::fs::remove_file(path.with_extension("goblin")).unwrap();
    }
}

/// A torus of 2nm triangles with bumps.
fn bumpy_torus(n: i32, m: i32, grid: Grid) -> FaceList {
    let at = |i: i32, j: i32| {
        let [u, v] =
            [(i, n), (j, m)].map(|(at, of)| f64::from(at % of) / f64::from(of) * std::f64::consts::TAU);
        let r = 1.0 + 0.05 * (12.0 * u).sin() * (7.0 * v).cos();
        let wide = 3.0 + r * v.cos();
        [wide * u.cos(), wide * u.sin(), r * v.sin()].map(|at| ((at + 4.2) * 7000.0) as i32)
    };
    let mut list = FaceList::new(grid, vec!["torus".into()]);
    for i in 0..n {
        for j in 0..m {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            push(&mut list, &[vec![a, b, c]], 0, None);
            push(&mut list, &[vec![a, c, d]], 0, None);
        }
    }
    list
}

/// A tile whose transforms have been applied.
struct Tile {
    depth: usize,
    error: f64,
    bounds: [Point; 2],
    is_leaf: bool,
    triangles: Vec<[Point; 3]>,
}

/// Reads a tile and all tiles below it.
fn read_tile(
    directory: &Path,
    tile: &Json,
    (depth, origin): (usize, Point),
    above: Option<&(f64, [Point; 2])>,
    found: &mut (Vec<Tile>, BTreeSet<PathBuf>),
) {
    let number = |json: &Json, at: usize| json[at].as_f64().unwrap();
    let matrix = &tile["transform"];
    let linear = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let origin = match matrix.is_null() {
        true => origin,
        false => {
            assert!((0..12).all(|at| number(matrix, at) == linear[at]), "{matrix}");
            add(origin, [12, 13, 14].map(|at| number(matrix, at)))
        }
    };
    let shape = &tile["boundingVolume"]["box"];
    let centre = add(origin, [0, 1, 2].map(|at| number(shape, at)));
    let half = [3, 7, 11].map(|at| number(shape, at));
    let bounds =
        [[0, 1, 2].map(|axis| centre[axis] - half[axis]), [0, 1, 2].map(|axis| centre[axis] + half[axis])];
    let error = tile["geometricError"].as_f64().unwrap();
    // (Sums of origins are rounded.)
    const ROUNDED: f64 = 1e-6;
    if let Some((error_above, [low, high])) = above {
        assert!(error <= *error_above, "{error} below {error_above}");
        let is_in = (0..3)
            .all(|axis| low[axis] - ROUNDED <= bounds[0][axis] && bounds[1][axis] <= high[axis] + ROUNDED);
        assert!(is_in, "{bounds:?} in {low:?} to {high:?}");
    }
    let mut triangles = Vec::new();
    if let Some(name) = tile["content"]["uri"].as_str() {
        let path = directory.join(name);
        triangles = Read::of(&path).triangles;
        triangles.as_flattened_mut().iter_mut().for_each(|point| *point = add(*point, origin));
        for point in triangles.as_flattened() {
            let is_in = (0..3).all(|axis| {
                bounds[0][axis] - ROUNDED <= point[axis] && point[axis] <= bounds[1][axis] + ROUNDED
            });
            assert!(is_in, "{name}: {point:?} in {bounds:?}");
        }
        assert!(found.1.insert(path), "{name} is used twice");
    }
    assert!(tile["refine"].is_null() || tile["refine"] == "REPLACE");
    let children = tile["children"].as_array().map_or(&[][..], Vec::as_slice);
    found.0.push(Tile { depth, error, bounds, is_leaf: children.is_empty(), triangles });
    for child in children {
        read_tile(directory, child, (depth + 1, origin), Some(&(error, bounds)), found);
    }
}

/// Writes and reads a tileset, and checks its structure.
fn tiles_of(model: &ExactModel, directory: &Path) -> (Json, Vec<Tile>) {
    let output = OutputDirectory::create(directory).unwrap();
    let summary = export_model_tileset(model, &GltfOptions::new(), output, MEMORY, &()).unwrap();
    let json: Json = serde_json::from_slice(&std::fs::read(directory.join("tileset.json")).unwrap()).unwrap();
    assert_eq!((&json["asset"]["version"], &json["root"]["refine"]), (&"1.1".into(), &"REPLACE".into()));
    let mut found = (Vec::new(), BTreeSet::new());
    read_tile(directory, &json["root"], (0, [0.0; 3]), None, &mut found);
    let (tiles, files) = found;
    assert!(json["geometricError"].as_f64().unwrap() >= tiles[0].error);
    // No other files.
    let mut there = BTreeSet::new();
    let mut pending = vec![directory.to_path_buf()];
    while let Some(directory) = pending.pop() {
        for entry in std::fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => pending.push(path),
                false => assert!(there.insert(path)),
            }
        }
    }
    assert!(there.remove(&directory.join("tileset.json")));
    assert_eq!(there, files);
    assert_eq!(summary.tiles, files.len() as u64);
    let triangles: usize = tiles.iter().map(|tile| tile.triangles.len()).sum();
    assert_eq!(summary.triangles, triangles as u64);
    (json, tiles)
}

fn area(triangles: impl Iterator<Item = [Point; 3]>) -> f64 {
    triangles.map(double_area).sum::<f64>() / 2.0
}

/// A slab of 2n x 2n triangles on either side and a distant box. Upper vertices alternate around
/// the middle of the grid, so that exact triangles have their centroids below it, and some coarse
/// ones above.
fn slab(n: i32) -> FaceList {
    let mut list = FaceList::new(grid([0; 3], 0.001, 16), vec!["slab".into(), "box".into()]);
    let width = 30_000 / n;
    let upper = |i: i32, j: i32| {
        let is_inside = 0 < i && i < n && 0 < j && j < n;
        let shift = if is_inside && (i + j) % 3 == 0 { 60 } else { -98 };
        [i * width, j * width, (1 << 15) + shift]
    };
    let lower = |i: i32, j: i32| [i * width, j * width, 0];
    let mut add = |a: [i32; 3], b: [i32; 3], c: [i32; 3], d: [i32; 3]| {
        push(&mut list, &[vec![a, b, c]], 0, None);
        push(&mut list, &[vec![a, c, d]], 0, None);
    };
    for i in 0..n {
        for j in 0..n {
            add(upper(i, j), upper(i + 1, j), upper(i + 1, j + 1), upper(i, j + 1));
            add(lower(i, j + 1), lower(i + 1, j + 1), lower(i + 1, j), lower(i, j));
        }
        add(lower(i, 0), lower(i + 1, 0), upper(i + 1, 0), upper(i, 0));
        add(lower(i + 1, n), lower(i, n), upper(i, n), upper(i + 1, n));
        add(lower(0, i + 1), lower(0, i), upper(0, i), upper(0, i + 1));
        add(lower(n, i), lower(n, i + 1), upper(n, i + 1), upper(n, i));
    }
    for face in cuboid([64_900; 3], [65_400; 3]) {
        push(&mut list, &face, 1, None);
    }
    list
}

#[test]
fn tiles_have_every_level_within_their_boxes() {
    check_tiles(&bumpy_torus(360, 260, grid([0; 3], 0.001, 16)));
}

#[test]
fn tiles_above_cells_without_exact_faces_are_replaced() {
    let empty = check_tiles(&slab(156));
    assert!(empty > 0);
}

/// Checks the tiles of a model with levels. Returns the number of empty leaves.
fn check_tiles(list: &FaceList) -> usize {
    let directory = tempfile::tempdir().unwrap();
    let plain = file_of(list);
    let path = directory.path().join("levels.goblin");
    add_levels(&plain, (Output::create(&path).unwrap(), plain.codec()), MEMORY, &()).unwrap();
    let model = ExactModel::open(&path, &OpenOptions::new()).unwrap();
    let levels = model.levels();
    let (json, tiles) = tiles_of(&model, &directory.path().join("tiles"));
    assert!(json["asset"]["extras"].is_null());
    let first = levels.iter().rposition(|level| level.faces <= 20_000).unwrap();
    let depths = levels.len() - first;
    assert!(depths >= 3, "{depths}");
    for (depth, level) in levels[first..].iter().enumerate() {
        let here = || tiles.iter().filter(|tile| tile.depth == depth);
        let count: usize = here().map(|tile| tile.triangles.len()).sum();
        let surface = model.at_detail(Detail::Level((first + depth) as u8), None).unwrap();
        let surface = Triangulated::of(&surface).unwrap();
        assert_eq!(count as u64, surface.len(), "depth {depth}");
        let mut expected = 0.0;
        surface
            .each(&mut |face| {
                let corner = |at: usize| model.grid().to_world(face.points[at]);
                expected += double_area([0, 1, 2].map(corner)) / 2.0;
                Ok(())
            })
            .unwrap();
        let found = area(here().flat_map(|tile| tile.triangles.iter().copied()));
        assert!((found - expected).abs() < 1e-5 * expected, "depth {depth}: {found}, expected {expected}");
        let error = level.error * model.grid().width();
        let has_error = |tile: &Tile| (tile.error - error).abs() <= 1e-9 * error;
        assert!(here().all(|tile| has_error(tile) || tile.triangles.is_empty()), "depth {depth}");
    }
    let leaves = || tiles.iter().filter(|tile| tile.is_leaf);
    let early: Vec<_> = leaves().filter(|tile| tile.error != 0.0).map(|tile| tile.bounds).collect();
    assert!(early.is_empty(), "leaves with an error: {early:?}");
    let count: usize = leaves().map(|tile| tile.triangles.len()).sum();
    assert_eq!(count as u64, Triangulated::of(&model).unwrap().len());
    let all: Vec<_> = leaves().flat_map(|tile| tile.triangles.iter().copied()).collect();
    assert!((six_volumes(&all) / 6.0 - volume(&model)).abs() < 1e-5 * volume(&model));
    // Errors are in metres, as coordinates are.
    for (unit, crs, metres) in [(Some("mm"), None, 0.001), (None, Some(2263), 1200.0 / 3937.0)] {
        let moved = placed(&plain, directory.path(), unit, crs.map(Crs::epsg));
        let path = directory.path().join("moved.goblin");
        add_levels(&moved, (Output::create(&path).unwrap(), moved.codec()), MEMORY, &()).unwrap();
        let moved = ExactModel::open(&path, &OpenOptions::new()).unwrap();
        let tiles = directory.path().join(format!("tiles {metres}"));
        let (_, tiles) = tiles_of(&moved, &tiles);
        let expected = moved.levels()[first].error * moved.grid().width() * metres;
        assert!((tiles[0].error - expected).abs() < 1e-9 * expected, "{unit:?} {crs:?}");
        for name in ["placed.goblin", "moved.goblin"] {
            std::fs::remove_file(directory.path().join(name)).unwrap();
        }
    }
    leaves().filter(|tile| tile.triangles.is_empty()).count()
}

#[test]
fn tiles_are_on_the_globe() {
    // Corners of a box of 1000 x 1000 x 10 m in EPSG:28992, as PROJ 9 computes them with
    // EPSG:15934's seven parameters, which keep heights.
    const EXPECTED: [Point; 8] = [
        [3888259.18211, 332519.08030, 5028033.52724],
        [3888168.48594, 333515.02965, 5028037.67152],
        [3887470.59007, 332444.72656, 5028644.06099],
        [3887379.89360, 333440.67559, 5028648.20551],
        [3888265.26541, 332519.60053, 5028041.44702],
        [3888174.56909, 333515.55144, 5028045.59130],
        [3887476.67213, 332445.24668, 5028651.98172],
        [3887385.97552, 333441.19726, 5028656.12625],
    ];
    let directory = tempfile::tempdir().unwrap();
    let mut list = FaceList::new(grid([121_000, 487_000, 0], 1.0, 10), vec!["box".into()]);
    for face in cuboid([0; 3], [1000, 1000, 10]) {
        push(&mut list, &face, 0, None);
    }
    let model = placed(&file_of(&list), directory.path(), None, Some(Crs::epsg(28992)));
    let (json, tiles) = tiles_of(&model, &directory.path().join("tiles"));
    assert!(json["asset"]["extras"]["note"].as_str().unwrap().contains("EPSG:4978"), "{json}");
    assert_eq!((tiles.len(), tiles[0].triangles.len()), (1, 12));
    let mut seen = BTreeSet::new();
    for point in tiles[0].triangles.as_flattened() {
        let distances = EXPECTED.map(|expected| distance(expected, *point));
        let nearest = (0..8).min_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap();
        assert!(distances[nearest] < 1e-3, "{point:?} is {} m off", distances[nearest]);
        seen.insert(nearest);
    }
    assert_eq!(seen.len(), 8);
    // In millimetres, without a coordinate system.
    let model = file_of(&list);
    std::fs::remove_file(directory.path().join("placed.goblin")).unwrap();
    let local = placed(&model, directory.path(), Some("mm"), None);
    let (json, tiles) = tiles_of(&local, &directory.path().join("local"));
    assert!(json["asset"]["extras"].is_null());
    assert!(distance(tiles[0].bounds[0], [121.0, 487.0, 0.0]) < 1e-3, "{:?}", tiles[0].bounds);
}

#[test]
fn tilesets_are_refused_or_advised() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let tiles = directory.path().join("tiles");
    let (_, found) = tiles_of(&model, &tiles);
    assert!(found.len() == 1 && found[0].is_leaf && found[0].error == 0.0);
    let names: Vec<Json> = model.parts().iter().map(|name| name.as_str().into()).collect();
    assert_eq!(Read::of(&tiles.join("content/0/0.glb")).table()["name"], names);
    let bytes = std::fs::read(tiles.join("tileset.json")).unwrap();
    let error = OutputDirectory::create(&tiles)
        .and_then(|output| export_model_tileset(&model, &GltfOptions::new(), output, MEMORY, &()))
        .unwrap_err()
        .to_string();
    assert!(error.contains("not empty"), "{error}");
    assert_eq!(std::fs::read(tiles.join("tileset.json")).unwrap(), bytes);
    let large = file_of(&bumpy_torus(360, 280, grid([0; 3], 0.001, 16)));
    let output = OutputDirectory::create(&directory.path().join("large")).unwrap();
    let error =
        export_model_tileset(&large, &GltfOptions::new(), output, MEMORY, &()).unwrap_err().to_string();
    assert!(error.contains("without levels") && error.contains("spinney transform FILE levels"), "{error}");
    let names = std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), ["tiles"]);
}
