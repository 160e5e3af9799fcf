//! Exact models: open files and their metadata.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use spinney::brep::{BoxLocation, Faces, Location, Motion, with_levels};
use spinney::export::{MeshFormat, export_exact};
use spinney::import::feature::FeatureFilter;
use spinney::import::mesh::ExactOptions;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::brep::{ModelView, NodeCounts};
use spinney::raw::import::feature::choose_objects;
use spinney::raw::import::mesh;
use spinney::raw::ops::AffineMap;
use spinney::raw::store::Tag;
use spinney::{Crs, ExactModel, Output, Progress, Result, ViewOperation};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, access};
use crate::meshes::{arrays_of, models_of};
use crate::model_faces::{DetailChoice, detail_of};
use crate::packing::Packing;
use crate::remote::{RemoteAccess, path_object};
use crate::tree::crs_text;

/// Exact model in an open file; any number of threads can query it.
#[pyclass(subclass, frozen, weakref, module = "spinney._native")]
pub(crate) struct Model {
    /// `None` when it is closed.
    opened: RwLock<Option<Arc<ModelView>>>,
    path: PathBuf,
    /// View operations.
    steps: Vec<ViewOperation>,
    positioned: bool,
    remote: RemoteAccess,
}

impl Model {
    /// Returns the open file, with its view operations.
    pub(crate) fn get(&self) -> PyResult<Arc<ModelView>> {
        let opened = self.opened.read().unwrap_or_else(PoisonError::into_inner);
        opened.clone().ok_or_else(|| invalid(format!("{}: is closed", self.path.display())))
    }
}

/// Distances from the surface (negative inside), its nearest points, and their faces.
type Nearest<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i64>>);

/// Computes a result for each point, on all processors.
pub(crate) fn each<R: Send>(
    points: &[f64],
    work: &dyn Progress,
    query: impl Fn(usize, [f64; 3]) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    /// Points between progress reports, and points that a thread processes between checks for
    /// cancellation.
    const BATCH: usize = 1 << 16;
    const PART: usize = 1 << 9;
    let (points, _) = points.as_chunks::<3>();
    let mut results = Vec::with_capacity(points.len());
    for (start, batch) in (0..).step_by(BATCH).zip(points.chunks(BATCH)) {
        let parts: Result<Vec<Vec<R>>> = batch
            .par_chunks(PART)
            .enumerate()
            .map(|(part, points)| {
                work.check()?;
                let first = start + part * PART;
                points.iter().enumerate().map(|(index, point)| query(first + index, *point)).collect()
            })
            .collect();
        results.extend(parts?.into_iter().flatten());
        work.advance(batch.len() as u64, points.len() as u64);
    }
    Ok(results)
}

