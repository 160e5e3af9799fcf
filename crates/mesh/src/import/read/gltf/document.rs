//! JSON document of glTF 2.0: the members that geometry depends on.
//!
//! (The `gltf` crate has transforms in single precision, which is too coarse for world
//! coordinates.)

use std::borrow::Cow;
use std::fmt::Display;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::value::RawValue;

use super::super::model_file::ModelFile;
use spinney_base::{Error, Result};

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document<'a> {
    pub(super) asset: Asset,
    pub(super) scene: Option<u32>,
    #[serde(default)]
    pub(super) scenes: Vec<Scene>,
    #[serde(default, borrow)]
    pub(super) nodes: Vec<Node<'a>>,
    #[serde(default, borrow)]
    pub(super) meshes: Vec<Mesh<'a>>,
    #[serde(default)]
    pub(super) materials: Vec<Material>,
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(default, borrow)]
    pub(super) buffers: Vec<Buffer<'a>>,
    #[serde(default)]
    pub(super) extensions_required: Vec<String>,
    #[serde(borrow)]
    pub(super) extensions: Option<Extensions<'a>>,
    // (Lists of `IgnoredAny` take no memory.)
    #[serde(default)]
    pub(super) textures: Vec<IgnoredAny>,
    #[serde(default)]
    pub(super) skins: Vec<IgnoredAny>,
    #[serde(default)]
    pub(super) animations: Vec<IgnoredAny>,
    #[serde(default)]
    pub(super) cameras: Vec<IgnoredAny>,
}

impl Document<'_> {
    /// Whether the file was written by this program.
    pub(super) fn is_own(&self) -> bool {
        self.asset.generator.as_deref() == Some("spinney")
    }
}

#[derive(Deserialize)]
pub(super) struct Extensions<'a> {
    #[serde(borrow, rename = "EXT_structural_metadata")]
    pub(super) metadata: Option<&'a RawValue>,
}

#[derive(Deserialize)]
pub(super) struct Asset {
    pub(super) version: String,
    pub(super) generator: Option<String>,
}

#[derive(Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Vec<u32>,
}

#[derive(Deserialize)]
pub(super) struct Node<'a> {
    #[serde(borrow)]
    pub(super) name: Option<&'a RawValue>,
    #[serde(default)]
    pub(super) children: Vec<u32>,
    pub(super) mesh: Option<u32>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    pub(super) extensions: Option<Box<NodeExtensions>>,
}

#[derive(Deserialize)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instancing: Option<Instancing>,
}

#[derive(Deserialize)]
pub(super) struct Instancing {
    #[serde(default)]
    pub(super) attributes: InstanceAttributes,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) struct InstanceAttributes {
    pub(super) translation: Option<u32>,
    pub(super) rotation: Option<u32>,
    pub(super) scale: Option<u32>,
}

#[derive(Deserialize)]
pub(super) struct Mesh<'a> {
    #[serde(borrow)]
    pub(super) name: Option<&'a RawValue>,
    #[serde(default)]
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub(super) attributes: Attributes,
    pub(super) indices: Option<u32>,
    pub(super) material: Option<u32>,
    pub(super) mode: Option<u32>,
    #[serde(default)]
    pub(super) targets: Vec<IgnoredAny>,
    pub(super) extensions: Option<PrimitiveExtensions>,
}

#[derive(Clone, Copy, Default, Deserialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(super) position: Option<u32>,
    #[serde(rename = "COLOR_0")]
    pub(super) colour: Option<u32>,
    #[serde(rename = "_BATCHID")]
    pub(super) batch: Option<u32>,
    #[serde(rename = "_FEATURE_ID_0")]
    feature_0: Option<u32>,
    #[serde(rename = "_FEATURE_ID_1")]
    feature_1: Option<u32>,
    #[serde(rename = "_FEATURE_ID_2")]
    feature_2: Option<u32>,
    #[serde(rename = "_FEATURE_ID_3")]
    feature_3: Option<u32>,
}

impl Attributes {
    /// Returns the accessor of `_FEATURE_ID_n`, of the first four.
    pub(super) fn feature_ids(&self, n: u32) -> Option<u32> {
        let all = [self.feature_0, self.feature_1, self.feature_2, self.feature_3];
        all.get(n as usize).copied().flatten()
    }
}

#[derive(Deserialize)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<IgnoredAny>,
    #[serde(rename = "EXT_mesh_features")]
    pub(super) features: Option<FeatureExtension>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct FeatureExtension {
    #[serde(default)]
    pub(super) feature_ids: Vec<FeatureIds>,
}

