//! Point trees: open files and their metadata.

use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::points::{PointImportOptions, PointRegion, PointTree, Selection};
use spinney::raw::import::feature::plan_point_files;
use spinney::raw::points::{
    GriddedPoints, PointAttribute, PointBuildOptions, PointFormat, PointRaster, WorldPoints, attribute_index,
    export_points, is_point_file, ordered_number, plan_points, rasterize_points,
};
use spinney::raw::store::Packing;
use spinney::{Crs, Dimension, Progress as _, Result, SampleType};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, access};
use crate::region::coordinates_of;
use crate::remote::{RemoteAccess, path_object};
use crate::tree::crs_text;

/// Returns whether a file is a point tree.
#[pyfunction]
pub(crate) fn is_points(py: Python<'_>, path: PathBuf) -> PyResult<bool> {
    py.detach(|| is_point_file(&path, access())).or_raise()
}

/// Polygons: each is a list of rings, the outer one first.
type Polygons = Vec<Vec<Vec<[f64; 2]>>>;

/// Selection of points: a box, polygons, a ball, the deepest level, conditions.
#[derive(FromPyObject)]
struct Wanted(Option<[[f64; 3]; 2]>, Option<Polygons>, Option<([f64; 3], f64)>, Option<u8>, Option<String>);

impl Wanted {
    fn selection(self, tree: &PointTree) -> Result<Selection> {
        let Wanted(corners, polygons, ball, level, filter) = self;
        let region = match (corners, polygons, ball) {
            (Some(corners), ..) => PointRegion::Box(corners),
            (None, Some(parts), _) => PointRegion::Polygons(parts),
            (None, None, Some((centre, radius))) => PointRegion::Ball(centre, radius),
            (None, None, None) => PointRegion::All,
        };
        let filter: Option<FeatureFilter> = filter.map(|text| text.parse()).transpose()?;
        let conditions = filter.map(|filter| filter.for_points(tree.attributes())).transpose()?;
        Ok(Selection { region, level, conditions: conditions.unwrap_or_default() })
    }
}

/// Point tree in an open file; any number of threads can query it.
#[pyclass(subclass, frozen, weakref, module = "spinney._native")]
pub(crate) struct Points {
    /// `None` when it is closed.
    opened: RwLock<Option<Arc<PointTree>>>,
    path: PathBuf,
    positioned: bool,
    remote: RemoteAccess,
}

/// Distances, a row per query point, and coordinates of the points found, concatenated.
type Near<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Number of values in a column, their minimum, maximum and mean.
type Column = Option<(u64, f64, f64, f64)>;

impl Points {
    fn get(&self) -> PyResult<Arc<PointTree>> {
        let opened = self.opened.read().unwrap_or_else(PoisonError::into_inner);
        opened.clone().ok_or_else(|| invalid(format!("{}: is closed", self.path.display())))
    }
}

fn attribute_indices(tree: &PointTree, names: Option<Vec<String>>) -> Result<Vec<usize>> {
    match names {
        None => Ok((0..tree.attributes().len()).collect()),
        Some(names) => names.iter().map(|name| attribute_index(tree.attributes(), name)).collect(),
    }
}

#[pymethods]
impl Points {
    #[new]
    #[pyo3(signature = (path, positioned, remote=RemoteAccess::default()))]
    fn new(py: Python<'_>, path: PathBuf, positioned: bool, remote: RemoteAccess) -> PyResult<Points> {
        let mut options = remote.options();
        if positioned {
            let access = options.access.clone().positioned(None);
            options = options.access(access);
        }
        let tree = py.detach(|| PointTree::open(&path, &options)).or_raise()?;
        Ok(Points { opened: RwLock::new(Some(Arc::new(tree))), path, positioned, remote })
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

    /// Returns the metadata that needs no points, by name.
    #[pyo3(name = "_facts")]
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let tree = self.get()?;
        let facts = PyDict::new(py);
        let attribute = |attribute: &PointAttribute| {
            let sample = if attribute.scale_offset.is_some() { SampleType::F64 } else { attribute.sample };
            (attribute.name.clone(), sample.name(), attribute.description.clone(), attribute.no_data())
        };
        facts.set_item("attributes", tree.attributes().iter().map(attribute).collect::<Vec<_>>())?;
        facts.set_item("axes", tree.dimension().axes())?;
        facts.set_item("depth", tree.depth())?;
        facts.set_item("duplicates", tree.duplicates())?;
        facts.set_item("leaf_size", tree.leaf_size())?;
        facts.set_item("scale", tree.grid().scale)?;
        facts.set_item("offset", tree.grid().offset)?;
        facts.set_item("crs", tree.metadata().frame.crs.as_ref().map(crs_text))?;
        facts.set_item("tags", tree.metadata().tags.clone())?;
        facts.set_item("provenance", tree.metadata().clean_provenance())?;
        Ok(facts)
    }

