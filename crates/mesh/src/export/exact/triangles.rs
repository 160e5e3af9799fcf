//! Exact models as STL: triangles in single precision.

use super::{ExactSummary, Job, wide};
use crate::export::sink::{Sink, Vertex};
use crate::export::stl::Stl;
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_brep::geometry::{Triangulator, join_rings};

pub(super) fn write(job: &Job<'_>, output: Output) -> Result<ExactSummary> {
    let mut sink = Box::new(Stl::new(output)?);
    let grid = job.faces.grid();
    let mut summary = ExactSummary { lost_parts: job.has_parts(), ..ExactSummary::default() };
    let mut triangulator = Triangulator::new();
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    job.each(&mut |face| {
        summary.lost_colours |= !face.colours.is_empty();
        wide(face.points, &mut points);
        triangles.clear();
        if !triangulator.triangulate(&points, face.ring_ends, &mut triangles) {
            fan(&join_rings(&points, face.ring_ends), &mut triangles);
        }
        for triangle in &triangles {
            let exact = triangle.map(|corner| grid.to_world(face.points[corner as usize]));
            let rounded = exact.map(|at| at.map(|coordinate| coordinate as f32));
            let [a, b, c] = rounded;
            if a == b || b == c || c == a {
                summary.collapsed += 1;
                continue;
            }
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

/// Triangles from the first corner of a ring. Used for faces that cannot be triangulated, as they
/// have no area or intersect themselves, but whose edges adjacent faces need.
fn fan(ring: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let Some((&first, rest)) = ring.split_first() else { return };
    triangles.extend(rest.windows(2).map(|pair| [first, pair[0], pair[1]]));
}
