//! Surfaces as binary glTF 2.0: quantised positions and normals (KHR_mesh_quantization), colours, and classes as features
//! (EXT_mesh_features, EXT_structural_metadata).

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};

use super::surface::{MARGIN, STEPS, Surface};
use crate::store::Metadata;

/// The attribute of cells in a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ModelAttribute {
    None,
    /// A colour, `red << 16 | green << 8 | blue`.
    Colour,
    /// A class.
    Class,
}

/// Numbers of glTF: types of components, and what a buffer is for.
const BYTE: u32 = 5120;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// A model that is being made: surfaces as nodes below one.
pub(super) struct Model<'a> {
    attribute: ModelAttribute,
    metadata: &'a Metadata,
    bin: Vec<u8>,
    views: Vec<Json>,
    accessors: Vec<Json>,
    meshes: Vec<Json>,
    nodes: Vec<Json>,
    /// Rows of the table of classes.
    classes: BTreeMap<u32, u32>,
}

impl<'a> Model<'a> {
    /// `matrix` is that of the root, by columns; coordinates below it are cells of the deepest level. `classes` are all
    /// that the surfaces have.
    pub(super) fn new(
        attribute: ModelAttribute,
        metadata: &'a Metadata,
        matrix: [f64; 16],
        classes: impl IntoIterator<Item = u32>,
    ) -> Model<'a> {
        let sorted: std::collections::BTreeSet<u32> = classes.into_iter().collect();
        Model {
            attribute,
            metadata,
            bin: Vec::new(),
            views: Vec::new(),
            accessors: Vec::new(),
            meshes: Vec::new(),
            nodes: vec![json!({ "matrix": matrix })],
            classes: sorted.into_iter().zip(0..).collect(),
        }
    }

    /// Adds the surface of a tile whose first cell, and cells, are those of the deepest level.
    pub(super) fn push(&mut self, surface: &Surface, origin: [f64; 3], cell: f64) {
        let corners = &surface.corners;
        let mut attributes = serde_json::Map::new();
        let steps = |range: fn(u16, u16) -> u16, first: u16| -> Vec<u16> {
            (0..3).map(|axis| corners.iter().map(|corner| corner.at[axis]).fold(first, range)).collect()
        };
        let (min, max) = (steps(u16::min, u16::MAX), steps(u16::max, 0));
        // Elements stand at multiples of four bytes.
        let bytes = corners.iter().flat_map(|corner| {
            let [x, y, z] = corner.at.map(u16::to_le_bytes);
            [x, y, z, [0; 2]].concat()
        });
        let view = self.view(bytes.collect(), Some(8), VERTICES);
        let position = json!({ "bufferView": view, "componentType": UNSIGNED_SHORT, "count": corners.len(),
            "type": "VEC3", "min": min, "max": max });
        attributes.insert("POSITION".into(), self.accessor(position));
        let bytes = corners.iter().flat_map(|corner| {
            let [x, y, z] = corner.normal.map(|number| number as u8);
            [x, y, z, 0]
        });
        let view = self.view(bytes.collect(), Some(4), VERTICES);
        let normal = json!({ "bufferView": view, "componentType": BYTE, "normalized": true,
            "count": corners.len(), "type": "VEC3" });
        attributes.insert("NORMAL".into(), self.accessor(normal));
        if self.has_colours() {
            let bytes = corners
                .iter()
                .flat_map(|corner| self.colour(corner.attribute).map(u16::to_le_bytes).concat());
            let view = self.view(bytes.collect::<Vec<u8>>(), Some(8), VERTICES);
            let colour = json!({ "bufferView": view, "componentType": UNSIGNED_SHORT, "normalized": true,
                "count": corners.len(), "type": "VEC4" });
            attributes.insert("COLOR_0".into(), self.accessor(colour));
        }
        let mut primitive = json!({ "mode": 4, "material": 0 });
        if self.attribute == ModelAttribute::Class {
            let row = |corner: &super::surface::Corner| self.classes[&corner.attribute] as u16;
            let bytes = corners.iter().flat_map(|corner| [row(corner).to_le_bytes(), [0; 2]].concat());
            let view = self.view(bytes.collect(), Some(4), VERTICES);
            let feature = json!({ "bufferView": view, "componentType": UNSIGNED_SHORT, "count": corners.len(),
                "type": "SCALAR" });
            attributes.insert("_FEATURE_ID_0".into(), self.accessor(feature));
            let features = json!({ "featureIds": [{ "featureCount": self.classes.len(), "attribute": 0,
                "propertyTable": 0, "label": "classes" }] });
            primitive["extensions"] = json!({ "EXT_mesh_features": features });
        }
        let is_small = corners.len() <= usize::from(u16::MAX);
        let numbers = surface.triangles.iter().flatten();
        let bytes: Vec<u8> = match is_small {
            true => numbers.flat_map(|number| (*number as u16).to_le_bytes()).collect(),
            false => numbers.flat_map(|number| number.to_le_bytes()).collect(),
        };
        let view = self.view(bytes, None, INDICES);
        let kind = if is_small { UNSIGNED_SHORT } else { UNSIGNED_INT };
        let indices = json!({ "bufferView": view, "componentType": kind, "count": surface.triangles.len() * 3,
            "type": "SCALAR" });
        primitive["indices"] = self.accessor(indices);
        primitive["attributes"] = attributes.into();
        self.meshes.push(json!({ "primitives": [primitive] }));
        let scale = cell / STEPS;
        self.nodes.push(json!({
            "mesh": self.meshes.len() - 1,
            "translation": origin.map(|at| at - MARGIN * cell),
            "scale": [scale, scale, scale],
        }));
    }

    /// The bytes of the file.
    pub(super) fn finish(mut self) -> Vec<u8> {
        let mut extensions = vec!["KHR_mesh_quantization"];
        let mut extra = serde_json::Map::new();
        if self.attribute == ModelAttribute::Class {
            extensions.extend(["EXT_mesh_features", "EXT_structural_metadata"]);
            extra.insert("EXT_structural_metadata".into(), self.class_table());
        }
        self.nodes[0]["children"] = (1..self.nodes.len()).collect();
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "spinney" },
            "extensionsUsed": extensions,
            "extensionsRequired": ["KHR_mesh_quantization"],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": [{ "doubleSided": true,
                "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.bin.len() }],
        });
        if !extra.is_empty() {
            root["extensions"] = extra.into();
        }
        let mut text = root.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.bin.len();
        let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        let mut file = words(&[0x4654_6c67, 2, length as u32, text.len() as u32, 0x4e4f_534a]);
        file.extend(text);
        file.extend(words(&[self.bin.len() as u32, 0x004e_4942]));
        file.append(&mut self.bin);
        file
    }

    fn has_colours(&self) -> bool {
        match self.attribute {
            ModelAttribute::None => false,
            ModelAttribute::Colour => true,
            ModelAttribute::Class => self.metadata.palette.is_some(),
        }
    }

    /// The colour of an attribute: linear, and opaque.
    fn colour(&self, attribute: u32) -> [u16; 4] {
        let [_, r, g, b] = match (self.attribute, &self.metadata.palette) {
            (ModelAttribute::Class, Some(palette)) => {
                let [r, g, b, _] = palette.colours.get(attribute as usize).copied().unwrap_or_default();
                [0, r, g, b]
            }
            _ => attribute.to_be_bytes(),
        };
        // IEC 61966-2-1.
        let linear = |number: u8| {
            let number = f64::from(number) / 255.0;
            let linear =
                if number <= 0.040_45 { number / 12.92 } else { ((number + 0.055) / 1.055).powf(2.4) };
            (linear * 65535.0).round() as u16
        };
        [linear(r), linear(g), linear(b), u16::MAX]
    }

    /// The table of classes: number and name of each.
    fn class_table(&mut self) -> Json {
        let values: Vec<u8> = self.classes.keys().flat_map(|value| value.to_le_bytes()).collect();
        let (mut texts, mut offsets) = (Vec::new(), vec![0u32]);
        for value in self.classes.keys() {
            let name = self.metadata.class_names.get(&i64::from(*value)).map_or("", String::as_str);
            texts.extend(name.bytes());
            offsets.push(texts.len() as u32);
        }
        // (Views of no bytes there are none.)
        if texts.is_empty() {
            texts.push(0);
        }
        let offsets = offsets.iter().flat_map(|offset| offset.to_le_bytes()).collect();
        let [values, texts, offsets] = [values, texts, offsets].map(|bytes| self.table_view(bytes));
        json!({
            "schema": { "id": "classes", "classes": { "class": { "properties": {
                "value": { "type": "SCALAR", "componentType": "UINT32" },
                "name": { "type": "STRING" },
            } } } },
            "propertyTables": [{ "class": "class", "count": self.classes.len(), "properties": {
                "value": { "values": values },
                "name": { "values": texts, "stringOffsets": offsets },
            } }],
        })
    }

    fn table_view(&mut self, bytes: Vec<u8>) -> usize {
        self.append(bytes, json!({}))
    }

    fn view(&mut self, bytes: Vec<u8>, stride: Option<u32>, target: u32) -> usize {
        let mut view = json!({ "target": target });
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.append(bytes, view)
    }

    fn append(&mut self, bytes: Vec<u8>, mut view: Json) -> usize {
        view["buffer"] = 0.into();
        view["byteOffset"] = self.bin.len().into();
        view["byteLength"] = bytes.len().into();
        self.bin.extend(bytes);
        // (Numbers of 64 bits in tables stand at multiples of eight.)
        self.bin.resize(self.bin.len().next_multiple_of(8), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Json) -> Json {
        self.accessors.push(accessor);
        (self.accessors.len() - 1).into()
    }
}