    /// Returns rows of points as bytes.
    #[pyo3(name = "_read")]
    fn read<'py>(
        &self,
        py: Python<'py>,
        wanted: Wanted,
        names: Option<Vec<String>>,
        terms: Terms,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let tree = self.get()?;
        let rows = jobs::run(py, terms, |work| {
            let chosen = attribute_indices(&tree, names)?;
            let mut rows = Vec::new();
            tree.select(&wanted.selection(&tree)?, Some(&chosen), work, &mut |points| {
                points.rows(tree.grid(), tree.attributes(), &chosen, &mut rows);
                Ok(())
            })?;
            Ok(rows)
        })?;
        Ok(PyArray1::from_vec(py, rows))
    }

    /// Returns the number of points.
    #[pyo3(name = "_count")]
    fn count(&self, py: Python<'_>, wanted: Wanted, terms: Terms) -> PyResult<u64> {
        let tree = self.get()?;
        jobs::run(py, terms, |work| tree.count(&wanted.selection(&tree)?, work))
    }

    /// Returns the number of points, and the summary of each column.
    #[pyo3(name = "_statistics")]
    fn statistics(&self, py: Python<'_>, wanted: Wanted, terms: Terms) -> PyResult<(u64, Vec<Column>)> {
        let tree = self.get()?;
        let found = jobs::run(py, terms, |work| tree.statistics(&wanted.selection(&tree)?, work))?;
        let column = |found: &Option<spinney::raw::points::ColumnSummary>| {
            found.map(|found| (found.count, found.min, found.max, found.mean))
        };
        Ok((found.points, found.columns.iter().map(column).collect()))
    }

    /// Returns distances and coordinates of the points nearest to query points; infinity and NaN
    /// where there are fewer.
    #[pyo3(name = "_nearest")]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'py, f64>,
        max_count: usize,
        radius: f64,
        memory: u64,
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
                "k: got {max_count} points for each of {} points, which is too many",
                positions.len()
            ))
        })?;
        let (distances, found) = jobs::run(py, terms, |work| {
            let mut distances = vec![f64::INFINITY; capacity];
            let mut found = vec![f64::NAN; 3 * capacity];
            let nearest = tree.nearest(&positions, max_count, radius, memory, work)?;
            for (index, points) in nearest.iter().enumerate() {
                for (number, point) in points.iter().enumerate() {
                    let at = index * max_count + number;
                    distances[at] = point.distance;
                    found[3 * at..3 * at + 3].copy_from_slice(&point.position);
                }
            }
            Ok((distances, found))
        })?;
        let distances = PyArray1::from_vec(py, distances).reshape([positions.len(), max_count])?;
        Ok((distances, PyArray1::from_vec(py, found)))
    }

    /// Writes points; returns their number.
    #[pyo3(name = "_write")]
    fn write(
        &self,
        py: Python<'_>,
        out: PathBuf,
        wanted: Wanted,
        names: Option<Vec<String>>,
        terms: Terms,
    ) -> PyResult<u64> {
        let tree = self.get()?;
        check_output(std::slice::from_ref(&self.path), &out)?;
        let format = PointFormat::of(&out)
            .ok_or_else(|| invalid(format!("{}: expected .las, .laz, .csv, .ply or .npy", out.display())))?;
        jobs::run(py, terms, |work| {
            let chosen = attribute_indices(&tree, names)?;
            let selection = wanted.selection(&tree)?;
            export_points(&tree, &selection, Some(&chosen), work.create(&out)?, format, work)
        })
    }

    /// Rasterizes the points; returns columns and rows.
    #[pyo3(name = "_raster")]
    fn raster(
        &self,
        py: Python<'_>,
        out: PathBuf,
        step: String,
        filter: Option<String>,
        memory: u64,
        terms: Terms,
    ) -> PyResult<[u64; 2]> {
        let tree = self.get()?;
        check_output(std::slice::from_ref(&self.path), &out)?;
        let mut raster: PointRaster = step.parse().or_raise()?;
        if let Some(filter) = filter {
            let filter: FeatureFilter = filter.parse().or_raise()?;
            raster.conditions = filter.for_points(tree.attributes()).or_raise()?;
        }
        jobs::run(py, terms, |work| {
            rasterize_points(&tree, &raster, (memory, Packing::default()), work.create_tree(&out)?, work)
        })
    }
}

