//! Layers of features: kinds of geometries, and attributes.

use super::{VectorFormat, shapefile};
use spinney_crs::Crs;

/// Bytes that a text has at most in a table of dBASE.
pub(super) const TEXT_BYTES: usize = 254;

/// Kind of a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeometryKind {
    /// Points: every part has one.
    Point,
    /// Lines: every part has the points of one.
    Line,
    /// Polygons: an outer ring, which holes follow, if there are some. Rings end with the point that they begin with.
    Polygon,
}

/// Type of an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttributeType {
    /// Whole numbers of 64 bits.
    Integer,
    /// Numbers, of which some may be whole.
    Number,
    /// Texts.
    Text,
    /// Yes or no.
    Boolean,
    /// JSON.
    Json,
    /// Values of several types: texts where a format has no such attributes.
    Mixed,
    /// Whole numbers, one for each segment of a line: texts with blanks between them where a format has no lists, integers of edges in PLY.
    PerSegment,
}

impl AttributeType {
    /// The type that has values of both.
    pub(crate) fn with(self, other: AttributeType) -> AttributeType {
        use AttributeType::{Integer, Mixed, Number};
        match (self, other) {
            (one, same) if one == same => one,
            (Integer, Number) | (Number, Integer) => Number,
            _ => Mixed,
        }
    }
}

/// An attribute of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AttributeValue<'a> {
    /// A whole number.
    Integer(i64),
    /// A number; one that is not finite is none.
    Number(f64),
    /// A text.
    Text(&'a str),
    /// Yes or no.
    Boolean(bool),
    /// JSON, as text.
    Json(&'a str),
    /// A number for each segment of a line.
    PerSegment(&'a [u64]),
    /// Nothing.
    None,
}

impl AttributeValue<'_> {
    /// Whether an attribute of the type may have the value.
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

    /// The value, or none if it is a number that is not finite.
    pub(super) fn told(self) -> Self {
        match self {
            AttributeValue::Number(number) if !number.is_finite() => AttributeValue::None,
            told => told,
        }
    }

    /// The value as text, of formats that have nothing else; nothing for none.
    pub(super) fn to_text(self) -> String {
        match self.told() {
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

/// The shortest text that is read as the same number.
fn shortest(number: f64) -> String {
    let mut text = serde_json::Value::from(number).to_string();
    if text.ends_with(".0") {
        text.truncate(text.len() - 2);
    }
    text
}

/// Adds an attribute to others, with a number behind its name if one of these has that; whether it has another name now.
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
    /// Its name.
    pub name: String,
    /// Kind of all features; `None` if they are of several kinds.
    pub kind: Option<GeometryKind>,
    /// Whether features may have several points, lines or polygons. Formats that declare one type for all features make multi-geometries of all.
    pub is_multi: bool,
    /// Whether points have a third coordinate.
    pub has_z: bool,
    /// Names and types of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// The coordinate system, where known.
    pub crs: Option<Crs>,
    /// Least and greatest x and y of all features, or of what is around them.
    pub bounds: [[f64; 2]; 2],
}

impl VectorLayer {
    /// Parts of the layer's coordinate system that a file of the format cannot tell, in words: nothing if it tells all.
    pub(super) fn unknown_system(&self, format: VectorFormat) -> Option<String> {
        let crs = self.crs.as_ref()?;
        let is_told = match format {
            VectorFormat::GeoPackage | VectorFormat::FlatGeobuf => {
                crs.numbers().is_some() || crs.to_wkt2().is_ok() || crs.foreign_text().is_some()
            }
            VectorFormat::Shapefile => shapefile::definition(crs).is_some(),
            // (Documents of GeoJSON have any definition; the others have no place for one.)
            VectorFormat::GeoJson
            | VectorFormat::Csv
            | VectorFormat::Svg
            | VectorFormat::Obj
            | VectorFormat::Ply => true,
        };
        (!is_told)
            .then(|| format!("the coordinate system is not in the file, which has no words for it: {crs}"))
    }
}
