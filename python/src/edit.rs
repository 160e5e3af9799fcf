//! Edits of Autumnal files.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{SystemTime, UNIX_EPOCH};

use numpy::{Element, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::{PyIndexError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::edit::{Edit, FillRegion, Note};
use spinney::query::Polygon;
use spinney::raw::ops::{Prefer, apply_edits};
use spinney::{CellLocator, Code, CombineOperation, Coordinates, Dataset, FileView, Number, SetOperation};

use crate::error::{OrRaise, invalid};
use crate::features_over::FeatureTerms;
use crate::files::{Reconcile, commit_facts, is_same_file, named};
use crate::jobs::{self, Terms, access};
use crate::numbers::PyNumber;
use crate::region::{coordinates_of, region_of};

/// Editor of a file. Readers see no edit before it is committed.
#[pyclass(frozen, module = "spinney._native")]
pub(crate) struct Editor {
    editor: Mutex<Option<spinney::edit::Editor>>,
    path: PathBuf,
}

impl Editor {
    /// Returns the editor, which one thread at a time can use.
    fn get(&self) -> PyResult<MutexGuard<'_, Option<spinney::edit::Editor>>> {
        let in_use = |_| {
            PyRuntimeError::new_err(format!("{}: is being edited by another thread", self.path.display()))
        };
        let editor = self.editor.try_lock().map_err(in_use)?;
        if editor.is_none() {
            return Err(PyValueError::new_err(format!("{}: is closed", self.path.display())));
        }
        Ok(editor)
    }

    fn apply(&self, py: Python<'_>, edit: Edit, terms: Terms) -> PyResult<()> {
        let mut editor = self.get()?;
        let Some(editor) = editor.as_mut() else { return Ok(()) };
        jobs::run(py, terms, |work| apply_edits(editor, &mut std::iter::once(Ok(edit)), work).map(drop))
    }

    /// Fails if `other` is the file that is being edited, without a commit number.
    fn check_other(&self, other: &Path) -> PyResult<()> {
        let name = self.path.display();
        let text = || {
            invalid(format!("{name}: is both the edited file and the source; give a commit, as in {name}@1"))
        };
        if is_same_file(other, &self.path) { Err(text()) } else { Ok(()) }
    }

    /// Returns the tree with all edits so far.
    fn tree(&self) -> PyResult<Dataset> {
        let editor = self.get()?;
        let closed = || PyValueError::new_err("is closed");
        Dataset::of(editor.as_ref().ok_or_else(closed)?.tree().into()).or_raise()
    }
}

#[pymethods]
impl Editor {
    #[new]
    fn new(py: Python<'_>, path: PathBuf, memory: u64) -> PyResult<Editor> {
        let editor = py.detach(|| spinney::edit::Editor::open_with(&path, memory, access())).or_raise()?;
        Ok(Editor { editor: Mutex::new(Some(editor)), path })
    }

    /// Writes another file's tree over a region.
    #[allow(clippy::too_many_arguments)] // as in Python
    fn paste(
        &self,
        py: Python<'_>,
        patch: PathBuf,
        steps: Vec<String>,
        at: Option<Vec<i64>>,
        void: bool,
        reconcile: Reconcile,
        terms: Terms,
    ) -> PyResult<()> {
        self.check_other(&patch)?;
        let steps = steps.iter().map(|step| step.parse().or_raise()).collect::<PyResult<Vec<_>>>()?;
        let at = match at.as_deref() {
            None => None,
            Some(&[x, y]) => Some([x, y, 0]),
            Some(&[x, y, z]) => Some([x, y, z]),
            Some(_) => return Err(invalid("at: expected (column, row), or (x, y, z) in octrees")),
        };
        let chain = FileView { steps, access: access().clone(), ..FileView::of(&patch) };
        if let Some(at) = at {
            let (size, extent) = (chain.open().or_raise()?.extent(), self.tree()?.header().extent);
            let sticks_out = |axis: usize| {
                at[axis] < 0 || at[axis].saturating_add_unsigned(size[axis]) > extent[axis] as i64
            };
            if (0..3).any(sticks_out) {
                let text =
                    format!("at: got {size:?} cells at {at:?}, which extend beyond the tree's {extent:?}");
                return Err(PyIndexError::new_err(text));
            }
        }
        self.apply(py, Edit::Paste { patch: chain, at, void, options: reconcile.options()? }, terms)
    }

    /// Sets a region to one value, or to VOID.
    #[allow(clippy::too_many_arguments)] // as in Python
    fn fill(
        &self,
        py: Python<'_>,
        value: Option<Vec<PyNumber>>,
        window: Option<&Bound<'_, PyAny>>,
        coordinates: Option<&Bound<'_, PyAny>>,
        polygon: Option<Vec<Vec<[f64; 2]>>>,
        block: Option<&str>,
        terms: Terms,
    ) -> PyResult<()> {
        let tree = self.tree()?;
        let given = coordinates.map(coordinates_of).transpose()?;
        let part = if polygon.is_some() { None } else { region_of(&tree, window, coordinates)? };
        let region = match (part, polygon, block) {
            (Some(bounds), None, None) => FillRegion::Box(bounds),
            (None, Some(rings), None) => {
                Polygon::new(&rings).or_raise()?;
                let coordinates = given.unwrap_or(Coordinates::World);
                let locator = CellLocator::new(&coordinates, &tree.metadata().frame, tree.header().extent)
                    .or_raise()?;
                let parts = locator.parts(&[rings]);
                if parts.is_empty() {
                    let text =
                        format!("polygon: is outside of the raster, which is {}", locator.bounds_text());
                    return Err(invalid(text));
                }
                // (Even-odd rule over all rings, also across polygons.)
                FillRegion::Polygon(Polygon::new(&parts.concat()).or_raise()?)
            }
            (None, None, Some(text)) => {
                let code = Code::parse(tree.header().form.dimension, text).or_raise()?;
                if code.level() > tree.depth() {
                    return Err(PyIndexError::new_err(format!(
                        "block: got {text}, expected a node of this tree"
                    )));
                }
                FillRegion::Box(code.bounds(tree.depth()))
            }
            _ => return Err(invalid("fill: expected one of window, polygon and block")),
        };
        drop(tree);
        self.apply(
            py,
            Edit::Fill(region, value.map(|samples| samples.into_iter().map(|number| number.0).collect())),
            terms,
        )
    }

    /// Sets the cells of features to values, or to VOID.
    fn fill_zones(
        &self,
        py: Python<'_>,
        zones: FeatureTerms<'_>,
        is_void: bool,
        memory: u64,
        terms: Terms,
    ) -> PyResult<()> {
        let (tree, zones) = (self.tree()?, zones.read()?);
        let mut editor = self.get()?;
        let Some(editor) = editor.as_mut() else { return Ok(()) };
        jobs::run(py, terms, |work| {
            let laid = zones.over(tree.header(), tree.metadata(), memory, work)?;
            let source = Arc::new(laid.tree);
            let difference = CombineOperation::set(SetOperation::Difference);
            let edit = if is_void { Edit::Merge(difference, source) } else { Edit::Cover(source) };
            drop(tree);
            apply_edits(editor, &mut std::iter::once(Ok(edit)), work).map(drop)
        })
    }

    /// Sets single cells to values: a row of x, y and, in octrees, z per cell, a row of values per
    /// cell; VOID without values.
    fn set(
        &self,
        py: Python<'_>,
        cells: PyReadonlyArray2<'_, i64>,
        values: Option<&Bound<'_, PyAny>>,
        terms: Terms,
    ) -> PyResult<()> {
        let axes = self.tree()?.header().form.axes();
        let (cells, values) = (cells.as_array(), values.map(rows_of).transpose()?);
        if cells.ncols() != axes || values.as_ref().is_some_and(|values| values.len() != cells.nrows()) {
            return Err(invalid(format!(
                "cells: expected rows of {axes} coordinates, and a row of values for each"
            )));
        }
        let mut values = values.map(Vec::into_iter);
        let mut edits = Vec::with_capacity(cells.nrows());
        for cell in cells.rows() {
            let mut at = [0; 3];
            for (at, number) in at.iter_mut().zip(cell) {
                *at = u64::try_from(*number).map_err(|_| {
                    PyIndexError::new_err(format!("cells: got {cell}, which is outside of the tree"))
                })?;
            }
            edits.push((at, values.as_mut().and_then(Iterator::next)));
        }
        self.apply(py, Edit::Set(edits), terms)
    }

    /// Replaces the tree by the result of a set operation on it and another tree.
    fn combine(
        &self,
        py: Python<'_>,
        operation: &str,
        other: PathBuf,
        reconcile: Reconcile,
        terms: Terms,
    ) -> PyResult<()> {
        self.check_other(&other)?;
        self.apply(py, Edit::Apply(named(operation, Prefer::First)?, other, reconcile.options()?), terms)
    }

    /// Restores the tree's state at another commit.
    fn revert(&self, py: Python<'_>, commit: u64, terms: Terms) -> PyResult<()> {
        self.apply(py, Edit::Revert(commit), terms)
    }

    /// Commits all edits, and closes the file. Returns `None` if nothing has changed.
    fn commit<'py>(
        &self,
        py: Python<'py>,
        message: String,
        author: String,
        time: Option<i64>,
    ) -> PyResult<Option<Bound<'py, PyDict>>> {
        let now = || SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|time| time.as_secs() as i64);
        let note = Note { time: time.or_else(now), author, message };
        let Some(mut editor) = self.get()?.take() else { return Ok(None) };
        let commit = py.detach(|| editor.commit(note)).or_raise()?;
        commit.map(|commit| commit_facts(py, &commit)).transpose()
    }

    /// Discards all edits, and closes the file.
    fn close(&self) -> PyResult<()> {
        if let Ok(mut editor) = self.get() {
            editor.take();
        }
        Ok(())
    }
}

/// Returns the numbers of each row of a u64, i64 or f64 array.
fn rows_of(values: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<Number>>> {
    fn rows<T: Element + Copy + Into<Number>>(values: &Bound<'_, PyArray2<T>>) -> PyResult<Vec<Vec<Number>>> {
        let lent = values.try_readonly().map_err(|error| invalid(format!("values: {error}")))?;
        let rows = lent.as_array();
        Ok(rows.rows().into_iter().map(|row| row.iter().map(|number| (*number).into()).collect()).collect())
    }
    if let Ok(values) = values.cast::<PyArray2<u64>>() {
        return rows(values);
    }
    if let Ok(values) = values.cast::<PyArray2<i64>>() {
        return rows(values);
    }
    rows(values.cast::<PyArray2<f64>>()?)
}
