//! Features of vector files: points, lines and polygons with attributes, read one at a time.
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
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::filter::FeatureFilter;
use super::formats;
pub use super::formats::is_feature_file;
use super::geojson::GeoJson;
pub use super::heights::Heights;
pub use crate::export::AttributeType;
use crate::export::GeometryKind;
use crate::zonal::in_file;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, PolygonParts};

/// Feature of a vector file.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Id, a string or a number, if the format has ids.
    pub id: Option<Value>,
    /// Attributes, in number and order those of the schema.
    pub attributes: Vec<FeatureAttribute>,
    /// Geometry, if it has one.
    pub geometry: Option<FeatureGeometry>,
    /// Heights and measures of its points.
    pub heights: Heights,
}

impl Feature {
    /// Takes the lines out of the geometry; z is NaN unless all vertices have heights. If they are
    /// not lines, returns what they are.
    pub(crate) fn take_lines(&mut self) -> Result<Vec<Vec<[f64; 3]>>, &'static str> {
        let lines = match self.geometry.take() {
            None => Vec::new(),
            Some(FeatureGeometry::Lines(lines)) => lines,
            Some(FeatureGeometry::Points(_)) => return Err("points"),
            Some(FeatureGeometry::Polygons(_)) => return Err("a polygon"),
            Some(FeatureGeometry::Collection(_)) => return Err("a collection of geometries"),
        };
        let heights = &self.heights.of_points;
        let have_heights = heights.len() == lines.iter().map(Vec::len).sum::<usize>();
        let mut heights = heights.iter().filter(|_| have_heights);
        let mut vertex = |[x, y]: [f64; 2]| [x, y, heights.next().copied().unwrap_or(f64::NAN)];
        Ok(lines.into_iter().map(|line| line.into_iter().map(&mut vertex).collect()).collect())
    }

    /// Returns the id as an attribute: an integer, or else a string.
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

/// Geometry of a feature, in x and y (for z: [`Heights::of_points`]). A geometry without parts is
/// empty.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureGeometry {
    /// Points.
    Points(Vec<[f64; 2]>),
    /// Lines of at least two points.
    Lines(Vec<Vec<[f64; 2]>>),
    /// Polygons, each an outer ring and its holes. Rings have at least three vertices; the last one
    /// may repeat the first.
    Polygons(PolygonParts),
    /// Geometries of several kinds.
    Collection(Vec<FeatureGeometry>),
}

impl FeatureGeometry {
    /// Returns the kind; `None` for a collection.
    pub fn kind(&self) -> Option<GeometryKind> {
        match self {
            FeatureGeometry::Points(_) => Some(GeometryKind::Point),
            FeatureGeometry::Lines(_) => Some(GeometryKind::Line),
            FeatureGeometry::Polygons(_) => Some(GeometryKind::Polygon),
            FeatureGeometry::Collection(_) => None,
        }
    }

    /// Returns all points, including vertices of lines and rings, in order.
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

    /// Applies `change` to all points, including vertices of lines and rings, in order; stops at
    /// its first error.
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

    /// Removes empty parts and checks the geometry; returns an error message if it is invalid.
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
                    return Err(format!("a ring of {} vertices", ring.len()));
                }
                rings.all(|ring| all_finite(ring))
            }
            FeatureGeometry::Collection(members) => {
                let members = std::mem::take(members).into_iter().map(FeatureGeometry::checked);
                return members.collect::<Result<_, _>>().map(FeatureGeometry::Collection);
            }
        };
        if is_finite { Ok(self) } else { Err("a coordinate that is not a number".into()) }
    }
}

/// Attribute value.
#[derive(Clone, Debug, PartialEq)]
pub enum FeatureAttribute {
    /// No value.
    None,
    /// Integer.
    Integer(i64),
    /// Floating-point number.
    Number(f64),
    /// String; also a date or time as written, or bytes in hexadecimal.
    Text(String),
    /// Boolean.
    Boolean(bool),
    /// List, object, or a number beyond 64 bits, as JSON.
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
    /// Converts the value to JSON.
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

    /// Converts the value to a string; empty for no value.
    pub fn to_text(&self) -> String {
        match self {
            FeatureAttribute::None => String::new(),
            FeatureAttribute::Integer(number) => number.to_string(),
            FeatureAttribute::Number(number) => Value::from(*number).to_string(),
            FeatureAttribute::Text(text) | FeatureAttribute::Json(text) => text.clone(),
            FeatureAttribute::Boolean(is) => is.to_string(),
        }
    }

