//! Features as they come out of files of other programs: points, lines and polygons with attributes, one after the other.
//!
//! ```
//! use std::path::Path;
//! use spinney::import::feature::FeatureOptions;
//! use spinney::raw::import::feature::{FeatureAttribute, FeatureGeometry, open_features};
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("places.geojson");
//! let point = r#"{"type":"Feature","id":7,"properties":{"code":3,"kind":"spring"},"geometry":{"type":"Point","coordinates":[9.5,47]}}"#;
//! std::fs::write(&path, format!(r#"{{"type":"FeatureCollection","features":[{point}]}}"#)).unwrap();
//! let options = FeatureOptions { filter: "code>=3".parse()?, ..FeatureOptions::default() };
//! let mut reader = open_features(&path, &options)?;
//! assert_eq!(reader.schema().attributes[0].0, "code");
//! let feature = reader.next()?.unwrap();
//! assert_eq!(feature.attributes, [FeatureAttribute::Integer(3), FeatureAttribute::Text("spring".into())]);
//! assert_eq!(feature.geometry, Some(FeatureGeometry::Points(vec![[9.5, 47.0]])));
//! assert!(reader.next()?.is_none());
//! # Ok::<(), spinney::Error>(())
//! ```

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

use serde_json::Value;

use super::filter::FeatureFilter;
use super::formats;
pub use super::formats::is_feature_file;
use super::geojson::GeoJson;
pub use super::heights::Heights;
pub use crate::export::AttributeType;
use crate::export::GeometryKind;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, PolygonParts};

/// A feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Its id, a text or a number, where the format has ids.
    pub id: Option<Value>,
    /// Its attributes, as many as the schema has, in the same order.
    pub attributes: Vec<FeatureAttribute>,
    /// Its geometry; `None` if it has none.
    pub geometry: Option<FeatureGeometry>,
    /// Heights and measures of its points.
    pub heights: Heights,
}

impl Feature {
    /// The id as an attribute: an integer, or else its text.
    pub(crate) fn id_attribute(&self) -> FeatureAttribute {
        match &self.id {
            None => FeatureAttribute::None,
            Some(Value::String(text)) => FeatureAttribute::Text(text.clone()),
            Some(id) => {
                id.as_i64().map_or_else(|| FeatureAttribute::Text(id.to_string()), FeatureAttribute::Integer)
            }
        }
    }
}

/// The geometry of a feature: x and y (z: [`Heights::of_points`]). One without parts is empty.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureGeometry {
    /// Points.
    Points(Vec<[f64; 2]>),
    /// Lines of two points or more.
    Lines(Vec<Vec<[f64; 2]>>),
    /// Parts of polygons, each an outer ring and its holes, of three corners or more; the last may repeat the first.
    Polygons(PolygonParts),
    /// Geometries of several kinds.
    Collection(Vec<FeatureGeometry>),
}

impl FeatureGeometry {
    /// The kind; `None` of a collection.
    pub fn kind(&self) -> Option<GeometryKind> {
        match self {
            FeatureGeometry::Points(_) => Some(GeometryKind::Point),
            FeatureGeometry::Lines(_) => Some(GeometryKind::Line),
            FeatureGeometry::Polygons(_) => Some(GeometryKind::Polygon),
            FeatureGeometry::Collection(_) => None,
        }
    }

