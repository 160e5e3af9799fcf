//! `GeoJSON`: feature collections, single features or sequences of these (RFC 7946, RFC 8142), and
//! bare geometries.
//!
//! A file is read twice: first for the names and types of all attributes, and the coordinate
//! system, which may follow the features; then feature by feature.

use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::Value;
use serde_json::value::RawValue;

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema,
    RequestedAttributes,
};
use super::heights::Heights;
use super::scanner::{Input, List, Record, ScannedItem, Scanner};
use crate::export::GeometryKind;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Maximum number of attributes, since each feature stores a value of each.
const MAX_NAMES: usize = 4096;

/// Maximum nesting depth of geometries.
const MAX_DEPTH: usize = 16;

pub(super) struct GeoJson {
    scanner: Scanner,
    path: PathBuf,
    schema: FeatureSchema,
    columns: Columns,
    /// Number of the next feature, from 1.
    number: u64,
    assumes_degrees: bool,
}

impl GeoJson {
    pub(super) fn open(
        input: Box<dyn Input>,
        path: &Path,
        options: &FeatureOptions,
        wanted: &mut RequestedAttributes,
    ) -> Result<GeoJson> {
        let mut scanner = Scanner::new(input, path, options.memory);
        let mut sketch = GeoJsonSurvey::default();
        let (mut record, mut number) = (Record::default(), 1);
        while let Some(step) = scanner.step(&mut record)? {
            let is_feature = sketch.add(step, &record, wanted).map_err(|found| wrong(path, number, found))?;
            number += u64::from(is_feature);
            scanner.set_number(number);
        }
        let Some(crs) = sketch.crs else {
            return Err(Error::corrupt(path, "GeoJSON", "nothing", "features"));
        };
        scanner.rewind()?;
        let own = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let schema = FeatureSchema {
            name: sketch.name.or(own).unwrap_or_default(),
            crs,
            attributes: sketch.columns.attributes(),
            kind: sketch.kind.flatten(),
            count: Some(number - 1),
        };
        let GeoJsonSurvey { columns, assumes_degrees, .. } = sketch;
        Ok(GeoJson { scanner, path: path.into(), schema, columns, number: 1, assumes_degrees })
    }
}

fn wrong(path: &Path, number: u64, found: String) -> Error {
    Error::corrupt(
        path,
        format!("feature {number}"),
        found,
        "GeoJSON (RFC 7946) of points, lines and polygons",
    )
}

impl FeatureReader for GeoJson {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn assumes_degrees(&self) -> bool {
        self.assumes_degrees
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        let mut record = Record::default();
        self.scanner.set_number(self.number);
        while let Some(step) = self.scanner.step(&mut record)? {
            if matches!(step, ScannedItem::Document(Some(_))) {
                continue;
            }
            let found = feature(step, &record, &self.columns);
            let feature = found.map_err(|found| wrong(&self.path, self.number, found))?;
            self.number += 1;
            if Some(self.number - 1) > self.schema.count {
                break;
            }
            return Ok(Some(feature));
        }
        match Some(self.number - 1) == self.schema.count {
            true => Ok(None),
            false => Err(Error::Changed { path: self.path.clone(), what: "was overwritten" }),
        }
    }
}

type Parsed<T> = std::result::Result<T, String>;

