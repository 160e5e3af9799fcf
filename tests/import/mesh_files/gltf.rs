//! glTF: transforms, accessors and buffers, of files that are made here.

use serde_json::{Value as Json, json};
use spinney::Error;
use spinney::raw::import::mesh::{Model, open};

use super::mesh_files::*;

const FLOAT: u32 = 5126;

/// A file under construction: its JSON document and the bytes of its first buffer.
pub(crate) struct File {
    pub(crate) json: Json,
    pub(crate) bytes: Vec<u8>,
}

impl File {
    pub(crate) fn new() -> File {
        let json = json!({ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }],
            "nodes": [], "meshes": [], "accessors": [], "bufferViews": [], "buffers": [{}] });
        File { json, bytes: Vec::new() }
    }

    /// Adds an item to a list of the document; returns its index.
    fn add(&mut self, list: &str, item: Json) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let first = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.add("bufferViews", json!({ "buffer": 0, "byteOffset": first, "byteLength": bytes.len() }))
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, kind: &str) -> usize {
        let view = self.view(bytes);
        let accessor =
            json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
        self.add("accessors", accessor)
    }

    fn floats(&mut self, numbers: &[f32], kind: &str) -> usize {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let width = ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|name| *name == kind).unwrap() + 1;
        self.accessor(&bytes, FLOAT, numbers.len() / width, kind)
    }

    fn indices(&mut self, numbers: &[u32], size: usize) -> usize {
        let bytes: Vec<u8> =
            numbers.iter().flat_map(|number| number.to_le_bytes()[..size].to_vec()).collect();
        self.accessor(&bytes, [5121, 5123, 0, 5125][size - 1], numbers.len(), "SCALAR")
    }

    /// Adds a mesh with one primitive.
    fn mesh(&mut self, primitive: Json) -> usize {
        self.add("meshes", json!({ "primitives": [primitive] }))
    }

    /// Adds a root of the scene.
    fn root(&mut self, node: Json) -> usize {
        let node = self.add("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
        node
    }

    /// The same cube as in the other formats, with y up. Its vertices are repeated for each side,
    /// as if they had normals.
    pub(crate) fn cube() -> File {
        let mut file = File::new();
        let points: Vec<f32> = corners().iter().flatten().map(|number| *number as f32).collect();
        let positions = file.floats(&points, "VEC3");
        let indices = file.indices(&TRIANGLES, 2);
        let mesh = file.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
        file.root(json!({ "mesh": mesh }));
        file
    }

    fn document(&self, uri: Option<&str>) -> String {
        let mut json = self.json.clone();
        json["buffers"][0] = json!({ "byteLength": self.bytes.len() });
        if let Some(uri) = uri {
            json["buffers"][0]["uri"] = uri.into();
        }
        json.to_string()
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        glb(&self.document(None), &self.bytes)
    }

    /// JSON with the buffer as base64.
    pub(crate) fn embedded(&self) -> String {
        self.document(Some(&format!("data:application/octet-stream;base64,{}", base64(&self.bytes))))
    }
}

fn glb(json: &str, bytes: &[u8]) -> Vec<u8> {
    let mut text = json.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + text.len() as u32 + bytes.len() as u32).to_le_bytes());
    for (name, chunk) in [(b"JSON", &text[..]), (b"BIN\0", bytes)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend_from_slice(name);
        file.extend_from_slice(chunk);
    }
    file
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let number =
            three.iter().fold(0u32, |sum, byte| sum << 8 | u32::from(*byte)) << (8 * (3 - three.len()));
        for digit in 0..4 {
            let is_there = digit <= three.len();
            let digit = DIGITS[(number >> (18 - 6 * digit) & 63) as usize];
            text.push(if is_there { char::from(digit) } else { '=' });
        }
    }
    text
}

/// Corners of all sides of the cube, with y up.
fn corners() -> Vec<[f64; 3]> {
    let points = cube_points();
    CUBE.iter().flatten().map(|corner| points[*corner]).map(|[x, y, z]| [x, z, 0.0 - y]).collect()
}

const TRIANGLES: [u32; 36] = [
    0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7, 8, 9, 10, 8, 10, 11, 12, 13, 14, 12, 14, 15, 16, 17, 18, 16, 18, 19,
    20, 21, 22, 20, 22, 23,
];

