//! Line trees: open files and their metadata.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use spinney::export::VectorFormat;
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::lines::{LineBuildOptions, LineFeature, LineTree, build};
use spinney::raw::import::feature::{is_feature_file, open_feature_lines};
use spinney::raw::import::mesh::{EdgeOptions, open_mesh_edges, open_with};
use spinney::raw::lines::{LineSource, LineValue, export_lines};
use spinney::raw::space::Up;
use spinney::{Crs, Metadata, Progress as _, Result};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, access};
use crate::region::coordinates_of;
use crate::remote::{RemoteAccess, path_object};
use crate::tree::crs_text;

/// Line tree in an open file; any number of threads can query it.
#[pyclass(subclass, frozen, weakref, module = "spinney._native")]
pub(crate) struct Lines {
    /// `None` when it is closed.
    opened: RwLock<Option<Arc<LineTree>>>,
    path: PathBuf,
    positioned: bool,
    remote: RemoteAccess,
}

/// Distances and feature numbers, a row per point, and the nearest points, concatenated.
type Near<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<f64>>);

/// Feature numbers, numbers of the lines that cross them, distances, and crossing points,
/// concatenated.
type Crossed<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// A feature: its number, the vertices of its lines, and the values of its attributes.
type Row<'py> = (u64, Vec<Vec<Vec<f64>>>, Vec<Bound<'py, PyAny>>);

/// Nodes of a level, their segments, the segments' length, and the maximum numbers of segments and
/// features below a node.
type Level = (u64, u64, f64, u64, u64);

impl Lines {
    fn get(&self) -> PyResult<Arc<LineTree>> {
        let opened = self.opened.read().unwrap_or_else(PoisonError::into_inner);
        opened.clone().ok_or_else(|| invalid(format!("{}: is closed", self.path.display())))
    }
}

/// Coordinates of positions, two or three of each.
fn coordinates(tree: &LineTree, positions: impl IntoIterator<Item = [f64; 3]>) -> Vec<f64> {
    let axes = tree.grid().axes();
    positions.into_iter().flat_map(|position| position.into_iter().take(axes)).collect()
}

/// Returns a value as a Python object.
fn value_of<'py>(py: Python<'py>, value: &LineValue) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        LineValue::None => py.None().into_bound(py),
        LineValue::Integer(number) => number.into_pyobject(py)?.into_any(),
        LineValue::Number(number) => number.into_pyobject(py)?.into_any(),
        LineValue::Text(text) => text.into_pyobject(py)?.into_any(),
        LineValue::Boolean(is) => is.into_pyobject(py)?.to_owned().into_any(),
        LineValue::Json(text) => py.import("json")?.call_method1("loads", (text,))?,
    })
}

#[pymethods]
impl Lines {
    #[new]
    #[pyo3(signature = (path, positioned, remote=RemoteAccess::default()))]
    fn new(py: Python<'_>, path: PathBuf, positioned: bool, remote: RemoteAccess) -> PyResult<Lines> {
        let mut options = remote.options();
        if positioned {
            let access = options.access.clone().positioned(None);
            options = options.access(access);
        }
        let tree = py.detach(|| LineTree::open(&path, &options)).or_raise()?;
        Ok(Lines { opened: RwLock::new(Some(Arc::new(tree))), path, positioned, remote })
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

    #[getter]
    fn positioned(&self) -> bool {
        self.positioned
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.get()?.len() as usize)
    }

