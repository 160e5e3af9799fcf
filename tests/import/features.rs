//! Feature files: output of our own writers and GDAL's is read without changes.

use std::path::{Path, PathBuf};
use std::process::Command;

use spinney::export::VectorFormat;
use spinney::import::feature::FeatureOptions;
use spinney::raw::export::vector::{
    AttributeType, AttributeValue, Geometry, GeometryKind, VectorLayer, VectorWriter,
};
use spinney::raw::import::feature::{
    Feature, FeatureAttribute, FeatureGeometry, FeatureSchema, open_features, read_polygons,
};
use spinney::{Crs, Error, Output, Result};
use tempfile::TempDir;

fn read_with(path: &Path, options: &FeatureOptions) -> Result<(FeatureSchema, Vec<Feature>)> {
    let mut reader = open_features(path, options)?;
    let mut features = Vec::new();
    while let Some(feature) = reader.next()? {
        features.push(feature);
    }
    Ok((reader.schema().clone(), features))
}

fn read(path: &Path) -> (FeatureSchema, Vec<Feature>) {
    read_with(path, &FeatureOptions::default()).unwrap()
}

fn written(directory: &TempDir, name: &str, text: &str) -> PathBuf {
    let path = directory.path().join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// Returns a ring counterclockwise from its minimum vertex on, without the closing vertex.
fn plain_ring(ring: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut ring = ring.to_vec();
    if ring.first() == ring.last() {
        ring.pop();
    }
    let area: f64 = (0..ring.len())
        .map(|i| (ring[i], ring[(i + 1) % ring.len()]))
        .map(|(a, b)| a[0] * b[1] - b[0] * a[1])
        .sum();
    if area < 0.0 {
        ring.reverse();
    }
    let least = (0..ring.len()).min_by(|a, b| ring[*a].partial_cmp(&ring[*b]).unwrap()).unwrap_or(0);
    ring.rotate_left(least);
    ring
}

/// Returns a geometry independent of its rings' vertex order.
fn plain(geometry: &Option<FeatureGeometry>) -> Option<FeatureGeometry> {
    geometry.clone().map(|geometry| match geometry {
        FeatureGeometry::Polygons(parts) => FeatureGeometry::Polygons(
            parts.iter().map(|part| part.iter().map(|ring| plain_ring(ring)).collect()).collect(),
        ),
        other => other,
    })
}

fn square(x: f64, y: f64, size: f64) -> Vec<[f64; 2]> {
    vec![[x, y], [x + size, y], [x + size, y + size], [x, y + size], [x, y]]
}

/// A geometry of any number of parts.
struct MultiLine(Vec<Vec<[f64; 3]>>);

impl Geometry for MultiLine {
    fn parts(&self) -> usize {
        self.0.len()
    }

    fn count(&self, part: usize) -> u64 {
        self.0[part].len() as u64
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        each(&self.0[part])
    }
}

#[test]
fn files_of_all_our_writers_are_read() {
    let directory = tempfile::tempdir().unwrap();
    let [outer, hole] = [square(500_000.0, 5_200_000.0, 100.5), square(500_010.0, 5_200_010.0, 7.25)];
    let line: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i), f64::from(i * i) / 8.0]).collect();
    let of = |kind: GeometryKind| match kind {
        GeometryKind::Polygon => {
            vec![vec![outer.clone(), hole.clone()], vec![square(500_200.0, 5_200_000.0, 3.0)]]
        }
        GeometryKind::Line => vec![vec![line.clone()], vec![line[3..9].to_vec()]],
        GeometryKind::Point => vec![vec![vec![[1.5, 2.0]]], vec![vec![[-3.0, 4.0]]]],
    };
    let rows = [
        (AttributeValue::Number(0.1), AttributeValue::Text("Zürich, \"東京\"")),
        (AttributeValue::None, AttributeValue::None),
    ];
    for ending in ["geojson", "csv", "gpkg", "fgb", "shp"] {
        for kind in [GeometryKind::Polygon, GeometryKind::Line, GeometryKind::Point] {
            for has_z in [false, true] {
                if ending == "shp" && kind == GeometryKind::Point {
                    continue;
                }
                let path = directory.path().join(format!("{kind:?}{has_z}.{ending}"));
                let layer = VectorLayer {
                    name: "things".into(),
                    kind: Some(kind),
                    is_multi: false,
                    has_z,
                    attributes: vec![
                        ("size".into(), AttributeType::Number),
                        ("name".into(), AttributeType::Text),
                    ],
                    crs: Some(Crs::epsg(25832)),
                    bounds: [[0.0, 0.0], [1e6, 1e7]],
                };
                let format: VectorFormat = ending.parse().unwrap();
                let mut writer = VectorWriter::create(Output::create(&path).unwrap(), format, layer).unwrap();
                for (parts, (size, name)) in of(kind).iter().zip(rows) {
                    let lift =
                        |part: &Vec<[f64; 2]>| part.iter().map(|[x, y]| [*x, *y, 7.0]).collect::<Vec<_>>();
                    let parts: Vec<Vec<[f64; 3]>> = parts.iter().map(lift).collect();
                    writer.write(&MultiLine(parts), &[size, name]).unwrap();
                }
                writer.finish(&()).unwrap();
                let (schema, mut features) = read(&path);
                // A spatial index reorders features.
                features.sort_by_key(|feature| feature.attributes[0] == FeatureAttribute::None);
                let case = format!("{ending} {kind:?} {has_z}");
                let kinds = [("size".into(), AttributeType::Number), ("name".into(), AttributeType::Text)];
                assert_eq!(schema.attributes, kinds, "{case}");
                match ending {
                    // CSV stores none.
                    "csv" => assert_eq!(schema.crs, None),
                    "shp" => assert!(schema.crs.unwrap().to_wkt2().unwrap().contains("UTM"), "{case}"),
                    _ => assert_eq!(schema.crs, Some(Crs::epsg(25832)), "{case}"),
                }
                assert_eq!(features.len(), 2, "{case}");
                for (feature, parts) in features.iter().zip(of(kind)) {
                    let expected = match kind {
                        GeometryKind::Polygon => FeatureGeometry::Polygons(vec![parts]),
                        GeometryKind::Line => FeatureGeometry::Lines(parts),
                        GeometryKind::Point => FeatureGeometry::Points(parts.concat()),
                    };
                    assert_eq!(plain(&feature.geometry), plain(&Some(expected)), "{case}");
                }
                assert_eq!(features[0].attributes[0], FeatureAttribute::Number(0.1), "{case}");
                assert_eq!(
                    features[0].attributes[1],
                    FeatureAttribute::Text("Zürich, \"東京\"".into()),
                    "{case}"
                );
                assert_eq!(
                    features[1].attributes,
                    [FeatureAttribute::None, FeatureAttribute::None],
                    "{case}"
                );
            }
        }
    }
}

