//! Written features, read back: null and multi-geometries, collections, ids and all attribute
//! types.

use std::path::Path;

use spinney::Output;
use spinney::export::VectorFormat;
use spinney::import::feature::FeatureOptions;
use spinney::raw::export::vector::{
    AttributeType, AttributeValue, FeatureParts, Geometry, GeometryKind, VectorFeature, VectorLayer,
    VectorWriter,
};
use spinney::raw::import::feature::{Feature, FeatureAttribute, FeatureGeometry, Heights, open_features};

const ATTRIBUTES: [(&str, AttributeType); 6] = [
    ("count", AttributeType::Integer),
    ("share", AttributeType::Number),
    ("name", AttributeType::Text),
    ("is_open", AttributeType::Boolean),
    ("tags", AttributeType::Json),
    ("any", AttributeType::Mixed),
];

/// Returns a square ring, counterclockwise or, for a hole, clockwise.
fn square(west: f64, south: f64, side: f64, is_hole: bool) -> Vec<[f64; 2]> {
    let (east, north) = (west + side, south + side);
    let mut ring = vec![[west, south], [east, south], [east, north], [west, north], [west, south]];
    if is_hole {
        ring.reverse();
    }
    ring
}

fn feature(id: i64, geometry: Option<FeatureGeometry>) -> Feature {
    let text = |text: &str| FeatureAttribute::Text(text.into());
    let attributes = vec![
        FeatureAttribute::Integer((1 << 53) + id),
        FeatureAttribute::Number(0.1 * id as f64 + 0.05),
        text("one, \"two\"\nø"),
        FeatureAttribute::Boolean(id % 2 == 1),
        FeatureAttribute::Json(r#"{"a":[1,null]}"#.into()),
        if id % 2 == 0 { FeatureAttribute::None } else { text("7 x") },
    ];
    Feature { id: Some(id.into()), attributes, geometry, heights: Heights::default() }
}

/// Polygon features: one, one with a hole, several of which one has a hole, an empty one, and none.
fn polygons() -> Vec<Feature> {
    let outer = square(0.0, 0.0, 4.0, false);
    let hole = square(1.0, 1.0, 2.0, true);
    let parts = [
        Some(vec![vec![square(9.0, 9.5, 1.0, false)]]),
        Some(vec![vec![outer.clone(), hole.clone()]]),
        Some(vec![
            vec![square(20.0, 0.0, 1.0, false)],
            vec![outer, hole],
            vec![square(-5.5, 0.0, 1.0, false)],
        ]),
        None,
    ];
    let features = (3..).zip(parts).map(|(id, parts)| feature(id, parts.map(FeatureGeometry::Polygons)));
    features.collect()
}

fn written(path: &Path, kind: Option<GeometryKind>, features: &[Feature]) -> spinney::Result<()> {
    let layer = VectorLayer {
        name: "things".into(),
        kind,
        is_multi: true,
        has_z: false,
        attributes: ATTRIBUTES.iter().map(|(name, kind)| ((*name).into(), *kind)).collect(),
        crs: None,
        bounds: [[-6.0, -1.0], [21.0, 11.0]],
    };
    let format = VectorFormat::of(path).unwrap();
    let mut writer = VectorWriter::create(Output::create(path)?, format, layer)?;
    for feature in features {
        let parts = feature.geometry.as_ref().map(FeatureParts::of);
        let attributes: Vec<AttributeValue<'_>> =
            feature.attributes.iter().map(AttributeValue::from).collect();
        writer.write_feature(&VectorFeature {
            id: feature.id.as_ref(),
            geometry: parts.as_ref().map(|parts| (parts.kind(), parts as &dyn Geometry)),
            attributes: &attributes,
        })?;
    }
    writer.finish(&())
}

fn read(path: &Path) -> Vec<Feature> {
    let mut reader = open_features(path, &FeatureOptions::default()).unwrap();
    let mut features = Vec::new();
    while let Some(feature) = reader.next().unwrap() {
        features.push(feature);
    }
    features
}

/// Returns a feature as a format can store it.
fn as_stored(path: &Path, feature: &Feature) -> Feature {
    let mut as_stored = feature.clone();
    let ending = path.extension().unwrap().to_str().unwrap();
    let as_text = |attribute: &FeatureAttribute| match attribute {
        FeatureAttribute::None => FeatureAttribute::None,
        other => FeatureAttribute::Text(other.to_text()),
    };
    match ending {
        "gpkg" => {
            // JSON is a string there.
            as_stored.attributes[4] = as_text(&feature.attributes[4]);
        }
        "fgb" => as_stored.id = None,
        "csv" | "shp" => {
            as_stored.id = None;
            as_stored.attributes[4] = as_text(&feature.attributes[4]);
            if ending == "csv" {
                as_stored.attributes[3] = as_text(&feature.attributes[3]);
            }
        }
        _ => {}
    }
    as_stored
}

#[test]
fn polygons_round_trip_through_every_format() {
    let directory = tempfile::tempdir().unwrap();
    for ending in ["geojson", "csv", "gpkg", "fgb", "shp"] {
        let path = directory.path().join(format!("things.{ending}"));
        let features = polygons();
        written(&path, Some(GeometryKind::Polygon), &features).unwrap();
        let mut wanted: Vec<Feature> = features.iter().map(|feature| as_stored(&path, feature)).collect();
        if ending == "shp" {
            // Outer rings are clockwise there.
            for parts in wanted.iter_mut().filter_map(|feature| feature.geometry.as_mut()) {
                let FeatureGeometry::Polygons(parts) = parts else { continue };
                parts.iter_mut().flatten().for_each(|ring| ring.reverse());
            }
        }
        assert_eq!(read(&path), wanted, "{ending}");
    }
}

#[test]
fn features_of_several_geometry_types_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let line = vec![[0.0, 0.0], [3.0, 4.5]];
    let geometries = [
        FeatureGeometry::Points(vec![[1.0, 2.0]]),
        FeatureGeometry::Points(vec![[1.0, 2.0], [3.0, 0.25]]),
        FeatureGeometry::Lines(vec![line.clone()]),
        FeatureGeometry::Lines(vec![line.clone(), vec![[5.0, 5.0], [6.0, 5.0], [6.0, 7.0]]]),
        FeatureGeometry::Polygons(vec![vec![square(0.0, 0.0, 2.0, false), square(0.5, 0.5, 1.0, true)]]),
        FeatureGeometry::Collection(vec![
            FeatureGeometry::Points(vec![[1.0, 2.0]]),
            FeatureGeometry::Lines(vec![line]),
            FeatureGeometry::Polygons(vec![vec![square(7.0, 0.0, 2.0, false)]]),
        ]),
    ];
    let features: Vec<Feature> = (1..).zip(geometries).map(|(id, own)| feature(id, Some(own))).collect();
    for ending in ["geojson", "csv", "gpkg", "fgb"] {
        let path = directory.path().join(format!("things.{ending}"));
        written(&path, None, &features).unwrap();
        let mut found = read(&path);
        // Formats with an index have their own order.
        found.sort_by_key(|feature| match feature.attributes[0] {
            FeatureAttribute::Integer(number) => number,
            _ => 0,
        });
        let wanted: Vec<Feature> = features.iter().map(|feature| as_stored(&path, feature)).collect();
        assert_eq!(found, wanted, "{ending}");
    }
    let path = directory.path().join("things.shp");
    assert!(written(&path, None, &features).unwrap_err().to_string().contains("several geometry types"));
}

