//! Triangles of exact models as binary glTF 2.0, with objects as features.

use std::collections::BTreeSet;

use serde_json::{Value as Json, json};

use super::super::gltf::buffer::GlbBuffer;
use super::super::gltf::glb::{file_of, linear_colour};
use super::face_mesh::{FaceMesh, FaceVertex};
use super::features::{FaceValues, PartTable, extension};
use spinney_base::Result;
use spinney_brep::Faces;

/// Component types.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Properties of a file.
#[derive(Default)]
pub(super) struct ModelGlbOptions {
    pub(super) is_coloured: bool,
    /// Whether vertices and triangles are compressed.
    pub(super) meshopt: bool,
    /// Origin of the root node's coordinates.
    pub(super) origin: glam::DVec3,
    /// A note for the file.
    pub(super) about: Option<Json>,
    /// Values of faces, if they have any.
    pub(super) values: FaceValues,
}

/// Returns a binary glTF file with a node per mesh. Faces have no normals: viewers show them flat.
///
/// # Errors
/// If attributes cannot be read.
pub(super) fn model_glb(
    faces: &dyn Faces,
    meshes: &[FaceMesh],
    ModelGlbOptions { is_coloured, meshopt, origin, about, values }: ModelGlbOptions,
) -> Result<Vec<u8>> {
    let parts: BTreeSet<u32> =
        meshes.iter().flat_map(|mesh| mesh.vertices.iter().map(|vertex| vertex.part)).collect();
    let (parts, values) = (PartTable::of(faces, &parts)?, values.table());
    let mut glb = ModelGlb { buffer: GlbBuffer::new(meshopt), accessors: Vec::new() };
    let (mut made, mut nodes) = (Vec::new(), vec![json!({ "name": "model" })]);
    for mesh in meshes.iter().filter(|mesh| !mesh.triangles.is_empty()) {
        let primitive = glb.primitive(mesh, (&parts, values.count), is_coloured);
        made.push(json!({ "primitives": [primitive] }));
        let [x, y, z] = (mesh.origin - origin).to_array();
        // (Subtraction from 0.0 avoids negative zeros.)
        nodes.push(json!({ "mesh": made.len() - 1, "translation": [x, z, 0.0 - y] }));
    }
    let mut root = json!({
        "asset": { "version": "2.0", "generator": "spinney" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
    });
    if let Some(about) = about {
        root["asset"]["extras"] = about;
    }
    if made.is_empty() {
        root["nodes"] = nodes.into();
        return Ok(file_of(&root, Vec::new()));
    }
    nodes[0]["children"] = (1..nodes.len()).collect();
    let mut used = vec!["EXT_mesh_features", "EXT_structural_metadata"];
    if let Some(extension) = glb.buffer.extension() {
        used.push(extension);
        root["extensionsRequired"] = json!([extension]);
    }
    root["extensionsUsed"] = used.into();
    let tables = [("object", &parts.table), ("face", &values)];
    let tables = if values.count == 0 { &tables[..1] } else { &tables };
    root["extensions"] = json!({ "EXT_structural_metadata": extension(tables, &mut glb.buffer) });
    root["nodes"] = nodes.into();
    root["meshes"] = made.into();
    root["materials"] = json!([{ "doubleSided": true,
        "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } }]);
    root["accessors"] = glb.accessors.into();
    let bin = glb.buffer.finish(root.as_object_mut().expect("it is made above"));
    Ok(file_of(&root, bin))
}

struct ModelGlb {
    buffer: GlbBuffer,
    accessors: Vec<Json>,
}

impl ModelGlb {
    fn primitive(
        &mut self,
        mesh: &FaceMesh,
        (parts, values): (&PartTable, usize),
        is_coloured: bool,
    ) -> Json {
        let up = |[x, y, z]: [f32; 3]| [x, z, 0.0 - y];
        let vertices = &mesh.vertices;
        let first = vertices.first().map_or([0.0; 3], |vertex| up(vertex.at));
        let [min, max] = vertices.iter().fold([first; 2], |[min, max], vertex| {
            let at = up(vertex.at);
            [[0, 1, 2].map(|axis| min[axis].min(at[axis])), [0, 1, 2].map(|axis| max[axis].max(at[axis]))]
        });
        let position = json!({ "componentType": FLOAT, "type": "VEC3", "min": min, "max": max });
        let position = self.vertices(vertices, position, |vertex| {
            let mut bytes = [0; 12];
            for (bytes, at) in bytes.chunks_exact_mut(4).zip(up(vertex.at)) {
                bytes.copy_from_slice(&at.to_le_bytes());
            }
            bytes
        });
        let objects = self.rows(vertices, parts.table.count, |vertex| parts.rows[&vertex.part]);
        let mut attributes = json!({ "POSITION": position, "_FEATURE_ID_0": objects });
        let set = |table: usize, count: usize, label: &str| json!({ "featureCount": count, "attribute": table, "propertyTable": table, "label": label });
        let mut sets = vec![set(0, parts.table.count, "objects")];
        if values > 0 {
            attributes["_FEATURE_ID_1"] = self.rows(vertices, values, |vertex| vertex.values).into();
            sets.push(set(1, values, "faces"));
        }
        if is_coloured {
            let colour = json!({ "componentType": UNSIGNED_SHORT, "normalized": true, "type": "VEC4" });
            let colour = self.vertices(vertices, colour, |vertex| {
                let mut bytes = [255; 8];
                for (bytes, part) in bytes.chunks_exact_mut(2).zip(linear_colour(vertex.colour)) {
                    bytes.copy_from_slice(&part.to_le_bytes());
                }
                bytes
            });
            attributes["COLOR_0"] = colour.into();
        }
        let is_small = vertices.len() <= usize::from(u16::MAX);
        let view = self.buffer.triangles(&mesh.triangles, is_small);
        let kind = if is_small { UNSIGNED_SHORT } else { UNSIGNED_INT };
        let count = mesh.triangles.len() * 3;
        let indices = self
            .accessor(json!({ "bufferView": view, "componentType": kind, "count": count, "type": "SCALAR" }));
        json!({
            "mode": 4,
            "material": 0,
            "attributes": attributes,
            "indices": indices,
            "extensions": { "EXT_mesh_features": { "featureIds": sets } },
        })
    }

    /// Adds an accessor to rows of a table with so many rows; returns its index.
    fn rows(&mut self, vertices: &[FaceVertex], count: usize, row: impl Fn(&FaceVertex) -> u32) -> usize {
        // (The row is a float where 16 bits are not enough: attributes have no integers of 32
        // bits.)
        let is_short = count <= usize::from(u16::MAX);
        let kind = if is_short { UNSIGNED_SHORT } else { FLOAT };
        self.vertices(vertices, json!({ "componentType": kind, "type": "SCALAR" }), |vertex| {
            let row = row(vertex);
            if is_short { row.to_le_bytes() } else { (row as f32).to_le_bytes() }
        })
    }

    /// Adds an accessor to a vertex attribute; returns its index. `N` is a multiple of 4 bytes.
    fn vertices<const N: usize>(
        &mut self,
        vertices: &[FaceVertex],
        mut accessor: Json,
        bytes: impl Fn(&FaceVertex) -> [u8; N],
    ) -> usize {
        let bytes: Vec<u8> = vertices.iter().flat_map(bytes).collect();
        accessor["bufferView"] = self.buffer.vertices(&bytes, N).into();
        accessor["count"] = vertices.len().into();
        self.accessor(accessor)
    }

    fn accessor(&mut self, accessor: Json) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}
