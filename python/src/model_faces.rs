//! Faces of exact models as arrays.

use std::collections::{BTreeSet, HashMap};

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::brep::{Face, FaceBuffer, Faces};
use spinney::raw::brep::ModelNode;
use spinney::raw::geometry::{Triangulator, join_rings};
use spinney::{ExactModel, Progress, Result};

use crate::error::OrRaise;
use crate::jobs::{self, Terms};
use crate::model::Model;

/// Box in world coordinates: minimum and maximum.
type WorldBox = [[f64; 3]; 2];

/// Output arrays of faces.
#[derive(Default)]
struct Lists {
    known: HashMap<[i32; 3], i64>,
    vertices: Vec<f64>,
    corners: Vec<i64>,
    ring_ends: Vec<i64>,
    face_ends: Vec<i64>,
    numbers: Vec<i64>,
    parts: Vec<i64>,
    sources: Vec<i64>,
    colours: Vec<u8>,
}

impl Lists {
    /// Returns the number of the vertex at a grid point.
    fn vertex(&mut self, model: &ExactModel, point: [i32; 3]) -> i64 {
        let next = self.known.len() as i64;
        *self.known.entry(point).or_insert_with(|| {
            self.vertices.extend(model.grid().to_world(point));
            next
        })
    }

    fn push(&mut self, model: &ExactModel, face: &Face<'_>) {
        let start = self.corners.len() as i64;
        for point in face.points {
            let vertex = self.vertex(model, *point);
            self.corners.push(vertex);
        }
        self.colours.extend_from_slice(face.colours.as_flattened());
        self.ring_ends.extend(face.ring_ends.iter().map(|end| start + *end as i64));
        self.face_ends.push(self.ring_ends.len() as i64);
        self.numbers.push(face.number as i64);
        self.parts.push(face.part.into());
        self.sources.push(face.source as i64);
    }

    /// Adds a face as triangles.
    fn push_triangles(&mut self, model: &ExactModel, face: &Face<'_>, triangulator: &mut Triangulator) {
        let points: Vec<[i64; 3]> = face.points.iter().map(|point| point.map(i64::from)).collect();
        let mut triangles = Vec::new();
        if !triangulator.triangulate(&points, face.ring_ends, &mut triangles) {
            // The face has no area, or intersects itself. Its edges are kept as a fan, since
            // neighbouring faces rely on them.
            let ring = join_rings(&points, face.ring_ends);
            let rest = ring.get(1..).unwrap_or_default();
            triangles.extend(rest.windows(2).map(|pair| [ring[0], pair[0], pair[1]]));
        }
        for triangle in triangles {
            for corner in triangle {
                let vertex = self.vertex(model, face.points[corner as usize]);
                self.corners.push(vertex);
            }
            self.numbers.push(face.number as i64);
        }
    }
}

/// Returns whether two boxes intersect.
fn meet(a: &WorldBox, b: &WorldBox) -> bool {
    (0..3).all(|axis| a[0][axis] <= b[1][axis] && b[0][axis] <= a[1][axis])
}

/// Collects the numbers of the faces in those leaves that a box intersects.
fn numbers_in(
    model: &ExactModel,
    node: &ModelNode<'_>,
    part: &WorldBox,
    work: &dyn Progress,
    numbers: &mut BTreeSet<u64>,
) -> Result<()> {
    if !meet(&node.world_box(model.grid()), part) {
        return Ok(());
    }
    work.check()?;
    numbers.extend(node.faces());
    for child in model.children(node)?.iter().flatten() {
        numbers_in(model, child, part, work, numbers)?;
    }
    Ok(())
}