    /// Returns the type of attributes with this value; `None` for no value, which fits all types.
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
    /// Layer name.
    pub name: String,
    /// Coordinate system, if known.
    pub crs: Option<Crs>,
    /// Names and types of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// Kind of all features; `None` if they are of several kinds, or it is unknown.
    pub kind: Option<GeometryKind>,
    /// Number of features in the file, before filtering; `None` if unknown.
    pub count: Option<u64>,
}

impl FeatureSchema {
    /// Returns the index of an attribute.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|(own, _)| own == name)
    }
}

/// Reader of a layer, one feature at a time.
pub trait FeatureReader {
    /// Returns the description of the layer.
    fn schema(&self) -> &FeatureSchema;

    /// Reads the next feature; `None` after the last.
    ///
    /// # Errors
    /// If the file cannot be read, violates the rules of its format, or the feature exceeds the
    /// memory limit, or has an invalid geometry. Errors contain the feature's number, from 1.
    fn next(&mut self) -> Result<Option<Feature>>;

    /// Returns whether the coordinate system is not specified, but WGS 84 by the rules of the
    /// format: see [`FeatureOptions::check_degrees`].
    fn assumes_degrees(&self) -> bool {
        false
    }
}

/// Options of reading features.
#[derive(Clone, Debug)]
pub struct FeatureOptions {
    /// Maximum memory for one feature, in bytes.
    pub memory: u64,
    /// Layer name, for files with several layers.
    pub layer: Option<String>,
    /// Conditions that features must satisfy.
    pub filter: FeatureFilter,
    /// Names of the attributes to read, in this order; `None` for all.
    pub attributes: Option<Vec<String>>,
    /// Whether to reject coordinates that are not degrees in a file that names no coordinate
    /// system, whose format then means WGS 84 (GeoJSON, and tables with columns `lon` and `lat`).
    /// False if the caller does not use the system of the file.
    pub check_degrees: bool,
}

impl Default for FeatureOptions {
    fn default() -> FeatureOptions {
        FeatureOptions {
            memory: 256 << 20,
            layer: None,
            filter: FeatureFilter::default(),
            attributes: None,
            check_degrees: true,
        }
    }
}

/// Opens a feature file. Formats are GeoJSON, also with one feature per line or record (RFC 8142);
/// CSV tables with geometries in WKT or WKB (in a column `wkt`, `wkb`, `geometry`, `geom` or
/// `the_geom`) or points (in `x` and `y`, or `lon` and `lat`); shapefiles; `GeoPackage` (feature
/// `mbtiles`; `x.gpkg:NAME` is one of several layers) and `FlatGeobuf` (feature `flatgeobuf`).
///
/// # Errors
/// If it cannot be read, or has another format; if it has several layers, and none or an unknown
/// one is named; if no feature has a requested attribute. Readers fail at coordinates that are not
/// degrees: see [`FeatureOptions::check_degrees`].
pub fn open_features(path: &Path, options: &FeatureOptions) -> Result<Box<dyn FeatureReader>> {
    open_with(path, options, None)
}

/// Opens a file, and reads one more attribute than requested, if it exists.
pub(super) fn open_with(
    path: &Path,
    options: &FeatureOptions,
    more: Option<&str>,
) -> Result<Box<dyn FeatureReader>> {
    let mut wanted = RequestedAttributes::new(options, more);
    let reader = formats::open(path, options, &mut wanted)?;
    checked(reader, path, options, &wanted, more)
}

/// Reads GeoJSON text like a file; `path` is for messages.
pub(super) fn open_geojson(
    text: Vec<u8>,
    path: &Path,
    options: &FeatureOptions,
    more: Option<&str>,
) -> Result<Box<dyn FeatureReader>> {
    let mut wanted = RequestedAttributes::new(options, more);
    let reader = GeoJson::open(Box::new(Cursor::new(text)), path, options, &mut wanted)?;
    checked(Box::new(reader), path, options, &wanted, more)
}

/// Returns a reader of the selected features, whose coordinates are checked if they must be
/// degrees.
fn checked(
    reader: Box<dyn FeatureReader>,
    path: &Path,
    options: &FeatureOptions,
    wanted: &RequestedAttributes,
    more: Option<&str>,
) -> Result<Box<dyn FeatureReader>> {
    let is_checked = options.check_degrees && reader.assumes_degrees();
    let reader = FilteredReader::of(reader, path, options, wanted, more)?;
    Ok(if is_checked { Box::new(DegreeReader { reader, path: path.into() }) } else { reader })
}

/// A reader that fails at coordinates that are not degrees.
struct DegreeReader {
    reader: Box<dyn FeatureReader>,
    path: PathBuf,
}

