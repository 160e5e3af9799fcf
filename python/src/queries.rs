//! Points, statistics, histograms, searches, commits.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::query::{Condition, FoundBlock, PointSamples};
use spinney::raw::ops::{AffineMap, ViewSource};
use spinney::{Bounds, CellLocator, Coordinates, Number, Value, ValueType};

use crate::error::{OrRaise, invalid};
use crate::features_over::FeatureTerms;
use crate::jobs::{self, Terms, Work};
use crate::numbers::PyNumber;
use crate::region::{coordinates_of, level_of, region_of};
use crate::samples::{empty, with_bytes};
use crate::tree::{Opened, Tree};

/// Points read between checks for signals, for a file and for a view, in which each may be
/// expensive.
const BATCHES: [usize; 2] = [1 << 18, 1 << 13];

/// Samples of points, and flags for the points that have any.
pub(crate) type Sampled<'py> = (Bound<'py, PyAny>, Bound<'py, PyArray1<bool>>);

#[pymethods]
impl Tree {
    /// Returns the values at points, a row each, and flags that are `false` for VOID. Points are in
    /// world coordinates, or in cells of the deepest level.
    #[pyo3(name = "_sample_points")]
    fn sample_points<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        level: Option<i64>,
        coordinates: Option<&Bound<'py, PyAny>>,
        fill: Option<PyNumber>,
    ) -> PyResult<Sampled<'py>> {
        let opened = self.get()?;
        let axes = opened.axes();
        let points = points.as_slice().map_err(|error| invalid(format!("points: {error}")))?;
        let level = level_of(&opened.tree, level)?;
        let fill = opened.fill(fill)?;
        let coordinates = coordinates.map(coordinates_of).transpose()?.unwrap_or(Coordinates::World);
        let locator = Points::new(&opened, level, &coordinates)?;
        let (values, found) = values_at(py, &opened, level, fill, points.len() / axes, &mut |numbers| {
            let points = &points[numbers.start * axes..numbers.end * axes];
            points.chunks_exact(axes).map(|point| locator.cell(point)).collect()
        })?;
        opened.tree.check_unchanged().or_raise()?;
        Ok((values, found))
    }

    /// Returns exact statistics of a region, by name.
    #[pyo3(signature = (window=None, coordinates=None))]
    #[pyo3(name = "_statistics")]
    fn statistics<'py>(
        &self,
        py: Python<'py>,
        window: Option<&Bound<'py, PyAny>>,
        coordinates: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let opened = self.get()?;
        let part = region_of(&opened.tree, window, coordinates)?;
        let found = jobs::run_here(py, |work| {
            let found = opened.tree.statistics(part, work)?;
            opened.tree.check_unchanged()?;
            Ok(found)
        })?;
        let facts = PyDict::new(py);
        facts.set_item("cells", found.cells)?;
        facts.set_item("void_cells", found.void_cells)?;
        let channels = found.channels.iter().map(|c| {
            Ok((
                c.cells,
                opened.to_python(py, c.min)?,
                opened.to_python(py, c.max)?,
                c.mean,
                c.standard_deviation,
            ))
        });
        facts.set_item("channels", channels.collect::<PyResult<Vec<_>>>()?)?;
        let classes = found.classes.iter().map(|(value, cells)| Ok((opened.to_python(py, *value)?, *cells)));
        facts.set_item("classes", classes.collect::<PyResult<Vec<_>>>()?)?;
        Ok(facts)
    }

    /// Counts a region's cells in equal bins of a range, by their first sample.
    #[pyo3(signature = (bins, low, high, window=None, coordinates=None))]
    #[pyo3(name = "_count_bins")]
    fn count_bins<'py>(
        &self,
        py: Python<'py>,
        bins: usize,
        low: f64,
        high: f64,
        window: Option<&Bound<'py, PyAny>>,
        coordinates: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<u64>>> {
        if !(1..=1 << 24).contains(&bins) {
            return Err(invalid(format!("bins: got {bins}, expected 1 to {}", 1 << 24)));
        }
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(invalid(format!("range: got {low} to {high}, expected minimum and maximum")));
        }
        let opened = self.get()?;
        let part =
            region_of(&opened.tree, window, coordinates)?.unwrap_or(opened.tree.header().extent_bounds());
        let cells = jobs::run_here(py, |work| opened.tree.histogram(&part, low, high, bins, work))?;
        Ok(PyArray1::from_vec(py, cells))
    }

    /// Returns the VOID, LEAF and INNER nodes of each level of the file's tree, root first.
    #[pyo3(name = "_level_counts")]
    fn level_counts(&self, py: Python<'_>, terms: Terms) -> PyResult<Vec<[u64; 3]>> {
        let opened = self.get()?;
        if opened.is_view {
            let name = opened.tree.name().display().to_string();
            return Err(invalid(format!(
                "{name}: is a view, but only files have nodes; open the file without a view"
            )));
        }
        let counts = jobs::run(py, terms, |work| opened.tree.level_counts(u64::MAX, work))?;
        Ok(counts.map(|counts| counts.levels().to_vec()).unwrap_or_default())
    }

    /// Returns the largest blocks whose cells all meet a condition: codes, levels, first cells and
    /// sizes, values, and whether a block has a single value.
    #[pyo3(signature = (condition, number, window=None, coordinates=None, limit=None, largest=None, within=None, memory=None))]
    #[allow(clippy::too_many_arguments)] // as in Python
    #[pyo3(name = "_find_blocks")]
    fn find_blocks<'py>(
        &self,
        py: Python<'py>,
        condition: &str,
        number: PyNumber,
        window: Option<&Bound<'py, PyAny>>,
        coordinates: Option<&Bound<'py, PyAny>>,
        limit: Option<usize>,
        largest: Option<usize>,
        within: Option<FeatureTerms<'py>>,
        memory: Option<u64>,
    ) -> PyResult<Blocks<'py>> {
        let opened = self.get()?;
        let zones = within.map(FeatureTerms::read).transpose()?;
        let part = region_of(&opened.tree, window, coordinates)?;
        let PyNumber(number) = number;
        let condition = match condition {
            "above" => Condition::Above(number),
            "below" => Condition::Below(number),
            _ => Condition::Equal(number),
        };
        let found = jobs::run(py, Terms::default(), |work| {
            let (header, metadata) = (opened.tree.header(), opened.tree.metadata());
            let zones = zones.map(|zones| zones.over(header, metadata, memory.unwrap_or(256 << 20), work));
            let zones = zones.transpose()?.map(|laid| Arc::new(laid.tree));
            search(&opened, (condition, part, zones.as_ref()), limit, largest, work)
        })?;
        let axes = opened.axes();
        let boxes = found.iter().flat_map(|block| {
            let (min, size) = (block.bounds.min, block.bounds.size());
            min.into_iter().take(axes).chain(size.into_iter().take(axes)).map(|cells| cells as i64)
        });
        let boxes = PyArray1::from_iter(py, boxes).reshape([found.len(), 2 * axes])?;
        let sample = opened.tree.header().form.value.sample;
        let values = empty(py, sample, &[found.len()])?;
        with_bytes(&values, sample, |bytes| {
            let value_type = ValueType::new(sample, 1);
            for (bytes, block) in bytes.chunks_exact_mut(sample.size()).zip(&found) {
                value_type.nearest_numbers(|_| block.value.unwrap_or_default()).write(bytes);
            }
            Ok(())
        })?;
        Ok((
            found.iter().map(|block| block.code.clone()).collect(),
            PyArray1::from_iter(py, found.iter().map(|block| block.level)),
            boxes,
            values,
            PyArray1::from_iter(py, found.iter().map(|block| block.value.is_some())),
        ))
    }
}

