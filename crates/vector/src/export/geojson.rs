//! `GeoJSON`: a collection of features, one per line.

use super::text::Text;
use super::{AttributeValue, FormatWriter, Geometry, GeometryKind, VectorLayer};
use spinney_base::Result;
use spinney_base::io::Output;

pub(super) struct GeoJson {
    text: Text,
    layer: VectorLayer,
    has_features: bool,
}

/// WGS 84 by longitude and latitude, which is what coordinates are in if nothing is said.
const WGS84: u32 = 4326;

impl GeoJson {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<GeoJson> {
        let mut text = Text::new(output);
        text.push("{\"type\":\"FeatureCollection\",\"name\":");
        text.push_json(&layer.name);
        let epsg = layer.crs.as_ref().and_then(|crs| crs.numbers());
        if let Some(number) = epsg.map(|epsg| epsg.horizontal).filter(|number| *number != WGS84) {
            let name = format!("urn:ogc:def:crs:EPSG::{number}");
            text.push(&format!(",\"crs\":{{\"type\":\"name\",\"properties\":{{\"name\":\"{name}\"}}}}"));
        }
        text.push(",\"features\":[");
        Ok(GeoJson { text, layer, has_features: false })
    }
}

impl FormatWriter for GeoJson {
    fn write(
        &mut self,
        kind: GeometryKind,
        geometry: &dyn Geometry,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let GeoJson { text, layer, has_features } = self;
        text.push(if std::mem::replace(has_features, true) { ",\n" } else { "\n" });
        text.push("{\"type\":\"Feature\",\"properties\":{");
        for (index, ((name, _), value)) in layer.attributes.iter().zip(attributes).enumerate() {
            if index > 0 {
                text.push(",");
            }
            text.push_json(name);
            text.push(":");
            match value {
                AttributeValue::Number(number) => text.push_number(*number),
                AttributeValue::Text(value) => text.push_json(value),
                AttributeValue::PerSegment(numbers) => {
                    text.push("[");
                    text.push_integers(numbers, ",");
                    text.push("]");
                }
                AttributeValue::None => text.push("null"),
            }
        }
        text.push("},\"geometry\":{\"type\":");
        let around = ["[", ",", "]"];
        match kind {
            GeometryKind::Point => {
                text.push("\"Point\",\"coordinates\":");
                text.push_points(geometry, 0, layer.has_z, around)?;
            }
            GeometryKind::Line => {
                text.push("\"LineString\",\"coordinates\":[");
                text.push_points(geometry, 0, layer.has_z, around)?;
                text.push("]");
            }
            GeometryKind::Polygon => {
                text.push("\"Polygon\",\"coordinates\":[");
                for part in 0..geometry.parts() {
                    text.push(if part > 0 { ",[" } else { "[" });
                    text.push_points(geometry, part, layer.has_z, around)?;
                    text.push("]");
                }
                text.push("]");
            }
        }
        text.push("}}");
        text.flush_some()
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.text.push("\n]}\n");
        self.text.finish()
    }
}