/// A FlatGeobuf index over many features: nodes contain their children, and leaves store the
/// features' offsets.
#[test]
fn an_index_of_flatgeobuf_is_around_its_features() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("many.fgb");
    for count in [1usize, 15, 16, 17, 256, 257, 5000] {
        let layer = VectorLayer {
            name: "many".into(),
            kind: Some(GeometryKind::Point),
            is_multi: false,
            has_z: false,
            attributes: vec![("number".into(), AttributeType::Integer)],
            crs: None,
            bounds: [[0.0, 0.0], [100.0, 100.0]],
        };
        let mut writer =
            VectorWriter::create(Output::create(&path).unwrap(), VectorFormat::FlatGeobuf, layer).unwrap();
        let point_of = |number: usize| [(number * 37 % 101) as f64, (number * 53 % 97) as f64];
        for number in 0..count {
            let [x, y] = point_of(number);
            writer.write(&[vec![[x, y, 0.0]]], &[AttributeValue::Integer(number as i64)]).unwrap();
        }
        writer.finish(&()).unwrap();
        let features = read(&path);
        assert_eq!(features.len(), count);
        let mut seen: Vec<usize> = Vec::new();
        for feature in &features {
            let FeatureAttribute::Integer(number) = feature.attributes[0] else { panic!("{feature:?}") };
            let number = number as usize;
            assert_eq!(feature.geometry, Some(FeatureGeometry::Points(vec![point_of(number)])));
            seen.push(number);
        }
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..count));
        check_index(&std::fs::read(&path).unwrap(), count);
    }
}

