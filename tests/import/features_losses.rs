//! Losses of feature formats are reported, and nothing else is lost.

use std::path::Path;
use std::sync::Mutex;

use spinney::export::VectorFormat;
use spinney::import::feature::FeatureOptions;
use spinney::raw::export::vector::{
    AttributeType, AttributeValue, Geometry, GeometryKind, VectorFeature, VectorLayer, VectorWriter,
};
use spinney::raw::import::feature::{FeatureAttribute, open_features};
use spinney::{Output, Progress};

/// Progress that collects warnings.
#[derive(Default)]
struct Warnings(Mutex<Vec<String>>);

impl Progress for Warnings {
    fn warn(&self, file: &Path, text: &str) {
        assert!(file.exists(), "{text}");
        self.0.lock().unwrap().push(text.into());
    }
}

/// Writes features of squares (or none) with attributes. Returns the warnings.
fn written(
    path: &Path,
    attributes: &[(&str, AttributeType)],
    features: &[(Option<i64>, bool, &[AttributeValue<'_>])],
) -> Vec<String> {
    let layer = VectorLayer {
        name: "things".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: false,
        has_z: false,
        attributes: attributes.iter().map(|(name, kind)| ((*name).into(), *kind)).collect(),
        crs: None,
        bounds: [[0.0, 0.0], [1.0, 1.0]],
    };
    let format = VectorFormat::of(path).unwrap();
    let mut writer = VectorWriter::create(Output::create(path).unwrap(), format, layer).unwrap();
    let ring = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]].map(|[x, y]| [x, y, 0.0]).to_vec();
    let square = [ring];
    for (id, has_geometry, attributes) in features {
        let id = id.map(serde_json::Value::from);
        let geometry = has_geometry.then_some((GeometryKind::Polygon, &square as &dyn Geometry));
        writer.write_feature(&VectorFeature { id: id.as_ref(), geometry, attributes }).unwrap();
    }
    let warnings = Warnings::default();
    writer.finish(&warnings).unwrap();
    warnings.0.into_inner().unwrap()
}

/// Returns the attribute names, and all features' attributes.
fn read(path: &Path) -> (Vec<String>, Vec<Vec<FeatureAttribute>>) {
    let mut reader = open_features(path, &FeatureOptions::default()).unwrap();
    let mut features = Vec::new();
    while let Some(feature) = reader.next().unwrap() {
        features.push(feature.attributes);
    }
    (reader.schema().attributes.iter().map(|(name, _)| name.clone()).collect(), features)
}

#[test]
fn truncation_in_shapefiles_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.shp");
    let attributes = [
        ("population_total", AttributeType::Text),
        ("population_density", AttributeType::Text),
        ("Name", AttributeType::Text),
        ("name", AttributeType::Text),
    ];
    let long = "é".repeat(200);
    let rows = [
        [AttributeValue::Text(&long), AttributeValue::Text("b"), AttributeValue::None, AttributeValue::None],
        [
            AttributeValue::Text("a"),
            AttributeValue::Text(&long),
            AttributeValue::Text(""),
            AttributeValue::Text("d "),
        ],
    ];
    let warnings = written(&path, &attributes, &[(None, true, &rows[0]), (Some(2), false, &rows[1])]);
    assert_eq!(
        warnings,
        [
            "attributes are renamed: `population_total` is `population`, `population_density` is `populati_2`, `name` is `name_2`",
            "dropped ids, since the format has none: 1",
            "strings truncated to 254 bytes: 2",
            "empty strings or trailing blanks that the format cannot distinguish: 2",
        ]
    );
    let (names, features) = read(&path);
    assert_eq!(names, ["population", "populati_2", "Name", "name_2"]);
    assert_eq!(features[0][0], FeatureAttribute::Text("é".repeat(127)));
}

