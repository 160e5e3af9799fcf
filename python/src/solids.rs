//! Octrees as solids: measures, rays, slices, surfaces, renderings.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::Bounds;
use spinney::export::{Detail, MeshFormat, MeshRequest, RenderRequest, WindowRequest, export_mesh, render};
use spinney::query::Ray;
use spinney::raw::export::CameraProjection;
use spinney::raw::export::image::{Format, format_of};
use spinney::raw::export::mesh::surface_mesh;
use spinney::raw::ops::AffineMap;

use crate::error::{OrRaise, invalid};
use crate::jobs::{self, Terms};
use crate::numbers::PyNumber;
use crate::read::resampled_slice;
use crate::region::level_of;
use crate::tree::{Opened, Tree};

impl Opened {
    /// Fails unless this is an octree.
    pub(crate) fn check_octree(&self) -> PyResult<()> {
        let name = || format!("{}: is a quadtree, expected an octree", self.tree.name().display());
        if self.axes() == 3 { Ok(()) } else { Err(invalid(name())) }
    }
}

/// Vertices and triangles.
type Surface<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>);

/// Distances along rays (NaN without a hit), points, cells.
type Hits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>);

#[pymethods]
impl Tree {
    /// Returns volume, centre, bounds and, on request, the surface area of a solid, by name.
    #[pyo3(name = "_measure")]
    fn measure<'py>(
        &self,
        py: Python<'py>,
        level: Option<i64>,
        surface: bool,
        terms: Terms,
    ) -> PyResult<Bound<'py, PyDict>> {
        let opened = self.get()?;
        opened.check_octree()?;
        let level = level_of(&opened.tree, level)?;
        let (solid, surface) = jobs::run(py, terms, |work| {
            let solid = opened.tree.solid(level, work)?;
            let surface = surface.then(|| opened.tree.solid_surface(level, work)).transpose()?;
            opened.tree.check_unchanged()?;
            Ok((solid, surface))
        })?;
        let facts = PyDict::new(py);
        facts.set_item("level", solid.level)?;
        facts.set_item("cells", solid.cells)?;
        let is_known = opened.tree.metadata().frame.cell_volume().is_ok();
        facts.set_item("volume", if is_known { solid.world_volume() } else { f64::NAN })?;
        facts.set_item("volume_cells", solid.volume)?;
        facts.set_item("centre", solid.world_centre())?;
        facts.set_item("bounds", solid.world_bounds())?;
        let known = |area: f64| if is_known { area } else { f64::NAN };
        facts.set_item("area", surface.as_ref().map(|surface| known(surface.smooth_area())))?;
        facts.set_item("block_area", surface.as_ref().map(|surface| known(surface.block_area())))?;
        Ok(facts)
    }

    /// Casts rays, in world coordinates, at full cells or at the smooth surface.
    #[pyo3(name = "_cast_rays")]
    fn cast_rays<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        level: Option<i64>,
        smooth: bool,
    ) -> PyResult<Hits<'py>> {
        /// Rays cast between checks for signals, for a file and for a view, in which each may be
        /// expensive.
        const BATCHES: [usize; 2] = [1 << 14, 1 << 8];
        let opened = self.get()?;
        let batch = BATCHES[usize::from(opened.is_view)];
        opened.check_octree()?;
        let level = level_of(&opened.tree, level)?;
        let frame = opened.tree.metadata().frame.coarser(opened.tree.depth() - level);
        let inverse = AffineMap::from_rows(frame.matrix).inverse().or_raise()?.to_rows();
        let (origins, directions) = (origins.as_slice()?, directions.as_slice()?);
        let is_direction = |d: &[f64]| d.iter().all(|x| x.is_finite()) && d.iter().any(|x| *x != 0.0);
        if !directions.chunks_exact(3).all(is_direction) || !origins.iter().all(|x| x.is_finite()) {
            return Err(invalid("rays: expected finite origins, and directions other than 0"));
        }
        let total = origins.len() / 3;
        let mut rays = py.detach(|| opened.tree.rays(level)).or_raise()?;
        let (mut distances, mut points) = (vec![f64::NAN; total], vec![f64::NAN; 3 * total]);
        let mut hit_cells = vec![-1i64; 3 * total];
        for first in (0..total).step_by(batch) {
            py.detach(|| -> spinney::Result<()> {
                for index in first..total.min(first + batch) {
                    let of = |numbers: &[f64]| -> [f64; 3] {
                        std::array::from_fn(|axis| numbers[3 * index + axis])
                    };
                    let (origin, direction) = (of(origins), of(directions));
                    let linear = |m: &[f64; 4], p: [f64; 3]| m[0] * p[0] + m[1] * p[1] + m[2] * p[2];
                    let ray = Ray {
                        origin: std::array::from_fn(|axis| linear(&inverse[axis], origin) + inverse[axis][3]),
                        direction: std::array::from_fn(|axis| linear(&inverse[axis], direction)),
                    };
                    // The map is affine: distances in units of the direction's length are equal in
                    // both spaces.
                    let hit = if smooth {
                        rays.surface(&ray)?.map(|hit| (hit.t, hit.point.map(|number| number.floor() as i64)))
                    } else {
                        rays.cell(&ray)?.map(|hit| (hit.t, hit.cell.map(i64::from)))
                    };
                    if let Some((t, cell)) = hit {
                        distances[index] = t;
                        for axis in 0..3 {
                            points[3 * index + axis] = origin[axis] + t * direction[axis];
                            hit_cells[3 * index + axis] = cell[axis];
                        }
                    }
                }
                Ok(())
            })
            .or_raise()?;
            py.check_signals()?;
        }
        drop(rays);
        opened.tree.check_unchanged().or_raise()?;
        Ok((
            PyArray1::from_vec(py, distances),
            PyArray1::from_vec(py, points).reshape([total, 3])?,
            PyArray1::from_vec(py, hit_cells).reshape([total, 3])?,
        ))
    }

    /// Returns a slice across an axis (0 is x), at a cell of the deepest level or at a world
    /// coordinate.
    #[allow(clippy::too_many_arguments)] // as in Python
    #[pyo3(name = "_slice_across")]
    fn slice_across<'py>(
        &self,
        py: Python<'py>,
        across: usize,
        at: f64,
        coordinates: &str,
        level: Option<i64>,
        masked: bool,
        fill: Option<PyNumber>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let opened = self.get()?;
        opened.check_octree()?;
        let tree = &opened.tree;
        let level = level_of(tree, level)?;
        let extent = tree.header().extent;
        let cell = if coordinates == "world" {
            let [low, high] = tree.metadata().frame.world_box(&tree.header().extent_bounds());
            let mut middle: [f64; 3] = std::array::from_fn(|axis| low[axis].midpoint(high[axis]));
            middle[across] = at;
            let cell = tree.metadata().frame.to_cells(middle);
            cell.ok_or_else(|| invalid("the file's transform has no inverse"))?[across].floor()
        } else {
            at
        };
        if cell.fract() != 0.0 || !(0.0..extent[across] as f64).contains(&cell) {
            let max = extent[across] - 1;
            return Err(PyIndexError::new_err(format!(
                "slice: got cell {cell}, expected an integer, 0 to {max}"
            )));
        }
        let mut bounds = Bounds::of_extent(extent);
        (bounds.min[across], bounds.max[across]) = (cell as u64, cell as u64 + 1);
        let mut request = WindowRequest::new(bounds, Detail::Level(level));
        request.across = across;
        request.nodata = Some(if masked { opened.fill(fill)? } else { opened.plain_fill(fill)? });
        resampled_slice(py, &opened, &request, level, masked)
    }

    /// Returns the surface as vertices and triangles.
    #[pyo3(name = "_surface_arrays")]
    fn surface_arrays<'py>(
        &self,
        py: Python<'py>,
        level: Option<i64>,
        smooth: bool,
        terms: Terms,
    ) -> PyResult<Surface<'py>> {
        let opened = self.get()?;
        opened.check_octree()?;
        let mut request = MeshRequest::new();
        request.level = Some(level_of(&opened.tree, level)?);
        request.smooth = smooth;
        let mesh = jobs::run(py, terms, |work| surface_mesh(&opened.tree, &request, work))?;
        let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        let coordinates = mesh.vertices.into_iter().flatten();
        let corners = mesh.triangles.into_iter().flatten().map(i64::from);
        Ok((
            PyArray1::from_iter(py, coordinates).reshape([vertices, 3])?,
            PyArray1::from_iter(py, corners).reshape([triangles, 3])?,
        ))
    }

    /// Writes the surface as a mesh; returns the number of vertices and faces.
    #[pyo3(name = "_write_mesh")]
    fn write_mesh(
        &self,
        py: Python<'_>,
        path: PathBuf,
        level: Option<i64>,
        smooth: bool,
        triangles: bool,
        terms: Terms,
    ) -> PyResult<(u64, u64)> {
        let opened = self.get()?;
        opened.check_octree()?;
        let format = MeshFormat::of(&path);
        let format =
            format.ok_or_else(|| invalid(format!("{}: use .ply, .obj, .stl or .off", path.display())))?;
        let mut request = MeshRequest::new();
        request.level = Some(level_of(&opened.tree, level)?);
        (request.smooth, request.triangles) = (smooth, triangles);
        let made = jobs::run(py, terms, |work| {
            export_mesh(&opened.tree, &request, work.create(&path)?, format, work)
        })?;
        Ok((made.vertices, made.faces))
    }

    /// Writes a shaded image; returns the level that was drawn.
    #[allow(clippy::too_many_arguments)] // as in Python
    #[pyo3(name = "_write_render")]
    fn write_render(
        &self,
        py: Python<'_>,
        path: PathBuf,
        size: [u64; 2],
        direction: [f64; 2],
        level: Option<i64>,
        scale: f64,
        orthographic: bool,
        up: &str,
        background: Option<[u8; 3]>,
        samples: u32,
        terms: Terms,
    ) -> PyResult<u8> {
        let opened = self.get()?;
        opened.check_octree()?;
        let format: Option<Format> = format_of(&path);
        let format =
            format.ok_or_else(|| invalid(format!("{}: use .png, .tif, .npy or .raw", path.display())))?;
        let mut request = RenderRequest::new(size[0], size[1]);
        [request.azimuth, request.elevation] = direction;
        request.scale = scale;
        if orthographic {
            request.projection = CameraProjection::Orthographic;
        }
        request.up = up.parse().map_err(|error: spinney::Error| crate::error::raised(error))?;
        request.level = level.map(|level| level_of(&opened.tree, Some(level))).transpose()?;
        request.background = background;
        request.samples = samples;
        jobs::run(py, terms, |work| render(&opened.tree, &request, work.create(&path)?, format, work))
    }
}
