//! Exact models as PLY, OBJ or OFF: single-ring polygons over numbered vertices.

use super::numbering::CornerNumbers;
use super::survey::Survey;
use super::{ExactSummary, Job, temporary_directory, wide};
use crate::export::sink::{Sink, Vertex};
use crate::export::{FaceAttribute, MeshFormat, obj, off, ply};
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_brep::geometry::join_rings;

pub(super) fn write(job: &Job<'_>, format: MeshFormat, output: Output) -> Result<ExactSummary> {
    let survey = Survey::of(job)?;
    // OBJ has face colours only as materials, which require a second file.
    let with_colours = survey.has_colours && (survey.has_shades || format == MeshFormat::Obj);
    let of_faces = survey.has_colours && !with_colours;
    let attribute = if of_faces { FaceAttribute::Colour } else { FaceAttribute::None };
    let directory = temporary_directory(&output);
    let mut sink: Box<dyn Sink> = match format {
        MeshFormat::Obj => Box::new(obj::Obj::new(output)?),
        MeshFormat::Off => Box::new(off::Off::new(output, attribute, with_colours)?),
        _ => Box::new(ply::Ply::of_polygons(output, attribute, with_colours, survey.most_corners)?),
    };
    let grid = job.faces.grid();
    let mut numbers = CornerNumbers::of(job, with_colours, &directory, &mut |(point, colour)| {
        let at = grid.to_world(point);
        if with_colours { sink.coloured_vertex(at, colour) } else { sink.vertex(at) }
    })?;
    let has_names = format == MeshFormat::Obj && (job.has_parts() || job.names_something());
    let mut summary = ExactSummary {
        vertices: numbers.vertices,
        lost_parts: job.has_parts() && format != MeshFormat::Obj,
        ..ExactSummary::default()
    };
    let (mut part, mut found, mut points, mut corners) = (None, Vec::new(), Vec::new(), Vec::new());
    job.each(&mut |face| {
        if has_names && part != Some(face.part) {
            part = Some(face.part);
            sink.part(job.faces.parts().get(face.part as usize).map_or("", String::as_str))?;
        }
        numbers.next(face.points.len(), &mut found)?;
        let vertex = |corner: usize| Vertex { index: found[corner], at: [0.0; 3] };
        corners.clear();
        if face.ring_ends.len() > 1 {
            wide(face.points, &mut points);
            corners.extend(join_rings(&points, face.ring_ends).into_iter().map(|i| vertex(i as usize)));
            summary.bridged_holes += face.ring_ends.len() as u64 - 1;
        } else {
            corners.extend((0..face.points.len()).map(vertex));
        }
        summary.faces += 1;
        let [red, green, blue] = face.colours.first().copied().unwrap_or_default();
        sink.face(&corners, u32::from_be_bytes([0, red, green, blue]))
    })?;
    sink.finish()?;
    Ok(summary)
}
