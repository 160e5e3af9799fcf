//! Faces of exact models as arrays.

use std::collections::HashMap;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::brep::{DetailLevel, Face, Faces, Grid, ModelSurface, SurfaceDetail};
use spinney::raw::geometry::{Triangulator, join_rings};
use spinney::{Progress, Result};

use crate::error::{OrRaise, invalid};
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
    fn vertex(&mut self, grid: &Grid, point: [i32; 3]) -> i64 {
        let next = self.known.len() as i64;
        *self.known.entry(point).or_insert_with(|| {
            self.vertices.extend(grid.to_world(point));
            next
        })
    }

    fn push(&mut self, grid: &Grid, face: &Face<'_>) {
        let start = self.corners.len() as i64;
        for point in face.points {
            let vertex = self.vertex(grid, *point);
            self.corners.push(vertex);
        }
        self.colours.extend_from_slice(face.colours.as_flattened());
        self.ring_ends.extend(face.ring_ends.iter().map(|end| start + *end as i64));
        self.face_ends.push(self.ring_ends.len() as i64);
        self.numbers.push(face.number as i64);
        self.parts.push(face.part.into());
        self.sources.push(face.source as i64);
    }

    /// Adds a face as triangles, each with the number and the part of the face.
    fn push_triangles(&mut self, grid: &Grid, face: &Face<'_>, triangulator: &mut Triangulator) {
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
                let vertex = self.vertex(grid, face.points[corner as usize]);
                self.corners.push(vertex);
                self.colours.extend(face.colours.get(corner as usize).into_iter().flatten());
            }
            self.numbers.push(face.number as i64);
            self.parts.push(face.part.into());
        }
    }
}

/// Visits the faces of a surface. Some faces of the exact surface keep their numbers.
fn each(surface: &ModelSurface<'_>, work: &dyn Progress, each: &mut dyn FnMut(&Face<'_>)) -> Result<()> {
    let mut numbers = surface.numbers_of_faces();
    surface.each(&mut |face| {
        if face.number.is_multiple_of(1024) {
            work.check()?;
            work.advance(1024.min(surface.len() - face.number), surface.len());
        }
        let number = numbers.as_mut().and_then(Iterator::next).map_or(face.number, u64::from);
        each(&Face { number, ..*face });
        Ok(())
    })
}

/// Level of detail: faces, error, bytes, vanished bodies, and a bound of their diameter.
type LevelRow = (u64, f64, u64, u64, f64);

/// Detail of a surface: the maximum error, the maximum number of faces, or the level.
pub(crate) type DetailChoice = (Option<f64>, Option<i64>, Option<i64>);

/// Returns the detail that is chosen.
pub(crate) fn detail_of(choice: DetailChoice) -> PyResult<SurfaceDetail> {
    Ok(match choice {
        (None, None, None) => SurfaceDetail::Exact,
        (Some(error), None, None) => SurfaceDetail::Error(error),
        (None, Some(faces), None) => match u64::try_from(faces) {
            Ok(faces) => SurfaceDetail::Faces(faces),
            Err(_) => return Err(invalid(format!("faces: got {faces}, expected a number of faces"))),
        },
        (None, None, Some(level)) => match u8::try_from(level) {
            Ok(level) => SurfaceDetail::Level(level),
            Err(_) => return Err(invalid(format!("level: got {level}, expected a level of `levels`"))),
        },
        _ => return Err(invalid("error, faces, level: got several, expected one of them")),
    })
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
            let surface = model.surface(SurfaceDetail::Exact, part, work)?;
            each(&surface, work, &mut |face| lists.push(model.grid(), face))?;
            model.check_unchanged()?;
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
            let surface = model.surface(SurfaceDetail::Exact, part, work)?;
            each(&surface, work, &mut |face| {
                lists.push_triangles(model.grid(), face, &mut triangulator);
            })?;
            model.check_unchanged()?;
            Ok(lists)
        })?;
        let (vertices, triangles) = (lists.known.len(), lists.numbers.len());
        Ok((
            PyArray1::from_vec(py, lists.vertices).reshape([vertices, 3])?,
            PyArray1::from_vec(py, lists.corners).reshape([triangles, 3])?,
            PyArray1::from_vec(py, lists.numbers),
        ))
    }

    /// Returns the levels of detail, coarsest first.
    #[pyo3(name = "_levels")]
    fn levels(&self) -> PyResult<Vec<LevelRow>> {
        let view = self.get()?;
        let model = view.as_model("levels of detail").or_raise()?;
        let width = model.grid().width();
        let row = |level: &DetailLevel| {
            let DetailLevel { faces, error, bytes, vanished, vanished_diameter, .. } = *level;
            (faces, error * width, bytes, vanished, vanished_diameter * width)
        };
        Ok(model.levels().iter().map(row).collect())
    }

    /// Returns a surface at a level of detail as triangles, by name; without a detail, the exact
    /// one. A box selects clusters that touch it, or faces of the exact surface.
    #[pyo3(name = "_mesh_arrays")]
    fn mesh_arrays<'py>(
        &self,
        py: Python<'py>,
        choice: DetailChoice,
        part: Option<WorldBox>,
        terms: Terms,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (view, detail) = (self.get()?, detail_of(choice)?);
        let (lists, error) = jobs::run(py, terms, |work| {
            let (mut lists, mut triangulator) = (Lists::default(), Triangulator::new());
            let model = view.as_model("faces")?;
            let mut push = |face: &Face<'_>| lists.push_triangles(model.grid(), face, &mut triangulator);
            let surface = model.surface(detail, part, work)?;
            each(&surface, work, &mut push)?;
            model.check_unchanged()?;
            let error = surface.error();
            Ok((lists, error))
        })?;
        let facts = PyDict::new(py);
        let (vertices, triangles) = (lists.known.len(), lists.numbers.len());
        let has_colours = lists.colours.len() == 9 * triangles && triangles > 0;
        facts.set_item("vertices", PyArray1::from_vec(py, lists.vertices).reshape([vertices, 3])?)?;
        facts.set_item("faces", PyArray1::from_vec(py, lists.corners).reshape([triangles, 3])?)?;
        facts.set_item("parts", PyArray1::from_vec(py, lists.parts))?;
        let colours = has_colours.then(|| PyArray1::from_vec(py, lists.colours).reshape([triangles, 3, 3]));
        facts.set_item("colours", colours.transpose()?)?;
        facts.set_item("error", error)?;
        Ok(facts)
    }
}
