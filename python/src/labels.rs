//! Tables of labels.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use spinney::raw::ops::Connectivity;
use spinney::raw::query::LabelRequest;
use spinney::{Number, SampleType, ValueType};

use crate::error::OrRaise;
use crate::jobs::{self, Terms};
use crate::samples::{empty, with_bytes};
use crate::tree::Tree;

/// Labels, classes of components, cell counts, boxes, first cells, pairs of adjacent labels, and
/// the faces that these share; then a cell's area in square metres, or its volume, if known.
type Table<'py> = (
    Bound<'py, PyAny>,
    Option<Bound<'py, PyAny>>,
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyAny>,
    Bound<'py, PyArray1<u64>>,
    Option<f64>,
);

#[derive(Default)]
struct Columns {
    labels: Vec<Number>,
    classes: Vec<Number>,
    cells: Vec<u64>,
    boxes: Vec<i64>,
    firsts: Vec<i64>,
    pairs: Vec<Number>,
    faces: Vec<u64>,
}

#[pymethods]
impl Tree {
    /// Returns the table of all labels, or of the connected components; `connect` is the number of
    /// neighbours per cell.
    #[pyo3(name = "_labels")]
    fn labels<'py>(
        &self,
        py: Python<'py>,
        connect: Option<u64>,
        neighbours: bool,
        memory: u64,
        terms: Terms,
    ) -> PyResult<Table<'py>> {
        let opened = self.get()?;
        let axes = opened.axes();
        let mut request = LabelRequest::new();
        request.connect =
            connect.map(|connect| connect.to_string().parse::<Connectivity>()).transpose().or_raise()?;
        (request.neighbours, request.memory) = (neighbours, memory);
        let columns = jobs::run(py, terms, |work| {
            let mut columns = Columns::default();
            opened.tree.labels(&request, work, &mut |label| {
                let (bounds, own) = (label.bounds(), label.label());
                columns.labels.push(own);
                columns.classes.extend(label.class().iter().flat_map(|class| class.iter().copied()));
                columns.cells.push(label.cells());
                for corner in [bounds.min, bounds.size()] {
                    columns.boxes.extend(corner[..axes].iter().map(|cell| *cell as i64));
                }
                columns.firsts.extend(label.first_cell()[..axes].iter().map(|cell| *cell as i64));
                while let Some(neighbour) = label.next_neighbour()? {
                    columns.pairs.extend([own, neighbour.label]);
                    columns.faces.push(neighbour.faces);
                }
                Ok(())
            })?;
            Ok(columns)
        })?;
        let value = opened.tree.header().form.value;
        let sample = if request.connect.is_some() { SampleType::U64 } else { value.sample };
        let (count, pairs) = (columns.cells.len(), columns.faces.len());
        let has_classes = !columns.classes.is_empty() || request.connect.is_some() && count == 0;
        let frame = &opened.tree.metadata().frame;
        let measure = if axes == 3 { frame.cell_volume().ok() } else { frame.cell_square_metres().ok() };
        let channels = usize::from(value.channels);
        let classes = || array(py, value.sample, &[count, channels], &columns.classes);
        Ok((
            array(py, sample, &[count], &columns.labels)?,
            has_classes.then(classes).transpose()?,
            PyArray1::from_vec(py, columns.cells),
            PyArray1::from_vec(py, columns.boxes).reshape([count, 2 * axes])?,
            PyArray1::from_vec(py, columns.firsts).reshape([count, axes])?,
            array(py, sample, &[pairs, 2], &columns.pairs)?,
            PyArray1::from_vec(py, columns.faces),
            measure,
        ))
    }
}

/// Returns an array of numbers that fit a sample type.
fn array<'py>(
    py: Python<'py>,
    sample: SampleType,
    shape: &[usize],
    numbers: &[Number],
) -> PyResult<Bound<'py, PyAny>> {
    let values = empty(py, sample, shape)?;
    with_bytes(&values, sample, |bytes| {
        let value_type = ValueType::new(sample, 1);
        for (bytes, number) in bytes.chunks_exact_mut(sample.size()).zip(numbers) {
            value_type.nearest_numbers(|_| *number).write(bytes);
        }
        Ok(())
    })?;
    Ok(values)
}