/// Returns the values of many cells of a level, a row each, and flags that are `false` for VOID;
/// `cells` returns the cells of a range of numbers.
pub(crate) fn values_at<'py>(
    py: Python<'py>,
    opened: &Opened,
    level: u8,
    fill: Number,
    total: usize,
    cells: &mut (dyn FnMut(Range<usize>) -> Vec<[u64; 3]> + Send),
) -> PyResult<Sampled<'py>> {
    let value = opened.tree.header().form.value;
    let found = PyArray1::<bool>::zeros(py, total, false);
    let values = empty(py, value.sample, &[total, opened.count()])?;
    with_bytes(&values, value.sample, |bytes| {
        let mut lent = found.readwrite();
        let found = lent.as_slice_mut()?;
        let mut samples = PointSamples::default();
        let batch = BATCHES[usize::from(opened.is_view)];
        let parts = bytes.chunks_mut(batch * value.size()).zip(found.chunks_mut(batch));
        for ((bytes, found), first) in parts.zip((0..).step_by(batch)) {
            py.detach(|| {
                opened.tree.points(&cells(first..first + found.len()), level, &mut samples)?;
                write(&samples, value.nearest_numbers(|_| fill), bytes, found);
                Ok(())
            })
            .or_raise()?;
            py.check_signals()?;
        }
        Ok(())
    })?;
    Ok((values, found))
}

