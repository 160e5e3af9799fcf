//! Triangles as binary glTF 2.0: quantized positions and normals (KHR_mesh_quantization), colours,
//! and classes as features (EXT_mesh_features, EXT_structural_metadata).

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};

use super::GltfOptions;
use super::buffer::GlbBuffer;
use super::tile_mesh::{MARGIN, STEPS, TileCorner, TileMesh};
use spinney_container::Metadata;
use spinney_crs::Frame;

/// Attribute of a tile's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TileAttribute {
    None,
    /// Colour, `red << 16 | green << 8 | blue`.
    Colour,
    /// Class.
    Class,
}

/// Component types.
const BYTE: u32 = 5120;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;

/// File under construction: the triangles of each tile are a child of the root node.
pub(super) struct Glb<'a> {
    attribute: TileAttribute,
    metadata: &'a Metadata,
    buffer: GlbBuffer,
    accessors: Vec<Json>,
    meshes: Vec<Json>,
    nodes: Vec<Json>,
    /// Row in the table of classes, by class.
    classes: BTreeMap<u32, u32>,
}

impl<'a> Glb<'a> {
    /// `matrix` is the root's matrix by columns; coordinates below it are cells of the finest
    /// level. `classes` are all attributes that the triangles have.
    pub(super) fn new(
        attribute: TileAttribute,
        options: &GltfOptions,
        metadata: &'a Metadata,
        matrix: [f64; 16],
        classes: impl IntoIterator<Item = u32>,
    ) -> Glb<'a> {
        let mut numbers = BTreeMap::new();
        numbers.extend(classes.into_iter().map(|class| (class, 0)));
        numbers.values_mut().zip(0..).for_each(|(number, next)| *number = next);
        Glb {
            attribute,
            metadata,
            buffer: GlbBuffer::new(options.meshopt),
            accessors: Vec::new(),
            meshes: Vec::new(),
            nodes: vec![json!({ "matrix": matrix })],
            classes: numbers,
        }
    }

    /// Adds the triangles of a tile. `origin` is its first cell and `cell` the side of its cells,
    /// both in cells of the finest level.
    pub(super) fn push(&mut self, mesh: &TileMesh, origin: [f64; 3], cell: f64) {
        let corners = &mesh.corners;
        let steps = |range: fn(u16, u16) -> u16, first: u16| -> Vec<u16> {
            (0..3).map(|axis| corners.iter().map(|corner| corner.at[axis]).fold(first, range)).collect()
        };
        let (min, max) = (steps(u16::min, u16::MAX), steps(u16::max, 0));
        let position = json!({ "componentType": UNSIGNED_SHORT, "type": "VEC3", "min": min, "max": max });
        let position = self.vertices(corners, position, |corner| {
            let [x, y, z] = corner.at;
            shorts([x, y, z, 0])
        });
        let normal = json!({ "componentType": BYTE, "normalized": true, "type": "VEC3" });
        let normal = self.vertices(corners, normal, |corner| {
            let [x, y, z] = corner.normal.map(i8::cast_unsigned);
            [x, y, z, 0]
        });
        let mut attributes = json!({ "POSITION": position, "NORMAL": normal });
        if let Some(colours) = self.colours() {
            let colour = json!({ "componentType": UNSIGNED_SHORT, "normalized": true, "type": "VEC4" });
            attributes["COLOR_0"] =
                self.vertices(corners, colour, |corner| shorts(colours(corner.attribute))).into();
        }
        let mut primitive = json!({ "mode": 4, "material": 0 });
        if self.attribute == TileAttribute::Class {
            let classes = self.classes.clone();
            let feature = json!({ "componentType": UNSIGNED_SHORT, "type": "SCALAR" });
            let feature = self.vertices(corners, feature, |corner| {
                // (Classes have at most 16 bits, and so do their row numbers.)
                let [low, high] = (classes[&corner.attribute] as u16).to_le_bytes();
                [low, high, 0, 0]
            });
            attributes["_FEATURE_ID_0"] = feature.into();
            primitive["extensions"] = json!({ "EXT_mesh_features": { "featureIds": [{
                "featureCount": self.classes.len(), "attribute": 0, "propertyTable": 0, "label": "classes",
            }] } });
        }
        let is_small = corners.len() <= usize::from(u16::MAX);
        let view = self.buffer.triangles(&mesh.triangles, is_small);
        let kind = if is_small { UNSIGNED_SHORT } else { UNSIGNED_INT };
        primitive["indices"] = self
            .accessor(json!({ "bufferView": view, "componentType": kind,
            "count": mesh.triangles.len() * 3, "type": "SCALAR" }))
            .into();
        primitive["attributes"] = attributes;
        self.meshes.push(json!({ "primitives": [primitive] }));
        let scale = cell / STEPS;
        self.nodes.push(json!({
            "mesh": self.meshes.len() - 1,
            "translation": origin.map(|at| at - MARGIN * cell),
            "scale": [scale, scale, scale],
        }));
    }

    /// Returns the bytes of the file. A file without triangles has only the root node: empty lists
    /// and unused extensions are not allowed.
    pub(super) fn finish(mut self) -> Vec<u8> {
        if self.meshes.is_empty() {
            let root = json!({
                "asset": { "version": "2.0", "generator": "spinney" },
                "scene": 0,
                "scenes": [{ "nodes": [0] }],
                "nodes": self.nodes,
            });
            return file_of(&root, Vec::new());
        }
        let mut required = vec!["KHR_mesh_quantization"];
        required.extend(self.buffer.extension());
        let mut used = required.clone();
        let mut extensions = serde_json::Map::new();
        if self.attribute == TileAttribute::Class {
            used.extend(["EXT_mesh_features", "EXT_structural_metadata"]);
            extensions.insert("EXT_structural_metadata".into(), self.class_table());
        }
        self.nodes[0]["children"] = (1..self.nodes.len()).collect();
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "spinney" },
            "extensionsUsed": used,
            "extensionsRequired": required,
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": [{ "doubleSided": true,
                "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } }],
            "accessors": self.accessors,
        });
        if !extensions.is_empty() {
            root["extensions"] = extensions.into();
        }
        let bin = self.buffer.finish(root.as_object_mut().expect("it is made above"));
        file_of(&root, bin)
    }

    /// Adds an accessor to a vertex attribute; returns its index. `N` must be a multiple of 4
    /// bytes.
    fn vertices<const N: usize>(
        &mut self,
        corners: &[TileCorner],
        mut accessor: Json,
        bytes: impl Fn(&TileCorner) -> [u8; N],
    ) -> usize {
        let bytes: Vec<u8> = corners.iter().flat_map(bytes).collect();
        accessor["bufferView"] = self.buffer.vertices(&bytes, N).into();
        accessor["count"] = corners.len().into();
        self.accessor(accessor)
    }

    fn accessor(&mut self, accessor: Json) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Map from attributes to colours, which are linear and opaque.
    fn colours(&self) -> Option<impl Fn(u32) -> [u16; 4] + use<'a>> {
        let palette = self.metadata.palette.as_ref();
        let is_class = match self.attribute {
            TileAttribute::None => return None,
            TileAttribute::Colour => false,
            TileAttribute::Class => {
                palette?;
                true
            }
        };
        let table: [u16; 256] = std::array::from_fn(|number| linear(number as u8));
        Some(move |attribute: u32| {
            let [_, r, g, b] = match palette.filter(|_| is_class) {
                Some(palette) => {
                    let [r, g, b, _] = palette.colours.get(attribute as usize).copied().unwrap_or_default();
                    [0, r, g, b]
                }
                None => attribute.to_be_bytes(),
            };
            let [r, g, b] = [r, g, b].map(|number| table[usize::from(number)]);
            [r, g, b, u16::MAX]
        })
    }

    /// Table of classes: value and name of each.
    fn class_table(&mut self) -> Json {
        let values: Vec<u8> = self.classes.keys().flat_map(|value| value.to_le_bytes()).collect();
        let (mut names, mut offsets) = (Vec::new(), vec![0u32]);
        for value in self.classes.keys() {
            let name = self.metadata.class_names.get(&(*value).into()).map_or("", String::as_str);
            names.extend(name.bytes());
            offsets.push(names.len() as u32);
        }
        if names.is_empty() {
            // (Views must not be empty.)
            names.push(0);
        }
        let offsets: Vec<u8> = offsets.iter().flat_map(|offset| offset.to_le_bytes()).collect();
        let [values, names, offsets] = [values, names, offsets].map(|bytes| self.buffer.table(&bytes));
        json!({
            "schema": { "id": "classes", "classes": { "class": { "properties": {
                "value": { "type": "SCALAR", "componentType": "UINT32" },
                "name": { "type": "STRING" },
            } } } },
            "propertyTables": [{ "class": "class", "count": self.classes.len(), "properties": {
                "value": { "values": values },
                "name": { "values": names, "stringOffsets": offsets },
            } }],
        })
    }
}

