//! Contours: lines, areas between them, and surfaces of octrees.

use std::path::PathBuf;

use pyo3::prelude::*;
use spinney::export::mesh::{MeshFormat, export_isosurfaces};
use spinney::export::vector::{ContourFeatures, VectorFormat, export_contours};
use spinney::query::{ContourEnds, ContourLevels, ContourRequest};

use crate::error::invalid;
use crate::files::check_output;
use crate::jobs::{self, Terms};
use crate::part::level_of;
use crate::tree::Tree;

/// Contours that are asked for.
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
            _ => Err(invalid("contours: give one of at and every")),
        }
    }

    fn ends(&self) -> PyResult<ContourEnds> {
        match self.ends.as_str() {
            "open" => Ok(ContourEnds::Open),
            "extend" => Ok(ContourEnds::Extend),
            "close" => Ok(ContourEnds::Close),
            other => Err(invalid(format!("ends: {other}, expected open, extend or close"))),
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
                return Err(invalid("filled, smooth and has_z are for contours of pictures"));
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
}