    /// Returns the metadata that needs no lines, by name.
    #[pyo3(name = "_facts")]
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let tree = self.get()?;
        let facts = PyDict::new(py);
        let names: Vec<&str> = tree.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
        facts.set_item("attributes", names)?;
        facts.set_item("segments", tree.segments())?;
        facts.set_item("length", tree.length().or_raise()?)?;
        let bounds = tree.bounds().or_raise()?.map(|bounds| coordinates(&tree, bounds));
        facts.set_item("axes", tree.grid().axes())?;
        facts.set_item("bounds", bounds.map(|numbers| PyTuple::new(py, numbers)).transpose()?)?;
        facts.set_item("leaf_size", tree.leaf_size())?;
        facts.set_item("scale", tree.grid().scale[0])?;
        facts.set_item("crs", tree.metadata().frame.crs.as_ref().map(crs_text))?;
        facts.set_item("tags", tree.metadata().tags.clone())?;
        facts.set_item("provenance", tree.metadata().clean_provenance())?;
        Ok(facts)
    }

    /// Returns for each level the number of nodes, the number and length of their own segments, and
    /// the maximum numbers of segments and features below a node.
    #[pyo3(name = "_levels")]
    fn levels(&self) -> PyResult<Vec<Level>> {
        let levels = self.get()?.levels().or_raise()?;
        let row = |level: spinney::raw::lines::LevelTotals| {
            (level.nodes, level.segments, level.length, level.most_segments, level.most_features)
        };
        Ok(levels.into_iter().map(row).collect())
    }

    /// Returns the numbers of the features that intersect a window.
    #[pyo3(name = "_window")]
    fn window<'py>(
        &self,
        py: Python<'py>,
        window: [f64; 6],
        terms: Terms,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let tree = self.get()?;
        let [a, b, c, d, e, f] = window;
        let numbers = jobs::run(py, terms, |work| tree.window([[a, b, c], [d, e, f]], work))?;
        Ok(PyArray1::from_vec(py, numbers.into_iter().map(|number| number as i64).collect()))
    }

    /// Returns whole features: all, or those with the given ascending numbers.
    #[pyo3(name = "_features")]
    fn features<'py>(
        &self,
        py: Python<'py>,
        numbers: Option<Vec<u64>>,
        terms: Terms,
    ) -> PyResult<Vec<Row<'py>>> {
        let tree = self.get()?;
        let found = jobs::run(py, terms, |work| {
            let mut found: Vec<(u64, LineFeature)> = Vec::new();
            let mut all: Box<dyn Iterator<Item = u64>> = match numbers {
                Some(numbers) => Box::new(numbers.into_iter()),
                None => Box::new(0..tree.len()),
            };
            tree.features(&mut all, &mut |number, feature| {
                if found.len().is_multiple_of(1024) {
                    work.check()?;
                }
                found.push((number, feature.clone()));
                Ok(())
            })?;
            Ok(found)
        })?;
        let row = |(number, feature): (u64, LineFeature)| {
            let vertex = |vertex: &[i32; 3]| coordinates(&tree, [tree.grid().to_world(*vertex)]);
            let line = |line: &Vec<[i32; 3]>| line.iter().map(vertex).collect();
            let values = feature.values.iter().map(|value| value_of(py, value)).collect::<PyResult<_>>()?;
            Ok((number, feature.lines.iter().map(line).collect(), values))
        };
        found.into_iter().map(row).collect()
    }

    /// Returns distances, features and positions on the lines nearest to points, whose z may be
    /// NaN; infinity, -1 and NaN where there are fewer.
    #[pyo3(name = "_nearest")]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'py, f64>,
        max_count: usize,
        radius: f64,
        coordinates: &Bound<'py, PyAny>,
        terms: Terms,
    ) -> PyResult<Near<'py>> {
        let tree = self.get()?;
        let mut positions: Vec<[f64; 3]> = positions.as_slice()?.as_chunks::<3>().0.to_vec();
        let locator = tree.locator(&coordinates_of(coordinates)?).or_raise()?;
        for point in &mut positions {
            let [x, y] = locator.locate([point[0], point[1]]).or_raise()?;
            (point[0], point[1]) = (x, y);
        }
        let capacity = positions.len().checked_mul(max_count).filter(|capacity| *capacity < 1 << 40);
        let capacity = capacity.ok_or_else(|| {
            invalid(format!(
                "k: got {max_count} lines for each of {} points, which is too many",
                positions.len()
            ))
        })?;
        let (distances, features, found) = jobs::run(py, terms, |work| {
            let (mut distances, mut features) = (vec![f64::INFINITY; capacity], vec![-1; capacity]);
            let axes = tree.grid().axes();
            let mut found = vec![f64::NAN; axes * capacity];
            for (index, lines) in tree.nearest(&positions, max_count, radius, work)?.iter().enumerate() {
                for (number, line) in lines.iter().enumerate() {
                    let at = index * max_count + number;
                    distances[at] = line.distance;
                    features[at] = line.feature as i64;
                    found[axes * at..axes * (at + 1)].copy_from_slice(&line.position[..axes]);
                }
            }
            Ok((distances, features, found))
        })?;
        let shape = [positions.len(), max_count];
        let distances = PyArray1::from_vec(py, distances).reshape(shape)?;
        Ok((distances, PyArray1::from_vec(py, features).reshape(shape)?, PyArray1::from_vec(py, found)))
    }

    /// Returns crossings with lines, whose z may be NaN, or lines within a distance of them:
    /// feature numbers, line numbers, distances, and points.
    #[pyo3(name = "_crossings")]
    fn crossings<'py>(
        &self,
        py: Python<'py>,
        lines: Vec<PyReadonlyArray2<'py, f64>>,
        within: f64,
        terms: Terms,
    ) -> PyResult<Crossed<'py>> {
        let tree = self.get()?;
        let mut all: Vec<Vec<[f64; 3]>> = Vec::with_capacity(lines.len());
        for line in &lines {
            all.push(line.as_slice()?.as_chunks::<3>().0.to_vec());
        }
        let found = jobs::run(py, terms, |work| tree.crossings(&all, within, work))?;
        let features = found.iter().map(|crossing| crossing.feature as i64).collect();
        let lines = found.iter().map(|crossing| crossing.line as i64).collect();
        let distances = found.iter().map(|crossing| crossing.distance).collect();
        let positions = coordinates(&tree, found.iter().map(|crossing| crossing.position));
        Ok((
            PyArray1::from_vec(py, features),
            PyArray1::from_vec(py, lines),
            PyArray1::from_vec(py, distances),
            PyArray1::from_vec(py, positions),
        ))
    }

    /// Writes whole features, all or those with the given ascending numbers; returns their number.
    #[pyo3(name = "_write")]
    fn write(
        &self,
        py: Python<'_>,
        out: PathBuf,
        numbers: Option<Vec<u64>>,
        names: Option<Vec<String>>,
        terms: Terms,
    ) -> PyResult<u64> {
        let tree = self.get()?;
        check_output(std::slice::from_ref(&self.path), &out)?;
        let format = VectorFormat::of(&out).ok_or_else(|| {
            let formats = ".geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply";
            invalid(format!("{}: expected {formats}", out.display()))
        })?;
        jobs::run(py, terms, |work| {
            export_lines(&tree, numbers.as_deref(), names.as_deref(), work.create(&out)?, format, work)
        })
    }
}