/// Codes, levels, boxes and values of blocks, and whether each has a single value.
type Blocks<'py> = (
    Vec<String>,
    Bound<'py, PyArray1<u8>>,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyAny>,
    Bound<'py, PyArray1<bool>>,
);

fn search(
    opened: &Opened,
    (condition, part, zones): (Condition, Option<Bounds>, Option<&Arc<ViewSource>>),
    limit: Option<usize>,
    largest: Option<usize>,
    work: &Work,
) -> spinney::Result<Vec<FoundBlock>> {
    let (mut all, mut by_size) = (Vec::new(), BTreeMap::new());
    let most = limit.unwrap_or(usize::MAX);
    let mut take = |block: FoundBlock| {
        match largest {
            // By level, and in traversal order within a level.
            Some(most) => {
                by_size.insert((block.level, block.code.clone()), block);
                if by_size.len() > most {
                    by_size.pop_last();
                }
            }
            None if all.len() == most => return Ok(false),
            None => all.push(block),
        }
        Ok(true)
    };
    match zones {
        Some(zones) => opened.tree.find_within(condition, zones, part, work, &mut take)?,
        None => opened.tree.find(condition, part, work, &mut take)?,
    }
    opened.tree.check_unchanged()?;
    all.extend(by_size.into_values());
    Ok(all)
}

/// Map from points to cells of a level.
struct Points {
    /// Transformation from other coordinates to the tree's own.
    locator: Option<CellLocator>,
    /// Rows of the matrix to cells of the deepest level.
    rows: [[f64; 4]; 3],
    shift: u8,
}

impl Points {
    fn new(opened: &Opened, level: u8, coordinates: &Coordinates) -> PyResult<Points> {
        let frame = &opened.tree.metadata().frame;
        let shift = opened.tree.depth() - level;
        let mut points = Points { locator: None, rows: spinney::Frame::identity().matrix, shift };
        match coordinates {
            Coordinates::Cells => {}
            Coordinates::World => {
                points.rows = AffineMap::from_rows(frame.matrix).inverse().or_raise()?.to_rows();
            }
            Coordinates::System(_) => {
                let extent = opened.tree.header().extent;
                points.locator = Some(CellLocator::new(coordinates, frame, extent).or_raise()?);
            }
        }
        Ok(points)
    }

    /// Returns the cell at a point, or one outside of every tree if there is none.
    #[inline]
    fn cell(&self, point: &[f64]) -> [u64; 3] {
        let [x, y, z] = [point[0], point[1], point.get(2).copied().unwrap_or(0.0)];
        let cell = match &self.locator {
            None => self.rows.map(|[a, b, c, d]| a * x + b * y + c * z + d),
            // (A quadtree has one plane, whatever the point's height.)
            Some(locator) => match locator.cell([x, y, z]) {
                Some([x, y, z]) => [x, y, if point.len() > 2 { z } else { 0.0 }],
                None => [f64::NAN; 3],
            },
        };
        // (NaN and negative cells are outside, as are those after the last cell: all VOID.)
        if cell.iter().all(|number| *number >= 0.0) {
            cell.map(|number| number as u64 >> self.shift)
        } else {
            [u64::MAX; 3]
        }
    }
}

/// Writes the values of cells, and whether each has one.
fn write(samples: &PointSamples, fill: Value, bytes: &mut [u8], found: &mut [bool]) {
    let width = bytes.len() / found.len().max(1);
    for (index, (bytes, found)) in bytes.chunks_exact_mut(width.max(1)).zip(found).enumerate() {
        let value = samples.value(index);
        *found = value.is_some();
        value.unwrap_or(fill).write(bytes);
    }
}