    /// All points, and vertices of lines and rings, in their order.
    pub fn points(&self) -> Box<dyn Iterator<Item = &[f64; 2]> + '_> {
        match self {
            FeatureGeometry::Points(points) => Box::new(points.iter()),
            FeatureGeometry::Lines(lines) => Box::new(lines.iter().flatten()),
            FeatureGeometry::Polygons(parts) => Box::new(parts.iter().flatten().flatten()),
            FeatureGeometry::Collection(members) => {
                Box::new(members.iter().flat_map(FeatureGeometry::points))
            }
        }
    }

    /// Changes all points, and vertices of lines and rings, in their order; stops at the first error of `change`.
    pub(crate) fn for_each_point<E>(
        &mut self,
        change: &mut dyn FnMut(&mut [f64; 2]) -> std::result::Result<(), E>,
    ) -> std::result::Result<(), E> {
        match self {
            FeatureGeometry::Points(points) => points.iter_mut().try_for_each(change),
            FeatureGeometry::Lines(lines) => lines.iter_mut().flatten().try_for_each(change),
            FeatureGeometry::Polygons(parts) => parts.iter_mut().flatten().flatten().try_for_each(change),
            FeatureGeometry::Collection(members) => {
                members.iter_mut().try_for_each(|member| member.for_each_point(change))
            }
        }
    }

    /// The geometry without parts that are empty, or what is wrong with it.
    pub(super) fn checked(mut self) -> Result<FeatureGeometry, String> {
        let all_finite = |points: &[[f64; 2]]| points.iter().flatten().all(|number| number.is_finite());
        let is_finite = match &mut self {
            FeatureGeometry::Points(points) => all_finite(points),
            FeatureGeometry::Lines(lines) => {
                lines.retain(|line| !line.is_empty());
                if lines.iter().any(|line| line.len() < 2) {
                    return Err("a line of one point".into());
                }
                lines.iter().all(|line| all_finite(line))
            }
            FeatureGeometry::Polygons(parts) => {
                parts.retain(|part| part.iter().any(|ring| !ring.is_empty()));
                let mut rings = parts.iter().flatten();
                if let Some(ring) = rings.clone().find(|ring| ring.len() < 3) {
                    return Err(format!("a ring of {} corners", ring.len()));
                }
                rings.all(|ring| all_finite(ring))
            }
            FeatureGeometry::Collection(members) => {
                let members = std::mem::take(members).into_iter().map(FeatureGeometry::checked);
                return members.collect::<Result<_, _>>().map(FeatureGeometry::Collection);
            }
        };
        if is_finite { Ok(self) } else { Err("a coordinate that is no number".into()) }
    }
}

/// A value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureAttribute {
    /// Nothing.
    None,
    /// A whole number.
    Integer(i64),
    /// A number.
    Number(f64),
    /// A text; a date or time as it is written, bytes in hexadecimal digits.
    Text(String),
    /// Yes or no.
    Boolean(bool),
    /// A list, an object, or a number beyond 64 bits, as JSON.
    Json(String),
}

impl From<&Value> for FeatureAttribute {
    fn from(value: &Value) -> FeatureAttribute {
        match value {
            Value::Null => FeatureAttribute::None,
            Value::Bool(is) => FeatureAttribute::Boolean(*is),
            Value::String(text) => FeatureAttribute::Text(text.clone()),
            Value::Number(number) if number.is_f64() => {
                number.as_f64().map_or(FeatureAttribute::None, FeatureAttribute::Number)
            }
            Value::Number(number) => {
                let whole = number.as_i64().map(FeatureAttribute::Integer);
                whole.unwrap_or_else(|| FeatureAttribute::Json(number.to_string()))
            }
            Value::Array(_) | Value::Object(_) => FeatureAttribute::Json(value.to_string()),
        }
    }
}

impl FeatureAttribute {
    /// The value as JSON.
    pub fn to_json(&self) -> Value {
        match self {
            FeatureAttribute::None => Value::Null,
            FeatureAttribute::Integer(number) => Value::from(*number),
            FeatureAttribute::Number(number) => Value::from(*number),
            FeatureAttribute::Text(text) => Value::from(text.as_str()),
            FeatureAttribute::Boolean(is) => Value::from(*is),
            FeatureAttribute::Json(text) => {
                serde_json::from_str(text).unwrap_or_else(|_| Value::from(text.as_str()))
            }
        }
    }