/// Returns a linear part of a colour: the sRGB transfer function, IEC 61966-2-1.
fn linear(number: u8) -> u16 {
    let number = f64::from(number) / 255.0;
    let linear = if number <= 0.040_45 { number / 12.92 } else { ((number + 0.055) / 1.055).powf(2.4) };
    (linear * 65535.0).round() as u16
}

/// Returns the linear parts of a colour.
pub(in crate::export) fn linear_colour(colour: [u8; 3]) -> [u16; 3] {
    colour.map(linear)
}

/// GLB file with a JSON chunk and a binary chunk.
pub(in crate::export) fn file_of(root: &Json, bin: Vec<u8>) -> Vec<u8> {
    let mut text = root.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let chunks = [(b"JSON", text), (b"BIN\0", bin)];
    let chunks = chunks.iter().filter(|(_, bytes)| !bytes.is_empty());
    let length: usize = chunks.clone().map(|(_, bytes)| 8 + bytes.len()).sum();
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend(((12 + length) as u32).to_le_bytes());
    for (name, bytes) in chunks {
        file.extend((bytes.len() as u32).to_le_bytes());
        file.extend_from_slice(*name);
        file.extend_from_slice(bytes);
    }
    file
}

fn shorts(numbers: [u16; 4]) -> [u8; 8] {
    let [a, b, c, d] = numbers.map(u16::to_le_bytes);
    [a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]]
}

/// Frame matrix by columns, with y up as in glTF; trees have z up.
pub(super) fn y_up(frame: &Frame) -> [f64; 16] {
    let m = &frame.matrix;
    let mut columns = [0.0; 16];
    for column in 0..4 {
        let [x, y, z] = [m[0][column], m[1][column], m[2][column]];
        // (Subtraction from 0.0 avoids negative zeros.)
        columns[4 * column..4 * column + 3].copy_from_slice(&[x, z, 0.0 - y]);
    }
    columns[15] = 1.0;
    columns
}
