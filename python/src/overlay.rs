//! Set operations of polygons.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::export::VectorFormat;
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::raw::import::feature::read_polygons;
use spinney::raw::overlay::{OverlayOperation, OverlayRequest, overlay_features, read_polygon_layers};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms};

/// Region that limits a result: a box, or a file of polygons.
#[derive(FromPyObject)]
pub(crate) enum Region {
    Box(Vec<f64>),
    Polygons(PathBuf),
}

/// Writes the result of a set operation on the polygons of files; returns counts by name.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as in Python
pub(crate) fn combine_polygons<'py>(
    py: Python<'py>,
    operation: &str,
    paths: Vec<PathBuf>,
    out: PathBuf,
    filter: Option<String>,
    within: Option<Region>,
    snap: Option<f64>,
    memory: u64,
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    let operation = OverlayOperation::named(operation).ok_or_else(|| {
        invalid(format!("operation: got {operation:?}, expected one for polygons, which have no values"))
    })?;
    let format = VectorFormat::of(&out)
        .ok_or_else(|| invalid("out: expected .geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply"))?;
    check_output(&paths, &out)?;
    let filter: FeatureFilter = filter.map(|text| text.parse()).transpose().or_raise()?.unwrap_or_default();
    let mut request = OverlayRequest { snap, memory, ..OverlayRequest::new(operation) };
    let region = match within {
        Some(Region::Box(numbers)) => match numbers[..] {
            [west, south, east, north] => {
                request.within_box([west, south], [east, north]);
                None
            }
            _ => return Err(invalid("within: expected 4 numbers, or a file of polygons")),
        },
        Some(Region::Polygons(path)) => Some(path),
        None => None,
    };
    let made = jobs::run(py, terms, |work| {
        let layers = read_polygon_layers(&paths, &filter, memory)?;
        if let Some(path) = region {
            let region = read_polygons(&path, &FeatureOptions { memory, ..FeatureOptions::default() })?;
            request.within = Some(region.into_parts());
        }
        overlay_features(layers, &request, work.create(&out)?, format, work)
    })?;
    let facts = PyDict::new(py);
    facts.set_item("features", made.parts)?;
    facts.set_item("polygons", made.polygons)?;
    facts.set_item("area", made.area)?;
    facts.set_item("shared", made.shared)?;
    facts.set_item("edges", made.summary.edges)?;
    facts.set_item("crossings", made.summary.crossings)?;
    facts.set_item("repeated_corners", made.summary.repeated_corners)?;
    facts.set_item("cell", made.summary.cell)?;
    facts.set_item("area_bound", made.summary.area_bound)?;
    Ok(facts)
}
