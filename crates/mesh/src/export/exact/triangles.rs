//! Exact models as STL: triangles in single precision.

use std::path::Path;

use glam::DVec3;

use super::survey::{bounds_of, join_bounds};
use super::{ExactSummary, Job, wide};
use crate::export::sink::{Sink, Vertex};
use crate::export::stl::Stl;
use spinney_base::io::Output;
use spinney_base::{Error, Result};
use spinney_brep::geometry::{Triangulator, join_rings};

pub(super) fn write(job: &Job<'_>, output: Output) -> Result<ExactSummary> {
    check_precision(job, output.path())?;
    let mut sink = Box::new(Stl::new(output)?);
    let grid = job.faces.grid();
    let mut summary = ExactSummary { lost_parts: job.has_parts(), ..ExactSummary::default() };
    let mut triangulator = Triangulator::new();
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    let (mut exact, mut rounded) = (Vec::<[f64; 3]>::new(), Vec::<[f32; 3]>::new());
    job.each(&mut |face| {
        summary.lost_colours |= !face.colours.is_empty();
        triangles.clear();
        exact.clear();
        exact.extend(face.points.iter().map(|point| grid.to_world(*point)));
        rounded.clear();
        rounded.extend(exact.iter().map(|at| at.map(|coordinate| coordinate as f32)));
        // Invariant: triangles are those of the rounded polygon. A triangle of the exact polygon
        // whose height is less than the rounding may be reversed by it, and then lies on its
        // neighbours: readers would find a surface that is folded there.
        integers(&rounded, &mut points);
        if !triangulator.triangulate(&points, face.ring_ends, &mut triangles) {
            // Rounding made the rings cross.
            wide(face.points, &mut points);
            if !triangulator.triangulate(&points, face.ring_ends, &mut triangles) {
                fan(&join_rings(&points, face.ring_ends), &mut triangles);
            }
        }
        let normal = face.area_vector();
        for triangle in &triangles {
            let exact = triangle.map(|corner| exact[corner as usize]);
            let rounded = triangle.map(|corner| rounded[corner as usize]);
            let [a, b, c] = rounded;
            if a == b || b == c || c == a {
                summary.collapsed += 1;
                continue;
            }
            summary.reversed += u64::from(is_reversed(rounded, normal));
            for (exact, rounded) in exact.iter().zip(&rounded) {
                let by = [0, 1, 2].map(|axis| f64::from(rounded[axis]) - exact[axis]);
                if by != [0.0; 3] {
                    summary.moved += 1;
                    summary.farthest = summary.farthest.max(by.iter().map(|x| x * x).sum::<f64>().sqrt());
                }
            }
            summary.faces += 1;
            sink.face(&exact.map(|at| Vertex { index: 0, at }), 0)?;
        }
        Ok(())
    })?;
    sink.finish()?;
    Ok(summary)
}

/// Fails if single precision cannot distinguish at least 4096 coordinates along the model: far from
/// the origin, it would distort the model visibly.
fn check_precision(job: &Job<'_>, path: &Path) -> Result<()> {
    const MIN_COORDINATES: f64 = 4096.0;
    let mut bounds = None;
    job.each(&mut |face| {
        bounds = join_bounds(bounds, bounds_of(face.points));
        Ok(())
    })?;
    let Some([low, high]) = bounds.map(|bounds| bounds.map(|point| job.faces.grid().to_world(point))) else {
        return Ok(());
    };
    let size = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let farthest = low.iter().chain(&high).fold(0.0, |far: f64, at| far.max(at.abs()));
    // (The distance between numbers in single precision is at most this.)
    let spacing = farthest * f64::from(f32::EPSILON);
    if size >= MIN_COORDINATES * spacing {
        return Ok(());
    }
    let found = format!(
        "a model of a size of {size} at a distance of {farthest} from the origin in the single precision of STL, \
         which would move vertices by up to {:.1e},",
        spacing / 2.0
    );
    // (Moving by integers is exact.)
    let [x, y, z] = low.map(|at| 0.0 - at.floor());
    let advice = format!("move it to the origin with --view translate={x},{y},{z}, or write PLY or OBJ");
    Err(Error::unsupported(path, found, advice))
}

/// Points of a face as integers, in the power of two of which the face has 2^29 to 2^30 units.
/// Smaller differences are far below the precision of the face's largest coordinates.
fn integers(points: &[[f32; 3]], out: &mut Vec<[i64; 3]>) {
    /// Bits of the integers.
    const BITS: i32 = 30;
    let bound = |bound: fn(f64, f64) -> f64, from: f64| -> [f64; 3] {
        points.iter().fold([from; 3], |far, at| [0, 1, 2].map(|axis| bound(far[axis], at[axis].into())))
    };
    let (low, high) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
    let span = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let scale = if span > 0.0 { 2f64.powi(BITS - 1 - span.log2().floor() as i32) } else { 0.0 };
    out.clear();
    out.extend(
        points.iter().map(|at| [0, 1, 2].map(|axis| ((f64::from(at[axis]) - low[axis]) * scale) as i64)),
    );
}

/// Whether rounding turned a triangle of a face with this normal by more than a right angle.
fn is_reversed(triangle: [[f32; 3]; 3], normal: [f64; 3]) -> bool {
    let [a, b, c] = triangle.map(|at| DVec3::from(at.map(f64::from)));
    (b - a).cross(c - a).dot(normal.into()) < 0.0
}

/// Triangles from the first corner of a ring. Used for faces that cannot be triangulated, as they
/// have no area or intersect themselves, but whose edges adjacent faces need.
fn fan(ring: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let Some((&first, rest)) = ring.split_first() else { return };
    triangles.extend(rest.windows(2).map(|pair| [first, pair[0], pair[1]]));
}
