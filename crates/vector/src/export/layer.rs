//! Layers of features: geometry kinds and attributes.

use super::{VectorFormat, shapefile};
use spinney_crs::Crs;

/// Maximum size of a string in a dBASE table, in bytes.
pub(super) const TEXT_BYTES: usize = 254;

/// Geometry kind of a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeometryKind {
    /// Points: each part is one point.
    Point,
    /// Lines: each part is one line.
    Line,
    /// Polygons: an outer ring, followed by its holes. Rings are closed, with equal first and last
    /// points.
    Polygon,
}

/// Type of an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttributeType {
    /// 64-bit integers.
    Integer,
    /// Floating-point numbers or integers.
    Number,
    /// Strings.
    Text,
    /// Boolean values.
    Boolean,
    /// JSON.
    Json,
    /// Values of several types; strings in formats without such attributes.
    Mixed,
    /// One integer per segment of a line: a string separated by spaces in formats without lists, an
    /// integer per edge in PLY.
    PerSegment,
}

impl AttributeType {
    /// Returns the type that can represent values of both.
    pub(crate) fn with(self, other: AttributeType) -> AttributeType {
        use AttributeType::{Integer, Mixed, Number};
        match (self, other) {
            (one, same) if one == same => one,
            (Integer, Number) | (Number, Integer) => Number,
            _ => Mixed,
        }
    }
}

/// Attribute value of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AttributeValue<'a> {
    /// Integer.
    Integer(i64),
    /// Floating-point number; one that is not finite counts as no value.
    Number(f64),
    /// String.
    Text(&'a str),
    /// Boolean.
    Boolean(bool),
    /// JSON text.
    Json(&'a str),
    /// One number per segment of a line.
    PerSegment(&'a [u64]),
    /// No value.
    None,
}

impl AttributeValue<'_> {
    /// Returns whether an attribute of this type can have the value.
    pub(super) fn fits(&self, kind: AttributeType) -> bool {
        match self {
            AttributeValue::None => true,
            AttributeValue::PerSegment(_) => kind == AttributeType::PerSegment,
            _ if kind == AttributeType::Mixed => true,
            AttributeValue::Integer(_) => matches!(kind, AttributeType::Integer | AttributeType::Number),
            AttributeValue::Number(_) => kind == AttributeType::Number,
            AttributeValue::Text(_) => kind == AttributeType::Text,
            AttributeValue::Boolean(_) => kind == AttributeType::Boolean,
            AttributeValue::Json(_) => kind == AttributeType::Json,
        }
    }

    /// Returns the value, with numbers that are not finite replaced by no value.
    pub(super) fn finite_or_none(self) -> Self {
        match self {
            AttributeValue::Number(number) if !number.is_finite() => AttributeValue::None,
            other => other,
        }
    }

    /// Converts the value to a string, for formats without types; empty for no value.
    pub(super) fn to_text(self) -> String {
        match self.finite_or_none() {
            AttributeValue::None => String::new(),
            AttributeValue::Integer(number) => number.to_string(),
            AttributeValue::Number(number) => shortest(number),
            AttributeValue::Text(text) | AttributeValue::Json(text) => text.into(),
            AttributeValue::Boolean(is) => is.to_string(),
            AttributeValue::PerSegment(numbers) => {
                numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(" ")
            }
        }
    }
}

/// Returns the shortest string that parses to the same number.
fn shortest(number: f64) -> String {
    let mut text = serde_json::Value::from(number).to_string();
    if text.ends_with(".0") {
        text.truncate(text.len() - 2);
    }
    text
}

/// Appends an attribute, with a number after its name if the name is taken. Returns whether it was
/// renamed.
pub(crate) fn push_attribute(
    attributes: &mut Vec<(String, AttributeType)>,
    name: String,
    kind: AttributeType,
) -> bool {
    let is_taken = |name: &str| attributes.iter().any(|(own, _)| own == name);
    let mut numbered = (2..).map(|number| format!("{name}_{number}"));
    let renamed = if is_taken(&name) { numbered.find(|name| !is_taken(name)) } else { None };
    let is_renamed = renamed.is_some();
    attributes.push((renamed.unwrap_or(name), kind));
    is_renamed
}

/// Description of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorLayer {
    /// Layer name.
    pub name: String,
    /// Kind of all features; `None` for several kinds.
    pub kind: Option<GeometryKind>,
    /// Whether a feature may have several points, lines or polygons. Formats that declare one type
    /// per layer then write multi-geometries only.
    pub is_multi: bool,
    /// Whether points have a third coordinate.
    pub has_z: bool,
    /// Names and types of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// Coordinate system, if known.
    pub crs: Option<Crs>,
    /// Minimum and maximum x and y of all features; may be larger.
    pub bounds: [[f64; 2]; 2],
}

impl VectorLayer {
    /// Returns a remark if a file of the format cannot store the layer's coordinate system.
    pub(super) fn unknown_system(&self, format: VectorFormat) -> Option<String> {
        let crs = self.crs.as_ref()?;
        let is_stored = match format {
            VectorFormat::GeoPackage | VectorFormat::FlatGeobuf => {
                crs.numbers().is_some() || crs.to_wkt2().is_ok() || crs.foreign_text().is_some()
            }
            VectorFormat::Shapefile => shapefile::definition(crs).is_some(),
            // GeoJSON stores any definition. The other formats cannot store one at all.
            VectorFormat::GeoJson
            | VectorFormat::Csv
            | VectorFormat::Svg
            | VectorFormat::Obj
            | VectorFormat::Ply => true,
        };
        (!is_stored).then(|| format!("the format cannot store the coordinate system, which is {crs}"))
    }
}