/// Triangles of the cube as its reader should return them.
fn triangles() -> Vec<Vec<[f64; 3]>> {
    let points: Vec<[f64; 3]> = CUBE.iter().flatten().map(|corner| cube_points()[*corner]).collect();
    TRIANGLES.chunks(3).map(|three| three.iter().map(|corner| points[*corner as usize]).collect()).collect()
}

fn points(faces: &[OwnedFace]) -> Vec<Vec<[f64; 3]>> {
    faces.iter().map(|face| face.points.clone()).collect()
}

fn read(file: &File) -> (Vec<OwnedFace>, Box<dyn Model>) {
    let files = Files::new();
    let faces = files.faces("a.glb", file.glb()).unwrap();
    (faces, files.open("a.glb", file.glb()).unwrap())
}

fn error(file: &File) -> String {
    Files::new().error("a.glb", file.glb())
}

fn volume(faces: &[OwnedFace]) -> f64 {
    volume_and_area(faces)[0]
}

#[test]
fn binary_embedded_and_sibling_buffers() {
    let (file, files) = (File::cube(), Files::new());
    for name in ["a.glb", "a", "a.obj"] {
        assert_eq!(points(&files.faces(name, file.glb()).unwrap()), triangles(), "{name}");
    }
    for name in ["a.gltf", "a.json", "a"] {
        assert_eq!(points(&files.faces(name, file.embedded()).unwrap()), triangles(), "{name}");
    }
    for (name, uri) in [("a.bin", "a.bin"), ("b c.bin", "./b%20c.bin"), ("d.bin", "d\u{2e}bin")] {
        files.write(name, &file.bytes);
        assert_eq!(points(&files.faces("a.gltf", file.document(Some(uri))).unwrap()), triangles());
    }
    // JSON may escape slashes.
    let escaped = file.embedded().replace('/', "\\/");
    assert_eq!(points(&files.faces("a.gltf", escaped).unwrap()), triangles());
    let model = files.open("a.gltf", file.embedded()).unwrap();
    let info = model.info();
    assert_eq!((info.unit.as_deref(), info.faces, info.is_coloured), (Some("m"), Some(12), false));
    assert_eq!((&info.parts[..], info.bounds), (&["node 0".to_string()][..], [[0.0; 3], [2.0; 3]]));
    assert!(model.remarks().is_empty());

    files.write("short.bin", &file.bytes[1..]);
    assert!(open(&files.write("a.gltf", file.document(Some("none.bin"))), ENOUGH).is_err());
    let short = open(&files.write("a.gltf", file.document(Some("short.bin"))), ENOUGH);
    let text = short.map(|_| ()).unwrap_err().to_string();
    assert!(text.contains("short.bin") && text.contains("buffer 0"), "{text}");
    for uri in ["../a.bin", "/etc/passwd", "http://host/a.bin", "b\\..\\a.bin", "", "%2e%2e/a.bin", "C:a.bin"]
    {
        let text = files.error("a.gltf", file.document(Some(uri)));
        assert!(text.contains("below it"), "{uri}: {text}");
    }
    for uri in ["data:,abc", "data:;base64,ab*d", "data:;base64,abc=abcd"] {
        files.error("a.gltf", file.document(Some(uri)));
    }
}

#[test]
fn transforms_of_nodes_multiply() {
    let mut file = File::cube();
    // A quarter turn about y, which is up; then a scale of 2, then a translation.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    file.json["nodes"] = json!([
        { "children": [1, 3], "translation": [10.0, 20.0, 30.0] },
        { "children": [2], "scale": [2.0, 2.0, 2.0] },
        { "mesh": 0, "name": "turned", "rotation": [0.0, half, 0.0, half] },
        { "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0.5, 0, 1, 0, 1, 2, 3, 1] },
        { "mesh": 0, "name": "outside" },
    ]);
    let (faces, model) = read(&file);
    assert_eq!(model.info().parts, ["turned", "node 3"]);
    let of = |part: u32| faces.iter().filter(|face| face.part == part).cloned().collect::<Vec<_>>();
    let [turned, sheared] = [of(0), of(1)];
    assert!((volume(&turned) - 64.0).abs() < 1e-9 && (volume(&sheared) - 8.0).abs() < 1e-9);
    let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|axis| (a[axis] - b[axis]).abs() < 1e-9);
    // Point (2, 2, 2) of the model with z up is (2, 2, -2) in glTF, then (-2, 2, -2), (-4, 4, -4)
    // and (6, 24, 26).
    let find = |faces: &[OwnedFace], at: [f64; 3]| {
        let expected = triangles();
        let corners = expected.iter().flatten().zip(faces.iter().flat_map(|face| &face.points));
        corners.filter(|(point, _)| **point == at).map(|(_, found)| *found).next().unwrap()
    };
    assert!(near(find(&turned, [2.0; 3]), [6.0, -26.0, 24.0]), "{:?}", find(&turned, [2.0; 3]));
    // (2, 2, -2) + (0.5 * -2 + 1, 2, 3) + (10, 20, 30).
    assert!(near(find(&sheared, [2.0; 3]), [12.0, -31.0, 24.0]), "{:?}", find(&sheared, [2.0; 3]));

    // Without scenes, all roots are read.
    file.json.as_object_mut().unwrap().remove("scenes");
    file.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(read(&file).1.info().parts, ["turned", "node 3", "outside"]);
}

