//! Points, statistics, histograms, searches, commits.

use std::collections::BTreeMap;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::ops::AffineMap;
use spinney::query::{Condition, FoundBlock, PointSamples};
use spinney::space::Bounds;
use zerocopy::FromBytes;

use crate::error::{OrRaise, invalid};
use crate::part::{level_of, part_of};
use crate::samples::{Plain, empty, with_bytes, with_sample};
use crate::tree::{Opened, Tree};

/// Points that are answered at a time, before signals are looked at.
const BATCH: usize = 1 << 18;

/// Samples of points, and which points have any.
type Sampled<'py> = (Bound<'py, PyAny>, Bound<'py, PyArray1<bool>>);

#[pymethods]
impl Tree {
    /// Values at points, one row each, and flags that are `false` where there is VOID. Points are in the world, or
    /// cells of the deepest level.
    #[pyo3(name = "_sample_points")]
    fn sample_points<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        level: Option<i64>,
        in_cells: bool,
        fill: Option<f64>,
    ) -> PyResult<Sampled<'py>> {
        let opened = self.get()?;
        let axes = opened.axes();
        let points = points.as_slice().map_err(|error| invalid(format!("points: {error}")))?;
        let level = level_of(&opened.tree, level)?;
        let fill = opened.fill(fill)?;
        let places = Places::new(&opened, level, in_cells)?;
        let value = opened.tree.header().form.value;
        let total = points.len() / axes;
        let found = PyArray1::<bool>::zeros(py, total, false);
        let values = empty(py, value.sample, &[total, opened.count()])?;
        with_bytes(&values, value.sample, |bytes| {
            let mut lent = found.readwrite();
            let found = lent.as_slice_mut()?;
            let (mut samples, mut cells) = (PointSamples::default(), Vec::new());
            let parts = points.chunks(BATCH * axes);
            let parts = parts.zip(bytes.chunks_mut(BATCH * value.size())).zip(found.chunks_mut(BATCH));
            for ((points, bytes), found) in parts {
                py.detach(|| {
                    cells.clear();
                    cells.extend(points.chunks_exact(axes).map(|point| places.cell(point)));
                    opened.tree.points(&cells, level, &mut samples)?;
                    with_sample!(value.sample, S => write::<S>(&samples, fill, bytes, found));
                    Ok(())
                })
                .or_raise()?;
                py.check_signals()?;
            }
            Ok(())
        })?;
        opened.tree.check_unchanged().or_raise()?;
        Ok((values, found))
    }

    /// Exact statistics of a part, by name.
    #[pyo3(signature = (window=None, bbox=None))]
    #[pyo3(name = "_statistics")]
    fn statistics<'py>(
        &self,
        py: Python<'py>,
        window: Option<&Bound<'py, PyAny>>,
        bbox: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let opened = self.get()?;
        let part = part_of(&opened.tree, window, bbox)?;
        let found = py.detach(|| {
            let found = opened.tree.statistics(part)?;
            opened.tree.check_unchanged()?;
            Ok(found)
        });
        let found = found.or_raise()?;
        let facts = PyDict::new(py);
        facts.set_item("cells", found.cells)?;
        facts.set_item("void_cells", found.void_cells)?;
        let channels = found.channels.iter();
        let channels: Vec<_> =
            channels.map(|c| (c.cells, c.min, c.max, c.mean, c.standard_deviation)).collect();
        facts.set_item("channels", channels)?;
        facts.set_item("classes", found.classes)?;
        Ok(facts)
    }

    /// Cells of a part whose first sample lies in each of so many equal parts of a range.
    #[pyo3(signature = (bins, low, high, window=None, bbox=None))]
    #[pyo3(name = "_count_bins")]
    fn count_bins<'py>(
        &self,
        py: Python<'py>,
        bins: usize,
        low: f64,
        high: f64,
        window: Option<&Bound<'py, PyAny>>,
        bbox: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<u64>>> {
        if !(1..=1 << 24).contains(&bins) {
            return Err(invalid(format!("bins: {bins}, expected 1 to {}", 1 << 24)));
        }
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(invalid(format!("range: {low} to {high}, expected two numbers, the least first")));
        }
        let opened = self.get()?;
        let part = part_of(&opened.tree, window, bbox)?.unwrap_or(opened.tree.header().picture());
        let cells = py.detach(|| opened.tree.histogram(&part, low, high, bins)).or_raise()?;
        Ok(PyArray1::from_vec(py, cells))
    }

    /// The largest blocks whose cells all meet a condition: codes, levels, first cells and sizes, and values (NaN where
    /// a block has several).
    #[pyo3(signature = (condition, number, window=None, bbox=None, limit=None, largest=None))]
    #[allow(clippy::too_many_arguments)] // those of the Python function
    #[pyo3(name = "_find_blocks")]
    fn find_blocks<'py>(
        &self,
        py: Python<'py>,
        condition: &str,
        number: f64,
        window: Option<&Bound<'py, PyAny>>,
        bbox: Option<&Bound<'py, PyAny>>,
        limit: Option<usize>,
        largest: Option<usize>,
    ) -> PyResult<Blocks<'py>> {
        let opened = self.get()?;
        let part = part_of(&opened.tree, window, bbox)?;
        let condition = match condition {
            "above" => Condition::Above(number),
            "below" => Condition::Below(number),
            _ => Condition::Equal(number),
        };
        let found = py.detach(|| search(&opened, condition, part, limit, largest)).or_raise()?;
        let axes = opened.axes();
        let boxes = found.iter().flat_map(|block| {
            let (min, size) = (block.bounds.min, block.bounds.size());
            min.into_iter().take(axes).chain(size.into_iter().take(axes)).map(|cells| cells as i64)
        });
        let boxes = PyArray1::from_iter(py, boxes).reshape([found.len(), 2 * axes])?;
        Ok((
            found.iter().map(|block| block.code.clone()).collect(),
            PyArray1::from_iter(py, found.iter().map(|block| block.level)),
            boxes,
            PyArray1::from_iter(py, found.iter().map(|block| block.value.unwrap_or(f64::NAN))),
        ))
    }
}

