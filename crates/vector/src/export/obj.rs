//! Wavefront OBJ: one object per feature, with lines and points.

use serde_json::Value;

use super::geometry::Shape;
use super::text::Text;
use super::{AttributeValue, FormatWriter, Geometry, GeometryKind, VectorLayer};
use spinney_base::Result;
use spinney_base::io::Output;

pub(super) struct ObjLines {
    text: Text,
    layer: VectorLayer,
    features: u64,
    vertices: u64,
}

impl ObjLines {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<ObjLines> {
        let mut text = Text::new(output);
        text.push("# made by spinney\n");
        Ok(ObjLines { text, layer, features: 0, vertices: 0 })
    }

    /// Writes the points of a part, and the line through them. The repeated last point of a closed
    /// part is written once.
    fn part(&mut self, kind: GeometryKind, geometry: &dyn Geometry, part: usize) -> Result<()> {
        let ObjLines { text, layer, vertices, .. } = self;
        let (count, base) = (geometry.count(part), *vertices);
        let (mut first, mut is_closed) = (None, false);
        geometry.points(part, &mut |points| {
            for point in points {
                let is_last = *vertices - base + 1 == count;
                is_closed = is_last && count > 2 && first == Some(*point);
                first.get_or_insert(*point);
                if !is_closed {
                    *vertices += 1;
                    text.push("v");
                    for at in [point[0], point[1], if layer.has_z { point[2] } else { 0.0 }] {
                        text.push(" ");
                        text.push_number(at);
                    }
                    text.push("\n");
                }
                text.flush_some()?;
            }
            Ok(())
        })?;
        text.push(if kind == GeometryKind::Point { "p" } else { "l" });
        // Indices start at 1.
        for number in (base..*vertices).chain(is_closed.then_some(base)) {
            text.push(&format!(" {}", number + 1));
            text.flush_some()?;
        }
        text.push("\n");
        Ok(())
    }
}

impl FormatWriter for ObjLines {
    fn write(
        &mut self,
        _id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let ObjLines { text, layer, features, .. } = self;
        text.push(&format!("o feature_{features}\n"));
        *features += 1;
        let present =
            layer.attributes.iter().zip(attributes).filter(|(_, value)| **value != AttributeValue::None);
        for ((name, _), value) in present {
            // A line break would end the comment.
            let plain = |text: &str| text.replace(|letter: char| letter.is_control(), " ");
            text.push(&format!("# {name} "));
            match value {
                AttributeValue::Number(number) => text.push_number(*number),
                value => text.push(&plain(&value.to_text())),
            }
            text.push("\n");
        }
        if let Some(shape) = shape {
            let mut parts =
                shape.members.iter().flat_map(|(kind, parts)| parts.clone().map(|part| (*kind, part)));
            parts.try_for_each(|(kind, part)| self.part(kind, shape.geometry, part))?;
        }
        self.text.flush_some()
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.text.finish()
    }
}
