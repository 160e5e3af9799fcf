//! Ray casting in exact models, from arrays to arrays.

use std::sync::{Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use spinney::Result;
use spinney::brep::Hit;

use crate::error::invalid;
use crate::jobs::{self, Terms};
use crate::model::Model;

/// Rays between progress reports.
const BATCH: usize = 1 << 17;
/// Maximum and minimum number of rays that a thread processes between checks for cancellation.
const PART: usize = 1 << 13;
const MIN_PART: usize = 1 << 8;

/// An origin and a direction.
type Ray = [[f64; 3]; 2];

/// Distances along rays (NaN without a hit), points, faces and parts (-1 without a hit), and
/// whether rays arrive from outside.
type Hits<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<bool>>,
);

/// Output arrays.
#[derive(Default)]
struct Lists {
    distances: Vec<f64>,
    points: Vec<f64>,
    faces: Vec<i64>,
    parts: Vec<i64>,
    entering: Vec<bool>,
}

impl Lists {
    fn with_capacity(count: usize) -> Lists {
        Lists {
            distances: Vec::with_capacity(count),
            points: Vec::with_capacity(3 * count),
            faces: Vec::with_capacity(count),
            parts: Vec::with_capacity(count),
            entering: Vec::with_capacity(count),
        }
    }

    fn push(&mut self, hit: Option<&Hit>) {
        self.distances.push(hit.map_or(f64::NAN, |hit| hit.share));
        self.points.extend(hit.map_or([f64::NAN; 3], |hit| hit.point));
        self.faces.push(hit.map_or(-1, |hit| hit.face as i64));
        self.parts.push(hit.map_or(-1, |hit| hit.part.into()));
        self.entering.push(hit.is_some_and(|hit| hit.is_entry));
    }

    fn into_arrays(self, py: Python<'_>) -> PyResult<Hits<'_>> {
        let count = self.faces.len();
        Ok((
            PyArray1::from_vec(py, self.distances),
            PyArray1::from_vec(py, self.points).reshape([count, 3])?,
            PyArray1::from_vec(py, self.faces),
            PyArray1::from_vec(py, self.parts),
            PyArray1::from_vec(py, self.entering),
        ))
    }
}

/// Checks input rays.
fn check(origins: &[f64], directions: &[f64]) -> PyResult<()> {
    let is_direction = |d: &[f64]| d.iter().all(|x| x.is_finite()) && d.iter().any(|x| *x != 0.0);
    let are_rays = origins.len() == directions.len()
        && directions.chunks_exact(3).all(is_direction)
        && origins.iter().all(|x| x.is_finite());
    are_rays
        .then_some(())
        .ok_or_else(|| invalid("rays: expected finite origins, and as many directions other than 0"))
}

/// Computes results for rays on all processors: passes `query`'s result for each run of
/// consecutive rays to `take`, in input order.
fn each_part<R: Send>(
    (origins, directions): (&[f64], &[f64]),
    work: &dyn spinney::Progress,
    query: impl Fn(&[Ray]) -> Result<R> + Sync,
    mut take: impl FnMut(R),
) -> Result<()> {
    let (origins, directions) = (origins.as_chunks::<3>().0, directions.as_chunks::<3>().0);
    let total = origins.len() as u64;
    for (origins, directions) in origins.chunks(BATCH).zip(directions.chunks(BATCH)) {
        let part = (origins.len() / (8 * rayon::current_num_threads())).clamp(MIN_PART, PART);
        let parts: Vec<R> = origins
            .par_chunks(part)
            .zip(directions.par_chunks(part))
            .map(|(origins, directions)| {
                work.check()?;
                let rays: Vec<Ray> =
                    origins.iter().zip(directions).map(|(at, along)| [*at, *along]).collect();
                query(&rays)
            })
            .collect::<Result<_>>()?;
        parts.into_iter().for_each(&mut take);
        work.advance(origins.len() as u64, total);
    }
    Ok(())
}

#[pymethods]
impl Model {
    /// Returns the first hits of rays.
    #[pyo3(name = "_cast_rays")]
    fn cast_rays<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        terms: Terms,
    ) -> PyResult<Hits<'py>> {
        let model = self.get()?;
        let (origins, directions) = (origins.as_slice()?, directions.as_slice()?);
        check(origins, directions)?;
        let lists = jobs::run(py, terms, |work| {
            let mut lists = Lists::with_capacity(origins.len() / 3);
            // Each thread has a caster, whose cache serves all of its rays.
            let casters = Mutex::new(Vec::new());
            let first = |rays: &[Ray]| {
                let caster = casters.lock().unwrap_or_else(PoisonError::into_inner).pop();
                let mut caster = caster.unwrap_or_else(|| model.rays());
                let hits = caster.first_of(rays);
                casters.lock().unwrap_or_else(PoisonError::into_inner).push(caster);
                hits
            };
            each_part((origins, directions), work, first, |hits| {
                hits.iter().for_each(|hit| lists.push(hit.as_ref()));
            })?;
            model.file().check_unchanged()?;
            Ok(lists)
        })?;
        lists.into_arrays(py)
    }

    /// Returns all points where rays cross the surface, and their number per ray.
    #[pyo3(name = "_cross_rays")]
    fn cross_rays<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        terms: Terms,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, Hits<'py>)> {
        let model = self.get()?;
        let (origins, directions) = (origins.as_slice()?, directions.as_slice()?);
        check(origins, directions)?;
        let (counts, lists) = jobs::run(py, terms, |work| {
            let (mut counts, mut lists) = (Vec::with_capacity(origins.len() / 3), Lists::default());
            let all = |rays: &[Ray]| {
                rays.iter()
                    .map(|[from, along]| model.ray_crossings(*from, *along))
                    .collect::<Result<Vec<_>>>()
            };
            each_part((origins, directions), work, all, |crossings| {
                for hits in crossings {
                    counts.push(hits.len() as i64);
                    hits.iter().for_each(|hit| lists.push(Some(hit)));
                }
            })?;
            model.file().check_unchanged()?;
            Ok((counts, lists))
        })?;
        Ok((PyArray1::from_vec(py, counts), lists.into_arrays(py)?))
    }
}
