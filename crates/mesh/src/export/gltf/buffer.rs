//! Binary buffer of glTF: buffer views, with optional compression of vertices and triangles
//! (EXT_meshopt_compression).

use serde_json::{Map, Value as Json, json};

/// Targets of buffer views: vertex attributes and vertex indices.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Name of the compression extension.
const MESHOPT: &str = "EXT_meshopt_compression";

/// Buffer views under construction, all in one buffer.
pub(in crate::export) struct GlbBuffer {
    meshopt: bool,
    bytes: Vec<u8>,
    /// Length in bytes of the uncompressed buffer.
    plain: usize,
    views: Vec<Json>,
}

impl GlbBuffer {
    pub(in crate::export) fn new(meshopt: bool) -> GlbBuffer {
        GlbBuffer { meshopt, bytes: Vec::new(), plain: 0, views: Vec::new() }
    }

    /// Extension that readers must support.
    pub(in crate::export) fn extension(&self) -> Option<&'static str> {
        self.meshopt.then_some(MESHOPT)
    }

    /// Adds a view of a vertex attribute with `stride` bytes per vertex; returns its index.
    pub(in crate::export) fn vertices(&mut self, bytes: &[u8], stride: usize) -> usize {
        let view = json!({ "target": ARRAY_BUFFER, "byteStride": stride });
        match self.meshopt {
            true => {
                self.compressed(bytes.len(), stride, "ATTRIBUTES", view, meshopt::vertices(bytes, stride))
            }
            false => self.plain(bytes, view),
        }
    }

    /// Adds a view of triangles; returns its index. Vertex indices have 16 bits if `is_small`, else
    /// 32.
    pub(in crate::export) fn triangles(&mut self, triangles: &[[u32; 3]], is_small: bool) -> usize {
        let view = json!({ "target": ELEMENT_ARRAY_BUFFER });
        let numbers = triangles.as_flattened();
        let size = if is_small { 2 } else { 4 };
        if self.meshopt {
            return self.compressed(
                numbers.len() * size,
                size,
                "TRIANGLES",
                view,
                meshopt::triangles(numbers),
            );
        }
        let bytes: Vec<u8> = match is_small {
            true => numbers.iter().flat_map(|number| (*number as u16).to_le_bytes()).collect(),
            false => numbers.iter().flat_map(|number| number.to_le_bytes()).collect(),
        };
        self.plain(&bytes, view)
    }

    /// Adds a view of a table column; returns its index.
    pub(in crate::export) fn table(&mut self, bytes: &[u8]) -> usize {
        self.plain(bytes, json!({}))
    }

    /// Adds buffers and views to the file's root. Returns the bytes of the only buffer that has
    /// any.
    pub(in crate::export) fn finish(self, root: &mut Map<String, Json>) -> Vec<u8> {
        let mut buffers = vec![json!({ "byteLength": self.bytes.len() })];
        if self.meshopt {
            // Placeholder for the bytes that readers decompress from the first buffer.
            buffers
                .push(json!({ "byteLength": self.plain, "extensions": { MESHOPT: { "fallback": true } } }));
        }
        root.insert("buffers".into(), buffers.into());
        root.insert("bufferViews".into(), self.views.into());
        self.bytes
    }

    fn plain(&mut self, bytes: &[u8], view: Json) -> usize {
        let first = self.append(bytes);
        self.view(view, 0, first, bytes.len())
    }

    fn compressed(
        &mut self,
        length: usize,
        stride: usize,
        mode: &str,
        mut view: Json,
        bytes: Vec<u8>,
    ) -> usize {
        let first = self.append(&bytes);
        view["extensions"] = json!({ MESHOPT: { "buffer": 0, "byteOffset": first, "byteLength": bytes.len(),
            "byteStride": stride, "count": length / stride, "mode": mode } });
        let first = self.plain;
        self.plain = (first + length).next_multiple_of(8);
        self.view(view, 1, first, length)
    }

    fn append(&mut self, bytes: &[u8]) -> usize {
        let first = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        // (Table columns must be aligned to 8 bytes.)
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        first
    }

    fn view(&mut self, mut view: Json, buffer: u32, first: usize, length: usize) -> usize {
        view["buffer"] = buffer.into();
        view["byteOffset"] = first.into();
        view["byteLength"] = length.into();
        self.views.push(view);
        self.views.len() - 1
    }
}

/// Codecs of meshoptimizer.
#[cfg(feature = "meshopt")]
mod meshopt {
    use meshoptimizer_rs::Workspace;
    use meshoptimizer_rs::codec::{IndexEncoding, VertexEncoding, encode_index_buffer, encode_vertex_buffer};

    pub(in crate::export) fn vertices(bytes: &[u8], stride: usize) -> Vec<u8> {
        // The extension only allows version 0.
        let encoding = VertexEncoding::new(0, 0).expect("there is such a version");
        let (count, mut workspace) = (bytes.len() / stride, Workspace::default());
        encode_vertex_buffer(bytes, count, stride, encoding, &mut workspace).expect("strides are 4 and 8")
    }

    pub(in crate::export) fn triangles(numbers: &[u32]) -> Vec<u8> {
        let mut workspace = Workspace::default();
        encode_index_buffer(numbers, IndexEncoding::DEFAULT, &mut workspace)
            .expect("triangles have three corners")
    }
}

/// Without the feature, `GltfOptions::check` rejects the option.
#[cfg(not(feature = "meshopt"))]
mod meshopt {
    pub(in crate::export) fn vertices(_: &[u8], _: usize) -> Vec<u8> {
        unreachable!("refused without the feature")
    }

    pub(in crate::export) fn triangles(_: &[u32]) -> Vec<u8> {
        unreachable!("refused without the feature")
    }
}
