//! Export of existing triangle surfaces as mesh files.

use super::losses::Losses;
use super::sink::{Sink, Vertex};
use super::{FaceAttribute, MeshFormat, MeshSummary, SurfaceMesh, obj, off, ply};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;

/// Writes a triangle surface, open or closed, in double precision: PLY, OBJ or OFF. These formats
/// cannot store the source's coordinate system and unit of length, which is reported as a
/// [warning](Progress::warn).
///
/// # Errors
/// If the format has another precision or requires bodies; if a vertex index is out of range; if
/// the output cannot be written; or on cancellation.
pub fn export_triangles(
    mesh: &SurfaceMesh,
    made_of: &Metadata,
    output: Output,
    format: MeshFormat,
    progress: &dyn Progress,
) -> Result<MeshSummary> {
    let mut losses = Losses::of(&output);
    losses.add_place(made_of);
    let mut sink: Box<dyn Sink> = match format {
        MeshFormat::Ply => Box::new(ply::Ply::new(output, FaceAttribute::None, true)?),
        MeshFormat::Obj => Box::new(obj::Obj::new(output)?),
        MeshFormat::Off => Box::new(off::Off::new(output, FaceAttribute::None, false)?),
        MeshFormat::Stl | MeshFormat::CityJson => {
            let found = "a TIN in a format of single precision or of bodies";
            return Err(Error::unsupported(output.path(), found, "write PLY, OBJ or OFF"));
        }
    };
    for at in &mesh.vertices {
        sink.vertex(*at)?;
    }
    let mut ring = Vec::with_capacity(3);
    for corners in &mesh.triangles {
        ring.clear();
        for corner in corners {
            let Some(at) = mesh.vertices.get(*corner as usize) else {
                let expected = format!("less than {}", mesh.vertices.len());
                return Err(Error::invalid("vertex index", corner.to_string(), expected));
            };
            ring.push(Vertex { index: (*corner).into(), at: *at });
        }
        sink.face(&ring, 0)?;
    }
    progress.check()?;
    sink.finish()?;
    losses.report(progress);
    Ok(MeshSummary { vertices: mesh.vertices.len() as u64, faces: mesh.triangles.len() as u64 })
}
