//! Features whose geometries are polygons, held in memory, as questions about cells in them need them.

use std::io::Cursor;
use std::path::Path;

use serde_json::Value;

use super::feature::{
    AttributeType, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, Wanted, open_with,
    unknown_attribute,
};
use super::filter::FeatureFilter;
use super::geojson::GeoJson;
use spinney_base::space::Polygon;
use spinney_base::{Error, Result};
use spinney_crs::{Coordinates, Crs, Places, PolygonParts, corners_text};

/// Polygons with the coordinate system that they are in.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonLayer {
    /// The coordinate system of the corners; `None` if it is not known.
    pub crs: Option<Crs>,
    /// Names and kinds of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// The features, in the file's order.
    pub features: Vec<PolygonFeature>,
    /// Features whose corners have heights or measures, which are read over.
    pub with_heights: u64,
}

/// A feature that is a polygon, or several.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonFeature {
    /// Its id: a text or a number.
    pub id: Option<Value>,
    /// Its attributes, in the layer's order.
    pub attributes: Vec<FeatureAttribute>,
    /// Parts, each an outer ring and its holes, of corners x, y; none if it has no geometry.
    pub parts: PolygonParts,
}

impl PolygonFeature {
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
    /// The place of an attribute among all.
    fn position(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|(own, _)| own == name)
    }

    /// A feature's value of an attribute; nothing if there is no such attribute.
    pub fn value<'a>(&self, feature: &'a PolygonFeature, name: &str) -> &'a FeatureAttribute {
        let value = self.position(name).and_then(|place| feature.attributes.get(place));
        value.unwrap_or(&FeatureAttribute::None)
    }

    /// A feature's name: the attribute `name`, else the id.
    pub fn name(&self, feature: &PolygonFeature) -> Option<String> {
        match self.value(feature, "name") {
            FeatureAttribute::Text(text) => Some(text.clone()),
            number @ (FeatureAttribute::Integer(_) | FeatureAttribute::Number(_)) => Some(number.to_text()),
            _ => match &feature.id {
                Some(Value::String(text)) => Some(text.clone()),
                id => id.as_ref().map(Value::to_string),
            },
        }
    }

    /// Keeps the features of some layers for which all of a filter's conditions hold.
    ///
    /// ```
    /// use spinney::import::feature::{PolygonLayer, parse_polygons};
    ///
    /// let ring = "[[[0, 0], [1, 0], [1, 1], [0, 0]]]";
    /// let feature = |kind: &str| {
    ///     let geometry = format!(r#"{{"type": "Polygon", "coordinates": {ring}}}"#);
    ///     format!(r#"{{"type": "Feature", "properties": {{"kind": "{kind}"}}, "geometry": {geometry}}}"#)
    /// };
    /// let text = format!(r#"{{"type": "FeatureCollection", "features": [{}, {}]}}"#, feature("wood"), feature("lake"));
    /// let mut layers = [parse_polygons(&text)?];
    /// PolygonLayer::select(&mut layers, &"kind!=wood".parse()?)?;
    /// assert_eq!(layers[0].features.len(), 1);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If no layer has such an attribute, or the conditions hold for no feature.
    pub fn select(layers: &mut [PolygonLayer], filter: &FeatureFilter) -> Result<()> {
        if filter.conditions.is_empty() {
            return Ok(());
        }
        let unknown = |name: &&str| layers.iter().all(|layer| layer.position(name).is_none());
        if let Some(name) = filter.names().find(unknown) {
            let names = layers.iter().flat_map(|layer| &layer.attributes).map(|(name, _)| name.as_str());
            let names: std::collections::BTreeSet<&str> = names.collect();
            let known: Vec<&str> = names.into_iter().take(MOST_KNOWN).collect();
            return Err(unknown_attribute(name, &known.join(", ")));
        }
        for layer in layers.iter_mut() {
            let places: Vec<Option<usize>> = filter.names().map(|name| layer.position(name)).collect();
            layer
                .features
                .retain(|feature| filter.holds(|condition| feature.attributes.get(places[condition]?)));
        }
        if layers.iter().all(|layer| layer.features.is_empty()) { Err(none_with(filter)) } else { Ok(()) }
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

/// Names that are told to somebody who asked for another one.
const MOST_KNOWN: usize = 200;

fn none_with(filter: &FeatureFilter) -> Error {
    Error::invalid("features", format!("none with {filter}"), "values that a feature has")
}

/// Reads the polygons of a file of any format that [`open_features`](super::feature::open_features) reads, with the attribute `name` besides those
/// that are asked for. All of them must fit into the memory that there may be.
///
/// # Errors
/// Those of [`open_features`](super::feature::open_features); if the file has anything but polygons, or they need more memory; if there are conditions that hold for none of
/// them.
pub fn read_polygons(path: &Path, options: &FeatureOptions) -> Result<PolygonLayer> {
    let layer = collect(&mut *open_with(path, options, Some("name"))?, path, options.memory)?;
    let is_empty = layer.features.is_empty() && !options.filter.conditions.is_empty();
    if is_empty { Err(none_with(&options.filter)) } else { Ok(layer) }
}

/// Reads the polygons of a GeoJSON text.
///
/// # Errors
/// If it is no GeoJSON, or has anything but polygons.
pub fn parse_polygons(text: &str) -> Result<PolygonLayer> {
    let path = Path::new("GeoJSON");
    let options = FeatureOptions { memory: u64::MAX, ..FeatureOptions::default() };
    // (A copy, since readers go over files and keep nothing.)
    let input = Box::new(Cursor::new(text.as_bytes().to_vec()));
    let reader = GeoJson::open(input, path, &options, &mut Wanted::new(&options, None));
    let layer = reader.and_then(|mut reader| collect(&mut reader, path, u64::MAX));
    layer.map_err(|error| match error {
        Error::Corrupt { place, found, expected, .. } => Error::invalid(place, found, expected),
        Error::Unsupported { found, advice, .. } => Error::invalid("GeoJSON", found, advice),
        other => other,
    })
}

/// Bytes of memory for a corner, as it was read, in cells, and as an edge; for a ring, a value, a feature.
const BYTES_OF_CORNER: u64 = 128;
const BYTES_OF_RING: u64 = 128;
const BYTES_OF_VALUE: u64 = 32;
const BYTES_OF_FEATURE: u64 = 256;

fn collect(reader: &mut dyn FeatureReader, path: &Path, memory: u64) -> Result<PolygonLayer> {
    let schema = reader.schema();
    let mut layer = PolygonLayer {
        crs: schema.crs.clone(),
        attributes: schema.attributes.clone(),
        features: Vec::new(),
        with_heights: 0,
    };
    let mut needed = 0u64;
    while let Some(feature) = reader.next()? {
        let number = layer.features.len() + 1;
        layer.with_heights += u64::from(feature.has_heights);
        let mut parts = Vec::new();
        if let Some(geometry) = feature.geometry {
            polygons_of(geometry, &mut parts).map_err(|kind| {
                let found = format!("feature {number}, a geometry of type `{kind}`,");
                Error::unsupported(
                    path,
                    format!("{found} as a zone"),
                    "zones are polygons: make some around it first",
                )
            })?;
        }
        let rings = || parts.iter().flatten();
        let texts = feature.attributes.iter().map(|value| match value {
            FeatureAttribute::Text(text) | FeatureAttribute::Json(text) => text.capacity() as u64,
            _ => 0,
        });
        needed += BYTES_OF_FEATURE
            + rings().count() as u64 * BYTES_OF_RING
            + rings().map(|ring| ring.len() as u64 * BYTES_OF_CORNER).sum::<u64>()
            + feature.attributes.len() as u64 * BYTES_OF_VALUE
            + texts.sum::<u64>();
        if needed > memory {
            return Err(Error::TooLarge {
                path: path.into(),
                what: format!("what the first {number} features are"),
                needed,
                limit: memory,
                advice: "allow more, or give the polygons in several files".into(),
            });
        }
        layer.features.push(PolygonFeature { id: feature.id, attributes: feature.attributes, parts });
    }
    Ok(layer)
}

/// Adds the parts of polygons; or what else a geometry is.
fn polygons_of(geometry: FeatureGeometry, parts: &mut PolygonParts) -> Result<(), &'static str> {
    match geometry {
        FeatureGeometry::Polygons(own) => parts.extend(own),
        FeatureGeometry::Collection(members) => {
            members.into_iter().try_for_each(|member| polygons_of(member, parts))?;
        }
        FeatureGeometry::Points(_) => return Err("Point"),
        FeatureGeometry::Lines(_) => return Err("LineString"),
    }
    Ok(())
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
        assert_eq!((found.features.len(), first.parts.len(), found.name(first)), (1, 1, None));
        assert_eq!(found.coordinates(), Coordinates::LONLAT);
        let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{square}],[{square},{square}]]}}"#);
        let feature = |properties: &str, geometry: &str| {
            format!(r#"{{"type":"Feature","id":7,"properties":{properties},"geometry":{geometry}}}"#)
        };
        let [first, second, third] =
            [feature(r#"{"name":"A","area":1.5}"#, &multi), feature("null", &polygon), feature("{}", "null")];
        let all = format!(r#"{{"type":"FeatureCollection","features":[{first},{second},{third}]}}"#);
        let layer = parse_polygons(&format!("\u{feff}{all}")).unwrap();
        let found = &layer.features;
        let told = found.iter().map(|feature| (layer.name(feature), feature.parts.len()));
        let seven = || Some("7".into());
        assert_eq!(told.collect::<Vec<_>>(), [(Some("A".into()), 2), (seven(), 1), (seven(), 0)]);
        assert_eq!(
            (layer.value(&found[0], "area"), &found[0].id),
            (&FeatureAttribute::Number(1.5), &Some(7.into()))
        );
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
        let flat = parse_polygons(r#"{"type":"Polygon","coordinates":[[[1,2],[3,4]]]}"#).unwrap_err();
        assert!(flat.to_string().contains("feature 1: got a ring of 2 corners"), "{flat}");
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