/// A set of feature identifiers.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct FeatureIds {
    /// Number of the vertex attribute that has them.
    pub(super) attribute: Option<u32>,
    pub(super) property_table: Option<u32>,
    pub(super) null_feature_id: Option<u64>,
    pub(super) label: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pbr_metallic_roughness: Option<Reflection>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Reflection {
    base_color_factor: Option<[f32; 4]>,
}

impl Material {
    /// Linear base colour.
    pub(super) fn colour(&self) -> Option<[f32; 3]> {
        let [r, g, b, _] = self.pbr_metallic_roughness.as_ref()?.base_color_factor?;
        Some([r, g, b])
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<u32>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) shape: Shape,
    pub(super) sparse: Option<Box<Sparse>>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum Shape {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
pub(super) struct Sparse {
    pub(super) count: u64,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
    pub(super) extensions: Option<Box<ViewExtensions>>,
}

#[derive(Deserialize)]
pub(super) struct ViewExtensions {
    // (A view must not have both.)
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    pub(super) meshopt: Option<Compression>,
}

/// Compressed bytes of a buffer view.
#[derive(Deserialize)]
// (Without the feature, compressed views are refused.)
#[cfg_attr(not(feature = "meshopt"), expect(dead_code))]
#[serde(rename_all = "camelCase")]
pub(super) struct Compression {
    pub(super) buffer: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: u64,
    pub(super) count: u64,
    pub(super) mode: String,
    pub(super) filter: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer<'a> {
    #[serde(borrow)]
    pub(super) uri: Option<&'a RawValue>,
    pub(super) byte_length: u64,
}

/// Bytes of JSON that use as much memory as they say, whatever `--memory` is.
const SMALL: u64 = 16 << 20;

/// Parses the JSON text of a file.
pub(super) fn parse<'a>(source: &ModelFile, json: &'a [u8], memory: u64) -> Result<Document<'a>> {
    // Parsed lists take up to a few times their text.
    let needed = structure(json).saturating_mul(4);
    let limit = memory.max(SMALL);
    if needed > limit {
        return Err(Error::TooLarge {
            path: source.path().to_path_buf(),
            what: "the list of nodes, meshes and accessors".into(),
            needed,
            limit,
            advice: "allow more memory, merge nodes, or split the file".into(),
        });
    }
    let document: Document<'a> = serde_json::from_slice(json).map_err(|error| {
        let text = error.to_string();
        let what = text.rsplit_once(" at line").map_or(text.as_str(), |(what, _)| what);
        let end = what.char_indices().nth(200).map_or(what.len(), |(at, _)| at);
        let position = format!("JSON, line {}, column {}", error.line(), error.column());
        source.corrupt(position, &what[..end], "glTF 2.0")
    })?;
    if !document.asset.version.starts_with("2.") {
        let version: String = document.asset.version.chars().take(20).collect();
        let found = format!("glTF version {version:?}");
        return Err(Error::unsupported(source.path(), found, "convert it to glTF 2.0"));
    }
    Ok(document)
}

/// Bytes of a JSON text without its long strings, such as embedded buffers and images.
fn structure(json: &[u8]) -> u64 {
    const LONG: usize = 1024;
    let (mut sum, mut at) = (0, 0);
    while let Some(length) = json[at..].iter().position(|byte| *byte == b'"') {
        let start = at + length + 1;
        let mut end = start;
        while let Some(byte) = json.get(end).filter(|byte| **byte != b'"') {
            end += if *byte == b'\\' { 2 } else { 1 };
        }
        let end = end.min(json.len());
        sum += length + if end - start > LONG { 0 } else { end - start };
        at = (end + 1).min(json.len());
    }
    (sum + json.len() - at) as u64
}

/// Value of a JSON string.
pub(super) fn string(text: &RawValue) -> Option<Cow<'_, str>> {
    match text.get().strip_prefix('"')?.strip_suffix('"')? {
        plain if !plain.contains('\\') => Some(plain.into()),
        _ => serde_json::from_str::<String>(text.get()).ok().map(Cow::from),
    }
}

/// Item of a list by its index, which `place` has.
pub(super) fn item<'a, T>(
    source: &ModelFile,
    list: &'a [T],
    (what, index): (&str, u32),
    place: &dyn Display,
) -> Result<&'a T> {
    list.get(index as usize).ok_or_else(|| {
        let found = format!("{what} {index} of {}", list.len());
        source.corrupt(place.to_string(), found, format!("the index of a {what} in the file"))
    })
}
