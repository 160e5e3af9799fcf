//! Polygons of GeoJSON documents (RFC 7946), as far as questions about trees need them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde_json::Value;

use spinney_base::space::Polygon;
use spinney_base::{Error, Result};
use spinney_crs::Frame;

/// Bytes of a document at most: it is held in memory several times.
const MOST_BYTES: u64 = 1 << 30;

/// A feature that is a polygon, or several.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonFeature {
    /// Its name: the property `name`, else its number in the document.
    pub name: Option<String>,
    /// Parts, each an outer ring and its holes, of corners x, y.
    pub parts: Vec<Vec<Vec<[f64; 2]>>>,
}

impl PolygonFeature {
    /// The polygon in cells of a tree with this frame, whose coordinate system must be that of the corners.
    ///
    /// # Errors
    /// If a ring has too few corners, or one that is nowhere.
    pub fn in_cells(&self, frame: &Frame) -> Result<Polygon> {
        let corner = |[x, y]: &[f64; 2]| {
            let cell = frame.to_cells([*x, *y, 0.0]);
            cell.map(|[x, y, _]| [x, y])
                .ok_or_else(|| Error::invalid("frame", "a flat one", "one with an inverse"))
        };
        let ring = |ring: &Vec<[f64; 2]>| ring.iter().map(corner).collect::<Result<Vec<_>>>();
        let part = |part: &Vec<Vec<[f64; 2]>>| part.iter().map(ring).collect::<Result<Vec<_>>>();
        Polygon::of_parts(&self.parts.iter().map(part).collect::<Result<Vec<_>>>()?)
    }
}

/// Reads the polygons of a GeoJSON file: of a FeatureCollection, a Feature, or a geometry. Corners are taken as they are: in the
/// coordinate system of the tree that is asked.
///
/// # Errors
/// If it cannot be read, is no GeoJSON, is larger than 1 GiB, or has anything but polygons.
pub fn read_polygons(path: &Path) -> Result<Vec<PolygonFeature>> {
    let mut text = String::new();
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    let read = file.take(MOST_BYTES + 1).read_to_string(&mut text).map_err(Error::io(path, "read"))?;
    if read as u64 > MOST_BYTES {
        let advice = "give the polygons in several files".into();
        let what = "a GeoJSON document".into();
        return Err(Error::TooLarge {
            path: path.into(),
            what,
            needed: read as u64,
            limit: MOST_BYTES,
            advice,
        });
    }
    let wrong = |found: String| Error::corrupt(path, "GeoJSON", found, "Polygon and MultiPolygon geometries");
    parse(&text).map_err(wrong)
}

/// Reads the polygons of a GeoJSON text.
///
/// # Errors
/// If it is no GeoJSON, or has anything but polygons.
pub fn parse_polygons(text: &str) -> Result<Vec<PolygonFeature>> {
    parse(text).map_err(|found| Error::invalid("GeoJSON", found, "Polygon and MultiPolygon geometries"))
}

/// The polygons, or what was found instead.
fn parse(text: &str) -> std::result::Result<Vec<PolygonFeature>, String> {
    let text = text.trim_start_matches('\u{feff}');
    let document: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    match kind(&document)? {
        "FeatureCollection" => array(&document, "features")?.iter().map(feature).collect(),
        "GeometryCollection" => {
            array(&document, "geometries")?.iter().map(|part| geometry(part, None)).collect()
        }
        "Feature" => Ok(vec![feature(&document)?]),
        _ => Ok(vec![geometry(&document, None)?]),
    }
}

fn kind(object: &Value) -> std::result::Result<&str, String> {
    object["type"].as_str().ok_or_else(|| "an object without a type".into())
}

fn array<'v>(object: &'v Value, name: &str) -> std::result::Result<&'v Vec<Value>, String> {
    object[name].as_array().ok_or_else(|| format!("no array `{name}`"))
}

fn feature(object: &Value) -> std::result::Result<PolygonFeature, String> {
    let text = |value: &Value| match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    };
    let name = text(&object["properties"]["name"]).or_else(|| text(&object["id"]));
    geometry(&object["geometry"], name)
}

fn geometry(object: &Value, name: Option<String>) -> std::result::Result<PolygonFeature, String> {
    let coordinates = || array(object, "coordinates");
    let parts = match kind(object)? {
        "Polygon" => vec![polygon(coordinates()?)?],
        "MultiPolygon" => {
            let parts =
                coordinates()?.iter().map(|part| polygon(part.as_array().ok_or("a part that is no array")?));
            parts.collect::<std::result::Result<_, _>>()?
        }
        other => return Err(format!("a geometry of type `{other}`")),
    };
    Ok(PolygonFeature { name, parts })
}

fn polygon(rings: &[Value]) -> std::result::Result<Vec<Vec<[f64; 2]>>, String> {
    let corner = |corner: &Value| match corner.as_array().map(Vec::as_slice) {
        Some([x, y, ..]) => x.as_f64().zip(y.as_f64()).map(|(x, y)| [x, y]),
        _ => None,
    };
    let ring = |ring: &Value| {
        let corners =
            ring.as_array().and_then(|corners| corners.iter().map(corner).collect::<Option<Vec<_>>>());
        corners.ok_or_else(|| "a ring that is no array of positions".to_owned())
    };
    rings.iter().map(ring).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_of_all_kinds_of_documents() {
        let square = "[[0,0],[4,0],[4,4],[0,4],[0,0]]";
        let polygon = format!(r#"{{"type":"Polygon","coordinates":[{square}]}}"#);
        let found = parse_polygons(&polygon).unwrap();
        assert_eq!((found.len(), found[0].parts.len(), &found[0].name), (1, 1, &None));
        let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{square}],[{square},{square}]]}}"#);
        let feature = |properties: &str, geometry: &str| {
            format!(r#"{{"type":"Feature","id":7,"properties":{properties},"geometry":{geometry}}}"#)
        };
        let [first, second] = [feature(r#"{"name":"A"}"#, &multi), feature("null", &polygon)];
        let all = format!(r#"{{"type":"FeatureCollection","features":[{first},{second}]}}"#);
        let found = parse_polygons(&format!("\u{feff}{all}")).unwrap();
        let told = found.iter().map(|feature| (feature.name.as_deref(), feature.parts.len()));
        assert_eq!(told.collect::<Vec<_>>(), [(Some("A"), 2), (Some("7"), 1)]);
        assert_eq!(found[0].parts[1].len(), 2);
        let frame = Frame::planar([2.0, 0.0, 100.0, 0.0, -2.0, 50.0]);
        let cells = found[1].in_cells(&frame).unwrap();
        assert_eq!(cells.corners(), [[-50.0, 23.0], [-48.0, 25.0]]);
        for wrong in [
            "",
            "{}",
            "[1]",
            r#"{"type":"Point","coordinates":[1,2]}"#,
            r#"{"type":"Polygon"}"#,
            r#"{"type":"Polygon","coordinates":[[[1,2],[3]]]}"#,
            r#"{"type":"Polygon","coordinates":[[["a","b"]]]}"#,
            r#"{"type":"FeatureCollection","features":[{"type":"Feature","geometry":null}]}"#,
        ] {
            assert!(parse_polygons(wrong).is_err(), "{wrong}");
        }
        let flat = parse_polygons(r#"{"type":"Polygon","coordinates":[[[1,2],[3,4]]]}"#).unwrap();
        assert!(flat[0].in_cells(&Frame::identity()).is_err());
    }
}
