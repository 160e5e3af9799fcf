//! Open trees and their metadata.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyString};
use spinney::raw::dataset;
use spinney::raw::export::void_number;
use spinney::raw::io::FileStat;
use spinney::raw::ops::Calculation;
use spinney::raw::store::{FileReference, file_of};
use spinney::raw::value::Mask;
use spinney::{Crs, Dataset, Number, ViewOperation};

use crate::error::{OrRaise, invalid};
use crate::numbers::{PyNumber, names_to_python, to_python};
use crate::remote::{RemoteAccess, path_object};
use crate::{jobs, samples};

/// Open file or view; any number of threads can query it.
#[pyclass(subclass, frozen, weakref, module = "spinney._native")]
pub(crate) struct Tree {
    /// `None` when it is closed.
    opened: RwLock<Option<Arc<Opened>>>,
    /// Path and options that it was opened with.
    path: PathBuf,
    steps: Vec<ViewOperation>,
    commit: Option<u64>,
    positioned: bool,
    /// Name or number of the layer, by default the first.
    layer: Option<String>,
    /// How the file is opened if it is remote.
    remote: RemoteAccess,
}

/// Returns a coordinate system as pyproj and rasterio read it: `EPSG:4326`, else WKT 2, else its
/// unchanged definition.
pub(crate) fn crs_text(crs: &Crs) -> String {
    crs.to_text().ok().or_else(|| crs.foreign_text()).unwrap_or_else(|| crs.definition())
}

/// State of a file.
pub(crate) struct Opened {
    pub(crate) tree: Dataset,
    /// File of a view.
    file: Option<Dataset>,
    /// Whether view operations apply, which take time for each cell.
    pub(crate) is_view: bool,
    void: OnceLock<Number>,
}

impl Opened {
    /// Returns the default number for VOID cells.
    pub(crate) fn void(&self) -> PyResult<Number> {
        if let Some(number) = self.void.get() {
            return Ok(*number);
        }
        // (This reads the file, which another thread of this interpreter may serve.)
        let number = Python::attach(|py| py.detach(|| void_number(&self.tree))).or_raise()?;
        let number = number.unwrap_or_default();
        Ok(*self.void.get_or_init(|| number))
    }

    /// Returns the number for VOID cells of arrays without a mask: the caller's, or an unused one.
    pub(crate) fn plain_fill(&self, given: Option<PyNumber>) -> PyResult<Number> {
        if given.is_none() {
            let is_free = || {
                let extent = self.tree.header().extent_bounds();
                Ok(void_number(&self.tree)?.is_some() || !self.tree.may_have_void(extent)?)
            };
            if !Python::attach(|py| py.detach(is_free)).or_raise()? {
                let sample = self.tree.header().form.value.sample.name();
                return Err(invalid(format!(
                    "VOID cells: every number of {sample} is a value, so no number can represent VOID; read with masked=True, or give a number as fill="
                )));
            }
        }
        self.fill(given)
    }

    /// Returns the number for VOID cells: the caller's, or an unused one; else 0, for arrays with a
    /// mask.
    pub(crate) fn fill(&self, given: Option<PyNumber>) -> PyResult<Number> {
        let sample = self.tree.header().form.value.sample;
        match given.map(|number| number.0) {
            None => self.void(),
            Some(number) if sample.is_float() || sample.can_hold(number) => Ok(number),
            Some(number) => Err(invalid(format!("fill: {} cannot hold {number}", sample.name()))),
        }
    }

    /// Returns the file, or the layer of it, without view operations.
    fn file(&self) -> &Dataset {
        self.file.as_ref().unwrap_or(&self.tree)
    }

    /// Returns the sample that marks a missing channel value, if there is one.
    pub(crate) fn missing(&self) -> Option<Number> {
        self.tree.metadata().nodata.filter(|_| matches!(self.tree.header().form.value.mask, Mask::Missing(_)))
    }

    /// Converts a sample for Python.
    pub(crate) fn to_python<'py>(&self, py: Python<'py>, number: Number) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, number, self.tree.header().form.value.sample)
    }

    /// Returns the number of axes.
    pub(crate) fn axes(&self) -> usize {
        self.tree.header().form.axes()
    }

    /// Returns the samples per value.
    pub(crate) fn count(&self) -> usize {
        self.tree.header().form.value.channels.into()
    }
}

impl Tree {
    /// Returns the open file.
    pub(crate) fn get(&self) -> PyResult<Arc<Opened>> {
        let opened = self.opened.read().unwrap_or_else(PoisonError::into_inner);
        opened.clone().ok_or_else(|| invalid(format!("{}: is closed", self.path.display())))
    }

