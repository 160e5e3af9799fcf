//! Polygon features as zones for cell queries, held in memory all at once or in batches.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema,
    open_geojson, open_with, unknown_attribute,
};
use super::filter::FeatureFilter;
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates, Crs, PolygonParts, corners_text};
use spinney_overlay::Polygon;

/// Polygons with their coordinate system.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonLayer {
    /// Coordinate system of the vertices; `None` if unknown.
    pub crs: Option<Crs>,
    /// Names and types of the attributes.
    pub attributes: Vec<(String, AttributeType)>,
    /// Features, in file order.
    pub features: Vec<Feature>,
    /// Number of features in the file before these.
    pub before: u64,
}

/// Polygons in cells of trees. Each tree has one entry per feature, which is `None` if the feature
/// is outside of it or not a polygon.
pub struct FoundPolygons {
    /// One list per tree.
    pub trees: Vec<Vec<Option<Polygon>>>,
    /// Error to report if there are polygons and all of them are outside of all trees.
    pub outside: Option<Error>,
}

/// Returns the parts of a polygonal geometry; empty for any other.
fn parts_of(feature: &Feature) -> Cow<'_, PolygonParts> {
    match &feature.geometry {
        Some(FeatureGeometry::Polygons(parts)) => Cow::Borrowed(parts),
        Some(FeatureGeometry::Collection(members)) => {
            let mut parts = Vec::new();
            let is_polygon = members.iter().try_for_each(|member| add_polygons(member, &mut parts)).is_ok();
            if is_polygon { Cow::Owned(parts) } else { Cow::default() }
        }
        _ => Cow::default(),
    }
}

/// Returns a warning about polygons whose rings cross or touch, or whose parts overlap.
pub(crate) fn invalid_polygons(count: u64) -> String {
    let (subject, repaired) = match count {
        1 => ("1 polygon is".into(), "it was"),
        _ => (format!("{count} polygons are"), "they were"),
    };
    format!(
        "{subject} invalid (rings cross or touch, or parts overlap); {repaired} repaired: rings of a part by the even-odd rule, and parts were united"
    )
}

/// Moves the parts out of a polygonal geometry.
pub(crate) fn take_polygons(geometry: FeatureGeometry, parts: &mut PolygonParts) {
    match geometry {
        FeatureGeometry::Polygons(own) => parts.extend(own),
        FeatureGeometry::Collection(members) => {
            members.into_iter().for_each(|member| take_polygons(member, parts));
        }
        FeatureGeometry::Points(_) | FeatureGeometry::Lines(_) => {}
    }
}

/// Converts a feature to a polygon in cells of a tree; `None` if it is outside or has no parts.
fn in_cells(feature: &Feature, locator: &CellLocator) -> Result<Option<Polygon>> {
    let parts = parts_of(feature);
    if parts.is_empty() {
        return Ok(None);
    }
    // Errors in the original vertices are reported before transforming them.
    Polygon::check_parts(&parts)?;
    let near = locator.parts(&parts);
    // Parts far from the tree count only towards the area.
    let whole = locator.whole_parts(&parts).map(|whole| Polygon::of_parts(&whole)).transpose()?;
    match (near.is_empty(), whole) {
        (true, whole) => Ok(whole),
        (false, None) => Polygon::of_parts(&near).map(Some),
        (false, Some(whole)) => Ok(Some(Polygon::of_parts(&near)?.part_of(whole.area()))),
    }
}

impl PolygonLayer {
    /// Returns the parts of all features.
    pub fn into_parts(self) -> PolygonParts {
        let mut parts = Vec::new();
        self.features
            .into_iter()
            .filter_map(|feature| feature.geometry)
            .for_each(|own| take_polygons(own, &mut parts));
        parts
    }

