//! Sections: cuts of exact models by planes, and by the surfaces of other models.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::ExactModel;
use spinney::export::VectorFormat;
use spinney::raw::brep::ModelView;
use spinney::raw::brep::surface_intersection::surface_intersection;
use spinney::raw::export::vector::{SectionPlanes, export_intersection, export_section};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, access};
use crate::model::Model;

/// Planes and models that cut a model.
#[derive(Default)]
struct Cutters {
    planes: Vec<SectionPlanes>,
    models: Vec<Arc<ModelView>>,
}

impl Cutters {
    fn of(py: Python<'_>, given: &[Bound<'_, PyAny>]) -> PyResult<Cutters> {
        let mut cutters = Cutters::default();
        for cutter in given {
            if let Ok(model) = cutter.cast::<Model>() {
                cutters.models.push(model.get().get()?);
                continue;
            }
            if let Ok(text) = cutter.extract::<String>() {
                if Path::new(&text).exists() {
                    return Err(invalid(format!("by: {text} is a file; give it as a Path, or open it")));
                }
                cutters.planes.push(text.parse().or_raise()?);
                continue;
            }
            let path: PathBuf = cutter.extract()?;
            let model = py.detach(|| ExactModel::open(&path, &access().into())).or_raise()?;
            cutters.models.push(Arc::new(model.into()));
        }
        Ok(cutters)
    }
}

#[pymethods]
impl Model {
    /// Writes the model's cuts by planes, or its intersection with another model; returns counts
    /// and sums by name.
    #[pyo3(name = "_write_section")]
    fn write_section<'py>(
        &self,
        py: Python<'py>,
        path: PathBuf,
        cutters: Vec<Bound<'py, PyAny>>,
        flat: bool,
        memory: u64,
        terms: Terms,
    ) -> PyResult<Bound<'py, PyDict>> {
        let model = self.get()?;
        let Cutters { planes, models } = Cutters::of(py, &cutters)?;
        let inputs = models.iter().chain([&model]).map(|model| model.file().path().to_path_buf());
        check_output(&inputs.collect::<Vec<_>>(), &path)?;
        let known = "use .geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply";
        let format = VectorFormat::of(&path)
            .ok_or_else(|| invalid(format!("{}: unknown format; {known}", path.display())))?;
        let facts = PyDict::new(py);
        match &models[..] {
            [] => {
                let made = jobs::run(py, terms, |work| {
                    export_section(&model, &planes, (flat, false), work.create(&path)?, format, work)
                })?;
                facts.set_item("planes", made.planes)?;
                facts.set_item("polygons", made.polygons)?;
                facts.set_item("area", made.area)?;
            }
            [_] if flat => {
                return Err(invalid("flat: is for planes, not for the intersection of two models"));
            }
            [other] if planes.is_empty() => {
                let made = jobs::run(py, terms, |work| {
                    let what = "the intersection of two models";
                    let models = [model.as_model(what)?, other.as_model(what)?];
                    let found = surface_intersection(models[0], models[1], memory, work)?;
                    export_intersection(&found, models, work.create(&path)?, format, work)
                })?;
                facts.set_item("crossings", made.crossings)?;
                facts.set_item("crossing_length", made.crossing_length)?;
                facts.set_item("touches", made.touches)?;
                facts.set_item("touch_length", made.touch_length)?;
                facts.set_item("overlaps", made.overlaps)?;
                facts.set_item("overlap_area", made.overlap_area)?;
                facts.set_item("points", made.points)?;
            }
            _ => return Err(invalid("section: expected planes, or one other model")),
        }
        Ok(facts)
    }
}
