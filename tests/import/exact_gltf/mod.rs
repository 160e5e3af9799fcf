//! Exact models as binary glTF and 3D Tiles: read back by our reader and by an independent one.

mod objects;
mod scenes;
mod tiles;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use spinney::brep::{Faces, Grid, Motion, SurfaceDetail, TransformOptions, add_levels, transform};
use spinney::export::{GltfOptions, export_model_glb, export_model_tileset};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::{FaceList, ModelBuilder, Triangulated};
use spinney::raw::io::OutputDirectory;
use spinney::{Crs, ExactModel, Metadata, OpenOptions, Output};

use crate::common::exact::{bumpy_torus, cuboid, push};

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
    /// Row of each triangle's vertices in the table of faces, if there is one.
    faces: Vec<[usize; 3]>,
    /// Linear colours of each triangle's vertices.
    colours: Vec<[Point; 3]>,
    /// Translations of nodes with meshes, with z up.
    origins: Vec<Point>,
}

impl Read {
    fn of(path: &Path) -> Read {
        let mut read = Read::chunks(path);
        assert!(read.json["nodes"][0]["translation"].is_null() && read.json["nodes"][0]["matrix"].is_null());
        for node in read.json["nodes"].as_array().unwrap().clone() {
            if let Some(mesh) = node["mesh"].as_u64() {
                read.mesh(&node, mesh as usize);
            }
        }
        read
    }

    /// Reads JSON and bytes only.
    fn chunks(path: &Path) -> Read {
        let bytes = std::fs::read(path).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (b"glTF".as_slice(), 2, bytes.len()));
        let end = 20 + word(12);
        let json: Json = serde_json::from_slice(&bytes[20..end]).unwrap();
        assert_eq!(&bytes[end + 4..end + 8], b"BIN\0");
        Read {
            json,
            bin: bytes[end + 8..].to_vec(),
            triangles: Vec::new(),
            rows: Vec::new(),
            faces: Vec::new(),
            colours: Vec::new(),
            origins: Vec::new(),
        }
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
        let faces = read("_FEATURE_ID_1");
        let indices = self.numbers(primitive["indices"].as_u64().unwrap() as usize);
        for corners in indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|corner: usize| corners[corner][0] as usize);
            self.triangles.push(corners.map(|corner| add(up(&positions[corner]), origin)));
            self.rows.push(corners.map(|corner| rows[corner][0] as usize));
            self.faces.extend(faces.iter().map(|faces| corners.map(|corner| faces[corner][0] as usize)));
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
        self.table_of(0, "object")
    }

    fn table_of(&self, number: usize, class: &str) -> BTreeMap<String, Vec<Json>> {
        let root = &self.json["extensions"]["EXT_structural_metadata"];
        let table = &root["propertyTables"][number];
        assert_eq!(table["class"], class);
        let count = table["count"].as_u64().unwrap() as usize;
        let properties = root["schema"]["classes"][class]["properties"].as_object().unwrap();
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
            } else if about["componentType"] == "INT32" {
                let of = |it: &[u8]| i32::from_le_bytes(it.try_into().unwrap()).into();
                values.chunks_exact(4).map(of).collect()
            } else {
                assert_eq!(about["componentType"], "FLOAT64");
                let of = |it: &[u8]| f64::from_le_bytes(it.try_into().unwrap()).into();
                values.chunks_exact(8).map(of).collect()
            };
            let is_missing = |value: &Json| about.get("noData").is_some_and(|missing| value == missing);
            let rows: Vec<Json> =
                rows.into_iter().map(|value| if is_missing(&value) { Json::Null } else { value }).collect();
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
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
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

/// A box of a thousandth of a degree and a height of 10 from 7 degrees east and 46 degrees north.
fn geographic_box() -> FaceList {
    let grid = Grid { bits: 14, origin: [7000, 46000, 0], step: 1.0, divisor: 1000.0 };
    let mut list = FaceList::new(grid, vec!["box".into()]);
    for face in cuboid([0; 3], [1, 1, 10_000]) {
        push(&mut list, &face, 0, None);
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

fn area(triangles: impl Iterator<Item = [Point; 3]>) -> f64 {
    triangles.map(double_area).sum::<f64>() / 2.0
}