    /// Returns the index of an attribute.
    fn position(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|(own, _)| own == name)
    }

    /// Returns a feature's value of an attribute; no value if the attribute does not exist.
    pub fn value<'a>(&self, feature: &'a Feature, name: &str) -> &'a FeatureAttribute {
        let value = self.position(name).and_then(|place| feature.attributes.get(place));
        value.unwrap_or(&FeatureAttribute::None)
    }

    /// Returns a feature's name: the attribute `name`, else the id.
    pub fn name(&self, feature: &Feature) -> Option<String> {
        match self.value(feature, "name") {
            FeatureAttribute::Text(text) => Some(text.clone()),
            number @ (FeatureAttribute::Integer(_) | FeatureAttribute::Number(_)) => Some(number.to_text()),
            _ => match &feature.id {
                Some(Value::String(text)) => Some(text.clone()),
                id => id.as_ref().map(Value::to_string),
            },
        }
    }

    /// Keeps the features of some layers that satisfy all conditions of a filter.
    ///
    /// ```
    /// use spinney::import::feature::FeatureOptions;
    /// use spinney::raw::import::feature::{PolygonLayer, parse_polygons};
    ///
    /// let ring = "[[[0, 0], [1, 0], [1, 1], [0, 0]]]";
    /// let feature = |kind: &str| {
    ///     let geometry = format!(r#"{{"type": "Polygon", "coordinates": {ring}}}"#);
    ///     format!(r#"{{"type": "Feature", "properties": {{"kind": "{kind}"}}, "geometry": {geometry}}}"#)
    /// };
    /// let text = format!(r#"{{"type": "FeatureCollection", "features": [{}, {}]}}"#, feature("wood"), feature("lake"));
    /// let mut layers = [parse_polygons(&text, &FeatureOptions::default())?];
    /// PolygonLayer::select(&mut layers, &"kind!=wood".parse()?)?;
    /// assert_eq!(layers[0].features.len(), 1);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If no layer has such an attribute, or no feature satisfies the conditions.
    pub fn select(layers: &mut [PolygonLayer], filter: &FeatureFilter) -> Result<()> {
        if filter.conditions.is_empty() {
            return Ok(());
        }
        let unknown = |name: &&str| layers.iter().all(|layer| layer.position(name).is_none());
        if let Some(name) = filter.names().find(unknown) {
            let names = layers.iter().flat_map(|layer| &layer.attributes).map(|(name, _)| name.as_str());
            let names: std::collections::BTreeSet<&str> = names.collect();
            let known: Vec<&str> = names.into_iter().take(MAX_REMEMBERED).collect();
            return Err(unknown_attribute(name, &known.join(", ")));
        }
        for layer in layers.iter_mut() {
            let indices: Vec<Option<usize>> = filter.names().map(|name| layer.position(name)).collect();
            layer
                .features
                .retain(|feature| filter.holds(|condition| feature.attributes.get(indices[condition]?)));
        }
        if layers.iter().all(|layer| layer.features.is_empty()) { Err(none_with(filter)) } else { Ok(()) }
    }

    /// Returns the coordinates of the vertices: those of [`PolygonLayer::crs`], or the tree's own
    /// if unknown.
    pub fn coordinates(&self) -> Coordinates {
        self.crs.clone().map_or(Coordinates::World, Coordinates::System)
    }

    /// Converts the polygons to cells of a tree with this extent; `None` for those outside.
    ///
    /// # Errors
    /// If a ring has too few vertices, or one that is not finite, with the feature's number; if
    /// there are polygons and all of them are outside of the tree.
    pub fn in_cells(&self, locator: &CellLocator, extent: [u64; 3]) -> Result<Vec<Option<Polygon>>> {
        let polygons = self.polygons(locator)?;
        if self.meets(&polygons, extent) {
            Ok(polygons)
        } else {
            Err(self.outside(&self.coordinates(), locator))
        }
    }

    /// Like [`PolygonLayer::in_cells`], for several trees, such as the layers of a file, each with
    /// its extent. Vertices are in `coordinates`, as in the locators. It is no error if polygons
    /// are outside of all trees.
    ///
    /// # Errors
    /// If a ring has too few vertices, or one that is not finite, with the feature's number.
    pub fn in_cells_of(
        &self,
        coordinates: &Coordinates,
        trees: &[(CellLocator, [u64; 3])],
    ) -> Result<FoundPolygons> {
        let all = trees.iter().map(|(locator, _)| self.polygons(locator)).collect::<Result<Vec<_>>>()?;
        let is_met = trees.iter().zip(&all).any(|((_, extent), polygons)| self.meets(polygons, *extent));
        let outside =
            trees.first().filter(|_| !is_met).map(|(locator, _)| self.outside(coordinates, locator));
        Ok(FoundPolygons { trees: all, outside })
    }

    fn polygons(&self, locator: &CellLocator) -> Result<Vec<Option<Polygon>>> {
        let numbered = |(number, feature): (u64, &Feature)| {
            in_cells(feature, locator).map_err(|error| match error {
                Error::Invalid { what, found, expected } => {
                    Error::invalid(format!("feature {number}: {what}"), found, expected)
                }
                other => other,
            })
        };
        (self.before + 1..).zip(&self.features).map(numbered).collect()
    }

    /// Returns whether some of the polygons meet a raster of this extent, or there are none.
    fn meets(&self, polygons: &[Option<Polygon>], extent: [u64; 3]) -> bool {
        let is_met = |polygon: &Polygon| {
            let [low, high] = polygon.corners();
            (0..2).all(|axis| high[axis] > 0.0 && low[axis] < extent[axis] as f64)
        };
        polygons.iter().flatten().any(is_met)
            || self
                .features
                .iter()
                .all(|feature| parts_of(feature).iter().flatten().flatten().next().is_none())
    }

    /// Error if all polygons are outside of a tree.
    fn outside(&self, coordinates: &Coordinates, locator: &CellLocator) -> Error {
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut swapped = false;
        for [x, y] in self.features.iter().map(parts_of).flat_map(|parts| parts.concat().concat()) {
            (least, most) = ([least[0].min(x), least[1].min(y)], [most[0].max(x), most[1].max(y)]);
            swapped = swapped || locator.cell([y, x, 0.0]).is_some_and(|cell| locator.is_inside(cell));
        }
        let system = match coordinates {
            Coordinates::World => "the tree's own system".into(),
            other => other.to_string(),
        };
        let found = format!("{} in {system}, all outside of the tree", corners_text(least, most));
        let advice = match swapped {
            true => "x and y of the vertices seem to be swapped",
            false => "name their coordinate system: --in (in Python: crs=), or a member \"crs\" of GeoJSON",
        };
        let expected =
            format!("polygons that touch the tree, which is {} there; {advice}", locator.bounds_text());
        Error::invalid("extent of the polygons", found, expected)
    }
}