impl FeatureReader for DegreeReader {
    fn schema(&self) -> &FeatureSchema {
        self.reader.schema()
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        let feature = self.reader.next()?;
        let Some([x, y]) = feature.as_ref().and_then(beyond_degrees) else { return Ok(feature) };
        let found = format!(
            "the position {x},{y}, which is not in degrees, in a file that names no coordinate system"
        );
        let advice = "say which it is: --crs EPSG:NUMBER (of zones: --in; in Python: crs=), or in the file: `spinney \
                      transform FILE crs=EPSG:NUMBER -o OUT`; of local coordinates: a member \"crs\": null";
        Err(Error::unsupported(&self.path, found, advice))
    }
}

/// Returns the first position of a feature that is not in degrees.
fn beyond_degrees(feature: &Feature) -> Option<[f64; 2]> {
    /// Maximum absolute longitude and latitude. Longitudes may continue across the antimeridian;
    /// the excess over 90 allows for rounding.
    const MAX: [f64; 2] = [360.0, 90.000_001];
    let mut points = feature.geometry.as_ref()?.points();
    points.find(|[x, y]| x.abs() > MAX[0] || y.abs() > MAX[1]).copied()
}

/// Attributes to read, and those found in the file.
pub(super) struct RequestedAttributes {
    /// Attributes that are requested or used by a filter; `None` for all.
    names: Option<BTreeSet<String>>,
    /// The first attributes found.
    known: BTreeSet<String>,
}

/// Maximum number of known names in an error message.
const MAX_REMEMBERED: usize = 200;

impl RequestedAttributes {
    pub(super) fn new(options: &FeatureOptions, more: Option<&str>) -> RequestedAttributes {
        let names = options.attributes.as_ref().map(|chosen| {
            let others = options.filter.names().chain(more).map(str::to_owned);
            others.chain(chosen.iter().cloned()).collect()
        });
        RequestedAttributes { names, known: BTreeSet::new() }
    }

    /// Returns whether an attribute of the file is to be read.
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

/// Error for a requested attribute that no feature has.
pub(super) fn unknown_attribute(name: &str, known: &str) -> Error {
    let expected = format!("one of the features' attributes: {known}");
    Error::invalid("attribute", format!("{name}, which no feature has"), expected)
}

/// Selects features and attributes of a reader.
struct FilteredReader {
    reader: Box<dyn FeatureReader>,
    filter: FeatureFilter,
    /// Indices of the attributes used by the filter.
    filter_columns: Vec<usize>,
    /// Indices of the output attributes; `None` for all.
    chosen: Option<Vec<usize>>,
    schema: FeatureSchema,
}

impl FilteredReader {
    fn of(
        reader: Box<dyn FeatureReader>,
        path: &Path,
        options: &FeatureOptions,
        wanted: &RequestedAttributes,
        more: Option<&str>,
    ) -> Result<Box<dyn FeatureReader>> {
        let mut schema = reader.schema().clone();
        let unknown = |name: &str| in_file(path, unknown_attribute(name, &wanted.known()));
        let index = |name: &str| schema.position(name).ok_or_else(|| unknown(name));
        let filter_columns = options.filter.names().map(index).collect::<Result<Vec<_>>>()?;
        let chosen = match &options.attributes {
            Some(names) => {
                let more = more.filter(|more| !names.iter().any(|name| name == more));
                let more = more.and_then(|more| schema.position(more)).map(Ok);
                let chosen = names.iter().map(|name| index(name)).chain(more);
                Some(chosen.collect::<Result<Vec<_>>>()?)
            }
            None => None,
        };
        if filter_columns.is_empty() && chosen.is_none() {
            return Ok(reader);
        }
        if let Some(chosen) = &chosen {
            schema.attributes = chosen.iter().map(|index| schema.attributes[*index].clone()).collect();
        }
        Ok(Box::new(FilteredReader {
            reader,
            filter: options.filter.clone(),
            filter_columns,
            chosen,
            schema,
        }))
    }
}

impl FeatureReader for FilteredReader {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        while let Some(mut feature) = self.reader.next()? {
            if self.filter.holds(|condition| feature.attributes.get(self.filter_columns[condition])) {
                if let Some(chosen) = &self.chosen {
                    let value = |index: &usize| {
                        feature.attributes.get(*index).cloned().unwrap_or(FeatureAttribute::None)
                    };
                    feature.attributes = chosen.iter().map(value).collect();
                }
                return Ok(Some(feature));
            }
        }
        Ok(None)
    }
}
