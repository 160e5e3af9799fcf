//! Comma-separated values (RFC 4180): geometries in well-known text (ISO 19125) in the first column, attributes in the others.

use super::text::Text;
use super::{AttributeValue, FormatWriter, Geometry, GeometryKind, VectorLayer};
use spinney_base::Result;
use spinney_base::io::Output;

pub(super) struct Csv {
    text: Text,
    layer: VectorLayer,
}

impl Csv {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<Csv> {
        let mut text = Text::new(output);
        text.push("WKT");
        for (name, _) in &layer.attributes {
            text.push(",");
            push_field(&mut text, name);
        }
        text.push("\r\n");
        Ok(Csv { text, layer })
    }
}

/// A text as a field, in quotes if it needs some.
fn push_field(text: &mut Text, field: &str) {
    if field.contains(['"', ',', '\r', '\n']) {
        text.push(&format!("\"{}\"", field.replace('"', "\"\"")));
    } else {
        text.push(field);
    }
}

impl FormatWriter for Csv {
    fn write(
        &mut self,
        kind: GeometryKind,
        geometry: &dyn Geometry,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let Csv { text, layer } = self;
        let around = ["", " ", ""];
        let z = if layer.has_z { "Z " } else { "" };
        match kind {
            GeometryKind::Point => {
                text.push(&format!("\"POINT {z}("));
                text.push_points(geometry, 0, layer.has_z, around)?;
            }
            GeometryKind::Line => {
                text.push(&format!("\"LINESTRING {z}("));
                text.push_points(geometry, 0, layer.has_z, around)?;
            }
            GeometryKind::Polygon => {
                text.push(&format!("\"POLYGON {z}("));
                for part in 0..geometry.parts() {
                    text.push(if part > 0 { ",(" } else { "(" });
                    text.push_points(geometry, part, layer.has_z, around)?;
                    text.push(")");
                }
            }
        }
        text.push(")\"");
        for value in attributes {
            text.push(",");
            match value {
                AttributeValue::Number(number) if number.is_finite() => text.push_number(*number),
                AttributeValue::Text(value) => push_field(text, value),
                AttributeValue::PerSegment(numbers) => text.push_integers(numbers, " "),
                AttributeValue::Number(_) | AttributeValue::None => {}
            }
        }
        text.push("\r\n");
        text.flush_some()
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.text.finish()
    }
}
