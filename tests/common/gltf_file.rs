//! A second, independent reader of binary glTF and of tilesets, as far as tests need it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::Value as Json;

/// A node's triangles in the coordinates of its parent node.
#[derive(Default)]
pub struct Mesh {
    pub corners: Vec<Corner>,
    pub triangles: Vec<[usize; 3]>,
}

#[derive(Clone, Copy)]
pub struct Corner {
    pub at: [f64; 3],
    pub normal: [f64; 3],
    pub colour: Option<[f64; 3]>,
    pub class: Option<u16>,
}

/// A binary glTF file.
pub struct Glb {
    pub json: Json,
    /// The root's matrix in column-major order.
    pub matrix: [f64; 16],
    pub meshes: Vec<Mesh>,
    bin: Vec<u8>,
}

impl Glb {
    pub fn read(path: &Path) -> Glb {
        let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (b"glTF".as_slice(), 2, bytes.len()));
        let length = word(12);
        assert_eq!(&bytes[16..20], b"JSON");
        let json: Json = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let bin = match bytes.get(20 + length..) {
            Some([]) | None => Vec::new(),
            Some(chunk) => {
                assert_eq!(&chunk[4..8], b"BIN\0");
                assert_eq!(word(20 + length), chunk.len() - 8);
                chunk[8..].to_vec()
            }
        };
        check_contents(&json, &path.display().to_string());
        let matrix = std::array::from_fn(|at| json["nodes"][0]["matrix"][at].as_f64().unwrap());
        let mut glb = Glb { json, matrix, meshes: Vec::new(), bin };
        for node in glb.json["nodes"].as_array().unwrap().iter().skip(1) {
            glb.meshes.push(glb.mesh(node));
        }
        glb
    }

    fn mesh(&self, node: &Json) -> Mesh {
        let number = |json: &Json, axis: usize| json[axis].as_f64().unwrap();
        let primitive = &self.json["meshes"][node["mesh"].as_u64().unwrap() as usize]["primitives"][0];
        let read = |name: &str| {
            let accessor = &primitive["attributes"][name];
            accessor.as_u64().map(|accessor| self.numbers(accessor as usize))
        };
        let positions = read("POSITION").unwrap();
        let (normals, colours, classes) = (read("NORMAL").unwrap(), read("COLOR_0"), read("_FEATURE_ID_0"));
        let corners = positions.iter().enumerate().map(|(i, place)| Corner {
            at: [0, 1, 2]
                .map(|axis| number(&node["translation"], axis) + number(&node["scale"], axis) * place[axis]),
            normal: [0, 1, 2].map(|axis| normals[i][axis] / 127.0),
            colour: colours.as_ref().map(|colours| [0, 1, 2].map(|axis| colours[i][axis] / 65535.0)),
            class: classes.as_ref().map(|classes| classes[i][0] as u16),
        });
        let corners = corners.collect();
        let numbers = self.numbers(primitive["indices"].as_u64().unwrap() as usize);
        let numbers: Vec<usize> = numbers.iter().map(|number| number[0] as usize).collect();
        Mesh { corners, triangles: numbers.chunks_exact(3).map(|it| it.try_into().unwrap()).collect() }
    }

    /// Returns the elements of an accessor as stored.
    fn numbers(&self, accessor: usize) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][accessor];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let parts = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let kind = accessor["componentType"].as_u64().unwrap();
        let size = [1, 2, 4][(kind as usize - 5120) / 2];
        let stride = view["byteStride"].as_u64().map_or(parts * size, |stride| stride as usize);
        let first = view["byteOffset"].as_u64().unwrap() as usize;
        let number = |at: usize| match kind {
            5120 => f64::from(self.bin[at].cast_signed()),
            5123 => f64::from(u16::from_le_bytes([self.bin[at], self.bin[at + 1]])),
            _ => f64::from(u32::from_le_bytes(self.bin[at..at + 4].try_into().unwrap())),
        };
        let count = accessor["count"].as_u64().unwrap() as usize;
        let element = |i: usize| (0..parts).map(|part| number(first + i * stride + part * size)).collect();
        (0..count).map(element).collect()
    }

    /// Returns the bytes of a buffer view.
    pub fn view(&self, view: &Json) -> &[u8] {
        let view = &self.json["bufferViews"][view.as_u64().unwrap() as usize];
        let [first, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
        &self.bin[first..first + length]
    }
}

/// Checks that nothing is empty: the glTF schema allows no empty lists, accessors or views, and
/// every node except the root has a mesh.
fn check_contents(json: &Json, name: &str) {
    let list = |key: &str| json[key].as_array().map_or(&[][..], Vec::as_slice);
    for (key, value) in json.as_object().unwrap() {
        assert!(value.as_array().is_none_or(|list| !list.is_empty()), "{name}: {key} is empty");
    }
    assert!(list("nodes").iter().skip(1).all(|node| node["mesh"].is_u64()), "{name}");
    assert!(list("nodes")[0].get("children").is_none_or(|children| children[0].is_u64()), "{name}");
    assert_eq!(list("meshes").len(), list("nodes").len() - 1, "{name}");
    assert!(list("accessors").iter().all(|accessor| accessor["count"].as_u64() > Some(0)), "{name}");
    assert!(list("bufferViews").iter().all(|view| view["byteLength"].as_u64() > Some(0)), "{name}");
    for mesh in list("meshes") {
        let indices = mesh["primitives"][0]["indices"].as_u64().unwrap() as usize;
        assert_eq!(list("accessors")[indices]["count"].as_u64().unwrap() % 3, 0, "{name}");
    }
    for extension in list("extensionsUsed") {
        let text = json.to_string();
        // KHR_mesh_quantization has no member of its own.
        let has = text.contains(&format!("{extension}:")) || extension == "KHR_mesh_quantization";
        assert!(has && !list("meshes").is_empty(), "{name}: {extension}");
    }
    for table in
        json["extensions"]["EXT_structural_metadata"]["propertyTables"].as_array().into_iter().flatten()
    {
        assert!(table["count"].as_u64() > Some(0), "{name}");
    }
}

