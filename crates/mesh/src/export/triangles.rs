//! Export of existing triangle surfaces as mesh files.

use super::losses::Losses;
use super::sink::{Sink, Vertex};
use super::{FaceAttribute, MeshFormat, MeshSummary, SurfaceMesh, obj, off, ply};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;

/// Writes triangle surfaces, open or closed, in double precision: PLY, OBJ or OFF. Surfaces with
/// names become objects in OBJ. Names of several surfaces in other formats, and the source's
/// coordinate system and unit of length, cannot be stored, which is reported as a
/// [warning](Progress::warn).
///
/// # Errors
/// If the format has another precision or requires bodies; if a vertex index is out of range; if
/// the output cannot be written; or on cancellation.
pub fn export_triangles(
    surfaces: &[(String, SurfaceMesh)],
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
    let names = surfaces.iter().filter(|(name, _)| !name.is_empty()).count();
    losses.add(names > 1 && format != MeshFormat::Obj, "the names of the surfaces");
    let mut summary = MeshSummary { vertices: 0, faces: 0 };
    let mut ring = Vec::with_capacity(3);
    for (name, mesh) in surfaces {
        progress.check()?;
        if !name.is_empty() {
            sink.part(name)?;
        }
        for at in &mesh.vertices {
            sink.vertex(*at)?;
        }
        for corners in &mesh.triangles {
            ring.clear();
            for corner in corners {
                let Some(at) = mesh.vertices.get(*corner as usize) else {
                    let expected = format!("less than {}", mesh.vertices.len());
                    return Err(Error::invalid("vertex index", corner.to_string(), expected));
                };
                ring.push(Vertex { index: summary.vertices + u64::from(*corner), at: *at });
            }
            sink.face(&ring, 0)?;
        }
        summary.vertices += mesh.vertices.len() as u64;
        summary.faces += mesh.triangles.len() as u64;
    }
    progress.check()?;
    sink.finish()?;
    losses.report(progress);
    Ok(summary)
}