/// Maximum number of known names in an error message.
const MAX_REMEMBERED: usize = 200;

fn none_with(filter: &FeatureFilter) -> Error {
    Error::invalid("features", format!("none with {filter}"), "a condition that some features meet")
}

/// Reads the polygons of a file in any format of [`open_features`](super::feature::open_features),
/// with the attribute `name` in addition to the requested ones. All of them must fit into the
/// memory limit.
///
/// # Errors
/// Those of [`PolygonReader`]; if they exceed the memory limit.
pub fn read_polygons(path: &Path, options: &FeatureOptions) -> Result<PolygonLayer> {
    let mut reader = PolygonReader::open(path, options)?;
    let layer = reader.next_layer()?.unwrap_or_else(|| reader.layer());
    match reader.held {
        None => Ok(layer),
        Some((_, needed)) => Err(Error::TooLarge {
            path: path.into(),
            what: format!("the first {} features", reader.count),
            needed: reader.needed + needed,
            limit: options.memory,
            advice: "allow more memory, or split the polygons into several files".into(),
        }),
    }
}

/// Reader of the polygons of a file in any format of
/// [`open_features`](super::feature::open_features), as many at a time as fit into memory. It reads
/// the attribute `name` in addition to the requested ones.
pub struct PolygonReader {
    reader: Box<dyn FeatureReader>,
    path: PathBuf,
    options: FeatureOptions,
    /// A feature that did not fit into the last batch, and its memory size.
    held: Option<(Feature, u64)>,
    /// Number of features read.
    count: u64,
    /// Memory size of the current batch, in bytes.
    needed: u64,
    /// Whether features other than polygons are accepted.
    takes_others: bool,
}