#[test]
fn world_coordinates_keep_their_precision() {
    let mut file = File::cube();
    file.json["nodes"][0]["translation"] = json!([4_500_000.125, 300.001, -5_600_000.375]);
    let least = read(&file).1.info().bounds[0];
    assert_eq!(least, [4_500_000.125, 5_600_000.375, 300.001]);
}

#[test]
fn mirrored_and_flat_nodes() {
    let mut file = File::cube();
    for scale in [[-1.0, 1.0, 1.0], [1.0, -2.0, 1.0], [-1.0, -1.0, -1.0]] {
        file.json["nodes"][0]["scale"] = json!(scale);
        let faces = read(&file).0;
        let expected: f64 = 8.0 * scale.iter().product::<f64>().abs();
        assert_eq!((faces.len(), volume(&faces)), (12, expected), "{scale:?}");
    }
    file.root(json!({ "mesh": 0, "scale": [1, 0, 1] }));
    let (faces, model) = read(&file);
    assert_eq!((faces.len(), model.remarks()), (12, vec!["left out: 1 node with a scale of 0".into()]));
}

#[test]
fn instances() {
    let mut file = File::cube();
    let translations = file.floats(&[0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 20.0, 0.0, 0.0], "VEC3");
    let scales = file.floats(&[1.0, 1.0, 1.0, 2.0, 2.0, 2.0, -1.0, 1.0, 1.0], "VEC3");
    file.json["nodes"][0] = json!({ "mesh": 0, "name": "tree", "translation": [0, 5, 0], "extensions": {
        "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": translations, "SCALE": scales } } } });
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let (faces, model) = read(&file);
    assert_eq!(model.info().parts, ["tree #1", "tree #2", "tree #3"]);
    assert_eq!(model.info().bounds, [[0.0, 0.0, 5.0], [20.0, 4.0, 9.0]]);
    assert_eq!((faces.len(), volume(&faces)), (36, 8.0 + 64.0 + 8.0));
    file.json["accessors"][scales]["count"] = 2.into();
    assert!(error(&file).contains("instances"));
    // Any number of instances without bytes.
    file.json["accessors"][scales] = json!({ "componentType": FLOAT, "count": 1u64 << 52, "type": "VEC3" });
    assert!(error(&file).contains("without a buffer view"));
}

#[test]
fn instances_without_faces_are_counted() {
    let mut file = File::cube();
    let translations = json!({ "componentType": FLOAT, "count": 4096, "type": "VEC3" });
    let translations = file.add("accessors", translations);
    file.json["nodes"][0] = json!({ "mesh": 0,
        "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": translations } } } });
    let bytes: Vec<u8> = [0f32; 9].iter().flat_map(|number| number.to_le_bytes()).collect();
    let flat = file.accessor(&bytes, FLOAT, 3, "VEC3");
    file.json["meshes"][0]["primitives"] = json!([{ "attributes": { "POSITION": flat } }]);
    let (_, mut model) = read(&file);
    assert_eq!((faces(&mut *model).unwrap().len(), model.degenerate()), (0, 4096));
}