fn node_counts<'py>(py: Python<'py>, nodes: &NodeCounts) -> PyResult<Bound<'py, PyDict>> {
    let counts = PyDict::new(py);
    for (name, count) in nodes.named() {
        counts.set_item(name.to_lowercase(), count)?;
    }
    Ok(counts)
}

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (path, positioned, remote=RemoteAccess::default(), steps=Vec::new()))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        positioned: bool,
        remote: RemoteAccess,
        steps: Vec<String>,
    ) -> PyResult<Model> {
        let steps: Vec<ViewOperation> =
            steps.iter().map(|step| step.parse()).collect::<Result<_>>().or_raise()?;
        let mut options = remote.options();
        if positioned {
            let access = options.access.clone().positioned(None);
            options = options.access(access);
        }
        let open = || -> Result<ModelView> {
            let model = ExactModel::open(&path, &options)?;
            if steps.is_empty() {
                return Ok(model.into());
            }
            let next = |map: AffineMap, step: &ViewOperation| Ok(map.then(&step.as_map()?));
            let map = steps.iter().try_fold(AffineMap::IDENTITY, next)?;
            ModelView::of(model, &Motion::from_rows(map.to_rows())?)
        };
        let view = py.detach(open).or_raise()?;
        Ok(Model { opened: RwLock::new(Some(Arc::new(view))), path, steps, positioned, remote })
    }

    /// Closes the file; running reads can finish.
    fn close(&self) {
        *self.opened.write().unwrap_or_else(PoisonError::into_inner) = None;
    }

    #[getter]
    fn closed(&self) -> bool {
        self.opened.read().unwrap_or_else(PoisonError::into_inner).is_none()
    }

    #[getter]
    fn path<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        path_object(py, &self.path)
    }

    /// Returns the store's options, and the file that Python reads.
    #[getter]
    fn _remote(&self) -> &RemoteAccess {
        &self.remote
    }

    /// Returns the view operations.
    #[getter]
    fn view(&self) -> Vec<String> {
        self.steps.iter().map(ViewOperation::to_string).collect()
    }

    #[getter]
    fn positioned(&self) -> bool {
        self.positioned
    }

    /// Raises OSError if the file was overwritten since it was opened. For a remote file this is
    /// one request.
    fn check_unchanged(&self, py: Python<'_>) -> PyResult<()> {
        let model = self.get()?;
        py.detach(|| model.file().check_unchanged().and_then(|()| model.file().check_remote())).or_raise()
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.get()?.file().len() as usize)
    }

    /// Returns the metadata that needs no faces, by name.
    #[pyo3(name = "_facts")]
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let view = self.get()?;
        let model = view.file();
        let (grid, metadata) = (model.grid(), model.metadata());
        let facts = PyDict::new(py);
        facts.set_item("depth", model.depth())?;
        facts.set_item("bits", grid.bits)?;
        facts.set_item("step", grid.width())?;
        facts.set_item("origin", grid.to_world([0; 3]))?;
        facts.set_item("parts", model.parts())?;
        facts.set_item("nodes", node_counts(py, model.nodes())?)?;
        facts.set_item("crs", metadata.frame.crs.as_ref().map(crs_text))?;
        facts.set_item("unit", metadata.tag(Tag::Unit))?;
        facts.set_item("tags", metadata.tags.clone())?;
        facts.set_item("provenance", metadata.clean_provenance())?;
        facts.set_item("bytes", model.file_size())?;
        facts.set_item("rounding", view.rounding())?;
        Ok(facts)
    }

    #[pyo3(name = "_bounds")]
    fn bounds(&self, py: Python<'_>) -> PyResult<[[f64; 3]; 2]> {
        let model = self.get()?;
        py.detach(|| model.bounds()).or_raise()
    }

    /// Returns volume, centre, moments and area, by name.
    #[pyo3(name = "_mass")]
    fn mass<'py>(&self, py: Python<'py>, terms: Terms) -> PyResult<Bound<'py, PyDict>> {
        let model = self.get()?;
        let mass = jobs::run(py, terms, |work| {
            let mass = model.mass(work)?;
            model.file().check_unchanged()?;
            Ok(mass)
        })?;
        let facts = PyDict::new(py);
        // (Horizontal degrees and vertical units have no common unit.)
        let is_known = model.file().metadata().frame.cell_volume().is_ok();
        let known = |measure: f64| if is_known { measure } else { f64::NAN };
        facts.set_item("volume", known(mass.volume))?;
        facts.set_item("area", known(mass.area))?;
        facts.set_item("centre", mass.centre)?;
        facts.set_item("second_moments", mass.second_moments)?;
        facts.set_item("inertia", mass.inertia)?;
        Ok(facts)
    }

    /// Returns the numbers of vertices, edges, faces, inner rings, shells, boundaries and handles.
    #[pyo3(name = "_euler")]
    fn euler<'py>(&self, py: Python<'py>, memory: u64, terms: Terms) -> PyResult<Bound<'py, PyDict>> {
        let model = self.get()?;
        let options = TopologyOptions { memory, path: self.path.clone() };
        let euler = jobs::run(py, terms, |work| Ok(Topology::of(model.file(), &options, work)?.euler()))?;
        let facts = PyDict::new(py);
        facts.set_item("vertices", euler.vertices)?;
        facts.set_item("edges", euler.edges)?;
        facts.set_item("faces", euler.faces)?;
        facts.set_item("inner_rings", euler.rings)?;
        facts.set_item("shells", euler.shells)?;
        facts.set_item("boundaries", euler.boundaries)?;
        facts.set_item("genus", euler.genus)?;
        Ok(facts)
    }

    /// Returns 1 for points inside, 0 on the surface, -1 outside.
    #[pyo3(name = "_locate")]
    fn locate<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        terms: Terms,
    ) -> PyResult<Bound<'py, PyArray1<i8>>> {
        let model = self.get()?;
        let points = points.as_slice()?;
        let found = jobs::run(py, terms, |work| {
            let found = each(points, work, |_, point| {
                Ok(match model.locate(point)? {
                    Location::Inside => 1,
                    Location::Boundary => 0,
                    Location::Outside => -1,
                })
            })?;
            model.file().check_unchanged()?;
            Ok(found)
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// Returns the nearest points on the surface.
    #[pyo3(name = "_nearest")]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        signed: bool,
        terms: Terms,
    ) -> PyResult<Nearest<'py>> {
        let model = self.get()?;
        let points = points.as_slice()?;
        let found = jobs::run(py, terms, |work| {
            let found = each(points, work, |_, point| {
                let Some(nearest) = model.nearest(point)? else { return Ok((f64::NAN, [f64::NAN; 3], -1)) };
                let distance = match signed.then(|| model.locate(point)).transpose()? {
                    Some(Location::Inside) => -nearest.distance,
                    Some(Location::Boundary) => 0.0,
                    _ => nearest.distance,
                };
                Ok((distance, nearest.point, nearest.face as i64))
            })?;
            model.file().check_unchanged()?;
            Ok(found)
        })?;
        let count = found.len();
        let nearest = PyArray1::from_iter(py, found.iter().flat_map(|(_, point, _)| *point));
        Ok((
            PyArray1::from_iter(py, found.iter().map(|(distance, ..)| *distance)),
            nearest.reshape([count, 3])?,
            PyArray1::from_iter(py, found.iter().map(|(.., face)| *face)),
        ))
    }

    /// Classifies a box as "inside", "outside" or "cut".
    #[pyo3(name = "_place_of_box")]
    fn locate_box(&self, py: Python<'_>, min: [f64; 3], max: [f64; 3]) -> PyResult<&'static str> {
        let model = self.get()?;
        let place = py.detach(|| model.locate_box(min, max)).or_raise()?;
        Ok(match place {
            BoxLocation::Inside => "inside",
            BoxLocation::Outside => "outside",
            BoxLocation::Cut => "cut",
        })
    }

    /// Returns the share, volume and centre of a cell's interior.
    #[pyo3(name = "_coverage")]
    fn coverage(
        &self,
        py: Python<'_>,
        level: u8,
        position: [u32; 3],
        terms: Terms,
    ) -> PyResult<(f64, f64, Option<[f64; 3]>)> {
        let model = self.get()?;
        let found = jobs::run(py, terms, |work| {
            model.as_model("shares of cells")?.cell_coverage(level, position, work)
        })?;
        Ok((found.share, found.volume, found.centre))
    }

    /// Writes the faces as a mesh, at a level of detail if there is one; returns the number of
    /// vertices, of faces, and of vertices that single precision has moved.
    #[pyo3(name = "_export")]
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        choice: DetailChoice,
        terms: Terms,
    ) -> PyResult<(u64, u64, u64)> {
        let (model, detail) = (self.get()?, detail_of(choice)?);
        check_output(std::slice::from_ref(&self.path), &path)?;
        let format = MeshFormat::of(&path).ok_or_else(|| {
            invalid(format!("{}: use .ply, .obj, .stl, .off or .city.json", path.display()))
        })?;
        let made = jobs::run(py, terms, |work| {
            let model = model.as_model("faces")?;
            let output = work.create(&path)?;
            let refined = model.refined(detail, &output, work)?;
            let surface = refined.as_deref().unwrap_or(model).surface(detail, None, work)?;
            let made = export_exact(&surface, format, output, work)?;
            model.check_unchanged()?;
            Ok(made)
        })?;
        Ok((made.vertices, made.faces, made.moved))
    }
}