/// Visits all faces, or those whose own boxes intersect a box.
fn each(
    model: &ExactModel,
    part: Option<&WorldBox>,
    work: &dyn Progress,
    each: &mut dyn FnMut(&Face<'_>),
) -> Result<()> {
    let Some(part) = part else {
        model.each(&mut |face| {
            if face.number.is_multiple_of(1024) {
                work.check()?;
                work.advance(1024.min(model.len() - face.number), model.len());
            }
            each(face);
            Ok(())
        })?;
        return model.check_unchanged();
    };
    let mut numbers = BTreeSet::new();
    numbers_in(model, &model.root()?, part, work, &mut numbers)?;
    let mut buffer = FaceBuffer::default();
    for number in numbers {
        work.check()?;
        model.face(number, &mut buffer)?;
        let face = buffer.face();
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in face.points {
            let at = model.grid().to_world(*point);
            for axis in 0..3 {
                min[axis] = min[axis].min(at[axis]);
                max[axis] = max[axis].max(at[axis]);
            }
        }
        if meet(&[min, max], part) {
            each(&face);
        }
    }
    model.check_unchanged()
}

/// Vertices, triangles, and the triangles' face numbers.
type Triangles<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<i64>>);

#[pymethods]
impl Model {
    /// Returns the names of the face value columns.
    #[pyo3(name = "_face_columns")]
    fn face_columns(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let model = self.get()?;
        py.detach(|| model.file().value_columns()).or_raise()
    }

    /// Returns the values in a column, as JSON, with their face numbers.
    #[pyo3(name = "_face_values")]
    fn face_values(&self, py: Python<'_>, column: u32, terms: Terms) -> PyResult<Vec<(u32, String)>> {
        let model = self.get()?;
        jobs::run(py, terms, |work| {
            let mut all = Vec::new();
            model.file().each_face_value(column, &mut |face, json| {
                if all.len().is_multiple_of(1 << 12) {
                    work.check()?;
                }
                all.push((face, json.to_string()));
                Ok(())
            })?;
            model.file().check_unchanged()?;
            Ok(all)
        })
    }

    /// Returns faces as arrays, by name: all, or those whose boxes intersect a box.
    #[pyo3(name = "_face_arrays")]
    fn face_arrays<'py>(
        &self,
        py: Python<'py>,
        part: Option<WorldBox>,
        terms: Terms,
    ) -> PyResult<Bound<'py, PyDict>> {
        let model = self.get()?;
        let lists = jobs::run(py, terms, |work| {
            let (mut lists, model) = (Lists::default(), model.as_model("faces")?);
            each(model, part.as_ref(), work, &mut |face| lists.push(model, face))?;
            Ok(lists)
        })?;
        let facts = PyDict::new(py);
        let (vertices, corners) = (lists.known.len(), lists.corners.len());
        let has_colours = lists.colours.len() == 3 * corners && corners > 0;
        facts.set_item("vertices", PyArray1::from_vec(py, lists.vertices).reshape([vertices, 3])?)?;
        facts.set_item("corners", PyArray1::from_vec(py, lists.corners))?;
        facts.set_item("ring_ends", PyArray1::from_vec(py, lists.ring_ends))?;
        facts.set_item("face_ends", PyArray1::from_vec(py, lists.face_ends))?;
        facts.set_item("numbers", PyArray1::from_vec(py, lists.numbers))?;
        facts.set_item("parts", PyArray1::from_vec(py, lists.parts))?;
        facts.set_item("sources", PyArray1::from_vec(py, lists.sources))?;
        let colours = has_colours.then(|| PyArray1::from_vec(py, lists.colours).reshape([corners, 3]));
        facts.set_item("colours", colours.transpose()?)?;
        Ok(facts)
    }

    /// Returns triangulated faces: all, or those whose boxes intersect a box.
    #[pyo3(name = "_triangle_arrays")]
    fn triangle_arrays<'py>(
        &self,
        py: Python<'py>,
        part: Option<WorldBox>,
        terms: Terms,
    ) -> PyResult<Triangles<'py>> {
        let model = self.get()?;
        let lists = jobs::run(py, terms, |work| {
            let (mut lists, mut triangulator) = (Lists::default(), Triangulator::new());
            let model = model.as_model("faces")?;
            each(model, part.as_ref(), work, &mut |face| {
                lists.push_triangles(model, face, &mut triangulator);
            })?;
            Ok(lists)
        })?;
        let (vertices, triangles) = (lists.known.len(), lists.numbers.len());
        Ok((
            PyArray1::from_vec(py, lists.vertices).reshape([vertices, 3])?,
            PyArray1::from_vec(py, lists.corners).reshape([triangles, 3])?,
            PyArray1::from_vec(py, lists.numbers),
        ))
    }
}
