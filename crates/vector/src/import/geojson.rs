//! Polygons of GeoJSON documents (RFC 7946), as far as questions about trees need them.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use spinney_base::space::Polygon;
use spinney_base::{Error, Result};
use spinney_container::OtherFormat;
use spinney_crs::{Coordinates, Crs, Places, PolygonParts, corners_text};

/// Polygons with the coordinate system that they are in.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonLayer {
    /// The coordinate system of the corners: longitude and latitude in WGS 84 (RFC 7946), unless a member `crs` says another one;
    /// `None` where that is `null`.
    pub crs: Option<Crs>,
    /// The features, in the document's order.
    pub features: Vec<PolygonFeature>,
}

/// A feature that is a polygon, or several.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonFeature {
    /// Its id: a text or a number.
    pub id: Option<Value>,
    /// Its attributes.
    pub properties: Map<String, Value>,
    /// Parts, each an outer ring and its holes, of corners x, y; none if it has no geometry.
    pub parts: PolygonParts,
}

impl PolygonFeature {
    /// Its name: the property `name`, else the id.
    pub fn name(&self) -> Option<String> {
        let text = |value: &Value| match value {
            Value::String(text) => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        };
        self.properties.get("name").and_then(text).or_else(|| self.id.as_ref().and_then(text))
    }

    /// Whether an attribute has a value that is written so; numbers are what they are, however they are written, and nothing is what it
    /// does not have.
    fn has_value(&self, name: &str, value: &str) -> bool {
        match self.properties.get(name) {
            Some(Value::String(text)) => text == value,
            Some(Value::Number(number)) => number.as_f64() == value.parse().ok(),
            Some(Value::Bool(is)) => value == is.to_string(),
            Some(Value::Null) | None => value.is_empty(),
            Some(_) => false,
        }
    }

    /// The polygon in cells of a tree; `None` if it lies outside of it, or has no parts.
    ///
    /// # Errors
    /// If a ring has too few corners, or one that is nowhere.
    pub fn in_cells(&self, places: &Places) -> Result<Option<Polygon>> {
        if self.parts.is_empty() {
            return Ok(None);
        }
        // (What is wrong with the corners as they came is found before they are brought elsewhere.)
        Polygon::of_parts(&self.parts)?;
        let parts = places.parts(&self.parts);
        if parts.is_empty() { Ok(None) } else { Polygon::of_parts(&parts).map(Some) }
    }
}

impl PolygonLayer {
    /// Fails if no feature of some layers has an attribute with one of these names.
    ///
    /// # Errors
    /// If there is none, with the names that there are.
    pub fn check_attributes(layers: &[PolygonLayer], names: &[&str]) -> Result<()> {
        let features = layers.iter().flat_map(|layer| &layer.features);
        let known: BTreeSet<&str> =
            features.flat_map(|feature| feature.properties.keys().map(String::as_str)).collect();
        match names.iter().find(|name| !known.contains(*name)) {
            None => Ok(()),
            Some(name) => {
                let known = known.into_iter().collect::<Vec<_>>().join(", ");
                let expected = format!("the name of one that a feature has: {known}");
                Err(Error::invalid("attribute", format!("{name}, which no feature has"), expected))
            }
        }
    }

