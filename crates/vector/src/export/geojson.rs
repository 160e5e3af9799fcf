//! `GeoJSON`: a feature collection, with one feature per line.

use std::ops::Range;

use serde_json::Value;

use super::geometry::Shape;
use super::text::Text;
use super::{AttributeValue, FormatWriter, Geometry, GeometryKind, VectorLayer};
use spinney_base::Result;
use spinney_base::io::Output;

pub(super) struct GeoJson {
    text: Text,
    layer: VectorLayer,
    has_features: bool,
}

/// EPSG code of WGS 84 by longitude and latitude, the default of the format.
const WGS84: u32 = 4326;

impl GeoJson {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<GeoJson> {
        let mut text = Text::new(output);
        text.push("{\"type\":\"FeatureCollection\",\"name\":");
        text.push_json(&layer.name);
        // Without this member, readers assume longitude and latitude.
        let name = layer.crs.as_ref().map(|crs| match crs.numbers() {
            Some(epsg) if epsg.horizontal == WGS84 => String::new(),
            Some(epsg) => format!("urn:ogc:def:crs:EPSG::{}", epsg.horizontal),
            None => crs.definition(),
        });
        match name {
            Some(name) if name.is_empty() => {}
            Some(name) => {
                text.push(",\"crs\":{\"type\":\"name\",\"properties\":{\"name\":");
                text.push_json(&name);
                text.push("}}");
            }
            None => text.push(",\"crs\":null"),
        }
        text.push(",\"features\":[");
        Ok(GeoJson { text, layer, has_features: false })
    }
}

impl FormatWriter for GeoJson {
    fn write(
        &mut self,
        id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let GeoJson { text, layer, has_features } = self;
        text.push(if std::mem::replace(has_features, true) { ",\n" } else { "\n" });
        text.push("{\"type\":\"Feature\",");
        if let Some(id) = id {
            text.push(&format!("\"id\":{id},"));
        }
        text.push("\"properties\":{");
        for (index, ((name, _), value)) in layer.attributes.iter().zip(attributes).enumerate() {
            if index > 0 {
                text.push(",");
            }
            text.push_json(name);
            text.push(":");
            match value {
                AttributeValue::Integer(number) => text.push(&number.to_string()),
                AttributeValue::Number(number) => text.push_number(*number),
                AttributeValue::Text(value) => text.push_json(value),
                AttributeValue::Boolean(is) => text.push(if *is { "true" } else { "false" }),
                AttributeValue::Json(json) => push_object(text, json),
                AttributeValue::PerSegment(numbers) => {
                    text.push("[");
                    text.push_integers(numbers, ",");
                    text.push("]");
                }
                AttributeValue::None => text.push("null"),
            }
        }
        text.push("},\"geometry\":");
        match shape {
            Some(shape) => push_shape(text, shape, layer.has_z)?,
            None => text.push("null"),
        }
        text.push("}");
        text.flush_some()
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.text.push("\n]}\n");
        self.text.finish()
    }
}

/// Writes valid JSON unchanged, and other text as a string.
fn push_object(text: &mut Text, json: &str) {
    match serde_json::from_str::<&serde_json::value::RawValue>(json) {
        Ok(own) => text.push(own.get()),
        Err(_) => text.push_json(json),
    }
}

fn push_shape(text: &mut Text, shape: &Shape<'_>, has_z: bool) -> Result<()> {
    let name = |kind: GeometryKind| match kind {
        GeometryKind::Point => "Point",
        GeometryKind::Line => "LineString",
        GeometryKind::Polygon => "Polygon",
    };
    let geometry = shape.geometry;
    match (shape.kind, &shape.members[..]) {
        (Some(kind), [(_, parts)]) => {
            text.push(&format!("{{\"type\":\"{}\",\"coordinates\":", name(kind)));
            push_member(text, geometry, kind, parts.clone(), has_z)?;
            text.push("}");
        }
        // An empty geometry has no points, whatever its type.
        (Some(kind), members) => {
            let multi = if members.is_empty() { "" } else { "Multi" };
            text.push(&format!("{{\"type\":\"{multi}{}\",\"coordinates\":[", name(kind)));
            for (index, (_, parts)) in members.iter().enumerate() {
                text.push(if index > 0 { "," } else { "" });
                push_member(text, geometry, kind, parts.clone(), has_z)?;
            }
            text.push("]}");
        }
        (None, members) => {
            text.push("{\"type\":\"GeometryCollection\",\"geometries\":[");
            for (index, (kind, parts)) in members.iter().enumerate() {
                let comma = if index > 0 { "," } else { "" };
                text.push(&format!("{comma}{{\"type\":\"{}\",\"coordinates\":", name(*kind)));
                push_member(text, geometry, *kind, parts.clone(), has_z)?;
                text.push("}");
            }
            text.push("]}");
        }
    }
    Ok(())
}

/// Writes the coordinates of a point, a line or a polygon.
fn push_member(
    text: &mut Text,
    geometry: &dyn Geometry,
    kind: GeometryKind,
    parts: Range<usize>,
    has_z: bool,
) -> Result<()> {
    let around = ["[", ",", "]"];
    if kind == GeometryKind::Point {
        return text.push_points(geometry, parts.start, has_z, around);
    }
    let (open, close) = if kind == GeometryKind::Line { ("", "") } else { ("[", "]") };
    text.push(open);
    for (index, part) in parts.enumerate() {
        text.push(if index > 0 { ",[" } else { "[" });
        text.push_points(geometry, part, has_z, around)?;
        text.push("]");
    }
    text.push(close);
    Ok(())
}