#[test]
fn indices_of_all_sizes_strips_and_fans() {
    for size in [1, 2, 4] {
        let mut file = File::cube();
        let indices = file.indices(&TRIANGLES, size);
        file.json["meshes"][0]["primitives"][0]["indices"] = indices.into();
        assert_eq!(points(&read(&file).0), triangles(), "{size}");
        let wrong = file.indices(&[0, 1, 24], size);
        file.json["meshes"][0]["primitives"][0]["indices"] = wrong.into();
        assert!(error(&file).contains("vertex 24 of 24"));
        let incomplete = file.indices(&[0, 1, 2, 3], size);
        file.json["meshes"][0]["primitives"][0]["indices"] = incomplete.into();
        assert!(error(&file).contains("multiple of 3"));
    }
    // Without indices.
    let mut file = File::new();
    let expanded: Vec<f32> =
        TRIANGLES.iter().flat_map(|corner| corners()[*corner as usize].map(|number| number as f32)).collect();
    let positions = file.floats(&expanded, "VEC3");
    let mesh = file.mesh(json!({ "attributes": { "POSITION": positions }, "mode": 4 }));
    file.root(json!({ "mesh": mesh }));
    assert_eq!(points(&read(&file).0), triangles());

    // A square of two triangles, as a strip and as a fan: both have the same direction.
    let mut file = File::new();
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, -1.0];
    let positions = file.floats(&corners, "VEC3");
    let strip = file.mesh(json!({ "attributes": { "POSITION": positions }, "mode": 5 }));
    let order = file.indices(&[0, 1, 3, 2], 1);
    let fan = file.mesh(json!({ "attributes": { "POSITION": positions }, "mode": 6, "indices": order }));
    for mesh in [strip, fan] {
        file.root(json!({ "mesh": mesh }));
    }
    let faces = read(&file).0;
    assert_eq!(faces.len(), 4);
    for face in &faces {
        let [a, b, c] = [0, 1, 2].map(|corner| face.points[corner]);
        let z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert_eq!(z, 1.0, "{face:?}");
    }
    file.json["meshes"][0]["primitives"][0]["mode"] = 7.into();
    assert!(error(&file).contains("mode 7"));
}

#[test]
fn quantized_positions() {
    let points = corners();
    // Component type, its maximum, and whether numbers are normalized.
    for (component, size, most, normalized) in [
        (5120, 1, 127.0, true),
        (5121, 1, 255.0, true),
        (5122, 2, 32767.0, true),
        (5123, 2, 65535.0, true),
        (5120, 1, 2.0, false),
        (5122, 2, 2.0, false),
    ] {
        let is_signed = component == 5120 || component == 5122;
        let mut file = File::new();
        let mut bytes = Vec::new();
        for [x, y, z] in &points {
            // From 0 to 1, or from -1 to 1 along z if there are negative numbers.
            let z = if is_signed { z / 2.0 } else { z / 2.0 + 1.0 };
            for number in [x / 2.0, y / 2.0, z] {
                bytes.extend(&((number * most) as i64).to_le_bytes()[..size]);
            }
            // (Strides are multiples of 4.)
            bytes.resize(bytes.len().next_multiple_of(4), 0xff);
        }
        let positions = file.accessor(&bytes, component, 24, "VEC3");
        file.json["accessors"][positions]["normalized"] = normalized.into();
        let view = file.json["accessors"][positions]["bufferView"].as_u64().unwrap() as usize;
        file.json["bufferViews"][view]["byteStride"] = (bytes.len() / 24).into();
        let indices = file.indices(&TRIANGLES, 2);
        let mesh = file.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
        let scale = if normalized { 2.0 } else { 1.0 };
        let offset = if is_signed { 0.0 } else { -2.0 };
        file.root(json!({ "mesh": mesh, "scale": [scale, scale, scale], "translation": [0.0, 0.0, offset] }));
        file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        assert_eq!(self::points(&read(&file).0), triangles(), "{component}, {normalized}");
    }
}

#[test]
fn sparse_accessors() {
    let mut file = File::cube();
    // Vertex 0 moves from (0, 0, 0) to itself, two others to their own positions, from wrong ones.
    let vertices: [u16; 3] = [0, 7, 23];
    let values: Vec<f32> =
        vertices.iter().flat_map(|at| corners()[usize::from(*at)].map(|number| number as f32)).collect();
    let expected = triangles();
    let view = file.json["accessors"][0]["bufferView"].as_u64().unwrap() as usize;
    for at in vertices {
        let first = file.json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        file.bytes[first + usize::from(at) * 12..][..12].fill(0x41);
    }
    assert_ne!(points(&read(&file).0), expected);
    let indices = file.view(&vertices.map(u16::to_le_bytes).concat());
    let values = file.view(&values.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>());
    file.json["accessors"][0]["sparse"] = json!({ "count": 3,
        "indices": { "bufferView": indices, "componentType": 5123 }, "values": { "bufferView": values } });
    assert_eq!(points(&read(&file).0), expected);
    for (pointer, number, words) in [
        ("/accessors/0/sparse/count", json!(4), "within buffer view"),
        ("/accessors/0/sparse/count", json!(u64::MAX), "within buffer view"),
        ("/accessors/0/sparse/indices/componentType", json!(5122), "unsigned integers"),
        ("/accessors/0/sparse/indices/componentType", json!(5121), "increasing"),
        ("/accessors/0/sparse/values/bufferView", json!(99), "buffer view 99"),
    ] {
        let before = std::mem::replace(file.json.pointer_mut(pointer).unwrap(), number);
        let text = error(&file);
        assert!(text.contains(words), "{pointer}: {text}");
        *file.json.pointer_mut(pointer).unwrap() = before;
    }
    // Without a view, all other vertices are at the origin: each triangle has two equal corners.
    file.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    let (faces, model) = read(&file);
    assert!(faces.is_empty() && model.info().bounds == [[0.0; 3], [2.0; 3]], "{:?}", model.info());
}

