//! SVG 1.1 drawings: one path per feature.

use serde_json::Value;

use super::geometry::Shape;
use super::text::Text;
use super::{AttributeValue, FormatWriter, GeometryKind, VectorLayer};
use spinney_base::Result;
use spinney_base::io::Output;

pub(super) struct Svg {
    text: Text,
    layer: VectorLayer,
}

impl Svg {
    pub(super) fn new(output: Output, layer: VectorLayer) -> Result<Svg> {
        let mut text = Text::new(output);
        let [[west, south], [east, north]] = layer.bounds;
        text.push("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"");
        // SVG's y axis points down.
        for (index, number) in [west, -north, east - west, north - south].into_iter().enumerate() {
            if index > 0 {
                text.push(" ");
            }
            text.push_number(number);
        }
        text.push(
            "\">\n<g transform=\"scale(1,-1)\" stroke=\"#444\" stroke-width=\"1\" stroke-linejoin=\"round\" ",
        );
        text.push(match layer.kind {
            Some(GeometryKind::Line) => "fill=\"none\">\n",
            // Points are lines of length zero, which are visible only with round caps.
            _ => "fill=\"#b9cbb0\" fill-opacity=\"0.5\" fill-rule=\"evenodd\" stroke-linecap=\"round\">\n",
        });
        Ok(Svg { text, layer })
    }
}

/// Writes a string as an attribute value. Characters that XML does not allow become spaces.
fn push_escaped(text: &mut Text, value: &str) {
    for character in value.chars() {
        match character {
            '&' => text.push("&amp;"),
            '<' => text.push("&lt;"),
            '"' => text.push("&quot;"),
            character if character.is_control() => text.push(" "),
            character => text.push(character.encode_utf8(&mut [0; 4])),
        }
    }
}

impl FormatWriter for Svg {
    fn write(
        &mut self,
        _id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        let Svg { text, layer } = self;
        text.push("<path vector-effect=\"non-scaling-stroke\"");
        match shape.and_then(|shape| shape.kind) {
            Some(GeometryKind::Point) => text.push(" stroke-width=\"4\""),
            Some(GeometryKind::Line) if layer.kind.is_none() => text.push(" fill=\"none\""),
            _ => {}
        }
        for ((name, _), value) in layer.attributes.iter().zip(attributes) {
            if *value == AttributeValue::None {
                continue;
            }
            text.push(&format!(" data-{name}=\""));
            match value {
                AttributeValue::Number(number) => text.push_number(*number),
                value => push_escaped(text, &value.to_text()),
            }
            text.push("\"");
        }
        text.push(" d=\"");
        for (shape, (kind, parts)) in
            shape.iter().flat_map(|shape| shape.members.iter().map(move |own| (shape, own)))
        {
            for part in parts.clone() {
                // Further points after the first are lines to each.
                text.push("M");
                text.push_points(shape.geometry, part, false, ["", " ", ""])?;
                text.push(match kind {
                    GeometryKind::Point => "h0",
                    GeometryKind::Line => "",
                    GeometryKind::Polygon => "Z",
                });
            }
        }
        text.push("\"/>\n");
        text.flush_some()
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.text.push("</g>\n</svg>\n");
        self.text.finish()
    }
}