/// Options of building a point tree: points per leaf, coordinate system, attribute names, memory in
/// bytes, conditions.
#[derive(FromPyObject)]
pub(crate) struct PointTerms(Option<usize>, Option<String>, Option<Vec<String>>, u64, Option<String>);

impl PointTerms {
    fn options(&self) -> Result<(PointImportOptions, FeatureFilter)> {
        let PointTerms(leaf_size, crs, attributes, memory, filter) = self;
        let mut options = PointImportOptions {
            build: PointBuildOptions { memory: *memory, ..PointBuildOptions::default() },
            attributes: attributes.clone(),
            crs: crs.as_deref().map(Crs::parse).transpose()?,
        };
        options.build.leaf_size = leaf_size.unwrap_or(options.build.leaf_size);
        Ok((options, filter.as_deref().map(str::parse).transpose()?.unwrap_or_default()))
    }
}

/// Builds a point tree from files.
#[pyfunction]
pub(crate) fn build_point_files(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    out: PathBuf,
    given: PointTerms,
    terms: Terms,
) -> PyResult<(u64, u64)> {
    check_output(&paths, &out)?;
    let built = jobs::run(py, terms, |work| {
        let (options, filter) = given.options()?;
        let features = FeatureOptions { filter, ..FeatureOptions::default() };
        let import = plan_point_files(&paths, &features, &options)?;
        import.build(work.create_tree(&out)?, work)
    })?;
    Ok((built.points, built.duplicates))
}

/// Points in arrays.
struct ArrayPoints {
    positions: Vec<f64>,
    axes: usize,
    attributes: Vec<PointAttribute>,
    columns: Vec<Vec<u8>>,
    next: usize,
}

impl WorldPoints for ArrayPoints {
    fn attributes(&self) -> &[PointAttribute] {
        &self.attributes
    }

    fn dimension(&self) -> Dimension {
        if self.axes == 3 { Dimension::Oct } else { Dimension::Quad }
    }

    fn crs(&self) -> Option<&Crs> {
        None
    }

    fn path(&self) -> &Path {
        Path::new("(array)")
    }

    fn next(&mut self, numbers: &mut [i64]) -> Result<Option<[f64; 3]>> {
        let Some(position) = self.positions.chunks_exact(self.axes).nth(self.next) else { return Ok(None) };
        let position = [position[0], position[1], position.get(2).copied().unwrap_or(0.0)];
        for ((number, attribute), column) in numbers.iter_mut().zip(&self.attributes).zip(&self.columns) {
            *number = ordered_number(attribute.sample, &column[self.next * attribute.sample.size()..]);
        }
        self.next += 1;
        Ok(Some(position))
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }
}

/// Attribute: its name, type name, and values as bytes.
type ArrayColumn<'py> = (String, String, PyReadonlyArray1<'py, u8>);

/// Builds a point tree from arrays.
#[pyfunction]
pub(crate) fn build_point_array(
    py: Python<'_>,
    positions: PyReadonlyArray2<'_, f64>,
    columns: Vec<ArrayColumn<'_>>,
    out: PathBuf,
    given: PointTerms,
    terms: Terms,
) -> PyResult<(u64, u64)> {
    let axes = positions.as_array().shape()[1];
    let positions = positions.as_slice()?.to_vec();
    let count = positions.len().checked_div(axes).unwrap_or(0);
    let (mut attributes, mut bytes) = (Vec::new(), Vec::new());
    for (name, sample, column) in &columns {
        let known = SampleType::ALL.into_iter().find(|known| known.name() == sample);
        let sample =
            known.ok_or_else(|| invalid(format!("{name}: numbers of type {sample} cannot be stored")))?;
        let column = column.as_slice()?.to_vec();
        if column.len() != count * sample.size() {
            return Err(invalid(format!("{name}: expected a number for each of {count} points")));
        }
        attributes.push(PointAttribute::new(name.clone(), sample));
        bytes.push(column);
    }
    if !(2..=3).contains(&axes) {
        return Err(invalid(format!("points: got rows of {axes} coordinates, expected 2 or 3")));
    }
    let built = jobs::run(py, terms, |work| {
        let (options, filter) = given.options()?;
        let conditions = filter.for_points(&attributes)?;
        let points = ArrayPoints { positions, axes, attributes, columns: bytes, next: 0 };
        let points = GriddedPoints::new(Box::new(points))?;
        if let Some(text) = points.rounding() {
            work.warn(&out, text);
        }
        let mut import = plan_points(Box::new(points), &[], conditions, &options)?;
        import.add_provenance("points of an array");
        if !filter.conditions.is_empty() {
            import.add_provenance(format!("points where {filter}"));
        }
        import.build(work.create_tree(&out)?, work)
    })?;
    Ok((built.points, built.duplicates))
}