    /// Keeps the features of some layers that have all of these values of attributes, each a name and the value as text: of numbers
    /// however they are written, `true` or `false`, and nothing for what a feature does not have.
    ///
    /// ```
    /// use spinney::import::geojson::{PolygonLayer, parse_polygons};
    ///
    /// let ring = "[[[0, 0], [1, 0], [1, 1], [0, 0]]]";
    /// let feature = |kind: &str| {
    ///     let geometry = format!(r#"{{"type": "Polygon", "coordinates": {ring}}}"#);
    ///     format!(r#"{{"type": "Feature", "properties": {{"kind": "{kind}"}}, "geometry": {geometry}}}"#)
    /// };
    /// let text = format!(r#"{{"type": "FeatureCollection", "features": [{}, {}]}}"#, feature("wood"), feature("lake"));
    /// let mut layers = [parse_polygons(&text)?];
    /// PolygonLayer::select(&mut layers, &[("kind".into(), "lake".into())])?;
    /// assert_eq!(layers[0].features.len(), 1);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If no feature has such an attribute, or none all of the values.
    pub fn select(layers: &mut [PolygonLayer], values: &[(String, String)]) -> Result<()> {
        if values.is_empty() {
            return Ok(());
        }
        let names: Vec<&str> = values.iter().map(|(name, _)| name.as_str()).collect();
        PolygonLayer::check_attributes(layers, &names)?;
        let is_meant =
            |feature: &PolygonFeature| values.iter().all(|(name, value)| feature.has_value(name, value));
        layers.iter_mut().for_each(|layer| layer.features.retain(is_meant));
        if layers.iter().any(|layer| !layer.features.is_empty()) {
            return Ok(());
        }
        let found: Vec<String> = values.iter().map(|(name, value)| format!("{name}={value}")).collect();
        Err(Error::invalid(
            "features",
            format!("none with {}", found.join(", ")),
            "values that a feature has",
        ))
    }

    /// The coordinates that corners are in: those of [`PolygonLayer::crs`], or the tree's own where that is not known.
    pub fn coordinates(&self) -> Coordinates {
        self.crs.clone().map_or(Coordinates::World, Coordinates::System)
    }

    /// The polygons in cells of a tree with a picture of so many cells along each axis; `None` of those that lie outside of it.
    ///
    /// # Errors
    /// Those of [`PolygonFeature::in_cells`], with the feature's number; if there are polygons and all of them lie outside of the tree.
    pub fn in_cells(&self, places: &Places, extent: [u64; 3]) -> Result<Vec<Option<Polygon>>> {
        let polygons = self.polygons(places)?;
        if self.meets(&polygons, extent) { Ok(polygons) } else { Err(self.outside(places)) }
    }

    /// [`PolygonLayer::in_cells`] of several trees, such as the layers of a file.
    ///
    /// # Errors
    /// Those of [`PolygonLayer::in_cells`]; polygons may lie outside of some of the trees, but not of all.
    pub fn in_cells_of(&self, trees: &[(Places, [u64; 3])]) -> Result<Vec<Vec<Option<Polygon>>>> {
        let all = trees.iter().map(|(places, _)| self.polygons(places)).collect::<Result<Vec<_>>>()?;
        let mut pairs = trees.iter().zip(&all);
        match trees.first() {
            Some((places, _)) if !pairs.any(|((_, extent), polygons)| self.meets(polygons, *extent)) => {
                Err(self.outside(places))
            }
            _ => Ok(all),
        }
    }

    fn polygons(&self, places: &Places) -> Result<Vec<Option<Polygon>>> {
        let in_cells = |(index, feature): (usize, &PolygonFeature)| {
            feature.in_cells(places).map_err(|error| match error {
                Error::Invalid { what, found, expected } => {
                    Error::invalid(format!("feature {}: {what}", index + 1), found, expected)
                }
                other => other,
            })
        };
        self.features.iter().enumerate().map(in_cells).collect()
    }

    /// Whether some of the polygons reach into a picture of so many cells, or there are none.
    fn meets(&self, polygons: &[Option<Polygon>], extent: [u64; 3]) -> bool {
        let is_met = |polygon: &Polygon| {
            let [low, high] = polygon.corners();
            (0..2).all(|axis| high[axis] > 0.0 && low[axis] < extent[axis] as f64)
        };
        self.features.iter().all(|feature| feature.parts.iter().flatten().flatten().next().is_none())
            || polygons.iter().flatten().any(is_met)
    }