/// Options of building a line tree: segments per leaf, coordinate system, attribute names, memory
/// in bytes, conditions, and what the features were made from.
#[derive(FromPyObject)]
pub(crate) struct LineTerms(Option<usize>, Option<String>, Option<Vec<String>>, u64, Option<String>, String);

/// Builds a line tree from a feature file, or from the edges of a mesh; returns the number of
/// features and segments, and the length.
#[pyfunction]
pub(crate) fn build_line_file(
    py: Python<'_>,
    path: PathBuf,
    out: PathBuf,
    given: LineTerms,
    terms: Terms,
) -> PyResult<(u64, u64, f64)> {
    check_output(std::slice::from_ref(&path), &out)?;
    let built = jobs::run(py, terms, |work| {
        let LineTerms(leaf_size, crs, attributes, memory, filter, from) = &given;
        let filter: FeatureFilter = filter.as_deref().map(str::parse).transpose()?.unwrap_or_default();
        let attributes = attributes.clone();
        let features = FeatureOptions { filter, attributes, ..FeatureOptions::default() };
        let crs = crs.as_deref().map(Crs::parse).transpose()?;
        let mut source: Box<dyn LineSource> = if is_feature_file(&path) {
            Box::new(open_feature_lines(&path, &features, crs.as_ref(), work)?)
        } else {
            let edges = EdgeOptions { up: Up::Z, crs, memory: *memory, output: out.clone() };
            Box::new(open_mesh_edges(&mut *open_with(&path, *memory, access())?, &edges, work)?)
        };
        let mut options = LineBuildOptions { memory: *memory, ..LineBuildOptions::default() };
        options.leaf_size = leaf_size.unwrap_or(options.leaf_size);
        let mut metadata = Metadata::default();
        metadata.frame.crs = source.schema().crs.clone();
        metadata.provenance = vec![from.clone()];
        let built = build(&mut *source, &options, &metadata, work.create_tree(&out)?, work)?;
        source.remarks().iter().for_each(|remark| work.warn(&path, remark));
        Result::Ok(built)
    })?;
    Ok((built.features, built.segments, built.length))
}