#[test]
fn colours_are_encoded() {
    let mut file = File::cube();
    let mut numbers = vec![0.0; 24 * 4];
    // Linear 0.5 is 188 in sRGB.
    numbers.chunks_mut(4).for_each(|colour| colour.copy_from_slice(&[1.0, 0.5, 0.0, 1.0]));
    let colours = file.floats(&numbers, "VEC4");
    file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colours.into();
    let (faces, model) = read(&file);
    assert!(model.info().is_coloured && faces.iter().all(|face| face.colours == [[255, 188, 0]; 3]));
    let material =
        file.add("materials", json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 1, 1, 1] } }));
    file.json["meshes"][0]["primitives"][0]["material"] = material.into();
    assert!(read(&file).0.iter().all(|face| face.colours == [[188, 188, 0]; 3]));
    // Another primitive has no colour of its own.
    let plain = json!({ "attributes": { "POSITION": 0 } });
    file.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(plain);
    assert_eq!(read(&file).0[12].colours, [[255; 3]; 3]);
    file.json["accessors"][colours]["count"] = 23.into();
    assert!(error(&file).contains("23 colours of 24 vertices"));
}

#[test]
fn what_is_left_out_is_reported() {
    let mut file = File::cube();
    for (list, count) in [("textures", 2), ("skins", 1), ("animations", 3), ("cameras", 1)] {
        file.json[list] = vec![json!({ "anything": [1, 2] }); count].into();
    }
    file.add("scenes", json!({}));
    let primitives = file.json["meshes"][0]["primitives"].as_array_mut().unwrap();
    primitives[0]["targets"] = json!([{ "POSITION": 0 }]);
    primitives[0]["extensions"] = json!({ "EXT_mesh_features": { "featureIds": [] } });
    primitives.push(json!({ "attributes": { "POSITION": 0 }, "mode": 1 }));
    primitives.push(json!({ "attributes": {} }));
    let text = "left out: 1 primitive of points or lines, 1 primitive without positions, 2 textures, 1 skin, \
        1 primitive's morph targets, 1 primitive's feature identifiers, 3 animations, 1 camera, \
        1 scene that is not the default";
    assert_eq!(read(&file).1.remarks(), [text]);
}

#[test]
fn unsupported_extensions_and_versions() {
    let mut file = File::cube();
    file.json["extensionsRequired"] = json!(["KHR_materials_unlit", "KHR_texture_transform"]);
    assert_eq!(read(&file).0.len(), 12);
    file.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert!(error(&file).contains("Draco"));
    file.json["extensionsRequired"] = json!(["ACME_voxels"]);
    assert!(error(&file).contains("ACME_voxels"));
    file.json.as_object_mut().unwrap().remove("extensionsRequired");
    file.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } });
    assert_eq!(read(&file).0.len(), 12, "an uncompressed copy");
    file.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert!(error(&file).contains("Draco"));
    file.json["asset"]["version"] = "1.0".into();
    assert!(error(&file).contains("glTF 2.0"));
    let mut bytes = File::cube().glb();
    bytes[4] = 1;
    assert!(Files::new().error("a.glb", bytes).contains("version 1"));
}