/// Codes, levels, boxes and values of blocks.
type Blocks<'py> =
    (Vec<String>, Bound<'py, PyArray1<u8>>, Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<f64>>);

fn search(
    opened: &Opened,
    condition: Condition,
    part: Option<Bounds>,
    limit: Option<usize>,
    largest: Option<usize>,
) -> spinney::Result<Vec<FoundBlock>> {
    let (mut all, mut by_size) = (Vec::new(), BTreeMap::new());
    let most = limit.unwrap_or(usize::MAX);
    opened.tree.find(condition, part, &mut |block| {
        match largest {
            // By level, and those of a level as they come.
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
    })?;
    opened.tree.check_unchanged()?;
    all.extend(by_size.into_values());
    Ok(all)
}

/// The way from points to cells of a level.
struct Places {
    /// Rows of the map to cells of the deepest level.
    rows: [[f64; 4]; 3],
    shift: u8,
}

impl Places {
    fn new(opened: &Opened, level: u8, in_cells: bool) -> PyResult<Places> {
        let frame = &opened.tree.metadata().frame;
        let shift = opened.tree.depth() - level;
        if in_cells {
            return Ok(Places { rows: spinney::space::Frame::identity().matrix, shift });
        }
        let rows = AffineMap::from_rows(frame.matrix).inverse().or_raise()?.to_rows();
        Ok(Places { rows, shift })
    }

    /// The cell at a point; one outside of every tree where there is none.
    #[inline]
    fn cell(&self, point: &[f64]) -> [u64; 3] {
        let [x, y, z] = [point[0], point[1], point.get(2).copied().unwrap_or(0.0)];
        let cell = self.rows.map(|[a, b, c, d]| a * x + b * y + c * z + d);
        // (NaN is nowhere. Before the first cell everything is as VOID as behind the last.)
        if cell.iter().all(|number| *number >= 0.0) {
            cell.map(|number| number as u64 >> self.shift)
        } else {
            [u64::MAX; 3]
        }
    }
}

fn write<S: Plain + FromF64>(samples: &PointSamples, fill: f64, bytes: &mut [u8], found: &mut [bool]) {
    let Ok(values) = <[S]>::mut_from_bytes(bytes) else { return };
    let count = values.len() / found.len().max(1);
    for (index, (values, found)) in values.chunks_exact_mut(count).zip(found).enumerate() {
        match samples.get(index) {
            Some(numbers) => {
                *found = true;
                values.iter_mut().zip(numbers).for_each(|(value, number)| *value = S::from_f64(*number));
            }
            None => values.fill(S::from_f64(fill)),
        }
    }
}

/// Samples as the nearest to a number.
pub(crate) trait FromF64 {
    fn from_f64(number: f64) -> Self;
}

macro_rules! from_f64 {
    ($($type:ty)*) => { $(impl FromF64 for $type {
        #[inline]
        fn from_f64(number: f64) -> $type {
            number as $type
        }
    })* };
}
from_f64!(u8 u16 i16 u32 i32 f32 f64);
