//! Features: files of each format, which are read completely, twice, and as zones.

use std::path::Path;

use spinney::Result;
use spinney::import::feature::FeatureOptions;
use spinney::raw::import::feature::{Feature, open_features, read_polygons};

use super::files::in_file;

/// Memory limit of a feature in bytes.
const MEMORY: u64 = 1 << 20;

/// A target for each single-file format; the file's name selects the format if the bytes do not.
macro_rules! features {
    ($($name:ident $file:literal),*) => {
        $(#[doc = concat!("Features, as a file with the name `", $file, "`.")]
        pub fn $name(bytes: &[u8]) {
            in_file($file, bytes, read_features);
        })*
    };
}

features!(feature_table "f.csv", flatgeobuf "f.fgb", geojson "f.geojson", geopackage "g.gpkg", shapefile "s.shp");

/// A shape without a geometry, in a shapefile.
const SHAPE: [u8; 112] = {
    let mut file = [0; 112];
    (file[2], file[3]) = (0x27, 0x0a);
    (file[27], file[28], file[29]) = (56, 0xe8, 3);
    (file[103], file[107]) = (1, 2);
    file
};

/// A dBASE table, with a shapefile.
pub fn shapefile_table(bytes: &[u8]) {
    in_file("t.dbf", bytes, |_| in_file("t.shp", &SHAPE, read_features));
}

fn all(path: &Path) -> Result<Vec<Feature>> {
    let mut reader = open_features(path, &FeatureOptions { memory: MEMORY, ..FeatureOptions::default() })?;
    let mut features = Vec::new();
    while let Some(feature) = reader.next()? {
        assert_eq!(feature.attributes.len(), reader.schema().attributes.len());
        features.push(feature);
    }
    assert!(reader.schema().count.is_none_or(|count| count >= features.len() as u64));
    Ok(features)
}

fn read_features(path: &Path) {
    if let Ok(features) = all(path) {
        // (NaN does not equal itself.)
        let again = all(path).unwrap();
        assert_eq!(format!("{features:?}"), format!("{again:?}"), "the second read differs");
    }
    drop(read_polygons(path, &FeatureOptions { memory: MEMORY, ..FeatureOptions::default() }));
}