    /// The error that all polygons lie outside of a tree.
    fn outside(&self, places: &Places) -> Error {
        let corners = || self.features.iter().flat_map(|feature| feature.parts.iter().flatten().flatten());
        let least = |axis: usize| corners().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
        let most = |axis: usize| corners().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
        let system = self.crs.as_ref().map_or("the tree's own system".into(), Crs::to_string);
        let found = format!(
            "{} in {system}, all outside of the tree",
            corners_text([least(0), least(1)], [most(0), most(1)])
        );
        let swapped =
            corners().filter_map(|[x, y]| places.cell([*y, *x, 0.0])).any(|cell| places.is_inside(cell));
        let advice = match swapped {
            true => "x and y of the corners seem to be swapped",
            false => "a member \"crs\" or the option for coordinates says in which system they are",
        };
        let expected = format!("polygons that touch the tree, which is {} there; {advice}", places.picture());
        Error::invalid("extent of the polygons", found, expected)
    }
}

/// Reads the polygons of a GeoJSON file: of a FeatureCollection, a Feature, or a geometry. With `memory` bytes they must fit: about six
/// times the file's.
///
/// # Errors
/// If it cannot be read, is no GeoJSON, needs more memory, or has anything but polygons.
pub fn read_polygons(path: &Path, memory: u64) -> Result<PolygonLayer> {
    let too_large = |needed: u64| Error::TooLarge {
        path: path.into(),
        what: "a GeoJSON document".into(),
        needed,
        limit: memory,
        advice: "allow more, or give the polygons in several files".into(),
    };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    let read = file.take(memory / 2 + 1).read_to_end(&mut bytes).map_err(Error::io(path, "read"))? as u64;
    if read > memory / 2 {
        return Err(too_large(2 * read));
    }
    // What stands between two commas or colons becomes half a corner, or a part of an attribute.
    let parts = bytes.iter().filter(|byte| matches!(byte, b',' | b':')).count() as u64;
    let needed = 2 * read + parts * BYTES_EACH;
    if needed > memory {
        return Err(too_large(needed));
    }
    let wrong = |found: String| {
        let damaged = || Error::corrupt(path, "GeoJSON", found, "Polygon and MultiPolygon geometries");
        OtherFormat::refuse_unread(path, &bytes).unwrap_or_else(damaged)
    };
    let text = std::str::from_utf8(&bytes).map_err(|error| wrong(error.to_string()))?;
    parse(text).map_err(wrong)
}

/// Bytes of memory for half a corner, as it was read, in cells, and as an edge; or for a part of an attribute.
const BYTES_EACH: u64 = 64;

/// Reads the polygons of a GeoJSON text.
///
/// # Errors
/// If it is no GeoJSON, or has anything but polygons.
pub fn parse_polygons(text: &str) -> Result<PolygonLayer> {
    parse(text).map_err(|found| Error::invalid("GeoJSON", found, "Polygon and MultiPolygon geometries"))
}

type Parsed<T> = std::result::Result<T, String>;

/// An object's members, each as the text that it has: only what is looked at is parsed.
type Members<'t> = HashMap<Cow<'t, str>, &'t RawValue>;

/// The polygons, or what was found instead.
fn parse(text: &str) -> Parsed<PolygonLayer> {
    let document: Members = parsed(text.trim_start_matches('\u{feff}'))?;
    let bare = |parts: PolygonParts| PolygonFeature { id: None, properties: Map::new(), parts };
    let list = |name: &str| -> Parsed<Vec<&RawValue>> {
        let found = document.get(name).ok_or_else(|| format!("no array `{name}`"))?;
        parsed(found.get())
    };
    let features = match kind(&document)?.as_str() {
        "FeatureCollection" => list("features")?
            .into_iter()
            .map(|found| feature(&parsed(found.get())?))
            .collect::<Parsed<_>>()?,
        "GeometryCollection" => list("geometries")?
            .into_iter()
            .map(|found| geometry(&parsed(found.get())?).map(bare))
            .collect::<Parsed<_>>()?,
        "Feature" => vec![feature(&document)?],
        _ => vec![bare(geometry(&document)?)],
    };
    Ok(PolygonLayer { crs: system(&document)?, features })
}