    /// The value as text; nothing for none.
    pub fn to_text(&self) -> String {
        match self {
            FeatureAttribute::None => String::new(),
            FeatureAttribute::Integer(number) => number.to_string(),
            FeatureAttribute::Number(number) => Value::from(*number).to_string(),
            FeatureAttribute::Text(text) | FeatureAttribute::Json(text) => text.clone(),
            FeatureAttribute::Boolean(is) => is.to_string(),
        }
    }

    /// Type of the attributes that have it; `None` if all have.
    pub(crate) fn kind(&self) -> Option<AttributeType> {
        match self {
            FeatureAttribute::None => None,
            FeatureAttribute::Integer(_) => Some(AttributeType::Integer),
            FeatureAttribute::Number(_) => Some(AttributeType::Number),
            FeatureAttribute::Text(_) => Some(AttributeType::Text),
            FeatureAttribute::Boolean(_) => Some(AttributeType::Boolean),
            FeatureAttribute::Json(_) => Some(AttributeType::Json),
        }
    }
}

/// Description of a layer of features.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureSchema {
    /// Its name.
    pub name: String,
    /// The coordinate system, where known.
    pub crs: Option<Crs>,
    /// Names and types of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// Kind of all features; `None` if they are of several kinds, or that is not known.
    pub kind: Option<GeometryKind>,
    /// Number of features in the file, whatever is asked for; `None` if it is not known.
    pub count: Option<u64>,
}

impl FeatureSchema {
    /// The place of an attribute among all.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|(own, _)| own == name)
    }
}

/// A layer that is being read, feature by feature.
pub trait FeatureReader {
    /// Description of the layer.
    fn schema(&self) -> &FeatureSchema;

    /// The next feature; `None` behind the last.
    ///
    /// # Errors
    /// If the file cannot be read, breaks the rules of its format, or the feature needs more memory than there may be, or has a geometry that
    /// cannot be used; all of them with the feature's number, from 1.
    fn next(&mut self) -> Result<Option<Feature>>;
}

/// Options of reading features.
#[derive(Clone, Debug)]
pub struct FeatureOptions {
    /// Bytes of memory that a feature may take.
    pub memory: u64,
    /// Name of the layer, of files that may have several.
    pub layer: Option<String>,
    /// Conditions that hold for the features that are asked for.
    pub filter: FeatureFilter,
    /// Names of the attributes that are asked for, in this order; `None` for all.
    pub attributes: Option<Vec<String>>,
}

impl Default for FeatureOptions {
    fn default() -> FeatureOptions {
        FeatureOptions { memory: 256 << 20, layer: None, filter: FeatureFilter::default(), attributes: None }
    }
}

/// Opens a file of features: GeoJSON, also one feature per line or record (RFC 8142); tables of comma-separated values with geometries in
/// well-known text or binary (in a column `wkt`, `wkb`, `geometry`, `geom` or `the_geom`) or points (in `x` and `y`, or `lon` and `lat`);
/// shapefiles; `GeoPackage` (feature `mbtiles`; `x.gpkg:NAME` is one layer of several) and `FlatGeobuf` (feature `flatgeobuf`).
///
/// # Errors
/// If it cannot be read, or is of another format; if it has several layers, and none or another one is named; if no feature has an attribute
/// that is asked for.
pub fn open_features(path: &Path, options: &FeatureOptions) -> Result<Box<dyn FeatureReader>> {
    open_with(path, options, None)
}

/// Opens a file, with one more attribute than those that are asked for, if there is such.
pub(super) fn open_with(
    path: &Path,
    options: &FeatureOptions,
    more: Option<&str>,
) -> Result<Box<dyn FeatureReader>> {
    let mut wanted = Wanted::new(options, more);
    let reader = formats::open(path, options, &mut wanted)?;
    Selected::of(reader, options, &wanted, more)
}