/// A tile: level, x, y, z.
pub type TilePosition = [u32; 4];

/// The tiles of a tileset, as listed by its subtrees.
#[derive(Default)]
pub struct Tiles {
    /// Tiles, and whether each has content.
    pub tiles: BTreeMap<TilePosition, bool>,
    /// Explicit bounding boxes: centre and half side lengths.
    pub boxes: BTreeMap<TilePosition, [[f64; 3]; 2]>,
    /// Names of subtree files.
    pub files: BTreeSet<String>,
}

impl Tiles {
    pub fn read(directory: &Path, tileset: &Json) -> Tiles {
        let implicit = &tileset["root"]["children"][0]["implicitTiling"];
        assert_eq!(implicit["subdivisionScheme"], "OCTREE");
        let [levels, of_subtree] =
            ["availableLevels", "subtreeLevels"].map(|key| implicit[key].as_u64().unwrap() as u32);
        let mut found = Tiles::default();
        let mut pending = vec![[0; 4]];
        while let Some(root) = pending.pop() {
            let [level, x, y, z] = root;
            let name = format!("subtrees/{level}/{x}/{y}/{z}.subtree");
            let bytes = std::fs::read(directory.join(&name)).unwrap();
            found.files.insert(name);
            let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
            assert_eq!(&bytes[..8], b"subt\x01\0\0\0");
            assert_eq!(24 + word(8) + word(16), bytes.len());
            assert_eq!(word(8) % 8, 0);
            let json: Json = serde_json::from_slice(&bytes[24..24 + word(8)]).unwrap();
            let bin = &bytes[24 + word(8)..];
            let view = |view: &Json| {
                let view = &json["bufferViews"][view.as_u64().unwrap() as usize];
                let [first, length] =
                    ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
                &bin[first..first + length]
            };
            let bits = |json: &Json, count: usize| -> Vec<bool> {
                if let Some(constant) = json["constant"].as_u64() {
                    return vec![constant == 1; count];
                }
                let bytes = view(&json["bitstream"]);
                assert_eq!(bytes.len(), count.div_ceil(8));
                let bits: Vec<bool> = (0..count).map(|bit| bytes[bit / 8] >> (bit % 8) & 1 == 1).collect();
                let set = bits.iter().filter(|bit| **bit).count();
                assert_eq!(json["availableCount"].as_u64(), Some(set as u64));
                bits
            };
            let child = |below: u32, order: u32| -> TilePosition {
                let place =
                    |axis: u32| (0..below).map(|bit| (order >> (3 * bit + axis) & 1) << bit).sum::<u32>();
                [level + below, (x << below) + place(0), (y << below) + place(1), (z << below) + place(2)]
            };
            let nodes = (8usize.pow(of_subtree) - 1) / 7;
            let available = bits(&json["tileAvailability"], nodes);
            let contents = bits(&json["contentAvailability"][0], nodes);
            let all = (0..of_subtree).flat_map(|below| (0..8u32.pow(below)).map(move |order| (below, order)));
            let mut here = Vec::new();
            for ((below, order), (is_there, has_content)) in all.zip(available.iter().zip(&contents)) {
                assert!(is_there | !has_content);
                if *is_there {
                    let place = child(below, order);
                    assert!(place[0] < levels);
                    found.tiles.insert(place, *has_content);
                    here.push(place);
                }
            }
            if !json["propertyTables"].is_null() {
                let table = &json["propertyTables"][json["tileMetadata"].as_u64().unwrap() as usize];
                assert_eq!(table["count"].as_u64(), Some(here.len() as u64));
                let bytes = view(&table["properties"]["boundingBox"]["values"]);
                assert_eq!(bytes.len(), here.len() * 96);
                for (place, bytes) in here.iter().zip(bytes.chunks_exact(96)) {
                    let numbers: Vec<f64> =
                        bytes.chunks_exact(8).map(|it| f64::from_le_bytes(it.try_into().unwrap())).collect();
                    let centre = [numbers[0], numbers[1], numbers[2]];
                    found.boxes.insert(*place, [centre, [numbers[3], numbers[7], numbers[11]]]);
                }
            }
            let children = bits(&json["childSubtreeAvailability"], 8usize.pow(of_subtree));
            let children = (0u32..).zip(children).filter(|(_, is_there)| *is_there);
            pending.extend(children.map(|(order, _)| child(of_subtree, order)));
        }
        for place in found.tiles.keys().filter(|place| place[0] > 0) {
            let [level, x, y, z] = *place;
            assert!(found.tiles.contains_key(&[level - 1, x / 2, y / 2, z / 2]), "{place:?} has no parent");
        }
        found
    }
}
