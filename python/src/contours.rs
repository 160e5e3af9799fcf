//! Contours: lines, bands, and isosurfaces of octrees; regions of classes as polygons and chain
//! codes.

use std::path::PathBuf;

use pyo3::prelude::*;
use spinney::export::{MeshFormat, VectorFormat, export_contours, export_polygons};
use spinney::query::{ContourLevels, ContourRequest, PolygonRequest};
use spinney::raw::export::mesh::export_isosurfaces;
use spinney::raw::export::vector::ContourFeatures;
use spinney::raw::export::{ChainDirections, export_chain_code};
use spinney::raw::query::ContourEnds;

use crate::error::invalid;
use crate::files::check_output;
use crate::jobs::{self, Terms};
use crate::numbers::PyNumber;
use crate::region::level_of;
use crate::tree::Tree;

/// Contour request.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ContourOptions {
    at: Option<Vec<f64>>,
    every: Option<f64>,
    base: f64,
    filled: bool,
    level: Option<i64>,
    ends: String,
    smooth: u8,
    has_z: bool,
    memory: u64,
}

impl ContourOptions {
    fn levels(&self) -> PyResult<ContourLevels> {
        match (&self.at, self.every) {
            (Some(values), None) => Ok(ContourLevels::At(values.clone())),
            (None, Some(step)) => Ok(ContourLevels::Every { step, base: self.base }),
            _ => Err(invalid("contours: expected one of at and every")),
        }
    }

    fn ends(&self) -> PyResult<ContourEnds> {
        match self.ends.as_str() {
            "open" => Ok(ContourEnds::Open),
            "extend" => Ok(ContourEnds::Extend),
            "close" => Ok(ContourEnds::Close),
            other => Err(invalid(format!("ends: got {other}, expected open, extend or close"))),
        }
    }
}

#[pymethods]
impl Tree {
    /// Writes contours; returns the number of lines, polygons or triangles.
    #[pyo3(name = "_write_contours")]
    fn write_contours(
        &self,
        py: Python<'_>,
        path: PathBuf,
        options: ContourOptions,
        terms: Terms,
    ) -> PyResult<u64> {
        let opened = self.get()?;
        check_output(&[opened.tree.name().to_path_buf()], &path)?;
        let mut request = ContourRequest::new(options.levels()?);
        request.level = Some(level_of(&opened.tree, options.level)?);
        request.ends = options.ends()?;
        request.memory = options.memory;
        let unknown = |known: &str| invalid(format!("{}: unknown format; use {known}", path.display()));
        if opened.axes() == 3 {
            if options.filled || options.smooth > 0 || options.has_z {
                return Err(invalid("filled, smooth, has_z: are for contours of rasters"));
            }
            let format = MeshFormat::of(&path).filter(|format| *format != MeshFormat::CityJson);
            let format = format.ok_or_else(|| unknown(".ply, .obj, .stl or .off"))?;
            let made = jobs::run(py, terms, |work| {
                export_isosurfaces(&opened.tree, &request, work.create(&path)?, format, work)
            })?;
            return Ok(made.triangles);
        }
        let format = VectorFormat::of(&path);
        let format =
            format.ok_or_else(|| unknown(".geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply"))?;
        let mut features = ContourFeatures::new();
        (features.filled, features.smooth, features.has_z) = (options.filled, options.smooth, options.has_z);
        let made = jobs::run(py, terms, |work| {
            export_contours(&opened.tree, &request, &features, work.create(&path)?, format, work)
        })?;
        Ok(made.count)
    }

    /// Writes regions of classes as polygons, with 4- or 8-connected cells; returns their number.
    #[pyo3(name = "_write_polygons")]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn write_polygons(
        &self,
        py: Python<'_>,
        path: PathBuf,
        classes: Option<Vec<PyNumber>>,
        connect: u8,
        simplify: Option<f64>,
        level: Option<i64>,
        terms: Terms,
    ) -> PyResult<u64> {
        let opened = self.get()?;
        check_output(&[opened.tree.name().to_path_buf()], &path)?;
        let mut request = region_request(classes, connect, level_of(&opened.tree, level)?)?;
        request.simplify = simplify;
        let known = ".geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply";
        let format = VectorFormat::of(&path)
            .ok_or_else(|| invalid(format!("{}: unknown format; use {known}", path.display())))?;
        let made = jobs::run(py, terms, |work| {
            export_polygons(&opened.tree, &request, work.create(&path)?, format, work)
        })?;
        Ok(made.count)
    }

    /// Writes regions of classes as chain codes of 4 or 8 directions; returns their number.
    #[pyo3(name = "_write_chain_code")]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn write_chain_code(
        &self,
        py: Python<'_>,
        path: PathBuf,
        classes: Option<Vec<PyNumber>>,
        connect: u8,
        directions: u8,
        level: Option<i64>,
        terms: Terms,
    ) -> PyResult<u64> {
        let opened = self.get()?;
        check_output(&[opened.tree.name().to_path_buf()], &path)?;
        let request = region_request(classes, connect, level_of(&opened.tree, level)?)?;
        let directions: ChainDirections =
            directions.to_string().parse().map_err(|e: spinney::Error| invalid(e.to_string()))?;
        let made = jobs::run(py, terms, |work| {
            export_chain_code(&opened.tree, &request, directions, work.create(&path)?, work)
        })?;
        Ok(made.count)
    }
}

/// Returns the request for regions of classes at `level`, with cells connected to 4 or 8
/// neighbours.
fn region_request(classes: Option<Vec<PyNumber>>, connect: u8, level: u8) -> PyResult<PolygonRequest> {
    let mut request = PolygonRequest::new();
    request.classes = classes.map(|classes| classes.into_iter().map(|PyNumber(class)| class).collect());
    request.across_corners = match connect {
        4 => false,
        8 => true,
        _ => return Err(invalid(format!("connect: got {connect}, expected 4 or 8"))),
    };
    request.level = Some(level);
    Ok(request)
}