/// Reads a GeoJSON text as files are read; the path is for messages.
pub(super) fn open_geojson(
    text: Vec<u8>,
    path: &Path,
    options: &FeatureOptions,
    more: Option<&str>,
) -> Result<Box<dyn FeatureReader>> {
    let mut wanted = Wanted::new(options, more);
    let reader = GeoJson::open(Box::new(Cursor::new(text)), path, options, &mut wanted)?;
    Selected::of(Box::new(reader), options, &wanted, more)
}

/// The names of attributes that are read, and those that there are.
pub(super) struct Wanted {
    /// Those that are asked for, or decide; `None` for all.
    names: Option<BTreeSet<String>>,
    /// Those that features have: the first of them.
    known: BTreeSet<String>,
}

/// Names that are told to somebody who asked for another one.
const MAX_REMEMBERED: usize = 200;

impl Wanted {
    pub(super) fn new(options: &FeatureOptions, more: Option<&str>) -> Wanted {
        let names = options.attributes.as_ref().map(|chosen| {
            let others = options.filter.names().chain(more).map(str::to_owned);
            others.chain(chosen.iter().cloned()).collect()
        });
        Wanted { names, known: BTreeSet::new() }
    }

    /// Whether an attribute that features have is to be read.
    pub(super) fn takes(&mut self, name: &str) -> bool {
        if self.known.len() < MAX_REMEMBERED && !self.known.contains(name) {
            self.known.insert(name.chars().take(100).collect());
        }
        self.names.as_ref().is_none_or(|names| names.contains(name))
    }

    fn known(&self) -> String {
        self.known.iter().map(String::as_str).collect::<Vec<_>>().join(", ")
    }
}

/// The error that an attribute was asked for that no feature has.
pub(super) fn unknown_attribute(name: &str, known: &str) -> Error {
    let expected = format!("the name of one that a feature has: {known}");
    Error::invalid("attribute", format!("{name}, which no feature has"), expected)
}

/// Features and attributes that are asked for, of all that a file has.
struct Selected {
    reader: Box<dyn FeatureReader>,
    filter: FeatureFilter,
    /// Places of the attributes that the filter asks for.
    asked: Vec<usize>,
    /// Places of those that are handed out; `None` for all.
    chosen: Option<Vec<usize>>,
    schema: FeatureSchema,
}

impl Selected {
    fn of(
        reader: Box<dyn FeatureReader>,
        options: &FeatureOptions,
        wanted: &Wanted,
        more: Option<&str>,
    ) -> Result<Box<dyn FeatureReader>> {
        let mut schema = reader.schema().clone();
        let place =
            |name: &str| schema.position(name).ok_or_else(|| unknown_attribute(name, &wanted.known()));
        let asked = options.filter.names().map(place).collect::<Result<Vec<_>>>()?;
        let chosen = match &options.attributes {
            Some(names) => {
                let more = more.filter(|more| !names.iter().any(|name| name == more));
                let more = more.and_then(|more| schema.position(more)).map(Ok);
                let chosen = names.iter().map(|name| place(name)).chain(more);
                Some(chosen.collect::<Result<Vec<_>>>()?)
            }
            None => None,
        };
        if asked.is_empty() && chosen.is_none() {
            return Ok(reader);
        }
        if let Some(chosen) = &chosen {
            schema.attributes = chosen.iter().map(|place| schema.attributes[*place].clone()).collect();
        }
        Ok(Box::new(Selected { reader, filter: options.filter.clone(), asked, chosen, schema }))
    }
}

impl FeatureReader for Selected {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        while let Some(mut feature) = self.reader.next()? {
            if self.filter.holds(|condition| feature.attributes.get(self.asked[condition])) {
                if let Some(chosen) = &self.chosen {
                    let value = |place: &usize| {
                        feature.attributes.get(*place).cloned().unwrap_or(FeatureAttribute::None)
                    };
                    feature.attributes = chosen.iter().map(value).collect();
                }
                return Ok(Some(feature));
            }
        }
        Ok(None)
    }
}