impl PolygonReader {
    /// Opens a file. A batch fits into the memory limit of the options, unless a single feature
    /// does not.
    ///
    /// # Errors
    /// Those of [`open_features`](super::feature::open_features).
    pub fn open(path: &Path, options: &FeatureOptions) -> Result<PolygonReader> {
        let reader = open_with(path, options, Some("name"))?;
        Ok(PolygonReader::of(reader, path, options))
    }

    /// Reads GeoJSON text, like [`PolygonReader::open`] reads a file.
    ///
    /// # Errors
    /// If it is not GeoJSON, or has no requested attribute.
    pub fn of_geojson(text: Vec<u8>, options: &FeatureOptions) -> Result<PolygonReader> {
        let path = Path::new("GeoJSON");
        let reader = open_geojson(text, path, options, Some("name"))?;
        Ok(PolygonReader::of(reader, path, options))
    }

    fn of(reader: Box<dyn FeatureReader>, path: &Path, options: &FeatureOptions) -> PolygonReader {
        let (path, options) = (path.into(), options.clone());
        PolygonReader { reader, path, options, held: None, count: 0, needed: 0, takes_others: false }
    }

    /// Returns the description of the layer.
    pub fn schema(&self) -> &FeatureSchema {
        self.reader.schema()
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Creates an empty batch. Of the features read, all but a held one were returned before.
    fn layer(&self) -> PolygonLayer {
        let FeatureSchema { crs, attributes, .. } = self.schema();
        let before = self.count - u64::from(self.held.is_some());
        PolygonLayer { crs: crs.clone(), attributes: attributes.clone(), features: Vec::new(), before }
    }

    /// Reads the next batch, of at least one feature; `None` after the last.
    ///
    /// # Errors
    /// Those of [`FeatureReader::next`]; if a feature is not a polygon and others are not accepted;
    /// if no feature satisfies the conditions.
    pub fn next_layer(&mut self) -> Result<Option<PolygonLayer>> {
        let mut layer = self.layer();
        self.needed = 0;
        if let Some((feature, needed)) = self.held.take() {
            layer.features.push(feature);
            self.needed = needed;
        }
        while let Some(feature) = self.reader.next()? {
            self.count += 1;
            self.check(&feature)?;
            let needed = bytes_of(&feature);
            if self.needed + needed > self.options.memory && !layer.features.is_empty() {
                self.held = Some((feature, needed));
                return Ok(Some(layer));
            }
            self.needed += needed;
            layer.features.push(feature);
        }
        match &self.options.filter {
            filter if self.count == 0 && !filter.conditions.is_empty() => Err(none_with(filter)),
            _ => Ok((!layer.features.is_empty()).then_some(layer)),
        }
    }

    /// Also accepts features other than polygons; they have no cells.
    pub(crate) fn with_others(mut self) -> PolygonReader {
        self.takes_others = true;
        self
    }

    /// Fails if a feature is not a polygon, and others are not accepted.
    fn check(&self, feature: &Feature) -> Result<()> {
        if self.takes_others {
            return Ok(());
        }
        let Some(geometry) = &feature.geometry else { return Ok(()) };
        kind_of_others(geometry).map_or(Ok(()), |kind| {
            let found = format!("feature {}, a geometry of type `{kind}`, as a zone", self.count);
            Err(Error::unsupported(&self.path, found, "zones are polygons: buffer it first"))
        })
    }
}

/// Reads the polygons of GeoJSON text, like [`read_polygons`] those of a file, but without a memory
/// limit.
///
/// # Errors
/// If it is not GeoJSON, or contains geometries other than polygons.
pub fn parse_polygons(text: &str, options: &FeatureOptions) -> Result<PolygonLayer> {
    let options = FeatureOptions { memory: u64::MAX, ..options.clone() };
    // A copy, since the reader needs an owned input.
    let reader = PolygonReader::of_geojson(text.as_bytes().to_vec(), &options);
    let layer = reader.and_then(|mut reader| Ok(reader.next_layer()?.unwrap_or_else(|| reader.layer())));
    layer.map_err(|error| match error {
        Error::Corrupt { location: place, found, expected, .. } => Error::invalid(place, found, expected),
        Error::Unsupported { found, advice, .. } => Error::invalid("GeoJSON", found, advice),
        other => other,
    })
}

/// Memory per vertex, as read, in cells, and as an edge; and per ring, value and feature, in bytes.
const BYTES_OF_CORNER: u64 = 128;
const BYTES_OF_RING: u64 = 128;
const BYTES_OF_VALUE: u64 = 32;
const BYTES_OF_FEATURE: u64 = 256;

/// Returns the memory size of a feature in bytes.
fn bytes_of(feature: &Feature) -> u64 {
    fn of_geometry(geometry: &FeatureGeometry) -> u64 {
        let of_line = |line: &Vec<[f64; 2]>| BYTES_OF_RING + line.len() as u64 * BYTES_OF_CORNER;
        match geometry {
            FeatureGeometry::Points(points) => points.len() as u64 * BYTES_OF_CORNER,
            FeatureGeometry::Lines(lines) => lines.iter().map(of_line).sum(),
            FeatureGeometry::Polygons(parts) => parts.iter().flatten().map(of_line).sum(),
            FeatureGeometry::Collection(members) => members.iter().map(of_geometry).sum(),
        }
    }
    let text_sizes = feature.attributes.iter().map(|value| match value {
        FeatureAttribute::Text(text) | FeatureAttribute::Json(text) => text.capacity() as u64,
        _ => 0,
    });
    BYTES_OF_FEATURE
        + feature.geometry.as_ref().map_or(0, of_geometry)
        + feature.attributes.len() as u64 * BYTES_OF_VALUE
        + text_sizes.sum::<u64>()
}

/// Appends the parts of polygons; fails for any other geometry.
fn add_polygons(geometry: &FeatureGeometry, parts: &mut PolygonParts) -> Result<(), ()> {
    match geometry {
        FeatureGeometry::Polygons(own) => parts.extend(own.iter().cloned()),
        FeatureGeometry::Collection(members) => {
            members.iter().try_for_each(|member| add_polygons(member, parts))?;
        }
        FeatureGeometry::Points(_) | FeatureGeometry::Lines(_) => return Err(()),
    }
    Ok(())
}

/// Returns the type name of a geometry that is not polygonal.
fn kind_of_others(geometry: &FeatureGeometry) -> Option<&'static str> {
    match geometry {
        FeatureGeometry::Polygons(_) => None,
        FeatureGeometry::Collection(members) => members.iter().find_map(kind_of_others),
        FeatureGeometry::Points(_) => Some("Point"),
        FeatureGeometry::Lines(_) => Some("LineString"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_crs::Frame;

    fn parse_polygons(text: &str) -> Result<PolygonLayer> {
        super::parse_polygons(text, &FeatureOptions::default())
    }

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
        assert_eq!((found.features.len(), parts_of(first).len(), found.name(first)), (1, 1, None));
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
        let names = found.iter().map(|feature| (layer.name(feature), parts_of(feature).len()));
        let seven = || Some("7".into());
        assert_eq!(names.collect::<Vec<_>>(), [(Some("A".into()), 2), (seven(), 1), (seven(), 0)]);
        assert_eq!(
            (layer.value(&found[0], "area"), &found[0].id),
            (&FeatureAttribute::Number(1.5), &Some(7.into()))
        );
        assert_eq!(parts_of(&found[0])[1].len(), 2);
        let frame = Frame::planar([2.0, 0.0, 100.0, 0.0, -2.0, 50.0]);
        let locator = CellLocator::new(&Coordinates::World, &frame, [10, 10, 1]).unwrap();
        let cells = in_cells(&found[1], &locator).unwrap().unwrap();
        assert_eq!(cells.corners(), [[-50.0, 23.0], [-48.0, 25.0]]);
        assert!(in_cells(&found[2], &locator).unwrap().is_none());
        for wrong in [
            "",
            "{}",
            "[1]",
            r#"{"type":"Point","coordinates":[1,2]}"#,
            r#"{"type":"Polygon"}"#,
            r#"{"type":"Polygon","coordinates":[[[1,2],[3]]]}"#,
            r#"{"type":"Polygon","coordinates":[[["a","b"]]]}"#,
            r#"{"type":"Polygon","coordinates":[],"crs":{"type":"link","properties":{"href":"x"}}}"#,
            r#"{"type":"Polygon","coordinates":[],"crs":{"type":"name","properties":{"name":"somewhere"}}}"#,
            r#"{"type":"FeatureCollection","features":[{"type":"Feature"}]}"#,
        ] {
            assert!(parse_polygons(wrong).is_err(), "{wrong}");
        }
        let flat = parse_polygons(r#"{"type":"Polygon","coordinates":[[[1,2],[3,4]]]}"#).unwrap_err();
        assert!(flat.to_string().contains("feature 1: got a ring of 2 vertices"), "{flat}");
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
    fn coordinates_beyond_degrees_are_refused_unless_a_system_is_given() {
        let far = format!(r#"{{"type":"Polygon","coordinates":[{}]}}"#, square(3e5));
        let error = parse_polygons(&far).unwrap_err().to_string();
        assert!(
            error.contains("300000,300000, which is not in degrees") && error.contains("--crs"),
            "{error}"
        );
        let any = FeatureOptions { check_degrees: false, ..FeatureOptions::default() };
        assert_eq!(super::parse_polygons(&far, &any).unwrap().features.len(), 1);
        assert_eq!(parse_polygons(&far.replacen('{', r#"{"crs":null,"#, 1)).unwrap().crs, None);
        // Across the antimeridian, and a pole with rounding errors.
        for text in ["[[179,80],[190,80],[190,90.0000000001]]", "[[-360,-90],[0,-90],[0,0]]"] {
            parse_polygons(&format!(r#"{{"type":"Polygon","coordinates":[{text}]}}"#)).unwrap();
        }
    }

    #[test]
    fn a_layer_outside_the_tree_is_an_error() {
        let frame = Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([1.0, 0.0, 40.0, 0.0, -1.0, 5.0]) };
        let extent = [10, 10, 1];
        let locator = CellLocator::new(&Coordinates::LONLAT, &frame, extent).unwrap();
        let layer = |text: &str| {
            parse_polygons(&format!(r#"{{"type":"Polygon","coordinates":[{text}]}}"#))
                .unwrap()
                .in_cells(&locator, extent)
        };
        let error = layer(&square(60.0)).unwrap_err().to_string();
        assert!(
            error.contains("60,60,64,64 in lonlat (EPSG:4326)")
                && error.contains("40,-5,50,5")
                && error.contains("crs"),
            "{error}"
        );
        let error = layer("[[0,41],[1,41],[1,42]]").unwrap_err().to_string();
        assert!(error.contains("swapped"), "{error}");
        assert!(layer("[[41,0],[42,0],[42,1]]").unwrap()[0].is_some());
    }
}
