//! Polygons for queries of point trees.

use std::path::Path;

use crate::import::feature::{FeatureGeometry, open_features};
use crate::zonal::{coordinates_in, in_file, options_over};
use spinney_base::{Error, Progress, Result};
use spinney_crs::PolygonParts;
use spinney_points::{PointRegion, PointTree};

/// Reads all polygons of a feature file, and transforms them to the coordinate system of a point
/// tree, as zones are transformed to that of a raster.
///
/// # Errors
/// If a feature is not a polygon, there are none, the file cannot be read, or one of the coordinate
/// systems is not supported.
pub fn region_of_polygons(tree: &PointTree, path: &Path, progress: &dyn Progress) -> Result<PointRegion> {
    let mut reader = open_features(path, &options_over(&tree.metadata().frame))?;
    let coordinates = coordinates_in(&tree.metadata().frame, path, &*reader, progress);
    let locator = tree.locator(&coordinates).map_err(|error| in_file(path, error))?;
    locator.remarks().iter().for_each(|remark| progress.warn(path, remark));
    let mut parts = PolygonParts::new();
    let (mut number, mut polygons) = (0u64, 0u64);
    while let Some(feature) = reader.next()? {
        number += 1;
        match feature.geometry {
            Some(FeatureGeometry::Polygons(own)) => {
                polygons += 1;
                parts.extend(locator.parts(own));
            }
            None => {}
            Some(_) => {
                let found = format!("feature {number}, which is not a polygon,");
                return Err(Error::unsupported(path, found, "regions of points are polygons"));
            }
        }
    }
    if polygons == 0 {
        return Err(Error::unsupported(path, "a region without polygons", "regions of points are polygons"));
    }
    Ok(PointRegion::Polygons(parts))
}