/// Numbers, booleans and dates are preserved in all formats, without warnings.
#[test]
fn numbers_are_not_lost() {
    let directory = tempfile::tempdir().unwrap();
    let attributes = [
        ("whole", AttributeType::Integer),
        ("number", AttributeType::Number),
        ("truth", AttributeType::Boolean),
        ("day", AttributeType::Text),
    ];
    let numbers = [
        -1.234_567_890_123_456_7e-300,
        f64::MAX,
        f64::MIN_POSITIVE,
        5e-324,
        0.1 + 0.2,
        -1.0 / 3.0,
        123_456_789_012.345_67,
        -98_765_432_109_876_540_000.0,
    ];
    let wholes = [i64::MIN, i64::MAX, (1 << 53) + 1, -1, 0, 7, -(1 << 60) - 1, 999_999_999_999_999_999];
    let rows: Vec<[AttributeValue<'_>; 4]> = numbers
        .iter()
        .zip(wholes)
        .map(|(number, whole)| {
            let truth = match whole % 3 {
                0 => AttributeValue::None,
                rest => AttributeValue::Boolean(rest == 1),
            };
            [
                AttributeValue::Integer(whole),
                AttributeValue::Number(*number),
                truth,
                AttributeValue::Text("2026-02-28"),
            ]
        })
        .collect();
    let features: Vec<_> = rows.iter().map(|row| (None, true, &row[..])).collect();
    for ending in ["geojson", "csv", "gpkg", "fgb", "shp"] {
        let path = directory.path().join(format!("a.{ending}"));
        assert_eq!(written(&path, &attributes, &features), Vec::<String>::new(), "{ending}");
        let (_, mut found) = read(&path);
        let key = |row: &Vec<FeatureAttribute>| match row[0] {
            FeatureAttribute::Integer(number) => number,
            _ => panic!("{ending}: {row:?}"),
        };
        found.sort_by_key(key);
        let mut wanted: Vec<Vec<FeatureAttribute>> = rows
            .iter()
            .map(|row| {
                row.iter()
                    .map(|value| match value {
                        AttributeValue::Integer(number) => FeatureAttribute::Integer(*number),
                        AttributeValue::Number(number) => FeatureAttribute::Number(*number),
                        // CSV stores these as strings.
                        AttributeValue::Boolean(is) if ending == "csv" => {
                            FeatureAttribute::Text(is.to_string())
                        }
                        AttributeValue::Boolean(is) => FeatureAttribute::Boolean(*is),
                        AttributeValue::Text(text) => FeatureAttribute::Text((*text).into()),
                        _ => FeatureAttribute::None,
                    })
                    .collect()
            })
            .collect();
        wanted.sort_by_key(key);
        assert_eq!(found, wanted, "{ending}");
    }
}

#[test]
fn losses_of_other_formats_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let attributes =
        [("fid", AttributeType::Number), ("a b", AttributeType::Text), ("a_b", AttributeType::Integer)];
    let row = [
        AttributeValue::Integer((1 << 53) + 1),
        AttributeValue::Text("x\ny"),
        AttributeValue::Integer(i64::MAX),
    ];
    let infinite = [AttributeValue::Number(f64::INFINITY), AttributeValue::None, AttributeValue::None];
    let warnings = |ending: &str| {
        let path = directory.path().join(format!("a.{ending}"));
        let warnings = written(&path, &attributes, &[(None, true, &row), (None, false, &infinite)]);
        warnings.join("; ")
    };
    let infinite = "dropped infinite numbers: 1";
    let rounded = |count: u64| format!("rounded integers beyond 2^53: {count}");
    let control = "strings with control characters replaced by blanks: 1";
    let other = "attributes are renamed: ";
    assert_eq!(warnings("geojson"), infinite);
    assert_eq!(warnings("csv"), infinite);
    assert_eq!(warnings("fgb"), format!("{infinite}; {}", rounded(1)));
    assert_eq!(warnings("gpkg"), format!("{other}`fid` is `fid_2`; {infinite}; {}", rounded(1)));
    let names = format!("{other}`a b` is `a_b`, `a_b` is `a_b_2`");
    assert_eq!(warnings("svg"), format!("{names}; {infinite}; {control}"));
    assert_eq!(warnings("obj"), format!("{infinite}; {control}"));
    let dropped = "attributes that are not numbers are dropped: `a b`";
    assert_eq!(warnings("ply"), format!("{names}; {dropped}; {infinite}; {}", rounded(2)));
    // A point or an empty geometry has no edges to carry attributes.
    let path = directory.path().join("b.ply");
    let warnings = written(&path, &attributes[2..], &[(None, false, &row[2..])]);
    assert!(warnings.iter().any(|text| text.contains("since they have no edges: 1")), "{warnings:?}");
}