/// Runs GDAL's converter; `None` if it is not installed.
fn ogr2ogr(arguments: &[&str]) -> Option<()> {
    let run = Command::new("ogr2ogr").args(arguments).output();
    let Ok(run) = run else {
        eprintln!("skipped: no ogr2ogr");
        return None;
    };
    assert!(run.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&run.stderr));
    Some(())
}

/// Features of one kind with attributes of all types, null values, and no geometry.
fn source(kind: GeometryKind, crs: &str) -> String {
    let rings = "[[[9,47],[10,47],[10,48],[9,48],[9,47]],[[9.25,47.25],[9.25,47.5],[9.5,47.5],[9.25,47.25]]]";
    let other = "[[[11,47],[12,47],[11.5,48.125],[11,47]]]";
    let geometries = match kind {
        GeometryKind::Polygon => [
            format!(r#"{{"type":"Polygon","coordinates":{rings}}}"#),
            format!(r#"{{"type":"MultiPolygon","coordinates":[{rings},{other}]}}"#),
        ],
        GeometryKind::Line => [
            r#"{"type":"LineString","coordinates":[[9,47],[10,47.5],[10,48]]}"#.into(),
            r#"{"type":"MultiLineString","coordinates":[[[9,47],[10,47.5]],[[1,2],[3,4],[5,6]]]}"#.into(),
        ],
        GeometryKind::Point => [
            r#"{"type":"Point","coordinates":[9.125,47]}"#.into(),
            r#"{"type":"Point","coordinates":[-9.125,-47]}"#.into(),
        ],
    };
    let [first, second] = geometries;
    let full = r#""n":1,"big":9007199254740993,"share":0.25,"name":"Zürich","flag":true,"day":"2024-02-29","list":{"a":[1,2]}"#;
    let bare = r#""n":2,"big":null,"share":null,"name":null,"flag":null,"day":null,"list":null"#;
    let last =
        r#""n":3,"big":-5,"share":1234.5,"name":"a, \"b\"","flag":false,"day":"1999-12-31","list":{"a":[]}"#;
    let feature = |id: u32, properties: &str, geometry: &str| {
        format!(r#"{{"type":"Feature","id":{id},"properties":{{{properties}}},"geometry":{geometry}}}"#)
    };
    let features =
        [feature(11, full, &first), feature(12, bare, &second), feature(13, last, "null")].join(",\n");
    format!(r#"{{"type":"FeatureCollection","name":"things",{crs}"features":[{features}]}}"#)
}

/// Returns a value as all formats can represent it.
fn common(value: &FeatureAttribute) -> FeatureAttribute {
    match value {
        FeatureAttribute::Boolean(is) => FeatureAttribute::Integer((*is).into()),
        FeatureAttribute::Text(text) if text.ends_with("T00:00:00") => {
            FeatureAttribute::Text(text[..10].into())
        }
        FeatureAttribute::Text(text) if text.get(4..5) == Some("/") => {
            FeatureAttribute::Text(text.replace('/', "-"))
        }
        FeatureAttribute::Json(text) => FeatureAttribute::Text(text.replace(' ', "")),
        FeatureAttribute::Text(text) if text.starts_with('{') => {
            FeatureAttribute::Text(text.replace(' ', ""))
        }
        other => other.clone(),
    }
}

#[test]
fn files_of_gdal_are_read_alike() {
    let directory = tempfile::tempdir().unwrap();
    let plane = r#""crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::25832"}},"#;
    for kind in [GeometryKind::Polygon, GeometryKind::Line, GeometryKind::Point] {
        let own = written(&directory, &format!("{kind:?}.json"), &source(kind, plane));
        let degrees = written(&directory, &format!("{kind:?}degrees.json"), &source(kind, ""));
        let (schema, expected) = read(&own);
        assert_eq!((schema.name.as_str(), schema.count, schema.kind), ("things", Some(3), Some(kind)));
        assert_eq!(schema.crs, Some(Crs::epsg(25832)));
        assert_eq!(expected[0].attributes[1], FeatureAttribute::Integer(9_007_199_254_740_993));
        assert_eq!((&expected[2].geometry, &expected[2].id), (&None, &Some(13.into())));
        assert_eq!(expected[1].attributes[1..], vec![FeatureAttribute::None; 6]);
        let has_ids = |name: &str| name.starts_with("GeoJSON") || name == "GPKG";
        for (number, (driver, ending, more)) in [
            ("GeoJSON", "geojson", &[][..]),
            ("GeoJSONSeq", "geojsonl", &[]),
            ("GeoJSONSeq", "geojsons", &["-lco", "RS=YES"]),
            ("GPKG", "gpkg", &["-preserve_fid"]),
            ("FlatGeobuf", "fgb", &["-lco", "SPATIAL_INDEX=NO"]),
            ("FlatGeobuf", "fgb", &[]),
            ("ESRI Shapefile", "shp", &["-lco", "ENCODING=UTF-8"]),
            ("ESRI Shapefile", "shp", &["-lco", "ENCODING=ISO-8859-1"]),
            ("ESRI Shapefile", "shp", &["-lco", "ENCODING=CP1252"]),
            ("CSV", "csv", &["-lco", "GEOMETRY=AS_WKT"]),
            ("CSV", "csv", &["-lco", "GEOMETRY=AS_WKT", "-lco", "SEPARATOR=SEMICOLON"]),
            ("CSV", "csv", &["-lco", "GEOMETRY=AS_XY"]),
        ]
        .into_iter()
        .enumerate()
        {
            let case = format!("{driver} {more:?} {kind:?}");
            if more.contains(&"GEOMETRY=AS_XY") && kind != GeometryKind::Point {
                continue;
            }
            let path = directory.path().join(format!("{kind:?}{number}.{ending}"));
            let from = if driver == "GeoJSONSeq" { &degrees } else { &own };
            let words = ["-f", driver, path.to_str().unwrap(), from.to_str().unwrap()];
            if ogr2ogr(&[&words[..], more].concat()).is_none() {
                return;
            }
            let (schema, mut features) = read(&path);
            let index_of = |name: &str| schema.position(name).unwrap_or_else(|| panic!("{case}: no {name}"));
            features.sort_by_key(|feature| format!("{:?}", feature.attributes[index_of("n")]));
            // GDAL omits features without a geometry from FlatGeobuf.
            let count = if driver == "FlatGeobuf" { 2 } else { 3 };
            assert_eq!(features.len(), count, "{case}");
            match (driver, &schema.crs) {
                ("GeoJSONSeq", crs) => assert_eq!(*crs, Some(Crs::epsg(4326)), "{case}"),
                ("CSV", crs) => assert_eq!(*crs, None, "{case}"),
                ("ESRI Shapefile", crs) => {
                    assert!(crs.as_ref().unwrap().to_wkt2().unwrap().contains("UTM"), "{case}");
                }
                (_, crs) => assert_eq!(*crs, Some(Crs::epsg(25832)), "{case}"),
            }
            for (feature, wanted) in features.iter().zip(&expected) {
                assert_eq!(plain(&feature.geometry), plain(&wanted.geometry), "{case}");
                if has_ids(driver) {
                    assert_eq!(feature.id, wanted.id, "{case}");
                }
                for (index, (name, _)) in self::schema_of(&own).attributes.iter().enumerate() {
                    let (found, wanted) = (&feature.attributes[index_of(name)], &wanted.attributes[index]);
                    assert_eq!(common(found), common(wanted), "{case}: {name}");
                }
            }
            // Zones do not depend on the format.
            if kind == GeometryKind::Polygon && count == 3 {
                let layer = read_polygons(&path, &FeatureOptions::default()).unwrap();
                let parts = |feature: &Feature| match &feature.geometry {
                    Some(FeatureGeometry::Polygons(parts)) => parts.len(),
                    Some(other) => panic!("{other:?}"),
                    None => 0,
                };
                let parts: Vec<usize> = layer.features.iter().map(parts).collect();
                assert_eq!(parts, [1, 2, 0], "{case}");
            }
        }
    }
}

fn schema_of(path: &Path) -> FeatureSchema {
    open_features(path, &FeatureOptions::default()).unwrap().schema().clone()
}

#[test]
fn layers_of_geopackages_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let [first, second] = [GeometryKind::Point, GeometryKind::Line]
        .map(|kind| written(&directory, &format!("{kind:?}.json"), &source(kind, "")));
    let path = directory.path().join("both.gpkg");
    let gpkg = path.to_str().unwrap();
    for (from, name) in [(first, "springs"), (second, "brooks: small")] {
        let words = ["-f", "GPKG", "-update", "-append", gpkg, from.to_str().unwrap(), "-nln", name];
        let words = if path.exists() { &words[..] } else { &[&words[..2], &words[4..]].concat() };
        if ogr2ogr(words).is_none() {
            return;
        }
    }
    let message = read_with(&path, &FeatureOptions::default()).unwrap_err().to_string();
    assert!(message.contains("springs") && message.contains("brooks: small"), "{message}");
    assert_eq!(read(Path::new(&format!("{gpkg}:springs"))).0.kind, Some(GeometryKind::Point));
    assert_eq!(read(Path::new(&format!("{gpkg}:brooks: small"))).0.kind, None);
    let named = FeatureOptions { layer: Some("springs".into()), ..FeatureOptions::default() };
    assert_eq!(read_with(&path, &named).unwrap().1.len(), 3);
    let message = read_with(Path::new(&format!("{gpkg}:nothing")), &named).unwrap_err().to_string();
    assert!(message.contains("nothing") && message.contains("springs"), "{message}");
}

#[test]
fn documents_of_all_kinds_are_features() {
    let directory = tempfile::tempdir().unwrap();
    let feature = |code: &str| {
        format!(
            r#"{{"geometry":{{"coordinates":[1,2,9],"type":"Point"}},"properties":{{"code":{code}}},"type":"Feature"}}"#
        )
    };
    let [one, two] = ["1", "2.5"].map(feature);
    let mixed = AttributeType::Number;
    for (text, count, kind) in [
        (one.clone(), 1, AttributeType::Integer),
        (format!("{one}\n{two}\n"), 2, mixed),
        (format!("\u{1e}{one}\n\u{1e}{two}\n"), 2, mixed),
        (format!("{one}{two}"), 2, mixed),
        (format!(r#"{{"features":[{one},{two}],"type":"FeatureCollection"}}"#), 2, mixed),
        (
            format!(
                "{{\"type\":\"FeatureCollection\",\"x\":{{\"features\":[1]}},\r\n\"features\" : [ {one}\n,\t{two} ] }}"
            ),
            2,
            mixed,
        ),
    ] {
        let (schema, features) = read(&written(&directory, "a.geojson", &text));
        assert_eq!((features.len(), schema.count), (count, Some(count as u64)), "{text}");
        assert_eq!(schema.attributes, [("code".into(), kind)], "{text}");
        assert_eq!(features[0].geometry, Some(FeatureGeometry::Points(vec![[1.0, 2.0]])));
    }
    let collection = r#"{"type":"GeometryCollection","geometries":[{"type":"Point","coordinates":[1,2]},{"type":"GeometryCollection","geometries":[{"type":"LineString","coordinates":[[1,2],[3,4]]}]}]}"#;
    let (_, features) = read(&written(&directory, "a.geojson", collection));
    assert_eq!(features.len(), 2);
    let lines = FeatureGeometry::Lines(vec![vec![[1.0, 2.0], [3.0, 4.0]]]);
    assert_eq!(features[1].geometry, Some(FeatureGeometry::Collection(vec![lines])));
    // Attributes that some features lack, and their types.
    let with =
        |properties: &str| format!(r#"{{"type":"Feature","properties":{properties},"geometry":null}}"#);
    let text = [r#"{"a":1,"b":"x"}"#, "null", r#"{"b":2,"c":[1, {"d":2}],"e":18446744073709551615}"#]
        .map(with)
        .join("\n");
    let (schema, features) = read(&written(&directory, "a.geojson", &text));
    let kinds: Vec<_> = schema.attributes.iter().map(|(name, kind)| (name.as_str(), *kind)).collect();
    let json = AttributeType::Json;
    assert_eq!(kinds, [("a", AttributeType::Integer), ("b", AttributeType::Mixed), ("c", json), ("e", json)]);
    assert_eq!(features[1].attributes, vec![FeatureAttribute::None; 4]);
    assert_eq!(features[2].attributes[2].to_json(), serde_json::json!([1, {"d": 2}]));
    assert_eq!(features[2].attributes[3].to_json(), serde_json::json!(u64::MAX));
}

#[test]
fn tables_have_geometries_in_many_ways() {
    let directory = tempfile::tempdir().unwrap();
    let point = |x: f64, y: f64| Some(FeatureGeometry::Points(vec![[x, y]]));
    let text =
        "code;The_Geom;\"note\"\r\n007;POINT(1 2);\"a;\r\n\"\"b\"\"\"\r\n\r\n08;;\r\n9;\"SRID=0;x\"\r\n";
    let message =
        read_with(&written(&directory, "a.csv", text), &FeatureOptions::default()).unwrap_err().to_string();
    assert!(message.contains("feature 3") && message.contains("coordinate system"), "{message}");
    let (schema, features) = read(&written(&directory, "a.csv", &text[..text.find("9;").unwrap()]));
    assert_eq!(
        schema.attributes,
        [("code".into(), AttributeType::Text), ("note".into(), AttributeType::Text)]
    );
    assert_eq!(
        features[0].attributes,
        ["007", "a;\r\n\"b\""].map(|text| FeatureAttribute::Text(text.into()))
    );
    assert_eq!((&features[0].geometry, &features[1].geometry), (&point(1.0, 2.0), &None));
    assert_eq!(features[1].attributes[1], FeatureAttribute::None);
    // Points whose coordinates are in two columns, recognized as degrees by their names.
    let (schema, features) = read(&written(&directory, "b.csv", "id,Lon,Lat\n1,9.5,47\n2,,\n3,-1e1,0"));
    assert_eq!(
        (schema.crs, schema.kind, schema.count),
        (Some(Crs::epsg(4326)), Some(GeometryKind::Point), Some(3))
    );
    let geometries: Vec<_> = features.iter().map(|feature| feature.geometry.clone()).collect();
    assert_eq!(geometries, [point(9.5, 47.0), None, point(-10.0, 0.0)]);
    assert_eq!(
        features[2].attributes,
        [FeatureAttribute::Integer(3), FeatureAttribute::Number(-10.0), FeatureAttribute::Integer(0)]
    );
    let (schema, features) = read(&written(&directory, "c.tsv", "x\ty\tv\n1\t2\t0.5\n"));
    assert_eq!((schema.crs, &features[0].geometry), (None, &point(1.0, 2.0)));
    // Hexadecimal WKB with a coordinate system; and a sidecar file with one.
    let (schema, features) =
        read(&written(&directory, "d.csv", "wkb\n0101000020E8640000000000000000F03F0000000000000040\n"));
    assert_eq!((schema.crs, &features[0].geometry), (Some(Crs::epsg(25832)), &point(1.0, 2.0)));
    written(&directory, "b.prj", "EPSG:2056");
    let path = written(&directory, "b.csv", "x,y\n1,2\n");
    assert_eq!(read(&path).0.crs, Some(Crs::epsg(2056)));
    let message = read_with(&written(&directory, "e.csv", "a,b\n1,2\n"), &FeatureOptions::default())
        .unwrap_err()
        .to_string();
    assert!(message.contains("the columns a, b") && message.contains("the_geom"), "{message}");
}

#[test]
fn features_and_attributes_are_chosen() {
    let directory = tempfile::tempdir().unwrap();
    let path = written(&directory, "a.csv", "x,y,code,kind\n1,2,3,wood\n3,4,10,lake\n5,6,,wood\n");
    let chosen = |filter: &str, attributes: Option<&[&str]>| {
        let attributes = attributes.map(|names| names.iter().map(ToString::to_string).collect());
        let filter = if filter.is_empty() { Default::default() } else { filter.parse().unwrap() };
        read_with(&path, &FeatureOptions { filter, attributes, ..FeatureOptions::default() })
    };
    let count = |filter: &str| chosen(filter, None).unwrap().1.len();
    assert_eq!((count("code>=3"), count("code>3,kind=lake"), count("code!=3"), count("code=")), (2, 1, 2, 1));
    assert_eq!((count("kind<m"), count("x<=3"), count("kind=nothing")), (1, 2, 0));
    let (schema, features) = chosen("kind=wood", Some(&["code", "x"])).unwrap();
    assert_eq!(schema.attributes.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["code", "x"]);
    assert_eq!(features[0].attributes, [FeatureAttribute::Integer(3), FeatureAttribute::Integer(1)]);
    assert_eq!(features[1].attributes, [FeatureAttribute::None, FeatureAttribute::Integer(5)]);
    assert!(chosen("", Some(&[])).unwrap().1[0].attributes.is_empty());
    for (filter, attributes) in [("height>3", None), ("", Some(&["height"][..]))] {
        let message = chosen(filter, attributes).unwrap_err().to_string();
        assert!(
            message.contains("height, which no feature has") && message.contains("code, kind, x, y"),
            "{message}"
        );
    }
}

#[test]
fn unusable_features_are_reported_with_their_numbers() {
    let directory = tempfile::tempdir().unwrap();
    let feature = |geometry: &str| format!(r#"{{"type":"Feature","properties":{{}},"geometry":{geometry}}}"#);
    let good = feature(r#"{"type":"Point","coordinates":[1,2]}"#);
    for (geometry, expected) in [
        (r#"{"type":"Polygon","coordinates":[[[0,0],[1,1]]]}"#, "a ring of 2 vertices"),
        (r#"{"type":"LineString","coordinates":[[0,0]]}"#, "a line of one point"),
        (r#"{"type":"Point","coordinates":[1,"x"]}"#, "invalid type"),
        (r#"{"type":"Point","coordinates":[1e999,0]}"#, "out of range"),
        (r#"{"type":"Circle","coordinates":[1,0]}"#, "`Circle`"),
        (r#"{"type":"Point"}"#, "without coordinates"),
        ("7", "expected"),
    ] {
        let text = format!("{good}\n{}\n", feature(geometry));
        let error =
            read_with(&written(&directory, "a.geojson", &text), &FeatureOptions::default()).unwrap_err();
        let said = error.to_string();
        assert!(
            said.contains("feature 2") && said.contains(expected) && said.contains("a.geojson"),
            "{said}"
        );
    }
    let rows = "wkt\nPOINT (1 2)\n\"POLYGON ((0 0,1 1))\"\n";
    let error = read_with(&written(&directory, "a.csv", rows), &FeatureOptions::default()).unwrap_err();
    assert!(error.to_string().contains("feature 2: found a ring of 2 vertices"), "{error}");
    // Points and lines are not zones.
    let path = written(&directory, "a.geojson", &good);
    let expected = read_polygons(&path, &FeatureOptions::default()).unwrap_err().to_string();
    assert!(
        expected.contains("feature 1, a geometry of type `Point`") && expected.contains("zones are polygons"),
        "{expected}"
    );
    // Formats that no feature reader supports.
    let expected = read_with(&written(&directory, "a.kml", "<kml>"), &FeatureOptions::default())
        .unwrap_err()
        .to_string();
    assert!(expected.contains("a.kml"), "{expected}");
}

#[test]
fn memory_is_bounded_by_feature() {
    let directory = tempfile::tempdir().unwrap();
    let ring: Vec<String> = (0..20_000).map(|i| format!("{},{}", i, i * i % 1009)).collect();
    let of =
        |separator: &str, ring: &[String]| ring.iter().map(|c| c.replace(',', separator)).collect::<Vec<_>>();
    let line =
        |count: usize| of(",", &ring[..count]).iter().map(|c| format!("[{c}]")).collect::<Vec<_>>().join(",");
    let feature = |count: usize| {
        let line = line(count);
        format!(
            r#"{{"type":"Feature","crs":null,"properties":{{"n":1}},"geometry":{{"type":"LineString","coordinates":[{line}]}}}}"#
        )
    };
    let json =
        written(&directory, "a.geojson", &format!("{}\n{}\n{}", feature(9), feature(10), feature(20_000)));
    let row = |count: usize| format!("1,\"LINESTRING ({})\"\n", of(" ", &ring[..count]).join(","));
    let table = written(&directory, "a.csv", &format!("n,wkt\n{}{}{}", row(9), row(10), row(20_000)));
    let mut paths = vec![json.clone(), table];
    for (driver, ending) in [("GPKG", "gpkg"), ("FlatGeobuf", "fgb"), ("ESRI Shapefile", "shp")] {
        let path = directory.path().join(format!("b.{ending}"));
        let words = ["-f", driver, path.to_str().unwrap(), json.to_str().unwrap()];
        let plain = ["-lco", "SPATIAL_INDEX=NO"];
        if ogr2ogr(&[&words[..], &plain].concat()).is_some() {
            paths.push(path);
        }
    }
    for path in paths {
        let read = |memory: u64| read_with(&path, &FeatureOptions { memory, ..FeatureOptions::default() });
        assert_eq!(read(64 << 20).unwrap().1.len(), 3, "{}", path.display());
        match read(270_000) {
            Err(Error::TooLarge { what, .. }) => assert_eq!(what, "feature 3", "{}", path.display()),
            other => panic!("{}: {other:?}", path.display()),
        }
    }
    let squares: Vec<String> = (0..100).map(|i| format!("{i},\"POLYGON ((0 0,1 0,1 1))\"\n")).collect();
    let path = written(&directory, "c.csv", &format!("n,wkt\n{}", squares.concat()));
    let zones = |memory: u64| read_polygons(&path, &FeatureOptions { memory, ..FeatureOptions::default() });
    assert_eq!(zones(1 << 20).unwrap().features.len(), 100);
    assert!(matches!(zones(20_000), Err(Error::TooLarge { .. })));
}