fn parsed<'t, T: Deserialize<'t>>(text: &'t str) -> Parsed<T> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}

/// The coordinate system that a document says it has, by a name; what has no member `crs` is in degrees.
fn system(document: &Members) -> Parsed<Option<Crs>> {
    let degrees = Crs::epsg(4326);
    let Some(crs) = document.get("crs") else { return Ok(Some(degrees)) };
    let crs: Value = parsed(crs.get())?;
    if crs.is_null() {
        return Ok(None);
    }
    let name = crs["properties"]["name"].as_str().filter(|_| crs["type"] == "name");
    let name = name.ok_or_else(|| format!("a member `crs` without a name: {crs}"))?;
    if name.ends_with(":CRS84") || name.ends_with("/CRS84") {
        return Ok(Some(degrees));
    }
    Crs::parse(name).map(Some).map_err(|error| format!("a member `crs` of another kind: {error}"))
}

fn kind(object: &Members) -> Parsed<String> {
    let kind = object.get("type").and_then(|kind| parsed(kind.get()).ok());
    kind.ok_or_else(|| "an object without a type".into())
}

fn feature(object: &Members) -> Parsed<PolygonFeature> {
    let parts = match object.get("geometry") {
        None => return Err("a feature without a member `geometry`".into()),
        Some(found) if found.get() == "null" => Vec::new(),
        Some(found) => geometry(&parsed(found.get())?)?,
    };
    let id: Option<Value> = object.get("id").map(|id| parsed(id.get())).transpose()?;
    let properties = object.get("properties").map(|found| parsed::<Option<_>>(found.get())).transpose()?;
    Ok(PolygonFeature {
        id: id.filter(|id| id.is_string() || id.is_number()),
        properties: properties.flatten().unwrap_or_default(),
        parts,
    })
}

fn geometry(object: &Members) -> Parsed<PolygonParts> {
    let kind = kind(object)?;
    let coordinates = object.get("coordinates").map(|found| found.get());
    let coordinates = || coordinates.ok_or_else(|| "a geometry without coordinates".to_owned());
    let parts: Vec<Vec<Vec<Corner>>> = match kind.as_str() {
        "Polygon" => vec![parsed(coordinates()?)?],
        "MultiPolygon" => parsed(coordinates()?)?,
        other => return Err(format!("a geometry of type `{other}`")),
    };
    let ring = |ring: Vec<Corner>| ring.into_iter().map(|Corner(corner)| corner).collect();
    Ok(parts.into_iter().map(|part| part.into_iter().map(ring).collect()).collect())
}

/// A position, of which the first two numbers count.
struct Corner([f64; 2]);

impl<'de> Deserialize<'de> for Corner {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Corner, D::Error> {
        struct Position;

        impl<'de> Visitor<'de> for Position {
            type Value = Corner;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a position of two numbers or more")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> std::result::Result<Corner, A::Error> {
                let mut corner = [0.0; 2];
                for (index, number) in corner.iter_mut().enumerate() {
                    let found = numbers.next_element()?;
                    *number = found.ok_or_else(|| de::Error::invalid_length(index, &self))?;
                }
                while numbers.next_element::<f64>()?.is_some() {}
                Ok(Corner(corner))
            }
        }

        deserializer.deserialize_seq(Position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_crs::Frame;

    fn square(at: f64) -> String {
        let end = at + 4.0;
        format!("[[{at},{at}],[{end},{at}],[{end},{end}],[{at},{end}],[{at},{at}]]")
    }

    #[test]
    fn polygons_of_all_kinds_of_documents() {
        let square = square(0.0);
        let polygon = format!(r#"{{"type":"Polygon","coordinates":[{square}]}}"#);
        let found = parse_polygons(&polygon).unwrap();
        let first = &found.features[0];
        assert_eq!((found.features.len(), first.parts.len(), first.name()), (1, 1, None));
        assert_eq!(found.coordinates(), Coordinates::LONLAT);
        let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{square}],[{square},{square}]]}}"#);
        let feature = |properties: &str, geometry: &str| {
            format!(r#"{{"type":"Feature","id":7,"properties":{properties},"geometry":{geometry}}}"#)
        };
        let [first, second, third] =
            [feature(r#"{"name":"A","area":1.5}"#, &multi), feature("null", &polygon), feature("{}", "null")];
        let all = format!(r#"{{"type":"FeatureCollection","features":[{first},{second},{third}]}}"#);
        let found = parse_polygons(&format!("\u{feff}{all}")).unwrap().features;
        let told = found.iter().map(|feature| (feature.name(), feature.parts.len()));
        let seven = || Some("7".into());
        assert_eq!(told.collect::<Vec<_>>(), [(Some("A".into()), 2), (seven(), 1), (seven(), 0)]);
        assert_eq!((&found[0].properties["area"], &found[0].id), (&Value::from(1.5), &Some(7.into())));
        assert_eq!(found[0].parts[1].len(), 2);
        let frame = Frame::planar([2.0, 0.0, 100.0, 0.0, -2.0, 50.0]);
        let places = Places::new(&Coordinates::World, &frame, [10, 10, 1]).unwrap();
        let cells = found[1].in_cells(&places).unwrap().unwrap();
        assert_eq!(cells.corners(), [[-50.0, 23.0], [-48.0, 25.0]]);
        assert!(found[2].in_cells(&places).unwrap().is_none());
        for wrong in [
            "",
            "{}",
            "[1]",
            r#"{"type":"Point","coordinates":[1,2]}"#,
            r#"{"type":"Polygon"}"#,
            r#"{"type":"Polygon","coordinates":[[[1,2],[3]]]}"#,
            r#"{"type":"Polygon","coordinates":[[["a","b"]]]}"#,
            r#"{"type":"Polygon","coordinates":[],"crs":{"type":"link","properties":{"href":"x"}}}"#,
            r#"{"type":"Polygon","coordinates":[],"crs":{"type":"name","properties":{"name":"elsewhere"}}}"#,
            r#"{"type":"FeatureCollection","features":[{"type":"Feature"}]}"#,
        ] {
            assert!(parse_polygons(wrong).is_err(), "{wrong}");
        }
        let flat = parse_polygons(r#"{"type":"Polygon","coordinates":[[[1,2],[3,4]]]}"#).unwrap();
        assert!(flat.features[0].in_cells(&places).is_err());
    }

    #[test]
    fn systems_are_those_that_documents_name() {
        let with = |crs: &str| {
            let text = format!(r#"{{"type":"Polygon","coordinates":[{}],"crs":{crs}}}"#, square(1.0));
            parse_polygons(&text).unwrap().crs
        };
        let named = |name: &str| with(&format!(r#"{{"type":"name","properties":{{"name":"{name}"}}}}"#));
        assert_eq!(named("urn:ogc:def:crs:OGC:1.3:CRS84"), Some(Crs::epsg(4326)));
        assert_eq!(named("urn:ogc:def:crs:EPSG::25832"), Some(Crs::epsg(25832)));
        assert_eq!(named("EPSG:3857"), Some(Crs::epsg(3857)));
        assert_eq!(with("null"), None);
    }

    #[test]
    fn a_layer_that_touches_nothing_is_told() {
        let frame = Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([1.0, 0.0, 40.0, 0.0, -1.0, 5.0]) };
        let extent = [10, 10, 1];
        let places = Places::new(&Coordinates::LONLAT, &frame, extent).unwrap();
        let layer = |text: &str| {
            parse_polygons(&format!(r#"{{"type":"Polygon","coordinates":[{text}]}}"#))
                .unwrap()
                .in_cells(&places, extent)
        };
        let told = layer(&square(60.0)).unwrap_err().to_string();
        assert!(
            told.contains("60,60,64,64 in EPSG:4326") && told.contains("40,-5,50,5") && told.contains("crs"),
            "{told}"
        );
        let told = layer("[[0,41],[1,41],[1,42]]").unwrap_err().to_string();
        assert!(told.contains("swapped"), "{told}");
        assert!(layer("[[41,0],[42,0],[42,1]]").unwrap()[0].is_some());
    }
}