/// Options of building an exact model.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ModelOptions {
    snap: Option<f64>,
    close: bool,
    repair: bool,
    inside: String,
    #[pyo3(item("where"))]
    filter: Option<String>,
    skip_bad: bool,
    levels: bool,
    leaf_size: Option<usize>,
    up: Option<String>,
    unit: Option<String>,
    crs: Option<String>,
    packing: Packing,
    memory: u64,
}

/// Builds an exact model from mesh files and meshes in memory; returns counts by name.
#[pyfunction]
#[pyo3(signature = (paths, meshes, out, options, terms))]
pub(crate) fn build_brep<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    meshes: Vec<Bound<'py, PyDict>>,
    out: PathBuf,
    options: ModelOptions,
    terms: Terms,
) -> PyResult<Bound<'py, PyDict>> {
    check_output(&paths, &out)?;
    let meshes = arrays_of(&meshes)?;
    let mut exact = ExactOptions::new();
    (exact.snap, exact.close, exact.memory) = (options.snap, options.close, options.memory);
    exact.repair = options.repair;
    exact.inside = options.inside.parse().or_raise()?;
    exact.skip_bad = options.skip_bad;
    let filter = options.filter.as_deref().map(str::parse::<FeatureFilter>).transpose().or_raise()?;
    exact.codec = options.packing.of_model()?;
    exact.leaf_size = options.leaf_size.unwrap_or(exact.leaf_size);
    exact.up = options.up.as_ref().map(|name| name.parse()).transpose().or_raise()?.unwrap_or_default();
    exact.unit = options.unit;
    exact.crs = options.crs.as_deref().map(Crs::parse).transpose().or_raise()?;
    let report = jobs::run(py, terms, |work| {
        let mut models = spinney::raw::import::mesh::open_all_with(&paths, exact.memory, access())?;
        models.extend(models_of(meshes)?);
        if let Some(filter) = &filter {
            let (names, about) = mesh::parts_of(&models);
            exact.parts = Some(choose_objects(filter, &names, &|part| Ok(about[part as usize].clone()))?);
        }
        let output = work.create_tree(&out)?;
        let import = |output: Output| spinney::import::mesh::import_exact(models, &exact, output, work);
        match options.levels {
            true => with_levels(output, exact.memory, work, import),
            false => import(output),
        }
    })?;
    let facts = PyDict::new(py);
    facts.set_item("read", report.read)?;
    facts.set_item("faces", report.faces)?;
    facts.set_item("collapsed", report.collapsed)?;
    facts.set_item("slivers", report.slivers)?;
    facts.set_item("cut", report.cut)?;
    facts.set_item("fanned", report.fanned)?;
    facts.set_item("closed_boundaries", report.closed.0)?;
    facts.set_item("closing_triangles", report.closed.1)?;
    let repaired = report.repair.map_or(0, |done| done.divided + done.removed);
    facts.set_item("repaired_faces", repaired)?;
    facts.set_item("lost_faces", report.repair.map_or(0, |done| done.outside))?;
    let skipped: Vec<(&str, &str)> =
        report.skipped.iter().map(|object| (object.name.as_str(), object.why.as_str())).collect();
    facts.set_item("skipped", skipped)?;
    facts.set_item("turned_bodies", report.repair.map_or(0, |done| done.turned.0))?;
    facts.set_item("displacement", report.displacement)?;
    facts.set_item("step", report.grid.width())?;
    facts.set_item("bits", report.grid.bits)?;
    facts.set_item("nodes", node_counts(py, &report.built.nodes)?)?;
    Ok(facts)
}