    /// Returns a line that lists the view operations, if there are any.
    pub(crate) fn steps_text(&self) -> Option<String> {
        let steps: Vec<String> = self.steps.iter().map(ViewOperation::to_string).collect();
        (!steps.is_empty()).then(|| format!("view of {}: {}", self.path.display(), steps.join(", ")))
    }

    /// Opens another layer of the file in the same way; returns an object of the same class.
    pub(crate) fn other_layer<'py>(
        &self,
        this: &Bound<'py, Tree>,
        name: &Bound<'py, PyString>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let steps: Vec<String> = self.steps.iter().map(ViewOperation::to_string).collect();
        // (At the same commit, so that all layers have one state.)
        let commit = self.get()?.tree.commit().map(|commit| commit.number);
        this.get_type().call1((
            path_object(this.py(), &self.path)?,
            steps,
            commit,
            self.positioned,
            name,
            &self.remote,
            this,
        ))
    }

    /// Opens layers of the file as the channels of one tree, on the finest layer's cells, in the
    /// same way; returns an object of the same class.
    pub(crate) fn composite<'py>(
        &self,
        this: &Bound<'py, Tree>,
        names: &[String],
    ) -> PyResult<Bound<'py, PyAny>> {
        let composite = ViewOperation::Calculation(Box::new(Calculation::composite(names).or_raise()?));
        let commit = self.get()?.tree.commit().map(|commit| commit.number);
        let finest = this.py().detach(|| -> spinney::Result<Option<&String>> {
            let file = self.open_file(commit)?;
            // (A name that no layer has may be that of a channel.)
            let depth = |name: &&String| file.layer(name).map_or(0, |layer| layer.depth());
            let deepest = names.iter().map(|name| depth(&name)).max();
            Ok(names.iter().find(|name| Some(depth(name)) == deepest && file.layer(name).is_ok()))
        });
        let finest = finest.or_raise()?;
        let steps: Vec<String> =
            [&composite].into_iter().chain(&self.steps).map(ViewOperation::to_string).collect();
        let layer = finest.cloned();
        let path = path_object(this.py(), &self.path)?;
        this.get_type().call1((path, steps, commit, self.positioned, layer, &self.remote))
    }

    /// Returns whether there are no view operations.
    pub(crate) fn is_file(&self) -> bool {
        self.steps.is_empty()
    }

    fn set(&self, opened: Option<Arc<Opened>>) {
        *self.opened.write().unwrap_or_else(PoisonError::into_inner) = opened;
    }

    /// Opens layers of the file by name, with the same view operations and at the same commit.
    pub(crate) fn open_layers(&self, names: &[String]) -> spinney::Result<Vec<Arc<Opened>>> {
        let file = self.open_file(self.state())?;
        names.iter().map(|name| self.seen(file.layer(name)?)).collect()
    }

    /// Returns the commit that is read, if the file has commits and is open.
    fn state(&self) -> Option<u64> {
        let opened = self.opened.read().unwrap_or_else(PoisonError::into_inner);
        opened.as_ref().and_then(|opened| opened.tree.commit()).map(|commit| commit.number)
    }

    /// Opens the tree; if the file is open already, its state is shared.
    fn open(&self, file: Option<&Opened>) -> spinney::Result<Arc<Opened>> {
        if let (Some(file), Some(layer)) = (file, &self.layer) {
            return self.seen(file.tree.layer(layer)?);
        }
        let tree = self.open_file(self.commit)?;
        self.seen(match &self.layer {
            Some(layer) => tree.layer(layer)?,
            None => tree,
        })
    }

    /// Opens the first layer of the file, or of a commit.
    fn open_file(&self, commit: Option<u64>) -> spinney::Result<Dataset> {
        let mut options = self.remote.options();
        if self.positioned {
            let access = options.access.clone().positioned(None);
            options = options.access(access);
        }
        let path = match commit {
            Some(number) => {
                let place = FileReference { file: (&self.path).into(), commit: Some(number), layer: None };
                place.of_commit()
            }
            None => self.path.clone(),
        };
        dataset::open(&path, &options)
    }

    /// Applies the view operations to a layer.
    fn seen(&self, layer: Dataset) -> spinney::Result<Arc<Opened>> {
        let (tree, file) = match &self.steps[..] {
            [] => (layer, None),
            steps => {
                let file = layer.as_file().map(|file| Dataset::of(file.into())).transpose()?;
                (layer.view(steps)?, file)
            }
        };
        let is_view = !self.is_file();
        Ok(Arc::new(Opened { tree, file, is_view, void: OnceLock::new() }))
    }
}

