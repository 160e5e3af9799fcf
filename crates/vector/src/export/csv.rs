//! Comma-separated values (RFC 4180): geometries as WKT (ISO 19125) in the first column, attributes
//! in the others.

use std::ops::Range;

use serde_json::Value;

use super::geometry::Shape;
use super::text::Text;
use super::{AttributeValue, FormatWriter, GeometryKind, VectorLayer};
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

/// Writes a string as a field, quoted if necessary.
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
        _id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let Csv { text, layer } = self;
        if let Some(shape) = shape {
            text.push("\"");
            push_shape(text, shape, layer.has_z)?;
            text.push("\"");
        }
        for value in attributes {
            text.push(",");
            match value {
                AttributeValue::Number(number) if number.is_finite() => text.push_number(*number),
                value => push_field(text, &value.to_text()),
            }
        }
        text.push("\r\n");
        text.flush_some()
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.text.finish()
    }
}

/// Writes a geometry as WKT.
fn push_shape(text: &mut Text, shape: &Shape<'_>, has_z: bool) -> Result<()> {
    let name = |kind: GeometryKind| match kind {
        GeometryKind::Point => "POINT",
        GeometryKind::Line => "LINESTRING",
        GeometryKind::Polygon => "POLYGON",
    };
    let z = if has_z { " Z" } else { "" };
    match (shape.kind, &shape.members[..]) {
        (Some(kind), []) => text.push(&format!("{}{z} EMPTY", name(kind))),
        (Some(kind), [(_, parts)]) => {
            text.push(&format!("{}{z} ", name(kind)));
            push_member(text, shape, kind, parts.clone(), has_z)?;
        }
        (Some(kind), members) => {
            text.push(&format!("MULTI{}{z} (", name(kind)));
            for (index, (_, parts)) in members.iter().enumerate() {
                text.push(if index > 0 { "," } else { "" });
                push_member(text, shape, kind, parts.clone(), has_z)?;
            }
            text.push(")");
        }
        (None, members) => {
            text.push(&format!("GEOMETRYCOLLECTION{z} ("));
            for (index, (kind, parts)) in members.iter().enumerate() {
                let comma = if index > 0 { "," } else { "" };
                text.push(&format!("{comma}{}{z} ", name(*kind)));
                push_member(text, shape, *kind, parts.clone(), has_z)?;
            }
            text.push(")");
        }
    }
    Ok(())
}

/// Writes the coordinates of a point, a line or a polygon.
fn push_member(
    text: &mut Text,
    shape: &Shape<'_>,
    kind: GeometryKind,
    parts: Range<usize>,
    has_z: bool,
) -> Result<()> {
    let (open, close) = if kind == GeometryKind::Polygon { ("(", ")") } else { ("", "") };
    text.push(open);
    for (index, part) in parts.enumerate() {
        text.push(if index > 0 { ",(" } else { "(" });
        text.push_points(shape.geometry, part, has_z, ["", " ", ""])?;
        text.push(")");
    }
    text.push(close);
    Ok(())
}