fn check_index(bytes: &[u8], count: usize) {
    let header = u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
    let mut levels = vec![count];
    while levels.len() == 1 || levels[levels.len() - 1] > 1 {
        levels.push(levels[levels.len() - 1].div_ceil(16));
    }
    let nodes: usize = levels.iter().sum();
    let index = &bytes[12 + header..];
    let node = |number: usize| {
        let bytes = &index[40 * number..][..40];
        let number = |at: usize| f64::from_le_bytes(bytes[8 * at..][..8].try_into().unwrap());
        ([0, 1, 2, 3].map(number), u64::from_le_bytes(bytes[32..].try_into().unwrap()) as usize)
    };
    // From the root on: the children of all nodes are all lower nodes, in order.
    let mut next = 1;
    for parent in 0..nodes - count {
        let (around, first) = node(parent);
        assert_eq!(first, next, "{count}");
        let level_end = levels
            .iter()
            .rev()
            .scan(0, |end, own| {
                *end += own;
                Some(*end)
            })
            .find(|end| *end > first);
        let children = first..(first + 16).min(level_end.unwrap());
        let mut joined = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for child in children.clone() {
            let (own, _) = node(child);
            joined =
                [joined[0].min(own[0]), joined[1].min(own[1]), joined[2].max(own[2]), joined[3].max(own[3])];
        }
        assert_eq!(around, joined, "node {parent} of {count}");
        next = children.end;
    }
    assert_eq!(next, nodes);
    // Leaves: features are contiguous.
    let features = &index[40 * nodes..];
    let mut at = 0;
    for leaf in nodes - count..nodes {
        assert_eq!(node(leaf).1, at);
        at += 4 + u32::from_le_bytes(features[at..at + 4].try_into().unwrap()) as usize;
    }
    assert_eq!(at, features.len());
}

/// Heights are ignored, which is reported for each feature.
#[test]
fn dropped_heights_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    for ending in ["geojson", "csv", "gpkg", "fgb", "shp"] {
        for has_z in [false, true] {
            let path = directory.path().join(format!("lines{has_z}.{ending}"));
            let layer = VectorLayer {
                name: "lines".into(),
                kind: Some(GeometryKind::Line),
                is_multi: false,
                has_z,
                attributes: Vec::new(),
                crs: None,
                bounds: [[0.0, 0.0], [1.0, 1.0]],
            };
            let format = VectorFormat::of(&path).unwrap();
            let mut writer = VectorWriter::create(Output::create(&path).unwrap(), format, layer).unwrap();
            writer.write(&[vec![[0.0, 0.0, 5.0], [1.0, 1.0, 6.0]]], &[]).unwrap();
            writer.finish(&()).unwrap();
            let features = read(&path);
            assert_eq!(features.len(), 1);
            let Heights { are_there, have_measures, .. } = features[0].heights;
            assert_eq!((are_there, have_measures), (has_z, false), "{ending}");
            assert_eq!(
                features[0].geometry,
                Some(FeatureGeometry::Lines(vec![vec![[0.0, 0.0], [1.0, 1.0]]]))
            );
        }
    }
}