#[pymethods]
impl Tree {
    #[new]
    #[pyo3(signature = (path, view, commit, positioned, layer, remote=RemoteAccess::default(), sibling=None))]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn new(
        py: Python<'_>,
        path: PathBuf,
        view: Vec<String>,
        commit: Option<u64>,
        positioned: bool,
        layer: Option<String>,
        remote: RemoteAccess,
        sibling: Option<&Bound<'_, Tree>>,
    ) -> PyResult<Tree> {
        let FileReference { file, commit: named, layer: layer_named } = FileReference::of(&path);
        if layer_named.is_some() && layer.is_some() && layer_named != layer {
            return Err(invalid("layer: differs from the layer in the path"));
        }
        let layer = layer.or(layer_named);
        if named.is_some() && commit.is_some() && named != commit {
            return Err(invalid("commit: differs from the commit in the path"));
        }
        let (path, commit) = (file.into_owned(), commit.or(named));
        let steps =
            view.iter().map(|step| step.parse().or_raise()).collect::<PyResult<Vec<ViewOperation>>>()?;
        let tree = Tree { opened: RwLock::new(None), path, steps, commit, positioned, layer, remote };
        // (Layers share an open file, as there may be thousands. A view only has its own layer.)
        let file = sibling.filter(|_| tree.is_file()).map(|sibling| sibling.get().get()).transpose()?;
        let opened = py.detach(|| tree.open(file.as_deref())).or_raise()?;
        if let Some(remark) = opened.tree.remark().filter(|_| sibling.is_none()) {
            jobs::warn(py, &format!("{}: {remark}", tree.path.display()))?;
        }
        tree.set(Some(opened));
        Ok(tree)
    }

    /// Closes the file; running reads can finish.
    fn close(&self) {
        self.set(None);
    }

    #[getter]
    fn closed(&self) -> bool {
        self.opened.read().unwrap_or_else(PoisonError::into_inner).is_none()
    }

    /// Advances to the newest commit; returns whether there was a newer one.
    fn refresh(&self, py: Python<'_>) -> PyResult<bool> {
        let before = self.get()?.tree.commit().map(|commit| commit.number);
        if before.is_none() || self.commit.is_some() {
            return Ok(false);
        }
        let now = py.detach(|| self.open(None)).or_raise()?;
        let is_newer = now.tree.commit().map(|commit| commit.number) != before;
        if is_newer {
            self.set(Some(now));
        }
        Ok(is_newer)
    }

    /// Raises OSError if the file was overwritten since it was opened. For a remote file this is
    /// one request.
    fn check_unchanged(&self, py: Python<'_>) -> PyResult<()> {
        let opened = self.get()?;
        py.detach(|| {
            opened.tree.check_unchanged()?;
            opened.file().check_remote()
        })
        .or_raise()
    }

    /// Returns the version of the file when it was opened (length, and modification time or entity
    /// tag), then the current versions of the files that a view names.
    #[pyo3(name = "_versions")]
    fn versions(&self, py: Python<'_>) -> PyResult<Vec<Option<String>>> {
        let opened = self.get()?;
        let text = |stat: &FileStat| format!("{} {:?}", stat.length, stat.version);
        let file = opened.file();
        let of_list = || file.listed_state().map(|state| format!("{state:x}"));
        let mut all = vec![file.version().map(text).or_else(of_list)];
        let named: Vec<_> =
            self.steps.iter().flat_map(ViewOperation::files).map(|path| file_of(path).into_owned()).collect();
        let named: Vec<&Path> = named.iter().map(|path| &**path).collect();
        for found in py.detach(|| self.remote.options().access.stat(&named)).or_raise()? {
            all.push(found.or_raise()?.as_ref().map(text));
        }
        Ok(all)
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

    #[getter]
    fn view(&self) -> Vec<String> {
        self.steps.iter().map(ViewOperation::to_string).collect()
    }

    #[getter]
    fn positioned(&self) -> bool {
        self.positioned
    }

    /// Returns the names of the file's layers.
    #[getter]
    fn names(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let opened = self.get()?;
        // (A view has one layer, but the same operations can be applied to the file's other
        // layers.)
        let layers = match self.steps.is_empty() {
            true => opened.tree.layers().or_raise()?,
            false => {
                let (opened, path, steps) = (RwLock::new(None), self.path.clone(), Vec::new());
                let (commit, positioned) = (self.commit, self.positioned);
                let remote = self.remote.clone_ref(py);
                let file = Tree { opened, path, steps, commit, positioned, layer: None, remote };
                py.detach(|| file.open(None).and_then(|file| file.tree.layers())).or_raise()?
            }
        };
        Ok(layers.into_iter().map(|layer| layer.name).collect())
    }

    /// Returns the name of the current layer; empty for an only layer without a name.
    #[getter]
    fn layer(&self) -> PyResult<String> {
        Ok(self.get()?.tree.metadata().name.clone())
    }

    /// Returns the acquisition time of the content, if known.
    #[getter]
    fn time(&self) -> PyResult<Option<String>> {
        Ok(self.get()?.tree.metadata().time.clone())
    }

    /// Returns the number of the commit that is read; `None` if the file has no commits.
    #[getter]
    fn commit(&self) -> PyResult<Option<u64>> {
        Ok(self.get()?.tree.commit().map(|commit| commit.number))
    }

    #[getter]
    fn dtype<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(samples::dtype(py, self.get()?.tree.header().form.value.sample))
    }

    #[getter]
    fn count(&self) -> PyResult<usize> {
        Ok(self.get()?.count())
    }

    #[getter]
    fn depth(&self) -> PyResult<u8> {
        Ok(self.get()?.tree.depth())
    }

    /// Returns whether the numbers of a level are approximate.
    #[pyo3(name = "_is_approximate")]
    fn is_approximate(&self, level: u8) -> PyResult<bool> {
        Ok(self.get()?.tree.is_approximate(level))
    }

    /// Returns the rows and columns of a level, in octrees with planes first.
    #[pyo3(name = "_shape_at")]
    fn shape_at(&self, level: Option<i64>) -> PyResult<Vec<u64>> {
        let opened = self.get()?;
        let size = opened.tree.extent_at(crate::region::level_of(&opened.tree, level)?).max;
        Ok(size[..opened.axes()].iter().rev().copied().collect())
    }

    /// Returns the rows of the matrix from cells (x, y, z, 1) to world coordinates.
    #[getter(_frame)]
    fn frame(&self) -> PyResult<[[f64; 4]; 3]> {
        Ok(self.get()?.tree.metadata().frame.matrix)
    }

    /// Returns the minimum and maximum world coordinates.
    #[getter(_world_box)]
    fn world_box(&self) -> PyResult<[[f64; 3]; 2]> {
        let opened = self.get()?;
        Ok(opened.tree.metadata().frame.world_box(&opened.tree.header().extent_bounds()))
    }

    #[getter]
    fn crs(&self) -> PyResult<Option<String>> {
        Ok(self.get()?.tree.metadata().frame.crs.as_ref().map(crs_text))
    }

    /// Returns the coordinate system as WKT 2, also if it is an EPSG code. A code without a known
    /// definition is an error.
    #[getter(_crs_wkt)]
    fn crs_wkt(&self) -> PyResult<Option<String>> {
        self.get()?.tree.metadata().frame.crs.as_ref().map(Crs::to_wkt2).transpose().or_raise()
    }

    #[getter]
    fn nodata<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let opened = self.get()?;
        opened.tree.metadata().nodata.map(|number| opened.to_python(py, number)).transpose()
    }

    /// Returns the number that VOID cells have in arrays.
    #[getter]
    fn fill_value<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let opened = self.get()?;
        opened.to_python(py, opened.void()?)
    }

    /// Returns whether some number is no cell's value, and hence available for VOID in arrays.
    #[pyo3(name = "_has_free_number")]
    fn has_free_number(&self, py: Python<'_>) -> PyResult<bool> {
        let opened = self.get()?;
        Ok(py.detach(|| void_number(&opened.tree)).or_raise()?.is_some())
    }

    /// Returns the sample that marks a missing channel value, if there is one.
    #[getter(_missing)]
    fn missing<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let opened = self.get()?;
        opened.missing().map(|number| opened.to_python(py, number)).transpose()
    }

    /// Returns all other metadata, by name.
    #[pyo3(name = "_facts")]
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let opened = self.get()?;
        let (header, metadata) = (opened.tree.header(), opened.tree.metadata());
        let facts = PyDict::new(py);
        facts.set_item("kind", header.kind.name())?;
        facts.set_item("rule", header.rule.name())?;
        facts.set_item("format", opened.tree.format().name())?;
        facts.set_item("file_size", opened.tree.file_size())?;
        facts.set_item("tags", metadata.tags.clone())?;
        let colours = metadata.palette.as_ref().map(|palette| {
            let colours = palette.colours.iter().map(|[r, g, b, a]| (*r, *g, *b, *a));
            colours.enumerate().collect::<BTreeMap<_, _>>()
        });
        facts.set_item("colormap", colours)?;
        let names = names_to_python(py, &metadata.class_names, header.form.value.sample)?;
        facts.set_item("categories", names.into_py_dict(py)?)?;
        facts.set_item("descriptions", metadata.band_names.clone())?;
        facts.set_item("scale_offset", metadata.scale_offset.clone())?;
        facts.set_item("units", metadata.units.clone())?;
        facts.set_item("alpha", metadata.alpha)?;
        facts.set_item("provenance", metadata.clean_provenance())?;
        Ok(facts)
    }
}