fn parsed<'t, T: Deserialize<'t>>(text: &'t str) -> Parsed<T> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}

/// Result of the first pass.
#[derive(Default)]
struct GeoJsonSurvey {
    columns: Columns,
    /// Coordinate system of all documents; the inner `None` if it is unknown in some, the outer one
    /// before the first document.
    crs: Option<Option<Crs>>,
    /// Whether some documents do not specify it.
    assumes_degrees: bool,
    name: Option<String>,
    /// Kind of the features; the inner `None` for several kinds, the outer one before the first
    /// feature.
    kind: Option<Option<GeometryKind>>,
}

impl GeoJsonSurvey {
    /// Adds an item; returns whether it is a feature.
    fn add(&mut self, step: ScannedItem, record: &Record, wanted: &mut RequestedAttributes) -> Parsed<bool> {
        if let ScannedItem::Document(list) = step {
            let kind = record.kind()?;
            let expected = match kind.as_str() {
                "FeatureCollection" => Some(List::Features),
                "GeometryCollection" => Some(List::Geometries),
                _ => None,
            };
            match (expected, list) {
                (Some(List::Features), None) => return Err("a collection without an array `features`".into()),
                (Some(List::Geometries), None) => {
                    return Err("a collection without an array `geometries`".into());
                }
                (expected, list) if expected != list => {
                    return Err(format!("a list of features in a `{kind}`"));
                }
                _ => {}
            }
            let crs = system(record.get("crs"))?;
            self.assumes_degrees |= record.get("crs").is_none();
            if self.crs.get_or_insert_with(|| crs.clone()) != &crs {
                return Err("a coordinate system that differs from that of earlier features".into());
            }
            if let (Some(_), Some(name)) = (list, record.get("name")) {
                self.name = parsed(name).ok();
                return Ok(false);
            } else if list.is_some() {
                return Ok(false);
            }
        }
        let kind = if is_bare(step, record)? { record.get("type") } else { record.get("geometry") };
        // A missing geometry is reported in the second pass; a null geometry has no kind.
        if let Some(kind) = kind.filter(|kind| *kind != "null") {
            let kind = geometry_kind(&parsed::<String>(kind)?)?;
            if *self.kind.get_or_insert(kind) != kind {
                self.kind = Some(None);
            }
        }
        if let Some(properties) = record.get("properties") {
            for (name, value) in parsed::<Option<Pairs>>(properties)?.into_iter().flat_map(|pairs| pairs.0) {
                self.columns.see(&name, kind_of(value.get()), wanted)?;
            }
        }
        Ok(true)
    }
}

/// Returns whether an item is a bare geometry.
fn is_bare(step: ScannedItem, record: &Record) -> Parsed<bool> {
    match step {
        ScannedItem::Element(list) => Ok(list == List::Geometries),
        ScannedItem::Document(_) => Ok(record.kind()? != "Feature"),
    }
}

fn geometry_kind(name: &str) -> Parsed<Option<GeometryKind>> {
    match name {
        "Point" | "MultiPoint" => Ok(Some(GeometryKind::Point)),
        "LineString" | "MultiLineString" => Ok(Some(GeometryKind::Line)),
        "Polygon" | "MultiPolygon" => Ok(Some(GeometryKind::Polygon)),
        "GeometryCollection" => Ok(None),
        other => Err(format!("a geometry of type `{other}`")),
    }
}

/// Attributes found so far.
#[derive(Default)]
struct Columns {
    /// Index of each requested attribute, and `None` for the others.
    indices: HashMap<String, Option<usize>>,
    attributes: Vec<(String, Option<AttributeType>)>,
}

impl Columns {
    /// Adds a value.
    fn see(
        &mut self,
        name: &str,
        kind: Option<AttributeType>,
        wanted: &mut RequestedAttributes,
    ) -> Parsed<()> {
        let index = match self.indices.get(name) {
            Some(index) => *index,
            None => {
                let index = wanted.takes(name).then_some(self.attributes.len());
                if index.is_some() {
                    if self.attributes.len() == MAX_NAMES {
                        return Err(format!(
                            "more than {MAX_NAMES} names of attributes (select some of them)"
                        ));
                    }
                    self.attributes.push((name.into(), None));
                }
                if index.is_some() || self.indices.len() < 2 * MAX_NAMES {
                    self.indices.insert(name.into(), index);
                }
                index
            }
        };
        if let (Some(index), Some(kind)) = (index, kind) {
            let known = &mut self.attributes[index].1;
            *known = Some(known.map_or(kind, |known| known.with(kind)));
        }
        Ok(())
    }

    /// Returns names and types. Attributes without values are strings.
    fn attributes(&self) -> Vec<(String, AttributeType)> {
        let all = self.attributes.iter();
        all.map(|(name, kind)| (name.clone(), kind.unwrap_or(AttributeType::Text))).collect()
    }
}

/// Returns the coordinate system that a document names. Without the member `crs`, coordinates are
/// in degrees.
fn system(crs: Option<&str>) -> Parsed<Option<Crs>> {
    let degrees = Crs::epsg(4326);
    let Some(crs) = crs else { return Ok(Some(degrees)) };
    let crs: Value = parsed(crs)?;
    if crs.is_null() {
        return Ok(None);
    }
    let name = crs["properties"]["name"].as_str().filter(|_| crs["type"] == "name");
    let name = name.ok_or_else(|| format!("a member `crs` without a name: {crs}"))?;
    if name.ends_with(":CRS84") || name.ends_with("/CRS84") {
        return Ok(Some(degrees));
    }
    Crs::parse(name).map(Some).map_err(|error| format!("a member `crs` that is not supported: {error}"))
}

fn feature(step: ScannedItem, record: &Record, columns: &Columns) -> Parsed<Feature> {
    let mut attributes = vec![FeatureAttribute::None; columns.attributes.len()];
    let mut heights = Heights::default();
    if is_bare(step, record)? {
        let (coordinates, geometries) = (record.get("coordinates"), record.get("geometries"));
        let geometry = geometry(&record.kind()?, coordinates, geometries, 0, &mut heights)?;
        return Ok(Feature { id: None, attributes, geometry: Some(geometry.checked()?), heights });
    }
    let geometry = match record.get("geometry") {
        None => return Err("a feature without a member `geometry`".into()),
        Some("null") => None,
        Some(text) => Some(geometry_of(text, 0, &mut heights)?.checked()?),
    };
    if let Some(properties) = record.get("properties") {
        for (name, value) in parsed::<Option<Pairs>>(properties)?.into_iter().flat_map(|pairs| pairs.0) {
            if let Some(Some(index)) = columns.indices.get(&name) {
                attributes[*index] = attribute(value.get())?;
            }
        }
    }
    let id: Option<Value> = record.get("id").map(parsed).transpose()?;
    Ok(Feature { id: id.filter(|id| id.is_string() || id.is_number()), attributes, geometry, heights })
}

/// Returns the type of a JSON value.
fn kind_of(text: &str) -> Option<AttributeType> {
    match text.as_bytes().first()? {
        b'n' => None,
        b't' | b'f' => Some(AttributeType::Boolean),
        b'"' => Some(AttributeType::Text),
        b'{' | b'[' => Some(AttributeType::Json),
        _ => number(text).kind(),
    }
}

fn attribute(text: &str) -> Parsed<FeatureAttribute> {
    Ok(match text.as_bytes().first() {
        None | Some(b'n') => FeatureAttribute::None,
        Some(b't' | b'f') => FeatureAttribute::Boolean(text == "true"),
        Some(b'"') => FeatureAttribute::Text(parsed(text)?),
        Some(b'{' | b'[') => FeatureAttribute::Json(text.into()),
        _ => number(text),
    })
}

/// Parses a number. Integers stay integers; numbers out of range stay text.
fn number(text: &str) -> FeatureAttribute {
    let is_whole = !text.contains(['.', 'e', 'E']);
    match (text.parse().ok().filter(|_| is_whole), text.parse::<f64>()) {
        (Some(number), _) => FeatureAttribute::Integer(number),
        (None, Ok(number)) if !is_whole && number.is_finite() => FeatureAttribute::Number(number),
        _ => FeatureAttribute::Json(text.into()),
    }
}

fn geometry_of(text: &str, depth: usize, heights: &mut Heights) -> Parsed<FeatureGeometry> {
    let pairs = parsed::<Pairs>(text)?.0;
    let member = |name: &str| pairs.iter().rev().find(|(own, _)| own == name).map(|(_, value)| value.get());
    let kind = member("type").and_then(|kind| parsed::<String>(kind).ok());
    let kind = kind.ok_or("an object without a type")?;
    geometry(&kind, member("coordinates"), member("geometries"), depth, heights)
}

fn geometry(
    kind: &str,
    coordinates: Option<&str>,
    geometries: Option<&str>,
    depth: usize,
    heights: &mut Heights,
) -> Parsed<FeatureGeometry> {
    let coordinates = || coordinates.ok_or_else(|| "a geometry without coordinates".to_owned());
    match kind {
        "Point" if coordinates()? == "[]" => Ok(FeatureGeometry::Points(Vec::new())),
        "Point" => Ok(FeatureGeometry::Points(positions(vec![parsed(coordinates()?)?], heights))),
        "MultiPoint" => Ok(FeatureGeometry::Points(positions(parsed(coordinates()?)?, heights))),
        "LineString" => Ok(FeatureGeometry::Lines(vec![positions(parsed(coordinates()?)?, heights)])),
        "MultiLineString" => Ok(FeatureGeometry::Lines(lines(parsed(coordinates()?)?, heights))),
        "Polygon" => Ok(FeatureGeometry::Polygons(vec![lines(parsed(coordinates()?)?, heights)])),
        "MultiPolygon" => {
            let parts: Vec<Vec<Vec<Position>>> = parsed(coordinates()?)?;
            Ok(FeatureGeometry::Polygons(parts.into_iter().map(|part| lines(part, heights)).collect()))
        }
        "GeometryCollection" if depth == MAX_DEPTH => Err(format!("geometries nested {depth} deep")),
        "GeometryCollection" => {
            let members: Vec<&RawValue> = parsed(geometries.ok_or("no array `geometries`")?)?;
            let members = members.into_iter().map(|member| geometry_of(member.get(), depth + 1, heights));
            members.collect::<Parsed<_>>().map(FeatureGeometry::Collection)
        }
        other => Err(format!("a geometry of type `{other}`")),
    }
}

fn positions(positions: Vec<Position>, heights: &mut Heights) -> Vec<[f64; 2]> {
    positions.iter().for_each(|position| heights.add_point(position.height));
    heights.are_there |= positions.iter().any(|position| position.height.is_some());
    heights.have_measures |= positions.iter().any(|position| position.has_more);
    positions.into_iter().map(|position| position.numbers).collect()
}

fn lines(lines: Vec<Vec<Position>>, heights: &mut Heights) -> Vec<Vec<[f64; 2]>> {
    lines.into_iter().map(|line| positions(line, heights)).collect()
}

/// Members of an object, with unparsed values.
struct Pairs<'t>(Vec<(String, &'t RawValue)>);

