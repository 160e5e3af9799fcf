//! PLY, binary little-endian: vertices, and edges between them.

use std::io::Write;

use serde_json::Value;

use super::geometry::Shape;
use super::{AttributeType, AttributeValue, FormatWriter, GeometryKind, VectorLayer};
use spinney_base::io::Output;
use spinney_base::io::spill::{Spill, failed};
use spinney_base::{Error, Result};

/// The header needs the vertex and edge counts, so both lists are spooled to temporary files.
pub(super) struct PlyEdges {
    output: Output,
    layer: VectorLayer,
    features: u32,
    vertices: u64,
    edges: u64,
    vertex_spill: Spill,
    edge_spill: Spill,
}

impl PlyEdges {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<PlyEdges> {
        let (vertex_spill, edge_spill) = (Spill::new(&output)?, Spill::new(&output)?);
        Ok(PlyEdges { output, layer, features: 0, vertices: 0, edges: 0, vertex_spill, edge_spill })
    }

    fn header(&self) -> String {
        let properties: String = (self.layer.attributes.iter())
            .filter_map(|(name, kind)| {
                let kind = match kind {
                    AttributeType::Number | AttributeType::Integer => "double",
                    AttributeType::PerSegment => "uint",
                    _ => return None,
                };
                Some(format!("property {kind} {name}\n"))
            })
            .collect();
        format!(
            "ply\nformat binary_little_endian 1.0\ncomment made by spinney\nelement vertex {}\n\
             property double x\nproperty double y\nproperty double z\nelement edge {}\n\
             property int vertex1\nproperty int vertex2\nproperty uint feature\n{properties}end_header\n",
            self.vertices, self.edges
        )
    }

    fn too_many(&self, what: &str) -> Error {
        Error::unsupported(self.output.path(), format!("a PLY file of {what}"), "choose another format")
    }

    /// Writes an edge with its attributes; `segment` is its index in the feature.
    fn edge(&mut self, ends: [u64; 2], segment: usize, attributes: &[AttributeValue<'_>]) -> Result<()> {
        let mut bytes = Vec::new();
        for end in ends {
            let end = i32::try_from(end).map_err(|_| self.too_many("more than 2^31 vertices"))?;
            bytes.extend(end.to_le_bytes());
        }
        bytes.extend(self.features.to_le_bytes());
        for ((_, kind), value) in self.layer.attributes.iter().zip(attributes) {
            match (kind, value) {
                (AttributeType::Number, AttributeValue::Number(number)) => bytes.extend(number.to_le_bytes()),
                (AttributeType::Number | AttributeType::Integer, AttributeValue::Integer(number)) => {
                    bytes.extend((*number as f64).to_le_bytes());
                }
                (AttributeType::Number | AttributeType::Integer, _) => bytes.extend(f64::NAN.to_le_bytes()),
                (AttributeType::PerSegment, AttributeValue::PerSegment(numbers)) => {
                    let number = numbers.get(segment).copied().unwrap_or_default();
                    let number = u32::try_from(number).map_err(|_| self.too_many("numbers beyond 2^32"))?;
                    bytes.extend(number.to_le_bytes());
                }
                (AttributeType::PerSegment, _) => bytes.extend(0u32.to_le_bytes()),
                _ => {}
            }
        }
        self.edges += 1;
        self.edge_spill.write(&bytes)
    }
}

impl FormatWriter for PlyEdges {
    fn write(
        &mut self,
        _id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let mut segment = 0;
        let parts = shape.iter().flat_map(|shape| {
            shape
                .members
                .iter()
                .flat_map(|(kind, parts)| parts.clone().map(|part| (shape.geometry, *kind, part)))
        });
        for (geometry, kind, part) in parts {
            let (count, base, mut passed) = (geometry.count(part), self.vertices, 0);
            let mut first = None;
            geometry.points(part, &mut |points| {
                for &point in points {
                    let first = *first.get_or_insert(point);
                    passed += 1;
                    // The repeated last point of a closed part is written once.
                    let is_back = passed == count && count > 2 && point == first;
                    let vertex = if is_back { base } else { self.vertices };
                    if !is_back {
                        let [x, y, z] = point;
                        let at = [x, y, if self.layer.has_z { z } else { 0.0 }].map(f64::to_le_bytes);
                        self.vertex_spill.write(at.as_flattened())?;
                        self.vertices += 1;
                    }
                    if passed > 1 && kind != GeometryKind::Point {
                        self.edge([base + passed - 2, vertex], segment, attributes)?;
                        segment += 1;
                    }
                }
                Ok(())
            })?;
        }
        self.features = self.features.checked_add(1).ok_or_else(|| self.too_many("2^32 features"))?;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let header = self.header();
        let PlyEdges { mut output, vertex_spill, edge_spill, .. } = *self;
        let path = output.path().to_path_buf();
        output.write_all(header.as_bytes()).map_err(failed(&path))?;
        vertex_spill.copy_to(&mut output)?;
        edge_spill.copy_to(&mut output)?;
        output.commit()
    }
}
