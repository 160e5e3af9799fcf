//! Exact models as PLY, OBJ or OFF: triangles and convex polygons over numbered vertices.

use super::face_columns::{FaceColumns, material_name, number};
use super::material_library::{library_path, start as start_library};
use super::numbering::CornerNumbers;
use super::survey::Survey;
use super::{ExactSummary, Job};
use crate::export::sink::{Sink, Vertex};
use crate::export::{FaceAttribute, MeshFormat, obj, off, ply};
use spinney_base::Result;
use spinney_base::io::Output;

pub(super) fn write(
    job: &Job<'_>,
    format: MeshFormat,
    columns: &FaceColumns,
    output: Output,
) -> Result<ExactSummary> {
    let survey = Survey::of(job)?;
    // OBJ has face colours only as materials, which require a second file.
    let library = columns.library.as_ref().zip(library_path(&output));
    let library = library.map(|(text, (path, name))| Ok((start_library(&output, path, text)?, name)));
    let (library, library_name) = library.transpose()?.unzip();
    let with_colours =
        survey.has_colours && library.is_none() && (survey.has_shades || format == MeshFormat::Obj);
    let of_faces = survey.has_colours && !with_colours;
    let attribute = if of_faces { FaceAttribute::Colour } else { FaceAttribute::None };
    let directory = output.temporary_directory();
    let mut sink: Box<dyn Sink> = match format {
        MeshFormat::Obj => Box::new(obj::Obj::with_library(output, library_name.as_deref())?),
        MeshFormat::Off => Box::new(off::Off::new(output, attribute, with_colours)?),
        _ => {
            let ply = ply::Ply::of_model(output, attribute, with_colours)?;
            Box::new(ply.with_properties(columns.properties.clone()))
        }
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
        has_library: library.is_some(),
        ..ExactSummary::default()
    };
    let (mut part, mut found, mut corners) = (None, Vec::new(), Vec::new());
    let wanted: Vec<&str> = columns.names.iter().map(String::as_str).collect();
    let (mut material, mut numbers_of_face) = (None, Vec::new());
    job.each_with_values(&wanted, &mut |face, values| {
        match values {
            [] => {}
            [own] if format == MeshFormat::Obj => {
                if material != *own {
                    sink.material(&material_name(own.as_deref()))?;
                    material = own.clone();
                }
            }
            _ => {
                numbers_of_face.clear();
                numbers_of_face.extend(values.iter().map(|json| number(json.as_deref())));
                sink.numbers(&numbers_of_face);
            }
        }
        if has_names && part != Some(face.part) {
            part = Some(face.part);
            sink.part(job.faces.parts().get(face.part as usize).map_or("", String::as_str))?;
        }
        numbers.next(face.points.len(), &mut found)?;
        let vertex = |corner: usize| Vertex { index: found[corner], at: [0.0; 3] };
        corners.clear();
        corners.extend((0..face.points.len()).map(vertex));
        summary.faces += 1;
        let [red, green, blue] = face.colours.first().copied().unwrap_or_default();
        sink.face(&corners, u32::from_be_bytes([0, red, green, blue]))
    })?;
    sink.finish()?;
    library.map_or(Ok(()), Output::commit)?;
    Ok(summary)
}