#[test]
fn nodes_must_be_trees() {
    let mut file = File::cube();
    for (nodes, words) in [
        (json!([{ "mesh": 0 }, { "children": [2] }, { "children": [1] }]), "ancestor"),
        (json!([{ "mesh": 0 }, { "children": [1] }]), "ancestor"),
        (json!([{ "children": [1, 1] }, { "mesh": 0 }]), "one parent"),
        (json!([{ "children": [2] }, { "children": [2] }, { "mesh": 0 }]), "one parent"),
        (json!([{ "children": [7] }]), "node 7 of 1"),
        (json!([{ "mesh": 3 }]), "mesh 3 of 1"),
        (json!([{ "mesh": 0 }, { "children": [0] }]), "root"),
        (json!([{ "mesh": 0, "rotation": [0, 0, 0, 0] }]), "quaternion"),
        (json!([{ "mesh": 0, "matrix": [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] }]), "affine"),
        (json!([{ "mesh": 0, "scale": [1e308, 1e308, 1e308], "translation": [1e308, 0, 0] }]), "finite"),
        (json!([{}]), "no vertices"),
        (json!([]), "node 0 of 0"),
    ] {
        file.json["nodes"] = nodes.clone();
        let text = error(&file);
        assert!(text.contains(words), "{nodes}: {text}");
    }
    // A chain of many nodes.
    let mut nodes: Vec<Json> = (1..30_000).map(|child| json!({ "children": [child] })).collect();
    nodes.push(json!({ "mesh": 0 }));
    file.json["nodes"] = nodes.into();
    assert_eq!(read(&file).0.len(), 12);
}

#[test]
fn numbers_that_do_not_fit() {
    let file = File::cube();
    for (pointer, number) in [
        ("/accessors/0/count", json!(25)),
        ("/accessors/0/count", json!(u64::MAX)),
        ("/accessors/0/byteOffset", json!(1)),
        ("/accessors/0/byteOffset", json!(u64::MAX)),
        ("/accessors/0/componentType", json!(5125)),
        ("/accessors/0/componentType", json!(1)),
        ("/accessors/0/type", json!("MAT4")),
        ("/accessors/0/bufferView", json!(9)),
        ("/accessors/1/componentType", json!(5126)),
        ("/accessors/1/count", json!(-1)),
        ("/bufferViews/0/byteLength", json!(1u64 << 40)),
        ("/bufferViews/0/byteOffset", json!(u64::MAX)),
        ("/bufferViews/0/byteStride", json!(4)),
        ("/bufferViews/0/byteStride", json!(u64::MAX)),
        ("/bufferViews/0/buffer", json!(1)),
        ("/scene", json!(1)),
        ("/scenes/0/nodes/0", json!(5)),
        ("/meshes/0/primitives/0/indices", json!(99)),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(99)),
        ("/meshes/0/primitives/0/material", json!(0)),
        ("/asset", json!(null)),
        ("/nodes", json!({})),
    ] {
        let mut wrong = File { json: file.json.clone(), bytes: file.bytes.clone() };
        let (parent, name) = pointer.rsplit_once('/').unwrap();
        wrong.json.pointer_mut(parent).unwrap()[name
            .parse::<usize>()
            .map_or_else(
                |_| Box::new(name.to_string()) as Box<dyn serde_json::value::Index>,
                |index| Box::new(index),
            )
            .as_ref()] = number;
        error(&wrong);
    }
    let mut many = File::cube();
    many.json["nodes"] = vec![json!({}); 1 << 20].into();
    many.json["nodes"][0] = json!({ "mesh": 0 });
    let files = Files::new();
    assert!(open(&files.write("a.glb", many.glb()), 1 << 10).is_ok(), "3 MB of JSON");
    let nodes = many.json["nodes"].as_array_mut().unwrap();
    nodes.resize(2 << 20, json!({}));
    let path = files.write("a.glb", many.glb());
    assert!(matches!(open(&path, 1 << 10).map(|_| ()), Err(Error::TooLarge { .. })));
    assert!(open(&path, ENOUGH).is_ok());
}

#[test]
fn truncated_and_changed_files() {
    let file = File::cube();
    assert_eq!(read_truncated("a.glb", &file.glb()), 0);
    read_truncated("a.gltf", file.embedded().as_bytes());
    let files = Files::new();
    let bytes = file.glb();
    let mut state = 1u64;
    for _ in 0..3000 {
        let mut changed = bytes.clone();
        for _ in 0..3 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            changed[(state >> 40) as usize % bytes.len()] = (state >> 32) as u8;
        }
        let path = files.write("a.glb", &changed);
        if let Ok(mut model) = open(&path, ENOUGH) {
            let _ = model.faces(&mut |_| Ok(()));
        }
    }
}