impl<'de> Deserialize<'de> for Pairs<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Pairs<'de>, D::Error> {
        struct Members;

        impl<'de> Visitor<'de> for Members {
            type Value = Pairs<'de>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Pairs<'de>, A::Error> {
                let mut pairs = Vec::new();
                while let Some(pair) = map.next_entry()? {
                    pairs.push(pair);
                }
                Ok(Pairs(pairs))
            }
        }

        deserializer.deserialize_map(Members)
    }
}

/// A position: x and y, possibly a height, and whether there are more coordinates.
struct Position {
    numbers: [f64; 2],
    height: Option<f64>,
    has_more: bool,
}

impl<'de> Deserialize<'de> for Position {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Position, D::Error> {
        struct Numbers;

        impl<'de> Visitor<'de> for Numbers {
            type Value = Position;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a position of two numbers or more")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> std::result::Result<Position, A::Error> {
                let mut position = [0.0; 2];
                for (index, number) in position.iter_mut().enumerate() {
                    let found = numbers.next_element()?;
                    *number = found.ok_or_else(|| de::Error::invalid_length(index, &self))?;
                }
                let height = numbers.next_element()?;
                let mut has_more = false;
                while numbers.next_element::<de::IgnoredAny>()?.is_some() {
                    has_more = true;
                }
                Ok(Position { numbers: position, height, has_more })
            }
        }

        deserializer.deserialize_seq(Numbers)
    }
}
